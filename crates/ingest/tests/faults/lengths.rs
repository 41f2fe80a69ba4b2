//! T4: numbers that a hostile file puts where a length, a count or an offset may be.

use crate::lab::{Lab, of_each_format, seeds};

const VALUES: [u64; 8] = [0, 1, (1 << 31) - 1, 1 << 31, (1 << 32) - 1, 1 << 62, 1 << 63, u64::MAX];

/// In the normal suite every n-th offset of a file is overwritten; all of them by `just faults`.
fn lengths(family: &str, step: usize) {
    for seed in seeds(family) {
        let mut lab = Lab::new();
        let subject = lab.seed(&seed, 0);
        let mut bytes = seed.files[0].bytes.clone();
        let size = bytes.len();
        for (turn, at) in (0..bytes.len()).step_by(step).enumerate() {
            for width in [1, 2, 4, 8].into_iter().filter(|width| at + width <= size) {
                let kept = bytes[at..at + width].to_vec();
                // One more and one less than the present value, and one of the large values in turn.
                let stored = kept.iter().rev().fold(0_u64, |n, b| n << 8 | u64::from(*b));
                let values = [stored.wrapping_add(1), stored.wrapping_sub(1), VALUES[(turn + width) % VALUES.len()]];
                let values = values.into_iter().chain(VALUES.into_iter().filter(|_| step == 1));
                for value in values {
                    for swapped in [false, true] {
                        let number = if swapped { value.to_be_bytes() } else { value.to_le_bytes() };
                        let number = if swapped { &number[8 - width..] } else { &number[..width] };
                        bytes[at..at + width].copy_from_slice(number);
                        let case = format!("{}: {value:#x} in {width} bytes at {at}, swapped: {swapped}", seed.name);
                        let _ = lab.read(&subject, &bytes, &case);
                    }
                }
                bytes[at..at + width].copy_from_slice(&kept);
            }
        }
        println!("| {} | {} | {:?} |", seed.name, lab.cases, lab.slowest);
    }
}

of_each_format! {
    lengths, 1, "every place; `just faults`":
    hostile_numbers_in_an_mcap_take_little_memory "mcap" 509 every_hostile_number_in_an_mcap,
    hostile_numbers_in_a_bag_take_little_memory "bag" 1021 every_hostile_number_in_a_bag,
    hostile_numbers_in_a_ros_2_bag_take_little_memory "db3" 1021 every_hostile_number_in_a_ros_2_bag,
    hostile_numbers_in_a_ulog_take_little_memory "ulog" 61 every_hostile_number_in_a_ulog,
    hostile_numbers_in_a_dataflash_log_take_little_memory "dataflash-binary" 61 every_hostile_number_in_a_dataflash_log,
    hostile_numbers_in_a_dataflash_text_take_little_memory "dataflash-text" 61 every_hostile_number_in_a_dataflash_text,
    hostile_numbers_in_an_nmea_log_take_little_memory "nmea" 61 every_hostile_number_in_an_nmea_log,
    hostile_numbers_in_a_table_take_little_memory "csv" 61 every_hostile_number_in_a_table,
    hostile_numbers_in_a_tlog_take_little_memory "tlog" 61 every_hostile_number_in_a_tlog,
    hostile_numbers_in_a_ubx_log_take_little_memory "ubx" 61 every_hostile_number_in_a_ubx_log,
}
