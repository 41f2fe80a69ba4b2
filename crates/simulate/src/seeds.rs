//! One tiny flight in every container: the start of damage tests and fuzzers.

use crate::error::SimulateError;
use crate::sensor::SensorSettings;
use crate::simulated::{FlightSettings, SimulatedFlight, simulate};
use crate::write::{
    BagCompression, BagSettings, Container, Db3Compression, Db3Layout, Db3Settings, LogFile, McapCompression,
    McapEncoding, McapSettings,
};
use flight::Stamp;

/// A tiny log.
#[derive(Debug, Clone)]
pub struct Seed {
    /// Name, usable as a file name.
    pub name: &'static str,
    /// Its format.
    pub container: Container,
    /// Its files.
    pub files: Vec<LogFile>,
}

/// 1.2 s of circuit: 3 late positions, 13 velocities, 7 true positions and a note.
///
/// # Errors
/// Never; the settings are valid.
pub fn tiny_flight() -> Result<SimulatedFlight, SimulateError> {
    simulate(&FlightSettings {
        duration_s: 1.2,
        start: Stamp(1_777_852_800_000_000_000),
        position: SensorSettings { delay_s: 0.4, white_std: 0.3, ..SensorSettings::clean(2.0) },
        velocity: SensorSettings::clean(10.0),
        truth_rate_hz: Some(5.0),
        ..FlightSettings::default()
    })
}

/// The tiny flight in every container, with file names that start with the seed's name.
///
/// # Errors
/// As [`Container::files`].
pub fn seeds() -> Result<Vec<Seed>, SimulateError> {
    let flight = tiny_flight()?;
    let seed = |(name, container): (&'static str, Container)| {
        Ok(Seed { name, container, files: container.files(&flight, name)? })
    };
    containers().into_iter().map(seed).collect()
}

/// Every container, with a name usable as a file name.
fn containers() -> [(&'static str, Container); 26] {
    use {BagCompression as B, Db3Compression as D, Db3Layout as L, McapCompression as C, McapEncoding as E};
    let mcap = |encoding, compression, summary| Container::Mcap(McapSettings { encoding, compression, summary });
    let bag = |compression, indexed| Container::Bag(BagSettings { compression, indexed });
    let db3 = |compression, layout| Container::Db3(Db3Settings { compression, layout, definitions: true });
    [
        ("mcap-cdr-zstd", mcap(E::Cdr, C::Zstd, true)),
        ("mcap-cdr-lz4", mcap(E::Cdr, C::Lz4, true)),
        ("mcap-cdr-none", mcap(E::Cdr, C::None, true)),
        ("mcap-cdr-unindexed", mcap(E::Cdr, C::None, false)),
        ("mcap-cdr-unchunked", mcap(E::Cdr, C::Unchunked, true)),
        ("mcap-ros1-none", mcap(E::Ros1, C::None, true)),
        ("mcap-idl-none", mcap(E::Idl, C::None, true)),
        ("mcap-json-none", mcap(E::Json, C::None, true)),
        ("mcap-protobuf-none", mcap(E::Protobuf, C::None, true)),
        ("bag-none", bag(B::None, true)),
        ("bag-unindexed", bag(B::None, false)),
        ("bag-bz2", bag(B::Bz2, true)),
        ("bag-lz4-independent", bag(B::Lz4Independent, true)),
        ("bag-lz4-linked", bag(B::Lz4Linked, true)),
        ("db3-bare", db3(D::None, L::Bare)),
        ("db3-zstd-messages", db3(D::ZstdMessages, L::Bare)),
        ("db3-zstd-file", db3(D::ZstdFile, L::Folder(1))),
        ("db3-folder", db3(D::None, L::Folder(1))),
        ("ulog", Container::Ulog),
        ("dataflash-binary", Container::DataFlash),
        ("dataflash-text", Container::DataFlashText),
        ("tlog", Container::Tlog),
        ("ubx", Container::Ubx),
        ("nmea", Container::Nmea),
        ("csv-wide", Container::CsvWide),
        ("csv-folder", Container::CsvFolder),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seeds_are_small_and_have_unique_names() {
        let seeds = seeds().unwrap();
        let names: std::collections::BTreeSet<_> = seeds.iter().map(|seed| seed.name).collect();
        assert_eq!(names.len(), seeds.len());
        for seed in seeds {
            let bytes: usize = seed.files.iter().map(|file| file.bytes.len()).sum();
            assert!((100..64 << 10).contains(&bytes), "{}: {bytes} bytes", seed.name);
        }
    }
}
