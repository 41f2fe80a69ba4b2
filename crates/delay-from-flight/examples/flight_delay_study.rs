//! Accuracy of the delay from a flight: many simulated circuits with known delay, a line of figures per receiver kind.
//! `cargo run --release -p flightlag-delay-from-flight --example flight_delay_study -- [trials] [part of a case's name]`
#![allow(clippy::print_stdout, clippy::unwrap_used, reason = "an example's output is its print")]

use delay_from_flight::{FlightDelaySettings, measure_delays};
use flight::{Channel, ChannelSource, Clock, Flight, Quantity, Series, StampKind, Timeline};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use record::{Finding, MeasuredDelay};
use simulate::{FlightSettings, PathKind, SensorSettings, SimulatedFlight, Wander, simulate};

const DELAY_S: f64 = 0.4;

struct Case {
    name: &'static str,
    duration_s: f64,
    position_hz: f64,
    white_m: f64,
    wander: Option<Wander>,
    velocity_hz: f64,
    velocity_mps: f64,
    /// Scatter of the velocity's timestamps, s.
    jitter_s: f64,
    lost: f64,
}

fn cases() -> Vec<Case> {
    let wander = |std: f64, time_constant_s: f64| Some(Wander { std, time_constant_s });
    let case = |name, duration_s, position_hz, white_m, wander, velocity_hz, velocity_mps| Case {
        name,
        duration_s,
        position_hz,
        white_m,
        wander,
        velocity_hz,
        velocity_mps,
        jitter_s: 0.0,
        lost: 0.0,
    };
    vec![
        case("GPS 4 Hz .3 m + wander 1.5 m/60 s, v 10 Hz .1", 60.0, 4.0, 0.3, wander(1.5, 60.0), 10.0, 0.1),
        case("INS 25 Hz .02 m + wander .5 m/20 s, v 50 Hz .05", 60.0, 25.0, 0.02, wander(0.5, 20.0), 50.0, 0.05),
        case("RTK 10 Hz .02 m, v 10 Hz .05 (like D)", 60.0, 10.0, 0.02, None, 10.0, 0.05),
        case("like B: 100 Hz .1 m, v 100 Hz .1", 60.0, 100.0, 0.1, None, 100.0, 0.1),
        case("like C: 4 Hz 1 m, v 100 Hz .1", 180.0, 4.0, 1.0, None, 100.0, 0.1),
        case("like F: 4 Hz .3 m, v 4 Hz .1", 180.0, 4.0, 0.3, None, 4.0, 0.1),
        case("poor velocity: 5 Hz .1 m, v 5 Hz .5", 120.0, 5.0, 0.1, None, 5.0, 0.5),
        Case {
            jitter_s: 0.01,
            lost: 0.1,
            ..case("GPS 5 Hz .5 m + wander 1 m/30 s, 10 % lost", 120.0, 5.0, 0.5, wander(1.0, 30.0), 10.0, 0.1)
        },
        case("walk: 10 Hz .5 m, v 10 Hz .1", 60.0, 10.0, 0.5, None, 10.0, 0.1),
        case("walk: 10 Hz .5 m, v 10 Hz .25", 60.0, 10.0, 0.5, None, 10.0, 0.25),
        case("walk: 10 Hz 1 m, v 10 Hz .1", 60.0, 10.0, 1.0, None, 10.0, 0.1),
        case("walk: 10 Hz 1 m, v 10 Hz .25, 2 min", 120.0, 10.0, 1.0, None, 10.0, 0.25),
        case("walk: 10 Hz 2 m, v 10 Hz .25, 30 s", 30.0, 10.0, 2.0, None, 10.0, 0.25),
        case("walk: 10 Hz .2 m, v 10 Hz .25", 60.0, 10.0, 0.2, None, 10.0, 0.25),
        case("short: 5 Hz .3 m, 30 s", 30.0, 5.0, 0.3, None, 10.0, 0.1),
    ]
}

impl Case {
    fn settings(&self, seed: u64) -> FlightSettings {
        FlightSettings {
            path: PathKind::Circuit,
            duration_s: self.duration_s,
            seed,
            position: SensorSettings {
                delay_s: DELAY_S,
                white_std: self.white_m,
                wander: self.wander,
                drop_share: self.lost,
                ..SensorSettings::clean(self.position_hz)
            },
            velocity: SensorSettings {
                white_std: self.velocity_mps,
                bias: [0.05, -0.03, 0.0],
                stamp_jitter_s: self.jitter_s,
                drop_share: self.lost,
                ..SensorSettings::clean(self.velocity_hz)
            },
            truth_rate_hz: Some(1.0),
            ..FlightSettings::default()
        }
    }
}

/// Bound for the delay of one case: the position's noise, and the random walk from the velocity's noise.
enum Bound {
    /// Covariance of all samples.
    Dense(Cholesky<f64, Dyn>),
    /// White and walk: a wander of a very long time constant.
    Walk(signal::NoiseModel),
}

impl Bound {
    fn of(case: &Case) -> Bound {
        let q = case.velocity_mps.powi(2) / case.velocity_hz;
        let long_s = 1e5;
        let walk = signal::NoiseModel {
            wander_std: (0.5 * q * long_s).sqrt(),
            time_constant_s: long_s,
            white_std: case.white_m,
        };
        let Some(w) = case.wander else { return Bound::Walk(walk) };
        let n = ((case.duration_s - 1.0) * case.position_hz) as usize;
        let t = |k: usize| k as f64 / case.position_hz;
        let covariance = DMatrix::from_fn(n, n, |i, j| {
            let apart = (t(i) - t(j)).abs();
            let white = if i == j { case.white_m.powi(2) } else { 0.0 };
            w.std.powi(2) * (-apart / w.time_constant_s).exp() + q * t(i.min(j)) + white
        });
        Bound::Dense(covariance.cholesky().unwrap())
    }

    /// Standard deviation of the best unbiased delay for this flight's path, s.
    fn sigma(&self, case: &Case, flight: &SimulatedFlight) -> f64 {
        let n = ((case.duration_s - 1.0) * case.position_hz) as usize;
        let t: Vec<f64> = (0..n).map(|k| 0.5 + DELAY_S + k as f64 / case.position_hz).collect();
        let information: f64 = (0..2)
            .map(|axis| {
                let mut columns = [
                    vec![1.0; n],
                    t.iter().map(|t| t - 0.5 * case.duration_s).collect(),
                    t.iter().map(|t| flight.truth.at(t - DELAY_S).velocity[axis]).collect::<Vec<f64>>(),
                ];
                match self {
                    Bound::Walk(noise) => {
                        let [a, b, c] = &mut columns;
                        signal::whiten(&t, &mut [a, b, c], noise);
                    }
                    Bound::Dense(factor) => columns.iter_mut().for_each(|c| {
                        let whitened = factor.l_dirty().solve_lower_triangular(&DVector::from_vec(c.clone())).unwrap();
                        c.copy_from_slice(whitened.as_slice());
                    }),
                }
                unexplained_squares(&columns)
            })
            .sum();
        // Lost samples reduce the information.
        (information * (1.0 - case.lost)).powf(-0.5)
    }
}

/// Sum of squares of the last column after regression on the previous ones.
fn unexplained_squares(columns: &[Vec<f64>; 3]) -> f64 {
    let [a, b, c] = columns.clone();
    let dot = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>();
    let less = |x: &[f64], q: &[f64]| -> Vec<f64> {
        let share = dot(x, q) / dot(q, q);
        x.iter().zip(q).map(|(x, q)| x - share * q).collect()
    };
    let b = less(&b, &a);
    let c = less(&less(&c, &a), &b);
    dot(&c, &c)
}

#[derive(Default)]
struct Tally {
    trials: usize,
    refused: usize,
    errors: Vec<f64>,
    bounds: Vec<f64>,
    covered: usize,
    uncertainties: Vec<f64>,
    injected: usize,
    injections: usize,
    split_p_below_5: usize,
    splits: usize,
    windows_p_below_5: usize,
    alarms: usize,
    windows: usize,
}

impl Tally {
    fn add(&mut self, truth_s: f64, d: &MeasuredDelay) {
        self.errors.push(d.delay_s.value - truth_s);
        self.uncertainties.push(d.delay_s.standard_uncertainty.unwrap());
        self.covered += usize::from(d.interval_95_s[0] <= truth_s && truth_s <= d.interval_95_s[1]);
        for i in &d.injections {
            self.injections += 1;
            self.injected += usize::from(i.interval_95_s[0] <= 0.0 && 0.0 <= i.interval_95_s[1]);
        }
        for p in d.splits.iter().filter_map(|s| s.p) {
            self.splits += 1;
            self.split_p_below_5 += usize::from(p < 0.05);
        }
        if let Some(h) = &d.homogeneity {
            self.windows += 1;
            self.windows_p_below_5 += usize::from(h.p < 0.05);
            self.alarms += usize::from(d.alarm.is_some());
        }
    }

    fn rms(x: &[f64]) -> f64 {
        (x.iter().map(|x| x * x).sum::<f64>() / x.len().max(1) as f64).sqrt()
    }

    fn line(&self, name: &str) {
        let bound = Tally::rms(&self.bounds);
        let rms = Tally::rms(&self.errors);
        let mean = self.errors.iter().sum::<f64>() / self.errors.len().max(1) as f64;
        let percent = |a: usize, b: usize| 100.0 * a as f64 / b.max(1) as f64;
        println!(
            "| {name} | {:.3} | {:.3} | {:.2} | {:+.3} | {:.2} | {:.1} | {:.1} | {:.1} | {:.1} | {:.1} | {} |",
            1e3 * bound,
            1e3 * rms,
            rms / bound,
            1e3 * mean,
            Tally::rms(&self.uncertainties) / rms,
            percent(self.covered, self.errors.len()),
            percent(self.injected, self.injections),
            percent(self.split_p_below_5, self.splits),
            percent(self.windows_p_below_5, self.windows),
            percent(self.alarms, self.windows),
            self.refused
        );
    }
}

fn found(flight: &Flight, settings: &FlightDelaySettings) -> Option<MeasuredDelay> {
    let (mut delays, _) = measure_delays(flight, settings);
    match delays.pairs.pop()?.delay {
        Finding::Found(delay) => Some(delay),
        Finding::CannotTell(_) => None,
    }
}

fn circuits(trials: usize, part: &str) {
    println!(
        "| case | bound ms | rms ms | rms/bound | bias ms | u/rms | 95 % covers | injected covers | speed p<5 % | windows p<5 % | alarms % | refused |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|---|");
    for case in cases().iter().filter(|c| c.name.contains(part)) {
        let bound = Bound::of(case);
        let mut tally = Tally { trials, ..Tally::default() };
        for seed in 0..tally.trials as u64 {
            let flown = simulate(&case.settings(1000 + seed)).unwrap();
            let mut flight = flown.to_flight().unwrap();
            flight.channels.remove("position.truth");
            tally.bounds.push(bound.sigma(case, &flown));
            match found(&flight, &FlightDelaySettings::default()) {
                Some(delay) => tally.add(DELAY_S, &delay),
                None => tally.refused += 1,
            }
        }
        tally.line(case.name);
    }
}

/// Cases that must not be measured: share refused, and the largest delay claimed.
fn straight(trials: usize) {
    for (name, path) in [
        ("straight, 17.5 m/s", PathKind::Straight { speed_mps: 17.5, heading_rad: 0.7 }),
        ("standing still", PathKind::Still),
    ] {
        let case = &cases()[0];
        let refused = (0..trials as u64)
            .filter(|seed| {
                let flown = simulate(&FlightSettings { path, ..case.settings(*seed) }).unwrap();
                let mut flight = flown.to_flight().unwrap();
                flight.channels.remove("position.truth");
                found(&flight, &FlightDelaySettings::default()).is_none()
            })
            .count();
        println!("{name}: refused {refused} of {trials}");
    }
}

/// A flight with a velocity at 5 Hz that is late by 0.12 s and accelerometers at 50 Hz with another phase.
fn with_accelerometers(seed: u64) -> (Flight, SimulatedFlight) {
    let settings = FlightSettings {
        duration_s: 60.0,
        seed,
        position: SensorSettings::clean(5.0),
        velocity: SensorSettings { delay_s: 0.12, white_std: 0.1, ..SensorSettings::clean(5.0) },
        truth_rate_hz: Some(1.0),
        ..FlightSettings::default()
    };
    let flown = simulate(&settings).unwrap();
    let mut flight = flown.to_flight().unwrap();
    flight.channels.retain(|name, _| name == "velocity.gps");
    let mut rng = Pcg64::seed_from_u64(seed ^ 0x5eed);
    let phase: f64 = 0.02 * rng.random::<f64>();
    let t: Vec<f64> = (0..2990).map(|k| phase + 0.02 * f64::from(k)).collect();
    let (mut attitude, mut force) = ([(); 4].map(|()| vec![]), [(); 3].map(|()| vec![]));
    for t in &t {
        let at = |h: f64| flown.truth.at(t + h).velocity;
        let a: [f64; 3] = std::array::from_fn(|k| (at(5e-4)[k] - at(-5e-4)[k]) / 1e-3);
        let v = at(0.0);
        let heading = v[1].atan2(v[0]);
        let (sin, cos) = heading.sin_cos();
        let mut normal = |std: f64| -> f64 {
            let z: f64 = StandardNormal.sample(&mut rng);
            std * z
        };
        let (n, e, d) = (a[0] + 0.1 + normal(0.3), a[1] - 0.08 + normal(0.3), a[2] - 9.81 + normal(0.3));
        for (column, x) in force.iter_mut().zip([cos * n + sin * e, -sin * n + cos * e, d]) {
            column.push(x);
        }
        for (column, x) in attitude.iter_mut().zip([(0.5 * heading).cos(), 0.0, 0.0, (0.5 * heading).sin()]) {
            column.push(x);
        }
    }
    let channel = |quantity: Quantity, columns: Vec<Vec<f64>>| {
        let stamps = t.iter().map(|t| settings.start.plus_seconds(*t)).collect();
        let timeline = Timeline::new(StampKind::Measured, Clock::Unix, stamps).unwrap();
        Channel {
            quantity,
            present: vec![true; columns.len()],
            held: vec![false; t.len()],
            series: Series::new(timeline, columns).unwrap(),
            other_stamps: vec![],
            source: ChannelSource { topic: "study".into(), type_name: String::new(), fields: vec![] },
        }
    };
    flight.channels.insert("attitude.sim".into(), channel(Quantity::Attitude, attitude.to_vec()));
    flight.channels.insert("specific-force.sim".into(), channel(Quantity::SpecificForce, force.to_vec()));
    (flight, flown)
}

/// Today's practice (as described in the design note, 4.1): differences of velocity between fixes against summed
/// acceleration, shifted by whole samples of the accelerometer. The shift with the least mean absolute difference wins.
fn integer_shift(flight: &Flight) -> f64 {
    let velocity = &flight.channels["velocity.gps"];
    let (attitude, force) = (&flight.channels["attitude.sim"], &flight.channels["specific-force.sim"]);
    let origin = force.series.timeline().first().unwrap();
    let (tv, ta) = (velocity.series.timeline().seconds_since(origin), force.series.timeline().seconds_since(origin));
    let step = (ta[ta.len() - 1] - ta[0]) / (ta.len() - 1) as f64;
    let mut sums = [vec![0.0], vec![0.0]];
    for k in 0..ta.len() {
        let heading = 2.0 * attitude.series.component(3)[k].atan2(attitude.series.component(0)[k]);
        let (sin, cos) = heading.sin_cos();
        let (x, y) = (force.series.component(0)[k], force.series.component(1)[k]);
        for (sum, a) in sums.iter_mut().zip([cos * x - sin * y, sin * x + cos * y]) {
            sum.push(sum[sum.len() - 1] + a * step);
        }
    }
    let samples = |t: f64| ta.partition_point(|x| *x <= t) as i64;
    let misfit = |shift: i64| {
        let (mut sum, mut count) = (0.0, 0.0);
        for k in 1..tv.len() {
            let (from, to) = (samples(tv[k - 1]) - shift, samples(tv[k]) - shift);
            if from < 0 || to as usize >= sums[0].len() || to <= from {
                continue;
            }
            let scale = (tv[k] - tv[k - 1]) / ((to - from) as f64 * step);
            for (axis, gained) in sums.iter().enumerate() {
                let v = velocity.series.component(axis);
                sum += (v[k] - v[k - 1] - (gained[to as usize] - gained[from as usize]) * scale).abs();
                count += 1.0;
            }
        }
        sum / count
    };
    let best = (0..100).min_by(|a, b| misfit(*a).total_cmp(&misfit(*b))).unwrap();
    best as f64 * step
}

fn against_practice(trials: usize) {
    let (mut ours, mut theirs) = (Tally::default(), vec![]);
    for seed in 0..trials as u64 {
        let (flight, _) = with_accelerometers(seed);
        theirs.push(integer_shift(&flight) - 0.12);
        match found(&flight, &FlightDelaySettings::default()) {
            Some(delay) => ours.add(0.12, &delay),
            None => ours.refused += 1,
        }
    }
    println!("| velocity against acceleration, same data | rms error ms | bias ms | 95 % covers |");
    println!("|---|---|---|---|");
    let mean = |x: &[f64]| 1e3 * x.iter().sum::<f64>() / x.len() as f64;
    println!(
        "| integer shifts, mean absolute difference | {:.2} | {:+.2} | no interval |",
        1e3 * Tally::rms(&theirs),
        mean(&theirs)
    );
    println!(
        "| this estimator | {:.2} | {:+.2} | {:.1} % ({} refused) |",
        1e3 * Tally::rms(&ours.errors),
        mean(&ours.errors),
        100.0 * ours.covered as f64 / ours.errors.len().max(1) as f64,
        ours.refused
    );
    println!("ratio of rms errors: {:.1}", Tally::rms(&theirs) / Tally::rms(&ours.errors));
}

/// Run time for one hour at 10 Hz position and 100 Hz velocity.
fn hour() {
    let case = Case { duration_s: 3600.0, position_hz: 10.0, velocity_hz: 100.0, ..cases().remove(0) };
    let flown = simulate(&case.settings(5)).unwrap();
    let mut flight = flown.to_flight().unwrap();
    flight.channels.remove("position.truth");
    let start = std::time::Instant::now();
    let delay = found(&flight, &FlightDelaySettings::default()).unwrap();
    println!(
        "one hour, position 10 Hz, velocity 100 Hz: {:.2} s for {:.2} ± {:.2} ms",
        start.elapsed().as_secs_f64(),
        1e3 * delay.delay_s.value,
        1.96e3 * delay.delay_s.standard_uncertainty.unwrap()
    );
}

fn main() {
    let mut arguments = std::env::args().skip(1);
    let trials = arguments.next().and_then(|a| a.parse().ok()).unwrap_or(200);
    let part = arguments.next().unwrap_or_default();
    hour();
    circuits(trials, &part);
    if part.is_empty() {
        straight(trials.min(50));
        against_practice(trials);
    }
}
