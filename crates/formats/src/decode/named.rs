//! ROS 2 definitions written by `flightlag recover`: the comment of each field holds its name in the original log,
//! because ROS allows few names.
//!
//! ```text
//! float64 time_us # "TimeUS"
//! bool time_us_given # given "TimeUS"
//! string time_us_written # written "TimeUS"
//! ```
//!
//! The second line belongs to a field that some rows lack: it is false where the value is only a placeholder. The third
//! line is the decimal as written, where a float has lost its last digits.

use super::Wanted;
use super::ros::Plan;
use super::rows::Rows;
use super::schema::{Dialect, Schema};
use crate::table::{Column, ColumnData, Table};
use std::collections::BTreeSet;

/// The encoding name of such a definition.
pub(crate) const NAMED: &str = "ros2msg with names";
/// Prefix of the path of a field's presence flag; a field with such a name is rejected.
const GIVEN: &str = "\u{1}";
/// Prefix of the path of a field's decimal text; likewise.
const WRITTEN: &str = "\u{2}";
const MARKS: [char; 2] = ['\u{1}', '\u{2}'];

/// Plans the decoding of such messages under the names of the original log.
pub(super) fn plan(type_name: &str, text: &str, wanted: &Wanted, rows: &mut Rows) -> Result<Plan, String> {
    let mut schema = Schema::parse(type_name, text, Dialect::Ros2)?;
    let names = text.lines().filter_map(name_of).collect::<Result<Vec<String>, String>>()?;
    check(&names)?;
    let fields = schema.messages.first_mut().map(|message| message.fields.as_mut_slice()).unwrap_or_default();
    if fields.len() != names.len() {
        return Err(format!("it has {} fields, but names for {}", fields.len(), names.len()));
    }
    fields.iter_mut().zip(names).for_each(|(field, name)| field.name = name);
    let wanted = with_marked_fields(wanted);
    let given = fields.iter().map(|field| field.name.as_str()).filter(|name| name.starts_with(GIVEN));
    for name in given.filter(|name| wanted.has(name)) {
        rows.flag_column(name).ok_or("it has too many optional fields")?;
    }
    Ok(Plan::new(&schema, &wanted, rows))
}

/// Two fields of one name would share a column, and a flag without its field would have no meaning.
fn check(names: &[String]) -> Result<(), String> {
    let mut distinct = BTreeSet::new();
    if let Some(twice) = names.iter().find(|name| !distinct.insert(name.as_str())) {
        return Err(format!("two of its fields are called {:.100}", twice.trim_start_matches(MARKS)));
    }
    match names.iter().filter_map(|name| name.strip_prefix(MARKS)).find(|name| !distinct.contains(name)) {
        Some(name) => Err(format!("another field describes {name:.100}, which it does not have")),
        None => Ok(()),
    }
}

/// The content of a field's comment; `None` for an empty line or one with only a comment.
fn name_of(line: &str) -> Option<Result<String, String>> {
    let (_, comment) = line.split_once(" # ").filter(|_| !line.starts_with('#'))?;
    let after_mark = |what: &str, mark| comment.strip_prefix(what).map(|name| (mark, name));
    let (mark, name) = after_mark("given ", GIVEN).or_else(|| after_mark("written ", WRITTEN)).unwrap_or(("", comment));
    let name = serde_json::from_str(name.trim_end()).ok().filter(|name: &String| !name.starts_with(MARKS));
    Some(name.map(|name| format!("{mark}{name}")).ok_or_else(|| format!("{line:.100}: the name is missing")))
}

/// Adds the presence flag and the decimal text of each wanted field.
fn with_marked_fields(wanted: &Wanted) -> Wanted {
    match wanted {
        Wanted::All => Wanted::All,
        Wanted::Paths(paths) => {
            let marked = paths.iter().flat_map(|path| ["", GIVEN, WRITTEN].map(|mark| format!("{mark}{path}")));
            Wanted::Paths(marked.collect::<BTreeSet<String>>())
        }
    }
}

/// Removes the presence flags, and makes the values absent where the flag is false. Returns the columns of decimal texts.
pub(crate) fn leave_out_placeholders(table: &mut Table) -> Vec<Column> {
    let of = |mark: &'static str| move |column: &Column| column.path.starts_with(mark);
    let (given, columns): (Vec<Column>, Vec<Column>) =
        std::mem::take(&mut table.columns).into_iter().partition(of(GIVEN));
    let (mut written, mut columns): (Vec<Column>, Vec<Column>) = columns.into_iter().partition(of(WRITTEN));
    for flags in given {
        let path = flags.path.strip_prefix(GIVEN).unwrap_or_default();
        let Ok(place) = columns.binary_search_by(|column| column.path.as_str().cmp(path)) else { continue };
        let valid: Vec<bool> = (0..table.rows).map(|row| flags.number(row) == Some(1.0)).collect();
        if let Some(column) = columns.get_mut(place) {
            column.blank(&valid);
            column.valid = Some(valid);
        }
    }
    for column in &mut written {
        column.path = column.path.split_off(WRITTEN.len());
        let place = columns.binary_search_by(|number| number.path.cmp(&column.path));
        column.valid = place.ok().and_then(|place| columns.get(place)?.valid.clone());
    }
    table.columns = columns;
    written
}

impl Column {
    /// Sets the placeholders that all formats use.
    fn blank(&mut self, valid: &[bool]) {
        fn blank<T: Default>(values: &mut [T], valid: &[bool]) {
            values.iter_mut().zip(valid).filter(|(_, valid)| !**valid).for_each(|(value, _)| *value = T::default());
        }
        match &mut self.data {
            ColumnData::F64(values) => blank(values, valid),
            ColumnData::I64(values) => blank(values, valid),
            ColumnData::U64(values) => blank(values, valid),
            ColumnData::Text(values) => {
                let kept = values.iter().zip(valid).map(|(text, valid)| if *valid { text } else { "" });
                *values = kept.collect();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::TopicInfo;

    const TEXT: &str = "# Written by flightlag\nfloat64 gyro_0 # \"gyro[0]\"\nuint64 time_us # \"TimeUS\"\n\
                        bool gyro_0_given # given \"gyro[0]\"\n";

    fn decoded(wanted: &Wanted) -> Table {
        let mut rows = Rows::default();
        let plan = plan("flightlag/msg/A", TEXT, wanted, &mut rows).unwrap();
        for (number, given) in [(1_u64, 1), (2, 0)] {
            let payload =
                [&[0, 1, 0, 0][..], &0.5_f64.to_le_bytes(), &(u64::MAX - number).to_le_bytes(), &[given]].concat();
            plan.decode(&payload, &mut rows).unwrap();
            rows.close(0, None, number);
        }
        let mut table = rows.into_table(TopicInfo::default());
        let _ = leave_out_placeholders(&mut table);
        table
    }

    #[test]
    fn fields_have_their_original_names_and_placeholders_are_absent() {
        let table = decoded(&Wanted::All);
        let paths: Vec<&str> = table.columns.iter().map(|c| c.path.as_str()).collect();
        assert_eq!(paths, ["TimeUS", "gyro[0]"]);
        assert_eq!([0, 1].map(|row| table.columns[0].unsigned(row)), [Some(u64::MAX - 1), Some(u64::MAX - 2)]);
        assert_eq!([0, 1].map(|row| table.columns[1].number(row)), [Some(0.5), None]);
        assert_eq!(decoded(&Wanted::of_paths(["gyro[0]", "gone"])).columns, table.columns[1..]);
    }

    #[test]
    fn a_definition_without_all_names_is_rejected() {
        for text in ["float64 a", "float64 a # b", "float64 a # \"a\"\nfloat64 b", "float64 a # \"\\u0001a\""] {
            assert!(plan("flightlag/msg/A", text, &Wanted::All, &mut Rows::default()).is_err(), "{text}");
        }
    }

    #[test]
    fn duplicate_names_and_flags_of_missing_fields_are_rejected() {
        for second in ["float64 b # \"a\"", "bool b # given \"b\"", "bool b # given \"a\"\nbool c # given \"a\""] {
            let text = format!("float64 a # \"a\"\n{second}");
            assert!(plan("flightlag/msg/A", &text, &Wanted::All, &mut Rows::default()).is_err(), "{text}");
        }
    }

    #[test]
    fn presence_flags_work_even_at_the_limit_of_columns() {
        let name = |number: usize| format!("f{number:05}");
        let fields = (0..4100).map(|n| format!("uint64 {} # \"{}\"\n", name(n), name(n))).collect::<String>();
        let text = fields + "bool given # given \"f00007\"\n";
        let mut rows = Rows::default();
        let plan = plan("flightlag/msg/A", &text, &Wanted::All, &mut rows).unwrap();
        let payload = [&[0, 1, 0, 0][..], &[7; 8 * 4100], &[0]].concat();
        plan.decode(&payload, &mut rows).unwrap();
        rows.close(0, None, 1);
        assert_eq!(rows.turned_away(), 4);
        let mut table = rows.into_table(TopicInfo::default());
        let _ = leave_out_placeholders(&mut table);
        assert_eq!(table.columns.len(), 4096);
        assert_eq!(["f00006", "f00007"].map(|path| table.column(path).unwrap().number(0).is_some()), [true, false]);
    }
}
