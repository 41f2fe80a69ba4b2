//! A simulated swing with known truth, and helpers shared by the tests.

use bench_analysis::{
    BarState, EncoderSeries, Motion, Rig, angular_rate, attitude, magnetic_field, position, specific_force, velocity,
};
use flight::{
    Channel, ChannelSource, Clock, Flight, Geodetic, LocalFrame, Quantity, Series, Stamp, StampKind, Timeline,
};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use serde_json::Value;
use std::f64::consts::TAU;
use std::path::Path;

pub const LENGTH: f64 = 1.3;
pub const GRAVITY: f64 = 9.7996;
/// Field at Goyang in 2010, T.
pub const FIELD: [f64; 3] = [29_579e-9, -4_122e-9, 41_280e-9];

pub fn vectors() -> Value {
    serde_json::from_str(include_str!("../vectors.json")).unwrap()
}

pub fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

pub fn close(expected: &[f64], found: &[f64], tolerance: f64) {
    assert_eq!(expected.len(), found.len());
    for (e, f) in expected.iter().zip(found) {
        assert!((e - f).abs() <= tolerance, "expected {expected:?}, found {found:?}");
    }
}

/// A hand swing: a few sines about a centre.
#[derive(Debug, Clone)]
pub struct Swing {
    pub middle: f64,
    /// Amplitude rad, frequency Hz, phase rad.
    pub sines: Vec<(f64, f64, f64)>,
    pub duration: f64,
}

impl Swing {
    /// About 55° to either side near 0.55 Hz, with small faster hand motion.
    pub fn by_hand(middle: f64) -> Swing {
        let sines = vec![(0.7, 0.53, 0.3), (0.2, 0.68, 1.1), (0.1, 1.07, -0.7), (0.05, 1.61, 2.0)];
        Swing { middle, sines, duration: 40.0 }
    }

    pub fn at(&self, t: f64) -> BarState {
        let mut s = BarState { angle: self.middle, ..BarState::default() };
        for &(a, f, phase) in &self.sines {
            let w = TAU * f;
            let (sin, cos) = (w * t + phase).sin_cos();
            s.angle += a * sin;
            s.rate += a * w * cos;
            s.acceleration -= a * w * w * sin;
            s.jerk -= a * w.powi(3) * cos;
        }
        s
    }
}

/// What the sensor on the bar measures of the truth.
#[derive(Debug, Clone)]
pub struct Sensor {
    pub azimuth: f64,
    pub arm: [f64; 3],
    /// Rotation vector of the mount: the sensor reads `Rᵀ u`.
    pub turned: [f64; 3],
    pub seed: u64,
}

impl Sensor {
    pub fn upright(azimuth: f64) -> Sensor {
        Sensor { azimuth, arm: [0.0, 0.0, -LENGTH], turned: [0.0; 3], seed: 1 }
    }
}

pub struct Noise {
    rng: Pcg64,
}

impl Noise {
    pub fn seeded(seed: u64) -> Noise {
        Noise { rng: Pcg64::seed_from_u64(seed) }
    }

    pub fn gauss(&mut self, sigma: f64) -> f64 {
        let x: f64 = StandardNormal.sample(&mut self.rng);
        sigma * x
    }
}

pub fn channel(quantity: Quantity, t: &[f64], components: Vec<Vec<f64>>) -> Channel {
    let stamps = t.iter().map(|t| Stamp((t * 1e9).round() as i64)).collect();
    let timeline = Timeline::new(StampKind::Logged, Clock::Elapsed, stamps).unwrap();
    let width = components.len();
    Channel {
        quantity,
        series: Series::new(timeline, components).unwrap(),
        present: vec![true; width],
        other_stamps: vec![],
        held: vec![false; t.len()],
        source: ChannelSource { topic: "t".into(), type_name: String::new(), fields: vec![] },
    }
}

pub fn grid(rate: f64, duration: f64) -> Vec<f64> {
    (0..(rate * duration) as usize).map(|k| k as f64 / rate).collect()
}

/// Counts of an encoder with `per_rev` counts, its sign and its angle at count zero.
pub fn encoder_channel(swing: &Swing, rate: f64, per_rev: f64, sign: f64, zero: f64) -> Channel {
    let t = grid(rate, swing.duration);
    let counts = t.iter().map(|t| (sign * (swing.at(*t).angle - zero) / TAU * per_rev).round()).collect();
    channel(Quantity::EncoderCount, &t, vec![counts])
}

/// A rig of 2000 counts at Goyang; `more` is appended, `encoder` and `bar` are lines of their tables.
pub fn rig(bar: &str, encoder: &str, more: &str) -> Rig {
    let mount = if bar.contains("mount") { "" } else { "mount = \"upright\"\n" };
    let text = format!(
        "schema = 1\n[sensor]\nmodel = \"simulated\"\n[bar]\nlength_m = {LENGTH}\n{mount}{bar}\n\
         [encoder]\ncounts_per_rev = 2000\n{encoder}\n[site]\ngravity_mps2 = {GRAVITY}\n{more}\n"
    );
    Rig::parse(&text, Path::new("test.rig.toml")).unwrap()
}

/// The smoothed encoder without sign and zero.
pub fn motion(encoder: &Channel, rig: &Rig) -> Motion {
    Motion::of(EncoderSeries::of("encoder.bar", encoder, rig).unwrap()).unwrap()
}

/// One channel of the sensor: `delay` late at `rate`, with white noise of `sigma`.
pub fn sensed(swing: &Swing, sensor: &Sensor, quantity: Quantity, rate: f64, delay: f64, sigma: f64) -> Channel {
    let t = grid(rate, swing.duration);
    let mut noise = Noise::seeded(sensor.seed.wrapping_mul(1000).wrapping_add(quantity as u64));
    let turn = bench_analysis::rotation(sensor.turned).transpose();
    let body = |v: [f64; 3]| -> [f64; 3] { (turn * nalgebra::Vector3::from(v)).into() };
    let frame = LocalFrame::new(Geodetic::from_degrees(37.6, 126.86, 20.0));
    let rows: Vec<Vec<f64>> = t
        .iter()
        .map(|t| {
            let state = swing.at(t - delay);
            let mut noisy = |v: [f64; 3]| v.map(|x| x + noise.gauss(sigma)).to_vec();
            let Sensor { azimuth, arm, .. } = *sensor;
            match quantity {
                Quantity::PositionNed => noisy(position(&state, azimuth, arm).value),
                Quantity::PositionGeodetic => {
                    let ned = noisy(position(&state, azimuth, arm).value);
                    let at = frame.to_geodetic([ned[0], ned[1], ned[2]]);
                    vec![at.latitude, at.longitude, at.height]
                }
                Quantity::VelocityNed => noisy(velocity(&state, azimuth, arm).value),
                Quantity::SpecificForce => noisy(body(specific_force(&state, arm, GRAVITY).value)),
                Quantity::AngularRate => noisy(body(angular_rate(&state, azimuth, None).value)),
                Quantity::MagneticField => noisy(body(magnetic_field(&state, azimuth, FIELD).value)),
                Quantity::Height => vec![-noisy(position(&state, azimuth, arm).value)[2]],
                Quantity::Attitude => {
                    let tilt = noisy([state.angle, 0.0, 0.0])[0];
                    attitude(tilt, azimuth).to_vec()
                }
                other => panic!("{other:?}"),
            }
        })
        .collect();
    let components = (0..rows[0].len()).map(|k| rows.iter().map(|r| r[k]).collect()).collect();
    channel(quantity, &t, components)
}

pub fn flight_of(channels: Vec<(&str, Channel)>) -> Flight {
    Flight { channels: channels.into_iter().map(|(n, c)| (n.to_owned(), c)).collect(), ..Flight::default() }
}

/// All channels of an MTi-G-like sensor: position 0.4 s late, the rest nearly on time.
pub fn everything(swing: &Swing, sensor: &Sensor) -> Flight {
    let made = |quantity, rate, delay, sigma| sensed(swing, sensor, quantity, rate, delay, sigma);
    flight_of(vec![
        ("position.gps", made(Quantity::PositionGeodetic, 4.0, 0.4, 0.1)),
        ("velocity.ins", made(Quantity::VelocityNed, 100.0, 0.02, 0.05)),
        ("attitude.ins", made(Quantity::Attitude, 100.0, 0.01, 0.005)),
        ("angular-rate.imu", made(Quantity::AngularRate, 100.0, 0.003, 0.01)),
        ("specific-force.imu", made(Quantity::SpecificForce, 100.0, 0.003, 0.05)),
        ("magnetic-field.imu", made(Quantity::MagneticField, 100.0, 0.006, 2e-7)),
        ("height.baro", made(Quantity::Height, 10.0, 0.15, 0.3)),
    ])
}
