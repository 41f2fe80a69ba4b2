//! T3: stretches of bytes zeroed, set, doubled, removed and swapped.

use crate::lab::{Lab, each_file, of_each_format};
use crate::verdict::Verdict;
use simulate::{Container, Seed};

const SIZES: [usize; 3] = [1, 16, 512];

fn blocks(family: &str, step: usize) {
    each_file(family, |seed, damaged| hit(seed, damaged, step));
}

fn hit(seed: &Seed, damaged: usize, step: usize) {
    let mut lab = Lab::new();
    let (subject, intact) = lab.intact(seed, damaged);
    let bytes = &seed.files[damaged].bytes;
    for size in SIZES {
        for at in (0..bytes.len().saturating_sub(size)).step_by(step) {
            for (what, hurt) in damage(bytes, at, size) {
                let case = format!("{}, file {damaged}, {size} bytes from {at} {what}", seed.name);
                let verdict = Verdict::of(&lab.read(&subject, &hurt, &case), &intact);
                let silent = ![Verdict::Same, Verdict::Reported].contains(&verdict);
                assert!(!summed(seed.container) || !silent, "{case}: {verdict:?} and nothing reported");
            }
        }
    }
    println!("| {} {damaged} | {} | {:?} |", seed.name, lab.cases - 1, lab.slowest);
}

/// Whether checksums detect such damage. The XOR of NMEA misses swapped bytes.
fn summed(container: Container) -> bool {
    matches!(container, Container::Mcap(_) | Container::Ubx)
}

fn damage(bytes: &[u8], at: usize, size: usize) -> [(&'static str, Vec<u8>); 6] {
    let (before, block, after) = (&bytes[..at], &bytes[at..at + size], &bytes[at + size..]);
    let next = size.min(after.len());
    [
        ("zeroed", [before, &vec![0; size], after].concat()),
        ("set", [before, &vec![0xff; size], after].concat()),
        ("random", [before, &noise(at, size), after].concat()),
        ("doubled", [before, block, block, after].concat()),
        ("left out", [before, after].concat()),
        ("swapped", [before, &after[..next], block, &after[next..]].concat()),
    ]
}

/// Bytes that depend on the offset.
fn noise(at: usize, size: usize) -> Vec<u8> {
    let mut state = at as u64 + 1;
    let next = |_| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as u8
    };
    (0..size).map(next).collect()
}

of_each_format! {
    blocks, 64, "a block at every 64 bytes; `just faults`":
    a_bad_block_of_an_mcap_is_reported "mcap" 2039 bad_blocks_of_an_mcap,
    a_bad_block_of_a_bag_is_survived "bag" 4093 bad_blocks_of_a_bag,
    a_bad_block_of_a_ros_2_bag_is_survived "db3" 4093 bad_blocks_of_a_ros_2_bag,
    a_bad_block_of_a_ulog_is_survived "ulog" 127 bad_blocks_of_a_ulog,
    a_bad_block_of_a_dataflash_log_is_survived "dataflash" 251 bad_blocks_of_a_dataflash_log,
    a_bad_block_of_a_tlog_is_survived "tlog" 127 bad_blocks_of_a_tlog,
    a_bad_block_of_a_ubx_log_is_reported "ubx" 127 bad_blocks_of_a_ubx_log,
    a_bad_block_of_an_nmea_log_is_survived "nmea" 127 bad_blocks_of_an_nmea_log,
    a_bad_block_of_a_table_is_survived "csv" 251 bad_blocks_of_a_table,
}
