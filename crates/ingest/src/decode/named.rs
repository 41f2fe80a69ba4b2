//! Definitions of ROS 2 that `flightlag recover` wrote: each field says in its comment what it is called in the log that it
//! comes from, for ROS allows few names.
//!
//! ```text
//! float64 time_us # "TimeUS"
//! bool time_us_given # given "TimeUS"
//! ```
//!
//! The second line belongs to a field that not every row has: it is false where the value is a mere placeholder.

use super::Wanted;
use super::ros::Plan;
use super::rows::Rows;
use super::schema::{Dialect, Schema};
use crate::table::{Column, ColumnData, Table};
use std::collections::BTreeSet;

/// Stands for the encoding of such a definition.
pub(crate) const NAMED: &str = "ros2msg with names";
/// In front of the path that a field is told to be absent by; no path of a log begins with it.
const GIVEN: &str = "\u{1}";

/// How to read messages of such a definition by the names that the log has.
pub(super) fn plan(type_name: &str, text: &str, wanted: &Wanted, rows: &mut Rows) -> Result<Plan, String> {
    let mut schema = Schema::parse(type_name, text, Dialect::Ros2)?;
    let names = text.lines().filter_map(name_of).collect::<Result<Vec<String>, String>>()?;
    let fields = schema.messages.first_mut().map(|message| message.fields.as_mut_slice()).unwrap_or_default();
    if fields.len() != names.len() {
        return Err(format!("it has {} fields and names for {}", fields.len(), names.len()));
    }
    fields.iter_mut().zip(names).for_each(|(field, name)| field.name = name);
    Ok(Plan::new(&schema, &with_given(wanted), rows))
}

/// What the comment of a field says; `None` for a line that is all comment, or empty.
fn name_of(line: &str) -> Option<Result<String, String>> {
    let (_, comment) = line.split_once(" # ").filter(|_| !line.starts_with('#'))?;
    let (given, name) = comment.strip_prefix("given ").map_or(("", comment), |name| (GIVEN, name));
    let name: Result<String, _> = serde_json::from_str(name.trim_end());
    Some(name.map(|name| format!("{given}{name}")).map_err(|_| format!("{line:.100}: no name is said")))
}

/// With a field what tells whether it is there.
fn with_given(wanted: &Wanted) -> Wanted {
    match wanted {
        Wanted::All => Wanted::All,
        Wanted::Paths(paths) => {
            let given = paths.iter().map(|path| format!("{GIVEN}{path}"));
            Wanted::Paths(given.chain(paths.iter().cloned()).collect::<BTreeSet<String>>())
        }
    }
}

/// Takes out the columns that tell whether others have a value, and makes these absent where they have none.
pub(crate) fn leave_out_placeholders(table: &mut Table) {
    let (given, mut columns): (Vec<Column>, Vec<Column>) =
        std::mem::take(&mut table.columns).into_iter().partition(|column| column.path.starts_with(GIVEN));
    for told in given {
        let path = told.path.strip_prefix(GIVEN).unwrap_or_default();
        let Ok(place) = columns.binary_search_by(|column| column.path.as_str().cmp(path)) else { continue };
        let valid: Vec<bool> = (0..table.rows).map(|row| told.number(row) == Some(1.0)).collect();
        if let Some(column) = columns.get_mut(place) {
            column.blank(&valid);
            column.valid = Some(valid);
        }
    }
    table.columns = columns;
}

impl Column {
    /// Placeholders as all formats have them.
    fn blank(&mut self, valid: &[bool]) {
        fn blank<T: Default>(values: &mut [T], valid: &[bool]) {
            values.iter_mut().zip(valid).filter(|(_, valid)| !**valid).for_each(|(value, _)| *value = T::default());
        }
        match &mut self.data {
            ColumnData::F64(values) => blank(values, valid),
            ColumnData::I64(values) => blank(values, valid),
            ColumnData::U64(values) => blank(values, valid),
            ColumnData::Text(values) => blank(values, valid),
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
        leave_out_placeholders(&mut table);
        table
    }

    #[test]
    fn fields_have_the_names_of_the_log_and_placeholders_are_absent() {
        let table = decoded(&Wanted::All);
        let paths: Vec<&str> = table.columns.iter().map(|c| c.path.as_str()).collect();
        assert_eq!(paths, ["TimeUS", "gyro[0]"]);
        assert_eq!([0, 1].map(|row| table.columns[0].unsigned(row)), [Some(u64::MAX - 1), Some(u64::MAX - 2)]);
        assert_eq!([0, 1].map(|row| table.columns[1].number(row)), [Some(0.5), None]);
        assert_eq!(decoded(&Wanted::of_paths(["gyro[0]", "gone"])).columns, table.columns[1..]);
    }

    #[test]
    fn a_definition_without_all_names_is_refused() {
        for text in ["float64 a", "float64 a # b", "float64 a # \"a\"\nfloat64 b"] {
            assert!(plan("flightlag/msg/A", text, &Wanted::All, &mut Rows::default()).is_err(), "{text}");
        }
    }
}
