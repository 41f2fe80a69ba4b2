//! One lateness per channel: the delay network of a flight, the pool of a group, and the delay that is removed.
//!
//! Source of all of it: the delay-network specification (`science/delay-network.md`); sections are named in the docs.

use crate::replay::Estimate;
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Zero of the latenesses of a network or of a part of it (section 3).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum NetworkDatum {
    /// Accelerations of the IMU are on time within 5 ms by assumption.
    Imu,
    /// A reference of its own clock (truth, motion capture, RTK), used because the user asked for it.
    Reference,
    /// Nothing ties the channels to true time: figures are relative to one channel.
    None,
    /// A channel would be earlier than the IMU, which causality forbids: figures are relative to one channel.
    Refused,
}

/// Outcome of the tests of a network (section 4).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum NetworkVerdict {
    /// All loops close within their uncertainty.
    Consistent,
    /// There is no loop: no pair is checked by another.
    Unchecked,
    /// A loop failed, one effect alone explains it, and its pairs no longer count.
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
    /// Channels, in the order of their names.
    pub channels: Vec<ChannelLateness>,
    /// Covariance of the latenesses, s², rows and columns in the order of `channels`. Differences need all of it.
    /// Birge's ratio is included.
    pub covariance_s2: Vec<Vec<f64>>,
    /// Datum of the whole network; with several parts that of the best tied part, `refused` if any part is.
    pub datum: NetworkDatum,
    /// What the latenesses refer to and what that hides, in words.
    pub datum_words: String,
    /// Outcome of the closure tests.
    pub verdict: NetworkVerdict,
    /// Verdict in words.
    pub verdict_words: String,
    /// Effects found wrong. Their pairs no longer carry any weight.
    pub named: Vec<EffectName>,
    /// Effects of which one is wrong, without a way to say which. Nothing is freed.
    pub undecided_between: Vec<EffectName>,
    /// Closure test after freeing the named effects, χ²; 0 without a loop.
    pub chi2: f64,
    /// Degrees of freedom of the closure test.
    pub degrees_of_freedom: u32,
    /// Probability of a χ² at least as large; `None` without a degree of freedom.
    pub p: Option<f64>,
    /// Factor on all uncertainties: above 1 only with verdict `scattered`.
    pub birge: f64,
    /// Fundamental loops: one per pair that is not in the spanning tree of least uncertainty.
    pub loops: Vec<DelayLoop>,
    /// Effects with their tests.
    pub effects: Vec<NetworkEffect>,
    /// Pairs used, in the order of kind and names.
    pub used_pairs: Vec<UsedPair>,
    /// Pairs not used, with the reason.
    pub unused_pairs: Vec<UnusedPair>,
    /// Pairs that would tie separate parts together or give a datum.
    pub suggestions: Vec<PairSuggestion>,
    /// Latenesses against references that did not take part.
    pub judged: Vec<ReferenceJudgement>,
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
    /// Lateness, s: positive is late. Against the datum, or relative to `relative_to`. 0 ± 0 for the zero itself.
    /// With verdict `undecided` nothing may be removed from it: use `interval_95_s`.
    pub lateness_s: Estimate,
    /// Part of the uncertainty that comes from model errors and datum, s: it does not average out over flights.
    pub model_uncertainty_s: f64,
    /// 95 % interval, s. With verdict `undecided` the hull over all suspects.
    pub interval_95_s: [f64; 2],
    /// Connected part of the network, from 0.
    pub part: u32,
    /// Datum of this part.
    pub datum: NetworkDatum,
    /// Channel that is zero by convention; `None` where a datum holds. Such figures are never called "late".
    pub relative_to: Option<String>,
    /// Whether the channel is made from others (a filter's output).
    pub derived: bool,
    /// Whether the model part exceeds 20 ms: the only way to the datum leads through a filter that is made from it.
    pub weak: bool,
    /// Lower bound of the lateness, s. If weak: value less twice the part of U that is not model, for the model error
    /// is one-sided. If the datum was refused: value less that of the earliest channel.
    pub at_least_s: Option<f64>,
    /// Lateness against its own IMU, s, where that differs from the lateness that positions see by more than
    /// 3 standard uncertainties: a filter, not a delay.
    pub filter_not_a_delay: Option<Estimate>,
    /// Whether this channel came out earlier than the datum, which refuses the datum.
    pub earlier_than_datum: bool,
    /// Lateness against the refused datum, s; only where the datum was refused.
    pub against_refused_datum_s: Option<Estimate>,
    /// What carries more than half of this figure and is checked by no other pair, as
    /// `velocity.gps against acceleration, unchecked`.
    pub rests_on: Option<String>,
}

/// Loop of pairs: its delays should add up to zero.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DelayLoop {
    /// Channels in the order of the walk; the last is tied to the first.
    pub channels: Vec<String>,
    /// Sum of the delays along the walk, s, and the uncertainty that the model allows it.
    pub misclosure_s: Estimate,
}

/// Effect with its test and its reliability.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct NetworkEffect {
    /// Name.
    pub name: EffectName,
    /// Standard deviation assumed for it, s.
    pub model_s: f64,
    /// Pairs that share it.
    pub pairs: u32,
    /// Test value of data snooping, a standard normal variable if nothing is wrong; `None` if no pair checks it.
    pub w: Option<f64>,
    /// Size of the error if this effect alone were wrong, s; `None` if no pair checks it.
    pub size_s: Option<f64>,
    /// Share of an error in this effect that the residuals show: 0 is unchecked, 1 is fully checked.
    pub redundancy: f64,
    /// Least error found with 80 % probability at 0.1 % false alarms (Baarda, δ₀ = 4.13), s; `None` if unchecked.
    pub least_error_found_s: Option<f64>,
}

/// Pair that took part.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct UsedPair {
    /// First channel.
    pub first: String,
    /// Second channel.
    pub second: String,
    /// Measured delay, s: lateness of the first less that of the second.
    pub delay_s: Estimate,
    /// Delay less what the network says, s.
    pub residual_s: f64,
    /// Effect that it belongs to.
    pub effect: EffectName,
}

/// Pair that did not take part.
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

/// Pair that would improve the network.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct PairSuggestion {
    /// First channel, or a channel to log.
    pub first: String,
    /// Second channel, or a channel to log.
    pub second: String,
    /// What it would give, and what stands in its way, in words.
    pub words: String,
}

/// Lateness judged by a reference that took no part in it (section 3.4).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ReferenceJudgement {
    /// Channel judged.
    pub channel: String,
    /// Reference.
    pub reference: String,
    /// Lateness against the reference, s.
    pub reference_s: Estimate,
    /// Network less reference, s.
    pub error_s: Estimate,
    /// `|error| / (1.96 u)`: at most 1 is agreement.
    pub e_n: f64,
}

/// Mean lateness of one channel over the flights of a group (section 5).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DelayPool {
    /// Flights in the mean.
    pub flights: u32,
    /// Mean lateness, s, with the common part in its uncertainty.
    pub mean_s: Estimate,
    /// 95 % interval of the mean, s (Hartung–Knapp, common part added).
    pub interval_95_s: [f64; 2],
    /// Half of its width, s.
    pub half_width_95_s: f64,
    /// Interval that the next flight's delay lies in with 95 % probability, s; `None` for one flight.
    pub prediction_95_s: Option<[f64; 2]>,
    /// Standard deviation between flights beyond their own measurement part, s (REML); `None` for one flight.
    pub tau_s: Option<f64>,
    /// Model part shared by all flights, s: it does not average out.
    pub common_s: f64,
    /// Test whether flights differ; `None` for one flight.
    pub difference: Option<FlightsDiffer>,
    /// Every flight against the pool of the others.
    pub members: Vec<PoolMember>,
    /// Two clusters, if the group is not one; then the mean describes neither.
    pub split: Option<GroupSplit>,
    /// The flights that are no outliers; `None` without outliers, and where the others are not the larger part.
    pub without_outliers: Option<PoolMean>,
}

/// Mean of some flights of a group.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct PoolMean {
    /// Flights in the mean.
    pub flights: u32,
    /// Mean lateness, s, with the common part in its uncertainty.
    pub mean_s: Estimate,
    /// Half of the width of its 95 % interval, s.
    pub half_width_95_s: f64,
    /// Standard deviation between flights beyond their own measurement part, s; `None` for one flight.
    pub tau_s: Option<f64>,
}

impl DelayPool {
    /// Flights that surely differ, and whose spread is more than this, s and as a share of the mean, have no one delay.
    const MOST_SPREAD_S: f64 = 0.015;
    const MOST_SPREAD_SHARE: f64 = 0.05;
    const SURELY: f64 = 1e-3;

    /// The mean that describes the group: of the flights that are no outliers. `None` where too few are left, and where they
    /// differ so much that it describes none of them.
    #[must_use]
    pub fn described(&self) -> Option<PoolMean> {
        self.without_its_outliers().filter(|mean| !self.differ_about(mean))
    }

    /// Whether the flights differ so much that no mean describes them: of three delays in a group none is an outlier.
    #[must_use]
    pub fn has_no_mean(&self) -> bool {
        self.without_its_outliers().is_some_and(|mean| self.differ_about(&mean))
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

/// Test of heterogeneity with the full uncertainties less the datum's.
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
    /// Externally studentised difference to the others.
    pub z: Option<f64>,
    /// Whether |z| > 3.
    pub outlier: bool,
}

/// Two clusters in what was taken for one group.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct GroupSplit {
    /// Flights of the earlier cluster.
    pub early: Vec<String>,
    /// Flights of the later cluster.
    pub late: Vec<String>,
    /// Mean lateness of the earlier cluster, s.
    pub early_s: Estimate,
    /// Mean lateness of the later cluster, s.
    pub late_s: Estimate,
    /// Empty gap between the clusters, s.
    pub gap_s: f64,
    /// Upper bound of the probability that one normal group looks this divided.
    pub p: f64,
    /// In words.
    pub words: String,
}

/// Source of the delay that is removed (section 6).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum RemovedFrom {
    /// Mean of the other flights of the group.
    OthersFlights,
    /// The flight's own delay network.
    OwnNetwork,
    /// The sensor card.
    Card,
    /// The number stated in the pipeline.
    Stated,
    /// Position less velocity of this flight.
    Pair,
    /// The best delay of the sweep against the flight's reference.
    Sweep,
    /// Nothing is removed.
    None,
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
    /// Row of the decision table, 1 to 10; 0 where the user fixed the source and no row speaks of it.
    pub row: u8,
    /// Source of the value.
    pub source: RemovedFrom,
    /// Whether the value comes from this flight itself, so that a small residual proves nothing.
    pub circular: bool,
    /// What was done and why, in plain English.
    pub words: String,
    /// Other flights in the mean.
    pub pooled_flights: u32,
    /// Externally studentised difference of the flight's own network to the other flights.
    pub z: Option<f64>,
    /// E_n between the card and the flights; `None` without either.
    pub card_e_n: Option<f64>,
    /// E_n between the value removed and the reference; `None` without either.
    pub reference_e_n: Option<f64>,
    /// What the flights say against the number that was stated or the card that was asked for; `None` if nothing does.
    pub contradicted: Option<String>,
}
