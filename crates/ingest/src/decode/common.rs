//! Definitions of common ROS 2 messages, for bags that were recorded before bags held definitions.
//!
//! Written from the public definitions of common_interfaces (Dashing to Humble agree on them),
//! geographic_info, gps_umd and mavros. A message must fit its definition to the byte, so that one of
//! another version is refused and not read wrongly.

use crate::decode::Definition;
use crate::decode::schema::types_within;
use crate::reader::Select;
use crate::table::TopicInfo;

/// Language of a definition that is not the log's own, but common.
pub(crate) const COMMON: &str = "ros2msg, common";
/// Language of one that the user gave.
pub(crate) const GIVEN: &str = "ros2msg, given";
/// As MCAP's registry of schema encodings has it, for who copies the definition.
const SEPARATOR: &str = "================================================================================";
const TYPES: &str = include_str!("common.msg");

/// A definition, with its language, in place of one that the log lacks: the common one, else what the user gave. A recorder
/// of ROS 2 that does not find a definition leaves the text empty, or calls its language unknown or nothing.
pub(crate) fn lent(info: &TopicInfo, own: Definition<'_>, want: &dyn Select) -> Option<(&'static str, String)> {
    let told = !own.text.is_empty() && !["", "unknown"].contains(&own.encoding);
    if told || info.encoding != "cdr" {
        return None;
    }
    let common = common_definition(&info.type_name).map(|text| (COMMON, text));
    common.or_else(|| Some((GIVEN, want.definition(&info.type_name)?)))
}

/// The definition of a type with all that it refers to; `None` if it is not known.
fn common_definition(type_name: &str) -> Option<String> {
    with_all_types(type_name, |_| None)
}

/// The definition of a type that `known` has, or else is common, with all that it refers to as far as that is.
pub(crate) fn with_all_types<'t>(type_name: &str, known: impl Fn(&str) -> Option<&'t str>) -> Option<String> {
    let find = |name: &str| known(name).or_else(|| section(name));
    let root = type_name.replace("/msg/", "/");
    let mut text = find(&root)?.trim_end().to_owned();
    let mut needed = vec![root.clone()];
    add_types(&mut needed, &root, &text);
    let mut next = 1;
    while let Some(name) = needed.get(next).cloned() {
        next += 1;
        if let Some(body) = find(&name) {
            text += &format!("\n{SEPARATOR}\nMSG: {name}\n{}", body.trim_end());
            add_types(&mut needed, &name, body);
        }
    }
    Some(text + "\n")
}

fn add_types(needed: &mut Vec<String>, owner: &str, body: &str) {
    for used in types_within(owner, body) {
        if !needed.contains(&used) {
            needed.push(used);
        }
    }
}

fn section(name: &str) -> Option<&'static str> {
    TYPES.split("===\nMSG: ").find_map(|part| part.strip_prefix(name)?.strip_prefix('\n'))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decode::schema::{Dialect, Schema};

    #[test]
    fn every_definition_refers_only_to_what_is_there() {
        let names: Vec<&str> = TYPES.split("===\nMSG: ").filter_map(|part| part.lines().next()).collect();
        assert!(names.len() > 50);
        for name in names.into_iter().filter(|name| name.contains('/')) {
            let text = common_definition(name).unwrap();
            Schema::parse(name, &text, Dialect::Ros2).unwrap_or_else(|e| panic!("{name}: {e}"));
        }
        assert_eq!(common_definition("no_msgs/msg/Such"), None);
    }
}
