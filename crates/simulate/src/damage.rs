//! Damage as found in real logs.

/// Keeps the first `share` (0 to 1) of the bytes: a recorder that lost power.
pub fn cut_off(bytes: &mut Vec<u8>, share: f64) {
    bytes.truncate(place(bytes.len(), share));
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
    fn a_block_beyond_the_end_is_truncated_there() {
        let mut bytes = vec![1_u8; 10];
        zero_block(&mut bytes, 0.8, 100);
        assert_eq!(bytes, [1, 1, 1, 1, 1, 1, 1, 1, 0, 0]);
    }
}
