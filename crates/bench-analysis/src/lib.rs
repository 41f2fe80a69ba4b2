//! From encoder counts to the delay and the dynamics of each channel of a sensor.

mod alignment;
mod bench;
mod card;
mod channel;
mod clock;
mod constancy;
mod curves;
mod dead_encoder;
mod encoder;
mod flexibility;
mod gap;
mod gate;
mod gravity;
mod injection;
mod kinematics;
mod lag_words;
mod lagged_field;
mod magnetic;
mod magnetometer;
mod motion;
mod mount;
mod no_answer;
mod overlay;
mod pattern;
mod reference_error;
mod references;
mod response;
mod rig;
mod rig_file;
mod sampling;
mod sensed;
mod sensor_rows;
mod slip;
mod surroundings;
mod verdict;

pub use crate::alignment::{Alignment, align};
pub use crate::bench::{Bench, BenchInput, BenchRefusal, bench};
#[cfg(feature = "schema")]
pub use crate::card::card_schema;
pub use crate::card::{
    CardTerms, Combined, MagneticEvidence, card_magnetometer, card_text, combine, copies, identity_conflict,
    parse_card, sensor_name,
};
pub use crate::encoder::{EncoderError, EncoderSeries, encoder_channel};
pub use crate::flexibility::{GainAt, bending_response, first_mode_of_gain, flexibility};
pub use crate::gravity::{STANDARD_GRAVITY_MPS2, normal_gravity};
pub use crate::kinematics::{
    BarState, EARTH_RATE, Sensed, acceleration, angular_rate, attitude, magnetic_field, ned_from_body, position,
    rotation, specific_force, swing_angle, swing_azimuth, velocity, wrapped,
};
pub use crate::magnetic::{MagneticModel, ModelField, decimal_year, model_field};
pub use crate::magnetometer::{MagneticSwing, calibrate_magnetometer};
pub use crate::motion::Motion;
pub use crate::mount::mount_finding;
pub use crate::references::{ChannelReference, ComponentReference, References};
pub use crate::rig::{
    AnalysisRule, Bar, ClockRule, DEFAULT_RIG, EncoderRule, FieldRule, Mount, MountKind, Rig, Site, StampChoice,
};
#[cfg(feature = "schema")]
pub use crate::rig_file::rig_schema;
pub use crate::slip::Slip;
pub use crate::surroundings::{Surroundings, place_of};
pub use settings::SettingsError;
