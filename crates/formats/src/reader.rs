//! The interface of every format: columns of the wanted topics, and an account of every byte.

use crate::table::{Column, Table, TopicInfo};
use flight::{Dimension, LogHealth, Notices};
pub use logscan::{Limits, ReadContext};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The content of a log.
#[derive(Debug, Default)]
pub struct Log {
    /// Format, bytes, topics, damage.
    pub health: LogHealth,
    /// The wanted topics that could be decoded, sorted by topic.
    pub tables: Vec<Table>,
    /// Notices of the reading.
    pub notices: Notices,
    /// Units of fields that the log itself states.
    pub units: Vec<StatedUnit>,
    /// Fields that got no column although all were wanted.
    pub left_out: Vec<LeftOut>,
    /// Large decimals of text tables, as written, if all fields are wanted: their float column has lost the last
    /// digits, which a timestamp needs.
    pub written: Vec<(TopicInfo, Column)>,
    /// Where the clock since boot of the log's own vehicle restarted, in the order of the log.
    pub restarts: Vec<Restart>,
    /// The headers of text tables: all their columns, wanted or not.
    pub heads: Vec<TableHead>,
}

impl Log {
    /// The header of a text table.
    pub fn head(&self, topic: &str) -> Option<&TableHead> {
        self.heads.iter().find(|head| head.topic == topic)
    }
}

/// The header of a text table.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct TableHead {
    /// The topic.
    pub topic: String,
    /// Names of all columns, in the order of the file.
    pub names: Vec<String>,
    /// The cells of the line of units, as written; empty if there is no such line.
    pub units: Vec<String>,
    /// The line that names the columns, if it is not the header because of a line above it.
    pub unused_names: Option<u64>,
}

impl TableHead {
    /// The unit of a column in the line of units, or else in brackets at the end of its name; empty if there is
    /// neither.
    pub fn unit_of<'a>(&'a self, name: &'a str) -> &'a str {
        let index = self.names.iter().position(|n| n == name);
        let cell = index.and_then(|index| self.units.get(index)).map_or("", String::as_str);
        if crate::written_unit::is_blank(cell) { crate::written_unit::in_brackets(name).unwrap_or("") } else { cell }
    }
}

/// A restart of a clock since boot within a log.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Restart {
    /// A log time, ns: messages logged at or after it are on the restarted clock.
    pub logged_ns: i64,
    /// The clock went back. Otherwise a restart is only likely, and the dates on both sides must confirm it.
    pub certain: bool,
}

/// Fields without a column although every field is wanted: variable-length arrays, long ones after their first
/// elements, byte strings.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LeftOut {
    /// The topic.
    pub topic: String,
    /// The number of fields.
    pub fields: u64,
    /// The first few, for the user.
    pub names: String,
}

/// The unit of a field as the log states it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StatedUnit {
    /// Message type.
    pub type_name: String,
    /// Dotted path of the field.
    pub path: String,
    /// As written in the log, after a factor if the values are multiples of the unit.
    pub text: String,
    /// Its dimension, and its size in SI units and radians; `None` if channels do not use it.
    pub measures: Option<(Dimension, f64)>,
}

/// Decides which topics and fields are decoded.
pub trait Select {
    /// The selection for `topic`.
    fn select(&self, topic: &TopicInfo) -> Selection;

    /// The text of a ROS type, `package/Type`, that the log does not define; without the types that it uses.
    fn definition(&self, _type_name: &str) -> Option<&str> {
        None
    }

    /// The receiver of messages of topics selected as [`Selection::Raw`].
    fn sink(&self) -> Option<&dyn MessageSink> {
        None
    }
}

/// Receives undecoded messages.
pub trait MessageSink {
    /// An intact message, in file order.
    fn message(&self, message: &RawMessage<'_>);

    /// Intact data other than messages, in file order.
    fn extra(&self, _extra: &Extra<'_>) {}
}

/// Data in a log other than messages.
#[derive(Debug, Clone, Copy)]
pub enum Extra<'m> {
    /// A file within the log. Its checksum, if it has one, is correct.
    Attachment {
        /// File name.
        name: &'m str,
        /// Such as `text/plain`.
        media_type: &'m str,
        /// When it was added to the log, ns.
        logged_ns: u64,
        /// When it was created, ns.
        created_ns: u64,
        /// Its bytes.
        data: &'m [u8],
    },
    /// Texts by name, including format-specific data (parameters, logged texts).
    Metadata {
        /// Name of the record.
        name: &'m str,
        /// The texts.
        entries: &'m BTreeMap<String, String>,
    },
    /// Properties of a topic other than its type, such as the QoS of its publisher. Comes before the topic's first
    /// message, possibly more than once.
    OfTopic {
        /// Name of the topic.
        topic: &'m str,
        /// The texts.
        entries: &'m BTreeMap<String, String>,
    },
}

/// An undecoded message.
#[derive(Debug, Clone, Copy)]
pub struct RawMessage<'m> {
    /// Its topic.
    pub topic: &'m TopicInfo,
    /// Encoding of the definition, such as `ros2msg`; empty if the log has none.
    pub schema_encoding: &'m str,
    /// Definition of the type.
    pub schema: &'m [u8],
    /// The time at which the message was logged, as the log states it, ns.
    pub logged_ns: i64,
    /// The time at which the message was published, as the log states it, ns.
    pub published_ns: Option<i64>,
    /// The container's message number; `None` where containers have none.
    pub sequence: Option<u32>,
    /// Its bytes.
    pub payload: &'m [u8],
}

impl<F: Fn(&TopicInfo) -> Selection> Select for F {
    fn select(&self, topic: &TopicInfo) -> Selection {
        self(topic)
    }
}

/// The selection for a topic.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Selection {
    /// Nothing: its messages are counted and timed, not decoded.
    Skip,
    /// These fields. A field that the message lacks is absent from the table.
    Fields(Vec<FieldRequest>),
    /// Every field: numbers as numbers, text as text.
    All,
    /// The messages themselves go to [`Select::sink`] and make no table. Formats whose messages have no meaning outside
    /// their file (ULog, DataFlash, tables) are read as with [`Selection::All`] instead. Undecoded receiver and MAVLink
    /// messages become text, or bytes in hexadecimal digits ([`crate::PAYLOAD_HEX`]).
    Raw,
}

/// A wanted field and its kind.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct FieldRequest {
    /// Dotted path, such as `twist.linear.x`; elements of arrays as `position_covariance[0]`.
    pub path: String,
    /// Number or text.
    pub kind: ValueKind,
}

/// The wanted kind of a value. Matters for formats without types, such as CSV.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum ValueKind {
    /// A number; any other cell is rejected and counted.
    Number,
    /// Text, unchanged.
    Text,
}
