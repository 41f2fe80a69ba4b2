//! `metadata.yaml` of a ROS 2 bag: the files of one recording, in order, and the recorder's message
//! counts. It is a hint: the data read is compared with it.

use super::yaml::{self, ELEMENT};
use crate::error::{LogError, file_name};
use crate::reader::Log;
use flight::{Code, Notices, Severity};
use logscan::ScanError;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// File name.
pub const NAME: &str = "metadata.yaml";
/// Maximum length that is read.
const LONGEST: u64 = 16 << 20;
/// Its first key.
const ROOT: &str = "rosbag2_bagfile_information";
/// The key of the list of topics.
const TOPICS: &str = "topics_with_message_count";

/// What a recorder states about its bag.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Metadata {
    /// Length of the file.
    pub bytes: u64,
    /// Names of the files, without folders, in recording order.
    pub files: Vec<String>,
    /// Message count by topic.
    topics: BTreeMap<String, u64>,
    /// Where and why the rest cannot be read.
    broken: Option<String>,
}

impl Metadata {
    /// `None` if the file is something else.
    pub fn read(path: &Path) -> std::io::Result<Option<Metadata>> {
        let about = std::fs::metadata(path)?;
        if !about.is_file() {
            return Ok(None);
        }
        let mut text = vec![];
        File::open(path)?.take(LONGEST).read_to_end(&mut text)?;
        Ok(Metadata::parse(&String::from_utf8_lossy(&text)).map(|m| Metadata { bytes: about.len(), ..m }))
    }

    /// Removes the metadata from the files of a bag.
    pub(crate) fn split_off(files: &[PathBuf]) -> Result<(Option<Metadata>, Vec<PathBuf>), LogError> {
        let is_metadata = |path: &&PathBuf| path.file_name().is_some_and(|name| name == NAME);
        let Some(found) = files.iter().find(is_metadata) else { return Ok((None, files.to_vec())) };
        let rest = files.iter().filter(|path| *path != found).cloned().collect();
        let failed = |source| LogError::Read(ScanError::Io { file: NAME.to_owned(), offset: 0, source });
        let bytes = std::fs::metadata(found).map_err(failed)?.len();
        let metadata = Metadata::read(found).map_err(failed)?;
        Ok((Some(metadata.unwrap_or_else(|| Metadata::of_something_else(bytes))), rest))
    }

    /// A file of this length that only shares its name with the metadata.
    fn of_something_else(bytes: u64) -> Metadata {
        Metadata { bytes, broken: Some(format!("there is no {ROOT} in it")), ..Metadata::default() }
    }

    fn parse(text: &str) -> Option<Metadata> {
        let mut found = Metadata::default();
        let (mut topic, mut count) = (None, None);
        let mut known = false;
        let end = yaml::walk(text, |path, value| {
            known |= path.first() == Some(&ROOT);
            match (path, value) {
                ([ROOT, "relative_file_paths", ELEMENT], Some(name)) if !name.is_empty() => {
                    found.files.push(name.rsplit(['/', '\\']).next().unwrap_or_default().to_owned());
                }
                ([ROOT, TOPICS, ELEMENT], None) => (topic, count) = (None, None),
                ([ROOT, TOPICS, ELEMENT, "message_count"], Some(messages)) => count = messages.parse::<u64>().ok(),
                ([ROOT, TOPICS, ELEMENT, "topic_metadata", "name"], Some(name)) => topic = Some(name.to_owned()),
                _ => {}
            }
            // A topic with two types is listed twice.
            if let (Some(name), Some(messages)) = (topic.as_ref(), count) {
                *found.topics.entry(name.clone()).or_default() += messages;
                (topic, count) = (None, None);
            }
        });
        found.broken = end.err();
        in_order_of_numbers(&mut found.files);
        known.then_some(found)
    }

    /// Reports differences between the recorder's account and the data read. `files` are the files that were read.
    pub(crate) fn compare(&self, files: &[PathBuf], log: &mut Log) {
        // Packed files were unpacked under the name without the packing suffix.
        let inner = |name: &str| name.trim_end_matches(".zstd").trim_end_matches(".zst").to_owned();
        let read = files.iter().map(|path| inner(&path.file_name().unwrap_or_default().to_string_lossy()));
        let read: Vec<String> = read.collect();
        let is_there = |name: &&String| read.contains(&inner(name));
        if let Some(why) = &self.broken {
            let text = format!("it cannot be read beyond this: {why:.200}");
            log.notices.push(Code::IndexDiffers, NAME, 1, text);
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
                first = format!("{topic:.200}, {stated} in {NAME}, {read} in the files");
            }
        }
        for name in self.files.iter().filter(|name| !is_there(name)) {
            let (severity, text) = if self.topics.is_empty() || fewer + more > 0 {
                (Severity::Loss, format!("{name:.200} is part of this recording, but is missing"))
            } else {
                let text = "is missing under this name; all messages that the recorder counted were read";
                (Severity::Warning, format!("{name:.200} {text}"))
            };
            log.notices.push(Code::IncompleteRecording.at(severity), NAME, 1, text);
        }
        if fewer > 0 {
            let text = format!("messages that the recorder counted are missing; the first topic: {first}");
            log.notices.push(Code::IndexDiffers.at(Severity::Loss), NAME, fewer, text);
        }
        if more > 0 {
            let text = format!("more messages than the recorder counted; the first topic: {first}");
            log.notices.push(Code::IndexDiffers, NAME, more, text);
        }
    }
}

/// `bag` and 10 for `bag_10.db3`, with any suffix.
fn numbered(name: &str) -> Option<(&str, u64)> {
    let (front, number) = name.split('.').next()?.rsplit_once('_')?;
    Some((front, number.parse().ok()?))
}

/// Sorts `bag_10.db3` after `bag_2.db3`, whatever the input order; files with other names keep their place.
fn in_order_of_numbers(files: &mut [String]) {
    let front = files.first().and_then(|first| numbered(first)).map(|(front, _)| front.to_owned());
    if front.is_some() && files.iter().all(|name| numbered(name).map(|(front, _)| front) == front.as_deref()) {
        files.sort_by_key(|name| numbered(name).map(|(_, number)| number));
    }
}

/// Reports numbers missing among the files of a recording without metadata. A recorder that keeps only the
/// newest files removes the first ones itself.
pub(crate) fn report_gaps(files: &[PathBuf], notices: &mut Notices) {
    let mut parts = BTreeMap::<_, Vec<(u64, String)>>::new();
    for path in files {
        let name = file_name(path);
        if let Some((front, number)) = numbered(&name) {
            parts.entry((path.parent(), front.to_owned())).or_default().push((number, name));
        }
    }
    for recording in parts.values_mut().filter(|recording| recording.len() > 1) {
        recording.sort();
        let (mut severity, mut expected) = (Severity::Warning, 0);
        for (number, name) in recording {
            if *number > expected {
                let text = "files of this recording are missing: there are gaps in the numbers of the file names";
                notices.push(
                    Code::IncompleteRecording.at(severity),
                    format!("before {name}"),
                    *number - expected,
                    text,
                );
            }
            (severity, expected) = (Severity::Loss, number.saturating_add(1));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As written by rosbag2 of 2020 and of 2025: list indentation and key order differ.
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
    fn metadata_of_old_and_new_recorders_reads_the_same() {
        for text in [OLD, NEW] {
            let metadata = Metadata::parse(text).unwrap();
            assert_eq!(metadata.files, ["bag_0.db3", "bag_1.db3"]);
            assert_eq!(metadata.topics, BTreeMap::from([("/imu".to_owned(), 4), ("/fix".to_owned(), 3)]));
        }
    }

    #[test]
    fn metadata_before_the_damage_is_used_and_the_damage_is_reported() {
        let broken = NEW.replace("offered_qos_profiles: \"", "offered_qos_profiles: ]\"");
        let metadata = Metadata::parse(&broken).unwrap();
        assert_eq!(metadata.files, ["bag_0.db3", "bag_1.db3"]);
        assert_eq!(metadata.topics, BTreeMap::from([("/imu".to_owned(), 4)]));
        let mut log = Log::default();
        metadata.compare(&[PathBuf::from("bag_0.db3"), PathBuf::from("bag_1.db3")], &mut log);
        assert!(
            log.notices.iter().any(|n| n.code == "index-differs" && n.text.contains("line 15")),
            "{:?}",
            log.notices
        );
    }

    #[test]
    fn a_file_with_only_the_name_of_the_metadata_is_reported() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(NAME);
        for text in [&[0; 2000][..], b"", b"<html>404</html>"] {
            std::fs::write(&path, text).unwrap();
            let (metadata, rest) = Metadata::split_off(&[path.clone(), "bag_0.db3".into()]).unwrap();
            let mut log = Log::default();
            metadata.unwrap().compare(&rest, &mut log);
            let codes: Vec<&str> = log.notices.iter().map(|n| n.code.as_str()).collect();
            assert_eq!(codes, ["index-differs"], "{:?}", log.notices);
        }
    }

    #[test]
    fn a_list_of_qos_profiles_does_not_hide_the_message_count() {
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
    fn yaml_variants_of_other_writers_read_the_same() {
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
    fn the_parts_of_a_recording_are_sorted_by_number() {
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

    /// The gaps reported for files with these names.
    fn missing_parts(names: &[&str]) -> Vec<(Severity, String, u64)> {
        let mut notices = Notices::new();
        report_gaps(&names.iter().map(PathBuf::from).collect::<Vec<_>>(), &mut notices);
        notices.iter().map(|n| (n.severity, n.place.clone(), n.count)).collect()
    }

    #[test]
    fn missing_numbers_among_the_parts_of_a_recording_are_reported() {
        assert_eq!(missing_parts(&["b_0.mcap", "b_1.mcap", "b_2.mcap"]), []);
        assert_eq!(missing_parts(&["b_7.mcap"]), []);
        assert_eq!(missing_parts(&["a.mcap", "b_7.mcap"]), []);
        let (warning, loss) = (Severity::Warning, Severity::Loss);
        let gap = |severity, name: &str, count| (severity, format!("before {name}"), count);
        assert_eq!(missing_parts(&["b_0.db3", "b_3.db3.zstd", "b_4.db3"]), [gap(loss, "b_3.db3.zstd", 2)]);
        assert_eq!(missing_parts(&["b_2.db3", "b_3.db3"]), [gap(warning, "b_2.db3", 2)]);
    }

    #[test]
    fn numbers_are_compared_only_within_one_recording_and_in_order() {
        assert_eq!(missing_parts(&["a_0.mcap", "b_7.mcap"]), []);
        assert_eq!(missing_parts(&["a_0.mcap", "a_1.mcap", "b_0.mcap", "b_1.mcap", "c.mcap"]), []);
        assert_eq!(
            missing_parts(&["b_10.mcap", "b_2.mcap", "a_0.mcap", "b_1.mcap", "b_0.mcap", "a_1.mcap"]),
            [(Severity::Loss, "before b_10.mcap".to_owned(), 7)]
        );
        assert_eq!(missing_parts(&["one/b_0.mcap", "two/b_4.mcap"]), []);
    }

    #[test]
    fn a_renamed_file_is_not_a_loss_if_every_message_is_present() {
        let metadata = Metadata::parse(NEW).unwrap();
        let topic = |name: &str, messages| flight::TopicHealth {
            name: name.to_owned(),
            messages,
            type_name: String::new(),
            encoding: String::new(),
            payload_bytes: 0,
            decoded: true,
            reason: String::new(),
            stamps: vec![],
        };
        for (messages, severity) in [(4, Severity::Warning), (3, Severity::Loss)] {
            let mut log = Log::default();
            log.health.topics = vec![topic("/imu", messages), topic("/fix", 3)];
            metadata.compare(&[PathBuf::from("renamed.db3")], &mut log);
            let missing: Vec<Severity> =
                log.notices.iter().filter(|n| n.code == "incomplete-recording").map(|n| n.severity).collect();
            assert_eq!(missing, [severity; 2], "{:?}", log.notices);
        }
    }

    #[test]
    fn the_counts_of_a_topic_with_two_types_are_added() {
        let text = "rosbag2_bagfile_information:\n  topics_with_message_count:\n    - topic_metadata:\n        name: /t\n      \
            message_count: 4\n    - topic_metadata:\n        name: /t\n      message_count: 2\n";
        assert_eq!(Metadata::parse(text).unwrap().topics, BTreeMap::from([("/t".to_owned(), 6)]));
    }

    #[test]
    fn an_unrelated_file_of_that_name_is_not_metadata() {
        for text in ["", "title: a book\n", "- a\n- b\n", "{}", "a: &a [*a, *a]\n"] {
            assert_eq!(Metadata::parse(text), None, "{text:?}");
        }
    }

    #[test]
    fn file_names_never_point_outside_the_folder() {
        let text = "rosbag2_bagfile_information:\n  relative_file_paths:\n  - ../../etc/passwd\n  - /etc/shadow\n  - 'a\\b.db3'\n";
        assert_eq!(Metadata::parse(text).unwrap().files, ["passwd", "shadow", "b.db3"]);
    }
}
