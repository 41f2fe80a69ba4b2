//! Accuracy of the bench: many simulated records, each with a known answer.
//!
//! `cargo run --release -p flightlag-bench-analysis --example monte_carlo -- [TRIALS]` prints the tables. Every trial has
//! its own seed, so that the result does not depend on the number of threads.

#![allow(clippy::print_stdout, clippy::unwrap_used)]

mod delay;
mod lag;
mod noise;
mod reference;
mod swing;

use record::Estimate;

/// Seed of the whole study.
pub const SEED: u64 = 20_101_025;

/// One case of a study.
pub struct Case {
    /// What was simulated, in words.
    pub name: String,
    /// Number of trials.
    pub trials: u64,
    /// Columns of numbers, in the order of the group's columns; `None` where a number does not apply to the case.
    pub values: Vec<Option<Estimate>>,
    /// Whether each goal is met within the error of the study; `None` where the column has no goal.
    pub met: Vec<Option<bool>>,
}

/// Cases with the same columns.
pub struct Group {
    /// Title.
    pub title: String,
    /// Procedure and goals, in words.
    pub text: String,
    /// Columns with units, such as `rms/CRLB`.
    pub columns: Vec<String>,
    /// Goal of each column in words; empty without a goal.
    pub goals: Vec<String>,
    /// Cases.
    pub cases: Vec<Case>,
}

fn main() {
    let trials: u64 = std::env::args().nth(1).map_or(1000, |text| text.parse().expect("TRIALS is a number"));
    let swings = swing::swings(50);
    print(&reference::accuracy());
    print(&delay::efficiency(&swings, trials));
    print(&delay::misspecified(&swings, trials));
    print(&delay::held(&swings, trials.min(200)));
    // The goal is known to one in a hundred: with a thousand trials 0.7 of it would be random.
    print(&delay::decisions(&swings, 10 * trials));
    print(&lag::choices(&swings, trials.min(100)));
}

fn print(group: &Group) {
    println!("\n{}\n{}", group.title, group.text);
    let goal = |(column, goal): (&String, &String)| {
        if goal.is_empty() { column.clone() } else { format!("{column} ({goal})") }
    };
    let columns: Vec<String> = group.columns.iter().zip(&group.goals).map(goal).collect();
    println!("{:<58} {:>6}  {}", "case", "trials", columns.join(" | "));
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
