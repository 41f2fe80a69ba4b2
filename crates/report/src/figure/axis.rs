//! Axes with thoughtful ticks: 1-2-5 steps for lengths, clock steps for time.

use crate::number;

/// One axis: its words, its range, its ticks.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Axis {
    /// Quantity and unit, as `north (m)`.
    pub(crate) label: String,
    /// Lower end.
    pub(crate) low: f64,
    /// Upper end, above the lower one.
    pub(crate) high: f64,
    /// Ticks inside the range, rising.
    pub(crate) ticks: Vec<Tick>,
}

/// A labelled place on an axis.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Tick {
    /// Where, in the axis' unit.
    pub(crate) at: f64,
    /// What is written there.
    pub(crate) label: String,
}

/// Steps of a clock, s. Longer ones are whole days.
const CLOCK_STEPS: [f64; 20] = [
    0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 15.0, 30.0, 60.0, 120.0, 300.0, 600.0, 900.0, 1800.0, 3600.0, 7200.0, 14400.0,
    21600.0, 43200.0,
];

impl Axis {
    /// An axis for lengths and the like around the given values, with some air.
    pub(crate) fn linear(label: &str, (low, high): (f64, f64), most_ticks: u32) -> Axis {
        let air = match (high - low) * 0.05 {
            air if air > 0.0 && air > high.abs().max(low.abs()) * 1e-9 => air,
            _ => (high.abs() * 1e-3).max(0.5),
        };
        Axis::exactly(label, (low - air, high + air), most_ticks)
    }

    /// An axis from end to end, with 1-2-5 ticks.
    pub(crate) fn exactly(label: &str, (low, high): (f64, f64), most_ticks: u32) -> Axis {
        let step = decimal_step((high - low) / f64::from(most_ticks));
        let decimals = (-step.log10()).ceil().clamp(0.0, 9.0) as i32;
        Axis { label: label.to_owned(), low, high, ticks: ticks(low, high, step, |at| number::fixed(at, decimals)) }
    }

    /// An axis of seconds, labelled as a clock.
    pub(crate) fn time(what: &str, (low, high): (f64, f64), most_ticks: u32) -> Axis {
        let (low, high) = if high > low { (low, high) } else { (low - 0.5, high + 0.5) };
        let step = clock_step((high - low) / f64::from(most_ticks));
        let decimals = usize::from(step < 1.0);
        let long = low.abs().max(high.abs()) >= 3600.0;
        let write = |at| if long { number::clock(at, decimals) } else { number::short_clock(at, decimals) };
        let unit = if long { "h:mm:ss" } else { "m:ss" };
        Axis { label: format!("{what} ({unit})"), low, high, ticks: ticks(low, high, step, write) }
    }
}

/// The smallest of 1, 2, 5 times a power of ten that is not below `least`.
fn decimal_step(least: f64) -> f64 {
    let power = 10f64.powf(least.log10().floor());
    [1.0, 2.0, 5.0].into_iter().map(|m| m * power).find(|step| *step >= least * 0.999_999).unwrap_or(10.0 * power)
}

fn clock_step(least: f64) -> f64 {
    const DAY: f64 = 86_400.0;
    if least < CLOCK_STEPS[0] {
        return decimal_step(least);
    }
    let whole_days = || decimal_step(least / DAY).max(1.0) * DAY;
    CLOCK_STEPS.into_iter().find(|step| *step >= least).unwrap_or_else(whole_days)
}

fn ticks(low: f64, high: f64, step: f64, write: impl Fn(f64) -> String) -> Vec<Tick> {
    if !(step.is_finite() && step > 0.0) {
        return Vec::new();
    }
    let slack = step * 1e-6;
    let first = ((low - slack) / step).ceil();
    (0..50)
        .map(|i| (first + f64::from(i)) * step)
        .take_while(|at| *at <= high + slack)
        .map(|at| Tick { at: at.clamp(low, high), label: write(at) })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(axis: &Axis) -> Vec<&str> {
        axis.ticks.iter().map(|t| t.label.as_str()).collect()
    }

    #[test]
    fn lengths_are_ticked_in_ones_twos_and_fives() {
        assert_eq!(
            labels(&Axis::exactly("north (m)", (-61.0, 42.0), 6)),
            ["\u{2212}60", "\u{2212}40", "\u{2212}20", "0", "20", "40"]
        );
        assert_eq!(labels(&Axis::exactly("d (m)", (0.0, 0.05), 5)), ["0.00", "0.01", "0.02", "0.03", "0.04", "0.05"]);
    }

    #[test]
    fn time_is_ticked_as_a_clock() {
        let minutes = Axis::time("time", (0.0, 725.0), 10);
        assert_eq!(labels(&minutes)[..4], ["0:00", "2:00", "4:00", "6:00"]);
        assert_eq!(minutes.label, "time (m:ss)");
        assert_eq!(
            labels(&Axis::time("time", (0.0, 7300.0), 5)),
            ["0:00:00", "0:30:00", "1:00:00", "1:30:00", "2:00:00"]
        );
        assert_eq!(
            labels(&Axis::time("time", (10.0, 11.0), 6)),
            ["0:10.0", "0:10.2", "0:10.4", "0:10.6", "0:10.8", "0:11.0"]
        );
    }

    #[test]
    fn any_range_gives_a_few_ticks_inside_it() {
        for (low, high) in [(0.0, 0.0), (1e12, 1e12), (-1e12, 1e12), (5.0, 5.0 + 1e-12), (-3.0, 1e-300)] {
            for axis in [Axis::linear("x (m)", (low, high), 6), Axis::time("t", (low, high), 8)] {
                assert!(axis.high > axis.low, "{axis:?}");
                assert!(!axis.ticks.is_empty() && axis.ticks.len() <= 12, "{axis:?}");
                assert!(axis.ticks.iter().all(|t| (axis.low..=axis.high).contains(&t.at)), "{axis:?}");
            }
        }
    }
}
