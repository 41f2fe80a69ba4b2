//! Definitions of common ROS messages. They are used for ROS 2 bags from before bags held definitions, and for ROS 1
//! bags with definitions that lack a type, as rosjava writes them.
//!
//! Written from the public definitions of common_interfaces (Dashing to Humble agree on them), geographic_info, gps_umd
//! and mavros. A ROS 2 message must match its definition to the byte, so that another version is rejected instead of
//! misread. In ROS 1 the MD5 sum of the connection decides.

use crate::decode::schema::{Dialect, Names, sections, types_within};
use crate::decode::type_sum::{MD5_OF_NOTHING, type_sum};
use crate::decode::{Definition, LONGEST_DEFINITION};
use crate::reader::Select;
use crate::table::TopicInfo;
use std::collections::HashSet;

/// The language of a common definition, which is not from the log.
pub(crate) const COMMON: &str = "ros2msg, common";
/// The language of a definition that the user supplied.
pub(crate) const GIVEN: &str = "ros2msg, given";
/// Language of a ROS 1 definition that was completed with built-in ones.
pub(crate) const COMPLETED: &str = "ros1msg, common";
/// Language of a ROS 1 definition that was completed with the user's.
pub(crate) const COMPLETED_AS_GIVEN: &str = "ros1msg, given";
/// As in MCAP's registry of schema encodings, for readers of the copied definition.
const SEPARATOR: &str = "================================================================================";
/// The most types that are searched for at a time: a hostile definition may use many.
const MOST_MISSING: usize = 100;
const TYPES: &str = include_str!("common.msg");
const TYPES_ROS1: &str = include_str!("common_ros1.msg");

/// A definition from outside the log with its language, to replace one that the log lacks or leaves incomplete. `md5sum` is the one that a
/// ROS 1 log states for the type.
///
/// # Errors
/// If a ROS 1 definition is incomplete and cannot be completed to match its MD5 sum.
pub(crate) fn borrowed(
    info: &TopicInfo,
    own: Definition<'_>,
    md5sum: Option<&str>,
    want: &dyn Select,
) -> Result<Option<(&'static str, String)>, String> {
    match info.encoding.as_str() {
        "cdr" => Ok(borrowed_ros2(info, own, want)),
        "ros1" if !info.type_name.is_empty() && is_completable(own, md5sum) => {
            completed_ros1(info, own.text, md5sum, want)
        }
        _ => Ok(None),
    }
}

/// Whether a ROS 1 definition may be incomplete. An empty one is complete unless the type is known to have fields.
fn is_completable(own: Definition<'_>, md5sum: Option<&str>) -> bool {
    match (own.encoding, own.text.is_empty()) {
        ("", _) => true,
        ("ros1msg", true) => md5sum.is_some_and(|sum| sum != MD5_OF_NOTHING),
        ("ros1msg", false) => own.text.len() <= LONGEST_DEFINITION,
        _ => false,
    }
}

/// The common definition, or else the user's. A ROS 2 recorder that does not find a definition leaves the text empty,
/// or its language unknown or empty.
fn borrowed_ros2(info: &TopicInfo, own: Definition<'_>, want: &dyn Select) -> Option<(&'static str, String)> {
    if !own.text.is_empty() && !["", "unknown"].contains(&own.encoding) {
        return None;
    }
    let root = info.type_name.replace("/msg/", "/");
    let common = common_definition(&root).map(|text| (COMMON, text));
    common.or_else(|| {
        let text = want.definition(&root)?;
        let find = |name: &str| want.definition(name).or_else(|| section(TYPES, name));
        Some((GIVEN, with_all_types(&root, text, Dialect::Ros2, find)))
    })
}

/// The log's own text with the missing types. Definitions from the user come first, but only a text that matches the
/// stated MD5 sum is used.
fn completed_ros1(
    info: &TopicInfo,
    own: &[u8],
    md5sum: Option<&str>,
    want: &dyn Select,
) -> Result<Option<(&'static str, String)>, String> {
    let (root, own) = (&info.type_name, String::from_utf8_lossy(own));
    let missing = missing_types(root, &own);
    if missing.is_empty() {
        return Ok(None);
    }
    let built_in = |name: &str| section(TYPES_ROS1, name);
    let given = |name: &str| want.definition(name).or_else(|| section(TYPES_ROS1, name));
    let is_given = want.definition(root).is_some() || missing.iter().any(|name| want.definition(name).is_some());
    let candidates = [
        is_given.then(|| (COMPLETED_AS_GIVEN, completed(root, &own, given))),
        Some((COMPLETED, completed(root, &own, built_in))),
    ];
    let mut refusal = None;
    for (language, text) in candidates.into_iter().flatten() {
        match text.and_then(|text| agreeing(root, text, md5sum)) {
            Ok(text) => return Ok(Some((language, text))),
            Err(why) => refusal = refusal.or(Some(why)),
        }
    }
    let lacks = match own.is_empty() {
        true => format!("the message definition of {root} is missing"),
        false => format!("the definition of {root} lacks {}", missing.join(", ")),
    };
    Err(format!("{lacks}: {}", refusal.unwrap_or_default()))
}

/// The types that a ROS 1 definition uses but does not hold; the type itself if the text is empty.
fn missing_types(root: &str, text: &str) -> Vec<String> {
    if text.is_empty() {
        return vec![root.to_owned()];
    }
    let sections = sections(root, text);
    let names = Names::of(&sections);
    let (mut open, mut seen, mut missing) = (vec![0], HashSet::from([0]), vec![]);
    while let Some(section) = open.pop().and_then(|index| sections.get(index)) {
        for used in types_within(&section.name, &section.lines.join("\n"), Dialect::Ros1) {
            match names.section(&used) {
                Some(index) if seen.insert(index) => open.push(index),
                None if missing.len() < MOST_MISSING && !missing.contains(&used) => missing.push(used),
                _ => {}
            }
        }
    }
    missing
}

/// A ROS 1 definition with its missing types, as far as `find` has them.
fn completed<'t>(root: &str, own: &str, find: impl Fn(&str) -> Option<&'t str>) -> Result<String, String> {
    if own.is_empty() {
        let text = find(root).ok_or_else(|| unknown(root))?;
        return Ok(with_all_types(root, text, Dialect::Ros1, find));
    }
    let mut text = own.trim_end().to_owned();
    loop {
        let missing = missing_types(root, &text);
        if missing.is_empty() {
            return Ok(text + "\n");
        }
        for name in missing {
            let body = find(&name).ok_or_else(|| unknown(&name))?;
            text += &format!("\n{SEPARATOR}\nMSG: {name}\n{}", body.trim_end());
        }
    }
}

fn unknown(name: &str) -> String {
    let (package, own) = name.split_once('/').unwrap_or(("PACKAGE", name));
    format!("{name} is not built in (put it into the --maps folder, as {package}/msg/{own}.msg)")
}

/// `text` if it matches the stated MD5 sum.
fn agreeing(root: &str, text: String, md5sum: Option<&str>) -> Result<String, String> {
    let stated = md5sum.filter(|sum| sum.len() == 32).ok_or(
        "the log states no MD5 sum, so other definitions cannot be \
            checked",
    )?;
    let sum = type_sum(root, &text)?;
    if sum != stated {
        return Err(format!("the MD5 sum of the completed definition is {sum}, but the log states {stated:.32}"));
    }
    Ok(text)
}

/// The definition of a ROS 2 type with all the types it uses; `None` if it is unknown.
fn common_definition(root: &str) -> Option<String> {
    let find = |name: &str| section(TYPES, name);
    Some(with_all_types(root, find(root)?, Dialect::Ros2, find))
}

/// The definition of a type with all the types it uses, as far as `find` has them.
fn with_all_types<'t>(root: &str, text: &str, dialect: Dialect, find: impl Fn(&str) -> Option<&'t str>) -> String {
    let mut all = text.trim_end().to_owned();
    let mut needed = vec![root.to_owned()];
    add_types(&mut needed, root, text, dialect);
    let mut next = 1;
    while let Some(name) = needed.get(next).cloned() {
        next += 1;
        if let Some(body) = find(&name) {
            all += &format!("\n{SEPARATOR}\nMSG: {name}\n{}", body.trim_end());
            add_types(&mut needed, &name, body, dialect);
        }
    }
    all + "\n"
}

fn add_types(needed: &mut Vec<String>, owner: &str, body: &str, dialect: Dialect) {
    for used in types_within(owner, body, dialect) {
        if !needed.contains(&used) {
            needed.push(used);
        }
    }
}

fn section(types: &'static str, name: &str) -> Option<&'static str> {
    types.split("===\nMSG: ").find_map(|part| part.strip_prefix(name)?.strip_prefix('\n'))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decode::schema::Schema;

    fn names(types: &'static str) -> Vec<&'static str> {
        let names = types.split("===\nMSG: ").filter_map(|part| part.lines().next());
        names.filter(|name| name.contains('/')).collect()
    }

    #[test]
    fn every_definition_uses_only_defined_types() {
        for (types, dialect) in [(TYPES, Dialect::Ros2), (TYPES_ROS1, Dialect::Ros1)] {
            let names = names(types);
            assert!(names.len() > 50);
            for name in names {
                let find = |name: &str| section(types, name);
                let text = with_all_types(name, find(name).unwrap(), dialect, find);
                Schema::parse(name, &text, dialect).unwrap_or_else(|e| panic!("{name}: {e}"));
            }
        }
        assert_eq!(common_definition("no_msgs/Such"), None);
    }

    /// As printed by `rosmsg md5` (Noetic).
    const PUBLISHED_SUMS: &[(&str, &str)] = &[
        ("std_msgs/Header", "2176decaecbce78abc3b96ef049fabed"),
        ("std_msgs/Time", "cd7166c74c552c311fbcc2fe5a7bc289"),
        ("geometry_msgs/Point32", "cc153912f1453b708d221682bc23d9ac"),
        ("geometry_msgs/PoseStamped", "d3812c3cbc69362b77dc0b19b345f8f5"),
        ("geometry_msgs/PoseWithCovarianceStamped", "953b798c0f514ff060a53a3498ce6246"),
        ("geometry_msgs/TwistStamped", "98d34b0043a2093cf9d9345ab6eef12e"),
        ("geometry_msgs/TwistWithCovarianceStamped", "8927a1a12fb2607ceea095b2dc440a96"),
        ("geometry_msgs/AccelWithCovarianceStamped", "96adb295225031ec8d57fb4251b0a886"),
        ("geometry_msgs/WrenchStamped", "d78d3cb249ce23087ade7e7d0c40cfa7"),
        ("geometry_msgs/TransformStamped", "b5764a33bfeb3588febc2682852579b0"),
        ("tf/tfMessage", "94810edda583a504dfda3829e70d7eec"),
        ("nav_msgs/Odometry", "cd5e73d190d741a2f92e81eda573aca7"),
        ("nav_msgs/Path", "6227e2b7e9cce15051f669a5e197bbf7"),
        ("sensor_msgs/NavSatStatus", "331cdbddfa4bc96ffc3b9ad98900a54c"),
        ("sensor_msgs/NavSatFix", "2d3a8cd499b9b4a0249fb98fd05cfa48"),
        ("sensor_msgs/Imu", "6a62c6daae103f4ff57a132d6f95cec2"),
        ("sensor_msgs/MagneticField", "2f3b0b43eed0c9501de0fa3ff89a45aa"),
        ("sensor_msgs/FluidPressure", "804dc5cea1c5306d6a2eb80b9833befe"),
        ("sensor_msgs/Temperature", "ff71b307acdbe7c871a5a6d7ed359100"),
        ("sensor_msgs/JointState", "3066dcd76a6cfaef579bd0f34173e9fd"),
        ("sensor_msgs/TimeReference", "fded64a0265108ba86c3d38fb11c0c16"),
        ("sensor_msgs/Range", "c005c34273dc426c67a020a87bc24148"),
        ("geographic_msgs/GeoPoseStamped", "cc409c8ed6064d8a846fa207bf3fba6b"),
        ("gps_common/GPSFix", "3db3d0a7bc53054c67c528af84710b70"),
        ("mavros_msgs/Altitude", "1296a05dc5b6160be0ae04ba9ed3a3fa"),
    ];

    #[test]
    fn built_in_ros_1_definitions_have_the_published_sums() {
        for (name, sum) in PUBLISHED_SUMS {
            let find = |name: &str| section(TYPES_ROS1, name);
            let text = with_all_types(name, find(name).unwrap(), Dialect::Ros1, find);
            assert_eq!(type_sum(name, &text).unwrap(), *sum, "{name}");
        }
    }

    #[test]
    fn only_used_types_are_missing() {
        let text = "Header header\nPart part\nuint8 A=1\n===\nMSG: p/Part\ngeometry_msgs/Point at\ntime t\n\
                    ===\nMSG: p/Unused\nOther other\n";
        let mut missing = missing_types("p/A", text);
        missing.sort();
        assert_eq!(missing, ["geometry_msgs/Point", "std_msgs/Header"]);
        let whole = completed("p/A", text, |name| section(TYPES_ROS1, name)).unwrap();
        assert!(missing_types("p/A", &whole).is_empty());
    }
}
