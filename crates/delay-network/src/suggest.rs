//! Pairs that would connect separate parts, or a part to a datum.

use crate::graph::{Graph, Node};
use crate::isolate::Isolation;
use crate::lineage::Role;
use record::{NetworkDatum, PairSuggestion, UnusedPair};

/// Name of the missing channel if no acceleration is known.
const ACCELERATION: &str = "attitude + specific-force";

/// Suggestions, pairs that were already tried first.
pub(crate) fn suggestions(graph: &Graph, isolation: &Isolation, unused: &[UnusedPair]) -> Vec<PairSuggestion> {
    let tied = |part: usize| {
        let datum = isolation.adjustment.parts.get(part).map(|part| part.datum);
        matches!(datum, Some(NetworkDatum::Imu | NetworkDatum::Reference))
    };
    let mut found: Vec<PairSuggestion> = unused.iter().filter_map(|pair| tried(graph, pair, &tied)).collect();
    if found.is_empty() {
        found.extend((1..graph.parts).filter_map(|part| untried(graph, part)));
    }
    let datum_tried = found.iter().any(|pair| pair.second.starts_with("acc["));
    for part in (0..graph.parts).filter(|part| !tied(*part) && !datum_tried) {
        let holds_acceleration = graph.members(part).any(|at| graph.nodes[at].role == Role::Acceleration);
        found.extend(first_velocity(graph, part).map(|velocity| PairSuggestion {
            first: velocity.name.clone(),
            second: ACCELERATION.to_owned(),
            words: if holds_acceleration {
                "log attitude and specific force with timestamps from the IMU and less latency: the figures are then \
                 against true time"
                    .to_owned()
            } else {
                "log attitude and specific force of the IMU at 10 Hz or more: the figures are then against true time"
                    .to_owned()
            },
        }));
    }
    found
}

/// Pair that was tried but not used, and that connects one part to another or to a datum.
fn tried(graph: &Graph, pair: &UnusedPair, tied: &dyn Fn(usize) -> bool) -> Option<PairSuggestion> {
    let node = |name: &str| graph.nodes.iter().find(|node| node.name == name);
    let words = match (node(&pair.first), node(&pair.second)) {
        (Some(a), Some(b)) if a.part != b.part => {
            format!("would tie {} and {} together; not used: {}", pair.first, pair.second, pair.why)
        }
        (Some(a), None) if pair.second.starts_with("acc[") && !tied(a.part) => {
            format!("would tie {} to the IMU; not used: {}", pair.first, pair.why)
        }
        _ => return None,
    };
    Some(PairSuggestion { first: pair.first.clone(), second: pair.second.clone(), words })
}

/// Untried pair between the first part and another.
fn untried(graph: &Graph, part: usize) -> Option<PairSuggestion> {
    let (first, second) = match (first_position(graph, 0), first_velocity(graph, part)) {
        (Some(position), Some(velocity)) => (position, velocity),
        _ => (first_position(graph, part)?, first_velocity(graph, 0)?),
    };
    Some(PairSuggestion {
        first: first.name.clone(),
        second: second.name.clone(),
        words: format!("would tie {} and {} together", first.name, second.name),
    })
}

fn first_position(graph: &Graph, part: usize) -> Option<&Node> {
    graph.members(part).filter_map(|at| graph.nodes.get(at)).find(|node| node.name.starts_with("position"))
}

fn first_velocity(graph: &Graph, part: usize) -> Option<&Node> {
    graph.members(part).filter_map(|at| graph.nodes.get(at)).find(|node| node.name.starts_with("velocity"))
}
