//! Draws figures as SVG. Only this file uses plotters.
//!
//! Plotters places axes, grid and text and maps values to pixels. This module works around three of its limits.
//! Plotters uses whole pixels, so everything is drawn at [`FINENESS`] times the size inside a `viewBox`.
//! It cuts a dashed line into thousands of lines, so each curve is written as one `path` with `stroke-dasharray`.
//! It repeats absolute coordinates, so paths are relative and omit points too close to see.
//! [`frame`] shortens the frame.

mod frame;

use crate::figure::{Axis, Dimension, Figure, Ground, Line, Mark, Panel, Pen, Shape, Span};
use crate::text::shown_block;
use maud::Render;
use plotters::chart::ChartContext;
use plotters::coord::Shift;
use plotters::coord::cartesian::Cartesian2d;
use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::fmt::Write;
use std::ops::Range;

/// Drawing units per CSS pixel.
const FINENESS: u32 = 2;
/// Margins around a panel, drawing units.
const EDGE: u32 = 14;
/// Minimum margin to the left of a panel.
const LEFT: u32 = 140;
/// Between the longest label of a vertical axis and the axis.
const BESIDE_LABEL: u32 = 30;
/// Size of all text, drawing units.
const FONT: u32 = 24;
/// Ten letters of a label.
const TEN_LETTERS: usize = 122;
const RIGHT: u32 = 64;
const BETWEEN: u32 = 34;
const BOTTOM: u32 = 96;
/// One row of the legend.
const LEGEND_ROW: u32 = 46;
const SAMPLE: i32 = 84;

const INK: RGBColor = RGBColor(0x1b, 0x1f, 0x24);
const AXIS: RGBColor = RGBColor(0x57, 0x60, 0x6a);
const GRID: RGBColor = RGBColor(0xe4, 0xe7, 0xeb);
const SPAN: RGBColor = RGBColor(0xe6, 0x9f, 0x00);
const SPAN_LABEL: RGBColor = RGBColor(0x6b, 0x4a, 0x00);

/// Every colour of a figure: its value in a file, and its CSS variable on a page, so that dark mode and print also
/// restyle the figures.
const PALETTE: [(&str, &str); 22] = [
    ("#1b1f24", "ink"),
    ("#57606a", "axis"),
    ("#e4e7eb", "grid"),
    ("#ffffff", "paper"),
    ("#e69f00", "span"),
    ("#6b4a00", "unsure"),
    ("#4d5761", "line-raw"),
    ("#0072b2", "line-exact_async"),
    ("#b34e00", "line-pade_1_1"),
    ("#00785a", "line-truth"),
    ("#5aa7de", "pen-band"),
    ("#3fa98c", "pen-true"),
    ("#cfe3f3", "pen-pale"),
    ("#7fa9c9", "pen-bars"),
    ("#9aa3ab", "pen-faint"),
    ("#767f88", "pen-doubt"),
    ("#b42318", "pen-mark"),
    ("#3b2f9e", "lead-0"),
    ("#7a1fa2", "lead-1"),
    ("#b12a90", "lead-2"),
    ("#d5455f", "lead-3"),
    ("#d9691e", "lead-4"),
];

/// Appearance of a pen. Widths and dashes are in drawing units.
struct Look {
    colour: &'static str,
    width: u32,
    dashes: &'static str,
    cap: &'static str,
    hollow: bool,
}

/// Colours after Okabe and Ito; those of thin lines are darkened for contrast. In black and
/// white the pens differ by width and dashes.
fn look(pen: Pen, fine: bool) -> Look {
    let line = |colour, width, fine_width| Look {
        colour,
        width: if fine { fine_width } else { width },
        dashes: "",
        cap: "round",
        hollow: false,
    };
    match pen {
        Pen::Uncertainty => line("#cfe3f3", 0, 0),
        Pen::Bars => line("#7fa9c9", 0, 0),
        Pen::Faint => line("#9aa3ab", 2, 1),
        Pen::Rule => Look { cap: "butt", ..line("#b34e00", 3, 3) },
        Pen::Samples => line("#1b1f24", 5, 5),
        Pen::DoubtfulPoints => Look { hollow: true, ..line("#767f88", 13, 13) },
        Pen::Band => line("#5aa7de", 10, 6),
        Pen::TrueBand => line("#3fa98c", 10, 6),
        Pen::Exact => line("#0072b2", 4, 3),
        Pen::Lead(level) => {
            let colours = ["#3b2f9e", "#7a1fa2", "#b12a90", "#d5455f", "#d9691e"];
            line(colours[usize::from(level) % colours.len()], 5, 4)
        }
        Pen::Raw => line("#4d5761", 3, 2),
        Pen::Dashed => Look { dashes: "17 11", cap: "butt", ..line("#b34e00", 5, 3) },
        Pen::Reference => Look { dashes: "0 10", ..line("#00785a", 5, 3) },
        Pen::Dotted => Look { dashes: "0 10", ..line("#1b1f24", 5, 3) },
        Pen::Points => line("#0072b2", 13, 13),
        Pen::HollowPoints => Look { hollow: true, ..line("#b42318", 15, 15) },
    }
}

/// The figure as a standalone file on a white background.
pub(crate) fn svg_file(figure: &Figure) -> String {
    let (width, height) = size(figure);
    let ground = format!("<rect width=\"{width}\" height=\"{height}\" fill=\"#ffffff\"/>\n");
    document(figure, " xmlns=\"http://www.w3.org/2000/svg\"", &ground)
}

/// The figure as an element of a page, in the colours of the page's style sheet and with no background.
pub(crate) fn svg_inline(figure: &Figure) -> String {
    let svg = document(figure, "", "");
    PALETTE
        .iter()
        .fold(svg, |svg, (colour, variable)| svg.replace(&format!("=\"{colour}\""), &format!("=\"var(--{variable})\"")))
}

fn document(figure: &Figure, namespace: &str, ground: &str) -> String {
    let (width, height) = size(figure);
    let body = match body(figure, (width, height)) {
        Ok(body) => body,
        Err(error) => {
            format!("<text x=\"20\" y=\"60\" font-size=\"28\">not drawn: {}</text>", escaped(&error.to_string()))
        }
    };
    let (id, title) = (&figure.id, escaped(&figure.title));
    let description = escaped(&format!("{} {}", figure.caption, figure.how_to_read));
    format!(
        "<svg{namespace} font-family=\"sans-serif\" viewBox=\"0 0 {width} {height}\" width=\"{}\" height=\"{}\" role=\"img\" \
         aria-labelledby=\"{id}-t {id}-d\"><title id=\"{id}-t\">{title}</title><desc id=\"{id}-d\">{description}</desc>\n\
         {ground}{body}</svg>\n",
        width / FINENESS,
        height / FINENESS
    )
}

fn escaped(text: &str) -> String {
    shown_block(text).render().into_string()
}

/// Outer size, drawing units.
fn size(figure: &Figure) -> (u32, u32) {
    let panels = figure.panels.len() as u32;
    let (width, height) = (figure.panel_size.0 * FINENESS, figure.panel_size.1 * FINENESS);
    let total = legend_height(figure) + panels * (height + BETWEEN) + BOTTOM;
    (EDGE + LEFT + width + RIGHT, total)
}

/// Left margin for the longest vertical-axis label, drawing units. All panels share it so that they align.
fn left(figure: &Figure) -> u32 {
    let labels = figure.panels.iter().flat_map(|panel| &panel.y.ticks).map(|tick| tick.label.chars().count());
    let longest = labels.max().unwrap_or(0) * TEN_LETTERS / 10;
    u32::try_from(longest).map_or(LEFT, |longest| (longest + BESIDE_LABEL).clamp(LEFT, 3 * LEFT))
}

type Failure = Box<dyn std::error::Error + Send + Sync>;
type Area<'a, 'b> = DrawingArea<SVGBackend<'a>, Shift>;
type Chart<'a, 'b> = ChartContext<'b, SVGBackend<'a>, Cartesian2d<Scale<'b>, Scale<'b>>>;

/// Plotters draws background, axes and text; the curves go on top.
fn body(figure: &Figure, size: (u32, u32)) -> Result<String, Failure> {
    let mut frame = String::new();
    let mut curves = String::new();
    {
        let area = SVGBackend::with_string(&mut frame, size).into_drawing_area();
        legend(&area, figure, &mut curves)?;
        let top = legend_height(figure);
        let panel_height = figure.panel_size.1 * FINENESS + BETWEEN;
        for (row, panel) in (0u32..).zip(&figure.panels) {
            let last = row as usize + 1 == figure.panels.len();
            let below = if last { BOTTOM } else { 0 };
            let from = top + row * panel_height;
            let part = area.clone().shrink((0, from), (size.0, panel_height + below));
            draw_panel(&part, panel, (figure.fine, last, left(figure)), &mut curves)?;
        }
        area.present()?;
    }
    Ok(format!("{}{curves}", frame::lighter(inner(&frame))))
}

/// Content between the outermost tags.
fn inner(svg: &str) -> &str {
    let start = svg.find('>').map_or(0, |i| i + 1);
    let end = svg.rfind("</svg>").unwrap_or(svg.len());
    svg.get(start..end).unwrap_or("")
}

fn draw_panel(
    area: &Area,
    panel: &Panel,
    (fine, last, left): (bool, bool, u32),
    out: &mut String,
) -> Result<(), Failure> {
    let mut chart = ChartBuilder::on(area)
        .margin_top(BETWEEN)
        .margin_left(EDGE)
        .margin_right(RIGHT)
        .set_label_area_size(LabelAreaPosition::Left, left)
        .set_label_area_size(LabelAreaPosition::Bottom, if last { BOTTOM } else { 1 })
        .build_cartesian_2d(Scale(&panel.x), Scale(&panel.y))?;
    for span in &panel.spans {
        shade(&mut chart, panel, span)?;
    }
    grid(&mut chart, panel, last)?;
    let mut lines: Vec<&Line> = panel.lines.iter().collect();
    lines.sort_by_key(|line| line.pen);
    for line in lines {
        write_line(out, &chart, line, fine);
    }
    for label in &panel.labels {
        write_label(out, &chart, panel, label);
    }
    for mark in &panel.marks {
        write_mark(out, &chart, panel, mark);
    }
    for mark in &panel.names {
        write_name(out, &chart, mark);
    }
    for dimension in &panel.dimensions {
        write_dimension(out, &chart, panel, dimension);
    }
    if let Some(ground) = &panel.ground {
        write_ground(out, &chart, panel, ground);
    }
    if !panel.heading.is_empty() {
        let (x, y) = chart.backend_coord(&(panel.x.low, panel.y.high));
        write_text(out, (x, y - 9), "start", &panel.heading);
    }
    Ok(())
}

fn grid(chart: &mut Chart, panel: &Panel, last: bool) -> Result<(), Failure> {
    let text = font(FONT).color(&INK);
    let mut mesh = chart.configure_mesh();
    mesh.light_line_style(TRANSPARENT)
        .bold_line_style(GRID.stroke_width(2))
        .axis_style(AXIS.stroke_width(2))
        .x_labels(panel.x.ticks.len())
        .y_labels(panel.y.ticks.len())
        .label_style(text.clone())
        .axis_desc_style(text)
        .y_desc(&panel.y.label)
        .set_all_tick_mark_size(7);
    if last {
        mesh.x_desc(&panel.x.label);
    } else {
        mesh.x_label_formatter(&|_| String::new());
    }
    mesh.draw()?;
    Ok(())
}

fn shade(chart: &mut Chart, panel: &Panel, span: &Span) -> Result<(), Failure> {
    let corners = [(span.from, panel.y.low), (span.to, panel.y.high)];
    chart.draw_series([Rectangle::new(corners, SPAN.mix(0.22).filled())])?;
    if !span.label.is_empty() {
        // Centred above; near the edge of the panel, shifted inwards.
        let middle = (span.from + span.to) / 2.0;
        let (at, anchor) = match (middle - panel.x.low) / (panel.x.high - panel.x.low) {
            place if place < 0.15 => (span.from, HPos::Left),
            place if place > 0.85 => (span.to, HPos::Right),
            _ => (middle, HPos::Center),
        };
        let style = font(FONT).color(&SPAN_LABEL).pos(Pos::new(anchor, VPos::Bottom));
        chart.draw_series([Text::new(span.label.clone(), (at, panel.y.high), style)])?;
    }
    Ok(())
}

/// Text of a size in drawing units. Plotters divides sizes by 1.24 in SVG.
fn font(size: u32) -> TextStyle<'static> {
    ("sans-serif", f64::from(size) * 1.24).into_text_style(&(0, 0))
}

// Legend, above the panels so that it covers no data.

/// Position of each entry: column and row, drawing units.
fn legend_places(figure: &Figure) -> Vec<(i32, u32)> {
    let left = (EDGE + left(figure)) as i32;
    let width = (EDGE + LEFT + figure.panel_size.0 * FINENESS) as i32;
    let (mut x, mut row) = (left, 0);
    let mut places = Vec::new();
    for (name, _) in figure.legend() {
        // 0.54 em per character, plus space before the next entry.
        let entry = SAMPLE + 18 + name.chars().count() as i32 * 13 + 30;
        if x + entry > width && x > left {
            (x, row) = (left, row + 1);
        }
        places.push((x, row));
        x += entry;
    }
    places
}

fn legend_height(figure: &Figure) -> u32 {
    legend_places(figure).last().map_or(0, |(_, row)| (row + 1) * LEGEND_ROW)
}

fn legend(area: &Area, figure: &Figure, curves: &mut String) -> Result<(), Failure> {
    let style = font(FONT).color(&INK).pos(Pos::new(HPos::Left, VPos::Center));
    for ((x, row), (name, pen)) in legend_places(figure).into_iter().zip(figure.legend()) {
        let y = (row * LEGEND_ROW + LEGEND_ROW / 2) as i32;
        area.draw(&Text::new(name.to_owned(), (x + SAMPLE + 18, y), style.clone()))?;
        let look = look(pen, figure.fine);
        curves.push_str(&match pen.shape() {
            Shape::Stroke => path(&look, &format!("M{x} {y}h{SAMPLE}"), ""),
            Shape::Points => path(&look, &dots(&[(x + SAMPLE / 2, y)]), ""),
            Shape::Area | Shape::Bars => filled(&look, &rectangle((x, y - 12), (x + SAMPLE, y + 12)), ""),
        });
    }
    Ok(())
}

// Curves

fn write_line(out: &mut String, chart: &Chart, line: &Line, fine: bool) {
    let pixels = |piece: &Vec<(f64, f64)>| piece.iter().map(|p| chart.backend_coord(p)).collect::<Vec<_>>();
    let pieces: Vec<Vec<(i32, i32)>> = line.pieces.iter().map(pixels).collect();
    let mut look = look(line.pen, fine);
    out.push_str(&match line.pen.shape() {
        Shape::Stroke => {
            let d: String = pieces.iter().map(|piece| relative_path(&thinned(piece))).collect();
            path(&look, &d, &line.name)
        }
        Shape::Points => {
            let firsts: Vec<(i32, i32)> = pieces.iter().filter_map(|piece| piece.first().copied()).collect();
            if line.pen == Pen::Samples {
                look.width = dot_width(&firsts);
            }
            uncertainties(&pieces) + &path(&look, &dots(&apart(firsts)), &line.name)
        }
        Shape::Area => {
            let d: String = pieces.iter().map(|piece| relative_path(&without_straight_runs(piece)) + "z").collect();
            filled(&look, &d, &line.name)
        }
        Shape::Bars => {
            let bar = |piece: &Vec<(i32, i32)>| piece.get(1).map_or_else(String::new, |&to| rectangle(piece[0], to));
            filled(&look, &pieces.iter().map(bar).collect::<String>(), &line.name)
        }
    });
}

/// A ring and its name.
fn write_mark(out: &mut String, chart: &Chart, panel: &Panel, mark: &Mark) {
    let (x, y) = chart.backend_coord(&mark.at);
    let _ =
        writeln!(out, "<circle cx=\"{x}\" cy=\"{y}\" r=\"9\" fill=\"#ffffff\" stroke=\"#1b1f24\" stroke-width=\"4\"/>");
    write_label(out, chart, panel, mark);
}

/// A name next to its point.
fn write_label(out: &mut String, chart: &Chart, panel: &Panel, label: &Mark) {
    let (x, y) = chart.backend_coord(&label.at);
    let right = label.at.0 > (panel.x.low + panel.x.high) / 2.0;
    let (text_x, anchor) = if right { (x - 18, "end") } else { (x + 18, "start") };
    write_text(out, (text_x, y + 9), anchor, &label.label);
}

/// A scale bar at the lower left, a north arrow at the upper right.
fn write_ground(out: &mut String, chart: &Chart, panel: &Panel, ground: &Ground) {
    let (left, bottom) = chart.backend_coord(&(panel.x.low, panel.y.low));
    let (right, top) = chart.backend_coord(&(panel.x.high, panel.y.high));
    let length = chart.backend_coord(&(panel.x.low + ground.length, panel.y.low)).0 - left;
    let (x, y) = (left + 24, bottom - 24);
    let bar = format!("M{x} {}v24M{} {}v24M{x} {y}h{length}", y - 12, x + length, y - 12);
    let (x_north, y_north) = (right - 30, top + 20);
    let arrow = format!("M{x_north} {}V{y_north}l-9 22M{x_north} {y_north}l9 22", y_north + 52);
    let ink = Look { colour: "#1b1f24", width: 4, dashes: "", cap: "round", hollow: false };
    out.push_str(&path(&ink, &(bar + &arrow), ""));
    write_text(out, (x + 6, y - 16), "start", &ground.label);
    write_text(out, (x_north, y_north + 78), "middle", "N");
}

/// A name shown when the user hovers over its point.
fn write_name(out: &mut String, chart: &Chart, mark: &Mark) {
    let (x, y) = chart.backend_coord(&mark.at);
    let _ = writeln!(out, "<circle cx=\"{x}\" cy=\"{y}\" r=\"13\" opacity=\"0\">{}</circle>", title(&mark.label));
}

/// A dimension line between two ends with its label; nothing if it is too short to see.
fn write_dimension(out: &mut String, chart: &Chart, panel: &Panel, dimension: &Dimension) {
    const SHORTEST: i32 = 8;
    let end = |x: f64| chart.backend_coord(&(x, dimension.at));
    let ((from, y), (to, _)) = (end(dimension.from), end(dimension.to));
    if (to - from).abs() < SHORTEST {
        return;
    }
    let ends = format!("M{from} {}v28M{to} {}v28M{from} {y}H{to}", y - 14, y - 14);
    let seam = Look { colour: "#ffffff", width: 11, dashes: "", cap: "butt", hollow: false };
    out.push_str(&path(&seam, &ends, ""));
    out.push_str(&path(&Look { colour: "#b42318", width: 5, ..seam }, &ends, ""));
    let right = dimension.from > (panel.x.low + panel.x.high) / 2.0;
    let (x, anchor) = if right { (from.min(to) - 14, "end") } else { (from.max(to) + 14, "start") };
    if !dimension.label.is_empty() {
        write_text(out, (x, y + 9), anchor, &dimension.label);
    }
}

/// Text with an outline in the background colour, legible on top of any curve.
fn write_text(out: &mut String, (x, y): (i32, i32), anchor: &str, text: &str) {
    let _ = writeln!(
        out,
        "<text x=\"{x}\" y=\"{y}\" text-anchor=\"{anchor}\" font-size=\"{FONT}\" fill=\"#1b1f24\" stroke=\"#ffffff\" \
         stroke-width=\"8\" stroke-linejoin=\"round\" paint-order=\"stroke\">{}</text>",
        escaped(text)
    );
}

fn path(look: &Look, d: &str, name: &str) -> String {
    let dashes = match look.dashes {
        "" => String::new(),
        dashes => format!(" stroke-dasharray=\"{dashes}\""),
    };
    let title = title(name);
    let stroke = |colour: &str, width: u32| {
        format!(
            "<path fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width}\" stroke-linejoin=\"round\" \
             stroke-linecap=\"{}\"{dashes} d=\"{d}\">{title}</path>\n",
            look.cap
        )
    };
    match look.hollow {
        true => stroke(look.colour, look.width) + &stroke("#ffffff", look.width.saturating_sub(7)),
        false => stroke(look.colour, look.width),
    }
}

fn title(name: &str) -> String {
    if name.is_empty() { String::new() } else { format!("<title>{}</title>", escaped(name)) }
}

fn filled(look: &Look, d: &str, name: &str) -> String {
    format!("<path fill=\"{}\" d=\"{d}\">{}</path>\n", look.colour, title(name))
}

fn rectangle((x0, y0): (i32, i32), (x1, y1): (i32, i32)) -> String {
    format!("M{x0} {y0}H{x1}V{y1}H{x0}z")
}

/// A curve through pixels as the `d` of a path, without points too close to see.
pub(crate) fn curve(points: &[(i32, i32)]) -> String {
    relative_path(&thinned(points))
}

/// A round dot at each point: a zero-length line with round caps.
fn dots(points: &[(i32, i32)]) -> String {
    let mut d = String::new();
    let mut last = None;
    for &(x, y) in points {
        let _ = match last {
            None => write!(d, "M{x} {y}h0"),
            Some((from_x, from_y)) => write!(d, "m{} {}h0", x - from_x, y - from_y),
        };
        last = Some((x, y));
    }
    d
}

/// Dots are larger where there is room between them.
fn dot_width(points: &[(i32, i32)]) -> u32 {
    let (Some(first), Some(last)) = (points.first(), points.last()) else { return 5 };
    let step = (last.0 - first.0).unsigned_abs() / points.len() as u32;
    (step / 2).clamp(5, 13)
}

/// Drops points within a CSS pixel of the previous one: on a screen they are the same dot.
fn apart(points: Vec<(i32, i32)>) -> Vec<(i32, i32)> {
    let mut kept: Vec<(i32, i32)> = Vec::with_capacity(points.len());
    for (x, y) in points {
        let is_near = |&(a, b): &(i32, i32)| (x - a).abs().max((y - b).abs()) < FINENESS as i32;
        if !kept.last().is_some_and(is_near) {
            kept.push((x, y));
        }
    }
    kept
}

/// The error bar of each point, from its second to its third coordinate pair: vertical or horizontal.
fn uncertainties(pieces: &[Vec<(i32, i32)>]) -> String {
    let bar = |piece: &Vec<(i32, i32)>| match piece[..] {
        [_, (x, low), (_, high)] if low != high => format!("M{x} {low}V{high}"),
        [_, (low, y), (high, _)] if low != high => format!("M{low} {y}H{high}"),
        _ => String::new(),
    };
    let d: String = pieces.iter().map(bar).collect();
    match d.is_empty() {
        true => String::new(),
        false => format!("<path fill=\"none\" stroke=\"#57606a\" stroke-width=\"3\" d=\"{d}\"/>\n"),
    }
}

/// Distinguishable points. Each column one CSS pixel wide keeps its first, lowest, highest and last point.
/// Points on the line between their neighbours are then dropped. An isolated sample or spike is never removed.
fn thinned(points: &[(i32, i32)]) -> Vec<(i32, i32)> {
    let column = |p: &(i32, i32)| p.0.div_euclid(FINENESS as i32);
    let mut kept = Vec::new();
    for run in points.chunk_by(|a, b| column(a) == column(b)) {
        let rows = || run.iter().enumerate();
        let lowest = rows().min_by_key(|(_, p)| p.1).map_or(0, |(i, _)| i);
        let highest = rows().max_by_key(|(_, p)| p.1).map_or(0, |(i, _)| i);
        let mut chosen = [0, lowest, highest, run.len() - 1];
        chosen.sort_unstable();
        kept.extend(chosen.map(|i| run[i]));
    }
    kept.dedup();
    without_straight_runs(&kept)
}

/// Drops points within half a drawing unit of the line between the points that are kept.
fn without_straight_runs(points: &[(i32, i32)]) -> Vec<(i32, i32)> {
    /// Longest stretch that one line may replace; bounds the work.
    const LONGEST: usize = 48;
    let Some(&first) = points.first() else { return Vec::new() };
    let mut kept = vec![first];
    let mut anchor = 0;
    for end in 1..points.len() {
        let straight = points[anchor + 1..end].iter().all(|&p| is_between(points[anchor], p, points[end]));
        if !straight || end - anchor > LONGEST {
            anchor = end - 1;
            kept.push(points[anchor]);
        }
    }
    if points.len() > 1 {
        kept.push(points[points.len() - 1]);
    }
    kept
}

/// Whether `p` lies between `a` and `b` and at most half a drawing unit from their line.
fn is_between(a: (i32, i32), p: (i32, i32), b: (i32, i32)) -> bool {
    let to = |q: (i32, i32)| (i64::from(q.0) - i64::from(a.0), i64::from(q.1) - i64::from(a.1));
    let ((px, py), (bx, by)) = (to(p), to(b));
    let (along, across, length2) = (px * bx + py * by, px * by - py * bx, bx * bx + by * by);
    along >= 0 && along <= length2 && 4 * across * across <= length2
}

/// `M` to the first point, then steps; a lone point becomes a dot.
fn relative_path(points: &[(i32, i32)]) -> String {
    let Some(&(x, y)) = points.first() else { return String::new() };
    let mut d = format!("M{x} {y}l");
    if points.len() == 1 {
        d.push_str("0 0");
    }
    for (i, pair) in points.windows(2).enumerate() {
        for (first, step) in [(true, pair[1].0 - pair[0].0), (false, pair[1].1 - pair[0].1)] {
            let separator = if step < 0 || (first && i == 0) { "" } else { " " };
            let _ = write!(d, "{separator}{step}");
        }
    }
    d
}

// Axes with our ticks, drawn by plotters.

struct Scale<'a>(&'a Axis);

impl Ranged for Scale<'_> {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, (start, end): (i32, i32)) -> i32 {
        start + (self.0.share(*value) * f64::from(end - start)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        if hint.weight().allow_light_points() {
            return Vec::new();
        }
        self.0.ticks.iter().map(|tick| tick.at).collect()
    }

    fn range(&self) -> Range<f64> {
        self.0.low..self.0.high
    }
}

impl ValueFormatter<f64> for Scale<'_> {
    fn format_ext(&self, value: &f64) -> String {
        self.0.ticks.iter().find(|tick| tick.at == *value).map_or_else(String::new, |tick| tick.label.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::page::CSS;

    const PENS: [Pen; 17] = [
        Pen::Uncertainty,
        Pen::Bars,
        Pen::Faint,
        Pen::Band,
        Pen::TrueBand,
        Pen::Exact,
        Pen::Lead(0),
        Pen::Lead(4),
        Pen::Raw,
        Pen::Dashed,
        Pen::Reference,
        Pen::Dotted,
        Pen::Rule,
        Pen::Samples,
        Pen::DoubtfulPoints,
        Pen::Points,
        Pen::HollowPoints,
    ];

    /// A figure with every pen and everything else that a panel can hold.
    fn with_everything() -> Figure {
        let points = |x: f64| vec![vec![(x, 0.5), (x + 0.1, 0.4), (x + 0.1, 0.6)]];
        let lines = PENS.iter().map(|&pen| Line { name: format!("{pen:?}"), pen, pieces: points(0.2) }).collect();
        let axis = || Axis::exactly("x", (0.0, 1.0), 4);
        let mut panel = Panel::of(axis(), axis(), lines);
        panel.spans = vec![Span { from: 0.1, to: 0.9, label: "span".to_owned() }];
        panel.marks = vec![Mark { at: (0.5, 0.5), label: "mark".to_owned() }];
        panel.ground = Some(Ground { length: 0.2, label: "0.2 m".to_owned(), scale: 1.0 });
        panel.dimensions = vec![Dimension { from: 0.1, to: 0.9, at: 0.3, label: "length".to_owned() }];
        Figure {
            id: "f".to_owned(),
            number: 1,
            title: "t".to_owned(),
            caption: "c".to_owned(),
            how_to_read: "h",
            panels: vec![panel],
            panel_size: (400, 200),
            fine: false,
        }
    }

    #[test]
    fn every_figure_colour_is_a_css_variable_in_light_and_dark_mode() {
        let (light, rest) = CSS.split_once("@media screen and (prefers-color-scheme:dark)").unwrap();
        let dark = rest.split_once("}}").unwrap().0;
        for (colour, variable) in PALETTE {
            let short = colour.replace("#ffffff", "#fff");
            assert!(light.contains(&format!("--{variable}:{short}")), "{variable} {colour}");
            assert!(dark.contains(&format!("--{variable}:#")), "{variable}");
        }
        let figure = with_everything();
        let inline = svg_inline(&figure);
        assert!(!inline.contains("=\"#") && !inline.contains("<rect width"), "{inline}");
        assert!(!svg_file(&figure).contains("var("));
    }

    #[test]
    fn a_lone_spike_survives_thinning() {
        let mut points: Vec<(i32, i32)> = (0..4000).map(|i| (i / 4, 500)).collect();
        points[1234] = (308, 100);
        assert!(thinned(&points).contains(&(308, 100)));
    }

    #[test]
    fn a_straight_line_is_thinned_and_a_noisy_one_keeps_its_extremes() {
        let line: Vec<(i32, i32)> = (0..1000).map(|i| (i, 2 * i)).collect();
        assert!(thinned(&line).len() < 30);
        let noisy: Vec<(i32, i32)> = (0..100_000).map(|i| (i / 100, (i * 7919) % 431)).collect();
        let kept = thinned(&noisy);
        assert!(kept.len() <= 4 * 500);
        for column in 0..500 {
            let extreme = |points: &[(i32, i32)]| {
                let column = || points.iter().filter(|p| p.0 / 2 == column).map(|p| p.1);
                (column().min(), column().max())
            };
            assert_eq!(extreme(&kept), extreme(&noisy));
        }
    }

    #[test]
    fn every_removed_point_is_within_half_a_unit_of_the_drawn_line() {
        let curve: Vec<(i32, i32)> =
            (0..1500).map(|i| (i, (300.0 + 250.0 * (f64::from(i) / 90.0).sin()).round() as i32)).collect();
        let kept = without_straight_runs(&curve);
        assert!(kept.len() < curve.len());
        for &(x, y) in &curve {
            let near = kept.windows(2).any(|w| is_between(w[0], (x, y), w[1]));
            assert!(near, "({x}, {y})");
        }
    }

    #[test]
    fn all_dots_distinguishable_on_a_screen_are_drawn() {
        let points = vec![(10, 20), (11, 21), (13, 20), (13, 60)];
        assert_eq!(dots(&apart(points)), "M10 20h0m3 0h0m0 40h0");
    }

    #[test]
    fn an_error_bar_is_vertical_or_horizontal() {
        let drawn = uncertainties(&[vec![(5, 7), (5, 3), (5, 9)], vec![(5, 7), (1, 7), (8, 7)], vec![(5, 7)]]);
        assert!(drawn.contains("d=\"M5 3V9M1 7H8\""), "{drawn}");
    }

    #[test]
    fn a_relative_path_passes_through_the_same_points() {
        let points = [(10, 20), (12, 15), (9, 15), (9, 30)];
        assert_eq!(relative_path(&points), "M10 20l2-5-3 0 0 15");
        assert_eq!(relative_path(&points[..1]), "M10 20l0 0");
    }
}
