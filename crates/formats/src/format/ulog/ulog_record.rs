//! The messages of a ULog, and how well their bytes vouch for themselves.
//!
//! A ULog has no checksums. Substitutes are lengths that follow from a definition, names that
//! were defined, a magic number, and the fact that another message follows.

use crate::bytes::Bytes;
use crate::decode::packed;
use crate::decode::schema::Number;

/// Length and type before every message.
pub(super) const HEAD: usize = 3;
/// Head and the longest message.
pub(super) const LONGEST: usize = HEAD + u16::MAX as usize;
/// Content of a sync message.
pub(super) const SYNC: [u8; 8] = [0x2f, 0x73, 0x13, 0x20, 0x25, 0x0c, 0xbb, 0x12];
/// Bytes of the flag bits: compatible ones, incompatible ones, three offsets.
pub(super) const FLAG_BITS: usize = 40;
/// Longest name that PX4 could give a format or a topic.
const LONGEST_NAME: usize = 128;
/// Zeros that pad a text.
const MOST_ZEROS_OF_TEXT: usize = 8;
/// Longest type of an information entry, as `uint16_t[1000]`.
const LONGEST_TYPE: usize = 64;

/// The type of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    FlagBits,
    Format,
    Info,
    InfoPart,
    Parameter,
    DefaultParameter,
    Subscribe,
    Unsubscribe,
    Data,
    Text,
    TaggedText,
    Sync,
    Dropout,
}

impl Kind {
    pub(super) const DATA: u8 = b'D';

    #[inline]
    pub(super) fn of(letter: u8) -> Option<Kind> {
        Some(match letter {
            b'B' => Kind::FlagBits,
            b'F' => Kind::Format,
            b'I' => Kind::Info,
            b'M' => Kind::InfoPart,
            b'P' => Kind::Parameter,
            b'Q' => Kind::DefaultParameter,
            b'A' => Kind::Subscribe,
            b'R' => Kind::Unsubscribe,
            Kind::DATA => Kind::Data,
            b'L' => Kind::Text,
            b'C' => Kind::TaggedText,
            b'S' => Kind::Sync,
            b'O' => Kind::Dropout,
            _ => return None,
        })
    }
}

/// How well a message vouches for itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Trust {
    /// Content and length agree with what is known.
    Sure,
    /// The content is right as far as can be checked; nothing vouches for the length.
    Fits,
    /// It may be a message.
    Weak,
    /// It is not a message, or a corrupt one.
    Wrong(&'static str),
}

/// Bytes of a message that are examined.
const GLANCE: usize = 64;
/// The same for a format; nearly all are shorter.
const FORMAT_GLANCE: usize = 2048;

/// Judges a message without the help of definitions.
pub(super) fn judge(kind: Kind, body: &[u8]) -> Trust {
    match kind {
        Kind::FlagBits => Trust::Wrong("flag bits that are not the first message"),
        Kind::Sync if body == SYNC => Trust::Sure,
        Kind::Sync => Trust::Wrong("a sync message with a wrong magic number"),
        Kind::Dropout | Kind::Unsubscribe if body.len() == 2 => Trust::Weak,
        Kind::Dropout => Trust::Wrong("a dropout with a wrong length"),
        Kind::Unsubscribe => Trust::Wrong("an unsubscription with a wrong length"),
        Kind::Format => format_trust(body),
        Kind::Info => Entry::parse(body).map_or(Trust::Wrong("a damaged information message"), Entry::trust),
        Kind::InfoPart | Kind::DefaultParameter => {
            let entry = body.get(1..).and_then(Entry::parse);
            entry.map_or(Trust::Wrong("a damaged information message or default parameter"), Entry::trust)
        }
        Kind::Parameter => Entry::parse(body).map_or(Trust::Wrong("a damaged parameter"), Entry::trust),
        Kind::Subscribe => match Subscription::parse(body) {
            Some(subscription) if is_name(subscription.name) => Trust::Fits,
            _ => Trust::Wrong("a subscription without a name"),
        },
        Kind::Text => text_trust(body, 9),
        Kind::TaggedText => text_trust(body, 11),
        Kind::Data if body.len() >= 2 => Trust::Weak,
        Kind::Data => Trust::Wrong("a message too short to hold its number"),
    }
}

/// The length of a short format agrees too: it ends with a field.
fn format_trust(body: &[u8]) -> Trust {
    const DAMAGED: Trust = Trust::Wrong("a damaged format");
    let head = body.get(..body.len().min(LONGEST_NAME)).unwrap_or_default();
    let Some(end) = memchr::memchr(b':', head).filter(|&end| head.get(..end.min(FORMAT_GLANCE)).is_some_and(is_name))
    else {
        return DAMAGED;
    };
    // Some writers leave the last semicolon out.
    let ends = |last: &u8| matches!(last, b';' | b'_') || last.is_ascii_alphanumeric();
    let fields = body.get(end + 1..).unwrap_or_default();
    if !fields.last().is_none_or(ends) || !body.iter().take(FORMAT_GLANCE).all(is_printable) {
        return DAMAGED;
    }
    match fields.last() {
        Some(b';') | None if body.len() <= FORMAT_GLANCE && fields.split(|&b| b == b';').all(is_field) => Trust::Sure,
        Some(_) => Trust::Fits,
        None => DAMAGED,
    }
}

/// Whether a character is valid in a format.
fn is_printable(character: &u8) -> bool {
    (b' '..=b'~').contains(character)
}

/// A type and a name, or nothing.
fn is_field(field: &[u8]) -> bool {
    let words: Vec<&[u8]> = field.split(|&b| b == b' ').filter(|word| !word.is_empty()).collect();
    matches!(words.as_slice(), [] | [_, _])
}

/// A text after its level, perhaps a tag, and a timestamp of less than two thousand years.
fn text_trust(body: &[u8], head: usize) -> Trust {
    let Some((head, text)) = body.split_at_checked(head) else { return Trust::Wrong("a text that is too short") };
    let level = head.first().is_some_and(|level| matches!(level, b'0'..=b'7'));
    // Some loggers write zeros after a text.
    let zeros = text.iter().rev().take(MOST_ZEROS_OF_TEXT).take_while(|b| **b == 0).count();
    let text = text.get(..text.len() - zeros).unwrap_or_default();
    let control = |b: &u8| *b < b' ' && !b"\x07\x08\t\n\r\x1b".contains(b);
    match level && head.last() == Some(&0) && !text.iter().take(GLANCE).any(control) {
        true => Trust::Fits,
        false => Trust::Wrong("a damaged logged text"),
    }
}

/// Names of formats and topics.
fn is_name(name: &[u8]) -> bool {
    let inner = |b: &u8| b.is_ascii_alphanumeric() | matches!(b, b'_' | b'-' | b'/');
    // Checks all of it, because that takes less time than finding its end.
    let plain = || name.iter().fold(true, |plain, b| plain & inner(b));
    name.len() <= LONGEST_NAME && !name.is_empty() && plain()
}

/// A key with its type, and the value: information, parameters, defaults.
#[derive(Debug, Clone, Copy)]
pub(super) struct Entry<'m> {
    pub(super) kind: &'m str,
    pub(super) name: &'m str,
    pub(super) value: &'m [u8],
}

impl<'m> Entry<'m> {
    pub(super) fn parse(body: &'m [u8]) -> Option<Entry<'m>> {
        let mut rest = Bytes(body);
        let length = rest.u8()?;
        let key = rest.take(length.into())?;
        // The type first: that rules out most non-keys quickly.
        let end = memchr::memchr(b' ', key.get(..key.len().min(LONGEST_TYPE))?)?;
        let (kind, name) = (std::str::from_utf8(key.get(..end)?).ok()?, key.get(end + 1..)?);
        let known = basic(kind).is_some() || array(kind).is_some();
        if !known || !kind.bytes().all(|b| is_printable(&b)) || !name.iter().all(is_printable) {
            return None;
        }
        let name = std::str::from_utf8(name).ok()?;
        (!name.is_empty()).then_some(Entry { kind, name, value: rest.0 })
    }

    fn trust(self) -> Trust {
        let size = match array(self.kind) {
            Some((element, count)) => basic(element).map_or(0, Basic::size).saturating_mul(count as usize),
            None => basic(self.kind).map_or(0, Basic::size),
        };
        if size == self.value.len() { Trust::Sure } else { Trust::Weak }
    }

    /// As a number, if it is a single one. A 32-bit float is what its shortest decimal says: 0.29, and not the
    /// double next to it.
    pub(super) fn number(&self) -> Option<f64> {
        let Basic::Number(number) = basic(self.kind)? else { return None };
        let value = packed::float_of(number, self.value)?;
        if number == Number::F32 { (value as f32).to_string().parse().ok() } else { Some(value) }
    }

    /// As text, if it is one.
    pub(super) fn text(&self) -> Option<String> {
        let is_text = array(self.kind).is_some_and(|(element, _)| element == "char");
        is_text.then(|| packed::text_of(self.value).into_owned())
    }
}

/// A topic with the number that its messages have.
#[derive(Debug, Clone, Copy)]
pub(super) struct Subscription<'m> {
    pub(super) instance: u8,
    pub(super) number: u16,
    pub(super) name: &'m [u8],
}

impl<'m> Subscription<'m> {
    /// A name that is too long is invalid.
    pub(super) fn parse(body: &'m [u8]) -> Option<Subscription<'m>> {
        let mut rest = Bytes(body);
        let (instance, number) = (rest.u8()?, rest.u16()?);
        (rest.0.len() <= LONGEST_NAME).then_some(Subscription { instance, number, name: rest.0 })
    }
}

/// What the first message states about the file.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct FlagBits {
    pub(super) incompatible: [u8; 8],
}

impl FlagBits {
    pub(super) fn parse(body: &[u8]) -> Option<FlagBits> {
        let mut rest = Bytes(body);
        rest.take(8)?;
        let incompatible = rest.take(8)?.try_into().ok()?;
        // Three offsets of appended data.
        rest.take(24)?;
        Some(FlagBits { incompatible })
    }

    /// Unknown flags. The first flag says that data were appended.
    pub(super) fn unknown(&self) -> bool {
        let [first, rest @ ..] = self.incompatible;
        first & !1 != 0 || rest.iter().any(|&flags| flags != 0)
    }
}

/// A type that needs no definition.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Basic {
    Number(Number),
    Char,
}

impl Basic {
    pub(super) fn size(self) -> usize {
        match self {
            Basic::Number(number) => number.size() as usize,
            Basic::Char => 1,
        }
    }
}

pub(super) fn basic(name: &str) -> Option<Basic> {
    Some(Basic::Number(match name {
        "char" => return Some(Basic::Char),
        "bool" => Number::Bool,
        "int8_t" => Number::I8,
        "uint8_t" => Number::U8,
        "int16_t" => Number::I16,
        "uint16_t" => Number::U16,
        "int32_t" => Number::I32,
        "uint32_t" => Number::U32,
        "int64_t" => Number::I64,
        "uint64_t" => Number::U64,
        "float" => Number::F32,
        "double" => Number::F64,
        _ => return None,
    }))
}

/// Element type and count of `float[3]`.
pub(super) fn array(name: &str) -> Option<(&str, u32)> {
    let (element, count) = name.strip_suffix(']')?.split_once('[')?;
    Some((element, count.parse().ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(key: &str, value: &[u8]) -> Vec<u8> {
        [&[key.len() as u8][..], key.as_bytes(), value].concat()
    }

    #[test]
    fn a_parameter_vouches_for_itself_by_its_type_and_length() {
        let whole = entry("float EKF2_GPS_DELAY", &110_f32.to_le_bytes());
        assert_eq!(judge(Kind::Parameter, &whole), Trust::Sure);
        assert_eq!(Entry::parse(&whole).unwrap().number(), Some(110.0));
        assert_eq!(judge(Kind::Parameter, &whole[..whole.len() - 1]), Trust::Weak);
        assert!(matches!(judge(Kind::Parameter, &entry("flaot A", &[0; 4])), Trust::Wrong(_)));
    }

    #[test]
    fn invalid_formats_texts_and_syncs_are_detected() {
        assert_eq!(judge(Kind::Format, b"a:float x;"), Trust::Sure);
        assert_eq!(judge(Kind::Format, b"a:float x"), Trust::Fits);
        for text in [&b"6\0\0\0\0\0\0\0\0hello"[..], b"6\0\0\0\0\0\0\0\0hello\x07\0\0", b"6\0\0\0\0\0\0\0\0"] {
            assert_eq!(judge(Kind::Text, text), Trust::Fits);
        }
        for name in ["/fmu/out/x", "_x", "-x", "a/b-c_d"] {
            assert_eq!(judge(Kind::Format, format!("{name}:float x;").as_bytes()), Trust::Sure, "{name}");
        }
        assert_eq!(judge(Kind::Sync, &SYNC), Trust::Sure);
        for (kind, body) in [
            (Kind::Format, &b"a:float "[..]),
            (Kind::Format, b"a:fl\0at x;"),
            (Kind::Format, b":float x;"),
            (Kind::Text, b"9\0\0\0\0\0\0\0\0hello"),
            (Kind::Text, b"6\0\0\0\0\0\0\0\x01hello"),
            (Kind::Text, b"6\0\0\0\0\0\0\0\0he\x02lo"),
            (Kind::Text, b"6\0\0\0\0\0\0\0\0he\0lo"),
            (Kind::Format, b":uint64_t timestamp;"),
            (Kind::Sync, &SYNC[1..]),
            (Kind::Subscribe, b"\0\0\0"),
        ] {
            assert!(matches!(judge(kind, body), Trust::Wrong(_)), "{kind:?} {body:?}");
        }
    }

    #[test]
    fn unknown_flags_are_detected() {
        let mut body = [0; FLAG_BITS];
        body[8] = 1;
        let bits = FlagBits::parse(&body).unwrap();
        assert!(!bits.unknown());
        body[10] = 4;
        assert!(FlagBits::parse(&body).unwrap().unknown());
        assert_eq!(FlagBits::parse(&body[1..]), None);
    }
}
