//! Decodes lines of comma-separated values into columns, as in text logs of ArduPilot.

use crate::decode::Wanted;
use crate::decode::rows::{Rows, Value, ValueType};

/// The assignment of cells of a line to values.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct CellLayout {
    /// In the order of their cells.
    pub(crate) fields: Vec<CellField>,
    /// Number of cells of a line.
    pub(crate) cells: usize,
}

/// A value in a line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct CellField {
    pub(crate) path: String,
    /// Index of its cell.
    pub(crate) cell: usize,
    pub(crate) kind: CellKind,
}

/// How a cell is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum CellKind {
    Number,
    /// A whole number of up to 64 bits, exact.
    Whole,
    /// Unchanged; in the last cell including its commas.
    Text,
    /// A number, or an empty cell: then the value is absent.
    NumberIfAny,
    /// A whole number, or an empty cell.
    WholeIfAny,
}

/// How to read the wanted cells of a line.
#[derive(Debug)]
pub(crate) struct Plan {
    steps: Vec<Step>,
    cells: usize,
}

#[derive(Debug)]
struct Step {
    column: usize,
    cell: usize,
    kind: CellKind,
    path: String,
}

impl CellLayout {
    /// These cells in their order.
    pub(crate) fn of<'p>(fields: impl IntoIterator<Item = (&'p str, CellKind)>) -> CellLayout {
        let field = |(cell, (path, kind)): (usize, (&str, CellKind))| CellField { path: path.to_owned(), cell, kind };
        let fields: Vec<CellField> = fields.into_iter().enumerate().map(field).collect();
        CellLayout { cells: fields.len(), fields }
    }
}

impl Plan {
    /// Compiles the wanted fields; creates their columns in `rows`.
    pub(crate) fn new(layout: &CellLayout, wanted: &Wanted, rows: &mut Rows) -> Plan {
        let step = |field: &CellField| {
            let CellField { path, cell, kind } = field;
            let value_type = match kind {
                CellKind::Number | CellKind::NumberIfAny => ValueType::Float,
                CellKind::Whole | CellKind::WholeIfAny => ValueType::Integer,
                CellKind::Text => ValueType::Text,
            };
            let column = wanted.has(path).then(|| rows.column(path, value_type)).flatten()?;
            Some(Step { column, cell: *cell, kind: *kind, path: path.clone() })
        };
        Plan { steps: layout.fields.iter().filter_map(step).collect(), cells: layout.cells }
    }

    /// Sets the wanted values of the open row.
    pub(crate) fn decode(&self, line: &[u8], rows: &mut Rows) -> Result<(), String> {
        let line = std::str::from_utf8(line).map_err(|_| "the line is not UTF-8".to_owned())?;
        for step in &self.steps {
            let last = step.cell + 1 == self.cells && step.kind == CellKind::Text;
            let text = cell(line, step.cell, last).ok_or_else(|| format!("{} is missing", step.path))?;
            let no_number =
                || format!("{}: {:?} is not a number", step.path, text.chars().take(40).collect::<String>());
            let value = match step.kind {
                CellKind::NumberIfAny | CellKind::WholeIfAny if text.is_empty() => continue,
                CellKind::Text => Value::Text(text),
                CellKind::Whole | CellKind::WholeIfAny => Value::Integer(text.parse().map_err(|_| no_number())?),
                CellKind::Number | CellKind::NumberIfAny => Value::Float(number(text).ok_or_else(no_number)?),
            };
            rows.set(step.column, value);
        }
        Ok(())
    }

    /// Approximate memory use of the plan, bytes.
    pub(crate) fn weight(&self) -> usize {
        self.steps.iter().map(|s| size_of::<Step>() + s.path.len()).sum()
    }
}

/// A cell without the spaces around it; with `rest`, everything to the end of the line.
pub(crate) fn cell(line: &str, index: usize, rest: bool) -> Option<&str> {
    let mut cells = if rest { line.splitn(index + 1, ',') } else { line.splitn(index + 2, ',') };
    cells.nth(index).map(str::trim)
}

/// Writes bytes as hexadecimal digits.
pub(crate) fn push_hex(bytes: &[u8], line: &mut String) {
    let digit = |nibble: u8| char::from_digit(nibble.into(), 16).unwrap_or_default();
    line.extend(bytes.iter().flat_map(|byte| [digit(byte >> 4), digit(byte & 0xf)]));
}

/// A number as printed by C, including `-nan`.
pub(crate) fn number(text: &str) -> Option<f64> {
    text.parse().ok().or_else(|| (text == "-nan").then_some(f64::NAN))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::TopicInfo;

    #[test]
    fn wanted_cells_become_columns_and_text_at_the_end_keeps_its_commas() {
        let field = |path: &str, cell, kind| CellField { path: path.to_owned(), cell, kind };
        let fields = vec![
            field("TimeUS", 0, CellKind::Whole),
            field("Alt", 1, CellKind::Number),
            field("Text", 2, CellKind::Text),
        ];
        let mut rows = Rows::default();
        let plan = Plan::new(&CellLayout { fields, cells: 3 }, &Wanted::All, &mut rows);
        plan.decode(b" 9007199254740993, -12.5, all well, nothing to see", &mut rows).unwrap();
        rows.close(0, None, 1);
        plan.decode(b"1, -nan, x", &mut rows).unwrap();
        rows.close(0, None, 2);
        assert!(plan.decode(b"1, high, x", &mut rows).unwrap_err().contains("high"));
        assert!(plan.decode(b"1, 2", &mut rows).unwrap_err().contains("Text"));
        rows.roll_back();
        let table = rows.into_table(TopicInfo::default());
        assert_eq!(table.column("TimeUS").unwrap().integer(0), Some(9_007_199_254_740_993));
        assert_eq!(table.column("Alt").unwrap().number(0), Some(-12.5));
        assert!(table.column("Alt").unwrap().number(1).unwrap().is_nan());
        assert_eq!(table.column("Text").unwrap().text(0), Some("all well, nothing to see"));
    }
}
