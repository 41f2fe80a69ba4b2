//! Criteria in words: the same on every page and on the terminal.

use crate::number;
use record::{CriterionFinding, CriterionVerdict, DecisionRule, Limit};

/// The verdict on a criterion, as a word.
pub(crate) fn criterion_word(verdict: CriterionVerdict) -> &'static str {
    match verdict {
        CriterionVerdict::Fail => "FAIL",
        CriterionVerdict::Inconclusive => "INCONCLUSIVE",
        CriterionVerdict::NotEvaluated => "NOT EVALUATED",
        CriterionVerdict::Pass => "PASS",
        CriterionVerdict::NotApplicable => "NOT APPLICABLE",
    }
}

/// A criterion as a sentence: `Td(position) = 118.4 ms ± 3.1 ms (k = 2), criterion ≤ 150 ms: PASS`; with the reason
/// where there is no number or no decision.
#[must_use]
pub fn criterion_sentence(finding: &CriterionFinding) -> String {
    let CriterionFinding { quantity, reason, .. } = finding;
    let value = value_with_unit(finding).map(|v| format!(" = {v}")).unwrap_or_default();
    let because = if reason.is_empty() { String::new() } else { format!(" ({reason})") };
    format!("{quantity}{value}, criterion {}: {}{because}", limit(finding), criterion_word(finding.verdict))
}

/// `118.4 ms ± 3.1 ms (k = 2)`, or a plain value.
fn value_with_unit(finding: &CriterionFinding) -> Option<String> {
    let (value, expanded) = criterion_value(finding)?;
    Some(match expanded {
        Some(expanded) => format!("{} ± {} (k = 2)", in_unit(&value, finding), in_unit(&expanded, finding)),
        None => in_unit(&value, finding),
    })
}

fn in_unit(number: &str, finding: &CriterionFinding) -> String {
    match finding.unit.name.as_str() {
        "" => number.to_owned(),
        unit => format!("{number}\u{a0}{unit}"),
    }
}

/// Value and expanded uncertainty in the unit of the limit. A value without an uncertainty gets enough digits to show
/// on which side of the limit it lies.
pub(crate) fn criterion_value(finding: &CriterionFinding) -> Option<(String, Option<String>)> {
    let value = number::scaled(finding.value.as_ref()?, 1.0 / finding.unit.si);
    if value.standard_uncertainty.is_some_and(|u| u > 0.0) {
        return Some(number::measured(value.value, value.standard_uncertainty));
    }
    if value.value.fract() == 0.0 && value.value.abs() < 1e6 {
        return Some((number::exact(value.value), None));
    }
    let is_distinct = |digits: &i32| {
        let shown = number::to_significant(value.value, *digits);
        limits(finding).iter().all(|limit| shown.partial_cmp(limit) == value.value.partial_cmp(limit))
    };
    let digits = (3..9).find(is_distinct).unwrap_or(9);
    Some((number::significant(value.value, digits), None))
}

/// Converted to the unit of the criteria file.
fn limits(finding: &CriterionFinding) -> Vec<f64> {
    let all = match finding.limit {
        Limit::AtMost(x) | Limit::AtLeast(x) => vec![x],
        Limit::Between(both) => both.to_vec(),
    };
    all.into_iter().map(|x| x / finding.unit.si).collect()
}

/// `≤ 150 ms`.
pub(crate) fn limit(finding: &CriterionFinding) -> String {
    let one = |x: f64| in_unit(&number::exact(x / finding.unit.si), finding);
    match finding.limit {
        Limit::AtMost(most) => format!("≤ {}", one(most)),
        Limit::AtLeast(least) => format!("≥ {}", one(least)),
        Limit::Between([low, high]) => format!("{} to {}", number::exact(low / finding.unit.si), one(high)),
    }
}

/// Why the verdict is what it is.
pub(crate) fn criterion_why(finding: &CriterionFinding) -> String {
    if !finding.reason.is_empty() {
        return finding.reason.clone();
    }
    let beyond = if finding.verdict == CriterionVerdict::Pass { "within" } else { "beyond" };
    match (finding.rule, finding.verdict, finding.margin) {
        (DecisionRule::Plain, ..) => format!("{beyond} the limit; no uncertainty, compared directly"),
        (DecisionRule::Value, ..) => {
            format!("the value alone is {beyond} the limit: the criteria file ignores its uncertainty")
        }
        (_, CriterionVerdict::Inconclusive, Some(margin)) if margin != 0.0 => {
            let needed = in_unit(&number::significant(margin.abs() / finding.unit.si, 2), finding);
            let side = if margin < 0.0 { "FAIL" } else { "PASS" };
            format!(
                "the 95\u{a0}% interval crosses the limit; at this value it would {side} with an interval of less than ± {needed}"
            )
        }
        (_, CriterionVerdict::Inconclusive, _) => "the 95\u{a0}% interval crosses the limit".to_owned(),
        _ => format!("the whole 95\u{a0}% interval is {beyond} the limit"),
    }
}

/// The 95 % interval in the unit of the limit, rounded like the value.
pub(crate) fn criterion_interval(finding: &CriterionFinding) -> Option<String> {
    let [low, high] = finding.interval_95?.map(|x| x / finding.unit.si);
    let u = finding.value?.standard_uncertainty.filter(|u| *u > 0.0).unwrap_or((high - low) / 4.0 * finding.unit.si);
    Some(number::interval([low, high], u / finding.unit.si))
}

#[cfg(test)]
mod tests {
    use super::*;
    use record::{CriterionUnit, Estimate};

    fn finding(value: f64, u: Option<f64>, limit: Limit, verdict: CriterionVerdict) -> CriterionFinding {
        let margin = match limit {
            Limit::AtMost(x) => x - value,
            Limit::AtLeast(x) => value - x,
            Limit::Between([low, high]) => (value - low).min(high - value),
        };
        CriterionFinding {
            id: "delay".into(),
            title: "Not too late".into(),
            rationale: "because".into(),
            metric: "delay".into(),
            quantity: "Td(position)".into(),
            limit,
            unit: CriterionUnit { name: "ms".into(), si: 1e-3 },
            rule: if u.is_some() { DecisionRule::Interval } else { DecisionRule::Plain },
            value: Some(Estimate { value, standard_uncertainty: u }),
            interval_95: u.map(|u| [value - 2.0 * u, value + 2.0 * u]),
            margin: Some(margin),
            verdict,
            reason: String::new(),
        }
    }

    #[test]
    fn a_criterion_sentence_has_value_uncertainty_limit_and_verdict() {
        let pass = finding(0.118_43, Some(0.001_55), Limit::AtMost(0.15), CriterionVerdict::Pass);
        assert_eq!(
            criterion_sentence(&pass),
            "Td(position) = 118.4\u{a0}ms ± 3.1\u{a0}ms (k = 2), criterion ≤ 150\u{a0}ms: PASS"
        );
        assert_eq!(criterion_interval(&pass).unwrap(), "115.3\u{a0}to\u{a0}121.5");
        let unsure = finding(0.149, Some(0.001_55), Limit::Between([0.1, 0.15]), CriterionVerdict::Inconclusive);
        assert!(criterion_sentence(&unsure).ends_with("criterion 100 to 150\u{a0}ms: INCONCLUSIVE"));
        assert!(
            criterion_why(&unsure).ends_with("would PASS with an interval of less than ± 1.0\u{a0}ms"),
            "{}",
            criterion_why(&unsure)
        );
        let none = CriterionFinding {
            value: None,
            interval_95: None,
            margin: None,
            verdict: CriterionVerdict::NotEvaluated,
            reason: "straight flight".into(),
            ..pass
        };
        let text = "Td(position), criterion ≤ 150\u{a0}ms: NOT EVALUATED (straight flight)";
        assert_eq!(criterion_sentence(&none), text);
    }

    #[test]
    fn a_plain_number_is_never_rounded_onto_the_other_side_of_its_limit() {
        let just_below = finding(0.149_999_6, None, Limit::AtLeast(0.15), CriterionVerdict::Fail);
        assert_eq!(criterion_value(&just_below).unwrap().0, "149.9996");
        let far_below = finding(0.123_456, None, Limit::AtLeast(0.15), CriterionVerdict::Fail);
        assert_eq!(criterion_value(&far_below).unwrap().0, "123");
        let whole = finding(3.0, None, Limit::AtMost(0.15), CriterionVerdict::Fail);
        assert_eq!(criterion_value(&whole).unwrap().0, "3000");
    }

    #[test]
    fn a_value_without_uncertainty_has_enough_digits_to_show_its_side_of_the_limit() {
        let shown = |value_ms: f64, limit_ms: f64| {
            let limit = Limit::AtMost(1e-3 * limit_ms);
            criterion_value(&finding(1e-3 * value_ms, None, limit, CriterionVerdict::Pass)).unwrap()
        };
        assert_eq!(shown(12.0, 50.0), ("12".to_owned(), None));
        assert_eq!(shown(123.45, 200.0), ("123".to_owned(), None));
        assert_eq!(shown(150.04, 150.0), ("150.04".to_owned(), None));
    }
}
