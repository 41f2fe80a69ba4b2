//! A delay that may vary during a flight.
