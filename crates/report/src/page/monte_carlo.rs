//! The page of a Monte-Carlo study.

use super::Head::Text;
use super::{
    Needs, badge, command_block, document, estimate, fact, figure, met_badge, no_number, rows, table, table_of,
};
use crate::figure::{Figure, group_figure};
use crate::number;
use crate::site::Site;
use crate::text::shown;
use maud::{Markup, html};
use record::{MonteCarloCase, MonteCarloGroup, MonteCarloRecord};

/// The page of a study: `index.html`, and the figure of each group also as a file in
/// `figures/`.
#[must_use]
pub fn monte_carlo_site(record: &MonteCarloRecord) -> Site {
    let figures: Vec<Option<Figure>> = (1..).zip(&record.groups).map(|(n, group)| group_figure(group, n)).collect();
    let mut site = Site::default();
    for figure in figures.iter().flatten() {
        site.add_figure(figure);
    }
    site.add("index.html", document(&format!("{} — flightlag", record.title), Needs::Nothing, body(record, &figures)));
    site
}

fn body(record: &MonteCarloRecord, figures: &[Option<Figure>]) -> Markup {
    html! {
        main {
            h1 { (shown(&record.title)) }
            (goals(record))
            @for ((number, group), figure) in (1..).zip(&record.groups).zip(figures) {
                (one_group(number, group, figure.as_ref()))
            }
            h2 id="provenance" { "Provenance" }
            (table("Study", &[Text("Item"), Text("Value")], html! {
                (fact("Seed", record.seed))
                (fact("Versions", format!("record {}, report {}", record.record_version, crate::REPORT_VERSION)))
            }))
            h3 { "Make it again" }
            (command_block(&record.command))
        }
    }
}

/// Number of goals met, and each goal that is not met.
fn goals(record: &MonteCarloRecord) -> Markup {
    let cases = || record.groups.iter().flat_map(|g| &g.cases);
    let count = |wanted| cases().flat_map(|c| &c.met).filter(|met| **met == Some(wanted)).count() as u64;
    let (met, missed) = (count(true), count(false));
    let trials = cases().fold(0u64, |sum, c| sum.saturating_add(c.trials));
    html! {
        div.strip role="status" {
            span { (badge("ok", "✓", "Goal met")) " " (number::count(met)) }
            @if missed > 0 { span { (badge("bad", "✗", "Goal not met")) " " (number::count(missed)) } }
        }
        p.answer {
            b { (number::count(met)) " of " (number::counted(met + missed, "goal", "goals")) " met" } " in "
            (number::counted(cases().count() as u64, "case", "cases")) " with " (number::counted(trials, "trial", "trials")) "."
        }
        @if missed > 0 {
            ul.plain {
                @for (group, case, column) in missed_goals(record).into_iter().take(60) {
                    li { (shown(&group.title)) ", " (shown(&case.name)) ": "
                        (shown(group.columns.get(column).map_or("", String::as_str))) }
                }
            }
        }
    }
}

fn missed_goals(record: &MonteCarloRecord) -> Vec<(&MonteCarloGroup, &MonteCarloCase, usize)> {
    let cases = record.groups.iter().flat_map(|g| g.cases.iter().map(move |c| (g, c)));
    cases
        .flat_map(|(g, c)| {
            c.met.iter().enumerate().filter(|(_, met)| **met == Some(false)).map(move |(i, _)| (g, c, i))
        })
        .collect()
}

fn one_group(number: usize, group: &MonteCarloGroup, shown_figure: Option<&Figure>) -> Markup {
    html! {
        h2 id={ "group-" (number) } { (shown(&group.title)) }
        p { (shown(&group.text)) }
        (cases(group))
        @if let Some(shown) = shown_figure { (figure(shown)) }
    }
}

fn cases(group: &MonteCarloGroup) -> Markup {
    let columns = &group.columns[..group.columns.len().min(20)];
    let numbered: Vec<(usize, &MonteCarloCase)> = (1..).zip(&group.cases).collect();
    let row = |(number, case): &(usize, &MonteCarloCase)| {
        html! {
            tr {
                td.n { (number) }
                th scope="row" { (shown(&case.name)) }
                td.n { (number::count(case.trials)) }
                @for i in 0..columns.len() { td.n { (cell(case, i)) } }
            }
        }
    };
    let head = html! {
        tr {
            th.n scope="col" { "No." } th scope="col" { "Case" } th.n scope="col" { "Trials" }
            @for column in columns { th.n scope="col" { (shown(column)) } }
        }
        @if group.goals.iter().any(|goal| !goal.is_empty()) {
            tr {
                th scope="col" colspan="3" { "Goal" }
                @for i in 0..columns.len() { th.n scope="col" { (shown(group.goals.get(i).map_or("", String::as_str))) } }
            }
        }
    };
    table_of("± is U with k = 2: the error of the study", head, rows(&numbered, 400, columns.len() + 3, row))
}

fn cell(case: &MonteCarloCase, column: usize) -> Markup {
    html! {
        @match case.values.get(column).and_then(Option::as_ref) {
            Some(value) => { (estimate(value)) }
            None => { (no_number("not asked")) }
        }
        @if let Some(met) = case.met.get(column).copied().flatten() { " " (met_badge(met)) }
    }
}
