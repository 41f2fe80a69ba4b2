//! Hard and soft iron of a magnetometer, as far as the azimuths of the swings determine them (design note 1.6, 9).
//!
//! The sensor reads `m = S Cᵀ b + h`: field b, soft iron and scale S, hard iron h. One azimuth only shows how m moves
//! in the swing's plane: the effect of the field across the plane through S looks like hard iron.

mod azimuths;
mod full;
mod swings;

use crate::alignment::estimate;
use crate::kinematics::wrapped;
use crate::surroundings::Surroundings;
use azimuths::distinct;
use full::NotFull;
use nalgebra::{Matrix2, Vector3};
use record::{Estimate, Finding, IronCalibration, MagnetometerFinding};
use signal::{Regression, regress};

pub(crate) use swings::magnetic_swings;

/// A magnetometer over one swing: the bar's angle at the true instant of each row, and the rows in body axes.
#[derive(Debug, Clone, PartialEq)]
pub struct MagneticSwing {
    /// Name of the channel.
    pub channel: String,
    /// Azimuth of the swing's plane, rad; without uncertainty if the rig file states it.
    pub azimuth: Estimate,
    /// Bar angle, rad.
    pub angle_rad: Vec<f64>,
    /// x, y, z in the channel's unit; each as long as the angles.
    pub field: [Vec<f64>; 3],
    /// Whether the unit is tesla; otherwise a sensor-specific scale.
    pub is_tesla: bool,
}

/// Calibrates one magnetometer from one or more swings: in full if their azimuths allow it (three or more; a swing
/// there and back the other way round counts as two), otherwise within the plane.
#[must_use]
pub fn calibrate_magnetometer(swings: &[MagneticSwing], around: &Surroundings) -> Finding<MagnetometerFinding> {
    if swings.is_empty() {
        return Finding::CannotTell("no magnetometer follows the swing at a known azimuth".to_owned());
    }
    let found = match full::full(swings) {
        Ok(fit) => Ok(fit.finding(swings, around)),
        Err(NotFull::Lacking(why)) => planar(swings, around, &why),
        Err(NotFull::Impossible(why)) => Err(why),
    };
    found.map_or_else(Finding::CannotTell, Finding::Found)
}

/// Hard and soft iron of all axes.
///
/// # Errors
/// The azimuths do not determine it, and which would; or the axes cannot be right.
pub(crate) fn iron(swings: &[MagneticSwing], around: &Surroundings) -> Result<IronCalibration, String> {
    let fit = full::full(swings).map_err(NotFull::why)?;
    Ok(fit.calibration(swings, around))
}

/// The field for comparison, T.
pub(crate) fn expected(around: &Surroundings) -> Option<Vector3<f64>> {
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

    /// The best field along the plane and down if the sensor is perfect up to its scale.
    fn field(&self) -> (f64, f64) {
        let ([_, x_cos, x_sin], [_, z_cos, z_sin]) = (self.axis(0), self.axis(2));
        (0.5 * (x_cos + z_sin), 0.5 * (z_cos - x_sin))
    }

    /// Variances of [`Ellipse::field`], axes assumed independent.
    fn field_variance(&self) -> (f64, f64) {
        let v = |axis: usize, k: usize| self.axes[axis].covariance[k][k];
        (0.25 * (v(0, 1) + v(2, 2)), 0.25 * (v(2, 1) + v(0, 2)))
    }

    fn residual_ms(&self) -> f64 {
        let squares: f64 = self.axes.iter().flat_map(|a| &a.residuals).map(|r| r * r).sum();
        squares / self.axes.iter().map(|a| a.residuals.len()).sum::<usize>().max(1) as f64
    }
}

/// `why` states the reason for the limited result.
fn planar(swings: &[MagneticSwing], around: &Surroundings, why: &str) -> Result<MagnetometerFinding, String> {
    let azimuths = distinct(swings);
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
    let why_y = "a planar swing does not change the field along its axis of rotation: swing in three azimuths or more";
    let model = expected(around).map(|b| in_plane(b, swing.azimuth.value));
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
        soft_iron_standard_uncertainty: vec![],
        condition: None,
        residual_rms: ellipse.residual_ms().sqrt(),
        magnitude_ratio,
        dip_error_rad: None,
        text: planar_text(azimuths, turned, why),
    })
}

fn planar_text(azimuths: usize, turned_deg: Option<f64>, why: &str) -> String {
    let turned = turned_deg
        .map_or(String::new(), |deg| format!(" In the plane the field points {deg:.1}° away from the model's."));
    let have = if azimuths == 1 { "one azimuth".to_owned() } else { format!("{azimuths} azimuths") };
    format!(
        "From {have}: hard iron of x and z is right if no soft iron couples them with y; the middle row and column of \
         the soft iron are assumed. The rest is unknown: {why}.{turned}"
    )
}

/// Field along the plane and down.
fn in_plane(ned: Vector3<f64>, azimuth: f64) -> (f64, f64) {
    let (s, c) = azimuth.sin_cos();
    (c * ned.x + s * ned.y, ned.z)
}
