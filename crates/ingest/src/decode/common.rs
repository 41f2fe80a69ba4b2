//! Definitions of common ROS 2 messages, for bags that were recorded before bags held definitions.
//!
//! Written from the public definitions of common_interfaces (Dashing to Humble agree on them),
//! geographic_info, gps_umd and mavros. A message must fit its definition to the byte, so that one of
//! another version is refused and not read wrongly.

/// Names the language of a definition that is not the log's own.
pub(crate) const COMMON: &str = "ros2msg, common";
const TYPES: &str = include_str!("common.msg");

/// The definition of a type with all that it refers to; `None` if it is not known.
pub(crate) fn common_definition(type_name: &str) -> Option<String> {
    let root = type_name.replace("/msg/", "/");
    let mut needed = vec![root.clone()];
    let mut text = section(&root)?.to_owned();
    let mut next = 0;
    while let Some(name) = needed.get(next).cloned() {
        let body = section(&name)?;
        if next > 0 {
            text += &format!("===\nMSG: {name}\n{body}");
        }
        for used in body.lines().filter_map(|line| line.split([' ', '[']).next()).filter(|used| used.contains('/')) {
            if !needed.iter().any(|n| n == used) && used != "builtin_interfaces/Time" {
                needed.push(used.to_owned());
            }
        }
        next += 1;
    }
    Some(text)
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
