//! Functions known at nodes, for numerical integration.

/// Node spacing, s.
pub(super) const STEP_S: f64 = 0.001;

/// A function given by its value and first two derivatives at equal steps, with a quintic between them.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Nodes {
    pub(super) first_s: f64,
    pub(super) step_s: f64,
    pub(super) rows: Vec<[f64; 3]>,
}

impl Nodes {
    /// Value and three derivatives; outside, those of the nearest end.
    pub(super) fn at(&self, t_s: f64) -> [f64; 4] {
        let last = self.rows.len().saturating_sub(2);
        let steps = ((t_s - self.first_s) / self.step_s).clamp(0.0, (last + 1) as f64);
        let node = (steps as usize).min(last);
        let (Some(&a), Some(&b)) = (self.rows.get(node), self.rows.get(node + 1)) else { return [0.0; 4] };
        quintic(steps - node as f64, self.step_s, a, b)
    }
}

/// The polynomial of degree 5 through value and two derivatives at both ends of a step, and three derivatives.
fn quintic(s: f64, h: f64, a: [f64; 3], b: [f64; 3]) -> [f64; 4] {
    let (a1, a2, b1, b2) = (a[1] * h, a[2] * h * h / 2.0, b[1] * h, b[2] * h * h / 2.0);
    let rise = b[0] - a[0];
    // Coefficients of s³, s⁴, s⁵.
    let (p, q, r) = (rise - a1 - a2, b1 - a1 - 2.0 * a2, b2 - a2);
    let c3 = 10.0 * p - 4.0 * q + r;
    let c4 = -15.0 * p + 7.0 * q - 2.0 * r;
    let c5 = 6.0 * p - 3.0 * q + r;
    [
        a[0] + s * (a1 + s * (a2 + s * (c3 + s * (c4 + s * c5)))),
        (a1 + s * (2.0 * a2 + s * (3.0 * c3 + s * (4.0 * c4 + s * 5.0 * c5)))) / h,
        (2.0 * a2 + s * (6.0 * c3 + s * (12.0 * c4 + s * 20.0 * c5))) / (h * h),
        (6.0 * c3 + s * (24.0 * c4 + s * 60.0 * c5)) / (h * h * h),
    ]
}

/// Three functions after a first-order lag: `τ y′ = u − y`, from the steady state at `from_s`.
#[derive(Debug, Clone)]
pub(super) struct Lagged {
    first_s: f64,
    /// Value and slope of each component.
    rows: Vec<[[f64; 2]; 3]>,
}

/// Node spacing of a lag, s.
const LAG_STEP_S: f64 = 0.002;

impl Lagged {
    /// The input is taken as a parabola over each step, and the integral of that is exact.
    pub(super) fn new(input: impl Fn(f64) -> [f64; 3], time_constant_s: f64, from_s: f64, to_s: f64) -> Lagged {
        let (h, tau) = (LAG_STEP_S, time_constant_s);
        let weights = parabola_weights(h / tau);
        let keep = (-h / tau).exp();
        let count = ((to_s - from_s) / h).ceil() as usize + 1;
        let mut u0 = input(from_s);
        let mut y = u0;
        let mut rows = Vec::with_capacity(count + 1);
        for node in 0..=count {
            rows.push([0, 1, 2].map(|k| [y[k], (u0[k] - y[k]) / tau]));
            let t = from_s + node as f64 * h;
            let (um, u1) = (input(t + h / 2.0), input(t + h));
            y = [0, 1, 2].map(|k| keep * y[k] + weights[0] * u0[k] + weights[1] * um[k] + weights[2] * u1[k]);
            u0 = u1;
        }
        Lagged { first_s: from_s, rows }
    }

    /// A cubic between nodes.
    pub(super) fn at(&self, t_s: f64) -> [f64; 3] {
        let last = self.rows.len().saturating_sub(2);
        let steps = ((t_s - self.first_s) / LAG_STEP_S).clamp(0.0, (last + 1) as f64);
        let node = (steps as usize).min(last);
        let (Some(a), Some(b)) = (self.rows.get(node), self.rows.get(node + 1)) else { return [0.0; 3] };
        let s = steps - node as f64;
        let r = 1.0 - s;
        [0, 1, 2].map(|k| {
            let ([y0, d0], [y1, d1]) = (a[k], b[k]);
            y0 + (y1 - y0) * s * s * (3.0 - 2.0 * s) + LAG_STEP_S * s * r * (d0 * r - d1 * s)
        })
    }
}

/// Weights of the input at the start, the middle and the end of a step of `x` time constants:
/// `∫₀¹ x e^{−x(1−s)} ℓ(s) ds` for the three parabolas ℓ.
fn parabola_weights(x: f64) -> [f64; 3] {
    // Moments m_n = ∫ x e^{−x(1−s)} sⁿ ds, by parts: m_n = 1 − (n/x) m_{n−1}; as a series for small x.
    let [m0, m1, m2] = if x > 0.5 {
        let m0 = -(-x).exp_m1();
        let m1 = 1.0 - m0 / x;
        [m0, m1, 1.0 - 2.0 * m1 / x]
    } else {
        [0, 1, 2].map(|n| moment(x, n))
    };
    [m0 - 3.0 * m1 + 2.0 * m2, 4.0 * (m1 - m2), 2.0 * m2 - m1]
}

/// `Σ x (−x)^k n!/(n+k+1)!`.
fn moment(x: f64, n: u32) -> f64 {
    let mut term = x / f64::from(n + 1);
    let mut sum = term;
    for k in 1..20_u32 {
        term *= -x / f64::from(n + k + 1);
        sum += term;
    }
    sum
}
