//! T2: every bit flipped, one at a time.
//!
//! Formats with checksums may not change silently. The others cannot detect a wrong value; there a flipped bit may
//! change the record that it hits, or, in a definition, what the definition says of its records. No row may be
//! missing silently.

use crate::lab::{Lab, each_file, of_each_format};
use crate::layout::definitions;
use crate::verdict::Verdict;
use simulate::{Container, Seed};
use std::collections::BTreeMap;

/// In the normal suite every `step`-th bit is flipped.
fn flips(family: &str, step: usize) {
    each_file(family, |seed, damaged| flip(seed, damaged, step));
}

fn flip(seed: &Seed, damaged: usize, step: usize) {
    let mut lab = Lab::new();
    let (subject, intact) = lab.intact(seed, damaged);
    let mut bytes = seed.files[damaged].bytes.clone();
    let definitions = definitions(seed, damaged);
    let (mut counts, mut wrong): (BTreeMap<Verdict, usize>, Vec<String>) = Default::default();
    for bit in (0..8 * bytes.len()).step_by(step) {
        let case = format!("{}, file {damaged}, bit {} of byte {}", seed.name, bit % 8, bit / 8);
        bytes[bit / 8] ^= 1 << (bit % 8);
        let verdict = Verdict::of(&lab.read(&subject, &bytes, &case), &intact);
        bytes[bit / 8] ^= 1 << (bit % 8);
        *counts.entry(verdict).or_default() += 1;
        if !allowed(seed, verdict, definitions.iter().any(|range| range.contains(&(bit / 8)))) {
            wrong.push(format!("{verdict:?} {}.{}", bit / 8, bit % 8));
        }
    }
    println!("| {} {damaged} | {} | {counts:?} | {} | {:?} |", seed.name, lab.cases - 1, wrong.len(), lab.slowest);
    assert!(wrong.is_empty(), "{}, file {damaged}: not reported (byte.bit): {wrong:?}", seed.name);
}

fn allowed(seed: &Seed, verdict: Verdict, in_definition: bool) -> bool {
    match verdict {
        Verdict::Same | Verdict::Reported => true,
        Verdict::OneRow => !checked(seed.container),
        Verdict::ManyRows | Verdict::More => in_definition && !checked(seed.container),
        Verdict::Fewer => false,
    }
}

/// Whether checksums cover the whole log. Those of tlog exclude the timestamps.
fn checked(container: Container) -> bool {
    matches!(container, Container::Mcap(_) | Container::Ubx | Container::Nmea)
}

of_each_format! {
    flips, 1, "every bit; `just faults`":
    a_flipped_bit_of_an_mcap_changes_nothing_silently "mcap" 509 every_flipped_bit_of_an_mcap,
    a_flipped_bit_of_a_bag_changes_no_more_than_its_record "bag" 509 every_flipped_bit_of_a_bag,
    a_flipped_bit_of_a_ros_2_bag_changes_no_more_than_its_record "db3" 2039 every_flipped_bit_of_a_ros_2_bag,
    a_flipped_bit_of_a_ulog_changes_no_more_than_its_record "ulog" 61 every_flipped_bit_of_a_ulog,
    a_flipped_bit_of_a_dataflash_log_changes_no_more_than_its_record "dataflash" 61 every_flipped_bit_of_a_dataflash_log,
    a_flipped_bit_of_a_tlog_changes_no_more_than_a_timestamp "tlog" 61 every_flipped_bit_of_a_tlog,
    a_flipped_bit_of_a_ubx_log_changes_nothing_silently "ubx" 61 every_flipped_bit_of_a_ubx_log,
    a_flipped_bit_of_an_nmea_log_changes_nothing_silently "nmea" 61 every_flipped_bit_of_an_nmea_log,
    a_flipped_bit_of_a_table_changes_no_more_than_its_row "csv" 61 every_flipped_bit_of_a_table,
}
