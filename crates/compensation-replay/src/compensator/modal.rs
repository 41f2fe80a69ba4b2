//! Any Padé form at any step, mode by mode.

use crate::compensator::PadeForm;
use crate::compensator::filtered::VelocityFilter;
use nalgebra::Complex;
use record::StartRule;

/// How the continuous filter is discretised.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Discretisation {
    /// Trapezoidal rule, as in the paper. At a constant step it equals the bilinear transform.
    Tustin,
    /// First-order hold: exact for a velocity that is linear between its samples. The best of the four.
    Foh,
    /// Zero-order hold: the new sample takes effect at the next step, half a step late.
    Zoh,
    /// Matched pole and a zero at the Nyquist frequency; first order only.
    Matched,
}

impl Discretisation {
    /// Name as in a pipeline.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Discretisation::Tustin => "tustin",
            Discretisation::Foh => "foh",
            Discretisation::Zoh => "zoh",
            Discretisation::Matched => "matched",
        }
    }
}

/// `z⁺ = φ z + before · v_{k−1} + now · v_k` for one mode and one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct StepGains {
    pub(crate) decay: Complex<f64>,
    pub(crate) before: Complex<f64>,
    pub(crate) now: Complex<f64>,
}

/// One mode: `z′ = λ z + v`, which contributes `Re(share · z)` to the output.
#[derive(Debug, Clone, Copy, PartialEq)]
struct ModeState {
    lambda: Complex<f64>,
    share: Complex<f64>,
    z: Complex<f64>,
    gains: StepGains,
}

/// A Padé form as a sum of its modes (design note 5.4): any order, any step, no matrix exponential.
///
/// First-order hold, with `φ = e^{λh}`, λ = pole/Td:
/// `z ← φ z + ((φ−1)/λ) v_{k−1} + ((φ−1−λh)/(λ²h)) (v_k − v_{k−1})`, `y = Σ Re(ρ z)`, conjugate pairs once with twice the
/// `(φ−1)/λ` and similar factors are computed from series if `|λh|` is small. Tustin, ZOH and matched differ only in
/// the three factors. At a constant step all equal their direct forms to rounding (test
/// `the_discrete_filters_match_the_vectors`), without the ill-conditioned coefficients of those.
///
/// The factors of the last step are kept and reused for steps that differ by less than a relative 1e-9, which covers
/// the rounding of timestamps in seconds.
#[derive(Debug, Clone, PartialEq)]
pub struct ModalFilter {
    form: PadeForm,
    rule: Discretisation,
    delay_s: f64,
    step_s: f64,
    velocity: f64,
    output: f64,
    modes: Vec<ModeState>,
}

impl ModalFilter {
    /// Starts at rest. `None` if the delay is not positive and finite, or matched is requested for a higher order.
    #[must_use]
    pub fn new(form: &PadeForm, rule: Discretisation, delay_s: f64) -> Option<ModalFilter> {
        let first_order = form.degrees().1 == 1;
        if !(delay_s > 0.0 && delay_s.is_finite()) || (rule == Discretisation::Matched && !first_order) {
            return None;
        }
        let zero = Complex::new(0.0, 0.0);
        let none = StepGains { decay: zero, before: zero, now: zero };
        let modes = form.modes().iter().map(|mode| ModeState {
            lambda: mode.pole / delay_s,
            share: mode.residue * mode.weight(),
            z: zero,
            gains: none,
        });
        let modes = modes.collect();
        Some(ModalFilter { form: form.clone(), rule, delay_s, step_s: 0.0, velocity: 0.0, output: 0.0, modes })
    }

    /// The discretised form.
    #[must_use]
    pub fn form(&self) -> &PadeForm {
        &self.form
    }

    /// The discretisation.
    #[must_use]
    pub fn rule(&self) -> Discretisation {
        self.rule
    }

    /// The delay, s.
    #[must_use]
    pub fn delay_s(&self) -> f64 {
        self.delay_s
    }

    /// Factors of each mode at a step of `h` s, each with its share of the output.
    pub(crate) fn gains_at(&self, h: f64) -> Vec<(StepGains, Complex<f64>)> {
        self.modes.iter().map(|mode| (step_gains(self.rule, mode.lambda, h), mode.share)).collect()
    }

    /// Warm state per m/s of velocity, for each mode.
    pub(crate) fn warm_gains(&self) -> Vec<Complex<f64>> {
        self.modes.iter().map(|mode| -mode.lambda.inv()).collect()
    }

    /// `b` and `a` of `Σ a_i y[k−i] = Σ b_i v[k−i]`, `a_0 = 1`, at a constant step. For a page or a controller of first
    /// or second order; higher orders lose digits in this form.
    #[must_use]
    pub fn direct_form(&self, h: f64) -> (Vec<f64>, Vec<f64>) {
        let all: Vec<(StepGains, Complex<f64>)> = self.gains_at(h).into_iter().flat_map(both).collect();
        let one = vec![Complex::new(1.0, 0.0)];
        let poles = |skip: Option<usize>| {
            let kept = all.iter().enumerate().filter(|(k, _)| Some(*k) != skip);
            kept.fold(one.clone(), |product, (_, (gains, _))| times(&product, [1.0.into(), -gains.decay]))
        };
        let mut b = vec![Complex::new(0.0, 0.0); all.len() + 1];
        for (k, (gains, share)) in all.iter().enumerate() {
            let term = times(&poles(Some(k)), [share * gains.now, share * gains.before]);
            b.iter_mut().zip(term).for_each(|(sum, x)| *sum += x);
        }
        let real = |x: Vec<Complex<f64>>| x.into_iter().map(|x| x.re).collect();
        (real(b), real(poles(None)))
    }

    /// `H(e^{jωh})`: displacement over velocity, s, for motion of the angle `ωh` per step of `h` seconds.
    pub(crate) fn response(&self, angle: f64, h: f64) -> Complex<f64> {
        let before = Complex::from_polar(1.0, -angle);
        let mode = |(gains, share): (StepGains, Complex<f64>)| {
            share * (gains.now + gains.before * before) / (Complex::from(1.0) - gains.decay * before)
        };
        self.gains_at(h).into_iter().flat_map(both).map(mode).sum()
    }

    fn set_step(&mut self, h: f64) {
        self.step_s = h;
        for mode in &mut self.modes {
            mode.gains = step_gains(self.rule, mode.lambda, h);
        }
    }
}

impl VelocityFilter for ModalFilter {
    fn delay_s(&self) -> f64 {
        self.delay_s
    }

    fn start(&mut self, velocity: f64, rule: StartRule, step_s: f64) {
        let before = if rule == StartRule::Cold { 0.0 } else { velocity };
        let mut output = 0.0;
        for mode in &mut self.modes {
            mode.z = -mode.lambda.inv() * before;
            output += (mode.share * mode.z).re;
        }
        self.velocity = before;
        self.output = output;
        if rule == StartRule::Cold {
            self.step(step_s, velocity);
        }
    }

    fn step(&mut self, h: f64, velocity: f64) -> f64 {
        if (h - self.step_s).abs() > 1e-9 * self.step_s {
            self.set_step(h);
        }
        let before = self.velocity;
        let mut output = 0.0;
        for mode in &mut self.modes {
            // Written out because the C export performs the same operations in the same order.
            let (z, g) = (mode.z, mode.gains);
            let re = (g.decay.re * z.re - g.decay.im * z.im) + (g.before.re * before + g.now.re * velocity);
            let im = (g.decay.re * z.im + g.decay.im * z.re) + (g.before.im * before + g.now.im * velocity);
            mode.z = Complex::new(re, im);
            output += mode.share.re * re - mode.share.im * im;
        }
        self.velocity = velocity;
        self.output = output;
        output
    }

    fn displacement(&self) -> f64 {
        self.output
    }
}

/// The factors of one mode for one step.
pub(crate) fn step_gains(rule: Discretisation, lambda: Complex<f64>, h: f64) -> StepGains {
    let zero = Complex::new(0.0, 0.0);
    if rule == Discretisation::Tustin {
        let half = lambda * (0.5 * h);
        let below = Complex::new(1.0, 0.0) - half;
        let gain = Complex::from(0.5 * h) / below;
        return StepGains { decay: (half + 1.0) / below, before: gain, now: gain };
    }
    let (decay, mean, ramp) = exponentials(lambda * h);
    match rule {
        Discretisation::Foh => StepGains { decay, before: (mean - ramp) * h, now: ramp * h },
        Discretisation::Zoh => StepGains { decay, before: mean * h, now: zero },
        Discretisation::Matched | Discretisation::Tustin => {
            StepGains { decay, before: mean * (0.5 * h), now: mean * (0.5 * h) }
        }
    }
}

/// Below this |λh| the series is used.
const SERIES_BELOW: f64 = 0.1;

/// Ratio of consecutive terms of `Σ x^k/(k+2)!`, divided by x; the remainder is below 1e-19.
const RATIOS: [f64; 10] = [1.0 / 3.0, 0.25, 0.2, 1.0 / 6.0, 1.0 / 7.0, 0.125, 1.0 / 9.0, 0.1, 1.0 / 11.0, 1.0 / 12.0];

/// `e^x`, `(e^x − 1)/x` and `(e^x − 1 − x)/x²`, without cancellation for small x.
fn exponentials(x: Complex<f64>) -> (Complex<f64>, Complex<f64>, Complex<f64>) {
    if x.im == 0.0 {
        let (decay, mean, ramp) = real_exponentials(x.re);
        return (decay.into(), mean.into(), ramp.into());
    }
    if x.norm_sqr() < SERIES_BELOW * SERIES_BELOW {
        let ramp = RATIOS.iter().rev().fold(Complex::new(0.0, 0.0), |sum, ratio| sum * x * ratio + 1.0) * 0.5;
        let mean = x * ramp + 1.0;
        return (x * mean + 1.0, mean, ramp);
    }
    let decay = x.exp();
    let mean = (decay - 1.0) / x;
    (decay, mean, (mean - 1.0) / x)
}

/// The same for a real pole.
fn real_exponentials(x: f64) -> (f64, f64, f64) {
    if x.abs() < SERIES_BELOW {
        let ramp = RATIOS.iter().rev().fold(0.0, |sum, ratio| sum * x * ratio + 1.0) * 0.5;
        let mean = x * ramp + 1.0;
        return (x * mean + 1.0, mean, ramp);
    }
    let less_one = x.exp_m1();
    let mean = less_one / x;
    (less_one + 1.0, mean, (mean - 1.0) / x)
}

fn both((gains, share): (StepGains, Complex<f64>)) -> Vec<(StepGains, Complex<f64>)> {
    if gains.decay.im == 0.0 && share.im == 0.0 {
        return vec![(gains, share)];
    }
    let conjugate = StepGains { decay: gains.decay.conj(), before: gains.before.conj(), now: gains.now.conj() };
    vec![(gains, share * 0.5), (conjugate, share.conj() * 0.5)]
}

/// A polynomial in z⁻¹, rising powers, times `c[0] + c[1] z⁻¹`.
fn times(polynomial: &[Complex<f64>], c: [Complex<f64>; 2]) -> Vec<Complex<f64>> {
    let mut out = vec![Complex::new(0.0, 0.0); polynomial.len() + 1];
    for (k, x) in polynomial.iter().enumerate() {
        out[k] += x * c[0];
        out[k + 1] += x * c[1];
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_factors_are_continuous_between_series_and_formula() {
        for angle in [2.0, 2.5, std::f64::consts::PI] {
            let [inside, outside] =
                [SERIES_BELOW - 1e-13, SERIES_BELOW + 1e-13].map(|r| exponentials(Complex::from_polar(r, angle)));
            assert!((inside.0 - outside.0).norm() < 1e-12);
            assert!((inside.1 - outside.1).norm() < 1e-12);
            assert!((inside.2 - outside.2).norm() < 2e-12);
        }
        // A real pole has its own code path: the result must equal that of a pole very close to it.
        for x in [-0.05, -0.099, -0.2, -3.0] {
            let (real, neighbour) = (exponentials(x.into()), exponentials(Complex::new(x, 1e-13)));
            assert!((real.0 - neighbour.0).norm() < 1e-12);
            assert!((real.1 - neighbour.1).norm() < 1e-12);
            assert!((real.2 - neighbour.2).norm() < 1e-12);
        }
    }

    /// Compared with the sums of Σ x^k/k!, Σ x^k/(k+1)! and Σ x^k/(k+2)!.
    #[test]
    fn the_factors_equal_their_power_series() {
        for size in [0.003, 0.05, 0.0999, 0.1001, 0.7] {
            for angle in [0.0, 0.4, 2.0, 2.9, std::f64::consts::PI, -1.3] {
                let x = Complex::from_polar(size, angle);
                let series = |shift: u32| {
                    let first = 1.0 / f64::from((1..=shift).product::<u32>());
                    let next = |(sum, term): (Complex<f64>, Complex<f64>), k: u32| {
                        (sum + term, term * x / f64::from(k + shift))
                    };
                    (1..40).fold((Complex::from(0.0), Complex::from(first)), next).0
                };
                let found = exponentials(x);
                for (found, shift) in [found.0, found.1, found.2].into_iter().zip(0..) {
                    assert!((found - series(shift)).norm() < 1e-13 / size, "{x}: {found} {}", series(shift));
                }
            }
        }
    }
}
