//! One file per format.

mod bag;
pub mod bag_folder;
mod csv;
mod dataflash;
mod db3;
mod identity;
mod inflate;
mod mcap;
mod nmea;
mod receiver;
mod tlog;
mod ubx;
mod ulog;
mod unpack;
mod unpacker;
mod workers;
mod yaml;

use bag::read as read_bag;
pub use csv::inert;
pub(crate) use csv::looks_like as looks_like_table;
use csv::read as read_tables;
pub(crate) use dataflash::looks_like as looks_like_dataflash;
use dataflash::read as read_dataflash;
use db3::read as read_db3;
pub use db3::write_ahead_log_of;
use mcap::read as read_mcap;
pub use mcap::{OriginalLog, OriginalTopic};
pub(crate) use nmea::looks_like as looks_like_nmea;
use receiver::read as read_receiver;
pub(crate) use tlog::looks_like as looks_like_tlog;
use tlog::read as read_tlog;
pub(crate) use ubx::looks_like as looks_like_ubx;
use ulog::read as read_ulog;
pub(crate) use unpack::named_text;
pub use unpack::{ENDINGS as PACKED_ENDINGS, Member, Packing, is_packed_of, members, read};

use crate::bytes::is_zero;
use crate::decode::{Tally, Topics};
use crate::error::{LogError, file_name};
use crate::reader::{Limits, Log, ReadContext, Select};
use crate::sniff::LogKind;
use flight::{Code, Notices, Severity};
use logscan::{Ledger, LogFile, MOST_ZEROS, Source};
use std::path::PathBuf;

/// Reads unpacked files of one kind, one log or several that make up one flight, once from the first byte to the last.
///
/// `want` is called once for each topic, before its first message. Damage is not an error: intact data before and after
/// it is returned, with the damage in the health and a notice. Messages are decoded in the caller's thread. Meanwhile
/// idle threads may decompress chunks: those of the caller's rayon pool, or else of one pool of up to four threads for
/// all logs.
///
/// # Errors
/// Only if nothing can be used, the file cannot be read, or on cancellation.
pub fn read_files(
    kind: LogKind,
    files: &[PathBuf],
    want: &dyn Select,
    context: &ReadContext<'_>,
) -> Result<Log, LogError> {
    match kind {
        LogKind::Csv => read_tables(files, want, context),
        LogKind::Mcap => read_mcap(files, want, context),
        LogKind::Bag => read_bag(files, want, context),
        LogKind::Ulog => read_ulog(files, want, context),
        LogKind::DataFlash => read_dataflash(files, want, context),
        LogKind::Tlog => read_tlog(files, want, context),
        LogKind::Db3 => read_db3(files, want, context),
        LogKind::Nmea => read_receiver(files, true, want, context),
        LogKind::Ubx => read_receiver(files, false, want, context),
    }
}

/// Reports how many messages belong to no topic that the log defines.
fn report_unplaced(unplaced: &Tally, file: &str, notices: &mut Notices) {
    unplaced.report(Code::Undecodable, file, "messages that belong to no known topic", notices);
}

/// Reports how many messages (in the format's own term) belong to topics above the topic limit.
fn report_too_many_topics(unplaced: &Tally, what: &str, file: &str, notices: &mut Notices) {
    unplaced.report(Code::TooMuchData, file, &format!("{what} were not read: the log has too many topics"), notices);
}

/// Reports how many messages could not be decompressed.
fn report_broken(broken: &Tally, file: &str, notices: &mut Notices) {
    broken.report(Code::Undecodable, file, "messages with corrupt compression", notices);
}

/// Compares the number of messages with the number stated by `by`, such as an index.
fn compare_count(by: &str, stated: u64, found: u64, file: &str, notices: &mut Notices) {
    if stated > found {
        let text = format!("messages are missing: {stated} in the {by}, {found} were found");
        notices.push(Code::IndexDiffers.at(Severity::Loss), file, stated - found, text);
    } else if stated < found {
        let text = format!("more messages than in the {by} ({stated})");
        notices.push(Code::IndexDiffers, file, found - stated, text);
    }
}

/// Rejects a file that is empty, all zeros as far as examined, or text: it is not a log, not even a damaged one.
/// `wrong_start` is what the walk would report for its first bytes.
fn refuse_foreign(file: &mut LogFile, wrong_start: &str, context: &ReadContext<'_>) -> Result<(), LogError> {
    let nothing = all_zero(file)?;
    let what = match file.up_to(0, 4096)? {
        [] => "the file is empty".to_owned(),
        _ if nothing => "the file begins with zero bytes only".to_owned(),
        text if is_text(text) => format!("{wrong_start}: it is text, {}", kind_of_text(text, context)),
        _ => return Ok(()),
    };
    Err(LogError::NotALog { file: file.name().to_owned(), what })
}

/// Whether one of the files that make up a log is not a log itself. This is reported, and the other files are read.
fn is_foreign_part(
    refused: Result<(), LogError>,
    size: u64,
    ledger: &mut Ledger,
    notices: &mut Notices,
) -> Result<bool, LogError> {
    let Err(LogError::NotALog { file, what }) = refused else { return refused.map(|()| false) };
    if size > 0 {
        ledger.damaged(&file, 0, size, what);
    } else {
        notices.push(Code::IncompleteRecording, file, 1, "a part of this recording is empty");
    }
    Ok(true)
}

/// Describes a wrong start of a file: `wrong_start`, or a copy in text mode, which changes line ends or replaces
/// invalid UTF-8.
fn wrong_start(found: &[u8], magic: &[u8], wrong_start: &'static str) -> &'static str {
    let line = |end: &[u8]| [magic.trim_ascii_end(), end].concat();
    let all: [Vec<u8>; 3] = [b"\n", &b"\r\n"[..], b"\r\r\n"].map(line);
    let is_text = |changed: &[u8]| changed != magic && found.starts_with(changed);
    let not_utf8 = magic.first().is_some_and(|first| !first.is_ascii()) && found.starts_with("\u{fffd}".as_bytes());
    if not_utf8 || all.iter().any(|changed| is_text(changed)) {
        return "the file was copied in text mode, which damages all of it: copy it again in binary mode";
    }
    wrong_start
}

/// Whether a file is all zeros as far as examined. A file that only lost its first blocks is not.
fn all_zero(file: &mut LogFile) -> Result<bool, LogError> {
    let end = file.size().min(MOST_ZEROS);
    let (mut at, mut most) = (0, 4096);
    while at < end {
        let block = file.up_to(at, most)?;
        if !is_zero(block) {
            return Ok(false);
        }
        at += block.len().max(1) as u64;
        most = 1 << 20;
    }
    Ok(true)
}

/// Text without control characters, longer than a truncated log could be before its first length
/// field.
fn is_text(head: &[u8]) -> bool {
    const SHORTEST: usize = 16;
    let plain = |b: &u8| *b >= b' ' || b"\t\r\n".contains(b);
    // The last character may be truncated.
    let valid = std::str::from_utf8(head).map_or_else(|e| e.error_len().is_none(), |_| true);
    head.len() > SHORTEST && valid && head.iter().all(plain)
}

fn kind_of_text(head: &[u8], context: &ReadContext<'_>) -> String {
    if looks_like_table(head, context).is_ok() {
        return "it looks like a table: rename it to end in .csv".to_owned();
    }
    let first: String = String::from_utf8_lossy(head).lines().next().unwrap_or_default().chars().take(60).collect();
    format!("its first line {first:?}")
}

/// Removes the log times of a format with messages that have no log timestamp.
fn forget_log_times(log: &mut Log) {
    log.tables.iter_mut().for_each(|table| table.logged_ns = None);
    log.health.topics.iter_mut().for_each(|topic| topic.stamps.clear());
}

/// As `context`, limited to the number of topics that a log can reasonably have: each takes a few kilobytes.
fn with_topics<'c>(context: &'c ReadContext<'c>, most: usize) -> ReadContext<'c> {
    let limits = Limits { topics: context.limits.topics.min(most), ..context.limits };
    ReadContext { limits, cancel: context.cancel, on_bytes: context.on_bytes }
}

fn report_padding(file: &str, bytes: u64, notices: &mut Notices) {
    if bytes > 0 {
        notices.push(Code::Skipped, file, bytes, "bytes of padding after the last record");
    }
}

fn report_preamble(bytes: u64, notices: &mut Notices) {
    if bytes > 0 {
        notices.push(Code::Skipped, "", bytes, "bytes of text before the first frame");
    }
}

/// State that the readers of message formats share.
struct Reading<'w> {
    /// The first file.
    name: String,
    ledger: Ledger,
    notices: Notices,
    topics: Topics<'w>,
}

impl<'w> Reading<'w> {
    fn begin(files: &[LogFile], want: &'w dyn Select, context: &ReadContext<'_>) -> Reading<'w> {
        let name = files.first().map_or("", LogFile::name).to_owned();
        let size = files.iter().map(LogFile::size).sum();
        let topics = Topics::new(want, context.limits.topics, size);
        let ledger = Ledger::new(size, context.limits.listed_damage).timed_by(topics.log_time());
        Reading { name, ledger, notices: Notices::new(), topics }
    }

    /// Opens the only file of a log in a format that is never split.
    fn open(
        paths: &[PathBuf],
        want: &'w dyn Select,
        context: &ReadContext<'_>,
    ) -> Result<(LogFile, Reading<'w>), LogError> {
        let [path] = paths else {
            let file = paths.first().map_or(String::new(), |path| file_name(path));
            let what = format!("a log of this format is one file, but {} were given", paths.len());
            return Err(LogError::Unusable { file, what });
        };
        let file = LogFile::open(path)?;
        let reading = Reading::begin(std::slice::from_ref(&file), want, context);
        Ok((file, reading))
    }

    /// Assembles the log. A log with nothing intact is an error; an empty but complete one
    /// is not.
    fn conclude(self, mut log: Log) -> Result<Log, LogError> {
        // Damage first: it explains the notices that follow.
        self.ledger.finish(&mut log.health, &mut log.notices);
        log.notices.extend(self.notices);
        self.topics.finish(&mut log);
        let first = log.notices.iter().find(|n| n.severity == Severity::Loss);
        match first {
            Some(loss) if log.health.messages == 0 => Err(LogError::Unusable {
                file: self.name,
                what: format!("nothing in the file is intact: {}", loss.text),
            }),
            _ => Ok(log),
        }
    }
}
