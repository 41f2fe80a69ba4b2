//! ArduPilot DataFlash, binary and text (<https://ardupilot.org/dev/docs/code-overview-adding-a-new-log-message.html>).
//!
//! A log describes itself: an `FMT` record names the fields of a type and their format characters. Values are as
//! pymavlink gives them: `c`, `C`, `e`, `E` count hundredths and `L` counts 1e-7 degrees; all others are
//! unscaled. A topic is named after its type; for a type with instances the second is `GPS_1`.

mod binary;
mod dataflash_record;
mod dataflash_session;
pub(super) mod dataflash_vehicle;
pub(super) mod modes;
mod text;
mod units;

use self::dataflash_session::Session;
use crate::error::LogError;
use crate::format::Reading;
use crate::reader::{Log, ReadContext, Select};
use flight::Clock;
use logscan::{LogFile, Source};
use memchr::memmem;
use std::path::PathBuf;

/// Maximum topics in one log: there are fewer than 256 types, with few instances of each.
const MOST_TOPICS: usize = 4096;

/// Reads a DataFlash log, binary or text.
pub(crate) fn read(files: &[PathBuf], want: &dyn Select, context: &ReadContext<'_>) -> Result<Log, LogError> {
    let context = &super::with_topics(context, MOST_TOPICS);
    let (mut file, Reading { name, mut ledger, mut notices, mut topics }) = Reading::open(files, want, context)?;
    topics.count_by(Clock::Boot);
    let mut log = Log::default();
    let mut session = Session::new(&name, &mut topics);
    let text = is_text(&mut file)?;
    log.health.format = if text { "ArduPilot DataFlash (text)" } else { "ArduPilot DataFlash" }.to_owned();
    if text {
        text::Walk::new(&mut file, context, &mut ledger, &mut notices, &mut session).run()?;
    } else {
        super::refuse_foreign(&mut file, binary::NO_RECORD, context)?;
        let scanned = logscan::scan(&mut file, &mut ledger, context, &mut binary::Records::new(&mut session))?;
        super::report_padding(&name, scanned.padding, &mut notices);
    }
    session.finish(&mut log, &mut notices);
    Reading { name, ledger, notices, topics }.conclude(log)
}

/// The first definition in a text log, and the prefix of all definitions.
const TEXT_STARTS: [&str; 2] = ["FMT, 128, 89, FMT", "FMT,128,89,FMT"];
const TEXT_DEFINITION: &str = "FMT,";
/// The byte order mark that some editors prepend to a text.
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

fn starts_a_log(line: &[u8]) -> bool {
    TEXT_STARTS.iter().any(|text| line.starts_with(text.as_bytes()))
}

fn is_text(file: &mut LogFile) -> Result<bool, LogError> {
    let head = file.up_to(0, crate::sniff::HEAD)?;
    Ok(!head.starts_with(&dataflash_record::SYNC) && text_begins(head))
}

/// Whether a text log starts in these first bytes of a file: with the first definition, or with others if that one is
/// corrupt.
fn text_begins(head: &[u8]) -> bool {
    let head = head.strip_prefix(BYTE_ORDER_MARK).unwrap_or(head);
    let mut lines = head.split(|b| *b == b'\n');
    let definitions = head.split(|b| *b == b'\n').filter(|line| line.starts_with(TEXT_DEFINITION.as_bytes()));
    lines.any(starts_a_log) || definitions.take(2).count() == 2
}

/// Whether these first bytes of a file are those of a DataFlash log, whatever comes before its first record.
/// Two consecutive records of the type `FMT` do not occur by chance.
pub(crate) fn looks_like(head: &[u8]) -> bool {
    let definitions =
        memmem::find_iter(head, &[dataflash_record::SYNC[0], dataflash_record::SYNC[1], dataflash_record::FMT_ID]);
    let mut pairs = definitions.filter_map(|at| head.get(at + dataflash_record::FMT_LENGTH..));
    pairs
        .any(|next| next.starts_with(&[dataflash_record::SYNC[0], dataflash_record::SYNC[1], dataflash_record::FMT_ID]))
        || text_begins(head)
}
