//! The azimuths of the swings, and further ones that would help.

use super::MagneticSwing;
use crate::kinematics::wrapped;
use std::f64::consts::TAU;

/// Azimuths closer than this count as one (10°).
const DISTINCT_RAD: f64 = 0.175;
/// Minimum number of azimuths for a full fit.
pub(super) const FULL: usize = 3;

/// The azimuths of the swings, no two of them within ten degrees.
fn kept(swings: &[MagneticSwing]) -> Vec<f64> {
    let mut kept: Vec<f64> = vec![];
    for azimuth in swings.iter().map(|s| s.azimuth.value) {
        if kept.iter().all(|k| differ(azimuth, *k)) {
            kept.push(azimuth);
        }
    }
    kept
}

/// Whether two azimuths are distinct.
pub(super) fn differ(a: f64, b: f64) -> bool {
    wrapped(a - b).abs() > DISTINCT_RAD
}

/// Number of azimuths that differ by more than ten degrees.
pub(super) fn distinct(swings: &[MagneticSwing]) -> usize {
    kept(swings).len()
}

/// What the swings lack for a full fit: the number of azimuths, the arc they span, and which would help.
pub(super) fn lacking(swings: &[MagneticSwing]) -> String {
    let kept = kept(swings);
    let have = match kept.len() {
        1 if swings.len() == 1 => format!("the only swing is at an azimuth of {}", degrees(kept[0])),
        1 => format!("all swings are at one azimuth, {}", degrees(kept.first().copied().unwrap_or(0.0))),
        n => format!(
            "the swings are at {n} azimuths within {:.0}°",
            TAU.to_degrees() - largest_gap(&kept).1.to_degrees()
        ),
    };
    let more: Vec<String> = further(&kept).into_iter().map(degrees).collect();
    format!("{have}; swing at {} more, such as {}", more.len(), more.join(" and "))
}

/// `30°`, from 0 to 359.
pub(super) fn degrees(azimuth: f64) -> String {
    format!("{:.0}°", azimuth.to_degrees().round().rem_euclid(360.0))
}

/// Azimuths to add: a third of a turn to both sides of a single one, otherwise the middles of the largest gaps until
/// there are enough, at least one.
fn further(kept: &[f64]) -> Vec<f64> {
    if let [only] = kept {
        return vec![only + TAU / 3.0, only - TAU / 3.0];
    }
    let mut all = kept.to_vec();
    while all.len() < FULL.max(kept.len() + 1) {
        let (from, width) = largest_gap(&all);
        all.push(from + 0.5 * width);
    }
    all.split_off(kept.len())
}

/// Start and width of the largest arc without an azimuth, rad.
fn largest_gap(azimuths: &[f64]) -> (f64, f64) {
    let mut sorted: Vec<f64> = azimuths.iter().map(|a| a.rem_euclid(TAU)).collect();
    sorted.sort_unstable_by(f64::total_cmp);
    let next = sorted.iter().skip(1).copied().chain(sorted.first().map(|first| first + TAU));
    let gaps = sorted.iter().copied().zip(next).map(|(from, to)| (from, to - from));
    gaps.max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0.0, TAU))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn further_deg(azimuths_deg: &[f64]) -> Vec<f64> {
        let azimuths: Vec<f64> = azimuths_deg.iter().map(|a| a.to_radians()).collect();
        further(&azimuths).into_iter().map(|a| a.to_degrees().rem_euclid(360.0).round()).collect()
    }

    #[test]
    fn the_next_azimuths_lie_in_the_largest_gaps() {
        assert_eq!(further_deg(&[30.0]), [150.0, 270.0]);
        assert_eq!(further_deg(&[350.0, 20.0]), [185.0]);
        assert_eq!(further_deg(&[0.0, 20.0, 40.0]), [200.0]);
    }
}
