//! Extracts frames from files, damaged or not. Independent of any format.
//!
//! A format defines its frames ([`Framing`]). [`scan`] walks from frame to frame, resyncs after damage, and assigns
//! every byte a fate in the [`Ledger`]. It scans a file, or bytes in memory such as a decompressed chunk ([`Source`]).
//! Frames may be larger than memory: of those it examines only the head, and the format fetches the rest.

#![cfg_attr(not(test), deny(clippy::indexing_slicing, clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod bytes;
mod error;
mod frame;
mod ledger;
mod limits;
mod platform;
mod scan;
mod source;

pub use bytes::{is_plain, is_zero};
pub use error::ScanError;
pub use frame::{Fetched, Framing, Parsed, Trust};
pub use ledger::{Fate, Ledger, LogTime};
pub use limits::{FIRST_BLOCK, Limits, MOST_IN_VAIN, MOST_ZEROS, ReadContext};
pub use platform::read_at;
pub use scan::{Scanned, scan};
pub use source::{LogFile, Source, read_exactly};
