//! Damaged and hostile logs of every format: no panic, no hang, bounded memory, every byte accounted for, nothing lost
//! or changed silently.
//!
//! A separate binary, as its allocator counts. The ignored tests are exhaustive: `just faults`.

#![allow(clippy::print_stdout, reason = "figures of the exhaustive runs")]

mod blocks;
mod bombs;
mod cuts;
mod flips;
mod hostile;
mod lab;
mod layout;
mod lengths;
mod moving;
mod odd;
mod packed;
mod pieces;
mod regress;
mod schemas;
mod structure;
mod verdict;
