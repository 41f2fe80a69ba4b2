//! Compensators as an aircraft would run them: one axis, one sample in, one position out.

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
pub use likelihood::{KalmanFit, fit_kalman};
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
/// Positions arrive late by Td (positive is late: `measured(t) = truth(t − Td)`) and velocities as they are flown;
/// the output is the position at the instant asked for. Stamps are seconds of one clock for all calls.
///
/// The contract:
///
/// - [`start`](Compensator::start) is the first velocity sample, and forgets all that was before. Velocity and
///   position before it are refused.
/// - Velocity stamps rise strictly, position stamps rise strictly, each for itself. What is refused leaves the state
///   as it was, so a caller may count the error and go on with the next sample: that is how duplicates are dropped.
/// - **Any step, also over gaps**: a step of any length is taken as a straight line between the two velocities, never
///   skipped. How long a gap may be is the caller's decision: beyond it, call `start` again.
/// - The output changes only by calls of `velocity` and `position`: samples later than `t` must not have been fed
///   where the replay is to be causal. Between and after samples a compensator says what it does.
/// - Start rules ([`StartRule`]): **warm**, as if the first velocity had always been flown; **cold**, nothing was flown
///   before, and the first velocity counts as a ramp from zero over one nominal step; **invalid until Td**, as warm,
///   but no output until Td of velocity has been seen.
/// - No output (`None`) before the first position.
/// - Positions that jump pass with gain 1; smoothing compensators ([`DelayedKalman`]) say otherwise.
/// - The same calls give the same bits. [`snapshot`](Compensator::snapshot) is a copy that goes on by itself with
///   the same bits: keep one to restart without a bump.
pub trait Compensator: Debug + Send {
    /// As in a pipeline: `pade-1-1-tustin`, `exact-async`.
    fn name(&self) -> String;

    /// The first velocity (m/s) at `t` (s).
    ///
    /// # Errors
    /// [`FeedError::NotFinite`].
    fn start(&mut self, t: f64, velocity: f64, rule: StartRule) -> Result<(), FeedError>;

    /// The next velocity (m/s), stamped `t` (s).
    ///
    /// # Errors
    /// Not started, not finite, or not later than the velocity before.
    fn velocity(&mut self, t: f64, velocity: f64) -> Result<(), FeedError>;

    /// The next position (m), stamped `t` (s), of an instant Td earlier.
    ///
    /// # Errors
    /// Not started, not finite, not later than the position before, or so old that velocity of its time is forgotten.
    fn position(&mut self, t: f64, position: f64) -> Result<(), FeedError>;

    /// The position at `t` (s), m; `None` where there is none to give.
    fn output(&self, t: f64) -> Option<f64>;

    /// Whether the output between two velocity samples uses both of them if both are known ([`VelocityView`]).
    fn interpolates(&self) -> bool {
        false
    }

    /// All that the next output depends on, by name, for a person who looks for a fault.
    fn state(&self) -> Vec<StateValue>;

    /// A copy that goes on by itself.
    fn snapshot(&self) -> Box<dyn Compensator>;
}

/// A number of a compensator's state.
#[derive(Debug, Clone, PartialEq)]
pub struct StateValue {
    /// What it is.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// Its unit.
    pub unit: &'static str,
}

impl StateValue {
    fn new(name: impl Into<String>, value: f64, unit: &'static str) -> StateValue {
        StateValue { name: name.into(), value, unit }
    }
}

/// Why a sample was not taken. The state is as it was before.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum FeedError {
    /// A compensator begins with `start`.
    #[error("{what} at {t} s before the start")]
    NotStarted {
        /// Velocity or position.
        what: &'static str,
        /// Its stamp, s.
        t: f64,
    },
    /// Stamps must rise.
    #[error("{what} at {t} s is not later than the one before, at {previous} s")]
    NotLater {
        /// Velocity or position.
        what: &'static str,
        /// Its stamp, s.
        t: f64,
        /// The stamp before, s.
        previous: f64,
    },
    /// Numbers must be finite.
    #[error("{what} at {t} s: stamp or value is not finite")]
    NotFinite {
        /// Velocity or position.
        what: &'static str,
        /// Its stamp, s.
        t: f64,
    },
    /// The velocity of its time is no longer known.
    #[error("position at {t} s is from before {known_from} s, and the velocity of that time is no longer stored")]
    TooOld {
        /// Its stamp, s.
        t: f64,
        /// Velocity is known from here, s.
        known_from: f64,
    },
}

const VELOCITY: &str = "velocity";
const POSITION: &str = "position";

/// Whether a sample follows the one at `previous`.
fn check(what: &'static str, t: f64, value: f64, previous: Option<f64>) -> Result<(), FeedError> {
    if !t.is_finite() || !value.is_finite() {
        return Err(FeedError::NotFinite { what, t });
    }
    match previous {
        Some(previous) if t <= previous => Err(FeedError::NotLater { what, t, previous }),
        _ => Ok(()),
    }
}
