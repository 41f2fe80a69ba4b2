//! Lateness of tracks against the integral of one velocity, for outputs of compensators: only the fit of
//! [`super::measure_delays`], without its checks.

use super::FlightDelaySettings;
use super::coarse::coarse_delay;
use super::fit::{Record, fit_shared, walk_of};
use super::local::{LEAST_SAMPLES, Prepared};
use super::measure::{about, settings_about};
use super::pieces::{self, Names};
use super::{foreign, gate};
use crate::horizontal::{AXES, Horizontal};
use flight::{Clock, Notices};
use record::DelayOrigin;
use signal::{DelayFit, NoiseModel};

/// Result of the fit of a track.
#[derive(Debug, Clone)]
pub struct TrackFit {
    /// Delay, s; positive is late against the velocity.
    pub delay_s: f64,
    /// Standard uncertainty of the delay, s.
    pub standard_uncertainty_s: f64,
    /// 95 % interval of the delay, s.
    pub interval_95_s: [f64; 2],
    /// Samples of both axes.
    pub samples: u64,
    /// Track less integral, m/s: north and east, with standard uncertainty; mean over the pieces by their samples.
    pub drift: [(f64, f64); 2],
    /// Noise of the longest piece.
    pub noise: [NoiseModel; 2],
    /// Length of that piece, s.
    pub span_s: f64,
}

/// Maximum number of speeds.
const SPEEDS: usize = 6_000;

/// Fits several tracks in turn against the same velocity (m/s).
pub struct TrackFitter {
    prepared: Prepared,
}

impl TrackFitter {
    /// For tracks that are compared with `velocity`, m/s.
    pub fn new(velocity: &Horizontal) -> TrackFitter {
        let second = pieces::without_spikes(velocity, &mut None, "velocity", &mut Notices::new());
        let second = second.unwrap_or_else(|| velocity.clone());
        // Speed is only needed to separate rest from motion.
        let every = second.t.len().div_ceil(SPEEDS).max(1);
        let speeds = second.axes[0].iter().zip(&second.axes[1]).map(|(n, e)| n.hypot(*e)).step_by(every);
        let speed = (second.t.iter().copied().step_by(every).collect(), speeds.collect());
        // Only time differences matter here, and tracks are compared on the same timestamps.
        let origin = DelayOrigin { origin_ns: 0, clock: Clock::Elapsed };
        let first = Horizontal::default();
        TrackFitter {
            prepared: Prepared { origin, first, second, integrate: true, body: None, speed, one_in: 1, stamps_s: 0.0 },
        }
    }

    /// The delay of `track` (m), searched around `expected_s`.
    ///
    /// # Errors
    /// Why it cannot be measured: too few fixes, no overlap with the velocity, or no fit.
    pub fn fit(&mut self, track: Horizontal, expected_s: f64) -> Result<TrackFit, String> {
        let search_s = about(expected_s);
        let settings = FlightDelaySettings { search_s, ..FlightDelaySettings::default() };
        self.prepared.first = track;
        let prepared = &self.prepared;
        let fixes = prepared.first.t.len();
        if fixes < LEAST_SAMPLES {
            return Err(format!("only {fixes} fixes; at least {LEAST_SAMPLES} are needed"));
        }
        let names = Names { first: "the output", second: "the velocity" };
        let step_s = pieces::usual_step_s(&prepared.second.t);
        let ranges = pieces::stretches(&prepared.second.t, pieces::longest_gap(step_s, &settings));
        let stretches = pieces::references(&prepared.second, &ranges, true, None);
        let coarse = coarse_delay(&prepared.first, &stretches, search_s)
            .ok_or("output and velocity do not overlap for long enough at any delay searched")?
            .delay_s;
        // Masking was already reported when the delays of the flight were measured.
        let cut = pieces::pieces(prepared, &stretches, coarse, &names, &mut Notices::new());
        let mut offer = gate::excitation(&prepared.first, &cut, &stretches, coarse, &prepared.speed.1);
        let motion = gate::motion(&prepared.first, &cut, &stretches, coarse, false);
        let noise = gate::noise_of_motion(&prepared.second, step_s);
        if let Some(reason) = gate::refuse_motion(&offer, &motion, noise, &prepared.speed.1) {
            return Err(reason);
        }
        let record = Record::of(prepared, &cut, &stretches);
        let walk = walk_of(&prepared.second, step_s);
        let fit = fit_shared(&record.measurements(), &settings_about(expected_s), walk).map_err(|e| e.to_string())?;
        offer.predicted_s = Some(fit.crlb_s);
        let compared =
            foreign::Compared { first: &prepared.first, pieces: &cut, stretches: &stretches, delay_s: fit.delay_s };
        let refusal = compared.refusal(compared.unexplained_share(), &names);
        if let Some(reason) = refusal.or_else(|| gate::refuse_fit(&fit, &offer, &motion, &settings, &names, || None)) {
            return Err(reason);
        }
        Ok(TrackFit::of(&fit))
    }
}

impl TrackFit {
    fn of(fit: &DelayFit) -> TrackFit {
        let of_axis = |axis: usize| fit.components.iter().skip(axis).step_by(2);
        let longest = |axis: usize| of_axis(axis).max_by_key(|c| c.t_used.len());
        TrackFit {
            delay_s: fit.delay_s,
            standard_uncertainty_s: fit.standard_uncertainty_s,
            interval_95_s: fit.interval(0.95),
            samples: fit.components.iter().map(|c| c.t_used.len() as u64).sum(),
            drift: AXES.map(|axis| mean_drift(of_axis(axis))),
            span_s: longest(0).map_or(0.0, |c| c.t_used.last().unwrap_or(&0.0) - c.t_used.first().unwrap_or(&0.0)),
            noise: AXES.map(|axis| longest(axis).map_or(NONE, |c| c.noise)),
        }
    }
}

const NONE: NoiseModel = NoiseModel { wander_std: 0.0, time_constant_s: 1.0, white_std: 0.0 };

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
