//! What an MCAP that `flightlag recover` wrote says of the log that it comes from.
//!
//! Messages of ULog, DataFlash, MAVLink, UBX, NMEA and tables of text mean nothing outside of their files: a recovered MCAP
//! has their values as messages of ROS 2, with names that ROS allows. Each channel says in its metadata what its topic was,
//! the definition what its fields were called, the time of publishing is the stamp as it was logged, the sequence number the
//! line or message number, and one metadata record in front of these messages says what the log stated beside them. Read by
//! that, the MCAP is the log that it comes from.

use crate::decode::leave_out_placeholders;
use crate::reader::{Log, Restart, Select, Selection, StatedUnit, ValueKind};
use crate::table::{Column, TopicInfo};
use flight::{About, Clock, Code, Notice, Notices, Severity};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Key in the metadata of a channel, and name of the metadata record.
const ORIGINAL: &str = "flightlag-original";
/// Key in the metadata record.
const LOG: &str = "log";
/// What a file may say in all of the logs that it was recovered from, bytes.
const LONGEST: usize = 4 << 20;
/// Logs that one file may come from: one, and one more for each time that something of it was lost.
const MOST_LOGS: usize = 16;
/// What is believed of each list of one log. What a log that was read says of itself is shorter.
const MOST_LISTED: usize = 1000;
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

    /// What was lost of a log whose messages were copied as they stand: everything else is found in them again.
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

/// What the files of an MCAP say of the log that they come from.
#[derive(Debug, Default)]
pub(super) struct Originals {
    /// The number of each, and its clock; `None` for those that are read as they stand.
    topics: BTreeMap<TopicInfo, Option<(usize, Option<Clock>)>>,
    /// For each: line or message number of its rows in the original.
    rows: Vec<Vec<u32>>,
    logs: Vec<OriginalLog>,
    log_bytes: usize,
    unreadable: u64,
}

impl Originals {
    /// The number of a topic that is read as the one that it was; `None` for one that is read as it stands.
    ///
    /// Fails if another channel of the same topic says something else of it: their stamps are of two clocks.
    pub(super) fn topic(&mut self, info: TopicInfo, original: Option<&OriginalTopic>) -> Result<Option<usize>, String> {
        let clock = original.map(|original| original.clock);
        let next = self.rows.len();
        let known = *self.topics.entry(info).or_insert_with(|| clock.map(|clock| (next, clock)));
        if known.map(|(_, clock)| clock) != clock {
            return Err("of whose topic another channel says that it was something else".to_owned());
        }
        if known.is_some_and(|(number, _)| number == next) {
            self.rows.push(vec![]);
        }
        Ok(known.map(|(number, _)| number))
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
        let fits = self.log_bytes <= LONGEST && self.logs.len() < MOST_LOGS;
        match fits.then(|| serde_json::from_str(text).ok()).flatten() {
            Some(log) => self.logs.push(log),
            None => self.unreadable += 1,
        }
    }

    /// Makes the log what it was.
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
                // As tables of text have a column that is wanted as text and as a number.
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
            let text = "what the file says of the log that it was recovered from cannot be read";
            log.notices.push(Code::IndexDiffers, "", self.unreadable, text);
        }
        self.logs.into_iter().for_each(|original| original.put(log));
    }
}

impl OriginalLog {
    /// Shortens what is longer than any log says, for all of it goes onto the page. Says by how many entries.
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

    /// What was lost of the log then is not lost of this one: it is no loss here, but it is told.
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
            let text = "the file says more of the log that it was recovered from than a log has to say: not all of it is taken";
            log.notices.push(Code::IndexDiffers, "", more, text);
        }
    }
}

/// How many entries of a list were too many.
fn cut<T>(list: &mut Vec<T>, most: usize) -> u64 {
    let more = list.len().saturating_sub(most);
    list.truncate(most);
    more as u64
}
