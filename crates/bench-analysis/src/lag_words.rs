//! The choice between delay and lag as a finding, and in words.

use crate::verdict::millis;
use flight::with_expanded;
use record::{Estimate, Finding, ModelCandidate, ModelFinding};
use signal::{LagCandidate, LagChoice, LagModel, Uncertain};

/// The shortest fitted lag, s: a result at this limit means no lag.
const SHORTEST_LAG_S: f64 = 1e-4;
/// Another candidate this much worse in BIC is ruled out.
const DISTINGUISHED: f64 = 6.0;

fn estimate(uncertain: Uncertain) -> Estimate {
    Estimate { value: uncertain.value, standard_uncertainty: Some(uncertain.standard_uncertainty) }
}

/// The choice for a record. There is no model if delay and lags together may be zero, or the lag ends at the shortest
/// fitted value.
pub(crate) fn model(choice: &LagChoice) -> Finding<ModelFinding> {
    let Some(best) = choice.candidates.first() else {
        return Finding::CannotTell("no model of delay and lag could be fitted".to_owned());
    };
    let is_at_floor = best.model == LagModel::L && best.lags_s.iter().all(|lag| lag.value <= 1.01 * SHORTEST_LAG_S);
    if best.sum_s.value.abs() < 2.0 * best.sum_s.standard_uncertainty || is_at_floor {
        return Finding::CannotTell("no delay found".to_owned());
    }
    let candidates = choice
        .candidates
        .iter()
        .map(|c| ModelCandidate {
            name: c.model.name().to_owned(),
            delta_bic: c.bic - best.bic,
            delay_s: c.delay_s.map(estimate),
            lags_s: c.lags_s.iter().copied().map(estimate).collect(),
            gain: c.gains.first().map_or(Estimate { value: 1.0, standard_uncertainty: None }, |g| estimate(*g)),
        })
        .collect();
    let chosen = choice.chosen.map(|m| m.name().to_owned());
    Finding::Found(ModelFinding { candidates, chosen, text: text(choice, best), sum_s: estimate(best.sum_s) })
}

fn text(choice: &LagChoice, best: &LagCandidate) -> String {
    let words = |model: LagModel| match model {
        LagModel::D => "a pure delay",
        LagModel::L => "a first-order lag",
        LagModel::DL => "a delay and a first-order lag",
        LagModel::DLL => "a delay and two lags",
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

/// The numbers of the chosen model, if it has a lag: `a first-order lag of 300.1 ± 2.4 ms (k = 2)`.
pub(crate) fn lag_in_words(model: &ModelFinding) -> Option<String> {
    let chosen = model.candidates.iter().find(|c| Some(&c.name) == model.chosen.as_ref())?;
    let number = |e: &Estimate| match e.standard_uncertainty {
        Some(u) => format!("{} ms", with_expanded(1e3 * e.value, 2e3 * u)),
        None => format!("{} ms", millis(e.value)),
    };
    let lags = match chosen.lags_s.as_slice() {
        [] => return None,
        [lag] => format!("a first-order lag of {}", number(lag)),
        lags => format!("lags of {}", lags.iter().map(number).collect::<Vec<_>>().join(" and ")),
    };
    let delay = chosen.delay_s.as_ref().map(|d| format!("a delay of {} and ", number(d))).unwrap_or_default();
    Some(format!("{delay}{lags} (k = 2), so slow motion is {} late", number(&model.sum_s)))
}

/// The reason of a verdict, completed if the lateness is not, or not certainly, a pure delay: `reason` is for the pure
/// delay that fits best.
pub(crate) fn with_model(reason: &str, delay_s: f64, model: Option<&ModelFinding>) -> String {
    match model {
        None => reason.to_owned(),
        Some(model) => match (lag_in_words(model), model.chosen.as_deref()) {
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
