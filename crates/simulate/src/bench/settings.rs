//! Settings of a simulated bench.

use super::bar::{Bar, Mount};
use super::quantity::BenchChannel;
use super::swing::Swing;
use crate::error::{SimulateError, within};
use crate::sensor::{SensorSettings, Wander};
use flight::{Geodetic, Stamp};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Location and field of the bench.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Site {
    /// Latitude, deg.
    pub latitude_deg: f64,
    /// Longitude, deg.
    pub longitude_deg: f64,
    /// Height of the pivot, m.
    pub height_m: f64,
    /// Gravity, m/s².
    pub gravity_mps2: f64,
    /// Magnetic field north, east, down, T.
    pub field_t: [f64; 3],
}

impl Site {
    /// The pivot.
    #[must_use]
    pub fn pivot(&self) -> Geodetic {
        Geodetic::from_degrees(self.latitude_deg, self.longitude_deg, self.height_m)
    }

    fn check(&self) -> Result<(), SimulateError> {
        within("site.latitude_deg", self.latitude_deg, -90.0, 90.0, "a latitude")?;
        within("site.longitude_deg", self.longitude_deg, -360.0, 360.0, "a longitude")?;
        within("site.height_m", self.height_m, -1e5, 1e5, "within 100 km")?;
        within("site.gravity_mps2", self.gravity_mps2, 0.0, 100.0, "between 0 and 100 m/s²")?;
        self.field_t.iter().try_for_each(|&b| within("site.field_t", b, -1.0, 1.0, "within 1 T"))
    }
}

impl Default for Site {
    /// Goyang: gravity by Somigliana at 20 m, field by WMM2010 at 2010.8 (design note 1.6).
    fn default() -> Site {
        Site {
            latitude_deg: 37.6,
            longitude_deg: 126.86,
            height_m: 20.0,
            gravity_mps2: 9.799_516_171,
            field_t: [29_579.31e-9, -4_121.77e-9, 41_279.72e-9],
        }
    }
}

/// Output of the encoder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum EncoderOutput {
    /// Counts.
    Count,
    /// Counts as an angle: 2π/N each, without correction of sign or zero.
    Angle,
}

/// The encoder on the axis: counts n = round((ξ − zero)·N/(2π)·sign).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Encoder {
    /// Lines per revolution.
    pub lines: u32,
    /// Counts per line: 1, 2 or 4.
    pub decoding: u32,
    /// +1 or −1: direction in which counts rise with the bar's angle.
    pub sign: f64,
    /// Bar angle at count zero, rad.
    pub zero_rad: f64,
    /// Its output.
    pub output: EncoderOutput,
    /// The counter wraps around at this number, if at all.
    pub wrap_counts: Option<u32>,
    /// Its timestamps and losses. Its delay is that of the encoder; noise and bias are not used.
    pub sampling: SensorSettings,
}

impl Encoder {
    /// Counts per revolution.
    #[must_use]
    pub fn counts_per_rev(&self) -> f64 {
        f64::from(self.lines) * f64::from(self.decoding)
    }
}

/// Outliers of single samples.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Outliers {
    /// Share of samples, 0 to 1.
    pub share: f64,
    /// Standard deviation of these on each axis, in the channel's unit.
    pub std: f64,
}

/// One channel of the sensor. A row sent at the instant t is `soft iron · gain · lagged truth(u − delay) + bias +
/// wander + white`, with u = t, or the instant of the last update if the value is held.
///
/// For the gain, position is relative to the pivot; the errors of an attitude are small rotations about the sensor's
/// axes, rad, and its gain scales the bar's angle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BenchSensor {
    /// Rate of the rows, delay, noise, bias, timestamps, losses.
    pub sampling: SensorSettings,
    /// Updates per second, if rows repeat a held value; `None`: every row is an update.
    pub update_hz: Option<f64>,
    /// Time constants of first-order lags in series, s.
    pub lags_s: Vec<f64>,
    /// Factor applied to the truth.
    pub gain: f64,
    /// Matrix that mixes the axes of a magnetometer, row by row, in its own axes; the hard iron is the bias. `None`: no
    /// mixing. Other channels ignore it.
    pub soft_iron: Option<[[f64; 3]; 3]>,
    /// From the pivot, forward, right, down of the bar, m; `None`: that of the bar.
    pub lever_arm_m: Option<[f64; 3]>,
    /// Rotation vector R from sensor axes to body axes, rad: the sensor reads `exp(R)ᵀ u_body`.
    pub rotation_rad: [f64; 3],
    /// Outliers, if any.
    pub outliers: Option<Outliers>,
}

impl BenchSensor {
    /// A perfect channel at this rate, delivered 2 ms after its timestamp.
    #[must_use]
    pub fn clean(rate_hz: f64) -> BenchSensor {
        BenchSensor {
            sampling: SensorSettings::clean(rate_hz),
            update_hz: None,
            lags_s: vec![],
            gain: 1.0,
            soft_iron: None,
            lever_arm_m: None,
            rotation_rad: [0.0; 3],
            outliers: None,
        }
    }

    /// The same with white noise.
    #[must_use]
    pub fn noisy(rate_hz: f64, white_std: f64) -> BenchSensor {
        BenchSensor { sampling: SensorSettings { white_std, ..SensorSettings::clean(rate_hz) }, ..Self::clean(rate_hz) }
    }

    /// The same, `delay_s` late.
    #[must_use]
    pub fn late(mut self, delay_s: f64) -> BenchSensor {
        self.sampling.delay_s = delay_s;
        self
    }

    /// The same with wandering noise.
    #[must_use]
    pub fn wandering(mut self, std: f64, time_constant_s: f64) -> BenchSensor {
        self.sampling.wander = Some(Wander { std, time_constant_s });
        self
    }

    /// The same with a constant error.
    #[must_use]
    pub fn biased(mut self, bias: [f64; 3]) -> BenchSensor {
        self.sampling.bias = bias;
        self
    }

    fn check(&self) -> Result<(), SimulateError> {
        self.sampling.check()?;
        self.update_hz
            .iter()
            .try_for_each(|&f| within("update_hz", f, 0.01, 10_000.0, "between 0.01 and 10 000 Hz"))?;
        self.lags_s.iter().try_for_each(|&lag| within("lags_s", lag, 1e-4, 2.0, "between 0.1 ms and 2 s"))?;
        let soft_iron = self.soft_iron.iter().flatten().flatten();
        soft_iron.into_iter().try_for_each(|&s| within("soft_iron", s, -10.0, 10.0, "within ten"))?;
        within("gain", self.gain, -1e3, 1e3, "within a thousand")?;
        let arm = self.lever_arm_m.unwrap_or_default();
        arm.iter().try_for_each(|&r| within("lever_arm_m", r, -100.0, 100.0, "within 100 m"))?;
        self.rotation_rad.iter().try_for_each(|&r| within("rotation_rad", r, -10.0, 10.0, "within 10 rad"))?;
        self.outliers.iter().try_for_each(|o| {
            within("outliers.share", o.share, 0.0, 1.0, "between 0 and 1")?;
            within("outliers.std", o.std, 0.0, f64::MAX, "zero or more")
        })
    }
}

/// Error of a clock: at true time t it shows `offset + (1 + skew) t` seconds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct ClockError {
    /// Offset at the start, s.
    pub offset_s: f64,
    /// Seconds gained per second.
    pub skew: f64,
}

impl ClockError {
    /// Its reading, seconds after its own zero, at true time `t_s`.
    #[must_use]
    pub fn shows_s(&self, t_s: f64) -> f64 {
        self.offset_s + (1.0 + self.skew) * t_s
    }

    fn check(&self) -> Result<(), SimulateError> {
        within("clock.offset_s", self.offset_s, -1e8, 1e8, "within three years")?;
        within("clock.skew", self.skew, -0.01, 0.01, "within one in a hundred")
    }
}

/// The clocks other than the encoder's, which shows true time as UTC.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct BenchClocks {
    /// The sensor's own clock, which timestamps its samples since boot; `None`: the encoder's clock timestamps them.
    pub device: Option<ClockError>,
    /// The clock of the logger that timestamps the arrival of every message: UTC, with this error.
    pub logger: ClockError,
}

/// A pulse at each full second of the sensor's clock (or of the encoder's, if that is the only one).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Pulses {
    /// Standard deviation of the timestamp of an edge in the encoder's clock, s.
    pub stamp_jitter_s: f64,
    /// Share of lost pulses.
    pub drop_share: f64,
}

/// A bench to simulate.
#[derive(Debug, Clone, PartialEq)]
pub struct BenchSettings {
    /// Seed of the swing, the noise and the latencies.
    pub seed: u64,
    /// Time zero, UTC, as the encoder's clock shows it.
    pub start: Stamp,
    /// Its location.
    pub site: Site,
    /// The bar.
    pub bar: Bar,
    /// Its angle at rest, rad: the swing goes to both sides of this angle.
    pub rest_angle_rad: f64,
    /// Kind of motion.
    pub swing: Swing,
    /// Duration of the swing, s.
    pub swing_s: f64,
    /// Duration of the rest before and after, s.
    pub rest_s: [f64; 2],
    /// The encoder.
    pub encoder: Encoder,
    /// The sensor's channels.
    pub sensor: BTreeMap<BenchChannel, BenchSensor>,
    /// Clocks.
    pub clocks: BenchClocks,
    /// Pulse per second, if any.
    pub pulses: Option<Pulses>,
}

impl Default for BenchSettings {
    /// The paper's bench with a plain receiver: upright bar of 1.3 m, 60 s of hand-driven swing of ±60° between 10 s of
    /// rest, encoder of 2000 counts at 100 Hz, one clock. An MTi-G-like sensor at 100 Hz, on time, except for the
    /// position: 0.4 s late, updated at 4 Hz and held in 100 Hz rows.
    fn default() -> BenchSettings {
        let position = BenchSensor { update_hz: Some(4.0), ..BenchSensor::noisy(100.0, 0.05) };
        let mut sensor = inertial();
        sensor.insert(BenchChannel::PositionGps, position.wandering(0.5, 20.0).late(0.4));
        BenchSettings {
            seed: 1,
            // 2010-10-25 00:00:00 UTC, the day on which the paper was received.
            start: Stamp(1_287_964_800_000_000_000),
            site: Site::default(),
            bar: Bar { length_m: 1.3, mount: Mount::Upright, azimuth_rad: 30f64.to_radians(), flexible: None },
            rest_angle_rad: 0.0,
            swing: Swing::hand(),
            swing_s: 60.0,
            rest_s: [10.0, 10.0],
            encoder: Encoder {
                lines: 2000,
                decoding: 1,
                sign: 1.0,
                zero_rad: 0.0,
                output: EncoderOutput::Count,
                wrap_counts: None,
                sampling: SensorSettings::clean(100.0),
            },
            sensor,
            clocks: BenchClocks::default(),
            pulses: None,
        }
    }
}

impl BenchSettings {
    /// As the default, but with the position of an inertial navigation system: 100 Hz, 0.4 s late.
    #[must_use]
    pub fn ins() -> BenchSettings {
        let mut settings = BenchSettings::default();
        settings.sensor.remove(&BenchChannel::PositionGps);
        let position = BenchSensor::noisy(100.0, 0.01).wandering(0.1, 5.0).late(0.4);
        settings.sensor.insert(BenchChannel::PositionIns, position);
        settings
    }

    /// With only these channels.
    #[must_use]
    pub fn only(mut self, channels: &[BenchChannel]) -> BenchSettings {
        self.sensor.retain(|channel, _| channels.contains(channel));
        self
    }

    /// With a replaced or additional channel.
    #[must_use]
    pub fn with(mut self, channel: BenchChannel, sensor: BenchSensor) -> BenchSettings {
        self.sensor.insert(channel, sensor);
        self
    }

    /// Duration from time zero to the end, s.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.rest_s[0] + self.swing_s + self.rest_s[1]
    }

    /// Lever arm of a channel: forward, right, down of the bar, m.
    #[must_use]
    pub fn lever_arm_m(&self, channel: BenchChannel) -> [f64; 3] {
        self.sensor.get(&channel).and_then(|s| s.lever_arm_m).unwrap_or_else(|| self.bar.lever_arm_m())
    }

    pub(super) fn check(&self) -> Result<(), SimulateError> {
        within("swing_s", self.swing_s, 5.0, 7200.0, "between 5 and 7200 s")?;
        self.rest_s.iter().try_for_each(|&s| within("rest_s", s, 0.0, 7200.0, "between 0 and 7200 s"))?;
        self.site.check()?;
        within("rest_angle_rad", self.rest_angle_rad, -100.0, 100.0, "within 100 rad")?;
        self.bar.check()?;
        self.swing.check()?;
        self.encoder.check()?;
        self.sensor.values().try_for_each(BenchSensor::check)?;
        self.clocks.logger.check()?;
        self.clocks.device.iter().try_for_each(ClockError::check)?;
        self.pulses.iter().try_for_each(|p| {
            within("pulses.stamp_jitter_s", p.stamp_jitter_s, 0.0, 0.1, "between 0 and 0.1 s")?;
            within("pulses.drop_share", p.drop_share, 0.0, 1.0, "between 0 and 1")
        })
    }
}

impl Encoder {
    fn check(&self) -> Result<(), SimulateError> {
        within("encoder.lines", f64::from(self.lines), 1.0, 1e7, "between 1 and 10 million")?;
        within("encoder.decoding", f64::from(self.decoding), 1.0, 4.0, "1, 2 or 4")?;
        within("encoder.sign", self.sign.abs(), 1.0, 1.0, "+1 or −1")?;
        within("encoder.zero_rad", self.zero_rad, -1e3, 1e3, "within a thousand rad")?;
        within("encoder.wrap_counts", self.wrap_counts.map_or(1.0, f64::from), 1.0, f64::MAX, "1 or more")?;
        self.sampling.check()
    }
}

/// All channels except positions: rates and noise similar to an MTi-G of 2010.
fn inertial() -> BTreeMap<BenchChannel, BenchSensor> {
    BTreeMap::from([
        (BenchChannel::VelocityIns, BenchSensor::noisy(100.0, 0.02).wandering(0.03, 5.0)),
        (BenchChannel::Attitude, BenchSensor::noisy(100.0, 0.001).wandering(0.005, 10.0)),
        (BenchChannel::AngularRate, BenchSensor::noisy(100.0, 0.005).biased([0.002, -0.003, 0.001])),
        (BenchChannel::SpecificForce, BenchSensor::noisy(100.0, 0.03).biased([0.02, -0.03, 0.05])),
        (BenchChannel::MagneticField, BenchSensor::noisy(100.0, 0.2e-6).biased([1.5e-6, -1e-6, 2e-6])),
        (BenchChannel::Height, BenchSensor::noisy(100.0, 0.1).wandering(0.2, 30.0)),
    ])
}
