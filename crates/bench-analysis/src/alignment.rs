//! Fits what the rig file leaves open: sign and zero of the encoder, azimuth of the swing's plane.
//!
//! Every channel is first aligned with the encoder's angle with all its coefficients free (see `pattern`), so that a
//! late channel carries as much information as one on time. Sign, zero and azimuth then follow from the coefficients
//! (design note 1.6).

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

/// Relation of the bar's angle to the encoder, and the plane of the swing.
#[derive(Debug, Clone)]
pub struct Alignment {
    /// +1 or −1.
    pub sign: f64,
    /// Source of the sign.
    pub sign_source: String,
    /// Bar angle at encoder zero, rad, in (−π, π].
    pub zero_rad: Estimate,
    /// Source of the zero.
    pub zero_source: String,
    /// Azimuth of the swing's plane from north over east, rad, in (−π, π]; `None` if no channel shows it.
    pub azimuth_rad: Option<Estimate>,
    /// Source of the azimuth, or why it is unknown.
    pub azimuth_source: String,
    /// Delay at which each channel was aligned with the encoder, s: good to a few milliseconds, without interval.
    pub coarse_delay_s: BTreeMap<String, f64>,
    /// Zero according to each channel alone, rad, by channel, for comparison.
    pub zeros: Vec<(String, Estimate)>,
    /// Azimuth according to each channel alone, rad.
    pub azimuths: Vec<(String, Estimate)>,
    /// Assumptions made.
    pub notices: Notices,
    pub(crate) clues: Vec<Clue>,
}

/// Fits what the rig file leaves open from the channels of `sensor`, whose timestamps are in the encoder's clock.
/// `motion` is [`Motion::of`] the encoder, not yet oriented. What no channel shows is assumed, named in the source and
/// reported as a warning.
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
