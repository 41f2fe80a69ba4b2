//! "Set this, then prove it": whether a recommended parameter had the predicted effect, judged by later flights.
//!
//! The residual is the lateness of the position minus the value of the parameter: what the autopilot does not account
//! for. A run recommends a value from the lateness of earlier flights. When later logs show that the parameter was set,
//! their residual is measured and compared with the prediction.

use crate::brief::{Brief, PageOf, latest_briefs};
use crate::change_points::{Looks, SharedMean, change_points};
use record::{Estimate, ProofVerdict, SettingProof};
use std::collections::{BTreeMap, BTreeSet};

/// Parameters are whole milliseconds: values closer than this are equal, s.
const SAME_S: f64 = 0.5e-3;
/// Residuals agree if they differ by at most the step of the parameter, s.
const STEP_S: f64 = 1e-3;
/// Prediction and measurement agree within this many combined standard uncertainties.
const AGREE_SIGMAS: f64 = 2.0;

/// Identifies a setting of an aircraft.
type Subject<'a> = (&'a str, &'a str, &'a str, &'a str);

/// Consecutive flights with the same value of the parameter.
struct Epoch<'a> {
    set_s: f64,
    /// The latest row of each flight.
    latest: Vec<&'a Brief>,
}

/// The state of each recommended setting. `rows` are all rows of all runs.
#[must_use]
pub fn proofs(rows: &[Brief], page: PageOf<'_>) -> Vec<SettingProof> {
    let counted: BTreeSet<(&str, &str)> =
        latest_briefs(rows).into_iter().map(|row| (&*row.campaign, &*row.flight)).collect();
    let counts = |row: &&Brief| row.duplicate_of.is_none() && counted.contains(&(&*row.campaign, &*row.flight));
    let mut subjects: BTreeMap<Subject<'_>, Vec<&Brief>> = BTreeMap::new();
    for row in rows.iter().filter(counts) {
        let Some(parameter) = row.parameter.as_deref() else { continue };
        let receiver = row.serial.as_deref().or(row.receiver.as_deref());
        let subject = (
            &*row.campaign,
            row.airframe.as_deref().unwrap_or_default(),
            receiver.or(row.group.as_deref()).unwrap_or_default(),
            parameter,
        );
        subjects.entry(subject).or_default().push(row);
    }
    subjects.iter().flat_map(|(subject, rows)| of_subject(*subject, rows, page)).collect()
}

/// The latest change of a setting, and its open recommendation.
fn of_subject(subject: Subject<'_>, rows: &[&Brief], page: PageOf<'_>) -> Vec<SettingProof> {
    let epochs = epochs(rows);
    let mut found = vec![];
    if let [earlier @ .., after] = epochs.as_slice() {
        found.extend(tested(subject, earlier, after, rows, page));
    }
    if let Some(last) = epochs.last() {
        found.extend(open(subject, last));
    }
    found
}

/// Flights with a known value of the parameter, in flying order, grouped by value.
fn epochs<'a>(rows: &[&'a Brief]) -> Vec<Epoch<'a>> {
    let mut latest: BTreeMap<&str, &Brief> = BTreeMap::new();
    for row in rows.iter().filter(|row| row.parameter_s.is_some()) {
        let known = latest.entry(&row.flight).or_insert(row);
        if known.run_ns <= row.run_ns {
            *known = row;
        }
    }
    let mut ordered: Vec<&Brief> = latest.into_values().collect();
    ordered.sort_by_key(|row| (row.order(), &row.flight));
    let mut epochs: Vec<Epoch<'_>> = vec![];
    for row in ordered {
        let Some(set_s) = row.parameter_s else { continue };
        match epochs.last_mut() {
            Some(epoch) if (epoch.set_s - set_s).abs() <= SAME_S => epoch.latest.push(row),
            _ => epochs.push(Epoch { set_s, latest: vec![row] }),
        }
    }
    epochs
}

/// The recommendation for the earlier flights by the last run before any of the later ones that recommends a value.
fn recommendation<'a>(earlier: &[Epoch<'_>], after: &Epoch<'_>, rows: &[&'a Brief]) -> Option<&'a Brief> {
    let is_in = |epoch: &Epoch<'_>, row: &Brief| epoch.latest.iter().any(|of| of.flight == row.flight);
    let first_run = rows.iter().filter(|row| is_in(after, row)).map(|row| row.run_ns).min()?;
    let is_before = |row: &Brief| earlier.iter().any(|epoch| is_in(epoch, row));
    let made = rows.iter().filter(|row| row.run_ns < first_run && row.advised_s.is_some() && is_before(row));
    made.copied().max_by_key(|row| (row.run_ns, row.flown_ns))
}

fn tested(
    subject: Subject<'_>,
    earlier: &[Epoch<'_>],
    after: &Epoch<'_>,
    rows: &[&Brief],
    page: PageOf<'_>,
) -> Option<SettingProof> {
    let before = earlier.last()?;
    let recommended = recommendation(earlier, after, rows)?;
    let (advised_s, from) = (recommended.advised_s?, lateness_from(recommended)?);
    let parameter = subject.3;
    let less = |set_s: f64| Estimate { value: from.value - set_s, ..from };
    let before_s = (!is_automatic(parameter, before.set_s)).then(|| less(before.set_s));
    let predicted_s = less(if is_automatic(parameter, after.set_s) { advised_s } else { after.set_s });
    let measures = |row: &&Brief| row.datum == recommended.datum && has_lateness(row);
    let mut measuring: Vec<&Brief> = after.latest.iter().copied().filter(measures).collect();
    let later = measuring.split_off(until_change(&measuring));
    let measured = mean_lateness(&measuring).filter(|_| !is_automatic(parameter, after.set_s));
    let measured_s = measured.map(|mean| residual(&mean, after.set_s));
    let is_other = (advised_s - after.set_s).abs() > SAME_S;
    let (mut verdict, mut why) = match is_automatic(parameter, after.set_s) {
        true => (ProofVerdict::CannotTell, "0 leaves the delay to the autopilot: the residual is unknown.".to_owned()),
        false => judge(&predicted_s, measured.zip(measured_s), (before.set_s - after.set_s).abs()),
    };
    if let Some(left) = measured_s.filter(|left| verdict == ProofVerdict::Pass && is_other && !is_zero(left)) {
        verdict = ProofVerdict::Fail;
        why = format!("{why} But {} was recommended, and this value leaves {}.", millis(advised_s), with_u(&left));
    }
    let changed = later_words(measuring.len(), &later, after.set_s);
    let is_said = why.contains("was recommended");
    let other = if is_other && !is_said { format!(" {} was recommended.", millis(advised_s)) } else { String::new() };
    let [was, is] = [before, after].map(|epoch| set_words(parameter, epoch.set_s));
    Some(SettingProof {
        campaign: subject.0.to_owned(),
        of: label(subject),
        parameter: parameter.to_owned(),
        recommended_by: recommended.run_id.to_string(),
        was_s: Some(before.set_s),
        recommended_s: advised_s,
        set_s: Some(after.set_s),
        before_s,
        predicted_s,
        measured_s,
        flights: measuring.iter().map(|row| row.named(page)).collect(),
        verdict,
        words: format!("Set from {was} to {is}.{other} {why}{changed}"),
    })
}

/// Number of flights up to the first step of their lateness: those after it do not show what the setting did.
fn until_change(rows: &[&Brief]) -> usize {
    let (x, u) = latenesses(rows);
    change_points(&x, &u, Looks::One).changes.first().copied().unwrap_or(rows.len())
}

/// What the flights from a step of the lateness on show; if they have steps themselves, the newest of them.
fn later_words(judged: usize, later: &[&Brief], set_s: f64) -> String {
    let Some(first) = later.first() else { return String::new() };
    let (x, u) = latenesses(later);
    let newest = &later[change_points(&x, &u, Looks::One).changes.last().copied().unwrap_or(0)..];
    let Some(mean) = mean_lateness(newest) else { return String::new() };
    format!(
        " The lateness changed after {}: {} from {} on {} not judged, and {} left in {}.",
        flights(judged),
        flights(later.len()),
        first.flight,
        if later.len() == 1 { "is" } else { "are" },
        with_u(&residual(&mean, set_s)),
        if newest.len() == later.len() { "them".to_owned() } else { format!("the newest {}", newest.len()) }
    )
}

fn flights(n: usize) -> String {
    if n == 1 { "1 flight".to_owned() } else { format!("{n} flights") }
}

/// Whether nothing is left within the uncertainty and the step of the parameter.
fn is_zero(left: &Estimate) -> bool {
    left.value.abs() <= STEP_S + AGREE_SIGMAS * left.standard_uncertainty.unwrap_or(0.0)
}

/// The latenesses of flights and their standard uncertainties.
fn latenesses(rows: &[&Brief]) -> (Vec<f64>, Vec<f64>) {
    rows.iter().filter_map(|row| row.lateness_s.zip(row.lateness_u_s)).unzip()
}

/// Whether a flight has a lateness with an uncertainty.
fn has_lateness(row: &Brief) -> bool {
    row.lateness_s.is_some() && row.lateness_u_s.is_some_and(|u| u > 0.0)
}

/// A recommendation that no later log shows to be followed. The newest flight with a known delay decides: older
/// recommendations may be for another state of the receiver.
fn open(subject: Subject<'_>, last: &Epoch<'_>) -> Option<SettingProof> {
    let measured = last.latest.iter().filter(|row| row.lateness_s.is_some());
    let recommended = measured.max_by_key(|row| (row.order(), &row.flight))?;
    let Some(advised_s) = recommended.advised_s else { return withdrawn(subject, last, recommended) };
    let from = lateness_from(recommended)?;
    let before_s = Estimate { value: from.value - last.set_s, ..from };
    let before_s = Some(before_s).filter(|_| !is_automatic(subject.3, last.set_s));
    let u = from.standard_uncertainty.unwrap_or(0.0);
    let matters = before_s.is_none_or(|before| before.value.abs() > STEP_S + AGREE_SIGMAS * u);
    if (advised_s - last.set_s).abs() <= SAME_S || !matters {
        return None;
    }
    Some(SettingProof {
        before_s,
        verdict: ProofVerdict::NotSet,
        words: format!(
            "Recommended: {}.{} {} {}.",
            millis(advised_s),
            others(last, advised_s),
            match last.latest.len() {
                1 => "The latest log has".to_owned(),
                n => format!("The latest {n} logs have"),
            },
            set_words(subject.3, last.set_s)
        ),
        ..not_set(subject, last, (recommended, advised_s), from)
    })
}

/// A recommendation without a later flight: the residual of a lateness `from` once it is followed.
fn not_set(subject: Subject<'_>, last: &Epoch<'_>, (by, advised_s): (&Brief, f64), from: Estimate) -> SettingProof {
    SettingProof {
        campaign: subject.0.to_owned(),
        of: label(subject),
        parameter: subject.3.to_owned(),
        recommended_by: by.run_id.to_string(),
        was_s: Some(last.set_s),
        recommended_s: advised_s,
        set_s: None,
        before_s: None,
        predicted_s: Estimate { value: from.value - advised_s, ..from },
        measured_s: None,
        flights: vec![],
        verdict: ProofVerdict::CannotTell,
        words: String::new(),
    }
}

/// Older flights recommend a value, and the newest does not: it may need one outside the parameter's range.
fn withdrawn(subject: Subject<'_>, last: &Epoch<'_>, newest: &Brief) -> Option<SettingProof> {
    let older =
        last.latest.iter().filter(|row| row.advised_s.is_some()).max_by_key(|row| (row.order(), &row.flight))?;
    let advised_s = older.advised_s?;
    let late_s = Estimate { value: newest.lateness_s?, standard_uncertainty: newest.lateness_u_s };
    let words = format!(
        "No value is recommended for the newest flight, which is {} late.{}",
        millis(late_s.value),
        others(last, late_s.value)
    );
    Some(SettingProof { words, ..not_set(subject, last, (older, advised_s), late_s) })
}

/// The recommendations of other flights with the same setting.
fn others(last: &Epoch<'_>, advised_s: f64) -> String {
    let mut values: Vec<i64> =
        last.latest.iter().filter_map(|row| row.advised_s).map(|s| (s * 1e3).round() as i64).collect();
    values.retain(|ms| (*ms as f64 / 1e3 - advised_s).abs() > SAME_S);
    values.sort_unstable();
    values.dedup();
    match values.as_slice() {
        [] => String::new(),
        [one] => format!(" Other flights recommend {one} ms."),
        [first, .., last] => format!(" Other flights recommend {first} to {last} ms."),
    }
}

/// Whether ArduPilot uses its own value for this kind of receiver, which the log does not state.
fn is_automatic(parameter: &str, set_s: f64) -> bool {
    parameter.starts_with("GPS") && parameter.ends_with("DELAY_MS") && set_s.abs() < SAME_S
}

/// The value of a parameter as text.
fn set_words(parameter: &str, set_s: f64) -> String {
    if is_automatic(parameter, set_s) { "0 (automatic)".to_owned() } else { millis(set_s) }
}

/// The lateness on which a recommendation is based.
fn lateness_from(row: &Brief) -> Option<Estimate> {
    Some(Estimate { value: row.advised_from_s?, standard_uncertainty: row.advised_from_u_s })
}

/// Mean lateness of some flights.
fn mean_lateness(rows: &[&Brief]) -> Option<SharedMean> {
    let (x, u) = latenesses(rows);
    SharedMean::of(&x, &u, &rows.iter().map(|row| row.lateness_model_u_s).collect::<Vec<_>>())
}

/// The lateness that the autopilot does not account for.
fn residual(mean: &SharedMean, set_s: f64) -> Estimate {
    Estimate { value: mean.mean - set_s, standard_uncertainty: Some(mean.u()) }
}

/// The verdict and the reason. A change too small for the measurement to detect proves nothing. Prediction and
/// measurement are from one receiver with one channel map, so both contain the model error that flights share. It
/// counts once, with the prediction.
fn judge(predicted: &Estimate, measured: Option<(SharedMean, Estimate)>, changed_by_s: f64) -> (ProofVerdict, String) {
    let Some((mean, measured)) = measured else {
        return (ProofVerdict::CannotTell, "No flight after the change has a measured lateness.".to_owned());
    };
    let Some(of_prediction) = predicted.standard_uncertainty else {
        return (ProofVerdict::CannotTell, "The prediction has no uncertainty.".to_owned());
    };
    let u = of_prediction.hypot(mean.own_u);
    let apart = (measured.value - predicted.value).abs();
    let side_by_side = format!("Predicted residual {}, measured {}", with_u(predicted), with_u(&measured));
    if apart > STEP_S + AGREE_SIGMAS * u {
        let why = format!(
            "{side_by_side}: they differ by {}, more than {}.",
            millis(apart),
            millis(STEP_S + AGREE_SIGMAS * u)
        );
        (ProofVerdict::Fail, why)
    } else if AGREE_SIGMAS * u > 0.5 * changed_by_s {
        let why = format!("{side_by_side}: too uncertain to show a change of {}.", millis(changed_by_s));
        (ProofVerdict::CannotTell, why)
    } else {
        (ProofVerdict::Pass, format!("{side_by_side}: they agree."))
    }
}

fn label((_, airframe, receiver, _): Subject<'_>) -> String {
    [airframe, receiver].into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join(", ")
}

/// Seconds as milliseconds, as text.
pub(crate) fn millis(seconds: f64) -> String {
    let text = flight::fixed(seconds * 1e3, 1);
    format!("{} ms", text.strip_suffix(".0").unwrap_or(&text))
}

/// Seconds as milliseconds with the expanded uncertainty (k = 2).
pub(crate) fn with_u(estimate: &Estimate) -> String {
    let value = estimate.value * 1e3;
    match estimate.standard_uncertainty {
        Some(u) => format!("{} ± {:.1} ms", flight::fixed(value, 1), 2.0 * u * 1e3),
        None => format!("{} ms", flight::fixed(value, 1)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::row::Row;

    /// A flight of `uav-1` whose position is 118 ms late, with this parameter in its log.
    fn row(run: i64, day: i64, set_ms: f64, late_ms: f64) -> Row {
        Row {
            run_id: format!("night-{run}"),
            run_ns: run,
            campaign: "c".into(),
            flight: format!("{day:03}.bin"),
            flown_ns: Some(day),
            airframe: Some("uav-1".into()),
            serial: Some("D9".into()),
            datum: Some("imu".into()),
            lateness_s: Some(late_ms / 1e3),
            lateness_u_s: Some(0.002),
            lateness_model_u_s: Some(0.0),
            parameter: Some("GPS1_DELAY_MS".into()),
            parameter_s: Some(set_ms / 1e3),
            advised_s: Some(0.118),
            advised_from_s: Some(0.1183),
            advised_from_u_s: Some(0.001),
            ..Row::default()
        }
    }

    fn before() -> Vec<Row> {
        (1..=5).map(|day| row(10, day, 220.0, 118.0 + (day % 3) as f64)).collect()
    }

    fn briefs(rows: &[Row]) -> Vec<Brief> {
        rows.iter().map(Brief::from).collect()
    }

    fn only(rows: &[Row]) -> SettingProof {
        let all = proofs(&briefs(rows), &|_, _| None);
        assert_eq!(all.len(), 1, "{all:#?}");
        all.into_iter().next().unwrap()
    }

    #[test]
    fn a_setting_with_the_predicted_effect_passes() {
        let mut rows = before();
        rows.extend((6..=9).map(|day| row(20, day, 118.0, 117.5 + (day % 2) as f64)));
        let proof = only(&rows);
        assert_eq!((proof.verdict, proof.recommended_by.as_str()), (ProofVerdict::Pass, "night-10"));
        assert!((proof.before_s.unwrap().value + 0.1017).abs() < 1e-9);
        assert!((proof.predicted_s.value - 0.0003).abs() < 1e-9);
        assert!(proof.measured_s.unwrap().value.abs() < 0.001);
        assert_eq!(proof.flights.len(), 4);
        assert!(
            proof.words.starts_with("Set from 220 ms to 118 ms. Predicted residual 0.3 ± 2.0 ms, measured "),
            "{}",
            proof.words
        );
    }

    #[test]
    fn a_receiver_with_another_lateness_afterwards_fails() {
        let mut rows = before();
        rows.extend((6..=9).map(|day| row(20, day, 118.0, 150.0)));
        let proof = only(&rows);
        assert_eq!(proof.verdict, ProofVerdict::Fail);
        assert!((proof.measured_s.unwrap().value - 0.032).abs() < 1e-9);
    }

    #[test]
    fn an_unset_recommendation_is_open_and_a_correct_setting_is_not_listed() {
        let proof = only(&before());
        assert_eq!((proof.verdict, proof.set_s, proof.measured_s), (ProofVerdict::NotSet, None, None));
        let right: Vec<Row> = (1..=5).map(|day| row(10, day, 118.0, 118.0)).collect();
        assert_eq!(proofs(&briefs(&right), &|_, _| None), []);
    }

    #[test]
    fn the_newest_flight_decides_and_withdrawn_advice_is_reported() {
        let moved = |advised_s: Option<f64>| {
            let newest = Row { advised_s, lateness_s: Some(0.303), ..row(20, 9, 0.0, 303.0) };
            only(&(1..=5).map(|day| row(10, day, 0.0, 118.0)).chain([newest]).collect::<Vec<Row>>())
        };
        let newest = moved(Some(0.303));
        assert_eq!((newest.verdict, newest.recommended_s), (ProofVerdict::NotSet, 0.303));
        assert!(newest.words.starts_with("Recommended: 303 ms. Other flights recommend 118 ms."), "{}", newest.words);
        let none = moved(None);
        let words =
            "No value is recommended for the newest flight, which is 303 ms late. Other flights recommend 118 ms.";
        assert_eq!((none.verdict, none.words.as_str()), (ProofVerdict::CannotTell, words));
    }

    #[test]
    fn an_automatic_ardupilot_delay_has_an_unknown_residual() {
        let mut rows: Vec<Row> = (1..=5).map(|day| row(10, day, 0.0, 118.0)).collect();
        let proof = only(&rows);
        assert_eq!((proof.verdict, proof.before_s), (ProofVerdict::NotSet, None));
        assert_eq!(proof.words, "Recommended: 118 ms. The latest 5 logs have 0 (automatic).");
        rows.extend((6..=9).map(|day| row(20, day, 118.0, 118.0)));
        let proof = only(&rows);
        assert_eq!((proof.verdict, proof.before_s), (ProofVerdict::Pass, None));
        assert!(proof.words.starts_with("Set from 0 (automatic) to 118 ms."), "{}", proof.words);
    }

    #[test]
    fn a_change_within_the_uncertainty_proves_nothing() {
        let mut rows: Vec<Row> = (1..=5).map(|day| row(10, day, 116.0, 118.0)).collect();
        rows.extend((6..=7).map(|day| row(20, day, 118.0, 118.0)));
        assert_eq!(only(&rows).verdict, ProofVerdict::CannotTell);
    }

    #[test]
    fn a_shared_error_is_shown_and_does_not_hide_a_change() {
        let shared = |row: Row| Row { lateness_model_u_s: Some(0.0019), advised_from_u_s: Some(0.002), ..row };
        let mut rows = before();
        rows.extend((6..=9).map(|day| row(20, day, 118.0, 118.0)));
        let proof = only(&rows.into_iter().map(shared).collect::<Vec<Row>>());
        let exact = ((0.002f64.powi(2) - 0.0019f64.powi(2)) / 4.0 + 0.0019f64.powi(2)).sqrt();
        assert!((proof.measured_s.unwrap().standard_uncertainty.unwrap() - exact).abs() < 1e-9);
        assert_eq!(proof.verdict, ProofVerdict::Pass);
    }

    #[test]
    fn only_recommendations_made_before_the_flights_are_tested() {
        // All flights are in one run: there was no recommendation before the later ones were flown.
        let mut rows = before();
        rows.extend((6..=9).map(|day| row(10, day, 118.0, 118.0)));
        assert_eq!(proofs(&briefs(&rows), &|_, _| None), []);
    }

    #[test]
    fn a_value_other_than_recommended_is_judged_by_its_own_prediction() {
        let mut rows = before();
        rows.extend((6..=9).map(|day| row(20, day, 100.0, 118.0)));
        let all = proofs(&briefs(&rows), &|_, _| None);
        assert_eq!(all.iter().map(|p| p.verdict).collect::<Vec<_>>(), [ProofVerdict::Fail, ProofVerdict::NotSet]);
        assert!((all[0].predicted_s.value - 0.0183).abs() < 1e-9);
        let end = "they agree. But 118 ms was recommended, and this value leaves 18.0 ± 2.0 ms.";
        assert!(all[0].words.ends_with(end), "{}", all[0].words);
    }

    #[test]
    fn a_later_change_of_the_lateness_is_not_averaged_into_the_effect() {
        let mut rows = before();
        rows.extend((6..=11).map(|day| row(20, day, 118.0, 117.5 + (day % 2) as f64)));
        rows.extend((12..=15).map(|day| row(20, day, 118.0, 217.5 + (day % 2) as f64)));
        let proof = only(&rows);
        assert_eq!((proof.verdict, proof.flights.len()), (ProofVerdict::Pass, 6), "{}", proof.words);
        assert!(proof.measured_s.unwrap().value.abs() < 0.001);
        let later = "The lateness changed after 6 flights: 4 flights from 012.bin on are not judged, and 100.0 ± ";
        assert!(proof.words.contains(later) && proof.words.ends_with("left in them."), "{}", proof.words);
        // Two populations have no common residual: the newest one counts.
        rows.extend((16..=19).map(|day| row(20, day, 118.0, 117.5 + (day % 2) as f64)));
        let back = only(&rows);
        assert!(back.words.contains("8 flights from 012.bin on are not judged"), "{}", back.words);
        assert!(back.words.ends_with(" left in the newest 4."), "{}", back.words);
    }

    #[test]
    fn a_setting_that_is_reverted_is_judged_by_the_recommendation_for_older_flights() {
        let mut rows = before();
        rows.extend((6..=9).map(|day| Row { advised_s: None, ..row(20, day, 118.0, 118.0) }));
        rows.extend((10..=13).map(|day| row(30, day, 220.0, 118.0)));
        let all = proofs(&briefs(&rows), &|_, _| None);
        assert_eq!(all.iter().map(|p| p.verdict).collect::<Vec<_>>(), [ProofVerdict::Fail, ProofVerdict::NotSet]);
        assert!(all[0].words.starts_with("Set from 118 ms to 220 ms. Predicted residual"), "{}", all[0].words);
    }
}
