//! The contents of a ULog besides its topics, as texts by name: information, parameters with defaults and changes,
//! logged texts, and dropouts. Every value is kept: a float has a point or an exponent; values other than numbers and
//! text are their type and bytes.

use super::about::level_name;
use super::ulog_record::{Basic, Entry, Kind, basic};
use crate::bytes::Bytes;
use crate::decode::Topics;
use crate::decode::packed::number_of;
use crate::decode::rows::Value;
use crate::decode::schema::Number;
use crate::reader::Extra;
use std::collections::BTreeMap;
use std::fmt::Write;

/// Bytes collected before they are passed on.
const MOST: usize = 1 << 20;

const INFORMATION: &str = "ulog information";
const PARAMETERS: &str = "ulog parameters";
const DEFAULTS: &str = "ulog default parameters";
const CHANGES: &str = "ulog parameter changes";
const TEXTS: &str = "ulog texts";
const DROPOUTS: &str = "ulog dropouts";

/// Collects the texts of one file.
#[derive(Debug, Default)]
pub(super) struct Beside {
    sets: BTreeMap<&'static str, BTreeMap<String, String>>,
    bytes: usize,
    /// Key of the multi-part information in progress.
    part: String,
    /// Count of texts, changes and the like so far.
    count: u64,
}

impl Beside {
    /// Takes a message; `at_us` is the time of parameter changes, and `None` during the definitions.
    pub(super) fn take(&mut self, kind: Kind, body: &[u8], at_us: Option<u64>, topics: &Topics<'_>) {
        // An invalid entry is damaged, and reported as such.
        let _ = match kind {
            Kind::Info => Entry::parse(body).map(|entry| self.set(INFORMATION, entry.name.to_owned(), value(&entry))),
            Kind::InfoPart => self.part(body),
            Kind::Parameter => Entry::parse(body).map(|entry| self.parameter(&entry, at_us)),
            Kind::DefaultParameter => self.default_parameter(body),
            Kind::Text => self.text(body, false),
            Kind::TaggedText => self.text(body, true),
            Kind::Dropout => Bytes(body).u16().map(|ms| {
                let key = self.next(at_us.unwrap_or_default());
                self.set(DROPOUTS, key, format!("{ms} ms"));
            }),
            _ => None,
        };
        if self.bytes > MOST {
            self.hand_on(topics);
        }
    }

    /// Passes everything collected to its receiver.
    pub(super) fn hand_on(&mut self, topics: &Topics<'_>) {
        for (name, entries) in std::mem::take(&mut self.sets) {
            topics.extra(&Extra::Metadata { name, entries: &entries });
        }
        self.bytes = 0;
    }

    /// A key that occurs again with another value gets a number.
    fn set(&mut self, name: &'static str, key: String, value: String) {
        self.bytes += key.len() + value.len();
        let set = self.sets.entry(name).or_default();
        let mut free = key.clone();
        let mut count = 1;
        while set.get(&free).is_some_and(|known| *known != value) {
            count += 1;
            free = format!("{key} ({count})");
        }
        set.insert(free, value);
    }

    /// Number and time of a text: keys are sorted, so this keeps the order of the log.
    fn next(&mut self, at_us: u64) -> String {
        self.count += 1;
        format!("#{:06} at {}.{:06} s", self.count, at_us / 1_000_000, at_us % 1_000_000)
    }

    /// Multi-part information: parts that continue the previous one are joined into one text.
    fn part(&mut self, body: &[u8]) -> Option<()> {
        let goes_on = *body.first()? != 0;
        let entry = Entry::parse(body.get(1..)?)?;
        let set = self.sets.entry(INFORMATION).or_default();
        let value = value(&entry);
        self.bytes += entry.name.len() + value.len();
        let same = |part: &str| part.rsplit_once(" #").is_some_and(|(name, _)| name == entry.name);
        if let Some(text) = set.get_mut(&self.part).filter(|_| goes_on && same(&self.part)) {
            text.push_str(&value);
            return Some(());
        }
        self.count += 1;
        self.part = format!("{} #{:06}", entry.name, self.count);
        set.insert(self.part.clone(), value);
        Some(())
    }

    fn parameter(&mut self, entry: &Entry<'_>, at_us: Option<u64>) {
        match at_us {
            None => self.set(PARAMETERS, entry.name.to_owned(), value(entry)),
            Some(at_us) => {
                let key = format!("{}: {}", self.next(at_us), entry.name);
                self.set(CHANGES, key, value(entry));
            }
        }
    }

    /// The first byte says whose default it is: the system's, or this airframe configuration's.
    fn default_parameter(&mut self, body: &[u8]) -> Option<()> {
        let of = *body.first()?;
        let entry = Entry::parse(body.get(1..)?)?;
        let key = match of & 3 {
            1 => format!("{}: system", entry.name),
            2 => format!("{}: configuration", entry.name),
            3 => format!("{}: system and configuration", entry.name),
            _ => format!("{}: {of}", entry.name),
        };
        self.set(DEFAULTS, key, value(&entry));
        Some(())
    }

    fn text(&mut self, body: &[u8], tagged: bool) -> Option<()> {
        let mut rest = Bytes(body);
        let level = rest.u8()?;
        let tag = if tagged { format!(" [{}]", rest.u16()?) } else { String::new() };
        let at_us = rest.u64()?;
        let key = format!("{}: {}{tag}", self.next(at_us), level_name(level));
        let text = rest.0.strip_suffix(&[0]).unwrap_or(rest.0);
        self.set(TEXTS, key, std::str::from_utf8(text).map_or_else(|_| bytes("char", text), str::to_owned));
        Some(())
    }
}

fn value(entry: &Entry<'_>) -> String {
    let otherwise = || bytes(entry.kind, entry.value);
    if entry.text().is_some() {
        let end = entry.value.iter().rposition(|&b| b != 0).map_or(0, |last| last + 1);
        let text = entry.value.get(..end).and_then(|text| std::str::from_utf8(text).ok());
        return text.filter(|text| !text.contains('\0')).map_or_else(otherwise, str::to_owned);
    }
    let number = match basic(entry.kind) {
        Some(Basic::Number(Number::F32 | Number::F64)) => entry.number().map(|x| format!("{x:?}")),
        Some(Basic::Number(number)) => match number_of(number, entry.value) {
            Some(Value::Float(x)) => Some(x.to_string()),
            Some(Value::Integer(x)) => Some(x.to_string()),
            _ => None,
        },
        _ => None,
    };
    number.unwrap_or_else(otherwise)
}

fn bytes(kind: &str, value: &[u8]) -> String {
    let mut text = format!("{kind} 0x");
    for byte in value {
        let _ = write!(text, "{byte:02x}");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shown(kind: &str, value: &[u8]) -> String {
        super::value(&Entry { kind, name: "x", value })
    }

    #[test]
    fn every_value_is_recoverable_from_its_text() {
        assert_eq!(shown("float", &110_f32.to_le_bytes()), "110.0");
        assert_eq!(shown("float", &0.29_f32.to_le_bytes()), "0.29");
        assert_eq!(shown("int32_t", &(-7_i32).to_le_bytes()), "-7");
        assert_eq!(shown("uint64_t", &(1_u64 << 60 | 1).to_le_bytes()), "1152921504606846977");
        assert_eq!(shown("uint64_t", &u64::MAX.to_le_bytes()), "uint64_t 0xffffffffffffffff");
        assert_eq!(shown("char[4]", b"ab\0\0"), "ab");
        assert_eq!(shown("char[2]", b"\xff\xfe"), "char[2] 0xfffe");
        assert_eq!(shown("char[3]", b"a\0b"), "char[3] 0x610062");
        assert_eq!(shown("uint8_t[2]", &[1, 2]), "uint8_t[2] 0x0102");
    }

    #[test]
    fn a_repeated_entry_does_not_replace_the_first() {
        let mut beside = Beside::default();
        for value in ["1", "2", "2", "3"] {
            beside.set(INFORMATION, "k".to_owned(), value.to_owned());
        }
        let keys: Vec<&str> = beside.sets[INFORMATION].keys().map(String::as_str).collect();
        assert_eq!(keys, ["k", "k (2)", "k (3)"]);
        let part = |goes_on: u8, text: &[u8]| [&[goes_on, 9], &b"char[2] p"[..], text].concat();
        for (goes_on, text) in [(0, b"ab"), (1, b"cd"), (0, b"ef")] {
            beside.part(&part(goes_on, text)).unwrap();
        }
        let parts: Vec<&str> = beside.sets[INFORMATION].range("p".to_owned()..).map(|(_, v)| v.as_str()).collect();
        assert_eq!(parts, ["abcd", "ef"]);
    }
}
