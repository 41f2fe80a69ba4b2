//! Checks whether the bar bends, and at which natural frequency (design note 1.6).

use crate::alignment::estimate;
use flight::with_minus;
use record::{Estimate, Finding, Flexibility, MountCheck};

/// Modal factor Γ of tip deflection against root rotation, for any tip mass from zero up: 1.1377 to 1.
const GAMMA: (f64, f64) = (1.0, 1.1377);
/// Slope factor κ over the same range: 1.3765 to 1.5.
const KAPPA: (f64, f64) = (1.3765, 1.5);
/// Number of standard uncertainties by which a gain must differ from one to indicate bending.
const CLEAR: f64 = 3.0;
/// Share of the excess of a gain by which it may differ from that of the stated first mode: 10 % of that frequency.
const MODE_TOLERANCE: f64 = 0.2;

/// Response of a bar that bends in its first mode, `1 + Γ r²/(1 − r² + 2iζr)` with `r = f/f_n`: magnitude and argument
/// (rad). Γ is for translation of the tip, κΓ for its rotation.
#[must_use]
pub fn bending_response(frequency_hz: f64, first_mode_hz: f64, damping: f64, gamma: f64) -> (f64, f64) {
    let r = frequency_hz / first_mode_hz;
    let (real, imaginary) = (1.0 - r * r, 2.0 * damping * r);
    let size2 = real * real + imaginary * imaginary;
    let (re, im) = (1.0 + gamma * r * r * real / size2, -gamma * r * r * imaginary / size2);
    (re.hypot(im), im.atan2(re))
}

/// The first mode that explains a gain above one at `frequency_hz`, well below resonance: `1 + Γ r²/(1 − r²)`. `None`
/// for gains of one or less.
#[must_use]
pub fn first_mode_of_gain(gain: f64, gamma: f64, frequency_hz: f64) -> Option<f64> {
    let x = (gain - 1.0) / gamma;
    (x > 0.0).then(|| frequency_hz * ((1.0 + x) / x).sqrt())
}

/// A gain, and the frequency of the motion that it stands for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GainAt {
    /// Measured divided by reference.
    pub gain: Estimate,
    /// Hz; above zero.
    pub frequency_hz: f64,
}

/// Compares the gains of channels that translate with the tip (position, velocity, height) with those that rotate with
/// it (attitude, rate). Bending grows with the square of frequency, so all are converted to one frequency first: that
/// of the most certain rotation.
#[must_use]
pub fn flexibility(translation: &[GainAt], rotation: &[GainAt], expected_hz: Option<f64>) -> Finding<Flexibility> {
    let most_certain = rotation.iter().min_by(|a, b| u(&a.gain).total_cmp(&u(&b.gain)));
    let frequency_hz = most_certain.map_or(0.0, |g| g.frequency_hz);
    let mean = |gains: &[GainAt]| weighted_mean(&gains.iter().map(|g| g.at(frequency_hz)).collect::<Vec<_>>());
    let (Some(p), Some(r)) = (mean(translation), mean(rotation)) else {
        let text = "bending shows only in the gain of position or velocity together with the gain of attitude or rate; \
                    one of the two is missing";
        return Finding::CannotTell(text.to_owned());
    };
    let ratio = ratio(p, r);
    let first_mode_hz = first_mode(p, r, &ratio, frequency_hz);
    let gains = format!(
        "At {frequency_hz:.2} Hz the gain of translation is {}, of rotation {} (k = 2)",
        with_u(&p, 4),
        with_u(&r, 4)
    );
    let text = in_words(&gains, &ratio, &first_mode_hz, expected_hz);
    Finding::Found(Flexibility {
        frequency_hz: Some(frequency_hz),
        translation_gain: p,
        rotation_gain: r,
        ratio,
        first_mode_hz,
        expected_hz,
        text,
    })
}

impl GainAt {
    /// The gain at another frequency, below resonance: its excess over one grows with the square.
    fn at(&self, frequency_hz: f64) -> Estimate {
        let factor = (frequency_hz / self.frequency_hz).powi(2);
        estimate(1.0 + factor * (self.gain.value - 1.0), factor * u(&self.gain))
    }
}

fn u(e: &Estimate) -> f64 {
    e.standard_uncertainty.unwrap_or(f64::INFINITY)
}

/// `value ± U`, U with k = 2.
fn with_u(e: &Estimate, decimals: usize) -> String {
    with_minus(&format!("{:.decimals$} ± {:.decimals$}", e.value, 2.0 * u(e)))
}

/// Inverse-variance mean; its uncertainty is widened (Birge) if the values scatter more than stated.
pub(crate) fn weighted_mean(values: &[Estimate]) -> Option<Estimate> {
    let usable: Vec<(f64, f64)> =
        values.iter().filter(|g| u(g).is_finite() && u(g) > 0.0).map(|g| (g.value, u(g).powi(-2))).collect();
    let weight: f64 = usable.iter().map(|(_, w)| w).sum();
    if usable.is_empty() {
        return None;
    }
    let mean = usable.iter().map(|(v, w)| v * w).sum::<f64>() / weight;
    let chi2: f64 = usable.iter().map(|(v, w)| w * (v - mean).powi(2)).sum();
    let birge = if usable.len() > 1 { (chi2 / (usable.len() - 1) as f64).sqrt().max(1.0) } else { 1.0 };
    Some(estimate(mean, birge / weight.sqrt()))
}

/// The first mode that the rig file states against the gain of rotation: `None` if it states none, or if the gains are
/// not those of a bar.
pub(crate) fn stated_mode_check(finding: &Finding<Flexibility>) -> Option<MountCheck> {
    let found = finding.found().filter(|_| bar_of(finding) != Bar::Scaled)?;
    let (stated_hz, frequency_hz) = found.expected_hz.zip(found.frequency_hz)?;
    let factor = 0.5 * (GAMMA.0 + GAMMA.1) * 0.5 * (KAPPA.0 + KAPPA.1);
    let (gain, _) = bending_response(frequency_hz, stated_hz, 0.0, factor);
    let difference = (found.rotation_gain.value - gain).abs();
    let text = format!(
        "{stated_hz} Hz, as the rig file states, would raise the gain of rotation at {frequency_hz:.2} Hz to {gain:.4}; it \
         is {}",
        with_u(&found.rotation_gain, 4)
    );
    Some(MountCheck {
        name: "first mode of the bar".to_owned(),
        unit: "Hz".to_owned(),
        fitted: found.first_mode_hz.clone(),
        stated: Some(stated_hz),
        agrees: Some(difference <= CLEAR * u(&found.rotation_gain) + MODE_TOLERANCE * (gain - 1.0).abs()),
        of_rig: true,
        text,
    })
}

fn ratio(translation: Estimate, rotation: Estimate) -> Finding<Estimate> {
    let (p, r) = (translation.value - 1.0, rotation.value - 1.0);
    if p.abs() < CLEAR * u(&translation) {
        let text = format!("the gain of translation, {}, does not differ from one", with_u(&translation, 4));
        return Finding::CannotTell(text);
    }
    let value = r / p;
    Finding::Found(estimate(value, (u(&rotation) / p).hypot(value * u(&translation) / p)))
}

/// Whether the ratio is that of a bar, within two standard uncertainties.
fn bends(ratio: &Finding<Estimate>) -> Option<bool> {
    ratio.found().map(|e| e.value + 2.0 * u(e) >= KAPPA.0 && e.value - 2.0 * u(e) <= KAPPA.1)
}

/// What the gains say about the bar.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Bar {
    /// Rotation and translation are raised as by a bar that bends.
    Bends,
    /// They are raised in another ratio: a scale or a length is wrong.
    Scaled,
    /// Unknown, or stiff.
    NotSeen,
}

pub(crate) fn bar_of(finding: &Finding<Flexibility>) -> Bar {
    let Some(found) = finding.found() else { return Bar::NotSeen };
    match bends(&found.ratio) {
        Some(true) if found.first_mode_hz.found().is_some() => Bar::Bends,
        Some(false) => Bar::Scaled,
        _ => Bar::NotSeen,
    }
}

/// Both gains come from one mode: rotation with κΓ, translation with Γ. Γ and κ are known to a range, taken as uniform.
fn first_mode(p: Estimate, r: Estimate, ratio: &Finding<Estimate>, frequency_hz: f64) -> Finding<Estimate> {
    let middle = |(low, high): (f64, f64)| 0.5 * (low + high);
    let share = |(low, high): (f64, f64)| (high - low) / 12f64.sqrt() / (0.5 * (low + high));
    let one = |gain: Estimate, factor: f64, factor_share: f64| {
        let mode = first_mode_of_gain(gain.value, factor, frequency_hz)?;
        let excess = gain.value - 1.0;
        (excess > CLEAR * u(&gain)).then(|| estimate(mode, 0.5 * mode * (u(&gain) / excess).hypot(factor_share)))
    };
    let by_translation = one(p, middle(GAMMA), share(GAMMA));
    let by_rotation = one(r, middle(GAMMA) * middle(KAPPA), share(GAMMA).hypot(share(KAPPA)));
    match (bends(ratio), [by_translation, by_rotation]) {
        (Some(false), _) => Finding::CannotTell("the gains are not in the ratio of a bending bar".to_owned()),
        (_, [Some(a), Some(b)]) => Finding::Found(if u(&a) <= u(&b) { a } else { b }),
        (_, [Some(only), None] | [None, Some(only)]) => Finding::Found(only),
        (_, [None, None]) => {
            let least = first_mode_of_gain(1.0 + CLEAR * u(&r), middle(GAMMA) * middle(KAPPA), frequency_hz);
            let beyond =
                least.map_or(String::new(), |hz| format!("; a first mode below {hz:.1} Hz would have been detected"));
            Finding::CannotTell(format!("no gain is clearly above one{beyond}"))
        }
    }
}

fn in_words(gains: &str, ratio: &Finding<Estimate>, mode: &Finding<Estimate>, expected_hz: Option<f64>) -> String {
    let expected = expected_hz.map_or(String::new(), |hz| format!(" (the rig file expects {hz} Hz)"));
    match (ratio, bends(ratio), mode) {
        (Finding::Found(k), Some(true), Finding::Found(hz)) => format!(
            "{gains}: (rotation − 1)/(translation − 1) = {}, as of a bar that bends (1.38 to 1.50), with a first mode at {} \
             Hz{expected}.",
            with_u(k, 2),
            with_u(hz, 1)
        ),
        (Finding::Found(k), Some(false), _) => format!(
            "{gains}: (rotation − 1)/(translation − 1) = {}, not as of a bar that bends (1.38 to 1.50): the \
             counts per revolution, the bar's length or a scale of the sensor is wrong.",
            with_u(k, 2)
        ),
        (_, _, Finding::CannotTell(why)) => format!("{gains}: no bending detected; {why}."),
        (_, _, Finding::Found(hz)) => format!(
            "{gains}: rotation alone is clearly above one; if the bar bends, its first mode is at {} Hz{expected}, but a scale of \
             the sensor would look the same.",
            with_u(hz, 1)
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The check of a stated first mode of 5 Hz for a bar whose first mode is `mode_hz`, swung at 0.5 Hz.
    fn check(mode_hz: f64) -> MountCheck {
        let at = |gamma: f64| {
            let (value, _) = bending_response(0.5, mode_hz, 0.0, gamma);
            [GainAt { gain: estimate(value, 1e-4), frequency_hz: 0.5 }]
        };
        let middle = |(low, high): (f64, f64)| 0.5 * (low + high);
        let (gamma, kappa) = (middle(GAMMA), middle(KAPPA));
        stated_mode_check(&flexibility(&at(gamma), &at(gamma * kappa), Some(5.0))).unwrap()
    }

    #[test]
    fn a_stated_first_mode_that_the_gains_exclude_is_a_contradiction() {
        assert_eq!(check(5.0).agrees, Some(true));
        assert_eq!(check(5.2).agrees, Some(true), "8 % of the excess");
        assert_eq!(check(10.0).agrees, Some(false));
        let stiff = check(200.0);
        assert!(stiff.contradicts_rig() && stiff.fitted.found().is_none(), "{stiff:?}");
        // 1 + Γκ r²/(1 − r²) with Γκ = 1.5374 and r = 0.1.
        assert!(stiff.text.contains("to 1.0155; it is 1.0000"), "{}", stiff.text);
    }
}
