//! What a map asks of a row before it counts: of its own fields, or of another message of the same epoch.

use super::trial::Plan;
use crate::map_schema::RequireEntry;
use crate::reader::Log;
use crate::table::{Column, Table, numbers};
use std::collections::HashMap;

/// One condition with the numbers that it is about.
pub(super) struct Condition<'a> {
    entry: &'a RequireEntry,
    values: Values<'a>,
}

enum Values<'a> {
    Own(&'a Column),
    /// Of the row of the same epoch in the topic of this name; `None` for epochs that it does not have.
    Of(&'a str, Vec<Option<f64>>),
}

/// The conditions of a rule on the rows of `table`, as far as the log has their fields.
pub(super) fn conditions<'a>(require: &'a [RequireEntry], table: &'a Table, log: &'a Log) -> Vec<Condition<'a>> {
    let mut conditions = vec![];
    for entry in require {
        if entry.of.is_empty() {
            let own = numbers(table, &entry.field);
            conditions.extend(own.map(|column| Condition { entry, values: Values::Own(column) }));
        }
        let others = log.tables.iter().filter(|other| entry.of.contains(&other.topic.name));
        for other in others {
            let values = same_epoch(entry, table, other);
            conditions.extend(values.map(|v| Condition { entry, values: Values::Of(&other.topic.name, v) }));
        }
    }
    conditions
}

/// The field in the rows of `other` that have the number of the epoch that each row of `table` has.
fn same_epoch(entry: &RequireEntry, table: &Table, other: &Table) -> Option<Vec<Option<f64>>> {
    let epoch = entry.same.as_ref()?;
    let (here, there, field) = (numbers(table, epoch)?, numbers(other, epoch)?, numbers(other, &entry.field)?);
    let said: HashMap<i64, f64> =
        (0..other.rows).filter_map(|row| Some((there.integer(row)?, field.number(row)?))).collect();
    Some((0..table.rows).map(|row| said.get(&here.integer(row)?).copied()).collect())
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
        topic + &[min, max].into_iter().flatten().collect::<Vec<_>>().join(" or ")
    }
}

/// The first condition that a row fails, in words. A row without the field fails none.
pub(super) fn failed(plan: &Plan<'_>, row: usize) -> Option<String> {
    let fails = |c: &&Condition<'_>| c.value(row).is_some_and(|value| !c.entry.met_by(value));
    plan.conditions.iter().find(fails).map(Condition::text)
}
