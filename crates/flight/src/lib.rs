//! The first waist of the architecture: what was measured. Independent of files and filters.
//!
//! Many log formats become one [`Flight`]: named [`Channel`]s of strictly timed,
//! finite samples in SI units, with [`Notice`]s that report what was lost on the way.
//!
//! Convention of the whole project: a positive [`Delay`] means **late**,
//! `measured(t) = truth(t − delay)`.
//!
//! ```
//! use flight::{Clock, Series, Stamp, StampKind, Timeline};
//! let timeline = Timeline::new(StampKind::Measured, Clock::Unix, vec![Stamp(0), Stamp(10_000_000)])?;
//! let north = Series::new(timeline, vec![vec![0.0, 0.15]])?;
//! assert_eq!(north.timeline().seconds_since(Stamp(0)), [0.0, 0.01]);
//! # Ok::<(), flight::SeriesError>(())
//! ```

mod about;
mod attitude;
mod channel;
mod distribution;
mod geodesy;
mod health;
mod leap;
mod notice;
mod number;
mod series;
mod time;
mod unit;

pub use about::{About, ConfiguredDelay, LeverArm, ModeStart, ReceiverIdentity};
pub use attitude::rotation_vector;
pub use channel::{Channel, ChannelSource, Flight, Quantity};
pub use distribution::Distribution;
pub use geodesy::{Ecef, Geodetic, LocalFrame, WGS84_A, WGS84_E2, WGS84_F};
pub use health::{
    Binding, ByteLedger, ChannelHealth, DamagedRange, Gap, Held, LogHealth, MapCandidate, RejectCount, StampHealth,
    StampOffset, TopicHealth,
};
pub use leap::{
    GPS_EPOCH_UNIX_S, LEAPS_KNOWN_UNTIL, TAI_LESS_GPS_S, WEEK_S, gps_ahead_of_utc_s, gps_of_unix, leaps_are_known_at,
    unix_of_gps,
};
pub use notice::{Alarm, AlarmEntry, Code, CodeEntry, Graded, Gravity, Notice, Notices, Severity};
pub use number::{decimals_of, fixed, with_expanded, with_minus};
pub use series::{Series, SeriesError, Timeline};
pub use time::{Clock, Delay, NANOS_PER_SECOND, Stamp, StampKind, UtcTie};
pub use unit::{Dimension, Unit, UnknownUnit};
