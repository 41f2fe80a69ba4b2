//! Sensor card files, and their selection by a pipeline.

use bench_analysis::{identity_conflict, parse_card, sensor_name};
use record::{SensorCard, SensorIdentity};
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Suffix of the file name of a sensor card.
pub(crate) const CARD_ENDING: &str = ".card.toml";

/// A card and its content, in a manifest: a cluster's nodes do not need the file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct CardFile {
    file: String,
    text: String,
}

/// A card by name and content.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct Pin {
    /// File name of the card, without its folder.
    pub(crate) file: String,
    /// BLAKE3 of its content.
    pub(crate) blake3: String,
}

/// Whether two lists name the same cards, in any order.
pub(crate) fn same_pins(a: &[Pin], b: &[Pin]) -> bool {
    let sorted = |pins: &[Pin]| {
        let mut pins = pins.to_vec();
        pins.sort();
        pins
    };
    sorted(a) == sorted(b)
}

/// A card that provides delays.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct UsedCard {
    file: CardFile,
    blake3: String,
    card: SensorCard,
}

impl UsedCard {
    /// Reads a card from its text.
    pub(crate) fn parse(file: CardFile) -> Result<UsedCard, String> {
        let card = parse_card(&file.text, Path::new(&file.file)).map_err(|e| e.to_string())?;
        Ok(UsedCard { blake3: blake3::hash(file.text.as_bytes()).to_hex().to_string(), card, file })
    }

    /// File name without its folder.
    pub(crate) fn name(&self) -> &str {
        &self.file.file
    }

    /// Its content.
    pub(crate) fn card(&self) -> &SensorCard {
        &self.card
    }

    /// BLAKE3 of its content.
    pub(crate) fn blake3(&self) -> &str {
        &self.blake3
    }

    /// Name and content.
    pub(crate) fn file(&self) -> CardFile {
        self.file.clone()
    }

    /// Name and hash.
    pub(crate) fn pin(&self) -> Pin {
        Pin { file: self.file.file.clone(), blake3: self.blake3.clone() }
    }

    /// Where `sensor` and the card's sensor differ: first the value of `sensor`, then the card's.
    pub(crate) fn conflict(&self, sensor: &SensorIdentity) -> Option<String> {
        identity_conflict(sensor, &self.card.sensor)
    }
}

/// Source of cards.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Shelf<'a> {
    /// Files.
    Disk,
    /// A manifest.
    Manifest(&'a [CardFile]),
}

impl Shelf<'_> {
    /// The card at this path.
    pub(crate) fn card(&self, path: &Path) -> Result<UsedCard, String> {
        match self {
            Shelf::Disk => read(path),
            Shelf::Manifest([only]) => UsedCard::parse(only.clone()),
            Shelf::Manifest(cards) => Err(format!("the manifest has {} cards instead of one", cards.len())),
        }
    }

    /// The cards of a folder, by name.
    pub(crate) fn cards(&self, folder: &Path) -> Result<Vec<UsedCard>, String> {
        match self {
            Shelf::Disk => read_folder(folder),
            Shelf::Manifest(cards) => cards.iter().cloned().map(UsedCard::parse).collect(),
        }
    }
}

fn read(path: &Path) -> Result<UsedCard, String> {
    let text = std::fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))?;
    UsedCard::parse(CardFile { file: name_of(path), text })
}

fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

fn read_folder(folder: &Path) -> Result<Vec<UsedCard>, String> {
    let failed = |e: std::io::Error| format!("{}: {e}", folder.display());
    let entries = std::fs::read_dir(folder).map_err(failed)?.collect::<Result<Vec<_>, _>>().map_err(failed)?;
    let mut paths: Vec<_> = entries.iter().map(std::fs::DirEntry::path).collect();
    paths.retain(|p| name_of(p).ends_with(CARD_ENDING) && !name_of(p).starts_with('.'));
    paths.sort();
    if paths.is_empty() {
        return Err(format!("{}: no *{CARD_ENDING} in this folder", folder.display()));
    }
    paths.iter().map(|p| read(p)).collect()
}

/// Selects the cards of a sensor; all must be for the same one.
pub(crate) fn chosen(all: Vec<UsedCard>, sensor: &SensorIdentity) -> Result<Vec<UsedCard>, String> {
    let of = |card: &UsedCard| format!("{} ({})", card.name(), sensor_name(&card.card.sensor));
    let held = all.iter().map(of).collect::<Vec<_>>().join(", ");
    let fitting: Vec<UsedCard> = all.into_iter().filter(|card| card.conflict(sensor).is_none()).collect();
    if fitting.is_empty() {
        return Err(format!("no card of {}; the folder holds {held}", sensor_name(sensor)));
    }
    for (i, card) in fitting.iter().enumerate() {
        let others = fitting.iter().take(i);
        if let Some((other, conflict)) = others.filter_map(|o| Some((o, card.conflict(&o.card.sensor)?))).next() {
            let (other, this) = (other.name(), card.name());
            return Err(format!(
                "{other} and {this} both fit, but are of different sensors ({conflict}): state which \
                one in [sensor]"
            ));
        }
    }
    Ok(fitting)
}
