//! The smoother on shifted data: the best possible result.

use crate::compensator::AxisSamples;
use crate::compensator::white_jerk::{Belief, KalmanSettings, transition};
use nalgebra::{Matrix3, Vector3};

/// Position of the smoother at one row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Smoothed {
    /// Position, m.
    pub position: f64,
    /// Its standard deviation, m, if the settings are correct.
    pub sigma: f64,
}

/// A measurement or a request at an instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Event {
    Position(f64),
    Velocity(f64),
    Row(usize),
}

/// Samples at the instants at which they were true, and rows, in order of time.
pub(crate) fn events(
    samples: &AxisSamples<'_>,
    delay_s: f64,
    settings: &KalmanSettings,
    rows: &[f64],
) -> Vec<(f64, Event)> {
    let positions = samples.position_t.iter().zip(samples.position).map(|(t, p)| (t - delay_s, Event::Position(*p)));
    let late = settings.velocity_delay_s;
    let velocities = samples.velocity_t.iter().zip(samples.velocity).map(|(t, v)| (t - late, Event::Velocity(*v)));
    let rows = rows.iter().enumerate().map(|(k, t)| (*t, Event::Row(k)));
    let mut all: Vec<(f64, Event)> = positions.chain(velocities).chain(rows).collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    all
}

/// The state at the first position of the events, and the number of the next event.
pub(crate) fn first_belief(events: &[(f64, Event)], settings: &KalmanSettings) -> Option<(usize, Belief)> {
    let (at, t, p) = events.iter().enumerate().find_map(|(k, (t, e))| match e {
        Event::Position(p) => Some((k, *t, *p)),
        _ => None,
    })?;
    let velocity = |(t, e): &(f64, Event)| if let Event::Velocity(v) = e { Some((*t, *v)) } else { None };
    let before = events[..at].iter().rev().find_map(velocity);
    let after = events[at..].iter().find_map(velocity);
    let nearest = [before, after].into_iter().flatten().min_by(|a, b| (a.0 - t).abs().total_cmp(&(b.0 - t).abs()))?;
    Some((at + 1, Belief::first(t, p, nearest.1, (nearest.0 - t).abs(), settings)))
}

struct Stage {
    predicted: Belief,
    filtered: Belief,
    row: Option<usize>,
}

/// Rauch–Tung–Striebel smoother (1965) of position, velocity and acceleration under white jerk, with every position at
/// the instant it was true. It uses the whole record, before and after. No compensator can be better under its model,
/// so it is shown as the bound for causal ones.
///
/// One entry per row. `None` before the instant of the first position, and for all rows without positions or velocities
/// or with settings that are not positive.
#[must_use]
pub fn rts_smooth(
    samples: &AxisSamples<'_>,
    delay_s: f64,
    settings: &KalmanSettings,
    rows: &[f64],
) -> Vec<Option<Smoothed>> {
    let mut out = vec![None; rows.len()];
    let events = events(samples, delay_s, settings, rows);
    let Some((next, first)) = first_belief(&events, settings).filter(|_| settings.is_sound()) else { return out };
    let stages = forward(&events[next..], first, settings);
    let Some(last) = stages.last() else { return out };
    let (mut mean, mut covariance) = (last.filtered.mean, last.filtered.covariance);
    for k in (0..stages.len()).rev() {
        let stage = &stages[k];
        if let Some(later) = stages.get(k + 1) {
            (mean, covariance) = back(&stage.filtered, &later.predicted, mean, covariance);
        }
        if let Some(row) = stage.row {
            out[row] = Some(Smoothed { position: mean[0], sigma: covariance[(0, 0)].max(0.0).sqrt() });
        }
    }
    out
}

fn forward(events: &[(f64, Event)], first: Belief, settings: &KalmanSettings) -> Vec<Stage> {
    let mut belief = first;
    let mut stages = vec![Stage { predicted: first, filtered: first, row: None }];
    for (t, event) in events {
        belief.predict(*t, settings.jerk_density);
        let predicted = belief;
        let mut row = None;
        match event {
            Event::Position(p) => drop(belief.update(0, *p, settings.position_sigma_m)),
            Event::Velocity(v) => drop(belief.update(1, *v, settings.velocity_sigma_mps)),
            Event::Row(k) => row = Some(*k),
        }
        stages.push(Stage { predicted, filtered: belief, row });
    }
    stages
}

/// One step backwards in time, from the smoothed state of the later stage.
fn back(
    filtered: &Belief,
    predicted: &Belief,
    mean: Vector3<f64>,
    covariance: Matrix3<f64>,
) -> (Vector3<f64>, Matrix3<f64>) {
    let h = predicted.t - filtered.t;
    if h == 0.0 {
        return (mean, covariance);
    }
    let forward = transition(h) * filtered.covariance;
    let Some(inverse) = predicted.covariance.cholesky() else {
        // The later stage adds no information.
        return (filtered.mean, filtered.covariance);
    };
    let gain = inverse.solve(&forward).transpose();
    let smoothed = filtered.covariance + gain * (covariance - predicted.covariance) * gain.transpose();
    (filtered.mean + gain * (mean - predicted.mean), (smoothed + smoothed.transpose()) * 0.5)
}
