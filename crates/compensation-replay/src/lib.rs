//! What a delay compensator would have done on a recorded flight.
//!
//! A receiver reports position late by Td while its velocity is on time. Two compensators recover the aircraft's
//! position, sample by sample, as an on-board loop would run them:
//!
//! - the paper's (Park & Lee 2010, eq. 3): `x_est = x_m + G(s) v`, with
//!   `G(s) = (1 − e^{−s Td})/s ≈ Td / ((Td/2) s + 1)`, first-order Padé, Tustin, warm start;
//! - the exact asynchronous form: `x_est(t) = p_j + I(t) − I(t_j − Td)` with the newest fix `p_j`
//!   stamped `t_j` and `I = ∫ v` (design note 5.1).
//!
//! [`replay`] takes a [`flight::Flight`] and [`Settings`] and returns a [`record::ReplayRecord`] and the compensated
//! [`Track`]. It uses no disk, screen or clock.

mod compensator;
mod curves;
mod effect;
mod ekf_values;
mod estimate;
mod exact;
mod explorer;
mod export;
mod input;
mod lever_arm;
mod pade;
mod reference_file;
mod replay;
mod rows;
mod score;
mod settings;
mod sweep;
mod track;
mod validity;

pub use compensator::{
    AxisSamples, Compensator, CompensatorError, CompensatorKind, CompensatorOptions, DelayedKalman, Discretisation,
    ExactFir, FeedError, Filtered, Fraction, KalmanSettings, ModalFilter, Mode, OfflineShift, PadeForm, PadeRefusal,
    Replayed, Smoothed, StreamingAsync, VelocityFilter, VelocityView, fit_kalman, replay_axis, rts_smooth,
};
pub use effect::{KnownLateness, MotionRms, effect, error_words};
pub use ekf_values::{EkfChannelFacts, ekf_values, ekf_values_toml};
pub use exact::ExactAsync;
pub use export::{
    AutopilotAdvice, AutopilotParameter, CExport, CFloat, CSource, EKF2_DELAY_MAX_DEFAULT_MS, ExportError,
    MeasuredAgainst, ParameterFit, autopilot_advice, export_c, is_gps_delay,
};
pub use input::{Picked, Refusal, pick_pair, some_of};
pub use lever_arm::{AntennaArm, LeverMotion, LeverSensitivity, VelocityPoint, antenna_arm, lever_sensitivity};
pub use pade::PadeTustin;
pub use reference_file::{
    ClockRule, Likeness, REFERENCE_POSITION, REFERENCE_VELOCITY, join_reference, likeness, relate_clocks,
};
pub use replay::{Replay, replay, sketch};
pub use rows::RowState;
pub use settings::Settings;
pub use sweep::{Sweeper, TruthEffect};
pub use track::{ReplayedTrack, Track, TrackColumn, TrackRows};
pub use validity::{DelayModel, Delays, MotionShare, ValidityBand, compensation_error};
