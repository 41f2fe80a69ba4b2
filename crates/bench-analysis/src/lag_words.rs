//! The choice between delay and lag as a finding, and in words.

use crate::verdict::millis;
use flight::with_expanded;
use record::{Estimate, Finding, ModelCandidate, ModelFinding, Verdict};
use signal::{LagCandidate, LagChoice, LagModel, Uncertain};

/// The shortest fitted lag, s: a result at this limit means no lag.
const SHORTEST_LAG_S: f64 = 1e-4;
/// Another candidate this much worse in BIC is ruled out.
const DISTINGUISHED: f64 = 6.0;

fn estimate(uncertain: Uncertain) -> Estimate {
    Estimate { value: uncertain.value, standard_uncertainty: Some(uncertain.standard_uncertainty) }
}

/// The choice for a record, of a channel with samples `step_s` apart. There is no model if delay and lags together may
/// be zero, or the lag ends at the shortest fitted value.
pub(crate) fn model(choice: &LagChoice, step_s: f64) -> Finding<ModelFinding> {
    let Some(best) = choice.candidates.first() else {
        return Finding::CannotTell("no model of delay and lag could be fitted".to_owned());
    };
    let is_at_floor = best.model == LagModel::L && best.lags_s.iter().all(|lag| lag.value <= 1.01 * SHORTEST_LAG_S);
    if best.sum_s.value.abs() < 2.0 * best.sum_s.standard_uncertainty || is_at_floor {
        return Finding::CannotTell("no delay found".to_owned());
    }
    let is_impossible = is_impossible(best, step_s);
    let chosen = choice.chosen.filter(|_| !is_impossible);
    let candidates = choice
        .candidates
        .iter()
        .map(|c| ModelCandidate {
            name: c.model.name().to_owned(),
            delta_bic: c.bic - best.bic,
            delay_s: c.delay_s.map(estimate),
            lags_s: c.lags_s.iter().copied().map(estimate).collect(),
            square_s2: c.square_s2.map(estimate),
            gain: c.gains.first().map_or(Estimate { value: 1.0, standard_uncertainty: None }, |g| estimate(*g)),
        })
        .collect();
    let text = if is_impossible { OPPOSITE.to_owned() } else { text(choice, best) };
    let chosen = chosen.map(|m| m.name().to_owned());
    Finding::Found(ModelFinding { candidates, chosen, text, sum_s: estimate(best.sum_s) })
}

/// With the uncertainty of the lateness beyond that of the fit, by `add`: what shifts a channel in time is part of its
/// delay, or of the lag where there is no delay.
pub(crate) fn less_certain(model: Finding<ModelFinding>, add: impl Fn(f64) -> f64) -> Finding<ModelFinding> {
    let Finding::Found(mut model) = model else { return model };
    let widen = |e: &mut Estimate| e.standard_uncertainty = e.standard_uncertainty.map(&add);
    widen(&mut model.sum_s);
    for candidate in &mut model.candidates {
        candidate.delay_s.iter_mut().for_each(widen);
        if candidate.delay_s.is_none() {
            candidate.lags_s.iter_mut().for_each(widen);
        }
    }
    Finding::Found(model)
}

/// Why no model is chosen where the best one is early and smears at the same time.
const OPPOSITE: &str = "no sensor: the best model is early by a delay and late by a lag. The reference has another shape \
                        than the channel: check soft iron, field, mount and lever arm";

/// No sensor shows a value early and smears it. A digital filter is early by up to a sample against the continuous one
/// that is fitted.
fn is_impossible(best: &LagCandidate, step_s: f64) -> bool {
    let is_early = |d: Uncertain| d.value + 2.0 * d.standard_uncertainty < -step_s;
    !best.lags_s.is_empty() && best.delay_s.is_some_and(is_early)
}

fn text(choice: &LagChoice, best: &LagCandidate) -> String {
    let words = |model: LagModel| match model {
        LagModel::D => "a pure delay",
        LagModel::L => "a first-order lag",
        LagModel::DL => "a delay and a first-order lag",
        LagModel::DLL => "a delay and two lags",
        LagModel::D2 => "a delay and a second-order filter",
        LagModel::DA => "a delay and a moving average",
    };
    match (choice.chosen, choice.rival.map(|(model, delta)| (words(model), delta))) {
        (Some(_), Some((rival, delta))) => format!("{}; {rival} is worse by ΔBIC {delta:.1}", words(best.model)),
        (Some(_), None) => words(best.model).to_owned(),
        (None, Some((rival, delta))) if delta < DISTINGUISHED => {
            format!("not distinguished: {} or {rival} (ΔBIC {delta:.1}, 6 would decide)", words(best.model))
        }
        (None, Some((rival, delta))) => format!(
            "not distinguished: {} or {rival} (ΔBIC {delta:.1}, but they differ by less than the uncertainty of the \
             reference)",
            words(best.model)
        ),
        (None, None) => "not distinguished".to_owned(),
    }
}

/// Whether this is a moving average, which has one delay at all frequencies, but not one gain.
fn averages(candidate: &ModelCandidate) -> bool {
    candidate.name == LagModel::DA.name()
}

/// The numbers of the chosen model, if it has a lag: `a first-order lag of 300.1 ± 2.4 ms (k = 2)`.
pub(crate) fn lag_in_words(model: &ModelFinding) -> Option<String> {
    let chosen = model.candidates.iter().find(|c| Some(&c.name) == model.chosen.as_ref())?;
    let number = |e: &Estimate| match e.standard_uncertainty {
        Some(u) => format!("{} ms", with_expanded(1e3 * e.value, 2e3 * u)),
        None => format!("{} ms", millis(e.value)),
    };
    let lags = match chosen.lags_s.as_slice() {
        [] => return None,
        [half] if averages(chosen) => {
            let twice = |s: f64| 2.0 * s;
            let window =
                Estimate { value: twice(half.value), standard_uncertainty: half.standard_uncertainty.map(twice) };
            format!("a moving average over {}", number(&window))
        }
        [lag] if chosen.square_s2.is_some() => format!("a second-order filter of {}", number(lag)),
        [lag] => format!("a first-order lag of {}", number(lag)),
        lags => format!("lags of {}", lags.iter().map(number).collect::<Vec<_>>().join(" and ")),
    };
    let delay = chosen.delay_s.as_ref().map(|d| format!("a delay of {} and ", number(d))).unwrap_or_default();
    let motion = if averages(chosen) { "motion at any speed" } else { "slow motion" };
    Some(format!("{delay}{lags} (k = 2), so {motion} is {} late", number(&model.sum_s)))
}

/// The verdict, where a lag may make slow motion late although the best pure delay of this swing is within its margin.
/// Early by a lag is impossible.
pub(crate) fn with_lag(verdict: Verdict, model: Option<&ModelFinding>, margin_s: f64) -> Verdict {
    let is_late = |model: &ModelFinding| {
        let u = model.sum_s.standard_uncertainty.unwrap_or(0.0);
        lag_in_words(model).is_some() && model.sum_s.value - 2.0 * u > margin_s
    };
    if verdict == Verdict::EquivalentToZero && model.is_some_and(is_late) { Verdict::Delayed } else { verdict }
}

/// The reason of a verdict, completed if the lateness is not, or not certainly, a pure delay: `reason` is for the pure
/// delay that fits best.
pub(crate) fn with_model(reason: &str, delay_s: f64, model: Option<&ModelFinding>) -> String {
    match model {
        None => reason.to_owned(),
        Some(model) => match (lag_in_words(model), model.chosen.as_deref()) {
            (Some(lag), Some(name)) if name == LagModel::DA.name() => {
                format!("{lag}. Its gain depends on the frequency. Chosen model: {}", model.text)
            }
            (Some(lag), _) => format!(
                "{lag}. The pure delay that fits this swing best is {} ms ({reason}). It is not a property of the \
                 sensor: it differs at another speed. Chosen model: {}",
                millis(delay_s),
                model.text
            ),
            (None, Some(_)) => reason.to_owned(),
            (None, None) => format!("{reason}; as a model: {}", model.text),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lag(sum_ms: f64, u_ms: f64, chosen: Option<&str>) -> ModelFinding {
        let estimate = |ms: f64| Estimate { value: 1e-3 * ms, standard_uncertainty: Some(1e-3 * u_ms) };
        let gain = Estimate { value: 1.0, standard_uncertainty: None };
        let of = |name: &str, lags_s| ModelCandidate {
            name: name.to_owned(),
            delta_bic: 0.0,
            delay_s: None,
            lags_s,
            square_s2: None,
            gain,
        };
        ModelFinding {
            candidates: vec![of("L", vec![estimate(sum_ms)]), of("D", vec![])],
            chosen: chosen.map(str::to_owned),
            text: String::new(),
            sum_s: estimate(sum_ms),
        }
    }

    #[test]
    fn a_lag_beyond_the_margin_is_not_on_time() {
        let verdict = |model: &ModelFinding| with_lag(Verdict::EquivalentToZero, Some(model), 5e-3);
        assert_eq!(verdict(&lag(20.0, 2.0, Some("L"))), Verdict::Delayed);
        assert_eq!(verdict(&lag(4.0, 0.1, Some("L"))), Verdict::EquivalentToZero, "within the margin");
        assert_eq!(verdict(&lag(8.0, 2.0, Some("L"))), Verdict::EquivalentToZero, "may be within the margin");
        assert_eq!(verdict(&lag(20.0, 2.0, Some("D"))), Verdict::EquivalentToZero, "a pure delay has its own verdict");
        assert_eq!(verdict(&lag(20.0, 2.0, None)), Verdict::EquivalentToZero, "no model was chosen");
        let model = lag(20.0, 2.0, Some("L"));
        assert_eq!(with_lag(Verdict::NotMeasurable, Some(&model), 5e-3), Verdict::NotMeasurable);
        assert_eq!(with_lag(Verdict::EquivalentToZero, None, 5e-3), Verdict::EquivalentToZero);
    }

    /// A channel with soft iron against the model of the field: e^{sT}/(1 + sτ) fits best, but no sensor is early by T.
    #[test]
    fn a_delay_and_a_lag_of_opposite_signs_are_no_sensor() {
        let of = |delay_ms: f64, step_s: f64| {
            let uncertain = |ms: f64| Uncertain { value: 1e-3 * ms, standard_uncertainty: 1e-3 };
            let best = LagCandidate {
                model: LagModel::DL,
                bic: 0.0,
                delay_s: Some(uncertain(delay_ms)),
                lags_s: vec![uncertain(38.0)],
                square_s2: None,
                gains: vec![],
                sum_s: uncertain(38.0 + delay_ms),
                delay_range_s: [0.0, 0.0],
            };
            let finding = model(&LagChoice { candidates: vec![best], chosen: Some(LagModel::DL), rival: None }, step_s);
            finding.found().unwrap().clone()
        };
        let choice = |delay_ms: f64| of(delay_ms, 0.0);
        let impossible = choice(-25.0);
        assert_eq!(impossible.chosen, None);
        assert!(impossible.text.contains("no sensor") && impossible.text.contains("soft iron"), "{}", impossible.text);
        let reason = with_model("late: the 95 % interval excludes zero", 0.012, Some(&impossible));
        assert!(reason.starts_with("late: ") && reason.contains("as a model: no sensor"), "{reason}");
        assert_eq!(choice(25.0).chosen.as_deref(), Some("DL"));
        assert_eq!(choice(-1.5).chosen.as_deref(), Some("DL"), "may be zero");
        // y += a (x − y) at 100 Hz is early by half a sample against the lag that is fitted.
        assert_eq!((of(-5.0, 0.01).chosen.as_deref(), of(-5.0, 0.001).chosen), (Some("DL"), None));
    }
}
