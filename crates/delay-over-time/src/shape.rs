//! The word for a description: what it does between the first and the last fix (section 4 of the specification).

use crate::describe::Description;
use record::{DelayKind, DelayTermKind};

/// A slope steeper than this is a flush, s/s.
const FLUSH: f64 = -0.1;
/// Least growth that is called a queue with a flush, and without one, s.
const QUEUE_S: f64 = 0.05;
const BUILD_UP_S: f64 = 0.3;
/// Growth faster than this is no clock, s/s.
const FAST: f64 = 1e-3;

/// Rises and falls of a description.
#[derive(Debug, Clone, Default)]
pub(crate) struct Shape {
    pub(crate) least_s: f64,
    pub(crate) most_s: f64,
    /// Slow rises and falls, jumps down, s.
    rise_s: f64,
    fall_s: f64,
    drop_s: f64,
    /// Steepest slow slope, s/s.
    pub(crate) steepest: f64,
    /// Levels between steps, s.
    levels: Vec<f64>,
    duration_s: f64,
}

impl Shape {
    pub(crate) fn new(d: &Description, [from, to]: [f64; 2]) -> Shape {
        let mut edges: Vec<f64> = d.terms.iter().map(|x| x.at_s).filter(|t| *t > from && *t < to).collect();
        edges.push(to);
        edges.sort_by(f64::total_cmp);
        let first = d.at(from);
        let mut shape = Shape { least_s: first, most_s: first, duration_s: to - from, ..Shape::default() };
        shape.levels.push(first);
        let mut start = from;
        for end in edges {
            let slope: f64 =
                d.terms.iter().filter(|x| x.kind == DelayTermKind::Bend && x.at_s <= start).map(|x| x.size).sum();
            let before = d.at(start) + slope * (end - start);
            shape.change(slope * (end - start), slope);
            let after = d.at(end);
            if after < before - 1e-9 {
                shape.drop_s += before - after;
            }
            if (after - before).abs() > 1e-9 {
                shape.levels.push(after);
            }
            shape.least_s = shape.least_s.min(before).min(after);
            shape.most_s = shape.most_s.max(before).max(after);
            start = end;
        }
        shape
    }

    fn change(&mut self, by: f64, slope: f64) {
        if slope < FLUSH {
            self.drop_s -= by;
        } else if by > 0.0 {
            self.rise_s += by;
        } else {
            self.fall_s -= by;
        }
        if slope >= FLUSH && slope.abs() > self.steepest.abs() {
            self.steepest = slope;
        }
    }

    pub(crate) fn span_s(&self) -> f64 {
        self.most_s - self.least_s
    }

    pub(crate) fn word(&self) -> DelayKind {
        let span = self.span_s();
        if self.rise_s + self.fall_s < 0.25 * span {
            return if self.is_two_levels() { DelayKind::Switches } else { DelayKind::Steps };
        }
        let rises = self.rise_s > 0.5 * span;
        if rises && self.drop_s > 0.5 * self.rise_s && self.rise_s > QUEUE_S {
            return DelayKind::Queues;
        }
        if rises && self.fall_s > 0.5 * self.rise_s && self.rise_s > BUILD_UP_S {
            return DelayKind::Queues;
        }
        let fast = self.rise_s > FAST * self.duration_s;
        if self.rise_s > BUILD_UP_S && span > BUILD_UP_S && fast { DelayKind::BuildsUp } else { DelayKind::Drifts }
    }

    fn is_two_levels(&self) -> bool {
        let low = self.levels.iter().copied().fold(f64::MAX, f64::min);
        let high = self.levels.iter().copied().fold(f64::MIN, f64::max);
        let near = |x: &f64| (x - low).abs().min((x - high).abs()) < 0.25 * (high - low);
        self.levels.len() >= 4 && self.levels.iter().all(near)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::describe::Term;

    fn word(terms: &[(DelayTermKind, f64, f64)]) -> DelayKind {
        let terms = terms.iter().map(|(kind, at_s, size)| Term { kind: *kind, at_s: *at_s, size: *size }).collect();
        Shape::new(&Description { level_s: 0.2, terms }, [0.0, 240.0]).word()
    }

    #[test]
    fn words_follow_the_shape() {
        use DelayTermKind::{Bend, Step};
        assert_eq!(word(&[(Step, 120.0, 0.15)]), DelayKind::Steps);
        assert_eq!(
            word(&[(Step, 50.0, 0.2), (Step, 90.0, -0.21), (Step, 150.0, 0.19), (Step, 190.0, -0.2)]),
            DelayKind::Switches
        );
        assert_eq!(word(&[(Bend, 60.0, 0.021), (Bend, 168.0, -0.021), (Step, 168.0, -2.3)]), DelayKind::Queues);
        assert_eq!(word(&[(Bend, 60.0, 0.021), (Bend, 168.0, -1.021), (Bend, 170.3, 1.0)]), DelayKind::Queues);
        assert_eq!(word(&[(Bend, 60.0, 0.02)]), DelayKind::BuildsUp);
        assert_eq!(word(&[(Bend, 0.0, 0.0005)]), DelayKind::Drifts);
    }
}
