//! The causal filter for a late position.

use crate::compensator::white_jerk::{Belief, KalmanSettings};
use crate::compensator::{Compensator, FeedError, POSITION, VELOCITY, check};
use record::StartRule;
use std::collections::VecDeque;

/// Kalman filter of position, velocity and acceleration under white jerk, with positions delayed by Td (design note
/// 5.7). It uses both inputs up to the instant at which the newest position was true, velocity alone from there on, and
/// then predicts to the requested instant.
///
/// The optimal causal compensator under its model. On circuits its error is 0.127 m where the exact asynchronous form
/// has 1.43 m (4 Hz position of 1 m), 0.0166 m where it has 0.142 m (INS at 100 Hz), and 0.0131 m where it has 0.113 m
/// (clean 4 Hz; example `table_5_7`). It smooths, so it follows a jump of the position slowly. Its output is as good as
/// its settings ([`fit_kalman`](crate::fit_kalman)). A new position costs one filter step per velocity of the last Td.
/// Cold and warm starts are the same: it starts at the first position, with a wide covariance. After `max_gap_s`
/// without a position, velocities of that age are final.
#[derive(Debug, Clone)]
pub struct DelayedKalman {
    delay_s: f64,
    keep_s: f64,
    settings: KalmanSettings,
    start: Option<(f64, StartRule)>,
    /// Timestamp and value of the newest velocity.
    newest: (f64, f64),
    fix_stamp: Option<f64>,
    /// Velocities after the tail.
    recent: VecDeque<(f64, f64)>,
    /// State after all positions and the velocities up to the newest of them.
    tail: Option<Belief>,
    /// The tail updated with the recent velocities.
    head: Option<Belief>,
}

impl DelayedKalman {
    /// For positions late by `delay_s`, with timestamps up to `max_gap_s` before the newest velocity. `None` if a
    /// setting is not positive and finite.
    #[must_use]
    pub fn new(delay_s: f64, max_gap_s: f64, settings: KalmanSettings) -> Option<DelayedKalman> {
        settings.is_sound().then(|| DelayedKalman {
            delay_s,
            keep_s: delay_s + max_gap_s,
            settings,
            start: None,
            newest: (0.0, 0.0),
            fix_stamp: None,
            recent: VecDeque::new(),
            tail: None,
            head: None,
        })
    }

    /// Standard deviation of the output at `t`, m, if the settings are correct.
    #[must_use]
    pub fn sigma(&self, t: f64) -> Option<f64> {
        let mut head = self.head?;
        head.predict(t.max(head.t), self.settings.jerk_density);
        Some(head.covariance[(0, 0)].max(0.0).sqrt())
    }

    /// Advances the tail over the velocities up to `t` and drops them.
    fn finish_until(&mut self, t: f64) {
        while let Some(&(at, v)) = self.recent.front().filter(|(at, _)| *at <= t) {
            if let Some(tail) = &mut self.tail {
                tail.predict(at, self.settings.jerk_density);
                tail.update(1, v, self.settings.velocity_sigma_mps);
            }
            self.recent.pop_front();
        }
    }

    /// Initial state at the first position: its own value, and the velocity nearest to it.
    fn first(&self, at: f64, position: f64) -> Belief {
        let nearest = self.recent.iter().copied().min_by(|a, b| (a.0 - at).abs().total_cmp(&(b.0 - at).abs()));
        let (t, v) = nearest.unwrap_or(self.newest);
        Belief::first(at, position, v, (t - at).abs(), &self.settings)
    }
}

impl Compensator for DelayedKalman {
    fn start(&mut self, t: f64, velocity: f64, rule: StartRule) -> Result<(), FeedError> {
        check(VELOCITY, t, velocity, None)?;
        let at = t - self.settings.velocity_delay_s;
        (self.start, self.newest, self.fix_stamp) = (Some((at, rule)), (at, velocity), None);
        (self.tail, self.head) = (None, None);
        self.recent.clear();
        self.recent.push_back((at, velocity));
        Ok(())
    }

    fn velocity(&mut self, t: f64, velocity: f64) -> Result<(), FeedError> {
        if self.start.is_none() {
            return Err(FeedError::NotStarted { what: VELOCITY, t });
        }
        let late = self.settings.velocity_delay_s;
        check(VELOCITY, t, velocity, None)?;
        if t - late <= self.newest.0 {
            return Err(FeedError::NotLater { what: VELOCITY, t, previous: self.newest.0 + late });
        }
        self.newest = (t - late, velocity);
        // A velocity from before the newest position's instant (arrived after the position) counts from there.
        let at = self.tail.map_or(t - late, |tail| tail.t.max(t - late));
        self.recent.push_back((at, velocity));
        if let Some(head) = &mut self.head {
            head.predict(at, self.settings.jerk_density);
            head.update(1, velocity, self.settings.velocity_sigma_mps);
        }
        self.finish_until(at - self.keep_s);
        Ok(())
    }

    fn position(&mut self, t: f64, position: f64) -> Result<(), FeedError> {
        if self.start.is_none() {
            return Err(FeedError::NotStarted { what: POSITION, t });
        }
        check(POSITION, t, position, self.fix_stamp)?;
        let at = t - self.delay_s;
        match self.tail {
            Some(tail) if at < tail.t => return Err(FeedError::TooOld { t, known_from: tail.t }),
            Some(_) => {
                self.finish_until(at);
                if let Some(tail) = &mut self.tail {
                    tail.predict(at, self.settings.jerk_density);
                    tail.update(0, position, self.settings.position_sigma_m);
                }
            }
            None => {
                self.tail = Some(self.first(at, position));
                self.recent.retain(|(t, _)| *t > at);
            }
        }
        self.fix_stamp = Some(t);
        self.head = self.tail;
        if let Some(head) = &mut self.head {
            for &(at, v) in &self.recent {
                head.predict(at, self.settings.jerk_density);
                head.update(1, v, self.settings.velocity_sigma_mps);
            }
        }
        Ok(())
    }

    fn output(&self, t: f64) -> Option<f64> {
        let (start, rule) = self.start?;
        let fix = self.fix_stamp?;
        if rule == StartRule::InvalidUntilTd && fix - self.delay_s < start {
            return None;
        }
        self.head.map(|head| head.position_at(t))
    }
}
