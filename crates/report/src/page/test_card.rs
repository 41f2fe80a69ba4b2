//! Content of the test cards: front matter, instrumentation, and which cards are done.

use super::Head::{self, Number, Text};
use super::{badge, fact, more, table};
use crate::criterion::criterion_sentence;
use crate::number;
use crate::text::{href, shown};
use maud::{Markup, html};
use record::{
    CampaignTest, CardCoverage, CardFlight, CardStatus, FlightTest, FlownCard, TestAircraft, TestCard, TestCardSource,
    TestConditions, TestInstrument, TestReport,
};

/// Maximum number of flights named for one card; the record has all.
const MOST_FLIGHTS: usize = 50;

/// Cards, report and aircraft in one line below the title of a flight; empty without a card.
pub(super) fn flight_line(test: Option<&FlightTest>) -> Markup {
    let Some(test) = test else { return html! {} };
    html! {
        p.note {
            @for flown in &test.cards {
                "Test card " (card_name(&flown.card)) ": " (status_badge(flown.status)) " "
            }
            (front_line(test.title.as_deref(), &test.report, &test.aircraft))
        }
    }
}

/// Report and aircraft in one line below the title of a campaign.
pub(super) fn campaign_line(test: Option<&CampaignTest>) -> Markup {
    let Some(test) = test else { return html! {} };
    html! { p.note { (front_line(test.title.as_deref(), &test.report, &test.aircraft)) } }
}

fn front_line(title: Option<&str>, report: &TestReport, aircraft: &TestAircraft) -> Markup {
    let number = report.number.as_ref().map(|number| format!("report {number}"));
    let issue = report.issue.as_ref().map(|issue| format!("issue {issue}"));
    let author = report.author.as_ref().map(|author| format!("by {author}"));
    let parts = [title.map(str::to_owned), number, issue, report.date.clone(), author, aircraft.name.clone()];
    html! { (shown(&parts.into_iter().flatten().collect::<Vec<_>>().join(" · "))) }
}

/// The test-card section of a flight's page.
pub(super) fn flight_section(test: Option<&FlightTest>) -> Markup {
    html! {
        h2 #test-card { "Test card" }
        @match test {
            None => p.note {
                "Not provided. Objective, configuration, instrumentation and conditions are read from " code { "NAME.test-card.toml" }
                " in the folder of the log and " code { "test-card.toml" } " in the folder of flights."
            }
            Some(test) => {
                @if test.cards.is_empty() { p { "No test card lists this flight." } }
                @for flown in &test.cards { (flown_card(flown)) }
                (front_matter(&test.report, &test.aircraft, &test.conditions))
                (instrumentation(&test.instrumentation))
                (sources(&test.sources))
            }
        }
    }
}

/// The test-card section of a campaign's page; empty without a card.
pub(super) fn campaign_section(test: Option<&CampaignTest>) -> Markup {
    let Some(test) = test else { return html! {} };
    let with = |status| test.coverage.iter().filter(|card| card.status == status).count() as u64;
    let are_planned = test.coverage.iter().any(|card| card.is_planned);
    let head = [Text("Card"), Text("Title"), Text("Priority"), Text("State"), Text("Flights")];
    html! {
        h2 #test-cards { "Test cards" }
        p.answer {
            b { (number::count(with(CardStatus::Done))) " of " (number::counted(test.coverage.len() as u64, "card", "cards")) " done" }
            ", " (number::count(with(CardStatus::Repeat))) " to repeat, " (number::count(with(CardStatus::Missing))) " missing; "
            (number::counted(test.flights_without_card, "flight", "flights")) " without a card."
        }
        (table("Test cards by flight", &head, html! {
            @for card in &test.coverage { (coverage_row(card, are_planned)) }
        }))
        p.note {
            "DONE: one of its flights has a result and meets the criteria, or there are none. REPEAT: flown, but each flight fails a \
             criterion, cannot decide one, or has no result. MISSING: no flight has flown it."
        }
        details {
            summary { "Front matter and instrumentation" }
            (front_matter(&test.report, &test.aircraft, &test.conditions))
            (instrumentation(&test.instrumentation))
            (sources(test.source.as_slice()))
        }
    }
}

fn coverage_row(card: &CardCoverage, are_planned: bool) -> Markup {
    let flight = |of: &CardFlight| {
        html! {
            a href=(href(&of.page)) { bdi { (shown(&of.flight)) } } " " (status_badge(of.status))
            @if !of.why.is_empty() { " " (shown(&of.why)) }
        }
    };
    html! {
        tr {
            th scope="row" { (shown(&card.card.number)) @if are_planned && !card.is_planned { " (not planned)" } }
            td { (provided(card.card.title.as_deref())) }
            td { (provided(card.card.priority.as_deref())) }
            td { (status_badge(card.status)) }
            td.any {
                @if card.flights.is_empty() { "none" }
                @for (n, of) in card.flights.iter().take(MOST_FLIGHTS).enumerate() { @if n > 0 { ", " } (flight(of)) }
                @if let Some(rest) = card.flights.len().checked_sub(MOST_FLIGHTS).filter(|rest| *rest > 0) { ", " (more(rest)) }
            }
        }
    }
}

fn flown_card(flown: &FlownCard) -> Markup {
    let card = &flown.card;
    let facts = html! {
        (fact("Objective", provided(card.objective.as_deref())))
        (fact("Priority", provided(card.priority.as_deref())))
        (fact("Procedure", listed(&card.procedure)))
        (fact("Limits", listed(&card.limits)))
        (fact("State after this flight", html! {
            (status_badge(flown.status)) @if !flown.why.is_empty() { " " (shown(&flown.why)) }
        }))
    };
    html! {
        h3 { (card_name(card)) }
        (table(&format!("Test card {}", card.number), &[Text("Item"), Text("Value")], facts))
        @if let Some(judged) = &flown.criteria {
            p { "Criteria of the card, " code { (shown(&judged.criteria.file)) } ":" }
            ul.plain { @for finding in &judged.findings { li { (shown(&criterion_sentence(finding))) } } }
        }
    }
}

/// `TC-01 “Turns at constant speed”`.
fn card_name(card: &TestCard) -> Markup {
    html! { bdi { (shown(&card.number)) } @if let Some(title) = &card.title { " “" (shown(title)) "”" } }
}

fn status_badge(status: CardStatus) -> Markup {
    match status {
        CardStatus::Done => badge("ok", "✓", "DONE"),
        CardStatus::Repeat => badge("unsure", "↻", "REPEAT"),
        CardStatus::Missing => badge("off", "○", "MISSING"),
    }
}

/// A text of the card, or a note that it is missing.
fn provided(text: Option<&str>) -> Markup {
    match text {
        Some(text) => html! { (shown(text)) },
        None => html! { span.none { "not provided" } },
    }
}

fn listed(items: &[String]) -> Markup {
    match items {
        [] => provided(None),
        [one] => provided(Some(one)),
        all => html! { ol { @for item in all { li { (shown(item)) } } } },
    }
}

fn front_matter(report: &TestReport, aircraft: &TestAircraft, conditions: &TestConditions) -> Markup {
    let number = |value: Option<f64>| value.map(number::exact);
    let distribution = (!report.distribution.is_empty()).then(|| report.distribution.join(", "));
    let rows = [
        ("Report number", report.number.clone()),
        ("Issue", report.issue.clone()),
        ("Date", report.date.clone()),
        ("Author", report.author.clone()),
        ("Checked by", report.checker.clone()),
        ("Approved by", report.approver.clone()),
        ("Distribution", distribution),
        ("Aircraft", aircraft.name.clone()),
        ("Mass (kg)", number(aircraft.mass_kg)),
        ("Centre of gravity", aircraft.centre_of_gravity.clone()),
        ("Configuration", aircraft.configuration.clone()),
        ("Software", aircraft.software.clone()),
        ("Place", conditions.place.clone()),
        ("Wind", conditions.wind.clone()),
        ("Temperature (°C)", number(conditions.temperature_c)),
        ("Satellites", conditions.satellites.map(|n| n.to_string())),
    ];
    table(
        "Front matter, aircraft and conditions",
        &[Text("Item"), Text("Value")],
        html! {
            @for (name, value) in &rows { (fact(name, provided(value.as_deref()))) }
        },
    )
}

fn instrumentation(rows: &[TestInstrument]) -> Markup {
    let head: [Head; 10] = [
        Text("Channel"),
        Text("Sensor"),
        Text("Serial"),
        Text("Range"),
        Text("Resolution"),
        Number("Rate (Hz)"),
        Text("Timestamps from"),
        Text("Calibrated"),
        Text("Certificate"),
        Text("Standard uncertainty (k = 1)"),
    ];
    let row = |row: &TestInstrument| {
        let words = [&row.sensor, &row.serial, &row.range, &row.resolution];
        let rest = [&row.timestamp_source, &row.calibrated_on, &row.certificate, &row.standard_uncertainty];
        html! {
            tr {
                th scope="row" { code { (shown(&row.channel)) } }
                @for word in words { td { (provided(word.as_deref())) } }
                td.n { (provided(row.rate_hz.map(number::exact).as_deref())) }
                @for word in rest { td { (provided(word.as_deref())) } }
            }
        }
    };
    html! {
        @if rows.is_empty() { p { "Instrumentation: " (provided(None)) "." } }
        @else { (table("Instrumentation, as the test card states it", &head, html! { @for of in rows { (row(of)) } })) }
    }
}

fn sources(sources: &[TestCardSource]) -> Markup {
    html! {
        p.note {
            "From "
            @for (n, source) in sources.iter().enumerate() {
                @if n > 0 { " and " } (shown(&source.file)) " (BLAKE3 " span.hash { (shown(&source.blake3)) } ")"
            }
            "."
        }
    }
}
