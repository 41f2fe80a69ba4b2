//! PX4 ULog (<https://docs.px4.io/main/en/dev_log/ulog_file_format.html>), by a walk over the messages.

pub(super) mod about;
mod beside;
mod formats;
mod record;
mod session;
mod walk;

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
        for file in &mut files {
            read_file(file, context, &mut ledger, &mut topics, &mut notices, &mut log.health)?;
        }
        Reading { files, ledger, notices, topics }.conclude(log)
    }
}

fn read_file(
    file: &mut LogFile,
    context: &ReadContext<'_>,
    ledger: &mut Ledger,
    topics: &mut Topics<'_>,
    notices: &mut Notices,
    health: &mut LogHealth,
) -> Result<(), IngestError> {
    super::refuse_foreign(file, WRONG_START, context)?;
    let name = file.name().to_owned();
    let head = file.up_to(0, START as usize)?;
    // A cut head is still one.
    let intact = head.iter().zip(MAGIC).all(|(a, b)| a == b);
    let version = head.get(MAGIC.len()).copied().unwrap_or(VERSION);
    let mut session = Session::new(topics);
    let mut walk = Walk::new(&name, ledger);
    walk.begin(file.size(), intact);
    walk.run(file, context, &mut session)?;
    walk.conclude(notices);
    if version > VERSION {
        let text = format!("the log is of version {version}; what is new in it since version {VERSION} is not read");
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
    health.format = format!("ULog {version}");
    Ok(())
}
