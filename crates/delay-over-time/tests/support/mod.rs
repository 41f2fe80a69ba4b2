//! Flights with a known delay that may vary (`delay-over-time.md`, `vectors.json`). Seconds and metres.

#![allow(dead_code, clippy::indexing_slicing, clippy::unwrap_used)]

use delay_over_time::{CannotAnalyse, OverTimeSettings, PositionAgainstVelocity};
use rand::{RngExt, SeedableRng};
use rand_distr::{Exp1, StandardNormal, StudentT};
use rand_pcg::Pcg64;
use std::f64::consts::PI;

/// Step of the true motion, s.
const DT: f64 = 0.02;
/// Start of the true motion, s.
const BEGIN_S: f64 = -20.0;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Path {
    Circuits,
    Sturns,
    Survey,
    Hover,
    Straight,
    VarSpeed,
}

pub const TURNING: [Path; 4] = [Path::Circuits, Path::Sturns, Path::Survey, Path::Hover];

/// Delay against the instant at which a fix is valid.
#[derive(Debug, Clone, Copy)]
pub enum Profile {
    Constant,
    Step { by: f64 },
    Ramp { by: f64 },
    Skew { rate: f64 },
    BuildUp { top: f64 },
    Sawtooth { top: f64, period: f64 },
    Two { by: f64, dwell: f64 },
    Jitter { mean: f64 },
    Spikes { count: usize },
}

#[derive(Debug, Clone, Copy)]
pub struct Case {
    pub path: Path,
    pub profile: Profile,
    pub delay: f64,
    /// OU standard deviation, time constant, white: m, s, m.
    pub noise: [f64; 3],
    /// White noise of the velocity, m/s.
    pub velocity_noise: f64,
    pub duration: f64,
    /// Fixes and velocities per second.
    pub rates: [f64; 2],
    /// Antenna ahead, m.
    pub lever: f64,
    pub heavy_tails: bool,
    pub velocity_scale: f64,
    pub east_noise: f64,
}

pub const GPS: [f64; 3] = [1.5, 60.0, 0.3];
pub const RTK: [f64; 3] = [0.02, 20.0, 0.02];
pub const ROUGH: [f64; 3] = [1.0, 15.0, 0.5];

impl Case {
    pub fn gps(path: Path, profile: Profile) -> Case {
        Case {
            path,
            profile,
            delay: 0.2,
            noise: GPS,
            velocity_noise: 0.1,
            duration: 240.0,
            rates: [5.0, 25.0],
            lever: 0.0,
            heavy_tails: false,
            velocity_scale: 1.0,
            east_noise: 1.0,
        }
    }

    pub fn rtk(path: Path, profile: Profile) -> Case {
        Case { noise: RTK, velocity_noise: 0.05, duration: 180.0, rates: [10.0, 50.0], ..Case::gps(path, profile) }
    }
}

pub struct Flight {
    pub t: Vec<f64>,
    pub north: Vec<f64>,
    pub east: Vec<f64>,
    pub velocity_t: Vec<f64>,
    pub velocity_north: Vec<f64>,
    pub velocity_east: Vec<f64>,
    /// True lateness of each fix, s.
    pub late: Vec<f64>,
}

/// [`delay_over_time::analyse`], compared with the golden text of the running test.
pub fn analyse(
    record: &PositionAgainstVelocity<'_>,
    settings: &OverTimeSettings,
) -> Result<record::DelayOverTime, CannotAnalyse> {
    let found = delay_over_time::analyse(record, settings);
    let golden = found.as_ref().map_err(ToString::to_string);
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden");
    simulate::assert_golden(&folder, &simulate::one_field_per_line(&serde_json::to_value(golden).unwrap()));
    found
}

impl Flight {
    pub fn record(&self) -> PositionAgainstVelocity<'_> {
        PositionAgainstVelocity {
            t: &self.t,
            north: &self.north,
            east: &self.east,
            velocity_t: &self.velocity_t,
            velocity_north: &self.velocity_north,
            velocity_east: &self.velocity_east,
            breaks: &[],
        }
    }

    pub fn analyse(&self) -> record::DelayOverTime {
        analyse(&self.record(), &OverTimeSettings::default()).unwrap()
    }
}

pub struct Random(Pcg64);

impl Random {
    pub fn new(seed: u64) -> Random {
        Random(Pcg64::seed_from_u64(seed))
    }

    pub fn uniform(&mut self, from: f64, to: f64) -> f64 {
        from + (to - from) * self.0.random::<f64>()
    }

    pub fn normal(&mut self) -> f64 {
        self.0.sample(StandardNormal)
    }

    fn exponential(&mut self) -> f64 {
        self.0.sample(Exp1)
    }

    fn below(&mut self, n: usize) -> usize {
        ((self.uniform(0.0, 1.0) * n as f64) as usize).min(n - 1)
    }
}

/// Hann window of ±2 s.
fn smooth(x: &[f64], s: f64) -> Vec<f64> {
    let half = (2.0 * s / DT) as isize;
    let weights: Vec<f64> = (-half..=half).map(|k| 0.5 + 0.5 * (PI * k as f64 / half as f64).cos()).collect();
    let total: f64 = weights.iter().sum();
    let last = x.len() as isize - 1;
    let at = |i: isize| -> f64 {
        let sum: f64 = (-half..=half).zip(&weights).map(|(k, w)| w * x[(i + k).clamp(0, last) as usize]).sum();
        sum / total
    };
    (0..=last).map(at).collect()
}

/// True velocity on the grid.
fn velocity(path: Path, n: usize, random: &mut Random) -> Vec<[f64; 2]> {
    let t = |i: usize| BEGIN_S + DT * i as f64;
    let along = |heading: &dyn Fn(usize) -> f64, speed: &dyn Fn(f64) -> f64| -> Vec<[f64; 2]> {
        (0..n).map(|i| [speed(t(i)) * heading(i).cos(), speed(t(i)) * heading(i).sin()]).collect()
    };
    let turned = |rate: Vec<f64>| -> Vec<f64> {
        let mut sum = 0.0;
        smooth(&rate, 0.5)
            .into_iter()
            .map(|r| {
                sum += r * DT;
                sum
            })
            .collect()
    };
    match path {
        Path::Circuits => {
            let mut rate = vec![0.0; n];
            let mut i = 0;
            while i < n {
                i += (random.uniform(3.0, 9.0) / DT) as usize;
                let turn = 17.0 / 30.0 * if random.below(2) == 0 { 1.0 } else { -1.0 };
                let share = [1.0, 1.0, 0.5][random.below(3)];
                let k = (PI / (17.0 / 30.0) * share / DT) as usize;
                rate[i.min(n)..(i + k).min(n)].fill(turn);
                i += k;
            }
            let heading = turned(rate);
            along(&|i| heading[i], &|t| 17.5 + 2.5 * (2.0 * PI * t / 37.0).sin())
        }
        Path::Sturns => {
            let period = random.uniform(9.0, 14.0);
            let heading = |i: usize| {
                let t = t(i);
                50f64.to_radians() * (2.0 * PI * (t / period + 0.15 * (2.0 * PI * t / 47.0).sin())).sin()
            };
            along(&heading, &|_| 20.0)
        }
        Path::Survey => {
            let mut rate = vec![0.0; n];
            let (mut i, mut side) = (0, 1.0);
            while i < n {
                i += (40.0 / DT) as usize;
                let k = (6.0 / DT) as usize;
                rate[i.min(n)..(i + k).min(n)].fill(side * PI / 6.0);
                i += k;
                side = -side;
            }
            let heading = turned(rate);
            along(&|i| heading[i], &|t| 18.0 + 0.3 * (2.0 * PI * t / 23.0).sin())
        }
        Path::Hover => {
            let mut v = [vec![0.0; n], vec![0.0; n]];
            let mut i = 0;
            while i < n {
                i += (random.uniform(8.0, 20.0) / DT) as usize;
                let k = (random.uniform(4.0, 7.0) / DT) as usize;
                let (angle, speed) = (random.uniform(0.0, 2.0 * PI), random.uniform(5.0, 10.0));
                v[0][i.min(n)..(i + k).min(n)].fill(speed * angle.cos());
                v[1][i.min(n)..(i + k).min(n)].fill(speed * angle.sin());
                i += k;
            }
            let [north, east] = v.map(|x| smooth(&x, 0.6));
            north.into_iter().zip(east).map(|(n, e)| [n, e]).collect()
        }
        Path::Straight => along(&|_| 0.3, &|t| 18.0 + 0.2 * (2.0 * PI * t / 31.0).sin()),
        Path::VarSpeed => {
            let heading = |i: usize| 50f64.to_radians() * (2.0 * PI * t(i) / 12.0).sin();
            along(&heading, &|t| 16.0 + 8.0 * (2.0 * PI * t / 53.0).sin())
        }
    }
}

/// Lateness of fixes that are valid at `s`.
fn lateness(case: &Case, s: &[f64], random: &mut Random) -> Vec<f64> {
    let (d, end) = (case.delay, case.duration);
    let of = |f: &dyn Fn(f64) -> f64| s.iter().map(|s| f(*s)).collect::<Vec<f64>>();
    match case.profile {
        Profile::Constant => of(&|_| d),
        Profile::Step { by } => of(&|s| if s < 0.5 * end { d } else { d + by }),
        Profile::Ramp { by } => of(&|s| d + by * (s / end).clamp(0.0, 1.0)),
        Profile::Skew { rate } => of(&|s| d + rate * s),
        Profile::BuildUp { top } => {
            let (t0, t1) = (0.25 * end, 0.7 * end);
            of(&|s| if s > t0 && s < t1 { d + (top - d) * (s - t0) / (t1 - t0) } else { d })
        }
        Profile::Sawtooth { top, period } => of(&|s| d + (top - d) * s.rem_euclid(period) / period),
        Profile::Two { by, dwell } => {
            let mut sum = 0.0;
            let edges: Vec<f64> = (0..200)
                .map(|_| {
                    sum += dwell * random.exponential();
                    sum
                })
                .collect();
            of(&|s| if edges.partition_point(|e| *e < s) % 2 == 1 { d + by } else { d })
        }
        Profile::Jitter { mean } => s.iter().map(|_| d + mean * random.exponential()).collect(),
        Profile::Spikes { count } => {
            let mut late = vec![d; s.len()];
            for _ in 0..count {
                let k = random.below(s.len());
                late[k] = d + random.uniform(0.3, 1.0);
            }
            late
        }
    }
}

/// A flight of the given case.
pub fn fly(case: &Case, seed: u64) -> Flight {
    let mut random = Random::new(seed);
    let end = case.duration;
    let n = ((end + 5.0 - BEGIN_S) / DT) as usize;
    let v = velocity(case.path, n, &mut random);
    let mut place = vec![[0.0; 2]];
    for w in v.windows(2) {
        let p = place[place.len() - 1];
        place.push([0, 1].map(|a| p[a] + 0.5 * (w[0][a] + w[1][a]) * DT));
    }
    let at = |x: &[[f64; 2]], t: f64| -> [f64; 2] {
        let u = ((t - BEGIN_S) / DT).clamp(0.0, (n - 2) as f64);
        let (k, share) = (u as usize, u - u.floor());
        [0, 1].map(|a| x[k][a] + share * (x[k + 1][a] - x[k][a]))
    };
    let first = 0.37 / case.rates[0] - 1.0 - 13.0;
    let s: Vec<f64> = (0..).map(|k| first + f64::from(k) / case.rates[0]).take_while(|s| *s < end).collect();
    let late = lateness(case, &s, &mut random);
    let mut flight = Flight {
        t: vec![],
        north: vec![],
        east: vec![],
        velocity_t: vec![],
        velocity_north: vec![],
        velocity_east: vec![],
        late: vec![],
    };
    let mut noise = [0.0; 2].map(|_: f64| case.noise[0] * random.normal());
    let decay = (-1.0 / (case.rates[0] * case.noise[1])).exp();
    let mut arrival = f64::MIN;
    let tails = StudentT::new(3.0).unwrap();
    for (s, late) in s.iter().zip(&late) {
        arrival = (s + late).max(arrival + 1e-9);
        let white = [0, 1].map(|_| if case.heavy_tails { random.0.sample(tails) / 1.3 } else { random.normal() });
        for wander in &mut noise {
            *wander = decay * *wander + case.noise[0] * (1.0 - decay * decay).sqrt() * random.normal();
        }
        if arrival <= 0.5 || arrival >= end || *s < BEGIN_S {
            continue;
        }
        let (p, vel) = (at(&place, *s), at(&v, *s));
        let speed = vel[0].hypot(vel[1]).max(0.5);
        let y = |a: usize| {
            let scale = if a == 1 { case.east_noise } else { 1.0 };
            p[a] + case.lever * vel[a] / speed + scale * (noise[a] + case.noise[2] * white[a])
        };
        flight.t.push(arrival);
        flight.north.push(y(0));
        flight.east.push(y(1));
        flight.late.push(arrival - s);
    }
    let bias = [0.0; 2].map(|_: f64| 0.03 * random.normal());
    let count = ((end + 3.0 + 18.0) * case.rates[1]) as usize;
    for k in 0..count {
        let t = -18.0 + k as f64 / case.rates[1];
        let vel = at(&v, t);
        flight.velocity_t.push(t);
        let mut measured = |a: usize| case.velocity_scale * vel[a] + case.velocity_noise * random.normal() + bias[a];
        flight.velocity_north.push(measured(0));
        flight.velocity_east.push(measured(1));
    }
    flight
}

/// The positions of a flight with later timestamps: by `by` from the instant at which `share` of the record is over.
pub fn inject_step(flight: &Flight, by: f64, share: f64) -> Vec<f64> {
    let (first, last) = (flight.t[0], flight.t[flight.t.len() - 1]);
    let at = first + share * (last - first);
    flight.t.iter().map(|t| if *t < at { *t } else { t + by }).collect()
}
