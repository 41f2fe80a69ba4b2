//! `flightlag diff`: compares two reports, or two pipelines over the same flights.

use crate::arguments::DiffArguments;
use crate::campaign_command::{name_for_shell, pipeline_of, run_context};
use crate::failure::{End, Failure};
use crate::files::write_site;
use crate::listen::listener;
use crate::show::{Table, count, number, visible};
use crate::stop::Stop;
use campaign::{Exit, Order};
use record::{ComparedReport, DiffRecord, Estimate, FlightWords, MovedNumber, NamedFlight, RunChanges};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Maximum number of flights listed in a section; page and JSON list all.
const MOST: usize = 50;

pub(crate) fn run(arguments: &DiffArguments, stop: &Stop) -> Result<End, Failure> {
    let (before, now, exit) = match &arguments.flights {
        Some(flights) => both_pipelines(arguments, flights, stop)?,
        None => {
            refuse_pipelines([&arguments.before, &arguments.now])?;
            (arguments.before.clone(), arguments.now.clone(), Exit::Well)
        }
    };
    let found = history::diff(&before, &now, arguments.out.as_deref())?;
    if let Some(out) = &arguments.out {
        let json = serde_json::to_string_pretty(&found).unwrap_or_default() + "\n";
        write_site(out, &report::diff_site(&found), &[("diff.json", &json)])?;
    }
    let mut stdout = std::io::stdout().lock();
    match arguments.common.json {
        true => writeln!(stdout, "{}", serde_json::to_string(&found).unwrap_or_default())?,
        false if arguments.common.quiet => {}
        false => {
            write!(stdout, "{}", text(&found))?;
            if let Some(out) = &arguments.out {
                writeln!(stdout, "open {}", visible(&out.join("index.html").display().to_string()))?;
            }
        }
    }
    Ok(exit.into())
}

/// Without flights, a pipeline cannot be compared.
fn refuse_pipelines(paths: [&PathBuf; 2]) -> Result<(), Failure> {
    let is_pipeline = |path: &&PathBuf| path.is_file() && path.extension().is_some_and(|ending| ending == "toml");
    match paths.into_iter().find(is_pipeline) {
        Some(path) => Err(Failure::new(
            Exit::Wrong,
            format!("{} is a pipeline: add --flights FOLDER and --out DIR", path.display()),
        )),
        None => Ok(()),
    }
}

/// Runs a campaign with each pipeline, into OUT/first and OUT/second. The exit code is that of the second.
fn both_pipelines(arguments: &DiffArguments, flights: &Path, stop: &Stop) -> Result<(PathBuf, PathBuf, Exit), Failure> {
    let Some(out) = &arguments.out else {
        return Err(Failure::new(
            Exit::Wrong,
            "a comparison of two pipelines needs a folder for both reports: add --out DIR",
        ));
    };
    // Standard output is reserved for the comparison.
    let quiet = crate::arguments::RunArguments {
        quiet: arguments.common.quiet || arguments.common.json,
        json: false,
        ..arguments.common.clone()
    };
    let events = listener(&quiet);
    let (mut reports, mut exit) = (vec![], Exit::Well);
    for (name, pipeline) in [("first", &arguments.before), ("second", &arguments.now)] {
        let order = Order {
            flights: flights.to_owned(),
            out: out.join(name),
            pipeline: pipeline_of(Some(pipeline), None, None)?,
            verify: false,
            replace: false,
            command: format!(
                "flightlag campaign {} --pipeline {} --out REPORT",
                name_for_shell(flights),
                name_for_shell(pipeline)
            ),
            settle: None,
        };
        exit = campaign::run(&order, &run_context(&quiet, stop, events.as_ref()))?.exit();
        reports.push(order.out);
    }
    match reports.as_slice() {
        [before, now] => Ok((before.clone(), now.clone(), exit)),
        _ => Err(Failure::new(Exit::Failed, "a report is missing")),
    }
}

fn text(found: &DiffRecord) -> String {
    let changes = &found.changes;
    let (by_sigmas, by_a_tenth) = changes.moved_counts();
    let (failing, failing_new) = changes.failing_and_new();
    let of_new = if failing_new.is_empty() { String::new() } else { format!(" ({} failing)", failing_new.len()) };
    let mut text = format!("first:  {}\nsecond: {}\n", report_line(&found.before), report_line(&found.now));
    for line in &found.settings {
        text += &format!("  {}\n", visible(line));
    }
    text += &format!(
        "{} in both: {} moved by more than 2 sigma, {} by more than 10 % (uncertainty unknown), {} computed again, {} newly failing; {} only in the second{of_new}, {} only in the first\n",
        count(changes.compared, "flight"),
        count(by_sigmas as u64, "number"),
        by_a_tenth,
        changes.rerun.len(),
        failing.len(),
        changes.new.len(),
        changes.gone.len()
    );
    text + &groups(found) + &moved(changes) + &rerun(changes) + &lists(changes)
}

fn report_line(report: &ComparedReport) -> String {
    let short = |hash: &str| hash.get(..8).unwrap_or(hash).to_owned();
    let criteria = report.criteria_blake3.as_deref().map(|hash| format!(", criteria {}", short(hash)));
    let text = format!(
        "{}: {}, settings \"{}\" ({}){}, flightlag {}, analysis {}",
        report.folder,
        count(report.flights, "flight"),
        report.settings,
        short(&report.settings_blake3),
        criteria.unwrap_or_default(),
        report.flightlag_version,
        report.analysis_version
    );
    visible(&text)
}

/// A number with its expanded uncertainty (k = 2): seconds as milliseconds.
pub(crate) fn with_u(estimate: &Estimate, unit: &str) -> String {
    let (factor, digits) = if unit == "s" { (1e3, 1) } else { (1.0, 3) };
    let value = estimate.value * factor;
    match estimate.standard_uncertainty {
        Some(u) => format!("{value:.digits$} ± {:.digits$}", 2.0 * u * factor),
        None => format!("{value:.digits$}"),
    }
}

fn groups(found: &DiffRecord) -> String {
    let mut table = Table::new(&["group", "first ms|", "second ms|", "sigma|"]);
    for group in found.moved_groups.iter().take(MOST) {
        let (before, now) = (with_u(&group.before_s, "s"), with_u(&group.now_s, "s"));
        table.row(vec![group.name.clone(), before, now, format!("{:.1}", group.sigmas)]);
    }
    section("groups that moved", &table, found.moved_groups.len())
}

fn moved(changes: &RunChanges) -> String {
    let mut table = Table::new(&["flight", "quantity", "first|", "second|", "unit", "sigma|", "because of"]);
    for of in changes.moved.iter().take(MOST) {
        let MovedNumber { flight, quantity, unit, before, now, sigmas, causes } = of;
        let causes: Vec<&str> = causes.iter().map(|cause| cause.word()).collect();
        let shown = if unit == "s" { "ms" } else { unit };
        table.row(vec![
            flight.flight.clone(),
            quantity.clone(),
            with_u(before, unit),
            with_u(now, unit),
            shown.to_owned(),
            sigmas.map_or_else(|| "unknown".to_owned(), |sigmas| format!("{sigmas:+.1}")),
            causes.join(", "),
        ]);
    }
    section(
        "moved by more than 2 sigma, or by more than 10 % where that is unknown (± is U, k = 2)",
        &table,
        changes.moved.len(),
    )
}

fn rerun(changes: &RunChanges) -> String {
    let mut table = Table::new(&["flight", "because of"]);
    for of in changes.rerun.iter().take(MOST) {
        let causes: Vec<&str> = of.causes.iter().map(|cause| cause.word()).collect();
        table.row(vec![of.flight.flight.clone(), causes.join(", ")]);
    }
    section("computed again", &table, changes.rerun.len())
}

fn lists(changes: &RunChanges) -> String {
    let words = |title: &str, all: &[FlightWords]| {
        let has_text = |of: &FlightWords| of.error.is_some() || of.texts.iter().any(|text| !text.is_empty());
        let columns = if all.iter().any(has_text) { 3 } else { 2 };
        let mut table = Table::new(&["flight", "what", "in words"][..columns]);
        for of in all.iter().take(MOST) {
            let texts = of.texts.iter().filter(|text| !text.is_empty()).cloned().collect::<Vec<_>>().join("; ");
            let text = of.error.clone().unwrap_or(texts);
            let row = [of.flight.flight.clone(), of.words.join(", "), text];
            table.row(row.into_iter().take(columns).collect());
        }
        section(title, &table, all.len())
    };
    let millis = |value_s: Option<f64>| value_s.map_or_else(|| "none".to_owned(), |s| number(Some(s * 1e3), 0));
    let mut advice = Table::new(&["flight", "parameter", "first ms|", "second ms|"]);
    for of in changes.advice.iter().take(MOST) {
        advice.row(vec![of.flight.flight.clone(), of.parameter.clone(), millis(of.before_s), millis(of.now_s)]);
    }
    let names = |title: &str, all: &[NamedFlight]| {
        let mut table = Table::new(&["flight"]);
        all.iter().take(MOST).for_each(|flight| table.row(vec![flight.flight.clone()]));
        section(title, &table, all.len())
    };
    let (failing, failing_new) = changes.failing_and_new();
    words("newly failing", &failing)
        + &words("another verdict of the criteria", &changes.verdicts)
        + &section("another value recommended", &advice, changes.advice.len())
        + &words("no longer failing", &changes.recovered_from())
        + &words("new alarms", &changes.alarms_new)
        + &words("alarms cleared", &changes.alarms_cleared)
        + &words("new remarks", &changes.remarks_new)
        + &words("remarks cleared", &changes.remarks_cleared)
        + &names("only in the second", &changes.new)
        + &words("failing, only in the second", &failing_new)
        + &names("only in the first", &changes.gone)
}

/// A titled table with the number of rows not shown; empty if it has no rows.
fn section(title: &str, table: &Table, all: usize) -> String {
    let more = match all.saturating_sub(MOST) {
        0 => String::new(),
        n => format!("  and {n} more; --json and the page of --out have all\n"),
    };
    crate::findings::section(title, table) + &more
}

#[cfg(test)]
mod tests {
    use super::*;
    use record::{ChangeCause, MovedAdvice, MovedDelay, RerunCause};

    fn named(flight: &str) -> NamedFlight {
        NamedFlight { campaign: String::new(), flight: flight.to_owned(), page: None }
    }

    fn words(flight: &str, word: &str) -> FlightWords {
        FlightWords { flight: named(flight), words: vec![word.to_owned()], error: None, texts: vec![] }
    }

    fn estimate(value: f64, standard_uncertainty: Option<f64>) -> Estimate {
        Estimate { value, standard_uncertainty }
    }

    fn compared(folder: &str, flights: u64) -> ComparedReport {
        ComparedReport {
            folder: folder.to_owned(),
            name: folder.to_owned(),
            flights,
            flightlag_version: "1.2".to_owned(),
            analysis_version: 7,
            settings: "usual".to_owned(),
            settings_blake3: "0123456789".to_owned(),
            criteria_blake3: None,
        }
    }

    fn moved_number(flight: &str, unit: &str, sigmas: Option<f64>) -> MovedNumber {
        let u = sigmas.map(|_| 0.01);
        MovedNumber {
            flight: named(flight),
            quantity: "lateness".to_owned(),
            unit: unit.to_owned(),
            before: estimate(0.2, u),
            now: estimate(0.25, u),
            sigmas,
            causes: vec![ChangeCause::Settings, ChangeCause::Build],
        }
    }

    /// The lines of a text, with single blanks.
    fn lines(text: &str) -> Vec<String> {
        text.lines().map(|line| line.split_whitespace().collect::<Vec<_>>().join(" ")).collect()
    }

    #[test]
    fn every_kind_of_change_has_a_titled_section() {
        let alarm = FlightWords { texts: vec!["it drifts".to_owned(), String::new()], ..words("e", "drift") };
        let failed = FlightWords { error: Some("no position".to_owned()), ..words("f", "failed") };
        let found = DiffRecord {
            record_version: 1,
            before: compared("a", 1),
            now: compared("b", 9),
            settings: vec!["delay.position_s: was 0.4, is 0.35".to_owned()],
            changes: RunChanges {
                compared: 6,
                new: vec![named("n"), named("m")],
                gone: vec![named("g")],
                rerun: vec![RerunCause { flight: named("r"), causes: vec![ChangeCause::Log] }],
                moved: vec![moved_number("s", "s", Some(3.54)), moved_number("t", "m", None)],
                failing: vec![failed, words("n", "harmed")],
                recovered: vec![words("h", "harmed")],
                verdicts: vec![words("v", "FAIL → PASS, because of criteria")],
                alarms_new: vec![alarm],
                alarms_cleared: vec![words("i", "steps")],
                remarks_new: vec![words("j", "copy")],
                remarks_cleared: vec![words("k", "short")],
                advice: vec![MovedAdvice {
                    flight: named("p"),
                    parameter: "GPS_DELAY".to_owned(),
                    before_s: None,
                    now_s: Some(0.11),
                }],
                ..RunChanges::default()
            },
            moved_groups: vec![MovedDelay {
                name: "M8".to_owned(),
                before_s: estimate(0.2, Some(0.001)),
                now_s: estimate(0.21, Some(0.001)),
                sigmas: 7.07,
            }],
        };
        let expected = [
            "first: a: 1 flight, settings \"usual\" (01234567), flightlag 1.2, analysis 7",
            "second: b: 9 flights, settings \"usual\" (01234567), flightlag 1.2, analysis 7",
            "delay.position_s: was 0.4, is 0.35",
            "6 flights in both: 1 number moved by more than 2 sigma, 1 by more than 10 % (uncertainty unknown), 1 \
             computed again, 1 newly failing; 2 only in the second (1 failing), 1 only in the first",
            "groups that moved",
            "group first ms second ms sigma",
            "M8 200.0 ± 2.0 210.0 ± 2.0 7.1",
            "moved by more than 2 sigma, or by more than 10 % where that is unknown (± is U, k = 2)",
            "flight quantity first second unit sigma because of",
            "s lateness 200.0 ± 20.0 250.0 ± 20.0 ms +3.5 settings, build",
            "t lateness 0.200 0.250 m unknown settings, build",
            "computed again",
            "flight because of",
            "r log",
            "newly failing",
            "flight what in words",
            "f failed no position",
            "another verdict of the criteria",
            "flight what",
            "v FAIL → PASS, because of criteria",
            "another value recommended",
            "flight parameter first ms second ms",
            "p GPS_DELAY none 110",
            "no longer failing",
            "flight what",
            "h was harmed",
            "new alarms",
            "flight what in words",
            "e drift it drifts",
            "alarms cleared",
            "flight what",
            "i steps",
            "new remarks",
            "flight what",
            "j copy",
            "remarks cleared",
            "flight what",
            "k short",
            "only in the second",
            "flight",
            "n",
            "m",
            "failing, only in the second",
            "flight what",
            "n harmed",
            "only in the first",
            "flight",
            "g",
        ];
        assert_eq!(lines(&text(&found)), expected);
        let same = DiffRecord { settings: vec![], changes: RunChanges::default(), moved_groups: vec![], ..found };
        assert_eq!(lines(&text(&same)).len(), 3, "nothing changed, nothing is listed");
    }

    #[test]
    fn only_a_file_named_toml_is_a_pipeline() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::create_dir(path("report.toml")).unwrap();
        std::fs::write(path("p.toml"), "schema = 1\n").unwrap();
        std::fs::write(path("report"), "").unwrap();
        let refused = |second: &str| refuse_pipelines([&path("report.toml"), &path(second)]).is_err();
        assert_eq!([refused("report"), refused("report.toml"), refused("p.toml")], [false, false, true]);
    }

    #[test]
    fn a_long_section_ends_with_the_number_of_rows_that_only_the_page_has() {
        let changes = |count: usize| RunChanges { gone: vec![named("g"); count], ..RunChanges::default() };
        for (count, last) in [(50, "g"), (53, "and 3 more; --json and the page of --out have all")] {
            let lines = lines(&lists(&changes(count)));
            assert_eq!((lines.len(), lines.last().unwrap().as_str()), (2 + count.min(51), last));
        }
    }
}
