//! What every format offers: columns of the wanted topics, and where every byte went.

use crate::error::IngestError;
use crate::table::{Column, Table, TopicInfo};
use flight::{Dimension, LogHealth, Notices};
pub use logscan::{Limits, ReadContext};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A log of any format, opened and recognised.
pub trait LogReader {
    /// Reads the log once from its first byte to its last.
    ///
    /// `want` is asked once for each topic, before its first message. Damage is no error: what
    /// is intact before and after it comes back, with the damage in the health and a notice.
    /// Messages are decoded in the caller's thread; idle threads of the rayon pool that it belongs to, or else of one of
    /// up to four threads for all logs, may decompress chunks meanwhile.
    ///
    /// # Errors
    /// Only when nothing at all can be used, when the file cannot be read, or on cancellation.
    fn read(&mut self, want: &dyn Select, context: &ReadContext<'_>) -> Result<Log, IngestError>;
}

/// What came out of a log.
#[derive(Debug, Default)]
pub struct Log {
    /// Format, bytes, topics, damage.
    pub health: LogHealth,
    /// The wanted topics that could be decoded, sorted by topic.
    pub tables: Vec<Table>,
    /// What happened on the way.
    pub notices: Notices,
    /// Units that the log itself states of its fields.
    pub units: Vec<StatedUnit>,
    /// Fields that no column took although all were wanted.
    pub left_out: Vec<LeftOut>,
    /// Large decimals of tables of text, as they were written, where all fields are wanted: the column of floats beside them
    /// has lost their last digits, and a stamp must not.
    pub written: Vec<(TopicInfo, Column)>,
    /// Where the clock since boot of the vehicle that the log is of began anew, in the order of the log.
    pub restarts: Vec<Restart>,
    /// The headers of tables of text: all their columns, wanted or not.
    pub heads: Vec<TableHead>,
}

impl Log {
    /// The header of a table of text.
    pub(crate) fn head(&self, topic: &str) -> Option<&TableHead> {
        self.heads.iter().find(|head| head.topic == topic)
    }
}

/// The header of a table of text.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct TableHead {
    /// The topic.
    pub topic: String,
    /// Names of all columns, in the order of the file.
    pub names: Vec<String>,
    /// The cells of the line of units, as written; empty where there is no such line.
    pub units: Vec<String>,
}

impl TableHead {
    /// What the line of units says of a column, or else the brackets at the end of its name; empty where neither says anything.
    pub(crate) fn unit_of<'a>(&'a self, name: &'a str) -> &'a str {
        let index = self.names.iter().position(|n| n == name);
        let cell = index.and_then(|index| self.units.get(index)).map_or("", String::as_str);
        if crate::written_unit::is_blank(cell) { crate::written_unit::in_brackets(name).unwrap_or("") } else { cell }
    }
}

/// A clock since boot that began anew within a log.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Restart {
    /// A log time, ns: messages that the log has at it or later are of the clock that began then.
    pub logged_ns: i64,
    /// The clock went back. Else something else looks like it, and it is for the dates on both sides to tell.
    pub certain: bool,
}

/// Fields of a topic that are no columns although every field is wanted: arrays of any length, long ones beyond their first
/// elements, byte strings.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LeftOut {
    /// The topic.
    pub topic: String,
    /// How many.
    pub fields: u64,
    /// The first few, for people.
    pub names: String,
}

/// The unit of a field as the log states it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StatedUnit {
    /// Message type.
    pub type_name: String,
    /// Dotted path of the field.
    pub path: String,
    /// As the log writes it, behind a factor where the values are in multiples of it.
    pub text: String,
    /// What it measures, and one of it in SI units and radians; `None` if it is none that channels have.
    pub measures: Option<(Dimension, f64)>,
}

/// Decides which topics and fields are decoded.
pub trait Select {
    /// What is wanted of `topic`.
    fn select(&self, topic: &TopicInfo) -> Selection;

    /// The text of a ROS type, `package/Type`, that the log does not define; without the types that it refers to.
    fn definition(&self, _type_name: &str) -> Option<&str> {
        None
    }

    /// Who takes the messages of topics selected as [`Selection::Raw`].
    fn sink(&self) -> Option<&dyn MessageSink> {
        None
    }
}

/// Takes messages as they stand in the log.
pub trait MessageSink {
    /// An intact message, in file order.
    fn message(&self, message: &RawMessage<'_>);

    /// Something intact that the log holds beside its messages, in file order.
    fn extra(&self, _extra: &Extra<'_>) {}
}

/// What a log holds beside its messages.
#[derive(Debug, Clone, Copy)]
pub enum Extra<'m> {
    /// A file within the log. If it states a checksum, it is right.
    Attachment {
        /// File name.
        name: &'m str,
        /// As `text/plain`.
        media_type: &'m str,
        /// When it was put into the log, ns.
        logged_ns: u64,
        /// When it was made, ns.
        created_ns: u64,
        /// Its bytes.
        data: &'m [u8],
    },
    /// Texts by name. What a format keeps in a way of its own (parameters, logged texts) comes as such too.
    Metadata {
        /// Name of them all.
        name: &'m str,
        /// The texts.
        entries: &'m BTreeMap<String, String>,
    },
    /// What the log says of a topic beside its type, as how its publisher offers it. Comes before the topic's first message,
    /// and maybe more than once.
    OfTopic {
        /// Name of the topic.
        topic: &'m str,
        /// The texts.
        entries: &'m BTreeMap<String, String>,
    },
}

/// A message as it stands in the log.
#[derive(Debug, Clone, Copy)]
pub struct RawMessage<'m> {
    /// Its topic.
    pub topic: &'m TopicInfo,
    /// Encoding of the definition, as `ros2msg`; empty if the log has none.
    pub schema_encoding: &'m str,
    /// Definition of the type.
    pub schema: &'m [u8],
    /// When the log says that it was logged, ns.
    pub logged_ns: i64,
    /// When the log says that it was published, ns.
    pub published_ns: Option<i64>,
    /// Its number as the container has it; `None` where containers have none.
    pub sequence: Option<u32>,
    /// Its bytes.
    pub payload: &'m [u8],
}

impl<F: Fn(&TopicInfo) -> Selection> Select for F {
    fn select(&self, topic: &TopicInfo) -> Selection {
        self(topic)
    }
}

/// What is wanted of a topic.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Selection {
    /// Nothing: its messages are counted and timed, not decoded.
    Skip,
    /// These fields. One that the message does not have is absent from the table.
    Fields(Vec<FieldRequest>),
    /// Every field: numbers as numbers, text as text.
    All,
    /// The messages themselves go to [`Select::sink`] and make no table. Formats whose messages mean nothing
    /// outside of their file (ULog, DataFlash, tables) are read as with [`Selection::All`] instead; of a receiver's and of
    /// MAVLink's, those that are not decoded become text, or bytes in hexadecimal digits ([`crate::PAYLOAD_HEX`]).
    Raw,
}

/// A field and how it is wanted.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct FieldRequest {
    /// Dotted path, as `twist.linear.x`; elements of arrays as `position_covariance[0]`.
    pub path: String,
    /// Number or text.
    pub kind: ValueKind,
}

/// How a value is wanted. Matters where a format does not know its types, as CSV.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum ValueKind {
    /// A number; a cell that is none is rejected and counted.
    Number,
    /// Text as it stands.
    Text,
}
