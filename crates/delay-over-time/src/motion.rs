//! The path from the velocity, and where the velocity is missing.

/// Gap of the velocity that interrupts its integral, s and in usual intervals.
const GAP_S: f64 = 1.0;
const GAP_INTERVALS: f64 = 4.0;
/// Speed below which motion has no delay information: 1/4 of the 95 % speed within these limits, m/s, at least 1/10.
const SLOW_MPS: (f64, f64) = (0.3, 1.5);
const SLOW_SHARES: (f64, f64) = (0.25, 0.1);

/// Velocity, linear between its samples, with its integral.
pub(crate) struct Motion {
    t: Vec<f64>,
    /// Velocity, m/s, and position, m: north, east.
    samples: Vec<[f64; 4]>,
    /// Columns of the two effects that resemble a delay: speed later than direction (m/s), antenna ahead (unit vector).
    resembling: Vec<[f64; 4]>,
    /// Gaps: from the last sample before to the first sample after, s.
    gaps: Vec<(f64, f64)>,
    /// Speed below which a fix carries no information on the delay, m/s.
    pub(crate) slow_mps: f64,
    /// 95th percentile of the speed, m/s.
    pub(crate) fast_mps: f64,
    /// Rms speed, m/s.
    pub(crate) rms_mps: f64,
}

/// Position and velocity at an instant.
#[derive(Debug, Clone, Copy)]
pub(crate) struct State {
    /// North and east, m.
    pub(crate) place: [f64; 2],
    /// North and east, m/s.
    pub(crate) velocity: [f64; 2],
}

/// Speeds neither overflow nor underflow when squared, and `hypot` would cost five times as much.
pub(crate) fn speed(north: f64, east: f64) -> f64 {
    (north * north + east * east).sqrt()
}

impl State {
    pub(crate) fn speed(&self) -> f64 {
        speed(self.velocity[0], self.velocity[1])
    }
}

impl Motion {
    /// Timestamps must rise strictly and there must be at least two.
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

    /// Sample at or before `q` that has a successor. `hint` is where the last query ended.
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

    /// Position and velocity at `q`; outside the record the velocity is held.
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

    /// The columns that resemble a delay at `q`: for each axis [speed later than direction, antenna ahead].
    pub(crate) fn resembling_at(&self, q: f64, hint: &mut usize) -> [[f64; 2]; 2] {
        let k = self.place_of(q, hint);
        let share = ((q - self.t[k]) / (self.t[k + 1] - self.t[k])).clamp(0.0, 1.0);
        let (a, b) = (self.resembling[k], self.resembling[k + 1]);
        let at = |c: usize| a[c] + (b[c] - a[c]) * share;
        [[at(0), at(2)], [at(1), at(3)]]
    }
}

/// Speed below which motion carries no delay, 95 % speed and rms speed.
fn speeds(samples: &[[f64; 4]]) -> [f64; 3] {
    let every = (samples.len() / 20_000).max(1);
    let mut speeds: Vec<f64> = samples.iter().step_by(every).map(|v| speed(v[0], v[1])).collect();
    let rms = (speeds.iter().map(|u| u * u).sum::<f64>() / speeds.len() as f64).sqrt();
    let at = ((speeds.len() - 1) as f64 * 0.95).round() as usize;
    let fast = *speeds.select_nth_unstable_by(at, f64::total_cmp).1;
    let slow = (SLOW_SHARES.0 * fast).clamp(SLOW_MPS.0, SLOW_MPS.1);
    [slow.max(SLOW_SHARES.1 * fast), fast, rms]
}

/// −∫ U̇ n dt and n, with n = v/U while moving.
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

/// Median interval, s; from at most 10 000 of them.
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
    use crate::dense::Random;
    use crate::fixes::Fixes;

    #[test]
    fn the_position_is_the_integral_in_any_order_of_queries() {
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
    fn a_gap_is_recognised() {
        let t: Vec<f64> = (0..40).map(|k| 0.1 * f64::from(k) + if k >= 20 { 3.0 } else { 0.0 }).collect();
        let motion = Motion::new(&t, &[1.0; 40], &[0.0; 40]);
        assert_eq!(motion.gaps().len(), 1);
        assert!(motion.knows(1.0) && !motion.knows(3.0) && motion.knows(5.5) && !motion.knows(8.0));
        assert_eq!((motion.gaps_before(1.0), motion.gaps_before(6.0)), (0, 1));
    }

    /// From anywhere to anywhere, on irregular timestamps.
    #[test]
    fn a_query_does_not_depend_on_the_previous_one() {
        let mut random = Random::new(1);
        let t = random.stamps(300, -40.0);
        let (north, east): (Vec<f64>, Vec<f64>) = random.pairs(300, 9.0).into_iter().map(|v| (v[0], v[1])).unzip();
        let motion = Motion::new(&t, &north, &east);
        let mut hint = usize::MAX;
        for k in 0..2000 {
            let q = random.uniform(t[0], t[299]);
            let q = if k % 3 == 0 { t[k % 299] } else { q };
            let s = motion.at(q, &mut hint);
            let before = t.iter().rposition(|t| *t <= q).unwrap().min(298);
            assert_eq!(hint, before);
            let share = (q - t[before]) / (t[before + 1] - t[before]);
            let v = [&north, &east].map(|v| v[before] + share * (v[before + 1] - v[before]));
            let area = |v: &[f64], here: f64| -> f64 {
                let whole: f64 = (0..before).map(|i| 0.5 * (v[i] + v[i + 1]) * (t[i + 1] - t[i])).sum();
                whole + 0.5 * (v[before] + here) * (q - t[before])
            };
            let place = [area(&north, v[0]), area(&east, v[1])];
            assert!((0..2).all(|a| (s.velocity[a] - v[a]).abs() < 1e-9 && (s.place[a] - place[a]).abs() < 1e-8));
            assert!((s.speed() - v[0].hypot(v[1])).abs() < 1e-9);
        }
    }

    #[test]
    fn the_velocity_is_held_outside_its_record() {
        let t: Vec<f64> = (0..50).map(|k| 10.0 + 0.1 * f64::from(k)).collect();
        let north: Vec<f64> = t.iter().map(|t| 2.0 * t).collect();
        let motion = Motion::new(&t, &north, &[3.0; 50]);
        assert_eq!(motion.span(), (10.0, t[49]));
        let before = motion.at(7.0, &mut 30);
        assert!((before.place[0] + 60.0).abs() < 1e-9 && (before.place[1] + 9.0).abs() < 1e-9, "{before:?}");
        assert!((before.velocity[0] - 20.0).abs() < 1e-9);
        let after = motion.at(t[49] + 4.0, &mut 3);
        let end = t[49] * t[49] - 100.0;
        assert!((after.place[0] - end - 8.0 * t[49]).abs() < 1e-9, "{after:?}");
        assert!((after.place[1] - 3.0 * (4.9 + 4.0)).abs() < 1e-9, "{after:?}");
        assert!(motion.knows(10.0) && motion.knows(t[49]) && !motion.knows(9.99) && !motion.knows(t[49] + 0.01));
    }

    /// Heading ωt, speed 10 + 2t: a late speed makes the position lag by −∫ U̇ n dt, the antenna puts it n ahead.
    #[test]
    fn columns_resembling_a_delay_match_their_closed_form() {
        let t: Vec<f64> = (0..1000).map(|k| 0.01 * f64::from(k)).collect();
        let (rate, speed) = (0.7, |t: f64| 10.0 + 2.0 * t);
        let north: Vec<f64> = t.iter().map(|t| speed(*t) * (rate * t).cos()).collect();
        let east: Vec<f64> = t.iter().map(|t| speed(*t) * (rate * t).sin()).collect();
        let motion = Motion::new(&t, &north, &east);
        for q in [0.0f64, 1.234, 5.5, 9.99] {
            let [[lag_n, lever_n], [lag_e, lever_e]] = motion.resembling_at(q, &mut 500);
            let angle = rate * q;
            assert!((lag_n + 2.0 * angle.sin() / rate).abs() < 1e-3, "{q}: {lag_n}");
            assert!((lag_e + 2.0 * (1.0 - angle.cos()) / rate).abs() < 1e-3, "{q}: {lag_e}");
            assert!((lever_n - angle.cos()).abs() < 1e-4 && (lever_e - angle.sin()).abs() < 1e-4, "{q}");
        }
        // A fix late by its speed only: the position from a velocity whose speed is 0.1 s later than its direction.
        let fixes = Fixes { y: vec![[7.0, 8.0]; 1000], starts: vec![0, 1000], t: t.clone() };
        let freed = fixes.without_effects(&motion, &|_| 1.0, [0.1, 2.0]);
        let [[lag_n, lever_n], [lag_e, lever_e]] = motion.resembling_at(t[600] - 1.0, &mut 0);
        let expected = [7.0 - 0.1 * lag_n - 2.0 * lever_n, 8.0 - 0.1 * lag_e - 2.0 * lever_e];
        assert!((0..2).all(|a| (freed.y[600][a] - expected[a]).abs() < 1e-9), "{:?} {expected:?}", freed.y[600]);
    }

    #[test]
    fn a_stationary_vehicle_has_no_heading() {
        let t: Vec<f64> = (0..300).map(|k| 0.1 * f64::from(k)).collect();
        let north: Vec<f64> = (0..300).map(|k| if k < 150 { 20.0 } else { 0.2 }).collect();
        let motion = Motion::new(&t, &north, &[0.0; 300]);
        let [[lag, ahead], aside] = motion.resembling_at(5.0, &mut 0);
        assert!(lag == 0.0 && ahead == 1.0 && aside == [0.0, 0.0]);
        let [[lag, ahead], _] = motion.resembling_at(25.0, &mut 0);
        // From 20 m/s to 0.2 m/s with half of the heading.
        assert!((lag - 0.5 * 19.8).abs() < 1e-9 && ahead == 0.0, "{lag} {ahead}");
    }

    /// Usual interval 0.1 s: a gap is more than a second; 0.5 s: more than two seconds.
    #[test]
    fn a_gap_is_more_than_a_second_and_more_than_four_intervals() {
        let stamps = |every: f64, gap: f64| -> Vec<f64> {
            (0..40).map(|k| every * f64::from(k) + if k >= 20 { gap - every } else { 0.0 }).collect()
        };
        for (every, gap, is_one) in [(0.1, 0.99, false), (0.1, 1.01, true), (0.5, 1.99, false), (0.5, 2.01, true)] {
            let t = stamps(every, gap);
            assert!((usual_interval(&t) - every).abs() < 1e-9);
            let motion = Motion::new(&t, &[1.0; 40], &[0.0; 40]);
            assert_eq!(motion.gaps().len(), usize::from(is_one), "{every} s, {gap} s");
            if is_one {
                assert_eq!(motion.gaps()[0], (t[19], t[20]));
                assert!(motion.knows(t[19]) && !motion.knows(t[19] + 0.1) && motion.knows(t[20]));
            }
        }
        assert_eq!(usual_interval(&[3.0]), 1.0);
    }

    /// A quarter of the 95 % speed, but 0.3 m/s to 1.5 m/s, and at least a tenth of it.
    #[test]
    fn the_slow_speed_is_a_limited_share_of_the_fast_speed() {
        for (fast, slow) in [(0.4, 0.3), (4.0, 1.0), (10.0, 1.5), (40.0, 4.0)] {
            // One sample in a hundred is ten times as fast, which is not the usual speed.
            let t: Vec<f64> = (0..500).map(f64::from).collect();
            let speed: Vec<f64> = (0..500).map(|k| if k % 100 == 7 { 10.0 * fast } else { fast }).collect();
            let (north, east): (Vec<f64>, Vec<f64>) = speed.iter().map(|u| (0.6 * u, -0.8 * u)).unzip();
            let motion = Motion::new(&t, &north, &east);
            assert!((motion.fast_mps - fast).abs() < 1e-9 && (motion.slow_mps - slow).abs() < 1e-9, "{fast}");
            assert!((motion.rms_mps - fast * (0.99f64 + 0.01 * 100.0).sqrt()).abs() < 1e-9, "{}", motion.rms_mps);
        }
    }
}
