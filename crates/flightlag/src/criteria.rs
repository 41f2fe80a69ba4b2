//! `flightlag criteria`: lists the available criteria, and checks a criteria file.

use crate::arguments::CriteriaArguments;
use crate::failure::{End, Failure};
use crate::show::visible;
use campaign::{CampaignError, Criteria, EXAMPLE_CRITERIA, Exit, METRICS, MetricEntry, Takes};
use std::io::Write;
use std::path::Path;

pub(crate) fn run(arguments: &CriteriaArguments) -> Result<End, Failure> {
    let mut out = std::io::stdout().lock();
    match &arguments.file {
        Some(file) => write!(out, "{}", checked(file)?)?,
        None if arguments.example => write!(out, "{EXAMPLE_CRITERIA}")?,
        None => write!(out, "{}", listed())?,
    }
    Ok(Exit::Well.into())
}

/// The resolved criteria, in the layout of the file.
fn checked(file: &Path) -> Result<String, Failure> {
    let criteria = Criteria::read(file).map_err(CampaignError::from)?;
    let used = criteria.as_used();
    let lines: String = used.toml.lines().map(|line| visible(line) + "\n").collect();
    let (name, number) = (visible(&used.file), criteria.count());
    Ok(format!("# {name} is valid; criteria: {number}; BLAKE3 of the resolved criteria: {}\n{lines}", used.blake3))
}

fn listed() -> String {
    let mut text =
        "Metrics of a criteria file (flightlag criteria --example prints one). Metrics with * have an uncertainty: \
         the 95 % interval decides.\n\n"
            .to_owned();
    METRICS.iter().for_each(|metric| text += &entry(metric));
    text
}

fn entry(metric: &MetricEntry) -> String {
    let star = if metric.uncertain { "*" } else { " " };
    let units: Vec<&str> = metric.dimension.units().filter(|unit| !unit.is_empty()).collect();
    let units = if units.is_empty() { "a bare number".to_owned() } else { units.join(", ") };
    let takes = match metric.takes {
        Takes::Nothing => "",
        Takes::Compensator => "; needs compensator",
        Takes::Channel => "; needs channel",
        Takes::Pair => "; takes channel, against",
    };
    format!("{star} {:34} [{units}{takes}]\n      {}\n", metric.name, metric.about)
}
