//! One flight through all compensators.

use crate::curves::{Curves, draw};
use crate::estimate::{PAPER, Positions, estimates};
use crate::explorer::explorer_rows;
use crate::input::{Input, Refusal};
use crate::rows::{Rows, bridge, segments};
use crate::score;
use crate::settings::Settings;
use crate::track::{Track, TrackColumn};
use flight::{Distribution, Flight, Geodetic, LocalFrame, Notices};
use record::{ExplorerRows, ReplayRecord, ReplaySettings};

/// What came of a replay.
#[derive(Debug, Clone, PartialEq)]
pub struct Replay {
    /// What was found.
    pub record: ReplayRecord,
    /// Every row.
    pub track: Track,
    /// The rows once more, in few bytes.
    pub explorer: ExplorerRows,
    /// What a reader of the record must know.
    pub notices: Notices,
}

/// Replays the compensators over a flight.
///
/// # Errors
/// A [`Refusal`] when compensation says nothing about this flight, with the reason.
pub fn replay(flight: &Flight, settings: &Settings) -> Result<Replay, Refusal> {
    play(flight, settings, Extent::Whole)
}

/// The same without scores and without the rows of the track: what a page needs to draw a flight.
///
/// # Errors
/// As [`replay`].
pub fn sketch(flight: &Flight, settings: &Settings) -> Result<(ReplayRecord, ExplorerRows), Refusal> {
    play(flight, settings, Extent::Sketch).map(|done| (done.record, done.explorer))
}

/// How much of a replay is wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Extent {
    Whole,
    Sketch,
}

fn play(flight: &Flight, settings: &Settings, extent: Extent) -> Result<Replay, Refusal> {
    let input = Input::of(flight, settings)?;
    let speed = ground_speed(&input, settings)?;
    let bridge_s = bridge(&input, settings);
    let segments = segments(&input.velocity.t, bridge_s);
    let mut notices = Notices::new();
    Input::warn_of_coarse_stamps(flight, &input.names, settings, &mut notices);
    let rows = Rows::of(&input, settings, &segments, &mut notices)?;
    if rows.valid().next().is_none() {
        let record::PairUse { position, velocity, .. } = input.names;
        return Err(Refusal::NothingValid { position, velocity, delay_s: settings.delay.seconds() });
    }
    let estimates = estimates(&input, settings, &segments, &rows, &mut notices);
    let innovations = score::innovations(&input, settings, &segments);
    score::warn_of_contradiction(&input, settings, &segments, &mut notices);
    let resets = score::resets(&innovations, &mut notices);
    let coverage = rows.coverage(&input, bridge_s, &segments, resets);
    let compensators = score::compensators(&input, settings, &rows, &estimates, &innovations);
    let predicted_rms_m = score::predicted(&rows, settings);
    let is_whole = extent == Extent::Whole;
    let scores = is_whole.then(|| {
        score::scores(&score::Played {
            input: &input,
            settings,
            segments: &segments,
            rows: &rows,
            tracks: &estimates,
            innovations: &innovations,
            way_m: predicted_rms_m.value,
        })
    });
    let onboard = is_whole.then(|| score::onboard(flight, settings, &input, &rows, &estimates, &mut notices)).flatten();
    let Curves { axes, zoom, track, lead } = draw(&input, settings, &rows, &estimates);
    let record = ReplayRecord {
        settings: as_used(settings, bridge_s),
        pair: input.names.clone(),
        origin_ns: input.origin.0,
        clock: input.clock,
        origin: input.frame.map(|f| f.origin()),
        coverage,
        speed_mps: speed,
        predicted_rms_m,
        compensators,
        scores,
        onboard,
        axes,
        zoom,
        track,
        lead,
        choice: None,
        sweep: None,
    };
    let track = if is_whole { table(&input, &rows, &estimates) } else { Track::default() };
    let explorer = explorer_rows(&input, &rows, &estimates);
    Ok(Replay { record, track, explorer, notices })
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

/// Median and percentiles of the ground speed; refuses a flight that does not move.
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

fn table(input: &Input, rows: &Rows, estimates: &[Positions]) -> Track {
    let stamps = rows.t.iter().map(|&t| input.origin.plus_seconds(t).0).collect();
    let shown = |values: &[f64], shown: &dyn Fn(usize) -> bool| {
        TrackColumn::F64(values.iter().enumerate().map(|(row, &v)| shown(row).then_some(v)).collect())
    };
    let mut columns = vec![
        ("stamp_ns".to_owned(), TrackColumn::I64(stamps)),
        ("t_s".to_owned(), shown(&rows.t, &|_| true)),
        ("state".to_owned(), TrackColumn::Text(rows.state.iter().map(|s| s.name()).collect())),
        ("fix_age_s".to_owned(), shown(&rows.age, &|_| true)),
    ];
    for estimate in estimates {
        let prefix = estimate.name.replace('-', "_");
        for (axis, values) in ["north", "east"].into_iter().zip(&estimate.axes) {
            columns.push((format!("{prefix}_{axis}_m"), shown(values, &|row| estimate.shown(rows, row))));
        }
    }
    if let Some(frame) = &input.frame {
        columns.extend(places(frame, input, rows, estimates));
    }
    Track { columns }
}

/// Height, then latitude and longitude of each estimate but the paper's, which no map shows: north and east from the origin
/// that the track states say the same.
fn places(frame: &LocalFrame, input: &Input, rows: &Rows, estimates: &[Positions]) -> Vec<(String, TrackColumn)> {
    let column = |points: &[Option<Geodetic>], value: fn(&Geodetic) -> f64| {
        TrackColumn::F64(points.iter().map(|p| p.as_ref().map(value)).collect())
    };
    let of = |estimate: &Positions| -> Vec<Option<Geodetic>> {
        let shown = |row| estimate.shown(rows, row).then(|| point(frame, input, rows, estimate, row));
        (0..rows.t.len()).map(shown).collect()
    };
    let mut columns = vec![];
    for estimate in estimates.iter().filter(|e| !e.name.starts_with(PAPER)) {
        let (prefix, points) = (estimate.name.replace('-', "_"), of(estimate));
        if columns.is_empty() {
            columns.push(("height_m".to_owned(), column(&points, |p| p.height)));
        }
        columns.push((format!("{prefix}_latitude_deg"), column(&points, |p| p.latitude.to_degrees())));
        columns.push((format!("{prefix}_longitude_deg"), column(&points, |p| p.longitude.to_degrees())));
    }
    columns
}

/// The compensated point of a row at the height of its fix: only the horizontal position is compensated.
fn point(frame: &LocalFrame, input: &Input, rows: &Rows, exact: &Positions, row: usize) -> Geodetic {
    let fix = rows.fix[row];
    frame.to_geodetic([exact.axes[0][row], exact.axes[1][row], input.down[fix]])
}
