//! Telemetry of MAVLink as ground stations write it: each frame behind the time at which it came, µs of UTC in eight
//! bytes, the highest first (<https://mavlink.io/en/file_formats/#tlog>).
//!
//! Every frame has a checksum, and it is checked; of a message that is not defined, whether it is the same layout every
//! time. A frame from whose end a ground station took zeros under its checksum is intact with them. A topic is named after
//! its message. The vehicle with the smallest number has the plain name; what another vehicle says is `GPS_RAW_INT@2`, and
//! another component of this one `ODOMETRY@1.197`.
//!
//! A stream may also be written as it came, frame behind frame without times (MAVProxy's `.tlog.raw`, a capture of a serial
//! line). Then the messages' own clocks are all there is. Of a vehicle that starts anew the longest run has the plain names, and
//! what it says in its second one, if that is shorter, is `GPS_RAW_INT#2`.
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
mod dialect;
mod frame;
mod framing;
mod recut;
mod vehicle;

use self::book::{Book, CUT, MOST_TOPICS};
use self::clock::BootClock;
use self::definition::Definitions;
use self::dialect::Dialect;
use self::frame::{Frame, LONGEST};
pub(crate) use self::framing::looks_like;
use self::framing::{Framing, Search, TIME, time_us};
use self::recut::Recut;
use crate::error::IngestError;
use crate::format::Reading;
use crate::format::file::LogFile;
use crate::ledger::{Fate, Ledger};
use crate::reader::{Log, LogReader, ReadContext, Select};
use std::borrow::Cow;
use std::path::{Path, PathBuf};

/// Bytes in which the heartbeat of every vehicle is expected.
const BEGIN: u64 = 1 << 20;
/// Bytes of two records and the begin of a third: the times of the next two frames speak for that of this one.
const LOOK: usize = 2 * (TIME + LONGEST) + TIME + 1;

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
        let mut learned = Learned::default();
        let framings = files.iter_mut().map(|file| Framing::of_file(file, context)).collect::<Result<Vec<_>, _>>()?;
        let main = match self.files.first().zip(framings.first()) {
            Some((first, framing)) => main_vehicle(first, *framing, &mut learned, context)?,
            None => Sender::default(),
        };
        // Times that only some of the frames have would be none of the log's.
        let stamped = !framings.contains(&Framing::Bare);
        let runs = if stamped { Runs::default() } else { Runs::of(&self.files, &framings, main, context)? };
        log.health.format = if stamped { "MAVLink telemetry" } else { "MAVLink stream" }.to_owned();
        let mut book = Book::new(main, learned, stamped, runs, &mut topics);
        for ((file, path), framing) in files.iter_mut().zip(&self.files).zip(framings) {
            let (name, search) = (file.name().to_owned(), Search::of(framing));
            let size = file.size();
            let ledger = &mut ledger;
            Walk { name, path, file, context, ledger, book: &mut book, framing, at: 0, search, learned: false }
                .run()?;
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

/// What the frames themselves show of how their senders write them.
#[derive(Debug, Default)]
struct Learned {
    recut: Recut,
    dialect: Dialect,
}

/// The autopilot with the smallest number among those whose heartbeat is near the begin of the log. How senders write their
/// frames is learned on the way.
fn main_vehicle(
    path: &Path,
    framing: Framing,
    learned: &mut Learned,
    context: &ReadContext<'_>,
) -> Result<Sender, IngestError> {
    let mut main = None;
    skim(path, framing, BEGIN, context, |at, frame| {
        let sender = Sender::of(frame);
        learned.recut.learn(sender, at, frame);
        learned.dialect.learn(at, frame);
        let is_known = frame.intact != Some(false) && frame.unknown_flags == 0;
        if is_known && vehicle::is_autopilot(frame.message, frame.payload) {
            main = Some(main.map_or(sender, |main: Sender| main.min(sender)));
        }
    })?;
    Ok(main.unwrap_or_default())
}

/// The runs of a vehicle in a stream without times of reception: nothing tells how far apart they are.
#[derive(Debug, Default)]
struct Runs {
    /// Where among the bytes of all files all but the first begin.
    begins: Vec<u64>,
    /// The longest, by its bytes.
    longest: usize,
}

impl Runs {
    fn of(
        paths: &[PathBuf],
        framings: &[Framing],
        main: Sender,
        context: &ReadContext<'_>,
    ) -> Result<Runs, IngestError> {
        let (mut clock, mut before) = (BootClock::default(), 0);
        for (path, framing) in paths.iter().zip(framings) {
            before += skim(path, *framing, u64::MAX, context, |at, frame| {
                let definition = Definitions::all().get(frame.message).filter(|_| frame.intact == Some(true));
                if let Some(definition) = definition.filter(|_| Sender::of(frame) == main && frame.unknown_flags == 0) {
                    clock.message(definition, frame.message, frame.payload, (before + at) as i64);
                }
            })?;
        }
        let begins: Vec<u64> = clock.finish().into_iter().map(|restart| restart.logged_ns as u64).collect();
        let from = [0].iter().chain(&begins);
        let lengths = from.zip(begins.iter().chain([&before])).map(|(begin, end)| end.saturating_sub(*begin));
        let longest = lengths.enumerate().max_by_key(|(_, length)| *length).map_or(0, |(run, _)| run);
        Ok(Runs { begins, longest })
    }

    /// Number of the run that these bytes are of, from 1; `None` for the longest.
    fn beside(&self, place: u64) -> Option<usize> {
        let run = self.begins.partition_point(|begin| *begin <= place);
        (run != self.longest).then_some(run + 1)
    }
}

/// Hands on the frames that begin in the first bytes of a file, and where they stand: those that are intact, with or without
/// the zeros behind them, or by another definition, and those of messages that are not defined. Gives the size of the file.
fn skim(
    path: &Path,
    framing: Framing,
    first: u64,
    context: &ReadContext<'_>,
    mut take: impl FnMut(u64, &Frame<'_>),
) -> Result<u64, IngestError> {
    // Those who look on are told of each byte once, when it is read.
    let context = &ReadContext { on_bytes: &|_| (), ..*context };
    let mut file = LogFile::open(path)?;
    let end = file.size().min(first);
    let (mut search, front) = (Search::of(framing), framing.front());
    let mut at = 0;
    while at < end {
        let bytes = file.up_to(at, LOOK)?;
        match Frame::at(bytes.get(front..).unwrap_or_default()) {
            Ok(frame)
                if frame.intact.unwrap_or_else(|| framing.believes(&frame, bytes))
                    || frame.zeros_cut.is_some()
                    || (frame.other.is_some() && framing.goes_on(&frame, bytes)) =>
            {
                take(at, &frame);
                search.last_us = time_us(bytes).filter(|_| framing == Framing::Stamped);
                at += (front + frame.length) as u64;
            }
            _ => at = search.next(&mut file, at + 1, end, &|_, _| false, context)?,
        }
        file.progress(at.min(end), context)?;
    }
    Ok(file.size())
}

/// A walk in progress.
struct Walk<'w, 'c, 'b, 't> {
    file: &'w mut LogFile,
    path: &'w Path,
    name: String,
    context: &'w ReadContext<'c>,
    ledger: &'w mut Ledger,
    book: &'w mut Book<'b, 't>,
    framing: Framing,
    at: u64,
    search: Search,
    /// All of the file was looked over for other definitions.
    learned: bool,
}

impl Walk<'_, '_, '_, '_> {
    /// From the first byte to the last.
    fn run(mut self) -> Result<(), IngestError> {
        while self.at < self.file.size() {
            let bytes = self.file.up_to(self.at, LOOK)?;
            match self.book.record(bytes, self.framing, self.at) {
                Ok((fate, length)) => {
                    self.search.last_us = time_us(bytes).filter(|_| self.framing == Framing::Stamped);
                    self.ledger.count(fate, length as u64);
                    self.at += length as u64;
                }
                Err(_) if self.book.suspects() && !self.learned => self.learn()?,
                Err(reason) => self.lost(reason)?,
            }
            self.file.progress(self.at, self.context)?;
        }
        Ok(())
    }

    /// Looks over all of the file for messages that are defined otherwise: the first of them should not be damage.
    fn learn(&mut self) -> Result<(), IngestError> {
        self.learned = true;
        skim(self.path, self.framing, u64::MAX, self.context, |at, frame| self.book.learn(at, frame)).map(|_| ())
    }

    /// Goes on where the next intact frame begins.
    fn lost(&mut self, reason: Cow<'static, str>) -> Result<(), IngestError> {
        let behind = self.known_behind()?;
        let knows = |message, extra| self.book.knows(message, extra);
        let found = self.search.next(self.file, self.at + 1, self.file.size(), &knows, self.context)?;
        let next = behind.map_or(found, |behind| behind.min(found));
        if self.at == 0 && super::preamble(self.file, next)?.is_some() {
            self.ledger.count(Fate::Skipped, next);
            self.book.preamble += next;
            self.at = next;
            return Ok(());
        }
        if next == self.file.size() && reason == CUT {
            self.ledger.cut(&self.name, self.at, next - self.at, "the log ends inside a frame");
        } else {
            self.ledger.damaged(&self.name, self.at, next - self.at, reason);
        }
        self.at = next;
        Ok(())
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
