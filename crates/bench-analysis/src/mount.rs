//! The mounting of the sensor on the bar: compares the record with the rig file (design note 1.6).

mod accelerometer;
mod circle;
mod gyro;

use crate::alignment::{Alignment, Clue, estimate};
use crate::flexibility::{Bar, bar_of, stated_mode_check};
use crate::kinematics::{BarState, wrapped};
use crate::magnetometer::{MagneticSwing, calibrate_magnetometer};
use crate::rig::Rig;
use crate::surroundings::Surroundings;
use flight::{Code, Notices, Quantity};
use record::{ChannelDynamics, ENCODER_SIGN, Estimate, Finding, Flexibility, MountCheck, MountFinding, SIDE_OF_PIVOT};
use std::f64::consts::TAU;

/// Tolerance for angles of zero and azimuth in addition to their uncertainties (1°).
const ANGLE_TOLERANCE_RAD: f64 = 0.0175;
/// Relative tolerance for lengths.
const LENGTH_TOLERANCE: f64 = 0.01;
/// Tolerance for lever arms, m.
const ARM_TOLERANCE_M: f64 = 0.005;
/// Relative tolerance for scales.
const SCALE_TOLERANCE: f64 = 0.01;
/// Misalignment that is not reported (1°).
const MISALIGNMENT_TOLERANCE_RAD: f64 = 0.0175;

/// What checks of the azimuth are named after.
const AZIMUTH: &str = "azimuth";
/// Angles that differ by less are shown on the same turn, rad.
const NEAR_RAD: f64 = 0.5;
/// Source of an angle stated in the rig file.
const STATED: &str = "rig file";
/// A bending bar makes its tip swing further than its length, by less than this share at hand speeds.
const BENDING: f64 = 0.05;

/// No gyro or attitude has a scale that is wrong by more than this: the encoder's is. Where translation is raised too,
/// the tolerance is that of a scale.
const ENCODER_TOLERANCE: f64 = 0.05;
/// Unit of a number of counts.
const COUNTS: &str = "counts";
/// Text of checks that a bending bar explains.
const RAISED: &str = "a bar that bends raises it too";

/// Input of the checks.
struct Inputs<'a> {
    /// The rig file states a first mode, or the gains show one.
    bends: bool,
    /// Rotation and translation are raised, but not as by a bar that bends.
    is_scaled: bool,
    /// From the rig file.
    counts_per_rev: Option<f64>,
    around: &'a Surroundings,
    alignment: &'a Alignment,
}

/// Compares mount, lever arms, biases and scales with the rig file, and calibrates the magnetometer on its `swings`.
/// `channels` states which of them are slow by themselves, `flexibility` whether the bar bends.
#[must_use]
pub fn mount_finding(
    rig: &Rig,
    around: &Surroundings,
    alignment: &Alignment,
    swings: &[MagneticSwing],
    channels: &[ChannelDynamics],
    flexibility: &Finding<Flexibility>,
) -> (MountFinding, Notices) {
    let bar = bar_of(flexibility);
    let inputs = Inputs {
        bends: bar == Bar::Bends || (bar == Bar::NotSeen && rig.bar.first_mode_hz.is_some()),
        is_scaled: bar == Bar::Scaled,
        counts_per_rev: rig.encoder.counts_per_rev,
        around,
        alignment,
    };
    let detected = detected(&inputs);
    let mut checks: Vec<MountCheck> = alignment.clues.iter().filter_map(|clue| inputs.counts_check(clue)).collect();
    checks.extend(angle_checks(&inputs));
    for clue in &alignment.clues {
        checks.extend(inputs.checks(clue));
    }
    ask_for_witnesses(&mut checks);
    checks.extend(stated_mode_check(flexibility));
    let fastest = alignment.clues.iter().map(|clue| pace(&clue.fit.states)).fold(0.0, f64::max);
    let own: Vec<&str> = channels.iter().filter(|c| is_own_effect(c, fastest)).map(|c| c.name.as_str()).collect();
    for check in checks.iter_mut().filter(|check| own.iter().any(|name| check.name.ends_with(name))) {
        check.of_rig = false;
        if check.agrees == Some(false) {
            check.agrees = None;
            check.text += "; not compared: this channel lags, or its delay was not measured";
        }
    }
    let found_s = |name: &str| Some(channels.iter().find(|c| c.name == name)?.delay.as_ref()?.delay.seconds());
    let at_other_part =
        |c: &&Clue| found_s(&c.name).is_some_and(|found_s| is_misaligned(found_s, c.delay_s, pace(&c.fit.states)));
    let misaligned: Vec<&str> = alignment.clues.iter().filter(at_other_part).map(|c| c.name.as_str()).collect();
    for check in checks.iter_mut().filter(|check| misaligned.iter().any(|name| check.name.ends_with(name))) {
        check.of_rig = false;
        check.agrees = None;
        check.text += "; not compared: it was aligned with another part of the swing than its delay shows";
    }
    if inputs.bends {
        checks.iter_mut().for_each(excuse_what_bending_explains);
    }
    excuse_what_counts_explain(&mut checks);
    excuse_what_angles_explain(&mut checks, &alignment.notices);
    let finding = MountFinding {
        detected: detected.map_or_else(
            || {
                let text = "neither accelerometer nor vertical position or velocity shows on which side of the pivot the sensor is";
                Finding::CannotTell(text.to_owned())
            },
            |side| Finding::Found(side.in_words()),
        ),
        stated: rig.bar.mount.to_string(),
        checks,
        magnetometer: calibrate_magnetometer(swings, around),
    };
    let notices = warnings(&finding, detected, rig);
    (finding, notices)
}

fn excuse_what_bending_explains(check: &mut MountCheck) {
    let excess = check.fitted.found().zip(check.stated).map(|(fitted, stated)| fitted.value / stated - 1.0);
    let is_raised = check.text.contains(RAISED) && excess.is_some_and(|e| e > 0.0 && e <= BENDING);
    if is_raised && check.agrees == Some(false) && !check.of_rig {
        check.agrees = None;
        check.text = check.text.replace(RAISED, "the bar, which bends, explains it");
    }
}

/// Wrong counts per revolution scale every angle, and so every length.
fn excuse_what_counts_explain(checks: &mut [MountCheck]) {
    let ratio = |c: &MountCheck| Some(c.fitted.found()?.value / c.stated?);
    let is_wrong = |c: &&MountCheck| c.unit == COUNTS && c.agrees == Some(false);
    let Some(counts) = checks.iter().find(is_wrong).and_then(ratio) else { return };
    for check in checks.iter_mut().filter(|c| c.unit == "m" && c.agrees == Some(false)) {
        if ratio(check).is_some_and(|length| (length * counts - 1.0).abs() < LENGTH_TOLERANCE) {
            check.of_rig = false;
            check.text += "; the counts per revolution explain it";
        }
    }
}

/// A wrong sign or number of counts changes all angles and lengths. A wrong azimuth changes the zero by position and
/// velocity, and a wrong zero their azimuth. Only the cause is to be corrected.
fn excuse_what_angles_explain(checks: &mut [MountCheck], notices: &Notices) {
    let is_sign_wrong = notices.iter().any(|n| n.code == Code::RigContradicted && n.place == ENCODER_SIGN);
    let are_counts_wrong = checks.iter().any(|c| c.unit == COUNTS && c.contradicts_rig());
    let is_azimuth_wrong = checks.iter().any(|c| c.name.starts_with(AZIMUTH) && c.contradicts_rig());
    // Attitude and specific force show the zero whatever the azimuth is.
    let by_body = ["encoder zero by attitude", "encoder zero by specific-force"];
    let is_any_of = |check: &MountCheck, names: &[&str]| names.iter().any(|name| check.name.starts_with(name));
    let is_zero_wrong = checks.iter().any(|c| is_any_of(c, &by_body) && c.contradicts_rig());
    for check in checks.iter_mut().filter(|c| c.contradicts_rig() && c.unit != COUNTS) {
        let cause = match (is_sign_wrong, are_counts_wrong) {
            (true, _) => "encoder's sign",
            (false, true) => "number of counts",
            _ if is_zero_wrong && is_any_of(check, &["azimuth by position", "azimuth by velocity"]) => "zero",
            _ if is_zero_wrong => continue,
            _ if is_azimuth_wrong && is_any_of(check, &["encoder zero by position", "encoder zero by velocity"]) => {
                "azimuth"
            }
            _ => continue,
        };
        check.of_rig = false;
        check.text += &format!("; it may follow from the wrong {cause}");
    }
}

/// A lag of this many radians of the swing shrinks it by 0.3 %. A shorter one excuses no deviation: a lever arm across
/// the bar makes an accelerometer look as if it had a lag of some milliseconds.
const LAG_MATTERS_RAD: f64 = 0.08;

/// Whether a deviation from the rig file is the channel's own: it was not measurable, or its lag shrinks its swing of
/// this angular frequency.
fn is_own_effect(channel: &ChannelDynamics, pace: f64) -> bool {
    let matters = |lags: &[Estimate]| lags.iter().map(|lag| lag.value).sum::<f64>() * pace > LAG_MATTERS_RAD;
    channel.delay.is_none() || channel.lags().is_some_and(|(_, lags)| matters(lags))
}

/// A channel aligned with the swing at this phase from its delay, rad, is aligned with another part of it.
const MISALIGNED_RAD: f64 = 0.5;

/// Whether the coarse delay, at which the mount was fitted, is not that of the channel. A swing repeats: half a period
/// later all signs are reversed.
fn is_misaligned(found_s: f64, coarse_s: f64, pace: f64) -> bool {
    (found_s - coarse_s).abs() * pace > MISALIGNED_RAD
}

/// Angular frequency of the swing, rad/s: rms of its acceleration over that of its rate.
fn pace(states: &[BarState]) -> f64 {
    let (rates, accelerations) =
        states.iter().fold((0.0, 0.0), |(r, a), s| (r + s.rate.powi(2), a + s.acceleration.powi(2)));
    if rates > 0.0 { f64::sqrt(accelerations / rates) } else { 0.0 }
}

impl Inputs<'_> {
    /// A length against the rig file's, whole length `of_m`. A difference explained by bending is no contradiction.
    fn length_check(
        &self,
        name: String,
        fitted: Estimate,
        stated: f64,
        of_m: f64,
        (tolerance, text): (f64, String),
    ) -> MountCheck {
        let bent = if self.bends { BENDING * of_m } else { 0.0 };
        let of_rig = (fitted.value - stated).abs() > 3.0 * u(&fitted) + tolerance + bent;
        MountCheck { of_rig, ..check(name, "m", fitted, Some(stated), tolerance, text) }
    }

    /// Counts per revolution according to a gyro or an attitude.
    fn counts_check(&self, clue: &Clue) -> Option<MountCheck> {
        let component = match clue.quantity {
            Quantity::AngularRate => 1,
            Quantity::Attitude => 0,
            _ => return None,
        };
        let fit = clue.regression(component)?;
        let scale = fit.coefficients.get(1)?.abs();
        let stated = self.counts_per_rev.filter(|_| scale > 0.0)?;
        let counts = stated / scale;
        let fitted = estimate(counts, counts * fit.standard_uncertainty(1) / scale);
        let tolerance = match (self.is_scaled, self.bends) {
            (true, _) => SCALE_TOLERANCE,
            (false, true) => ENCODER_TOLERANCE + BENDING,
            (false, false) => ENCODER_TOLERANCE,
        };
        let text = "from its scale; a wrong number of lines or a wrong decoding changes it by a factor".to_owned();
        let name = format!("counts per revolution by {}", clue.name);
        Some(check(name, COUNTS, fitted, Some(stated), tolerance * stated, text))
    }

    fn checks(&self, clue: &Clue) -> Vec<MountCheck> {
        match clue.quantity {
            Quantity::SpecificForce => accelerometer::checks(self, clue),
            Quantity::AngularRate => gyro::checks(self, clue),
            Quantity::PositionGeodetic | Quantity::PositionNed | Quantity::VelocityNed | Quantity::Height => {
                circle::checks(self, clue)
            }
            _ => vec![],
        }
    }
}

/// Position and orientation of the sensor in the middle of the swing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Side {
    below: bool,
    /// Only an accelerometer shows this.
    upside_down: Option<bool>,
}

impl Side {
    fn in_words(self) -> String {
        let side = if self.below { "hanging" } else { "upright" };
        match self.upside_down {
            Some(true) => format!("{side}, sensor upside down"),
            _ => side.to_owned(),
        }
    }
}

fn detected(inputs: &Inputs<'_>) -> Option<Side> {
    let by_force = inputs.alignment.clues.iter().find_map(|c| accelerometer::side(inputs, c));
    by_force.or_else(|| inputs.alignment.clues.iter().find_map(|c| circle::side(inputs, c)))
}

/// A bar on the opposite side of the pivot than its lever arm states makes every gain negative.
fn warnings(finding: &MountFinding, detected: Option<Side>, rig: &Rig) -> Notices {
    let mut notices = Notices::new();
    let wrong = finding.checks.iter().filter(|c| c.contradicts_rig());
    let names: Vec<&str> = wrong.map(|c| c.name.as_str()).collect();
    if !names.is_empty() {
        let text = format!("record and rig file disagree on {}", names.join(", "));
        notices.push(Code::RigContradicted, "mount", names.len() as u64, text);
    }
    // Without an accelerometer the side is that of the vertical position or velocity.
    let upright_side = detected.filter(|s| s.upside_down != Some(true));
    let hangs = rig.bar.mount == crate::rig::MountKind::Hanging;
    if let Some(side) = upright_side.filter(|s| rig.bar.mount != crate::rig::MountKind::Custom && s.below != hangs) {
        let text =
            format!("the record shows a bar that is {}, but the rig file says {}", side.in_words(), rig.bar.mount);
        notices.push(Code::RigContradicted, SIDE_OF_PIVOT, 1, text);
    }
    notices
}

/// Zero and azimuth from each channel, compared with those in use.
fn angle_checks(inputs: &Inputs<'_>) -> Vec<MountCheck> {
    let alignment = inputs.alignment;
    let zeros = alignment.zeros.iter().map(|(channel, found)| {
        angle_check(format!("encoder zero by {channel}"), *found, alignment.zero_rad, &alignment.zero_source)
    });
    let azimuths = alignment.azimuths.iter().filter_map(|(channel, found)| {
        let used = alignment.azimuth_rad?;
        Some(angle_check(format!("{AZIMUTH} by {channel}"), *found, used, &alignment.azimuth_source))
    });
    // A barometer is slow: its deviation is its own.
    let is_slow =
        |name: &str| alignment.clues.iter().any(|c| c.quantity == Quantity::Height && name.ends_with(&c.name));
    zeros.chain(azimuths).map(|check| MountCheck { of_rig: check.of_rig && !is_slow(&check.name), ..check }).collect()
}

fn angle_check(name: String, found: Estimate, used: Estimate, source: &str) -> MountCheck {
    // Azimuths from 0 to 360°, zeros from −180 to 180°; near the value in use on its turn, so that 359.9° and 0.1° are
    // −0.1° and 0.1°.
    let difference = wrapped(found.value - used.value);
    let is_azimuth = name.starts_with(AZIMUTH);
    let stated = if is_azimuth { used.value.rem_euclid(TAU) } else { used.value };
    let near = stated + difference;
    let turned = if is_azimuth { near.rem_euclid(TAU) } else { wrapped(near) };
    let value = Estimate { value: if difference.abs() < NEAR_RAD { near } else { turned }, ..found };
    let agrees =
        difference.abs() <= 3.0 * u(&found).hypot(used.standard_uncertainty.unwrap_or(0.0)) + ANGLE_TOLERANCE_RAD;
    let of_rig = source == STATED;
    // The most certain channel is not compared with itself.
    let is_in_use = !of_rig && found.value == used.value;
    let text = match is_in_use {
        true => format!("in use: {source}"),
        false => format!("{}° away from the one in use ({source})", flight::fixed(difference.to_degrees(), 2)),
    };
    MountCheck {
        name,
        unit: "rad".to_owned(),
        text,
        fitted: Finding::Found(value),
        stated: Some(stated).filter(|_| !is_in_use),
        agrees: Some(agrees).filter(|_| !is_in_use),
        of_rig,
    }
}

/// The radius of a channel's circle is the bar's length times the channel's gain, and a lag or clipping reduces it: a
/// short one contradicts the rig file only if another channel shows the same length.
fn ask_for_witnesses(checks: &mut [MountCheck]) {
    let ratio = |c: &MountCheck| {
        let differs = c.unit == "m" && c.agrees == Some(false);
        let (stated, fitted) = (c.stated.filter(|_| differs)?, c.fitted.found()?);
        Some(Estimate { value: fitted.value / stated, standard_uncertainty: Some(u(fitted) / stated) })
    };
    let ratios: Vec<Option<Estimate>> = checks.iter().map(ratio).collect();
    for (k, check) in checks.iter_mut().enumerate() {
        let Some(own) = ratios[k].filter(|_| check.name.starts_with(circle::NAME)) else { continue };
        let is_alike =
            |other: &Estimate| (other.value - own.value).abs() <= 3.0 * u(other).hypot(u(&own)) + LENGTH_TOLERANCE;
        let is_short = own.value < 1.0;
        let others = ratios.iter().enumerate().filter(|(other, _)| *other != k).filter_map(|(_, ratio)| ratio.as_ref());
        if is_short && check.of_rig && !others.into_iter().any(is_alike) {
            check.of_rig = false;
            check.text +=
                ". No other channel shows this length: the cause is this channel's gain or lag, or the bar's length";
        }
    }
}

fn u(e: &Estimate) -> f64 {
    e.standard_uncertainty.unwrap_or(0.0)
}

/// A fitted number compared with the rig file.
fn check(name: String, unit: &str, fitted: Estimate, stated: Option<f64>, tolerance: f64, text: String) -> MountCheck {
    let agrees = stated.map(|s| (fitted.value - s).abs() <= 3.0 * u(&fitted) + tolerance);
    MountCheck { name, unit: unit.to_owned(), fitted: Finding::Found(fitted), stated, agrees, of_rig: true, text }
}

/// A scale compared with one: a difference is the sensor's, not the rig's.
fn scale_check(name: String, fitted: Estimate, text: String) -> MountCheck {
    MountCheck { of_rig: false, ..check(name, "1", fitted, Some(1.0), SCALE_TOLERANCE, text) }
}

/// An unknown quantity, and why it is unknown.
fn unknown(name: String, unit: &str, why: &str) -> MountCheck {
    MountCheck {
        name,
        unit: unit.to_owned(),
        fitted: Finding::CannotTell(why.to_owned()),
        stated: None,
        agrees: None,
        of_rig: false,
        text: String::new(),
    }
}

/// One coefficient of a regression as an estimate.
fn coefficient(fit: &signal::Regression, k: usize) -> Estimate {
    estimate(fit.coefficients.get(k).copied().unwrap_or(0.0), fit.standard_uncertainty(k))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Which of these lengths, for a stated 1.3 m, contradict the rig file.
    fn contradict<const N: usize>(found: [(&str, f64); N]) -> [bool; N] {
        let of = |(name, length): (&str, f64)| {
            let fitted = Estimate { value: length, standard_uncertainty: Some(0.003) };
            check(name.to_owned(), "m", fitted, Some(1.3), 0.013, String::new())
        };
        let mut checks = found.map(of);
        ask_for_witnesses(&mut checks);
        checks.map(|c| c.of_rig && c.agrees == Some(false))
    }

    /// Former bug: 50 mm across the bar made an accelerometer look 7 ms lagged, and that lag hid the 50 mm.
    #[test]
    fn only_a_lag_that_shrinks_the_swing_excuses_a_deviation() {
        use crate::card::example::{channel, model};
        let with = |lag_s: f64| ChannelDynamics { model: model("L", &[lag_s]), ..channel("imu", 0.007, 1e-4) };
        let at = |rate: f64| BarState { angle: 0.0, rate, acceleration: 4.0 * rate, jerk: 0.0 };
        let rate = pace(&[at(0.5), at(-1.0)]);
        assert!((rate - 4.0).abs() < 1e-12);
        assert!(!is_own_effect(&with(0.007), rate) && is_own_effect(&with(0.11), rate));
    }

    /// Former bug: a barometer aligned half a period of its height off showed the encoder's zero 180° off, and every delay
    /// of the record was in doubt.
    #[test]
    fn a_channel_aligned_half_a_period_off_does_not_accuse_the_encoder() {
        // A swing of 0.41 Hz raises and lowers the sensor at 0.82 Hz.
        let (pace, half_period_s) = (TAU * 0.41, 0.5 / 0.82);
        assert!(is_misaligned(0.13, 0.13 + half_period_s, pace) && is_misaligned(0.13, 0.13 - half_period_s, pace));
        // The coarse delay of a lag differs from that of the fit.
        assert!(!is_misaligned(0.12, 0.147, pace));
    }

    #[test]
    fn a_short_circle_of_a_single_channel_is_its_gain_or_lag() {
        let (position, velocity) = ("distance from the axis by position", "distance from the axis by velocity");
        assert_eq!(contradict([(velocity, 1.25)]), [false]);
        assert_eq!(contradict([(velocity, 1.25), (position, 1.3), ("lever arm z", 1.3)]), [false; 3]);
        assert_eq!(contradict([(velocity, 1.25), (position, 1.1)]), [false; 2], "two lags");
        // The bar is 5 cm shorter than the rig file says.
        assert_eq!(contradict([(velocity, 1.25), (position, 1.252)]), [true; 2]);
        assert_eq!(contradict([(velocity, 1.25), ("lever arm z", 1.248)]), [true; 2]);
        // A lag does not make a circle larger.
        assert_eq!(contradict([(velocity, 1.35)]), [true]);
    }

    #[test]
    fn an_azimuth_is_quoted_as_the_rig_file_states_it() {
        let degrees = |found: f64, used: f64, name: &str| {
            let of =
                |degrees: f64| Estimate { value: wrapped(degrees.to_radians()), standard_uncertainty: Some(0.001) };
            let check = angle_check(format!("{name} by position.gps"), of(found), of(used), STATED);
            let fitted = check.fitted.found().unwrap().value;
            [fitted, check.stated.unwrap()].map(|angle| (10.0 * angle.to_degrees()).round() / 10.0)
        };
        assert_eq!(degrees(30.0, 210.0, AZIMUTH), [30.0, 210.0]);
        assert_eq!(degrees(359.0, 1.0, AZIMUTH), [-1.0, 1.0], "neighbours");
        assert_eq!(degrees(308.0, 300.0, AZIMUTH), [308.0, 300.0]);
        assert_eq!(degrees(0.0, 180.0, "encoder zero")[0].abs(), 0.0);
        assert_eq!(degrees(-179.0, 179.0, "encoder zero"), [181.0, 179.0], "neighbours");
    }

    /// Which of these checks still accuse the rig file, all of them differing from it.
    fn accused<const N: usize>(names: [&str; N], sign_is_wrong: bool) -> Vec<&str> {
        let mut notices = Notices::new();
        if sign_is_wrong {
            notices.push(Code::RigContradicted, ENCODER_SIGN, 1, "the other way round");
        }
        let mut checks = names.map(|name| {
            let unit = if name.starts_with("counts") { COUNTS } else { "rad" };
            let fitted = Estimate { value: 2.0, standard_uncertainty: Some(0.01) };
            check(name.to_owned(), unit, fitted, Some(1.0), 0.01, String::new())
        });
        excuse_what_angles_explain(&mut checks, &notices);
        names.into_iter().zip(&checks).filter(|(_, c)| c.contradicts_rig()).map(|(name, _)| name).collect()
    }

    #[test]
    fn only_the_cause_accuses_the_rig_file() {
        let (zero, azimuth) = ("encoder zero by position.gps", "azimuth by position.gps");
        let (body_zero, body_azimuth) = ("encoder zero by attitude.ins", "azimuth by attitude.ins");
        assert_eq!(accused([zero, azimuth, "lever arm z of imu"], true), [""; 0], "the sign");
        let counts = "counts per revolution by imu";
        assert_eq!(accused([counts, zero, "lever arm z of imu"], false), [counts]);
        assert_eq!(accused([zero, azimuth, body_azimuth], false), [azimuth, body_azimuth]);
        assert_eq!(accused([zero, azimuth, body_zero], false), [zero, body_zero]);
        assert_eq!(
            accused([zero, "lever arm z of imu"], false),
            [zero, "lever arm z of imu"],
            "nothing explains these"
        );
    }
}
