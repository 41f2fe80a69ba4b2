//! The compensated track, row by row, for the Parquet file of a flight.

/// What the compensated position of a row is worth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum RowState {
    /// Every part of it was measured.
    Valid,
    /// Less than Td of velocity has been seen since the start: the start rule speaks.
    WarmUp,
    /// No fix yet since the velocity started, or started anew after a long gap.
    NoFix,
    /// No velocity: inside a gap too long to bridge. (Only with rows at a fixed rate.)
    NoVelocity,
}

impl RowState {
    /// As the track's `state` column has it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            RowState::Valid => "valid",
            RowState::WarmUp => "warm-up",
            RowState::NoFix => "no-fix",
            RowState::NoVelocity => "no-velocity",
        }
    }

    /// In words, for counts.
    #[must_use]
    pub fn reason(self) -> &'static str {
        match self {
            RowState::Valid => "valid",
            RowState::WarmUp => "less than Td of velocity since the start",
            RowState::NoFix => "no position fix since the velocity started",
            RowState::NoVelocity => "velocity gap too long to bridge",
        }
    }
}

/// A column of the track.
#[derive(Debug, Clone, PartialEq)]
pub enum TrackColumn {
    /// Stamps, ns.
    I64(Vec<i64>),
    /// Numbers; `None` where there is none.
    F64(Vec<Option<f64>>),
    /// Names, see [`RowState::name`].
    Text(Vec<&'static str>),
}

/// Columns of equal length, by name. Names end in their unit.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Track {
    /// In the order in which a reader expects them.
    pub columns: Vec<(String, TrackColumn)>,
}

impl Track {
    /// A column by name.
    #[must_use]
    pub fn column(&self, name: &str) -> Option<&TrackColumn> {
        self.columns.iter().find(|(n, _)| n == name).map(|(_, c)| c)
    }
}
