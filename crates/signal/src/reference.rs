//! What a measurement is compared with.

/// A known signal, continuous with its derivative.
pub trait Reference: Sync {
    /// First and last instant at which it is known, s.
    fn span(&self) -> (f64, f64);

    /// Value and time derivative at `t` (s) inside the span.
    fn value_and_rate(&self, t: f64) -> (f64, f64);
}
