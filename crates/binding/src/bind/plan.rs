//! A rule of a map with the columns that it found in a log.

use super::conditions::Condition;
use super::stamp_columns::Stamps;
use crate::map::ChannelRule;
use flight::{Quantity, Unit};
use formats::{Column, Table};
use map_file::HeightAbove;

/// A rule with the columns that it found.
pub(super) struct Plan<'a> {
    pub(super) rule: &'a ChannelRule,
    pub(super) table: &'a Table,
    /// [`Closeness::distance`] of the table's name.
    pub(super) distance: u8,
    /// As [`ChannelRule::parts`]; `None` where the log lacks the field.
    pub(super) columns: Vec<Option<Found<'a>>>,
    /// The timestamps by kind, the timeline's kind first.
    pub(super) stamps: Vec<Stamps>,
    /// The assumptions made to find them.
    pub(super) remarks: Vec<String>,
    pub(super) conditions: Vec<Condition<'a>>,
}

/// A part of a channel in the log.
#[derive(Clone, Copy)]
pub(super) struct Found<'a> {
    pub(super) column: &'a Column,
    pub(super) unit: Unit,
    /// For a height: what it is above.
    pub(super) above: Option<HeightAbove>,
    /// A preferred column that is zero throughout.
    pub(super) passed_over: Option<&'a Column>,
    /// The unit that the table states and the map's unit, where they differ or the stated one is unknown.
    pub(super) stated_unit: Option<(&'a str, Unit)>,
}

/// Whether the map binds any channel of the wanted quantities.
pub(super) fn binds(plans: &[Plan<'_>], wanted: &[Quantity]) -> bool {
    plans.iter().any(|p| wanted.contains(&p.rule.quantity))
}
