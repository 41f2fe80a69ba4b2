//! The forest plot of a sensor card: for each channel the combined delay and the delay of each record.

use super::axis::Tick;
use super::{Axis, Figure, Line, Panel, Pen, is_drawable, outline, stroke};
use crate::number::COVERAGE_FACTOR;
use crate::text::label;
use record::{CardChannel, Estimate};

/// Result of one record for one channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Forest {
    /// Number of the record in the table of the page, from 1.
    pub(crate) number: usize,
    /// Its delay, s; `None` if the record has none.
    pub(crate) delay_s: Option<Estimate>,
    /// Its margin of equivalence, s.
    pub(crate) margin_s: Option<f64>,
    /// Why it was left out of the combination, if it was.
    pub(crate) left_out: Option<LeftOut>,
}

/// Why a delay is excluded from the combined one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum LeftOut {
    /// It is an outlier.
    Outlier,
    /// It was measured with other timestamps or against another clock, or has no verdict.
    NotComparable,
}

/// A channel of the card, its margin of equivalence (s), and its records.
pub(crate) type ForestRow<'a> = (&'a CardChannel, f64, &'a [Forest]);

/// Maximum number of channels in one figure; the table has all.
const MOST: usize = 40;
/// Delays up to this are drawn on a linear scale, larger ones on a logarithmic one, ms.
const TO_SCALE_MS: f64 = 1.0;

/// Delays of all channels, the first at the top; `None` if no delay can be drawn.
pub(crate) fn card_forest(channels: &[ForestRow]) -> Option<Figure> {
    let shown = &channels[..channels.len().min(MOST)];
    let mut lines = forest_lines(shown);
    let ends = lines.iter().flat_map(|l| l.pieces.iter().flatten()).map(|p| p.0);
    let (low, high) = ends.fold((-TO_SCALE_MS, TO_SCALE_MS), |(low, high), v| (low.min(v), high.max(v)));
    if lines.iter().all(|line| line.pen == Pen::Uncertainty) {
        return None;
    }
    let (bottom, top) = (0.5, shown.len() as f64 + 0.5);
    lines.push(stroke("", Pen::Faint, vec![(0.0, bottom), (0.0, top)]));
    let ticks = shown.iter().enumerate().rev();
    let ticks =
        ticks.map(|(row, (channel, ..))| Tick { at: height(shown, row), label: label(&channel.name) }).collect();
    Some(Figure {
        id: "forest".to_owned(),
        number: 0,
        title: "Delay of every channel".to_owned(),
        caption: format!(
            "Delays in ms with U (k = 2), positive is late: all records together, and below that each record in the order of \
             the table of records. The axis is to scale within ±{TO_SCALE_MS} ms and logarithmic beyond."
        ),
        how_to_read: "Good: the bars of a channel reach each other, and lie inside the pale margin where the channel \
                      is on time. Bad: bars that do not reach each other (the delay differs from record to record; the \
                      bar of all records includes that).",
        panels: vec![Panel::of(
            Axis::symmetric("delay (ms)", (low * 1.3, high * 1.3), TO_SCALE_MS),
            Axis::ticked("", (bottom, top), ticks),
            lines,
        )],
        panel_size: (700, 52 * u32::try_from(shown.len()).unwrap_or(1).max(2)),
        fine: false,
    })
}

fn height(shown: &[ForestRow], row: usize) -> f64 {
    shown.len() as f64 - row as f64
}

/// The lines drawn for the channels, in the order of the legend.
fn forest_lines(shown: &[ForestRow]) -> Vec<Line> {
    let (mut combined, mut kept, mut left_out, mut margins) = (vec![], vec![], vec![], vec![]);
    for (row, (channel, margin_s, records)) in shown.iter().enumerate() {
        let middle = height(shown, row);
        let own = Estimate { value: channel.delay_s, standard_uncertainty: Some(channel.delay_standard_uncertainty_s) };
        combined.extend(level(&own, middle + 0.22));
        let step = 0.5 / records.len().max(1) as f64;
        for (place, record) in records.iter().enumerate() {
            let at = middle + 0.02 - step * place as f64;
            let point = record.delay_s.as_ref().and_then(|delay| level(delay, at));
            if record.left_out.is_some() { left_out.extend(point) } else { kept.extend(point) }
        }
        let margin = margin_s * 1e3;
        if is_drawable(margin) {
            margins.push(outline((-margin, middle - 0.45), (margin, middle + 0.45)));
        }
    }
    let line = |name: &str, pen, pieces| Line { name: name.to_owned(), pen, pieces };
    let mut lines = vec![
        line("margin: as good as no delay", Pen::Uncertainty, margins),
        line("all records, ± U", Pen::Points, combined),
        line("one record, ± U", Pen::Samples, kept),
        line("left out", Pen::DoubtfulPoints, left_out),
    ];
    lines.retain(|line| !line.pieces.is_empty());
    lines
}

/// A delay (s) as a point at a height, ms, with the ends of its error bar; `None` if it cannot be drawn.
fn level(delay: &Estimate, at: f64) -> Option<Vec<(f64, f64)>> {
    let half = 1e3 * COVERAGE_FACTOR * delay.standard_uncertainty.unwrap_or(0.0);
    let value = delay.value * 1e3;
    (is_drawable(value) && is_drawable(half)).then(|| vec![(value, at), (value - half, at), (value + half, at)])
}
