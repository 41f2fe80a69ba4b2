//! Whether one channel moves as another says, and if it does not, what would make it.

use super::pieces::{Names, Piece, Stretch};
use crate::input::{AXES, Horizontal};

/// A pair whose displacements disagree by more than this share does not belong together.
const MOST_UNEXPLAINED: f64 = 0.5;
/// Another unit or other axes are named where they leave so little.
const EXPLAINED: f64 = 0.2;
/// A ratio of two units is recognised within this, as a logarithm.
const NEAR: f64 = 0.03;
/// Ratios by which values are wrong whose unit is taken for another.
const UNITS: [(f64, &str); 7] = [
    (3.6, "km/h were read as m/s"),
    (1.943_844, "knots were read as m/s"),
    (3.280_84, "feet were read as metres"),
    (2.236_936, "mi/h were read as m/s"),
    (100.0, "centimetres were read as metres"),
    (1000.0, "millimetres were read as metres"),
    (57.295_78, "radians were read as degrees"),
];

/// How far displacements of two channels over the same times agree.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Agreement {
    /// Share of the displacement (rms) of the first that the second leaves over.
    pub(crate) unexplained: f64,
    way: Way,
}

/// The second channel with other axes and another scale.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Way {
    swapped: bool,
    signs: [f64; 2],
    /// The second channel over the first.
    ratio: f64,
    unexplained: f64,
}

impl Agreement {
    /// Why such a pair is no measurement of a delay, and what would make it one.
    pub(crate) fn refusal(&self, Names { first, second }: &Names) -> Option<String> {
        let share = 100.0 * self.unexplained;
        let check = self.way.words(second).unwrap_or_else(|| "Check axes, signs and units of both".to_owned());
        (self.unexplained > MOST_UNEXPLAINED).then(|| {
            format!("{first} does not move as {second} says: {share:.0} % of its displacement is left over at the best delay. {check}")
        })
    }
}

impl Way {
    fn words(&self, second: &str) -> Option<String> {
        let near = |ratio: f64| (self.ratio / ratio).ln().abs() < NEAR;
        let unit = UNITS.iter().find_map(|(ratio, words)| match (near(*ratio), near(1.0 / ratio)) {
            (true, _) => Some(format!(", as if {words} in {second}")),
            (_, true) => Some(format!(", as if {words} in the other channel")),
            _ => None,
        });
        let scale = (!near(1.0)).then(|| format!("divided by {:.3}{}", self.ratio, unit.unwrap_or_default()));
        let sign = |axis: usize, name: &str| (self.signs[axis] < 0.0).then(|| format!("{name} negated"));
        let axes = self.swapped.then(|| "north and east exchanged".to_owned());
        let all: Vec<String> = [axes, sign(0, "north"), sign(1, "east"), scale].into_iter().flatten().collect();
        let left = 100.0 * self.unexplained;
        (self.unexplained < EXPLAINED && !all.is_empty()).then(|| {
            format!(
                "With {second} {} it would ({left:.0} % left over): check axes and units of the channel map",
                all.join(" and ")
            )
        })
    }
}

/// Agreement over 5, 10 or 20 s, whichever leaves least: noise counts less the longer, drift the shorter. Of a flight too short
/// for three of these, over a fifth of its longest piece.
pub(crate) fn agreement(
    first: &Horizontal,
    pieces: &[Piece],
    stretches: &[Stretch],
    delay_s: f64,
) -> Option<Agreement> {
    let over = |base_s: f64| of_steps(&steps(first, pieces, stretches, delay_s, base_s));
    let longest_s = pieces.iter().map(|piece| piece.duration_s(first)).fold(0.0, f64::max);
    let least = |a: &Agreement, b: &Agreement| a.unexplained.total_cmp(&b.unexplained);
    [5.0, 10.0, 20.0].into_iter().filter_map(over).min_by(least).or_else(|| over(longest_s / 5.0))
}

/// A displacement of the first channel, and what the second says of it.
type Step = ([f64; 2], [f64; 2]);

/// Steps of at least `base_s`.
fn steps(first: &Horizontal, pieces: &[Piece], stretches: &[Stretch], delay_s: f64, base_s: f64) -> Vec<Step> {
    let mut steps = vec![];
    for piece in pieces {
        let mut i = 0;
        for j in 0..piece.rows.len() {
            let (a, b) = (piece.rows[i], piece.rows[j]);
            if first.t[b] - first.t[a] < base_s {
                continue;
            }
            let at = |axis: usize, row: usize| stretches[piece.stretch][axis].value_and_rate(first.t[row] - delay_s).0;
            let moved = AXES.map(|axis| first.axes[axis][b] - first.axes[axis][a]);
            steps.push((moved, AXES.map(|axis| at(axis, b) - at(axis, a))));
            i = j;
        }
    }
    steps
}

fn of_steps(steps: &[Step]) -> Option<Agreement> {
    let sum = |of: &dyn Fn(&Step) -> f64| steps.iter().map(of).sum::<f64>();
    let moved2 = sum(&|(moved, _)| moved[0].powi(2) + moved[1].powi(2));
    let said2 = sum(&|(_, said)| said[0].powi(2) + said[1].powi(2));
    let missed2 = sum(&|(moved, said)| (moved[0] - said[0]).powi(2) + (moved[1] - said[1]).powi(2));
    let way = |swapped: bool, signs: [f64; 2]| {
        let said = |step: &Step| if swapped { [step.1[1], step.1[0]] } else { step.1 };
        let cross = sum(&|step| signs[0] * step.0[0] * said(step)[0] + signs[1] * step.0[1] * said(step)[1]);
        let agreed = cross.max(0.0) / (moved2 * said2).sqrt().max(f64::MIN_POSITIVE);
        let ratio = (said2 / moved2).sqrt();
        Way { swapped, signs, ratio, unexplained: (1.0 - agreed.powi(2)).max(0.0).sqrt() }
    };
    let signs = [[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]];
    let ways = [false, true].into_iter().flat_map(|swapped| signs.map(|signs| way(swapped, signs)));
    let best = ways.min_by(|a, b| a.unexplained.total_cmp(&b.unexplained))?;
    (steps.len() >= 3 && moved2 > 0.0).then(|| Agreement { unexplained: (missed2 / moved2).sqrt(), way: best })
}

#[cfg(test)]
mod tests {
    use super::*;

    const NAMES: Names<'static> = Names { first: "position", second: "velocity" };

    /// Steps round circles, of which the second channel says `said`.
    fn circles(said: impl Fn([f64; 2]) -> [f64; 2]) -> Agreement {
        let moved = |k: u32| [20.0 * f64::from(k).cos(), 20.0 * (1.3 * f64::from(k)).sin()];
        of_steps(&(0..60).map(|k| (moved(k), said(moved(k)))).collect::<Vec<Step>>()).unwrap()
    }

    #[test]
    fn what_moves_alike_is_not_refused() {
        assert_eq!(circles(|moved| moved).refusal(&NAMES), None);
        assert_eq!(circles(|[n, e]| [1.1 * n, 1.1 * e]).refusal(&NAMES), None);
    }

    #[test]
    fn a_refusal_says_which_unit_and_which_axes_would_fit() {
        for (said, words) in [
            (
                circles(|[n, e]| [3.6 * n, 3.6 * e]),
                "velocity divided by 3.600, as if km/h were read as m/s in velocity it would",
            ),
            (circles(|[n, e]| [0.3048 * n, 0.3048 * e]), "as if feet were read as metres in the other channel"),
            (circles(|[n, e]| [e, n]), "With velocity north and east exchanged it would (0 % left over)"),
            (circles(|[n, e]| [n, -e]), "With velocity east negated it would"),
            (
                circles(|[n, e]| [7.0 * e, -7.0 * n]),
                "north and east exchanged and north negated and divided by 7.000 it would",
            ),
        ] {
            let refusal = said.refusal(&NAMES).unwrap();
            assert!(refusal.contains(words), "{refusal}");
        }
    }

    #[test]
    fn what_fits_in_no_way_is_told_to_check_all() {
        let refusal = circles(|[n, e]| [n * e, n - 3.0 * e]).refusal(&NAMES).unwrap();
        assert!(refusal.ends_with("Check axes, signs and units of both"), "{refusal}");
    }
}
