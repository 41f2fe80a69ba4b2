//! One line per flight: the output of `flightlag delay`, and the first columns of the campaign's table.

use record::{
    Decision, DelayAdvice, DelayAlarm, DelayKind, Effect, EffectVerdict, FlightLateness, FlightRow, Outcome,
    flight_alarms,
};
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::Serialize;

/// The answer for one flight, in seconds and metres. An unknown number is `null`.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DelayLine {
    /// Path of the log.
    pub flight: String,
    /// Receiver, firmware, rate, map and log kind.
    pub group: String,
    /// `constant`, `on-time`, `early`, `not-tested`, `scatters`, `steps`, `switches`, `drifts`, `queues`, `builds-up`, `wanders` or
    /// `cannot-tell`, each relative to `datum`. With `+jitters`, `+late-fixes`, `+bursts` if detected.
    pub kind: String,
    /// Lateness of the position, s; positive is late. If the datum is `relative to CHANNEL`: how much later it is than
    /// that channel.
    pub lateness_s: Option<f64>,
    /// Its standard uncertainty (k = 1), s.
    pub lateness_u_s: Option<f64>,
    /// Lower end of its 95 % interval, s.
    pub lateness_low_s: Option<f64>,
    /// Upper end of that interval, s.
    pub lateness_high_s: Option<f64>,
    /// Datum of the lateness: `imu`, `reference`, or `relative to CHANNEL`.
    pub datum: String,
    /// Lateness of the position against the velocity that compensates it, s.
    pub position_minus_velocity_s: Option<f64>,
    /// Its standard uncertainty, s.
    pub position_minus_velocity_u_s: Option<f64>,
    /// The velocity that compensates it.
    pub velocity: Option<String>,
    /// Removed delay, s.
    pub removed_s: Option<f64>,
    /// Its standard uncertainty, s; `None` if a stated delay has none.
    pub removed_u_s: Option<f64>,
    /// Source of the removed delay; `none` if nothing is removed.
    pub removed_from: String,
    /// Effect of the removal: `helped`, `no-change`, `harmed` or `cannot-tell`; empty if nothing could be compared.
    pub effect: String,
    /// Error of the position before compensation, 2-D rms, m.
    pub error_raw_m: Option<f64>,
    /// Its standard uncertainty, m.
    pub error_raw_u_m: Option<f64>,
    /// Error after compensation, 2-D rms, m.
    pub error_compensated_m: Option<f64>,
    /// Its standard uncertainty, m.
    pub error_compensated_u_m: Option<f64>,
    /// Alarms, the most severe first.
    pub alarms: Vec<LineAlarm>,
    /// `whole`, `tail-cut` (a last record cut at power-off, no loss), `minor-loss` (less than 0.1 % of the log was
    /// lost, without effect on results), `damaged`, `failed`, `companion` (a log that is not a flight), or
    /// `pending` without a result yet.
    pub data: String,
    /// Number of warnings about the log and its analysis, such as rows left out or a clock that was set.
    pub warnings: u64,
    /// Their texts, each with its place and once, without those that an alarm already says; empty in a campaign, where
    /// the page of the flight lists them.
    pub warning_texts: Vec<String>,
    /// The lateness as a sentence.
    pub words: String,
    /// The effect as a sentence.
    pub effect_words: String,
    /// Settings that remove the delay.
    pub set: Vec<LineSetting>,
    /// What to fly for a better answer.
    pub fly: Option<String>,
    /// The flight with the same samples that counts instead of this one.
    pub duplicate_of: Option<String>,
    /// The second file of the flight and how its clock relates to that of the log, as a sentence; `null` without one.
    pub reference_file: Option<String>,
}

/// An alarm of a flight.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct LineAlarm {
    /// `red`, `amber` or `grey`.
    pub gravity: String,
    /// Short, stable name.
    pub code: String,
    /// Text of the alarm, a sentence.
    pub text: String,
}

/// A setting that removes a delay.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct LineSetting {
    /// Its name.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// `s` or `ms`.
    pub unit: String,
    /// Its value in the log, or in all logs of a group.
    pub in_log: Option<f64>,
    /// Caveats.
    pub note: String,
    /// Whether the setting cannot remove the delay; `note` says why.
    pub unsuitable: bool,
}

/// Inputs of a line.
#[derive(Default)]
pub(crate) struct LineParts<'a> {
    pub(crate) flight: &'a str,
    pub(crate) lateness: Option<&'a FlightLateness>,
    pub(crate) decision: Option<&'a Decision>,
    pub(crate) effect: Option<&'a Effect>,
    pub(crate) failed: Option<&'a str>,
    pub(crate) pending: Option<&'a str>,
    pub(crate) damaged: bool,
    pub(crate) minor_loss: bool,
    pub(crate) tail_cut: bool,
    pub(crate) warnings: u64,
    pub(crate) warning_texts: &'a [String],
    /// Whether the decision could be carried out.
    pub(crate) replayed: bool,
    pub(crate) duplicate_of: Option<&'a str>,
}

impl LineParts<'_> {
    /// Integrity of the data, as named in tables.
    fn data_name(&self) -> &'static str {
        let is_companion = |l: &FlightLateness| l.alarms.iter().any(|a| a.code == flight::Alarm::Companion);
        match self.failed {
            Some(_) => "failed",
            None if self.pending.is_some() => "pending",
            None if self.damaged => "damaged",
            None if self.lateness.is_some_and(is_companion) => "companion",
            None if self.minor_loss => "minor-loss",
            None if self.tail_cut => "tail-cut",
            None => "whole",
        }
    }
}

impl DelayLine {
    pub(crate) fn of(parts: &LineParts<'_>) -> DelayLine {
        let lateness = parts.lateness;
        let channel = lateness.and_then(|l| l.lateness.as_ref());
        let relative = lateness.and_then(|l| l.position_minus_velocity_s);
        let removed = parts.decision.filter(|_| parts.replayed).and_then(|d| d.delay_s.zip(d.used));
        let raw = parts.effect.and_then(|e| e.error_raw_m);
        let compensated = parts.effect.filter(|_| removed.is_some()).and_then(|e| e.error_compensated_m);
        let advice = lateness.map_or_else(DelayAdvice::default, |l| l.advice.clone());
        DelayLine {
            flight: parts.flight.to_owned(),
            group: lateness.map(|l| l.group.name.clone()).unwrap_or_default(),
            kind: lateness.map_or_else(|| "cannot-tell".to_owned(), FlightLateness::kind_name),
            lateness_s: channel.map(|c| c.lateness_s.value),
            lateness_u_s: channel.and_then(|c| c.lateness_s.standard_uncertainty),
            lateness_low_s: channel.map(|c| c.interval_95_s[0]),
            lateness_high_s: channel.map(|c| c.interval_95_s[1]),
            datum: channel.and(lateness).map(|l| l.against.clone()).unwrap_or_default(),
            position_minus_velocity_s: relative.map(|e| e.value),
            position_minus_velocity_u_s: relative.and_then(|e| e.standard_uncertainty),
            velocity: lateness.and_then(|l| l.velocity.clone()),
            removed_s: removed.map(|(delay_s, _)| delay_s),
            removed_u_s: removed.and(parts.decision).and_then(|d| d.standard_uncertainty_s),
            removed_from: removed.map_or("none", |(_, used)| used.name()).to_owned(),
            effect: parts.effect.map(|e| effect_name(e.verdict)).unwrap_or_default().to_owned(),
            error_raw_m: raw.map(|e| e.value),
            error_raw_u_m: raw.and_then(|e| e.standard_uncertainty),
            error_compensated_m: compensated.map(|e| e.value),
            error_compensated_u_m: compensated.and_then(|e| e.standard_uncertainty),
            alarms: flight_alarms(lateness, parts.decision).iter().map(alarm).collect(),
            data: parts.data_name().to_owned(),
            warnings: parts.warnings,
            warning_texts: parts.warning_texts.to_vec(),
            words: parts.failed.or(parts.pending).or(lateness.map(|l| l.words.as_str())).unwrap_or_default().to_owned(),
            effect_words: parts.effect.map(|e| e.words.clone()).unwrap_or_default(),
            set: advice.set.into_iter().map(LineSetting::of).collect(),
            fly: advice.fly,
            duplicate_of: parts.duplicate_of.map(str::to_owned),
            reference_file: lateness.and_then(|l| l.reference_file.as_ref()).map(|r| r.words.clone()),
        }
    }

    /// The line for a row of the campaign's table.
    #[must_use]
    pub fn of_row(row: &FlightRow) -> DelayLine {
        let mut line = DelayLine::of(&LineParts {
            flight: &row.flight,
            lateness: row.lateness.as_ref(),
            decision: row.decision.as_ref(),
            effect: row.effect.as_ref(),
            failed: match &row.outcome {
                Outcome::Failed { reason } => Some(reason),
                _ => None,
            },
            pending: match &row.outcome {
                Outcome::Pending { reason } => Some(reason),
                _ => None,
            },
            damaged: row.lossy,
            minor_loss: row.minor_loss,
            tail_cut: row.tail_cut_bytes > 0,
            warnings: row.warnings,
            warning_texts: &[],
            replayed: row.outcome == Outcome::Compensated,
            duplicate_of: row.duplicate_of.as_deref(),
        });
        let damage = row.damage.clone().map(|text| DelayAlarm::of(flight::Alarm::LogDamaged, text));
        line.alarms.extend(damage.iter().map(alarm));
        line
    }

    /// Whether a requested reference file was unusable, or was not used because the log contradicts its clock.
    #[must_use]
    pub fn lacks_reference(&self) -> bool {
        use flight::Alarm;
        let has = |wanted: Alarm| self.alarms.iter().any(|alarm| alarm.code == wanted);
        has(Alarm::ReferenceNotUsed) || (has(Alarm::ReferenceContradicted) && self.datum != "reference")
    }

    /// Whether a change of the delay was detected.
    #[must_use]
    pub fn varies(&self) -> bool {
        let changes = [DelayKind::Steps, DelayKind::Switches, DelayKind::Drifts, DelayKind::Queues];
        let more = [DelayKind::BuildsUp, DelayKind::Wanders];
        let base = self.kind.split('+').next().unwrap_or_default();
        changes.iter().chain(&more).any(|kind| kind.word().replace(' ', "-") == base)
    }
}

fn alarm(alarm: &DelayAlarm) -> LineAlarm {
    LineAlarm { gravity: alarm.gravity.word().to_owned(), code: alarm.code.clone(), text: alarm.text.clone() }
}

impl LineSetting {
    pub(crate) fn of(setting: record::DelaySetting) -> LineSetting {
        let record::DelaySetting { name, value, unit, in_log, note, unsuitable } = setting;
        LineSetting { name, value, unit, in_log, note, unsuitable }
    }
}

/// Name of a verdict in tables.
pub(crate) fn effect_name(verdict: EffectVerdict) -> &'static str {
    match verdict {
        EffectVerdict::Helped => "helped",
        EffectVerdict::NoChange => "no-change",
        EffectVerdict::Harmed => "harmed",
        EffectVerdict::CannotTell => "cannot-tell",
    }
}
