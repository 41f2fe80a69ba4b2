//! Logs of receivers that say sentences, among which they may have been told to send binary frames.

use super::nmea;
use super::ubx::{self, UbxReader};
use crate::error::IngestError;
use crate::reader::{Log, LogReader, ReadContext, Select};
use logscan::LogFile;
use std::path::PathBuf;

/// Reads one NMEA log, or several that make up one flight.
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

    /// Whether binary frames stand between the sentences, however far behind the first. What a logger wrote in front of
    /// the lines the reader of frames does not know: there they are damage among sentences.
    fn holds_frames(&self, context: &ReadContext<'_>) -> Result<bool, IngestError> {
        for path in &self.files {
            if nmea::is_prefixed(LogFile::open(path)?.up_to(0, crate::sniff::HEAD)?) {
                return Ok(false);
            }
        }
        for path in &self.files {
            let mut file = LogFile::open(path)?;
            if !nmea::is_bare(file.up_to(0, crate::sniff::HEAD)?) && ubx::holds_frames(&mut file, context)? {
                return Ok(true);
            }
        }
        Ok(false)
    }
}

impl LogReader for NmeaReader {
    fn read(&mut self, want: &dyn Select, context: &ReadContext<'_>) -> Result<Log, IngestError> {
        if !self.holds_frames(context)? {
            return nmea::read(&self.files, want, context);
        }
        let mut log = UbxReader::new(self.files.clone()).read(want, context)?;
        log.health.format = "NMEA 0183 among UBX or RTCM 3".to_owned();
        Ok(log)
    }
}
