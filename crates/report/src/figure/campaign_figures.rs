//! The figures of a campaign: how the removal affected each flight, and the error of one delay for a whole group.

use super::forest::{flights_axis, missing_words, newest};
use super::{Axis, Figure, Line, Panel, Pen, extent, is_drawable, pieces, stroke};
use crate::number;
use crate::text::label;
use record::{CampaignDelay, CampaignRecord, EffectVerdict, Estimate, FlightRow, GroupLateness, PooledSweep};

/// Error of the position as logged and after the removal, m.
fn errors(row: &FlightRow) -> Option<[f64; 2]> {
    row.delay_s?;
    let effect = row.effect.as_ref()?;
    let both = [effect.error_raw_m?.value, effect.error_compensated_m?.value];
    both.into_iter().all(|e| is_drawable(e) && e > 0.0).then_some(both)
}

/// Heights of flights, and their errors before and after.
fn effect_lines(all: &[(f64, [f64; 2])]) -> Vec<Line> {
    let points = |k: usize| all.iter().map(|(y, e)| vec![(e[k], *y); 3]).collect::<Vec<_>>();
    let ways = all.iter().map(|(y, e)| vec![(e[0], *y), (e[1], *y)]).collect();
    vec![
        Line { name: String::new(), pen: Pen::Faint, pieces: ways },
        Line { name: "as logged".to_owned(), pen: Pen::HollowPoints, pieces: points(0) },
        Line { name: "after removal".to_owned(), pen: Pen::Points, pieces: points(1) },
    ]
}

/// Error of each flight before and after a delay was removed; flights that got worse come first.
pub(crate) fn effects(record: &CampaignRecord) -> Option<Figure> {
    let is_harmed = |row: &FlightRow| row.effect.as_ref().is_some_and(|e| e.verdict == EffectVerdict::Harmed);
    let (mut rows, missing) = newest(&record.flights, |row| errors(row).is_some(), is_harmed);
    let worse = |row: &FlightRow| errors(row).map_or(0.0, |[raw, after]| after / raw);
    rows.sort_by(|a, b| worse(b).total_cmp(&worse(a)));
    let y = |k: usize| (rows.len() - k) as f64;
    let all: Vec<(f64, [f64; 2])> = rows.iter().enumerate().filter_map(|(k, row)| Some((y(k), errors(row)?))).collect();
    let lines = effect_lines(&all);
    let (least, largest) = extent(&lines, |p| p.0)?;
    let x = Axis::logarithmic("error of the position, 2‑D rms (m)", (least / 1.15, largest * 1.15));
    let verdict = |row: &&&FlightRow| row.effect.as_ref().is_some_and(|e| e.verdict == EffectVerdict::Helped);
    let helped = rows.iter().filter(verdict).count();
    let names: Vec<&str> = rows.iter().map(|row| row.flight.as_str()).collect();
    Some(Figure {
        id: "effect".to_owned(),
        number: 0,
        title: format!("The removal helped {helped} of {}", number::counted(all.len() as u64, "flight", "flights")),
        caption: format!(
            "Error (2‑D rms, m) before and after, of {}, the most harmed first.{}",
            number::counted(rows.len() as u64, "flight", "flights"),
            missing_words(missing, "the oldest that were not harmed")
        ),
        how_to_read: "Good: the full point lies left of the ring. Bad: it lies right of it. The error is against a \
                      reference if the log has one, otherwise from the remaining lateness.",
        panels: vec![Panel::of(x, flights_axis(&names), lines)],
        panel_size: (540, 24 + 15 * rows.len() as u32),
        fine: true,
    })
}

/// `Least error 0.031 m; the best delay is 203.1 ± 1.2 ms`. The curve only has grid delays, so the best
/// delay comes from the flights' own optima.
fn least_words(pooled: &PooledSweep, best: Option<&Estimate>) -> String {
    let what = if pooled.against_reference { "error" } else { "step at a fix" };
    let least = pooled.rms_m.iter().filter(|m| is_drawable(**m)).min_by(|a, b| a.total_cmp(b));
    let Some(least) = least else { return "One delay".to_owned() };
    let best = best.map_or(String::new(), |s| {
        format!("; the best delay is {}\u{a0}ms", number::with_uncertainty(&number::scaled(s, 1e3)))
    });
    format!("Least {what} {}\u{a0}m{best}", number::significant(*least, 2))
}

/// Known delays of a group, s, and the delays that were removed.
fn known_delays(group: &GroupLateness, delay: &CampaignDelay, removed_s: &[f64]) -> Vec<(&'static str, Pen, f64)> {
    let mut known = vec![];
    if let Some(card) = &delay.card_s {
        known.push(("sensor card", Pen::Dashed, card.value));
    }
    if let Some(lateness) = &group.lateness_s {
        let name =
            if group.against.starts_with("relative") { "position − velocity, mean" } else { "lateness of the group" };
        known.push((name, Pen::Rule, lateness.value));
    }
    if let Some(swept) = delay.swept.found() {
        known.push(("best of each flight, mean", Pen::Dotted, swept.delay_s.value));
    }
    known.extend(removed_s.iter().map(|removed| ("removed", Pen::Faint, *removed)));
    known
}

/// The score of the flights of a group over one delay for all of them. `None` without a curve.
/// `removed_s` are the delays that were removed.
pub(crate) fn valley(group: &GroupLateness, delay: &CampaignDelay, removed_s: &[f64], id: &str) -> Option<Figure> {
    let pooled = delay.curve.found()?;
    let x_ms: Vec<f64> = pooled.delay_s.iter().map(|s| s * 1e3).collect();
    let (curve, _) = pieces(&x_ms, &pooled.rms_m, &[]);
    let mut lines = vec![Line { name: "all flights of the group, 2‑D rms".to_owned(), pen: Pen::Raw, pieces: curve }];
    let x = Axis::linear("delay removed from all flights of the group (ms)", extent(&lines, |p| p.0)?, 8);
    let (what, unit, weight) = match pooled.against_reference {
        true => ("Error of the exact asynchronous form against the reference", "error, 2‑D rms (m)", "time flown"),
        false => {
            ("Step of the exact asynchronous form at each fix", "step at a fix, 2‑D rms (m)", "the number of fixes")
        }
    };
    let y = Axis::linear(unit, extent(&lines, |p| p.1)?, 6);
    for (name, pen, at_s) in known_delays(group, delay, removed_s) {
        let at = at_s * 1e3;
        if (x.low..=x.high).contains(&at) {
            lines.push(stroke(name, pen, vec![(at, y.low), (at, y.high)]));
        }
    }
    Some(Figure {
        id: id.to_owned(),
        number: 0,
        title: format!(
            "{}: {}",
            label(&group.group.name),
            least_words(pooled, delay.swept.found().map(|d| &d.delay_s))
        ),
        caption: format!(
            "{what} (2‑D rms, m) over one delay for {}, {}; mean squares weighted by {weight}.",
            number::counted(pooled.flights, "flight", "flights"),
            number::counted(pooled.samples, "sample", "samples")
        ),
        how_to_read: "Good: a clear valley with the removed delay at its bottom. Where flights differ, the valley is \
                      shallow. Its bottom then lies above the minima of the single flights: that is the cost of one \
                      delay for all.",
        panels: vec![Panel::of(x, y, lines)],
        panel_size: (860, 220),
        fine: false,
    })
}
