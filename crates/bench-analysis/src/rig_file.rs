//! The rig file as its author writes it. Every table refuses keys that it does not know.

use crate::rig::{MountKind, StampChoice};
use record::SensorIdentity;
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::Deserialize;
use toml::Spanned;

/// The bench, as known before a record is analysed.
#[derive(Debug, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "schema", schemars(title = "flightlag rig"))]
pub(crate) struct RigFile {
    /// Version of this file's layout: 1.
    #[cfg_attr(feature = "schema", schemars(with = "u32", range(min = 1, max = 1)))]
    pub(crate) schema: Spanned<u32>,
    /// Name of the bench, for the pages. Default: Swing bench.
    #[serde(default = "default_title")]
    pub(crate) title: String,
    /// The sensor on the bar.
    #[cfg_attr(feature = "schema", schemars(with = "SensorIdentity"))]
    pub(crate) sensor: Spanned<SensorIdentity>,
    /// The bar.
    pub(crate) bar: BarTable,
    /// The encoder at the pivot.
    #[serde(default)]
    pub(crate) encoder: EncoderTable,
    /// Place and date of the record.
    #[serde(default)]
    pub(crate) site: SiteTable,
    /// Positions of the parts of the sensor on the bar. For a channel, the first entry that names it is used.
    #[serde(default)]
    pub(crate) mount: Vec<MountTable>,
    /// Relation of the timestamps of encoder and sensor.
    #[serde(default)]
    pub(crate) clock: ClockTable,
    /// Settings of the delay search.
    #[serde(default)]
    pub(crate) analysis: AnalysisTable,
    /// Settings of the sensor card.
    #[serde(default)]
    pub(crate) card: CardTable,
}

fn default_title() -> String {
    "Swing bench".to_owned()
}

#[derive(Debug, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct BarTable {
    /// Distance from the pivot to the sensor, m.
    #[cfg_attr(feature = "schema", schemars(with = "f64", range(min = 0.05, max = 50.0)))]
    pub(crate) length_m: Spanned<f64>,
    /// Position of the sensor at bar angle zero.
    #[cfg_attr(feature = "schema", schemars(with = "MountKind"))]
    pub(crate) mount: Spanned<MountKind>,
    /// Azimuth of the swing plane (direction of the body's x axis at rest), from north over east, deg. Default: fitted.
    #[cfg_attr(feature = "schema", schemars(with = "Option<f64>", range(min = -360.0, max = 360.0)))]
    pub(crate) azimuth_deg: Option<Spanned<f64>>,
    /// Expected first bending mode, Hz.
    #[cfg_attr(feature = "schema", schemars(with = "Option<f64>", range(min = 0.1, max = 1000.0)))]
    pub(crate) first_mode_hz: Option<Spanned<f64>>,
}

#[derive(Debug, Default, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub(crate) struct EncoderTable {
    /// Its channel. Default: the only encoder in the log.
    pub(crate) channel: Option<String>,
    /// Lines per revolution. Default: inferred from the smallest step of an angle; required for counts.
    #[cfg_attr(feature = "schema", schemars(with = "Option<u32>", range(min = 4, max = 67_108_864)))]
    pub(crate) counts_per_rev: Option<Spanned<u32>>,
    /// Counts per line: 1, 2 or 4. Default: 1.
    #[cfg_attr(feature = "schema", schemars(with = "Option<u32>"))]
    pub(crate) decoding: Option<Spanned<u32>>,
    /// 1 if the count rises with the angle of the bar (body x turning up), otherwise -1. Default: fitted.
    #[cfg_attr(feature = "schema", schemars(with = "Option<i32>"))]
    pub(crate) sign: Option<Spanned<i32>>,
    /// Angle of the bar at count 0, deg. Default: fitted.
    #[cfg_attr(feature = "schema", schemars(with = "Option<f64>", range(min = -360.0, max = 360.0)))]
    pub(crate) zero_deg: Option<Spanned<f64>>,
}

#[derive(Debug, Default, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub(crate) struct SiteTable {
    /// Latitude, deg, positive north. Default: from the geodetic position in the log, if there is one.
    #[cfg_attr(feature = "schema", schemars(with = "Option<f64>", range(min = -90.0, max = 90.0)))]
    pub(crate) latitude_deg: Option<Spanned<f64>>,
    /// Longitude, deg, positive east.
    #[cfg_attr(feature = "schema", schemars(with = "Option<f64>", range(min = -180.0, max = 360.0)))]
    pub(crate) longitude_deg: Option<Spanned<f64>>,
    /// Height above the ellipsoid, m. Default: 0.
    #[cfg_attr(feature = "schema", schemars(with = "Option<f64>", range(min = -1000.0, max = 10_000.0)))]
    pub(crate) height_m: Option<Spanned<f64>>,
    /// Day of the record, yyyy-mm-dd, used if the log does not state it.
    #[cfg_attr(feature = "schema", schemars(with = "Option<String>"))]
    pub(crate) date: Option<Spanned<String>>,
    /// Gravity, m/s². Default: from latitude and height.
    #[cfg_attr(feature = "schema", schemars(with = "Option<f64>", range(min = 9.7, max = 9.9)))]
    pub(crate) gravity_mps2: Option<Spanned<f64>>,
    /// The magnetic field at the bench. Default: fit.
    #[cfg_attr(feature = "schema", schemars(with = "Option<FieldName>"))]
    pub(crate) field: Option<Spanned<toml::Value>>,
}

/// Where the magnetic field comes from. Only the schema reads this type; the value is checked by hand, for the
/// sake of its error message.
#[cfg(feature = "schema")]
#[derive(JsonSchema)]
#[serde(untagged)]
#[allow(dead_code)]
enum FieldName {
    /// By name.
    Named(FieldRule),
    /// As measured.
    Stated(StatedField),
}

/// Source of the magnetic field.
#[cfg(feature = "schema")]
#[derive(JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[allow(dead_code)]
enum FieldRule {
    /// Fitted: indoors, the field differs from any model by tens of microtesla.
    Fit,
    /// World Magnetic Model at site and date.
    Wmm,
}

/// Measured field, nT.
#[derive(Debug, Clone, Copy, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct StatedField {
    /// North, nT.
    pub(crate) north_nt: f64,
    /// East, nT.
    pub(crate) east_nt: f64,
    /// Down, nT.
    pub(crate) down_nt: f64,
}

#[derive(Debug, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub(crate) struct MountTable {
    /// Channel names; `*` at the end of a name matches anything.
    #[cfg_attr(feature = "schema", schemars(with = "Vec<String>"))]
    pub(crate) channels: Spanned<Vec<String>>,
    /// Lever arm from the pivot to this part, body axes (x, y, z), m. Default: along the bar, by bar.mount and
    /// bar.length_m.
    #[cfg_attr(feature = "schema", schemars(with = "Option<[f64; 3]>"))]
    pub(crate) lever_arm_m: Option<Spanned<[f64; 3]>>,
    /// Rotation vector from the sensor axes to the body axes, deg. Default: 0, 0, 0.
    #[cfg_attr(feature = "schema", schemars(with = "Option<[f64; 3]>"))]
    pub(crate) rotation_deg: Option<Spanned<[f64; 3]>>,
    /// Sensor axes that are body x, y and z: `x`, `-y` and so on. Default: x, y, z.
    #[cfg_attr(feature = "schema", schemars(with = "Option<[String; 3]>"))]
    pub(crate) axes: Option<Spanned<[String; 3]>>,
}

#[derive(Debug, Default, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub(crate) struct ClockTable {
    /// Whether encoder and sensor have timestamps of one clock. Default: yes for one log with timestamps of one clock,
    /// otherwise no.
    pub(crate) shared: Option<bool>,
    /// Channel that is assumed to be on time where clocks differ. Default: the first angular rate of the sensor.
    #[cfg_attr(feature = "schema", schemars(with = "Option<String>"))]
    pub(crate) anchor: Option<Spanned<String>>,
    /// Kind of timestamps of the sensor that is used. Default: auto.
    pub(crate) stamps: Option<StampChoice>,
}

#[derive(Debug, Default, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub(crate) struct AnalysisTable {
    /// Search range of delays, first and last, s. Default: -1.0, 1.5.
    #[cfg_attr(feature = "schema", schemars(with = "Option<[f64; 2]>"))]
    pub(crate) search_s: Option<Spanned<[f64; 2]>>,
    /// Margin below which a delay counts as no delay, ms. Default: half the update interval of each channel, at least 5
    /// ms.
    #[cfg_attr(feature = "schema", schemars(with = "Option<f64>", range(min = 0.01, max = 1000.0)))]
    pub(crate) margin_ms: Option<Spanned<f64>>,
    /// Whether the offsets of position, velocity and height may drift. Default: true.
    pub(crate) drift: Option<bool>,
    /// Delays injected into the data and measured again, ms. Default: 5, 50.
    #[cfg_attr(feature = "schema", schemars(with = "Option<Vec<f64>>"))]
    pub(crate) inject_ms: Option<Spanned<Vec<f64>>>,
    /// Gain injected with them. Default: 1.05.
    #[cfg_attr(feature = "schema", schemars(with = "Option<f64>", range(min = 0.5, max = 2.0)))]
    pub(crate) inject_gain: Option<Spanned<f64>>,
}

#[derive(Debug, Default, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub(crate) struct CardTable {
    /// Validity of the card after the newest record, days. Default: no end.
    #[cfg_attr(feature = "schema", schemars(with = "Option<u32>", range(min = 1, max = 36_500)))]
    pub(crate) valid_days: Option<Spanned<u32>>,
}

/// The JSON schema of a rig file, as text.
#[cfg(feature = "schema")]
#[must_use]
pub fn rig_schema() -> String {
    let schema = schemars::schema_for!(RigFile);
    format!("{:#}\n", schema.as_value())
}
