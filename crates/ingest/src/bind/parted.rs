//! Hands the columns of a log to the channels one after another. A column is freed once the last channel that reads it
//! is made: a flight takes as much memory as its columns, and both must not be held at once.

use super::conditions::{Condition, Values};
use super::stamps::Stamps;
use super::trial::{Found, Plan};
use crate::map::{ChannelMap, ChannelRule};
use crate::map_schema::HeightAbove;
use crate::reader::Log;
use crate::table::{Column, ColumnData, Table};
use flight::Unit;
use std::collections::HashSet;

/// A plan that names its columns without holding them.
pub(super) struct Parted {
    /// Index among the rules of the map.
    rule: usize,
    /// Index among the tables of the log.
    table: usize,
    columns: Vec<Option<Place>>,
    stamps: Vec<Stamps>,
    conditions: Vec<OnRows>,
}

/// As [`Found`].
struct Place {
    column: usize,
    unit: Unit,
    above: Option<HeightAbove>,
    passed_over: Option<usize>,
}

/// As [`Condition`].
struct OnRows {
    /// Index among the entries of the rule.
    entry: usize,
    values: OfRows,
}

/// As [`Values`].
enum OfRows {
    Own(usize),
    Topic(String, Vec<Option<f64>>),
}

/// The index of an element in a slice, by address.
fn place_of<T>(all: &[T], one: &T) -> usize {
    all.iter().position(|other| std::ptr::eq(other, one)).unwrap_or(usize::MAX)
}

impl Parted {
    /// From a plan of this map for this log.
    pub(super) fn of(plan: Plan<'_>, map: &ChannelMap, log: &Log) -> Parted {
        let column = |column: &Column| place_of(&plan.table.columns, column);
        let place = |found: &Found<'_>| Place {
            column: column(found.column),
            unit: found.unit,
            above: found.above,
            passed_over: found.passed_over.map(column),
        };
        let columns = plan.columns.iter().map(|found| found.as_ref().map(place)).collect();
        let on_rows = |condition: Condition<'_>| OnRows {
            entry: place_of(&plan.rule.require, condition.entry),
            values: match condition.values {
                Values::Own(own) => OfRows::Own(column(own)),
                Values::Of(topic, values) => OfRows::Topic(topic.into_owned(), values),
            },
        };
        Parted {
            rule: place_of(&map.rules, plan.rule),
            table: place_of(&log.tables, plan.table),
            columns,
            conditions: plan.conditions.into_iter().map(on_rows).collect(),
            stamps: plan.stamps,
        }
    }

    /// The columns that it reads.
    fn reads(&self) -> impl Iterator<Item = (usize, usize)> {
        let found = self.columns.iter().flatten().flat_map(|place| place.passed_over.into_iter().chain([place.column]));
        let asked = self.conditions.iter().filter_map(|condition| match condition.values {
            OfRows::Own(column) => Some(column),
            OfRows::Topic(..) => None,
        });
        found.chain(asked).map(|column| (self.table, column))
    }

    /// The table with the columns that the plan reads, taken out of the log, and their indices.
    fn take_columns(&self, log: &mut Log) -> Option<(Table, Vec<usize>)> {
        let mut held: Vec<usize> = self.reads().map(|(_, column)| column).collect();
        held.sort_unstable();
        held.dedup();
        let table = log.tables.get_mut(self.table)?;
        let take = |column: &usize| Some(std::mem::replace(table.columns.get_mut(*column)?, empty()));
        let columns = held.iter().map(take).collect::<Option<_>>()?;
        let (topic, origin) = (table.topic.clone(), table.origin.clone());
        let own = Table { topic, rows: table.rows, logged_ns: None, published_ns: None, origin, columns };
        Some((own, held))
    }

    /// Leaves the table only the names of its columns. Columns that others read `later` go back into the log.
    fn give_back(&self, table: &mut Table, held: &[usize], log: &mut Log, later: &[Parted]) {
        for (column, place) in table.columns.iter_mut().zip(held) {
            let named = Column { path: column.path.clone(), ..empty() };
            let values = std::mem::replace(column, named);
            let is_read = later.iter().flat_map(Parted::reads).any(|read| read == (self.table, *place));
            let of_log = log.tables.get_mut(self.table).and_then(|table| table.columns.get_mut(*place));
            if let Some(of_log) = of_log.filter(|_| is_read) {
                *of_log = values;
            }
        }
    }

    /// Rebuilds the plan with the columns of this table.
    fn plan<'p>(&self, rule: &'p ChannelRule, table: &'p Table, held: &[usize], stamps: Vec<Stamps>) -> Plan<'p> {
        let column = |of: usize| table.columns.get(held.binary_search(&of).ok()?);
        let found = |place: &Place| {
            Some(Found {
                column: column(place.column)?,
                unit: place.unit,
                above: place.above,
                passed_over: place.passed_over.and_then(column),
                said: None,
            })
        };
        let columns = self.columns.iter().map(|place| place.as_ref().and_then(found)).collect();
        Plan { rule, table, distance: 0, columns, stamps, remarks: vec![], conditions: vec![] }
    }

    /// Gives the plan to `take` with its columns, and then to `make` with the result. Columns that no part reads
    /// `later` are freed in between.
    pub(super) fn make<S, T>(
        mut self,
        map: &ChannelMap,
        log: &mut Log,
        later: &[Parted],
        take: impl FnOnce(&Plan<'_>) -> S,
        make: impl FnOnce(&Plan<'_>, S) -> T,
    ) -> Option<T> {
        let (mut table, held) = self.take_columns(log)?;
        let rule = map.rules.get(self.rule)?;
        let (stamps, conditions) = (std::mem::take(&mut self.stamps), std::mem::take(&mut self.conditions));
        let condition = |on_rows: OnRows| {
            let values = match on_rows.values {
                OfRows::Own(own) => Values::Own(table.columns.get(held.binary_search(&own).ok()?)?),
                OfRows::Topic(topic, values) => Values::Of(topic.into(), values),
            };
            Some(Condition { entry: rule.require.get(on_rows.entry)?, values })
        };
        let conditions = conditions.into_iter().filter_map(condition).collect();
        let whole = Plan { conditions, ..self.plan(rule, &table, &held, stamps) };
        let taken = take(&whole);
        let stamps = whole.stamps;
        self.give_back(&mut table, &held, log, later);
        Some(make(&self.plan(rule, &table, &held, stamps), taken))
    }
}

/// Keeps only the columns that these read.
pub(super) fn keep_columns_of(parts: &[Parted], log: &mut Log) {
    let read: HashSet<(usize, usize)> = parts.iter().flat_map(Parted::reads).collect();
    for (at, table) in log.tables.iter_mut().enumerate() {
        let others = table.columns.iter_mut().enumerate().filter(|(column, _)| !read.contains(&(at, *column)));
        others.for_each(|(_, column)| *column = empty());
        (table.logged_ns, table.published_ns) = (None, None);
    }
}

fn empty() -> Column {
    Column { path: String::new(), data: ColumnData::F64(vec![]), valid: None }
}
