//! The encoder's channel as an angle: counts per revolution, turns unwrapped, glitches removed.

use crate::rig::Rig;
use crate::slip::{Slip, slips};
use flight::{Channel, Code, Flight, Notices, Quantity, RejectCount, Severity, Stamp};
use std::f64::consts::TAU;

/// Maximum rate of a hand-driven bar, rad/s: a larger step is a wrap-around or a glitch.
const FASTEST_RAD_PER_S: f64 = 30.0;
/// Steps up to this many counts are always plausible.
const LEAST_PLAUSIBLE_COUNTS: f64 = 8.0;
/// Counters wrap around at these powers of two.
const COUNTER_BITS: [i32; 4] = [16, 20, 24, 32];
/// Minimum number of rows of a record.
const LEAST_ROWS: usize = 50;

/// The encoder as an angle without sign and zero: counts times the angle of one count.
#[derive(Debug, Clone, PartialEq)]
pub struct EncoderSeries {
    /// Source channel.
    pub channel: String,
    /// Seconds after the first timestamp of the channel.
    pub t_s: Vec<f64>,
    /// Rotation angle, rad, continuous; the encoder's own sign and zero.
    pub angle_rad: Vec<f64>,
    /// Counts per revolution.
    pub counts_per_rev: f64,
    /// Source of that number.
    pub counts_source: String,
    /// The timestamp of time zero.
    pub origin: Stamp,
    /// Rejected rows, by reason.
    pub rejected: Vec<RejectCount>,
    /// Places of lost or gained counts. The series is the longest part without any.
    pub slips: Vec<Slip>,
    /// Repairs and assumptions.
    pub notices: Notices,
}

/// Why an encoder cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum EncoderError {
    /// The rig file names a channel that is missing or is not an encoder.
    #[error("the rig's encoder channel `{name}` is not in the log; it holds {}", listed(.there))]
    NoSuchChannel {
        /// Name in the rig file.
        name: String,
        /// Encoders in the log.
        there: Vec<String>,
    },
    /// The log has no encoder.
    #[error("the log holds no encoder (a channel of encoder-count or encoder-angle)")]
    NoEncoder,
    /// The log has several encoders.
    #[error("the log holds several encoders ({}); set encoder.channel in the rig file", listed(.there))]
    Several {
        /// Their names.
        there: Vec<String>,
    },
    /// Counts without counts per revolution.
    #[error("{channel} holds counts: set encoder.counts_per_rev in the rig file")]
    CountsPerRevUnknown {
        /// The channel.
        channel: String,
    },
    /// Too few rows to smooth.
    #[error("{channel} has {rows} rows: at least {least} are needed", least = LEAST_ROWS)]
    TooShort {
        /// The channel.
        channel: String,
        /// Number of rows.
        rows: usize,
    },
    /// The bar does not move.
    #[error("{channel} never changes: the bar was not swung")]
    Still {
        /// The channel.
        channel: String,
    },
}

fn listed(names: &[String]) -> String {
    if names.is_empty() { "none".to_owned() } else { names.join(", ") }
}

/// The encoder's channel of `flight`: the one named in the rig file; the default is the only one.
///
/// # Errors
/// [`EncoderError`]: no encoder, several, or not the named one.
pub fn encoder_channel<'a>(flight: &'a Flight, rig: &Rig) -> Result<(&'a str, &'a Channel), EncoderError> {
    let is_encoder = |c: &Channel| matches!(c.quantity, Quantity::EncoderCount | Quantity::EncoderAngle);
    let all: Vec<(&str, &Channel)> =
        flight.channels.iter().filter(|(_, c)| is_encoder(c)).map(|(n, c)| (n.as_str(), c)).collect();
    let there = || all.iter().map(|(n, _)| (*n).to_owned()).collect();
    if let Some(name) = &rig.encoder.channel {
        let named = all.iter().find(|(n, _)| n == name).copied();
        return named.ok_or_else(|| EncoderError::NoSuchChannel { name: name.clone(), there: there() });
    }
    match all[..] {
        [] => Err(EncoderError::NoEncoder),
        [only] => Ok(only),
        _ => Err(EncoderError::Several { there: there() }),
    }
}

impl EncoderSeries {
    /// The channel `name` as an angle.
    ///
    /// # Errors
    /// [`EncoderError`].
    pub fn of(name: &str, channel: &Channel, rig: &Rig) -> Result<EncoderSeries, EncoderError> {
        let rows = channel.series.len();
        if rows < LEAST_ROWS {
            return Err(EncoderError::TooShort { channel: name.to_owned(), rows });
        }
        let origin = channel.series.timeline().first().unwrap_or(Stamp(0));
        let t_s = channel.series.timeline().seconds_since(origin);
        let raw = channel.series.component(0);
        let mut notices = Notices::new();
        let scale = scale_of(name, channel.quantity, raw, rig, &mut notices)?;
        let turned: Vec<f64> = raw.iter().map(|v| v * scale.rad_per_unit).collect();
        let lsb = TAU / scale.counts_per_rev;
        let unwrapped = unwrap_turns(&t_s, &turned, lsb, &wrap_angles(&scale), name, &mut notices);
        let kept = without_spikes(&t_s, &unwrapped, lsb);
        let left_out = rows - kept.len();
        let mut rejected = vec![];
        if left_out > 0 {
            let text = format!("{left_out} single samples jump away and back faster than a bar can turn: rejected");
            notices.push(Code::EncoderRepaired, name, left_out as u64, text);
            let first = (0..rows).find(|row| kept.binary_search(row).is_err()).unwrap_or(0);
            rejected.push(RejectCount {
                reason: "jumps away and back".to_owned(),
                count: left_out as u64,
                first: format!("row {first}"),
            });
        }
        if kept.iter().all(|&row| unwrapped[row] == unwrapped[kept[0]]) {
            return Err(EncoderError::Still { channel: name.to_owned() });
        }
        let series = EncoderSeries {
            channel: name.to_owned(),
            t_s: kept.iter().map(|&row| t_s[row]).collect(),
            angle_rad: kept.iter().map(|&row| unwrapped[row]).collect(),
            counts_per_rev: scale.counts_per_rev,
            counts_source: scale.source,
            origin,
            rejected,
            slips: vec![],
            notices,
        };
        Ok(series.without_slips())
    }

    /// The part between two slips in which the reading changes most often. The other parts have a different zero, and an
    /// encoder that has died does not change.
    fn without_slips(mut self) -> EncoderSeries {
        self.slips = slips(&self.t_s, &self.angle_rad, self.lsb_rad());
        if self.slips.is_empty() {
            return self;
        }
        let rows = self.t_s.len();
        let ends = self.slips.iter().map(|slip| slip.row);
        let starts = std::iter::once(0).chain(ends.clone());
        let parts = starts.zip(ends.chain([rows])).map(|(from, to)| from..to);
        let changes = |part: &std::ops::Range<usize>| {
            self.angle_rad[part.clone()].windows(2).filter(|pair| pair[0] != pair[1]).count()
        };
        let used = parts.max_by_key(changes).unwrap_or(0..rows);
        let left_out = rows - used.len();
        let [from_s, to_s] = [used.start, used.end - 1].map(|row| self.t_s[row]);
        let text = format!(
            "the encoder slipped: {}. Only the part with the most motion is used, {from_s:.2} to {to_s:.2} s",
            self.slips_in_words()
        );
        self.notices.push(Code::EncoderRepaired, &self.channel, self.slips.len() as u64, text);
        self.rejected.push(RejectCount {
            reason: "before or after a slip".to_owned(),
            count: left_out as u64,
            first: format!("{:.2} s", if used.start > 0 { self.t_s[0] } else { self.t_s[used.end] }),
        });
        self.t_s = self.t_s[used.clone()].to_vec();
        self.angle_rad = self.angle_rad[used].to_vec();
        self
    }

    /// `+50.0 counts (9.00°) at 22.00 s`, for the first few slips.
    pub(crate) fn slips_in_words(&self) -> String {
        const MOST: usize = 3;
        let word = |slip: &Slip| {
            let degrees = (slip.counts * self.lsb_rad()).to_degrees();
            let [counts, degrees] =
                [format!("{:+.1}", slip.counts), format!("{degrees:+.2}")].map(|x| flight::with_minus(&x));
            format!("{counts} counts ({degrees}°) at {:.2} s", slip.t_s)
        };
        let mut words: Vec<String> = self.slips.iter().take(MOST).map(word).collect();
        if self.slips.len() > MOST {
            words.push(format!("and {} more", self.slips.len() - MOST));
        }
        words.join(", ")
    }

    /// The angle of one count, rad.
    #[must_use]
    pub fn lsb_rad(&self) -> f64 {
        TAU / self.counts_per_rev
    }

    /// Variance of one reading, rad²: LSB²/12, that of a perfect quantiser.
    #[must_use]
    pub fn variance(&self) -> f64 {
        self.lsb_rad().powi(2) / 12.0
    }
}

/// Conversion of a reading to an angle.
struct Scale {
    rad_per_unit: f64,
    counts_per_rev: f64,
    source: String,
    /// Whether the log has bare counts.
    is_count: bool,
}

fn scale_of(
    name: &str,
    quantity: Quantity,
    raw: &[f64],
    rig: &Rig,
    notices: &mut Notices,
) -> Result<Scale, EncoderError> {
    let is_count = quantity == Quantity::EncoderCount;
    let stated = rig.encoder.counts_per_rev;
    let (counts_per_rev, source) = match stated {
        Some(n) => (n, format!("rig file: {} lines × {}", n / rig.encoder.decoding, rig.encoder.decoding)),
        None if is_count => return Err(EncoderError::CountsPerRevUnknown { channel: name.to_owned() }),
        None => inferred_counts(raw).ok_or_else(|| EncoderError::Still { channel: name.to_owned() })?,
    };
    if let (Some(stated), false) = (stated, is_count) {
        warn_of_other_steps(name, stated, raw, notices);
    }
    let rad_per_unit = if is_count { TAU / counts_per_rev } else { 1.0 };
    Ok(Scale { rad_per_unit, counts_per_rev, source, is_count })
}

/// Warns if the steps of an angle do not match the stated encoder (lines for counts, or ×4 forgotten).
fn warn_of_other_steps(name: &str, stated: f64, raw: &[f64], notices: &mut Notices) {
    let Some(seen) = lattice_counts(raw) else { return };
    if (seen / stated - 1.0).abs() > 0.01 {
        let text = format!("the angle has {seen:.0} steps per revolution, but the rig file says {stated:.0}");
        notices.push(Code::RigContradicted, name, 1, text);
    }
}

/// Counts per revolution inferred from the steps of an angle, and how; `None` without motion.
fn inferred_counts(raw: &[f64]) -> Option<(f64, String)> {
    if let Some(counts) = lattice_counts(raw) {
        let source = format!("inferred: the angle moves in steps of {:.4}°", 360.0 / counts);
        return Some((counts, source));
    }
    let noise = Some(second_difference_sigma(raw)).filter(|sigma| *sigma > 0.0)?;
    let counts = (TAU / (noise * 12f64.sqrt())).round().max(4.0);
    let source = format!(
        "no steps were detected: the scatter of {:.4}° is assumed to be that of {counts} counts",
        noise.to_degrees()
    );
    Some((counts, source))
}

/// The finest whole number of steps per revolution that fits the angles; `None` if no lattice fits.
///
/// Angles on a lattice of N steps make `|mean exp(iNx)|` one; text rounding by σ lowers it to exp(−(Nσ)²/2).
fn lattice_counts(raw: &[f64]) -> Option<f64> {
    /// Maximum number of samples; prime strides would be no better.
    const SAMPLES: usize = 600;
    const LEAST_CONCENTRATION: f64 = 0.8;
    let range =
        raw.iter().copied().fold(f64::NEG_INFINITY, f64::max) - raw.iter().copied().fold(f64::INFINITY, f64::min);
    let smallest = smallest_step(raw)?;
    let finest = TAU / smallest;
    // Fewer than a dozen steps over the whole swing cannot be recognized as a lattice.
    let coarsest = (12.0 * TAU / range).max(finest / 3.0).max(4.0);
    if finest * 4.0 < coarsest || finest > 1e6 {
        return None;
    }
    let stride = raw.len().div_ceil(SAMPLES);
    let some: Vec<f64> = raw.iter().step_by(stride).map(|v| v - raw[0]).collect();
    let concentration = |n: f64| {
        let (s, c) = some.iter().fold((0.0, 0.0), |(s, c), x| {
            let (ds, dc) = (n * x).sin_cos();
            (s + ds, c + dc)
        });
        f64::hypot(s, c) / some.len() as f64
    };
    let is_lattice = |n: f64| concentration(n) > LEAST_CONCENTRATION;
    let guess = finest.round();
    let (from, to) = (coarsest.ceil() as u64, ((finest * 4.0).ceil() as u64).min(40_000));
    let first = if is_lattice(guess) && !is_lattice((guess / 2.0).round()) {
        guess
    } else {
        (from..=to).map(|n| n as f64).find(|n| is_lattice(*n))?
    };
    Some(top_of_hill(concentration, first))
}

/// The whole number around `start` at which `height` is largest: an arc does not separate neighbours sharply.
fn top_of_hill(height: impl Fn(f64) -> f64, start: f64) -> f64 {
    let climbed = |from: f64, step: f64| {
        let mut at = from;
        while height(at + step) > height(at) {
            at += step;
        }
        at
    };
    climbed(climbed(start, 1.0), -1.0)
}

/// The smallest difference between two of the values, except rounding; `None` if they are all equal.
fn smallest_step(raw: &[f64]) -> Option<f64> {
    /// Resolution of text with seven decimals of a degree, rad.
    const ROUNDING: f64 = 1e-8;
    let mut sorted = raw.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    sorted.windows(2).map(|w| w[1] - w[0]).filter(|step| *step > ROUNDING).min_by(f64::total_cmp)
}

/// Robust scatter of a smooth series from its second differences.
fn second_difference_sigma(raw: &[f64]) -> f64 {
    let second: Vec<f64> = raw.windows(3).map(|w| w[0] - 2.0 * w[1] + w[2]).collect();
    signal::robust_sigma(&second).unwrap_or(0.0) / 6f64.sqrt()
}

/// Angles at which this reading may wrap around, with their names.
fn wrap_angles(scale: &Scale) -> Vec<(f64, String)> {
    let one_turn = (TAU, "one revolution".to_owned());
    if !scale.is_count {
        return vec![one_turn];
    }
    let counters = COUNTER_BITS.map(|bits| (2f64.powi(bits) * scale.rad_per_unit, format!("2^{bits} counts")));
    std::iter::once(one_turn).chain(counters).collect()
}

/// The largest plausible step of a bar in `dt`.
fn plausible(dt: f64, lsb: f64) -> f64 {
    FASTEST_RAD_PER_S * dt + LEAST_PLAUSIBLE_COUNTS * lsb
}

/// The angle without wrap-arounds. The modulus is the one that explains most of the impossible steps.
fn unwrap_turns(
    t: &[f64],
    angle: &[f64],
    lsb: f64,
    moduli: &[(f64, String)],
    name: &str,
    notices: &mut Notices,
) -> Vec<f64> {
    let range =
        angle.iter().copied().fold(f64::NEG_INFINITY, f64::max) - angle.iter().copied().fold(f64::INFINITY, f64::min);
    let explained = |modulus: f64| {
        let wrapped_around = |k: usize| {
            let (step, limit) = (angle[k] - angle[k - 1], plausible(t[k] - t[k - 1], lsb));
            // Above half a turn the step alone is ambiguous.
            step.abs() > limit && limit < 0.5 * modulus && (step.abs() - modulus).abs() <= limit
        };
        (1..angle.len()).filter(|&k| wrapped_around(k)).count()
    };
    let candidates = moduli.iter().filter(|(modulus, _)| range <= modulus * (1.0 + 1e-9) + lsb);
    let best = candidates.map(|(modulus, name)| (explained(*modulus), *modulus, name)).max_by_key(|c| c.0);
    let Some((count @ 1.., modulus, what)) = best else { return angle.to_vec() };
    let text = format!("the encoder wrapped around {count} times at {what}: unwrapped");
    notices.push(Code::EncoderRepaired.at(Severity::Info), name, count as u64, text);
    let mut turns = 0.0;
    let mut unwrapped = Vec::with_capacity(angle.len());
    for (k, value) in angle.iter().enumerate() {
        if let Some(before) = k.checked_sub(1).map(|b| angle[b]) {
            turns -= ((value - before) / modulus).round();
        }
        unwrapped.push(value + turns * modulus);
    }
    unwrapped
}

/// Rows that do not jump away from both neighbours and back, faster than any bar turns.
fn without_spikes(t: &[f64], angle: &[f64], lsb: f64) -> Vec<usize> {
    let mut kept: Vec<usize> = Vec::with_capacity(angle.len());
    for row in 0..angle.len() {
        let leaps = |other: usize| (angle[row] - angle[other]).abs() > plausible((t[row] - t[other]).abs(), lsb);
        let neighbours_agree = |a: usize, b: usize| (angle[a] - angle[b]).abs() <= plausible(t[b] - t[a], lsb);
        let is_spike = match (kept.last().copied(), row + 1 < angle.len()) {
            (Some(before), true) => leaps(before) && leaps(row + 1) && neighbours_agree(before, row + 1),
            (Some(before), false) => leaps(before),
            (None, true) => leaps(row + 1) && row + 2 < angle.len() && neighbours_agree(row + 1, row + 2),
            (None, false) => false,
        };
        if !is_spike {
            kept.push(row);
        }
    }
    kept
}
