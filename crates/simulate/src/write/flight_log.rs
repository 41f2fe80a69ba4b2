//! The log of a simulated flight.

use super::definition::{NAV_SAT_FIX, STRING, TWIST_STAMPED};
use super::message::{Fields, Header, Message};
use super::{Logbook, Topic, ros};
use crate::samples::Samples;
use crate::simulated::{SimulatedFlight, topic};

const POSITION: usize = 0;
const VELOCITY: usize = 1;
const REFERENCE: usize = 2;
const NOTES: usize = 3;
/// Only if the aircraft computes a position.
const ONBOARD: usize = 4;

/// Variance that represents "as good as exact" in a covariance, m².
const EXACT_M2: f64 = 1e-6;

/// All topics and messages of a flight.
pub(super) fn logbook(flight: &SimulatedFlight) -> Logbook {
    let mut topics = vec![
        Topic { name: topic::POSITION.to_owned(), definition: &NAV_SAT_FIX },
        Topic { name: topic::VELOCITY.to_owned(), definition: &TWIST_STAMPED },
        Topic { name: topic::REFERENCE.to_owned(), definition: &NAV_SAT_FIX },
        Topic { name: topic::NOTES.to_owned(), definition: &STRING },
    ];
    let std = flight.settings.position.white_std;
    let mut all = fixes(&flight.position, POSITION, (std * std).max(EXACT_M2));
    all.extend(stamped(&flight.velocity, VELOCITY, "map", |row, header| {
        ros::twist_stamped(header, flight.velocity.ned[row])
    }));
    all.extend(fixes(&flight.reference, REFERENCE, EXACT_M2));
    all.extend(notes(flight));
    if !flight.onboard.is_empty() {
        topics.push(Topic { name: topic::ONBOARD.to_owned(), definition: &NAV_SAT_FIX });
        all.extend(fixes(&flight.onboard, ONBOARD, EXACT_M2));
    }
    Logbook::new(topics, all)
}

fn fixes(samples: &Samples, topic: usize, variance_m2: f64) -> Vec<Message> {
    stamped(samples, topic, "gps", |row, header| ros::nav_sat_fix(header, samples.geodetic_deg[row], variance_m2))
}

fn stamped(
    samples: &Samples,
    topic: usize,
    frame_id: &'static str,
    fields: impl Fn(usize, Header) -> Fields,
) -> Vec<Message> {
    let message = |row: usize| {
        let header = Header { sequence: row as u32, stamp: samples.measured[row], frame_id };
        Message { topic, sequence: row as u32, logged: samples.logged[row], fields: fields(row, header) }
    };
    (0..samples.len()).map(message).collect()
}

/// One message per second: a topic that is not needed, so that readers have something to skip.
fn notes(flight: &SimulatedFlight) -> Vec<Message> {
    let note = |second: u32| Message {
        topic: NOTES,
        sequence: second,
        logged: flight.settings.start.plus_seconds(f64::from(second) + 0.0005),
        fields: ros::string(format!("second {second}: all well, \"nothing\" to see; 3 < 4 & so on")),
    };
    (0..flight.settings.duration_s as u32).map(note).collect()
}
