//! Lateness of position and velocity as far as it is known.

use compensation_replay::{KnownLateness, MotionRms, TruthEffect};
use flight::Alarm;
use record::{
    ChannelLateness, Decision, DelaySource, Estimate, FlightLateness, JudgedBy, NetworkDatum, NetworkVerdict,
    ReferenceClock,
};

/// What an effect is judged by: the flight's own lateness, else the difference between position and velocity with the
/// lateness of the velocity on the card, else the lateness of the group, if this flight has the same difference, else the
/// difference alone. A flight that shows neither is not judged.
pub(crate) fn known(lateness: &FlightLateness, decision: &Decision) -> Option<KnownLateness> {
    let channel = lateness.lateness.as_ref();
    let undecided = lateness.verdict == Some(NetworkVerdict::Undecided);
    let apart_s = lateness.position_minus_velocity_s;
    let doubtful = |datum: NetworkDatum| datum == NetworkDatum::Reference && is_contradicted(lateness);
    let usable = |c: &&ChannelLateness| c.relative_to.is_none() && !c.weak && !undecided && !doubtful(c.datum);
    let own = channel.filter(usable).map(|own| own.lateness_s).or_else(|| with_card(lateness, decision));
    let of_group = || match (decision.used, decision.delay_s, apart_s) {
        (Some(DelaySource::OthersFlights), Some(value), Some(_)) => {
            Some(Estimate { value, standard_uncertainty: decision.standard_uncertainty_s })
        }
        _ => None,
    };
    let jitter_s = lateness.jitter_s.unwrap_or(0.0);
    if let Some(lateness_s) = own.or_else(of_group) {
        let velocity_late_s = apart_s.map(|apart| minus(&lateness_s, &apart));
        return Some(KnownLateness { lateness_s, judged_by: JudgedBy::Lateness, jitter_s, velocity_late_s });
    }
    let judged_by = JudgedBy::Velocity(lateness.velocity.clone()?);
    Some(KnownLateness { lateness_s: apart_s?, judged_by, jitter_s, velocity_late_s: None })
}

/// The lateness of a position that is only known against a velocity, with that velocity as late as on the card.
fn with_card(lateness: &FlightLateness, decision: &Decision) -> Option<Estimate> {
    let card = lateness.card.as_ref().filter(|_| decision.used == Some(DelaySource::Card))?.found()?;
    Some(plus(&lateness.position_minus_velocity_s?, &card.card.velocity_delay_s?))
}

/// A smaller difference is no contradiction, s.
const LEAST_S: f64 = 0.02;
/// Nor is a difference of fewer standard uncertainties.
const CERTAIN_U: f64 = 3.0;

/// How a stated delay or a card contradicts a flight that shows only the difference between position and velocity: by a
/// smaller delay the velocity would come before the motion.
pub(crate) fn velocity_before_motion(lateness: &FlightLateness, decision: &Decision) -> Option<String> {
    let is_given = matches!(decision.used, Some(DelaySource::Fixed | DelaySource::Card));
    let is_absolute = lateness.lateness.as_ref().is_some_and(|channel| channel.relative_to.is_none());
    if !is_given || is_absolute {
        return None;
    }
    let (apart_s, removed_s) = (lateness.position_minus_velocity_s?, decision.delay_s?);
    let u_s = apart_s.standard_uncertainty?.hypot(decision.standard_uncertainty_s.unwrap_or(0.0));
    let early_s = apart_s.value - removed_s;
    (early_s > LEAST_S.max(CERTAIN_U * u_s)).then(|| {
        format!(
            "position - velocity is {} ms in this flight: if the position is only {:.1} ms late, the velocity comes {:.0} ms \
             before the motion",
            crate::delay::in_ms(&apart_s),
            1e3 * removed_s,
            1e3 * early_s
        )
    })
}

/// How a card that gives the removed delay and that of the velocity differs from the flight, which shows the difference
/// of both.
pub(crate) fn contradiction_of_card(lateness: &FlightLateness, decision: &Decision) -> Option<String> {
    let seen_s = with_card(lateness, decision)?;
    let card = lateness.card.as_ref()?.found()?;
    let excess_s = seen_s.value - card.delay_s.value;
    let u_s = seen_s.standard_uncertainty?.hypot(card.delay_s.standard_uncertainty?);
    (excess_s.abs() > LEAST_S.max(CERTAIN_U * u_s)).then(|| {
        format!(
            "position - velocity is {} ms in this flight, and {:.1} ms on the card",
            crate::delay::in_ms(&lateness.position_minus_velocity_s.unwrap_or(seen_s)),
            1e3 * (card.delay_s.value - card.card.velocity_delay_s.map_or(0.0, |v| v.value))
        )
    })
}

/// The motion over which a lateness becomes an error.
pub(crate) fn motion(lateness: &FlightLateness) -> MotionRms {
    MotionRms {
        speed_mps: lateness.speed_rms_mps.unwrap_or(0.0),
        acceleration_mps2: lateness.acceleration_rms_mps2.unwrap_or(0.0),
    }
}

/// Whether other channels of the log contradict the clock of its reference.
pub(crate) fn is_contradicted(lateness: &FlightLateness) -> bool {
    lateness.alarms.iter().any(|alarm| alarm.code == Alarm::ReferenceContradicted)
}

/// The error against the reference, with its condition if the clock of a reference file was set by the log. `None` if the
/// clock of the reference is contradicted.
pub(crate) fn judging(truth: TruthEffect, lateness: &FlightLateness) -> Option<TruthEffect> {
    let clock = lateness.reference_file.as_ref().map(|file| &file.clock);
    let if_on_time = match clock {
        Some(ReferenceClock::Own(offset)) => Some(offset.by.clone()),
        Some(ReferenceClock::Same | ReferenceClock::Unknown { .. }) | None => None,
    };
    (!is_contradicted(lateness)).then_some(TruthEffect { if_on_time, ..truth })
}

/// Lateness of the velocity, s: [`known`] minus the difference between position and velocity. `None` if the lateness is
/// only known against that velocity.
pub(crate) fn velocity_lateness_s(lateness: &FlightLateness, decision: &Decision) -> Option<Estimate> {
    known(lateness, decision)?.velocity_late_s
}

fn plus(a: &Estimate, b: &Estimate) -> Estimate {
    let standard_uncertainty = a.standard_uncertainty.zip(b.standard_uncertainty).map(|(a, b)| a.hypot(b));
    Estimate { value: a.value + b.value, standard_uncertainty }
}

fn minus(a: &Estimate, b: &Estimate) -> Estimate {
    plus(a, &Estimate { value: -b.value, ..*b })
}
