//! A figure as data: what is drawn, in which units, and how to read it. Pixels are left to `draw`.

mod axis;
mod bench_figures;
mod campaign_figures;
mod card_figures;
mod control_chart;
mod csv;
mod curve;
mod flight_delay_figures;
mod flight_figures;
mod forest;
mod score_figures;
mod sketch;
mod sweep_figures;
mod timeline;

pub(crate) use axis::Axis;
pub(crate) use bench_figures::{BenchFigures, ChannelFigures, KINDS, families, letter, main_component, place_in_paper};
pub(crate) use campaign_figures::{effects, valley};
pub(crate) use card_figures::{Forest, ForestRow, LeftOut, card_forest};
pub(crate) use control_chart::control_chart;
pub(crate) use csv::csv;
pub(crate) use flight_delay_figures::delay_over_time;
pub(crate) use flight_figures::{THUMBNAIL, flight_figures, thumbnail};
pub(crate) use forest::{forest, trend};
pub(crate) use score_figures::{bands_figure, budget_figure};
pub(crate) use sketch::packed_sketch;
pub(crate) use sweep_figures::{objective_figure, sweep_figure};
pub(crate) use timeline::timeline;

/// Stacked panels with one legend.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Figure {
    /// File name without folder and extension; also the anchor on the page.
    pub(crate) id: String,
    /// Number on its page.
    pub(crate) number: u32,
    /// One-line title: the finding where there is one.
    pub(crate) title: String,
    /// What is drawn, with units, and the number of samples it represents.
    pub(crate) caption: String,
    /// What good and bad look like.
    pub(crate) how_to_read: &'static str,
    /// From top to bottom, over the same horizontal axis.
    pub(crate) panels: Vec<Panel>,
    /// Width and height of the plotting area of one panel, CSS pixels.
    pub(crate) panel_size: (u32, u32),
    /// Thin pens, for many turns in a narrow figure.
    pub(crate) fine: bool,
}

/// One pair of axes and what is drawn in them.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Panel {
    /// Horizontal axis.
    pub(crate) x: Axis,
    /// Vertical axis.
    pub(crate) y: Axis,
    /// Curves in the order of the legend.
    pub(crate) lines: Vec<Line>,
    /// Shaded stretches of the horizontal axis.
    pub(crate) spans: Vec<Span>,
    /// Named points, each with a ring.
    pub(crate) marks: Vec<Mark>,
    /// The same without a ring.
    pub(crate) labels: Vec<Mark>,
    /// Points whose names show on hover.
    pub(crate) names: Vec<Mark>,
    /// Lengths along the horizontal axis, with arrows and a label.
    pub(crate) dimensions: Vec<Dimension>,
    /// Heading above the panel; empty for no heading.
    pub(crate) heading: String,
    /// Scale and north, where the panel is a map.
    pub(crate) ground: Option<Ground>,
}

/// What a map needs in addition to its axes: a scale bar and a north arrow. North is up.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Ground {
    /// Length of the scale bar, in the unit of the axes.
    pub(crate) length: f64,
    /// The same as text.
    pub(crate) label: String,
    /// Axis units per metre.
    pub(crate) scale: f64,
}

impl Panel {
    /// Axes and lines, and nothing else.
    pub(crate) fn of(x: Axis, y: Axis, lines: Vec<Line>) -> Panel {
        Panel {
            x,
            y,
            lines,
            spans: vec![],
            marks: vec![],
            labels: vec![],
            names: vec![],
            dimensions: vec![],
            heading: String::new(),
            ground: None,
        }
    }

    /// Converts a position in metres to axis units.
    pub(crate) fn ground_scale(&self, (east_m, north_m): (f64, f64)) -> (f64, f64) {
        let scale = self.ground.as_ref().map_or(1.0, |ground| ground.scale);
        (east_m * scale, north_m * scale)
    }
}

/// A curve, or another shape drawn from its pieces: see [`Shape`].
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Line {
    /// Name in the legend; empty for a line that needs no explanation.
    pub(crate) name: String,
    /// Appearance.
    pub(crate) pen: Pen,
    /// Points in the units of the axes, all finite.
    pub(crate) pieces: Vec<Vec<(f64, f64)>>,
}

/// How to distinguish a curve from the others, in colour and in black and white. Drawn in this order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Pen {
    /// Pale area: 95 % interval of a value.
    Uncertainty,
    /// Filled bars: counts, correlations.
    Bars,
    /// Thin and grey: shown for comparison, without hiding other curves.
    Faint,
    /// Wide and pale, drawn first so that curves on top of it stay visible.
    Band,
    /// The same in the green of references: the true position.
    TrueBand,
    /// Solid, 2 px: the compensated position.
    Exact,
    /// Solid, 2 px, in one of [`LEADS`] colours, from low to high.
    Lead(u8),
    /// Thin, dark, solid: what the receiver reported.
    Raw,
    /// Dashed.
    Dashed,
    /// Dots in green: an independent reference.
    Reference,
    /// Dots in black: a prediction, not a measurement.
    Dotted,
    /// A straight line that marks a value: thin and solid.
    Rule,
    /// Small black dots on top of curves: samples as measured.
    Samples,
    /// Single points, hollow and grey: unreliable or excluded.
    DoubtfulPoints,
    /// Single points, round.
    Points,
    /// Single points, hollow: data were lost.
    HollowPoints,
}

/// Colours of [`Pen::Lead`].
pub(crate) const LEADS: u8 = 5;

/// How the pieces of a line are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Shape {
    /// A curve through the points of a piece.
    Stroke,
    /// A marker at the first point of a piece; two more points are the ends of its error bar.
    Points,
    /// A filled area; the piece is its outline.
    Area,
    /// A bar between two opposite corners.
    Bars,
}

impl Pen {
    /// The shape this pen draws.
    pub(crate) fn shape(self) -> Shape {
        match self {
            Pen::Uncertainty => Shape::Area,
            Pen::Bars => Shape::Bars,
            Pen::Samples | Pen::DoubtfulPoints | Pen::Points | Pen::HollowPoints => Shape::Points,
            _ => Shape::Stroke,
        }
    }
}

/// A shaded stretch of the horizontal axis.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Span {
    /// Start.
    pub(crate) from: f64,
    /// End.
    pub(crate) to: f64,
    /// Name, written at its top; may be empty.
    pub(crate) label: String,
}

/// A named point.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Mark {
    /// Position.
    pub(crate) at: (f64, f64),
    /// Its name.
    pub(crate) label: String,
}

/// A length along the horizontal axis.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Dimension {
    /// Start.
    pub(crate) from: f64,
    /// End.
    pub(crate) to: f64,
    /// Height at which it is drawn.
    pub(crate) at: f64,
    /// Label.
    pub(crate) label: String,
}

impl Figure {
    /// Each named curve once, in the order of the panels.
    pub(crate) fn legend(&self) -> Vec<(&str, Pen)> {
        let mut entries: Vec<(&str, Pen)> = Vec::new();
        for line in self.panels.iter().flat_map(|panel| &panel.lines) {
            if !line.name.is_empty() && !entries.contains(&(line.name.as_str(), line.pen)) {
                entries.push((&line.name, line.pen));
            }
        }
        entries
    }
}

/// Largest magnitude that is drawn. A larger value is a fault, and the axes would lose their digits.
const LARGEST: f64 = 1e12;

/// The drawable points, split into pieces at the rows in `breaks`, and the number of points that cannot be drawn.
pub(crate) fn pieces(x: &[f64], y: &[f64], breaks: &[u32]) -> (Vec<Vec<(f64, f64)>>, usize) {
    let mut breaks = breaks.iter().copied().peekable();
    let mut pieces: Vec<Vec<(f64, f64)>> = vec![];
    let mut drawn = 0;
    for (row, (&x, &y)) in x.iter().zip(y).enumerate() {
        let mut lift = row == 0;
        while breaks.next_if(|&b| (b as usize) <= row).is_some() {
            lift = true;
        }
        if lift {
            pieces.push(Vec::new());
        }
        if x.abs() <= LARGEST
            && y.abs() <= LARGEST
            && let Some(piece) = pieces.last_mut()
        {
            drawn += 1;
            piece.push((x, y));
        }
    }
    pieces.retain(|piece| !piece.is_empty());
    (pieces, x.len().max(y.len()) - drawn)
}

/// Whether a number can be drawn.
fn is_drawable(value: f64) -> bool {
    value.abs() <= LARGEST
}

/// A point and the ends of its uncertainty above and below; `None` if it cannot be drawn.
fn upright(x: f64, y: f64, half: f64) -> Option<Vec<(f64, f64)>> {
    [x, y, half].into_iter().all(is_drawable).then(|| vec![(x, y), (x, y - half), (x, y + half)])
}

/// The outline of a rectangle between two opposite corners.
fn outline((x0, y0): (f64, f64), (x1, y1): (f64, f64)) -> Vec<(f64, f64)> {
    vec![(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
}

/// A line with one piece.
fn stroke(name: &str, pen: Pen, points: Vec<(f64, f64)>) -> Line {
    Line { name: name.to_owned(), pen, pieces: vec![points] }
}

/// Smallest and largest of one coordinate over some lines; `None` without a point.
pub(crate) fn extent<'a>(
    lines: impl IntoIterator<Item = &'a Line>,
    of: impl Fn(&(f64, f64)) -> f64,
) -> Option<(f64, f64)> {
    let values = lines.into_iter().flat_map(|line| line.pieces.iter().flatten()).map(of);
    values.fold(None, |range, v| match range {
        None => Some((v, v)),
        Some((low, high)) => Some((v.min(low), v.max(high))),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_break_splits_the_line() {
        let (parts, missing) = pieces(&[0.0, 1.0, 5.0], &[1.0, 2.0, 3.0], &[2]);
        assert_eq!(parts, [vec![(0.0, 1.0), (1.0, 2.0)], vec![(5.0, 3.0)]]);
        assert_eq!(missing, 0);
    }

    #[test]
    fn points_that_cannot_be_drawn_are_counted() {
        let (parts, missing) = pieces(&[0.0, 1.0, 2.0, 3.0], &[f64::NAN, 1e300, 2.0], &[0, 0, 700]);
        assert_eq!(parts, [vec![(2.0, 2.0)]]);
        assert_eq!(missing, 3);
    }
}
