//! The paper's compensator: Padé [1/1], Tustin.

/// `G(s) = Td / ((Td/2) s + 1)` (Park & Lee 2010, eq. 3) by Tustin's rule, with a step that may
/// change from sample to sample (the output is continuous, so this is the trapezoid rule):
///
/// `y_k = [(Td − h) y_{k−1} + Td h (v_k + v_{k−1})] / (Td + h)` (design note 5.4).
///
/// Adds to the late position what was flown during Td. Against the exact form it errs by
/// `2 |sin(x/2 − atan(x/2))|` of the amplitude, `x = 2π f Td`: 1 % at f·Td = 0.08, and past
/// f·Td = 0.68 it is worse than no compensation.
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

    /// From rest, as a naive implementation: the output lacks `Td v0 e^{−2t/Td}` at first.
    /// The first velocity counts as a step from zero over `step_s`.
    ///
    /// # Panics
    /// If the delay is not positive.
    #[must_use]
    pub fn cold(delay_s: f64, velocity: f64, step_s: f64) -> PadeTustin {
        let mut filter = PadeTustin::warm(delay_s, 0.0);
        filter.step(step_s, velocity);
        filter
    }

    /// Displacement during the delay, m, as the filter has it now.
    #[must_use]
    pub fn output(&self) -> f64 {
        self.output
    }

    /// The next velocity, m/s, `h` seconds after the last; gives the displacement, m.
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

    /// `filters_Td0p4_dt0p01`, [1/1] Tustin, of the acceptance vectors: cold step and ramp.
    #[test]
    fn the_step_and_ramp_responses_equal_the_acceptance_vectors() {
        let step = [
            0.009_756_097_560_975_61,
            0.028_792_385_484_830_46,
            0.046_900_073_997_765_56,
            0.064_124_460_632_020_9,
            0.080_508_633_284_117_44,
            0.096_093_577_977_574_96,
            0.110_918_281_490_863_8,
            0.125_019_828_735_211_9,
            0.138_433_495_626_177_2,
            0.151_192_837_302_949_1,
        ];
        let mut filter = PadeTustin::cold(0.4, 1.0, 0.01);
        for (k, expected) in step.into_iter().enumerate() {
            let y = if k == 0 { filter.output() } else { filter.step(0.01, 1.0) };
            assert!((y - expected).abs() < 1e-10, "step {k}: {y} {expected}");
        }
        let ramp = [
            0.0,
            9.756098e-5,
            3.854848e-4,
            8.544856e-4,
            1.495_730_2e-3,
            2.300_816_5e-3,
            3.261_752_3e-3,
            4.370_935_1e-3,
            5.621_133_4e-3,
            7.005_468_3e-3,
        ];
        let mut filter = PadeTustin::cold(0.4, 0.0, 0.01);
        for (k, expected) in ramp.into_iter().enumerate().skip(1) {
            let y = filter.step(0.01, k as f64 * 0.01);
            assert!((y - expected).abs() < 1e-10, "ramp {k}: {y} {expected}");
        }
    }

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

    /// `circle_error` of the acceptance vectors: on a circle the continuous filter leaves R |e^{−x} − P/Q|.
    #[test]
    fn the_error_on_a_circle_is_the_closed_form() {
        let (radius, speed, td, h) = (30.0, 17.5, 0.4, 0.001);
        let omega: f64 = speed / radius;
        let north_late = |t: f64| radius * (omega * (t - td)).sin();
        let velocity = |t: f64| speed * (omega * t).cos();
        let mut filter = PadeTustin::warm(td, velocity(0.0));
        let mut worst: f64 = 0.0;
        for k in 1..40_000 {
            let t = f64::from(k) * h;
            let estimate = north_late(t) + filter.step(h, velocity(t));
            if t > 5.0 {
                worst = worst.max((estimate - radius * (omega * t).sin()).abs());
            }
        }
        let expected = 0.031_502_7; // closed form for U = 17.5 m/s, R = 30 m: 2 R |sin(x/2 − atan(x/2))|
        assert!((2.0 * radius * ((omega * td / 2.0) - (omega * td / 2.0).atan()).sin() - expected).abs() < 1e-5);
        assert!((worst - expected).abs() < 1e-5, "{worst}");
    }
}
