//! Septic Hermite interpolation: value and three derivatives at both ends of an interval.

/// Value and first three derivatives at `t` between two instants, from the unique polynomial of degree 7 that has the
/// given value and three derivatives at both. Between the knots of a four-state smoother this is the conditional mean
/// of the motion, not an approximation (Wahba 1978).
///
/// `start` and `end` are x, x′, x″, x‴ at `t_start` and `t_end` (s, different).
#[must_use]
pub fn septic_hermite(t_start: f64, start: &[f64; 4], t_end: f64, end: &[f64; 4], t: f64) -> [f64; 4] {
    let length = t_end - t_start;
    let unscaled = at_share(&scaled(start, length), &scaled(end, length), (t - t_start) / length);
    let (l2, l3) = (length * length, length * length * length);
    [unscaled[0], unscaled[1] / length, 2.0 * unscaled[2] / l2, 6.0 * unscaled[3] / l3]
}

/// Lⁱ/i! x⁽ⁱ⁾.
fn scaled(x: &[f64; 4], length: f64) -> [f64; 4] {
    [x[0], x[1] * length, 0.5 * x[2] * length * length, x[3] * length * length * length / 6.0]
}

/// Scaled states at the fraction `u` of the interval.
///
/// The polynomial is the Taylor polynomial of the start, plus u⁴ times a cubic in v = u − 1 that corrects its error at
/// the end.
pub(crate) fn at_share(start: &[f64; 4], end: &[f64; 4], u: f64) -> [f64; 4] {
    let missed = {
        let reached = taylor(start, 1.0);
        [end[0] - reached[0], end[1] - reached[1], end[2] - reached[2], end[3] - reached[3]]
    };
    let e0 = missed[0];
    let e1 = missed[1] - 4.0 * e0;
    let e2 = missed[2] - 4.0 * e1 - 6.0 * e0;
    let e3 = missed[3] - 4.0 * e2 - 6.0 * e1 - 4.0 * e0;
    let cubic = taylor(&[e0, e1, e2, e3], u - 1.0);
    let (u2, u3) = (u * u, u * u * u);
    let power = [u2 * u2, 4.0 * u3, 6.0 * u2, 4.0 * u];
    let mut x = taylor(start, u);
    for i in 0..4 {
        for j in 0..=i {
            x[i] += power[j] * cubic[i - j];
        }
    }
    x
}

/// Scaled states of a cubic, shifted by `u`.
fn taylor(a: &[f64; 4], u: f64) -> [f64; 4] {
    [a[0] + u * (a[1] + u * (a[2] + u * a[3])), a[1] + u * (2.0 * a[2] + u * 3.0 * a[3]), a[2] + u * 3.0 * a[3], a[3]]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn polynomial(t: f64) -> [f64; 4] {
        let c = [0.7, -1.1, 0.4, 2.0, -0.3, 1.5, -0.8, 0.6];
        std::array::from_fn(|d| {
            (d..8).map(|p| c[p] * ((p + 1 - d)..=p).map(|m| m as f64).product::<f64>() * t.powi((p - d) as i32)).sum()
        })
    }

    #[test]
    fn a_polynomial_of_degree_seven_is_reproduced_exactly() {
        let (a, b) = (-0.4, 1.3);
        for step in 0..=40 {
            let t = a + (b - a) * f64::from(step) / 40.0;
            let found = septic_hermite(a, &polynomial(a), b, &polynomial(b), t);
            for (found, expected) in found.iter().zip(polynomial(t)) {
                // Derivatives of order 3 are scaled by 6/L³; the largest is about 300.
                assert!((found - expected).abs() < 1e-12 * 300.0, "{found} {expected} at {t}");
            }
        }
    }

    #[test]
    fn a_very_short_interval_is_exact_at_its_ends() {
        let (a, b) = (100.0, 100.000_1);
        let (start, end) = ([1.0, 5.0, 20.0, 50.0], [1.0 + 5e-4, 5.002, 20.005, 50.0]);
        let found = septic_hermite(a, &start, b, &end, b);
        for i in 0..3 {
            assert!((found[i] - end[i]).abs() < 1e-9 * end[i].abs(), "{i}: {}", found[i]);
        }
        assert_eq!(septic_hermite(a, &start, b, &end, a)[0], 1.0);
    }
}
