//! Readings of an ideal sensor on the bar from its motion (design note 1.1 to 1.4; Park & Lee 2010, eq. 1 and 2).
//!
//! Frames: north-east-down (NED); the swing's plane at azimuth η from north over east; body x y z fixed to bar and
//! sensor, y along the axis of rotation, z down at bar angle ξ = 0. The lever arm r goes from the pivot to the
//! sensor, in body axes: (0, 0, −L) is Park & Lee's upright bar, (0, 0, +L) a hanging one with an upright sensor.
//! Body turns to NED by `C = Rz(η) Ry(ξ)`.

use nalgebra::{Matrix3, Vector3};

/// Rate of the Earth's rotation, rad/s.
pub const EARTH_RATE: f64 = 7.292_115e-5;

/// The bar at an instant.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BarState {
    /// Angle ξ, rad.
    pub angle: f64,
    /// ξ′, rad/s.
    pub rate: f64,
    /// ξ″, rad/s².
    pub acceleration: f64,
    /// ξ‴, rad/s³.
    pub jerk: f64,
}

/// Three components, with their slopes against the bar's state, as needed to propagate uncertainty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensed {
    /// x, y, z or north, east, down.
    pub value: [f64; 3],
    /// For each component its derivatives by ξ, ξ′ and ξ″.
    pub slope: [[f64; 3]; 3],
}

impl Sensed {
    /// Standard deviations of the components by the delta method, from the covariance of (ξ, ξ′, ξ″, ξ‴) as
    /// upper triangle 00 01 02 03 11 12 13 22 23 33.
    #[must_use]
    pub fn standard_deviation(&self, covariance: &[f64; 10]) -> [f64; 3] {
        let [p00, p01, p02, _, p11, p12, _, p22, ..] = *covariance;
        self.slope.map(|[a, b, c]| {
            let variance = a * a * p00 + b * b * p11 + c * c * p22 + 2.0 * (a * b * p01 + a * c * p02 + b * c * p12);
            variance.max(0.0).sqrt()
        })
    }

    /// The vector of the swing's plane (x′ horizontal, z down; third axis constant `across`) in NED.
    fn in_ned(azimuth: f64, along: (f64, [f64; 3]), across: f64, down: (f64, [f64; 3])) -> Sensed {
        let (sin_e, cos_e) = azimuth.sin_cos();
        Sensed {
            value: [cos_e * along.0 - sin_e * across, sin_e * along.0 + cos_e * across, down.0],
            slope: [along.1.map(|s| cos_e * s), along.1.map(|s| sin_e * s), down.1],
        }
    }
}

/// C: body to NED.
#[must_use]
#[rustfmt::skip]
pub fn ned_from_body(azimuth: f64, angle: f64) -> Matrix3<f64> {
    let (sin_e, cos_e) = azimuth.sin_cos();
    let (sin_x, cos_x) = angle.sin_cos();
    Matrix3::new(
        cos_e * cos_x, -sin_e, cos_e * sin_x,
        sin_e * cos_x,  cos_e, sin_e * sin_x,
       -sin_x,          0.0,   cos_x,
    )
}

/// Position from the pivot, NED, m: `C r`.
#[must_use]
pub fn position(state: &BarState, azimuth: f64, arm_m: [f64; 3]) -> Sensed {
    let (s, c) = state.angle.sin_cos();
    let [x, y, z] = arm_m;
    let (along, down) = (z * s + x * c, z * c - x * s);
    Sensed::in_ned(azimuth, (along, [down, 0.0, 0.0]), y, (down, [-along, 0.0, 0.0]))
}

/// Velocity, NED, m/s.
#[must_use]
pub fn velocity(state: &BarState, azimuth: f64, arm_m: [f64; 3]) -> Sensed {
    let (s, c) = state.angle.sin_cos();
    let [x, _, z] = arm_m;
    let (along, down) = (z * s + x * c, z * c - x * s);
    let rate = state.rate;
    Sensed::in_ned(
        azimuth,
        (rate * down, [-rate * along, down, 0.0]),
        0.0,
        (-rate * along, [-rate * down, -along, 0.0]),
    )
}

/// Acceleration over ground, NED, m/s².
#[must_use]
pub fn acceleration(state: &BarState, azimuth: f64, arm_m: [f64; 3]) -> [f64; 3] {
    let (s, c) = state.angle.sin_cos();
    let [x, _, z] = arm_m;
    let (along, down) = (z * s + x * c, z * c - x * s);
    let (tangential, radial) = (state.acceleration, state.rate * state.rate);
    let (sin_e, cos_e) = azimuth.sin_cos();
    let horizontal = tangential * down - radial * along;
    [cos_e * horizontal, sin_e * horizontal, -tangential * along - radial * down]
}

/// Specific force (acceleration less gravity), body axes, m/s²: `(r_z ξ″ − r_x ξ′² + g sin ξ, 0, −r_x ξ″ − r_z ξ′² − g cos ξ)`.
#[must_use]
pub fn specific_force(state: &BarState, arm_m: [f64; 3], gravity: f64) -> Sensed {
    let (s, c) = state.angle.sin_cos();
    let [x, _, z] = arm_m;
    let (rate, square) = (state.rate, state.rate * state.rate);
    Sensed {
        value: [
            z * state.acceleration - x * square + gravity * s,
            0.0,
            -x * state.acceleration - z * square - gravity * c,
        ],
        slope: [[gravity * c, -2.0 * x * rate, z], [0.0; 3], [gravity * s, -2.0 * z * rate, -x]],
    }
}

/// Angular rate, body axes, rad/s: `(0, ξ′, 0)`, plus the Earth's rotation if `earth` gives the latitude (rad), for a
/// gyro sensitive enough to measure it.
#[must_use]
pub fn angular_rate(state: &BarState, azimuth: f64, earth: Option<f64>) -> Sensed {
    let turning = earth.map_or([0.0; 3], |latitude| {
        let (s, c) = latitude.sin_cos();
        [EARTH_RATE * c, 0.0, -EARTH_RATE * s]
    });
    let mut sensed = turned_into_body(state, azimuth, turning);
    sensed.value[1] += state.rate;
    sensed.slope[1][1] += 1.0;
    sensed
}

/// Magnetic field, body axes, in the unit of `field_ned`: `Cᵀ b`.
#[must_use]
pub fn magnetic_field(state: &BarState, azimuth: f64, field_ned: [f64; 3]) -> Sensed {
    turned_into_body(state, azimuth, field_ned)
}

/// Attitude as unit quaternion w, x, y, z that rotates body to NED; continuous in both angles.
#[must_use]
pub fn attitude(angle: f64, azimuth: f64) -> [f64; 4] {
    let (sin_e, cos_e) = (0.5 * azimuth).sin_cos();
    let (sin_x, cos_x) = (0.5 * angle).sin_cos();
    [cos_e * cos_x, -sin_e * sin_x, cos_e * sin_x, sin_e * cos_x]
}

/// The bar's angle from an attitude, rad in (−π, π]: the direction of the vertical in the body's x-z plane,
/// `atan2(−d_x, d_z)`. Equal to ξ at every angle (no gimbal lock), and independent of the heading and its errors.
#[must_use]
pub fn swing_angle(quaternion: [f64; 4]) -> f64 {
    let [w, x, y, z] = quaternion;
    (2.0 * (w * y - x * z)).atan2(w * w - x * x - y * y + z * z)
}

/// The azimuth of the swing's plane from an attitude, rad in (−π, π]: the direction of the body's y axis minus 90°.
/// Defined at every bar angle.
#[must_use]
pub fn swing_azimuth(quaternion: [f64; 4]) -> f64 {
    let [w, x, y, z] = quaternion;
    (2.0 * (w * z - x * y)).atan2(w * w - x * x + y * y - z * z)
}

/// The rotation with this rotation vector (rad): `exp([φ]×)` (Rodrigues).
#[must_use]
pub fn rotation(vector: [f64; 3]) -> Matrix3<f64> {
    let v = Vector3::from(vector);
    let angle = v.norm();
    let cross = v.cross_matrix();
    let (first, second) = if angle < 1e-4 {
        let a2 = angle * angle;
        (1.0 - a2 / 6.0, 0.5 - a2 / 24.0)
    } else {
        (angle.sin() / angle, (1.0 - angle.cos()) / (angle * angle))
    };
    Matrix3::identity() + cross * first + cross * cross * second
}

/// An angle in (−π, π].
#[must_use]
pub fn wrapped(angle: f64) -> f64 {
    let turned = angle.rem_euclid(std::f64::consts::TAU);
    if turned > std::f64::consts::PI { turned - std::f64::consts::TAU } else { turned }
}

/// `Cᵀ u` and its slope by ξ.
fn turned_into_body(state: &BarState, azimuth: f64, ned: [f64; 3]) -> Sensed {
    let (sin_e, cos_e) = azimuth.sin_cos();
    let (s, c) = state.angle.sin_cos();
    let along = cos_e * ned[0] + sin_e * ned[1];
    let (x, z) = (c * along - s * ned[2], s * along + c * ned[2]);
    Sensed { value: [x, cos_e * ned[1] - sin_e * ned[0], z], slope: [[-z, 0.0, 0.0], [0.0; 3], [x, 0.0, 0.0]] }
}
