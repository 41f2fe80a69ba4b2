//! `flightlag demo`: simulated flights, and on request their report.

use crate::arguments::DemoArguments;
use crate::campaign_command::{run_order, say};
use crate::failure::{End, Failure};
use crate::show::count;
use crate::stop::Stop;
use campaign::{DEMO_PIPELINE, Exit, Order, Pipeline, Verdict};
use std::path::Path;

pub(crate) fn run(arguments: &DemoArguments, stop: &Stop) -> Result<End, Failure> {
    let flights = arguments.folder.join("flights");
    let report = arguments.folder.join("report");
    let failed = |e: simulate::SimulateError| Failure::new(Exit::Failed, e.to_string());
    let written = simulate::write_demo(&flights, arguments.seed).map_err(failed)?;
    let many = count(written.flights.len() as u64, "simulated flight");
    say(&arguments.desk, &format!("{many} in {}, the truth in {}", flights.display(), simulate::TRUTH_FILE))?;
    if !arguments.run {
        let next = format!("flightlag campaign {} --out {}", flights.display(), report.display());
        say(&arguments.desk, &format!("next: {next}"))?;
        return Ok(Exit::Well.into());
    }
    let pipeline = Pipeline::parse(DEMO_PIPELINE, Path::new("demo.toml")).map_err(campaign::CampaignError::from)?;
    let command = format!("flightlag demo DIR --run --seed {}", arguments.seed);
    let verdict = run_order(&Order { flights, out: report, pipeline, verify: false, command }, &arguments.desk, stop)?;
    Ok(exit_of_demo(&verdict).into())
}

/// The demo holds a truncated flight on purpose: that its loss is found is no fault of the demo.
fn exit_of_demo(verdict: &Verdict) -> Exit {
    let only_lossy = verdict.totals.failed == 0 && verdict.troubled == 0;
    if only_lossy { Exit::Well } else { verdict.exit() }
}
