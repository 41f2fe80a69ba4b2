//! Compares two sets of rows: what is new, what moved, what fails now, and why.

use crate::brief::PageOf;
use crate::change_points::own_part;
use crate::dataset::Latest;
use crate::row::Row;
use flight::{Alarm, Code, Gravity};
use record::{
    ChangeCause, CriterionVerdict, Estimate, FlightWords, MovedAdvice, MovedNumber, NamedFlight, RerunCause, RunChanges,
};
use std::collections::{BTreeMap, BTreeSet};

/// Trouble of a flight whose delay cannot be measured.
const NOT_MEASURABLE: &str = "not measurable";
/// Key of the answer of a flight among its texts.
pub(crate) const ANSWER: &str = "answer";
pub(crate) const FAILED: &str = "failed";
const PENDING: &str = "pending";
const DAMAGED: &str = "log damaged";
pub(crate) const HARMED: &str = "harmed";
/// Trouble of a flight from which a delay used to be removed.
const NOTHING_REMOVED: &str = "nothing is removed any more";
/// A number counts as moved beyond this many standard uncertainties.
const MOVED_SIGMAS: f64 = 2.0;
/// A number of unknown uncertainty counts as moved if it changed by more than this fraction.
const MOVED_SHARE: f64 = 0.1;
/// Recommended values closer than this are equal, s: parameters are whole milliseconds.
const SAME_ADVICE_S: f64 = 0.5e-3;

/// Full texts of alarms and troubles, and the answer, by campaign and flight, then by code or trouble: rows contain only
/// the latter.
pub type Texts = BTreeMap<(String, String), BTreeMap<String, String>>;

/// Compares rows with the latest earlier ones; `texts` are of these rows. Flights that have disappeared are not in the
/// rows: the caller knows them.
#[must_use]
pub fn compare(before: &Latest, now: &[Row], texts: &Texts, page: PageOf<'_>) -> RunChanges {
    let mut changes = RunChanges::default();
    for row in now {
        let name = (row.campaign.clone(), row.flight.clone());
        let flight = Flight { row, named: name_of(row, page), texts: texts.get(&name) };
        let Some(was) = before.get(&name) else {
            new_flight(&mut changes, flight);
            continue;
        };
        let named = &flight.named;
        changes.compared += 1;
        let causes = causes(was, row);
        if was.key != row.key {
            changes.rerun.push(RerunCause { flight: named.clone(), causes: of_result(&causes) });
        }
        changes.moved.extend(moved(was, row, named, &causes));
        changes.advice.extend(moved_advice(was, row, named));
        came_and_went(&mut changes, was, &flight);
        let verdict = verdict(was, &flight, &changes, &causes);
        changes.verdicts.extend(verdict);
    }
    let size = |m: &MovedNumber| m.sigmas.map_or(-1.0, f64::abs);
    changes.moved.sort_by(|a, b| size(b).total_cmp(&size(a)));
    // Guessed columns are the least of alarms, and the most frequent.
    changes.alarms_new.sort_by_key(|of| of.words.iter().all(|word| word == Code::BoundByGuess.name()));
    changes
}

/// The current state of a flight.
struct Flight<'a> {
    row: &'a Row,
    named: NamedFlight,
    texts: Option<&'a BTreeMap<String, String>>,
}

impl Flight<'_> {
    /// The text of an alarm or a trouble.
    fn text(&self, word: &str) -> Option<&str> {
        match word {
            FAILED | NOT_MEASURABLE | PENDING | NOTHING_REMOVED => self.row.reason.as_deref(),
            DAMAGED => self.texts?.get(Alarm::LogDamaged.name()).map(String::as_str),
            word => self.texts?.get(word).map(String::as_str),
        }
    }

    fn words(&self, words: Vec<String>, error: Option<&str>, texts: Vec<String>) -> Option<FlightWords> {
        let error = error.and_then(|error| error.lines().next()).map(str::to_owned);
        (!words.is_empty()).then(|| FlightWords { flight: self.named.clone(), words, error, texts })
    }

    /// Troubles with the first reason available. A reason does not repeat its trouble.
    fn failing(&self, troubles: Vec<String>) -> Option<FlightWords> {
        let of = |trouble: &String| {
            let text = self.text(trouble)?;
            Some(text.strip_prefix(&format!("{trouble}: ")).unwrap_or(text).to_owned())
        };
        let error = troubles.iter().find_map(of);
        self.words(troubles, error.as_deref(), vec![])
    }

    /// Alarms with their texts.
    fn alarming(&self, codes: Vec<String>) -> Option<FlightWords> {
        let texts = codes.iter().map(|code| self.text(code).unwrap_or_default().to_owned()).collect();
        self.words(codes, None, texts)
    }

    /// Words without a reason.
    fn plain(&self, words: Vec<String>) -> Option<FlightWords> {
        self.words(words, None, vec![])
    }
}

/// A flight with its page.
fn name_of(row: &Row, page: PageOf<'_>) -> NamedFlight {
    NamedFlight { campaign: row.campaign.clone(), flight: row.flight.clone(), page: page(&row.campaign, &row.page) }
}

/// A new flight. One that cannot be measured never could: that is not a failure.
fn new_flight(changes: &mut RunChanges, flight: Flight<'_>) {
    let (cannot, troubles): (Vec<String>, _) =
        troubles(flight.row).into_iter().partition(|what| what == NOT_MEASURABLE);
    changes.failing.extend(flight.failing(troubles));
    let (alarms, remarks) = codes(flight.row);
    changes.alarms_new.extend(flight.alarming(alarms));
    changes.remarks_new.extend(flight.plain(remarks));
    changes.new_not_measurable.extend(cannot.first().map(|_| flight.named.clone()));
    changes.new_answers.push(flight.text(ANSWER).unwrap_or_default().to_owned());
    changes.new.push(flight.named);
}

/// Troubles and alarms that appeared or disappeared.
fn came_and_went(changes: &mut RunChanges, was: &Row, flight: &Flight<'_>) {
    let row = flight.row;
    let only = |of: &[String], not: &[String]| of.iter().filter(|t| !not.contains(t)).cloned().collect::<Vec<_>>();
    let (had, mut has) = (troubles(was), troubles(row));
    if was.removed_s.is_some() && row.removed_s.is_none() && has.is_empty() {
        has.push(NOTHING_REMOVED.to_owned());
    }
    changes.failing.extend(flight.failing(only(&has, &had)));
    // A flight that now fails for another reason has not recovered.
    if has.is_empty() {
        // Without a judgement by the same criteria, recovery is unknown.
        let same_criteria = was.criteria_hash == row.criteria_hash;
        let lost = only(&had, &has).into_iter().filter(|what| same_criteria || !is_criterion(what)).collect();
        changes.recovered.extend(flight.plain(lost));
    }
    let ((had, had_remarks), (has, has_remarks)) = (codes(was), codes(row));
    changes.alarms_new.extend(flight.alarming(only(&has, &had)));
    changes.remarks_new.extend(flight.plain(only(&has_remarks, &had_remarks)));
    // A flight that could not be read shows neither that an alarm is gone nor that it persists.
    if row.outcome != FAILED {
        changes.alarms_cleared.extend(flight.plain(only(&had, &has)));
        changes.remarks_cleared.extend(flight.plain(only(&had_remarks, &has_remarks)));
    }
}

/// Codes of the alarms of a flight that require action, and of its remarks, each once.
fn codes(row: &Row) -> (Vec<String>, Vec<String>) {
    let codes: BTreeSet<String> = row.alarm_codes().map(str::to_owned).collect();
    codes.into_iter().partition(|code| !is_remark(code))
}

/// Whether a code is one of the catalogue's remarks. A code of an older release counts as an alarm.
fn is_remark(code: &str) -> bool {
    Alarm::ALL.iter().any(|alarm| alarm.name() == code && alarm.gravity() == Gravity::Grey)
}

/// Another verdict of the criteria: `FAIL → PASS, because of criteria`. A criterion that newly fails is listed already,
/// and so is one that failed and now passes. A flight that could not be read was not judged.
fn verdict(was: &Row, flight: &Flight<'_>, changes: &RunChanges, causes: &[ChangeCause]) -> Option<FlightWords> {
    let row = flight.row;
    let of_criterion = |of: &FlightWords| of.flight == flight.named && of.words.iter().any(|what| is_criterion(what));
    let has_recovered = row.criteria.as_deref() == Some(CriterionVerdict::Pass.word())
        && changes.recovered.last().is_some_and(of_criterion);
    let is_listed = has_recovered || changes.failing.last().is_some_and(of_criterion);
    if was.criteria.is_none() || was.criteria == row.criteria || row.outcome == FAILED || is_listed {
        return None;
    }
    // As the pages write it: `NOT EVALUATED`.
    let name = |verdict: &Option<String>| match verdict {
        Some(word) => word.replace('-', " ").to_uppercase(),
        None => "no criteria".to_owned(),
    };
    let causes: Vec<&str> = causes.iter().map(|cause| cause.word()).collect();
    let because = if causes.is_empty() { String::new() } else { format!(", because of {}", causes.join(", ")) };
    flight.plain(vec![format!("{} → {}{because}", name(&was.criteria), name(&row.criteria))])
}

/// Everything that makes a flight worth examining.
fn troubles(row: &Row) -> Vec<String> {
    let outcome = match row.outcome.as_str() {
        FAILED => Some(FAILED.to_owned()),
        "not-measurable" => Some(NOT_MEASURABLE.to_owned()),
        PENDING => Some(PENDING.to_owned()),
        _ => None,
    };
    let harmed = (row.effect.as_deref() == Some("harmed")).then(|| HARMED.to_owned());
    let damaged = (row.data == "damaged").then(|| DAMAGED.to_owned());
    let failed = row.criteria_failed.iter().flat_map(|ids| ids.split_whitespace());
    let failed = failed.map(failed_criterion);
    outcome.into_iter().chain(harmed).chain(damaged).chain(failed).collect()
}

/// Trouble of a flight that fails a criterion.
pub(crate) fn failed_criterion(id: &str) -> String {
    format!("criterion {id} failed")
}

fn is_criterion(trouble: &str) -> bool {
    trouble.starts_with("criterion ")
}

/// Every reason why the second row may differ from the first.
#[must_use]
pub fn causes(was: &Row, row: &Row) -> Vec<ChangeCause> {
    let log = was.log_hash.is_some() && row.log_hash.is_some() && was.log_hash != row.log_hash;
    let build = was.analysis_version != row.analysis_version || was.build != row.build;
    let settings = was.settings_hash != row.settings_hash;
    // Criteria do not change results.
    let others = was.key != row.key && !(log || settings || build);
    let found = [
        (log, ChangeCause::Log),
        (settings, ChangeCause::Settings),
        (build, ChangeCause::Build),
        (others, ChangeCause::OtherFlights),
        (was.criteria_hash != row.criteria_hash, ChangeCause::Criteria),
    ];
    found.into_iter().filter(|(is, _)| *is).map(|(_, cause)| cause).collect()
}

/// Numbers of a flight that moved.
fn moved(was: &Row, row: &Row, named: &NamedFlight, causes: &[ChangeCause]) -> Vec<MovedNumber> {
    // A lateness relative to the velocity is the difference, which has its own name.
    let is_relative = row.datum.as_deref().is_some_and(|datum| datum.starts_with("relative"));
    let is_lateness = was.datum == row.datum && !is_relative;
    let numbers = [
        ("lateness", "s", (was.lateness_s, was.lateness_u_s), (row.lateness_s, row.lateness_u_s)),
        (
            "position minus velocity",
            "s",
            (was.position_minus_velocity_s, was.position_minus_velocity_u_s),
            (row.position_minus_velocity_s, row.position_minus_velocity_u_s),
        ),
        (
            "error after compensation",
            "m",
            (was.error_compensated_m, was.error_compensated_u_m),
            (row.error_compensated_m, row.error_compensated_u_m),
        ),
        ("removed delay", "s", (was.removed_s, None), (row.removed_s, None)),
    ];
    let shared_model_u = was.lateness_model_u_s.zip(row.lateness_model_u_s).map_or(0.0, |(was, is)| was.min(is));
    let wanted = numbers.into_iter().filter(|(quantity, ..)| is_lateness || *quantity != "lateness");
    let one = |(quantity, unit, was, is): (&str, &str, _, _)| {
        let (before, now) = (estimate(was)?, estimate(is)?);
        let shared = if quantity == "lateness" { shared_model_u } else { 0.0 };
        let sigmas = sigmas(&before, &now, shared);
        let has_moved = match sigmas {
            Some(sigmas) => sigmas.abs() > MOVED_SIGMAS,
            None => (now.value - before.value).abs() > MOVED_SHARE * before.value.abs().max(now.value.abs()),
        };
        has_moved.then(|| MovedNumber {
            flight: named.clone(),
            quantity: quantity.to_owned(),
            unit: unit.to_owned(),
            before,
            now,
            sigmas,
            causes: of_result(causes),
        })
    };
    wanted.filter_map(one).collect()
}

/// A recommended value that changed. A flight that could not be read withdraws nothing.
fn moved_advice(was: &Row, row: &Row, named: &NamedFlight) -> Option<MovedAdvice> {
    let is_same = match (was.advised_s, row.advised_s) {
        (Some(before), Some(now)) => was.parameter == row.parameter && (before - now).abs() < SAME_ADVICE_S,
        (None, None) => true,
        (Some(_), None) => row.outcome == FAILED,
        (None, Some(_)) => false,
    };
    let of = if row.advised_s.is_some() { row } else { was };
    let parameter = of.parameter.clone().filter(|_| !is_same)?;
    let before_s = was.advised_s.filter(|_| was.parameter == of.parameter);
    Some(MovedAdvice { flight: named.clone(), parameter, before_s, now_s: row.advised_s })
}

/// The causes that can change a result or number: criteria change neither.
fn of_result(causes: &[ChangeCause]) -> Vec<ChangeCause> {
    causes.iter().copied().filter(|cause| *cause != ChangeCause::Criteria).collect()
}

fn estimate((value, u): (Option<f64>, Option<f64>)) -> Option<Estimate> {
    Some(Estimate { value: value?, standard_uncertainty: u })
}

/// Now minus before, divided by the root of the sum of both squared standard uncertainties. A model error that both
/// contain is not in their difference.
fn sigmas(before: &Estimate, now: &Estimate, shared_u: f64) -> Option<f64> {
    let own = |estimate: &Estimate| Some(own_part(estimate.standard_uncertainty?, shared_u));
    let u = if shared_u > 0.0 {
        own(before)?.hypot(own(now)?)
    } else {
        before.standard_uncertainty?.hypot(now.standard_uncertainty?)
    };
    (u > 0.0).then(|| (now.value - before.value) / u)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::latest_of;

    fn row(flight: &str) -> Row {
        Row {
            campaign: "c".into(),
            flight: flight.into(),
            key: "k1".into(),
            log_hash: Some("log".into()),
            settings_hash: "s".into(),
            build: "0.1.0".into(),
            outcome: "compensated".into(),
            data: "whole".into(),
            datum: Some("imu".into()),
            lateness_s: Some(0.118),
            lateness_u_s: Some(0.003),
            alarms: Some("weak".into()),
            ..Row::default()
        }
    }

    fn changes(before: &[Row], now: &[Row]) -> RunChanges {
        compare(&latest_of(before.iter().cloned()), now, &Texts::new(), &|_, _| None)
    }

    #[test]
    fn a_model_error_that_both_contain_hides_no_change() {
        let with_model = |late_s| Row {
            lateness_s: Some(late_s),
            lateness_u_s: Some(0.0155),
            lateness_model_u_s: Some(0.015),
            ..row("a")
        };
        let own_u: f64 = 2.0_f64.sqrt() * (0.0155_f64.powi(2) - 0.015_f64.powi(2)).sqrt();
        let [one] = changes(&[with_model(0.2)], &[with_model(0.22)]).moved.try_into().unwrap();
        assert!((one.sigmas.unwrap() - 0.02 / own_u).abs() < 1e-9);
        assert_eq!(changes(&[with_model(0.2)], &[with_model(0.21)]).moved, vec![]);
    }

    #[test]
    fn each_cause_is_distinguished() {
        let rerun = |change: &dyn Fn(&mut Row)| {
            let mut now = row("a");
            now.key = "k2".into();
            change(&mut now);
            changes(&[row("a")], &[now]).rerun[0].causes.clone()
        };
        assert_eq!(rerun(&|_| ()), [ChangeCause::OtherFlights]);
        assert_eq!(rerun(&|now| now.log_hash = Some("other".into())), [ChangeCause::Log]);
        assert_eq!(rerun(&|now| now.settings_hash = "t".into()), [ChangeCause::Settings]);
        assert_eq!(rerun(&|now| now.analysis_version = 20), [ChangeCause::Build]);
        let both = rerun(&|now| {
            now.log_hash = Some("other".into());
            now.build = "0.2.0".into();
        });
        assert_eq!(both, [ChangeCause::Log, ChangeCause::Build]);
    }

    #[test]
    fn a_number_without_uncertainty_moves_by_more_than_a_tenth() {
        let error = |error_compensated_m| Row {
            error_compensated_m: Some(error_compensated_m),
            error_compensated_u_m: None,
            ..row("a")
        };
        let moved = |now| changes(&[error(0.14)], &[error(now)]).moved;
        assert_eq!(moved(0.15), vec![]);
        let [one] = moved(3.5).try_into().unwrap();
        assert_eq!((one.quantity.as_str(), one.now.value, one.sigmas), ("error after compensation", 3.5, None));
    }

    #[test]
    fn a_delay_moves_by_combined_uncertainty_only_within_one_datum() {
        let by = |ms: f64, datum: &str| {
            let now = Row { lateness_s: Some(0.118 + ms / 1e3), datum: Some(datum.into()), ..row("a") };
            changes(&[row("a")], &[now]).moved.first().and_then(|m| m.sigmas)
        };
        // √(3² + 3²) = 4.24 ms.
        assert_eq!(by(8.4, "imu"), None);
        assert!((by(-8.6, "imu").unwrap() + 2.027).abs() < 0.001);
        assert_eq!(by(50.0, "reference"), None);
    }

    #[test]
    fn new_failures_have_their_first_error_line_and_alarms_come_and_go() {
        let failed =
            Row { outcome: "failed".into(), reason: Some("a.bin: byte 12: no frame\nmore".into()), ..row("a") };
        let other = Row { alarms: Some("steps steps".into()), ..row("b") };
        let new = Row { data: "damaged".into(), alarms: None, ..row("n") };
        let found = changes(&[row("a"), row("b")], &[failed, other, new]);
        assert_eq!(found.failing[0].words, ["failed"]);
        assert_eq!(found.failing[0].error.as_deref(), Some("a.bin: byte 12: no frame"));
        assert_eq!((found.failing[1].flight.flight.as_str(), found.failing[1].words[0].as_str()), ("n", "log damaged"));
        assert_eq!(found.alarms_new[0].words, ["steps"]);
        // `a` could not be read; the alarm of `b` is gone.
        assert_eq!(found.alarms_cleared.iter().map(|of| of.flight.flight.as_str()).collect::<Vec<_>>(), ["b"]);
        assert_eq!((found.compared, found.new.len(), found.rerun.len()), (2, 1, 0));
    }

    #[test]
    fn a_flight_that_never_moved_is_not_failing() {
        let parked =
            |flight| Row { outcome: "not-measurable".into(), reason: Some("stands still".into()), ..row(flight) };
        let found = changes(&[row("a")], &[parked("a"), parked("n")]);
        assert_eq!(found.failing.iter().map(|of| of.flight.flight.as_str()).collect::<Vec<_>>(), ["a"]);
        assert_eq!(found.new_not_measurable, found.new);
        assert_eq!(found.new[0].flight, "n");
        // One that is also damaged is failing.
        let found = changes(&[], &[Row { data: "damaged".into(), ..parked("n") }]);
        assert_eq!(found.failing[0].words, ["log damaged"]);
    }

    #[test]
    fn a_flight_failing_for_another_reason_has_not_recovered() {
        let damaged = |criterion: Option<&str>| Row {
            data: "damaged".into(),
            criteria_failed: criterion.map(str::to_owned),
            reason: Some("nothing was removed".into()),
            ..row("a")
        };
        let found = changes(&[damaged(Some("dur"))], &[damaged(None)]);
        assert_eq!((found.recovered, found.failing), (vec![], vec![]));
        let found = changes(&[damaged(None)], &[row("a")]);
        assert_eq!(found.recovered[0].words, ["log damaged"]);
        // Why nothing was removed is not a reason for the damage.
        assert_eq!(changes(&[row("a")], &[damaged(None)]).failing[0].error, None);
        // A flight that cannot be read shows no alarm, and clears none.
        let failed = Row { outcome: "failed".into(), alarms: None, ..row("a") };
        assert_eq!(changes(&[row("a")], &[failed]).alarms_cleared, vec![]);
    }

    #[test]
    fn a_new_flight_has_its_answer() {
        let answer = "position.gps is 401 ms late. helped: 5.9 → 0.5 m.";
        let words = BTreeMap::from([(ANSWER.to_owned(), answer.to_owned())]);
        let texts = Texts::from([(("c".to_owned(), "n".to_owned()), words)]);
        let found = compare(&latest_of([row("a")]), &[row("a"), row("m"), row("n")], &texts, &|_, _| None);
        let names: Vec<&str> = found.new.iter().map(|of| of.flight.as_str()).collect();
        assert_eq!((names, found.new_answers), (vec!["m", "n"], vec![String::new(), answer.to_owned()]));
    }

    #[test]
    fn a_harmed_flight_says_so_once() {
        let harmed = Row { effect: Some("harmed".into()), ..row("a") };
        let words = BTreeMap::from([("harmed".to_owned(), "harmed: 7.02 → 8.79 m".to_owned())]);
        let texts = Texts::from([(("c".to_owned(), "a".to_owned()), words)]);
        let found = compare(&latest_of([row("a")]), &[harmed], &texts, &|_, _| None);
        assert_eq!(found.failing[0].words, ["harmed"]);
        assert_eq!(found.failing[0].error.as_deref(), Some("7.02 → 8.79 m"));
    }

    #[test]
    fn new_alarms_and_damage_have_their_texts() {
        let damaged = |flight: &str| Row {
            data: "damaged".into(),
            alarms: Some("log-damaged weak delay-steps".into()),
            ..row(flight)
        };
        let messages =
            [("log-damaged", "12 of 900 bytes could not be read\nmore"), ("delay-steps", "The delay steps by 90 ms.")];
        let messages = BTreeMap::from(messages.map(|(code, text)| (code.to_owned(), text.to_owned())));
        let texts = ["a", "n"].map(|flight| (("c".to_owned(), flight.to_owned()), messages.clone())).into();
        let found = compare(&latest_of([row("a")]), &[damaged("a"), damaged("n")], &texts, &|_, _| None);
        for failing in &found.failing {
            assert_eq!(failing.error.as_deref(), Some("12 of 900 bytes could not be read"));
        }
        let alarms: Vec<_> = found.alarms_new.iter().map(|of| (of.words.join(" "), of.texts.join("|"))).collect();
        let steps = "12 of 900 bytes could not be read\nmore";
        assert_eq!(alarms[0], ("delay-steps log-damaged".to_owned(), format!("The delay steps by 90 ms.|{steps}")));
        // `weak` is not an alarm in this flight's record: an empty text keeps the others aligned.
        assert_eq!(alarms[1].1, format!("The delay steps by 90 ms.|{steps}|"));
    }

    #[test]
    fn a_recommendation_is_reported_once_it_differs_by_a_millisecond() {
        let advised = |ms: Option<f64>, parameter: &str| Row {
            parameter: Some(parameter.into()),
            advised_s: ms.map(|ms| ms / 1e3),
            ..row("a")
        };
        let moved = |was: &Row, now: Row| {
            let found = changes(std::slice::from_ref(was), &[now]).advice;
            found.into_iter().next().map(|of| (of.parameter, of.before_s, of.now_s))
        };
        let was = advised(Some(118.0), "GPS1_DELAY_MS");
        assert_eq!(moved(&was, was.clone()), None);
        let name = || "GPS1_DELAY_MS".to_owned();
        assert_eq!(moved(&was, advised(Some(119.0), "GPS1_DELAY_MS")), Some((name(), Some(0.118), Some(0.119))));
        assert_eq!(moved(&was, advised(None, "GPS1_DELAY_MS")), Some((name(), Some(0.118), None)));
        let failed = Row { outcome: "failed".into(), ..advised(None, "GPS1_DELAY_MS") };
        assert_eq!(moved(&was, failed), None);
        let other = advised(Some(118.0), "GPS2_DELAY_MS");
        assert_eq!(moved(&was, other), Some(("GPS2_DELAY_MS".to_owned(), None, Some(0.118))));
        assert_eq!(moved(&advised(None, "GPS1_DELAY_MS"), was), Some((name(), None, Some(0.118))));
    }

    #[test]
    fn new_criteria_change_no_result_and_recover_no_flight() {
        let was = Row { criteria_failed: Some("late".into()), criteria_hash: Some("one".into()), ..row("a") };
        let now = Row { key: "k2".into(), criteria_hash: None, ..row("a") };
        let found = changes(std::slice::from_ref(&was), &[now]);
        assert_eq!(found.rerun[0].causes, [ChangeCause::OtherFlights]);
        assert_eq!(found.recovered, vec![]);
        let judged = Row { criteria_failed: None, ..was.clone() };
        assert_eq!(changes(&[was], &[judged]).recovered[0].words, ["criterion late failed"]);
    }

    #[test]
    fn another_verdict_of_other_criteria_is_listed_with_its_cause() {
        let with = |verdict: &str, failed: Option<&str>, hash: &str| Row {
            criteria: Some(verdict.into()),
            criteria_failed: failed.map(str::to_owned),
            criteria_hash: Some(hash.into()),
            ..row("a")
        };
        let words = |was: Row, now: Row| {
            let verdicts = changes(&[was], &[now]).verdicts;
            verdicts.first().map(|of| of.words.join("; "))
        };
        let failed = || with("fail", Some("late"), "one");
        assert_eq!(words(failed(), with("pass", None, "two")).unwrap(), "FAIL → PASS, because of criteria");
        let unjudged = Row { criteria_hash: None, ..row("a") };
        assert_eq!(words(failed(), unjudged.clone()).unwrap(), "FAIL → no criteria, because of criteria");
        let inconclusive = Row { settings_hash: "t".into(), ..with("inconclusive", None, "one") };
        let text = "PASS → INCONCLUSIVE, because of settings";
        assert_eq!(words(with("pass", None, "one"), inconclusive).unwrap(), text);
        assert_eq!(words(failed(), with("pass", None, "one")), None, "it is listed as recovered");
        assert_eq!(words(with("pass", None, "one"), failed()), None, "it is listed as newly failing");
        assert_eq!(words(unjudged, failed()), None, "nothing was judged before");
        let unread = Row { outcome: FAILED.into(), ..row("a") };
        assert_eq!(words(failed(), unread), None, "it could not be read");
        let open = with("inconclusive", None, "one");
        assert_eq!(words(failed(), open).unwrap(), "FAIL → INCONCLUSIVE", "no longer failing is not passing");
    }

    #[test]
    fn a_flight_whose_delay_is_no_longer_removed_is_newly_failing() {
        let was = Row { removed_s: Some(0.2), ..row("a") };
        let now = Row { outcome: "uncompensated".into(), reason: Some("no one delay".into()), ..row("a") };
        let found = changes(&[was], &[now]);
        assert_eq!(
            (found.failing[0].words[0].as_str(), found.failing[0].error.as_deref()),
            (NOTHING_REMOVED, Some("no one delay"))
        );
    }

    /// Former bug: "0 numbers moved" where another pipeline removed 250 ms instead of 599 ms.
    #[test]
    fn another_removed_delay_has_moved() {
        let with = |removed_s| Row { removed_s, ..row("a") };
        let moved = |was, now| changes(&[with(was)], &[with(now)]).moved;
        let found = moved(Some(0.5988), Some(0.25));
        assert_eq!((found.len(), found[0].quantity.as_str(), found[0].sigmas), (1, "removed delay", None));
        assert_eq!(moved(Some(0.2), Some(0.201)), vec![]);
        assert_eq!(moved(None, Some(0.25)), vec![], "nothing was removed before: other words say so");
    }

    #[test]
    fn criteria_move_no_number() {
        let was = Row { error_compensated_m: Some(0.1), criteria_hash: Some("one".into()), ..row("a") };
        let now = Row {
            error_compensated_m: Some(0.5),
            criteria_hash: Some("two".into()),
            settings_hash: "t".into(),
            ..row("a")
        };
        assert_eq!(changes(&[was], &[now]).moved[0].causes, [ChangeCause::Settings]);
    }

    #[test]
    fn alarms_of_guessed_columns_come_last() {
        let guess = Code::BoundByGuess.name();
        let with = |alarms: &str, flight: &str| Row { alarms: Some(alarms.into()), ..row(flight) };
        let now = [with(guess, "a"), with("delay-steps", "b"), with(&format!("{guess} delay-steps"), "c")];
        let found = changes(&[], &now);
        let order: Vec<&str> = found.alarms_new.iter().map(|of| of.flight.flight.as_str()).collect();
        assert_eq!(order, ["b", "c", "a"]);
    }

    #[test]
    fn remarks_are_not_alarms() {
        let [remark, alarm] = [Gravity::Grey, Gravity::Red]
            .map(|gravity| Alarm::ALL.iter().find(|alarm| alarm.gravity() == gravity).unwrap().name());
        let with = |alarms: &[&str], flight: &str| Row { alarms: Some(alarms.join(" ")), ..row(flight) };
        let found = changes(&[with(&[remark], "a")], &[with(&[alarm], "a"), with(&[remark, alarm], "n")]);
        let all = |of: &[FlightWords]| of.iter().map(|of| of.words.join(" ")).collect::<Vec<_>>();
        assert_eq!(all(&found.alarms_new), [alarm, alarm]);
        assert_eq!(all(&found.remarks_new), [remark]);
        assert_eq!((all(&found.remarks_cleared), found.alarms_cleared), (vec![remark.to_owned()], vec![]));
    }

    #[test]
    fn numbers_without_uncertainty_are_listed_last() {
        let error = |error_compensated_m, lateness_s| Row {
            error_compensated_m: Some(error_compensated_m),
            lateness_s: Some(lateness_s),
            ..row("a")
        };
        let found = changes(&[error(0.029, 0.118)], &[error(0.035, 0.131)]);
        assert_eq!(found.moved_counts(), (1, 1));
        assert_eq!(found.moved[0].quantity, "lateness");
    }
}
