//! What flights are judged by, and how they were judged.

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
    /// BLAKE3 of the criteria as they are meant (comments do not count).
    pub blake3: String,
    /// The criteria as they are meant, as TOML.
    pub toml: String,
}

/// How a flight stands to a criterion, or to all of them: the gravest first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum CriterionVerdict {
    /// The limit is not kept.
    Fail,
    /// The number is too uncertain for this limit.
    Inconclusive,
    /// There is no such number.
    NotEvaluated,
    /// The limit is kept.
    Pass,
    /// The criterion is not meant for this flight.
    NotApplicable,
}

impl CriterionVerdict {
    /// The verdict as tables give it.
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

/// Where a number must lie; the limits themselves are inside. SI units.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Limit {
    /// Not above.
    AtMost(f64),
    /// Not below.
    AtLeast(f64),
    /// From the first to the second.
    Between([f64; 2]),
}

/// How a number and its limit become a verdict.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum DecisionRule {
    /// 95 % interval wholly within the limit: pass; wholly beyond: fail; else inconclusive.
    Interval,
    /// The value alone, though it has an uncertainty: the file's author takes the risk.
    Value,
    /// The value alone, for it has no uncertainty of its own: a count, or a fact of the log.
    Plain,
}

/// A unit that people write.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct CriterionUnit {
    /// As written behind the number; empty for counts and ratios.
    pub name: String,
    /// How many SI units it is.
    pub si: f64,
}

/// One criterion and what it says of one flight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct CriterionFinding {
    /// Name in the file, unique there.
    pub id: String,
    /// What is asked, in words.
    pub title: String,
    /// Why the limit is what it is.
    pub rationale: String,
    /// Name of the metric.
    pub metric: String,
    /// What the metric is of this flight, as `Td(position)` or `Error rms, exact-async`.
    pub quantity: String,
    /// Where the number must lie, SI.
    pub limit: Limit,
    /// The unit of the limit in the file; numbers are shown in it.
    pub unit: CriterionUnit,
    /// How it is decided.
    pub rule: DecisionRule,
    /// The number, SI; `None` if there is none.
    pub value: Option<Estimate>,
    /// Its 95 % interval, SI; `None` if it has none.
    pub interval_95: Option<[f64; 2]>,
    /// From the value to the nearest limit, SI: positive within, negative beyond.
    pub margin: Option<f64>,
    /// What follows.
    pub verdict: CriterionVerdict,
    /// Why there is no number, or no decision, or why it does not apply; empty where numbers and rule say it.
    pub reason: String,
}

/// Verdicts, counted.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct VerdictTally {
    /// Limit not kept.
    pub fail: u64,
    /// Too uncertain for the limit.
    pub inconclusive: u64,
    /// No number.
    pub not_evaluated: u64,
    /// Limit kept.
    pub pass: u64,
    /// Not meant for the flight.
    pub not_applicable: u64,
}

impl VerdictTally {
    /// Counts one more.
    pub fn add(&mut self, verdict: CriterionVerdict) {
        *match verdict {
            CriterionVerdict::Fail => &mut self.fail,
            CriterionVerdict::Inconclusive => &mut self.inconclusive,
            CriterionVerdict::NotEvaluated => &mut self.not_evaluated,
            CriterionVerdict::Pass => &mut self.pass,
            CriterionVerdict::NotApplicable => &mut self.not_applicable,
        } += 1;
    }

    /// Each verdict with its count, the gravest first.
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

/// What the criteria say of one flight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct FlightCriteria {
    /// Which criteria.
    pub criteria: CriteriaUse,
    /// In the order of the file.
    pub findings: Vec<CriterionFinding>,
}

impl FlightCriteria {
    /// The gravest verdict: fail if any fails, pass if some pass and the rest does not apply.
    #[must_use]
    pub fn overall(&self) -> CriterionVerdict {
        self.findings.iter().map(|f| f.verdict).min().unwrap_or(CriterionVerdict::NotApplicable)
    }

    /// How many of each.
    #[must_use]
    pub fn tally(&self) -> VerdictTally {
        self.findings.iter().map(|f| f.verdict).collect()
    }
}

/// The verdicts of one flight in the table of flights.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct RowVerdicts {
    /// The gravest.
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

/// One of them.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct RowVerdict {
    /// Name of the criterion.
    pub id: String,
    /// What it says.
    pub verdict: CriterionVerdict,
    /// The same in a sentence with the value and the limit, if it fails.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub words: String,
}

/// How many of how many passed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct PassRate {
    /// Flights that pass.
    pub passed: u64,
    /// Flights that could be judged: passed, failed or inconclusive.
    pub judged: u64,
    /// 95 % interval of the share that passes (Wilson 1927), 0 to 1: what these flights say of flights like them.
    pub interval_95: [f64; 2],
}

/// One criterion over all flights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct CriterionSummary {
    /// Name in the file.
    pub id: String,
    /// What is asked, in words.
    pub title: String,
    /// Name of the metric.
    pub metric: String,
    /// The limit as the file gives it, as `≤ 150 ms`.
    pub limit: String,
    /// Flights by verdict.
    pub tally: VerdictTally,
    /// `None` if no flight could be judged.
    pub pass_rate: Option<PassRate>,
    /// Flights that fail, by name.
    pub failed: Vec<String>,
}

/// The criteria over all flights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct CampaignCriteria {
    /// Which criteria.
    pub criteria: CriteriaUse,
    /// Flights by their gravest verdict.
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
    fn the_gravest_verdict_comes_first_and_what_does_not_apply_hides_nothing() {
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
