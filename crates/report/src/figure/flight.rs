//! The figures of a flight: Fig. 7 of the paper, its zoom, the difference, the track.

use super::curve::{Tally, lines};
use super::{Axis, Figure, Line, Mark, Panel, Pen, Span, extent};
use crate::number;
use crate::text::{label, sentence};
use record::{AxisCurves, Curve, ReplayRecord, Zoom};

const WIDE: (u32, u32) = (860, 215);
const TIME: &str = "time since the first sample";

/// All figures of a replay that have something to show, numbered.
pub(crate) fn flight_figures(replay: &ReplayRecord) -> Vec<Figure> {
    let zoomed = |make: fn(&ReplayRecord, &Zoom) -> Option<Figure>| replay.zoom.as_ref().and_then(|z| make(replay, z));
    let all = [overview(replay), zoomed(zoom), zoomed(zoom_difference), difference(replay), track(replay)];
    let mut figures: Vec<Figure> = all.into_iter().flatten().collect();
    for (number, figure) in (1..).zip(&mut figures) {
        figure.number = number;
    }
    figures
}

/// Pens for the curves of one panel. A curve is known by its compensator's title at the end
/// of its name: raw is solid, the exact form a band, the paper's form dashed (a second of its
/// kind dash-dotted); a curve of no compensator gets `other`.
fn pens<'a>(replay: &ReplayRecord, names: impl Iterator<Item = &'a str>, other: Pen) -> Vec<Pen> {
    let mut pens: Vec<Pen> = Vec::new();
    for name in names {
        let compensator = replay.compensators.iter().position(|c| !c.title.is_empty() && name.ends_with(&c.title));
        pens.push(match compensator {
            None => other,
            Some(0) => Pen::Raw,
            Some(i) if replay.compensators[i].name.starts_with("exact") => Pen::Band,
            Some(_) if pens.contains(&Pen::Dashed) => Pen::DashDot,
            Some(_) => Pen::Dashed,
        });
    }
    pens
}

fn overview(replay: &ReplayRecord) -> Option<Figure> {
    let drawn = Drawn::new(replay, &replay.axes, |axis| &axis.position_m, Pen::Reference);
    let mut panels = drawn.panels("", None)?;
    if let Some(zoom) = &replay.zoom {
        for (panel, name) in panels.iter_mut().zip(["hardest manoeuvre", ""]) {
            panel.spans.extend(span(zoom, panel, name));
        }
    }
    Some(Figure {
        id: "fig-7".to_owned(),
        number: 0,
        title: "North and east, raw and compensated".to_owned(),
        caption: drawn
            .tally
            .caption("Position north and east of the origin in metres over time, as Fig. 7 of Park and Lee."),
        how_to_read: "Good: at this scale the curves lie on each other, for compensation must not change the shape; the \
                      next figure shows the lead. Bad: they part on straight legs, or overshoot in turns.",
        panels,
        panel_size: WIDE,
        fine: true,
    })
}

fn zoom(replay: &ReplayRecord, zoom: &Zoom) -> Option<Figure> {
    let drawn = Drawn::new(replay, &zoom.axes, |axis| &axis.position_m, Pen::Reference);
    let what = format!(
        "The shaded span of the figure above, {} to {}: {}. Position north and east in metres over time.",
        number::clock(zoom.start_s, 1),
        number::clock(zoom.end_s, 1),
        sentence(zoom.why.trim_end_matches('.'))
    );
    Some(Figure {
        id: "zoom".to_owned(),
        number: 0,
        title: "The hardest manoeuvre".to_owned(),
        caption: drawn.tally.caption(&what),
        how_to_read: "Good: each turning point of the compensated curve comes Td before that of the raw one, at the \
                      same height. Bad: the peaks differ in height, or the lead changes through the turn.",
        panels: drawn.panels("", None)?,
        panel_size: WIDE,
        fine: false,
    })
}

const DIFFERENCE: &str = "raw − compensated, ";

fn zoom_difference(replay: &ReplayRecord, zoom: &Zoom) -> Option<Figure> {
    let drawn = Drawn::new(replay, &zoom.axes, |axis| &axis.difference_m, Pen::Dotted);
    let what = "Raw − compensated in metres over the same span, with the way that velocity says was flown meanwhile.";
    Some(Figure {
        id: "zoom-difference".to_owned(),
        number: 0,
        title: "The hardest manoeuvre: what compensation changed, and what velocity predicts".to_owned(),
        caption: drawn.tally.caption(what),
        how_to_read: "Dots: the velocity half way back, times the delay and the age of the fix. Where fixes are held \
                      all are saw teeth. Good: the curves lie on the dots. Bad: a filter that cannot follow \
                      (overshoot, wrong height in turns). All are made of the same velocity and Td: whether those \
                      are right, only a reference or the fixes themselves can say.",
        panels: drawn.panels(DIFFERENCE, Some(0.0))?,
        panel_size: WIDE,
        fine: false,
    })
}

fn difference(replay: &ReplayRecord) -> Option<Figure> {
    let drawn = Drawn::new(replay, &replay.axes, |axis| &axis.difference_m, Pen::Dotted);
    let what =
        "Raw − compensated in metres over the whole flight, with the way that velocity says was flown meanwhile.";
    Some(Figure {
        id: "difference".to_owned(),
        number: 0,
        title: "What compensation changed, and what velocity predicts".to_owned(),
        caption: drawn.tally.caption(what),
        how_to_read: "Good: the curves fill the same heights as the dots from start to end. Bad: a stretch without \
                      output, a spike (a fix held through an outage).",
        panels: drawn.panels(DIFFERENCE, Some(0.0))?,
        panel_size: WIDE,
        fine: true,
    })
}

fn track(replay: &ReplayRecord) -> Option<Figure> {
    let mut tally = Tally::default();
    let pens = pens(replay, replay.track.iter().map(|c| c.name.as_str()), Pen::Reference);
    let lines = lines(&replay.track, &pens, &mut tally);
    let (east, north) = (extent(&lines, |p| p.0)?, extent(&lines, |p| p.1)?);
    let largest = [east.0, east.1, north.0, north.1].into_iter().fold(0.0, |m: f64, v| m.max(v.abs()));
    let (scale, unit) = if largest > 10_000.0 { (1e-3, "km") } else { (1.0, "m") };
    let lines = lines.into_iter().map(|line| scaled(line, scale)).collect::<Vec<_>>();
    let scale_range = |(low, high): (f64, f64)| (low * scale, high * scale);
    let (panel_size, east, north) = equal_axes(scale_range(east), scale_range(north));
    let marks = ends(&lines);
    let x = Axis::exactly(&format!("east ({unit})"), east, 8);
    let y = Axis::exactly(&format!("north ({unit})"), north, 8);
    let panel = Panel { marks, ..Panel::of(x, y, lines) };
    let what = format!("Ground track, east and north of the origin in {unit}, equal scales.");
    Some(Figure {
        id: "track".to_owned(),
        number: 0,
        title: "Ground track".to_owned(),
        caption: tally.caption(&what),
        how_to_read: "Good: opposite passes over the same line fall together once compensated. Bad: they stay apart \
                      along the track (Td wrong) or across it (heading or frame wrong).",
        panels: vec![panel],
        panel_size,
        fine: true,
    })
}

/// Panels over a common time axis, and what their caption must own up to.
struct Drawn<'a> {
    axes: Vec<(&'a AxisCurves, Vec<Line>)>,
    tally: Tally,
}

impl<'a> Drawn<'a> {
    fn new(
        replay: &ReplayRecord,
        axes: &'a [AxisCurves],
        of: impl Fn(&'a AxisCurves) -> &'a Vec<Curve>,
        other: Pen,
    ) -> Self {
        let mut tally = Tally::default();
        let mut drawn = |axis| {
            let curves = of(axis);
            let pens = pens(replay, curves.iter().map(|c| c.name.as_str()), other);
            (axis, lines(curves, &pens, &mut tally))
        };
        let axes = axes.iter().take(2).map(&mut drawn).collect();
        Drawn { axes, tally }
    }

    /// `None` without a point to draw.
    fn panels(&self, what: &str, include: Option<f64>) -> Option<Vec<Panel>> {
        let everything = self.axes.iter().flat_map(|(_, lines)| lines);
        let time = Axis::time(TIME, extent(everything, |p| p.0)?, 10);
        Some(self.axes.iter().map(|(axis, lines)| panel(axis, lines, &time, what, include)).collect())
    }
}

fn panel(axis: &AxisCurves, lines: &[Line], time: &Axis, what: &str, include: Option<f64>) -> Panel {
    let (mut low, mut high) = extent(lines, |p| p.1).unwrap_or((0.0, 0.0));
    if let Some(value) = include {
        (low, high) = (low.min(value), high.max(value));
    }
    let name = format!("{what}{} (m)", label(&axis.axis));
    Panel::of(time.clone(), Axis::linear(&name, (low, high), 6), lines.to_vec())
}

fn span(zoom: &Zoom, panel: &Panel, name: &str) -> Option<Span> {
    let (from, to) = (zoom.start_s.max(panel.x.low), zoom.end_s.min(panel.x.high));
    (from < to).then(|| Span { from, to, label: name.to_owned() })
}

fn scaled(mut line: Line, scale: f64) -> Line {
    for point in line.pieces.iter_mut().flatten() {
        *point = (point.0 * scale, point.1 * scale);
    }
    line
}

/// Where the first curve begins and ends.
fn ends(lines: &[Line]) -> Vec<Mark> {
    let points = || lines.first().into_iter().flat_map(|line| line.pieces.iter().flatten());
    let mark = |at: Option<&(f64, f64)>, label: &str| at.map(|&at| Mark { at, label: label.to_owned() });
    mark(points().next(), "start").into_iter().chain(mark(points().last(), "end")).collect()
}

/// A plotting area and ranges in which a metre east is as long as a metre north.
fn equal_axes(east: (f64, f64), north: (f64, f64)) -> ((u32, u32), (f64, f64), (f64, f64)) {
    const WIDTH: f64 = 620.0;
    let with_air = |(low, high): (f64, f64)| ((low + high) / 2.0, ((high - low) * 1.08).max(1e-6));
    let ((east_middle, east_span), (north_middle, north_span)) = (with_air(east), with_air(north));
    let height = (WIDTH * north_span / east_span).clamp(260.0, 620.0).round();
    let per_pixel = (east_span / WIDTH).max(north_span / height).max(1e-6);
    let around = |middle: f64, pixels: f64| (middle - per_pixel * pixels / 2.0, middle + per_pixel * pixels / 2.0);
    ((WIDTH as u32, height as u32), around(east_middle, WIDTH), around(north_middle, height))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_metre_is_as_long_east_as_north() {
        for (east, north) in [((0.0, 1000.0), (0.0, 10.0)), ((-5.0, 5.0), (0.0, 9000.0)), ((3.0, 3.0), (1.0, 1.0))] {
            let ((width, height), e, n) = equal_axes(east, north);
            let (per_x, per_y) = ((e.1 - e.0) / f64::from(width), (n.1 - n.0) / f64::from(height));
            assert!((per_x / per_y - 1.0).abs() < 1e-9);
            assert!(e.0 <= east.0 && e.1 >= east.1 && n.0 <= north.0 && n.1 >= north.1);
        }
    }
}
