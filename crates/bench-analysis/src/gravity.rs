//! Gravity of the ellipsoid.

use flight::{WGS84_A, WGS84_E2, WGS84_F};

/// Gravity at the equator, m/s² (WGS 84, NIMA TR8350.2).
const EQUATOR_MPS2: f64 = 9.780_325_335_9;
/// Somigliana's constant.
const SOMIGLIANA: f64 = 0.001_931_852_652_41;
/// ω²a²b/GM.
const CENTRIFUGAL: f64 = 0.003_449_786_506_84;

/// Standard gravity, m/s²: the default without a site.
pub const STANDARD_GRAVITY_MPS2: f64 = 9.806_65;

/// Normal gravity at geodetic `latitude` (rad) and `height` above the ellipsoid (m), m/s²: Somigliana's closed form and
/// the second-order free-air correction (design note 1.6). It excludes the local anomaly, up to about 5e-4 m/s².
#[must_use]
pub fn normal_gravity(latitude: f64, height: f64) -> f64 {
    let s2 = latitude.sin().powi(2);
    let surface = EQUATOR_MPS2 * (1.0 + SOMIGLIANA * s2) / (1.0 - WGS84_E2 * s2).sqrt();
    let linear = 2.0 / WGS84_A * (1.0 + WGS84_F + CENTRIFUGAL - 2.0 * WGS84_F * s2) * height;
    surface * (1.0 - linear + 3.0 * (height / WGS84_A).powi(2))
}
