//! ROS 2 bag in SQLite.

use crate::error::IngestError;
use crate::reader::{Log, LogReader, ReadContext, Select};
use std::path::PathBuf;

/// Reads ROS 2 bag in SQLite.
#[derive(Debug, Clone)]
pub struct Db3Reader {
    files: Vec<PathBuf>,
}

impl Db3Reader {
    /// A reader of these files. Nothing is opened yet.
    #[must_use]
    pub fn new(files: Vec<PathBuf>) -> Db3Reader {
        Db3Reader { files }
    }
}

impl LogReader for Db3Reader {
    fn read(&mut self, _want: &dyn Select, _context: &ReadContext<'_>) -> Result<Log, IngestError> {
        let file = self.files.first().map(|f| f.display().to_string()).unwrap_or_default();
        Err(IngestError::NotALog { file, what: "ROS 2 bag in SQLite, a format that is not read yet".to_owned() })
    }
}
