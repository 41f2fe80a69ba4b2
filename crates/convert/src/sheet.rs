//! A table of results in memory, and the files it is written to.

mod parquet;
mod text;

pub use parquet::{
    ROWS_OF_A_GROUP, ReadTable, read_parquet, read_parquet_columns, write_parquet, write_parquet_about,
    write_parquet_parts,
};
pub(crate) use text::with_zero_bytes;
pub use text::write_csv;

use ingest::{Texts, Values};

/// Columns of equal length.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Sheet {
    /// In the order a reader expects; names end in their unit.
    pub columns: Vec<SheetColumn>,
}

/// A column.
#[derive(Debug, Clone, PartialEq)]
pub struct SheetColumn {
    /// Name, ending in the unit.
    pub name: String,
    /// Values.
    pub cells: Cells,
}

/// Values of a column; `None` for an absent value.
#[derive(Debug, Clone, PartialEq)]
pub enum Cells {
    /// Integers.
    I64(Values<i64>),
    /// Unsigned integers, some of them above `i64::MAX`.
    U64(Values<u64>),
    /// Floating-point numbers. A NaN in a log stays NaN.
    F64(Values<f64>),
    /// Texts.
    Text(TextCells),
}

/// Texts of a column; `None` if absent. A log may have many millions: they need no more memory than in the log.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TextCells {
    texts: Texts,
    /// Which rows have a text; `None` if all.
    given: Option<Vec<bool>>,
}

impl TextCells {
    /// From texts and a presence flag for each row; `None` if all are present.
    pub(crate) fn of_parts(texts: Texts, given: Option<Vec<bool>>) -> TextCells {
        let given = given.filter(|given| given.contains(&false));
        TextCells { texts, given }
    }

    /// The inverse of [`TextCells::of_parts`].
    pub(crate) fn into_parts(self) -> (Texts, Option<Vec<bool>>) {
        (self.texts, self.given)
    }

    /// Number of rows.
    #[must_use]
    pub fn len(&self) -> usize {
        self.texts.len()
    }

    /// Whether there are no rows.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.texts.is_empty()
    }

    /// The text of a row.
    #[must_use]
    pub fn get(&self, row: usize) -> Option<&str> {
        let is_given = self.given.as_ref().is_none_or(|given| given.get(row) == Some(&true));
        self.texts.get(row).filter(|_| is_given)
    }

    /// The text of each row.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = Option<&str>> + Clone {
        (0..self.len()).map(|row| self.get(row))
    }
}

impl<T: AsRef<str>> FromIterator<Option<T>> for TextCells {
    fn from_iter<I: IntoIterator<Item = Option<T>>>(cells: I) -> TextCells {
        let (mut texts, mut given) = (Texts::default(), vec![]);
        for cell in cells {
            given.push(cell.is_some());
            texts.push(cell.as_ref().map_or("", AsRef::as_ref));
        }
        TextCells::of_parts(texts, Some(given))
    }
}

impl Cells {
    /// Number of cells.
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

    /// Whether there are no cells.
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

    /// The cells of the column with this name.
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
