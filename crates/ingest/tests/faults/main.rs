//! Damaged and hostile logs of every format: no panic, no hang, bounded memory, every byte accounted for, nothing lost
//! or changed in silence.
//!
//! A binary of its own, for its allocator counts. What is marked as ignored is exhaustive: `just faults`.

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
