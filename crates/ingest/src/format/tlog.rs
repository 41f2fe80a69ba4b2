//! Telemetry of MAVLink as ground stations write it: each frame behind the time at which it came, µs of UTC in eight
//! bytes, the highest first (<https://mavlink.io/en/file_formats/#tlog>).
//!
//! Every frame has a checksum, and it is checked; of a message that is not defined, whether it is the same layout every
//! time. A frame from whose end a ground station took zeros under its checksum is intact with them. A topic is named after
//! its message. The vehicle with the smallest number has the plain name; what another vehicle says is `GPS_RAW_INT@2`, and
//! another component of this one `ODOMETRY@1.197`.
//!
//! A stream may also be written as it came, frame behind frame without times (MAVProxy's `.tlog.raw`, a capture of a serial
//! line). Then the messages' own clocks are all there is.
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
use flight::{Clock, Notices, Severity};
use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};
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
        let mut recut = Recut::default();
        let framings = files.iter_mut().map(Framing::of_file).collect::<Result<Vec<_>, _>>()?;
        let main = match files.first_mut().zip(framings.first()) {
            Some((first, framing)) => main_vehicle(first, *framing, &mut recut, context)?,
            None => Sender::default(),
        };
        // Times that only some of the frames have would be none of the log's.
        let stamped = !framings.contains(&Framing::Bare);
        log.health.format = if stamped { "MAVLink telemetry" } else { "MAVLink stream" }.to_owned();
        let mut book = Book::new(main, recut, stamped, &mut topics);
        for (file, framing) in files.iter_mut().zip(framings) {
            super::refuse_foreign(file, NO_FRAME, context)?;
            let (name, search) = (file.name().to_owned(), Search::of(framing));
            book.receive.next_file();
            Walk { name, file, context, ledger: &mut ledger, book: &mut book, framing, at: 0, search }.run()?;
        }
        book.finish(&mut log, &mut notices);
        let mut log = Reading { files, ledger, notices, topics }.conclude(log)?;
        if !stamped {
            super::nmea::forget_log_times(&mut log);
        }
        Ok(log)
    }
}

/// What stands in front of every frame of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Framing {
    /// The time at which it came.
    Stamped,
    /// Nothing: it follows the frame before.
    Bare,
}

/// So many frames in a row without a time between them are no accident.
const FEWEST_BARE: usize = 3;
/// The longest text that an autopilot prints before the first frame, bytes.
const LONGEST_PREAMBLE: usize = 4 << 10;

impl Framing {
    /// Bytes in front of a frame.
    fn front(self) -> usize {
        match self {
            Framing::Stamped => TIME,
            Framing::Bare => 0,
        }
    }

    fn of_file(file: &mut LogFile) -> Result<Framing, IngestError> {
        Ok(Framing::of(file.up_to(0, crate::sniff::HEAD)?))
    }

    /// As most of the frames show that follow another or the begin.
    fn of(head: &[u8]) -> Framing {
        let finder = Finder::new(head.to_vec());
        let (mut stamped, mut bare, mut at, mut end) = (0, 0, 0, 0);
        while at < head.len() {
            if !finder.is_frame(at) {
                at += 1;
                continue;
            }
            stamped += usize::from(at == end + TIME);
            bare += usize::from(at == end);
            at += Frame::length_at(head.get(at..).unwrap_or_default()).unwrap_or(1);
            end = at;
        }
        if bare > stamped { Framing::Bare } else { Framing::Stamped }
    }
}

/// Said where no frame begins.
const NO_FRAME: &str = "what stands here is no frame of MAVLink";

/// Whether these first bytes of a file are frames with times in front, or one behind the other.
pub(crate) fn looks_like(head: &[u8]) -> bool {
    begins_stamped(head) || begins_bare(head)
}

fn begins_bare(head: &[u8]) -> bool {
    let finder = Finder::new(head.get(..LONGEST_PREAMBLE + LONGEST * (FEWEST_BARE + 1)).unwrap_or(head).to_vec());
    let next = |at: &usize| Some(at + Frame::length_at(head.get(*at..)?)?);
    let in_a_row = |at| std::iter::successors(Some(at), next).take_while(|at| finder.is_frame(*at));
    let first = (0..=LONGEST_PREAMBLE.min(head.len())).find(|at| finder.is_frame(*at));
    first.is_some_and(|at| in_a_row(at).take(FEWEST_BARE).count() == FEWEST_BARE)
}

fn begins_stamped(head: &[u8]) -> bool {
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
fn main_vehicle(
    file: &mut LogFile,
    framing: Framing,
    recut: &mut Recut,
    context: &ReadContext<'_>,
) -> Result<Sender, IngestError> {
    let (mut at, end) = (0, file.size().min(BEGIN));
    let (mut search, front) = (Search::of(framing), framing.front());
    let mut main = None;
    while at < end {
        let bytes = file.up_to(at, front + LONGEST)?;
        match Frame::at(bytes.get(front..).unwrap_or_default()) {
            Ok(frame) if frame.intact != Some(false) || frame.zeros_cut.is_some() => {
                let sender = Sender::of(&frame);
                recut.learn(sender, at, &frame);
                let is_known = frame.intact != Some(false) && frame.unknown_flags == 0;
                if is_known && vehicle::is_autopilot(frame.message, frame.payload) {
                    main = Some(main.map_or(sender, |main: Sender| main.min(sender)));
                }
                at += (front + frame.length) as u64;
            }
            _ => at = search.next(file, at + 1, end, context)?,
        }
    }
    Ok(main.unwrap_or_default())
}

/// A search for intact frames. What was learned of a block serves the next search in it.
struct Search {
    framing: Framing,
    /// A block and where it begins.
    searched: Option<(u64, Finder)>,
}

impl Search {
    fn of(framing: Framing) -> Search {
        Search { framing, searched: None }
    }

    /// Where the next intact frame of a defined message begins, at or behind `from`; `end` if there is none before.
    fn next(&mut self, file: &mut LogFile, from: u64, end: u64, context: &ReadContext<'_>) -> Result<u64, IngestError> {
        let (mut at, mut zeros) = (from, 0);
        let front = self.framing.front();
        while at < end && zeros <= MOST_ZEROS {
            if self.searched.as_ref().is_none_or(|(start, _)| at - start >= BLOCK as u64) {
                // What a block of the search begins with may be as long as a record.
                self.searched = Some((at, Finder::new(file.up_to(at, BLOCK + front + LONGEST)?.to_vec())));
            }
            let Some((start, finder)) = &self.searched else { break };
            let (first, block) = ((at - start) as usize, finder.block());
            let found = memchr::memchr2_iter(MAGIC[0], MAGIC[1], block.get(first + front..).unwrap_or_default())
                .map(|hit| first + hit)
                .take_while(|hit| *hit < BLOCK)
                .find(|&hit| {
                    let time = || block.get(hit..).and_then(time_us);
                    let plausible = front == 0 || time().is_some_and(|time| PLAUSIBLE_US.contains(&time));
                    plausible && finder.is_frame(hit + front)
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
    framing: Framing,
    at: u64,
    search: Search,
}

impl Walk<'_, '_, '_, '_> {
    /// From the first byte to the last.
    fn run(mut self) -> Result<(), IngestError> {
        while self.at < self.file.size() {
            // The times of the next two frames speak for that of this one.
            let bytes = self.file.up_to(self.at, 2 * (TIME + LONGEST) + TIME + 1)?;
            match self.book.record(bytes, self.framing, self.at) {
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
    fn lost(&mut self, reason: Cow<'static, str>) -> Result<(), IngestError> {
        let behind = self.known_behind()?;
        let found = self.search.next(self.file, self.at + 1, self.file.size(), self.context)?;
        let next = behind.map_or(found, |behind| behind.min(found));
        if self.at == 0 && self.begins_with_text(next)? {
            self.ledger.count(Fate::Skipped, next);
            self.book.preamble += next;
            self.at = next;
            return Ok(());
        }
        let is_cut = next == self.file.size() && reason == CUT;
        let reason = if is_cut { "the log ends inside a frame".into() } else { reason };
        self.ledger.damaged(&self.name, self.at, next - self.at, reason);
        self.at = next;
        Ok(())
    }
}

impl Walk<'_, '_, '_, '_> {
    /// Whether there is but text before this place: what an autopilot prints on its line as it starts.
    fn begins_with_text(&mut self, end: u64) -> Result<bool, IngestError> {
        if self.framing == Framing::Stamped || end == self.file.size() || end > LONGEST_PREAMBLE as u64 {
            return Ok(false);
        }
        let text = self.file.up_to(0, end as usize)?;
        Ok(super::nmea::is_plain(text) && text.ends_with(b"\n"))
    }

    /// Where the damaged frame ends, if one of a message that is not defined follows whose layout is known from before.
    /// Elsewhere none is searched for: nothing but this place vouches for it.
    fn known_behind(&mut self) -> Result<Option<u64>, IngestError> {
        let front = self.framing.front();
        let bytes = self.file.up_to(self.at, 2 * (front + LONGEST))?;
        let length = bytes.get(front..).and_then(Frame::length_at).map(|length| front + length);
        let next = length.and_then(|length| Frame::at(bytes.get(length + front..)?).ok());
        let is_known = next.is_some_and(|frame| self.book.has_layout(&frame));
        Ok(length.filter(|_| is_known).map(|length| self.at + length as u64))
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
fn unknown(message: u32) -> String {
    format!(
        "a frame of message {message}, which is not known, so that its checksum cannot be checked; it has no layout, or another \
         one than before"
    )
}

/// Said of a frame with unknown flags whose checksum fits no header that is known: either may be damaged.
const UNKNOWN_FLAGS: &str = "a frame with incompatibility flags that are not known, and whose checksum is wrong for every \
                             header that is";

/// What stands for the layout of a message that is not defined: as its first frame has it, unless that stays alone and two
/// others agree.
struct Guess {
    extra: u8,
    seen: u64,
    rival: Option<u8>,
}

impl Guess {
    fn agrees(&mut self, extra: u8) -> bool {
        if extra != self.extra && (self.seen > 1 || self.rival.replace(extra) != Some(extra)) {
            return false;
        }
        self.seen += 1;
        self.extra = extra;
        true
    }
}

/// The way of each message to its topic.
struct Book<'b, 't> {
    main: Sender,
    topics: &'b mut Topics<'t>,
    routes: HashMap<(Sender, u32, bool), Option<Route>>,
    vehicle: Vehicle,
    /// Every frame has the time at which it was received.
    stamped: bool,
    receive: ReceiveClock,
    boot: BootClock,
    /// Layouts of messages that are not defined.
    unknown: HashMap<u32, Guess>,
    recut: Recut,
    frames: u64,
    /// Bytes of text before the first frame.
    preamble: u64,
    /// Frames whose zeros were put back.
    completed: Tally,
    cut_signatures: Tally,
    /// Frames by the number of their message.
    undefined: BTreeMap<u32, u64>,
    flagged: Tally,
    unplaced: Tally,
    restored: Vec<u8>,
}

impl<'b, 't> Book<'b, 't> {
    fn new(main: Sender, recut: Recut, stamped: bool, topics: &'b mut Topics<'t>) -> Book<'b, 't> {
        Book {
            main,
            topics,
            routes: HashMap::new(),
            vehicle: Vehicle::new(if stamped { Clock::Unix } else { Clock::Boot }),
            stamped,
            receive: ReceiveClock::default(),
            boot: BootClock::default(),
            unknown: HashMap::new(),
            recut,
            frames: 0,
            preamble: 0,
            completed: Tally::default(),
            cut_signatures: Tally::default(),
            undefined: BTreeMap::new(),
            flagged: Tally::default(),
            unplaced: Tally::default(),
            restored: vec![],
        }
    }

    /// The record that the bytes at this place of a file begin with: its fate and its length, or why there is none.
    fn record(&mut self, bytes: &[u8], framing: Framing, at: u64) -> Result<(Fate, usize), Cow<'static, str>> {
        let frame = Frame::at(bytes.get(framing.front()..).unwrap_or_default()).map_err(|no| match no {
            NoFrame::Foreign => NO_FRAME,
            NoFrame::Cut => CUT,
        })?;
        let sender = Sender::of(&frame);
        self.recut.learn(sender, at, &frame);
        match frame.intact {
            Some(false) if self.recut.vouches_for(sender, &frame) => {
                self.completed.add(|| format!("message {} of {}.{}", frame.message, sender.system, sender.component));
            }
            Some(false) if frame.unknown_flags != 0 => return Err(UNKNOWN_FLAGS.into()),
            Some(false) => return Err("the checksum of a frame is wrong".into()),
            None if !self.is_consistent(&frame) => return Err(unknown(frame.message).into()),
            _ => {}
        }
        let length = self.end_of(&frame, bytes, framing);
        let logged_ns = match framing {
            Framing::Stamped if self.stamped => {
                let next = bytes.get(length..).and_then(next_time);
                let second = next.and_then(|(_, behind)| next_time(behind));
                let ahead = [next, second].map(|ahead| ahead.map(|(time, _)| time));
                self.receive.stamp(time_us(bytes).ok_or(CUT)?, ahead)
            }
            // The vehicle's clock as it was told last, for what is said of the vehicle itself.
            _ => self.boot.told_ns(),
        };
        if frame.unknown_flags != 0 {
            self.flagged.add(|| format!("message {} with flags {:#04x}", frame.message, frame.unknown_flags));
            return Ok((Fate::Skipped, length));
        }
        Ok((self.message(&frame, logged_ns), length))
    }

    /// Where the record of this frame ends. A signature that was cut does not take the begin of the next record with it.
    fn end_of(&mut self, frame: &Frame<'_>, bytes: &[u8], framing: Framing) -> usize {
        let end = framing.front() + frame.length;
        let begins = |at: &usize| match framing {
            Framing::Stamped => bytes.get(*at..).is_some_and(begins_stamped),
            Framing::Bare => bytes.get(*at..).is_some_and(|b| Frame::at(b).is_ok_and(|f| f.intact == Some(true))),
        };
        if !frame.is_signed || begins(&end) {
            return end;
        }
        let cut = (end - SIGNATURE..end).find(begins);
        if cut.is_some() {
            self.cut_signatures.add(|| format!("message {} of {}.{}", frame.message, frame.system, frame.component));
        }
        cut.unwrap_or(end)
    }

    /// Whether a message is not defined and has the layout that one had before.
    fn has_layout(&self, frame: &Frame<'_>) -> bool {
        let known = self.unknown.get(&frame.message).filter(|_| frame.intact.is_none() && frame.extra.is_some());
        known.is_some_and(|guess| [Some(guess.extra), guess.rival].contains(&frame.extra))
    }

    /// Whether a message that is not defined has the layout that it had before.
    fn is_consistent(&mut self, frame: &Frame<'_>) -> bool {
        let Some(extra) = frame.extra else { return false };
        if self.unknown.len() >= MOST_UNKNOWN && !self.unknown.contains_key(&frame.message) {
            return false;
        }
        self.unknown.entry(frame.message).or_insert(Guess { extra, seen: 0, rival: None }).agrees(extra)
    }

    fn message(&mut self, frame: &Frame<'_>, logged_ns: i64) -> Fate {
        self.frames += 1;
        let sender = Sender::of(frame);
        let Some(route) = self.route(sender, frame) else {
            self.unplaced.add(|| format!("message {}", frame.message));
            return Fate::Skipped;
        };
        let times = Times { logged_ns, published_ns: None };
        let Some(definition) = Definitions::all().get(frame.message) else {
            *self.undefined.entry(frame.message).or_default() += 1;
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
            self.boot.message(definition, frame.message, &self.restored, self.stamped.then_some(logged_ns));
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
        let text = "frames have the checksum of a payload with zeros at its end, which the ground station left out as it \
                    wrote them; with the zeros they are intact, and were read";
        say(Severity::Info, "zeros-cut", &self.completed, text);
        let text = "frames are intact, but bytes of the signature behind them are missing";
        say(Severity::Loss, "cut-signature", &self.cut_signatures, text);
        let text =
            "frames have incompatibility flags that are not known: they are intact and were not read, as MAVLink asks";
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
        let frames = self.undefined.values().sum();
        if frames > 0 {
            let text = format!("frames of messages that are not defined were not read: {}", listed(&self.undefined));
            notices.push(Severity::Warning, "unknown-message", "", frames, text);
        }
        if self.preamble > 0 {
            let text = "bytes of text stand before the first frame";
            notices.push(Severity::Info, "preamble", "", self.preamble, text);
        }
        let restarts = self.boot.finish();
        if self.stamped {
            log.restarts = restarts;
        } else {
            let text = "frames stand one behind the other without the times at which they were received: their messages' own \
                        clocks are all there is";
            notices.push(Severity::Warning, "no-receive-time", "", self.frames, text);
            if !restarts.is_empty() {
                let text = "the clock since boot begins anew, and without times of reception nothing tells whose rows are \
                            whose: of what was at the same time since boot the longer stretch is used";
                notices.push(Severity::Loss, "clock-restart", "", restarts.len() as u64, text);
            }
        }
        log.health.about = self.vehicle.finish();
    }
}

/// Numbers of messages with how many frames each has, the first few.
fn listed(messages: &BTreeMap<u32, u64>) -> String {
    const LISTED: usize = 10;
    let list: Vec<String> =
        messages.iter().take(LISTED).map(|(number, frames)| format!("{number} ({frames})")).collect();
    let more = messages.len().saturating_sub(LISTED);
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    let word = if messages.len() == 1 { "number" } else { "numbers" };
    format!("{word} {}{more}", list.join(", "))
}
