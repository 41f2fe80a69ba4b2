//! u-blox binary.

use crate::error::IngestError;
use crate::reader::{Log, LogReader, ReadContext, Select};
use std::path::PathBuf;

/// Reads u-blox binary.
#[derive(Debug, Clone)]
pub struct UbxReader {
    files: Vec<PathBuf>,
}

impl UbxReader {
    /// A reader of these files. Nothing is opened yet.
    #[must_use]
    pub fn new(files: Vec<PathBuf>) -> UbxReader {
        UbxReader { files }
    }
}

impl LogReader for UbxReader {
    fn read(&mut self, _want: &dyn Select, _context: &ReadContext<'_>) -> Result<Log, IngestError> {
        let file = self.files.first().map(|f| f.display().to_string()).unwrap_or_default();
        Err(IngestError::NotALog { file, what: "u-blox binary, a format that is not read yet".to_owned() })
    }
}
