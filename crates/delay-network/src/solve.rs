//! Turns pairs into a network record.

use crate::channels::Channels;
use crate::graph::{Graph, Prepared, prepare};
use crate::isolate::{Isolation, isolate};
use crate::lineage::Lineage;
use crate::noise::channel_noise;
use crate::observation::PairObservation;
use crate::settings::NetworkSettings;
use crate::words;
use record::{DelayNetwork, EffectName, Estimate, NetworkDatum, NetworkEffect, NetworkVerdict, UsedPair};

/// One lateness per channel from all pairs of one flight; `None` if no pair is usable.
///
/// `lineage` returns where each channel comes from, normally from the channel map, with
/// [`lineage_from_name`](crate::lineage_from_name) as the fallback. The order of `pairs` does not matter.
///
/// Generalised least squares over `y_ab = (T_a + n_a) − (T_b + n_b) + f_e + e_ab` (section 2), with the datum rules of
/// section 3 and the closure test and data snooping by effect of section 4.
///
/// Measured: latenesses drawn from the model are within their 95 % intervals in 94.4–96.2 % of 2000 draws, for each
/// channel of seven networks (test `intervals_reach_their_stated_coverage`). An error in an unchecked pair cannot be
/// detected; `rests_on` names that pair. Two velocities and two positions form one loop of effects, so an error there
/// is detected but cannot be located. A majority vote (Huber, L1, Marzullo) was tried and rejected: the many lanes of
/// one filter outvote the sensors.
///
/// ```
/// use delay_network::{NetworkSettings, PairObservation, lineage_from_name, solve};
/// use record::DelayPairKind::{PositionAgainstVelocity, VelocityAgainstAcceleration};
/// let imu = "attitude.ahrs2 + specific-force.imu";
/// let pairs = [
///     PairObservation::measured(PositionAgainstVelocity, "position.gps", "velocity.gps", 0.0002, 0.0018),
///     PairObservation::measured(VelocityAgainstAcceleration, "velocity.gps", imu, 0.2020, 0.0009),
/// ];
/// let network = solve(&pairs, &lineage_from_name, &NetworkSettings::default()).unwrap();
/// let position = network.channel("position.gps").unwrap();
/// assert!((position.lateness_s.value - 0.2022).abs() < 1e-6);
/// ```
#[must_use]
pub fn solve(
    pairs: &[PairObservation],
    lineage: &dyn Fn(&str) -> Lineage,
    settings: &NetworkSettings,
) -> Option<DelayNetwork> {
    let Prepared { graph, unused } = prepare(pairs, lineage, settings);
    if graph.edges.is_empty() {
        return None;
    }
    let noise = channel_noise(&graph, settings.shared_noise);
    let Shown { shown, refused, earlier } = against_datum(&graph, settings, &noise)?;
    let channels = Channels { graph: &graph, settings, shown: &shown, refused: refused.as_ref(), earlier: &earlier };
    Some(DelayNetwork {
        channels: channels.latenesses(),
        covariance_s2: covariance(&shown, graph.nodes.len()),
        datum: network_datum(&shown),
        datum_words: words::datum(&graph, &shown, settings, &earlier),
        verdict: shown.verdict,
        verdict_words: words::verdict(&graph, &shown),
        named: names(&graph, &shown.freed),
        undecided_between: names(&graph, &shown.suspects),
        chi2: shown.adjustment.chi2,
        degrees_of_freedom: u32::try_from(shown.adjustment.degrees_of_freedom).unwrap_or(u32::MAX),
        p: shown.adjustment.p(),
        birge: shown.birge,
        effects: effects(&graph, &shown),
        used_pairs: used_pairs(&graph, &shown),
        unused_pairs: unused,
    })
}

/// Network as reported.
struct Shown {
    shown: Isolation,
    /// Network against the IMU, if it was refused, and the nodes that are earlier than the IMU.
    refused: Option<Isolation>,
    earlier: Vec<usize>,
}

/// Latenesses against the IMU. Parts in which a channel would be earlier than the IMU are solved without it.
fn against_datum(graph: &Graph, settings: &NetworkSettings, noise: &[f64]) -> Option<Shown> {
    let first = isolate(graph, settings, noise, &[])?;
    let earlier = first.earlier_than_datum(graph, settings);
    if earlier.is_empty() {
        return Some(Shown { shown: first, refused: None, earlier });
    }
    let refused_parts: Vec<bool> =
        (0..graph.parts).map(|part| earlier.iter().any(|at| graph.nodes[*at].part == part)).collect();
    Some(Shown { shown: isolate(graph, settings, noise, &refused_parts)?, refused: Some(first), earlier })
}

/// Lateness of `first` less that of `second`, s, from the full covariance; `None` if one is missing or they are in
/// separate parts.
#[must_use]
pub fn difference(network: &DelayNetwork, first: &str, second: &str) -> Option<Estimate> {
    let at = |name: &str| network.channels.iter().position(|channel| channel.channel == name);
    let (i, j) = (at(first)?, at(second)?);
    let (a, b) = (network.channels.get(i)?, network.channels.get(j)?);
    let covariance = |i: usize, j: usize| network.covariance_s2.get(i)?.get(j).copied();
    let variance = covariance(i, i)? + covariance(j, j)? - 2.0 * covariance(i, j)?;
    (a.part == b.part).then(|| Estimate {
        value: a.lateness_s.value - b.lateness_s.value,
        standard_uncertainty: Some(variance.max(0.0).sqrt()),
    })
}

/// Covariance of all latenesses, s², Birge's ratio included.
fn covariance(isolation: &Isolation, size: usize) -> Vec<Vec<f64>> {
    let factor = isolation.birge.powi(2);
    (0..size).map(|i| (0..size).map(|j| factor * isolation.adjustment.covariance[(i, j)]).collect()).collect()
}

/// Datum of the whole network.
fn network_datum(isolation: &Isolation) -> NetworkDatum {
    let order = [NetworkDatum::Refused, NetworkDatum::Reference, NetworkDatum::Imu];
    let holds = |datum: &NetworkDatum| isolation.adjustment.parts.iter().any(|part| part.datum == *datum);
    order.into_iter().find(holds).unwrap_or(NetworkDatum::None)
}

fn names(graph: &Graph, effects: &[usize]) -> Vec<EffectName> {
    effects.iter().filter_map(|at| graph.effects.get(*at)).map(|effect| effect.name.clone()).collect()
}

fn effects(graph: &Graph, isolation: &Isolation) -> Vec<NetworkEffect> {
    graph
        .effects
        .iter()
        .zip(&isolation.adjustment.tests)
        .map(|(effect, test)| NetworkEffect {
            name: effect.name.clone(),
            model_s: effect.model_s,
            pairs: u32::try_from(effect.edges.len()).unwrap_or(u32::MAX),
            w: test.checked.map(|checked| checked.w),
            size_s: test.checked.map(|checked| checked.size_s),
            redundancy: test.redundancy,
            least_error_found_s: test.checked.map(|checked| checked.least_error_s),
        })
        .collect()
}

fn used_pairs(graph: &Graph, isolation: &Isolation) -> Vec<UsedPair> {
    graph
        .edges
        .iter()
        .zip(isolation.adjustment.residuals.iter())
        .map(|(edge, residual_s)| UsedPair {
            first: graph.nodes[edge.first].name.clone(),
            second: graph.nodes[edge.second].name.clone(),
            delay_s: Estimate {
                value: edge.delay_s,
                standard_uncertainty: Some(edge.uncertainty_s.hypot(edge.widened_s)),
            },
            residual_s: *residual_s,
            effect: graph.effects[edge.effect].name.clone(),
        })
        .collect()
}

/// Whether a verdict allows a value to be removed.
pub(crate) fn trusted(verdict: NetworkVerdict) -> bool {
    matches!(verdict, NetworkVerdict::Consistent | NetworkVerdict::Named | NetworkVerdict::Unchecked)
}
