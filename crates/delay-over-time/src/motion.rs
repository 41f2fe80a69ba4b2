//! The path that the velocity says, and where it cannot say it.

/// Gap of the velocity that breaks its integral, s and in usual intervals.
const GAP_S: f64 = 1.0;
const GAP_INTERVALS: f64 = 4.0;
/// Speed below which motion carries no delay: a quarter of the 95 % speed within these limits, m/s, and at least a tenth.
const SLOW_MPS: (f64, f64) = (0.3, 1.5);
const SLOW_SHARES: (f64, f64) = (0.25, 0.1);

/// Velocity, linear between its samples, with its integral.
pub(crate) struct Motion {
    t: Vec<f64>,
    /// Velocity, m/s, and place, m: north, east.
    samples: Vec<[f64; 4]>,
    /// Columns of the two effects that resemble a delay: speed later than direction (m/s), antenna ahead (unit vector).
    resembling: Vec<[f64; 4]>,
    /// Gaps: from the last sample before to the first after, s.
    gaps: Vec<(f64, f64)>,
    /// Speed below which a fix says nothing of a delay, m/s.
    pub(crate) slow_mps: f64,
    /// 95th percentile of the speed, m/s.
    pub(crate) fast_mps: f64,
    /// Rms speed, m/s.
    pub(crate) rms_mps: f64,
}

/// Place and velocity at an instant.
#[derive(Debug, Clone, Copy)]
pub(crate) struct State {
    /// North and east, m.
    pub(crate) place: [f64; 2],
    /// North and east, m/s.
    pub(crate) velocity: [f64; 2],
}

/// Speeds neither overflow nor underflow when squared: `hypot` would cost five times as much.
pub(crate) fn speed(north: f64, east: f64) -> f64 {
    (north * north + east * east).sqrt()
}

impl State {
    pub(crate) fn speed(&self) -> f64 {
        speed(self.velocity[0], self.velocity[1])
    }
}

impl Motion {
    /// Stamps rise strictly and there are at least two.
    pub(crate) fn new(t: &[f64], north: &[f64], east: &[f64]) -> Motion {
        let mut samples = Vec::with_capacity(t.len());
        let mut place = [0.0; 2];
        let mut before: Option<(f64, [f64; 2])> = None;
        for ((&t, &n), &e) in t.iter().zip(north).zip(east) {
            if let Some((t0, v0)) = before {
                place[0] += 0.5 * (n + v0[0]) * (t - t0);
                place[1] += 0.5 * (e + v0[1]) * (t - t0);
            }
            before = Some((t, [n, e]));
            samples.push([n, e, place[0], place[1]]);
        }
        let [slow_mps, fast_mps, rms_mps] = speeds(&samples);
        let resembling = resembling(&samples, slow_mps);
        let gaps = gaps(t);
        Motion { t: t.to_vec(), samples, resembling, gaps, slow_mps, fast_mps, rms_mps }
    }

    pub(crate) fn span(&self) -> (f64, f64) {
        crate::input::span(&self.t)
    }

    /// Whether the velocity is known at `q`.
    pub(crate) fn knows(&self, q: f64) -> bool {
        let (first, last) = self.span();
        let next = self.gaps.get(self.gaps_before(q));
        q >= first && q <= last && next.is_none_or(|g| q <= g.0)
    }

    /// Number of gaps before `q`.
    pub(crate) fn gaps_before(&self, q: f64) -> usize {
        self.gaps.partition_point(|g| g.1 <= q)
    }

    pub(crate) fn gaps(&self) -> &[(f64, f64)] {
        &self.gaps
    }

    /// Sample at or before `q`, such that one follows. `hint` is where the last query ended.
    #[inline]
    fn place_of(&self, q: f64, hint: &mut usize) -> usize {
        let last = self.t.len() - 2;
        let mut k = (*hint).min(last);
        let near = (0..12).any(|_| {
            if self.t[k] <= q || k == 0 {
                if k == last || q < self.t[k + 1] {
                    return true;
                }
                k += 1;
            } else {
                k -= 1;
            }
            false
        });
        if !near {
            k = self.t.partition_point(|t| *t <= q).saturating_sub(1).min(last);
        }
        *hint = k;
        k
    }

    /// Place and velocity at `q`; outside the record the velocity is held.
    #[inline]
    pub(crate) fn at(&self, q: f64, hint: &mut usize) -> State {
        let k = self.place_of(q, hint);
        let (t0, t1) = (self.t[k], self.t[k + 1]);
        let ([a_n, a_e, p_n, p_e], [b_n, b_e, ..]) = (self.samples[k], self.samples[k + 1]);
        let within = q.clamp(t0, t1);
        let d = within - t0;
        let share = d / (t1 - t0);
        let v = [a_n + (b_n - a_n) * share, a_e + (b_e - a_e) * share];
        let beyond = q - within;
        let place = [p_n + 0.5 * (a_n + v[0]) * d + v[0] * beyond, p_e + 0.5 * (a_e + v[1]) * d + v[1] * beyond];
        State { place, velocity: v }
    }

    /// The columns that resemble a delay at `q`: of each axis [speed later than direction, antenna ahead].
    pub(crate) fn resembling_at(&self, q: f64, hint: &mut usize) -> [[f64; 2]; 2] {
        let k = self.place_of(q, hint);
        let share = ((q - self.t[k]) / (self.t[k + 1] - self.t[k])).clamp(0.0, 1.0);
        let (a, b) = (self.resembling[k], self.resembling[k + 1]);
        let at = |c: usize| a[c] + (b[c] - a[c]) * share;
        [[at(0), at(2)], [at(1), at(3)]]
    }
}

/// Speed that carries no delay, 95 % speed and rms speed.
fn speeds(samples: &[[f64; 4]]) -> [f64; 3] {
    let every = (samples.len() / 20_000).max(1);
    let mut speeds: Vec<f64> = samples.iter().step_by(every).map(|v| speed(v[0], v[1])).collect();
    let rms = (speeds.iter().map(|u| u * u).sum::<f64>() / speeds.len() as f64).sqrt();
    let at = ((speeds.len() - 1) as f64 * 0.95).round() as usize;
    let fast = *speeds.select_nth_unstable_by(at, f64::total_cmp).1;
    let slow = (SLOW_SHARES.0 * fast).clamp(SLOW_MPS.0, SLOW_MPS.1);
    [slow.max(SLOW_SHARES.1 * fast), fast, rms]
}

/// −∫ U̇ n dt and n, with n = v/U where it moves.
fn resembling(samples: &[[f64; 4]], slow_mps: f64) -> Vec<[f64; 4]> {
    let mut sum = [0.0; 2];
    let mut before = (0.0, [0.0; 2]);
    let mut first = true;
    let column = |v: &[f64; 4]| {
        let speed = speed(v[0], v[1]);
        let slow = speed < slow_mps;
        let n = if slow { [0.0; 2] } else { [v[0] / speed, v[1] / speed] };
        if !first {
            let gain = speed - before.0;
            for a in 0..2 {
                sum[a] -= 0.5 * gain * (n[a] + before.1[a]);
            }
        }
        first = false;
        before = (speed, n);
        [sum[0], sum[1], n[0], n[1]]
    };
    samples.iter().map(column).collect()
}

fn gaps(t: &[f64]) -> Vec<(f64, f64)> {
    let limit = (GAP_INTERVALS * usual_interval(t)).max(GAP_S);
    t.windows(2).filter(|w| w[1] - w[0] > limit).map(|w| (w[0], w[1])).collect()
}

/// Median interval, s; of at most 10 000 of them.
pub(crate) fn usual_interval(t: &[f64]) -> f64 {
    let every = (t.len() / 10_000).max(1);
    let mut d: Vec<f64> = t.windows(2).step_by(every).map(|w| w[1] - w[0]).collect();
    let middle = d.len() / 2;
    match d.len() {
        0 => 1.0,
        _ => *d.select_nth_unstable_by(middle, f64::total_cmp).1,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_place_is_the_integral_whatever_the_order_of_the_queries() {
        let t: Vec<f64> = (0..60).map(|k| 0.1 * f64::from(k) + 0.02 * f64::from(k % 3)).collect();
        let north: Vec<f64> = t.iter().map(|t| 6.0 * t - 2.0).collect();
        let east = vec![3.0; 60];
        let motion = Motion::new(&t, &north, &east);
        let mut hint = 0;
        for q in [5.5, 0.03, 3.0, 2.9, 0.0, 5.9] {
            let s = motion.at(q, &mut hint);
            assert!((s.place[0] - (3.0 * q * q - 2.0 * q)).abs() < 1e-9 && (s.place[1] - 3.0 * q).abs() < 1e-9);
            assert!((s.velocity[0] - (6.0 * q - 2.0)).abs() < 1e-9);
        }
    }

    #[test]
    fn a_gap_is_known_as_one() {
        let t: Vec<f64> = (0..40).map(|k| 0.1 * f64::from(k) + if k >= 20 { 3.0 } else { 0.0 }).collect();
        let motion = Motion::new(&t, &[1.0; 40], &[0.0; 40]);
        assert_eq!(motion.gaps().len(), 1);
        assert!(motion.knows(1.0) && !motion.knows(3.0) && motion.knows(5.5) && !motion.knows(8.0));
        assert_eq!((motion.gaps_before(1.0), motion.gaps_before(6.0)), (0, 1));
    }
}
