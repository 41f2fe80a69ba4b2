//! Telemetry of MAVLink as ground stations write it: each frame behind the time at which it came, µs of UTC in eight
//! bytes, the highest first (<https://mavlink.io/en/file_formats/#tlog>).
//!
//! Every frame has a checksum, and it is checked; that of a message that is not defined cannot be, and the message is not
//! read. A topic is named after its message. The vehicle with the smallest number has the plain name; what another vehicle
//! says is `GPS_RAW_INT@2`, and another component of this one `ODOMETRY@1.197`.
//!
//! A stream may also be written as it came, frame after frame without times (MAVProxy's `.tlog.raw`, a capture of a serial
//! line). Then the messages' own clocks are all there is. Of a vehicle that restarts the first run has the plain names, and
//! what it says in its second one is `GPS_RAW_INT#2`.
//!
//! In front of the fields of GPS_INPUT the reader puts `use_flags`, the inverse of its `ignore_flags`.
//!
//! The definitions are a table and not the `mavlink` crate, which refuses whole messages for one number that its
//! enumerations do not know, and passes what it cannot read without a count. The table goes into columns as it is, the
//! checksum of every frame proves its line, and the crate writes and reads every message of it in the tests.

mod book;
mod checksum;
mod clock;
mod definition;
mod frame;
mod framing;
mod vehicle;

use self::book::{Book, MOST_TOPICS, NO_FRAME};
use self::frame::{Frame, LONGEST, MAGIC, NoFrame};
pub(crate) use self::framing::looks_like;
use self::framing::{Framing, TIME};
use crate::bytes::is_plain;
use crate::error::IngestError;
use crate::format::Reading;
use crate::reader::{Log, ReadContext, Select};
use logscan::{Fate, LogFile, Parsed, Trust, scan};
use memchr::memchr2;
use std::borrow::Cow;
use std::path::PathBuf;

/// Bytes in which the heartbeat of every vehicle is expected.
const BEGIN: usize = 1 << 20;
/// Bytes of two records and the begin of a third: the times of the next two frames confirm that of this one.
const LOOK: usize = 2 * (TIME + LONGEST) + TIME + 1;

/// Reads one telemetry log, or several that make up one flight.
pub(crate) fn read(files: &[PathBuf], want: &dyn Select, context: &ReadContext<'_>) -> Result<Log, IngestError> {
    let context = &super::with_topics(context, MOST_TOPICS);
    let Reading { mut files, mut ledger, mut notices, mut topics } = Reading::begin(files, want, context)?;
    let mut log = Log::default();
    let framings = files.iter_mut().map(|file| Framing::of_file(file, context)).collect::<Result<Vec<_>, _>>()?;
    let main = match files.first_mut().zip(framings.first()) {
        Some((first, framing)) => main_vehicle(first, *framing)?,
        None => Sender::default(),
    };
    // Times that only some of the frames have would be none of the log's.
    let stamped = !framings.contains(&Framing::Bare);
    log.health.format = if stamped { "MAVLink telemetry" } else { "MAVLink stream" }.to_owned();
    let mut book = Book::new(main, stamped, &mut topics);
    for (file, framing) in files.iter_mut().zip(framings) {
        let size = file.size();
        let scanned = scan(file, &mut ledger, context, &mut Records { book: &mut book, framing })?;
        book.preamble += scanned.preamble;
        book.end_file(size);
    }
    if let Some(what) = book.why_nothing() {
        let file = files.first().map_or("", LogFile::name).to_owned();
        return Err(IngestError::Unusable { file, what });
    }
    book.finish(&mut log, &mut notices);
    let mut log = Reading { files, ledger, notices, topics }.conclude(log)?;
    if !stamped {
        super::forget_log_times(&mut log);
    }
    Ok(log)
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

/// The autopilot with the smallest number among those whose heartbeat is near the begin of the log.
fn main_vehicle(file: &mut LogFile, framing: Framing) -> Result<Sender, IngestError> {
    let bytes = file.up_to(0, BEGIN)?;
    let (mut main, mut at) = (None, 0);
    while let Some(rest) = bytes.get(at..).filter(|rest| !rest.is_empty()) {
        let frame = Frame::at(rest.get(framing.front()..).unwrap_or_default()).ok();
        let Some(frame) = frame.filter(|frame| frame.intact == Some(true)) else {
            at += 1;
            continue;
        };
        if frame.unknown_flags == 0 && vehicle::is_autopilot(frame.message, frame.payload) {
            let sender = Sender::of(&frame);
            main = Some(main.map_or(sender, |main: Sender| main.min(sender)));
        }
        at += framing.front() + frame.length;
    }
    Ok(main.unwrap_or_default())
}

/// The records of a file, each a frame and what stands before it, on their way to the book.
struct Records<'r, 'b, 't> {
    book: &'r mut Book<'b, 't>,
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
        self.book.record(record, after, self.framing, at)
    }

    fn fault(&self, bytes: &[u8]) -> Cow<'static, str> {
        match Frame::at(bytes.get(self.framing.front()..).unwrap_or_default()) {
            Ok(frame) => book::fault(&frame),
            Err(NoFrame::Cut) => "a frame whose length is wrong".into(),
            Err(NoFrame::Foreign) => NO_FRAME.into(),
        }
    }

    fn is_preamble(&self, bytes: &[u8]) -> bool {
        is_plain(bytes) && bytes.ends_with(b"\n")
    }
}
