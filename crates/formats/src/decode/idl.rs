//! Message definitions in OMG IDL (`ros2idl`, `omgidl`): the subset that describes ROS 2 messages.
//!
//! Modules, structures (with a base), typedefs, constants, enumerations, sequences, bounded texts, arrays and
//! annotations (IDL 4.2, formal/18-01-05, 7.4). Unions, maps, bit masks and optional members are rejected by name where
//! a message uses them.

use crate::decode::schema::{Count, Dialect, Field, Kind, Message, Number, Schema};
use std::collections::HashMap;

/// Types nested deeper than this are rejected.
const MOST_NESTED: usize = 32;

impl Schema {
    /// Parses the definition of `root`, such as `sensor_msgs/msg/NavSatFix`, with all the types it uses.
    pub(crate) fn parse_idl(root: &str, text: &str) -> Result<Schema, String> {
        let mut parser = Parser::of(text)?;
        parser.definitions()?;
        let name = root.replace('/', "::");
        let root = parser.root(&name).ok_or_else(|| format!("{root}: the type is not defined"))?;
        let mut builder = Builder { types: &parser.types, known: HashMap::new(), messages: vec![] };
        builder.message(&root, 0)?;
        Ok(Schema { dialect: Dialect::Ros2, messages: builder.messages })
    }
}

#[derive(Debug, Clone, PartialEq)]
enum Token<'t> {
    /// A name, including `::` if it has several parts.
    Word(&'t str),
    Number(Option<u64>),
    /// A text or a character. Its content is ignored.
    Literal,
    Sign(char),
}

/// Splits a text into tokens; comments, directives and the lines between files are skipped.
fn tokens(text: &str) -> Result<Vec<Token<'_>>, String> {
    let is_word = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let mut tokens = vec![];
    let mut rest = text;
    let mut line_start = true;
    loop {
        let trimmed = rest.trim_start();
        line_start |= rest.get(..rest.len() - trimmed.len()).is_some_and(|space| space.contains('\n'));
        rest = trimmed;
        let Some(first) = rest.chars().next() else { return Ok(tokens) };
        let line = rest.lines().next().unwrap_or_default();
        let directive = line_start && (first == '#' || line.starts_with("===") || line.starts_with("IDL:"));
        let skipped = if directive || rest.starts_with("//") {
            Some(line.len())
        } else if rest.starts_with("/*") {
            Some(rest.find("*/").ok_or("a comment has no end")? + 2)
        } else {
            None
        };
        line_start = false;
        let length = match skipped {
            Some(length) => length,
            None if first == '"' || first == '\'' => {
                tokens.push(Token::Literal);
                literal(rest, first).ok_or("a text has no end")?
            }
            None if first.is_ascii_digit() => {
                let end = rest.find(|c| !is_word(c) && c != '.').unwrap_or(rest.len());
                tokens.push(Token::Number(rest.get(..end).and_then(whole_number)));
                end
            }
            None if is_word(first) || rest.starts_with("::") => {
                let word = word(rest, is_word);
                tokens.push(Token::Word(word.trim_start_matches("::")));
                word.len()
            }
            None => {
                tokens.push(Token::Sign(first));
                first.len_utf8()
            }
        };
        rest = rest.get(length..).unwrap_or_default();
    }
}

/// Length of a text including its quotes.
fn literal(text: &str, quote: char) -> Option<usize> {
    let mut escaped = false;
    let end = text.char_indices().skip(1).find(|&(_, c)| {
        let ends = c == quote && !escaped;
        escaped = c == '\\' && !escaped;
        ends
    });
    end.map(|(at, quote)| at + quote.len_utf8())
}

fn whole_number(text: &str) -> Option<u64> {
    match text.strip_prefix("0x").or_else(|| text.strip_prefix("0X")) {
        Some(hex) => u64::from_str_radix(hex, 16).ok(),
        None => text.parse().ok(),
    }
}

/// A name with its scopes.
fn word(text: &str, is_word: impl Fn(char) -> bool) -> &str {
    let mut end = 0;
    loop {
        let rest = text.get(end..).unwrap_or_default();
        let part = rest.find(|c| !is_word(c)).unwrap_or(rest.len());
        end += part;
        let scope = text.get(end..).is_some_and(|rest| rest.starts_with("::"));
        if !scope {
            return text.get(..end).unwrap_or_default();
        }
        end += 2;
    }
}

/// A type as written.
#[derive(Debug, Clone)]
enum Type {
    Plain(Kind),
    /// A name and the scope that uses it.
    Named(String, String),
    Sequence(Box<Type>),
    Array(Box<Type>, u32),
    /// What it is, for the error message.
    Refused(&'static str),
}

#[derive(Debug, Clone)]
enum Definition {
    Struct { base: Option<Type>, members: Vec<(String, Type)> },
    Alias(Type),
    Constant(Option<u64>),
    Refused(&'static str),
}

struct Parser<'t> {
    tokens: Vec<Token<'t>>,
    at: usize,
    /// Open modules, joined by `::`.
    scope: String,
    types: HashMap<String, Definition>,
}

fn joined(scope: &str, name: &str) -> String {
    if scope.is_empty() { name.to_owned() } else { format!("{scope}::{name}") }
}

/// The definition of a name used in `scope`: the innermost match.
fn resolve<'d>(types: &'d HashMap<String, Definition>, scope: &str, name: &str) -> Option<(String, &'d Definition)> {
    let mut scope = scope;
    loop {
        let full = joined(scope, name);
        if let Some(found) = types.get(&full) {
            return Some((full, found));
        }
        if scope.is_empty() {
            return None;
        }
        scope = scope.rsplit_once("::").map_or("", |(outer, _)| outer);
    }
}

impl<'t> Parser<'t> {
    fn of(text: &'t str) -> Result<Parser<'t>, String> {
        Ok(Parser { tokens: tokens(text)?, at: 0, scope: String::new(), types: HashMap::new() })
    }

    /// The root by its full name, or the only structure of that name in any module.
    fn root(&self, name: &str) -> Option<String> {
        if matches!(self.types.get(name), Some(Definition::Struct { .. })) {
            return Some(name.to_owned());
        }
        let own = name.rsplit("::").next().unwrap_or(name);
        let is_it = |(full, definition): &(&String, &Definition)| {
            full.rsplit("::").next() == Some(own) && matches!(definition, Definition::Struct { .. })
        };
        let mut found: Vec<&String> = self.types.iter().filter(is_it).map(|(full, _)| full).collect();
        if found.len() == 1 { found.pop().cloned() } else { None }
    }

    fn peek(&self) -> Option<&Token<'t>> {
        self.tokens.get(self.at)
    }

    fn next(&mut self) -> Option<Token<'t>> {
        let token = self.tokens.get(self.at).cloned();
        self.at += 1;
        token
    }

    fn sign(&mut self, sign: char) -> bool {
        let there = self.peek() == Some(&Token::Sign(sign));
        self.at += usize::from(there);
        there
    }

    fn word(&mut self, word: &str) -> bool {
        let there = self.peek() == Some(&Token::Word(word));
        self.at += usize::from(there);
        there
    }

    fn expect(&mut self, sign: char) -> Result<(), String> {
        if self.sign(sign) { Ok(()) } else { Err(format!("{}: {sign:?} is missing", self.place())) }
    }

    fn name(&mut self) -> Result<&'t str, String> {
        match self.next() {
            Some(Token::Word(word)) if word.len() <= 255 => Ok(word),
            _ => Err(format!("{}: a name is missing", self.place())),
        }
    }

    /// The last token read, for error messages.
    fn place(&self) -> String {
        let last = self.tokens.iter().take(self.at).rev().find_map(|token| match token {
            Token::Word(word) => Some(*word),
            _ => None,
        });
        format!("after {:.100}", last.unwrap_or("the beginning"))
    }

    /// Skips annotations; returns whether one of them makes a member optional.
    fn annotations(&mut self) -> Result<bool, String> {
        let mut optional = false;
        while self.sign('@') {
            optional |= self.name()? == "optional";
            if self.peek() == Some(&Token::Sign('(')) {
                self.balanced('(', ')')?;
            }
        }
        Ok(optional)
    }

    /// Skips everything between two matching brackets.
    fn balanced(&mut self, open: char, close: char) -> Result<(), String> {
        let mut depth = 0;
        loop {
            match self.next() {
                None => return Err(format!("{}: {close:?} is missing", self.place())),
                Some(Token::Sign(sign)) if sign == open => depth += 1,
                Some(Token::Sign(sign)) if sign == close => depth -= 1,
                Some(_) => {}
            }
            if depth == 0 {
                return Ok(());
            }
        }
    }

    fn definitions(&mut self) -> Result<(), String> {
        let mut modules = 0;
        loop {
            self.annotations()?;
            match self.next() {
                None => return Ok(()),
                Some(Token::Sign(';')) => {}
                Some(Token::Sign('}')) if modules > 0 => {
                    modules -= 1;
                    self.scope = self.scope.rsplit_once("::").map_or(String::new(), |(outer, _)| outer.to_owned());
                }
                Some(Token::Word("module")) if modules < MOST_NESTED => {
                    let name = self.name()?;
                    self.expect('{')?;
                    self.scope = joined(&self.scope, name);
                    modules += 1;
                }
                Some(Token::Word("struct")) => self.structure()?,
                Some(Token::Word("typedef")) => self.alias()?,
                Some(Token::Word("const")) => self.constant()?,
                Some(Token::Word("enum")) => self.body(Definition::Alias(Type::Plain(Kind::Number(Number::U32))))?,
                Some(Token::Word("union")) => self.body(Definition::Refused("a union"))?,
                Some(Token::Word("bitmask")) => self.body(Definition::Refused("a bit mask"))?,
                Some(Token::Word("bitset")) => self.body(Definition::Refused("a bit set"))?,
                Some(_) => return Err(format!("{}: neither a type nor a module", self.place())),
            }
        }
    }

    /// A definition of which only the name is used.
    fn body(&mut self, definition: Definition) -> Result<(), String> {
        let name = self.name()?;
        self.types.insert(joined(&self.scope, name), definition);
        while !matches!(self.peek(), Some(Token::Sign('{' | ';')) | None) {
            self.at += 1;
        }
        if self.peek() == Some(&Token::Sign('{')) { self.balanced('{', '}') } else { Ok(()) }
    }

    fn structure(&mut self) -> Result<(), String> {
        let name = self.name()?;
        if self.sign(';') {
            return Ok(());
        }
        let base = if self.sign(':') { Some(self.type_of(0)?) } else { None };
        self.expect('{')?;
        let mut members = vec![];
        while !self.sign('}') {
            let optional = self.annotations()?;
            let of = self.type_of(0)?;
            for (name, of) in self.declarators(of)? {
                let of = if optional { Type::Refused("an optional member") } else { of };
                members.push((name, of));
            }
        }
        self.types.insert(joined(&self.scope, name), Definition::Struct { base, members });
        Ok(())
    }

    fn alias(&mut self) -> Result<(), String> {
        let of = self.type_of(0)?;
        for (name, of) in self.declarators(of)? {
            self.types.insert(joined(&self.scope, &name), Definition::Alias(of));
        }
        Ok(())
    }

    fn constant(&mut self) -> Result<(), String> {
        self.type_of(0)?;
        let name = self.name()?;
        self.expect('=')?;
        let value = self.number();
        while !self.sign(';') {
            if self.next().is_none() {
                return Err(format!("{}: ';' is missing", self.place()));
            }
        }
        self.types.insert(joined(&self.scope, name), Definition::Constant(value));
        Ok(())
    }

    /// Names with their array sizes, up to the end of the declaration.
    fn declarators(&mut self, of: Type) -> Result<Vec<(String, Type)>, String> {
        let mut found = vec![];
        loop {
            let name = self.name()?.to_owned();
            let mut count: Option<u32> = None;
            while self.sign('[') {
                let size = self.number().and_then(|n| u32::try_from(n).ok());
                let size = size.and_then(|n| count.unwrap_or(1).checked_mul(n));
                count = Some(size.ok_or_else(|| format!("{name:.100}: the array's length cannot be read"))?);
                self.expect(']')?;
            }
            let of = of.clone();
            found.push((name, count.map_or(of.clone(), |count| Type::Array(Box::new(of), count))));
            if !self.sign(',') {
                self.expect(';')?;
                return Ok(found);
            }
        }
    }

    /// A number, or a constant with a numeric value.
    fn number(&mut self) -> Option<u64> {
        match self.next()? {
            Token::Number(number) => number,
            Token::Word(name) => match resolve(&self.types, &self.scope, name) {
                Some((_, Definition::Constant(value))) => *value,
                _ => None,
            },
            Token::Literal | Token::Sign(_) => None,
        }
    }

    fn type_of(&mut self, depth: usize) -> Result<Type, String> {
        if depth > MOST_NESTED {
            return Err(format!("{}: nested more than {MOST_NESTED} deep", self.place()));
        }
        self.annotations()?;
        let name = self.name()?;
        let kind = |number| Type::Plain(Kind::Number(number));
        if let Some(number) = number_called(name) {
            return Ok(kind(number));
        }
        Ok(match name {
            "long" if self.word("long") => kind(Number::I64),
            "long" if self.word("double") => Type::Refused("a long double"),
            "long" => kind(Number::I32),
            "unsigned" => match self.name()? {
                "short" => kind(Number::U16),
                _ if self.word("long") => kind(Number::U64),
                _ => kind(Number::U32),
            },
            "string" | "wstring" => {
                if self.sign('<') {
                    self.number();
                    self.expect('>')?;
                }
                Type::Plain(if name == "string" { Kind::Text } else { Kind::WideText })
            }
            "sequence" => {
                self.expect('<')?;
                let of = self.type_of(depth + 1)?;
                if self.sign(',') {
                    self.number();
                }
                self.expect('>')?;
                Type::Sequence(Box::new(of))
            }
            "map" => {
                self.balanced('<', '>')?;
                Type::Refused("a map")
            }
            "any" | "fixed" => Type::Refused("a type without a fixed layout"),
            name => Type::Named(name.to_owned(), self.scope.clone()),
        })
    }
}

/// Whether this is a time, with or without its definition.
fn is_time(name: &str) -> bool {
    matches!(name, "builtin_interfaces::msg::Time" | "builtin_interfaces::msg::Duration")
}

struct Builder<'d> {
    types: &'d HashMap<String, Definition>,
    /// Finished messages by name; `None` while one is being built.
    known: HashMap<String, Option<usize>>,
    messages: Vec<Message>,
}

impl Builder<'_> {
    /// Builds a structure and the types it uses; returns its index among the messages.
    fn message(&mut self, name: &str, depth: usize) -> Result<usize, String> {
        match self.known.get(name) {
            Some(Some(index)) => return Ok(*index),
            Some(None) => return Err(format!("{name}: the type contains itself")),
            None if depth > MOST_NESTED => return Err(format!("{name}: nested more than {MOST_NESTED} deep")),
            None => self.known.insert(name.to_owned(), None),
        };
        let index = self.messages.len();
        self.messages.push(Message { name: name.to_owned(), fields: vec![] });
        let fields = self.fields(name, depth)?;
        if let Some(message) = self.messages.get_mut(index) {
            message.fields = fields;
        }
        self.known.insert(name.to_owned(), Some(index));
        Ok(index)
    }

    /// The members of a structure, those of its base first.
    fn fields(&mut self, name: &str, depth: usize) -> Result<Vec<Field>, String> {
        let Some(Definition::Struct { base, members }) = self.types.get(name) else {
            return Err(format!("{name}: not a structure"));
        };
        let mut fields = vec![];
        if let Some(Type::Named(base, scope)) = base {
            let (base, _) = resolve(self.types, scope, base).ok_or_else(|| format!("{name}: {base} is not defined"))?;
            if depth > MOST_NESTED {
                return Err(format!("{name}: nested more than {MOST_NESTED} deep"));
            }
            fields = self.fields(&base, depth + 1)?;
        }
        for (member, of) in members {
            let (kind, count) = self.kind(of, depth).map_err(|what| format!("{name}: {member}: {what}"))?;
            fields.push(Field { name: member.clone(), kind, count });
        }
        Ok(fields)
    }

    fn kind(&mut self, of: &Type, depth: usize) -> Result<(Kind, Count), String> {
        if depth > MOST_NESTED {
            return Err(format!("nested more than {MOST_NESTED} deep"));
        }
        match of {
            Type::Plain(kind) => Ok((*kind, Count::One)),
            Type::Refused(what) => Err(format!("{what} is not supported")),
            Type::Sequence(of) => Ok((self.element(of, depth + 1)?, Count::Variable)),
            Type::Array(of, count) => Ok((self.element(of, depth + 1)?, Count::Fixed(*count))),
            Type::Named(name, _) if is_time(name) => Ok((Kind::Time { signed_seconds: true }, Count::One)),
            Type::Named(name, scope) => {
                let (full, definition) =
                    resolve(self.types, scope, name).ok_or_else(|| format!("the type {name:.200} is not defined"))?;
                match definition {
                    Definition::Alias(of) => self.kind(&of.clone(), depth + 1),
                    Definition::Refused(what) => Err(format!("{what} is not supported")),
                    Definition::Constant(_) => Err(format!("{name:.200} is not a type")),
                    Definition::Struct { .. } => Ok((Kind::Message(self.message(&full, depth + 1)?), Count::One)),
                }
            }
        }
    }

    /// The element of an array or sequence. Nested arrays become messages with a single field `value`.
    fn element(&mut self, of: &Type, depth: usize) -> Result<Kind, String> {
        let (kind, count) = self.kind(of, depth)?;
        if count == Count::One {
            return Ok(kind);
        }
        let field = Field { name: "value".to_owned(), kind, count };
        self.messages.push(Message { name: "array".to_owned(), fields: vec![field] });
        Ok(Kind::Message(self.messages.len() - 1))
    }
}

/// The number type with a one-word name.
fn number_called(name: &str) -> Option<Number> {
    Some(match name {
        "boolean" => Number::Bool,
        "octet" | "char" | "uint8" => Number::U8,
        "int8" => Number::I8,
        "short" | "int16" => Number::I16,
        "uint16" | "wchar" => Number::U16,
        "int32" => Number::I32,
        "uint32" => Number::U32,
        "int64" => Number::I64,
        "uint64" => Number::U64,
        "float" => Number::F32,
        "double" => Number::F64,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As generated by `rosidl_adapter`, with other features of the language.
    const FIX: &str = r#"
================================================================================
IDL: test_msgs/msg/Fix
// generated from rosidl_adapter/resource/msg.idl.em
#include "std_msgs/msg/Header.idl"

module test_msgs {
  module msg {
    const unsigned long NINE = 9;
    typedef double double__9[9];
    typedef sequence<uint8, 7> Raw;
    module Fix_Constants {
      @verbatim (language="comment", text="a \"quoted\" ) } text")
      const octet STATUS = 1;
      const string NAME = "a;b";
    };
    enum Mode { @value(1) ONE, TWO };
    @verbatim (language="comment", text=
      "Two" "lines")
    struct Fix : Base {
      @unit (value="deg")
      double latitude, longitude;
      double__9 covariance;
      float small[2][3];
      unsigned long long big;
      long long whole; long word; unsigned short half; char letter; boolean flag;
      sequence<test_msgs::msg::Part> parts; /* a comment */
      Part one;
      Raw raw;
      Mode mode;
      string<9> name; wstring wide;
      builtin_interfaces::msg::Time stamp;
      sequence<double__9> many;
      int16 last[NINE];
    };
    struct Part { uint8 a; @key double b; };
    struct Base { std_msgs::msg::Header header; };
    struct Later;
    union U switch (long) { case 1: long a; };
  };
};
================================================================================
IDL: std_msgs/msg/Header
module std_msgs { module msg { struct Header { builtin_interfaces::msg::Time stamp; string frame_id; }; }; };
"#;

    #[test]
    fn the_idl_of_a_message_gives_the_same_schema_as_its_msg() {
        let msg = "std_msgs/Header header\nfloat64 latitude\nfloat64 longitude\nfloat64[9] covariance\nfloat32[6] small\n\
            uint64 big\nint64 whole\nint32 word\nuint16 half\nuint8 letter\nbool flag\nPart[] parts\nPart one\nuint8[] raw\n\
            uint32 mode\nstring name\nwstring wide\nbuiltin_interfaces/Time stamp\nMany[] many\nint16[9] last\n===\n\
            MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n===\nMSG: test_msgs/Part\nuint8 a\nfloat64 b\n\
            ===\nMSG: test_msgs/Many\nfloat64[9] value\n";
        let flat = |schema: &Schema| -> Vec<(String, Vec<(String, String)>)> {
            // The numbering of messages differs: they are identified by their own fields.
            let of = |field: &Field| match field.kind {
                Kind::Message(index) => format!(
                    "{:?} of {:?}",
                    field.count,
                    schema.messages[index].fields.iter().map(|f| &f.name).collect::<Vec<_>>()
                ),
                kind => format!("{kind:?} {:?}", field.count),
            };
            let message = |m: &Message| (String::new(), m.fields.iter().map(|f| (f.name.clone(), of(f))).collect());
            let mut all: Vec<_> = schema.messages.iter().map(message).collect();
            all[1..].sort();
            all
        };
        let ours = Schema::parse_idl("test_msgs/msg/Fix", FIX).unwrap();
        let theirs = Schema::parse("test_msgs/msg/Fix", msg, Dialect::Ros2).unwrap();
        assert_eq!(flat(&ours), flat(&theirs));
    }

    #[test]
    fn the_root_is_found_by_its_short_name_if_that_is_unique() {
        let text = "module a { struct X { double v; }; };";
        assert!(Schema::parse_idl("b/msg/X", text).is_ok());
        assert!(Schema::parse_idl("b/msg/X", &format!("{text} module c {{ struct X {{ double v; }}; }};")).is_err());
    }

    #[test]
    fn unsupported_constructs_are_rejected_by_name() {
        let of = |members: &str| {
            let text = format!(
                "module m {{ union U switch (long) {{ case 1: long a; }}; bitmask B {{ @position(0) x }}; \
                 typedef A Again; const long N = 1 + 2; struct A {{ {members} }}; }};"
            );
            Schema::parse_idl("m/A", &text).unwrap_err()
        };
        for (members, word) in [
            ("U u;", "a union"),
            ("B b;", "a bit mask"),
            ("map<string, long> m;", "a map"),
            ("@optional long x;", "optional"),
            ("long double x;", "long double"),
            ("Unknown x;", "Unknown is not defined"),
            ("sequence<A> x;", "contains itself"),
            ("Again x;", "contains itself"),
            ("long x", "after x: ';' is missing"),
            ("long x[99999999999];", "length"),
            ("N x;", "not a type"),
            ("long \"x\";", "after long: a name is missing"),
        ] {
            assert!(of(members).contains(word), "{members}: {}", of(members));
        }
        for (text, word) in [
            ("struct A { long x; } /* no end", "comment"),
            ("'", "text"),
            ("}", "neither"),
            ("@", "after the beginning: a name is missing"),
            ("struct A { long x;", "after x"),
        ] {
            assert!(Schema::parse_idl("A", text).unwrap_err().contains(word), "{text}");
        }
    }

    #[test]
    fn deep_and_circular_types_are_rejected() {
        let chain: String = (0..1000).map(|i| format!("struct T{i} {{ T{} a; }};", i + 1)).collect();
        assert!(Schema::parse_idl("T0", &chain).unwrap_err().contains("nested"));
        let aliases: String = (0..1000).map(|i| format!("typedef T{} T{i};", i + 1)).collect();
        assert!(Schema::parse_idl("A", &format!("{aliases} struct A {{ T0 a; }};")).unwrap_err().contains("nested"));
        let bases = "struct A : B { long a; }; struct B : A { long b; };";
        assert!(Schema::parse_idl("A", bases).unwrap_err().contains("nested"));
        let sequences = format!("struct A {{ {} long {} a; }};", "sequence<".repeat(10_000), ">".repeat(10_000));
        assert!(Schema::parse_idl("A", &sequences).unwrap_err().contains("nested"));
        let modules = "module m {".repeat(10_000);
        assert!(Schema::parse_idl("A", &modules).is_err());
    }
}
