//! The bench as one wide table.

use super::bench_samples::{BenchSamples, SimulatedBench, columns, held};
use super::part::Part;
use super::quantity::BenchChannel;
use super::settings::EncoderOutput;
use crate::error::SimulateError;
use flight::{Clock, Flight, Series, Stamp, StampKind, Timeline};

/// Rows of the table: true times, timestamps, and the clock of these.
struct Rows<'a> {
    at_s: &'a [f64],
    stamps: &'a [Stamp],
    clock: Clock,
}

/// A row for each sample of the encoder, or of the sensor's channel with the most rows.
fn rows(bench: &SimulatedBench, part: Part) -> Rows<'_> {
    if part.has_encoder() {
        return Rows { at_s: &bench.encoder.at_s, stamps: &bench.encoder.measured, clock: Clock::Unix };
    }
    let clock = if bench.settings.clocks.device.is_some() { Clock::Boot } else { Clock::Unix };
    let longest = bench.channels.values().max_by_key(|samples| samples.at_s.len());
    longest.map_or(Rows { at_s: &[], stamps: &[], clock }, |s| Rows { at_s: &s.at_s, stamps: &s.measured, clock })
}

/// For each row of the table, the newest row of a channel.
fn newest(rows: &Rows<'_>, samples: &BenchSamples) -> Vec<Option<usize>> {
    // One nanosecond of tolerance, for the same instant counted in two clocks.
    let last = |t: &f64| samples.at_s.partition_point(|at| *at <= t + 1e-9).checked_sub(1);
    rows.at_s.iter().map(last).collect()
}

/// Names contain the unit; body axes are forward, right, down; a quaternion rotates them to north, east, down.
fn names(channel: BenchChannel) -> Vec<String> {
    let of = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect::<Vec<_>>();
    match channel {
        BenchChannel::PositionGps => of(&["gps_latitude_deg", "gps_longitude_deg", "gps_height_m"]),
        BenchChannel::PositionIns => of(&["latitude_deg", "longitude_deg", "height_m"]),
        BenchChannel::VelocityGps => of(&["gps_velocity_north_mps", "gps_velocity_east_mps", "gps_velocity_down_mps"]),
        BenchChannel::VelocityIns => of(&["velocity_north_mps", "velocity_east_mps", "velocity_down_mps"]),
        BenchChannel::Attitude => of(&["q_w", "q_x", "q_y", "q_z"]),
        BenchChannel::AngularRate => of(&["gyro_x_radps", "gyro_y_radps", "gyro_z_radps"]),
        BenchChannel::SpecificForce => of(&["acc_x_mps2", "acc_y_mps2", "acc_z_mps2"]),
        BenchChannel::MagneticField => of(&["mag_x_t", "mag_y_t", "mag_z_t"]),
        BenchChannel::MagneticDirection => of(&["mag_x_au", "mag_y_au", "mag_z_au"]),
        BenchChannel::Height => of(&["baro_height_m"]),
    }
}

/// The cells of a channel's row.
fn cells(channel: BenchChannel, samples: &BenchSamples, row: usize) -> Vec<f64> {
    match channel {
        BenchChannel::PositionGps | BenchChannel::PositionIns => samples.geodetic_deg[row].to_vec(),
        _ => samples.values[row].clone(),
    }
}

pub(super) fn table(bench: &SimulatedBench, part: Part) -> Vec<u8> {
    let rows = rows(bench, part);
    let mut header = vec![if rows.clock == Clock::Boot { "time_boot_ns" } else { "time_ns" }.to_owned()];
    let mut lines: Vec<String> = rows.stamps.iter().map(|stamp| stamp.0.to_string()).collect();
    if part.has_encoder() {
        let count = bench.settings.encoder.output == EncoderOutput::Count;
        header.push(if count { "encoder_count" } else { "encoder_angle_rad" }.to_owned());
        lines.iter_mut().zip(bench.encoder_values()).for_each(|(line, value)| *line += &format!(",{value}"));
    }
    for (&channel, samples) in bench.channels.iter().filter(|_| part.has_sensor()) {
        let names = names(channel);
        for (line, row) in lines.iter_mut().zip(newest(&rows, samples)) {
            let cells = row.map_or(vec![String::new(); names.len()], |row| {
                cells(channel, samples, row).iter().map(f64::to_string).collect()
            });
            *line += &format!(",{}", cells.join(","));
        }
        header.extend(names);
    }
    (header.join(",") + "\n" + &lines.join("\n") + "\n").into_bytes()
}

impl SimulatedBench {
    /// The bench's wide table as a perfect reader would return it: all channels by the timestamps of the encoder, which
    /// count as the logger's, with repeats marked if a channel or its updates are slower than the rows.
    ///
    /// # Errors
    /// [`SimulateError::Series`] if the samples are not a valid series.
    pub fn to_wide_flight(&self) -> Result<Flight, SimulateError> {
        let rows = rows(self, Part::Whole);
        let mut flight = self.to_flight()?;
        flight.channels.remove("pps.sensor");
        for (&which, samples) in &self.channels {
            let newest = newest(&rows, samples);
            let Some(channel) = flight.channels.get_mut(which.name()) else { continue };
            let first = newest.iter().take_while(|row| row.is_none()).count();
            let shown: Vec<usize> = newest.into_iter().flatten().collect();
            let column = |column: &Vec<f64>| shown.iter().map(|&row| column[row]).collect();
            let components: Vec<Vec<f64>> = columns(which, samples).iter().map(column).collect();
            channel.held = held(&components);
            let timeline = Timeline::new(StampKind::Logged, Clock::Unix, rows.stamps[first..].to_vec())?;
            channel.series = Series::new(timeline, components)?;
            channel.other_stamps = vec![];
        }
        if let Some(encoder) = flight.channels.get_mut(self.encoder_name()) {
            let timeline = Timeline::new(StampKind::Logged, Clock::Unix, rows.stamps.to_vec())?;
            encoder.series = Series::new(timeline, vec![self.encoder_values()])?;
            encoder.other_stamps = vec![];
        }
        Ok(flight)
    }
}
