//! No detections on unmodified real flights, and what is found of injected changes:
//! `cargo run --release -p flightlag-delay-over-time --example real_flights FOLDER [LONGEST_PIECE_S]`. The folder holds
//! one folder per log, written by `flightlag export LOG --to csv --out FOLDER/NAME`. Only the timestamps of positions
//! are changed. A piece of 0 s uses whole flights, injects nothing and prints the cost of each.

#![allow(clippy::print_stdout, clippy::indexing_slicing, clippy::unwrap_used)]

use delay_over_time::{OverTimeSettings, PositionAgainstVelocity, analyse};
use record::DelayOverTime;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Longest piece of a flight unless another length is given, s.
const PIECE_S: f64 = 600.0;

#[derive(Clone, Default)]
struct Series {
    t: Vec<f64>,
    north: Vec<f64>,
    east: Vec<f64>,
}

#[derive(Clone, Copy)]
enum Change {
    None,
    Step(f64),
    Drift(f64),
    BuildUp(f64),
}

fn read(path: &Path, epoch_ns: &mut Option<i128>) -> Option<Series> {
    let text = fs::read_to_string(path).ok()?;
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next()?.split(',').collect();
    let column = |prefix: &str| header.iter().position(|h| h.starts_with(prefix));
    let (a, b, geodetic) = match (column("latitude"), column("longitude"), column("north"), column("east")) {
        (Some(a), Some(b), ..) => (a, b, true),
        (.., Some(a), Some(b)) => (a, b, false),
        _ => return None,
    };
    let held = column("held");
    let mut out = Series::default();
    let mut origin = None;
    for line in lines {
        let cells: Vec<&str> = line.split(',').collect();
        if held.is_some_and(|h| cells.get(h).is_some_and(|c| *c == "true" || *c == "1")) {
            continue;
        }
        let ns: i128 = cells.first()?.parse().ok()?;
        let t = (ns - *epoch_ns.get_or_insert(ns)) as f64 * 1e-9;
        let (Some(Ok(x)), Some(Ok(y))) =
            (cells.get(a).map(|c| c.parse::<f64>()), cells.get(b).map(|c| c.parse::<f64>()))
        else {
            continue;
        };
        if out.t.last().is_some_and(|l| t <= *l) || !(x.is_finite() && y.is_finite()) {
            continue;
        }
        let (x, y) = if geodetic {
            let (x0, y0): (f64, f64) = *origin.get_or_insert((x, y));
            let north = (x - x0).to_radians() * 6_371_000.0;
            (north, (y - y0).to_radians() * 6_378_137.0 * x0.to_radians().cos())
        } else {
            (x, y)
        };
        out.t.push(t);
        out.north.push(x);
        out.east.push(y);
    }
    (out.t.len() > 30).then_some(out)
}

/// Piece of a series.
fn cut(s: &Series, from: f64, to: f64) -> Series {
    let rows = s.t.partition_point(|t| *t < from)..s.t.partition_point(|t| *t <= to);
    Series { t: s.t[rows.clone()].to_vec(), north: s.north[rows.clone()].to_vec(), east: s.east[rows].to_vec() }
}

/// Instants by share of the motion: metres of velocity change while moving.
fn motion_times(v: &Series) -> impl Fn(f64) -> f64 {
    let n = v.t.len();
    let k = ((n as f64 / (v.t[n - 1] - v.t[0]).max(1.0)).round() as usize).clamp(1, n - 1);
    let speed: Vec<f64> = v.north.iter().zip(&v.east).map(|(n, e)| n.hypot(*e)).collect();
    let mut sorted = speed.clone();
    sorted.sort_by(f64::total_cmp);
    let slow = (0.1 * sorted[n * 95 / 100]).max(1.5);
    let mut sum = 0.0;
    let mut times = vec![];
    for i in k..n {
        if speed[i].min(speed[i - k]) > slow {
            sum += (v.north[i] - v.north[i - k]).hypot(v.east[i] - v.east[i - k]);
        }
        times.push((v.t[i], sum));
    }
    move |share: f64| times[times.partition_point(|x| x.1 < share * sum).min(times.len() - 1)].0
}

fn inject(p: &Series, v: &Series, change: Change) -> Series {
    let at = motion_times(v);
    let extra = |t: f64| match change {
        Change::None => 0.0,
        Change::Step(by) => {
            if t < at(0.5) {
                0.0
            } else {
                by
            }
        }
        Change::Drift(by) => by * ((t - at(0.02)) / (at(0.98) - at(0.02)).max(1.0)).clamp(0.0, 1.0),
        Change::BuildUp(by) => {
            let (t0, t1) = (at(0.25), at(0.7));
            if t > t0 && t < t1 { by * (t - t0) / (t1 - t0).max(1.0) } else { 0.0 }
        }
    };
    let mut out = p.clone();
    let mut last = f64::MIN;
    for t in &mut out.t {
        *t = (*t + extra(*t)).max(last + 1e-6);
        last = *t;
    }
    out
}

fn run(p: &Series, v: &Series) -> Option<DelayOverTime> {
    let record = PositionAgainstVelocity {
        t: &p.t,
        north: &p.north,
        east: &p.east,
        velocity_t: &v.t,
        velocity_north: &v.north,
        velocity_east: &v.east,
        breaks: &[],
    };
    analyse(&record, &OverTimeSettings::default()).ok()
}

fn line(name: &str, f: &DelayOverTime) {
    let c = &f.constancy;
    let b = c.difference_s.map_or((0.0, 0.0), |b| (1e3 * b.value, 1e3 * b.standard_uncertainty.unwrap_or(0.0)));
    println!(
        "{name:60} {:11} level {:6.0} ± {:4.0}; n {:2} X {:4.0} p {:.0e} b {:4.0} ± {:3.0} om {:4.0} loo {}; lag {:?} {}",
        f.kind.word(),
        1e3 * f.level_s.value,
        1e3 * f.level_s.standard_uncertainty.unwrap_or(9.0),
        c.windows,
        1e3 * c.detectable_s.unwrap_or(0.0),
        c.p.unwrap_or(1.0),
        b.0,
        b.1,
        1e3 * c.scatter_s.unwrap_or(0.0),
        c.left_out_window_s.is_some(),
        f.speed_after_direction_s.map(|s| (1e3 * s.value).round()),
        if f.constancy.varies { &f.words } else { "" },
    );
}

fn pairs(folder: &Path, piece_s: f64) -> Vec<(String, Series, Series)> {
    let mut files: Vec<PathBuf> = fs::read_dir(folder).into_iter().flatten().flatten().map(|f| f.path()).collect();
    files.sort();
    let mut epoch = None;
    let mut read_all = |what: &str| -> Vec<(String, Series)> {
        let name = |p: &PathBuf| p.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let of = |p: &PathBuf| Some((name(p).trim_end_matches(".csv").to_owned(), read(p, &mut epoch)?));
        files.iter().filter(|p| name(p).starts_with(what)).filter_map(of).collect()
    };
    let (positions, velocities) = (read_all("position."), read_all("velocity."));
    let mut out = vec![];
    for (p_name, p) in positions.iter().filter(|p| p.0.contains("gps")) {
        for (v_name, v) in &velocities {
            if v_name.contains("truth") {
                continue;
            }
            let at = motion_times(v);
            let middle = at(0.5);
            let (from, to) = (middle - 0.5 * piece_s, middle + 0.5 * piece_s);
            let (p, v) = (cut(p, from, to), cut(v, from - 15.0, to + 5.0));
            if p.t.len() > 30 && v.t.len() > 30 {
                out.push((format!("{p_name} | {v_name}"), p, v));
            }
        }
    }
    out
}

fn main() {
    let root = PathBuf::from(std::env::args().nth(1).unwrap_or_default());
    let piece_s = std::env::args().nth(2).and_then(|s| s.parse().ok()).unwrap_or(PIECE_S);
    let whole = piece_s == 0.0;
    let mut folders: Vec<PathBuf> = fs::read_dir(&root).into_iter().flatten().flatten().map(|f| f.path()).collect();
    folders.sort();
    let changes = [
        ("none", Change::None),
        ("step 150", Change::Step(0.15)),
        ("step −150", Change::Step(-0.15)),
        ("step 300", Change::Step(0.3)),
        ("step 100", Change::Step(0.1)),
        ("drift 200", Change::Drift(0.2)),
        ("build-up 1 s", Change::BuildUp(1.0)),
    ];
    let mut seen = std::collections::BTreeSet::new();
    let mut totals: BTreeMap<&str, [[usize; 2]; 5]> = BTreeMap::new();
    for folder in folders.iter().filter(|f| f.is_dir()) {
        for (name, p, v) in pairs(folder, if whole { f64::INFINITY } else { piece_s }) {
            let name = format!("{}/{name}", folder.file_name().unwrap().to_string_lossy());
            let sum = |x: &[f64]| x.iter().map(|x| x.to_bits()).fold(0u64, |h, x| h.rotate_left(5) ^ x);
            if !seen.insert((sum(&p.north), sum(&p.t), sum(&v.north))) {
                continue;
            }
            let from = Instant::now();
            let Some(clean) = run(&p, &v) else { continue };
            line(&name, &clean);
            if whole {
                let ms = 1e3 * from.elapsed().as_secs_f64();
                println!("   {} fixes, {} terms; {}\n{ms:9.1} ms {name}", p.t.len(), clean.terms.len(), clean.words);
                continue;
            }
            let at = motion_times(&v)(0.5);
            for (what, change) in changes {
                let found = if what == "none" { Some(clean.clone()) } else { run(&inject(&p, &v, change), &v) };
                let Some(found) = found.filter(|_| clean.constancy.tested) else { continue };
                let red = found.constancy.varies;
                let sharp = |f: &DelayOverTime| f.constancy.detectable_s.is_some_and(|x| x < 0.15);
                let sees =
                    |f: &DelayOverTime| f.constancy.detectable_between_s.is_some_and(|[a, b]| a <= at && at <= b);
                let total = totals.entry(what).or_default();
                let of =
                    [true, sharp(&clean), sharp(&clean) && sees(&clean), sharp(&found), sharp(&found) && sees(&found)];
                for (sum, _) in total.iter_mut().zip(of).filter(|x| x.1) {
                    sum[0] += 1;
                    sum[1] += usize::from(red);
                }
                if !red && what.contains("150") {
                    line(&format!("   missed {what}, in sight before {} after {}", sees(&clean), sees(&found)), &found);
                }
            }
        }
    }
    println!("found of those that are: tested; limit < 150 ms before the change; and in sight; after it; and in sight");
    for (what, of) in totals {
        let of: Vec<String> = of.iter().map(|[n, red]| format!("{red:3} of {n:3}")).collect();
        println!("{what:14} {}", of.join("; "));
    }
}
