//! Streams of GNSS receivers: binary frames of UBX and RTCM 3, and NMEA sentences in lines, in any mixture.

use super::Reading;
use super::nmea::{self, Lines};
use super::ubx::{self, Frames};
use crate::decode::Topics;
use crate::error::LogError;
use crate::reader::{Log, ReadContext, Select};
use crate::sniff::HEAD;
use logscan::{Fate, Framing, LogFile, Parsed, Source, is_plain, is_zero, scan};
use memchr::{memchr, memchr3};
use std::borrow::Cow;
use std::path::PathBuf;

/// Topics in one log: talkers and sentence types, and some two hundred messages of u-blox.
const MOST_TOPICS: usize = 4096;

/// Reported for a stream of frames where neither a frame nor a sentence begins.
const NOTHING: &str = "bytes that are neither a frame nor a sentence";

/// Reads one NMEA log, a stream of lines, or one UBX log, of frames. The receiver may have been configured to
/// send the other format as well.
pub(crate) fn read(
    paths: &[PathBuf],
    of_lines: bool,
    want: &dyn Select,
    context: &ReadContext<'_>,
) -> Result<Log, LogError> {
    let context = &super::with_topics(context, MOST_TOPICS);
    let (mut file, Reading { name, mut ledger, mut notices, mut topics }) = Reading::open(paths, want, context)?;
    refuse_foreign(&mut file, of_lines, context)?;
    let lines = Lines::new(of_lines, of_lines && nmea::has_bare_sentences(&mut file)?);
    let mut stream = Stream { topics: &mut topics, frames: Frames::default(), lines };
    let preamble = scan(&mut file, &mut ledger, context, &mut stream)?.preamble;
    stream.lines.report(&name, &mut notices);
    super::report_preamble(preamble, &mut notices);
    let mut log = Log::default();
    log.health.format = name_of(of_lines, stream.frames.any).to_owned();
    let Stream { frames, lines, .. } = stream;
    let (weeks, marks) = frames.finish(&mut log, &mut notices);
    let dates = lines.finish(&mut log, &mut notices);
    let mut log = Reading { name, ledger, notices, topics }.conclude(log)?;
    if of_lines && log.health.topics.is_empty() && log.health.bytes.damaged == 0 {
        return Err(LogError::NotALog {
            file: file.name().to_owned(),
            what: "the file has no NMEA sentence".to_owned(),
        });
    }
    weeks.put(&mut log);
    marks.put(&mut log);
    dates.put(&mut log);
    super::forget_log_times(&mut log);
    Ok(log)
}

fn name_of(of_lines: bool, has_frames: bool) -> &'static str {
    match (of_lines, has_frames) {
        (true, false) => "NMEA 0183",
        (true, true) => "NMEA 0183 among UBX or RTCM 3",
        (false, _) => "u-blox UBX",
    }
}

fn refuse_foreign(file: &mut LogFile, of_lines: bool, context: &ReadContext<'_>) -> Result<(), LogError> {
    let head = file.up_to(0, HEAD)?;
    match of_lines {
        true if is_zero(head) => super::refuse_foreign(file, "", context),
        false if !nmea::looks_like(head) && !ubx::looks_like(head) => super::refuse_foreign(file, NOTHING, context),
        _ => Ok(()),
    }
}

/// Routes frames and lines to their topics.
struct Stream<'b, 't> {
    topics: &'b mut Topics<'t>,
    frames: Frames,
    lines: Lines,
}

impl Framing for Stream<'_, '_> {
    fn longest(&self) -> usize {
        ubx::LONGEST
    }

    fn parse(&self, bytes: &[u8]) -> Parsed {
        if ubx::begins(bytes) { ubx::parse(bytes) } else { self.lines.parse(bytes) }
    }

    fn begins(&self, bytes: &[u8]) -> bool {
        ubx::begins(bytes) || bytes.first().is_some_and(|first| b"$!\r\n".contains(first))
    }

    fn candidate(&self, block: &[u8], from: usize) -> Option<usize> {
        let rest = block.get(from..)?;
        let frame = memchr3(ubx::SYNC[0], b'$', ubx::RTCM, rest);
        let before = rest.get(..frame.unwrap_or(rest.len())).filter(|_| self.lines.has_text());
        let line = before.and_then(|before| memchr(b'\n', before));
        line.or(frame).map(|at| from + at)
    }

    fn take(&mut self, bytes: &[u8], after: &[u8], _: u64) -> Result<Fate, Cow<'static, str>> {
        if ubx::begins(bytes) {
            self.lines.begin_line();
            return Ok(self.frames.take(bytes, self.topics));
        }
        Ok(self.lines.take(bytes, after, self.topics))
    }

    fn fault(&self, bytes: &[u8]) -> Cow<'static, str> {
        match bytes {
            _ if ubx::begins(bytes) => ubx::fault(bytes).into(),
            [b'$' | b'!', ..] => self.lines.fault(bytes),
            _ if self.lines.has_text() => self.lines.fault(bytes),
            _ => NOTHING.into(),
        }
    }

    fn is_preamble(&self, bytes: &[u8]) -> bool {
        // A star ends a sentence: the text before it is a fragment of one.
        is_plain(bytes) && bytes.ends_with(b"\n") && memchr(b'*', bytes).is_none()
    }

    fn breaks(&mut self) {
        self.lines.breaks();
    }
}
