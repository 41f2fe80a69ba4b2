//! `flightlag inspect`: the content of a log, the quality of its timestamps, and what a map would bind.

mod vehicle;

use crate::arguments::InspectArguments;
use crate::failure::{End, Failure};
use crate::findings::{damage, notices, section, typed};
use crate::maps::{check_name, library};
use crate::show::{Table, bytes, count, number, visible};
use crate::stop::Stop;
use campaign::Exit;
use flight::{Binding, ChannelHealth, Flight, LogHealth, Stamp, StampHealth, TopicHealth};
use ingest::{Discovery, FlightUnit, Limits, Loaded, LogKind, MapLibrary, ReadContext, discover, load};
use std::fmt::Write as _;
use std::io::Write;
use std::path::Path;

/// Printed below every table that counts gaps.
const GAP: &str = "  a gap is a step of more than 2.5 median steps\n";
/// Maximum number of topics listed by default.
const MOST_TOPICS: usize = 40;
/// Maximum number of topics listed in addition to those that were read.
const MOST_OTHERS: usize = 12;
/// Maximum number of other items listed by default.
const MOST_LISTED: usize = 8;

pub(crate) fn run(arguments: &InspectArguments, stop: &Stop) -> Result<End, Failure> {
    let library = library(arguments.maps.as_deref())?;
    check_name(&library, arguments.map.as_deref())?;
    let unit = unit_of(&arguments.log, &library)?;
    // It accounts for every byte, wanted or not.
    let limits = Limits { may_leave_closed: false, ..Limits::default() };
    let context = ReadContext { limits, cancel: stop.flag(), on_bytes: &|_| {} };
    let loaded = load(&unit, &library, arguments.map.as_deref(), &context)?;
    let text = if arguments.json { json_text(&unit, &loaded) } else { page(&unit, &loaded, arguments) };
    std::io::stdout().lock().write_all(text.as_bytes())?;
    Ok(exit(&loaded).into())
}

/// A map that does not fit is the wrong map, not damage.
fn exit(loaded: &Loaded) -> Exit {
    let notices = &loaded.flight.notices;
    if notices.iter().any(|notice| notice.code == flight::Code::MapLacks) {
        Exit::Wrong
    } else if notices.any_loss() {
        Exit::Incomplete
    } else {
        Exit::Well
    }
}

/// The flight at a path: a file, or a folder that contains one flight.
pub(crate) fn unit_of(path: &Path, library: &MapLibrary) -> Result<FlightUnit, Failure> {
    let failure = |exit, what: String| Failure::new(exit, format!("{}: {what}", path.display()));
    let about = std::fs::metadata(path).map_err(|e| failure(Exit::Wrong, e.to_string()))?;
    if !about.is_file() && !about.is_dir() {
        return Err(failure(Exit::Wrong, "a device or a pipe; logs are read only from files".to_owned()));
    }
    let mut found = discover(path, library)?;
    match found.units.as_slice() {
        [] => Err(failure(Exit::Failed, nothing(&found, about.is_dir()))),
        [_] => Ok(found.units.remove(0)),
        several => {
            let names: Vec<&str> = several.iter().take(MOST_LISTED).map(|u| u.id.as_str()).collect();
            let more = if several.len() > names.len() { ", ..." } else { "" };
            let what = format!("{} flights are in this folder; give one of them: ", several.len());
            Err(failure(Exit::Wrong, what + &names.join(", ") + more))
        }
    }
}

/// Why there is no flight.
fn nothing(found: &Discovery, folder: bool) -> String {
    let reasons = || found.unreadable.iter().chain(&found.ignored);
    match (reasons().next(), folder) {
        (Some((_, reason)), false) => reason.clone(),
        (None, false) => "not a log".to_owned(),
        (None, true) => "this folder is empty".to_owned(),
        (Some((name, reason)), true) => {
            let files = count(reasons().count() as u64, "other file");
            format!("no log in this folder, but {files}; the first: {name}, {reason}")
        }
    }
}

fn json_text(unit: &FlightUnit, loaded: &Loaded) -> String {
    let json = serde_json::json!({
        "flight": unit.id,
        "health": loaded.health,
        "binding": loaded.binding.as_ref().ok(),
        "no_binding": loaded.binding.as_ref().err(),
        "notices": loaded.flight.notices,
    });
    let mut text = serde_json::to_string_pretty(&json).unwrap_or_default();
    text.push('\n');
    text
}

fn page(unit: &FlightUnit, loaded: &Loaded, arguments: &InspectArguments) -> String {
    let all = arguments.all;
    let health = &loaded.health;
    let binding = match &loaded.binding {
        Ok(binding) => binding_text(binding, &loaded.flight),
        Err(reason) => format!("{}\n", visible(&without_repeats(reason, &health.topics))),
    };
    let parts = [
        head(unit, health),
        vehicle::text(&health.about, all),
        topics(&health.topics, channels_of(loaded), all),
        stamps(&health.topics, all),
        extras(health, all),
        binding,
        damage(health),
        notices(&loaded.flight.notices),
        next(unit, loaded, &arguments.log),
    ];
    let parts: Vec<String> = parts.into_iter().filter(|p| !p.is_empty()).collect();
    parts.join("\n")
}

fn head(unit: &FlightUnit, health: &LogHealth) -> String {
    let b = &health.bytes;
    let parts =
        [("decoded", b.decoded), ("not wanted", b.skipped), ("structure", b.structure), ("tail cut", b.tail_cut)];
    let mut ledger = String::new();
    for (what, n) in parts.into_iter().filter(|(_, n)| *n > 0) {
        let _ = write!(ledger, "{n} {what} + ");
    }
    let share = match 100.0 * b.damaged as f64 / b.size.max(1) as f64 {
        0.0 => String::new(),
        small if small < 0.01 => " (< 0.01 %)".to_owned(),
        percent => format!(" ({percent:.2} %)"),
    };
    let undecodable = match health.undecodable {
        0 => String::new(),
        n => format!(", {n} more that could not be decoded"),
    };
    format!(
        "{}\n  {}, {}, {}{undecodable}\n  {} bytes = {ledger}{} damaged{share}\n",
        visible(&unit.id),
        visible(&health.format),
        bytes(b.size),
        count(health.messages, "message"),
        b.size,
        b.damaged,
    )
}

fn channels_of(loaded: &Loaded) -> &[ChannelHealth] {
    loaded.binding.as_ref().map_or(&[], |binding| &binding.channels)
}

/// Topics that were read, and as many others as there is room for.
fn topics(topics: &[TopicHealth], channels: &[ChannelHealth], all: bool) -> String {
    let mut table = Table::new(&["topic", "type", "encoding", "messages|", "rate Hz|", "duration s|", "values"]);
    let any = topics.iter().any(|t| t.decoded);
    let (mut room, mut left_out, mut empty) = (if any { MOST_OTHERS } else { MOST_TOPICS }, 0, 0);
    let mut notes = vec![];
    for topic in topics {
        let asked = topic.decoded || !topic.reason.is_empty();
        match (all || asked, topic.messages, room) {
            (false, 0, _) => empty += 1,
            (false, _, 0) => left_out += 1,
            (asked, ..) => {
                room -= usize::from(!asked);
                table.row(topic_cells(topic));
                notes.extend(about_rate(topic, channels));
            }
        }
    }
    let mut text = section("topics", &table);
    for note in notes.iter().take(MOST_LISTED) {
        let _ = writeln!(text, "  {note}");
    }
    if notes.len() > MOST_LISTED {
        let _ = writeln!(text, "  and {} more topics with a remark on their rate", notes.len() - MOST_LISTED);
    }
    for (n, what) in [(left_out, "more without a map"), (empty, "more without a message")] {
        if n > 0 {
            let _ = writeln!(text, "  and {n} {what}; --all lists them");
        }
    }
    text
}

/// What the rate of a topic does not show: how many of its messages it covers.
fn about_rate(topic: &TopicHealth, channels: &[ChannelHealth]) -> Option<String> {
    let stamps = topic.stamps.first()?;
    let (name, all) = (visible(&topic.name), topic.messages);
    // Where the format has no times, those of a channel are shown: of the rows that it uses.
    let is_shown = |c: &&ChannelHealth| c.source.topic == topic.name && c.stamps.as_ref() == Some(stamps);
    if let Some(channel) = channels.iter().find(is_shown).filter(|_| stamps.count < all) {
        let (count, channel) = (stamps.count, visible(&channel.name));
        return Some(format!("{name}: rate and duration are of the {count} of {all} messages that {channel} uses"));
    }
    if stamps.count < all {
        return Some(format!("{name}: {} of {all} messages have a time", stamps.count));
    }
    let at_once = stamps.rate_hz.is_none() && stamps.steps_s.is_some();
    at_once.then(|| format!("{name}: no rate, because half or more of its messages share one timestamp"))
}

fn topic_cells(topic: &TopicHealth) -> Vec<String> {
    let first = topic.stamps.first();
    vec![
        topic.name.clone(),
        topic.type_name.clone(),
        topic.encoding.clone(),
        topic.messages.to_string(),
        rate(first.and_then(|s| s.rate_hz)),
        number(first.and_then(duration), 1),
        decoded(topic),
    ]
}

/// Rate in Hz: thousands, which occur in bursts, without a fraction.
fn rate(hz: Option<f64>) -> String {
    number(hz, if hz.is_some_and(|hz| hz >= 1000.0) { 0 } else { 2 })
}

/// From the first timestamp to the last, s; unknown where timestamps go back.
fn duration(stamps: &StampHealth) -> Option<f64> {
    let span = i128::from(stamps.last_ns) - i128::from(stamps.first_ns);
    (stamps.back_jumps == 0 && span >= 0).then_some(span as f64 * 1e-9)
}

fn decoded(topic: &TopicHealth) -> String {
    match (topic.decoded, topic.reason.is_empty()) {
        (true, true) => "read".to_owned(),
        (true, false) => format!("read: {}", topic.reason),
        (false, true) => "-".to_owned(),
        (false, false) => format!("not read: {}", topic.reason),
    }
}

/// For the topics that were read; for all if none was.
fn stamps(topics: &[TopicHealth], all: bool) -> String {
    let mut table = Table::new(&[
        "topic",
        "stamp",
        "clock",
        "from",
        "rate Hz|",
        "step ms: least|",
        "median|",
        "p99|",
        "most|",
        "gaps|",
        "longest s|",
        "after s|",
        "repeated|",
        "backwards|",
    ]);
    let any = topics.iter().any(|t| t.decoded);
    let shown = topics.iter().filter(|t| all || t.decoded || !any);
    for topic in shown.take(if all || any { usize::MAX } else { MOST_TOPICS }) {
        for stamp in &topic.stamps {
            let mut row = vec![topic.name.clone()];
            row.extend(stamp_cells(stamp));
            table.row(row);
        }
    }
    let title = if any && !all { "timestamps of the topics that were read" } else { "timestamps" };
    let text = section(title, &table);
    if text.is_empty() { text } else { text + GAP }
}

fn stamp_cells(stamp: &StampHealth) -> Vec<String> {
    let millis = |of: &dyn Fn(&flight::Distribution) -> f64| number(stamp.steps_s.as_ref().map(|d| of(d) * 1e3), 2);
    let longest = stamp.gaps.first();
    vec![
        stamp.kind.to_string(),
        stamp.clock.to_string(),
        stamp.source.clone(),
        rate(stamp.rate_hz),
        millis(&|d| d.min),
        millis(&|d| d.median),
        millis(&|d| d.p99),
        millis(&|d| d.max),
        stamp.steps_s.map_or_else(|| "-".to_owned(), |_| stamp.gap_count.to_string()),
        number(longest.map(|g| g.length_s), 2),
        number(longest.map(|g| g.start_s), 1),
        stamp.duplicates.to_string(),
        stamp.back_jumps.to_string(),
    ]
}

fn extras(health: &LogHealth, all: bool) -> String {
    if health.extras.is_empty() {
        return String::new();
    }
    let most = if all { usize::MAX } else { MOST_LISTED };
    let mut text = String::from("also in the log\n");
    for extra in health.extras.iter().take(most) {
        let _ = writeln!(text, "  {}", visible(extra));
    }
    let more = health.extras.len().saturating_sub(most);
    if more > 0 {
        let _ = writeln!(text, "  and {more} more; --all lists them");
    }
    text
}

fn binding_text(binding: &Binding, flight: &Flight) -> String {
    let mut text = format!("channel map {}: {}\n", visible(&binding.map), visible(&binding.why));
    if let Some(span) = span(&binding.channels, flight) {
        let _ = writeln!(text, "  {span}");
    }
    text += &channels(&binding.channels).text();
    text += GAP;
    for table in [offsets(&binding.channels), others(binding)] {
        if !table.is_empty() {
            text += &format!("\n{}", table.text());
        }
    }
    text
}

/// Why no map fits, without what the table of topics already says about each topic.
fn without_repeats(reason: &str, topics: &[TopicHealth]) -> String {
    let listed =
        topics.iter().filter(|t| !t.reason.is_empty()).map(|t| (&t.name, format!("{} ({})", t.name, t.reason)));
    listed.fold(reason.to_owned(), |text, (name, both)| text.replace(&both, name))
}

/// Time span of the channels together, with the date if the log has it.
fn span(channels: &[ChannelHealth], flight: &Flight) -> Option<String> {
    let stamps: Vec<&StampHealth> = channels.iter().filter_map(|c| c.stamps.as_ref()).collect();
    let clock = stamps.first()?.clock;
    let of_clock = || stamps.iter().filter(|s| s.clock == clock);
    let first = of_clock().map(|s| s.first_ns.min(s.last_ns)).min()?;
    let last = of_clock().map(|s| s.last_ns.max(s.first_ns)).max()?;
    let seconds = (i128::from(last) - i128::from(first)) as f64 * 1e-9;
    let utc = |ns: i64| flight.unix(clock, Stamp(ns));
    let shown = |stamp: Stamp| {
        let instant = jiff::Timestamp::from_nanosecond(i128::from(stamp.0)).ok()?;
        Some(instant.strftime("%Y-%m-%d %H:%M:%S").to_string())
    };
    let when = match (utc(first).and_then(shown), utc(last).and_then(shown)) {
        (Some(from), Some(to)) => format!("from {from} to {to} UTC"),
        _ => format!("from {:.1} s to {:.1} s, clock {clock}, date unknown", first as f64 * 1e-9, last as f64 * 1e-9),
    };
    Some(format!("{seconds:.1} s {when}"))
}

fn channels(channels: &[ChannelHealth]) -> Table {
    let mut table = Table::new(&["channel", "topic", "fields", "rows|", "used|", "held|", "rate Hz|", "gaps", "stamp"]);
    for channel in channels {
        let stamps = channel.stamps.as_ref();
        let absent = match channel.absent.as_slice() {
            [] => String::new(),
            absent => format!("; no {}", absent.join(", no ")),
        };
        table.row(vec![
            channel.name.clone(),
            channel.source.topic.clone(),
            channel.source.fields.join(", ") + &absent,
            channel.rows.to_string(),
            channel.used.to_string(),
            channel.held.as_ref().map_or(0, |h| h.repeats).to_string(),
            rate(stamps.and_then(|s| s.rate_hz)),
            stamps.map_or_else(|| "-".to_owned(), gaps),
            stamps.map_or_else(|| "-".to_owned(), |s| format!("{}, {}", s.kind, s.source)),
        ]);
    }
    table
}

fn gaps(stamps: &StampHealth) -> String {
    match (stamps.gaps.first(), stamps.steps_s) {
        (Some(longest), _) => {
            format!("{}, longest {:.2} s after {:.1} s", stamps.gap_count, longest.length_s, longest.start_s)
        }
        (None, Some(_)) => stamps.gap_count.to_string(),
        (None, None) => "-".to_owned(),
    }
}

/// Differences between the timestamp kinds of a channel.
fn offsets(channels: &[ChannelHealth]) -> Table {
    let mut table = Table::new(&["channel", "stamps", "median ms|", "p01|", "p99|"]);
    for (channel, o) in channels.iter().flat_map(|c| c.offsets.iter().map(move |o| (c, o))) {
        let millis = |x: f64| number(Some(x * 1e3), 2);
        let d = &o.offset_s;
        let pair = format!("{} minus {}", o.of, o.against);
        table.row(vec![channel.name.clone(), pair, millis(d.median), millis(d.p01), millis(d.p99)]);
    }
    table
}

fn others(binding: &Binding) -> Table {
    let mut table = Table::new(&["other map", "would bind", "why not"]);
    for other in &binding.others {
        table.row(vec![other.map.clone(), other.binds.join(", "), other.why.clone()]);
    }
    table
}

/// Possible next steps.
fn next(unit: &FlightUnit, loaded: &Loaded, log: &Path) -> String {
    let mut text = String::new();
    if loaded.flight.notices.any_loss() {
        let command = match unit.kind {
            LogKind::Csv | LogKind::Nmea => format!("flightlag export {} --topics --to csv", typed(log)),
            _ => format!("flightlag recover {} GOOD.mcap", typed(log)),
        };
        let lost = match loaded.health.bytes.damaged {
            0 => "data were lost".to_owned(),
            bytes => format!("{} of the log could not be read", count(bytes, "byte")),
        };
        let _ = writeln!(text, "{lost} (exit code 3); save the intact data with: {command}");
    }
    if loaded.binding.is_err() {
        let _ = writeln!(
            text,
            "without a map there are no channels. `flightlag maps` lists the known maps, `flightlag maps NAME` \
             prints one as a start for your own, and --maps DIR reads it. `flightlag export LOG --topics` needs no \
             map"
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use flight::Clock;

    #[test]
    fn the_reason_does_not_repeat_the_topic_table() {
        let topic: TopicHealth = serde_json::from_value(serde_json::json!({
            "name": "motor", "type_name": "", "encoding": "csv", "messages": 2, "payload_bytes": 8, "stamps": [],
            "decoded": false, "reason": "none of the wanted columns is among t, rpm",
        }))
        .unwrap();
        let reason = "no channel map fits; the log holds motor (none of the wanted columns is among t, rpm)";
        assert_eq!(without_repeats(reason, &[topic]), "no channel map fits; the log holds motor");
    }

    #[test]
    fn a_rate_of_the_rows_of_a_channel_is_said_to_be_that() {
        let kind = flight::StampKind::Logged;
        let stamps = ingest::stamps::StampStats::from_slice(kind, Clock::Elapsed, "time", &[0, 1, 2]);
        let topic: TopicHealth = serde_json::from_value(serde_json::json!({
            "name": "own", "type_name": "", "encoding": "csv", "messages": 5, "payload_bytes": 8, "stamps": [stamps],
            "decoded": true, "reason": "",
        }))
        .unwrap();
        let channel: ChannelHealth = serde_json::from_value(serde_json::json!({
            "name": "position.gps", "quantity": "position-geodetic", "rows": 5, "used": 3, "absent": [],
            "source": {"topic": "own", "type_name": "", "fields": []}, "rejected": [], "stamps": stamps,
            "offsets": [], "held": null,
        }))
        .unwrap();
        let of_channel = "own: rate and duration are of the 3 of 5 messages that position.gps uses";
        assert_eq!(about_rate(&topic, &[channel]).as_deref(), Some(of_channel));
        assert_eq!(about_rate(&topic, &[]).as_deref(), Some("own: 3 of 5 messages have a time"));
    }

    #[test]
    fn a_flight_on_gps_time_is_dated_in_utc() {
        // Week 2313 and 500000 s: 2024-05-10 18:53:20 GPS time, which is 18 s ahead of UTC.
        let first = (2313 * 604_800 + 500_000) * flight::NANOS_PER_SECOND;
        let last = first + 60 * flight::NANOS_PER_SECOND;
        let kind = flight::StampKind::Measured;
        let span_of = |clock| {
            let stamps = ingest::stamps::StampStats::from_slice(kind, clock, "GWk, GMS", &[first, last]);
            let channel: ChannelHealth = serde_json::from_value(serde_json::json!({
                "name": "position.gps", "quantity": "position-geodetic", "rows": 2, "used": 2, "absent": [],
                "source": {"topic": "t", "type_name": "", "fields": []}, "rejected": [], "stamps": stamps,
                "offsets": [], "held": null,
            }))
            .unwrap();
            span(&[channel], &Flight::default()).unwrap()
        };
        assert_eq!(span_of(Clock::Gps), "60.0 s from 2024-05-10 18:53:02 to 2024-05-10 18:54:02 UTC");
        assert!(span_of(Clock::Boot).ends_with("date unknown"));
    }

    #[test]
    fn the_longest_gap_is_shown_and_gaps_of_unknown_steps_are_not_counted() {
        let stamps = |stamps: &[i64]| {
            ingest::stamps::StampStats::from_slice(flight::StampKind::Logged, Clock::Unix, "log", stamps).unwrap()
        };
        let second = flight::NANOS_PER_SECOND;
        assert_eq!(gaps(&stamps(&[0, 1, 2, 172, 173].map(|s| s * second))), "1, longest 170.00 s after 2.0 s");
        assert_eq!(gaps(&stamps(&[0, second])), "0");
        assert_eq!(gaps(&stamps(&[0])), "-");
    }
}
