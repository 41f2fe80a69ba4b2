//! The delay of one flight: which of a stated number, a sensor card, the flight's own delay and the optimum of its sweep
//! is removed, and why.

mod card;
mod over_flights;

pub(crate) use card::instant;
pub(crate) use over_flights::campaign_delay;

use crate::cards::UsedCard;
use flight::{Binding, Channel, Delay, Flight, Notices, Severity};
use record::{
    CardUse, DelayCandidate, DelayChoice, DelayPairKind, DelaySource, Estimate, Finding, FlightDelays, MeasuredDelay,
    SweepMethod, SweepOptimum,
};

/// Two delays that are farther apart than so many standard uncertainties of their difference contradict each other.
const CONTRADICTS: f64 = 3.0;

/// Where delays come from.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct DelayRule {
    /// What is removed. Where a flight has no such delay, the card stands in, then the stated number, if there are any.
    pub(crate) from: DelaySource,
    /// The number that the pipeline states for all flights.
    pub(crate) fixed: Option<FixedDelay>,
    /// Cards of one sensor.
    pub(crate) cards: Vec<UsedCard>,
}

/// A delay that somebody states.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FixedDelay {
    pub(crate) delay: Delay,
    /// Its standard uncertainty, s, if known.
    pub(crate) standard_uncertainty_s: Option<f64>,
    /// Where it comes from, in words.
    pub(crate) source: String,
}

/// A flight whose delay is wanted: what is replayed, and what is known of it.
pub(crate) struct Case<'a> {
    pub(crate) flight: &'a Flight,
    pub(crate) binding: &'a Binding,
    /// Name and channel of the position that is replayed.
    pub(crate) position: (&'a str, &'a Channel),
    /// And of the velocity.
    pub(crate) velocity: (&'a str, &'a Channel),
}

/// The delay of one flight.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FoundDelay {
    pub(crate) delay: Delay,
    pub(crate) standard_uncertainty_s: Option<f64>,
    pub(crate) source: String,
    pub(crate) card: Option<CardUse>,
    pub(crate) notices: Notices,
}

impl FoundDelay {
    fn estimate(&self) -> Estimate {
        Estimate { value: self.delay.seconds(), standard_uncertainty: self.standard_uncertainty_s }
    }
}

/// What was decided for a flight.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Decided {
    /// The delay that is removed. Its notices also say what contradicts it.
    pub(crate) found: FoundDelay,
    pub(crate) choice: DelayChoice,
    /// The optimum of the sweep, if it was asked for.
    pub(crate) optimum: Option<Finding<SweepOptimum>>,
}

/// A source and the delay it has for the flight, or why it has none.
type Candidate = (DelaySource, Result<FoundDelay, String>);

impl DelayRule {
    /// The delay of a flight, or why there is none to remove. `measured` is what the flight itself says of the pair;
    /// `best` the optimum of its sweep, called only if that is asked for.
    pub(crate) fn decide(
        &self,
        case: &Case<'_>,
        measured: &Finding<MeasuredDelay>,
        best: impl FnOnce() -> Finding<SweepOptimum>,
    ) -> Result<Decided, String> {
        let optimum = (self.from == DelaySource::Sweep).then(best);
        let mut candidates: Vec<Candidate> = vec![];
        if let Some(optimum) = &optimum {
            candidates.push((DelaySource::Sweep, of_sweep(case, optimum)));
        }
        if !self.cards.is_empty() {
            candidates.push((DelaySource::Card, card::delay_of(&self.cards, case)));
        }
        if let Some(fixed) = &self.fixed {
            candidates.push((DelaySource::Fixed, Ok(fixed.found())));
        }
        candidates.push((DelaySource::Flight, of_flight(case, measured)));
        candidates.sort_by_key(|(source, _)| *source != self.from);
        let used = self.used(&candidates)?;
        let (source, found) = match candidates.get(used) {
            Some((source, Ok(found))) => (*source, found.clone()),
            _ => return Err("there is no delay".to_owned()),
        };
        let mut decided = Decided {
            choice: DelayChoice {
                asked: self.from,
                used: source,
                why: self.why(source, &candidates),
                circular: matches!(source, DelaySource::Flight | DelaySource::Sweep),
                candidates: vec![],
            },
            found,
            optimum,
        };
        contradiction(&candidates, measured, case, &mut decided.found.notices);
        if source != self.from {
            let why = decided.choice.why.clone();
            decided.found.notices.push(Severity::Warning, "delay-fallback", case.position.0, 1, why);
        }
        candidates.swap(0, used);
        decided.choice.candidates = candidates.into_iter().map(listed).collect();
        Ok(decided)
    }

    /// Which candidate is used: the first is what is asked for; the flight's own delay never stands in unasked.
    fn used(&self, candidates: &[Candidate]) -> Result<usize, String> {
        let may = |source: DelaySource| source == self.from || source != DelaySource::Flight;
        let usable = |(source, delay): &Candidate| delay.is_ok() && may(*source);
        candidates.iter().position(usable).ok_or_else(|| {
            let asked: Vec<&str> =
                candidates.iter().filter(|c| may(c.0)).filter_map(|c| c.1.as_ref().err()).map(String::as_str).collect();
            let none = match self.from {
                DelaySource::Flight | DelaySource::Sweep if asked.len() == 1 => {
                    "; and the pipeline names no card and no number to fall back on"
                }
                _ => "",
            };
            format!("{}{none}", asked.join("; and "))
        })
    }

    fn why(&self, used: DelaySource, candidates: &[Candidate]) -> String {
        let asks = match self.from {
            DelaySource::Fixed => "the pipeline states it",
            DelaySource::Card => "the pipeline asks for the sensor card",
            DelaySource::Flight => "the pipeline asks for the delay that each flight shows itself",
            DelaySource::Sweep => "the pipeline asks for the optimum of each flight's delay sweep",
        };
        if used == self.from {
            return asks.to_owned();
        }
        let because = candidates.first().and_then(|c| c.1.as_ref().err()).map(String::as_str).unwrap_or_default();
        let stand_in =
            if used == DelaySource::Card { "the sensor card" } else { "the number that the pipeline states" };
        format!("{asks}, but {because}: {stand_in} stands in")
    }
}

impl FixedDelay {
    fn found(&self) -> FoundDelay {
        FoundDelay {
            delay: self.delay,
            standard_uncertainty_s: self.standard_uncertainty_s,
            source: self.source.clone(),
            card: None,
            notices: Notices::new(),
        }
    }
}

fn listed((source, delay): Candidate) -> DelayCandidate {
    match delay {
        Ok(found) => DelayCandidate { source, delay_s: Finding::Found(found.estimate()), words: found.source },
        Err(why) => DelayCandidate { source, delay_s: Finding::CannotTell(why), words: String::new() },
    }
}

/// What a flight says of the pair that is replayed.
pub(crate) fn measured_pair(delays: &FlightDelays, position: &str, velocity: &str) -> Finding<MeasuredDelay> {
    let is_pair = |kind, first: &str, second: &str| {
        kind == DelayPairKind::PositionAgainstVelocity && first == position && second == velocity
    };
    let pair = delays.pairs.iter().find(|p| is_pair(p.kind, &p.first, &p.second));
    pair.map_or_else(
        || Finding::CannotTell(format!("{position} against {velocity} was not tried")),
        |pair| pair.delay.clone(),
    )
}

fn of_flight(case: &Case<'_>, measured: &Finding<MeasuredDelay>) -> Result<FoundDelay, String> {
    let (position, velocity) = (case.position.0, case.velocity.0);
    let measured = match measured {
        Finding::Found(measured) => measured,
        Finding::CannotTell(why) => return Err(format!("the flight does not show its delay: {why}")),
    };
    if let Some(rival) = measured.rival_s {
        return Err(format!(
            "the flight does not show its delay: {} and {} ms explain it almost equally well",
            shown(&measured.delay_s),
            (1e3 * rival).round()
        ));
    }
    let source =
        format!("measured in this flight: {position} against {velocity}, {} ms (k = 2)", shown(&measured.delay_s));
    let mut found = late(case, measured.delay_s, source)?;
    if let Some(alarm) = &measured.alarm {
        found.notices.push(Severity::Warning, "flight-delay-changes", position, 1, alarm.clone());
    }
    Ok(found)
}

fn of_sweep(case: &Case<'_>, optimum: &Finding<SweepOptimum>) -> Result<FoundDelay, String> {
    let optimum = match optimum {
        Finding::Found(optimum) => optimum,
        Finding::CannotTell(why) => return Err(format!("the delay sweep has no optimum: {why}")),
    };
    let how = match optimum.method {
        SweepMethod::Jackknife => "least error against the reference",
        SweepMethod::Estimator => "without a reference, the optimum of the delay estimator",
    };
    let source = format!("optimum of this flight's delay sweep ({how}): {} ms (k = 2)", shown(&optimum.delay_s));
    late(case, optimum.delay_s, source)
}

/// Only what is late can be compensated.
fn late(case: &Case<'_>, delay_s: Estimate, source: String) -> Result<FoundDelay, String> {
    let nothing = || {
        format!("{} is not later than {} ({} ms): nothing to remove", case.position.0, case.velocity.0, shown(&delay_s))
    };
    let delay = Delay::from_seconds(delay_s.value).filter(|d| d.seconds() > 0.0).ok_or_else(nothing)?;
    Ok(FoundDelay {
        delay,
        standard_uncertainty_s: delay_s.standard_uncertainty,
        source,
        card: None,
        notices: Notices::new(),
    })
}

/// Says if the flight shows another delay than the card has or the pipeline states.
fn contradiction(candidates: &[Candidate], measured: &Finding<MeasuredDelay>, case: &Case<'_>, notices: &mut Notices) {
    let of = |wanted: DelaySource| {
        candidates.iter().find(|c| c.0 == wanted).and_then(|c| c.1.as_ref().ok()).map(FoundDelay::estimate)
    };
    let Some(flight) = measured.found().filter(|m| m.rival_s.is_none()).map(|m| m.delay_s) else { return };
    for (source, name) in [(DelaySource::Card, "the sensor card"), (DelaySource::Fixed, "the pipeline")] {
        let Some(stated) = of(source) else { continue };
        let u = flight.standard_uncertainty.unwrap_or(0.0).hypot(stated.standard_uncertainty.unwrap_or(0.0));
        let apart = (flight.value - stated.value).abs();
        if apart > CONTRADICTS * u {
            let text = format!(
                "the flight shows a delay of {} ms, {name} has {} ms: {:.1} ms apart, where {:.1} ms are explained (three \
                 standard uncertainties)",
                shown(&flight),
                shown(&stated),
                1e3 * apart,
                1e3 * CONTRADICTS * u
            );
            notices.push(Severity::Warning, "delay-contradicted", case.position.0, 1, text);
        }
    }
}

fn shown(delay_s: &Estimate) -> String {
    match delay_s.standard_uncertainty {
        Some(u) => milliseconds(delay_s.value, u),
        None => format!("{:.1}", 1e3 * delay_s.value),
    }
}

/// `400.0 ± 2.1`, the expanded uncertainty with k = 2: as many digits as it bears.
fn milliseconds(seconds: f64, standard_uncertainty_s: f64) -> String {
    let (value, uncertainty) = (seconds * 1e3, 2.0 * standard_uncertainty_s * 1e3);
    let digits = match uncertainty {
        u if u >= 10.0 => 0,
        u if u >= 1.0 => 1,
        u if u >= 0.1 => 2,
        _ => 3,
    };
    format!("{value:.digits$} ± {uncertainty:.digits$}")
}

#[cfg(test)]
pub(crate) mod tests;
