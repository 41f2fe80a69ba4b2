//! Metrics of a flight: the vocabulary of criteria files.

use super::unit::Dimension;
#[cfg(feature = "schema")]
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};

/// Additional keys of a criterion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Takes {
    /// None.
    Nothing,
    /// `compensator`, required.
    Compensator,
    /// `channel`, required.
    Channel,
    /// `channel` and `against`, optional. Default: the replayed pair.
    Pair,
}

/// Possible values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Range {
    Signed,
    Positive,
    Share,
}

/// Description of a metric.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MetricEntry {
    pub(crate) metric: Metric,
    /// Its name in the file.
    pub name: &'static str,
    /// Its name on a page.
    pub symbol: &'static str,
    /// Its dimension.
    pub dimension: Dimension,
    /// Whether it has an uncertainty, so that its interval decides.
    pub uncertain: bool,
    /// Additional keys.
    pub takes: Takes,
    pub(crate) range: Range,
    /// Description for users.
    pub about: &'static str,
}

/// A metric with an uncertainty.
const UNSURE: bool = true;
/// A metric that has no uncertainty.
const PLAIN: bool = false;

/// Declares [`Metric`] and [`METRICS`] from one table: metric, name in the file, name on a page, dimension, uncertainty,
/// additional keys, range and description.
macro_rules! metrics {
    ($($metric:ident $name:literal $symbol:literal: $dimension:ident $uncertain:ident $takes:ident $range:ident
        $about:literal;)*) => {
        /// A number in the record of a flight.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub(crate) enum Metric {
            $($metric,)*
        }

        /// Every metric, as `flightlag criteria` lists them.
        pub const METRICS: &[MetricEntry] = &[$(MetricEntry {
            metric: Metric::$metric,
            name: $name,
            symbol: $symbol,
            dimension: Dimension::$dimension,
            uncertain: $uncertain,
            takes: Takes::$takes,
            range: Range::$range,
            about: $about,
        },)*];
    };
}

metrics! {
    Delay "delay" "Td(position), one pair": Time UNSURE Pair Signed
        "How late position is against velocity, from this one pair of the flight; positive is late. All pairs together: \
         lateness.";
    Lateness "lateness" "T(position)": Time UNSURE Nothing Signed
        "How late position is, from all pairs of the flight together; positive is late. Not evaluated where the flight \
         shows only how much later it is than the velocity: delay.";
    LatenessExpandedUncertainty "lateness-expanded-uncertainty" "U of T(position)": Time PLAIN Nothing Positive
        "Expanded uncertainty (k = 2) of the lateness.";
    DelayVaries "delay-varies" "delay varies": Count PLAIN Nothing Positive
        "1 if a change of the delay was detected during the flight, 0 if it stays the same; not evaluated if the flight \
         does not show it.";
    VelocityDelay "velocity-delay" "Td(velocity)": Time UNSURE Pair Signed
        "How late velocity is against integrated acceleration, measured from the flight itself.";
    DelayAgainstReference "delay-against-reference" "Td(position against reference)": Time UNSURE Pair Signed
        "How late position is against the reference position, measured from the flight itself.";
    VelocityDelayAgainstReference "velocity-delay-against-reference" "Td(velocity against reference)": Time UNSURE Pair Signed
        "How late velocity is against the reference position, measured from the flight itself.";
    DelayDifference "delay-difference" "T(flight) − stated delay": Time UNSURE Nothing Signed
        "Lateness measured from the flight minus the stated delay: that of the sensor card or, without a card, that of \
         the pipeline. Both need an uncertainty.";
    DelayNormalisedDifference "delay-normalised-difference" "|E_n| of flight and stated delay": Ratio PLAIN Nothing Positive
        "|E_n|: magnitude of that difference over √(U₁² + U₂²), the U of the two, k = 2 (ISO 13528). At most 1 means that \
         both agree. Both need an uncertainty.";
    DelayChange "delay-change" "Change of Td over the flight": Time UNSURE Pair Positive
        "Magnitude of the step of the delay where the flight is split in two so that the delays before and after differ \
         most. The interval is widened for the number of splits that were tried.";
    DelayExpandedUncertainty "delay-expanded-uncertainty" "U of Td(position), one pair": Time PLAIN Pair Positive
        "Expanded uncertainty (k = 2) of the delay between position and velocity, from this one pair. That of all pairs \
         together: lateness-expanded-uncertainty.";
    SmallestDetectableDelayChange "smallest-detectable-delay-change" "Smallest detectable Td": Time PLAIN Pair Positive
        "Delay that a test at 5 % would detect in this flight with a probability of 80 %.";
    InjectionError "injection-error" "Error of recovering an injected delay": Time UNSURE Pair Signed
        "Worst error in recovering a known delay that was injected into half of the flight.";
    MovingShare "moving-share" "Share of motion that shows a delay": Share PLAIN Pair Share
        "Share of the motion that is left after offset and drift are removed: 0 in straight and steady flight.";
    ErrorRms "error-rms" "Error against the reference, 2‑D rms": Length UNSURE Compensator Positive
        "2-D rms error of a compensator (or `raw`) against the reference position.";
    ErrorP95 "error-p95" "Error against the reference, 2‑D 95th percentile": Length UNSURE Compensator Positive
        "2-D 95th percentile of the error of a compensator (or `raw`) against the reference position.";
    ErrorRatio "error-ratio" "Error rms over raw error rms": Ratio UNSURE Compensator Positive
        "2-D rms error of a compensator over that of the raw position: below 1 it helps. The uncertainty is the largest \
         for any correlation of the two.";
    CorrectionRms "correction-rms" "Raw − compensated, 2‑D rms": Length UNSURE Compensator Positive
        "How far a compensator moves the raw position, 2-D rms.";
    StepAtFixRms "step-at-fix-rms" "Step at a fix, 2‑D rms": Length UNSURE Compensator Positive
        "How far the output of a compensator (or `raw`) jumps when the next fix arrives, 2-D rms.";
    ErrorMax "error-max" "Largest error against the reference, 2‑D": Length PLAIN Compensator Positive
        "Largest 2-D error of a compensator (or `raw`) against the reference position.";
    AlongTrackRms "along-track-rms" "Error along the track, rms": Length UNSURE Compensator Positive
        "Error of a compensator (or `raw`) against the reference along the track, rms: where a delay shows.";
    AcrossTrackRms "across-track-rms" "Error across the track, rms": Length UNSURE Compensator Positive
        "Error of a compensator (or `raw`) against the reference across the track, rms.";
    ResidualDelay "residual-delay" "Residual delay against the velocity": Time UNSURE Compensator Signed
        "How late the output of a compensator still is against integrated velocity: zero if everything was removed and \
         the velocity is on time. Not evaluated where the removed delay was measured in the same flight, because it is \
         then zero by construction.";
    ResidualDelayAgainstReference "residual-delay-against-reference" "Residual delay against the reference": Time UNSURE Compensator Signed
        "How late the output of a compensator still is against the reference.";
    LeadError "lead-error" "Lead minus the delay given": Time UNSURE Compensator Signed
        "Distance along the track by which the output leads the raw position, divided by the ground speed, minus the \
         delay that the compensator was given.";
    StepCorrelation "step-correlation" "Correlation of steps at fixes with the way flown": Ratio UNSURE Compensator Signed
        "Correlation of the output's steps at the fixes with the way flown between them: 1 for raw, 0 after compensation.";
    Hysteresis "hysteresis" "Offset between opposite passes, along the track": Length UNSURE Compensator Signed
        "Offset along the track between passes over the same place in opposite directions: positive if both trail, as a \
         late position does.";
    StraightAcrossRms "straight-across-rms" "Correction across straight legs, rms": Length UNSURE Compensator Positive
        "How far a compensator moves the position sideways on straight legs, rms, where it should not move it.";
    StraightNoiseRatio "straight-noise-ratio" "Noise over raw noise on straight legs": Ratio UNSURE Compensator Positive
        "Noise of a compensator's output over the raw noise on straight legs: above 1 it adds noise.";
    MotionHelpedShare "motion-helped-share" "Share of the motion that is helped": Share PLAIN Compensator Share
        "Share of the power of the flight's velocity at frequencies at which the compensator helps.";
    MotionHarmedShare "motion-harmed-share" "Share of the motion that is made worse": Share PLAIN Compensator Share
        "Share of the power of the flight's velocity at frequencies at which the compensator is worse than raw.";
    OnboardDifferenceRms "onboard-difference-rms" "Onboard position minus replay, 2‑D rms": Length PLAIN Compensator Positive
        "Compensated position that the aircraft computed in flight minus the replay of a compensator, 2-D rms after the \
         start.";
    ErrorAtBenchValue "error-at-bench-value" "Error rms at the bench value of Td": Length UNSURE Nothing Positive
        "2-D rms error against the reference of the exact form with the delay of the sensor card, whichever delay was \
         removed: would this flight meet the limit with the bench value?";
    StepAtBenchValue "step-at-bench-value" "Step at a fix at the bench value of Td": Length UNSURE Nothing Positive
        "2-D rms step at the fixes of the exact form with the delay of the sensor card, for flights without a reference.";
    DelayOfLeastError "delay-of-least-error" "Td of least error": Time UNSURE Nothing Signed
        "The delay whose removal fits the flight best: the optimum of its delay sweep.";
    ValidShare "valid-share" "Time with a valid compensated position": Share PLAIN Nothing Share
        "Share of the time covered that has a valid compensated position.";
    Duration "duration" "Time covered": Time PLAIN Nothing Positive
        "From the first to the last row that has position and velocity.";
    SpeedMedian "speed-median" "Ground speed, median": Speed PLAIN Nothing Positive
        "Median ground speed.";
    LongestPositionGap "longest-position-gap" "Longest time without a position fix": Time PLAIN Nothing Positive
        "Longest time without a position fix.";
    PositionResets "position-resets" "Position resets": Count PLAIN Nothing Positive
        "Fixes that jump against integrated velocity by more than five sigma of the neighbouring fixes.";
    BridgedGaps "bridged-gaps" "Velocity gaps bridged": Count PLAIN Nothing Positive
        "Velocity gaps short enough to be bridged.";
    Restarts "restarts" "Restarts after velocity gaps": Count PLAIN Nothing Positive
        "Velocity gaps too long to be bridged: the compensators restarted.";
    PositionRate "position-rate" "Rate of the position": Rate PLAIN Nothing Positive
        "Updates per second of the position that was replayed, outside gaps.";
    VelocityRate "velocity-rate" "Rate of the velocity": Rate PLAIN Nothing Positive
        "Updates per second of the velocity that was replayed, outside gaps.";
    ChannelRate "channel-rate" "Rate": Rate PLAIN Channel Positive
        "Updates per second of a channel, outside gaps.";
    ChannelLongestStep "channel-longest-step" "Longest step between timestamps": Time PLAIN Channel Positive
        "Longest time between two timestamps of a channel.";
    ChannelUsedShare "channel-used-share" "Rows used": Share PLAIN Channel Share
        "Share of the rows of a channel that could be used.";
    BytesDamaged "bytes-damaged" "Bytes damaged": Bytes PLAIN Nothing Positive
        "Bytes of the log that could not be read or failed a checksum.";
    DamagedShare "damaged-share" "Share of the log that is damaged": Share PLAIN Nothing Share
        "Share of the bytes of the log that could not be read or failed a checksum.";
    MessagesUndecodable "messages-undecodable" "Messages that could not be decoded": Count PLAIN Nothing Positive
        "Messages or rows that were found and could not be decoded.";
    Losses "losses" "Notices of lost data": Count PLAIN Nothing Positive
        "Notices of severity loss.";
    Warnings "warnings" "Warnings": Count PLAIN Nothing Positive
        "Notices of severity warning.";
}

impl MetricEntry {
    /// The metric of a name; else an error with the nearest names, or all.
    pub(crate) fn of(name: &str) -> Result<&'static MetricEntry, String> {
        METRICS.iter().find(|m| m.name == name).ok_or_else(|| {
            let near = |m: &&MetricEntry| name.split('-').any(|word| word.len() > 2 && m.name.contains(word));
            let mut names: Vec<&str> = METRICS.iter().filter(near).map(|m| m.name).collect();
            if names.is_empty() {
                names = METRICS.iter().map(|m| m.name).collect();
            }
            let hint = MetricEntry::nearest(name).map_or(String::new(), |m| format!("did you mean `{}`? ", m.name));
            format!("no metric is called `{name}`; {hint}known are {} (all: flightlag criteria)", names.join(", "))
        })
    }

    /// The metric with the most likely name.
    pub(crate) fn nearest(name: &str) -> Option<&'static MetricEntry> {
        let near = settings::likely(name, METRICS.iter().map(|m| m.name))?;
        METRICS.iter().find(|m| m.name == near)
    }
}

/// The names of all metrics, for the schema.
#[cfg(feature = "schema")]
pub(crate) struct MetricName;

#[cfg(feature = "schema")]
impl JsonSchema for MetricName {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Metric".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        let one = |m: &MetricEntry| json_schema!({ "const": m.name, "description": m.about });
        let all: Vec<Schema> = METRICS.iter().map(one).collect();
        json_schema!({ "description": "The measured quantity.", "oneOf": all })
    }
}
