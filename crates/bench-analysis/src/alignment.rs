//! What the rig leaves open and the record shows: sign and zero of the encoder, azimuth of the swing's plane.
//!
//! Every channel is first laid over the encoder's angle with all its coefficients free (see `pattern`), so that a
//! late channel says as much as one on time. Sign, zero and azimuth are then read off the coefficients (design note 1.6).

mod azimuth;
mod clue;
mod force;
mod sign;
mod zero;

use crate::motion::Motion;
use crate::rig::Rig;
use crate::surroundings::Surroundings;
use flight::{Code, Flight, Notices};
use record::Estimate;
use std::collections::BTreeMap;

pub(crate) use clue::{Circle, Clue, clues};
pub(crate) use force::ForceFit;
pub(crate) use zero::force_fit;

/// How the bar's angle follows from the encoder, and where it swings.
#[derive(Debug, Clone)]
pub struct Alignment {
    /// +1 or −1.
    pub sign: f64,
    /// Where it comes from.
    pub sign_source: String,
    /// Bar angle at encoder zero, rad, in (−π, π].
    pub zero_rad: Estimate,
    /// Where it comes from.
    pub zero_source: String,
    /// Azimuth of the swing's plane from north over east, rad, in (−π, π]; `None` if nothing shows it.
    pub azimuth_rad: Option<Estimate>,
    /// Where it comes from, or why it is missing.
    pub azimuth_source: String,
    /// Delay at which each channel was laid over the encoder, s: good to a few milliseconds, without interval.
    pub coarse_delay_s: BTreeMap<String, f64>,
    /// Zero as each channel shows it alone, rad, by channel: to compare.
    pub zeros: Vec<(String, Estimate)>,
    /// Azimuth as each channel shows it alone, rad.
    pub azimuths: Vec<(String, Estimate)>,
    /// What had to be assumed.
    pub notices: Notices,
    pub(crate) clues: Vec<Clue>,
}

/// Finds what the rig leaves open from the channels of `sensor`, whose stamps are in the encoder's clock. `motion` is
/// [`Motion::of`] the encoder, not yet oriented. What nothing shows is assumed, said in the source and raised as a warning.
#[must_use]
pub fn align(motion: &Motion, sensor: &Flight, rig: &Rig, around: &Surroundings) -> Alignment {
    let clues = clues(motion, sensor, rig, around);
    let mut notices = Notices::new();
    let (sign, sign_source) = sign::sign(&clues, rig, &mut notices);
    let azimuth_hint = rig.bar.azimuth_rad;
    let zeros = zero::zeros(&clues, sign, azimuth_hint);
    let (zero_rad, zero_source) = zero::zero(&zeros, motion, sign, rig, &mut notices);
    let azimuths = azimuth::azimuths(&clues, sign, zero_rad.value);
    let (azimuth_rad, azimuth_source) = azimuth::azimuth(&azimuths, rig);
    if azimuth_rad.is_none() && clues.iter().any(Clue::needs_azimuth) {
        let text = "the azimuth of the swing is unknown: north and east are not compared";
        notices.push(Code::NoReference, "", 1, text);
    }
    Alignment {
        sign,
        sign_source,
        zero_rad,
        zero_source,
        azimuth_rad,
        azimuth_source,
        coarse_delay_s: clues.iter().map(|c| (c.name.clone(), c.delay_s)).collect(),
        zeros,
        azimuths,
        notices,
        clues,
    }
}

/// `value ± uncertainty`.
pub(crate) fn estimate(value: f64, standard_uncertainty: f64) -> Estimate {
    Estimate { value, standard_uncertainty: Some(standard_uncertainty) }
}
