//! The replay against flights whose truth is known.

#![allow(clippy::print_stdout)] // tests may say what they saw

mod compensators;
mod edges;
mod export;
mod flight_delay;
mod flights;
mod like_cases;
mod like_flights;
mod scores;
mod sweep;
mod vectors;
