//! Effect of the encoder's steps on the delays, through the reference.
//!
//! All components of a channel share the error of the bar's motion, so their number does not average it away. The noise
//! of a fit is each component's own and does not include it. The smoother is linear in the encoder: its response to the
//! encoder's noise is drawn at random, and propagated through slope and fit of every channel.

use crate::motion::Motion;
use crate::overlay::rms;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;
use signal::{ComponentFit, DelayFit, DelayResponse, GainResponse, Measurement, Reference, SmoothedMotion};
use std::f64::consts::TAU;

/// Number of draws: the uncertainty of a delay is then known to 1/√(2·16) = 18 %.
const DRAWS: usize = 16;
/// Number of phases of the counts for which the motion is measured again.
const AGAIN: usize = 8;
const SEED: u64 = 20_101_025;

/// Draws of the error of the smoothed motion.
pub(crate) struct ReferenceErrors {
    draws: Vec<SmoothedMotion>,
    /// The motion measured again with other phases of the counts, and the motion itself.
    again: Vec<SmoothedMotion>,
    once: SmoothedMotion,
    sign: f64,
}

/// Sensitivity of a component of a channel to an error of the motion.
#[derive(Clone, Copy)]
pub(crate) struct Sensitivity<'a> {
    /// The slopes are evenly spaced over this span, s.
    pub(crate) span: (f64, f64),
    /// Derivatives by the bar's angle, rate and acceleration.
    pub(crate) slope: &'a [[f64; 3]],
}

impl Sensitivity<'_> {
    /// The slopes nearest to `t`.
    fn at(&self, t: f64) -> Option<&[f64; 3]> {
        let (first, last) = self.span;
        let place = (t - first) / (last - first) * self.slope.len().saturating_sub(1) as f64;
        self.slope.get(place.round().max(0.0) as usize)
    }
}

impl ReferenceErrors {
    /// For the motion as oriented: steps of ±σ with random signs, σ² = LSB²/12, one for each held reading, through the
    /// same smoother.
    pub(crate) fn of(motion: &Motion) -> ReferenceErrors {
        let mut random = Pcg64::seed_from_u64(SEED);
        let sigma = motion.encoder().variance().sqrt();
        let samples = motion.encoder().t_s.len();
        let held = motion.held();
        let draws = (0..DRAWS).filter_map(|_| {
            let mut sign = sigma;
            let noise: Vec<f64> = (0..samples)
                .map(|k| {
                    if k % held == 0 {
                        sign = if random.next_u64() >> 63 == 0 { sigma } else { -sigma };
                    }
                    sign
                })
                .collect();
            motion.smoothed_as_the_encoder(&noise)
        });
        let again = (0..AGAIN).filter_map(|k| motion.measured_again(k as f64 / AGAIN as f64));
        ReferenceErrors {
            draws: draws.collect(),
            again: again.collect(),
            once: motion.smoothed().clone(),
            sign: motion.sign(),
        }
    }

    /// Standard uncertainty of the delay of `fit` from the reference alone, s; `sensitivities`: one per component.
    pub(crate) fn of_delay(
        &self,
        measurements: &[Measurement<'_>],
        fit: &DelayFit,
        sensitivities: &[Sensitivity<'_>],
    ) -> f64 {
        let Some(response) = DelayResponse::of(measurements, fit) else { return 0.0 };
        let shift = |draw: &SmoothedMotion| {
            let mut errors = self.errors(draw, fit, sensitivities);
            for (of_component, c) in errors.iter_mut().zip(&fit.components) {
                of_component.iter_mut().for_each(|error| *error *= c.gain.value);
            }
            response.shift_s(&errors)
        };
        rms(self.draws.iter().filter_map(shift))
    }

    /// Relative standard uncertainty of the gain of each component from the reference alone.
    ///
    /// An error that follows the reference acts as a gain. Steps are not random here: at each reversal of the swing the
    /// count is constant for long, and the smoother flattens the remainder. Therefore the motion is quantised and
    /// smoothed again with other phases of the counts, and the effect on the gain is its uncertainty.
    pub(crate) fn of_gains(
        &self,
        measurements: &[Measurement<'_>],
        fit: &DelayFit,
        sensitivities: &[Sensitivity<'_>],
    ) -> Vec<f64> {
        let once = self.errors(&self.once, fit, sensitivities);
        let again: Vec<Vec<Vec<f64>>> = self.again.iter().map(|a| self.errors(a, fit, sensitivities)).collect();
        let of_component = |k: usize| {
            let Some(response) = GainResponse::of(&measurements[k], &fit.components[k], fit.delay_s) else {
                return 0.0;
            };
            let share = |again: &Vec<Vec<f64>>| {
                let moved: Vec<f64> = again[k].iter().zip(&once[k]).map(|(again, once)| again - once).collect();
                response.shift(&moved)
            };
            rms(again.iter().filter_map(share))
        };
        (0..fit.components.len()).map(of_component).collect()
    }

    /// Frequency of the motion that the gain of one component stands for, Hz: a bar that bends raises the gain as if it
    /// swung at that frequency alone.
    ///
    /// A bar that bends turns by ξ − ε ξ″ with a small ε (design note 1.6, below resonance). The increase of the gain
    /// over ε is a mean ω² of the motion, weighted as the fit with its noise weights it.
    pub(crate) fn frequency_of_gain_hz(
        &self,
        measurement: &Measurement<'_>,
        fit: &DelayFit,
        component: &ComponentFit,
        by: &Sensitivity<'_>,
    ) -> Option<f64> {
        let response = GainResponse::of(measurement, component, fit.delay_s)?;
        let bent = |t: &f64| {
            let instant = t - fit.delay_s;
            let (slope, state) = (by.at(instant), self.once.at(instant));
            let (Some(slope), Some([_, _, acceleration, jerk])) = (slope, state) else { return 0.0 };
            -self.sign * (slope[0] * acceleration + slope[1] * jerk)
        };
        let omega2 = response.shift(&component.t_used.iter().map(bent).collect::<Vec<f64>>())?;
        (omega2 > 0.0).then(|| omega2.sqrt() / TAU)
    }

    /// Error of the reference of each component at the true instants of its used rows, where `draw` is the error of the
    /// motion.
    fn errors(&self, draw: &SmoothedMotion, fit: &DelayFit, sensitivities: &[Sensitivity<'_>]) -> Vec<Vec<f64>> {
        let mut t_used: &[f64] = &[];
        let mut states: Vec<Option<[f64; 4]>> = vec![];
        let mut errors = vec![];
        for (by, c) in sensitivities.iter().zip(&fit.components) {
            // The components of a channel usually have the same rows.
            if c.t_used != t_used {
                t_used = &c.t_used;
                states = t_used.iter().map(|t| draw.at(t - fit.delay_s)).collect();
            }
            let of_row = |(t, state): (&f64, &Option<[f64; 4]>)| self.error(by, t - fit.delay_s, *state);
            errors.push(t_used.iter().zip(&states).map(of_row).collect());
        }
        errors
    }

    /// Error of a reference at `t` from the `error` of the motion there; 0 outside of the motion.
    fn error(&self, by: &Sensitivity<'_>, t: f64, error: Option<[f64; 4]>) -> f64 {
        let (Some(slope), Some(error)) = (by.at(t), error) else { return 0.0 };
        self.sign * (slope[0] * error[0] + slope[1] * error[1] + slope[2] * error[2])
    }
}

/// Standard uncertainty of a delay including that of its reference. The noise of the fit treats the error of the
/// reference as independent between `components`: the amount that this averages away is added back.
pub(crate) fn with_reference(fit_s: f64, reference_s: f64, components: usize) -> f64 {
    let averaged = 1.0 - 1.0 / components.max(1) as f64;
    fit_s.hypot(averaged.sqrt() * reference_s).max(reference_s)
}

/// Sensitivity of a component through its reference.
pub(crate) fn sensitivity<'a>(reference: &dyn Reference, slope: &'a [[f64; 3]]) -> Sensitivity<'a> {
    Sensitivity { span: reference.span(), slope }
}
