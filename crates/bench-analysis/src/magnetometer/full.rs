//! The full fit: hard and soft iron of all axes together with the field's direction.

use super::azimuths::{FULL, distinct, lacking};
use super::{Ellipse, MagneticSwing, expected};
use crate::alignment::estimate;
use crate::kinematics::{BarState, magnetic_field, wrapped};
use crate::surroundings::Surroundings;
use nalgebra::{Matrix2, Matrix3};
use record::{Estimate, Finding, IronCalibration, MagnetometerFinding};
use signal::{Regression, regress};

/// Number of rows used by the fit.
const ROWS: usize = 3000;
const MOST_STEPS: usize = 30;
/// Standard uncertainty of an azimuth stated in the rig file (0.5°).
const STATED_RAD: f64 = 0.0087;
/// Soft iron more uncertain than this is unknown, and so is hard iron more uncertain than this share of the field.
const WORST: f64 = 0.05;
const DECLINATION: usize = 12;
const DIP: usize = 13;

/// Why there is no full fit.
pub(super) enum NotFull {
    /// The azimuths do not determine it; the result within a plane remains valid.
    Lacking(String),
    /// No real sensor reads like this.
    Impossible(String),
}

impl NotFull {
    pub(super) fn why(self) -> String {
        match self {
            NotFull::Lacking(why) | NotFull::Impossible(why) => why,
        }
    }
}

/// The sensor's effect on the field, and its uncertainty.
pub(super) struct FullFit {
    /// S including the strength of the field.
    soft: Matrix3<f64>,
    hard: [f64; 3],
    direction: Direction,
    /// Of S row by row, h, declination and dip: noise and azimuths.
    covariance: Vec<Vec<f64>>,
    condition: f64,
    residual_rms: f64,
    /// Largest mean of the residuals of one axis in one swing.
    swings_apart: f64,
    /// Number of azimuths used in the fit.
    azimuths: usize,
    /// Whether the rig file states one of them.
    is_stated: bool,
}

/// 14 unknowns: S row by row, h, declination and dip (Gauss–Newton; all but the last two enter linearly). A rotation of
/// all azimuths together is a declination; an error of a single azimuth widens the stated uncertainty.
///
/// Performance (simulated records of 12 s, 0.2 µT of white noise, iron of 25 µT and 5 %): at 30°, 75°, 165°, 308° the
/// stated uncertainty is 0.03 µT for the hard iron and 0.001 for the soft iron, with azimuths fitted from a velocity;
/// rms error over stated 0.75 to 1.01, 96 to 99 % of 200 trials within k = 2. With azimuths stated 0.5° wrong
/// (Gaussian) 0.13 µT and 0.004, 0.72 to 1.06 and 96 to 100 %. `tests/it/iron.rs` checks single trials.
///
/// # Errors
/// The azimuths are too few or too close to each other, with those that would help; or the axes are mirrored.
pub(super) fn full(swings: &[MagneticSwing]) -> Result<FullFit, NotFull> {
    let azimuths = distinct(swings);
    if azimuths < FULL {
        return Err(NotFull::Lacking(lacking(swings)));
    }
    let lacking_because = |why: String| NotFull::Lacking(format!("{why}: {}", lacking(swings)));
    let rows = Rows::of(swings);
    let mut direction = first_guess(swings).map_err(lacking_because)?;
    let mut soft = linear_soft_iron(&rows, direction).map_err(lacking_because)?;
    let mut fit = linearised(&rows, direction, &soft).map_err(lacking_because)?;
    for _ in 0..MOST_STEPS {
        let [by_declination, by_dip] = [DECLINATION, DIP].map(|k| fit.coefficients[k].clamp(-0.3, 0.3));
        direction.declination += by_declination;
        direction.dip += by_dip;
        soft = linear_soft_iron(&rows, direction).map_err(lacking_because)?;
        fit = linearised(&rows, direction, &soft).map_err(lacking_because)?;
        if by_declination.hypot(by_dip) < 1e-10 {
            break;
        }
    }
    if soft.determinant() <= 0.0 {
        let why = "the axes of the magnetometer are not right-handed: look at `axes` of its mount";
        return Err(NotFull::Impossible(why.to_owned()));
    }
    let found = FullFit {
        hard: [0, 1, 2].map(|axis| fit.coefficients[9 + axis]),
        covariance: with_azimuths(&fit, &rows, direction, &soft, swings).map_err(lacking_because)?,
        condition: fit.condition,
        residual_rms: (fit.residuals.iter().map(|r| r * r).sum::<f64>() / fit.residuals.len().max(1) as f64).sqrt(),
        swings_apart: swings_apart(&fit.residuals, &rows),
        soft,
        direction,
        azimuths,
        is_stated: swings.iter().any(|s| s.azimuth.standard_uncertainty.is_none()),
    };
    found.known_well_enough().map_err(lacking_because)?;
    Ok(found)
}

/// The covariance of the fit including the errors of the azimuths: to first order an azimuth error moves the solution
/// as the regression of its effect on the unknowns.
fn with_azimuths(
    fit: &Regression,
    rows: &Rows,
    direction: Direction,
    soft: &Matrix3<f64>,
    swings: &[MagneticSwing],
) -> Result<Vec<Vec<f64>>, String> {
    let mut covariance = fit.covariance.clone();
    let columns = columns(rows, direction, soft);
    let columns: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
    let [north, east, _] = direction.ned();
    let turning = rows.in_body([east, -north, 0.0]);
    for (k, swing) in swings.iter().enumerate() {
        let u = swing.azimuth.standard_uncertainty.unwrap_or(STATED_RAD);
        let effect: Vec<f64> = (0..3)
            .flat_map(|axis| {
                let of_row = move |(row, by): (usize, &[f64; 3])| {
                    let moved = (0..3).map(|c| soft[(axis, c)] * by[c]).sum::<f64>();
                    if rows.swing[row] == k { moved } else { 0.0 }
                };
                turning.iter().enumerate().map(of_row)
            })
            .collect();
        let moved = regress(&columns, &NAMES, &effect).map_err(|e| e.to_string())?.coefficients;
        for (i, row) in covariance.iter_mut().enumerate() {
            for (j, cell) in row.iter_mut().enumerate() {
                *cell += moved[i] * moved[j] * u * u;
            }
        }
    }
    Ok(covariance)
}

/// Largest mean residual of an axis in a swing: what the swings do not have in common.
fn swings_apart(residuals: &[f64], rows: &Rows) -> f64 {
    let n = rows.swing.len();
    let mean = |axis: usize, swing: usize| {
        let own = || (0..n).filter(|&row| rows.swing[row] == swing);
        own().map(|row| residuals[axis * n + row]).sum::<f64>() / own().count().max(1) as f64
    };
    let swings = rows.swing.last().map_or(0, |last| last + 1);
    (0..3).flat_map(|axis| (0..swings).map(move |swing| mean(axis, swing).abs())).fold(0.0, f64::max)
}

impl FullFit {
    fn scale(&self) -> f64 {
        self.soft.determinant().cbrt()
    }

    fn u(&self, unknown: usize) -> f64 {
        self.covariance[unknown][unknown].max(0.0).sqrt()
    }

    /// Standard uncertainty of a quantity with this slope in the nine numbers of S.
    fn u_of_soft(&self, slope: impl Fn(usize) -> f64) -> f64 {
        let slope: Vec<f64> = (0..9).map(slope).collect();
        let variance = (0..9).flat_map(|i| (0..9).map(move |j| (i, j)));
        variance.map(|(i, j)| slope[i] * slope[j] * self.covariance[i][j]).sum::<f64>().max(0.0).sqrt()
    }

    /// Slope of the scale in the nine numbers of S: d(det S)/dS = det S · S⁻ᵀ, and the scale is its cube root.
    fn scale_slope(&self) -> [f64; 9] {
        let scale = self.scale();
        // Its determinant is above zero.
        let inverse = self.soft.try_inverse().unwrap_or_else(Matrix3::zeros);
        std::array::from_fn(|k| scale / 3.0 * inverse[(k % 3, k / 3)])
    }

    fn shape(&self) -> [[f64; 3]; 3] {
        [0, 1, 2].map(|r| [0, 1, 2].map(|c| self.soft[(r, c)] / self.scale()))
    }

    fn shape_u(&self) -> [[f64; 3]; 3] {
        let (scale, by_scale) = (self.scale(), self.scale_slope());
        [0, 1, 2].map(|r| {
            [0, 1, 2].map(|c| {
                let own = |k: usize| if k == 3 * r + c { 1.0 } else { 0.0 };
                self.u_of_soft(|k| (own(k) - self.soft[(r, c)] / scale * by_scale[k]) / scale)
            })
        })
    }

    fn known_well_enough(&self) -> Result<(), String> {
        let soft = self.shape_u().into_iter().flatten().fold(0.0, f64::max);
        let hard = (9..12).map(|k| self.u(k)).fold(0.0, f64::max) / self.scale();
        if soft <= WORST && hard <= WORST {
            return Ok(());
        }
        Err(format!(
            "soft iron would be known to ±{soft:.2} and hard iron to ±{hard:.2} of the field (k = 1), {WORST} is needed"
        ))
    }

    /// Magnitude of the field divided by that of the model.
    fn magnitude_ratio(&self, swings: &[MagneticSwing], around: &Surroundings) -> Option<Estimate> {
        let model = expected(around).filter(|_| swings.iter().all(|s| s.is_tesla))?;
        let slope = self.scale_slope();
        Some(estimate(self.scale() / model.norm(), self.u_of_soft(|k| slope[k]) / model.norm()))
    }

    fn text(&self, swings: &[MagneticSwing]) -> String {
        let stated = if self.is_stated {
            " Azimuths stated in the rig file are assumed to be accurate to 0.5° (k = 1)."
        } else {
            ""
        };
        format!(
            "From {} swings at {} azimuths: hard and soft iron of all axes, with the direction of the field \
             (declination {}°, dip {}°) fitted too; the soft iron is scaled to determinant one. The mean of a swing \
             differs from the common fit by at most {:.2} times the rms of the residuals. Uncertainties cover noise \
             and azimuths.{stated}",
            swings.len(),
            self.azimuths,
            flight::fixed(wrapped(self.direction.declination).to_degrees(), 2),
            flight::fixed(self.direction.dip.to_degrees(), 2),
            self.swings_apart / self.residual_rms.max(f64::MIN_POSITIVE),
        )
    }

    pub(super) fn finding(&self, swings: &[MagneticSwing], around: &Surroundings) -> MagnetometerFinding {
        let dip_error_rad = expected(around).map(|b| {
            let model = b.z.atan2(b.x.hypot(b.y));
            estimate(self.direction.dip - model, self.u(DIP))
        });
        MagnetometerFinding {
            kind: "full".to_owned(),
            azimuths: self.azimuths as u64,
            hard_iron: [0, 1, 2].map(|k| Finding::Found(estimate(self.hard[k], self.u(9 + k)))),
            soft_iron: self.shape().to_vec(),
            soft_iron_standard_uncertainty: self.shape_u().to_vec(),
            condition: Some(self.condition),
            residual_rms: self.residual_rms,
            magnitude_ratio: self.magnitude_ratio(swings, around),
            dip_error_rad,
            text: self.text(swings),
        }
    }

    pub(super) fn calibration(&self, swings: &[MagneticSwing], around: &Surroundings) -> IronCalibration {
        let ratio = self.magnitude_ratio(swings, around);
        IronCalibration {
            hard_iron: self.hard,
            hard_iron_standard_uncertainty: [9, 10, 11].map(|k| self.u(k)),
            soft_iron: self.shape(),
            soft_iron_standard_uncertainty: self.shape_u(),
            scale: ratio.map(|r| r.value),
            scale_standard_uncertainty: ratio.and_then(|r| r.standard_uncertainty),
            residual_rms: self.residual_rms,
            condition: self.condition,
            text: self.text(swings),
        }
    }
}

/// Rows of all swings, thinned evenly.
struct Rows {
    /// Swing index of each row, rising.
    swing: Vec<usize>,
    /// Azimuth and angle.
    pose: Vec<(f64, f64)>,
    field: [Vec<f64>; 3],
}

impl Rows {
    fn of(swings: &[MagneticSwing]) -> Rows {
        let total: usize = swings.iter().map(|s| s.angle_rad.len()).sum();
        let stride = total.div_ceil(ROWS).max(1);
        let mut rows = Rows { swing: vec![], pose: vec![], field: [vec![], vec![], vec![]] };
        for (k, swing) in swings.iter().enumerate() {
            for row in (0..swing.angle_rad.len()).step_by(stride) {
                rows.swing.push(k);
                rows.pose.push((swing.azimuth.value, swing.angle_rad[row]));
                for (all, own) in rows.field.iter_mut().zip(&swing.field) {
                    all.push(own[row]);
                }
            }
        }
        rows
    }

    /// `Cᵀ b` for each row.
    fn in_body(&self, ned: [f64; 3]) -> Vec<[f64; 3]> {
        let state = |angle: f64| BarState { angle, ..BarState::default() };
        self.pose.iter().map(|(azimuth, angle)| magnetic_field(&state(*angle), *azimuth, ned).value).collect()
    }
}

/// Declination and dip of a unit field.
#[derive(Debug, Clone, Copy)]
struct Direction {
    declination: f64,
    dip: f64,
}

impl Direction {
    fn ned(self) -> [f64; 3] {
        let ((sd, cd), (si, ci)) = (self.declination.sin_cos(), self.dip.sin_cos());
        [ci * cd, ci * sd, si]
    }

    fn by_declination(self) -> [f64; 3] {
        let ((sd, cd), ci) = (self.declination.sin_cos(), self.dip.cos());
        [-ci * sd, ci * cd, 0.0]
    }

    fn by_dip(self) -> [f64; 3] {
        let ((sd, cd), (si, ci)) = (self.declination.sin_cos(), self.dip.sin_cos());
        [-si * cd, -si * sd, ci]
    }
}

/// Direction of the field assuming perfect sensors: the start of the fit.
fn first_guess(swings: &[MagneticSwing]) -> Result<Direction, String> {
    let (mut cosine, mut sine, mut along, mut down) = (vec![], vec![], vec![], 0.0);
    for swing in swings {
        let (a, d) = Ellipse::of(swing)?.field();
        cosine.push(swing.azimuth.value.cos());
        sine.push(swing.azimuth.value.sin());
        along.push(a);
        down += d / swings.len() as f64;
    }
    // along = H cos(D − η) = north cos η + east sin η
    let normal = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let m =
        Matrix2::new(normal(&cosine, &cosine), normal(&cosine, &sine), normal(&cosine, &sine), normal(&sine, &sine));
    let right = nalgebra::Vector2::new(normal(&cosine, &along), normal(&sine, &along));
    let horizontal = m.try_inverse().ok_or("the azimuths are all alike")? * right;
    Ok(Direction { declination: horizontal.y.atan2(horizontal.x), dip: down.atan2(horizontal.norm()) })
}

/// S for a given direction: regression of each axis on 1 and the field in body axes.
fn linear_soft_iron(rows: &Rows, direction: Direction) -> Result<Matrix3<f64>, String> {
    let body = rows.in_body(direction.ned());
    let one = vec![1.0; body.len()];
    let column = |k: usize| body.iter().map(|u| u[k]).collect::<Vec<f64>>();
    let (x, y, z) = (column(0), column(1), column(2));
    let mut soft = Matrix3::zeros();
    for (axis, measured) in rows.field.iter().enumerate() {
        let fit = regress(&[&one, &x, &y, &z], &["hard iron", "x", "y", "z"], measured).map_err(|e| e.to_string())?;
        for k in 0..3 {
            soft[(axis, k)] = fit.coefficients[k + 1];
        }
    }
    Ok(soft)
}

const NAMES: [&str; 14] =
    ["xx", "xy", "xz", "yx", "yy", "yz", "zx", "zy", "zz", "hx", "hy", "hz", "declination", "dip"];

/// Regression of all stacked axes on all unknowns; those of the direction are small changes.
fn linearised(rows: &Rows, direction: Direction, soft: &Matrix3<f64>) -> Result<Regression, String> {
    let columns = columns(rows, direction, soft);
    let columns: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
    regress(&columns, &NAMES, &rows.field.concat()).map_err(|e| e.to_string())
}

fn columns(rows: &Rows, direction: Direction, soft: &Matrix3<f64>) -> Vec<Vec<f64>> {
    let n = rows.pose.len();
    let body = rows.in_body(direction.ned());
    let turned = [direction.by_declination(), direction.by_dip()].map(|slope| rows.in_body(slope));
    let mut columns = vec![vec![0.0; 3 * n]; 14];
    for axis in 0..3 {
        for row in 0..n {
            let place = axis * n + row;
            for k in 0..3 {
                columns[3 * axis + k][place] = body[row][k];
            }
            columns[9 + axis][place] = 1.0;
            for (which, slope) in turned.iter().enumerate() {
                columns[DECLINATION + which][place] = (0..3).map(|k| soft[(axis, k)] * slope[row][k]).sum();
            }
        }
    }
    columns
}
