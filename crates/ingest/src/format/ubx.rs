//! UBX, the binary protocol of u-blox receivers, as it comes from the receiver: NMEA and RTCM 3 may stand between.
//!
//! Every frame has a checksum, and it is checked. A topic is named after its message, `NAV-PVT`; messages that are not
//! read are counted by class and number, and so are corrections; who takes messages as they stand has their bytes.
//!
//! In front of the fields of a message the reader puts what it derives:
//!
//! - `gps_week`, the week of its `iTOW` as NAV-TIMEGPS, NAV-SOL or the date of NAV-TIMEUTC or a PVT before it says, or
//!   else the first behind it (0 if none did), and `fix_ok`;
//! - of NAV-PVT, NAV2-PVT and NAV-PVAT `carrier`, whether the phases of the carriers are solved;
//! - of NAV-HPPOSLLH `latitude`, `longitude` and `ellipsoid_height` of all its digits, of NAV-HPPOSECEF so `place_x`,
//!   `place_y` and `place_z`;
//! - of NAV-VELECEF the place that was told last, `at_x`, `at_y` and `at_z` (0 if none was within ten seconds);
//! - of TIM-TP and TIM-TM2 `gps_tow_ms`, which with `gps_week` is the GPS time of a pulse that the message may count in
//!   UTC or in the time of BeiDou; without one both are 0.
//!
//! A receiver's own output has no time at which it was logged.
//!
//! Layouts are a table and not those of the `ublox` crate: its accessors scale and clip each field, and one conversion
//! by hand for each message would stand between it and the columns. The table goes into columns as it is.

mod frame;
mod identity;
mod message;
mod pulse;
mod receiver;

use self::frame::{Frame, LONGEST, LONGEST_RTCM, RTCM, SYNC, WRONG, rtcm_length};
use self::message::Message;
use self::pulse::EarlyMarks;
use self::receiver::{Receiver, Weeks};
use super::nmea::{self, Book, Dates, Sentence};
use crate::bytes::{is_plain, is_zero};
use crate::decode::cells::{CellKind, CellLayout, push_hex};
use crate::decode::{Route, Tally, Times, Topics, Vouch};
use crate::error::IngestError;
use crate::format::Reading;
use crate::reader::{Log, LogReader, ReadContext, Select};
use crate::table::{PAYLOAD_HEX, TopicInfo};
use flight::{Code, Notices, Severity};
use logscan::{Fate, Framing, LogFile, MOST_IN_VAIN, MOST_ZEROS, Parsed, Trust, scan};
use memchr::{memchr, memchr2_iter, memchr3, memmem};
use std::borrow::Cow;
use std::collections::HashMap;
use std::path::PathBuf;

/// Bytes searched in one go.
const BLOCK: usize = 256 << 10;
/// Topics in one log: u-blox defines some two hundred messages.
const MOST_TOPICS: usize = 2048;
/// Bytes that may be looked at for false starts in a file of any size.
const VAIN_AT_ONCE: u64 = 1 << 20;
/// Nobody stamped the messages.
const UNSTAMPED: Times = Times { logged_ns: 0, published_ns: None };

/// Reads one UBX log, or several that make up one flight.
#[derive(Debug, Clone)]
pub struct UbxReader {
    files: Vec<PathBuf>,
}

impl UbxReader {
    /// A reader of these files. Nothing is opened yet.
    #[must_use]
    pub fn new(files: Vec<PathBuf>) -> UbxReader {
        UbxReader { files }
    }
}

impl LogReader for UbxReader {
    fn read(&mut self, want: &dyn Select, context: &ReadContext<'_>) -> Result<Log, IngestError> {
        let context = &super::with_topics(context, MOST_TOPICS);
        let Reading { mut files, mut ledger, mut notices, mut topics } = Reading::begin(&self.files, want, context)?;
        let mut log = Log::default();
        log.health.format = "u-blox UBX".to_owned();
        let mut content = Content::new(&mut topics);
        for file in &mut files {
            let head = file.up_to(0, crate::sniff::HEAD)?;
            if !nmea::looks_like(head) && !looks_like(head) {
                super::refuse_foreign(file, NOTHING, context)?;
            }
            content.breaks();
            content.preamble += scan(file, &mut ledger, context, &mut content)?.preamble;
        }
        let (weeks, marks, dates) = content.finish(&mut log, &mut notices);
        let mut log = Reading { files, ledger, notices, topics }.conclude(log)?;
        weeks.put(&mut log);
        marks.put(&mut log);
        dates.put(&mut log);
        super::forget_log_times(&mut log);
        Ok(log)
    }
}

/// Said where neither frame nor sentence begins.
const NOTHING: &str = "bytes that are neither a frame nor a sentence";

/// Whether these first bytes of a file hold an intact frame.
pub(crate) fn looks_like(head: &[u8]) -> bool {
    memmem::find_iter(head, &SYNC).take(1000).any(|at| Frame::at(head.get(at..).unwrap_or_default()).is_ok())
}

/// Bytes of the intact frame, of UBX or of RTCM 3, that the bytes begin with.
pub(super) fn frame_length(bytes: &[u8]) -> Option<usize> {
    match bytes {
        [RTCM, ..] => rtcm_length(bytes),
        _ => Frame::at(bytes).ok().map(|frame| frame.length),
    }
}

/// Whether an intact frame of UBX or of RTCM 3 stands anywhere in a file of something else.
pub(super) fn holds_frames(file: &mut LogFile, context: &ReadContext<'_>) -> Result<bool, IngestError> {
    // Progress counts each byte once, when it is read.
    let context = &ReadContext { on_bytes: &|_| (), ..*context };
    let (mut at, mut looked, mut zeros) = (0, 0, 0);
    let most = VAIN_AT_ONCE + MOST_IN_VAIN.saturating_mul(file.size());
    while at < file.size() && zeros <= MOST_ZEROS && looked <= most {
        let block = file.up_to(at, BLOCK + LONGEST)?;
        for hit in memchr2_iter(SYNC[0], RTCM, block).take_while(|hit| *hit < BLOCK) {
            let bytes = block.get(hit..).unwrap_or_default();
            if frame_length(bytes).is_some() {
                return Ok(true);
            }
            looked += frame::length_at(bytes).unwrap_or(LONGEST_RTCM) as u64;
        }
        zeros = if is_zero(block) { zeros + BLOCK as u64 } else { 0 };
        at += BLOCK as u64;
        file.progress(at.min(file.size()), context)?;
    }
    Ok(false)
}

/// The way of frames and sentences to their topics.
struct Content<'b, 't> {
    topics: &'b mut Topics<'t>,
    /// By class and number; RTCM by its own.
    routes: HashMap<(u8, u8), Option<Route>>,
    /// The same, for messages that are taken whole.
    whole_routes: HashMap<(u8, u8), Option<Route>>,
    line: String,
    receiver: Receiver,
    sentences: Book,
    assembled: Vec<u8>,
    /// Messages before the first that told the week, of this run of the receiver's clock, and of earlier ones, in which it did
    /// not know the time.
    early: Tally,
    early_run: i64,
    untimed: Tally,
    unplaced: Tally,
    /// Bytes of text before the first frame.
    preamble: u64,
}

impl Framing for Content<'_, '_> {
    fn longest(&self) -> usize {
        LONGEST
    }

    fn parse(&self, bytes: &[u8]) -> Parsed {
        match bytes {
            [0xb5, ..] => match Frame::at(bytes) {
                Ok(frame) => Parsed::Frame(frame.length, Trust::Proven),
                Err(WRONG) => Parsed::Not(frame::length_at(bytes).unwrap_or(frame::HEADER)),
                Err(_) if frame::may_be_cut(bytes) => Parsed::Cut,
                Err(_) => Parsed::Not(SYNC.len()),
            },
            // Some receivers double it.
            [b'$', rest @ ..] if rest.starts_with(b"$") => match Sentence::at(rest, false) {
                Ok(_) => Parsed::Frame(1, Trust::Proven),
                Err(_) => Parsed::Not(1),
            },
            [b'$' | b'!', ..] => match Sentence::at(bytes, false) {
                Ok(sentence) => Parsed::Frame(sentence.length, Trust::Proven),
                Err(_) => Parsed::Not(1),
            },
            [b'\r' | b'\n', ..] => Parsed::Frame(1, Trust::Proven),
            [RTCM, ..] => match rtcm_length(bytes) {
                Some(length) => Parsed::Frame(length, Trust::Proven),
                None => Parsed::Not(frame::stated_rtcm_length(bytes).unwrap_or(1)),
            },
            _ => Parsed::Not(1),
        }
    }

    fn begins(&self, bytes: &[u8]) -> bool {
        bytes.first().is_some_and(|first| [SYNC[0], b'$', b'!', b'\r', b'\n', RTCM].contains(first))
    }

    fn candidate(&self, block: &[u8], from: usize) -> Option<usize> {
        memchr3(SYNC[0], b'$', RTCM, block.get(from..)?).map(|at| from + at)
    }

    fn take(&mut self, bytes: &[u8], _: &[u8], _: u64) -> Result<Fate, Cow<'static, str>> {
        Ok(match bytes {
            [0xb5, ..] => self.frame(Frame::of(bytes)),
            [RTCM, ..] => self.skip(CORRECTIONS, bytes),
            [_] => Fate::Structure,
            _ => match Sentence::at(bytes, false) {
                Ok(sentence) => self.sentences.sentence(&sentence, None, self.topics),
                Err(fault) => return Err(fault.to_string().into()),
            },
        })
    }

    fn fault(&self, bytes: &[u8]) -> Cow<'static, str> {
        match bytes {
            [0xb5, ..] => Frame::at(bytes).map_or_else(Cow::from, |_| NOTHING.into()),
            [b'$' | b'!', ..] => {
                Sentence::at(bytes, false).map_or_else(|fault| fault.to_string().into(), |_| NOTHING.into())
            }
            [RTCM, ..] => "the checksum of a correction is wrong".into(),
            _ => NOTHING.into(),
        }
    }

    fn is_preamble(&self, bytes: &[u8]) -> bool {
        // A star ends a sentence: what stands before it is a piece of one.
        is_plain(bytes) && bytes.ends_with(b"\n") && memchr(b'*', bytes).is_none()
    }

    fn breaks(&mut self) {
        self.sentences.breaks();
    }
}

/// Stands for corrections among the routes: no class of UBX has this number.
const CORRECTIONS: (u8, u8) = (0xff, RTCM);

/// Of messages that are not read, for who takes all of them as they stand.
fn whole_layout() -> CellLayout {
    let number = CellKind::NumberIfAny;
    CellLayout::of([("gps_week", number), ("iTOW", number), (PAYLOAD_HEX, CellKind::Text)])
}

fn name_of(key: (u8, u8)) -> String {
    if key == CORRECTIONS { "RTCM3".to_owned() } else { message::name(key.0, key.1) }
}

impl<'b, 't> Content<'b, 't> {
    fn new(topics: &'b mut Topics<'t>) -> Content<'b, 't> {
        Content {
            topics,
            routes: HashMap::new(),
            whole_routes: HashMap::new(),
            line: String::new(),
            receiver: Receiver::default(),
            sentences: Book::new(),
            assembled: vec![],
            early: Tally::default(),
            early_run: 0,
            untimed: Tally::default(),
            unplaced: Tally::default(),
            preamble: 0,
        }
    }

    fn frame(&mut self, frame: Frame<'_>) -> Fate {
        const MON_VER: (u8, u8) = (0x0a, 0x04);
        let key = (frame.class, frame.number);
        if key == MON_VER {
            self.receiver.version(frame.payload);
        }
        self.receiver.identity.tell(key, frame.payload);
        // A frame without payload asks for the message; nothing is in it.
        let Some(message) = Message::of(frame.class, frame.number).filter(|_| !frame.payload.is_empty()) else {
            return self.skip(key, frame.payload);
        };
        let derived = self.receiver.tell(message, frame.payload);
        if Weeks::is_untold(derived.week) {
            if Weeks::run_of(derived.week) != self.early_run {
                self.early_run = Weeks::run_of(derived.week);
                self.untimed.extend(std::mem::take(&mut self.early));
            }
            self.early.add(|| message.name.to_owned());
        }
        self.topics.vouch(Vouch::Checksum);
        let Some(route) = self.route(key) else { return Fate::Skipped };
        if !route.is_wanted() {
            return self.topics.unread(route, UNSTAMPED, frame.payload.len() as u64);
        }
        message.assemble(derived, frame.payload, &mut self.assembled);
        self.topics.message(route, UNSTAMPED, &self.assembled)
    }

    /// Counts what is not read, or hands it on as it stands, with the time of week that was told last.
    fn skip(&mut self, key: (u8, u8), payload: &[u8]) -> Fate {
        self.topics.vouch(Vouch::Checksum);
        if !self.topics.takes_extras() {
            let route = self.route(key);
            return route.map_or(Fate::Skipped, |route| self.topics.unread(route, UNSTAMPED, payload.len() as u64));
        }
        let Some(route) = self.whole_route(key) else { return Fate::Skipped };
        self.line.clear();
        if let Some((week, itow_ms)) = self.receiver.told() {
            self.line += &format!("{week},{itow_ms},");
        } else {
            self.line += ",,";
        }
        push_hex(payload, &mut self.line);
        self.topics.message(route, UNSTAMPED, self.line.as_bytes())
    }

    fn whole_route(&mut self, key: (u8, u8)) -> Option<Route> {
        // One without a payload asks for the message, and is none of them.
        let poll = if Message::of(key.0, key.1).is_some() { "-poll" } else { "" };
        let name = name_of(key) + poll;
        let topics = &mut *self.topics;
        let route = *self.whole_routes.entry(key).or_insert_with(|| {
            let info = TopicInfo { name: name.clone(), type_name: name.clone(), encoding: "ubx".to_owned() };
            topics.cells_route(info, b"whole", || Ok(whole_layout())).ok()
        });
        if route.is_none() {
            self.unplaced.add(|| name);
        }
        route
    }

    /// Where messages go; `None`, and counted, if there are too many topics.
    fn route(&mut self, key: (u8, u8)) -> Option<Route> {
        let (class, number) = key;
        let name = name_of(key);
        let topics = &mut *self.topics;
        let route = *self.routes.entry(key).or_insert_with(|| {
            let info = TopicInfo { name: name.clone(), type_name: name.clone(), encoding: "ubx".to_owned() };
            let layout = || Message::of(class, number).map(Message::layout);
            topics.packed_route(info, &[class, number], |_| layout().ok_or("this message is not read".to_owned())).ok()
        });
        if route.is_none() {
            self.unplaced.add(|| name);
        }
        route
    }

    /// Writes what the receiver says of itself, and what was wrong. What is returned dates the tables when they are made.
    fn finish(mut self, log: &mut Log, notices: &mut Notices) -> (Weeks, EarlyMarks, Dates) {
        if self.unplaced.count > 0 {
            let text = format!("messages found no topic, for there are too many; the first: {}", self.unplaced.first);
            notices.push(Code::UnknownChannel, "", self.unplaced.count, text);
        }
        super::tell_preamble(self.preamble, notices);
        if !self.receiver.weeks.are_of(self.early_run) {
            self.untimed.extend(std::mem::take(&mut self.early));
        }
        if !self.receiver.weeks.are_told() {
            self.early = std::mem::take(&mut self.untimed);
        }
        if self.early.count > 0 {
            let text = match self.receiver.weeks.are_told() {
                true => "messages stand before the first that tells the week, and are dated backwards from it",
                false => "messages have a time of week and no week: none in the log tells it",
            };
            let text = format!("{text}; the first: {}", self.early.first);
            notices.push(Code::Undated, "", self.early.count, text);
        }
        if self.untimed.count > 0 {
            let text = "messages of a receiver that did not know the time yet have none";
            let text = format!("{text}; the first: {}", self.untimed.first);
            notices.push(Code::Undated, "", self.untimed.count, text);
        }
        if self.receiver.nowhere > 0 {
            let text = "velocities are in the earth's own axes, and no message near them says the place, without which north is \
                        not known: they are not used";
            notices.push(Code::RejectedRow, "NAV-VELECEF", self.receiver.nowhere, text);
        }
        let marks = self.receiver.early_marks();
        let untimed = &self.receiver.pulses.untimed;
        if untimed.count > 0 {
            let text = format!("pulses have no GPS time; the first: {}", untimed.first);
            notices.push(Code::Undated.at(Severity::Warning), "", untimed.count, text);
        }
        if let Some((text, dates)) = self.receiver.suspicion() {
            notices.push(Code::GpsWeek, "", dates, text);
        }
        log.health.about.receivers = self.receiver.names;
        log.health.about.receiver_identities = self.receiver.identity.finish();
        (self.receiver.weeks, marks, self.sentences.finish(log, notices))
    }
}
