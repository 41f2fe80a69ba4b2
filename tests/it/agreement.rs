//! One flight gives the same channels in every container.

use flight::{Channel, Flight, Stamp, StampKind};
use ingest::{Limits, Loaded, MapLibrary, ReadContext};
use simulate::{
    BagCompression, BagSettings, Container, Db3Compression, Db3Layout, Db3Settings, FlightSettings, LogFile,
    McapCompression, McapEncoding, McapSettings, SensorSettings, SimulatedFlight,
};
use std::fs;
use std::sync::atomic::AtomicBool;

/// With noise, so that no two values are equal, and a climb, so that all components move.
fn flight() -> SimulatedFlight {
    let position = SensorSettings { delay_s: 0.4, white_std: 0.3, ..SensorSettings::clean(5.0) };
    let velocity = SensorSettings { white_std: 0.1, ..SensorSettings::clean(100.0) };
    simulate::simulate(&FlightSettings { duration_s: 20.0, position, velocity, ..FlightSettings::default() }).unwrap()
}

/// All containers that preserve every timestamp of every topic.
pub fn containers() -> Vec<Container> {
    use {BagCompression as B, McapCompression as C, McapEncoding as E};
    let mcap = |encoding, compression, summary| Container::Mcap(McapSettings { encoding, compression, summary });
    let mut all = vec![Container::CsvFolder];
    for encoding in [E::Ros1, E::Cdr, E::Idl, E::Json, E::Protobuf] {
        for compression in [C::None, C::Lz4, C::Zstd, C::Unchunked] {
            all.extend([true, false].map(|summary| mcap(encoding, compression, summary)));
        }
    }
    for compression in [B::None, B::Bz2, B::Lz4Independent, B::Lz4Linked] {
        all.extend([true, false].map(|indexed| Container::Bag(BagSettings { compression, indexed })));
    }
    for compression in [Db3Compression::None, Db3Compression::ZstdMessages, Db3Compression::ZstdFile] {
        for layout in [Db3Layout::Bare, Db3Layout::Folder(1), Db3Layout::Folder(3)] {
            let db3 = |definitions| Container::Db3(Db3Settings { compression, layout, definitions });
            all.extend([true, false].map(db3));
        }
    }
    all
}

fn through(container: Container, simulated: &SimulatedFlight) -> Loaded {
    read_back(&container.files(simulated, "flight").unwrap(), &format!("{container:?}"))
}

/// Writes the files of a log, discovers it and reads it, as a campaign does. `what` is for messages.
pub fn read_back(files: &[LogFile], what: &str) -> Loaded {
    let folder = tempfile::tempdir().unwrap();
    for file in files {
        let path = folder.path().join(&file.path);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, &file.bytes).unwrap();
    }
    let library = MapLibrary::shipped().unwrap();
    let found = ingest::discover(folder.path(), &library).unwrap();
    assert_eq!((found.units.len(), found.ignored.len()), (1, 0), "{what}: {found:?}");
    let cancel = AtomicBool::new(false);
    let context = ReadContext { limits: Limits::default(), cancel: &cancel, on_bytes: &|_| () };
    ingest::load(&found.units[0], &library, None, &context).unwrap_or_else(|e| panic!("{what}: {e}"))
}

/// Everything measured in a channel: timestamps, and values as bits.
pub type Measured = (Vec<Stamp>, Vec<Vec<u64>>, Vec<bool>, Option<Vec<Stamp>>);

fn measured(channel: &Channel) -> Measured {
    let bits = channel.series.components().iter().map(|values| values.iter().map(|v| v.to_bits()).collect()).collect();
    let logged = channel.other_stamps.iter().find(|(kind, ..)| *kind == StampKind::Logged).map(|(.., s)| s.clone());
    (channel.series.timeline().stamps().to_vec(), bits, channel.held.clone(), logged)
}

pub fn channels(flight: &Flight) -> Vec<(&str, Measured)> {
    flight.channels.iter().map(|(name, channel)| (name.as_str(), measured(channel))).collect()
}

#[test]
fn one_flight_in_every_container_gives_the_same_channels_bit_for_bit() {
    let simulated = flight();
    let truth = simulated.to_flight().unwrap();
    for container in containers() {
        let loaded = through(container, &simulated);
        let names: Vec<&String> = loaded.flight.channels.keys().collect();
        assert_eq!(names, ["position.gps", "position.truth", "velocity.gps"], "{container:?}: {:?}", loaded.binding);
        for (ours, theirs) in channels(&loaded.flight).into_iter().zip(channels(&truth)) {
            assert!(ours == theirs, "{container:?}: {} differs from what was simulated", ours.0);
        }
    }
}

#[test]
fn every_byte_of_an_intact_log_is_accounted_for_without_damage() {
    let simulated = flight();
    for container in containers().into_iter().chain([Container::CsvWide]) {
        let health = through(container, &simulated).health;
        let bytes = &health.bytes;
        // Compressed containers are accounted for by their unpacked bytes.
        let packed = Db3Compression::ZstdFile;
        let size = match container {
            Container::Db3(Db3Settings { compression, .. }) if compression == packed => bytes.size,
            _ => container.files(&simulated, "flight").unwrap().iter().map(|f| f.bytes.len() as u64).sum(),
        };
        assert_eq!((bytes.size, bytes.damaged), (size, 0), "{container:?}: {:?}", health.damage);
        assert_eq!(bytes.decoded + bytes.skipped + bytes.structure, size, "{container:?}: {bytes:?}");
        assert!(bytes.decoded > size / 2, "{container:?}: {bytes:?}");
    }
}

#[test]
fn a_wide_table_gives_the_velocity_bit_for_bit_and_marks_the_held_positions() {
    let simulated = flight();
    let loaded = through(Container::CsvWide, &simulated);
    let held = simulated.to_held_flight().unwrap();
    for name in ["position.gps", "velocity.gps", "position.truth"] {
        let (stamps, bits, repeats, _) = measured(&loaded.flight.channels[name]);
        let (true_stamps, true_bits, true_repeats, _) = measured(&held.channels[name]);
        assert_eq!(stamps, true_stamps, "{name}");
        assert!(bits == true_bits, "{name}");
        assert_eq!(repeats, true_repeats, "{name}");
    }
}

#[test]
fn the_demo_has_twelve_flights_and_only_the_truncated_one_lost_data() {
    let folder = crate::shared::demo().join("demo/flights");
    let truth = std::fs::read(folder.join(simulate::TRUTH_FILE)).unwrap();
    let manifest: simulate::DemoManifest = serde_json::from_slice(&truth).unwrap();
    let library = MapLibrary::shipped().unwrap();
    let found = ingest::discover(&folder, &library).unwrap();
    let ids: Vec<&str> = found.units.iter().map(|unit| unit.id.as_str()).collect();
    assert_eq!(ids, manifest.flights.iter().map(|flight| flight.path.as_str()).collect::<Vec<_>>());
    assert_eq!(found.ignored.iter().map(|(path, _)| path.as_str()).collect::<Vec<_>>(), [simulate::TRUTH_FILE]);
    let cancel = AtomicBool::new(false);
    let context = ReadContext { limits: Limits::default(), cancel: &cancel, on_bytes: &|_| () };
    for (unit, truth) in found.units.iter().zip(&manifest.flights) {
        let loaded = ingest::load(unit, &library, None, &context).unwrap();
        assert!(loaded.binding.is_ok(), "{}: {:?}", unit.id, loaded.binding);
        assert_eq!(loaded.flight.notices.any_loss(), truth.kept_share.is_some(), "{}", unit.id);
        // The cut loses the chunk it falls into: one of about thirty, so up to 0.04 more than its share.
        let velocity = &loaded.flight.channels["velocity.gps"].series;
        let gaps: f64 = truth.velocity.gaps.iter().map(|gap| gap.to_s - gap.from_s).sum();
        let whole = (truth.duration_s - gaps) * truth.velocity.rate_hz;
        let share = velocity.len() as f64 / whole;
        assert!((share - truth.kept_share.unwrap_or(1.0)).abs() < 0.05, "{}: {share}", unit.id);
    }
}
