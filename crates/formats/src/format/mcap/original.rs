//! What an MCAP written by `flightlag recover` states about its source log.
//!
//! Messages of ULog, DataFlash, MAVLink, UBX, NMEA and text tables mean nothing outside their files. A recovered MCAP
//! has their values as ROS 2 messages, with names that ROS allows. The channel metadata name the original topic;
//! the definition names the original fields. The publish time is the timestamp as logged, the sequence number the line
//! or message number. One metadata record before these messages holds what the log stated besides its messages. With
//! these, the MCAP reads the same as its source log.

use crate::decode::leave_out_placeholders;
use crate::reader::{Log, Restart, Select, Selection, StatedUnit, ValueKind};
use crate::table::{Column, TopicInfo};
use flight::{About, Clock, Code, Notice, Notices, Severity};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, HashMap};

/// Key in the metadata of a channel, and name of the metadata record.
const ORIGINAL: &str = "flightlag-original";
/// Key in the metadata record.
const LOG: &str = "log";
/// Maximum text in a file about all its source logs, bytes.
const LONGEST: usize = 4 << 20;
/// Maximum source logs of one file: one, and one more for each time that part of it was lost.
const MOST_LOGS: usize = 16;
/// Maximum entries accepted for each list of one log. A log's own lists are shorter.
const MOST_LISTED: usize = 1000;
/// Maximum clock restarts accepted.
const MOST_RESTARTS: usize = 10_000;

/// What a topic was in its source log.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct OriginalTopic {
    /// Its type.
    pub type_name: String,
    /// Encoding of its messages in the source log.
    pub encoding: String,
    /// Clock of their log timestamps; `None` if nothing logged them.
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

/// What a log stated besides its messages.
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
    /// Where its clock since boot restarted.
    pub restarts: Vec<Restart>,
    /// Notices from when it was read.
    pub notices: Notices,
}

impl OriginalLog {
    /// What a log that was read states. NaN and infinity carry no information and are not valid JSON: they are omitted.
    #[must_use]
    pub fn of(log: &Log) -> OriginalLog {
        let mut about = log.health.about.clone();
        about.configured_delays.retain(|delay| delay.value_s.is_finite());
        OriginalLog {
            format: log.health.format.clone(),
            extras: log.health.extras.clone(),
            about,
            units: log
                .units
                .iter()
                .filter(|unit| unit.measures.is_none_or(|(_, si)| si.is_finite()))
                .cloned()
                .collect(),
            restarts: log.restarts.clone(),
            notices: log.notices.clone(),
        }
    }

    /// What was lost of a log whose messages were copied unchanged: everything else is found in them again.
    #[must_use]
    pub fn lost(log: &Log) -> Option<OriginalLog> {
        let mut notices = Notices::new();
        for loss in log.notices.iter().filter(|notice| notice.severity == Severity::Loss) {
            notices.add(loss.clone());
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

/// What the files of an MCAP state about their source log.
#[derive(Debug, Default)]
pub(super) struct Originals {
    /// The number and clock of each topic; `None` for topics read unconverted.
    topics: HashMap<TopicInfo, Option<(usize, Option<Clock>)>>,
    /// For each: line or message number of its rows in the source log.
    rows: Vec<Vec<u32>>,
    logs: Vec<OriginalLog>,
    log_bytes: usize,
    unreadable: u64,
}

impl Originals {
    /// The number of a topic that is read as its original; `None` for one that is read unconverted.
    ///
    /// Fails if another channel of the same topic disagrees about the original: their timestamps are of two clocks.
    pub(super) fn topic(&mut self, info: TopicInfo, original: Option<&OriginalTopic>) -> Result<Option<usize>, String> {
        let clock = original.map(|original| original.clock);
        let next = self.rows.len();
        let known = *self.topics.entry(info).or_insert_with(|| clock.map(|clock| (next, clock)));
        if known.map(|(_, clock)| clock) != clock {
            return Err("but another channel of the same topic states a different original".to_owned());
        }
        if known.is_some_and(|(number, _)| number == next) {
            self.rows.push(vec![]);
        }
        Ok(known.map(|(number, _)| number))
    }

    /// A row of a topic was read: the message's sequence number is its position in the source log.
    pub(super) fn row(&mut self, topic: usize, sequence: u32) {
        if let Some(rows) = self.rows.get_mut(topic) {
            rows.push(sequence);
        }
    }

    /// Reads a metadata record. A log that was recovered repeatedly has several.
    pub(super) fn metadata(&mut self, name: &str, entries: &BTreeMap<String, String>) {
        let Some(text) = entries.get(LOG).filter(|_| name == ORIGINAL) else { return };
        self.log_bytes = self.log_bytes.saturating_add(text.len());
        let fits = self.log_bytes <= LONGEST && self.logs.len() < MOST_LOGS;
        match fits.then(|| serde_json::from_str(text).ok()).flatten() {
            Some(log) => self.logs.push(log),
            None => self.unreadable += 1,
        }
    }

    /// Restores the source log.
    pub(super) fn restore(self, want: &dyn Select, log: &mut Log) {
        let clock_of = |name: &str, type_name: &str, encoding: &str| {
            let text = str::to_owned;
            let info = TopicInfo { name: text(name), type_name: text(type_name), encoding: text(encoding) };
            self.topics.get(&info).copied().flatten()
        };
        for topic in &mut log.health.topics {
            match clock_of(&topic.name, &topic.type_name, &topic.encoding) {
                Some((_, Some(clock))) => topic.stamps.iter_mut().for_each(|stamps| stamps.clock = clock),
                Some((_, None)) => topic.stamps.clear(),
                None => {}
            }
        }
        for table in &mut log.tables {
            let Some(Some((number, clock))) = self.topics.get(&table.topic) else { continue };
            let written = leave_out_placeholders(table);
            if let Selection::Fields(requests) = want.select(&table.topic) {
                // For example, text tables with a column that is wanted as text and as a number.
                let as_text = |c: &Column| requests.iter().any(|r| r.path == c.path && r.kind == ValueKind::Text);
                table.columns.extend(written.into_iter().filter(as_text));
                table.columns.sort_by(|a, b| a.path.cmp(&b.path));
            } else {
                log.written.extend(written.into_iter().map(|column| (table.topic.clone(), column)));
            }
            let rows = self.rows.get(*number).map(Vec::as_slice).unwrap_or_default();
            table.origin = rows.iter().map(|row| u64::from(*row)).collect();
            if clock.is_none() {
                table.logged_ns = None;
            }
        }
        if self.unreadable > 0 {
            let text = "the information about the log that this file was recovered from cannot be read";
            log.notices.push(Code::IndexDiffers, "", self.unreadable, text);
        }
        self.logs.into_iter().for_each(|original| original.put(log));
    }
}

impl OriginalLog {
    /// Shortens lists longer than those of any log, because all of it goes onto the page. Reports by how many entries.
    fn shorten(&mut self) -> u64 {
        let About {
            receivers,
            receiver_identities,
            lever_arms,
            configured_delays,
            parameter_changes,
            modes,
            texts,
            ..
        } = &mut self.about;
        let lists = [&mut self.extras, receivers, parameter_changes, texts].map(|list| cut(list, MOST_LISTED));
        lists.iter().sum::<u64>()
            + cut(configured_delays, MOST_LISTED)
            + cut(modes, MOST_LISTED)
            + cut(receiver_identities, MOST_LISTED)
            + cut(lever_arms, MOST_LISTED)
            + cut(&mut self.restarts, MOST_RESTARTS)
            + self.notices.len().saturating_sub(MOST_LISTED) as u64
    }

    /// What the source log had lost is not a loss of this one, but it is reported.
    fn put(mut self, log: &mut Log) {
        let more = self.shorten();
        let OriginalLog { format, extras, about, units, restarts, notices } = self;
        log.health.format = format!("{}, recovered from {format:.200}", log.health.format);
        log.health.extras.splice(0..0, extras);
        if log.health.about.is_empty() {
            log.health.about = about;
        }
        log.units.extend(units);
        log.restarts.extend(restarts);
        for notice in notices.iter().take(MOST_LISTED) {
            let (severity, text) = match notice.severity {
                Severity::Loss => (Severity::Warning, format!("when the log was recovered: {}", notice.text)),
                severity => (severity, notice.text.clone()),
            };
            log.notices.add(Notice { severity, text, ..notice.clone() });
        }
        if more > 0 {
            let text = "the information about the log that this file was recovered from is too long; not all of it \
                was read";
            log.notices.push(Code::IndexDiffers, "", more, text);
        }
    }
}

/// The number of entries beyond the limit of a list.
fn cut<T>(list: &mut Vec<T>, most: usize) -> u64 {
    let more = list.len().saturating_sub(most);
    list.truncate(most);
    more as u64
}
