//! Writes everything recoverable from a log as MCAP.

use crate::error::ConvertError;
use crate::export::about_tie;
use crate::guard::{Unchanged, may_write};
use crate::output::Output;
use crate::recording::{Content, Entry, Recording, Tally};
use crate::row_time::{self, LogTime, RowTime};
use crate::typed_topics;
use flight::{Code, LogHealth, Notices, Severity};
use ingest::{
    Extra, FlightUnit, Log, LogKind, MapLibrary, MessageSink, OriginalLog, RawMessage, ReadContext, Select, Selection,
    TopicInfo,
};
use serde_json::json;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The result of recovering a log.
#[derive(Debug)]
pub struct Recovered {
    /// How its messages were written.
    pub how: How,
    /// Topics in the order of their names.
    pub topics: Vec<RecoveredTopic>,
    /// Attachments and metadata that were copied and found again in the output.
    pub extras: Vec<RecoveredExtra>,
    /// How the log was read, including its damage.
    pub health: LogHealth,
    /// What was lost or assumed on the way.
    pub notices: Notices,
    /// Size of what was written, bytes.
    pub bytes: u64,
}

/// How messages are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum How {
    /// Byte for byte as in the log.
    Copied,
    /// As tables of numbers and texts (CDR), because the log's own messages mean nothing outside of it.
    Rewritten,
}

/// One topic.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecoveredTopic {
    /// Name.
    pub name: String,
    /// Intact messages in the log.
    pub found: u64,
    /// Messages written, and found again in the output.
    pub written: u64,
}

/// Something in a log other than its messages.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecoveredExtra {
    /// Kind, name and size.
    pub what: String,
    /// Number of items.
    pub count: u64,
}

impl Recovered {
    /// Whether anything in the log is missing from the output.
    #[must_use]
    pub fn any_loss(&self) -> bool {
        self.notices.any_loss()
    }
}

/// Writes every intact message of a log to `out`, reads the output back and compares counts and bytes.
///
/// MCAP, ROS 1 and ROS 2 bags are copied message by message with their definitions; the topics of other formats
/// become one typed topic each. Their rows keep their order and the log's own timestamps, unwrapped if a 32-bit counter
/// wrapped around. Rows without a log timestamp (a receiver's own output, text tables) get the best time they contain:
/// UTC where `library` says how, otherwise the first time or their position in the log; a notice says which. Intact
/// messages that are not decoded are copied as bytes or text. Attachments, metadata and topic metadata are copied;
/// parameters, information and texts of a ULog become metadata. Everything rewritten records its original, so that
/// reading the output gives the same result as reading the log ([`ingest::OriginalTopic`]). The metadata record
/// `flightlag-recover` names the source and what was lost. Damage in the log is not an error.
///
/// # Errors
/// [`ConvertError::Refused`] if `out` is a file of the log or not a regular file, [`ConvertError::Log`] if nothing in
/// the log is usable or it changed while it was read, [`ConvertError::Nothing`] for a log without messages,
/// [`ConvertError::Write`], [`ConvertError::ReadsBackDifferently`]. `out` is then absent or unchanged.
pub fn recover(
    unit: &FlightUnit,
    library: &MapLibrary,
    out: &Path,
    context: &ReadContext<'_>,
) -> Result<Recovered, ConvertError> {
    may_write(out, &unit.files)?;
    let unchanged = Unchanged::of(&unit.files)?;
    let output = Output::begin(out)?;
    let taker = Taker::new(Recording::begin(out, output.file()?, profile(unit.kind))?);
    let mut log = ingest::read(unit, &taker, context)?;
    let mut recording = taker.into_recording()?;
    let how = if log.tables.is_empty() { How::Copied } else { How::Rewritten };
    let mut notices = log.notices.clone();
    let mut about_times = BTreeMap::new();
    if how == How::Rewritten {
        about_times = rewrite(&log, library, &mut recording, &mut notices, context)?;
    } else if let Some(lost) = OriginalLog::lost(&log) {
        let (name, entries) = lost.metadata();
        recording.extra(&Extra::Metadata { name, entries: &entries })?;
    }
    log.tables.clear();
    if recording.content.topics.is_empty() && recording.content.extras.is_empty() {
        return Err(ConvertError::Nothing(format!("{}: no intact message found", unit.id)));
    }
    let topics = topics(&log.health, &recording.content, &mut notices);
    let extras = extras(&recording.content);
    note_remaining(&recording, &mut notices);
    let mut entries = provenance(unit, &log.health, &notices);
    entries.extend(about_times);
    recording.extra(&Extra::Metadata { name: "flightlag-recover", entries: &entries })?;
    let written = recording.end()?;
    check(output.written(), out, &written, context)?;
    unchanged.check()?;
    let bytes = std::fs::metadata(output.written()).map_err(ConvertError::write(out, "read the status of"))?.len();
    output.keep()?;
    Ok(Recovered { how, topics, extras, health: log.health, notices, bytes })
}

/// Writes the rows of a log, and reports the source of the message times.
fn rewrite(
    log: &Log,
    library: &MapLibrary,
    recording: &mut Recording,
    notices: &mut Notices,
    context: &ReadContext<'_>,
) -> Result<BTreeMap<String, String>, ConvertError> {
    let times = row_time::of_log(log, library)?;
    times.note(notices);
    let log_times: Vec<LogTime> = times.tables.iter().map(RowTime::as_logged).collect();
    let names = log.tables.iter().map(|table| table.topic.name.as_str());
    let topics_by_time = row_time::report(names.zip(&log_times), notices);
    typed_topics::write(log, &times, &log_times, recording, notices, context)?;
    let utc = times.utc.as_ref().map(about_tie);
    let entries = [("log_time", json!(topics_by_time)), ("utc", json!(utc))];
    Ok(entries.map(|(key, value)| (key.to_owned(), value.to_string())).into())
}

/// Texts for the output: its source, and what was lost.
fn provenance(unit: &FlightUnit, health: &LogHealth, notices: &Notices) -> BTreeMap<String, String> {
    let name = |path: &PathBuf| path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
    let files: Vec<String> = unit.files.iter().map(name).collect();
    let json = |value: serde_json::Result<String>| value.unwrap_or_default();
    let entries = [
        ("made_by", concat!("flightlag ", env!("CARGO_PKG_VERSION")).to_owned()),
        ("inputs", files.join(", ")),
        ("format", health.format.clone()),
        ("bytes", json(serde_json::to_string(&health.bytes))),
        ("damage", json(serde_json::to_string(&health.damage))),
        ("notices", json(serde_json::to_string(notices))),
    ];
    entries.map(|(key, value)| (key.to_owned(), value)).into()
}

fn profile(kind: LogKind) -> &'static str {
    match kind {
        LogKind::Bag => "ros1",
        LogKind::Db3 => "ros2",
        _ => "",
    }
}

/// Writes messages to the recording as they arrive.
struct Taker {
    recording: RefCell<Recording>,
    failure: RefCell<Option<ConvertError>>,
}

impl Taker {
    fn new(recording: Recording) -> Taker {
        Taker { recording: RefCell::new(recording), failure: RefCell::new(None) }
    }

    /// Writes, unless an earlier write failed.
    fn write(&self, write: impl FnOnce(&mut Recording) -> Result<(), ConvertError>) {
        let mut failure = self.failure.borrow_mut();
        if failure.is_none() {
            *failure = write(&mut self.recording.borrow_mut()).err();
        }
    }

    fn into_recording(self) -> Result<Recording, ConvertError> {
        match self.failure.into_inner() {
            Some(failure) => Err(failure),
            None => Ok(self.recording.into_inner()),
        }
    }
}

impl Select for Taker {
    fn select(&self, _: &TopicInfo) -> Selection {
        Selection::Raw
    }

    fn sink(&self) -> Option<&dyn MessageSink> {
        Some(self)
    }
}

impl MessageSink for Taker {
    fn message(&self, message: &RawMessage<'_>) {
        self.write(|recording| {
            recording.write(&Entry {
                topic: message.topic,
                original: None,
                encoding: &message.topic.encoding,
                schema_encoding: message.schema_encoding,
                schema: message.schema,
                logged_ns: message.logged_ns,
                published_ns: message.published_ns,
                sequence: message.sequence,
                payload: message.payload,
            })
        });
    }

    fn extra(&self, extra: &Extra<'_>) {
        self.write(|recording| recording.extra(extra));
    }
}

/// Reads the whole output back, and compares.
fn check(written: &Path, out: &Path, expected: &Content, context: &ReadContext<'_>) -> Result<(), ConvertError> {
    let differs = |what: String| ConvertError::ReadsBackDifferently { path: out.to_owned(), what };
    let counter = Counter::default();
    let log = ingest::read_files(LogKind::Mcap, &[written.to_owned()], &counter, context)?;
    if let Some(damage) = log.health.damage.first() {
        return Err(differs(format!("{} at byte {}", damage.reason, damage.offset)));
    }
    let found = counter.0.into_inner();
    let differing = |kind: &str, expected: &BTreeMap<String, Tally>, found: &BTreeMap<String, Tally>| {
        let names = expected.keys().chain(found.keys());
        let of = |tallies: &BTreeMap<String, Tally>, name: &str| tallies.get(name).copied().unwrap_or_default();
        let other = names.map(|name| (name, of(expected, name), of(found, name))).find(|(_, a, b)| a != b);
        other.map(|(name, a, b)| format!("{kind}{name}: {} found, {} written", b.count, a.count))
    };
    let topic = differing("topic ", &expected.topics, &found.topics);
    let other = topic.or(differing("", &expected.extras, &found.extras));
    if let Some(other) = other {
        return Err(differs(other));
    }
    if found.of_topics != expected.of_topics {
        return Err(differs("properties of topics other than their types".to_owned()));
    }
    Ok(())
}

/// Counts the contents of a file.
#[derive(Default)]
struct Counter(RefCell<Content>);

impl Select for Counter {
    fn select(&self, _: &TopicInfo) -> Selection {
        Selection::Raw
    }

    fn sink(&self) -> Option<&dyn MessageSink> {
        Some(self)
    }
}

impl MessageSink for Counter {
    fn message(&self, message: &RawMessage<'_>) {
        let logged = u64::try_from(message.logged_ns).unwrap_or_default();
        self.0.borrow_mut().message(&message.topic.name, logged, message.payload);
    }

    fn extra(&self, extra: &Extra<'_>) {
        self.0.borrow_mut().extra(extra);
    }
}

/// Counts by topic; anything found but not written is a loss.
fn topics(health: &LogHealth, content: &Content, notices: &mut Notices) -> Vec<RecoveredTopic> {
    let mut found: BTreeMap<&str, u64> = BTreeMap::new();
    health.topics.iter().for_each(|t| *found.entry(&t.name).or_default() += t.messages);
    let topic = |(name, found): (&str, u64)| {
        let written = content.topics.get(name).map_or(0, |t| t.count);
        if written < found {
            let text = "messages that were found, but could not be written";
            notices.push(Code::NotWritten, format!("topic {name}"), found - written, text);
        }
        RecoveredTopic { name: name.to_owned(), found, written }
    };
    found.into_iter().map(topic).collect()
}

fn extras(content: &Content) -> Vec<RecoveredExtra> {
    let extra = |(what, tally): (&String, &Tally)| RecoveredExtra { what: what.clone(), count: tally.count };
    content.extras.iter().map(extra).collect()
}

fn note_remaining(recording: &Recording, notices: &mut Notices) {
    recording.note_before_epoch(notices);
    if let Some(first) = recording.several.first() {
        let text = format!(
            "topics with publishers that differ in name, latching or quality of service: the values of the first \
             publisher were kept; the first: {first}"
        );
        notices.push(Code::SeveralSources.at(Severity::Warning), "", recording.several.len() as u64, text);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_found_but_not_written_are_a_loss() {
        let topic = |name: &str, messages: u64| flight::TopicHealth {
            name: name.to_owned(),
            type_name: String::new(),
            encoding: String::new(),
            messages,
            payload_bytes: 0,
            stamps: vec![],
            decoded: true,
            reason: String::new(),
        };
        let health = LogHealth { topics: vec![topic("/fix", 2), topic("/imu", 3)], ..LogHealth::default() };
        let mut content = Content::default();
        for (name, messages) in [("/fix", 2), ("/imu", 1)] {
            (0..messages).for_each(|at| content.message(name, at, b"payload"));
        }
        let mut notices = Notices::new();
        let topics = topics(&health, &content, &mut notices);
        assert_eq!(topics.iter().map(|t| (t.found, t.written)).collect::<Vec<_>>(), [(2, 2), (3, 1)]);
        let raised: Vec<_> = notices.iter().map(|n| (n.code.as_str(), n.place.as_str(), n.count)).collect();
        assert_eq!(raised, [("not-written", "topic /imu", 2)]);
        assert!(notices.any_loss());
    }
}
