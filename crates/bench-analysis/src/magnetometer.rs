//! Hard and soft iron of a magnetometer, as far as the azimuths of the swings show them (design note 1.6, 9).
//!
//! The sensor reads `m = S Cᵀ b + h`: field b, soft iron and scale S, hard iron h. One azimuth shows how m moves in the
//! swing's plane, and no more: what the field across the plane does through S looks like hard iron.

use crate::alignment::{Alignment, estimate};
use crate::kinematics::{BarState, magnetic_field, wrapped};
use crate::motion::Motion;
use crate::pattern::Samples;
use crate::rig::Rig;
use crate::sensor_rows::{sensor_rows, update_samples};
use crate::surroundings::Surroundings;
use flight::{Channel, Quantity};
use nalgebra::{Matrix2, Matrix3, Vector3};
use record::{Finding, MagnetometerFinding};
use signal::{Regression, regress};

/// Azimuths closer than this are one (10°).
const DISTINCT_RAD: f64 = 0.175;
/// Fewest azimuths for a full fit.
const FULL: usize = 3;
/// Rows that the full fit looks at.
const FULL_ROWS: usize = 3000;
/// Fewer rows of a swing show nothing.
const LEAST_ROWS: usize = 50;
const MOST_STEPS: usize = 30;

/// A magnetometer over one swing: the bar's angle at the time when each row was true, and the rows in body axes.
#[derive(Debug, Clone, PartialEq)]
pub struct MagneticSwing {
    /// Azimuth of the swing's plane, rad.
    pub azimuth_rad: f64,
    /// Bar angle, rad.
    pub angle_rad: Vec<f64>,
    /// x, y, z in the channel's unit; each as long as the angles.
    pub field: [Vec<f64>; 3],
    /// Whether the unit is tesla; else a scale of the sensor's own.
    pub is_tesla: bool,
}

impl MagneticSwing {
    /// The channel `name` over one swing, its delay taken out. `None` if it is no magnetometer with three axes, shows
    /// nothing of the swing, or the azimuth is not known.
    #[must_use]
    pub fn of(
        name: &str,
        channel: &Channel,
        motion: &Motion,
        rig: &Rig,
        alignment: &Alignment,
    ) -> Option<MagneticSwing> {
        if !matches!(channel.quantity, Quantity::MagneticField | Quantity::MagneticDirection) {
            return None;
        }
        let delay = *alignment.coarse_delay_s.get(name)?;
        let samples = update_samples(channel, &sensor_rows(name, channel, rig)?, motion.origin());
        MagneticSwing::from_samples(&samples, motion, delay, alignment.azimuth_rad?.value, channel.quantity)
    }

    fn from_samples(
        samples: &Samples,
        motion: &Motion,
        delay_s: f64,
        azimuth_rad: f64,
        quantity: Quantity,
    ) -> Option<MagneticSwing> {
        let [x, y, z] = &samples.components[..] else { return None };
        let (rows, angle_rad): (Vec<usize>, Vec<f64>) =
            samples.t.iter().enumerate().filter_map(|(row, t)| Some((row, motion.at(t - delay_s)?.angle))).unzip();
        let taken = |column: &[f64]| rows.iter().map(|&row| column[row]).collect();
        (rows.len() >= LEAST_ROWS).then(|| MagneticSwing {
            azimuth_rad,
            angle_rad,
            field: [taken(x), taken(y), taken(z)],
            is_tesla: quantity == Quantity::MagneticField,
        })
    }
}

/// Calibrates one magnetometer from one or more swings: in full with three azimuths or more (a swing there and back
/// the other way round counts as two), else within the plane.
#[must_use]
pub fn calibrate_magnetometer(swings: &[MagneticSwing], around: &Surroundings) -> Finding<MagnetometerFinding> {
    let azimuths = distinct(swings);
    let found = match swings {
        [] => return Finding::CannotTell("no magnetometer follows the swing at a known azimuth".to_owned()),
        _ if azimuths >= FULL => full(swings, azimuths, around),
        _ => planar(swings, azimuths, around),
    };
    found.map_or_else(Finding::CannotTell, Finding::Found)
}

/// How many azimuths differ by more than ten degrees.
fn distinct(swings: &[MagneticSwing]) -> usize {
    let mut kept: Vec<f64> = vec![];
    for swing in swings {
        if kept.iter().all(|k| wrapped(swing.azimuth_rad - k).abs() > DISTINCT_RAD) {
            kept.push(swing.azimuth_rad);
        }
    }
    kept.len()
}

/// The field to compare with, T.
fn expected(around: &Surroundings) -> Option<Vector3<f64>> {
    around.field_t.or(around.model.as_ref().map(|m| m.ned_t)).map(Vector3::from)
}

/// Each axis on 1, cos ξ, sin ξ.
struct Ellipse {
    axes: [Regression; 3],
}

impl Ellipse {
    fn of(swing: &MagneticSwing) -> Result<Ellipse, String> {
        let one = vec![1.0; swing.angle_rad.len()];
        let cosine: Vec<f64> = swing.angle_rad.iter().map(|a| a.cos()).collect();
        let sine: Vec<f64> = swing.angle_rad.iter().map(|a| a.sin()).collect();
        let axis = |k: usize| {
            regress(&[&one, &cosine, &sine], &["offset", "cosine", "sine"], &swing.field[k]).map_err(|e| e.to_string())
        };
        Ok(Ellipse { axes: [axis(0)?, axis(1)?, axis(2)?] })
    }

    /// Coefficients of 1, cos, sin of an axis.
    fn axis(&self, k: usize) -> [f64; 3] {
        let c = &self.axes[k].coefficients;
        [c[0], c[1], c[2]]
    }

    /// The field along the plane and down that fits best if the sensor is perfect up to its scale.
    fn field(&self) -> (f64, f64) {
        let ([_, x_cos, x_sin], [_, z_cos, z_sin]) = (self.axis(0), self.axis(2));
        (0.5 * (x_cos + z_sin), 0.5 * (z_cos - x_sin))
    }

    /// Variances of [`Ellipse::field`], axes taken as independent.
    fn field_variance(&self) -> (f64, f64) {
        let v = |axis: usize, k: usize| self.axes[axis].covariance[k][k];
        (0.25 * (v(0, 1) + v(2, 2)), 0.25 * (v(2, 1) + v(0, 2)))
    }

    fn residual_ms(&self) -> f64 {
        let squares: f64 = self.axes.iter().flat_map(|a| &a.residuals).map(|r| r * r).sum();
        squares / self.axes.iter().map(|a| a.residuals.len()).sum::<usize>().max(1) as f64
    }
}

fn planar(swings: &[MagneticSwing], azimuths: usize, around: &Surroundings) -> Result<MagnetometerFinding, String> {
    let swing = swings.iter().max_by_key(|s| s.angle_rad.len()).ok_or("no swing")?;
    let ellipse = Ellipse::of(swing)?;
    let (along, down) = ellipse.field();
    let size = along.hypot(down);
    if size <= 0.0 {
        return Err("the magnetometer does not move with the swing".to_owned());
    }
    let ([x_0, x_cos, x_sin], [z_0, z_cos, z_sin]) = (ellipse.axis(0), ellipse.axis(2));
    let moved = Matrix2::new(x_cos, x_sin, z_cos, z_sin);
    let perfect_inverse = Matrix2::new(along, down, -down, along) / (size * size);
    let soft = moved * perfect_inverse;
    let hard = |value: f64, axis: usize| Finding::Found(estimate(value, ellipse.axes[axis].standard_uncertainty(0)));
    let why_y = "the axis of rotation keeps one field throughout a planar swing: swing in three azimuths or more";
    let model = expected(around).map(|b| in_plane(b, swing.azimuth_rad));
    let magnitude_ratio = model.filter(|_| swing.is_tesla).map(|(a, d)| {
        let expected = a.hypot(d);
        let (va, vd) = ellipse.field_variance();
        let u = (along * along * va + down * down * vd).sqrt() / size;
        estimate(size / expected, u / expected)
    });
    let turned = model.map(|(a, d)| wrapped(down.atan2(along) - d.atan2(a)).to_degrees());
    Ok(MagnetometerFinding {
        kind: "planar".to_owned(),
        azimuths: azimuths as u64,
        hard_iron: [hard(x_0, 0), Finding::CannotTell(why_y.to_owned()), hard(z_0, 2)],
        soft_iron: vec![[soft[(0, 0)], 0.0, soft[(0, 1)]], [0.0, 1.0, 0.0], [soft[(1, 0)], 0.0, soft[(1, 1)]]],
        residual_rms: ellipse.residual_ms().sqrt(),
        magnitude_ratio,
        dip_error_rad: None,
        text: planar_text(azimuths, turned),
    })
}

fn planar_text(azimuths: usize, turned_deg: Option<f64>) -> String {
    let turned = turned_deg
        .map_or(String::new(), |deg| format!(" In the plane the field points {deg:.1}° away from the model's."));
    let have = if azimuths == 1 { "one azimuth".to_owned() } else { format!("{azimuths} azimuths") };
    format!(
        "From {have}: hard iron of x and z is right if no soft iron couples them with y; the middle row and column of \
         the soft iron are assumed, three azimuths would show them.{turned}"
    )
}

/// Field along the plane and down.
fn in_plane(ned: Vector3<f64>, azimuth: f64) -> (f64, f64) {
    let (s, c) = azimuth.sin_cos();
    (c * ned.x + s * ned.y, ned.z)
}

/// Rows of all swings, thinned evenly.
struct Rows {
    /// Azimuth and angle.
    pose: Vec<(f64, f64)>,
    field: [Vec<f64>; 3],
}

impl Rows {
    fn of(swings: &[MagneticSwing]) -> Rows {
        let total: usize = swings.iter().map(|s| s.angle_rad.len()).sum();
        let stride = total.div_ceil(FULL_ROWS).max(1);
        let mut rows = Rows { pose: vec![], field: [vec![], vec![], vec![]] };
        for swing in swings {
            for row in (0..swing.angle_rad.len()).step_by(stride) {
                rows.pose.push((swing.azimuth_rad, swing.angle_rad[row]));
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

/// Direction of the field as perfect sensors would show it: where the fit starts.
fn first_guess(swings: &[MagneticSwing]) -> Result<Direction, String> {
    let (mut cosine, mut sine, mut along, mut down) = (vec![], vec![], vec![], 0.0);
    for swing in swings {
        let (a, d) = Ellipse::of(swing)?.field();
        cosine.push(swing.azimuth_rad.cos());
        sine.push(swing.azimuth_rad.sin());
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

/// 14 unknowns: S row by row, h, declination and dip (Gauss–Newton; all but the last two enter linearly).
fn full(swings: &[MagneticSwing], azimuths: usize, around: &Surroundings) -> Result<MagnetometerFinding, String> {
    let rows = Rows::of(swings);
    let mut direction = first_guess(swings)?;
    let mut soft = linear_soft_iron(&rows, direction)?;
    let mut fit = linearised(&rows, direction, &soft)?;
    for _ in 0..MOST_STEPS {
        let (by_declination, by_dip) = (fit.coefficients[12].clamp(-0.3, 0.3), fit.coefficients[13].clamp(-0.3, 0.3));
        direction.declination += by_declination;
        direction.dip += by_dip;
        soft = linear_soft_iron(&rows, direction)?;
        fit = linearised(&rows, direction, &soft)?;
        if by_declination.hypot(by_dip) < 1e-10 {
            break;
        }
    }
    describe(&fit, &soft, direction, swings, azimuths, around)
}

/// S for a given direction: each axis on 1 and the field in body axes.
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

/// All axes stacked on all unknowns, the direction's as small changes.
fn linearised(rows: &Rows, direction: Direction, soft: &Matrix3<f64>) -> Result<Regression, String> {
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
                columns[12 + which][place] = (0..3).map(|k| soft[(axis, k)] * slope[row][k]).sum();
            }
        }
    }
    let names = ["xx", "xy", "xz", "yx", "yy", "yz", "zx", "zy", "zz", "hx", "hy", "hz", "declination", "dip"];
    let columns: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
    regress(&columns, &names, &rows.field.concat()).map_err(|e| e.to_string())
}

fn describe(
    fit: &Regression,
    soft: &Matrix3<f64>,
    direction: Direction,
    swings: &[MagneticSwing],
    azimuths: usize,
    around: &Surroundings,
) -> Result<MagnetometerFinding, String> {
    let determinant = soft.determinant();
    if determinant <= 0.0 {
        return Err("the axes of the magnetometer are not right-handed: look at `axes` of its mount".to_owned());
    }
    let scale = determinant.cbrt();
    let hard = |axis: usize| Finding::Found(estimate(fit.coefficients[9 + axis], fit.standard_uncertainty(9 + axis)));
    let is_tesla = swings.iter().all(|s| s.is_tesla);
    let model = expected(around);
    let magnitude_ratio =
        model.filter(|_| is_tesla).map(|b| estimate(scale / b.norm(), scale_uncertainty(fit, soft, scale) / b.norm()));
    let dip_error_rad = model.map(|b| {
        let expected = b.z.atan2(b.x.hypot(b.y));
        estimate(direction.dip - expected, fit.standard_uncertainty(13))
    });
    let residual_ms = fit.residuals.iter().map(|r| r * r).sum::<f64>() / fit.residuals.len().max(1) as f64;
    Ok(MagnetometerFinding {
        kind: "full".to_owned(),
        azimuths: azimuths as u64,
        hard_iron: [hard(0), hard(1), hard(2)],
        soft_iron: (0..3).map(|r| [0, 1, 2].map(|c| soft[(r, c)] / scale)).collect(),
        residual_rms: residual_ms.sqrt(),
        magnitude_ratio,
        dip_error_rad,
        text: format!(
            "From {azimuths} azimuths: hard and soft iron of all axes, with the field's own direction (declination {:.2}°, dip \
             {:.2}°) fitted along; the soft iron is scaled to determinant one.",
            wrapped(direction.declination).to_degrees(),
            direction.dip.to_degrees()
        ),
    })
}

/// d(det S)/dS = det S · S⁻ᵀ, and the scale is its cube root.
fn scale_uncertainty(fit: &Regression, soft: &Matrix3<f64>, scale: f64) -> f64 {
    let Some(inverse) = soft.try_inverse() else { return f64::INFINITY };
    let gradient: Vec<f64> = (0..9).map(|k| scale / 3.0 * inverse[(k % 3, k / 3)]).collect();
    let variance: f64 =
        (0..9).map(|i| (0..9).map(|j| gradient[i] * gradient[j] * fit.covariance[i][j]).sum::<f64>()).sum();
    variance.max(0.0).sqrt()
}
