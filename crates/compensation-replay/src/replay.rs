//! Runs one flight through all compensators.

use crate::curves::{Curves, draw};
use crate::estimate::{Positions, estimates};
use crate::explorer::explorer_rows;
use crate::input::{Input, Refusal};
use crate::rows::{Rows, bridge, segments};
use crate::score;
use crate::settings::Settings;
use crate::track::ReplayedTrack;
use flight::{Distribution, Flight, Notices};
use record::{ExplorerRows, ReplayRecord, ReplaySettings};
use std::ops::Range;

/// Result of a replay.
#[derive(Debug, Clone, PartialEq)]
pub struct Replay {
    /// Results.
    pub record: ReplayRecord,
    /// Every row.
    pub track: ReplayedTrack,
    /// The same rows in compact form.
    pub explorer: ExplorerRows,
    /// Messages for the reader of the record.
    pub notices: Notices,
}

/// Replays the compensators over a flight.
///
/// # Errors
/// A [`Refusal`] with the reason if compensation cannot be assessed on this flight.
pub fn replay(flight: &Flight, settings: &Settings) -> Result<Replay, Refusal> {
    play(flight, settings, Extent::Whole)
}

/// The same without scores: what a page needs to draw a flight.
///
/// # Errors
/// As [`replay`].
pub fn sketch(flight: &Flight, settings: &Settings) -> Result<Replay, Refusal> {
    play(flight, settings, Extent::Sketch)
}

/// Extent of a replay.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Extent {
    Whole,
    Sketch,
}

/// A flight after the compensators, before scoring.
struct Compensated {
    input: Input,
    speed: Distribution,
    bridge_s: f64,
    segments: Vec<Range<usize>>,
    rows: Rows,
    estimates: Vec<Positions>,
}

fn compensate(flight: &Flight, settings: &Settings, notices: &mut Notices) -> Result<Compensated, Refusal> {
    let input = Input::of(flight, settings, notices)?;
    let speed = ground_speed(&input, settings)?;
    let bridge_s = bridge(&input, settings);
    let segments = segments(&input.velocity.t, bridge_s);
    Input::warn_of_coarse_stamps(flight, &input.names, settings, notices);
    let rows = Rows::of(&input, settings, &segments, notices)?;
    if rows.valid().next().is_none() {
        let record::PairUse { position, velocity, .. } = input.names;
        return Err(Refusal::NothingValid { position, velocity, delay_s: settings.delay.seconds() });
    }
    let estimates = estimates(&input, settings, &segments, &rows, notices);
    score::warn_of_contradiction(&input, settings, &segments, notices);
    Ok(Compensated { input, speed, bridge_s, segments, rows, estimates })
}

fn play(flight: &Flight, settings: &Settings, extent: Extent) -> Result<Replay, Refusal> {
    let mut notices = Notices::new();
    let compensated = compensate(flight, settings, &mut notices)?;
    let record = judged(flight, settings, &compensated, extent, &mut notices);
    let Compensated { input, rows, estimates, .. } = compensated;
    let explorer = explorer_rows(&input, &rows, &estimates);
    let (origin, frame, fixes) = (input.origin, input.frame, [input.position.t, input.down]);
    let track = ReplayedTrack { origin, frame, fixes, rows, estimates };
    Ok(Replay { record, track, explorer, notices })
}

fn judged(
    flight: &Flight,
    settings: &Settings,
    compensated: &Compensated,
    extent: Extent,
    notices: &mut Notices,
) -> ReplayRecord {
    let Compensated { input, bridge_s, segments, rows, estimates, .. } = compensated;
    let innovations = score::innovations(input, settings, segments);
    let resets = score::resets(input, &innovations, notices);
    let compensators = score::compensators(input, settings, rows, estimates, &innovations);
    let predicted_rms_m = score::predicted(input, rows, settings);
    let played =
        score::Played { input, settings, segments, rows, tracks: estimates, travelled_m: predicted_rms_m.value };
    let (scores, onboard) = match extent {
        Extent::Whole => (Some(score::scores(&played, innovations)), score::onboard(flight, &played, notices)),
        Extent::Sketch => (None, None),
    };
    let Curves { axes, zoom, lead } = draw(input, settings, rows, estimates);
    ReplayRecord {
        settings: as_used(settings, *bridge_s),
        pair: input.names.clone(),
        origin_ns: input.origin.0,
        clock: input.clock,
        origin: input.frame.map(|f| f.origin()),
        coverage: rows.coverage(input, *bridge_s, segments, resets),
        speed_mps: compensated.speed,
        predicted_rms_m,
        compensators,
        scores,
        onboard,
        axes,
        zoom,
        lead,
        choice: None,
        sweep: None,
    }
}

fn as_used(settings: &Settings, bridge_s: f64) -> ReplaySettings {
    ReplaySettings {
        delay: settings.delay,
        delay_uncertainty_s: settings.delay_uncertainty_s,
        delay_source: settings.delay_source.clone(),
        card: settings.card.clone(),
        start: settings.start,
        bridge_s,
    }
}

/// Median and percentiles of the ground speed; rejects a flight that does not move.
fn ground_speed(input: &Input, settings: &Settings) -> Result<Distribution, Refusal> {
    let mut speeds: Vec<f64> = {
        let [north, east] = &input.velocity.axes;
        north.iter().zip(east).map(|(n, e)| n.hypot(*e)).collect()
    };
    speeds.sort_unstable_by(f64::total_cmp);
    let at = |share| signal::percentile_of_sorted(&speeds, share).unwrap_or_default();
    let p95_mps = at(0.95);
    if p95_mps < settings.min_speed_mps {
        return Err(Refusal::NoMotion { p95_mps, limit_mps: settings.min_speed_mps });
    }
    Ok(Distribution { min: at(0.0), p01: at(0.01), median: at(0.5), p99: at(0.99), max: at(1.0) })
}
