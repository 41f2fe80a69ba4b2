//! Combines several records of one sensor into one card.

use super::identity::identity_conflict;
use super::sensor_name;
use crate::verdict::Evidence;
use flight::{Code, Notices, Quantity, StampKind, fixed};
use jiff::ToSpan;
use jiff::civil::Date;
use record::{
    BenchOutcome, BenchRecord, CARD_VERSION, CardChannel, CardSource, ChannelDynamics, DelayFinding, ENCODER_SLIP,
    Estimate, GateCheck, SensorCard, SensorIdentity, TimeBasis, Verdict,
};
use settings::SettingsError;
use signal::{Mean, Reading, mean_of, outliers};
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

const METHOD: &str = "Each channel against the motion of the bar, smoothed from the encoder: generalised least squares \
                      with fitted noise.";
const METHOD_OF_SEVERAL: &str = "Over several records: random-effects mean (Paule and Mandel), uncertainty by Hartung, \
                                 Knapp, Sidik and Jonkman, within and between records.";
/// A larger difference in update rate indicates another configuration of the sensor.
const RATE_TOLERANCE: f64 = 0.2;

/// More than two thirds of the records must agree; otherwise the outliers cannot be identified.
const MAJORITY: [usize; 2] = [2, 3];
/// Delays of two records differ if they are this many standard uncertainties apart, for any number of records.
const SURELY_APART: f64 = 6.0;
/// A smaller spread between records is covered by the uncertainty of the card, s.
const APART_S: f64 = 0.020;

/// Inputs of a card in addition to the records.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CardTerms<'a> {
    /// Validity of the card in days after the newest record; `None` if not stated.
    pub valid_days: Option<u32>,
    /// Version of flightlag that writes the card.
    pub flightlag_version: &'a str,
}

/// A card, and notices about the records it was made from.
#[derive(Debug, Clone, PartialEq)]
pub struct Combined {
    /// The card.
    pub card: SensorCard,
    /// Missing channels of each record, exclusions, and their reasons.
    pub notices: Notices,
}

/// Combines the records of one sensor, each with its display name, into one card.
///
/// A channel's delay and gain are random-effects means over the records that measured it: the uncertainty covers the
/// spread within and between them. Effects common to all records (coarse timestamps, the anchor's own delay) are not
/// averaged away. [`crate::card_magnetometer`] handles the magnetometer. From four records on, an outlier is excluded
/// and listed; if no more than two thirds of the records remain, the channel is not on the card. A single record is
/// used as it is.
///
/// # Errors
/// [`SettingsError`] naming the record: there are no records, they are of different sensors or of different analyses, or
/// nothing was measured.
pub fn combine(records: &[(String, BenchRecord)], terms: &CardTerms<'_>) -> Result<Combined, SettingsError> {
    let (first_name, first) = records.first().ok_or_else(|| error("", "a card needs at least one record"))?;
    let sensor = one_sensor(records)?;
    let analysis_version = one_analysis((first_name, first), records)?;
    let mut notices = Notices::new();
    let copies = copies(records);
    let usable: Vec<&(String, BenchRecord)> = records
        .iter()
        .enumerate()
        .filter(|(at, record)| is_usable(record, copies.get(at).copied(), &mut notices))
        .map(|(_, record)| record)
        .collect();
    let names: BTreeSet<&str> = usable.iter().flat_map(|(_, r)| channels(r)).map(|c| c.name.as_str()).collect();
    let mut left_out = vec![];
    let several: Vec<Several<'_>> =
        names.into_iter().filter_map(|name| Several::of(name, &usable, &mut left_out)).collect();
    report_left_out(&left_out, &mut notices);
    report_doubts(&usable, &mut notices);
    report_gates(&usable, &mut notices);
    let channels: Vec<CardChannel> = several.iter().filter_map(|s| s.card(&mut notices)).collect();
    if channels.is_empty() {
        return Err(error(first_name, format!("{} of {}: no card", why_empty(&left_out), sensor_name(&sensor))));
    }
    let [measured_on, valid_from, valid_until] = validity(&days_of_means(&several, &usable), terms, &mut notices);
    let card = SensorCard {
        card_version: CARD_VERSION,
        sensor,
        rig: titles(&usable),
        method: method(usable.len(), &notices),
        flightlag_version: terms.flightlag_version.to_owned(),
        analysis_version,
        measured_on,
        valid_from,
        valid_until,
        magnetometer: None,
        channels,
        records: usable.iter().map(|(_, r)| source(r)).collect(),
    };
    Ok(Combined { card, notices })
}

/// Why no channel is on the card.
fn why_empty(left_out: &[LeftOut<'_>]) -> String {
    let disagree: Vec<&str> = left_out.iter().filter(|l| l.record.is_empty()).map(|l| l.why.as_str()).collect();
    if disagree.is_empty() { "nothing was measured".to_owned() } else { disagree.join("; ") + ". No channel" }
}

/// Days of the records used in the means: other records do not make the card newer.
fn days_of_means<'a>(several: &[Several<'_>], usable: &[&'a (String, BenchRecord)]) -> Vec<&'a str> {
    let in_means: BTreeSet<&str> = several.iter().flat_map(|s| s.runs.iter().map(|run| run.record)).collect();
    let of_means = usable.iter().filter(|(name, _)| in_means.contains(name.as_str()));
    of_means.filter_map(|(_, r)| r.date.as_deref()).collect()
}

/// Description of how the numbers were obtained, including exclusions.
fn method(records: usize, notices: &Notices) -> String {
    let mut text = METHOD.to_owned();
    if records > 1 {
        text += " ";
        text += METHOD_OF_SEVERAL;
    }
    for notice in notices.iter().filter(|n| n.code == Code::NotComparable) {
        let place = if notice.place.is_empty() { String::new() } else { format!("{}: ", notice.place) };
        text += &format!(" {place}{}.", notice.text);
    }
    text
}

fn one_analysis(
    (first_name, first): (&str, &BenchRecord),
    records: &[(String, BenchRecord)],
) -> Result<u32, SettingsError> {
    let was = first.analysis_version;
    match records.iter().find(|(_, r)| r.analysis_version != was) {
        Some((name, BenchRecord { analysis_version: is, .. })) => {
            Err(error(name, format!("analysis version {is}, but {first_name} has {was}: analyse all of them again")))
        }
        None => Ok(was),
    }
}

fn error(file: &str, what: impl Into<String>) -> SettingsError {
    SettingsError { file: PathBuf::from(file), line: None, what: what.into() }
}

/// The identity common to all records, with every part stated by at least one of them.
fn one_sensor(records: &[(String, BenchRecord)]) -> Result<SensorIdentity, SettingsError> {
    let mut whole = SensorIdentity::default();
    for (i, (name, record)) in records.iter().enumerate() {
        let own = &record.sensor;
        if i == 0 {
            whole = own.clone();
        } else if let Some(conflict) = identity_conflict(&whole, own) {
            return Err(error(name, format!("a different sensor from the records before: {conflict}")));
        }
        whole.serial = whole.serial.or_else(|| own.serial.clone());
        whole.firmware = whole.firmware.or_else(|| own.firmware.clone());
        whole.baud = whole.baud.or(own.baud);
        whole.configuration = whole.configuration.or_else(|| own.configuration.clone());
    }
    Ok(whole)
}

fn channels(record: &BenchRecord) -> &[ChannelDynamics] {
    record.findings.as_ref().map(|f| f.channels.as_slice()).unwrap_or_default()
}

fn is_usable((name, record): &(String, BenchRecord), copy_of: Option<&str>, notices: &mut Notices) -> bool {
    let reason = match (&record.outcome, copy_of) {
        (BenchOutcome::NotMeasurable { reason } | BenchOutcome::Failed { reason }, _) => reason.clone(),
        (BenchOutcome::Measured, Some(first)) => format!("a copy of {first}"),
        (BenchOutcome::Measured, None) => return true,
    };
    notices.push(Code::LeftOffCard, name, 1, format!("not on the card: {reason}"));
    false
}

/// Indices of measured records with the same content as an earlier one, each with the name of that one: a copy of a
/// recording is not another measurement.
#[must_use]
pub fn copies(records: &[(String, BenchRecord)]) -> BTreeMap<usize, &str> {
    let mut known: BTreeMap<Vec<&str>, &str> = BTreeMap::new();
    let mut copies = BTreeMap::new();
    let measured = records.iter().enumerate().filter(|(_, (_, record))| record.outcome == BenchOutcome::Measured);
    for (at, (name, record)) in measured {
        let content: Vec<&str> = record.logs.iter().flat_map(|log| &log.inputs).map(|i| i.blake3.as_str()).collect();
        match known.get(&content).filter(|_| !content.is_empty()) {
            Some(first) => drop(copies.insert(at, *first)),
            None => drop(known.insert(content, name)),
        }
    }
    copies
}

/// A channel of a record that is excluded from the mean, and why.
struct LeftOut<'a> {
    code: Code,
    record: &'a str,
    channel: &'a str,
    why: String,
}

/// Reports one notice for all channels that a record lacks for one reason.
fn report_left_out(left_out: &[LeftOut<'_>], notices: &mut Notices) {
    let mut reported: Vec<(Code, &str, &str)> = vec![];
    for LeftOut { code, record, why, .. } in left_out {
        if reported.contains(&(*code, *record, why)) {
            continue;
        }
        reported.push((*code, record, why));
        let alike = left_out.iter().filter(|l| (l.code, l.record, &l.why) == (*code, *record, why));
        let channels: Vec<&str> = alike.map(|l| l.channel).collect();
        let text = format!("{}: {why}", channels.join(", "));
        notices.push(*code, *record, channels.len() as u64, text);
    }
}

/// Reports, for each record, what puts all its channels in doubt, then the channels whose delay changes.
fn report_doubts(records: &[&(String, BenchRecord)], notices: &mut Notices) {
    for (name, record) in records {
        let doubts = record.doubts();
        if !doubts.is_empty() {
            let slipped = failed_checks(record).any(|c| c.name == ENCODER_SLIP);
            let part =
                if slipped { "The delays are from the part with the most motion between two slips. " } else { "" };
            let text = format!(
                "{}. {part}Every delay of the record is in doubt: correct the named cause and measure again",
                doubts.join("; ")
            );
            notices.push(Code::RigContradicted, name, doubts.len() as u64, text);
        }
        let words: Vec<String> =
            channels(record).iter().filter_map(|c| Some(format!("{}: {}", c.name, c.doubt()?))).collect();
        if !words.is_empty() {
            let text = format!("{}. One number does not describe it: find the cause", words.join("; "));
            notices.push(Code::FlightDelayChanges, name, words.len() as u64, text);
        }
    }
}

fn failed_checks(record: &BenchRecord) -> impl Iterator<Item = &GateCheck> {
    record.findings.iter().flat_map(|f| &f.gate.checks).filter(|c| !c.passed)
}

/// Reports the gate checks that a record failed, if they do not put anything in doubt.
fn report_gates(records: &[&(String, BenchRecord)], notices: &mut Notices) {
    for (name, record) in records {
        for check in failed_checks(record).filter(|c| !c.is_of_wrong_motion()) {
            notices.push(Code::CardConditions, name, 1, format!("{}: {}", check.name, check.text));
        }
    }
}

/// First to last day, as requested by the rig file.
fn validity(days: &[&str], terms: &CardTerms<'_>, notices: &mut Notices) -> [Option<String>; 3] {
    let days: Vec<Date> = days.iter().filter_map(|day| day.parse().ok()).collect();
    let (oldest, newest) = (days.iter().min(), days.iter().max());
    let until = newest.zip(terms.valid_days).and_then(|(day, n)| day.checked_add(i64::from(n).days()).ok());
    if newest.is_none() && terms.valid_days.is_some() {
        let text = "no record has a date: the card has no period of validity";
        notices.push(Code::CardConditions, "", 1, text);
    }
    let text = |day: Option<&Date>| day.map(ToString::to_string);
    [text(newest), until.and(text(oldest)), text(until.as_ref())]
}

fn titles(records: &[&(String, BenchRecord)]) -> String {
    let titles: BTreeSet<&str> = records.iter().map(|(_, r)| r.rig.title.as_str()).collect();
    titles.into_iter().collect::<Vec<_>>().join("; ")
}

fn source(record: &BenchRecord) -> CardSource {
    let inputs = || record.logs.iter().flat_map(|log| &log.inputs);
    CardSource {
        files: inputs().map(|f| f.name.clone()).collect(),
        blake3: inputs().map(|f| f.blake3.clone()).collect(),
        date: record.date.clone(),
        rig_blake3: record.rig.blake3.clone(),
    }
}

/// One channel of one record, with everything needed for a card.
#[derive(Clone, Copy)]
struct Run<'a> {
    record: &'a str,
    channel: &'a ChannelDynamics,
    delay: &'a DelayFinding,
    gain: Reading,
}

/// Properties that must be equal for delays to be comparable.
#[derive(Debug, Clone, PartialEq)]
struct Kind {
    quantity: Quantity,
    stamp_kind: StampKind,
    /// The anchor that the delay is relative to; `None` if it is absolute.
    anchor: Option<String>,
}

impl Kind {
    fn of(channel: &ChannelDynamics) -> Kind {
        let anchor = match &channel.basis {
            TimeBasis::OneClock | TimeBasis::Pps => None,
            TimeBasis::FastestArrivals => Some("the fastest arrivals".to_owned()),
            TimeBasis::Anchor { channel } => Some(channel.clone()),
        };
        Kind { quantity: channel.quantity, stamp_kind: channel.stamp_kind, anchor }
    }

    fn words(&self) -> String {
        let against = match &self.anchor {
            None => "absolute".to_owned(),
            Some(anchor) => format!("relative to {anchor}"),
        };
        format!("{} timestamps, {against}", self.stamp_kind)
    }
}

/// Comparable runs of one channel.
struct Several<'a> {
    name: &'a str,
    runs: Vec<Run<'a>>,
    /// Records excluded as outliers.
    outliers: Vec<String>,
    /// Doubts about the records in the mean.
    contradicted: Vec<String>,
}

impl<'a> Several<'a> {
    /// The runs that can be averaged; missing and excluded ones are reported. `None` without any.
    fn of(
        name: &'a str,
        records: &[&'a (String, BenchRecord)],
        left_out: &mut Vec<LeftOut<'a>>,
    ) -> Option<Several<'a>> {
        let mut runs = vec![];
        for (record, found) in records {
            let channel = channels(found).iter().find(|c| c.name == name);
            // The anchor has no delay of its own, and lacks nothing.
            if channel.is_some_and(ChannelDynamics::is_anchor) {
                continue;
            }
            match run(record, channel) {
                Ok(run) => runs.push(run),
                Err(why) => left_out.push(LeftOut { code: Code::LeftOffCard, record, channel: name, why }),
            }
        }
        let (runs, outliers) = without_outliers(name, comparable(name, runs, left_out), left_out)?;
        let contradicted = doubts(name, records, &runs, left_out);
        (!runs.is_empty()).then_some(Several { name, runs, outliers, contradicted })
    }

    fn card(&self, notices: &mut Notices) -> Option<CardChannel> {
        let first = self.runs.first()?;
        let readings = |of: fn(&Run<'a>) -> Reading| self.runs.iter().map(of).collect::<Vec<Reading>>();
        let (mut delay, gain) = (mean_of(&readings(Run::random_delay))?, mean_of(&readings(|r| r.gain))?);
        let shared = self.runs.iter().map(Run::shared).fold(0.0, f64::max);
        delay.standard_uncertainty = match self.runs.as_slice() {
            [only] => only.delay.standard_uncertainty_s,
            _ => delay.standard_uncertainty.hypot(shared),
        };
        let model = self.model();
        Some(CardChannel {
            name: self.name.to_owned(),
            quantity: first.channel.quantity,
            verdict: self.verdict(&delay)?,
            delay_s: delay.value,
            delay_standard_uncertainty_s: delay.standard_uncertainty,
            as_seen_delay_s: self.mean_age().map(|age| delay.value + age),
            lags_s: model.lags.iter().map(|lag| lag.value).collect(),
            lags_standard_uncertainty_s: uncertainties(&model.lags),
            slow_motion_delay_s: model.slow_s.map(|slow| slow.value),
            slow_motion_standard_uncertainty_s: model.slow_s.and_then(|slow| slow.standard_uncertainty),
            model: model.words,
            gain: gain.value,
            gain_standard_uncertainty: gain.standard_uncertainty,
            update_rate_hz: self.update_rate(notices),
            stamp_kind: first.channel.stamp_kind,
            basis: first.channel.basis.clone(),
            records: self.runs.len() as u64,
            between_runs_s: delay.between,
            outliers: self.outliers.clone(),
            contradicted: self.contradicted.clone(),
        })
    }

    /// One record keeps its verdict; several are judged by their mean.
    fn verdict(&self, delay: &Mean) -> Option<Verdict> {
        if let [only] = self.runs.as_slice() {
            return Some(only.channel.verdict);
        }
        let largest = |margin: fn(&Run<'_>) -> f64| self.runs.iter().map(margin).fold(0.0, f64::max);
        let evidence = Evidence {
            delay_s: delay.value,
            standard_uncertainty_s: delay.standard_uncertainty,
            // The uncertainty of a mean is already widened, so that 1.96 times it is the interval.
            degrees_of_freedom: f64::INFINITY,
            margin_s: largest(|run| run.delay.margin_s),
            strict_margin_s: largest(|run| run.delay.strict_margin_s),
            duration_s: 0.0,
        };
        Some(evidence.judge().verdict)
    }

    /// Age of a held sample when a loop reads it, averaged over the records that state it.
    fn mean_age(&self) -> Option<f64> {
        let age = |r: &Run<'_>| r.delay.as_seen_s.map(|seen| seen.value - r.delay.delay.seconds());
        let ages: Vec<f64> = self.runs.iter().filter_map(age).collect();
        (!ages.is_empty()).then(|| ages.iter().sum::<f64>() / ages.len() as f64)
    }

    /// The model of more than half of the records, with its mean lags and, if it has any, its lateness for slow motion;
    /// without such a majority, the models of the records.
    fn model(&self) -> CardModel {
        let kinds: BTreeSet<&str> = self.runs.iter().map(Run::model).collect();
        let with = |kind: &str| self.runs.iter().filter(|r| r.model() == kind).collect::<Vec<_>>();
        let counted: Vec<(&str, Vec<&Run<'_>>)> = kinds.into_iter().map(|kind| (kind, with(kind))).collect();
        let n = self.runs.len();
        match counted.iter().find(|(_, runs)| 2 * runs.len() > n) {
            Some((kind, runs)) => {
                let words = model_in_words(kind);
                let text =
                    if runs.len() < n { format!("{words} ({} of {n} records)", runs.len()) } else { words.into() };
                let lags = mean_lags(runs);
                let sums: Vec<Estimate> = runs.iter().filter_map(|r| Some(r.channel.model.found()?.sum_s)).collect();
                let has_lag = lags.iter().any(|lag| lag.value > 0.0);
                let shared_s = runs.iter().map(|r| r.shared()).fold(0.0, f64::max);
                let whole = |u: f64| u.hypot(shared_s);
                let slow_s = mean_estimate(&sums).filter(|_| has_lag);
                let slow_s = slow_s.map(|s| Estimate { standard_uncertainty: s.standard_uncertainty.map(whole), ..s });
                CardModel { words: text, lags, slow_s }
            }
            None => {
                let part = |(kind, runs): &(&str, Vec<&Run<'_>>)| format!("{} ({})", model_in_words(kind), runs.len());
                let parts: Vec<String> = counted.iter().map(part).collect();
                let words = format!("differs between records: {}", parts.join(", "));
                CardModel { words, lags: vec![], slow_s: None }
            }
        }
    }

    fn update_rate(&self, notices: &mut Notices) -> Option<f64> {
        let mut rates: Vec<f64> = self.runs.iter().filter_map(|r| r.channel.update_rate_hz).collect();
        let middle = signal::median_in_place(&mut rates)?;
        let differ = rates.iter().any(|rate| (rate / middle - 1.0).abs() > RATE_TOLERANCE);
        if differ {
            let text = format!("{}: the records differ in their update rate; the card gives {middle:.3} Hz", self.name);
            notices.push(Code::CardConditions, self.name, 1, text);
        }
        Some(middle)
    }
}

/// Reports a delay that varies between records by more than their uncertainties and by more than a flight tolerates.
fn difference(runs: &[Run<'_>]) -> Option<String> {
    let by_delay = |a: &&Run<'_>, b: &&Run<'_>| a.delay.delay.seconds().total_cmp(&b.delay.delay.seconds());
    let (least, most) = (runs.iter().min_by(by_delay)?, runs.iter().max_by(by_delay)?);
    let [from_s, to_s] = [least, most].map(|run| run.delay.delay.seconds());
    let u_s = least.delay.standard_uncertainty_s.hypot(most.delay.standard_uncertainty_s);
    (to_s - from_s > (SURELY_APART * u_s).max(APART_S)).then(|| {
        let [from, to] = [from_s, to_s].map(|delay_s| fixed(1e3 * delay_s, 1));
        format!("the delay differs from record to record, from {from} to {to} ms")
    })
}

/// Both groups of records if neither is a clear majority: split at the widest gap between their delays.
fn disagreement(mut runs: Vec<Run<'_>>) -> String {
    let delay_s = |r: &Run<'_>| r.delay.delay.seconds();
    runs.sort_by(|a, b| delay_s(a).total_cmp(&delay_s(b)));
    let gap = |k: &usize| delay_s(&runs[*k]) - delay_s(&runs[k - 1]);
    let split = (1..runs.len()).max_by(|a, b| gap(a).total_cmp(&gap(b))).unwrap_or(0);
    let group = |runs: &[Run<'_>]| {
        let one = |r: &Run<'_>| {
            let [delay, u] = [delay_s(r), 2.0 * r.delay.standard_uncertainty_s].map(|s| fixed(1e3 * s, 1));
            format!("{} {delay} ± {u} ms", r.record)
        };
        runs.iter().map(one).collect::<Vec<_>>().join(", ")
    };
    format!(
        "the records disagree: {} against {}. No group is more than two thirds of them, so the card gives no common delay. Find \
         what differs between them, and make one card for each configuration",
        group(&runs[..split]),
        group(&runs[split..])
    )
}

/// The runs that belong together, and the records of the others. `None` if no clear majority agrees.
fn without_outliers<'a>(
    name: &'a str,
    runs: Vec<Run<'a>>,
    left_out: &mut Vec<LeftOut<'a>>,
) -> Option<(Vec<Run<'a>>, Vec<String>)> {
    let delays: Vec<Reading> = runs.iter().map(Run::random_delay).collect();
    let (mut kept, mut left) = (vec![], vec![]);
    for (run, is_outlier) in runs.into_iter().zip(outliers(&delays)) {
        if is_outlier { left.push(run) } else { kept.push(run) }
    }
    if !left.is_empty() && MAJORITY[1] * kept.len() <= MAJORITY[0] * (kept.len() + left.len()) {
        let why = disagreement(kept.into_iter().chain(left).collect());
        left_out.push(LeftOut { code: Code::NotComparable, record: "", channel: name, why });
        return None;
    }
    for run in &left {
        let delay_s = run.delay.delay.seconds();
        let why = format!("{delay_s:.4} s is an outlier among the records and is not in the mean");
        left_out.push(LeftOut { code: Code::LeftOffCard, record: run.record, channel: name, why });
    }
    Some((kept, left.into_iter().map(|run| run.record.to_owned()).collect()))
}

/// What puts the mean of these runs in doubt, each with the name of its record.
fn doubts<'a>(
    name: &'a str,
    records: &[&'a (String, BenchRecord)],
    runs: &[Run<'a>],
    left_out: &mut Vec<LeftOut<'a>>,
) -> Vec<String> {
    let of_record = |(record, found): &&'a (String, BenchRecord)| {
        let own = channels(found).iter().find(|c| c.name == name).and_then(ChannelDynamics::doubt);
        found.doubts().into_iter().chain(own).map(move |what| format!("{record}: {what}"))
    };
    let differs = difference(runs);
    if let Some(what) = &differs {
        let why = format!("{what}. One number does not describe it: find what differs between the records");
        left_out.push(LeftOut { code: Code::FlightDelayChanges, record: "", channel: name, why });
    }
    let in_mean = records.iter().filter(|(record, _)| runs.iter().any(|run| run.record == record));
    in_mean.flat_map(of_record).chain(differs).collect()
}

/// A channel of a record, or why it is missing.
fn run<'a>(record: &'a str, channel: Option<&'a ChannelDynamics>) -> Result<Run<'a>, String> {
    let channel = channel.ok_or("the record has no such channel")?;
    let delay = channel.delay.as_ref().filter(|_| channel.verdict != Verdict::NotMeasurable);
    let delay = delay.ok_or_else(|| channel.reason.clone())?;
    let gain = gain(channel).ok_or("no component has a gain")?;
    Ok(Run { record, channel, delay, gain })
}

/// Gain of the excited components: their mean, because in a planar swing they share the motion.
fn gain(channel: &ChannelDynamics) -> Option<Reading> {
    let reading = |c: &record::ComponentDynamics| {
        let gain = c.gain.filter(|_| c.excited)?;
        Some(Reading { value: gain.value, standard_uncertainty: gain.standard_uncertainty? })
    };
    let mean = mean_of(&channel.components.iter().filter_map(reading).collect::<Vec<_>>())?;
    Some(Reading { value: mean.value, standard_uncertainty: mean.standard_uncertainty })
}

/// Keeps the runs of the most frequent kind, absolute ones before relative ones; reports the others.
fn comparable<'a>(name: &'a str, runs: Vec<Run<'a>>, left_out: &mut Vec<LeftOut<'a>>) -> Vec<Run<'a>> {
    let like = |kind: &Kind| runs.iter().filter(|r| Kind::of(r.channel) == *kind).count();
    let mut kinds: Vec<Kind> = vec![];
    for run in &runs {
        let kind = Kind::of(run.channel);
        if !kinds.contains(&kind) {
            kinds.push(kind);
        }
    }
    // On a tie the first one is kept.
    kinds.sort_by_key(|kind| (kind.anchor.is_some(), std::cmp::Reverse(like(kind))));
    let Some(best) = kinds.first().cloned() else { return runs };
    let (kept, others): (Vec<Run<'_>>, Vec<Run<'_>>) = runs.into_iter().partition(|r| Kind::of(r.channel) == best);
    for run in others {
        let own = Kind::of(run.channel);
        let what = if own.quantity == best.quantity { own.words() } else { format!("{:?}", own.quantity) };
        let why = format!("{what}: not comparable with the others ({}) and not used for delay and gain", best.words());
        left_out.push(LeftOut { code: Code::NotComparable, record: run.record, channel: name, why });
    }
    kept
}

impl Run<'_> {
    /// Uncertainty common to other records of the bench, s: it does not average away.
    fn shared(&self) -> f64 {
        self.delay.stamps_s.hypot(self.delay.anchor_s)
    }

    /// The delay with only the uncertainty that varies between records.
    fn random_delay(&self) -> Reading {
        let whole = self.delay.standard_uncertainty_s;
        let random = (whole * whole - self.shared().powi(2)).max(0.0).sqrt();
        Reading { value: self.delay.delay.seconds(), standard_uncertainty: random }
    }

    /// Name of the model: empty if the record cannot determine it.
    fn model(&self) -> &str {
        self.channel.model.found().and_then(|m| m.chosen.as_deref()).unwrap_or_default()
    }

    fn lags(&self) -> &[Estimate] {
        let model = self.channel.model.found();
        let chosen = model.and_then(|m| m.candidates.iter().find(|c| Some(&c.name) == m.chosen.as_ref()));
        chosen.map(|c| c.lags_s.as_slice()).unwrap_or_default()
    }
}

fn model_in_words(name: &str) -> &str {
    match name {
        "" => "delay or lag: not distinguished",
        "D" => "delay",
        "L" => "first-order lag",
        "DL" => "delay and first-order lag",
        "DLL" => "delay and two lags",
        "D2" => "delay and second-order filter",
        "DA" => record::MOVING_AVERAGE,
        other => other,
    }
}

/// Delay or lag of a channel over its records.
struct CardModel {
    words: String,
    lags: Vec<Estimate>,
    /// Delay plus lags, if there is a lag.
    slow_s: Option<Estimate>,
}

fn mean_lags(runs: &[&Run<'_>]) -> Vec<Estimate> {
    let lags: Vec<&[Estimate]> = runs.iter().map(|r| r.lags()).collect();
    let count = lags.iter().map(|lags| lags.len()).min().unwrap_or(0);
    let of = |i: usize| lags.iter().filter_map(|l| l.get(i).copied()).collect::<Vec<Estimate>>();
    (0..count).filter_map(|i| mean_estimate(&of(i))).collect()
}

/// Mean over records, weighted if all uncertainties are known; otherwise plain, without uncertainty.
fn mean_estimate(all: &[Estimate]) -> Option<Estimate> {
    let reading = |e: &Estimate| {
        let standard_uncertainty = e.standard_uncertainty.filter(|u| *u > 0.0)?;
        Some(Reading { value: e.value, standard_uncertainty })
    };
    let readings: Option<Vec<Reading>> = all.iter().map(reading).collect();
    let weighted = readings.and_then(|readings| mean_of(&readings));
    let plain = || all.iter().map(|e| e.value).sum::<f64>() / all.len() as f64;
    match weighted {
        Some(mean) => Some(Estimate { value: mean.value, standard_uncertainty: Some(mean.standard_uncertainty) }),
        None => (!all.is_empty()).then(|| Estimate { value: plain(), standard_uncertainty: None }),
    }
}

/// The uncertainties if all are known.
fn uncertainties(all: &[Estimate]) -> Vec<f64> {
    all.iter().map(|e| e.standard_uncertainty).collect::<Option<_>>().unwrap_or_default()
}

#[cfg(test)]
mod tests;
