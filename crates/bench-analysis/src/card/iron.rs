//! Hard and soft iron of a magnetometer from all records of a card.

use crate::magnetometer::{MagneticSwing, expected, iron};
use crate::surroundings::Surroundings;
use record::{CardMagnetometer, Finding};

/// The Earth's fields of two sites differ if they are further apart than this share.
const SAME_FIELD: f64 = 0.02;

/// Evidence of a record about its magnetometer.
#[derive(Debug, Clone, PartialEq)]
pub struct MagneticEvidence {
    /// One swing, or more if the bench was turned within the record; empty without magnetometer or azimuth.
    pub swings: Vec<MagneticSwing>,
    /// The field at the bench.
    pub around: Surroundings,
}

/// Hard and soft iron from the swings of all `records`, in their order, taken together: one sensor in one field. `None`
/// if no record has a magnetometer at a known azimuth. Of several magnetometers, the first by record is used.
#[must_use]
pub fn card_magnetometer(records: &[&MagneticEvidence]) -> Option<CardMagnetometer> {
    let first = records.iter().flat_map(|r| &r.swings).next()?;
    let swings: Vec<MagneticSwing> =
        records.iter().flat_map(|r| &r.swings).filter(|s| s.channel == first.channel).cloned().collect();
    let with: Vec<&MagneticEvidence> = records.iter().copied().filter(|r| !r.swings.is_empty()).collect();
    let around = with.iter().find(|r| expected(&r.around).is_some()).or(with.first()).map(|r| &r.around)?;
    let found = one_field(&with).and_then(|()| iron(&swings, around));
    Some(CardMagnetometer {
        channel: first.channel.clone(),
        unit: if first.is_tesla { "T" } else { "1" }.to_owned(),
        azimuths_rad: swings.iter().map(|s| s.azimuth.value).collect(),
        iron: found.map_or_else(Finding::CannotTell, Finding::Found),
    })
}

/// Swings in different fields cannot be combined.
fn one_field(records: &[&MagneticEvidence]) -> Result<(), String> {
    let mut fields = records.iter().filter_map(|r| expected(&r.around));
    let Some(first) = fields.next() else { return Ok(()) };
    match fields.map(|b| (b - first).norm() / first.norm()).fold(0.0, f64::max) {
        apart if apart > SAME_FIELD => Err(format!(
            "the Earth's field differs by {:.1} % between the places of the records: hard and soft iron need swings in \
             one place",
            100.0 * apart
        )),
        _ => Ok(()),
    }
}
