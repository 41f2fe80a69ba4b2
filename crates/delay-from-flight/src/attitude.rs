//! Lateness of an attitude against the gyro of the accelerometer that it rotates.
//!
//! The rotation from one attitude to the next equals the integral of the angular rate, shifted by the lateness. An
//! accelerometer rotated with a late attitude makes a velocity look early, by up to the same amount in a hover.
//!
//! No attitude is known before it happens. If it is earlier than the gyro, then gyro and accelerometer are late, as
//! behind a low-pass filter: 11.3 ms for two poles at 20 Hz. In eight simulated flights of ArduPilot the attitude is 10.8
//! to 11.3 ms early. With this correction the velocity is as late against the IMU as against the truth of the log, and
//! the standard uncertainty is less than half.

use super::fit::estimate;
use super::local::{LEAST_SAMPLES, quaternion};
use flight::{Channel, Code, Flight, Notices, Severity, Stamp, rotation_vector};
use record::Estimate;
use signal::{BlockSums, least_between};

/// Largest lateness that is searched for, s, and the step of the search.
const FARTHEST_S: f64 = 0.5;
const STEP_S: f64 = 0.02;
/// Attitudes that are compared, in the search and for the result.
const MOST: [usize; 2] = [300, 2000];
/// Shortest interval between two attitudes that are compared, s.
const LEAST_INTERVAL_S: f64 = 0.09;
/// Largest share of the rotation that the shifted gyro may leave unexplained.
const MOST_UNEXPLAINED: f64 = 0.2;
/// A less certain lateness is not used, s (standard uncertainty).
const WORST_U_S: f64 = 0.005;
/// A smaller difference is not corrected, s.
const LEAST_S: f64 = 0.005;
/// From this difference on the user is warned, s: usual filters are below.
const WARN_S: f64 = 0.02;
const AXES: [usize; 3] = [0, 1, 2];

/// How much `attitude` is later than the gyro of the device of `force`, s; 0 if this is too little to matter, `None` if
/// the log does not show it. A notice says what is done about it.
pub(crate) fn lateness_s(flight: &Flight, attitude: &str, force: &str, notices: &mut Notices) -> Option<f64> {
    let gyro = format!("angular-rate.{}", force.split_once('.')?.1);
    let turned = flight.channels.get(attitude)?;
    if let Some(size_mps2) = size_without_gravity(flight.channels.get(force)?) {
        let text = format!(
            "half of its samples are below {size_mps2:.1} m/s²: gravity was removed from it before the log, or the unit is \
             wrong. How late the attitude was that removed gravity is unknown"
        );
        notices.push(Code::AttitudeShift, force, 1, text);
        return None;
    }
    let not_tested = |severity, why: &str| Err((severity, why.to_owned()));
    let tested = match flight.channels.get(&gyro).map(|rate| Turns::of(turned, rate)) {
        None => not_tested(Severity::Warning, "the log has none"),
        Some(None) => not_tested(Severity::Info, "they share too few samples, or no clock"),
        Some(Some(turns)) => turns.lateness().ok_or_else(|| match turns.wrong() {
            Some(why) => (Severity::Warning, why),
            None => (Severity::Info, "the rotations of the two differ".to_owned()),
        }),
    };
    let found = match tested {
        Ok(found) => found,
        Err((severity, why)) => {
            let text = format!(
                "not tested for lateness against {gyro}: {why}. If it is late, every lateness against {force} comes out too \
                 short, by up to as much"
            );
            notices.push(Code::AttitudeShift.at(severity), attitude, 1, text);
            return None;
        }
    };
    let size_s = found.value.abs();
    if size_s < LEAST_S {
        return Some(0.0);
    }
    let size = format!("{:.1} ± {:.1} ms", 1e3 * size_s, 1.96e3 * found.standard_uncertainty.unwrap_or_default());
    let text = match found.value > 0.0 {
        true => format!("{size} late against {gyro}: shifted by this before it rotates {force}"),
        false => format!(
            "{size} early against {gyro}. No attitude is known before it happens, so that gyro is late, and {force} with \
             it: {force} is shifted by this"
        ),
    };
    let severity = if size_s < WARN_S { Severity::Info } else { Severity::Warning };
    notices.push(Code::AttitudeShift.at(severity), attitude, 1, text);
    Some(found.value)
}

/// Median size of a specific force that does not hold gravity, m/s².
fn size_without_gravity(force: &Channel) -> Option<f64> {
    const LEAST_MPS2: f64 = 5.0;
    const MOST_ROWS: usize = 2000;
    let rows = force.update_rows();
    let axes = AXES.map(|k| force.series.component(k));
    let size = |row: &usize| AXES.map(|k| axes[k][*row].powi(2)).iter().sum::<f64>().sqrt();
    let mut sizes: Vec<f64> = rows.iter().step_by(rows.len().div_ceil(MOST_ROWS).max(1)).map(size).collect();
    let is_whole = force.present.iter().all(|present| *present);
    signal::median_in_place(&mut sizes).filter(|size| is_whole && *size < LEAST_MPS2)
}

/// Rotations from attitude to attitude, and the gyro.
struct Turns {
    /// Start and end of each interval, s.
    spans: Vec<[f64; 2]>,
    /// Rotation vector of each interval in body axes, rad.
    turns: Vec<[f64; 3]>,
    gyro_t: Vec<f64>,
    /// Angular rate, rad/s.
    gyro: Vec<[f64; 3]>,
    /// Its integral from the first sample, rad.
    turned: Vec<[f64; 3]>,
}

impl Turns {
    fn of(attitude: &Channel, gyro: &Channel) -> Option<Turns> {
        let clock = |c: &Channel| c.series.timeline().clock();
        if clock(attitude) != clock(gyro) || gyro.present.contains(&false) {
            return None;
        }
        let stamps = attitude.series.timeline().stamps();
        let origin = stamps.first()?;
        let (spans, turns) = rotations(attitude, *origin);
        let rows = gyro.update_rows();
        if spans.len() < LEAST_SAMPLES || rows.len() < LEAST_SAMPLES {
            return None;
        }
        let gyro_stamps = gyro.series.timeline().stamps();
        let gyro_t: Vec<f64> = rows.iter().map(|&row| gyro_stamps[row].seconds_since(*origin)).collect();
        let gyro: Vec<[f64; 3]> = rows.iter().map(|&row| AXES.map(|k| gyro.series.component(k)[row])).collect();
        let mut sum = [0.0; 3];
        let mut turned = vec![sum];
        for (t, v) in gyro_t.windows(2).zip(gyro.windows(2)) {
            sum = AXES.map(|k| sum[k] + 0.5 * (v[0][k] + v[1][k]) * (t[1] - t[0]));
            turned.push(sum);
        }
        Some(Turns { spans, turns, gyro_t, gyro, turned })
    }

    /// Integral of the angular rate from the first sample to `t` between the samples, which is linear between them.
    fn turned_until(&self, t: f64) -> [f64; 3] {
        let k = self.gyro_t.partition_point(|at| *at <= t).clamp(1, self.gyro_t.len() - 1) - 1;
        let (d, step) = (t - self.gyro_t[k], self.gyro_t[k + 1] - self.gyro_t[k]);
        let (a, b) = (self.gyro[k], self.gyro[k + 1]);
        AXES.map(|axis| self.turned[k][axis] + d * (a[axis] + 0.5 * d * (b[axis] - a[axis]) / step))
    }

    fn lateness(&self) -> Option<Estimate> {
        let (first, last) = (self.gyro_t[0], *self.gyro_t.last()?);
        let inside = |[from, to]: &[f64; 2]| from - FARTHEST_S > first && to + FARTHEST_S < last;
        let all: Vec<usize> = (0..self.spans.len()).filter(|&k| inside(&self.spans[k])).collect();
        let [few, many] = MOST.map(|most| Compared {
            turns: self,
            rows: all.iter().step_by(all.len().div_ceil(most).max(1)).copied().collect(),
        });
        if many.rows.len() < LEAST_SAMPLES {
            return None;
        }
        let steps = (FARTHEST_S / STEP_S).round() as i32;
        let left = |k: &i32| few.unexplained(STEP_S * f64::from(*k)).0;
        let coarse = (-steps..=steps).map(|k| (k, left(&k))).min_by(|a, b| a.1.total_cmp(&b.1))?.0;
        if coarse.abs() == steps {
            return None;
        }
        let near = |steps: i32| STEP_S * f64::from(coarse + steps);
        let (late_s, _) = least_between(|late_s| many.unexplained(late_s).0, (near(-1), near(1)), 1e-5);
        let (left, moved) = many.unexplained(late_s);
        let u = many.uncertainty(late_s)?;
        (left < MOST_UNEXPLAINED * moved && u < WORST_U_S).then(|| estimate(late_s, u))
    }

    /// What is wrong with the gyro if it follows the attitude with another factor or sign, in words.
    fn wrong(&self) -> Option<String> {
        const LEAST_CORRELATION: f64 = 0.9;
        let rows: Vec<usize> = (0..self.spans.len()).step_by(self.spans.len().div_ceil(MOST[0]).max(1)).collect();
        let compared = Compared { turns: self, rows };
        let steps = (FARTHEST_S / STEP_S).round() as i32;
        let at = |k: i32| compared.factors(STEP_S * f64::from(k));
        let follows =
            |factors: &[Option<Factor>; 3]| factors.iter().flatten().map(|f| f.correlation.powi(2)).sum::<f64>();
        let best = (-steps..=steps).map(at).max_by(|a, b| follows(a).total_cmp(&follows(b)))?;
        let [x, y, z] = best;
        if self.gyro.iter().flatten().all(|rate| *rate == 0.0) {
            return Some("it is zero throughout".to_owned());
        }
        let known: Vec<(char, Factor)> = [('x', x), ('y', y), ('z', z)]
            .into_iter()
            .filter_map(|(axis, factor)| Some((axis, factor.filter(|f| f.correlation.abs() > LEAST_CORRELATION)?)))
            .collect();
        let is = |size: f64| move |(_, f): &(char, Factor)| (f.factor.abs() / size - 1.0).abs() < 0.1;
        if !known.is_empty() && known.iter().all(is(57.3)) {
            return Some("it is 57.3 times the rotation: its unit is degrees per second".to_owned());
        }
        let reversed: Vec<String> =
            known.iter().filter(|one| is(1.0)(one) && one.1.factor < 0.0).map(|(axis, _)| axis.to_string()).collect();
        (!reversed.is_empty()).then(|| format!("its axes {} are reversed", reversed.join(" and ")))
    }
}

/// How the gyro follows the rotation about one axis.
#[derive(Clone, Copy)]
struct Factor {
    /// Gyro over rotation.
    factor: f64,
    correlation: f64,
}

/// Intervals and rotation vectors between attitudes, without gaps.
fn rotations(attitude: &Channel, origin: Stamp) -> (Vec<[f64; 2]>, Vec<[f64; 3]>) {
    let stamps = attitude.series.timeline().stamps();
    let mut rows = vec![];
    for row in attitude.updates() {
        let t = stamps[row].seconds_since(origin);
        if rows.last().is_none_or(|(_, before)| t - before >= LEAST_INTERVAL_S) {
            rows.push((row, t));
        }
    }
    let mut steps: Vec<f64> = rows.windows(2).map(|w| w[1].1 - w[0].1).collect();
    let longest_s = 2.5 * signal::median_in_place(&mut steps).unwrap_or(0.0);
    let usable = rows.windows(2).filter(|w| w[1].1 - w[0].1 <= longest_s);
    usable
        .map(|w| ([w[0].1, w[1].1], rotation_vector(quaternion(attitude, w[0].0), quaternion(attitude, w[1].0))))
        .unzip()
}

/// Some of the intervals, with the gyro.
struct Compared<'a> {
    turns: &'a Turns,
    rows: Vec<usize>,
}

impl Compared<'_> {
    /// Rotation less that of the gyro, and the latter, each without a constant rate, for each axis.
    fn residuals(&self, late_s: f64) -> [(Vec<f64>, Vec<f64>); 3] {
        let span = |row: &usize| self.turns.spans[*row];
        let by_gyro = |row: &usize| {
            let [from, to] = span(row).map(|t| self.turns.turned_until(t - late_s));
            AXES.map(|k| to[k] - from[k])
        };
        let turned: Vec<[f64; 3]> = self.rows.iter().map(by_gyro).collect();
        let long: Vec<f64> = self.rows.iter().map(span).map(|[from, to]| to - from).collect();
        AXES.map(|axis| {
            let turned: Vec<f64> = turned.iter().map(|turned| turned[axis]).collect();
            let left = self.rows.iter().zip(&turned).map(|(&k, by_gyro)| self.turns.turns[k][axis] - by_gyro).collect();
            (without_rate(left, &long), without_rate(turned, &long))
        })
    }

    /// Factor and correlation for each axis; `None` for an axis without rotation.
    fn factors(&self, late_s: f64) -> [Option<Factor>; 3] {
        self.residuals(late_s).map(|(left, by_gyro)| {
            let turn: Vec<f64> = left.iter().zip(&by_gyro).map(|(left, by_gyro)| left + by_gyro).collect();
            let product: f64 = turn.iter().zip(&by_gyro).map(|(a, b)| a * b).sum();
            let [of_turn, of_gyro] = [&turn, &by_gyro].map(|y| signal::sum_of_squares(y));
            let correlation = product / (of_turn * of_gyro).sqrt();
            (of_turn > 0.0 && of_gyro > 0.0).then(|| Factor { factor: of_gyro / product, correlation })
        })
    }

    /// Sum of squares that a gyro earlier by `late_s` leaves, and that of its own rotation, rad².
    fn unexplained(&self, late_s: f64) -> (f64, f64) {
        let squares = self.residuals(late_s).map(|(left, turned)| [left, turned].map(|y| signal::sum_of_squares(&y)));
        squares.into_iter().fold((0.0, 0.0), |sum, [left, turned]| (sum.0 + left, sum.1 + turned))
    }

    /// Standard uncertainty from blocks of the record, s, so that residuals may be correlated.
    fn uncertainty(&self, late_s: f64) -> Option<f64> {
        const BESIDE_S: f64 = 1e-3;
        let [before, at, after] = [-BESIDE_S, 0.0, BESIDE_S].map(|by| self.residuals(late_s + by));
        let row = |k: usize| {
            let of = |axis: usize| {
                let slope = (after[axis].0[k] - before[axis].0[k]) / (2.0 * BESIDE_S);
                [slope * at[axis].0[k], slope * slope]
            };
            AXES.map(of).into_iter().fold([0.0, 0.0], |sum, axis| [sum[0] + axis[0], sum[1] + axis[1]])
        };
        let sums = BlockSums::of(self.rows.len(), (0..self.rows.len()).map(row));
        sums.estimate(|[score, information]| score / information)?.standard_uncertainty
    }
}

/// `y` less its best constant rate over intervals of these lengths.
fn without_rate(mut y: Vec<f64>, long: &[f64]) -> Vec<f64> {
    let rate = y.iter().zip(long).map(|(y, t)| y * t).sum::<f64>() / signal::sum_of_squares(long);
    y.iter_mut().zip(long).for_each(|(y, t)| *y -= rate * t);
    y
}
