//! What every file below a folder is: `cargo run -p flightlag-ingest --example bind_logs -- FOLDER [part of a name]`. For each
//! flight its map, channels and notices; for the rest the reason.
#![allow(clippy::print_stdout, reason = "an example's output is its print")]

use ingest::{Limits, MapLibrary, ReadContext, discover, load};
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = PathBuf::from(arguments.next().ok_or("usage: bind_logs FOLDER [part of a name]")?);
    let part = arguments.next().unwrap_or_default();
    let library = MapLibrary::shipped()?;
    let cancel = AtomicBool::new(false);
    let context = ReadContext { limits: Limits::default(), cancel: &cancel, on_bytes: &|_| {} };
    let found = discover(&folder, &library)?;
    for (name, reason) in found.ignored.iter().chain(&found.unreadable).filter(|(name, _)| name.contains(&part)) {
        println!("- {name}: {reason}");
    }
    for unit in found.units.iter().filter(|u| u.id.contains(&part)) {
        let start = Instant::now();
        let loaded = match load(unit, &library, None, &context) {
            Ok(loaded) => loaded,
            Err(error) => {
                println!("{}: {error}", unit.id);
                continue;
            }
        };
        let (took, bytes) = (start.elapsed().as_secs_f64(), loaded.health.bytes);
        println!("{} ({:?}): {}, {bytes:?}, {took:.3} s", unit.id, unit.kind, loaded.health.format);
        match &loaded.binding {
            Ok(binding) => println!("  map {}: {}", binding.map, binding.why),
            Err(reason) => println!("  no map: {reason}"),
        }
        for channel in loaded.binding.iter().flat_map(|b| &b.channels) {
            println!("  {}: {} of {} rows of {}", channel.name, channel.used, channel.rows, channel.source.topic);
        }
        if let Some(tie) = &loaded.health.utc {
            println!("  UTC: {tie:?}");
        }
        for n in loaded.flight.notices.iter() {
            println!("    {:?} {} {} x{}: {}", n.severity, n.code, n.place, n.count, n.text);
        }
    }
    Ok(())
}
