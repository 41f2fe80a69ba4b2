//! T1: logs that end too early, wherever that is.

use crate::lab::{Lab, seeds};
use crate::verdict::{first_foreign_row, told};
use simulate::{BagSettings, Container, Seed};

/// In the normal suite every so-manieth cut is tried, in file order, and all of the last hundred.
fn a_cut_log_gives_the_beginning_of_the_whole_one_and_says_so(family: &str, step: usize) {
    for seed in seeds(family) {
        (0..seed.files.len()).for_each(|damaged| cut(&seed, damaged, step));
    }
}

fn cut(seed: &Seed, damaged: usize, step: usize) {
    let mut lab = Lab::new();
    let subject = lab.seed(seed, damaged);
    let bytes = &seed.files[damaged].bytes;
    let intact = lab.read(&subject, bytes, seed.name).unwrap();
    let ends = Ends::of(seed, damaged);
    let last = bytes.len().saturating_sub(100);
    let mut silent = vec![];
    for length in (0..last).step_by(step).chain(last..bytes.len()) {
        let case = format!("{}, file {damaged} cut to {length} of {} bytes", seed.name, bytes.len());
        let read = lab.read(&subject, &bytes[..length], &case);
        if let Ok(log) = &read {
            assert_eq!(first_foreign_row(log, &intact), None, "{case}");
        }
        if !told(&read, &intact) && !ends.allow(length) {
            silent.push(length);
        }
    }
    println!("| {} {damaged} | {} | {} | {:?} |", seed.name, lab.cases - 1, silent.len(), lab.slowest);
    assert!(silent.is_empty(), "{}: cuts of file {damaged} that nobody hears of: {silent:?}", seed.name);
}

/// Where a log may end without anything missing: behind a whole record, where the format has no mark of its end.
enum Ends {
    Nowhere,
    At(Vec<usize>),
}

impl Ends {
    fn of(seed: &Seed, damaged: usize) -> Ends {
        let bytes = &seed.files[damaged].bytes;
        match seed.container {
            Container::Ulog => Ends::At(ulog_ends(bytes)),
            Container::DataFlash => Ends::At(dataflash_ends(bytes)),
            // A line is whole with its line end or without.
            Container::DataFlashText | Container::CsvWide | Container::CsvFolder | Container::Nmea => {
                let ends = bytes.iter().enumerate().filter(|(_, b)| **b == b'\n').map(|(at, _)| at + 1);
                Ends::At(ends.flat_map(|end| [end - 1, end]).chain([0]).collect())
            }
            Container::Ubx => Ends::At(ubx_ends(bytes)),
            Container::Tlog => Ends::At(tlog_ends(bytes)),
            // What the recorder wrote beside the log is a hint, whatever becomes of it.
            Container::Db3(_) if seed.files[damaged].path.ends_with("metadata.yaml") => Ends::At((0..bytes.len()).collect()),
            Container::Bag(BagSettings { indexed: false, .. }) => Ends::At(bag_ends(bytes)),
            Container::Mcap(_) | Container::Bag(_) | Container::Db3(_) => Ends::Nowhere,
        }
    }

    fn allow(&self, length: usize) -> bool {
        match self {
            Ends::Nowhere => false,
            Ends::At(places) => places.binary_search(&length).is_ok(),
        }
    }
}

/// Walks records of which each says its own length.
fn walk(bytes: &[u8], start: usize, mut length: impl FnMut(&[u8]) -> usize) -> Vec<usize> {
    let mut ends = vec![start];
    let mut at = start;
    while at < bytes.len() {
        at += length(&bytes[at..]);
        ends.push(at);
    }
    assert_eq!(at, bytes.len(), "the seed is whole");
    ends
}

fn ulog_ends(bytes: &[u8]) -> Vec<usize> {
    walk(bytes, 16, |rest| 3 + usize::from(u16::from_le_bytes([rest[0], rest[1]])))
}

fn dataflash_ends(bytes: &[u8]) -> Vec<usize> {
    let mut lengths = [0_usize; 256];
    lengths[128] = 89;
    let ends = walk(bytes, 0, |rest| {
        if rest[2] == 128 {
            lengths[usize::from(rest[3])] = rest[4].into();
        }
        lengths[usize::from(rest[2])]
    });
    ends
}

/// Records behind the first line and the padded header; a length before the header, another before the data.
fn bag_ends(bytes: &[u8]) -> Vec<usize> {
    let length = |rest: &[u8], at: usize| 4 + u32::from_le_bytes(rest[at..at + 4].try_into().unwrap()) as usize;
    walk(bytes, 13, |rest| length(rest, 0) + length(rest, length(rest, 0)))
}

fn ubx_ends(bytes: &[u8]) -> Vec<usize> {
    walk(bytes, 0, |rest| 8 + usize::from(u16::from_le_bytes([rest[4], rest[5]])))
}

/// A stamp of eight bytes, then a frame of MAVLink 1 or 2.
fn tlog_ends(bytes: &[u8]) -> Vec<usize> {
    walk(bytes, 0, |rest| match rest[8] {
        0xfe => 8 + 8 + usize::from(rest[9]),
        0xfd => 8 + 12 + usize::from(rest[9]) + if rest[10] & 1 == 1 { 13 } else { 0 },
        other => panic!("no frame begins with {other:x}"),
    })
}

macro_rules! of_each_format {
    ($($family:ident $name:literal $step:literal $all:ident,)*) => {$(
        #[test]
        fn $family() {
            a_cut_log_gives_the_beginning_of_the_whole_one_and_says_so($name, $step);
        }

        #[test]
        #[ignore = "every cut; `just faults`"]
        fn $all() {
            a_cut_log_gives_the_beginning_of_the_whole_one_and_says_so($name, 1);
        }
    )*};
}

of_each_format! {
    a_cut_mcap_gives_its_beginning_and_says_so "mcap" 61 every_cut_of_an_mcap,
    a_cut_bag_gives_its_beginning_and_says_so "bag" 61 every_cut_of_a_bag,
    a_cut_ros_2_bag_gives_its_beginning_and_says_so "db3" 257 every_cut_of_a_ros_2_bag,
    a_cut_ulog_gives_its_beginning_and_says_so "ulog" 7 every_cut_of_a_ulog,
    a_cut_dataflash_log_gives_its_beginning_and_says_so "dataflash" 13 every_cut_of_a_dataflash_log,
    a_cut_tlog_gives_its_beginning_and_says_so "tlog" 7 every_cut_of_a_tlog,
    a_cut_ubx_log_gives_its_beginning_and_says_so "ubx" 7 every_cut_of_a_ubx_log,
    a_cut_nmea_log_gives_its_beginning_and_says_so "nmea" 7 every_cut_of_an_nmea_log,
    a_cut_table_gives_its_beginning_and_says_so "csv" 7 every_cut_of_a_table,
}
