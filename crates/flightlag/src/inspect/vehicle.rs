//! What a log states about the vehicle, its software and its settings.

use super::MOST_LISTED;
use crate::show::{Table, count, number};
use flight::{About, Clock, ModeStart};

/// As a table; long lists are shortened unless `all`.
pub(super) fn text(about: &About, all: bool) -> String {
    let mut table = Table::new(&["vehicle", "value"]);
    for (name, value) in facts(about) {
        if let Some(value) = value {
            table.row(vec![name.to_owned(), value]);
        }
    }
    for delay in &about.configured_delays {
        let value = format!("{} ms: {}", number(Some(delay.value_s * 1e3), 1), delay.meaning);
        table.row(vec![delay.parameter.clone(), value]);
    }
    let modes = about.modes.iter().map(|m| format!("{}: {}", when(m), m.mode)).collect();
    list(&mut table, "mode", modes, all);
    list(&mut table, "changed", about.parameter_changes.clone(), all);
    list(&mut table, "text", about.texts.clone(), all);
    if table.is_empty() { String::new() } else { table.text() }
}

/// By the log's clock, as in its texts: UTC if the clock counts that.
fn when(mode: &ModeStart) -> String {
    let utc = jiff::Timestamp::from_nanosecond(mode.at_ns.into()).ok().filter(|_| mode.clock == Clock::Unix);
    match utc {
        Some(utc) => utc.strftime("%Y-%m-%d %H:%M:%S%.3f UTC").to_string(),
        None => format!("{:.3} s", mode.at_ns as f64 * 1e-9),
    }
}

fn facts(about: &About) -> [(&'static str, Option<String>); 6] {
    let changes = about.parameter_changes.len() as u64;
    let parameters = (about.parameters > 0 || changes > 0)
        .then(|| format!("{}, {} during the log", count(about.parameters, "parameter"), count(changes, "change")));
    let receivers = (!about.receivers.is_empty()).then(|| about.receivers.join("; "));
    [
        ("system", about.system.clone()),
        ("firmware", about.firmware.clone()),
        ("hardware", about.hardware.clone()),
        ("vehicle", about.vehicle.clone()),
        ("receivers", receivers),
        ("parameters", parameters),
    ]
}

fn list(table: &mut Table, name: &str, values: Vec<String>, all: bool) {
    let most = if all { usize::MAX } else { MOST_LISTED };
    let more = values.len().saturating_sub(most);
    for value in values.into_iter().take(most) {
        table.row(vec![name.to_owned(), value]);
    }
    if more > 0 {
        table.row(vec![String::new(), format!("and {more} more; --all lists them")]);
    }
}
