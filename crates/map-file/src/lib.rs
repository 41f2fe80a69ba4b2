//! A channel map as written in its file. Every struct rejects unknown fields.
//!
//! A crate of its own, because what TOML and serde make of these structs is a sixth of the code of `ingest`, and is compiled
//! without optimisation here: it runs once for each map.

use flight::{Quantity, StampKind, Unit};
use formats::civil::{DateOrder, Tick};
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer, StrDeserializer};
use serde::de::{Error, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};
use settings::{Refused, SettingsFile};
use std::fmt::Formatter;
use std::marker::PhantomData;
use toml::Spanned;

/// Reads the file of a channel map. Complaints are kept by `file`.
///
/// # Errors
/// The text is not TOML, or nothing of the right type was found.
pub fn read(file: &SettingsFile<'_>) -> Result<MapFile, Refused> {
    file.read()
}

/// A channel map: which topic and field becomes which channel, in which unit, frame and timeline.
#[derive(Debug, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct MapFile {
    /// Version of this format: 1.
    #[cfg_attr(feature = "schema", schemars(with = "u32"))]
    pub schema: Spanned<u32>,
    /// Short name, for `--map`.
    pub name: String,
    /// Title in one line.
    pub title: String,
    /// Whether the map binds any log with certain types. A map made for a specific device takes precedence.
    #[serde(default)]
    pub generic: bool,
    /// Channels without which the map does not fit a log. Default: none in particular.
    #[serde(default)]
    #[cfg_attr(feature = "schema", schemars(with = "Vec<String>"))]
    pub needs: Vec<Spanned<String>>,
    /// Sources of timestamps for all channels without their own.
    #[serde(default)]
    pub time: TimeTable,
    /// Ties of the clock since boot to UTC. The first one that the log has is used.
    #[serde(default)]
    #[cfg_attr(feature = "schema", schemars(with = "Vec<UtcEntry>"))]
    pub utc: Vec<Spanned<UtcEntry>>,
    /// The channels. If several have the same name, for different types, the first one that finds its data is used.
    #[cfg_attr(feature = "schema", schemars(with = "Vec<ChannelEntry>"))]
    pub channel: Vec<Spanned<ChannelEntry>>,
}

/// Sources of timestamps by kind. The first one of each kind that exists is used.
#[derive(Debug, Clone, Default, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct TimeTable {
    /// Time at which the value was true, according to the device.
    pub measured: Vec<TimeEntry>,
    /// Time at which the driver sent the message.
    pub published: Vec<TimeEntry>,
    /// Time at which the logger received it.
    pub logged: Vec<TimeEntry>,
}

/// A topic with both the time since boot and UTC in each message, such as that of a receiver. It dates the flight; the
/// timestamps of samples are unchanged.
#[derive(Debug, Clone, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct UtcEntry {
    /// As in a channel.
    #[serde(default)]
    pub topic: Vec<String>,
    /// As in a channel.
    #[serde(default, rename = "type")]
    pub types: Vec<String>,
    /// The clock that is tied: a field with a unit and the clock `boot` or `elapsed`.
    pub stamp: TimeEntry,
    /// UTC or GPS time in the same message.
    pub utc: TimeEntry,
    /// Conditions on a message, such as a fix.
    #[serde(default)]
    pub require: Vec<RequireEntry>,
}

/// One source of timestamps: `container`, or `field` with `unit`, or `field` with `text`, or `date`, `time` and
/// `offset` or `zone`, or `week` with `field` and `unit`, or `calendar`.
#[derive(Debug, Clone, Default, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct TimeEntry {
    /// A timestamp that the container has for every message.
    pub container: Option<ContainerStamp>,
    /// A field of the message.
    pub field: Option<String>,
    /// Unit of its number.
    pub unit: Option<Tick>,
    /// Format of its text.
    pub text: Option<TimeText>,
    /// The GPS week; `field` is then the time in the week. If all weeks are below 1024, they are read as a ten-bit
    /// counter: the weeks nearest to the date of another clock of the log are used, otherwise those that end about a
    /// year after this release. Week 0 means no fix.
    pub week: Option<String>,
    /// With a week: a field of nanoseconds to add.
    pub nanos: Option<String>,
    /// Columns of year, month, day, hour, minute and second, and optionally of nanoseconds. The second may have a
    /// fraction.
    pub calendar: Option<Vec<String>>,
    /// With a calendar: a counter of the device. It dates rows without a date, or with a date more than a day away from
    /// most others.
    pub counter: Option<CounterEntry>,
    /// Column of a date: `yyyy-mm-dd`, `yyyy/mm/dd`, `yyyymmdd`, `yyyy-ddd`, `dd.mm.yyyy` or `dd-Mon-yyyy`. Dates such
    /// as `05/06/2021` or `050621` are ambiguous: the order is inferred from the column, or stated by `order`.
    pub date: Option<String>,
    /// With a date: the order of day, month and year.
    pub order: Option<DateOrder>,
    /// Column of a time of day, `hh:mm:ss`, or `hhmmss` if all its rows can be that.
    pub time: Option<String>,
    /// Column of the offset from UTC, `+hh:mm`.
    pub offset: Option<String>,
    /// Offset from UTC of all rows, `+hh:mm`, for dates that do not state their own. Default: UTC. It is a fixed
    /// offset, not a zone with daylight saving time.
    pub zone: Option<String>,
    /// Year in which the log begins, for days of the year without a year.
    pub year: Option<i16>,
    /// Width of a counter that wraps around to zero, bits. Default: 32.
    pub bits: Option<u32>,
    /// The clock; `unix` where text states the instant.
    pub clock: Option<ClockName>,
}

/// A counter of a device, of 32 bits or more.
#[derive(Debug, Clone, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct CounterEntry {
    /// The field.
    pub field: String,
    /// Unit of its number.
    pub unit: Tick,
}

/// A timestamp of the container.
#[derive(Debug, Clone, Copy, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum ContainerStamp {
    /// Time at which the message was written, according to the container.
    Logged,
    /// Time at which the message was published, according to the container.
    Published,
    /// Time at which the message was written, on the clock since boot. It is for messages without their own timestamp:
    /// they are placed between the messages that `[[utc]]` names with `utc = { container = "logged" }`.
    LoggedOnBoot,
}

/// A way to write an instant.
#[derive(Debug, Clone, Copy, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum TimeText {
    /// `2024-05-10T17:27:44.30Z`; UTC if it has no zone.
    #[serde(rename = "iso-8601")]
    Iso8601,
    /// Day of the year and time, as in IRIG time codes: `131:17:27:44.300000`, or with the year before it. Without a
    /// year the clock is `elapsed`, since the beginning of an unknown year.
    DayOfYear,
    /// `17:27:44.300` or `172744.300` on an unknown day: the clock is `elapsed`, since midnight.
    TimeOfDay,
}

/// A clock.
#[derive(Debug, Clone, Copy, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum ClockName {
    /// UTC since 1970.
    Unix,
    /// GPS time since 1980.
    Gps,
    /// Time since the device was switched on.
    Boot,
    /// Time since an unknown start.
    Elapsed,
    /// Atomic time since 1970, as in PTP (IEEE 1588): it includes leap seconds.
    Tai,
    /// UTC since 1904, as in LabVIEW.
    Labview,
    /// UTC in days since 1899-12-30, as in spreadsheets.
    Excel,
    /// UTC in days since the year 0, as MATLAB's `datenum`.
    Matlab,
    /// UTC as the modified Julian date, in days.
    ModifiedJulian,
    /// UTC as the Julian date, in days. Its resolution as a double is 20 µs at best.
    Julian,
}

/// Axes of a source.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum FrameName {
    /// For a vector: x forward, y right, z down.
    Frd,
    /// For a vector: x forward, y left, z up (ROS REP 103; Xsens).
    Flu,
    /// For an attitude: it rotates forward, right, down to north, east, down.
    FrdNed,
    /// For an attitude: it rotates forward, left, up to east, north, up (ROS REP 103).
    FluEnu,
    /// For an attitude: it rotates forward, left, up to north, west, up (Xsens until 2012).
    FluNwu,
    /// For an attitude: it rotates forward, left, up to north, east, down.
    FluNed,
    /// For a position or a velocity: earth-centred, earth-fixed (WGS-84).
    Ecef,
}

/// Reference of a height.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum HeightAbove {
    /// The WGS-84 ellipsoid.
    Ellipsoid,
    /// Mean sea level: used unchanged, with a notice.
    MeanSeaLevel,
}

/// One channel.
#[derive(Debug, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct ChannelEntry {
    /// Name of the form `quantity.source`, such as `position.gps`.
    pub name: String,
    /// Its quantity. It has these fields:
    ///
    /// - `position-geodetic`: `latitude`, `longitude` and optionally `height`; or `x`, `y`, `z` with the frame `ecef`
    /// - `position-ned`: `north`, `east` or `west`, and optionally `down` or `up`
    /// - `velocity-ned`: `north`, `east`; or `speed`, `track` and optionally `variation`; or `forward`, `left`, `up` and
    ///   the orientation; or `x`, `y`, `z` with the frame `ecef` and the position `at_x`, `at_y`, `at_z`
    /// - `height`: `height`
    /// - `attitude`: `orientation_w` to `orientation_z`, a quaternion that need not be normalised, or `roll`, `pitch` and
    ///   `yaw`; with `frame`
    /// - `angular-rate`, `specific-force`, `magnetic-field`, `magnetic-direction`: `x`, `y`, `z` with `frame`; or
    ///   `forward`, `right` or `left`, `down` or `up`. An axis may be missing
    /// - `encoder-count`: `count`; `encoder-angle`: `angle`; `scalar`: `value`
    /// - `pulse`: `second`, a time or a running number
    pub quantity: Quantity,
    /// Topic names, the best first. A name of several words also matches below a namespace. It also matches a file name
    /// that ends in it, with `/` written as `-` or `_`, and with an instance such as `_0` after it.
    #[serde(default)]
    pub topic: Vec<String>,
    /// Message types, such as `sensor_msgs/NavSatFix`. Without a topic, any topic of the type matches; without either,
    /// any text table.
    #[serde(default, rename = "type")]
    pub types: Vec<String>,
    /// Kind of timestamp that is the time of the value.
    pub timeline: StampKind,
    /// Timestamps of this channel, instead of those of the file.
    pub time: Option<TimeTable>,
    /// The fields.
    pub fields: FieldTable,
    /// Conditions on a row.
    #[serde(default)]
    pub require: Vec<RequireEntry>,
    /// Axes of `x`, `y`, `z`, or of an attitude.
    pub frame: Option<FrameName>,
    /// Reference of the height.
    pub height_above: Option<HeightAbove>,
    /// An assumption that readers of the report should know.
    pub note: Option<String>,
    /// Whether logs of this kind may lack the channel. If false, a missing field is an error, except in built-in maps.
    #[serde(default)]
    pub optional: bool,
    /// A remark of the log that selects the channel. Of channels with the same name and the same remark, at most one is
    /// used.
    pub when: Option<WhenEntry>,
}

/// A remark in the log, such as a comment `// Coordinate system: NED` above a text table.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct WhenEntry {
    /// Text before the colon.
    pub remark: String,
    /// Text after the colon. Without it, the channel is for logs without this remark.
    pub says: Option<String>,
}

macro_rules! field_table {
    ($($(#[$about:meta])* $name:ident,)*) => {
        /// The fields of a channel. Each is one field with its unit, or a list of them. The first one that exists is
        /// read. A height that is zero in every row is used only if all other heights are zero or missing.
        #[derive(Debug, Default, Deserialize)]
        #[cfg_attr(feature = "schema", derive(JsonSchema))]
        #[serde(deny_unknown_fields, default)]
        pub struct FieldTable {
            $($(#[$about])* pub $name: Option<OneOrMore<FieldEntry>>,)*
        }

        impl FieldTable {
            /// Every field by its name, written or not.
            pub fn all(&self) -> impl Iterator<Item = (&'static str, &Option<OneOrMore<FieldEntry>>)> {
                [$((stringify!($name), &self.$name),)*].into_iter()
            }
        }
    };
}

field_table! {
    /// Latitude, positive north.
    latitude,
    /// Longitude, positive east.
    longitude,
    /// Height, positive up.
    height,
    /// North.
    north,
    /// East; instead of `west`.
    east,
    /// West; instead of `east`.
    west,
    /// Down; instead of `up`. In body axes: along the downward axis.
    down,
    /// Up; instead of `down`. In body axes: along the upward axis.
    up,
    /// Speed over ground.
    speed,
    /// Direction of travel, clockwise from north: from true north, or with `variation` from magnetic north.
    track,
    /// Magnetic variation, positive east: true track = magnetic track + variation.
    variation,
    /// Along the body's forward axis.
    forward,
    /// Along the body's left axis; instead of `right`.
    left,
    /// Along the body's right axis; instead of `left`.
    right,
    /// Along or about the first axis of `frame`.
    x,
    /// Along or about the second axis of `frame`.
    y,
    /// Along or about the third axis of `frame`.
    z,
    /// With a velocity in the frame `ecef`: position along the first axis.
    at_x,
    /// Position along the second axis.
    at_y,
    /// Position along the third axis.
    at_z,
    /// Rotation about the first axis of `frame`, the last of the three (3-2-1).
    roll,
    /// Rotation about the second axis of `frame`, the second of the three.
    pitch,
    /// Rotation about the third axis of `frame`, the first of the three.
    yaw,
    /// Counts of an encoder.
    count,
    /// Angle of an encoder.
    angle,
    /// Second of the device's clock at a pulse, or number of the pulse.
    second,
    /// Orientation: quaternion, x. For an attitude in the axes of `frame`, otherwise of the body (forward, left, up) in
    /// east, north, up.
    orientation_x,
    /// Quaternion, y.
    orientation_y,
    /// Quaternion, z.
    orientation_z,
    /// Quaternion, scalar part.
    orientation_w,
    /// Value of a scalar.
    value,
}

/// One entry, or a list of them. An untagged enum of serde would not report which line is wrong, and why.
#[derive(Debug, Clone)]
pub struct OneOrMore<T>(pub Vec<T>);

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
pub struct FieldEntry {
    /// Dotted path.
    pub field: String,
    /// Unit, such as `deg`, `1e-7 deg`, `m`, `mm`, `ft`, `m/s`, `kt`, `ft/min`; `1` for a pure number.
    #[serde(deserialize_with = "unit")]
    #[cfg_attr(feature = "schema", schemars(with = "String"))]
    pub unit: Unit,
    /// For a height: its reference, if it differs from that of the channel.
    pub above: Option<HeightAbove>,
}

/// A condition on a row. Rows that fail it are counted, but not used. The condition is ignored if the log does not have
/// the field, or if the other topics do not have the epoch. If an epoch has several messages, all must meet the
/// condition.
#[derive(Debug, Clone, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct RequireEntry {
    /// The field.
    pub field: String,
    /// Topics that have the field in a message of the same epoch, instead of the row itself.
    #[serde(default)]
    pub of: Vec<String>,
    /// With other topics: the field that numbers the epochs in both. It may be several fields together, such as the
    /// week and the time in it.
    #[serde(default)]
    pub same: OneOrMore<String>,
    /// Its minimum value.
    pub min: Option<f64>,
    /// Its maximum value.
    pub max: Option<f64>,
    /// A bit that must be set; 0 is the lowest.
    pub bit: Option<u32>,
}

/// Parses a unit; an unknown one is rejected with its line.
fn unit<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Unit, D::Error> {
    String::deserialize(deserializer)?.parse().map_err(D::Error::custom)
}

/// The JSON schema of a channel map, for editors.
#[cfg(feature = "schema")]
#[must_use]
pub fn channel_map_schema() -> String {
    let schema = schemars::schema_for!(MapFile);
    let text = serde_json::to_string_pretty(&schema).unwrap_or_default();
    format!("{text}\n")
}
