//! Camera and laser scanner data of a flight: most bytes of such a log, but irrelevant for a delay.

use super::definition::COMPRESSED_IMAGE;
use super::message::{Header, Message, Value};
use super::{Logbook, Topic};
use crate::random::generator;
use crate::simulated::SimulatedFlight;
use flight::Stamp;
use rand::RngExt;
use rand_pcg::Pcg64;

/// A topic of images.
struct Images {
    name: &'static str,
    frame_id: &'static str,
    format: &'static str,
    rate_hz: f64,
    draw: fn(&mut Pcg64) -> Vec<u8>,
}

const CAMERA: Images = Images {
    name: "/camera/image/compressed",
    frame_id: "camera",
    format: "jpeg",
    rate_hz: 5.0,
    // Compressed once, so that it cannot be compressed again.
    draw: |random| (0..48_000).map(|_| random.random()).collect(),
};
const SCANNER: Images = Images {
    name: "/lidar/ranges/compressed",
    frame_id: "lidar",
    format: "16 bit",
    rate_hz: 2.0,
    // Ranges around the aircraft, mm: the low bits are noise.
    draw: |random| {
        let range = |i: u32| 20_000 + (6000.0 * (f64::from(i) * 1e-3).sin()) as i32 + random.random_range(-15..=15);
        (0..20_000).map(range).flat_map(|range| (range as u16).to_le_bytes()).collect()
    },
};

/// Whether a topic is one of these.
pub(super) fn is_heavy(topic: &Topic) -> bool {
    [CAMERA.name, SCANNER.name].contains(&topic.name.as_str())
}

/// The logbook including their topics.
pub(super) fn added(log: Logbook, flight: &SimulatedFlight) -> Logbook {
    let Logbook { mut topics, mut messages } = log;
    for images in [CAMERA, SCANNER] {
        messages.extend(images.messages(flight, topics.len()));
        topics.push(Topic { name: images.name.to_owned(), definition: &COMPRESSED_IMAGE });
    }
    Logbook::new(topics, messages)
}

impl Images {
    fn messages(&self, flight: &SimulatedFlight, topic: usize) -> Vec<Message> {
        let settings = &flight.settings;
        let mut random = generator(settings.seed, self.name);
        let message = |sequence: u32| {
            let stamp: Stamp = settings.start.plus_seconds(f64::from(sequence) / self.rate_hz + 0.002);
            let header = Header { sequence, stamp, frame_id: self.frame_id };
            let fields = vec![
                ("header", Value::Header(header)),
                ("format", Value::Text(self.format.to_owned())),
                ("data", Value::Bytes((self.draw)(&mut random))),
            ];
            Message { topic, sequence, logged: stamp, fields }
        };
        (0..(settings.duration_s * self.rate_hz) as u32).map(message).collect()
    }
}
