//! The reference signal that a measurement is compared with.

/// A known signal with a continuous derivative.
pub trait Reference: Sync {
    /// First and last known instant, s.
    fn span(&self) -> (f64, f64);

    /// Value and time derivative at `t` (s) inside the span.
    fn value_and_rate(&self, t: f64) -> (f64, f64);

    /// [`Reference::value_and_rate`] at each of `instants` (s), into `values` and `rates`, both as long as `instants`.
    /// Rising instants are fastest: an implementation may continue from the previous one.
    fn fill(&self, instants: &[f64], values: &mut [f64], rates: &mut [f64]) {
        for ((t, value), rate) in instants.iter().zip(values).zip(rates) {
            (*value, *rate) = self.value_and_rate(*t);
        }
    }

    /// Possible errors of the whole reference, each with a coefficient fitted together with the delay: the k-th of
    /// every component of a fit has one coefficient in common. They are as late as the reference. Every component must
    /// have the same number of them.
    fn shared(&self) -> Vec<SharedColumn<'_>> {
        vec![]
    }
}

/// A possible error of a reference, such as the integrated bias of an accelerometer along one body axis.
#[derive(Clone, Copy)]
pub struct SharedColumn<'a> {
    /// Effect of a coefficient of 1 on the reference.
    pub reference: &'a dyn Reference,
    /// Standard deviation of the coefficient before the measurement: it keeps the fit well posed if the motion does not
    /// reveal the coefficient.
    pub prior_std: f64,
}

/// Finds the intervals of rising instants among rising knots, one after the other.
///
/// ```
/// let t = [0.0, 1.0, 3.0];
/// let mut cursor = signal::Cursor::default();
/// assert_eq!([-1.0, 0.5, 1.0, 9.0, 0.2].map(|at| cursor.interval(&t, at)), [0, 0, 1, 2, 0]);
/// ```
#[derive(Debug, Clone, Copy, Default)]
pub struct Cursor {
    at: usize,
    /// Size of the previous move.
    stride: usize,
}

impl Cursor {
    /// The `k` with `t[k] <= at < t[k + 1]`; 0 before all, the last one after all, and 0 without knots. Fast if
    /// instants are as far apart as the previous two.
    #[inline]
    pub fn interval(&mut self, t: &[f64], at: f64) -> usize {
        let begins = |k: usize| t.get(k).is_some_and(|x| *x <= at);
        let guess = self.at + self.stride;
        for k in [guess, guess + 1, guess.saturating_sub(1)] {
            if begins(k) && !begins(k + 1) {
                self.stride = k.saturating_sub(self.at);
                self.at = k;
                return k;
            }
        }
        let k = t.partition_point(|x| *x <= at).saturating_sub(1);
        self.stride = k.saturating_sub(self.at);
        self.at = k;
        k
    }
}
