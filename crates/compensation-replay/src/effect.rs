//! Whether removing a delay brought a position closer to the truth.
//!
//! With a reference the errors before and after are compared row by row. Without one the lateness decides. Removing
//! `Td` from a position that is late by `T` leaves `T − Td`, so `|T − Td| < |T|` exactly if `T > Td/2` (for `Td > 0`).
//! The error in metres is that lateness times the rms ground speed. What a late velocity adds, a·Td·Tv, remains. Both
//! evaluate the position at its own timestamps: the age of a held fix is not included.
//!
//! A lateness known only against a velocity is the least that it can be, because no velocity is early. What harms is then
//! stated with the lateness of the velocity that would make it right.

use crate::sweep::TruthEffect;
use record::{Effect, EffectVerdict, Estimate, JudgedBy};

/// Standard uncertainties that a change must exceed to be shown.
const SHOWN: f64 = 2.0;
/// A relative change of the error below this counts as none.
const LEAST_SHARE: f64 = 0.05;
/// An error above the best by this factor is reported.
const SHORT: f64 = 1.3;
/// Errors below this are not compared as a ratio, m.
const LEAST_ERROR_M: f64 = 0.02;

/// Known lateness of a position.
#[derive(Debug, Clone, PartialEq)]
pub struct KnownLateness {
    /// Lateness, s.
    pub lateness_s: Estimate,
    /// What it is measured against: [`JudgedBy::Lateness`] or [`JudgedBy::Velocity`].
    pub judged_by: JudgedBy,
    /// Scatter of the lateness from fix to fix, standard deviation, s: it remains after removing one delay.
    pub jitter_s: f64,
    /// Lateness of the velocity that compensates, s, positive if late; `None` if unknown.
    pub velocity_late_s: Option<Estimate>,
}

/// Motion of a flight, rms.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct MotionRms {
    /// Ground speed, m/s.
    pub speed_mps: f64,
    /// Horizontal acceleration, m/s².
    pub acceleration_mps2: f64,
}

/// The effect of removing `removed_s` (`None`: nothing was removed).
#[must_use]
pub fn effect(
    truth: Option<&TruthEffect>,
    known: Option<&KnownLateness>,
    motion: MotionRms,
    removed_s: Option<f64>,
) -> Effect {
    match (truth, known) {
        (Some(truth), _) => by_truth(truth, removed_s),
        (None, Some(known)) => by_lateness(known, motion, removed_s),
        (None, None) => Effect {
            verdict: if removed_s.is_some() { EffectVerdict::CannotTell } else { EffectVerdict::NoChange },
            judged_by: JudgedBy::Nothing,
            error_raw_m: None,
            error_compensated_m: None,
            best_m: None,
            short_by: None,
            words: match removed_s {
                Some(s) => format!("{} were removed; this flight does not show whether that is right", ms(s)),
                None => "nothing was removed: the lateness of the position is unknown".to_owned(),
            },
        },
    }
}

fn by_truth(truth: &TruthEffect, removed_s: Option<f64>) -> Effect {
    let verdict = match (removed_s, truth.change_m.standard_uncertainty) {
        (None, _) => EffectVerdict::NoChange,
        (_, None) => EffectVerdict::CannotTell,
        (_, Some(u)) => {
            let (change, least) = (truth.change_m.value, LEAST_SHARE * truth.raw_m.value);
            verdict_of(change, u, least)
        }
    };
    let judged_by = JudgedBy::Truth(truth.reference.clone());
    let condition = truth.if_on_time.as_ref().map_or(String::new(), |what| format!(", if {what} is on time"));
    let against = format!("against {}{condition}", truth.reference);
    finished(verdict, judged_by, &against, [truth.raw_m, truth.compensated_m], truth.best_m, removed_s)
}

/// Verdict on a change (negative is better) with its uncertainty; changes smaller than `least` count as none.
fn verdict_of(change: f64, u: f64, least: f64) -> EffectVerdict {
    let least = least.max(LEAST_ERROR_M);
    if change - SHOWN * u > least {
        EffectVerdict::Harmed
    } else if change + SHOWN * u < -least {
        EffectVerdict::Helped
    } else if change.abs() + SHOWN * u <= least || (change.abs() <= least && u <= least) {
        EffectVerdict::NoChange
    } else {
        EffectVerdict::CannotTell
    }
}

fn by_lateness(known: &KnownLateness, motion: MotionRms, removed_s: Option<f64>) -> Effect {
    let speed_mps = motion.speed_mps;
    let lateness_s = known.lateness_s.value;
    let u_s = known.lateness_s.standard_uncertainty.unwrap_or(f64::INFINITY);
    let removed = removed_s.unwrap_or(0.0);
    let by_velocity = known.velocity_late_s.unwrap_or(Estimate { value: 0.0, standard_uncertainty: None });
    let added = |late_s: f64| (motion.acceleration_mps2 * removed * late_s).abs();
    let (added_m, added_u_m) = (added(by_velocity.value), added(by_velocity.standard_uncertainty.unwrap_or(0.0)));
    // |T − Td| − |T| changes at −2 per second of T between 0 and Td, and not at all outside.
    let change_m = ((lateness_s - removed) * speed_mps).hypot(added_m) - lateness_s.abs() * speed_mps;
    let inside = |t: f64| t.clamp(removed.min(0.0), removed.max(0.0));
    let reach = 2.0 * (inside(lateness_s + SHOWN * u_s) - inside(lateness_s - SHOWN * u_s)).abs() / (2.0 * SHOWN);
    let is_least = matches!(known.judged_by, JudgedBy::Velocity(_));
    let verdict = match removed_s {
        None => EffectVerdict::NoChange,
        Some(_) if !u_s.is_finite() => EffectVerdict::CannotTell,
        Some(_) => verdict_of(change_m, reach * speed_mps, LEAST_SHARE * lateness_s.abs() * speed_mps),
    };
    let metres = |s: f64, added: (f64, f64)| Estimate {
        value: (s.hypot(known.jitter_s) * speed_mps).hypot(added.0),
        standard_uncertainty: Some((u_s * speed_mps).hypot(added.1)).filter(|u| u.is_finite()),
    };
    let errors = [metres(lateness_s, (0.0, 0.0)), metres(lateness_s - removed, (added_m, added_u_m))];
    // A delay with uncertainty u leaves u, even if it is removed entirely.
    let best_m = (u_s.is_finite() && !is_least).then(|| (u_s.hypot(known.jitter_s) * speed_mps).hypot(added_m));
    let against = match &known.judged_by {
        JudgedBy::Velocity(name) => format!("against {name}, with its own lateness unknown"),
        _ => "by the remaining lateness".to_owned(),
    };
    let mut effect = finished(verdict, known.judged_by.clone(), &against, errors, best_m, removed_s);
    if let (EffectVerdict::Harmed, JudgedBy::Velocity(name)) = (verdict, &known.judged_by) {
        effect.words += &format!(", unless {name} is itself {} late", ms(removed - lateness_s));
    }
    effect
}

fn finished(
    verdict: EffectVerdict,
    judged_by: JudgedBy,
    against: &str,
    [raw, after]: [Estimate; 2],
    best_m: Option<f64>,
    removed_s: Option<f64>,
) -> Effect {
    let short_by = best_m
        .filter(|_| removed_s.is_some())
        .map(|best| after.value / best.max(LEAST_ERROR_M))
        .filter(|ratio| *ratio > SHORT && clearly_above(&after, best_m.unwrap_or(0.0)));
    let short = short_by.map_or(String::new(), |ratio| format!(", but {ratio:.1} × the smallest possible error"));
    let metres = format!("{} → {} m", error_words(&raw), error_words(&after));
    let words = match (verdict, removed_s) {
        (_, None) => format!("nothing was removed; the position error is {} m ({against})", error_with_u(&raw)),
        (EffectVerdict::Helped, Some(_)) => format!("helped: {metres} ({against}){short}"),
        (EffectVerdict::Harmed, Some(s)) => {
            format!("harmed: {metres} ({against}). Removing {} made the position worse", ms(s))
        }
        (EffectVerdict::NoChange, Some(_)) => format!("no change: {metres} ({against}){short}"),
        (EffectVerdict::CannotTell, Some(_)) => {
            format!("cannot tell: {metres} ({against}), a difference within its uncertainty{short}")
        }
    };
    Effect { verdict, judged_by, error_raw_m: Some(raw), error_compensated_m: Some(after), best_m, short_by, words }
}

/// An error in m, as `0.42`; `below 0.15` if it does not exceed its expanded uncertainty (k = 2).
#[must_use]
pub fn error_words(error: &Estimate) -> String {
    let metres = |m: f64| if m >= 10.0 { format!("{m:.1}") } else { format!("{m:.2}") };
    match error.standard_uncertainty.map(|u| SHOWN * u) {
        Some(expanded) if expanded >= error.value => format!("below {}", metres(error.value + expanded)),
        _ => metres(error.value),
    }
}

/// The same with its expanded uncertainty (k = 2), if it is known: `3.33 ± 0.47`.
fn error_with_u(error: &Estimate) -> String {
    match error.standard_uncertainty.map(|u| SHOWN * u) {
        Some(expanded) if expanded < error.value => flight::with_expanded(error.value, expanded),
        _ => error_words(error),
    }
}

/// An error against a reference may come without uncertainty, where the flight is too short for one.
fn clearly_above(after: &Estimate, best_m: f64) -> bool {
    after.standard_uncertainty.is_none_or(|u| after.value - SHOWN * u > best_m)
}

fn ms(s: f64) -> String {
    format!("{} ms", flight::fixed(1e3 * s, 0))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn known(lateness_s: f64, u_s: f64) -> KnownLateness {
        let lateness_s = Estimate { value: lateness_s, standard_uncertainty: Some(u_s) };
        KnownLateness { lateness_s, judged_by: JudgedBy::Lateness, jitter_s: 0.0, velocity_late_s: None }
    }

    fn at(speed_mps: f64) -> MotionRms {
        MotionRms { speed_mps, acceleration_mps2: 0.0 }
    }

    #[test]
    fn jitter_remains_when_the_mean_delay_is_removed() {
        let known = KnownLateness { jitter_s: 0.1, ..known(0.4, 0.001) };
        let found = effect(None, Some(&known), at(10.0), Some(0.4));
        let close = |m: Option<Estimate>, to: f64| (m.unwrap().value - to).abs() < 1e-9;
        assert!(close(found.error_raw_m, 10.0 * 0.4_f64.hypot(0.1)) && close(found.error_compensated_m, 1.0));
        assert_eq!((found.verdict, found.short_by), (EffectVerdict::Helped, None));
    }

    fn verdict(lateness_s: f64, u_s: f64, removed_s: Option<f64>) -> EffectVerdict {
        effect(None, Some(&known(lateness_s, u_s)), at(10.0), removed_s).verdict
    }

    #[test]
    fn removing_more_than_twice_the_lateness_harms() {
        assert_eq!(verdict(0.15, 0.005, Some(0.4)), EffectVerdict::Harmed);
        assert_eq!(verdict(0.0, 0.005, Some(0.4)), EffectVerdict::Harmed);
        assert_eq!(verdict(-0.5, 0.005, Some(0.4)), EffectVerdict::Harmed);
        assert_eq!(verdict(0.25, 0.005, Some(0.4)), EffectVerdict::Helped);
        assert_eq!(verdict(0.4, 0.005, Some(0.4)), EffectVerdict::Helped);
        assert_eq!(verdict(0.2, 0.005, Some(0.4)), EffectVerdict::CannotTell, "half of what is removed: it depends");
        assert_eq!(verdict(0.2, 0.0001, Some(0.4)), EffectVerdict::NoChange);
    }

    /// Against a velocity the lateness is 150 ms or more: with a velocity 250 ms late, 400 ms are right.
    #[test]
    fn harm_against_a_velocity_is_stated_with_its_condition() {
        let known = KnownLateness { judged_by: JudgedBy::Velocity("velocity.gps".into()), ..known(0.15, 0.002) };
        let found = effect(None, Some(&known), at(20.0), Some(0.4));
        assert_eq!((found.verdict, found.short_by), (EffectVerdict::Harmed, None));
        assert!(found.words.ends_with("worse, unless velocity.gps is itself 250 ms late"), "{}", found.words);
        assert_eq!(effect(None, Some(&known), at(20.0), Some(0.1)).verdict, EffectVerdict::Helped);
    }

    /// Design note 5.6: a·Td·Tv remains, here 4 m/s² · 0.5 s · 0.3 s.
    #[test]
    fn the_lateness_of_the_velocity_remains_in_the_error_after() {
        let late = |value, u| Some(Estimate { value, standard_uncertainty: Some(u) });
        let known = KnownLateness { velocity_late_s: late(0.3, 0.01), ..known(0.5, 0.001) };
        let motion = MotionRms { speed_mps: 20.0, acceleration_mps2: 4.0 };
        let found = effect(None, Some(&known), motion, Some(0.5));
        let after = found.error_compensated_m.unwrap();
        assert!((after.value - 0.6).abs() < 1e-12, "{after:?}");
        assert!((after.standard_uncertainty.unwrap() - 0.02_f64.hypot(0.02)).abs() < 1e-12, "{after:?}");
        assert!((found.error_raw_m.unwrap().value - 10.0).abs() < 1e-12);
        assert_eq!((found.verdict, found.short_by), (EffectVerdict::Helped, None));
    }

    #[test]
    fn removing_part_of_a_long_lateness_helps_even_if_the_rest_is_uncertain() {
        let effect = effect(None, Some(&known(1.0, 0.1)), at(10.0), Some(0.4));
        assert_eq!(effect.verdict, EffectVerdict::Helped);
        assert!((effect.error_raw_m.unwrap().value - 10.0).abs() < 1e-12);
        assert!((effect.error_compensated_m.unwrap().value - 6.0).abs() < 1e-12);
        assert!((effect.short_by.unwrap() - 6.0).abs() < 1e-9, "6 m where 1 m was possible");
        assert!(effect.words.contains("6.0 × the smallest"), "{}", effect.words);
    }

    #[test]
    fn an_error_within_its_uncertainty_is_given_as_a_bound() {
        let words = effect(None, Some(&known(0.133, 0.0236)), at(3.0), Some(0.133)).words;
        assert_eq!(words, "helped: 0.40 → below 0.14 m (by the remaining lateness)");
    }

    #[test]
    fn removing_nothing_changes_nothing_and_no_knowledge_gives_no_verdict() {
        assert_eq!(verdict(0.0, 0.005, None), EffectVerdict::NoChange);
        assert_eq!(effect(None, None, at(0.0), Some(0.4)).verdict, EffectVerdict::CannotTell);
        assert_eq!(effect(None, None, at(0.0), None).verdict, EffectVerdict::NoChange);
        assert_eq!(verdict(0.2, f64::INFINITY, Some(0.2)), EffectVerdict::CannotTell);
    }

    #[test]
    fn with_a_reference_the_paired_difference_decides() {
        let e = |value, u| Estimate { value, standard_uncertainty: Some(u) };
        let truth = |change: f64, u: f64| TruthEffect {
            reference: "position.truth".into(),
            if_on_time: None,
            raw_m: e(1.0, 0.3),
            compensated_m: e(1.0 + change, 0.3),
            change_m: e(change, u),
            best_m: Some(0.05),
        };
        let of = |change, u| effect(Some(&truth(change, u)), None, at(0.0), Some(0.4)).verdict;
        assert_eq!(of(-0.5, 0.1), EffectVerdict::Helped, "although each error alone is known to 0.3 m only");
        assert_eq!(of(0.5, 0.1), EffectVerdict::Harmed);
        assert_eq!(of(-0.03, 0.005), EffectVerdict::NoChange);
        assert_eq!(of(0.2, 0.2), EffectVerdict::CannotTell);
        let far = TruthEffect { compensated_m: e(0.97, 0.05), ..truth(-0.03, 0.005) };
        let found = effect(Some(&far), None, at(0.0), Some(0.4));
        assert_eq!(found.verdict, EffectVerdict::NoChange);
        assert!(found.words.ends_with("but 19.4 × the smallest possible error"), "{}", found.words);
        let conditional = TruthEffect { if_on_time: Some("velocity.gps".into()), ..far };
        let words = effect(Some(&conditional), None, at(0.0), Some(0.4)).words;
        assert!(words.contains("(against position.truth, if velocity.gps is on time)"), "{words}");
    }
}
