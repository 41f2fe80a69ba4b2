//! The expected values of each sensor channel, next to the measured ones.

use crate::alignment::Alignment;
use crate::clock::is_sensed;
use crate::kinematics::{Sensed, angular_rate, magnetic_field, position, specific_force, velocity};
use crate::lagged_field::{Turning, coefficients_behind_lag};
use crate::motion::Motion;
use crate::pattern::{Pattern, fit_at};
use crate::rig::Rig;
use crate::sensor_rows::{SensorRows, sensor_rows, update_samples};
use crate::surroundings::Surroundings;
use flight::{Channel, Code, Flight, Notices, Quantity};
use signal::CubicSpline;

/// Minimum and maximum rate of the grid of the references, Hz.
const GRID_HZ: (f64, f64) = (100.0, 250.0);
/// A component that moves less than this share of the channel's most active one mostly shows leakage from it: a mount
/// three degrees off gives 5 %.
const LEAST_SHARE: f64 = 0.05;
/// A reference must move by at least this many times its own standard uncertainty.
const LEAST_OVER_UNCERTAINTY: f64 = 5.0;

/// One component of a channel: measured and expected.
#[derive(Debug, Clone)]
pub struct ComponentReference {
    /// Its name, such as `north`, or `swing angle` for an attitude.
    pub name: String,
    /// SI unit for display.
    pub unit: String,
    /// Measured, SI, one value for each row of the channel (including held repeats); body vectors in body axes.
    pub measured: Vec<f64>,
    /// Expected, at the encoder's time.
    pub reference: CubicSpline,
    /// Standard uncertainty of the reference from the encoder's smoothing, median over the record, same unit.
    pub uncertainty: f64,
    /// Derivatives of the reference by the bar's angle, rate and acceleration, at its knots.
    pub slope: Vec<[f64; 3]>,
    /// Rms of the reference about its mean, same unit.
    pub reference_rms: f64,
    /// Whether the swing moves it enough to count in the delay; if not, why.
    pub excited: Result<(), String>,
    /// Whether the reference was fitted to the measurement itself, which makes its gain one by construction.
    pub unit_gain: bool,
    /// Whether its offset may drift: position, velocity and height, unless the rig forbids it.
    pub drift: bool,
}

/// One channel of the sensor.
#[derive(Debug, Clone)]
pub struct ChannelReference {
    /// Its name.
    pub name: String,
    /// Its quantity.
    pub quantity: Quantity,
    /// Timestamps of all its rows, s after the encoder's first timestamp.
    pub t_s: Vec<f64>,
    /// Delay at which it was aligned with the motion, s: good to a few milliseconds; `None` if it was not.
    pub coarse_delay_s: Option<f64>,
    /// The components that the log has and the bench can compute.
    pub components: Vec<ComponentReference>,
}

/// All channels of a sensor that have a reference.
#[derive(Debug, Clone)]
pub struct References {
    /// In order of their names.
    pub channels: Vec<ChannelReference>,
    /// Skipped channels, and why.
    pub notices: Notices,
}

impl References {
    /// References for the channels of `sensor`, whose timestamps are in the encoder's clock. `motion` is oriented by
    /// `alignment`.
    #[must_use]
    pub fn of(sensor: &Flight, motion: &Motion, rig: &Rig, around: &Surroundings, alignment: &Alignment) -> References {
        let mut notices = Notices::new();
        let maker = Maker::new(motion, rig, around, alignment);
        let channels =
            sensor.channels.iter().filter_map(|(name, channel)| maker.channel(name, channel, &mut notices)).collect();
        References { channels, notices }
    }
}

/// Inputs of a reference.
struct Maker<'a> {
    motion: &'a Motion,
    rig: &'a Rig,
    around: &'a Surroundings,
    alignment: &'a Alignment,
    grid: Vec<f64>,
}

/// A reference on the grid.
struct Curve {
    values: Vec<f64>,
    slope: Vec<[f64; 3]>,
    uncertainty: f64,
    unit_gain: bool,
}

impl<'a> Maker<'a> {
    fn new(motion: &'a Motion, rig: &'a Rig, around: &'a Surroundings, alignment: &'a Alignment) -> Maker<'a> {
        let grid = motion.grid(motion.span(), motion.rate_hz().clamp(GRID_HZ.0, GRID_HZ.1));
        Maker { motion, rig, around, alignment, grid }
    }

    fn channel(&self, name: &str, channel: &Channel, notices: &mut Notices) -> Option<ChannelReference> {
        if !is_sensed(channel.quantity) {
            return None;
        }
        let rows = sensor_rows(name, channel, self.rig).filter(|_| !channel.series.is_empty());
        let Some(mut rows) = rows else {
            let text = "the log lacks a component that the mount needs: no reference";
            notices.push(Code::NoReference, name, channel.series.len() as u64, text);
            return None;
        };
        let t_s = channel.series.timeline().seconds_since(self.motion.origin());
        if channel.quantity == Quantity::Attitude {
            self.onto_the_same_turn(&t_s, &mut rows);
        }
        let components = self.components(name, channel, rows);
        if components.is_empty() {
            let text = "no component of this channel can be compared with the bar's motion";
            notices.push(Code::NoReference, name, t_s.len() as u64, text);
            return None;
        }
        let coarse_delay_s = self.alignment.coarse_delay_s.get(name).copied();
        Some(ChannelReference { name: name.to_owned(), quantity: channel.quantity, t_s, coarse_delay_s, components })
    }

    /// The components that have a reference.
    fn components(&self, name: &str, channel: &Channel, rows: SensorRows) -> Vec<ComponentReference> {
        let curves: Vec<Option<Curve>> = match channel.quantity {
            Quantity::MagneticField | Quantity::MagneticDirection if self.around.field_t.is_none() => {
                self.fitted_field(name, channel, &rows)
            }
            _ => rows.component.iter().map(|&k| self.curve(name, channel.quantity, k)).collect(),
        };
        let mut components = vec![];
        for ((k, curve), measured) in curves.into_iter().enumerate().zip(rows.columns) {
            let Some(curve) = curve else { continue };
            let Ok(reference) = CubicSpline::new(&self.grid, &curve.values) else { continue };
            components.push(ComponentReference {
                name: rows.names[k].to_owned(),
                unit: rows.unit.to_owned(),
                measured,
                reference,
                uncertainty: curve.uncertainty,
                slope: curve.slope,
                reference_rms: rms_about_mean(&curve.values),
                excited: Ok(()),
                unit_gain: curve.unit_gain,
                drift: self.rig.analysis.drift && may_drift(channel.quantity),
            });
        }
        judge_excitation(channel.quantity, &mut components);
        components
    }

    /// A swing angle is ambiguous by whole turns: shifts it to the turn nearest to the bar's.
    fn onto_the_same_turn(&self, t_s: &[f64], rows: &mut SensorRows) {
        for column in &mut rows.columns {
            let mut off: Vec<f64> =
                t_s.iter().zip(&*column).filter_map(|(t, y)| Some(self.motion.seen_at(*t)?.angle - y)).collect();
            let turns = (signal::median_in_place(&mut off).unwrap_or(0.0) / std::f64::consts::TAU).round();
            column.iter_mut().for_each(|y| *y += turns * std::f64::consts::TAU);
        }
    }

    /// One kinematic component over the grid; `None` if it needs an unknown azimuth.
    fn curve(&self, name: &str, quantity: Quantity, component: usize) -> Option<Curve> {
        let azimuth = self.alignment.azimuth_rad.map(|e| e.value);
        let needs_azimuth =
            matches!(quantity, Quantity::PositionGeodetic | Quantity::PositionNed | Quantity::VelocityNed)
                && component < 2;
        let field_needs_it = matches!(quantity, Quantity::MagneticField | Quantity::MagneticDirection);
        if (needs_azimuth || field_needs_it) && azimuth.is_none() {
            return None;
        }
        let azimuth = azimuth.unwrap_or(0.0);
        let arm = self.rig.mount_of(name).lever_arm_m;
        let field = self.field(quantity);
        let sensed = |state: &crate::kinematics::BarState| -> Option<Sensed> {
            Some(match quantity {
                Quantity::PositionGeodetic | Quantity::PositionNed => position(state, azimuth, arm),
                Quantity::Height => up(position(state, azimuth, arm)),
                Quantity::VelocityNed => velocity(state, azimuth, arm),
                Quantity::Attitude => Sensed { value: [state.angle; 3], slope: [[1.0, 0.0, 0.0]; 3] },
                Quantity::AngularRate => angular_rate(state, azimuth, None),
                Quantity::SpecificForce => specific_force(state, arm, self.around.gravity_mps2),
                Quantity::MagneticField | Quantity::MagneticDirection => magnetic_field(state, azimuth, field?),
                Quantity::EncoderCount | Quantity::EncoderAngle | Quantity::Pulse | Quantity::Scalar => return None,
            })
        };
        let mut values = Vec::with_capacity(self.grid.len());
        let mut slope = Vec::with_capacity(self.grid.len());
        let mut spread = Vec::with_capacity(self.grid.len());
        for t in &self.grid {
            let reading = sensed(&self.motion.at(*t)?)?;
            values.push(reading.value[component]);
            slope.push(reading.slope[component]);
            spread.push(reading.standard_deviation(&self.motion.covariance_at(*t)?)[component]);
        }
        let uncertainty = signal::median_in_place(&mut spread).unwrap_or(0.0);
        Some(Curve { values, slope, uncertainty, unit_gain: false })
    }

    /// The field of the reference; a direction has length one.
    fn field(&self, quantity: Quantity) -> Option<[f64; 3]> {
        let field = self.around.field_t?;
        if quantity != Quantity::MagneticDirection {
            return Some(field);
        }
        let size = field.iter().map(|b| b * b).sum::<f64>().sqrt();
        (size > 0.0).then(|| field.map(|b| b / size))
    }

    /// Each axis as the combination of 1, sin ξ and cos ξ that fits it best at its own delay, or at its own delay and
    /// lag: valid for any field, iron and mount.
    fn fitted_field(&self, name: &str, channel: &Channel, rows: &SensorRows) -> Vec<Option<Curve>> {
        let none = || rows.columns.iter().map(|_| None).collect();
        let samples = update_samples(channel, rows, self.motion.origin());
        let delay = self.alignment.coarse_delay_s.get(name).copied().unwrap_or(0.0);
        let Some(fit) = fit_at(self.motion, &samples, Pattern::Circle, delay) else { return none() };
        let turns: Option<Vec<(f64, f64)>> =
            self.grid.iter().map(|t| Some(self.motion.at(*t)?.angle.sin_cos())).collect();
        let Some(turns) = turns else { return none() };
        let (sine, cosine): (Vec<f64>, Vec<f64>) = turns.iter().copied().unzip();
        let behind_lag = || {
            let spline = |values: &[f64]| CubicSpline::new(&self.grid, values).ok();
            let turning = Turning { sine: spline(&sine)?, cosine: spline(&cosine)? };
            coefficients_behind_lag(&turning, &samples.of_rows(&fit.rows), delay)
        };
        let plain = || fit.fits.iter().map(|f| f.coefficients.clone().try_into().ok()).collect();
        let Some(coefficients) = behind_lag().or_else(plain) else { return none() };
        let angle_u = self.motion.typical_uncertainty()[0];
        let curve = |[offset, sine, cosine]: [f64; 3]| {
            let at = |(s, c): &(f64, f64)| (offset + sine * s + cosine * c, [sine * c - cosine * s, 0.0, 0.0]);
            let (values, slope) = turns.iter().map(at).unzip();
            Some(Curve { values, slope, uncertainty: angle_u * sine.hypot(cosine), unit_gain: true })
        };
        coefficients.into_iter().map(curve).collect()
    }
}

fn up(down: Sensed) -> Sensed {
    Sensed { value: down.value.map(|v| -v), slope: down.slope.map(|row| row.map(|v| -v)) }
}

fn may_drift(quantity: Quantity) -> bool {
    matches!(quantity, Quantity::PositionGeodetic | Quantity::PositionNed | Quantity::VelocityNed | Quantity::Height)
}

fn rms_about_mean(values: &[f64]) -> f64 {
    let n = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / n;
    (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt()
}

/// Decides for each component whether the swing moves it enough.
fn judge_excitation(quantity: Quantity, components: &mut [ComponentReference]) {
    let liveliest = components.iter().map(|c| c.reference_rms).fold(0.0, f64::max);
    for component in components {
        let (rms, u) = (component.reference_rms, component.uncertainty);
        let over = |what: f64| rms < what;
        component.excited = if liveliest == 0.0 || rms == 0.0 {
            Err("a planar swing does not move it at all".to_owned())
        } else if over(LEAST_OVER_UNCERTAINTY * u) {
            Err(format!(
                "the swing moves it by {rms:.2e} {} rms, but its reference is uncertain by {u:.1e}",
                component.unit
            ))
        } else if over(LEAST_SHARE * liveliest) {
            Err(weak(quantity, &component.name, rms / liveliest))
        } else {
            Ok(())
        };
    }
}

fn weak(quantity: Quantity, component: &str, share: f64) -> String {
    let percent = 100.0 * share;
    if quantity == Quantity::SpecificForce && component == "x" {
        return format!(
            "its signal is {percent:.1} % of that of the liveliest axis: a freely swinging pendulum has no tangential \
             specific force; push it away from its natural frequency"
        );
    }
    format!("its signal is {percent:.1} % of that of the liveliest component: it may be leakage from there")
}
