//! What a delay compensator would have done on a flight
