//! UBX, the binary protocol of u-blox receivers, as the receiver sends it: NMEA and RTCM 3 may be interleaved.
//!
//! The checksum of every frame is verified. A topic is named after its message, `NAV-PVT`. Messages that are not
//! read are counted by class and number, and so are corrections; raw selections get their bytes.
//!
//! The reader prepends derived fields to those of a message:
//!
//! - `gps_week`, the week of its `iTOW` from a preceding NAV-TIMEGPS, NAV-SOL or date of NAV-TIMEUTC or a PVT,
//!   otherwise from the first one after it (0 if there is none), and `fix_ok`;
//! - for NAV-PVT, NAV2-PVT and NAV-PVAT `carrier`, whether the carrier phases are resolved;
//! - for NAV-HPPOSLLH `latitude`, `longitude` and `ellipsoid_height` with all digits, and for NAV-HPPOSECEF `place_x`,
//!   `place_y` and `place_z`;
//! - for NAV-VELECEF the last known position, `at_x`, `at_y` and `at_z` (0 if there was none within ten seconds);
//! - for TIM-TP and TIM-TM2 `gps_tow_ms`, which with `gps_week` is the GPS time of a pulse that the message may count
//!   in UTC or in the time of BeiDou; without one both are 0.
//!
//! A receiver's own output has no time at which it was logged.
//!
//! Layouts are a table, not those of the `ublox` crate: its accessors scale and clip each field, and each message would
//! need a conversion by hand into columns. The table is decoded directly into columns.

mod message;
mod pulse;
mod ubx_frame;
mod ubx_identity;
mod ubx_receiver;

use self::message::Message;
use self::pulse::EarlyMarks;
use self::ubx_frame::{Frame, WRONG, rtcm_length};
pub(super) use self::ubx_frame::{LONGEST, RTCM, SYNC};
use self::ubx_receiver::{Receiver, Weeks};
use crate::decode::cells::{CellKind, CellLayout, push_hex};
use crate::decode::{Route, Tally, Times, Topics};
use crate::format::report_too_many_topics;
use crate::reader::Log;
use crate::table::{PAYLOAD_HEX, TopicInfo};
use flight::{Code, Notices, Severity};
use logscan::{Fate, Parsed, Trust};
use memchr::memmem;
use std::collections::HashMap;

/// The messages have no log time.
const UNSTAMPED: Times = Times { logged_ns: 0, published_ns: None };

/// Whether these first bytes of a file hold an intact frame.
pub(crate) fn looks_like(head: &[u8]) -> bool {
    memmem::find_iter(head, &SYNC).take(1000).any(|at| Frame::at(head.get(at..).unwrap_or_default()).is_ok())
}

/// Whether a frame of UBX or of RTCM 3 may begin here.
pub(super) fn begins(bytes: &[u8]) -> bool {
    bytes.first().is_some_and(|first| [SYNC[0], RTCM].contains(first))
}

/// The frame of UBX or of RTCM 3 that may begin here.
pub(super) fn parse(bytes: &[u8]) -> Parsed {
    if bytes.first() == Some(&RTCM) {
        return match rtcm_length(bytes) {
            Some(length) => Parsed::Frame(length, Trust::Proven),
            None => Parsed::Not(ubx_frame::stated_rtcm_length(bytes).unwrap_or(1)),
        };
    }
    match Frame::at(bytes) {
        Ok(frame) => Parsed::Frame(frame.length, Trust::Proven),
        Err(WRONG) => Parsed::Not(ubx_frame::length_at(bytes).unwrap_or(ubx_frame::HEADER)),
        Err(_) if ubx_frame::may_be_cut(bytes) => Parsed::Cut,
        Err(_) => Parsed::Not(SYNC.len()),
    }
}

/// What is wrong where such a frame may begin.
pub(super) fn fault(bytes: &[u8]) -> &'static str {
    match Frame::at(bytes) {
        _ if bytes.first() == Some(&RTCM) => "the checksum of an RTCM 3 message is wrong",
        fault => fault.err().unwrap_or(WRONG),
    }
}

/// Routes frames to their topics.
#[derive(Default)]
pub(super) struct Frames {
    /// Whether there was any.
    pub(super) any: bool,
    /// Routes by class and number; RTCM by its own.
    routes: HashMap<(u8, u8), Option<Route>>,
    /// The same, for messages that are taken raw.
    whole_routes: HashMap<(u8, u8), Option<Route>>,
    line: String,
    receiver: Receiver,
    assembled: Vec<u8>,
    /// Messages before the first known week, in this run of the receiver's clock and in earlier ones, in which it did
    /// not know the time.
    early: Tally,
    early_run: i64,
    untimed: Tally,
    unplaced: Tally,
}

/// Key of corrections among the routes: no UBX class has this number.
const CORRECTIONS: (u8, u8) = (0xff, RTCM);

/// Raw column of messages that are not decoded.
fn whole_layout() -> CellLayout {
    let number = CellKind::NumberIfAny;
    CellLayout::of([("gps_week", number), ("iTOW", number), (PAYLOAD_HEX, CellKind::Text)])
}

fn name_of(key: (u8, u8)) -> String {
    if key == CORRECTIONS { "RTCM3".to_owned() } else { message::name(key.0, key.1) }
}

impl Frames {
    /// Takes a frame that is known to be intact.
    pub(super) fn take(&mut self, bytes: &[u8], topics: &mut Topics<'_>) -> Fate {
        self.any = true;
        match bytes {
            [RTCM, ..] => self.skip(CORRECTIONS, bytes, topics),
            _ => self.frame(Frame::of(bytes), topics),
        }
    }

    fn frame(&mut self, frame: Frame<'_>, topics: &mut Topics<'_>) -> Fate {
        const MON_VER: (u8, u8) = (0x0a, 0x04);
        let key = (frame.class, frame.number);
        if key == MON_VER {
            self.receiver.version(frame.payload);
        }
        self.receiver.identity.observe(key, frame.payload);
        // A frame without payload is a poll for the message; it contains nothing.
        let Some(message) = Message::of(frame.class, frame.number).filter(|_| !frame.payload.is_empty()) else {
            return self.skip(key, frame.payload, topics);
        };
        let derived = self.receiver.observe(message, frame.payload);
        if Weeks::is_unknown(derived.week) {
            if Weeks::run_of(derived.week) != self.early_run {
                self.early_run = Weeks::run_of(derived.week);
                self.untimed.extend(std::mem::take(&mut self.early));
            }
            self.early.add(|| message.name.to_owned());
        }
        let Some(route) = self.route(key, topics) else { return Fate::Skipped };
        if !route.is_wanted() {
            return topics.unread(route, UNSTAMPED, frame.payload.len() as u64);
        }
        message.assemble(derived, frame.payload, &mut self.assembled);
        topics.message(route, UNSTAMPED, &self.assembled)
    }

    /// Counts a message that is not read, or passes it on raw, with the last known time of week.
    fn skip(&mut self, key: (u8, u8), payload: &[u8], topics: &mut Topics<'_>) -> Fate {
        if !topics.takes_extras() {
            let route = self.route(key, topics);
            return route.map_or(Fate::Skipped, |route| topics.unread(route, UNSTAMPED, payload.len() as u64));
        }
        let Some(route) = self.whole_route(key, topics) else { return Fate::Skipped };
        self.line.clear();
        if let Some((week, itow_ms)) = self.receiver.known_time() {
            self.line += &format!("{week},{itow_ms},");
        } else {
            self.line += ",,";
        }
        push_hex(payload, &mut self.line);
        topics.message(route, UNSTAMPED, self.line.as_bytes())
    }

    fn whole_route(&mut self, key: (u8, u8), topics: &mut Topics<'_>) -> Option<Route> {
        // A frame without payload is a poll, not such a message.
        let poll = if Message::of(key.0, key.1).is_some() { "-poll" } else { "" };
        let name = name_of(key) + poll;
        let route = *self.whole_routes.entry(key).or_insert_with(|| {
            let info = TopicInfo { name: name.clone(), type_name: name.clone(), encoding: "ubx".to_owned() };
            topics.cells_route(info, b"whole", || Ok(whole_layout())).ok()
        });
        if route.is_none() {
            self.unplaced.add(|| name);
        }
        route
    }

    /// Destination of messages; `None`, and counted, if there are too many topics.
    fn route(&mut self, key: (u8, u8), topics: &mut Topics<'_>) -> Option<Route> {
        let (class, number) = key;
        let name = name_of(key);
        let route = *self.routes.entry(key).or_insert_with(|| {
            let info = TopicInfo { name: name.clone(), type_name: name.clone(), encoding: "ubx".to_owned() };
            let layout = || Message::of(class, number).map(Message::layout);
            topics
                .packed_route(info, &[class, number], |_| layout().ok_or("this message is not supported".to_owned()))
                .ok()
        });
        if route.is_none() {
            self.unplaced.add(|| name);
        }
        route
    }

    /// Writes what the receiver says about itself, and what was wrong. The returned value dates the tables once they
    /// are made.
    pub(super) fn finish(mut self, log: &mut Log, notices: &mut Notices) -> (Weeks, EarlyMarks) {
        report_too_many_topics(&self.unplaced, "messages", "", notices);
        if !self.receiver.weeks.are_of(self.early_run) {
            self.untimed.extend(std::mem::take(&mut self.early));
        }
        if !self.receiver.weeks.are_told() {
            self.early = std::mem::take(&mut self.untimed);
        }
        let text = match self.receiver.weeks.are_told() {
            true => "messages before the first one with a week are dated backwards from it",
            false => "messages have a time of week, but the log has no week number",
        };
        self.early.report(Code::Undated, "", text, notices);
        let text = "messages have no time because the receiver did not know it yet";
        self.untimed.report(Code::Undated, "", text, notices);
        if self.receiver.nowhere > 0 {
            let text = "velocities are in earth-fixed axes, but no message near them gives the position, so north is \
                unknown: they are not used";
            notices.push(Code::RejectedRow, "NAV-VELECEF", self.receiver.nowhere, text);
        }
        let marks = self.receiver.early_marks();
        let untimed = &self.receiver.pulses.untimed;
        untimed.report(Code::Undated.at(Severity::Warning), "", "pulses have no GPS time", notices);
        if let Some((text, dates)) = self.receiver.suspicion() {
            notices.push(Code::DateInferred.at(Severity::Warning), "", dates, text);
        }
        log.health.about.receivers = self.receiver.names;
        log.health.about.receiver_identities = self.receiver.identity.finish();
        (self.receiver.weeks, marks)
    }
}
