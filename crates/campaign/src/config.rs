//! The pipeline file: as the user wrote it, then resolved (defaults filled in).
//!
//! [`Pipeline::read`] turns a TOML file into complete, checked settings.
//! The resolved settings, not the text, name the results: a comment or a default spelled out
//! changes nothing.

use crate::answer::compensated_pair;
use crate::cards::{CardFile, Pin, Shelf, UsedCard, chosen};
use crate::criteria::Criteria;
use crate::delay::{Case, Decided, DelayRule, FixedDelay, Known, measured_pair};
use crate::error::CampaignError;
use crate::lever::Antenna;
use crate::reference_rule::ReferenceRule;
use compensation_replay::{
    ClockRule, CompensatorKind, REFERENCE_POSITION, REFERENCE_VELOCITY, Settings, Sweeper, pick_pair,
};
use delay_from_flight::FlightDelaySettings;
use flight::{Binding, Delay, Flight};
use record::{
    CardDelay, Decision, DelaySource, Estimate, Finding, FlightDelays, FlightLateness, PipelineUse, SensorIdentity,
    StartRule,
};
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize, Serializer};
use settings::{Refused, SettingsError, SettingsFile, plain_zero};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use toml::Spanned;

/// The default pipeline: `pipelines/default.toml`, compiled in.
pub const DEFAULT_PIPELINE: &str = pipelines::DEFAULT_PIPELINE;

/// The pipeline of the simulated campaign: `pipelines/demo.toml`, compiled in.
pub const DEMO_PIPELINE: &str = pipelines::DEMO_PIPELINE;

/// Longest delay accepted and searched for, s; a larger number is a delay in milliseconds.
const LONGEST_DELAY_S: f64 = 30.0;

/// Default search range of delays, s.
const DEFAULT_SEARCH_S: [f64; 2] = [-2.5, 13.0];
/// Widest search range, s.
const LONGEST_SEARCH_S: f64 = 60.0;

/// Provisional delay until the delay is known, s: velocity gaps are bridged as for the paper's receiver.
const PROVISIONAL_S: f64 = 0.4;

/// Source of a number for which the pipeline states none.
const NO_SOURCE: &str = "set in the pipeline, which states no source";

/// A pipeline as the user wrote it.
#[derive(Debug, Clone, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "schema", schemars(title = "flightlag pipeline"))]
struct Written {
    /// Version of this file's layout: 1.
    #[cfg_attr(feature = "schema", schemars(with = "u32", range(min = 1, max = 1)))]
    schema: Spanned<u32>,
    /// Title of the campaign on its pages.
    #[serde(default = "default_title")]
    title: String,
    /// The delay to remove. Default: the one measured from the flights themselves (`from = "network"`).
    #[cfg_attr(feature = "schema", schemars(with = "Option<WrittenDelay>"))]
    delay: Option<Spanned<WrittenDelay>>,
    /// Settings of the measurement of delays.
    #[serde(default)]
    measure: WrittenMeasure,
    /// The sensor of these flights, used to find its card.
    #[cfg_attr(feature = "schema", schemars(with = "Option<SensorIdentity>"))]
    sensor: Option<Spanned<SensorIdentity>>,
    /// Channels of a flight: the first of each list that the flight has is used.
    #[serde(default)]
    channels: WrittenChannels,
    /// Second file of each flight, with a reference or a velocity; without `file`, the clock of the reference in the log.
    #[cfg_attr(feature = "schema", schemars(with = "Option<WrittenReference>"))]
    reference: Option<Spanned<WrittenReference>>,
    /// Settings of the compensators.
    #[serde(default)]
    replay: WrittenReplay,
    /// Sources of channel maps.
    #[serde(default)]
    maps: WrittenMaps,
    /// Acceptance criteria of flights.
    criteria: Option<WrittenCriteria>,
}

#[derive(Debug, Clone, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
struct WrittenCriteria {
    /// Criteria file, relative to this file; `--criteria` overrides it.
    #[cfg_attr(feature = "schema", schemars(with = "PathBuf"))]
    file: Spanned<PathBuf>,
}

#[derive(Debug, Clone, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
struct WrittenReference {
    /// The second file, relative to the folder of the flight's log. `{stem}` is the log's file name without its
    /// extension, `*` matches anything: `{stem}.pos`, `{stem}_*.csv`.
    #[cfg_attr(feature = "schema", schemars(with = "Option<String>"))]
    file: Option<Spanned<String>>,
    /// Relation of its clock to the clock of the log: `auto` (two files with UTC or GPS time share a clock; for others
    /// the offset is estimated), `same`, or `own` (the offset is estimated). Default: auto. Without a file only `same`: the
    /// reference in the log is on time, and lateness is measured against it.
    #[serde(default)]
    #[cfg_attr(feature = "schema", schemars(with = "WrittenClock"))]
    clock: ClockRule,
}

/// Relation of the clock of a reference file to the clock of the log.
#[cfg(feature = "schema")]
#[derive(JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[expect(dead_code, reason = "for the schema of ClockRule")]
enum WrittenClock {
    Auto,
    Same,
    Own,
}

#[derive(Debug, Clone, Default, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
struct WrittenMeasure {
    /// Search range of delays, first and last, s; widened when the best delay lies at the edge. Default: -2.5 and 13.
    #[cfg_attr(feature = "schema", schemars(with = "Option<[f64; 2]>"))]
    search_s: Option<Spanned<[f64; 2]>>,
    /// Distance of the antenna ahead of the point where velocity is measured, m; negative is aft. It shifts the delay
    /// by about -1/speed per metre. Default: from the parameters in the log, otherwise unknown.
    #[cfg_attr(feature = "schema", schemars(with = "Option<f64>", range(min = -100.0, max = 100.0)))]
    antenna_ahead_m: Option<Spanned<f64>>,
    /// Standard uncertainty of the antenna position, m; it increases that of the delay. Default: 0.
    #[cfg_attr(feature = "schema", schemars(with = "Option<f64>", range(min = 0.0, max = 100.0)))]
    antenna_uncertainty_m: Option<Spanned<f64>>,
}

#[derive(Debug, Clone, Default, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
struct WrittenDelay {
    /// Delay to remove. Default: fixed with `position_s`, card with `card` or `cards`, otherwise network. Fallback for
    /// a flight without its own delay: the card if one is given, then `position_s`; otherwise nothing is removed.
    #[cfg_attr(feature = "schema", schemars(with = "Option<WrittenFrom>"))]
    from: Option<Spanned<WrittenFrom>>,
    /// Lateness of position against velocity, s; positive means late.
    #[cfg_attr(feature = "schema", schemars(with = "Option<f64>", extend("exclusiveMinimum" = 0.0), range(max = 30.0)))]
    position_s: Option<Spanned<f64>>,
    /// With `position_s`: its standard uncertainty (k = 1), s; omit if unknown.
    #[cfg_attr(feature = "schema", schemars(with = "Option<f64>"))]
    standard_uncertainty_s: Option<Spanned<f64>>,
    /// With `position_s`: source of the number, as text; printed on every page.
    #[cfg_attr(feature = "schema", schemars(with = "Option<String>"))]
    source: Option<Spanned<String>>,
    /// Sensor card of `flightlag bench` that holds the delay, relative to this file.
    #[cfg_attr(feature = "schema", schemars(with = "Option<PathBuf>"))]
    card: Option<Spanned<PathBuf>>,
    /// Folder of sensor cards (`*.card.toml`), relative to this file: cards of `[sensor]` are used, and each flight
    /// takes the card that is valid on its day.
    #[cfg_attr(feature = "schema", schemars(with = "Option<PathBuf>"))]
    cards: Option<Spanned<PathBuf>>,
    /// Cards that must be found, each with exactly this content.
    #[cfg_attr(feature = "schema", schemars(with = "Option<Vec<Pin>>"))]
    pin: Option<Spanned<Vec<Pin>>>,
}

/// Delay to remove.
#[derive(Debug, Clone, Copy, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
enum WrittenFrom {
    /// Lateness of the position: the mean of the other flights of its group, otherwise the flight's own delay network.
    Network,
    /// `position_s`.
    Fixed,
    /// The sensor card.
    Card,
    /// Each flight's own measurement: position against the integral of velocity. Ignores the lateness of the velocity.
    #[serde(alias = "pair")]
    Flight,
    /// The optimum of each flight's delay sweep: the smallest error against its reference, if it has one.
    Sweep,
}

impl From<WrittenFrom> for DelaySource {
    fn from(written: WrittenFrom) -> DelaySource {
        match written {
            WrittenFrom::Network => DelaySource::Network,
            WrittenFrom::Fixed => DelaySource::Fixed,
            WrittenFrom::Card => DelaySource::Card,
            WrittenFrom::Flight => DelaySource::Flight,
            WrittenFrom::Sweep => DelaySource::Sweep,
        }
    }
}

/// Best first.
const DEFAULT_POSITIONS: [&str; 11] = [
    "position.gps",
    "position.ins",
    "position.ekf",
    "position.precise",
    "position.precise-ecef",
    "position.posllh",
    "position.sol",
    "position.posecef",
    "position.hnr",
    "position.nav2",
    "position.ekf-global",
];
/// Best first.
const DEFAULT_VELOCITIES: [&str; 12] = [
    "velocity.ekf",
    "velocity.ins",
    "velocity.plain",
    "velocity.gps",
    "velocity.xyz",
    "velocity.velned",
    "velocity.sol",
    "velocity.pubx",
    "velocity.vtg",
    "velocity.hnr",
    "velocity.nav2",
    "velocity.ekf-global",
];

#[derive(Debug, Clone, Default, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
struct WrittenChannels {
    /// Late position, best first. Default: position.gps, position.ins, position.ekf, position.precise,
    /// position.precise-ecef, position.posllh, position.sol, position.posecef, position.hnr, position.nav2,
    /// position.ekf-global.
    #[cfg_attr(feature = "schema", schemars(with = "Option<Vec<String>>"))]
    position: Option<Spanned<Vec<String>>>,
    /// Velocity on time, best first. Default: velocity.ekf, velocity.ins, velocity.plain, velocity.gps, velocity.xyz,
    /// velocity.velned, velocity.sol, velocity.pubx, velocity.vtg, velocity.hnr, velocity.nav2, velocity.ekf-global.
    #[cfg_attr(feature = "schema", schemars(with = "Option<Vec<String>>"))]
    velocity: Option<Spanned<Vec<String>>>,
    /// Independent position to score against. Default: position.truth.
    #[cfg_attr(feature = "schema", schemars(with = "Option<Vec<String>>"))]
    reference: Option<Spanned<Vec<String>>>,
    /// Compensated position that the aircraft computed in flight. Default: position.compensated.
    #[cfg_attr(feature = "schema", schemars(with = "Option<Vec<String>>"))]
    onboard: Option<Spanned<Vec<String>>>,
}

#[derive(Debug, Clone, Default, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
struct WrittenReplay {
    /// Assumption of a compensator before its first sample. Default: warm.
    start: Option<StartRule>,
    /// Longest velocity gap that is bridged, s. Default: two delays, and at least 2.5 velocity intervals.
    #[cfg_attr(feature = "schema", schemars(with = "Option<f64>", range(min = 0.0, max = 600.0)))]
    bridge_s: Option<Spanned<f64>>,
    /// Minimum ground speed, m/s: flights that never exceed it are not replayed. Default: 0.5.
    #[cfg_attr(feature = "schema", schemars(with = "Option<f64>", range(min = 0.0)))]
    min_speed_mps: Option<Spanned<f64>>,
    /// Length of the zoom on the hardest manoeuvre, s. Default: 20.
    #[cfg_attr(feature = "schema", schemars(with = "Option<f64>"))]
    zoom_s: Option<Spanned<f64>>,
    /// Output rate, Hz. Default: one row per velocity sample.
    #[cfg_attr(feature = "schema", schemars(with = "Option<f64>"))]
    output_rate_hz: Option<Spanned<f64>>,
    /// Maximum samples per channel; above it, neighbouring samples are averaged. 500000 take about 100 MB. Default:
    /// 500000.
    #[cfg_attr(feature = "schema", schemars(with = "Option<u64>", range(min = 1000)))]
    most_samples: Option<Spanned<f64>>,
    /// Compensators in addition to those that always run (raw, pade-1-1-tustin, the same corrected for the age of held
    /// fixes, exact-async): pade-M-N-tustin, pade-M-N-foh, pade-M-N-zoh, exact-fir, kalman, and as bounds the
    /// non-causal offline-shift and rts-smoother. All are in the tables and the track, the first two in the figures.
    /// Default: none.
    #[cfg_attr(feature = "schema", schemars(with = "Option<Vec<String>>"))]
    compensators: Option<Vec<Spanned<String>>>,
}

#[derive(Debug, Clone, Default, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
struct WrittenMaps {
    /// Folder with more channel maps, relative to this file.
    folder: Option<PathBuf>,
    /// Name of the map for every flight; omit to select it by the content of each log.
    force: Option<String>,
}

fn default_title() -> String {
    "Flight campaign".to_owned()
}

/// A resolved pipeline (defaults filled in), in the layout of the file.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Resolved {
    schema: u32,
    title: String,
    delay: ResolvedDelay,
    measure: ResolvedMeasure,
    #[serde(skip_serializing_if = "Option::is_none")]
    sensor: Option<SensorIdentity>,
    channels: ResolvedChannels,
    #[serde(skip_serializing_if = "Option::is_none")]
    reference: Option<ResolvedReference>,
    replay: ResolvedReplay,
    maps: ResolvedMaps,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
enum ResolvedReference {
    File(ReferenceRule),
    /// The reference in the log itself; its clock is [`ClockRule::Same`].
    InLog {
        clock: ClockRule,
    },
}

impl ResolvedReference {
    fn clock(&self) -> ClockRule {
        match self {
            ResolvedReference::File(rule) => rule.clock,
            ResolvedReference::InLog { clock } => *clock,
        }
    }
}

#[derive(Debug, Clone, Default, PartialEq, Serialize)]
struct ResolvedDelay {
    /// Always written: a comparison of two pipelines names it.
    from: Option<DelaySource>,
    #[serde(skip_serializing_if = "Option::is_none")]
    position_s: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    standard_uncertainty_s: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    source: Option<String>,
    /// File name without the folder: the content of a card is part of the settings, its location is not.
    #[serde(skip_serializing_if = "Option::is_none")]
    card: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    cards: Option<String>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pin: Vec<Pin>,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
struct ResolvedMeasure {
    search_s: [f64; 2],
    #[serde(skip_serializing_if = "Option::is_none")]
    antenna_ahead_m: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    antenna_uncertainty_m: Option<f64>,
}

/// What a measurement depends on: the parts of [`Resolved`] that matter before a delay is removed.
#[derive(Debug, Serialize)]
struct MeasurePart<'a> {
    measure: &'a ResolvedMeasure,
    channels: &'a ResolvedChannels,
    #[serde(skip_serializing_if = "Option::is_none")]
    clock: Option<ClockRule>,
    maps: &'a ResolvedMaps,
    pin: &'a [Pin],
}

#[derive(Debug, Clone, PartialEq, Serialize)]
struct ResolvedChannels {
    position: Vec<String>,
    velocity: Vec<String>,
    reference: Vec<String>,
    onboard: Vec<String>,
}

impl ResolvedChannels {
    /// Adds the channels of a second file: the first reference, and the last velocity.
    fn with_reference_file(&mut self) {
        if self.reference.iter().all(|name| name != REFERENCE_POSITION) {
            self.reference.insert(0, REFERENCE_POSITION.to_owned());
        }
        if self.velocity.iter().all(|name| name != REFERENCE_VELOCITY) {
            self.velocity.push(REFERENCE_VELOCITY.to_owned());
        }
    }
}

#[derive(Debug, Clone, PartialEq, Serialize)]
struct ResolvedReplay {
    start: StartRule,
    #[serde(skip_serializing_if = "Option::is_none")]
    bridge_s: Option<f64>,
    min_speed_mps: f64,
    zoom_s: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    output_rate_hz: Option<f64>,
    most_samples: usize,
    /// Without those that always run: naming them changes nothing.
    #[serde(skip_serializing_if = "Vec::is_empty", serialize_with = "by_name")]
    compensators: Vec<CompensatorKind>,
}

fn by_name<S: Serializer>(kinds: &[CompensatorKind], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(kinds.iter().map(ToString::to_string))
}

#[derive(Debug, Clone, PartialEq, Serialize)]
struct ResolvedMaps {
    #[serde(skip_serializing_if = "Option::is_none")]
    force: Option<String>,
}

/// Settings of a campaign, checked and complete.
#[derive(Debug, Clone, PartialEq)]
pub struct Pipeline {
    resolved: Resolved,
    delay: DelayRule,
    maps_folder: Option<PathBuf>,
    criteria: Option<Criteria>,
    file_name: String,
    /// Channels that the file names, with the line of their list.
    channel_lines: Vec<(String, usize)>,
}

impl Pipeline {
    /// Reads a pipeline file.
    ///
    /// # Errors
    /// The file cannot be read, is not TOML, has an unknown key, or a value makes no sense; with file and line.
    pub fn read(path: &Path) -> Result<Pipeline, SettingsError> {
        Pipeline::parse(&settings::read_text(path)?, path)
    }

    /// The default pipeline.
    ///
    /// # Errors
    /// Never in a tested build: the text is compiled in, and a test reads it.
    pub fn shipped_default() -> Result<Pipeline, SettingsError> {
        Pipeline::parse(DEFAULT_PIPELINE, Path::new("default.toml"))
    }

    /// Reads a pipeline from `text`, and its sensor cards; `path` is for errors and for paths relative to the file.
    ///
    /// # Errors
    /// As [`Pipeline::read`].
    pub fn parse(text: &str, path: &Path) -> Result<Pipeline, SettingsError> {
        Pipeline::parse_with(text, path, Shelf::Disk)
    }

    /// A pipeline from a manifest, which also holds its cards: no files are read.
    pub(crate) fn of_manifest(text: &str, cards: &[CardFile]) -> Result<Pipeline, SettingsError> {
        Pipeline::parse_with(text, Path::new("manifest"), Shelf::Manifest(cards))
    }

    fn parse_with(text: &str, path: &Path, shelf: Shelf<'_>) -> Result<Pipeline, SettingsError> {
        let file = SettingsFile::new(text, path);
        let resolved = file.read().and_then(|written| Checker { file: &file, path, shelf }.resolve(written));
        file.finish(resolved)
    }

    /// The same pipeline with another map forced on every flight.
    #[must_use]
    pub fn with_forced_map(mut self, name: Option<String>) -> Pipeline {
        self.resolved.maps.force = name.or(self.resolved.maps.force);
        self
    }

    /// The same pipeline with another folder of channel maps.
    #[must_use]
    pub fn with_maps_folder(mut self, folder: Option<PathBuf>) -> Pipeline {
        self.maps_folder = folder.or(self.maps_folder);
        self
    }

    /// The same pipeline with other criteria.
    #[must_use]
    pub fn with_criteria(mut self, criteria: Option<Criteria>) -> Pipeline {
        self.criteria = criteria.or(self.criteria);
        self
    }

    /// Criteria that flights are judged by. Not part of the settings' hash: another limit changes no result.
    #[must_use]
    pub fn criteria(&self) -> Option<&Criteria> {
        self.criteria.as_ref()
    }

    /// Folder with further channel maps. The content of the maps is part of a result's key, the folder is not.
    #[must_use]
    pub fn maps_folder(&self) -> Option<&Path> {
        self.maps_folder.as_deref()
    }

    /// Name of the file without its folder.
    #[must_use]
    pub fn file_name(&self) -> &str {
        &self.file_name
    }

    /// Name of the map forced on every flight.
    #[must_use]
    pub fn forced_map(&self) -> Option<&str> {
        self.resolved.maps.force.as_deref()
    }

    /// The settings for a record: title, hash and text of the resolved pipeline.
    #[must_use]
    pub fn as_used(&self) -> PipelineUse {
        let toml = toml::to_string(&self.resolved).unwrap_or_else(|e| format!("# cannot be written: {e}\n"));
        PipelineUse {
            title: self.resolved.title.clone(),
            blake3: blake3::hash(toml.as_bytes()).to_hex().to_string(),
            toml,
        }
    }

    /// The sensor cards that provide delays.
    pub(crate) fn card_files(&self) -> Vec<CardFile> {
        self.delay.cards.iter().map(UsedCard::file).collect()
    }

    /// Names of all channels in the settings.
    pub(crate) fn channel_names(&self) -> impl Iterator<Item = &str> {
        let ResolvedChannels { position, velocity, reference, onboard } = &self.resolved.channels;
        position.iter().chain(velocity).chain(reference).chain(onboard).map(String::as_str)
    }

    /// Line of the list that names a channel in the file; `None` for a default.
    pub(crate) fn line_of_channel(&self, name: &str) -> Option<usize> {
        self.channel_lines.iter().find(|(known, _)| known == name).map(|(_, line)| *line)
    }

    /// Hash of the settings that a result depends on: all except the title.
    pub(crate) fn replay_blake3(&self) -> String {
        let untitled = Resolved { title: String::new(), ..self.resolved.clone() };
        blake3::hash(toml::to_string(&untitled).unwrap_or_default().as_bytes()).to_hex().to_string()
    }

    /// Hash of the settings that a measurement depends on.
    pub(crate) fn measure_blake3(&self) -> String {
        let Resolved { measure, channels, maps, delay, reference, .. } = &self.resolved;
        // The file itself is part of the flight's content.
        let clock = reference.as_ref().map(ResolvedReference::clock);
        let part = MeasurePart { measure, channels, clock, maps, pin: &delay.pin };
        blake3::hash(toml::to_string(&part).unwrap_or_default().as_bytes()).to_hex().to_string()
    }

    /// Settings of the measurement of delays.
    pub(crate) fn measure_settings(&self) -> FlightDelaySettings {
        let ResolvedMeasure { search_s: [from, to], .. } = self.resolved.measure;
        FlightDelaySettings { search_s: (from, to), ..FlightDelaySettings::default() }
    }

    /// Position of the antenna.
    pub(crate) fn antenna(&self) -> Antenna {
        let ResolvedMeasure { antenna_ahead_m, antenna_uncertainty_m, .. } = self.resolved.measure;
        Antenna { ahead_m: antenna_ahead_m, uncertainty_m: antenna_uncertainty_m }
    }

    /// Names of the position and of the velocity, best first.
    pub(crate) fn position_and_velocity(&self) -> (&[String], &[String]) {
        (&self.resolved.channels.position, &self.resolved.channels.velocity)
    }

    /// Names of the reference, best first.
    pub(crate) fn reference(&self) -> &[String] {
        &self.resolved.channels.reference
    }

    /// The same pipeline with a second file for each flight: a path, or a pattern relative to the flight's folder. With
    /// [`ClockRule::Same`] and no file, the reference in the log is on time.
    ///
    /// # Errors
    /// Another clock rule is given, but no second file.
    pub fn with_reference(mut self, file: Option<String>, clock: Option<ClockRule>) -> Result<Pipeline, CampaignError> {
        let known = self.resolved.reference.take();
        let clock = clock.or(known.as_ref().map(ResolvedReference::clock));
        let known_file = known.and_then(|reference| match reference {
            ResolvedReference::File(rule) => Some(rule.file),
            ResolvedReference::InLog { .. } => None,
        });
        self.resolved.reference = match (file.or(known_file), clock) {
            (Some(file), _) => Some(ResolvedReference::File(ReferenceRule { file, clock: clock.unwrap_or_default() })),
            (None, None) => None,
            (None, Some(clock @ ClockRule::Same)) => Some(ResolvedReference::InLog { clock }),
            (None, Some(_)) => {
                let what = "--reference-clock needs --reference FILE, unless it is `same`: then the reference in the log is \
                            on time";
                return Err(CampaignError::Asked(what.to_owned()));
            }
        };
        if self.reference_file().is_some() {
            self.resolved.channels.with_reference_file();
        }
        Ok(self)
    }

    /// Where the second file of each flight is.
    pub(crate) fn reference_file(&self) -> Option<&ReferenceRule> {
        match &self.resolved.reference {
            Some(ResolvedReference::File(rule)) => Some(rule),
            Some(ResolvedReference::InLog { .. }) | None => None,
        }
    }

    /// Whether the reference in the log is on time, so that lateness is measured against it.
    pub(crate) fn log_reference_is_on_time(&self) -> bool {
        matches!(self.resolved.reference, Some(ResolvedReference::InLog { .. }))
    }

    /// The requested source of the delay.
    pub(crate) fn asked(&self) -> DelaySource {
        self.delay.from
    }

    /// The stated delay, s.
    pub(crate) fn stated(&self) -> Option<Estimate> {
        let fixed = self.delay.fixed.as_ref()?;
        Some(Estimate { value: fixed.delay.seconds(), standard_uncertainty: fixed.standard_uncertainty_s })
    }

    /// The sensor card's delay for a flight; `None` if the pipeline names no card or the flight lacks a channel.
    pub(crate) fn card_delay(&self, flight: &Flight, binding: &Binding) -> Option<Finding<CardDelay>> {
        let (position, velocity) = self.position_and_velocity();
        let [position, velocity] = pick_pair(flight, position, velocity).ok()?;
        self.delay.card_delay(&Case { flight, binding, position, velocity })
    }

    /// The replay settings of one flight, with the decided delay. Notices report doubts about it.
    ///
    /// # Errors
    /// Why nothing is removed from this flight.
    pub(crate) fn settings_for(&self, case: &FlightCase<'_>) -> Result<(Settings, Decided), String> {
        let ResolvedChannels { position, velocity, .. } = &self.resolved.channels;
        let [position, velocity] = pick_pair(case.flight, position, velocity).map_err(|refusal| refusal.to_string())?;
        let measured = measured_pair(case.delays, position.0, velocity.0);
        let best = || match Sweeper::of(case.flight, &self.provisional()) {
            Ok(sweeper) => sweeper.best(&measured),
            Err(refusal) => Finding::CannotTell(refusal.to_string()),
        };
        let decided = self.delay.chosen(
            &Case { flight: case.flight, binding: case.binding, position, velocity },
            &Known { decision: case.decision, lateness: case.lateness, measured: &measured },
            best,
        )?;
        let settings = Settings {
            delay_uncertainty_s: decided.found.standard_uncertainty_s,
            delay_source: decided.found.source.clone(),
            card: decided.found.card.clone(),
            position_minus_velocity_s: case.lateness.position_minus_velocity_s,
            position_lateness_s: crate::known_lateness::known(case.lateness, case.decision)
                .map(|known| known.lateness_s),
            velocity_lateness_s: crate::known_lateness::velocity_lateness_s(case.lateness, case.decision),
            ..self.settings(decided.found.delay)
        };
        // Motion sufficient to measure a delay is sufficient to remove one.
        let settings = match case.lateness.position_minus_velocity_s.is_some() {
            true => Settings { min_speed_mps: 0.0, ..settings },
            false => settings,
        };
        Ok((settings, decided))
    }

    /// The settings that would remove the difference between position and velocity, or the mean of a difference that
    /// changes. `None` if the position is not later.
    pub(crate) fn trial_settings(&self, case: &FlightCase<'_>) -> Option<Settings> {
        let FlightLateness { position_minus_velocity_s, position, velocity, kind, .. } = case.lateness;
        let pair = || compensated_pair(case.delays, position.as_ref()?, velocity.as_ref()?)?.varies.as_ref();
        let mean_s = || pair().filter(|_| kind.varies()).map(|over_time| over_time.level_s);
        let difference_s = position_minus_velocity_s.or_else(mean_s).filter(|d| d.value > 0.0)?;
        Some(Settings {
            delay_uncertainty_s: difference_s.standard_uncertainty,
            delay_source: "trial: the difference between position and velocity".to_owned(),
            ..self.settings(Delay::from_seconds(difference_s.value)?)
        })
    }

    /// Settings for steps that do not depend on the delay.
    pub(crate) fn provisional(&self) -> Settings {
        self.settings(Delay::from_seconds(PROVISIONAL_S).unwrap_or(Delay::ZERO))
    }

    /// The settings with this delay, without notices.
    fn settings(&self, delay: Delay) -> Settings {
        let ResolvedChannels { position, velocity, reference, onboard } = self.resolved.channels.clone();
        let ResolvedReplay { start, bridge_s, min_speed_mps, zoom_s, output_rate_hz, most_samples, compensators } =
            self.resolved.replay.clone();
        Settings {
            delay,
            delay_uncertainty_s: None,
            delay_source: String::new(),
            card: None,
            position_minus_velocity_s: None,
            position_lateness_s: None,
            velocity_lateness_s: None,
            start,
            bridge_s,
            min_speed_mps,
            zoom_s,
            output_rate_hz,
            most_samples,
            compensators,
            position,
            velocity,
            reference,
            onboard,
        }
    }
}

/// A flight and its bound channels.
pub(crate) struct FlightCase<'a> {
    pub(crate) flight: &'a Flight,
    pub(crate) binding: &'a Binding,
    /// Its measured delays.
    pub(crate) delays: &'a FlightDelays,
    /// How late its position is.
    pub(crate) lateness: &'a FlightLateness,
    /// What is removed.
    pub(crate) decision: &'a Decision,
}

/// The JSON schema of a pipeline file, as text.
#[cfg(feature = "schema")]
pub(crate) fn pipeline_schema() -> String {
    let schema = schemars::schema_for!(Written);
    serde_json::to_string_pretty(&schema).map(|text| text + "\n").unwrap_or_default()
}

/// The settings that differ between two resolved pipelines, as `delay.position_s: was 0.4, is 0.35`.
#[must_use]
pub(crate) fn differences(was: &str, is: &str) -> Vec<String> {
    let flat = |text: &str| toml::from_str::<toml::Table>(text).map(|t| flatten(&t)).unwrap_or_default();
    let (was, is) = (flat(was), flat(is));
    let keys: std::collections::BTreeSet<&String> = was.keys().chain(is.keys()).collect();
    let shown = |v: Option<&String>| v.cloned().unwrap_or_else(|| "not given".to_owned());
    keys.into_iter()
        .filter(|k| was.get(*k) != is.get(*k))
        .map(|k| format!("{k}: was {}, is {}", shown(was.get(k)), shown(is.get(k))))
        .collect()
}

fn flatten(table: &toml::Table) -> std::collections::BTreeMap<String, String> {
    let mut flat = std::collections::BTreeMap::new();
    for (key, value) in table {
        match value.as_table() {
            Some(inner) => flat.extend(flatten(inner).into_iter().map(|(k, v)| (format!("{key}.{k}"), v))),
            None => {
                flat.insert(key.clone(), value.to_string());
            }
        }
    }
    flat
}

/// Checks a pipeline. Holds the file, so that every complaint has its line.
struct Checker<'a> {
    file: &'a SettingsFile<'a>,
    path: &'a Path,
    shelf: Shelf<'a>,
}

impl Checker<'_> {
    fn resolve(&self, written: Written) -> Result<Pipeline, Refused> {
        self.file.known_layout(&written.schema)?;
        let sensor = written.sensor.map(|s| self.sensor(s)).transpose();
        let written_delay = written.delay.unwrap_or_else(|| Spanned::new(0..0, WrittenDelay::default()));
        let delay = sensor.as_ref().map_err(|r| *r).and_then(|s| self.delay(&written_delay, s.as_ref()));
        let (measure, replay) = (self.measure(&written.measure), self.replay(&written.replay));
        let channel_lines = self.channel_lines(&written.channels);
        let channels = self.channels(written.channels);
        let reference = written.reference.map(|r| self.reference(r)).transpose();
        let criteria = written.criteria.map(|c| self.criteria(&c.file)).transpose();
        let searched = match (&measure, &delay) {
            (Ok(measure), Ok((rule, _))) => self.is_searched(&written_delay, rule, measure),
            _ => Ok(()),
        };
        let fine = delay.is_ok() && measure.is_ok() && replay.is_ok() && channels.is_ok() && searched.is_ok();
        if !fine {
            self.likely_typos(&channel_lines);
        }
        let (rule, delay) = delay?;
        searched?;
        let mut resolved = Resolved {
            schema: 1,
            title: written.title,
            delay,
            measure: measure?,
            sensor: sensor?.map(Spanned::into_inner),
            channels: channels?,
            reference: reference?,
            replay: replay?,
            maps: ResolvedMaps { force: written.maps.force },
        };
        if matches!(resolved.reference, Some(ResolvedReference::File(_))) {
            resolved.channels.with_reference_file();
        }
        let maps_folder = written.maps.folder.map(|f| self.next_to_file(&f));
        let file_name = self.file_name();
        Ok(Pipeline { resolved, delay: rule, maps_folder, criteria: criteria?, file_name, channel_lines })
    }

    fn file_name(&self) -> String {
        self.path.file_name().unwrap_or_default().to_string_lossy().into_owned()
    }

    /// Rejects a stated delay outside the search range: no flight could confirm it, so it is a typo.
    fn is_searched(
        &self,
        written: &Spanned<WrittenDelay>,
        rule: &DelayRule,
        measure: &ResolvedMeasure,
    ) -> Result<(), Refused> {
        let (Some(fixed), [from, to]) = (&rule.fixed, measure.search_s) else { return Ok(()) };
        let seconds = fixed.delay.seconds();
        if (from..=to).contains(&seconds) {
            return Ok(());
        }
        let what = format!(
            "delay.position_s = {seconds} s: outside of measure.search_s = [{from}, {to}] s, so no flight can show \
             it; widen the search or correct the delay"
        );
        Err(match &written.get_ref().position_s {
            Some(at) => self.fault(at, what),
            None => self.fault(written, what),
        })
    }

    fn channel_lines(&self, written: &WrittenChannels) -> Vec<(String, usize)> {
        let lists = [&written.position, &written.velocity, &written.reference, &written.onboard];
        let all = lists.into_iter().flatten();
        let of_list = |list: &Spanned<Vec<String>>| {
            let line = self.file.line_of(list);
            list.get_ref().iter().map(|name| (name.clone(), line)).collect::<Vec<_>>()
        };
        all.flat_map(of_list).collect()
    }

    /// Complains about channels that no shipped map binds, if a map binds one of nearly the same name. Only for a file
    /// with other errors, because the user's maps are not read before the file is correct.
    fn likely_typos(&self, channels: &[(String, usize)]) {
        let Ok(maps) = ingest::MapLibrary::shipped() else { return };
        let known: BTreeSet<&str> = maps.channel_names().collect();
        for (name, line) in channels.iter().filter(|(name, _)| !known.contains(name.as_str())) {
            if let Some(near) = settings::likely(name, known.iter().copied()) {
                self.file
                    .reject_line(*line, format!("[channels]: no channel map binds {name:?}; did you mean {near:?}?"));
            }
        }
    }

    fn criteria(&self, file: &Spanned<PathBuf>) -> Result<Criteria, Refused> {
        Criteria::read(&self.next_to_file(file.get_ref())).map_err(|e| self.fault(file, format!("criteria.file: {e}")))
    }

    /// A path relative to the pipeline file.
    fn next_to_file(&self, path: &Path) -> PathBuf {
        self.path.parent().unwrap_or(Path::new("")).join(path)
    }

    fn sensor(&self, written: Spanned<SensorIdentity>) -> Result<Spanned<SensorIdentity>, Refused> {
        if written.get_ref().model.trim().is_empty() {
            return Err(self.fault(&written, "sensor.model must name the sensor"));
        }
        Ok(written)
    }

    /// The delay to remove, and its fallbacks.
    fn delay(
        &self,
        written: &Spanned<WrittenDelay>,
        sensor: Option<&Spanned<SensorIdentity>>,
    ) -> Result<(DelayRule, ResolvedDelay), Refused> {
        let delay = written.get_ref();
        let with_card = delay.card.is_some() || delay.cards.is_some();
        let from = self.asked(written, with_card);
        let cards = match (&delay.card, &delay.cards) {
            (Some(card), None) => self.of_card(card, delay, sensor),
            (None, Some(folder)) => self.of_folder(folder, delay, sensor),
            (Some(_), Some(_)) => Err(self.fault(written, "[delay] takes either `card` or `cards`, not both")),
            (None, None) => self.without_card(delay, sensor),
        };
        let fixed = delay.position_s.as_ref().map(|seconds| self.stated(seconds, written)).transpose();
        let (from, (cards, of_cards), fixed) = (from?, cards?, fixed?);
        let resolved = ResolvedDelay {
            from: Some(from),
            position_s: fixed.as_ref().map(|f| plain_zero(f.delay.seconds())),
            standard_uncertainty_s: fixed.as_ref().and_then(|f| f.standard_uncertainty_s),
            source: fixed.as_ref().map(|f| f.source.clone()),
            ..of_cards
        };
        Ok((DelayRule { from, fixed, cards }, resolved))
    }

    /// The requested source of the delay, explicit or implied. Checks that its inputs are given.
    fn asked(&self, written: &Spanned<WrittenDelay>, with_card: bool) -> Result<DelaySource, Refused> {
        let delay = written.get_ref();
        let with_number = delay.position_s.is_some();
        let Some(from) = &delay.from else {
            return match (with_number, with_card) {
                (true, false) => Ok(DelaySource::Fixed),
                (false, true) => Ok(DelaySource::Card),
                (false, false) => Ok(DelaySource::Network),
                (true, true) => {
                    let what = "[delay] has a number and a card: state with `from` which one is removed, or keep \
                        only one of `position_s`, `card` and `cards`";
                    Err(self.fault(written, what))
                }
            };
        };
        let source = DelaySource::from(*from.get_ref());
        match source {
            DelaySource::Fixed if !with_number => Err(self.fault(from, "delay.from = \"fixed\" needs `position_s`")),
            DelaySource::Card if !with_card => Err(self.fault(from, "delay.from = \"card\" needs `card` or `cards`")),
            _ => Ok(source),
        }
    }

    /// Rejects keys that require a card or a number when there is none.
    fn without_card(
        &self,
        delay: &WrittenDelay,
        sensor: Option<&Spanned<SensorIdentity>>,
    ) -> Result<(Vec<UsedCard>, ResolvedDelay), Refused> {
        if let Some(sensor) = sensor {
            return Err(self.fault(sensor, "[sensor] selects a card and needs delay.card or delay.cards"));
        }
        if let Some(pin) = &delay.pin {
            return Err(self.fault(pin, "delay.pin is for sensor cards: remove it or position_s"));
        }
        if delay.position_s.is_none() {
            self.no_words_without_number(delay, "is only for position_s: remove it")?;
        }
        Ok((vec![], ResolvedDelay::default()))
    }

    /// The delay that the pipeline states, with its source.
    fn stated(&self, position_s: &Spanned<f64>, written: &Spanned<WrittenDelay>) -> Result<FixedDelay, Refused> {
        let WrittenDelay { standard_uncertainty_s, source, .. } = written.get_ref();
        let seconds = *position_s.get_ref();
        let can_be_removed = seconds > 0.0 && seconds <= LONGEST_DELAY_S;
        let delay = Delay::from_seconds(seconds).filter(|_| can_be_removed).ok_or_else(|| {
            let wrong = settings::within("delay.position_s", seconds, 0.0, LONGEST_DELAY_S).err();
            let only_late = || {
                format!(
                    "delay.position_s = {seconds} s: must be above 0, in seconds: only a late \
                position can be compensated"
                )
            };
            self.fault(position_s, wrong.unwrap_or_else(only_late))
        });
        let source = match source {
            None => Ok(NO_SOURCE.to_owned()),
            Some(source) if source.get_ref().trim().is_empty() => {
                Err(self.fault(source, "delay.source must state where the delay comes from"))
            }
            Some(source) => Ok(source.get_ref().clone()),
        };
        let within = |u| self.file.within(u, "delay.standard_uncertainty_s", 0.0, LONGEST_DELAY_S);
        let standard_uncertainty_s = standard_uncertainty_s.as_ref().map(within).transpose();
        Ok(FixedDelay { delay: delay?, standard_uncertainty_s: standard_uncertainty_s?, source: source? })
    }

    /// Rejects text about a number without the number: the meaning would be ambiguous.
    fn no_words_without_number(&self, delay: &WrittenDelay, what: &str) -> Result<(), Refused> {
        if let Some(given) = &delay.standard_uncertainty_s {
            return Err(self.fault(given, format!("delay.standard_uncertainty_s {what}")));
        }
        match &delay.source {
            Some(given) => Err(self.fault(given, format!("delay.source {what}"))),
            None => Ok(()),
        }
    }

    fn no_number_with_card(&self, delay: &WrittenDelay) -> Result<(), Refused> {
        match &delay.position_s {
            Some(_) => Ok(()),
            None => self.no_words_without_number(delay, "comes from the sensor card: remove it"),
        }
    }

    fn of_card(
        &self,
        card: &Spanned<PathBuf>,
        delay: &WrittenDelay,
        sensor: Option<&Spanned<SensorIdentity>>,
    ) -> Result<(Vec<UsedCard>, ResolvedDelay), Refused> {
        self.no_number_with_card(delay)?;
        let found = self.shelf.card(&self.next_to_file(card.get_ref()));
        let found = found.map_err(|what| self.fault(card, format!("delay.card: {what}")))?;
        if let Some((sensor, conflict)) = sensor.and_then(|s| Some((s, found.conflict(s.get_ref())?))) {
            let what = format!(
                "[sensor] contradicts the card {} (first the pipeline, then the card): {conflict}",
                found.name()
            );
            return Err(self.fault(sensor, what));
        }
        let resolved = ResolvedDelay { card: Some(found.name().to_owned()), ..ResolvedDelay::default() };
        self.pinned(vec![found], delay, resolved)
    }

    fn of_folder(
        &self,
        folder: &Spanned<PathBuf>,
        delay: &WrittenDelay,
        sensor: Option<&Spanned<SensorIdentity>>,
    ) -> Result<(Vec<UsedCard>, ResolvedDelay), Refused> {
        self.no_number_with_card(delay)?;
        let Some(sensor) = sensor else {
            return Err(self.fault(folder, "delay.cards needs [sensor] with at least a model, to select the card"));
        };
        let path = self.next_to_file(folder.get_ref());
        let at_folder = |what: String| self.fault(folder, format!("delay.cards: {what}"));
        let all = self.shelf.cards(&path).map_err(at_folder)?;
        let found = chosen(all, sensor.get_ref()).map_err(|what| self.fault(sensor, format!("[sensor]: {what}")))?;
        let name = path.file_name().map_or_else(|| "cards".to_owned(), |n| n.to_string_lossy().into_owned());
        let resolved = ResolvedDelay { cards: Some(name), ..ResolvedDelay::default() };
        self.pinned(found, delay, resolved)
    }

    /// The cards that were found become part of the resolved settings. If the file pins cards, they must match.
    fn pinned(
        &self,
        cards: Vec<UsedCard>,
        delay: &WrittenDelay,
        resolved: ResolvedDelay,
    ) -> Result<(Vec<UsedCard>, ResolvedDelay), Refused> {
        let pin: Vec<Pin> = cards.iter().map(UsedCard::pin).collect();
        match &delay.pin {
            Some(stated) if !crate::cards::same_pins(stated.get_ref(), &pin) => {
                let found: Vec<String> = pin.iter().map(|p| format!("{} with {}", p.file, p.blake3)).collect();
                Err(self.fault(stated, format!("delay.pin names other cards than those found: {}", found.join(", "))))
            }
            _ => Ok((cards, ResolvedDelay { pin, ..resolved })),
        }
    }

    fn channels(&self, written: WrittenChannels) -> Result<ResolvedChannels, Refused> {
        let (position, velocity) = (DEFAULT_POSITIONS, DEFAULT_VELOCITIES);
        let position = self.names(written.position, "position", &position);
        let velocity = self.names(written.velocity, "velocity", &velocity);
        let reference = self.names(written.reference, "position", &["position.truth"]);
        let onboard = self.names(written.onboard, "position", &["position.compensated"]);
        Ok(ResolvedChannels { position: position?, velocity: velocity?, reference: reference?, onboard: onboard? })
    }

    /// The channel names of a list; each channel must hold `quantity`.
    fn names(
        &self,
        written: Option<Spanned<Vec<String>>>,
        quantity: &str,
        default: &[&str],
    ) -> Result<Vec<String>, Refused> {
        let Some(list) = written else { return Ok(default.iter().map(|&s| s.to_owned()).collect()) };
        let is_invalid =
            |name: &&String| name.strip_prefix(quantity).and_then(|n| n.strip_prefix('.')).is_none_or(str::is_empty);
        match list.get_ref().iter().find(is_invalid) {
            Some(invalid) => {
                let what = format!(
                    "channel `{invalid}` is not a {quantity}; names have the form `{quantity}.source`, such as \
                        `{}`",
                    default[0]
                );
                Err(self.fault(&list, what))
            }
            None => Ok(list.into_inner()),
        }
    }

    fn reference(&self, written: Spanned<WrittenReference>) -> Result<ResolvedReference, Refused> {
        let clock = written.get_ref().clock;
        let Some(file) = &written.get_ref().file else {
            let what = "reference needs `file`, such as \"{stem}.pos\", or `clock = \"same\"` for a reference in the log that is \
                        on time";
            let is_in_log = clock == ClockRule::Same;
            return is_in_log.then_some(ResolvedReference::InLog { clock }).ok_or_else(|| self.fault(&written, what));
        };
        if file.get_ref().trim().is_empty() {
            return Err(self.fault(file, "reference.file must name a file, such as \"{stem}.pos\""));
        }
        Ok(ResolvedReference::File(ReferenceRule { file: file.get_ref().clone(), clock }))
    }

    fn measure(&self, written: &WrittenMeasure) -> Result<ResolvedMeasure, Refused> {
        let search_s = self.search_s(written.search_s.as_ref());
        let ahead_m = self.file.optional(&written.antenna_ahead_m, "measure.antenna_ahead_m", -100.0, 100.0);
        let uncertainty_m =
            self.file.optional(&written.antenna_uncertainty_m, "measure.antenna_uncertainty_m", 0.0, 100.0);
        Ok(ResolvedMeasure { search_s: search_s?, antenna_ahead_m: ahead_m?, antenna_uncertainty_m: uncertainty_m? })
    }

    fn search_s(&self, written: Option<&Spanned<[f64; 2]>>) -> Result<[f64; 2], Refused> {
        let Some(given) = written else { return Ok(DEFAULT_SEARCH_S) };
        let [from, to] = *given.get_ref();
        let bounded = |s| settings::within("measure.search_s", s, -LONGEST_SEARCH_S, LONGEST_SEARCH_S);
        bounded(from).and(bounded(to)).map_err(|what| self.fault(given, what))?;
        if from < to && to - from <= LONGEST_SEARCH_S {
            return Ok([plain_zero(from), plain_zero(to)]);
        }
        let what = format!(
            "measure.search_s = [{from}, {to}]: the first must be below the second, and they must be at most \
             {LONGEST_SEARCH_S} s apart"
        );
        Err(self.fault(given, what))
    }

    fn replay(&self, written: &WrittenReplay) -> Result<ResolvedReplay, Refused> {
        let bridge_s = self.file.optional(&written.bridge_s, "replay.bridge_s", 0.0, 600.0);
        let min_speed_mps = self.file.optional(&written.min_speed_mps, "replay.min_speed_mps", 0.0, 1000.0);
        let zoom_s = self.file.optional(&written.zoom_s, "replay.zoom_s", 1.0, 3600.0);
        let output_rate_hz = self.file.optional(&written.output_rate_hz, "replay.output_rate_hz", 1.0, 10_000.0);
        let most_samples = self.file.optional(&written.most_samples, "replay.most_samples", 1000.0, 1e9);
        let compensators = self.compensators(written.compensators.as_deref().unwrap_or_default());
        Ok(ResolvedReplay {
            start: written.start.unwrap_or(StartRule::Warm),
            bridge_s: bridge_s?,
            min_speed_mps: min_speed_mps?.unwrap_or(0.5),
            zoom_s: zoom_s?.unwrap_or(20.0),
            output_rate_hz: output_rate_hz?,
            most_samples: most_samples?.map_or(Settings::MOST_SAMPLES, |most| most as usize),
            compensators: compensators?,
        })
    }

    /// The additional compensators. An unknown or repeated name is rejected with its line.
    fn compensators(&self, written: &[Spanned<String>]) -> Result<Vec<CompensatorKind>, Refused> {
        let mut all: Vec<CompensatorKind> = vec![];
        let mut right = Ok(());
        for name in written {
            match name.get_ref().parse::<CompensatorKind>() {
                Err(e) => right = Err(self.fault(name, format!("replay.compensators: {e}"))),
                Ok(kind) if all.contains(&kind) => {
                    right = Err(self.fault(name, format!("replay.compensators names {kind} twice")));
                }
                Ok(kind) => all.push(kind),
            }
        }
        right?;
        all.retain(|kind| !Settings::always_runs(*kind));
        Ok(all)
    }

    fn fault<T>(&self, at: &Spanned<T>, what: impl Into<String>) -> Refused {
        self.file.reject(at, what)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::delay::tests::example_card;

    fn parse(text: &str) -> Result<Pipeline, SettingsError> {
        Pipeline::parse(text, Path::new("settings/p.toml"))
    }

    const SMALL: &str = "schema = 1\n[delay]\nposition_s = 0.4\nsource = \"bench\"\n";

    #[test]
    fn every_shipped_pipeline_is_valid_and_names_its_source() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../pipelines");
        let files = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path());
        let is_pipeline = |p: &PathBuf| {
            let name = p.file_name().unwrap().to_string_lossy().into_owned();
            name.ends_with(".toml")
                && !name.ends_with(".rig.toml")
                && !name.ends_with(".card.toml")
                && !name.ends_with("criteria.toml")
                && name != "channel-map.example.toml"
                && name != "Cargo.toml"
                && !name.ends_with("test-card.toml")
        };
        let pipelines: Vec<PathBuf> = files.filter(is_pipeline).collect();
        assert!(pipelines.len() >= 3, "{pipelines:?}");
        for path in pipelines {
            let rule = Pipeline::read(&path).unwrap().delay;
            match rule.fixed {
                Some(fixed) => assert!(!fixed.source.is_empty(), "{}", path.display()),
                None => assert!(rule.from != DelaySource::Card || !rule.cards.is_empty(), "{}", path.display()),
            }
        }
    }

    #[test]
    fn a_pipeline_without_a_title_is_a_flight_campaign() {
        assert_eq!(parse(SMALL).unwrap().resolved.title, "Flight campaign");
        assert_eq!(parse(&format!("title = \"Seoul\"\n{SMALL}")).unwrap().resolved.title, "Seoul");
    }

    #[test]
    fn a_delay_outside_the_search_range_is_rejected_with_its_line() {
        let error = parse(&SMALL.replace("0.4", "20")).unwrap_err();
        assert_eq!(error.line, Some(3));
        assert!(error.what.contains("outside of measure.search_s = [-2.5, 13] s"), "{error}");
        let narrow = SMALL.replace("0.4", "3") + "[measure]\nsearch_s = [-1, 1]\n";
        assert!(parse(&narrow).unwrap_err().what.contains("measure.search_s = [-1, 1] s"));
        assert!(parse(&(SMALL.replace("0.4", "20") + "[measure]\nsearch_s = [-2.5, 25]\n")).is_ok());
    }

    #[test]
    fn mistyped_channels_are_reported_with_the_other_errors_of_the_file() {
        let text = format!(
            "{SMALL}[channels]\nposition = [\"position.gsp\"]\nvelocity = [\"velocity.gspp\"]\n[replay]\ncompensators = [\"exact-fri\"]\n"
        );
        let text = parse(&text).unwrap_err().to_string();
        for expected in [
            "binds \"position.gsp\"; did you mean \"position.",
            "binds \"velocity.gspp\"; did you mean",
            "did you mean \"exact-fir\"?",
        ] {
            assert!(text.contains(expected), "{expected}: {text}");
        }
        assert!(text.lines().all(|line| line.starts_with("settings/p.toml:")), "{text}");
    }

    #[test]
    fn an_unknown_key_is_rejected_with_its_line_and_likely_or_known_keys() {
        let error = parse("schema = 1\n[delay]\nposition_s = 0.4\nsource = \"bench\"\npositon_s = 1\n").unwrap_err();
        let text = error.to_string();
        assert!(text.starts_with("settings/p.toml:5: unknown key `positon_s`"), "{text}");
        assert!(text.ends_with("did you mean `position_s`?"), "{text}");
        let other = parse(&SMALL.replace("position_s", "colour")).unwrap_err().to_string();
        assert!(other.contains("p.toml:3: unknown key `colour`; the keys here are `from`, `position_s`, "), "{other}");
    }

    #[test]
    fn all_typos_of_a_file_are_reported_at_once_with_the_nearest_keys() {
        let error = parse(&format!("titel = \"x\"\n{SMALL}[replay]\nzom_s = 3\n")).unwrap_err();
        let text = error.to_string();
        assert!(text.starts_with("settings/p.toml:1: unknown key `titel`: did you mean `title`?"), "{text}");
        assert!(text.contains("\nsettings/p.toml:7: unknown key `zom_s`: did you mean `zoom_s`?"), "{text}");
    }

    #[test]
    fn a_delay_in_milliseconds_or_not_positive_is_rejected_with_its_line() {
        for delay in ["400", "0", "-0.5", "nan", "inf"] {
            let error = parse(&SMALL.replace("0.4", delay)).unwrap_err();
            assert_eq!(error.line, Some(3));
            assert!(error.what.contains(" s: "), "{error}");
        }
        let error = parse(&SMALL.replace("0.4", "400")).unwrap_err();
        assert_eq!(error.what, "delay.position_s = 400 s: must be from 0 to 30 s; 400 ms are 0.4 s");
        let error = parse(&SMALL.replace("0.4", "0")).unwrap_err();
        assert!(error.what.contains("only a late position can be compensated"), "{error}");
        let error = parse(&format!("{SMALL}[measure]\nsearch_s = [400, 420]\n")).unwrap_err();
        assert_eq!(error.what, "measure.search_s = 400 s: must be from -60 to 60 s; 400 ms are 0.4 s");
        let error = parse(&format!("{SMALL}[replay]\noutput_rate_hz = -100\n")).unwrap_err();
        assert_eq!(error.what, "replay.output_rate_hz = -100 Hz: must be from 1 to 10000 Hz");
    }

    #[test]
    fn an_implausible_value_is_rejected_with_its_line() {
        for (line, number) in [
            ("[replay]\nbridge_s = -1.0", 6),
            ("[replay]\nzoom_s = nan", 6),
            ("[channels]\nvelocity = [\"position.gps\"]", 6),
            ("[channels]\nposition = [\"position.\"]", 6),
            ("[replay]\nstart = \"lukewarm\"", 6),
        ] {
            let error = parse(&format!("{SMALL}{line}\n")).unwrap_err();
            assert_eq!(error.line, Some(number), "{line}: {error}");
        }
        assert_eq!(parse(&SMALL.replace("schema = 1", "schema = 2")).unwrap_err().line, Some(1));
        assert_eq!(parse("schema = 1\n[delay]\nposition_s = 0.4\nsource = \" \"\n").unwrap_err().line, Some(4));
    }

    #[test]
    fn one_run_reports_every_error_of_a_pipeline() {
        let text = "schema = 1\n[delay]\nposition_s = 400\nsource = \" \"\n[measure]\nsearch_s = [4, 2]\nantenna_ahead_m = \"3 m\"\n\
                    [channels]\nvelocity = [\"position.gps\"]\n[replay]\nzom_s = 0.1\ncompensators = [\"pad\"]\nstart = \"hot\"\n";
        let error = parse(text).unwrap_err().to_string();
        let lines: Vec<&str> = error.lines().collect();
        let right = [
            (3, "400 ms are 0.4 s"),
            (4, "delay.source must state"),
            (6, "the first must be below the second"),
            (7, "measure.antenna_ahead_m = \"3 m\": must be a number in m"),
            (9, "is not a velocity"),
            (11, "did you mean `zoom_s`?"),
            (11, "replay.zoom_s = 0.1 s: must be from 1 to 3600 s"),
            (12, "replay.compensators: "),
            (13, "unknown value `hot`"),
        ];
        assert_eq!(lines.len(), right.len(), "{error}");
        for (line, (number, says)) in lines.iter().zip(right) {
            assert!(line.starts_with(&format!("settings/p.toml:{number}: ")) && line.contains(says), "{line}");
        }
    }

    #[test]
    fn a_default_spelled_out_or_a_comment_changes_nothing() {
        let spelled = format!(
            "# a comment\n{SMALL}[replay]\nzoom_s = 20\nstart = \"warm\"\n[channels]\nreference = [\"position.truth\"]\n"
        );
        assert_eq!(parse(SMALL).unwrap().as_used(), parse(&spelled).unwrap().as_used());
    }

    #[test]
    fn the_shipped_pipeline_states_the_actual_defaults() {
        let shipped = Pipeline::shipped_default().unwrap().resolved.channels;
        assert_eq!(shipped, parse(SMALL).unwrap().resolved.channels);
    }

    #[test]
    fn the_default_binds_receiver_channels_and_prefers_the_better_one() {
        let resolved = Pipeline::shipped_default().unwrap().resolved.channels;
        let pair = |names: &[(&str, &str)]| {
            let simulated = simulate::simulate(&simulate::LikeCase::A.settings(1)).unwrap().to_flight().unwrap();
            let mut flight = Flight::default();
            for (name, source) in names {
                flight.channels.insert((*name).to_owned(), simulated.channels[*source].clone());
            }
            let picked =
                pick_pair(&flight, &resolved.position, &resolved.velocity).map(|pair| pair.map(|p| p.0.to_owned()));
            picked.map_err(|refusal| refusal.to_string())
        };
        let (p, v) = ("position.gps", "velocity.gps");
        for (position, velocity) in [
            ("position.gps", "velocity.vtg"),
            ("position.posllh", "velocity.velned"),
            ("position.precise", "velocity.velned"),
            ("position.sol", "velocity.sol"),
            ("position.posecef", "velocity.velned"),
            ("position.precise-ecef", "velocity.pubx"),
            ("position.hnr", "velocity.hnr"),
            ("position.nav2", "velocity.nav2"),
            ("position.ekf-global", "velocity.ekf-global"),
            ("position.ins", "velocity.xyz"),
        ] {
            let expected = Ok([position, velocity].map(str::to_owned));
            assert_eq!(pair(&[(position, p), (velocity, v)]), expected);
        }
        let both = pair(&[("position.posllh", p), (p, p), ("velocity.velned", v), ("velocity.vtg", v), (v, v)]);
        assert_eq!(both, Ok([p, v].map(str::to_owned)));
        // Columns without a named source, next to those of the receiver, come from something faster.
        let plain = pair(&[(p, p), ("velocity.truth", v), (v, v), ("velocity.plain", v)]);
        assert_eq!(plain, Ok([p, "velocity.plain"].map(str::to_owned)));
    }

    #[test]
    fn a_resolved_pipeline_resolves_to_itself() {
        let resolved = parse(SMALL).unwrap().with_forced_map(Some("mavros".into())).as_used();
        assert_eq!(parse(&resolved.toml).unwrap().as_used(), resolved);
    }

    #[test]
    fn an_unknown_compensator_is_rejected_with_its_line_and_the_known_names() {
        let list = |name: &str| {
            format!(
                "{SMALL}[replay]\ncompensators = [\n  \"pade-1-1-tustin\",\n  \"pade-2-2-foh\",\n  \"{name}\",\n]\n"
            )
        };
        for (name, says) in [
            ("wishful", "no compensator is called \"wishful\"; `flightlag compensator --help` lists"),
            ("pade-0-5-foh", "unstable"),
            ("pade-2-2", "names pade-2-2-foh twice"),
        ] {
            let error = parse(&list(name)).unwrap_err();
            assert!(error.to_string().starts_with("settings/p.toml:9: replay.compensators"), "{error}");
            assert!(error.what.contains(says), "{error}");
        }
        parse(&list("kalman")).unwrap();
    }

    #[test]
    fn only_additional_compensators_are_part_of_the_resolved_pipeline() {
        let with = |list: &str| parse(&format!("{SMALL}[replay]\ncompensators = {list}\n")).unwrap();
        assert_eq!(with("[\"exact-async\", \"pade-1-1\"]").as_used(), parse(SMALL).unwrap().as_used());
        let pipeline = with("[\"pade-2-2\", \"exact-async\", \"kalman\"]");
        let used = pipeline.as_used();
        assert!(used.toml.contains("compensators = [\"pade-2-2-foh\", \"kalman\"]"), "{}", used.toml);
        assert_eq!(parse(&used.toml).unwrap().as_used(), used);
        assert_ne!(used.blake3, parse(SMALL).unwrap().as_used().blake3);
    }

    /// Settings and decision of this pipeline for a single flight.
    fn settings_of(pipeline: &Pipeline, flight: &Flight, binding: &Binding) -> (Settings, Decided) {
        let measured = crate::answer::measure("k", flight, &flight::LogHealth::default(), binding, None, pipeline);
        let decided = crate::decide::over(&[("a", &measured.lateness)], pipeline);
        let (delays, decision) = (measured.delays.unwrap(), &decided.decisions["a"]);
        let case = FlightCase { flight, binding, delays: &delays, lateness: &measured.lateness, decision };
        pipeline.settings_for(&case).unwrap()
    }

    #[test]
    fn a_better_compensator_scores_better_on_a_flight_with_known_truth() {
        let simulated = simulate::simulate(&simulate::LikeCase::A.settings(1)).unwrap();
        let flight = simulated.to_flight().unwrap();
        let binding = Binding { map: String::new(), why: String::new(), others: vec![], channels: vec![] };
        let text =
            format!("{SMALL}[replay]\ncompensators = [\"pade-1-1-tustin\", \"exact-async\", \"pade-2-2-foh\"]\n");
        let (settings, _) = settings_of(&parse(&text).unwrap(), &flight, &binding);
        let record = compensation_replay::replay(&flight, &settings).unwrap().record;
        let error = |name: &str| {
            record.compensators.iter().find(|c| c.name == name).and_then(|c| c.error_rms_m).map(|e| e.value).unwrap()
        };
        // The design note, table 5.7: 0.0371 m with [1/1].
        let (paper, better) = (error("pade-1-1"), error("pade-2-2-foh"));
        assert!(better < 0.1 * paper && paper < 0.05, "[2/2] {better} m, the paper's {paper} m");
    }

    #[test]
    fn a_changed_setting_is_reported_with_its_old_value() {
        let was = parse(SMALL).unwrap().as_used().toml;
        let is = parse(&SMALL.replace("0.4", "0.35")).unwrap().as_used().toml;
        let changed = differences(&was, &is);
        assert_eq!(changed, ["delay.position_s: was 0.4, is 0.35"]);
    }

    /// A folder with cards of two sensors, and the path of the pipeline in it.
    fn cards() -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("shelf")).unwrap();
        for (file, serial) in [("a.card.toml", "1"), ("b.card.toml", "2")] {
            std::fs::write(folder.path().join("shelf").join(file), example_card(serial, "2026-01-01")).unwrap();
        }
        std::fs::write(folder.path().join("shelf/notes.txt"), "no card").unwrap();
        let pipeline = folder.path().join("p.toml");
        (folder, pipeline)
    }

    #[test]
    fn a_delay_is_given_in_exactly_one_way() {
        let (_folder, path) = cards();
        for (delay, says) in [
            ("position_s = 0.4\nsource = \"s\"\ncard = \"shelf/a.card.toml\"", "keep only one"),
            ("card = \"shelf/a.card.toml\"\ncards = \"shelf\"", "not both"),
            ("card = \"shelf/a.card.toml\"\nsource = \"s\"", "comes from the sensor card"),
            ("card = \"shelf/a.card.toml\"\nstandard_uncertainty_s = 0.1", "comes from the sensor card"),
            ("cards = \"shelf\"", "needs [sensor]"),
        ] {
            let error = Pipeline::parse(&format!("schema = 1\n[delay]\n{delay}\n"), &path).unwrap_err();
            assert!(error.what.contains(says) && error.line.is_some_and(|l| l >= 2), "{delay}: {error}");
        }
    }

    #[test]
    fn the_pipeline_states_the_source_of_the_delay_and_its_fallbacks() {
        let (_folder, path) = cards();
        let number = "position_s = 0.4\nsource = \"s\"\n";
        let card = "card = \"shelf/a.card.toml\"\n";
        let rule = |delay: String| {
            let text = format!("schema = 1\n[delay]\n{delay}");
            Pipeline::parse(&text, &path).map(|p| (p.delay.from, p.delay.fixed.is_some(), p.delay.cards.len()))
        };
        for (delay, from, fixed, cards) in [
            ("from = \"flight\"\n".to_owned(), DelaySource::Flight, false, 0),
            (format!("from = \"flight\"\n{card}"), DelaySource::Flight, false, 1),
            (format!("from = \"sweep\"\n{number}{card}"), DelaySource::Sweep, true, 1),
            (format!("from = \"fixed\"\n{number}{card}"), DelaySource::Fixed, true, 1),
            (format!("from = \"card\"\n{number}{card}"), DelaySource::Card, true, 1),
            (number.to_owned(), DelaySource::Fixed, true, 0),
            (card.to_owned(), DelaySource::Card, false, 1),
        ] {
            assert_eq!(rule(delay.clone()).unwrap(), (from, fixed, cards), "{delay}");
        }
    }

    #[test]
    fn a_missing_or_unknown_source_of_the_delay_is_rejected() {
        let (_folder, path) = cards();
        for (delay, says) in [
            ("from = \"fixed\"\ncard = \"shelf/a.card.toml\"", "needs `position_s`"),
            ("from = \"card\"\nposition_s = 0.4\nsource = \"s\"", "needs `card` or `cards`"),
            ("from = \"flight\"\nsource = \"s\"", "is only for position_s"),
            ("from = \"moon\"", "unknown value `moon`"),
        ] {
            let error = Pipeline::parse(&format!("schema = 1\n[delay]\n{delay}\n"), &path).unwrap_err();
            assert!(error.what.contains(says) && error.line.is_some(), "{error}");
        }
    }

    #[test]
    fn stating_the_implied_source_changes_nothing_and_another_source_does() {
        let explicit = SMALL.replace("[delay]\n", "[delay]\nfrom = \"fixed\"\n");
        assert_eq!(parse(&explicit).unwrap().as_used(), parse(SMALL).unwrap().as_used());
        let flight = parse(&explicit.replace("fixed", "flight")).unwrap().as_used();
        assert_ne!(flight.blake3, parse(SMALL).unwrap().as_used().blake3);
        assert_eq!(parse(&flight.toml).unwrap().as_used(), flight, "a resolved pipeline resolves to itself");
    }

    /// Simulated one-minute circuits with a delay of 0.25 s under a pipeline that states 0.4 s: the flight's own delay
    /// is within four of its standard uncertainties of the truth, and so is the optimum against the truth.
    #[test]
    fn the_flights_own_delay_matches_the_truth_whatever_the_pipeline_states() {
        for (from, seed) in [("flight", 1), ("flight", 2), ("sweep", 3), ("sweep", 4)] {
            let usual = simulate::LikeCase::D.settings(seed);
            let position = simulate::SensorSettings { delay_s: 0.25, ..usual.position.clone() };
            let settings = simulate::FlightSettings { duration_s: 60.0, position, ..usual };
            let flight = simulate::simulate(&settings).unwrap().to_flight().unwrap();
            let binding = Binding { map: String::new(), why: String::new(), others: vec![], channels: vec![] };
            let text = SMALL.replace("[delay]\n", &format!("[delay]\nfrom = \"{from}\"\n"));
            let (settings, decided) = settings_of(&parse(&text).unwrap(), &flight, &binding);
            let (found, u) = (settings.delay.seconds(), settings.delay_uncertainty_s.unwrap());
            assert!((found - 0.25).abs() < 4.0 * u && u < 0.01, "{from}: {found} ± {u}");
            assert_eq!(decided.choice.used, decided.choice.asked);
        }
    }

    #[test]
    fn a_missing_or_invalid_card_is_a_pipeline_error_with_its_line() {
        let (folder, path) = cards();
        std::fs::write(folder.path().join("bad.card.toml"), "card_version = 1\ncolour = 3\n").unwrap();
        for (card, says) in [("none.card.toml", "No such file"), ("bad.card.toml", "bad.card.toml:2: unknown key")] {
            let text = format!("schema = 1\n[delay]\ncard = \"{card}\"\n");
            let error = Pipeline::parse(&text, &path).unwrap_err();
            assert_eq!(error.line, Some(3), "{error}");
            assert!(error.what.contains(says), "{error}");
        }
    }

    #[test]
    fn the_card_of_another_sensor_is_rejected_with_the_differences() {
        let (_folder, path) = cards();
        let text = "schema = 1\n[delay]\ncard = \"shelf/a.card.toml\"\n[sensor]\nmodel = \"M\"\nserial = \"2\"\n";
        let error = Pipeline::parse(text, &path).unwrap_err();
        assert!(error.what.contains("serial `2` and `1`"), "{error}");
        assert_eq!(error.line, Some(4), "{error}");
        Pipeline::parse(&text.replace("serial = \"2\"", "serial = \"1\""), &path).unwrap();
    }

    #[test]
    fn a_folder_of_cards_is_searched_by_sensor_without_guessing() {
        let (_folder, path) = cards();
        let with = |sensor: &str| {
            let text = format!("schema = 1\n[delay]\ncards = \"shelf\"\n[sensor]\nmodel = \"M\"\n{sensor}\n");
            Pipeline::parse(&text, &path)
        };
        let found = with("serial = \"2\"").unwrap();
        assert_eq!(found.delay.cards.iter().map(UsedCard::name).collect::<Vec<_>>(), ["b.card.toml"]);
        let both = with("").unwrap_err();
        assert!(both.what.contains("different sensors (serial"), "{both}");
        let none = with("serial = \"3\"").unwrap_err();
        assert!(none.what.contains("no card of M 3; the folder holds a.card.toml (M 1), b.card.toml (M 2)"), "{none}");
    }

    #[test]
    fn the_content_of_a_card_counts_and_its_location_does_not() {
        let (folder, path) = cards();
        let of = |card: &str| {
            Pipeline::parse(&format!("schema = 1\n[delay]\ncard = \"{card}\"\n"), &path).unwrap().as_used()
        };
        let before = of("shelf/a.card.toml");
        std::fs::copy(folder.path().join("shelf/a.card.toml"), folder.path().join("a.card.toml")).unwrap();
        assert_eq!(of("a.card.toml"), before);
        std::fs::write(folder.path().join("a.card.toml"), example_card("1", "2026-01-02")).unwrap();
        let changed = differences(&before.toml, &of("a.card.toml").toml);
        assert_eq!(changed.len(), 1, "{changed:?}");
        assert!(changed[0].starts_with("delay.pin: was "), "{changed:?}");
    }

    #[test]
    fn a_manifest_needs_no_card_file_and_a_pin_rejects_other_content() {
        let (folder, path) = cards();
        let text = "schema = 1\n[delay]\ncards = \"shelf\"\n[sensor]\nmodel = \"M\"\nserial = \"1\"\n";
        let pipeline = Pipeline::parse(text, &path).unwrap();
        let (resolved, files) = (pipeline.as_used(), pipeline.card_files());
        assert_eq!(Pipeline::of_manifest(&resolved.toml, &files).unwrap().as_used(), resolved);
        assert_eq!(
            Pipeline::parse(&resolved.toml, &path).unwrap().as_used(),
            resolved,
            "a resolved pipeline resolves to itself"
        );
        std::fs::write(folder.path().join("shelf/a.card.toml"), example_card("1", "2026-01-02")).unwrap();
        let error = Pipeline::parse(&resolved.toml, &path).unwrap_err();
        assert!(error.what.contains("names other cards than those found: a.card.toml with"), "{error}");
        assert!(Pipeline::of_manifest(&resolved.toml, &[]).is_err());
    }

    #[test]
    fn a_sensor_with_a_plain_number_is_rejected() {
        let error = parse(&format!("{SMALL}[sensor]\nmodel = \"M\"\n")).unwrap_err();
        assert_eq!(error.line, Some(5), "{error}");
        assert!(error.what.contains("[sensor] selects a card"), "{error}");
    }

    #[test]
    fn maps_are_found_next_to_the_pipeline_file() {
        let pipeline = parse(&format!("{SMALL}[maps]\nfolder = \"maps\"\n")).unwrap();
        assert_eq!(pipeline.maps_folder(), Some(Path::new("settings/maps")));
    }
}
