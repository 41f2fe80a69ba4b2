//! The compensated track, row by row, for the Parquet file of a flight.

use crate::estimate::{PAPER, Positions};
use crate::rows::Rows;
use flight::{Geodetic, LocalFrame, Stamp};
use std::fmt::Debug;
use std::ops::Range;

/// A column of the track.
#[derive(Debug, Clone, PartialEq)]
pub enum TrackColumn {
    /// Timestamps, ns.
    I64(Vec<i64>),
    /// Numbers; `None` if missing.
    F64(Vec<Option<f64>>),
    /// Names, see [`RowState::name`](crate::RowState::name).
    Text(Vec<&'static str>),
}

/// Columns of equal length, by name. Names end in their unit.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Track {
    /// In the usual reading order.
    pub columns: Vec<(String, TrackColumn)>,
}

impl Track {
    /// A column by name.
    #[must_use]
    pub fn column(&self, name: &str) -> Option<&TrackColumn> {
        self.columns.iter().find(|(n, _)| n == name).map(|(_, c)| c)
    }
}

/// A track that is built part by part: all columns of a long record at once would take more memory than the log.
pub trait TrackRows: Debug + Send {
    /// How many rows there are.
    fn rows(&self) -> usize;

    /// The columns of these rows; all parts have the same columns.
    fn part(&self, rows: Range<usize>) -> Track;

    /// All rows at once.
    fn whole(&self) -> Track {
        self.part(0..self.rows())
    }
}

impl TrackRows for Track {
    fn rows(&self) -> usize {
        self.columns.first().map_or(0, |(_, column)| match column {
            TrackColumn::I64(values) => values.len(),
            TrackColumn::F64(values) => values.len(),
            TrackColumn::Text(values) => values.len(),
        })
    }

    fn part(&self, rows: Range<usize>) -> Track {
        let part = |column: &TrackColumn| match column {
            TrackColumn::I64(values) => TrackColumn::I64(values[rows.clone()].to_vec()),
            TrackColumn::F64(values) => TrackColumn::F64(values[rows.clone()].to_vec()),
            TrackColumn::Text(values) => TrackColumn::Text(values[rows.clone()].to_vec()),
        };
        Track { columns: self.columns.iter().map(|(name, column)| (name.clone(), part(column))).collect() }
    }
}

/// The track of a replay.
#[derive(Debug, Clone, PartialEq)]
pub struct ReplayedTrack {
    pub(crate) origin: Stamp,
    pub(crate) frame: Option<LocalFrame>,
    /// Timestamp of each fix, s from the origin, and its down coordinate, m.
    pub(crate) fixes: [Vec<f64>; 2],
    pub(crate) rows: Rows,
    pub(crate) estimates: Vec<Positions>,
}

impl TrackRows for ReplayedTrack {
    fn rows(&self) -> usize {
        self.rows.t.len()
    }

    fn part(&self, part: Range<usize>) -> Track {
        let rows = &self.rows;
        let given = |value: &dyn Fn(usize) -> f64| TrackColumn::F64(part.clone().map(|row| Some(value(row))).collect());
        let stamp = |row: usize| self.origin.plus_seconds(rows.t[row]).0;
        let mut columns = vec![
            ("stamp_ns".to_owned(), TrackColumn::I64(part.clone().map(stamp).collect())),
            ("t_s".to_owned(), given(&|row| rows.t[row])),
            ("state".to_owned(), TrackColumn::Text(part.clone().map(|row| rows.state[row].name()).collect())),
            ("fix_age_s".to_owned(), given(&|row| rows.t[row] - self.fixes[0][rows.fix(row)])),
        ];
        for estimate in &self.estimates {
            let prefix = estimate.name.replace('-', "_");
            for (axis, values) in ["north", "east"].into_iter().zip(&estimate.axes) {
                let shown = |row: usize| estimate.shown(rows, row).then(|| values[row]);
                columns.push((format!("{prefix}_{axis}_m"), TrackColumn::F64(part.clone().map(shown).collect())));
            }
        }
        if let Some(frame) = &self.frame {
            columns.extend(self.places(frame, &part));
        }
        Track { columns }
    }
}

impl ReplayedTrack {
    /// Height, then latitude and longitude of each estimate except the paper's, which no map shows: the track's north
    /// and east from its origin give the same.
    fn places(&self, frame: &LocalFrame, part: &Range<usize>) -> Vec<(String, TrackColumn)> {
        let column = |points: &[Option<Geodetic>], value: fn(&Geodetic) -> f64| {
            TrackColumn::F64(points.iter().map(|p| p.as_ref().map(value)).collect())
        };
        let mut columns = vec![];
        for estimate in self.estimates.iter().filter(|e| !e.name.starts_with(PAPER)) {
            let prefix = estimate.name.replace('-', "_");
            let shown = |row| estimate.shown(&self.rows, row).then(|| self.point(frame, estimate, row));
            let points: Vec<Option<Geodetic>> = part.clone().map(shown).collect();
            if columns.is_empty() {
                columns.push(("height_m".to_owned(), column(&points, |p| p.height)));
            }
            columns.push((format!("{prefix}_latitude_deg"), column(&points, |p| p.latitude.to_degrees())));
            columns.push((format!("{prefix}_longitude_deg"), column(&points, |p| p.longitude.to_degrees())));
        }
        columns
    }

    /// The compensated point of a row at the height of its fix: only the horizontal position is compensated.
    fn point(&self, frame: &LocalFrame, estimate: &Positions, row: usize) -> Geodetic {
        let [north, east] = [estimate.axes[0][row], estimate.axes[1][row]];
        frame.to_geodetic([north, east, self.fixes[1][self.rows.fix(row)]])
    }
}
