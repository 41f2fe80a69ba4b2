//! Scores against an independent reference.

use super::Reference;
use super::jackknife::{Blocks, jackknife, rms, root_mean};
use super::truthless::found;
use super::updates::{both_at, dot, length, to_the_right};
use crate::estimate::Positions;
use crate::rows::{Rows, median_step};
use delay_from_flight::{AXES, Horizontal};
use record::{Estimate, Finding, ReferenceScore};

/// Edges of the frequency bands, Hz.
const BANDS_HZ: [f64; 10] = [0.0, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 25.0];
/// Errors are averaged down to this rate for their spectrum, Hz.
const SPECTRUM_HZ: f64 = 10.0;
/// Shortest stretch with a spectrum, s.
const SHORTEST_S: f64 = 20.0;
/// Speeds that differ by less than this ratio (95th to 5th percentile) count as one.
const LEAST_RANGE: f64 = 1.3;
/// Maximum number of rows for the delay against the reference.
const DELAY_ROWS: usize = 3_000;

/// Precomputed parts of all scores against one reference.
pub(crate) struct Judge<'a> {
    reference: &'a Reference,
    rows: &'a Rows,
    velocity: &'a Horizontal,
    /// Ground speed bins, m/s, from and to; empty if all speeds are similar.
    pub(crate) speeds_mps: Vec<[f64; 2]>,
    /// Frequency bands, Hz, from and to.
    pub(crate) bands_hz: Vec<[f64; 2]>,
    /// Rows of the reference used for the spectrum, and how many are averaged.
    stretch: Result<(std::ops::Range<usize>, usize), String>,
    /// Usual step of the rows, s.
    step_s: f64,
}

impl<'a> Judge<'a> {
    pub(crate) fn of(reference: &'a Reference, rows: &'a Rows, velocity: &'a Horizontal) -> Judge<'a> {
        let step_s = median_step(&rows.t);
        let stretch = stretch(reference, rows, step_s);
        let rate_hz = stretch.as_ref().map_or(0.0, |(_, block)| 1.0 / (step_s * *block as f64));
        // A band that is almost entirely above half the rate carries no information.
        let bands = BANDS_HZ.windows(2).map(|w| [w[0], w[1].min(0.5 * rate_hz)]).filter(|b| 1.05 * b[0] < b[1]);
        Judge {
            reference,
            rows,
            velocity,
            speeds_mps: speeds(reference, rows),
            bands_hz: bands.collect(),
            stretch,
            step_s,
        }
    }

    fn velocity_at(&self, row: usize) -> [f64; 2] {
        AXES.map(|k| self.rows.velocity[k][row])
    }

    /// `late_s`: approximate lateness of the track.
    pub(crate) fn score(&self, track: &Positions, late_s: f64) -> Finding<ReferenceScore> {
        let shown: Vec<usize> =
            (0..self.reference.row.len()).filter(|&i| track.has_own_output(self.reference.row[i])).collect();
        let errors: Vec<[f64; 2]> = shown
            .iter()
            .map(|&i| AXES.map(|k| track.axes[k][self.reference.row[i]] - self.reference.axes[k][i]))
            .collect();
        let velocities: Vec<[f64; 2]> = shown.iter().map(|&i| self.velocity_at(self.reference.row[i])).collect();
        let score = self.score_of(&errors, &velocities, track, &shown, late_s);
        found(score, "no valid row has a reference at the same time")
    }

    fn score_of(
        &self,
        errors: &[[f64; 2]],
        velocities: &[[f64; 2]],
        track: &Positions,
        shown: &[usize],
        late_s: f64,
    ) -> Option<ReferenceScore> {
        let mut sizes: Vec<f64> = errors.iter().map(|e| length(*e)).collect();
        let by_speed = self.by_speed(&sizes, velocities);
        let quantiles = signal::percentiles(&mut sizes, &[0.5, 0.68, 0.95, 0.99, 1.0]);
        let sums = errors.iter().zip(velocities).map(|(e, v)| {
            // At standstill there is no direction along the track.
            let speed = length(*v);
            let (moves, along, across) =
                if speed > 0.1 { (1.0, dot(*e, *v) / speed, to_the_right(*v, *e) / speed) } else { (0.0, 0.0, 0.0) };
            let [n, east] = *e;
            [1.0, n, n * n, east, east * east, moves, along, along * along, across, across * across]
        });
        let blocks = Blocks::of(errors.len(), sums);
        let both = |count: usize, first: usize| {
            let mean = blocks.estimate(|s| s[first] / s[count])?;
            Some([mean, blocks.size(|s| root_mean([s[first + 1], s[count]]))?])
        };
        Some(ReferenceScore {
            rows: errors.len() as u64,
            rms_m: blocks.size(|s| root_mean([s[2] + s[4], s[0]]))?,
            percentiles_m: [0, 1, 2, 3].map(|k| quantiles[k]),
            max_m: quantiles[4],
            north_m: both(0, 1)?,
            east_m: both(0, 3)?,
            along_m: both(5, 6)?,
            across_m: both(5, 8)?,
            by_speed,
            bands_rms_m: self.bands(track),
            residual_delay_s: found(
                self.delay(track, shown, late_s),
                "the flight has too little motion to show a delay",
            ),
        })
    }

    fn by_speed(&self, sizes: &[f64], velocities: &[[f64; 2]]) -> Vec<Option<Estimate>> {
        let inside = |[from, to]: [f64; 2]| {
            let of_bin = sizes.iter().zip(velocities).filter(move |(_, v)| (from..to).contains(&length(**v)));
            rms(&of_bin.map(|(e, _)| *e).collect::<Vec<f64>>())
        };
        self.speeds_mps.iter().map(|bin| inside(*bin)).collect()
    }

    /// Rms in each band, both axes together, over the longest stretch without a gap.
    fn bands(&self, track: &Positions) -> Finding<Vec<f64>> {
        let (range, block) = match &self.stretch {
            Ok((range, block)) => (range.clone(), *block),
            Err(why) => return Finding::CannotTell(why.clone()),
        };
        if range.clone().any(|i| !track.has_own_output(self.reference.row[i])) {
            return Finding::CannotTell("it has no output at some rows of the stretch".to_owned());
        }
        let spectra = AXES.map(|k| {
            let errors: Vec<f64> =
                range.clone().map(|i| track.axes[k][self.reference.row[i]] - self.reference.axes[k][i]).collect();
            let means: Vec<f64> = errors.chunks_exact(block).map(|c| c.iter().sum::<f64>() / block as f64).collect();
            signal::power_spectrum(&means, 1.0 / (self.step_s * block as f64))
        });
        let lines = || spectra.iter().flat_map(|s| s.frequency_hz.iter().zip(&s.power));
        let inside =
            |[from, to]: &[f64; 2]| lines().filter(|(f, _)| (*from..*to).contains(*f)).map(|(_, p)| p).sum::<f64>();
        Finding::Found(self.bands_hz.iter().map(|band| inside(band).sqrt()).collect())
    }

    /// `e = −δ v̄` with the mean velocity v̄ of the last δ (Simpson's rule), offsets removed: least squares, with the
    /// jackknife's uncertainty.
    fn delay(&self, track: &Positions, shown: &[usize], late_s: f64) -> Option<Estimate> {
        let every = shown.len().div_ceil(DELAY_ROWS).max(1);
        let rows: Vec<usize> = shown.iter().copied().step_by(every).collect();
        let round = |about_s: f64| {
            let row = |&i: &usize| {
                let row = self.reference.row[i];
                let v = self.mean_velocity(row, about_s);
                let e = AXES.map(|k| track.axes[k][row] - self.reference.axes[k][i]);
                [1.0, v[0], v[1], e[0], e[1], dot(v, v), dot(e, v)]
            };
            let sums: Vec<[f64; 7]> = rows.iter().map(row).collect();
            jackknife(&sums, |[n, vn, ve, en, ee, vv, ev]| {
                -(ev - (en * vn + ee * ve) / n) / (vv - (vn * vn + ve * ve) / n)
            })
        };
        let first = round(late_s)?;
        // Averaging over another time changes the result only by the square of the error.
        if (first.value - late_s).abs() > 0.02 { round(first.value) } else { Some(first) }
    }

    fn mean_velocity(&self, row: usize, over_s: f64) -> [f64; 2] {
        let now = self.velocity_at(row);
        if over_s.abs() < 1e-9 {
            return now;
        }
        let t = self.rows.t[row];
        let [middle, first] = [0.5, 1.0].map(|share| both_at(self.velocity, t - share * over_s));
        AXES.map(|k| (first[k] + 4.0 * middle[k] + now[k]) / 6.0)
    }
}

/// The longest run of rows without a missing one, and how many make a tenth of a second.
fn stretch(reference: &Reference, rows: &Rows, step_s: f64) -> Result<(std::ops::Range<usize>, usize), String> {
    let mut longest = 0..0;
    let mut first = 0;
    for i in 0..reference.row.len() {
        let [row, before] = [i, i.saturating_sub(1)].map(|i| reference.row[i]);
        if i > 0 && (row != before + 1 || rows.t[row] - rows.t[before] > rows.gap_s) {
            first = i;
        }
        if i + 1 - first > longest.len() {
            longest = first..i + 1;
        }
    }
    let length_s = longest.len() as f64 * step_s;
    if length_s < SHORTEST_S {
        return Err(format!(
            "the longest stretch with a reference and without a gap lasts {length_s:.1} s; at least {SHORTEST_S} s are needed"
        ));
    }
    Ok((longest, (1.0 / (SPECTRUM_HZ * step_s)).round().max(1.0) as usize))
}

/// Three bins with equal numbers of rows; none if speed hardly changes.
fn speeds(reference: &Reference, rows: &Rows) -> Vec<[f64; 2]> {
    let mut all: Vec<f64> = reference.row.iter().map(|&r| length([rows.velocity[0][r], rows.velocity[1][r]])).collect();
    if all.len() < 60 {
        return vec![];
    }
    let at = signal::percentiles(&mut all, &[0.0, 0.05, 1.0 / 3.0, 2.0 / 3.0, 0.95, 1.0]);
    if at[4] < LEAST_RANGE * at[1].max(0.5) {
        return vec![];
    }
    let edges = [at[0], at[2], at[3], at[5].next_up()];
    edges.windows(2).map(|w| [w[0], w[1]]).collect()
}
