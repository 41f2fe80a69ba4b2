//! WGS-84: geodetic, earth-centred and local north-east-down coordinates, exact.

use nalgebra::{Matrix3, Vector3};
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Semi-major axis, m (WGS 84, NIMA TR8350.2).
pub const WGS84_A: f64 = 6_378_137.0;
/// Flattening.
pub const WGS84_F: f64 = 1.0 / 298.257_223_563;
/// First eccentricity squared.
pub const WGS84_E2: f64 = WGS84_F * (2.0 - WGS84_F);

/// Latitude rad, longitude rad, height above the ellipsoid m.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct Geodetic {
    /// Latitude, rad, positive north.
    pub latitude: f64,
    /// Longitude, rad, positive east.
    pub longitude: f64,
    /// Height above the ellipsoid, m.
    pub height: f64,
}

/// Earth-centred, earth-fixed coordinates, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ecef {
    /// Toward latitude 0, longitude 0.
    pub x: f64,
    /// Toward latitude 0, longitude 90° east.
    pub y: f64,
    /// Toward the north pole.
    pub z: f64,
}

impl Geodetic {
    /// From degrees and metres.
    #[must_use]
    pub fn from_degrees(latitude: f64, longitude: f64, height: f64) -> Geodetic {
        Geodetic { latitude: latitude.to_radians(), longitude: longitude.to_radians(), height }
    }

    /// Exact closed form.
    #[must_use]
    pub fn to_ecef(self) -> Ecef {
        let (sin_lat, cos_lat) = self.latitude.sin_cos();
        let (sin_lon, cos_lon) = self.longitude.sin_cos();
        let prime_vertical = WGS84_A / (1.0 - WGS84_E2 * sin_lat * sin_lat).sqrt();
        Ecef {
            x: (prime_vertical + self.height) * cos_lat * cos_lon,
            y: (prime_vertical + self.height) * cos_lat * sin_lon,
            z: (prime_vertical * (1.0 - WGS84_E2) + self.height) * sin_lat,
        }
    }
}

impl Ecef {
    /// Bowring's parametric latitude, iterated to the last bits; valid at the poles.
    #[must_use]
    pub fn to_geodetic(self) -> Geodetic {
        /// The first round is accurate to 1e-11 rad below 10 km (Bowring 1976); the test demands 10 nm up to 400 km.
        const ROUNDS: usize = 2;
        let semi_minor = WGS84_A * (1.0 - WGS84_F);
        let second_e2 = WGS84_E2 / (1.0 - WGS84_E2);
        let p = self.x.hypot(self.y);
        let longitude = self.y.atan2(self.x);
        let mut beta = (self.z * WGS84_A).atan2(p * semi_minor);
        let mut latitude = 0.0_f64;
        for _ in 0..ROUNDS {
            let (sin_b, cos_b) = beta.sin_cos();
            latitude = (self.z + second_e2 * semi_minor * sin_b.powi(3)).atan2(p - WGS84_E2 * WGS84_A * cos_b.powi(3));
            let (sin_lat, cos_lat) = latitude.sin_cos();
            beta = ((1.0 - WGS84_F) * sin_lat).atan2(cos_lat);
        }
        let (sin_lat, cos_lat) = latitude.sin_cos();
        let prime_vertical = WGS84_A / (1.0 - WGS84_E2 * sin_lat * sin_lat).sqrt();
        // Well conditioned everywhere, unlike p / cos(latitude) − N.
        let height = p * cos_lat + self.z * sin_lat - WGS84_A * WGS84_A / prime_vertical;
        Geodetic { latitude, longitude, height }
    }
}

/// The plane tangent to the ellipsoid at an origin: north, east, down.
///
/// This is the rigid local frame, so a long track curves *away* below it (8 m down at 10 km,
/// 785 m at 100 km) and horizontal coordinates are chords, not arcs. Rates of change of these
/// coordinates are velocities in the **origin's** north and east; a velocity measured in the
/// aircraft's own north and east rotates relative to them by the convergence of the meridians.
/// [`LocalFrame::from_local_ned`] rotates it back, so position and integrated velocity agree over 100 km and more.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalFrame {
    origin: Geodetic,
    origin_ecef: Vector3<f64>,
    ned_from_ecef: Matrix3<f64>,
}

impl LocalFrame {
    /// The frame at `origin`.
    #[must_use]
    pub fn new(origin: Geodetic) -> LocalFrame {
        LocalFrame { origin, origin_ecef: vector(origin.to_ecef()), ned_from_ecef: ned_from_ecef(origin) }
    }

    /// The origin.
    #[must_use]
    pub fn origin(&self) -> Geodetic {
        self.origin
    }

    /// North, east, down of a point, m. Exact (ECEF difference, one rotation).
    #[must_use]
    pub fn to_ned(&self, point: Geodetic) -> [f64; 3] {
        (self.ned_from_ecef * (vector(point.to_ecef()) - self.origin_ecef)).into()
    }

    /// The point with these coordinates.
    #[must_use]
    pub fn to_geodetic(&self, ned: [f64; 3]) -> Geodetic {
        let ecef = self.origin_ecef + self.ned_from_ecef.tr_mul(&Vector3::from(ned));
        Ecef { x: ecef.x, y: ecef.y, z: ecef.z }.to_geodetic()
    }

    /// A vector (velocity) given in the north-east-down axes of `at`, in this frame's axes.
    #[must_use]
    pub fn from_local_ned(&self, at: Geodetic, vector: [f64; 3]) -> [f64; 3] {
        (self.rotation_from(at) * Vector3::from(vector)).into()
    }

    /// The rotation of [`LocalFrame::from_local_ned`], for many vectors at one position.
    #[must_use]
    pub fn rotation_from(&self, at: Geodetic) -> Matrix3<f64> {
        self.ned_from_ecef * ned_from_ecef(at).transpose()
    }
}

fn vector(point: Ecef) -> Vector3<f64> {
    Vector3::new(point.x, point.y, point.z)
}

#[rustfmt::skip]
fn ned_from_ecef(at: Geodetic) -> Matrix3<f64> {
    let (sin_lat, cos_lat) = at.latitude.sin_cos();
    let (sin_lon, cos_lon) = at.longitude.sin_cos();
    Matrix3::new(
        -sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat,
        -sin_lon,            cos_lon,           0.0,
        -cos_lat * cos_lon, -cos_lat * sin_lon, -sin_lat,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid() -> impl Iterator<Item = Geodetic> {
        let latitudes = [-90.0, -89.9999, -45.0, -1e-9, 0.0, 37.6, 89.99, 90.0];
        let longitudes = [-180.0, -179.9999, -79.9, 0.0, 126.86, 180.0];
        let heights = [-400.0, 0.0, 350.0, 12_000.0, 400_000.0];
        latitudes.into_iter().flat_map(move |lat| {
            longitudes.into_iter().flat_map(move |lon| heights.map(|h| Geodetic::from_degrees(lat, lon, h)))
        })
    }

    #[test]
    fn known_points_have_their_known_coordinates() {
        let a = Geodetic::from_degrees(0.0, 0.0, 0.0).to_ecef();
        assert_eq!((a.x, a.y, a.z), (WGS84_A, 0.0, 0.0));
        let pole = Geodetic::from_degrees(90.0, 0.0, 0.0).to_ecef();
        // Semi-minor axis of WGS 84: 6 356 752.314 245 m.
        assert!((pole.z - 6_356_752.314_245).abs() < 1e-6 && pole.x.abs() < 1e-9);
    }

    #[test]
    fn a_round_trip_stays_within_ten_nanometres() {
        for point in grid() {
            let there = point.to_ecef();
            let again = there.to_geodetic().to_ecef();
            let error = (there.x - again.x).hypot(there.y - again.y).hypot(there.z - again.z);
            assert!(error < 1e-8, "{point:?}: {error} m");
        }
    }

    #[test]
    fn the_small_step_formula_of_the_design_note_holds_near_the_origin() {
        // dN = (M + h) dlat, dE = (N + h) cos(lat) dlon, better than 1 mm within 1 km (design note 1.6).
        let origin = Geodetic::from_degrees(37.6, 126.86, 350.0);
        let frame = LocalFrame::new(origin);
        let s = origin.latitude.sin();
        let meridian = WGS84_A * (1.0 - WGS84_E2) / (1.0 - WGS84_E2 * s * s).powf(1.5);
        let prime_vertical = WGS84_A / (1.0 - WGS84_E2 * s * s).sqrt();
        for (dlat, dlon) in [(1e-6, 0.0), (0.0, 1e-6), (-2e-6, 3e-6)] {
            let [n, e, _] = frame.to_ned(Geodetic {
                latitude: origin.latitude + dlat,
                longitude: origin.longitude + dlon,
                height: origin.height,
            });
            assert!((n - (meridian + 350.0) * dlat).abs() < 1e-3);
            assert!((e - (prime_vertical + 350.0) * origin.latitude.cos() * dlon).abs() < 1e-3);
        }
    }

    #[test]
    fn crossing_the_antimeridian_is_continuous() {
        let frame = LocalFrame::new(Geodetic::from_degrees(10.0, 179.9999, 0.0));
        let [_, east, _] = frame.to_ned(Geodetic::from_degrees(10.0, -179.9999, 0.0));
        assert!((east - 21.93).abs() < 0.01, "{east}");
    }

    #[test]
    fn integrated_velocity_matches_the_position_after_200_km() {
        // East along a parallel at constant speed: the aircraft's own velocity is purely "east" all
        // the way; turned into the origin's axes its integral must land on the position.
        let frame = LocalFrame::new(Geodetic::from_degrees(60.0, 10.0, 1000.0));
        let at = |s: f64| Geodetic { longitude: 10f64.to_radians() + s * 3.6f64.to_radians(), ..frame.origin() };
        let s = frame.origin().latitude.sin();
        let radius = (WGS84_A / (1.0 - WGS84_E2 * s * s).sqrt() + 1000.0) * frame.origin().latitude.cos();
        let speed = radius * 3.6f64.to_radians();
        let n = 20_000;
        let mut sum = [0.0; 3];
        for i in 0..n {
            let v = frame.from_local_ned(at((f64::from(i) + 0.5) / f64::from(n)), [0.0, speed, 0.0]);
            for k in 0..3 {
                sum[k] += v[k] / f64::from(n);
            }
        }
        let end = frame.to_ned(at(1.0));
        assert!(end[1] > 200_000.0 && end[0] > 5_000.0, "{end:?}");
        for k in 0..3 {
            assert!((sum[k] - end[k]).abs() < 1e-4, "{k}: {} {}", sum[k], end[k]);
        }
    }

    #[test]
    fn a_point_and_its_local_coordinates_are_the_same_point() {
        let frame = LocalFrame::new(Geodetic::from_degrees(-45.0, 170.0, 20.0));
        let point = frame.to_geodetic([80_000.0, -120_000.0, -3_000.0]);
        let ned = frame.to_ned(point);
        assert!(
            (ned[0] - 80_000.0).abs() < 1e-8 && (ned[1] + 120_000.0).abs() < 1e-8 && (ned[2] + 3_000.0).abs() < 1e-8
        );
    }
}
