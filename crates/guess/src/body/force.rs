//! Specific forces: infers the unit from a magnitude near 1 g, and the axes from the direction of gravity.

use super::body_attitude::Rotation;
use super::{Body, TimedTriple, unit};
use crate::windows::Trace;
use flight::Unit;

/// What an accelerometer at rest measures, m/s^2.
const GRAVITY: f64 = 9.806_65;
/// The range of the median magnitude in flight, g.
const PLAUSIBLE: std::ops::Range<f64> = 0.7..1.4;
/// The same in a stated unit: more than half of an aerobatic flight may be turns of 2 g. Without a stated unit, forces
/// without gravity would be taken for g.
const PLAUSIBLE_AS_STATED: std::ops::Range<f64> = 0.7..2.3;
/// An attitude farther away is not that of the row, s.
const HOLE_S: f64 = 1.0;
/// Agreement of z with gravity that decides.
const LEAST: f64 = 0.6;
/// Less gravity along x is not evaluated, g.
const LEAST_TILT: f64 = 0.03;
/// Fewer rows are not evaluated.
const FEWEST: usize = 20;

/// The unit and the frame of three forces.
pub(super) fn decide(of: &TimedTriple<'_>, rotation: Option<&Rotation>) -> Result<Body, String> {
    let (unit, g) = unit_by_gravity(of)?;
    let magnitude = format!("the median of their magnitude is {g:.2} g if they are in {unit}");
    let trace = of.trace(unit);
    let (frame, why) = match rotation.map(|rotation| by_attitude(&trace, rotation)) {
        Some(Some(found)) => found?,
        Some(None) | None => by_mean(&trace, &of.group.columns[2].path)?,
    };
    let (group, why) = (of.group.clone(), vec![magnitude, why]);
    Ok(Body { group, quantity: "specific-force", roles: ["x", "y", "z"], unit, frame, why })
}

/// The unit in which the median magnitude is near 1 g, and that median in g.
fn unit_by_gravity(of: &TimedTriple<'_>) -> Result<(Unit, f64), String> {
    let si = unit("m/s^2")?;
    let mut magnitudes: Vec<f64> =
        of.trace(si).values.iter().map(|v| v.iter().map(|v| v * v).sum::<f64>().sqrt() / si.to_si(1.0)).collect();
    magnitudes.sort_by(f64::total_cmp);
    let median = magnitudes.get(magnitudes.len() / 2).copied().ok_or("no row has all three")?;
    let in_g = |unit: Unit| unit.to_si(median) / GRAVITY;
    if let Some(stated) = of.stated()? {
        return match in_g(stated) {
            g if PLAUSIBLE_AS_STATED.contains(&g) => Ok((stated, g)),
            g => Err(format!(
                "the median of their magnitude is {g:.2} g if they are in {stated} as stated, which is impossible \
                 for an accelerometer in flight"
            )),
        };
    }
    let tried = [si, unit("g0")?, unit("mg0")?];
    let fits = tried.into_iter().find(|unit| PLAUSIBLE.contains(&in_g(*unit)));
    fits.map(|unit| (unit, in_g(unit))).ok_or_else(|| {
        format!(
            "the median of their magnitude is {median:.3}, which is not near 1 g in any unit: gravity may have \
            been removed"
        )
    })
}

/// Infers the axes from what gravity alone would give in the attitude of each row; `None` if too few rows have one. A
/// coordinated turn has nothing along y, whatever gravity does there: x and z decide.
fn by_attitude(forces: &Trace<3>, rotation: &Rotation) -> Option<Result<(&'static str, String), String>> {
    let pairs = forces.times_s.iter().zip(&forces.values).filter_map(|(t, force)| {
        let [w, x, y, z] = rotation.quaternions.at(*t, HOLE_S)?;
        // Against gravity, along forward and down.
        let up = [2.0 * (x * z - w * y), 1.0 - 2.0 * (x * x + y * y)].map(|v| -GRAVITY * v);
        Some(([force[0], force[2]], up))
    });
    let pairs: Vec<([f64; 2], [f64; 2])> = pairs.collect();
    (pairs.len() >= FEWEST).then(|| {
        let path = &rotation.path;
        let (forward, tilt) = agreement(&pairs, 0);
        let (down, _) = agreement(&pairs, 1);
        if down.abs() < LEAST {
            return Err(format!("z does not follow gravity in the attitude of {path} (agreement {down:.2})"));
        }
        let frame = if down > 0.0 { "frd" } else { "flu" };
        let side = if down > 0.0 { "down" } else { "up" };
        match forward {
            _ if tilt < LEAST_TILT || forward.abs() < 0.5 => Ok((
                frame,
                format!(
                    "z points {side}, as gravity in the attitude of {path} shows; x and y are assumed from their \
                    names"
                ),
            )),
            along if along > 0.0 => Ok((
                frame,
                format!(
                    "x forward and z {side} follow gravity in the attitude of {path} to {along:.2} and {:.2}",
                    down.abs()
                ),
            )),
            _ if down < 0.0 => Err("they are positive along gravity; an accelerometer measures against it".to_owned()),
            _ => Err("x points backward and z down; channel maps have no frame for this".to_owned()),
        }
    })
}

/// How an axis follows gravity, 1 if it does and -1 if it points the other way, and how much gravity it sees, in g.
fn agreement(pairs: &[([f64; 2], [f64; 2])], axis: usize) -> (f64, f64) {
    let [mut cross, mut measured, mut expected] = [0.0; 3];
    for (force, up) in pairs {
        let (force, up) = (force.get(axis).copied().unwrap_or_default(), up.get(axis).copied().unwrap_or_default());
        cross += force * up;
        measured += force * force;
        expected += up * up;
    }
    let rms = (expected / pairs.len().max(1) as f64).sqrt() / GRAVITY;
    (cross / (measured * expected).sqrt().max(f64::MIN_POSITIVE), rms)
}

/// Infers the axes from the mean along z, for a vehicle that is mostly level.
fn by_mean(forces: &Trace<3>, z: &str) -> Result<(&'static str, String), String> {
    let count = forces.values.len().max(1) as f64;
    let mean = forces.values.iter().map(|v| v[2]).sum::<f64>() / count / GRAVITY;
    match mean {
        m if m < -0.7 => {
            Ok(("frd", format!("{z} is {m:.2} g on average, so z points down; x and y are assumed from their names")))
        }
        m if m > 0.7 => Ok((
            "flu",
            format!(
                "{z} is {m:.2} g on average, so z points up; x forward and y left are assumed from \
                their names"
            ),
        )),
        m => Err(format!("{z} is {m:.2} g on average, and there is no attitude: it is unknown where the axes point")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Up is 2 g along the second axis in one of four rows, so 1 g rms; the force is its half, or half of its opposite.
    #[test]
    fn an_axis_follows_gravity_or_points_the_other_way() {
        let pairs = |sign: f64| [0.0, 2.0 * GRAVITY, 0.0, 0.0].map(|up| ([7.0, sign * 0.5 * up], [0.0, up]));
        let near = |a: (f64, f64), b: (f64, f64)| (a.0 - b.0).abs() < 1e-12 && (a.1 - b.1).abs() < 1e-12;
        assert!(near(agreement(&pairs(1.0), 1), (1.0, 1.0)));
        assert!(near(agreement(&pairs(-1.0), 1), (-1.0, 1.0)));
        assert!(near(agreement(&pairs(1.0), 0), (0.0, 0.0)), "it sees no gravity");
        assert!(near(agreement(&[], 0), (0.0, 0.0)));
    }
}
