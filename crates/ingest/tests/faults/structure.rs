//! T7: files with sound parts that contradict each other: an index is never trusted over the data.

use crate::lab::{Lab, seeds};
use crate::verdict::{Verdict, first_foreign_row, first_unknown_row, is_reported, rows};
use ingest::Log;

/// Opcode and content of a record.
type Record = (u8, Vec<u8>);

const MAGIC: &[u8] = b"\x89MCAP0\r\n";
const FOOTER: u8 = 2;
const SCHEMA: u8 = 3;
const CHANNEL: u8 = 4;
const MESSAGE: u8 = 5;
const CHUNK: u8 = 6;
const MESSAGE_INDEX: u8 = 7;
const CHUNK_INDEX: u8 = 8;
const STATISTICS: u8 = 11;
const DATA_END: u8 = 15;

fn records(bytes: &[u8]) -> Vec<Record> {
    let mut rest = &bytes[8..bytes.len() - 8];
    let mut records = vec![];
    while let [opcode, tail @ ..] = rest {
        let length = u64::from_le_bytes(tail[..8].try_into().unwrap()) as usize;
        records.push((*opcode, tail[8..8 + length].to_vec()));
        rest = &tail[8 + length..];
    }
    records
}

/// The file of these records, its footer pointing at the first record after the end of the data, without checksums of
/// data and summary: so that what is wrong is only what a test makes wrong.
fn file(records: &[Record]) -> Vec<u8> {
    let mut bytes = MAGIC.to_vec();
    let mut summary = 0_u64;
    for (opcode, content) in records {
        let mut content = content.clone();
        match *opcode {
            DATA_END => content = vec![0; 4],
            FOOTER if content.len() == 20 => {
                content = [summary.to_le_bytes(), [0; 8]].concat().into_iter().chain([0; 4]).collect()
            }
            _ => {}
        }
        bytes.push(*opcode);
        bytes.extend((content.len() as u64).to_le_bytes());
        bytes.extend(content);
        if *opcode == DATA_END {
            summary = bytes.len() as u64;
        }
    }
    bytes.extend(MAGIC);
    bytes
}

fn seed(name: &str) -> Vec<Record> {
    records(&seeds(name)[0].files[0].bytes)
}

fn place(records: &[Record], opcode: u8) -> usize {
    records.iter().position(|(found, _)| *found == opcode).unwrap()
}

fn put(record: &mut Record, at: usize, value: u64) {
    record.1[at..at + 8].copy_from_slice(&value.to_le_bytes());
}

/// No loss or change of the flight, or it is reported.
fn same_or_reported(lab: &mut Lab, bytes: &[u8], intact: &Log, case: &str) {
    let seed = &seeds("mcap-cdr-none")[0];
    let subject = lab.seed(seed, 0);
    let read = lab.read(&subject, bytes, case);
    let verdict = Verdict::of(&read, intact);
    assert!([Verdict::Same, Verdict::Reported].contains(&verdict), "{case}: {verdict:?}");
    if let Ok(log) = &read {
        assert_eq!(first_foreign_row(log, intact), None, "{case}");
    }
}

fn intact(lab: &mut Lab, records: &[Record]) -> Log {
    let seed = &seeds("mcap-cdr-none")[0];
    let subject = lab.seed(seed, 0);
    let log = lab.read(&subject, &file(records), "intact").unwrap();
    assert_eq!(rows(&log), 24, "{:?}", log.notices);
    log
}

#[test]
fn a_false_index_costs_no_row() {
    let mut lab = Lab::new();
    let sound = seed("mcap-cdr-none");
    let intact = intact(&mut lab, &sound);
    let size = file(&sound).len() as u64;
    let index = place(&sound, CHUNK_INDEX);
    for value in [0, 8, 17, size / 2, size - 30, size, u64::MAX, 1 << 63] {
        for (at, field) in [(16, "offset"), (24, "length")] {
            let mut lie = sound.clone();
            put(&mut lie[index], at, value);
            same_or_reported(&mut lab, &file(&lie), &intact, &format!("chunk index with {field} {value}"));
        }
        let mut lie = file(&sound);
        let footer = lie.len() - 8 - 20;
        lie[footer..footer + 8].copy_from_slice(&value.to_le_bytes());
        same_or_reported(&mut lab, &lie, &intact, &format!("summary at {value}"));
        let mut lie = sound.clone();
        let statistics = place(&sound, STATISTICS);
        put(&mut lie[statistics], 0, value);
        same_or_reported(&mut lab, &file(&lie), &intact, &format!("statistics of {value} messages"));
        let mut lie = sound.clone();
        let messages = place(&sound, MESSAGE_INDEX);
        let entry = lie[messages].1.len() - 8;
        put(&mut lie[messages], entry, value);
        same_or_reported(&mut lab, &file(&lie), &intact, &format!("message index to {value}"));
    }
    let mut twice = sound.clone();
    twice.insert(index, sound[index].clone());
    same_or_reported(&mut lab, &file(&twice), &intact, "a chunk that is listed twice");
}

#[test]
fn misplaced_records_cost_no_row_silently() {
    let mut lab = Lab::new();
    let sound = seed("mcap-cdr-none");
    let intact = intact(&mut lab, &sound);
    let (chunk, end) = (place(&sound, CHUNK), place(&sound, DATA_END));
    let with = |at: usize, record: Record| {
        let mut records = sound.clone();
        records.insert(at, record);
        file(&records)
    };
    let inner = |record: &Record| {
        let content = [&[record.0][..], &(record.1.len() as u64).to_le_bytes(), &record.1].concat();
        let size = (content.len() as u64).to_le_bytes();
        (CHUNK, [&[0; 16][..], &size, &[0; 4], &0_u32.to_le_bytes(), &size, &content].concat())
    };
    let footer = sound[place(&sound, FOOTER)].clone();
    for (case, bytes) in [
        ("an opcode of zero", with(chunk, (0, vec![1; 30]))),
        ("an unknown opcode of the standard", with(chunk, (0x10, vec![1; 30]))),
        ("an unknown opcode of a private one", with(chunk, (0xff, vec![1; 30]))),
        ("two footers", with(end, footer.clone())),
        ("a chunk in a chunk", with(end, inner(&sound[chunk]))),
        ("an empty chunk", with(chunk, (CHUNK, vec![0; 40]))),
        ("a schema with id zero", with(chunk, (SCHEMA, vec![0; 14]))),
        ("a channel of a schema that is not there", with(chunk, (CHANNEL, [&[9, 0, 9, 0][..], &[0; 12]].concat()))),
        ("a message of no channel", with(chunk, (MESSAGE, vec![9; 40]))),
        ("garbage behind the end", [file(&sound), vec![7; 1000]].concat()),
        ("zeros behind the end", [file(&sound), vec![0; 100_000]].concat()),
        ("garbage before the beginning", [vec![7; 1000], file(&sound)].concat()),
    ] {
        same_or_reported(&mut lab, &bytes, &intact, case);
    }
    let mut reordered = sound.clone();
    let moved = reordered.remove(chunk);
    reordered.push(moved);
    same_or_reported(&mut lab, &file(&reordered), &intact, "data behind the footer");
}

#[test]
fn channels_and_messages_before_their_definitions_cost_no_row_silently() {
    let mut lab = Lab::new();
    let sound = seed("mcap-cdr-unchunked");
    let intact = intact(&mut lab, &sound);
    let end = place(&sound, DATA_END);
    for (case, order) in [("schemas last", [CHANNEL, MESSAGE, SCHEMA]), ("channels last", [SCHEMA, MESSAGE, CHANNEL])] {
        let rank = |record: &Record| order.iter().position(|opcode| *opcode == record.0).map_or(0, |rank| rank + 1);
        let mut records = sound.clone();
        records[..end].sort_by_key(rank);
        same_or_reported(&mut lab, &file(&records), &intact, case);
    }
}

#[test]
fn a_false_bag_index_costs_no_row() {
    let mut lab = Lab::new();
    for name in ["bag-none", "bag-lz4-linked"] {
        let seed = &seeds(name)[0];
        let (subject, intact) = lab.intact(seed, 0);
        let bytes = &seed.files[0].bytes;
        let size = bytes.len() as u64;
        for field in ["index_pos=", "chunk_pos=", "chunk_count=", "conn_count="] {
            let at = bytes.windows(field.len()).position(|w| w == field.as_bytes()).unwrap() + field.len();
            for value in [0, 1, 13, 4117, size / 2, size - 1, size, u64::MAX] {
                let mut lie = bytes.clone();
                let width = if field.ends_with("count=") { 4 } else { 8 };
                lie[at..at + width].copy_from_slice(&value.to_le_bytes()[..width]);
                let case = format!("{name}: {field}{value}");
                let verdict = Verdict::of(&lab.read(&subject, &lie, &case), &intact);
                assert!([Verdict::Same, Verdict::Reported].contains(&verdict), "{case}: {verdict:?}");
            }
        }
        for (case, bytes) in [
            ("garbage behind", [&bytes[..], &[7; 1000]].concat()),
            ("garbage before", [&[7; 1000], &bytes[..]].concat()),
        ] {
            let verdict = Verdict::of(&lab.read(&subject, &bytes, case), &intact);
            assert!([Verdict::Same, Verdict::Reported].contains(&verdict), "{name}, {case}: {verdict:?}");
        }
    }
}

/// Reads two logs as one file: the first is intact, and the second is damage.
fn assert_first_read(lab: &mut Lab, all: &[&str], least: usize) {
    for a in all {
        let (subject, intact) = lab.intact(&seeds(a)[0], 0);
        for b in all {
            let [first, second] = [a, b].map(|name| seeds(name)[0].files[0].bytes.clone());
            let log = lab.read(&subject, &[first, second].concat(), a).unwrap();
            assert!(rows(&log) >= rows(&intact) && log.notices.any_loss(), "{a} before {b}: {:?}", log.notices);
            assert!(log.health.bytes.damaged as usize >= least, "{a} before {b}: {:?}", log.health.bytes);
        }
    }
}

#[test]
fn an_mcap_after_another_in_one_file_is_damage() {
    let all = ["mcap-cdr-none", "mcap-cdr-zstd", "mcap-cdr-unchunked", "mcap-cdr-unindexed", "mcap-ros1-none"];
    let least = all.iter().map(|name| seeds(name)[0].files[0].bytes.len()).min().unwrap();
    assert_first_read(&mut Lab::new(), &all, least);
}

#[test]
fn the_head_of_a_bag_after_another_in_one_file_is_damage() {
    assert_first_read(&mut Lab::new(), &["bag-none", "bag-lz4-linked", "bag-bz2"], 4096);
}

#[test]
fn a_log_after_a_truncated_one_is_never_read_silently() {
    let mut lab = Lab::new();
    for name in ["mcap-cdr-zstd", "mcap-cdr-unchunked", "bag-none", "bag-lz4-linked"] {
        let seed = &seeds(name)[0];
        let (subject, intact) = lab.intact(seed, 0);
        let bytes = &seed.files[0].bytes;
        for cut in (1..bytes.len()).step_by(97) {
            let case = format!("{name} cut at {cut}");
            let both = [&bytes[..cut], bytes.as_slice()].concat();
            let read = lab.read(&subject, &both, &case);
            let Ok(log) = &read else { continue };
            assert!(log.notices.any_loss(), "{case}: {:?}", log.notices);
            assert_eq!(first_unknown_row(log, &intact), None, "{case}");
        }
    }
}

#[test]
fn a_log_after_foreign_bytes_is_read_whole() {
    let mut lab = Lab::new();
    let noise: Vec<u8> = (0..5000_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
    for name in ["mcap-cdr-none", "mcap-cdr-unchunked", "mcap-cdr-unindexed", "bag-none", "bag-unindexed", "ulog"] {
        let seed = &seeds(name)[0];
        let (subject, intact) = lab.intact(seed, 0);
        for junk in [vec![7; 1000], vec![0; 8192], noise.clone()] {
            let log = lab.read(&subject, &[junk.as_slice(), &seed.files[0].bytes].concat(), name).unwrap();
            assert_eq!((rows(&log), log.health.bytes.damaged), (rows(&intact), junk.len() as u64), "{name}");
            assert_eq!(first_unknown_row(&log, &intact), None, "{name}");
        }
    }
}

#[test]
fn an_unchunked_mcap_without_its_start_uses_its_summarys_channels() {
    let mut lab = Lab::new();
    let seed = &seeds("mcap-cdr-unchunked")[0];
    let (subject, intact) = lab.intact(seed, 0);
    let bytes = seed.files[0].bytes.as_slice();
    let messages: Vec<usize> = (0..bytes.len() - 9)
        .filter(|&at| bytes[at] == MESSAGE && bytes[at + 3..at + 9] == [0; 6] && bytes[at + 11..at + 15] == [0; 4])
        .collect();
    let first = messages[0];
    for (case, hurt, expected) in [
        ("the beginning is zero", [&vec![0; first], &bytes[first..]].concat(), 24),
        ("junk behind the magic", [MAGIC, &[9; 777], &bytes[8..]].concat(), 24),
        ("a hole", [&bytes[..first + 40], &bytes[first + 1000..]].concat(), 1),
    ] {
        let log = lab.read(&subject, &hurt, case).unwrap();
        assert!(rows(&log) >= expected && log.notices.any_loss(), "{case}: {} rows, {:?}", rows(&log), log.notices);
        assert_eq!(first_unknown_row(&log, &intact), None, "{case}");
    }
}

#[test]
fn a_file_without_its_first_blocks_is_read_from_there_on() {
    let mut lab = Lab::new();
    for (name, fewest) in [("mcap-cdr-none", 0), ("mcap-cdr-unchunked", 20), ("bag-none", 20), ("db3-bare", 0)] {
        let seed = &seeds(name)[0];
        let (subject, intact) = lab.intact(seed, 0);
        let mut bytes = seed.files[0].bytes.clone();
        bytes[..4096].fill(0);
        let read = lab.read(&subject, &bytes, name);
        let found = read.as_ref().map_or(0, rows);
        assert!(found >= fewest && is_reported(&read, &intact), "{name}: {found} rows, {:?}", read.map(|l| l.notices));
    }
}

#[test]
fn an_empty_or_foreign_part_of_a_recording_costs_only_itself() {
    let mut lab = Lab::new();
    for (name, ending) in [("db3-bare", "db3"), ("mcap-cdr-zstd", "mcap")] {
        let seed = &seeds(name)[0];
        let (_, intact) = lab.intact(seed, 0);
        let names = [0, 1].map(|number| format!("b_{number}.{ending}"));
        let page = b"<!DOCTYPE html><html><body>404 not found</body></html>\n".to_vec();
        for bad in [vec![], vec![0; 5000], page] {
            for damaged in [0, 1] {
                let mut files = names.each_ref().map(|name| (name.as_str(), seed.files[0].bytes.as_slice()));
                files[damaged].1 = &[];
                let subject = lab.subject(crate::lab::kind_of(seed.container), &files, damaged);
                let log = lab.read(&subject, &bad, name).unwrap();
                assert_eq!((rows(&log), log.health.bytes.damaged), (rows(&intact), bad.len() as u64), "{name}");
                assert!(log.notices.any_loss(), "{name}: {:?}", log.notices);
            }
        }
    }
}
