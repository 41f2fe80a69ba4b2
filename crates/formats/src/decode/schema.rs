//! Parses the text of a ROS message definition (`ros1msg`, `ros2msg`) into types.
//!
//! Both dialects are lines of `type name`, followed by the definitions of the nested types after lines of `=` and `MSG:
//! package/Type` (ROS 1 `gendeps --cat`; MCAP's registry of schema encodings). Times are not split: they become one
//! column of nanoseconds.

use std::collections::HashMap;

/// Messages nested deeper than this are rejected.
const MOST_NESTED: usize = 32;
/// Field names longer than this are rejected.
const LONGEST_NAME: usize = 255;

/// The language of a definition.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Dialect {
    Ros1,
    Ros2,
}

/// A message definition with all the types it uses; the message itself is the first.
#[derive(Debug)]
pub(crate) struct Schema {
    pub(crate) dialect: Dialect,
    pub(crate) messages: Vec<Message>,
}

/// The fields of one message type.
#[derive(Debug, Default)]
pub(crate) struct Message {
    pub(crate) name: String,
    pub(crate) fields: Vec<Field>,
}

/// A field.
#[derive(Debug)]
pub(crate) struct Field {
    pub(crate) name: String,
    pub(crate) kind: Kind,
    pub(crate) count: Count,
}

/// The type of a field, or of its elements.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Number(Number),
    Text,
    /// UTF-16 after a count of code units, ROS 2 only.
    WideText,
    /// Seconds and nanoseconds, 32 bits each.
    Time {
        /// Seconds below zero are possible.
        signed_seconds: bool,
    },
    /// Index into [`Schema::messages`].
    Message(usize),
}

/// The encoding of a number in the message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Number {
    Bool,
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl Number {
    pub(crate) fn size(self) -> u64 {
        match self {
            Number::Bool | Number::I8 | Number::U8 => 1,
            Number::I16 | Number::U16 => 2,
            Number::I32 | Number::U32 | Number::F32 => 4,
            Number::I64 | Number::U64 | Number::F64 => 8,
        }
    }
}

/// The number of elements.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Count {
    One,
    Fixed(u32),
    /// As many as the message states; a bound in the definition only concerns the writer.
    Variable,
}

impl Schema {
    /// Reads the definition of `root`, such as `sensor_msgs/NavSatFix` or `sensor_msgs/msg/NavSatFix`.
    ///
    /// An error names the message type and the line.
    pub(crate) fn parse(root: &str, text: &str, dialect: Dialect) -> Result<Schema, String> {
        let sections = sections(root, text);
        let names = Names::of(&sections);
        let mut parser = Parser { dialect, sections, names, known: HashMap::new(), messages: vec![] };
        parser.message(0, 0)?;
        Ok(Schema { dialect, messages: parser.messages })
    }
}

pub(super) struct Section<'t> {
    pub(super) name: String,
    pub(super) lines: Vec<&'t str>,
}

fn without_msg(name: &str) -> String {
    name.replace("/msg/", "/")
}

pub(super) fn sections<'t>(root: &str, text: &'t str) -> Vec<Section<'t>> {
    let mut sections = vec![Section { name: without_msg(root), lines: vec![] }];
    for line in text.lines() {
        let trimmed = line.trim();
        if trimmed.len() >= 3 && trimmed.bytes().all(|b| b == b'=') {
            sections.push(Section { name: String::new(), lines: vec![] });
        } else if let Some(section) = sections.last_mut() {
            match trimmed.strip_prefix("MSG:") {
                Some(name) if section.name.is_empty() => section.name = without_msg(name.trim()),
                _ => section.lines.push(trimmed),
            }
        }
    }
    sections
}

/// The state of a section: one that is met again while it is open refers to itself.
#[derive(Clone, Copy)]
enum Known {
    Open,
    Read(usize),
}

/// Sections by full name, and by the type's own name where that is unambiguous: some writers omit the package.
#[derive(Default)]
pub(super) struct Names {
    full: HashMap<String, usize>,
    own: HashMap<String, Option<usize>>,
}

impl Names {
    pub(super) fn of(sections: &[Section<'_>]) -> Names {
        let mut names = Names::default();
        for (index, section) in sections.iter().enumerate() {
            names.full.entry(section.name.clone()).or_insert(index);
            if index > 0 {
                let own = names.own.entry(own_name(&section.name).to_owned());
                own.and_modify(|found| *found = None).or_insert(Some(index));
            }
        }
        names
    }

    pub(super) fn section(&self, full: &str) -> Option<usize> {
        self.full.get(full).copied().or_else(|| self.own.get(own_name(full)).copied().flatten())
    }
}

fn own_name(full: &str) -> &str {
    full.rsplit('/').next().unwrap_or_default()
}

struct Parser<'t> {
    dialect: Dialect,
    sections: Vec<Section<'t>>,
    names: Names,
    known: HashMap<usize, Known>,
    messages: Vec<Message>,
}

impl Parser<'_> {
    /// Parses a section and the types it uses; returns its index among the messages.
    fn message(&mut self, section: usize, depth: usize) -> Result<usize, String> {
        let name = self.sections.get(section).map(|s| s.name.clone()).unwrap_or_default();
        match self.known.get(&section) {
            Some(Known::Read(index)) => return Ok(*index),
            Some(Known::Open) => return Err(format!("{name}: the type contains itself")),
            None if depth > MOST_NESTED => return Err(format!("{name}: nested more than {MOST_NESTED} deep")),
            None => self.known.insert(section, Known::Open),
        };
        let index = self.messages.len();
        self.messages.push(Message { name: name.clone(), fields: vec![] });
        let lines = self.sections.get_mut(section).map(|s| std::mem::take(&mut s.lines)).unwrap_or_default();
        for line in lines {
            let field = self.field(&name, line, depth).map_err(|what| format!("{name}: {line:.100}: {what}"))?;
            if let Some(message) = self.messages.get_mut(index) {
                message.fields.extend(field);
            }
        }
        self.known.insert(section, Known::Read(index));
        Ok(index)
    }

    /// The field on a line; `None` for comments and constants.
    fn field(&mut self, owner: &str, line: &str, depth: usize) -> Result<Option<Field>, String> {
        let line = line.split('#').next().unwrap_or_default().trim();
        if line.is_empty() {
            return Ok(None);
        }
        let (written, rest) = line.split_once(char::is_whitespace).ok_or("neither a field nor a constant")?;
        let rest = rest.trim_start();
        let name_end = rest.find(|c: char| !c.is_ascii_alphanumeric() && c != '_').unwrap_or(rest.len());
        let (name, after) = rest.split_at(name_end);
        if name.is_empty() {
            return Err("the field has no name".to_owned());
        }
        if name.len() > LONGEST_NAME {
            return Err(format!("the name is longer than {LONGEST_NAME} characters"));
        }
        if after.trim_start().starts_with('=') {
            return Ok(None);
        }
        let (base, count) = array(written)?;
        let kind = match plain(base, self.dialect) {
            Some(kind) => kind,
            None => self.nested(owner, base, depth)?,
        };
        Ok(Some(Field { name: name.to_owned(), kind, count }))
    }

    fn nested(&mut self, owner: &str, base: &str, depth: usize) -> Result<Kind, String> {
        let full = full_name(owner, base, self.dialect);
        if let Some(time) = ros2_time(&full, self.dialect) {
            return Ok(time);
        }
        let section = self.names.section(&full).ok_or_else(|| format!("the type {full} is not defined"))?;
        self.message(section, depth + 1).map(Kind::Message)
    }
}

/// A name without a package is in the package of the message that uses it.
fn full_name(owner: &str, base: &str, dialect: Dialect) -> String {
    if base.contains('/') {
        return without_msg(base);
    }
    if base == "Header" && dialect == Dialect::Ros1 {
        return "std_msgs/Header".to_owned();
    }
    match owner.rsplit_once('/') {
        Some((package, _)) => format!("{package}/{base}"),
        None => base.to_owned(),
    }
}

/// The message types of the fields of a message, without built-in types. `owner` is its full name.
pub(crate) fn types_within(owner: &str, text: &str, dialect: Dialect) -> Vec<String> {
    let lines = text.lines().map(|line| line.split('#').next().unwrap_or_default());
    let written = lines.filter_map(|line| line.split_whitespace().next());
    let bases = written.filter_map(|written| array(written).ok()).map(|(base, _)| base);
    let nested = bases.filter_map(|base| message_type(owner, base, dialect));
    nested.filter(|full| ros2_time(full, dialect).is_none()).collect()
}

/// The full name of a type without brackets; `None` if it is a built-in type.
pub(super) fn message_type(owner: &str, base: &str, dialect: Dialect) -> Option<String> {
    plain(base, dialect).is_none().then(|| full_name(owner, base, dialect))
}

/// Splits `float64[9]`, `string<=5[<=3]`, `uint8[]` into element and count.
pub(super) fn array(written: &str) -> Result<(&str, Count), String> {
    let Some((base, rest)) = written.split_once('[') else { return Ok((unbounded(written), Count::One)) };
    let size = rest.strip_suffix(']').ok_or("the array has no closing bracket")?;
    let count = match size {
        "" => Count::Variable,
        bounded if bounded.starts_with("<=") => Count::Variable,
        fixed => Count::Fixed(fixed.parse().map_err(|_| format!("{fixed:?} is not an array length"))?),
    };
    Ok((unbounded(base), count))
}

fn unbounded(base: &str) -> &str {
    base.split("<=").next().unwrap_or(base)
}

fn plain(base: &str, dialect: Dialect) -> Option<Kind> {
    let number = match (base, dialect) {
        ("bool", _) => Number::Bool,
        ("int8", _) | ("byte", Dialect::Ros1) => Number::I8,
        ("uint8" | "char", _) | ("byte", Dialect::Ros2) => Number::U8,
        ("int16", _) => Number::I16,
        ("uint16", _) => Number::U16,
        ("int32", _) => Number::I32,
        ("uint32", _) => Number::U32,
        ("int64", _) => Number::I64,
        ("uint64", _) => Number::U64,
        ("float32", _) => Number::F32,
        ("float64", _) => Number::F64,
        ("string", _) => return Some(Kind::Text),
        ("wstring", Dialect::Ros2) => return Some(Kind::WideText),
        ("time", Dialect::Ros1) => return Some(Kind::Time { signed_seconds: false }),
        ("duration", Dialect::Ros1) => return Some(Kind::Time { signed_seconds: true }),
        _ => return None,
    };
    Some(Kind::Number(number))
}

fn ros2_time(full: &str, dialect: Dialect) -> Option<Kind> {
    let is_time = matches!(full, "builtin_interfaces/Time" | "builtin_interfaces/Duration");
    (is_time && dialect == Dialect::Ros2).then_some(Kind::Time { signed_seconds: true })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fields(root: &str, text: &str, dialect: Dialect) -> Vec<(String, Kind, Count)> {
        let mut schema = Schema::parse(root, text, dialect).unwrap();
        schema.messages.remove(0).fields.into_iter().map(|f| (f.name, f.kind, f.count)).collect()
    }

    #[test]
    fn constants_comments_and_defaults_are_not_fields() {
        let text =
            "# a comment\nint8 STATUS_FIX=0\nstring NAME = \"a # b\"\nuint8 x 5 # five\nstring<=5 name \"a = b\"\n\r\n";
        let names: Vec<String> = fields("p/A", text, Dialect::Ros2).into_iter().map(|f| f.0).collect();
        assert_eq!(names, ["x", "name"]);
    }

    #[test]
    fn the_same_word_means_what_its_dialect_says() {
        let byte = |dialect| fields("p/A", "byte b", dialect).remove(0).1;
        assert_eq!(byte(Dialect::Ros1), Kind::Number(Number::I8));
        assert_eq!(byte(Dialect::Ros2), Kind::Number(Number::U8));
        assert_eq!(fields("p/A", "char c", Dialect::Ros1).remove(0).1, Kind::Number(Number::U8));
        assert!(Schema::parse("p/A", "wstring w", Dialect::Ros1).is_err());
    }

    #[test]
    fn arrays_are_fixed_or_variable_length() {
        let text = "float64[9] a\nuint8[] b\nint32[<=7] c\nwstring<=3[<=2] d\nstring<=9[2] e";
        let counts: Vec<Count> = fields("p/A", text, Dialect::Ros2).into_iter().map(|f| f.2).collect();
        assert_eq!(counts, [Count::Fixed(9), Count::Variable, Count::Variable, Count::Variable, Count::Fixed(2)]);
    }

    #[test]
    fn nested_types_are_found_with_and_without_package_and_msg() {
        let text = "Header header\ngeometry_msgs/msg/Point p\nOwn own\n===\nMSG: std_msgs/Header\nuint32 seq\n\
                    =====\nMSG: geometry_msgs/Point\nfloat64 x\n====\nMSG: mine/Own\ntime t";
        let found = fields("mine/msg/A", text, Dialect::Ros1);
        assert_eq!(found.iter().map(|f| f.1).collect::<Vec<_>>(), [1, 2, 3].map(Kind::Message));
    }

    #[test]
    fn a_ros_2_time_is_a_time_with_or_without_its_definition() {
        let with = "builtin_interfaces/Time stamp\n===\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec";
        for text in [with, "builtin_interfaces/msg/Time stamp"] {
            assert_eq!(fields("p/A", text, Dialect::Ros2)[0].1, Kind::Time { signed_seconds: true });
        }
    }

    #[test]
    fn an_invalid_definition_is_rejected_with_its_type_and_line() {
        for (text, word) in [
            ("float64", "neither"),
            ("Unknown u", "p/Unknown is not defined"),
            ("A again", "contains itself"),
            ("B b\n===\nMSG: p/B\nA a", "contains itself"),
            ("uint8[99999999999] a", "not an array length"),
            ("uint8[ a", "bracket"),
            ("uint8 -x", "no name"),
        ] {
            let error = Schema::parse("p/A", text, Dialect::Ros1).unwrap_err();
            assert!(error.contains(word) && error.starts_with("p/"), "{text:?}: {error}");
        }
    }

    #[test]
    fn a_long_chain_of_nested_types_is_rejected() {
        let mut text = "T0 a\n".to_owned();
        for i in 0..100_000 {
            text += &format!("===\nMSG: p/T{i}\nT{} a\n", i + 1);
        }
        assert!(Schema::parse("p/A", &text, Dialect::Ros1).unwrap_err().contains("nested more than"));
    }
}
