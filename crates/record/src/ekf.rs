//! What a filter designer needs to know about each channel: noise, wander, delay, rate.

#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Values for the design of a Kalman filter, from one flight.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct EkfValues {
    /// Channels, sorted by name.
    pub channels: Vec<EkfChannel>,
}

/// Values of one channel. Values that the flight does not provide are absent.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct EkfChannel {
    /// Name, such as `position.gps`.
    pub channel: String,
    /// Basis of the values: the pair that was fitted.
    pub rests_on: String,
    /// Updates per second, Hz.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rate_hz: Option<f64>,
    /// Values in the order in which they are explained.
    pub values: Vec<EkfValue>,
    /// Values that the channel does not provide, and why.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub remarks: Vec<String>,
}

/// Kind of value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum EkfValueKind {
    /// Standard deviation of the white noise of one sample.
    WhiteStd,
    /// Density of the white noise: its standard deviation times the root of the sampling interval.
    NoiseDensity,
    /// Standard deviation of the wander (first-order Gauss–Markov process).
    WanderStd,
    /// Correlation time of the wander, s.
    WanderTimeConstant,
    /// Density of the noise that drives the wander; for a slow wander, the density of the random walk.
    RandomWalkDensity,
    /// Bias of the integrated channel, as a standard deviation.
    BiasStd,
    /// How late the channel is, s; positive is late.
    Delay,
}

/// One value.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct EkfValue {
    /// Its kind.
    pub kind: EkfValueKind,
    /// The value.
    pub value: f64,
    /// Its standard uncertainty, if it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub standard_uncertainty: Option<f64>,
    /// Unit of both.
    pub unit: String,
    /// Formula or definition, in words.
    pub formula: String,
}

impl EkfChannel {
    /// The value of this kind.
    #[must_use]
    pub fn value(&self, kind: EkfValueKind) -> Option<&EkfValue> {
        self.values.iter().find(|value| value.kind == kind)
    }
}
