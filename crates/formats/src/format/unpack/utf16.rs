//! Text in UTF-16 as UTF-8.

use super::Packing;
use std::cell::Cell;
use std::io::Read;

/// Bytes examined to detect UTF-16 in a text without a byte order mark.
pub(super) const TELLING: usize = 4096;

/// Detects a text of mostly Latin letters without a byte order mark: nearly every other byte is zero, and few others.
pub(super) fn without_mark(head: &[u8]) -> Option<Packing> {
    let head = head.get(..head.len().min(TELLING))?;
    let zeros = |from: usize| head.iter().skip(from).step_by(2).filter(|b| **b == 0).count();
    let (even, odd) = (zeros(0), zeros(1));
    let most = |count: usize| head.len() >= 16 && 5 * count >= 2 * head.len();
    if most(odd) && 4 * even <= odd {
        return Some(Packing::Utf16 { big: false });
    }
    (most(even) && 4 * odd <= even).then_some(Packing::Utf16 { big: true })
}

/// Returns UTF-8. The byte order mark is removed; invalid characters become U+FFFD and are counted.
pub(super) struct Reader<'r, R> {
    inner: R,
    big: bool,
    bad: &'r Cell<u64>,
    /// Bytes of an incomplete character, then those of the last read.
    input: Vec<u8>,
    /// UTF-8 that was not consumed yet.
    text: Vec<u8>,
    taken: usize,
    begun: bool,
    ended: bool,
}

impl<'r, R: Read> Reader<'r, R> {
    pub(super) fn new(inner: R, big: bool, bad: &'r Cell<u64>) -> Reader<'r, R> {
        Reader { inner, big, bad, input: vec![], text: vec![], taken: 0, begun: false, ended: false }
    }

    fn fill(&mut self) -> std::io::Result<()> {
        let got = self.inner.by_ref().take(super::STEP as u64).read_to_end(&mut self.input)?;
        self.ended = got == 0;
        let units = self.input.as_chunks::<2>().0.iter();
        let units: Vec<u16> =
            units.map(|pair| if self.big { u16::from_be_bytes(*pair) } else { u16::from_le_bytes(*pair) }).collect();
        // The second half of a surrogate pair may follow.
        let cut = units.last().is_some_and(|last| (0xd800..0xdc00).contains(last)) && !self.ended;
        let whole = units.len() - usize::from(cut);
        self.text.clear();
        self.taken = 0;
        for character in char::decode_utf16(units.iter().take(whole).copied()) {
            self.bad.set(self.bad.get() + u64::from(character.is_err()));
            let character = character.unwrap_or(char::REPLACEMENT_CHARACTER);
            if self.begun || character != '\u{feff}' {
                self.text.extend_from_slice(character.encode_utf8(&mut [0; 4]).as_bytes());
            }
            self.begun = true;
        }
        self.input.drain(..2 * whole);
        if self.ended && !self.input.is_empty() {
            self.bad.set(self.bad.get() + 1);
            self.input.clear();
        }
        Ok(())
    }
}

impl<R: Read> Read for Reader<'_, R> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        while self.taken == self.text.len() && !self.ended {
            self.fill()?;
        }
        let rest = self.text.get(self.taken..).unwrap_or_default();
        let count = rest.len().min(buffer.len());
        if let (Some(to), Some(from)) = (buffer.get_mut(..count), rest.get(..count)) {
            to.copy_from_slice(from);
        }
        self.taken += count;
        Ok(count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns one byte at a time.
    struct Dripping<'a>(&'a [u8]);

    impl Read for Dripping<'_> {
        fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
            self.0.read(&mut buffer[..1])
        }
    }

    fn encoded(text: &str, big: bool) -> Vec<u8> {
        text.encode_utf16().flat_map(|u| if big { u.to_be_bytes() } else { u.to_le_bytes() }).collect()
    }

    #[test]
    fn text_in_either_byte_order_gives_the_same_utf_8() {
        let text = "t,x °\n1,😀\n".repeat(50_000);
        for big in [false, true] {
            let bytes = encoded(&format!("\u{feff}{text}"), big);
            let bad = Cell::new(0);
            let mut out = String::new();
            Reader::new(Dripping(&bytes), big, &bad).read_to_string(&mut out).unwrap();
            assert!(out == text && bad.get() == 0);
            assert_eq!(without_mark(&encoded(&text, big)), Some(Packing::Utf16 { big }));
        }
        assert_eq!(without_mark(text.as_bytes()), None);
    }

    #[test]
    fn an_unpaired_surrogate_and_half_a_character_are_replaced_and_counted() {
        let mut bytes = encoded("ab", false);
        bytes.extend([0x00, 0xd8]);
        bytes.extend(encoded("c", false));
        bytes.push(0x41);
        let bad = Cell::new(0);
        let mut out = String::new();
        Reader::new(bytes.as_slice(), false, &bad).read_to_string(&mut out).unwrap();
        assert_eq!((out.as_str(), bad.get()), ("ab\u{fffd}c", 2));
    }
}
