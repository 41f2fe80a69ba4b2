//! Bounds on what is done for a file, progress and cancellation.

use crate::error::ScanError;
use std::sync::atomic::{AtomicBool, Ordering};

/// A search after damage ends after this many zero bytes: a sparse file has nothing more.
pub const MOST_ZEROS: u64 = 64 << 20;
/// It begins with a block of so many bytes: the next frame is mostly near, and damage may be in many places.
pub const FIRST_BLOCK: usize = 512;
/// False starts are looked into up to this multiple of the file: a hostile file has many that overlap.
pub const MOST_IN_VAIN: u64 = 4;

/// Bounds on what is done for a file, also for a hostile or damaged one (faults.md P5).
#[derive(Debug, Clone, Copy)]
pub struct Limits {
    /// Largest record that is taken into memory, bytes.
    pub record_bytes: u64,
    /// Largest decompressed chunk, bytes.
    pub chunk_bytes: u64,
    /// Largest log that is unpacked onto the disk, bytes, whatever its packed size.
    pub unpacked_bytes: u64,
    /// Most topics in one log.
    pub topics: usize,
    /// Damaged ranges that are listed; the rest is counted.
    pub listed_damage: usize,
    /// Longest line of a text log, bytes.
    pub line_bytes: usize,
    /// Chunks whose index says that nothing in them is wanted need not be read: then nobody knows whether they are intact.
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

/// What a reader needs from its surroundings.
pub struct ReadContext<'a> {
    /// Bounds.
    pub limits: Limits,
    /// Set when the user wants to stop; readers look at it at least once every few megabytes.
    pub cancel: &'a AtomicBool,
    /// Told how many more bytes of the input have been read.
    pub on_bytes: &'a (dyn Fn(u64) + Sync),
}

impl ReadContext<'_> {
    /// Reports progress and stops if the user wants to.
    ///
    /// # Errors
    /// [`ScanError::Cancelled`].
    pub fn advance(&self, bytes: u64) -> Result<(), ScanError> {
        (self.on_bytes)(bytes);
        if self.cancel.load(Ordering::Relaxed) { Err(ScanError::Cancelled) } else { Ok(()) }
    }
}
