//! What a night found: what changed against the runs before, trends, and whether recommended settings held.

use crate::{CampaignTotals, Estimate};
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A flight of a campaign, and its page.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct NamedFlight {
    /// Name of the campaign.
    pub campaign: String,
    /// Path of the flight below the campaign's folder.
    pub flight: String,
    /// Its page, relative to the page that names it; `None` if it has none.
    pub page: Option<String>,
}

/// Why a flight has another result than before.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum ChangeCause {
    /// The content of its log changed.
    Log,
    /// The resolved settings changed.
    Settings,
    /// The analysis changed: another build of flightlag.
    Build,
    /// The criteria changed.
    Criteria,
    /// Nothing of the flight itself changed: what is removed follows from the other flights of its group.
    OtherFlights,
}

impl ChangeCause {
    /// The cause in a word or two.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            ChangeCause::Log => "log",
            ChangeCause::Settings => "settings",
            ChangeCause::Build => "build",
            ChangeCause::Criteria => "criteria",
            ChangeCause::OtherFlights => "other flights of its group",
        }
    }
}

/// A flight with another result than before.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct RerunCause {
    /// The flight.
    #[serde(flatten)]
    pub flight: NamedFlight,
    /// Every cause.
    pub causes: Vec<ChangeCause>,
}

/// A number of a flight that is another one than before.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct MovedNumber {
    /// The flight.
    #[serde(flatten)]
    pub flight: NamedFlight,
    /// What moved: `lateness`, `position minus velocity` or `error after compensation`.
    pub quantity: String,
    /// Unit of both values: `s` or `m`.
    pub unit: String,
    /// Value before.
    pub before: Estimate,
    /// Value now.
    pub now: Estimate,
    /// Difference over the root of the sum of both squared standard uncertainties, with the sign of now − before; `None` where
    /// one of them is not known: then the value changed by more than a tenth.
    pub sigmas: Option<f64>,
    /// Every cause.
    pub causes: Vec<ChangeCause>,
}

/// Words about a flight: troubles or alarms that came or went.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct FlightWords {
    /// The flight.
    #[serde(flatten)]
    pub flight: NamedFlight,
    /// Each in a word or two.
    pub words: Vec<String>,
    /// First line of the error, or what is wrong with a damaged log; `None` if nothing says it.
    pub error: Option<String>,
    /// What each alarm says in full, in the order of the words; empty for troubles, remarks and alarms that are gone.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub texts: Vec<String>,
}

/// A value that is recommended for a parameter of the autopilot, and that is another one than before.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct MovedAdvice {
    /// The flight.
    #[serde(flatten)]
    pub flight: NamedFlight,
    /// The parameter.
    pub parameter: String,
    /// Value recommended before, s; `None` if there was none.
    pub before_s: Option<f64>,
    /// Value recommended now, s; `None` if there is none.
    pub now_s: Option<f64>,
}

/// One set of results against another.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct RunChanges {
    /// Flights that are in both.
    pub compared: u64,
    /// Flights that were not there before.
    pub new: Vec<NamedFlight>,
    /// Flights that are no longer there.
    pub gone: Vec<NamedFlight>,
    /// Flights with another result.
    pub rerun: Vec<RerunCause>,
    /// Numbers that moved by more than two standard uncertainties, the largest move first; after them those that moved by more
    /// than a tenth and have no uncertainty.
    pub moved: Vec<MovedNumber>,
    /// Flights with a trouble that they did not have; new flights with a trouble too, except those that cannot be measured.
    pub failing: Vec<FlightWords>,
    /// New flights that cannot be measured, as one that stands still: nothing failed.
    #[serde(default)]
    pub new_not_measurable: Vec<NamedFlight>,
    /// Flights that lost a trouble.
    pub recovered: Vec<FlightWords>,
    /// Alarms that are new and ask for something.
    pub alarms_new: Vec<FlightWords>,
    /// Such alarms that are gone.
    pub alarms_cleared: Vec<FlightWords>,
    /// Remarks that are new: they ask for nothing.
    #[serde(default)]
    pub remarks_new: Vec<FlightWords>,
    /// Remarks that are gone.
    #[serde(default)]
    pub remarks_cleared: Vec<FlightWords>,
    /// Flights for which another value is recommended than before.
    #[serde(default)]
    pub advice: Vec<MovedAdvice>,
}

impl RunChanges {
    /// How many numbers moved by more than two standard uncertainties, and how many by more than a tenth without one.
    #[must_use]
    pub fn moved_counts(&self) -> (usize, usize) {
        let known = self.moved.iter().filter(|moved| moved.sigmas.is_some()).count();
        (known, self.moved.len() - known)
    }
}

/// A point of a control chart.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct TrendPoint {
    /// The flight.
    #[serde(flatten)]
    pub flight: NamedFlight,
    /// Instant, UTC, at which it was flown; `None` if its log does not know the day. Such flights are ordered by their run.
    pub flown_at: Option<String>,
    /// Lateness, s.
    pub lateness_s: Estimate,
    /// Mean of its segment, s.
    pub centre_s: f64,
    /// Distance of both limits from the centre, s: three standard deviations of this point.
    pub limit_s: f64,
    /// Whether it is outside its limits.
    pub is_outside: bool,
    /// Whether it differs from the flights before and after it: it takes no part in the search for changes.
    pub is_odd: bool,
}

/// Flights between two changes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct TrendSegment {
    /// First flight.
    pub first: NamedFlight,
    /// Last flight.
    pub last: NamedFlight,
    /// Number of flights that count.
    pub flights: u64,
    /// Weighted mean, s.
    pub mean_s: Estimate,
}

/// A step between two segments.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct TrendChange {
    /// First flight after the step.
    pub at: NamedFlight,
    /// Instant, UTC, at which that flight was flown.
    pub flown_at: Option<String>,
    /// The step is at one of the flights from this one (95 %) …
    pub earliest: NamedFlight,
    /// … to this one.
    pub latest: NamedFlight,
    /// Mean after less mean before, s.
    pub step_s: Estimate,
    /// The step over its standard uncertainty.
    pub sigmas: f64,
    /// What else is another one after the step, as `firmware: 3.01 → 4.04`.
    pub with_it: Vec<String>,
}

/// The control chart of one aircraft, receiver or setting.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct TrendChart {
    /// `airframe`, `serial`, `receiver`, `firmware`, `rate` or `baud`.
    pub dimension: String,
    /// Its value.
    pub value: String,
    /// What the lateness is counted from.
    pub datum: String,
    /// Standard deviation between flights beyond their own uncertainties, s.
    pub between_s: f64,
    /// A change counts if it lowers the weighted sum of squares by more than this; `None` if there are fewer than six
    /// flights, or if even a lower threshold shows none.
    pub threshold: Option<f64>,
    /// Flights before those in `points`: they count in the segments.
    pub older_points: u64,
    /// Flights in the order in which they were flown.
    pub points: Vec<TrendPoint>,
    /// Stretches without a change.
    pub segments: Vec<TrendSegment>,
    /// Steps between them.
    pub changes: Vec<TrendChange>,
}

impl TrendChart {
    /// Its name: `receiver u-blox M8`, `rate 5 Hz`, `115200 baud`.
    #[must_use]
    pub fn name(&self) -> String {
        match self.value.ends_with(&self.dimension) {
            true => self.value.clone(),
            false => format!("{} {}", self.dimension, self.value),
        }
    }
}

/// Control charts of a history.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct TrendRecord {
    /// [`crate::RECORD_VERSION`].
    pub record_version: u32,
    /// Probability that one chart without a change shows one.
    pub false_alarm: f64,
    /// Whether that is over every look as the chart grows, as a night needs it, and not for one look.
    #[serde(default)]
    pub every_look: bool,
    /// Charts by dimension and value.
    pub charts: Vec<TrendChart>,
    /// Flights that are on no chart, with the reason: `3 without a lateness`.
    pub left_out: Vec<String>,
    /// Charts without a change, which the page of a night leaves out; 0 on the page of `trend`.
    #[serde(default)]
    pub without_change: u64,
}

/// Whether a recommended setting did what was predicted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum ProofVerdict {
    /// It did not.
    Fail,
    /// The flights after it cannot show it.
    CannotTell,
    /// No later log shows that the parameter was set.
    NotSet,
    /// It did.
    Pass,
}

impl ProofVerdict {
    /// The verdict as pages and tables give it.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            ProofVerdict::Fail => "FAIL",
            ProofVerdict::CannotTell => "CANNOT TELL",
            ProofVerdict::NotSet => "NOT SET YET",
            ProofVerdict::Pass => "PASS",
        }
    }
}

/// A recommended setting and the flights after it. The residual is the lateness less the parameter: what the autopilot does
/// not account for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct SettingProof {
    /// Name of the campaign.
    pub campaign: String,
    /// Aircraft and receiver, in words.
    pub of: String,
    /// Name of the parameter.
    pub parameter: String,
    /// Run that recommended it.
    pub recommended_by: String,
    /// Value in the logs that the recommendation follows from, s; `None` if those logs do not say it.
    pub was_s: Option<f64>,
    /// Recommended value, s.
    pub recommended_s: f64,
    /// Value in the later logs, s; `None` if it was not set.
    pub set_s: Option<f64>,
    /// Residual before, s; `None` if the logs do not say the parameter.
    pub before_s: Option<Estimate>,
    /// Residual that the set value predicts, s; with `set_s` absent the one that the recommended value predicts.
    pub predicted_s: Estimate,
    /// Residual measured on the flights after it, s; `None` without such a flight.
    pub measured_s: Option<Estimate>,
    /// Flights that measured it.
    pub flights: Vec<NamedFlight>,
    /// Whether they agree.
    pub verdict: ProofVerdict,
    /// The verdict in a sentence or two.
    pub words: String,
}

/// A log that a night left for the next one.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct LeftLog {
    /// Name of the campaign.
    pub campaign: String,
    /// Path of the log below the campaign's folder.
    pub path: String,
    /// Why.
    pub reason: String,
}

/// One campaign of a night.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct NightCampaign {
    /// Name of the campaign.
    pub name: String,
    /// Folder of its logs.
    pub flights: String,
    /// Its report, relative to the page of the night; empty if there is none yet.
    pub report: String,
    /// Counts over all flights; `None` if the campaign failed.
    pub totals: Option<CampaignTotals>,
    /// Flights that fail a criterion.
    pub criteria_failed: u64,
    /// Exit code of this campaign.
    pub exit: u8,
    /// Why the campaign failed; `None` if it did not.
    pub error: Option<String>,
    /// Whether the campaign had nothing to do.
    pub nothing_changed: bool,
}

/// Flights of one receiver that do not share one delay.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct NightGroup {
    /// Name of the campaign.
    pub campaign: String,
    /// The group.
    pub group: String,
    /// In what its flights differ.
    pub words: String,
    /// Whether they shared one delay in the report before.
    pub is_new: bool,
}

/// Everything that a night found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct NightRecord {
    /// [`crate::RECORD_VERSION`].
    pub record_version: u32,
    /// Name of the night.
    pub title: String,
    /// Name of the run: its start, UTC.
    pub run_id: String,
    /// Start, UTC.
    pub started: String,
    /// Time that it took, s.
    pub seconds: f64,
    /// Version of flightlag.
    pub flightlag_version: String,
    /// The run before; `None` for the first.
    pub before: Option<String>,
    /// Exit code of the night.
    pub exit: u8,
    /// The summary: five lines.
    pub summary: Vec<String>,
    /// Campaigns in the order of the nightly file.
    pub campaigns: Vec<NightCampaign>,
    /// What changed since the night before.
    pub changes: RunChanges,
    /// Logs that are left for the next night.
    pub left: Vec<LeftLog>,
    /// Groups whose flights do not share one delay, so that no value for all of them is recommended.
    #[serde(default)]
    pub groups: Vec<NightGroup>,
    /// Changes of a trend that the night before did not show, with the chart: `receiver u-blox M8`.
    pub new_trend_changes: Vec<NewTrendChange>,
    /// Charts with a change, and how many charts there are.
    pub trend: TrendRecord,
    /// Recommended settings and the flights after them.
    pub proofs: Vec<SettingProof>,
    /// What went wrong with the night itself, such as a history file that cannot be read.
    pub problems: Vec<String>,
}

/// A change of a trend that is new.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct NewTrendChange {
    /// Chart that shows it: `receiver u-blox M8`.
    pub chart: String,
    /// The change.
    #[serde(flatten)]
    pub change: TrendChange,
}

/// Two reports side by side.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DiffRecord {
    /// [`crate::RECORD_VERSION`].
    pub record_version: u32,
    /// The first report.
    pub before: ComparedReport,
    /// The second report.
    pub now: ComparedReport,
    /// What of the settings differs, a line each, as `delay.position_s: was 0.4, is 0.35`.
    pub settings: Vec<String>,
    /// What changed.
    pub changes: RunChanges,
    /// Groups whose mean lateness moved by more than two standard uncertainties.
    pub moved_groups: Vec<crate::MovedDelay>,
}

/// One of two reports that are compared.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ComparedReport {
    /// Its folder.
    pub folder: String,
    /// Name of the campaign.
    pub name: String,
    /// Flights in it.
    pub flights: u64,
    /// Version of flightlag.
    pub flightlag_version: String,
    /// Version of the analysis.
    pub analysis_version: u32,
    /// Title of the settings.
    pub settings: String,
    /// Hash of the settings.
    pub settings_blake3: String,
    /// Hash of the criteria; `None` without criteria.
    pub criteria_blake3: Option<String>,
}
