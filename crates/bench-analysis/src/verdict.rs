//! Delayed, equivalent to zero, or inconclusive (design note 3.7).

use record::Verdict;
use signal::student_quantile;

/// A test has this power at the minimum detectable delay.
const POWER_FACTOR: f64 = 2.8;
/// Nobody swings a bar for longer.
const HOUR_S: f64 = 3600.0;
/// Probability above the upper end of a two-sided interval of 95 %.
const TAIL_95: f64 = 0.975;
/// The same for 90 %: two one-sided tests at 5 %.
const TAIL_90: f64 = 0.95;

/// Input of a verdict on a delay.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Evidence {
    /// Best value, s; positive is late.
    pub(crate) delay_s: f64,
    /// Standard uncertainty, s.
    pub(crate) standard_uncertainty_s: f64,
    /// Degrees of freedom of the standard uncertainty.
    pub(crate) degrees_of_freedom: f64,
    /// Margin within which a delay that may be zero is equivalent to zero, s.
    pub(crate) margin_s: f64,
    /// Margin for a delay that differs from zero, s.
    pub(crate) strict_margin_s: f64,
    /// Length of the record, s.
    pub(crate) duration_s: f64,
}

/// A verdict with its numbers.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Judgement {
    pub(crate) verdict: Verdict,
    pub(crate) interval_95_s: [f64; 2],
    /// Smallest delay detectable with a power of 80 %, s.
    pub(crate) minimum_detectable_s: f64,
    /// Record length required for a decision, s.
    pub(crate) deciding_length_s: Option<f64>,
    pub(crate) reason: String,
}

impl Evidence {
    fn interval(&self, tail: f64) -> [f64; 2] {
        let half = student_quantile(tail, self.degrees_of_freedom) * self.standard_uncertainty_s;
        [self.delay_s - half, self.delay_s + half]
    }

    /// *Delayed* (or *early*) if the 95 % interval excludes zero and a delay above the strict margin is not excluded;
    /// *equivalent to zero* if the 90 % interval lies within the margin, which is two one-sided tests at 5 %. If the
    /// delay differs from zero, the strict margin applies, because half the update interval of a slow channel would
    /// hide a large delay. Otherwise *inconclusive*.
    ///
    /// How often the interval excludes zero without any delay (examples/monte_carlo): in 4.7 ± 0.1 % of 24 000 records
    /// at 10 Hz with jittered timestamps and coloured noise, 4.4 to 5.5 % (each ± 0.3) under seven other kinds of noise
    /// in the model, 1.2 to 6.5 % outside it. Tried and rejected: the curvature alone (5.1 %), or the sandwich only if
    /// the whitened residuals are not white (5.1 %). They are nearer to 5 % but report "late" 12 to 18 % of the time
    /// where timestamps are missing.
    pub(crate) fn judge(&self) -> Judgement {
        let [low, high] = self.interval(TAIL_95);
        let [inner_low, inner_high] = self.interval(TAIL_90);
        let significant = low > 0.0 || high < 0.0;
        let margin_s = if significant { self.strict_margin_s } else { self.margin_s };
        let equivalent = inner_low > -margin_s && inner_high < margin_s;
        let minimum_detectable_s = POWER_FACTOR * self.standard_uncertainty_s;
        let verdict = match (equivalent, significant) {
            (true, _) => Verdict::EquivalentToZero,
            (false, true) if self.delay_s > 0.0 => Verdict::Delayed,
            (false, true) => Verdict::Early,
            (false, false) => Verdict::Inconclusive,
        };
        let deciding_length_s = (verdict == Verdict::Inconclusive)
            .then(|| self.duration_s * (minimum_detectable_s / self.margin_s).powi(2).max(1.0));
        let reason = self.reason(verdict, significant, minimum_detectable_s, deciding_length_s);
        Judgement { verdict, interval_95_s: [low, high], minimum_detectable_s, deciding_length_s, reason }
    }

    fn reason(&self, verdict: Verdict, significant: bool, detectable_s: f64, length_s: Option<f64>) -> String {
        let [low, high] = self.interval(TAIL_95).map(millis);
        let margin = millis(self.margin_s);
        match verdict {
            Verdict::Delayed => format!("late: the 95 % interval {low} to {high} ms excludes zero"),
            Verdict::Early => format!(
                "early: the 95 % interval {low} to {high} ms excludes zero; the value is timestamped before it was \
                 true, or the reference is late"
            ),
            Verdict::EquivalentToZero if significant => format!(
                "on time: {} ms differs from zero, but lies within ±{} ms (equivalence test)",
                millis(self.delay_s),
                millis(self.strict_margin_s)
            ),
            Verdict::EquivalentToZero => format!(
                "on time: |delay| < {margin} ms (equivalence test). Detectable here: {} ms",
                millis(detectable_s)
            ),
            Verdict::Inconclusive | Verdict::NotMeasurable => format!(
                "not decided: the 95 % interval {low} to {high} ms includes zero and exceeds the margin of ±{margin} \
                 ms. Detectable here: {} ms. {}",
                millis(detectable_s),
                match length_s {
                    Some(s) if s <= HOUR_S => format!("{:.0} s of the same swing would decide", s.ceil()),
                    Some(_) => "An hour of the same swing would not decide".to_owned(),
                    None => "More of the same swing would decide".to_owned(),
                }
            ),
        }
    }
}

/// Milliseconds with appropriate precision: three significant digits, at most to the microsecond. The minus sign is
/// U+2212.
pub(crate) fn millis(seconds: f64) -> String {
    let ms = seconds * 1e3;
    let decimals = match ms.abs() {
        m if m >= 100.0 => 1,
        m if m >= 1.0 => 2,
        _ => 3,
    };
    flight::fixed(ms, decimals)
}

/// A probability as text: three decimals at most, and never 0.
pub(crate) fn probability(p: f64) -> String {
    match p {
        p if p < 0.001 => "p < 0.001".to_owned(),
        p if p < 0.1 => format!("p = {p:.3}"),
        p => format!("p = {p:.2}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn verdict(delay_ms: f64, u_ms: f64, margin_ms: f64) -> Judgement {
        Evidence {
            delay_s: delay_ms * 1e-3,
            standard_uncertainty_s: u_ms * 1e-3,
            degrees_of_freedom: 1000.0,
            margin_s: margin_ms * 1e-3,
            strict_margin_s: margin_ms.min(5.0) * 1e-3,
            duration_s: 60.0,
        }
        .judge()
    }

    #[test]
    fn a_late_sensor_is_delayed_and_an_early_one_is_early() {
        assert_eq!(verdict(400.0, 2.0, 5.0).verdict, Verdict::Delayed);
        assert_eq!(verdict(-20.0, 2.0, 5.0).verdict, Verdict::Early);
    }

    #[test]
    fn a_small_but_certain_delay_within_the_margin_is_equivalent_to_zero() {
        let small = verdict(1.0, 0.1, 5.0);
        assert_eq!(small.verdict, Verdict::EquivalentToZero);
        assert!(small.reason.contains("differs from zero"), "{}", small.reason);
    }

    /// A 1 Hz GPS that is 400 ms late is late, although half its interval is 500 ms.
    #[test]
    fn a_large_certain_delay_is_not_equivalent_to_zero_on_slow_channels() {
        assert_eq!(verdict(400.0, 4.0, 500.0).verdict, Verdict::Delayed);
        assert_eq!(verdict(-90.0, 4.0, 100.0).verdict, Verdict::Early);
        assert_eq!(verdict(5.0, 8.0, 500.0).verdict, Verdict::EquivalentToZero, "may be zero, surely below the margin");
    }

    #[test]
    fn a_probability_is_never_zero_and_the_minus_sign_is_u2212() {
        assert_eq!([0.0, 0.0004, 0.012, 0.62].map(probability), ["p < 0.001", "p < 0.001", "p = 0.012", "p = 0.62"]);
        assert_eq!(millis(-0.0232), "\u{2212}23.20");
    }

    #[test]
    fn the_tost_flips_where_the_90_percent_interval_meets_the_margin() {
        // 1.6464 is Student's 95 % quantile with 1000 degrees of freedom (tables).
        assert_eq!(verdict(0.0, 5.0 / 1.6465, 5.0).verdict, Verdict::EquivalentToZero);
        assert_eq!(verdict(0.0, 5.0 / 1.6463, 5.0).verdict, Verdict::Inconclusive);
    }

    #[test]
    fn an_inconclusive_record_states_the_required_length() {
        let unsure = verdict(1.0, 5.0, 5.0);
        assert_eq!(unsure.verdict, Verdict::Inconclusive);
        // T (2.8 se / margin)² = 60 · 2.8².
        assert!((unsure.deciding_length_s.unwrap() - 60.0 * 2.8 * 2.8).abs() < 1e-9);
        assert!((unsure.minimum_detectable_s - 0.014).abs() < 1e-12);
        assert!(unsure.reason.contains("471"), "{}", unsure.reason);
    }

    #[test]
    fn the_required_length_is_never_shorter_than_the_record() {
        assert!(verdict(3.9, 2.0, 5.0).deciding_length_s.is_none_or(|s| s >= 60.0));
    }
}
