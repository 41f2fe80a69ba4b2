//! What each test loads, as it was accepted. `FLIGHTLAG_BLESS=1` accepts a change: read the diff.

use flight::{Channel, Notices, Stamp};
use ingest::{Column, ColumnData, IngestError, Loaded, Log, LogError};
use serde::Serialize;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Values of a record with more characters are shown by their hash.
const LONGEST: usize = 240;

/// Compares what was loaded from files with the golden text of the running test.
pub fn assert_as_accepted(files: &[PathBuf], loaded: &Result<Loaded, IngestError>) {
    assert_golden(files, &loaded.as_ref().map_or_else(ToString::to_string, summary));
}

/// Compares what was read from files with the golden text of the running test.
pub fn assert_log_as_accepted(files: &[PathBuf], log: &Result<Log, LogError>) {
    assert_golden(files, &log.as_ref().map_or_else(ToString::to_string, summary_of_log));
}

/// Real logs have `tests/frozen/real.txt`.
pub fn assert_golden(files: &[PathBuf], text: &str) {
    let folder = files.first().and_then(|file| file.parent()).unwrap_or(Path::new(""));
    if folder.components().any(|part| part.as_os_str() == "shared") {
        return;
    }
    let text = text.replace(&format!("{}/", folder.display()), "");
    // Damaged names hold control characters, which would make the file binary.
    let text = text.replace(|c: char| c.is_control() && c != '\n', "·");
    simulate::assert_golden(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden"), &text);
}

fn summary(loaded: &Loaded) -> String {
    let mut text = String::new();
    for (name, channel) in &loaded.flight.channels {
        _ = writeln!(text, "{name} {}", values(channel));
    }
    match &loaded.binding {
        Ok(binding) => add(&mut text, "binding", binding),
        Err(why) => text += &format!("no binding: {why}\n"),
    }
    add(&mut text, "health", &loaded.health);
    if let Some(companion) = &loaded.companion {
        text += &format!("companion: {companion}\n");
    }
    add_notices(&mut text, &loaded.flight.notices);
    text
}

fn summary_of_log(log: &Log) -> String {
    let mut text = String::new();
    for table in &log.tables {
        _ = write!(text, "{} {} {} rows", table.topic.name, table.topic.type_name, table.rows);
        for times in [&table.logged_ns, &table.published_ns].into_iter().flatten() {
            let seconds: Vec<f64> = times.iter().map(|ns| (ns - times[0]) as f64 * 1e-9).collect();
            _ = write!(text, " from {:?}{}", times.first(), statistics(&seconds));
        }
        let columns: String = table.columns.iter().map(|c| column(c, table.rows)).collect();
        _ = writeln!(text, "{}", short(&columns));
    }
    add(&mut text, "health", &log.health);
    add_notices(&mut text, &log.notices);
    text
}

/// Name, rows with a value, and mean and rms of the numbers.
fn column(column: &Column, rows: usize) -> String {
    let rows = column.valid.as_ref().map_or(rows, |valid| valid.iter().filter(|valid| **valid).count());
    let numbers: Vec<f64> = match &column.data {
        ColumnData::F64(values) => values.clone(),
        ColumnData::I64(values) => values.iter().map(|value| *value as f64).collect(),
        ColumnData::U64(values) => values.iter().map(|value| *value as f64).collect(),
        ColumnData::Text(values) => {
            return format!(" {} {rows} {}", column.path, short(&values.iter().collect::<Vec<&str>>().join(" ")));
        }
    };
    format!(" {} {rows}{}", column.path, statistics(&numbers))
}

fn add_notices(text: &mut String, notices: &Notices) {
    for notice in notices.iter() {
        let what: String = notice.text.chars().take(LONGEST).collect();
        _ = writeln!(text, "{:?} {} × {} at {:?}: {what}", notice.severity, notice.code, notice.count, notice.place);
    }
}

/// A long text is shown by its hash.
fn short(text: &str) -> String {
    let hash = || format!(" hash {}", &blake3::hash(text.as_bytes()).to_hex()[..16]);
    if text.len() > LONGEST { hash() } else { text.to_owned() }
}

/// Rows, times, and mean and rms of each component.
fn values(channel: &Channel) -> String {
    let timeline = channel.series.timeline();
    let seconds =
        |stamps: &[Stamp]| -> Vec<f64> { stamps.iter().map(|t| t.seconds_since(timeline.stamps()[0])).collect() };
    let mut text = format!("{:?} {:?}", channel.quantity, channel.present);
    if let Some(first) = timeline.stamps().first() {
        _ = write!(text, " {} rows from {} {}", channel.held.len(), first.0, statistics(&seconds(timeline.stamps())));
    }
    channel.series.components().iter().for_each(|component| text += &statistics(component));
    for (kind, clock, stamps) in &channel.other_stamps {
        _ = write!(text, " {kind:?} {clock:?} {}", statistics(&seconds(stamps)));
    }
    _ = write!(text, " held {}", channel.held.iter().filter(|held| **held).count());
    text
}

fn statistics(values: &[f64]) -> String {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let rms = (values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n).sqrt();
    // Below is rounding noise.
    let [mean, rms] = [mean, rms].map(|x| if x.abs() < 1e-9 { 0.0 } else { x });
    format!(" ({mean:.7e} ± {rms:.4e})")
}

/// One line for each field of a record.
fn add(text: &mut String, name: &str, record: &impl Serialize) {
    let serde_json::Value::Object(fields) = serde_json::to_value(record).unwrap() else { return };
    for (field, value) in fields {
        _ = writeln!(text, "{name}.{field}: {}", short(&value.to_string()));
    }
}
