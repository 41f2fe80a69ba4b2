//! The filter that makes noise white: Ornstein–Uhlenbeck plus white, exact on irregular stamps (design note 3.5).

/// Shape of the position's noise. All variances are in units of the white part's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct NoiseShape {
    /// Standard deviation of the wander over that of the white part.
    pub(crate) wander: f64,
    /// Correlation time of the wander, s.
    pub(crate) time_constant_s: f64,
    /// Scatter of the delay from fix to fix over the standard deviation of the white part, s/m.
    pub(crate) jitter: f64,
}

/// What the filter does at one sample.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Step {
    /// Share of the innovation that is wander.
    pub(crate) gain: f64,
    /// Decay of the wander to the next sample.
    pub(crate) decay: f64,
    /// One over the standard deviation of the innovation.
    pub(crate) weight: f64,
}

/// Steps for the stamps `t`, and the logarithm of the determinant. `extra` gives the further variance of each sample.
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

/// Makes `C` columns white in place.
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

/// The whitened columns 1 and x (rising from −½ to ½ over the stamps) made orthonormal, and the logarithm of the
/// determinant of their products: what an offset and a drift take away.
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

    #[test]
    fn the_filter_agrees_with_that_of_the_signal_crate() {
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
}
