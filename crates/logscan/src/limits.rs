//! Limits for reading a file, progress and cancellation.

use crate::error::ScanError;
use std::sync::atomic::{AtomicBool, Ordering};

/// A search after damage ends after this many zero bytes: a sparse file holds nothing more.
pub const MOST_ZEROS: u64 = 64 << 20;
/// Size of the first block of a search, bytes: the next frame is usually near, and damage may be in many places.
pub const FIRST_BLOCK: usize = 512;
/// False starts are examined up to this multiple of the file size: a hostile file has many that overlap.
pub const MOST_IN_VAIN: u64 = 4;

/// Limits for reading a file, including a hostile or damaged one (faults.md P5).
#[derive(Debug, Clone, Copy)]
pub struct Limits {
    /// Largest record that is read into memory, bytes.
    pub record_bytes: u64,
    /// Largest decompressed chunk, bytes.
    pub chunk_bytes: u64,
    /// Largest log that is unpacked to disk, bytes, whatever its packed size.
    pub unpacked_bytes: u64,
    /// Maximum number of topics in one log.
    pub topics: usize,
    /// Number of damaged ranges that are listed; the rest are counted.
    pub listed_damage: usize,
    /// Longest line of a text log, bytes.
    pub line_bytes: usize,
    /// Skip chunks whose index shows nothing wanted. Whether they are intact is then unknown.
    pub may_leave_closed: bool,
}

impl Default for Limits {
    fn default() -> Limits {
        Limits {
            record_bytes: 256 << 20,
            chunk_bytes: 256 << 20,
            unpacked_bytes: 16 << 30,
            topics: 65_536,
            listed_damage: 100,
            line_bytes: 1 << 20,
            may_leave_closed: true,
        }
    }
}

/// The environment of a reader.
pub struct ReadContext<'a> {
    /// Limits.
    pub limits: Limits,
    /// Set when the user requests a stop; readers check it at least once every few megabytes.
    pub cancel: &'a AtomicBool,
    /// Called with the number of further input bytes that have been read.
    pub on_bytes: &'a (dyn Fn(u64) + Sync),
}

impl ReadContext<'_> {
    /// Reports progress and stops if the user requested it.
    ///
    /// # Errors
    /// [`ScanError::Cancelled`].
    pub fn advance(&self, bytes: u64) -> Result<(), ScanError> {
        (self.on_bytes)(bytes);
        if self.cancel.load(Ordering::Relaxed) { Err(ScanError::Cancelled) } else { Ok(()) }
    }
}
