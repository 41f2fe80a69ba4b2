//! What a measurement is compared with.

/// A known signal, continuous with its derivative.
pub trait Reference: Sync {
    /// First and last instant at which it is known, s.
    fn span(&self) -> (f64, f64);

    /// Value and time derivative at `t` (s) inside the span.
    fn value_and_rate(&self, t: f64) -> (f64, f64);

    /// [`Reference::value_and_rate`] at each of `instants` (s), into `values` and `rates`, both as long as `instants`.
    /// Instants that rise are cheapest: an implementation may go on from where the last one was.
    fn fill(&self, instants: &[f64], values: &mut [f64], rates: &mut [f64]) {
        for ((t, value), rate) in instants.iter().zip(values).zip(rates) {
            (*value, *rate) = self.value_and_rate(*t);
        }
    }

    /// Directions in which the whole reference may be wrong, each with a coefficient that is fitted with the delay: the
    /// k-th of every component of a fit has one coefficient in common. They are as late as the reference. Every
    /// component must have equally many.
    fn shared(&self) -> Vec<SharedColumn<'_>> {
        vec![]
    }
}

/// A direction in which a reference may be wrong, such as what an accelerometer's bias along one body axis integrates to.
#[derive(Clone, Copy)]
pub struct SharedColumn<'a> {
    /// What a coefficient of 1 adds to the reference.
    pub reference: &'a dyn Reference,
    /// Standard deviation of the coefficient before anything is measured: it keeps the fit well posed where the motion
    /// does not show the coefficient.
    pub prior_std: f64,
}

/// Where rising instants lie between rising knots, one after the other.
///
/// ```
/// let t = [0.0, 1.0, 3.0];
/// let mut cursor = signal::Cursor::default();
/// assert_eq!([-1.0, 0.5, 1.0, 9.0, 0.2].map(|at| cursor.interval(&t, at)), [0, 0, 1, 2, 0]);
/// ```
#[derive(Debug, Clone, Copy, Default)]
pub struct Cursor {
    at: usize,
    /// How far it went the last time.
    stride: usize,
}

impl Cursor {
    /// The `k` with `t[k] <= at < t[k + 1]`; 0 before all, the last after all and for no knots. Cheap if instants are as
    /// far apart as the two before.
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
