//! Holds only integration tests.
