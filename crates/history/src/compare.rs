//! One set of rows against another: what is new, what moved, what fails now, and why.

use crate::brief::PageOf;
use crate::dataset::Latest;
use crate::row::Row;
use flight::{Alarm, Gravity};
use record::{ChangeCause, Estimate, FlightWords, MovedNumber, NamedFlight, RerunCause, RunChanges};
use std::collections::BTreeSet;

/// Trouble of a flight whose delay cannot be measured.
const NOT_MEASURABLE: &str = "not measurable";
const FAILED: &str = "failed";
const PENDING: &str = "pending";
/// A number has moved if it did by more than this many standard uncertainties.
const MOVED_SIGMAS: f64 = 2.0;
/// A number whose uncertainty is not known has moved if it changed by more than this share.
const MOVED_SHARE: f64 = 0.1;

/// Compares rows with the latest ones before. Flights that are gone are not in rows: the caller knows them.
#[must_use]
pub fn compare(before: &Latest, now: &[Row], page: PageOf<'_>) -> RunChanges {
    let mut changes = RunChanges::default();
    for row in now {
        let named = name_of(row, page);
        let Some(was) = before.get(&(row.campaign.clone(), row.flight.clone())) else {
            new_flight(&mut changes, row, named);
            continue;
        };
        changes.compared += 1;
        let causes = causes(was, row);
        if was.key != row.key {
            changes.rerun.push(RerunCause { flight: named.clone(), causes: causes.clone() });
        }
        changes.moved.extend(moved(was, row, &named, &causes));
        came_and_went(&mut changes, was, row, &named);
    }
    let size = |m: &MovedNumber| m.sigmas.map_or(-1.0, f64::abs);
    changes.moved.sort_by(|a, b| size(b).total_cmp(&size(a)));
    changes
}

/// A flight with its page.
fn name_of(row: &Row, page: PageOf<'_>) -> NamedFlight {
    NamedFlight { campaign: row.campaign.clone(), flight: row.flight.clone(), page: page(&row.campaign, &row.page) }
}

/// A flight that was not there before. One that cannot be measured never could: that is no failure.
fn new_flight(changes: &mut RunChanges, row: &Row, named: NamedFlight) {
    let (cannot, troubles): (Vec<String>, _) = troubles(row).into_iter().partition(|what| what == NOT_MEASURABLE);
    words(&mut changes.failing, &named, troubles, row);
    let (alarms, remarks) = codes(row);
    words(&mut changes.alarms_new, &named, alarms, row);
    words(&mut changes.remarks_new, &named, remarks, row);
    changes.new_not_measurable.extend(cannot.first().map(|_| named.clone()));
    changes.new.push(named);
}

/// Troubles and alarms that came or went.
fn came_and_went(changes: &mut RunChanges, was: &Row, row: &Row, named: &NamedFlight) {
    let only = |of: &[String], not: &[String]| of.iter().filter(|t| !not.contains(t)).cloned().collect::<Vec<_>>();
    let (had, has) = (troubles(was), troubles(row));
    words(&mut changes.failing, named, only(&has, &had), row);
    // A flight that fails for another reason now has not recovered.
    if has.is_empty() {
        words(&mut changes.recovered, named, only(&had, &has), row);
    }
    let ((had, had_remarks), (has, has_remarks)) = (codes(was), codes(row));
    words(&mut changes.alarms_new, named, only(&has, &had), row);
    words(&mut changes.remarks_new, named, only(&has_remarks, &had_remarks), row);
    // A flight that could not be read shows neither that an alarm is gone nor that it is still there.
    if row.outcome != FAILED {
        words(&mut changes.alarms_cleared, named, only(&had, &has), row);
        words(&mut changes.remarks_cleared, named, only(&had_remarks, &has_remarks), row);
    }
}

/// Codes of the alarms of a flight that ask for something, and of its remarks, each once.
fn codes(row: &Row) -> (Vec<String>, Vec<String>) {
    let codes: BTreeSet<String> = row.alarm_codes().map(str::to_owned).collect();
    codes.into_iter().partition(|code| !is_remark(code))
}

/// Whether a code is one of the catalogue's remarks. A code of an older release counts as an alarm.
fn is_remark(code: &str) -> bool {
    Alarm::ALL.iter().any(|alarm| alarm.name() == code && alarm.gravity() == Gravity::Grey)
}

/// Adds an entry if there is something to say. The reason of the flight is that of its outcome, and of nothing else.
fn words(list: &mut Vec<FlightWords>, named: &NamedFlight, words: Vec<String>, row: &Row) {
    if !words.is_empty() {
        let is_outcome = words.iter().any(|word| [FAILED, NOT_MEASURABLE, PENDING].contains(&word.as_str()));
        let reason = row.reason.as_deref().filter(|_| is_outcome);
        let error = reason.and_then(|reason| reason.lines().next()).map(str::to_owned);
        list.push(FlightWords { flight: named.clone(), words, error });
    }
}

/// Everything that makes a flight one to look at.
fn troubles(row: &Row) -> Vec<String> {
    let outcome = match row.outcome.as_str() {
        FAILED => Some(FAILED.to_owned()),
        "not-measurable" => Some(NOT_MEASURABLE.to_owned()),
        PENDING => Some(PENDING.to_owned()),
        _ => None,
    };
    let harmed = (row.effect.as_deref() == Some("harmed")).then(|| "harmed".to_owned());
    let damaged = (row.data == "damaged").then(|| "log damaged".to_owned());
    let failed = row.criteria_failed.iter().flat_map(|ids| ids.split_whitespace());
    let failed = failed.map(|id| format!("criterion {id} failed"));
    outcome.into_iter().chain(harmed).chain(damaged).chain(failed).collect()
}

/// Every reason why the second row may differ from the first.
#[must_use]
pub fn causes(was: &Row, row: &Row) -> Vec<ChangeCause> {
    let log = was.log_hash.is_some() && row.log_hash.is_some() && was.log_hash != row.log_hash;
    let build = was.analysis_version != row.analysis_version || was.build != row.build;
    let found = [
        (log, ChangeCause::Log),
        (was.settings_hash != row.settings_hash, ChangeCause::Settings),
        (build, ChangeCause::Build),
        (was.criteria_hash != row.criteria_hash, ChangeCause::Criteria),
    ];
    let mut causes: Vec<ChangeCause> = found.into_iter().filter(|(is, _)| *is).map(|(_, cause)| cause).collect();
    if causes.is_empty() && was.key != row.key {
        causes.push(ChangeCause::OtherFlights);
    }
    causes
}

/// Numbers of a flight that moved.
fn moved(was: &Row, row: &Row, named: &NamedFlight, causes: &[ChangeCause]) -> Vec<MovedNumber> {
    let same_datum = was.datum == row.datum;
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
    ];
    let wanted = numbers.into_iter().filter(|(quantity, ..)| same_datum || *quantity != "lateness");
    let one = |(quantity, unit, was, is): (&str, &str, _, _)| {
        let (before, now) = (estimate(was)?, estimate(is)?);
        let sigmas = sigmas(&before, &now);
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
            // Criteria change no number.
            causes: causes.iter().copied().filter(|cause| *cause != ChangeCause::Criteria).collect(),
        })
    };
    wanted.filter_map(one).collect()
}

fn estimate((value, u): (Option<f64>, Option<f64>)) -> Option<Estimate> {
    Some(Estimate { value: value?, standard_uncertainty: u })
}

/// Now less before over the root of the sum of both squared standard uncertainties.
fn sigmas(before: &Estimate, now: &Estimate) -> Option<f64> {
    let u = before.standard_uncertainty?.hypot(now.standard_uncertainty?);
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
        compare(&latest_of(before.iter().cloned()), now, &|_, _| None)
    }

    #[test]
    fn each_cause_is_told_from_the_others() {
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
    fn a_number_without_an_uncertainty_moves_by_more_than_a_tenth() {
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
    fn a_delay_moves_by_its_combined_uncertainty_and_never_against_another_datum() {
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
        // `a` could not be read; of `b` the alarm is gone.
        assert_eq!(found.alarms_cleared.iter().map(|of| of.flight.flight.as_str()).collect::<Vec<_>>(), ["b"]);
        assert_eq!((found.compared, found.new.len(), found.rerun.len()), (2, 1, 0));
    }

    #[test]
    fn a_flight_that_stands_still_from_the_first_night_on_is_not_failing() {
        let parked =
            |flight| Row { outcome: "not-measurable".into(), reason: Some("stands still".into()), ..row(flight) };
        let found = changes(&[row("a")], &[parked("a"), parked("n")]);
        assert_eq!(found.failing.iter().map(|of| of.flight.flight.as_str()).collect::<Vec<_>>(), ["a"]);
        assert_eq!(found.new_not_measurable, found.new);
        assert_eq!(found.new[0].flight, "n");
        // What is damaged as well, is.
        let found = changes(&[], &[Row { data: "damaged".into(), ..parked("n") }]);
        assert_eq!(found.failing[0].words, ["log damaged"]);
    }

    #[test]
    fn a_flight_that_fails_for_another_reason_has_not_recovered() {
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
        // Why nothing was removed is no reason of the damage.
        assert_eq!(changes(&[row("a")], &[damaged(None)]).failing[0].error, None);
        // What cannot be read shows no alarm, and clears none.
        let failed = Row { outcome: "failed".into(), alarms: None, ..row("a") };
        assert_eq!(changes(&[row("a")], &[failed]).alarms_cleared, vec![]);
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
    fn remarks_are_no_alarms() {
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
    fn a_number_without_an_uncertainty_comes_after_those_that_moved_by_sigmas() {
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
