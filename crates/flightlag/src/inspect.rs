//! `flightlag inspect`: what is in a log, how good its stamps are, and what a map would bind.

mod vehicle;

use crate::arguments::InspectArguments;
use crate::failure::{End, Failure};
use crate::findings::{damage, notices, section, typed};
use crate::maps::{check_name, library};
use crate::show::{Table, bytes, count, number, visible};
use crate::stop::Stop;
use campaign::Exit;
use flight::{Binding, ChannelHealth, Clock, Flight, LogHealth, Stamp, StampHealth, TopicHealth};
use ingest::{Discovery, FlightUnit, Limits, Loaded, LogKind, MapLibrary, ReadContext, discover, load};
use std::fmt::Write as _;
use std::io::Write;
use std::path::Path;

/// Topics that are listed unasked.
const MOST_TOPICS: usize = 40;
/// And beside those that were read.
const MOST_OTHERS: usize = 12;
/// Other things that are listed unasked.
const MOST_LISTED: usize = 8;

pub(crate) fn run(arguments: &InspectArguments, stop: &Stop) -> Result<End, Failure> {
    let library = library(arguments.maps.as_deref())?;
    check_name(&library, arguments.map.as_deref())?;
    let unit = unit_of(&arguments.log, &library)?;
    let context = ReadContext { limits: Limits::default(), cancel: stop.flag(), on_bytes: &|_| {} };
    let loaded = load(&unit, &library, arguments.map.as_deref(), &context)?;
    let text = if arguments.json { json_text(&unit, &loaded) } else { page(&unit, &loaded, arguments) };
    std::io::stdout().lock().write_all(text.as_bytes())?;
    let lossy = loaded.flight.notices.any_loss();
    Ok(if lossy { Exit::Incomplete } else { Exit::Well }.into())
}

/// The flight that a path stands for: a file, or a folder that holds one flight.
pub(crate) fn unit_of(path: &Path, library: &MapLibrary) -> Result<FlightUnit, Failure> {
    let failure = |exit, what: String| Failure::new(exit, format!("{}: {what}", path.display()));
    let about = std::fs::metadata(path).map_err(|e| failure(Exit::Wrong, e.to_string()))?;
    if !about.is_file() && !about.is_dir() {
        return Err(failure(Exit::Wrong, "a device or a pipe; a log is read from a file".to_owned()));
    }
    let mut found = discover(path, library)?;
    match found.units.as_slice() {
        [] => Err(failure(Exit::Failed, nothing(&found, about.is_dir()))),
        [_] => Ok(found.units.remove(0)),
        several => {
            let names: Vec<&str> = several.iter().take(MOST_LISTED).map(|u| u.id.as_str()).collect();
            let more = if several.len() > names.len() { ", ..." } else { "" };
            let what = format!("{} flights are in this folder; name one of them: ", several.len());
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
        Err(reason) => format!("{}\n", visible(reason)),
    };
    let parts = [
        head(unit, health),
        vehicle::text(&health.about, all),
        topics(&health.topics, all),
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
    let parts = [("decoded", b.decoded), ("not wanted", b.skipped), ("structure", b.structure)];
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

/// Topics that were read, and others as far as there is room.
fn topics(topics: &[TopicHealth], all: bool) -> String {
    let mut table = Table::new(&["topic", "type", "encoding", "messages|", "rate Hz|", "duration s|", "values"]);
    let any = topics.iter().any(|t| t.decoded);
    let (mut room, mut left_out, mut empty) = (if any { MOST_OTHERS } else { MOST_TOPICS }, 0, 0);
    for topic in topics {
        let asked = topic.decoded || !topic.reason.is_empty();
        match (all || asked, topic.messages, room) {
            (false, 0, _) => empty += 1,
            (false, _, 0) => left_out += 1,
            (asked, ..) => {
                room -= usize::from(!asked);
                table.row(topic_cells(topic));
            }
        }
    }
    let mut text = section("topics", &table);
    for (n, what) in [(left_out, "more that no map reads"), (empty, "more without a message")] {
        if n > 0 {
            let _ = writeln!(text, "  and {n} {what}; --all lists them");
        }
    }
    text
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

/// Hz: of bursts, thousands without a fraction.
fn rate(hz: Option<f64>) -> String {
    number(hz, if hz.is_some_and(|hz| hz >= 1000.0) { 0 } else { 2 })
}

/// From the first stamp to the last, s; unknown where stamps go back.
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

/// Of the topics that were read; of all if none was.
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
    section(if any && !all { "time stamps of the topics that were read" } else { "time stamps" }, &table)
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
        stamp.gap_count.to_string(),
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
    for table in [offsets(&binding.channels), others(binding)] {
        if !table.is_empty() {
            text += &format!("\n{}", table.text());
        }
    }
    text
}

/// When it was: what the channels span together, with the date where the log tells it.
fn span(channels: &[ChannelHealth], flight: &Flight) -> Option<String> {
    let stamps: Vec<&StampHealth> = channels.iter().filter_map(|c| c.stamps.as_ref()).collect();
    let clock = stamps.first()?.clock;
    let of_clock = || stamps.iter().filter(|s| s.clock == clock);
    let first = of_clock().map(|s| s.first_ns.min(s.last_ns)).min()?;
    let last = of_clock().map(|s| s.last_ns.max(s.first_ns)).max()?;
    let seconds = (i128::from(last) - i128::from(first)) as f64 * 1e-9;
    let utc = |ns: i64| match clock {
        Clock::Unix => Some(Stamp(ns)),
        _ => flight.utc.as_ref().filter(|tie| tie.clock == clock).and_then(|tie| tie.unix(Stamp(ns))),
    };
    let shown = |stamp: Stamp| {
        let instant = jiff::Timestamp::from_nanosecond(i128::from(stamp.0)).ok()?;
        Some(instant.strftime("%Y-%m-%d %H:%M:%S").to_string())
    };
    let when = match (utc(first).and_then(shown), utc(last).and_then(shown)) {
        (Some(from), Some(to)) => format!("from {from} to {to} UTC"),
        _ => format!(
            "from {:.1} s to {:.1} s, clock {clock}, which nothing dates",
            first as f64 * 1e-9,
            last as f64 * 1e-9
        ),
    };
    Some(format!("{seconds:.1} s {when}"))
}

fn channels(channels: &[ChannelHealth]) -> Table {
    let mut table = Table::new(&["channel", "topic", "fields", "rows|", "used|", "held|", "rate Hz|", "stamp"]);
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
            stamps.map_or_else(|| "-".to_owned(), |s| format!("{}, {}", s.kind, s.source)),
        ]);
    }
    table
}

/// How far the kinds of stamp of a channel are apart.
fn offsets(channels: &[ChannelHealth]) -> Table {
    let mut table = Table::new(&["channel", "stamps", "median ms|", "p01|", "p99|"]);
    for (channel, o) in channels.iter().flat_map(|c| c.offsets.iter().map(move |o| (c, o))) {
        let millis = |x: f64| number(Some(x * 1e3), 2);
        let d = &o.offset_s;
        let pair = format!("{} less {}", o.of, o.against);
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

/// What can be done about it.
fn next(unit: &FlightUnit, loaded: &Loaded, log: &Path) -> String {
    let mut text = String::new();
    if loaded.flight.notices.any_loss() {
        let command = match unit.kind {
            LogKind::Csv | LogKind::Nmea => format!("flightlag export {} --topics --to csv", typed(log)),
            _ => format!("flightlag recover {} GOOD.mcap", typed(log)),
        };
        let _ = writeln!(text, "data were lost (exit code 3); what is good of them: {command}");
    }
    if loaded.binding.is_err() {
        let _ = writeln!(
            text,
            "without a map there are no channels: `flightlag maps` lists what is known, `flightlag maps NAME` prints one \
             to start your own from, and --maps DIR reads it; `flightlag export LOG --topics` needs none"
        );
    }
    text
}
