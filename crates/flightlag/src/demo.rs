//! `flightlag demo`: simulated flights and bench records, and optionally their reports.

use crate::arguments::DemoArguments;
use crate::campaign_command::{run_order, say};
use crate::failure::{End, Failure};
use crate::show::count;
use crate::stop::Stop;
use crate::{bench_command, campaign_command::name_for_shell};
use campaign::{BenchOrder, Criteria, DEMO_CRITERIA, DEMO_PIPELINE, Exit, Order, Pipeline, Verdict};
use simulate::{BenchDemo, SimulateError};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

pub(crate) fn run(arguments: &DemoArguments, stop: &Stop) -> Result<End, Failure> {
    let (flights, bench) = (arguments.folder.join("flights"), arguments.folder.join("bench"));
    let failed = |e: SimulateError| Failure::new(Exit::Failed, e.to_string());
    let (written, swings) = std::thread::scope(|threads| {
        let swings = threads.spawn(|| simulate::write_bench_demo(&bench, arguments.seed));
        let written = simulate::write_demo(&flights, arguments.seed);
        (written, swings.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
    });
    let (written, swings) = (written.map_err(failed)?, swings.map_err(failed)?);
    let truth = |what: &str, n: usize, folder: &Path| {
        format!("{} in {}, the truth in {}", count(n as u64, what), folder.display(), simulate::TRUTH_FILE)
    };
    say(&arguments.common, &truth("simulated flight", written.flights.len(), &flights))?;
    say(&arguments.common, &truth("simulated bench record", swings.records.len(), &bench))?;
    let benches = benches(arguments, &bench, &swings);
    if !arguments.run {
        return next(arguments, &flights, &benches);
    }
    let mut exit = Exit::Well;
    let mut measured = vec![];
    for order in &benches {
        let verdict = bench_command::run_order(order, &arguments.common, stop)?;
        exit = worse(exit, verdict.exit());
        measured.push(verdict);
    }
    campaign::bench_index(&arguments.folder.join("bench-report"), &measured)?;
    let verdict = run_flights(arguments, flights, stop)?;
    Ok(worse(exit, exit_of_flights(&verdict)).into())
}

/// The commands that make the reports.
fn next(arguments: &DemoArguments, flights: &Path, benches: &[BenchOrder]) -> Result<End, Failure> {
    for BenchOrder { records, out, .. } in benches {
        let records: Vec<String> = records.iter().map(|p| p.display().to_string()).collect();
        say(&arguments.common, &format!("next: flightlag bench {} --out {}", records.join(" "), out.display()))?;
    }
    let report = report(arguments);
    let (flights, report) = (flights.display(), report.display());
    // Without it nothing would be removed: the flights have no IMU.
    say(&arguments.common, &format!("next: flightlag campaign {flights} --reference-clock same --out {report}"))?;
    Ok(Exit::Well.into())
}

fn report(arguments: &DemoArguments) -> PathBuf {
    arguments.folder.join("report")
}

/// One bench run per sensor; the rig files are next to the records.
fn benches(arguments: &DemoArguments, folder: &Path, demo: &BenchDemo) -> Vec<BenchOrder> {
    let mut of_sensor: BTreeMap<&str, Vec<PathBuf>> = BTreeMap::new();
    for record in &demo.records {
        let logs = of_sensor.entry(&record.serial).or_default();
        // A folder would be taken as one bench run, but its logs belong to several sensors.
        logs.push(folder.join(&record.sensor));
        if record.encoder != record.sensor {
            logs.push(folder.join(&record.encoder));
        }
    }
    let order = |(serial, records): (&str, Vec<PathBuf>)| {
        let names: Vec<String> = records.iter().map(|p| name_for_shell(p)).collect();
        BenchOrder {
            encoder: None,
            rig: None,
            out: arguments.folder.join("bench-report").join(serial.to_lowercase()),
            forced_map: None,
            maps_folder: None,
            replace: false,
            card: None,
            command: format!("flightlag bench {} --out REPORT", names.join(" ")),
            records,
        }
    };
    of_sensor.into_iter().map(order).collect()
}

/// The flights are compensated with the simulated delay, not by a card: their receiver was never on the bench.
fn run_flights(arguments: &DemoArguments, flights: PathBuf, stop: &Stop) -> Result<Verdict, Failure> {
    let pipeline = Pipeline::parse(DEMO_PIPELINE, Path::new("demo.toml")).map_err(campaign::CampaignError::from)?;
    let criteria =
        Criteria::parse(DEMO_CRITERIA, Path::new("demo.criteria.toml")).map_err(campaign::CampaignError::from)?;
    let pipeline = pipeline.with_criteria(Some(criteria));
    let command = format!("flightlag demo DIR --run --seed {}", arguments.seed);
    let order =
        Order { flights, out: report(arguments), pipeline, verify: false, replace: false, command, settle: None };
    run_order(&order, &arguments.common, stop)
}

/// The demo contains a truncated flight and failed criteria on purpose: finding them is not a fault of the demo.
fn exit_of_flights(verdict: &Verdict) -> Exit {
    let only_lossy = verdict.totals.failed == 0 && verdict.troubled == 0;
    if only_lossy { Exit::Well } else { Exit::Incomplete }
}

fn worse(a: Exit, b: Exit) -> Exit {
    if a == Exit::Well { b } else { a }
}
