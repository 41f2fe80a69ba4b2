//! Lateness of position and velocity as far as it is known.

use compensation_replay::{KnownLateness, TruthEffect};
use record::{Decision, DelaySource, Estimate, FlightLateness, JudgedBy, NetworkVerdict, ReferenceClock};

/// What an effect is judged by: the flight's own lateness, else that of its group, else the velocity alone.
pub(crate) fn known(lateness: &FlightLateness, decision: &Decision) -> Option<KnownLateness> {
    let channel = lateness.lateness.as_ref();
    let undecided = lateness.verdict == Some(NetworkVerdict::Undecided);
    let jitter_s = lateness.jitter_s.unwrap_or(0.0);
    if let Some(own) = channel.filter(|c| c.relative_to.is_none() && !c.weak && !undecided) {
        return Some(KnownLateness { lateness_s: own.lateness_s, judged_by: JudgedBy::Lateness, jitter_s });
    }
    if let (Some(DelaySource::OthersFlights), Some(value)) = (decision.used, decision.delay_s) {
        let lateness_s = Estimate { value, standard_uncertainty: decision.standard_uncertainty_s };
        return Some(KnownLateness { lateness_s, judged_by: JudgedBy::Lateness, jitter_s });
    }
    let velocity = lateness.velocity.clone()?;
    let lateness_s = lateness.position_minus_velocity_s?;
    Some(KnownLateness { lateness_s, judged_by: JudgedBy::Velocity(velocity), jitter_s })
}

/// The error against the reference, with its condition if the clock of a reference file was set by the log.
pub(crate) fn on_condition(truth: TruthEffect, lateness: &FlightLateness) -> TruthEffect {
    let clock = lateness.reference_file.as_ref().map(|file| &file.clock);
    let if_on_time = match clock {
        Some(ReferenceClock::Own(offset)) => Some(offset.by.clone()),
        Some(ReferenceClock::Same | ReferenceClock::Unknown { .. }) | None => None,
    };
    TruthEffect { if_on_time, ..truth }
}

/// Lateness of the velocity, s: [`known`] minus the difference between position and velocity. `None` if the lateness is
/// only known against that velocity.
pub(crate) fn velocity_lateness_s(lateness: &FlightLateness, decision: &Decision) -> Option<Estimate> {
    let position = known(lateness, decision).filter(|known| known.judged_by == JudgedBy::Lateness)?.lateness_s;
    let apart = lateness.position_minus_velocity_s?;
    let standard_uncertainty = position.standard_uncertainty.zip(apart.standard_uncertainty).map(|(p, a)| p.hypot(a));
    Some(Estimate { value: position.value - apart.value, standard_uncertainty })
}
