//! Arithmetic on series. Independent of pendulums, files and pages.
//!
//! Series here are slices: strictly increasing times in seconds, and one value for each.
//!
//! ```
//! let t = [0.0, 1.0, 2.0];
//! let v = [0.0, 2.0, 4.0];
//! let distance = signal::CumulativeIntegral::new(&t, &v).at(1.5);
//! assert_eq!(distance, 2.25); // ∫₀^1.5 2τ dτ
//! ```

mod blocks;
mod coarse_lag;
mod decimate;
mod delay;
mod distributions;
mod excess;
mod frequency_response;
mod hann_mean;
mod hermite;
mod hull;
mod integral;
mod lag;
mod log_product;
mod minimise;
mod noise;
mod path;
mod piecewise;
mod projection;
mod random_effects;
mod reference;
mod regression;
mod residuals;
mod shift;
mod smooth;
mod spectrum;
mod spline;
mod static_noise;
mod statistics;
mod whiten;
mod window;

pub use blocks::{BlockEstimate, BlockSums};
pub use coarse_lag::{CoarseLag, coarse_lag};
pub use decimate::{Decimated, min_max};
pub use delay::{
    ComponentFit, DelayError, DelayFit, DelaySettings, DelayStart, DelayWindow, FoundNoise, Gain, Measurement,
    OtherMinimum, SegmentDelay, Sign, Uncertain, delay_by_segment, delay_crlb, delay_objective, delay_objective_above,
    delay_windows, fit_delay, fit_delay_near, fit_delay_with_noise, homogeneity,
};
pub use distributions::{chi_squared_tail, normal_quantile, student_quantile};
pub use excess::delay_excess;
pub use frequency_response::{FrequencyPoint, FrequencyResponse, ResponseError, frequency_response};
pub use hann_mean::HannMean;
pub use hermite::septic_hermite;
pub use hull::{HullLine, lower_hull};
pub use integral::CumulativeIntegral;
pub use lag::{LagCandidate, LagChoice, LagModel, LaggedReference, choose_lag_model, choose_lag_model_against};
pub use minimise::least_between;
pub use noise::NoiseRule;
pub use path::thin_path;
pub use piecewise::{PiecewiseClock, PulseError};
pub use projection::{orthonormal, residuals_of, sum_of_squares};
pub use random_effects::{Mean, Reading, mean_of, outliers};
pub use reference::{Cursor, Reference, SharedColumn};
pub use regression::{Regression, RegressionError, regress};
pub use residuals::{autocorrelation, jitter_from_residuals, kurtosis, ljung_box};
pub use shift::{DelayResponse, GainResponse};
pub use smooth::{SmoothError, SmoothedMotion, Smoother, smooth, smooth_by_gcv, usual_run};
pub use spectrum::{Spectrum, power_spectrum};
pub use spline::{CubicSpline, SplineError};
pub use static_noise::{resolution, static_deviation, static_segments};
pub use statistics::{
    block_jackknife_rms, median_by_selection, median_in_place, median_step, percentile, percentile_of_sorted,
    percentiles, robust_sigma,
};
pub use whiten::{NoiseModel, whiten};
pub use window::{Window, largest_sum};
