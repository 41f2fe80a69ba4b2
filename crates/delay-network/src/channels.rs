//! Results of the network for each channel.

use crate::adjust::Checked;
use crate::graph::Graph;
use crate::isolate::{Isolation, K95};
use crate::lineage::Role;
use crate::settings::NetworkSettings;
use crate::words;
use record::{ChannelLateness, EffectKind, Estimate, NetworkDatum, NetworkVerdict};

/// Redundancy below which nothing checks an effect.
const UNCHECKED_BELOW: f64 = 0.1;
/// Share of a figure above which it rests on one effect.
const RESTS_ABOVE: f64 = 0.5;
/// Difference in standard uncertainties above which a delay is reported as a filter's.
const FILTER_ABOVE: f64 = 3.0;

/// A network and what is needed to describe its channels.
pub(crate) struct Channels<'a> {
    pub(crate) graph: &'a Graph,
    pub(crate) settings: &'a NetworkSettings,
    /// Network as reported.
    pub(crate) shown: &'a Isolation,
    /// Network against the IMU, if it was refused.
    pub(crate) refused: Option<&'a Isolation>,
    /// Nodes earlier than the IMU.
    pub(crate) earlier: &'a [usize],
}

impl Channels<'_> {
    /// All channels in the order of the nodes.
    pub(crate) fn latenesses(&self) -> Vec<ChannelLateness> {
        (0..self.graph.nodes.len()).filter_map(|at| self.lateness(at)).collect()
    }

    fn lateness(&self, at: usize) -> Option<ChannelLateness> {
        let node = self.graph.nodes.get(at)?;
        let part = *self.shown.adjustment.parts.get(node.part)?;
        let model_s = self.shown.birge * self.shown.adjustment.model_s.get(at)?;
        let weak = part.zero.is_none() && model_s > self.settings.weak_above_s;
        let refused = self.refused.filter(|_| part.datum == NetworkDatum::Refused);
        Some(ChannelLateness {
            channel: node.name.clone(),
            lateness_s: value(self.shown, at),
            model_uncertainty_s: model_s,
            interval_95_s: self.shown.interval_s(at, K95),
            part: u32::try_from(node.part).unwrap_or(u32::MAX),
            datum: part.datum,
            relative_to: part.zero.and_then(|zero| self.graph.nodes.get(zero)).map(|zero| zero.name.clone()),
            derived: node.role == Role::Derived,
            weak,
            at_least_s: match refused {
                Some(refused) => self.at_least_after_refusal(refused, at),
                None if weak => self.at_least_if_weak(at, model_s),
                None => None,
            },
            filter_not_a_delay: self.filter_not_a_delay(at),
            earlier_than_datum: self.earlier.contains(&at),
            against_refused_datum_s: refused.map(|refused| value(refused, at)),
            rests_on: self.rests_on(at),
        })
    }

    /// `T̂ − 2√(U² − U_model²)`: the error of a filter against its own IMU is one-sided (section 6).
    fn at_least_if_weak(&self, at: usize, model_s: f64) -> Option<f64> {
        let decided = self.shown.verdict != NetworkVerdict::Undecided;
        let own_variance = self.shown.uncertainty_s(at).powi(2) - model_s.powi(2);
        decided.then(|| self.shown.adjustment.lateness_s[at] - 2.0 * own_variance.max(0.0).sqrt())
    }

    /// `T̂ − min T̂`: no channel is earlier than true time (section 3.3).
    fn at_least_after_refusal(&self, refused: &Isolation, at: usize) -> Option<f64> {
        let decided = refused.verdict != NetworkVerdict::Undecided;
        let lateness = &refused.adjustment.lateness_s;
        let earliest =
            self.graph.members(self.graph.nodes[at].part).map(|node| lateness[node]).fold(f64::INFINITY, f64::min);
        decided.then(|| lateness[at] - earliest)
    }

    /// Lateness against the own IMU, if it differs from the lateness that positions see (section 2).
    fn filter_not_a_delay(&self, at: usize) -> Option<Estimate> {
        let (which, effect) = self.graph.effects.iter().enumerate().find(|(_, effect)| {
            effect.name.kind == EffectKind::DerivedAcceleration
                && effect.edges.iter().any(|edge| self.graph.edges[*edge].first == at)
        })?;
        let Checked { size_s, size_uncertainty_s, .. } = self.shown.adjustment.tests.get(which)?.checked?;
        if size_s.abs() <= FILTER_ABOVE * size_uncertainty_s {
            return None;
        }
        let (mut sum, mut weight, mut least_s) = (0.0, 0.0, f64::INFINITY);
        for &edge in effect.edges.iter().filter(|edge| self.graph.edges[**edge].first == at) {
            let uncertainty_s = self.graph.edges[edge].uncertainty_s;
            sum += self.shown.adjustment.residuals[edge] / uncertainty_s.powi(2);
            weight += 1.0 / uncertainty_s.powi(2);
            least_s = least_s.min(uncertainty_s);
        }
        let datum_s = self.settings.datum_uncertainty_s.hypot(self.settings.acceleration_pin_s);
        Some(Estimate {
            value: self.shown.adjustment.lateness_s[at] + sum / weight,
            standard_uncertainty: Some(least_s.hypot(datum_s)),
        })
    }

    /// The unchecked effect that carries more than half of this figure. If there are several, the one whose model error
    /// adds most to its uncertainty.
    fn rests_on(&self, at: usize) -> Option<String> {
        let adjustment = &self.shown.adjustment;
        if adjustment.parts.iter().any(|part| part.zero == Some(at)) {
            return None;
        }
        self.graph
            .effects
            .iter()
            .zip(&adjustment.tests)
            .enumerate()
            .filter(|(_, (_, test))| test.redundancy < UNCHECKED_BELOW)
            .map(|(column, (effect, _))| (effect, adjustment.carried[(at, column)].abs()))
            .filter(|(_, carried)| *carried > RESTS_ABOVE)
            .max_by(|(a, carried_a), (b, carried_b)| {
                (carried_a * a.model_s).total_cmp(&(carried_b * b.model_s)).then(b.name.cmp(&a.name))
            })
            .map(|(effect, _)| format!("{}, unchecked", words::effect(&effect.name)))
    }
}

/// Lateness with its standard uncertainty, s.
fn value(isolation: &Isolation, at: usize) -> Estimate {
    Estimate { value: isolation.adjustment.lateness_s[at], standard_uncertainty: Some(isolation.uncertainty_s(at)) }
}
