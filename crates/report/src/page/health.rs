//! Data quality: channels, topics, bytes, damage, notices, and the channel map that was used.

use super::Head::{Number, Text};
use super::{data_lost, maybe, minor_loss, more, rows, table, tail_cut};
use crate::number;
use crate::text::shown;
use flight::{
    About, Binding, ByteLedger, ChannelHealth, Code, DamagedRange, LogHealth, MapCandidate, Notice, Notices,
    RejectCount, Severity, StampHealth, StampOffset, TopicHealth,
};
use maud::{Markup, html};
use record::FlightRecord;

/// Maximum number of rows in each list on the page; the record has all.
const MOST_CHANNELS: usize = 60;
const MOST_TOPICS: usize = 300;
const MOST_NOTICES: usize = 200;
const MOST_INNER: usize = 12;
/// Timestamps of a topic: measured, published, logged.
const MOST_STAMPS: usize = 3;

/// Definition of a gap, shown next to every number of gaps.
const GAP: &str = "A gap is a step from one timestamp to the next of more than 2.5 median steps.";

/// Channels, topics, bytes and damage of a flight.
pub(super) fn section(record: &FlightRecord, timeline: &Markup) -> Markup {
    html! {
        h2 id="health" { "Data health" }
        (timeline)
        @match &record.log {
            Some(log) => { (log_health(log, record.binding.as_ref())) }
            None => { p { "The log could not be opened, so its data are unknown." } }
        }
    }
}

/// Channels, topics, bytes and damage of one log.
pub(super) fn log_health(log: &LogHealth, binding: Option<&Binding>) -> Markup {
    html! {
        p {
            "Format: " (shown(&log.format)) ". "
            (number::counted(log.messages, "intact message", "intact messages")) ", "
            (number::count(log.undecodable)) " that could not be decoded."
        }
        (vehicle(&log.about))
        @if let Some(binding) = binding { (channels(&binding.channels)) }
        (ledger(&log.bytes))
        (damage(log))
        (topics(log))
        (extras(&log.extras))
    }
}

/// Vehicle, software and settings according to the log.
fn vehicle(about: &About) -> Markup {
    let receivers = (!about.receivers.is_empty()).then(|| about.receivers.join("; "));
    let changes = about.parameter_changes.len() as u64;
    let parameters = (about.parameters > 0 || changes > 0).then(|| {
        let all = number::counted(about.parameters, "parameter", "parameters");
        format!("{all}, {} during the log", number::counted(changes, "change", "changes"))
    });
    let facts = [
        ("System", about.system.clone()),
        ("Firmware", about.firmware.clone()),
        ("Hardware", about.hardware.clone()),
        ("Vehicle", about.vehicle.clone()),
        ("Receivers", receivers),
        ("Parameters", parameters),
    ];
    let fact = |(name, value): (&str, Option<String>)| {
        let value = value?;
        Some(html! { tr { th scope="row" { (name) } td.any { (shown(&value)) } } })
    };
    html! {
        @if !about.is_empty() {
            h3 { "Vehicle" }
            (table("The vehicle, from the log", &[Text("What"), Text("Value")], html! {
                @for row in facts.into_iter().filter_map(fact) { (row) }
            }))
            (configured_delays(about))
            (modes(about))
            (lines("Parameters that changed", &about.parameter_changes))
            (lines("Texts of the autopilot", &about.texts))
        }
    }
}

fn configured_delays(about: &About) -> Markup {
    let row = |delay: &flight::ConfiguredDelay| {
        html! {
            tr {
                th scope="row" { code { (shown(&delay.parameter)) } }
                td.n { (millis(delay.value_s)) }
                td.any { (shown(&delay.meaning)) }
            }
        }
    };
    let head = [Text("Parameter"), Number("Delay (ms)"), Text("Of what")];
    html! {
        @if !about.configured_delays.is_empty() {
            (table("Delays as configured, at the start of the log", &head,
                rows(&about.configured_delays, MOST_CHANNELS, head.len(), row)))
        }
    }
}

fn modes(about: &About) -> Markup {
    let first_ns = about.modes.first().map_or(0, |mode| mode.at_ns);
    let row = |mode: &flight::ModeStart| {
        let at_s = flight::Stamp(mode.at_ns).seconds_since(flight::Stamp(first_ns));
        html! { tr { th scope="row" { (shown(&mode.mode)) } td.n { (number::clock(at_s, 0)) } } }
    };
    let head = [Text("Mode"), Number("Since the first")];
    html! {
        @if !about.modes.is_empty() {
            details {
                summary { "Flight modes (" (number::count(about.modes.len() as u64)) ")" }
                (table("Flight modes", &head, rows(&about.modes, MOST_TOPICS, head.len(), row)))
            }
        }
    }
}

/// A collapsed list of texts from the log.
fn lines(title: &str, lines: &[String]) -> Markup {
    html! {
        @if !lines.is_empty() {
            details {
                summary { (title) " (" (number::count(lines.len() as u64)) ")" }
                ul.plain {
                    @for line in lines.iter().take(MOST_TOPICS) { li { (shown(line)) } }
                    @if lines.len() > MOST_TOPICS { li { (more(lines.len() - MOST_TOPICS)) } }
                }
            }
        }
    }
}

fn channels(channels: &[ChannelHealth]) -> Markup {
    let timing = [
        Text("Channel"),
        Text("Stamps used"),
        Number("Rate (Hz)"),
        Number("Jitter, p99 − median (ms)"),
        Text("Gaps"),
        Number("Duplicates"),
        Number("Back-jumps"),
        Text("Stamp offsets (ms)"),
    ];
    let use_of_rows =
        [Text("Channel"), Text("Topic and fields"), Number("Rows"), Number("Used"), Text("Held"), Text("Rejected")];
    html! {
        (table("Channels: time stamps", &timing, rows(channels, MOST_CHANNELS, timing.len(), channel_timing)))
        p.note { (GAP) " Where timestamps go backwards, rate, jitter and gaps are those of the sorted rows. Stamp \
                        offsets are medians, with 1st and 99th percentile." }
        (table("Channels: rows", &use_of_rows, rows(channels, MOST_CHANNELS, use_of_rows.len(), channel_rows)))
    }
}

fn channel_timing(channel: &ChannelHealth) -> Markup {
    let stamps = channel.stamps.as_ref();
    html! {
        tr {
            th scope="row" { (shown(&channel.name)) }
            td.any { (maybe(stamps, stamp_source)) }
            td.n { (maybe(stamps.and_then(|s| s.rate_hz), |rate| html! { (number::significant(rate, 4)) })) }
            td.n { (maybe(stamps.and_then(|s| s.steps_s), |d| html! { (millis(d.p99 - d.median)) })) }
            td { (maybe(stamps.filter(|s| s.steps_s.is_some()), gaps)) }
            td.n { (maybe(stamps, |s| html! { (number::count(s.duplicates)) })) }
            td.n { (maybe(stamps, |s| html! { (number::count(s.back_jumps)) })) }
            td {
                @for offset in channel.offsets.iter().take(MOST_INNER) { div { (offset_line(offset)) } }
                @if channel.offsets.is_empty() { span.none { "—" } }
            }
        }
    }
}

fn stamp_source(stamps: &StampHealth) -> Markup {
    html! { (stamps.kind) ", clock " (stamps.clock) ", from " code { (shown(&stamps.source)) } }
}

/// Seconds as milliseconds.
pub(super) fn millis(seconds: f64) -> String {
    number::significant(seconds * 1e3, 3)
}

fn gaps(stamps: &StampHealth) -> Markup {
    html! {
        (number::count(stamps.gap_count))
        @if let Some(gap) = stamps.gaps.first() {
            "; longest " (number::significant(gap.length_s, 3)) " s at " (number::clock(gap.start_s, 0))
        } @else if let Some(steps) = stamps.steps_s {
            "; longest step " (millis(steps.max)) " ms"
        }
    }
}

fn offset_line(offset: &StampOffset) -> Markup {
    let d = &offset.offset_s;
    html! {
        (offset.of) " − " (offset.against) ": " (millis(d.median)) " (" (millis(d.p01)) " to " (millis(d.p99)) ")"
    }
}

fn channel_rows(channel: &ChannelHealth) -> Markup {
    html! {
        tr {
            th scope="row" { (shown(&channel.name)) }
            td.any {
                code { (shown(&channel.source.topic)) }
                @if !channel.source.type_name.is_empty() { " (" (shown(&channel.source.type_name)) ")" }
                ": " (shown(&channel.source.fields.join(", ")))
                @if !channel.absent.is_empty() { "; not in the log: " (shown(&channel.absent.join(", "))) }
            }
            td.n { (number::count(channel.rows)) }
            td.n { (number::count(channel.used)) }
            td { (maybe(channel.held.as_ref(), |h| html! {
                (number::count(h.repeats)) " repeats, runs of " (number::count(h.modal_run))
                ", update every " (millis(h.update_interval_s)) " ms"
            })) }
            td.any { (rejects(&channel.rejected)) }
        }
    }
}

pub(super) fn rejects(rejected: &[RejectCount]) -> Markup {
    html! {
        @if rejected.is_empty() { "0" }
        @for reject in rejected.iter().take(MOST_INNER) {
            div { (number::count(reject.count)) ": " (shown(&reject.reason)) " (first: " (shown(&reject.first)) ")" }
        }
        @if rejected.len() > MOST_INNER { div { (more(rejected.len() - MOST_INNER)) } }
    }
}

fn ledger(bytes: &ByteLedger) -> Markup {
    let parts = [
        ("Decoded", bytes.decoded, "held values that were wanted; a compressed chunk counts whole"),
        ("Not wanted", bytes.skipped, "intact, but no map wants it"),
        ("Structure", bytes.structure, "magic, headers, indexes, definitions"),
        ("Damaged", bytes.damaged, "could not be read or failed a checksum"),
        ("Tail cut", bytes.tail_cut, "the log ends inside its last record, as at power-off: no damage"),
    ];
    let sum = bytes.sum();
    let body = html! {
        @for (name, count, what) in parts {
            tr { th scope="row" { (name) } td.n { (number::count(count)) } td { (what) } }
        }
        tr {
            th scope="row" { "Sum" } td.n { (number::count(sum)) }
            td {
                @if sum == bytes.size { "equal to the size of the files: every byte is accounted for" }
                @else { b.bad { "not the size of the files, " (number::count(bytes.size)) " bytes: the ledger does \
                 not add up" } }
            }
        }
    };
    table("Where every byte went", &[Text("Bytes"), Number("Count"), Text("What they are")], body)
}

fn damage(log: &LogHealth) -> Markup {
    let row = |range: &DamagedRange| {
        html! {
            tr {
                th scope="row" { (shown(&range.file)) }
                td.n { (number::count(range.offset)) } td.n { (number::count(range.length)) }
                td.n { (range.after_s().map_or("–".to_owned(), |s| format!("{s:.3}"))) }
                td.any { (shown(&range.reason)) }
            }
        }
    };
    let head = [Text("File"), Number("First byte"), Number("Bytes"), Number("After, s"), Text("Why")];
    html! {
        @if log.damage_count > 0 || !log.damage.is_empty() {
            h3 { "Damage" }
            p { (number::counted(log.damage_count, "damaged stretch", "damaged stretches")) " in all"
                @if log.damage_count > log.damage.len() as u64 { "; the first " (log.damage.len()) " are listed" } ". “After” counts from the log's first message to the last one in front of the stretch." }
            (table("Stretches that could not be used", &head, rows(&log.damage, 100, head.len(), row)))
        }
    }
}

fn topics(log: &LogHealth) -> Markup {
    let head = [
        Text("Topic"),
        Text("Type"),
        Text("Encoding"),
        Number("Messages"),
        Number("Payload"),
        Text("Stamps: kind, clock, rate, gaps"),
        Text("Decoded"),
    ];
    html! {
        details {
            summary { "All topics of the log (" (number::count(log.topics.len() as u64)) ")" }
            (table("Topics", &head, rows(&log.topics, MOST_TOPICS, head.len(), topic_row)))
            p.note { (GAP) }
        }
    }
}

fn topic_row(topic: &TopicHealth) -> Markup {
    html! {
        tr {
            th scope="row" { (shown(&topic.name)) }
            td.any { (shown(&topic.type_name)) }
            td { (shown(&topic.encoding)) }
            td.n { (number::count(topic.messages)) }
            td.n { (number::bytes(topic.payload_bytes)) }
            td { @for stamps in topic.stamps.iter().take(MOST_STAMPS) { div { (topic_stamps(stamps, topic.messages)) } } }
            td.any {
                @if topic.decoded { "yes" } @else { "no" }
                @if !topic.reason.is_empty() { ": " (shown(&topic.reason)) }
            }
        }
    }
}

fn topic_stamps(stamps: &StampHealth, messages: u64) -> Markup {
    html! {
        (stamps.kind) " (" (shown(&stamps.source)) "), " (stamps.clock)
        @if let Some(rate) = stamps.rate_hz { ", " (number::significant(rate, 4)) " Hz" }
        @else if stamps.steps_s.is_some() { ", half or more of them at once" }
        @if stamps.count < messages { ", from " (number::count(stamps.count)) " of the messages" }
        @if stamps.gap_count > 0 { ", " (number::counted(stamps.gap_count, "gap", "gaps")) }
        @if let Some(gap) = stamps.gaps.first() { ", longest " (number::significant(gap.length_s, 3)) " s" }
        @if stamps.back_jumps > 0 { ", " (number::counted(stamps.back_jumps, "step", "steps")) " back" }
    }
}

fn extras(extras: &[String]) -> Markup {
    html! {
        @if !extras.is_empty() {
            details {
                summary { "Attachments and metadata, listed but not read (" (number::count(extras.len() as u64)) ")" }
                ul.plain {
                    @for extra in extras.iter().take(MOST_TOPICS) { li { (shown(extra)) } }
                    @if extras.len() > MOST_TOPICS { li { (more(extras.len() - MOST_TOPICS)) } }
                }
            }
        }
    }
}

/// Lost data and the number of notices, for the top of a page.
pub(super) fn notice_words(notices: &Notices) -> Markup {
    let number_of = |severity| notices.iter().filter(|n| n.severity == severity).count() as u64;
    let (losses, warnings) = (number_of(Severity::Loss), number_of(Severity::Warning));
    html! {
        @if notices.any_loss() { (data_lost()) }
        @else if notices.iter().any(|n| n.code == Code::MinorLoss) { a href="#notices" { (minor_loss()) } }
        @else if notices.iter().any(|n| n.code == Code::TailCut) { a href="#notices" { (tail_cut()) } }
        @if losses + warnings > 0 {
            a href="#notices" {
                (number::counted(losses, "notice", "notices")) " of loss, "
                (number::counted(warnings, "warning", "warnings"))
            }
        }
    }
}

/// All notices, most severe first.
pub(super) fn notices_section(notices: &Notices) -> Markup {
    let groups = [
        (Severity::Loss, "▲ Damage"),
        (Severity::Warning, "! Warnings (something was assumed, skipped or repaired)"),
        (Severity::Info, "i For information (every number is valid)"),
    ];
    html! {
        h2 id="notices" { "Notices" }
        @if notices.is_empty() { p { "None." } }
        @for (severity, title) in groups { (notice_group(notices, severity, title)) }
    }
}

fn notice_group(notices: &Notices, severity: Severity, title: &str) -> Markup {
    let group: Vec<&Notice> = notices.iter().filter(|n| n.severity == severity).collect();
    let events = group.iter().fold(0u64, |sum, n| sum.saturating_add(n.count));
    let row = |notice: &&Notice| {
        html! {
            tr {
                th scope="row" { code { (shown(&notice.code)) } }
                td.n { (number::count(notice.count)) }
                td.any { (shown(&notice.place)) }
                td.any { (shown(&notice.text)) }
            }
        }
    };
    let head = [Text("Code"), Number("Count"), Text("Where"), Text("What")];
    let notices = number::counted(group.len() as u64, "notice", "notices");
    let caption = format!("{title}: {notices}, sum of counts {}", number::count(events));
    html! {
        @if !group.is_empty() {
            div.grave[severity == Severity::Loss] {
                (table(&caption, &head, rows(&group, MOST_NOTICES, head.len(), row)))
            }
        }
    }
}

/// The channel map that was used and why, and the other candidates.
pub(super) fn binding_section(binding: Option<&Binding>) -> Markup {
    html! {
        h2 { "Channel map" }
        (channel_map(binding))
    }
}

/// The channel map of one log.
pub(super) fn channel_map(binding: Option<&Binding>) -> Markup {
    let row = |candidate: &MapCandidate| {
        html! {
            tr {
                th scope="row" { (shown(&candidate.map)) }
                td.any { (shown(&candidate.binds.join(", "))) }
                td.any { (shown(&candidate.why)) }
            }
        }
    };
    let head = [Text("Map"), Text("Would bind"), Text("Why not")];
    html! {
        @match binding {
            Some(binding) => {
                p { "Taken: " b { (shown(&binding.map)) } ". " (shown(&binding.why)) }
                @if !binding.others.is_empty() {
                    details {
                        summary { "Others considered (" (number::count(binding.others.len() as u64)) ")" }
                        (table("Other channel maps", &head, rows(&binding.others, 60, head.len(), row)))
                    }
                }
            }
            None => { p { "No channel map was taken, so no channel is bound." } }
        }
    }
}
