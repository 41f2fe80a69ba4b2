//! The delay of one flight: which of a stated number, a sensor card, the flight's own delay and the optimum of its
//! sweep is removed, and why.

mod card;
mod over_flights;

pub(crate) use over_flights::campaign_delay;

use crate::cards::UsedCard;
use flight::{Binding, Channel, Code, Delay, Flight, Notices};
use record::{
    CardDelay, CardUse, Decision, DelayCandidate, DelayChoice, DelayPairKind, DelaySource, Estimate, Finding,
    FlightDelays, FlightLateness, MeasuredDelay, SweepMethod, SweepOptimum,
};

/// Sources of delays.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct DelayRule {
    /// The requested source.
    pub(crate) from: DelaySource,
    /// The number that the pipeline states for all flights.
    pub(crate) fixed: Option<FixedDelay>,
    /// Cards of one sensor.
    pub(crate) cards: Vec<UsedCard>,
}

/// A stated delay.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FixedDelay {
    pub(crate) delay: Delay,
    /// Its standard uncertainty, s, if known.
    pub(crate) standard_uncertainty_s: Option<f64>,
    /// Its source, as text.
    pub(crate) source: String,
}

/// A flight that needs a delay: the replayed channels, and what is known about them.
pub(crate) struct Case<'a> {
    pub(crate) flight: &'a Flight,
    pub(crate) binding: &'a Binding,
    /// Name and channel of the replayed position.
    pub(crate) position: (&'a str, &'a Channel),
    /// Name and channel of the replayed velocity.
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

/// The decision for a flight.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Decided {
    /// The delay to remove. Its notices include contradictions.
    pub(crate) found: FoundDelay,
    pub(crate) choice: DelayChoice,
    /// The optimum of the sweep, if requested.
    pub(crate) optimum: Option<Finding<SweepOptimum>>,
}

/// A source and its delay for the flight, or why it has none.
type Candidate = (DelaySource, Result<FoundDelay, String>);

/// What is known about a flight when its delay is removed.
pub(crate) struct Known<'a> {
    pub(crate) decision: &'a Decision,
    pub(crate) lateness: &'a FlightLateness,
    /// The flight's own delay of the replayed pair.
    pub(crate) measured: &'a Finding<MeasuredDelay>,
}

impl DelayRule {
    /// The delay from this flight's card; `None` if the pipeline names no card.
    pub(crate) fn card_delay(&self, case: &Case<'_>) -> Option<Finding<CardDelay>> {
        (!self.cards.is_empty()).then(|| match card::delay_of(&self.cards, case) {
            Ok(FoundDelay { delay, standard_uncertainty_s, source, card: Some(card), notices }) => {
                let delay_s = Estimate { value: delay.seconds(), standard_uncertainty: standard_uncertainty_s };
                Finding::Found(CardDelay { delay_s, words: source, card, notices })
            }
            Ok(_) => Finding::CannotTell("the card has no delay".to_owned()),
            Err(why) => Finding::CannotTell(why),
        })
    }

    /// The delay to remove from a flight, or why there is none. `best` finds the optimum of its sweep, and is called
    /// only if requested.
    pub(crate) fn chosen(
        &self,
        case: &Case<'_>,
        known: &Known<'_>,
        best: impl FnOnce() -> Finding<SweepOptimum>,
    ) -> Result<Decided, String> {
        let decision = known.decision;
        let optimum = (self.from == DelaySource::Sweep).then(best);
        let mut candidates = self.candidates(case, known, optimum.as_ref());
        let swept = optimum.is_some() && candidates.first().is_some_and(|c| c.1.is_ok());
        let source = if swept { DelaySource::Sweep } else { decision.used.ok_or_else(|| decision.words.clone())? };
        let used = candidates.iter().position(|c| c.0 == source).ok_or_else(|| decision.words.clone())?;
        let mut found = match &candidates[used].1 {
            Ok(found) => found.clone(),
            Err(why) => return Err(why.clone()),
        };
        if let (false, Some(delay)) = (swept, decision.delay_s.and_then(Delay::from_seconds)) {
            (found.delay, found.standard_uncertainty_s) = (delay, decision.standard_uncertainty_s);
        }
        // All pairs together give the difference that is removed, and not the one pair alone.
        if source == DelaySource::Flight {
            found.source = format!("{} minus {} of this flight, from all pairs", case.position.0, case.velocity.0);
            candidates[used].1 = Ok(found.clone());
        }
        let is_new = |text: &&String| !found.notices.iter().any(|n| n.text == **text);
        if let Some(contradicted) = decision.contradicted.as_ref().filter(is_new) {
            found.notices.push(Code::DelayContradicted, case.position.0, 1, contradicted.clone());
        }
        candidates.swap(0, used);
        let choice = DelayChoice {
            asked: self.from,
            used: source,
            why: if swept {
                "The pipeline asks for the best delay of the sweep.".to_owned()
            } else {
                decision.words.clone()
            },
            circular: swept || decision.circular,
            candidates: candidates.into_iter().map(listed).collect(),
            differences: vec![],
        };
        Ok(Decided { found, choice, optimum })
    }

    /// The delay of each source for the flight; the sweep comes first if requested.
    fn candidates(
        &self,
        case: &Case<'_>,
        known: &Known<'_>,
        optimum: Option<&Finding<SweepOptimum>>,
    ) -> Vec<Candidate> {
        let Known { decision, lateness, measured } = known;
        let mut candidates: Vec<Candidate> = vec![];
        if let Some(optimum) = optimum {
            candidates.push((DelaySource::Sweep, of_sweep(case, optimum)));
        }
        if decision.used == Some(DelaySource::OthersFlights) {
            candidates.push((DelaySource::OthersFlights, decided(decision)));
        }
        candidates.push((DelaySource::OwnNetwork, of_network(lateness)));
        if let Some(card) = &lateness.card {
            candidates.push((DelaySource::Card, of_card(card)));
        }
        if let Some(fixed) = &self.fixed {
            candidates.push((DelaySource::Fixed, Ok(fixed.found())));
        }
        candidates.push((DelaySource::Flight, of_flight(case, measured)));
        candidates
    }
}

fn decided(decision: &Decision) -> Result<FoundDelay, String> {
    let delay = decision.delay_s.and_then(Delay::from_seconds).ok_or_else(|| decision.words.clone())?;
    Ok(FoundDelay {
        delay,
        standard_uncertainty_s: decision.standard_uncertainty_s,
        source: decision.words.clone(),
        card: None,
        notices: Notices::new(),
    })
}

/// The lateness from the flight's own network, if it has a datum.
fn of_network(lateness: &FlightLateness) -> Result<FoundDelay, String> {
    let channel = lateness.lateness.as_ref().filter(|c| c.relative_to.is_none());
    let found = channel.map(|c| c.lateness_s).ok_or_else(|| lateness.words.clone())?;
    Ok(FoundDelay {
        delay: Delay::from_seconds(found.value).ok_or_else(|| lateness.words.clone())?,
        standard_uncertainty_s: found.standard_uncertainty,
        source: lateness.words.clone(),
        card: None,
        notices: Notices::new(),
    })
}

fn of_card(card: &Finding<CardDelay>) -> Result<FoundDelay, String> {
    match card {
        Finding::CannotTell(why) => Err(why.clone()),
        Finding::Found(card) => Ok(FoundDelay {
            delay: Delay::from_seconds(card.delay_s.value).ok_or("the card's delay is out of range")?,
            standard_uncertainty_s: card.delay_s.standard_uncertainty,
            source: card.words.clone(),
            card: Some(card.card.clone()),
            notices: card.notices.clone(),
        }),
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

/// A flight's own delay of the replayed pair.
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
            "the flight does not show its delay: {} and {} ms fit it almost equally well",
            shown(&measured.delay_s),
            (1e3 * rival).round()
        ));
    }
    let source =
        format!("measured in this flight: {position} against {velocity}, {} ms (k = 2)", shown(&measured.delay_s));
    let mut found = late(case, measured.delay_s, source)?;
    if let Some(alarm) = &measured.alarm {
        found.notices.push(Code::FlightDelayChanges, position, 1, alarm.clone());
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

/// Rejects a delay that is not positive: only a late position can be compensated.
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

fn shown(delay_s: &Estimate) -> String {
    match delay_s.standard_uncertainty {
        Some(u) => milliseconds(delay_s.value, u),
        None => flight::fixed(1e3 * delay_s.value, 1),
    }
}

/// `400.0 ± 2.1`: expanded uncertainty with k = 2, with as many digits as it justifies.
pub(crate) fn milliseconds(seconds: f64, standard_uncertainty_s: f64) -> String {
    let (value, uncertainty) = (seconds * 1e3, 2.0 * standard_uncertainty_s * 1e3);
    let digits = match uncertainty {
        u if u >= 10.0 => 0,
        u if u >= 1.0 => 1,
        u if u >= 0.1 => 2,
        _ => 3,
    };
    format!("{} ± {uncertainty:.digits$}", flight::fixed(value, digits))
}

#[cfg(test)]
pub(crate) mod tests;

/// `203.4 ± 16.2`: expanded uncertainty with k = 2.
pub(crate) fn in_ms(e: &Estimate) -> String {
    match e.standard_uncertainty {
        Some(u) => milliseconds(e.value, u),
        None => format!("{:.1}", 1e3 * e.value),
    }
}
