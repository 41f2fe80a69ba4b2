//! Valid and invalid criteria files, and every metric on a record with known numbers.

use super::metric::METRICS;
use super::{Criteria, DEMO_CRITERIA, EXAMPLE_CRITERIA, Takes, row_verdicts};
use record::{CriterionFinding, CriterionVerdict, Estimate, FlightRecord, FlightRow, Limit, VerdictTally};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::Path;

fn parse(text: &str) -> Result<Criteria, super::SettingsError> {
    Criteria::parse(text, Path::new("settings/c.toml"))
}

/// A file with one criterion; its metric is on line 5, the added keys on line 7.
fn one(metric: &str, added: &str) -> String {
    format!(
        "schema = 1\n[[criterion]]\nid = \"a\"\ntitle = \"asked\"\nmetric = \"{metric}\"\nrationale = \"why\"\n{added}\n"
    )
}

/// Parts of a valid file, their replacement, the line of the complaint, and its text.
const SLIPS: [(&str, &str, usize, &str); 9] = [
    ("schema = 1", "schema = 2", 1, "schema must be 1"),
    ("title", "titel", 4, "unknown key `titel`"),
    ("schema = 1", "schema = one", 1, ""),
    ("\"a\"", "\"a b\"", 3, "letters, digits"),
    ("\"asked\"", "\" \"", 4, "state the requirement"),
    ("\"why\"", "\"\"", 6, "justify the limit"),
    ("rationale = \"why\"\n", "", 2, "missing key `rationale`"),
    ("\"delay\"", "\"delays\"", 5, "no metric is called `delays`; did you mean `delay`? known are delay,"),
    ("\"delay\"", "\"speed\"", 5, "known are speed-median"),
];

/// Metrics, the keys added to their criterion, the line of the complaint, and its text.
const WRONG_KEYS: [(&str, &str, usize, &str); 31] = [
    ("delay", "", 2, "needs a limit"),
    ("delay", "at_most = \"1 s\"\nat_least = \"0 s\"", 2, "has only one limit"),
    ("delay", "at_most = 150", 7, "150 has no unit: write a text with a number and one of the units s, ms"),
    ("delay", "at_most = \"150 m\"", 7, "`m` is not a unit"),
    ("delay", "at_most = \"1,5 s\"", 7, "decimal point, not a comma"),
    ("delay", "at_most = \"soon\"", 7, "does not begin with a number"),
    ("delay", "at_most = true", 7, "true is not a limit"),
    ("delay", "between = [\"2 s\", \"1 s\"]", 7, "2 s is not below 1 s"),
    ("delay", "between = [\"2 s\"]", 7, "takes two numbers"),
    ("delay", "at_most = \"1 s\"\ncompensator = \"raw\"", 8, "compensator has no meaning for delay"),
    ("delay", "at_most = \"1 s\"\nchannel = \"gps\"", 8, "`gps` is not a channel"),
    ("delay", "at_most = \"1 s\"\ndecision = \"coin\"", 8, "\"interval\" or \"value\""),
    ("delay", "at_most = \"1 s\"\napplies_to = {}", 8, "applies_to is empty"),
    ("delay", "at_most = \"1 s\"\napplies_to = { flights = [] }", 8, "applies_to.flights needs at least one name"),
    ("delay", "at_most = \"1 s\"\napplies_to = { channels = [\"gps\"] }", 8, "`gps` is not a channel"),
    ("delay", "at_most = \"1 s\"\napplies_to = { reference = false }", 8, "must be true"),
    ("delay", "at_most = \"1 s\"\napplies_to = { duration_at_least = 60 }", 8, "60 has no unit"),
    ("delay", "at_most = \"1 s\"\napplies_to = { planes = [\"x\"] }", 8, "unknown key `planes`"),
    ("error-rms", "at_most = \"1 m\"", 2, "missing key `compensator`"),
    ("error-rms", "at_most = \"1 m\"\ncompensator = \"wishful\"", 8, "no compensator is called \"wishful\""),
    ("error-rms", "at_most = \"-1 m\"\ncompensator = \"raw\"", 7, "no flight can meet this limit"),
    ("valid-share", "between = [\"101 %\", \"120 %\"]", 7, "no flight can meet this limit"),
    ("error-rms", "at_least = \"0 m\"\ncompensator = \"raw\"", 7, "every flight meets this limit"),
    ("error-ratio", "at_most = 1\ncompensator = \"raw\"", 8, "compares with raw"),
    ("channel-rate", "at_least = \"4 Hz\"", 2, "missing key `channel`"),
    ("position-rate", "at_least = \"4 Hz\"\nchannel = \"position.gps\"", 8, "channel has no meaning"),
    ("position-rate", "at_least = \"4 Hz\"\ndecision = \"value\"", 8, "this metric has no uncertainty"),
    ("valid-share", "at_least = \"105 %\"", 7, "from 0 to 100 %"),
    ("valid-share", "at_least = 0.95", 7, "as \"5 %\""),
    ("restarts", "at_most = 1.5", 7, "not a count"),
    ("restarts", "at_most = \"3 Hz\"", 7, "has no unit `Hz`"),
];

fn assert_refused(text: &str, line: usize, says: &str) {
    let error = parse(text).unwrap_err();
    assert_eq!(error.line, Some(line), "{error}\n{text}");
    assert!(error.to_string().starts_with(&format!("settings/c.toml:{line}: ")), "{error}");
    assert!(error.what.contains(says), "{error}\nshould say: {says}");
}

#[test]
fn a_typo_is_rejected_with_its_line_and_the_correct_form() {
    let good = one("delay", "at_most = \"1 s\"");
    for (right, wrong, line, says) in SLIPS {
        assert_refused(&good.replace(right, wrong), line, says);
    }
    let twice = format!("{good}[[criterion]]\nid = \"a\"\ntitle = \"t\"\nmetric = \"delay\"\nrationale = \"r\"\n");
    assert_refused(&format!("{twice}at_most = \"2 s\"\n"), 9, "id \"a\" is already used by the criterion on line 3");
    assert!(parse("schema = 1\n").unwrap_err().what.contains("no [[criterion]] found"));
    assert!(Criteria::read(Path::new("/nowhere/c.toml")).unwrap_err().what.starts_with("cannot be read"));
}

#[test]
fn keys_that_do_not_fit_the_metric_are_rejected_with_line_and_correction() {
    for (metric, keys, line, says) in WRONG_KEYS {
        assert_refused(&one(metric, keys), line, says);
    }
}

#[test]
fn resolved_criteria_resolve_to_themselves() {
    for text in [EXAMPLE_CRITERIA, DEMO_CRITERIA] {
        let criteria = parse(text).unwrap();
        let used = criteria.as_used();
        assert_eq!(parse(&used.toml).unwrap(), criteria);
        assert_eq!(Criteria::of_use(&used).unwrap().as_used(), used);
        assert_eq!(parse(&format!("# a comment\n{text}")).unwrap().as_used().blake3, used.blake3);
    }
    let spelled = one("restarts", "at_most = \"3\"\napplies_to = { duration_at_least = \"1 min\" }");
    let plain = one("restarts", "at_most = 3\napplies_to = { duration_at_least = \"60 s\" }");
    assert_eq!(parse(&spelled).unwrap(), parse(&plain).unwrap());
    assert_ne!(parse(&plain).unwrap().as_used().blake3, parse(&plain.replace("= 3", "= 4")).unwrap().as_used().blake3);
    let paper = one("error-rms", "at_most = \"1 m\"\ncompensator = \"pade-1-1-tustin\"");
    assert!(parse(&paper).unwrap().as_used().toml.contains("compensator = \"pade-1-1\""), "as records name it");
}

fn estimate(value: f64, u: f64) -> Value {
    json!({ "value": value, "standard_uncertainty": u })
}

fn found(value: Value) -> Value {
    json!({ "found": value })
}

fn distribution(least: f64, median: f64, most: f64) -> Value {
    json!({ "min": least, "p01": least, "median": median, "p99": most, "max": most })
}

/// 0.4 s ± 0.01 s (k = 1), 0.38 s before and 0.43 s after the middle, in three windows.
fn measured_delay() -> Value {
    let window =
        |start: f64, value: f64| json!({ "start_s": start, "end_s": start + 10.0, "delay_s": estimate(value, 0.01) });
    let injected = |error: f64| {
        json!({ "injected_s": 0.05, "error_s": estimate(error, 0.005), "interval_95_s": [error - 0.01, error + 0.01],
            "split_s": 15.0 })
    };
    json!({
        "delay_s": estimate(0.4, 0.01), "interval_95_s": [0.379, 0.421], "hessian_s": 0.01, "hac_s": 0.01, "crlb_s": 0.009,
        "smallest_detectable_s": 0.028, "samples": 100, "downweighted_share": 0.0, "rival_s": null, "pieces": [],
        "over_time": [window(0.0, 0.38), window(10.0, 0.43), window(20.0, 0.43)],
        "homogeneity": { "chi2": 9.0, "degrees_of_freedom": 2, "p": 0.01, "largest_step": {
            "at_s": 10.0, "before_s": estimate(0.38, 0.003), "after_s": estimate(0.43, 0.004), "p": 0.02 } },
        "alarm": null, "splits": [], "injections": [injected(0.002), injected(-0.004)],
    })
}

fn pair(kind: &str, first: &str, second: &str, delay: Value) -> Value {
    let excitation = json!({ "samples": 100, "duration_s": 30.0, "pieces": 1, "speed_p95_mps": 20.0, "moving_share": 0.75,
        "unexplained_share": null, "predicted_s": null });
    json!({ "kind": kind, "first": first, "second": second, "meaning": "", "origin": null, "excitation": excitation,
        "delay": delay })
}

fn shifted(by: f64) -> Value {
    let mut delay = measured_delay();
    delay["delay_s"]["value"] = json!(0.4 + by);
    delay["interval_95_s"] = json!([0.379 + by, 0.421 + by]);
    found(delay)
}

fn compensator(name: &str, error: f64) -> Value {
    json!({ "name": name, "title": name, "delay": 0.39, "raw_minus_this_rms_m": estimate(7.0, 0.1),
        "step_at_fix_rms_m": estimate(0.2, 0.01), "error_rms_m": estimate(error, 0.05 * error),
        "error_p95_m": estimate(2.0 * error, 0.1 * error) })
}

fn score(name: &str) -> Value {
    json!({ "name": name,
        "residual_delay": found(json!({ "delay_s": estimate(0.003, 0.002), "interval_95_s": [-0.001, 0.007], "samples": 9,
            "expected_s": estimate(0.0, 0.0) })),
        "lead_s": found(estimate(0.395, 0.004)), "expected_lead_s": 0.39,
        "step_correlation": found(estimate(0.05, 0.03)),
        "hysteresis": found(json!({ "along_m": estimate(0.3, 0.2), "across_m": estimate(0.0, 0.2),
            "expected_along_m": 0.0 })),
        "raw_minus_this_axes_rms_m": [estimate(5.0, 0.1), estimate(5.0, 0.1)],
        "straight": found(json!({ "along_excess_m": estimate(0.0, 0.1), "across_rms_m": estimate(0.04, 0.01),
            "noise_ratio": estimate(1.1, 0.05) })),
        "reference": found(json!({ "rows": 9, "rms_m": estimate(1.0, 0.05), "percentiles_m": [0.8, 1.0, 2.0, 3.0],
            "max_m": 3.5, "along_m": [estimate(0.1, 0.1), estimate(0.9, 0.04)],
            "across_m": [estimate(0.0, 0.1), estimate(0.4, 0.02)], "north_m": [estimate(0.0, 0.1), estimate(0.7, 0.1)],
            "east_m": [estimate(0.0, 0.1), estimate(0.7, 0.1)], "by_speed": [], "bands_rms_m": found(json!([])),
            "residual_delay_s": found(estimate(0.005, 0.001)) })),
        "budget": { "terms": [], "total_m": 0.9, "known_m": 0.9, "measured_m": null },
        "band": found(json!({ "factor": 0.7, "helps_below_hz": 0.5, "halves_below_hz": 0.3, "worse_above_hz": 1.0,
            "delays_s": [0.4, 0.0, 0.39], "motion_share": [0.9, 0.08, 0.02] })),
    })
}

fn replay() -> Value {
    let at = |source: &str, value: f64| json!({ "source": source, "delay_s": estimate(0.38, 0.002), "rms_m": estimate(value, 0.03) });
    let candidate =
        |source: &str, value: f64| json!({ "source": source, "delay_s": found(estimate(value, 0.006)), "words": "" });
    json!({
        "settings": { "delay": 0.39, "delay_uncertainty_s": 0.001, "delay_source": "s", "start": "warm", "bridge_s": 0.8 },
        "pair": { "position": "position.gps", "velocity": "velocity.ekf", "reference": "position.truth" },
        "origin_ns": 0, "clock": "unix", "origin": null,
        "coverage": { "duration_s": 200.0, "rows": 100, "valid_rows": 90, "valid_s": 190.0, "invalid": [],
            "bridged_gaps": 3, "restarts": 1, "fixes": 50, "position_resets": 2, "longest_position_gap_s": 1.25 },
        "speed_mps": distribution(1.0, 17.0, 22.0), "predicted_rms_m": estimate(7.0, 0.1),
        "compensators": [compensator("raw", 8.0), compensator("pade-1-1", 1.0), compensator("exact-async", 0.5)],
        "scores": { "compensators": [score("raw"), score("pade-1-1"), score("exact-async")],
            "predicted_axes_rms_m": [5.0, 5.0], "straight_legs": { "cannot-tell": "" }, "opposite_passes": { "cannot-tell": "" },
            "velocity_delay_s": { "cannot-tell": "" }, "motion": { "cannot-tell": "" }, "bands_hz": [], "speeds_mps": [] },
        "onboard": found(json!({ "channel": "position.onboard", "samples": 9, "compared": 9, "same_stamps": true,
            "tolerance_m": 1e-3, "tolerance_source": "", "start_s": 1.0, "reproduced_by": { "cannot-tell": "" },
            "against": [{ "name": "pade-1-1", "rms_m": 0.006, "p95_m": 0.01, "max_m": 0.02, "start_max_m": null,
                "delay_s": { "cannot-tell": "" } }] })),
        "axes": [], "zoom": null,
        "choice": { "asked": "fixed", "used": "fixed", "why": "", "circular": false,
            "candidates": [candidate("fixed", 0.39), candidate("card", 0.38)] },
        "sweep": { "score": { "error-against": "position.truth" }, "samples": 9, "delay_s": [], "rms_m": [],
            "at": [at("fixed", 0.9), at("card", 0.6)],
            "optimum": found(json!({ "delay_s": estimate(0.402, 0.003), "interval_95_s": [0.395, 0.409],
                "method": "jackknife" })) },
    })
}

fn channel(name: &str, quantity: &str) -> Value {
    json!({ "name": name, "quantity": quantity, "source": { "topic": "t", "type_name": "", "fields": [] }, "absent": [],
        "rows": 100, "used": 80, "rejected": [{ "reason": "r", "count": 20, "first": "row 1" }], "offsets": [], "held": null,
        "stamps": { "kind": "measured", "clock": "unix", "source": "s", "first_ns": 0, "last_ns": 20, "count": 100,
            "rate_hz": 5.0, "steps_s": distribution(0.1, 0.2, 1.5), "gap_count": 1, "gaps": [], "duplicates": 0,
            "back_jumps": 0 } })
}

pub(crate) fn record() -> FlightRecord {
    serde_json::from_value(record_json()).unwrap()
}

fn record_json() -> Value {
    let notice = |severity: &str| json!({ "severity": severity, "code": "c", "place": "", "count": 7, "text": "t" });
    json!({
        "record_version": 1, "analysis_version": 1, "key": "k", "inputs": [],
        "pipeline": { "title": "", "blake3": "", "toml": "" }, "outcome": "compensated",
        "log": { "format": "MCAP", "bytes": { "size": 1000, "decoded": 900, "skipped": 50, "structure": 40, "damaged": 10 },
            "messages": 100, "undecodable": 4, "damage": [], "damage_count": 1, "topics": [], "extras": [] },
        "binding": { "map": "mavros", "why": "", "others": [],
            "channels": [channel("position.gps", "position-geodetic"), channel("velocity.ekf", "velocity-ned")] },
        "replay": replay(),
        "delays": { "pairs": [
            pair("position-against-velocity", "position.gps", "velocity.ekf", found(measured_delay())),
            pair("position-against-velocity", "position.ins", "velocity.ekf", shifted(0.1)),
            pair("velocity-against-acceleration", "velocity.ekf", "attitude.ins + specific-force.imu", shifted(-0.39)),
            pair("position-against-reference", "position.gps", "position.truth", shifted(0.02)),
            pair("velocity-against-reference", "velocity.ekf", "position.truth", shifted(-0.38)),
        ] },
        "lateness": lateness(),
        "notices": [notice("loss"), notice("warning"), notice("warning"), notice("info")],
    })
}

fn lateness() -> Value {
    json!({
        "key": "", "failed": null, "position": "position.gps", "velocity": "velocity.ekf",
        "group": { "name": "", "key": "", "parts": [], "told_by_log": false }, "content": null,
        "kind": "constant", "also": [], "words": "w", "datum": "imu", "against": "imu", "verdict": "consistent",
        "lateness": {
            "channel": "position.gps", "lateness_s": estimate(0.41, 0.008), "model_uncertainty_s": 0.007,
            "interval_95_s": [0.394, 0.426], "part": 0, "datum": "imu", "relative_to": null, "derived": false,
            "weak": false, "at_least_s": null, "filter_not_a_delay": null, "earlier_than_datum": false,
            "against_refused_datum_s": null, "rests_on": null,
        },
        "position_minus_velocity_s": null, "card": null, "speed_rms_mps": 17.0, "lever_arm_s_per_decimetre": null,
        "alarms": [], "advice": { "set": [], "fly": null },
    })
}

/// A number against a reference whose clock is contradicted is no number.
#[test]
fn a_contradicted_reference_gives_no_number() {
    let mut json = record_json();
    let alarm = json!({ "gravity": "amber", "code": "reference-contradicted", "text": "the clock is off" });
    let text = one("error-rms", &any_limit("error-rms"));
    let verdict = |json: &Value| judged(&text, &serde_json::from_value(json.clone()).unwrap());
    assert!(verdict(&json).value.is_some());
    json["lateness"]["alarms"] = json!([alarm]);
    let found = verdict(&json);
    assert_eq!((found.verdict, found.reason.as_str()), (CriterionVerdict::NotEvaluated, "the clock is off"));
    // It has left the replay, and still is a reference.
    json["replay"]["pair"]["reference"] = Value::Null;
    let with_one = format!("{}\napplies_to = {{ reference = true }}", any_limit("error-rms"));
    let found = judged(&one("error-rms", &with_one), &serde_json::from_value(json).unwrap());
    assert_eq!((found.verdict, found.reason.as_str()), (CriterionVerdict::NotEvaluated, "the clock is off"));
}

/// The first pair with this course of its delay.
fn with_course(kind: &str, tested: bool, difference_s: Option<f64>) -> FlightRecord {
    let mut json = record_json();
    json["delays"]["pairs"][0]["varies"] = json!({
        "kind": kind, "words": "w", "level_s": estimate(0.4, 0.002), "level_widening_s": 0.0,
        "constancy": { "tested": tested, "varies": false, "windows": 7, "window_s": 10.0, "limit_s": 0.1, "window_delays": [],
            "difference_s": difference_s.map(|value| estimate(value, 0.01)) },
        "late_fixes": [], "odd_fixes": 0, "bursts": [], "curve": [], "terms": [], "span_s": 0.0, "remarks": [],
        "search_s": [-1.0, 2.0], "edge_hit": false, "advice": "", "fixes_used": 9, "fixes_given": 9,
    });
    serde_json::from_value(json).unwrap()
}

/// Former bug: flights whose delay changes had no number, so that nothing failed; and flights that were not tested passed.
#[test]
fn a_changing_delay_fails_its_limit_and_an_untested_one_has_no_number() {
    let text = one("delay-change", "at_most = \"40 ms\"");
    let queue = judged(&text, &with_course("queues", true, Some(-0.5)));
    assert_eq!((queue.verdict, queue.value.unwrap().value), (CriterionVerdict::Fail, 0.5));
    let untested = judged(&text, &with_course("not-tested", false, None));
    assert_eq!(untested.verdict, CriterionVerdict::NotEvaluated);
    assert!(untested.reason.contains("known in 7 windows"), "{}", untested.reason);
    // Position and velocity that change together, by 60 ms against the IMU.
    let mut json = record_json();
    let against_imu = &mut json["delays"]["pairs"][2]["delay"]["found"];
    against_imu["alarm"] = json!("the delay changes");
    against_imu["homogeneity"]["largest_step"]["before_s"] = estimate(0.1, 0.003);
    against_imu["homogeneity"]["largest_step"]["after_s"] = estimate(0.16, 0.004);
    let together = judged(&text, &serde_json::from_value(json).unwrap());
    assert_eq!(together.verdict, CriterionVerdict::Fail);
    assert!((together.value.unwrap().value - 0.06).abs() < 1e-12, "{together:?}");
    let constant = judged(&text, &with_course("constant", true, None));
    assert!((constant.value.unwrap().value - 0.05).abs() < 1e-12, "the largest step between two windows");
}

/// Former bug: where nothing was removed, a criterion for flights with a reference was not evaluated in flights without.
#[test]
fn a_flight_without_a_reference_is_known_without_a_replay() {
    let text = one("losses", "at_most = 0\napplies_to = { reference = true }");
    let mut json = record_json();
    (json["replay"], json["outcome"], json["reason"]) = (Value::Null, json!("uncompensated"), json!("r"));
    let verdict = |json: &Value| judged(&text, &serde_json::from_value(json.clone()).unwrap()).verdict;
    assert_eq!(verdict(&json), CriterionVerdict::NotEvaluated);
    json["delays"]["pairs"].as_array_mut().unwrap().truncate(3);
    assert_eq!(verdict(&json), CriterionVerdict::NotApplicable);
}

/// The finding of a text with one criterion on a record.
fn judged(text: &str, record: &FlightRecord) -> CriterionFinding {
    let mut findings = parse(text).unwrap().judge("2026-05/f.bag", record).findings;
    assert_eq!(findings.len(), 1);
    findings.remove(0)
}

/// A limit for tests that only examine the number of a metric.
fn any_limit(name: &str) -> String {
    let metric = METRICS.iter().find(|m| m.name == name).unwrap();
    let unit = metric.dimension.units().next().unwrap();
    let limit = if unit.is_empty() { "at_most = 1".to_owned() } else { format!("at_most = \"1 {unit}\"") };
    match metric.takes {
        Takes::Compensator => format!("{limit}\ncompensator = \"pade-1-1\""),
        Takes::Channel => format!("{limit}\nchannel = \"position.gps\""),
        Takes::Nothing | Takes::Pair => limit,
    }
}

/// A value and its 95 % interval, if any.
type Expected = (f64, Option<[f64; 2]>);

const fn around(value: f64, u: f64) -> Expected {
    (value, Some([value - 2.0 * u, value + 2.0 * u]))
}

const fn plain(value: f64) -> Expected {
    (value, None)
}

/// Two places where a step was searched for: the normal quantile of 1 − 0.025/2 is 2.241403.
const STEP: f64 = 2.241_402_727_604_947 * 0.005;

/// Values calculated by hand from the record above, by metric.
const EXPECTED: [(&str, Expected); 51] = [
    ("delay", (0.4, Some([0.379, 0.421]))),
    ("lateness", (0.41, Some([0.394, 0.426]))),
    ("lateness-expanded-uncertainty", plain(0.016)),
    ("delay-varies", plain(0.0)),
    ("velocity-delay", (0.01, Some([-0.011, 0.031]))),
    ("delay-against-reference", (0.42, Some([0.399, 0.441]))),
    ("velocity-delay-against-reference", (0.02, Some([-0.001, 0.041]))),
    // The lateness is 0.41 ± 0.008 and the card's delay 0.38 ± 0.006 (k = 1): √(0.008² + 0.006²) = 0.01, 0.03/0.02 = 1.5.
    ("delay-difference", around(0.03, 0.01)),
    ("delay-normalised-difference", plain(1.5)),
    ("delay-change", (0.05, Some([0.05 - STEP, 0.05 + STEP]))),
    ("delay-expanded-uncertainty", plain(0.02)),
    ("smallest-detectable-delay-change", plain(0.028)),
    ("injection-error", (-0.004, Some([-0.014, 0.006]))),
    ("moving-share", plain(0.75)),
    ("error-rms", around(1.0, 0.05)),
    ("error-p95", around(2.0, 0.1)),
    // 1/8, relative uncertainties 5 % and 5 % added.
    ("error-ratio", around(0.125, 0.0125)),
    ("correction-rms", around(7.0, 0.1)),
    ("step-at-fix-rms", around(0.2, 0.01)),
    ("error-max", plain(3.5)),
    ("along-track-rms", around(0.9, 0.04)),
    ("across-track-rms", around(0.4, 0.02)),
    ("residual-delay", (0.003, Some([-0.001, 0.007]))),
    ("residual-delay-against-reference", around(0.005, 0.001)),
    ("lead-error", around(0.005, 0.004)),
    ("step-correlation", around(0.05, 0.03)),
    ("hysteresis", around(0.3, 0.2)),
    ("straight-across-rms", around(0.04, 0.01)),
    ("straight-noise-ratio", around(1.1, 0.05)),
    ("motion-helped-share", plain(0.9)),
    ("motion-harmed-share", plain(0.02)),
    ("onboard-difference-rms", plain(0.006)),
    ("error-at-bench-value", around(0.6, 0.03)),
    ("delay-of-least-error", (0.402, Some([0.395, 0.409]))),
    ("valid-share", plain(0.95)),
    ("duration", plain(200.0)),
    ("speed-median", plain(17.0)),
    ("longest-position-gap", plain(1.25)),
    ("position-resets", plain(2.0)),
    ("bridged-gaps", plain(3.0)),
    ("restarts", plain(1.0)),
    ("position-rate", plain(5.0)),
    ("velocity-rate", plain(5.0)),
    ("channel-rate", plain(5.0)),
    ("channel-longest-step", plain(1.5)),
    ("channel-used-share", plain(0.8)),
    ("bytes-damaged", plain(10.0)),
    ("damaged-share", plain(0.01)),
    ("messages-undecodable", plain(4.0)),
    ("losses", plain(1.0)),
    ("warnings", plain(2.0)),
];

#[test]
fn every_metric_matches_the_value_calculated_by_hand() {
    let (record, expected) = (record(), BTreeMap::from(EXPECTED));
    let close = |a: f64, b: f64| (a - b).abs() <= 1e-12 * b.abs().max(1.0);
    for metric in METRICS.iter().filter(|m| m.name != "step-at-bench-value") {
        let (value, interval) = expected.get(metric.name).unwrap_or_else(|| panic!("{} is not tested", metric.name));
        // Shares and the like: a limit that is neither always nor never met.
        let text = one(metric.name, &any_limit(metric.name).replace("\"1 %\"", "\"50 %\""));
        let finding = judged(&text, &record);
        let Estimate { value: got, .. } =
            finding.value.unwrap_or_else(|| panic!("{}: {}", metric.name, finding.reason));
        assert!(close(got, *value), "{}: {got}, not {value}", metric.name);
        match (finding.interval_95, interval) {
            (Some(got), Some(wanted)) => {
                assert!(close(got[0], wanted[0]) && close(got[1], wanted[1]), "{}: {got:?}", metric.name);
            }
            (got, wanted) => assert_eq!(got, *wanted, "{}", metric.name),
        }
        assert_eq!(metric.uncertain, interval.is_some(), "{}: the rule follows the number", metric.name);
    }
}

#[test]
fn steps_at_fixes_are_judged_at_the_bench_value_without_a_reference() {
    let mut json = record_json();
    json["replay"]["sweep"]["score"] = json!("step-at-fixes");
    let record: FlightRecord = serde_json::from_value(json).unwrap();
    let finding = judged(&one("step-at-bench-value", "at_most = \"1 m\""), &record);
    assert_eq!(finding.value.unwrap().value, 0.6);
    let error = judged(&one("error-at-bench-value", "at_most = \"1 m\""), &record);
    assert_eq!(error.verdict, CriterionVerdict::NotEvaluated);
}

#[test]
fn a_verdict_follows_from_interval_and_limit_in_the_files_unit() {
    use CriterionVerdict::{Fail, Inconclusive, Pass};
    let record = record();
    for (limit, verdict, margin) in [
        ("at_most = \"421 ms\"", Pass, 0.021),
        ("at_most = \"420.9 ms\"", Inconclusive, 0.0209),
        ("at_most = \"379 ms\"", Inconclusive, -0.021),
        ("at_most = \"378.9 ms\"", Fail, -0.0211),
        ("at_least = \"379 ms\"", Pass, 0.021),
        ("at_least = \"422 ms\"", Fail, -0.022),
        ("between = [\"370 ms\", \"430 ms\"]", Pass, 0.03),
        ("between = [\"390 ms\", \"410 ms\"]", Inconclusive, 0.01),
        ("between = [\"0 ms\", \"300 ms\"]", Fail, -0.1),
        ("at_most = \"399 ms\"\ndecision = \"value\"", Fail, -0.001),
        ("at_most = \"400 ms\"\ndecision = \"value\"", Pass, 0.0),
    ] {
        let finding = judged(&one("delay", limit), &record);
        assert_eq!(finding.verdict, verdict, "{limit}");
        assert!((finding.margin.unwrap() - margin).abs() < 1e-12, "{limit}: {:?}", finding.margin);
        assert_eq!((finding.unit.name.as_str(), finding.unit.si), ("ms", 1e-3));
    }
    let finding = judged(&one("delay", "at_most = \"150 ms\""), &record);
    assert_eq!((finding.limit, finding.quantity.as_str()), (Limit::AtMost(0.15), "Td(position), one pair"));
}

#[test]
fn the_delay_is_judged_with_the_uncertainty_of_the_answer_if_larger() {
    let mut json = record_json();
    json["lateness"]["position_minus_velocity_s"] = estimate(0.402, 0.02);
    let record: FlightRecord = serde_json::from_value(json).unwrap();
    // The pair has 0.379 to 0.421; U of the answer is 2 · 0.02.
    let finding = judged(&one("delay", "at_most = \"421 ms\""), &record);
    assert_eq!(finding.verdict, CriterionVerdict::Inconclusive);
    let finding = judged(&one("delay", "at_most = \"440 ms\""), &record);
    assert_eq!(
        (finding.verdict, finding.value),
        (CriterionVerdict::Pass, Some(Estimate { value: 0.4, standard_uncertainty: Some(0.02) }))
    );
    let other = judged(&one("delay", "at_most = \"521 ms\"\nchannel = \"position.ins\""), &record);
    assert_eq!(other.verdict, CriterionVerdict::Pass, "the answer does not rest on this pair");
}

#[test]
fn a_criterion_can_name_another_pair() {
    let record = record();
    let of = |keys: &str| judged(&one("delay", &format!("at_most = \"1 s\"\n{keys}")), &record);
    assert_eq!(of("channel = \"position.ins\"").value.unwrap().value, 0.5);
    assert_eq!(of("channel = \"position.ins\"").quantity, "Td(position), one pair, position.ins");
    assert_eq!(of("against = \"velocity.ekf\"").value.unwrap().value, 0.4, "the replayed one of two");
    let missing = of("channel = \"position.none\"");
    assert_eq!(missing.verdict, CriterionVerdict::NotEvaluated);
    let rest = missing.reason.strip_prefix("this flight has no pair of position.none; it has ").unwrap();
    assert!(rest.contains("position.ins against "), "{rest}");
}

#[test]
fn facts_of_a_flight_are_known_if_nothing_was_removed() {
    let mut json = record_json();
    json["outcome"] = json!("uncompensated");
    json["reason"] = json!("the position is early");
    json["trial"] = json["replay"].take();
    let record: FlightRecord = serde_json::from_value(json).unwrap();
    let of = |metric: &str| judged(&one(metric, &any_limit(metric)), &record);
    for (metric, value) in
        [("duration", 200.0), ("speed-median", 17.0), ("position-resets", 2.0), ("position-rate", 5.0)]
    {
        assert_eq!(of(metric).value.unwrap().value, value, "{metric}");
    }
    assert!(of("error-rms").reason.contains("nothing was removed"));
}

#[test]
fn without_a_number_nothing_is_evaluated_and_the_reason_is_reported() {
    let verdict = |change: &dyn Fn(&mut Value), metric: &str| {
        let mut json = record_json();
        change(&mut json);
        let finding = judged(&one(metric, &any_limit(metric)), &serde_json::from_value(json).unwrap());
        assert_eq!((finding.value, finding.interval_95, finding.margin), (None, None, None), "{metric}");
        assert_eq!(finding.verdict, CriterionVerdict::NotEvaluated, "{metric}");
        finding.reason
    };
    let straight = |json: &mut Value| json["delays"]["pairs"][0]["delay"] = json!({ "cannot-tell": "straight flight" });
    assert_eq!(verdict(&straight, "delay"), "straight flight");
    let circular = |json: &mut Value| json["replay"]["choice"]["circular"] = json!(true);
    assert!(verdict(&circular, "residual-delay").contains("zero by construction"));
    let relative = |json: &mut Value| json["lateness"]["lateness"]["relative_to"] = json!("velocity.gps");
    for metric in ["lateness", "lateness-expanded-uncertainty", "delay-difference", "delay-normalised-difference"] {
        assert!(verdict(&relative, metric).ends_with("not how late velocity.gps is"), "{metric}");
    }
    let no_reference = |json: &mut Value| {
        json["replay"]["pair"]["reference"] = Value::Null;
        json["replay"]["compensators"][1]["error_rms_m"] = Value::Null;
    };
    assert!(verdict(&no_reference, "error-rms").contains("no reference to score against"));
    let one_window = |json: &mut Value| json["delays"]["pairs"][0]["delay"]["found"]["homogeneity"] = Value::Null;
    assert!(verdict(&one_window, "delay-change").contains("fewer than two time windows"));
    let no_u = |json: &mut Value| {
        json["replay"]["choice"]["candidates"][1]["delay_s"]["found"]["standard_uncertainty"] = Value::Null;
    };
    assert!(verdict(&no_u, "delay-normalised-difference").contains("E_n is not defined"));
    let failed = |json: &mut Value| {
        json["outcome"] = json!("failed");
        json["reason"] = json!("cut at byte 13");
        for part in ["log", "binding", "replay", "delays", "lateness"] {
            json[part] = Value::Null;
        }
        json["notices"] = json!([]);
    };
    for metric in METRICS {
        let reason = match metric.name {
            // A share of 1 % is not a sensible limit for these; the reason is the same.
            name if name.ends_with("-share") => continue,
            name => verdict(&failed, name),
        };
        assert!(reason.contains("cut at byte 13"), "{}: {reason}", metric.name);
    }
}

#[test]
fn an_unknown_uncertainty_decides_nothing_unless_the_file_says_so() {
    let mut json = record_json();
    json["replay"]["compensators"][1]["error_rms_m"]["standard_uncertainty"] = Value::Null;
    let record: FlightRecord = serde_json::from_value(json).unwrap();
    let limit = "at_most = \"2 m\"\ncompensator = \"pade-1-1\"";
    let finding = judged(&one("error-rms", limit), &record);
    assert_eq!(finding.verdict, CriterionVerdict::Inconclusive);
    assert!(finding.reason.contains("no uncertainty"), "{}", finding.reason);
    let finding = judged(&one("error-rms", &format!("{limit}\ndecision = \"value\"")), &record);
    assert_eq!(finding.verdict, CriterionVerdict::Pass);
}

#[test]
fn a_criterion_applies_only_if_all_its_conditions_hold() {
    use CriterionVerdict::{NotApplicable, NotEvaluated, Pass};
    let verdict = |applies: &str, record: &FlightRecord| {
        let text = one("position-rate", &format!("at_least = \"1 Hz\"\napplies_to = {applies}"));
        judged(&text, record).verdict
    };
    let whole = record();
    for (applies, wanted) in [
        ("{ flights = [\"*.bag\"] }", Pass),
        ("{ flights = [\"*.csv\", \"2026-06/*\"] }", NotApplicable),
        ("{ maps = [\"mav*\"] }", Pass),
        ("{ maps = [\"px4*\"] }", NotApplicable),
        ("{ channels = [\"position.gps\", \"velocity.*\"] }", Pass),
        ("{ channels = [\"position.gps\", \"attitude.ins\"] }", NotApplicable),
        ("{ reference = true }", Pass),
        ("{ duration_at_least = \"200 s\" }", Pass),
        ("{ duration_at_least = \"4 min\" }", NotApplicable),
        ("{ flights = [\"*.bag\"], duration_at_least = \"1 h\" }", NotApplicable),
    ] {
        assert_eq!(verdict(applies, &whole), wanted, "{applies}");
    }
    let mut json = record_json();
    json["outcome"] = json!("not-measurable");
    json["reason"] = json!("never moves");
    json["replay"] = Value::Null;
    let parked: FlightRecord = serde_json::from_value(json).unwrap();
    assert_eq!(verdict("{ reference = true }", &parked), NotEvaluated, "unknown reference");
    assert_eq!(verdict("{ flights = [\"*.csv\"], reference = true }", &parked), NotApplicable, "whatever the replay");
}

#[test]
fn a_campaign_counts_flights_by_criterion_and_by_worst_verdict() {
    let criteria = parse(&format!(
        "{}[[criterion]]\nid = \"b\"\ntitle = \"t\"\nmetric = \"restarts\"\nrationale = \"r\"\nat_most = 1\n",
        one("delay", "at_most = \"421 ms\"")
    ))
    .unwrap();
    let flown = |name: &str, delay: f64, restarts: u64| {
        let mut json = record_json();
        let found = shifted(delay - 0.4);
        json["delays"]["pairs"][0]["delay"] = found;
        json["replay"]["coverage"]["restarts"] = json!(restarts);
        row(&criteria, name, json)
    };
    let rows = [flown("pass", 0.4, 0), flown("late", 0.5, 0), flown("unsure", 0.41, 0), flown("both", 0.5, 9)];
    let summary = criteria.summary(&rows);
    let tally = VerdictTally { pass: 1, fail: 2, inconclusive: 1, ..VerdictTally::default() };
    assert_eq!(summary.flights, tally);
    assert_eq!(summary.pass_rate.map(|r| (r.passed, r.judged)), Some((1, 4)));
    assert_eq!(summary.each[0].tally, tally);
    assert_eq!(
        (summary.each[0].limit.as_str(), &summary.each[0].failed),
        ("≤ 421 ms", &vec!["late".into(), "both".into()])
    );
    assert_eq!(summary.each[1].tally, VerdictTally { pass: 3, fail: 1, ..VerdictTally::default() });
    assert!(summary.each.iter().all(|each| each.never_evaluated.is_none()));
}

#[test]
fn a_criterion_for_a_misspelt_channel_is_reported_as_never_evaluated() {
    let criteria = parse(&one("channel-rate", "at_least = \"4 Hz\"\nchannel = \"position.gsp\"")).unwrap();
    let rows = [row(&criteria, "first", record_json()), row(&criteria, "second", record_json())];
    let summary = criteria.summary(&rows);
    let reason = summary.each[0].never_evaluated.as_deref().unwrap();
    assert!(reason.starts_with("this flight has no channel position.gsp; it has position.gps"), "{reason}");
}

/// The row of a flight with the verdicts on its record.
fn row(criteria: &Criteria, name: &str, record: Value) -> FlightRow {
    let judged = criteria.judge(name, &serde_json::from_value(record).unwrap());
    let row = json!({ "flight": name, "key": "", "page": "", "outcome": "compensated", "lossy": false, "format": "",
        "map": null, "bytes": 0, "duration_s": null, "position": null, "velocity": null, "position_rate_hz": null,
        "velocity_rate_hz": null, "speed_median_mps": null, "delay_s": null, "correction_rms_m": null,
        "raw_error_rms_m": null, "pade_error_rms_m": null, "exact_error_rms_m": null, "valid_share": null,
        "attention": [], "warnings": 0, "losses": 0, "criteria": row_verdicts(&judged) });
    serde_json::from_value(row).unwrap()
}
