//! A table as ROS 2 messages: a definition (`ros2msg`), and each row as CDR.

use flight::{Code, Notices};
use ingest::{Column, ColumnData, PAYLOAD_HEX, Table, TopicInfo};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

/// The definition of a table's rows, and their serialisation.
///
/// A comment after each field gives the log's own name as JSON: ROS allows few names, and a recovered log is read back
/// by the originals. For a field that is absent from some rows, an extra field marks its presence. For decimals with
/// too many digits, an extra field keeps the original text.
pub(crate) struct MessageType<'t> {
    table: &'t Table,
    definition: String,
    /// Columns without a value in some rows.
    partial: Vec<&'t Column>,
    /// Original texts of decimals that lost their last digits as floats.
    written: Vec<&'t Column>,
}

impl<'t> MessageType<'t> {
    /// `written` are text columns that accompany number columns of the same path.
    pub(crate) fn of(table: &'t Table, written: Vec<&'t Column>) -> MessageType<'t> {
        let mut taken = BTreeSet::new();
        let mut definition =
            String::from("# Written by flightlag. The comment after a field is its name in the log.\n");
        let partial: Vec<&Column> = table.columns.iter().filter(|column| absent(column) > 0).collect();
        let quoted = |path: &str| serde_json::Value::from(path).to_string();
        let mut names = BTreeMap::new();
        for column in &table.columns {
            let kind = match column.data {
                ColumnData::F64(_) => "float64",
                ColumnData::I64(_) => "int64",
                ColumnData::U64(_) => "uint64",
                ColumnData::Text(_) if is_payload(column) => "uint8[]",
                ColumnData::Text(_) => "string",
            };
            let name = field_name(if is_payload(column) { "payload" } else { &column.path }, &mut taken);
            let _ = writeln!(definition, "{kind} {name} # {}", quoted(&column.path));
            names.insert(column.path.as_str(), name);
        }
        let mut companion_fields = |kind: &str, what: &str, columns: &[&Column]| {
            for Column { path, .. } in columns {
                let of = names.get(path.as_str()).map_or("", String::as_str);
                let name = field_name(&format!("{of}_{what}"), &mut taken);
                let _ = writeln!(definition, "{kind} {name} # {what} {}", quoted(path));
            }
        };
        companion_fields("bool", "given", &partial);
        companion_fields("string", "written", &written);
        MessageType { table, definition, partial, written }
    }

    /// The topic as written: typed, with a type name that ROS allows.
    pub(crate) fn topic(&self) -> TopicInfo {
        let name = &self.table.topic.name;
        TopicInfo {
            name: name.clone(),
            type_name: format!("flightlag/msg/{}", type_name(name)),
            encoding: "cdr".to_owned(),
        }
    }

    /// Reports that placeholders were written.
    pub(crate) fn note_absent(&self, notices: &mut Notices) {
        let absent = self.partial.iter().copied().map(absent).sum();
        if absent > 0 {
            let text = "values that the log does not have were written as NaN, 0 or empty text; the fields that end \
                in _given mark them";
            let place = format!("topic {}", self.table.topic.name);
            notices.push(Code::ValuesReplaced, place, absent, text);
        }
    }

    pub(crate) fn definition(&self) -> &[u8] {
        self.definition.as_bytes()
    }

    /// A row, little-endian CDR with its header. Absent numbers are NaN, absent integers 0, absent texts empty. A
    /// message without fields is one zero byte.
    pub(crate) fn payload(&self, row: usize, out: &mut Vec<u8>) {
        out.clear();
        out.extend([0, 1, 0, 0]);
        if self.table.columns.is_empty() {
            out.push(0);
        }
        for column in &self.table.columns {
            match &column.data {
                ColumnData::F64(_) => number(out, column.number(row).unwrap_or(f64::NAN).to_le_bytes()),
                ColumnData::I64(_) => number(out, column.integer(row).unwrap_or_default().to_le_bytes()),
                ColumnData::U64(_) => number(out, column.unsigned(row).unwrap_or_default().to_le_bytes()),
                ColumnData::Text(_) if is_payload(column) => payload_of(out, column, row),
                ColumnData::Text(_) => text(out, column, row),
            }
        }
        out.extend(self.partial.iter().map(|column| u8::from(is_given(column, row))));
        self.written.iter().for_each(|column| text(out, column, row));
    }
}

/// Number of rows without a value.
fn absent(column: &Column) -> u64 {
    column.valid.as_ref().map_or(0, |valid| valid.iter().filter(|valid| !**valid).count() as u64)
}

fn is_given(column: &Column, row: usize) -> bool {
    column.valid.as_ref().is_none_or(|valid| valid.get(row).copied().unwrap_or(false))
}

/// Whether the column holds undecoded message bytes.
fn is_payload(column: &Column) -> bool {
    column.path == PAYLOAD_HEX
}

fn payload_of(out: &mut Vec<u8>, column: &Column, row: usize) {
    let digits = column.text(row).unwrap_or_default();
    let byte = |pair: &[u8]| std::str::from_utf8(pair).ok().and_then(|pair| u8::from_str_radix(pair, 16).ok());
    align(out, 4);
    out.extend((digits.len() as u32 / 2).to_le_bytes());
    out.extend(digits.as_bytes().chunks_exact(2).map(|pair| byte(pair).unwrap_or_default()));
}

/// CDR alignment counts from the end of its four-byte header.
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
    align(out, 4);
    out.extend((text.len() as u32 + 1).to_le_bytes());
    out.extend(text.as_bytes());
    out.push(0);
}

/// Longer field names are truncated, because ROS limits their length.
const LONGEST_NAME: usize = 200;

/// Lower-case letters, digits and single underscores, starting with a letter, all unique: `TimeUS` becomes `time_us`.
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
    name.truncate(LONGEST_NAME);
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

/// Capitalised words without separators, such as `VehicleGpsPosition`.
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
    fn a_definition_records_original_names_and_marks_placeholders() {
        let column = |path: &str, data, valid| Column { path: path.to_owned(), data, valid };
        let columns = vec![
            column("TimeUS", ColumnData::U64(vec![u64::MAX, 1]), None),
            column("gyro[0]", ColumnData::F64(vec![0.5, 0.0]), Some(vec![true, false])),
            column(PAYLOAD_HEX, ColumnData::Text(["00ff", ""].into_iter().collect()), None),
        ];
        let topic = TopicInfo::default();
        let table =
            Table { topic, rows: 2, logged_ns: None, published_ns: None, origin: ingest::Places::default(), columns };
        let as_written = column("gyro[0]", ColumnData::Text(["0.50", ""].into_iter().collect()), None);
        let messages = MessageType::of(&table, vec![&as_written]);
        let lines: Vec<&str> = messages.definition.lines().skip(1).collect();
        let expected = [
            r#"uint64 time_us # "TimeUS""#,
            r#"float64 gyro_0 # "gyro[0]""#,
            r#"uint8[] payload # "payload_hex""#,
            r#"bool gyro_0_given # given "gyro[0]""#,
            r#"string gyro_0_written # written "gyro[0]""#,
        ];
        assert_eq!(lines, expected);
        let mut bytes = vec![];
        messages.payload(0, &mut bytes);
        let head = [&[0, 1, 0, 0][..], &u64::MAX.to_le_bytes(), &0.5_f64.to_le_bytes()].concat();
        let text = [&[0][..], &5_u32.to_le_bytes(), b"0.50\0"].concat();
        assert_eq!(bytes, [&head[..], &2_u32.to_le_bytes(), &[0, 0xff], &[1], &text].concat());
        messages.payload(1, &mut bytes);
        assert!(f64::from_le_bytes(bytes[12..20].try_into().unwrap()).is_nan());
        assert_eq!(bytes[20..], [0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0]);
    }

    #[test]
    fn names_are_valid_in_ros_and_unique() {
        let mut taken = BTreeSet::new();
        let names = ["TimeUS", "q[0]", "q[1]", "a.b", "a_b", "9", "", "höhe", "_x__y_"];
        let fields: Vec<String> = names.iter().map(|n| field_name(n, &mut taken)).collect();
        let types = ["vehicle_gps_position", "/gps/fix", "GPS_1", "9", "position.gps"].map(type_name);
        assert_eq!(types, ["VehicleGpsPosition", "GpsFix", "GPS1", "T9", "PositionGps"]);
        assert_eq!(fields, ["time_us", "q_0", "q_1", "a_b", "a_b_2", "f_9", "f", "h_he", "x_y"]);
    }
}
