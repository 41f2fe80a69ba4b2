//! The walk over a text log, line by line: name and values between commas.

use super::dataflash_session::Session;
use super::{BYTE_ORDER_MARK, starts_a_log};
use crate::error::LogError;
use crate::reader::ReadContext;
use flight::{Code, Notices};
use logscan::LogFile;
use logscan::{Fate, Ledger, Source};

/// Bytes searched for lines in one go.
const BLOCK: usize = 1 << 20;

/// A walk in progress.
pub(super) struct Walk<'w, 'c, 't, 's> {
    file: &'w mut LogFile,
    name: String,
    context: &'w ReadContext<'c>,
    ledger: &'w mut Ledger,
    notices: &'w mut Notices,
    session: &'w mut Session<'t, 's>,
    at: u64,
    /// Bytes of lines before the first record: console output of old autopilots.
    preamble: u64,
    begun: bool,
    /// The first record is not the usual first record of a log.
    headless: bool,
}

impl<'w, 'c, 't, 's> Walk<'w, 'c, 't, 's> {
    pub(super) fn new(
        file: &'w mut LogFile,
        context: &'w ReadContext<'c>,
        ledger: &'w mut Ledger,
        notices: &'w mut Notices,
        session: &'w mut Session<'t, 's>,
    ) -> Walk<'w, 'c, 't, 's> {
        let name = file.name().to_owned();
        Walk { file, name, context, ledger, notices, session, at: 0, preamble: 0, begun: false, headless: false }
    }

    /// From the first byte to the last.
    pub(super) fn run(mut self) -> Result<(), LogError> {
        if self.file.up_to(0, BYTE_ORDER_MARK.len())? == BYTE_ORDER_MARK {
            self.at = BYTE_ORDER_MARK.len() as u64;
            self.ledger.count(Fate::Structure, self.at);
        }
        while self.at < self.file.size() {
            if !self.lines()? {
                self.long_line()?;
            }
            self.file.progress(self.at, self.context)?;
        }
        if self.preamble > 0 {
            let text = "bytes of text before the first record";
            self.notices.push(Code::Skipped, self.name.as_str(), self.preamble, text);
        }
        if self.headless {
            let text = "the log does not begin with the definition of FMT itself: its first lines may be lost";
            self.notices.push(Code::IncompleteRecording, self.name.as_str(), 1, text);
        }
        Ok(())
    }

    /// The whole lines of the next block; `false` if it has none.
    fn lines(&mut self) -> Result<bool, LogError> {
        let longest = self.context.limits.line_bytes.max(1);
        let mut block = self.file.up_to(self.at, BLOCK.min(longest))?;
        if memchr::memchr(b'\n', block).is_none() {
            block = self.file.up_to(self.at, longest)?;
        }
        let mut taken = 0;
        for end in memchr::memchr_iter(b'\n', block) {
            let line = block.get(taken..end).unwrap_or_default();
            let length = (end + 1 - taken) as u64;
            match fate_of(line, self.session) {
                Ok(fate) => {
                    self.headless |= !self.begun && fate.is_some() && !starts_a_log(line);
                    self.begun |= fate.is_some();
                    self.ledger.count(fate.unwrap_or(Fate::Structure), length);
                }
                Err(_) if !self.begun && is_plain(line) => {
                    self.preamble += length;
                    self.ledger.count(Fate::Structure, length);
                }
                Err(reason) => self.ledger.damaged(&self.name, self.at + taken as u64, length, reason),
            }
            taken = end + 1;
        }
        self.at += taken as u64;
        Ok(taken > 0)
    }

    /// A line longer than the limit, or the last one without its line end: its last value may be truncated.
    fn long_line(&mut self) -> Result<(), LogError> {
        let start = self.at;
        let (end, ended) = self.file.line_end(start, self.context)?;
        self.at = end;
        if ended {
            self.ledger.damaged(&self.name, start, self.at - start, "a line longer than the limit");
        } else {
            self.ledger.cut(&self.name, start, self.at - start, "the log ends inside a line");
        }
        Ok(())
    }
}

/// The fate of a line; `None` for an empty one.
fn fate_of(line: &[u8], session: &mut Session<'_, '_>) -> Result<Option<Fate>, String> {
    let text = std::str::from_utf8(line).map_err(|_| "a line that is not valid text".to_owned())?.trim_end();
    if text.bytes().any(|b| b < b' ' && b != b'\t') {
        return Err("a line with control characters".to_owned());
    }
    if text.is_empty() {
        return Ok(None);
    }
    let (name, values) = text.split_once(',').unwrap_or((text, ""));
    session.line(name.trim(), values).map(Some)
}

fn is_plain(line: &[u8]) -> bool {
    std::str::from_utf8(line).is_ok_and(|text| text.bytes().all(|b| b >= b' ' || b"\t\r".contains(&b)))
}
