//! How late the position of a flight is, what is removed, and whether that helped.

use crate::delay_network::{ChannelLateness, DelayNetwork, FlightsDiffer, NetworkDatum, NetworkVerdict};
use crate::delay_over_time::DelayKind;
use crate::group::{FlightContent, ReceiverGroup};
use crate::replay::Estimate;
use crate::{CampaignDelay, CardUse, DelaySource, Finding, FlightDelays, ReferenceFile};
pub use flight::Gravity;
use flight::{Alarm, Code, Notices};
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What the first stage of a campaign finds of a flight: all delays, before one is removed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct MeasuredFlight {
    /// [`crate::RECORD_VERSION`].
    pub record_version: u32,
    /// Raised by hand when the analysis gives other numbers.
    pub analysis_version: u32,
    /// Hash of inputs, settings of the measurement and analysis version: the name of this result.
    pub key: String,
    /// The answer.
    pub lateness: FlightLateness,
    /// Every pair of channels that was compared; `None` if no channel was bound.
    pub delays: Option<FlightDelays>,
    /// One lateness for each channel; `None` if no pair gave a delay.
    pub network: Option<DelayNetwork>,
    /// Notices of the measurement.
    pub notices: Notices,
}

/// How late the position of one flight is: what a person asks first. Small, so that a decision over many flights is cheap.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct FlightLateness {
    /// Name of the measurement that it is from.
    pub key: String,
    /// Why the log could not be used; `None` if it could.
    pub failed: Option<String>,
    /// Position that is compensated, as `position.gps`.
    pub position: Option<String>,
    /// Velocity that compensates it.
    pub velocity: Option<String>,
    /// Receiver, firmware, rate, map and log kind: flights of one group may share a delay.
    pub group: ReceiverGroup,
    /// Print of the position's samples: the same flight in another container, or a part of it, is found by it.
    pub content: Option<FlightContent>,
    /// What kind of delay it is.
    pub kind: DelayKind,
    /// What was seen beside it: `jitters`, `late-fixes`, `bursts`.
    pub also: Vec<String>,
    /// The answer in a sentence or two.
    pub words: String,
    /// Lateness of the position against `datum`; `None` if it cannot be told.
    pub lateness: Option<ChannelLateness>,
    /// What the lateness is counted from.
    pub datum: NetworkDatum,
    /// The datum for people and tables: `imu`, `reference`, or `relative to velocity.ekf`.
    pub against: String,
    /// What the tests of the network say; `None` without a network.
    pub verdict: Option<NetworkVerdict>,
    /// Position later than the velocity that compensates it, s: a figure of consistency, not what is removed.
    pub position_minus_velocity_s: Option<Estimate>,
    /// What the sensor card says; `None` where the pipeline names none.
    pub card: Option<Finding<CardDelay>>,
    /// The second file of the flight; `None` where the pipeline asks for none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reference_file: Option<ReferenceFile>,
    /// Ground speed, rms over the flight, m/s.
    pub speed_rms_mps: Option<f64>,
    /// Scatter of the delay from fix to fix, standard deviation, s; `None` if none was found.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub jitter_s: Option<f64>,
    /// Change of this lateness for each 0.1 m by which the antenna is ahead of where velocity is taken, s; `None` if the
    /// lever arm is known or does not matter.
    pub lever_arm_s_per_decimetre: Option<f64>,
    /// Other positions of the log, not of a filter, that are late by another amount: counted as `against` says.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub other_receivers: Vec<OtherReceiver>,
    /// What a reader must know of this number, the gravest first.
    pub alarms: Vec<DelayAlarm>,
    /// What to set or to fly.
    pub advice: DelayAdvice,
}

impl FlightLateness {
    /// The kind with what was seen beside it, as `constant+jitters`.
    #[must_use]
    pub fn kind_name(&self) -> String {
        let kind = self.kind.word().replace(" ", "-");
        std::iter::once(kind.as_str()).chain(self.also.iter().map(String::as_str)).collect::<Vec<_>>().join("+")
    }

    /// Lateness of the position, s.
    #[must_use]
    pub fn lateness_s(&self) -> Option<Estimate> {
        self.lateness.as_ref().map(|found| found.lateness_s)
    }
}

/// Another receiver of a flight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct OtherReceiver {
    /// Channel of its position.
    pub channel: String,
    /// How late it is, s.
    pub lateness_s: Estimate,
}

/// What a sensor card says of a flight's position, with the velocity's own delay taken off.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct CardDelay {
    /// Delay, s.
    pub delay_s: Estimate,
    /// Where it comes from, in words.
    pub words: String,
    /// Which card.
    pub card: CardUse,
    /// What is doubtful about it.
    pub notices: Notices,
}

/// Something that a reader must know of a flight's delay.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DelayAlarm {
    /// How grave it is.
    pub gravity: Gravity,
    /// Short stable name, such as `delay-steps`.
    pub code: String,
    /// A sentence.
    pub text: String,
}

impl DelayAlarm {
    /// An alarm of the catalogue.
    #[must_use]
    pub fn of(alarm: Alarm, text: String) -> DelayAlarm {
        DelayAlarm { gravity: alarm.gravity(), code: alarm.name().to_owned(), text }
    }
}

/// All alarms of a flight, the gravest first: those of its delay, and that of the delay that is removed.
#[must_use]
pub fn flight_alarms(lateness: Option<&FlightLateness>, decision: Option<&Decision>) -> Vec<DelayAlarm> {
    let contradicted = decision.and_then(|d| d.contradicted.clone()).map(|text| DelayAlarm {
        gravity: Gravity::Amber,
        code: Code::DelayContradicted.name().to_owned(),
        text,
    });
    let mut all: Vec<DelayAlarm> = lateness.iter().flat_map(|l| l.alarms.clone()).chain(contradicted).collect();
    // That columns were guessed says nothing of the delay itself.
    all.sort_by(|a, b| {
        let key = |alarm: &DelayAlarm| (alarm.gravity, alarm.code == Code::BoundByGuess.name());
        key(a).cmp(&key(b)).then_with(|| a.cmp(b))
    });
    all
}

/// What to do about a delay.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DelayAdvice {
    /// Settings that remove the delay, the pipeline's first.
    pub set: Vec<DelaySetting>,
    /// What to fly so that the next log shows the delay; `None` if this one does.
    pub fly: Option<String>,
}

/// A setting that removes a delay.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DelaySetting {
    /// Its name: `position_s`, `GPS1_DELAY_MS`, `EKF2_GPS_DELAY`.
    pub name: String,
    /// Its value, in the unit of the setting.
    pub value: f64,
    /// Unit: `s` or `ms`.
    pub unit: String,
    /// What to beware of; empty if nothing.
    pub note: String,
    /// Whether the setting does not take this value.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub out_of_range: bool,
}

/// Whether compensation helped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum EffectVerdict {
    /// The position is farther from the truth than before.
    Harmed,
    /// Neither can be shown.
    CannotTell,
    /// Nothing was removed, or too little to matter.
    NoChange,
    /// The position is closer to the truth than before.
    Helped,
}

/// What the effect is judged by.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum JudgedBy {
    /// The error against this reference channel.
    Truth(String),
    /// The lateness that is left, against a datum, times the speed.
    Lateness,
    /// The lateness that is left against this velocity: how late both are is not known.
    Velocity(String),
    /// Nothing: the delay of this flight is not known.
    Nothing,
}

/// What the removal of a delay did to the position, along its own timestamps: the age of a held fix is no part of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct Effect {
    /// The verdict.
    pub verdict: EffectVerdict,
    /// What it is judged by.
    pub judged_by: JudgedBy,
    /// Error before, 2-D rms, m.
    pub error_raw_m: Option<Estimate>,
    /// Error after, 2-D rms, m.
    pub error_compensated_m: Option<Estimate>,
    /// Error with the best delay, 2-D rms, m: what compensation could reach on this flight.
    pub best_m: Option<f64>,
    /// Error after over the best, where that is clearly above 1.
    pub short_by: Option<f64>,
    /// The verdict in a sentence.
    pub words: String,
}

/// What is removed from the position of a flight, decided over all flights of its group.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct Decision {
    /// What the pipeline asks for.
    pub asked: DelaySource,
    /// Row of the decision table (delay-network specification, section 6).
    pub row: u8,
    /// Where the delay comes from; `None` if nothing is removed.
    pub used: Option<DelaySource>,
    /// Delay, s, rounded to a grid well inside its uncertainty; `None` if nothing is removed, or if the sweep tells it.
    pub delay_s: Option<f64>,
    /// Its standard uncertainty, s, rounded up to two digits.
    pub standard_uncertainty_s: Option<f64>,
    /// It was found in the data that it is removed from.
    pub circular: bool,
    /// Why this one, or why none, in a sentence.
    pub words: String,
    /// What contradicts it; `None` if nothing does.
    pub contradicted: Option<String>,
}

/// How late the position is in a group of flights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct GroupLateness {
    /// The group.
    pub group: ReceiverGroup,
    /// Its flights, duplicates counted once.
    pub flights: u64,
    /// Those that tell their lateness. The outliers among them are not in the mean.
    pub pooled: u64,
    /// Mean lateness, s; `None` if no flight tells it.
    pub lateness_s: Option<Estimate>,
    /// 95 % interval of the mean, s.
    pub interval_95_s: Option<[f64; 2]>,
    /// What the lateness is counted from, as [`FlightLateness::against`].
    pub against: String,
    /// Spread between flights beyond their own uncertainties, s.
    pub between_s: Option<f64>,
    /// The group in a sentence: how late, how well known, what differs.
    pub words: String,
    /// Flights that differ from the others.
    pub outliers: Vec<String>,
    /// What to set.
    pub advice: DelayAdvice,
    /// Names of the flights of this group, duplicates left out.
    #[serde(default)]
    pub members: Vec<String>,
    /// Why these flights are not one group: the mean describes neither part, and each part follows as a group of its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub split: Option<String>,
    /// Test whether the flights share one delay; `None` for one flight.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub difference: Option<FlightsDiffer>,
    /// Position against velocity over these flights; `None` if no flight has a sweep or a measured delay, or if they are
    /// not one group.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub consistency: Option<CampaignDelay>,
}

/// What a lateness is counted from, for a sentence: `against the IMU`, `against the reference`, `relative to velocity.gps`. `datum` as
/// in [`FlightLateness::against`].
#[must_use]
pub fn counted_from(datum: &str) -> String {
    match datum {
        "imu" => "against the IMU".to_owned(),
        datum if datum.starts_with("relative") => datum.to_owned(),
        datum => format!("against the {datum}"),
    }
}

impl GroupLateness {
    /// Whether its flights were seen not to share one delay.
    #[must_use]
    pub fn is_apart(&self) -> bool {
        self.split.is_some() || (self.pooled > 1 && self.lateness_s.is_none())
    }

    /// The flights that differ from the others of a group that has one delay otherwise.
    #[must_use]
    pub fn lone_outliers(&self) -> &[String] {
        if self.is_apart() { &[] } else { &self.outliers }
    }
}
