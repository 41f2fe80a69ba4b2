//! Fig. 4 of Park and Lee: each output of the sensor against what the encoder says it should be.

use super::super::curve::{Tally, lines};
use super::super::{Axis, Dimension, Figure, Line, Panel, Pen, extent, is_drawable};
use super::{Role, main_component, roles};
use crate::number;
use crate::text::{label, short_label};
use crate::verdict;
use flight::Quantity;
use record::{ChannelDynamics, ComponentDynamics, Curve};

const TIME: &str = "time since the encoder's first sample";
/// Ticks of the time axis at most.
const TICKS: u32 = 12;

/// Position, velocity, acceleration, attitude and magnetic field as in the paper, and the angular rate that its
/// abstract promises.
fn place_in_paper(quantity: Quantity) -> Option<usize> {
    match quantity {
        Quantity::PositionGeodetic | Quantity::PositionNed => Some(0),
        Quantity::VelocityNed => Some(1),
        Quantity::SpecificForce => Some(2),
        Quantity::Attitude => Some(3),
        Quantity::MagneticField | Quantity::MagneticDirection => Some(4),
        Quantity::AngularRate => Some(5),
        _ => None,
    }
}

/// A channel and the component of it that is shown.
type Family<'a> = (&'a ChannelDynamics, &'a ComponentDynamics);

/// One channel of each family in the paper's order: the one whose delay is known best, else the first.
fn families(channels: &[ChannelDynamics]) -> Vec<Family<'_>> {
    let family = |place| {
        let members = || channels.iter().filter(move |c| place_in_paper(c.quantity) == Some(place));
        let uncertainty = |c: &ChannelDynamics| c.delay.as_ref().map_or(f64::INFINITY, |d| d.standard_uncertainty_s);
        members().min_by(|a, b| uncertainty(a).total_cmp(&uncertainty(b)))
    };
    (0..6).filter_map(family).filter_map(|channel| Some((channel, main_component(channel)?))).collect()
}

/// Fig. 4 over a few swings.
pub(super) fn zoom(channels: &[ChannelDynamics]) -> Option<Figure> {
    let mut tally = Tally::default();
    let row = |(channel, component): Family| {
        let lines = component_lines(&component.zoom, Pen::Samples, &mut tally);
        Row {
            dimension: dimension(channel, &lines),
            heading: heading(channel, component),
            label: axis_label(component),
            lines,
        }
    };
    let panels = stacked(families(channels).into_iter().map(row).collect())?;
    Some(Figure {
        id: "fig-4".to_owned(),
        number: 0,
        title: "Reference and output over a few swings".to_owned(),
        caption: tally.caption(
            "What the encoder says and what the sensor says over time, in the unit of each axis, as Fig. 4 of Park and \
             Lee, with the angular rate that is not in theirs. One component of one channel of each kind; the others \
             stand in the sections of the channels.",
        ),
        how_to_read: "Dots to the right of the wide curve are late, by the red length where it can be seen. Good: the \
                      dots lie on the dashes at every height. Bad: they part at the turning points (gain, or a lag \
                      instead of a delay), or from swing to swing (a delay that changes).",
        panels,
        panel_size: (860, 130),
        fine: false,
    })
}

/// Fig. 4 over the whole record.
pub(super) fn whole(channels: &[ChannelDynamics]) -> Option<Figure> {
    let mut tally = Tally::default();
    let row = |(channel, component): Family| {
        let mut lines = component_lines(&component.curves, Pen::Raw, &mut tally);
        lines.retain(|line| line.pen != Pen::Dashed);
        Row { dimension: None, heading: heading(channel, component), label: axis_label(component), lines }
    };
    let panels = stacked(families(channels).into_iter().map(row).collect())?;
    Some(Figure {
        id: "fig-4-whole".to_owned(),
        number: 0,
        title: "Reference and output over the whole record".to_owned(),
        caption: tally.caption(
            "As the figure above, in the unit of each axis, from the first to the last sample, without the dashes.",
        ),
        how_to_read: "Good: wide and thin curve fill the same heights from start to end. Bad: a stretch without \
                      output, an output that wanders off or is cut at a height (saturation), a swing that dies out.",
        panels,
        panel_size: (860, 105),
        fine: true,
    })
}

/// All components of one channel over a few swings.
pub(super) fn components(channel: &ChannelDynamics, id: String) -> Option<Figure> {
    /// Panels of one channel at most.
    const MOST: usize = 4;
    let mut tally = Tally::default();
    let row = |component: &ComponentDynamics| {
        let lines = component_lines(&component.zoom, Pen::Samples, &mut tally);
        let dimension = if component.excited { dimension(channel, &lines) } else { None };
        Row { dimension, heading: component_heading(component), label: axis_label(component), lines }
    };
    let panels = stacked(channel.components.iter().take(MOST).map(row).collect())?;
    Some(Figure {
        id,
        number: 0,
        title: format!("{}: all components over a few swings", label(&channel.name)),
        caption: tally.caption("Reference and output over time, in the unit of each axis."),
        how_to_read: "As Fig. 4 above. A component that the swing does not move says nothing of the delay; what is \
                      seen of it is offset, drift and noise.",
        panels,
        panel_size: (860, 110),
        fine: false,
    })
}

/// One panel before its time axis is known.
struct Row {
    /// Of the vertical axis.
    label: String,
    lines: Vec<Line>,
    heading: String,
    dimension: Option<Dimension>,
}

/// Panels over a common time; those without a point are left out. `None` if all are.
fn stacked(mut rows: Vec<Row>) -> Option<Vec<Panel>> {
    rows.retain(|row| extent(&row.lines, |p| p.1).is_some());
    let time = Axis::record_time(TIME, extent(rows.iter().flat_map(|row| &row.lines), |p| p.0)?, TICKS);
    let panel = |row: Row| {
        let y = Axis::linear(&row.label, extent(&row.lines, |p| p.1).unwrap_or((0.0, 0.0)), 6);
        let dimensions = row.dimension.into_iter().collect();
        Panel { dimensions, heading: row.heading, ..Panel::of(time.clone(), y, row.lines) }
    };
    Some(rows.into_iter().map(panel).collect())
}

fn heading(channel: &ChannelDynamics, component: &ComponentDynamics) -> String {
    format!("{}, {}: {}", label(&channel.name), short_label(&component.name), verdict::phrase(channel))
}

fn component_heading(component: &ComponentDynamics) -> String {
    if component.excited {
        String::new()
    } else {
        format!("{}: not excited, no part in the delay", label(&component.name))
    }
}

fn axis_label(component: &ComponentDynamics) -> String {
    format!("{} ({})", short_label(&component.name), short_label(&component.unit))
}

fn component_lines(curves: &[Curve], measured: Pen, tally: &mut Tally) -> Vec<Line> {
    let look = |role| match role {
        Role::Reference => ("reference at the true time", Pen::Band),
        Role::Delayed => ("reference, late as found", Pen::Dashed),
        Role::Measured => ("measured", measured),
    };
    let pens: Vec<Pen> = roles(curves).map(|(role, _)| look(role).1).collect();
    let mut drawn = lines(curves, &pens, tally);
    for (line, (role, _)) in drawn.iter_mut().zip(roles(curves)) {
        line.name = look(role).0.to_owned();
    }
    drawn
}

/// The delay as a length: from where the reference passes half its height to where it does so a delay later. Of all
/// such places the one nearest the middle.
fn dimension(channel: &ChannelDynamics, lines: &[Line]) -> Option<Dimension> {
    let found = channel.delay.as_ref()?;
    let reference = lines.iter().find(|line| line.pen == Pen::Band)?;
    let (low, high) = extent([reference], |p| p.1)?;
    let (start, end) = extent([reference], |p| p.0)?;
    let at = (low + high) / 2.0;
    let middle = (start + end) / 2.0;
    let pairs = reference.pieces.iter().flat_map(|piece| piece.windows(2));
    let crossings = pairs.filter(|pair| pair[0].1 < at && pair[1].1 >= at).map(|pair| {
        let share = (at - pair[0].1) / (pair[1].1 - pair[0].1);
        pair[0].0 + share * (pair[1].0 - pair[0].0)
    });
    let from = crossings.min_by(|a, b| (a - middle).abs().total_cmp(&(b - middle).abs()))?;
    let to = from + found.delay.seconds();
    let label = format!("{} ms", number::with_uncertainty(&verdict::in_millis(&verdict::delay(found))));
    is_drawable(to).then_some(Dimension { from, to, at, label })
}
