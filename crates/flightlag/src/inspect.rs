//! `flightlag inspect`: what is in a log, how good its stamps are, and what a map would bind.

use crate::arguments::InspectArguments;
use crate::failure::{End, Failure};
use crate::maps::library;
use crate::show::{Table, bytes, count, number, visible};
use crate::stop::Stop;
use campaign::Exit;
use flight::{About, Binding, ChannelHealth, LogHealth, Notices, Severity, StampHealth, TopicHealth};
use ingest::{FlightUnit, Limits, Loaded, MapLibrary, ReadContext, discover, load};
use std::io::Write;
use std::path::Path;

pub(crate) fn run(arguments: &InspectArguments, stop: &Stop) -> Result<End, Failure> {
    let library = library(arguments.maps.as_deref())?;
    let unit = unit_of(&arguments.log, &library)?;
    let context = ReadContext { limits: Limits::default(), cancel: stop.flag(), on_bytes: &|_| {} };
    let loaded = load(&unit, &library, arguments.map.as_deref(), &context)?;
    let text = if arguments.json { json_text(&unit, &loaded) } else { page(&unit, &loaded) };
    std::io::stdout().lock().write_all(text.as_bytes())?;
    let lossy = loaded.flight.notices.any_loss();
    Ok(if lossy { Exit::Incomplete } else { Exit::Well }.into())
}

/// The flight that a path stands for: a file, or a folder that holds one flight.
pub(crate) fn unit_of(path: &Path, library: &MapLibrary) -> Result<FlightUnit, Failure> {
    let wrong = |what: String| Failure::new(Exit::Wrong, format!("{}: {what}", path.display()));
    std::fs::metadata(path).map_err(|e| wrong(e.to_string()))?;
    let mut found = discover(path, library)?;
    match (found.units.pop(), found.units.len(), found.ignored.pop().or_else(|| found.unreadable.pop())) {
        (Some(unit), 0, _) => Ok(unit),
        (Some(_), others, _) => Err(wrong(format!("this folder holds {} flights; name one of them", others + 1))),
        (None, _, Some((_, reason))) if path.is_file() => {
            Err(Failure::new(Exit::Failed, format!("{}: {reason}", path.display())))
        }
        (None, ..) => Err(wrong("no log found in this folder".to_owned())),
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

fn page(unit: &FlightUnit, loaded: &Loaded) -> String {
    let binding = match &loaded.binding {
        Ok(binding) => binding_text(binding),
        Err(reason) => format!("no channel map fits: {}\n", visible(reason)),
    };
    let health = &loaded.health;
    let parts = [
        head(unit, health),
        vehicle(&health.about),
        section("topics", &topics(&health.topics)),
        section("time stamps", &stamps(&health.topics)),
        damage(health),
        extras(health),
        binding,
        notices(&loaded.flight.notices),
    ];
    let parts: Vec<String> = parts.into_iter().filter(|p| !p.is_empty()).collect();
    parts.join("\n")
}

fn section(title: &str, table: &Table) -> String {
    if table.is_empty() { String::new() } else { format!("{title}\n{}", table.text()) }
}

fn head(unit: &FlightUnit, health: &LogHealth) -> String {
    let b = &health.bytes;
    let parts = [("decoded", b.decoded), ("not wanted", b.skipped), ("structure", b.structure), ("damaged", b.damaged)];
    let ledger: Vec<String> = parts.iter().filter(|(_, n)| *n > 0).map(|(what, n)| format!("{what} {n}")).collect();
    let undecodable = match health.undecodable {
        0 => String::new(),
        n => format!(", {n} more that could not be decoded"),
    };
    format!(
        "{}\n  {}, {}, {}{undecodable}\n  bytes: {} = {}\n",
        visible(&unit.id),
        visible(&health.format),
        bytes(b.size),
        count(health.messages, "message"),
        b.size,
        if ledger.is_empty() { "0".to_owned() } else { ledger.join(" + ") },
    )
}

/// What the log says of the vehicle, its software and its settings.
fn vehicle(about: &About) -> String {
    let changes = about.parameter_changes.len() as u64;
    let parameters = (about.parameters > 0 || changes > 0)
        .then(|| format!("{}, {} during the log", count(about.parameters, "parameter"), count(changes, "change")));
    let receivers = (!about.receivers.is_empty()).then(|| about.receivers.join("; "));
    let facts = [
        ("system", about.system.clone()),
        ("firmware", about.firmware.clone()),
        ("hardware", about.hardware.clone()),
        ("vehicle", about.vehicle.clone()),
        ("receivers", receivers),
        ("parameters", parameters),
    ];
    let mut table = Table::new(&["vehicle", "value"]);
    for (name, value) in facts {
        if let Some(value) = value {
            table.row(vec![name.to_owned(), value]);
        }
    }
    for delay in &about.configured_delays {
        let value = format!("{} ms: {}", number(Some(delay.value_s * 1e3), 1), delay.meaning);
        table.row(vec![delay.parameter.clone(), value]);
    }
    let modes = about.modes.iter().map(|m| ("mode", format!("{:.1} s: {}", m.at_ns as f64 * 1e-9, m.mode)));
    let changes = about.parameter_changes.iter().map(|change| ("changed", change.clone()));
    let texts = about.texts.iter().map(|text| ("text", text.clone()));
    for (name, value) in modes.chain(changes).chain(texts) {
        table.row(vec![name.to_owned(), value]);
    }
    if table.is_empty() { String::new() } else { table.text() }
}

fn topics(topics: &[TopicHealth]) -> Table {
    let mut table = Table::new(&["topic", "type", "encoding", "messages|", "rate Hz|", "duration s|", "values"]);
    for topic in topics {
        let best = topic.stamps.first();
        let duration = best.map(|s| (i128::from(s.last_ns) - i128::from(s.first_ns)) as f64 * 1e-9);
        table.row(vec![
            topic.name.clone(),
            topic.type_name.clone(),
            topic.encoding.clone(),
            topic.messages.to_string(),
            number(best.and_then(|s| s.rate_hz), 2),
            number(duration, 1),
            decoded(topic),
        ]);
    }
    table
}

fn decoded(topic: &TopicHealth) -> String {
    match (topic.decoded, topic.reason.is_empty()) {
        (true, true) => "read".to_owned(),
        (true, false) => format!("read: {}", topic.reason),
        (false, true) => "-".to_owned(),
        (false, false) => format!("not read: {}", topic.reason),
    }
}

fn stamps(topics: &[TopicHealth]) -> Table {
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
        "repeated|",
        "backwards|",
    ]);
    for (topic, stamp) in topics.iter().flat_map(|t| t.stamps.iter().map(move |s| (t, s))) {
        let mut row = vec![topic.name.clone()];
        row.extend(stamp_cells(stamp));
        table.row(row);
    }
    table
}

fn stamp_cells(stamp: &StampHealth) -> Vec<String> {
    let millis = |of: &dyn Fn(&flight::Distribution) -> f64| number(stamp.steps_s.as_ref().map(|d| of(d) * 1e3), 2);
    vec![
        stamp.kind.to_string(),
        stamp.clock.to_string(),
        stamp.source.clone(),
        number(stamp.rate_hz, 2),
        millis(&|d| d.min),
        millis(&|d| d.median),
        millis(&|d| d.p99),
        millis(&|d| d.max),
        stamp.gap_count.to_string(),
        number(stamp.gaps.first().map(|g| g.length_s), 2),
        stamp.duplicates.to_string(),
        stamp.back_jumps.to_string(),
    ]
}

pub(crate) fn damage(health: &LogHealth) -> String {
    let mut table = Table::new(&["file", "first byte|", "bytes|", "why"]);
    for range in &health.damage {
        table.row(vec![range.file.clone(), range.offset.to_string(), range.length.to_string(), range.reason.clone()]);
    }
    let unlisted = health.damage_count.saturating_sub(health.damage.len() as u64);
    let mut text = section("damage", &table);
    if unlisted > 0 {
        text += &format!("  and {unlisted} more\n");
    }
    text
}

fn extras(health: &LogHealth) -> String {
    let names: Vec<String> = health.extras.iter().map(|e| visible(e)).collect();
    if names.is_empty() { String::new() } else { format!("also in the log: {}\n", names.join(", ")) }
}

fn binding_text(binding: &Binding) -> String {
    let mut text = format!("channel map {}: {}\n", visible(&binding.map), visible(&binding.why));
    text += &channels(&binding.channels).text();
    text += &channel_remarks(&binding.channels);
    let mut others = Table::new(&["other map", "would bind", "why not"]);
    for other in &binding.others {
        others.row(vec![other.map.clone(), other.binds.join(", "), other.why.clone()]);
    }
    if !others.is_empty() {
        text += &format!("\n{}", others.text());
    }
    text
}

fn channels(channels: &[ChannelHealth]) -> Table {
    let mut table = Table::new(&["channel", "topic", "fields", "rows|", "used|", "rate Hz|", "stamp"]);
    for channel in channels {
        let stamps = channel.stamps.as_ref();
        table.row(vec![
            channel.name.clone(),
            channel.source.topic.clone(),
            channel.source.fields.join(", "),
            channel.rows.to_string(),
            channel.used.to_string(),
            number(stamps.and_then(|s| s.rate_hz), 2),
            stamps.map_or_else(|| "-".to_owned(), |s| format!("{}, {}", s.kind, s.source)),
        ]);
    }
    table
}

/// What does not fit into a row: held values, rejected rows, absent components, offsets between stamps.
fn channel_remarks(channels: &[ChannelHealth]) -> String {
    let mut lines = vec![];
    for channel in channels {
        if let Some(held) = &channel.held {
            let interval = held.update_interval_s;
            lines
                .push(format!("{} of its rows repeat a held value; it is updated every {interval:.3} s", held.repeats));
        }
        if !channel.absent.is_empty() {
            lines.push(format!("the log does not hold {}", channel.absent.join(", ")));
        }
        lines.extend(
            channel.rejected.iter().map(|r| format!("{}: {}, first at {}", r.reason, count(r.count, "row"), r.first)),
        );
        lines.extend(channel.offsets.iter().map(|o| {
            let d = &o.offset_s;
            let (low, median, high) = (d.p01 * 1e3, d.median * 1e3, d.p99 * 1e3);
            format!("{} less {}: median {median:.2} ms, p01 {low:.2} ms, p99 {high:.2} ms", o.of, o.against)
        }));
        let name = visible(&channel.name);
        lines.iter_mut().filter(|l| !l.starts_with("  ")).for_each(|l| *l = format!("  {name}: {}", visible(l)));
    }
    lines.into_iter().map(|l| l + "\n").collect()
}

pub(crate) fn notices(notices: &Notices) -> String {
    let mut table = Table::new(&["notice", "where", "count|", "what"]);
    for notice in notices.iter() {
        let severity = match notice.severity {
            Severity::Info => "info",
            Severity::Warning => "warning",
            Severity::Loss => "loss",
        };
        table.row(vec![severity.to_owned(), notice.place.clone(), notice.count.to_string(), notice.text.clone()]);
    }
    section("notices", &table)
}
