//! Output of a sensor.

use flight::Stamp;

/// Samples of one sensor, row by row.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Samples {
    /// Instant at which each was taken, s after the start.
    pub at_s: Vec<f64>,
    /// Its timestamp.
    pub measured: Vec<Stamp>,
    /// Arrival at the logger; may decrease if a later sample overtook.
    pub logged: Vec<Stamp>,
    /// Measured north, east, down: from the flight's origin, m, for a position; in the aircraft's own north and east,
    /// m/s, for a velocity.
    pub ned: Vec<[f64; 3]>,
    /// Latitude deg, longitude deg, height m: the output of a position sensor. Empty for a velocity.
    pub geodetic_deg: Vec<[f64; 3]>,
}

impl Samples {
    /// Number of rows.
    #[must_use]
    pub fn len(&self) -> usize {
        self.measured.len()
    }

    /// Whether there are no rows.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.measured.is_empty()
    }
}
