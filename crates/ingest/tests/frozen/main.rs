//! Frozen results: a hash of everything that is read from intact logs, and what damaged ones must keep.
//!
//! A refactoring of a reader keeps every hash. `FLIGHTLAG_BLESS=1` accepts new ones: read the
//! diff first, and raise the analysis version if numbers changed.

mod damage;
mod fingerprint;

use crate::fingerprint::fingerprint;
use ingest::{FlightUnit, MapLibrary, discover};
use rayon::prelude::*;
use simulate::{Container, FlightSettings, SensorSettings, SimulatedFlight, seeds};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A flight of 20 s with noise, so that no two values are alike.
pub fn flight() -> SimulatedFlight {
    let position = SensorSettings { delay_s: 0.4, white_std: 0.3, ..SensorSettings::clean(5.0) };
    let velocity = SensorSettings { white_std: 0.1, ..SensorSettings::clean(100.0) };
    simulate::simulate(&FlightSettings { duration_s: 20.0, position, velocity, ..FlightSettings::default() }).unwrap()
}

/// Writes the files of a log to a folder and finds the flight in it.
pub fn written(container: Container, simulated: &SimulatedFlight, folder: &Path) -> FlightUnit {
    for file in container.files(simulated, "flight").unwrap() {
        let path = folder.join(&file.path);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, &file.bytes).unwrap();
    }
    let found = discover(folder, &MapLibrary::shipped().unwrap()).unwrap();
    assert_eq!(found.units.len(), 1, "{container:?}: {found:?}");
    found.units.into_iter().next().unwrap()
}

/// Compares what was found with the lines of a file, which may be of more logs, or writes them with `FLIGHTLAG_BLESS=1`.
fn compare(name: &str, found: &BTreeMap<String, String>) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/frozen").join(name);
    let text = std::fs::read_to_string(&path).unwrap_or_default();
    let lines = text.lines().map(|line| line.split_at(line.find(" ./").unwrap()));
    let mut frozen: BTreeMap<&str, &str> = lines.map(|(print, id)| (&id[1..], print)).collect();
    if std::env::var_os("FLIGHTLAG_BLESS").is_some() {
        frozen.extend(found.iter().map(|(id, print)| (id.as_str(), print.as_str())));
        let text: String = frozen.iter().map(|(id, print)| format!("{print} {id}\n")).collect();
        std::fs::write(&path, text).unwrap();
    }
    let changed: Vec<String> = found
        .iter()
        .filter(|(id, print)| frozen.get(id.as_str()).is_none_or(|frozen| !fingerprint::keeps(frozen, print)))
        .map(|(id, print)| format!("{id}: {print}, frozen as {:?}", frozen.get(id.as_str())))
        .collect();
    assert!(changed.is_empty(), "{} logs differ from those frozen in {name}:\n{}", changed.len(), changed.join("\n"));
}

#[test]
fn every_simulated_container_matches_its_frozen_result() {
    let simulated = flight();
    let seeds = seeds().unwrap();
    let of = |seed: &simulate::Seed| {
        let folder = tempfile::tempdir().unwrap();
        let unit = written(seed.container, &simulated, folder.path());
        (format!("./{}", seed.name), fingerprint(&unit))
    };
    compare("simulated.txt", &seeds.par_iter().map(of).collect());
}

/// Every flight below the folder of real logs that is of this size.
fn real(is_wanted: impl Fn(u64) -> bool) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/logs");
    if !root.exists() {
        // Straight to standard error: the test runner hides what a passing test prints.
        let _ = std::io::Write::write_all(&mut std::io::stderr(), b"skipped: the folder of real logs is absent\n");
        return;
    }
    let size = |file: &PathBuf| std::fs::metadata(file).map_or(0, |about| about.len());
    let units = discover(&root, &MapLibrary::shipped().unwrap()).unwrap().units;
    let wanted: Vec<FlightUnit> =
        units.into_iter().filter(|unit| is_wanted(unit.files.iter().map(size).sum())).collect();
    assert!(!wanted.is_empty());
    compare("real.txt", &wanted.par_iter().map(|unit| (format!("./{}", unit.id), fingerprint(unit))).collect());
}

/// Logs up to this size are read in the normal suite, bytes.
const SMALL: u64 = 50_000;

#[test]
fn every_small_real_log_matches_its_frozen_result() {
    real(|size| size <= SMALL);
}

#[test]
#[ignore = "about 100 MB of logs, minutes in a debug build: cargo test -p flightlag-ingest --test frozen -- --ignored"]
fn every_large_real_log_matches_its_frozen_result() {
    real(|size| size > SMALL);
}
