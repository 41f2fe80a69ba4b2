//! Tests of the crate's public interface.

#![allow(clippy::print_stdout, reason = "a skipped test says so")]

mod bag;
mod bench;
mod bind;
mod bindings;
mod clocks;
mod csv;
mod dataflash;
mod db3;
mod definitions;
mod discover;
mod drivers;
mod golden;
mod gps_time;
mod guess;
mod identity;
mod kept_crates;
mod made;
mod maps;
mod mcap;
mod nmea;
mod own_tables;
mod power_off;
mod protobuf;
mod ros;
mod stream;
mod support;
mod threads;
mod time;
mod time_formats;
mod tlog;
mod ubx;
mod ulog;
mod unpack;
mod wire;
