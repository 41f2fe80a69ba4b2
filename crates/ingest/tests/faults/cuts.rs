//! T1: logs that end too early, wherever that is.

use crate::lab::{Lab, each_file, of_each_format};
use crate::layout::{Ends, definitions};
use crate::verdict::{first_foreign_row, is_reported};
use simulate::Seed;

/// A truncated log yields the beginning and reports the cut. In the normal suite every `step`-th cut is tried, in file
/// order, and all of the last hundred.
fn cuts(family: &str, step: usize) {
    each_file(family, |seed, damaged| cut(seed, damaged, step));
}

fn cut(seed: &Seed, damaged: usize, step: usize) {
    let mut lab = Lab::new();
    let (subject, intact) = lab.intact(seed, damaged);
    let bytes = &seed.files[damaged].bytes;
    let definitions = definitions(seed, damaged);
    let ends = Ends::of(seed, damaged);
    let last = bytes.len().saturating_sub(100);
    let mut silent = vec![];
    for length in (0..last).step_by(step).chain(last..bytes.len()) {
        let case = format!("{}, file {damaged} cut to {length} of {} bytes", seed.name, bytes.len());
        let read = lab.read(&subject, &bytes[..length], &case);
        // In a table that ends in its header, the next line could be a row.
        if let Ok(log) = read.as_ref()
            && !definitions.iter().any(|range| seed.name.starts_with("csv") && range.contains(&length))
        {
            assert_eq!(first_foreign_row(log, &intact), None, "{case}");
        }
        if !is_reported(&read, &intact) && !ends.allow(length) {
            silent.push(length);
        }
    }
    println!("| {} {damaged} | {} | {} | {:?} |", seed.name, lab.cases - 1, silent.len(), lab.slowest);
    assert!(silent.is_empty(), "{}: cuts of file {damaged} that are not reported: {silent:?}", seed.name);
}

of_each_format! {
    cuts, 1, "every cut; `just faults`":
    a_cut_mcap_gives_its_beginning_and_is_reported "mcap" 61 every_cut_of_an_mcap,
    a_cut_bag_gives_its_beginning_and_is_reported "bag" 61 every_cut_of_a_bag,
    a_cut_ros_2_bag_gives_its_beginning_and_is_reported "db3" 257 every_cut_of_a_ros_2_bag,
    a_cut_ulog_gives_its_beginning_and_is_reported "ulog" 7 every_cut_of_a_ulog,
    a_cut_dataflash_log_gives_its_beginning_and_is_reported "dataflash" 13 every_cut_of_a_dataflash_log,
    a_cut_tlog_gives_its_beginning_and_is_reported "tlog" 7 every_cut_of_a_tlog,
    a_cut_ubx_log_gives_its_beginning_and_is_reported "ubx" 7 every_cut_of_a_ubx_log,
    a_cut_nmea_log_gives_its_beginning_and_is_reported "nmea" 7 every_cut_of_an_nmea_log,
    a_cut_table_gives_its_beginning_and_is_reported "csv" 7 every_cut_of_a_table,
}
