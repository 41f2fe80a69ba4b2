//! The page of a sensor card: each record's delay beside the combined one.

use super::Head::{Number, Text};
use super::bench::soft_iron;
use super::{
    Needs, badge, basis, command_block, contents, document, estimate, fact, figure, finding, no_number, or_why, plain,
    provenance, rows, sensor_name, table, verdict_badge,
};
use crate::figure::{Figure, Forest, LeftOut, anchors, card_figures};
use crate::number;
use crate::site::Site;
use crate::text::{href, shown, shown_block};
use crate::verdict;
use maud::{Markup, html};
use record::{
    BenchOutcome, BenchRecord, CardChannel, CardMagnetometer, ChannelDynamics, Estimate, InputFile, IronCalibration,
    SensorCard, TimeBasis, Verdict,
};

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
        site.add_figure(figure);
    }
    let title = format!("{} — flightlag sensor card", page.card.sensor.model);
    site.add("index.html", document(&title, Needs::Nothing, body(page, &forests, &figures)));
    site
}

/// What each record says of a channel.
fn forest(channel: &CardChannel, records: &[CardRecord]) -> Vec<Forest> {
    let row = |(number, record): (usize, &CardRecord)| {
        let channels = record.record.findings.iter().flat_map(|f| &f.channels);
        let found = channels.filter(|c| c.name == channel.name).find_map(|c| Some((c, c.delay.as_ref()?)));
        let is_outlier = channel.outliers.iter().any(|name| name == record.name)
            || files(record.record).any(|file| channel.outliers.contains(&file.name));
        let left_out = match found {
            _ if is_outlier => Some(LeftOut::Outlier),
            Some((measured, _)) if !is_comparable(measured, channel) => Some(LeftOut::NotComparable),
            _ => None,
        };
        Forest { number, delay_s: found.map(|(_, delay)| verdict::delay(delay)), left_out }
    };
    (1..).zip(records).map(row).collect()
}

/// Whether the card's mean could be made of it: the same kind of stamps against the same clock.
fn is_comparable(measured: &ChannelDynamics, card: &CardChannel) -> bool {
    let anchor = |basis: &TimeBasis| match basis {
        TimeBasis::OneClock | TimeBasis::Pps => None,
        TimeBasis::Anchor { channel } => Some(channel.clone()),
    };
    measured.verdict != Verdict::NotMeasurable
        && measured.quantity == card.quantity
        && measured.stamp_kind == card.stamp_kind
        && anchor(&measured.basis) == anchor(&card.basis)
}

fn files(record: &BenchRecord) -> impl Iterator<Item = &InputFile> {
    record.logs.iter().flat_map(|log| &log.inputs)
}

fn body(page: &CardPage, forests: &[Vec<Forest>], figures: &[Option<Figure>]) -> Markup {
    let card = page.card;
    html! {
        (contents(&[("channels", "Channels"), ("magnetometer", "Magnetometer"), ("records", "Records"), ("method", "Method"), ("provenance", "Provenance")]))
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
            h2 id="magnetometer" { "Magnetometer" }
            (or_why(card.magnetometer.as_ref(), "no record shows a magnetometer at a known azimuth", magnetometer))
            h2 id="records" { "Records" }
            (records(page))
            h2 id="method" { "Method" }
            p { (shown_block(&card.method)) }
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
            td {
                (verdict_badge(channel.verdict))
                @if !channel.contradicted.is_empty() { " " (badge("bad", "✗", "rig contradicted")) }
            }
            td.n { (estimate(&delay_ms(channel))) }
            td.n { (or_why(channel.as_seen_delay_s, "not held", |s| plain(s * 1e3, 4))) }
            td.n {
                @if channel.lags_s.is_empty() { (no_number("no lag")) }
                @for (i, lag) in channel.lags_s.iter().enumerate() { @if i > 0 { ", " } (plain(lag * 1e3, 3)) }
                @if let Some(slow) = channel.slow_motion_delay_s { "; slow motion " (plain(slow * 1e3, 4)) }
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
    let numbers = |wanted: &dyn Fn(&Forest) -> bool| {
        rows.iter().filter(|r| wanted(r)).map(|r| r.number.to_string()).collect::<Vec<_>>().join(", ")
    };
    let silent = numbers(&|r| r.delay_s.is_none());
    let not_comparable = numbers(&|r| r.left_out == Some(LeftOut::NotComparable));
    html! {
        @match forest {
            Some(forest) => { (figure(forest)) }
            None => { p { code { (shown(&channel.name)) } ": " (no_number("no record at hand holds a delay of it")) } }
        }
        @if !channel.contradicted.is_empty() {
            p {
                (badge("bad", "✗", "rig contradicted")) " The data contradict the rig file, so that this delay is measured \
                 against a motion that was not the bar's: "
                @for (i, what) in channel.contradicted.iter().take(20).enumerate() { @if i > 0 { ", " } (shown(what)) }
                @if channel.contradicted.len() > 20 { " and " (channel.contradicted.len() - 20) " more" }
                ". Put the rig file right and measure again."
            }
        }
        @if !channel.outliers.is_empty() {
            p {
                (badge("unsure", "!", "Left out")) " as outliers of " code { (shown(&channel.name)) } ": "
                @for (i, name) in channel.outliers.iter().take(20).enumerate() { @if i > 0 { ", " } code { (shown(name)) } }
                @if channel.outliers.len() > 20 { " and " (channel.outliers.len() - 20) " more" } "."
            }
        }
        @if !not_comparable.is_empty() {
            p.note {
                "Left out, for its delay is of another kind (stamps, clock, or no verdict): record "
                (shown(&not_comparable)) "."
            }
        }
        @if forest.is_some() && !silent.is_empty() {
            p.note { "Without a delay of this channel: record " (shown(&silent)) "." }
        }
    }
}

fn magnetometer(found: &CardMagnetometer) -> Markup {
    let azimuths: Vec<f64> = found.azimuths_rad.iter().map(|a| a.to_degrees()).collect();
    html! {
        p {
            "Hard and soft iron of " code { (shown(&found.channel)) } " from "
            (number::counted(azimuths.len() as u64, "swing", "swings")) " at azimuths of "
            @for (i, azimuth) in azimuths.iter().take(40).enumerate() { @if i > 0 { ", " } (number::fixed(*azimuth, 1)) "°" }
            "."
        }
        (finding(&found.iron, |iron| calibration(iron, &found.unit)))
    }
}

fn calibration(iron: &IronCalibration, unit: &str) -> Markup {
    // People think of fields in microtesla.
    let (factor, unit) = if unit == "T" { (1e6, "µT") } else { (1.0, "the sensor's own unit") };
    let hard = |axis: usize| {
        let (value, u) = (iron.hard_iron[axis], iron.hard_iron_standard_uncertainty[axis]);
        estimate(&number::scaled(&Estimate { value, standard_uncertainty: Some(u) }, factor))
    };
    let scale = iron.scale.map(|value| Estimate { value, standard_uncertainty: iron.scale_standard_uncertainty });
    let facts = html! {
        @for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
            (fact(&format!("Hard iron {name} ({unit})"), hard(axis)))
        }
        (fact("Soft iron, row by row", soft_iron(&iron.soft_iron, &iron.soft_iron_standard_uncertainty)))
        (fact("Size of the field over the model's", or_why(scale.as_ref(), "no model, or a scale of the sensor's own", estimate)))
        (fact(&format!("Rms of what is left ({unit})"), plain(iron.residual_rms * factor, 3)))
        (fact("Condition number of the fit", plain(iron.condition, 2)))
    };
    html! {
        (table("What the sensor reads: scale · soft iron · field + hard iron, body axes; ± is U with k = 2",
            &[Text("Item"), Text("Value")], facts))
        p.note { (shown_block(&iron.text)) }
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
