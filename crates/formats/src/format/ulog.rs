//! PX4 ULog (<https://docs.px4.io/main/en/dev_log/ulog_file_format.html>), message by message.

pub(super) mod about;
mod beside;
mod boots;
mod formats;
mod messages;
mod session;
mod ulog_record;

use self::boots::Boots;
use self::messages::{Messages, NO_MESSAGE};
use crate::error::LogError;
use crate::format::Reading;
use crate::reader::{Log, ReadContext, Select};
use flight::Clock;
use logscan::scan;
use std::path::PathBuf;

/// The magic of every ULog; the version follows.
const MAGIC: &[u8] = b"ULog\x01\x12\x35";
/// Magic, version and time before the first message.
const START: usize = 16;
/// The newest version of the format.
const VERSION: u8 = 1;

/// Maximum logs one after another in one file.
const MOST_LOGS: u64 = 1000;
/// Maximum topics in one log: PX4 has about three hundred, with few instances of each.
const MOST_TOPICS: usize = 8192;

/// Reads a PX4 ULog.
pub(crate) fn read(files: &[PathBuf], want: &dyn Select, context: &ReadContext<'_>) -> Result<Log, LogError> {
    let context = &super::with_topics(context, MOST_TOPICS);
    let (mut file, Reading { name, mut ledger, mut notices, mut topics }) = Reading::open(files, want, context)?;
    topics.count_by(Clock::Boot);
    let mut log = Log::default();
    let mut boots = Boots::default();
    super::refuse_foreign(&mut file, NO_MESSAGE, context)?;
    let mut messages = Messages::new(&name, &mut topics, &mut boots, &mut notices, &mut log.health);
    scan(&mut file, &mut ledger, context, &mut messages)?;
    messages.finish();
    log.restarts = boots.restarts;
    Reading { name, ledger, notices, topics }.conclude(log)
}
