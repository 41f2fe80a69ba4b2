//! Tests of the crate from outside.

#![allow(clippy::print_stdout, reason = "a skipped test says so")]

mod bag;
mod bench;
mod bind;
mod csv;
mod discover;
mod made;
mod maps;
mod mcap;
mod ros;
mod support;
