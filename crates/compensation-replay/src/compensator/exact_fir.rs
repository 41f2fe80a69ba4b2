//! The exact form on a held position.

use crate::compensator::velocity_integral::VelocityIntegral;
use crate::compensator::{Compensator, FeedError, POSITION, VELOCITY, check};
use record::StartRule;

/// `x_est(t) = x_m(t) + ∫_{t−Td}^{t} v dτ` with the newest position for `x_m` (design note 5.1). This is
/// `G(s) = (1 − e^{−s Td})/s` itself, for a velocity that is linear between its samples and held after the newest one.
///
/// Like the filters it ignores the age of a held position; [`StreamingAsync`](crate::StreamingAsync) accounts for it.
#[derive(Debug, Clone)]
pub struct ExactFir {
    delay_s: f64,
    flown: VelocityIntegral,
    valid_from: f64,
    fix: Option<(f64, f64)>,
}

impl ExactFir {
    /// For positions late by `delay_s`; outputs may be requested up to `max_gap_s` before the newest velocity.
    #[must_use]
    pub fn new(delay_s: f64, max_gap_s: f64) -> ExactFir {
        ExactFir { delay_s, flown: VelocityIntegral::new(delay_s + max_gap_s), valid_from: 0.0, fix: None }
    }
}

impl Compensator for ExactFir {
    fn start(&mut self, t: f64, velocity: f64, rule: StartRule) -> Result<(), FeedError> {
        check(VELOCITY, t, velocity, None)?;
        self.flown.start(t, velocity, if rule == StartRule::Cold { 0.0 } else { velocity });
        self.valid_from = if rule == StartRule::InvalidUntilTd { t + self.delay_s } else { t };
        self.fix = None;
        Ok(())
    }

    fn velocity(&mut self, t: f64, velocity: f64) -> Result<(), FeedError> {
        let newest = self.flown.newest().ok_or(FeedError::NotStarted { what: VELOCITY, t })?;
        check(VELOCITY, t, velocity, Some(newest))?;
        self.flown.push(t, velocity);
        Ok(())
    }

    fn position(&mut self, t: f64, position: f64) -> Result<(), FeedError> {
        if self.flown.newest().is_none() {
            return Err(FeedError::NotStarted { what: POSITION, t });
        }
        check(POSITION, t, position, self.fix.map(|(t, _)| t))?;
        self.fix = Some((t, position));
        Ok(())
    }

    fn output(&self, t: f64) -> Option<f64> {
        let (_, position) = self.fix.filter(|_| t >= self.valid_from)?;
        Some(position + (self.flown.at(t)? - self.flown.at(t - self.delay_s)?))
    }

    fn interpolates(&self) -> bool {
        true
    }
}
