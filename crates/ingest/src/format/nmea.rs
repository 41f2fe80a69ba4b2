//! NMEA 0183.

use crate::error::IngestError;
use crate::reader::{Log, LogReader, ReadContext, Select};
use std::path::PathBuf;

/// Reads NMEA 0183.
#[derive(Debug, Clone)]
pub struct NmeaReader {
    files: Vec<PathBuf>,
}

impl NmeaReader {
    /// A reader of these files. Nothing is opened yet.
    #[must_use]
    pub fn new(files: Vec<PathBuf>) -> NmeaReader {
        NmeaReader { files }
    }
}

impl LogReader for NmeaReader {
    fn read(&mut self, _want: &dyn Select, _context: &ReadContext<'_>) -> Result<Log, IngestError> {
        let file = self.files.first().map(|f| f.display().to_string()).unwrap_or_default();
        Err(IngestError::NotALog { file, what: "NMEA 0183, a format that is not read yet".to_owned() })
    }
}
