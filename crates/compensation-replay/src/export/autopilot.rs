//! The autopilot's own parameters for a measured delay.

use flight::Delay;
use std::fmt::Write;

/// What the position's delay was measured against.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MeasuredAgainst {
    /// The autopilot's inertial sensors or its own clock: the meaning of the parameters.
    Inertial,
    /// A velocity with unknown lateness: only the difference is known.
    UnknownVelocity,
}

/// Whether a parameter can hold the value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ParameterFit {
    /// The value and its interval are within the parameter's range.
    Fits,
    /// The value is within the range, its interval is not.
    AtTheEdge,
    /// The value is out of range; the parameter cannot remove the delay.
    OutOfRange,
    /// It rounds to zero, which this parameter treats as "automatic".
    RoundsToAutomatic,
}

/// A parameter with the value to set.
#[derive(Debug, Clone, PartialEq)]
pub struct AutopilotParameter {
    /// PX4 or ArduPilot, with the versions that have this name.
    pub firmware: &'static str,
    /// Name of the parameter.
    pub name: &'static str,
    /// Value to set, whole milliseconds, ties to even; not clipped to the range.
    pub value_ms: i64,
    /// Interval of ±2 standard uncertainties, ms, rounded outwards; `None` without an uncertainty.
    pub interval_ms: Option<[i64; 2]>,
    /// Range accepted by the firmware, ms.
    pub range_ms: [i64; 2],
    /// Whether the value fits.
    pub fit: ParameterFit,
}

/// What to set, and warnings.
#[derive(Debug, Clone, PartialEq)]
pub struct AutopilotAdvice {
    /// The delay that the values represent: that of the receiver after the inertial sensors, s.
    pub delay: Delay,
    /// Parameters by firmware.
    pub parameters: Vec<AutopilotParameter>,
    /// Sentences, most important first.
    pub warnings: Vec<String>,
}

/// Firmware, name, range in ms, whether zero means automatic, as the firmware's sources declare them: PX4
/// `ekf2_params.c`, then `vehicle_gps_position/module.yaml` (renamed twice in 2026), ArduPilot `AP_GPS_Params.cpp`
/// (4.6) and `AP_GPS.cpp` (before).
const KNOWN: [(&str, &str, [i64; 2], bool); 5] = [
    ("PX4", "EKF2_GPS_DELAY", [0, 300], false),
    ("PX4 main from March 2026", "SENS_GPS0_DELAY", [0, 300], false),
    ("PX4 main of later in 2026", "SENS_GNSS0_DELAY", [0, 300], false),
    ("ArduPilot from 4.6", "GPS1_DELAY_MS", [0, 250], true),
    ("ArduPilot before 4.6", "GPS_DELAY_MS", [0, 250], true),
];

/// Above this EKF2 needs a longer buffer, ms.
pub const EKF2_DELAY_MAX_DEFAULT_MS: i64 = 200;

/// Whether a parameter is the delay of an autopilot's first receiver.
#[must_use]
pub fn is_gps_delay(parameter: &str) -> bool {
    KNOWN.iter().any(|(_, name, ..)| *name == parameter)
}

/// Parameters for a delay with its standard uncertainty (s, k = 1).
///
/// These parameters shift the whole fix, position and velocity together, against the inertial sensors. A delay measured
/// against the receiver's own velocity is the difference of the two. It becomes a parameter only after adding the
/// velocity's own delay.
#[must_use]
pub fn autopilot_advice(delay: Delay, uncertainty_s: Option<f64>, against: MeasuredAgainst) -> AutopilotAdvice {
    let uncertainty_s = uncertainty_s.filter(|u| u.is_finite() && *u >= 0.0);
    let parameters: Vec<AutopilotParameter> =
        KNOWN.iter().map(|&known| parameter(known, delay.millis(), uncertainty_s.map(|u| u * 1e3))).collect();
    let warnings = warnings(delay.millis(), against, &parameters);
    AutopilotAdvice { delay, parameters, warnings }
}

fn parameter(
    (firmware, name, range_ms, automatic): (&'static str, &'static str, [i64; 2], bool),
    ms: f64,
    uncertainty_ms: Option<f64>,
) -> AutopilotParameter {
    let value_ms = ms.round_ties_even() as i64;
    let interval_ms = uncertainty_ms.map(|u| [(ms - 2.0 * u).floor() as i64, (ms + 2.0 * u).ceil() as i64]);
    let inside = |x: i64| (range_ms[0]..=range_ms[1]).contains(&x);
    let fit = match interval_ms {
        _ if !inside(value_ms) => ParameterFit::OutOfRange,
        _ if automatic && value_ms == 0 => ParameterFit::RoundsToAutomatic,
        Some(ends) if !ends.into_iter().all(inside) => ParameterFit::AtTheEdge,
        _ => ParameterFit::Fits,
    };
    AutopilotParameter { firmware, name, value_ms, interval_ms, range_ms, fit }
}

fn warnings(ms: f64, against: MeasuredAgainst, parameters: &[AutopilotParameter]) -> Vec<String> {
    let mut out = vec![
        "Do not compensate twice: set the parameter or run the compensator, never both. If this delay was measured \
         on the EKF's position, the parameter of that flight has already been applied, and the delay is the residual."
            .to_owned(),
    ];
    match against {
        MeasuredAgainst::Inertial => {}
        MeasuredAgainst::UnknownVelocity => out.push(
            "If this delay is that of the position relative to its velocity, a value is right only if that velocity \
             is on time, because the parameters shift both together. Measure the velocity against the inertial \
             sensors first."
                .to_owned(),
        ),
    }
    if parameters.iter().any(|p| p.fit == ParameterFit::OutOfRange) {
        let names: Vec<String> = parameters
            .iter()
            .filter(|p| p.fit == ParameterFit::OutOfRange)
            .map(|p| format!("{} takes {} to {} ms", p.name, p.range_ms[0], p.range_ms[1]))
            .collect();
        out.push(format!("{:.0} ms is out of range: {}.", ms, names.join(", ")));
    }
    if parameters.iter().any(|p| p.fit == ParameterFit::RoundsToAutomatic) {
        out.push("ArduPilot takes 0 as \"the default of the receiver's driver\", not as no delay.".to_owned());
    }
    if ms > EKF2_DELAY_MAX_DEFAULT_MS as f64 {
        out.push(format!(
            "Where PX4 has EKF2_DELAY_MAX (default {EKF2_DELAY_MAX_DEFAULT_MS} ms), it must not be below the largest delay."
        ));
    }
    out.push(
        "The parameters take effect after a reboot. PX4 of 2026 ignores SENS_GPS0_DELAY and SENS_GNSS0_DELAY where \
         the receiver's driver stamps the fix itself."
            .to_owned(),
    );
    out
}

impl AutopilotAdvice {
    /// Whether any parameter can hold the delay.
    #[must_use]
    pub fn can_be_set(&self) -> bool {
        self.parameters.iter().any(|p| matches!(p.fit, ParameterFit::Fits | ParameterFit::AtTheEdge))
    }

    /// Plain text, one line per parameter and warning.
    #[must_use]
    pub fn text(&self) -> String {
        let mut text = String::new();
        for p in &self.parameters {
            let interval = p.interval_ms.map_or(String::new(), |[low, high]| format!(" ({low} to {high}, k = 2)"));
            let fit = match p.fit {
                ParameterFit::Fits => "",
                ParameterFit::AtTheEdge => ", the interval exceeds the range",
                ParameterFit::OutOfRange => ", out of range: cannot be set",
                ParameterFit::RoundsToAutomatic => ", which means automatic: cannot be set",
            };
            let _ = writeln!(text, "{}: {} = {} ms{interval}{fit}", p.firmware, p.name, p.value_ms);
        }
        for warning in &self.warnings {
            let _ = writeln!(text, "{warning}");
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn advice(ms: f64, uncertainty_ms: f64) -> AutopilotAdvice {
        let delay = Delay::from_seconds(ms * 1e-3).unwrap();
        autopilot_advice(delay, Some(uncertainty_ms * 1e-3), MeasuredAgainst::Inertial)
    }

    fn named<'a>(advice: &'a AutopilotAdvice, name: &str) -> &'a AutopilotParameter {
        advice.parameters.iter().find(|p| p.name == name).unwrap()
    }

    #[test]
    fn delays_round_to_milliseconds_and_intervals_round_outwards() {
        let advice = advice(118.4, 3.1);
        for name in ["EKF2_GPS_DELAY", "SENS_GPS0_DELAY", "SENS_GNSS0_DELAY", "GPS1_DELAY_MS", "GPS_DELAY_MS"] {
            let parameter = named(&advice, name);
            assert_eq!((parameter.value_ms, parameter.interval_ms), (118, Some([112, 125])), "{name}");
            assert_eq!(parameter.fit, ParameterFit::Fits);
        }
        assert!(advice.text().contains("EKF2_GPS_DELAY = 118 ms (112 to 125, k = 2)"), "{}", advice.text());
        assert!(advice.warnings[0].contains("twice"));
    }

    #[test]
    fn a_value_out_of_range_is_reported_and_not_clipped() {
        let late = advice(400.0, 2.0);
        assert!(late.parameters.iter().all(|p| p.fit == ParameterFit::OutOfRange && p.value_ms == 400));
        assert!(late.text().contains("GPS1_DELAY_MS takes 0 to 250 ms") && late.text().contains("EKF2_DELAY_MAX"));
        let between = advice(249.0, 4.0);
        assert!(!late.can_be_set() && between.can_be_set());
        assert_eq!(named(&between, "GPS1_DELAY_MS").fit, ParameterFit::AtTheEdge);
        assert_eq!(named(&between, "EKF2_GPS_DELAY").fit, ParameterFit::Fits);
        let none = advice(0.2, 0.05);
        assert_eq!(named(&none, "GPS1_DELAY_MS").fit, ParameterFit::RoundsToAutomatic);
        assert_eq!(named(&none, "EKF2_GPS_DELAY").fit, ParameterFit::Fits);
        assert_eq!(named(&advice(-20.0, 1.0), "EKF2_GPS_DELAY").fit, ParameterFit::OutOfRange);
    }

    #[test]
    fn a_delay_against_a_velocity_of_unknown_lateness_is_said_to_be_relative() {
        let delay = Delay::from_seconds(0.1).unwrap();
        let unknown = autopilot_advice(delay, None, MeasuredAgainst::UnknownVelocity);
        assert!(unknown.text().contains("relative to its velocity"));
        assert_eq!(unknown.parameters[0].interval_ms, None);
    }
}
