//! The figures of a bench: Fig. 4 of the paper, the reference motion, and what each channel does.

mod channel_figures;
mod geometry_figures;
mod paper;
mod reference_figures;

pub(super) use channel_figures::objective_panel;
pub(crate) use channel_figures::{ChannelFigures, KINDS};
pub(crate) use geometry_figures::letter;
pub(crate) use paper::{families, place_in_paper};

use super::Figure;
use record::{BenchFindings, ChannelDynamics, ComponentDynamics, Curve, ReferenceFinding, RigGeometry};
use std::collections::BTreeSet;

/// All figures of a bench record that have something to show, numbered in the order of the page.
#[derive(Debug, Default)]
pub(crate) struct BenchFigures {
    /// Fig. 4 over a few swings.
    pub(crate) zoom: Option<Figure>,
    /// Fig. 4 over the whole record.
    pub(crate) whole: Option<Figure>,
    /// The rig from the side.
    pub(crate) side: Option<Figure>,
    /// The rig from above.
    pub(crate) above: Option<Figure>,
    /// One for each channel, in the order of the record.
    pub(crate) channels: Vec<ChannelFigures>,
    /// Bar angle.
    pub(crate) angle: Option<Figure>,
    /// Tangential acceleration, smoothed and as in the paper.
    pub(crate) acceleration: Option<Figure>,
}

impl BenchFigures {
    /// Figures of the results.
    pub(crate) fn of(findings: &BenchFindings) -> BenchFigures {
        let channels = &findings.channels;
        let anchors = anchors(channels.iter().map(|c| c.name.as_str()));
        let geometry = |draw: fn(&RigGeometry, &ReferenceFinding) -> Option<Figure>| {
            findings.geometry.as_ref().and_then(|geometry| draw(geometry, &findings.reference))
        };
        let mut figures = BenchFigures {
            zoom: paper::zoom(channels),
            whole: paper::whole(channels),
            side: geometry(geometry_figures::side),
            above: geometry(geometry_figures::above),
            channels: channels.iter().zip(anchors).map(|(c, anchor)| ChannelFigures::of(c, anchor)).collect(),
            angle: reference_figures::angle(&findings.reference),
            acceleration: reference_figures::acceleration(&findings.reference),
        };
        for (number, figure) in (1..).zip(figures.slots_mut().into_iter().flatten()) {
            figure.number = number;
        }
        figures
    }

    /// Fig. 4 of the paper over a few swings, alone.
    pub(crate) fn zoom_of(findings: &BenchFindings) -> Option<Figure> {
        paper::zoom(&findings.channels)
    }

    /// All figures in order.
    pub(crate) fn iter(&self) -> impl Iterator<Item = &Figure> {
        let channels = self.channels.iter().flat_map(ChannelFigures::slots);
        let first = [&self.zoom, &self.whole, &self.side, &self.above];
        first.into_iter().chain(channels).chain([&self.angle, &self.acceleration]).flatten()
    }

    fn slots_mut(&mut self) -> Vec<&mut Option<Figure>> {
        let channels = self.channels.iter_mut().flat_map(ChannelFigures::slots_mut);
        [&mut self.zoom, &mut self.whole, &mut self.side, &mut self.above]
            .into_iter()
            .chain(channels)
            .chain([&mut self.angle, &mut self.acceleration])
            .collect()
    }
}

/// The most informative component for the delay: the excited one with the smallest uncertainty, otherwise the first.
pub(crate) fn main_component(channel: &ChannelDynamics) -> Option<&ComponentDynamics> {
    let uncertainty = |c: &ComponentDynamics| c.delay_s.and_then(|d| d.standard_uncertainty).unwrap_or(f64::INFINITY);
    let excited = || channel.components.iter().filter(|c| c.excited);
    excited().min_by(|a, b| uncertainty(a).total_cmp(&uncertainty(b))).or(channel.components.first())
}

/// The role of a component's curve, by its position: the reference first, the reference shifted by the estimated delay
/// next, the measured values last.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Role {
    Reference,
    Delayed,
    Measured,
}

fn roles(curves: &[Curve]) -> impl Iterator<Item = (Role, &Curve)> {
    let last = curves.len().saturating_sub(1);
    curves.iter().enumerate().map(move |(i, curve)| {
        let role = match i {
            _ if i == last => Role::Measured,
            0 => Role::Reference,
            _ => Role::Delayed,
        };
        (role, curve)
    })
}

/// A unique name for each channel, valid as part of an `id`.
pub(crate) fn anchors<'a>(names: impl Iterator<Item = &'a str>) -> Vec<String> {
    let mut taken = BTreeSet::new();
    let free = |name| {
        let slug = slug(name);
        let mut anchor = slug.clone();
        let mut copy = 2;
        while !taken.insert(anchor.clone()) {
            anchor = format!("{slug}-{copy}");
            copy += 1;
        }
        anchor
    };
    names.map(free).collect()
}

/// Lower-case letters and digits of a name; anything else becomes one dash.
fn slug(name: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '-' };
    let dashed: String = name.chars().take(60).map(plain).collect();
    let words: Vec<&str> = dashed.split('-').filter(|word| !word.is_empty()).collect();
    if words.is_empty() { "unnamed".to_owned() } else { words.join("-") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn anchors_are_plain_and_unique() {
        let names = ["position.ins", "position ins", "<b>", "\u{202e}", "", "position-ins-2"];
        let expected = ["position-ins", "position-ins-2", "b", "unnamed", "unnamed-2", "position-ins-2-2"];
        assert_eq!(anchors(names.into_iter()), expected);
    }

    #[test]
    fn curves_are_identified_by_their_position() {
        let curve = || Curve { name: String::new(), t_s: vec![], y: vec![], breaks: vec![], stands_for: 0 };
        let of = |n| roles(&vec![curve(); n]).map(|(role, _)| role).collect::<Vec<_>>();
        assert_eq!(of(3), [Role::Reference, Role::Delayed, Role::Measured]);
        assert_eq!(of(2), [Role::Reference, Role::Measured]);
        assert_eq!(of(1), [Role::Measured]);
        assert_eq!(of(0), []);
    }
}
