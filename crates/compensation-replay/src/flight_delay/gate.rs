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
            let v = t.iter().map(|t| stretches[piece.stretch][axis].value_and_rate(t - delay_s).1).collect::<Vec<_>>();
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

fn percentile(values: &[f64], share: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    signal::percentile_of_sorted(&sorted, share).unwrap_or(0.0)
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

/// Why this motion cannot show a delay, and what would.
pub(crate) fn refuse_motion(offer: &DelayExcitation, speed: &[f64], settings: &FlightDelaySettings) -> Option<String> {
    if offer.duration_s < SHORTEST_S {
        return Some(format!(
            "only {:.1} s can be compared; at least {SHORTEST_S} s are needed, better a minute with turns",
            offer.duration_s
        ));
    }
    let fastest = percentile(speed, 0.99);
    if fastest < settings.least_speed_mps {
        return Some(format!(
            "the vehicle does not travel: 99 % of ground speeds are below {fastest:.2} m/s (limit {} m/s); standing \
             still, late and on time look alike. Fly a minute of turns",
            settings.least_speed_mps
        ));
    }
    if offer.moving_share < settings.least_moving_share {
        return Some(format!(
            "the flight is too straight and steady: {:.1} % of the squared velocity is neither constant nor a steady \
             change (at least {:.0} % are needed), and a constant lag looks like an offset. Fly circles or figures of \
             eight for a minute, or change speed quickly and often",
            100.0 * offer.moving_share,
            100.0 * settings.least_moving_share
        ));
    }
    None
}

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
    let (from, to) = settings.search_s;
    let edge = 2.0 * SEARCH_STEP_S;
    if fit.delay_s < from + edge || fit.delay_s > to - edge {
        return Some(format!(
            "the best delay, {:.3} s, is at the edge of what was searched ({from} to {to} s): search wider, or check the \
             clocks of both",
            fit.delay_s
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
