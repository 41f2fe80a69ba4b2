//! `flightlag delay`: how late the positions of logs are.

use crate::aircraft;
use crate::arguments::{DelayArguments, RunArguments};
use crate::campaign_command::{pipeline_of, run_context, with_reference};
use crate::failure::{End, Failure};
use crate::listen::listener;
use crate::show::{Table, count, visible};
use crate::stop::Stop;
use campaign::{DelayLine, DelayOrder, DelayReport, GroupLine, LineAlarm, LineSetting, delay_report};
use compensation_replay::ekf_values_toml;
use record::Estimate;
use std::io::Write;
use std::path::Path;

/// Maximum number of flight lines at the end of a campaign; its page lists all.
const MOST_FLIGHTS: usize = 40;
/// Maximum number of alarms printed.
const MOST_ALARMS: usize = 20;

pub(crate) fn run(arguments: &DelayArguments, stop: &Stop) -> Result<End, Failure> {
    let mut out = std::io::stdout().lock();
    let pipeline = pipeline_of(arguments.pipeline.as_deref(), arguments.map.clone(), arguments.maps.clone())?;
    let pipeline = with_reference(pipeline, arguments.reference.as_deref(), arguments.reference_clock)?;
    let order = DelayOrder { paths: arguments.logs.clone(), pipeline, filter_values: arguments.ekf.is_some() };
    let quiet = arguments.quiet || arguments.logs.iter().all(|path| path.is_file());
    let asked = RunArguments { threads: arguments.threads, json: false, quiet, cache: arguments.cache.clone() };
    let events = listener(&asked);
    let report = delay_report(&order, &run_context(&asked, stop, events.as_ref()))?;
    drop(events);
    match (arguments.json, arguments.csv) {
        (true, _) => writeln!(out, "{}", serde_json::to_string_pretty(&report).unwrap_or_default())?,
        (_, true) => report.write_csv(&mut out)?,
        _ => write!(out, "{}", visible_lines(&text(&report.flights, &report.groups, usize::MAX)))?,
    }
    if let Some(folder) = &arguments.ekf {
        filter_values(folder, &report)?;
    }
    aircraft::write(&arguments.aircraft, &report.groups)?;
    Ok(report.exit().into())
}

/// One file for each flight whose delays were measured.
fn filter_values(folder: &Path, report: &DelayReport) -> Result<(), Failure> {
    aircraft::make(folder)?;
    for (name, values) in &report.filter_values {
        aircraft::put(&folder.join(format!("{name}.ekf.toml")), &ekf_values_toml(values))?;
    }
    let written = report.filter_values.len();
    let flights = count(report.flights.len() as u64, "flight");
    aircraft::say(&format!(
        "values for the design of a filter written for {written} of {flights}: {}",
        folder.display()
    ));
    Ok(())
}

fn visible_lines(text: &str) -> String {
    text.lines().map(|line| visible(line) + "\n").collect()
}

/// Groups first, then flights, then alarms: the same lines at the end of a campaign.
pub(crate) fn text(flights: &[DelayLine], groups: &[GroupLine], most: usize) -> String {
    match flights {
        [one] => one_flight(one),
        _ => {
            groups_text(groups)
                + "\n"
                + &flights_text(flights, most)
                + &alarms_text(flights)
                + &companions_text(flights)
        }
    }
}

/// The same, shortened for a terminal.
pub(crate) fn short_text(flights: &[DelayLine], groups: &[GroupLine]) -> String {
    text(flights, groups, MOST_FLIGHTS)
}

fn one_flight(line: &DelayLine) -> String {
    let mut text = String::new();
    for alarm in line.alarms.iter().filter(|_| line.lacks_reference()).filter(|alarm| is_reference(alarm)) {
        let file = if line.reference_file.is_some() { "reference file " } else { "" };
        text += &format!("{file}{}\n", alarm.text);
    }
    text += &format!("{}: {}\n", line.flight, line.words);
    let mut row = |what: &str, value: String| {
        if !value.is_empty() {
            text += &format!("  {what:<22}{value}\n");
        }
    };
    row("lateness (k = 2)", lateness(line));
    row("95 % interval", interval(line));
    row("kind", line.kind.clone());
    row("position - velocity", position_minus_velocity(line));
    row("campaign removes", removed(line));
    row("effect", line.effect_words.clone());
    row("data", data(&line.data));
    row("set", settings(&line.set));
    row("fly", line.fly.clone().unwrap_or_default());
    row("group", line.group.clone());
    row("reference file", line.reference_file.clone().filter(|_| !line.lacks_reference()).unwrap_or_default());
    for alarm in line.alarms.iter().filter(|alarm| !is_reference(alarm)) {
        row(if alarm.gravity == "grey" { "remark" } else { "alarm" }, alarm.text.clone());
    }
    text
}

/// Whether an alarm is about the reference file: its reason is the first line.
fn is_reference(alarm: &LineAlarm) -> bool {
    alarm.code == flight::Alarm::ReferenceNotUsed
}

/// Empty for an intact log.
fn data(word: &str) -> String {
    match word {
        "whole" => String::new(),
        "minor-loss" => "minor loss: less than 0.1 % of the log is damaged; `flightlag inspect` shows where".to_owned(),
        _ => word.replace('-', " "),
    }
}

fn groups_text(groups: &[GroupLine]) -> String {
    let mut lines: Vec<String> = vec![];
    for group in groups.iter().filter(|group| !group.group.is_empty()) {
        let set = settings(&group.set);
        let set = if set.is_empty() { set } else { format!("  set {set}\n") };
        let line = format!("{}: {}\n{set}", group.group, group.words);
        // Groups may differ in properties that are not in their names.
        if !lines.contains(&line) {
            lines.push(line);
        }
    }
    let of_no_group: u64 = groups.iter().filter(|group| group.group.is_empty()).map(|group| group.flights).sum();
    if of_no_group > 0 {
        lines.push(format!("{} in no group; see below\n", count(of_no_group, "file")));
    }
    lines.concat()
}

/// The state of the log, and whether it is a copy of another flight.
fn data_cell(line: &DelayLine) -> String {
    let copy = line.duplicate_of.as_ref().map_or(String::new(), |of| format!(", copy of {of}"));
    format!("{}{copy}", line.data.replace('-', " "))
}

fn flights_text(flights: &[DelayLine], most: usize) -> String {
    let mut table =
        Table::new(&["flight", "lateness ms|", "against", "kind", "pos-vel ms|", "removed|", "effect", "data"]);
    for line in flights.iter().take(most) {
        let relative = expanded_ms(line.position_minus_velocity_s, line.position_minus_velocity_u_s);
        table.row(vec![
            line.flight.clone(),
            expanded_ms(line.lateness_s, line.lateness_u_s),
            line.datum.clone(),
            line.kind.clone(),
            relative,
            removed(line),
            effect(line),
            data_cell(line),
        ]);
    }
    let more = match flights.len().saturating_sub(most) {
        0 => String::new(),
        n => format!("  and {}\n", count(n as u64, "more flight")),
    };
    format!("{}{more}", table.text())
}

/// Files that are not flights, with the reason.
fn companions_text(flights: &[DelayLine]) -> String {
    let all: Vec<&DelayLine> = flights.iter().filter(|line| line.data == "companion").collect();
    let mut text = String::new();
    if !all.is_empty() {
        text += "\nnot a flight\n";
    }
    for line in all.iter().take(MOST_ALARMS) {
        text += &format!("  {}: {}\n", line.flight, line.words);
    }
    if all.len() > MOST_ALARMS {
        text += &format!("  and {} more\n", all.len() - MOST_ALARMS);
    }
    text
}

/// The most severe alarms first; grey ones only on the page and in JSON.
fn alarms_text(flights: &[DelayLine]) -> String {
    let of = |gravity: &'static str| {
        flights.iter().flat_map(move |line| {
            line.alarms
                .iter()
                .filter(move |a| a.gravity == gravity)
                .map(move |a| format!("{}: {}", line.flight, a.text))
        })
    };
    let harmed = flights.iter().filter(|l| l.effect == "harmed").map(|l| format!("{}: {}", l.flight, l.effect_words));
    let failed = flights.iter().filter(|l| l.data == "failed").map(|l| format!("{}: {}", l.flight, l.words));
    let is_unsaid =
        |l: &&DelayLine| l.kind.starts_with("cannot-tell") && !["failed", "companion"].contains(&l.data.as_str());
    let unknown = flights.iter().filter(is_unsaid).map(|l| format!("{}: {}", l.flight, l.words));
    let all: Vec<String> = harmed.chain(of("red")).chain(failed).chain(of("amber")).chain(unknown).collect();
    let mut text = String::new();
    if !all.is_empty() {
        text += "\nneeds attention\n";
    }
    for alarm in all.iter().take(MOST_ALARMS) {
        text += &format!("  {alarm}\n");
    }
    if all.len() > MOST_ALARMS {
        text += &format!("  and {} more\n", all.len() - MOST_ALARMS);
    }
    text
}

fn position_minus_velocity(line: &DelayLine) -> String {
    let value = expanded_ms(line.position_minus_velocity_s, line.position_minus_velocity_u_s);
    match &line.velocity {
        Some(velocity) if !value.is_empty() => format!("{value} ms, {velocity}"),
        _ => value,
    }
}

fn lateness(line: &DelayLine) -> String {
    let value = expanded_ms(line.lateness_s, line.lateness_u_s);
    if value.is_empty() { value } else { format!("{value} ms, {}", record::counted_from(&line.datum)) }
}

fn interval(line: &DelayLine) -> String {
    let ends = line.lateness_low_s.zip(line.lateness_high_s);
    ends.map_or_else(String::new, |(low, high)| format!("{:.1} to {:.1} ms", 1e3 * low, 1e3 * high))
}

/// `203.4 ± 16.2`: value and expanded uncertainty (k = 2), ms.
fn expanded_ms(value: Option<f64>, u: Option<f64>) -> String {
    match (value, u) {
        (None, _) => String::new(),
        (Some(value), None) => format!("{:.1}", 1e3 * value),
        (Some(value), Some(u)) => {
            let expanded = 2e3 * u;
            let digits = if expanded >= 10.0 {
                0
            } else if expanded >= 1.0 {
                1
            } else {
                2
            };
            format!("{:.digits$} ± {expanded:.digits$}", 1e3 * value)
        }
    }
}

fn removed(line: &DelayLine) -> String {
    match line.removed_s {
        Some(delay_s) => {
            let from = match line.removed_from.as_str() {
                "others-flights" => "other flights",
                "own-network" => "this flight",
                other => other,
            };
            format!("{:.1} ms, from {from}", 1e3 * delay_s)
        }
        None => "nothing".to_owned(),
    }
}

/// Empty if nothing was removed: the neighbouring column says so.
fn effect(line: &DelayLine) -> String {
    if line.removed_s.is_none() && line.effect == "no-change" {
        return String::new();
    }
    let metres = match (line.error_raw_m, line.error_compensated_m) {
        (Some(raw), Some(after)) if line.removed_s.is_some() => {
            let words = |value, u| campaign::error_words(&Estimate { value, standard_uncertainty: u });
            format!(" {} -> {} m", words(raw, line.error_raw_u_m), words(after, line.error_compensated_u_m))
        }
        _ => String::new(),
    };
    let word = if line.effect == "harmed" { "HARMED".to_owned() } else { line.effect.replace('-', " ") };
    format!("{word}{metres}")
}

fn settings(set: &[LineSetting]) -> String {
    let one = |s: &LineSetting| {
        let note = if s.note.is_empty() { String::new() } else { format!(" ({})", s.note) };
        match s.unsuitable {
            true => format!("{} cannot remove it: {}", s.name, s.note),
            false => format!("{} = {}{note}", s.name, s.value),
        }
    };
    set.iter().map(one).collect::<Vec<_>>().join("; ")
}
