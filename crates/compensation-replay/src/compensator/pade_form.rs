//! The Padé family of compensators, before any discretisation.

use nalgebra::Complex;
use std::f64::consts::{PI, TAU};

/// Largest denominator degree: above it, residues of opposite sign cancel more digits than the higher order gains.
const MAX_DEGREE: usize = 8;

/// An exact fraction in lowest terms, with a positive denominator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Fraction {
    /// Numerator.
    pub numerator: i64,
    /// Denominator.
    pub denominator: i64,
}

impl Fraction {
    fn new(numerator: i128, denominator: i128) -> Fraction {
        let common = gcd(numerator.unsigned_abs(), denominator.unsigned_abs()).max(1) as i128;
        // For degrees up to 8 both fit easily.
        Fraction { numerator: (numerator / common) as i64, denominator: (denominator / common) as i64 }
    }

    /// The nearest float.
    #[must_use]
    pub fn value(self) -> f64 {
        self.numerator as f64 / self.denominator as f64
    }

    fn minus(self, other: Fraction) -> Fraction {
        let [a, b, c, d] = [self.numerator, self.denominator, other.numerator, other.denominator].map(i128::from);
        Fraction::new(a * d - c * b, b * d)
    }
}

impl std::fmt::Display for Fraction {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.denominator {
            1 => write!(f, "{}", self.numerator),
            below => write!(f, "{}/{below}", self.numerator),
        }
    }
}

fn gcd(a: u128, b: u128) -> u128 {
    if b == 0 { a } else { gcd(b, a % b) }
}

fn factorial(n: usize) -> i128 {
    (1..=n as i128).product()
}

/// Why a filter is rejected.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PadeRefusal {
    /// `R` must not grow with frequency.
    #[error("[{m}/{n}] is not proper: it needs 1 ≤ n and m ≤ n, or it would differentiate velocity")]
    NotProper {
        /// Degree of P.
        m: usize,
        /// Degree of Q.
        n: usize,
    },
    /// Rounding would cancel the gain of the order.
    #[error("[{m}/{n}]: degrees above {MAX_DEGREE} lose their gain to rounding")]
    DegreeTooHigh {
        /// Degree of P.
        m: usize,
        /// Degree of Q.
        n: usize,
    },
    /// The filter would diverge.
    #[error("[{m}/{n}] is unstable: a pole at {real:+.4} ± j{imaginary:.4}, over Td, in the right half plane")]
    Unstable {
        /// Degree of P.
        m: usize,
        /// Degree of Q.
        n: usize,
        /// Pole times Td, real part.
        real: f64,
        /// Pole times Td, imaginary part.
        imaginary: f64,
    },
    /// Stable, but with a gain above that of a delay: not `n − 2 ≤ m ≤ n`.
    #[error("[{m}/{n}] is not A-acceptable (that needs n − 2 ≤ m ≤ n): |R| reaches {peak:.3} at f·Td = {at_f_td:.2}")]
    NotAcceptable {
        /// Degree of P.
        m: usize,
        /// Degree of Q.
        n: usize,
        /// Largest |R(jω)|; that of a delay is 1.
        peak: f64,
        /// Frequency of that maximum, times Td.
        at_f_td: f64,
    },
}

/// A pole of G with its residue; one entry per conjugate pair.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mode {
    /// Pole times Td; its imaginary part is not negative.
    pub pole: Complex<f64>,
    /// `N(x)/Q′(x)` at the pole: `G(s) = Σ residue / (s − pole/Td)`.
    pub residue: Complex<f64>,
}

impl Mode {
    /// 1 for a real pole, 2 for a conjugate pair: `y = Σ weight · Re(residue · z)`.
    #[must_use]
    pub fn weight(&self) -> f64 {
        if self.pole.im == 0.0 { 1.0 } else { 2.0 }
    }
}

/// `e^{−x} ≈ R(x) = P_m(x)/Q_n(x)` with `x = s Td`, which makes `(1 − e^{−s Td})/s ≈ G(s) = Td N(x)/Q(x)`,
/// `N = (Q − P)/x` (design note 5.2): displacement during the delay from velocity.
///
/// The DC gain is always Td. Compared with the exact form the error is `e^{−x} − R(x)` of the amplitude
/// ([`error`](PadeForm::error)). The forms with `n − 2 ≤ m ≤ n` are stable and their gain never exceeds that of a delay
/// (the A-acceptable approximations; Hairer & Wanner, Solving ODEs II, theorem IV.4.12). All others are rejected.
#[derive(Debug, Clone, PartialEq)]
pub struct PadeForm {
    m: usize,
    n: usize,
    p: Vec<Fraction>,
    q: Vec<Fraction>,
    numerator: Vec<Fraction>,
    modes: Vec<Mode>,
}

impl PadeForm {
    /// The \[m/n\] form.
    ///
    /// # Errors
    /// [`PadeRefusal`] with the reason: improper, unstable, not A-acceptable or too high.
    pub fn new(m: usize, n: usize) -> Result<PadeForm, PadeRefusal> {
        if n == 0 || m > n {
            return Err(PadeRefusal::NotProper { m, n });
        }
        if n > MAX_DEGREE {
            return Err(PadeRefusal::DegreeTooHigh { m, n });
        }
        let (p, q) = (coefficients(m, n, -1), coefficients(n, m, 1));
        let numerator = (1..=n).map(|j| q[j].minus(p.get(j).copied().unwrap_or(Fraction::new(0, 1)))).collect();
        let mut form = PadeForm { m, n, p, q, numerator, modes: vec![] };
        let poles = roots(&floats(&form.q));
        if let Some(pole) = poles.iter().find(|x| x.re >= 0.0) {
            return Err(PadeRefusal::Unstable { m, n, real: pole.re, imaginary: pole.im });
        }
        if m + 2 < n {
            let (peak, at_f_td) = form.peak_gain();
            return Err(PadeRefusal::NotAcceptable { m, n, peak, at_f_td });
        }
        let (above, below) = (floats(&form.numerator), derivative(&floats(&form.q)));
        form.modes = poles
            .into_iter()
            .map(|pole| Mode { pole, residue: horner(&above, pole) / horner(&below, pole) })
            .map(|mode| if mode.pole.im == 0.0 { Mode { residue: mode.residue.re.into(), ..mode } } else { mode })
            .collect();
        Ok(form)
    }

    /// Degrees of P and of Q.
    #[must_use]
    pub fn degrees(&self) -> (usize, usize) {
        (self.m, self.n)
    }

    /// Coefficients of P, rising powers of x.
    #[must_use]
    pub fn p(&self) -> &[Fraction] {
        &self.p
    }

    /// Coefficients of Q, rising powers of x.
    #[must_use]
    pub fn q(&self) -> &[Fraction] {
        &self.q
    }

    /// Coefficients of N, rising powers of x; n of them, the highest may be zero.
    #[must_use]
    pub fn numerator(&self) -> &[Fraction] {
        &self.numerator
    }

    /// Poles with residues, slowest decay last.
    #[must_use]
    pub fn modes(&self) -> &[Mode] {
        &self.modes
    }

    /// `R(x)` at `x = j 2π f Td`, the approximation of the delay.
    #[must_use]
    pub fn delay_at(&self, f_td: f64) -> Complex<f64> {
        let x = Complex::new(0.0, TAU * f_td);
        horner(&floats(&self.p), x) / horner(&floats(&self.q), x)
    }

    /// `x_est/x − 1 = e^{−x} − R(x)` at `x = j 2π f Td`, of the continuous filter (design note 5.3).
    #[must_use]
    pub fn error(&self, f_td: f64) -> Complex<f64> {
        Complex::from_polar(1.0, -TAU * f_td) - self.delay_at(f_td)
    }

    /// `∫ g² dt / Td` of the impulse response: variance of the output per `Td · dt · σ_v²` of white velocity noise.
    /// 1 for all \[n/n\], as for the exact form (design note 5.5).
    #[must_use]
    pub fn noise_gain(&self) -> f64 {
        let all: Vec<Mode> = self.modes.iter().flat_map(|mode| both_of_pair(*mode)).collect();
        let pair = |a: &Mode, b: &Mode| -(a.residue * b.residue / (a.pole + b.pole)).re;
        all.iter().map(|a| all.iter().map(|b| pair(a, b)).sum::<f64>()).sum()
    }

    /// Largest |R| on the imaginary axis and its f·Td.
    fn peak_gain(&self) -> (f64, f64) {
        let scan = (1..=4000).map(|k| f64::from(k) * 1e-3);
        scan.map(|f_td| (self.delay_at(f_td).norm(), f_td)).fold((0.0, 0.0), |a, b| if b.0 > a.0 { b } else { a })
    }
}

fn both_of_pair(mode: Mode) -> Vec<Mode> {
    let conjugate = Mode { pole: mode.pole.conj(), residue: mode.residue.conj() };
    if mode.pole.im == 0.0 { vec![mode] } else { vec![mode, conjugate] }
}

/// `(m+n−j)! m! / ((m+n)! j! (m−j)!) · sign^j` for j up to `own`; `other` is the other degree.
fn coefficients(own: usize, other: usize, sign: i128) -> Vec<Fraction> {
    let all = own + other;
    let term = |j: usize| {
        let above = factorial(all - j) * factorial(own);
        Fraction::new(sign.pow(j as u32) * above, factorial(all) * factorial(j) * factorial(own - j))
    };
    (0..=own).map(term).collect()
}

fn floats(fractions: &[Fraction]) -> Vec<f64> {
    fractions.iter().map(|f| f.value()).collect()
}

fn derivative(rising: &[f64]) -> Vec<f64> {
    rising.iter().enumerate().skip(1).map(|(j, c)| j as f64 * c).collect()
}

fn horner(rising: &[f64], x: Complex<f64>) -> Complex<f64> {
    rising.iter().rev().fold(Complex::new(0.0, 0.0), |sum, c| sum * x + c)
}

/// Roots of a real polynomial, one of each conjugate pair (the upper), fastest decay first: Aberth's iteration.
fn roots(rising: &[f64]) -> Vec<Complex<f64>> {
    let degree = rising.len() - 1;
    let slope = derivative(rising);
    let radius = (rising[0] / rising[degree]).abs().powf(1.0 / degree as f64);
    let mut roots: Vec<Complex<f64>> =
        (0..degree).map(|k| Complex::from_polar(radius, 2.0 * PI * k as f64 / degree as f64 + 0.4)).collect();
    for _ in 0..200 {
        let mut moved: f64 = 0.0;
        for k in 0..degree {
            let newton = horner(rising, roots[k]) / horner(&slope, roots[k]);
            let others = (0..degree).filter(|&j| j != k).map(|j| (roots[k] - roots[j]).inv());
            let step = newton / (Complex::new(1.0, 0.0) - newton * others.sum::<Complex<f64>>());
            roots[k] -= step;
            moved = moved.max(step.norm());
        }
        if moved <= 1e-16 * radius {
            break;
        }
    }
    let near_axis = |x: &Complex<f64>| x.im.abs() < 1e-9 * radius;
    let mut upper: Vec<Complex<f64>> = roots
        .into_iter()
        .filter(|x| near_axis(x) || x.im > 0.0)
        .map(|x| if near_axis(&x) { x.re.into() } else { x })
        .collect();
    upper.sort_by(|a, b| a.re.total_cmp(&b.re).then(a.im.total_cmp(&b.im)));
    upper
}
