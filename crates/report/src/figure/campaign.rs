//! The figures of a campaign: how large is each correction, and what the flights say of the delay.

use super::axis::Tick;
use super::{Axis, Figure, Line, Panel, Pen, extent, is_drawable, pieces, stroke, upright};
use crate::number::{self, COVERAGE_FACTOR};
use record::{CampaignDelay, CampaignRecord, ControlPoint, FlightRow};

/// Correction over the way flown in Td at median speed, a point for each flight, with its
/// expanded uncertainty. `None` if no flight has both.
pub(crate) fn overview(record: &CampaignRecord) -> Option<Figure> {
    let points: Vec<_> = record.flights.iter().filter_map(|row| Some((row.lossy, point(row)?))).collect();
    let largest = points.iter().flat_map(|(_, p)| [p.way, p.high]).fold(0.0, f64::max);
    if points.is_empty() || largest <= 0.0 {
        return None;
    }
    let of = |lossy: bool| points.iter().filter(move |(l, _)| *l == lossy).map(|(_, p)| p.piece()).collect::<Vec<_>>();
    let mut lines = vec![
        Line { name: "equal".to_owned(), pen: Pen::Dotted, pieces: vec![vec![(0.0, 0.0), (largest, largest)]] },
        Line { name: "flight, with U (k = 2)".to_owned(), pen: Pen::Points, pieces: of(false) },
        Line { name: "flight with a damaged log".to_owned(), pen: Pen::HollowPoints, pieces: of(true) },
    ];
    lines.retain(|line| !line.pieces.is_empty());
    let axis = |label: &str| Axis::exactly(label, (0.0, largest * 1.05), 8);
    Some(Figure {
        id: "overview".to_owned(),
        number: 1,
        title: "Correction against speed times delay".to_owned(),
        caption: format!(
            "Raw − exact compensation (2‑D rms, m) of {} of {} flights over Td times median ground speed (m).",
            points.len(),
            record.flights.len()
        ),
        how_to_read: "A point above the line held its fixes for long, or flew much of the time faster than its median. \
                      Correction and line are made of the same velocity and Td: the figure shows sizes, and is a \
                      check of neither.",
        panels: vec![Panel::of(axis("Td × median ground speed (m)"), axis("correction, 2‑D rms (m)"), lines)],
        panel_size: (620, 330),
        fine: false,
    })
}

struct Point {
    way: f64,
    value: f64,
    low: f64,
    high: f64,
}

impl Point {
    /// A point, then its bar: a piece of three points, all at the same abscissa.
    fn piece(&self) -> Vec<(f64, f64)> {
        vec![(self.way, self.value), (self.way, self.low), (self.way, self.high)]
    }
}

fn point(row: &FlightRow) -> Option<Point> {
    let way = (row.delay_s? * row.speed_median_mps?).abs();
    let correction = row.correction_rms_m?;
    let expanded = COVERAGE_FACTOR * correction.standard_uncertainty.unwrap_or(0.0);
    let value = correction.value;
    let (low, high) = ((value - expanded).max(0.0), value + expanded);
    let drawable = |v: f64| (0.0..1e12).contains(&v);
    [way, value, low, high].into_iter().all(drawable).then_some(Point { way, value, low, high })
}

/// Most flights on the control chart; the record holds all.
const MOST_FLIGHTS: usize = 400;

/// Measured delays over the flights, with what they should be. `None` without one. Its number is the page's.
pub(crate) fn control_chart(delay: &CampaignDelay, number: u32) -> Option<Figure> {
    let points = || (1u32..).zip(&delay.control).take(MOST_FLIGHTS);
    let of = |outside: bool| {
        let wanted = points().filter(move |(_, p)| p.is_outside == outside);
        let pieces = wanted.filter_map(|(n, p)| {
            let half = COVERAGE_FACTOR * p.delay_s.standard_uncertainty.unwrap_or(0.0);
            upright(f64::from(n), p.delay_s.value * 1e3, half * 1e3)
        });
        pieces.collect::<Vec<_>>()
    };
    let level = |of: &dyn Fn(&ControlPoint) -> f64| {
        let step = |(n, p): (u32, &ControlPoint)| {
            let (n, y) = (f64::from(n), of(p) * 1e3);
            is_drawable(y).then_some([(n - 0.5, y), (n + 0.5, y)])
        };
        points().filter_map(step).flatten().collect::<Vec<_>>()
    };
    let should = if delay.card_s.is_some() { "sensor card" } else { "should be (card, or mean of the flights)" };
    let mut lines = vec![
        Line { name: "flight, ± U (k = 2)".to_owned(), pen: Pen::Points, pieces: of(false) },
        Line { name: "flight outside its limits".to_owned(), pen: Pen::HollowPoints, pieces: of(true) },
        stroke(should, Pen::Rule, level(&|p| p.centre_s)),
        stroke("limits, ± 3 σ of the difference", Pen::Dashed, level(&|p| p.centre_s + p.limit_s)),
        stroke("", Pen::Dashed, level(&|p| p.centre_s - p.limit_s)),
    ];
    lines.retain(|line| line.pieces.iter().any(|piece| !piece.is_empty()));
    let y = Axis::linear("position later than velocity (ms)", extent(&lines, |p| p.1)?, 7);
    let last = points().count();
    let every = last.div_ceil(25).max(1);
    let tick = |n: usize| Tick { at: n as f64, label: n.to_string() };
    let x = Axis::ticked("flight", (0.4, last as f64 + 0.6), (1..=last).step_by(every).map(tick).collect());
    let order =
        if delay.in_time_order { "in the order in which they were flown" } else { "in the order of their names" };
    let outside = delay.control.iter().filter(|p| p.is_outside).count();
    let mut caption = format!(
        "How much later than the velocity each flight shows its position, {} {order}; {} outside.",
        number::counted(last as u64, "flight", "flights"),
        number::count(outside as u64),
    );
    if last < delay.control.len() {
        let more = (delay.control.len() - last) as u64;
        caption += &format!(" Not drawn, but in the record: {}.", number::count(more));
    }
    Some(Figure {
        id: "control-chart".to_owned(),
        number,
        title: "Position later than velocity, from flight to flight".to_owned(),
        caption,
        how_to_read: "Good: bars around the line, none beyond the dashes, no trend. Bad: a step (another firmware, another \
                      rate, another cable) or a trend. About 3 flights of 1000 lie outside by chance. The dashes are wide \
                      where a flight says little.",
        panels: vec![Panel::of(x, y, lines)],
        panel_size: (860, 240),
        fine: false,
    })
}

/// The score of all flights over one delay for all. `None` without a curve.
pub(crate) fn pooled_sweep(delay: &CampaignDelay, number: u32) -> Option<Figure> {
    let pooled = delay.curve.found()?;
    let x_ms: Vec<f64> = pooled.delay_s.iter().map(|s| s * 1e3).collect();
    let (curve, _) = pieces(&x_ms, &pooled.rms_m, &[]);
    let mut lines = vec![Line { name: "all flights, 2‑D rms".to_owned(), pen: Pen::Raw, pieces: curve }];
    let x = Axis::linear("delay removed from all flights (ms)", extent(&lines, |p| p.0)?, 8);
    let (what, label) = match pooled.against_reference {
        true => ("Error of the exact asynchronous form against the reference", "error, 2‑D rms (m)"),
        false => ("Step of the exact asynchronous form at each fix", "step at a fix, 2‑D rms (m)"),
    };
    let y = Axis::linear(label, extent(&lines, |p| p.1)?, 6);
    let mut upright_at = |name: &str, pen: Pen, at_s: f64| {
        let at = at_s * 1e3;
        if (x.low..=x.high).contains(&at) {
            lines.push(stroke(name, pen, vec![(at, y.low), (at, y.high)]));
        }
    };
    if let Some(card) = &delay.card_s {
        upright_at("sensor card", Pen::Dashed, card.value);
    }
    if let Some(measured) = delay.measured.found() {
        upright_at("measured in the flights, mean", Pen::Rule, measured.delay_s.value);
    }
    if let Some(swept) = delay.swept.found() {
        upright_at("best of each flight, mean", Pen::Dotted, swept.delay_s.value);
    }
    Some(Figure {
        id: "campaign-sweep".to_owned(),
        number,
        title: "One delay for all flights".to_owned(),
        caption: format!(
            "{what} (2‑D rms, m) over one delay for {}, {}; mean squares weighted by {}.",
            number::counted(pooled.flights, "flight", "flights"),
            number::counted(pooled.samples, "sample", "samples"),
            if pooled.against_reference { "time flown" } else { "the number of fixes" },
        ),
        how_to_read: "Good: a clear valley with the card at its bottom. Where flights differ, the valley is shallow and one \
                      delay for all costs what its bottom lies above the flights' own.",
        panels: vec![Panel::of(x, y, lines)],
        panel_size: (860, 220),
        fine: false,
    })
}
