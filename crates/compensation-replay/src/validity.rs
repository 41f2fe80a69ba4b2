//! Where a compensator helps, and the share of a flight there.

use crate::compensator::{ModalFilter, PadeForm};
use nalgebra::Complex;
use signal::Spectrum;
use std::f64::consts::TAU;

/// The model of the delay: a Padé form, or the exact one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DelayModel<'a> {
    /// `R = P/Q`.
    Pade(&'a PadeForm),
    /// A Padé form as a loop runs it: `R = 1 − jω H(e^{jωh})`, H its response in steps of h. Valid below `1/(2h)`.
    Loop {
        /// The filter; its own delay is the one that is removed.
        filter: &'a ModalFilter,
        /// Interval of the loop h, s.
        step_s: f64,
    },
    /// `e^{−s Td}`: exact FIR and exact asynchronous.
    Exact,
}

/// Position late by `position_s`, velocity late by `velocity_s`, a compensator set to `compensator_s`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Delays {
    /// Lateness of the position, s; positive is late.
    pub position_s: f64,
    /// Lateness of the velocity, s.
    pub velocity_s: f64,
    /// Delay that the compensator removes, s. `position_s − velocity_s` leaves the velocity's delay; `position_s` also
    /// leaves an error at all frequencies.
    pub compensator_s: f64,
}

impl Delays {
    /// Velocity on time and the compensator set correctly.
    #[must_use]
    pub fn of_position(delay_s: f64) -> Delays {
        Delays { position_s: delay_s, velocity_s: 0.0, compensator_s: delay_s }
    }
}

/// Frequencies at which a compensator is useful.
///
/// Motion of frequency f arrives as `x e^{−jωTp}` in the position and `jω x e^{−jωTv}` in the velocity. The error of
/// the compensated position is then `|e^{−jωTp} + (1 − R(jωTd)) e^{−jωTv} − 1|` of the amplitude, and that of the raw
/// one `|e^{−jωTp} − 1|` (continuous time, positions not held; design note 5.2).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ValidityBand {
    /// The error must be less than this share of the raw one below `helps_below_hz`.
    pub factor: f64,
    /// f1: up to here the error is less than `factor` of the raw one, at most `1/Tp`, where the raw error happens to
    /// vanish; `None` if it is not even for slow motion.
    pub helps_below_hz: Option<f64>,
    /// Up to here at least half of the raw error is removed.
    pub halves_below_hz: Option<f64>,
    /// f2: the lowest frequency above which it is worse than raw; `None` if it never is below `1/Tp`.
    pub worse_above_hz: Option<f64>,
}

impl ValidityBand {
    /// Band of a compensator for these delays, with the share of the raw error that still counts as helpful, e.g. 0.1.
    ///
    /// `None` if the position's or the compensator's delay is not positive, or the factor is not between 0 and 1.
    #[must_use]
    pub fn of(model: DelayModel<'_>, delays: Delays, factor: f64) -> Option<ValidityBand> {
        let positive = |x: f64| x > 0.0 && x.is_finite();
        let sound = positive(delays.position_s) && positive(delays.compensator_s) && delays.velocity_s.is_finite();
        let share = 0.0 < factor && factor < 1.0;
        if !(sound && share) {
            return None;
        }
        let below = |share: f64| match crossing(model, delays, share) {
            Crossing::At(hz) => Some(hz),
            Crossing::FromTheStart => None,
            Crossing::Never => Some(1.0 / delays.position_s),
        };
        let worse = match crossing(model, delays, 1.0) {
            Crossing::At(hz) => Some(hz),
            Crossing::FromTheStart => Some(0.0),
            Crossing::Never => None,
        };
        Some(ValidityBand { factor, helps_below_hz: below(factor), halves_below_hz: below(0.5), worse_above_hz: worse })
    }

    /// Distribution of the motion of a flight over the band, from the power spectra of the axes of its velocity about its
    /// mean: straight flight has none. `None` without motion.
    pub(crate) fn share_of_spectra(&self, spectra: &[Spectrum]) -> Option<MotionShare> {
        let lines = || spectra.iter().flat_map(|s| s.frequency_hz.iter().zip(&s.power));
        let total: f64 = lines().map(|(_, p)| p).sum();
        if !(total > 0.0 && total.is_finite()) {
            return None;
        }
        let share =
            |keep: &dyn Fn(f64) -> bool| lines().filter(|(f, _)| keep(**f)).map(|(_, p)| p).sum::<f64>() / total;
        let low = self.helps_below_hz.unwrap_or(0.0);
        let high = self.worse_above_hz.unwrap_or(f64::INFINITY).max(low);
        Some(MotionShare {
            helped: share(&|f| f < low),
            between: share(&|f| (low..high).contains(&f)),
            worse: share(&|f| f >= high),
        })
    }
}

/// Shares of the power of a flight's velocity; they sum to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionShare {
    /// Below f1.
    pub helped: f64,
    /// From f1 to f2.
    pub between: f64,
    /// Above f2: this motion is made worse.
    pub worse: f64,
}

/// Error of the compensated and of the raw position at a frequency, share of the amplitude.
#[must_use]
pub fn compensation_error(model: DelayModel<'_>, delays: Delays, hz: f64) -> (f64, f64) {
    let late = |s: f64| Complex::from_polar(1.0, -TAU * hz * s);
    let stand_in = match model {
        DelayModel::Pade(form) => form.delay_at(hz * delays.compensator_s),
        DelayModel::Loop { filter, step_s } => {
            Complex::from(1.0) - Complex::new(0.0, TAU * hz) * filter.response(TAU * hz * step_s, step_s)
        }
        DelayModel::Exact => late(delays.compensator_s),
    };
    let one = Complex::new(1.0, 0.0);
    let raw = late(delays.position_s) - one;
    ((raw + (one - stand_in) * late(delays.velocity_s)).norm(), raw.norm())
}

enum Crossing {
    /// The error is below the share up to here.
    At(f64),
    /// It is above it from the lowest frequency on.
    FromTheStart,
    /// It is below it up to `1/Tp`.
    Never,
}

/// Grid points up to 1/Tp.
const GRID: u32 = 2000;

/// Where the error first exceeds `share` of the raw one, on a grid of f·Tp and then by bisection.
fn crossing(model: DelayModel<'_>, delays: Delays, share: f64) -> Crossing {
    let last = 1.0 / delays.position_s;
    let exceeds = |hz: f64| {
        let (error, raw) = compensation_error(model, delays, hz);
        error > share * raw
    };
    // At 1/Tp itself the raw error is zero: the last grid point is before it.
    let step = last / f64::from(GRID);
    let Some(first) = (1..GRID).find(|&k| exceeds(f64::from(k) * step)) else { return Crossing::Never };
    if first == 1 {
        return Crossing::FromTheStart;
    }
    let (mut low, mut high) = (f64::from(first - 1) * step, f64::from(first) * step);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if exceeds(middle) { high = middle } else { low = middle }
    }
    Crossing::At(high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compensator::{CompensatorKind, VelocityFilter};
    use record::StartRule;
    use signal::power_spectrum;

    fn band(m: usize, n: usize, factor: f64) -> ValidityBand {
        let form = PadeForm::new(m, n).unwrap();
        ValidityBand::of(DelayModel::Pade(&form), Delays::of_position(0.4), factor).unwrap()
    }

    #[test]
    fn the_papers_filter_halves_below_0_480_and_harms_above_0_680_of_one_over_td() {
        let found = band(1, 1, 0.1);
        assert!((found.halves_below_hz.unwrap() * 0.4 - 0.480).abs() < 5e-4, "{found:?}");
        assert!((found.worse_above_hz.unwrap() * 0.4 - 0.680).abs() < 5e-4, "{found:?}");
        // Closed form: sin(x/2 − atan(x/2)) = 0.1 sin(x/2) at f1.
        let half = std::f64::consts::PI * found.helps_below_hz.unwrap() * 0.4;
        assert!(((half - half.atan()).sin() - 0.1 * half.sin()).abs() < 1e-9);
    }

    #[test]
    fn a_loop_that_holds_the_velocity_helps_much_less_far() {
        let band = |name: &str, step_s: f64| {
            let filter = name.parse::<CompensatorKind>().unwrap().filter(0.4).unwrap();
            let model = DelayModel::Loop { filter: &filter, step_s };
            ValidityBand::of(model, Delays::of_position(0.4), 0.1).unwrap().helps_below_hz.unwrap()
        };
        // Holding for h delays the velocity by h/2, which costs ωh/2 of the raw error: a tenth at 1/(10 π h).
        let expected = 1.0 / (10.0 * std::f64::consts::PI * 0.05);
        let held = band("pade-4-4-zoh", 0.05);
        assert!((held - expected).abs() < 0.01 * expected, "{held} {expected}");
        // Fast loops approach the continuous filter.
        let form = PadeForm::new(2, 2).unwrap();
        let continuous = ValidityBand::of(DelayModel::Pade(&form), Delays::of_position(0.4), 0.1).unwrap();
        let fast = band("pade-2-2-foh", 1e-3);
        assert!((fast - continuous.helps_below_hz.unwrap()).abs() < 2e-3, "{fast} {continuous:?}");
    }

    #[test]
    fn the_response_in_a_loop_is_what_the_filter_does() {
        // 30 s of a tone of 0.5 Hz through the filter itself, 50 ms apart.
        let mut filter = "pade-2-2-zoh".parse::<CompensatorKind>().unwrap().filter(0.4).unwrap();
        let (omega, h) = (TAU * 0.5, 0.05);
        let response = filter.response(omega * h, h);
        filter.start(1.0, StartRule::Warm, h);
        for k in 1..600 {
            let phase = omega * h * f64::from(k);
            let found = filter.step(h, phase.cos());
            let expected = (response * Complex::from_polar(1.0, phase)).re;
            assert!(k < 400 || (found - expected).abs() < 1e-9, "{k}: {found} {expected}");
        }
    }

    #[test]
    fn higher_orders_help_further() {
        let f1 = [(0, 1), (1, 1), (1, 2), (2, 2), (3, 3), (4, 4)].map(|(m, n)| band(m, n, 0.1).helps_below_hz.unwrap());
        assert!(f1.is_sorted_by(|a, b| a < b), "{f1:?}");
    }

    #[test]
    fn a_late_velocity_leaves_only_its_own_delay() {
        let delays = Delays { position_s: 0.5, velocity_s: 0.1, compensator_s: 0.4 };
        let (error, _) = compensation_error(DelayModel::Exact, delays, 0.3);
        assert!((error - 2.0 * (std::f64::consts::PI * 0.3 * 0.1).sin()).abs() < 1e-12);
        // A fifth of the delay is left at best: a tenth cannot be reached, a half can.
        let band = ValidityBand::of(DelayModel::Exact, delays, 0.1).unwrap();
        assert_eq!(band.helps_below_hz, None);
        let half = ValidityBand::of(DelayModel::Exact, delays, 0.5).unwrap().helps_below_hz.unwrap();
        // sin(π f 0.1) = 0.5 sin(π f 0.5).
        let angle = std::f64::consts::PI * half;
        assert!(((0.1 * angle).sin() - 0.5 * (0.5 * angle).sin()).abs() < 1e-9, "{half}");
    }

    #[test]
    fn the_exact_form_on_time_helps_everywhere() {
        let band = ValidityBand::of(DelayModel::Exact, Delays::of_position(0.4), 0.1).unwrap();
        assert_eq!((band.helps_below_hz, band.worse_above_hz), (Some(2.5), None));
    }

    #[test]
    fn the_wrong_sign_is_worse_from_the_start() {
        let delays = Delays { position_s: 0.1, velocity_s: 0.0, compensator_s: 0.5 };
        let band = ValidityBand::of(DelayModel::Exact, delays, 0.1).unwrap();
        assert_eq!((band.helps_below_hz, band.worse_above_hz), (None, Some(0.0)));
        assert!(ValidityBand::of(DelayModel::Exact, Delays::of_position(0.0), 0.1).is_none());
        assert!(ValidityBand::of(DelayModel::Exact, Delays::of_position(0.4), 1.0).is_none());
    }

    #[test]
    fn motion_is_distributed_by_power() {
        let form = PadeForm::new(1, 1).unwrap();
        let band = ValidityBand::of(DelayModel::Pade(&form), Delays::of_position(0.4), 0.1).unwrap();
        let tone = |f: f64, a: f64| move |k: usize| a * (TAU * f * k as f64 / 50.0).sin();
        // 0.3 Hz is below f1 = 0.42 Hz, 1 Hz between, 2 Hz above f2 = 1.70 Hz; powers 8 : 1 : 1.
        let (slow, mid, fast) = (tone(0.3, 8f64.sqrt()), tone(1.0, 1.0), tone(2.0, 1.0));
        let north: Vec<f64> = (0..10_000).map(|k| 9.0 + slow(k) + mid(k)).collect();
        let east: Vec<f64> = (0..10_000).map(fast).collect();
        let share = band.share_of_spectra(&[&north, &east].map(|v| power_spectrum(v, 50.0))).unwrap();
        assert!((share.helped - 0.8).abs() < 1e-3 && (share.between - 0.1).abs() < 1e-3, "{share:?} {band:?}");
        assert!((share.helped + share.between + share.worse - 1.0).abs() < 1e-12);
        assert_eq!(band.share_of_spectra(&[power_spectrum(&[3.0; 100], 50.0)]), None);
    }
}
