//! The replay on flights with known truth.

#![allow(clippy::print_stdout)] // tests may print what they measured

mod compensators;
mod edges;
mod export;
mod flight_delay;
mod flights;
mod golden;
mod like_cases;
mod like_flights;
mod scores;
mod sweep;
mod vectors;
