//! The fleet file: aircraft and receiver of a flight, where its log does not state them.

use crate::error::HistoryError;
use campaign::pattern::matches;
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::Deserialize;
use settings::{Refused, SettingsFile};
use std::path::Path;
use toml::Spanned;

/// The fleet file.
#[derive(Debug, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "schema", schemars(title = "flightlag fleet"))]
struct FleetFile {
    /// Version of this file's layout: 1.
    #[cfg_attr(feature = "schema", schemars(with = "u32", range(min = 1, max = 1)))]
    schema: Spanned<u32>,
    /// Aircraft, each with its flights. The first that matches a flight is used.
    #[serde(default)]
    #[cfg_attr(feature = "schema", schemars(with = "Vec<AircraftTable>", length(min = 1)))]
    aircraft: Vec<Spanned<AircraftTable>>,
}

/// An aircraft with its receiver and its flights.
#[derive(Debug, Clone, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
struct AircraftTable {
    /// Pattern of CAMPAIGN/FLIGHT; `*` matches anything, including several folders.
    #[cfg_attr(feature = "schema", schemars(with = "String"))]
    flights: Spanned<String>,
    /// Aircraft: registration or tail number.
    airframe: Option<String>,
    /// Make and model of the receiver.
    receiver: Option<String>,
    /// Serial number of the receiver.
    serial: Option<String>,
    /// Firmware of the receiver.
    firmware: Option<String>,
    /// Rate of the position, Hz.
    #[cfg_attr(feature = "schema", schemars(with = "Option<f64>", extend("exclusiveMinimum" = 0)))]
    rate_hz: Option<Spanned<f64>>,
    /// Speed of the receiver's serial line, baud.
    #[cfg_attr(feature = "schema", schemars(with = "Option<u32>", range(min = 1)))]
    baud: Option<Spanned<u32>>,
}

/// What the fleet file states about a flight.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Aircraft {
    /// Aircraft.
    pub airframe: Option<String>,
    /// Make and model of the receiver.
    pub receiver: Option<String>,
    /// Serial number of the receiver.
    pub serial: Option<String>,
    /// Firmware of the receiver.
    pub firmware: Option<String>,
    /// Rate of the position, Hz.
    pub rate_hz: Option<f64>,
    /// Speed of the receiver's serial line, baud.
    pub baud: Option<i64>,
}

/// Aircraft of each flight. Empty without a fleet file.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Fleet {
    /// Patterns and their aircraft; the first match counts.
    aircraft: Vec<(String, Aircraft)>,
}

impl Fleet {
    /// Reads a fleet file.
    ///
    /// # Errors
    /// The file cannot be read or is invalid: every error with its line.
    pub fn read(path: &Path) -> Result<Fleet, HistoryError> {
        Fleet::parse(&settings::read_text(path)?, path)
    }

    /// Reads a fleet from a text; `path` is for errors.
    ///
    /// # Errors
    /// As [`Fleet::read`].
    pub fn parse(text: &str, path: &Path) -> Result<Fleet, HistoryError> {
        let file = SettingsFile::new(text, path);
        let meant = file.read().and_then(|written| meaning_of(&file, written));
        Ok(file.finish(meant)?)
    }

    /// The entry for a flight: the first pattern that matches `CAMPAIGN/FLIGHT`.
    #[must_use]
    pub fn of(&self, campaign: &str, flight: &str) -> Option<&Aircraft> {
        let name = format!("{campaign}/{flight}");
        self.aircraft.iter().find(|(pattern, _)| matches(pattern, &name)).map(|(_, aircraft)| aircraft)
    }
}

fn meaning_of(file: &SettingsFile<'_>, written: FleetFile) -> Result<Fleet, Refused> {
    file.known_layout(&written.schema)?;
    if written.aircraft.is_empty() {
        return Err(file.reject_whole("has no [[aircraft]]: no flight can match"));
    }
    let aircraft: Vec<_> = written.aircraft.into_iter().map(|a| aircraft(file, a)).collect();
    Ok(Fleet { aircraft: aircraft.into_iter().collect::<Result<_, _>>()? })
}

fn aircraft(file: &SettingsFile<'_>, written: Spanned<AircraftTable>) -> Result<(String, Aircraft), Refused> {
    let whole = Spanned::new(written.span(), ());
    let table = written.into_inner();
    check(file, &whole, &table)?;
    let AircraftTable { flights, airframe, receiver, serial, firmware, rate_hz, baud } = table;
    let (rate_hz, baud) = (rate_hz.map(Spanned::into_inner), baud.map(|baud| i64::from(baud.into_inner())));
    Ok((flights.into_inner(), Aircraft { airframe, receiver, serial, firmware, rate_hz, baud }))
}

/// Reports everything that is wrong with an aircraft.
fn check(file: &SettingsFile<'_>, whole: &Spanned<()>, table: &AircraftTable) -> Result<(), Refused> {
    let says_nothing = table.airframe.is_none()
        && [&table.receiver, &table.serial, &table.firmware].iter().all(|text| text.is_none())
        && table.rate_hz.is_none()
        && table.baud.is_none();
    let mut right = Ok(());
    if says_nothing {
        right = Err(
            file.reject(whole, "[[aircraft]] is empty: give airframe, receiver, serial, firmware, rate_hz or baud")
        );
    }
    if table.flights.get_ref().trim().is_empty() {
        right = Err(file.reject(&table.flights, "flights must be a pattern of CAMPAIGN/FLIGHT, such as \"uav-1/*\""));
    }
    if let Some(rate) = table.rate_hz.as_ref().filter(|rate| !(rate.get_ref().is_finite() && *rate.get_ref() > 0.0)) {
        right = Err(file.reject(rate, "rate_hz must be more than 0 Hz"));
    }
    if let Some(baud) = table.baud.as_ref().filter(|baud| *baud.get_ref() == 0) {
        right = Err(file.reject(baud, "baud must be more than 0 baud"));
    }
    right
}

/// The JSON schema of a fleet file, as text.
#[cfg(feature = "schema")]
pub(crate) fn fleet_schema() -> String {
    let schema = schemars::schema_for!(FleetFile);
    serde_json::to_string_pretty(&schema).map(|text| text + "\n").unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_matching_pattern_counts() {
        let text = "schema = 1\n[[aircraft]]\nflights = \"uav/may/*\"\nairframe = \"N1\"\nbaud = 115200\n\
                    [[aircraft]]\nflights = \"uav/*.bin\"\nairframe = \"N2\"\nserial = \"7\"\n";
        let fleet = Fleet::parse(text, Path::new("fleet.toml")).unwrap();
        let airframe = |flight: &str| fleet.of("uav", flight).and_then(|a| a.airframe.clone());
        assert_eq!(airframe("may/1.bin").as_deref(), Some("N1"));
        assert_eq!(airframe("june/day/1.bin").as_deref(), Some("N2"));
        assert_eq!(airframe("june/1.ulg"), None);
        assert_eq!(fleet.of("uav", "may/1.bin").unwrap().baud, Some(115_200));
    }

    #[test]
    fn a_star_matches_anything() {
        for (pattern, name, does) in [
            ("*", "", true),
            ("a*", "abc", true),
            ("a*c", "abbc", true),
            ("a*c", "ab", false),
            ("a*b*c", "a-b-b-c", true),
            ("ab", "ab", true),
            ("ab", "abc", false),
            ("ab*ba", "aba", false),
        ] {
            assert_eq!(matches(pattern, name), does, "{pattern} {name}");
        }
    }

    #[test]
    fn all_errors_are_reported_at_once_with_their_lines() {
        let text = "schema = 1\n[[aircraft]]\nflights = \"a/*\"\n[[aircraft]]\nflights = \"b/*\"\nairfarme = \"N2\"\n\
                    [[aircraft]]\nflights = \"c/*\"\nrate_hz = -5.0\n";
        let error = Fleet::parse(text, Path::new("fleet.toml")).unwrap_err().to_string();
        assert!(error.contains("fleet.toml:2: [[aircraft]] is empty"), "{error}");
        assert!(error.contains("fleet.toml:6: unknown key `airfarme`: did you mean `airframe`?"), "{error}");
        assert!(error.contains("fleet.toml:9: rate_hz must be more than 0 Hz"), "{error}");
    }

    #[test]
    fn the_example_is_a_valid_fleet() {
        let fleet = Fleet::parse(pipelines::EXAMPLE_FLEET, Path::new("fleet.toml")).unwrap();
        assert!(!fleet.aircraft.is_empty());
    }
}
