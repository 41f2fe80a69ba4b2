//! Ramps of the description on the fixes: a staircase becomes a ramp, and bends move to where they fit best.

use crate::describe::{Description, Term};
use crate::parts::Part;
use crate::refine::{Refined, Refinement};
use nalgebra::DVector;
use record::DelayTermKind;

/// Rounds in which bends move, and the largest move per round, bins.
const ROUNDS: usize = 6;
const LARGEST_MOVE_BINS: f64 = 4.0;
/// Least number of steps in one direction that may be a ramp.
const LEAST_STAIRS: usize = 2;
/// Candidate ends of a ramp before and after its stairs, in units of their spacing.
const ENDS: [f64; 2] = [0.5, 1.0];
/// Share of the slope of a ramp that may remain after it.
const UNEVEN: f64 = 0.2;
/// A bend within this distance of a step is the end of a ramp with a drop and moves with it, bins.
const AT_A_STEP_BINS: f64 = 0.5;

impl Refinement<'_> {
    /// On bins the ramp of a queue looks like stairs, and bends are at bin middles. This fits ramps to the fixes.
    pub(crate) fn ramps(&self, mut now: Refined) -> Refined {
        let mut cost = self.cost(&now.description);
        for _ in 0..now.description.terms.len() {
            let better = stairs(&now.description).into_iter().flat_map(|s| self.ramps_for(&now.description, &s));
            let costed = better.map(|r| (self.cost(&r.description), r));
            let best = costed.min_by(|a, b| a.0.total_cmp(&b.0)).filter(|best| best.0 < cost);
            let Some((lower, ramp)) = best else { break };
            (cost, now) = (lower, ramp);
        }
        now = self.place_bends(now);
        match short_ramps_as_steps(&now.description, self.bin_s).and_then(|d| self.descend(d)) {
            Some(mut steps) => {
                self.place_edges(&mut steps);
                self.descend(steps.description).unwrap_or(now)
            }
            None => now,
        }
    }

    /// Descriptions with a ramp in place of these steps.
    fn ramps_for(&self, d: &Description, stairs: &Stairs) -> Vec<Refined> {
        let spacing = stairs.spacing_s.max(self.bin_s);
        let ends = ENDS.iter().map(|x| stairs.to_s + x * spacing).chain(stairs.falls_s);
        let ramp = |from: f64, to: f64| {
            let slope = stairs.height_s / (to - from);
            let mut ramp = d.clone();
            ramp.terms.retain(|t| !stairs.has(t));
            ramp.terms.push(Term { kind: DelayTermKind::Bend, at_s: from, size: slope });
            ramp.terms.push(Term { kind: DelayTermKind::Bend, at_s: to, size: -slope });
            ramp.terms.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
            Some(self.place_bends(self.descend(ramp)?))
        };
        let both = ends.flat_map(|to| ENDS.map(|x| (stairs.from_s - x * spacing, to)));
        both.filter_map(|(from, to)| ramp(from, to)).collect()
    }

    /// Moves the bends that are not at a step to where they fit best (Gauss–Newton with their instants free).
    pub(crate) fn place_bends(&self, mut now: Refined) -> Refined {
        let mut cost = self.cost(&now.description);
        for _ in 0..ROUNDS {
            let moved = self.with_bends_moved(&now.description).and_then(|d| self.descend(d));
            let lower = moved.map(|m| (self.cost(&m.description), m)).filter(|m| m.0 < cost - 1.0);
            let Some((lower, moved)) = lower else { break };
            (cost, now) = (lower, moved);
        }
        now
    }

    fn with_bends_moved(&self, d: &Description) -> Option<Description> {
        let free: Vec<usize> = (0..d.terms.len()).filter(|i| self.is_free(d, *i)).collect();
        if free.is_empty() {
            return None;
        }
        let n = 1 + d.terms.len() + free.len();
        let columns = |t: f64, out: &mut Vec<f64>| {
            out.push(1.0);
            out.extend(d.terms.iter().map(|x| x.column(t)));
            // Change at `t` from moving the bend to a later instant.
            out.extend(free.iter().map(|i| if t >= d.terms[*i].at_s { -d.terms[*i].size } else { 0.0 }));
        };
        let mut all = Part::none(n);
        for piece in self.fixes.pieces() {
            all.join(&self.part(piece, &|t| d.at(t), n, &columns));
        }
        let scale = DVector::from_fn(n, |i, _| all.normal[(i, i)].max(1e-300).sqrt().recip());
        for i in 0..n {
            for j in 0..n {
                all.normal[(i, j)] *= scale[i] * scale[j];
            }
            all.normal[(i, i)] += 1e-8;
        }
        let solved = all.normal.cholesky()?.solve(&all.right.component_mul(&scale)).component_mul(&scale);
        let most = LARGEST_MOVE_BINS * self.bin_s;
        let mut moved = d.clone();
        for (k, i) in free.iter().enumerate() {
            moved.terms[*i].at_s += solved[1 + d.terms.len() + k].clamp(-most, most);
        }
        moved.terms.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
        moved.terms.iter().all(|t| t.at_s.is_finite()).then_some(moved)
    }

    /// Whether term `i` is a bend away from every step: near a step its instant cannot be separated from the step's
    /// size.
    fn is_free(&self, d: &Description, i: usize) -> bool {
        let Term { kind: DelayTermKind::Bend, at_s, .. } = d.terms[i] else { return false };
        let near = |t: &Term| t.kind == DelayTermKind::Step && (t.at_s - at_s).abs() < AT_A_STEP_BINS * self.bin_s;
        !d.terms.iter().any(near)
    }
}

/// Ramps shorter than a bin are steps; `None` if there are none.
fn short_ramps_as_steps(d: &Description, bin_s: f64) -> Option<Description> {
    let is_ramp = |a: &Term, b: &Term| {
        let bends = a.kind == DelayTermKind::Bend && b.kind == a.kind;
        bends && b.at_s - a.at_s < bin_s && (a.size + b.size).abs() < UNEVEN * a.size.abs()
    };
    let mut terms: Vec<Term> = vec![];
    for term in &d.terms {
        match terms.last_mut().filter(|before| is_ramp(before, term)) {
            Some(ramp) => {
                let (from_s, slope) = (ramp.at_s, ramp.size);
                let (at_s, size) = (0.5 * (from_s + term.at_s), slope * (term.at_s - from_s));
                *ramp = Term { kind: DelayTermKind::Step, at_s, size };
            }
            None => terms.push(*term),
        }
    }
    (terms.len() < d.terms.len()).then_some(Description { terms, ..*d })
}

/// Consecutive steps in one direction.
struct Stairs {
    from_s: f64,
    to_s: f64,
    height_s: f64,
    spacing_s: f64,
    /// Instant at which the delay falls back after them.
    falls_s: Option<f64>,
}

impl Stairs {
    fn has(&self, t: &Term) -> bool {
        t.kind == DelayTermKind::Step && t.at_s >= self.from_s && t.at_s <= self.to_s
    }
}

fn stairs(d: &Description) -> Vec<Stairs> {
    let steps: Vec<&Term> = d.terms.iter().filter(|t| t.kind == DelayTermKind::Step).collect();
    let mut out = vec![];
    let mut start = 0;
    for run in steps.chunk_by(|a, b| (a.size > 0.0) == (b.size > 0.0)) {
        let next = start + run.len();
        if let ([first, .., last], true) = (run, run.len() >= LEAST_STAIRS) {
            out.push(Stairs {
                from_s: first.at_s,
                to_s: last.at_s,
                height_s: run.iter().map(|t| t.size).sum(),
                spacing_s: (last.at_s - first.at_s) / (run.len() - 1) as f64,
                falls_s: steps.get(next).map(|t| t.at_s),
            });
        }
        start = next;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use DelayTermKind::{Bend, Step};

    fn described(terms: &[(DelayTermKind, f64, f64)]) -> Description {
        let term = |&(kind, at_s, size): &(DelayTermKind, f64, f64)| Term { kind, at_s, size };
        Description { level_s: 0.2, terms: terms.iter().map(term).collect() }
    }

    #[test]
    fn a_ramp_shorter_than_a_bin_is_a_step_of_its_height_at_its_middle() {
        let short = described(&[(Step, 5.0, 0.1), (Bend, 20.0, 0.05), (Bend, 21.0, -0.05), (Bend, 60.0, 0.01)]);
        let found = short_ramps_as_steps(&short, 2.0).unwrap();
        let terms: Vec<(bool, f64, f64)> =
            found.terms.iter().map(|t| (t.kind == Step, t.at_s, (1e9 * t.size).round())).collect();
        assert_eq!(terms, [(true, 5.0, 1e8), (true, 20.5, 5e7), (false, 60.0, 1e7)]);
        assert_eq!(found.level_s, 0.2);
    }

    #[test]
    fn long_ramps_uneven_ramps_and_steps_stay() {
        for terms in [
            [(Bend, 20.0, 0.05), (Bend, 24.0, -0.05)],
            [(Bend, 20.0, 0.05), (Bend, 21.0, -0.03)],
            [(Bend, 20.0, 0.05), (Bend, 21.0, 0.05)],
            [(Step, 20.0, 0.05), (Step, 21.0, -0.05)],
            [(Step, 20.0, 0.05), (Bend, 21.0, -0.05)],
        ] {
            assert!(short_ramps_as_steps(&described(&terms), 2.0).is_none(), "{terms:?}");
        }
    }

    #[test]
    fn stairs_are_runs_of_steps_in_one_direction() {
        let up = described(&[(Step, 10.0, 0.1), (Step, 20.0, 0.2), (Step, 30.0, 0.1), (Step, 50.0, -0.3)]);
        let found = stairs(&up);
        assert_eq!(found.len(), 1, "one step alone is no ramp");
        let ramp = &found[0];
        assert_eq!((ramp.from_s, ramp.to_s, ramp.spacing_s, ramp.falls_s), (10.0, 30.0, 10.0, Some(50.0)));
        assert!((ramp.height_s - 0.4).abs() < 1e-12);
        assert_eq!(up.terms.iter().map(|t| ramp.has(t)).collect::<Vec<_>>(), [true, true, true, false]);
        assert!(!ramp.has(&Term { kind: Bend, at_s: 20.0, size: 0.1 }));
    }
}
