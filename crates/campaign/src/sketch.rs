//! A small ground track of a flight, for the row of a table.

use record::LeadTrack;
use signal::thin_path;
use std::fmt::Write;

/// Maximum points of a sketch: enough for a picture of 160 by 60 pixels, in a page of a thousand rows.
const MOST: usize = 32;
/// The first tolerance is the track's extent divided by this, less than a pixel.
const FINEST: f64 = 200.0;

/// `east,north` of the points needed for the shape, m, separated by spaces and by `;` at gaps; `None` without a track.
pub(crate) fn sketch(track: &LeadTrack) -> Option<String> {
    let points: Vec<(f64, f64)> = track.east_m.iter().copied().zip(track.north_m.iter().copied()).collect();
    let points = points.into_iter().filter(|(e, n)| e.is_finite() && n.is_finite());
    let pieces = pieces(&points.collect::<Vec<_>>(), &track.breaks);
    let extent = extent(&pieces).filter(|extent| *extent > 0.0)?;
    let mut tolerance = extent / FINEST;
    let mut thin: Vec<Vec<(f64, f64)>> = thinned(&pieces, tolerance);
    while thin.iter().map(Vec::len).sum::<usize>() > MOST && tolerance < extent {
        tolerance *= 1.25;
        thin = thinned(&pieces, tolerance);
    }
    // Many short pieces may still have too many points.
    let step = thin.len().div_ceil(MOST / 2).max(1);
    let decimals = (-(extent / 500.0).log10().floor()).clamp(0.0, 3.0) as usize;
    let mut text = String::new();
    for piece in thin.iter().step_by(step) {
        text.push_str(if text.is_empty() { "" } else { ";" });
        for (i, (e, n)) in piece.iter().enumerate() {
            let _ = write!(text, "{}{e:.decimals$},{n:.decimals$}", if i > 0 { " " } else { "" });
        }
    }
    Some(text)
}

/// Splits the points at the breaks, given as the row after each break.
fn pieces(points: &[(f64, f64)], breaks: &[u32]) -> Vec<Vec<(f64, f64)>> {
    let mut ends: Vec<usize> = breaks.iter().map(|&row| (row as usize).min(points.len())).collect();
    ends.push(points.len());
    ends.sort_unstable();
    let mut from = 0;
    let mut piece = |to: usize| points[std::mem::replace(&mut from, to)..to].to_vec();
    ends.into_iter().map(&mut piece).filter(|piece| !piece.is_empty()).collect()
}

/// The longer side of the bounding box.
fn extent(pieces: &[Vec<(f64, f64)>]) -> Option<f64> {
    let span = |of: fn(&(f64, f64)) -> f64| {
        let all = || pieces.iter().flatten().map(of);
        Some(all().reduce(f64::max)? - all().reduce(f64::min)?)
    };
    Some(span(|p| p.0)?.max(span(|p| p.1)?))
}

fn thinned(pieces: &[Vec<(f64, f64)>], tolerance: f64) -> Vec<Vec<(f64, f64)>> {
    let thin = |piece: &Vec<(f64, f64)>| {
        let (e, n): (Vec<f64>, Vec<f64>) = piece.iter().copied().unzip();
        thin_path(&e, &n, tolerance).into_iter().map(|row| piece[row]).collect()
    };
    pieces.iter().map(thin).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn circuits(turns: f64, breaks: Vec<u32>) -> LeadTrack {
        let at = |i: usize| std::f64::consts::TAU * turns * i as f64 / 2000.0;
        LeadTrack {
            east_m: (0..=2000).map(|i| 300.0 * at(i).sin() + i as f64 / 10.0).collect(),
            north_m: (0..=2000).map(|i| 80.0 * at(i).cos()).collect(),
            lead_m: vec![1.0; 2001],
            breaks,
            stands_for: 2001,
        }
    }

    fn read(text: &str) -> Vec<Vec<(f64, f64)>> {
        let point = |p: &str| p.split_once(',').map(|(e, n)| (e.parse().unwrap(), n.parse().unwrap())).unwrap();
        text.split(';').map(|piece| piece.split(' ').map(point).collect()).collect()
    }

    /// Distance of a point from the segment between two others.
    fn distance((e, n): (f64, f64), a: (f64, f64), b: (f64, f64)) -> f64 {
        let (be, bn) = (b.0 - a.0, b.1 - a.1);
        let share = (((e - a.0) * be + (n - a.1) * bn) / be.hypot(bn).powi(2).max(1e-12)).clamp(0.0, 1.0);
        (e - a.0 - share * be).hypot(n - a.1 - share * bn)
    }

    #[test]
    fn every_fix_is_near_a_sketch_of_few_points() {
        let track = circuits(1.0, vec![]);
        let thin = read(&sketch(&track).unwrap());
        assert!(thin.len() == 1 && (8..=MOST).contains(&thin[0].len()), "{}", thin[0].len());
        for (&e, &n) in track.east_m.iter().zip(&track.north_m) {
            let nearest = thin[0].windows(2).map(|w| distance((e, n), w[0], w[1])).fold(f64::INFINITY, f64::min);
            // One hundredth of 600 m: 1.5 pixels of the picture.
            assert!(nearest < 6.0, "{nearest} m from the sketch");
        }
    }

    #[test]
    fn a_long_flight_has_no_more_points_and_keeps_its_gap() {
        let thin = read(&sketch(&circuits(40.0, vec![1000])).unwrap());
        assert_eq!(thin.len(), 2);
        assert!(thin.iter().map(Vec::len).sum::<usize>() <= MOST);
        assert!(read(&sketch(&circuits(9.0, (1..2000).step_by(2).collect())).unwrap()).len() <= MOST);
    }

    #[test]
    fn without_a_track_there_is_no_sketch() {
        assert_eq!(sketch(&LeadTrack::default()), None);
        let still =
            LeadTrack { east_m: vec![2.0; 3], north_m: vec![1.0; 3], lead_m: vec![0.0; 3], ..LeadTrack::default() };
        assert_eq!(sketch(&still), None);
        let lost = LeadTrack { east_m: vec![f64::NAN; 3], ..still };
        assert_eq!(sketch(&lost), None);
    }
}
