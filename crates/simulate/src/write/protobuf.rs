//! Messages as Protocol Buffers (proto3), and the descriptor of their type
//! (<https://protobuf.dev/programming-guides/encoding>).

use super::definition::Definition;
use super::message::{Fields, Message, Value, halves};

const VARINT: u32 = 0;
const FIXED64: u32 = 1;
const BYTES: u32 = 2;

fn varint(mut number: u64, out: &mut Vec<u8>) {
    while number >= 0x80 {
        out.push(number as u8 | 0x80);
        number >>= 7;
    }
    out.push(number as u8);
}

fn tagged_varint(number: u32, value: u64, out: &mut Vec<u8>) {
    varint((number << 3 | VARINT).into(), out);
    varint(value, out);
}

fn tagged_bytes(number: u32, bytes: &[u8], out: &mut Vec<u8>) {
    varint((number << 3 | BYTES).into(), out);
    varint(bytes.len() as u64, out);
    out.extend(bytes);
}

/// A message; zero values are omitted, as in proto3.
pub(super) fn payload(message: &Message) -> Vec<u8> {
    of_fields(&message.fields)
}

fn of_fields(fields: &Fields) -> Vec<u8> {
    let mut out = vec![];
    for (index, (_, value)) in fields.iter().enumerate() {
        field(index as u32 + 1, value, &mut out);
    }
    out
}

fn field(number: u32, value: &Value, out: &mut Vec<u8>) {
    let zigzag = |n: i64| ((n << 1) ^ (n >> 63)) as u64;
    let mut whole = |n: u64| {
        if n != 0 {
            tagged_varint(number, n, out);
        }
    };
    match value {
        Value::I8(v) => whole(zigzag((*v).into())),
        Value::U8(v) => whole((*v).into()),
        Value::U16(v) => whole((*v).into()),
        Value::I64(v) => whole(*v as u64),
        Value::F64(v) if v.to_bits() == 0 => {}
        Value::F64(v) => {
            varint((number << 3 | FIXED64).into(), out);
            out.extend(v.to_le_bytes());
        }
        Value::Text(text) if text.is_empty() => {}
        Value::Text(text) => tagged_bytes(number, text.as_bytes(), out),
        Value::Time(stamp) => {
            let (seconds, nanos) = halves(*stamp);
            let mut time = vec![];
            tagged_varint(1, seconds as u64, &mut time);
            tagged_varint(2, nanos as u64, &mut time);
            tagged_bytes(number, &time, out);
        }
        Value::Header(header) => {
            let fields =
                vec![("stamp", Value::Time(header.stamp)), ("frame_id", Value::Text(header.frame_id.to_owned()))];
            tagged_bytes(number, &of_fields(&fields), out);
        }
        Value::Fixed(values) | Value::Sequence(values) => {
            let packed: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
            if !packed.is_empty() {
                tagged_bytes(number, &packed, out);
            }
        }
        Value::Bytes(bytes) => tagged_bytes(number, bytes, out),
        Value::Texts(texts) => texts.iter().for_each(|text| tagged_bytes(number, text.as_bytes(), out)),
        Value::Message(fields) => tagged_bytes(number, &of_fields(fields), out),
    }
}

/// Name of the type in Protocol Buffers.
pub(super) fn type_name(definition: &Definition) -> String {
    definition.ros1_name().replace('/', ".")
}

/// The `FileDescriptorSet` of a type, derived from one of its messages.
pub(super) fn descriptor(definition: &Definition, example: Option<&Message>) -> Vec<u8> {
    let full = type_name(definition);
    let (package, name) = full.split_once('.').unwrap_or(("", &full));
    let none = vec![];
    let root = message_type(name, &format!(".{full}"), example.map_or(&none, |message| &message.fields));
    let mut file = vec![];
    tagged_bytes(1, format!("{}.proto", full.replace('.', "/")).as_bytes(), &mut file);
    tagged_bytes(2, package.as_bytes(), &mut file);
    tagged_bytes(3, b"google/protobuf/timestamp.proto", &mut file);
    tagged_bytes(4, &root, &mut file);
    tagged_bytes(12, b"proto3", &mut file);
    let mut set = vec![];
    tagged_bytes(1, &timestamp(), &mut set);
    tagged_bytes(1, &file, &mut set);
    set
}

/// `google/protobuf/timestamp.proto`.
fn timestamp() -> Vec<u8> {
    let (mut file, mut message) = (vec![], vec![]);
    tagged_bytes(1, b"Timestamp", &mut message);
    tagged_bytes(2, &field_type("seconds", 1, Type::Plain(3), false), &mut message);
    tagged_bytes(2, &field_type("nanos", 2, Type::Plain(5), false), &mut message);
    tagged_bytes(1, b"google/protobuf/timestamp.proto", &mut file);
    tagged_bytes(2, b"google.protobuf", &mut file);
    tagged_bytes(4, &message, &mut file);
    tagged_bytes(12, b"proto3", &mut file);
    file
}

/// A type by its number in `FieldDescriptorProto`, or a message by its name.
enum Type {
    Plain(u64),
    Named(String),
}

fn field_type(name: &str, number: u32, of: Type, repeated: bool) -> Vec<u8> {
    let mut out = vec![];
    tagged_bytes(1, name.as_bytes(), &mut out);
    tagged_varint(3, number.into(), &mut out);
    tagged_varint(4, if repeated { 3 } else { 1 }, &mut out);
    match of {
        Type::Plain(kind) => tagged_varint(5, kind, &mut out),
        Type::Named(name) => {
            tagged_varint(5, 11, &mut out);
            tagged_bytes(6, name.as_bytes(), &mut out);
        }
    }
    out
}

/// A message type with the nested types of its fields.
fn message_type(name: &str, full: &str, fields: &Fields) -> Vec<u8> {
    let mut out = vec![];
    tagged_bytes(1, name.as_bytes(), &mut out);
    for (index, (name, value)) in fields.iter().enumerate() {
        let inner = format!("Of_{name}");
        let named = || Type::Named(format!("{full}.{inner}"));
        let (of, repeated) = match value {
            Value::F64(_) => (Type::Plain(1), false),
            Value::I8(_) => (Type::Plain(17), false),
            Value::U8(_) | Value::U16(_) => (Type::Plain(13), false),
            Value::I64(_) => (Type::Plain(3), false),
            Value::Text(_) => (Type::Plain(9), false),
            Value::Time(_) => (Type::Named(".google.protobuf.Timestamp".to_owned()), false),
            Value::Fixed(_) | Value::Sequence(_) => (Type::Plain(1), true),
            Value::Bytes(_) => (Type::Plain(12), false),
            Value::Texts(_) => (Type::Plain(9), true),
            Value::Header(_) | Value::Message(_) => (named(), false),
        };
        tagged_bytes(2, &field_type(name, index as u32 + 1, of, repeated), &mut out);
        let nested = match value {
            Value::Header(header) => {
                Some(vec![("stamp", Value::Time(header.stamp)), ("frame_id", Value::Text(String::new()))])
            }
            Value::Message(fields) => Some(fields.clone()),
            _ => None,
        };
        if let Some(fields) = nested {
            tagged_bytes(3, &message_type(&inner, &format!("{full}.{inner}"), &fields), &mut out);
        }
    }
    out
}
