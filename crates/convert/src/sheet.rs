//! A table of results in memory, and the files that it becomes.

mod parquet;
mod text;

pub use parquet::write_parquet;
pub use text::write_csv;

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
    I64(Vec<Option<i64>>),
    /// Numbers. A NaN that a log holds stays a NaN.
    F64(Vec<Option<f64>>),
    /// Texts.
    Text(Vec<Option<String>>),
}

impl Cells {
    /// How many.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Cells::I64(v) => v.len(),
            Cells::F64(v) => v.len(),
            Cells::Text(v) => v.len(),
        }
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

    /// Number of rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.columns.first().map_or(0, |c| c.cells.len())
    }
}
