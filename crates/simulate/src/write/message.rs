//! Messages as trees of named values, and their four encodings.

use crate::error::SimulateError;
use flight::{NANOS_PER_SECOND, Stamp};
use serde::ser::{Serialize, SerializeMap, SerializeSeq, Serializer};

/// A message before it is encoded.
#[derive(Debug, Clone)]
pub(crate) struct Message {
    /// Index into the topics of its [`super::Logbook`].
    pub(crate) topic: usize,
    /// Sequence number within its topic.
    pub(crate) sequence: u32,
    /// Arrival at the logger.
    pub(crate) logged: Stamp,
    /// Its content, in the order of its definition.
    pub(crate) fields: Fields,
}

/// Named values in the order of a definition.
pub(crate) type Fields = Vec<(&'static str, Value)>;

/// A value of a message.
#[derive(Debug, Clone)]
pub(crate) enum Value {
    F64(f64),
    I8(i8),
    U8(u8),
    U16(u16),
    I64(i64),
    Text(String),
    Time(Stamp),
    /// `std_msgs/Header`.
    Header(Header),
    /// An array of fixed length.
    Fixed(Vec<f64>),
    /// A variable-length array.
    Sequence(Vec<f64>),
    /// A variable-length array of bytes.
    Bytes(Vec<u8>),
    /// A variable-length array of texts.
    Texts(Vec<&'static str>),
    Message(Fields),
}

/// `std_msgs/Header`; only ROS 1 has the sequence number.
#[derive(Debug, Clone)]
pub(crate) struct Header {
    pub(crate) sequence: u32,
    pub(crate) stamp: Stamp,
    pub(crate) frame_id: &'static str,
}

/// The two halves of a ROS time: s and ns.
pub(super) fn halves(stamp: Stamp) -> (i64, i64) {
    (stamp.0.div_euclid(NANOS_PER_SECOND), stamp.0.rem_euclid(NANOS_PER_SECOND))
}

/// The two 32-bit halves of a ROS time.
pub(crate) fn ros_time(stamp: Stamp) -> [u8; 8] {
    let (sec, nanosec) = halves(stamp);
    let mut bytes = [0; 8];
    bytes[..4].copy_from_slice(&(sec as u32).to_le_bytes());
    bytes[4..].copy_from_slice(&(nanosec as u32).to_le_bytes());
    bytes
}

impl Message {
    /// ROS 1 serialisation.
    pub(crate) fn ros1(&self) -> Vec<u8> {
        let mut wire = Wire { bytes: Vec::with_capacity(160), cdr: false };
        wire.fields(&self.fields);
        wire.bytes
    }

    /// CDR, little-endian, with its encapsulation header.
    pub(crate) fn cdr(&self) -> Vec<u8> {
        let mut wire = Wire { bytes: vec![0, 1, 0, 0], cdr: true };
        wire.fields(&self.fields);
        wire.bytes
    }

    /// JSON with the field names of ROS 2.
    pub(crate) fn json(&self) -> Result<Vec<u8>, SimulateError> {
        Ok(serde_json::to_vec(&Object(&self.fields))?)
    }

    /// The cells of `rostopic echo -p`: log time first.
    pub(crate) fn csv_row(&self) -> String {
        let mut cells = vec![self.logged.0.to_string()];
        self.fields.iter().for_each(|(_, value)| value.cells(&mut cells));
        cells.join(",") + "\n"
    }

    /// Names of the cells of [`Message::csv_row`].
    pub(crate) fn csv_header(&self) -> String {
        let mut names = vec!["%time".to_owned()];
        self.fields.iter().for_each(|(name, value)| value.names(&format!("field.{name}"), &mut names));
        names.join(",") + "\n"
    }
}

impl Value {
    fn cells(&self, cells: &mut Vec<String>) {
        match self {
            Value::F64(v) => cells.push(v.to_string()),
            Value::I8(v) => cells.push(v.to_string()),
            Value::U8(v) => cells.push(v.to_string()),
            Value::U16(v) => cells.push(v.to_string()),
            Value::I64(v) => cells.push(v.to_string()),
            Value::Text(text) => cells.push(quoted(text)),
            Value::Time(stamp) => cells.push(stamp.0.to_string()),
            Value::Header(header) => {
                cells.extend([header.sequence.to_string(), header.stamp.0.to_string(), header.frame_id.to_owned()]);
            }
            Value::Fixed(values) | Value::Sequence(values) => cells.extend(values.iter().map(f64::to_string)),
            Value::Bytes(bytes) => cells.extend(bytes.iter().map(u8::to_string)),
            Value::Texts(texts) => cells.extend(texts.iter().map(|text| quoted(text))),
            Value::Message(fields) => fields.iter().for_each(|(_, value)| value.cells(cells)),
        }
    }

    fn names(&self, path: &str, names: &mut Vec<String>) {
        let numbered = |count: usize| (0..count).map(|i| format!("{path}{i}")).collect::<Vec<_>>();
        match self {
            Value::Header(_) => names.extend(["seq", "stamp", "frame_id"].map(|part| format!("{path}.{part}"))),
            Value::Fixed(values) | Value::Sequence(values) => names.extend(numbered(values.len())),
            Value::Bytes(bytes) => names.extend(numbered(bytes.len())),
            Value::Texts(texts) => names.extend(numbered(texts.len())),
            Value::Message(fields) => fields.iter().for_each(|(name, v)| v.names(&format!("{path}.{name}"), names)),
            _ => names.push(path.to_owned()),
        }
    }
}

fn quoted(text: &str) -> String {
    if text.contains(['"', ',', '\n']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}

/// Fields as a JSON object, in their order.
struct Object<'a>(&'a Fields);

impl Serialize for Object<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.0.len()))?;
        self.0.iter().try_for_each(|(name, value)| map.serialize_entry(name, value))?;
        map.end()
    }
}

impl Serialize for Value {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Value::F64(v) => serializer.serialize_f64(*v),
            Value::I8(v) => serializer.serialize_i8(*v),
            Value::U8(v) => serializer.serialize_u8(*v),
            Value::U16(v) => serializer.serialize_u16(*v),
            Value::I64(v) => serializer.serialize_i64(*v),
            Value::Text(text) => serializer.serialize_str(text),
            Value::Time(stamp) => {
                let (sec, nanosec) = halves(*stamp);
                Object(&vec![("sec", Value::I64(sec)), ("nanosec", Value::I64(nanosec))]).serialize(serializer)
            }
            Value::Header(Header { stamp, frame_id, .. }) => {
                let fields = vec![("stamp", Value::Time(*stamp)), ("frame_id", Value::Text((*frame_id).to_owned()))];
                Object(&fields).serialize(serializer)
            }
            Value::Fixed(values) | Value::Sequence(values) => {
                let mut seq = serializer.serialize_seq(Some(values.len()))?;
                values.iter().try_for_each(|value| seq.serialize_element(value))?;
                seq.end()
            }
            Value::Bytes(bytes) => bytes.serialize(serializer),
            Value::Texts(texts) => {
                let mut seq = serializer.serialize_seq(Some(texts.len()))?;
                texts.iter().try_for_each(|text| seq.serialize_element(text))?;
                seq.end()
            }
            Value::Message(fields) => Object(fields).serialize(serializer),
        }
    }
}

/// Bytes of a message: packed (ROS 1), or each aligned to its size (CDR).
struct Wire {
    bytes: Vec<u8>,
    cdr: bool,
}

impl Wire {
    fn fields(&mut self, fields: &Fields) {
        fields.iter().for_each(|(_, value)| self.value(value));
    }

    fn value(&mut self, value: &Value) {
        match value {
            Value::F64(v) => self.put(v.to_le_bytes()),
            Value::I8(v) => self.put(v.to_le_bytes()),
            Value::U8(v) => self.put(v.to_le_bytes()),
            Value::U16(v) => self.put(v.to_le_bytes()),
            Value::I64(v) => self.put(v.to_le_bytes()),
            Value::Text(text) => self.text(text),
            Value::Time(stamp) => self.time(*stamp),
            Value::Header(header) => self.header(header),
            Value::Fixed(values) => values.iter().for_each(|v| self.put(v.to_le_bytes())),
            Value::Sequence(values) => {
                self.put((values.len() as u32).to_le_bytes());
                values.iter().for_each(|v| self.put(v.to_le_bytes()));
            }
            Value::Bytes(bytes) => {
                self.put((bytes.len() as u32).to_le_bytes());
                self.bytes.extend_from_slice(bytes);
            }
            Value::Texts(texts) => {
                self.put((texts.len() as u32).to_le_bytes());
                texts.iter().for_each(|text| self.text(text));
            }
            Value::Message(fields) => self.fields(fields),
        }
    }

    fn header(&mut self, header: &Header) {
        if !self.cdr {
            self.put(header.sequence.to_le_bytes());
        }
        self.time(header.stamp);
        self.text(header.frame_id);
    }

    fn time(&mut self, stamp: Stamp) {
        let (sec, nanosec) = halves(stamp);
        self.put((sec as u32).to_le_bytes());
        self.put((nanosec as u32).to_le_bytes());
    }

    /// CDR counts and writes a terminating zero, ROS 1 does not.
    fn text(&mut self, text: &str) {
        let zero: &[u8] = if self.cdr { &[0] } else { &[] };
        self.put(((text.len() + zero.len()) as u32).to_le_bytes());
        self.bytes.extend_from_slice(text.as_bytes());
        self.bytes.extend_from_slice(zero);
    }

    fn put<const N: usize>(&mut self, value: [u8; N]) {
        if self.cdr {
            // Alignment counts from the end of the four bytes of the encapsulation header.
            let padding = (self.bytes.len() - 4).next_multiple_of(N) + 4 - self.bytes.len();
            self.bytes.extend(std::iter::repeat_n(0, padding));
        }
        self.bytes.extend_from_slice(&value);
    }
}
