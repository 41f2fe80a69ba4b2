//! Matrix of criteria and flights, or criteria and groups if there are many flights.

use super::super::criteria::verdict_cell;
use super::flights::link;
use super::members;
use crate::number;
use crate::text::{label, shown};
use maud::{Markup, html};
use record::{CampaignCriteria, CampaignRecord, CriterionSummary, CriterionVerdict, FlightRow, VerdictTally};

/// Maximum number of flights with a column each.
const MOST_FLIGHTS: usize = 60;
/// Maximum number of groups with a column each.
const MOST_GROUPS: usize = 12;
/// Maximum number of criteria.
const MOST_CRITERIA: usize = 100;

pub(super) fn matrix(record: &CampaignRecord, criteria: &CampaignCriteria) -> Markup {
    let each = criteria.each.get(..criteria.each.len().min(MOST_CRITERIA)).unwrap_or_default();
    html! {
        @if record.flights.len() <= MOST_FLIGHTS { (by_flight(record, each)) } @else { (by_group(record, each)) }
    }
}

fn verdict_of(row: &FlightRow, id: &str) -> Option<CriterionVerdict> {
    row.criteria.as_ref()?.each.iter().find(|v| v.id == id).map(|v| v.verdict)
}

fn by_flight(record: &CampaignRecord, each: &[CriterionSummary]) -> Markup {
    let rows: Vec<&FlightRow> = record.flights.iter().filter(|row| row.criteria.is_some()).collect();
    html! {
        div.scroll tabindex="0" role="region" aria-label="Criteria by flight" {
            table.matrix {
                caption { "Each criterion on each flight: ✓ PASS, ✗ FAIL, ? INCONCLUSIVE, ○ NOT EVALUATED, – NOT APPLICABLE" }
                thead { tr { th scope="col" { "Criterion" } @for row in &rows { th.up scope="col" { (link(row, "")) } } } }
                tbody {
                    @for of in each {
                        tr {
                            th scope="row" { (shown(&of.title)) }
                            @for row in &rows { (verdict_cell(verdict_of(row, &of.id), &label(&row.flight))) }
                        }
                    }
                }
            }
        }
    }
}

fn by_group(record: &CampaignRecord, each: &[CriterionSummary]) -> Markup {
    let groups: Vec<_> = record.groups.iter().filter(|g| g.split.is_none()).take(MOST_GROUPS).collect();
    let columns: Vec<_> = groups.iter().map(|group| (&group.group.name, members(group, &record.flights))).collect();
    html! {
        @if !columns.is_empty() {
            div.scroll tabindex="0" role="region" aria-label="Criteria by group" {
                table {
                    caption { "Each criterion on each group: flights that pass, of those that pass, fail or are inconclusive" }
                    thead { tr { th scope="col" { "Criterion" } @for (name, _) in &columns { th scope="col" { (shown(name)) } } } }
                    tbody {
                        @for of in each {
                            tr { th scope="row" { (shown(&of.title)) } @for (_, rows) in &columns { (tally_cell(rows, &of.id)) } }
                        }
                    }
                }
            }
        }
    }
}

fn tally_cell(rows: &[&FlightRow], id: &str) -> Markup {
    let tally: VerdictTally = rows.iter().filter_map(|row| verdict_of(row, id)).collect();
    let judged = tally.pass + tally.fail + tally.inconclusive;
    let class = if tally.fail > 0 {
        "bad"
    } else if judged == 0 {
        "off"
    } else if tally.pass < judged {
        "unsure"
    } else {
        "ok"
    };
    html! {
        td class=(class) {
            @if judged == 0 { "○ not evaluated" } @else {
                (number::count(tally.pass)) " of " (number::count(judged)) @if tally.fail > 0 { ", ✗ " (number::count(tally.fail)) " FAIL" }
            }
        }
    }
}
