//! Fields that the user's map names and the log lacks.

use super::conditions::is_for;
use super::trial::Trial;
use crate::map::{ChannelMap, ChannelRule, Closeness, MapLibrary};
use formats::{Log, Table};
use settings::nearest;

/// A shipped map lists fields that some logs of a kind have; in the user's own map every field is meant. A missing
/// field is then a mistake, unless the channel is `optional`, its names are copied from a shipped map, or the log has
/// no topic of the channel.
///
/// # Errors
/// Every such field with its channel and the nearest name.
pub(super) fn check(best: &Trial<'_>, log: &Log) -> Result<(), String> {
    if best.map.shipped {
        return Ok(());
    }
    let with_fields = |rule| Some((rule, missing(rule, best, log)?));
    let mut missing: Vec<(&ChannelRule, String)> = wanted(best.map, log).filter_map(with_fields).collect();
    if !missing.is_empty() {
        let shipped = MapLibrary::shipped().map_err(|e| e.to_string())?;
        let copied =
            |rule: &ChannelRule| shipped.iter().flat_map(|map| &map.rules).any(|known| known.has_names_of(rule));
        missing.retain(|(rule, _)| !copied(rule));
    }
    let missing: Vec<String> = missing.into_iter().map(|(_, fields)| fields).collect();
    match missing.as_slice() {
        [] => Ok(()),
        missing => Err(format!(
            "the channel map {} names fields that the log does not have: {}; correct the names, or write `optional = \
             true` in the channel",
            best.map.name,
            missing.join("; ")
        )),
    }
}

/// The first rule for each channel name that the log does not exclude, if the channel is required.
fn wanted<'m>(map: &'m ChannelMap, log: &Log) -> impl Iterator<Item = &'m ChannelRule> {
    let met = |rule: &&ChannelRule| rule.when.as_ref().is_none_or(|when| is_for(when, log));
    let rules: Vec<&ChannelRule> = map.rules.iter().filter(met).collect();
    let mut kept: Vec<&ChannelRule> = vec![];
    for rule in rules {
        if !map.optional.contains(&rule.name) && kept.iter().all(|known| known.name != rule.name) {
            kept.push(rule);
        }
    }
    kept.into_iter()
}

/// What the table of a rule lacks: the table it is bound to, or else the closest one that has rows.
fn missing(rule: &ChannelRule, best: &Trial<'_>, log: &Log) -> Option<String> {
    let bound = best.plans.iter().find(|plan| plan.rule.name == rule.name);
    // Another rule of the same name bound the channel.
    if bound.is_some_and(|plan| !std::ptr::eq(plan.rule, rule)) {
        return None;
    }
    let closest = || {
        let close = |table: &&Table| rule.meets(&table.topic);
        let with_rows = log.tables.iter().filter(|table| table.rows > 0 && close(table).is_some());
        with_rows.min_by_key(|table| (close(table).unwrap_or(FAR), usize::MAX - has_of(rule, table, log)))
    };
    let table = bound.map(|plan| plan.table).or_else(closest)?;
    let lacks = |paths: &[&str]| !paths.is_empty() && !paths.iter().any(|path| has(table, log, path));
    let parts = rule.parts.iter().map(|part| part.fields.iter().map(|f| f.path.as_str()).collect::<Vec<_>>());
    let mut lacking: Vec<String> = parts.filter(|paths| lacks(paths)).map(|paths| listed(&paths, table, log)).collect();
    if bound.is_none() {
        let times: Vec<String> = rule.time_fields();
        let times: Vec<&str> = times.iter().map(String::as_str).collect();
        lacking.extend(
            Some(times)
                .filter(|times| lacks(times) && !rule.may_be_timed_by_container())
                .map(|t| listed(&t, table, log)),
        );
    }
    (!lacking.is_empty()).then(|| format!("{}: topic {} has no {}", rule.name, table.topic.name, lacking.join(", no ")))
}

const FAR: Closeness = Closeness { choice: usize::MAX, distance: u8::MAX, instance: u32::MAX };

fn has(table: &Table, log: &Log, path: &str) -> bool {
    let named = || log.head(&table.topic.name).is_some_and(|head| head.names.iter().any(|name| name == path));
    table.column(path).is_some() || named()
}

fn has_of(rule: &ChannelRule, table: &Table, log: &Log) -> usize {
    rule.parts.iter().flat_map(|part| &part.fields).filter(|field| has(table, log, &field.path)).count()
}

/// At most three names, and the nearest name to the first one that the table has.
fn listed(paths: &[&str], table: &Table, log: &Log) -> String {
    let names: Vec<String> = paths.iter().take(3).map(|path| format!("{path:?}")).collect();
    let there = log.head(&table.topic.name).into_iter().flat_map(|head| head.names.iter().map(String::as_str));
    let near = paths.first().and_then(|first| nearest(first, there));
    format!("{}{}", names.join(" or "), near.map_or(String::new(), |near| format!(" (the nearest name is {near:?})")))
}
