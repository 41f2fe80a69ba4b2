//! The effect that other delays would have had on a flight, and the objective of the delay estimator.

use super::bench_figures::objective_panel;
use super::{Axis, Figure, Line, Panel, Pen, Span, extent, is_drawable, pieces, stroke, upright};
use crate::number::{self, COVERAGE_FACTOR};
use crate::text::label;
use crate::verdict::source_phrase;
use record::{DelayChoice, DelaySource, DelaySweep, MeasuredDelay, PairDelay, SweepScore};

/// Score over delay, with the delays from all sources. `None` if nothing can be drawn.
pub(crate) fn sweep_figure(sweep: &DelaySweep, choice: Option<&DelayChoice>) -> Option<Figure> {
    let x_ms: Vec<f64> = sweep.delay_s.iter().map(|s| s * 1e3).collect();
    let (curve, lost) = pieces(&x_ms, &sweep.rms_m, &[]);
    let mut lines = vec![Line { name: "2‑D rms".to_owned(), pen: Pen::Raw, pieces: curve }];
    extent(&lines, |p| p.0)?;
    lines.extend(stated(sweep));
    let x = Axis::linear("delay removed (ms)", extent(&lines, |p| p.0)?, 8);
    let (low, high) = extent(&lines, |p| p.1)?;
    let y = Axis::linear(y_label(&sweep.score), (low.max(0.0), high), 6);
    if let Some(point) = choice.and_then(|c| sweep.score_at(c.used)).filter(|p| is_drawable(p.delay_s.value)) {
        let at = point.delay_s.value * 1e3;
        lines.push(stroke("removed", Pen::Dashed, vec![(at, y.low), (at, y.high)]));
    }
    let mut panel = Panel::of(x, y, lines);
    panel.spans.extend(interval(sweep, &panel.x));
    let mut caption = format!("{} over the delay that is removed, in ms.", title(&sweep.score));
    if lost > 0 {
        caption += &format!(" Not drawn, because not finite or beyond 10¹²: {}.", number::count(lost as u64));
    }
    Some(Figure {
        id: "delay-sweep".to_owned(),
        number: 0,
        title: least_words(sweep),
        caption: caption
            + " Points are the delays that could be removed, with U (k = 2) of the score; the shaded stretch is the 95 \
               % interval of the best delay.",
        how_to_read: match &sweep.score {
            SweepScore::ErrorAgainst(_) => {
                "Good: the removed delay and the others lie in the shaded stretch, at the bottom of a clear valley. Bad: \
                 the removed delay lies up a slope: this flight is late by a different amount. A flat curve means that \
                 the delay hardly matters, because the flight hardly turned."
            }
            SweepScore::StepAtFixes => {
                "Good: a clear valley. Its bottom is the difference between position and velocity. If the velocity is late \
                 too, the removed delay lies right of it, by as much. A flat curve means that the delay hardly matters, \
                 because the flight hardly turned."
            }
        },
        panels: vec![panel],
        panel_size: (760, 230),
        fine: false,
    })
}

/// The delays from all sources.
fn stated(sweep: &DelaySweep) -> Vec<Line> {
    let with_card = sweep.score_at(DelaySource::Card).is_some();
    let pens = [
        (DelaySource::Sweep, Pen::Points),
        (DelaySource::Card, Pen::HollowPoints),
        (DelaySource::Flight, Pen::DoubtfulPoints),
        (DelaySource::Fixed, if with_card { Pen::Samples } else { Pen::HollowPoints }),
    ];
    let line = |(source, pen)| {
        let point = sweep.score_at(source)?;
        let half = COVERAGE_FACTOR * point.rms_m.standard_uncertainty.unwrap_or(0.0);
        let place = upright(point.delay_s.value * 1e3, point.rms_m.value, half)?;
        Some(stroke(source_phrase(source), pen, place))
    };
    pens.into_iter().filter_map(line).collect()
}

/// `Least at 203 ± 4 ms`.
fn least_words(sweep: &DelaySweep) -> String {
    match sweep.score_at(DelaySource::Sweep) {
        Some(best) => format!("Least at {}\u{a0}ms", number::with_uncertainty(&number::scaled(&best.delay_s, 1e3))),
        None => "No delay is the best".to_owned(),
    }
}

/// The optimum's interval, if it is on the axis.
fn interval(sweep: &DelaySweep, x: &Axis) -> Option<Span> {
    let [from, to] = sweep.optimum.found()?.interval_95_s.map(|s| s * 1e3);
    let (from, to) = (from.max(x.low), to.min(x.high));
    (from < to).then(|| Span { from, to, label: "best, 95 %".to_owned() })
}

fn y_label(score: &SweepScore) -> &'static str {
    match score {
        SweepScore::ErrorAgainst(_) => "error, 2‑D rms (m)",
        SweepScore::StepAtFixes => "step at a fix, 2‑D rms (m)",
    }
}

fn title(score: &SweepScore) -> String {
    match score {
        SweepScore::ErrorAgainst(reference) => {
            format!("Error of the exact asynchronous form against {} (2‑D rms, m)", label(reference))
        }
        SweepScore::StepAtFixes => "Step of the exact asynchronous form at each fix (2‑D rms, m)".to_owned(),
    }
}

/// Objective of the delay estimator near its minimum. `None` without a curve.
pub(crate) fn objective_figure(pair: &PairDelay, found: &MeasuredDelay) -> Option<Figure> {
    /// 95 % quantile of chi-squared with one degree of freedom.
    const LIMIT: f64 = 3.841;
    let curve = found.objective.as_ref()?;
    let at = (found.delay_s.value, found.interval_95_s);
    let mut near = objective_panel(&curve.near_delay_s, &curve.near_value, Some(at))?;
    near.lines.push(stroke("3.84, 95 % of χ²", Pen::Dotted, vec![(near.x.low, LIMIT), (near.x.high, LIMIT)]));
    Some(Figure {
        id: "delay-objective".to_owned(),
        number: 0,
        title: format!(
            "This pair alone: least at {}\u{a0}ms{}",
            number::with_uncertainty(&number::scaled(&found.delay_s, 1e3)),
            if found.rival_s.is_some() { ", and another that is almost as deep" } else { "" }
        ),
        caption: format!(
            "−2 ln L above its least over the delay of {} against {} in ms, near the least; noise as fitted, offsets and \
             drifts free at each delay. The band is the 95 % interval that the record states.",
            label(&pair.first),
            label(&pair.second)
        ),
        how_to_read: "Good: a round valley whose width at 3.84 is the band. The band may be wider than the curve at 3.84: the \
                      larger of two uncertainties is used.",
        panels: vec![near],
        panel_size: (760, 200),
        fine: false,
    })
}
