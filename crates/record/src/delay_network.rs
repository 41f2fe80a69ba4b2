//! One lateness per channel: what the delay network of a flight says.
