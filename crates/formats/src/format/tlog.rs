//! MAVLink telemetry as ground stations write it: before each frame the time of its reception, µs of UTC, eight
//! bytes, big-endian (<https://mavlink.io/en/file_formats/#tlog>).
//!
//! The checksum of every frame is verified. For a message that is not defined this is impossible, and the message is
//! not read. A topic is named after its message. The vehicle with the lowest system ID has the plain name. Messages of
//! another vehicle are named `GPS_RAW_INT@2`, and those of another component of this vehicle `ODOMETRY@1.197`.
//!
//! A stream may also be recorded as received, frame after frame without times (MAVProxy's `.tlog.raw`, a capture of a
//! serial line). Then only the clocks of the messages are available. If a vehicle restarts, its first run has the plain
//! names, and messages of the second run are named `GPS_RAW_INT#2`.
//!
//! The reader prepends `use_flags`, the inverse of `ignore_flags`, to the fields of GPS_INPUT.
//!
//! The definitions are a table. The `mavlink` crate rejects whole messages for one number that its enumerations do
//! not know, and skips what it cannot read without a count. The table is decoded directly into columns, the
//! checksum of every frame proves its line, and the tests write and read every message of it with the crate.

mod checksum;
mod clock;
mod definition;
mod framing;
mod mavlink_frame;
mod mavlink_vehicle;
mod tlog_session;

pub(crate) use self::framing::looks_like;
use self::framing::{Framing, NO_FRAME, TIME};
use self::mavlink_frame::{Frame, LONGEST, MAGIC, NoFrame, Sender};
use self::tlog_session::{MOST_TOPICS, Session};
use crate::bytes::is_plain;
use crate::error::LogError;
use crate::format::Reading;
use crate::reader::{Log, ReadContext, Select};
use logscan::{Fate, LogFile, Parsed, Source, Trust, scan};
use memchr::memchr2;
use std::borrow::Cow;
use std::path::PathBuf;

/// Number of bytes in which the heartbeat of every vehicle is expected.
const BEGIN: usize = 1 << 20;
/// Bytes of two records and the start of a third: the times of the next two frames confirm the time of this one.
const LOOK: usize = 2 * (TIME + LONGEST) + TIME + 1;

/// Reads one telemetry log, or several that make up one flight.
pub(crate) fn read(files: &[PathBuf], want: &dyn Select, context: &ReadContext<'_>) -> Result<Log, LogError> {
    let context = &super::with_topics(context, MOST_TOPICS);
    let (mut file, Reading { name, mut ledger, mut notices, mut topics }) = Reading::open(files, want, context)?;
    let mut log = Log::default();
    let framing = Framing::of_file(&mut file, context)?;
    let main = main_vehicle(&mut file, framing)?;
    let stamped = framing != Framing::Bare;
    log.health.format = if stamped { "MAVLink telemetry" } else { "MAVLink stream" }.to_owned();
    let mut session = Session::new(main, stamped, &mut topics);
    session.preamble = scan(&mut file, &mut ledger, context, &mut Records { session: &mut session, framing })?.preamble;
    if let Some(what) = session.why_nothing() {
        return Err(LogError::Unusable { file: name, what });
    }
    session.finish(&mut log, &mut notices);
    let mut log = Reading { name, ledger, notices, topics }.conclude(log)?;
    if !stamped {
        super::forget_log_times(&mut log);
    }
    Ok(log)
}

/// The autopilot with the lowest system ID among those with a heartbeat near the start of the log.
fn main_vehicle(file: &mut LogFile, framing: Framing) -> Result<Sender, LogError> {
    let bytes = file.up_to(0, BEGIN)?;
    let (mut main, mut at) = (None, 0);
    while let Some(rest) = bytes.get(at..).filter(|rest| !rest.is_empty()) {
        let frame = Frame::at(rest.get(framing.front()..).unwrap_or_default()).ok();
        let Some(frame) = frame.filter(|frame| frame.intact == Some(true)) else {
            at += 1;
            continue;
        };
        if frame.unknown_flags == 0 && mavlink_vehicle::is_autopilot(frame.message, frame.payload) {
            let sender = Sender::of(&frame);
            main = Some(main.map_or(sender, |main: Sender| main.min(sender)));
        }
        at += framing.front() + frame.length;
    }
    Ok(main.unwrap_or_default())
}

/// Passes the records of a file, each a frame and what precedes it, to the session.
struct Records<'r, 'b, 't> {
    session: &'r mut Session<'b, 't>,
    framing: Framing,
}

impl logscan::Framing for Records<'_, '_, '_> {
    fn longest(&self) -> usize {
        LOOK
    }

    fn parse(&self, bytes: &[u8]) -> Parsed {
        let front = self.framing.front();
        match Frame::at(bytes.get(front..).unwrap_or_default()) {
            Ok(frame) => match frame.intact {
                Some(true) if self.framing.is_plausible(bytes) => Parsed::Frame(front + frame.length, Trust::Proven),
                Some(true) => Parsed::Frame(front + frame.length, Trust::Agrees),
                None => Parsed::Frame(front + frame.length, Trust::Shape),
                Some(false) => Parsed::Not(frame.length),
            },
            Err(NoFrame::Cut) => Parsed::Cut,
            Err(NoFrame::Foreign) => Parsed::Not(1),
        }
    }

    fn begins(&self, bytes: &[u8]) -> bool {
        bytes.get(self.framing.front()).is_none_or(|magic| MAGIC.contains(magic))
    }

    fn candidate(&self, block: &[u8], from: usize) -> Option<usize> {
        memchr2(MAGIC[0], MAGIC[1], block.get(from + self.framing.front()..)?).map(|at| from + at)
    }

    fn length(&self, bytes: &[u8]) -> Option<usize> {
        let front = self.framing.front();
        Frame::length_at(bytes.get(front..)?).map(|length| front + length)
    }

    fn take(&mut self, record: &[u8], after: &[u8], at: u64) -> Result<Fate, Cow<'static, str>> {
        self.session.record(record, after, self.framing, at)
    }

    fn fault(&self, bytes: &[u8]) -> Cow<'static, str> {
        match Frame::at(bytes.get(self.framing.front()..).unwrap_or_default()) {
            Ok(frame) => tlog_session::fault(&frame),
            Err(NoFrame::Cut) => "a frame with a wrong length".into(),
            Err(NoFrame::Foreign) => NO_FRAME.into(),
        }
    }

    fn is_preamble(&self, bytes: &[u8]) -> bool {
        is_plain(bytes) && bytes.ends_with(b"\n")
    }
}
