//! Which effect is wrong: data snooping by effect (section 4).

use crate::adjust::{Adjustment, Freed, adjust};
use crate::graph::Graph;
use crate::lineage::Role;
use crate::settings::NetworkSettings;
use record::{NetworkDatum, NetworkVerdict};

/// Network after the search for wrong effects.
#[derive(Debug)]
pub(crate) struct Isolation {
    pub(crate) adjustment: Adjustment,
    pub(crate) verdict: NetworkVerdict,
    /// Effects freed one after the other: each was the only explanation of the misclosure.
    pub(crate) freed: Vec<usize>,
    /// Suspects, one of which is wrong, in the order of the effects; empty unless undecided.
    pub(crate) suspects: Vec<usize>,
    /// Network with each suspect freed in turn.
    alternatives: Vec<Adjustment>,
    /// Factor on all uncertainties.
    pub(crate) birge: f64,
}

/// Coverage factor of a standard uncertainty for 95 %.
pub(crate) const K95: f64 = 1.96;

impl Isolation {
    /// Standard uncertainty of a node, s, Birge's ratio included.
    pub(crate) fn uncertainty_s(&self, node: usize) -> f64 {
        self.birge * self.adjustment.uncertainty_s(node)
    }

    /// Lateness ± k U of a node, s, wider if few windows of its pairs were measured: the hull over all suspects if no
    /// effect is named.
    pub(crate) fn interval_s(&self, node: usize, k: f64) -> [f64; 2] {
        std::iter::once(&self.adjustment).chain(&self.alternatives).fold(
            [f64::INFINITY, f64::NEG_INFINITY],
            |[low, high], one| {
                let (value, half) = (one.lateness_s[node], k * self.birge * one.half_width_s(node));
                [low.min(value - half), high.max(value + half)]
            },
        )
    }

    /// Nodes that are earlier than the IMU of their part, which violates causality (section 3.3).
    pub(crate) fn earlier_than_datum(&self, graph: &Graph, settings: &NetworkSettings) -> Vec<usize> {
        let tied = |part: usize| self.adjustment.parts.get(part).is_some_and(|p| p.datum == NetworkDatum::Imu);
        (0..graph.nodes.len())
            .filter(|&at| {
                let allowance_s = match graph.nodes[at].role {
                    Role::Measured => 0.0,
                    Role::Derived => settings.filter_lead_s,
                    Role::Reference | Role::Acceleration => return false,
                };
                tied(graph.nodes[at].part) && self.interval_s(at, 2.0)[1] < -allowance_s
            })
            .collect()
    }
}

/// Frees wrong effects as long as exactly one explains the misclosure; `None` if a matrix is singular.
pub(crate) fn isolate(graph: &Graph, settings: &NetworkSettings, noise: &[f64], refused: &[bool]) -> Option<Isolation> {
    let mut freed: Vec<Freed> = Vec::new();
    let mut adjustment = adjust(graph, settings, noise, refused, &freed)?;
    let mut verdict = if adjustment.p().is_some() { NetworkVerdict::Consistent } else { NetworkVerdict::Unchecked };
    let mut suspects = Vec::new();
    while adjustment.p().is_some_and(|p| p < settings.closure_p) {
        let found = suspect_effects(&adjustment, settings, &freed);
        match found.as_slice() {
            [one] if freed.len() < settings.most_freed => {
                freed.push(*one);
                adjustment = adjust(graph, settings, noise, refused, &freed)?;
                verdict = NetworkVerdict::Named;
            }
            [_, _, ..] if freed.len() < settings.most_freed => {
                suspects = found;
                verdict = NetworkVerdict::Undecided;
                break;
            }
            _ => {
                verdict = NetworkVerdict::Scattered;
                break;
            }
        }
    }
    let alternatives = suspects
        .iter()
        .map(|suspect| adjust(graph, settings, noise, refused, &[freed.as_slice(), &[*suspect]].concat()))
        .collect::<Option<Vec<_>>>()?;
    let birge = birge_ratio(verdict, &adjustment);
    let mut suspects: Vec<usize> = suspects.iter().map(|suspect| suspect.effect).collect();
    suspects.sort_unstable();
    let freed = freed.iter().map(|freed| freed.effect).collect();
    Some(Isolation { adjustment, verdict, freed, suspects, alternatives, birge })
}

/// Factor on all uncertainties: they are widened by residuals that no effect explains.
fn birge_ratio(verdict: NetworkVerdict, adjustment: &Adjustment) -> f64 {
    match verdict {
        NetworkVerdict::Scattered => (adjustment.chi2 / adjustment.degrees_of_freedom.max(1) as f64).max(1.0).sqrt(),
        _ => 1.0,
    }
}

/// The effect with the largest |w| and its rivals; empty if none is large enough.
fn suspect_effects(adjustment: &Adjustment, settings: &NetworkSettings, freed: &[Freed]) -> Vec<Freed> {
    let candidates: Vec<(usize, f64, f64)> = adjustment
        .tests
        .iter()
        .enumerate()
        .filter(|(at, _)| freed.iter().all(|freed| freed.effect != *at))
        .filter_map(|(at, test)| test.checked.map(|checked| (at, checked.w.abs(), checked.size_s)))
        .filter(|(_, w, _)| *w > settings.suspect_w)
        .collect();
    let largest = candidates.iter().map(|(_, w, _)| *w).fold(0.0, f64::max);
    candidates
        .iter()
        .filter(|(_, w, _)| *w > largest - settings.rival_w || *w == largest)
        .map(|(at, _, size_s)| Freed::with_size(*at, *size_s))
        .collect()
}
