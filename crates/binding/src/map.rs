//! Resolved channel maps: checked, with units and patterns parsed.

use crate::definitions::Definitions;
use crate::error::IngestError;
use flight::{Clock, Dimension, GPS_EPOCH_UNIX_S, Quantity, StampKind, TAI_LESS_GPS_S, Unit};
use formats::civil::{DateOrder, Tick, offset_seconds};
use formats::{FieldRequest, Select, Selection, TopicInfo, ValueKind};
use logscan::ScanError;
use map_file::{
    ChannelEntry, ClockName, ContainerStamp, FieldEntry, FieldTable, FrameName, HeightAbove, MapFile, OneOrMore,
    RequireEntry, TimeEntry, TimeTable, TimeText, UtcEntry, WhenEntry,
};
use settings::{Refused, SettingsFile};
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// The commented example of a channel map: it uses every key.
pub const EXAMPLE_MAP: &str = pipelines::EXAMPLE_MAP;

/// The channel maps built into flightlag.
const SHIPPED: &[(&str, &str)] = pipelines::CHANNEL_MAPS;

/// Whether a map of this name is built into flightlag.
pub fn is_shipped(name: &str) -> bool {
    SHIPPED.iter().any(|(file, _)| Path::new(file).file_stem().is_some_and(|stem| stem == name) || *file == name)
}

/// Defines which topics and fields of a kind of log become which channels.
///
/// Its debug text shows every resolved rule, not the text of the file: two files that differ only in comments and
/// spaces give the same.
#[derive(Clone)]
pub struct ChannelMap {
    /// Short name.
    pub name: String,
    /// One line for the user.
    pub title: String,
    pub(crate) rules: Vec<ChannelRule>,
    pub(crate) ties: Vec<TieRule>,
    /// Whether it fits any log with certain types.
    pub(crate) generic: bool,
    /// Channels without which it fits no log.
    pub(crate) needs: Vec<String>,
    /// Channels that a log of its kind need not have.
    pub(crate) optional: Vec<String>,
    /// Whether it is built into flightlag.
    pub shipped: bool,
    text: String,
}

impl fmt::Debug for ChannelMap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ChannelMap { name, title, rules, ties, generic, needs, optional, shipped: _, text: _ } = self;
        let mut debug = f.debug_struct("ChannelMap");
        debug.field("name", name).field("title", title).field("rules", rules);
        // Omitted if empty, so that other maps keep their cache keys.
        if !ties.is_empty() {
            debug.field("ties", ties);
        }
        if *generic {
            debug.field("generic", generic);
        }
        if !needs.is_empty() {
            debug.field("needs", needs);
        }
        if !optional.is_empty() {
            debug.field("optional", optional);
        }
        debug.finish()
    }
}

/// Name and title.
impl fmt::Display for ChannelMap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({})", self.name, self.title)
    }
}

/// How one channel is made.
#[derive(Debug, Clone)]
pub(crate) struct ChannelRule {
    pub(crate) name: String,
    pub(crate) quantity: Quantity,
    pub(crate) topics: Vec<String>,
    pub(crate) types: Vec<String>,
    pub(crate) timeline: StampKind,
    /// The sources of each kind in order of preference.
    pub(crate) times: [(StampKind, Vec<TimeSource>); 3],
    pub(crate) combine: Combine,
    pub(crate) parts: Vec<Part>,
    pub(crate) require: Vec<RequireEntry>,
    pub(crate) note: Option<String>,
    pub(crate) when: Option<WhenEntry>,
}

/// One number of a channel.
#[derive(Debug, Clone)]
pub(crate) struct Part {
    pub(crate) role: &'static str,
    /// What follows if the log lacks it.
    pub(crate) presence: Presence,
    /// The log has the opposite sign: up for down, west for east, left for right.
    pub(crate) opposite: bool,
    /// The first existing field is read; if it is zero throughout, the next one that is not.
    pub(crate) fields: Vec<Source>,
}

/// A field that a part may be read from.
#[derive(Debug, Clone)]
pub(crate) struct Source {
    pub(crate) path: String,
    pub(crate) unit: Unit,
    /// For a height: what it is above.
    pub(crate) above: Option<HeightAbove>,
}

/// Channel names for columns without a source in their name, in a table that also has GPS columns. They come from
/// another source, usually a faster one.
pub(crate) const PLAIN: [&str; 2] = ["position.plain", "velocity.plain"];

/// Quantities that only a bench measures, in addition to position and velocity.
pub(crate) const BENCH_ALONE: &[Quantity] = &[
    Quantity::Height,
    Quantity::Attitude,
    Quantity::AngularRate,
    Quantity::SpecificForce,
    Quantity::MagneticField,
    Quantity::MagneticDirection,
    Quantity::EncoderCount,
    Quantity::EncoderAngle,
    Quantity::Pulse,
];

/// What happens to a channel without one of its parts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Presence {
    /// There is no channel.
    Required,
    /// The channel exists: heights and vertical speeds. One that most rows lack is dropped as if the log had none.
    Vertical,
    /// The channel exists if it has one of the other axes.
    Axis,
    /// There is no channel. A row without it is still valid where the first part is zero: no motion needs no direction.
    Direction,
}

/// How parts, in SI units and in this order, become the components of a channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Combine {
    /// The parts are the components.
    AsIs,
    /// Speed, true track, down.
    Polar,
    /// Speed, magnetic track, variation, down.
    MagneticPolar,
    /// Forward, left, up, and the quaternion x, y, z, w that rotates them to east, north, up.
    Body,
    /// A position: x, y, z in earth-fixed axes.
    EcefPlace,
    /// A velocity: x, y, z in earth-fixed axes, followed by those of its position.
    EcefVelocity,
    /// Quaternion w, x, y, z.
    Quaternion(AttitudeFrame),
    /// Roll, pitch, yaw: rotates by yaw about the third axis, then pitch about the second, then roll about the first.
    Euler(AttitudeFrame),
}

/// The two frames of an attitude. All others are converted to the first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AttitudeFrame {
    /// Forward, right, down to north, east, down.
    FrdNed,
    /// Forward, left, up to east, north, up.
    FluEnu,
    /// Forward, left, up to north, west, up.
    FluNwu,
    /// Forward, left, up to north, east, down.
    FluNed,
}

/// The source of timestamps.
#[derive(Debug, Clone)]
pub(crate) enum TimeSource {
    ContainerLogged,
    ContainerPublished,
    /// The container's timestamps on the clock since boot.
    LoggedOnBoot,
    Number {
        field: String,
        tick: Tick,
        clock: Clock,
        /// The zero of the number, in seconds of the clock.
        zero_s: i64,
        /// For a counter that wraps around to zero.
        bits: u32,
    },
    GpsWeek {
        week: String,
        field: String,
        tick: Tick,
        /// A field of nanoseconds to be added.
        nanos: Option<String>,
    },
    Iso {
        field: String,
        /// The UTC offset of text without one.
        zone: Option<String>,
    },
    /// As text without a zone that counts GPS time, without leap seconds.
    GpsText {
        field: String,
    },
    Civil {
        date: String,
        time: String,
        offset: Option<String>,
        zone: Option<String>,
        /// For ambiguous dates; `None` if the dates themselves must show it.
        order: Option<DateOrder>,
        /// They count GPS time, without leap seconds.
        is_gps: bool,
    },
    /// Year, month, day, hour, minute, second, and optionally nanoseconds.
    Calendar {
        fields: Vec<String>,
        zone: Option<String>,
        /// A counter of the device that dates rows without a date.
        counter: Option<(String, Tick)>,
    },
    DayOfYear {
        field: String,
        /// For the first row, if no row states it.
        year: Option<i16>,
        zone: Option<String>,
    },
    TimeOfDay {
        field: String,
    },
}

/// What ties the clock since boot to UTC.
#[derive(Debug, Clone)]
pub(crate) struct TieRule {
    pub(crate) topics: Vec<String>,
    pub(crate) types: Vec<String>,
    pub(crate) clock: Clock,
    pub(crate) stamp: TimeSource,
    pub(crate) utc: TimeSource,
    pub(crate) require: Vec<RequireEntry>,
}

impl TieRule {
    /// How closely `topic` meets this rule; `None` if it does not.
    pub(crate) fn meets(&self, topic: &TopicInfo) -> Option<Closeness> {
        closeness(&self.topics, &self.types, topic)
    }

    /// The fields to decode for it.
    fn requests(&self) -> impl Iterator<Item = FieldRequest> {
        let require = self.require.iter().map(|r| number(&r.field));
        [&self.stamp, &self.utc].into_iter().flat_map(TimeSource::requests).chain(require)
    }
}

/// How closely a topic meets a rule; smaller is better.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Closeness {
    /// The index of the matching name or type in the rule.
    pub(crate) choice: usize,
    /// 0 for the exact name, 1 below a namespace or after a prefix.
    pub(crate) distance: u8,
    /// Instance of the topic, as in `vehicle_gps_position_1`.
    pub(crate) instance: u32,
}

/// How a rule names its topic: the more specific rule wins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Specificity {
    AnyTable,
    ByType,
    ByName,
}

impl ChannelRule {
    pub(crate) fn specificity(&self) -> Specificity {
        specificity(&self.topics, &self.types)
    }

    /// How closely `topic` meets this rule; `None` if it does not.
    pub(crate) fn meets(&self, topic: &TopicInfo) -> Option<Closeness> {
        closeness(&self.topics, &self.types, topic)
    }

    /// Whether it takes the same channel from the same fields.
    pub(crate) fn has_names_of(&self, other: &ChannelRule) -> bool {
        let paths = |rule: &ChannelRule| -> Vec<String> {
            rule.parts.iter().flat_map(|part| &part.fields).map(|field| field.path.clone()).collect()
        };
        let same =
            |rule: &ChannelRule| (rule.name.clone(), rule.topics.clone(), rule.types.clone(), rule.time_fields());
        same(self) == same(other) && paths(self) == paths(other)
    }

    /// The fields that can each date its rows.
    pub(crate) fn time_fields(&self) -> Vec<String> {
        let sources = self.times.iter().flat_map(|(_, sources)| sources);
        sources.flat_map(TimeSource::requests).map(|request| request.path).collect()
    }

    /// Whether the container may date its rows.
    pub(crate) fn may_be_timed_by_container(&self) -> bool {
        let of_container = |source: &TimeSource| source.requests().is_empty();
        self.times.iter().flat_map(|(_, sources)| sources).any(of_container)
    }

    /// The fields to decode of another topic, for conditions on messages of the same epoch.
    fn requests_of<'r>(&'r self, topic: &'r TopicInfo) -> impl Iterator<Item = FieldRequest> + 'r {
        let require = self.require.iter().filter(|r| r.of.contains(&topic.name));
        require.flat_map(|r| std::iter::once(&r.field).chain(&r.same.0).map(|path| number(path)))
    }

    /// The fields to decode for it.
    pub(crate) fn requests(&self) -> impl Iterator<Item = FieldRequest> {
        let parts = self.parts.iter().flat_map(|p| &p.fields).map(|source| number(&source.path));
        let require =
            self.require.iter().flat_map(|r| if r.of.is_empty() { std::slice::from_ref(&r.field) } else { &r.same.0 });
        let require = require.map(|path| number(path));
        let times = self.times.iter().flat_map(|(_, sources)| sources).flat_map(TimeSource::requests);
        parts.chain(require).chain(times)
    }
}

fn number(path: &str) -> FieldRequest {
    FieldRequest { path: path.to_owned(), kind: ValueKind::Number }
}

fn text(path: &str) -> FieldRequest {
    FieldRequest { path: path.to_owned(), kind: ValueKind::Text }
}

fn specificity(topics: &[String], types: &[String]) -> Specificity {
    match (topics.is_empty(), types.is_empty()) {
        (false, _) => Specificity::ByName,
        (true, false) => Specificity::ByType,
        (true, true) => Specificity::AnyTable,
    }
}

/// How closely a topic meets the names and types of a rule.
fn closeness(topics: &[String], types: &[String], topic: &TopicInfo) -> Option<Closeness> {
    let text = topic.encoding == "csv";
    let type_name = if types.is_empty() { String::new() } else { plain_type(&topic.type_name) };
    let type_choice = types.iter().position(|t| type_name == *t);
    match specificity(topics, types) {
        Specificity::AnyTable => text.then_some(Closeness { choice: 0, distance: 0, instance: 0 }),
        Specificity::ByType => type_choice.map(|choice| Closeness { choice, distance: 0, instance: 0 }),
        Specificity::ByName if type_choice.is_none() && !types.is_empty() && !topic.type_name.is_empty() => None,
        Specificity::ByName => topics.iter().enumerate().find_map(|(choice, pattern)| {
            let (distance, instance, _) = match topic.encoding.as_str() {
                "csv" => stem_matches(&topic.name, pattern)?,
                "ulog" => instance_matches(topic, pattern)?,
                _ => topic_matches(&topic.name, pattern)?,
            };
            Some(Closeness { choice, distance, instance })
        }),
    }
}

impl TimeSource {
    /// The clock of its timestamps, as far as the map knows it.
    pub(crate) fn clock(&self) -> Clock {
        match self {
            TimeSource::Number { clock, .. } => *clock,
            TimeSource::GpsWeek { .. } | TimeSource::GpsText { .. } | TimeSource::Civil { is_gps: true, .. } => {
                Clock::Gps
            }
            TimeSource::DayOfYear { year: None, .. } | TimeSource::TimeOfDay { .. } => Clock::Elapsed,
            TimeSource::LoggedOnBoot => Clock::Boot,
            _ => Clock::Unix,
        }
    }

    /// Its name in the health of the timestamps.
    pub(crate) fn label(&self) -> String {
        match self {
            TimeSource::ContainerLogged => "log".into(),
            TimeSource::ContainerPublished => "publish".into(),
            TimeSource::LoggedOnBoot => "log, on the clock since boot".into(),
            TimeSource::Number { field, .. }
            | TimeSource::Iso { field, .. }
            | TimeSource::GpsText { field }
            | TimeSource::DayOfYear { field, .. }
            | TimeSource::TimeOfDay { field } => field.clone(),
            TimeSource::GpsWeek { week, field, .. } => format!("{week}, {field}"),
            TimeSource::Civil { date, time, .. } => format!("{date}, {time}"),
            TimeSource::Calendar { fields, .. } => fields.join(", "),
        }
    }

    fn requests(&self) -> Vec<FieldRequest> {
        match self {
            TimeSource::ContainerLogged | TimeSource::ContainerPublished | TimeSource::LoggedOnBoot => vec![],
            // Text keeps every digit of a decimal fraction.
            TimeSource::Number { field, tick: Tick::TenthMillis | Tick::Micros | Tick::Nanos, .. } => {
                vec![number(field)]
            }
            TimeSource::GpsWeek { week, field, tick, nanos } => {
                let in_week = if *tick == Tick::Seconds { text(field) } else { number(field) };
                [number(week), in_week].into_iter().chain(nanos.as_deref().map(number)).collect()
            }
            TimeSource::Calendar { fields, counter, zone: _ } => {
                let counter = counter.iter().map(|(field, _)| field);
                fields.iter().chain(counter).map(|field| number(field)).collect()
            }
            TimeSource::Number { field, .. }
            | TimeSource::Iso { field, .. }
            | TimeSource::GpsText { field }
            | TimeSource::DayOfYear { field, .. }
            | TimeSource::TimeOfDay { field } => vec![text(field)],
            TimeSource::Civil { date, time, offset, .. } => {
                [date, time].into_iter().chain(offset).map(|field| text(field)).collect()
            }
        }
    }
}

/// `sensor_msgs/msg/NavSatFix`, `sensor_msgs::msg::NavSatFix` and `sensor_msgs.NavSatFix` (protobuf) are
/// `sensor_msgs/NavSatFix`.
fn plain_type(name: &str) -> String {
    name.replace("::", "/").replace('.', "/").replace("/msg/", "/")
}

/// Distance, instance and number of bytes before the match. A single word such as `/velocity` ends too many names to
/// match below a namespace.
fn topic_matches(name: &str, pattern: &str) -> Option<(u8, u32, usize)> {
    let front = name.len().checked_sub(pattern.len())?;
    let several_words = pattern.trim_start_matches('/').contains('/');
    let at_boundary = front == 0 || (several_words && (pattern.starts_with('/') || name.get(..front)?.ends_with('/')));
    (name.ends_with(pattern) && at_boundary).then_some((u8::from(front > 0), 0, front))
}

/// A ULog topic is named after its type, followed by the instance if it is not the first.
fn instance_matches(topic: &TopicInfo, pattern: &str) -> Option<(u8, u32, usize)> {
    if topic.name == pattern {
        return Some((0, 0, 0));
    }
    let instance = topic.name.strip_prefix(pattern)?.strip_prefix('_')?.parse().ok()?;
    (topic.type_name == pattern).then_some((0, instance, 0))
}

/// A file stem is a topic name with `/` written as `-` or `_`, after a prefix and optionally followed by an instance.
fn stem_matches(stem: &str, pattern: &str) -> Option<(u8, u32, usize)> {
    let pattern = pattern.trim_start_matches('/');
    // Every name of every map is compared with every file, and nearly all of them have another ending.
    let before = stem.rsplit_once(['/', '-', '_']).map_or(stem, |(before, _)| before);
    if !ends_alike(stem, pattern) && !ends_alike(before, pattern) {
        return None;
    }
    let plain = |text: &str| text.replace(['/', '-'], "_");
    let pattern = plain(pattern);
    let whole = plain(stem);
    let (base, instance) = match whole.rsplit_once('_') {
        // A single word with a number, such as gps_105, could be the name of anything.
        Some((base, digits)) if base.ends_with(&pattern) && pattern.contains('_') => match digits.parse() {
            Ok(instance) => (base, instance),
            Err(_) => (whole.as_str(), 0),
        },
        _ => (whole.as_str(), 0),
    };
    let front = base.len().checked_sub(pattern.len())?;
    let at_boundary = front == 0 || base.get(..front)?.ends_with('_');
    let is_specific = front == 0 || pattern.contains('_');
    (base.ends_with(&pattern) && at_boundary && is_specific).then_some((u8::from(front > 0), instance, front))
}

/// Whether a name ends with another, regardless of the separators between words.
fn ends_alike(name: &str, end: &str) -> bool {
    let plain = |byte| if matches!(byte, b'/' | b'-') { b'_' } else { byte };
    let last = name.bytes().rev().take(end.len());
    last.map(plain).eq(end.bytes().rev().map(plain))
}

/// All available channel maps, and definitions of messages for logs that lack them. The default has no map, which is
/// enough to read a log with known fields.
#[derive(Debug, Clone, Default)]
pub struct MapLibrary {
    maps: Vec<ChannelMap>,
    definitions: Definitions,
}

impl MapLibrary {
    /// The built-in maps.
    ///
    /// # Errors
    /// [`IngestError::BadMap`]; a test ensures that this does not happen.
    pub fn shipped() -> Result<MapLibrary, IngestError> {
        // Parsed once in a process.
        static PARSED: OnceLock<MapLibrary> = OnceLock::new();
        if let Some(library) = PARSED.get() {
            return Ok(library.clone());
        }
        let mut library = MapLibrary::default();
        for (name, text) in SHIPPED {
            library.add(ChannelMap { shipped: true, ..ChannelMap::from_toml(Path::new(name), text)? });
        }
        Ok(PARSED.get_or_init(|| library).clone())
    }

    /// Adds the `*.toml` of a folder, and the definitions `PACKAGE/msg/TYPE.msg` in it and below it; a map replaces a
    /// built-in one of the same name.
    ///
    /// # Errors
    /// [`IngestError::Log`] or [`IngestError::BadMap`], also if two maps of the folder have one name;
    /// [`IngestError::Map`] for an invalid definition.
    pub fn with_folder(mut self, folder: &Path) -> Result<MapLibrary, IngestError> {
        let failed =
            |source| IngestError::from(ScanError::Io { file: folder.display().to_string(), offset: 0, source });
        if folder.is_file() {
            let above = folder.parent().filter(|above| !above.as_os_str().is_empty()).unwrap_or(Path::new("."));
            let (file, above) = (folder.display(), above.display());
            return Err(IngestError::Map(format!("{file} is a file; --maps takes the folder: --maps {above}")));
        }
        let mut paths: Vec<PathBuf> = vec![];
        for entry in std::fs::read_dir(folder).map_err(failed)? {
            paths.push(entry.map_err(failed)?.path());
        }
        paths.retain(|p| p.extension().is_some_and(|e| e == "toml"));
        paths.sort();
        let mut files: BTreeMap<String, PathBuf> = BTreeMap::new();
        for path in paths {
            let text = std::fs::read_to_string(&path).map_err(failed)?;
            let map = ChannelMap::from_toml(&path, &text)?;
            if let Some(first) = files.insert(map.name.clone(), path.clone()) {
                let what =
                    format!("{:?} is also the name of {}: rename one of the two maps", map.name, first.display());
                return Err(IngestError::BadMap { path, line: None, what });
            }
            self.add(map);
        }
        self.definitions.add_folder(folder)?;
        Ok(self)
    }

    /// Names of the channels that a flight can have by these maps, or by a guess if none fits.
    pub fn channel_names(&self) -> impl Iterator<Item = &str> {
        self.iter().flat_map(ChannelMap::channel_names).chain(PLAIN)
    }

    /// Adds a map, or replaces the one of the same name.
    pub fn add(&mut self, map: ChannelMap) {
        match self.maps.iter_mut().find(|m| m.name == map.name) {
            Some(old) => *old = map,
            None => self.maps.push(map),
        }
    }

    /// The maps, in the order in which they are tried.
    pub fn iter(&self) -> impl Iterator<Item = &ChannelMap> {
        self.maps.iter()
    }

    /// The map with a name.
    ///
    /// # Errors
    /// [`IngestError::Map`] with the names that exist.
    pub fn get(&self, name: &str) -> Result<&ChannelMap, IngestError> {
        self.maps.iter().find(|m| m.name == name).ok_or_else(|| {
            let near = settings::nearest_few(name, self.maps.iter().map(|m| m.name.as_str()), 5);
            let near = near.join(", ");
            IngestError::Map(format!("there is no channel map {name:?}; the nearest are {near} (all: flightlag maps)"))
        })
    }

    /// The fields wanted from a log: by all maps, or by the forced one.
    ///
    /// # Errors
    /// As [`MapLibrary::get`].
    pub fn select(&self, forced: Option<&str>) -> Result<MapSelect<'_>, IngestError> {
        Ok(MapSelect { maps: self.candidates(forced)?, definitions: &self.definitions })
    }

    /// Wants everything in a log.
    #[must_use]
    pub fn select_all(&self) -> SelectAll<'_> {
        SelectAll(&self.definitions)
    }

    /// The given definitions: type and text.
    pub fn definitions(&self) -> impl Iterator<Item = (&str, &str)> {
        self.definitions.iter()
    }

    pub(crate) fn candidates(&self, forced: Option<&str>) -> Result<Vec<&ChannelMap>, IngestError> {
        forced.map_or_else(|| Ok(self.maps.iter().collect()), |name| Ok(vec![self.get(name)?]))
    }

    /// The prefix before the topic name in the stem of a file with one topic of a flight. `None` if no map names such a
    /// topic; `sensed` includes bench topics.
    pub fn flight_prefix<'a>(&self, stem: &'a str, sensed: bool) -> Option<&'a str> {
        let rules = self.maps.iter().flat_map(|m| &m.rules).filter(|r| sensed || !BENCH_ALONE.contains(&r.quantity));
        let front =
            rules.flat_map(|r| &r.topics).filter_map(|p| stem_matches(stem, p)).map(|(_, _, front)| front).min()?;
        stem.get(..front)
    }
}

/// The topics and fields that some channel maps want.
#[derive(Debug)]
pub struct MapSelect<'a> {
    maps: Vec<&'a ChannelMap>,
    definitions: &'a Definitions,
}

impl<'a> MapSelect<'a> {
    /// The fields that one map wants.
    pub fn of(map: &'a ChannelMap) -> MapSelect<'a> {
        static NONE: std::sync::OnceLock<Definitions> = std::sync::OnceLock::new();
        MapSelect { maps: vec![map], definitions: NONE.get_or_init(Definitions::default) }
    }
}

impl Select for MapSelect<'_> {
    fn select(&self, topic: &TopicInfo) -> Selection {
        let rules = self.maps.iter().flat_map(|m| &m.rules);
        let ties = self.maps.iter().flat_map(|m| &m.ties);
        let mut fields: Vec<FieldRequest> =
            rules.clone().filter(|r| r.meets(topic).is_some()).flat_map(ChannelRule::requests).collect();
        fields.extend(rules.flat_map(|r| r.requests_of(topic)));
        fields.extend(ties.filter(|t| t.meets(topic).is_some()).flat_map(TieRule::requests));
        fields.sort();
        fields.dedup();
        if fields.is_empty() { Selection::Skip } else { Selection::Fields(fields) }
    }

    fn definition(&self, type_name: &str) -> Option<&str> {
        self.definitions.of(type_name)
    }
}

/// Wants all topics and fields of a log; missing definitions come from a library.
#[derive(Debug)]
pub struct SelectAll<'a>(&'a Definitions);

impl Select for SelectAll<'_> {
    fn select(&self, _: &TopicInfo) -> Selection {
        Selection::All
    }

    fn definition(&self, type_name: &str) -> Option<&str> {
        self.0.of(type_name)
    }
}

impl ChannelMap {
    /// Reads and checks a map.
    ///
    /// # Errors
    /// [`IngestError::BadMap`] with the line and the error.
    pub fn from_toml(path: &Path, text: &str) -> Result<ChannelMap, IngestError> {
        let file = SettingsFile::new(text, path);
        let map = map_file::read(&file).and_then(|written| meaning_of(written, &file, text));
        file.finish(map).map_err(|e| IngestError::BadMap { path: path.to_owned(), line: e.line, what: e.what })
    }

    /// Names of the channels that it can bind, such as `position.gps`.
    pub fn channel_names(&self) -> impl Iterator<Item = &str> {
        self.rules.iter().map(|rule| rule.name.as_str())
    }

    /// The TOML text of the map, including comments: a template for the user's own map.
    #[must_use]
    pub fn text(&self) -> &str {
        &self.text
    }
}

/// Resolves the map in a file.
fn meaning_of(written: MapFile, file: &SettingsFile<'_>, text: &str) -> Result<ChannelMap, Refused> {
    if *written.schema.get_ref() != 1 {
        let what = format!("schema {} is unknown; use schema = 1", written.schema.get_ref());
        return Err(file.reject(&written.schema, what));
    }
    let rules = rules_of(&written, file);
    let mut ties = Ok(vec![]);
    for entry in &written.utc {
        match (tie_rule(entry.get_ref()), &mut ties) {
            (Err(what), _) => ties = Err(file.reject(entry, format!("utc: {what}"))),
            (Ok(rule), Ok(ties)) => ties.push(rule),
            (Ok(_), Err(Refused)) => {}
        }
    }
    let is_missing =
        |name: &&toml::Spanned<String>| written.channel.iter().all(|c| c.get_ref().name != **name.get_ref());
    if let Some(name) = written.needs.iter().find(is_missing) {
        return Err(file.reject(name, format!("needs: the map has no channel {}", name.get_ref())));
    }
    let MapFile { name, title, generic, needs, channel, .. } = written;
    let needs = needs.into_iter().map(toml::Spanned::into_inner).collect();
    let optional = channel.into_iter().map(toml::Spanned::into_inner).filter(|entry| entry.optional);
    let optional = optional.map(|entry| entry.name).collect();
    let text = text.to_owned();
    Ok(ChannelMap { name, title, rules: rules?, ties: ties?, generic, needs, optional, shipped: false, text })
}

fn rules_of(written: &MapFile, file: &SettingsFile<'_>) -> Result<Vec<ChannelRule>, Refused> {
    let mut rules: Vec<ChannelRule> = vec![];
    let mut right = Ok(());
    for place in &written.channel {
        let entry = place.get_ref();
        match rule_of(entry, written) {
            Err(what) => right = Err(file.reject(place, format!("channel {}: {what}", entry.name))),
            Ok(rule)
                if rules.iter().any(|r| r.name == rule.name && !excludes(r, &rule) && !of_other_types(r, &rule)) =>
            {
                right = Err(file.reject(place, format!("channel {} is a duplicate", rule.name)));
            }
            Ok(rule) => rules.push(rule),
        }
    }
    right.map(|()| rules)
}

/// Whether a log never has both, because they need different values of a remark.
fn excludes(a: &ChannelRule, b: &ChannelRule) -> bool {
    a.when.as_ref().zip(b.when.as_ref()).is_some_and(|(a, b)| a.remark == b.remark && a.says != b.says)
}

/// Whether both are for named types without a common one.
fn of_other_types(a: &ChannelRule, b: &ChannelRule) -> bool {
    let by_type = |rule: &ChannelRule| rule.specificity() == Specificity::ByType;
    by_type(a) && by_type(b) && a.types.iter().all(|name| !b.types.contains(name))
}

fn rule_of(entry: &ChannelEntry, file: &MapFile) -> Result<ChannelRule, String> {
    let (combine, mut parts) = recipe(entry.quantity, &entry.fields, entry.frame)?;
    for part in &mut parts {
        let is_height = part.role == "height";
        if !is_height && part.fields.iter().any(|source| source.above.is_some()) {
            return Err(format!("{}: `above` is for heights only", part.role));
        }
        // For earth-fixed axes the height is computed.
        let above = entry.height_above.filter(|_| is_height);
        part.fields.iter_mut().for_each(|source| source.above = source.above.or(above));
    }
    let times = times_of(entry.time.as_ref().unwrap_or(&file.time))?;
    if times.iter().all(|(_, sources)| sources.is_empty()) {
        return Err("no source of timestamps".into());
    }
    for require in &entry.require {
        if require.min.is_none() && require.max.is_none() && require.bit.is_none() {
            return Err(format!("require {}: give min, max or bit", require.field));
        }
        if require.of.is_empty() != require.same.0.is_empty() {
            return Err(format!("require {}: `of` and `same` are used together", require.field));
        }
    }
    Ok(ChannelRule {
        name: entry.name.clone(),
        quantity: entry.quantity,
        topics: entry.topic.clone(),
        types: entry.types.iter().map(|t| plain_type(t)).collect(),
        timeline: entry.timeline,
        times,
        combine,
        parts,
        require: entry.require.clone(),
        note: entry.note.clone(),
        when: entry.when.clone(),
    })
}

/// Role, dimension and fields of a part, and what happens to the channel without it.
struct Slot<'a> {
    role: &'static str,
    dimension: Dimension,
    written: &'a Option<OneOrMore<FieldEntry>>,
    presence: Presence,
    opposite: bool,
}

fn slot<'a>(role: &'static str, dimension: Dimension, written: &'a Option<OneOrMore<FieldEntry>>) -> Slot<'a> {
    Slot { role, dimension, written, presence: Presence::Required, opposite: false }
}

/// A slot that the author may fill with the opposite sign.
fn either<'a>(this: Slot<'a>, opposite: Slot<'a>) -> Slot<'a> {
    if opposite.written.is_some() { Slot { opposite: true, ..opposite } } else { this }
}

/// The fields present determine how they combine.
fn recipe(quantity: Quantity, f: &FieldTable, frame: Option<FrameName>) -> Result<(Combine, Vec<Part>), String> {
    use Dimension::{Acceleration, Angle, AngularRate, Length, MagneticField, None as Pure, Time};
    let (combine, slots): (Combine, Vec<Slot<'_>>) = match quantity {
        Quantity::PositionGeodetic => place(f, frame),
        Quantity::PositionNed => (Combine::AsIs, north_east_down(f, Length)),
        Quantity::VelocityNed => velocity(f, frame),
        Quantity::Scalar => (Combine::AsIs, vec![slot("value", Pure, &f.value)]),
        Quantity::Height => (Combine::AsIs, vec![slot("height", Length, &f.height)]),
        Quantity::EncoderCount => (Combine::AsIs, vec![slot("count", Pure, &f.count)]),
        Quantity::EncoderAngle => (Combine::AsIs, vec![slot("angle", Angle, &f.angle)]),
        Quantity::Pulse => (Combine::AsIs, vec![slot("second", Time, &f.second)]),
        Quantity::Attitude => attitude(f, frame)?,
        Quantity::AngularRate => (Combine::AsIs, body_axes(f, AngularRate, frame)?),
        Quantity::SpecificForce => (Combine::AsIs, body_axes(f, Acceleration, frame)?),
        Quantity::MagneticField => (Combine::AsIs, body_axes(f, MagneticField, frame)?),
        Quantity::MagneticDirection => (Combine::AsIs, body_axes(f, Pure, frame)?),
    };
    if frame.is_some() && !slots.iter().any(|s| matches!(s.role, "x" | "y" | "z" | "orientation_w" | "roll")) {
        return Err("a frame is only for x, y and z, or for an attitude".into());
    }
    no_other_fields(f, &slots)?;
    let parts: Result<Vec<Part>, String> = slots.iter().map(part).collect();
    Ok((combine, parts?))
}

fn place(f: &FieldTable, frame: Option<FrameName>) -> (Combine, Vec<Slot<'_>>) {
    use Dimension::{Angle, Length};
    if frame == Some(FrameName::Ecef) {
        return (Combine::EcefPlace, xyz(f, Length).into());
    }
    let height = Slot { presence: Presence::Vertical, ..slot("height", Length, &f.height) };
    (Combine::AsIs, vec![slot("latitude", Angle, &f.latitude), slot("longitude", Angle, &f.longitude), height])
}

fn velocity(f: &FieldTable, frame: Option<FrameName>) -> (Combine, Vec<Slot<'_>>) {
    use Dimension::{Angle, Speed};
    let speed = || slot("speed", Speed, &f.speed);
    let track = || Slot { presence: Presence::Direction, ..slot("track", Angle, &f.track) };
    if frame == Some(FrameName::Ecef) {
        (Combine::EcefVelocity, ecef_velocity(f))
    } else if f.forward.is_some() {
        (Combine::Body, body_velocity(f))
    } else if f.variation.is_some() {
        let variation = slot("variation", Angle, &f.variation);
        (Combine::MagneticPolar, vec![speed(), track(), variation, vertical(f, Speed)])
    } else if f.speed.is_some() {
        (Combine::Polar, vec![speed(), track(), vertical(f, Speed)])
    } else {
        (Combine::AsIs, north_east_down(f, Speed))
    }
}

fn north_east_down(f: &FieldTable, dimension: Dimension) -> Vec<Slot<'_>> {
    let east = either(slot("east", dimension, &f.east), slot("west", dimension, &f.west));
    vec![slot("north", dimension, &f.north), east, vertical(f, dimension)]
}

fn vertical(f: &FieldTable, dimension: Dimension) -> Slot<'_> {
    let down = either(slot("down", dimension, &f.down), slot("up", dimension, &f.up));
    Slot { presence: Presence::Vertical, ..down }
}

fn ecef_velocity(f: &FieldTable) -> Vec<Slot<'_>> {
    use Dimension::{Length, Speed};
    let at = [slot("at_x", Length, &f.at_x), slot("at_y", Length, &f.at_y), slot("at_z", Length, &f.at_z)];
    xyz(f, Speed).into_iter().chain(at).collect()
}

fn xyz(f: &FieldTable, dimension: Dimension) -> [Slot<'_>; 3] {
    [slot("x", dimension, &f.x), slot("y", dimension, &f.y), slot("z", dimension, &f.z)]
}

fn body_velocity(f: &FieldTable) -> Vec<Slot<'_>> {
    use Dimension::{None as Pure, Speed};
    vec![
        slot("forward", Speed, &f.forward),
        slot("left", Speed, &f.left),
        slot("up", Speed, &f.up),
        slot("orientation_x", Pure, &f.orientation_x),
        slot("orientation_y", Pure, &f.orientation_y),
        slot("orientation_z", Pure, &f.orientation_z),
        slot("orientation_w", Pure, &f.orientation_w),
    ]
}

fn attitude(f: &FieldTable, frame: Option<FrameName>) -> Result<(Combine, Vec<Slot<'_>>), String> {
    use Dimension::{Angle, None as Pure};
    let frame = match frame {
        Some(FrameName::FrdNed) => AttitudeFrame::FrdNed,
        Some(FrameName::FluEnu) => AttitudeFrame::FluEnu,
        Some(FrameName::FluNwu) => AttitudeFrame::FluNwu,
        Some(FrameName::FluNed) => AttitudeFrame::FluNed,
        _ => return Err("an attitude needs a frame: frd-ned, flu-enu, flu-nwu or flu-ned".into()),
    };
    if f.roll.is_some() || f.pitch.is_some() || f.yaw.is_some() {
        let turns = [slot("roll", Angle, &f.roll), slot("pitch", Angle, &f.pitch), slot("yaw", Angle, &f.yaw)];
        return Ok((Combine::Euler(frame), turns.into()));
    }
    let quaternion = [
        slot("orientation_w", Pure, &f.orientation_w),
        slot("orientation_x", Pure, &f.orientation_x),
        slot("orientation_y", Pure, &f.orientation_y),
        slot("orientation_z", Pure, &f.orientation_z),
    ];
    Ok((Combine::Quaternion(frame), quaternion.into()))
}

/// Forward, right, down of the body, by name or as x, y, z of a frame.
fn body_axes(f: &FieldTable, dimension: Dimension, frame: Option<FrameName>) -> Result<Vec<Slot<'_>>, String> {
    let slots = if [&f.x, &f.y, &f.z].iter().any(|axis| axis.is_some()) {
        let opposite = match frame {
            Some(FrameName::Frd) => false,
            Some(FrameName::Flu) => true,
            _ => return Err("x, y and z need a frame: frd or flu".into()),
        };
        let [x, y, z] = xyz(f, dimension);
        [x, Slot { opposite, ..y }, Slot { opposite, ..z }]
    } else {
        [
            slot("forward", dimension, &f.forward),
            either(slot("right", dimension, &f.right), slot("left", dimension, &f.left)),
            either(slot("down", dimension, &f.down), slot("up", dimension, &f.up)),
        ]
    };
    if slots.iter().all(|s| s.written.is_none()) {
        return Err("no field: give x, y or z with a frame, or forward, right or left, down or up".into());
    }
    Ok(slots.into_iter().map(|s| Slot { presence: Presence::Axis, ..s }).collect())
}

/// A field that the recipe does not use is a mistake of the author.
fn no_other_fields(f: &FieldTable, slots: &[Slot<'_>]) -> Result<(), String> {
    let stray = f.all().find(|(name, field)| field.is_some() && slots.iter().all(|slot| slot.role != *name));
    stray.map_or(Ok(()), |(name, _)| Err(format!("the field {name} cannot be combined with the others")))
}

fn part(slot: &Slot<'_>) -> Result<Part, String> {
    let role = slot.role;
    let entries = match slot.written {
        None if matches!(slot.presence, Presence::Vertical | Presence::Axis) => vec![],
        None => return Err(format!("the field {role} is missing")),
        Some(OneOrMore(entries)) => entries.clone(),
    };
    let mut fields = vec![];
    for entry in entries {
        let unit = entry.unit;
        let numbered = role == "second" && unit.dimension() == Dimension::None;
        if unit.dimension() != slot.dimension && role != "value" && !numbered {
            return Err(format!("{role}: {unit} is not a unit of {:?}", slot.dimension));
        }
        fields.push(Source { path: entry.field, unit, above: entry.above });
    }
    Ok(Part { role, presence: slot.presence, opposite: slot.opposite, fields })
}

fn times_of(table: &TimeTable) -> Result<[(StampKind, Vec<TimeSource>); 3], String> {
    let sources = |entries: &[TimeEntry]| entries.iter().map(time_source).collect::<Result<Vec<_>, _>>();
    Ok([
        (StampKind::Measured, sources(&table.measured)?),
        (StampKind::Published, sources(&table.published)?),
        (StampKind::Logged, sources(&table.logged)?),
    ])
}

fn tie_rule(entry: &UtcEntry) -> Result<TieRule, String> {
    if entry.require.iter().any(|r| !r.of.is_empty()) {
        return Err("conditions must be on the message itself".into());
    }
    let (stamp, utc) = (time_source(&entry.stamp)?, time_source(&entry.utc)?);
    if matches!(stamp, TimeSource::LoggedOnBoot) {
        return Err("logged-on-boot is computed from utc rules and cannot be used in one".into());
    }
    // A container with timestamps that need a date counts since boot.
    let clock = if matches!(stamp, TimeSource::ContainerLogged) { Clock::Boot } else { stamp.clock() };
    if !matches!(clock, Clock::Boot | Clock::Elapsed) {
        return Err("the tied timestamp must use the clock boot or elapsed".into());
    }
    if !matches!(utc.clock(), Clock::Unix | Clock::Gps) {
        return Err("utc must use the clock unix or gps".into());
    }
    let types = entry.types.iter().map(|t| plain_type(t)).collect();
    Ok(TieRule { topics: entry.topic.clone(), types, clock, stamp, utc, require: entry.require.clone() })
}

/// A timestamp source in map syntax, `{ field = "t", unit = "s", clock = "boot" }`.
pub(crate) fn time_source_of(entry: &str) -> Option<TimeSource> {
    let table: std::collections::BTreeMap<String, TimeEntry> = toml::from_str(&format!("time = {entry}")).ok()?;
    time_source(table.get("time")?).ok()
}

fn time_source(entry: &TimeEntry) -> Result<TimeSource, String> {
    only_where_it_counts(entry)?;
    let clock = entry.clock.map(clock_of);
    let TimeEntry { container, field, calendar, date, time, offset, zone, .. } = entry;
    let of_utc = matches!(clock, None | Some((Clock::Unix, 0)));
    let is_gps = clock == Some((Clock::Gps, 0)) && zone.is_none() && offset.is_none();
    match (container, field, calendar, date, time, offset) {
        (None, Some(field), None, None, None, None) => source_in_field(field, entry, clock),
        _ if entry.unit.is_some() || entry.text.is_some() || entry.week.is_some() => Err(NO_STAMP.into()),
        (Some(container), None, None, None, None, None) if clock.is_none() => Ok(container_source(*container)),
        (None, None, Some(fields), None, None, None) if of_utc => {
            if !matches!(fields.len(), 6 | 7) {
                return Err("a calendar is year, month, day, hour, minute, second, and optionally nanoseconds".into());
            }
            let counter = entry.counter.as_ref().map(|c| (c.field.clone(), c.unit));
            Ok(TimeSource::Calendar { fields: fields.clone(), zone: zone.clone(), counter })
        }
        (None, None, None, Some(date), Some(time), offset) if of_utc || is_gps => {
            let (date, time, offset, zone) = (date.clone(), time.clone(), offset.clone(), zone.clone());
            Ok(TimeSource::Civil { date, time, offset, zone, order: entry.order, is_gps })
        }
        _ => Err(NO_STAMP.into()),
    }
}

/// A source with one field, or with one and its week.
fn source_in_field(field: &str, entry: &TimeEntry, clock: Option<(Clock, i64)>) -> Result<TimeSource, String> {
    let (field, zone) = (field.to_owned(), entry.zone.clone());
    match (entry.unit, entry.text, entry.week.clone()) {
        (Some(unit), None, None) => {
            let (clock, epoch_s) = clock.ok_or_else(|| format!("the timestamp {field} needs a clock"))?;
            let east_s = zone.as_deref().and_then(offset_seconds).map_or(0, i64::from);
            let bits = entry.bits.unwrap_or(USUAL_BITS);
            Ok(TimeSource::Number { field, tick: unit, clock, zero_s: epoch_s - east_s, bits })
        }
        (Some(unit), None, Some(week)) if matches!(clock, None | Some((Clock::Gps, 0))) => {
            Ok(TimeSource::GpsWeek { week, field, tick: unit, nanos: entry.nanos.clone() })
        }
        (None, Some(TimeText::Iso8601), None) if matches!(clock, None | Some((Clock::Unix, 0))) => {
            Ok(TimeSource::Iso { field, zone })
        }
        (None, Some(TimeText::Iso8601), None) if clock == Some((Clock::Gps, 0)) && zone.is_none() => {
            Ok(TimeSource::GpsText { field })
        }
        (None, Some(TimeText::DayOfYear), None) if clock.is_none() => {
            Ok(TimeSource::DayOfYear { field, year: entry.year, zone })
        }
        (None, Some(TimeText::TimeOfDay), None) if clock.is_none() => Ok(TimeSource::TimeOfDay { field }),
        _ => Err(NO_STAMP.into()),
    }
}

const NO_STAMP: &str = "a timestamp is one of: a container; a field with a unit and a clock; a field with text; a \
    week with a field and a unit; a date and a time; a calendar";

fn container_source(stamp: ContainerStamp) -> TimeSource {
    match stamp {
        ContainerStamp::Logged => TimeSource::ContainerLogged,
        ContainerStamp::Published => TimeSource::ContainerPublished,
        ContainerStamp::LoggedOnBoot => TimeSource::LoggedOnBoot,
    }
}

/// The default width of a device counter.
pub(crate) const USUAL_BITS: u32 = 32;

/// The largest UTC offset in use.
const MOST_EAST_S: i32 = 14 * 3600;

/// Rejects keys that the rest of a timestamp source does not use.
fn only_where_it_counts(entry: &TimeEntry) -> Result<(), String> {
    let refused = |wrong: bool, why: &str| if wrong { Err(why.to_owned()) } else { Ok(()) };
    let clock = entry.clock.map(clock_of);
    let counter = entry.week.is_none() && matches!(clock, Some((Clock::Boot | Clock::Elapsed, _)));
    let days = matches!(entry.text, Some(TimeText::DayOfYear));
    let dated = match entry.text {
        Some(text) => !matches!(text, TimeText::TimeOfDay),
        None => entry.date.is_some() || entry.calendar.is_some() || matches!(clock, Some((Clock::Unix, _))),
    };
    refused(entry.order.is_some() && entry.date.is_none(), "`order` needs `date`")?;
    refused(entry.nanos.is_some() && entry.week.is_none(), "`nanos` needs `week`")?;
    refused(entry.counter.is_some() && entry.calendar.is_none(), "`counter` needs `calendar`")?;
    refused(entry.year.is_some() && !days, "`year` needs text = \"day-of-year\"")?;
    refused(entry.bits.is_some() && !counter, "`bits` needs a counter with the clock boot or elapsed")?;
    refused(entry.bits.is_some_and(|bits| !(8..=48).contains(&bits)), "a counter has 8 to 48 bits")?;
    refused(entry.zone.is_some() && (!dated || entry.offset.is_some()), "`zone` needs a date without `offset`")?;
    refused(
        entry.zone.as_deref().is_some_and(|zone| offset_seconds(zone).is_none_or(|east| east.abs() > MOST_EAST_S)),
        "`zone` is an offset from UTC of at most 14 hours, such as +02:00",
    )
}

/// The clock, and the epoch of the count in seconds of the clock.
fn clock_of(name: ClockName) -> (Clock, i64) {
    const DAY_S: i64 = 86_400;
    match name {
        ClockName::Unix => (Clock::Unix, 0),
        ClockName::Gps => (Clock::Gps, 0),
        ClockName::Boot => (Clock::Boot, 0),
        ClockName::Elapsed => (Clock::Elapsed, 0),
        ClockName::Tai => (Clock::Gps, -(GPS_EPOCH_UNIX_S + TAI_LESS_GPS_S)),
        ClockName::Labview => (Clock::Unix, -24_107 * DAY_S),
        ClockName::Excel => (Clock::Unix, -25_569 * DAY_S),
        ClockName::Matlab => (Clock::Unix, -719_529 * DAY_S),
        ClockName::ModifiedJulian => (Clock::Unix, -40_587 * DAY_S),
        ClockName::Julian => (Clock::Unix, -2_440_587 * DAY_S - DAY_S / 2),
    }
}
