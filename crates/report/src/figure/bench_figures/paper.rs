//! Fig. 4 of Park and Lee: each output of the sensor against the reference from the encoder.

use super::super::curve::{Tally, lines};
use super::super::{Axis, Dimension, Figure, Line, Panel, Pen, extent, is_drawable, stroke};
use super::{Role, main_component, roles};
use crate::number;
use crate::text::{label, short_label};
use crate::verdict;
use flight::Quantity;
use record::{ChannelDynamics, ComponentDynamics, Curve, DelayFinding};

const TIME: &str = "time since the encoder's first sample";
/// Maximum number of ticks on the time axis.
const TICKS: u32 = 12;

/// Position, velocity, acceleration, attitude and magnetic field as in the paper, then the angular rate announced in
/// its abstract, then height. All pages of a bench list channels in this order.
pub(crate) fn place_in_paper(quantity: Quantity) -> Option<usize> {
    match quantity {
        Quantity::PositionGeodetic | Quantity::PositionNed => Some(0),
        Quantity::VelocityNed => Some(1),
        Quantity::SpecificForce => Some(2),
        Quantity::Attitude => Some(3),
        Quantity::MagneticField | Quantity::MagneticDirection => Some(4),
        Quantity::AngularRate => Some(5),
        Quantity::Height => Some(6),
        _ => None,
    }
}

/// A channel and the component of it that is shown.
pub(crate) type Family<'a> = (&'a ChannelDynamics, &'a ComponentDynamics);

/// One channel of each family in the paper's order: the one with the best-known delay, otherwise the first. For
/// position, north and east if the swing moves them; for the others, the most informative component for the delay.
pub(crate) fn families(channels: &[ChannelDynamics]) -> Vec<Family<'_>> {
    let family = |place| {
        let members = || channels.iter().filter(move |c| place_in_paper(c.quantity) == Some(place));
        let uncertainty = |c: &ChannelDynamics| c.delay.as_ref().map_or(f64::INFINITY, |d| d.standard_uncertainty_s);
        members().min_by(|a, b| uncertainty(a).total_cmp(&uncertainty(b)))
    };
    let shown = |channel: &'_ ChannelDynamics| -> Vec<usize> {
        let all = channel.components.iter().enumerate();
        let level = all.filter(|(_, c)| c.excited && ["north", "east"].contains(&c.name.as_str())).map(|(i, _)| i);
        let is_position = place_in_paper(channel.quantity) == Some(0);
        let level: Vec<usize> = level.filter(|_| is_position).collect();
        let main = main_component(channel);
        match level.is_empty() {
            true => channel
                .components
                .iter()
                .position(|c| main.is_some_and(|main| std::ptr::eq(main, c)))
                .into_iter()
                .collect(),
            false => level,
        }
    };
    let found = (0..7).filter_map(family);
    found.flat_map(|channel| shown(channel).into_iter().map(move |i| (channel, &channel.components[i]))).collect()
}

/// Fig. 4 over a few swings.
pub(super) fn zoom(channels: &[ChannelDynamics]) -> Option<Figure> {
    let mut tally = Tally::default();
    let row = |(channel, component): Family| {
        let lines = laid_lines(channel, component, &mut tally);
        Row {
            dimension: dimension(channel, &lines),
            heading: heading(channel, component),
            label: axis_label(component),
            lines,
        }
    };
    let shown = families(channels);
    let title = first_words(&shown);
    let panels = stacked(shown.into_iter().map(row).collect())?;
    Some(Figure {
        id: "fig-4".to_owned(),
        number: 0,
        title,
        caption: tally.caption(
            "A few swings as the encoder and the sensor measured them (Park and Lee 2010, Fig. 4), one panel per \
             quantity. Offset and drift are removed from the measured values. So is slow wander, if the heading says \
             so: the mean of measured − fitted over four swings, which cannot hide a delay.",
        ),
        how_to_read: "The red length is the delay: from the wide curve (reference at the true time) to the dashes (the same, \
                      scaled and late as found). Good: the dots lie on the dashes at every height. Bad: they part at the \
                      turning points (gain, or a lag instead of a delay), or from swing to swing (a delay that changes).",
        panels,
        panel_size: (860, 112),
        fine: false,
    })
}

/// Short title of the figure: the lateness of the position, if there is one.
fn first_words(shown: &[Family]) -> String {
    match shown.first() {
        Some((channel, _)) if place_in_paper(channel.quantity) == Some(0) => {
            format!("{} is {}", label(&channel.name), verdict::phrase(channel))
        }
        _ => "Reference and output over a few swings".to_owned(),
    }
}

/// Reference, late reference and measured values of a component, without what is unrelated to the delay; as logged if
/// the record holds nothing else.
fn laid_lines(channel: &ChannelDynamics, component: &ComponentDynamics, tally: &mut Tally) -> Vec<Line> {
    let Some(overlay) = &component.overlay else { return component_lines(&component.zoom, Pen::Samples, tally) };
    let view = view(&overlay.measured);
    let delay_s = channel.delay.as_ref().map_or(0.0, |d| d.delay.seconds());
    let gain = component.gain.map_or(1.0, |g| g.value);
    let curves = [
        within(&overlay.reference, view, 0.0, 1.0),
        within(&overlay.reference, view, delay_s, gain),
        overlay.measured.clone(),
    ];
    component_lines(&curves, Pen::Samples, tally)
}

/// From the first to the last point of a curve, s.
fn view(curve: &Curve) -> (f64, f64) {
    curve.t_s.first().copied().zip(curve.t_s.last().copied()).unwrap_or((0.0, 0.0))
}

/// The part of a curve between two times, shifted and scaled.
fn within(curve: &Curve, (from, to): (f64, f64), shift_s: f64, gain: f64) -> Curve {
    let points = curve.t_s.iter().zip(&curve.y).map(|(t, y)| (t + shift_s, y * gain));
    let (t_s, y): (Vec<f64>, Vec<f64>) = points.filter(|(t, _)| (from..=to).contains(t)).unzip();
    Curve { t_s, y, breaks: vec![], ..curve.clone() }
}

/// Measured over reference, at the same time (a loop) and with the delay removed (a line).
pub(super) fn hysteresis(channel: &ChannelDynamics) -> Option<(String, Vec<Panel>)> {
    let component = main_component(channel)?;
    let (overlay, delay) = (component.overlay.as_ref()?, channel.delay.as_ref()?);
    let gain = component.gain.map_or(1.0, |g| g.value);
    let loop_of = |shift_s: f64| -> Vec<(f64, f64)> {
        let measured = overlay.measured.t_s.iter().zip(&overlay.measured.y);
        measured.filter_map(|(t, y)| Some((between(&overlay.reference, t - shift_s)?, *y))).collect()
    };
    let (before, after) = (loop_of(0.0), loop_of(delay.delay.seconds()));
    let lines = [stroke("", Pen::Raw, before), stroke("", Pen::Raw, after)];
    let (low, high) = extent(&lines, |p| p.0)?;
    let x = Axis::linear(&format!("reference ({})", short_label(&component.unit)), (low, high), 7);
    let y = Axis::linear(&format!("measured ({})", short_label(&component.unit)), extent(&lines, |p| p.1)?, 5);
    let diagonal = stroke("gain as found", Pen::Dashed, vec![(low, gain * low), (high, gain * high)]);
    let headings = ["at the same time".to_owned(), format!("after {} ms are removed", millis_of(delay))];
    let panel = |(line, heading): (Line, String)| Panel {
        heading,
        ..Panel::of(x.clone(), y.clone(), vec![line, diagonal.clone()])
    };
    Some((component.name.clone(), lines.into_iter().zip(headings).map(panel).collect()))
}

fn millis_of(delay: &DelayFinding) -> String {
    number::with_uncertainty(&verdict::in_millis(&verdict::delay(delay)))
}

/// A curve interpolated at a time between two of its points.
fn between(curve: &Curve, t: f64) -> Option<f64> {
    let after = curve.t_s.partition_point(|&x| x < t);
    let before = after.checked_sub(1)?;
    let (t0, t1) = (curve.t_s[before], *curve.t_s.get(after)?);
    let (y0, y1) = (*curve.y.get(before)?, *curve.y.get(after)?);
    Some(y0 + (t - t0) / (t1 - t0) * (y1 - y0))
}

/// Fig. 4 over the whole record.
pub(super) fn whole(channels: &[ChannelDynamics]) -> Option<Figure> {
    let mut tally = Tally::default();
    let row = |(channel, component): Family| {
        let mut lines = component_lines(&component.curves, Pen::Raw, &mut tally);
        lines.retain(|line| line.pen != Pen::Dashed);
        let heading = format!("{}, {}", label(&channel.name), short_label(&component.name));
        Row { dimension: None, heading, label: axis_label(component), lines }
    };
    let panels = stacked(families(channels).into_iter().map(row).collect())?;
    Some(Figure {
        id: "fig-4-whole".to_owned(),
        number: 0,
        title: "Reference and output over the whole record".to_owned(),
        caption: tally.caption(
            "Reference and output as logged, in the unit of each axis, over the part of the encoder's record that is used. No \
             reference is drawn in a gap of the encoder.",
        ),
        how_to_read: "Good: the wide and the thin curve have the same height from start to end. Bad: a stretch without \
                      output, an output that wanders off or is clipped (saturation), a swing that decays.",
        panels,
        panel_size: (860, 105),
        fine: true,
    })
}

/// All components of one channel over a few swings.
pub(super) fn components(channel: &ChannelDynamics, id: String) -> Option<Figure> {
    /// Maximum number of panels of one channel.
    const MOST: usize = 4;
    let mut tally = Tally::default();
    let row = |component: &ComponentDynamics| {
        let lines = laid_lines(channel, component, &mut tally);
        let dimension = if component.excited { dimension(channel, &lines) } else { None };
        Row { dimension, heading: component_heading(component), label: axis_label(component), lines }
    };
    let panels = stacked(channel.components.iter().take(MOST).map(row).collect())?;
    Some(Figure {
        id,
        number: 0,
        title: format!("{}: components over a few swings", label(&channel.name)),
        caption: tally.caption("Reference and output over time."),
        how_to_read: "",
        panels,
        panel_size: (860, 110),
        fine: false,
    })
}

/// One panel before its time axis is known.
struct Row {
    /// Label of the vertical axis.
    label: String,
    lines: Vec<Line>,
    heading: String,
    dimension: Option<Dimension>,
}

/// Panels over a common time axis; those without points are omitted. `None` if no panel is left.
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
    let found = format!("{}, {}: {}", label(&channel.name), short_label(&component.name), verdict::phrase(channel));
    [Some(found), taken_out(component)].into_iter().flatten().collect::<Vec<_>>().join("; ")
}

/// Note on how much slow wander is not drawn.
fn taken_out(component: &ComponentDynamics) -> Option<String> {
    let wander = component.overlay.as_ref()?.wander.as_ref()?;
    let unit = short_label(&component.unit);
    let amount = |value| number::significant(value, 2);
    let (here, rms) = (amount(wander.range_in_view), amount(wander.rms));
    Some(format!("wander of {here} {unit} removed here ({rms} {unit} rms over the record)"))
}

fn component_heading(component: &ComponentDynamics) -> String {
    if component.excited {
        taken_out(component).unwrap_or_default()
    } else {
        format!("{}: not excited, not used for the delay", label(&component.name))
    }
}

fn axis_label(component: &ComponentDynamics) -> String {
    format!("{} ({})", short_label(&component.name), short_label(&component.unit))
}

fn component_lines(curves: &[Curve], measured: Pen, tally: &mut Tally) -> Vec<Line> {
    let look = |role| match role {
        Role::Reference => ("reference at the true time", Pen::TrueBand),
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

/// The delay as a dimension line (the number is in the heading): from where the reference passes half its height to
/// where the delayed one does. Of all such places, the one nearest the middle.
fn dimension(channel: &ChannelDynamics, lines: &[Line]) -> Option<Dimension> {
    let found = channel.delay.as_ref()?;
    let reference = lines.iter().find(|line| line.pen == Pen::TrueBand)?;
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
    is_drawable(to).then_some(Dimension { from, to, at, label: String::new() })
}
