//! Quantiles and tails, on statrs.

use statrs::distribution::{ChiSquared, ContinuousCDF, Normal, StudentsT};

/// Quantile of Student's distribution; of the normal distribution if `degrees_of_freedom` is not a positive finite number.
#[must_use]
pub fn student_quantile(p: f64, degrees_of_freedom: f64) -> f64 {
    let p = p.clamp(1e-300, 1.0 - 1e-16);
    match StudentsT::new(0.0, 1.0, degrees_of_freedom) {
        Ok(student) if degrees_of_freedom.is_finite() && degrees_of_freedom > 0.0 => student.inverse_cdf(p),
        _ => normal_quantile(p),
    }
}

/// Quantile of the standard normal distribution.
#[must_use]
pub fn normal_quantile(p: f64) -> f64 {
    Normal::standard().inverse_cdf(p.clamp(1e-300, 1.0 - 1e-16))
}

/// Probability that chi-squared with `degrees_of_freedom` exceeds `value`; 1 without a degree of freedom.
#[must_use]
pub fn chi_squared_tail(value: f64, degrees_of_freedom: f64) -> f64 {
    match ChiSquared::new(degrees_of_freedom) {
        Ok(chi2) if value.is_finite() => chi2.sf(value.max(0.0)),
        _ if value == f64::INFINITY => 0.0,
        _ => 1.0,
    }
}
