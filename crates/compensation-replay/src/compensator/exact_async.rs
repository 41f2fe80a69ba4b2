//! The exact form for any rates and drop-outs, sample by sample.

use crate::compensator::velocity_integral::VelocityIntegral;
use crate::compensator::{Compensator, FeedError, POSITION, VELOCITY, check};
use record::StartRule;

#[derive(Debug, Clone, Copy)]
struct Anchor {
    stamp: f64,
    position: f64,
    /// The instant from which velocity is added to it, s.
    from: f64,
    /// I at that instant, if the velocity has reached it.
    integral: Option<f64>,
}

/// `x_est(t) = p_j + I(t) − I(t_j − Td)` with the newest position `p_j` at timestamp `t_j` (design note 5.1): dead
/// reckoning from the instant at which the newest fix was true.
///
/// With velocity fed up to the first sample at or after `t` it gives the same bits as
/// [`ExactAsync`](crate::ExactAsync), which looks that far ahead (test `streaming_and_whole_record_agree_to_the_bit`).
/// Otherwise velocity is held after its newest sample, as on an aircraft. The error on circuits is then 0.113 m rms
/// instead of 0.020 m with clean 4 Hz position and velocity, 0.036 m instead of 0.032 m with 10 Hz of an RTK receiver,
/// and the same with 100 Hz velocity (example `table_5_7`).
#[derive(Debug, Clone)]
pub struct StreamingAsync {
    delay_s: f64,
    flown: VelocityIntegral,
    start: f64,
    rule: StartRule,
    anchor: Option<Anchor>,
}

impl StreamingAsync {
    /// For positions late by `delay_s`, with timestamps up to `max_gap_s` before the newest velocity.
    #[must_use]
    pub fn new(delay_s: f64, max_gap_s: f64) -> StreamingAsync {
        let flown = VelocityIntegral::new(delay_s + max_gap_s);
        StreamingAsync { delay_s, flown, start: 0.0, rule: StartRule::Warm, anchor: None }
    }

    /// From where velocity is added to a fix; cold: at rest before the first velocity.
    fn from(&self, stamp: f64) -> f64 {
        let from = stamp - self.delay_s;
        if self.rule == StartRule::Cold { from.max(self.start) } else { from }
    }
}

impl Compensator for StreamingAsync {
    fn start(&mut self, t: f64, velocity: f64, rule: StartRule) -> Result<(), FeedError> {
        check(VELOCITY, t, velocity, None)?;
        self.flown.start(t, velocity, velocity);
        (self.start, self.rule, self.anchor) = (t, rule, None);
        Ok(())
    }

    fn velocity(&mut self, t: f64, velocity: f64) -> Result<(), FeedError> {
        let newest = self.flown.newest().ok_or(FeedError::NotStarted { what: VELOCITY, t })?;
        check(VELOCITY, t, velocity, Some(newest))?;
        self.flown.push(t, velocity);
        if let Some(anchor) = self.anchor.as_mut().filter(|a| a.integral.is_none() && a.from <= t) {
            anchor.integral = self.flown.at(anchor.from);
        }
        Ok(())
    }

    fn position(&mut self, t: f64, position: f64) -> Result<(), FeedError> {
        let newest = self.flown.newest().ok_or(FeedError::NotStarted { what: POSITION, t })?;
        check(POSITION, t, position, self.anchor.map(|a| a.stamp))?;
        let from = self.from(t);
        let integral = if from > newest {
            None
        } else {
            let known_from = self.flown.known_from();
            Some(self.flown.at(from).ok_or(FeedError::TooOld { t, known_from })?)
        };
        self.anchor = Some(Anchor { stamp: t, position, from, integral });
        Ok(())
    }

    fn output(&self, t: f64) -> Option<f64> {
        let anchor = self.anchor?;
        if self.rule == StartRule::InvalidUntilTd && anchor.stamp - self.delay_s < self.start {
            return None;
        }
        let then = anchor.integral.or_else(|| self.flown.at(anchor.from))?;
        Some(anchor.position + (self.flown.at(t)? - then))
    }

    fn interpolates(&self) -> bool {
        true
    }
}
