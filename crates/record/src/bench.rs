//! Bench results for a sensor: the delay and dynamics of each of its channels.

use crate::SensorIdentity;
use crate::flight::InputFile;
use crate::replay::{Curve, Estimate};
use flight::{Binding, Clock, Delay, LogHealth, Notices, Quantity, RejectCount, StampKind};
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The rig file with which a record was analysed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct RigUse {
    /// Title from the file.
    pub title: String,
    /// BLAKE3 of the resolved rig file (comments and order do not count).
    pub blake3: String,
    /// The resolved rig file, as TOML.
    pub toml: String,
}

/// Outcome of the bench record.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(tag = "outcome", rename_all = "kebab-case")]
pub enum BenchOutcome {
    /// The delay of at least one channel was measured.
    Measured,
    /// The logs were read, but no channel can be measured.
    NotMeasurable {
        /// Reason, and what would make it possible.
        reason: String,
    },
    /// The logs could not be used.
    Failed {
        /// File, topic, line or byte, and what is wrong.
        reason: String,
    },
}

/// One log of a bench record.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct BenchLog {
    /// `encoder`, `sensor`, or `encoder and sensor`.
    pub role: String,
    /// Its files.
    pub inputs: Vec<InputFile>,
    /// Result of reading them.
    pub health: LogHealth,
    /// Channels bound by the channel map; `None` if no map matches.
    pub binding: Option<Binding>,
}

/// Everything found about one bench record. It contains no times of day, hosts or folders.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct BenchRecord {
    /// [`crate::RECORD_VERSION`].
    pub record_version: u32,
    /// Analysis version, raised by hand when the numbers change.
    pub analysis_version: u32,
    /// The sensor on the bench, from the rig file.
    pub sensor: SensorIdentity,
    /// Rig file used.
    pub rig: RigUse,
    /// One or two logs.
    pub logs: Vec<BenchLog>,
    /// UTC day of the record, `yyyy-mm-dd`: from the timestamps, otherwise from the rig file.
    pub date: Option<String>,
    /// Outcome.
    #[serde(flatten)]
    pub outcome: BenchOutcome,
    /// Findings; `None` unless something was measured or at least attempted.
    pub findings: Option<BenchFindings>,
    /// All notices, in the order in which they were raised.
    pub notices: Notices,
}

/// Findings of a bench record.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct BenchFindings {
    /// Time zero of all `t_s`: a timestamp, ns, on the encoder's clock.
    pub origin_ns: i64,
    /// The encoder's clock.
    pub clock: Clock,
    /// The encoder and the motion derived from it.
    pub reference: ReferenceFinding,
    /// Whether this swing is suitable for measurement.
    pub gate: QualityGate,
    /// How the sensor's clock was tied to the encoder's.
    pub clocks: ClockFinding,
    /// Mount and calibration.
    pub mount: MountFinding,
    /// Whether the bar bends.
    pub flexibility: Finding<Flexibility>,
    /// The rig as built, for a drawing; `None` in records of earlier versions.
    #[serde(default)]
    pub geometry: Option<RigGeometry>,
    /// Channels, sorted by name.
    pub channels: Vec<ChannelDynamics>,
}

/// Pivot, bar and parts of the sensor, from the rig file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct RigGeometry {
    /// Pivot to sensor, m.
    pub bar_length_m: f64,
    /// `upright` (sensor above the pivot), `hanging` (below), or `custom`.
    pub mount: String,
    /// Places at which channels were measured, sorted by the first channel of each.
    pub parts: Vec<RigPart>,
}

/// A place on the bar.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct RigPart {
    /// Channels of the record measured there.
    pub channels: Vec<String>,
    /// Arm from the pivot in body axes forward, right, down at bar angle zero, m.
    pub lever_arm_m: [f64; 3],
    /// Whether the rig file states this arm. Otherwise it is derived from length and mount of the bar.
    pub is_stated: bool,
}

/// A finding, or why it is unavailable.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Finding<T> {
    /// It was found.
    Found(T),
    /// It cannot be determined from this record: why, and what would make it possible.
    CannotTell(String),
}

impl<T> Finding<T> {
    /// The finding, if available.
    pub fn found(&self) -> Option<&T> {
        match self {
            Finding::Found(t) => Some(t),
            Finding::CannotTell(_) => None,
        }
    }
}

/// The encoder, and the reference motion that a four-state smoother derived from it (design note 2).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ReferenceFinding {
    /// Channel of the encoder.
    pub channel: String,
    /// Number of samples used.
    pub samples: u64,
    /// Samples per second.
    pub rate_hz: f64,
    /// Duration from the first to the last sample, s.
    pub duration_s: f64,
    /// Counts per revolution that were used: lines times decoding.
    pub counts_per_rev: f64,
    /// Source of that number, in words: the rig file, or the smallest step observed.
    pub counts_source: String,
    /// Direction of increasing counts: +1 or −1.
    pub sign: f64,
    /// Source of the sign.
    pub sign_source: String,
    /// Bar angle at count zero, rad.
    pub zero_rad: Estimate,
    /// Source of the zero.
    pub zero_source: String,
    /// Azimuth of the swing plane from north over east, rad; `None` if no channel needs it.
    pub azimuth_rad: Option<Estimate>,
    /// Source of the azimuth.
    pub azimuth_source: String,
    /// log10 of the spectral density of the white snap, rad²/s⁷, estimated by generalised cross-validation.
    pub log10_q: f64,
    /// Rms of encoder − smoothed, in counts. A perfect quantiser gives 0.289.
    pub residual_rms_counts: f64,
    /// Smoothed standard deviation (median over the record) of angle, rate and acceleration: rad, rad/s, rad/s².
    pub uncertainty: [f64; 3],
    /// Largest and smallest bar angle, rad.
    pub angle_range_rad: [f64; 2],
    /// Gravity at the site, m/s².
    pub gravity_mps2: f64,
    /// Source of gravity.
    pub gravity_source: String,
    /// Magnetic field north, east, down, T; `None` if it was fitted.
    pub field_t: Option<[f64; 3]>,
    /// Source of the field, with the validity of the model.
    pub field_source: String,
    /// Bar angle, rad: first encoder, then smoothed.
    pub angle: Vec<Curve>,
    /// Tangential acceleration L·ξ″, m/s²: first smoothed, then the paper's second central difference.
    pub acceleration: Vec<Curve>,
}

/// One check before any verdict.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct GateCheck {
    /// Name of the check, such as `swing amplitude`.
    pub name: String,
    /// Whether it passed.
    pub passed: bool,
    /// Number, limit and consequence, in words.
    pub text: String,
}

/// The quality of the record, judged before any verdict (design note 1.6, 3.3).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct QualityGate {
    /// The checks.
    pub checks: Vec<GateCheck>,
    /// Band with 90 % of the power of the bar's rate, Hz.
    pub excited_band_hz: [f64; 2],
    /// Rms frequency of the bar's angle, Hz.
    pub rms_frequency_hz: f64,
    /// Full swings (pairs of reversals).
    pub swings: u64,
    /// Limits of a planar swing, for any sensor.
    pub not_observable: Vec<String>,
}

/// How the timestamps of the sensor were tied to the encoder's clock.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ClockFinding {
    /// Reference for all delays.
    pub basis: TimeBasis,
    /// Summary in words: what is absolute and what is relative.
    pub statement: String,
    /// Skew of the sensor's clock against the encoder's: seconds gained per second, estimated jointly from all
    /// channels.
    pub skew: Finding<Estimate>,
    /// Lag of the anchor channel against the encoder as logged, s: an offset of the clocks plus the anchor's own delay.
    pub anchor_lag_s: Option<Estimate>,
    /// Map from device time to the logger's clock from the lower hull of (device time, arrival − device time).
    pub hull: Option<HullFinding>,
    /// Pulse per second, if one was logged.
    pub pps: Option<PpsFinding>,
}

/// Reference for a delay.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case", tag = "basis")]
pub enum TimeBasis {
    /// Encoder and sensor have timestamps from one clock: delays are absolute, except for that clock's own
    /// timestamping.
    OneClock,
    /// A pulse per second ties the device's clock to the encoder's: delays are absolute.
    Pps,
    /// The fastest arrivals tie the device's clock to the encoder's: delays include the minimum transport latency,
    /// which no log shows.
    FastestArrivals,
    /// Clocks differ: delays are relative to this channel, which is assumed to be on time.
    Anchor {
        /// Name of the channel.
        channel: String,
    },
}

/// The fastest arrivals as a line (design note 6).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct HullFinding {
    /// Channel whose timestamps were used.
    pub channel: String,
    /// Device clock.
    pub device: Clock,
    /// Clock of the arrival.
    pub arrival: Clock,
    /// Arrival less device time at the middle of the record, on the hull, s. It includes the minimum transport latency.
    pub offset_s: f64,
    /// Slope of arrival less device time, s/s: negative if the device's clock gains.
    pub skew: f64,
    /// Arrival above the hull: delay relative to the fastest.
    pub latency_s: flight::Distribution,
    /// A note if the device's timestamp offset is not monotonic or there are too few timestamps.
    pub remark: String,
}

/// Pulse per second as a time reference.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct PpsFinding {
    /// Channel of the pulses.
    pub channel: String,
    /// Number of pulses used.
    pub pulses: u64,
    /// Pulses rejected, by reason.
    pub rejected: Vec<RejectCount>,
    /// Mean skew of the logger's clock against the pulses, s/s.
    pub skew: Estimate,
    /// Rms of the pulses about the piecewise-linear map, s.
    pub residual_rms_s: f64,
}

/// Verdict on a delay (design note 3.7).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// The interval excludes zero.
    Delayed,
    /// As [`Verdict::Delayed`], but early: the timestamp is earlier than the time at which the value was true.
    Early,
    /// Two one-sided tests: the delay lies within the margin.
    EquivalentToZero,
    /// Neither could be shown.
    Inconclusive,
    /// The delay could not be estimated, or the gate forbids a verdict.
    NotMeasurable,
}

/// A delay with everything that describes its uncertainty.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DelayFinding {
    /// Best value; positive is late.
    pub delay: Delay,
    /// Standard uncertainty, s: the larger of the next two, plus the contributions of the reference, the timestamps,
    /// the anchor and a change over the record in quadrature.
    pub standard_uncertainty_s: f64,
    /// Part from the Hessian of the generalised least squares, s.
    pub hessian_s: f64,
    /// Part from the heteroscedasticity and autocorrelation consistent sandwich, s.
    pub hac_s: f64,
    /// Part from the reference, whose error follows the encoder's steps, s. The noise of the fit includes it as if each
    /// component had its own: `1 − 1/components` of its variance is added, and the total is at least this part.
    #[serde(default)]
    pub reference_s: f64,
    /// Part from coarse timestamps, s: a held value is seen at most one row late; a tick is truncated or rounded.
    pub stamps_s: f64,
    /// Part from the delay of the anchor channel, s; zero where delays are absolute.
    pub anchor_s: f64,
    /// Part added so that the interval covers the delay of every part of the record, s; zero unless the delay
    /// significantly changes.
    #[serde(default)]
    pub change_s: f64,
    /// 95 % confidence interval (Student), s.
    pub interval_95_s: [f64; 2],
    /// Degrees of freedom.
    pub degrees_of_freedom: f64,
    /// Cramér–Rao bound at the fitted noise, s.
    pub crlb_s: f64,
    /// Delay seen by a loop that reads the held value: delay plus mean age of a held sample (design note 3.8).
    pub as_seen_s: Option<Estimate>,
    /// Result of a fit on the held rows, if the channel is held.
    pub held_fit_s: Option<Estimate>,
    /// Smallest delay that this record would detect with a power of 80 %, s: 2.8 standard uncertainties.
    pub minimum_detectable_s: f64,
    /// Margin of the equivalence test, s.
    pub margin_s: f64,
    /// Margin of a delay that differs from zero, s: half the sampling interval of a slow channel would hide a large
    /// delay.
    #[serde(default)]
    pub strict_margin_s: f64,
    /// Record length needed for a verdict, s; only where it is inconclusive.
    pub deciding_length_s: Option<f64>,
}

impl DelayFinding {
    /// The margin used for the verdict, s: the strict one where the interval excludes zero.
    #[must_use]
    pub fn deciding_margin_s(&self) -> f64 {
        let [low, high] = self.interval_95_s;
        if low > 0.0 || high < 0.0 { self.strict_margin_s } else { self.margin_s }
    }
}

/// Noise about the reference: an Ornstein–Uhlenbeck process plus white noise, in the channel's unit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct NoiseFinding {
    /// Standard deviation of the wander; zero if the fit found no wander.
    pub wander_std: f64,
    /// Its correlation time, s.
    pub time_constant_s: f64,
    /// Standard deviation of the white part.
    pub white_std: f64,
    /// Robust standard deviation while the bar is at rest; `None` if it never is.
    pub static_std: Option<f64>,
    /// Smallest step between different values.
    pub resolution: Option<f64>,
}

/// One component of a channel.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ComponentDynamics {
    /// Its name, such as `north`, or `swing angle` for an attitude.
    pub name: String,
    /// Display unit, such as `m/s`.
    pub unit: String,
    /// Whether the swing excites it enough to count in the delay.
    pub excited: bool,
    /// Why it is not excited, in words; empty if it is.
    pub why_not: String,
    /// Gain: measured divided by reference.
    pub gain: Option<Estimate>,
    /// Frequency of the motion that the gain stands for, Hz: its mean over the motion, weighted as the fit weights it.
    /// `None` without a fit and in records of earlier versions.
    #[serde(default)]
    pub gain_frequency_hz: Option<f64>,
    /// Offset: measured less reference, unit.
    pub offset: Option<Estimate>,
    /// Drift of the offset, unit per second.
    pub drift: Option<Estimate>,
    /// Noise.
    pub noise: Option<NoiseFinding>,
    /// Delay estimated from this component alone, s.
    pub delay_s: Option<Estimate>,
    /// Curves over the whole record: the reference at the true time, the reference with the estimated delay (if any),
    /// then measured.
    pub curves: Vec<Curve>,
    /// The same curves over a few swings, not decimated.
    pub zoom: Vec<Curve>,
    /// Measured − fitted, unit.
    pub residual: Option<Curve>,
    /// Reference and measured values that can be overlaid; `None` without a fit and in records of earlier versions.
    #[serde(default)]
    pub overlay: Option<Overlay>,
}

/// A few swings of one component in which the measured values differ from the reference only by delay, gain and fast
/// noise: offset, drift and slow wander are removed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct Overlay {
    /// Reference at the true time, unit. It extends past the measured values by the largest shift.
    pub reference: Curve,
    /// Measured less offset, drift and slow wander, unit.
    pub measured: Curve,
    /// The slow wander that was removed; `None` where the fit found no wander.
    pub wander: Option<WanderTaken>,
    /// Residual over the whole record when the reference is shifted.
    pub shifts: ShiftCurve,
}

/// Slow wander, estimated as the mean of measured − fitted over several swings, weighted with a Hann window. Anything
/// at the swing frequency averages out, so an error of delay or gain is not removed with it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct WanderTaken {
    /// Full width of the window, s: four mean periods of the bar's angle.
    pub window_s: f64,
    /// Rms over the whole record, unit.
    pub rms: f64,
    /// Largest less smallest value within the swings that are drawn, unit.
    pub range_in_view: f64,
}

/// Rms of measured less reference over the whole record, the reference scaled by the fitted gain and shifted. Offset,
/// drift and slow wander are removed again at each shift.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ShiftCurve {
    /// First shift, s; a positive shift makes the reference late.
    pub from_s: f64,
    /// Step between shifts, s.
    pub step_s: f64,
    /// Rms at each shift, unit.
    pub rms: Vec<f64>,
}

/// Kind of lateness (design note 3.6).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ModelFinding {
    /// The fitted candidates.
    pub candidates: Vec<ModelCandidate>,
    /// Name of the chosen one, or `None` where they cannot be distinguished.
    pub chosen: Option<String>,
    /// Summary in words, with ΔBIC: the choice, or `not distinguished` and the candidates concerned.
    pub text: String,
    /// Delay plus lags of the best candidate: the group delay at low frequency, s; known much better than the parts.
    pub sum_s: Estimate,
}

/// A delay, a lag, or both.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ModelCandidate {
    /// `D` delay, `L` first-order lag, `DL` both, `DLL` delay and two lags, `D2` delay and second-order filter with complex
    /// poles, `DA` delay and moving average.
    pub name: String,
    /// Bayesian information criterion less that of the best candidate.
    pub delta_bic: f64,
    /// Delay, s; zero by definition for `L`.
    pub delay_s: Option<Estimate>,
    /// Lags, s; for `D2` the one number a₁ of `1/(1 + a₁s + a₂s²)`, by which slow motion is later, for `DA`
    /// half the average.
    pub lags_s: Vec<Estimate>,
    /// a₂ of `D2`, s².
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub square_s2: Option<Estimate>,
    /// Gain of the first excited component.
    pub gain: Estimate,
}

/// One frequency of a response, H1 = Sxy/Sxx (design note 9).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ResponsePoint {
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// Gain: measured divided by reference.
    pub gain: f64,
    /// Half width of the gain's 95 % interval.
    pub gain_u95: f64,
    /// Phase, rad, unwrapped; negative is late.
    pub phase_rad: f64,
    /// Half width of the phase's 95 % interval, rad.
    pub phase_u95: f64,
    /// Magnitude-squared coherence, 0 to 1.
    pub coherence: f64,
    /// Coherence above 0.6 and reference power above 1 % of the peak: only such points are reliable.
    pub reliable: bool,
}

/// Frequency response of one component.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ResponseFinding {
    /// Component used, which is the one with the most signal.
    pub component: String,
    /// Length of a segment, s.
    pub segment_s: f64,
    /// Effective number of averages.
    pub averages: f64,
    /// Points from low to high.
    pub points: Vec<ResponsePoint>,
    /// Phase of the fitted model at the same frequencies, rad.
    pub model_phase_rad: Vec<f64>,
    /// Gain of the fitted model.
    pub model_gain: Vec<f64>,
    /// −3 dB bandwidth of the fitted model, as text: `> 1.9 Hz` if beyond the last reliable point.
    pub bandwidth: String,
    /// −3 dB bandwidth, Hz, if within the excited band.
    pub bandwidth_hz: Option<f64>,
    /// Its standard uncertainty, Hz: of two lags the largest that their own uncertainties allow.
    #[serde(default)]
    pub bandwidth_u_hz: Option<f64>,
}

/// Diagnostics of the fit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct FitChecks {
    /// Autocorrelation of the whitened residuals: lags 1 to n, in samples.
    pub autocorrelation: Vec<f64>,
    /// Half width of its 95 % band for white residuals.
    pub autocorrelation_u95: f64,
    /// p-value of the Ljung–Box test over these lags.
    pub ljung_box_p: f64,
    /// Kurtosis of the whitened residuals; 3 for Gaussian.
    pub kurtosis: f64,
    /// Share of samples down-weighted by the robust fit, 0 to 1.
    pub downweighted_share: f64,
    /// Share of the samples more than four standard deviations off: 6 in 100 000 for Gaussian noise.
    #[serde(default)]
    pub outlier_share: f64,
    /// Objective over delay: −2 log likelihood above its minimum, with the fitted noise.
    pub objective: ObjectiveCurve,
    /// Another minimum that is nearly as good, s: the delay is ambiguous by one swing.
    pub second_minimum_s: Option<f64>,
}

/// The objective that was minimised, −2 log likelihood above the minimum of each curve, which is 0 at the delay of the
/// fit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ObjectiveCurve {
    /// Over the search range: delay, s.
    pub delay_s: Vec<f64>,
    /// The objective there.
    pub value: Vec<f64>,
    /// Close to the minimum: delay, s.
    pub near_delay_s: Vec<f64>,
    /// The objective there.
    pub near_value: Vec<f64>,
}

/// The delay over the record (design note 9).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct Stationarity {
    /// Length of the half-overlapping windows, s.
    pub window_s: f64,
    /// Middle of each window, s.
    pub t_s: Vec<f64>,
    /// Delay in each window, s.
    pub delay_s: Vec<Estimate>,
    /// p-value of the hypothesis that the delay is constant, from windows that do not overlap.
    pub constant_p: f64,
    /// Whether the delay significantly changes: p below 0.001, and not because of a lag.
    #[serde(default)]
    pub changes: bool,
    /// Slope, s/s: a clock's skew, or a queue that fills.
    pub slope: Estimate,
    /// Summary in words.
    pub text: String,
}

/// Arrival less device time, where both are logged.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct LatencyHistogram {
    /// Summary in words: which timestamps, and whether the number is absolute or above the fastest.
    pub text: String,
    /// Edges of the bins, s; one more than counts.
    pub edges_s: Vec<f64>,
    /// Number of samples in each bin.
    pub counts: Vec<u64>,
    /// Number of samples beyond the last edge.
    pub beyond: u64,
    /// Order statistics, s.
    pub latency_s: flight::Distribution,
}

/// One extra delay and gain injected into the second half of the real data and recovered against the first half. The
/// noise of the two estimates is independent, so the interval is tested.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct Injection {
    /// Delay added, s.
    pub injected_s: f64,
    /// Gain factor applied.
    pub injected_gain: f64,
    /// What was recovered, or why nothing was.
    pub recovered: Finding<Recovery>,
}

/// How well an injected delay and gain were recovered.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct Recovery {
    /// Delay recovered − injected, s.
    pub delay_error_s: Estimate,
    /// Gain recovered − injected.
    pub gain_error: Estimate,
}

/// Dynamics of one channel against the reference motion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ChannelDynamics {
    /// Name, such as `position.ins`.
    pub name: String,
    /// Quantity that it holds.
    pub quantity: Quantity,
    /// Timestamps with which its delay is measured.
    pub stamp_kind: StampKind,
    /// Clock of these timestamps as logged.
    pub clock: Clock,
    /// Reference against which the delay is measured.
    pub basis: TimeBasis,
    /// Number of rows of the channel, without held repeats.
    pub samples: u64,
    /// Rows not used by the fit, by reason.
    pub rejected: Vec<RejectCount>,
    /// Rows per second.
    pub rate_hz: Option<f64>,
    /// Updates per second: rows without held repeats.
    pub update_rate_hz: Option<f64>,
    /// Number of repeats of held values.
    pub held_rows: u64,
    /// Verdict on the delay.
    pub verdict: Verdict,
    /// The verdict in a sentence, with the number that decided it.
    pub reason: String,
    /// Predicted standard uncertainty before the fit, from swing, rate and noise, s (design note 3.1).
    pub predicted_s: Option<f64>,
    /// The delay.
    pub delay: Option<DelayFinding>,
    /// Its components.
    pub components: Vec<ComponentDynamics>,
    /// Delay or lag.
    pub model: Finding<ModelFinding>,
    /// Frequency response.
    pub response: Finding<ResponseFinding>,
    /// Checks of the fit.
    pub checks: Option<FitChecks>,
    /// Delay over the record.
    pub stationarity: Finding<Stationarity>,
    /// Jitter of the latency from residuals against slope (design note 3.9), s.
    pub jitter_s: Finding<Estimate>,
    /// Latency, if device time and arrival are logged.
    pub latency: Finding<LatencyHistogram>,
    /// Injection and recovery, one per delay in the rig file's list.
    pub injections: Vec<Injection>,
}

impl ChannelDynamics {
    /// Whether this channel is the anchor, on time by definition: every other delay is relative to it.
    #[must_use]
    pub fn is_anchor(&self) -> bool {
        let own = matches!(&self.basis, TimeBasis::Anchor { channel } if *channel == self.name);
        own && self.verdict == Verdict::NotMeasurable && self.delay.is_some()
    }
}

/// A number from the data, compared with the rig file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct MountCheck {
    /// Name of the quantity, such as `lever arm z of imu`.
    pub name: String,
    /// Display unit.
    pub unit: String,
    /// Value from the data, or why it is unavailable.
    pub fitted: Finding<Estimate>,
    /// Value from the rig file, if stated.
    pub stated: Option<f64>,
    /// Whether they agree (within three standard uncertainties and the check's tolerance); `None` if either is missing.
    pub agrees: Option<bool>,
    /// Whether a disagreement means that the rig file is wrong. A scale, by contrast, belongs to the sensor.
    #[serde(default)]
    pub of_rig: bool,
    /// Summary in words.
    pub text: String,
}

/// Mount and calibration (design note 1.6).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct MountFinding {
    /// `upright` or `hanging`, according to the data.
    pub detected: Finding<String>,
    /// The mount according to the rig file.
    pub stated: String,
    /// All comparisons.
    pub checks: Vec<MountCheck>,
    /// Magnetometer.
    pub magnetometer: Finding<MagnetometerFinding>,
}

/// Hard and soft iron, as far as the azimuths of the records show them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct MagnetometerFinding {
    /// `planar` (one azimuth) or `full` (three or more).
    pub kind: String,
    /// Azimuths of the swings, no two within 10°.
    pub azimuths: u64,
    /// Hard iron, in the channel's unit, body x, y, z.
    pub hard_iron: [Finding<Estimate>; 3],
    /// Soft iron and scale, row by row, body; identity for a perfect sensor.
    pub soft_iron: Vec<[f64; 3]>,
    /// Standard uncertainty of each of these; empty for a planar fit, which assumes some of them.
    #[serde(default)]
    pub soft_iron_standard_uncertainty: Vec<[f64; 3]>,
    /// Condition number of the fit, columns scaled to unit length: how many times worse its least known combination is
    /// than if the columns were independent. `None` for a planar fit.
    #[serde(default)]
    pub condition: Option<f64>,
    /// Rms of the residuals, in the channel's unit.
    pub residual_rms: f64,
    /// Magnitude of the measured field divided by the model's; `None` without a model.
    pub magnitude_ratio: Option<Estimate>,
    /// Measured dip less the model's, rad.
    pub dip_error_rad: Option<Estimate>,
    /// Summary in words.
    pub text: String,
}

/// Whether the bar bends (design note 1.6).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct Flexibility {
    /// Frequency of the motion to which both gains are converted, Hz; `None` in records of earlier versions.
    #[serde(default)]
    pub frequency_hz: Option<f64>,
    /// Gain of position, velocity and height.
    pub translation_gain: Estimate,
    /// Gain of attitude and rate.
    pub rotation_gain: Estimate,
    /// (rotation − 1)/(translation − 1): 1.38 to 1.50 for a bar that bends.
    pub ratio: Finding<Estimate>,
    /// First mode, Hz.
    pub first_mode_hz: Finding<Estimate>,
    /// First mode expected by the rig file, Hz.
    pub expected_hz: Option<f64>,
    /// Summary in words: the bar bends, the sensor's scale is off, or neither can be determined.
    pub text: String,
}
