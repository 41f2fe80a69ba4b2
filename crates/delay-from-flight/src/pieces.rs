//! Splits the record where an offset ends: at gaps of the second channel, and at resets.

use super::FlightDelaySettings;
use super::disturbance::disturbances;
use super::local::{BodyAxes, Prepared};
use super::reference::{Integral, Interpolated};
use crate::horizontal::{AXES, Horizontal};
use flight::{Code, Notices, Severity};
use signal::Reference;
use std::ops::Range;

/// Least number of samples for a piece with its own offset.
pub(crate) const LEAST_ROWS: usize = 20;
/// Maximum number of pieces in a fit; more would cost an offset and a noise each and add little.
const MOST_PIECES: usize = 12;
/// Smallest reset or glitch that is detected, m or m/s.
const LEAST_RESET: f64 = 0.3;

/// A stretch with one offset.
#[derive(Debug, Clone)]
pub(crate) struct Piece {
    /// Rows of the first channel.
    pub(crate) rows: Vec<usize>,
    /// Index of the stretch of the second channel that it is compared with.
    pub(crate) stretch: usize,
    /// Why it starts here; empty for the first.
    pub(crate) begun_by: String,
}

impl Piece {
    /// Duration from its first row to its last, s; `first` is the first channel.
    pub(crate) fn duration_s(&self, first: &Horizontal) -> f64 {
        match *self.rows.as_slice() {
            [a, .., b] => first.t[b] - first.t[a],
            _ => 0.0,
        }
    }
}

/// The second channel as a reference, north and east, over one stretch without gaps.
pub(crate) type Stretch<'a> = [Box<dyn Reference + 'a>; 2];

/// Names for notices.
pub(crate) struct Names<'a> {
    pub(crate) first: &'a str,
    pub(crate) second: &'a str,
}

/// Drops single samples of a rate that no vehicle can follow: a jump away and back by more than 100 m/s² (or 20 robust
/// deviations of the second difference, whichever is more). Each would shift the integral permanently. `body` loses the
/// same samples.
pub(crate) fn without_spikes(
    rate: &Horizontal,
    body: &mut Option<BodyAxes>,
    name: &str,
    notices: &mut Notices,
) -> Option<Horizontal> {
    const HARDEST: f64 = 100.0;
    let n = rate.t.len();
    let bend = |y: &[f64], k: usize| y[k] - 0.5 * (y[k - 1] + y[k + 1]);
    let mut spike = vec![false; n];
    for axis in AXES {
        let y = &rate.axes[axis];
        let bends: Vec<f64> = (1..n.saturating_sub(1)).map(|k| bend(y, k)).collect();
        let usual = signal::robust_sigma(&bends).unwrap_or(0.0);
        for k in 1..n.saturating_sub(1) {
            let (before, after) = (y[k] - y[k - 1], y[k + 1] - y[k]);
            let hard = before.abs().min(after.abs()) > HARDEST * (rate.t[k + 1] - rate.t[k - 1]).max(0.02);
            spike[k] |= before * after < 0.0 && hard && bend(y, k).abs() > 20.0 * usual;
        }
    }
    let count = spike.iter().filter(|s| **s).count();
    if count == 0 {
        return None;
    }
    let samples = number_of(count as u64, "sample", "samples");
    let text = format!("{name}: {samples} dropped for a jump away and back of more than {HARDEST} m/s²");
    notices.push(Code::SamplesLeftOut, name, count as u64, text);
    let keep = |x: &[f64]| x.iter().zip(&spike).filter(|(_, s)| !**s).map(|(x, _)| *x).collect();
    body.iter_mut().flatten().flatten().for_each(|column| *column = keep(column));
    Some(Horizontal { t: keep(&rate.t), axes: [keep(&rate.axes[0]), keep(&rate.axes[1])] })
}

/// Largest step of a velocity that is smoothed, s: at 20 Hz a hard turn loses a centimetre.
const SMOOTHED_S: f64 = 0.05;
/// Weights of a sample and its neighbours: noise that alternates in sign from sample to sample is removed entirely.
const BINOMIAL: [f64; 5] = [1.0 / 16.0, 4.0 / 16.0, 6.0 / 16.0, 4.0 / 16.0, 1.0 / 16.0];
/// Power of white noise in the steps from sample to sample after that: Σ (1, 3, 2, -2, -3, -1)²/16².
const BINOMIAL_STEPS: f64 = 28.0 / 256.0;

/// Share of noise in the steps of a velocity, by power, above which it counts.
const VELOCITY_NOISE_COUNTS: f64 = 0.1;
/// Most smoothing of a noisy velocity, standard deviation of the weights, s: a velocity at rest is noise alone.
const VELOCITY_SMOOTHED_S: f64 = 1.0;
/// Most that smoothing may take from the turns of a noisy velocity, rms, m.
const MOST_LOST_M: f64 = 0.05;

/// A velocity (m/s, timestamps in s), smoothed; `None` if its usual step is longer than [`SMOOTHED_S`] and it has
/// little noise, or if it cannot be smoothed.
///
/// Between two samples the integral of white noise has another variance than at a sample. A fit of the delay mistakes
/// the smaller variance for better agreement and ends at multiples of the step. It also takes the steps of the noise for
/// motion that shows the delay, and its uncertainty is far too small. The smoothed velocity has hardly any noise from
/// sample to sample, and the noise of its integral does not depend on where it is read. What smoothing takes from a turn
/// is parallel to the acceleration, and so looks like no delay.
///
/// With noise of 0.05 m/s at 10 Hz and steps of 0.02 m/s, a delay of 250 ms was measured as 200 ± 17 or 300 ± 17 ms.
pub(crate) fn smoothed_velocity(velocity: &Horizontal, step_s: Option<f64>) -> Option<Horizontal> {
    let step_s = step_s.filter(|step| *step > 0.0)?;
    let noise = power(velocity, &|y| white_noise(y).powi(2));
    // `left` is the power of white noise in the steps, 2 without smoothing.
    let counts = |smoothed: &Horizontal, left: f64| left * noise > VELOCITY_NOISE_COUNTS * power(smoothed, &mean_step);
    let fast = if step_s <= SMOOTHED_S { smoothed(velocity, step_s) } else { None };
    let (least, left) = fast.as_ref().map_or((velocity, 2.0), |fast| (fast, BINOMIAL_STEPS));
    if !counts(least, left) {
        return fast;
    }
    let mut best = fast;
    let mut half = 1;
    // The weights of two means over m samples have the variance (m² − 1)/6, and 2/m³ of the noise is in their steps.
    let samples = |half: usize| (2 * half + 1) as f64;
    let deviation_s = |half: usize| ((samples(half).powi(2) - 1.0) / 6.0).sqrt() * step_s;
    while deviation_s(half) <= VELOCITY_SMOOTHED_S {
        let Some(now) = two_means(velocity, half, step_s) else { break };
        let lost_m = 0.5 * deviation_s(half).powi(2) * power(&now, &mean_step).sqrt() / step_s;
        if lost_m > MOST_LOST_M {
            break;
        }
        let is_enough = !counts(&now, 2.0 / samples(half).powi(3));
        best = Some(now);
        if is_enough {
            break;
        }
        half = (half + 1).max(half * 4 / 3);
    }
    best
}

/// The sum over both axes.
fn power(series: &Horizontal, of: &dyn Fn(&[f64]) -> f64) -> f64 {
    AXES.map(|axis| of(&series.axes[axis])).iter().sum()
}

/// Mean square of the steps from sample to sample.
fn mean_step(y: &[f64]) -> f64 {
    y.windows(2).map(|pair| (pair[1] - pair[0]).powi(2)).sum::<f64>() / y.len().max(2) as f64
}

/// Largest step of a track that is smoothed twice, s: a turn at 3 m/s² loses 0.12 m.
const SMOOTHED_TWICE_S: f64 = 0.2;
/// Bias of a delay in units of its uncertainty above which the noise of a track counts.
const NOISE_COUNTS: f64 = 0.1;

/// A track (timestamps in s), smoothed; `None` if its noise is too small to matter, or if it cannot be smoothed.
///
/// Read between two samples, a track has up to 36 % less variance than at a sample. Where both tracks have the same
/// timestamps, a fit mistakes that for better agreement, and its delay is drawn to half a step: two positions at 10 Hz
/// with 1 m of noise, equally late, were 48.0 ± 1.8 ms apart. Of a smoothed track the variance differs by 2 %, and
/// smoothed twice by 0.7 %. What
/// smoothing takes from a turn is parallel to the acceleration, and so looks like no delay.
pub(crate) fn smoothed_track(track: &Horizontal, step_s: Option<f64>) -> Option<Horizontal> {
    let step_s = step_s.filter(|_| track.t.len() > BINOMIAL.len())?;
    let length = |of: &dyn Fn(usize) -> f64| AXES.map(|axis| of(axis).powi(2)).iter().sum::<f64>().sqrt();
    let noise = length(&|axis| white_noise(&track.axes[axis]));
    let speed = length(&|axis| deviation(Interpolated::new(&track.t, &track.axes[axis]).slopes()));
    // The bias is about noise²/(step · speed²), the uncertainty noise/(speed √n).
    let counts = noise * (track.t.len() as f64).sqrt() > NOISE_COUNTS * step_s * speed;
    let once = if counts { smoothed(track, step_s)? } else { return None };
    // Slower tracks would lose too much of their turns.
    if step_s <= SMOOTHED_TWICE_S { smoothed(&once, step_s) } else { Some(once) }
}

/// Noise of an acceleration over its motion above which it counts.
const ACCELERATION_NOISE_COUNTS: f64 = 0.15;
/// Smoothing of a noisy acceleration, standard deviation of the weights, s: motion of 1 Hz loses a sixth.
const ACCELERATION_SMOOTHED_S: f64 = 0.1;

/// An acceleration (m/s², timestamps in s), smoothed; `None` if its white noise is small against its motion, or if it
/// cannot be smoothed.
///
/// A fit takes the rate of its reference for motion, noise included, and the noise of the integral is in the residuals
/// as well. With as much noise as motion the least residual is where the noise happens to be: 3 m/s² at 100 Hz moved
/// the delay of a velocity by up to 49 ms, with a standard uncertainty of 0.4 ms. Smoothing is symmetric and shifts
/// nothing, and what it takes from a turn is parallel to the velocity, and so looks like no delay.
pub(crate) fn smoothed_acceleration(rate: &Horizontal, step_s: Option<f64>) -> Option<Horizontal> {
    let step_s = step_s.filter(|step| *step > 0.0)?;
    let noise = power(rate, &|y| white_noise(y).powi(2));
    let all = power(rate, &|y| deviation(y).powi(2));
    if noise <= ACCELERATION_NOISE_COUNTS.powi(2) * (all - noise) {
        return None;
    }
    // The weights of two means over m samples have the variance (m² − 1)/6.
    let samples = (6.0 * (ACCELERATION_SMOOTHED_S / step_s).powi(2) + 1.0).sqrt();
    let half = (0.5 * samples) as usize;
    if half > 0 { two_means(rate, half, step_s) } else { None }
}

/// [`mean_over`] twice; `None` if timestamps are so uneven that the smoothed ones would cross their neighbours.
fn two_means(series: &Horizontal, half: usize, step_s: f64) -> Option<Horizontal> {
    let twice = mean_over(&mean_over(series, half, step_s), half, step_s);
    twice.t.windows(2).all(|pair| pair[0] < pair[1]).then_some(twice)
}

/// The mean over `half` samples to either side of each, fewer next to a gap: always as many before as after. The
/// timestamps are averaged too, so uneven ones shift no sample.
fn mean_over(series: &Horizontal, half: usize, step_s: f64) -> Horizontal {
    let mut out = series.clone();
    for run in stretches(&series.t, 2.5 * step_s) {
        let start = series.t[run.start];
        let smooth = |y: &[f64], offset: f64, into: &mut [f64]| {
            let mut sums = vec![0.0];
            sums.extend(y.iter().scan(0.0, |sum, y| {
                *sum += y - offset;
                Some(*sum)
            }));
            for (k, smoothed) in into.iter_mut().enumerate() {
                let half = half.min(k).min(y.len() - 1 - k);
                *smoothed = offset + (sums[k + half + 1] - sums[k - half]) / (2 * half + 1) as f64;
            }
        };
        smooth(&series.t[run.clone()], start, &mut out.t[run.clone()]);
        for axis in AXES {
            smooth(&series.axes[axis][run.clone()], 0.0, &mut out.axes[axis][run.clone()]);
        }
    }
    out
}

/// The mean of five samples around each, weighted; samples next to a gap are unchanged. `None` if timestamps are so
/// uneven that the smoothed ones would cross their neighbours.
fn smoothed(series: &Horizontal, step_s: f64) -> Option<Horizontal> {
    let longest_s = 1.5 * (BINOMIAL.len() - 1) as f64 * step_s;
    let mean = |x: &[f64]| x.iter().zip(BINOMIAL).map(|(x, weight)| x * weight).sum::<f64>();
    let half = BINOMIAL.len() / 2;
    let mut out = series.clone();
    for (k, t) in series.t.windows(BINOMIAL.len()).enumerate() {
        if t[BINOMIAL.len() - 1] - t[0] <= longest_s {
            // The timestamps are averaged too, so uneven ones shift no sample.
            out.t[k + half] = t[0] + t.iter().zip(BINOMIAL).map(|(t_k, weight)| weight * (t_k - t[0])).sum::<f64>();
            for axis in AXES {
                out.axes[axis][k + half] = mean(&series.axes[axis][k..k + BINOMIAL.len()]);
            }
        }
    }
    out.t.windows(2).all(|pair| pair[0] < pair[1]).then_some(out)
}

/// Standard deviation of the white noise of evenly spaced samples, robust, from their third differences.
fn white_noise(y: &[f64]) -> f64 {
    let third = |y: &[f64]| y[3] - 3.0 * y[2] + 3.0 * y[1] - y[0];
    let thirds: Vec<f64> = y.windows(4).map(third).collect();
    // 1 + 9 + 9 + 1
    signal::robust_sigma(&thirds).unwrap_or(0.0) / 20_f64.sqrt()
}

fn deviation(y: &[f64]) -> f64 {
    let n = y.len().max(1) as f64;
    let mean = y.iter().sum::<f64>() / n;
    (y.iter().map(|y| (y - mean).powi(2)).sum::<f64>() / n).sqrt()
}

/// Ranges of rows in which the second channel has no gap longer than `gap_s`.
pub(crate) fn stretches(t: &[f64], gap_s: f64) -> Vec<Range<usize>> {
    let mut out: Vec<Range<usize>> = vec![];
    for k in 0..t.len() {
        match out.last_mut() {
            Some(stretch) if t[k] - t[k - 1] <= gap_s => stretch.end = k + 1,
            _ => out.push(k..k + 1),
        }
    }
    out.retain(|s| s.len() > 2);
    out
}

/// The longest gap that is bridged: 2.5 usual intervals, at least half a second.
pub(crate) fn longest_gap(usual_step_s: Option<f64>, settings: &FlightDelaySettings) -> f64 {
    settings.bridge_s.unwrap_or((2.5 * usual_step_s.unwrap_or(0.0)).max(0.5))
}

/// The median interval between timestamps, s; `None` without any.
pub(crate) fn usual_step_s(t: &[f64]) -> Option<f64> {
    let steps: Vec<f64> = t.windows(2).map(|w| w[1] - w[0]).collect();
    signal::median_by_selection(&steps)
}

/// Prior standard deviation of an accelerometer's bias, m/s²: tilt errors of some degrees look like one.
const BIAS_PRIOR_MPS2: f64 = 0.5;

/// References over the stretches. With `body` axes a bias along each of them is fitted with the delay: in a turn a
/// forward bias is parallel to the jerk and would look like a delay (delay network, section 9).
pub(crate) fn references<'a>(
    second: &'a Horizontal,
    stretches: &[Range<usize>],
    integrate: bool,
    body: Option<&BodyAxes>,
) -> Vec<Stretch<'a>> {
    let of = |s: &Range<usize>, axis: usize| -> Box<dyn Reference + 'a> {
        let (t, y) = (&second.t[s.clone()], &second.axes[axis][s.clone()]);
        match (integrate, body) {
            (false, _) => Box::new(Interpolated::new(t, y)),
            (true, None) => Box::new(Integral::new(t, y)),
            (true, Some(body)) => {
                let columns = body.each_ref().map(|column| &column[axis][s.clone()]);
                Box::new(Integral::new(t, y).with_shared(&columns, BIAS_PRIOR_MPS2))
            }
        }
    };
    stretches.iter().map(|s| AXES.map(|axis| of(s, axis))).collect()
}

/// Index of the stretch that covers each row of the first channel at the delay `delay_s`.
fn stretch_of(first: &Horizontal, stretches: &[Stretch], delay_s: f64) -> Vec<Option<usize>> {
    let mut s = 0;
    first
        .t
        .iter()
        .map(|t| {
            while s < stretches.len() && t - delay_s > stretches[s][0].span().1 {
                s += 1;
            }
            (s < stretches.len() && t - delay_s >= stretches[s][0].span().0).then_some(s)
        })
        .collect()
}

/// Why the `k`-th piece of a stretch starts, in words; empty for the very first.
fn begun_by(k: usize, stretch: usize, stretches: &[Stretch], names: &Names) -> String {
    match (k, stretch) {
        (0, 0) => String::new(),
        (0, s) => {
            let gap = stretches[s][0].span().0 - stretches[s - 1][0].span().1;
            format!("a gap of {gap:.3} s in {} (or a jump of its clock)", names.second)
        }
        _ => format!("a reset of {}", names.first),
    }
}

/// Number of skipped samples and of cuts, by cause.
#[derive(Default)]
struct Cuts {
    glitches: u64,
    wild: u64,
    resets: u64,
    gaps: u64,
}

impl Cuts {
    fn report(&self, names: &Names, notices: &mut Notices) {
        let Cuts { glitches, wild, resets, gaps } = self;
        if *glitches > 0 {
            let samples = number_of(*glitches, "sample", "samples");
            let text = format!("{}: {samples} dropped for a jump away from the neighbours", names.first);
            notices.push(Code::SamplesLeftOut, names.first, *glitches, text);
        }
        if *wild > 0 {
            let text = format!(
                "{} and {} contradict each other by {WILD} times the usual in {}, as before a receiver has settled: \
                 dropped",
                names.first,
                names.second,
                number_of(*wild, "sample", "samples")
            );
            notices.push(Code::SamplesLeftOut, names.first, *wild, text);
        }
        report_split(names.first, *resets, ["reset", "resets"], notices);
        report_split(names.second, *gaps, ["gap or clock jump", "gaps or clock jumps"], notices);
    }
}

/// Splits the first channel into pieces for the delay `delay_s`; reports every cut and every skipped sample.
pub(crate) fn pieces(
    prepared: &Prepared,
    stretches: &[Stretch],
    delay_s: f64,
    names: &Names,
    notices: &mut Notices,
) -> Vec<Piece> {
    let first = &prepared.first;
    let mut home = stretch_of(first, stretches, delay_s);
    skip_rest(&mut home, prepared, names, notices);
    let mut out: Vec<Piece> = vec![];
    let mut counts = Cuts { gaps: (stretches.len() as u64).saturating_sub(1), ..Cuts::default() };
    for (stretch, references) in stretches.iter().enumerate() {
        let rows: Vec<usize> = (0..first.t.len()).filter(|&k| home[k] == Some(stretch)).collect();
        if rows.is_empty() {
            continue;
        }
        let residuals = AXES.map(|axis| residuals(first, &*references[axis], axis, &rows, delay_s));
        let flaws = Flaws::of(&residuals, disturbed(first, &residuals, &rows, &prepared.speed));
        flaws.count(&mut counts);
        let mut cuts = vec![0];
        cuts.extend(&flaws.resets);
        cuts.push(rows.len());
        for (k, cut) in cuts.windows(2).enumerate() {
            let kept: Vec<usize> = (cut[0]..cut[1]).filter(|&r| !flaws.away[r]).map(|r| rows[r]).collect();
            let begun_by = begun_by(k, stretch, stretches, names);
            out.push(Piece { rows: kept, stretch, begun_by });
        }
    }
    counts.report(names, notices);
    keep_the_best(out, first, names, notices)
}

/// `1 sample`, `2 samples`.
fn number_of(n: u64, one: &str, many: &str) -> String {
    format!("{n} {}", if n == 1 { one } else { many })
}

fn report_split(name: &str, count: u64, [one, many]: [&str; 2], notices: &mut Notices) {
    if count > 0 {
        let cuts = number_of(count, one, many);
        let text = format!("{name}: {cuts}: the record is cut there, each part has its own offset");
        notices.push(Code::RecordSplit, name, count, text);
    }
}

/// Removes samples at rest before and after the motion from their stretches.
fn skip_rest(home: &mut [Option<usize>], prepared: &Prepared, names: &Names, notices: &mut Notices) {
    let (from, to) = moving_part(&prepared.speed);
    let at_rest = |t: f64| t < from - REST_KEPT_S || t > to + REST_KEPT_S;
    let of_rest = home.iter_mut().zip(&prepared.first.t).filter(|(h, t)| h.is_some() && at_rest(**t));
    let rest = of_rest.map(|(h, _)| *h = None).count();
    if rest > 0 {
        let samples = number_of(rest as u64, "sample", "samples");
        let text = format!("{}: {samples} left out: at rest before or after the motion", names.first);
        notices.push(Code::SamplesLeftOut.at(Severity::Info), names.first, rest as u64, text);
    }
}

/// Defects in the rows of a stretch.
struct Flaws {
    /// Rows that are not used.
    away: Vec<bool>,
    /// Those of them in which the two channels contradict each other.
    wild: Vec<bool>,
    resets: Vec<usize>,
}

impl Flaws {
    fn of(residuals: &[Vec<f64>; 2], wild: Vec<bool>) -> Flaws {
        let (mut away, mut resets) = (wild.clone(), vec![]);
        for residuals in residuals {
            let found = disturbances(residuals, LEAST_RESET);
            found.glitches.iter().for_each(|&k| away[k] = true);
            resets.extend(found.resets);
        }
        resets.retain(|&k| !wild[k] && !wild[k - 1]);
        resets.sort_unstable();
        resets.dedup();
        Flaws { away, wild, resets }
    }

    fn count(&self, cuts: &mut Cuts) {
        let of = |flags: &[bool]| flags.iter().filter(|flag| **flag).count() as u64;
        cuts.wild += of(&self.wild);
        cuts.glitches += of(&self.away) - of(&self.wild);
        cuts.resets += self.resets.len() as u64;
    }
}

/// First channel less the second at the delay `delay_s`, at each of `rows`.
fn residuals(first: &Horizontal, reference: &dyn Reference, axis: usize, rows: &[usize], delay_s: f64) -> Vec<f64> {
    let instants: Vec<f64> = rows.iter().map(|&k| first.t[k] - delay_s).collect();
    let (mut values, mut rates) = (vec![0.0; rows.len()], vec![0.0; rows.len()]);
    reference.fill(&instants, &mut values, &mut rates);
    rows.iter().zip(&values).map(|(&k, value)| first.axes[axis][k] - value).collect()
}

/// Duration of rest that is kept before and after the motion, s.
const REST_KEPT_S: f64 = 10.0;

/// First and last instant in motion: the ends of the first and last five seconds whose median speed is above 1 m/s.
/// Rest carries no information on a delay, and its noise differs from that in flight.
fn moving_part((t, speed): &(Vec<f64>, Vec<f64>)) -> (f64, f64) {
    const LOOK_S: f64 = 5.0;
    const MOVES_MPS: f64 = 1.0;
    let (mut from, mut to) = (f64::NEG_INFINITY, f64::INFINITY);
    let mut a = 0;
    let mut first = true;
    while a < t.len() {
        let b = t.partition_point(|x| *x < t[a] + LOOK_S).max(a + 1);
        if signal::median_by_selection(&speed[a..b]).is_some_and(|v| v > MOVES_MPS) {
            if first {
                (from, first) = (t[a], false);
            }
            to = t[b - 1];
        }
        a = b;
    }
    if first { (f64::NEG_INFINITY, f64::INFINITY) } else { (from, to) }
}

/// Number of samples over which the scatter of a stretch is computed.
const BLOCK: usize = 50;
/// A block with more than this multiple of the median scatter in motion is not a measurement of this flight.
const WILD: f64 = 8.0;
/// And at least this from sample to sample, m or m/s.
const LEAST_WILD: f64 = 1.0;

/// Rows of blocks with wild scatter from sample to sample.
fn disturbed(
    first: &Horizontal,
    residuals: &[Vec<f64>; 2],
    rows: &[usize],
    (speed_t, speed): &(Vec<f64>, Vec<f64>),
) -> Vec<bool> {
    let scatter = |block: std::ops::Range<usize>| -> f64 {
        let of = |axis: usize| {
            let steps: Vec<f64> = residuals[axis][block.clone()].windows(2).map(|w| w[1] - w[0]).collect();
            signal::robust_sigma(&steps).unwrap_or(0.0)
        };
        of(0).max(of(1))
    };
    let moves = |block: &[usize]| {
        let at = |k: &usize| speed.get(speed_t.partition_point(|t| *t <= first.t[*k]).saturating_sub(1));
        at(&block[block.len() / 2]).is_some_and(|v| *v > 1.0)
    };
    let block = |b: usize| b * BLOCK..((b + 1) * BLOCK).min(rows.len());
    let blocks: Vec<(f64, bool)> =
        (0..rows.len().div_ceil(BLOCK)).map(|b| (scatter(block(b)), moves(&rows[block(b)]))).collect();
    let mut usual: Vec<f64> = blocks.iter().filter(|b| b.1).map(|b| b.0).collect();
    if usual.len() < 10 {
        return vec![false; rows.len()];
    }
    let usual = signal::median_in_place(&mut usual).unwrap_or(0.0);
    let bar = (WILD * usual).max(LEAST_WILD);
    (0..rows.len()).map(|k| blocks[k / BLOCK].0 > bar).collect()
}

fn keep_the_best(mut all: Vec<Piece>, first: &Horizontal, names: &Names, notices: &mut Notices) -> Vec<Piece> {
    let rows = |pieces: &[Piece]| pieces.iter().map(|p| p.rows.len() as u64).sum::<u64>();
    let before = (all.len(), rows(&all));
    all.retain(|p| p.rows.len() >= LEAST_ROWS);
    let length = |p: &Piece| first.t[p.rows[p.rows.len() - 1]] - first.t[p.rows[0]];
    if all.len() > MOST_PIECES {
        all.sort_by(|a, b| length(b).total_cmp(&length(a)));
        all.truncate(MOST_PIECES);
        all.sort_by_key(|p| p.rows[0]);
    }
    let lost = before.1 - rows(&all);
    if lost > 0 {
        let text = format!(
            "{}: {} left out, in {} too short or not among the {MOST_PIECES} longest",
            names.first,
            number_of(lost, "sample", "samples"),
            number_of((before.0 - all.len()) as u64, "piece", "pieces")
        );
        notices.push(Code::SamplesLeftOut.at(Severity::Info), names.first, lost, text);
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 20 Hz: the neighbours are 0.1 s apart, so 100 m/s² is a jump of 10 m/s.
    fn kept(north: impl Fn(usize) -> f64) -> Option<(usize, u64)> {
        let t: Vec<f64> = (0..100).map(|k| 0.05 * k as f64).collect();
        let rate = Horizontal { axes: [(0..100).map(north).collect(), vec![3.0; 100]], t };
        let mut notices = Notices::default();
        let kept = without_spikes(&rate, &mut None, "velocity.gps", &mut notices)?;
        assert!(!kept.t.contains(&(0.05 * 40.0)), "row 40 is left out");
        Some((kept.axes[0].len(), notices.iter().map(|notice| notice.count).sum()))
    }

    #[test]
    fn a_velocity_that_jumps_away_and_back_is_left_out_and_counted() {
        let spike = |size: f64| move |k: usize| if k == 40 { 5.0 + size } else { 5.0 };
        assert_eq!(kept(spike(10.5)), Some((99, 1)));
        assert_eq!(kept(spike(-10.5)), Some((99, 1)));
        assert_eq!(kept(spike(9.5)), None);
    }

    #[test]
    fn a_step_of_the_velocity_and_noise_of_the_same_size_are_kept() {
        assert_eq!(kept(|k| if k < 40 { 5.0 } else { 25.0 }), None);
        // Every sample differs from the mean of its neighbours by 2 m/s.
        let noise = |k: usize| if k.is_multiple_of(2) { 1.0 } else { -1.0 };
        assert_eq!(kept(|k| noise(k) + if k == 40 { 12.0 } else { 0.0 }), None);
    }
}
