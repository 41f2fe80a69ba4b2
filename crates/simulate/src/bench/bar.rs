//! The bar, the mounting of the sensor on it, and its bending.

use crate::error::{SimulateError, within};
use serde::{Deserialize, Serialize};

/// Mounting of the sensor on the bar (design note 1.2, 1.4).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mount {
    /// Above the pivot when the bar's angle is zero: lever arm 0, 0, −L. As in the paper.
    Upright,
    /// Below the pivot when the bar's angle is zero, sensor upright: lever arm 0, 0, +L.
    Hanging,
    /// Elsewhere: lever arm forward, right, down of the pivot, m.
    Custom([f64; 3]),
}

/// The bar.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Bar {
    /// Distance from the pivot to the sensor, m.
    pub length_m: f64,
    /// Mounting of the sensor.
    pub mount: Mount,
    /// Azimuth of the swing plane from north over east, rad.
    pub azimuth_rad: f64,
    /// Bending; `None` is stiff.
    pub flexible: Option<FlexibleBar>,
}

/// The first bending mode (design note 1.6): with deflection w of the tip and bar angle ξ,
/// `w/(L ξ) = −Γ s²/(s² + 2ζω s + ω²)`; the slope of the tip is κ times that.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FlexibleBar {
    /// Natural frequency, Hz.
    pub frequency_hz: f64,
    /// Damping ratio.
    pub damping: f64,
    /// Participation Γ.
    pub participation: f64,
    /// Slope of the tip divided by its deflection, κ = L φ'(L)/φ(L).
    pub slope_ratio: f64,
}

impl FlexibleBar {
    /// Γ and κ of a cantilever by the ratio of its tip mass to its own mass, linear between the rows of the table in
    /// the design note, 1.6 (from 5 on, those of a massless bar).
    #[must_use]
    pub fn of_tip_mass(mass_ratio: f64, frequency_hz: f64, damping: f64) -> FlexibleBar {
        const TABLE: [(f64, f64, f64); 5] = [
            (0.0, 1.1377, 1.3765),
            (0.5, 1.0511, 1.4607),
            (1.0, 1.0310, 1.4767),
            (2.0, 1.0174, 1.4872),
            (5.0, 1.0075, 1.4945),
        ];
        let pair = TABLE.windows(2).find(|pair| (pair[0].0..pair[1].0).contains(&mass_ratio));
        let (participation, slope_ratio) = pair.map_or((1.0, 1.5), |pair| {
            let share = (mass_ratio - pair[0].0) / (pair[1].0 - pair[0].0);
            let between = |a: f64, b: f64| a + share * (b - a);
            (between(pair[0].1, pair[1].1), between(pair[0].2, pair[1].2))
        });
        FlexibleBar { frequency_hz, damping, participation, slope_ratio }
    }

    fn check(&self) -> Result<(), SimulateError> {
        within("flexible.frequency_hz", self.frequency_hz, 0.1, 50.0, "between 0.1 and 50 Hz")?;
        within("flexible.damping", self.damping, 0.0, 1.0, "between 0 and 1")?;
        within("flexible.participation", self.participation, 0.0, 2.0, "between 0 and 2")?;
        within("flexible.slope_ratio", self.slope_ratio, 0.0, 2.0, "between 0 and 2")
    }
}

impl Bar {
    /// Vector from the pivot to the sensor: forward, right, down of the bar, m.
    #[must_use]
    pub fn lever_arm_m(&self) -> [f64; 3] {
        match self.mount {
            Mount::Upright => [0.0, 0.0, -self.length_m],
            Mount::Hanging => [0.0, 0.0, self.length_m],
            Mount::Custom(arm) => arm,
        }
    }

    pub(super) fn check(&self) -> Result<(), SimulateError> {
        within("bar.length_m", self.length_m, 0.01, 100.0, "between 0.01 and 100 m")?;
        within("bar.azimuth_rad", self.azimuth_rad, f64::MIN, f64::MAX, "a finite number")?;
        self.lever_arm_m().iter().try_for_each(|&r| within("bar.lever_arm_m", r, -100.0, 100.0, "within 100 m"))?;
        self.flexible.iter().try_for_each(FlexibleBar::check)
    }
}
