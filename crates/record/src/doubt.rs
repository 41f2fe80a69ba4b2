//! Reasons to doubt the delays of a bench record: one rule for its page, its card and the terminal.

use crate::{BenchRecord, ChannelDynamics, Estimate, Finding, GateCheck, ModelFinding, MountCheck, TimeBasis};
use flight::{Code, Quantity, decimals_of, fixed};

/// Place of the notice that the encoder's sign in the record differs from the rig file.
pub const ENCODER_SIGN: &str = "encoder sign";
/// Place of the notice that the sensor's side of the pivot in the record differs from the rig file.
pub const SIDE_OF_PIVOT: &str = "side of the pivot";
/// Gate check for an encoder that lost counts. The two halves of such a record have different zeros.
pub const ENCODER_SLIP: &str = "encoder slip";
/// Gate check for the scatter of the encoder's counts about the smoothed motion.
pub const ENCODER_RESIDUAL: &str = "encoder residual";
/// End of that check's text where the scatter is too large, so that the reference motion is wrong.
pub const COUNTS_OR_STAMPS_WRONG: &str = "counts are lost or timestamps jitter";
/// Start of the reason for doubt, after the name of the record, where the delay is not one number.
pub const DELAY_CHANGES: &str = "the delay changes over the record";

/// An inertial sensor this much ahead of the encoder shows a wrong clock, s: it cannot know a motion before it happens.
const EARLY_S: f64 = 0.005;

impl BenchRecord {
    /// Reasons to doubt every delay of the record, each in words with its size: data that contradict the rig file, an
    /// encoder that slipped or scatters, or clocks that differ. Rig file, encoder and clock affect every reference.
    #[must_use]
    pub fn doubts(&self) -> Vec<String> {
        self.doubts_of(|_| true)
    }

    /// Reasons to doubt the angles of the record, and with them the directions of its fields and forces: as
    /// [`BenchRecord::doubts`], but without lengths and the bending of the bar.
    #[must_use]
    pub fn doubts_of_angles(&self) -> Vec<String> {
        self.doubts_of(|check| !["m", "Hz"].contains(&check.unit.as_str()))
    }

    fn doubts_of(&self, counts: impl Fn(&MountCheck) -> bool) -> Vec<String> {
        let findings = || self.findings.iter();
        let contradicted = self.notices.iter().filter(|n| n.code == Code::RigContradicted);
        let stated = contradicted.filter(|n| [ENCODER_SIGN, SIDE_OF_PIVOT].contains(&n.place.as_str()));
        let checks =
            findings().flat_map(|f| &f.mount.checks).filter(|c| (c.contradicts_rig() || c.is_reversed()) && counts(c));
        let encoder = findings().flat_map(|f| &f.gate.checks).filter(|c| c.is_of_wrong_motion());
        let of_notices = stated.map(|n| n.text.clone());
        let of_gate = encoder.map(|c| format!("{}: {}", c.name, c.text));
        let of_clock = findings().flat_map(|f| &f.channels).filter_map(ChannelDynamics::impossible_lead);
        of_gate.chain(of_notices).chain(of_clock).chain(checks.map(MountCheck::in_words)).collect()
    }
}

impl GateCheck {
    /// Whether this check finds the reference motion wrong.
    #[must_use]
    pub fn is_of_wrong_motion(&self) -> bool {
        let scatters = self.name == ENCODER_RESIDUAL && self.text.ends_with(COUNTS_OR_STAMPS_WRONG);
        !self.passed && (scatters || self.name == ENCODER_SLIP)
    }
}

impl MountCheck {
    /// Whether data and rig file differ and the rig file is wrong.
    #[must_use]
    pub fn contradicts_rig(&self) -> bool {
        self.of_rig && self.agrees == Some(false)
    }

    /// Whether the zero or the azimuth by one channel is turned by more than 90° from that of the others: a sign or an
    /// axis of one of them is reversed, and it is unknown of which.
    #[must_use]
    pub fn is_reversed(&self) -> bool {
        let is_of_data = self.unit == "rad" && !self.of_rig && self.agrees == Some(false);
        let is_common = ["azimuth by ", "encoder zero by "].iter().any(|start| self.name.starts_with(start));
        let apart = self.fitted.found().zip(self.stated).map(|(fitted, stated)| (fitted.value - stated).cos());
        is_of_data && is_common && apart.is_some_and(|cosine| cosine < 0.0)
    }

    /// `lever arm z of imu: 1.201 ± 0.004 m by the data, 1.3 m by the rig file`.
    fn in_words(&self) -> String {
        let (Finding::Found(fitted), Some(stated)) = (&self.fitted, self.stated) else {
            let text = if self.text.is_empty() { String::new() } else { format!(": {}", self.text) };
            return self.name.clone() + &text;
        };
        let (factor, unit) = if self.unit == "rad" { (1f64.to_degrees(), "°") } else { (1.0, self.unit.as_str()) };
        let u = fitted.standard_uncertainty.map_or(0.0, |u| 2.0 * u * factor);
        let digits = if u > 0.0 { decimals_of(u) } else { 3 };
        let [fitted, stated] = [fitted.value, stated].map(|value| fixed(value * factor, digits));
        match self.is_reversed() {
            true => format!(
                "{}: {fitted} ± {u:.digits$} {unit}, and {stated} {unit} by the others. A sign or an axis of one channel is \
                 reversed",
                self.name
            ),
            false => {
                format!("{}: {fitted} ± {u:.digits$} {unit} by the data, {stated} {unit} by the rig file", self.name)
            }
        }
    }
}

impl ChannelDynamics {
    /// Why a gyro or accelerometer that is clearly early shows that the clocks of sensor and encoder differ.
    fn impossible_lead(&self) -> Option<String> {
        let is_inertial = matches!(self.quantity, Quantity::AngularRate | Quantity::SpecificForce);
        let delay = self.delay.as_ref().filter(|_| is_inertial && self.basis == TimeBasis::OneClock)?;
        let (delay_s, u) = (delay.delay.seconds(), delay.standard_uncertainty_s);
        (delay_s + 4.0 * u < -EARLY_S).then(|| {
            format!(
                "{}: {} ± {} ms, but no gyro or accelerometer is early. The clocks of sensor and encoder differ (set \
                 clock.shared = false in the rig file), or timestamps are wrong",
                self.name,
                fixed(1e3 * delay_s, 1),
                fixed((2e4 * u).ceil() / 10.0, 1)
            )
        })
    }

    /// Smallest and largest delay of the windows, s, where the delay significantly changes over the record, so that it
    /// is not one number.
    #[must_use]
    pub fn changing_delay_s(&self) -> Option<[f64; 2]> {
        let found = self.stationarity.found().filter(|s| s.changes)?;
        let bound = |f: fn(f64, f64) -> f64, from: f64| found.delay_s.iter().map(|d| d.value).fold(from, f);
        Some([bound(f64::min, f64::INFINITY), bound(f64::max, f64::NEG_INFINITY)])
    }

    /// The model of the channel, if one was chosen and has a lag. A delay that changes can look like a lag, but is
    /// excluded.
    #[must_use]
    pub fn lags(&self) -> Option<(&ModelFinding, &[Estimate])> {
        let model = self.model.found().filter(|_| self.changing_delay_s().is_none())?;
        let chosen = model.candidates.iter().find(|c| Some(&c.name) == model.chosen.as_ref())?;
        (!chosen.lags_s.is_empty()).then_some((model, chosen.lags_s.as_slice()))
    }

    /// Reason to doubt the delay of this channel, in words: it is not one number.
    #[must_use]
    pub fn doubt(&self) -> Option<String> {
        let [least, most] = self.changing_delay_s()?.map(|delay_s| fixed(1e3 * delay_s, 1));
        Some(format!("{DELAY_CHANGES}, from {least} to {most} ms in windows"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gate(name: &str, passed: bool, text: &str) -> GateCheck {
        GateCheck { name: name.to_owned(), passed, text: text.to_owned() }
    }

    #[test]
    fn only_slips_and_scatter_of_the_encoder_make_the_motion_wrong() {
        let lost = format!("3.1 counts rms: {COUNTS_OR_STAMPS_WRONG}");
        assert!(gate(ENCODER_SLIP, false, "12 counts at 31 s").is_of_wrong_motion());
        assert!(gate(ENCODER_RESIDUAL, false, &lost).is_of_wrong_motion());
        // The smoothing is coarse, but the motion is right.
        assert!(!gate(ENCODER_RESIDUAL, false, "0.4 counts rms: smoother than the counts").is_of_wrong_motion());
        assert!(!gate(ENCODER_SLIP, true, "none").is_of_wrong_motion());
        assert!(!gate("swing amplitude", false, &lost).is_of_wrong_motion());
    }

    fn mount(unit: &str, fitted: Finding<Estimate>, stated: Option<f64>) -> MountCheck {
        let (name, unit, agrees, of_rig) = ("lever arm z of imu".to_owned(), unit.to_owned(), Some(false), true);
        MountCheck { name, unit, fitted, stated, agrees, of_rig, text: String::new() }
    }

    #[test]
    fn a_contradiction_is_given_with_both_values_and_the_95_percent_half_width() {
        let fitted = |value, u| Finding::Found(Estimate { value, standard_uncertainty: Some(u) });
        let words = |unit, value, u, stated| mount(unit, fitted(value, u), Some(stated)).in_words();
        assert_eq!(
            words("m", 1.2012, 0.002, 1.3),
            "lever arm z of imu: 1.2012 ± 0.0040 m by the data, 1.3000 m by the rig file"
        );
        // 0.1 rad is 5.73°, and 2 × 0.005 rad 0.57°.
        assert_eq!(
            words("rad", 0.1, 0.005, 0.0),
            "lever arm z of imu: 5.73 ± 0.57 ° by the data, 0.00 ° by the rig file"
        );
        assert_eq!(mount("m", Finding::CannotTell(String::new()), Some(1.0)).in_words(), "lever arm z of imu");
    }

    #[test]
    fn a_scale_that_differs_does_not_accuse_the_rig_file() {
        let check = mount("m", Finding::CannotTell(String::new()), None);
        assert!(check.contradicts_rig());
        assert!(!MountCheck { of_rig: false, ..check.clone() }.contradicts_rig());
        assert!(!MountCheck { agrees: None, ..check }.contradicts_rig());
        let azimuth = |fitted: f64, of_rig: bool| MountCheck {
            name: "azimuth by position.gps".into(),
            unit: "rad".into(),
            fitted: Finding::Found(Estimate { value: fitted, standard_uncertainty: Some(0.02) }),
            stated: Some(2.2334),
            agrees: Some(false),
            of_rig,
            text: String::new(),
        };
        assert!(azimuth(5.3629, false).is_reversed() && !azimuth(5.3629, true).is_reversed());
        assert!(!azimuth(2.4, false).is_reversed(), "10° are no reversed sign");
        let words = "azimuth by position.gps: 307.3 ± 2.3 °, and 128.0 ° by the others. A sign or an axis of one channel is reversed";
        assert_eq!(azimuth(5.3629, false).in_words(), words);
    }
}
