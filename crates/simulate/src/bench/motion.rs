//! The truth at an instant: the bar, and the ideal readings of each channel (design note 1.1 to 1.4).

use super::bar::FlexibleBar;
use super::lag::{Nodes, STEP_S};
use super::quantity::BenchChannel;
use super::settings::BenchSettings;
use super::swing::SwingCurve;
use crate::error::SimulateError;
use crate::trajectory::MARGIN_S;
use nalgebra::{UnitQuaternion, Vector3};
use std::f64::consts::TAU;

/// Angle of a bar and its derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BarMotion {
    /// rad.
    pub angle: f64,
    /// rad/s.
    pub rate: f64,
    /// rad/s².
    pub acceleration: f64,
    /// rad/s³.
    pub jerk: f64,
}

impl BarMotion {
    /// Angle and derivatives that bending adds, scaled.
    fn bent(self, deflection: [f64; 4], scale: f64) -> BarMotion {
        BarMotion {
            angle: self.angle + scale * deflection[0],
            rate: self.rate + scale * deflection[1],
            acceleration: self.acceleration + scale * deflection[2],
            jerk: self.jerk + scale * deflection[3],
        }
    }
}

/// The truth of a bench at every instant.
#[derive(Debug, Clone, PartialEq)]
pub struct BenchTruth {
    settings: BenchSettings,
    curve: SwingCurve,
    /// Deflection of the tip over the length, if the bar bends.
    deflection: Option<Nodes>,
}

impl BenchTruth {
    pub(super) fn new(settings: &BenchSettings) -> Result<BenchTruth, SimulateError> {
        let gravity = settings.site.gravity_mps2;
        let curve = SwingCurve::draw(settings.swing, settings.swing_s, &settings.bar, gravity, settings.seed);
        let mut truth = BenchTruth { settings: settings.clone(), curve, deflection: None };
        truth.deflection = settings.bar.flexible.map(|flexible| truth.bend(&flexible));
        Ok(truth)
    }

    /// The bar at its axis, where the encoder is, `t_s` seconds after the start. It rests before the start and after
    /// the end.
    #[must_use]
    pub fn at(&self, t_s: f64) -> BarMotion {
        let [angle, rate, acceleration, jerk] = self.curve.at(t_s - self.settings.rest_s[0]);
        BarMotion { angle: self.settings.rest_angle_rad + angle, rate, acceleration, jerk }
    }

    /// The line from the pivot to the sensor: it determines position and velocity. For a stiff bar it is the bar's.
    #[must_use]
    pub fn chord_at(&self, t_s: f64) -> BarMotion {
        self.deflection.as_ref().map_or(self.at(t_s), |nodes| self.at(t_s).bent(nodes.at(t_s), 1.0))
    }

    /// The slope of the bar at the sensor: it determines attitude, angular rate and field. For a stiff bar it is the
    /// bar's.
    #[must_use]
    pub fn slope_at(&self, t_s: f64) -> BarMotion {
        let slope_ratio = self.settings.bar.flexible.map_or(0.0, |f| f.slope_ratio);
        self.deflection.as_ref().map_or(self.at(t_s), |nodes| self.at(t_s).bent(nodes.at(t_s), slope_ratio))
    }

    /// Readings of a perfect sensor at the channel's place and in its mount: components in the order and the units of
    /// [`flight::Quantity`], but a position as north, east, down from the pivot, m.
    #[must_use]
    pub fn value(&self, channel: BenchChannel, t_s: f64) -> Vec<f64> {
        let core = self.core(channel, t_s);
        if channel == BenchChannel::Attitude {
            return self.quaternion(core[0], [0.0; 3]).to_vec();
        }
        core.iter().take(channel.quantity().components().len()).copied().collect()
    }

    /// The input of lags and gains: the value itself; for an attitude the angle of the bar at the sensor; for a single
    /// number the first component.
    pub(super) fn core(&self, channel: BenchChannel, t_s: f64) -> [f64; 3] {
        match channel {
            BenchChannel::PositionGps | BenchChannel::PositionIns => self.position(channel, t_s),
            BenchChannel::VelocityGps | BenchChannel::VelocityIns => self.velocity(channel, t_s),
            BenchChannel::Attitude => [self.slope_at(t_s).angle, 0.0, 0.0],
            BenchChannel::AngularRate => self.sensed(channel, [0.0, self.slope_at(t_s).rate, 0.0]),
            BenchChannel::SpecificForce => self.sensed(channel, self.specific_force(channel, t_s)),
            BenchChannel::MagneticField => self.sensed(channel, self.field(t_s)),
            BenchChannel::MagneticDirection => {
                let strength = Vector3::from(self.settings.site.field_t).norm();
                self.sensed(channel, self.field(t_s).map(|b| b / strength))
            }
            BenchChannel::Height => [-self.position(channel, t_s)[2], 0.0, 0.0],
        }
    }

    /// w, x, y, z of the sensor's attitude at the bar angle `angle`, rotated further by a small `error`.
    pub(super) fn quaternion(&self, angle: f64, error: [f64; 3]) -> [f64; 4] {
        let azimuth = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), self.settings.bar.azimuth_rad);
        let swung = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), angle);
        let error = UnitQuaternion::from_scaled_axis(Vector3::from(error));
        let q = azimuth * swung * self.body_from_sensor(BenchChannel::Attitude) * error;
        // Once more, to normalise the length to the last bit.
        let q = UnitQuaternion::new_normalize(q.into_inner());
        [q.w, q.i, q.j, q.k]
    }

    fn position(&self, channel: BenchChannel, t_s: f64) -> [f64; 3] {
        let [x, y, z] = self.settings.lever_arm_m(channel);
        let (sin, cos) = self.chord_at(t_s).angle.sin_cos();
        self.to_ned([x * cos + z * sin, y, z * cos - x * sin])
    }

    fn velocity(&self, channel: BenchChannel, t_s: f64) -> [f64; 3] {
        let [x, _, z] = self.settings.lever_arm_m(channel);
        let motion = self.chord_at(t_s);
        let (sin, cos) = motion.angle.sin_cos();
        self.to_ned([motion.rate * (z * cos - x * sin), 0.0, -motion.rate * (x * cos + z * sin)])
    }

    /// Acceleration of the chord's end minus gravity, in the axes of the bar at the sensor.
    fn specific_force(&self, channel: BenchChannel, t_s: f64) -> [f64; 3] {
        let [x, _, z] = self.settings.lever_arm_m(channel);
        let motion = self.chord_at(t_s);
        let (sin, cos) = motion.angle.sin_cos();
        let (along, across) = (z * cos - x * sin, x * cos + z * sin);
        let square = motion.rate * motion.rate;
        let forward = motion.acceleration * along - square * across;
        let down = -motion.acceleration * across - square * along - self.settings.site.gravity_mps2;
        let (sin, cos) = self.slope_at(t_s).angle.sin_cos();
        [cos * forward - sin * down, 0.0, sin * forward + cos * down]
    }

    fn field(&self, t_s: f64) -> [f64; 3] {
        let [north, east, down] = self.settings.site.field_t;
        let (sin_azimuth, cos_azimuth) = self.settings.bar.azimuth_rad.sin_cos();
        let (along, across) = (north * cos_azimuth + east * sin_azimuth, east * cos_azimuth - north * sin_azimuth);
        let (sin, cos) = self.slope_at(t_s).angle.sin_cos();
        [cos * along - sin * down, across, sin * along + cos * down]
    }

    /// Converts the swing plane (forward, right, down) to north, east, down.
    fn to_ned(&self, [forward, right, down]: [f64; 3]) -> [f64; 3] {
        let (sin, cos) = self.settings.bar.azimuth_rad.sin_cos();
        [cos * forward - sin * right, sin * forward + cos * right, down]
    }

    fn sensed(&self, channel: BenchChannel, body: [f64; 3]) -> [f64; 3] {
        let sensor = self.body_from_sensor(channel).inverse() * Vector3::from(body);
        sensor.into()
    }

    fn body_from_sensor(&self, channel: BenchChannel) -> UnitQuaternion<f64> {
        let rotation = self.settings.sensor.get(&channel).map_or([0.0; 3], |s| s.rotation_rad);
        UnitQuaternion::from_scaled_axis(Vector3::from(rotation))
    }

    /// Deflection over length, q″ + 2ζω q′ + ω² q = −Γ ξ″, by RK4 from rest.
    fn bend(&self, flexible: &FlexibleBar) -> Nodes {
        let omega = TAU * flexible.frequency_hz;
        let law = |q: f64, v: f64, push: f64| {
            -flexible.participation * push - 2.0 * flexible.damping * omega * v - omega * omega * q
        };
        let end_s = self.settings.duration_s() + MARGIN_S;
        let count = (end_s / STEP_S).ceil() as usize;
        let (mut q, mut v, h) = (0.0, 0.0, STEP_S);
        let mut u0 = self.at(0.0).acceleration;
        let mut rows = Vec::with_capacity(count + 1);
        for node in 0..=count {
            let t = node as f64 * h;
            let (um, u1) = (self.at(t + h / 2.0).acceleration, self.at(t + h).acceleration);
            let a = law(q, v, u0);
            rows.push([q, v, a]);
            let (v2, a2) = (v + h / 2.0 * a, law(q + h / 2.0 * v, v + h / 2.0 * a, um));
            let (v3, a3) = (v + h / 2.0 * a2, law(q + h / 2.0 * v2, v + h / 2.0 * a2, um));
            let (v4, a4) = (v + h * a3, law(q + h * v3, v + h * a3, u1));
            q += h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4);
            v += h / 6.0 * (a + 2.0 * a2 + 2.0 * a3 + a4);
            u0 = u1;
        }
        Nodes { first_s: 0.0, step_s: STEP_S, rows }
    }
}
