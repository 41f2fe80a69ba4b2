//! Lead of the compensated position, and of the reference, over raw along the track.

use super::BINS;
use crate::estimate::{EXACT_ASYNC, Positions};
use crate::input::Input;
use crate::rows::{Rows, median_step};
use crate::score::Reference;
use delay_from_flight::AXES;
use record::{Curve, Lead, LeadCurves, LeadTrack};
use std::ops::Range;

/// Below this ground speed a lead is not converted to time, m/s,
const LEAST_SPEED_MPS: f64 = 2.0;
/// nor below this fraction of the 95th percentile of the speed.
const LEAST_SHARE: f64 = 0.25;

/// A ground track is drawn to this fraction of its extent, about half a pixel of a page.
const PATH_RESOLUTION: f64 = 1500.0;
/// The colour of a track changes by steps of this share of the largest lead.
const COLOUR_STEP: f64 = 0.05;
/// Maximum number of points of a track; if there are more, it is drawn coarser by these factors in turn.
const MOST_OF_TRACK: usize = 8000;
const COARSER: [f64; 5] = [2.0, 4.0, 8.0, 16.0, 32.0];

/// `None` if the exact form has no output.
pub(super) fn lead(input: &Input, rows: &Rows, estimates: &[&Positions]) -> Option<LeadCurves> {
    let raw = estimates.first()?;
    let exact = estimates.iter().find(|e| e.name == EXACT_ASYNC)?;
    let fresh = || (0..rows.t.len()).filter(|&row| rows.has_new_fix(row));
    let gap_s = gap(&fresh().map(|row| rows.t[row]).collect::<Vec<_>>())?;
    // The distance flown since the fix is not a lead.
    let ahead = |row: usize, of: [f64; 2]| {
        let displacement = along(rows, row, [of[0] - raw.axes[0][row], of[1] - raw.axes[1][row]])?;
        Some(displacement - speed(rows, row) * rows.age_s(input, row))
    };
    let given = fresh().filter(|&row| exact.shown(rows, row));
    let compensated: Points =
        given.filter_map(|row| Some((row, ahead(row, AXES.map(|k| exact.axes[k][row]))?))).collect();
    if compensated.m.len() < 2 {
        return None;
    }
    let least_speed_mps = least_speed(rows);
    let mut lead = LeadCurves {
        of: vec![of(&exact.title, rows, &compensated, least_speed_mps, gap_s)],
        least_speed_mps,
        track: track(rows, exact, &compensated, gap_s),
    };
    drop(compensated);
    if let Some(reference) = &input.reference {
        let truth = Reference::at(reference, rows, fresh());
        let truth = truth.row.iter().zip(truth.axes[0].iter().zip(&truth.axes[1]));
        let truth: Points = truth.filter_map(|(&r, (n, e))| Some((r, ahead(r, [*n, *e])?))).collect();
        if !truth.m.is_empty() {
            lead.of.push(of("reference", rows, &truth, least_speed_mps, gap_s));
        }
    }
    Some(lead)
}

/// Leads at some rows. A long flight has half a million.
#[derive(Default)]
struct Points {
    row: Vec<u32>,
    /// Metres, or milliseconds of flight.
    m: Vec<f64>,
}

impl FromIterator<(usize, f64)> for Points {
    fn from_iter<I: IntoIterator<Item = (usize, f64)>>(points: I) -> Points {
        let mut out = Points::default();
        for (row, m) in points {
            out.row.push(row as u32);
            out.m.push(m);
        }
        out
    }
}

impl Points {
    fn rows(&self) -> impl Iterator<Item = usize> {
        self.row.iter().map(|row| *row as usize)
    }

    fn time_s(&self, rows: &Rows, point: usize) -> f64 {
        rows.t[self.row[point] as usize]
    }
}

fn of(name: &str, rows: &Rows, points: &Points, least_speed_mps: f64, gap_s: f64) -> Lead {
    let is_time = |(row, _): &(usize, f64)| speed(rows, *row) >= least_speed_mps;
    let all = points.rows().zip(points.m.iter().copied());
    let in_ms: Points = all.filter(is_time).map(|(row, m)| (row, 1e3 * m / speed(rows, row))).collect();
    Lead {
        median_m: signal::percentile(&points.m, 0.5).unwrap_or_default(),
        over_time_m: curve(name, rows, points, gap_s),
        over_time_ms: curve(name, rows, &in_ms, gap_s),
    }
}

fn speed(rows: &Rows, row: usize) -> f64 {
    rows.velocity[0][row].hypot(rows.velocity[1][row])
}

fn least_speed(rows: &Rows) -> f64 {
    let speeds: Vec<f64> = (0..rows.t.len()).map(|row| speed(rows, row)).collect();
    let fast = signal::percentile(&speeds, 0.95).unwrap_or_default();
    LEAST_SPEED_MPS.max(LEAST_SHARE * fast)
}

/// A longer step between fixes is a gap, s; `None` with fewer than three fixes.
fn gap(times: &[f64]) -> Option<f64> {
    (times.len() > 2).then(|| 2.5 * median_step(times))
}

/// Component of a displacement along the velocity of a row, m; `None` at standstill.
fn along(rows: &Rows, row: usize, displacement: [f64; 2]) -> Option<f64> {
    let velocity = AXES.map(|k| rows.velocity[k][row]);
    let speed = velocity[0].hypot(velocity[1]);
    (speed > 0.1).then(|| (displacement[0] * velocity[0] + displacement[1] * velocity[1]) / speed)
}

/// Ranges of points without a gap between them.
fn strokes(rows: &Rows, points: &Points, gap_s: f64) -> Vec<Range<usize>> {
    let mut out: Vec<Range<usize>> = vec![];
    for i in 0..points.m.len() {
        match out.last_mut() {
            Some(stroke) if points.time_s(rows, i) - points.time_s(rows, i - 1) <= gap_s => stroke.end = i + 1,
            _ => out.push(i..i + 1),
        }
    }
    out
}

fn curve(name: &str, rows: &Rows, points: &Points, gap_s: f64) -> Curve {
    let mut out = Curve { name: name.to_owned(), t_s: vec![], y: vec![], breaks: vec![], stands_for: 0 };
    let strokes = strokes(rows, points, gap_s);
    // About the same total number of points for any number of strokes.
    let bins = (BINS / strokes.len().max(1)).max(4);
    for stroke in strokes {
        let t: Vec<f64> = stroke.clone().map(|point| points.time_s(rows, point)).collect();
        let y = &points.m[stroke];
        let kept = signal::min_max(&t, y, bins);
        if !out.t_s.is_empty() {
            out.breaks.push(out.t_s.len() as u32);
        }
        out.t_s.extend(kept.rows.iter().map(|&r| t[r]));
        out.y.extend(kept.rows.iter().map(|&r| y[r]));
        out.stands_for += kept.stands_for as u64;
    }
    out
}

/// The compensated track at its fixes, thinned where neither path nor colour bends, and limited in points.
fn track(rows: &Rows, exact: &Positions, points: &Points, gap_s: f64) -> LeadTrack {
    let [north, east] = AXES.map(|k| points.rows().map(|row| exact.axes[k][row]).collect::<Vec<f64>>());
    let extent = |y: &[f64]| {
        y.iter().copied().fold(f64::NEG_INFINITY, f64::max) - y.iter().copied().fold(f64::INFINITY, f64::min)
    };
    let tolerance = extent(&north).max(extent(&east)) / PATH_RESOLUTION;
    let colour = COLOUR_STEP * points.m.iter().map(|lead| lead.abs()).fold(0.0, f64::max);
    let strokes = strokes(rows, points, gap_s);
    let thinned = |coarser: f64| thinned(&strokes, [&north, &east], points, (coarser * tolerance, coarser * colour));
    let mut out = thinned(1.0);
    for coarser in COARSER {
        if out.east_m.len() <= MOST_OF_TRACK {
            break;
        }
        out = thinned(coarser);
    }
    out
}

fn thinned(
    strokes: &[Range<usize>],
    [north, east]: [&[f64]; 2],
    points: &Points,
    (tolerance, colour): (f64, f64),
) -> LeadTrack {
    let mut out = LeadTrack::default();
    for stroke in strokes.iter().cloned() {
        let (n, e) = (&north[stroke.clone()], &east[stroke.clone()]);
        let of_way = signal::thin_path(e, n, tolerance);
        if !out.east_m.is_empty() {
            out.breaks.push(out.east_m.len() as u32);
        }
        let (mut last, mut bends) = (f64::INFINITY, of_way.iter().copied().peekable());
        for i in 0..stroke.len() {
            let lead = points.m[stroke.start + i];
            let is_bend = bends.next_if_eq(&i).is_some();
            if is_bend || (lead - last).abs() > colour {
                last = lead;
                out.east_m.push(e[i]);
                out.north_m.push(n[i]);
                out.lead_m.push(lead);
            }
        }
        out.stands_for += stroke.len() as u64;
    }
    out
}

#[cfg(test)]
mod tests {
    use crate::{Settings, replay};
    use flight::Delay;
    use simulate::{FlightSettings, SensorSettings, simulate};

    /// A flight with a position 0.3 s late, from which 0.4 s are removed.
    fn played() -> record::LeadCurves {
        let settings = FlightSettings {
            duration_s: 90.0,
            position: SensorSettings { delay_s: 0.3, white_std: 0.0, ..SensorSettings::clean(5.0) },
            velocity: SensorSettings { white_std: 0.0, ..SensorSettings::clean(100.0) },
            ..FlightSettings::default()
        };
        let flight = simulate(&settings).unwrap().to_flight().unwrap();
        let settings = Settings::with_delay(Delay::from_seconds(0.4).unwrap(), "test");
        replay(&flight, &settings).unwrap().record.lead.unwrap()
    }

    #[test]
    fn the_reference_leads_by_the_lateness_and_the_output_by_the_removed_delay() {
        let lead = played();
        let names: Vec<&str> = lead.of.iter().map(|of| of.over_time_m.name.as_str()).collect();
        assert_eq!(names[1..], ["reference"]);
        for (of, want_ms) in lead.of.iter().zip([400.0, 300.0]) {
            // A chord of a turn is shorter than its arc.
            let median_ms = signal::percentile(&of.over_time_ms.y, 0.5).unwrap();
            assert!((median_ms - want_ms).abs() < 8.0, "{median_ms} ms, not {want_ms}");
        }
    }

    #[test]
    fn the_track_carries_its_lead_and_covers_every_fix() {
        let lead = played();
        let track = &lead.track;
        assert!(track.east_m.len() > 10 && track.east_m.len() < track.stands_for as usize);
        assert_eq!((track.east_m.len(), track.north_m.len()), (track.lead_m.len(), track.lead_m.len()));
        let most = |values: &[f64]| values.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
        let of_curve = most(&lead.of[0].over_time_m.y);
        assert!((most(&track.lead_m) - of_curve).abs() <= 0.06 * of_curve);
    }

    #[test]
    fn a_long_track_with_a_noisy_lead_has_few_points() {
        let settings = FlightSettings {
            duration_s: 600.0,
            position: SensorSettings { delay_s: 0.3, white_std: 0.3, ..SensorSettings::clean(50.0) },
            velocity: SensorSettings { white_std: 0.0, ..SensorSettings::clean(50.0) },
            ..FlightSettings::default()
        };
        let flight = simulate(&settings).unwrap().to_flight().unwrap();
        let settings = Settings::with_delay(Delay::from_seconds(0.4).unwrap(), "test");
        let track = replay(&flight, &settings).unwrap().record.lead.unwrap().track;
        assert!(track.stands_for > 25_000, "{}", track.stands_for);
        assert!((100..=super::MOST_OF_TRACK).contains(&track.east_m.len()), "{}", track.east_m.len());
    }
}
