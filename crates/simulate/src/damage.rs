//! Damage as found in real logs.

use crate::random::generator;
use rand::RngExt;

/// Keeps the first `share` (0 to 1) of the bytes: a recorder that lost power.
pub fn cut_off(bytes: &mut Vec<u8>, share: f64) {
    bytes.truncate(place(bytes.len(), share));
}

/// Flips `count` bits at random places among the `length` bytes starting at `share` of the file: a bad sector, or
/// memory.
pub fn flip_bits(bytes: &mut [u8], share: f64, length: usize, count: usize, seed: u64) {
    let range = block(bytes.len(), share, length);
    if range.is_empty() {
        return;
    }
    let mut random = generator(seed, "damage");
    for _ in 0..count {
        let at = random.random_range(range.clone());
        bytes[at] ^= 1 << random.random_range(0..8);
    }
}

/// Overwrites `length` bytes starting at `share` of the file with zeros: a block that never reached the disk.
pub fn zero_block(bytes: &mut [u8], share: f64, length: usize) {
    let range = block(bytes.len(), share, length);
    bytes[range].fill(0);
}

fn place(length: usize, share: f64) -> usize {
    // Clamps a share outside its bounds; a NaN gives 0.
    ((length as f64 * share.clamp(0.0, 1.0)) as usize).min(length)
}

fn block(size: usize, share: f64, length: usize) -> std::ops::Range<usize> {
    let from = place(size, share);
    from..from.saturating_add(length).min(size)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truncation_keeps_the_share_from_the_start() {
        let mut bytes: Vec<u8> = (0..100).collect();
        cut_off(&mut bytes, 0.6);
        assert_eq!(bytes, (0..60).collect::<Vec<u8>>());
    }

    #[test]
    fn flipped_bits_stay_in_their_block() {
        let mut bytes = vec![0_u8; 1000];
        flip_bits(&mut bytes, 0.5, 10, 5, 1);
        assert!(bytes[500..510].iter().any(|b| *b != 0));
        assert!(bytes[..500].iter().chain(&bytes[510..]).all(|b| *b == 0));
    }

    #[test]
    fn a_block_beyond_the_end_is_truncated_there() {
        let mut bytes = vec![1_u8; 10];
        zero_block(&mut bytes, 0.8, 100);
        assert_eq!(bytes, [1, 1, 1, 1, 1, 1, 1, 1, 0, 0]);
        flip_bits(&mut bytes, 1.0, 10, 3, 1);
        assert_eq!(bytes[..8], [1; 8]);
    }
}
