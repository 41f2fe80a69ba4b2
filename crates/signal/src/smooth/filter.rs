//! The Kalman filter forwards, and its adjoint backwards for cross-validation.

use super::chain::{State, Symmetric, Transition, dot, process_noise, settled, sum, times};

/// A record in scaled units: intervals in usual intervals, values in standard deviations.
#[derive(Debug, Clone)]
pub(super) struct Series {
    /// Values minus the first, over the measurement's standard deviation.
    pub z: Vec<f64>,
    /// Interval before each sample divided by the usual one; exactly 1 where it is usual.
    pub ratio: Vec<f64>,
    /// Prior variances of the scaled states.
    pub prior: [f64; 4],
}

/// One update.
#[derive(Debug, Clone, Copy)]
struct Update {
    gain: State,
    /// 1/S.
    inverse_s: f64,
    /// Whether the motion restarts here: earlier samples carry no information about it.
    restarts: bool,
}

/// Innovations skipped by the likelihood while the states converge: two per state (half of a very short record).
const START_UP: usize = 8;

/// Predicted variance of x, in measurement variances, above which the motion is lost and restarts.
const LOST: f64 = 1e10;

/// Results of a forward pass. Once the filter has settled, samples share an update.
#[derive(Debug, Clone, Default)]
pub(super) struct Filtered {
    updates: Vec<Update>,
    /// Filtered covariances, parallel to `updates`, if kept.
    covariances: Vec<Symmetric>,
    /// Filtered states, one for each sample, if kept.
    pub states: Vec<State>,
    /// For each sample, its row in `updates` and `covariances`.
    pub update_of: Vec<u32>,
    innovations: Vec<f64>,
    /// Σ log S + e²/S after the start-up: −2 log likelihood, without a constant.
    pub minus_two_log_likelihood: f64,
}

/// Quantities for cross-validation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Score {
    /// Sum of squares of measured − smoothed, in measurement variances.
    pub rss: f64,
    /// n − tr H.
    pub freedom: f64,
}

impl Filtered {
    /// Filters the record with noise density `rho`; keeps states and covariances if requested.
    pub(super) fn run(&mut self, series: &Series, rho: f64, keep: bool) {
        self.clear();
        let usual = Transition::new(1.0);
        let usual_noise = process_noise(1.0, rho);
        let mut state = [0.0; 4];
        let prior = diagonal(series.prior);
        let mut covariance = prior;
        let mut steady = false;
        let mut log_likelihood = LogLikelihood::default();
        let start_up = START_UP.min(series.z.len() / 2);
        let mut update = Update { gain: [0.0; 4], inverse_s: 1.0, restarts: false };
        for (k, (&z, &ratio)) in series.z.iter().zip(&series.ratio).enumerate() {
            let is_usual = ratio == 1.0;
            let before = covariance;
            steady &= is_usual;
            if is_usual {
                state = usual.apply(&state);
            } else if k > 0 {
                state = Transition::new(ratio).apply(&state);
            }
            if !steady {
                if is_usual {
                    covariance = sum(&usual.congruence(&covariance), &usual_noise);
                } else if k > 0 {
                    covariance = sum(&Transition::new(ratio).congruence(&covariance), &process_noise(ratio, rho));
                }
                let restarts = covariance[0] > LOST;
                if restarts {
                    (state, covariance) = ([z, 0.0, 0.0, 0.0], prior);
                }
                (update, covariance) = updated(&covariance, restarts);
                self.updates.push(update);
                if keep {
                    self.covariances.push(covariance);
                }
                steady = is_usual && !restarts && settled(&covariance, &before);
            }
            let innovation = z - state[0];
            for (x, gain) in state.iter_mut().zip(update.gain) {
                *x += gain * innovation;
            }
            if keep {
                self.states.push(state);
            }
            self.innovations.push(innovation);
            self.update_of.push((self.updates.len() - 1) as u32);
            if k >= start_up {
                log_likelihood.add(innovation, update.inverse_s);
            }
        }
        self.minus_two_log_likelihood = log_likelihood.total();
    }

    fn clear(&mut self) {
        self.updates.clear();
        self.covariances.clear();
        self.states.clear();
        self.update_of.clear();
        self.innovations.clear();
    }

    /// Filtered covariance of sample `k`, if covariances were kept.
    pub(super) fn covariance(&self, k: usize) -> &Symmetric {
        &self.covariances[self.update_of[k] as usize]
    }

    /// Whether the motion restarts at sample `k`.
    pub(super) fn restarts_at(&self, k: usize) -> bool {
        self.updates[self.update_of[k] as usize].restarts
    }

    /// Residual sum of squares and degrees of freedom of the smoother, by the adjoint of the filter
    /// (Bryson and Frazier 1963; de Jong 1989): with u = e/S + Kᵀλ and d = 1/S + KᵀΛK, both in units
    /// of the measurement's variance, measured − smoothed is u and 1 − Hₖₖ is d. No matrix is inverted,
    /// and n − tr H is a sum of positive terms.
    pub(super) fn score(&self, series: &Series) -> Score {
        let usual = Transition::new(1.0);
        let mut adjoint = [0.0; 4];
        let mut information = [0.0; 10];
        let mut steady = false;
        let mut previous = u32::MAX;
        let (mut rss, mut freedom, mut d) = (0.0, 0.0, 0.0);
        for k in (0..series.z.len()).rev() {
            let index = self.update_of[k];
            let Update { gain, inverse_s, restarts } = &self.updates[index as usize];
            let is_usual = series.ratio[k] == 1.0;
            let transition = if is_usual { usual } else { Transition::new(series.ratio[k]) };
            steady &= index == previous;
            let residual = self.innovations[k] * inverse_s + dot(gain, &adjoint);
            rss += residual * residual;
            adjoint[0] -= residual;
            adjoint = transition.apply_transposed(&adjoint);
            if !(steady && is_usual) {
                let weighted = times(&information, gain);
                d = inverse_s + dot(gain, &weighted);
                let mut next = information;
                next[0] += d - 2.0 * weighted[0];
                next[1] -= weighted[1];
                next[2] -= weighted[2];
                next[3] -= weighted[3];
                next = transition.congruence_transposed(&next);
                steady = is_usual && index == previous && settled(&next, &information);
                information = next;
            }
            freedom += d;
            previous = index;
            if *restarts {
                (adjoint, information) = ([0.0; 4], [0.0; 10]);
            }
        }
        Score { rss, freedom }
    }
}

/// A matrix with this diagonal and nothing else.
fn diagonal(d: [f64; 4]) -> Symmetric {
    [d[0], 0.0, 0.0, 0.0, d[1], 0.0, 0.0, d[2], 0.0, d[3]]
}

/// The update of a predicted covariance, and the filtered one. The measurement's variance is 1.
fn updated(predicted: &Symmetric, restarts: bool) -> (Update, Symmetric) {
    let inverse_s = 1.0 / (predicted[0] + 1.0);
    let [p00, p01, p02, p03, p11, p12, p13, p22, p23, p33] = *predicted;
    let gain = [p00 * inverse_s, p01 * inverse_s, p02 * inverse_s, p03 * inverse_s];
    let covariance = [
        gain[0],
        gain[1],
        gain[2],
        gain[3],
        p11 - gain[1] * p01,
        p12 - gain[1] * p02,
        p13 - gain[1] * p03,
        p22 - gain[2] * p02,
        p23 - gain[2] * p03,
        p33 - gain[3] * p03,
    ];
    (Update { gain, inverse_s, restarts }, covariance)
}

/// Σ log S + e²/S. The logarithms are taken of products, which is a hundred times cheaper.
#[derive(Debug, Default)]
struct LogLikelihood {
    squares: f64,
    logarithms: f64,
    product: Option<f64>,
}

impl LogLikelihood {
    fn add(&mut self, innovation: f64, inverse_s: f64) {
        self.squares += innovation * innovation * inverse_s;
        let product = self.product.unwrap_or(1.0) * inverse_s;
        // 1/S lies in (0, 1]: the product only falls, and is flushed long before it can underflow.
        self.product = if product < 1e-100 {
            self.logarithms -= product.ln();
            None
        } else {
            Some(product)
        };
    }

    fn total(&self) -> f64 {
        self.squares + self.logarithms - self.product.map_or(0.0, f64::ln)
    }
}
