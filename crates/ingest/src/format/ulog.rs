//! PX4 ULog (<https://docs.px4.io/main/en/dev_log/ulog_file_format.html>), by a walk over the messages.

pub(super) mod about;
mod beside;
mod boots;
mod formats;
mod record;
mod session;
mod walk;

use self::boots::Boots;
use self::session::Session;
use self::walk::{START, WRONG_START, Walk};
use crate::decode::Topics;
use crate::error::IngestError;
use crate::format::Reading;
use crate::format::file::LogFile;
use crate::ledger::Ledger;
use crate::reader::{Log, LogReader, ReadContext, Select};
use flight::{Clock, LogHealth, Notices, Severity};
use std::path::PathBuf;

/// What every ULog begins with; its version follows.
const MAGIC: &[u8] = b"ULog\x01\x12\x35";
/// The newest version of the format.
const VERSION: u8 = 1;

/// Logs one behind another in one file.
const MOST_LOGS: u64 = 1000;
/// Topics in one log: PX4 has some three hundred, and few instances of each.
const MOST_TOPICS: usize = 8192;

/// Reads one PX4 ULog, or several that make up one flight.
#[derive(Debug, Clone)]
pub struct UlogReader {
    files: Vec<PathBuf>,
}

impl UlogReader {
    /// A reader of these files. Nothing is opened yet.
    #[must_use]
    pub fn new(files: Vec<PathBuf>) -> UlogReader {
        UlogReader { files }
    }
}

impl LogReader for UlogReader {
    fn read(&mut self, want: &dyn Select, context: &ReadContext<'_>) -> Result<Log, IngestError> {
        let context = &super::with_topics(context, MOST_TOPICS);
        let Reading { mut files, mut ledger, mut notices, mut topics } = Reading::begin(&self.files, want, context)?;
        topics.count_by(Clock::Boot);
        let mut log = Log::default();
        let mut boots = Boots::default();
        for file in &mut files {
            read_file(file, context, &mut ledger, &mut topics, &mut boots, &mut notices, &mut log.health)?;
        }
        log.restarts = boots.restarts;
        Reading { files, ledger, notices, topics }.conclude(log)
    }
}

/// Reads one file, which may be several logs one behind another.
fn read_file(
    file: &mut LogFile,
    context: &ReadContext<'_>,
    ledger: &mut Ledger,
    topics: &mut Topics<'_>,
    boots: &mut Boots,
    notices: &mut Notices,
    health: &mut LogHealth,
) -> Result<(), IngestError> {
    super::refuse_foreign(file, WRONG_START, context)?;
    let (name, size) = (file.name().to_owned(), file.size());
    let mut walk = Walk::new(&name, ledger);
    let (mut tried, mut logs) = (0, 0);
    while tried == 0 || walk.at < size && tried < MOST_LOGS {
        let bytes = file.up_to(walk.at, 2 * START as usize)?;
        let head = Head::of(bytes);
        walk.begin(bytes, head.intact);
        let mut session = Session::new(topics, boots.next_log(head.began_us));
        walk.run(file, context, &mut session)?;
        (tried, logs) = (tried + 1, logs + u64::from(walk.found_any));
        boots.latest(session.last_stamp.us);
        if head.version > VERSION {
            let version = head.version;
            let text =
                format!("the log is of version {version}; what is new in it since version {VERSION} is not read");
            notices.push(Severity::Warning, "newer-version", name.as_str(), 1, text);
        }
        session.conclude(&name, notices);
        session.hand_on();
        health.undecodable += session.unplaced.count;
        health.extras.extend(session.gathered.extras());
        let about = session.gathered.about();
        if health.about.is_empty() {
            health.about = about;
        }
        health.format = format!("ULog {}", head.version);
    }
    walk.conclude(notices);
    if walk.at < size {
        walk.leave(size, "more logs in one file than are read");
    }
    super::tell_logs(&name, logs, notices);
    Ok(())
}

/// The first bytes of a log.
struct Head {
    intact: bool,
    version: u8,
    /// When the log was begun, by the clock since boot.
    began_us: Option<u64>,
}

impl Head {
    fn of(bytes: &[u8]) -> Head {
        // A cut head is still one.
        let intact = bytes.iter().zip(MAGIC).all(|(a, b)| a == b);
        let began = bytes.get(MAGIC.len() + 1..).and_then(|time| time.first_chunk().copied().map(u64::from_le_bytes));
        let version = bytes.get(MAGIC.len()).copied().filter(|_| intact).unwrap_or(VERSION);
        Head { intact, version, began_us: began.filter(|_| intact) }
    }
}
