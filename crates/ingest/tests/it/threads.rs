//! Many threads read a log exactly as one thread does.

use crate::made::{BagCodec, Encoding, Layout, OnDisk, bag, each_damage, flight, mcap};
use rayon::{ThreadPool, ThreadPoolBuilder};

/// Logs of many chunks; whether each is a bag.
fn logs() -> Vec<(String, Vec<u8>, bool)> {
    let sent = flight(300);
    let layouts = [
        Layout::ZSTD,
        Layout::LZ4,
        Layout::PLAIN,
        Layout { data_crc: false, ..Layout::ZSTD },
        Layout { summary: false, ..Layout::LZ4 },
    ];
    // Chunks shorter than a kilobyte are not handed to other threads.
    let layouts = layouts.map(|layout| Layout { chunk_bytes: 6000, ..layout });
    let mcaps = layouts.map(|layout| (format!("{layout:?}"), mcap(&sent, Encoding::Cdr, layout), false));
    let codecs = [BagCodec::Lz4Independent, BagCodec::Lz4Linked, BagCodec::Bz2, BagCodec::None];
    let bags = codecs.map(|codec| (format!("{codec:?}"), bag(&sent, codec, 40, true, true), true));
    mcaps.into_iter().chain(bags).collect()
}

fn pools() -> [ThreadPool; 2] {
    [1, 4].map(|threads| ThreadPoolBuilder::new().num_threads(threads).build().unwrap())
}

fn assert_one_answer(pools: &[ThreadPool; 2], content: &[u8], is_bag: bool, case: &str) {
    let disk = OnDisk::new(content, is_bag);
    let [one, many] = pools.each_ref().map(|pool| pool.install(|| format!("{:?}", disk.read())));
    let first = one.split(", ").zip(many.split(", ")).find(|(a, b)| a != b);
    assert!(one == many, "{case}: {first:?}");
}

#[test]
fn an_intact_log_is_the_same_to_one_thread_and_to_many() {
    let pools = pools();
    for (name, content, is_bag) in logs() {
        (0..20).for_each(|_| assert_one_answer(&pools, &content, is_bag, &name));
    }
}

#[test]
fn a_damaged_log_is_the_same_to_one_thread_and_to_many() {
    let pools = pools();
    for (name, content, is_bag) in logs() {
        each_damage(&content, 150, |damaged| assert_one_answer(&pools, damaged, is_bag, &name));
    }
}

#[test]
fn concatenated_logs_are_the_same_to_one_thread_and_to_many() {
    let pools = pools();
    for (name, content, is_bag) in logs() {
        let cut = &content[..content.len() / 2];
        for parts in [[&content[..], &content], [&content, cut], [cut, &content]] {
            assert_one_answer(&pools, &parts.concat(), is_bag, &name);
        }
    }
}

/// Index offsets that point into the middle of chunks, repeatedly to one chunk, and in no order.
#[test]
fn an_index_with_wrong_offsets_changes_nothing_with_many_threads() {
    let pools = pools();
    let sent = flight(300);
    for layout in [Layout::ZSTD, Layout::LZ4] {
        let mut content = mcap(&sent, Encoding::Cdr, Layout { chunk_bytes: 6000, ..layout });
        // A summary without a checksum, just before the magic at the end of the file.
        let crc_at = content.len() - 12;
        content[crc_at..crc_at + 4].fill(0);
        // The content of a chunk index begins with two times of eight bytes; then comes the offset.
        let indexes: Vec<usize> = chunk_indexes(&content).map(|at| at + 16).collect();
        assert!(indexes.len() > 10);
        for lie in 0..40_u64 {
            let mut lying = content.clone();
            for (number, &at) in indexes.iter().enumerate() {
                let other = indexes[(number * (lie as usize + 3) + 7) % indexes.len()];
                let place = u64::from_le_bytes(content[other..other + 8].try_into().unwrap());
                let place = if lie % 4 == 0 { place + lie } else { place };
                lying[at..at + 8].copy_from_slice(&place.to_le_bytes());
            }
            assert_one_answer(&pools, &lying, false, &format!("{layout:?}, {lie}"));
        }
    }
}

/// Offsets of the contents of the chunk indexes.
fn chunk_indexes(content: &[u8]) -> impl Iterator<Item = usize> {
    let mut at = 8;
    std::iter::from_fn(move || {
        while at + 9 < content.len() {
            let (opcode, start) = (content[at], at + 9);
            at = start + u64::from_le_bytes(content[at + 1..start].try_into().unwrap()) as usize;
            if opcode == 8 {
                return Some(start);
            }
        }
        None
    })
}
