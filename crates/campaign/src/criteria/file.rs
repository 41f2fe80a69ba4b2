//! The criteria file as its author writes it. Every table rejects unknown keys.

#[cfg(feature = "schema")]
use super::metric::MetricName;
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::Deserialize;
use toml::Spanned;

/// Acceptance criteria of flights.
#[derive(Debug, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "schema", schemars(title = "flightlag criteria"))]
pub(super) struct CriteriaFile {
    /// Version of this file's layout: 1.
    #[cfg_attr(feature = "schema", schemars(with = "u32", range(min = 1, max = 1)))]
    pub(super) schema: Spanned<u32>,
    /// Title of this set of criteria on the pages.
    #[serde(default = "default_title")]
    pub(super) title: String,
    /// The criteria, in the order in which they are shown.
    #[serde(default)]
    #[cfg_attr(feature = "schema", schemars(with = "Vec<CriterionTable>", length(min = 1)))]
    pub(super) criterion: Vec<Spanned<CriterionTable>>,
}

fn default_title() -> String {
    "Criteria".to_owned()
}

/// One criterion: a metric, exactly one limit, and why.
#[derive(Debug, Clone, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub(super) struct CriterionTable {
    /// Name, unique in the file: letters, digits, `-`, `_` and `.`.
    #[cfg_attr(feature = "schema", schemars(with = "String", regex(pattern = "^[A-Za-z0-9._-]+$")))]
    pub(super) id: Spanned<String>,
    /// The requirement, as text.
    #[cfg_attr(feature = "schema", schemars(with = "String"))]
    pub(super) title: Spanned<String>,
    /// The measured quantity.
    #[cfg_attr(feature = "schema", schemars(with = "MetricName"))]
    pub(super) metric: Spanned<String>,
    /// With a metric of a compensator: its name, such as `raw`, `pade-1-1` (of the paper) or `exact-async`.
    #[cfg_attr(feature = "schema", schemars(with = "Option<String>"))]
    pub(super) compensator: Option<Spanned<String>>,
    /// With a metric of a channel: its name, such as `position.gps`. With a delay: the late channel. Default: the
    /// replayed one.
    #[cfg_attr(feature = "schema", schemars(with = "Option<String>"))]
    pub(super) channel: Option<Spanned<String>>,
    /// With a delay: the channel to compare with. Default: the replayed one.
    #[cfg_attr(feature = "schema", schemars(with = "Option<String>"))]
    pub(super) against: Option<Spanned<String>>,
    /// Upper limit: a number and its unit, such as "150 ms"; counts and ratios have no unit.
    #[cfg_attr(feature = "schema", schemars(with = "Option<LimitText>"))]
    pub(super) at_most: Option<Spanned<toml::Value>>,
    /// Lower limit.
    #[cfg_attr(feature = "schema", schemars(with = "Option<LimitText>"))]
    pub(super) at_least: Option<Spanned<toml::Value>>,
    /// Lower and upper limit, both inclusive.
    #[cfg_attr(feature = "schema", schemars(with = "Option<[LimitText; 2]>"))]
    pub(super) between: Option<Spanned<Vec<toml::Value>>>,
    /// How an uncertain number is decided. Default: interval.
    #[cfg_attr(feature = "schema", schemars(with = "Option<DecisionName>"))]
    pub(super) decision: Option<Spanned<String>>,
    /// Source of the limit: a standard, a requirement, a calculation.
    #[cfg_attr(feature = "schema", schemars(with = "String"))]
    pub(super) rationale: Spanned<String>,
    /// Flights that it applies to. Default: all.
    #[cfg_attr(feature = "schema", schemars(with = "Option<AppliesTable>"))]
    pub(super) applies_to: Option<Spanned<AppliesTable>>,
}

/// A number with its unit. Only the schema uses this type; the value is checked by hand for a better error
/// message.
#[cfg(feature = "schema")]
#[derive(JsonSchema)]
#[serde(untagged)]
#[allow(dead_code)]
enum LimitText {
    /// With a unit, such as "150 ms".
    WithUnit(String),
    /// A count or a ratio.
    Bare(f64),
}

/// How an uncertain number is decided.
#[cfg(feature = "schema")]
#[derive(JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[allow(dead_code)]
enum DecisionName {
    /// 95 % interval entirely inside the limit: PASS; entirely outside: FAIL; otherwise INCONCLUSIVE.
    Interval,
    /// Only the value decides. The verdict is wrong in half of all cases where the truth is at the limit.
    Value,
}

/// Flights that a criterion applies to: all given conditions must hold. `*` in a name matches anything.
#[derive(Debug, Clone, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub(super) struct AppliesTable {
    /// Names of flights: paths below the folder of flights.
    #[cfg_attr(feature = "schema", schemars(with = "Option<Vec<String>>"))]
    pub(super) flights: Option<Spanned<Vec<String>>>,
    /// Channel maps with which they were read.
    #[cfg_attr(feature = "schema", schemars(with = "Option<Vec<String>>"))]
    pub(super) maps: Option<Spanned<Vec<String>>>,
    /// Channels that the flight must have, all of them.
    #[cfg_attr(feature = "schema", schemars(with = "Option<Vec<String>>"))]
    pub(super) channels: Option<Spanned<Vec<String>>>,
    /// `true`: only flights with a reference to score against.
    #[cfg_attr(feature = "schema", schemars(with = "Option<bool>"))]
    pub(super) reference: Option<Spanned<bool>>,
    /// Only flights of at least this duration, such as "60 s".
    #[cfg_attr(feature = "schema", schemars(with = "Option<LimitText>"))]
    pub(super) duration_at_least: Option<Spanned<toml::Value>>,
}

/// The JSON schema of a criteria file, as text.
#[cfg(feature = "schema")]
pub(crate) fn criteria_schema() -> String {
    let schema = schemars::schema_for!(CriteriaFile);
    format!("{:#}\n", schema.as_value())
}
