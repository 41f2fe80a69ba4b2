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
use flight::fixed;
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
    for warning in line.warning_texts.iter().take(MOST_ALARMS) {
        row("warning", warning.clone());
    }
    row("warnings", unlisted(line));
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

/// The warnings that are not listed.
fn unlisted(line: &DelayLine) -> String {
    match (line.warnings, line.warning_texts.len()) {
        (0, _) => String::new(),
        (n, 0) => format!("{n}, among the alarms or on the page of the flight"),
        (_, texts) if texts <= MOST_ALARMS => String::new(),
        (_, texts) => format!("{}, listed by --json", count((texts - MOST_ALARMS) as u64, "more warning")),
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
            lateness_ms(line),
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
    let value = lateness_ms(line);
    if value.is_empty() { value } else { format!("{value} ms, {}", record::counted_from(&line.datum)) }
}

fn interval(line: &DelayLine) -> String {
    let ends = line.lateness_low_s.zip(line.lateness_high_s);
    ends.map_or_else(String::new, |(low, high)| format!("{} to {} ms", fixed(1e3 * low, 1), fixed(1e3 * high, 1)))
}

/// `203 ± 16`, or `395 to 518` where the interval is one-sided, ms.
fn lateness_ms(line: &DelayLine) -> String {
    match (line.lateness_s, line.lateness_low_s, line.lateness_high_s) {
        (Some(value), Some(low), Some(high)) if record::is_one_sided(value, [low, high]) => {
            format!("{} to {}", fixed(1e3 * low, 0), fixed(1e3 * high, 0))
        }
        (value, ..) => expanded_ms(value, line.lateness_u_s),
    }
}

/// `203 ± 16`: value and expanded uncertainty (k = 2), ms.
fn expanded_ms(value: Option<f64>, u: Option<f64>) -> String {
    match (value, u) {
        (None, _) => String::new(),
        (Some(value), None) => fixed(1e3 * value, 1),
        (Some(value), Some(u)) => {
            let expanded = 2e3 * u;
            let digits = if expanded >= 10.0 {
                0
            } else if expanded >= 1.0 {
                1
            } else {
                2
            };
            format!("{} ± {}", fixed(1e3 * value, digits), fixed(expanded, digits))
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
            format!("{} ms, from {from}", expanded_ms(Some(delay_s), line.removed_u_s))
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A flight of an intact log with a position 203 ms late; nothing was removed.
    fn late(flight: &str) -> DelayLine {
        DelayLine {
            flight: flight.to_owned(),
            group: "M8 at 5 Hz".to_owned(),
            kind: "constant".to_owned(),
            lateness_s: Some(0.2034),
            lateness_u_s: Some(0.0081),
            lateness_low_s: Some(0.1873),
            lateness_high_s: Some(0.2195),
            datum: "imu".to_owned(),
            position_minus_velocity_s: Some(0.12),
            position_minus_velocity_u_s: Some(0.002),
            velocity: Some("velocity.gps".to_owned()),
            removed_s: None,
            removed_u_s: None,
            removed_from: "none".to_owned(),
            effect: "no-change".to_owned(),
            error_raw_m: Some(4.0),
            error_raw_u_m: None,
            error_compensated_m: None,
            error_compensated_u_m: None,
            alarms: vec![],
            data: "whole".to_owned(),
            warnings: 0,
            warning_texts: vec![],
            words: "203 ms late".to_owned(),
            effect_words: String::new(),
            set: vec![],
            fly: None,
            duplicate_of: None,
            reference_file: None,
        }
    }

    fn alarm(gravity: &str, code: &str) -> LineAlarm {
        LineAlarm { gravity: gravity.to_owned(), code: code.to_owned(), text: format!("text of {code}") }
    }

    fn group(name: &str, flights: u64) -> GroupLine {
        GroupLine {
            group: name.to_owned(),
            flights,
            pooled: flights,
            lateness_s: None,
            lateness_u_s: None,
            lateness_low_s: None,
            lateness_high_s: None,
            datum: String::new(),
            between_s: None,
            words: "on time".to_owned(),
            outliers: vec![],
            set: vec![],
        }
    }

    /// Names and values of the rows below the first line.
    fn rows(text: &str) -> Vec<(&str, &str)> {
        let rows = text.lines().skip(1).map(|line| line.split_at(24));
        rows.map(|(name, value)| (name.trim(), value)).collect()
    }

    /// Former bug: exit code 0 beside "the reference is not used as the zero".
    #[test]
    fn a_contradicted_reference_counts_as_unusable_unless_it_is_still_the_zero() {
        let alarm = LineAlarm {
            gravity: "amber".to_owned(),
            code: flight::Alarm::ReferenceContradicted.name().to_owned(),
            text: "velocity.gps would be early".to_owned(),
        };
        let with = |datum: &str| DelayLine { datum: datum.to_owned(), alarms: vec![alarm.clone()], ..late("a.bin") };
        assert!(with("relative to velocity.gps").lacks_reference() && !with("reference").lacks_reference());
    }

    /// Former bug: "399 ± 122 ms" beside "at least 395 ms late".
    #[test]
    fn a_one_sided_lateness_is_its_interval() {
        let with = |low, high| DelayLine { lateness_low_s: Some(low), lateness_high_s: Some(high), ..late("a.bin") };
        assert_eq!(lateness_ms(&with(0.2, 0.32)), "200 to 320");
        assert_eq!(lateness_ms(&with(0.187, 0.219)), "203 ± 16");
    }

    #[test]
    fn one_flight_has_a_row_for_everything_known_and_none_for_the_rest() {
        let text = one_flight(&late("a.bin"));
        assert!(text.starts_with("a.bin: 203 ms late\n"), "{text}");
        let known = [
            ("lateness (k = 2)", "203 ± 16 ms, against the IMU"),
            ("95 % interval", "187.3 to 219.5 ms"),
            ("kind", "constant"),
            ("position - velocity", "120.0 ± 4.0 ms, velocity.gps"),
            ("campaign removes", "nothing"),
            ("group", "M8 at 5 Hz"),
        ];
        assert_eq!(rows(&text), known);
        let set = |unsuitable| LineSetting {
            name: "GPS_DELAY_MS".to_owned(),
            value: 203.0,
            unit: "ms".to_owned(),
            in_log: None,
            note: "most is 250".to_owned(),
            unsuitable,
        };
        let more = DelayLine {
            removed_s: Some(0.2),
            removed_u_s: Some(0.004),
            removed_from: "others-flights".to_owned(),
            effect_words: "the error fell".to_owned(),
            data: "tail-cut".to_owned(),
            warnings: 2,
            warning_texts: vec!["clock: set".to_owned(), "rows: left out".to_owned()],
            set: vec![set(false), set(true)],
            fly: Some("turns".to_owned()),
            reference_file: Some("its clock is that of the log".to_owned()),
            alarms: vec![alarm("grey", "one"), alarm("amber", "two")],
            lateness_s: None,
            lateness_low_s: None,
            position_minus_velocity_s: None,
            ..late("b.bin")
        };
        let known = [
            ("kind", "constant"),
            ("campaign removes", "200.0 ± 8.0 ms, from other flights"),
            ("effect", "the error fell"),
            ("data", "tail cut"),
            ("set", "GPS_DELAY_MS = 203 (most is 250); GPS_DELAY_MS cannot remove it: most is 250"),
            ("fly", "turns"),
            ("group", "M8 at 5 Hz"),
            ("reference file", "its clock is that of the log"),
            ("remark", "text of one"),
            ("alarm", "text of two"),
            ("warning", "clock: set"),
            ("warning", "rows: left out"),
        ];
        assert_eq!(rows(&one_flight(&more)), known);
        assert!(data("minor-loss").contains("less than 0.1 %"), "{}", data("minor-loss"));
        let in_campaign = DelayLine { warning_texts: vec![], ..more.clone() };
        assert!(
            rows(&one_flight(&in_campaign)).contains(&("warnings", "2, among the alarms or on the page of the flight"))
        );
        let own = DelayLine { removed_from: "own-network".to_owned(), ..more };
        assert_eq!(removed(&own), "200.0 ± 8.0 ms, from this flight");
    }

    #[test]
    fn a_reference_that_was_not_used_is_the_first_line() {
        let alarms = vec![alarm("amber", "reference-not-used"), alarm("red", "two")];
        let line = DelayLine { alarms, ..late("a.bin") };
        let text = one_flight(&line);
        assert!(text.starts_with("text of reference-not-used\na.bin: 203 ms late\n"), "{text}");
        assert_eq!(text.matches("reference").count(), 1, "{text}");
        let with_file = DelayLine { reference_file: Some("another day".to_owned()), ..line };
        let text = one_flight(&with_file);
        assert!(text.starts_with("reference file text of reference-not-used\na.bin: "), "{text}");
        assert!(!text.contains("another day") && text.ends_with("text of two\n"), "{text}");
    }

    #[test]
    fn a_value_has_as_many_decimals_as_its_uncertainty_needs() {
        let cases = [
            (None, Some(0.1), ""),
            (Some(0.2034), None, "203.4"),
            (Some(0.2034), Some(0.005), "203 ± 10"),
            (Some(0.2034), Some(0.004), "203.4 ± 8.0"),
            (Some(-0.2034), Some(0.0005), "\u{2212}203.4 ± 1.0"),
            (Some(-0.000_01), Some(0.008), "0 ± 16"),
            (Some(0.2034), Some(0.0004), "203.40 ± 0.80"),
        ];
        for (value, u, text) in cases {
            assert_eq!(expanded_ms(value, u), text);
        }
    }

    #[test]
    fn the_effect_of_a_removed_delay_comes_with_the_errors_before_and_after() {
        let removed = |effect: &str, after| DelayLine {
            removed_s: Some(0.2),
            effect: effect.to_owned(),
            error_compensated_m: after,
            ..late("a.bin")
        };
        assert_eq!(effect(&late("a.bin")), "");
        assert_eq!(effect(&DelayLine { effect: "cannot-tell".to_owned(), ..late("a.bin") }), "cannot tell");
        assert_eq!(effect(&removed("helped", Some(0.5))), "helped 4.00 -> 0.50 m");
        assert_eq!(effect(&removed("harmed", Some(12.0))), "HARMED 4.00 -> 12.0 m");
        assert_eq!(effect(&removed("no-change", None)), "no change");
    }

    #[test]
    fn several_flights_are_a_table_that_ends_with_the_number_of_further_ones() {
        let copy = DelayLine { duplicate_of: Some("a.bin".to_owned()), data: "tail-cut".to_owned(), ..late("b.bin") };
        let flights = [late("a.bin"), copy, late("c.bin")];
        let cells =
            |line: &str| line.split("  ").map(str::trim).filter(|cell| !cell.is_empty()).collect::<Vec<_>>().join("|");
        let lines = |most| -> Vec<String> { flights_text(&flights, most).lines().map(cells).collect() };
        let row = |name: &str, data: &str| format!("{name}|203 ± 16|imu|constant|120.0 ± 4.0|nothing|{data}");
        let expected = [
            "flight|lateness ms|against|kind|pos-vel ms|removed|effect|data".to_owned(),
            row("a.bin", "whole"),
            row("b.bin", "tail cut, copy of a.bin"),
            row("c.bin", "whole"),
        ];
        assert_eq!(lines(3), expected);
        assert_eq!(lines(2), [&expected[..3], &["and 1 more flight".to_owned()]].concat());
        let whole = text(&flights, &[group("M8", 3)], 2);
        assert_eq!(whole, format!("M8: on time\n\n{}", flights_text(&flights, 2)));
    }

    #[test]
    fn alike_groups_are_one_line_and_files_without_a_group_are_counted() {
        let set = vec![LineSetting {
            name: "EKF2_GPS_DELAY".to_owned(),
            value: 110.0,
            unit: "ms".to_owned(),
            in_log: None,
            note: String::new(),
            unsuitable: false,
        }];
        let groups = [group("M8", 2), group("M8", 5), GroupLine { set, ..group("F9", 1) }, group("", 1), group("", 2)];
        let expected = "M8: on time\nF9: on time\n  set EKF2_GPS_DELAY = 110\n3 files in no group; see below\n";
        assert_eq!(groups_text(&groups), expected);
    }

    #[test]
    fn what_needs_attention_is_listed_by_severity() {
        let flight = |name: &str, kind: &str, data: &str, alarms| DelayLine {
            kind: kind.to_owned(),
            data: data.to_owned(),
            alarms,
            ..late(name)
        };
        let unknown = |name: &str, data: &str| flight(name, "cannot-tell", data, vec![]);
        let harmed = DelayLine { effect: "harmed".to_owned(), effect_words: "worse".to_owned(), ..late("harmed") };
        let flights = [
            unknown("unknown", "whole"),
            flight("amber", "constant", "whole", vec![alarm("amber", "two"), alarm("grey", "three")]),
            unknown("failed", "failed"),
            flight("red", "constant", "whole", vec![alarm("red", "one")]),
            unknown("companion", "companion"),
            harmed,
        ];
        let expected = "\nneeds attention\n  harmed: worse\n  red: text of one\n  failed: 203 ms late\n  \
            amber: text of two\n  unknown: 203 ms late\n";
        assert_eq!(alarms_text(&flights), expected);
        assert_eq!(companions_text(&flights), "\nnot a flight\n  companion: 203 ms late\n");
        assert_eq!(alarms_text(&[late("a")]) + &companions_text(&[late("a")]), "");

        for (count, last) in [(20, "  20: 203 ms late"), (23, "  and 3 more")] {
            let many = |data: &str| (1..=count).map(|i| unknown(&i.to_string(), data)).collect::<Vec<_>>();
            for text in [alarms_text(&many("whole")), companions_text(&many("companion"))] {
                assert_eq!(text.lines().last(), Some(last));
            }
        }
    }
}
