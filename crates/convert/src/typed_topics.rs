//! Rewrites rows as ROS 2 messages, for logs whose own messages mean nothing outside the log.
//!
//! The original topics are recorded with them ([`OriginalTopic`], [`OriginalLog`]), so that the output is read as the
//! log is.

use crate::error::ConvertError;
use crate::export::ROWS_AT_ONCE;
use crate::message_type::MessageType;
use crate::recording::{Entry, Recording};
use crate::row_time::{LogTime, LogTimes};
use flight::{Clock, Notices, TopicHealth};
use ingest::{Column, Extra, IngestError, Log, OriginalLog, OriginalTopic, Places, ReadContext, Table, TopicInfo};

/// A table being written.
struct Topic<'t> {
    table: &'t Table,
    messages: MessageType<'t>,
    info: TopicInfo,
    original: OriginalTopic,
}

/// Writes the log's statements, its topics without messages, and the rows of all tables in the order of `log_times`.
/// Rows of one table keep the order of the log.
pub(crate) fn write(
    log: &Log,
    times: &LogTimes,
    log_times: &[LogTime],
    recording: &mut Recording,
    notices: &mut Notices,
    context: &ReadContext<'_>,
) -> Result<(), ConvertError> {
    let (name, entries) = OriginalLog::of(log).metadata();
    recording.extra(&Extra::Metadata { name, entries: &entries })?;
    for topic in log.health.topics.iter().filter(|topic| topic.messages == 0) {
        announce(topic, recording)?;
    }
    let tables = log.tables.iter().zip(&times.tables);
    let topics: Vec<Topic<'_>> =
        tables.map(|(table, time)| Topic::of(table, written(log, table), time.logged_by())).collect();
    topics.iter().for_each(|topic| topic.messages.note_absent(notices));
    let mut payload = vec![];
    for (count, (number, row, logged_ns)) in in_order(log_times).enumerate() {
        if count.is_multiple_of(ROWS_AT_ONCE) {
            context.advance(0).map_err(IngestError::from)?;
        }
        let Some(topic) = topics.get(number as usize) else { continue };
        topic.messages.payload(row as usize, &mut payload);
        // The timestamp as logged, also where its clock restarted.
        let stamp = topic.table.logged_ns.as_ref().and_then(|stamps| stamps.get(row as usize).copied());
        let sequence = u32::try_from(topic.table.origin_of(row as usize)).ok();
        recording.write(&Entry { logged_ns, published_ns: stamp, sequence, payload: &payload, ..topic.entry() })?;
    }
    Ok(())
}

/// The decimals of a table as originally written.
fn written<'l>(log: &'l Log, table: &Table) -> Vec<&'l Column> {
    log.written.iter().filter(|(topic, _)| *topic == table.topic).map(|(_, column)| column).collect()
}

/// Table, row and time of all rows by time; the rows of one table keep their order, whatever their times.
fn in_order(times: &[LogTime]) -> impl Iterator<Item = (u32, u32, i64)> + use<> {
    // The latest time so far, table, row, time.
    let mut order: Vec<(i64, u32, u32, i64)> = vec![];
    for (number, time) in (0_u32..).zip(times) {
        let mut latest = i64::MIN;
        order.extend(time.nanos.iter().zip(0_u32..).map(|(&t, row)| {
            latest = latest.max(t);
            (latest, number, row, t)
        }));
    }
    order.sort_unstable();
    order.into_iter().map(|(_, number, row, time)| (number, row, time))
}

impl<'t> Topic<'t> {
    fn of(table: &'t Table, written: Vec<&'t Column>, clock: Option<Clock>) -> Topic<'t> {
        let messages = MessageType::of(table, written);
        let TopicInfo { type_name, encoding, .. } = table.topic.clone();
        Topic { table, info: messages.topic(), original: OriginalTopic { type_name, encoding, clock }, messages }
    }

    /// An entry without payload.
    fn entry(&self) -> Entry<'_> {
        Entry {
            topic: &self.info,
            original: Some(&self.original),
            encoding: "cdr",
            schema_encoding: "ros2msg",
            schema: self.messages.definition(),
            logged_ns: 0,
            published_ns: None,
            sequence: None,
            payload: &[],
        }
    }
}

/// Registers a topic without messages.
fn announce(topic: &TopicHealth, recording: &mut Recording) -> Result<(), ConvertError> {
    let TopicHealth { name, type_name, encoding, .. } = topic.clone();
    let info = TopicInfo { name, type_name, encoding };
    let empty =
        Table { topic: info, rows: 0, logged_ns: None, published_ns: None, origin: Places::default(), columns: vec![] };
    recording.announce(&Topic::of(&empty, vec![], None).entry())
}
