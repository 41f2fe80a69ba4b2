//! Conditions that a row must meet to be used: on its own fields, or on another message of the same epoch.

use formats::{Column, Log, Table};
use map_file::{RequireEntry, WhenEntry};
use std::borrow::Cow;
use std::collections::{BTreeSet, HashMap};

/// Whether a value fulfils a condition; a NaN does not.
pub(super) fn is_met(entry: &RequireEntry, value: f64) -> bool {
    let is_set = |bit: u32| (value / 2_f64.powi(bit as i32)).floor().rem_euclid(2.0) == 1.0;
    entry.min.is_none_or(|min| value >= min) && entry.max.is_none_or(|max| value <= max) && entry.bit.is_none_or(is_set)
}

/// Whether the log is one that a channel with this remark is made for.
pub(super) fn is_for(when: &WhenEntry, log: &Log) -> bool {
    said_by(when, log).into_iter().eq(when.says.as_deref())
}

/// The log's values of the remark. If there are several, the condition is not met.
pub(super) fn said_by<'l>(when: &WhenEntry, log: &'l Log) -> BTreeSet<&'l str> {
    let remarks = log.health.extras.iter().filter_map(|extra| extra.split_once(" = "));
    remarks.filter(|(name, _)| *name == when.remark).map(|(_, text)| text).collect()
}

/// One condition with the numbers to check.
pub(super) struct Condition<'a> {
    pub(super) entry: &'a RequireEntry,
    pub(super) values: Values<'a>,
}

pub(super) enum Values<'a> {
    Own(&'a Column),
    /// From the row of the same epoch in the topic of this name; `None` for epochs that it lacks.
    Of(Cow<'a, str>, Vec<Option<f64>>),
}

/// The conditions of a rule on the rows of `table`, for those fields that the log has.
pub(super) fn conditions<'a>(require: &'a [RequireEntry], table: &'a Table, log: &'a Log) -> Vec<Condition<'a>> {
    let mut conditions = vec![];
    for entry in require {
        if entry.of.is_empty() {
            let own = table.numbers(&entry.field);
            conditions.extend(own.map(|column| Condition { entry, values: Values::Own(column) }));
        }
        let others = log.tables.iter().filter(|other| entry.of.contains(&other.topic.name));
        for other in others {
            let values = same_epoch(entry, table, other);
            conditions
                .extend(values.map(|v| Condition { entry, values: Values::Of(other.topic.name.as_str().into(), v) }));
        }
    }
    conditions
}

/// The field in the rows of `other` whose epoch numbers match those of each row of `table`. Where several rows match,
/// one that fails the condition decides, because it is unknown which of them belongs to the row.
fn same_epoch(entry: &RequireEntry, table: &Table, other: &Table) -> Option<Vec<Option<f64>>> {
    fn epochs<'t>(entry: &RequireEntry, table: &'t Table) -> Option<Vec<&'t Column>> {
        entry.same.0.iter().map(|field| table.numbers(field)).collect()
    }
    let (here, there, field) = (epochs(entry, table)?, epochs(entry, other)?, other.numbers(&entry.field)?);
    let epoch = |columns: &[&Column], row| columns.iter().map(|c| c.integer(row)).collect::<Option<Vec<i64>>>();
    let mut by_epoch: HashMap<Vec<i64>, f64> = HashMap::new();
    for (epoch, value) in (0..other.rows).filter_map(|row| epoch(&there, row).zip(field.number(row))) {
        let known = by_epoch.entry(epoch).or_insert(value);
        if is_met(entry, *known) {
            *known = value;
        }
    }
    Some((0..table.rows).map(|row| by_epoch.get(&epoch(&here, row)?).copied()).collect())
}

impl Condition<'_> {
    fn value(&self, row: usize) -> Option<f64> {
        match &self.values {
            Values::Own(column) => column.number(row),
            Values::Of(_, values) => values.get(row).copied().flatten(),
        }
    }

    fn text(&self) -> String {
        let topic = match &self.values {
            Values::Own(_) => String::new(),
            Values::Of(topic, _) => format!("{topic} of the same epoch: "),
        };
        let field = &self.entry.field;
        let min = self.entry.min.map(|min| format!("{field} is below {min}"));
        let max = self.entry.max.map(|max| format!("{field} is above {max}"));
        let bit = self.entry.bit.map(|bit| format!("bit {bit} of {field} is not set"));
        topic + &[min, max, bit].into_iter().flatten().collect::<Vec<_>>().join(" or ")
    }
}

/// The first condition that a row fails, in words. A row without the field passes.
pub(super) fn failed(conditions: &[Condition<'_>], row: usize) -> Option<String> {
    let fails = |c: &&Condition<'_>| c.value(row).is_some_and(|value| !is_met(c.entry, value));
    conditions.iter().find(fails).map(Condition::text)
}
