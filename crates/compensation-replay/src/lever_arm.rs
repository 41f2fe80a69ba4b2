//! Effect on a delay of an antenna that is not at the point where velocity is measured.
//!
//! The receiver's position is that of its antenna: `p = x + l·h`, where `l` is how far the antenna is ahead of the
//! point whose velocity is integrated, and `h` is the horizontal direction of the nose. The fit
//! `p(t) = c + d·t + ∫v(t − δ)` takes the part of `l·h` that looks like `−v` for a delay. To first order, for least
//! squares with weights w,
//!
//! `shift = −l · Σ w (Ph)·(Pv) / Σ w (Pv)·(Pv)`,
//!
//! where P removes offset and drift of each piece and axis. In a turn at constant speed U with the nose along the path
//! `h = v/U`, so the shift is exactly −l/U: an antenna ahead makes a position look early, −91 ms for 1 m at 11 m/s. If
//! the speed varies and offset and drift absorb little, it is about −l·ΣU/ΣU². With straight stretches it is less,
//! because there an arm is an offset (a real log of the DeLorean set: −82 ms/m by the formula above, −112 ms/m by
//! speeds alone).
//!
//! A receiver's own velocity is that of its antenna, so there is no shift. EKF2 of PX4 and EKF2 and EKF3 of ArduPilot
//! output the velocity of the vehicle's origin (they correct for the IMU's position). An acceleration is that of the
//! IMU.

mod projection;

use self::projection::Projected;
use flight::About;
use record::Estimate;

/// Below this speed a path has no direction, m/s.
const LEAST_SPEED_MPS: f64 = 0.5;
/// Standard uncertainty of a uniform distribution, as a fraction of its half-width.
const RECTANGULAR: f64 = 0.577_350_269_189_625_8;

/// Point on the vehicle where a velocity is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum VelocityPoint {
    /// At the position's antenna: velocity of the same receiver.
    Antenna,
    /// At the autopilot's vehicle origin: output of its estimators.
    Origin,
    /// At the inertial sensors: integrated specific force, and inertial systems without correction.
    Imu,
}

/// Offset of an antenna from the point where velocity is measured, in body axes.
#[derive(Debug, Clone, PartialEq)]
pub struct AntennaArm {
    /// Ahead of it, m.
    pub forward_m: f64,
    /// Right of it, m.
    pub right_m: f64,
    /// Largest error of both, m; 0 if they are taken as exact.
    pub tolerance_m: f64,
    /// Source, in words.
    pub from: String,
}

/// The arm from the velocity's point to the antenna of a receiver (the first is 1), from the log's parameters. `None`
/// if the antenna was not configured: the arm is then unknown, not zero.
#[must_use]
pub fn antenna_arm(about: &About, receiver: u32, point: VelocityPoint) -> Option<AntennaArm> {
    let arm = |forward_m, right_m, from| Some(AntennaArm { forward_m, right_m, tolerance_m: 0.0, from });
    if point == VelocityPoint::Antenna {
        return arm(0.0, 0.0, "velocity and position are of the same antenna".to_owned());
    }
    let sensor = if receiver <= 1 { "gps".to_owned() } else { format!("gps-{receiver}") };
    let gps = about.lever_arm(&sensor)?;
    match about.lever_arm("imu").filter(|_| point == VelocityPoint::Imu) {
        Some(imu) => {
            let from = format!("{} less {}", gps.parameter, imu.parameter);
            arm(gps.forward_m - imu.forward_m, gps.right_m - imu.right_m, from)
        }
        None => arm(gps.forward_m, gps.right_m, gps.parameter.clone()),
    }
}

/// The motion at the samples of a delay fit. Non-empty slices have the length of the velocity.
#[derive(Debug, Clone, Copy, Default)]
pub struct LeverMotion<'a> {
    /// Times, s. Empty: the fit has no drift.
    pub time_s: &'a [f64],
    /// Velocity north and east, m/s.
    pub velocity_mps: [&'a [f64]; 2],
    /// Direction of the nose north and east, from the attitude. `None`: along the path, as for an aeroplane or a car.
    pub nose: Option<[&'a [f64]; 2]>,
    /// Weight of each sample in the fit. Empty: all equal.
    pub weight: &'a [f64],
    /// Index of the piece with its own offset and drift. Empty: one piece.
    pub piece: &'a [usize],
}

/// Effect of a lever arm on the delay of a position against a velocity.
#[derive(Debug, Clone, PartialEq)]
pub struct LeverSensitivity {
    /// Shift of the delay for an antenna 1 m farther ahead, s/m: negative, the position looks earlier.
    pub shift_s_per_m: f64,
    /// Shift for an antenna 1 m farther to the right, s/m: about zero if the vehicle turns both ways.
    pub sideways_s_per_m: f64,
    /// Samples that were used.
    pub samples: u64,
}

impl LeverSensitivity {
    /// The speed at which a circle has this shift, m/s.
    #[must_use]
    pub fn speed_mps(&self) -> Option<f64> {
        (self.shift_s_per_m != 0.0).then(|| 1.0 / self.shift_s_per_m.abs())
    }

    /// Shift of the delay by an arm, s, with the uncertainty from its tolerance (uniform).
    #[must_use]
    pub fn shift_s(&self, arm: &AntennaArm) -> Estimate {
        let per_m = self.shift_s_per_m.hypot(self.sideways_s_per_m);
        Estimate {
            value: self.shift_s_per_m * arm.forward_m + self.sideways_s_per_m * arm.right_m,
            standard_uncertainty: Some(per_m * arm.tolerance_m.abs() * RECTANGULAR),
        }
    }

    /// The delay for an antenna at the point where velocity is measured: the shift is removed, and its uncertainty
    /// added.
    #[must_use]
    pub fn corrected(&self, delay_s: Estimate, arm: &AntennaArm) -> Estimate {
        let shift = self.shift_s(arm);
        let u = shift.standard_uncertainty.unwrap_or(0.0);
        Estimate {
            value: delay_s.value - shift.value,
            standard_uncertainty: delay_s.standard_uncertainty.map(|delay| delay.hypot(u)),
        }
    }

    /// Text for a number with an unknown lever arm: `± 9.1 ms per 0.1 m of unknown lever arm`.
    #[must_use]
    pub fn words(&self) -> String {
        format!("± {:.1} ms per 0.1 m of unknown lever arm (antenna ahead or behind)", 100.0 * self.shift_s_per_m.abs())
    }

    /// The removed shift, in words.
    #[must_use]
    pub fn words_of(&self, arm: &AntennaArm) -> String {
        let Estimate { value, standard_uncertainty } = self.shift_s(arm);
        let u = 2e3 * standard_uncertainty.unwrap_or(0.0);
        let uncertainty = if u > 0.0 { format!(" ± {u:.1}") } else { String::new() };
        format!(
            "the antenna is {:.2} m {} the point where velocity is taken ({}): that makes the position look \
             {:.1}{uncertainty} ms {}, which is corrected",
            arm.forward_m.abs(),
            if arm.forward_m >= 0.0 { "ahead of" } else { "behind" },
            arm.from,
            1e3 * value.abs(),
            if value <= 0.0 { "earlier" } else { "later" },
        )
    }
}

/// Effect of a lever arm on a fit of these samples. `None` if the path cannot show it (stationary or straight and
/// steady).
#[must_use]
pub fn lever_sensitivity(motion: &LeverMotion<'_>) -> Option<LeverSensitivity> {
    let mut projected = Projected::default();
    let mut samples = 0;
    for row in 0..motion.velocity_mps[0].len() {
        if let Some(sample) = sample_of(motion, row) {
            projected.add(&sample);
            samples += 1;
        }
    }
    let [forward, sideways, power] = projected.products(!motion.time_s.is_empty());
    // Excludes what rounding leaves of a straight and steady flight.
    let excited = power > 1e-9 * projected.power() && forward.is_finite() && power.is_finite();
    excited.then(|| LeverSensitivity { shift_s_per_m: -forward / power, sideways_s_per_m: -sideways / power, samples })
}

/// One row as input to the projection.
struct Sample {
    piece: usize,
    weight: f64,
    time_s: f64,
    velocity: [f64; 2],
    forward: [f64; 2],
}

fn sample_of(motion: &LeverMotion<'_>, row: usize) -> Option<Sample> {
    let both = |slices: [&[f64]; 2]| {
        let pair = [*slices[0].get(row)?, *slices[1].get(row)?];
        pair.iter().all(|value| value.is_finite()).then_some(pair)
    };
    let velocity = both(motion.velocity_mps)?;
    let along = match motion.nose {
        Some(nose) => both(nose)?,
        None => Some(velocity).filter(|[n, e]| n.hypot(*e) >= LEAST_SPEED_MPS)?,
    };
    let length = along[0].hypot(along[1]);
    let forward = (length > 0.0).then(|| along.map(|axis| axis / length))?;
    let time_s = if motion.time_s.is_empty() { 0.0 } else { *motion.time_s.get(row).filter(|t| t.is_finite())? };
    let piece = if motion.piece.is_empty() { 0 } else { *motion.piece.get(row)? };
    Some(Sample { piece, weight: weight_of(motion.weight, row)?, time_s, velocity, forward })
}

fn weight_of(weight: &[f64], row: usize) -> Option<f64> {
    if weight.is_empty() { Some(1.0) } else { weight.get(row).copied().filter(|w| w.is_finite() && *w > 0.0) }
}

#[cfg(test)]
mod tests;
