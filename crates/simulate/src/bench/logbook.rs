//! The logs of a simulated bench.

use super::bench_samples::{BenchSamples, SimulatedBench};
use super::part::Part;
use super::quantity::BenchChannel;
use super::settings::EncoderOutput;
use super::wide;
use crate::error::SimulateError;
use crate::write::definition::{
    Definition, ENCODER_COUNT, JOINT_STATE, MAGNETIC_FIELD, NAV_SAT_FIX, POINT_STAMPED, QUATERNION_STAMPED,
    TIME_REFERENCE, TWIST_STAMPED, VECTOR3_STAMPED,
};
use crate::write::message::{Fields, Header, Message};
use crate::write::{Container, LogFile, Logbook, Topic, ros};
use flight::{NANOS_PER_SECOND, Stamp};

impl SimulatedBench {
    /// The bench as one log; `stem` is its path without an extension. A wide table has a row for each sample of the
    /// encoder and holds the last values of the sensor; it has only the encoder's timestamps, and no pulses.
    ///
    /// # Errors
    /// [`SimulateError::Mcap`], [`SimulateError::Json`] or [`SimulateError::Compress`] if a writer fails.
    pub fn files(&self, container: Container, stem: &str) -> Result<Vec<LogFile>, SimulateError> {
        self.part_files(Part::Whole, container, stem)
    }

    /// The log of the encoder alone, with the pulses.
    ///
    /// # Errors
    /// As [`SimulatedBench::files`].
    pub fn encoder_files(&self, container: Container, stem: &str) -> Result<Vec<LogFile>, SimulateError> {
        self.part_files(Part::Encoder, container, stem)
    }

    /// The log of the sensor alone. Its wide table has a row for each row of the channel with the most rows.
    ///
    /// # Errors
    /// As [`SimulatedBench::files`].
    pub fn sensor_files(&self, container: Container, stem: &str) -> Result<Vec<LogFile>, SimulateError> {
        self.part_files(Part::Sensor, container, stem)
    }

    fn part_files(&self, part: Part, container: Container, stem: &str) -> Result<Vec<LogFile>, SimulateError> {
        container.write(stem, || self.logbook(part), || wide::table(self, part))
    }

    /// Topic of a channel: below `/bench`, or below `/mti` if the sensor has its own clock.
    #[must_use]
    pub fn topic(&self, channel: BenchChannel) -> String {
        let own_clock = self.settings.clocks.device.is_some();
        if own_clock { channel.topic().replacen("/bench/", "/mti/", 1) } else { channel.topic().to_owned() }
    }

    /// Topic of the encoder: below `/bench`, or below `/daq` if the sensor has its own clock.
    #[must_use]
    pub fn encoder_topic(&self) -> String {
        let name = match self.settings.encoder.output {
            EncoderOutput::Count => "encoder",
            EncoderOutput::Angle => "joint_states",
        };
        format!("/{}/{name}", self.encoder_folder())
    }

    /// Topic of the pulses.
    #[must_use]
    pub fn pulse_topic(&self) -> String {
        format!("/{}/pps", self.encoder_folder())
    }

    fn encoder_folder(&self) -> &'static str {
        if self.settings.clocks.device.is_some() { "daq" } else { "bench" }
    }

    fn logbook(&self, part: Part) -> Logbook {
        let (mut topics, mut messages) = (vec![], vec![]);
        if part.has_encoder() {
            self.add_encoder(&mut topics, &mut messages);
            self.add_pulses(&mut topics, &mut messages);
        }
        if part.has_sensor() {
            for (&channel, samples) in &self.channels {
                messages.extend(self.sensor_messages(topics.len(), channel, samples));
                topics.push(Topic { name: self.topic(channel), definition: definition(channel) });
            }
        }
        Logbook::new(topics, messages)
    }

    fn add_encoder(&self, topics: &mut Vec<Topic>, messages: &mut Vec<Message>) {
        let (encoder, angles) = (&self.encoder, self.encoder_values());
        let topic = topics.len();
        let (definition, fields): (_, &dyn Fn(usize, Header) -> Fields) = match self.settings.encoder.output {
            EncoderOutput::Count => (&ENCODER_COUNT, &|row, header| ros::encoder_count(header, encoder.counts[row])),
            EncoderOutput::Angle => (&JOINT_STATE, &|row, header| ros::joint_state(header, angles[row])),
        };
        topics.push(Topic { name: self.encoder_topic(), definition });
        messages.extend(stamped(topic, "bar", &encoder.measured, &encoder.logged, fields));
    }

    /// A pulse is logged when it is detected.
    fn add_pulses(&self, topics: &mut Vec<Topic>, messages: &mut Vec<Message>) {
        let Some(pulses) = &self.pulses else { return };
        let second = |row: usize, header| ros::time_reference(header, Stamp(pulses.second[row] * NANOS_PER_SECOND));
        messages.extend(stamped(topics.len(), "pps", &pulses.edge, &pulses.edge, &second));
        topics.push(Topic { name: self.pulse_topic(), definition: &TIME_REFERENCE });
    }

    fn sensor_messages(&self, topic: usize, channel: BenchChannel, samples: &BenchSamples) -> Vec<Message> {
        let sampling = self.settings.sensor.get(&channel).map(|s| &s.sampling);
        let variance = sampling.map_or(0.0, |s| s.white_std.powi(2) + s.wander.map_or(0.0, |w| w.std.powi(2)));
        let fields = |row: usize, header: Header| message(channel, samples, row, header, variance);
        stamped(topic, "sensor", &samples.measured, &samples.logged, &fields)
    }
}

fn definition(channel: BenchChannel) -> &'static Definition {
    match channel {
        BenchChannel::PositionGps | BenchChannel::PositionIns => &NAV_SAT_FIX,
        BenchChannel::VelocityGps | BenchChannel::VelocityIns => &TWIST_STAMPED,
        BenchChannel::Attitude => &QUATERNION_STAMPED,
        BenchChannel::AngularRate | BenchChannel::SpecificForce | BenchChannel::MagneticDirection => &VECTOR3_STAMPED,
        BenchChannel::MagneticField => &MAGNETIC_FIELD,
        BenchChannel::Height => &POINT_STAMPED,
    }
}

/// Vectors are sent forward, left, up; attitudes rotate forward, left, up to north, west, up, as on the MTi-G. All of
/// this only changes signs. (East, north, up would change the last bits.)
fn message(channel: BenchChannel, samples: &BenchSamples, row: usize, header: Header, variance: f64) -> Fields {
    let of = |k: usize| samples.values[row].get(k).copied().unwrap_or(0.0);
    let flu = [of(0), -of(1), -of(2)];
    match channel {
        BenchChannel::PositionGps | BenchChannel::PositionIns => {
            ros::nav_sat_fix(header, samples.geodetic_deg[row], variance.max(1e-6))
        }
        BenchChannel::VelocityGps | BenchChannel::VelocityIns => ros::twist_stamped(header, [of(0), of(1), of(2)]),
        BenchChannel::Attitude => ros::quaternion_stamped(header, [of(0), of(1), -of(2), -of(3)]),
        BenchChannel::AngularRate | BenchChannel::SpecificForce | BenchChannel::MagneticDirection => {
            ros::vector3_stamped(header, flu)
        }
        BenchChannel::MagneticField => ros::magnetic_field(header, flu),
        BenchChannel::Height => ros::point_stamped(header, [0.0, 0.0, of(0)]),
    }
}

fn stamped(
    topic: usize,
    frame_id: &'static str,
    measured: &[Stamp],
    logged: &[Stamp],
    fields: &dyn Fn(usize, Header) -> Fields,
) -> Vec<Message> {
    let rows = measured.iter().zip(logged).enumerate();
    rows.map(|(row, (&stamp, &logged))| {
        let sequence = row as u32;
        Message { topic, sequence, logged, fields: fields(row, Header { sequence, stamp, frame_id }) }
    })
    .collect()
}
