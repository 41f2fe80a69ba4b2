//! A table of results in memory, and the files that it becomes.

mod parquet;
mod text;

pub use parquet::{ReadTable, read_parquet, read_parquet_columns, write_parquet, write_parquet_about};
pub(crate) use text::with_zero_bytes;
pub use text::write_csv;

use ingest::Values;

/// Columns of equal length.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Sheet {
    /// In the order in which a reader expects them; names end in their unit.
    pub columns: Vec<SheetColumn>,
}

/// A column.
#[derive(Debug, Clone, PartialEq)]
pub struct SheetColumn {
    /// Name, with the unit at its end.
    pub name: String,
    /// Values.
    pub cells: Cells,
}

/// Values of a column; `None` where there is none.
#[derive(Debug, Clone, PartialEq)]
pub enum Cells {
    /// Integers.
    I64(Values<i64>),
    /// Integers without sign, some of them above `i64::MAX`.
    U64(Values<u64>),
    /// Numbers. A NaN that a log holds stays a NaN.
    F64(Values<f64>),
    /// Texts.
    Text(Vec<Option<String>>),
}

impl Cells {
    /// How many.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Cells::I64(v) => v.len(),
            Cells::U64(v) => v.len(),
            Cells::F64(v) => v.len(),
            Cells::Text(v) => v.len(),
        }
    }

    /// As integers if every number is whole and exact: a log's integers of up to 32 bits are read as floats.
    pub(crate) fn whole(self) -> Cells {
        const EXACT: f64 = 9_007_199_254_740_992.0;
        let Cells::F64(values) = &self else { return self };
        let is_whole = |x: f64| x.fract() == 0.0 && x.abs() < EXACT && !(x == 0.0 && x.is_sign_negative());
        if !values.given().all(is_whole) {
            return self;
        }
        Cells::I64(values.iter().map(|x| x.map(|x| x as i64)).collect())
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

impl Sheet {
    /// Adds a column.
    pub fn push(&mut self, name: impl Into<String>, cells: Cells) {
        self.columns.push(SheetColumn { name: name.into(), cells });
    }

    /// The cells of the column of this name.
    #[must_use]
    pub fn cells(&self, name: &str) -> Option<&Cells> {
        self.columns.iter().find(|c| c.name == name).map(|c| &c.cells)
    }

    /// Number of rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.columns.first().map_or(0, |c| c.cells.len())
    }
}
