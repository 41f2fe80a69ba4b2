//! The curve of a delay, and its description if the delay changes (S3, S6, S7).

use crate::bins::{self, Flexible, Noise};
use crate::coarse::{CoarseMap, interpolate};
use crate::delays::delays;
use crate::describe::{Description, describe};
use crate::fixes::Fixes;
use crate::motion::Motion;
use crate::noise_shape::Sample;
use crate::refine::{Refined, Refinement};
use crate::shape::Shape;
use crate::stages::{Test, fit_all, usual_length};
use crate::windows::{Scratch, Starts, Window};

/// Change of the coarse path above which a description is tried, s.
const MOVED_S: f64 = 0.25;
/// Least span, s, of a description that decides by what it explains; the share of squares it may leave; and that share
/// with any one window left out.
const EXPLAINED_SPAN_S: f64 = 0.25;
const UNEXPLAINED: f64 = 0.6;
/// Limit on the squares of a window, in medians.
const MOST_SQUARES: f64 = 10.0;
const UNEXPLAINED_WITHOUT_ONE: f64 = 0.7;
/// Least number of moving windows for this.
const LEAST_MOVING: usize = 4;
/// A curve on bins that leaves more than this will not explain enough on the fixes.
const MOST_LEFT_ON_BINS: f64 = 0.9;
/// Number of alternations between noise and description.
const TURNS: usize = 3;
/// Bins of the flexible fit: least length, s, and the number of bins if the delay is constant and if it varies.
const BIN_S: f64 = 2.0;
const BIN_FIXES: f64 = 4.0;
const BINS_CONSTANT: f64 = 80.0;
const BINS_VARYING: f64 = 160.0;

/// Input of the description.
pub(crate) struct Change<'a> {
    pub(crate) motion: &'a Motion,
    pub(crate) map: &'a CoarseMap,
    /// Fixes without those near jumps, and with them.
    pub(crate) fixes: Fixes,
    pub(crate) edges: Fixes,
    pub(crate) test: Option<&'a Test>,
    pub(crate) interval_s: f64,
    pub(crate) span_s: [f64; 2],
}

/// Curve and description.
pub(crate) struct Described {
    pub(crate) noise: Noise,
    pub(crate) flexible: Option<Flexible>,
    pub(crate) refined: Option<Refined>,
    /// Whether the description alone shows that the delay varies.
    pub(crate) explained: bool,
}

impl Change<'_> {
    pub(crate) fn describe(&self, noise: Noise, scratch: &mut Scratch) -> Described {
        let varies = self.test.is_some_and(Test::varies);
        let moved = self.map.path_span_s() > MOVED_S;
        let level = self.level();
        let bins = if varies || moved { BINS_VARYING } else { BINS_CONSTANT };
        let bin_s = BIN_S.max(BIN_FIXES * self.interval_s).max((self.span_s[1] - self.span_s[0]) / bins);
        let flexible = self.flexible(&noise, bin_s, varies || moved, if varies { self.map.constant_s } else { level });
        let refined = match &flexible {
            Some(f) if varies => self.refined(describe(f, self.inflation()), noise, bin_s),
            Some(f) if moved => self.refined_if_promising(f, noise, bin_s),
            _ => None,
        };
        let mut out = Described { noise, flexible, refined, explained: false };
        // The noise estimate also absorbed the change: remove the change and estimate again.
        let turns = match (varies, moved) {
            (true, true) => 1,
            (true, false) => 0,
            (false, _) => TURNS,
        };
        for _ in 0..turns {
            let (Some(first), Some(_)) = (out.refined.take(), self.test) else { break };
            self.turn(&mut out, first, bin_s, varies, scratch);
        }
        out.refined = out.refined.filter(|_| varies || out.explained);
        out
    }

    /// Noise without the description `first`, and the description with that noise.
    fn turn(&self, out: &mut Described, first: Refined, bin_s: f64, varies: bool, scratch: &mut Scratch) {
        let level = self.level();
        let retimed = self.fixes.retimed(&|t| first.description.at(t) - level);
        let at_level = |_| level;
        let calm = Starts::new(&retimed, self.motion, level, &at_level);
        out.noise = noise_about(&retimed, self.motion, &calm, self.interval_s, out.noise, scratch);
        let start = |t: f64| first.description.at(t);
        out.flexible = bins::fit(&self.fixes, self.motion, &out.noise, &start, bin_s).or(out.flexible.take());
        let again = out.flexible.as_ref().map(|f| describe(f, self.inflation()));
        let again = again.and_then(|d| self.refined(d, out.noise, bin_s)).unwrap_or(first);
        out.explained = !varies && self.explains(&again.description, out.noise, bin_s);
        out.refined = Some(again);
    }

    fn level(&self) -> f64 {
        self.test.map_or(self.map.constant_s, |t| t.all.level.size)
    }

    fn inflation(&self) -> f64 {
        self.test.map_or(1.0, |t| t.all.inflation)
    }

    fn refinement(&self, noise: Noise, bin_s: f64) -> Refinement<'_> {
        Refinement { fixes: &self.edges, motion: self.motion, noise, inflation: self.inflation(), bin_s }
    }

    /// The flexible fit from a constant, and from the coarse path if that changes.
    fn flexible(&self, noise: &Noise, bin_s: f64, moves: bool, constant_s: f64) -> Option<Flexible> {
        let path = |t: f64| self.map.path_at(t);
        let from_constant = bins::fit(&self.fixes, self.motion, noise, &|_| constant_s, bin_s);
        let from_path = if moves { bins::fit(&self.fixes, self.motion, noise, &path, bin_s) } else { None };
        match (from_constant, from_path) {
            (Some(c), Some(p)) => Some(if p.beats(&c) { p } else { c }),
            (c, p) => c.or(p),
        }
    }

    /// The description that explains the fixes best. A step within a bin costs more on bins than on the fixes.
    fn refined(&self, descriptions: Vec<Description>, noise: Noise, bin_s: f64) -> Option<Refined> {
        let refinement = self.refinement(noise, bin_s);
        let refined = descriptions.into_iter().filter(|d| !d.terms.is_empty()).filter_map(|d| refinement.refine(d));
        let costed = refined.map(|refined| (refinement.cost(&refined.description), refined));
        costed.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, refined)| refined)
    }

    /// Refined only if bins or description leave clearly less than everything: the fixes cannot rescue a poor fit.
    fn refined_if_promising(&self, flexible: &Flexible, noise: Noise, bin_s: f64) -> Option<Refined> {
        let refinement = self.refinement(noise, bin_s);
        let on_bins = |t: f64| interpolate(&flexible.middle_s, &flexible.delay_s, t);
        let descriptions = describe(flexible, self.inflation());
        let hopeless = |curve: &dyn Fn(f64) -> f64| {
            self.unexplained(&refinement, curve).is_some_and(|l| l.share > MOST_LEFT_ON_BINS)
        };
        if hopeless(&on_bins) && descriptions.iter().all(|d| hopeless(&|t| d.at(t))) {
            return None;
        }
        self.refined(descriptions, noise, bin_s)
    }

    /// Whether a description with a large span leaves few of the squares that a constant leaves, also with any one
    /// window left out. This detects changes that occur in all windows, such as a sawtooth, which the comparison of
    /// windows treats as scatter.
    fn explains(&self, description: &Description, noise: Noise, bin_s: f64) -> bool {
        let spans = Shape::new(description, self.span_s).span_s() >= EXPLAINED_SPAN_S;
        let left = || self.unexplained(&self.refinement(noise, bin_s), &|t| description.at(t));
        spans && left().is_some_and(|l| l.share <= UNEXPLAINED && l.without_one <= UNEXPLAINED_WITHOUT_ONE)
    }

    /// Squares of windows that a curve leaves; `None` if too few windows move.
    fn unexplained(&self, refinement: &Refinement, curve: &dyn Fn(f64) -> f64) -> Option<Unexplained> {
        let windows = &self.test?.windows;
        let moving: Vec<&Window> = windows.iter().filter(|w| w.speed_mps > self.motion.slow_mps).collect();
        // Squares per number: one window with a wild fix counts no more than the others together with the noise.
        let squares = |at: &dyn Fn(f64) -> f64| -> Vec<f64> {
            let of = |w: &&Window| {
                let (squares, fixes) = refinement.squares_between(w.from_s, w.to_s, at);
                squares / (2 * fixes).max(1) as f64
            };
            moving.iter().map(of).collect()
        };
        let total = |s: &[f64]| s.iter().sum::<f64>();
        let mut described = squares(curve);
        let mut constant = [self.level(), self.map.constant_s].map(|c| squares(&|_| c));
        for all in &mut constant {
            let cut = MOST_SQUARES * signal::median_in_place(&mut all.clone()).unwrap_or(0.0);
            all.iter_mut().for_each(|s| *s = s.min(cut));
        }
        let constant = if total(&constant[0]) < total(&constant[1]) { &constant[0] } else { &constant[1] };
        let cut = MOST_SQUARES * signal::median_in_place(&mut constant.clone()).unwrap_or(0.0);
        described.iter_mut().for_each(|s| *s = s.min(cut));
        let (left, all) = (total(&described), total(constant));
        let without = |(d, c): (&f64, &f64)| (left - d) / (all - c).max(1e-300);
        let without_one = described.iter().zip(constant).map(without).fold(0.0, f64::max);
        (moving.len() >= LEAST_MOVING && all > 0.0).then_some(Unexplained { share: left / all, without_one })
    }
}

/// Share of the squares about the better constant that a curve leaves; the largest with one window left out.
struct Unexplained {
    share: f64,
    without_one: f64,
}

/// Noise of windows at the delays of `starts`; the jitter is taken from `noise`.
fn noise_about(
    fixes: &Fixes,
    motion: &Motion,
    starts: &Starts,
    interval_s: f64,
    noise: Noise,
    scratch: &mut Scratch,
) -> Noise {
    let sample = Sample::new(fixes, motion, starts, interval_s, scratch);
    let shape = sample.shape(fixes, motion, noise.shape.jitter, scratch);
    let windows = fit_all(fixes, motion, &shape, starts, usual_length(interval_s), scratch);
    delays(&windows).map_or(noise, |d| Noise { shape, white_m: d.white_m.max(1e-6) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dense::Random;
    use crate::describe::Term;
    use crate::example::{FIRST_S, WINDOW_S, found};
    use record::DelayTermKind;

    /// Fixes at 5 Hz, late by `late`, with noise of 0.3 m, within the windows of [`example::found`].
    fn fixes(late: &dyn Fn(f64) -> f64, motion: &Motion) -> Fixes {
        let mut random = Random::new(1);
        let t: Vec<f64> = (0..1200).map(|k| FIRST_S + 0.2 * f64::from(k)).collect();
        let y = t.iter().map(|t| motion.at(t - late(*t), &mut 0).place.map(|p| p + 0.3 * random.normal()));
        Fixes { y: y.collect(), starts: vec![0, 1200], t }
    }

    const NOISE: Noise = Noise { shape: crate::noise_shape::GUESS, white_m: 0.3 };

    fn with_change<T>(late: &dyn Fn(f64) -> f64, ask: impl FnOnce(&Change) -> T) -> T {
        let found = found(&[0.3; 12], 1e-3);
        let (map, test) = (found.map.unwrap(), found.test.unwrap());
        let of = fixes(late, &found.motion);
        ask(&Change {
            motion: &found.motion,
            map: &map,
            fixes: of.clone(),
            edges: of,
            test: Some(&test),
            interval_s: 0.2,
            span_s: found.span_s,
        })
    }

    fn sawtooth(t: f64) -> f64 {
        0.1 + 0.4 * ((t - FIRST_S) / 17.0).fract()
    }

    /// Squares of each window per number of values, about the better of the level (0.3 s) and the map's constant.
    #[test]
    fn a_curve_leaves_its_share_of_the_window_squares() {
        with_change(&sawtooth, |change| {
            let refinement = change.refinement(NOISE, 2.0);
            let squares = |at: &dyn Fn(f64) -> f64| -> Vec<f64> {
                (0..12)
                    .map(|k| {
                        let from = FIRST_S + WINDOW_S * f64::from(k);
                        let (squares, count) = refinement.squares_between(from, from + WINDOW_S, at);
                        squares / (2 * count) as f64
                    })
                    .collect()
            };
            let sum = |x: &[f64]| x.iter().sum::<f64>();
            let constants = [0.3, 0.2].map(|c| squares(&|_| c));
            let constant = constants.iter().min_by(|a, b| sum(a).total_cmp(&sum(b))).unwrap();
            let curves: [&dyn Fn(f64) -> f64; 3] = [&sawtooth, &|t| 0.5 * sawtooth(t) + 0.15, &|_| 0.3];
            for curve in curves {
                let described = squares(curve);
                let left = change.unexplained(&refinement, curve).unwrap();
                let (d, c) = (sum(&described), sum(constant));
                assert!((left.share - d / c).abs() < 1e-9, "{} {}", left.share, d / c);
                let without = |k: usize| (d - described[k]) / (c - constant[k]);
                let worst = (0..12).map(without).fold(0.0, f64::max);
                assert!((left.without_one - worst).abs() < 1e-9, "{} {worst}", left.without_one);
            }
        });
    }

    #[test]
    fn a_sawtooth_is_explained_by_its_curve_but_not_by_a_constant() {
        let mut terms = vec![Term { kind: DelayTermKind::Bend, at_s: FIRST_S, size: 0.4 / 17.0 }];
        terms.extend((1..15).map(|k| Term {
            kind: DelayTermKind::Step,
            at_s: FIRST_S + 17.0 * f64::from(k),
            size: -0.4,
        }));
        let description = Description { level_s: 0.1, terms };
        assert!((description.at(FIRST_S + 40.0) - sawtooth(FIRST_S + 40.0)).abs() < 1e-9);
        let small = Description { level_s: 0.3, terms: vec![] };
        with_change(&sawtooth, |change| {
            assert!(change.explains(&description, NOISE, 2.0) && !change.explains(&small, NOISE, 2.0));
        });
        with_change(&|_| 0.3, |change| assert!(!change.explains(&description, NOISE, 2.0)));
    }

    /// One window that contains a reset of 500 m counts at most ten medians.
    #[test]
    fn one_wild_window_does_not_decide() {
        with_change(&sawtooth, |change| {
            let refinement = change.refinement(NOISE, 2.0);
            let calm = change.unexplained(&refinement, &sawtooth).unwrap();
            let mut wild = Change { fixes: change.fixes.clone(), edges: change.edges.clone(), ..*change };
            for k in 430..460 {
                wild.edges.y[k][0] += 500.0;
            }
            let refinement = wild.refinement(NOISE, 2.0);
            let left = wild.unexplained(&refinement, &sawtooth).unwrap();
            // Of twelve windows, ten medians are at most 10 of 21 of the squares about the constant.
            assert!(left.share < calm.share + 10.0 / 20.0, "{} {}", left.share, calm.share);
            assert!(left.share > calm.share && left.without_one < left.share + 1e-9 + 10.0 / 11.0);
        });
    }
}
