//! How late the position of a flight is, which delay is removed, and whether that helped.

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

/// Results of the first stage of a campaign for one flight: all delays, before one is removed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct MeasuredFlight {
    /// [`crate::RECORD_VERSION`].
    pub record_version: u32,
    /// Analysis version, raised by hand when the numbers change.
    pub analysis_version: u32,
    /// Hash of inputs, settings of the measurement and analysis version: the key of this result.
    pub key: String,
    /// The lateness of the flight.
    pub lateness: FlightLateness,
    /// Every pair of channels that was compared; `None` if no channel was bound.
    pub delays: Option<FlightDelays>,
    /// One lateness for each channel; `None` if no pair gave a delay.
    pub network: Option<DelayNetwork>,
    /// Notices of the measurement.
    pub notices: Notices,
}

/// How late the position of one flight is: the first question of a user. It is small, so that decisions over many
/// flights are cheap.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct FlightLateness {
    /// Key of the measurement that it comes from.
    pub key: String,
    /// Why the log could not be used; `None` if it could.
    pub failed: Option<String>,
    /// Position that is compensated, such as `position.gps`.
    pub position: Option<String>,
    /// Velocity that compensates it.
    pub velocity: Option<String>,
    /// Receiver, firmware, rate, channel map and kind of log: flights of one group may share a delay.
    pub group: ReceiverGroup,
    /// Fingerprint of the position samples, used to find the same flight, or part of it, in another container.
    pub content: Option<FlightContent>,
    /// Kind of delay.
    pub kind: DelayKind,
    /// Other findings: `jitters`, `late-fixes`, `bursts`.
    pub also: Vec<String>,
    /// The lateness in a sentence or two.
    pub words: String,
    /// Lateness of the position against `datum`; `None` if it is unknown.
    pub lateness: Option<ChannelLateness>,
    /// The datum of the lateness.
    pub datum: NetworkDatum,
    /// The datum in text and tables: `imu`, `reference`, or `relative to velocity.ekf`.
    pub against: String,
    /// Outcome of the network's tests; `None` without a network.
    pub verdict: Option<NetworkVerdict>,
    /// Lateness of the position relative to the velocity that compensates it, s: a consistency check, not the delay
    /// removed.
    pub position_minus_velocity_s: Option<Estimate>,
    /// Value of the sensor card; `None` if the pipeline does not name a card.
    pub card: Option<Finding<CardDelay>>,
    /// The reference file of the flight; `None` if the pipeline does not request one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reference_file: Option<ReferenceFile>,
    /// Ground speed, rms over the flight, m/s.
    pub speed_rms_mps: Option<f64>,
    /// Horizontal acceleration, rms over the flight, m/s²: changes of the velocity over a second.
    #[serde(default)]
    pub acceleration_rms_mps2: Option<f64>,
    /// Scatter of the delay from fix to fix, standard deviation, s; `None` if no scatter was found.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub jitter_s: Option<f64>,
    /// Change of this lateness for each 0.1 m by which the antenna is ahead of the point at which velocity is measured,
    /// s; `None` if the lever arm is known or does not matter.
    pub lever_arm_s_per_decimetre: Option<f64>,
    /// Other unfiltered positions of the log with a different lateness, relative to the datum in `against`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub other_receivers: Vec<OtherReceiver>,
    /// A reference in the log that checks a relative lateness. It is not the datum, unless the pipeline says that it is
    /// on time.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub checked_against: Option<String>,
    /// Alarms about this number, the most serious first.
    pub alarms: Vec<DelayAlarm>,
    /// Recommended settings or flights.
    pub advice: DelayAdvice,
}

impl FlightLateness {
    /// The kind with the other findings, such as `constant+jitters`.
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

/// Another receiver on the same flight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct OtherReceiver {
    /// Channel of its position.
    pub channel: String,
    /// How late it is, s.
    pub lateness_s: Estimate,
}

/// Sensor card delay for a flight's position, less the velocity's own delay.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct CardDelay {
    /// Delay, s.
    pub delay_s: Estimate,
    /// Source, in words.
    pub words: String,
    /// The card used.
    pub card: CardUse,
    /// Reasons to doubt it.
    pub notices: Notices,
}

/// An alarm about a flight's delay.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DelayAlarm {
    /// Severity.
    pub gravity: Gravity,
    /// Short stable name, such as `delay-steps`.
    pub code: String,
    /// Text, one sentence.
    pub text: String,
}

impl DelayAlarm {
    /// An alarm from the catalogue.
    #[must_use]
    pub fn of(alarm: Alarm, text: String) -> DelayAlarm {
        DelayAlarm { gravity: alarm.gravity(), code: alarm.name().to_owned(), text }
    }
}

/// All alarms of a flight, the most serious first: those about its delay, and the one about the removed delay
/// or about a sensor card that was not used.
#[must_use]
pub fn flight_alarms(lateness: Option<&FlightLateness>, decision: Option<&Decision>) -> Vec<DelayAlarm> {
    let contradicted = decision.and_then(|d| d.contradicted.clone()).map(|text| DelayAlarm {
        gravity: Gravity::Amber,
        code: Code::DelayContradicted.name().to_owned(),
        text,
    });
    let unused_card = decision.zip(lateness).and_then(|(decision, lateness)| match &lateness.card {
        Some(Finding::CannotTell(why)) if decision.asked == DelaySource::Card && decision.used.is_none() => {
            Some(DelayAlarm::of(Alarm::CardNotUsed, why.clone()))
        }
        _ => None,
    });
    let of_delay = lateness.iter().flat_map(|l| l.alarms.clone());
    let mut all: Vec<DelayAlarm> = of_delay.chain(contradicted).chain(unused_card).collect();
    // The alarm about guessed columns sorts last: it says nothing about the delay itself.
    all.sort_by(|a, b| {
        let key = |alarm: &DelayAlarm| (alarm.gravity, alarm.code == Code::BoundByGuess.name());
        key(a).cmp(&key(b)).then_with(|| a.cmp(b))
    });
    all
}

/// Recommendations for a delay.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DelayAdvice {
    /// Settings that remove the delay, those of the pipeline first.
    pub set: Vec<DelaySetting>,
    /// Recommended flight so that the next log shows the delay; `None` if this log does.
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
    /// Its value in the log, or in all logs of a group, in the same unit; `None` if unknown or different.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub in_log: Option<f64>,
    /// Caution; empty if not needed.
    pub note: String,
    /// Whether the setting cannot remove the delay; `note` says why.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub unsuitable: bool,
}

/// Whether compensation helped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum EffectVerdict {
    /// The position is farther from the truth after compensation.
    Harmed,
    /// Neither harm nor help can be shown.
    CannotTell,
    /// Nothing was removed, or too little to matter.
    NoChange,
    /// The position is closer to the truth after compensation.
    Helped,
}

/// Basis on which the effect is judged.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum JudgedBy {
    /// The error against this reference channel.
    Truth(String),
    /// The remaining lateness against a datum, times the speed.
    Lateness,
    /// The remaining lateness against this velocity. The lateness common to both is unknown.
    Velocity(String),
    /// No basis: the delay of this flight is unknown.
    Nothing,
}

/// Effect of removing a delay on the position, at its own timestamps. The age of a held fix is not included.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct Effect {
    /// The verdict.
    pub verdict: EffectVerdict,
    /// Basis of the verdict.
    pub judged_by: JudgedBy,
    /// Error before, 2-D rms, m.
    pub error_raw_m: Option<Estimate>,
    /// Error after, 2-D rms, m.
    pub error_compensated_m: Option<Estimate>,
    /// Error with the best delay, 2-D rms, m: what compensation could achieve on this flight.
    pub best_m: Option<f64>,
    /// Error after divided by the best, where that is clearly above 1.
    pub short_by: Option<f64>,
    /// The verdict in a sentence.
    pub words: String,
}

/// The delay removed from the position of a flight, decided from all flights of its group.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct Decision {
    /// Source requested by the pipeline.
    pub asked: DelaySource,
    /// Row of the decision table (delay-network specification, section 6).
    pub row: u8,
    /// Source of the delay; `None` if nothing is removed.
    pub used: Option<DelaySource>,
    /// Delay, s, rounded to a grid well inside its uncertainty; `None` if nothing is removed. A delay from the sweep is
    /// known once the flight is replayed.
    pub delay_s: Option<f64>,
    /// Its standard uncertainty, s, rounded up to two digits.
    pub standard_uncertainty_s: Option<f64>,
    /// Whether it was estimated from the data that it is removed from.
    pub circular: bool,
    /// Why this delay, or why no delay, in a sentence.
    pub words: String,
    /// Evidence against it; `None` if there is none.
    pub contradicted: Option<String>,
}

/// How late the position is in a group of flights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct GroupLateness {
    /// The group.
    pub group: ReceiverGroup,
    /// Number of its flights, duplicates counted once.
    pub flights: u64,
    /// Number of flights with a known lateness. Outliers among them are not in the mean.
    pub pooled: u64,
    /// Mean lateness, s; `None` if it is unknown for all flights.
    pub lateness_s: Option<Estimate>,
    /// 95 % interval of the mean, s.
    pub interval_95_s: Option<[f64; 2]>,
    /// The datum of the lateness, as in [`FlightLateness::against`].
    pub against: String,
    /// Spread between flights in excess of their own uncertainties, s.
    pub between_s: Option<f64>,
    /// Summary of the group in a sentence: lateness, uncertainty, differences.
    pub words: String,
    /// Flights that differ from the others.
    pub outliers: Vec<String>,
    /// Recommended settings.
    pub advice: DelayAdvice,
    /// Names of the flights of this group, without duplicates.
    #[serde(default)]
    pub members: Vec<String>,
    /// Why these flights are not one group. The mean describes neither part; each part follows as a group of its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub split: Option<String>,
    /// Test whether the flights share one delay; `None` for one flight.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub difference: Option<FlightsDiffer>,
    /// Delay of position against velocity over these flights; `None` if no flight has a sweep or a measured delay, or
    /// if they are not one group.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub consistency: Option<CampaignDelay>,
}

/// The datum of a lateness, as part of a sentence: `against the IMU`, `against the reference`, `relative to
/// velocity.gps`. `datum` as in [`FlightLateness::against`].
#[must_use]
pub fn counted_from(datum: &str) -> String {
    match datum {
        "imu" => "against the IMU".to_owned(),
        datum if datum.starts_with("relative") => datum.to_owned(),
        datum => format!("against the {datum}"),
    }
}

impl GroupLateness {
    /// Whether its flights were found not to share one delay.
    #[must_use]
    pub fn is_apart(&self) -> bool {
        self.split.is_some() || (self.pooled > 1 && self.lateness_s.is_none())
    }

    /// The outlier flights of a group that otherwise shares one delay.
    #[must_use]
    pub fn lone_outliers(&self) -> &[String] {
        if self.is_apart() { &[] } else { &self.outliers }
    }
}
