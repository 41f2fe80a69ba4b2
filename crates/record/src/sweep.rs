//! Which delay was removed and why, and the effect of other delays.

use crate::bench::Finding;
use crate::replay::Estimate;
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Where a delay comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum DelaySource {
    /// A number stated in the pipeline.
    Fixed,
    /// A sensor card from the bench.
    Card,
    /// The delay network: the mean of the other flights of the group, otherwise the flight's own lateness.
    Network,
    /// The mean lateness over the other flights of the group.
    OthersFlights,
    /// The flight's own lateness, from its delay network.
    OwnNetwork,
    /// Measured in the flight itself: position against the integral of velocity.
    Flight,
    /// The optimum of the flight's delay sweep.
    Sweep,
}

impl DelaySource {
    /// The name that pipelines, tables and records use.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            DelaySource::Fixed => "fixed",
            DelaySource::Card => "card",
            DelaySource::Network => "network",
            DelaySource::OthersFlights => "others-flights",
            DelaySource::OwnNetwork => "own-network",
            DelaySource::Flight => "flight",
            DelaySource::Sweep => "sweep",
        }
    }
}

/// A delay that could be removed, or why this source has no delay for the flight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DelayCandidate {
    /// Its source.
    pub source: DelaySource,
    /// Delay of position against velocity, s; positive is late.
    pub delay_s: Finding<Estimate>,
    /// Where exactly it comes from, in words; empty if there is no delay.
    pub words: String,
}

/// Which of several delays was removed, and why.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DelayChoice {
    /// The source that the pipeline asks for.
    pub asked: DelaySource,
    /// The source that was used.
    pub used: DelaySource,
    /// The reason, in a sentence.
    pub why: String,
    /// The delay was estimated from the same data that it is removed from. The residual delay of these data is zero by
    /// construction.
    pub circular: bool,
    /// The delays that were considered, the one used first.
    pub candidates: Vec<DelayCandidate>,
    /// How far the others, and the optimum of the sweep, are from the one used.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub differences: Vec<DelayDifference>,
}

/// A delay compared with the one that is removed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DelayDifference {
    /// Its source.
    pub source: DelaySource,
    /// E_n of ISO 13528, positive if it is later than the removed one. They agree if |E_n| is at most 1.
    pub e_n: f64,
}

impl DelayChoice {
    /// Compares the delays found with the one removed. A delay is not compared with itself. A delay of position against
    /// velocity is not compared with a lateness: both may be correct and still differ.
    pub fn compare(&mut self, sweep: Option<&DelaySweep>) {
        let comparable = |source| source != self.used && ![source, self.used].contains(&DelaySource::Flight);
        let removed = self.candidates.iter().find(|c| c.source == self.used).and_then(|c| c.delay_s.found());
        let Some(removed) = removed else { return };
        // Without a reference the optimum is the difference to the velocity, which is not a lateness.
        let of_reference = |s: &&DelaySweep| matches!(s.score, SweepScore::ErrorAgainst(_));
        let best = sweep.filter(of_reference).and_then(|s| s.optimum.found());
        let best = best.map(|best| (DelaySource::Sweep, best.delay_s));
        let best = best.filter(|_| self.candidates.iter().all(|c| c.source != DelaySource::Sweep));
        let found = self.candidates.iter().filter_map(|c| Some((c.source, *c.delay_s.found()?)));
        self.differences = found
            .filter(|(source, _)| comparable(*source))
            .chain(best)
            .filter_map(|(source, delay)| Some(DelayDifference { source, e_n: delay.normalised_difference(removed)? }))
            .collect();
    }

    /// E_n of this source's delay against the removed one, where they can be compared.
    #[must_use]
    pub fn e_n(&self, source: DelaySource) -> Option<f64> {
        self.differences.iter().find(|d| d.source == source).map(|d| d.e_n)
    }
}

/// The quantity that a sweep scores.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum SweepScore {
    /// 2-D error of the exact asynchronous form against this reference channel.
    ErrorAgainst(String),
    /// 2-D step of the exact asynchronous form at each fix, because there is no reference.
    StepAtFixes,
}

/// The score of one flight as a function of the delay removed. All delays are scored on the same samples.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DelaySweep {
    /// The quantity scored.
    pub score: SweepScore,
    /// Output rows (against a reference) or fixes that were scored.
    pub samples: u64,
    /// Delays, s, in ascending order.
    pub delay_s: Vec<f64>,
    /// 2-D rms at each delay, m.
    pub rms_m: Vec<f64>,
    /// The score at the delay of each source, once per source. The entry of the sweep is the optimum.
    pub at: Vec<SweepPoint>,
    /// The delay that fits the flight best.
    pub optimum: Finding<SweepOptimum>,
}

/// The score at one delay.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct SweepPoint {
    /// The source of this delay.
    pub source: DelaySource,
    /// The delay, s.
    pub delay_s: Estimate,
    /// 2-D rms at this delay, m. Its uncertainty includes that of the sample and that of the delay.
    pub rms_m: Estimate,
}

/// How the best delay and its interval were found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum SweepMethod {
    /// Least squares against the reference; interval by a delete-one jackknife over consecutive blocks, which allows
    /// for errors whose correlation is much shorter than a block.
    Jackknife,
    /// No reference: the minimum of the delay estimator's objective, with the estimator's own interval.
    Estimator,
}

/// The delay that fits best.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct SweepOptimum {
    /// Delay, s.
    pub delay_s: Estimate,
    /// 95 % interval, s.
    pub interval_95_s: [f64; 2],
    /// How it was found.
    pub method: SweepMethod,
}

impl DelaySweep {
    /// The score at the delay of this source, for a criterion such as "would this flight have met it at the bench
    /// value?"
    #[must_use]
    pub fn score_at(&self, source: DelaySource) -> Option<&SweepPoint> {
        self.at.iter().find(|point| point.source == source)
    }
}

/// Delays over the flights of a campaign.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct CampaignDelay {
    /// From the delays measured in the flights themselves.
    pub measured: Finding<DelayOverFlights>,
    /// From the optima of the flights' sweeps.
    pub swept: Finding<DelayOverFlights>,
    /// The sensor card's value, s, if it is the same for all flights.
    pub card_s: Option<Estimate>,
    /// The measured delays in the order flown, with their limits. Not in the JSON, because there is one for each
    /// flight.
    #[serde(skip)]
    pub control: Vec<ControlPoint>,
    /// Whether that order is chronological; otherwise it is the order of the names.
    pub in_time_order: bool,
    /// The score of all flights together as a function of one common delay.
    pub curve: Finding<PooledSweep>,
}

/// One delay from many flights.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DelayOverFlights {
    /// Flights that have a delay.
    pub flights: u64,
    /// Random-effects mean, s.
    pub delay_s: Estimate,
    /// Standard deviation between flights in excess of their own uncertainties, s; `None` for one flight.
    pub between_s: Option<f64>,
    /// The hypothesis of one delay for all flights; `None` for one flight.
    pub homogeneity: Option<FlightHomogeneity>,
}

/// A test of one delay for all flights.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct FlightHomogeneity {
    /// Chi-squared.
    pub chi2: f64,
    /// Degrees of freedom.
    pub degrees_of_freedom: u64,
    /// Probability of a value at least this large by chance.
    pub p: f64,
}

/// A flight's delay on the control chart.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ControlPoint {
    /// The flight's name.
    pub flight: String,
    /// UTC start time, if its clock knows the date.
    pub flown_at: Option<String>,
    /// Its delay, s.
    pub delay_s: Estimate,
    /// Expected value, s: the card's value, otherwise the mean over the flights.
    pub centre_s: f64,
    /// Three standard uncertainties of the difference, s.
    pub limit_s: f64,
    /// The difference exceeds that limit.
    pub is_outside: bool,
}

/// Mean square, pooled over the samples of all flights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct PooledSweep {
    /// Whether errors against a reference are pooled, or steps at fixes.
    pub against_reference: bool,
    /// Number of flights.
    pub flights: u64,
    /// Number of their samples.
    pub samples: u64,
    /// Delays, s, in ascending order.
    pub delay_s: Vec<f64>,
    /// 2-D rms, m.
    pub rms_m: Vec<f64>,
}
