//! The page of a campaign: the answer, what to do, and all flights, most severe first.

mod attention;
mod excerpts;
mod flights;
mod group_cards;
mod matrix;
mod todo;

pub use excerpts::{TrackExcerpt, excerpt_flights};
pub use flights::TABLE_FOLDER;
pub(super) use group_cards::p_value;

use super::Head::Text;
use super::{
    Needs, badge, command_block, criteria, document, estimate, figure, files, finding, more, no_number,
    pipeline_details, pipeline_rows, plain, table, test_card, versions,
};
use crate::figure::{Figure, effects, forest, trend, valley};
use crate::number;
use crate::site::Site;
use crate::text::shown;
use crate::verdict::{AGREE_P, DIFFER_P, in_millis, is_relative};
use maud::{Markup, html};
use record::{
    CampaignDelay, CampaignRecord, ControlPoint, CriterionVerdict, DelayOverFlights, EffectVerdict, Estimate, Finding,
    FlightHomogeneity, FlightRow, Gravity, GroupLateness, Outcome, flight_alarms,
};
use std::collections::{BTreeMap, BTreeSet};

/// Maximum number of paths listed for one reason; the record has all.
const MOST_PATHS: usize = 500;
/// Maximum number of flights named as outside their limits.
const MOST_OUTSIDE: usize = 20;
/// Maximum number of flights with which the forest plot leaves room for a figure below it.
const LOW_FOREST: usize = 30;
/// Maximum number of groups whose agreement is shown; the record has all.
const MOST_GROUPS: usize = 6;

/// The page of a campaign: `index.html`, and its figures also in `figures/`. [`FlightRow::page`] is a path relative to
/// this page, not yet percent-encoded. If one table cannot hold all flights, the tables are separate pages in
/// [`TABLE_FOLDER`].
#[must_use]
pub fn campaign_site(record: &CampaignRecord, excerpts: &[TrackExcerpt]) -> Site {
    let mut site = Site::default();
    let of_flights: Vec<Figure> = [forest(record), trend(record), effects(record)].into_iter().flatten().collect();
    let of_groups: Vec<(&GroupLateness, &CampaignDelay, Option<Figure>)> = agreeing(record);
    let mut figures = Figures { of_flights, of_groups };
    figures.number(record.flights.len());
    for figure in figures.all() {
        site.add_figure(figure);
    }
    for (path, page) in flights::pages(record) {
        site.add(&path, page);
    }
    let title = format!("{} — flightlag campaign", record.name);
    site.add("index.html", document(&title, Needs::Table, body(record, &figures, excerpts)));
    site
}

/// The figures of the page in page order.
struct Figures<'a> {
    of_flights: Vec<Figure>,
    /// Groups whose agreement is shown, each with its valley plot.
    of_groups: Vec<(&'a GroupLateness, &'a CampaignDelay, Option<Figure>)>,
}

impl Figures<'_> {
    fn all(&self) -> impl Iterator<Item = &Figure> {
        self.of_flights.iter().chain(self.of_groups.iter().filter_map(|(_, _, figure)| figure.as_ref()))
    }

    /// Two columns: the forest plot, whose height grows with its flights, and the others.
    fn columns(&self, flights: usize) -> impl Iterator<Item = Vec<&Figure>> {
        let (left, right): (Vec<&Figure>, Vec<&Figure>) =
            self.of_flights.iter().partition(|figure| is_left(figure, flights));
        [left, right].into_iter().filter(|column| !column.is_empty())
    }

    /// Numbers the figures in reading order: the left column first.
    fn number(&mut self, flights: usize) {
        self.of_flights.sort_by_key(|figure| !is_left(figure, flights));
        let valleys = self.of_groups.iter_mut().filter_map(|(_, _, figure)| figure.as_mut());
        (1..).zip(self.of_flights.iter_mut().chain(valleys)).for_each(|(number, figure)| figure.number = number);
    }
}

/// Whether the figure is in the left column. A low forest has the effects below it.
fn is_left(figure: &Figure, flights: usize) -> bool {
    match figure.id.as_str() {
        "lateness" => true,
        "effect" => flights <= LOW_FOREST,
        _ => false,
    }
}

/// Groups with two or more flights and a consistency result, largest first.
fn agreeing(record: &CampaignRecord) -> Vec<(&GroupLateness, &CampaignDelay, Option<Figure>)> {
    let groups = record.groups.iter().filter(|g| g.members.len() > 1);
    let shown = groups.filter_map(|g| Some((g, g.consistency.as_ref()?))).take(MOST_GROUPS).enumerate();
    let with_figure = shown.map(|(k, (group, delay))| {
        let rows = members(group, &record.flights);
        let removed: BTreeSet<u64> =
            rows.iter().filter_map(|r| r.delay_s).filter(|s| s.is_finite()).map(f64::to_bits).collect();
        // A separate delay for each flight would clutter the curve.
        let removed: Vec<f64> =
            if removed.len() <= 3 { removed.into_iter().map(f64::from_bits).collect() } else { vec![] };
        (group, delay, valley(group, delay, &removed, &format!("valley-{}", k + 1)))
    });
    with_figure.collect()
}

/// The flights in a group.
fn members<'a>(group: &GroupLateness, flights: &'a [FlightRow]) -> Vec<&'a FlightRow> {
    let names: BTreeSet<&str> = group.members.iter().map(String::as_str).collect();
    flights.iter().filter(|row| names.contains(row.flight.as_str())).collect()
}

fn body(record: &CampaignRecord, figures: &Figures<'_>, excerpts: &[TrackExcerpt]) -> Markup {
    html! {
        a.skip href="#all" { "Skip to the flights" }
        nav aria-label="On this page" {
            a href="#todo" { "Do this" }
            @for of in &figures.of_flights { a href={ "#" (of.id) } { (short_name(of)) } }
            a href="#attention" { "Needs attention" } a href="#all" { "All flights" }
            @if record.criteria.is_some() { a href="#criteria" { "Criteria" } }
            @if record.test.is_some() { a href="#test-cards" { "Test cards" } }
            @if !figures.of_groups.is_empty() { a href="#delay" { "Agreement in each group" } }
            @if !excerpts.is_empty() { a href="#excerpts" { "North and east" } }
            a href="#ignored" { "Inputs not processed" } a href="#provenance" { "Provenance" }
        }
        main {
            h1 { (shown(&record.name)) }
            (test_card::campaign_line(record.test.as_ref()))
            p.note { (shown(&record.pipeline.title)) }
            (answer(record))
            (todo::todo(record))
            p { a href="since-last-run.html" { "What changed since the last run" } }
            (group_cards::others(record))
            div.side-by-side {
                @for column in figures.columns(record.flights.len()) { div { @for of in column { (figure(of)) } } }
            }
            (attention::attention(record))
            (flights::section(record))
            @if let Some(of) = &record.criteria { (criteria::campaign_section(of, matrix::matrix(record, of))) }
            (test_card::campaign_section(record.test.as_ref()))
            (agreement(record, figures))
            (excerpts::section(record, excerpts))
            (ignored(record))
            (provenance(record))
        }
    }
}

fn short_name(figure: &Figure) -> &str {
    match figure.id.as_str() {
        "lateness" => "How late",
        "trend" => "Over the date",
        "effect" => "What the removal did",
        other => other,
    }
}

fn answer(record: &CampaignRecord) -> Markup {
    let t = &record.totals;
    let is_removed = record.flights.iter().any(|r| r.delay_s.is_some());
    let measured = if is_removed { "measured with nothing removed" } else { "measured" };
    html! {
        p.answer {
            @if t.helped > 0 || t.harmed > 0 { b { "Helped " (number::count(t.helped)) " of " (number::counted(t.flights, "flight", "flights")) } }
            @else if is_removed {
                b { (number::counted(t.flights, "flight", "flights")) ", no removal helped or harmed" }
            } @else { b { (number::counted(t.flights, "flight", "flights")) ", nothing was removed" } }
            @if t.harmed > 0 { ", " (badge("bad", "✗", "HARMED")) " " b { (number::count(t.harmed)) } }
            @let unclear = t.compensated.saturating_sub(t.helped).saturating_sub(t.harmed);
            @for (count, words) in [
                (if t.helped > 0 || t.harmed > 0 { unclear } else { 0 }, "with no clear effect"), (t.uncompensated, measured),
                (t.not_measurable, "not measurable"), (t.pending, "pending"), (t.failed, "failed"),
            ] { @if count > 0 { ", " (number::count(count)) " " (words) } }
            @if t.varying > 0 { "; " (number::counted(t.varying, "flight", "flights")) " with a delay that changes" }
            @match (t.lossy, t.flights) {
                (0, _) => {}
                (_, 1) => { "; the log is damaged" }
                (lossy, all) => { "; " (number::count(lossy)) " of the " (number::count(all)) " logs " (if lossy == 1 { "is" } else { "are" }) " damaged" }
            }
            "; " (number::bytes(t.bytes)) " of logs"
            @if t.duration_s > 0.0 { ", " (number::lasting(t.duration_s)) " compensated" }
            ". ± is U with k\u{a0}=\u{a0}2."
        }
        (group_cards::first(record))
    }
}

/// Whether the removal made the flight worse.
fn is_harmed(row: &FlightRow) -> bool {
    row.effect.as_ref().is_some_and(|e| e.verdict == EffectVerdict::Harmed)
}

/// Sort key: severity of a flight (0 is the most severe), then its name.
fn gravity(row: &FlightRow) -> (u8, &str) {
    let alarms = flight_alarms(row.lateness.as_ref(), row.decision.as_ref());
    let any = |gravity| alarms.iter().any(|a| a.gravity == gravity);
    let judged = |verdict| row.criteria.as_ref().is_some_and(|c| c.overall == verdict);
    let rank = match row.outcome {
        Outcome::Failed { .. } => 0,
        _ if is_harmed(row) => 1,
        _ if any(Gravity::Red) || judged(CriterionVerdict::Fail) => 2,
        _ if row.lossy => 3,
        Outcome::NotMeasurable { .. } | Outcome::Pending { .. } => 4,
        _ if any(Gravity::Amber) || !row.attention.is_empty() => 5,
        _ if judged(CriterionVerdict::Inconclusive) => 6,
        Outcome::Compensated | Outcome::Uncompensated { .. } => 7,
    };
    (rank, &row.flight)
}

/// The combined delay of the flights in each group. Flights in different groups are never averaged.
fn agreement(record: &CampaignRecord, figures: &Figures<'_>) -> Markup {
    let left_out = record
        .groups
        .iter()
        .filter(|g| g.members.len() > 1 && g.consistency.is_some())
        .count()
        .saturating_sub(MOST_GROUPS);
    html! {
        @if !figures.of_groups.is_empty() {
            h2 #delay { "Agreement in each group" }
            p.note {
                "Position against velocity: a check of consistency between flights. If the lateness of the position is \
                 known, it is above, and differs from this by the lateness of the velocity."
            }
            @for (group, delay, valley) in &figures.of_groups { (group_delay(group, &record.flights, delay, valley.as_ref())) }
            @if left_out > 0 { p.note { (number::counted(left_out as u64, "smaller group is", "smaller groups are")) " in campaign.json." } }
            p.note {
                "Mean over the flights: random effects (Paule and Mandel), its uncertainty by Hartung, Knapp, Sidik \
                 and Jonkman. Each flight counts with its measured position against velocity, whatever delay was \
                 removed from it, or none. Model errors of the channels are the same in all flights: these figures \
                 exclude them, and those of the cards above include them."
            }
        }
    }
}

fn group_delay(group: &GroupLateness, flights: &[FlightRow], delay: &CampaignDelay, valley: Option<&Figure>) -> Markup {
    let varies = |row: &&FlightRow| row.lateness.as_ref().is_some_and(|lateness| lateness.kind.varies());
    let of_group = flights.iter().filter(|row| group.members.contains(&row.flight));
    let varying: Vec<&str> = of_group.filter(varies).map(|row| row.flight.as_str()).collect();
    html! {
        h3 { bdi { (shown(&group.group.name)) } }
        @match delay.measured.found().and_then(|found| Some((found, found.homogeneity.filter(|h| h.p < DIFFER_P)?))) {
            Some((found, test)) => { (no_common_delay(found, &test, delay.card_s.as_ref())) }
            None => {
                p {
                    @if is_relative(group) { "Mean difference of the flights: " } @else { "Position later than velocity: " }
                    (finding(&delay.measured, |found| over_flights(found, delay.card_s.as_ref()))) "."
                }
                (homogeneity(delay.measured.found()))
            }
        }
        @if !varying.is_empty() {
            p {
                "Not in these figures, because the delay changes during the flight: "
                (first_names(&varying)) "."
            }
        }
        @if !group.outliers.is_empty() {
            p {
                "Not in these figures, because " @if group.outliers.len() == 1 { "it differs" } @else { "they differ" }
                " from the others: "
                (first_names(&group.outliers)) "."
            }
        }
        @if delay.measured != delay.swept {
            p { "Best delays of the flights' sweeps: " (finding(&delay.swept, |found| over_flights(found, delay.card_s.as_ref()))) "." }
        }
        (outside_limits(&delay.control))
        @match (valley, &delay.curve) {
            (Some(valley), _) => { (figure(valley)) }
            (None, Finding::CannotTell(why)) => { p { "One delay for all of them: " (no_number(why)) } }
            (None, Finding::Found(_)) => {}
        }
    }
}

fn first_names(flights: &[impl AsRef<str>]) -> Markup {
    html! {
        @for (i, flight) in flights.iter().take(MOST_OUTSIDE).enumerate() { @if i > 0 { ", " } bdi { (shown(flight.as_ref())) } }
        @if flights.len() > MOST_OUTSIDE { ", " (more(flights.len() - MOST_OUTSIDE)) }
    }
}

fn outside_limits(control: &[ControlPoint]) -> Markup {
    let outside: Vec<&ControlPoint> = control.iter().filter(|p| p.is_outside).collect();
    html! {
        @if !outside.is_empty() {
            p.why.unsure {
                (badge("unsure", "!", "Outside")) " Outside three standard uncertainties of the difference: "
                @for (i, point) in outside.iter().take(MOST_OUTSIDE).enumerate() {
                    @if i > 0 { ", " } bdi { (shown(&point.flight)) } " (" (estimate(&in_millis(&point.delay_s))) "\u{a0}ms)"
                }
                @if outside.len() > MOST_OUTSIDE { ", " (more(outside.len() - MOST_OUTSIDE)) }
                "."
            }
        }
    }
}

/// If the flights differ, their mean describes no flight and is not shown as the headline.
fn no_common_delay(found: &DelayOverFlights, test: &FlightHomogeneity, card: Option<&Estimate>) -> Markup {
    html! {
        p {
            b { "No common delay" }
            @if let Some(between) = found.between_s { ": the flights differ by " (plain(between * 1e3, 2)) "\u{a0}ms, 1\u{a0}σ" }
            " (χ² = " (plain(test.chi2, 3)) ", " (number::counted(test.degrees_of_freedom, "degree", "degrees")) " of freedom, "
            (group_cards::p_value(test.p)) "). Their mean, " (estimate(&in_millis(&found.delay_s))) "\u{a0}ms over "
            (number::counted(found.flights, "flight", "flights")) ", describes none of them"
            (against_card(found, card)) "."
        }
    }
}

fn over_flights(found: &DelayOverFlights, card: Option<&Estimate>) -> Markup {
    html! {
        b { (estimate(&in_millis(&found.delay_s))) "\u{a0}ms" } " over " (number::counted(found.flights, "flight", "flights"))
        @if let Some(between) = found.between_s {
            ", spread between flights beyond their own uncertainties " (plain(between * 1e3, 2)) "\u{a0}ms"
        }
        (against_card(found, card))
    }
}

/// The delay on the sensor card, and whether it agrees.
fn against_card(found: &DelayOverFlights, card: Option<&Estimate>) -> Markup {
    let e_n = card
        .filter(|_| found.delay_s.standard_uncertainty.is_some())
        .and_then(|card| found.delay_s.normalised_difference(card));
    html! {
        @if let (Some(card), Some(e_n)) = (card, e_n) {
            "; the sensor card has " (estimate(&in_millis(card))) "\u{a0}ms: "
            @if e_n.abs() <= 1.0 { (badge("ok", "✓", "agrees")) } @else { (badge("bad", "✗", "differs")) }
            ", E_n = " (plain(e_n, 2))
        }
    }
}

fn homogeneity(found: Option<&DelayOverFlights>) -> Markup {
    html! {
        @if let Some(h) = found.and_then(|f| f.homogeneity) {
            p {
                "One difference for all flights: χ² = " (plain(h.chi2, 3)) " with "
                (number::counted(h.degrees_of_freedom, "degree", "degrees")) " of freedom, " (group_cards::p_value(h.p)) ": "
                @if h.p < AGREE_P { "disagreement is likely." } @else { "the flights are consistent with it." }
            }
        }
    }
}

fn ignored(record: &CampaignRecord) -> Markup {
    let mut by_reason: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for input in &record.ignored {
        by_reason.entry(&input.reason).or_default().push(&input.path);
    }
    html! {
        h2 #ignored { "Inputs not processed" }
        @if record.ignored.is_empty() { p { "None: every file in the folder belongs to a flight." } }
        @else { p { (number::counted(record.ignored.len() as u64, "file", "files")) ", by reason:" } }
        @for (reason, paths) in &by_reason {
            details {
                summary { (number::counted(paths.len() as u64, "file", "files")) ": " (shown(reason)) }
                ul.plain {
                    @for path in paths.iter().take(MOST_PATHS) { li { (shown(path)) } }
                    @if let Some(more) = paths.len().checked_sub(MOST_PATHS).filter(|more| *more > 0) {
                        li { "and " (number::count(more as u64)) " more, in the campaign's record (JSON)" }
                    }
                }
            }
        }
    }
}

fn provenance(record: &CampaignRecord) -> Markup {
    let facts = html! {
        (pipeline_rows(&record.pipeline))
        tr {
            th scope="row" { "Versions" }
            td {
                "flightlag " (shown(&record.flightlag_version)) ", "
                (versions(record.record_version, record.analysis_version))
            }
        }
    };
    html! {
        h2 #provenance { "Provenance" }
        (table("Result", &[Text("Item"), Text("Value")], facts))
        (pipeline_details(&record.pipeline))
        h3 { "Make it again" }
        (command_block(&record.command))
        p.note { "Run it in the folder that holds what it names. The same logs, settings and versions give the same bytes, whatever the number of threads." }
        (files(&["campaign.json", "flights.csv", "flights.parquet", "run.json"]))
    }
}
