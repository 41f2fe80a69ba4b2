//! Fundamental loops: the sum of the delays around each.

use crate::graph::{Graph, Joined};
use nalgebra::DMatrix;
use record::{DelayLoop, Estimate};

/// Step of a walk: an edge, the node it leads to, and the sign +1 along or −1 against its direction.
#[derive(Debug, Clone, Copy)]
struct Step {
    edge: usize,
    to: usize,
    sign: f64,
}

/// Loops of the spanning tree of least uncertainty, one per pair outside the tree. `s` is the covariance of the pairs.
pub(crate) fn fundamental_loops(graph: &Graph, s: &DMatrix<f64>) -> Vec<DelayLoop> {
    let mut order: Vec<usize> = (0..graph.edges.len()).collect();
    order.sort_by(|&a, &b| graph.edges[a].uncertainty_s.total_cmp(&graph.edges[b].uncertainty_s).then(a.cmp(&b)));
    let mut joined = Joined::new(graph.nodes.len());
    let mut tree: Vec<Vec<Step>> = vec![Vec::new(); graph.nodes.len()];
    let mut closing = Vec::new();
    for at in order {
        let (first, second) = (graph.edges[at].first, graph.edges[at].second);
        if joined.join(first, second) {
            tree[first].push(Step { edge: at, to: second, sign: 1.0 });
            tree[second].push(Step { edge: at, to: first, sign: -1.0 });
        } else {
            closing.push(at);
        }
    }
    closing.sort_unstable();
    closing.iter().map(|&edge| close(graph, &tree, s, edge)).collect()
}

/// Loop that one edge closes: along it, then back through the tree.
fn close(graph: &Graph, tree: &[Vec<Step>], s: &DMatrix<f64>, edge: usize) -> DelayLoop {
    let (first, second) = (graph.edges[edge].first, graph.edges[edge].second);
    let mut steps = vec![Step { edge, to: second, sign: 1.0 }];
    steps.extend(path(tree, second, first));
    let misclosure_s = steps.iter().map(|step| step.sign * graph.edges[step.edge].delay_s).sum();
    let mut variance = 0.0;
    for a in &steps {
        for b in &steps {
            variance += a.sign * b.sign * s[(a.edge, b.edge)];
        }
    }
    let channels = std::iter::once(first)
        .chain(steps.iter().map(|step| step.to).take(steps.len() - 1))
        .map(|node| graph.nodes[node].name.clone())
        .collect();
    let misclosure_s = Estimate { value: misclosure_s, standard_uncertainty: Some(variance.max(0.0).sqrt()) };
    DelayLoop { channels, misclosure_s }
}

/// The unique path through the tree.
fn path(tree: &[Vec<Step>], from: usize, to: usize) -> Vec<Step> {
    let mut came: Vec<Option<(usize, Step)>> = vec![None; tree.len()];
    let mut open = vec![from];
    while let Some(at) = open.pop() {
        for step in &tree[at] {
            if step.to != from && came[step.to].is_none() {
                came[step.to] = Some((at, *step));
                open.push(step.to);
            }
        }
    }
    let mut steps = Vec::new();
    let mut at = to;
    while let Some((before, step)) = came[at] {
        steps.push(step);
        at = before;
    }
    steps.reverse();
    steps
}
