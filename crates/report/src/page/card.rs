//! The page of a sensor card: each record's delay beside the combined one.

use super::Head::{Number, Text};
use super::{
    badge, basis, command_block, contents, document, estimate, fact, figure, no_number, or_why, plain, provenance,
    rows, sensor_name, table, verdict_badge,
};
use crate::draw;
use crate::figure::{Figure, Forest, anchors, card_figures};
use crate::number;
use crate::site::Site;
use crate::text::{href, shown};
use crate::verdict;
use maud::{Markup, html};
use record::{BenchOutcome, BenchRecord, CardChannel, Estimate, InputFile, SensorCard, Verdict};

/// What the page of a sensor card needs besides the card.
#[derive(Debug, Clone, Copy)]
pub struct CardPage<'a> {
    /// The card.
    pub card: &'a SensorCard,
    /// The records behind it, in the order of [`SensorCard::records`].
    pub records: &'a [CardRecord<'a>],
    /// Command that makes this page again.
    pub command: &'a str,
}

/// One record behind a card.
#[derive(Debug, Clone, Copy)]
pub struct CardRecord<'a> {
    /// The name people know.
    pub name: &'a str,
    /// What was found.
    pub record: &'a BenchRecord,
    /// Path of its page from this one, if there is one; not encoded yet.
    pub href: Option<&'a str>,
}

/// The page of a sensor card: `index.html`, and the forest plot of each channel again as a
/// file under `figures/`, called after the channel.
#[must_use]
pub fn card_site(page: &CardPage) -> Site {
    let channels = &page.card.channels;
    let forests: Vec<Vec<Forest>> = channels.iter().map(|channel| forest(channel, page.records)).collect();
    let ids: Vec<String> =
        anchors(channels.iter().map(|c| c.name.as_str())).iter().map(|a| format!("{a}-forest")).collect();
    let figures = card_figures(channels, &ids, &forests);
    let mut site = Site::default();
    for figure in figures.iter().flatten() {
        site.add(&format!("figures/{}.svg", figure.id), draw::svg_file(figure));
    }
    let title = format!("{} — flightlag sensor card", page.card.sensor.model);
    site.add("index.html", document(&title, false, body(page, &forests, &figures)));
    site
}

/// What each record says of a channel.
fn forest(channel: &CardChannel, records: &[CardRecord]) -> Vec<Forest> {
    let row = |(number, record): (usize, &CardRecord)| {
        let channels = record.record.findings.iter().flat_map(|f| &f.channels);
        let found = channels.filter(|c| c.name == channel.name).find_map(|c| c.delay.as_ref());
        let is_outlier = channel.outliers.iter().any(|name| name == record.name)
            || files(record.record).any(|file| channel.outliers.contains(&file.name));
        Forest { number, delay_s: found.map(verdict::delay), is_outlier }
    };
    (1..).zip(records).map(row).collect()
}

fn files(record: &BenchRecord) -> impl Iterator<Item = &InputFile> {
    record.logs.iter().flat_map(|log| &log.inputs)
}

fn body(page: &CardPage, forests: &[Vec<Forest>], figures: &[Option<Figure>]) -> Markup {
    let card = page.card;
    html! {
        (contents(&[("channels", "Channels"), ("records", "Records"), ("method", "Method"), ("provenance", "Provenance")]))
        main {
            h1 { "Sensor card: " (shown(&sensor_name(&card.sensor))) }
            (answer(card))
            h2 id="channels" { "Channels" }
            (channels(card))
            div.pair {
                @for ((channel, rows), figure) in card.channels.iter().zip(forests).zip(figures) {
                    div { (one_channel(channel, rows, figure.as_ref())) }
                }
            }
            h2 id="records" { "Records" }
            (records(page))
            h2 id="method" { "Method" }
            p { (shown(&card.method)) }
            h2 id="provenance" { "Provenance" }
            (facts(card))
            @for (number, record) in (1..).zip(page.records).take(40) { (inputs(number, record)) }
            h3 { "Make it again" }
            (command_block(page.command))
        }
    }
}

fn answer(card: &SensorCard) -> Markup {
    let of = |verdict| card.channels.iter().filter(move |c| c.verdict == verdict);
    let others = [Verdict::EquivalentToZero, Verdict::Inconclusive, Verdict::NotMeasurable];
    html! {
        @for channel in of(Verdict::Delayed).chain(of(Verdict::Early)) {
            p.answer {
                b { code { (shown(&channel.name)) } ": " (estimate(&delay_ms(channel))) "\u{a0}ms" }
                " (k = 2, positive is late), from " (number::counted(channel.records, "record", "records"))
                @if !channel.outliers.is_empty() {
                    "; left out: " (number::counted(channel.outliers.len() as u64, "record", "records"))
                }
                "."
            }
        }
        @for verdict in others {
            @if of(verdict).next().is_some() {
                p.answer {
                    b { (verdict::word(verdict)) ": " }
                    @for (i, channel) in of(verdict).enumerate() { @if i > 0 { ", " } code { (shown(&channel.name)) } }
                    "."
                }
            }
        }
        @if card.channels.is_empty() { p.answer { "The card holds no channel." } }
        p.answer { (validity(card)) }
    }
}

fn delay_ms(channel: &CardChannel) -> Estimate {
    let standard_uncertainty = Some(channel.delay_standard_uncertainty_s * 1e3);
    Estimate { value: channel.delay_s * 1e3, standard_uncertainty }
}

fn validity(card: &SensorCard) -> Markup {
    html! {
        @match (&card.valid_from, &card.valid_until) {
            (Some(from), Some(until)) => { "Valid from " (shown(from)) " to " (shown(until)) "." }
            (None, Some(until)) => { "Valid until " (shown(until)) "." }
            (Some(from), None) => { "Valid from " (shown(from)) "; no last day is stated." }
            (None, None) => { "The card states no days of validity." }
        }
    }
}

fn channels(card: &SensorCard) -> Markup {
    let head = [
        Text("Channel"),
        Text("Verdict"),
        Number("Delay ± U (ms)"),
        Number("As seen, if held (ms)"),
        Number("Lags (ms)"),
        Text("Delay or lag"),
        Number("Gain ± U"),
        Number("Updates (Hz)"),
        Text("Measured against"),
        Number("Records"),
        Number("Spread between (ms)"),
    ];
    html! {
        div.compact { (table("Channels of the card", &head, rows(&card.channels, 60, head.len(), channel_row))) }
        p.note { "± is U with k = 2: within and between records. Spread between is one standard deviation." }
    }
}

fn channel_row(channel: &CardChannel) -> Markup {
    let gain = Estimate { value: channel.gain, standard_uncertainty: Some(channel.gain_standard_uncertainty) };
    html! {
        tr {
            th scope="row" { (shown(&channel.name)) }
            td { (verdict_badge(channel.verdict)) }
            td.n { (estimate(&delay_ms(channel))) }
            td.n { (or_why(channel.as_seen_delay_s, "not held", |s| plain(s * 1e3, 4))) }
            td.n {
                @if channel.lags_s.is_empty() { (no_number("no lag")) }
                @for (i, lag) in channel.lags_s.iter().enumerate() { @if i > 0 { ", " } (plain(lag * 1e3, 3)) }
            }
            td.any { (shown(&channel.model)) }
            td.n { (estimate(&gain)) }
            td.n { (or_why(channel.update_rate_hz, "not known", |hz| plain(hz, 4))) }
            td.any { (basis(&channel.basis)) ", " (channel.stamp_kind) }
            td.n { (number::count(channel.records)) }
            td.n { (or_why(channel.between_runs_s, "one record", |s| plain(s * 1e3, 2))) }
        }
    }
}

fn one_channel(channel: &CardChannel, rows: &[Forest], forest: Option<&Figure>) -> Markup {
    let silent: Vec<String> = rows.iter().filter(|r| r.delay_s.is_none()).map(|r| r.number.to_string()).collect();
    html! {
        @match forest {
            Some(forest) => { (figure(forest)) }
            None => { p { code { (shown(&channel.name)) } ": " (no_number("no record at hand holds a delay of it")) } }
        }
        @if !channel.outliers.is_empty() {
            p {
                (badge("unsure", "!", "Left out")) " as outliers of " code { (shown(&channel.name)) } ": "
                @for (i, name) in channel.outliers.iter().take(20).enumerate() { @if i > 0 { ", " } code { (shown(name)) } }
                @if channel.outliers.len() > 20 { " and " (channel.outliers.len() - 20) " more" } "."
            }
        }
        @if forest.is_some() && !silent.is_empty() {
            p.note { "Without a delay of this channel: record " (shown(&silent.join(", "))) "." }
        }
    }
}

fn records(page: &CardPage) -> Markup {
    let numbered: Vec<(usize, &CardRecord)> = (1..).zip(page.records).collect();
    let row = |(number, record): &(usize, &CardRecord)| {
        html! {
            tr {
                td.n { (number) }
                th scope="row" {
                    @match record.href {
                        Some(path) => { a href=(href(path)) { (shown(record.name)) } }
                        None => { (shown(record.name)) }
                    }
                }
                td { (or_why(record.record.date.as_ref(), "not known", |date| html! { (shown(date)) })) }
                td.any {
                    @match &record.record.outcome {
                        BenchOutcome::Measured => { (badge("ok", "✓", "Measured")) }
                        BenchOutcome::NotMeasurable { reason } => { (badge("unsure", "○", "Not measurable")) ": " (shown(reason)) }
                        BenchOutcome::Failed { reason } => { (badge("bad", "✗", "Failed")) ": " (shown(reason)) }
                    }
                }
            }
        }
    };
    let head = [Number("No."), Text("Record"), Text("Date (UTC)"), Text("Outcome")];
    html! {
        @if numbered.is_empty() { p { "No record is at hand." } }
        @else { (table("Records behind the card", &head, rows(&numbered, 200, head.len(), row))) }
    }
}

fn facts(card: &SensorCard) -> Markup {
    let body = html! {
        (fact("Sensor", shown(&sensor_name(&card.sensor))))
        (fact("Rig", shown(&card.rig)))
        (fact("Newest record", or_why(card.measured_on.as_ref(), "no day is known", |day| html! { (shown(day)) })))
        (fact("Versions", html! {
            "flightlag " (shown(&card.flightlag_version)) ", card " (card.card_version) ", analysis " (card.analysis_version)
            ", report " (crate::REPORT_VERSION)
        }))
    };
    table("Card", &[Text("Item"), Text("Value")], body)
}

fn inputs(number: usize, record: &CardRecord) -> Markup {
    let files: Vec<InputFile> = files(record.record).cloned().collect();
    provenance::inputs(&format!("Input files of record {number}"), &files)
}
