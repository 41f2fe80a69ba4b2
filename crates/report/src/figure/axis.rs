//! Axes with readable ticks: 1-2-5 steps for lengths, clock steps for time.

use crate::number;

/// One axis: label, range and ticks.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Axis {
    /// Quantity and unit, e.g. `north (m)`.
    pub(crate) label: String,
    /// Lower end.
    pub(crate) low: f64,
    /// Upper end, above the lower one.
    pub(crate) high: f64,
    /// Ticks inside the range, ascending.
    pub(crate) ticks: Vec<Tick>,
    /// What equal lengths represent.
    pub(crate) spacing: Spacing,
}

/// What equal lengths on an axis represent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Spacing {
    /// Equal differences.
    Linear,
    /// Equal ratios. Both ends are positive.
    Logarithmic,
    /// Differences up to this magnitude, ratios above it, on both sides of zero: asinh.
    Symmetric(f64),
}

/// A labelled place on an axis.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Tick {
    /// Position, in the unit of the axis.
    pub(crate) at: f64,
    /// Label.
    pub(crate) label: String,
}

/// Clock steps, s. Longer steps are whole days.
const CLOCK_STEPS: [f64; 20] = [
    0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 15.0, 30.0, 60.0, 120.0, 300.0, 600.0, 900.0, 1800.0, 3600.0, 7200.0, 14400.0,
    21600.0, 43200.0,
];

impl Axis {
    /// An axis for lengths and similar quantities around the given values, with some margin.
    pub(crate) fn linear(label: &str, (low, high): (f64, f64), most_ticks: u32) -> Axis {
        let air = match (high - low) * 0.05 {
            air if air > 0.0 && air > high.abs().max(low.abs()) * 1e-9 => air,
            _ => (high.abs() * 1e-3).max(0.5),
        };
        Axis::exactly(label, (low - air, high + air), most_ticks)
    }

    /// An axis with exactly these ends and 1-2-5 ticks.
    pub(crate) fn exactly(label: &str, (low, high): (f64, f64), most_ticks: u32) -> Axis {
        let step = decimal_step((high - low) / f64::from(most_ticks));
        let decimals = (-step.log10()).ceil().clamp(0.0, 9.0) as i32;
        Axis::plain(label, (low, high), ticks(low, high, step, |at| number::fixed(at, decimals)))
    }

    /// A time axis for a record: seconds up to ten minutes, clock labels for longer records.
    pub(crate) fn record_time(what: &str, (low, high): (f64, f64), most_ticks: u32) -> Axis {
        if low.abs().max(high.abs()) > 600.0 || high <= low {
            return Axis::time(what, (low, high), most_ticks);
        }
        Axis::exactly(&format!("{what} (s)"), (low, high), most_ticks)
    }

    /// A logarithmic axis with exactly these ends, both positive, and 1-2-5 ticks.
    pub(crate) fn logarithmic(label: &str, (low, high): (f64, f64)) -> Axis {
        let low = low.max(1e-9);
        let high = high.max(low * 1.001);
        let powers = (low.log10().floor() as i32)..=(high.log10().ceil() as i32);
        let places = powers.flat_map(|power| [1.0, 2.0, 5.0].map(|m| m * 10f64.powi(power)));
        let inside: Vec<f64> = places.filter(|at| (low..=high).contains(at)).collect();
        let decades_only = inside.len() > 12;
        let is_decade = |at: &f64| (at.log10() - at.log10().round()).abs() < 1e-9;
        let tick = |at: f64| Tick { at, label: number::significant(at, 1) };
        let mut ticks: Vec<Tick> = inside.into_iter().filter(|at| !decades_only || is_decade(at)).map(tick).collect();
        if ticks.len() < 2 {
            ticks = [low, high].map(|at| Tick { at, label: number::significant(at, 3) }).into();
        }
        Axis { spacing: Spacing::Logarithmic, ..Axis::plain(label, (low, high), ticks) }
    }

    /// An axis for small and large numbers of both signs: linear within ±`linear`, logarithmic outside, with ticks at
    /// powers of ten.
    pub(crate) fn symmetric(label: &str, (low, high): (f64, f64), linear: f64) -> Axis {
        let (low, high) = if high > low { (low, high) } else { (low - linear, high + linear) };
        let powers = 0..=(high.abs().max(low.abs()) / linear).log10().ceil().clamp(0.0, 15.0) as i32;
        let sizes: Vec<f64> = powers.map(|power| linear * 10f64.powi(power)).collect();
        let places = sizes.iter().rev().map(|size| -size).chain([0.0]).chain(sizes.iter().copied());
        let inside = places.filter(|at| (low..=high).contains(at));
        let ticks = inside.map(|at| Tick { at, label: number::exact(at) }).collect();
        Axis { spacing: Spacing::Symmetric(linear), ..Axis::plain(label, (low, high), ticks) }
    }

    /// An axis with custom ticks, e.g. for numbered rows.
    pub(crate) fn ticked(label: &str, (low, high): (f64, f64), ticks: Vec<Tick>) -> Axis {
        Axis::plain(label, (low, high), ticks)
    }

    /// Row names at 0, 1, 2…, the first at the top.
    pub(crate) fn rows(names: &[String]) -> Axis {
        let ticks = names.iter().enumerate().map(|(row, name)| Tick { at: row as f64, label: name.clone() });
        Axis { low: names.len() as f64 - 0.4, high: -0.6, ..Axis::ticked("", (-0.6, 0.0), ticks.collect()) }
    }

    fn plain(label: &str, (low, high): (f64, f64), ticks: Vec<Tick>) -> Axis {
        Axis { label: label.to_owned(), low, high, ticks, spacing: Spacing::Linear }
    }

    /// Where a value lies between the ends: 0 at the lower, 1 at the upper one; clamped outside them.
    pub(crate) fn share(&self, value: f64) -> f64 {
        let between = |of: fn(f64) -> f64, unit: f64| {
            let [value, low, high] = [value, self.low, self.high].map(|v| of(v / unit));
            (value - low) / (high - low)
        };
        let share = match self.spacing {
            Spacing::Linear => between(|v| v, 1.0),
            Spacing::Logarithmic => (value.max(self.low) / self.low).ln() / (self.high / self.low).ln(),
            Spacing::Symmetric(linear) => between(f64::asinh, linear),
        };
        share.clamp(0.0, 1.0)
    }

    /// An axis in seconds with clock labels.
    pub(crate) fn time(what: &str, (low, high): (f64, f64), most_ticks: u32) -> Axis {
        let (low, high) = if high > low { (low, high) } else { (low - 0.5, high + 0.5) };
        let step = clock_step((high - low) / f64::from(most_ticks));
        let decimals = usize::from(step < 1.0);
        let long = low.abs().max(high.abs()) >= 3600.0;
        let write = |at| if long { number::clock(at, decimals) } else { number::short_clock(at, decimals) };
        let unit = if long { "h:mm:ss" } else { "m:ss" };
        Axis::plain(&format!("{what} ({unit})"), (low, high), ticks(low, high, step, write))
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
    fn lengths_have_ticks_in_steps_of_1_2_and_5() {
        assert_eq!(
            labels(&Axis::exactly("north (m)", (-61.0, 42.0), 6)),
            ["\u{2212}60", "\u{2212}40", "\u{2212}20", "0", "20", "40"]
        );
        assert_eq!(labels(&Axis::exactly("d (m)", (0.0, 0.05), 5)), ["0.00", "0.01", "0.02", "0.03", "0.04", "0.05"]);
    }

    #[test]
    fn time_has_clock_ticks() {
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
    fn a_logarithmic_axis_shows_equal_ratios_as_equal_lengths() {
        let axis = Axis::logarithmic("frequency (Hz)", (0.1, 10.0));
        assert_eq!(labels(&axis), ["0.1", "0.2", "0.5", "1", "2", "5", "10"]);
        assert!((axis.share(1.0) - 0.5).abs() < 1e-12 && axis.share(0.01) == 0.0 && axis.share(99.0) == 1.0);
        for (low, high) in [(0.3, 0.31), (0.0, 0.0), (1e-300, 1e12), (2.0, 1.0)] {
            let axis = Axis::logarithmic("f", (low, high));
            assert!(axis.high > axis.low && (2..=24).contains(&axis.ticks.len()), "{axis:?}");
            assert!(axis.ticks.iter().all(|t| (axis.low..=axis.high).contains(&t.at)), "{axis:?}");
        }
    }

    #[test]
    fn a_symmetric_axis_is_odd_about_zero_and_ends_in_powers_of_ten() {
        let axis = Axis::symmetric("delay (ms)", (-1000.0, 1000.0), 1.0);
        let expected = ["\u{2212}1000", "\u{2212}100", "\u{2212}10", "\u{2212}1", "0", "1", "10", "100", "1000"];
        assert_eq!(labels(&axis), expected);
        assert!((axis.share(0.0) - 0.5).abs() < 1e-12 && (axis.share(20.0) + axis.share(-20.0) - 1.0).abs() < 1e-12);
        // asinh(10)/asinh(1000)/2 above the middle.
        assert!((axis.share(10.0) - 0.5 - 2.998_223 / 7.600_902 / 2.0).abs() < 1e-6);
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
