//! Minimises a function of one variable.

/// The minimum of the function on `[low, high]`, to within `tolerance`: golden section with parabolic steps (Brent
/// 1973, ch. 5; the bounded form of Forsythe, Malcolm and Moler 1977). If there are several local minima, one of them
/// is found. The function must not return NaN.
pub(super) fn least(mut f: impl FnMut(f64) -> f64, low: f64, high: f64, tolerance: f64) -> f64 {
    let golden = 0.5 * (3.0 - 5f64.sqrt());
    let (mut a, mut b) = (low, high);
    let mut best = a + golden * (b - a);
    let (mut second, mut third) = (best, best);
    let mut f_best = f(best);
    let (mut f_second, mut f_third) = (f_best, f_best);
    let (mut step, mut before_last) = (0.0_f64, 0.0_f64);
    for _ in 0..100 {
        let middle = 0.5 * (a + b);
        if (best - middle).abs() <= 2.0 * tolerance - 0.5 * (b - a) {
            break;
        }
        let r = (best - second) * (f_best - f_third);
        let q = (best - third) * (f_best - f_second);
        let (mut p, mut q) = ((best - third) * q - (best - second) * r, 2.0 * (q - r));
        if q > 0.0 {
            p = -p;
        }
        q = q.abs();
        let fits = p.abs() < (0.5 * q * before_last).abs() && p > q * (a - best) && p < q * (b - best);
        before_last = step;
        step = if fits { p / q } else { golden * (if best < middle { b - best } else { a - best }) };
        let aimed = best + step;
        if fits && (aimed - a < 2.0 * tolerance || b - aimed < 2.0 * tolerance) {
            step = tolerance * (middle - best).signum();
        }
        if !fits {
            before_last = if best < middle { b - best } else { a - best };
        }
        let x = best + if step.abs() >= tolerance { step } else { tolerance * step.signum() };
        let f_x = f(x);
        if f_x <= f_best {
            *(if x < best { &mut b } else { &mut a }) = best;
            (third, f_third, second, f_second, best, f_best) = (second, f_second, best, f_best, x, f_x);
        } else {
            *(if x < best { &mut a } else { &mut b }) = x;
            if f_x <= f_second || second == best {
                (third, f_third, second, f_second) = (second, f_second, x, f_x);
            } else if f_x <= f_third || third == best || third == second {
                (third, f_third) = (x, f_x);
            }
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_minimum_is_found_inside_and_at_an_end() {
        let mut calls = 0;
        let inside = least(
            |x| {
                calls += 1;
                (x - 1.3).powi(4) + 0.1 * (x - 1.3).powi(2)
            },
            -4.0,
            7.0,
            1e-3,
        );
        assert!((inside - 1.3).abs() < 3e-3 && calls < 40, "{inside} after {calls}");
        assert!((least(|x| x, 2.0, 9.0, 1e-3) - 2.0).abs() < 4e-3);
        assert!((least(|x| -x.exp(), 2.0, 9.0, 1e-3) - 9.0).abs() < 4e-3);
        assert!(least(|_| 0.0, 0.0, 1.0, 1e-3).is_finite());
        assert!(least(|_| f64::INFINITY, 0.0, 1.0, 1e-3).is_finite());
    }
}
