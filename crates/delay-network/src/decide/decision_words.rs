//! Decisions in plain English.

use super::RelativeLateness;
use super::group::{Evidence, why_not_own};
use super::table::Choice;
use crate::FlightSources;
use crate::words::ms;
use record::{DelaySource, Estimate};

/// `201.5 ± 15.7 ms`, with twice the standard uncertainty.
pub(crate) fn with_uncertainty(estimate: Estimate) -> String {
    match estimate.standard_uncertainty {
        Some(u) => format!("{} ± {} ms", ms(estimate.value), ms(2.0 * u)),
        None => format!("{} ms", ms(estimate.value)),
    }
}

fn flights(count: usize) -> String {
    if count == 1 { "1 other flight".to_owned() } else { format!("{count} other flights") }
}

/// Rows 1 to 4.
pub(crate) fn by_flights(flight: &FlightSources, evidence: &Evidence, choice: &Choice) -> String {
    let count = flights(choice.pooled);
    let own = evidence.own.map(with_uncertainty).unwrap_or_default();
    match choice.row {
        1 => format!("From {count} of this group. Its own delay, {own}, agrees, so the residual is a fair test."),
        2 => {
            let apart = evidence.own.zip(evidence.others).map_or(0.0, |(own, others)| own.value - others.mean_s);
            let side = if apart > 0.0 { "later" } else { "earlier" };
            format!(
                "Differs from its group: {} ms {side} than {count}. Its own delay, {own}, is removed, so the residual \
                 is zero by construction.",
                ms(apart.abs())
            )
        }
        3 => format!("From {count} of this group. Its own delay is unknown: {}.", why(flight)),
        _ => {
            let alone = match (evidence.cluster_unknown, choice.pooled) {
                (true, _) => "its group has two different delays, and no other flight certainly has the same one",
                _ => "there are not enough other flights to test it",
            };
            format!("Its own delay, {own}: the residual is zero by construction, and {alone}.")
        }
    }
}

/// Why the flight has no delay of its own.
pub(crate) fn why(flight: &FlightSources) -> String {
    match flight.position.as_ref().map(why_not_own) {
        Some(Some(why)) => why.to_owned(),
        Some(None) => "its figures have no usable uncertainty".to_owned(),
        None => flight.not_measured.clone().unwrap_or_else(|| "no pair of channels gave one".to_owned()),
    }
}

/// Row 8, including its use of a card or a stated number.
pub(crate) fn without_own_delay(flight: &FlightSources, evidence: &Evidence, source: Option<DelaySource>) -> String {
    let known = match &flight.relative {
        Some(pair) => format!("The lateness of position and {} is unknown: {}", pair.velocity, why(flight)),
        None => format!("The lateness of the position is unknown: {}", why(flight)),
    };
    let cluster = match evidence.cluster_unknown {
        true => " Its group has two different delays, and which one this flight has is unknown.",
        false => "",
    };
    let unlike = match (&flight.relative, evidence.unlike_s) {
        (Some(pair), Some(others_s)) => format!(
            " The mean of the other flights of its group is not its delay: position minus {} is {} here and {} ms in \
             those flights.",
            pair.velocity,
            with_uncertainty(pair.delay_s),
            ms(others_s)
        ),
        _ => String::new(),
    };
    let done = match source {
        Some(DelaySource::Card) => "The delay on the sensor card is removed.",
        Some(DelaySource::Fixed) => {
            "The number stated in the pipeline is removed. The delay network of this flight does not test it."
        }
        _ => "Nothing is removed.",
    };
    format!("{known}.{cluster}{unlike} {done}")
}

/// Row 9.
pub(crate) fn pair(pair: &RelativeLateness) -> String {
    let velocity = &pair.velocity;
    format!(
        "Aligns the position with {velocity}: what {velocity} itself is late remains. The residual against {velocity} does \
         not test it."
    )
}

/// How the flights contradict a number; `None` within 3 standard uncertainties. `by` names whose measurement it is.
pub(crate) fn contradiction(what: &str, number: Estimate, (measured, by): (Option<Estimate>, &str)) -> Option<String> {
    let measured = measured?;
    let u = measured.standard_uncertainty?.hypot(number.standard_uncertainty.unwrap_or(0.0));
    let apart = number.value - measured.value;
    (apart.abs() > 3.0 * u).then(|| {
        let side = if apart > 0.0 { "less" } else { "more" };
        format!(
            "{what}, {} ms, is contradicted: {by} measured {}. That is {} ms {side} than stated, {:.1} standard \
             uncertainties.",
            ms(number.value),
            with_uncertainty(measured),
            ms(apart.abs()),
            apart.abs() / u
        )
    })
}
