//! Checks whether two sensors are the same.

use record::SensorIdentity;

/// The differences between two identities, as ``serial `1` and `2` ``; `None` if every part stated by both is equal.
#[must_use]
pub fn identity_conflict(a: &SensorIdentity, b: &SensorIdentity) -> Option<String> {
    let baud = |s: &SensorIdentity| s.baud.map(|b| b.to_string());
    let parts = [
        ("model", Some(a.model.clone()), Some(b.model.clone())),
        ("serial", a.serial.clone(), b.serial.clone()),
        ("firmware", a.firmware.clone(), b.firmware.clone()),
        ("baud", baud(a), baud(b)),
        ("configuration", a.configuration.clone(), b.configuration.clone()),
    ];
    let conflict = |(part, a, b): &(&str, Option<String>, Option<String>)| match (a, b) {
        (Some(a), Some(b)) if a.trim() != b.trim() => Some(format!("{part} `{a}` and `{b}`")),
        _ => None,
    };
    let conflicts: Vec<String> = parts.iter().filter_map(conflict).collect();
    (!conflicts.is_empty()).then(|| conflicts.join(", "))
}

/// Short name of the sensor: model and serial number.
#[must_use]
pub fn sensor_name(sensor: &SensorIdentity) -> String {
    match &sensor.serial {
        Some(serial) => format!("{} {serial}", sensor.model),
        None => sensor.model.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sensor(model: &str, serial: Option<&str>) -> SensorIdentity {
        SensorIdentity { model: model.into(), serial: serial.map(str::to_owned), ..SensorIdentity::default() }
    }

    #[test]
    fn a_part_stated_by_one_side_only_is_no_conflict() {
        assert_eq!(identity_conflict(&sensor("A", Some("1")), &sensor("A", None)), None);
    }

    #[test]
    fn every_differing_part_is_named() {
        let a = SensorIdentity { baud: Some(115_200), ..sensor("A", Some("1")) };
        let b = SensorIdentity { baud: Some(57_600), ..sensor("A", Some("2")) };
        assert_eq!(identity_conflict(&a, &b).unwrap(), "serial `1` and `2`, baud `115200` and `57600`");
        assert!(identity_conflict(&a, &sensor("B", None)).unwrap().starts_with("model"));
    }
}
