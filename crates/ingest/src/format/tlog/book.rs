//! What becomes of each frame.

use super::clock::{BootClock, ReceiveClock};
use super::definition::{Definition, Definitions};
use super::frame::{Frame, NoFrame, SIGNATURE};
use super::framing::{Framing, begins_stamped, next_time, time_us};
use super::vehicle::Vehicle;
use super::{Learned, Runs, Sender};
use crate::decode::cells::{CellKind, CellLayout, push_hex};
use crate::decode::{Route, Tally, Times, Topics, Vouch};
use crate::ledger::Fate;
use crate::reader::Log;
use crate::table::{PAYLOAD_HEX, TopicInfo};
use flight::{Clock, Notices, Severity};
use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};

/// Topics in one log: a hundred vehicles with a hundred messages each need fewer.
pub(super) const MOST_TOPICS: usize = 8192;
/// Messages that are not defined and whose layout is remembered.
const MOST_UNKNOWN: usize = 4096;

/// Said where no frame begins.
pub(super) const NO_FRAME: &str = "what stands here is no frame of MAVLink";

/// Said of a frame that is not all there.
pub(super) const CUT: &str = "a frame whose length leads nowhere";

/// Said of a frame of a message that is not defined, if it does not agree with those before.
fn unknown(message: u32) -> String {
    format!(
        "a frame of message {message}, which is not known, so that its checksum cannot be checked; it has no layout, or another \
         one than before, or intact frames stand in what it says is its length"
    )
}

/// Said of a frame with unknown flags whose checksum fits no header that is known: either may be damaged.
const UNKNOWN_FLAGS: &str = "a frame with incompatibility flags that are not known, and whose checksum is wrong for every \
                             header that is";

const FLAGGED: &str = "incompatibility flags that are not known";

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

/// What messages of one topic and layout have in common.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct Key {
    sender: Sender,
    message: u32,
    wide: bool,
    is_defined: bool,
    /// Of the vehicle, beside the longest.
    run: Option<usize>,
}

/// The way of each message to its topic.
pub(super) struct Book<'b, 't> {
    main: Sender,
    topics: &'b mut Topics<'t>,
    routes: HashMap<Key, Option<Route>>,
    vehicle: Vehicle,
    /// Every frame has the time at which it was received.
    stamped: bool,
    receive: ReceiveClock,
    boot: BootClock,
    runs: Runs,
    /// Bytes of the files before.
    before: u64,
    /// Layouts of messages that are not defined.
    unknown: HashMap<u32, Guess>,
    learned: Learned,
    suspects: bool,
    frames: u64,
    /// Bytes of text before the first frame.
    pub(super) preamble: u64,
    /// Frames whose zeros were put back.
    completed: Tally,
    cut_signatures: Tally,
    /// Frames by the number of their message.
    undefined: BTreeMap<u32, u64>,
    flagged: Tally,
    /// Messages of the vehicle from runs that are not used.
    beside: u64,
    unplaced: Tally,
    restored: Vec<u8>,
}

impl<'b, 't> Book<'b, 't> {
    pub(super) fn new(
        main: Sender,
        learned: Learned,
        stamped: bool,
        runs: Runs,
        topics: &'b mut Topics<'t>,
    ) -> Book<'b, 't> {
        Book {
            main,
            topics,
            routes: HashMap::new(),
            vehicle: Vehicle::new(if stamped { Clock::Unix } else { Clock::Boot }),
            stamped,
            receive: ReceiveClock::default(),
            boot: BootClock::default(),
            runs,
            before: 0,
            unknown: HashMap::new(),
            learned,
            suspects: false,
            frames: 0,
            preamble: 0,
            completed: Tally::default(),
            cut_signatures: Tally::default(),
            undefined: BTreeMap::new(),
            flagged: Tally::default(),
            beside: 0,
            unplaced: Tally::default(),
            restored: vec![],
        }
    }

    /// The record that the bytes at this place of a file begin with: its fate and its length, or why there is none.
    pub(super) fn record(
        &mut self,
        bytes: &[u8],
        framing: Framing,
        at: u64,
    ) -> Result<(Fate, usize), Cow<'static, str>> {
        self.suspects = false;
        let mut frame = Frame::at(bytes.get(framing.front()..).unwrap_or_default()).map_err(|no| match no {
            NoFrame::Foreign => NO_FRAME,
            NoFrame::Cut => CUT,
        })?;
        let sender = Sender::of(&frame);
        self.learned.recut.learn(sender, at, &frame);
        let undefined = frame.intact.is_none() && frame.extra.is_some();
        let may_be_other = (frame.other.is_some() || undefined) && framing.goes_on(&frame, bytes);
        if may_be_other {
            self.learned.dialect.learn(self.before + at, &frame);
        }
        let vouched = self.learned.dialect.vouches_for(&frame);
        self.suspects = may_be_other && !vouched && !(undefined && self.may_be_consistent(&frame));
        match frame.intact {
            Some(false) if self.learned.recut.vouches_for(sender, &frame) => {
                self.completed.add(|| format!("message {} of {}.{}", frame.message, sender.system, sender.component));
            }
            Some(false) if vouched => frame = frame.undefined(),
            None if vouched => {}
            Some(false) if frame.unknown_flags != 0 => return Err(UNKNOWN_FLAGS.into()),
            Some(false) => return Err("the checksum of a frame is wrong".into()),
            None if !self.has_layout(&frame) && !framing.believes(&frame, bytes) => {
                return Err(unknown(frame.message).into());
            }
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
        Ok((self.message(&frame, logged_ns, self.before + at), length))
    }

    /// A file of this size has been read.
    pub(super) fn end_file(&mut self, size: u64) {
        self.receive.next_file();
        self.before += size;
    }

    /// What is wrong with a log of which no frame at all could be used although some are intact.
    pub(super) fn why_nothing(&self) -> Option<String> {
        let Tally { count, first } = &self.flagged;
        (self.frames == 0 && *count > 0).then(|| {
            format!("all of its frames that are intact ({count}) have {FLAGGED}, and were not read; the first: {first}")
        })
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

    /// Whether a message is not defined, or otherwise than here, and has the layout that one had before.
    pub(super) fn has_layout(&self, frame: &Frame<'_>) -> bool {
        if self.learned.dialect.vouches_for(frame) {
            return true;
        }
        let known = self.unknown.get(&frame.message).filter(|_| frame.intact.is_none() && frame.extra.is_some());
        known.is_some_and(|guess| [Some(guess.extra), guess.rival].contains(&frame.extra))
    }

    /// Whether several frames showed that a message which is not defined, or otherwise, has this layout.
    pub(super) fn knows(&self, message: u32, extra: u8) -> bool {
        let agree = |guess: &Guess| guess.seen > 1 && guess.extra == extra;
        self.unknown.get(&message).is_some_and(agree) || self.learned.dialect.has(message, extra)
    }

    /// Whether the frame that was refused last may be of another definition, which the rest of the file may confirm.
    pub(super) fn suspects(&self) -> bool {
        self.suspects
    }

    /// Takes in what a look over all of the file that is read shows.
    pub(super) fn learn(&mut self, at: u64, frame: &Frame<'_>) {
        self.learned.dialect.learn(self.before + at, frame);
    }

    /// Whether a message that is not defined is the first one, or has the layout that it had before.
    fn may_be_consistent(&self, frame: &Frame<'_>) -> bool {
        !self.unknown.contains_key(&frame.message) || self.has_layout(frame)
    }

    /// Whether a message that is not defined has the layout that it had before.
    fn is_consistent(&mut self, frame: &Frame<'_>) -> bool {
        let Some(extra) = frame.extra else { return false };
        if self.unknown.len() >= MOST_UNKNOWN && !self.unknown.contains_key(&frame.message) {
            return false;
        }
        self.unknown.entry(frame.message).or_insert(Guess { extra, seen: 0, rival: None }).agrees(extra)
    }

    fn message(&mut self, frame: &Frame<'_>, logged_ns: i64, place: u64) -> Fate {
        self.frames += 1;
        let sender = Sender::of(frame);
        let run = self.runs.beside(place).filter(|_| sender == self.main);
        self.beside += u64::from(run.is_some());
        let Some(route) = self.route(sender, run, frame) else {
            self.unplaced.add(|| format!("message {}", frame.message));
            return Fate::Skipped;
        };
        let times = Times { logged_ns, published_ns: None };
        // The checksum of a message that is not defined has a part that nobody knows.
        self.topics.vouch(if definition_of(frame).is_some() { Vouch::Checksum } else { Vouch::Nothing });
        let Some(definition) = definition_of(frame) else {
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
        if sender == self.main && run.is_none() {
            self.vehicle.tell(frame.message, &self.restored, logged_ns);
            let came = if self.stamped { logged_ns } else { place as i64 };
            self.boot.message(definition, frame.message, &self.restored, came);
        }
        if let Some(derived) = definition.derived(&self.restored) {
            self.restored.splice(..0, derived);
        }
        self.topics.message(route, times, &self.restored)
    }

    /// Where messages of this sender go; `None` if there are too many topics.
    fn route(&mut self, sender: Sender, run: Option<usize>, frame: &Frame<'_>) -> Option<Route> {
        let definition = definition_of(frame);
        let is_defined = definition.is_some();
        let key = Key { sender, message: frame.message, wide: frame.wide, is_defined, run };
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
            None => self.topics.packed_route(info, &[], |_| Err("a message that is not defined".to_owned())),
        };
        let route = route.ok();
        self.routes.insert(key, route);
        route
    }

    /// Writes what the log says of its vehicle, and what was wrong with it.
    pub(super) fn finish(self, log: &mut Log, notices: &mut Notices) {
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
        let text = format!("frames have {FLAGGED}: they are intact and were not read, as MAVLink asks");
        say(Severity::Loss, "unknown-flags", &self.flagged, &text);
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
            let text = format!(
                "frames of messages that are not defined, or otherwise than MAVLink has them, were not read: {}",
                listed(&self.undefined)
            );
            notices.push(Severity::Warning, "unknown-message", "", frames, text);
        }
        crate::format::tell_preamble(self.preamble, notices);
        if self.stamped {
            log.restarts = self.boot.finish();
        } else {
            let text = "frames stand one behind the other without the times at which they were received: their messages' own \
                        clocks are all there is";
            notices.push(Severity::Warning, "no-receive-time", "", self.frames, text);
        }
        if self.beside > 0 {
            let text = "messages are of another run of the vehicle: its clock since boot begins anew, and without times of \
                        reception nothing tells how far apart the runs are. Channels are made of the longest alone; of the \
                        others the topics have the number of the run, as ATTITUDE#2";
            notices.push(Severity::Loss, "clock-restart", "", self.beside, text);
        }
        log.health.about = self.vehicle.finish();
    }
}

/// The definition of a frame's message, unless the frame is of another one.
fn definition_of(frame: &Frame<'_>) -> Option<&'static Definition> {
    Definitions::all().get(frame.message).filter(|_| frame.intact.is_some())
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
