//! T1, T2 and T4 through a packing: losses and changes in a packed file are reported for any format inside.

use crate::lab::{Lab, kind_of, seeds};
use crate::verdict::{Verdict, first_foreign_row};
use simulate::Seed;
use std::io::Write;

/// A file packed with a checksum of its content.
fn packed(ending: &str, content: &[u8]) -> Vec<u8> {
    match ending {
        "gz" => {
            let mut encoder = flate2::write::GzEncoder::new(vec![], flate2::Compression::default());
            encoder.write_all(content).unwrap();
            encoder.finish().unwrap()
        }
        "zst" => {
            let mut encoder = zstd::stream::Encoder::new(vec![], 3).unwrap();
            encoder.include_checksum(true).unwrap();
            encoder.write_all(content).unwrap();
            encoder.finish().unwrap()
        }
        "lz4" => {
            let mut encoder =
                lz4::EncoderBuilder::new().checksum(lz4::ContentChecksum::ChecksumEnabled).build(vec![]).unwrap();
            encoder.write_all(content).unwrap();
            encoder.finish().0
        }
        _ => {
            let mut encoder = bzip2::write::BzEncoder::new(vec![], bzip2::Compression::best());
            encoder.write_all(content).unwrap();
            encoder.finish().unwrap()
        }
    }
}

const PACKINGS: [&str; 4] = ["gz", "zst", "lz4", "bz2"];

/// Each case of each packing of two small seeds: one of binary records, one of text.
fn each(mut check: impl FnMut(&mut Lab, &Seed, &str, &[u8])) {
    for family in ["ulog", "nmea"] {
        let seed = &seeds(family)[0];
        for ending in PACKINGS {
            let mut lab = Lab::new();
            check(&mut lab, seed, ending, &packed(ending, &seed.files[0].bytes));
        }
    }
}

#[test]
fn a_truncated_packed_log_is_reported() {
    each(|lab, seed, ending, whole| {
        let subject = lab.single(kind_of(seed.container), &format!("log.{ending}"));
        let intact = lab.read(&subject, whole, ending).unwrap();
        for length in (4..whole.len()).step_by(11).chain(whole.len() - 20..whole.len()) {
            let case = format!("{}.{ending} cut to {length} of {}", seed.name, whole.len());
            let read = lab.read(&subject, &whole[..length], &case);
            assert_eq!(Verdict::of(&read, &intact), Verdict::Reported, "{case}");
            if let Ok(log) = &read {
                assert_eq!(first_foreign_row(log, &intact), None, "{case}");
            }
        }
    });
}

#[test]
fn a_flipped_bit_in_a_packed_log_changes_nothing_silently() {
    each(|lab, seed, ending, whole| {
        let subject = lab.single(kind_of(seed.container), &format!("log.{ending}"));
        let intact = lab.read(&subject, whole, ending).unwrap();
        let mut bytes = whole.to_vec();
        for bit in (0..8 * bytes.len()).step_by(37) {
            let case = format!("{}.{ending}, bit {} of byte {}", seed.name, bit % 8, bit / 8);
            bytes[bit / 8] ^= 1 << (bit % 8);
            let verdict = Verdict::of(&lab.read(&subject, &bytes, &case), &intact);
            bytes[bit / 8] ^= 1 << (bit % 8);
            assert!([Verdict::Same, Verdict::Reported].contains(&verdict), "{case}: {verdict:?}");
        }
    });
}

#[test]
fn hostile_numbers_in_a_packed_log_take_little_memory() {
    each(|lab, seed, ending, whole| {
        let subject = lab.single(kind_of(seed.container), &format!("log.{ending}"));
        let mut bytes = whole.to_vec();
        for at in (0..bytes.len() - 8).step_by(7) {
            for value in [0, u32::MAX.into(), 1 << 62, u64::MAX] {
                let kept: Vec<u8> = bytes[at..at + 8].to_vec();
                bytes[at..at + 8].copy_from_slice(&u64::to_le_bytes(value));
                let _ = lab.read(&subject, &bytes, &format!("{}.{ending}: {value:#x} at {at}", seed.name));
                bytes[at..at + 8].copy_from_slice(&kept);
            }
        }
    });
}

#[test]
fn concatenated_packed_pieces_are_one_log_and_garbage_is_reported() {
    each(|lab, seed, ending, whole| {
        let subject = lab.single(kind_of(seed.container), &format!("log.{ending}"));
        let intact = lab.read(&subject, whole, ending).unwrap();
        let (front, back) = seed.files[0].bytes.split_at(seed.files[0].bytes.len() / 2);
        let pieces = [packed(ending, front), packed(ending, back)].concat();
        let case = format!("{}.{ending} in two pieces", seed.name);
        assert_eq!(Verdict::of(&lab.read(&subject, &pieces, &case), &intact), Verdict::Same, "{case}");
        let case = format!("{}.{ending} with garbage behind", seed.name);
        let read = lab.read(&subject, &[whole, &[7; 1000]].concat(), &case);
        assert_eq!(Verdict::of(&read, &intact), Verdict::Reported, "{case}");
        assert_eq!(first_foreign_row(read.as_ref().unwrap(), &intact), None, "{case}");
    });
}
