//! Whether one channel moves like another, and if not, what change would make it match.

use super::pieces::{Names, Piece, Stretch};
use crate::horizontal::{AXES, Horizontal};

/// The largest relative difference of the displacements of two channels of one vehicle.
const MOST_UNEXPLAINED: f64 = 0.5;
/// A different unit or other axes are suggested if they leave at most this share.
const EXPLAINED: f64 = 0.2;
/// A smaller difference of the headings is not reported, °.
const LEAST_TURNED_DEG: f64 = 3.0;
/// Fewer displacements give no result.
const LEAST_STEPS: usize = 3;
/// Delays at which other units and axes are tried, s.
const SEARCHED_S: (f64, f64) = (-1.0, 3.0);
const TRIED: u32 = 40;
/// Logarithmic tolerance for recognising the ratio of two units.
const NEAR: f64 = 0.1;
/// Ratios from mistaken units: the actual unit, and the unit assumed.
const UNITS: [(f64, &str, &str); 7] = [
    (3.6, "km/h", "m/s"),
    (1.943_844, "knots", "m/s"),
    (3.280_84, "feet", "metres"),
    (2.236_936, "mi/h", "m/s"),
    (100.0, "centimetres", "metres"),
    (1000.0, "millimetres", "metres"),
    (57.295_78, "degrees", "radians"),
];

/// The second channel with other axes and another scale.
#[derive(Debug, Clone, Copy, PartialEq)]
struct AxesMatch {
    swapped: bool,
    signs: [f64; 2],
    /// The second channel over the first.
    ratio: f64,
    unexplained: f64,
}

/// Inputs of the comparison.
pub(crate) struct Compared<'a> {
    pub(crate) first: &'a Horizontal,
    pub(crate) pieces: &'a [Piece],
    pub(crate) stretches: &'a [Stretch<'a>],
    /// Delay at which the pair fits best.
    pub(crate) delay_s: f64,
}

impl Compared<'_> {
    /// Rms share of the displacement of the first channel that the second does not explain, over 5, 10 or 20 s,
    /// whichever is least: over longer spans noise matters less, over shorter ones drift. For a flight too short for
    /// three of these, over a fifth of its longest piece.
    pub(crate) fn unexplained_share(&self) -> Option<f64> {
        let over = |base_s: f64| unexplained_of(&self.steps(base_s, self.delay_s));
        [5.0, 10.0, 20.0].into_iter().filter_map(over).min_by(f64::total_cmp).or_else(|| over(self.longest_s() / 5.0))
    }

    /// Why such a pair does not measure a delay, and what would fix it.
    pub(crate) fn refusal(&self, share: Option<f64>, names: &Names) -> Option<String> {
        let Names { first, second } = names;
        let share = share.filter(|share| *share > MOST_UNEXPLAINED)?;
        let of_axes = || self.best_match().and_then(|found| found.words(names));
        let check = of_axes().or_else(|| self.turned_words(names));
        Some(format!(
            "{first} does not move as {second} predicts: {:.0} % of its displacement is unexplained at the best delay. \
             {}",
            100.0 * share,
            check.unwrap_or_else(|| "Check axes, signs and units of both".to_owned())
        ))
    }

    /// By how much the second channel is turned against the first, in words, if that explains most of what is unexplained:
    /// the heading of a compass is often off by some degrees.
    pub(crate) fn turned_words(&self, Names { first, second }: &Names) -> Option<String> {
        let base_s = 5.0_f64.min(self.longest_s() / 5.0);
        let as_it_is = unexplained_of(&self.steps(base_s, self.delay_s))?;
        let turned = self.delays().filter_map(|delay_s| turned_of(&self.steps(base_s, delay_s)));
        let (angle, left) = turned.min_by(|a, b| a.1.total_cmp(&b.1))?;
        let degrees = angle.to_degrees();
        let side = if degrees > 0.0 { "right" } else { "left" };
        (degrees.abs() > LEAST_TURNED_DEG && left < EXPLAINED && left < 0.5 * as_it_is).then(|| {
            format!(
                "{:.0} % would be unexplained if {second} were turned to the {side} by {:.0}°: check the heading of it and of \
                 {first}, such as the declination, or the mounting of a compass",
                100.0 * left,
                degrees.abs()
            )
        })
    }

    /// Delays at which other units and axes are tried, s.
    fn delays(&self) -> impl Iterator<Item = f64> {
        let tried = (0..=TRIED).map(|i| SEARCHED_S.0 + (SEARCHED_S.1 - SEARCHED_S.0) * f64::from(i) / f64::from(TRIED));
        tried.chain([self.delay_s])
    }

    /// The best scale and axes, at any delay: for channels that do not belong together the best delay is arbitrary.
    fn best_match(&self) -> Option<AxesMatch> {
        let base_s = 5.0_f64.min(self.longest_s() / 5.0);
        let matches = self.delays().filter_map(|delay_s| match_of(&self.steps(base_s, delay_s)));
        matches.min_by(|a, b| a.unexplained.total_cmp(&b.unexplained))
    }

    fn longest_s(&self) -> f64 {
        self.pieces.iter().map(|piece| piece.duration_s(self.first)).fold(0.0, f64::max)
    }

    /// Displacements over at least `base_s` of the first channel, and those predicted by the second.
    fn steps(&self, base_s: f64, delay_s: f64) -> Vec<Step> {
        let first = self.first;
        let mut steps = vec![];
        for piece in self.pieces {
            let stretch = &self.stretches[piece.stretch];
            let (begin, end) = stretch[0].span();
            let rows: Vec<usize> =
                piece.rows.iter().copied().filter(|row| (begin..=end).contains(&(first.t[*row] - delay_s))).collect();
            let mut i = 0;
            for j in 0..rows.len() {
                let (a, b) = (rows[i], rows[j]);
                if first.t[b] - first.t[a] < base_s {
                    continue;
                }
                let at = |axis: usize, row: usize| stretch[axis].value_and_rate(first.t[row] - delay_s).0;
                let moved = AXES.map(|axis| first.axes[axis][b] - first.axes[axis][a]);
                steps.push((moved, AXES.map(|axis| at(axis, b) - at(axis, a))));
                i = j;
            }
        }
        steps
    }
}

impl AxesMatch {
    /// What would make the pair match; `None` if this does not, or changes nothing.
    fn words(&self, Names { first, second }: &Names) -> Option<String> {
        let (factor, verb, wrong) = match self.ratio >= 1.0 {
            true => (self.ratio, "divided", second),
            false => (1.0 / self.ratio, "multiplied", first),
        };
        let distance = |ratio: f64| (factor / ratio).ln().abs();
        let nearest = UNITS.iter().min_by(|a, b| distance(a.0).total_cmp(&distance(b.0)));
        let unit = nearest.filter(|(ratio, ..)| distance(*ratio) < NEAR);
        let unit = unit.map(|(_, is, read)| format!(", as if {wrong} were in {is} and read as {read}"));
        let scale =
            (distance(1.0) > NEAR).then(|| format!("{second} were {verb} by {factor:.2}{}", unit.unwrap_or_default()));
        let sign =
            |axis: usize, name: &str| (self.signs[axis] < 0.0).then(|| format!("{name} of {second} were negated"));
        let axes = self.swapped.then(|| format!("north and east of {second} were exchanged"));
        let all: Vec<String> = [axes, sign(0, "north"), sign(1, "east"), scale].into_iter().flatten().collect();
        let left = 100.0 * self.unexplained;
        (self.unexplained < EXPLAINED && !all.is_empty()).then(|| {
            let all = all.join(", and ");
            format!("{left:.0} % would be unexplained if {all}: check axes and units of the channel map")
        })
    }
}

/// A displacement of the first channel, and that predicted by the second.
type Step = ([f64; 2], [f64; 2]);

fn squared([north, east]: [f64; 2]) -> f64 {
    north * north + east * east
}

fn unexplained_of(steps: &[Step]) -> Option<f64> {
    let moved2: f64 = steps.iter().map(|(moved, _)| squared(*moved)).sum();
    let missed2: f64 =
        steps.iter().map(|(moved, predicted)| squared(AXES.map(|axis| moved[axis] - predicted[axis]))).sum();
    (steps.len() >= LEAST_STEPS && moved2 > 0.0).then(|| (missed2 / moved2).sqrt())
}

/// The angle from the predicted displacements to those of the first channel, rad, and the share that is then unexplained.
fn turned_of(steps: &[Step]) -> Option<(f64, f64)> {
    let dot: f64 = steps.iter().map(|(moved, by)| moved[0] * by[0] + moved[1] * by[1]).sum();
    let cross: f64 = steps.iter().map(|(moved, by)| by[0] * moved[1] - by[1] * moved[0]).sum();
    let angle = cross.atan2(dot);
    let (sin, cos) = angle.sin_cos();
    let turned = |(moved, [north, east]): &Step| (*moved, [cos * north - sin * east, sin * north + cos * east]);
    Some((angle, unexplained_of(&steps.iter().map(turned).collect::<Vec<Step>>())?))
}

fn match_of(steps: &[Step]) -> Option<AxesMatch> {
    let moved2: f64 = steps.iter().map(|(moved, _)| squared(*moved)).sum();
    let predicted2: f64 = steps.iter().map(|(_, predicted)| squared(*predicted)).sum();
    if steps.len() < LEAST_STEPS || moved2 == 0.0 || predicted2 == 0.0 {
        return None;
    }
    let matched = |swapped: bool, signs: [f64; 2]| {
        let cross = |(moved, predicted): &Step| {
            let predicted = if swapped { [predicted[1], predicted[0]] } else { *predicted };
            signs[0] * moved[0] * predicted[0] + signs[1] * moved[1] * predicted[1]
        };
        let agreed = steps.iter().map(cross).sum::<f64>().max(0.0) / (moved2 * predicted2).sqrt();
        AxesMatch {
            swapped,
            signs,
            ratio: (predicted2 / moved2).sqrt(),
            unexplained: (1.0 - agreed * agreed).max(0.0).sqrt(),
        }
    };
    let signs = [[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]];
    let matches = [false, true].into_iter().flat_map(|swapped| signs.map(|signs| matched(swapped, signs)));
    matches.min_by(|a, b| a.unexplained.total_cmp(&b.unexplained))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Steps around circles, with the second channel given by `predicted`: the refusal, if any.
    fn circles(predicted: impl Fn([f64; 2]) -> [f64; 2]) -> Option<String> {
        let moved = |k: u32| [20.0 * f64::from(k).cos(), 20.0 * (1.3 * f64::from(k)).sin()];
        let steps: Vec<Step> = (0..60).map(|k| (moved(k), predicted(moved(k)))).collect();
        let refused = unexplained_of(&steps).unwrap() > MOST_UNEXPLAINED;
        refused.then(|| {
            match_of(&steps).unwrap().words(&Names { first: "position", second: "velocity" }).unwrap_or_default()
        })
    }

    #[test]
    fn matching_channels_are_not_refused() {
        assert_eq!(circles(|moved| moved), None);
        assert_eq!(circles(|[n, e]| [1.1 * n, 1.1 * e]), None);
    }

    #[test]
    fn a_turned_channel_is_recognised_with_its_angle() {
        let (sin, cos) = 0.35_f64.sin_cos();
        let moved = |k: u32| [20.0 * f64::from(k).cos(), 20.0 * (1.3 * f64::from(k)).sin()];
        // The first channel is the second turned by 0.35 rad to the right.
        let steps: Vec<Step> =
            (0..60).map(moved).map(|[n, e]| ([cos * n - sin * e, sin * n + cos * e], [n, e])).collect();
        let (angle, left) = turned_of(&steps).unwrap();
        assert!((angle - 0.35).abs() < 1e-9 && left < 1e-9, "{angle} {left}");
    }

    #[test]
    fn a_refusal_names_the_unit_and_axes_that_would_fit() {
        for (refusal, words) in [
            (
                circles(|[n, e]| [3.6 * n, 3.6 * e]),
                "0 % would be unexplained if velocity were divided by 3.60, as if velocity were in km/h and read as \
                 m/s:",
            ),
            (
                circles(|[n, e]| [0.3048 * n, 0.3048 * e]),
                "if velocity were multiplied by 3.28, as if position were in feet and read as metres:",
            ),
            (circles(|[n, e]| [e, n]), "if north and east of velocity were exchanged:"),
            (circles(|[n, e]| [n, -e]), "if east of velocity were negated:"),
            (
                circles(|[n, e]| [7.0 * e, -7.0 * n]),
                "were exchanged, and north of velocity were negated, and velocity were divided by 7.00:",
            ),
        ] {
            let refusal = refusal.unwrap();
            assert!(refusal.contains(words), "{refusal}");
        }
    }

    #[test]
    fn channels_that_match_in_no_way_get_no_suggestion() {
        assert_eq!(circles(|[n, e]| [n * e, n - 3.0 * e]), Some(String::new()));
    }
}
