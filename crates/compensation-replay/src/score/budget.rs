//! Expected error of a compensator, term by term (design note 5.6).

use super::motion::Motion;
use super::updates::knows_age;
use crate::compensator::{CompensatorKind, Discretisation, PadeForm};
use crate::estimate::Positions;
use delay_from_flight::TrackFit;
use nalgebra::Complex;
use record::{BudgetTerm, ErrorBudget, Estimate, Finding};
use std::f64::consts::{PI, TAU};

/// The size of a wander is known if the record lasts this many of its time constants.
const TIME_CONSTANTS: f64 = 10.0;

/// The delay model of a compensator, if known.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum StandIn {
    /// Nothing: raw.
    Nothing,
    Pade(PadeForm),
    Exact,
    /// It adapts to the data: no fixed transfer function.
    Adaptive,
}

impl StandIn {
    pub(crate) fn of(track: &Positions) -> StandIn {
        let pade = |m, n| PadeForm::new(m, n).map_or(StandIn::Adaptive, StandIn::Pade);
        match track.further {
            Some(CompensatorKind::Pade { m, n, .. }) => pade(m, n),
            Some(CompensatorKind::ExactFir | CompensatorKind::ExactAsync | CompensatorKind::OfflineShift) => {
                StandIn::Exact
            }
            Some(CompensatorKind::Kalman | CompensatorKind::RtsSmoother) => StandIn::Adaptive,
            None if track.is_raw() => StandIn::Nothing,
            None if track.name == crate::estimate::EXACT_ASYNC => StandIn::Exact,
            None => pade(1, 1),
        }
    }
}

/// Inputs of the terms; everything in SI, 2-D rms for lengths.
pub(crate) struct Ground<'a> {
    /// Ground speed, rms.
    pub(crate) speed_mps: f64,
    /// Delay set.
    pub(crate) delay_s: f64,
    /// Its standard uncertainty as stated.
    pub(crate) delay_u_s: Option<f64>,
    /// Age of the fix over the rows: mean, and mean of its square.
    pub(crate) age_s: (f64, f64),
    /// Displacement during delay and age predicted from velocity.
    pub(crate) travelled_m: f64,
    /// Raw against the integral of velocity.
    pub(crate) raw_fit: Result<&'a TrackFit, &'a str>,
    pub(crate) motion: Result<&'a Motion, &'a str>,
    /// Lateness of the position less the set delay. (The output itself shows this times the cosine of the turn of the
    /// track in Td, because the missing displacement was flown then and not now.)
    pub(crate) left_s: Option<Estimate>,
    /// Lateness of the velocity itself.
    pub(crate) velocity_delay_s: &'a Finding<Estimate>,
    /// Rows use velocities held at this step, s.
    pub(crate) row_step_s: f64,
}

impl Ground<'_> {
    pub(crate) fn budget(&self, track: &Positions, measured_m: Option<Estimate>) -> ErrorBudget {
        let stand_in = StandIn::of(track);
        let mut terms = vec![];
        match &stand_in {
            StandIn::Nothing => terms.push(self.not_removed()),
            _ => {
                terms.push(self.mismatch());
                terms.push(self.velocity_delay());
                terms.push(self.velocity_bias());
            }
        }
        match &stand_in {
            StandIn::Pade(form) => {
                terms.push(self.truncation(form, track));
                terms.push(self.velocity_noise(form.noise_gain(), track));
            }
            StandIn::Exact if track.further != Some(CompensatorKind::OfflineShift) => {
                terms.push(self.velocity_noise(1.0, track));
            }
            StandIn::Adaptive => {
                let why = "it weights position and velocity by their noise: no formula".to_owned();
                terms.push(term("noise let through", Finding::CannotTell(why), ""));
            }
            StandIn::Nothing | StandIn::Exact => {}
        }
        if matches!(stand_in, StandIn::Pade(_) | StandIn::Exact) {
            terms.push(self.between_samples());
        }
        if stand_in != StandIn::Adaptive {
            terms.push(self.position_noise());
            terms.push(self.position_wander());
        }
        if !track.is_raw() && !knows_age(track) {
            terms.push(self.hold(track));
        }
        let known_m = terms.iter().filter_map(|t| t.size_m.found()).map(|m| m * m).sum::<f64>().sqrt();
        let total_m = terms.iter().all(|t| t.size_m.found().is_some()).then_some(known_m);
        ErrorBudget { terms, total_m, known_m, measured_m }
    }

    /// Residual delay, if this flight shows it.
    fn residual_delay_s(&self) -> Option<Estimate> {
        self.left_s.filter(|r| r.standard_uncertainty.is_some_and(|u| r.value.abs() > 2.0 * u))
    }

    /// The displacement during the delay and the age of the fix. If this flight shows a different delay than the set
    /// one, that delay is used, as in [`Ground::mismatch`].
    fn not_removed(&self) -> BudgetTerm {
        let name = "delay, not removed";
        let set_s = self.delay_s + self.age_s.0;
        match self.residual_delay_s().filter(|_| set_s > 0.0) {
            Some(seen) => term(
                name,
                Finding::Found(self.travelled_m * ((set_s + seen.value) / set_s).abs()),
                "distance flown in Td and the age of the fix, from velocity, in proportion to the lateness of the position, \
                 which differs from the delay set by more than two standard uncertainties",
            ),
            None => term(
                name,
                Finding::Found(self.travelled_m),
                "distance flown in Td and the age of the fix, from velocity",
            ),
        }
    }

    /// Speed × δTd: as measured in this flight if available, else as stated by the source of Td.
    fn mismatch(&self) -> BudgetTerm {
        let name = "delay set wrongly, speed × δTd";
        let own_u = self.left_s.and_then(|r| r.standard_uncertainty);
        match (self.residual_delay_s(), self.delay_u_s, own_u) {
            (Some(seen), _, _) => term(
                name,
                Finding::Found(self.speed_mps * seen.value.abs()),
                "U times the lateness of the position minus the delay set, which differ by more than two standard \
                 uncertainties",
            ),
            (None, Some(stated), Some(own)) if own < stated => term(name, Finding::Found(self.speed_mps * own), OWN),
            (None, Some(stated), _) => {
                term(name, Finding::Found(self.speed_mps * stated), "U times the standard uncertainty of Td as stated")
            }
            (None, None, Some(own)) => term(name, Finding::Found(self.speed_mps * own), OWN),
            (None, None, None) => {
                let why = "no uncertainty of Td is stated, and this flight does not show the remaining delay";
                term(name, Finding::CannotTell(why.to_owned()), "")
            }
        }
    }

    /// `a·Td·Tv`: to first order a late velocity costs nothing if the delay is set to the position's own (delay
    /// network, section 1); the displacement during Td is evaluated `Tv` too early.
    fn velocity_delay(&self) -> BudgetTerm {
        let name = "delay of the velocity itself, a·Td·Tv";
        let late_s = match self.velocity_delay_s {
            Finding::Found(tv) => tv,
            Finding::CannotTell(why) => return term(name, Finding::CannotTell(why.clone()), ""),
        };
        let seen = late_s.standard_uncertainty.is_some_and(|u| late_s.value.abs() > 2.0 * u);
        let (size_s, source) = match late_s.standard_uncertainty.filter(|_| !seen) {
            Some(u) => (
                u,
                "Td times the rms acceleration times the standard uncertainty of Tv, which does not differ \
                 significantly from zero",
            ),
            None => (late_s.value.abs(), "Td times the rms acceleration times the lateness of the velocity"),
        };
        let size = |motion: &Motion| self.delay_s * size_s * motion.weighted(|hz| (TAU * hz).powi(2)).sqrt();
        self.of_motion(name, size, source)
    }

    fn velocity_bias(&self) -> BudgetTerm {
        let size = |fit: &TrackFit| self.delay_s * fit.drift[0].0.hypot(fit.drift[1].0);
        let source = "Td times the drift of the fixes against the integrated velocity";
        match self.raw_fit {
            Ok(fit) => term("bias of the velocity, Td·b", Finding::Found(size(fit)), source),
            Err(why) => {
                term("bias of the velocity, Td·b", Finding::CannotTell(format!("velocity bias not known: {why}")), "")
            }
        }
    }

    /// `√Σ S_v(f)/ω² |e^{−jωTd} − R(jωTd)|²` over the motion of this flight.
    fn truncation(&self, form: &PadeForm, track: &Positions) -> BudgetTerm {
        let (m, n) = form.degrees();
        let left = Left::of(form, track, self.row_step_s);
        let size = |motion: &Motion| motion.weighted(|hz| (left.at(hz).norm() / (TAU * hz)).powi(2)).sqrt();
        let source = "spectrum of this flight's velocity less its noise, times |e^(−jωTd) − R|/ω";
        self.of_motion(&format!("truncation of [{m}/{n}]"), size, source)
    }

    /// The delay that truncation resembles in the motion of this flight, s: the δ for which `jωδ` is closest to the
    /// residual, by power. Zero for raw and the exact forms.
    pub(crate) fn truncation_delay_s(&self, track: &Positions) -> f64 {
        match (StandIn::of(track), self.motion) {
            (StandIn::Pade(form), Ok(motion)) => {
                let left = Left::of(&form, track, self.row_step_s);
                let power = motion.weighted(|_| 1.0);
                // Early or late: the sum may have either sign.
                let [late, early] = [-1.0, 1.0].map(|sign| motion.weighted(|hz| sign * left.at(hz).im / (TAU * hz)));
                if power > 0.0 { (late - early) / power } else { 0.0 }
            }
            _ => 0.0,
        }
    }

    /// `√(T·g·S_v)` over both axes, where T is the integration time of the velocity.
    fn velocity_noise(&self, gain: f64, track: &Positions) -> BudgetTerm {
        let over_s = track.delay.seconds() * gain + if knows_age(track) { self.age_s.0 } else { 0.0 };
        let size = |motion: &Motion| {
            let [north, east] = motion.noise_density();
            (0.5 * over_s * (north + east)).sqrt()
        };
        let source = "√(T·S_v): T the time that velocity is integrated over, S_v the floor of its spectrum (two-sided)";
        self.of_motion("noise of the velocity", size, source)
    }

    /// `T h²/12 · rms |v″|`.
    fn between_samples(&self) -> BudgetTerm {
        let over_s = self.delay_s + self.age_s.0;
        let size = |motion: &Motion| over_s * motion.step_s().powi(2) / 12.0 * motion.bend2().sqrt();
        let source =
            "T h²/12 times the rms of the velocity's second derivative: what a straight line between samples misses";
        self.of_motion("velocity between its samples", size, source)
    }

    fn of_motion(&self, name: &str, size: impl Fn(&Motion) -> f64, source: &str) -> BudgetTerm {
        match self.motion {
            Ok(motion) => term(name, Finding::Found(size(motion)), source),
            Err(why) => term(name, Finding::CannotTell(why.to_owned()), source),
        }
    }

    /// White noise of the fixes.
    fn position_noise(&self) -> BudgetTerm {
        let name = "white noise of the position";
        let source = "white scatter of the fixes about the integrated velocity; passes with gain 1";
        let size = |fit: &TrackFit| Finding::Found(fit.noise[0].white_std.hypot(fit.noise[1].white_std));
        term(name, self.raw_fit.map_or_else(|why| Finding::CannotTell(format!("not known: {why}")), size), source)
    }

    /// Wander of the fixes, unless the velocity's own noise explains it or its origin is unknown.
    fn position_wander(&self) -> BudgetTerm {
        let name = "wander of the position";
        let source = "slow scatter of the fixes about the integrated velocity, less what the white noise of the velocity \
                      explains; passes with gain 1";
        let fit = match self.raw_fit {
            Ok(fit) => fit,
            Err(why) => return term(name, Finding::CannotTell(format!("not known: {why}")), source),
        };
        let density = self.motion.map_or([0.0; 2], Motion::noise_density);
        let own = (0..2).map(|k| (fit.noise[k], density[k])).filter(|(m, density)| {
            // Twice the variance over the time constant is the rate of a random walk; integrated white noise has S_v.
            2.0 * m.wander_std * m.wander_std / m.time_constant_s > 4.0 * 0.5 * density
        });
        let slow = own.clone().find(|(m, _)| m.time_constant_s * TIME_CONSTANTS > fit.span_s);
        let size = match slow {
            Some((m, _)) => Finding::CannotTell(format!(
                "the fixes wander against the integrated velocity over {:.0} s in a record of {:.0} s: whether \
                 position or velocity wanders is unknown",
                m.time_constant_s, fit.span_s
            )),
            None => Finding::Found(own.map(|(m, _)| m.wander_std * m.wander_std).sum::<f64>().sqrt()),
        };
        term(name, size, source)
    }

    /// U·rms(age), less the mean age that is included in the compensator's delay.
    fn hold(&self, track: &Positions) -> BudgetTerm {
        let included_s = track.delay.seconds() - self.delay_s;
        let left2 = self.age_s.1 - 2.0 * included_s * self.age_s.0 + included_s * included_s;
        let source = "U times the rms of the age of the held fix, which the compensator does not know";
        term("position held between fixes", Finding::Found(self.speed_mps * left2.max(0.0).sqrt()), source)
    }
}

/// Error of a Padé filter, as a share of the amplitude of a motion: `e^{−jωTd} + jω G − 1`.
struct Left<'a> {
    form: &'a PadeForm,
    delay_s: f64,
    /// Tustin at step h sees ω as 2/h·tan(ωh/2); `None` for other rules, which are treated as continuous.
    tustin_step_s: Option<f64>,
}

impl<'a> Left<'a> {
    fn of(form: &'a PadeForm, track: &Positions, step_s: f64) -> Left<'a> {
        let tustin = match track.further {
            None => true,
            Some(CompensatorKind::Pade { rule, .. }) => rule == Discretisation::Tustin,
            Some(_) => false,
        };
        Left { form, delay_s: track.delay.seconds(), tustin_step_s: tustin.then_some(step_s) }
    }

    fn at(&self, hz: f64) -> Complex<f64> {
        let warped = match self.tustin_step_s {
            Some(h) if hz * h < 0.45 => (PI * hz * h).tan() / (PI * h),
            _ => hz,
        };
        let one = Complex::new(1.0, 0.0);
        let late = Complex::from_polar(1.0, -TAU * hz * self.delay_s);
        late + (one - self.form.delay_at(warped * self.delay_s)) * (hz / warped) - one
    }
}

const OWN: &str = "U times the standard uncertainty of the lateness of the position, which agrees with the delay set";

fn term(name: &str, size_m: Finding<f64>, source: &str) -> BudgetTerm {
    BudgetTerm { name: name.to_owned(), size_m, source: source.to_owned() }
}
