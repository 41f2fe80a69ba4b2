//! The delay estimated from a flight itself, over time.

use super::{Axis, Figure, Line, Panel, Pen, extent, is_drawable, outline, stroke, upright};
use crate::number::{self, COVERAGE_FACTOR};
use crate::text::label;
use record::{MeasuredDelay, PairDelay, WindowDelay};

/// Maximum number of windows drawn; the record holds all.
const MOST_WINDOWS: usize = 300;

/// Delay of a pair in windows over the flight; `None` if no window can be drawn.
pub(crate) fn delay_over_time(pair: &PairDelay, found: &MeasuredDelay) -> Option<Figure> {
    let windows = || found.over_time.iter().take(MOST_WINDOWS);
    let pieces: Vec<_> = windows().filter_map(point).collect();
    let drawn = pieces.len();
    let mut lines = vec![
        Line { name: "length of a window".to_owned(), pen: Pen::Faint, pieces: windows().filter_map(length).collect() },
        Line { name: "window, ± U (k = 2)".to_owned(), pen: Pen::Points, pieces },
    ];
    extent(&lines[1..], |p| p.0)?;
    let x = Axis::record_time("time since the pair's origin", extent(&lines, |p| p.0)?, 10);
    lines.extend(whole_flight(found, &x));
    let y = Axis::linear("delay (ms)", extent(&lines, |p| p.1)?, 7);
    lines.extend(step(found, &x, &y));
    let mut caption = format!(
        "Delay of {} against {} in ms, in {}, over the time of the middle; positive is late.",
        label(&pair.first),
        label(&pair.second),
        if drawn == 1 { "one window".to_owned() } else { format!("{drawn} windows that do not overlap") },
    );
    if drawn < found.over_time.len() {
        caption +=
            &format!(" Not drawn, but in the record: {}.", number::count((found.over_time.len() - drawn) as u64));
    }
    Some(Figure {
        id: "delay-over-time".to_owned(),
        number: 0,
        title: format!(
            "This pair alone: {}\u{a0}ms over the whole flight{}",
            number::with_uncertainty(&number::scaled(&found.delay_s, 1e3)),
            if found.alarm.is_some() { "; the windows do not agree on one delay" } else { "" }
        ),
        caption,
        how_to_read: "Good: nearly all bars reach the band. Bad: a step (the receiver changed its mode, the logger its \
                      clock) or a slope (clocks that drift apart): then one delay for the whole flight is a \
                      compromise. Each window fits its own offsets and drifts, so its bar is longer than its share of \
                      the flight suggests.",
        panels: vec![Panel::of(x, y, lines)],
        panel_size: (860, 215),
        fine: false,
    })
}

fn millis(seconds: f64) -> f64 {
    seconds * 1e3
}

fn point(window: &WindowDelay) -> Option<Vec<(f64, f64)>> {
    let half = millis(COVERAGE_FACTOR * window.delay_s.standard_uncertainty.unwrap_or(0.0));
    length(window).and_then(|_| upright((window.start_s + window.end_s) / 2.0, millis(window.delay_s.value), half))
}

fn length(window: &WindowDelay) -> Option<Vec<(f64, f64)>> {
    let at = millis(window.delay_s.value);
    [window.start_s, window.end_s, at]
        .into_iter()
        .all(is_drawable)
        .then(|| vec![(window.start_s, at), (window.end_s, at)])
}

/// The delay of the whole flight, with its expanded uncertainty.
fn whole_flight(found: &MeasuredDelay, x: &Axis) -> Vec<Line> {
    let value = millis(found.delay_s.value);
    let half = millis(COVERAGE_FACTOR * found.delay_s.standard_uncertainty.unwrap_or(0.0));
    if !is_drawable(value) || !is_drawable(half) {
        return vec![];
    }
    let band = outline((x.low, value - half), (x.high, value + half));
    vec![
        Line { name: "whole flight, ± U".to_owned(), pen: Pen::Uncertainty, pieces: vec![band] },
        stroke("whole flight", Pen::Rule, vec![(x.low, value), (x.high, value)]),
    ]
}

/// Where the delay stepped, if the analysis raised an alarm.
fn step(found: &MeasuredDelay, x: &Axis, y: &Axis) -> Option<Line> {
    let at = found.alarm.as_ref().and(found.homogeneity.as_ref())?.largest_step.at_s;
    (x.low..=x.high).contains(&at).then(|| stroke("largest step", Pen::Dotted, vec![(at, y.low), (at, y.high)]))
}
