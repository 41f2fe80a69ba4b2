//! Decodes Protocol Buffers into columns (<https://protobuf.dev/programming-guides/encoding>).
//!
//! The schema of a channel is a serialised `FileDescriptorSet`. It and the wanted fields are compiled once; a message
//! is then decoded in one pass over its bytes, without building a tree. A `google.protobuf.Timestamp` or `Duration` is
//! one column of nanoseconds. A field that proto3 omits because it is zero *is* zero; one with presence (`optional`,
//! `oneof`, messages, all of proto2) is absent.

use crate::decode::Wanted;
use crate::decode::rows::{Rows, Value, ValueType};
use std::collections::HashMap;

/// Messages and groups nested deeper than this are rejected.
const MOST_NESTED: usize = 32;
/// The most fields examined when everything is wanted: a definition can name exponentially many.
const MOST_VISITED: usize = 16_384;
/// Elements read from an array of numbers when everything is wanted.
pub(super) const MOST_ELEMENTS: u32 = 64;

/// How to read the wanted fields of one message type.
#[derive(Debug)]
pub(crate) struct Plan {
    /// The steps for the fields of a message, by number; the message itself is the first.
    nodes: Vec<Vec<Step>>,
    /// Fields that are not read, if all are wanted.
    pub(crate) left_out: Vec<String>,
}

#[derive(Debug)]
struct Step {
    number: u32,
    what: What,
    path: String,
}

#[derive(Debug)]
enum What {
    /// `zero`: an omitted value is zero.
    Scalar {
        column: usize,
        scalar: Scalar,
        zero: bool,
    },
    Time {
        column: usize,
    },
    Message {
        node: usize,
    },
    Scalars {
        columns: Vec<(u32, usize)>,
        scalar: Scalar,
    },
    Times {
        columns: Vec<(u32, usize)>,
    },
    Messages {
        nodes: Vec<(u32, usize)>,
    },
}

/// The encoding of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Scalar {
    F64,
    F32,
    I64,
    U64,
    I32,
    Fixed64,
    Fixed32,
    Bool,
    Text,
    U32,
    Enum,
    Sfixed32,
    Sfixed64,
    Sint32,
    Sint64,
}

impl Scalar {
    /// By the number of the type in a `FieldDescriptorProto`; `None` for bytes, messages and groups.
    fn of(kind: u64) -> Option<Scalar> {
        Some(match kind {
            1 => Scalar::F64,
            2 => Scalar::F32,
            3 => Scalar::I64,
            4 => Scalar::U64,
            5 => Scalar::I32,
            6 => Scalar::Fixed64,
            7 => Scalar::Fixed32,
            8 => Scalar::Bool,
            9 => Scalar::Text,
            13 => Scalar::U32,
            14 => Scalar::Enum,
            15 => Scalar::Sfixed32,
            16 => Scalar::Sfixed64,
            17 => Scalar::Sint32,
            18 => Scalar::Sint64,
            _ => return None,
        })
    }

    fn value_type(self) -> ValueType {
        match self {
            Scalar::Text => ValueType::Text,
            Scalar::I64 | Scalar::U64 | Scalar::Fixed64 | Scalar::Sfixed64 | Scalar::Sint64 => ValueType::Integer,
            _ => ValueType::Float,
        }
    }

    fn zero(self) -> Value<'static> {
        match self.value_type() {
            ValueType::Float => Value::Float(0.0),
            ValueType::Integer => Value::Integer(0),
            ValueType::Text => Value::Text(""),
        }
    }

    /// `None` for a value of another type.
    fn value(self, wire: Wire<'_>) -> Option<Value<'_>> {
        let zigzag = |n: u64| (n >> 1) as i64 ^ -((n & 1) as i64);
        Some(match (self, wire) {
            (Scalar::F64, Wire::Fixed64(bits)) => Value::Float(f64::from_bits(bits)),
            (Scalar::F32, Wire::Fixed32(bits)) => Value::Float(f32::from_bits(bits).into()),
            (Scalar::Fixed32, Wire::Fixed32(bits)) => Value::Float(bits.into()),
            (Scalar::Sfixed32, Wire::Fixed32(bits)) => Value::Float((bits as i32).into()),
            (Scalar::Sfixed64, Wire::Fixed64(bits)) => Value::Integer(bits as i64),
            (Scalar::Fixed64, Wire::Fixed64(n)) | (Scalar::U64, Wire::Varint(n)) => Value::unsigned(n),
            (Scalar::I64, Wire::Varint(n)) => Value::Integer(n as i64),
            (Scalar::Sint64, Wire::Varint(n)) => Value::Integer(zigzag(n)),
            (Scalar::I32 | Scalar::Enum, Wire::Varint(n)) => Value::Float((n as i32).into()),
            (Scalar::Sint32, Wire::Varint(n)) => Value::Float((zigzag(n & 0xffff_ffff) as i32).into()),
            (Scalar::U32, Wire::Varint(n)) => Value::Float((n as u32).into()),
            (Scalar::Bool, Wire::Varint(n)) => Value::Float(f64::from(u8::from(n != 0))),
            (Scalar::Text, Wire::Bytes(bytes)) => Value::Text(std::str::from_utf8(bytes).ok()?),
            _ => return None,
        })
    }

    /// Takes the next number of a packed array.
    fn unpack<'p>(self, rest: &mut &'p [u8]) -> Option<Wire<'p>> {
        match self {
            Scalar::F64 | Scalar::Fixed64 | Scalar::Sfixed64 => fixed(rest).map(u64::from_le_bytes).map(Wire::Fixed64),
            Scalar::F32 | Scalar::Fixed32 | Scalar::Sfixed32 => fixed(rest).map(u32::from_le_bytes).map(Wire::Fixed32),
            _ => varint(rest).map(Wire::Varint),
        }
    }
}

/// A value as encoded in a message.
#[derive(Debug, Clone, Copy)]
enum Wire<'p> {
    Varint(u64),
    Fixed64(u64),
    Fixed32(u32),
    Bytes(&'p [u8]),
    /// The bytes between the tags of a group.
    Group(&'p [u8]),
}

impl<'p> Wire<'p> {
    /// The bytes of a nested message, in either encoding.
    fn message(self) -> Option<&'p [u8]> {
        match self {
            Wire::Bytes(bytes) | Wire::Group(bytes) => Some(bytes),
            Wire::Varint(_) | Wire::Fixed64(_) | Wire::Fixed32(_) => None,
        }
    }
}

fn varint(rest: &mut &[u8]) -> Option<u64> {
    let mut value = 0;
    for shift in (0..70).step_by(7) {
        let (&byte, after) = rest.split_first()?;
        *rest = after;
        value |= u64::from(byte & 0x7f) << shift.min(63);
        if byte < 0x80 {
            return Some(value);
        }
    }
    None
}

fn fixed<const N: usize>(rest: &mut &[u8]) -> Option<[u8; N]> {
    let (bytes, after) = rest.split_first_chunk()?;
    *rest = after;
    Some(*bytes)
}

/// The next field: its number and value. `None` if the bytes end inside it or are invalid.
fn field<'p>(rest: &mut &'p [u8]) -> Option<(u32, Wire<'p>)> {
    let (number, kind) = tag(rest)?;
    let value = match kind {
        3 => Wire::Group(group(rest, number)?),
        kind => wire(rest, kind)?,
    };
    Some((number, value))
}

fn tag(rest: &mut &[u8]) -> Option<(u32, u8)> {
    let tag = u32::try_from(varint(rest)?).ok()?;
    (tag >> 3 != 0).then_some((tag >> 3, (tag & 7) as u8))
}

fn wire<'p>(rest: &mut &'p [u8], kind: u8) -> Option<Wire<'p>> {
    Some(match kind {
        0 => Wire::Varint(varint(rest)?),
        1 => Wire::Fixed64(u64::from_le_bytes(fixed(rest)?)),
        2 => {
            let length = usize::try_from(varint(rest)?).ok()?;
            let (bytes, after) = rest.split_at_checked(length)?;
            *rest = after;
            Wire::Bytes(bytes)
        }
        5 => Wire::Fixed32(u32::from_le_bytes(fixed(rest)?)),
        _ => return None,
    })
}

/// The rest of a group with its nested groups, up to its end.
fn group<'p>(rest: &mut &'p [u8], number: u32) -> Option<&'p [u8]> {
    let whole = *rest;
    let mut end = whole.len();
    let mut open = vec![number];
    while let Some(innermost) = open.last() {
        end = whole.len() - rest.len();
        match tag(rest)? {
            (number, 3) if open.len() < MOST_NESTED => open.push(number),
            (number, 4) if number == *innermost => {
                open.pop();
            }
            (_, kind) => {
                wire(rest, kind)?;
            }
        }
    }
    whole.get(..end)
}

/// All fields of a message, for descriptors. Unreadable bytes are an error.
fn each_field<'p>(
    mut bytes: &'p [u8],
    mut visit: impl FnMut(u32, Wire<'p>) -> Result<(), String>,
) -> Result<(), String> {
    while !bytes.is_empty() {
        let (number, value) = field(&mut bytes).ok_or("its descriptor is truncated or damaged")?;
        visit(number, value)?;
    }
    Ok(())
}

/// The message types of a `FileDescriptorSet`, by name.
#[derive(Debug, Default)]
pub(crate) struct Types {
    messages: HashMap<String, Vec<Field>>,
}

/// A field from its descriptor.
#[derive(Debug, Default)]
pub(super) struct Field {
    number: u32,
    pub(super) name: String,
    pub(super) repeated: bool,
    pub(super) kind: u64,
    pub(super) type_name: String,
    /// Part of a `oneof`, which includes `optional` fields of proto3.
    one_of: bool,
    /// Field presence, where the field itself states it.
    presence: Option<u64>,
    /// Omitted where it is zero.
    zero: bool,
}

impl Types {
    /// Reads a serialised `FileDescriptorSet` (`google/protobuf/descriptor.proto`).
    pub(crate) fn parse(set: &[u8]) -> Result<Types, String> {
        let mut types = Types::default();
        each_field(set, |number, value| match (number, value) {
            (1, Wire::Bytes(file)) => types.file(file),
            _ => Ok(()),
        })?;
        Ok(types)
    }

    fn file(&mut self, file: &[u8]) -> Result<(), String> {
        let (mut package, mut syntax, mut presence, mut messages) = (String::new(), String::new(), None, vec![]);
        each_field(file, |number, value| {
            match (number, value) {
                (2, Wire::Bytes(name)) => package = text(name),
                (4, Wire::Bytes(message)) => messages.push(message),
                (8, Wire::Bytes(options)) => presence = field_presence(options, 50)?,
                (12, Wire::Bytes(name)) => syntax = text(name),
                _ => {}
            }
            Ok(())
        })?;
        // proto2 and editions track presence unless a feature disables it (IMPLICIT is 2).
        let zero = if syntax == "proto3" { true } else { presence == Some(2) };
        messages.into_iter().try_for_each(|message| self.message(&package, message, zero, 0))
    }

    fn message(&mut self, scope: &str, message: &[u8], zero: bool, depth: usize) -> Result<(), String> {
        if depth > MOST_NESTED {
            return Err(format!("its types are nested more than {MOST_NESTED} deep"));
        }
        let (mut name, mut fields, mut nested) = (String::new(), vec![], vec![]);
        each_field(message, |number, value| {
            match (number, value) {
                (1, Wire::Bytes(own)) => name = text(own),
                (2, Wire::Bytes(field)) => fields.push(Field::parse(field, zero)?),
                (3, Wire::Bytes(message)) => nested.push(message),
                _ => {}
            }
            Ok(())
        })?;
        let full = if scope.is_empty() { name } else { format!("{scope}.{name}") };
        nested.into_iter().try_for_each(|message| self.message(&full, message, zero, depth + 1))?;
        fields.sort_by_key(|field| field.number);
        self.messages.insert(full, fields);
        Ok(())
    }

    pub(super) fn fields(&self, name: &str) -> Option<&[Field]> {
        self.messages.get(name.trim_start_matches('.')).map(Vec::as_slice)
    }
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// `features.field_presence` of file or field options.
fn field_presence(options: &[u8], features: u32) -> Result<Option<u64>, String> {
    let mut presence = None;
    each_field(options, |number, value| match value {
        Wire::Bytes(set) if number == features => each_field(set, |number, value| {
            if let (1, Wire::Varint(value)) = (number, value) {
                presence = Some(value);
            }
            Ok(())
        }),
        _ => Ok(()),
    })?;
    Ok(presence)
}

impl Field {
    fn parse(bytes: &[u8], zero: bool) -> Result<Field, String> {
        let mut field = Field::default();
        each_field(bytes, |number, value| {
            match (number, value) {
                (1, Wire::Bytes(name)) => field.name = text(name),
                (3, Wire::Varint(number)) => field.number = number as u32,
                (4, Wire::Varint(label)) => field.repeated = label == 3,
                (5, Wire::Varint(kind)) => field.kind = kind,
                (6, Wire::Bytes(name)) => field.type_name = text(name),
                (8, Wire::Bytes(options)) => field.presence = field_presence(options, 21)?,
                (9, Wire::Varint(_)) => field.one_of = true,
                _ => {}
            }
            Ok(())
        })?;
        field.zero = field.presence.map_or(zero, |presence| presence == 2) && !field.one_of;
        Ok(field)
    }

    /// Whether it holds a message; a group of proto2 is one too.
    pub(super) fn is_message(&self) -> bool {
        const GROUP: u64 = 10;
        const MESSAGE: u64 = 11;
        matches!(self.kind, GROUP | MESSAGE)
    }

    pub(super) fn is_time(&self) -> bool {
        matches!(self.type_name.as_str(), ".google.protobuf.Timestamp" | ".google.protobuf.Duration")
    }
}

struct Compiler<'t, 'w> {
    types: &'t Types,
    wanted: &'w Wanted,
    rows: &'w mut Rows,
    nodes: Vec<Vec<Step>>,
    left_out: Vec<String>,
    /// Types that enclose the one being compiled.
    open: Vec<&'t str>,
    visited: usize,
}

impl Plan {
    /// Compiles the type `root` of a `FileDescriptorSet`; columns are made in `rows`.
    pub(crate) fn new(root: &str, set: &[u8], wanted: &Wanted, rows: &mut Rows) -> Result<Plan, String> {
        let types = Types::parse(set)?;
        if types.fields(root).is_none() {
            return Err(format!("its type {root:.200} is not in its descriptor"));
        }
        let mut compiler =
            Compiler { types: &types, wanted, rows, nodes: vec![], left_out: vec![], open: vec![], visited: 0 };
        compiler.message(root, "");
        Ok(Plan { nodes: compiler.nodes, left_out: compiler.left_out })
    }

    /// Sets the wanted values of the open row.
    pub(crate) fn decode(&self, payload: &[u8], rows: &mut Rows) -> Result<(), String> {
        self.walk(0, payload, true, rows)
    }

    /// Approximate memory use of the plan, bytes.
    pub(crate) fn weight(&self) -> usize {
        let steps = self.nodes.iter().flatten();
        steps.map(|step| size_of::<Step>() + step.path.len() + 16 * step.what.width()).sum()
    }
}

impl What {
    fn width(&self) -> usize {
        match self {
            What::Scalars { columns, .. } | What::Times { columns } => columns.len(),
            What::Messages { nodes } => nodes.len(),
            What::Scalar { .. } | What::Time { .. } | What::Message { .. } => 1,
        }
    }
}

impl<'t> Compiler<'t, '_> {
    /// Compiles a type into a node; returns its index.
    fn message(&mut self, name: &'t str, prefix: &str) -> usize {
        let index = self.nodes.len();
        self.nodes.push(vec![]);
        let Some(fields) = self.types.fields(name) else { return index };
        self.open.push(name);
        let mut node = vec![];
        for field in fields {
            self.visited += 1;
            if self.visited > MOST_VISITED {
                break;
            }
            let path = if prefix.is_empty() { field.name.clone() } else { format!("{prefix}.{}", field.name) };
            match self.what(field, &path) {
                Some(what) => node.push(Step { number: field.number, what, path }),
                None if !matches!(self.wanted, Wanted::All) || Scalar::of(field.kind).is_some() => {}
                None if field.repeated && field.is_message() && !field.is_time() => {
                    self.left_out.push(format!("{path}[]"));
                }
                None => self.left_out.push(path),
            }
        }
        self.open.pop();
        if let Some(place) = self.nodes.get_mut(index) {
            *place = node;
        }
        index
    }

    fn what(&mut self, field: &'t Field, path: &str) -> Option<What> {
        match (Scalar::of(field.kind), field.repeated) {
            (Some(scalar), false) if self.wanted.has(path) => {
                let column = self.rows.column(path, scalar.value_type())?;
                Some(What::Scalar { column, scalar, zero: field.zero })
            }
            (Some(scalar), true) => {
                let columns = self.columns(path, scalar.value_type(), MOST_ELEMENTS);
                (!columns.is_empty()).then_some(What::Scalars { columns, scalar })
            }
            (None, false) if field.is_time() && self.wanted.has(path) => {
                Some(What::Time { column: self.rows.column(path, ValueType::Integer)? })
            }
            (None, true) if field.is_time() => {
                let columns = self.columns(path, ValueType::Integer, MOST_ELEMENTS);
                (!columns.is_empty()).then_some(What::Times { columns })
            }
            (None, false) if field.is_message() && self.wanted.below(path) && self.may_enter(field) => {
                Some(What::Message { node: self.message(&field.type_name, path) })
            }
            (None, true) if field.is_message() && self.may_enter(field) => {
                let indexes = self.wanted.elements(path, 0);
                let node = |index| (index, self.message(&field.type_name, &format!("{path}[{index}]")));
                let nodes: Vec<(u32, usize)> = indexes.into_iter().map(node).collect();
                (!nodes.is_empty()).then_some(What::Messages { nodes })
            }
            _ => None,
        }
    }

    fn columns(&mut self, path: &str, value_type: ValueType, of_all: u32) -> Vec<(u32, usize)> {
        let indexes = self.wanted.elements(path, of_all);
        indexes.into_iter().filter_map(|i| Some((i, self.rows.column(&format!("{path}[{i}]"), value_type)?))).collect()
    }

    /// A recursive type is entered only as far as the wanted paths require.
    fn may_enter(&self, field: &Field) -> bool {
        let again = matches!(self.wanted, Wanted::All)
            && self.open.iter().any(|open| open.trim_start_matches('.') == field.type_name.trim_start_matches('.'));
        !again && self.open.len() < MOST_NESTED
    }
}

impl Plan {
    /// Reads one message. `first` is false for the continuation of an earlier part.
    fn walk(&self, node: usize, mut bytes: &[u8], first: bool, rows: &mut Rows) -> Result<(), String> {
        let Some(node) = self.nodes.get(node) else { return Ok(()) };
        // The number of values found for each field.
        let mut seen = vec![0_u32; node.len()];
        while !bytes.is_empty() {
            let (number, value) = field(&mut bytes).ok_or("the message ends inside a field, or is not a message")?;
            let Ok(at) = node.binary_search_by_key(&number, |step| step.number) else { continue };
            let (Some(step), Some(seen)) = (node.get(at), seen.get_mut(at)) else { continue };
            self.step(step, value, seen, rows).ok_or_else(|| format!("{}: wrong type", step.path))??;
        }
        for (step, seen) in node.iter().zip(seen) {
            if let What::Scalar { column, scalar, zero: true } = step.what
                && first
                && seen == 0
            {
                rows.set(column, scalar.zero());
            }
        }
        Ok(())
    }

    /// `None` if the value does not have the type of the descriptor.
    fn step(&self, step: &Step, value: Wire<'_>, seen: &mut u32, rows: &mut Rows) -> Option<Result<(), String>> {
        let here = *seen;
        match &step.what {
            What::Scalar { column, scalar, .. } => {
                rows.set(*column, scalar.value(value)?);
                *seen = 1;
            }
            What::Time { column } => {
                rows.set(*column, Value::Integer(nanoseconds(value.message()?)?));
            }
            What::Message { node } => {
                *seen = 1;
                return Some(self.walk(*node, value.message()?, here == 0, rows));
            }
            What::Scalars { columns, scalar } => return elements(columns, *scalar, value, seen, rows).map(Ok),
            What::Times { columns } => {
                let nanos = nanoseconds(value.message()?)?;
                if let Ok(at) = columns.binary_search_by_key(&here, |(index, _)| *index) {
                    rows.set(columns.get(at)?.1, Value::Integer(nanos));
                }
                *seen = here.saturating_add(1);
            }
            What::Messages { nodes } => {
                let bytes = value.message()?;
                *seen = here.saturating_add(1);
                if let Ok(at) = nodes.binary_search_by_key(&here, |(index, _)| *index) {
                    return Some(self.walk(nodes.get(at)?.1, bytes, true, rows));
                }
            }
        }
        Some(Ok(()))
    }
}

/// Sets the wanted elements of an array, which may be packed or not.
fn elements(columns: &[(u32, usize)], scalar: Scalar, value: Wire<'_>, seen: &mut u32, rows: &mut Rows) -> Option<()> {
    let mut one = |value: Wire<'_>| {
        if let Ok(at) = columns.binary_search_by_key(seen, |(index, _)| *index) {
            rows.set(columns.get(at)?.1, scalar.value(value)?);
        }
        *seen = seen.saturating_add(1);
        Some(())
    };
    match value {
        Wire::Bytes(mut packed) if scalar != Scalar::Text => {
            while !packed.is_empty() {
                one(scalar.unpack(&mut packed)?)?;
            }
            Some(())
        }
        value => one(value),
    }
}

/// Seconds and nanoseconds of a `Timestamp` or `Duration`.
fn nanoseconds(mut bytes: &[u8]) -> Option<i64> {
    let (mut seconds, mut nanos) = (0, 0);
    while !bytes.is_empty() {
        match field(&mut bytes)? {
            (1, Wire::Varint(n)) => seconds = n as i64,
            (2, Wire::Varint(n)) => nanos = i64::from(n as i32),
            _ => {}
        }
    }
    seconds.checked_mul(flight::NANOS_PER_SECOND)?.checked_add(nanos)
}
