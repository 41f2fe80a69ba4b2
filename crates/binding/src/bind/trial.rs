//! Tries a channel map on a log: which tables and columns its rules find.

use super::conditions::{conditions, is_for, said_by};
use super::date_columns::{example, unclear};
use super::plan::{Found, Plan, binds};
use super::receive_times::by_receive_time;
use super::stamp_columns::{Stamps, is_constant, read_stamps, written_at};
use super::stated_units;
use crate::map::{BENCH_ALONE, ChannelMap, ChannelRule, Closeness, Part, Presence, Specificity, TimeSource};
use flight::{Quantity, StampKind};
use formats::{Log, Table};

/// Quantities of an IMU.
const INERTIAL: [Quantity; 3] = [Quantity::Attitude, Quantity::AngularRate, Quantity::SpecificForce];

/// What a map finds in a log.
pub(super) struct Trial<'a> {
    pub(super) map: &'a ChannelMap,
    /// One for each rule that finds its data.
    pub(super) plans: Vec<Plan<'a>>,
    /// Rules that found a topic, but lack something in it.
    near: Vec<String>,
    /// Rules that found no topic.
    far: Vec<String>,
    /// Channels for which several topics fit equally well, and which of them is used, in words.
    pub(super) equals: Vec<Equals>,
    /// Channels for which the log states something that no rule knows, and what it states.
    pub(super) unknown: Vec<(String, String)>,
    /// The number of wanted columns that the near rules did find.
    nearness: usize,
}

/// How good a map is for a log; larger is better, and the first difference decides.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Rank {
    /// It binds every channel that its map needs.
    has_needed: bool,
    both: bool,
    /// A velocity that is zero in every row does not count.
    moves: bool,
    replayed: bool,
    encoder: bool,
    fits: bool,
    /// Made for a device, and not for any log with certain types.
    of_device: bool,
    specificity: Specificity,
    of_flights: usize,
    channels: usize,
    /// Topics with the exact name come before topics below a namespace.
    nearness: std::cmp::Reverse<usize>,
}

enum Miss {
    /// No topic of that name or type.
    NoTopic(String),
    /// The topic exists, but something is missing in it; with the number of columns found.
    Near(String, usize),
    /// Several topics fit equally well; with the number of columns found.
    Equal(Vec<String>, usize),
}

/// Topics that fit a channel equally well.
pub(super) struct Equals {
    pub(super) channel: String,
    pub(super) topics: Vec<String>,
    /// The topic that is used.
    pub(super) used: Option<String>,
}

impl Equals {
    pub(super) fn in_words(&self) -> String {
        let Equals { channel, topics, used } = self;
        let topics = topics.join(" and ");
        match used {
            Some(used) => format!("channel {channel}: the topics {topics} fit equally well, and {used} is used"),
            None => format!("channel {channel} is not bound: the topics {topics} fit equally well"),
        }
    }
}

impl<'a> Trial<'a> {
    /// One for each map. Timestamps that several of them read alike are in memory once.
    pub(super) fn of_all(maps: &[&'a ChannelMap], log: &'a Log) -> Vec<Trial<'a>> {
        let mut trials: Vec<Trial<'_>> = vec![];
        for map in maps {
            let trial = Trial::new(map, log, &trials);
            trials.push(trial);
        }
        trials
    }

    fn new(map: &'a ChannelMap, log: &'a Log, others: &[Trial<'a>]) -> Trial<'a> {
        let mut trial =
            Trial { map, plans: vec![], near: vec![], far: vec![], equals: vec![], unknown: vec![], nearness: 0 };
        for rule in &map.rules {
            if rule.when.as_ref().is_some_and(|when| !is_for(when, log)) {
                continue;
            }
            if trial.plans.iter().any(|plan| plan.rule.name == rule.name) {
                continue;
            }
            match plan(rule, map, log) {
                Ok((mut plan, equals)) => {
                    trial.equals.retain(|of| of.channel != rule.name);
                    trial.equals.extend(equals);
                    let all = trial.plans.iter().chain(others.iter().flat_map(|other| &other.plans));
                    let same = all.filter(|other| std::ptr::eq(other.table, plan.table));
                    let known: Vec<&Stamps> = same.flat_map(|other| &other.stamps).collect();
                    plan.stamps.iter_mut().for_each(|own| known.iter().for_each(|other| own.share(other)));
                    trial.plans.push(plan);
                }
                Err(Miss::Near(what, found)) => {
                    trial.near.push(format!("{}: {what}", rule.name));
                    trial.nearness += found;
                }
                Err(Miss::Equal(topics, found)) => {
                    trial.near.push(format!("{}: the topics {} fit equally well", rule.name, topics.join(" and ")));
                    trial.nearness += found;
                    trial.equals.push(Equals { channel: rule.name.clone(), topics, used: None });
                }
                Err(Miss::NoTopic(what)) => trial.far.push(format!("{}: {what}", rule.name)),
            }
        }
        trial.unknown = unknown(map, log);
        trial
    }

    /// Whether it binds anything that a replay or a bench could use.
    pub(super) fn fits(&self) -> bool {
        self.has_needed() && (self.position() || self.velocity() || binds(&self.plans, BENCH_ALONE))
    }

    fn has_needed(&self) -> bool {
        self.map.needs.iter().all(|name| self.plans.iter().any(|plan| plan.rule.name == *name))
    }

    /// Larger is better. The channels of flights decide first, so that an extra bench channel does not change which map
    /// a flight gets.
    pub(super) fn rank(&self) -> Rank {
        Rank {
            has_needed: self.has_needed(),
            both: self.both(),
            moves: self.moves(),
            replayed: self.position() || self.velocity(),
            encoder: self.encoder(),
            fits: self.fits(),
            of_device: !self.map.generic,
            specificity: self.specificity(),
            of_flights: self.of_flights().count(),
            channels: self.plans.len(),
            nearness: std::cmp::Reverse(self.plans.iter().map(|p| usize::from(p.distance)).sum()),
        }
    }

    /// Both a position and a velocity.
    pub(super) fn both(&self) -> bool {
        self.position() && self.velocity()
    }

    fn position(&self) -> bool {
        binds(&self.plans, &[Quantity::PositionGeodetic, Quantity::PositionNed])
    }

    fn velocity(&self) -> bool {
        binds(&self.plans, &[Quantity::VelocityNed])
    }

    fn moves(&self) -> bool {
        let mut velocities = self.plans.iter().filter(|p| p.rule.quantity == Quantity::VelocityNed);
        velocities.any(|plan| {
            let horizontal = || plan.columns.iter().take(2).flatten().map(|found| found.column);
            (0..plan.table.rows).any(|row| horizontal().any(|column| column.number(row).is_some_and(|v| v != 0.0)))
        })
    }

    /// The encoder of a bench.
    pub(super) fn encoder(&self) -> bool {
        binds(&self.plans, &[Quantity::EncoderCount, Quantity::EncoderAngle])
    }

    /// Positions and velocities.
    fn of_flights(&self) -> impl Iterator<Item = &Plan<'a>> {
        let is_accessory = |quantity| quantity == Quantity::Scalar || BENCH_ALONE.contains(&quantity);
        self.plans.iter().filter(move |p| !is_accessory(p.rule.quantity))
    }

    /// The specificity of the channel with the least exact name; of the flight channels, if there is one.
    pub(super) fn specificity(&self) -> Specificity {
        let least = |plans: &mut dyn Iterator<Item = &Plan<'a>>| plans.map(|p| p.rule.specificity()).min();
        least(&mut self.of_flights()).or_else(|| least(&mut self.plans.iter())).unwrap_or(Specificity::AnyTable)
    }

    pub(super) fn names(&self) -> Vec<String> {
        self.plans.iter().map(|p| p.rule.name.clone()).collect()
    }

    /// Why this map is the best; the names of its `channels` channels are listed elsewhere.
    pub(super) fn why(&self, channels: usize) -> String {
        let how = match self.specificity() {
            Specificity::ByName => "the log holds its topics by name",
            Specificity::ByType => "the log holds topics of its types",
            Specificity::AnyTable => "the table has its columns",
        };
        let lacking = match (self.position(), self.velocity()) {
            (true, false) => ", but no velocity",
            (false, true) => ", but no position",
            _ => "",
        };
        format!("{how}{lacking}; {channels} {}", if channels == 1 { "channel" } else { "channels" })
    }

    /// Whether a user's map finds at least half of its columns in the log, so that it was meant for it.
    pub(super) fn is_meant(&self) -> bool {
        let parts = self.map.rules.iter().flat_map(|rule| &rule.parts).filter(|part| !part.fields.is_empty()).count();
        !self.map.shipped && self.nearness > 0 && 2 * self.nearness >= parts
    }

    /// How near the map comes, and what is missing in the first `channels` channels; `None` if it finds nothing of its
    /// own.
    pub(super) fn complaint(&self, channels: usize) -> Option<(usize, String)> {
        let missing: Vec<&str> = self.near.iter().chain(&self.far).map(String::as_str).collect();
        let missing = first_of(&missing, channels, ", ", " and {} more channels");
        (self.nearness > 0).then(|| (self.nearness, format!("{} lacks {missing}", self.map.name)))
    }
}

/// Channels whose rules depend on a remark of the log that none of them knows, if the log has their data.
fn unknown(map: &ChannelMap, log: &Log) -> Vec<(String, String)> {
    let mut unknown: Vec<(String, String)> = vec![];
    for (rule, when) in map.rules.iter().filter_map(|rule| Some((rule, rule.when.as_ref()?))) {
        let same = |other: &&ChannelRule| other.name == rule.name;
        let known = map.rules.iter().filter(same).any(|other| other.when.as_ref().is_none_or(|when| is_for(when, log)));
        let remark = said_by(when, log).into_iter().collect::<Vec<_>>().join(" and ");
        if !remark.is_empty()
            && !known
            && unknown.iter().all(|(name, _)| *name != rule.name)
            && plan(rule, map, log).is_ok()
        {
            unknown.push((rule.name.clone(), format!("{} {remark}", when.remark)));
        }
    }
    unknown
}

/// The best table for a rule. Which of several IMUs is used matters little, so that of the shortest name is taken
/// (`/imu/data` before `/imu/data_raw`); which of several receivers or filters is meant, only the user knows.
fn plan<'a>(rule: &'a ChannelRule, map: &ChannelMap, log: &'a Log) -> Result<(Plan<'a>, Option<Equals>), Miss> {
    let topics = log.tables.iter().filter_map(|table| Some((rule.meets(&table.topic)?, table)));
    let mut fitting: Vec<(Closeness, Plan<'a>)> = vec![];
    let mut miss = None;
    for (closeness, table) in topics {
        match columns_of(rule, table, (map, log), closeness.distance) {
            Ok(plan) => fitting.push((closeness, plan)),
            Err(what) => miss = miss.or_else(|| Some((format!("topic {}: {what}", table.topic.name), table))),
        }
    }
    fitting.sort_by_key(|(closeness, plan)| (*closeness, plan.table.topic.name.len(), &plan.table.topic.name));
    let best = fitting.first().map(|(closeness, _)| *closeness);
    let same = fitting.iter().filter(|(c, _)| Some(*c) == best);
    let mut topics: Vec<String> = same.map(|(_, plan)| plan.table.topic.name.clone()).collect();
    let used = topics.first().cloned();
    topics.sort_unstable();
    let is_of_imu = INERTIAL.contains(&rule.quantity);
    if topics.len() > 1 && !is_of_imu {
        return Err(Miss::Equal(topics, rule.parts.len()));
    }
    let equals = (topics.len() > 1).then(|| Equals { channel: rule.name.clone(), topics, used });
    match fitting.into_iter().next() {
        Some((_, plan)) => Ok((plan, equals)),
        None => Err(match miss {
            Some((what, table)) => Miss::Near(what, columns_found(rule, table)),
            None => Miss::NoTopic(no_topic(rule, log)),
        }),
    }
}

/// The number of the rule's fields that the table has, with or without values. Time columns do not count: every table
/// has one.
fn columns_found(rule: &ChannelRule, table: &Table) -> usize {
    let by_name = usize::from(rule.specificity() > Specificity::AnyTable);
    let fields = || rule.parts.iter().flat_map(|part| &part.fields);
    by_name + table.columns.iter().filter(|c| fields().any(|source| source.path == c.path)).count()
}

fn no_topic(rule: &ChannelRule, log: &Log) -> String {
    let undecodable = log.health.topics.iter().filter(|t| !t.reason.is_empty()).find(|t| {
        let topic =
            formats::TopicInfo { name: t.name.clone(), type_name: t.type_name.clone(), encoding: t.encoding.clone() };
        rule.meets(&topic).is_some()
    });
    match (undecodable, rule.topics.first(), rule.types.first()) {
        (Some(topic), ..) => format!("topic {}: {}", topic.name, topic.reason),
        (None, Some(name), _) => format!("no topic {name}"),
        (None, None, Some(type_name)) => format!("no topic of type {type_name}"),
        (None, None, None) => "no table with its columns".into(),
    }
}

fn columns_of<'a>(
    rule: &'a ChannelRule,
    table: &'a Table,
    (map, log): (&ChannelMap, &'a Log),
    distance: u8,
) -> Result<Plan<'a>, String> {
    if table.rows == 0 {
        return Err("has no messages".into());
    }
    let mut columns = vec![];
    for part in &rule.parts {
        let found = match find_part(part, table) {
            Some(found) => Some(stated_units::as_written(found, log.head(&table.topic.name))?),
            None => None,
        };
        if found.is_none() && is_needed(part, rule) {
            return Err(missing(part));
        }
        columns.push(found);
    }
    if let (Some(first), true) = (rule.parts.first(), columns.iter().all(Option::is_none)) {
        return Err(missing(first));
    }
    let (stamps, remarks) = stamps_of(rule, table, |kind| by_receive_time(kind, &map.ties, log, table))?;
    stated_units::check_times(rule, &stamps, log.head(&table.topic.name))?;
    let conditions = conditions(&rule.require, table, log);
    Ok(Plan { rule, table, distance, columns, stamps, remarks, conditions })
}

fn missing(part: &Part) -> String {
    let names: Vec<&str> = part.fields.iter().map(|source| source.path.as_str()).collect();
    format!("no {} ({})", part.role, first_of(&names, 3, " or ", " or {} other names"))
}

/// A list of at most `most` names; `more` names how many others there are.
fn first_of(names: &[&str], most: usize, between: &str, more: &str) -> String {
    let (listed, rest) = names.split_at(names.len().min(most));
    let more = if rest.is_empty() { String::new() } else { more.replace("{}", &rest.len().to_string()) };
    listed.join(between) + &more
}

/// The first of the part's fields that holds any number. A height that is zero throughout ranks after one that is not:
/// writers that do not know it leave it zero.
fn find_part<'a>(part: &'a Part, table: &'a Table) -> Option<Found<'a>> {
    let mut zero = None;
    for source in &part.fields {
        let Some(column) = table.numbers(&source.path) else { continue };
        let mut values = (0..table.rows).filter_map(|row| column.number(row)).peekable();
        if values.peek().is_none() {
            continue;
        }
        let is_zero = values.all(|value| value == 0.0);
        let passed_over = zero.map(|z: Found<'a>| z.column);
        let found = Found { column, unit: source.unit, above: source.above, passed_over, stated_unit: None };
        if !is_zero || part.role != "height" {
            return Some(found);
        }
        zero = zero.or(Some(found));
    }
    zero
}

/// Whether a channel needs a part that the table lacks. A channel known by its name may be motionless throughout; in
/// any other table a speed alone does not prove that it is one.
fn is_needed(part: &Part, rule: &ChannelRule) -> bool {
    match part.presence {
        Presence::Required => true,
        Presence::Direction => rule.specificity() == Specificity::AnyTable,
        Presence::Vertical | Presence::Axis => false,
    }
}

/// The timestamps that the log holds, the wanted kind first. If it is missing, the nearest other kind is the fallback,
/// with a remark. `on_boot` places the container's timestamps on the clock since boot.
pub(super) fn stamps_of(
    rule: &ChannelRule,
    table: &Table,
    on_boot: impl Fn(StampKind) -> Option<Stamps>,
) -> Result<(Vec<Stamps>, Vec<String>), String> {
    let mut remarks = vec![];
    let mut found: Vec<Stamps> = vec![];
    let sources = || rule.times.iter().flat_map(|(_, sources)| sources);
    for (kind, of_kind) in &rule.times {
        let read = |source: &TimeSource| match source {
            TimeSource::LoggedOnBoot => on_boot(*kind),
            _ => read_stamps(*kind, source, table, || written_at(sources(), table)),
        };
        found.extend(filled(*kind, of_kind, table, read, &mut remarks));
    }
    let Some(primary) = found.iter().position(|s| s.kind == rule.timeline).or((!found.is_empty()).then_some(0)) else {
        if remarks.is_empty() {
            remarks.extend(sources().filter_map(|source| example(source, table)).take(1));
        }
        let names: Vec<String> = sources().map(TimeSource::label).collect();
        let why: Vec<String> = remarks.iter().map(|remark| format!("; {remark}")).collect();
        return Err(format!("no timestamps ({}){}", names.join(" or "), why.concat()));
    };
    found.swap(0, primary);
    if let Some(first) = found.first().filter(|f| f.kind != rule.timeline) {
        remarks.push(format!(
            "no {} timestamps; the {} ones ({}) are used instead",
            rule.timeline, first.kind, first.label
        ));
    }
    Ok((found, remarks))
}

/// The timestamps of the first of some sources of a kind, with missing ones from the next.
fn filled(
    kind: StampKind,
    sources: &[TimeSource],
    table: &Table,
    read: impl Fn(&TimeSource) -> Option<Stamps>,
    remarks: &mut Vec<String>,
) -> Option<Stamps> {
    let mut first: Option<Stamps> = None;
    for source in sources {
        if first.as_ref().is_some_and(|first| first.nanos.is_whole()) {
            break;
        }
        let Some(stamps) = read(source) else {
            remarks.extend(unclear(source, table).filter(|_| first.is_none()));
            continue;
        };
        match &mut first {
            Some(first) => first.fill(stamps),
            None if is_constant(&stamps.nanos) => {
                remarks.push(format!("the {kind} timestamps in {} never change and are not used", source.label()));
            }
            None => first = Some(stamps),
        }
    }
    first
}
