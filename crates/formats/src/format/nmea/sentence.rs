//! A sentence: the text between `$` and its checksum, and the values of its fields.

use memchr::{memchr, memchr_iter};
use std::fmt;

/// Longest sentence that is accepted, bytes. The standard says 82; receivers send more.
pub(crate) const LONGEST: usize = 2048;

/// `P` and the three letters of a manufacturer.
const MAKER: usize = 4;
/// Manufacturers whose first field identifies the message: u-blox by a number, Trimble by letters.
const NUMBERED: [&str; 2] = ["PUBX", "PTNL"];

/// A sentence with a right checksum, or without one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Sentence<'t> {
    /// Between `$` and `*`: address and fields.
    pub(crate) body: &'t str,
    /// Bytes from `$` to the checksum, without the line end.
    pub(crate) length: usize,
    pub(crate) checked: bool,
}

/// Why the bytes are not a sentence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Fault {
    Address,
    Sum { stated: u8, computed: u8 },
    NoNumber,
    Cut,
    Unchecked,
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Fault::Address => write!(f, "not a sentence: its address is invalid"),
            Fault::Sum { stated, computed } => {
                write!(f, "the checksum is {stated:02X}, and the sentence gives {computed:02X}")
            }
            Fault::NoNumber => write!(f, "the checksum is not a number"),
            Fault::Cut => write!(f, "the checksum is truncated, or followed by other characters"),
            Fault::Unchecked => write!(f, "a sentence without a checksum"),
        }
    }
}

impl<'t> Sentence<'t> {
    /// The sentence at the start of the bytes; `bare` allows a whole line without a checksum. Fails with what is wrong.
    pub(crate) fn at(bytes: &'t [u8], bare: bool) -> Result<Sentence<'t>, Fault> {
        let inner = bytes.get(1..bytes.len().min(LONGEST)).unwrap_or_default();
        let plain = |b: &u8| b.is_ascii_uppercase() || b.is_ascii_digit();
        // Checked first, because it rejects nearly everything that is not a sentence.
        if !inner.get(..3).is_some_and(|address| address.iter().all(plain)) {
            return Err(Fault::Address);
        }
        let end = inner.iter().position(|b| !(b' '..=b'~').contains(b) || b"*$".contains(b)).unwrap_or(inner.len());
        let body = inner.get(..end).and_then(|body| std::str::from_utf8(body).ok()).unwrap_or_default();
        let address = body.split(',').next().unwrap_or_default();
        // Manufacturers may write anything after their own letters.
        let own = if address.starts_with('P') { MAKER.min(address.len()) } else { address.len() };
        if address.len() < 3 || !address.as_bytes().iter().take(own).all(plain) {
            return Err(Fault::Address);
        }
        let rest = inner.get(end..).unwrap_or_default();
        // ETX and ESC too: they end a frame or a colour.
        let ends = |rest: &[u8]| rest.first().is_none_or(|b| b"\r\n\t \x03\x1b".contains(b));
        match *rest {
            // Non-digits after a right checksum are not part of this sentence, unless another checksum follows.
            [b'*', high, low, ref behind @ ..] if ends(behind) || is_apart(behind) => {
                let computed = body.bytes().fold(0, |sum, b| sum ^ b);
                match hexadecimal(high).zip(hexadecimal(low)).map(|(high, low)| high << 4 | low) {
                    Some(stated) if stated == computed => Ok(Sentence { body, length: end + 4, checked: true }),
                    Some(_) if !ends(behind) => Err(Fault::Cut),
                    Some(stated) => Err(Fault::Sum { stated, computed }),
                    None => Err(Fault::NoNumber),
                }
            }
            [b'*', ..] => Err(Fault::Cut),
            _ if bare && !rest.is_empty() && ends(rest) => Ok(Sentence { body, length: end + 1, checked: false }),
            _ => Err(Fault::Unchecked),
        }
    }

    /// Parses bytes that are known to be a sentence.
    pub(crate) fn of(bytes: &'t [u8]) -> Sentence<'t> {
        let inner = bytes.get(1..).unwrap_or_default();
        let (body, checked) = match inner.split_last_chunk() {
            Some((body, [b'*', _, _])) => (body, true),
            _ => (inner, false),
        };
        Sentence { body: std::str::from_utf8(body).unwrap_or_default(), length: bytes.len(), checked }
    }

    /// Talker and type: `GN` and `RMC`. For a proprietary sentence nothing and all of it, with the message as in
    /// `PUBX,00`, or its manufacturer where a text begins without a comma, as in `$PSRFTXTWK: 1488`.
    pub(crate) fn address(&self) -> (&'t str, &'t str) {
        let end = memchr(b',', self.body.as_bytes()).unwrap_or(self.body.len());
        let address = self.body.get(..end).unwrap_or_default();
        let plain = |b: u8| b.is_ascii_uppercase() || b.is_ascii_digit();
        let message = if NUMBERED.contains(&address) { self.field(1) } else { "" };
        if (2..=3).contains(&message.len()) && message.bytes().all(plain) {
            return ("", self.body.get(..address.len() + 1 + message.len()).unwrap_or(address));
        }
        let address = if address.bytes().all(plain) { address } else { address.get(..MAKER).unwrap_or(address) };
        let split = if address.starts_with('P') || address.len() != 5 { 0 } else { 2 };
        address.split_at_checked(split).unwrap_or(("", address))
    }

    /// Field `index`, from 1; empty if it does not exist.
    pub(crate) fn field(&self, index: usize) -> &'t str {
        let mut commas = memchr_iter(b',', self.body.as_bytes());
        let Some(start) = index.checked_sub(1).and_then(|before| commas.nth(before)) else { return "" };
        self.body.get(start + 1..commas.next().unwrap_or(self.body.len())).unwrap_or_default()
    }
}

/// Whether the bytes after a checksum are neither a digit of it nor the rest of its sentence with a checksum of its
/// own. A frame, which does not begin with a character, is neither.
fn is_apart(behind: &[u8]) -> bool {
    let rest = behind.split(|b| b"\n$".contains(b)).next().unwrap_or_default();
    let is_other = |b: &u8| !b.is_ascii() || (hexadecimal(*b).is_none() && memchr(b'*', rest).is_none());
    behind.first().is_none_or(is_other)
}

fn hexadecimal(digit: u8) -> Option<u8> {
    char::from(digit).to_digit(16).map(|d| d as u8)
}

/// A plain decimal number as written; `None` for an empty field, and for text that is not a number.
pub(crate) fn plain(text: &str) -> Option<&str> {
    let digits = text.strip_prefix(['-', '+']).unwrap_or(text);
    let (whole, fraction) = digits.split_once('.').unwrap_or((digits, ""));
    let all_digits = |t: &str| t.bytes().all(|b| b.is_ascii_digit());
    (whole.len() + fraction.len() > 0 && all_digits(whole) && all_digits(fraction)).then_some(text)
}

/// Degrees from `dddmm.mmmm` and a hemisphere, rounded once; negative to the south and west.
pub(crate) fn degrees(text: &str, hemisphere: &str) -> Option<f64> {
    let sign = match hemisphere {
        "N" | "E" => 1.0,
        "S" | "W" => -1.0,
        _ => return None,
    };
    let (whole, fraction) = plain(text)?.split_once('.').unwrap_or((text, ""));
    // More digits than a double holds are irrelevant: 1e-9 minutes are two micrometres.
    let fraction = fraction.get(..fraction.len().min(9))?;
    let (degrees, minutes) = whole.split_at_checked(whole.len().checked_sub(2)?)?;
    let scale = 10_u64.pow(u32::try_from(fraction.len()).ok()?);
    let number = |digits: &str| if digits.is_empty() { Some(0) } else { digits.parse::<u64>().ok() };
    let minutes = number(minutes)?.checked_mul(scale)?.checked_add(number(fraction)?)?;
    let degrees = number(degrees).filter(|d| *d <= 180)?;
    let parts = degrees * 60 * scale + minutes;
    (minutes < 60 * scale).then_some(sign * parts as f64 / (60 * scale) as f64)
}

/// Nanoseconds since midnight of `hhmmss.sss`. A leap second counts as the second after.
pub(crate) fn time_of_day_ns(text: &str) -> Option<i64> {
    let (whole, fraction) = plain(text)?.split_once('.').unwrap_or((text, ""));
    let two = |at: usize| whole.get(at..at + 2)?.parse::<i64>().ok();
    let [hour, minute, second] = [two(0)?, two(2)?, two(4)?];
    if whole.len() != 6 || hour > 23 || minute > 59 || second > 60 {
        return None;
    }
    let fraction = fraction.get(..fraction.len().min(9))?;
    let digits = if fraction.is_empty() { 0 } else { fraction.parse::<i64>().ok()? };
    let nanos = digits * 10_i64.pow(9 - u32::try_from(fraction.len()).ok()?);
    Some(((hour * 60 + minute) * 60 + second) * 1_000_000_000 + nanos)
}

#[cfg(test)]
mod tests {
    use super::*;

    const GGA: &str = "GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,";

    #[test]
    fn a_sentence_needs_its_checksum_unless_bare_ones_are_allowed() {
        let line = format!("${GGA}*47\r\n");
        let sentence = Sentence::at(line.as_bytes(), false).unwrap();
        assert_eq!((sentence.body, sentence.length, sentence.checked), (GGA, line.len() - 2, true));
        assert_eq!((sentence.address(), sentence.field(3), sentence.field(99)), (("GP", "GGA"), "N", ""));
        for (text, reason) in [
            (format!("${GGA}*48\r\n"), "is 48, and the sentence gives 47"),
            (format!("${GGA}*4"), "truncated"),
            (format!("${GGA}*477"), "other characters"),
            (format!("${GGA}*48,7"), "other characters"),
            (format!("${GGA}*4x"), "not a number"),
            (format!("${GGA}\r\n"), "without a checksum"),
            (format!("${GGA}"), "without a checksum"),
            ("$, *00".to_owned(), "address"),
        ] {
            let error = Sentence::at(text.as_bytes(), false).unwrap_err().to_string();
            assert!(error.contains(reason), "{text}: {error}");
        }
        assert!(Sentence::at(format!("${GGA}\r\n").as_bytes(), true).is_ok());
        assert_eq!(Sentence::at(format!("${GGA}*47,7").as_bytes(), false).unwrap().length, GGA.len() + 4);
    }

    #[test]
    fn only_a_manufacturer_may_write_texts_without_a_comma() {
        let sentence = Sentence::at(b"$PSRFTXTWK:   1488*4C\r\n", false).unwrap();
        assert_eq!((sentence.address(), sentence.checked), (("", "PSRF"), true));
        let sealed = |body: &str| format!("${body}*{:02X}\r\n", body.bytes().fold(0, |sum, b| sum ^ b));
        assert_eq!(Sentence::at(sealed("PGRMZ,93,f,3").as_bytes(), false).unwrap().address(), ("", "PGRMZ"));
        for body in ["GPGG ,1", "GPgga,1", "PS f,1"] {
            assert_eq!(Sentence::at(sealed(body).as_bytes(), false), Err(Fault::Address), "{body}");
        }
    }

    #[test]
    fn degrees_are_the_double_nearest_to_the_decimal_text() {
        // Python: float(Fraction(d) + Fraction(m) / 60).
        assert_eq!(degrees("4807.038", "N"), Some(48.1173));
        assert_eq!(degrees("01131.000", "E"), Some(11.516_666_666_666_667));
        assert_eq!(degrees("4717.11399012", "S"), Some(-47.285_233_168_666_664));
        for (text, hemisphere) in
            [("", "N"), ("4807.038", ""), ("4860.0", "N"), ("48x7.0", "N"), ("99999.0", "E"), ("7", "N")]
        {
            assert_eq!(degrees(text, hemisphere), None, "{text}");
        }
    }

    #[test]
    fn a_manufacturers_message_is_identified_by_its_first_field() {
        let address = |body| Sentence { body, length: 0, checked: true }.address();
        assert_eq!(address("PUBX,00,081350.00"), ("", "PUBX,00"));
        assert_eq!(address("PUBX,41"), ("", "PUBX,41"));
        assert_eq!(address("PTNL,GGK,102939.00"), ("", "PTNL,GGK"));
        assert_eq!(["PUBX,", "PUBX", "PUBX,x7,1", "PUBX,00000"].map(address), [("", "PUBX"); 4]);
        assert_eq!(address("PASHR,POS,1"), ("", "PASHR"));
    }

    #[test]
    fn times_of_day_are_exact() {
        assert_eq!(time_of_day_ns("123519"), Some(45_319_000_000_000));
        assert_eq!(time_of_day_ns("000000.123456789"), Some(123_456_789));
        assert_eq!(time_of_day_ns("235960.5"), Some(86_400_500_000_000));
        for text in ["", "12351", "1235199", "246000", "126000", "123461.1", "1e5"] {
            assert_eq!(time_of_day_ns(text), None, "{text}");
        }
    }
}
