//! Decodes JSON messages into columns, without building a tree.
//!
//! Objects flatten into dotted paths, elements of arrays into `path[0]`. Two rules follow the ROS decoders: `true` is
//! 1, and an object of `sec` and `nsec` (or `nanosec`) is one column of nanoseconds under its own path. Whole numbers
//! are exact.

use crate::decode::Wanted;
use crate::decode::rows::{Rows, Value};
use serde::de::{DeserializeSeed, Deserializer, Error, IgnoredAny, MapAccess, SeqAccess, Visitor};
use std::fmt;

/// Elements read from an array when everything is wanted.
pub(super) const MOST_ELEMENTS: u32 = 64;

/// Sets the wanted values of the open row. An error names its position in the text.
pub(crate) fn decode(payload: &[u8], wanted: &Wanted, rows: &mut Rows) -> Result<(), String> {
    let mut text = serde_json::Deserializer::from_slice(payload);
    let mut path = String::new();
    let node = Node { wanted, rows, path: &mut path, held_back: false };
    node.deserialize(&mut text).and_then(|_| text.end()).map_err(|e| format!("the JSON is not valid: {e}"))
}

/// What a node was, for the enclosing object.
enum Seen {
    Whole(i64),
    Other,
}

/// The position in the message that is being read.
struct Node<'n> {
    wanted: &'n Wanted,
    rows: &'n mut Rows,
    path: &'n mut String,
    /// A whole number here may be half of a time: the enclosing object decides.
    held_back: bool,
}

impl Node<'_> {
    fn set(&mut self, value: Value<'_>) {
        if self.wanted.has(self.path)
            && let Some(column) = self.rows.column(self.path, value.value_type())
        {
            self.rows.set(column, value);
        }
    }

    /// Runs `inner` one level down, at `segment`.
    fn below<T>(&mut self, segment: fmt::Arguments<'_>, held_back: bool, inner: impl FnOnce(Node<'_>) -> T) -> T {
        let length = self.path.len();
        // Writing to a String cannot fail.
        let _ = fmt::Write::write_fmt(self.path, segment);
        let result = inner(Node { wanted: self.wanted, rows: self.rows, path: self.path, held_back });
        self.path.truncate(length);
        result
    }
}

impl<'de> DeserializeSeed<'de> for Node<'_> {
    type Value = Seen;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Seen, D::Error> {
        deserializer.deserialize_any(self)
    }
}

/// Whole numbers of an object under the keys of a time, and whether it has anything else.
#[derive(Default)]
struct TimeObject {
    parts: Vec<(String, i64)>,
    others: bool,
}

impl TimeObject {
    fn is_part(key: &str) -> bool {
        matches!(key, "sec" | "nsec" | "nanosec")
    }

    fn see(&mut self, key: String, seen: &Seen) {
        match seen {
            Seen::Whole(number) if TimeObject::is_part(&key) => self.parts.push((key, *number)),
            _ => self.others = true,
        }
    }

    fn nanoseconds(&self) -> Option<i64> {
        let (seconds, nanos) = match self.parts.as_slice() {
            [(a, seconds), (b, nanos)] if a == "sec" && b != "sec" => (seconds, nanos),
            [(a, nanos), (b, seconds)] if a != "sec" && b == "sec" => (seconds, nanos),
            _ => return None,
        };
        let whole = seconds.checked_mul(flight::NANOS_PER_SECOND)?.checked_add(*nanos)?;
        (!self.others).then_some(whole)
    }
}

impl<'de> Visitor<'de> for Node<'_> {
    type Value = Seen;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("any JSON value")
    }

    fn visit_bool<E: Error>(mut self, value: bool) -> Result<Seen, E> {
        self.set(Value::Integer(value.into()));
        Ok(Seen::Other)
    }

    fn visit_i64<E: Error>(mut self, value: i64) -> Result<Seen, E> {
        if !self.held_back {
            self.set(Value::Integer(value));
        }
        Ok(Seen::Whole(value))
    }

    fn visit_u64<E: Error>(mut self, value: u64) -> Result<Seen, E> {
        match i64::try_from(value) {
            Ok(value) => self.visit_i64(value),
            Err(_) => {
                self.set(Value::Large(value));
                Ok(Seen::Other)
            }
        }
    }

    fn visit_f64<E: Error>(mut self, value: f64) -> Result<Seen, E> {
        self.set(Value::Float(value));
        Ok(Seen::Other)
    }

    fn visit_str<E: Error>(mut self, value: &str) -> Result<Seen, E> {
        self.set(Value::Text(value));
        Ok(Seen::Other)
    }

    /// `null` is an absent value.
    fn visit_unit<E: Error>(self) -> Result<Seen, E> {
        Ok(Seen::Other)
    }

    fn visit_seq<A: SeqAccess<'de>>(mut self, mut elements: A) -> Result<Seen, A::Error> {
        let wanted = self.wanted.elements(self.path, MOST_ELEMENTS);
        let mut next = 0_u32;
        for index in wanted {
            while next < index {
                if elements.next_element::<IgnoredAny>()?.is_none() {
                    return Ok(Seen::Other);
                }
                next += 1;
            }
            let element = self.below(format_args!("[{index}]"), false, |node| elements.next_element_seed(node))?;
            if element.is_none() {
                return Ok(Seen::Other);
            }
            next += 1;
        }
        while elements.next_element::<IgnoredAny>()?.is_some() {}
        Ok(Seen::Other)
    }

    fn visit_map<A: MapAccess<'de>>(mut self, mut entries: A) -> Result<Seen, A::Error> {
        let mut time = TimeObject::default();
        let dot = if self.path.is_empty() { "" } else { "." };
        while let Some(key) = entries.next_key::<String>()? {
            let hold = TimeObject::is_part(&key);
            let seen = self.below(format_args!("{dot}{key}"), hold, |node| entries.next_value_seed(node))?;
            time.see(key, &seen);
        }
        if let Some(nanoseconds) = time.nanoseconds() {
            self.set(Value::Integer(nanoseconds));
        } else {
            for (key, number) in time.parts {
                self.below(format_args!("{dot}{key}"), false, |mut node| node.set(Value::Integer(number)));
            }
        }
        Ok(Seen::Other)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::{ColumnData, Table, TopicInfo};

    fn table(wanted: &Wanted, messages: &[&str]) -> Table {
        let mut rows = Rows::default();
        for (i, message) in messages.iter().enumerate() {
            decode(message.as_bytes(), wanted, &mut rows).unwrap();
            rows.close(0, None, i as u64 + 1);
        }
        rows.into_table(TopicInfo::default())
    }

    #[test]
    fn objects_flatten_into_dotted_paths_and_times_into_nanoseconds() {
        let text = r#"{"header":{"stamp":{"sec":1700000000,"nanosec":5},"frame_id":"base"},
                       "fix":{"lat":47.5,"ok":true,"cov":[1,0.5]},"none":null}"#;
        let table = table(&Wanted::All, &[text]);
        let paths: Vec<&str> = table.columns.iter().map(|c| c.path.as_str()).collect();
        assert_eq!(paths, ["fix.cov[0]", "fix.cov[1]", "fix.lat", "fix.ok", "header.frame_id", "header.stamp"]);
        assert_eq!(table.column("header.stamp").unwrap().integer(0), Some(1_700_000_000_000_000_005));
        assert_eq!(table.column("fix.ok").unwrap().number(0), Some(1.0));
        assert_eq!(table.column("header.frame_id").unwrap().text(0), Some("base"));
    }

    #[test]
    fn an_object_with_more_than_a_time_keeps_its_fields() {
        let table = table(&Wanted::All, &[r#"{"t":{"sec":1,"nsec":2,"zone":"UTC"},"u":{"sec":7}}"#]);
        let paths: Vec<&str> = table.columns.iter().map(|c| c.path.as_str()).collect();
        assert_eq!(paths, ["t.nsec", "t.sec", "t.zone", "u.sec"]);
    }

    #[test]
    fn only_wanted_fields_are_taken_and_a_missing_one_is_absent() {
        let wanted = Wanted::of_paths(["a.x", "list[2].y", "gone"]);
        let messages = [r#"{"a":{"x":1.5,"z":2},"list":[{"y":0},{"y":1},{"y":2}]}"#, r#"{"a":{"x":3},"list":[]}"#];
        let table = table(&wanted, &messages);
        let paths: Vec<&str> = table.columns.iter().map(|c| c.path.as_str()).collect();
        assert_eq!(paths, ["a.x", "list[2].y"]);
        let y = table.column("list[2].y").unwrap();
        assert_eq!((y.number(0), y.number(1)), (Some(2.0), None));
    }

    #[test]
    fn nanosecond_timestamps_stay_exact() {
        let table = table(&Wanted::All, &[r#"{"t":1700000000123456789}"#]);
        assert_eq!(table.columns[0].data, ColumnData::I64(vec![1_700_000_000_123_456_789]));
    }

    #[test]
    fn invalid_json_is_rejected_with_its_position() {
        let deep = "[".repeat(100_000);
        for text in ["", "{", "{\"a\":1} x", "{\"a\":\u{1}}", &deep] {
            let error = decode(text.as_bytes(), &Wanted::All, &mut Rows::default()).unwrap_err();
            assert!(error.contains("line 1"), "{error}");
        }
    }
}
