//! Positions and velocities in earth-centred, earth-fixed axes (WGS-84): x to the Greenwich meridian on the equator, z
//! to the north pole.

use flight::{Ecef, Geodetic};

/// No flight is further from the ellipsoid, m.
const FARTHEST_M: f64 = 1e6;
const NO_PLACE: &str = "the position is not on the earth: no fix";

/// Latitude and longitude, rad, and height above the ellipsoid, m; fails far from the ellipsoid, for example at the
/// centre of the earth, where receivers put themselves without a fix.
pub(super) fn place([x, y, z]: [f64; 3]) -> Result<Geodetic, String> {
    let place = Ecef { x, y, z }.to_geodetic();
    let plausible = [place.latitude, place.longitude].iter().all(|v| v.is_finite()) && place.height.abs() <= FARTHEST_M;
    if plausible { Ok(place) } else { Err(NO_PLACE.into()) }
}

/// North, east, down of a vector at a position.
pub(super) fn to_ned(at: Geodetic, [x, y, z]: [f64; 3]) -> [f64; 3] {
    let ((sin_lat, cos_lat), (sin_lon, cos_lon)) = (at.latitude.sin_cos(), at.longitude.sin_cos());
    // Away from the earth's axis.
    let outwards = cos_lon * x + sin_lon * y;
    [cos_lat * z - sin_lat * outwards, cos_lon * y - sin_lon * x, -cos_lat * outwards - sin_lat * z]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_velocity_is_the_derivative_of_the_position() {
        for (lat, lon) in [(47.4, 8.5), (-33.9, 151.2), (0.0, -90.0), (70.0, 180.0)] {
            let from = Geodetic::from_degrees(lat, lon, 500.0);
            let frame = flight::LocalFrame::new(from);
            for ned in [[10.0, 0.0, 0.0], [0.0, 10.0, 0.0], [0.0, 0.0, 10.0], [3.0, -4.0, 5.0]] {
                let (a, b) = (from.to_ecef(), frame.to_geodetic(ned).to_ecef());
                let found = to_ned(from, [b.x - a.x, b.y - a.y, b.z - a.z]);
                assert!(found.iter().zip(ned).all(|(a, b)| (a - b).abs() < 1e-6), "{lat} {lon} {ned:?}: {found:?}");
                let back = place([a.x, a.y, a.z]).unwrap();
                assert!((back.latitude - from.latitude).abs() < 1e-14 && (back.height - 500.0).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn the_earths_centre_and_huge_coordinates_are_rejected() {
        for nowhere in [[0.0; 3], [1e9, 0.0, 0.0], [f64::MAX; 3], [f64::INFINITY, 0.0, 0.0]] {
            assert!(place(nowhere).is_err(), "{nowhere:?}");
        }
    }
}
