//! `flightlag history` and `flightlag trend`: what many nights found.

use crate::arguments::{HistoryArguments, TrendArguments};
use crate::diff_command::with_u;
use crate::failure::{End, Failure};
use crate::files::write_site;
use crate::show::{Table, count, number, visible};
use campaign::Exit;
use convert::Cells;
use history::{Dimension, History, LatencyLine, Looks, RunLine, latency, latest_briefs, runs, trend};
use record::{Estimate, TrendChart, TrendPoint, TrendRecord};
use std::io::Write;
use std::path::Path;

pub(crate) fn history(arguments: &HistoryArguments) -> Result<End, Failure> {
    let history = existing(&arguments.history)?;
    if arguments.latency {
        let read = history.briefs(&|_| true)?;
        let lines = latency(&latest_briefs(&read.rows));
        return print_lines(arguments.json, &lines, || latency_text(&lines), &read.unreadable);
    }
    let lines = runs(&history)?;
    let unreadable = lines.iter().filter_map(|line| Some(format!("{}: {}", line.run, line.unreadable.as_ref()?)));
    let unreadable: Vec<String> = unreadable.collect();
    print_lines(arguments.json, &lines, || runs_text(&lines), &unreadable)
}

/// A history that exists. A folder without files is more often a wrong path than an empty history.
pub(crate) fn existing(folder: &Path) -> Result<History, Failure> {
    let history = History::new(folder);
    match history.files()?.is_empty() {
        false => Ok(history),
        true => {
            let what =
                format!("{}: no history found; give the history folder of `flightlag nightly`", folder.display());
            Err(Failure::new(Exit::Wrong, what))
        }
    }
}

/// Prints lines as JSON or as text, then the unreadable files: exit code 3 if there are any.
fn print_lines<T: serde::Serialize>(
    json: bool,
    lines: &T,
    text: impl Fn() -> String,
    unreadable: &[String],
) -> Result<End, Failure> {
    let mut out = std::io::stdout().lock();
    match json {
        true => writeln!(out, "{}", serde_json::to_string(lines).unwrap_or_default())?,
        false => write!(out, "{}", text())?,
    }
    warn(unreadable)
}

/// Lists files that could not be read on standard error.
pub(crate) fn warn(unreadable: &[String]) -> Result<End, Failure> {
    for what in unreadable {
        let _ = writeln!(std::io::stderr(), "flightlag: not read: {}", visible(what));
    }
    Ok(if unreadable.is_empty() { Exit::Well } else { Exit::Incomplete }.into())
}

fn runs_text(lines: &[RunLine]) -> String {
    let mut table = Table::new(&[
        "run",
        "campaigns",
        "flights|",
        "failed|",
        "harmed or criterion failed|",
        "flown from",
        "to",
        "build",
    ]);
    let day = |instant: &Option<String>| instant.as_deref().and_then(|at| at.get(..10)).unwrap_or("-").to_owned();
    for line in lines {
        table.row(vec![
            line.run.clone(),
            if line.unreadable.is_some() { "CANNOT BE READ".to_owned() } else { line.campaigns.join(", ") },
            line.flights.to_string(),
            line.failed.to_string(),
            line.harmed_or_criterion_failed.to_string(),
            day(&line.flown_from),
            day(&line.flown_to),
            line.builds.join(", "),
        ]);
    }
    format!(
        "{}, each with the flights that have a new or changed finding\n{}",
        count(lines.len() as u64, "run"),
        table.text()
    )
}

fn latency_text(lines: &[LatencyLine]) -> String {
    let heads = [
        "receiver",
        "firmware",
        "rate",
        "baud",
        "counted from",
        "flights|",
        "late ms|",
        "spread ms|",
        "least ms|",
        "most ms|",
    ];
    let mut table = Table::new(&heads);
    let known = |value: &Option<String>| value.clone().unwrap_or_else(|| "unknown".to_owned());
    let millis = |s: f64| number(Some(s * 1e3), 1);
    for line in lines {
        let mean = Estimate { value: line.lateness_s, standard_uncertainty: Some(line.lateness_u_s) };
        table.row(vec![
            known(&line.receiver),
            known(&line.firmware),
            known(&line.rate),
            known(&line.baud),
            line.datum.clone(),
            match line.odd_flights {
                0 => line.flights.to_string(),
                odd => format!("{}, {odd} odd", line.flights),
            },
            if line.differs() { "no common delay".to_owned() } else { with_u(&mean, "s") },
            if line.flights > 1 { millis(line.between_s) } else { "-".to_owned() },
            millis(line.low_s),
            millis(line.high_s),
        ]);
    }
    if table.is_empty() {
        "no flight has a known lateness\n".to_owned()
    } else {
        let differ = "no common delay: the flights differ by more than their uncertainties; `trend` shows when\n";
        let differ = if lines.iter().any(LatencyLine::differs) { differ } else { "" };
        let odd =
            "odd: it differs from the others by more than its uncertainty, and is not in the mean; `trend` names it\n";
        let odd = if lines.iter().any(|line| line.odd_flights > 0) { odd } else { "" };
        format!("± is U (k = 2) of the mean\n{differ}{odd}{}", table.text())
    }
}

pub(crate) fn trend_over(arguments: &TrendArguments) -> Result<End, Failure> {
    let history = existing(&arguments.history)?;
    let read = history.briefs(&|_| true)?;
    let dimensions: Vec<Dimension> = match arguments.by.is_empty() {
        true => Dimension::ALL.to_vec(),
        false => arguments.by.clone(),
    };
    let reports = arguments.reports.as_deref().unwrap_or("..").trim_end_matches('/').to_owned();
    let page = |campaign: &str, page: &str| {
        Some(format!("{reports}/{campaign}/{page}")).filter(|_| arguments.reports.is_some())
    };
    let found = trend(&latest_briefs(&read.rows), &dimensions, Looks::One, &page).record;
    if let Some(out) = &arguments.out {
        let json = serde_json::to_string_pretty(&found).unwrap_or_default() + "\n";
        let csv = trend_csv(&found);
        write_site(out, &report::trend_site(&found, "Trends", ""), &[("trend.json", &json), ("trend.csv", &csv)])?;
    }
    let mut out = std::io::stdout().lock();
    match arguments.json {
        true => writeln!(out, "{}", serde_json::to_string(&found).unwrap_or_default())?,
        false => write!(out, "{}", trend_text(&found))?,
    }
    if let Some(folder) = arguments.out.as_ref().filter(|_| !arguments.json) {
        writeln!(out, "open {}", visible(&folder.join("index.html").display().to_string()))?;
    }
    warn(&read.unreadable)
}

fn trend_text(found: &TrendRecord) -> String {
    let (charts, changes) = (charts_table(found), changes_table(found));
    let left_out = found.left_out.iter().map(|why| format!("  {}\n", visible(why))).collect::<String>();
    let left_out = if left_out.is_empty() { left_out } else { format!("not on a chart\n{left_out}") };
    let charts = if charts.is_empty() {
        "no chart: fewer than three flights share a value\n".to_owned()
    } else {
        crate::findings::section("charts (± is U, k = 2)", &charts)
    };
    charts + &crate::findings::section("changes", &changes) + &left_out
}

fn charts_table(found: &TrendRecord) -> Table {
    let mut table =
        Table::new(&["chart", "counted from", "flights|", "late now ms|", "spread ms|", "changes|", "outside|"]);
    for chart in &found.charts {
        let now = chart.segments.last().map(|segment| with_u(&segment.mean_s, "s")).unwrap_or_default();
        table.row(vec![
            chart.name(),
            chart.datum.clone(),
            (chart.points.len() as u64 + chart.older_points).to_string(),
            now,
            number(Some(chart.between_s * 1e3), 1),
            chart.changes.len().to_string(),
            chart.points.iter().filter(|point| point.is_outside).count().to_string(),
        ]);
    }
    table
}

fn changes_table(found: &TrendRecord) -> Table {
    let mut table = Table::new(&["chart", "from this flight on", "step ms|", "sigma|", "with it"]);
    for (chart, change) in found.charts.iter().flat_map(|chart| chart.changes.iter().map(move |change| (chart, change)))
    {
        table.row(vec![
            chart.name(),
            format!("{}/{}", change.at.campaign, change.at.flight),
            with_u(&change.step_s, "s"),
            format!("{:+.1}", change.sigmas),
            change.with_it.join("; "),
        ]);
    }
    table
}

/// Every point of every chart.
fn trend_csv(found: &TrendRecord) -> String {
    let mut sheet = convert::Sheet::default();
    let points: Vec<_> =
        found.charts.iter().flat_map(|chart| chart.points.iter().map(move |point| (chart, point))).collect();
    let of_chart = |of: &dyn Fn(&TrendChart) -> &String| {
        Cells::Text(points.iter().map(|(chart, _)| Some(of(chart).clone())).collect())
    };
    let texts =
        |of: &dyn Fn(&TrendPoint) -> Option<&String>| Cells::Text(points.iter().map(|(_, p)| of(p).cloned()).collect());
    let numbers = |of: &dyn Fn(&TrendPoint) -> Option<f64>| Cells::F64(points.iter().map(|(_, p)| of(p)).collect());
    let marks =
        |of: &dyn Fn(&TrendPoint) -> bool| Cells::I64(points.iter().map(|(_, p)| Some(i64::from(of(p)))).collect());
    sheet.push("dimension", of_chart(&|chart| &chart.dimension));
    sheet.push("value", of_chart(&|chart| &chart.value));
    sheet.push("datum", of_chart(&|chart| &chart.datum));
    sheet.push("campaign", texts(&|p| Some(&p.flight.campaign)));
    sheet.push("flight", texts(&|p| Some(&p.flight.flight)));
    sheet.push("flown_at", texts(&|p| p.flown_at.as_ref()));
    sheet.push("lateness_s", numbers(&|p| Some(p.lateness_s.value)));
    sheet.push("lateness_u_s", numbers(&|p| p.lateness_s.standard_uncertainty));
    sheet.push("centre_s", numbers(&|p| Some(p.centre_s)));
    sheet.push("limit_s", numbers(&|p| Some(p.limit_s)));
    sheet.push("is_outside", marks(&|p| p.is_outside));
    sheet.push("is_odd", marks(&|p| p.is_odd));
    let mut bytes = vec![];
    // All columns have the same length, and writing to a vector cannot fail.
    let _ = convert::write_csv(&sheet, &mut bytes);
    String::from_utf8(bytes).unwrap_or_default()
}
