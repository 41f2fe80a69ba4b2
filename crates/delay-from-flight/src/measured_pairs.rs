//! All delays of a flight, pair by pair.

use crate::pairs::{Pair, Second};
use crate::{measure, pairs};
use flight::{Flight, Notices};
use rayon::prelude::*;
use record::{DelayPairKind, Finding, FlightDelays, MeasuredDelay};

/// Settings of the delay search.
#[derive(Debug, Clone, PartialEq)]
pub struct FlightDelaySettings {
    /// Range of delays to search, s.
    pub search_s: (f64, f64),
    /// Wider range, used if the best delay is at the edge of the first range, s.
    pub wide_search_s: (f64, f64),
    /// A delay that is more uncertain than this is not measurable, s (standard uncertainty).
    pub worst_sigma_s: f64,
    /// Longest gap of the second channel that is bridged by a straight line, s. `None`: 2.5 usual intervals, and at
    /// least half a second.
    pub bridge_s: Option<f64>,
    /// Target standard uncertainty for a window of the delay over time, s.
    pub window_sigma_s: f64,
    /// Delays that are injected into the second half and measured again, s.
    pub inject_s: Vec<f64>,
    /// Position and velocity whose pair is examined in detail: splits, injections, objective. `None`: every pair.
    pub detailed: Option<(String, String)>,
    /// Chance probability below which a changing delay raises an alarm.
    pub alarm_p: f64,
    /// Sources (the part of a channel's name after the dot) that are on time by definition.
    pub references: Vec<String>,
    /// A channel with more samples is first measured with every second, third, … of them.
    pub first_look_samples: usize,
    /// A channel with a higher rate is first measured with every second, third, … of its samples, Hz.
    pub first_look_hz: f64,
    /// A first look with this standard uncertainty of the delay is sufficient, s.
    pub enough_s: f64,
    /// Maximum number of samples of a channel in the second look.
    pub most_samples: usize,
    /// Maximum number of samples of the channel compared with: in longer records neighbours are averaged.
    pub most_compared: usize,
}

impl Default for FlightDelaySettings {
    fn default() -> FlightDelaySettings {
        let references = ["truth", "mocap", "vicon", "rtk", "reference"];
        FlightDelaySettings {
            search_s: (-2.5, 13.0),
            wide_search_s: (-5.0, 30.0),
            worst_sigma_s: 0.05,
            bridge_s: None,
            window_sigma_s: 0.01,
            inject_s: vec![0.1],
            detailed: None,
            alarm_p: 1e-3,
            references: references.map(str::to_owned).to_vec(),
            first_look_samples: 8_000,
            first_look_hz: 25.0,
            enough_s: 2.5e-4,
            most_samples: 40_000,
            most_compared: 500_000,
        }
    }
}

/// All delays that the channels of the flight show. Each pair without a delay has a reason and advice. Notices list
/// what was masked, cut and skipped.
///
/// Measured quality (example `flight_delay_study`, nine kinds of receiver, 200 to 400 circuits each; the bound includes
/// the noise of the position and the integrated noise of the velocity): rms error 0.89 to 1.07 of the bound, 95 %
/// intervals that hold the truth in 93.5 to 98 %, straight and stationary flights always rejected. A 100 Hz channel
/// with a delay known to 0.25 ms from every fourth sample is not measured again: 1.17 of the bound there. Velocity
/// against acceleration, with the bias of the accelerometers fitted in body axes, has 5 times smaller errors than
/// integer shifts (today's practice) on the same data. One hour at 10 and 100 Hz takes 0.36 s.
#[must_use]
pub fn measure_delays(flight: &Flight, settings: &FlightDelaySettings) -> (FlightDelays, Notices) {
    let mut notices = Notices::new();
    let pairs = pairs::pairs_of(flight, settings, &mut notices);
    // Pairs are independent, so idle threads of the caller's pool help with them.
    let measured: Vec<_> = pairs
        .par_iter()
        .map(|pair| {
            let mut own = Notices::new();
            (measure::measure(flight, pair, settings, &mut own), own)
        })
        .collect();
    let mut all = vec![];
    for (pair, own) in measured {
        all.push(pair);
        notices.extend_unsaid(own);
    }
    (FlightDelays { pairs: all }, notices)
}

/// Lateness of the channel `velocity` against the channel `reference`, a position or a velocity; positive if the velocity
/// is later. Or why it cannot be measured.
#[must_use]
pub fn measure_against_reference(
    flight: &Flight,
    velocity: &str,
    reference: &str,
    settings: &FlightDelaySettings,
) -> Finding<MeasuredDelay> {
    let kind = DelayPairKind::VelocityAgainstReference;
    let owned = str::to_owned;
    let pair = match reference.starts_with("position") {
        true => Pair { kind, first: owned(reference), second: Second::Velocity(owned(velocity)), reversed: true },
        false => Pair { kind, first: owned(velocity), second: Second::Rate(owned(reference)), reversed: false },
    };
    measure::measure(flight, &pair, settings, &mut Notices::new()).delay
}
