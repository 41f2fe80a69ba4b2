//! What changed since the previous run: `since-last-run.json` and its page.
//!
//! Apart from `run.json`, only these outputs depend on the previous content of the folder. A run that changes nothing
//! does not change them.

use record::{
    CampaignChanges, CampaignRecord, CriterionVerdict, EffectVerdict, Estimate, FlightRow, GroupLateness, MadeWith,
    MovedDelay, Outcome, RECORD_VERSION, RerunFlight, TroubleChange,
};
use std::collections::{BTreeMap, BTreeSet};

/// A delay has moved if its change exceeds this many standard uncertainties.
const MOVED_SIGMAS: f64 = 2.0;

/// Compares a campaign with the previous one, which comes with its rows except those of the flights `same`, whose rows
/// are unchanged in `now`. `causes` gives the reasons why the result of a flight changed.
pub(crate) fn changes(
    before: Option<(&CampaignRecord, Vec<&FlightRow>)>,
    now: &CampaignRecord,
    same: &BTreeSet<&str>,
    causes: &dyn Fn(&str) -> Vec<String>,
) -> CampaignChanges {
    let mut changes = CampaignChanges {
        record_version: RECORD_VERSION,
        name: now.name.clone(),
        before: before.as_ref().map(|(record, _)| made_with(record)),
        now: made_with(now),
        new: vec![],
        gone: vec![],
        rerun: vec![],
        moved: vec![],
        moved_groups: vec![],
        failing: vec![],
        recovered: vec![],
    };
    let Some((before, rows)) = before else { return changes };
    let mut old: BTreeMap<&str, &FlightRow> = rows.into_iter().map(|row| (row.flight.as_str(), row)).collect();
    for row in now.flights.iter().filter(|row| !same.contains(row.flight.as_str())) {
        match old.remove(row.flight.as_str()) {
            None => changes.new.push(row.flight.clone()),
            Some(was) => compare(was, row, causes, &mut changes),
        }
    }
    changes.gone = old.into_keys().map(str::to_owned).collect();
    changes.moved.sort_by(|a, b| b.sigmas.total_cmp(&a.sigmas));
    changes.moved_groups = moved_groups(&before.groups, &now.groups);
    changes
}

/// Groups in both reports whose mean moved, the largest move first. The parts of a group that was split have no names
/// of their own.
#[must_use]
pub fn moved_groups(before: &[GroupLateness], now: &[GroupLateness]) -> Vec<MovedDelay> {
    let groups = now.iter().filter_map(|group| {
        let is_same = |g: &&GroupLateness| g.group.key == group.group.key && g.against == group.against;
        let one = |groups: &[GroupLateness]| groups.iter().filter(is_same).count() == 1;
        let was = before.iter().find(is_same).filter(|_| one(before) && one(now))?;
        moved(&group.group.name, was.lateness_s?, group.lateness_s?)
    });
    let mut all: Vec<MovedDelay> = groups.collect();
    all.sort_by(|a, b| b.sigmas.total_cmp(&a.sigmas));
    all
}

fn compare(was: &FlightRow, row: &FlightRow, causes: &dyn Fn(&str) -> Vec<String>, changes: &mut CampaignChanges) {
    let flight = || row.flight.clone();
    if was.key != row.key {
        changes.rerun.push(RerunFlight { flight: flight(), causes: causes(&row.flight) });
    }
    let late = |row: &FlightRow| row.lateness.as_ref().filter(|l| l.datum == datum(was)).and_then(|l| l.lateness_s());
    changes.moved.extend(late(was).zip(late(row)).and_then(|(was, is)| moved(&row.flight, was, is)));
    let (had, has) = (troubles(was), troubles(row));
    let only = |of: &[&str], not: &[&str]| of.iter().filter(|t| !not.contains(t)).map(|t| (*t).to_owned()).collect();
    // A flight with a different problem now has not recovered.
    let recovered = if has.is_empty() { only(&had, &has) } else { vec![] };
    let both: [Vec<String>; 2] = [only(&has, &had), recovered];
    for (troubles, list) in both.into_iter().zip([&mut changes.failing, &mut changes.recovered]) {
        if !troubles.is_empty() {
            list.push(TroubleChange { flight: flight(), troubles });
        }
    }
}

/// The datum of a lateness: values with different datums are not compared.
fn datum(row: &FlightRow) -> record::NetworkDatum {
    row.lateness.as_ref().map_or(record::NetworkDatum::None, |l| l.datum)
}

fn moved(name: &str, before_s: Estimate, now_s: Estimate) -> Option<MovedDelay> {
    let u = before_s.standard_uncertainty?.hypot(now_s.standard_uncertainty?);
    let sigmas = (now_s.value - before_s.value).abs() / u;
    (u > 0.0 && sigmas > MOVED_SIGMAS).then(|| MovedDelay { name: name.to_owned(), before_s, now_s, sigmas })
}

/// The problems of a flight.
fn troubles(row: &FlightRow) -> Vec<&'static str> {
    let outcome = match row.outcome {
        Outcome::Failed { .. } => Some("failed"),
        Outcome::NotMeasurable { .. } => Some("not measurable"),
        Outcome::Pending { .. } => Some("pending"),
        Outcome::Compensated | Outcome::Uncompensated { .. } => None,
    };
    let harmed = row.effect.as_ref().is_some_and(|e| e.verdict == EffectVerdict::Harmed);
    let fails = row.criteria.as_ref().is_some_and(|c| c.overall == CriterionVerdict::Fail);
    let found = [harmed.then_some("harmed"), fails.then_some("criterion failed"), row.lossy.then_some("log damaged")];
    outcome.into_iter().chain(found.into_iter().flatten()).collect()
}

fn made_with(record: &CampaignRecord) -> MadeWith {
    MadeWith {
        flightlag_version: record.flightlag_version.clone(),
        analysis_version: record.analysis_version,
        pipeline_blake3: record.pipeline.blake3.clone(),
        criteria_blake3: record.criteria.as_ref().map(|c| c.criteria.blake3.clone()),
    }
}
