//! Quality checks of a record before any verdict (design note 1.6, 3.3).

use crate::kinematics::{BarState, specific_force};
use crate::motion::Motion;
use crate::references::References;
use flight::with_minus;
use flight::{Channel, Flight, Quantity};
use record::{COUNTS_OR_STAMPS_WRONG, ENCODER_RESIDUAL, ENCODER_SLIP, GateCheck, QualityGate};
use signal::{Spectrum, power_spectrum};

/// Below this amplitude there is too little motion, rad.
const LEAST_AMPLITUDE: f64 = 2.0 * std::f64::consts::PI / 180.0;
/// An amplitude sufficient for every channel, rad.
const GOOD_AMPLITUDE: f64 = 20.0 * std::f64::consts::PI / 180.0;
/// With fewer swings a delay cannot be distinguished from a transient.
const LEAST_SWINGS: u64 = 2;
const GOOD_SWINGS: u64 = 10;
/// Encoder samples per period of the rms frequency.
const GOOD_SAMPLES_PER_SWING: f64 = 20.0;
/// Residuals of a perfect quantiser are 1/√12 = 0.289 counts.
const GOOD_RESIDUAL_COUNTS: [f64; 2] = [0.15, 0.6];
/// Share of rows at the very end of the range that indicates saturation.
const SATURATED_SHARE: f64 = 0.01;
/// Tangential specific force below this share of its two parts cancels: the accelerometer's x axis has no signal.
const NULL_SHARE: f64 = 0.1;
/// The sensor may begin this much later and end this much earlier than the encoder without a word, s.
const END_S: f64 = 1.0;
/// Grid of the spectrum, Hz.
const SPECTRUM_RATE_HZ: f64 = 50.0;

/// A gate, and why it is closed for every channel, if it is.
pub(crate) struct Gate {
    pub(crate) quality: QualityGate,
    pub(crate) closed: Option<String>,
}

/// Judges motion and channels. `arm_m` is the accelerometer's lever arm.
pub(crate) fn gate(motion: &Motion, sensor: &Flight, references: &References, arm_m: [f64; 3], gravity: f64) -> Gate {
    let (from, to) = covered(references);
    let parts = motion.parts().into_iter().map(|(first, last)| (first.max(from), last.min(to)));
    let parts: Vec<Vec<BarState>> = parts.filter(|p| p.0 < p.1).map(|part| states_of(motion, part)).collect();
    let states: Vec<BarState> = parts.iter().flatten().copied().collect();
    let Spectra { angle: spectrum, rate } = spectra(motion);
    let band = rate.band(0.9).unwrap_or([0.0; 2]);
    let rms_frequency_hz = spectrum.rms_frequency_hz().unwrap_or(0.0);
    let (first, last) = motion.span();
    let is_covered = from <= first + END_S && last - END_S <= to;
    let [low, high] = if is_covered { motion.angle_range() } else { range_of(&states) };
    let within = match is_covered {
        true => String::new(),
        false => format!(" in the {:.1} s that the sensor covers", (last.min(to) - first.max(from)).max(0.0)),
    };
    let amplitude = 0.5 * (high - low);
    let angles = |part: &Vec<BarState>| part.iter().map(|s| s.angle).collect::<Vec<f64>>();
    let swings = parts.iter().map(|part| swings(&angles(part), amplitude)).sum();
    let mut checks = vec![
        amplitude_check(amplitude, low, high),
        swings_check(swings, &within, band),
        encoder_check(motion, rms_frequency_hz),
        residual_check(motion),
    ];
    checks.extend(slip_check(motion));
    checks.extend(null_check(&states, sensor, arm_m, gravity));
    checks.extend(sensor.channels.iter().filter_map(|(name, channel)| saturation_check(name, channel, motion)));
    let closed = if amplitude < LEAST_AMPLITUDE {
        Some(format!(
            "the bar swings by ±{:.2}° only{within}; swing it by ±30° or more, by hand and not too regularly",
            amplitude.to_degrees()
        ))
    } else if swings < LEAST_SWINGS {
        Some(too_few(swings, &within, states.first().zip(states.last()).map_or(0.0, |(a, b)| b.angle - a.angle)))
    } else {
        None
    };
    let quality =
        QualityGate { checks, excited_band_hz: band, rms_frequency_hz, swings, not_observable: not_observable() };
    Gate { quality, closed }
}

/// What the measured channels cover together, s: swings before or after it measure nothing.
fn covered(references: &References) -> (f64, f64) {
    let spans = references.channels.iter().filter_map(|c| c.t_s.first().copied().zip(c.t_s.last().copied()));
    spans.fold((f64::INFINITY, f64::NEG_INFINITY), |(from, to), (first, last)| (from.min(first), to.max(last)))
}

fn range_of(states: &[BarState]) -> [f64; 2] {
    if states.is_empty() {
        return [0.0; 2];
    }
    states.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], s| [low.min(s.angle), high.max(s.angle)])
}

/// States of the bar over a part of the record, evenly spaced.
fn states_of(motion: &Motion, part: (f64, f64)) -> Vec<BarState> {
    motion.grid(part, SPECTRUM_RATE_HZ).iter().filter_map(|&t| motion.at(t)).collect()
}

/// Frequency distribution of the bar's angle and rate, over the longest part without a gap.
pub(crate) struct Spectra {
    pub(crate) angle: Spectrum,
    pub(crate) rate: Spectrum,
}

pub(crate) fn spectra(motion: &Motion) -> Spectra {
    let (first, last) = motion.longest_part();
    let states = states_of(motion, (first, last));
    let rate_hz = states.len().saturating_sub(1) as f64 / (last - first);
    let of = |f: fn(&BarState) -> f64| power_spectrum(&states.iter().map(f).collect::<Vec<f64>>(), rate_hz);
    Spectra { angle: of(|s| s.angle), rate: of(|s| s.rate) }
}

/// The gaps of the encoder, and how many channel samples they affect; `None` without a gap.
pub(crate) fn gap_check(motion: &Motion, left_out: u64) -> Option<GateCheck> {
    let gaps = motion.gaps();
    let (start, end) = gaps.iter().copied().max_by(|a, b| (a.1 - a.0).total_cmp(&(b.1 - b.0)))?;
    let text = match gaps.len() {
        1 => format!("the encoder has a gap from {start:.2} to {end:.2} s"),
        n => {
            let total_s: f64 = gaps.iter().map(|(from, to)| to - from).sum();
            format!("the encoder has {n} gaps, {total_s:.2} s in total, the longest from {start:.2} to {end:.2} s")
        }
    };
    let text = format!("{text}. The motion there is unknown: {left_out} samples of the channels are not used");
    Some(check("encoder gaps", false, text))
}

/// Why a record with this few reversals is rejected. `turned` is the angle from its first to its last sample, rad.
fn too_few(swings: u64, within: &str, turned: f64) -> String {
    let turns = (turned / std::f64::consts::TAU).abs();
    if turns < 1.0 {
        return format!("the record holds {}{within}; ten or more are needed", counted(swings));
    }
    format!(
        "the bar made {turns:.1} full turns and {}{within}: only swings to and fro are measured. Reverse the bar ten times or \
         more within the record",
        counted(swings)
    )
}

/// `1 swing`, `2 swings`.
fn counted(swings: u64) -> String {
    format!("{swings} swing{}", if swings == 1 { "" } else { "s" })
}

fn check(name: &str, passed: bool, text: String) -> GateCheck {
    GateCheck { name: name.to_owned(), passed, text }
}

fn amplitude_check(amplitude: f64, low: f64, high: f64) -> GateCheck {
    let text = format!(
        "±{:.1}° (from {}° to {}°); ±{:.0}° or more shows every channel well",
        amplitude.to_degrees(),
        with_minus(&format!("{:.1}", low.to_degrees())),
        with_minus(&format!("{:.1}", high.to_degrees())),
        GOOD_AMPLITUDE.to_degrees()
    );
    check("swing amplitude", amplitude >= GOOD_AMPLITUDE, text)
}

fn swings_check(swings: u64, within: &str, [low, high]: [f64; 2]) -> GateCheck {
    let passed = swings >= GOOD_SWINGS;
    let text = match passed {
        true => format!("{swings} swings{within}; 90 % of the rate's power lies from {low:.2} to {high:.2} Hz"),
        false => format!("{}{within}; {GOOD_SWINGS} or more are recommended", counted(swings)),
    };
    check("number of swings", passed, text)
}

fn encoder_check(motion: &Motion, rms_frequency_hz: f64) -> GateCheck {
    let per_swing = if rms_frequency_hz > 0.0 { motion.rate_hz() / rms_frequency_hz } else { 0.0 };
    let text = format!(
        "{:.1} Hz are {per_swing:.0} samples a swing; {GOOD_SAMPLES_PER_SWING:.0} or more are good",
        motion.rate_hz()
    );
    check("encoder rate", per_swing >= GOOD_SAMPLES_PER_SWING, text)
}

fn residual_check(motion: &Motion) -> GateCheck {
    let counts = motion.residual_rms_counts();
    let [low, high] = GOOD_RESIDUAL_COUNTS;
    let text = match counts {
        c if c > high => {
            format!("{c:.2} counts rms about the smoothed motion, a quantiser leaves 0.29: {COUNTS_OR_STAMPS_WRONG}")
        }
        c if c < low => format!(
            "{c:.2} counts rms about the smoothed motion, a quantiser leaves 0.29: the angle was smoothed before, or the \
             counts per revolution are wrong"
        ),
        c => format!("{c:.2} counts rms about the smoothed motion, as a quantiser leaves (0.29)"),
    };
    check(ENCODER_RESIDUAL, (low..=high).contains(&counts), text)
}

fn slip_check(motion: &Motion) -> Option<GateCheck> {
    let encoder = motion.encoder();
    (!encoder.slips.is_empty()).then(|| {
        let text = format!("{} (counts were lost, or the encoder turned on its shaft)", encoder.slips_in_words());
        check(ENCODER_SLIP, false, text)
    })
}

/// A freely hanging pendulum has no tangential specific force at all: `L ξ″ + g sin ξ = 0`.
fn null_check(states: &[BarState], sensor: &Flight, arm_m: [f64; 3], gravity: f64) -> Option<GateCheck> {
    sensor.channels.values().find(|c| c.quantity == Quantity::SpecificForce)?;
    let rms = |f: &dyn Fn(&BarState) -> f64| {
        let mean = states.iter().map(f).sum::<f64>() / states.len() as f64;
        (states.iter().map(|s| (f(s) - mean).powi(2)).sum::<f64>() / states.len() as f64).sqrt()
    };
    let whole = rms(&|s| specific_force(s, arm_m, gravity).value[0]);
    let weight = rms(&|s| gravity * s.angle.sin());
    let text = format!("accX would read {whole:.3} m/s² rms, gravity's part alone is {weight:.3} m/s²");
    let passed = whole > NULL_SHARE * weight;
    let advice = if passed {
        ""
    } else {
        ": the bar swings freely, so accX measures next to nothing; push it away from its natural rhythm"
    };
    Some(check("accelerometer x not in its null", passed, text + advice))
}

/// Below this share of its maximum rate the bar rests, and its sensors repeat their readings.
const STILL_SHARE: f64 = 0.05;

/// Checks for updates at the very end of a component's range, several in a row, while the bar moves.
fn saturation_check(name: &str, channel: &Channel, motion: &Motion) -> Option<GateCheck> {
    let t = channel.series.timeline().seconds_since(motion.origin());
    let fastest = motion.states().map(|(_, s)| s.rate.abs()).fold(0.0, f64::max);
    let moves = |row: &usize| motion.at(t[*row]).is_some_and(|s| s.rate.abs() > STILL_SHARE * fastest);
    let rows: Vec<usize> = channel.update_rows().into_iter().filter(moves).collect();
    let of = |y: &Vec<f64>| saturated_share(&rows.iter().map(|&row| y[row]).collect::<Vec<f64>>());
    let worst = channel.series.components().iter().map(of).fold(0.0, f64::max);
    let bound_to_saturate = matches!(channel.quantity, Quantity::SpecificForce | Quantity::AngularRate);
    (bound_to_saturate || worst > SATURATED_SHARE).then(|| {
        let text = format!("{:.1} % of the rows of {name} are at the limit of its range", worst * 100.0);
        check("saturation", worst <= SATURATED_SHARE, text)
    })
}

/// Share of rows in runs of three or more equal values at the largest or smallest value.
fn saturated_share(y: &[f64]) -> f64 {
    const LEAST_RUN: usize = 3;
    let ends = y.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(*v), high.max(*v)]);
    if y.len() < LEAST_RUN || ends[0] == ends[1] {
        return 0.0;
    }
    let runs = y.chunk_by(|a, b| a == b).filter(|run| run.len() >= LEAST_RUN && ends.contains(&run[0]));
    runs.map(<[f64]>::len).sum::<usize>() as f64 / y.len() as f64
}

/// Number of pairs of reversals by more than a tenth of the amplitude.
fn swings(angles: &[f64], amplitude: f64) -> u64 {
    let threshold = 0.1 * amplitude;
    let Some(&first) = angles.first().filter(|_| threshold > 0.0) else { return 0 };
    let (mut extreme, mut rising, mut reversals) = (first, None, 0);
    for &angle in angles {
        match rising {
            None if (angle - extreme).abs() > threshold => {
                rising = Some(angle > extreme);
                extreme = angle;
            }
            None => {}
            Some(up) => {
                let further = if up { angle > extreme } else { angle < extreme };
                if further {
                    extreme = angle;
                } else if (angle - extreme).abs() > threshold {
                    reversals += 1;
                    rising = Some(!up);
                    extreme = angle;
                }
            }
        }
    }
    reversals / 2
}

fn not_observable() -> Vec<String> {
    [
        "accelerometer y: a planar swing shows it only gravity's component along the axis",
        "gyro x and z, and the rotation of the mount about them",
        "magnetometer y, and hard iron apart from the y column of soft iron, from a single azimuth",
        "a delay common to encoder timestamps and sensor timestamps",
    ]
    .map(str::to_owned)
    .to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn swings_are_counted_once_despite_noise() {
        let angle = |t: f64| (std::f64::consts::TAU * 0.5 * t).sin() + 0.01 * (40.0 * t).sin();
        let angles: Vec<f64> = (0..1000).map(|k| angle(f64::from(k) * 0.02)).collect();
        // 20 s at 0.5 Hz: ten periods, twenty reversals minus the ends.
        assert!((9..=10).contains(&swings(&angles, 1.0)));
        assert_eq!(swings(&[0.3; 50], 0.0), 0);
    }

    #[test]
    fn too_few_swings_are_reported_with_the_number_needed() {
        assert_eq!(swings_check(2, "", [0.4, 1.2]).text, "2 swings; 10 or more are recommended");
        assert_eq!(swings_check(1, "", [0.4, 1.2]).text, "1 swing; 10 or more are recommended");
        assert!(swings_check(10, "", [0.4, 1.2]).passed);
    }

    #[test]
    fn a_clipped_signal_is_saturated_and_a_sine_is_not() {
        let sine: Vec<f64> = (0..600).map(|k| (f64::from(k) * 0.05).sin()).collect();
        assert_eq!(saturated_share(&sine), 0.0);
        let clipped: Vec<f64> = sine.iter().map(|v| v.clamp(-0.9, 0.9)).collect();
        // |sin| > 0.9 during 28.7 % of a turn.
        assert!((saturated_share(&clipped) - 0.287).abs() < 0.03, "{}", saturated_share(&clipped));
        assert_eq!(saturated_share(&[1.0; 20]), 0.0);
    }
}
