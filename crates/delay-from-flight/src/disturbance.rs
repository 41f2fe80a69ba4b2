//! Samples that are not part of the motion: glitches, and resets after which the position is shifted.

/// Number of samples on each side that predict where a sample should be.
const NEIGHBOURS: usize = 5;
/// The number of samples with which a sample is compared: their scatter is the reference.
const STRETCH: usize = 200;
/// Least size of a glitch or reset in local robust deviations. A Student's t with 3 degrees of freedom, which fixes
/// among buildings resemble, exceeds it in one sample of 5000.
const LARGE: f64 = 15.0;
/// Also least multiple of the 99th percentile in this flight: heavy tails are noise, not events.
const ABOVE_TAIL: f64 = 3.0;
/// The step into a reset exceeds every other step around it by this factor: a manoeuvre takes several.
const SUDDEN: f64 = 3.0;

/// Disturbances in `values` (slow residuals plus noise).
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Disturbances {
    /// Rows that jump away and back.
    pub(crate) glitches: Vec<usize>,
    /// Rows from which on the position is shifted.
    pub(crate) resets: Vec<usize>,
}

/// Glitches and resets of at least `least`, in samples in order of time.
pub(crate) fn disturbances(values: &[f64], least: f64) -> Disturbances {
    let glitches = glitches(values, least);
    let kept: Vec<usize> = (0..values.len()).filter(|k| glitches.binary_search(k).is_err()).collect();
    let calm: Vec<f64> = kept.iter().map(|&k| values[k]).collect();
    let resets = resets(&calm, least).into_iter().map(|k| kept[k]).collect();
    Disturbances { glitches, resets }
}

/// Rows far from the median of their neighbours, if the neighbours before and after agree.
fn glitches(values: &[f64], least: f64) -> Vec<usize> {
    let n = values.len();
    let median = |range: std::ops::Range<usize>| median_of_few(&values[range]);
    let away: Vec<(f64, f64)> = (0..n)
        .map(|k| {
            let before = median(k.saturating_sub(NEIGHBOURS)..k);
            let after = median((k + 1).min(n)..(k + 1 + NEIGHBOURS).min(n));
            match (before, after) {
                (Some(b), Some(a)) => (values[k] - 0.5 * (a + b), (a - b).abs()),
                _ => (0.0, 0.0),
            }
        })
        .collect();
    let size: Vec<f64> = away.iter().map(|a| a.0).collect();
    let (scatter, tail) = (local_scatter(&size), tail_of(&size));
    let bar = |k: usize| least.max(LARGE * scatter(k)).max(ABOVE_TAIL * tail);
    (0..n).filter(|&k| size[k].abs() > bar(k) && away[k].1 < 0.3 * size[k].abs()).collect()
}

/// Rows where the median after differs from the median before by a single sudden step.
fn resets(values: &[f64], least: f64) -> Vec<usize> {
    let n = values.len();
    if n < 2 * NEIGHBOURS {
        return vec![];
    }
    let median = |range: std::ops::Range<usize>| median_of_few(&values[range]).unwrap_or(0.0);
    let shift = |k: usize| median(k..(k + NEIGHBOURS).min(n)) - median(k.saturating_sub(NEIGHBOURS)..k);
    let shifts: Vec<f64> = (0..n).map(|k| if k == 0 { 0.0 } else { shift(k) }).collect();
    let step = |k: usize| values[k] - values[k - 1];
    let sudden = |k: usize| {
        let around = (k.saturating_sub(NEIGHBOURS).max(1)..(k + NEIGHBOURS).min(n)).filter(|j| *j != k);
        let other = around.map(|j| step(j).abs()).fold(0.0, f64::max);
        step(k).abs() > SUDDEN * other && (step(k) - shifts[k]).abs() < 0.5 * shifts[k].abs()
    };
    let scatter = local_scatter(&shifts);
    let candidates: Vec<usize> =
        (1..n).filter(|&k| shifts[k].abs() > least.max(LARGE * scatter(k)) && sudden(k)).collect();
    // The surroundings of candidates are excluded from the usual tail.
    let near = |k: usize| {
        let next = candidates.partition_point(|c| c + NEIGHBOURS < k);
        candidates.get(next).is_some_and(|c| *c <= k + NEIGHBOURS)
    };
    let usual: Vec<f64> = (0..n).filter(|&k| !near(k)).map(|k| shifts[k]).collect();
    let bar = ABOVE_TAIL * tail_of(&usual);
    candidates.iter().copied().filter(|&k| shifts[k].abs() > bar).collect()
}

/// The median of at most [`NEIGHBOURS`] values; `None` without any.
fn median_of_few(values: &[f64]) -> Option<f64> {
    let mut sorted = [f64::INFINITY; NEIGHBOURS];
    let n = values.len().min(NEIGHBOURS);
    for (k, value) in values.iter().take(n).enumerate() {
        let mut at = k;
        while at > 0 && sorted[at - 1] > *value {
            sorted[at] = sorted[at - 1];
            at -= 1;
        }
        sorted[at] = *value;
    }
    match n {
        0 => None,
        n if n % 2 == 1 => Some(sorted[n / 2]),
        n => Some(sorted[n / 2 - 1] + 0.5 * (sorted[n / 2] - sorted[n / 2 - 1])),
    }
}

/// The 99th percentile of `values`.
fn tail_of(values: &[f64]) -> f64 {
    let sizes: Vec<f64> = values.iter().map(|v| v.abs()).collect();
    signal::percentile(&sizes, 0.99).unwrap_or_default()
}

/// Robust standard deviation of the samples around a row.
fn local_scatter(values: &[f64]) -> impl Fn(usize) -> f64 {
    let stretches = values.len().div_ceil(STRETCH).max(1);
    let around = |s: usize| s.saturating_sub(1) * STRETCH..((s + 2) * STRETCH).min(values.len());
    let scatter: Vec<f64> = (0..stretches).map(|s| signal::robust_sigma(&values[around(s)]).unwrap_or(0.0)).collect();
    move |k| scatter[k / STRETCH]
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_distr::{Distribution, StudentT};
    use rand_pcg::Pcg64;

    /// Student's t with 3 degrees of freedom, scale 0.5 m: the tail of fixes among buildings.
    fn heavy(n: usize, seed: u64) -> Vec<f64> {
        let mut rng = Pcg64::seed_from_u64(seed);
        let t = StudentT::new(3.0).unwrap();
        (0..n).map(|_| 0.5 * t.sample(&mut rng)).collect()
    }

    #[test]
    fn heavy_tails_are_not_called_resets() {
        for seed in 0..5 {
            let found = disturbances(&heavy(5000, seed), 0.5);
            assert_eq!(found.resets, [0; 0]);
            // One in 5000 is expected above the limit.
            assert!(found.glitches.len() <= 8, "{:?}", found.glitches.len());
        }
    }

    #[test]
    fn a_reset_is_found_at_its_row_and_only_there() {
        let mut values = heavy(2000, 7);
        values.iter_mut().skip(812).for_each(|v| *v += 60.0);
        assert_eq!(disturbances(&values, 0.5).resets, [812]);
    }

    /// The first two solutions of a receiver that has just started.
    #[test]
    fn a_wild_start_is_removed() {
        let mut values = heavy(2000, 9);
        values.iter_mut().take(2).for_each(|v| *v -= 280.0);
        assert_eq!(disturbances(&values, 0.5).resets, [2]);
    }

    #[test]
    fn a_fix_that_jumps_away_and_back_is_a_glitch() {
        let mut values = heavy(2000, 8);
        values[500] += 400.0;
        let found = disturbances(&values, 0.5);
        assert!(found.glitches.contains(&500) && found.resets.is_empty(), "{found:?}");
    }

    /// Residual of a hard turn at a wrong delay: metres within a second, but in several steps.
    #[test]
    fn a_manoeuvre_is_neither_glitch_nor_reset() {
        let mut rng = Pcg64::seed_from_u64(1);
        let values: Vec<f64> = (0..3000)
            .map(|k| {
                let u = f64::from(k - 1500) / 10.0;
                4.0 * (u.tanh() + 0.5 * (3.0 * u).sin() * (-u * u).exp()) + 1e-3 * (rng.next_u32() as f64 / 4.3e9)
            })
            .collect();
        assert_eq!(disturbances(&values, 0.5), Disturbances::default());
    }

    #[test]
    fn the_median_of_few_values_is_correct() {
        let values = heavy(9, 3);
        for n in 0..=NEIGHBOURS {
            let few = &values[..n];
            assert_eq!(median_of_few(few), signal::median_in_place(&mut few.to_vec()));
        }
    }

    #[test]
    fn empty_input_has_no_disturbances() {
        for n in 0..12 {
            assert_eq!(disturbances(&vec![1.0; n], 0.5), Disturbances::default());
        }
    }
}
