//! Converts attitudes of any frame to the quaternion that rotates forward, right, down to north, east, down.

use crate::map::AttitudeFrame;
use std::f64::consts::FRAC_1_SQRT_2;

/// A squared length this near one counts as one: dividing by it would only perturb the last bits.
const UNIT: f64 = 1e-14;

/// w, x, y, z from a quaternion w, x, y, z of any length in `frame`; `None` if it is zero or not finite.
pub(super) fn from_quaternion(frame: AttitudeFrame, q: [f64; 4]) -> Option<[f64; 4]> {
    let square: f64 = q.iter().map(|v| v * v).sum();
    if (square - 1.0).abs() <= UNIT {
        return Some(to_ned(frame, q));
    }
    let norm = Some(square.sqrt()).filter(|n| *n > 0.0 && n.is_finite())?;
    Some(to_ned(frame, q.map(|v| v / norm)))
}

/// The quaternion w, x, y, z, forward, right, down to north, east, down, of roll, pitch, yaw in rad: Rz(yaw) Ry(pitch)
/// Rx(roll) in `frame`.
pub fn from_euler(frame: AttitudeFrame, angles: [f64; 3]) -> [f64; 4] {
    let [(sr, cr), (sp, cp), (sy, cy)] = angles.map(|angle| (angle / 2.0).sin_cos());
    let q = [
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    ];
    to_ned(frame, q)
}

/// `q(world → NED) q q(FRD → body)`. Half a turn about x converts forward, left, up and north, west, up; half a turn
/// about north-east converts east, north, up to north, east, down.
fn to_ned(frame: AttitudeFrame, [w, x, y, z]: [f64; 4]) -> [f64; 4] {
    match frame {
        AttitudeFrame::FrdNed => [w, x, y, z],
        AttitudeFrame::FluNwu => [w, x, -y, -z],
        AttitudeFrame::FluNed => [-x, w, z, -y],
        AttitudeFrame::FluEnu => [w + z, x + y, x - y, w - z].map(|v| v * FRAC_1_SQRT_2),
    }
}

/// `v` rotated by a quaternion x, y, z, w of any length; `None` if that is zero or not finite.
pub(super) fn rotate([x, y, z, w]: [f64; 4], v: [f64; 3]) -> Option<[f64; 3]> {
    let norm = Some((x * x + y * y + z * z + w * w).sqrt()).filter(|n| *n > 0.0 && n.is_finite())?;
    let [x, y, z, w] = [x / norm, y / norm, z / norm, w / norm];
    let [x1, y1, z1] = cross([x, y, z], v);
    let [x2, y2, z2] = cross([x, y, z], [x1, y1, z1]);
    let [vx, vy, vz] = v;
    Some([vx + 2.0 * (w * x1 + x2), vy + 2.0 * (w * y1 + y2), vz + 2.0 * (w * z1 + z2)])
}

fn cross([ax, ay, az]: [f64; 3], [bx, by, bz]: [f64; 3]) -> [f64; 3] {
    [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// North, east, down of a vector given in forward, right, down.
    fn turned([w, x, y, z]: [f64; 4], v: [f64; 3]) -> [f64; 3] {
        rotate([x, y, z, w], v).unwrap()
    }

    fn assert_near(a: &[f64], b: &[f64]) {
        assert!(a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-15), "{a:?} {b:?}");
    }

    #[test]
    fn the_identity_attitude_points_along_the_first_axis_of_its_frame() {
        let level = [1.0, 0.0, 0.0, 0.0];
        let forward = |frame| turned(from_quaternion(frame, level).unwrap(), [1.0, 0.0, 0.0]);
        let down = |frame| turned(from_quaternion(frame, level).unwrap(), [0.0, 0.0, 1.0]);
        assert_near(&forward(AttitudeFrame::FrdNed), &[1.0, 0.0, 0.0]);
        assert_near(&forward(AttitudeFrame::FluNwu), &[1.0, 0.0, 0.0]);
        assert_near(&forward(AttitudeFrame::FluEnu), &[0.0, 1.0, 0.0]);
        for frame in [AttitudeFrame::FrdNed, AttitudeFrame::FluNwu, AttitudeFrame::FluEnu] {
            assert_near(&down(frame), &[0.0, 0.0, 1.0]);
        }
        // Forward, left, up along north, east, down: on its back.
        assert_near(&forward(AttitudeFrame::FluNed), &[1.0, 0.0, 0.0]);
        assert_near(&down(AttitudeFrame::FluNed), &[0.0, 0.0, -1.0]);
    }

    #[test]
    fn any_attitude_rotates_any_vector_as_in_its_source_frame() {
        let q = [0.5, -0.3, 0.7, 0.2];
        let v = [0.2, -1.1, 0.6];
        for (frame, to_ned) in [
            (AttitudeFrame::FluNwu, (|[n, w, u]: [f64; 3]| [n, -w, -u]) as fn([f64; 3]) -> [f64; 3]),
            (AttitudeFrame::FluEnu, |[e, n, u]| [n, e, -u]),
        ] {
            // Forward, left, up of the same vector, rotated by the source's own quaternion.
            let source = rotate([q[1], q[2], q[3], q[0]], [v[0], -v[1], -v[2]]).unwrap();
            assert_near(&turned(from_quaternion(frame, q).unwrap(), v), &to_ned(source));
        }
    }

    #[test]
    fn euler_angles_rotate_by_yaw_then_pitch_then_roll() {
        let (roll, pitch, yaw) = (0.3_f64, -0.4_f64, 2.0_f64);
        let about = |axis: usize, angle: f64| {
            let mut q = [(angle / 2.0).cos(), 0.0, 0.0, 0.0];
            q[axis] = (angle / 2.0).sin();
            q
        };
        let v = [0.2, -1.1, 0.6];
        let by_steps = turned(about(3, yaw), turned(about(2, pitch), turned(about(1, roll), v)));
        assert_near(&turned(from_euler(AttitudeFrame::FrdNed, [roll, pitch, yaw]), v), &by_steps);
        // Nose up is a negative pitch where y points left.
        let nose = turned(from_euler(AttitudeFrame::FluNwu, [0.0, -0.4, 0.0]), [1.0, 0.0, 0.0]);
        assert_near(&nose, &[0.4_f64.cos(), 0.0, -(0.4_f64.sin())]);
    }

    #[test]
    fn quaternions_are_normalized_and_unit_quaternions_keep_their_bits() {
        let q = from_quaternion(AttitudeFrame::FrdNed, [2.0, 0.0, 0.0, -2.0]).unwrap();
        assert_near(&q, &[FRAC_1_SQRT_2, 0.0, 0.0, -FRAC_1_SQRT_2]);
        let unit = [0.1, 0.7, -0.5, 0.5];
        assert_eq!(from_quaternion(AttitudeFrame::FrdNed, unit), Some(unit));
        for nothing in [[0.0; 4], [1e-200, 0.0, 0.0, 0.0], [f64::MAX; 4]] {
            assert_eq!(from_quaternion(AttitudeFrame::FluEnu, nothing), None);
        }
    }
}
