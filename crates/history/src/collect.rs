//! Converts the report of a campaign to rows of the history.

use crate::compare::{ANSWER, HARMED, Texts, failed_criterion};
use crate::dataset::{Latest, Run};
use crate::error::HistoryError;
use crate::fleet::{Aircraft, Fleet};
use crate::row::Row;
use crate::schema::nanoseconds;
use campaign::DelayLine;
use flight::About;
use record::{CampaignRecord, CriterionVerdict, FlightRow, GroupLateness, InputFile, RECORD_VERSION};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Inputs for the rows of a report, other than the report itself.
#[derive(Debug, Clone, Copy)]
pub struct Collecting<'a> {
    /// The run of the rows.
    pub run: &'a Run,
    /// Name of the campaign in the history.
    pub campaign: &'a str,
    /// Identities that logs do not state.
    pub fleet: &'a Fleet,
    /// The latest known row of each flight: the record of a flight with the same result is not read again.
    pub known: &'a Latest,
}

/// The record of the campaign whose report is in a folder.
///
/// # Errors
/// The folder does not contain a campaign report, or one of another version.
pub fn read_campaign(report: &Path) -> Result<CampaignRecord, HistoryError> {
    let wrong = |(path, what): (PathBuf, String)| HistoryError::Report { path, what };
    let found = campaign::read_report(report).map_err(wrong)?.ok_or_else(|| {
        HistoryError::Asked(format!(
            "{}: not a campaign report: it has no campaign.json; give the folder that `flightlag campaign` wrote",
            report.display()
        ))
    })?;
    if found.record_version != RECORD_VERSION {
        let what = format!("has record version {}; this flightlag reads {RECORD_VERSION}", found.record_version);
        return Err(wrong((report.join("campaign.json"), what)));
    }
    Ok(found)
}

/// One row for each flight of a report.
///
/// # Errors
/// The record of a flight is damaged.
pub fn collect(record: &CampaignRecord, report: &Path, with: &Collecting<'_>) -> Result<Vec<Row>, HistoryError> {
    let groups = groups_of(&record.groups);
    let row = |flight: &FlightRow| {
        let group = groups.get(flight.flight.as_str()).copied();
        row_of(record, flight, group, report, with)
    };
    record.flights.iter().map(row).collect()
}

/// The texts of every flight of a report.
#[must_use]
pub fn texts_of(record: &CampaignRecord, campaign: &str) -> Texts {
    let of = |flight: &FlightRow| {
        let alarms = DelayLine::of_row(flight).alarms.into_iter().map(|alarm| (alarm.code, alarm.text));
        let failed = flight
            .criteria
            .iter()
            .flat_map(|criteria| &criteria.each)
            .filter(|one| one.verdict == CriterionVerdict::Fail);
        let criteria = failed.map(|one| (failed_criterion(&one.id), one.words.clone()));
        let effect = flight.effect.as_ref().map(|effect| (HARMED.to_owned(), effect.words.clone()));
        let mut texts = BTreeMap::from([(ANSWER.to_owned(), flight.answer())]);
        for (word, text) in alarms.chain(criteria).chain(effect) {
            // A flight may have several alarms with the same code.
            texts.entry(word).and_modify(|all: &mut String| *all += &format!("; {text}")).or_insert(text);
        }
        texts
    };
    record.flights.iter().map(|flight| ((campaign.to_owned(), flight.flight.clone()), of(flight))).collect()
}

/// The group of each flight. A split group describes no flight: its parts do.
fn groups_of(groups: &[GroupLateness]) -> BTreeMap<&str, &GroupLateness> {
    let whole = groups.iter().filter(|group| group.split.is_none());
    whole.flat_map(|group| group.members.iter().map(move |member| (member.as_str(), group))).collect()
}

/// Data that only the flight's own record contains.
#[derive(Debug, Default, Deserialize)]
struct RecordPart {
    #[serde(default)]
    inputs: Vec<InputFile>,
    log: Option<LogPart>,
}

#[derive(Debug, Deserialize)]
struct LogPart {
    #[serde(default)]
    about: About,
}

/// The record next to the flight's page, if any.
fn record_part(report: &Path, flight: &FlightRow) -> Result<Option<RecordPart>, HistoryError> {
    let page = report.join(&flight.page);
    let damaged = |what: String| HistoryError::Report { path: page.clone(), what };
    let Some(json) =
        campaign::record_of_page(&page).map_err(|e| damaged(format!("has a record that cannot be read: {e}")))?
    else {
        return Ok(None);
    };
    serde_json::from_slice(&json).map(Some).map_err(|e| damaged(format!("has a corrupt record: {e}")))
}

fn row_of(
    record: &CampaignRecord,
    flight: &FlightRow,
    group: Option<&GroupLateness>,
    report: &Path,
    with: &Collecting<'_>,
) -> Result<Row, HistoryError> {
    let line = DelayLine::of_row(flight);
    let row = Row {
        run_id: with.run.id.clone(),
        run_ns: with.run.start_ns,
        campaign: with.campaign.to_owned(),
        flight: flight.flight.clone(),
        flown_ns: flight.flown_at.as_deref().and_then(|instant| nanoseconds(instant).ok()),
        settings_hash: record.pipeline.blake3.clone(),
        criteria_hash: record.criteria.as_ref().map(|c| c.criteria.blake3.clone()),
        analysis_version: i64::from(record.analysis_version),
        build: record.flightlag_version.clone(),
        key: flight.key.clone(),
        outcome: flight.outcome.word().to_owned(),
        reason: flight.outcome.reason().map(str::to_owned),
        lateness_model_u_s: flight.lateness.as_ref().and_then(|l| Some(l.lateness.as_ref()?.model_uncertainty_s)),
        criteria: flight.criteria.as_ref().map(|c| c.overall.word().to_owned()),
        criteria_failed: flight.criteria.as_ref().and_then(|c| text(&c.failed())),
        duplicate_of: flight.duplicate_of.clone(),
        duration_s: flight.duration_s,
        page: flight.page.clone(),
        ..Row::default()
    };
    let row = with_record(with_answer(row, &line), (flight, group), report, with)?;
    Ok(with_identity(with_advice(row, flight, group), flight, with.fleet))
}

/// Adds the lateness of the position, and what was removed.
fn with_answer(row: Row, line: &DelayLine) -> Row {
    let codes: Vec<&str> = line.alarms.iter().map(|alarm| alarm.code.as_str()).collect();
    Row {
        group: text(&line.group),
        data: line.data.clone(),
        kind: text(&line.kind),
        lateness_s: line.lateness_s,
        lateness_u_s: line.lateness_u_s,
        lateness_low_s: line.lateness_low_s,
        lateness_high_s: line.lateness_high_s,
        datum: text(&line.datum),
        position_minus_velocity_s: line.position_minus_velocity_s,
        position_minus_velocity_u_s: line.position_minus_velocity_u_s,
        removed_s: line.removed_s,
        removed_from: text(&line.removed_from),
        effect: text(&line.effect),
        error_raw_m: line.error_raw_m,
        error_raw_u_m: line.error_raw_u_m,
        error_compensated_m: line.error_compensated_m,
        error_compensated_u_m: line.error_compensated_u_m,
        alarms: text(&codes.join(" ")),
        ..row
    }
}

fn text(words: &str) -> Option<String> {
    Some(words.to_owned()).filter(|w| !w.is_empty())
}

/// Adds data that only the flight's record contains. They are copied from a known row with the same result.
fn with_record(
    row: Row,
    (flight, group): (&FlightRow, Option<&GroupLateness>),
    report: &Path,
    with: &Collecting<'_>,
) -> Result<Row, HistoryError> {
    let name = (row.campaign.clone(), row.flight.clone());
    if let Some(known) =
        with.known.get(&name).filter(|k| k.key == row.key && k.log_hash.is_some() && !row.key.is_empty())
    {
        let Row { log_hash, vehicle, system, system_firmware, parameter, parameter_s, .. } = known.clone();
        return Ok(Row { log_hash, vehicle, system, system_firmware, parameter, parameter_s, ..row });
    }
    let Some(part) = record_part(report, flight)? else { return Ok(row) };
    let about = part.log.map(|log| log.about).unwrap_or_default();
    let wanted = advised(flight, group).map(|(name, _)| name);
    let configured = about.configured_delays.iter();
    let parameter = match &wanted {
        Some(name) => configured.clone().find(|c| c.parameter == *name),
        None => configured.clone().next(),
    };
    Ok(Row {
        log_hash: content_hash(&part.inputs),
        vehicle: about.vehicle,
        system: about.system,
        system_firmware: about.firmware,
        parameter: parameter.map(|c| c.parameter.clone()),
        parameter_s: parameter.map(|c| c.value_s),
        ..row
    })
}

/// One hash for all files of a flight: that of the only file, otherwise all of them in order.
fn content_hash(inputs: &[InputFile]) -> Option<String> {
    let hashes: Vec<&str> = inputs.iter().map(|input| input.blake3.as_str()).filter(|hash| !hash.is_empty()).collect();
    (!hashes.is_empty()).then(|| hashes.join("+"))
}

/// The autopilot parameter recommended for a flight, and its value, s. Only values that can be set are recommended.
fn advised(flight: &FlightRow, group: Option<&GroupLateness>) -> Option<(String, f64)> {
    if group.is_some_and(GroupLateness::is_apart) {
        return None;
    }
    let own = flight.lateness.iter().flat_map(|l| &l.advice.set);
    let all = group.into_iter().flat_map(|g| &g.advice.set).chain(own);
    let found = all.into_iter().find(|setting| setting.unit == "ms" && !setting.unsuitable)?;
    Some((found.name.clone(), found.value / 1e3))
}

/// Adds the recommendation: the group's if it has one, otherwise the flight's.
fn with_advice(row: Row, flight: &FlightRow, group: Option<&GroupLateness>) -> Row {
    let Some((parameter, value_s)) = advised(flight, group) else { return row };
    let of_group =
        group.filter(|g| g.advice.set.iter().any(|s| s.unit == "ms" && !s.unsuitable)).and_then(|g| g.lateness_s);
    let from = of_group.or_else(|| flight.lateness.as_ref().and_then(|l| l.lateness_s()));
    // The log states the value of one parameter only: a recommendation for another would be compared with the wrong
    // one.
    let parameter_s = row.parameter_s.filter(|_| row.parameter.as_ref() == Some(&parameter));
    Row {
        parameter: Some(parameter),
        parameter_s,
        advised_s: Some(value_s),
        advised_from_s: from.map(|e| e.value),
        advised_from_u_s: from.and_then(|e| e.standard_uncertainty),
        ..row
    }
}

/// Adds the identity: from the log first, then from the fleet file.
fn with_identity(row: Row, flight: &FlightRow, fleet: &Fleet) -> Row {
    let parts = flight.lateness.iter().flat_map(|l| &l.group.parts);
    let part = |what: &str| parts.clone().find(|part| part.what == what).map(|part| part.value.clone());
    let number = |text: String| text.split(' ').next().and_then(|number| number.parse::<f64>().ok());
    let known = fleet.of(&row.campaign, &row.flight).cloned().unwrap_or_default();
    let Aircraft { airframe, receiver, serial, firmware, rate_hz, baud } = known;
    let mut from = vec![];
    let airframe = first_of("airframe", row.vehicle.clone(), airframe, &mut from);
    let receiver = first_of("receiver", part("receiver"), receiver, &mut from);
    let serial = first_of("serial", part("serial"), serial, &mut from);
    let firmware = first_of("firmware", part("firmware"), firmware, &mut from);
    let rate_hz = first_of("rate", part("rate").and_then(number), rate_hz, &mut from);
    let baud = first_of("baud", part("baud").and_then(number).map(|baud| baud as i64), baud, &mut from);
    let identity_from = (!from.is_empty()).then(|| from.join(", "));
    Row { airframe, receiver, serial, firmware, rate_hz, baud, identity_from, ..row }
}

/// The value from the log, otherwise from the fleet file; records which.
fn first_of<T>(what: &str, log: Option<T>, fleet: Option<T>, from: &mut Vec<String>) -> Option<T> {
    let source = match (&log, &fleet) {
        (Some(_), _) => "log",
        (None, Some(_)) => "fleet file",
        (None, None) => return None,
    };
    from.push(format!("{what}: {source}"));
    log.or(fleet)
}
