//! The lowest point of a function without derivatives.

/// The minimum of the function on `[low, high]`, to within `tolerance`, and its value there: golden section with
/// parabolic steps (Brent 1973, ch. 5; the bounded form of Forsythe, Malcolm and Moler 1977). If there are several local
/// minima, one of them is found. The function must not return NaN.
pub fn least_between(mut f: impl FnMut(f64) -> f64, (low, high): (f64, f64), tolerance: f64) -> (f64, f64) {
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
    (best, f_best)
}

/// Stopping criteria of a search.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Tolerance<const N: usize> {
    /// Size of the simplex along each axis.
    pub(crate) x: [f64; N],
    /// Difference of its values.
    pub(crate) f: f64,
    /// Evaluations at most.
    pub(crate) evaluations: usize,
}

/// The best point found.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lowest<const N: usize> {
    pub(crate) at: [f64; N],
    pub(crate) value: f64,
}

impl<const N: usize> Lowest<N> {
    /// NaN counts as a wall.
    fn at(at: [f64; N], value: f64) -> Lowest<N> {
        Lowest { at, value: if value.is_nan() { f64::INFINITY } else { value } }
    }
}

/// Simplex search of Nelder and Mead (1965) with the usual coefficients (1, 2, ½, ½), from `start` and the points
/// `step` away from it along each axis. Infinite values are walls.
pub(crate) fn nelder_mead<const N: usize>(
    mut f: impl FnMut(&[f64; N]) -> f64,
    start: [f64; N],
    step: [f64; N],
    tolerance: &Tolerance<N>,
) -> Lowest<N> {
    let mut evaluations = 0;
    let mut evaluate = |at: [f64; N]| {
        evaluations += 1;
        (Lowest::at(at, f(&at)), evaluations)
    };
    let mut simplex: Vec<Lowest<N>> = first_points(start, step).map(|at| evaluate(at).0).collect();
    loop {
        simplex.sort_by(|a, b| a.value.total_cmp(&b.value));
        let (best, worst, second) = (simplex[0], simplex[N], simplex[N - 1]);
        if (!is_wide(&simplex, &tolerance.x) && worst.value - best.value <= tolerance.f) || !best.value.is_finite() {
            return best;
        }
        let centre = centre(&simplex[..N]);
        let along = |s: f64| -> [f64; N] { std::array::from_fn(|i| centre[i] + s * (worst.at[i] - centre[i])) };
        let (reflected, used) = evaluate(along(-1.0));
        if used >= tolerance.evaluations {
            return if reflected.value < best.value { reflected } else { best };
        }
        if reflected.value < best.value {
            let (expanded, _) = evaluate(along(-2.0));
            simplex[N] = if expanded.value < reflected.value { expanded } else { reflected };
        } else if reflected.value < second.value {
            simplex[N] = reflected;
        } else {
            let (contracted, _) = evaluate(along(if reflected.value < worst.value { -0.5 } else { 0.5 }));
            if contracted.value < worst.value.min(reflected.value) {
                simplex[N] = contracted;
            } else {
                for point in &mut simplex[1..] {
                    *point = evaluate(std::array::from_fn(|i| 0.5 * (best.at[i] + point.at[i]))).0;
                }
            }
        }
    }
}

/// `start`, and the points `step` away from it along each axis.
fn first_points<const N: usize>(start: [f64; N], step: [f64; N]) -> impl Iterator<Item = [f64; N]> {
    let neighbour = move |axis: usize| {
        let mut at = start;
        at[axis] += step[axis];
        at
    };
    std::iter::once(start).chain((0..N).map(neighbour))
}

/// Whether any point is further than `limit` from the first along any axis.
fn is_wide<const N: usize>(simplex: &[Lowest<N>], limit: &[f64; N]) -> bool {
    (0..N).any(|i| simplex.iter().any(|p| (p.at[i] - simplex[0].at[i]).abs() > limit[i]))
}

fn centre<const N: usize>(points: &[Lowest<N>]) -> [f64; N] {
    std::array::from_fn(|i| points.iter().map(|p| p.at[i]).sum::<f64>() / N as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_minimum_is_found_inside_and_at_an_end() {
        let mut calls = 0;
        let inside = least_between(
            |x| {
                calls += 1;
                (x - 1.3).powi(4) + 0.1 * (x - 1.3).powi(2)
            },
            (-4.0, 7.0),
            1e-3,
        );
        let (inside, value) = inside;
        assert!((value - (inside - 1.3).powi(4) - 0.1 * (inside - 1.3).powi(2)).abs() < 1e-15);
        assert!((inside - 1.3).abs() < 3e-3 && calls < 40, "{inside} after {calls}");
        assert!((least_between(|x| x, (2.0, 9.0), 1e-3).0 - 2.0).abs() < 4e-3);
        assert!((least_between(|x| -x.exp(), (2.0, 9.0), 1e-3).0 - 9.0).abs() < 4e-3);
        assert!(least_between(|_| 0.0, (0.0, 1.0), 1e-3).0.is_finite());
        assert!(least_between(|_| f64::INFINITY, (0.0, 1.0), 1e-3).0.is_finite());
    }

    #[test]
    fn the_bottom_of_rosenbrocks_valley_is_found() {
        let valley = |p: &[f64; 2]| (1.0 - p[0]).powi(2) + 100.0 * (p[1] - p[0] * p[0]).powi(2);
        let tolerance = Tolerance { x: [1e-7; 2], f: 1e-14, evaluations: 500 };
        let lowest = nelder_mead(valley, [-1.2, 1.0], [0.5, 0.5], &tolerance);
        assert!((lowest.at[0] - 1.0).abs() < 1e-6 && (lowest.at[1] - 1.0).abs() < 1e-6, "{lowest:?}");
    }

    #[test]
    fn a_wall_is_not_crossed_and_the_budget_is_kept() {
        let mut calls = 0;
        let hill = |p: &[f64; 1]| {
            calls += 1;
            if p[0] > 2.0 { f64::INFINITY } else { -p[0] }
        };
        let lowest = nelder_mead(hill, [0.0], [1.0], &Tolerance { x: [1e-9], f: 1e-9, evaluations: 60 });
        assert!(lowest.at[0] <= 2.0 && lowest.at[0] > 1.999, "{lowest:?}");
        assert!(calls <= 63, "{calls}");
    }
}
