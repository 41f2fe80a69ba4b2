//! What a sensor sends.

use flight::Stamp;

/// Samples of one sensor, row by row.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Samples {
    /// Instant at which each was taken, s after the start.
    pub at_s: Vec<f64>,
    /// The stamp that it carries.
    pub measured: Vec<Stamp>,
    /// When the logger had it; may fall where a later sample overtook.
    pub logged: Vec<Stamp>,
    /// North, east, down as the sensor says: of the flight's origin, m, for a position; in the
    /// aircraft's own north and east, m/s, for a velocity.
    pub ned: Vec<[f64; 3]>,
    /// Latitude deg, longitude deg, height m: what a position sensor sends. Empty for a velocity.
    pub geodetic_deg: Vec<[f64; 3]>,
}

impl Samples {
    /// Rows.
    #[must_use]
    pub fn len(&self) -> usize {
        self.measured.len()
    }

    /// Without rows.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.measured.is_empty()
    }
}
