//! The summary of a night in five lines, as text, JSON, Markdown and JUnit.

use crate::proof::with_u;
use record::{
    ChangeCause, Estimate, FlightWords, MovedNumber, NamedFlight, NightGroup, NightRecord, ProofVerdict, RunChanges,
    SettingProof,
};
use std::collections::BTreeMap;
use std::fmt::Write;

/// Maximum number of names in a line; the page lists all.
const MOST_NAMES: usize = 2;

/// The five lines.
pub(crate) fn lines(record: &NightRecord) -> Vec<String> {
    vec![night(record), moved(&record.changes), failing(&record.changes), alarms(record), settings(record)]
}

/// How the night went.
fn night(record: &NightRecord) -> String {
    let flights: u64 = record.campaigns.iter().filter_map(|c| c.totals.as_ref()).map(|t| t.flights).sum();
    let changes = &record.changes;
    let mut parts = vec![
        counted(record.campaigns.len(), "campaign"),
        counted(usize::try_from(flights).unwrap_or(usize::MAX), "flight"),
        format!("{} new", changes.new.len()),
        rerun(changes),
        format!("{} gone", changes.gone.len()),
        format!("{} left for the next night", record.left.len()),
    ];
    let of = |count: fn(&record::CampaignTotals) -> u64| -> usize {
        let sum: u64 = record.campaigns.iter().filter_map(|c| c.totals.as_ref()).map(count).sum();
        usize::try_from(sum).unwrap_or(usize::MAX)
    };
    // Why the exit code is 3, even if nothing is new.
    for (count, what) in [(of(|t| t.failed), "failed log"), (of(|t| t.lossy), "damaged log")] {
        parts.extend((count > 0).then(|| counted(count, what)));
    }
    let failed = record.campaigns.iter().filter(|c| c.error.is_some());
    parts.extend(
        failed.map(|c| format!("CAMPAIGN {} FAILED: {}", c.name, first_line(c.error.as_deref().unwrap_or_default()))),
    );
    if !record.problems.is_empty() {
        parts.push(format!("{}: {}", counted(record.problems.len(), "PROBLEM"), first_line(&record.problems[0])));
    }
    format!("{} {}: exit {}; {}", record.title, record.run_id, record.exit, parts.join(", "))
}

/// `3 rerun (log 1, settings 2)`.
fn rerun(changes: &RunChanges) -> String {
    let mut counts: BTreeMap<ChangeCause, usize> = BTreeMap::new();
    changes.rerun.iter().flat_map(|rerun| &rerun.causes).for_each(|cause| *counts.entry(*cause).or_default() += 1);
    let causes: Vec<String> = counts.iter().map(|(cause, count)| format!("{} {count}", cause.word())).collect();
    let causes = if causes.is_empty() { String::new() } else { format!(" ({})", causes.join(", ")) };
    format!("{} rerun{causes}", changes.rerun.len())
}

fn moved(changes: &RunChanges) -> String {
    let (by_sigmas, by_a_tenth) = changes.moved_counts();
    let most = |first: usize| changes.moved.get(first).map(moved_words).unwrap_or_default();
    let known = match by_sigmas {
        0 => format!("Moved by more than 2 sigma: none of {} compared", changes.compared),
        n => format!("Moved by more than 2 sigma: {n}; the most: {}", most(0)),
    };
    match by_a_tenth {
        0 => known,
        n => format!("{known}; by more than 10 %, uncertainty unknown: {n}: {}", most(by_sigmas)),
    }
}

/// `uav-1/a.bin lateness 118.0 ± 4.0 → 131.0 ± 4.0 ms (+4.6 sigma; log)`.
fn moved_words(moved: &MovedNumber) -> String {
    let causes: Vec<&str> = moved.causes.iter().map(|cause| cause.word()).collect();
    let causes = if causes.is_empty() { "cause unknown".to_owned() } else { causes.join(", ") };
    let (name, quantity) = (flight_name(&moved.flight), &moved.quantity);
    let (before, now) = (in_unit(&moved.before, &moved.unit), in_unit(&moved.now, &moved.unit));
    let by = moved.sigmas.map(|sigmas| format!("{sigmas:+.1} sigma; ")).unwrap_or_default();
    format!("{name} {quantity} {before} → {now} ({by}{causes})")
}

/// A number with its expanded uncertainty: seconds as milliseconds.
pub(crate) fn in_unit(estimate: &Estimate, unit: &str) -> String {
    match (unit, estimate.standard_uncertainty) {
        ("s", _) => with_u(estimate),
        (_, Some(u)) => format!("{:.3} ± {:.3} {unit}", estimate.value, 2.0 * u),
        (_, None) => format!("{:.3} {unit}", estimate.value),
    }
}

fn failing(changes: &RunChanges) -> String {
    let recovered = format!("no longer failing: {}", changes.recovered.len());
    let recovered = match changes.verdicts.as_slice() {
        [] => recovered,
        [first, ..] => format!(
            "{recovered}; another verdict of the criteria: {}: {} {}",
            changes.verdicts.len(),
            flight_name(&first.flight),
            first.words.join(", ")
        ),
    };
    let recovered = match changes.new_not_measurable.len() {
        0 => recovered,
        n => format!("{recovered}; {n} of the new flights cannot be measured"),
    };
    if changes.failing.is_empty() {
        return format!("Newly failing: none; {recovered}");
    }
    let named: Vec<String> = changes.failing.iter().take(MOST_NAMES).map(failing_words).collect();
    let more = match changes.failing.len().saturating_sub(MOST_NAMES) {
        0 => String::new(),
        n => format!("; and {n} more"),
    };
    format!("Newly failing: {}: {}{more}; {recovered}", changes.failing.len(), named.join("; "))
}

/// `uav-1/a.bin: failed: first line of the error`.
pub(crate) fn failing_words(failing: &FlightWords) -> String {
    let error = failing.error.as_deref().map(|error| format!(": {}", first_line(error))).unwrap_or_default();
    format!("{}: {}{error}", flight_name(&failing.flight), failing.words.join(", "))
}

fn alarms(record: &NightRecord) -> String {
    let mut codes: BTreeMap<&str, usize> = BTreeMap::new();
    let new = &record.changes.alarms_new;
    new.iter().flat_map(|of| &of.words).for_each(|code| *codes.entry(code).or_default() += 1);
    let codes: Vec<String> = codes.iter().map(|(code, count)| format!("{code} {count}")).collect();
    let codes = if codes.is_empty() { String::new() } else { format!(" ({})", codes.join(", ")) };
    let trend = match record.new_trend_changes.as_slice() {
        [] => match record.withdrawn_trend_changes.as_slice() {
            [] => "no new change".to_owned(),
            [first, ..] => format!(
                "CHANGE WITHDRAWN of {}: {} at {}",
                first.chart,
                with_u(&first.change.step_s),
                flight_name(&first.change.at)
            ),
        },
        [first, rest @ ..] => {
            let more = if rest.is_empty() { String::new() } else { format!(" and {} more", rest.len()) };
            let with = if first.change.with_it.is_empty() {
                String::new()
            } else {
                format!(" ({})", first.change.with_it.join(", "))
            };
            let at = flight_name(&first.change.at);
            format!("NEW CHANGE of {}: {} at {at}{with}{more}", first.chart, with_u(&first.change.step_s))
        }
    };
    let (cleared, remarks) = (count(&record.changes.alarms_cleared), count(&record.changes.remarks_new));
    let groups = groups(&record.groups);
    format!("Alarms: {} new{codes}, {cleared} cleared; remarks: {remarks} new; trend: {trend}{groups}", count(new))
}

/// Total number of alarms or remarks: a flight may have several.
fn count(all: &[FlightWords]) -> usize {
    all.iter().map(|of| of.words.len()).sum()
}

/// `; 1 GROUP WHOSE FLIGHTS DIFFER: uav u-blox: …`.
fn groups(all: &[NightGroup]) -> String {
    let new: Vec<&NightGroup> = all.iter().filter(|group| group.is_new).collect();
    match (new.as_slice(), all.len()) {
        ([], 0) => String::new(),
        ([], n) => format!("; groups whose flights differ: {n}, none new"),
        ([first, ..], n) => format!(
            "; groups whose flights differ: {n}, {} NEW: {} {}: {}",
            new.len(),
            first.campaign,
            first.group,
            first.words
        ),
    }
}

fn settings(record: &NightRecord) -> String {
    let moved = match record.changes.advice.len() {
        0 => String::new(),
        n => format!(" Another value is recommended for {}.", counted(n, "flight")),
    };
    if record.proofs.is_empty() {
        return format!(
            "Settings: no parameter change is recommended or awaits proof{}",
            if moved.is_empty() { "" } else { "." }.to_owned() + &moved
        );
    }
    let mut proofs: Vec<&SettingProof> = record.proofs.iter().collect();
    proofs.sort_by_key(|proof| proof.verdict);
    let named: Vec<String> = proofs.iter().take(MOST_NAMES).map(|proof| proof_words(proof)).collect();
    let more = match proofs.len().saturating_sub(MOST_NAMES) {
        0 => String::new(),
        n => format!("; and {n} more"),
    };
    format!("Settings: {}{more}{moved}", named.join("; "))
}

/// `GPS1_DELAY_MS of uav-1, D9: PASS: Set from 220 ms to 118 ms. …`.
pub(crate) fn proof_words(proof: &SettingProof) -> String {
    format!("{} of {} {}: {}: {}", proof.parameter, proof.campaign, proof.of, proof.verdict.word(), proof.words)
}

/// The five lines as a text file.
pub(crate) fn text(record: &NightRecord) -> String {
    record.summary.iter().map(|line| one_line(line) + "\n").collect()
}

/// The five lines and the underlying counts.
pub(crate) fn json(record: &NightRecord) -> String {
    let changes = &record.changes;
    let value = serde_json::json!({
        "run_id": record.run_id,
        "exit": record.exit,
        "lines": record.summary,
        "new": changes.new.len(),
        "rerun": changes.rerun.len(),
        "gone": changes.gone.len(),
        "left": record.left.len(),
        "moved": changes.moved_counts().0,
        "moved_uncertainty_unknown": changes.moved_counts().1,
        "failing": changes.failing.len(),
        "new_not_measurable": changes.new_not_measurable.len(),
        "recovered": changes.recovered.len(),
        "verdicts_changed": changes.verdicts.len(),
        "alarms_new": count(&changes.alarms_new),
        "alarms_cleared": count(&changes.alarms_cleared),
        "remarks_new": count(&changes.remarks_new),
        "groups_whose_flights_differ": record.groups.len(),
        "advice_moved": changes.advice.len(),
        "new_trend_changes": record.new_trend_changes.len(),
        "withdrawn_trend_changes": record.withdrawn_trend_changes.len(),
        "proofs_failed": record.proofs.iter().filter(|proof| proof.verdict == ProofVerdict::Fail).count(),
        "problems": record.problems.len(),
    });
    format!("{value:#}\n")
}

/// The five lines as a list. Names from logs are escaped.
pub(crate) fn markdown(record: &NightRecord) -> String {
    record.summary.iter().map(|line| format!("- {}\n", escaped_markdown(&one_line(line)))).collect()
}

fn escaped_markdown(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        if "\\`*_{}[]<>#|~!".contains(c) {
            escaped.push('\\');
        }
        escaped.push(c);
    }
    escaped
}

/// The night for a build server: one test for each campaign, each new trouble, each change of a trend that is new or
/// withdrawn, each problem and each setting.
pub(crate) fn junit(record: &NightRecord) -> String {
    let mut cases = Cases::default();
    for campaign in &record.campaigns {
        let failed = campaign.error.clone().or_else(|| match campaign.exit {
            0 => None,
            code => Some(format!("exit code {code}")),
        });
        cases.add("campaign", &campaign.name, failed.as_deref());
    }
    for failing in &record.changes.failing {
        cases.add("newly failing", &flight_name(&failing.flight), Some(&failing_words(failing)));
    }
    for group in record.groups.iter().filter(|group| group.is_new) {
        cases.add("group whose flights differ", &format!("{} {}", group.campaign, group.group), Some(&group.words));
    }
    for new in &record.new_trend_changes {
        let what = format!("{} at {}", with_u(&new.change.step_s), flight_name(&new.change.at));
        cases.add("trend", &format!("{} at {}", new.chart, flight_name(&new.change.at)), Some(&what));
    }
    for old in &record.withdrawn_trend_changes {
        let name = format!("{} at {}", old.chart, flight_name(&old.change.at));
        let what = format!("{} of the previous night is no longer found", with_u(&old.change.step_s));
        cases.add("trend change withdrawn", &name, Some(&what));
    }
    for proof in &record.proofs {
        let name = format!("{} of {} {}", proof.parameter, proof.campaign, proof.of);
        match proof.verdict {
            ProofVerdict::Pass => cases.add("setting", &name, None),
            ProofVerdict::Fail => cases.add("setting", &name, Some(&proof.words)),
            ProofVerdict::CannotTell => cases.skip("setting", &name, &proof.words),
            // A setting may be tested while another value is recommended for it.
            ProofVerdict::NotSet => cases.skip("recommendation", &name, &proof.words),
        }
    }
    for left in &record.left {
        cases.skip("left for the next night", &format!("{}/{}", left.campaign, left.path), &left.reason);
    }
    for (problem, number) in record.problems.iter().zip(1..) {
        cases.add("night", &format!("problem {number}"), Some(problem));
    }
    cases.document(record)
}

/// Tests of a JUnit file.
#[derive(Default)]
struct Cases {
    xml: String,
    tests: u32,
    failures: u32,
    skipped: u32,
}

impl Cases {
    fn add(&mut self, class: &str, name: &str, failure: Option<&str>) {
        self.tests += 1;
        let (class, name) = (escaped_xml(class), escaped_xml(name));
        let _ = match failure {
            None => writeln!(self.xml, "  <testcase classname=\"{class}\" name=\"{name}\"/>"),
            Some(what) => {
                self.failures += 1;
                let (first, what) = (escaped_xml(first_line(what)), escaped_xml(what));
                writeln!(
                    self.xml,
                    "  <testcase classname=\"{class}\" name=\"{name}\"><failure message=\"{first}\">{what}</failure></testcase>"
                )
            }
        };
    }

    fn skip(&mut self, class: &str, name: &str, why: &str) {
        self.tests += 1;
        self.skipped += 1;
        let (class, name, why) = (escaped_xml(class), escaped_xml(name), escaped_xml(first_line(why)));
        let _ = writeln!(
            self.xml,
            "  <testcase classname=\"{class}\" name=\"{name}\"><skipped message=\"{why}\"/></testcase>"
        );
    }

    fn document(&self, record: &NightRecord) -> String {
        let Cases { xml, tests, failures, skipped } = self;
        let (name, at, seconds) = (escaped_xml(&record.title), escaped_xml(&record.started), record.seconds);
        let lines: String = record.summary.iter().map(|line| escaped_xml(&one_line(line)) + "\n").collect();
        format!(
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuite name=\"{name}\" timestamp=\"{at}\" time=\"{seconds:.3}\" \
             tests=\"{tests}\" failures=\"{failures}\" errors=\"0\" skipped=\"{skipped}\">\n{xml}  <system-out>{lines}</system-out>\n</testsuite>\n"
        )
    }
}

/// A text in XML: characters not allowed in XML 1.0 become `?`.
fn escaped_xml(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\n' | '\t' => escaped.push(' '),
            c if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') => escaped.push('?'),
            c => escaped.push(c),
        }
    }
    escaped
}

fn first_line(text: &str) -> &str {
    text.lines().next().unwrap_or_default()
}

/// A line without characters that start another line or control a terminal.
fn one_line(text: &str) -> String {
    text.chars().map(|c| if c.is_control() || matches!(c, '\u{2028}' | '\u{2029}') { ' ' } else { c }).collect()
}

/// `1 flight`, `2 flights`.
fn counted(n: usize, what: &str) -> String {
    if n == 1 { format!("1 {what}") } else { format!("{n} {what}s") }
}

/// The name of a flight, as text.
pub(crate) fn flight_name(flight: &NamedFlight) -> String {
    if flight.campaign.is_empty() { flight.flight.clone() } else { format!("{}/{}", flight.campaign, flight.flight) }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use record::{LeftLog, NightCampaign, RECORD_VERSION, TrendRecord};

    pub(crate) fn night() -> NightRecord {
        let campaign = NightCampaign {
            name: "uav".into(),
            flights: "/logs/uav".into(),
            report: "uav/index.html".into(),
            totals: None,
            criteria_failed: 0,
            exit: 3,
            error: None,
            nothing_changed: false,
        };
        let mut record = NightRecord {
            record_version: RECORD_VERSION,
            title: "Night".into(),
            run_id: "2026-11-25T220000Z".into(),
            started: "2026-11-25T22:00:00Z".into(),
            seconds: 1.5,
            flightlag_version: "0.1.0".into(),
            before: None,
            exit: 3,
            summary: vec![],
            campaigns: vec![campaign],
            changes: changes(),
            groups: vec![],
            left: vec![LeftLog { campaign: "uav".into(), path: "w.bin".into(), reason: "still being written".into() }],
            new_trend_changes: vec![],
            withdrawn_trend_changes: vec![],
            trend: TrendRecord::default(),
            proofs: vec![],
            problems: vec![],
        };
        record.summary = lines(&record);
        record
    }

    /// One flight is new, one moved, and one fails.
    fn changes() -> RunChanges {
        let named = |flight: &str| NamedFlight { campaign: "uav".into(), flight: flight.into(), page: None };
        let estimate = |value: f64| Estimate { value, standard_uncertainty: Some(0.002) };
        RunChanges {
            compared: 9,
            new: vec![named("n.bin")],
            moved: vec![MovedNumber {
                flight: named("m.bin"),
                quantity: "lateness".into(),
                unit: "s".into(),
                before: estimate(0.118),
                now: estimate(0.131),
                sigmas: Some(4.6),
                causes: vec![ChangeCause::Log],
            }],
            failing: vec![FlightWords {
                flight: named("<b>&.bin"),
                words: vec!["failed".into()],
                error: Some("b.bin: byte 12: no frame".into()),
                texts: vec![],
            }],
            ..RunChanges::default()
        }
    }

    #[test]
    fn the_summary_has_five_lines_with_the_essentials() {
        let text = text(&night());
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(
            lines,
            [
                "Night 2026-11-25T220000Z: exit 3; 1 campaign, 0 flights, 1 new, 0 rerun, 0 gone, 1 left for the next night",
                "Moved by more than 2 sigma: 1; the most: uav/m.bin lateness 118.0 ± 4.0 ms → 131.0 ± 4.0 ms (+4.6 sigma; log)",
                "Newly failing: 1: uav/<b>&.bin: failed: b.bin: byte 12: no frame; no longer failing: 0",
                "Alarms: 0 new, 0 cleared; remarks: 0 new; trend: no new change",
                "Settings: no parameter change is recommended or awaits proof",
            ]
        );
    }

    #[test]
    fn a_number_without_uncertainty_has_no_sigmas() {
        let mut night = night();
        let known = night.changes.moved.clone();
        let unsure = MovedNumber {
            quantity: "error after compensation".into(),
            unit: "m".into(),
            before: Estimate { value: 0.029, standard_uncertainty: None },
            now: Estimate { value: 0.035, standard_uncertainty: None },
            sigmas: None,
            ..known[0].clone()
        };
        night.changes.moved = vec![unsure.clone()];
        let words =
            "by more than 10 %, uncertainty unknown: 1: uav/m.bin error after compensation 0.029 m → 0.035 m (log)";
        assert_eq!(moved(&night.changes), format!("Moved by more than 2 sigma: none of 9 compared; {words}"));
        night.changes.moved = vec![known[0].clone(), unsure];
        let both = moved(&night.changes);
        assert!(
            both.starts_with("Moved by more than 2 sigma: 1; the most: uav/m.bin lateness") && both.ends_with(words)
        );
    }

    #[test]
    fn names_from_logs_are_escaped() {
        let junit = junit(&night());
        assert!(junit.contains("name=\"uav/&lt;b&gt;&amp;.bin\""), "{junit}");
        assert!(junit.contains("tests=\"3\" failures=\"2\" errors=\"0\" skipped=\"1\""), "{junit}");
        let markdown = markdown(&night());
        assert!(markdown.contains("uav/\\<b\\>&.bin") && markdown.lines().count() == 5, "{markdown}");
        assert_eq!(escaped_xml("a\u{1b}[0m\u{0}"), "a?[0m?");
    }

    #[test]
    fn junit_case_names_are_unique() {
        let proof = |verdict, words: &str| SettingProof {
            campaign: "uav".into(),
            of: "D9".into(),
            parameter: "GPS1_DELAY_MS".into(),
            recommended_by: "2026-11-24T220000Z".into(),
            was_s: Some(0.22),
            recommended_s: 0.118,
            set_s: None,
            before_s: None,
            predicted_s: Estimate { value: 0.0, standard_uncertainty: Some(0.002) },
            measured_s: None,
            flights: vec![],
            verdict,
            words: words.into(),
        };
        let proofs = vec![proof(ProofVerdict::Fail, "did not"), proof(ProofVerdict::NotSet, "is open")];
        let night = NightRecord { proofs, problems: vec!["one".into(), "two".into()], ..night() };
        let junit = junit(&night);
        let mut names: Vec<&str> = junit.lines().filter_map(|line| line.trim().strip_prefix("<testcase ")).collect();
        names.iter_mut().for_each(|line| *line = line.split_once('>').unwrap().0.trim_end_matches('/'));
        let all = names.len();
        names.sort_unstable();
        names.dedup();
        assert_eq!((names.len(), all), (7, 7), "{junit}");
    }

    #[test]
    fn the_json_summary_has_the_lines_and_the_counts() {
        let value: serde_json::Value = serde_json::from_str(&json(&night())).unwrap();
        assert_eq!(value["lines"].as_array().unwrap().len(), 5);
        assert_eq!((&value["moved"], &value["left"]), (&1.into(), &1.into()));
    }
}
