//! Flights whose truth is known, written in every format
