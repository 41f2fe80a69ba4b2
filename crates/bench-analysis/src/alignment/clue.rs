//! Evidence of one channel for sign, zero and azimuth.

use super::force::{ForceFit, ForceTerms, force_fits};
use crate::kinematics::swing_azimuth;
use crate::motion::Motion;
use crate::pattern::{Pattern, PatternFit, Samples, fit_pattern};
use crate::rig::{Mount, Rig};
use crate::sensor_rows::{body_attitude, pattern_of, sensor_rows, unwrap, update_samples};
use crate::surroundings::Surroundings;
use flight::{Channel, Flight, Quantity};
use nalgebra::Matrix2;
use signal::{Regression, regress};

/// A share of the variance below this is not significant.
pub(crate) const LEAST_EXPLAINED: f64 = 0.2;

/// One channel aligned with the encoder's angle.
#[derive(Debug, Clone)]
pub(crate) struct Clue {
    pub(crate) name: String,
    pub(crate) quantity: Quantity,
    pub(crate) mount: Mount,
    pub(crate) delay_s: f64,
    /// Kinematic index of each component.
    pub(crate) component: Vec<usize>,
    pub(crate) samples: Samples,
    pub(crate) fit: PatternFit,
    /// For an attitude: heading of the swing's plane.
    pub(crate) heading: Option<(f64, f64)>,
    /// For specific force: fits of the stacked axes with the bar's sign +1 and −1.
    pub(crate) force: Option<[ForceFit; 2]>,
}

impl Clue {
    /// Whether the reference of this channel needs the azimuth.
    pub(crate) fn needs_azimuth(&self) -> bool {
        matches!(self.quantity, Quantity::PositionGeodetic | Quantity::PositionNed | Quantity::VelocityNed)
    }

    /// The regression of a kinematic component.
    pub(crate) fn regression(&self, component: usize) -> Option<&Regression> {
        let k = self.component.iter().position(|c| *c == component)?;
        self.fit.fits.get(k)
    }
}

/// All channels of `sensor` that the pattern explains to some degree.
pub(crate) fn clues(motion: &Motion, sensor: &Flight, rig: &Rig, around: &Surroundings) -> Vec<Clue> {
    sensor.channels.iter().filter_map(|(name, channel)| clue(motion, name, channel, rig, around)).collect()
}

fn clue(motion: &Motion, name: &str, channel: &Channel, rig: &Rig, around: &Surroundings) -> Option<Clue> {
    let rows = sensor_rows(name, channel, rig)?;
    let samples = update_samples(channel, &rows, motion.origin());
    let pattern = pattern_of(channel.quantity)?;
    let aligned = |pattern| fit_pattern(motion, &samples, pattern, rig.analysis.search_s);
    // A swing of one frequency cannot distinguish acceleration from gravity.
    let fit = aligned(pattern).or_else(|| aligned(Pattern::Circle).filter(|_| pattern == Pattern::Force))?;
    let explained = fit.explained.iter().copied().fold(0.0, f64::max);
    if explained < LEAST_EXPLAINED {
        return None;
    }
    let heading = if channel.quantity == Quantity::Attitude { heading(name, channel, rig) } else { None };
    let force = if channel.quantity == Quantity::SpecificForce {
        let typical = motion.typical_uncertainty();
        let [x, _, z] = rig.mount_of(name).lever_arm_m;
        force_fits(
            &samples,
            &fit,
            &rows.component,
            &ForceTerms { gravity: around.gravity_mps2, typical, stated: [z, x] },
        )
    } else {
        None
    };
    Some(Clue {
        name: name.to_owned(),
        quantity: channel.quantity,
        mount: rig.mount_of(name),
        delay_s: fit.delay_s,
        component: rows.component,
        samples,
        fit,
        heading,
        force,
    })
}

/// Mean azimuth of the plane from an attitude, and its standard uncertainty.
fn heading(name: &str, channel: &Channel, rig: &Rig) -> Option<(f64, f64)> {
    let attitudes = body_attitude(name, channel, rig)?;
    let mut azimuth: Vec<f64> = channel.update_rows().iter().map(|&row| swing_azimuth(attitudes[row])).collect();
    unwrap(&mut azimuth);
    let ones = vec![1.0; azimuth.len()];
    let mean = regress(&[&ones], &["mean"], &azimuth).ok()?;
    Some((mean.coefficients[0], mean.standard_uncertainty(0)))
}

/// The circle on which the sensor moves, as a function of the encoder's angle θ: with ξ = sθ + ξ₀ its coordinates in
/// the swing's plane are `down = A cos θ − s B sin θ`, `along = s A sin θ + B cos θ`, and `A + iB = (r_z + i r_x)
/// exp(iξ₀)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Circle {
    pub(crate) a: f64,
    pub(crate) b: f64,
    /// Covariance of (a, b).
    pub(crate) covariance: Matrix2<f64>,
}

impl Circle {
    /// From the down component of a position or velocity.
    pub(crate) fn from_down(clue: &Clue, sign: f64) -> Option<Circle> {
        let fit = clue.regression(2)?;
        // Coefficients 1 and 2 are those of the sine and the cosine.
        match clue.quantity {
            // v_D = −θ′ (s B cos θ + A sin θ)
            Quantity::VelocityNed => Some(Circle::linear(fit, [[-1.0, 0.0], [0.0, -sign]])),
            Quantity::PositionGeodetic | Quantity::PositionNed => Some(Circle::linear(fit, [[0.0, 1.0], [-sign, 0.0]])),
            Quantity::Height => Some(Circle::linear(fit, [[0.0, -1.0], [sign, 0.0]])),
            _ => None,
        }
    }

    /// From north and east with a known azimuth.
    pub(crate) fn from_horizontal(clue: &Clue, sign: f64, azimuth: f64) -> Option<Circle> {
        let (north, east) = (clue.regression(0)?, clue.regression(1)?);
        let (sin_e, cos_e) = azimuth.sin_cos();
        let from = match clue.quantity {
            // v_along = θ′ (s A cos θ − B sin θ)
            Quantity::VelocityNed => [[0.0, sign], [-1.0, 0.0]],
            Quantity::PositionGeodetic | Quantity::PositionNed => [[sign, 0.0], [0.0, 1.0]],
            _ => return None,
        };
        let (n, e) = (Circle::linear(north, from), Circle::linear(east, from));
        Some(Circle {
            a: cos_e * n.a + sin_e * e.a,
            b: cos_e * n.b + sin_e * e.b,
            covariance: n.covariance * cos_e.powi(2) + e.covariance * sin_e.powi(2),
        })
    }

    /// (A, B) as `matrix` times the coefficients of sine and cosine.
    fn linear(fit: &Regression, matrix: [[f64; 2]; 2]) -> Circle {
        let m = Matrix2::new(matrix[0][0], matrix[0][1], matrix[1][0], matrix[1][1]);
        let c = &fit.covariance;
        let covariance = Matrix2::new(c[1][1], c[1][2], c[2][1], c[2][2]);
        let value = m * nalgebra::Vector2::new(fit.coefficients[1], fit.coefficients[2]);
        Circle { a: value[0], b: value[1], covariance: m * covariance * m.transpose() }
    }

    /// Both, weighted by their covariances.
    pub(crate) fn combined(one: Option<Circle>, other: Option<Circle>) -> Option<Circle> {
        let (Some(one), Some(other)) = (one, other) else { return one.or(other) };
        let weights = (one.covariance.try_inverse(), other.covariance.try_inverse());
        let (Some(first), Some(second)) = weights else { return Some(one) };
        let covariance = (first + second).try_inverse()?;
        let value = covariance
            * (first * nalgebra::Vector2::new(one.a, one.b) + second * nalgebra::Vector2::new(other.a, other.b));
        Some(Circle { a: value[0], b: value[1], covariance })
    }

    /// Radius and its standard uncertainty.
    pub(crate) fn radius(&self) -> (f64, f64) {
        let r = self.a.hypot(self.b);
        (r, self.spread(self.a / r, self.b / r))
    }

    /// Phase arg(A + iB), rad, and its standard uncertainty.
    pub(crate) fn phase(&self) -> (f64, f64) {
        let r2 = self.a.powi(2) + self.b.powi(2);
        (self.b.atan2(self.a), self.spread(-self.b / r2, self.a / r2))
    }

    fn spread(&self, by_a: f64, by_b: f64) -> f64 {
        let gradient = nalgebra::Vector2::new(by_a, by_b);
        (gradient.transpose() * self.covariance * gradient)[0].max(0.0).sqrt()
    }
}
