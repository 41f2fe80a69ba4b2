//! Forest plots of a sensor card: each record's delay beside the combined one.

use super::axis::Tick;
use super::{Axis, Figure, Line, Panel, Pen, extent, is_drawable, outline, stroke};
use crate::number::COVERAGE_FACTOR;
use crate::text::label;
use record::{CardChannel, Estimate};

/// What one record says of one channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Forest {
    /// Number of the record in the table of the page, from 1.
    pub(crate) number: usize,
    /// Its delay, s; `None` if the record has none.
    pub(crate) delay_s: Option<Estimate>,
    /// Why it was left out of the combination, if it was.
    pub(crate) left_out: Option<LeftOut>,
}

/// Why a delay is no part of the combined one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum LeftOut {
    /// It does not belong to the others.
    Outlier,
    /// It was measured with other stamps or against another clock, or without a verdict.
    NotComparable,
}

/// A forest plot for each channel of a card, numbered. `forests` has one list for each channel.
pub(crate) fn card_figures(channels: &[CardChannel], ids: &[String], forests: &[Vec<Forest>]) -> Vec<Option<Figure>> {
    let mut number = 0;
    let channels = channels.iter().zip(ids).zip(forests);
    channels
        .map(|((channel, id), rows)| {
            let figure = forest(channel, id, rows)?;
            number += 1;
            Some(Figure { number, ..figure })
        })
        .collect()
}

fn forest(channel: &CardChannel, id: &str, rows: &[Forest]) -> Option<Figure> {
    let row = |row: &Forest| {
        let delay = row.delay_s?;
        let half = 1e3 * COVERAGE_FACTOR * delay.standard_uncertainty.unwrap_or(0.0);
        let (value, y) = (delay.value * 1e3, row.number as f64);
        (is_drawable(value) && is_drawable(half)).then(|| vec![(value, y), (value - half, y), (value + half, y)])
    };
    let of =
        |left_out| rows.iter().filter(move |r| r.left_out.is_some() == left_out).filter_map(row).collect::<Vec<_>>();
    let mut lines = vec![
        Line { name: "record, ± U (k = 2)".to_owned(), pen: Pen::Points, pieces: of(false) },
        Line { name: "left out".to_owned(), pen: Pen::DoubtfulPoints, pieces: of(true) },
    ];
    lines.retain(|line| !line.pieces.is_empty());
    extent(&lines, |p| p.0)?;
    let last = rows.iter().map(|r| r.number).max()? as f64;
    // The first record stands at the top.
    let ticks =
        rows.iter().rev().take(40).map(|r| Tick { at: last + 1.0 - r.number as f64, label: r.number.to_string() });
    for point in lines.iter_mut().flat_map(|line| line.pieces.iter_mut().flatten()) {
        point.1 = last + 1.0 - point.1;
    }
    let (low, high) = (0.4, last + 0.6);
    lines.extend(combined(channel, (low, high)));
    let x = Axis::linear("delay (ms)", extent(&lines, |p| p.0)?, 7);
    let y = Axis::ticked("record", (low, high), ticks.collect());
    Some(Figure {
        id: id.to_owned(),
        number: 0,
        title: format!("{}: delay of each record and of all together", label(&channel.name)),
        caption: "Delay in ms; rows are the numbers of the records in the table of records. The line is the combined \
                  value, the band its U (k = 2)."
            .to_owned(),
        how_to_read: "Good: the bars reach the band and lie on both sides of the line. Bad: bars that do not reach each \
                      other (the delay differs from run to run; the band then holds that too).",
        panels: vec![Panel::of(x, y, lines)],
        panel_size: (420, 40 + 20 * (last as u32).clamp(1, 40)),
        fine: false,
    })
}

fn combined(channel: &CardChannel, (low, high): (f64, f64)) -> Vec<Line> {
    let (value, half) = (channel.delay_s * 1e3, 1e3 * COVERAGE_FACTOR * channel.delay_standard_uncertainty_s);
    if !is_drawable(value) || !is_drawable(half) {
        return vec![];
    }
    let band = outline((value - half, low), (value + half, high));
    vec![
        Line { name: "combined, ± U".to_owned(), pen: Pen::Uncertainty, pieces: vec![band] },
        stroke("combined", Pen::Rule, vec![(value, low), (value, high)]),
    ]
}
