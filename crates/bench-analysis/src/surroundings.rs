//! Gravity and magnetic field at the bench, and their sources.

use crate::gravity::{STANDARD_GRAVITY_MPS2, normal_gravity};
use crate::magnetic::{ModelField, decimal_year, model_field};
use crate::rig::{FieldRule, Rig};
use flight::{Code, Flight, Geodetic, Notices, Quantity};
use jiff::civil::Date;

/// Effects of the site on the sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct Surroundings {
    /// Gravity, m/s².
    pub gravity_mps2: f64,
    /// Source of the gravity.
    pub gravity_source: String,
    /// Magnetic field north, east, down, T; `None` means fitted.
    pub field_t: Option<[f64; 3]>,
    /// Source of the field, with the validity of the model.
    pub field_source: String,
    /// The World Magnetic Model's field, if site and date are known; for comparison.
    pub model: Option<ModelField>,
}

/// The first fix of the first geodetic position in `flight`.
#[must_use]
pub fn place_of(flight: &Flight) -> Option<Geodetic> {
    let channel = flight.channels.values().find(|c| c.quantity == Quantity::PositionGeodetic)?;
    let first = |k: usize| channel.series.components().get(k).and_then(|c| c.first()).copied();
    Some(Geodetic { latitude: first(0)?, longitude: first(1)?, height: first(2).unwrap_or(0.0) })
}

impl Surroundings {
    /// From the rig file, with the log's own place and day as fallback (but the day of the log takes precedence over
    /// that of the rig file).
    #[must_use]
    pub fn of(rig: &Rig, log_place: Option<Geodetic>, log_day: Option<Date>) -> (Surroundings, Notices) {
        let mut notices = Notices::new();
        let place = stated_place(rig).or(log_place);
        let (gravity_mps2, gravity_source) = gravity(rig, place, &mut notices);
        let model = place.zip(log_day.or(rig.site.date)).map(|(p, day)| model_field(p, decimal_year(day)));
        let (field_t, field_source) = field(rig, model.as_ref(), &mut notices);
        (Surroundings { gravity_mps2, gravity_source, field_t, field_source, model }, notices)
    }
}

fn stated_place(rig: &Rig) -> Option<Geodetic> {
    let (latitude, longitude) = rig.site.latitude.zip(rig.site.longitude)?;
    Some(Geodetic { latitude, longitude, height: rig.site.height_m })
}

fn gravity(rig: &Rig, place: Option<Geodetic>, notices: &mut Notices) -> (f64, String) {
    if let Some(stated) = rig.site.gravity_mps2 {
        return (stated, "rig file".to_owned());
    }
    let latitude_only = rig.site.latitude.map(|latitude| (latitude, rig.site.height_m));
    match latitude_only.or(place.map(|p| (p.latitude, p.height))) {
        Some((latitude, height)) => {
            let from = if latitude_only.is_some() { "the rig file" } else { "the log's first fix" };
            let source = format!("Somigliana at {:.4}°, {height:.0} m ({from})", latitude.to_degrees());
            (normal_gravity(latitude, height), source)
        }
        None => {
            let text = "neither rig file nor log states the site: standard gravity 9.80665 m/s² is used, wrong by up \
                        to 0.3 %";
            notices.push(Code::Assumption, "", 1, text);
            (STANDARD_GRAVITY_MPS2, "assumed: standard gravity, because the site is unknown".to_owned())
        }
    }
}

fn field(rig: &Rig, model: Option<&ModelField>, notices: &mut Notices) -> (Option<[f64; 3]>, String) {
    match (rig.site.field, model) {
        (FieldRule::Stated(field), _) => (Some(field), "rig file".to_owned()),
        (FieldRule::Fit, _) => (None, "fitted to each axis of the magnetometer".to_owned()),
        (FieldRule::Wmm, Some(model)) => {
            if !model.is_valid {
                let text = format!("{}: the field is extrapolated", validity(model));
                notices.push(Code::Assumption, "", 1, text);
            }
            (Some(model.ned_t), validity(model))
        }
        (FieldRule::Wmm, None) => {
            let text = "site.field = \"wmm\" needs site and day, and neither rig file nor log has both: the field is \
                        fitted";
            notices.push(Code::Assumption, "", 1, text);
            (None, "fitted: the site or day that the model needs is unknown".to_owned())
        }
    }
}

fn validity(model: &ModelField) -> String {
    let [from, to] = model.valid_years;
    let outside = if model.is_valid { "" } else { ", and the day is outside these years" };
    format!("{}, made for {from:.0} to {to:.0}{outside}", model.model)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_place_is_the_first_fix_and_a_log_without_one_has_none() {
        let flight = simulate::simulate(&simulate::FlightSettings::default()).unwrap().to_flight().unwrap();
        let place = place_of(&flight).unwrap();
        let fixes = &flight.channels["position.gps"].series;
        assert_eq!([place.latitude, place.longitude, place.height], [0, 1, 2].map(|k| fixes.component(k)[0]));
        assert_eq!(place_of(&Flight::default()), None);
    }
}
