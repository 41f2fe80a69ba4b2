//! Names of ArduPilot's flight modes.

/// One line per vehicle.
const TABLE: &str = include_str!("modes.txt");

/// The mode of vehicle `system`; `mode 7` if either is unknown.
pub(in crate::format) fn name(system: Option<&str>, number: i64) -> String {
    let modes = TABLE.lines().filter_map(|line| line.split_once(": ")).find(|(name, _)| Some(*name) == system);
    let mut pairs = modes.into_iter().flat_map(|(_, modes)| modes.split(", ")).filter_map(|mode| mode.split_once(' '));
    let known = pairs.find(|(known, _)| known.parse() == Ok(number));
    known.map_or_else(|| format!("mode {number}"), |(_, name)| name.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modes_are_named_by_vehicle() {
        let named = [("ArduCopter", 28), ("ArduPlane", 26), ("Blimp", 0), ("ArduSub", 5), ("Kite", 1)];
        let names = named.map(|(system, number)| name(Some(system), number));
        assert_eq!(names, ["TURTLE", "AUTOLAND", "LAND", "mode 5", "mode 1"]);
        assert_eq!(name(None, 7), "mode 7");
    }
}
