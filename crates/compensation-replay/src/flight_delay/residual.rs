//! How late tracks are against the integral of one velocity: the fit of [`super::measure_delays`] and nothing around it,
//! for outputs of compensators.

use super::FlightDelaySettings;
use super::fit::fit_shared;
use super::gate::{self, SEARCH_STEP_S};
use super::local::Prepared;
use super::pieces::{self, Names, Piece};
use crate::input::{AXES, Horizontal};
use flight::{Clock, Notices};
use record::DelayOrigin;
use signal::{DelaySettings, Gain, Measurement, NoiseModel, NoiseRule};

/// What the fit says of a track.
#[derive(Debug, Clone)]
pub(crate) struct TrackFit {
    /// s; positive is late against the velocity.
    pub(crate) delay_s: f64,
    pub(crate) standard_uncertainty_s: f64,
    pub(crate) interval_95_s: [f64; 2],
    /// Of both axes.
    pub(crate) samples: u64,
    /// Track less integral, m/s: north and east, with standard uncertainty; mean over the pieces by their samples.
    pub(crate) drift: [(f64, f64); 2],
    /// Of the longest piece.
    pub(crate) noise: [NoiseModel; 2],
    /// Length of that piece, s.
    pub(crate) span_s: f64,
}

/// Most speeds that are looked at.
const SPEEDS: usize = 6_000;
/// Half the width of the delays that are looked at, s.
const SEARCH_S: f64 = 0.6;

/// Fits tracks one after the other against the same velocity (m/s).
pub(crate) struct TrackFitter {
    prepared: Prepared,
}

impl TrackFitter {
    pub(crate) fn new(velocity: &Horizontal) -> TrackFitter {
        let second = pieces::without_spikes(velocity, &mut None, "velocity", &mut Notices::new());
        let second = second.unwrap_or_else(|| velocity.clone());
        // Speed tells rest from motion only.
        let every = second.t.len().div_ceil(SPEEDS).max(1);
        let speeds = second.axes[0].iter().zip(&second.axes[1]).map(|(n, e)| n.hypot(*e)).step_by(every);
        let speed = (second.t.iter().copied().step_by(every).collect(), speeds.collect());
        // Only differences of times matter here, and tracks are compared by the same stamps.
        let origin = DelayOrigin { origin_ns: 0, clock: Clock::Elapsed };
        let first = Horizontal::default();
        TrackFitter {
            prepared: Prepared { origin, first, second, integrate: true, body: None, speed, one_in: 1, stamps_s: 0.0 },
        }
    }

    /// The delay of `track` (m), looked for about `expected_s`, or why it cannot be told.
    pub(crate) fn fit(&mut self, track: Horizontal, expected_s: f64) -> Result<TrackFit, String> {
        let search_s = (expected_s - SEARCH_S, expected_s + SEARCH_S);
        let settings = FlightDelaySettings { search_s, ..FlightDelaySettings::default() };
        self.prepared.first = track;
        let prepared = &self.prepared;
        let fixes = prepared.first.t.len();
        if fixes < super::local::LEAST_SAMPLES {
            return Err(format!("only {fixes} fixes; at least {} are needed", super::local::LEAST_SAMPLES));
        }
        let names = Names { first: "the output", second: "the velocity" };
        let step_s = pieces::usual_step_s(&prepared.second.t);
        let ranges = pieces::stretches(&prepared.second.t, pieces::longest_gap(step_s, &settings));
        let stretches = pieces::references(&prepared.second, &ranges, true, None);
        let coarse = super::coarse::coarse_delay(&prepared.first, &stretches, search_s)
            .ok_or("output and velocity do not overlap for long enough at any delay searched")?
            .delay_s;
        // What is masked was said where the delays of the flight are measured.
        let cut = pieces::pieces(prepared, &stretches, coarse, &names, &mut Notices::new());
        let mut offer = gate::excitation(&prepared.first, &cut, &stretches, coarse, &prepared.speed.1);
        let motion = gate::motion(&prepared.first, &cut, &stretches, coarse, false);
        let noise = gate::noise_of_motion(&prepared.second, step_s);
        if let Some(reason) = gate::refuse_motion(&offer, &motion, noise, &prepared.speed.1) {
            return Err(reason);
        }
        let components = components(&prepared.first, &cut);
        let reference = |c: &Component| &*stretches[c.stretch][c.axis];
        let measurements: Vec<Measurement> = components
            .iter()
            .map(|c| Measurement { t: &c.t, y: &c.y, reference: reference(c), gain: Gain::Fixed(1.0), drift: true })
            .collect();
        let delay_settings = DelaySettings {
            search_s,
            search_step_s: SEARCH_STEP_S,
            noise: NoiseRule::WanderAndWhite,
            skew: false,
            robust: true,
        };
        let fit = fit_shared(&measurements, &delay_settings, super::fit::walk_of(&prepared.second, step_s))
            .map_err(|e| e.to_string())?;
        offer.predicted_s = Some(fit.crlb_s);
        offer.unexplained_share = gate::unexplained_share(&prepared.first, &cut, &stretches, fit.delay_s);
        if let Some(reason) = gate::refuse_fit(&fit, &offer, &motion, &settings, [names.first, names.second]) {
            return Err(reason);
        }
        let of_axis = |axis: usize| fit.components.iter().skip(axis).step_by(2);
        let longest = |axis: usize| of_axis(axis).max_by_key(|c| c.t_used.len());
        Ok(TrackFit {
            delay_s: fit.delay_s,
            standard_uncertainty_s: fit.standard_uncertainty_s,
            interval_95_s: fit.interval(0.95),
            samples: fit.components.iter().map(|c| c.t_used.len() as u64).sum(),
            drift: AXES.map(|axis| mean_drift(of_axis(axis))),
            span_s: longest(0).map_or(0.0, |c| c.t_used.last().unwrap_or(&0.0) - c.t_used.first().unwrap_or(&0.0)),
            noise: AXES.map(|axis| longest(axis).map_or(NONE, |c| c.noise)),
        })
    }
}

const NONE: NoiseModel = NoiseModel { wander_std: 0.0, time_constant_s: 1.0, white_std: 0.0 };

struct Component {
    t: Vec<f64>,
    /// Less its mean, which the offset takes up.
    y: Vec<f64>,
    stretch: usize,
    axis: usize,
}

/// North and east of each piece, one after the other.
fn components(track: &Horizontal, pieces: &[Piece]) -> Vec<Component> {
    let component = |piece: &Piece, axis: usize| {
        let of = |x: &[f64]| piece.rows.iter().map(|&k| x[k]).collect::<Vec<f64>>();
        let mut y = of(&track.axes[axis]);
        let mean = y.iter().sum::<f64>() / y.len().max(1) as f64;
        y.iter_mut().for_each(|y| *y -= mean);
        Component { t: of(&track.t), y, stretch: piece.stretch, axis }
    };
    pieces.iter().flat_map(|p| AXES.map(|axis| component(p, axis))).collect()
}

/// Mean of the drifts by samples, with its standard uncertainty.
fn mean_drift<'a>(components: impl Iterator<Item = &'a signal::ComponentFit>) -> (f64, f64) {
    let (mut sum, mut variance, mut count) = (0.0, 0.0, 0.0);
    for c in components {
        let n = c.t_used.len() as f64;
        if let Some(d) = c.drift {
            sum += n * d.value;
            variance += (n * d.standard_uncertainty).powi(2);
            count += n;
        }
    }
    if count > 0.0 { (sum / count, variance.sqrt() / count) } else { (0.0, 0.0) }
}
