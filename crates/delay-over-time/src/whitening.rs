//! The filter that whitens noise: Ornstein–Uhlenbeck plus white, exact on irregular timestamps (design note 3.5).

/// Shape of the position's noise. All variances are relative to that of the white part.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct NoiseShape {
    /// Ratio of the standard deviations of the wander and the white part.
    pub(crate) wander: f64,
    /// Correlation time of the wander, s.
    pub(crate) time_constant_s: f64,
    /// Ratio of the fix-to-fix scatter of the delay and the standard deviation of the white part, s/m.
    pub(crate) jitter: f64,
}

/// Filter step at one sample.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Step {
    /// Share of the innovation that is wander.
    pub(crate) gain: f64,
    /// Decay of the wander to the next sample.
    pub(crate) decay: f64,
    /// One over the standard deviation of the innovation.
    pub(crate) weight: f64,
}

/// Steps for the timestamps `t`, and the log determinant. `extra` returns the additional variance of each sample.
pub(crate) fn steps(t: &[f64], shape: &NoiseShape, mut extra: impl FnMut(usize) -> f64, out: &mut Vec<Step>) -> f64 {
    let wander = shape.wander * shape.wander;
    let mut known = wander;
    let mut product = 1.0;
    let mut log_det = 0.0;
    let mut last = (0.0, 0.0);
    out.clear();
    out.reserve(t.len());
    for k in 0..t.len() {
        let variance = known + 1.0 + extra(k);
        let gain = known / variance;
        let decay = match t.get(k + 1) {
            Some(next) => {
                let interval = next - t[k];
                if (interval - last.0).abs() > 1e-7 * interval {
                    last = (interval, (-interval / shape.time_constant_s).exp());
                }
                last.1
            }
            None => 0.0,
        };
        known = wander + decay * decay * ((1.0 - gain) * known - wander);
        product *= variance;
        if !(1e-100..1e100).contains(&product) {
            log_det += product.ln();
            product = 1.0;
        }
        out.push(Step { gain, decay, weight: 1.0 / variance.sqrt() });
    }
    log_det + product.ln()
}

/// Whitens `C` columns in place.
pub(crate) fn whiten_rows<const C: usize>(steps: &[Step], rows: &mut [[f64; C]]) {
    let mut wander = [0.0; C];
    for (step, row) in steps.iter().zip(rows) {
        for c in 0..C {
            let innovation = row[c] - wander[c];
            row[c] = innovation * step.weight;
            wander[c] = step.decay * (wander[c] + step.gain * innovation);
        }
    }
}

/// Orthonormal basis of the whitened columns 1 and x (rising from −½ to ½ over the timestamps), and the logarithm of
/// the determinant of their products: what an offset and a drift remove.
pub(crate) fn offset_and_drift(t: &[f64], steps: &[Step], out: &mut Vec<[f64; 2]>) -> f64 {
    let (first, last) = crate::input::span(t);
    let length = (last - first).max(1e-9);
    out.clear();
    out.extend(t.iter().map(|t| [1.0, (t - first) / length - 0.5]));
    whiten_rows(steps, out);
    let sum = |f: &dyn Fn(&[f64; 2]) -> f64| out.iter().map(f).sum::<f64>();
    let (aa, ab, bb) = (sum(&|r| r[0] * r[0]), sum(&|r| r[0] * r[1]), sum(&|r| r[1] * r[1]));
    let share = if aa > 0.0 { ab / aa } else { 0.0 };
    let rest = (bb - ab * share).max(1e-12 * bb.max(1e-300));
    let scale = [1.0 / aa.max(1e-300).sqrt(), 1.0 / rest.sqrt()];
    for row in out.iter_mut() {
        *row = [row[0] * scale[0], (row[1] - share * row[0]) * scale[1]];
    }
    aa.max(1e-300).ln() + rest.ln()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dense::{Dense, Random, near};

    #[test]
    fn the_filter_agrees_with_the_signal_crate() {
        let t: Vec<f64> = (0..40).map(|k| 0.2 * f64::from(k) + 0.05 * f64::from(k % 3)).collect();
        let x: Vec<f64> = t.iter().map(|t| (1.3 * t).sin()).collect();
        let shape = NoiseShape { wander: 2.5, time_constant_s: 4.0, jitter: 0.0 };
        let mut filter = vec![];
        let log_det = steps(&t, &shape, |_| 0.0, &mut filter);
        let mut rows: Vec<[f64; 1]> = x.iter().map(|x| [*x]).collect();
        whiten_rows(&filter, &mut rows);
        let mut column = x.clone();
        let noise = signal::NoiseModel { wander_std: 2.5, time_constant_s: 4.0, white_std: 1.0 };
        let expected = signal::whiten(&t, &mut [&mut column], &noise);
        assert!((log_det - expected).abs() < 1e-10);
        assert!(rows.iter().zip(&column).all(|(a, b)| (a[0] - b).abs() < 1e-12));
    }

    #[test]
    fn offset_and_drift_are_orthonormal() {
        let t: Vec<f64> = (0..30).map(|k| 0.3 * f64::from(k)).collect();
        let shape = NoiseShape { wander: 3.0, time_constant_s: 10.0, jitter: 0.0 };
        let (mut filter, mut q) = (vec![], vec![]);
        steps(&t, &shape, |_| 0.0, &mut filter);
        offset_and_drift(&t, &filter, &mut q);
        let product = |i: usize, j: usize| q.iter().map(|r| r[i] * r[j]).sum::<f64>();
        assert!((product(0, 0) - 1.0).abs() < 1e-12 && (product(1, 1) - 1.0).abs() < 1e-12);
        assert!(product(0, 1).abs() < 1e-12);
    }

    /// Irregular timestamps, and an additional variance for every sample.
    #[test]
    fn the_filter_is_the_triangular_factor_of_the_covariance() {
        let mut random = Random::new(3);
        for (wander, time_constant_s) in [(0.3, 2.0), (3.0, 15.0), (40.0, 0.5)] {
            let t = random.stamps(60, -5.0);
            let extra: Vec<f64> = t.iter().map(|_| random.uniform(0.0, 5.0)).collect();
            let shape = NoiseShape { wander, time_constant_s, jitter: 0.0 };
            let mut filter = vec![];
            let log_det = steps(&t, &shape, |k| extra[k], &mut filter);
            let dense = Dense::new(&t, &shape, |k| extra[k]);
            assert!(near(log_det, dense.log_det_noise, 1e-12), "{log_det} {}", dense.log_det_noise);
            let mut rows = random.pairs(60, 2.0);
            let columns = [0, 1].map(|c| dense.white(&rows.iter().map(|r| r[c]).collect::<Vec<f64>>()));
            whiten_rows(&filter, &mut rows);
            for (k, row) in rows.iter().enumerate() {
                assert!((0..2).all(|c| near(row[c], columns[c][k], 1e-10)), "{k}: {row:?}");
            }
        }
    }

    /// A plain product of variances of 10⁸ and 10⁻⁸ would overflow and underflow.
    #[test]
    fn the_determinant_of_1000_samples_does_not_over_or_underflow() {
        let t: Vec<f64> = (0..1000).map(|k| 100.0 * f64::from(k)).collect();
        let shape = NoiseShape { wander: 1e4, time_constant_s: 1.0, jitter: 0.0 };
        let log_det = steps(&t, &shape, |_| 0.0, &mut vec![]);
        assert!(near(log_det, 1000.0 * (1e8f64 + 1.0).ln(), 1e-12), "{log_det}");
    }

    #[test]
    fn offset_and_drift_span_what_the_dense_formula_removes() {
        let mut random = Random::new(4);
        let t = random.stamps(40, 1000.0);
        let shape = NoiseShape { wander: 2.0, time_constant_s: 6.0, jitter: 0.0 };
        let (mut filter, mut basis) = (vec![], vec![]);
        steps(&t, &shape, |_| 0.0, &mut filter);
        let log_det = offset_and_drift(&t, &filter, &mut basis);
        let dense = Dense::new(&t, &shape, |_| 0.0);
        assert!(near(log_det, dense.log_det_nuisance, 1e-10), "{log_det} {}", dense.log_det_nuisance);
        // An offset and a drift of any size are within the span, whatever their origin.
        let white = dense.white(&t.iter().map(|t| 7.0 - 0.3 * t).collect::<Vec<f64>>());
        let with = |c: usize| basis.iter().zip(white.iter()).map(|(q, w)| q[c] * w).sum::<f64>();
        let (a, b) = (with(0), with(1));
        let left = |(q, w): (&[f64; 2], &f64)| (w - a * q[0] - b * q[1]).abs();
        assert!(basis.iter().zip(white.iter()).map(left).fold(0.0, f64::max) < 1e-8 * white.norm());
    }
}
