//! The decision rule: verdicts from numbers and limits.

use record::{CriterionVerdict, DecisionRule, Estimate, Limit, PassRate};

/// A number of one flight, SI.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Reading {
    pub(super) value: Estimate,
    /// `None` if the number has no uncertainty, or an unknown one.
    pub(super) interval_95: Option<[f64; 2]>,
    /// Whether the number is a root mean square.
    is_rms: bool,
}

impl Reading {
    /// A count, or a fact of the log.
    pub(super) fn plain(value: f64) -> Reading {
        Reading { value: Estimate { value, standard_uncertainty: None }, interval_95: None, is_rms: false }
    }

    /// With the interval value ± U, U = 2u.
    pub(super) fn uncertain(value: Estimate) -> Reading {
        let around = |u: f64| [value.value - 2.0 * u, value.value + 2.0 * u];
        Reading { value, interval_95: value.standard_uncertainty.map(around), is_rms: false }
    }

    /// With an interval from the analysis.
    pub(super) fn within(value: Estimate, interval_95: [f64; 2]) -> Reading {
        Reading { value, interval_95: Some(interval_95), is_rms: false }
    }

    /// A root mean square, with the interval value ± U.
    pub(super) fn rms(value: Estimate) -> Reading {
        Reading { is_rms: true, ..Reading::uncertain(value) }
    }

    /// Rejects values that are not finite.
    pub(super) fn finite(self) -> Result<Reading, String> {
        let all = self.interval_95.into_iter().flatten().chain([self.value.value]).all(f64::is_finite);
        if all { Ok(self) } else { Err("the number in the record is not finite".to_owned()) }
    }
}

const NO_UNCERTAINTY: &str = "the record gives no uncertainty of this number, so its 95 % interval is unknown. This \
    happens in a flight that is short compared with the correlation time of its errors: fly longer. decision = \
    \"value\" compares the number alone";

/// Factors on the absolute value of one number from a normal distribution that hold its standard deviation in 95 %
/// (χ² with one degree of freedom).
const OF_ONE_VALUE: [f64; 2] = [0.446, 31.9];
const ONE_VALUE: &str = "the record gives no uncertainty of this number, because its errors are correlated over the whole \
    flight. It counts as a single value: the limit is outside of 0.446 to 31.9 times the number";

/// The verdict, and its reason where numbers and rule do not show it.
pub(super) fn judge(reading: &Reading, limit: Limit, rule: DecisionRule) -> (CriterionVerdict, &'static str) {
    let value = reading.value.value;
    match (rule, reading.interval_95) {
        (DecisionRule::Plain | DecisionRule::Value, _) => (decided([value, value], limit), ""),
        (DecisionRule::Interval, Some(interval)) => (decided(interval, limit), ""),
        (DecisionRule::Interval, None) if reading.is_rms => {
            match decided(OF_ONE_VALUE.map(|factor| factor * value), limit) {
                CriterionVerdict::Inconclusive => (CriterionVerdict::Inconclusive, NO_UNCERTAINTY),
                verdict => (verdict, ONE_VALUE),
            }
        }
        (DecisionRule::Interval, None) => (CriterionVerdict::Inconclusive, NO_UNCERTAINTY),
    }
}

/// Entirely within: pass. Entirely beyond: fail. The limits themselves are within.
fn decided([low, high]: [f64; 2], limit: Limit) -> CriterionVerdict {
    let (least, most) = match limit {
        Limit::AtMost(most) => (f64::NEG_INFINITY, most),
        Limit::AtLeast(least) => (least, f64::INFINITY),
        Limit::Between([least, most]) => (least, most),
    };
    match () {
        () if low >= least && high <= most => CriterionVerdict::Pass,
        () if high < least || low > most => CriterionVerdict::Fail,
        () => CriterionVerdict::Inconclusive,
    }
}

/// Distance from the value to the nearest limit: positive within, negative beyond.
pub(super) fn margin(value: f64, limit: Limit) -> f64 {
    match limit {
        Limit::AtMost(most) => most - value,
        Limit::AtLeast(least) => value - least,
        Limit::Between([least, most]) => (value - least).min(most - value),
    }
}

/// Share that passes, with the interval of Wilson (1927), which stays within 0 to 1 and is valid for few flights too.
/// `None` without a flight.
pub(super) fn pass_rate(passed: u64, judged: u64) -> Option<PassRate> {
    const Z: f64 = 1.959_963_984_540_054;
    let n = judged as f64;
    let p = passed as f64 / n;
    let scale = 1.0 + Z * Z / n;
    let middle = (p + Z * Z / (2.0 * n)) / scale;
    let half = Z / scale * (p * (1.0 - p) / n + Z * Z / (4.0 * n * n)).sqrt();
    let interval_95 = [(middle - half).max(0.0), (middle + half).min(1.0)];
    (judged > 0).then_some(PassRate { passed, judged, interval_95 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use CriterionVerdict::{Fail, Inconclusive, Pass};

    fn of(interval: [f64; 2], limit: Limit) -> CriterionVerdict {
        let value = Estimate { value: 0.5 * (interval[0] + interval[1]), standard_uncertainty: None };
        judge(&Reading::within(value, interval), limit, DecisionRule::Interval).0
    }

    #[test]
    fn an_interval_that_ends_at_the_limit_is_within_it() {
        let (below, above) = (1.0f64.next_down(), 1.0f64.next_up());
        for (interval, verdict) in [
            ([0.5, below], Pass),
            ([0.5, 1.0], Pass),
            ([0.5, above], Inconclusive),
            ([1.0, 2.0], Inconclusive),
            ([1.0, 1.0], Pass),
            ([above, 2.0], Fail),
        ] {
            assert_eq!(of(interval, Limit::AtMost(1.0)), verdict, "{interval:?} at most 1");
        }
        for (interval, verdict) in [
            ([above, 2.0], Pass),
            ([1.0, 2.0], Pass),
            ([below, 2.0], Inconclusive),
            ([0.5, 1.0], Inconclusive),
            ([0.5, below], Fail),
        ] {
            assert_eq!(of(interval, Limit::AtLeast(1.0)), verdict, "{interval:?} at least 1");
        }
        for (interval, verdict) in [
            ([-1.0, 1.0], Pass),
            ([-1.0, above], Inconclusive),
            ([(-1.0f64).next_down(), 0.0], Inconclusive),
            ([-9.0, 9.0], Inconclusive),
            ([above, 2.0], Fail),
            ([-2.0, (-1.0f64).next_down()], Fail),
        ] {
            assert_eq!(of(interval, Limit::Between([-1.0, 1.0])), verdict, "{interval:?} between");
        }
    }

    #[test]
    fn at_most_and_at_least_are_opposite_only_where_the_interval_decides() {
        for low in [-3.0, -1.0, 0.0, 0.9, 1.0, 1.1] {
            for width in [0.0, 0.1, 1.0, 5.0] {
                let interval = [low, low + width];
                let (most, least) = (of(interval, Limit::AtMost(1.0)), of(interval, Limit::AtLeast(1.0)));
                assert!(!(most == Fail && least == Fail), "{interval:?}");
                if most == Fail {
                    assert_eq!(least, Pass, "{interval:?}");
                }
            }
        }
    }

    #[test]
    fn only_the_value_rule_compares_the_value_alone() {
        let reading = Reading::uncertain(Estimate { value: 1.1, standard_uncertainty: Some(0.2) });
        assert_eq!(reading.interval_95, Some([1.1 - 0.4, 1.1 + 0.4]));
        let verdict = |rule| judge(&reading, Limit::AtMost(1.0), rule).0;
        assert_eq!(verdict(DecisionRule::Interval), Inconclusive);
        assert_eq!(verdict(DecisionRule::Value), Fail);
        assert_eq!(judge(&Reading::plain(1.0), Limit::AtMost(1.0), DecisionRule::Plain), (Pass, ""));
    }

    #[test]
    fn a_number_with_unknown_uncertainty_decides_nothing() {
        let reading = Reading::uncertain(Estimate { value: 0.1, standard_uncertainty: None });
        let (verdict, reason) = judge(&reading, Limit::AtMost(1.0), DecisionRule::Interval);
        assert_eq!(verdict, Inconclusive);
        assert!(reason.contains("no uncertainty"), "{reason}");
    }

    /// Former bug: an error of 8 m without uncertainty was inconclusive against a limit of 1 m.
    #[test]
    fn an_rms_without_uncertainty_decides_where_even_one_value_would() {
        let of = |value: f64| {
            let reading = Reading::rms(Estimate { value, standard_uncertainty: None });
            judge(&reading, Limit::AtMost(1.0), DecisionRule::Interval).0
        };
        assert_eq!(
            [8.0, 2.3, 2.2, 0.72, 0.04, 0.03].map(of),
            [Fail, Fail, Inconclusive, Inconclusive, Inconclusive, Pass]
        );
        // A normal value is beyond 2.2414 standard deviations in 2.5 %, and within 0.03134 in 2.5 %.
        let [low, high] = OF_ONE_VALUE;
        assert!((low - 1.0 / 2.2414).abs() < 1e-3 && (high - 1.0 / 0.031338).abs() < 0.02, "{low} {high}");
    }

    #[test]
    fn a_number_that_is_not_finite_is_rejected() {
        assert!(Reading::plain(f64::NAN).finite().is_err());
        assert!(
            Reading::uncertain(Estimate { value: 1.0, standard_uncertainty: Some(f64::INFINITY) }).finite().is_err()
        );
        assert!(Reading::plain(0.0).finite().is_ok());
    }

    #[test]
    fn the_margin_is_negative_beyond_a_limit() {
        assert_eq!(margin(3.0, Limit::AtMost(5.0)), 2.0);
        assert_eq!(margin(3.0, Limit::AtLeast(5.0)), -2.0);
        assert_eq!(margin(3.0, Limit::Between([2.0, 10.0])), 1.0);
        assert_eq!(margin(11.0, Limit::Between([2.0, 10.0])), -1.0);
    }

    #[test]
    fn the_interval_of_a_share_is_the_wilson_interval() {
        // Wilson's limits satisfy |p − w| = z √(w(1 − w)/n); for 3 of 5 they are 0.2307 and 0.8824.
        for (passed, judged) in [(3, 5), (1, 200), (7, 8)] {
            let rate = pass_rate(passed, judged).unwrap();
            let (p, n) = (passed as f64 / judged as f64, judged as f64);
            for w in rate.interval_95 {
                let z = (p - w).abs() / (w * (1.0 - w) / n).sqrt();
                assert!((z - 1.96).abs() < 1e-3, "{passed} of {judged}: {z}");
            }
        }
        let [low, high] = pass_rate(3, 5).unwrap().interval_95;
        assert!((low - 0.2307).abs() < 1e-4 && (high - 0.8824).abs() < 1e-4, "{low} {high}");
        // All of ten: 10/(10 + z²).
        let [low, high] = pass_rate(10, 10).unwrap().interval_95;
        assert!((low - 10.0 / (10.0 + 1.96f64.powi(2))).abs() < 1e-4 && high > 1.0 - 1e-12, "{low} {high}");
        assert_eq!(pass_rate(0, 0), None);
    }
}
