//! Units as stated by a log in `UNIT`, `MULT` and `FMTU`: compared with those of the channel map.

use super::dataflash_record::Format;
use crate::reader::StatedUnit;
use flight::Dimension;
use std::borrow::Cow;
use std::collections::HashMap;

const DEG: f64 = std::f64::consts::PI / 180.0;

/// Names of units and multipliers by their letters.
#[derive(Debug, Default)]
pub(super) struct Units {
    names: HashMap<u8, String>,
    multipliers: HashMap<u8, f64>,
}

impl Units {
    /// A `UNIT` record.
    pub(super) fn unit(&mut self, id: Option<i64>, name: Option<Cow<'_, str>>) {
        if let (Some(id), Some(name)) = (id.and_then(|id| u8::try_from(id).ok()), name) {
            self.names.insert(id, name.into_owned());
        }
    }

    /// A `MULT` record.
    pub(super) fn multiplier(&mut self, id: Option<i64>, value: Option<f64>) {
        if let (Some(id), Some(value)) = (id.and_then(|id| u8::try_from(id).ok()), value) {
            self.multipliers.insert(id, value);
        }
    }

    /// Known units of the fields of a type. The scale of a format character is already applied to the values,
    /// and a multiplier of zero means no multiplier.
    pub(super) fn of(&self, format: &Format, units: &[u8], multipliers: &[u8]) -> Vec<StatedUnit> {
        let stated = |(index, field): (usize, &super::dataflash_record::Field)| {
            let name = self.names.get(units.get(index)?).filter(|name| !name.trim().is_empty())?;
            let multiplier = multipliers.get(index).and_then(|m| self.multipliers.get(m)).copied();
            let multiplier = multiplier.filter(|m| *m != 0.0 && !field.is_scaled()).unwrap_or(1.0);
            Some(StatedUnit {
                type_name: format.name.clone(),
                path: field.name.clone(),
                text: if multiplier == 1.0 { name.clone() } else { format!("{multiplier:.3e} {name}") },
                measures: meaning(name).map(|(dimension, si)| (dimension, si * multiplier)),
            })
        };
        format.fields.iter().enumerate().filter_map(stated).collect()
    }
}

/// The quantity of an ArduPilot unit, and one such unit in SI units.
fn meaning(name: &str) -> Option<(Dimension, f64)> {
    Some(match name {
        "deg" | "deglatitude" | "deglongitude" | "degheading" => (Dimension::Angle, DEG),
        "rad" => (Dimension::Angle, 1.0),
        "m" => (Dimension::Length, 1.0),
        "m/s" => (Dimension::Speed, 1.0),
        "m/s/s" => (Dimension::Acceleration, 1.0),
        "deg/s" => (Dimension::AngularRate, DEG),
        "rad/s" => (Dimension::AngularRate, 1.0),
        "s" => (Dimension::Time, 1.0),
        "Gauss" => (Dimension::MagneticField, 1e-4),
        _ => return None,
    })
}
