//! A channel map as written in its file. Every struct rejects unknown fields.

use crate::reader::Log;
use flight::Unit;
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer, StrDeserializer};
use serde::de::{Error, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};
use std::collections::BTreeSet;
use std::fmt::Formatter;
use std::marker::PhantomData;
use toml::Spanned;

/// A channel map: which topic and field becomes which channel, in which unit, frame and timeline.
#[derive(Debug, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct MapFile {
    /// Version of this format: 1.
    #[cfg_attr(feature = "schema", schemars(with = "u32"))]
    pub(crate) schema: Spanned<u32>,
    /// Short name, as `--map` takes it.
    pub(crate) name: String,
    /// One line for people.
    pub(crate) title: String,
    /// It binds any log that has some types, and is no match for a map that is made for a device.
    #[serde(default)]
    pub(crate) generic: bool,
    /// Sources of timestamps, for all channels without their own sources.
    #[serde(default)]
    pub(crate) time: TimeTable,
    /// What ties the clock since boot to UTC. Of several the first that the log holds is taken.
    #[serde(default)]
    #[cfg_attr(feature = "schema", schemars(with = "Vec<UtcEntry>"))]
    pub(crate) utc: Vec<Spanned<UtcEntry>>,
    /// The channels. Of several of one name, for other types, the first is made that finds its data.
    #[cfg_attr(feature = "schema", schemars(with = "Vec<ChannelEntry>"))]
    pub(crate) channel: Vec<Spanned<ChannelEntry>>,
}

/// Sources of stamps by kind; of each kind the first that exists is taken.
#[derive(Debug, Clone, Default, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub(crate) struct TimeTable {
    /// The time at which the value was true, as the device states it.
    pub(crate) measured: Vec<TimeEntry>,
    /// When the driver sent the message.
    pub(crate) published: Vec<TimeEntry>,
    /// When the logger received it.
    pub(crate) logged: Vec<TimeEntry>,
}

/// A topic with messages that state both the time since boot and UTC, as those of a receiver do. It dates the flight; the
/// samples keep their timestamps.
#[derive(Debug, Clone, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct UtcEntry {
    /// As in a channel.
    #[serde(default)]
    pub(crate) topic: Vec<String>,
    /// As in a channel.
    #[serde(default, rename = "type")]
    pub(crate) types: Vec<String>,
    /// The clock that is tied: a field with a unit and the clock `boot` or `elapsed`.
    pub(crate) stamp: TimeEntry,
    /// UTC or GPS time in the same message.
    pub(crate) utc: TimeEntry,
    /// What a message must fulfil, such as a fix.
    #[serde(default)]
    pub(crate) require: Vec<RequireEntry>,
}

/// One source of stamps: `container`, or `field` with `unit`, or `field` with `text`, or `date`, `time` and `offset` or `zone`,
/// or `week` with `field` and `unit`, or `calendar`.
#[derive(Debug, Clone, Default, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub(crate) struct TimeEntry {
    /// A stamp that the container gives to every message.
    pub(crate) container: Option<ContainerStamp>,
    /// A field of the message.
    pub(crate) field: Option<String>,
    /// What its number counts.
    pub(crate) unit: Option<TickName>,
    /// How its text is written.
    pub(crate) text: Option<TimeText>,
    /// The GPS week; `field` is then the time in the week. Weeks that are all below 1024 are taken as a counter
    /// of ten bits: the weeks nearest to the date of another clock of the log, or else those that end about a year
    /// after this release. Week 0 means no fix.
    pub(crate) week: Option<String>,
    /// With a week: a field of nanoseconds to be added.
    pub(crate) nanos: Option<String>,
    /// Columns of year, month, day, hour, minute and second, which may have a fraction, and perhaps one of the nanoseconds.
    pub(crate) calendar: Option<Vec<String>>,
    /// With a calendar: a counter of the device, which dates rows that have no date, or one that is more than a day off
    /// those of most rows.
    pub(crate) counter: Option<CounterEntry>,
    /// Column of a date, `yyyy-mm-dd`, `yyyy/mm/dd`, `yyyymmdd`, `yyyy-ddd`, `dd.mm.yyyy` or `dd-Mon-yyyy`; or one that leaves
    /// open what is the day, as `05/06/2021` or `050621`, where the column shows the order or `order` says it.
    pub(crate) date: Option<String>,
    /// With a date: the order of day, month and year.
    pub(crate) order: Option<OrderName>,
    /// Column of a time of day, `hh:mm:ss`, or `hhmmss` if all its rows can be that.
    pub(crate) time: Option<String>,
    /// Column of the offset from UTC, `+hh:mm`.
    pub(crate) offset: Option<String>,
    /// The offset from UTC of all rows, `+hh:mm`, for dates without an offset. Default: UTC. It is a fixed offset, without
    /// daylight saving time.
    pub(crate) zone: Option<String>,
    /// The year in which the log begins, for days of the year without one.
    pub(crate) year: Option<i16>,
    /// The bits of a counter that wraps around to zero. Default: 32.
    pub(crate) bits: Option<u32>,
    /// The clock that is counted; `unix` where text gives the instant.
    pub(crate) clock: Option<ClockName>,
}

/// A counter of a device, of 32 bits or more.
#[derive(Debug, Clone, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct CounterEntry {
    /// The field.
    pub(crate) field: String,
    /// What its number counts.
    pub(crate) unit: TickName,
}

/// A stamp of the container.
#[derive(Debug, Clone, Copy, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub(crate) enum ContainerStamp {
    /// The time at which the container wrote the message.
    Logged,
    /// The time at which the message was published, as the container states it.
    Published,
    /// The time at which the container wrote the message, on the clock since boot. For messages that state no time: they are
    /// placed between those that `[[utc]]` names with `utc = { container = "logged" }`.
    LoggedOnBoot,
}

/// A unit of time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub(crate) enum TickName {
    /// Days.
    #[serde(rename = "d")]
    Days,
    /// Hours.
    #[serde(rename = "h")]
    Hours,
    /// Minutes.
    #[serde(rename = "min")]
    Minutes,
    /// Seconds.
    #[serde(rename = "s")]
    Seconds,
    /// Milliseconds.
    #[serde(rename = "ms")]
    Millis,
    /// 100 microseconds.
    #[serde(rename = "100us")]
    TenthMillis,
    /// Microseconds.
    #[serde(rename = "us")]
    Micros,
    /// Nanoseconds.
    #[serde(rename = "ns")]
    Nanos,
}

/// A way to write an instant.
#[derive(Debug, Clone, Copy, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub(crate) enum TimeText {
    /// `2024-05-10T17:27:44.30Z`; without a zone it is UTC.
    #[serde(rename = "iso-8601")]
    Iso8601,
    /// Day of the year and time, as IRIG time codes are written: `131:17:27:44.300000`, or with the year in front. Without a
    /// year the clock is `elapsed`, since the begin of some year.
    DayOfYear,
    /// `17:27:44.300` or `172744.300`, of no known day: the clock is `elapsed`, since midnight.
    TimeOfDay,
}

/// What a date begins with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub(crate) enum OrderName {
    /// `23/06/2021`.
    DayMonthYear,
    /// `06/23/2021`.
    MonthDayYear,
    /// `21/06/23`.
    YearMonthDay,
}

/// A clock.
#[derive(Debug, Clone, Copy, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub(crate) enum ClockName {
    /// UTC since 1970.
    Unix,
    /// GPS time since 1980.
    Gps,
    /// Since the device was switched on.
    Boot,
    /// Since an unnamed start.
    Elapsed,
    /// Atomic time since 1970, as PTP (IEEE 1588) counts it: leap seconds counted.
    Tai,
    /// UTC since 1904, as LabVIEW counts seconds.
    Labview,
    /// UTC in days since 1899-12-30, as spreadsheets count.
    Excel,
    /// UTC in days since the year 0, as MATLAB's `datenum`.
    Matlab,
    /// UTC in days of the modified Julian date.
    ModifiedJulian,
    /// UTC in days of the Julian date. A double of it is no better than 20 µs.
    Julian,
}

/// A kind of stamp.
#[derive(Debug, Clone, Copy, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub(crate) enum KindName {
    /// The time at which the value was true, as the device states it.
    Measured,
    /// When the driver sent the message.
    Published,
    /// When the logger received it.
    Logged,
}

/// What a channel holds.
#[derive(Debug, Clone, Copy, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub(crate) enum QuantityName {
    /// `latitude`, `longitude` and perhaps `height`; or `x`, `y`, `z` with the frame `ecef`.
    PositionGeodetic,
    /// `north`, `east` or `west`, and perhaps `down` or `up`.
    PositionNed,
    /// `north`, `east`; or `speed`, `track` and perhaps `variation`; or `forward`, `left`, `up` and the orientation;
    /// or `x`, `y`, `z` with the frame `ecef` and the place `at_x`, `at_y`, `at_z`.
    VelocityNed,
    /// `height`.
    Height,
    /// `orientation_w` to `orientation_z`, a quaternion of any length, or `roll`, `pitch` and `yaw`; with `frame`.
    Attitude,
    /// `x`, `y`, `z` with `frame`; or `forward`, `right` or `left`, `down` or `up`. An axis may be missing.
    AngularRate,
    /// As an angular rate. At rest and level it points up.
    SpecificForce,
    /// As an angular rate, in a unit of magnetic field.
    MagneticField,
    /// As an angular rate, in units of the local field.
    MagneticDirection,
    /// `count`.
    EncoderCount,
    /// `angle`.
    EncoderAngle,
    /// `second`: a time, or a running number.
    Pulse,
    /// `value`.
    Scalar,
}

/// The axes that a source counts in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub(crate) enum FrameName {
    /// Of a vector: x forward, y right, z down.
    Frd,
    /// Of a vector: x forward, y left, z up (ROS REP 103; Xsens).
    Flu,
    /// Of an attitude: it turns forward, right, down to north, east, down.
    FrdNed,
    /// Of an attitude: it turns forward, left, up to east, north, up (ROS REP 103).
    FluEnu,
    /// Of an attitude: it turns forward, left, up to north, west, up (Xsens until 2012).
    FluNwu,
    /// Of an attitude: it turns forward, left, up to north, east, down.
    FluNed,
    /// Of a place or a velocity: earth-centred, earth-fixed (WGS-84).
    Ecef,
}

/// What a height is above.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub(crate) enum HeightAbove {
    /// WGS-84, as flightlag wants it.
    Ellipsoid,
    /// Mean sea level: taken as it is, with a notice.
    MeanSeaLevel,
}

/// One channel.
#[derive(Debug, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct ChannelEntry {
    /// `quantity.source`, as `position.gps`.
    pub(crate) name: String,
    /// What it holds.
    pub(crate) quantity: QuantityName,
    /// Topic names, the best first. A name of several words also fits below a namespace. It also fits a file with a name
    /// that ends in it, with `/` written as `-` or `_`, and with an instance appended as `_0`.
    #[serde(default)]
    pub(crate) topic: Vec<String>,
    /// Message types, as `sensor_msgs/NavSatFix`. Without a topic any topic of the type is meant;
    /// without either, any table of text.
    #[serde(default, rename = "type")]
    pub(crate) types: Vec<String>,
    /// The kind of stamp that is the time of the value.
    pub(crate) timeline: KindName,
    /// Stamps of this channel, instead of those of the file.
    pub(crate) time: Option<TimeTable>,
    /// The fields.
    pub(crate) fields: FieldTable,
    /// What a row must fulfil.
    #[serde(default)]
    pub(crate) require: Vec<RequireEntry>,
    /// The axes of `x`, `y`, `z`, or of an attitude.
    pub(crate) frame: Option<FrameName>,
    /// What the height is above.
    pub(crate) height_above: Option<HeightAbove>,
    /// An assumption that whoever reads the report should know.
    pub(crate) note: Option<String>,
    /// A log of this kind need not have it. Without it a field that the topic lacks is an error, but for maps that come with
    /// flightlag.
    #[serde(default)]
    pub(crate) optional: bool,
    /// The remark of the log on which the channel depends. Channels of one name with the same remark exclude one another.
    pub(crate) when: Option<WhenEntry>,
}

/// A remark of the log itself, as a comment `// Coordinate system: NED` above a table of text.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct WhenEntry {
    /// The text before the colon.
    pub(crate) remark: String,
    /// The text after the colon. Without it the channel is for logs that have no such remark.
    pub(crate) says: Option<String>,
}

impl WhenEntry {
    /// Whether the log is one that the channel is made for.
    pub(crate) fn met_by(&self, log: &Log) -> bool {
        self.said_by(log).into_iter().eq(self.says.as_deref())
    }

    /// The log's values of the remark. If there are several, the condition is not met.
    pub(crate) fn said_by<'l>(&self, log: &'l Log) -> BTreeSet<&'l str> {
        let remarks = log.health.extras.iter().filter_map(|extra| extra.split_once(" = "));
        remarks.filter(|(name, _)| *name == self.remark).map(|(_, text)| text).collect()
    }
}

/// The fields of a channel. Each is one field with its unit, or a list: the first field of the list that exists is read.
/// A height that is zero in every row ranks after one that is not.
#[derive(Debug, Default, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub(crate) struct FieldTable {
    /// Latitude, positive north.
    pub(crate) latitude: Option<OneOrMore<FieldEntry>>,
    /// Longitude, positive east.
    pub(crate) longitude: Option<OneOrMore<FieldEntry>>,
    /// Height, positive up.
    pub(crate) height: Option<OneOrMore<FieldEntry>>,
    /// North.
    pub(crate) north: Option<OneOrMore<FieldEntry>>,
    /// East; instead of `west`.
    pub(crate) east: Option<OneOrMore<FieldEntry>>,
    /// West; instead of `east`.
    pub(crate) west: Option<OneOrMore<FieldEntry>>,
    /// Down; instead of `up`. In the body's frame, along its downward axis.
    pub(crate) down: Option<OneOrMore<FieldEntry>>,
    /// Up; instead of `down`. In the body's frame, along its upward axis.
    pub(crate) up: Option<OneOrMore<FieldEntry>>,
    /// Speed over ground.
    pub(crate) speed: Option<OneOrMore<FieldEntry>>,
    /// Direction of travel, clockwise from north: from true north, or with `variation` from magnetic north.
    pub(crate) track: Option<OneOrMore<FieldEntry>>,
    /// Magnetic variation, positive east: true track = magnetic track + variation.
    pub(crate) variation: Option<OneOrMore<FieldEntry>>,
    /// Along the body's forward axis.
    pub(crate) forward: Option<OneOrMore<FieldEntry>>,
    /// Along the body's left axis; instead of `right`.
    pub(crate) left: Option<OneOrMore<FieldEntry>>,
    /// Along the body's right axis; instead of `left`.
    pub(crate) right: Option<OneOrMore<FieldEntry>>,
    /// Along or about the first axis of `frame`.
    pub(crate) x: Option<OneOrMore<FieldEntry>>,
    /// Along or about the second axis of `frame`.
    pub(crate) y: Option<OneOrMore<FieldEntry>>,
    /// Along or about the third axis of `frame`.
    pub(crate) z: Option<OneOrMore<FieldEntry>>,
    /// With a velocity in the frame `ecef`: where it is, along the first axis.
    pub(crate) at_x: Option<OneOrMore<FieldEntry>>,
    /// Where it is, along the second axis.
    pub(crate) at_y: Option<OneOrMore<FieldEntry>>,
    /// Where it is, along the third axis.
    pub(crate) at_z: Option<OneOrMore<FieldEntry>>,
    /// About the first axis of `frame`, last of the three turns (3-2-1).
    pub(crate) roll: Option<OneOrMore<FieldEntry>>,
    /// About the second axis of `frame`, second of the three turns.
    pub(crate) pitch: Option<OneOrMore<FieldEntry>>,
    /// About the third axis of `frame`, first of the three turns.
    pub(crate) yaw: Option<OneOrMore<FieldEntry>>,
    /// Counts of an encoder.
    pub(crate) count: Option<OneOrMore<FieldEntry>>,
    /// Angle of an encoder.
    pub(crate) angle: Option<OneOrMore<FieldEntry>>,
    /// Second of the device's clock at a pulse, or the pulse's number.
    pub(crate) second: Option<OneOrMore<FieldEntry>>,
    /// Orientation: quaternion, x. Of an attitude in the axes of `frame`, else of the body (forward, left, up) in
    /// east, north, up.
    pub(crate) orientation_x: Option<OneOrMore<FieldEntry>>,
    /// Quaternion, y.
    pub(crate) orientation_y: Option<OneOrMore<FieldEntry>>,
    /// Quaternion, z.
    pub(crate) orientation_z: Option<OneOrMore<FieldEntry>>,
    /// Quaternion, scalar part.
    pub(crate) orientation_w: Option<OneOrMore<FieldEntry>>,
    /// The number of a scalar.
    pub(crate) value: Option<OneOrMore<FieldEntry>>,
}

/// One entry, or a list of them. An untagged enum of serde would not say which line is wrong, and why.
#[derive(Debug, Clone)]
pub(crate) struct OneOrMore<T>(pub(crate) Vec<T>);

impl<T> Default for OneOrMore<T> {
    fn default() -> OneOrMore<T> {
        OneOrMore(vec![])
    }
}

impl<'de, T: Deserialize<'de>> Deserialize<'de> for OneOrMore<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<OneOrMore<T>, D::Error> {
        deserializer.deserialize_any(EntryOrList(PhantomData))
    }
}

struct EntryOrList<T>(PhantomData<T>);

impl<'de, T: Deserialize<'de>> Visitor<'de> for EntryOrList<T> {
    type Value = OneOrMore<T>;

    fn expecting(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        f.write_str("an entry, or a list of them")
    }

    fn visit_str<E: Error>(self, text: &str) -> Result<OneOrMore<T>, E> {
        T::deserialize(StrDeserializer::new(text)).map(|one| OneOrMore(vec![one]))
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<OneOrMore<T>, A::Error> {
        T::deserialize(MapAccessDeserializer::new(map)).map(|one| OneOrMore(vec![one]))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, list: A) -> Result<OneOrMore<T>, A::Error> {
        Vec::deserialize(SeqAccessDeserializer::new(list)).map(OneOrMore)
    }
}

#[cfg(feature = "schema")]
impl<T: JsonSchema> JsonSchema for OneOrMore<T> {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        format!("OneOrMore_{}", T::schema_name()).into()
    }

    fn json_schema(generator: &mut schemars::SchemaGenerator) -> schemars::Schema {
        schemars::json_schema!({
            "anyOf": [generator.subschema_for::<T>(), generator.subschema_for::<Vec<T>>()]
        })
    }
}

/// A field and its unit.
#[derive(Debug, Clone, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct FieldEntry {
    /// Dotted path.
    pub(crate) field: String,
    /// Unit, as `deg`, `1e-7 deg`, `m`, `mm`, `ft`, `m/s`, `kt`, `ft/min`; `1` for a pure number.
    #[serde(deserialize_with = "unit")]
    #[cfg_attr(feature = "schema", schemars(with = "String"))]
    pub(crate) unit: Unit,
    /// The reference of a height, if it differs from that of the channel.
    pub(crate) above: Option<HeightAbove>,
}

/// A condition on a row; rows that fail it are counted and not used. A field that the log does not have is no obstacle, and
/// neither is an epoch that the other topics do not have. Of several messages of one epoch all must fulfil it.
#[derive(Debug, Clone, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct RequireEntry {
    /// The field.
    pub(crate) field: String,
    /// Topics that have it in a message of the same epoch, instead of the row itself.
    #[serde(default)]
    pub(crate) of: Vec<String>,
    /// With other topics: the fields that number the epochs, here and there: one, or several that do it together, as a week
    /// and the time in it.
    #[serde(default)]
    pub(crate) same: OneOrMore<String>,
    /// Its least value.
    pub(crate) min: Option<f64>,
    /// Its largest value.
    pub(crate) max: Option<f64>,
    /// A bit that is set, counted from 0 at the lowest.
    pub(crate) bit: Option<u32>,
}

/// Parses a unit; an unknown one is rejected with its line.
fn unit<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Unit, D::Error> {
    String::deserialize(deserializer)?.parse().map_err(D::Error::custom)
}

impl RequireEntry {
    /// Whether a value fulfils the condition; a NaN does not.
    pub(crate) fn met_by(&self, value: f64) -> bool {
        let is_set = |bit: u32| (value / 2_f64.powi(bit as i32)).floor().rem_euclid(2.0) == 1.0;
        self.min.is_none_or(|min| value >= min)
            && self.max.is_none_or(|max| value <= max)
            && self.bit.is_none_or(is_set)
    }
}

/// The JSON schema of a channel map, for editors.
#[cfg(feature = "schema")]
#[must_use]
pub fn channel_map_schema() -> String {
    let schema = schemars::schema_for!(MapFile);
    let text = serde_json::to_string_pretty(&schema).unwrap_or_default();
    format!("{text}\n")
}
