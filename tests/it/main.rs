//! What only the whole can show.

#![allow(clippy::print_stdout, reason = "a skipped test says so")]

mod agreement;
mod bench;
mod book;
mod browser;
mod campaign;
mod command;
mod convert;
mod pages;
mod program;
mod real_logs;
mod reference;
