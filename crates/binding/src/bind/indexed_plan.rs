//! Gives the columns of a log to the channels one after another. A column is freed once the last channel that reads it
//! is made: a flight takes as much memory as its columns, and memory must not hold both at once.

use super::conditions::{Condition, Values};
use super::plan::{Found, Plan};
use super::stamp_columns::Stamps;
use crate::map::{ChannelMap, ChannelRule};
use flight::Unit;
use formats::{Column, ColumnData, Log, Table};
use map_file::HeightAbove;
use std::collections::HashSet;

/// A plan with the indices of its columns in place of references.
pub(super) struct IndexedPlan {
    /// Index among the rules of the map.
    rule: usize,
    /// Index among the tables of the log.
    table: usize,
    columns: Vec<Option<FoundIndices>>,
    stamps: Vec<Stamps>,
    conditions: Vec<IndexedCondition>,
}

/// A [`Found`] with indices.
struct FoundIndices {
    column: usize,
    unit: Unit,
    above: Option<HeightAbove>,
    passed_over: Option<usize>,
}

/// A [`Condition`] with indices.
struct IndexedCondition {
    /// Index among the entries of the rule.
    entry: usize,
    values: IndexedValues,
}

/// [`Values`] with indices.
enum IndexedValues {
    Own(usize),
    Topic(String, Vec<Option<f64>>),
}

/// The index of an element in a slice, by address.
fn index_of<T>(all: &[T], one: &T) -> usize {
    all.iter().position(|other| std::ptr::eq(other, one)).unwrap_or(usize::MAX)
}

impl IndexedPlan {
    /// From a plan of this map for this log.
    pub(super) fn of(plan: Plan<'_>, map: &ChannelMap, log: &Log) -> IndexedPlan {
        let column = |column: &Column| index_of(&plan.table.columns, column);
        let indices = |found: &Found<'_>| FoundIndices {
            column: column(found.column),
            unit: found.unit,
            above: found.above,
            passed_over: found.passed_over.map(column),
        };
        let columns = plan.columns.iter().map(|found| found.as_ref().map(indices)).collect();
        let indexed = |condition: Condition<'_>| IndexedCondition {
            entry: index_of(&plan.rule.require, condition.entry),
            values: match condition.values {
                Values::Own(own) => IndexedValues::Own(column(own)),
                Values::Of(topic, values) => IndexedValues::Topic(topic.into_owned(), values),
            },
        };
        IndexedPlan {
            rule: index_of(&map.rules, plan.rule),
            table: index_of(&log.tables, plan.table),
            columns,
            conditions: plan.conditions.into_iter().map(indexed).collect(),
            stamps: plan.stamps,
        }
    }

    /// The columns that it reads, as indices of table and column.
    fn reads(&self) -> impl Iterator<Item = (usize, usize)> {
        let found =
            self.columns.iter().flatten().flat_map(|indices| indices.passed_over.into_iter().chain([indices.column]));
        let asked = self.conditions.iter().filter_map(|condition| match condition.values {
            IndexedValues::Own(column) => Some(column),
            IndexedValues::Topic(..) => None,
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

    /// Leaves the table only the names of its columns. Columns that plans in `later` read go back into the log.
    fn give_back(&self, table: &mut Table, held: &[usize], log: &mut Log, later: &[IndexedPlan]) {
        for (column, indices) in table.columns.iter_mut().zip(held) {
            let named = Column { path: column.path.clone(), ..empty() };
            let values = std::mem::replace(column, named);
            let is_read = later.iter().flat_map(IndexedPlan::reads).any(|read| read == (self.table, *indices));
            let of_log = log.tables.get_mut(self.table).and_then(|table| table.columns.get_mut(*indices));
            if let Some(of_log) = of_log.filter(|_| is_read) {
                *of_log = values;
            }
        }
    }

    /// Rebuilds the plan with the columns of this table.
    fn plan<'p>(&self, rule: &'p ChannelRule, table: &'p Table, held: &[usize], stamps: Vec<Stamps>) -> Plan<'p> {
        let column = |of: usize| table.columns.get(held.binary_search(&of).ok()?);
        let found = |indices: &FoundIndices| {
            Some(Found {
                column: column(indices.column)?,
                unit: indices.unit,
                above: indices.above,
                passed_over: indices.passed_over.and_then(column),
                stated_unit: None,
            })
        };
        let columns = self.columns.iter().map(|indices| indices.as_ref().and_then(found)).collect();
        Plan { rule, table, distance: 0, columns, stamps, remarks: vec![], conditions: vec![] }
    }

    /// Gives the plan to `take` with its columns, and then to `make` with the result. Columns that no plan in `later`
    /// reads are freed in between.
    pub(super) fn make<S, T>(
        mut self,
        map: &ChannelMap,
        log: &mut Log,
        later: &[IndexedPlan],
        take: impl FnOnce(&Plan<'_>) -> S,
        make: impl FnOnce(&Plan<'_>, S) -> T,
    ) -> Option<T> {
        let (mut table, held) = self.take_columns(log)?;
        let rule = map.rules.get(self.rule)?;
        let (stamps, conditions) = (std::mem::take(&mut self.stamps), std::mem::take(&mut self.conditions));
        let condition = |indexed: IndexedCondition| {
            let values = match indexed.values {
                IndexedValues::Own(own) => Values::Own(table.columns.get(held.binary_search(&own).ok()?)?),
                IndexedValues::Topic(topic, values) => Values::Of(topic.into(), values),
            };
            Some(Condition { entry: rule.require.get(indexed.entry)?, values })
        };
        let conditions = conditions.into_iter().filter_map(condition).collect();
        let whole = Plan { conditions, ..self.plan(rule, &table, &held, stamps) };
        let taken = take(&whole);
        let stamps = whole.stamps;
        self.give_back(&mut table, &held, log, later);
        Some(make(&self.plan(rule, &table, &held, stamps), taken))
    }
}

/// Keeps only the columns that these plans read.
pub(super) fn keep_columns_of(plans: &[IndexedPlan], log: &mut Log) {
    let read: HashSet<(usize, usize)> = plans.iter().flat_map(IndexedPlan::reads).collect();
    for (at, table) in log.tables.iter_mut().enumerate() {
        let others = table.columns.iter_mut().enumerate().filter(|(column, _)| !read.contains(&(at, *column)));
        others.for_each(|(_, column)| *column = empty());
        (table.logged_ns, table.published_ns) = (None, None);
    }
}

fn empty() -> Column {
    Column { path: String::new(), data: ColumnData::F64(vec![]), valid: None }
}
