//! A delay that may vary during a flight.
//!
//! The order is: first the delay that may vary, with its noise; then the test whether it varies; then the name for it
//! (`delay-over-time.md`). [`analyse`] takes slices and returns a [`record::DelayOverTime`].

mod bin_statistics;
mod bins;
mod change;
mod coarse;
mod comparison;
mod constancy;
mod delays;
#[cfg(test)]
mod dense;
mod describe;
#[cfg(test)]
mod example;
mod fixes;
mod input;
mod jitter;
mod motion;
mod noise_shape;
mod odd;
mod parts;
mod ramps;
mod refine;
mod settings;
mod shape;
mod stages;
mod stamps;
mod verdict;
mod whitening;
mod windows;
mod words;

pub use crate::input::{CannotAnalyse, PositionAgainstVelocity};
pub use crate::settings::OverTimeSettings;

use record::{DelayKind, DelayOverTime, Estimate};

/// How the delay of a position against a velocity behaves over a flight. Positive is late.
///
/// The same input gives the same result: random draws come from a generator with a fixed seed. All instants in the
/// result are on the clock of the timestamps. The cost is bounded: about 15 ms for ten minutes of 10 Hz fixes with a
/// constant delay, 70 ms with a varying one, 80 ms for two hours (`examples/over_time_study.rs`, one core).
///
/// # Errors
/// Why the input cannot be analysed, in words. A flight with too little motion is not an error: its kind is
/// [`record::DelayKind::CannotTell`].
pub fn analyse(record: &PositionAgainstVelocity, settings: &OverTimeSettings) -> Result<DelayOverTime, CannotAnalyse> {
    record.check()?;
    input::check_range(settings.search_s)?;
    input::check_range(settings.wide_search_s)?;
    let found = stages::run(record, settings);
    let verdict = verdict::judge(&found, settings);
    let level_s = match verdict.level.and_then(verdict::estimate) {
        Some(level) => level,
        None => {
            let value = found.map.as_ref().map_or(0.0, |m| m.constant_s);
            Estimate { value, standard_uncertainty: None }
        }
    };
    let curve = verdict::curve(&found, &verdict);
    let sure = |pick: fn(&delays::Delays) -> delays::Effect| {
        let effect = pick(&found.test.as_ref()?.all);
        verdict::estimate(effect).filter(|_| effect.size.abs() > 3.0 * effect.uncertainty)
    };
    Ok(DelayOverTime {
        kind: verdict.kind,
        words: words::sentence(&found, &verdict),
        level_s,
        level_widening_s: verdict.widening_s,
        jitters: verdict::jitter_record(&found),
        jitter_limit_s: found.jitter.limit_s,
        late_fixes: found.odd.late.clone(),
        odd_fixes: found.odd.rows.len() as u64,
        bursts: found.queued.bursts.clone(),
        curve,
        terms: verdict::terms(&found),
        span_s: verdict.shape.as_ref().map_or(0.0, shape::Shape::span_s),
        lever_arm_m: sure(|d| d.lever_m),
        speed_after_direction_s: sure(|d| d.speed_lag_s),
        remarks: words::remarks(&found, &verdict),
        two_delays_fit: verdict.two_delays,
        unplaced_change: verdict.change_on_bins.is_some() && verdict.kind == DelayKind::CannotTell,
        search_s: found.search_s,
        edge_hit: found.map.as_ref().is_some_and(|m| m.edge),
        advice: words::advice(&verdict),
        what_to_fly: words::what_to_fly(&found, &verdict, settings),
        fixes_used: found.fixes_used as u64,
        fixes_given: record.t.len() as u64,
        constancy: verdict.constancy,
    })
}
