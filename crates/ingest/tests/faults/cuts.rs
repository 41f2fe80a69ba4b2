//! T1: logs that end too early, wherever that is.

use crate::lab::{Lab, seeds};
use crate::layout::{Ends, definitions};
use crate::verdict::{first_foreign_row, told};
use simulate::Seed;

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
    let definitions = definitions(seed, damaged);
    let ends = Ends::of(seed, damaged);
    let last = bytes.len().saturating_sub(100);
    let mut silent = vec![];
    for length in (0..last).step_by(step).chain(last..bytes.len()) {
        let case = format!("{}, file {damaged} cut to {length} of {} bytes", seed.name, bytes.len());
        let read = lab.read(&subject, &bytes[..length], &case);
        // Of a table that ends in its header nothing says that what follows is not a row.
        if let Ok(log) = read.as_ref()
            && !definitions.iter().any(|range| seed.name.starts_with("csv") && range.contains(&length))
        {
            assert_eq!(first_foreign_row(log, &intact), None, "{case}");
        }
        if !told(&read, &intact) && !ends.allow(length) {
            silent.push(length);
        }
    }
    println!("| {} {damaged} | {} | {} | {:?} |", seed.name, lab.cases - 1, silent.len(), lab.slowest);
    assert!(silent.is_empty(), "{}: cuts of file {damaged} that nobody hears of: {silent:?}", seed.name);
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
