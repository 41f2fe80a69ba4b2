//! Splits a record into fields and parses numbers.

use super::formula::restored;
use std::borrow::Cow;

/// The largest integer up to which a double holds every integer.
pub(super) const EXACT: u64 = 1 << 53;

/// Stands for a delimiter that is any run of spaces and TABs.
pub(super) const BLANKS: u8 = b' ';

/// The fields of one record, unquoted and without padding.
#[derive(Debug, Clone, Copy)]
pub(super) struct Row<'t> {
    text: &'t [u8],
    spans: &'t [(usize, usize)],
}

impl<'t> Row<'t> {
    /// From fields at the `spans` of a text.
    pub(super) fn new(text: &'t [u8], spans: &'t [(usize, usize)]) -> Row<'t> {
        Row { text, spans }
    }

    /// The number of fields.
    #[inline]
    pub(super) fn len(self) -> usize {
        self.spans.len()
    }

    /// One field without padding; empty if it does not exist.
    #[inline]
    pub(super) fn get(self, index: usize) -> &'t [u8] {
        let span = self.spans.get(index).copied().unwrap_or_default();
        self.text.get(span.0..span.1).unwrap_or_default().trim_ascii()
    }
}

/// The fields of one record. Reused from record to record.
#[derive(Debug, Default)]
pub(super) struct Fields {
    text: Vec<u8>,
    spans: Vec<(usize, usize)>,
    quoted: Option<Quoted>,
}

/// Splits records with quotes by the rules of `csv_core`. Creating one takes longer than reading a record.
#[derive(Debug)]
struct Quoted {
    delimiter: u8,
    core: Box<csv_core::Reader>,
    /// The ends of the fields of a record.
    ends: Vec<usize>,
}

impl Quoted {
    fn new(delimiter: u8) -> Quoted {
        let core = csv_core::ReaderBuilder::new().delimiter(delimiter).terminator(csv_core::Terminator::Any(0)).build();
        Quoted { delimiter, core: Box::new(core), ends: vec![] }
    }

    /// Writes the fields of a record one after the other into `text`, and their positions into `spans`.
    fn split(&mut self, mut record: &[u8], text: &mut Vec<u8>, spans: &mut Vec<(usize, usize)>) {
        self.core.reset();
        // No field is longer than its encoded form, and each but the last is followed by a delimiter.
        text.resize(record.len(), 0);
        self.ends.resize(record.len() + 1, 0);
        let (mut written, mut count) = (0, 0);
        loop {
            let (into, ends) = (text.get_mut(written..), self.ends.get_mut(count..));
            let (Some(into), Some(ends)) = (into, ends) else { break };
            let (result, read, wrote, ended) = self.core.read_record(record, into, ends);
            record = record.get(read..).unwrap_or_default();
            written += wrote;
            count += ended;
            // An empty input ends the record.
            if result != csv_core::ReadRecordResult::InputEmpty {
                break;
            }
        }
        text.truncate(written);
        let mut from = 0;
        for &end in self.ends.get(..count).unwrap_or_default() {
            spans.push((from, end));
            from = end;
        }
    }
}

impl Fields {
    /// Takes the fields of `record`.
    pub(super) fn split(&mut self, record: &[u8], delimiter: u8) {
        self.split_with(record, delimiter, true);
    }

    /// Like [`Fields::split`], for a record that contains quotes only if it `may`.
    pub(super) fn split_with(&mut self, record: &[u8], delimiter: u8, may: bool) {
        self.text.clear();
        self.spans.clear();
        if delimiter == BLANKS {
            self.split_blanks(record);
        } else if may && memchr::memchr(b'"', record).is_some() {
            self.split_quoted(record, delimiter);
        } else {
            self.split_plain(record, delimiter);
        }
    }

    fn split_plain(&mut self, record: &[u8], delimiter: u8) {
        self.text.extend_from_slice(record);
        let mut from = 0;
        let mut end = |at| {
            self.spans.push((from, at));
            from = at + 1;
        };
        // In a short row a search takes longer than checking each byte.
        if record.len() < 32 {
            record.iter().enumerate().filter(|(_, byte)| **byte == delimiter).for_each(|(at, _)| end(at));
        } else {
            memchr::memchr_iter(delimiter, record).for_each(&mut end);
        }
        end(record.len());
    }

    /// Any run of blanks is one delimiter.
    fn split_blanks(&mut self, record: &[u8]) {
        self.text.extend_from_slice(record);
        let mut from = None;
        for (at, byte) in record.iter().chain(b" ").enumerate() {
            match (byte.is_ascii_whitespace(), from) {
                (true, Some(start)) => {
                    self.spans.push((start, at));
                    from = None;
                }
                (false, None) => from = Some(at),
                _ => {}
            }
        }
    }

    fn split_quoted(&mut self, record: &[u8], delimiter: u8) {
        let quoted = match &mut self.quoted {
            Some(quoted) if quoted.delimiter == delimiter => quoted,
            other => other.insert(Quoted::new(delimiter)),
        };
        quoted.split(record, &mut self.text, &mut self.spans);
    }

    /// The number of fields.
    pub(super) fn len(&self) -> usize {
        self.spans.len()
    }

    /// Like [`Row::get`].
    pub(super) fn get(&self, index: usize) -> &[u8] {
        self.row().get(index)
    }

    /// The fields as a row.
    pub(super) fn row(&self) -> Row<'_> {
        Row::new(&self.text, &self.spans)
    }

    /// All fields as text.
    pub(super) fn texts(&self) -> Vec<String> {
        (0..self.len()).map(|i| text_of(self.get(i)).into_owned()).collect()
    }
}

/// UTF-8, or if invalid Latin-1, in which every byte is a character.
pub(super) fn text_of(cell: &[u8]) -> Cow<'_, str> {
    match std::str::from_utf8(cell) {
        Ok(text) => text.into(),
        Err(_) => cell.iter().map(|&byte| char::from(byte)).collect(),
    }
}

/// Decimal separator of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) enum Decimal {
    #[default]
    Point,
    /// A point is not part of a number then, because it would separate thousands.
    Comma,
}

impl Decimal {
    /// Reads a trimmed cell as a number.
    #[inline]
    pub(super) fn number(self, cell: &[u8]) -> Cell {
        match self {
            Decimal::Point => number(cell),
            Decimal::Comma if memchr::memchr(b'.', cell).is_some() => match number(cell) {
                Cell::Missing => Cell::Missing,
                _ => Cell::Bad,
            },
            Decimal::Comma => match memchr::memchr(b',', cell) {
                Some(at) => number_with_point(cell, at),
                None => number(cell),
            },
        }
    }

    /// A cell as text. A decimal comma becomes a point, as in numbers: `17:27:44,3` becomes `17:27:44.3`. An apostrophe
    /// that [`inert`](super::inert) added is removed.
    pub(super) fn text(self, cell: &[u8]) -> Cow<'_, str> {
        let text = text_of(cell);
        if cell.first() == Some(&b'\'') {
            return restored(&text).to_owned().into();
        }
        if memchr::memchr(b',', cell).is_none() {
            return text;
        }
        let one_comma = || text.bytes().filter(|b| *b == b',').count() == 1;
        let of_number = |b: u8| b.is_ascii_digit() || b"+-:,eETZ ".contains(&b);
        let of_decimals = || self == Decimal::Comma && text.bytes().all(of_number);
        if one_comma() && (of_decimals() || is_time_with_comma(&text)) { text.replace(',', ".").into() } else { text }
    }
}

/// Whether the comma is the ISO 8601 decimal sign in seconds, as Python's logging writes it: `2024-05-10 17:27:44,300`.
fn is_time_with_comma(text: &str) -> bool {
    let Some((time, fraction)) = text.split_once(',') else { return false };
    let mut parts = time.rsplit(':');
    let two_digits = |part: &str| part.len() == 2 && part.bytes().all(|b| b.is_ascii_digit());
    let seconds = [parts.next(), parts.next()].into_iter().all(|part| part.is_some_and(two_digits));
    let seconds = seconds && parts.next().is_some_and(|hour| hour.ends_with(|c: char| c.is_ascii_digit()));
    let zone = fraction.trim_start_matches(|c: char| c.is_ascii_digit());
    seconds && zone.len() < fraction.len() && (zone.is_empty() || zone.starts_with(['Z', '+', '-', ' ']))
}

/// A number with a decimal comma at `at`.
fn number_with_point(cell: &[u8], at: usize) -> Cell {
    const LONGEST: usize = 64;
    let mut plain = [0; LONGEST];
    let Some(space) = plain.get_mut(..cell.len()) else { return Cell::Bad };
    space.copy_from_slice(cell);
    if let Some(comma) = space.get_mut(at) {
        *comma = b'.';
    }
    number(space)
}

/// The possible meanings of a cell of digits and commas.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum CommaCell {
    /// `1,25`: only decimals.
    Decimals,
    /// `1,250` or `1,250,000`: decimals or thousands.
    Either,
}

/// The meaning of a comma in a cell; `None` if the cell is not a number with a comma.
pub(super) fn comma_cell(cell: &str) -> Option<CommaCell> {
    let digits = cell.trim_start_matches(['+', '-']);
    let digits = digits.split(['e', 'E']).next().unwrap_or_default();
    let mut groups = digits.split(',');
    let whole = groups.next()?;
    let rest: Vec<&str> = groups.collect();
    let all_digits = |group: &str| group.bytes().all(|b| b.is_ascii_digit());
    if rest.is_empty() || !all_digits(whole) || !rest.iter().all(|g| all_digits(g) && !g.is_empty()) {
        return None;
    }
    let thousands = rest.iter().all(|g| g.len() == 3) && (1..=3).contains(&whole.len()) && whole != "0";
    if thousands { Some(CommaCell::Either) } else { (rest.len() == 1).then_some(CommaCell::Decimals) }
}

/// A cell that was requested as a number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Cell {
    /// Empty.
    Empty,
    /// An integer that fits.
    Integer(i64),
    /// Any other finite number, correctly rounded.
    Float(f64),
    /// `nan`, `inf` or beyond the range of a double.
    NotFinite,
    /// A word for a missing value, such as `N/A`.
    Missing,
    /// Not a number.
    Bad,
}

/// Reads a trimmed cell as a number.
#[inline]
pub(super) fn number(cell: &[u8]) -> Cell {
    short_number(cell).or_else(|| decimal(cell)).unwrap_or_else(|| any_number(cell))
}

/// A decimal of any length, in digits: words are for [`any_number`].
#[inline]
fn decimal(cell: &[u8]) -> Option<Cell> {
    let (first, unsigned) = cell.strip_prefix(b"-").unwrap_or(cell).split_first()?;
    if !first.is_ascii_digit() || !unsigned.contains(&b'.') {
        return None;
    }
    fast_float2::parse(cell).ok().filter(|value: &f64| value.is_finite()).map(Cell::Float)
}

/// What databases, spreadsheets and programs write for a missing value, in lower case.
const NOTHING: &[&str] = &[
    "-",
    "--",
    "---",
    "n/a",
    "na",
    "<na>",
    "#n/a",
    "#na",
    "null",
    "none",
    "nil",
    "-nan(ind)",
    "nan(ind)",
    "1.#ind",
    "-1.#ind",
    "1.#qnan",
    "-1.#qnan",
    "1.#inf",
    "-1.#inf",
];

fn is_nothing(text: &str) -> bool {
    text.len() <= 9 && NOTHING.iter().any(|word| text.eq_ignore_ascii_case(word))
}

fn any_number(cell: &[u8]) -> Cell {
    if cell.is_empty() {
        return Cell::Empty;
    }
    let Ok(text) = std::str::from_utf8(cell) else { return Cell::Bad };
    // "-0" must keep its sign, so it is not an integer here.
    if let Ok(integer) = text.parse::<i64>()
        && (integer != 0 || !text.starts_with('-'))
    {
        return Cell::Integer(integer);
    }
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() => Cell::Float(value),
        Ok(_) => Cell::NotFinite,
        Err(_) if is_nothing(text) => Cell::Missing,
        Err(_) => Cell::Bad,
    }
}

/// An integer or a decimal of up to nineteen digits, at once.
#[inline]
fn short_number(cell: &[u8]) -> Option<Cell> {
    const DIGITS: usize = 19;
    let (negative, unsigned) = cell.strip_prefix(b"-").map_or((false, cell), |rest| (true, rest));
    // A zero before the point is a digit that makes nothing longer.
    if unsigned.len() > DIGITS + 1 + usize::from(unsigned.starts_with(b"0.")) {
        return None;
    }
    let (whole, rest) = digits(0, unsigned);
    let Some((point, decimals)) = rest.split_first() else {
        let integer = i64::try_from(whole).ok().filter(|_| (1..=DIGITS).contains(&unsigned.len()))?;
        // A zero may have a sign.
        return if negative { (integer != 0).then_some(Cell::Integer(-integer)) } else { Some(Cell::Integer(integer)) };
    };
    let (number, rest) = digits(whole, decimals);
    if *point != b'.' || !rest.is_empty() || unsigned.len() == 1 {
        return None;
    }
    let value = quotient(number, decimals.len())?;
    Some(Cell::Float(if negative { -value } else { value }))
}

/// Appends the digits at the start of `text` to those of `number`: nineteen in all at most.
#[inline]
fn digits(mut number: u64, mut text: &[u8]) -> (u64, &[u8]) {
    while let Some((eight, rest)) = text.split_first_chunk()
        && let Some(next) = eight_digits(u64::from_le_bytes(*eight))
    {
        number = number.wrapping_mul(100_000_000).wrapping_add(next);
        text = rest;
    }
    while let Some((digit @ b'0'..=b'9', rest)) = text.split_first() {
        number = number.wrapping_mul(10).wrapping_add(u64::from(digit - b'0'));
        text = rest;
    }
    (number, text)
}

/// The value of eight digits, the first one in the lowest byte. Bytes are joined to pairs, pairs to fours, and fours to
/// the number (D. Lemire, "Quickly parsing eight digits", 2018).
#[inline]
fn eight_digits(text: u64) -> Option<u64> {
    const ZEROS: u64 = 0x3030_3030_3030_3030;
    const HIGH: u64 = 0xf0f0_f0f0_f0f0_f0f0;
    // Bytes above '9' would carry into the high half.
    if (text & HIGH) != ZEROS || ((text + 0x0606_0606_0606_0606) & HIGH) != ZEROS {
        return None;
    }
    let ones = text - ZEROS;
    let pairs = ones * 10 + (ones >> 8);
    const PAIRS: u64 = 0x0000_00ff_0000_00ff;
    let low = (pairs & PAIRS).wrapping_mul(0x000f_4240_0000_0064);
    let high = (pairs >> 16 & PAIRS).wrapping_mul(0x0000_2710_0000_0001);
    Some(low.wrapping_add(high) >> 32)
}

/// The double nearest to `number` / 10^`tens`. If a double holds both exactly, one division gives it (Clinger, PLDI
/// 1990). Otherwise the integer quotient has at least eleven bits more than a double, and its lowest bit is set if there
/// is a remainder.
#[inline]
fn quotient(number: u64, tens: usize) -> Option<f64> {
    #[rustfmt::skip]
    const TENS: [u64; 20] = [
        1, 10, 100, 1_000, 10_000, 100_000, 1_000_000, 10_000_000, 100_000_000, 1_000_000_000,
        10_000_000_000, 100_000_000_000, 1_000_000_000_000, 10_000_000_000_000, 100_000_000_000_000,
        1_000_000_000_000_000, 10_000_000_000_000_000, 100_000_000_000_000_000, 1_000_000_000_000_000_000, 10_000_000_000_000_000_000,
    ];
    let divisor = *TENS.get(tens)?;
    if number <= EXACT {
        return Some(number as f64 / divisor as f64);
    }
    let shift = u64::BITS + number.leading_zeros();
    let (dividend, divisor) = (u128::from(number) << shift, u128::from(divisor));
    let remains = u128::from(dividend % divisor != 0);
    // A power of two: only the exponent bits.
    let scale = f64::from_bits(u64::from(1023 - shift) << 52);
    Some(((dividend / divisor) | remains) as f64 * scale)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eight_digits_are_read_and_any_other_byte_is_refused() {
        for (place, byte) in (0..8).flat_map(|place| (0..=u8::MAX).map(move |byte| (place, byte))) {
            let mut text = *b"12345678";
            text[place] = byte;
            let number = byte.is_ascii_digit().then(|| std::str::from_utf8(&text).unwrap().parse::<u64>().unwrap());
            assert_eq!(eight_digits(u64::from_le_bytes(text)), number, "{byte:#x} at {place}");
        }
        assert_eq!(eight_digits(u64::from_le_bytes(*b"99999999")), Some(99_999_999));
    }

    fn split(record: &str, delimiter: u8) -> Vec<String> {
        let mut fields = Fields::default();
        fields.split(record.as_bytes(), delimiter);
        fields.texts()
    }

    #[test]
    fn padding_goes_and_empty_fields_stay() {
        assert_eq!(split(" a ,, b,", b','), ["a", "", "b", ""]);
        assert_eq!(split("1;2,5;3", b';'), ["1", "2,5", "3"]);
    }

    #[test]
    fn quotes_hide_delimiters_line_ends_and_doubled_quotes() {
        assert_eq!(split("\"a,b\",\"c\nd\",\"e\"\"f\",g", b','), ["a,b", "c\nd", "e\"f", "g"]);
    }

    #[test]
    fn runs_of_blanks_are_one_delimiter() {
        assert_eq!(split("   1.0e+00  -2\t3  ", BLANKS), ["1.0e+00", "-2", "3"]);
        assert_eq!(split("   ", BLANKS), Vec::<String>::new());
    }

    #[test]
    fn a_decimal_comma_is_read_and_a_point_next_to_it_rejected() {
        let comma = |cell: &str| Decimal::Comma.number(cell.as_bytes());
        assert_eq!(comma("-1,5e-3"), Cell::Float(-1.5e-3));
        assert_eq!((comma("7"), comma(""), comma("nan")), (Cell::Integer(7), Cell::Empty, Cell::NotFinite));
        for bad in ["1.5", "1.234,5", "1,234,5", ",", "a,b"] {
            assert_eq!(comma(bad), Cell::Bad, "{bad}");
        }
        assert_eq!(Decimal::Comma.text(b"17:27:44,3"), "17:27:44.3");
        assert_eq!(Decimal::Comma.text(b"a, b"), "a, b");
        assert_eq!(Decimal::Point.text(b"1,5"), "1,5");
        for (text, point) in [
            ("17:27:44,3", "17:27:44.3"),
            ("2024-05-10 17:27:44,300", "2024-05-10 17:27:44.300"),
            ("2024-05-10T17:27:44,3+02:00", "2024-05-10T17:27:44.3+02:00"),
        ] {
            assert_eq!(Decimal::Point.text(text.as_bytes()), point);
        }
        for other in ["17:27:44,", "17:27,5", "a:44,3", "17:27:44,3,4", "17:27:44,3 m/s,x", "at 17:27:44, then"] {
            assert_eq!(Decimal::Point.text(other.as_bytes()), other);
        }
    }

    #[test]
    fn thousands_commas_are_distinguished_from_decimal_commas_if_possible() {
        for cell in ["1,5", "0,125", "-12,25e3", "1234,567", ",5"] {
            assert_eq!(comma_cell(cell), Some(CommaCell::Decimals), "{cell}");
        }
        for cell in ["1,250", "-12,345", "1,250,000"] {
            assert_eq!(comma_cell(cell), Some(CommaCell::Either), "{cell}");
        }
        for cell in ["", "1", "1.5", "1,5,25", "a,5", "1,", "x"] {
            assert_eq!(comma_cell(cell), None, "{cell}");
        }
    }

    #[test]
    fn a_number_is_the_nearest_double_and_an_integer_is_exact() {
        assert_eq!(number(b"1531943812200143162"), Cell::Integer(1_531_943_812_200_143_162));
        assert_eq!(number(b"1e5"), Cell::Float(1e5));
        assert_eq!(number(b"1E+05"), Cell::Float(1e5));
        // 2^53 + 1 is half-way between two doubles; ties go to the even one.
        assert_eq!(number(b"9007199254740993.0"), Cell::Float(9_007_199_254_740_992.0));
        assert!(matches!(number(b"-0"), Cell::Float(zero) if zero.is_sign_negative()));
    }

    #[test]
    fn a_short_number_equals_that_of_the_standard_library() {
        let mut seed = 1_u64;
        for _ in 0..20_000 {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let digits = format!("{:020}", u128::from(seed) * 5);
            let (length, point) = ((seed >> 3) as usize % 20, (seed >> 7) as usize % 24);
            let digits = &digits[digits.len() - 20..];
            let mut text = digits[..length].to_owned();
            if point <= length {
                text.insert(point, '.');
            }
            let text = if seed.is_multiple_of(3) { format!("-{text}") } else { text };
            let Some(short) = short_number(text.as_bytes()) else { continue };
            let expected = match text.parse::<i64>() {
                Ok(integer) => Cell::Integer(integer),
                Err(_) => Cell::Float(text.parse().unwrap()),
            };
            assert_eq!(short, expected, "{text}");
        }
    }

    #[test]
    fn a_short_number_has_no_exponent_no_plus_and_no_more_digits_than_fit() {
        let read = [
            "0.1",
            "-12.5",
            "123456789012345",
            ".5",
            "7.",
            "0",
            "0.0",
            "45.999984572",
            "1700000000.000091",
            "1531943812200143162",
            "-0.0",
        ];
        assert!(read.iter().all(|text| short_number(text.as_bytes()).is_some()));
        let left = ["", "-", ".", "-0", "1e5", "+1", "1.2.3", "9223372036854775808", "0.12345678901234567890", "1,5"];
        assert!(left.iter().all(|text| short_number(text.as_bytes()).is_none()));
    }

    #[test]
    fn a_decimal_equals_that_of_the_standard_library() {
        let mut seed = 7_u64;
        for _ in 0..20_000 {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let digits = (seed >> 3) as usize % 40 + 1;
            let point = (seed >> 9) as usize % (digits + 1);
            let mut text: String =
                (0..digits).map(|i| char::from(b'0' + (seed.rotate_right(3 * i as u32) % 10) as u8)).collect();
            text.insert(point, '.');
            text += ["", "e-5", "E+12", "e400", "e", " ", "x"][(seed >> 50) as usize % 7];
            let text = if seed & 1 == 0 { format!("-{text}") } else { text };
            match (text.parse::<f64>(), number(text.as_bytes())) {
                (Ok(value), Cell::Float(read)) => assert_eq!(read.to_bits(), value.to_bits(), "{text}"),
                (Ok(value), read) => assert!(value.is_infinite() && read == Cell::NotFinite, "{text}: {read:?}"),
                (Err(_), read) => assert_eq!(read, Cell::Bad, "{text}"),
            }
        }
    }

    #[test]
    fn cells_that_are_not_finite_numbers_are_distinguished() {
        assert_eq!(number(b""), Cell::Empty);
        for text in ["nan", "NaN", "inf", "-inf", "1e999"] {
            assert_eq!(number(text.as_bytes()), Cell::NotFinite, "{text}");
        }
        for text in ["N/A", "n/a", "null", "None", "-", "--", "#N/A", "-1.#IND", "-nan(ind)"] {
            assert_eq!(number(text.as_bytes()), Cell::Missing, "{text}");
            assert_eq!(Decimal::Comma.number(text.as_bytes()), Cell::Missing, "{text}");
        }
        for text in ["N/A?", "0x12", "1,234", "1.2.3", "12:30", "1 2", "\u{ff}", "+", "."] {
            assert_eq!(number(text.as_bytes()), Cell::Bad, "{text}");
        }
        assert_eq!(number(b"\xff"), Cell::Bad);
    }
}
