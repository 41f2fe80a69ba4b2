//! The motion measured by the encoder.

use super::super::curve::{Tally, lines};
use super::super::{Axis, Figure, Line, Panel, Pen, extent};
use record::{Curve, ReferenceFinding};

const SIZE: (u32, u32) = (860, 170);

/// Bar angle, as encoded and smoothed.
pub(super) fn angle(reference: &ReferenceFinding) -> Option<Figure> {
    let mut tally = Tally::default();
    let drawn = drawn(&reference.angle, [Pen::Band, Pen::Raw], &mut tally);
    Some(Figure {
        id: "angle".to_owned(),
        number: 0,
        title: "Bar angle".to_owned(),
        caption: tally.caption("Bar angle in rad over time: encoder and smoothed."),
        how_to_read: "Good: one curve. Bad: they part (counts lost, an encoder that slips), or the bar is at rest for \
                      much of the record.",
        panels: panels("bar angle (rad)", vec![drawn])?,
        panel_size: SIZE,
        fine: true,
    })
}

/// Tangential acceleration, with and without the paper's second central difference.
pub(super) fn acceleration(reference: &ReferenceFinding) -> Option<Figure> {
    let mut tally = Tally::default();
    let both = drawn(&reference.acceleration, [Pen::Raw, Pen::Faint], &mut tally);
    let alone: Vec<Line> = both.iter().take(1).cloned().collect();
    let mut panels = panels("L ξ″ (m/s²)", vec![both, alone])?;
    for (panel, heading) in panels.iter_mut().zip(["smoothed, and the paper's second difference", "smoothed, alone"]) {
        panel.heading = heading.to_owned();
    }
    Some(Figure {
        id: "acceleration".to_owned(),
        number: 0,
        title: "Tangential acceleration, smoothed and as in the paper".to_owned(),
        caption: tally
            .caption("L ξ″ in m/s² over time. The lower panel shows the smoothed curve again, on its own scale."),
        how_to_read: "The grey curve is the second central difference of the counts, which the paper compares its \
                      accelerometer with: what exceeds the black curve is quantisation. Good: the black curve is \
                      smooth and goes through the middle of the grey one.",
        panels,
        panel_size: SIZE,
        fine: true,
    })
}

fn drawn(curves: &[Curve], pens: [Pen; 2], tally: &mut Tally) -> Vec<Line> {
    lines(curves, &pens, tally)
}

fn panels(label: &str, drawn: Vec<Vec<Line>>) -> Option<Vec<Panel>> {
    let time = Axis::record_time("time since the encoder's first sample", extent(drawn.iter().flatten(), |p| p.0)?, 12);
    let panel = |lines: Vec<Line>| {
        let range = extent(&lines, |p| p.1).unwrap_or((0.0, 0.0));
        Panel::of(time.clone(), Axis::linear(label, range, 5), lines)
    };
    Some(drawn.into_iter().map(panel).collect())
}
