//! Lateness of the position of one flight: from all measured delays to the answer.

mod alarms;

use crate::config::Pipeline;
use crate::delay::in_ms;
use crate::group::{content_of, group_of};
use crate::lever;
use crate::no_position::no_position;
use crate::rate::rate_of;
use crate::reference::{OF_REFERENCE_FILE, settled};
use compensation_replay::{
    AutopilotParameter, EKF2_DELAY_MAX_DEFAULT_MS, MeasuredAgainst, ParameterFit, Refusal, autopilot_advice,
    is_gps_delay, pick_pair,
};
use delay_from_flight::{FlightDelaySettings, measure_delays};
use delay_network::{Lineage, NetworkSettings, PairObservation, ReferenceUse, difference, lineage_from_name, solve};
use flight::{Alarm, Binding, Code, ConfiguredDelay, Delay, Flight, LogHealth, Notices};
use record::{
    ChannelLateness, DelayAdvice, DelayAlarm, DelayKind, DelayNetwork, DelayOverTime, DelayPairKind, DelaySetting,
    Estimate, Finding, FlightContent, FlightDelays, FlightLateness, Gravity, MeasuredDelay, MeasuredFlight,
    NetworkDatum, OtherReceiver, PairDelay, RECORD_VERSION, ReceiverGroup, ReferenceClock, ReferenceFile,
};

/// Notices of a log that are alarms of its flight: columns bound by guess, and unknown stated units.
const ASSUMED: [Code; 2] = [Code::BoundByGuess, Code::UnitUnknown];
/// A delay whose 90 % interval is within this counts as on time, s.
const ON_TIME_S: f64 = 0.020;

/// The measurement of an unusable log.
pub(crate) fn failed(key: &str, reason: String) -> MeasuredFlight {
    let words = format!("the log could not be used: {reason}");
    measured_with(FlightLateness { failed: Some(reason), words, ..unknown(key) }, None, None, Notices::new())
}

/// The measurement of a log that accompanies a flight and is not a flight.
pub(crate) fn companion(key: &str, what: String) -> MeasuredFlight {
    let alarm = DelayAlarm::of(Alarm::Companion, what.clone());
    measured_with(FlightLateness { words: what, alarms: vec![alarm], ..unknown(key) }, None, None, Notices::new())
}

/// Measures the delays of a flight.
pub(crate) fn measure(
    key: &str,
    flight: &Flight,
    health: &LogHealth,
    binding: &Binding,
    reference: Option<ReferenceFile>,
    pipeline: &Pipeline,
) -> MeasuredFlight {
    let (positions, velocities) = pipeline.position_and_velocity();
    let picked = pick_pair(flight, positions, velocities);
    let detailed = picked.as_ref().ok().map(|[p, v]| (p.0.to_owned(), v.0.to_owned()));
    let settings = FlightDelaySettings { detailed, ..pipeline.measure_settings() };
    let (mut delays, notices) = measure_delays(flight, &settings);
    lever::take_out(&mut delays, flight, &health.about, pipeline.antenna());
    let (position, velocity) = match &picked {
        Ok([position, velocity]) => (Some(position.0), Some(velocity.0)),
        Err(_) => (flight.first_of(positions).map(|p| p.0), None),
    };
    let (network, contradiction) =
        network_of(&delays, velocity, reference.as_ref(), pipeline.log_reference_is_on_time());
    let reference_file = reference.map(|reference| settled(reference, network.as_ref()));
    let grouped = position.and_then(|position| grouped(position, flight, health, binding));
    let (group, content) = grouped.unwrap_or_default();
    let base = FlightLateness {
        position: position.map(str::to_owned),
        velocity: velocity.map(str::to_owned),
        group,
        content,
        card: pipeline.card_delay(flight, binding),
        reference_file,
        speed_rms_mps: speed_rms(picked.as_ref().ok().map(|p| p[1].1)),
        acceleration_rms_mps2: acceleration_rms(picked.as_ref().ok().map(|p| p[1].1)),
        ..unknown(key)
    };
    let mut lateness = match picked {
        Ok(_) => answered(base, &delays, network.as_ref(), health),
        Err(_) if position.is_none() => unusable(base, no_position(flight, binding, positions)),
        // Against a reference that is on time the lateness is known, although nothing can be removed.
        Err(refusal @ Refusal::NoChannel { .. })
            if position.is_some_and(|position| is_absolute(network.as_ref(), position)) =>
        {
            let found = answered(base, &delays, network.as_ref(), health);
            FlightLateness { words: format!("{}. Nothing can be removed: {refusal}", found.words), ..found }
        }
        Err(refusal @ Refusal::NoChannel { .. }) => {
            let check = position.and_then(|position| against_reference(position, &delays));
            unusable(base, format!("{refusal}{}", check.map(|(_, words)| words).unwrap_or_default()))
        }
        Err(refusal) => FlightLateness { words: refusal.to_string(), ..base },
    };
    lateness.alarms.extend(contradiction.map(|text| DelayAlarm::of(Alarm::ReferenceContradicted, text)));
    lateness.alarms.extend(lateness.reference_file.as_ref().and_then(unused_reference));
    if pipeline.log_reference_is_on_time() && flight.first_of(pipeline.reference()).is_none() {
        let names = pipeline.reference().join(", ");
        let text = format!("the log has no reference ({names}): `--reference-clock same` has no effect");
        lateness.alarms.push(DelayAlarm::of(Alarm::ReferenceNotUsed, text));
    }
    let unused = pipeline.log_reference_is_on_time().then(|| unused_log_reference(&delays)).flatten();
    lateness.alarms.extend(unused.map(|text| DelayAlarm::of(Alarm::ReferenceNotUsed, text)));
    lateness.alarms.extend(assumed(flight));
    lateness.alarms.sort();
    measured_with(lateness, Some(delays), network, notices)
}

/// Why the reference in the log that is said to be on time serves no channel; `None` if it serves one, or there is none.
fn unused_log_reference(delays: &FlightDelays) -> Option<String> {
    use DelayPairKind::{PositionAgainstReference, VelocityAgainstReference};
    let of_reference = |p: &&PairDelay| [PositionAgainstReference, VelocityAgainstReference].contains(&p.kind);
    let reasons = delays.pairs.iter().filter(of_reference).map(|p| match &p.delay {
        Finding::Found(_) => Err(()),
        Finding::CannotTell(why) => Ok(why),
    });
    let reasons: Vec<&String> = reasons.collect::<Result<_, ()>>().ok()?;
    reasons.first().map(|why| format!("the reference is not used: {why}"))
}

/// Whether the network knows how late the position is in true time.
fn is_absolute(network: Option<&DelayNetwork>, position: &str) -> bool {
    let channel = network.and_then(|network| network.channel(position));
    channel.is_some_and(|channel| channel.relative_to.is_none())
}

/// The group of the flight by its receiver, and the fingerprint that identifies copies.
fn grouped(
    position: &str,
    flight: &Flight,
    health: &LogHealth,
    binding: &Binding,
) -> Option<(ReceiverGroup, Option<FlightContent>)> {
    let kind = flight.channels.get(position)?.series.timeline().kind();
    let rate = rate_of(&binding.channels, position);
    Some((group_of(&health.about, binding, &health.format, position, rate, kind), content_of(flight, position)))
}

fn unusable(base: FlightLateness, reason: String) -> FlightLateness {
    FlightLateness { words: reason.clone(), failed: Some(reason), ..base }
}

/// Alarms for assumptions about a table.
fn assumed(flight: &Flight) -> impl Iterator<Item = DelayAlarm> {
    let notices = flight.notices.iter().filter(|n| ASSUMED.iter().any(|assumed| n.code == *assumed));
    notices.map(|n| DelayAlarm {
        gravity: Gravity::Amber,
        code: n.code.clone(),
        text: match n.place.starts_with(OF_REFERENCE_FILE) {
            true => format!("{OF_REFERENCE_FILE}: {}", n.text),
            false => n.text.clone(),
        },
    })
}

/// An alarm if a requested reference file is unusable.
fn unused_reference(reference: &ReferenceFile) -> Option<DelayAlarm> {
    let text = reference.words.clone();
    let alarm = DelayAlarm::of(Alarm::ReferenceNotUsed, text);
    reference.channels.is_empty().then_some(alarm)
}

fn measured_with(
    lateness: FlightLateness,
    delays: Option<FlightDelays>,
    network: Option<DelayNetwork>,
    notices: Notices,
) -> MeasuredFlight {
    MeasuredFlight {
        record_version: RECORD_VERSION,
        analysis_version: crate::ANALYSIS_VERSION,
        key: lateness.key.clone(),
        lateness,
        delays,
        network,
        notices,
    }
}

pub(crate) fn unknown(key: &str) -> FlightLateness {
    FlightLateness {
        key: key.to_owned(),
        failed: None,
        position: None,
        velocity: None,
        group: ReceiverGroup::default(),
        content: None,
        kind: DelayKind::CannotTell,
        also: vec![],
        words: String::new(),
        lateness: None,
        datum: NetworkDatum::None,
        against: String::new(),
        verdict: None,
        position_minus_velocity_s: None,
        card: None,
        reference_file: None,
        speed_rms_mps: None,
        acceleration_rms_mps2: None,
        jitter_s: None,
        lever_arm_s_per_decimetre: None,
        other_receivers: vec![],
        alarms: vec![],
        checked_against: None,
        advice: DelayAdvice::default(),
    }
}

/// One lateness per channel from the measured pairs. A reference file on the log's clock is on time; one with its own
/// clock has a lateness like any channel. A reference in the log is on time only if the pipeline says so. A reference
/// that channels contradict is not on time; the text says so.
fn network_of(
    delays: &FlightDelays,
    velocity: Option<&str>,
    reference: Option<&ReferenceFile>,
    log_reference_is_on_time: bool,
) -> (Option<DelayNetwork>, Option<String>) {
    let pairs: Vec<PairObservation> = delays.pairs.iter().map(observation).collect();
    let mut settings = NetworkSettings {
        compensation_velocity: velocity.map(str::to_owned),
        reference: match reference.map(|r| &r.clock) {
            Some(ReferenceClock::Same) => ReferenceUse::Datum,
            Some(ReferenceClock::Own(_)) => ReferenceUse::OwnClock,
            None if log_reference_is_on_time => ReferenceUse::Datum,
            Some(ReferenceClock::Unknown { .. }) | None => ReferenceUse::Judges,
        },
        ..NetworkSettings::default()
    };
    let is_untested = no_attitude_is_tested(delays);
    let solved = |settings: &NetworkSettings| {
        let network = covering_its_intervals(solve(&pairs, &lineage_from_name, settings)?);
        Some(if is_untested { with_untested_attitude(network) } else { network })
    };
    let network = solved(&settings);
    match network.as_ref().and_then(contradicts_reference) {
        Some(text) => {
            settings.reference = ReferenceUse::OwnClock;
            (solved(&settings), Some(text))
        }
        None => (network, None),
    }
}

/// A velocity or an IMU that is earlier than the reference by more than this contradicts it, s.
const EARLY_S: f64 = 0.02;

/// The velocities and the IMU that are earlier than a reference that counts as on time. No sensor measures a motion
/// before it happens; a position may be predicted.
fn contradicts_reference(network: &DelayNetwork) -> Option<String> {
    let measures = |c: &&ChannelLateness| !c.derived && !c.channel.starts_with("position");
    let is_early = |c: &&ChannelLateness| c.datum == NetworkDatum::Reference && c.interval_95_s[1] < -EARLY_S;
    let early = network.channels.iter().filter(measures).filter(is_early);
    let words: Vec<(&str, String)> = early
        .map(|c| {
            let early = Estimate { value: -c.lateness_s.value, ..c.lateness_s };
            (c.channel.as_str(), crate::delay::in_ms(&early))
        })
        .collect();
    let (first, early_ms) = words.first()?;
    let more = if words.len() > 1 { format!(" ({} more are early, too)", words.len() - 1) } else { String::new() };
    Some(format!(
        "{first} would be {early_ms} ms earlier than the reference{more}, and nothing is measured before it happens: the clock of the reference, or \
         of the log, is off. The reference is not used as the zero, and does not judge the removal"
    ))
}

/// With uncertainties as large as the intervals say. Where pairs disagree and none can be blamed, an interval covers the
/// results without each suspect: "300 ± 2 ms" beside 297 to 339 ms would be read as the former.
fn covering_its_intervals(mut network: DelayNetwork) -> DelayNetwork {
    for channel in &mut network.channels {
        let value = channel.lateness_s.value;
        let half_s = channel.interval_95_s.iter().map(|end| (end - value).abs()).fold(0.0, f64::max);
        if let Some(u) = &mut channel.lateness_s.standard_uncertainty {
            *u = u.max(half_s / NORMAL_95);
        }
        // The error of a filter against its own IMU is one-sided.
        if let Some(least_s) = channel.at_least_s.filter(|_| channel.weak) {
            channel.interval_95_s[0] = channel.interval_95_s[0].max(least_s);
        }
    }
    network
}

/// Standard deviations on each side that hold 95 % of a normal distribution.
const NORMAL_95: f64 = 1.96;

/// Standard uncertainty of the IMU's lateness that comes from an attitude whose own lateness is unknown, s. In a turn the
/// attitude alone tells where the force points to, so its lateness counts in full. Attitudes of autopilots are within
/// 30 ms, those behind a slow link or a filter some tens of milliseconds later.
const UNTESTED_ATTITUDE_S: f64 = 0.03;

/// Whether accelerations were compared, and none with an attitude that a gyro tested.
fn no_attitude_is_tested(delays: &FlightDelays) -> bool {
    let is_used = |p: &&PairDelay| p.delay.found().is_some() && p.not_for_network.is_none();
    let kind = DelayPairKind::VelocityAgainstAcceleration;
    let mut compared = delays.pairs.iter().filter(|p| p.kind == kind).filter(is_used).peekable();
    compared.peek().is_some() && compared.all(|p| p.is_attitude_untested)
}

/// With the uncertainty of an untested attitude in every lateness against the IMU. It is common to all of them: the
/// difference of two channels does not have it. The network is solved without it, so that a velocity that would come
/// before the motion still shows that the IMU is late.
fn with_untested_attitude(mut network: DelayNetwork) -> DelayNetwork {
    let is_tied: Vec<bool> = network.channels.iter().map(|c| c.datum == NetworkDatum::Imu).collect();
    if !is_tied.contains(&true) {
        return network;
    }
    for (row, _) in network.covariance_s2.iter_mut().zip(&is_tied).filter(|(_, tied)| **tied) {
        for (cell, _) in row.iter_mut().zip(&is_tied).filter(|(_, tied)| **tied) {
            *cell += UNTESTED_ATTITUDE_S.powi(2);
        }
    }
    for channel in network.channels.iter_mut().filter(|c| c.datum == NetworkDatum::Imu) {
        widen(channel, UNTESTED_ATTITUDE_S);
        channel.model_uncertainty_s = channel.model_uncertainty_s.hypot(UNTESTED_ATTITUDE_S);
    }
    network.datum_words += &format!(
        " No gyro shows how late its attitude is: {:.0} ms are assumed (standard uncertainty).",
        1e3 * UNTESTED_ATTITUDE_S
    );
    network
}

fn observation(pair: &PairDelay) -> PairObservation {
    let observed = PairObservation::from(pair);
    match (&pair.delay, &pair.not_for_network) {
        (_, Some(why)) => observed.not_used(why.clone()),
        (Finding::Found(found), None) => match found.rival_s {
            Some(rival) => observed.not_used(format!(
                "{:.0} and {:.0} ms fit it almost equally well",
                1e3 * found.delay_s.value,
                1e3 * rival
            )),
            None => observed,
        },
        _ => observed,
    }
}

/// The pair that compensation uses.
pub(crate) fn compensated_pair<'a>(delays: &'a FlightDelays, position: &str, velocity: &str) -> Option<&'a PairDelay> {
    delays
        .pairs
        .iter()
        .find(|p| p.kind == DelayPairKind::PositionAgainstVelocity && p.first == position && p.second == velocity)
}

/// A smaller change of a velocity against the IMU is left to its uncertainty, s.
const LEAST_CHANGE_S: f64 = 0.05;

/// A change of the velocity's delay against the IMU, in words, and its size, s: position and velocity of a receiver may
/// change together, which their difference does not show.
pub(crate) fn change_against_imu(velocity: &str, delays: &FlightDelays) -> Option<(String, Estimate)> {
    let is_used = |p: &&PairDelay| {
        p.kind == DelayPairKind::VelocityAgainstAcceleration && p.first == velocity && p.not_for_network.is_none()
    };
    let pair = delays.pairs.iter().filter(is_used).find(|p| p.delay.found().is_some())?;
    let found = pair.delay.found()?;
    let step = found.homogeneity?.largest_step;
    let u = |of: &Estimate| of.standard_uncertainty;
    let change_s = Estimate {
        value: (step.after_s.value - step.before_s.value).abs(),
        standard_uncertainty: u(&step.after_s).zip(u(&step.before_s)).map(|(after, before)| after.hypot(before)),
    };
    let alarm = found.alarm.as_ref().filter(|_| change_s.value > LEAST_CHANGE_S)?;
    Some((format!("{velocity} against {}: {alarm}. The position may change with it", pair.second), change_s))
}

/// Adds a standard uncertainty to a lateness, s.
fn widen(channel: &mut ChannelLateness, by_s: f64) {
    let value = channel.lateness_s.value;
    channel.lateness_s.standard_uncertainty = channel.lateness_s.standard_uncertainty.map(|u| u.hypot(by_s));
    for end in &mut channel.interval_95_s {
        let half_s = *end - value;
        *end = value + half_s.signum() * half_s.hypot(NORMAL_95 * by_s);
    }
}

/// Remarks on the comparison of the velocity with an acceleration, such as a heading that is off.
fn remarks_on_imu(velocity: &str, delays: &FlightDelays) -> Vec<DelayAlarm> {
    let is_of_imu = |p: &&PairDelay| p.kind == DelayPairKind::VelocityAgainstAcceleration && p.first == velocity;
    let found = delays.pairs.iter().filter(is_of_imu).filter_map(|p| p.delay.found());
    found.flat_map(|f| &f.remarks).map(|text| DelayAlarm::of(Alarm::DelayRemark, text.clone())).collect()
}

/// The flight's answer about its position.
fn answered(
    base: FlightLateness,
    delays: &FlightDelays,
    network: Option<&DelayNetwork>,
    health: &LogHealth,
) -> FlightLateness {
    let (position, velocity) = (base.position.clone().unwrap_or_default(), base.velocity.clone().unwrap_or_default());
    let pair = match &base.velocity {
        Some(_) => compensated_pair(delays, &position, &velocity),
        None => pair_with_reference(delays, &position),
    };
    let over_time = pair.and_then(|p| p.varies.as_ref());
    let channel = network.and_then(|n| n.channel(&position)).cloned();
    let measured = pair.and_then(|p| p.delay.found());
    // The same number, and the same uncertainty, where the velocity is the zero.
    let against_velocity = channel.as_ref().filter(|c| c.relative_to.as_deref() == Some(velocity.as_str()));
    let position_minus_velocity_s = against_velocity
        .map(|c| c.lateness_s)
        .or_else(|| network.and_then(|n| difference(n, &position, &velocity)))
        .or_else(|| measured.map(|m| m.delay_s))
        .filter(|_| base.velocity.is_some());
    let mut out = FlightLateness {
        datum: channel.as_ref().map_or(NetworkDatum::None, |c| c.datum),
        against: against(channel.as_ref(), &velocity),
        verdict: network.map(|n| n.verdict),
        position_minus_velocity_s,
        lateness: channel,
        jitter_s: over_time.and_then(|o| Some(o.jitters?.standard_deviation_s)),
        lever_arm_s_per_decimetre: pair.and_then(|p| p.lever_arm_s_per_decimetre),
        ..base
    };
    out.kind = kind_of(&out, over_time, measured);
    let change = change_against_imu(&velocity, delays).filter(|_| !out.kind.varies());
    if let Some((_, change_s)) = &change {
        out.kind = DelayKind::Scatters;
        out.lateness.iter_mut().for_each(|channel| widen(channel, change_s.value / 12_f64.sqrt()));
    }
    out.also = also(over_time);
    out.alarms = alarms::of(&out, network, measured, over_time);
    if change.is_some() {
        // What is said of a lasting change holds for the difference only.
        let of_pair = out.alarms.iter_mut().filter(|alarm| alarm.code == Alarm::DelayRemark);
        of_pair.for_each(|alarm| alarm.text.insert_str(0, "Position against velocity: "));
    }
    out.alarms.extend(unused_imu(&out, delays));
    out.alarms.extend(remarks_on_imu(&velocity, delays));
    out.alarms.extend(change.as_ref().map(|(text, _)| DelayAlarm::of(Alarm::DelayDoubtful, text.clone())));
    out.words = words(&out, pair, over_time);
    if out.datum == NetworkDatum::Imu && no_attitude_is_tested(delays) {
        out.words +=
            &format!(". No gyro tests the attitude of the IMU: U holds {:.0} ms for it", 2e3 * UNTESTED_ATTITUDE_S);
    }
    if let Some((reference, check)) = checked_by_reference(&out, delays) {
        out.words += &check;
        out.checked_against = Some(reference.to_owned());
    }
    if let Some(network) = network {
        out.other_receivers = other_receivers(&out, network);
        let others = receivers_in_words(&out);
        out.alarms.extend(other_receiver(&others));
        out.words += &others;
        out.words += &velocities_in_words(&velocity, network);
    }
    let absolute = out.lateness.as_ref().is_some_and(|l| l.relative_to.is_none());
    let is_one_number = !out.kind.varies() && change.is_none();
    let may_be_set = |lateness_s: &Estimate| Side::of_estimate(lateness_s) == Side::Late && is_one_number;
    if let Some(lateness_s) = out.lateness_s().filter(|lateness_s| absolute && may_be_set(lateness_s)) {
        let other_velocity = network.and_then(|n| other_velocity(n, &position));
        out.advice = advice(&lateness_s, &out, other_velocity, health);
    }
    out.alarms.extend(parameter_differs(&out, health));
    out.advice.fly = fly(&out, pair, over_time);
    out
}

/// An alarm about other receivers of the log, from their words.
fn other_receiver(words: &str) -> Option<DelayAlarm> {
    let text = words.strip_prefix(". ")?;
    Some(DelayAlarm::of(Alarm::OtherReceiver, text.to_owned()))
}

/// An alarm if the position is on time or early, and a parameter for the first receiver states a delay that the interval
/// excludes by more than [`ON_TIME_S`].
fn parameter_differs(out: &FlightLateness, health: &LogHealth) -> Option<DelayAlarm> {
    let is_known = |c: &&ChannelLateness| c.relative_to.is_none() && !c.weak && c.channel == "position.gps";
    let own = out.lateness.as_ref().filter(is_known).filter(|_| !out.kind.varies())?;
    let is_late = Side::of_estimate(&own.lateness_s) == Side::Late;
    let [_, most_s] = own.interval_95_s;
    let states_more = |c: &&ConfiguredDelay| is_gps_delay(&c.parameter) && c.value_s > most_s + ON_TIME_S;
    let stated = health.about.configured_delays.iter().find(states_more).filter(|_| !is_late)?;
    let text = format!(
        "{} is {:.0} ms in this log, and {} is {} ms late",
        stated.parameter,
        1e3 * stated.value_s,
        own.channel,
        in_ms(&own.lateness_s)
    );
    Some(DelayAlarm::of(Alarm::ParameterDiffers, text))
}

/// Why the IMU of a log does not show how late position and velocity are.
fn unused_imu(out: &FlightLateness, delays: &FlightDelays) -> Option<DelayAlarm> {
    let velocity = out.velocity.as_deref().filter(|_| out.datum == NetworkDatum::None && out.lateness.is_some())?;
    let is_imu = |p: &&PairDelay| p.kind == DelayPairKind::VelocityAgainstAcceleration && p.first == velocity;
    let why = |p: &PairDelay| match (&p.delay, &p.not_for_network) {
        (Finding::CannotTell(why), _) | (_, Some(why)) => Some(format!("{} is not used: {why}", p.second)),
        (Finding::Found(_), None) => None,
    };
    let text = delays.pairs.iter().filter(is_imu).find_map(why)?;
    Some(DelayAlarm::of(Alarm::DelayRemark, text))
}

fn against(channel: Option<&ChannelLateness>, velocity: &str) -> String {
    match channel {
        Some(ChannelLateness { relative_to: Some(zero), .. }) => format!("relative to {zero}"),
        Some(ChannelLateness { datum: NetworkDatum::Imu, .. }) => "imu".to_owned(),
        Some(ChannelLateness { datum: NetworkDatum::Reference, .. }) => "reference".to_owned(),
        _ => format!("relative to {velocity}"),
    }
}

fn kind_of(out: &FlightLateness, over_time: Option<&DelayOverTime>, measured: Option<&MeasuredDelay>) -> DelayKind {
    if let Some(varies) = over_time.map(|o| o.kind).filter(|k| k.varies()) {
        return varies;
    }
    let Some(Estimate { value, standard_uncertainty: Some(u) }) = out.lateness_s() else {
        return DelayKind::CannotTell;
    };
    // The other words say that the delay stays the same.
    let scatters = measured.and_then(|m| m.homogeneity).is_some_and(|h| h.scatters());
    if !over_time.is_some_and(tested) {
        return DelayKind::NotTested;
    }
    if scatters {
        return DelayKind::Scatters;
    }
    match Side::of(value, u) {
        Side::OnTime => DelayKind::OnTime,
        Side::Early => DelayKind::Early,
        Side::Late => DelayKind::Constant,
    }
}

/// Where a lateness lies, whether or not it stays the same.
#[derive(Clone, Copy, PartialEq)]
enum Side {
    /// Zero within the margin, by the test of equivalence.
    OnTime,
    Early,
    Late,
}

impl Side {
    fn of(lateness_s: f64, u: f64) -> Side {
        if lateness_s.abs() + 1.645 * u < ON_TIME_S {
            Side::OnTime
        } else if lateness_s + 1.96 * u < 0.0 {
            Side::Early
        } else {
            Side::Late
        }
    }

    fn of_estimate(lateness_s: &Estimate) -> Side {
        Side::of(lateness_s.value, lateness_s.standard_uncertainty.unwrap_or_default())
    }
}

/// Whether the flight was tested for changes of its delay.
fn tested(over_time: &DelayOverTime) -> bool {
    over_time.constancy.tested && over_time.kind != DelayKind::CannotTell
}

fn also(over_time: Option<&DelayOverTime>) -> Vec<String> {
    let Some(over_time) = over_time else { return vec![] };
    let seen = [
        (over_time.jitters.is_some(), "jitters"),
        (!over_time.late_fixes.is_empty(), "late-fixes"),
        (!over_time.bursts.is_empty(), "bursts"),
    ];
    seen.into_iter().filter(|(seen, _)| *seen).map(|(_, name)| name.to_owned()).collect()
}

fn words(out: &FlightLateness, pair: Option<&PairDelay>, over_time: Option<&DelayOverTime>) -> String {
    let position = out.position.as_deref().unwrap_or("position");
    if let Some(over_time) = over_time.filter(|o| o.kind.varies()) {
        let of_pair =
            out.velocity.as_ref().map(|velocity| format!(" The delay is that of {position} against {velocity}."));
        return over_time.words.clone() + &of_pair.unwrap_or_default();
    }
    let Some(channel) = &out.lateness else {
        return match pair.map(|p| &p.delay) {
            Some(Finding::CannotTell(why)) => why.clone(),
            _ => format!("{position} was not compared with a velocity"),
        };
    };
    let value = in_ms(&channel.lateness_s);
    let datum = if channel.datum == NetworkDatum::Reference { "the reference" } else { "the IMU" };
    let mut text = match (&channel.relative_to, Side::of_estimate(&channel.lateness_s)) {
        (Some(zero), _) if channel.lateness_s.value >= 0.0 => {
            format!("{position} is {value} ms later than {zero}; the lateness of both is unknown")
        }
        (Some(zero), _) => {
            let earlier = Estimate { value: -channel.lateness_s.value, ..channel.lateness_s };
            format!("{position} is {} ms earlier than {zero}; the lateness of both is unknown", in_ms(&earlier))
        }
        (None, Side::OnTime) => format!("{position} is on time ({value} ms against {datum})"),
        (None, Side::Early) => format!("{position} is early ({value} ms against {datum})"),
        (None, _) if channel.weak => {
            let [low, high] = channel.interval_95_s.map(|s| 1e3 * s);
            format!("{position} is at least {low:.0} ms late against {datum}, and at most {high:.0} ms")
        }
        (None, _) => format!("{position} is {value} ms late against {datum}"),
    };
    if let Some(rests_on) = &channel.rests_on {
        text += &format!(". This rests on {}, which no other pair checks", rests_on.trim_end_matches(", unchecked"));
    }
    if let Some(x) = out.lever_arm_s_per_decimetre {
        text += &format!(". Each 0.1 m of unknown lever arm adds ± {:.0} ms", 1e3 * x.abs());
    }
    text
}

/// Lateness of the position against a reference in the log. That reference is not a datum, so that it can check the
/// answer independently. A reference file has its own line, and its clock may differ from that of the log.
fn checked_by_reference<'a>(out: &FlightLateness, delays: &'a FlightDelays) -> Option<(&'a str, String)> {
    let relative = out.lateness.as_ref()?.relative_to.is_some() && !out.kind.varies() && out.reference_file.is_none();
    against_reference(out.position.as_deref().filter(|_| relative)?, delays)
}

fn pair_with_reference<'a>(delays: &'a FlightDelays, position: &str) -> Option<&'a PairDelay> {
    delays.pairs.iter().find(|p| p.kind == DelayPairKind::PositionAgainstReference && p.first == position)
}

/// The reference, and how late the position is against it, in words.
fn against_reference<'a>(position: &str, delays: &'a FlightDelays) -> Option<(&'a str, String)> {
    let pair = pair_with_reference(delays, position)?;
    let found = pair.delay.found()?.delay_s;
    let words = format!(
        ". As a check: the delay of {position} against {} is {} ms (U of the fit alone)",
        pair.second,
        in_ms(&found)
    );
    Some((&pair.second, words))
}

/// Other measured positions, not of a filter, with a different lateness: the delay of one receiver is wrong for
/// another.
fn other_receivers(out: &FlightLateness, network: &DelayNetwork) -> Vec<OtherReceiver> {
    let Some(own) = out.lateness.as_ref().filter(|_| !out.kind.varies()) else { return vec![] };
    let is_other = |channel: &&ChannelLateness| {
        let name = channel.channel.as_str();
        let differs = difference(network, name, &own.channel)
            .is_some_and(|d| d.value.abs() > ON_TIME_S.max(3.0 * d.standard_uncertainty.unwrap_or_default()));
        name.starts_with("position.") && lineage_from_name(name) == Lineage::Measured && differs
    };
    let others = network.channels.iter().filter(is_other);
    others.map(|c| OtherReceiver { channel: c.channel.clone(), lateness_s: c.lateness_s }).collect()
}

/// Other measured velocities that are not on time with the one that the position is compared with: another choice of
/// velocity would give another delay.
fn velocities_in_words(velocity: &str, network: &DelayNetwork) -> String {
    let is_measured = |name: &str| name.starts_with("velocity.") && lineage_from_name(name) == Lineage::Measured;
    if !is_measured(velocity) {
        return String::new();
    }
    let names =
        network.channels.iter().map(|c| c.channel.as_str()).filter(|name| *name != velocity && is_measured(name));
    let apart = names.filter_map(|name| Some((name, difference(network, name, velocity)?)));
    let differs = |d: &Estimate| d.value.abs() > ON_TIME_S.max(3.0 * d.standard_uncertainty.unwrap_or_default());
    let one = |(name, d): (&str, Estimate)| {
        let (size, word) = (Estimate { value: d.value.abs(), ..d }, if d.value < 0.0 { "earlier" } else { "later" });
        format!(". {name} is {} ms {word} than {velocity}", in_ms(&size))
    };
    apart.filter(|(_, d)| differs(d)).map(one).collect()
}

fn receivers_in_words(out: &FlightLateness) -> String {
    let against = match out.lateness.as_ref().and_then(|own| own.relative_to.as_ref()) {
        Some(zero) => format!("later than {zero}"),
        None => "late".to_owned(),
    };
    let one = |other: &OtherReceiver| {
        format!(". Another position of this log, {}, is {} ms {against}", other.channel, in_ms(&other.lateness_s))
    };
    out.other_receivers.iter().map(one).collect()
}

/// What to fly so that the next log shows what this one does not.
fn fly(out: &FlightLateness, pair: Option<&PairDelay>, over_time: Option<&DelayOverTime>) -> Option<String> {
    // A delay that changes was measured: more flying does not make it one number.
    if out.kind.varies() || out.lateness.is_some() && out.kind != DelayKind::NotTested {
        return None;
    }
    let of_test = over_time.and_then(|o| o.what_to_fly.clone());
    match pair.map(|p| &p.delay) {
        // With a coarse clock or too few fixes, turns do not help.
        Some(Finding::CannotTell(why)) if out.lateness.is_none() => advice_in(why).map(str::to_owned).or(of_test),
        _ => of_test,
    }
}

/// The sentence of a reason that says what to fly.
fn advice_in(why: &str) -> Option<&str> {
    why.split_inclusive(". ").map(str::trim).find(|s| s.contains("turns") || s.contains("circles"))
}

/// Start of a note about the range of a parameter.
const TAKES: &str = "it takes ";
/// Start of the firmware that a parameter belongs to.
const PX4: &str = "PX4";
const ARDUPILOT: &str = "ArduPilot";
/// Parameter of PX4 that limits the others, and its usual value, ms.
const PX4_LONGEST: (&str, f64) = ("EKF2_DELAY_MAX", EKF2_DELAY_MAX_DEFAULT_MS as f64);

/// Settings of the autopilot that wrote the log which remove this delay.
fn advice(
    lateness_s: &Estimate,
    out: &FlightLateness,
    other_velocity: Option<(String, Estimate)>,
    health: &LogHealth,
) -> DelayAdvice {
    let mut set = vec![];
    let is_only_a_bound = |own: &ChannelLateness| record::is_one_sided(own.lateness_s.value, own.interval_95_s);
    let is_uncertain = lateness_s.standard_uncertainty.is_some_and(|u| 2.0 * u >= lateness_s.value);
    if lateness_s.value <= 0.0 || is_uncertain || out.lateness.as_ref().is_some_and(is_only_a_bound) {
        return DelayAdvice::default();
    }
    let value = (lateness_s.value * 1e3).round() / 1e3;
    set.push(DelaySetting {
        name: "position_s".into(),
        value,
        unit: "s".into(),
        in_log: None,
        note: String::new(),
        unsuitable: false,
    });
    let inertial = out.datum == NetworkDatum::Imu && out.lateness.as_ref().is_some_and(|l| !l.weak);
    let system = health.about.system.as_deref().unwrap_or_default().to_ascii_lowercase();
    let is_px4 = system.contains("px4");
    let is_ardupilot = system.contains("ardu") || system.contains("apm") || health.format.contains("DataFlash");
    let stated = |name: &str| health.about.configured_delays.iter().find(|c| c.parameter == name);
    let stated_ms = |name: &str| stated(name).map(|c| 1e3 * c.value_s);
    let firmware = match (inertial, is_px4, is_ardupilot) {
        (true, true, _) => PX4,
        (true, _, true) => ARDUPILOT,
        _ => return DelayAdvice { set, fly: None },
    };
    let delay = Delay::from_seconds(lateness_s.value).unwrap_or(Delay::ZERO);
    let all = autopilot_advice(delay, lateness_s.standard_uncertainty, MeasuredAgainst::Inertial);
    let of_firmware: Vec<&AutopilotParameter> =
        all.parameters.iter().filter(|p| p.firmware.starts_with(firmware)).collect();
    // The name differs between versions: the log has that of its own.
    let named = of_firmware.iter().find(|p| stated_ms(p.name).is_some()).or(of_firmware.first());
    if let Some(p) = named {
        let mut setting = parameter_setting(p, stated_ms(p.name), stated_ms(PX4_LONGEST.0));
        if setting.in_log.is_none() && setting.note.is_empty() && firmware == ARDUPILOT {
            setting.note = "before ArduPilot 4.6, GPS_DELAY_MS".to_owned();
        }
        if let Some((velocity, late_s)) = other_velocity.filter(|_| !setting.unsuitable) {
            setting.note = format!("it also shifts {velocity}, which is {} ms late", in_ms(&late_s));
            setting.unsuitable = true;
        }
        set.push(setting);
    }
    DelayAdvice { set, fly: None }
}

/// The velocity of the same receiver and its lateness, if it differs from that of the position: a parameter of the
/// autopilot shifts both.
fn other_velocity(network: &DelayNetwork, position: &str) -> Option<(String, Estimate)> {
    let velocity = format!("velocity.{}", position.strip_prefix("position.")?);
    let apart = difference(network, position, &velocity)?;
    let is_apart = apart.value.abs() > ON_TIME_S.max(3.0 * apart.standard_uncertainty.unwrap_or_default());
    is_apart.then(|| Some((velocity.clone(), network.channel(&velocity)?.lateness_s)))?
}

/// The setting of an autopilot parameter that has a value in the log, and perhaps a limit, ms.
fn parameter_setting(p: &AutopilotParameter, in_log: Option<f64>, longest_ms: Option<f64>) -> DelaySetting {
    let note = match p.fit {
        ParameterFit::OutOfRange => format!("{TAKES}{} to {} ms", p.range_ms[0], p.range_ms[1]),
        ParameterFit::RoundsToAutomatic => "0 means automatic".to_owned(),
        ParameterFit::Fits | ParameterFit::AtTheEdge => {
            let words = [in_log.map(|ms| in_log_words(p, ms)), limit_words(p, longest_ms)];
            words.into_iter().flatten().collect::<Vec<String>>().join("; ")
        }
    };
    DelaySetting {
        name: p.name.to_owned(),
        value: p.value_ms as f64,
        unit: "ms".into(),
        in_log,
        note,
        unsuitable: p.fit == ParameterFit::OutOfRange,
    }
}

/// The value of a parameter in the log. In ArduPilot, 0 means the default delay of the receiver's driver.
fn in_log_words(p: &AutopilotParameter, ms: f64) -> String {
    let is_within = p.interval_ms.is_some_and(|[least, most]| (least as f64..=most as f64).contains(&ms));
    match ms {
        0.0 if p.firmware.starts_with(ARDUPILOT) => "it is 0 in this log, which means automatic".to_owned(),
        _ if is_within => format!("it is {ms:.0} ms in this log, which agrees"),
        _ => format!("it is {ms:.0} ms in this log"),
    }
}

/// The limit of PX4 that is below the value.
fn limit_words(p: &AutopilotParameter, longest_ms: Option<f64>) -> Option<String> {
    let (limit, usual_ms) = PX4_LONGEST;
    let is_beyond = p.firmware.starts_with(PX4) && p.value_ms as f64 > longest_ms.unwrap_or(usual_ms);
    is_beyond.then(|| match longest_ms {
        Some(ms) => format!("raise {limit} too: it is {ms:.0} ms in this log"),
        None => format!("raise {limit} too if it is {usual_ms:.0} ms"),
    })
}

/// The settings for some flights with a common delay. States the values in their logs if these are equal. A setting that
/// cannot remove the delay of one of them is no setting for all.
pub(crate) fn advice_for(lateness_s: &Estimate, flights: &[&FlightLateness]) -> DelayAdvice {
    let Some(like) = flights.iter().find(|l| !l.advice.set.is_empty()) else { return DelayAdvice::default() };
    let delay = Delay::from_seconds(lateness_s.value).unwrap_or(Delay::ZERO);
    let known = autopilot_advice(delay, lateness_s.standard_uncertainty, MeasuredAgainst::Inertial);
    let with = |s: &DelaySetting| match known.parameters.iter().find(|p| p.name == s.name) {
        Some(p) => {
            let own = || flights.iter().flat_map(|l| &l.advice.set).filter(|own| own.name == s.name);
            let mut stated = own().filter(|own| !own.unsuitable).map(|own| own.in_log);
            let in_log = stated.next().flatten().filter(|first| stated.all(|other| other == Some(*first)));
            let setting = parameter_setting(p, in_log, None);
            match own().find(|own| own.unsuitable && !setting.unsuitable && !own.note.starts_with(TAKES)) {
                Some(own) => DelaySetting { note: own.note.clone(), unsuitable: true, ..setting },
                None => setting,
            }
        }
        None => DelaySetting { value: (lateness_s.value * 1e3).round() / 1e3, ..s.clone() },
    };
    DelayAdvice { set: like.advice.set.iter().map(with).collect(), fly: None }
}

fn speed_rms(velocity: Option<&flight::Channel>) -> Option<f64> {
    let channel = velocity?;
    let rows = channel.update_rows();
    let square = |row: &usize| channel.series.component(0)[*row].powi(2) + channel.series.component(1)[*row].powi(2);
    let sum: f64 = rows.iter().map(square).sum();
    (!rows.is_empty()).then(|| (sum / rows.len() as f64).sqrt()).filter(|v| v.is_finite())
}

/// From changes over a second, in which noise of the velocity is small.
fn acceleration_rms(velocity: Option<&flight::Channel>) -> Option<f64> {
    const BASE_S: f64 = 1.0;
    let channel = velocity?;
    let stamps = channel.series.timeline().stamps();
    let rows = channel.update_rows();
    let mut before = 0;
    let mut squares = vec![];
    for &now in &rows {
        while before + 1 < rows.len() && stamps[now].seconds_since(stamps[rows[before + 1]]) >= BASE_S {
            before += 1;
        }
        let base_s = stamps[now].seconds_since(stamps[rows[before]]);
        // Over a gap the change is not an acceleration.
        if (BASE_S..=2.0 * BASE_S).contains(&base_s) {
            let change = |k: usize| channel.series.component(k)[now] - channel.series.component(k)[rows[before]];
            squares.push((change(0).hypot(change(1)) / base_s).powi(2));
        }
    }
    let mean = squares.iter().sum::<f64>() / squares.len() as f64;
    Some(mean.sqrt()).filter(|a| a.is_finite())
}

/// `1 flight`, `2 flights`, `3 fixes`.
pub(crate) fn counted(n: usize, what: &str) -> String {
    match (n, what) {
        (1, _) => format!("1 {what}"),
        (_, "fix") => format!("{n} fixes"),
        _ => format!("{n} {what}s"),
    }
}

#[cfg(test)]
pub(crate) mod tests;
