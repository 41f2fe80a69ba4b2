//! T2: every bit flipped, one at a time. T3: stretches of bytes overwritten, doubled and swapped.

use crate::lab::{Lab, seeds};
use crate::verdict::{Verdict, losses};
use simulate::Seed;
use std::collections::BTreeMap;

fn flips(family: &str, step: usize) {
    for seed in seeds(family) {
        (0..seed.files.len()).for_each(|damaged| flip(&seed, damaged, step));
    }
}

fn flip(seed: &Seed, damaged: usize, step: usize) {
    let mut lab = Lab::new();
    let subject = lab.seed(seed, damaged);
    let mut bytes = seed.files[damaged].bytes.clone();
    let intact = lab.read(&subject, &bytes, seed.name).unwrap();
    println!("{:?}", losses(&intact));
    let mut found: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
    for bit in (0..8 * bytes.len()).step_by(step) {
        let case = format!("{}, file {damaged}, bit {} of byte {}", seed.name, bit % 8, bit / 8);
        bytes[bit / 8] ^= 1 << (bit % 8);
        let read = lab.read(&subject, &bytes, &case);
        let verdict = match Verdict::of(&read, &intact) {
            Verdict::Same => "same",
            Verdict::Told => "told",
            Verdict::OneRow => "one row",
            Verdict::ManyRows => "many rows",
            Verdict::Fewer => "fewer",
            Verdict::More => "more",
        };
        found.entry(verdict).or_default().push(bit);
        bytes[bit / 8] ^= 1 << (bit % 8);
    }
    println!("| {} {damaged} | {} | {:?} |", seed.name, lab.cases - 1, lab.slowest);
    for (verdict, bits) in found {
        println!("   {verdict}: {}", bits.len());
        if !["same", "told"].contains(&verdict) {
            let mut bytes: Vec<usize> = bits.iter().map(|b| b / 8).collect();
            bytes.dedup();
            println!("      {:?}", &bytes[..bytes.len().min(400)]);
        }
    }
}

macro_rules! of_each_format {
    ($($family:ident $name:literal $step:literal $all:ident,)*) => {$(
        #[test]
        fn $family() {
            flips($name, $step);
        }

        #[test]
        #[ignore = "every bit; `just faults`"]
        fn $all() {
            flips($name, 1);
        }
    )*};
}

of_each_format! {
    a_flipped_bit_of_an_mcap_changes_nothing_in_silence "mcap" 509 every_flipped_bit_of_an_mcap,
    a_flipped_bit_of_a_bag_changes_no_more_than_its_record "bag" 509 every_flipped_bit_of_a_bag,
    a_flipped_bit_of_a_ros_2_bag_changes_no_more_than_its_record "db3" 2039 every_flipped_bit_of_a_ros_2_bag,
    a_flipped_bit_of_a_ulog_changes_no_more_than_its_record "ulog" 61 every_flipped_bit_of_a_ulog,
    a_flipped_bit_of_a_dataflash_log_changes_no_more_than_its_record "dataflash" 61 every_flipped_bit_of_a_dataflash_log,
    a_flipped_bit_of_a_tlog_changes_no_more_than_a_stamp "tlog" 61 every_flipped_bit_of_a_tlog,
    a_flipped_bit_of_a_ubx_log_changes_nothing_in_silence "ubx" 61 every_flipped_bit_of_a_ubx_log,
    a_flipped_bit_of_an_nmea_log_changes_nothing_in_silence "nmea" 61 every_flipped_bit_of_an_nmea_log,
    a_flipped_bit_of_a_table_changes_no_more_than_its_row "csv" 61 every_flipped_bit_of_a_table,
}
