//! Conversions of simulated flights, read back.

mod export;
mod flight;
mod guard;
mod original;
mod recover;
mod track;
