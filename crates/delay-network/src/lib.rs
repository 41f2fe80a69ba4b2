//! One lateness per channel, from all measured pairs of a flight.
