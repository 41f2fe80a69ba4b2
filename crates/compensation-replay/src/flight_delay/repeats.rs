//! Fixes that a receiver repeats during an outage, while the vehicle moves on.

use super::pieces::{Names, number_of};
use crate::horizontal::{AXES, Horizontal};
use flight::{Code, Notices};

/// During repeats the vehicle moves at least this far, m, ...
const LEAST_MOVED_M: f64 = 10.0;
/// ... at this speed, m/s: a velocity with a bias moves while the vehicle is parked ...
const LEAST_SPEED_MPS: f64 = 1.0;
/// ... and by this multiple of the usual step between fixes: a rounded position repeats until the next step.
const LEAST_STEPS: f64 = 4.0;

/// Repeated fixes that were removed.
#[derive(Default)]
pub(super) struct Repeats {
    fixes: u64,
    /// Start and duration of the longest repetition, s.
    longest: (f64, f64),
    /// Distance moved during it, m.
    moved_m: f64,
}

impl Repeats {
    /// Removes from `rows` those that repeat the fix before them, if `track` (m at a row) moves on during the
    /// repetition. The first of equal fixes is a measurement and stays.
    pub(super) fn remove(&mut self, rows: &mut Vec<usize>, fixes: &Horizontal, track: impl Fn(usize) -> [f64; 2]) {
        let at = |row: usize| AXES.map(|axis| fixes.axes[axis][row]);
        let runs: Vec<&[usize]> = rows.chunk_by(|a, b| at(*a) == at(*b)).collect();
        if runs.len() == rows.len() {
            return;
        }
        let steps: Vec<f64> = runs.windows(2).map(|pair| distance(at(pair[0][0]), at(pair[1][0]))).collect();
        let least_m = (LEAST_STEPS * signal::median_by_selection(&steps).unwrap_or(0.0)).max(LEAST_MOVED_M);
        let kept = runs.into_iter().flat_map(|run| {
            let [start, .., end] = *run else { return run };
            let (from, duration_s) = (track(start), fixes.t[end] - fixes.t[start]);
            let moved_m = run.iter().map(|&row| distance(track(row), from)).fold(0.0, f64::max);
            if moved_m < least_m || moved_m < LEAST_SPEED_MPS * duration_s {
                return run;
            }
            self.fixes += run.len() as u64 - 1;
            if duration_s > self.longest.1 {
                (self.longest, self.moved_m) = ((fixes.t[start], duration_s), moved_m);
            }
            &run[..1]
        });
        *rows = kept.copied().collect();
    }

    pub(super) fn report(&self, names: &Names, notices: &mut Notices) {
        if self.fixes == 0 {
            return;
        }
        let (from, duration_s) = self.longest;
        let text = format!(
            "{}: {} dropped. The longest repetition lasts {duration_s:.1} s, from {from:.0} s \
             on. By {} the vehicle moves {:.0} m meanwhile",
            names.first,
            number_of(self.fixes, "repeated fix", "repeated fixes"),
            names.second,
            self.moved_m
        );
        notices.push(Code::SamplesLeftOut, names.first, self.fixes, text);
    }
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Fixes every 0.1 s of a vehicle that flies north at `speed` m/s, each changed by `shown`.
    fn removed(speed: f64, shown: impl Fn(usize, f64) -> f64) -> (usize, Repeats) {
        let t: Vec<f64> = (0..600).map(|k| 0.1 * k as f64).collect();
        let north = t.iter().enumerate().map(|(k, t)| shown(k, speed * t)).collect();
        let fixes = Horizontal { axes: [north, vec![0.0; t.len()]], t };
        let (mut rows, mut repeats) = ((0..600).collect(), Repeats::default());
        repeats.remove(&mut rows, &fixes, |row| [speed * fixes.t[row], 0.0]);
        (600 - rows.len(), repeats)
    }

    #[test]
    fn fixes_repeated_in_an_outage_are_dropped_except_the_first() {
        let (dropped, repeats) = removed(15.0, |k, north| if (200..300).contains(&k) { 300.0 } else { north });
        assert_eq!((dropped, repeats.fixes), (99, 99));
        let (from, duration_s) = repeats.longest;
        assert!((from - 20.0).abs() < 1e-9 && (duration_s - 9.9).abs() < 1e-9);
        assert!((repeats.moved_m - 148.5).abs() < 1e-9);
    }

    #[test]
    fn rounded_fixes_and_a_parked_vehicle_are_measurements() {
        // Whole steps of 50 m, each for 33 fixes.
        assert_eq!(removed(15.0, |_, north| (north / 50.0).floor() * 50.0).0, 0);
        // A velocity that is 0.3 m/s off while the vehicle stands for a minute.
        assert_eq!(removed(0.3, |_, _| 5.0).0, 0);
    }
}
