//! Position with gain 1, plus the displacement that a filter computes from velocity.

use crate::compensator::{Compensator, FeedError, POSITION, VELOCITY, check};
use record::StartRule;
use std::fmt::Debug;

/// A filter from velocity to the displacement during the delay.
pub trait VelocityFilter: Debug + Clone + Send {
    /// The delay it models, s.
    fn delay_s(&self) -> f64;

    /// Takes the first velocity, m/s. Cold: a ramp from zero over `step_s`; else as if it had always been flown.
    fn start(&mut self, velocity: f64, rule: StartRule, step_s: f64);

    /// Takes the next velocity, m/s, any `h > 0` seconds after the last; returns the displacement, m.
    fn step(&mut self, h: f64, velocity: f64) -> f64;

    /// The displacement after the last step, m.
    fn displacement(&self) -> f64;
}

/// A [`VelocityFilter`] as a [`Compensator`]: `x_est = newest position + displacement at the newest velocity`.
///
/// Between samples the output is held, as in a loop that runs on each sample. The filter has no input for the age of a
/// held position, so the delay added by holding remains (design note 5.7), unless the given delay includes it.
#[derive(Debug, Clone)]
pub struct Filtered<F> {
    filter: F,
    step_s: f64,
    valid_from: f64,
    newest_velocity: Option<f64>,
    fix: Option<(f64, f64)>,
}

impl<F: VelocityFilter> Filtered<F> {
    /// Creates it with the nominal step (s) of a cold start.
    #[must_use]
    pub fn new(filter: F, step_s: f64) -> Filtered<F> {
        Filtered { filter, step_s, valid_from: 0.0, newest_velocity: None, fix: None }
    }

    /// The displacement currently added, m.
    #[must_use]
    pub fn displacement(&self) -> f64 {
        self.filter.displacement()
    }
}

impl<F: VelocityFilter + 'static> Compensator for Filtered<F> {
    fn start(&mut self, t: f64, velocity: f64, rule: StartRule) -> Result<(), FeedError> {
        check(VELOCITY, t, velocity, None)?;
        self.filter.start(velocity, rule, self.step_s);
        let wait = if rule == StartRule::InvalidUntilTd { self.filter.delay_s() } else { 0.0 };
        (self.valid_from, self.newest_velocity, self.fix) = (t + wait, Some(t), None);
        Ok(())
    }

    fn velocity(&mut self, t: f64, velocity: f64) -> Result<(), FeedError> {
        let previous = self.newest_velocity.ok_or(FeedError::NotStarted { what: VELOCITY, t })?;
        check(VELOCITY, t, velocity, Some(previous))?;
        self.filter.step(t - previous, velocity);
        self.newest_velocity = Some(t);
        Ok(())
    }

    fn position(&mut self, t: f64, position: f64) -> Result<(), FeedError> {
        if self.newest_velocity.is_none() {
            return Err(FeedError::NotStarted { what: POSITION, t });
        }
        check(POSITION, t, position, self.fix.map(|(t, _)| t))?;
        self.fix = Some((t, position));
        Ok(())
    }

    fn output(&self, t: f64) -> Option<f64> {
        let (_, position) = self.fix.filter(|_| t >= self.valid_from)?;
        Some(position + self.filter.displacement())
    }
}
