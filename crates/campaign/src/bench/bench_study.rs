//! The study of one record.

use super::BENCH_ANALYSIS_VERSION;
use super::bench_logs::{ReadLog, Role};
use super::pair::{MadeOf, Swing};
use bench_analysis::{BenchInput, MagneticEvidence, Rig, bench};
use flight::{Flight, LogHealth, Notices};
use record::{BenchLog, BenchOutcome, BenchRecord, ChannelDynamics, RECORD_VERSION};

/// Measures a record; also returns the evidence from its magnetometer, which is combined over records.
pub(super) fn record_of(swing: &Swing, rig: &Rig, logs: &[ReadLog]) -> (BenchRecord, Option<MagneticEvidence>) {
    let draft = draft(swing, rig, logs);
    match input(swing, logs) {
        Err(reason) => (BenchRecord { outcome: BenchOutcome::Failed { reason }, ..draft }, None),
        Ok(input) => measured(&input, rig, draft),
    }
}

/// The record of a swing on which the analysis panicked.
pub(super) fn defect(swing: &Swing, rig: &Rig, logs: &[ReadLog], panic: &str) -> BenchRecord {
    let reason = format!("a defect in flightlag, please report it: {panic}");
    BenchRecord { outcome: BenchOutcome::Failed { reason }, ..draft(swing, rig, logs) }
}

fn flight_of(logs: &[ReadLog], i: usize) -> Result<&Flight, String> {
    let log = logs.get(i).ok_or("no such log")?;
    log.loaded.as_ref().map(|loaded| &loaded.flight).map_err(Clone::clone)
}

fn input<'a>(swing: &Swing, logs: &'a [ReadLog]) -> Result<BenchInput<'a>, String> {
    match &swing.made_of {
        MadeOf::One(log) => {
            let flight = flight_of(logs, *log)?;
            Ok(BenchInput { encoder: flight, sensor: flight, one_log: true })
        }
        MadeOf::Two { encoder, sensor } => {
            let (encoder, sensor) = (flight_of(logs, *encoder)?, flight_of(logs, *sensor)?);
            Ok(BenchInput { encoder, sensor, one_log: false })
        }
        MadeOf::Nothing { reason, .. } => Err(reason.clone()),
    }
}

fn measured(input: &BenchInput<'_>, rig: &Rig, mut draft: BenchRecord) -> (BenchRecord, Option<MagneticEvidence>) {
    match bench(input, rig) {
        Ok(found) => {
            draft.notices.extend(found.notices);
            let outcome = outcome(&found.findings.channels);
            let record = BenchRecord { outcome, date: found.date, findings: Some(found.findings), ..draft };
            (record, Some(found.magnetic))
        }
        Err(refusal) => {
            let outcome = BenchOutcome::NotMeasurable { reason: refusal.to_string() };
            (BenchRecord { outcome, ..draft }, None)
        }
    }
}

/// A record counts as measured if at least one channel has a delay.
fn outcome(channels: &[ChannelDynamics]) -> BenchOutcome {
    if channels.iter().any(|c| c.delay.is_some() && c.verdict != record::Verdict::NotMeasurable) {
        return BenchOutcome::Measured;
    }
    let reasons: Vec<String> = channels.iter().map(|c| format!("{}: {}", c.name, c.reason)).collect();
    BenchOutcome::NotMeasurable { reason: format!("no channel has a delay: {}", reasons.join("; ")) }
}

/// The part of the record that is known before the analysis.
fn draft(swing: &Swing, rig: &Rig, logs: &[ReadLog]) -> BenchRecord {
    let own: Vec<&ReadLog> = swing.logs().iter().filter_map(|&i| logs.get(i)).collect();
    let mut notices = Notices::new();
    for log in &own {
        if let Ok(loaded) = &log.loaded {
            notices.extend(loaded.flight.notices.clone());
        }
    }
    BenchRecord {
        record_version: RECORD_VERSION,
        analysis_version: BENCH_ANALYSIS_VERSION,
        sensor: rig.sensor.clone(),
        rig: rig.as_used(),
        logs: own.iter().map(|log| bench_log(swing, log, logs)).collect(),
        date: None,
        outcome: BenchOutcome::Failed { reason: String::new() },
        findings: None,
        notices,
    }
}

fn bench_log(swing: &Swing, log: &ReadLog, logs: &[ReadLog]) -> BenchLog {
    let role = match &swing.made_of {
        MadeOf::Two { encoder, .. } if logs.get(*encoder).is_some_and(|l| std::ptr::eq(l, log)) => "encoder",
        MadeOf::Two { .. } => "sensor",
        _ => match log.role() {
            Ok(Role::Both) => "encoder and sensor",
            Ok(Role::Encoder) => "encoder",
            Ok(Role::Sensor) => "sensor",
            Err(_) => "unknown",
        },
    };
    let loaded = log.loaded.as_ref().ok();
    BenchLog {
        role: role.to_owned(),
        inputs: log.inputs.clone(),
        health: loaded.map_or_else(LogHealth::default, |l| l.health.clone()),
        binding: loaded.and_then(|l| l.binding.clone().ok()),
    }
}

/// Name of the outcome.
pub(super) fn outcome_name(outcome: &BenchOutcome) -> &'static str {
    match outcome {
        BenchOutcome::Measured => "measured",
        BenchOutcome::NotMeasurable { .. } => "not-measurable",
        BenchOutcome::Failed { .. } => "failed",
    }
}

/// Why it gives no card.
pub(super) fn outcome_reason(outcome: &BenchOutcome) -> Option<String> {
    match outcome {
        BenchOutcome::Measured => None,
        BenchOutcome::NotMeasurable { reason } | BenchOutcome::Failed { reason } => Some(reason.clone()),
    }
}
