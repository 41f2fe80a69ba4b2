//! Verdicts in words: the same on every page and figure.

use crate::number;
use record::{ChannelDynamics, DelayFinding, DelaySource, Estimate, GroupLateness, Verdict};

/// The delay of the anchor channel.
pub(crate) const ZERO_BY_DEFINITION: &str = "0 by definition";

/// A verdict as one or two words.
pub(crate) fn word(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Delayed => "Late",
        Verdict::Early => "Early",
        Verdict::EquivalentToZero => "On time",
        Verdict::Inconclusive => "Not decided",
        Verdict::NotMeasurable => "Not measurable",
    }
}

/// The same with its number, e.g. `late by 400.3 ± 1.6 ms`.
pub(crate) fn phrase(channel: &ChannelDynamics) -> String {
    let Some(found) = &channel.delay else { return word(channel.verdict).to_lowercase() };
    if channel.is_anchor() {
        return "the anchor, on time by definition".to_owned();
    }
    let value = in_millis(&delay(found));
    let size = |sign: f64| number::with_uncertainty(&Estimate { value: sign * value.value, ..value });
    match channel.verdict {
        Verdict::Delayed => format!("late by {} ms", size(1.0)),
        Verdict::Early => format!("early by {} ms", size(-1.0)),
        Verdict::EquivalentToZero => format!("on time ({} ms)", size(1.0)),
        Verdict::Inconclusive => format!("not decided ({} ms)", size(1.0)),
        Verdict::NotMeasurable => format!("not measurable ({} ms, not reliable)", size(1.0)),
    }
}

/// The delay with its standard uncertainty, s.
pub(crate) fn delay(found: &DelayFinding) -> Estimate {
    Estimate { value: found.delay.seconds(), standard_uncertainty: Some(found.standard_uncertainty_s) }
}

/// Probability below which flights count as different.
pub(crate) const DIFFER_P: f64 = 0.01;
/// Probability from which flights count as equal.
pub(crate) const AGREE_P: f64 = 0.05;

/// Whether the lateness of a group is relative to a velocity of unknown lateness.
pub(crate) fn is_relative(group: &GroupLateness) -> bool {
    group.against.starts_with("relative")
}

/// Whether the flights of a group differ too much to share one number.
pub(crate) fn has_no_common_delay(group: &GroupLateness) -> bool {
    let differ = group.difference.is_some_and(|test| test.p < DIFFER_P);
    group.is_apart() || group.lateness_s.is_some() && is_relative(group) && differ
}

/// Seconds as milliseconds.
pub(crate) fn in_millis(seconds: &Estimate) -> Estimate {
    number::scaled(seconds, 1e3)
}

/// The source of a delay, in a few words.
pub(crate) fn source_phrase(source: DelaySource) -> &'static str {
    match source {
        DelaySource::Fixed => "stated in the pipeline",
        DelaySource::Card => "sensor card",
        DelaySource::Network => "the delay network",
        DelaySource::OthersFlights => "other flights of the group",
        DelaySource::OwnNetwork => "this flight's own lateness",
        DelaySource::Flight => "position against velocity of this flight",
        DelaySource::Sweep => "best of the sweep",
    }
}

/// The same in one word.
pub(crate) fn source_word(source: DelaySource) -> &'static str {
    match source {
        DelaySource::Fixed => "pipeline",
        DelaySource::Card => "card",
        DelaySource::Network => "network",
        DelaySource::OthersFlights => "other flights",
        DelaySource::OwnNetwork => "own",
        DelaySource::Flight => "flight",
        DelaySource::Sweep => "sweep",
    }
}
