//! Samples of the bench's instruments, and the same as returned by a perfect reader.

use super::motion::BenchTruth;
use super::quantity::BenchChannel;
use super::settings::{BenchSettings, EncoderOutput};
use crate::error::SimulateError;
use flight::{Channel, ChannelSource, Clock, Flight, Quantity, Series, Stamp, StampKind, Timeline};
use std::collections::BTreeMap;

/// Rows of one channel of the sensor.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct BenchSamples {
    /// True time at which each row was sent, s after the start.
    pub at_s: Vec<f64>,
    /// True time at which its value was updated: the same, unless values are held.
    pub update_s: Vec<f64>,
    /// Its timestamp: of the device's clock, or of the encoder's if that is the only clock.
    pub measured: Vec<Stamp>,
    /// Arrival at the logger, by the logger's clock; may decrease if a later row overtook.
    pub logged: Vec<Stamp>,
    /// Components in the order and units of [`flight::Quantity`], but a position as north, east, down from the
    /// pivot, m.
    pub values: Vec<Vec<f64>>,
    /// For a position: latitude deg, longitude deg, height m, as sent. Otherwise empty.
    pub geodetic_deg: Vec<[f64; 3]>,
}

/// Rows of the encoder.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct EncoderSamples {
    /// True time at which each was taken, s after the start.
    pub at_s: Vec<f64>,
    /// Its timestamp, by the encoder's clock.
    pub measured: Vec<Stamp>,
    /// Arrival at the logger, by the logger's clock.
    pub logged: Vec<Stamp>,
    /// Counts.
    pub counts: Vec<i64>,
}

/// Pulses of the sensor.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PulseSamples {
    /// True time of each edge, s after the start.
    pub at_s: Vec<f64>,
    /// Timestamp of the edge, by the encoder's clock.
    pub edge: Vec<Stamp>,
    /// Second shown by the sensor's clock at the edge.
    pub second: Vec<i64>,
}

/// A bench record with known truth.
#[derive(Debug, Clone, PartialEq)]
pub struct SimulatedBench {
    /// The settings.
    pub settings: BenchSettings,
    /// The truth.
    pub truth: BenchTruth,
    /// The encoder.
    pub encoder: EncoderSamples,
    /// The sensor's channels.
    pub channels: BTreeMap<BenchChannel, BenchSamples>,
    /// The pulses, if any.
    pub pulses: Option<PulseSamples>,
}

impl SimulatedBench {
    /// Encoder and sensor as a perfect reader would return them from one log, bit for bit the values in the logs:
    /// `encoder.bar`, the channels of [`BenchChannel::name`], and `pps.sensor`.
    ///
    /// # Errors
    /// [`SimulateError::Series`] if the samples are not a valid series.
    pub fn to_flight(&self) -> Result<Flight, SimulateError> {
        let (mut encoder, sensor) = self.to_flights()?;
        encoder.channels.extend(sensor.channels);
        Ok(encoder)
    }

    /// The same from two logs: that of the encoder, with the pulses, and that of the sensor.
    ///
    /// # Errors
    /// [`SimulateError::Series`] if the samples are not a valid series.
    pub fn to_flights(&self) -> Result<(Flight, Flight), SimulateError> {
        let (mut encoder, mut sensor) = (Flight::default(), Flight::default());
        encoder.channels.insert(self.encoder_name().to_owned(), self.encoder_channel()?);
        if let Some(pulses) = &self.pulses {
            encoder.channels.insert("pps.sensor".to_owned(), pulse_channel(pulses, self.pulse_topic())?);
        }
        for (&channel, samples) in &self.channels {
            sensor.channels.insert(channel.name().to_owned(), self.sensor_channel(channel, samples)?);
        }
        Ok((encoder, sensor))
    }

    /// `encoder.bar` for counts, `encoder.angle` for angles.
    #[must_use]
    pub fn encoder_name(&self) -> &'static str {
        match self.settings.encoder.output {
            EncoderOutput::Count => "encoder.bar",
            EncoderOutput::Angle => "encoder.angle",
        }
    }

    /// The encoder's values as sent: counts, or rad.
    #[must_use]
    pub fn encoder_values(&self) -> Vec<f64> {
        let count_rad = std::f64::consts::TAU / self.settings.encoder.counts_per_rev();
        let value = |&n: &i64| match self.settings.encoder.output {
            EncoderOutput::Count => n as f64,
            EncoderOutput::Angle => n as f64 * count_rad,
        };
        self.encoder.counts.iter().map(value).collect()
    }

    fn encoder_channel(&self) -> Result<Channel, SimulateError> {
        let (quantity, type_name) = match self.settings.encoder.output {
            EncoderOutput::Count => (Quantity::EncoderCount, "flightlag_msgs/EncoderCount"),
            EncoderOutput::Angle => (Quantity::EncoderAngle, "sensor_msgs/JointState"),
        };
        let source = source(self.encoder_topic(), type_name);
        let timeline = Timeline::new(StampKind::Measured, Clock::Unix, self.encoder.measured.clone())?;
        let logged = (StampKind::Logged, Clock::Unix, self.encoder.logged.clone());
        channel(quantity, timeline, vec![self.encoder_values()], vec![logged], source)
    }

    fn sensor_channel(&self, which: BenchChannel, samples: &BenchSamples) -> Result<Channel, SimulateError> {
        let clock = if self.settings.clocks.device.is_some() { Clock::Boot } else { Clock::Unix };
        let timeline = Timeline::new(StampKind::Measured, clock, samples.measured.clone())?;
        let logged = (StampKind::Logged, Clock::Unix, samples.logged.clone());
        let components = columns(which, samples);
        let source = source(self.topic(which), which.type_name());
        let mut channel = channel(which.quantity(), timeline, components, vec![logged], source)?;
        if self.settings.sensor.get(&which).is_some_and(|s| s.update_hz.is_some()) {
            channel.held = held(channel.series.components());
        }
        Ok(channel)
    }
}

/// Components in the layout of a flight, column by column.
pub(super) fn columns(which: BenchChannel, samples: &BenchSamples) -> Vec<Vec<f64>> {
    let column = |k: usize| -> Vec<f64> {
        match which.quantity() {
            Quantity::PositionGeodetic if k < 2 => samples.geodetic_deg.iter().map(|row| row[k].to_radians()).collect(),
            Quantity::PositionGeodetic => samples.geodetic_deg.iter().map(|row| row[k]).collect(),
            _ => samples.values.iter().map(|row| row[k]).collect(),
        }
    };
    (0..which.quantity().components().len()).map(column).collect()
}

/// Rows equal to the previous row in all values; empty unless most updates cover two rows or more.
pub(super) fn held(components: &[Vec<f64>]) -> Vec<bool> {
    let rows = components.first().map_or(0, Vec::len);
    let repeats: Vec<bool> = (0..rows).map(|row| row > 0 && components.iter().all(|c| c[row] == c[row - 1])).collect();
    let mut tally: BTreeMap<usize, usize> = BTreeMap::new();
    let updates: Vec<usize> = (0..rows).filter(|&row| !repeats[row]).chain([rows]).collect();
    updates.windows(2).for_each(|pair| *tally.entry(pair[1] - pair[0]).or_default() += 1);
    let often = tally.into_iter().max_by_key(|&(run, count)| (count, std::cmp::Reverse(run)));
    if often.is_some_and(|(run, _)| run >= 2) { repeats } else { vec![false; rows] }
}

fn pulse_channel(pulses: &PulseSamples, topic: String) -> Result<Channel, SimulateError> {
    let timeline = Timeline::new(StampKind::Logged, Clock::Unix, pulses.edge.clone())?;
    let seconds = pulses.second.iter().map(|&s| s as f64).collect();
    channel(Quantity::Pulse, timeline, vec![seconds], vec![], source(topic, "sensor_msgs/TimeReference"))
}

fn source(topic: String, type_name: &str) -> ChannelSource {
    ChannelSource { topic, type_name: type_name.to_owned(), fields: vec![] }
}

fn channel(
    quantity: Quantity,
    timeline: Timeline,
    components: Vec<Vec<f64>>,
    other_stamps: Vec<(StampKind, Clock, Vec<Stamp>)>,
    source: ChannelSource,
) -> Result<Channel, SimulateError> {
    let series = Series::new(timeline, components)?;
    let (present, held) = (vec![true; series.components().len()], vec![false; series.len()]);
    Ok(Channel { quantity, series, present, other_stamps, held, source })
}
