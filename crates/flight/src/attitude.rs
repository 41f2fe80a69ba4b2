//! Rotation between two attitudes.

/// Rotation vector from the attitude `a` to `b` about forward, right and down of `a`, rad: 2 ln(a⁻¹ b), on the short way.
/// Both are unit quaternions w, x, y, z from body axes to north, east and down, as in a channel of attitudes.
#[must_use]
pub fn rotation_vector([aw, ax, ay, az]: [f64; 4], [bw, bx, by, bz]: [f64; 4]) -> [f64; 3] {
    let w = aw * bw + ax * bx + ay * by + az * bz;
    let v = [
        aw * bx - ax * bw - ay * bz + az * by,
        aw * by - ay * bw - az * bx + ax * bz,
        aw * bz - az * bw - ax * by + ay * bx,
    ];
    let sine = v.iter().map(|x| x * x).sum::<f64>().sqrt();
    let half = sine.atan2(w.abs());
    let factor = if sine > 0.0 { 2.0 * half / sine } else { 2.0 };
    v.map(|x| x * factor * w.signum())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turn_to_the_right_is_about_down_whatever_the_sign_of_the_quaternion() {
        let yaw = |rad: f64| [(0.5 * rad).cos(), 0.0, 0.0, (0.5 * rad).sin()];
        for sign in [1.0, -1.0] {
            let [x, y, z] = rotation_vector(yaw(0.4), yaw(1.1).map(|q| sign * q));
            assert!(x.abs() < 1e-15 && y.abs() < 1e-15 && (z - 0.7).abs() < 1e-14, "{x} {y} {z}");
        }
        assert_eq!(rotation_vector(yaw(0.4), yaw(0.4)).map(|x| x.abs() < 1e-15), [true; 3]);
    }
}
