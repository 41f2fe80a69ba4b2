//! Conversions of simulated flights, read back.

mod export;
mod flight;
mod guard;
mod layouts;
mod original;
mod recover;
mod track;
