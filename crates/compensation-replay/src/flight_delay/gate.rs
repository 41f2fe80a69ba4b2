//! Whether a flight can show a delay at all (design note 4).

use super::FlightDelaySettings;
use super::pieces::{Piece, Stretch};
use crate::input::{AXES, Horizontal};
use record::DelayExcitation;
use signal::DelayFit;

/// Shortest record that is tried, s.
const SHORTEST_S: f64 = 5.0;
/// A pair whose displacements disagree by more than this share does not belong together.
const MOST_UNEXPLAINED: f64 = 0.5;

/// What the motion offers, before anything is fitted.
pub(crate) fn excitation(
    first: &Horizontal,
    pieces: &[Piece],
    stretches: &[Stretch],
    delay_s: f64,
    speed: &[f64],
) -> DelayExcitation {
    let (mut moving, mut all) = (0.0, 0.0);
    for piece in pieces {
        let t: Vec<f64> = piece.rows.iter().map(|&k| first.t[k]).collect();
        for axis in AXES {
            let instants: Vec<f64> = t.iter().map(|t| t - delay_s).collect();
            let (mut values, mut v) = (vec![0.0; t.len()], vec![0.0; t.len()]);
            stretches[piece.stretch][axis].fill(&instants, &mut values, &mut v);
            all += v.iter().map(|v| v * v).sum::<f64>();
            moving += beside_a_line(&t, &v);
        }
    }
    DelayExcitation {
        samples: pieces.iter().map(|p| p.rows.len() as u64).sum(),
        duration_s: pieces.iter().map(|piece| piece.duration_s(first)).sum(),
        pieces: pieces.len() as u64,
        speed_p95_mps: percentile(speed, 0.95),
        moving_share: if all > 0.0 { moving / all } else { 0.0 },
        unexplained_share: None,
        predicted_s: None,
    }
}

pub(crate) fn percentile(values: &[f64], share: f64) -> f64 {
    let mut values = values.to_vec();
    let Some(last) = values.len().checked_sub(1) else { return 0.0 };
    let position = share.clamp(0.0, 1.0) * last as f64;
    let (_, below, above) = values.select_nth_unstable_by(position as usize, f64::total_cmp);
    let next = above.iter().copied().min_by(f64::total_cmp).unwrap_or(*below);
    *below + position.fract() * (next - *below)
}

/// Sum of squares of `y` beside its best straight line over `t`.
pub(crate) fn beside_a_line(t: &[f64], y: &[f64]) -> f64 {
    let n = t.len() as f64;
    let mean = |x: &[f64]| x.iter().sum::<f64>() / n;
    let (tm, ym) = (mean(t), mean(y));
    let (mut tt, mut ty, mut yy) = (0.0, 0.0, 0.0);
    for (t, y) in t.iter().zip(y) {
        let (t, y) = (t - tm, y - ym);
        tt += t * t;
        ty += t * y;
        yy += y * y;
    }
    (yy - if tt > 0.0 { ty * ty / tt } else { 0.0 }).max(0.0)
}

/// Why this motion cannot show a delay at all: too short, or at rest.
pub(crate) fn refuse_motion(offer: &DelayExcitation, speed: &[f64], settings: &FlightDelaySettings) -> Option<String> {
    if offer.duration_s < SHORTEST_S {
        return Some(format!(
            "only {:.1} s can be compared; at least {SHORTEST_S} s are needed, better a minute with turns",
            offer.duration_s
        ));
    }
    let fastest = percentile(speed, 0.99);
    (fastest < settings.least_speed_mps).then(|| {
        format!(
            "the vehicle does not travel: 99 % of ground speeds are below {fastest:.2} m/s (limit {} m/s); standing \
             still, late and on time look alike. Fly a minute of turns",
            settings.least_speed_mps
        )
    })
}

/// What is likely missing where a fit is refused: the motion, in words. `None` if it is rich enough.
pub(crate) fn poor_motion(offer: &DelayExcitation, speed: &[f64], settings: &FlightDelaySettings) -> Option<String> {
    let fastest = percentile(speed, 0.99);
    if fastest < SLOW_MPS {
        return Some(format!(
            "the vehicle hardly travels: 99 % of ground speeds are below {fastest:.2} m/s. Fly a minute of turns"
        ));
    }
    (offer.moving_share < settings.least_moving_share).then(|| {
        format!(
            "the flight is too straight and steady: {:.1} % of the squared velocity is neither constant nor a steady \
             change, and a constant lag looks like an offset. Fly circles or figures of eight for a minute, or change \
             speed quickly and often",
            100.0 * offer.moving_share
        )
    })
}

/// Below this, noise may pass for motion, m/s.
const SLOW_MPS: f64 = 1.0;

/// Least rate of specific force that is an acceleration for a delay, Hz.
const LEAST_FORCE_HZ: f64 = 10.0;
/// And least ratio of it to the frequency below which 95 % of the acceleration lies.
const LEAST_FORCE_RATIO: f64 = 4.0;

/// Why an acceleration is sampled too slowly to be a datum (delay network, section 3); `None` if it is not.
pub(crate) fn too_slow_for_datum(force: &Horizontal) -> Option<String> {
    let mut steps: Vec<f64> = force.t.windows(2).map(|w| w[1] - w[0]).collect();
    let rate_hz = 1.0 / signal::median_by_selection(&mut steps).filter(|s| *s > 0.0)?;
    if rate_hz < LEAST_FORCE_HZ {
        return Some(format!("the IMU is logged at {rate_hz:.1} Hz, and at least {LEAST_FORCE_HZ} Hz are needed"));
    }
    // Vibration above 5 Hz is no motion that a velocity could follow.
    let below = |axis: usize| {
        let spectrum = signal::power_spectrum(&force.axes[axis], rate_hz);
        let motion = spectrum.frequency_hz.iter().zip(&spectrum.power).filter(|(f, _)| **f <= MOTION_HZ);
        let power: Vec<(f64, f64)> = motion.map(|(f, p)| (*f, *p)).collect();
        let total: f64 = power.iter().map(|p| p.1).sum();
        let mut sum = 0.0;
        power
            .iter()
            .find(|(_, p)| {
                sum += p;
                sum >= 0.95 * total
            })
            .map_or(0.0, |p| p.0)
    };
    let highest_hz = below(0).max(below(1));
    (rate_hz < LEAST_FORCE_RATIO * highest_hz).then(|| {
        format!(
            "the IMU is logged at {rate_hz:.1} Hz, and the motion reaches {highest_hz:.1} Hz: at least \
             {LEAST_FORCE_RATIO} times that is needed"
        )
    })
}

/// Accelerations above this are vibration, Hz.
const MOTION_HZ: f64 = 5.0;

/// Why stamps that several rows share cannot show a delay; `stamps_s` is what they are good for, s.
pub(crate) fn refuse_stamps(stamps_s: f64, settings: &FlightDelaySettings) -> Option<String> {
    (stamps_s > settings.worst_sigma_s).then(|| {
        format!(
            "several rows share one stamp, and the steps between stamps alone leave a delay open by ±{:.0} ms (standard \
             uncertainty, limit {:.0} ms). Log with a finer clock, or choose stamps that the device itself gives",
            1e3 * stamps_s,
            1e3 * settings.worst_sigma_s
        )
    })
}

/// Why this fit is no measurement, and what would make it one.
pub(crate) fn refuse_fit(
    fit: &DelayFit,
    offer: &DelayExcitation,
    settings: &FlightDelaySettings,
    [first, second]: [&str; 2],
) -> Option<String> {
    if let Some(share) = offer.unexplained_share.filter(|share| *share > MOST_UNEXPLAINED) {
        return Some(format!(
            "{first} does not move as {second} says: {:.0} % of its displacement is left over at the best delay. Check \
             axes, signs and units of both",
            100.0 * share
        ));
    }
    if !fit.converged {
        return Some(format!(
            "no delay stands out: the search between {first} and {second} did not come to rest, as where they do not \
             belong together or noise is as large as the motion. Fly a minute of turns"
        ));
    }
    let known = fit.standard_uncertainty_s.max(fit.crlb_s);
    if known.is_nan() || known > settings.worst_sigma_s {
        let more = (known / settings.worst_sigma_s).powi(2) * offer.duration_s / 60.0;
        return Some(format!(
            "the delay would be known to ±{:.0} ms (standard uncertainty, limit {:.0} ms) only. Faster and tighter turns \
             help most; flying as here it takes {:.0} min",
            1e3 * known,
            1e3 * settings.worst_sigma_s,
            more.ceil()
        ));
    }
    None
}

/// Step of the first search, s.
pub(crate) const SEARCH_STEP_S: f64 = 0.02;

/// Share of the displacement (rms) that the second channel leaves over, over 5, 10 or 20 s, whichever is least: noise
/// counts less the longer, drift the shorter. Of a flight too short for three of these, over a fifth of its longest piece.
pub(crate) fn unexplained_share(
    first: &Horizontal,
    pieces: &[Piece],
    stretches: &[Stretch],
    delay_s: f64,
) -> Option<f64> {
    let over = |base_s: f64| -> Option<f64> {
        let (mut moved2, mut missed2, mut count) = (0.0, 0.0, 0);
        for piece in pieces {
            let mut i = 0;
            for j in 0..piece.rows.len() {
                let (a, b) = (piece.rows[i], piece.rows[j]);
                if first.t[b] - first.t[a] < base_s {
                    continue;
                }
                for axis in AXES {
                    let at = |row: usize| stretches[piece.stretch][axis].value_and_rate(first.t[row] - delay_s).0;
                    let moved = first.axes[axis][b] - first.axes[axis][a];
                    moved2 += moved * moved;
                    missed2 += (moved - (at(b) - at(a))).powi(2);
                }
                count += 1;
                i = j;
            }
        }
        (count >= 3 && moved2 > 0.0).then(|| (missed2 / moved2).sqrt())
    };
    let longest_s = pieces.iter().map(|piece| piece.duration_s(first)).fold(0.0, f64::max);
    [5.0, 10.0, 20.0].into_iter().filter_map(over).min_by(f64::total_cmp).or_else(|| over(longest_s / 5.0))
}
