//! Test cards: what to fly, with what, and which flight flew it.
//!
//! `test-card.toml` in the folder of flights is the card of the campaign. `NAME.test-card.toml` next to the log `NAME`
//! or `NAME.ENDING` is the card of a flight. Cards are not part of a result's key: like criteria they only affect
//! pages.

mod cover;
mod test_card_file;
#[cfg(test)]
mod tests;

pub(crate) use cover::row_cards;
#[cfg(feature = "schema")]
pub(crate) use test_card_file::test_card_schema;

use crate::criteria::Criteria;
use crate::error::CampaignError;
use crate::manifest::hash_of_parts;
use crate::pattern::any_matches;
use cover::status;
use record::{
    CriteriaUse, FlightRecord, FlightTest, FlownCard, IgnoredInput, TestCard, TestCardSource, TestInstrument,
};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use test_card_file::TestCardFile;

/// File name of the card of a campaign.
const CAMPAIGN_CARD: &str = "test-card.toml";

/// Suffix of the file name of a flight's card.
const ENDING: &str = ".test-card.toml";

/// The test cards of a campaign in a manifest: a cluster's nodes do not need the files.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct TestCardFiles {
    campaign: Option<CardText>,
    /// By flight.
    flights: BTreeMap<String, CardText>,
}

/// A card file with its content, and the criteria files that it names.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct CardText {
    /// Path below the folder of flights.
    file: String,
    text: String,
    /// By path as in the card.
    criteria: BTreeMap<String, CriteriaUse>,
}

impl TestCardFiles {
    /// Finds and checks the cards of flights below `root`, and removes them from the list of files that are not logs. A
    /// card that belongs to no flight stays there with the reason.
    ///
    /// # Errors
    /// All errors of all cards, in one message.
    pub(crate) fn find<'a>(
        root: &Path,
        flights: impl Iterator<Item = &'a str>,
        ignored: &mut Vec<IgnoredInput>,
    ) -> Result<TestCardFiles, CampaignError> {
        let below = if root.is_dir() { root } else { root.parent().unwrap_or(root) };
        let mut found = TestCardFiles::default();
        let mut wrong: Vec<String> = vec![];
        let mut read = |file: &str| match CardText::read(below, file) {
            Ok(card) => Some(card),
            Err(complaint) => {
                wrong.push(complaint);
                None
            }
        };
        let is_file = |name: &str| below.join(name).is_file();
        if root.is_dir() && is_file(CAMPAIGN_CARD) {
            found.campaign = read(CAMPAIGN_CARD);
        }
        for flight in flights {
            if let Some(name) = names_of(flight).into_iter().find(|name| is_file(name)) {
                found.flights.extend(read(&name).map(|card| (flight.to_owned(), card)));
            }
        }
        if !wrong.is_empty() {
            return Err(CampaignError::Asked(wrong.join("\n")));
        }
        let used: Vec<&str> = found.files().map(|card| card.file.as_str()).collect();
        ignored.retain(|input| !used.contains(&input.path.as_str()));
        for input in ignored.iter_mut().filter(|input| is_card(&input.path)) {
            input.reason = "a test card without a flight: no log in its folder matches its names".to_owned();
        }
        Ok(found)
    }

    fn files(&self) -> impl Iterator<Item = &CardText> {
        self.campaign.iter().chain(self.flights.values())
    }

    /// Hash of everything about a flight; empty if there is nothing.
    pub(crate) fn hash_of(&self, flight: &str) -> String {
        hash(self.campaign.iter().chain(self.flights.get(flight)))
    }

    /// Hash of all cards; empty without cards.
    pub(crate) fn hash(&self) -> String {
        hash(self.files())
    }
}

fn hash<'a>(cards: impl Iterator<Item = &'a CardText>) -> String {
    let of = |card: &'a CardText| {
        let criteria = card.criteria.values().map(|used| used.blake3.as_str());
        [card.file.as_str(), card.text.as_str()].into_iter().chain(criteria)
    };
    let parts: Vec<&str> = cards.flat_map(of).collect();
    if parts.is_empty() { String::new() } else { hash_of_parts(&parts) }
}

/// Whether a file has the name of a test card.
fn is_card(path: &str) -> bool {
    let name = path.rsplit('/').next().unwrap_or(path);
    name == CAMPAIGN_CARD || name.ends_with(ENDING)
}

/// Possible names for the card of a flight: its full name, or its name without the extension, plus the suffix.
fn names_of(flight: &str) -> Vec<String> {
    let name = flight.rsplit('/').next().unwrap_or(flight);
    let ending = name.rfind('.').filter(|at| *at > 0).map_or(0, |at| name.len() - at);
    let stem = flight.get(..flight.len() - ending).unwrap_or(flight);
    [flight, stem].map(|name| format!("{name}{ENDING}")).into()
}

impl CardText {
    fn read(below: &Path, file: &str) -> Result<CardText, String> {
        let path = below.join(file);
        let text = std::fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        let card = TestCardFile::parse(&text, &path)?;
        let mut criteria = BTreeMap::new();
        for name in card.card.iter().filter_map(|card| card.criteria.clone()) {
            let path: PathBuf = path.parent().unwrap_or(below).join(&name);
            criteria.insert(
                name,
                Criteria::read(&path).map_err(|e| format!("{}: {e}", below.join(file).display()))?.as_used(),
            );
        }
        Ok(CardText { file: file.to_owned(), text, criteria })
    }

    fn parsed(&self) -> Result<ReadCard, CampaignError> {
        let file = TestCardFile::parse(&self.text, Path::new(&self.file)).map_err(CampaignError::Asked)?;
        let criteria = |(name, used): (&String, &CriteriaUse)| Ok((name.clone(), Criteria::of_use(used)?));
        let criteria: Result<_, CampaignError> = self.criteria.iter().map(criteria).collect();
        let blake3 = blake3::hash(self.text.as_bytes()).to_hex().to_string();
        Ok(ReadCard { file, criteria: criteria?, source: TestCardSource { file: self.file.clone(), blake3 } })
    }
}

/// A parsed card file.
struct ReadCard {
    source: TestCardSource,
    file: TestCardFile,
    /// By path as in the card.
    criteria: BTreeMap<String, Criteria>,
}

impl ReadCard {
    fn criteria_of(&self, card: &TestCard) -> Option<&Criteria> {
        self.criteria.get(card.criteria.as_ref()?)
    }
}

/// The test cards of a campaign.
pub(crate) struct TestCards {
    campaign: Option<ReadCard>,
    flights: BTreeMap<String, ReadCard>,
}

impl TestCards {
    /// The test cards of a manifest.
    ///
    /// # Errors
    /// A card can no longer be read.
    pub(crate) fn of_files(files: &TestCardFiles) -> Result<TestCards, CampaignError> {
        let campaign = files.campaign.as_ref().map(CardText::parsed).transpose()?;
        let flights = files.flights.iter().map(|(flight, card)| Ok((flight.clone(), card.parsed()?)));
        Ok(TestCards { campaign, flights: flights.collect::<Result<_, CampaignError>>()? })
    }

    /// The test of a flight: its own card overrides the campaign's; `None` without either.
    pub(crate) fn of_flight(&self, flight: &str, record: &FlightRecord) -> Option<FlightTest> {
        let (base, own) = (self.campaign.as_ref(), self.flights.get(flight));
        let sources: Vec<TestCardSource> = base.iter().chain(&own).map(|read| read.source.clone()).collect();
        if sources.is_empty() {
            return None;
        }
        let nothing = TestCardFile::default();
        let (base_file, own_file) = (base.map_or(&nothing, |read| &read.file), own.map_or(&nothing, |read| &read.file));
        let flown = |(card, criteria): (TestCard, Option<&Criteria>)| {
            let criteria = criteria.map(|criteria| criteria.judge(flight, record));
            let (status, why) = status(&record.outcome, criteria.as_ref().or(record.criteria.as_ref()));
            FlownCard { card, status, why, criteria }
        };
        Some(FlightTest {
            sources,
            title: own_file.title.clone().or_else(|| base_file.title.clone()),
            report: over(&base_file.report, &own_file.report),
            aircraft: over(&base_file.aircraft, &own_file.aircraft),
            instrumentation: instruments(&base_file.instrumentation, &own_file.instrumentation),
            conditions: over(&base_file.conditions, &own_file.conditions),
            cards: flown_cards(base, own, flight).into_iter().map(flown).collect(),
        })
    }
}

/// The cards of a flight with their criteria: first those from the campaign's card, then those from its own.
fn flown_cards<'a>(
    base: Option<&'a ReadCard>,
    own: Option<&'a ReadCard>,
    flight: &str,
) -> Vec<(TestCard, Option<&'a Criteria>)> {
    let cards =
        |read: Option<&'a ReadCard>| read.into_iter().flat_map(|read| read.file.card.iter().map(move |c| (read, c)));
    let planned = |number: &str| cards(base).find(|(_, card)| card.number == number);
    let is_own = |number: &str| cards(own).any(|(_, card)| card.number == number);
    let assigned = cards(base).filter(|(_, card)| any_matches(&card.flights, flight) && !is_own(&card.number));
    let mut all: Vec<_> = assigned.map(|(read, card)| (card.clone(), read.criteria_of(card))).collect();
    all.extend(cards(own).map(|(read, card)| match planned(&card.number) {
        None => (card.clone(), read.criteria_of(card)),
        Some((base, plan)) => (over(plan, card), read.criteria_of(card).or_else(|| base.criteria_of(plan))),
    }));
    all
}

/// `own`, with missing values taken from `base`.
fn over<T: Serialize + DeserializeOwned + Clone>(base: &T, own: &T) -> T {
    let is_given = |value: &Value| !value.is_null() && value.as_array().is_none_or(|list| !list.is_empty());
    let fields = |of: &T| match serde_json::to_value(of) {
        Ok(Value::Object(fields)) => fields,
        _ => serde_json::Map::new(),
    };
    let mut merged = fields(base);
    merged.extend(fields(own).into_iter().filter(|(_, value)| is_given(value)));
    // Both have the type that is read back.
    serde_json::from_value(Value::Object(merged)).unwrap_or_else(|_| own.clone())
}

/// Rows by channel: those of the campaign, overridden by the flight's card for the same channel, then further ones.
fn instruments(base: &[TestInstrument], own: &[TestInstrument]) -> Vec<TestInstrument> {
    let of = |rows: &[TestInstrument], channel: &str| rows.iter().find(|row| row.channel == channel).cloned();
    let known = base.iter().map(|row| of(own, &row.channel).map_or_else(|| row.clone(), |own| over(row, &own)));
    let new = own.iter().filter(|row| of(base, &row.channel).is_none()).cloned();
    known.chain(new).collect()
}
