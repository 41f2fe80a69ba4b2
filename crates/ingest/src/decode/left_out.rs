//! Fields without a column although every field is wanted: variable-length and long arrays.

use super::protobuf::Types;
use super::rows::Rows;
use super::schema::{Count, Dialect, Kind, Schema};
use super::{COMMON, COMPLETED, COMPLETED_AS_GIVEN, Definition, GIVEN, json, protobuf, ros};
use crate::reader::LeftOut;
use crate::table::TopicInfo;
use std::collections::BTreeSet;

/// The most fields examined: a definition can name exponentially many.
const MOST_VISITED: usize = 16_384;
/// The most fields named in a notice.
const NAMED: usize = 5;

/// What is missing in the rows of a topic.
pub(super) fn of<'d>(
    info: &TopicInfo,
    definitions: impl Iterator<Item = Definition<'d>>,
    rows: &Rows,
) -> Option<LeftOut> {
    let mut names: BTreeSet<String> = definitions.flat_map(|definition| by_definition(info, definition)).collect();
    names.extend(beyond(info, rows));
    let first: Vec<&str> = names.iter().take(NAMED).map(String::as_str).collect();
    let more = if names.len() > NAMED { ", ..." } else { "" };
    (!names.is_empty()).then(|| LeftOut {
        topic: info.name.clone(),
        fields: names.len() as u64,
        names: format!("{}{more}", first.join(", ")),
    })
}

/// From the definition alone: `path[]` is a variable-length array, `path[64..100]` the elements after those that are
/// read.
fn by_definition(info: &TopicInfo, Definition { encoding, text }: Definition<'_>) -> Vec<String> {
    let read = String::from_utf8_lossy;
    let ros = |schema: Result<Schema, String>| schema.map_or(vec![], |schema| of_ros(&schema));
    match (info.encoding.as_str(), encoding) {
        ("ros1", "ros1msg" | COMPLETED | COMPLETED_AS_GIVEN) => {
            ros(Schema::parse(&info.type_name, &read(text), Dialect::Ros1))
        }
        ("cdr", "ros2msg" | COMMON | GIVEN) => ros(Schema::parse(&info.type_name, &read(text), Dialect::Ros2)),
        ("cdr", "ros2idl" | "omgidl") => ros(Schema::parse_idl(&info.type_name, &read(text))),
        ("protobuf", "protobuf") => Types::parse(text).map_or(vec![], |types| of_protobuf(&types, &info.type_name)),
        _ => vec![],
    }
}

/// Arrays without a bound in a definition that fill every column available for their elements.
fn beyond(info: &TopicInfo, rows: &Rows) -> Vec<String> {
    let most = match info.encoding.as_str() {
        "json" => json::MOST_ELEMENTS,
        "protobuf" => protobuf::MOST_ELEMENTS,
        _ => return vec![],
    };
    let last = format!("[{}]", most - 1);
    let long = |path: &str| Some(format!("{}[{most}..] if present", path.split_once(&last)?.0));
    rows.paths().filter_map(long).collect()
}

/// The fields of one type that are not read, in order.
struct Walk<'s, T> {
    types: &'s T,
    found: Vec<String>,
    visited: usize,
}

impl<'s, T> Walk<'s, T> {
    fn new(types: &'s T) -> Walk<'s, T> {
        Walk { types, found: vec![], visited: 0 }
    }

    fn may_go_on(&mut self) -> bool {
        self.visited += 1;
        self.visited <= MOST_VISITED
    }
}

fn path_of(prefix: &str, name: &str) -> String {
    if prefix.is_empty() { name.to_owned() } else { format!("{prefix}.{name}") }
}

fn of_ros(schema: &Schema) -> Vec<String> {
    let mut walk = Walk::new(schema);
    walk.message(0, "");
    walk.found
}

impl Walk<'_, Schema> {
    fn message(&mut self, message: usize, prefix: &str) {
        let types = self.types;
        for field in types.messages.get(message).map_or(&[][..], |m| &m.fields) {
            if !self.may_go_on() {
                return;
            }
            let path = path_of(prefix, &field.name);
            match (field.count, field.kind) {
                (Count::Variable, _) => self.found.push(format!("{path}[]")),
                (Count::One, Kind::Message(inner)) => self.message(inner, &path),
                (Count::One, _) => {}
                (Count::Fixed(count), kind) => {
                    if count > ros::MOST_ELEMENTS {
                        self.found.push(format!("{path}[{}..{count}]", ros::MOST_ELEMENTS));
                    }
                    if let (Kind::Message(inner), 1..) = (kind, count) {
                        self.message(inner, &format!("{path}[*]"));
                    }
                }
            }
        }
    }
}

fn of_protobuf(types: &Types, root: &str) -> Vec<String> {
    let mut walk = Walk::new(types);
    walk.fields(root, "", &mut vec![]);
    walk.found
}

impl<'s> Walk<'s, Types> {
    fn fields(&mut self, name: &'s str, prefix: &str, open: &mut Vec<&'s str>) {
        const BYTES: u64 = 12;
        let types = self.types;
        open.push(name.trim_start_matches('.'));
        for field in types.fields(name).unwrap_or_default() {
            if !self.may_go_on() {
                break;
            }
            let path = path_of(prefix, &field.name);
            let again = open.contains(&field.type_name.trim_start_matches('.'));
            match (field.is_message(), field.repeated) {
                (true, _) if field.is_time() => {}
                (true, false) if !again => self.fields(&field.type_name, &path, open),
                (true, true) => self.found.push(format!("{path}[]")),
                (true, false) => self.found.push(path),
                (false, _) if field.kind == BYTES => self.found.push(path),
                (false, _) => {}
            }
        }
        open.pop();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn info(encoding: &str) -> TopicInfo {
        TopicInfo { name: "/t".to_owned(), type_name: "p/A".to_owned(), encoding: encoding.to_owned() }
    }

    #[test]
    fn variable_length_arrays_and_the_rest_of_long_ones_are_named() {
        let text = b"float64 a\nfloat32[] ranges\nint16[3] s\nB[2] b\nfloat64[100] long\nstring[] names\nB inner\n\
                     ===\nMSG: p/B\nuint8[<=4] data\ntime t";
        let definition = Definition { encoding: "ros1msg", text };
        let found = by_definition(&info("ros1"), definition);
        assert_eq!(found, ["ranges[]", "b[*].data[]", "long[64..100]", "names[]", "inner.data[]"]);
        let left_out = of(&info("ros1"), [definition; 2].into_iter(), &Rows::default()).unwrap();
        assert_eq!(
            (left_out.fields, left_out.names.as_str()),
            (5, "b[*].data[], inner.data[], long[64..100], names[], ranges[]")
        );
        let whole = Definition { encoding: "ros1msg", text: b"float64[64] a\nstring s" };
        assert_eq!(of(&info("ros1"), [whole].into_iter(), &Rows::default()), None);
    }

    #[test]
    fn a_json_array_that_fills_all_columns_may_be_longer() {
        let mut rows = Rows::default();
        let numbers = |count: usize| vec!["1"; count].join(",");
        let text = format!(r#"{{"short":[{}],"full":[{}]}}"#, numbers(63), numbers(64));
        json::decode(text.as_bytes(), &crate::decode::Wanted::All, &mut rows).unwrap();
        let left_out = of(&info("json"), std::iter::empty(), &rows).unwrap();
        assert_eq!((left_out.fields, left_out.names.as_str()), (1, "full[64..] if present"));
    }
}
