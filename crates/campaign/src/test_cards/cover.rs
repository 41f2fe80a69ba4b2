//! Which cards are done, which must be repeated, and which were not flown.

use super::TestCards;
use record::{
    CampaignTest, CardCoverage, CardFlight, CardStatus, CriterionVerdict, FlightCriteria, FlightRow, FlightTest,
    Outcome, RowCard, TestCard,
};
use std::collections::BTreeMap;

/// Whether a flight completes its card, and why not. It does if it has a result and meets the criteria, if any.
pub(super) fn status(outcome: &Outcome, criteria: Option<&FlightCriteria>) -> (CardStatus, String) {
    let repeat = |why: String| (CardStatus::Repeat, why);
    match outcome {
        Outcome::Failed { reason } => return repeat(format!("the log could not be used: {reason}")),
        Outcome::Pending { reason } | Outcome::NotMeasurable { reason } => return repeat(reason.clone()),
        Outcome::Compensated | Outcome::Uncompensated { .. } => {}
    }
    let Some(criteria) = criteria else { return (CardStatus::Done, String::new()) };
    let overall = criteria.overall();
    let word = match overall {
        CriterionVerdict::Pass | CriterionVerdict::NotApplicable => return (CardStatus::Done, String::new()),
        CriterionVerdict::Fail => "fails",
        CriterionVerdict::Inconclusive => "inconclusive",
        CriterionVerdict::NotEvaluated => "not evaluated",
    };
    let which: Vec<&str> = criteria.findings.iter().filter(|f| f.verdict == overall).map(|f| f.id.as_str()).collect();
    repeat(format!("{word}: {}", which.join(", ")))
}

/// Short form of the cards of a flight.
pub(crate) fn row_cards(test: &FlightTest) -> Vec<RowCard> {
    let short = |flown: &record::FlownCard| RowCard {
        number: flown.card.number.clone(),
        title: flown.card.title.clone(),
        status: flown.status,
        why: flown.why.clone(),
    };
    test.cards.iter().map(short).collect()
}

impl TestCards {
    /// Summary of the cards over all flights; `None` without cards.
    pub(crate) fn of_campaign(&self, rows: &[FlightRow]) -> Option<CampaignTest> {
        if self.campaign.is_none() && self.flights.is_empty() {
            return None;
        }
        let nothing = super::TestCardFile::default();
        let file = self.campaign.as_ref().map_or(&nothing, |read| &read.file);
        Some(CampaignTest {
            source: self.campaign.as_ref().map(|read| read.source.clone()),
            title: file.title.clone(),
            report: file.report.clone(),
            aircraft: file.aircraft.clone(),
            instrumentation: file.instrumentation.clone(),
            conditions: file.conditions.clone(),
            coverage: coverage(&file.card, rows),
            flights_without_card: rows.iter().filter(|row| row.cards.is_empty()).count() as u64,
        })
    }
}

fn coverage(planned: &[TestCard], rows: &[FlightRow]) -> Vec<CardCoverage> {
    let mut flown: BTreeMap<&str, (Option<&str>, Vec<CardFlight>)> = BTreeMap::new();
    for (row, card) in rows.iter().flat_map(|row| row.cards.iter().map(move |card| (row, card))) {
        let (title, flights) = flown.entry(&card.number).or_insert((card.title.as_deref(), vec![]));
        *title = title.or(card.title.as_deref());
        let (flight, page) = (row.flight.clone(), row.page.clone());
        flights.push(CardFlight { flight, page, status: card.status, why: card.why.clone() });
    }
    let covered = |card: TestCard, is_planned, flights: Vec<CardFlight>| {
        let status = flights.iter().map(|flight| flight.status).max().unwrap_or(CardStatus::Missing);
        CardCoverage { card, is_planned, status, flights }
    };
    let mut all: Vec<CardCoverage> = vec![];
    for card in planned {
        let flights = flown.remove(card.number.as_str()).map(|(_, flights)| flights).unwrap_or_default();
        all.push(covered(card.clone(), true, flights));
    }
    for (number, (title, flights)) in flown {
        let card = TestCard { number: number.to_owned(), title: title.map(str::to_owned), ..TestCard::default() };
        all.push(covered(card, false, flights));
    }
    all
}
