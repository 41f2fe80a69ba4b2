//! The records of a file one by one, with the reader's own scan. For conformance tests.

use super::mcap_record;
use super::mcap_records::Records;
use super::summary::Summary;
use super::visit::Visit;
use crate::error::IngestError;
use crate::reader::{Limits, ReadContext};
use flight::{LogHealth, Notices};
use logscan::{Fate, Ledger, LogFile, scan};
use mcap::records::Record;
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// All records in file order; records in chunks come at the position of the chunk.
///
/// # Errors
/// If the file cannot be read, or if anything in it is damaged.
#[doc(hidden)]
pub fn mcap_records(path: &Path) -> Result<Vec<Record<'static>>, IngestError> {
    let mut file = LogFile::open(path)?;
    let cancel = AtomicBool::new(false);
    let context = ReadContext { limits: Limits::default(), cancel: &cancel, on_bytes: &|_| {} };
    let (mut ledger, mut health) = (Ledger::new(file.size(), 100), LogHealth::default());
    let (mut notices, mut all) = (Notices::new(), Collect(vec![]));
    let whole = 0..file.size();
    let summary = Summary::read(&mut file, whole, context.limits.record_bytes, &mut Collect(vec![]))?;
    let mut records = Records::new(&mut file, &context, &mut notices, &mut all, summary);
    scan(&mut file, &mut ledger, &context, &mut records)?;
    records.finish(&mut file)?;
    ledger.finish(&mut health, &mut notices);
    match notices.iter().find(|n| n.severity == flight::Severity::Loss) {
        Some(loss) => Err(IngestError::Unusable { file: file.name().to_owned(), what: loss.text.clone() }),
        None => Ok(all.0),
    }
}

struct Collect(Vec<Record<'static>>);

impl Visit for Collect {
    fn record(&mut self, opcode: u8, body: &[u8]) -> Result<Fate, String> {
        self.0.push(mcap_record::parse(opcode, body)?.into_owned());
        Ok(Fate::Structure)
    }

    fn may_want(&mut self, _channel: u16) -> bool {
        true
    }

    fn knows(&self, _channel: u16) -> bool {
        true
    }

    fn index(&mut self, body: &[u8]) -> Result<Fate, String> {
        self.record(mcap::records::op::MESSAGE_INDEX, body)
    }
}
