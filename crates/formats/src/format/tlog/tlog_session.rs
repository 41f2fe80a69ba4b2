//! Accounting for each frame.

use super::clock::{BootClock, ReceiveClock};
use super::definition::{Definition, Definitions};
use super::framing::{Framing, NO_FRAME, next_time, time_us};
use super::mavlink_frame::{Frame, Sender};
use super::mavlink_vehicle::Vehicle;
use crate::decode::cells::{CellKind, CellLayout, push_hex};
use crate::decode::{Route, Tally, Times, Topics};
use crate::format::report_too_many_topics;
use crate::reader::Log;
use crate::table::{PAYLOAD_HEX, TopicInfo};
use flight::{Clock, Code, Notices, Severity};
use logscan::Fate;
use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};

/// Topics in one log: a hundred vehicles with a hundred messages each need fewer.
pub(super) const MOST_TOPICS: usize = 8192;

/// Why a frame is rejected.
pub(super) fn fault(frame: &Frame<'_>) -> Cow<'static, str> {
    match frame.intact {
        None => format!(
            "a frame of the unknown message {}: its checksum cannot be checked, and no frame follows it",
            frame.message
        )
        .into(),
        // The flags may be corrupt, or the header longer than this reader knows.
        _ if frame.unknown_flags != 0 => {
            "a frame with unknown incompatibility flags; its checksum is wrong for every known header".into()
        }
        _ => "the checksum of a frame is wrong".into(),
    }
}

const FLAGGED: &str = "unknown incompatibility flags";

/// Properties shared by the messages of one topic and layout.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct Key {
    sender: Sender,
    message: u32,
    wide: bool,
    /// Run of the vehicle, if not the first.
    run: Option<usize>,
}

/// Routes each message to its topic.
pub(super) struct Session<'b, 't> {
    main: Sender,
    topics: &'b mut Topics<'t>,
    routes: HashMap<Key, Option<Route>>,
    vehicle: Vehicle,
    /// Every frame has the time at which it was received.
    stamped: bool,
    receive: ReceiveClock,
    boot: BootClock,
    frames: u64,
    /// Bytes of text before the first frame.
    pub(super) preamble: u64,
    /// Frames by message number.
    undefined: BTreeMap<u32, u64>,
    flagged: Tally,
    /// Messages of the vehicle from later runs, which are not used.
    later_runs: u64,
    unplaced: Tally,
    restored: Vec<u8>,
}

impl<'b, 't> Session<'b, 't> {
    pub(super) fn new(main: Sender, stamped: bool, topics: &'b mut Topics<'t>) -> Session<'b, 't> {
        Session {
            main,
            topics,
            routes: HashMap::new(),
            vehicle: Vehicle::new(if stamped { Clock::Unix } else { Clock::Boot }),
            stamped,
            receive: ReceiveClock::default(),
            boot: BootClock::default(),
            frames: 0,
            preamble: 0,
            undefined: BTreeMap::new(),
            flagged: Tally::default(),
            later_runs: 0,
            unplaced: Tally::default(),
            restored: vec![],
        }
    }

    /// Takes a record (a frame and what precedes it) at this position of a file; `after` holds some of the following
    /// bytes.
    pub(super) fn record(
        &mut self,
        record: &[u8],
        after: &[u8],
        framing: Framing,
        at: u64,
    ) -> Result<Fate, Cow<'static, str>> {
        let frame = Frame::at(record.get(framing.front()..).unwrap_or_default()).map_err(|_| NO_FRAME)?;
        let logged_ns = match framing {
            Framing::Stamped if self.stamped => {
                let next = next_time(after);
                let second = next.and_then(|(_, after)| next_time(after));
                let ahead = [next, second].map(|ahead| ahead.map(|(time, _)| time));
                self.receive.stamp(time_us(record).unwrap_or_default(), ahead)
            }
            // The vehicle's clock as last reported, for messages about the vehicle itself.
            _ => self.boot.told_ns(),
        };
        if frame.unknown_flags != 0 {
            self.flagged.add(|| format!("message {} with flags {:#04x}", frame.message, frame.unknown_flags));
            return Ok(Fate::Skipped);
        }
        Ok(self.message(&frame, logged_ns, at))
    }

    /// The error for a log with intact frames, not one of which could be used.
    pub(super) fn why_nothing(&self) -> Option<String> {
        let Tally { count, first } = &self.flagged;
        (self.frames == 0 && *count > 0)
            .then(|| format!("all intact frames ({count}) have {FLAGGED} and were not read; the first: {first}"))
    }

    fn message(&mut self, frame: &Frame<'_>, logged_ns: i64, place: u64) -> Fate {
        self.frames += 1;
        let sender = Sender::of(frame);
        let restarts = if self.stamped { 0 } else { self.boot.restarts() };
        let run = (restarts > 0 && sender == self.main).then_some(restarts + 1);
        self.later_runs += u64::from(run.is_some());
        let Some(route) = self.route(sender, run, frame) else {
            self.unplaced.add(|| format!("message {}", frame.message));
            return Fate::Skipped;
        };
        let times = Times { logged_ns, published_ns: None };
        let Some(definition) = definition_of(frame) else {
            *self.undefined.entry(frame.message).or_default() += 1;
            if !self.topics.takes_extras() {
                return self.topics.message(route, times, frame.payload);
            }
            let mut whole = String::new();
            push_hex(frame.payload, &mut whole);
            return self.topics.message(route, times, whole.as_bytes());
        };
        // A sender of MAVLink 2 omits trailing zeros.
        let length = if frame.wide { definition.length(true) } else { 0 };
        self.restored.clear();
        self.restored.extend_from_slice(frame.payload);
        self.restored.resize(frame.payload.len().max(length), 0);
        if sender == self.main {
            if run.is_none() {
                self.vehicle.observe(frame.message, &self.restored, logged_ns);
            }
            let came = if self.stamped { logged_ns } else { place as i64 };
            self.boot.message(definition, frame.message, &self.restored, came);
        }
        if let Some(derived) = definition.derived(&self.restored) {
            self.restored.splice(..0, derived);
        }
        self.topics.message(route, times, &self.restored)
    }

    /// Destination for messages of this sender; `None` if there are too many topics.
    fn route(&mut self, sender: Sender, run: Option<usize>, frame: &Frame<'_>) -> Option<Route> {
        let definition = definition_of(frame);
        let key = Key { sender, message: frame.message, wide: frame.wide, run };
        if let Some(route) = self.routes.get(&key) {
            return *route;
        }
        if self.routes.len() >= MOST_TOPICS {
            return None;
        }
        let type_name = definition.map_or_else(|| format!("MESSAGE_{}", frame.message), |d| d.name.to_owned());
        let name = match (sender.system == self.main.system, sender.component == self.main.component) {
            (true, true) => type_name.clone(),
            (false, true) => format!("{type_name}@{}", sender.system),
            (_, false) => format!("{type_name}@{}.{}", sender.system, sender.component),
        };
        let name = run.map_or(name.clone(), |run| format!("{name}#{run}"));
        let info = TopicInfo { name, type_name, encoding: "mavlink".to_owned() };
        let route = match definition {
            Some(d) => self.topics.packed_route(info, d.text(frame.wide).as_bytes(), |_| Ok(d.layout(frame.wide))),
            None if self.topics.takes_extras() => {
                self.topics.cells_route(info, &[], || Ok(CellLayout::of([(PAYLOAD_HEX, CellKind::Text)])))
            }
            None => self.topics.packed_route(info, &[], |_| Err("an undefined message".to_owned())),
        };
        let route = route.ok();
        self.routes.insert(key, route);
        route
    }

    /// Writes what the log says about its vehicle, and what was wrong with it.
    pub(super) fn finish(self, log: &mut Log, notices: &mut Notices) {
        let text = format!("frames have {FLAGGED}: they are intact, but were not read, as MAVLink requires");
        self.flagged.report(Code::UnknownRecord.at(Severity::Loss), "", &text, notices);
        report_too_many_topics(&self.unplaced, "messages", "", notices);
        let text = "the receive times of these frames jump away from those of their neighbours and back; times \
            between the neighbours are used instead";
        self.receive.out_of_line.report(Code::UnreliableStamps.at(Severity::Loss), "", text, notices);
        let text = "frames have a receive time before 2000 or after 2100: the clock was not set";
        self.receive.unset.report(Code::UnreliableStamps, "", text, notices);
        let text = "the clock of the receive times was set back";
        self.receive.set_back.report(Code::UnreliableStamps, "", text, notices);
        let frames = self.undefined.values().sum();
        if frames > 0 {
            let text = format!("frames of undefined messages were not read: {}", listed(&self.undefined));
            notices.push(Code::UnknownRecord, "", frames, text);
        }
        crate::format::report_preamble(self.preamble, notices);
        if self.stamped {
            log.restarts = self.boot.finish();
        } else {
            let text = "frames have no receive times: the only clocks are those of the messages";
            notices.push(Code::StampKind.at(Severity::Warning), "", self.frames, text);
        }
        if self.later_runs > 0 {
            let text = "messages are of a later run of the vehicle: its clock since boot restarts. Without receive \
                times, the time between the runs is unknown. Channels are made from the first run only. The topics \
                of the others have the number of the run, such as ATTITUDE#2";
            notices.push(Code::Undated.at(Severity::Loss), "", self.later_runs, text);
        }
        log.health.about = self.vehicle.finish();
    }
}

/// The definition of a frame's message, unless the frame belongs to another one.
fn definition_of(frame: &Frame<'_>) -> Option<&'static Definition> {
    Definitions::all().get(frame.message).filter(|_| frame.intact.is_some())
}

/// The first few message numbers, with the number of frames of each.
fn listed(messages: &BTreeMap<u32, u64>) -> String {
    const LISTED: usize = 10;
    let list: Vec<String> =
        messages.iter().take(LISTED).map(|(number, frames)| format!("{number} ({frames})")).collect();
    let more = messages.len().saturating_sub(LISTED);
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    let word = if messages.len() == 1 { "number" } else { "numbers" };
    format!("{word} {}{more}", list.join(", "))
}
