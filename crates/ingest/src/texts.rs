//! Stores the texts of a column compactly: the digits of each text separately from the characters around them.
//!
//! Text columns mostly hold times, numbers and status words. Thousands of them differ only in their digits, so a cell
//! takes five bytes, or nine if a number is longer than nine digits; other texts take these and their own bytes.

use std::collections::HashMap;
use std::ops::Deref;

/// Longer texts have no shape, bytes.
const LONGEST: usize = 40;
/// The most digits that always fit a 64-bit number.
const MOST_DIGITS: usize = 19;
/// The shape number of a text without a shape.
const NO_SHAPE: u8 = u8::MAX;

/// The texts of a column, row by row. Boxed, so that number columns do not pay for its size.
#[derive(Clone, Default)]
pub struct Texts(Box<Columns>);

#[derive(Clone, Default)]
struct Columns {
    /// For each row the number of its shape, or [`NO_SHAPE`].
    shape_of: Vec<u8>,
    /// For each row its digits as a number, or its offset in `others`.
    digits: Digits,
    shapes: Vec<Shape>,
    by_text: HashMap<Box<[u8]>, u8>,
    /// Texts without a shape, each after its length: seven bits a byte, the lowest first, and the eighth bit set if
    /// more follow.
    others: Vec<u8>,
}

/// Numbers, each in as many bytes as the longest needs.
#[derive(Clone)]
enum Digits {
    Narrow(Vec<u32>),
    Wide(Vec<u64>),
}

impl Default for Digits {
    fn default() -> Digits {
        Digits::Narrow(vec![])
    }
}

impl Digits {
    #[inline]
    fn get(&self, row: usize) -> Option<u64> {
        match self {
            Digits::Narrow(all) => all.get(row).map(|digits| u64::from(*digits)),
            Digits::Wide(all) => all.get(row).copied(),
        }
    }

    fn iter(&self) -> impl Iterator<Item = u64> {
        (0..).map_while(|row| self.get(row))
    }

    #[inline]
    fn push(&mut self, digits: u64) {
        match self {
            Digits::Wide(all) => all.push(digits),
            Digits::Narrow(all) => match u32::try_from(digits) {
                Ok(digits) => all.push(digits),
                Err(_) => *self = Digits::Wide(self.iter().chain([digits]).collect()),
            },
        }
    }

    fn truncate(&mut self, rows: usize) {
        match self {
            Digits::Narrow(all) => all.truncate(rows),
            Digits::Wide(all) => all.truncate(rows),
        }
    }
}

/// A text with every digit replaced by `0`.
#[derive(Debug, Clone)]
struct Shape {
    text: Box<[u8]>,
    digits: usize,
}

/// A text of a column.
#[derive(Debug, Clone, Copy)]
pub struct Text<'t>(Held<'t>);

#[derive(Debug, Clone, Copy)]
enum Held<'t> {
    Other(&'t str),
    Shaped([u8; LONGEST], usize),
}

impl Texts {
    /// The number of texts.
    #[must_use]
    pub fn len(&self) -> usize {
        self.0.shape_of.len()
    }

    /// Whether there are no rows.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.shape_of.is_empty()
    }

    /// The text of a row.
    #[must_use]
    pub fn get(&self, row: usize) -> Option<Text<'_>> {
        let (number, digits) = (*self.0.shape_of.get(row)?, self.0.digits.get(row)?);
        match self.0.shapes.get(usize::from(number)) {
            Some(shape) => Some(shape.with(digits)),
            None => Some(Text(Held::Other(self.other(digits as usize)))),
        }
    }

    /// Iterates over all texts in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = Text<'_>> {
        (0..self.len()).map(|row| self.get(row).unwrap_or_default())
    }

    /// Appends a text.
    pub fn push(&mut self, text: &str) {
        let (number, digits) = match self.shaped(text.as_bytes()) {
            Some(shaped) => shaped,
            None => (NO_SHAPE, self.push_other(text.as_bytes())),
        };
        self.0.shape_of.push(number);
        self.0.digits.push(digits);
    }

    /// Keeps at most `rows` texts.
    pub fn truncate(&mut self, rows: usize) {
        self.0.shape_of.truncate(rows);
        self.0.digits.truncate(rows);
    }

    /// Sets the number of texts to `rows`: added ones are empty.
    pub fn resize(&mut self, rows: usize) {
        if rows <= self.len() {
            return self.truncate(rows);
        }
        self.push("");
        let number = self.0.shape_of.last().copied().unwrap_or(NO_SHAPE);
        let last = self.len() - 1;
        let digits = self.0.digits.get(last).unwrap_or_default();
        self.0.shape_of.resize(rows, number);
        (last + 1..rows).for_each(|_| self.0.digits.push(digits));
    }

    /// Appends the texts of another column, and empties it, but keeps its capacity.
    pub(crate) fn append(&mut self, more: &mut Texts) {
        let numbers: Option<Vec<u8>> =
            more.0.shapes.iter().map(|shape| self.number_of(&shape.text, shape.digits)).collect();
        match numbers {
            Some(numbers) => {
                let others_before = self.0.others.len() as u64;
                let number_of = |of_more: &u8| numbers.get(usize::from(*of_more)).copied().unwrap_or(NO_SHAPE);
                let place = |(number, digits): (&u8, u64)| digits + if *number == NO_SHAPE { others_before } else { 0 };
                more.0
                    .shape_of
                    .iter()
                    .zip(more.0.digits.iter())
                    .map(place)
                    .for_each(|digits| self.0.digits.push(digits));
                self.0.shape_of.extend(more.0.shape_of.iter().map(number_of));
                self.0.others.extend_from_slice(&more.0.others);
            }
            // There are too many shapes.
            None => more.iter().for_each(|text| self.push(&text)),
        }
        more.clear();
    }

    /// Removes all rows but keeps the capacity.
    pub(crate) fn clear(&mut self) {
        self.0.shape_of.clear();
        self.0.digits.truncate(0);
        self.0.others.clear();
    }

    /// The number of its shape and its digits; `None` if it has no shape.
    fn shaped(&mut self, text: &[u8]) -> Option<(u8, u64)> {
        let mut shape = [0; LONGEST];
        let shape = shape.get_mut(..text.len())?;
        let (mut digits, mut count) = (0_u64, 0);
        for (place, &byte) in shape.iter_mut().zip(text) {
            *place = byte;
            if byte.is_ascii_digit() {
                *place = b'0';
                digits = digits.wrapping_mul(10).wrapping_add(u64::from(byte - b'0'));
                count += 1;
            }
        }
        if count > MOST_DIGITS {
            return None;
        }
        // Most rows have the shape of the one before.
        let last = self.0.shape_of.last().copied().unwrap_or(NO_SHAPE);
        if self.0.shapes.get(usize::from(last)).is_some_and(|known| *known.text == *shape) {
            return Some((last, digits));
        }
        Some((self.number_of(shape, count)?, digits))
    }

    /// The number of a shape, created if it is new; `None` if there are too many.
    fn number_of(&mut self, shape: &[u8], digits: usize) -> Option<u8> {
        if let Some(number) = self.0.by_text.get(shape) {
            return Some(*number);
        }
        let number = u8::try_from(self.0.shapes.len()).ok().filter(|number| *number < NO_SHAPE)?;
        self.0.by_text.insert(Box::from(shape), number);
        self.0.shapes.push(Shape { text: Box::from(shape), digits });
        Some(number)
    }

    fn push_other(&mut self, text: &[u8]) -> u64 {
        let place = self.0.others.len() as u64;
        push_with_length(&mut self.0.others, text);
        place
    }

    fn other(&self, place: usize) -> &str {
        let text = self.0.others.get(place..).and_then(with_length).map(|(text, _)| text);
        text.and_then(|text| std::str::from_utf8(text).ok()).unwrap_or_default()
    }
}

/// Appends a text after its length.
fn push_with_length(to: &mut Vec<u8>, text: &[u8]) {
    let mut length = text.len();
    while length >= 0x80 {
        to.push(length as u8 | 0x80);
        length >>= 7;
    }
    to.push(length as u8);
    to.extend_from_slice(text);
}

/// The text that starts here with its length, and the rest.
fn with_length(from: &[u8]) -> Option<(&[u8], &[u8])> {
    let length = from.iter().position(|byte| byte & 0x80 == 0)? + 1;
    let (digits, rest) = from.split_at_checked(length)?;
    let size = digits.iter().rev().fold(0, |size, byte| size << 7 | usize::from(byte & 0x7f));
    rest.split_at_checked(size)
}

impl Shape {
    fn with(&self, mut digits: u64) -> Text<'_> {
        if self.digits == 0 {
            return Text(Held::Other(std::str::from_utf8(&self.text).unwrap_or_default()));
        }
        let mut bytes = [0; LONGEST];
        let length = self.text.len();
        for (place, &byte) in bytes.iter_mut().zip(&self.text).rev() {
            *place = byte;
            if byte == b'0' {
                *place += (digits % 10) as u8;
                digits /= 10;
            }
        }
        Text(Held::Shaped(bytes, length))
    }
}

impl Default for Text<'_> {
    fn default() -> Self {
        Text(Held::Other(""))
    }
}

impl Deref for Text<'_> {
    type Target = str;

    fn deref(&self) -> &str {
        match &self.0 {
            Held::Other(text) => text,
            Held::Shaped(bytes, length) => {
                bytes.get(..*length).and_then(|text| std::str::from_utf8(text).ok()).unwrap_or_default()
            }
        }
    }
}

impl AsRef<str> for Text<'_> {
    fn as_ref(&self) -> &str {
        self
    }
}

impl PartialEq for Text<'_> {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}

impl PartialEq<str> for Text<'_> {
    fn eq(&self, other: &str) -> bool {
        **self == *other
    }
}

impl PartialEq<&str> for Text<'_> {
    fn eq(&self, other: &&str) -> bool {
        **self == **other
    }
}

impl std::fmt::Display for Text<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self)
    }
}

/// Row by row, independent of the numbering of shapes.
impl PartialEq for Texts {
    fn eq(&self, other: &Texts) -> bool {
        self.len() == other.len() && self.iter().zip(other.iter()).all(|(a, b)| a == b)
    }
}

impl std::fmt::Debug for Texts {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_list().entries(self.iter().map(|text| text.to_string())).finish()
    }
}

impl<T: AsRef<str>> FromIterator<T> for Texts {
    fn from_iter<I: IntoIterator<Item = T>>(texts: I) -> Texts {
        let mut all = Texts::default();
        texts.into_iter().for_each(|text| all.push(text.as_ref()));
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all() -> Vec<String> {
        let times = (0..500).map(|i| format!("2026-05-04T08:{:02}:{:02}.{:03}Z", i / 60, i % 60, i));
        let numbers = (0..500).map(|i| format!("{}.{:02}", i * 37, i % 100));
        let words = (0..400).map(|i| format!("word {}", "x".repeat(i)));
        let odd =
            ["", "007", "9999999999999999999", "18446744073709551616", "00000000000000000000", "é5", "0\u{0}1", "-0"];
        times.chain(numbers).chain(words).chain(odd.map(str::to_owned)).collect()
    }

    #[test]
    fn each_text_is_read_back_as_written() {
        let texts: Texts = all().into_iter().collect();
        assert!(texts.iter().eq(all().iter().map(String::as_str)));
        assert_eq!((texts.get(0).as_deref(), texts.get(all().len())), (Some("2026-05-04T08:00:00.000Z"), None));
    }

    #[test]
    fn a_time_takes_nine_bytes_and_a_long_text_its_own_length() {
        let times: Texts = (0..10_000).map(|i| format!("2026-05-04T08:00:{:02}.{:04}Z", i % 60, i)).collect();
        assert_eq!((times.0.shapes.len(), times.0.others.len()), (1, 0));
        let long: Texts = (0..100).map(|i| "y".repeat(41 + i)).collect();
        assert_eq!(
            (long.0.shapes.len(), long.0.others.len()),
            (0, (41..141).map(|n| n + 1 + usize::from(n > 127)).sum())
        );
    }

    #[test]
    fn rows_can_be_truncated_padded_and_appended() {
        let mut texts: Texts = ["a1", "b22"].into_iter().collect();
        texts.resize(4);
        assert_eq!(texts, ["a1", "b22", "", ""].into_iter().collect());
        texts.truncate(5);
        texts.truncate(1);
        let mut more: Texts = all().into_iter().collect();
        texts.append(&mut more);
        assert_eq!((more.len(), texts.len()), (0, all().len() + 1));
        assert!(texts.iter().skip(1).eq(all().iter().map(String::as_str)));
        // Both together have too many shapes.
        let words =
            |of: &str| -> Vec<String> { (0..200).map(|i| of.repeat(1 + i / 10) + &"z".repeat(i % 10)).collect() };
        let (mut texts, mut more): (Texts, Texts) = (words("a").iter().collect(), words("b").iter().collect());
        texts.append(&mut more);
        assert!(texts.iter().eq(words("a").iter().chain(&words("b")).map(String::as_str)));
    }
}
