//! Findings of a nightly run: changes since earlier runs, trends, and whether recommended settings worked.

use crate::{CampaignTotals, Estimate, in_the_past};
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// A flight of a campaign, and its page.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct NamedFlight {
    /// Name of the campaign.
    pub campaign: String,
    /// Path of the flight relative to the campaign's folder.
    pub flight: String,
    /// Its page, relative to the page that links to it; `None` without a page.
    pub page: Option<String>,
}

/// Why the result of a flight changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum ChangeCause {
    /// The content of its log changed.
    Log,
    /// The resolved settings changed.
    Settings,
    /// The analysis changed: a different build of flightlag.
    Build,
    /// The criteria changed.
    Criteria,
    /// The flight itself did not change: the removed delay depends on the other flights of its group.
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

/// A flight whose result changed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct RerunCause {
    /// The flight.
    #[serde(flatten)]
    pub flight: NamedFlight,
    /// All causes.
    pub causes: Vec<ChangeCause>,
}

/// A number of a flight that changed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct MovedNumber {
    /// The flight.
    #[serde(flatten)]
    pub flight: NamedFlight,
    /// The number that moved: `lateness`, `position minus velocity`, `error after compensation` or `removed
    /// delay`.
    pub quantity: String,
    /// Unit of both values: `s` or `m`.
    pub unit: String,
    /// Value before.
    pub before: Estimate,
    /// Value now.
    pub now: Estimate,
    /// Difference divided by the root sum of squares of both standard uncertainties, with the sign of now − before. A
    /// model error that both contain is left out.
    /// `None` where one of them is unknown: the value then changed by more than a tenth.
    pub sigmas: Option<f64>,
    /// All causes.
    pub causes: Vec<ChangeCause>,
}

/// Problems or alarms of a flight that are new or gone.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct FlightWords {
    /// The flight.
    #[serde(flatten)]
    pub flight: NamedFlight,
    /// Each in a word or two.
    pub words: Vec<String>,
    /// First line of the error, or what is wrong with a damaged log; `None` if unknown.
    pub error: Option<String>,
    /// Full text of each alarm, in the order of the words; empty for problems, remarks and alarms that are gone.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub texts: Vec<String>,
}

/// A changed recommendation for an autopilot parameter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct MovedAdvice {
    /// The flight.
    #[serde(flatten)]
    pub flight: NamedFlight,
    /// The parameter.
    pub parameter: String,
    /// Value recommended before, s; `None` without a recommendation.
    pub before_s: Option<f64>,
    /// Value recommended now, s; `None` without a recommendation.
    pub now_s: Option<f64>,
}

/// Comparison of two sets of results.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct RunChanges {
    /// Number of flights in both.
    pub compared: u64,
    /// New flights.
    pub new: Vec<NamedFlight>,
    /// What was found in each of them, in their order, in one to three sentences; empty if unknown.
    #[serde(default)]
    pub new_answers: Vec<String>,
    /// Flights that are gone.
    pub gone: Vec<NamedFlight>,
    /// Flights whose result changed.
    pub rerun: Vec<RerunCause>,
    /// Numbers that moved by more than two standard uncertainties, the largest move first, followed by numbers without
    /// an uncertainty that moved by more than a tenth.
    pub moved: Vec<MovedNumber>,
    /// Flights with a new problem, including new flights with a problem, except those that cannot be measured.
    pub failing: Vec<FlightWords>,
    /// New flights that cannot be measured, such as one that does not move. This is not a failure.
    #[serde(default)]
    pub new_not_measurable: Vec<NamedFlight>,
    /// Flights with a problem that is gone.
    pub recovered: Vec<FlightWords>,
    /// Flights whose verdict on the criteria changed, with the causes, except those that newly fail a criterion or have
    /// recovered from one.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub verdicts: Vec<FlightWords>,
    /// New alarms that require action.
    pub alarms_new: Vec<FlightWords>,
    /// Alarms requiring action that are gone.
    pub alarms_cleared: Vec<FlightWords>,
    /// New remarks, which require no action.
    #[serde(default)]
    pub remarks_new: Vec<FlightWords>,
    /// Remarks that are gone.
    #[serde(default)]
    pub remarks_cleared: Vec<FlightWords>,
    /// Flights whose recommended value changed.
    #[serde(default)]
    pub advice: Vec<MovedAdvice>,
}

impl RunChanges {
    /// How many numbers moved by more than two standard uncertainties, and how many without an uncertainty by more than
    /// a tenth.
    #[must_use]
    pub fn moved_counts(&self) -> (usize, usize) {
        let known = self.moved.iter().filter(|moved| moved.sigmas.is_some()).count();
        (known, self.moved.len() - known)
    }

    /// Flights with a new problem that were there before, and new flights with a problem.
    #[must_use]
    pub fn failing_and_new(&self) -> (Vec<FlightWords>, Vec<FlightWords>) {
        let new: BTreeSet<(&str, &str)> =
            self.new.iter().map(|of| (of.campaign.as_str(), of.flight.as_str())).collect();
        let is_new = |of: &NamedFlight| new.contains(&(of.campaign.as_str(), of.flight.as_str()));
        self.failing.iter().cloned().partition(|of| !is_new(&of.flight))
    }

    /// Flights with a problem that is gone, each problem in the past: `was harmed`.
    #[must_use]
    pub fn recovered_from(&self) -> Vec<FlightWords> {
        let past = |of: &FlightWords| FlightWords {
            words: of.words.iter().map(|word| in_the_past(word)).collect(),
            ..of.clone()
        };
        self.recovered.iter().map(past).collect()
    }
}

/// A point of a control chart.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct TrendPoint {
    /// The flight.
    #[serde(flatten)]
    pub flight: NamedFlight,
    /// Time of the flight, UTC; `None` if its log does not know the date. Such flights are ordered by their run.
    pub flown_at: Option<String>,
    /// Lateness, s.
    pub lateness_s: Estimate,
    /// Mean of its segment, s.
    pub centre_s: f64,
    /// Distance of both limits from the centre, s: three standard deviations of this point.
    pub limit_s: f64,
    /// Whether it is outside its limits.
    pub is_outside: bool,
    /// Whether it differs from the flights before and after it, and is therefore excluded from the search for changes.
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
    /// Number of flights included.
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
    /// Time of that flight, UTC.
    pub flown_at: Option<String>,
    /// First flight of the range that contains the step (95 %).
    pub earliest: NamedFlight,
    /// Last flight of that range.
    pub latest: NamedFlight,
    /// Mean after less mean before, s.
    pub step_s: Estimate,
    /// The step divided by its standard uncertainty.
    pub sigmas: f64,
    /// Other changes at the step, such as `firmware: 3.01 → 4.04`.
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
    /// The datum of the lateness.
    pub datum: String,
    /// Standard deviation between flights in excess of their own uncertainties, s.
    pub between_s: f64,
    /// Threshold: a change counts if it lowers the weighted sum of squares by more than this. `None` if there are fewer
    /// than six flights, or if even a lower threshold shows no change.
    pub threshold: Option<f64>,
    /// Number of flights before those in `points`, which are included in the segments.
    pub older_points: u64,
    /// Flights in the order flown.
    pub points: Vec<TrendPoint>,
    /// Segments without a change.
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
    /// False-alarm probability of one chart: it shows a change although there is none.
    pub false_alarm: f64,
    /// Whether that probability covers all repeated evaluations as the chart grows, as needed for nightly runs, and not
    /// only one.
    #[serde(default)]
    pub every_look: bool,
    /// Charts by dimension and value.
    pub charts: Vec<TrendChart>,
    /// Flights that are not on a chart, with the reason: `3 without a lateness`.
    pub left_out: Vec<String>,
    /// Number of charts without a change, which the nightly page omits; 0 on the page of `trend`.
    #[serde(default)]
    pub without_change: u64,
}

/// Whether a recommended setting had the predicted effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum ProofVerdict {
    /// It did not have the predicted effect.
    Fail,
    /// The later flights cannot show it.
    CannotTell,
    /// No later log shows that the parameter was set.
    NotSet,
    /// It had the predicted effect.
    Pass,
}

impl ProofVerdict {
    /// The verdict as shown on pages and in tables.
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

/// A recommended setting and the flights after it. The residual is the lateness less the parameter: the part that the
/// autopilot does not account for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct SettingProof {
    /// Name of the campaign.
    pub campaign: String,
    /// Aircraft and receiver, in words.
    pub of: String,
    /// Name of the parameter.
    pub parameter: String,
    /// Run that made the recommendation.
    pub recommended_by: String,
    /// Value in the logs that led to the recommendation, s; `None` if it is not in those logs.
    pub was_s: Option<f64>,
    /// Recommended value, s.
    pub recommended_s: f64,
    /// Value in the later logs, s; `None` if it was not set.
    pub set_s: Option<f64>,
    /// Residual before, s; `None` if the parameter is not in the logs.
    pub before_s: Option<Estimate>,
    /// Residual predicted for the value set, s; if `set_s` is absent, for the recommended value.
    pub predicted_s: Estimate,
    /// Residual measured on the later flights, s; `None` without such a flight.
    pub measured_s: Option<Estimate>,
    /// Flights that measured it.
    pub flights: Vec<NamedFlight>,
    /// Whether prediction and measurement agree.
    pub verdict: ProofVerdict,
    /// The verdict in a sentence or two.
    pub words: String,
}

/// A log that a nightly run deferred to the next one.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct LeftLog {
    /// Name of the campaign.
    pub campaign: String,
    /// Path of the log relative to the campaign's folder.
    pub path: String,
    /// Reason.
    pub reason: String,
}

/// One campaign of a nightly run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct NightCampaign {
    /// Name of the campaign.
    pub name: String,
    /// Folder of its logs.
    pub flights: String,
    /// Its report, relative to the nightly page; empty if there is no report yet.
    pub report: String,
    /// Counts over all flights; `None` if the campaign failed.
    pub totals: Option<CampaignTotals>,
    /// Number of flights that fail a criterion.
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
    /// How its flights differ.
    pub words: String,
    /// Whether they shared one delay in the previous report, or a new flight is unlike all earlier ones.
    pub is_new: bool,
}

/// All findings of a nightly run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct NightRecord {
    /// [`crate::RECORD_VERSION`].
    pub record_version: u32,
    /// Name of the nightly run.
    pub title: String,
    /// Name of the run: its start, UTC.
    pub run_id: String,
    /// Start, UTC.
    pub started: String,
    /// Duration of the run, s.
    pub seconds: f64,
    /// Version of flightlag.
    pub flightlag_version: String,
    /// The previous run; `None` for the first.
    pub before: Option<String>,
    /// Exit code of the nightly run.
    pub exit: u8,
    /// The summary: five lines.
    pub summary: Vec<String>,
    /// Campaigns in the order of the nightly file.
    pub campaigns: Vec<NightCampaign>,
    /// Changes since the previous nightly run.
    pub changes: RunChanges,
    /// Logs that are deferred to the next nightly run.
    pub left: Vec<LeftLog>,
    /// Groups whose flights do not share one delay, so that no value for all of them is recommended.
    #[serde(default)]
    pub groups: Vec<NightGroup>,
    /// Trend changes that the previous nightly run did not show, with the chart: `receiver u-blox M8`.
    pub new_trend_changes: Vec<NewTrendChange>,
    /// Trend changes that the previous nightly run showed and that the flights do not support any more.
    #[serde(default)]
    pub withdrawn_trend_changes: Vec<NewTrendChange>,
    /// Charts with a change, and how many charts there are.
    pub trend: TrendRecord,
    /// Recommended settings and their effect on later flights.
    pub proofs: Vec<SettingProof>,
    /// Problems of the nightly run itself, such as a history file that cannot be read.
    pub problems: Vec<String>,
}

/// A new or withdrawn change of a trend.
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
    /// Differences of the settings, one line each, such as `delay.position_s: was 0.4, is 0.35`.
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
