//! What an MCAP that `flightlag recover` wrote says of the log that it comes from.
//!
//! Messages of ULog, DataFlash, MAVLink, UBX, NMEA and tables of text mean nothing outside of their files: a recovered MCAP
//! has their values as messages of ROS 2, with names that ROS allows. Each channel says in its metadata what its topic was,
//! the definition what its fields were called, the time of publishing is the stamp as it was logged, the sequence number the
//! line or message number, and one metadata record in front of these messages says what the log stated beside them. Read by
//! that, the MCAP is the log that it comes from.

use crate::decode::leave_out_placeholders;
use crate::reader::{Log, Restart, StatedUnit};
use crate::table::TopicInfo;
use flight::{About, Clock, Notices, Severity};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Key in the metadata of a channel, and name of the metadata record.
const ORIGINAL: &str = "flightlag-original";
/// Key in the metadata record.
const LOG: &str = "log";
/// What a file may say in all of the logs that it was recovered from, bytes.
const LONGEST: usize = 4 << 20;
/// Begins of a clock that are believed.
const MOST_RESTARTS: usize = 10_000;

/// What a topic was in the log that it comes from.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct OriginalTopic {
    /// Its type.
    pub type_name: String,
    /// Encoding of its messages there.
    pub encoding: String,
    /// Clock of the stamps that the log has of them; `None` if nobody logged them.
    pub clock: Option<Clock>,
}

impl OriginalTopic {
    /// As the metadata of a channel.
    #[must_use]
    pub fn entries(&self) -> BTreeMap<String, String> {
        [(ORIGINAL.to_owned(), serde_json::to_string(self).unwrap_or_default())].into()
    }

    /// From the metadata of a channel.
    pub(super) fn of(entries: &BTreeMap<String, String>) -> Option<OriginalTopic> {
        serde_json::from_str(entries.get(ORIGINAL)?).ok()
    }
}

/// What a log stated beside its messages.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct OriginalLog {
    /// Its format.
    pub format: String,
    /// Attachments and the like, by name.
    pub extras: Vec<String>,
    /// Vehicle and settings.
    pub about: About,
    /// Units of its fields.
    pub units: Vec<StatedUnit>,
    /// Where its clock since boot began anew.
    pub restarts: Vec<Restart>,
    /// What was found when it was read.
    pub notices: Notices,
}

impl OriginalLog {
    /// What a log states that was read. Numbers that are none say nothing, and JSON does not know them: they are left out.
    #[must_use]
    pub fn of(log: &Log) -> OriginalLog {
        let mut about = log.health.about.clone();
        about.configured_delays.retain(|delay| delay.value_s.is_finite());
        OriginalLog {
            format: log.health.format.clone(),
            extras: log.health.extras.clone(),
            about,
            units: log.units.iter().filter(|unit| unit.si.is_finite()).cloned().collect(),
            restarts: log.restarts.clone(),
            notices: log.notices.clone(),
        }
    }

    /// What was lost of a log whose messages were copied as they stand: everything else is found in them again.
    #[must_use]
    pub fn lost(log: &Log) -> Option<OriginalLog> {
        let mut notices = Notices::new();
        for loss in log.notices.iter().filter(|notice| notice.severity == Severity::Loss) {
            notices.push(loss.severity, &loss.code, &loss.place, loss.count, &loss.text);
        }
        let format = log.health.format.clone();
        (!notices.is_empty()).then(|| OriginalLog { format, notices, ..OriginalLog::default() })
    }

    /// Name and texts of the metadata record.
    #[must_use]
    pub fn metadata(&self) -> (&'static str, BTreeMap<String, String>) {
        (ORIGINAL, [(LOG.to_owned(), serde_json::to_string(self).unwrap_or_default())].into())
    }
}

/// What the files of an MCAP say of the log that they come from.
#[derive(Debug, Default)]
pub(super) struct Originals {
    /// The number of each, and its clock.
    topics: BTreeMap<TopicInfo, (usize, Option<Clock>)>,
    /// For each: line or message number of its rows in the original.
    rows: Vec<Vec<u32>>,
    logs: Vec<OriginalLog>,
    log_bytes: usize,
    unreadable: u64,
}

impl Originals {
    /// The number of a topic that is read as the one that it was.
    pub(super) fn topic(&mut self, info: &TopicInfo, clock: Option<Clock>) -> usize {
        if let Some((number, _)) = self.topics.get(info) {
            return *number;
        }
        self.rows.push(vec![]);
        self.topics.insert(info.clone(), (self.rows.len() - 1, clock));
        self.rows.len() - 1
    }

    /// A row was read of a topic: the message's sequence number says where it stood.
    pub(super) fn row(&mut self, topic: usize, sequence: u32) {
        if let Some(rows) = self.rows.get_mut(topic) {
            rows.push(sequence);
        }
    }

    /// Looks at a metadata record. A log that was recovered again has several.
    pub(super) fn metadata(&mut self, name: &str, entries: &BTreeMap<String, String>) {
        let Some(text) = entries.get(LOG).filter(|_| name == ORIGINAL) else { return };
        self.log_bytes = self.log_bytes.saturating_add(text.len());
        let log = if self.log_bytes <= LONGEST { serde_json::from_str(text).ok() } else { None };
        match log {
            Some(log) => self.logs.push(log),
            None => self.unreadable += 1,
        }
    }

    /// Makes the log what it was.
    pub(super) fn restore(self, log: &mut Log) {
        let clock_of = |name: &str, type_name: &str, encoding: &str| {
            let text = str::to_owned;
            let info = TopicInfo { name: text(name), type_name: text(type_name), encoding: text(encoding) };
            self.topics.get(&info).copied()
        };
        for topic in &mut log.health.topics {
            match clock_of(&topic.name, &topic.type_name, &topic.encoding) {
                Some((_, Some(clock))) => topic.stamps.iter_mut().for_each(|stamps| stamps.clock = clock),
                Some((_, None)) => topic.stamps.clear(),
                None => {}
            }
        }
        for table in &mut log.tables {
            let Some((number, clock)) = self.topics.get(&table.topic) else { continue };
            leave_out_placeholders(table);
            let rows = self.rows.get(*number).map(|rows| rows.iter().map(|row| u64::from(*row)).collect::<Vec<u64>>());
            table.origin = rows.filter(|rows| (1..).zip(rows).any(|(row, at)| row != *at));
            if clock.is_none() {
                table.logged_ns = None;
            }
        }
        if self.unreadable > 0 {
            let text = "what the file says of the log that it was recovered from cannot be read";
            log.notices.push(Severity::Warning, "original-unreadable", "", self.unreadable, text);
        }
        self.logs.into_iter().for_each(|original| original.put(log));
    }
}

impl OriginalLog {
    /// What was lost of the log then is not lost of this one: it is no loss here, but it is told.
    fn put(self, log: &mut Log) {
        let OriginalLog { format, extras, about, units, restarts, notices } = self;
        log.health.format = format!("{}, recovered from {format}", log.health.format);
        log.health.extras.splice(0..0, extras);
        if log.health.about.is_empty() {
            log.health.about = about;
        }
        log.units.extend(units);
        log.restarts.extend(restarts.into_iter().take(MOST_RESTARTS));
        for notice in notices.iter() {
            let (severity, text) = match notice.severity {
                Severity::Loss => (Severity::Warning, format!("when the log was recovered: {}", notice.text)),
                severity => (severity, notice.text.clone()),
            };
            log.notices.push(severity, &notice.code, &notice.place, notice.count, text);
        }
    }
}
