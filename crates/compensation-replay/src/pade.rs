//! The paper's compensator: Padé [1/1], Tustin.

/// `G(s) = Td / ((Td/2) s + 1)` (Park & Lee 2010, eq. 3) by Tustin's rule, with a step that may change from sample to
/// sample (the output is continuous, so this is the trapezoidal rule):
///
/// `y_k = [(Td − h) y_{k−1} + Td h (v_k + v_{k−1})] / (Td + h)` (design note 5.4).
///
/// Adds the displacement during Td to the late position. Compared with the exact form the error is
/// `2 |sin(x/2 − atan(x/2))|` of the amplitude, `x = 2π f Td`: 1 % at f·Td = 0.08. Above f·Td = 0.68 it is worse
/// than no compensation.
#[derive(Debug, Clone, PartialEq)]
pub struct PadeTustin {
    delay_s: f64,
    velocity: f64,
    output: f64,
}

impl PadeTustin {
    /// As if `velocity` (m/s) had always been flown: the output starts at `Td · v0`.
    ///
    /// # Panics
    /// If the delay is not positive.
    #[must_use]
    pub fn warm(delay_s: f64, velocity: f64) -> PadeTustin {
        assert!(delay_s > 0.0, "the compensator needs a positive delay, not {delay_s}");
        PadeTustin { delay_s, velocity, output: delay_s * velocity }
    }

    /// From rest, as in a naive implementation: the output initially lacks `Td v0 e^{−2t/Td}`. The first velocity
    /// counts as a step from zero over `step_s`.
    ///
    /// # Panics
    /// If the delay is not positive.
    #[must_use]
    pub fn cold(delay_s: f64, velocity: f64, step_s: f64) -> PadeTustin {
        let mut filter = PadeTustin::warm(delay_s, 0.0);
        filter.step(step_s, velocity);
        filter
    }

    /// Current displacement during the delay, m.
    #[must_use]
    pub fn output(&self) -> f64 {
        self.output
    }

    /// Takes the next velocity, m/s, `h` seconds after the last; returns the displacement, m.
    pub fn step(&mut self, h: f64, velocity: f64) -> f64 {
        let td = self.delay_s;
        self.output = ((td - h) * self.output + td * h * (velocity + self.velocity)) / (td + h);
        self.velocity = velocity;
        self.output
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_warm_start_needs_no_time_to_settle() {
        let mut filter = PadeTustin::warm(0.4, 20.0);
        for _ in 0..100 {
            assert!((filter.step(0.01, 20.0) - 8.0).abs() < 1e-12);
        }
    }

    #[test]
    fn steps_of_any_length_settle_at_delay_times_velocity() {
        // Also with h > Td, where the pole is negative: |pole| < 1 always.
        for h in [0.001, 0.1, 0.4, 1.0, 30.0] {
            let mut filter = PadeTustin::cold(0.4, 20.0, h);
            for _ in 0..20_000 {
                filter.step(h, 20.0);
            }
            assert!((filter.output() - 8.0).abs() < 1e-9, "h = {h}: {}", filter.output());
        }
    }
}
