//! Criteria for flights: the criteria file as written, then resolved (defaults filled in), and the verdicts.
//!
//! Criteria are not part of a result's key. They are judged from the record whenever pages are made, so that another
//! limit recomputes no flight and only rewrites the pages that show it.

mod applies;
mod file;
mod judge;
mod measure;
mod metric;
mod read;
#[cfg(test)]
pub(crate) mod tests;
mod unit;

#[cfg(feature = "schema")]
pub(crate) use file::criteria_schema;
pub use metric::{METRICS, MetricEntry, Takes};
pub use unit::Dimension;

use applies::{AppliesTo, Applying};
use judge::{judge, margin, pass_rate};
use measure::{Subject, measure};
use record::{
    CampaignCriteria, CriteriaUse, CriterionFinding, CriterionSummary, CriterionUnit, CriterionVerdict, DecisionRule,
    FlightCriteria, FlightRecord, FlightRow, Limit, PassRate, RowVerdict, RowVerdicts, VerdictTally,
};
use serde::Serialize;
use settings::SettingsError;
use std::collections::BTreeMap;
use std::path::Path;

/// The commented example, compiled in: `pipelines/criteria.toml`.
pub const EXAMPLE_CRITERIA: &str = pipelines::EXAMPLE_CRITERIA;

/// The criteria of the simulated campaign, compiled in: `pipelines/demo.criteria.toml`.
pub const DEMO_CRITERIA: &str = pipelines::DEMO_CRITERIA;

/// Criteria, checked and complete.
#[derive(Debug, Clone, PartialEq)]
pub struct Criteria {
    title: String,
    file_name: String,
    criteria: Vec<Criterion>,
}

/// A resolved criterion.
#[derive(Debug, Clone, PartialEq)]
struct Criterion {
    entry: &'static MetricEntry,
    limit: Limit,
    unit: CriterionUnit,
    rule: DecisionRule,
    applies_to: AppliesTo,
    written: ResolvedCriterion,
}

/// The same in the layout of the file.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
struct ResolvedCriterion {
    id: String,
    title: String,
    metric: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    compensator: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    channel: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    against: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    at_most: Option<toml::Value>,
    #[serde(skip_serializing_if = "Option::is_none")]
    at_least: Option<toml::Value>,
    #[serde(skip_serializing_if = "Option::is_none")]
    between: Option<[toml::Value; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    decision: Option<&'static str>,
    rationale: String,
    #[serde(skip_serializing_if = "AppliesTo::is_everything")]
    applies_to: AppliesTo,
}

#[derive(Serialize)]
struct ResolvedFile<'a> {
    schema: u32,
    title: &'a str,
    criterion: Vec<&'a ResolvedCriterion>,
}

impl Criteria {
    /// Reads a criteria file.
    ///
    /// # Errors
    /// The file cannot be read, is not TOML, has an unknown key, or a value makes no sense; with file and line.
    pub fn read(path: &Path) -> Result<Criteria, SettingsError> {
        read::from_disk(path)
    }

    /// Reads criteria from `text`; `path` is for errors.
    ///
    /// # Errors
    /// As [`Criteria::read`].
    pub fn parse(text: &str, path: &Path) -> Result<Criteria, SettingsError> {
        read::parse(text, path)
    }

    /// The criteria for a record: title, hash and text of the resolved criteria.
    #[must_use]
    pub fn as_used(&self) -> CriteriaUse {
        let criterion = self.criteria.iter().map(|c| &c.written).collect();
        let resolved = ResolvedFile { schema: 1, title: &self.title, criterion };
        let toml = toml::to_string(&resolved).unwrap_or_else(|e| format!("# cannot be written: {e}\n"));
        CriteriaUse {
            title: self.title.clone(),
            file: self.file_name.clone(),
            blake3: blake3::hash(toml.as_bytes()).to_hex().to_string(),
            toml,
        }
    }

    /// Criteria from a manifest.
    pub(crate) fn of_use(used: &CriteriaUse) -> Result<Criteria, SettingsError> {
        Criteria::parse(&used.toml, Path::new(&used.file))
    }

    /// Number of criteria.
    #[must_use]
    pub fn count(&self) -> usize {
        self.criteria.len()
    }

    /// Judges a flight.
    pub(crate) fn judge(&self, flight: &str, record: &FlightRecord) -> FlightCriteria {
        let findings = self.criteria.iter().map(|c| c.judge(flight, record)).collect();
        FlightCriteria { criteria: self.as_used(), findings }
    }

    /// Summary over all flights.
    pub(crate) fn summary(&self, rows: &[FlightRow]) -> CampaignCriteria {
        let judged: Vec<(&str, &RowVerdicts)> =
            rows.iter().filter_map(|row| Some((row.flight.as_str(), row.criteria.as_ref()?))).collect();
        let flights: VerdictTally = judged.iter().map(|(_, verdicts)| verdicts.overall).collect();
        let each = self.criteria.iter().map(|c| c.summary(&judged)).collect();
        CampaignCriteria { criteria: self.as_used(), pass_rate: rate_of_tally(&flights), flights, each }
    }
}

/// The verdicts of a flight, short.
pub(crate) fn row_verdicts(criteria: &FlightCriteria) -> RowVerdicts {
    let words = |f: &CriterionFinding| match f.verdict {
        CriterionVerdict::Fail => report::criterion_sentence(f),
        CriterionVerdict::NotEvaluated => f.reason.clone(),
        _ => String::new(),
    };
    let short = |f: &CriterionFinding| RowVerdict { id: f.id.clone(), verdict: f.verdict, words: words(f) };
    RowVerdicts { overall: criteria.overall(), each: criteria.findings.iter().map(short).collect() }
}

/// Whether it applies to some flight, and no flight has the number.
fn never_evaluated(tally: &VerdictTally) -> bool {
    tally.not_evaluated > 0 && tally.pass + tally.fail + tally.inconclusive == 0
}

fn rate_of_tally(tally: &VerdictTally) -> Option<PassRate> {
    pass_rate(tally.pass, tally.pass + tally.fail + tally.inconclusive)
}

impl Criterion {
    fn judge(&self, flight: &str, record: &FlightRecord) -> CriterionFinding {
        let ResolvedCriterion { id, title, metric, compensator, channel, against, rationale, .. } = &self.written;
        let subject = Subject {
            record,
            compensator: compensator.as_deref(),
            channel: channel.as_deref(),
            against: against.as_deref(),
        };
        let none = |verdict, reason| (None, None, verdict, reason);
        let (reading, distance, verdict, reason) = match self.applies_to.applies(flight, &subject) {
            Applying::No(reason) => none(CriterionVerdict::NotApplicable, reason),
            Applying::CannotTell(reason) => none(CriterionVerdict::NotEvaluated, reason),
            Applying::Yes => match measure(self.entry.metric, &subject) {
                Err(reason) => none(CriterionVerdict::NotEvaluated, reason),
                Ok(reading) => {
                    let (verdict, reason) = judge(&reading, self.limit, self.rule);
                    (Some(reading), Some(margin(reading.value.value, self.limit)), verdict, reason.to_owned())
                }
            },
        };
        CriterionFinding {
            id: id.clone(),
            title: title.clone(),
            rationale: rationale.clone(),
            metric: metric.clone(),
            quantity: self.quantity(),
            limit: self.limit,
            unit: self.unit.clone(),
            rule: self.rule,
            value: reading.map(|r| r.value),
            interval_95: reading.and_then(|r| r.interval_95),
            margin: distance,
            verdict,
            reason,
        }
    }

    /// The measured quantity, with its compensator or channel.
    fn quantity(&self) -> String {
        let ResolvedCriterion { compensator, channel, against, .. } = &self.written;
        let named: Vec<&str> = [compensator, channel, against].into_iter().flatten().map(String::as_str).collect();
        match named.is_empty() {
            true => self.entry.symbol.to_owned(),
            false => format!("{}, {}", self.entry.symbol, named.join(" against ")),
        }
    }

    fn summary(&self, flights: &[(&str, &RowVerdicts)]) -> CriterionSummary {
        let verdict =
            |verdicts: &RowVerdicts| verdicts.each.iter().find(|v| v.id == self.written.id).map(|v| v.verdict);
        let each: Vec<(&str, CriterionVerdict)> =
            flights.iter().filter_map(|(flight, verdicts)| Some((*flight, verdict(verdicts)?))).collect();
        let tally: VerdictTally = each.iter().map(|(_, verdict)| *verdict).collect();
        let failed = each.iter().filter(|(_, v)| *v == CriterionVerdict::Fail).map(|(f, _)| (*f).to_owned()).collect();
        CriterionSummary {
            id: self.written.id.clone(),
            title: self.written.title.clone(),
            metric: self.written.metric.clone(),
            limit: self.limit_text(),
            pass_rate: rate_of_tally(&tally),
            never_evaluated: never_evaluated(&tally).then(|| self.most_frequent_reason(flights)),
            tally,
            failed,
        }
    }

    /// Why flights were not evaluated.
    fn most_frequent_reason(&self, flights: &[(&str, &RowVerdicts)]) -> String {
        let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
        let each = flights.iter().flat_map(|(_, verdicts)| &verdicts.each);
        for one in each.filter(|v| v.id == self.written.id && v.verdict == CriterionVerdict::NotEvaluated) {
            *counts.entry(&one.words).or_default() += 1;
        }
        counts.into_iter().max_by_key(|(_, count)| *count).map_or_else(String::new, |(reason, _)| reason.to_owned())
    }

    /// The limit as in the file: `≤ 150 ms`.
    fn limit_text(&self) -> String {
        let unquoted = |value: &toml::Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
        match (&self.written.at_most, &self.written.at_least, &self.written.between) {
            (Some(most), ..) => format!("≤ {}", unquoted(most)),
            (_, Some(least), _) => format!("≥ {}", unquoted(least)),
            (.., Some([low, high])) => format!("{} to {}", unquoted(low), unquoted(high)),
            _ => String::new(),
        }
    }
}
