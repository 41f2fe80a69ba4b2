//! Single fixes far from their neighbours (S2).

use crate::motion::State;
use record::LateFix;
use statrs::distribution::{Binomial, DiscreteCDF};

/// Distance in robust standard deviations above which a fix is an outlier.
const FAR: f64 = 8.0;
/// The same as a time at the current speed, s.
const FAR_S: f64 = 0.1;
/// Speed below which no fix is treated as an outlier, m/s.
const SLOW_MPS: f64 = 2.0;
/// The neighbours on both sides must agree to within this share of the distance.
const AGREE: f64 = 0.3;
/// If more than this share of the fixes are outliers, none is treated as one.
const MOST_SHARE: f64 = 0.03;
/// A fix lies behind on the track if its offset across is less than this share of the offset along.
const CONE: f64 = 0.6;
/// Share of directions within that cone.
const CONE_SHARE: f64 = 0.172;
const SIGNIFICANCE: f64 = 1e-3;

/// Excluded fixes.
#[derive(Default)]
pub(crate) struct Odd {
    /// Rows.
    pub(crate) rows: Vec<usize>,
    /// Those that lie behind on the track, if there are more than expected by chance.
    pub(crate) late: Vec<LateFix>,
}

/// Examines the residuals `e` (m) about the path; `state` is the motion at each fix.
pub(crate) fn odd_fixes(t: &[f64], e: &[[f64; 2]], state: &[State]) -> Odd {
    let n = e.len();
    if n < 20 {
        return Odd::default();
    }
    let off: Vec<Offset> = (0..n).map(|k| offset(e, k, &state[k])).collect();
    let every = (n / 20_000).max(1);
    let mut sizes: Vec<f64> = off.iter().step_by(every).flat_map(|o| [o.along.abs(), o.across.abs()]).collect();
    let middle = sizes.len() / 2;
    let usual = 1.4826 * *sizes.select_nth_unstable_by(middle, f64::total_cmp).1 + 1e-3;
    let is_odd = |k: &usize| {
        let (o, speed) = (&off[*k], state[*k].speed());
        let size = o.along.hypot(o.across);
        speed > SLOW_MPS && size > (FAR * usual).max(FAR_S * speed) && o.sides_differ < AGREE * size
    };
    let rows: Vec<usize> = (0..n).filter(is_odd).collect();
    if rows.is_empty() || rows.len() as f64 > MOST_SHARE * n as f64 {
        return Odd::default();
    }
    let behind: Vec<usize> = rows.iter().copied().filter(|k| off[*k].is_behind()).collect();
    let late = |k: &usize| LateFix { t_s: t[*k], late_s: -off[*k].along / state[*k].speed() };
    let late = if more_than_chance(behind.len(), rows.len()) { behind.iter().map(late).collect() } else { vec![] };
    Odd { rows, late }
}

fn more_than_chance(behind: usize, of: usize) -> bool {
    let Some(above) = behind.checked_sub(1) else { return false };
    Binomial::new(CONE_SHARE, of as u64).is_ok_and(|b| b.sf(above as u64) < SIGNIFICANCE)
}

/// Offset of a fix from the medians of its neighbours.
struct Offset {
    along: f64,
    across: f64,
    sides_differ: f64,
}

impl Offset {
    fn is_behind(&self) -> bool {
        self.along < 0.0 && self.across.abs() < CONE * self.along.abs()
    }
}

fn offset(e: &[[f64; 2]], k: usize, state: &State) -> Offset {
    let last = e.len() - 1;
    let before = [-3isize, -2, -1].map(|d| k.saturating_add_signed(d));
    let after = [1usize, 2, 3].map(|d| (k + d).min(last));
    let side = |rows: [usize; 3]| [0, 1].map(|a| middle_of(rows.map(|r| e[r][a])));
    let (b, a) = (side(before), side(after));
    let d = [0, 1].map(|i| e[k][i] - 0.5 * (b[i] + a[i]));
    let speed = state.speed().max(0.1);
    let u = [state.velocity[0] / speed, state.velocity[1] / speed];
    Offset {
        along: u[0] * d[0] + u[1] * d[1],
        across: u[0] * d[1] - u[1] * d[0],
        sides_differ: (a[0] - b[0]).hypot(a[1] - b[1]),
    }
}

fn middle_of([a, b, c]: [f64; 3]) -> f64 {
    a.min(b).max(a.max(b).min(c))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flight(late_rows: &[usize], late_s: f64) -> Odd {
        let t: Vec<f64> = (0..400).map(|k| 0.2 * f64::from(k)).collect();
        let state: Vec<State> = t
            .iter()
            .map(|t| State { place: [0.0; 2], velocity: [15.0 * (0.4 * t).cos(), 15.0 * (0.4 * t).sin()] })
            .collect();
        let e: Vec<[f64; 2]> = (0..400)
            .map(|k| {
                let noise = |c: f64| 0.3 * (c * k as f64).sin();
                let late = if late_rows.contains(&k) { late_s } else { 0.0 };
                [noise(1.7) - late * state[k].velocity[0], noise(2.3) - late * state[k].velocity[1]]
            })
            .collect();
        odd_fixes(&t, &e, &state)
    }

    #[test]
    fn late_fixes_are_found_with_their_lateness() {
        let odd = flight(&[60, 133, 200, 301, 350], 0.6);
        assert_eq!(odd.rows, [60, 133, 200, 301, 350]);
        assert_eq!(odd.late.len(), 5);
        assert!(odd.late.iter().all(|l| (l.late_s - 0.6).abs() < 0.05));
    }

    #[test]
    fn a_single_odd_fix_is_not_called_late() {
        let odd = flight(&[133], 0.6);
        assert_eq!((odd.rows.len(), odd.late.len()), (1, 0));
        assert!(flight(&[], 0.0).rows.is_empty());
    }

    /// 17.2 % of directions lie behind: all four of four fixes with 0.09 %, all three of three with 0.5 %.
    #[test]
    fn more_than_chance_means_below_one_in_a_thousand() {
        let probability = |behind: u32, of: u32| -> f64 {
            let choose = |k: u32| (0..k).map(|i| f64::from(of - i) / f64::from(i + 1)).product::<f64>();
            (behind..=of).map(|k| choose(k) * 0.172f64.powi(k as i32) * 0.828f64.powi((of - k) as i32)).sum()
        };
        for of in 1..12 {
            for behind in 0..=of {
                let expected = probability(behind, of) < 1e-3;
                assert_eq!(more_than_chance(behind as usize, of as usize), expected, "{behind} of {of}");
            }
        }
    }

    #[test]
    fn the_middle_of_three_is_between_the_others() {
        for [a, b, c] in [[1.0, 2.0, 3.0], [3.0, 1.0, 2.0], [2.0, 3.0, 1.0], [3.0, 2.0, 1.0], [2.0, 2.0, 1.0]] {
            assert_eq!(middle_of([a, b, c]), 2.0);
        }
    }

    /// Flying north-east, a fix 3 m north of the medians of its neighbours is √4.5 m along and −√4.5 m across.
    #[test]
    fn an_offset_is_split_along_and_across_the_direction() {
        let mut e = vec![[10.0, -5.0]; 9];
        e[5] = [40.0, 40.0];
        e[4] = [13.0, -5.0];
        let u = 15.0 / 2f64.sqrt();
        let o = offset(&e, 4, &State { place: [0.0; 2], velocity: [u, u] });
        let side = 4.5f64.sqrt();
        assert!((o.along - side).abs() < 1e-9 && (o.across + side).abs() < 1e-9 && o.sides_differ == 0.0);
        assert!(!o.is_behind());
        let behind = offset(&e, 4, &State { place: [0.0; 2], velocity: [-15.0, -8.0] });
        assert!(behind.along < 0.0 && behind.is_behind());
    }

    /// On a straight line, with noise of 0.3 m and the fixes off by `off`.
    fn line(fixes: usize, speed: f64, off: impl Fn(usize) -> [f64; 2]) -> Odd {
        let t: Vec<f64> = (0..fixes).map(|k| 0.2 * k as f64).collect();
        let state = vec![State { place: [0.0; 2], velocity: [speed, 0.0] }; fixes];
        let noise = |k: usize, c: f64| 0.3 * (c * k as f64).sin();
        let e: Vec<[f64; 2]> = (0..fixes).map(|k| [noise(k, 1.7) + off(k)[0], noise(k, 2.3) + off(k)[1]]).collect();
        odd_fixes(&t, &e, &state)
    }

    #[test]
    fn few_fixes_slow_fixes_and_many_outliers_are_left_alone() {
        let one = |k: usize| if k == 10 { [-15.0, 0.0] } else { [0.0; 2] };
        assert_eq!(line(20, 15.0, one).rows.len(), 0, "one of 20 is more than 3 %");
        assert_eq!(line(40, 15.0, one).rows, [10]);
        assert_eq!(line(40, 1.9, one).rows.len(), 0, "at a standstill late and wrong look alike");
        assert_eq!(line(40, 15.0, |k| if k % 20 == 10 { [-15.0, 0.0] } else { [0.0; 2] }).rows.len(), 0, "two of 40");
        assert_eq!(line(80, 15.0, |k| if k % 40 == 10 { [-15.0, 0.0] } else { [0.0; 2] }).rows, [10, 50]);
        // A step is not an outlier: the sides differ.
        assert_eq!(line(40, 15.0, |k| if k >= 10 { [-15.0, 0.0] } else { [0.0; 2] }).rows.len(), 0);
    }
}
