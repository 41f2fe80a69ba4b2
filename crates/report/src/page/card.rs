//! The page of a sensor card: how late each channel is, how that was found, and how to use it.

use super::Head::{self, Number, Text};
use super::bench::{for_people, soft_iron};
use super::{
    Needs, anchor_badge, badge, basis, command_block, contents, document, estimate, fact, figure, finding, in_doubt,
    maybe, no_number, or_why, plain, provenance, rows, sensor_name, table, verdict_or_doubt,
};
use crate::figure::{BenchFigures, Figure, Forest, ForestRow, LeftOut, card_forest, place_in_paper};
use crate::number;
use crate::site::Site;
use crate::text::{href, label, shown, shown_block};
use crate::verdict;
use maud::{Markup, Render, html};
use record::{
    BenchOutcome, BenchRecord, CardChannel, CardMagnetometer, ChannelDynamics, Estimate, InputFile, IronCalibration,
    SensorCard, TimeBasis, Verdict,
};
use std::collections::{BTreeMap, BTreeSet};

/// Maximum number of channels with their own column in the table of records; the record pages have all.
const MOST_COLUMNS: usize = 8;

/// What the page of a sensor card needs besides the card.
#[derive(Debug, Clone, Copy)]
pub struct CardPage<'a> {
    /// The card.
    pub card: &'a SensorCard,
    /// Name of the card's file in the folder of the page, if it is there.
    pub card_file: Option<&'a str>,
    /// The records it was made from, in the order of [`SensorCard::records`].
    pub records: &'a [CardRecord<'a>],
    /// Channels in the records without a common delay on the card.
    pub without_mean: &'a [WithoutMean<'a>],
    /// Other remarks about the records, such as a channel that no record could measure.
    pub remarks: &'a [String],
    /// Command that regenerates this page.
    pub command: &'a str,
}

/// A channel for which the records disagree on the delay.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WithoutMean<'a> {
    /// Channel name.
    pub channel: &'a str,
    /// How the records disagree, in one sentence.
    pub why: &'a str,
}

/// One record that a card was made from.
#[derive(Debug, Clone, Copy)]
pub struct CardRecord<'a> {
    /// The name that users know.
    pub name: &'a str,
    /// Results of the analysis.
    pub record: &'a BenchRecord,
    /// Path of its page relative to this page, if there is one; not yet percent-encoded.
    pub href: Option<&'a str>,
}

/// One channel of the card with its result from each record.
struct Channel<'a> {
    card: &'a CardChannel,
    /// A smaller delay is equivalent to zero, s.
    margin_s: f64,
    records: Vec<Forest>,
}

/// The page of a sensor card: `index.html`, and its figures also as files in `figures/`: `forest` of all channels, and
/// `fig-4` of the record with the most certain position delay.
#[must_use]
pub fn card_site(page: &CardPage) -> Site {
    let channels = channels(page);
    let rows: Vec<ForestRow> = channels.iter().map(|c| (c.card, c.margin_s, c.records.as_slice())).collect();
    let forest = card_forest(&rows).map(|figure| Figure { number: 1, ..figure });
    let best = best_record(&channels, page.records);
    let paper = best.and_then(|(number, channel)| {
        of_record(number, channel, &page.records[number - 1], u32::from(forest.is_some()) + 1)
    });
    let mut site = Site::default();
    for figure in [&forest, &paper].into_iter().flatten() {
        site.add_figure(figure);
    }
    let title = format!("{} — flightlag sensor card", page.card.sensor.model);
    let body = body(page, &channels, [forest.as_ref(), paper.as_ref()]);
    site.add("index.html", document(&title, Needs::Nothing, body));
    site
}

/// Channels in reading order: position first, then the others by lateness in multiples of their margin.
fn channels<'a>(page: &CardPage<'a>) -> Vec<Channel<'a>> {
    let channel = |card: &'a CardChannel| {
        let records = forest(card, page.records);
        Channel { card, margin_s: margin(card, &records), records }
    };
    let mut channels: Vec<Channel> = page.card.channels.iter().map(channel).collect();
    let margins_late = |c: &Channel| (c.card.delay_s / c.margin_s).abs();
    channels.sort_by(|a, b| {
        is_position(b.card).cmp(&is_position(a.card)).then(margins_late(b).total_cmp(&margins_late(a)))
    });
    channels
}

pub(super) fn is_position(channel: &CardChannel) -> bool {
    place_in_paper(channel.quantity) == Some(0)
}

/// The margin from the records; fallback: half the update interval, at least 5 ms, as in the records.
fn margin(channel: &CardChannel, records: &[Forest]) -> f64 {
    let of_records = records.iter().filter_map(|r| r.margin_s).filter(|m| *m > 0.0).reduce(f64::max);
    of_records.unwrap_or_else(|| channel.update_rate_hz.filter(|hz| *hz > 0.0).map_or(0.0, |hz| 0.5 / hz).max(0.005))
}

/// The delay of a channel from each record.
fn forest(channel: &CardChannel, records: &[CardRecord]) -> Vec<Forest> {
    let row = |(number, record): (usize, &CardRecord)| {
        let found = measured_in(record.record, channel).and_then(|c| Some((c, c.delay.as_ref()?)));
        let is_outlier = channel.outliers.iter().any(|name| name == record.name)
            || files_of(record.record).any(|file| channel.outliers.contains(&file.name));
        let left_out = match found {
            _ if is_outlier => Some(LeftOut::Outlier),
            Some((measured, _)) if unlike(measured, channel).is_some() => Some(LeftOut::NotComparable),
            _ => None,
        };
        Forest {
            number,
            delay_s: found.map(|(_, delay)| verdict::delay(delay)),
            margin_s: found.map(|(_, delay)| delay.deciding_margin_s()),
            left_out,
        }
    };
    (1..).zip(records).map(row).collect()
}

/// Why a result cannot be part of the card's mean; `None` if its kind of timestamp and its reference clock match.
fn unlike(measured: &ChannelDynamics, card: &CardChannel) -> Option<String> {
    let anchor = |basis: &TimeBasis| match basis {
        TimeBasis::OneClock | TimeBasis::Pps => None,
        TimeBasis::FastestArrivals => Some("the fastest arrivals".to_owned()),
        TimeBasis::Anchor { channel } => Some(channel.clone()),
    };
    let clock =
        |basis: &TimeBasis| anchor(basis).map_or("absolute".to_owned(), |channel| format!("relative to {channel}"));
    if measured.verdict == Verdict::NotMeasurable {
        return Some("its delay was not measurable".to_owned());
    }
    if measured.quantity != card.quantity {
        return Some("it is a different quantity".to_owned());
    }
    if measured.stamp_kind != card.stamp_kind {
        return Some(format!("its timestamps are {}, those of the card {}", measured.stamp_kind, card.stamp_kind));
    }
    let (of_record, of_card) = (anchor(&measured.basis), anchor(&card.basis));
    (of_record != of_card)
        .then(|| format!("its delay is {}, that of the card {}", clock(&measured.basis), clock(&card.basis)))
}

/// The result of a record for a channel of the card.
fn measured_in<'a>(record: &'a BenchRecord, card: &CardChannel) -> Option<&'a ChannelDynamics> {
    let channels = record.findings.iter().flat_map(|f| &f.channels);
    channels.filter(|c| c.name == card.name).find(|c| c.delay.is_some())
}

fn files_of(record: &BenchRecord) -> impl Iterator<Item = &InputFile> {
    record.logs.iter().flat_map(|log| &log.inputs)
}

/// Number of the record with the smallest uncertainty for the first channel, and that channel's name.
fn best_record<'a>(channels: &[Channel<'a>], records: &[CardRecord]) -> Option<(usize, &'a str)> {
    let known = |r: &&Forest| r.left_out.is_none() && r.delay_s.is_some();
    let uncertainty = |r: &Forest| r.delay_s.and_then(|d| d.standard_uncertainty).unwrap_or(f64::INFINITY);
    let of_first = channels.iter().take(1).flat_map(|c| &c.records).filter(known);
    let best = of_first.min_by(|a, b| uncertainty(a).total_cmp(&uncertainty(b)))?;
    (best.number <= records.len()).then_some((best.number, channels[0].card.name.as_str()))
}

/// Fig. 4 of the paper, drawn for one record.
fn of_record(number: usize, channel: &str, record: &CardRecord, figure_number: u32) -> Option<Figure> {
    let (name, record) = (record.name, for_people(record.record));
    let figure = BenchFigures::zoom_of(record.findings.as_ref()?)?;
    let caption =
        format!("Record {number} alone, with the smallest uncertainty for {}. {}", label(channel), figure.caption);
    let title = format!("{}: {}", label(name), figure.title);
    Some(Figure { number: figure_number, title, caption, ..figure })
}

fn body(page: &CardPage, channels: &[Channel], [forest, paper]: [Option<&Figure>; 2]) -> Markup {
    let card = page.card;
    html! {
        (contents(&[("channels", "Channels"), ("use", "Use it"), ("records", "Records"), ("magnetometer", "Magnetometer"), ("method", "Method"), ("provenance", "Provenance")]))
        main {
            h1 { "Sensor card: " (shown(&sensor_name(&card.sensor))) }
            (answer(page, channels))
            h2 id="channels" { "Channels" }
            @match forest {
                Some(forest) => { (figure(forest)) }
                None => { p { (no_number("no available record has a delay")) } }
            }
            (channel_table(channels))
            (snippet(page, channels))
            h2 id="records" { "Records" }
            (records(page, channels))
            @if let Some(paper) = paper { (figure(paper)) }
            h2 id="magnetometer" { "Magnetometer" }
            (or_why(card.magnetometer.as_ref(), "no record shows a magnetometer at a known azimuth", magnetometer))
            h2 id="method" { "Method" }
            p { (shown_block(&card.method)) }
            h2 id="provenance" { "Provenance" }
            @if let Some(file) = page.card_file {
                p.note { "The card as a file: " a href=(href(file)) download="" { (shown(file)) } "." }
            }
            (facts(card))
            (inputs(page.records))
            h3 { "Make it again" }
            (command_block(page.command))
        }
    }
}

/// The answer: how late each channel is and against what, worst first; then the validity of the card.
fn answer(page: &CardPage, channels: &[Channel]) -> Markup {
    let is_displaced = |c: &&Channel| matches!(c.card.verdict, Verdict::Delayed | Verdict::Early);
    let others = [Verdict::EquivalentToZero, Verdict::Inconclusive, Verdict::NotMeasurable];
    html! {
        @for what in page.without_mean {
            p.answer { (badge("bad", "✗", "no common delay")) " " code { (shown(what.channel)) } ": " (shown(what.why)) "." }
        }
        (doubts(channels))
        @for channel in channels.iter().filter(is_displaced) { (displaced(channel.card)) }
        @for verdict in others {
            @let of: Vec<&Channel> = channels.iter().filter(|c| c.card.verdict == verdict).collect();
            @if !of.is_empty() {
                p.answer {
                    b { (verdict::word(verdict)) ": " }
                    @for (i, channel) in of.into_iter().enumerate() {
                        @if i > 0 { "; " }
                        code { (shown(&channel.card.name)) } " " (estimate(&delay_ms(channel.card))) "\u{a0}ms"
                        @if verdict == Verdict::EquivalentToZero { ", margin ±" (number::significant(channel.margin_s * 1e3, 3)) "\u{a0}ms" }
                        @if channel.card.is_in_doubt() { ", " (in_doubt()) }
                    }
                    ". " (against(channels.iter().filter(|c| c.card.verdict == verdict)))
                }
            }
        }
        @for anchor in anchors(channels) {
            p.answer { (anchor_badge()) " " code { (shown(anchor)) } ": delay " (verdict::ZERO_BY_DEFINITION) "." }
        }
        @if channels.is_empty() { p.answer { "The card has no channel." } }
        @for remark in page.remarks { p.answer { (badge("unsure", "!", "Records")) " " (shown(remark)) "." } }
        p.answer { "Validity: " (validity(page.card)) }
    }
}

fn displaced(channel: &CardChannel) -> Markup {
    let (word, sign) = if channel.verdict == Verdict::Early { ("early", -1.0) } else { ("late", 1.0) };
    let slow = channel.slow_motion_delay_s.filter(|_| channel.has_lag() && channel.verdict == Verdict::Delayed);
    html! {
        p.answer {
            @if channel.is_in_doubt() { (in_doubt()) " " }
            b {
                code { (shown(&channel.name)) } " is " (word) " by "
                @match slow {
                    Some(slow) => { (in_ms(slow, channel.slow_motion_standard_uncertainty_s)) "\u{a0}ms in slow motion, " }
                    None => { (estimate(&number::scaled(&delay_ms(channel), sign))) "\u{a0}ms, " }
                }
                (time_base(&channel.basis))
            }
            " (k = 2)"
            @if slow.is_some() {
                ". It is a lag (" (shown(&channel.model)) "): the pure delay that fits the bench's swing best is "
                (estimate(&delay_ms(channel))) "\u{a0}ms"
            }
            ", from " (number::counted(channel.records, "record", "records"))
            @if !channel.outliers.is_empty() {
                ", " (number::counted(channel.outliers.len() as u64, "record", "records")) " left out"
            }
            "."
        }
    }
}

/// The reasons why the delay is in doubt.
fn reasons(channel: &CardChannel) -> Markup {
    const MOST: usize = 20;
    html! {
        @for (i, what) in channel.contradicted.iter().take(MOST).enumerate() { @if i > 0 { "; " } (shown(what)) }
        @if channel.contradicted.len() > MOST { " and " (channel.contradicted.len() - MOST) " more" }
    }
}

/// What a delay is measured against, as part of a sentence.
pub(super) fn time_base(basis: &TimeBasis) -> Markup {
    html! {
        @match basis {
            TimeBasis::OneClock => { "absolute (one clock)" }
            TimeBasis::Pps => { "absolute (pulse per second)" }
            TimeBasis::FastestArrivals => { "including the least transport latency (fastest arrivals)" }
            TimeBasis::Anchor { channel } => { "relative to " code { (shown(channel)) } }
        }
    }
}

/// The channels that delays of the card are relative to and that are not on it.
fn anchors<'a>(channels: &[Channel<'a>]) -> BTreeSet<&'a str> {
    let anchor = |c: &Channel<'a>| match &c.card.basis {
        TimeBasis::Anchor { channel } => Some(channel.as_str()),
        _ => None,
    };
    let is_on_card = |name: &str| channels.iter().any(|c| c.card.name == name);
    channels.iter().filter_map(anchor).filter(|name| !is_on_card(name)).collect()
}

/// The time base of several channels, if they all have the same.
fn against<'a>(mut channels: impl Iterator<Item = &'a Channel<'a>>) -> Markup {
    let Some(first) = channels.next() else { return html! {} };
    let same = channels.all(|c| c.card.basis == first.card.basis);
    html! { @if same { "All " (time_base(&first.card.basis)) "." } @else { "Absolute or relative: see the table." } }
}

pub(super) fn delay_ms(channel: &CardChannel) -> Estimate {
    let standard_uncertainty = Some(channel.delay_standard_uncertainty_s * 1e3);
    Estimate { value: channel.delay_s * 1e3, standard_uncertainty }
}

pub(super) fn validity(card: &SensorCard) -> Markup {
    html! {
        @match (&card.valid_from, &card.valid_until) {
            (Some(from), Some(until)) => { (shown(from)) " to " (shown(until)) "." }
            (None, Some(until)) => { "until " (shown(until)) "." }
            (Some(from), None) => { "from " (shown(from)) ", last day not stated." }
            (None, None) => { "not stated." }
        }
        @if let Some(day) = &card.measured_on { " Newest record: " (shown(day)) "." }
    }
}

/// Columns of the channel table. A value that is the same or unknown for all channels is stated once below the table.
struct Columns {
    held: bool,
    spread: bool,
    clock: bool,
}

impl Columns {
    fn of(channels: &[Channel]) -> Columns {
        let is_other =
            |c: &Channel| (&c.card.basis, c.card.stamp_kind) != (&channels[0].card.basis, channels[0].card.stamp_kind);
        Columns {
            held: channels.iter().any(|c| c.card.as_seen_delay_s.is_some()),
            spread: channels.iter().any(|c| c.card.between_runs_s.is_some()),
            clock: channels.iter().any(is_other),
        }
    }

    fn head(&self) -> Vec<Head> {
        let all = [
            (true, Text("Channel")),
            (true, Text("Verdict")),
            (true, Number("Delay (ms)")),
            (true, Number("Margin (ms)")),
            (self.held, Number("If held (ms)")),
            (true, Text("Delay or lag")),
            (true, Number("Gain")),
            (true, Number("Updates (Hz)")),
            (self.clock, Text("Measured against")),
            (true, Number("Records")),
            (self.spread, Number("Spread between (ms)")),
        ];
        all.into_iter().filter_map(|(is_shown, head)| is_shown.then_some(head)).collect()
    }

    fn note(&self, channels: &[Channel]) -> Markup {
        html! {
            p.note {
                @if self.held { "If held: effective delay when the last value is held; —: not held. " }
                @else { "No channel was held. " }
                @if self.spread { "Spread between records: one standard deviation; —: one record. " }
                @else { "No channel has two records, so their spread is unknown. " }
                "Gain: mean of the components that the swing moves. "
                @if let Some(first) = channels.first().filter(|_| !self.clock) {
                    "All delays: " (time_base(&first.card.basis)) ", by " (first.card.stamp_kind) " timestamps."
                }
            }
        }
    }
}

/// What the numbers of a model are.
fn number_of(model: &str) -> &'static str {
    match model {
        model if model.contains("filter") => "; filter ",
        model if model.contains("average") => "; average ",
        _ => "; lag ",
    }
}

fn channel_table(channels: &[Channel]) -> Markup {
    let columns = Columns::of(channels);
    let head = columns.head();
    html! {
        div.compact {
            (table("Channels of the card; ± is U with k = 2, within and between records", &head,
                rows(channels, 60, head.len(), |channel| channel_row(channel, &columns))))
        }
        (columns.note(channels))
    }
}

fn channel_row(channel: &Channel, columns: &Columns) -> Markup {
    let Channel { card: channel, margin_s, .. } = channel;
    let gain = Estimate { value: channel.gain, standard_uncertainty: Some(channel.gain_standard_uncertainty) };
    html! {
        tr {
            th scope="row" { (shown(&channel.name)) }
            td { (verdict_or_doubt(channel.verdict, channel.is_in_doubt())) }
            td.n { (estimate(&delay_ms(channel))) }
            td.n { "±" (number::significant(margin_s * 1e3, 3)) }
            // The age of held values follows from the timestamps. It adds no uncertainty to the delay.
            @if columns.held { td.n { (maybe(channel.as_seen_delay_s, |s| in_ms(s, Some(channel.delay_standard_uncertainty_s)))) } }
            td.any {
                (shown(&channel.model))
                @for (i, lag) in channel.lags_as_named().into_iter().enumerate() {
                    (if i > 0 { ", " } else { number_of(&channel.model) })
                    (in_ms(lag.value, lag.standard_uncertainty))
                }
                @if !channel.lags_s.is_empty() { " ms" }
                @if let Some(slow) = channel.slow_motion_delay_s {
                    "; slow motion " (in_ms(slow, channel.slow_motion_standard_uncertainty_s)) " ms"
                }
            }
            td.n {
                @if channel.has_lag() { (no_number("a lag's gain depends on the frequency")) }
                @else { (estimate(&gain)) }
            }
            td.n { (or_why(channel.update_rate_hz, "unknown", |hz| plain(hz, 4))) }
            @if columns.clock { td.any { (basis(&channel.basis)) ", " (channel.stamp_kind) } }
            td.n { (number::count(channel.records)) }
            @if columns.spread { td.n { (maybe(channel.between_runs_s, |s| plain(s * 1e3, 2))) } }
        }
    }
}

/// Seconds as milliseconds, with U if known.
fn in_ms(value_s: f64, standard_uncertainty_s: Option<f64>) -> Markup {
    estimate(&verdict::in_millis(&Estimate { value: value_s, standard_uncertainty: standard_uncertainty_s }))
}

/// Why delays are in doubt. Channels with the same reasons are listed together.
fn doubts(channels: &[Channel]) -> Markup {
    let mut groups: Vec<Vec<&CardChannel>> = vec![];
    for channel in channels.iter().map(|c| c.card).filter(|c| c.is_in_doubt()) {
        match groups.iter_mut().find(|group| group[0].contradicted == channel.contradicted) {
            Some(group) => group.push(channel),
            None => groups.push(vec![channel]),
        }
    }
    html! {
        @for group in groups {
            p.answer {
                (in_doubt()) " "
                @if group.len() == channels.len() && group.len() > 1 { "All channels" }
                @else { @for (i, channel) in group.iter().enumerate() { @if i > 0 { ", " } code { (shown(&channel.name)) } } }
                ": " (reasons(group[0])) ". Correct the named cause and measure again. Until then do not rely on the delay."
            }
        }
    }
}

/// What to write into a pipeline file.
fn snippet(page: &CardPage, channels: &[Channel]) -> Markup {
    let position = channels.iter().map(|c| c.card).find(|c| is_position(c));
    html! {
        h2 id="use" { "Use it in a pipeline" }
        @if position.is_some_and(CardChannel::is_in_doubt) {
            p { (in_doubt()) " Measure again before you use this delay." }
        }
        @if let Some((position, slow)) = position.filter(|p| p.has_lag()).and_then(|p| Some((p, p.slow_motion_delay_s?))) {
            p {
                (badge("unsure", "!", "A lag")) " A pipeline removes the lateness of slow motion, "
                (in_ms(slow, position.slow_motion_standard_uncertainty_s)) " ms. "
                code { (shown(&position.name)) } " is a lag: motion as fast as the bench's swing is "
                (estimate(&delay_ms(position))) " ms late, and smaller than it was."
            }
        }
        @match (position, page.card_file) {
            (Some(_), Some(file)) => {
                pre tabindex="0" { code { (shown_block(&format!("[delay]\nfrom = \"card\"\ncard = {}\n", toml_text(file)))) } }
                p.note { "The path is relative to the pipeline file. Flights need the position channel of this card." }
            }
            (Some(position), None) => {
                pre tabindex="0" { code { (shown_block(&fixed_delay(position, page.card))) } }
            }
            (None, _) if page.without_mean.is_empty() => {
                p { (no_number("the card has no position, so there is no delay to remove")) }
            }
            (None, _) => { p { (no_number("the card has no position on which the records agree, so there is no delay \
                                           to remove")) } }
        }
        @if let Some(TimeBasis::Anchor { channel }) = position.map(|p| &p.basis) {
            p { "This delay is relative: it is right where " code { (shown(channel)) } " of the flight is on time." }
        }
    }
}

/// The delay as a stand-alone number.
fn fixed_delay(position: &CardChannel, card: &SensorCard) -> String {
    let late_s = position.lateness_in_flight_s();
    format!(
        "[delay]\nfrom = \"fixed\"\nposition_s = {:.6}\nstandard_uncertainty_s = {:.6}\nsource = {}\n",
        late_s.value,
        late_s.standard_uncertainty.unwrap_or_default(),
        toml_text(&format!("bench, {}", sensor_name(&card.sensor)))
    )
}

/// A TOML basic string.
fn toml_text(text: &str) -> String {
    let plain: String = text.chars().filter(|c| !c.is_control()).collect();
    format!("\"{}\"", plain.replace('\\', "\\\\").replace('"', "\\\""))
}

fn magnetometer(found: &CardMagnetometer) -> Markup {
    let degrees = |azimuth: &f64| ((10.0 * azimuth.to_degrees()).round() / 10.0).rem_euclid(360.0);
    let azimuths: Vec<f64> = found.azimuths_rad.iter().map(degrees).collect();
    html! {
        p {
            "Hard and soft iron of " code { (shown(&found.channel)) } " from "
            (number::counted(azimuths.len() as u64, "swing", "swings")) " at "
            @if azimuths.len() == 1 { "an azimuth of " } @else { "azimuths of " }
            @for (i, azimuth) in azimuths.iter().take(40).enumerate() { @if i > 0 { ", " } (number::fixed(*azimuth, 1)) "°" }
            "."
        }
        (finding(&found.iron, |iron| calibration(iron, &found.unit)))
    }
}

fn calibration(iron: &IronCalibration, unit: &str) -> Markup {
    // Engineers expect magnetic fields in microtesla.
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
        (fact(&format!("Rms of residuals ({unit})"), plain(iron.residual_rms * factor, 3)))
        (fact("Condition number of the fit", plain(iron.condition, 2)))
    };
    html! {
        (table("What the sensor reads: scale · soft iron · field + hard iron, body axes; ± is U with k = 2",
            &[Text("Item"), Text("Value")], facts))
        p.note { (shown_block(&iron.text)) }
    }
}

/// Records with their result for each channel, then the excluded results and the reasons.
fn records(page: &CardPage, channels: &[Channel]) -> Markup {
    let numbered: Vec<(usize, &CardRecord)> = (1..).zip(page.records).collect();
    let columns = columns(page, channels);
    let all = channels.len() + page.without_mean.len();
    let row = |(number, record): &(usize, &CardRecord)| record_row(*number, record, &columns);
    let head = html! {
        tr {
            @for column in [Number("No."), Text("Record, date (UTC)"), Text("Outcome")] { (Head::render(&column)) }
            @for column in &columns { th.n scope="col" { (shown(column.name)) " (ms)" @if column.records.is_none() { ", no common delay" } } }
        }
    };
    html! {
        @if numbered.is_empty() { p { "No record is available." } }
        @else {
            div.compact {
                (super::table_of("Repeatability: delay in each record; ± is U with k = 2; ✗ is left out", head,
                    rows(&numbered, 200, 3 + columns.len(), row)))
            }
            @if all > columns.len() {
                p.note { (number::counted((all - columns.len()) as u64, "channel", "channels")) " more: see the pages of the records." }
            }
            (left_out(page, channels))
        }
    }
}

/// A column of the table of records.
struct Column<'a> {
    name: &'a str,
    /// Result of each record; `None` if the records disagree on the delay of the channel.
    records: Option<&'a [Forest]>,
}

/// Channels without a common delay first, then the channels of the card.
fn columns<'a>(page: &CardPage<'a>, channels: &'a [Channel<'a>]) -> Vec<Column<'a>> {
    let apart = page.without_mean.iter().map(|what| Column { name: what.channel, records: None });
    let of_card = channels.iter().map(|c| Column { name: &c.card.name, records: Some(&c.records) });
    apart.chain(of_card).take(MOST_COLUMNS).collect()
}

fn record_row(number: usize, record: &CardRecord, columns: &[Column]) -> Markup {
    let own = |name: &str| {
        let all = record.record.findings.iter().flat_map(|f| &f.channels);
        all.filter(|c| c.name == name).find_map(|c| c.delay.as_ref()).map(verdict::delay)
    };
    html! {
        tr {
            td.n { (number) }
            th scope="row" {
                @match record.href {
                    Some(path) => { a href=(href(path)) { (shown(record.name)) } }
                    None => { (shown(record.name)) }
                }
                ", " (or_why(record.record.date.as_ref(), "date unknown", |date| html! { (shown(date)) }))
            }
            td.any {
                @match &record.record.outcome {
                    BenchOutcome::Measured if !record.record.doubts().is_empty() => {
                        (badge("unsure", "!", "Measured")) " " (in_doubt())
                    }
                    BenchOutcome::Measured => { (badge("ok", "✓", "Measured")) }
                    BenchOutcome::NotMeasurable { reason } => { (badge("unsure", "○", "Not measurable")) ": " (shown(reason)) }
                    BenchOutcome::Failed { reason } => { (badge("bad", "✗", "Failed")) ": " (shown(reason)) }
                }
            }
            @for column in columns {
                td.n {
                    @let found = column.records.map(|records| records.get(number - 1));
                    @let delay = found.map_or_else(|| own(column.name), |of_card| of_card.and_then(|f| f.delay_s));
                    (or_why(delay.as_ref(), "none", |delay| estimate(&verdict::in_millis(delay))))
                    @if found.flatten().is_some_and(|f| f.left_out.is_some()) { " ✗" }
                }
            }
        }
    }
}

/// Records excluded from a channel's delay: each reason once, with the channels that it applies to.
fn left_out(page: &CardPage, channels: &[Channel]) -> Markup {
    let mut all: BTreeMap<(usize, String), Vec<&str>> = BTreeMap::new();
    for channel in channels {
        for (record, why) in channel.records.iter().filter_map(|r| Some((r, r.left_out?))) {
            let reason = why_left_out(page, channel.card, record, why);
            all.entry((record.number, reason)).or_default().push(&channel.card.name);
        }
    }
    let all: Vec<_> = all.into_iter().collect();
    let row = |((number, reason), names): &((usize, String), Vec<&str>)| {
        let name = page.records.get(number - 1).map_or("", |r| r.name);
        html! {
            tr {
                th scope="row" { (number) ": " (shown(name)) }
                td.any {
                    @if names.len() == channels.len() && names.len() > 1 { "all " (names.len()) " channels" }
                    @else { @for (i, name) in names.iter().enumerate() { @if i > 0 { ", " } (shown(name)) } }
                }
                td.any { (shown(reason)) }
            }
        }
    };
    let head = [Text("Record"), Text("Channels"), Text("Reason")];
    html! {
        @if all.is_empty() { p.note { "No record was left out." } }
        @else { (table("Left out of the mean", &head, rows(&all, 100, head.len(), row))) }
    }
}

fn why_left_out(page: &CardPage, card: &CardChannel, record: &Forest, why: LeftOut) -> String {
    let measured = page.records.get(record.number - 1).and_then(|r| measured_in(r.record, card));
    match (why, &record.delay_s) {
        (LeftOut::Outlier, Some(delay)) => format!(
            "outlier: its delay is {} ms from the mean of the others",
            number::significant((delay.value - card.delay_s) * 1e3, 3)
        ),
        (LeftOut::Outlier, None) => "outlier: its delay does not belong to those of the others".to_owned(),
        (LeftOut::NotComparable, _) => measured.and_then(|m| unlike(m, card)).unwrap_or_default(),
    }
}

fn facts(card: &SensorCard) -> Markup {
    let body = html! {
        (fact("Sensor", shown(&sensor_name(&card.sensor))))
        (fact("Rig", shown(&card.rig)))
        (fact("Newest record", or_why(card.measured_on.as_ref(), "unknown", |day| html! { (shown(day)) })))
        (fact("Versions", html! {
            "flightlag " (shown(&card.flightlag_version)) ", card " (card.card_version) ", analysis " (card.analysis_version)
            ", report " (crate::REPORT_VERSION)
        }))
    };
    table("Card", &[Text("Item"), Text("Value")], body)
}

/// Input files of all records, collapsed because each record has its own page.
fn inputs(records: &[CardRecord]) -> Markup {
    html! {
        @if !records.is_empty() {
            details {
                summary { "Input files with their hashes" }
                @for (number, record) in (1..).zip(records).take(40) {
                    @let files: Vec<InputFile> = files_of(record.record).cloned().collect();
                    (provenance::inputs(&format!("Input files of record {number}"), &files))
                }
                @if records.len() > 40 { p.note { "The rest is on the pages of the records." } }
            }
        }
    }
}
