//! A curve in the plane with fewer points and the same shape.

/// Rows of a path such that each skipped row lies within `tolerance` (same unit as the coordinates) of the line through
/// the kept rows around it. First and last are kept. One pass, O(n): from an anchor, the cone of directions that pass
/// all points so far within the tolerance is narrowed until it is empty (Williams 1978); then the last point becomes
/// the anchor.
#[must_use]
pub fn thin_path(x: &[f64], y: &[f64], tolerance: f64) -> Vec<usize> {
    let n = x.len().min(y.len());
    let mut kept = vec![];
    if n == 0 {
        return kept;
    }
    kept.push(0);
    let (mut anchor, mut cone) = (0, None);
    for row in 1..n {
        let (dx, dy) = (x[row] - x[anchor], y[row] - y[anchor]);
        let reach = dx.hypot(dy);
        if reach <= tolerance && cone.is_none() {
            continue;
        }
        match narrowed(cone, dx, dy, tolerance) {
            Some(narrower) => cone = Some(narrower),
            None => {
                anchor = row - 1;
                kept.push(anchor);
                cone = narrowed(None, x[row] - x[anchor], y[row] - y[anchor], tolerance);
            }
        }
    }
    if kept.last() != Some(&(n - 1)) {
        kept.push(n - 1);
    }
    kept
}

/// A cone of directions, and the distance covered along it.
#[derive(Debug, Clone, Copy)]
struct Cone {
    axis: f64,
    low: f64,
    high: f64,
    reach: f64,
}

/// The directions of `cone` that also pass `(dx, dy)` within the tolerance; `None` if there are none or the path turns
/// back.
fn narrowed(cone: Option<Cone>, dx: f64, dy: f64, tolerance: f64) -> Option<Cone> {
    use std::f64::consts::{FRAC_PI_2, PI, TAU};
    let reach = dx.hypot(dy);
    let half = if reach <= tolerance { FRAC_PI_2 } else { (tolerance / reach).asin() };
    let Some(c) = cone else {
        return Some(Cone { axis: dy.atan2(dx), low: -half, high: half, reach });
    };
    let turn = (dy.atan2(dx) - c.axis + PI).rem_euclid(TAU) - PI;
    let (low, high) = (c.low.max(turn - half), c.high.min(turn + half));
    let inside = turn >= c.low && turn <= c.high;
    (inside && low <= high && reach >= c.reach - tolerance).then_some(Cone {
        low,
        high,
        reach: reach.max(c.reach),
        ..c
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn distance_to_line(p: (f64, f64), a: (f64, f64), b: (f64, f64)) -> f64 {
        let (dx, dy) = (b.0 - a.0, b.1 - a.1);
        let length2 = dx * dx + dy * dy;
        let s = if length2 == 0.0 { 0.0 } else { (((p.0 - a.0) * dx + (p.1 - a.1) * dy) / length2).clamp(0.0, 1.0) };
        (p.0 - a.0 - s * dx).hypot(p.1 - a.1 - s * dy)
    }

    fn worst(x: &[f64], y: &[f64], kept: &[usize]) -> f64 {
        kept.windows(2)
            .flat_map(|w| (w[0]..=w[1]).map(move |i| (i, w[0], w[1])))
            .map(|(i, a, b)| distance_to_line((x[i], y[i]), (x[a], y[a]), (x[b], y[b])))
            .fold(0.0, f64::max)
    }

    #[test]
    fn a_circle_flown_five_hundred_times_keeps_its_shape_with_few_points() {
        let t: Vec<f64> = (0..540_000).map(|k| f64::from(k) * 0.01).collect();
        let x: Vec<f64> = t.iter().map(|t| 30.0 * (0.58 * t).sin() + 0.05 * t).collect();
        let y: Vec<f64> = t.iter().map(|t| 30.0 * (0.58 * t).cos()).collect();
        let kept = thin_path(&x, &y, 0.4);
        assert!(worst(&x, &y, &kept) <= 0.8, "{}", worst(&x, &y, &kept));
        // 500 circles; a chord of sagitta 0.4 m spans 0.33 rad: at best 19 per circle.
        assert!(kept.len() < 500 * 30, "{}", kept.len());
    }

    #[test]
    fn corners_spikes_and_ends_stay() {
        let x = [0.0, 1.0, 2.0, 3.0, 3.0, 3.0, 2.9, 50.0, 2.9, 2.0];
        let y = [0.0, 0.0, 0.0, 0.0, 1.0, 2.0, 2.0, 2.0, 2.0, 2.0];
        let kept = thin_path(&x, &y, 0.01);
        assert!([0, 3, 5, 6, 7, 9].iter().all(|row| kept.contains(row)) && kept.len() < 10, "{kept:?}");
    }

    #[test]
    fn a_stationary_path_is_two_points() {
        assert_eq!(thin_path(&[1.0; 1000], &[2.0; 1000], 0.1), [0, 999]);
        assert_eq!(thin_path(&[], &[], 0.1), [0_usize; 0]);
        assert_eq!(thin_path(&[1.0], &[1.0], 0.1), [0]);
    }
}
