//! Scores that need no reference (design note 5.9): lead, steps, opposite passes, straight legs.

use super::Innovations;
use super::jackknife::{Blocks, jackknife, mean, rms};
use super::updates::{Updates, dot, length, minus, to_the_right};
use crate::compensator::CompensatorKind;
use crate::estimate::{EXACT_ASYNC, Positions};
use delay_from_flight::AXES;
use record::{Estimate, Finding, Hysteresis, OppositePasses, StraightLegs, StraightScore};
use signal::{orthonormal, residuals_of};
use std::collections::BTreeMap;

/// Along-track distance ahead of raw over the displacement in a second: `Td · Σ d·w / Σ w·w` with `d` = output − raw
/// and `w` the displacement from velocity during the delay, so turns do not shorten it.
pub(crate) fn lead(updates: &Updates, raw: &Positions, track: &Positions) -> Finding<Estimate> {
    if track.is_raw() {
        return Finding::CannotTell("the lead is that over raw".to_owned());
    }
    let given = track.delay.seconds();
    let rows: Vec<[f64; 2]> = (0..updates.rows.len())
        .filter(|&i| updates.has_own_output(track, i))
        .map(|i| {
            let travelled = updates.travelled(i, updates.extrapolated_s(track, i));
            [dot(minus(updates.at(track, i), updates.at(raw, i)), travelled), dot(travelled, travelled)]
        })
        .collect();
    found(jackknife(&rows, |[dw, ww]| given * dw / ww), "no valid fix in motion")
}

/// Correlation of the steps at the fixes with the displacement between them.
pub(crate) fn step_correlation(innovations: &Innovations, track: &Positions) -> Finding<Estimate> {
    if let Some(CompensatorKind::Kalman | CompensatorKind::OfflineShift | CompensatorKind::RtsSmoother) = track.further
    {
        return Finding::CannotTell("it takes a fix over smoothly: there is no step".to_owned());
    }
    let carries_on = track.name == EXACT_ASYNC;
    let products = |i: usize| {
        let flown = AXES.map(|k| innovations.flown[k][i]);
        let left = AXES.map(|k| innovations.exact[k][i]);
        let step = if carries_on { left } else { AXES.map(|k| left[k] + flown[k]) };
        [dot(step, flown), dot(step, step), dot(flown, flown)]
    };
    let fixes = innovations.fix.len();
    let blocks = Blocks::of(fixes, (0..fixes).map(products));
    let why = "no fix with continuous velocity since the fix before";
    found(blocks.estimate(|[sf, ss, ff]| sf / (ss * ff).sqrt()), why)
}

// Opposite passes

/// Passes farther apart are not over the same place, m.
const WITHIN_M: f64 = 15.0;
/// Directions that differ by less than 180° − 20° are not opposite.
const OPPOSITE: f64 = -0.939_692_620_785_908_4;
/// Slower motion is not a pass, m/s.
const LEAST_SPEED_MPS: f64 = 2.0;

/// Two fixes over the same place in opposite directions, according to velocity.
struct Meeting {
    there: usize,
    back: usize,
    /// Velocity on the way out less velocity on the way back.
    closing: [f64; 2],
    /// Position on the way out less position on the way back, m.
    apart: [f64; 2],
}

/// Pairs of passes, each with its meeting fixes.
pub(crate) struct Passes(Vec<Vec<Meeting>>);

impl Passes {
    /// Finds where velocity brings the aircraft back in the opposite direction. Velocity's drift against the fixes is
    /// removed as a straight line.
    pub(crate) fn of(updates: &Updates, raw: &Positions) -> Passes {
        let place = without_drift(updates, raw);
        let cell = |p: [f64; 2]| p.map(|x| (x / WITHIN_M).floor() as i64);
        let mut cells: BTreeMap<[i64; 2], Vec<usize>> = BTreeMap::new();
        let mut pairs: Vec<Vec<Meeting>> = vec![];
        for back in 0..place.len() {
            if length(updates.velocity[back]) < LEAST_SPEED_MPS {
                continue;
            }
            let [n, e] = cell(place[back]);
            let near = (-1..=1).flat_map(|i| (-1..=1).map(move |j| [n + i, e + j]));
            let meets = |&&there: &&usize| {
                let (v, w) = (updates.velocity[there], updates.velocity[back]);
                updates.segment(there) == updates.segment(back)
                    && dot(v, w) < OPPOSITE * length(v) * length(w)
                    && length(minus(place[there], place[back])) <= WITHIN_M
            };
            let apart = |there: &usize| length(minus(place[*there], place[back]));
            let others = near.filter_map(|c| cells.get(&c)).flatten().filter(meets);
            if let Some(&there) = others.min_by(|a, b| apart(a).total_cmp(&apart(b))) {
                let closing = minus(updates.velocity[there], updates.velocity[back]);
                let meeting = Meeting { there, back, closing, apart: minus(place[there], place[back]) };
                match pairs.last_mut() {
                    Some(pair) if continues_pair(pair, &meeting) => pair.push(meeting),
                    _ => pairs.push(vec![meeting]),
                }
            }
            cells.entry([n, e]).or_default().push(back);
        }
        Passes(pairs)
    }

    pub(crate) fn finding(&self) -> Finding<OppositePasses> {
        let meetings: Vec<&Meeting> = self.0.iter().flatten().collect();
        if meetings.is_empty() {
            let text = format!(
                "no two passes within {WITHIN_M} m of each other in opposite directions: fly a line there and back"
            );
            return Finding::CannotTell(text);
        }
        Finding::Found(OppositePasses {
            pairs: self.0.len() as u64,
            fixes: 2 * meetings.len() as u64,
            within_m: WITHIN_M,
            closing_speed_mps: self.mean(|m| length(m.closing)),
        })
    }

    /// Mean over the pairs of the mean over each.
    fn mean(&self, of: impl Fn(&Meeting) -> f64) -> f64 {
        let of_pair = |pair: &Vec<Meeting>| pair.iter().map(&of).sum::<f64>() / pair.len() as f64;
        self.0.iter().map(of_pair).sum::<f64>() / self.0.len() as f64
    }

    /// Mean with the spread of the pairs as uncertainty, for three or more.
    fn estimate(&self, of: impl Fn(&Meeting) -> f64) -> Estimate {
        let n = self.0.len() as f64;
        let value = self.mean(&of);
        let of_pair = |pair: &Vec<Meeting>| pair.iter().map(&of).sum::<f64>() / pair.len() as f64;
        let spread = self.0.iter().map(|p| (of_pair(p) - value).powi(2)).sum::<f64>();
        let known = self.0.len() >= 3;
        Estimate { value, standard_uncertainty: known.then(|| (spread / (n * (n - 1.0))).sqrt()) }
    }

    /// Distance between the passes of a track, in excess of that from velocity.
    pub(crate) fn hysteresis(&self, updates: &Updates, track: &Positions, expected_s: f64) -> Finding<Hysteresis> {
        if let Finding::CannotTell(why) = self.finding() {
            return Finding::CannotTell(why);
        }
        if self
            .0
            .iter()
            .flatten()
            .any(|m| !updates.has_own_output(track, m.there) || !updates.has_own_output(track, m.back))
        {
            return Finding::CannotTell("it has no output on some of the passes".to_owned());
        }
        let offset = |m: &Meeting| minus(minus(updates.at(track, m.there), updates.at(track, m.back)), m.apart);
        Finding::Found(Hysteresis {
            along_m: self.estimate(|m| -dot(offset(m), m.closing) / length(m.closing)),
            across_m: self.estimate(|m| to_the_right(m.closing, offset(m)) / length(m.closing)),
            expected_along_m: expected_s * self.mean(|m| length(m.closing)),
        })
    }
}

/// Whether a meeting continues the same two passes.
fn continues_pair(pair: &[Meeting], next: &Meeting) -> bool {
    pair.last().is_some_and(|last| next.back - last.back <= 3 && last.there.abs_diff(next.there) <= 6)
}

/// Integrated positions less the straight line by which the fixes drift from them, segment by segment.
fn without_drift(updates: &Updates, raw: &Positions) -> Vec<[f64; 2]> {
    let mut out = updates.place.clone();
    let mut first = 0;
    while first < out.len() {
        let of_same = |i: &usize| updates.segment(*i) == updates.segment(first);
        let last = (first..out.len()).take_while(of_same).last().unwrap_or(first);
        let t: Vec<f64> = (first..=last).map(|i| updates.t(i) - updates.t(first)).collect();
        for k in AXES {
            let y: Vec<f64> = (first..=last).map(|i| updates.at(raw, i)[k] - updates.place[i][k]).collect();
            let slope = slope(&t, &y);
            (first..=last).zip(&t).for_each(|(i, t)| out[i][k] += slope * t);
        }
        first = last + 1;
    }
    out
}

fn slope(t: &[f64], y: &[f64]) -> f64 {
    let n = t.len() as f64;
    let (tm, ym) = (t.iter().sum::<f64>() / n, y.iter().sum::<f64>() / n);
    let tt: f64 = t.iter().map(|t| (t - tm).powi(2)).sum();
    let ty: f64 = t.iter().zip(y).map(|(t, y)| (t - tm) * (y - ym)).sum();
    if tt > 0.0 { ty / tt } else { 0.0 }
}

// Straight legs

/// A straight leg has less lateral acceleration than this, m/s².
const LATERAL_MPS2: f64 = 0.5;
/// Half of the interval for an acceleration, s.
const HALF_S: f64 = 0.5;
/// Least number of fixes of a leg.
const LEAST_FIXES: usize = 6;

/// Runs of fixes on straight legs, each after at least one delay of straight flight.
pub(crate) struct Legs {
    runs: Vec<std::ops::Range<usize>>,
    duration_s: f64,
}

impl Legs {
    /// From the velocity alone: fixes around which velocity does not turn.
    pub(crate) fn of(updates: &Updates, delay_s: f64) -> Legs {
        let straight: Vec<bool> = (0..updates.rows.len()).map(|i| is_straight(updates, i)).collect();
        let mut runs: Vec<std::ops::Range<usize>> = vec![];
        let mut duration_s = 0.0;
        let mut i = 0;
        while i < straight.len() {
            let same = |j: &usize| straight[*j] && updates.segment(*j) == updates.segment(i);
            let end = i + (i..straight.len()).take_while(same).count();
            if end > i {
                let inside = (i..end).find(|&j| updates.t(j) - updates.t(i) >= delay_s).unwrap_or(end);
                if end - inside >= LEAST_FIXES {
                    duration_s += updates.t(end - 1) - updates.t(inside);
                    runs.push(inside..end);
                }
            }
            i = end.max(i + 1);
        }
        Legs { runs, duration_s }
    }

    /// Squared scatter across the straight legs of `track` and of raw, m², of the legs where `track` has all outputs.
    fn squared_scatter(&self, updates: &Updates, raw: &Positions, track: &Positions) -> Vec<[f64; 2]> {
        let legs = self.runs.iter().filter(|run| (run.start..run.end).all(|i| updates.has_own_output(track, i)));
        let of_leg = |run: &std::ops::Range<usize>| {
            let [of_track, of_raw] = [track, raw].map(|p| scatter_across(updates, p, run));
            of_track.into_iter().zip(of_raw).map(|(a, b)| [a * a, b * b])
        };
        legs.flat_map(of_leg).collect()
    }

    pub(crate) fn finding(&self) -> Finding<StraightLegs> {
        if self.runs.is_empty() {
            let text = format!(
                "no straight leg with {LEAST_FIXES} fixes after one delay of straight flight (acceleration across below \
                 {LATERAL_MPS2} m/s²)"
            );
            return Finding::CannotTell(text);
        }
        Finding::Found(StraightLegs {
            legs: self.runs.len() as u64,
            duration_s: self.duration_s,
            lateral_limit_mps2: LATERAL_MPS2,
        })
    }

    pub(crate) fn score(&self, updates: &Updates, raw: &Positions, track: &Positions) -> Finding<StraightScore> {
        if track.is_raw() {
            return Finding::CannotTell("it is raw itself".to_owned());
        }
        if let Finding::CannotTell(why) = self.finding() {
            return Finding::CannotTell(why);
        }
        let fixes = || self.runs.iter().cloned().flatten().filter(|&i| updates.has_own_output(track, i));
        let moved = |i: usize| minus(updates.at(track, i), updates.at(raw, i));
        let travelled = fixes().map(|i| (moved(i), updates.travelled(i, updates.extrapolated_s(track, i))));
        let (excess, across): (Vec<f64>, Vec<f64>) =
            travelled.map(|(d, w)| (dot(d, w) / length(w) - length(w), to_the_right(w, d) / length(w))).unzip();
        let noise = self.squared_scatter(updates, raw, track);
        match (mean(&excess), rms(&across), jackknife(&noise, |[a, b]| (a / b).sqrt())) {
            (Some(along_excess_m), Some(across_rms_m), Some(noise_ratio)) => {
                Finding::Found(StraightScore { along_excess_m, across_rms_m, noise_ratio })
            }
            _ => Finding::CannotTell("it has no output on the straight legs, or raw has no noise there".to_owned()),
        }
    }
}

/// Lateral acceleration from three positions half a second apart.
fn is_straight(updates: &Updates, i: usize) -> bool {
    let v = updates.velocity[i];
    let speed = length(v);
    if speed < LEAST_SPEED_MPS {
        return false;
    }
    let acceleration = updates.acceleration(i, HALF_S);
    acceleration.is_some_and(|a| to_the_right(v, a).abs() / speed <= LATERAL_MPS2)
}

/// Residual across the leg about a parabola over time, m.
fn scatter_across(updates: &Updates, track: &Positions, run: &std::ops::Range<usize>) -> Vec<f64> {
    let heading = run.clone().fold([0.0; 2], |sum, i| AXES.map(|k| sum[k] + updates.velocity[i][k]));
    let (from, to) = (updates.t(run.start), updates.t(run.end - 1));
    let t: Vec<f64> = run.clone().map(|i| 2.0 * (updates.t(i) - from) / (to - from) - 1.0).collect();
    let origin = updates.at(track, run.start);
    let y: Vec<f64> =
        run.clone().map(|i| to_the_right(heading, minus(updates.at(track, i), origin)) / length(heading)).collect();
    let powers = [0, 1, 2].map(|power| t.iter().map(|t| t.powi(power)).collect());
    residuals_of(&y, &orthonormal(&powers))
}

/// A finding, or the reason for none.
pub(crate) fn found<T>(value: Option<T>, why: &str) -> Finding<T> {
    value.map_or_else(|| Finding::CannotTell(why.to_owned()), Finding::Found)
}
