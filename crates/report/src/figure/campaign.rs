//! The one figure of a campaign: how large is each correction, beside its flight's speed.

use super::{Axis, Figure, Line, Panel, Pen};
use crate::number::COVERAGE_FACTOR;
use record::{CampaignRecord, FlightRow};

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
