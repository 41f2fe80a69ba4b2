//! One format, one file.

mod bag;
mod csv;
mod file;
mod inflate;
mod mcap;

pub use bag::BagReader;
pub use csv::CsvReader;
pub(crate) use csv::looks_like as looks_like_table;
pub use mcap::{McapReader, mcap_indexed_records, mcap_records};

use crate::decode::Topics;
use crate::error::IngestError;
use crate::format::file::LogFile;
use crate::ledger::Ledger;
use crate::reader::Log;
use flight::{Notices, Severity};

/// A file that is empty, or zero as far as one looks, is no damaged log but none.
fn refuse_nothing(file: &mut LogFile) -> Result<(), IngestError> {
    let head = file.up_to(0, 4096)?;
    let what = match head {
        [] => "the file is empty",
        zeros if zeros.iter().all(|&b| b == 0) => "the file begins with nothing but zero bytes",
        _ => return Ok(()),
    };
    Err(IngestError::NotALog { file: file.name().to_owned(), what: what.to_owned() })
}

/// Puts a log of messages together. One in which nothing at all is intact is an error; an empty one
/// that is whole is not.
fn conclude(
    mut log: Log,
    ledger: Ledger,
    topics: Topics<'_>,
    notices: Notices,
    file: &str,
) -> Result<Log, IngestError> {
    // Damage first: it explains what follows.
    ledger.finish(&mut log.health, &mut log.notices);
    log.notices.extend(notices);
    topics.finish(&mut log);
    let first = log.notices.iter().find(|n| n.severity == Severity::Loss);
    match first {
        Some(loss) if log.health.messages == 0 => {
            let what = format!("nothing in it is intact: {}", loss.text);
            Err(IngestError::Unusable { file: file.to_owned(), what })
        }
        _ => Ok(log),
    }
}
