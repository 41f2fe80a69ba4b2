//! A flight: channels of checked samples with their source.

use crate::notice::Notices;
use crate::series::Series;
use crate::time::{Clock, Stamp, StampKind, UtcTie};
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// What a channel holds, in which frame, and the order of its components.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Quantity {
    /// WGS-84 latitude rad, longitude rad, height m. A height above mean sea level may replace the ellipsoidal height;
    /// a notice then states it.
    PositionGeodetic,
    /// North m, east m, down m from an origin chosen by the log.
    PositionNed,
    /// North, east, down over ground, m/s.
    VelocityNed,
    /// Height above an origin chosen by the log, m: of a barometer, or of a position alone.
    Height,
    /// Unit quaternion w, x, y, z that rotates body axes (forward, right, down) to north, east, down.
    Attitude,
    /// About the body's forward, right and down axes, rad/s.
    AngularRate,
    /// Acceleration minus gravity along the body's forward, right and down axes, m/s²: at rest and level the third is
    /// −g.
    SpecificForce,
    /// Along the body's forward, right and down axes, T.
    MagneticField,
    /// As [`Quantity::MagneticField`], in a scale of the sensor: 1 is about the local field.
    MagneticDirection,
    /// Counts of a rotary encoder: a running number that neither wraps around nor resets.
    EncoderCount,
    /// Angle of a rotary encoder, rad; it need not start at zero.
    EncoderAngle,
    /// Edges of a pulse per second, timestamped by the logger; the value is the second of the device's clock, or a
    /// running number.
    Pulse,
    /// A single number.
    Scalar,
}

impl Quantity {
    /// Names of the components, in order.
    #[must_use]
    pub fn components(self) -> &'static [&'static str] {
        match self {
            Quantity::PositionGeodetic => &["latitude", "longitude", "height"],
            Quantity::PositionNed | Quantity::VelocityNed => &["north", "east", "down"],
            Quantity::Attitude => &["w", "x", "y", "z"],
            Quantity::AngularRate | Quantity::SpecificForce | Quantity::MagneticField | Quantity::MagneticDirection => {
                &["x", "y", "z"]
            }
            Quantity::Height => &["height"],
            Quantity::EncoderCount => &["count"],
            Quantity::EncoderAngle => &["angle"],
            Quantity::Pulse => &["second"],
            Quantity::Scalar => &["value"],
        }
    }
}

/// Where a channel's values came from.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ChannelSource {
    /// The topic (or table) in the log.
    pub topic: String,
    /// Its message type, empty when the format has none.
    pub type_name: String,
    /// The fields, with the unit read, as `latitude [deg]`.
    pub fields: Vec<String>,
}

/// Samples of one quantity over their primary timeline, with the other timestamps of the same rows.
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    /// What the components are.
    pub quantity: Quantity,
    /// The samples over the timeline that the channel map chose. A component that the log
    /// does not hold is zero throughout and not in `present`.
    pub series: Series,
    /// Which components the log contains, in the order of [`Quantity::components`].
    pub present: Vec<bool>,
    /// Other timestamps of the same rows; these need not increase.
    pub other_stamps: Vec<(StampKind, Clock, Vec<Stamp>)>,
    /// Rows that repeat a value held since an earlier row, so not measurements. All false
    /// unless the stream was detected as held (design note 3.8).
    pub held: Vec<bool>,
    /// Source of the values.
    pub source: ChannelSource,
}

impl Channel {
    /// Rows at which the value was updated: all rows except the held ones.
    #[must_use]
    pub fn update_rows(&self) -> Vec<usize> {
        self.updates().collect()
    }

    /// [`Channel::update_rows`] as an iterator: the rows of a long record take much memory.
    pub fn updates(&self) -> impl Iterator<Item = usize> + '_ {
        self.held.iter().enumerate().filter(|(_, held)| !**held).map(|(row, _)| row)
    }

    /// Number of updated rows.
    #[must_use]
    pub fn update_count(&self) -> usize {
        self.held.iter().filter(|held| !**held).count()
    }

    /// Whether any row repeats a held value.
    #[must_use]
    pub fn is_held(&self) -> bool {
        self.held.contains(&true)
    }
}

/// What was measured in one flight. Channel names are `quantity.source`, such as
/// `position.gps`, `velocity.ekf`, `position.truth`.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Flight {
    /// Channels by name.
    pub channels: BTreeMap<String, Channel>,
    /// What was lost, assumed or repaired on the way.
    pub notices: Notices,
    /// UTC of the clock since boot, where the log ties the two.
    pub utc: Option<UtcTie>,
}

impl Flight {
    /// Adds a channel. It shares its timestamps with another channel if they are equal.
    pub fn insert(&mut self, name: impl Into<String>, mut channel: Channel) {
        let _ = self.channels.values().any(|other| channel.series.share_stamps(&other.series));
        self.channels.insert(name.into(), channel);
    }

    /// The first of `names` that the flight contains.
    #[must_use]
    pub fn first_of<'a>(&'a self, names: &'a [String]) -> Option<(&'a str, &'a Channel)> {
        names.iter().find_map(|name| self.channels.get(name).map(|c| (name.as_str(), c)))
    }

    /// UTC of a timestamp, as a Unix count; for a clock since boot it is as accurate as [`UtcTie::spread_s`]. `None`
    /// for a clock without a tie to UTC.
    #[must_use]
    pub fn unix(&self, clock: Clock, stamp: Stamp) -> Option<Stamp> {
        let tied = || self.utc.as_ref().filter(|tie| tie.clock == clock)?.unix(stamp);
        clock.unix(stamp).or_else(tied)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::series::Timeline;

    #[test]
    fn updates_are_the_rows_not_held() {
        let timeline = Timeline::new(StampKind::Measured, Clock::Unix, (0..4).map(Stamp).collect()).unwrap();
        let channel = Channel {
            quantity: Quantity::Scalar,
            series: Series::new(timeline, vec![vec![1.0, 1.0, 2.0, 2.0]]).unwrap(),
            present: vec![true],
            other_stamps: vec![],
            held: vec![false, true, false, true],
            source: ChannelSource { topic: "t".into(), type_name: String::new(), fields: vec![] },
        };
        assert_eq!(channel.update_rows(), [0, 2]);
    }

    #[test]
    fn channels_with_equal_stamps_hold_them_once() {
        let channel = |stamps: [i64; 2]| {
            let timeline = Timeline::new(StampKind::Measured, Clock::Unix, stamps.map(Stamp).to_vec()).unwrap();
            Channel {
                quantity: Quantity::Scalar,
                series: Series::new(timeline, vec![vec![1.0, 2.0]]).unwrap(),
                present: vec![true],
                other_stamps: vec![],
                held: vec![false, false],
                source: ChannelSource { topic: "t".into(), type_name: String::new(), fields: vec![] },
            }
        };
        let mut flight = Flight::default();
        flight.insert("a", channel([1, 2]));
        flight.insert("b", channel([1, 3]));
        flight.insert("c", channel([1, 2]));
        let stamps = |name: &str| flight.channels[name].series.timeline().stamps().as_ptr();
        assert_eq!(stamps("a"), stamps("c"));
        assert_ne!(stamps("a"), stamps("b"));
    }
}
