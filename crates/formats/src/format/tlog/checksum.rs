//! The checksum of a frame (<https://mavlink.io/en/guide/serialization.html#checksum>).

/// CRC-16/MCRF4XX, which MAVLink calls X.25.
#[derive(Debug, Clone, Copy)]
pub(super) struct Checksum(pub(super) u16);

impl Checksum {
    pub(super) fn new() -> Checksum {
        Checksum(0xffff)
    }

    pub(super) fn add(&mut self, bytes: &[u8]) {
        self.0 = bytes.iter().fold(self.0, |sum, &byte| step(sum, byte));
    }

    /// With one more byte.
    pub(super) fn with(self, byte: u8) -> u16 {
        let mut more = self;
        more.add(&[byte]);
        more.0
    }

    /// The byte that makes this checksum `stored`, if there is one.
    pub(super) fn extra_of(self, stored: u16) -> Option<u8> {
        // The inverse of `step`; the upper byte is all the information needed.
        let [_, high] = (stored ^ (self.0 >> 8)).to_le_bytes();
        let low = high ^ (high >> 5);
        let extra = low ^ (low << 4) ^ self.0 as u8;
        (self.with(extra) == stored).then_some(extra)
    }

    pub(super) fn value(self) -> u16 {
        self.0
    }
}

/// One more byte.
pub(super) const fn step(sum: u16, byte: u8) -> u16 {
    let mut low = byte ^ sum as u8;
    low ^= low << 4;
    let low = low as u16;
    (sum >> 8) ^ (low << 8) ^ (low << 3) ^ (low >> 4)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_matches_the_crc_catalogue() {
        let mut checksum = Checksum::new();
        checksum.add(b"123456789");
        assert_eq!(checksum.value(), 0x6f91);
    }

    #[test]
    fn every_byte_is_recovered_from_the_checksum_it_makes() {
        for sum in [0, 1, 0x1234, 0xffff, 0x8a5f] {
            let made = (0..=u8::MAX).map(|extra| Checksum(sum).with(extra));
            assert!(
                (0..=u8::MAX).zip(made.clone()).all(|(extra, stored)| Checksum(sum).extra_of(stored) == Some(extra))
            );
            let other = made.clone().fold(0, |other, stored| if stored == other { other + 1 } else { other });
            let possible: Vec<u16> = made.collect();
            assert_eq!(Checksum(sum).extra_of(other).is_some(), possible.contains(&other));
        }
    }
}
