//! What timestamps show before any motion is examined (S0).

use record::Burst;

/// Share of the usual interval below which a fix was queued after the previous one.
const QUEUED_SHARE: f64 = 0.2;
/// Share of queued fixes above which close fixes mean nothing: they are normal for the log.
const MOST_QUEUED: f64 = 0.3;
/// Least fixes of a burst that is reported, even without a pause before it.
const REPORTED_FIXES: usize = 4;
/// The same after a pause of at least `HOLD_INTERVALS` usual intervals.
const REPORTED_FIXES_AFTER_HOLD: usize = 3;
const HOLD_INTERVALS: f64 = 2.0;
/// Most bursts that are listed.
const MOST_BURSTS: usize = 100;

/// Fixes that share an arrival time but not a lateness.
pub(crate) struct Queued {
    /// Whether each fix arrived in a burst. All false if bursts are normal for the log.
    pub(crate) rows: Vec<bool>,
    /// Bursts to report.
    pub(crate) bursts: Vec<Burst>,
}

pub(crate) fn queued(t: &[f64], usual_s: f64) -> Queued {
    let mut rows = vec![false; t.len()];
    let close = |k: usize| t[k] - t[k - 1] < QUEUED_SHARE * usual_s;
    let mut bursts = vec![];
    let mut close_fixes = 0;
    let mut k = 1;
    while k < t.len() {
        if !close(k) {
            k += 1;
            continue;
        }
        let first = k - 1;
        while k < t.len() && close(k) {
            k += 1;
        }
        close_fixes += k - first;
        let hold_s = if first > 0 { t[first] - t[first - 1] } else { 0.0 };
        let held = hold_s > HOLD_INTERVALS * usual_s;
        let fixes = k - first;
        if fixes >= REPORTED_FIXES || (held && fixes >= REPORTED_FIXES_AFTER_HOLD) {
            rows[first..k].fill(true);
            bursts.push(Burst { start_s: t[first], fixes: fixes as u64, hold_s });
        }
    }
    let share = close_fixes as f64 / t.len().max(1) as f64;
    if share > MOST_QUEUED {
        return Queued { rows: vec![false; t.len()], bursts: vec![] };
    }
    bursts.truncate(MOST_BURSTS);
    Queued { rows, bursts }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flush_after_a_hold_is_one_burst() {
        let mut t: Vec<f64> = (0..50).map(|k| 0.2 * f64::from(k)).collect();
        t.extend((0..8).map(|k| 12.0 + 1e-3 * f64::from(k)));
        t.extend((1..40).map(|k| 12.0 + 0.2 * f64::from(k)));
        let found = queued(&t, 0.2);
        assert_eq!(found.bursts.len(), 1);
        assert_eq!(found.bursts[0].fixes, 8);
        assert!((found.bursts[0].hold_s - 2.2).abs() < 1e-9);
        assert_eq!(found.rows.iter().filter(|q| **q).count(), 8);
    }

    #[test]
    fn a_log_that_always_arrives_in_bursts_has_none_to_report() {
        let t: Vec<f64> = (0..100).map(|k| f64::from(k / 5) + 1e-3 * f64::from(k % 5)).collect();
        let found = queued(&t, 0.2);
        assert!(found.bursts.is_empty() && !found.rows.contains(&true));
    }

    #[test]
    fn regular_pairs_in_a_log_are_not_bursts() {
        let t: Vec<f64> = (0..100).map(|k| 0.2 * f64::from(k / 2) + 0.01 * f64::from(k % 2)).collect();
        let found = queued(&t, 0.1);
        assert!(found.bursts.is_empty() && !found.rows.contains(&true));
    }
}
