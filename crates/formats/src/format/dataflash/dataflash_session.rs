//! What a log states about its own records, and the route of each record to its topic.

use super::dataflash_record::{Body, FMT_ID, FMT_LENGTH, Field, Format, TimeField};
use super::dataflash_vehicle::Vehicle;
use super::units::Units;
use crate::decode::{Route, Tally, Times, Topics};
use crate::format::report_too_many_topics;
use crate::reader::{Log, Restart};
use crate::table::TopicInfo;
use flight::{Code, NANOS_PER_SECOND, Notices, Severity};
use logscan::Fate;
use std::borrow::Cow;
use std::collections::HashMap;

/// Length of a type's name, bytes.
const LONGEST_NAME: usize = 4;
/// Maximum definitions in one log, including replacements.
const MOST_TYPES: usize = 4096;
/// Maximum instances of one type.
const MOST_INSTANCES: usize = 4096;
/// Gap between two logs in one file when the second is moved after the first, ns.
const BETWEEN_BOOTS_NS: i64 = 10 * NANOS_PER_SECOND;
/// A backward clock step longer than this is more than mere disorder, ns.
const STEP_BACK_NS: i64 = NANOS_PER_SECOND;
/// Maximum log starts that are remembered.
const MOST_RESTARTS: usize = 10_000;
/// Consecutive records differ by less than this, whatever a log omits, ns.
const FAR_NS: u64 = 3600 * NANOS_PER_SECOND as u64;

/// The types of a log; routes its records to the topics.
pub(super) struct Session<'t, 'w> {
    topics: &'t mut Topics<'w>,
    types: Vec<Type>,
    by_id: Vec<Option<usize>>,
    by_name: HashMap<String, usize>,
    file: String,
    units: Units,
    vehicle: Vehicle,
    clock: BootClock,
    moved: Vec<u8>,
    /// Replaced types: the old and the new one.
    redefined: Vec<[usize; 2]>,
    unplaced: Tally,
    misfits: Tally,
    late_instances: Tally,
    /// Units that were stated again with another value.
    other_units: Tally,
}

/// A type of records.
struct Type {
    format: Format,
    role: Role,
    /// The field with the instance.
    instance: Option<usize>,
    /// Units and multipliers of its fields, from its `FMTU`.
    unit_ids: Option<[String; 2]>,
    /// For a type without instances only the first.
    ways: Vec<Option<Route>>,
    /// For instances without a small number.
    more_ways: HashMap<Instance, Option<Route>>,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash)]
enum Instance {
    Number(i64),
    Text(String),
}

/// What a record says about the log itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Role {
    Samples,
    Formats,
    FieldUnits,
    Unit,
    Multiplier,
    Parameter,
    Message,
    Mode,
    Version,
}

impl Role {
    fn of(name: &str) -> Role {
        match name {
            "FMT" => Role::Formats,
            "FMTU" => Role::FieldUnits,
            "UNIT" => Role::Unit,
            "MULT" => Role::Multiplier,
            "PARM" => Role::Parameter,
            "MSG" => Role::Message,
            "MODE" => Role::Mode,
            "VER" => Role::Version,
            _ => Role::Samples,
        }
    }

    fn is_structure(self) -> bool {
        matches!(self, Role::Formats | Role::FieldUnits | Role::Unit | Role::Multiplier)
    }
}

impl Type {
    fn new(format: Format) -> Type {
        let instance = format.usual_instance();
        let role = Role::of(&format.name);
        Type { format, role, instance, unit_ids: None, ways: vec![], more_ways: HashMap::new() }
    }

    fn is_used(&self) -> bool {
        !self.ways.is_empty() || !self.more_ways.is_empty()
    }

    /// The route of this record; `None` if there are too many topics.
    fn way(&mut self, body: Body<'_>, topics: &mut Topics<'_>) -> Option<Route> {
        let number = match self.instance {
            None => Some(0),
            Some(field) => body.byte(&self.format, field),
        };
        let Some(number) = number else { return self.distant_way(body, topics) };
        if let Some(Some(way)) = self.ways.get(usize::from(number)) {
            return Some(*way);
        }
        let way = self.open(self.topic_name(&Instance::Number(number.into())), body, topics);
        if self.ways.len() <= usize::from(number) {
            self.ways.resize(usize::from(number) + 1, None);
        }
        if let Some(place) = self.ways.get_mut(usize::from(number)) {
            *place = way;
        }
        way
    }

    /// As [`Type::way`], for an instance that is not a byte.
    fn distant_way(&mut self, body: Body<'_>, topics: &mut Topics<'_>) -> Option<Route> {
        let field = self.instance?;
        let instance = match (body.integer(&self.format, field), body.text(&self.format, field)) {
            (Some(number), _) => Instance::Number(number),
            (None, text) => Instance::Text(text.unwrap_or_default().into_owned()),
        };
        if let Some(way) = self.more_ways.get(&instance) {
            return *way;
        }
        if self.more_ways.len() >= MOST_INSTANCES {
            return None;
        }
        let way = self.open(self.topic_name(&instance), body, topics);
        self.more_ways.insert(instance, way);
        way
    }

    fn topic_name(&self, instance: &Instance) -> String {
        let name = &self.format.name;
        match instance {
            Instance::Number(0) => name.clone(),
            Instance::Number(number) => format!("{name}_{number}"),
            Instance::Text(text) => format!("{name}_{text}"),
        }
    }

    fn open(&self, name: String, body: Body<'_>, topics: &mut Topics<'_>) -> Option<Route> {
        let info = TopicInfo { name, type_name: self.format.name.clone(), encoding: "dataflash".to_owned() };
        let definition = self.format.definition.as_bytes();
        let route = match body {
            Body::Packed(_) => topics.packed_route(info, definition, |wanted| self.format.packed_layout(wanted)),
            Body::Line(_) => topics.cells_route(info, definition, || self.format.cell_layout()),
        };
        route.ok()
    }
}

impl<'t, 'w> Session<'t, 'w> {
    pub(super) fn new(file: &str, topics: &'t mut Topics<'w>) -> Session<'t, 'w> {
        let mut session = Session {
            topics,
            types: vec![],
            by_id: vec![None; 256],
            by_name: HashMap::new(),
            file: file.to_owned(),
            units: Units::default(),
            vehicle: Vehicle::default(),
            clock: BootClock::default(),
            moved: vec![],
            redefined: vec![],
            unplaced: Tally::default(),
            misfits: Tally::default(),
            late_instances: Tally::default(),
            other_units: Tally::default(),
        };
        session.learn(FMT_ID, Format::of_formats());
        session
    }

    fn learn(&mut self, id: u8, format: Format) {
        self.by_name.insert(format.name.clone(), self.types.len());
        if let Some(place) = self.by_id.get_mut(usize::from(id)) {
            *place = Some(self.types.len());
        }
        self.types.push(Type::new(format));
    }

    fn known(&self, id: u8) -> Option<usize> {
        self.by_id.get(usize::from(id)).copied().flatten()
    }

    /// The format of a type.
    pub(super) fn format(&self, id: u8) -> Option<&Format> {
        self.types.get(self.known(id)?).map(|t| &t.format)
    }

    /// Whether the time of a binary record, if its type has one, is near the last one; `bytes` with its header.
    pub(super) fn is_near(&self, bytes: &[u8], header: usize) -> bool {
        let id = bytes.get(header - 1).copied().unwrap_or_default();
        let Some(format) = self.format(id) else { return false };
        let time = |field: TimeField| field.read(format, Body::Packed(bytes.get(header..)?));
        match (format.time, self.clock.last_raw_ns()) {
            (Some(field), Some(last_ns)) => time(field).is_some_and(|ns| ns.abs_diff(last_ns) <= FAR_NS),
            _ => true,
        }
    }

    /// A binary record of a known type; `bytes` with its header. Fails if it is corrupt.
    pub(super) fn packed(&mut self, bytes: &[u8], header: usize) -> Result<Fate, String> {
        let id = bytes.get(header - 1).copied().unwrap_or_default();
        let Some(index) = self.known(id) else {
            return Err(format!("a record of the undefined type {id}"));
        };
        let Some(kind) = self.types.get(index) else { return Ok(Fate::Skipped) };
        if !kind.format.fits(bytes.len()) {
            let name = &kind.format.name;
            self.misfits.add(|| format!("a {name} of {} bytes", bytes.len()));
            return Ok(Fate::Skipped);
        }
        self.record(index, Body::Packed(bytes.get(header..).unwrap_or_default()))
    }

    /// A line of text: name and what follows its comma. Fails if it is corrupt.
    pub(super) fn line(&mut self, name: &str, values: &str) -> Result<Fate, String> {
        let Some(&index) = self.by_name.get(name) else {
            return Err("a line of an undefined type".to_owned());
        };
        if let Some(kind) = self.types.get(index).filter(|t| t.format.fault.is_none()) {
            let (needed, given) = (kind.format.fields.len(), values.split(',').count());
            if given < needed || (given > needed && !kind.format.ends_in_text()) {
                let name = &kind.format.name;
                return Err(format!("a line of type {name} with {given} values, but its format has {needed}"));
            }
            if kind.format.ends_in_text()
                && let Some(other) = values.splitn(needed, ',').last().and_then(|text| self.record_within(text))
            {
                return Err(format!("a line of type {} that continues with one of type {other}", kind.format.name));
            }
            if kind.format.text_is_too_long(values) {
                return Err(format!("a line of type {} whose text is longer than its field", kind.format.name));
            }
        }
        self.record(index, Body::Line(values))
    }

    /// The type of a record found within a text, if the line end before it is corrupt. A defined name, a comma and
    /// a whole number with a comma do not occur in a text by chance.
    fn record_within<'v>(&self, text: &'v str) -> Option<&'v str> {
        memchr::memchr_iter(b',', text.as_bytes()).find_map(|at| {
            let (before, behind) = (text.get(..at)?, text.get(at + 1..)?.trim_start_matches(' '));
            let digits = behind.bytes().take_while(u8::is_ascii_digit).count();
            let number = digits > 0 && behind.get(digits..)?.starts_with(',');
            let mut names =
                (2..=LONGEST_NAME).rev().filter_map(|length| before.get(before.len().checked_sub(length)?..));
            names.find(|name| self.by_name.get(*name).is_some_and(|&index| number || self.is_line_of(index, behind)))
        })
    }

    /// Whether the number of values matches the type, at least one is a number, and numeric fields have numbers.
    fn is_line_of(&self, index: usize, values: &str) -> bool {
        let Some(format) = self.types.get(index).map(|t| &t.format).filter(|format| format.fault.is_none()) else {
            return false;
        };
        let cells: Vec<&str> = values.split(',').map(str::trim).collect();
        let is_number = |(cell, field): (&&str, &Field)| field.is_text() || cell.parse::<f64>().is_ok();
        cells.len() == format.fields.len()
            && format.fields.iter().any(|field| !field.is_text())
            && cells.iter().zip(&format.fields).all(is_number)
    }

    fn record(&mut self, index: usize, body: Body<'_>) -> Result<Fate, String> {
        let Some(kind) = self.types.get(index) else { return Ok(Fate::Skipped) };
        let (role, raw_ns) = (kind.role, kind.format.time.and_then(|time| time.read(&kind.format, body)));
        let logged_ns = self.clock.stamp(raw_ns, &self.file);
        if role != Role::Samples {
            self.observe(role, index, body, logged_ns)?;
        }
        let Some(kind) = self.types.get_mut(index) else { return Ok(Fate::Skipped) };
        let Some(route) = kind.way(body, self.topics) else {
            self.unplaced.add(|| kind.format.name.clone());
            return Ok(Fate::Skipped);
        };
        let times = Times { logged_ns, published_ns: None };
        let payload = match (kind.format.time, self.clock.offset_ns) {
            (Some(time), offset_ns @ 1..) if route.is_wanted() => time.moved(body, offset_ns, &mut self.moved),
            _ => body.payload(),
        };
        match self.topics.message(route, times, payload) {
            Fate::Skipped if role.is_structure() => Ok(Fate::Structure),
            fate => Ok(fate),
        }
    }

    /// Records what a record says about the log.
    fn observe(&mut self, role: Role, index: usize, body: Body<'_>, at_ns: i64) -> Result<(), String> {
        let Some(format) = self.types.get(index).map(|t| &t.format) else { return Ok(()) };
        let integer = |name: &str| format.field(name).and_then(|field| body.integer(format, field));
        let number = |name: &str| format.field(name).and_then(|field| body.number(format, field));
        let text = |name: &str| format.field(name).and_then(|field| body.text(format, field));
        match role {
            Role::Samples => {}
            Role::Formats => {
                let texts = ["Name", "Format", "Columns"].map(|name| text(name).unwrap_or_default());
                return self.define(integer("Type"), integer("Length"), texts);
            }
            Role::FieldUnits => {
                let ids = ["UnitIds", "MultIds"].map(|name| text(name).unwrap_or_default().into_owned());
                if let Some(id) = integer("FmtType").and_then(|id| u8::try_from(id).ok()) {
                    self.set_units(id, ids);
                }
            }
            Role::Unit => self.units.unit(integer("Id"), text("Label")),
            Role::Multiplier => self.units.multiplier(integer("Id"), number("Mult")),
            Role::Parameter => {
                if let (Some(name), Some(value)) = (text("Name"), number("Value")) {
                    self.vehicle.parameter(at_ns, &name, value);
                }
            }
            Role::Message => {
                if let Some(text) = text("Message") {
                    self.vehicle.message(at_ns, &text);
                }
            }
            Role::Mode => {
                let number = integer("Mode").or_else(|| integer("ModeNum"));
                self.vehicle.mode(at_ns, number, text("Mode").as_deref());
            }
            Role::Version => match (text("Arch"), text("FwGit")) {
                (Some(board), Some(git)) => self.vehicle.version_of_px4(&board, &git),
                _ => self.vehicle.version(text("FWS").as_deref(), integer("BU"), integer("APJ")),
            },
        }
        Ok(())
    }

    fn define(
        &mut self,
        id: Option<i64>,
        length: Option<i64>,
        [name, codes, columns]: [Cow<'_, str>; 3],
    ) -> Result<(), String> {
        let (id, length) = id.zip(length).ok_or("a definition without a type")?;
        let (Ok(id), Ok(length)) = (u8::try_from(id), u8::try_from(length)) else {
            return Err("a definition whose type or length is not a byte".to_owned());
        };
        if id == FMT_ID {
            let usual = usize::from(length) == FMT_LENGTH && name == "FMT";
            return if usual {
                // The first record of every log. It adds nothing new, except that a log starts.
                self.clock.restarts();
                Ok(())
            } else {
                Err("an unusual definition of FMT itself".into())
            };
        }
        let format = Format::new(length, &name, &codes, &columns)?;
        let known = self.known(id).and_then(|index| self.types.get(index));
        if known.is_some_and(|known| known.format == format) {
            return Ok(());
        }
        if self.types.len() >= MOST_TYPES {
            return Err(format!("there are more than {MOST_TYPES} definitions"));
        }
        if let Some(index) = self.known(id) {
            self.redefined.push([index, self.types.len()]);
        }
        self.learn(id, format);
        Ok(())
    }

    fn set_units(&mut self, id: u8, ids: [String; 2]) {
        let Some(kind) = self.known(id).and_then(|index| self.types.get_mut(index)) else {
            return self.other_units.add(|| format!("undefined type {id}"));
        };
        if ids[0].len() != kind.format.codes() {
            self.other_units.add(|| format!("{}, of {} fields", kind.format.name, ids[0].len()));
            return;
        }
        if kind.unit_ids.as_ref().is_some_and(|known| *known != ids) {
            self.other_units.add(|| kind.format.name.clone());
            return;
        }
        let instance = ids[0].bytes().position(|b| b == b'#').filter(|&field| field < kind.format.fields.len());
        if instance != kind.instance && kind.is_used() {
            self.late_instances.add(|| kind.format.name.clone());
        }
        kind.instance = instance;
        kind.unit_ids = Some(ids);
    }

    /// Replaced types: those that have records, before or after, and the others.
    fn redefinitions(&self) -> [Tally; 2] {
        let mut tallies = [Tally::default(), Tally::default()];
        for places in &self.redefined {
            let [Some(old), Some(new)] = places.map(|place| self.types.get(place)) else { continue };
            let tally = usize::from(!old.is_used() && !new.is_used());
            if let Some(tally) = tallies.get_mut(tally) {
                tally.add(|| format!("{} replaces {}", new.format.name, old.format.name));
            }
        }
        tallies
    }

    /// Writes what the log states about itself, and what was wrong with it.
    pub(super) fn finish(self, log: &mut Log, notices: &mut Notices) {
        let file = self.file.as_str();
        let [used, unused] = self.redefinitions();
        let text = "types were redefined differently; later records are read with the new definition";
        used.report(Code::Redefined.at(Severity::Loss), file, text, notices);
        let text = "types were redefined differently, but neither the old nor the new type has records";
        unused.report(Code::Redefined.at(Severity::Info), file, text, notices);
        self.misfits.report(Code::Undecodable, file, "records do not have the length of their definition", notices);
        report_too_many_topics(&self.unplaced, "records", file, notices);
        let text = "the field that distinguishes instances was defined only after the first records, so these are in \
            one topic";
        self.late_instances.report(Code::Redefined, file, text, notices);
        let text = "units and instances were stated before their type, twice and differently (the first statement is \
            used), or for another number of fields; they may belong to another type";
        self.other_units.report(Code::Redefined, file, text, notices);
        let text = "the clock restarts within the file; the timestamps after it continue as if ten seconds had \
            passed";
        self.clock.moved.report(Code::SeveralSessions, file, text, notices);
        self.clock.back.report(Code::UnreliableStamps, file, "the clock steps back by more than a second", notices);
        log.health.undecodable += self.misfits.count;
        log.health.messages += self.misfits.count;
        log.restarts = self.clock.begun;
        log.health.about = self.vehicle.finish();
        for kind in self.types.iter().filter(|t| t.is_used()) {
            let Some([units, multipliers]) = &kind.unit_ids else { continue };
            log.units.extend(self.units.of(&kind.format, units.as_bytes(), multipliers.as_bytes()));
        }
    }
}

impl TimeField {
    /// Nanoseconds; `None` on overflow.
    fn read(self, format: &Format, body: Body<'_>) -> Option<i64> {
        let ticks = match body {
            Body::Packed(bytes) => {
                let place = bytes.get(self.offset..).unwrap_or_default();
                if self.wide {
                    i64::try_from(u64::from_le_bytes(*place.first_chunk()?)).ok()?
                } else {
                    u32::from_le_bytes(*place.first_chunk()?).into()
                }
            }
            Body::Line(_) => body.integer(format, self.field)?,
        };
        ticks.checked_mul(self.tick_ns)
    }

    /// The record with its time moved. A time that does not fit is unchanged.
    fn moved<'m>(self, body: Body<'m>, offset_ns: i64, space: &'m mut Vec<u8>) -> &'m [u8] {
        let ticks = offset_ns / self.tick_ns;
        space.clear();
        match body {
            Body::Packed(bytes) => {
                space.extend_from_slice(bytes);
                let place = space.get_mut(self.offset..).unwrap_or_default();
                if self.wide {
                    if let Some(place) = place.first_chunk_mut() {
                        *place = u64::from_le_bytes(*place).wrapping_add_signed(ticks).to_le_bytes();
                    }
                } else if let Some(place) = place.first_chunk_mut()
                    && let Ok(time) = u32::try_from(i64::from(u32::from_le_bytes(*place)) + ticks)
                {
                    *place = time.to_le_bytes();
                }
            }
            Body::Line(line) => {
                let cells = line.split(',').enumerate().map(|(cell, text)| match text.trim().parse::<i64>() {
                    Ok(time) if cell == self.field => time.saturating_add(ticks).to_string(),
                    _ => text.to_owned(),
                });
                space.extend_from_slice(cells.collect::<Vec<_>>().join(",").as_bytes());
            }
        }
        space
    }
}

/// The time since boot, from record to record.
#[derive(Debug, Default)]
struct BootClock {
    last_ns: Option<i64>,
    /// Added to logged times since the clock restarted: a multiple of a second.
    offset_ns: i64,
    begins: bool,
    moved: Tally,
    back: Tally,
    begun: Vec<Restart>,
}

impl BootClock {
    /// The next timestamp may be of another boot.
    fn restarts(&mut self) {
        self.begins = true;
    }

    /// The time of the last record as logged.
    fn last_raw_ns(&self) -> Option<i64> {
        self.last_ns.map(|last_ns| last_ns.saturating_sub(self.offset_ns))
    }

    /// The timestamp of a record. A record without a time of its own gets that of the previous record.
    fn stamp(&mut self, raw_ns: Option<i64>, file: &str) -> i64 {
        let Some(raw_ns) = raw_ns else { return self.last_ns.unwrap_or_default() };
        let last_ns = self.last_ns.unwrap_or(i64::MIN);
        let seconds = |ns: i64| ns as f64 / NANOS_PER_SECOND as f64;
        let begins = std::mem::take(&mut self.begins) && self.last_ns.is_some();
        // No autopilot reaches the time of the previous boot this soon.
        let certain = begins && raw_ns.saturating_add(self.offset_ns).saturating_add(STEP_BACK_NS) < last_ns;
        if certain {
            let second = NANOS_PER_SECOND;
            let gap_ns = last_ns.saturating_sub(raw_ns).saturating_add(BETWEEN_BOOTS_NS);
            self.offset_ns = gap_ns.div_euclid(second).saturating_mul(second);
            self.moved.add(|| format!("{file}, from {:.3} s to {:.3} s", seconds(last_ns), seconds(raw_ns)));
        }
        let stamp = raw_ns.saturating_add(self.offset_ns);
        if begins && self.begun.len() < MOST_RESTARTS {
            self.begun.push(Restart { logged_ns: stamp, certain });
        }
        if stamp.saturating_add(STEP_BACK_NS) < last_ns {
            self.back.add(|| format!("{file}, from {:.3} s to {:.3} s", seconds(last_ns), seconds(stamp)));
        }
        self.last_ns = Some(stamp);
        stamp
    }
}
