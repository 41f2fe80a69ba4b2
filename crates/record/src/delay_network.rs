//! One lateness per channel: the delay network of a flight, the pool of a group, and the delay that is removed.
//!
//! Implements the data of the delay-network specification (`science/delay-network.md`); the docs name its sections.

use crate::replay::Estimate;
use crate::sweep::DelaySource;
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Zero of the latenesses of a network or of a part of it (section 3).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum NetworkDatum {
    /// IMU accelerations are assumed to be on time within 5 ms.
    Imu,
    /// A reference with its own clock (truth, motion capture, RTK), used because the user asked for it.
    Reference,
    /// Nothing ties the channels to true time: values are relative to one channel.
    None,
    /// A channel would be earlier than the IMU, which causality forbids: values are relative to one channel.
    Refused,
}

/// Outcome of the tests of a network (section 4).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum NetworkVerdict {
    /// All loops close within their uncertainty.
    Consistent,
    /// There is no loop, so no pair checks another.
    Unchecked,
    /// A loop failed and one effect alone explains it. The pairs of that effect are no longer used.
    Named,
    /// A loop failed and several effects explain it equally well: intervals cover all of them.
    Undecided,
    /// A loop failed and no single effect explains it: intervals are widened by the Birge ratio.
    Scattered,
}

/// Kind of the model error of a pair (table of section 2).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum EffectKind {
    /// Two measured channels (`ss`).
    MeasuredMeasured,
    /// A measured and a derived channel (`sd`).
    MeasuredDerived,
    /// Two derived channels (`dd`).
    DerivedDerived,
    /// A measured velocity and an acceleration (`sacc`).
    MeasuredAcceleration,
    /// A derived velocity and an acceleration (`dacc`).
    DerivedAcceleration,
    /// A measured channel and a reference (`sref`).
    MeasuredReference,
    /// A derived channel and a reference (`dref`).
    DerivedReference,
}

/// Name of an effect: one draw of the model error, shared by all pairs between two families of channels.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct EffectName {
    /// Kind of pair.
    pub kind: EffectKind,
    /// Family of the first channel, such as `position.gps`.
    pub first: String,
    /// Family of the second channel, such as `velocity.ekf`; `acc` for all accelerations.
    pub second: String,
}

/// Result of the delay network of one flight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DelayNetwork {
    /// Channels, sorted by name.
    pub channels: Vec<ChannelLateness>,
    /// Covariance of the latenesses, s², rows and columns in the order of `channels`. Differences need the full matrix.
    /// The Birge ratio is included.
    pub covariance_s2: Vec<Vec<f64>>,
    /// Datum of the whole network. With several parts, the datum of the best-tied part, or `refused` if it is refused
    /// for any part.
    pub datum: NetworkDatum,
    /// What the latenesses refer to and what this datum hides, in words.
    pub datum_words: String,
    /// Outcome of the closure tests.
    pub verdict: NetworkVerdict,
    /// Verdict in words.
    pub verdict_words: String,
    /// Effects found wrong. Their pairs no longer have any weight.
    pub named: Vec<EffectName>,
    /// Suspect effects: one is wrong, but it is unknown which. No effect is freed.
    pub undecided_between: Vec<EffectName>,
    /// Closure test after freeing the named effects, χ²; 0 without a loop.
    pub chi2: f64,
    /// Degrees of freedom of the closure test.
    pub degrees_of_freedom: u32,
    /// Probability of a χ² at least as large; `None` without a degree of freedom.
    pub p: Option<f64>,
    /// Factor applied to all uncertainties: above 1 only with verdict `scattered`.
    pub birge: f64,
    /// Effects with their tests.
    pub effects: Vec<NetworkEffect>,
    /// Pairs used, sorted by kind and names.
    pub used_pairs: Vec<UsedPair>,
    /// Pairs not used, with the reason.
    pub unused_pairs: Vec<UnusedPair>,
}

/// Whether an interval begins near its number, so that number ± U is not the interval: that of a filter against its own
/// IMU.
#[must_use]
pub fn is_one_sided(value: f64, [low, high]: [f64; 2]) -> bool {
    value - low < 0.5 * (high - value)
}

impl DelayNetwork {
    /// Lateness of the named channel.
    #[must_use]
    pub fn channel(&self, name: &str) -> Option<&ChannelLateness> {
        self.channels.iter().find(|channel| channel.channel == name)
    }
}

/// Lateness of one channel.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ChannelLateness {
    /// Channel name, such as `position.gps`, or `acc[ahrs2+imu]` for attitude and specific force together.
    pub channel: String,
    /// Lateness, s: positive is late. Against the datum, or relative to `relative_to`. 0 ± 0 for the zero itself. With
    /// verdict `undecided`, do not use it to remove a delay: use `interval_95_s`.
    pub lateness_s: Estimate,
    /// Part of the uncertainty due to model errors and datum, s. It does not average out over flights.
    pub model_uncertainty_s: f64,
    /// 95 % interval, s. With verdict `undecided`, the hull over all suspects.
    pub interval_95_s: [f64; 2],
    /// Index of the connected part of the network, from 0.
    pub part: u32,
    /// Datum of this part.
    pub datum: NetworkDatum,
    /// Channel that is zero by convention; `None` where a datum is available. Such values are never called "late".
    pub relative_to: Option<String>,
    /// Whether the channel is derived from others (a filter's output).
    pub derived: bool,
    /// Whether the model part exceeds 20 ms: the only path to the datum is through a filter derived from it.
    pub weak: bool,
    /// Lower bound of the lateness, s. If weak: value less twice the non-model part of U, because the model error is
    /// one-sided. If the datum was refused: value less that of the earliest channel.
    pub at_least_s: Option<f64>,
    /// Lateness against its own IMU, s, where it differs from the lateness seen by positions by more than 3 standard
    /// uncertainties: a filter, not a delay.
    pub filter_not_a_delay: Option<Estimate>,
    /// Whether this channel is earlier than the datum, so that the datum is refused.
    pub earlier_than_datum: bool,
    /// Lateness against the refused datum, s; only where the datum was refused.
    pub against_refused_datum_s: Option<Estimate>,
    /// Pair that determines more than half of this value and is not checked by another, such as `velocity.gps against
    /// acceleration, unchecked`.
    pub rests_on: Option<String>,
}

/// Effect with its test and its reliability.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct NetworkEffect {
    /// Name.
    pub name: EffectName,
    /// Its assumed standard deviation, s.
    pub model_s: f64,
    /// Pairs that share it.
    pub pairs: u32,
    /// Test value of data snooping, a standard normal variable if nothing is wrong; `None` if no pair checks it.
    pub w: Option<f64>,
    /// Size of the error if this effect alone were wrong, s; `None` if no pair checks it.
    pub size_s: Option<f64>,
    /// Share of an error in this effect that appears in the residuals: 0 is unchecked, 1 is fully checked.
    pub redundancy: f64,
    /// Smallest error detected with 80 % probability at 0.1 % false alarms (Baarda, δ₀ = 4.13), s; `None` if unchecked.
    pub least_error_found_s: Option<f64>,
}

/// Pair that was used.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct UsedPair {
    /// First channel.
    pub first: String,
    /// Second channel.
    pub second: String,
    /// Measured delay, s: lateness of the first less that of the second.
    pub delay_s: Estimate,
    /// Delay less the network's estimate, s.
    pub residual_s: f64,
    /// Effect to which it belongs.
    pub effect: EffectName,
}

/// Pair that was not used.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct UnusedPair {
    /// First channel.
    pub first: String,
    /// Second channel.
    pub second: String,
    /// Reason.
    pub why: String,
}

/// Mean lateness of one channel over the flights of a group (section 5).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DelayPool {
    /// Number of flights in the mean.
    pub flights: u32,
    /// Mean lateness, s, with the common part in its uncertainty.
    pub mean_s: Estimate,
    /// 95 % interval of the mean, s (Hartung–Knapp, common part added).
    pub interval_95_s: [f64; 2],
    /// Half of its width, s.
    pub half_width_95_s: f64,
    /// Standard deviation between flights in excess of their own measurement part, s (REML); `None` for one flight.
    pub tau_s: Option<f64>,
    /// Model part shared by all flights, s: it does not average out.
    pub common_s: f64,
    /// Test whether flights differ; `None` for one flight.
    pub difference: Option<FlightsDiffer>,
    /// Each flight against the pool of the others.
    pub members: Vec<PoolMember>,
    /// Two clusters, if the group is divided; the mean then describes neither.
    pub split: Option<GroupSplit>,
    /// Mean without the outliers; `None` without outliers, or where the remaining flights are not the majority.
    pub without_outliers: Option<PoolMean>,
}

/// Mean of some flights of a group.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct PoolMean {
    /// Number of flights in the mean.
    pub flights: u32,
    /// Mean lateness, s, with the common part in its uncertainty.
    pub mean_s: Estimate,
    /// Half of the width of its 95 % interval, s.
    pub half_width_95_s: f64,
    /// Standard deviation between flights in excess of their own measurement part, s; `None` for one flight.
    pub tau_s: Option<f64>,
}

impl DelayPool {
    /// Limits of the spread, s and as a share of the mean. Flights that significantly differ by more do not share one
    /// delay.
    const MOST_SPREAD_S: f64 = 0.015;
    const MOST_SPREAD_SHARE: f64 = 0.05;
    const SURELY: f64 = 1e-3;

    /// The mean that describes the group, without outliers. `None` where too few flights are left, or where they differ
    /// so much that the mean describes none of them: if a group has three different delays, no delay is an outlier; if it
    /// has two, both are.
    #[must_use]
    pub fn described(&self) -> Option<PoolMean> {
        self.without_its_outliers().filter(|mean| !self.differ_about(mean))
    }

    fn without_its_outliers(&self) -> Option<PoolMean> {
        match self.members.iter().any(|member| member.outlier) {
            true => self.without_outliers,
            false => Some(PoolMean {
                flights: self.flights,
                mean_s: self.mean_s,
                half_width_95_s: self.half_width_95_s,
                tau_s: self.tau_s,
            }),
        }
    }

    fn differ_about(&self, mean: &PoolMean) -> bool {
        let surely = self.difference.is_some_and(|test| test.p < Self::SURELY);
        let most_s = Self::MOST_SPREAD_S.max(Self::MOST_SPREAD_SHARE * mean.mean_s.value.abs());
        surely && mean.tau_s.is_some_and(|tau_s| tau_s > most_s)
    }
}

/// Test of heterogeneity, with the full uncertainties except the datum's.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct FlightsDiffer {
    /// Cochran's Q.
    pub q: f64,
    /// Degrees of freedom.
    pub degrees_of_freedom: u32,
    /// Probability of a Q at least as large if all flights have one delay.
    pub p: f64,
    /// Share of the variance that lies between flights, 0 to 1.
    pub i2: f64,
    /// Standard deviation between flights, s (REML).
    pub tau_s: f64,
}

/// One flight against the pool of the others.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct PoolMember {
    /// Flight.
    pub flight: String,
    /// Mean of the others, s; `None` for a single flight.
    pub others_s: Option<Estimate>,
    /// Half width of the 95 % interval of that mean, s.
    pub others_half_width_95_s: Option<f64>,
    /// Externally studentised difference from the others.
    pub z: Option<f64>,
    /// Whether |z| > 3.
    pub outlier: bool,
}

/// Two clusters in an assumed group.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct GroupSplit {
    /// Flights in the earlier cluster.
    pub early: Vec<String>,
    /// Flights in the later cluster.
    pub late: Vec<String>,
    /// Mean lateness of the earlier cluster, s.
    pub early_s: Estimate,
    /// Mean lateness of the later cluster, s.
    pub late_s: Estimate,
    /// Empty gap between the clusters, s.
    pub gap_s: f64,
    /// Upper bound of the probability that one normal group appears this divided.
    pub p: f64,
    /// Summary in words.
    pub words: String,
}

/// Delay that is removed from the position of one flight, and why (table of section 6).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct RemovedDelay {
    /// Flight.
    pub flight: String,
    /// Delay removed, s, on a grid well inside its uncertainty; `None` if the flight is not compensated.
    pub value_s: Option<f64>,
    /// Standard uncertainty of the delay of this flight at this value, s.
    pub standard_uncertainty_s: Option<f64>,
    /// Row of the decision table, 1 to 10; 0 where the user fixed the source and no row applies.
    pub row: u8,
    /// Source of the value; `None` if nothing is removed.
    pub source: Option<DelaySource>,
    /// Whether the value comes from this flight itself, in which case a small residual proves nothing.
    pub circular: bool,
    /// What was done and why, in plain English.
    pub words: String,
    /// Number of other flights in the mean.
    pub pooled_flights: u32,
    /// Externally studentised difference between the flight's own network and the other flights.
    pub z: Option<f64>,
    /// E_n between the card and the flights; `None` without either.
    pub card_e_n: Option<f64>,
    /// Evidence in the flights against the stated value or the requested card; `None` if there is none.
    pub contradicted: Option<String>,
}
