//! Flights of table 5.7 as bare samples of two axes.

// Shared with the example `table_5_7`, which uses more of it than the tests.
#![allow(dead_code)]

use compensation_replay::{AxisSamples, CompensatorKind, CompensatorOptions, VelocityView};
use record::StartRule;
use simulate::{FlightSettings, LikeCase, Samples, SensorSettings, simulate};

/// Samples north and east, and the truth at 100 Hz rows from 1 s on, as in the note's script.
pub struct LikeFlight {
    pub rows: Vec<f64>,
    truth: [Vec<f64>; 2],
    velocity_t: Vec<f64>,
    velocity: [Vec<f64>; 2],
    position_t: Vec<f64>,
    position: [Vec<f64>; 2],
}

impl LikeFlight {
    pub fn of(case: LikeCase, seed: u64) -> LikeFlight {
        LikeFlight::fly(&case.settings(seed))
    }

    /// The circuit of a case with other rates and noise: position Hz, m, velocity Hz, m/s.
    pub fn of_rates(case: LikeCase, seed: u64, sensors: (f64, f64, f64, f64), duration_s: f64) -> LikeFlight {
        let usual = case.settings(seed);
        LikeFlight::fly(&FlightSettings {
            position: SensorSettings { rate_hz: sensors.0, white_std: sensors.1, ..usual.position.clone() },
            velocity: SensorSettings { rate_hz: sensors.2, white_std: sensors.3, ..usual.velocity.clone() },
            duration_s,
            ..usual
        })
    }

    fn fly(settings: &FlightSettings) -> LikeFlight {
        let flight = simulate(settings).unwrap();
        let quiet = SensorSettings { white_std: 0.0, ..settings.velocity.clone() };
        let noisy = settings.velocity.white_std > 0.0;
        let clean = noisy.then(|| simulate(&FlightSettings { velocity: quiet, ..settings.clone() }).unwrap());
        let clean = clean.as_ref().unwrap_or(&flight);
        let rows: Vec<f64> = (100..(settings.duration_s * 100.0) as usize - 100).map(|k| k as f64 * 0.01).collect();
        let axis = |samples: &Samples, k: usize| samples.ned.iter().map(|ned| ned[k]).collect::<Vec<f64>>();
        // In the origin's frame instead of the aircraft's own, so that only compensators cause an error.
        let velocity = [0, 1].map(|k| {
            let noise = flight.velocity.ned.iter().zip(&clean.velocity.ned).map(|(a, b)| a[k] - b[k]);
            flight.velocity.at_s.iter().zip(noise).map(|(t, noise)| flight.truth.at(*t).velocity[k] + noise).collect()
        });
        LikeFlight {
            truth: [0, 1].map(|k| rows.iter().map(|t| flight.truth.at(*t).position[k]).collect()),
            rows,
            velocity_t: flight.velocity.at_s.clone(),
            velocity,
            position_t: flight.position.at_s.clone(),
            position: [0, 1].map(|k| axis(&flight.position, k)),
        }
    }

    pub fn samples(&self, axis: usize) -> AxisSamples<'_> {
        AxisSamples {
            velocity_t: &self.velocity_t,
            velocity: &self.velocity[axis],
            position_t: &self.position_t,
            position: &self.position[axis],
        }
    }

    /// Velocity at every row as a loop at 100 Hz sees it: the newest sample.
    pub fn held_velocity(&self, axis: usize) -> Vec<f64> {
        self.rows.iter().map(|t| self.velocity[axis][self.velocity_t.partition_point(|s| s <= t) - 1]).collect()
    }

    /// 2-D rms error, m, without the first 5 s and the last second of the rows, as in the note.
    pub fn rms_of(&self, estimate: impl Fn(usize) -> Vec<Option<f64>>) -> f64 {
        let counted = 500..self.rows.len() - 100;
        let errors = [0, 1].map(|axis| {
            let estimate = estimate(axis);
            counted.clone().map(|k| (estimate[k].unwrap() - self.truth[axis][k]).powi(2)).sum::<f64>()
        });
        (errors.iter().sum::<f64>() / counted.len() as f64).sqrt()
    }

    pub fn rms(&self, kind: CompensatorKind, options: &CompensatorOptions, view: VelocityView) -> f64 {
        self.rms_of(|axis| {
            let replayed = kind.replay(options, &self.samples(axis), StartRule::Warm, view, &self.rows).unwrap();
            assert_eq!(replayed.refused, 0, "{:?}", replayed.first_refusal);
            replayed.output
        })
    }

    /// The newest position, held.
    pub fn rms_raw(&self) -> f64 {
        self.rms_of(|axis| {
            let newest = |t: &f64| self.position_t.partition_point(|s| s <= t) - 1;
            self.rows.iter().map(|t| Some(self.position[axis][newest(t)])).collect()
        })
    }

    /// A compensator in a loop at the rows' rate, on held inputs.
    pub fn rms_on_held_inputs(&self, kind: CompensatorKind, options: &CompensatorOptions) -> f64 {
        self.rms_of(|axis| {
            let held = self.held_velocity(axis);
            let samples = AxisSamples { velocity_t: &self.rows, velocity: &held, ..self.samples(axis) };
            kind.replay(options, &samples, StartRule::Warm, VelocityView::UpToNow, &self.rows).unwrap().output
        })
    }
}
