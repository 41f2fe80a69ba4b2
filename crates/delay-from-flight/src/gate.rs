//! Whether a flight can show a delay at all (design note 4).

use super::FlightDelaySettings;
use super::pieces::{LEAST_ROWS, Names, Piece, Stretch};
use crate::horizontal::{AXES, Horizontal};
use record::DelayExcitation;
use signal::DelayFit;

/// Shortest record that is tried, s.
const SHORTEST_S: f64 = 5.0;

/// Summary of the motion for gates and advice.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Motion {
    /// 95th percentile of the second channel's rate less a trend, mean over a second, m/s (m/s² for accelerations).
    pub(crate) unsteady: f64,
    /// Σ‖P⊥v‖² over the samples of the first channel.
    pub(crate) power: f64,
    /// Whether the rate is an acceleration.
    pub(crate) acceleration: bool,
}

/// Rates are averaged over this to separate motion from noise, s.
const MEAN_S: f64 = 1.0;
/// Below this unsteady motion a vehicle is stationary or flies straight, m/s or m/s².
const LEAST_UNSTEADY: f64 = 0.3;
/// 95th percentile of the length of two normal numbers.
const RAYLEIGH_95: f64 = 2.448;
/// Least ratio of the motion to the apparent motion from noise.
const ABOVE_NOISE: f64 = 1.5;

/// [`Motion::unsteady`] from the noise of a rate (m/s or m/s²) alone: white noise with the size shown by second
/// differences.
pub(crate) fn noise_of_motion(rate: &Horizontal, usual_step_s: Option<f64>) -> f64 {
    let step_s = usual_step_s.unwrap_or(MEAN_S);
    let bends = |axis: usize| -> f64 {
        let bends: Vec<f64> = rate.axes[axis].windows(3).map(|w| w[0] - 2.0 * w[1] + w[2]).collect();
        signal::robust_sigma(&bends).unwrap_or(0.0) / 6_f64.sqrt()
    };
    RAYLEIGH_95 * bends(0).max(bends(1)) * (step_s / MEAN_S).min(1.0).sqrt()
}

/// The motion at the samples of the first channel, from displacements over a second.
pub(crate) fn motion(
    first: &Horizontal,
    pieces: &[Piece],
    stretches: &[Stretch],
    delay_s: f64,
    acceleration: bool,
) -> Motion {
    let mut sizes: Vec<f64> = vec![];
    let mut power = 0.0;
    for piece in pieces {
        let (start, end) = stretches[piece.stretch][0].span();
        let inside = |t: f64| t.clamp(start, end);
        let t: Vec<f64> = piece.rows.iter().map(|&k| first.t[k] - delay_s).collect();
        let before: Vec<f64> = t.iter().map(|t| inside(t - 0.5 * MEAN_S)).collect();
        let after: Vec<f64> = t.iter().map(|t| inside(t + 0.5 * MEAN_S)).collect();
        let unsteady = AXES.map(|axis| {
            let filled = |instants: &[f64]| {
                let (mut values, mut rates) = (vec![0.0; t.len()], vec![0.0; t.len()]);
                stretches[piece.stretch][axis].fill(instants, &mut values, &mut rates);
                values
            };
            let (a, b) = (filled(&before), filled(&after));
            let mean = |k: usize| (b[k] - a[k]) / (after[k] - before[k]).max(0.1 * MEAN_S);
            without_line(&t, (0..t.len()).map(mean).collect())
        });
        power += unsteady.iter().flatten().map(|v| v * v).sum::<f64>();
        sizes.extend(unsteady[0].iter().zip(&unsteady[1]).map(|(n, e)| n.hypot(*e)));
    }
    Motion { unsteady: signal::percentile(&sizes, 0.95).unwrap_or_default(), power, acceleration }
}

/// `y` less its best-fit straight line over `t`.
fn without_line(t: &[f64], mut y: Vec<f64>) -> Vec<f64> {
    let n = t.len().max(1) as f64;
    let (tm, ym) = (t.iter().sum::<f64>() / n, y.iter().sum::<f64>() / n);
    let tt: f64 = t.iter().map(|t| (t - tm).powi(2)).sum();
    let ty: f64 = t.iter().zip(&y).map(|(t, y)| (t - tm) * (y - ym)).sum();
    let slope = if tt > 0.0 { ty / tt } else { 0.0 };
    y.iter_mut().zip(t).for_each(|(y, t)| *y -= ym + slope * (t - tm));
    y
}

/// Excitation by the motion, before any fit.
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
            moving += squares_about_a_line(&t, &v);
        }
    }
    DelayExcitation {
        samples: pieces.iter().map(|p| p.rows.len() as u64).sum(),
        // An empty sum is -0.
        duration_s: 0.0 + pieces.iter().map(|piece| piece.duration_s(first)).sum::<f64>(),
        pieces: pieces.len() as u64,
        speed_p95_mps: signal::percentile(speed, 0.95).unwrap_or_default(),
        moving_share: if all > 0.0 { moving / all } else { 0.0 },
        unexplained_share: None,
        predicted_s: None,
    }
}

/// Sum of squares of `y` about its best-fit straight line over `t`.
pub(crate) fn squares_about_a_line(t: &[f64], y: &[f64]) -> f64 {
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

/// Why this motion cannot show a delay at all: too short, or not above noise.
pub(crate) fn refuse_motion(offer: &DelayExcitation, motion: &Motion, noise: f64, speed: &[f64]) -> Option<String> {
    if offer.pieces == 0 {
        return Some(format!(
            "there is no stretch in which both can be compared: at least {SHORTEST_S} s and {LEAST_ROWS} samples without a gap are needed, better a \
             minute with turns"
        ));
    }
    if offer.duration_s < SHORTEST_S {
        return Some(format!(
            "only {:.1} s can be compared; at least {SHORTEST_S} s are needed, better a minute with turns",
            offer.duration_s
        ));
    }
    let needed = LEAST_UNSTEADY.max(ABOVE_NOISE * noise);
    if motion.unsteady >= needed {
        return None;
    }
    let (fastest, unsteady) = (signal::percentile(speed, 0.95).unwrap_or_default(), motion.unsteady);
    let unit = if motion.acceleration { "m/s²" } else { "m/s" };
    Some(if fastest < SLOW_MPS {
        format!(
            "the vehicle does not travel: 95 % of ground speeds are below {:.2} m/s, and the unsteady part of its \
             motion is {unsteady:.2} {unit}, but this noise requires at least {needed:.2} {unit}. At a standstill, \
             late and on time look alike. Fly a minute of circles at 3 m/s or more",
            fastest.max(0.01)
        )
    } else {
        format!(
            "the flight is too straight and steady: only {unsteady:.2} {unit} of its motion is neither constant nor a \
             steady change (at least {needed:.2} {unit} are needed), and a constant lag looks like an offset. Fly circles \
             or figures of eight for a minute, or change speed quickly and often"
        )
    })
}

/// Below this, noise may look like motion, m/s.
const SLOW_MPS: f64 = 1.0;
/// Target standard uncertainty of the advice, s.
const AIM_S: f64 = 0.025;
/// Least speed for which turns are advised, m/s.
const TURNS_MPS: f64 = 3.0;

/// What to fly so that the delay is known to [`AIM_S`] with the same noise: a fix in a turn at the speed U has the
/// information U²/(uncertainty of a fix)².
fn what_to_fly(known_s: f64, offer: &DelayExcitation, motion: &Motion) -> String {
    if motion.acceleration {
        return "Fly circles to the left and to the right for two minutes, and change speed between them".to_owned();
    }
    let fix_m = known_s * motion.power.sqrt();
    let rate_hz = offer.samples as f64 / offer.duration_s.max(1.0);
    let speed_mps = offer.speed_p95_mps.max(TURNS_MPS);
    let minutes = ((fix_m / (speed_mps * AIM_S)).powi(2) / rate_hz / 60.0).max(1.0);
    if minutes > LONGEST_ADVICE_MIN {
        return format!(
            "At this noise, not even an hour of circles at {speed_mps:.0} m/s would give a standard uncertainty of {:.0} \
             ms: log a position or a velocity with less noise, or fly tighter and faster turns",
            1e3 * AIM_S
        );
    }
    let straight = if offer.moving_share < STRAIGHT { "The flight is nearly straight. " } else { "" };
    format!(
        "{straight}About {:.0} min of circles or figures of eight at {speed_mps:.0} m/s would give a standard uncertainty of {:.0} \
         ms; tighter and faster turns need less",
        minutes.ceil(),
        1e3 * AIM_S
    )
}

/// Longest advised duration of circles, min.
const LONGEST_ADVICE_MIN: f64 = 60.0;

/// Σ‖P⊥v‖²/Σ‖v‖² below which a flight is called nearly straight.
const STRAIGHT: f64 = 0.05;

/// Least rate of specific force for an acceleration that can measure a delay, Hz.
const LEAST_FORCE_HZ: f64 = 10.0;
/// Least ratio of that rate to the frequency below which 95 % of the acceleration lies.
const LEAST_FORCE_RATIO: f64 = 4.0;

/// Why an acceleration is sampled too slowly to be a datum (delay network, section 3); `None` if it is not.
pub(crate) fn too_slow_for_datum(force: &Horizontal) -> Option<String> {
    let rate_hz = 1.0 / super::pieces::usual_step_s(&force.t).filter(|s| *s > 0.0)?;
    if rate_hz < LEAST_FORCE_HZ {
        return Some(format!("the IMU is logged at {rate_hz:.1} Hz, and at least {LEAST_FORCE_HZ} Hz are needed"));
    }
    // Vibration above 5 Hz is not motion that a velocity could follow.
    let below = |axis: usize| {
        let spectrum = signal::power_spectrum(&force.axes[axis], rate_hz);
        let motion = spectrum.frequency_hz.iter().zip(&spectrum.power).filter(|(f, _)| **f <= MOTION_HZ);
        let mut power: Vec<(f64, f64)> = motion.map(|(f, p)| (*f, *p)).collect();
        // The level that the upper half has throughout is noise.
        let upper: Vec<f64> = power[power.len() / 2..].iter().map(|p| p.1).collect();
        let floor = signal::median_by_selection(&upper).unwrap_or(0.0) / MEDIAN_OF_EXPONENTIAL;
        power.iter_mut().for_each(|p| p.1 = (p.1 - floor).max(0.0));
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

/// Median of a bin of white noise over its mean.
const MEDIAN_OF_EXPONENTIAL: f64 = std::f64::consts::LN_2;

/// Accelerations above this are vibration, Hz.
const MOTION_HZ: f64 = 5.0;

/// Why timestamps shared by several rows cannot show a delay; `stamps_s` is their standard uncertainty, s.
pub(crate) fn refuse_stamps(stamps_s: f64, settings: &FlightDelaySettings) -> Option<String> {
    (stamps_s > settings.worst_sigma_s).then(|| {
        let [known, limit] = against_limit(stamps_s, settings.worst_sigma_s);
        format!(
            "several rows share one timestamp, and the coarse timestamps alone make a delay uncertain by ±{known} ms \
             (standard uncertainty, limit {limit} ms). Log with a finer clock, or use the timestamps of the device \
             itself"
        )
    })
}

/// Why this fit is not a measurement, and what would make it one: `better_advice`, or more motion.
pub(crate) fn refuse_fit(
    fit: &DelayFit,
    offer: &DelayExcitation,
    motion: &Motion,
    settings: &FlightDelaySettings,
    Names { first, second }: &Names,
    better_advice: impl Fn() -> Option<String>,
) -> Option<String> {
    let advice = |known| better_advice().unwrap_or_else(|| what_to_fly(known, offer, motion));
    let known = fit.standard_uncertainty_s.max(fit.crlb_s);
    let uncertain = known.is_nan() || known > settings.worst_sigma_s;
    if !fit.converged && !uncertain {
        return Some(format!(
            "no delay stands out: the search between {first} and {second} did not converge. Either they do not belong \
             together, or noise is as large as the motion. {}",
            advice(known)
        ));
    }
    uncertain.then(|| {
        let [u, limit] = against_limit(known, settings.worst_sigma_s);
        format!("the delay would be known only to ±{u} ms (standard uncertainty, limit {limit} ms). {}", advice(known))
    })
}

/// An uncertainty and its limit, ms, with as many decimals as tell them apart.
fn against_limit(known_s: f64, limit_s: f64) -> [String; 2] {
    let of = |decimals: usize| [known_s, limit_s].map(|s| format!("{:.decimals$}", 1e3 * s));
    (0..3).map(of).find(|[known, limit]| known != limit).unwrap_or_else(|| of(3))
}

/// Step of the first search, s.
pub(crate) const SEARCH_STEP_S: f64 = 0.02;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_uncertainty_just_above_its_limit_does_not_read_as_the_limit() {
        assert_eq!(against_limit(0.061, 0.05), ["61", "50"]);
        assert_eq!(against_limit(0.0503, 0.05), ["50.3", "50.0"]);
        assert_eq!(against_limit(0.05001, 0.05), ["50.01", "50.00"]);
    }

    #[test]
    fn channels_without_overlap_are_not_reported_as_minus_zero_seconds() {
        let nothing = excitation(&Horizontal::default(), &[], &[], 0.0, &[0.0]);
        assert_eq!(format!("{:.1}", nothing.duration_s), "0.0");
        let motion = Motion { unsteady: 0.0, power: 0.0, acceleration: false };
        let refusal = refuse_motion(&nothing, &motion, 0.0, &[0.0]).unwrap();
        assert!(refusal.starts_with("there is no stretch in which both"), "{refusal}");
    }
}
