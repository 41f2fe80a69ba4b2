//! A motion with white-noise jerk, filtered.

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// Model of motion and sensors for a Kalman filter.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct KalmanSettings {
    /// Spectral density of the jerk, m²/s⁵.
    pub jerk_density: f64,
    /// White noise of each position, m.
    pub position_sigma_m: f64,
    /// White noise of each velocity, m/s.
    pub velocity_sigma_mps: f64,
    /// Delay of the velocity itself, s; positive is late.
    pub velocity_delay_s: f64,
}

impl KalmanSettings {
    /// Settings for the circuit of the design note (table 5.7): 60 m²/s⁵.
    #[must_use]
    pub fn circuit(position_sigma_m: f64, velocity_sigma_mps: f64) -> KalmanSettings {
        KalmanSettings { jerk_density: 60.0, position_sigma_m, velocity_sigma_mps, velocity_delay_s: 0.0 }
    }

    /// Whether all numbers are valid.
    pub(crate) fn is_sound(&self) -> bool {
        let positive = |x: f64| x > 0.0 && x.is_finite();
        positive(self.jerk_density)
            && positive(self.position_sigma_m)
            && positive(self.velocity_sigma_mps)
            && self.velocity_delay_s.is_finite()
    }
}

/// Prior standard deviation of the acceleration, m/s².
const ACCELERATION_SIGMA: f64 = 30.0;

/// Position, velocity and acceleration at an instant, with their covariance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Belief {
    pub(crate) t: f64,
    pub(crate) mean: Vector3<f64>,
    pub(crate) covariance: Matrix3<f64>,
}

/// State transition over `h` seconds, which may be negative if only the mean is needed.
pub(crate) fn transition(h: f64) -> Matrix3<f64> {
    Matrix3::new(1.0, h, 0.5 * h * h, 0.0, 1.0, h, 0.0, 0.0, 1.0)
}

/// Process noise of white jerk of density 1 over `h` seconds (design note 2).
fn unit_noise(h: f64) -> Matrix3<f64> {
    let (h2, h3) = (h * h, h * h * h);
    let (pp, pv, pa) = (h2 * h3 / 20.0, h2 * h2 / 8.0, h3 / 6.0);
    Matrix3::new(pp, pv, pa, pv, h3 / 3.0, 0.5 * h2, pa, 0.5 * h2, h)
}

impl Belief {
    /// Initial state from a position at `t` and a velocity measured `apart_s` away from it.
    pub(crate) fn first(t: f64, position: f64, velocity: f64, apart_s: f64, settings: &KalmanSettings) -> Belief {
        let acceleration = ACCELERATION_SIGMA * ACCELERATION_SIGMA;
        let variances = Vector3::new(
            settings.position_sigma_m.powi(2),
            settings.velocity_sigma_mps.powi(2) + acceleration * apart_s * apart_s,
            acceleration,
        );
        Belief { t, mean: Vector3::new(position, velocity, 0.0), covariance: Matrix3::from_diagonal(&variances) }
    }

    /// Predicts to `t`, which is not earlier.
    pub(crate) fn predict(&mut self, t: f64, jerk_density: f64) {
        let h = t - self.t;
        if h != 0.0 {
            let f = transition(h);
            self.mean = f * self.mean;
            self.covariance = f * self.covariance * f.transpose() + unit_noise(h) * jerk_density;
        }
        self.t = t;
    }

    /// Updates with a measurement of component `row` with noise `sigma`; returns the innovation and its variance.
    pub(crate) fn update(&mut self, row: usize, value: f64, sigma: f64) -> (f64, f64) {
        let innovation = value - self.mean[row];
        let column: Vector3<f64> = self.covariance.column(row).into_owned();
        let variance = column[row] + sigma * sigma;
        let gain = column / variance;
        self.mean += gain * innovation;
        self.covariance -= gain * column.transpose();
        self.covariance = (self.covariance + self.covariance.transpose()) * 0.5;
        (innovation, variance)
    }

    /// Position at another instant nearby, m.
    pub(crate) fn position_at(&self, t: f64) -> f64 {
        let h = t - self.t;
        self.mean[0] + h * (self.mean[1] + 0.5 * h * self.mean[2])
    }
}
