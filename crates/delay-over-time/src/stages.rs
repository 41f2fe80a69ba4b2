//! One flight, step by step.

use crate::bins::{Flexible, Noise};
use crate::change::Change;
use crate::coarse::{CoarseMap, Track, coarse};
use crate::constancy::{Comparison, Decision, compare, decide};
use crate::delays::{Delays, delays};
use crate::fixes::{Breaks, Fixes};
use crate::input::PositionAgainstVelocity;
use crate::jitter::{Jitter, jitter};
use crate::motion::{Motion, State, usual_interval};
use crate::noise_shape::{GUESS, Sample};
use crate::odd::{Odd, odd_fixes};
use crate::refine::Refined;
use crate::settings::OverTimeSettings;
use crate::stamps::{Queued, queued};
use crate::whitening::NoiseShape;
use crate::windows::{Scratch, Starts, Window, fit_window, tile};

/// Window lengths that are tried, s; least number of fixes per window, and maximum number of windows.
const LENGTHS_S: [f64; 4] = [10.0, 15.0, 20.0, 25.0];
const WINDOW_FIXES: f64 = 25.0;
const MOST_WINDOWS: f64 = 24.0;
/// Jump of the coarse path near which fixes are excluded from windows and bins, s, and the excluded half-width, s.
const JUMP_S: f64 = 0.3;
const JUMP_HALF_S: f64 = 3.0;
/// Guard at the ends of the velocity's record, s.
const GUARD_S: f64 = 0.3;
/// Delays are searched over this share of the record, but at least over this range, s: short records keep their fixes.
const SEARCH_SHARE: [f64; 2] = [-0.15, 0.35];
const LEAST_SEARCH_S: [f64; 2] = [-1.0, 2.0];
/// Unexplained share above which position and velocity do not belong together.
pub(crate) const FOREIGN_SHARE: f64 = 0.5;

/// All results before they are put into words.
pub(crate) struct Found {
    pub(crate) motion: Motion,
    pub(crate) queued: Queued,
    pub(crate) odd: Odd,
    pub(crate) search_s: [f64; 2],
    pub(crate) map: Option<CoarseMap>,
    pub(crate) jitter: Jitter,
    pub(crate) test: Option<Test>,
    pub(crate) flexible: Option<Flexible>,
    pub(crate) refined: Option<Refined>,
    /// Whether the description alone shows that the delay varies.
    pub(crate) explained: bool,
    pub(crate) noise: Noise,
    pub(crate) interval_s: f64,
    pub(crate) fixes_used: usize,
    /// First and last fix, s.
    pub(crate) span_s: [f64; 2],
}

/// Windows of one length, and their comparison.
pub(crate) struct Test {
    pub(crate) windows: Vec<Window>,
    pub(crate) length_s: f64,
    pub(crate) all: Delays,
    pub(crate) known: Delays,
    /// `None` if too few windows have a usable delay.
    pub(crate) comparison: Option<Comparison>,
    pub(crate) decision: Option<Decision>,
}

impl Test {
    pub(crate) fn varies(&self) -> bool {
        self.decision.as_ref().is_some_and(|d| d.varies)
    }
}

pub(crate) fn run(record: &PositionAgainstVelocity, settings: &OverTimeSettings) -> Found {
    let motion = Motion::new(record.velocity_t, record.velocity_north, record.velocity_east);
    let interval_s = usual_interval(record.t);
    let queued = queued(record.t, interval_s);
    let y: Vec<[f64; 2]> = record.north.iter().zip(record.east).map(|(n, e)| [*n, *e]).collect();
    let resets: Vec<f64> = sorted(record.breaks);
    let (map, search_s) = map_of(record, &y, &resets, &queued, &motion, settings);
    let (first, last) = crate::input::span(record.t);
    let mut found = Found {
        motion,
        queued,
        odd: Odd::default(),
        search_s,
        map,
        jitter: Jitter::default(),
        test: None,
        flexible: None,
        refined: None,
        explained: false,
        noise: Noise { shape: GUESS, white_m: 1.0 },
        interval_s,
        fixes_used: 0,
        span_s: [first, last],
    };
    if let Some(map) = found.map.take() {
        fit(record, &y, &resets, settings, &map, &mut found);
        found.map = Some(map);
    }
    found
}

fn sorted(breaks: &[f64]) -> Vec<f64> {
    let mut breaks = breaks.to_vec();
    breaks.sort_by(f64::total_cmp);
    breaks
}

/// The coarse map, over the wide range if the best is not within the first.
fn map_of(
    record: &PositionAgainstVelocity,
    y: &[[f64; 2]],
    resets: &[f64],
    queued: &Queued,
    motion: &Motion,
    settings: &OverTimeSettings,
) -> (Option<CoarseMap>, [f64; 2]) {
    let rows = || (0..record.t.len()).filter(|k| !queued.rows[*k]);
    let t: Vec<f64> = rows().map(|k| record.t[k]).collect();
    let y: Vec<[f64; 2]> = rows().map(|k| y[k]).collect();
    let mut breaks = resets.to_vec();
    breaks.extend(motion.gaps().iter().map(|g| g.1));
    breaks.sort_by(f64::total_cmp);
    let track = Track { t: &t, y: &y, breaks: &breaks };
    let ((first, last), (begin, end)) = (crate::input::span(&t), motion.span());
    let shared_s = last.min(end) - first.max(begin);
    let clip = |[lo, hi]: [f64; 2]| {
        // A velocity logged before and after the position allows a wide search.
        let (before, after) = ((first - begin).max(0.0), (end - last).max(0.0));
        let least = (SEARCH_SHARE[0] * shared_s).min(LEAST_SEARCH_S[0]) - after;
        let most = (SEARCH_SHARE[1] * shared_s).max(LEAST_SEARCH_S[1]) + before;
        [lo.max(least), hi.min(most)]
    };
    let narrow = clip(settings.search_s);
    let map = coarse(&track, motion, narrow);
    let fits = |m: &CoarseMap| !m.edge && m.unexplained_share <= FOREIGN_SHARE;
    let wide = clip(settings.wide_search_s);
    if map.as_ref().is_some_and(fits) || wide[1] - wide[0] <= narrow[1] - narrow[0] + 0.2 {
        return (map, narrow);
    }
    let wider = coarse(&track, motion, wide);
    match (map, wider) {
        (Some(n), Some(w)) if !n.edge && w.unexplained_share > 0.8 * n.unexplained_share => (Some(n), narrow),
        (n, w) => (w.or(n), wide),
    }
}

/// Selections of fixes for the steps.
struct Selected {
    /// Without bursts and outliers.
    edges: Fixes,
    /// Also without those near jumps of the path.
    calm: Fixes,
    odd: Odd,
    jitter: Jitter,
    /// Usual interval after thinning, s.
    interval_s: f64,
}

fn select(
    record: &PositionAgainstVelocity,
    y: &[[f64; 2]],
    resets: &[f64],
    map: &CoarseMap,
    found: &Found,
    most_fixes: usize,
) -> Selected {
    let motion = &found.motion;
    let path = |t: f64| map.path_at(t);
    let breaks = Breaks { resets, motion, delay: &path };
    let usable: Vec<bool> = record
        .t
        .iter()
        .zip(&found.queued.rows)
        .map(|(t, queued)| {
            let q = t - path(*t);
            !queued && motion.knows(q - GUARD_S) && motion.knows(q + GUARD_S)
        })
        .collect();
    let usable = |k: usize| usable[k];
    let all = Fixes::select(record.t, y, &breaks, usable, 1);
    let (e, state) = residuals(&all, motion, &path);
    let odd = odd_fixes(&all.t, &e, &state);
    let odd_times: Vec<f64> = odd.rows.iter().map(|r| all.t[*r]).collect();
    let is_odd = |t: f64| odd_times.binary_search_by(|o| o.total_cmp(&t)).is_ok();
    let jumps = jumps(map);
    let near_jump = |t: f64| jumps.iter().any(|j| (t - j).abs() < JUMP_HALF_S);
    let keep = |k: usize| usable(k) && !is_odd(record.t[k]);
    let calm = |k: usize| keep(k) && !near_jump(record.t[k]);
    let every = all.len().div_ceil(most_fixes.max(100)).max(1);
    let unthinned = Fixes::select(record.t, y, &breaks, calm, 1);
    Selected {
        edges: Fixes::select(record.t, y, &breaks, keep, every),
        jitter: jitter_of(&unthinned, motion, &path),
        calm: if every == 1 { unthinned } else { Fixes::select(record.t, y, &breaks, calm, every) },
        odd,
        interval_s: found.interval_s * every as f64,
    }
}

/// The fits between the coarse map and the wording.
fn fit(
    record: &PositionAgainstVelocity,
    y: &[[f64; 2]],
    resets: &[f64],
    settings: &OverTimeSettings,
    map: &CoarseMap,
    found: &mut Found,
) {
    let path = |t: f64| map.path_at(t);
    let selected = select(record, y, resets, map, found, settings.most_fixes);
    let Selected { edges, calm: fixes, interval_s, .. } = selected;
    let motion = &found.motion;
    found.fixes_used = edges.len();
    let mut scratch = Scratch::default();
    let starts = Starts::new(&fixes, motion, map.constant_s, &path);
    let shape = shape_of(&fixes, motion, &starts, interval_s, selected.jitter.found_s, &mut scratch);
    let test = best_test(&fixes, motion, &shape, &starts, interval_s, settings, &mut scratch);
    let noise = Noise { shape, white_m: test.as_ref().map_or(1.0, |t| t.all.white_m).max(1e-6) };
    let effects = test.as_ref().map_or([0.0; 2], |t| t.all.sure_effects());
    let [fixes, edges] = [fixes, edges].map(|of| match effects {
        [0.0, 0.0] => of,
        effects => of.without_effects(motion, &path, effects),
    });
    let change = Change { motion, map, fixes, edges, test: test.as_ref(), interval_s, span_s: found.span_s };
    let described = change.describe(noise, &mut scratch);
    (found.odd, found.jitter, found.test) = (selected.odd, selected.jitter, test);
    (found.noise, found.explained) = (described.noise, described.explained);
    (found.flexible, found.refined) = (described.flexible, described.refined);
}

fn jumps(map: &CoarseMap) -> Vec<f64> {
    let pairs = map.middle_s.windows(2).zip(map.path_s.windows(2));
    pairs.filter(|(_, p)| (p[1] - p[0]).abs() > JUMP_S).map(|(m, _)| 0.5 * (m[0] + m[1])).collect()
}

fn residuals(fixes: &Fixes, motion: &Motion, delay: &dyn Fn(f64) -> f64) -> (Vec<[f64; 2]>, Vec<State>) {
    let mut hint = 0;
    let of = |(t, y): (&f64, &[f64; 2])| {
        let s = motion.at(t - delay(*t), &mut hint);
        ([y[0] - s.place[0], y[1] - s.place[1]], s)
    };
    fixes.t.iter().zip(&fixes.y).map(of).unzip()
}

fn jitter_of(fixes: &Fixes, motion: &Motion, delay: &dyn Fn(f64) -> f64) -> Jitter {
    let (e, state) = residuals(fixes, motion, delay);
    let late_s: Vec<f64> = fixes.t.iter().map(|t| delay(*t)).collect();
    jitter(&fixes.t, &e, &state, &late_s)
}

/// Shape of the noise, with the estimated jitter.
fn shape_of(
    fixes: &Fixes,
    motion: &Motion,
    starts: &Starts,
    interval_s: f64,
    jitter_s: Option<f64>,
    scratch: &mut Scratch,
) -> NoiseShape {
    let sample = Sample::new(fixes, motion, starts, interval_s, scratch);
    let shape = sample.shape(fixes, motion, 0.0, scratch);
    match jitter_s {
        Some(jitter_s) => shape_with_jitter(fixes, motion, &sample, starts, interval_s, (shape, jitter_s), scratch),
        None => shape,
    }
}

/// Noise whose along-track part is the jitter; the white part is the remainder.
fn shape_with_jitter(
    fixes: &Fixes,
    motion: &Motion,
    sample: &Sample,
    starts: &Starts,
    interval_s: f64,
    (shape, jitter_s): (NoiseShape, f64),
    scratch: &mut Scratch,
) -> NoiseShape {
    let windows = fit_all(fixes, motion, &shape, starts, usual_length(interval_s), scratch);
    let Some(delays) = delays(&windows) else { return shape };
    let speed = windows.iter().map(|w| w.speed_mps).sum::<f64>() / windows.len() as f64;
    let along = 0.5 * (jitter_s * speed).powi(2);
    let white = delays.white_m * delays.white_m;
    let jitter = jitter_s / (white - along).max(0.1 * white).max(1e-12).sqrt();
    sample.shape(fixes, motion, jitter, scratch)
}

/// Length of a window if nothing was compared, s.
pub(crate) fn usual_length(interval_s: f64) -> f64 {
    LENGTHS_S[2].max(WINDOW_FIXES * interval_s)
}

pub(crate) fn fit_all(
    fixes: &Fixes,
    motion: &Motion,
    shape: &NoiseShape,
    starts: &Starts,
    length_s: f64,
    scratch: &mut Scratch,
) -> Vec<Window> {
    let rows = tile(fixes, starts, length_s);
    rows.into_iter().filter_map(|r| fit_window(fixes, r, motion, shape, starts, scratch)).collect()
}

/// Windows of the length with the smallest detectable change; the shortest length if none can be tested.
fn best_test(
    fixes: &Fixes,
    motion: &Motion,
    shape: &NoiseShape,
    starts: &Starts,
    interval_s: f64,
    settings: &OverTimeSettings,
    scratch: &mut Scratch,
) -> Option<Test> {
    let (first, last) = crate::input::span(&fixes.t);
    let least = (WINDOW_FIXES * interval_s).max((last - first) / MOST_WINDOWS);
    let mut lengths: Vec<f64> = LENGTHS_S.iter().map(|l| l.max(least)).collect();
    lengths.dedup();
    let test = |length_s: f64| {
        let windows = fit_all(fixes, motion, shape, starts, length_s, scratch);
        let all = delays(&windows)?;
        let known = all.known(settings.window_limit_s);
        let enough = known.len() >= settings.least_windows.max(4);
        let comparison = enough.then(|| compare(&known, settings));
        let length_s = windows.iter().map(|w| w.to_s - w.from_s).sum::<f64>() / windows.len() as f64;
        Some(Test { windows, length_s, all, known, comparison, decision: None })
    };
    let detectable = |t: &Test| t.comparison.as_ref().map_or(f64::MAX, |c| c.at_best_s);
    let tests: Vec<Test> = lengths.into_iter().filter_map(test).collect();
    let mut best = tests.into_iter().reduce(|a, b| if detectable(&b) < detectable(&a) { b } else { a })?;
    best.decision = best.comparison.as_ref().map(|c| decide(&best.known, c, settings));
    Some(best)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dense::turning;

    /// A flight of `seconds` with velocity logged from `before` s earlier to `after` s later: the searched delays, s.
    fn searched(seconds: f64, before: f64, after: f64) -> [f64; 2] {
        let motion = turning(seconds + 40.0);
        let velocity_t: Vec<f64> =
            (0..=((seconds + before + after) / 0.05) as usize).map(|k| 10.0 - before + 0.05 * k as f64).collect();
        let velocity: Vec<[f64; 2]> = velocity_t.iter().map(|t| motion.at(*t, &mut 0).velocity).collect();
        let t: Vec<f64> = (0..=(seconds / 0.2) as usize).map(|k| 10.0 + 0.2 * k as f64).collect();
        let place: Vec<[f64; 2]> = t.iter().map(|t| motion.at(*t, &mut 0).place).collect();
        let column = |x: &[[f64; 2]], a: usize| x.iter().map(|x| x[a]).collect::<Vec<f64>>();
        let record = PositionAgainstVelocity {
            t: &t,
            north: &column(&place, 0),
            east: &column(&place, 1),
            velocity_t: &velocity_t,
            velocity_north: &column(&velocity, 0),
            velocity_east: &column(&velocity, 1),
            breaks: &[],
        };
        run(&record, &OverTimeSettings::default()).search_s
    }

    /// From −15 % to 35 % of the shared record, at least −1 s to 2 s, further if the velocity was logged longer.
    #[test]
    fn a_short_record_is_searched_for_short_delays() {
        for (seconds, before, after, expected) in [
            (120.0, 0.0, 0.0, [-2.5, 13.0]),
            (20.0, 0.0, 0.0, [-2.5, 7.0]),
            (12.0, 0.0, 0.0, [-1.8, 4.2]),
            (12.0, 3.0, 0.4, [-2.2, 7.2]),
            (12.0, 20.0, 20.0, [-2.5, 13.0]),
        ] {
            let found = searched(seconds, before, after);
            assert!((0..2).all(|i| (found[i] - expected[i]).abs() < 1e-6), "{seconds} s: {found:?} {expected:?}");
        }
    }

    #[test]
    fn a_path_jumps_if_it_changes_by_more_than_300_ms() {
        let f = crate::example::found(&[0.2; 12], 1e-3);
        let map = CoarseMap {
            middle_s: vec![1.0, 3.0, 5.0, 7.0, 9.0],
            path_s: vec![0.2, 0.4, 0.8, 0.51, -0.2],
            ..f.map.unwrap()
        };
        assert_eq!(jumps(&map), [4.0, 8.0]);
        assert_eq!((usual_length(0.2), usual_length(2.0)), (20.0, 50.0));
    }
}
