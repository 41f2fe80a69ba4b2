//! Accuracy of the bench: many simulated records, each with a known answer.
//!
//! `cargo run --release -p flightlag-bench-analysis --example monte_carlo -- DIR [TRIALS]` prints the tables and writes
//! them as a page and as JSON. Every trial has its own seed, so that the result does not depend on the number of
//! threads.

#![allow(clippy::print_stdout, clippy::unwrap_used)]

mod delay;
mod lag;
mod noise;
mod reference;
mod swing;

use record::{Estimate, MonteCarloGroup, MonteCarloRecord, RECORD_VERSION};
use std::path::PathBuf;

/// Seed of the whole study.
pub const SEED: u64 = 20_101_025;

fn main() {
    let mut arguments = std::env::args().skip(1);
    let folder = PathBuf::from(arguments.next().unwrap_or_else(|| "reports/monte-carlo".to_owned()));
    let trials: u64 = arguments.next().map_or(1000, |text| text.parse().expect("TRIALS is a number"));
    let swings = swing::swings(50);
    let mut groups = vec![];
    let mut add = |group: MonteCarloGroup| {
        print(&group);
        groups.push(group);
    };
    add(reference::accuracy());
    add(delay::efficiency(&swings, trials));
    add(delay::misspecified(&swings, trials));
    add(delay::held(&swings, trials.min(200)));
    // The goal is known to one in a hundred: with a thousand trials 0.7 of it would be random.
    add(delay::decisions(&swings, 10 * trials));
    add(lag::choices(&swings, trials.min(100)));
    let record = MonteCarloRecord {
        record_version: RECORD_VERSION,
        title: "The bench, measured by simulation".to_owned(),
        seed: SEED,
        command: format!(
            "cargo run --release -p flightlag-bench-analysis --example monte_carlo -- {} {trials}",
            folder.display()
        ),
        groups,
    };
    let mut site = report::monte_carlo_site(&record);
    site.files.insert("record.json".to_owned(), serde_json::to_vec_pretty(&record).unwrap());
    for (path, bytes) in site.to_write() {
        let path = folder.join(path);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    }
    println!("\nopen {}", folder.join("index.html").display());
}

fn print(group: &MonteCarloGroup) {
    println!("\n{}\n{}", group.title, group.text);
    println!("{:<58} {:>6}  {}", "case", "trials", group.columns.join(" | "));
    for case in &group.cases {
        let cell = |(value, met): (&Option<Estimate>, &Option<bool>)| {
            let mark = if *met == Some(false) { " (!)" } else { "" };
            value.map_or("-".to_owned(), |e| match e.standard_uncertainty {
                Some(u) => format!("{:.3} ± {u:.3}{mark}", e.value),
                None => format!("{:.4}{mark}", e.value),
            })
        };
        let cells: Vec<String> = case.values.iter().zip(&case.met).map(cell).collect();
        println!("{:<58} {:>6}  {}", case.name, case.trials, cells.join(" | "));
    }
}

/// A number with the standard error of the study.
pub fn known(value: f64, standard_error: f64) -> Option<Estimate> {
    Some(Estimate { value, standard_uncertainty: Some(standard_error) })
}

/// Share of `n` trials with its binomial standard error, %; at least that of one trial.
pub fn share(hits: usize, n: usize) -> Option<Estimate> {
    let p = hits as f64 / n as f64;
    let floor = 0.5 / n as f64;
    known(100.0 * p, 100.0 * (p * (1.0 - p) / n as f64).sqrt().max(floor))
}

/// Root of the mean square.
pub fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.fold((0.0, 0), |(sum, n), v| (sum + v * v, n + 1));
    (sum / f64::from(n.max(1))).sqrt()
}
