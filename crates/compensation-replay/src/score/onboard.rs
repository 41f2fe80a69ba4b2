//! The compensated position computed by the aircraft in flight, compared with the replay.

use super::Played;
use super::jackknife::jackknife;
use super::truthless::found;
use super::updates::{dot, length};
use crate::estimate::Positions;
use crate::input::{Input, local};
use crate::rows::{Rows, median_step};
use crate::settings::Settings;
use delay_from_flight::Averaged;
use delay_from_flight::{AXES, Horizontal};
use flight::{Channel, Code, Flight, Notices, Quantity, WGS84_A};
use record::{Finding, OnboardAgainst, OnboardComparison};

/// Delays after which a first-order filter has forgotten its start to better than 10⁻⁶: e^(−2·8).
const FORGOTTEN: f64 = 8.0;
/// Timestamps this close to a row's count as the row's, s.
const SAME_S: f64 = 1e-6;
/// Number of samples used to find the quantum of their values.
const GRID_SAMPLES: usize = 4_000;
/// Relative precision of single-precision metres and degrees.
const SINGLE: f64 = 6e-8;

/// `None` if the log has no such channel.
pub(crate) fn onboard(flight: &Flight, played: &Played, notices: &mut Notices) -> Option<Finding<OnboardComparison>> {
    let (name, channel) = flight.first_of(&played.settings.onboard)?;
    Some(compare(name, channel, played).map_or_else(
        |why| {
            notices.push(Code::OnboardNotCompared, name, channel.series.len() as u64, why.clone());
            Finding::CannotTell(why)
        },
        Finding::Found,
    ))
}

/// Why the channel cannot be compared; else whether it is in degrees.
fn is_geodetic(name: &str, channel: &Channel, input: &Input) -> Result<bool, String> {
    let geodetic = match channel.quantity {
        Quantity::PositionGeodetic => true,
        Quantity::PositionNed => false,
        other => return Err(format!("{name} holds {other:?}, which is not a position")),
    };
    if geodetic != input.frame.is_some() {
        return Err(format!("{name} and {} are not in the same coordinates", input.names.position));
    }
    if channel.series.timeline().clock() != input.clock {
        let clock = channel.series.timeline().clock();
        return Err(format!("{name} has timestamps of the clock {clock}, {} of {}", input.names.position, input.clock));
    }
    if input.averaged > 1 {
        return Err(format!(
            "the record is so long that every {} velocity samples are averaged, but the aircraft's filter used each \
             sample",
            input.averaged
        ));
    }
    Ok(geodetic)
}

fn compare(name: &str, channel: &Channel, played: &Played) -> Result<OnboardComparison, String> {
    let Played { input, settings, rows, tracks, .. } = *played;
    let geodetic = is_geodetic(name, channel, input)?;
    let used = channel.update_rows();
    let place = (input.origin, input.frame.as_ref());
    let onboard =
        local((channel, name), used.iter().copied(), place, Averaged::none(used.len())).map_err(|e| e.to_string())?.0;
    let pairs = pairs(&onboard, rows);
    if pairs.is_empty() {
        return Err(format!("no sample of {name} lies within the replay"));
    }
    let same_stamps = pairs.iter().all(|p| p.share == 0.0);
    let (tolerance_m, tolerance_source) = tolerance(channel, &used, &onboard, geodetic);
    let against: Vec<OnboardAgainst> =
        tracks.iter().filter_map(|track| against(track, &onboard, &pairs, played)).collect();
    Ok(OnboardComparison {
        channel: name.to_owned(),
        samples: used.len() as u64,
        compared: pairs.len() as u64,
        same_stamps,
        tolerance_m,
        tolerance_source,
        start_s: start_s(settings),
        reproduced_by: reproduced(&against, tolerance_m),
        against,
    })
}

/// How long a filter remembers its start, s.
fn start_s(settings: &Settings) -> f64 {
    FORGOTTEN * settings.delay.seconds()
}

/// A sample and its place in the rows.
struct Pair {
    sample: usize,
    row: usize,
    /// Fraction of the way to the next row.
    share: f64,
}

/// Samples within the valid rows; between two rows only if both hold the same fix.
fn pairs(onboard: &Horizontal, rows: &Rows) -> Vec<Pair> {
    let mut out = vec![];
    let mut next = 0;
    let is_valid = |row: usize| rows.has_output(row);
    for (sample, &t) in onboard.t.iter().enumerate() {
        while next < rows.t.len() && rows.t[next] <= t + SAME_S {
            next += 1;
        }
        let Some(row) = next.checked_sub(1) else { continue };
        let beyond = t - rows.t[row];
        if beyond.abs() <= SAME_S {
            if is_valid(row) {
                out.push(Pair { sample, row, share: 0.0 });
            }
        } else if next < rows.t.len() && is_valid(row) && is_valid(next) && !rows.has_new_fix(next) {
            let step = rows.t[next] - rows.t[row];
            if step <= rows.gap_s {
                out.push(Pair { sample, row, share: beyond / step });
            }
        }
    }
    out
}

fn against(track: &Positions, onboard: &Horizontal, pairs: &[Pair], played: &Played) -> Option<OnboardAgainst> {
    let rows = played.rows;
    let shown = |p: &&Pair| track.has_own_output(p.row) && (p.share == 0.0 || track.has_own_output(p.row + 1));
    let difference = |p: &Pair| {
        AXES.map(|k| {
            let y = &track.axes[k];
            let here = if p.share == 0.0 { y[p.row] } else { y[p.row] + p.share * (y[p.row + 1] - y[p.row]) };
            onboard.axes[k][p.sample] - here
        })
    };
    let starts = starts(pairs, rows, played.input);
    let start_s = start_s(played.settings);
    let is_start = |p: &Pair| {
        let last = starts.partition_point(|s| *s <= rows.t[p.row]).checked_sub(1);
        last.is_some_and(|k| rows.t[p.row] - starts[k] < start_s)
    };
    let (start, after): (Vec<&Pair>, Vec<&Pair>) = pairs.iter().filter(shown).partition(|p| is_start(p));
    let mut sizes: Vec<f64> = after.iter().map(|p| length(difference(p))).collect();
    if sizes.is_empty() {
        return None;
    }
    let rms_m = (sizes.iter().map(|d| d * d).sum::<f64>() / sizes.len() as f64).sqrt();
    let quantiles = signal::percentiles(&mut sizes, &[0.95, 1.0]);
    let every = after.len().div_ceil(3_000).max(1);
    let delay: Vec<[f64; 2]> = after
        .iter()
        .step_by(every)
        .map(|p| {
            let v = AXES.map(|k| rows.velocity[k][p.row]);
            [dot(difference(p), v), dot(v, v)]
        })
        .collect();
    Some(OnboardAgainst {
        name: track.name.clone(),
        rms_m,
        p95_m: quantiles[0],
        max_m: quantiles[1],
        start_max_m: start.iter().map(|p| length(difference(p))).reduce(f64::max),
        delay_s: found(jackknife(&delay, |[dv, vv]| -dv / vv), "the flight does not move"),
    })
}

/// Instants at which filters start: the first sample, and after every gap of the velocity, s.
fn starts(pairs: &[Pair], rows: &Rows, input: &Input) -> Vec<f64> {
    let longest = 2.5 * median_step(&input.velocity.t);
    let mut out = vec![rows.t[pairs[0].row]];
    out.extend(pairs.windows(2).filter(|w| rows.t[w[1].row] - rows.t[w[0].row] > longest).map(|w| rows.t[w[1].row]));
    out
}

/// Half a quantum on each axis plus the rounding of single precision.
fn tolerance(channel: &Channel, used: &[usize], onboard: &Horizontal, geodetic: bool) -> (f64, String) {
    let metres = |k: usize| match (geodetic, k) {
        (false, _) => 1.0,
        (true, 0) => WGS84_A,
        (true, _) => WGS84_A * channel.series.component(0)[used[0]].cos(),
    };
    let quantum = AXES.map(|k| {
        let values: Vec<f64> = used.iter().take(GRID_SAMPLES).map(|&r| channel.series.component(k)[r]).collect();
        signal::resolution(&values).map_or(0.0, |step| step * metres(k))
    });
    let extent = onboard.axes.iter().flatten().fold(0.0_f64, |m, x| m.max(x.abs()));
    let rounding = SINGLE * extent.max(1.0) * 4.0;
    // One quantum on each axis: half of it from rounding, half from values at the edge of rounding.
    let tolerance_m = length(quantum) + rounding;
    let text = format!(
        "one step of its values on each axis ({:.4} m north, {:.4} m east) and single precision at {extent:.0} m from the \
         origin",
        quantum[0], quantum[1]
    );
    (tolerance_m, text)
}

fn reproduced(against: &[OnboardAgainst], tolerance_m: f64) -> Finding<String> {
    let closest = against.iter().min_by(|a, b| a.rms_m.total_cmp(&b.rms_m));
    match closest {
        Some(a) if a.max_m <= tolerance_m => Finding::Found(a.name.clone()),
        Some(a) => Finding::CannotTell(format!(
            "the closest, {}, differs by {:.3} m rms and up to {:.3} m, more than the {tolerance_m:.4} m that rounding \
             allows",
            a.name, a.rms_m, a.max_m
        )),
        None => Finding::CannotTell("no compensator has an output after the start".to_owned()),
    }
}
