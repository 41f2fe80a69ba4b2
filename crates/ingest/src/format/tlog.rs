//! Telemetry of MAVLink as ground stations write it: each frame behind the time at which it came, µs of UTC in eight
//! bytes, the highest first (<https://mavlink.io/en/file_formats/#tlog>).
//!
//! Every frame has a checksum, and it is checked; of a message that is not defined, whether it is the same layout every
//! time. A frame from whose end a ground station took zeros under its checksum is intact with them. A topic is named after
//! its message. The vehicle with the smallest number has the plain name; what another vehicle says is `GPS_RAW_INT@2`, and
//! another component of this one `ODOMETRY@1.197`.
//!
//! The definitions are a table and not the `mavlink` crate, which refuses whole messages for one number that its
//! enumerations do not know, and passes what it cannot read without a count. The table goes into columns as it is, the
//! checksum of every frame proves its line, and the crate writes and reads every message of it in the tests.

mod checksum;
mod clock;
mod definition;
mod frame;
mod recut;
mod vehicle;

use self::clock::{BootClock, PLAUSIBLE_US, ReceiveClock};
use self::definition::Definitions;
use self::frame::{Finder, Frame, LONGEST, MAGIC, NoFrame, SIGNATURE};
use self::recut::Recut;
use self::vehicle::Vehicle;
use crate::bytes::is_zero;
use crate::decode::cells::{CellKind, CellLayout, push_hex};
use crate::decode::{Route, Tally, Times, Topics};
use crate::error::IngestError;
use crate::format::file::LogFile;
use crate::format::{MOST_ZEROS, Reading};
use crate::ledger::{Fate, Ledger};
use crate::reader::{Log, LogReader, ReadContext, Select};
use crate::table::{PAYLOAD_HEX, TopicInfo};
use flight::{Notices, Severity};
use std::collections::HashMap;
use std::path::PathBuf;

/// Bytes of the time in front of a frame.
const TIME: usize = 8;
/// Bytes searched in one go.
const BLOCK: usize = 256 << 10;
/// Bytes in which the heartbeat of every vehicle is expected.
const BEGIN: u64 = 1 << 20;
/// Topics in one log: a hundred vehicles with a hundred messages each need fewer.
const MOST_TOPICS: usize = 8192;
/// Messages that are not defined and whose layout is remembered.
const MOST_UNKNOWN: usize = 4096;

/// Reads one telemetry log, or several that make up one flight.
#[derive(Debug, Clone)]
pub struct TlogReader {
    files: Vec<PathBuf>,
}

impl TlogReader {
    /// A reader of these files. Nothing is opened yet.
    #[must_use]
    pub fn new(files: Vec<PathBuf>) -> TlogReader {
        TlogReader { files }
    }
}

impl LogReader for TlogReader {
    fn read(&mut self, want: &dyn Select, context: &ReadContext<'_>) -> Result<Log, IngestError> {
        let context = &super::with_topics(context, MOST_TOPICS);
        let Reading { mut files, mut ledger, mut notices, mut topics } = Reading::begin(&self.files, want, context)?;
        let mut log = Log::default();
        log.health.format = "MAVLink telemetry".to_owned();
        let mut recut = Recut::default();
        let main = match files.first_mut() {
            Some(first) => main_vehicle(first, &mut recut, context)?,
            None => Sender::default(),
        };
        let mut book = Book::new(main, recut, &mut topics);
        for file in &mut files {
            super::refuse_foreign(file, NO_FRAME, context)?;
            let (name, search) = (file.name().to_owned(), Search::default());
            book.receive.next_file();
            Walk { name, file, context, ledger: &mut ledger, book: &mut book, at: 0, search }.run()?;
        }
        book.finish(&mut log, &mut notices);
        Reading { files, ledger, notices, topics }.conclude(log)
    }
}

/// Said where no frame begins.
const NO_FRAME: &str = "what stands here is no frame of MAVLink";

/// Whether these first bytes of a file are frames with times in front.
pub(crate) fn looks_like(head: &[u8]) -> bool {
    let plausible = |bytes: &[u8]| time_us(bytes).is_some_and(|time| PLAUSIBLE_US.contains(&time));
    let begins = head.get(TIME).is_some_and(|magic| MAGIC.contains(magic)) && plausible(head);
    let frame = || Frame::at(head.get(TIME..).unwrap_or_default()).ok();
    begins && frame().is_some_and(|frame| frame.intact == Some(true) || frame.zeros_cut.is_some())
}

fn time_us(bytes: &[u8]) -> Option<u64> {
    bytes.first_chunk().map(|eight| u64::from_be_bytes(*eight))
}

/// Who sent a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
struct Sender {
    system: u8,
    component: u8,
}

impl Sender {
    fn of(frame: &Frame<'_>) -> Sender {
        Sender { system: frame.system, component: frame.component }
    }
}

impl Default for Sender {
    /// An autopilot whose numbers nobody has changed.
    fn default() -> Sender {
        Sender { system: 1, component: 1 }
    }
}

/// The autopilot with the smallest number among those whose heartbeat is near the begin of the log. Who sends zeros at the
/// end of payloads is learned on the way.
fn main_vehicle(file: &mut LogFile, recut: &mut Recut, context: &ReadContext<'_>) -> Result<Sender, IngestError> {
    let (mut at, end) = (0, file.size().min(BEGIN));
    let mut search = Search::default();
    let mut main = None;
    while at < end {
        let bytes = file.up_to(at, TIME + LONGEST)?;
        match Frame::at(bytes.get(TIME..).unwrap_or_default()) {
            Ok(frame) if frame.intact != Some(false) || frame.zeros_cut.is_some() => {
                let sender = Sender::of(&frame);
                recut.learn(sender, time_us(bytes).unwrap_or_default(), &frame);
                if frame.intact != Some(false) && vehicle::is_autopilot(frame.message, frame.payload) {
                    main = Some(main.map_or(sender, |main: Sender| main.min(sender)));
                }
                at += (TIME + frame.length) as u64;
            }
            _ => at = search.next(file, at + 1, end, context)?,
        }
    }
    Ok(main.unwrap_or_default())
}

/// A search for intact frames. What was learned of a block serves the next search in it.
#[derive(Default)]
struct Search {
    /// A block and where it begins.
    searched: Option<(u64, Finder)>,
}

impl Search {
    /// Where the next intact frame of a defined message begins, at or behind `from`; `end` if there is none before.
    fn next(&mut self, file: &mut LogFile, from: u64, end: u64, context: &ReadContext<'_>) -> Result<u64, IngestError> {
        let (mut at, mut zeros) = (from, 0);
        while at < end && zeros <= MOST_ZEROS {
            if self.searched.as_ref().is_none_or(|(start, _)| at - start >= BLOCK as u64) {
                // What a block of the search begins with may be as long as a record.
                self.searched = Some((at, Finder::new(file.up_to(at, BLOCK + TIME + LONGEST)?.to_vec())));
            }
            let Some((start, finder)) = &self.searched else { break };
            let (first, block) = ((at - start) as usize, finder.block());
            let found = memchr::memchr2_iter(MAGIC[0], MAGIC[1], block.get(first + TIME..).unwrap_or_default())
                .map(|hit| first + hit)
                .take_while(|hit| *hit < BLOCK)
                .find(|&hit| {
                    let time = block.get(hit..).and_then(time_us);
                    time.is_some_and(|time| PLAUSIBLE_US.contains(&time)) && finder.is_frame(hit + TIME)
                });
            if let Some(hit) = found {
                return Ok((start + hit as u64).min(end));
            }
            at = start + BLOCK as u64;
            zeros = if is_zero(block) { zeros + BLOCK as u64 } else { 0 };
            file.progress(at.min(end), context)?;
        }
        Ok(end)
    }
}

/// A walk in progress.
struct Walk<'w, 'c, 'b, 't> {
    file: &'w mut LogFile,
    name: String,
    context: &'w ReadContext<'c>,
    ledger: &'w mut Ledger,
    book: &'w mut Book<'b, 't>,
    at: u64,
    search: Search,
}

impl Walk<'_, '_, '_, '_> {
    /// From the first byte to the last.
    fn run(mut self) -> Result<(), IngestError> {
        while self.at < self.file.size() {
            // The times of the next two frames speak for that of this one.
            let bytes = self.file.up_to(self.at, 2 * (TIME + LONGEST) + TIME + 1)?;
            match self.book.record(bytes) {
                Ok((fate, length)) => {
                    self.ledger.count(fate, length as u64);
                    self.at += length as u64;
                }
                Err(reason) => self.lost(reason)?,
            }
            self.file.progress(self.at, self.context)?;
        }
        Ok(())
    }

    /// Goes on where the next intact frame begins.
    fn lost(&mut self, reason: &str) -> Result<(), IngestError> {
        let next = self.search.next(self.file, self.at + 1, self.file.size(), self.context)?;
        let reason = if next == self.file.size() && reason == CUT { "the log ends inside a frame" } else { reason };
        self.ledger.damaged(&self.name, self.at, next - self.at, reason);
        self.at = next;
        Ok(())
    }
}

/// The time in front of a frame that the bytes begin with, and what follows that frame.
fn next_time(bytes: &[u8]) -> Option<(u64, &[u8])> {
    let time = time_us(bytes).filter(|_| bytes.get(TIME).is_some_and(|magic| MAGIC.contains(magic)))?;
    let length = Frame::length_at(bytes.get(TIME..)?).unwrap_or(usize::MAX);
    Some((time, bytes.get(TIME..)?.get(length..).unwrap_or_default()))
}

/// Said of a frame that is not all there.
const CUT: &str = "a frame whose length leads nowhere";

/// Said of a frame of a message that is not defined, if it does not agree with those before.
const UNKNOWN: &str = "a frame of a message that is not known, so that its checksum cannot be checked; it has no layout, or \
                       another one than before";

/// The way of each message to its topic.
struct Book<'b, 't> {
    main: Sender,
    topics: &'b mut Topics<'t>,
    routes: HashMap<(Sender, u32, bool), Option<Route>>,
    vehicle: Vehicle,
    receive: ReceiveClock,
    boot: BootClock,
    /// What stands for the layout of a message that is not defined, as its first frame has it.
    unknown: HashMap<u32, u8>,
    recut: Recut,
    /// Frames whose zeros were put back.
    completed: Tally,
    cut_signatures: Tally,
    undefined: Tally,
    flagged: Tally,
    unplaced: Tally,
    restored: Vec<u8>,
}

impl<'b, 't> Book<'b, 't> {
    fn new(main: Sender, recut: Recut, topics: &'b mut Topics<'t>) -> Book<'b, 't> {
        Book {
            main,
            topics,
            routes: HashMap::new(),
            vehicle: Vehicle::default(),
            receive: ReceiveClock::default(),
            boot: BootClock::default(),
            unknown: HashMap::new(),
            recut,
            completed: Tally::default(),
            cut_signatures: Tally::default(),
            undefined: Tally::default(),
            flagged: Tally::default(),
            unplaced: Tally::default(),
            restored: vec![],
        }
    }

    /// The record that the bytes begin with: its fate and its length, or why there is none.
    fn record(&mut self, bytes: &[u8]) -> Result<(Fate, usize), &'static str> {
        let time = time_us(bytes).ok_or(CUT)?;
        let frame = Frame::at(bytes.get(TIME..).unwrap_or_default()).map_err(|no| match no {
            NoFrame::Foreign => NO_FRAME,
            NoFrame::Cut => CUT,
        })?;
        let sender = Sender::of(&frame);
        self.recut.learn(sender, time, &frame);
        match frame.intact {
            Some(false) if self.recut.vouches_for(sender, &frame) => {
                self.completed.add(|| format!("message {} of {}.{}", frame.message, sender.system, sender.component));
            }
            Some(false) => return Err("the checksum of a frame is wrong"),
            None if !self.is_consistent(&frame) => return Err(UNKNOWN),
            _ => {}
        }
        let length = self.end_of(&frame, bytes);
        let next = bytes.get(length..).and_then(next_time);
        let second = next.and_then(|(_, behind)| next_time(behind));
        let logged_ns = self.receive.stamp(time, [next, second].map(|ahead| ahead.map(|(time, _)| time)));
        if frame.unknown_flags {
            self.flagged.add(|| format!("message {}", frame.message));
            return Ok((Fate::Skipped, length));
        }
        Ok((self.message(&frame, logged_ns), length))
    }

    /// Where the record of this frame ends. A signature that was cut does not take the begin of the next record with it.
    fn end_of(&mut self, frame: &Frame<'_>, bytes: &[u8]) -> usize {
        let end = TIME + frame.length;
        let begins = |at: &usize| bytes.get(*at..).is_some_and(looks_like);
        if !frame.is_signed || begins(&end) {
            return end;
        }
        let cut = (end - SIGNATURE..end).find(begins);
        if cut.is_some() {
            self.cut_signatures.add(|| format!("message {} of {}.{}", frame.message, frame.system, frame.component));
        }
        cut.unwrap_or(end)
    }

    /// Whether a message that is not defined has the layout that it had before.
    fn is_consistent(&mut self, frame: &Frame<'_>) -> bool {
        let Some(extra) = frame.extra else { return false };
        if self.unknown.len() >= MOST_UNKNOWN && !self.unknown.contains_key(&frame.message) {
            return false;
        }
        *self.unknown.entry(frame.message).or_insert(extra) == extra
    }

    fn message(&mut self, frame: &Frame<'_>, logged_ns: i64) -> Fate {
        let sender = Sender::of(frame);
        let Some(route) = self.route(sender, frame) else {
            self.unplaced.add(|| format!("message {}", frame.message));
            return Fate::Skipped;
        };
        let times = Times { logged_ns, published_ns: None };
        let Some(definition) = Definitions::all().get(frame.message) else {
            self.undefined.add(|| format!("number {}", frame.message));
            if !self.topics.takes_extras() {
                return self.topics.message(route, times, frame.payload);
            }
            let mut whole = String::new();
            push_hex(frame.payload, &mut whole);
            return self.topics.message(route, times, whole.as_bytes());
        };
        // A sender of MAVLink 2 leaves out the zeros at the end.
        let length = if frame.wide { definition.length(true) } else { 0 };
        self.restored.clear();
        self.restored.extend_from_slice(frame.payload);
        self.restored.resize(frame.payload.len().max(length), 0);
        if sender == self.main {
            self.vehicle.tell(frame.message, &self.restored, logged_ns);
            self.boot.message(definition, frame.message, &self.restored, logged_ns);
        }
        self.topics.message(route, times, &self.restored)
    }

    /// Where messages of this sender go; `None` if there are too many topics.
    fn route(&mut self, sender: Sender, frame: &Frame<'_>) -> Option<Route> {
        if let Some(route) = self.routes.get(&(sender, frame.message, frame.wide)) {
            return *route;
        }
        if self.routes.len() >= MOST_TOPICS {
            return None;
        }
        let definition = Definitions::all().get(frame.message);
        let type_name = definition.map_or_else(|| format!("MESSAGE_{}", frame.message), |d| d.name.to_owned());
        let name = match (sender.system == self.main.system, sender.component == self.main.component) {
            (true, true) => type_name.clone(),
            (false, true) => format!("{type_name}@{}", sender.system),
            (_, false) => format!("{type_name}@{}.{}", sender.system, sender.component),
        };
        let info = TopicInfo { name, type_name, encoding: "mavlink".to_owned() };
        let route = match definition {
            Some(d) => self.topics.packed_route(info, d.text(frame.wide).as_bytes(), |_| Ok(d.layout(frame.wide))),
            None if self.topics.takes_extras() => {
                self.topics.cells_route(info, &[], || Ok(CellLayout::of([(PAYLOAD_HEX, CellKind::Text)])))
            }
            None => self.topics.packed_route(info, &[], |_| Err("a message that is not defined".to_owned())),
        };
        let route = route.ok();
        self.routes.insert((sender, frame.message, frame.wide), route);
        route
    }

    /// Writes what the log says of its vehicle, and what was wrong with it.
    fn finish(self, log: &mut Log, notices: &mut Notices) {
        let mut say = |severity, code: &str, tally: &Tally, text: &str| {
            if tally.count > 0 {
                notices.push(severity, code, "", tally.count, format!("{text}; the first: {}", tally.first));
            }
        };
        let text = "frames of messages that are not defined were not read";
        say(Severity::Warning, "unknown-message", &self.undefined, text);
        let text = "frames have the checksum of a payload with zeros at its end, which the ground station left out as it \
                    wrote them; with the zeros they are intact, and were read";
        say(Severity::Info, "zeros-cut", &self.completed, text);
        let text = "frames are intact, but bytes of the signature behind them are missing";
        say(Severity::Loss, "cut-signature", &self.cut_signatures, text);
        let text = "frames with flags that nobody knows were not read";
        say(Severity::Loss, "unknown-flags", &self.flagged, text);
        let text = "messages found no topic, for there are too many";
        say(Severity::Loss, "unknown-channel", &self.unplaced, text);
        let text = "the times in front of frames leap away from those of their neighbours and back; the frames have a time \
                    between";
        say(Severity::Loss, "receive-time", &self.receive.out_of_line, text);
        let text = "frames were received before 2000 or after 2100 by a clock that was not set";
        say(Severity::Warning, "receive-clock-unset", &self.receive.unset, text);
        let text = "the clock by which frames were received was set back";
        say(Severity::Warning, "receive-clock-back", &self.receive.set_back, text);
        log.restarts = self.boot.finish();
        log.health.about = self.vehicle.finish();
    }
}
