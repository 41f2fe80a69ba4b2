//! ArduPilot DataFlash.

use crate::error::IngestError;
use crate::reader::{Log, LogReader, ReadContext, Select};
use std::path::PathBuf;

/// Reads ArduPilot DataFlash.
#[derive(Debug, Clone)]
pub struct DataFlashReader {
    files: Vec<PathBuf>,
}

impl DataFlashReader {
    /// A reader of these files. Nothing is opened yet.
    #[must_use]
    pub fn new(files: Vec<PathBuf>) -> DataFlashReader {
        DataFlashReader { files }
    }
}

impl LogReader for DataFlashReader {
    fn read(&mut self, _want: &dyn Select, _context: &ReadContext<'_>) -> Result<Log, IngestError> {
        let file = self.files.first().map(|f| f.display().to_string()).unwrap_or_default();
        Err(IngestError::NotALog { file, what: "ArduPilot DataFlash, a format that is not read yet".to_owned() })
    }
}
