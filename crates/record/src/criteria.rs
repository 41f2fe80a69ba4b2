//! Criteria for flights, and the verdicts.

use crate::replay::Estimate;
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The criteria file that was used.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct CriteriaUse {
    /// Title from the file.
    pub title: String,
    /// Name of the file without its folder.
    pub file: String,
    /// BLAKE3 of the resolved criteria (comments do not count).
    pub blake3: String,
    /// The resolved criteria, as TOML.
    pub toml: String,
}

/// Verdict on a flight by one criterion, or by all of them: the worst first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum CriterionVerdict {
    /// The limit is not met.
    Fail,
    /// The number is too uncertain for this limit.
    Inconclusive,
    /// The number does not exist.
    NotEvaluated,
    /// The limit is met.
    Pass,
    /// The criterion does not apply to this flight.
    NotApplicable,
}

impl CriterionVerdict {
    /// The verdict as shown in tables.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            CriterionVerdict::Fail => "fail",
            CriterionVerdict::Inconclusive => "inconclusive",
            CriterionVerdict::NotEvaluated => "not-evaluated",
            CriterionVerdict::Pass => "pass",
            CriterionVerdict::NotApplicable => "not-applicable",
        }
    }
}

/// Where a number must lie, limits included. SI units.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Limit {
    /// At most this value.
    AtMost(f64),
    /// At least this value.
    AtLeast(f64),
    /// From the first value to the second.
    Between([f64; 2]),
}

/// How a number and its limit become a verdict.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum DecisionRule {
    /// 95 % interval entirely within the limit: pass; entirely beyond: fail; otherwise inconclusive.
    Interval,
    /// The value alone, though it has an uncertainty: the file's author takes the risk.
    Value,
    /// The value alone, because it has no uncertainty of its own: a count, or a fact of the log.
    Plain,
}

/// A unit as written by users.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct CriterionUnit {
    /// As written after the number; empty for counts and ratios.
    pub name: String,
    /// Its size in SI units.
    pub si: f64,
}

/// One criterion and its verdict on one flight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct CriterionFinding {
    /// Name, unique in the file.
    pub id: String,
    /// The requirement, in words.
    pub title: String,
    /// Why the limit is what it is.
    pub rationale: String,
    /// Name of the metric.
    pub metric: String,
    /// The metric for this flight, such as `Td(position)` or `Error rms, exact-async`.
    pub quantity: String,
    /// Where the number must lie, SI.
    pub limit: Limit,
    /// The unit of the limit in the file, used for display.
    pub unit: CriterionUnit,
    /// The decision rule.
    pub rule: DecisionRule,
    /// The number, SI; `None` if it does not exist.
    pub value: Option<Estimate>,
    /// Its 95 % interval, SI; `None` without one.
    pub interval_95: Option<[f64; 2]>,
    /// Distance from the value to the nearest limit, SI: positive within, negative beyond.
    pub margin: Option<f64>,
    /// The verdict.
    pub verdict: CriterionVerdict,
    /// Why there is no number or decision, or why it does not apply; empty where numbers and rule suffice.
    pub reason: String,
}

/// Verdicts, counted.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct VerdictTally {
    /// Limit not met.
    pub fail: u64,
    /// Too uncertain for the limit.
    pub inconclusive: u64,
    /// The number does not exist.
    pub not_evaluated: u64,
    /// Limit met.
    pub pass: u64,
    /// Does not apply to the flight.
    pub not_applicable: u64,
}

impl VerdictTally {
    /// Adds one verdict.
    pub fn add(&mut self, verdict: CriterionVerdict) {
        *match verdict {
            CriterionVerdict::Fail => &mut self.fail,
            CriterionVerdict::Inconclusive => &mut self.inconclusive,
            CriterionVerdict::NotEvaluated => &mut self.not_evaluated,
            CriterionVerdict::Pass => &mut self.pass,
            CriterionVerdict::NotApplicable => &mut self.not_applicable,
        } += 1;
    }

    /// Each verdict with its count, the worst first.
    #[must_use]
    pub fn by_verdict(&self) -> [(CriterionVerdict, u64); 5] {
        [
            (CriterionVerdict::Fail, self.fail),
            (CriterionVerdict::Inconclusive, self.inconclusive),
            (CriterionVerdict::NotEvaluated, self.not_evaluated),
            (CriterionVerdict::Pass, self.pass),
            (CriterionVerdict::NotApplicable, self.not_applicable),
        ]
    }
}

impl FromIterator<CriterionVerdict> for VerdictTally {
    fn from_iter<I: IntoIterator<Item = CriterionVerdict>>(verdicts: I) -> VerdictTally {
        let mut tally = VerdictTally::default();
        verdicts.into_iter().for_each(|verdict| tally.add(verdict));
        tally
    }
}

/// The verdicts of the criteria on one flight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct FlightCriteria {
    /// The criteria used.
    pub criteria: CriteriaUse,
    /// In the order of the file.
    pub findings: Vec<CriterionFinding>,
}

impl FlightCriteria {
    /// The worst verdict: fail if any fails, pass if some pass and the rest do not apply.
    #[must_use]
    pub fn overall(&self) -> CriterionVerdict {
        self.findings.iter().map(|f| f.verdict).min().unwrap_or(CriterionVerdict::NotApplicable)
    }

    /// Number of each verdict.
    #[must_use]
    pub fn tally(&self) -> VerdictTally {
        self.findings.iter().map(|f| f.verdict).collect()
    }
}

/// The verdicts of one flight in the table of flights.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct RowVerdicts {
    /// The worst.
    pub overall: CriterionVerdict,
    /// In the order of the file.
    pub each: Vec<RowVerdict>,
}

impl RowVerdicts {
    /// Names of the criteria that fail, with spaces between.
    #[must_use]
    pub fn failed(&self) -> String {
        let failed = self.each.iter().filter(|v| v.verdict == CriterionVerdict::Fail);
        failed.map(|v| v.id.as_str()).collect::<Vec<_>>().join(" ")
    }
}

/// The verdict of one criterion in the table.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct RowVerdict {
    /// Name of the criterion.
    pub id: String,
    /// Its verdict.
    pub verdict: CriterionVerdict,
    /// If it fails: the verdict in a sentence with the value and the limit. If it was not evaluated: why.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub words: String,
}

/// How many flights passed, out of how many.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct PassRate {
    /// Flights that pass.
    pub passed: u64,
    /// Flights that could be judged: passed, failed or inconclusive.
    pub judged: u64,
    /// 95 % interval of the share that passes (Wilson 1927), 0 to 1: what these flights imply for similar flights.
    pub interval_95: [f64; 2],
}

/// One criterion over all flights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct CriterionSummary {
    /// Name in the file.
    pub id: String,
    /// The requirement, in words.
    pub title: String,
    /// Name of the metric.
    pub metric: String,
    /// The limit as in the file, such as `≤ 150 ms`.
    pub limit: String,
    /// Flights by verdict.
    pub tally: VerdictTally,
    /// `None` if no flight could be judged.
    pub pass_rate: Option<PassRate>,
    /// Flights that fail, by name.
    pub failed: Vec<String>,
    /// The most frequent reason if it applies to some flight, and no flight has the number.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub never_evaluated: Option<String>,
}

/// The criteria over all flights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct CampaignCriteria {
    /// The criteria used.
    pub criteria: CriteriaUse,
    /// Flights by their worst verdict.
    pub flights: VerdictTally,
    /// Flights that meet every criterion that applies to them; `None` if none could be judged.
    pub pass_rate: Option<PassRate>,
    /// In the order of the file.
    pub each: Vec<CriterionSummary>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use CriterionVerdict::{Fail, Inconclusive, NotApplicable, NotEvaluated, Pass};

    #[test]
    fn the_worst_verdict_wins_and_not_applicable_ranks_last() {
        let mut verdicts = [NotApplicable, Pass, Fail, NotEvaluated, Inconclusive];
        verdicts.sort();
        assert_eq!(verdicts, [Fail, Inconclusive, NotEvaluated, Pass, NotApplicable]);
    }

    #[test]
    fn a_tally_counts_each_verdict_once() {
        let tally: VerdictTally = [Pass, Fail, Pass, NotApplicable].into_iter().collect();
        assert_eq!(tally, VerdictTally { pass: 2, fail: 1, not_applicable: 1, ..VerdictTally::default() });
        assert_eq!(tally.by_verdict().map(|(_, n)| n).iter().sum::<u64>(), 4);
    }
}
