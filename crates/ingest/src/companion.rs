//! Logs that accompany those of flights: complete, but without the position of the vehicle.

use flight::{Flight, LogHealth, Quantity, TopicHealth};

/// What the log is, if it is not a flight but belongs to one: a file of a FlySight 2 other than its track, or reports
/// of other vessels. A log with a position of its vehicle is never a companion.
pub(crate) fn companion(health: &LogHealth, flight: &Flight) -> Option<&'static str> {
    let is_position = |quantity| matches!(quantity, Quantity::PositionGeodetic | Quantity::PositionNed);
    if flight.channels.values().any(|channel| is_position(channel.quantity)) {
        return None;
    }
    let held: Vec<&TopicHealth> = health.topics.iter().filter(|topic| topic.messages > 0).collect();
    let all = |of: fn(&TopicHealth) -> bool| !held.is_empty() && held.iter().all(|topic| of(topic));
    if health.format.contains("FlySight 2") && all(|topic| topic.name != "GNSS") {
        Some("this is the SENSOR or EVENT file of a FlySight 2. It has no position; the flight is in TRACK.CSV")
    } else if all(is_of_other_vessels) {
        Some("this log holds AIS reports of other vessels, but no position of its own vehicle")
    } else {
        None
    }
}

/// `AIVDM` sentences, and topics below `ais`.
fn is_of_other_vessels(topic: &TopicHealth) -> bool {
    topic.name.ends_with("VDM") || topic.name.split('/').any(|part| part.eq_ignore_ascii_case("ais"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn log(format: &str, topics: &[&str]) -> LogHealth {
        let topic = |name: &&str| TopicHealth {
            name: (*name).to_owned(),
            type_name: String::new(),
            encoding: "csv".to_owned(),
            messages: 3,
            payload_bytes: 9,
            stamps: vec![],
            decoded: true,
            reason: String::new(),
        };
        let topics = topics.iter().map(topic).collect();
        LogHealth { format: format.to_owned(), topics, ..LogHealth::default() }
    }

    #[test]
    fn sensors_without_their_track_and_other_vessels_are_not_flights() {
        let of = |format, topics: &[&str]| companion(&log(format, topics), &Flight::default()).unwrap_or("");
        assert!(of("FlySight 2 CSV", &["BARO", "IMU"]).contains("TRACK.CSV"));
        assert!(of("FlySight 2 CSV", &["EVNT"]).contains("TRACK.CSV"));
        assert!(of("MCAP", &["a/raw/ais/json/209014000/3", "a/raw/AIS/nmea0183"]).contains("other vessels"));
        assert!(of("NMEA 0183", &["AIVDM"]).contains("other vessels"));
    }

    #[test]
    fn a_log_of_an_own_vehicle_is_not_a_companion() {
        let of = |format, topics: &[&str]| companion(&log(format, topics), &Flight::default());
        assert_eq!(of("FlySight 2 CSV", &["GNSS", "IMU"]), None, "a track that was never fixed is a failed flight");
        assert_eq!(of("MCAP", &["a/raw/ais/json/209014000/3", "imu"]), None);
        assert_eq!(of("NMEA 0183", &["AIVDM", "GPRMC"]), None);
        assert_eq!(of("CSV", &[]), None);
        assert_eq!(of("MCAP", &["raise/main"]), None);
    }
}
