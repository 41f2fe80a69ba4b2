//! Logs that shrink, grow, are replaced or vanish while they are read: the length at the start is read, missing
//! bytes are damage, and a flight is never made of mixed contents.

use crate::lab::kind_of;
use ingest::{FlightUnit, Limits, Log, LogError, MapLibrary, ReadContext, Selection, TopicInfo};
use simulate::{Container, FlightSettings, SensorSettings, SimulatedFlight, simulate};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

/// Long enough to be read in several steps.
fn flight() -> SimulatedFlight {
    let settings =
        FlightSettings { duration_s: 15.0, velocity: SensorSettings::clean(200.0), ..FlightSettings::default() };
    simulate(&settings).unwrap()
}

struct Moving {
    _folder: tempfile::TempDir,
    unit: FlightUnit,
    /// The file that is changed, and its bytes.
    path: PathBuf,
    bytes: Vec<u8>,
}

impl Moving {
    fn of(container: Container, flight: &SimulatedFlight) -> Moving {
        let folder = tempfile::tempdir().unwrap();
        let mut files = vec![];
        for file in container.files(flight, "log").unwrap() {
            let path = folder.path().join(&file.path);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(&path, &file.bytes).unwrap();
            files.push((path, file.bytes));
        }
        let unit = FlightUnit {
            id: "moving".into(),
            files: files.iter().map(|(path, _)| path.clone()).collect(),
            kind: kind_of(container),
        };
        let (path, bytes) = files.into_iter().max_by_key(|(_, bytes)| bytes.len()).unwrap();
        Moving { _folder: folder, unit, path, bytes }
    }

    /// Acts at the first step of reading. Returns what was read, and whether there was a step.
    fn while_read<T>(&self, act: fn(&Moving), read: impl FnOnce(&ReadContext<'_>) -> T) -> (T, bool) {
        let (cancel, acted) = (AtomicBool::new(false), AtomicBool::new(false));
        let on_bytes = |_| {
            if !acted.swap(true, Ordering::Relaxed) {
                act(self);
            }
        };
        let read = read(&ReadContext { limits: Limits::default(), cancel: &cancel, on_bytes: &on_bytes });
        std::fs::write(&self.path, &self.bytes).unwrap();
        (read, acted.into_inner())
    }

    fn read(&self, act: fn(&Moving)) -> Result<Log, LogError> {
        self.while_read(act, |context| ingest::read(&self.unit, &|_: &TopicInfo| Selection::All, context)).0
    }
}

fn cut(path: &Path, to: u64) {
    File::options().write(true).open(path).unwrap().set_len(to).unwrap();
}

/// Replaces it by another file of the same size and time, like a copy that preserves times.
fn replace(log: &Moving) {
    let other = log.path.with_extension("other");
    std::fs::write(&other, vec![b'7'; log.bytes.len()]).unwrap();
    let time = std::fs::metadata(&log.path).unwrap().modified().unwrap();
    File::options().write(true).open(&other).unwrap().set_modified(time).unwrap();
    std::fs::rename(&other, &log.path).unwrap();
}

type Act = (&'static str, fn(&Moving));

const ACTS: [Act; 5] = [
    ("shrinks", |log| cut(&log.path, log.bytes.len() as u64 / 2)),
    ("is emptied", |log| cut(&log.path, 0)),
    ("grows", |log| std::fs::write(&log.path, [&log.bytes[..], &log.bytes[..1000]].concat()).unwrap()),
    ("is replaced", replace),
    ("vanishes", |log| std::fs::remove_file(&log.path).unwrap()),
];

#[test]
fn a_log_changed_while_read_makes_no_flight_and_loses_no_byte_silently() {
    let flight = flight();
    let library = MapLibrary::shipped().unwrap();
    for seed in simulate::seeds().unwrap() {
        let log = Moving::of(seed.container, &flight);
        let intact = log.read(|_| ()).unwrap();
        for (what, act) in ACTS {
            let case = format!("{} {what}", seed.name);
            let (loaded, acted) = log.while_read(act, |context| ingest::load(&log.unit, &library, None, context));
            assert!(acted, "{case}: no step");
            let error = loaded.map(|_| ()).expect_err(&case).to_string();
            assert!(error.contains(log.path.file_name().unwrap().to_str().unwrap()), "{case}: {error}");
            // A second open by name reads the other file whole: only the flight is rejected.
            let Some(read) = (what != "is replaced").then(|| log.read(act).ok()).flatten() else { continue };
            let b = &read.health.bytes;
            // For a packed log the unpacked bytes are counted.
            let is_packed = read.health.format.contains(", in ");
            assert_eq!(b.sum(), b.size, "{case}: {b:?}");
            assert!(is_packed || b.size == intact.health.bytes.size, "{case}: {b:?}");
            let lost = b.damaged + b.tail_cut > intact.health.bytes.damaged || read.notices.any_loss();
            assert!(read.tables == intact.tables || lost, "{case}: different rows, but no loss reported");
        }
    }
}
