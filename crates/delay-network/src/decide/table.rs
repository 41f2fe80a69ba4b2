//! The decision table, row by row.

use super::group::Evidence;
use super::{FlightSources, RelativeLateness, decision_words, grid};
use crate::isolate::K95;
use crate::solve::trusted;
use record::{DelaySource, Estimate, NetworkDatum, RemovedDelay};

/// Choice made by a row of the table.
#[derive(Debug, Clone)]
pub(crate) struct Choice {
    pub(crate) row: u8,
    pub(crate) source: Option<DelaySource>,
    pub(crate) delay_s: Option<Estimate>,
    pub(crate) circular: bool,
    /// Other flights in the mean.
    pub(crate) pooled: usize,
    pub(crate) words: String,
    pub(crate) contradicted: Option<String>,
    pub(crate) card_e_n: Option<f64>,
}

impl Choice {
    fn new(row: u8, source: Option<DelaySource>, delay_s: Option<Estimate>, words: String) -> Choice {
        let circular = matches!(source, Some(DelaySource::OwnNetwork | DelaySource::Flight));
        let source = if delay_s.is_some() { source } else { None };
        Choice { row, source, delay_s, circular, pooled: 0, words, contradicted: None, card_e_n: None }
    }

    fn nothing(row: u8, words: &str) -> Choice {
        Choice::new(row, None, None, words.to_owned())
    }

    /// Number of flights that support the value.
    fn flights(&self) -> usize {
        if self.source == Some(DelaySource::OwnNetwork) { 1 } else { self.pooled }
    }
}

/// Decision table for one flight.
#[derive(Debug)]
pub(crate) struct Table<'a> {
    pub(crate) flight: &'a FlightSources,
    pub(crate) evidence: Evidence,
}

impl Table<'_> {
    /// Delay removed for the requested source.
    pub(crate) fn removed(&self, asked: DelaySource) -> RemovedDelay {
        let choice = match asked {
            DelaySource::Network | DelaySource::OthersFlights | DelaySource::OwnNetwork => self.network(),
            DelaySource::Flight => self.pair(),
            DelaySource::Card => self.card(),
            DelaySource::Fixed => self.fixed(),
            DelaySource::Sweep => self.sweep(),
        };
        let delay_s = choice.delay_s.map(|delay_s| match (choice.source, delay_s.standard_uncertainty) {
            (Some(DelaySource::OthersFlights | DelaySource::OwnNetwork | DelaySource::Flight), Some(u)) => {
                Estimate { value: grid::on_grid(delay_s.value, u), standard_uncertainty: Some(grid::rounded_up(u)) }
            }
            _ => delay_s,
        });
        RemovedDelay {
            flight: self.flight.flight.clone(),
            value_s: delay_s.map(|delay_s| delay_s.value),
            standard_uncertainty_s: delay_s.and_then(|delay_s| delay_s.standard_uncertainty),
            row: choice.row,
            source: choice.source,
            circular: choice.circular,
            words: choice.words,
            pooled_flights: u32::try_from(choice.pooled).unwrap_or(u32::MAX),
            z: self.evidence.z,
            card_e_n: choice.card_e_n,
            contradicted: choice.contradicted,
        }
    }

    /// Rows 1 to 8.
    fn network(&self) -> Choice {
        match (self.by_flights(), self.card_delay()) {
            (Some(choice), Some(card)) => {
                Choice { contradicted: self.contradiction("The card", card), ..with_card(choice, card) }
            }
            (Some(choice), None) => choice,
            (None, card) => self.without_own_delay(card),
        }
    }

    /// Rows 1 to 4; `None` if neither this flight nor the others have a delay.
    fn by_flights(&self) -> Option<Choice> {
        let (row, delay_s) = match (self.evidence.others, self.evidence.own) {
            (Some(_), Some(own)) if self.evidence.differs() => (2, own),
            (Some(_), None) if self.evidence.unlike_s.is_some() => return None,
            (Some(others), own) => {
                let mean = Estimate { value: others.mean_s, standard_uncertainty: Some(others.uncertainty_s) };
                (if own.is_some() { 1 } else { 3 }, mean)
            }
            (None, Some(own)) => (4, own),
            (None, None) => return None,
        };
        let source = if row % 2 == 1 { Some(DelaySource::OthersFlights) } else { Some(DelaySource::OwnNetwork) };
        let mut choice = Choice::new(row, source, Some(delay_s), String::new());
        choice.pooled = self.evidence.others.map_or(0, |others| others.flights);
        choice.words = decision_words::by_flights(self.flight, &self.evidence, &choice);
        Some(choice)
    }

    /// Rows 7 and 8.
    fn without_own_delay(&self, card: Option<Estimate>) -> Choice {
        if let (Some(card), None) = (card, self.relative()) {
            let text = "The delay on the sensor card is removed. The IMU of no flight verified it.".to_owned();
            return Choice { contradicted: self.contradiction("The card", card), ..card_choice(7, card, text) };
        }
        let stated = self.flight.stated_s.filter(sound);
        let (source, delay_s) = match (card, stated) {
            (Some(card), _) => (Some(DelaySource::Card), Some(card)),
            (None, Some(stated)) => (Some(DelaySource::Fixed), Some(stated)),
            (None, None) => (None, None),
        };
        let mut choice =
            Choice::new(8, source, delay_s, decision_words::without_own_delay(self.flight, &self.evidence, source));
        choice.contradicted = delay_s.and_then(|number| {
            let what = if source == Some(DelaySource::Card) { "The card" } else { "The stated delay" };
            self.contradiction(what, number)
        });
        choice
    }

    /// Row 9.
    fn pair(&self) -> Choice {
        match self.relative() {
            Some(pair) => Choice::new(9, Some(DelaySource::Flight), Some(pair.delay_s), decision_words::pair(pair)),
            None => {
                Choice::nothing(9, "Position against velocity was not measured in this flight. Nothing is removed.")
            }
        }
    }

    /// Rows 5 to 7 if the card was requested: it is removed whatever the flights show.
    fn card(&self) -> Choice {
        let Some(card) = self.card_delay() else {
            return Choice::nothing(0, "There is no valid card of this sensor. Nothing is removed.");
        };
        let measured = self.by_flights();
        let found = measured.as_ref().and_then(|measured| e_n(card, measured.delay_s?));
        let (row, text) = match (&measured, found) {
            (Some(_), Some(e)) if e <= 1.0 => (5, "Card and flights agree. The card's delay is removed.".to_owned()),
            (Some(measured), Some(_)) => (
                6,
                format!(
                    "Card contradicted by {}. It is removed because the pipeline asks for it.",
                    count(measured.flights())
                ),
            ),
            _ => (7, "The delay on the sensor card is removed. The IMU of no flight verified it.".to_owned()),
        };
        let contradicted = self.contradiction("The card", card);
        Choice { card_e_n: found, contradicted, ..card_choice(row, card, text) }
    }

    /// A number fixed in the pipeline.
    fn fixed(&self) -> Choice {
        let Some(stated) = self.flight.stated_s.filter(sound) else {
            return Choice::nothing(0, "The pipeline asks for a fixed delay but states none. Nothing is removed.");
        };
        let contradicted = self.contradiction("The stated delay", stated);
        let text = match (&contradicted, self.measured()) {
            (Some(_), _) => "The number stated in the pipeline is removed. What was measured contradicts it.",
            (None, Some(_)) => {
                "The number stated in the pipeline is removed. What was measured does not contradict it."
            }
            (None, None) => {
                "The number stated in the pipeline is removed. The delay network of this flight does not test it."
            }
        };
        Choice { contradicted, ..Choice::new(0, Some(DelaySource::Fixed), Some(stated), text.to_owned()) }
    }

    /// Row 10 if the sweep was requested.
    fn sweep(&self) -> Choice {
        Choice::nothing(
            10,
            "The pipeline asks for the best delay of the sweep, which the replay finds. Without a sweep nothing is removed.",
        )
    }

    /// Card with an uncertainty.
    fn card_delay(&self) -> Option<Estimate> {
        self.flight.card_s.filter(|card| sound(card) && card.standard_uncertainty.is_some())
    }

    /// Position against velocity, if the figure is usable.
    fn relative(&self) -> Option<&RelativeLateness> {
        self.flight.relative.as_ref().filter(|pair| sound(&pair.delay_s))
    }

    /// Delay measured by this flight, weak figures included; else that of the other flights.
    fn measured(&self) -> Option<Estimate> {
        let weak = self.flight.position.as_ref().filter(|position| {
            sound(&position.lateness_s)
                && trusted(position.verdict)
                && matches!(position.datum, NetworkDatum::Imu | NetworkDatum::Reference)
        });
        self.evidence
            .own
            .or_else(|| self.by_flights().and_then(|choice| choice.delay_s))
            .or_else(|| weak.map(|position| position.lateness_s))
    }

    fn contradiction(&self, what: &str, number: Estimate) -> Option<String> {
        let by_others = self.evidence.own.is_none() && self.evidence.others.is_some();
        let by = if by_others { "other flights of its group" } else { "this flight" };
        decision_words::contradiction(what, number, (self.measured(), by))
    }
}

/// Rows 5 and 6: combines the flights' choice with a card.
fn with_card(choice: Choice, card: Estimate) -> Choice {
    let Some(flights) = choice.delay_s else { return choice };
    let Some(e) = e_n(card, flights) else { return choice };
    let card_e_n = Some(e);
    if e > 1.0 {
        let text = format!("Card contradicted by {}. {}", count(choice.flights()), choice.words);
        return Choice { row: 6, words: text, card_e_n, ..choice };
    }
    if card.standard_uncertainty < flights.standard_uncertainty {
        let text = "Card and flights agree. The card's delay is removed: it has the smaller uncertainty.".to_owned();
        let pooled = choice.pooled;
        return Choice { card_e_n, pooled, ..card_choice(5, card, text) };
    }
    Choice { row: 5, words: format!("Card and flights agree. {}", choice.words), card_e_n, ..choice }
}

fn card_choice(row: u8, card: Estimate, words: String) -> Choice {
    Choice::new(row, Some(DelaySource::Card), Some(card), words)
}

fn count(flights: usize) -> String {
    if flights == 1 { "1 flight".to_owned() } else { format!("{flights} flights") }
}

/// Whether the numbers of an estimate are usable.
fn sound(estimate: &Estimate) -> bool {
    estimate.value.is_finite() && estimate.standard_uncertainty.is_none_or(|u| u.is_finite() && u >= 0.0)
}

/// `|a − b| / (1.96 √(u_a² + u_b²))`; `None` without uncertainties.
fn e_n(a: Estimate, b: Estimate) -> Option<f64> {
    let u = a.standard_uncertainty?.hypot(b.standard_uncertainty?);
    let e = (a.value - b.value).abs() / (K95 * u);
    e.is_finite().then_some(e)
}
