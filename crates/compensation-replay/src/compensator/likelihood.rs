//! Noise and agility of a flight, estimated from the flight.

use crate::compensator::AxisSamples;
use crate::compensator::rts::{Event, events, first_belief};
use crate::compensator::white_jerk::KalmanSettings;

/// Innovations that are skipped while the filter settles.
const SETTLING: usize = 10;

/// Range of log₁₀ of jerk density, position sigma and velocity sigma.
const RANGE: [(f64, f64); 3] = [(-6.0, 8.0), (-4.0, 3.0), (-4.0, 2.0)];

/// Start of the search: 10 m²/s⁵, 0.3 m, 0.1 m/s.
const START: [f64; 3] = [1.0, -0.5, -1.0];

/// Jerk density and white noise of position and velocity by maximum likelihood of the innovations, common to all axes
/// (compass search over the logarithms, from 1 decade down to 2 %).
///
/// Simulated noise is recovered within its sampling error (test `maximum_likelihood_recovers_the_simulated_noise`), and
/// the filter is then within 4 % of a tuned one (example `table_5_7`). Without noise the search ends at its lower
/// bounds, 1e-4 m and 1e-4 m/s.
///
/// The model has white noise only: a wandering position looks like more agile motion. `None` if no axis has more than
/// 10 samples after its first position.
#[must_use]
pub fn fit_kalman(axes: &[AxisSamples<'_>], delay_s: f64, velocity_delay_s: f64) -> Option<KalmanSettings> {
    let settings = |x: [f64; 3]| KalmanSettings {
        jerk_density: 10f64.powf(x[0]),
        position_sigma_m: 10f64.powf(x[1]),
        velocity_sigma_mps: 10f64.powf(x[2]),
        velocity_delay_s,
    };
    let all: Vec<Vec<(f64, Event)>> = axes.iter().map(|a| events(a, delay_s, &settings(START), &[])).collect();
    let cost = |x: [f64; 3]| -> Option<f64> {
        let terms: Vec<f64> = all.iter().filter_map(|events| surprise(events, &settings(x))).collect();
        (!terms.is_empty()).then(|| terms.iter().sum())
    };
    let (mut at, mut value) = (START, cost(START)?);
    let mut step = 1.0;
    while step > 0.008 {
        let mut better = false;
        for (axis, sign) in (0..3).flat_map(|axis| [(axis, 1.0), (axis, -1.0)]) {
            let mut trial = at;
            trial[axis] = (trial[axis] + sign * step).clamp(RANGE[axis].0, RANGE[axis].1);
            if trial == at {
                continue;
            }
            if let Some(lower) = cost(trial).filter(|c| *c < value) {
                (at, value, better) = (trial, lower, true);
            }
        }
        if !better {
            step *= 0.5;
        }
    }
    Some(settings(at))
}

/// `½ Σ (ln S + e²/S)` over the innovations.
fn surprise(events: &[(f64, Event)], settings: &KalmanSettings) -> Option<f64> {
    let (next, mut belief) = first_belief(events, settings)?;
    let mut sum = 0.0;
    let mut count = 0;
    for (t, event) in &events[next..] {
        belief.predict(*t, settings.jerk_density);
        let (innovation, variance) = match event {
            Event::Position(p) => belief.update(0, *p, settings.position_sigma_m),
            Event::Velocity(v) => belief.update(1, *v, settings.velocity_sigma_mps),
            Event::Row(_) => continue,
        };
        count += 1;
        if count > SETTLING {
            sum += 0.5 * (variance.ln() + innovation * innovation / variance);
        }
    }
    (count > SETTLING).then_some(sum)
}
