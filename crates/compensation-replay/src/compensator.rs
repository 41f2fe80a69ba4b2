//! Compensators as an aircraft would run them: one axis, sample by sample.

mod axis;
mod exact_async;
mod exact_fir;
mod filtered;
mod kalman;
mod kind;
mod likelihood;
mod modal;
mod offline_shift;
mod pade_form;
mod pade_tustin;
mod rts;
mod velocity_integral;
mod white_jerk;

pub use axis::{AxisSamples, Replayed, VelocityView, replay_axis};
pub use exact_async::StreamingAsync;
pub use exact_fir::ExactFir;
pub use filtered::{Filtered, VelocityFilter};
pub use kalman::DelayedKalman;
pub use kind::{CompensatorError, CompensatorKind, CompensatorOptions};
pub use likelihood::fit_kalman;
pub(crate) use modal::StepGains;
pub use modal::{Discretisation, ModalFilter};
pub use offline_shift::OfflineShift;
pub use pade_form::{Fraction, Mode, PadeForm, PadeRefusal};
pub use rts::{Smoothed, rts_smooth};
pub use white_jerk::KalmanSettings;

use record::StartRule;
use std::fmt::Debug;

/// A delay compensator of one axis, run sample by sample.
///
/// Positions arrive late by Td (positive is late: `measured(t) = truth(t − Td)`) and velocities arrive on time. The
/// output is the position at the requested instant. Timestamps are seconds on one clock for all calls.
///
/// The contract:
///
/// - [`start`](Compensator::start) takes the first velocity sample and clears all earlier state. Velocity and position
///   before it are rejected.
/// - Velocity timestamps rise strictly, and so do position timestamps, independently. A rejected sample leaves the
///   state unchanged, so a caller may count the error and continue with the next sample. Duplicates are dropped this
///   way.
/// - **Any step, also over gaps**: a step of any length is a straight line between the two velocities, never skipped.
///   The caller decides how long a gap may be: after a longer one, call `start` again.
/// - The output changes only through calls of `velocity` and `position`. In a causal replay, do not feed samples later
///   than `t` before asking for `t`. Each compensator documents its output between and after samples.
/// - Start rules ([`StartRule`]): **warm**, as if the first velocity had always been flown; **cold**, at rest before,
///   and the first velocity counts as a ramp from zero over one nominal step; **invalid until Td**, like warm, but
///   without output until Td of velocity has been seen.
/// - No output (`None`) before the first position.
/// - Jumps of the position pass with gain 1, except in smoothing compensators ([`DelayedKalman`]).
/// - The same calls give the same bits.
pub trait Compensator: Debug + Send {
    /// Starts with the first velocity (m/s) at `t` (s).
    ///
    /// # Errors
    /// [`FeedError::NotFinite`].
    fn start(&mut self, t: f64, velocity: f64, rule: StartRule) -> Result<(), FeedError>;

    /// Takes the next velocity (m/s) with timestamp `t` (s).
    ///
    /// # Errors
    /// Not started, not finite, or not later than the previous velocity.
    fn velocity(&mut self, t: f64, velocity: f64) -> Result<(), FeedError>;

    /// Takes the next position (m) with timestamp `t` (s), which was true Td earlier.
    ///
    /// # Errors
    /// Not started, not finite, not later than the previous position, or older than the stored velocity.
    fn position(&mut self, t: f64, position: f64) -> Result<(), FeedError>;

    /// The position at `t` (s), m; `None` if there is no output.
    fn output(&self, t: f64) -> Option<f64>;

    /// Whether the output between two velocity samples uses both of them if both are known ([`VelocityView`]).
    fn interpolates(&self) -> bool {
        false
    }
}

/// Why a sample was rejected. The state is unchanged.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum FeedError {
    /// A sample arrived before `start`.
    #[error("{what} at {t} s is before the start")]
    NotStarted {
        /// Velocity or position.
        what: &'static str,
        /// Its timestamp, s.
        t: f64,
    },
    /// Timestamps must rise.
    #[error("{what} at {t} s is not later than the one before, at {previous} s")]
    NotLater {
        /// Velocity or position.
        what: &'static str,
        /// Its timestamp, s.
        t: f64,
        /// The previous timestamp, s.
        previous: f64,
    },
    /// Numbers must be finite.
    #[error("{what} at {t} s: timestamp or value is not finite")]
    NotFinite {
        /// Velocity or position.
        what: &'static str,
        /// Its timestamp, s.
        t: f64,
    },
    /// The velocity at its time is no longer stored.
    #[error("position at {t} s is older than {known_from} s, and the velocity of that time is no longer stored")]
    TooOld {
        /// Its timestamp, s.
        t: f64,
        /// Velocity is stored from here on, s.
        known_from: f64,
    },
}

const VELOCITY: &str = "velocity";
const POSITION: &str = "position";

/// Checks that a sample is finite and later than the one at `previous`.
fn check(what: &'static str, t: f64, value: f64, previous: Option<f64>) -> Result<(), FeedError> {
    if !t.is_finite() || !value.is_finite() {
        return Err(FeedError::NotFinite { what, t });
    }
    match previous {
        Some(previous) if t <= previous => Err(FeedError::NotLater { what, t, previous }),
        _ => Ok(()),
    }
}
