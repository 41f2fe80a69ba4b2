//! The acceptance table of `delay-over-time.md`, from simulated flights:
//! `nice -n 15 cargo run --release -p flightlag-delay-over-time --example over_time_study [flights per case] [part of a case's name]`

#![allow(clippy::print_stdout, clippy::indexing_slicing, clippy::unwrap_used)]

#[path = "../tests/support/mod.rs"]
mod support;

use record::{DelayKind, DelayOverTime};
use std::collections::BTreeMap;
use std::time::Instant;
use support::{Case, Flight, Path, Profile, ROUGH, Random, TURNING, fly};

struct Run {
    flight: Flight,
    found: DelayOverTime,
}

struct Study {
    flights: usize,
    filter: String,
    seed: u64,
}

impl Study {
    fn case(&mut self, name: &str, case: impl Fn(&mut Random) -> Case, report: impl Fn(&[Run]) -> String) {
        self.seed += 10_000;
        if !name.contains(&self.filter) {
            return;
        }
        let mut random = Random::new(self.seed);
        let mut seconds = 0.0;
        let runs: Vec<Run> = (0..self.flights)
            .map(|k| {
                let flight = fly(&case(&mut random), self.seed + k as u64);
                let start = Instant::now();
                let found = flight.analyse();
                seconds += start.elapsed().as_secs_f64();
                Run { flight, found }
            })
            .collect();
        let mut kinds: BTreeMap<&str, usize> = BTreeMap::new();
        for r in &runs {
            *kinds.entry(r.found.kind.word()).or_default() += 1;
        }
        if std::env::var_os("OT_SHOW").is_some() {
            for r in &runs {
                show(r);
            }
        }
        let red = runs.iter().filter(|r| r.found.constancy.varies).count();
        let tested = runs.iter().filter(|r| r.found.constancy.tested).count();
        let mut x: Vec<f64> = runs.iter().filter_map(|r| r.found.constancy.detectable_s).collect();
        x.sort_by(f64::total_cmp);
        let middle = x.get(x.len() / 2).map_or(f64::NAN, |x| 1e3 * x);
        println!(
            "{name:34} n {:3} red {red:3} of {tested:3} tested, X {middle:4.0} ms, {:5.1} ms each; {} {kinds:?}",
            runs.len(),
            1e3 * seconds / runs.len() as f64,
            report(&runs)
        );
    }
}

fn show(r: &Run) {
    let c = &r.found.constancy;
    let b = c.difference_s;
    println!(
        "  {:?} n {} W {:.1} p {:.1e} b {:?} d {} om {:?} X {:?} loo {:?}; {} {:?}",
        r.found.kind,
        c.windows,
        c.window_s,
        c.p.unwrap_or(f64::NAN),
        b.map(|b| (b.value, b.standard_uncertainty)),
        c.limit_s,
        c.scatter_s,
        c.detectable_s,
        c.left_out_window_s,
        r.found.words,
        r.found.terms
    );
}

/// Root mean square of curve less truth at the fixes, without bursts; also more than 4 s from a flush.
fn curve_rms(r: &Run) -> f64 {
    let (t, d): (Vec<f64>, Vec<f64>) = r.found.curve.iter().map(|p| (p.t_s, p.delay_s)).unzip();
    let mut sum = (0.0, 0.0);
    for k in 1..r.flight.t.len() {
        let next = r.flight.t.get(k + 1).map_or(1.0, |n| n - r.flight.t[k]);
        if (r.flight.t[k] - r.flight.t[k - 1]).min(next) < 0.02 {
            continue;
        }
        let at = r.flight.t[k];
        let i = t.partition_point(|x| *x <= at).clamp(1, t.len() - 1);
        let curve = d[i - 1] + (d[i] - d[i - 1]) * ((at - t[i - 1]) / (t[i] - t[i - 1])).clamp(0.0, 1.0);
        sum = (sum.0 + (curve - r.flight.late[k]).powi(2), sum.1 + 1.0);
    }
    (sum.0 / sum.1).sqrt()
}

fn share(runs: &[Run], of: impl Fn(&Run) -> bool) -> String {
    format!("{}/{}", runs.iter().filter(|r| of(r)).count(), runs.len())
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Error over uncertainty, and coverage of 95 % intervals.
fn level(runs: &[Run], truth: f64) -> String {
    let z: Vec<f64> = runs
        .iter()
        .filter_map(|r| {
            Some(
                (r.found.level_s.value - truth) / r.found.level_s.standard_uncertainty?.hypot(r.found.level_widening_s),
            )
        })
        .collect();
    let rms = (z.iter().map(|z| z * z).sum::<f64>() / z.len() as f64).sqrt();
    let held = z.iter().filter(|z| z.abs() < 1.96).count();
    let bias = runs.iter().map(|r| r.found.level_s.value - truth).sum::<f64>() / runs.len() as f64;
    format!("level z rms {rms:.2}, held {held}/{}, bias {:.1} ms", z.len(), 1e3 * bias)
}

fn mean_level(runs: &[Run]) -> String {
    let mean = |r: &Run| r.flight.late.iter().sum::<f64>() / r.flight.late.len() as f64;
    let bias = runs.iter().map(|r| r.found.level_s.value - mean(r)).sum::<f64>() / runs.len() as f64;
    format!("level less mean lateness {:.1} ms", 1e3 * bias)
}

fn steps(runs: &[Run], at: f64, by: f64) -> String {
    let single = runs.iter().filter(|r| r.found.terms.len() == 1).count();
    let first: Vec<_> = runs.iter().filter_map(|r| r.found.terms.first()).collect();
    let near = first.iter().filter(|t| (t.at_s - at).abs() <= 1.0).count();
    let covers = first.iter().filter(|t| t.at_interval_s.is_some_and(|i| i[0] <= at && i[1] >= at)).count();
    let size = first.iter().filter(|t| (t.size - by).abs() <= 0.02).count();
    format!("single {single}, |t| <= 1 s {near}, interval covers {covers}, size within 20 ms {size} of {}", first.len())
}

fn constant_cases(study: &mut Study) {
    for path in TURNING {
        study.case(&format!("constant {path:?} gps"), |_| Case::gps(path, Profile::Constant), |r| level(r, 0.2));
    }
    for path in TURNING {
        study.case(&format!("constant {path:?} rtk"), |_| Case::rtk(path, Profile::Constant), |r| level(r, 0.2));
    }
    for path in TURNING {
        let rough = |_: &mut Random| Case { noise: ROUGH, rates: [1.0, 25.0], ..Case::gps(path, Profile::Constant) };
        study.case(&format!("constant {path:?} rough 1 Hz"), rough, |r| level(r, 0.2));
    }
    for path in TURNING {
        let far =
            |random: &mut Random| Case { delay: random.uniform(-2.0, 12.0), ..Case::gps(path, Profile::Constant) };
        study.case(&format!("constant far {path:?}"), far, |runs| {
            let truth = |r: &Run| median(r.flight.late.clone());
            let near = share(runs, |r| (r.found.level_s.value - truth(r)).abs() < 0.1);
            let worst = runs.iter().map(|r| (r.found.level_s.value - truth(r)).abs()).fold(0.0, f64::max);
            format!("within 0.1 s {near}, worst {worst:.3} s, edge {}", share(runs, |r| r.found.edge_hit))
        });
    }
    let on_time = |_: &mut Random| Case { delay: 0.0, ..Case::gps(Path::Circuits, Profile::Constant) };
    study.case("on time Circuits", on_time, |r| level(r, 0.0));
    let early = |_: &mut Random| Case { delay: -0.2, ..Case::gps(Path::Circuits, Profile::Constant) };
    study.case("early Circuits", early, |r| level(r, -0.2));
    type Change = fn(Case) -> Case;
    let robust: [(&str, Change); 5] = [
        ("noise east x 3", |c| Case { east_noise: 3.0, ..c }),
        ("velocity scale 0.5 %", |c| Case { velocity_scale: 1.005, ..c }),
        ("t3 noise", |c| Case { heavy_tails: true, ..c }),
        ("wander 3 m / 300 s", |c| Case { noise: [3.0, 300.0, 0.3], ..c }),
        ("lever 1 m", |c| Case { lever: 1.0, ..c }),
    ];
    for (name, change) in robust {
        for path in [Path::Circuits, Path::Survey, Path::Hover] {
            let case = |_: &mut Random| change(Case::gps(path, Profile::Constant));
            study.case(&format!("robust {name} {path:?}"), case, |r| level(r, 0.2));
        }
    }
}

fn changing_cases(study: &mut Study) {
    for path in TURNING {
        let name = format!("step 150 {path:?}");
        study.case(&name, |_| Case::gps(path, Profile::Step { by: 0.15 }), |r| steps(r, 120.2, 0.15));
    }
    for path in [Path::Circuits, Path::Survey] {
        let name = format!("step 60 {path:?}");
        study.case(&name, |_| Case::gps(path, Profile::Step { by: 0.06 }), |r| steps(r, 120.23, 0.06));
    }
    let rms = |runs: &[Run]| {
        let all: Vec<f64> = runs.iter().filter(|r| r.found.constancy.varies).map(curve_rms).collect();
        let worst = all.iter().copied().fold(0.0, f64::max);
        format!("curve rms median {:.3} s, worst {worst:.3} s", median(all))
    };
    for path in [Path::Circuits, Path::Survey] {
        study.case(&format!("ramp 0.3 {path:?}"), |_| Case::gps(path, Profile::Ramp { by: 0.3 }), rms);
    }
    for path in [Path::Circuits, Path::Survey, Path::Hover] {
        study.case(&format!("build-up 2.5 {path:?}"), |_| Case::gps(path, Profile::BuildUp { top: 2.5 }), rms);
    }
    for path in [Path::Circuits, Path::Survey, Path::Hover] {
        let saw = Profile::Sawtooth { top: 0.6, period: 40.0 };
        study.case(&format!("sawtooth {path:?}"), |_| Case::gps(path, saw), rms);
    }
    let two = Profile::Two { by: 0.2, dwell: 60.0 };
    study.case("two-state 60 s Circuits", |_| Case::gps(Path::Circuits, two), rms);
}

fn other_cases(study: &mut Study) {
    for path in [Path::Circuits, Path::Survey, Path::Hover] {
        study.case(
            &format!("jitter {path:?}"),
            |_| Case::gps(path, Profile::Jitter { mean: 0.08 }),
            |runs| {
                let s: Vec<f64> = runs.iter().filter_map(|r| r.found.jitters.map(|j| j.standard_deviation_s)).collect();
                format!("jitters {}/{}, s_j median {:.3}; {}", s.len(), runs.len(), median(s), mean_level(runs))
            },
        );
    }
    study.case(
        "spikes Circuits",
        |_| Case::gps(Path::Circuits, Profile::Spikes { count: 5 }),
        |runs| format!("late fixes {}; {}", share(runs, |r| !r.found.late_fixes.is_empty()), level(runs, 0.2)),
    );
    study.case("straight", |_| Case::gps(Path::Straight, Profile::Constant), |_| String::new());
    study.case(
        "straight build-up",
        |_| Case::gps(Path::Straight, Profile::BuildUp { top: 2.5 }),
        |runs| format!("but it changes {}", share(runs, |r| r.found.words.contains("But the delay changes"))),
    );
    study.case(
        "skew 10 ppm rtk Circuits",
        |_| Case::rtk(Path::Circuits, Profile::Skew { rate: 1e-5 }),
        |runs| format!("said {}", share(runs, |r| r.found.remarks.iter().any(|x| x.contains("ppm")))),
    );
    let lever = |runs: &[Run]| {
        let l: Vec<f64> = runs.iter().filter_map(|r| r.found.lever_arm_m.map(|l| l.value)).collect();
        format!("lever said {}/{}, median {:.2} m; {}", l.len(), runs.len(), median(l), level(runs, 0.2))
    };
    study.case(
        "lever 1 m VarSpeed rtk",
        |_| Case { lever: 1.0, ..Case::rtk(Path::VarSpeed, Profile::Constant) },
        lever,
    );
    let both = |_: &mut Random| Case { lever: 1.0, ..Case::rtk(Path::VarSpeed, Profile::Step { by: 0.15 }) };
    study.case("lever 1 m + step VarSpeed rtk", both, lever);
}

fn speed_cases(study: &mut Study) {
    let ten =
        |_: &mut Random| Case { duration: 600.0, rates: [10.0, 50.0], ..Case::gps(Path::Circuits, Profile::Constant) };
    study.case("speed 600 s 10/50 Hz", ten, |r| level(r, 0.2));
    let one =
        |_: &mut Random| Case { duration: 60.0, rates: [10.0, 50.0], ..Case::gps(Path::Circuits, Profile::Constant) };
    study.case("speed 60 s 10/50 Hz", one, |r| level(r, 0.2));
    let hours =
        |_: &mut Random| Case { duration: 7200.0, rates: [10.0, 50.0], ..Case::gps(Path::Circuits, Profile::Constant) };
    study.case("speed 2 h 10/50 Hz", hours, |r| level(r, 0.2));
    let steps = |_: &mut Random| Case {
        duration: 600.0,
        rates: [10.0, 50.0],
        ..Case::gps(Path::Circuits, Profile::Step { by: 0.15 })
    };
    study.case("speed 600 s step", steps, |_| String::new());
    let saw = |_: &mut Random| {
        let saw = Profile::Sawtooth { top: 0.6, period: 40.0 };
        Case { duration: 600.0, rates: [10.0, 50.0], ..Case::gps(Path::Circuits, saw) }
    };
    study.case("speed 600 s sawtooth", saw, |_| String::new());
}

fn main() {
    let mut arguments = std::env::args().skip(1);
    let flights = arguments.next().and_then(|n| n.parse().ok()).unwrap_or(40);
    let mut study = Study { flights, filter: arguments.next().unwrap_or_default(), seed: 1 };
    speed_cases(&mut study);
    constant_cases(&mut study);
    changing_cases(&mut study);
    other_cases(&mut study);
    let _ = DelayKind::Constant;
}
