//! Shared by the tests of formats without an index: reading bytes, every cut and every flip.

use crate::support::*;
use ingest::{Column, Limits, Log, LogError, LogKind, Selection, Table, TopicInfo};
use simulate::{Container, FlightSettings, SensorSettings, SimulatedFlight};
use std::collections::BTreeMap;
use std::path::Path;

pub fn read(kind: LogKind, path: &Path) -> Result<Log, LogError> {
    let want = |_: &TopicInfo| Selection::All;
    read_files(Limits::default(), kind, &[path.to_owned()], &want)
}

/// Reads them; the ledger must add up.
pub fn read_bytes(kind: LogKind, bytes: &[u8]) -> Result<Log, LogError> {
    let (_folder, path) = file("log", bytes);
    let log = read(kind, &path);
    log.iter().for_each(|log| assert_balanced(log, bytes.len()));
    log
}

/// As [`read_bytes`], with these limits.
pub fn read_within(limits: Limits, kind: LogKind, bytes: &[u8]) -> Log {
    let (_folder, path) = file("log", bytes);
    let want = |_: &TopicInfo| Selection::All;
    let log = read_files(limits, kind, &[path], &want).unwrap();
    assert_balanced(&log, bytes.len());
    log
}

pub fn assert_balanced(log: &Log, size: usize) {
    let b = &log.health.bytes;
    assert_eq!(b.size, size as u64);
    assert_eq!(b.sum(), b.size, "{b:?}");
}

pub fn table<'l>(log: &'l Log, name: &str) -> &'l Table {
    log.tables.iter().find(|t| t.topic.name == name).unwrap_or_else(|| panic!("no table {name}: {:?}", log.health))
}

/// The values of a field; `None` where it is absent.
pub fn values(log: &Log, topic: &str, field: &str) -> Vec<Option<f64>> {
    let table = table(log, topic);
    let column = table.column(field).unwrap_or_else(|| panic!("no {topic}.{field}"));
    (0..table.rows).map(|row| column.number(row)).collect()
}

/// As [`values`], for a field that is never absent.
pub fn numbers(log: &Log, topic: &str, field: &str) -> Vec<f64> {
    values(log, topic, field).into_iter().map(Option::unwrap).collect()
}

pub fn messages(log: &Log, topic: &str) -> u64 {
    log.health.topics.iter().find(|t| t.name == topic).map_or(0, |t| t.messages)
}

pub fn codes(log: &Log) -> Vec<&str> {
    log.notices.iter().map(|n| n.code.as_str()).collect()
}

/// Noise, so that no two values are alike.
pub fn flight(duration_s: f64, velocity_hz: f64) -> SimulatedFlight {
    let position = SensorSettings { delay_s: 0.4, white_std: 0.3, ..SensorSettings::clean(5.0) };
    let velocity = SensorSettings { white_std: 0.1, ..SensorSettings::clean(velocity_hz) };
    simulate::simulate(&FlightSettings { duration_s, position, velocity, ..FlightSettings::default() }).unwrap()
}

/// A tiny flight.
pub fn seed(container: Container) -> Vec<u8> {
    container.files(&flight(0.5, 10.0), "seed").unwrap().remove(0).bytes
}

/// Rows of all topics as text.
pub fn rows(log: &Log) -> BTreeMap<String, Vec<String>> {
    let cell = |row: usize, column: &Column| match (column.number(row), column.text(row)) {
        (Some(number), _) => format!("{}={:x} ", column.path, number.to_bits()),
        (_, Some(text)) => format!("{}={text} ", column.path),
        _ => String::new(),
    };
    let of = |table: &Table| (0..table.rows).map(|row| table.columns.iter().map(|c| cell(row, c)).collect()).collect();
    log.tables.iter().map(|t| (t.topic.name.clone(), of(t))).collect()
}

/// Rows of `a` that are not in `b`.
pub fn missing(a: &BTreeMap<String, Vec<String>>, b: &BTreeMap<String, Vec<String>>) -> usize {
    let lacks = |(topic, rows): (&String, &Vec<String>)| {
        let others = b.get(topic).map(Vec::as_slice).unwrap_or_default();
        rows.iter().filter(|row| !others.contains(row)).count()
    };
    a.iter().map(lacks).sum()
}

/// Cuts the bytes to each of these lengths. The messages with `ends` before the cut must then be read, with
/// their values; a cut is damage, or a cut tail, unless it is `between` messages.
pub fn check_cuts(
    kind: LogKind,
    bytes: &[u8],
    lengths: impl DoubleEndedIterator<Item = usize>,
    ends: &[usize],
    between: impl Fn(usize) -> bool,
) {
    let whole = rows(&read_bytes(kind, bytes).unwrap());
    let (_folder, path) = file("log", bytes);
    let handle = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
    for length in lengths.rev() {
        handle.set_len(length as u64).unwrap();
        let intact = ends.iter().filter(|end| (1..=length).contains(*end)).count();
        let Ok(log) = read(kind, &path) else {
            assert_eq!(intact, 0, "{length} bytes give nothing");
            continue;
        };
        assert_balanced(&log, length);
        assert_eq!(log.health.messages, intact as u64, "{length}");
        let lacking = log.health.bytes.damaged + log.health.bytes.tail_cut;
        assert_eq!(lacking == 0, between(length), "{length}: {:?}", log.health.damage);
        for (topic, rows) in rows(&log) {
            assert_eq!(rows, whole[&topic][..rows.len()], "{length}: {topic}");
        }
    }
}

/// This many bits of each byte: byte offsets and bit numbers.
pub fn bits(places: impl IntoIterator<Item = usize>, of_each: usize) -> impl Iterator<Item = (usize, usize)> {
    places.into_iter().flat_map(move |place| (0..of_each).map(move |i| (place, (place + 5 * i) % 8)))
}

/// Flips bits one at a time and passes the result of reading to `check`, with byte and bit.
pub fn each_flip(
    kind: LogKind,
    bytes: &[u8],
    flips: impl Iterator<Item = (usize, usize)>,
    mut check: impl FnMut(&Log, usize, usize),
) {
    let (_folder, path) = file("log", bytes);
    let handle = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
    for (place, bit) in flips {
        crate::made::write_at(&handle, &[bytes[place] ^ 1 << bit], place as u64);
        let log = read(kind, &path).unwrap();
        assert_balanced(&log, bytes.len());
        check(&log, place, bit);
        crate::made::write_at(&handle, &[bytes[place]], place as u64);
    }
}

/// What is no log of any kind is refused with the reason; that of a letter is the format's own.
pub fn check_refusals(kind: LogKind, of_a_letter: &str) {
    for (bytes, reason) in [
        (&b""[..], "empty"),
        (&[0; 5000], "zero bytes"),
        (&[0x17; 5000], "nothing in the file is intact"),
        (b"a letter to a friend, in which nothing is measured at all", of_a_letter),
    ] {
        let error = read_bytes(kind, bytes).unwrap_err().to_string();
        assert!(error.contains(reason), "{error}");
    }
}

/// The bytes of hexadecimal digits; other characters are skipped.
pub fn bytes_of(text: &str) -> Vec<u8> {
    let digits: Vec<u32> = text.chars().filter_map(|c| c.to_digit(16)).collect();
    digits.chunks(2).map(|pair| (pair[0] << 4 | pair[1]) as u8).collect()
}

/// The flight in this container, found by its content and bound by this map.
pub fn load_written(
    container: Container,
    flight: &SimulatedFlight,
    name: &str,
    kind: LogKind,
    map: &str,
) -> ingest::Loaded {
    let bytes = container.files(flight, "flight").unwrap().remove(0).bytes;
    let (folder, _path) = file(name, &bytes);
    let found = ingest::discover(folder.path(), &ingest::MapLibrary::shipped().unwrap()).unwrap();
    assert_eq!((found.units.len(), found.units[0].kind), (1, kind), "{found:?}");
    let loaded = load(&found.units[0]).unwrap();
    assert_ledger(&loaded);
    assert!(!lossy(&loaded), "{:?}", loaded.flight.notices);
    assert_eq!(loaded.binding.as_ref().unwrap().map, map);
    loaded
}

/// The largest error of each component of a channel and of its timestamps, ns; the amount added to `ours` makes it UTC.
pub fn worst(ours: &flight::Channel, theirs: &flight::Channel, to_utc: impl Fn(i64) -> i64) -> (Vec<f64>, u64) {
    let (ours, theirs) = (&ours.series, &theirs.series);
    assert_eq!(ours.len(), theirs.len());
    let stamps = ours.timeline().stamps().iter().zip(theirs.timeline().stamps());
    let late = stamps.map(|(a, b)| to_utc(a.0).abs_diff(b.0)).max().unwrap();
    let axis = |axis: usize| {
        let pairs = ours.component(axis).iter().zip(theirs.component(axis));
        pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    };
    ((0..3).map(axis).collect(), late)
}
