//! Which delay was removed and why, and what other delays would have done.

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
    /// A number that the pipeline states.
    Fixed,
    /// A sensor card of the bench.
    Card,
    /// The delay network: the mean of the other flights of the group, else the flight's own.
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

/// A delay that could be removed, or why this source has none for the flight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DelayCandidate {
    /// Its source.
    pub source: DelaySource,
    /// Delay of position against velocity, s; positive is late.
    pub delay_s: Finding<Estimate>,
    /// Where exactly it comes from, in words; empty if there is none.
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
    /// Why, in a sentence.
    pub why: String,
    /// The delay was found in the very data that it is removed from: what these data then say of a residual delay is
    /// zero by construction.
    pub circular: bool,
    /// What was looked at: the used one first.
    pub candidates: Vec<DelayCandidate>,
    /// How far the others, and the best of the sweep, are from the used one.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub differences: Vec<DelayDifference>,
}

/// A delay against the one that is removed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DelayDifference {
    /// Its source.
    pub source: DelaySource,
    /// E_n of ISO 13528, positive if it is later than the removed one: up to 1 in size they agree.
    pub e_n: f64,
}

impl DelayChoice {
    /// Compares what was found with what is removed. A delay is not compared with itself, nor a position against a
    /// velocity with a lateness: both may be right and differ.
    pub fn compare(&mut self, sweep: Option<&DelaySweep>) {
        let comparable = |source| source != self.used && ![source, self.used].contains(&DelaySource::Flight);
        let removed = self.candidates.iter().find(|c| c.source == self.used).and_then(|c| c.delay_s.found());
        let Some(removed) = removed else { return };
        let best = sweep.and_then(|s| s.optimum.found()).map(|best| (DelaySource::Sweep, best.delay_s));
        let best = best.filter(|_| self.candidates.iter().all(|c| c.source != DelaySource::Sweep));
        let found = self.candidates.iter().filter_map(|c| Some((c.source, *c.delay_s.found()?)));
        self.differences = found
            .filter(|(source, _)| comparable(*source))
            .chain(best)
            .filter_map(|(source, delay)| Some(DelayDifference { source, e_n: delay.normalised_difference(removed)? }))
            .collect();
    }

    /// E_n of the delay of this source against the removed one, where they can be compared.
    #[must_use]
    pub fn e_n(&self, source: DelaySource) -> Option<f64> {
        self.differences.iter().find(|d| d.source == source).map(|d| d.e_n)
    }
}

/// What a sweep scores.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum SweepScore {
    /// 2-D error of the exact asynchronous form against this reference channel.
    ErrorAgainst(String),
    /// 2-D step of the exact asynchronous form at each fix: there is no reference.
    StepAtFixes,
}

/// The score of one flight over the delay that is removed. All delays are scored on the same samples.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DelaySweep {
    /// What is scored.
    pub score: SweepScore,
    /// Output rows (against a reference) or fixes that were scored.
    pub samples: u64,
    /// Delays, s; rising.
    pub delay_s: Vec<f64>,
    /// 2-D rms at each of them, m.
    pub rms_m: Vec<f64>,
    /// The score at the delays that somebody could have chosen, each source once; that of the sweep is the optimum.
    pub at: Vec<SweepPoint>,
    /// The delay that fits the flight best.
    pub optimum: Finding<SweepOptimum>,
}

/// The score at one delay.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct SweepPoint {
    /// Who says this delay.
    pub source: DelaySource,
    /// The delay, s.
    pub delay_s: Estimate,
    /// 2-D rms there, m; its uncertainty is that of the sample and that of the delay.
    pub rms_m: Estimate,
}

/// How the best delay and its interval were found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum SweepMethod {
    /// Least squares against the reference; interval by a delete-one jackknife over consecutive blocks, which allows for
    /// errors correlated over much less than a block.
    Jackknife,
    /// Without a reference the delay estimator's objective decides, with the estimator's own interval.
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
    /// How.
    pub method: SweepMethod,
}

impl DelaySweep {
    /// The score at the delay of this source; for a criterion as "would this flight have met it at the bench value?"
    #[must_use]
    pub fn score_at(&self, source: DelaySource) -> Option<&SweepPoint> {
        self.at.iter().find(|point| point.source == source)
    }
}

/// Delays over the flights of a campaign.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct CampaignDelay {
    /// Over the delays that the flights themselves show.
    pub measured: Finding<DelayOverFlights>,
    /// Over the optima of the flights' sweeps.
    pub swept: Finding<DelayOverFlights>,
    /// What the card says, s, if it says the same for all flights.
    pub card_s: Option<Estimate>,
    /// The measured delays in the order in which they were flown, with their limits. Not in the JSON, for it has one for each
    /// flight.
    #[serde(skip)]
    pub control: Vec<ControlPoint>,
    /// Whether that order is the order of time; else it is that of the names.
    pub in_time_order: bool,
    /// The score of all flights over one delay for all.
    pub curve: Finding<PooledSweep>,
}

/// One delay from many flights.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DelayOverFlights {
    /// Flights that have one.
    pub flights: u64,
    /// Random-effects mean, s.
    pub delay_s: Estimate,
    /// Standard deviation between flights beyond what their own uncertainties explain, s; `None` for one flight.
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
    /// Probability of one as large by chance.
    pub p: f64,
}

/// A flight's delay on the control chart.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ControlPoint {
    /// The flight's name.
    pub flight: String,
    /// UTC instant of its beginning, if its clock knows the day.
    pub flown_at: Option<String>,
    /// Its delay, s.
    pub delay_s: Estimate,
    /// What it should be, s: the card's value, else the mean over the flights.
    pub centre_s: f64,
    /// Three standard uncertainties of the difference, s.
    pub limit_s: f64,
    /// The difference is larger than that.
    pub is_outside: bool,
}

/// Mean square over the samples of all flights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct PooledSweep {
    /// Whether errors against a reference are pooled, or steps at fixes.
    pub against_reference: bool,
    /// Flights.
    pub flights: u64,
    /// Their samples.
    pub samples: u64,
    /// Delays, s; rising.
    pub delay_s: Vec<f64>,
    /// 2-D rms, m.
    pub rms_m: Vec<f64>,
}
