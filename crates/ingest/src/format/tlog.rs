//! MAVLink telemetry log.

use crate::error::IngestError;
use crate::reader::{Log, LogReader, ReadContext, Select};
use std::path::PathBuf;

/// Reads MAVLink telemetry log.
#[derive(Debug, Clone)]
pub struct TlogReader {
    files: Vec<PathBuf>,
}

impl TlogReader {
    /// A reader of these files. Nothing is opened yet.
    #[must_use]
    pub fn new(files: Vec<PathBuf>) -> TlogReader {
        TlogReader { files }
    }
}

impl LogReader for TlogReader {
    fn read(&mut self, _want: &dyn Select, _context: &ReadContext<'_>) -> Result<Log, IngestError> {
        let file = self.files.first().map(|f| f.display().to_string()).unwrap_or_default();
        Err(IngestError::NotALog { file, what: "MAVLink telemetry log, a format that is not read yet".to_owned() })
    }
}
