//! PX4 ULog.

use crate::error::IngestError;
use crate::reader::{Log, LogReader, ReadContext, Select};
use std::path::PathBuf;

/// Reads PX4 ULog.
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
    fn read(&mut self, _want: &dyn Select, _context: &ReadContext<'_>) -> Result<Log, IngestError> {
        let file = self.files.first().map(|f| f.display().to_string()).unwrap_or_default();
        Err(IngestError::NotALog { file, what: "PX4 ULog, a format that is not read yet".to_owned() })
    }
}
