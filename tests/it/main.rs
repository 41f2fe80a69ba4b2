//! Tests of the whole program.

#![allow(clippy::print_stdout, reason = "a skipped test says so")]

mod agreement;
mod bench;
mod bench_pages;
mod book;
mod browser;
mod campaign;
mod cluster;
mod command;
mod convert;
mod faults;
mod golden;
mod index_page;
mod memory;
mod nightly;
mod pages;
mod portable;
mod program;
mod real_logs;
mod reference;
mod schemas;
mod shared;
mod sources;
