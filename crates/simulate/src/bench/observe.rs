//! Observations of the truth by encoder, sensor and pulses.

use super::bench_samples::{BenchSamples, EncoderSamples, PulseSamples, SimulatedBench};
use super::lag::Lagged;
use super::motion::BenchTruth;
use super::quantity::BenchChannel;
use super::settings::{BenchSensor, BenchSettings, Outliers, Pulses};
use crate::error::SimulateError;
use crate::random::{generator, normal};
use crate::trajectory::MARGIN_S;
use flight::{LocalFrame, Stamp};
use rand::RngExt;
use rand_pcg::Pcg64;
use std::f64::consts::TAU;

pub(super) fn observe(settings: &BenchSettings, truth: BenchTruth) -> Result<SimulatedBench, SimulateError> {
    let encoder = encoder(settings, &truth);
    let sensor = settings.sensor.iter();
    let channels = sensor.map(|(&which, sensor)| (which, samples(settings, &truth, which, sensor))).collect();
    let pulses = settings.pulses.as_ref().map(|pulses| edges(settings, pulses));
    Ok(SimulatedBench { settings: settings.clone(), truth, encoder, channels, pulses })
}

/// A separate generator for each random quantity: more noise does not change any timestamp.
fn random(settings: &BenchSettings, name: &str, what: &str) -> Pcg64 {
    generator(settings.seed, &format!("bench {name} {what}"))
}

fn encoder(settings: &BenchSettings, truth: &BenchTruth) -> EncoderSamples {
    let encoder = &settings.encoder;
    let random = |what: &str| random(settings, "encoder", what);
    let at_s = encoder.sampling.instants(settings.duration_s(), &mut random("instants"));
    let misses = encoder.sampling.stamp_errors(at_s.len(), &mut random("stamps"));
    let latencies = encoder.sampling.latencies(at_s.len(), &mut random("latencies"));
    let count = |&t: &f64| {
        let turned = truth.at(t - encoder.sampling.delay_s).angle - encoder.zero_rad;
        let running = (encoder.sign * turned * encoder.counts_per_rev() / TAU).round() as i64;
        encoder.wrap_counts.map_or(running, |wrap| running.rem_euclid(i64::from(wrap)))
    };
    EncoderSamples {
        counts: at_s.iter().map(count).collect(),
        measured: at_s.iter().zip(&misses).map(|(t, miss)| settings.start.plus_seconds(t + miss)).collect(),
        logged: arrivals(settings, &at_s, &latencies),
        at_s,
    }
}

/// The logger's clock at the arrival of a message sent at `at_s`.
fn arrivals(settings: &BenchSettings, at_s: &[f64], latencies: &[f64]) -> Vec<Stamp> {
    let clock = settings.clocks.logger;
    at_s.iter().zip(latencies).map(|(t, late)| settings.start.plus_seconds(clock.shows_s(t + late))).collect()
}

fn samples(settings: &BenchSettings, truth: &BenchTruth, which: BenchChannel, sensor: &BenchSensor) -> BenchSamples {
    let random = |what: &str| random(settings, which.name(), what);
    let sampling = &sensor.sampling;
    // The sensor samples by its own clock: its elapsed seconds first, true time from them.
    let rate = 1.0 + settings.clocks.device.map_or(0.0, |clock| clock.skew);
    let elapsed = sampling.instants(settings.duration_s() * rate, &mut random("instants"));
    let misses = sampling.stamp_errors(elapsed.len(), &mut random("stamps"));
    let latencies = sampling.latencies(elapsed.len(), &mut random("latencies"));
    let at_s: Vec<f64> = elapsed.iter().map(|t| t / rate).collect();
    let (updates, update_of) = updates(&elapsed, sensor.update_hz);
    let update_at: Vec<f64> = updates.iter().map(|t| t / rate).collect();
    let mut errors = sampling.errors(&update_at, &mut random("errors"));
    if let Some(outliers) = &sensor.outliers {
        add_outliers(&mut errors, outliers, &mut random("outliers"));
    }
    let seen = Seen::new(settings, truth, which, sensor);
    let values: Vec<Vec<f64>> = update_at.iter().zip(&errors).map(|(&t, error)| seen.value(t, *error)).collect();
    let geodetic = geodetic_deg(settings, which, &values);
    let stamp = |(t, miss): (&f64, &f64)| match settings.clocks.device {
        Some(clock) => Stamp(0).plus_seconds(clock.offset_s + t + miss),
        None => settings.start.plus_seconds(t + miss),
    };
    BenchSamples {
        measured: elapsed.iter().zip(&misses).map(stamp).collect(),
        logged: arrivals(settings, &at_s, &latencies),
        update_s: update_of.iter().map(|&update| update_at[update]).collect(),
        values: update_of.iter().map(|&update| values[update].clone()).collect(),
        geodetic_deg: if geodetic.is_empty() { vec![] } else { update_of.iter().map(|&u| geodetic[u]).collect() },
        at_s,
    }
}

/// Instants of updates, and the update shown by each row.
fn updates(elapsed: &[f64], update_hz: Option<f64>) -> (Vec<f64>, Vec<usize>) {
    let Some(update_hz) = update_hz else { return (elapsed.to_vec(), (0..elapsed.len()).collect()) };
    let (mut updates, mut rows) = (vec![], vec![]);
    for t in elapsed {
        let update = (t * update_hz + 1e-9).floor() / update_hz;
        if updates.last() != Some(&update) {
            updates.push(update);
        }
        rows.push(updates.len() - 1);
    }
    (updates, rows)
}

fn add_outliers(errors: &mut [[f64; 3]], outliers: &Outliers, random: &mut Pcg64) {
    for error in errors {
        if random.random_bool(outliers.share) {
            error.iter_mut().for_each(|e| *e += outliers.std * normal(random));
        }
    }
}

/// The observation of the truth by one channel.
struct Seen<'a> {
    truth: &'a BenchTruth,
    which: BenchChannel,
    sensor: &'a BenchSensor,
    lagged: Option<Lagged>,
}

impl<'a> Seen<'a> {
    fn new(settings: &BenchSettings, truth: &'a BenchTruth, which: BenchChannel, sensor: &'a BenchSensor) -> Seen<'a> {
        let (from_s, to_s) = (-MARGIN_S, settings.duration_s() + MARGIN_S);
        let mut lagged: Option<Lagged> = None;
        for &lag in &sensor.lags_s {
            lagged = Some(match &lagged {
                None => Lagged::new(|t| truth.core(which, t), lag, from_s, to_s),
                Some(before) => Lagged::new(|t| before.at(t), lag, from_s, to_s),
            });
        }
        Seen { truth, which, sensor, lagged }
    }

    fn value(&self, t_s: f64, error: [f64; 3]) -> Vec<f64> {
        let t = t_s - self.sensor.sampling.delay_s;
        let core = self.lagged.as_ref().map_or_else(|| self.truth.core(self.which, t), |lagged| lagged.at(t));
        let scaled = self.mixed(core.map(|value| self.sensor.gain * value));
        if self.which == BenchChannel::Attitude {
            return self.truth.quaternion(scaled[0], error).to_vec();
        }
        let width = self.which.quantity().components().len();
        (0..width).map(|k| scaled[k] + error[k]).collect()
    }

    /// The effect of soft iron on a magnetometer's three axes.
    fn mixed(&self, field: [f64; 3]) -> [f64; 3] {
        let is_magnetometer = matches!(self.which, BenchChannel::MagneticField | BenchChannel::MagneticDirection);
        let soft_iron = self.sensor.soft_iron.filter(|_| is_magnetometer);
        soft_iron.map_or(field, |rows| rows.map(|row| (0..3).map(|k| row[k] * field[k]).sum()))
    }
}

/// Latitude deg, longitude deg, height m of a position; empty for other channels.
fn geodetic_deg(settings: &BenchSettings, which: BenchChannel, values: &[Vec<f64>]) -> Vec<[f64; 3]> {
    if which.quantity() != flight::Quantity::PositionGeodetic {
        return vec![];
    }
    let frame = LocalFrame::new(settings.site.pivot());
    let degrees = |ned: &Vec<f64>| {
        let point = frame.to_geodetic([ned[0], ned[1], ned[2]]);
        [point.latitude.to_degrees(), point.longitude.to_degrees(), point.height]
    };
    values.iter().map(degrees).collect()
}

fn edges(settings: &BenchSettings, pulses: &Pulses) -> PulseSamples {
    let mut random = random(settings, "pulses", "edges");
    let mut samples = PulseSamples::default();
    // A sensor without its own clock pulses at the full seconds of the encoder's, starting at one.
    let start_s = settings.start.0.div_euclid(flight::NANOS_PER_SECOND);
    let (clock, epoch_s) = settings.clocks.device.map_or((Default::default(), start_s), |clock| (clock, 0));
    let (first, last) = (clock.shows_s(0.0), clock.shows_s(settings.duration_s()));
    for second in first.ceil() as i64..=last.floor() as i64 {
        let at_s = (second as f64 - clock.offset_s) / (1.0 + clock.skew);
        let (lost, miss) = (random.random_bool(pulses.drop_share), pulses.stamp_jitter_s * normal(&mut random));
        if !lost {
            samples.at_s.push(at_s);
            samples.edge.push(settings.start.plus_seconds(at_s + miss));
            samples.second.push(epoch_s + second);
        }
    }
    samples
}
