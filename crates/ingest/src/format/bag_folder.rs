//! `metadata.yaml` of a ROS 2 bag: which files make up one recording, in order, and what the recorder
//! counted. It is a hint: what was read is compared with it.
//!
//! Of YAML only what rosbag2 writes is understood, and what other programs make of it: nested keys, lists, plain and
//! quoted values, collections in brackets. Anchors and tags are text, so that no file can unfold into a larger one.

use crate::error::IngestError;
use crate::reader::Log;
use flight::Severity;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Name of the file.
pub(crate) const NAME: &str = "metadata.yaml";
/// As much of it is read.
const LONGEST: u64 = 16 << 20;
/// Keys within each other that are followed.
const MOST_OPEN: usize = 16;
/// What its first key is called.
const ROOT: &str = "rosbag2_bagfile_information";

/// What a recorder says of its bag.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Metadata {
    /// Length of the file.
    pub(crate) bytes: u64,
    /// Names of the files, without folders, in the order of the recording.
    pub(crate) files: Vec<String>,
    /// Messages by topic.
    topics: BTreeMap<String, u64>,
}

impl Metadata {
    /// `None` if the file is something else.
    pub(crate) fn read(path: &Path) -> std::io::Result<Option<Metadata>> {
        let about = std::fs::metadata(path)?;
        if !about.is_file() {
            return Ok(None);
        }
        let mut text = vec![];
        File::open(path)?.take(LONGEST).read_to_end(&mut text)?;
        Ok(Metadata::parse(&String::from_utf8_lossy(&text)).map(|m| Metadata { bytes: about.len(), ..m }))
    }

    /// Takes the metadata out of the files of a bag.
    pub(crate) fn split_off(files: &[PathBuf]) -> Result<(Option<Metadata>, Vec<PathBuf>), IngestError> {
        let is_metadata = |path: &&PathBuf| path.file_name().is_some_and(|name| name == NAME);
        let Some(found) = files.iter().find(is_metadata) else { return Ok((None, files.to_vec())) };
        let rest = files.iter().filter(|path| *path != found).cloned().collect();
        let failed = |source| IngestError::Io { file: NAME.to_owned(), offset: 0, source };
        let bytes = std::fs::metadata(found).map_err(failed)?.len();
        let metadata = Metadata::read(found).map_err(failed)?;
        Ok((Some(metadata.unwrap_or(Metadata { bytes, ..Metadata::default() })), rest))
    }

    fn parse(text: &str) -> Option<Metadata> {
        let mut found = Metadata::default();
        let (mut topic, mut count) = (None, None);
        let mut known = false;
        for line in Lines::of(&unfolded(text)) {
            let path: Vec<&str> = line.path.iter().map(String::as_str).collect();
            known |= path.first() == Some(&ROOT);
            match path.as_slice() {
                [ROOT, "relative_file_paths"] if line.item && !line.value.is_empty() => {
                    let name = line.value.rsplit(['/', '\\']).next().unwrap_or_default();
                    found.files.push(name.to_owned());
                }
                [ROOT, "topics_with_message_count", rest @ ..] => {
                    // Deeper lists are those of a topic's qualities of service.
                    if line.item && rest.len() <= 1 {
                        (topic, count) = (None, None);
                    }
                    match rest {
                        ["message_count"] => count = line.value.parse::<u64>().ok(),
                        ["topic_metadata", "name"] => topic = Some(line.value),
                        _ => {}
                    }
                    // A topic of two types is listed twice.
                    if let Some(messages) = count.filter(|_| topic.is_some()) {
                        *found.topics.entry(topic.take().unwrap_or_default()).or_default() += messages;
                    }
                }
                _ => {}
            }
        }
        in_order_of_numbers(&mut found.files);
        known.then_some(found)
    }

    /// Says where the recorder's account and what was read differ. `files` are those that were read.
    pub(crate) fn compare(&self, files: &[PathBuf], log: &mut Log) {
        // Files that were packed have been unpacked under the name within.
        let inner = |name: &str| name.trim_end_matches(".zstd").trim_end_matches(".zst").to_owned();
        let read = files.iter().map(|path| inner(&path.file_name().unwrap_or_default().to_string_lossy()));
        let read: Vec<String> = read.collect();
        let is_there = |name: &&String| read.contains(&inner(name));
        for name in self.files.iter().filter(|name| !is_there(name)) {
            let text = format!("{name:.200} is part of this recording and is not there");
            log.notices.push(Severity::Loss, "missing-file", NAME, 1, text);
        }
        let mut found: BTreeMap<&str, u64> = BTreeMap::new();
        for topic in &log.health.topics {
            *found.entry(&topic.name).or_default() += topic.messages;
        }
        let (mut fewer, mut more, mut first) = (0, 0, String::new());
        for (topic, &stated) in &self.topics {
            let read = found.get(topic.as_str()).copied().unwrap_or(0);
            fewer += stated.saturating_sub(read);
            more += read.saturating_sub(stated);
            if stated != read && first.is_empty() {
                first = format!("{topic:.200}, {stated} by {NAME} and {read} by what was read");
            }
        }
        if fewer > 0 {
            let text = format!("messages are missing that the recorder counted; the first topic: {first}");
            log.notices.push(Severity::Loss, "missing-messages", NAME, fewer, text);
        }
        if more > 0 {
            let text = format!("messages more than the recorder counted; the first topic: {first}");
            log.notices.push(Severity::Warning, "miscounted-messages", NAME, more, text);
        }
    }
}

/// `bag_10.db3` comes behind `bag_2.db3`, however the list was made; files of other names stay as they are listed.
fn in_order_of_numbers(files: &mut [String]) {
    let number = |name: &str| {
        let (front, number) = name.split('.').next()?.rsplit_once('_')?;
        Some((front.to_owned(), number.parse::<u64>().ok()?))
    };
    let front = files.first().and_then(|first| number(first)).map(|(front, _)| front);
    if front.is_some() && files.iter().all(|name| number(name).map(|(front, _)| front) == front) {
        files.sort_by_key(|name| number(name));
    }
}

/// The text with collections in brackets (`[a, b]`, `{key: value}`, JSON) as lists and keys on lines of their own.
fn unfolded(text: &str) -> String {
    let mut out = Unfolded::default();
    for line in text.trim_start_matches('\u{feff}').lines() {
        let folded = if out.open.is_empty() { bracket(line) } else { Some(0) };
        let (front, rest) = folded.and_then(|at| line.split_at_checked(at)).unwrap_or((line, ""));
        out.text += front;
        if out.open.is_empty() {
            out.indent = front.len() - front.trim_start().len() + 2;
        }
        rest.chars().for_each(|c| out.take(c));
        out.text.push(if out.open.is_empty() { '\n' } else { ' ' });
    }
    out.text
}

/// Where a line's value begins with a bracket.
fn bracket(line: &str) -> Option<usize> {
    let after_dashes = line.trim_start_matches([' ', '-']);
    let value = match after_dashes.split_once(": ") {
        Some((key, value)) if !key.contains(['"', '\'', '[', '{']) => value.trim_start(),
        _ => after_dashes,
    };
    value.starts_with(['[', '{']).then_some(line.len() - value.len())
}

/// Brackets on the way to lines.
#[derive(Default)]
struct Unfolded {
    text: String,
    /// Brackets that are open.
    open: Vec<char>,
    /// Of the outermost.
    indent: usize,
    /// An element begins with what comes next.
    fresh: bool,
    quote: Option<char>,
}

impl Unfolded {
    fn take(&mut self, c: char) {
        match (self.quote, c) {
            (Some(quote), _) => {
                let ends = quote == c && !(quote == '"' && self.text.ends_with('\\'));
                self.quote = Some(quote).filter(|_| !ends);
                self.text.push(c);
            }
            (None, '[' | '{') => {
                self.element();
                self.open.push(c);
                self.fresh = true;
            }
            (None, ']' | '}') => {
                self.open.pop();
                self.fresh = false;
            }
            (None, ',') => self.fresh = true,
            (None, ' ') if self.fresh => {}
            (None, c) => {
                let begins = self.fresh || self.text.trim_end().ends_with(':');
                self.element();
                // JSON may have no blank behind the colon of a key.
                let key = c == ':' && self.text.ends_with('"');
                self.quote = Some(c).filter(|c| begins && ['"', '\''].contains(c));
                self.text.push(c);
                self.text += if key { " " } else { "" };
            }
        }
    }

    /// Begins a line if an element begins here.
    fn element(&mut self) {
        // A hostile file does not become much longer.
        let fits = self.text.len() as u64 <= 2 * LONGEST;
        let Some(kind) = self.open.last().filter(|_| self.fresh && fits) else { return };
        let indent = self.indent + 2 * self.open.len().min(MOST_OPEN);
        self.text += &format!("\n{:indent$}{}", "", if *kind == '[' { "- " } else { "" });
        self.fresh = false;
    }
}

/// A value without its quotes and without a comment behind it.
fn scalar(value: &str) -> &str {
    let value = value.trim();
    match value.chars().next() {
        Some(quote @ ('"' | '\'')) => value.get(1..).and_then(|rest| rest.split(quote).next()).unwrap_or_default(),
        _ => value.split(" #").next().unwrap_or_default().trim_end(),
    }
}

/// A line with the keys above it.
struct Line {
    /// Keys from the outermost to this line's own, if it has one.
    path: Vec<String>,
    /// It begins an element of a list.
    item: bool,
    value: String,
}

/// The lines of a file with keys in them.
struct Lines<'t> {
    text: std::str::Lines<'t>,
    /// Keys that are open, by their indentation.
    open: Vec<(usize, String)>,
}

impl Lines<'_> {
    fn of(text: &str) -> Lines<'_> {
        Lines { text: text.lines(), open: vec![] }
    }
}

impl Iterator for Lines<'_> {
    type Item = Line;

    fn next(&mut self) -> Option<Line> {
        let line = self.text.find(|line| !line.trim().is_empty() && !line.trim_start().starts_with('#'))?;
        let mut rest = line.trim_start();
        let mut indent = line.len() - rest.len();
        let item = rest == "-" || rest.starts_with("- ");
        if item {
            // The list may stand as far to the left as its own key.
            self.open.retain(|(at, _)| *at <= indent);
            let inner = rest.strip_prefix('-').unwrap_or(rest).trim_start();
            indent += rest.len() - inner.len();
            rest = inner;
        } else {
            self.open.retain(|(at, _)| *at < indent);
        }
        let entry = rest.split_once(": ").or_else(|| rest.strip_suffix(':').map(|key| (key, "")));
        let is_key =
            |key: &str| key.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_') && self.open.len() < MOST_OPEN;
        let value = match entry.map(|(key, value)| (key.trim_matches(['"', '\'']), value)) {
            Some((key, value)) if is_key(key) => {
                self.open.push((indent, key.to_owned()));
                value
            }
            _ => rest,
        };
        let path = self.open.iter().map(|(_, key)| key.clone()).collect();
        Some(Line { path, item, value: scalar(value).to_owned() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As rosbag2 of 2020 and as that of 2025 write it: lists are indented or not, and the order differs.
    const OLD: &str = "rosbag2_bagfile_information:\n  version: 2\n  relative_file_paths:\n    - bag/bag_0.db3\n    \
        - bag/bag_1.db3\n  duration:\n    nanoseconds: 5\n  message_count: 7\n  topics_with_message_count:\n    \
        - topic_metadata:\n        name: /imu\n        type: sensor_msgs/msg/Imu\n      message_count: 4\n    \
        - topic_metadata:\n        name: /fix\n      message_count: 3\n";
    const NEW: &str = "rosbag2_bagfile_information:\n  files:\n  - duration:\n      nanoseconds: 5\n    message_count: 7\n    \
        path: bag_0.db3\n  message_count: 7\n  relative_file_paths:\n  - bag_0.db3\n  - 'bag_1.db3'\n  \
        topics_with_message_count:\n  - message_count: 4\n    topic_metadata:\n      name: /imu\n      \
        offered_qos_profiles: \"- history: 3\\n  depth: 0\"\n  - message_count: 3\n    topic_metadata:\n      name: /fix\n  \
        version: 8\n";

    #[test]
    fn old_and_new_recorders_say_the_same() {
        for text in [OLD, NEW] {
            let metadata = Metadata::parse(text).unwrap();
            assert_eq!(metadata.files, ["bag_0.db3", "bag_1.db3"]);
            assert_eq!(metadata.topics, BTreeMap::from([("/imu".to_owned(), 4), ("/fix".to_owned(), 3)]));
        }
    }

    #[test]
    fn qualities_of_service_as_a_list_do_not_take_the_count_from_their_topic() {
        // As rosbag2 of Jazzy writes it (`metadata_io.cpp`, version 9).
        let text = "rosbag2_bagfile_information:\n  version: 9\n  message_count: 9\n  topics_with_message_count:\n    \
            - topic_metadata:\n        name: /imu\n        type: sensor_msgs/msg/Imu\n        offered_qos_profiles:\n          \
            - history: keep_last\n            depth: 10\n            deadline:\n              sec: 9223372036\n          \
            - history: unknown\n            depth: 0\n        type_description_hash: RIHS01_7d\n      message_count: 9\n  \
            relative_file_paths:\n    - bag_0.mcap\n";
        let metadata = Metadata::parse(text).unwrap();
        assert_eq!(metadata.topics, BTreeMap::from([("/imu".to_owned(), 9)]));
        assert_eq!(metadata.files, ["bag_0.mcap"]);
    }

    #[test]
    fn brackets_quotes_comments_and_marks_of_other_writers_say_the_same() {
        // PyYAML with `default_flow_style=None`, PyYAML with `True`, json, and by hand.
        let leaves = "rosbag2_bagfile_information:\n  duration: {nanoseconds: 5}\n  relative_file_paths: [bag_0.db3, bag_1.db3]\n  \
            topics_with_message_count:\n  - message_count: 4\n    topic_metadata: {name: /imu, offered_qos_profiles: '- a: [1',\n      \
            serialization_format: cdr, type: sensor_msgs/msg/Imu}\n  - message_count: 3\n    topic_metadata: {name: /fix}\n  version: 5\n";
        let all = "{rosbag2_bagfile_information: {relative_file_paths: [bag_0.db3, bag_1.db3],\n    topics_with_message_count: [\
            {message_count: 4, topic_metadata: {name: /imu, a: it's, qos: []}}, {message_count: 3,\n        topic_metadata: {name: /fix}}], \
            version: 5}}\n";
        let json = "{\"rosbag2_bagfile_information\":{\"relative_file_paths\":[\"bag_0.db3\",\"bag_1.db3\"],\
            \"topics_with_message_count\":[{\"topic_metadata\":{\"name\":\"/imu\",\"qos\":\"[\\\"{\"},\"message_count\":4},\
            {\"topic_metadata\":{\"name\":\"/fix\"},\"message_count\":3}]}}";
        let hand = "\u{feff}---\r\n# mine\r\nrosbag2_bagfile_information:\r\n  'relative_file_paths':\r\n    - \"bag_0.db3\"  # first\r\n    \
            - bag_1.db3 # second\r\n  topics_with_message_count:\r\n    - topic_metadata:\r\n        name: /imu\r\n      message_count: 4 # all\r\n    \
            -\r\n      topic_metadata:\r\n        name: '/fix'\r\n      message_count: 3\r\n";
        for text in [leaves, all, json, hand] {
            let metadata = Metadata::parse(text).unwrap();
            assert_eq!(metadata.files, ["bag_0.db3", "bag_1.db3"], "{text}");
            assert_eq!(metadata.topics, BTreeMap::from([("/imu".to_owned(), 4), ("/fix".to_owned(), 3)]), "{text}");
        }
        assert_eq!(Metadata::parse(&"[{".repeat(1 << 16)), None);
        assert_eq!(Metadata::parse("a: [\n- b\n]]]}\n"), None);
    }

    #[test]
    fn the_parts_of_a_recording_are_in_the_order_of_their_numbers() {
        let list = |names: &[&str]| {
            let text = format!("rosbag2_bagfile_information:\n  relative_file_paths:\n  - {}\n", names.join("\n  - "));
            Metadata::parse(&text).unwrap().files
        };
        let sorted_as_text = ["a_b_0.db3.zstd", "a_b_1.db3.zstd", "a_b_10.db3.zstd", "a_b_2.db3.zstd"];
        assert_eq!(list(&sorted_as_text), ["a_b_0.db3.zstd", "a_b_1.db3.zstd", "a_b_2.db3.zstd", "a_b_10.db3.zstd"]);
        for by_hand in [["second.db3", "first.db3"], ["b_1.mcap", "a_0.mcap"], ["x_2.db3", "x.db3"]] {
            assert_eq!(list(&by_hand), by_hand);
        }
    }

    #[test]
    fn a_topic_of_two_types_has_the_messages_of_both() {
        let text = "rosbag2_bagfile_information:\n  topics_with_message_count:\n    - topic_metadata:\n        name: /t\n      \
            message_count: 4\n    - topic_metadata:\n        name: /t\n      message_count: 2\n";
        assert_eq!(Metadata::parse(text).unwrap().topics, BTreeMap::from([("/t".to_owned(), 6)]));
    }

    #[test]
    fn another_file_of_that_name_is_none() {
        for text in ["", "title: a book\n", "- a\n- b\n", "{}", "a: &a [*a, *a]\n"] {
            assert_eq!(Metadata::parse(text), None, "{text:?}");
        }
    }

    #[test]
    fn names_never_lead_out_of_the_folder() {
        let text = "rosbag2_bagfile_information:\n  relative_file_paths:\n  - ../../etc/passwd\n  - /etc/shadow\n  - 'a\\b.db3'\n";
        assert_eq!(Metadata::parse(text).unwrap().files, ["passwd", "shadow", "b.db3"]);
    }
}
