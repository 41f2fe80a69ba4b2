//! A control chart: flights in flying order, the mean and limits of each stretch, and the steps.

use super::forest::{date_axis, late_mark, late_point, seconds};
use super::{Axis, Figure, Line, Mark, Panel, Pen, Span, extent, is_drawable, stroke};
use crate::number;
use record::{TrendChart, TrendPoint};

/// Maximum number of flights with a name on hover.
const MOST_NAMED: usize = 100;

/// The chart; `None` if there is nothing to draw.
pub(crate) fn control_chart(chart: &TrendChart, number: u32) -> Option<Figure> {
    let dates: Option<Vec<f64>> = chart.points.iter().map(|point| seconds(point.flown_at.as_deref()?)).collect();
    let by_date = dates.is_some();
    let at = dates.unwrap_or_else(|| (0..chart.points.len()).map(|k| k as f64 + 1.0).collect());
    let range = (at.iter().copied().reduce(f64::min)?, at.iter().copied().reduce(f64::max)?);
    let placed: Vec<(f64, &TrendPoint)> = at.iter().copied().zip(&chart.points).collect();
    let x = if by_date { date_axis(range) } else { Axis::linear("flight, in the order of the runs", range, 8) };
    let lines = lines(&placed);
    let y = Axis::linear("lateness (ms)", extent(&lines, |p| p.1)?, 5);
    let (names, spans) = (names(&placed), spans(chart, &placed));
    let name = chart.name();
    let steps = number::counted(chart.changes.len() as u64, "change", "changes");
    Some(Figure {
        id: format!("trend-{number}"),
        number,
        title: if chart.changes.is_empty() { format!("{name}: no change") } else { format!("{name}: {steps}") },
        caption: caption(chart, by_date),
        how_to_read: "Good: bars around one line, none beyond the dashes (± 3 σ). Bad: a shaded step (another firmware, rate, cable \
                      or receiver), and rings, which differ from the flights before and after them. About 3 flights of 1000 lie \
                      outside by chance. Point at a flight for its name.",
        panels: vec![Panel { names, spans, ..Panel::of(x, y, lines) }],
        panel_size: (540, 220),
        fine: chart.points.len() > 150,
    })
}

fn caption(chart: &TrendChart, by_date: bool) -> String {
    let older = match chart.older_points {
        0 => String::new(),
        older => format!(" {} are not drawn but are counted.", number::counted(older, "older flight", "older flights")),
    };
    format!(
        "Lateness (ms) of {}, {}, {}.{older}",
        number::counted(chart.points.len() as u64, "flight", "flights"),
        record::counted_from(&chart.datum),
        if by_date { "by date" } else { "in the order of the runs, because dates are unknown" }
    )
}

/// Names of the newest flights.
fn names(placed: &[(f64, &TrendPoint)]) -> Vec<Mark> {
    let newest = placed.iter().rev().take(MOST_NAMED);
    newest.filter_map(|(at, point)| late_mark(*at, &point.flight.flight, &point.lateness_s)).collect()
}

fn lines(placed: &[(f64, &TrendPoint)]) -> Vec<Line> {
    let of = |odd: bool| {
        let wanted = placed.iter().filter(move |(_, p)| (p.is_odd || p.is_outside) == odd);
        wanted.filter_map(|(at, p)| late_point(*at, &p.lateness_s)).collect::<Vec<_>>()
    };
    let level = |of: &dyn Fn(&TrendPoint) -> f64| {
        let place = |(at, p): &(f64, &TrendPoint)| Some((*at, of(p) * 1e3)).filter(|(_, y)| is_drawable(*y));
        placed.iter().filter_map(place).collect::<Vec<_>>()
    };
    let mut lines = vec![
        Line { name: "flight, ± U (k = 2)".to_owned(), pen: Pen::Points, pieces: of(false) },
        Line { name: "odd, or outside its limits".to_owned(), pen: Pen::HollowPoints, pieces: of(true) },
        stroke("mean between changes", Pen::Rule, level(&|p| p.centre_s)),
        stroke("limits, ± 3 σ", Pen::Dashed, level(&|p| p.centre_s + p.limit_s)),
        stroke("", Pen::Dashed, level(&|p| p.centre_s - p.limit_s)),
    ];
    lines.retain(|line| line.pieces.iter().any(|piece| !piece.is_empty()));
    lines
}

/// Each step as a span: from the last flight before it to the first one after it, or over its possible positions.
fn spans(chart: &TrendChart, placed: &[(f64, &TrendPoint)]) -> Vec<Span> {
    let place = |flight: &record::NamedFlight| placed.iter().position(|(_, point)| point.flight == *flight);
    let span = |change: &record::TrendChange| {
        let (first, last) = (place(&change.earliest)?, place(&change.latest)?);
        Some(Span { from: placed[first.saturating_sub(1)].0, to: placed[last].0, label: String::new() })
    };
    chart.changes.iter().filter_map(span).collect()
}
