//! Channels as nodes, pairs as edges, and the effects that pairs share.

use crate::attitudes::one_per_velocity;
use crate::lineage::{Lineage, Role, acceleration_name, effect_kind, family};
use crate::observation::PairObservation;
use crate::observation::Usable;
use crate::settings::{NetworkSettings, ReferenceUse};
use record::{DelayPairKind, EffectName, Estimate, Finding, UnusedPair};
use std::collections::{BTreeMap, BTreeSet};

/// Least standard uncertainty that is accepted for a pair, s.
const LEAST_UNCERTAINTY_S: f64 = 1e-6;

/// Channel of the network.
#[derive(Debug, Clone)]
pub(crate) struct Node {
    pub(crate) name: String,
    pub(crate) role: Role,
    /// Connected part, counted from 0 in the order of the nodes.
    pub(crate) part: usize,
}

/// Pair that is used: `delay_s` is the lateness of node `first` less that of node `second`.
#[derive(Debug, Clone)]
pub(crate) struct Edge {
    pub(crate) first: usize,
    pub(crate) second: usize,
    pub(crate) delay_s: f64,
    /// From noise, s.
    pub(crate) uncertainty_s: f64,
    /// Widening for what a single delay does not explain, s.
    pub(crate) widened_s: f64,
    /// What few windows add to the 95 % interval, s.
    pub(crate) few_windows_s: f64,
    pub(crate) effect: usize,
}

/// Model error that some pairs share.
#[derive(Debug, Clone)]
pub(crate) struct Effect {
    pub(crate) name: EffectName,
    pub(crate) model_s: f64,
    pub(crate) edges: Vec<usize>,
}

/// Pairs of a flight as a graph.
#[derive(Debug, Clone)]
pub(crate) struct Graph {
    pub(crate) nodes: Vec<Node>,
    pub(crate) edges: Vec<Edge>,
    pub(crate) effects: Vec<Effect>,
    pub(crate) parts: usize,
}

/// Graph of the usable pairs, plus the other pairs sorted by use.
#[derive(Debug)]
pub(crate) struct Prepared {
    pub(crate) graph: Graph,
    pub(crate) unused: Vec<UnusedPair>,
}

/// Sorts pairs into usable ones and others. The result does not depend on the order of `pairs`.
pub(crate) fn prepare(
    pairs: &[PairObservation],
    lineage: &dyn Fn(&str) -> Lineage,
    settings: &NetworkSettings,
) -> Prepared {
    let roles = roles(pairs, lineage);
    let role = |name: &str| roles.get(name).copied().unwrap_or(Role::Measured);
    let (mut usable, mut unused) = (vec![], vec![]);
    for pair in pairs {
        let (first, second) = (pair.first.clone(), second_name(pair));
        let against_reference = role(&first) == Role::Reference || role(&second) == Role::Reference;
        match usable_delay(pair, &first, &second) {
            Err(why) => unused.push(UnusedPair { first, second, why }),
            Ok(_) if against_reference && settings.reference == ReferenceUse::Judges => {
                let why = "a reference is used to check the network and is not part of it".to_owned();
                unused.push(UnusedPair { first, second, why });
            }
            Ok((delay, uncertainty_s)) => {
                let [widened_s, few_windows_s] =
                    [pair.widened_s, pair.few_windows_s].map(|s| if s.is_finite() { s } else { 0.0 });
                usable.push(Usable { kind: pair.kind, first, second, delay, uncertainty_s, widened_s, few_windows_s });
            }
        }
    }
    let (mut usable, others) = one_per_velocity(usable, &role);
    unused.extend(others);
    usable.sort_by(|a, b| {
        (a.kind, &a.first, &a.second)
            .cmp(&(b.kind, &b.first, &b.second))
            .then(a.delay.value.total_cmp(&b.delay.value))
            .then(a.uncertainty_s.total_cmp(&b.uncertainty_s))
    });
    unused.sort_by(|a, b| (&a.first, &a.second, &a.why).cmp(&(&b.first, &b.second, &b.why)));
    Prepared { graph: Graph::new(&usable, &role, settings), unused }
}

/// Node name of the second channel.
fn second_name(pair: &PairObservation) -> String {
    match pair.kind {
        DelayPairKind::VelocityAgainstAcceleration => acceleration_name(&pair.second),
        _ => pair.second.clone(),
    }
}

/// Role of every channel; the kind of a pair overrides the lineage.
fn roles(pairs: &[PairObservation], lineage: &dyn Fn(&str) -> Lineage) -> BTreeMap<String, Role> {
    let mut roles = BTreeMap::new();
    for pair in pairs {
        for name in [&pair.first, &pair.second] {
            roles.entry(name.clone()).or_insert_with(|| Role::from(lineage(name)));
        }
    }
    for pair in pairs {
        match pair.kind {
            DelayPairKind::PositionAgainstReference | DelayPairKind::VelocityAgainstReference => {
                roles.insert(pair.second.clone(), Role::Reference);
            }
            DelayPairKind::VelocityAgainstAcceleration => {
                roles.insert(acceleration_name(&pair.second), Role::Acceleration);
            }
            DelayPairKind::PositionAgainstVelocity | DelayPairKind::BetweenReceivers => {}
        }
    }
    roles
}

/// Delay and uncertainty of a usable pair, or why it is not usable.
fn usable_delay(pair: &PairObservation, first: &str, second: &str) -> Result<(Estimate, f64), String> {
    let delay = match &pair.delay_s {
        Finding::Found(delay) => *delay,
        Finding::CannotTell(why) => return Err(why.clone()),
    };
    if let Some(why) = &pair.not_used {
        return Err(why.clone());
    }
    match delay.standard_uncertainty {
        _ if first == second => Err("a channel is not compared with itself".to_owned()),
        _ if !delay.value.is_finite() => Err("its delay is not finite".to_owned()),
        Some(u) if u.is_finite() && u > 0.0 => Ok((delay, u.max(LEAST_UNCERTAINTY_S))),
        _ => Err("its delay has no uncertainty, so it has no weight".to_owned()),
    }
}

impl Edge {
    /// The effect is assigned later.
    fn new(first: usize, second: usize, pair: &Usable) -> Edge {
        Edge {
            first,
            second,
            delay_s: pair.delay.value,
            uncertainty_s: pair.uncertainty_s,
            widened_s: pair.widened_s,
            few_windows_s: pair.few_windows_s,
            effect: 0,
        }
    }
}

impl Graph {
    fn new(usable: &[Usable], role: &dyn Fn(&str) -> Role, settings: &NetworkSettings) -> Graph {
        let names: BTreeSet<&str> =
            usable.iter().flat_map(|pair| [pair.first.as_str(), pair.second.as_str()]).collect();
        let index: BTreeMap<&str, usize> = names.iter().enumerate().map(|(at, name)| (*name, at)).collect();
        let mut nodes: Vec<Node> =
            names.iter().map(|name| Node { name: (*name).to_owned(), role: role(name), part: 0 }).collect();
        let mut effects: BTreeMap<EffectName, Vec<usize>> = BTreeMap::new();
        let mut edges = Vec::new();
        for pair in usable {
            let (Some(&first), Some(&second)) = (index.get(pair.first.as_str()), index.get(pair.second.as_str()))
            else {
                continue;
            };
            let (a, b) = (role(&pair.first), role(&pair.second));
            let name =
                EffectName { kind: effect_kind(a, b), first: family(&pair.first, a), second: family(&pair.second, b) };
            effects.entry(name).or_default().push(edges.len());
            edges.push(Edge::new(first, second, pair));
        }
        let effects: Vec<Effect> = effects
            .into_iter()
            .map(|(name, edges)| Effect { model_s: settings.model.of(name.kind), name, edges })
            .collect();
        for (at, effect) in effects.iter().enumerate() {
            for &edge in &effect.edges {
                edges[edge].effect = at;
            }
        }
        let parts = number_parts(&mut nodes, &edges);
        Graph { nodes, edges, effects, parts }
    }

    /// Nodes of one part, in order.
    pub(crate) fn members(&self, part: usize) -> impl Iterator<Item = usize> + '_ {
        self.nodes.iter().enumerate().filter(move |(_, node)| node.part == part).map(|(at, _)| at)
    }
}

/// Disjoint sets that are joined one pair at a time.
#[derive(Debug)]
pub(crate) struct Joined(Vec<usize>);

impl Joined {
    pub(crate) fn new(size: usize) -> Self {
        Joined((0..size).collect())
    }

    pub(crate) fn root(&mut self, mut at: usize) -> usize {
        while self.0[at] != at {
            self.0[at] = self.0[self.0[at]];
            at = self.0[at];
        }
        at
    }

    /// Joins the sets of both; `false` if they were already one.
    pub(crate) fn join(&mut self, a: usize, b: usize) -> bool {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b)] = a.min(b);
        a != b
    }
}

/// Numbers the connected parts in the order of their first node; returns their count.
fn number_parts(nodes: &mut [Node], edges: &[Edge]) -> usize {
    let mut joined = Joined::new(nodes.len());
    for edge in edges {
        joined.join(edge.first, edge.second);
    }
    let mut numbers = BTreeMap::new();
    for (at, node) in nodes.iter_mut().enumerate() {
        let next = numbers.len();
        node.part = *numbers.entry(joined.root(at)).or_insert(next);
    }
    numbers.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn joined_items_are_one_set_in_any_order() {
        let mut joined = Joined::new(7);
        assert!(joined.join(5, 2) && joined.join(6, 5) && joined.join(1, 0));
        assert!(!joined.join(2, 6) && !joined.join(0, 1));
        assert_eq!((0..7).map(|at| joined.root(at)).collect::<Vec<usize>>(), [0, 0, 2, 3, 4, 2, 2]);
        assert!(joined.join(6, 1));
        assert_eq!((0..7).map(|at| joined.root(at)).collect::<Vec<usize>>(), [0, 0, 0, 3, 4, 0, 0]);
    }
}
