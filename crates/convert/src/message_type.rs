//! A table as messages of ROS 2: a definition (`ros2msg`), and each row as CDR.

use flight::{Notices, Severity};
use ingest::{Column, ColumnData, Table, TopicInfo};
use std::collections::BTreeSet;
use std::fmt::Write;

/// The definition of a table's rows, and how to write them.
pub(crate) struct MessageType<'t> {
    table: &'t Table,
    definition: String,
    /// Values that the log does not have although the column does; text and integers get a placeholder.
    absent: u64,
}

impl<'t> MessageType<'t> {
    pub(crate) fn of(table: &'t Table) -> MessageType<'t> {
        let mut taken = BTreeSet::new();
        let mut definition = String::from("# Written by flightlag. A field's name in the log stands behind it.\n");
        let mut absent = 0;
        for column in &table.columns {
            let kind = match column.data {
                ColumnData::F64(_) => "float64",
                ColumnData::I64(_) => "int64",
                ColumnData::U64(_) => "uint64",
                ColumnData::Text(_) => "string",
            };
            let name = field_name(&column.path, &mut taken);
            // One line, whatever the log's name holds.
            let path: String = column.path.chars().filter(|c| !c.is_control()).collect();
            let _ = writeln!(definition, "{kind} {name} # {path}");
            absent += column.valid.as_ref().map_or(0, |v| v.iter().filter(|v| !**v).count() as u64);
        }
        MessageType { table, definition, absent }
    }

    /// The topic as its messages are written: typed, and with a type of a name that ROS allows.
    pub(crate) fn topic(&self) -> TopicInfo {
        let name = &self.table.topic.name;
        TopicInfo {
            name: name.clone(),
            type_name: format!("flightlag/msg/{}", type_name(name)),
            encoding: "cdr".to_owned(),
        }
    }

    /// Says that placeholders were written.
    pub(crate) fn note_absent(&self, notices: &mut Notices) {
        if self.absent > 0 {
            let text = "values that the log does not have were written as NaN, 0 or empty text";
            notices.push(
                Severity::Info,
                "absent-values",
                format!("topic {}", self.table.topic.name),
                self.absent,
                text,
            );
        }
    }

    pub(crate) fn definition(&self) -> &[u8] {
        self.definition.as_bytes()
    }

    /// A row, little-endian CDR with its header. Absent numbers are NaN, absent integers 0, absent texts empty.
    pub(crate) fn payload(&self, row: usize, out: &mut Vec<u8>) {
        out.clear();
        out.extend([0, 1, 0, 0]);
        for column in &self.table.columns {
            match &column.data {
                ColumnData::F64(_) => number(out, column.number(row).unwrap_or(f64::NAN).to_le_bytes()),
                ColumnData::I64(_) => number(out, column.integer(row).unwrap_or_default().to_le_bytes()),
                ColumnData::U64(_) => number(out, column.unsigned(row).unwrap_or_default().to_le_bytes()),
                ColumnData::Text(_) => text(out, column, row),
            }
        }
    }
}

/// CDR aligns from behind its four bytes of header.
fn align(out: &mut Vec<u8>, to: usize) {
    let past = (out.len() - 4) % to;
    if past > 0 {
        out.resize(out.len() + to - past, 0);
    }
}

fn number(out: &mut Vec<u8>, bytes: [u8; 8]) {
    align(out, 8);
    out.extend(bytes);
}

fn text(out: &mut Vec<u8>, column: &Column, row: usize) {
    let text = column.text(row).unwrap_or_default();
    // A zero ends a string in CDR.
    let text = text.split('\0').next().unwrap_or_default();
    align(out, 4);
    out.extend((text.len() as u32 + 1).to_le_bytes());
    out.extend(text.as_bytes());
    out.push(0);
}

/// Small letters, digits and single underscores, beginning with a letter, and no name twice: `TimeUS` becomes `time_us`.
fn field_name(path: &str, taken: &mut BTreeSet<String>) -> String {
    let mut name = String::new();
    let mut before = ' ';
    for c in path.chars() {
        let begins_word = c.is_ascii_uppercase() && before.is_ascii_lowercase();
        if (begins_word || !c.is_ascii_alphanumeric()) && !name.is_empty() && !name.ends_with('_') {
            name.push('_');
        }
        if c.is_ascii_alphanumeric() {
            name.push(c.to_ascii_lowercase());
        }
        before = c;
    }
    let name = name.trim_end_matches('_');
    let name = if name.starts_with(|c: char| c.is_ascii_alphabetic()) { name.to_owned() } else { format!("f_{name}") };
    let mut free = name.trim_end_matches('_').to_owned();
    let mut count = 1;
    while !taken.insert(free.clone()) {
        count += 1;
        free = format!("{name}_{count}");
    }
    free
}

/// Words that begin with a capital, as `VehicleGpsPosition`.
fn type_name(topic: &str) -> String {
    let words = topic.split(|c: char| !c.is_ascii_alphanumeric()).filter(|w| !w.is_empty());
    let capital = |word: &str| {
        let (first, rest) = word.split_at(1);
        first.to_ascii_uppercase() + rest
    };
    let name: String = words.map(capital).collect();
    if name.starts_with(|c: char| c.is_ascii_uppercase()) { name } else { format!("T{name}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_such_as_ros_allows_and_differ() {
        let mut taken = BTreeSet::new();
        let names = ["TimeUS", "q[0]", "q[1]", "a.b", "a_b", "9", "", "höhe", "_x__y_"];
        let fields: Vec<String> = names.iter().map(|n| field_name(n, &mut taken)).collect();
        let types = ["vehicle_gps_position", "/gps/fix", "GPS_1", "9", "position.gps"].map(type_name);
        assert_eq!(types, ["VehicleGpsPosition", "GpsFix", "GPS1", "T9", "PositionGps"]);
        assert_eq!(fields, ["time_us", "q_0", "q_1", "a_b", "a_b_2", "f_9", "f", "h_he", "x_y"]);
    }
}
