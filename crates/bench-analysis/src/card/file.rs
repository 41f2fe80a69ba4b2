//! The card as a TOML file: sensor, validity, channels, records, then the magnetometer.

use flight::Quantity;
use jiff::civil::Date;
use record::{CARD_VERSION, CardChannel, CardMagnetometer, CardSource, Finding, SensorCard, Verdict};
use serde::Serialize;
use settings::{Refused, SettingsError, SettingsFile};
use std::collections::BTreeSet;
use std::fmt::Write;
use std::path::Path;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Longest plausible delay, s; a larger number is a delay in milliseconds.
const LONGEST_DELAY_S: f64 = 10.0;

const HEAD: &str = "\
# Sensor card: what the bench found about one sensor. Written by `flightlag bench`, read by
# `flightlag campaign` with `[delay] card = \"...\"` in its pipeline.
# Times are in seconds. A positive delay is late: measured(t) = truth(t - delay).
# Uncertainties are standard uncertainties (k = 1).
";
const VALIDITY: &str = "\
# Last day on which something was measured, and the days on which the card may be used.
";
const ORIGIN: &str = "\
# How the numbers were found.
";
const CHANNEL: &str = "\
# One entry for each channel. `verdict` is delayed, early, equivalent-to-zero, inconclusive or not-measurable.
# `basis` says what the delay is measured against: one clock for all, a pulse per second, or an anchor channel.
# `gain` is the mean of the components that the swing moves. Where `lags_s` is not empty, it holds for the bench's swing
# only: the gain of a lag depends on the frequency. `slow_motion_delay_s` is delay and lags together: a campaign removes
# it. `contradicted` says why the delay is in doubt, such as a record that contradicts its rig file: do not use the
# channel until the cause is found.
";
const RECORD: &str = "\
# The records that were measured for this card; `records` of a channel says how many of them are in its mean.
";
const MAGNETOMETER: &str = "\
# Hard and soft iron: read = scale * soft_iron * field + hard_iron, in body axes forward, right, down. `cannot-tell` says why
# they are unknown, and in which azimuths to swing.
";

const SENSOR_KEYS: [&str; 5] = ["model", "serial", "firmware", "baud", "configuration"];
const VALIDITY_KEYS: [&str; 3] = ["measured_on", "valid_from", "valid_until"];
const ORIGIN_KEYS: [&str; 4] = ["rig", "method", "flightlag_version", "analysis_version"];
const CHANNEL_KEYS: [&str; 20] = [
    "name",
    "quantity",
    "verdict",
    "delay_s",
    "delay_standard_uncertainty_s",
    "as_seen_delay_s",
    "model",
    "lags_s",
    "lags_standard_uncertainty_s",
    "slow_motion_delay_s",
    "slow_motion_standard_uncertainty_s",
    "gain",
    "gain_standard_uncertainty",
    "update_rate_hz",
    "stamp_kind",
    "basis",
    "records",
    "between_runs_s",
    "outliers",
    "contradicted",
];
const RECORD_KEYS: [&str; 4] = ["files", "blake3", "date", "rig_blake3"];
const MAGNETOMETER_KEYS: [&str; 3] = ["channel", "unit", "azimuths_rad"];
const FINDING_KEYS: [&str; 2] = ["found", "cannot-tell"];
const IRON_KEYS: [&str; 9] = [
    "hard_iron",
    "hard_iron_standard_uncertainty",
    "soft_iron",
    "soft_iron_standard_uncertainty",
    "scale",
    "scale_standard_uncertainty",
    "residual_rms",
    "condition",
    "text",
];

/// The text of a card: [`parse_card`] returns the same card, bit by bit.
#[must_use]
pub fn card_text(card: &SensorCard) -> String {
    let whole = table_of(card);
    let sensor = table_of(&card.sensor);
    let mut text = format!("{HEAD}\ncard_version = {}\n\n", card.card_version);
    lines(&mut text, "sensor.", &sensor, &SENSOR_KEYS);
    if VALIDITY_KEYS.iter().any(|key| whole.contains_key(*key)) {
        let _ = write!(text, "\n{VALIDITY}");
        lines(&mut text, "", &whole, &VALIDITY_KEYS);
    }
    let _ = write!(text, "\n{ORIGIN}");
    lines(&mut text, "", &whole, &ORIGIN_KEYS);
    entries(&mut text, "channel", CHANNEL, &card.channels, &CHANNEL_KEYS);
    entries(&mut text, "record", RECORD, &card.records, &RECORD_KEYS);
    if let Some(magnetometer) = &card.magnetometer {
        let _ = write!(text, "\n{MAGNETOMETER}[magnetometer]\n");
        lines(&mut text, "", &table_of(magnetometer), &MAGNETOMETER_KEYS);
        match &magnetometer.iron {
            Finding::Found(iron) => lines(&mut text, "iron.found.", &table_of(iron), &IRON_KEYS),
            Finding::CannotTell(_) => lines(&mut text, "iron.", &table_of(&magnetometer.iron), &FINDING_KEYS),
        }
    }
    text
}

/// A struct as a table; these types have text keys and cannot fail.
fn table_of(value: &impl Serialize) -> toml::Table {
    toml::Table::try_from(value).unwrap_or_default()
}

fn lines(text: &mut String, prefix: &str, table: &toml::Table, keys: &[&str]) {
    for (key, value) in keys.iter().filter_map(|key| table.get_key_value(*key)) {
        let _ = writeln!(text, "{prefix}{key} = {value}");
    }
}

fn entries(text: &mut String, name: &str, comment: &str, entries: &[impl Serialize], keys: &[&str]) {
    let _ = write!(text, "\n{comment}");
    if entries.is_empty() {
        let _ = writeln!(text, "{name} = []");
    }
    for (i, entry) in entries.iter().enumerate() {
        let _ = writeln!(text, "{}[[{name}]]", if i == 0 { "" } else { "\n" });
        lines(text, "", &table_of(entry), keys);
    }
}

/// Reads a card from `text`; `path` is used in errors.
///
/// # Errors
/// [`SettingsError`] with the line: invalid TOML, another layout, an unknown key, a number that is not finite, a negative
/// uncertainty, a delay that must be in milliseconds, an invalid day, a validity that ends before it starts, or a
/// duplicate channel.
pub fn parse_card(text: &str, path: &Path) -> Result<SensorCard, SettingsError> {
    let file = SettingsFile::new(text, path);
    file.finish(Checker { file: &file }.card())
}

/// The JSON schema of a sensor card, as text.
#[cfg(feature = "schema")]
#[must_use]
pub fn card_schema() -> String {
    let schema = schemars::schema_for!(SensorCard);
    format!("{:#}\n", schema.as_value())
}

type Place<'a> = Spanned<DeValue<'a>>;

fn get<'a, 'b>(table: &'b DeTable<'a>, key: &str) -> Option<&'b Place<'a>> {
    table.iter().find(|(k, _)| k.get_ref() == key).map(|(_, value)| value)
}

/// The value of `key` in a table, or the whole table if the key is missing.
fn part<'a, 'b>(place: &'b Place<'a>, key: &str) -> &'b Place<'a> {
    place.get_ref().as_table().and_then(|table| get(table, key)).unwrap_or(place)
}

/// The entries of an array of tables.
fn items<'a, 'b>(table: &'b DeTable<'a>, key: &str) -> impl Iterator<Item = &'b Place<'a>> {
    let array = get(table, key).and_then(|value| value.get_ref().as_array());
    array.into_iter().flat_map(|array| array.iter())
}

/// Holds the file, so that every error has its line.
struct Checker<'a> {
    file: &'a SettingsFile<'a>,
}

impl Checker<'_> {
    fn card(&self) -> Result<SensorCard, Refused> {
        let table = self.file.table()?;
        let table = table.get_ref();
        self.version(table)?;
        let card: SensorCard = self.file.read()?;
        self.whole(table, &card);
        for (place, channel) in items(table, "channel").zip(&card.channels) {
            self.channel(place, channel);
        }
        for (place, record) in items(table, "record").zip(&card.records) {
            self.record(place, record);
        }
        if let (Some(place), Some(magnetometer)) = (get(table, "magnetometer"), &card.magnetometer) {
            self.magnetometer(place, magnetometer);
        }
        self.each_channel_once(table, &card);
        Ok(card)
    }

    fn version(&self, table: &DeTable<'_>) -> Result<(), Refused> {
        let Some(place) = get(table, "card_version") else {
            return Err(self.file.reject_whole("missing key `card_version`: this is not a sensor card"));
        };
        let version = place.get_ref().as_integer().map(ToString::to_string);
        if version.as_deref() == Some(CARD_VERSION.to_string().as_str()) {
            return Ok(());
        }
        let what = format!("card_version must be {CARD_VERSION}, the only version that this flightlag knows");
        Err(self.file.reject(place, what))
    }

    fn whole(&self, table: &DeTable<'_>, card: &SensorCard) {
        if let Some(place) = get(table, "sensor").filter(|_| card.sensor.model.trim().is_empty()) {
            self.file.reject(place, "sensor.model must say which sensor this is");
        }
        let day = |key: &str, day: &Option<String>| self.day(get(table, key)?, key, day.as_deref()?);
        day("measured_on", &card.measured_on);
        let (from, until) = (day("valid_from", &card.valid_from), day("valid_until", &card.valid_until));
        if let (Some(from), Some(until), Some(place)) = (from, until, get(table, "valid_until"))
            && until < from
        {
            self.file.reject(place, format!("valid_until = {until} lies before valid_from = {from}"));
        }
    }

    fn day(&self, place: &Place<'_>, key: &str, text: &str) -> Option<Date> {
        let day = text.parse::<Date>();
        if day.is_err() {
            self.file.reject(place, format!("{key} = \"{text}\" is not a date such as \"2026-05-04\""));
        }
        day.ok()
    }

    fn channel(&self, place: &Place<'_>, channel: &CardChannel) {
        let at = |key: &str| part(place, key);
        self.numbers(place, channel);
        if channel.name.trim().is_empty() {
            self.file.reject(at("name"), "a channel must have a name, such as `position.gps`");
        }
        let contradicts = match channel.verdict {
            Verdict::Delayed => channel.delay_s <= 0.0,
            Verdict::Early => channel.delay_s >= 0.0,
            _ => false,
        };
        if contradicts {
            let what = "the verdict contradicts the sign of delay_s: positive is late";
            self.file.reject(at("verdict"), format!("channel `{}`: {what}", channel.name));
        }
        self.quantity(at("quantity"), channel);
    }

    fn numbers(&self, place: &Place<'_>, channel: &CardChannel) {
        let check = |key: &str, value: Option<f64>, fits: fn(f64) -> bool, must: &str| {
            if let Some(v) = value.filter(|&v| !(v.is_finite() && fits(v))) {
                let what = format!("channel `{}`: {key} = {v}: must be {must}", channel.name);
                self.file.reject(part(place, key), what);
            }
        };
        let delay = |key: &str, value: Option<f64>| {
            check(key, value, |v| v.abs() <= LONGEST_DELAY_S, "finite, in seconds, from -10 to 10");
        };
        let size = |key: &str, value: Option<f64>| check(key, value, |v| v >= 0.0, "finite and not negative");
        delay("delay_s", Some(channel.delay_s));
        delay("as_seen_delay_s", channel.as_seen_delay_s);
        delay("slow_motion_delay_s", channel.slow_motion_delay_s);
        size("delay_standard_uncertainty_s", Some(channel.delay_standard_uncertainty_s));
        check("gain", Some(channel.gain), |_| true, "finite");
        size("gain_standard_uncertainty", Some(channel.gain_standard_uncertainty));
        size("between_runs_s", channel.between_runs_s);
        check("update_rate_hz", channel.update_rate_hz, |v| v > 0.0, "finite and above zero");
        channel.lags_s.iter().for_each(|&lag| size("lags_s", Some(lag)));
        size("slow_motion_standard_uncertainty_s", channel.slow_motion_standard_uncertainty_s);
        channel.lags_standard_uncertainty_s.iter().for_each(|&u| size("lags_standard_uncertainty_s", Some(u)));
    }

    /// A position must hold a position: replay finds channels by name.
    fn quantity(&self, place: &Place<'_>, channel: &CardChannel) {
        let fits = match channel.name.split('.').next() {
            Some("position") => matches!(channel.quantity, Quantity::PositionGeodetic | Quantity::PositionNed),
            Some("velocity") => channel.quantity == Quantity::VelocityNed,
            _ => true,
        };
        if !fits {
            self.file.reject(place, format!("channel `{}` cannot hold this quantity", channel.name));
        }
    }

    fn record(&self, place: &Place<'_>, record: &CardSource) {
        if record.files.len() != record.blake3.len() {
            let (files, hashes) = (record.files.len(), record.blake3.len());
            self.file.reject(place, format!("a record has {files} files but {hashes} hashes"));
        }
        if let Some(date) = &record.date {
            self.day(part(place, "date"), "date", date);
        }
    }

    /// Numbers must be finite, uncertainties must not be negative.
    fn magnetometer(&self, place: &Place<'_>, magnetometer: &CardMagnetometer) {
        let Finding::Found(iron) = &magnetometer.iron else { return };
        let values = iron.soft_iron.iter().flatten().chain(&iron.hard_iron).chain(&iron.scale);
        let sizes = iron.soft_iron_standard_uncertainty.iter().flatten().chain(&iron.hard_iron_standard_uncertainty);
        let sizes = sizes.chain(&iron.scale_standard_uncertainty).chain([&iron.residual_rms, &iron.condition]);
        let azimuths = magnetometer.azimuths_rad.iter();
        if values.chain(azimuths).all(|v| v.is_finite()) && sizes.into_iter().all(|v| v.is_finite() && *v >= 0.0) {
            return;
        }
        self.file.reject(place, "magnetometer: every number must be finite, and no uncertainty negative");
    }

    fn each_channel_once(&self, table: &DeTable<'_>, card: &SensorCard) {
        let mut seen = BTreeSet::new();
        for (place, channel) in items(table, "channel").zip(&card.channels) {
            if !seen.insert(channel.name.as_str()) {
                self.file.reject(place, format!("channel `{}` is a duplicate", channel.name));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::card::example;

    fn refused(text: &str) -> SettingsError {
        parse_card(text, Path::new("cards/mtig.card.toml")).unwrap_err()
    }

    /// The line, from 1, that starts with `start`.
    fn line_of(text: &str, start: &str) -> usize {
        text.lines().position(|l| l.starts_with(start)).unwrap() + 1
    }

    #[test]
    fn a_card_survives_a_round_trip_through_text_bit_by_bit() {
        let mut card = example::card();
        card.channels[0].delay_s = 0.1 + 0.2;
        card.channels[1].delay_standard_uncertainty_s = f64::MIN_POSITIVE;
        let cannot_tell = CardMagnetometer {
            iron: Finding::CannotTell("swing at two more".into()),
            ..card.magnetometer.clone().unwrap()
        };
        for magnetometer in [card.magnetometer.clone(), Some(cannot_tell), None] {
            let card = SensorCard { magnetometer, ..card.clone() };
            assert_eq!(parse_card(&card_text(&card), Path::new("c")).unwrap(), card);
        }
    }

    #[test]
    fn a_card_lists_identity_validity_channels_and_records_in_order() {
        let text = card_text(&example::card());
        let starts = ["card_version", "sensor.model", "measured_on", "valid_until", "rig", "[[channel]]", "[[record]]"];
        let lines: Vec<usize> = starts.iter().map(|s| line_of(&text, s)).collect();
        assert!(lines.is_sorted(), "{lines:?}\n{text}");
        assert!(text.contains("basis = { basis = \"one-clock\" }"), "{text}");
    }

    #[test]
    fn the_text_contains_every_key_of_a_card() {
        let card = example::card();
        let full = CardChannel {
            as_seen_delay_s: Some(0.5),
            between_runs_s: Some(0.001),
            outliers: vec!["r".into()],
            lags_standard_uncertainty_s: vec![0.01],
            slow_motion_delay_s: Some(0.6),
            slow_motion_standard_uncertainty_s: Some(0.02),
            contradicted: vec!["r: encoder sign".into()],
            ..card.channels[0].clone()
        };
        let of = |table: toml::Table| table.keys().cloned().collect::<BTreeSet<String>>();
        let listed = |keys: &[&str]| keys.iter().map(|&k| k.to_owned()).collect::<BTreeSet<String>>();
        assert_eq!(of(table_of(&full)), listed(&CHANNEL_KEYS));
        assert_eq!(of(table_of(&card.records[0])), listed(&RECORD_KEYS));
        let sensor = record::SensorIdentity { configuration: Some("GPS".into()), ..card.sensor.clone() };
        assert_eq!(of(table_of(&sensor)), listed(&SENSOR_KEYS));
        let magnetometer = card.magnetometer.clone().unwrap();
        let mut keys = listed(&MAGNETOMETER_KEYS);
        keys.insert("iron".to_owned());
        assert_eq!(of(table_of(&magnetometer)), keys);
        assert_eq!(of(table_of(magnetometer.iron.found().unwrap())), listed(&IRON_KEYS));
        let mut whole = listed(&["card_version", "sensor", "channel", "record", "magnetometer"]);
        whole.extend(listed(&VALIDITY_KEYS).into_iter().chain(listed(&ORIGIN_KEYS)));
        assert_eq!(of(table_of(&card)), whole);
    }

    /// Replacements in the example, the line of the resulting error, and its text.
    const NONSENSE: [(&str, &str, &str, &str); 18] = [
        ("card_version = 1", "card_version = 2", "card_version", "only version"),
        ("delay_s = 0.4\n", "delay_s = nan\n", "delay_s", "finite"),
        ("delay_s = 0.4\n", "delay_s = 400.0\n", "delay_s", "in seconds"),
        ("delay_s = 0.4\n", "delay_s = -0.4\n", "verdict", "positive is late"),
        ("gain = 1.001", "gain = inf", "gain", "finite"),
        ("_uncertainty_s = 0.002", "_uncertainty_s = -0.002", "delay_standard", "not negative"),
        ("update_rate_hz = 4.0", "update_rate_hz = 0.0", "update_rate_hz", "above zero"),
        ("lags_s = []", "lags_s = [-0.1]", "lags_s", "not negative"),
        ("measured_on = \"2010-10-25\"", "measured_on = \"2010-13-25\"", "measured_on", "is not a date"),
        ("valid_until = \"2011-10-25\"", "valid_until = \"2009-10-25\"", "valid_until", "before valid_from"),
        ("valid_until", "valid_untill", "valid_until", "unknown key `valid_untill`"),
        ("sensor.serial", "sensor.seriel", "sensor.serial", "unknown key `seriel`"),
        ("sensor.model = \"Xsens MTi-G\"", "sensor.model = \" \"", "sensor.model", "which sensor"),
        ("quantity = \"position-geodetic\"", "quantity = \"scalar\"", "quantity", "cannot hold"),
        ("date = \"2010-10-25\"", "date = \"soon\"", "date", "is not a date"),
        ("files = [\"a.csv\"]", "files = []", "[[record]]", "hashes"),
        ("iron.found.scale = 1.01", "iron.found.scales = 1.01", "iron.found.scale", "unknown key `scales`"),
        ("residual_rms = 0.0000002", "residual_rms = -0.1", "[magnetometer]", "negative"),
    ];

    #[test]
    fn nonsense_is_rejected_with_its_line() {
        let text = card_text(&example::card());
        for (was, is, line, says) in NONSENSE {
            let changed = text.replacen(was, is, 1);
            assert_ne!(changed, text, "{was}");
            let error = refused(&changed);
            assert_eq!(error.line, Some(line_of(&text, line)), "{was} -> {is}: {error}");
            assert!(error.what.contains(says), "{was} -> {is}: {error}");
        }
    }

    #[test]
    fn all_errors_of_a_card_are_reported_at_once() {
        let text = card_text(&example::card())
            .replacen("measured_on = \"2010-10-25\"", "measured_on = \"2010-13-25\"", 1)
            .replacen("delay_s = 0.4\n", "delay_s = 400.0\n", 1)
            .replacen("gain = 1.001", "gain = \"1\"", 1)
            .replacen("sensor.serial", "sensor.seriel", 1);
        let error = refused(&text).to_string();
        let lines: Vec<&str> = error.lines().collect();
        let says = [
            "`seriel`: did you mean `serial`?",
            "is not a date",
            "delay_s = 400: must be",
            "channel.gain = \"1\": must be a number",
        ];
        assert_eq!(lines.len(), says.len(), "{error}");
        assert!(lines.iter().zip(says).all(|(line, says)| line.contains(says)), "{error}");
    }

    #[test]
    fn a_duplicate_channel_is_rejected_at_its_second_entry() {
        let text =
            card_text(&example::card()).replace("velocity.ins", "position.gps").replace("velocity-ned", "position-ned");
        let second = text.match_indices("[[channel]]").nth(1).unwrap().0;
        let line = text[..second].lines().count() + 1;
        let error = refused(&text);
        assert_eq!((error.line, error.what.as_str()), (Some(line), "channel `position.gps` is a duplicate"));
    }

    #[test]
    fn an_error_names_the_file_and_the_line() {
        let error = refused("card_version = 1\nsensor = 3\n");
        let text = error.to_string();
        assert!(text.starts_with("cards/mtig.card.toml:1: missing key `rig`\n"), "{text}");
        assert!(text.contains("\ncards/mtig.card.toml:1: missing key `method`\n"), "{text}");
        assert!(text.contains("\ncards/mtig.card.toml:2: sensor = 3: must be a table"), "{text}");
        assert!(refused("x = 1\n").to_string().contains("not a sensor card"));
    }
}
