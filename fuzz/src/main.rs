//! One binary with a target for each parser. `FLIGHTLAG_FUZZ` selects the one to run.
//!
//! A target panics where a promise is broken: a panic of the parser itself, bytes without a fate, an arithmetic
//! overflow. libFuzzer monitors time and memory.

#![no_main]

mod log;
mod text;

use ingest::LogKind;
use libfuzzer_sys::fuzz_target;
use std::sync::LazyLock;

/// What a target does with its input.
type Target = Box<dyn Fn(&[u8]) + Send + Sync>;

static CHOSEN: LazyLock<Target> = LazyLock::new(|| {
    let name = std::env::var("FLIGHTLAG_FUZZ").expect("FLIGHTLAG_FUZZ names the target");
    target(&name).unwrap_or_else(|| panic!("there is no target {name}"))
});

fuzz_target!(|data: &[u8]| CHOSEN(data));

fn target(name: &str) -> Option<Target> {
    Some(match name {
        "mcap" => log::of(LogKind::Mcap),
        "bag" => log::of(LogKind::Bag),
        "db3" => log::of(LogKind::Db3),
        "bag-folder" => log::bag_folder(),
        "ulog" => log::of(LogKind::Ulog),
        "dataflash" => log::of(LogKind::DataFlash),
        "csv" => log::of(LogKind::Csv),
        "tlog" => log::of(LogKind::Tlog),
        "ubx" => log::of(LogKind::Ubx),
        "nmea" => log::of(LogKind::Nmea),
        "flight" => log::whole(),
        "definition" => log::definition(),
        "channel-map" => Box::new(text::channel_map),
        "rig" => Box::new(text::rig),
        "card" => Box::new(text::card),
        #[cfg(feature = "pipeline")]
        "pipeline" => Box::new(text::pipeline),
        #[cfg(feature = "pipeline")]
        "criteria" => Box::new(text::criteria),
        _ => return None,
    })
}
