//! How a delay changes during a flight.
