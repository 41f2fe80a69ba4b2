//! The field around a magnetometer with a lag.
//!
//! Each axis of a magnetometer reads 1, sin ξ and cos ξ with coefficients that depend on field, iron and mount, and are
//! fitted. A lag damps sin ξ less than cos ξ, which has twice its frequency: coefficients fitted without the lag have
//! the wrong ratio, and make the lag come out too short (200 ms by 2 to 7 ms). So lag and coefficients are fitted
//! together.

use crate::pattern::Samples;
use signal::{
    CubicSpline, LaggedReference, Reference, least_between, orthonormal, regress, residuals_of, sum_of_squares,
};

/// Grid of the lagged functions, s.
const GRID_S: f64 = 0.01;
/// Delay plus lag below which the coefficients without a lag are good enough, s.
const SHORTEST_S: f64 = 0.02;
/// Delay plus lag in terms of the delay without a lag: to be searched.
const SUMS: (f64, f64) = (0.8, 1.6);
/// Longest lag in the same terms, and number of lags tried first.
const LONGEST: f64 = 1.5;
const LAGS: usize = 8;
const TO_S: f64 = 1e-4;
/// Number of rows in the search.
const SEARCH_ROWS: usize = 1500;
/// Minimum increase of 2 log likelihood for white noise: far more than chance, also for noise that is not white.
const LEAST_GAIN: f64 = 50.0;

/// Functions of the motion of which an axis consists, without the offset.
pub(crate) struct Turning {
    pub(crate) sine: CubicSpline,
    pub(crate) cosine: CubicSpline,
}

/// The coefficients of 1, sin ξ and cos ξ for each component, if a lag clearly explains the samples better than the
/// pure delay `delay_s` at its best.
pub(crate) fn coefficients_behind_lag(turning: &Turning, samples: &Samples, delay_s: f64) -> Option<Vec<[f64; 3]>> {
    if delay_s < SHORTEST_S {
        return None;
    }
    let rows = rows_after_lead_in(turning.sine.span(), samples, LONGEST * delay_s);
    let stride = rows.len().div_ceil(SEARCH_ROWS).max(1);
    let few = Rows { samples, rows: rows.iter().copied().step_by(stride).collect() };
    let best = |lag_s: f64| -> Option<(f64, f64)> {
        let lagged = turning.lagged(lag_s)?;
        let sums = (SUMS.0 * delay_s, SUMS.1 * delay_s);
        Some(least_between(|sum| few.misfit(&lagged, sum - lag_s), sums, TO_S))
    };
    let misfit = |lag_s: f64| best(lag_s).map_or(f64::INFINITY, |b| b.1);
    let step = LONGEST * delay_s / LAGS as f64;
    let coarse = (0..=LAGS).map(|k| k as f64 * step).min_by(|a, b| misfit(*a).total_cmp(&misfit(*b)))?;
    let (lag_s, least) = least_between(misfit, ((coarse - step).max(0.0), coarse + step), TO_S);
    let gain = few.rows.len() as f64 * (misfit(0.0) - least);
    if gain.is_nan() || gain <= LEAST_GAIN {
        return None;
    }
    let lagged = turning.lagged(lag_s)?;
    Rows { samples, rows }.coefficients(&lagged, best(lag_s)?.0 - lag_s)
}

/// Before the motion begins, its effect on a lag is unknown.
fn rows_after_lead_in((first, last): (f64, f64), samples: &Samples, longest_s: f64) -> Vec<usize> {
    let lead_s = (6.0 * longest_s + 0.2).min(0.2 * (last - first));
    let inside = |row: &usize| samples.t[*row] >= first + lead_s && samples.t[*row] <= last;
    (0..samples.t.len()).filter(inside).collect()
}

impl Turning {
    fn lagged(&self, lag_s: f64) -> Option<[LaggedReference; 2]> {
        let of = |function: &CubicSpline| LaggedReference::new(function, &[lag_s], GRID_S);
        Some([of(&self.sine)?, of(&self.cosine)?])
    }
}

struct Rows<'a> {
    samples: &'a Samples,
    rows: Vec<usize>,
}

impl Rows<'_> {
    /// 1, sine and cosine at the rows.
    fn columns(&self, lagged: &[LaggedReference; 2], delay_s: f64) -> [Vec<f64>; 3] {
        let at = |function: &LaggedReference| -> Vec<f64> {
            self.rows.iter().map(|&row| function.value_and_rate(self.samples.t[row] - delay_s).0).collect()
        };
        [vec![1.0; self.rows.len()], at(&lagged[0]), at(&lagged[1])]
    }

    fn measured<'s>(&'s self) -> impl Iterator<Item = Vec<f64>> + 's {
        self.samples.components.iter().map(|c| self.rows.iter().map(|&row| c[row]).collect())
    }

    /// −2 log likelihood per row for white noise.
    fn misfit(&self, lagged: &[LaggedReference; 2], delay_s: f64) -> f64 {
        let basis = orthonormal(&self.columns(lagged, delay_s));
        let of = |y: Vec<f64>| sum_of_squares(&residuals_of(&y, &basis)).max(1e-14 * sum_of_squares(&y));
        self.measured().map(|y| of(y).max(f64::MIN_POSITIVE).ln()).sum()
    }

    fn coefficients(&self, lagged: &[LaggedReference; 2], delay_s: f64) -> Option<Vec<[f64; 3]>> {
        let columns = self.columns(lagged, delay_s);
        let of = |y: Vec<f64>| {
            let fit = regress(&columns.each_ref().map(Vec::as_slice), &["offset", "sine", "cosine"], &y).ok()?;
            fit.coefficients.try_into().ok()
        };
        self.measured().map(of).collect()
    }
}
