//! Reads topics of a log and says what came of it: `read_topics LOG [TOPIC[=FIELD,FIELD] ...]`, no
//! topic for all. Without fields whole messages are decoded.
//!
//! CPU time is that of the whole process (Linux).
#![allow(clippy::print_stdout)]

mod asked;

use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let log = asked::read()?;
    println!("{}: {:?}", log.health.format, log.health.bytes);
    println!("{} messages, {} undecodable", log.health.messages, log.health.undecodable);
    for topic in &log.health.topics {
        let rate = topic.stamps.first().and_then(|s| s.rate_hz).map_or("-".to_owned(), |r| format!("{r:.2} Hz"));
        println!(
            "  {} [{}] {}: {} messages, {rate} {}",
            topic.name, topic.type_name, topic.encoding, topic.messages, topic.reason
        );
    }
    for table in &log.tables {
        println!("  table {}: {} rows, {} columns", table.topic.name, table.rows, table.columns.len());
    }
    for notice in log.notices.iter() {
        println!("  {:?} {} {} x{}: {}", notice.severity, notice.code, notice.place, notice.count, notice.text);
    }
    println!("  extras {:?}", log.health.extras);
    println!(
        "CPU {:.3} s, {} bytes read, peak memory {}",
        cpu_seconds().unwrap_or_default(),
        number_in("/proc/self/io", "rchar:").unwrap_or_default(),
        number_in("/proc/self/status", "VmHWM:").unwrap_or_default()
    );
    Ok(())
}

/// User and system time of this process, from ticks of 10 ms.
fn cpu_seconds() -> Option<f64> {
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    let mut fields = stat.rsplit(')').next()?.split_whitespace().skip(11);
    let (user, system): (f64, f64) = (fields.next()?.parse().ok()?, fields.next()?.parse().ok()?);
    Some((user + system) / 100.0)
}

/// What the system says of this process.
fn number_in(file: &str, name: &str) -> Option<String> {
    let text = std::fs::read_to_string(file).ok()?;
    text.lines().find_map(|line| line.strip_prefix(name)).map(|value| value.trim().to_owned())
}
