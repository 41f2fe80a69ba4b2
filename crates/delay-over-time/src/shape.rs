//! The name of a description: its course between the first and the last fix (section 4 of the specification).

use crate::describe::Description;
use record::{DelayKind, DelayTermKind};

/// A slope steeper than this is a flush, s/s.
const FLUSH: f64 = -0.1;
/// Least growth that counts as a queue with a flush, and without one, s.
const QUEUE_S: f64 = 0.05;
const BUILD_UP_S: f64 = 0.3;
/// Growth faster than this is not a clock drift, s/s.
const FAST: f64 = 1e-3;

/// Rises and falls of a description.
#[derive(Debug, Clone, Default)]
pub(crate) struct Shape {
    pub(crate) least_s: f64,
    pub(crate) most_s: f64,
    /// Slow rises and falls, downward jumps, s.
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
        let least_s = if self.drop_s > 0.5 * self.rise_s { QUEUE_S } else { BUILD_UP_S };
        if rises && self.drop_s + self.fall_s > 0.5 * self.rise_s && self.rise_s > least_s {
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
    use crate::dense::Random;
    use crate::describe::Term;
    use DelayTermKind::{Bend, Step};

    fn word(terms: &[(DelayTermKind, f64, f64)]) -> DelayKind {
        let terms = terms.iter().map(|(kind, at_s, size)| Term { kind: *kind, at_s: *at_s, size: *size }).collect();
        Shape::new(&Description { level_s: 0.2, terms }, [0.0, 240.0]).word()
    }

    #[test]
    fn words_follow_the_shape() {
        assert_eq!(word(&[(Step, 120.0, 0.15)]), DelayKind::Steps);
        assert_eq!(
            word(&[(Step, 50.0, 0.2), (Step, 90.0, -0.21), (Step, 150.0, 0.19), (Step, 190.0, -0.2)]),
            DelayKind::Switches
        );
        assert_eq!(word(&[(Bend, 60.0, 0.021), (Bend, 168.0, -0.021), (Step, 168.0, -2.3)]), DelayKind::Queues);
        assert_eq!(word(&[(Bend, 60.0, 0.021), (Bend, 168.0, -1.021), (Bend, 170.3, 1.0)]), DelayKind::Queues);
        // Two rises of 1.2 s; it falls back once at a time and once slowly.
        assert_eq!(
            word(&[
                (Bend, 40.0, 0.04),
                (Bend, 70.0, -0.04),
                (Step, 110.0, -1.2),
                (Bend, 150.0, 0.04),
                (Bend, 180.0, -0.06),
                (Bend, 220.0, 0.02),
            ]),
            DelayKind::Queues
        );
        assert_eq!(word(&[(Bend, 60.0, 0.02)]), DelayKind::BuildsUp);
        assert_eq!(word(&[(Bend, 0.0, 0.0005)]), DelayKind::Drifts);
    }

    /// Some steps and bends within and outside of a flight from 10 s to 110 s, at whole seconds.
    fn anything(random: &mut Random) -> Description {
        let mut term = |k: usize| {
            let at_s = random.uniform(-5.0, 115.0).round() + 0.1 * k as f64;
            let kind = if random.uniform(0.0, 1.0) < 0.5 { Step } else { Bend };
            let size = random.normal() * if kind == Step { 0.3 } else { 0.05 };
            Term { kind, at_s, size }
        };
        let mut terms: Vec<Term> = (0..6).map(&mut term).collect();
        terms.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
        Description { level_s: 0.2, terms }
    }

    /// Compared with a walk along the curve in steps of 10 ms.
    #[test]
    fn a_shape_matches_a_walk_along_the_curve() {
        let mut random = Random::new(1);
        for _ in 0..60 {
            let d = anything(&mut random);
            let shape = Shape::new(&d, [10.0, 110.0]);
            let curve: Vec<f64> = (0..=10_000).map(|k| d.at(10.0 + 0.01 * f64::from(k) + 1e-7)).collect();
            let (mut rise, mut fall, mut drop, mut steepest) = (0.0, 0.0, 0.0, 0.0f64);
            for (k, w) in curve.windows(2).enumerate() {
                let by = w[1] - w[0];
                let t = 10.0 + 0.01 * (k as f64 + 1.0);
                let jump: f64 =
                    d.terms.iter().filter(|x| x.kind == Step && (x.at_s - t).abs() < 1e-6).map(|x| x.size).sum();
                let slope = (by - jump) / 0.01;
                drop += (-jump).max(0.0);
                match slope {
                    s if s < FLUSH => drop -= by - jump,
                    s if s > 0.0 => rise += by - jump,
                    _ => fall -= by - jump,
                }
                if slope >= FLUSH && slope.abs() > steepest.abs() {
                    steepest = slope;
                }
            }
            let room = 0.02;
            let (least, most) = curve.iter().fold((f64::MAX, f64::MIN), |(l, m), x| (l.min(*x), m.max(*x)));
            assert!((shape.least_s - least).abs() < room && (shape.most_s - most).abs() < room, "{d:?}");
            assert!((shape.span_s() - (most - least)).abs() < 2.0 * room);
            assert!(
                (shape.rise_s - rise).abs() < room && (shape.fall_s - fall).abs() < room,
                "{d:?} {shape:?} {rise} {fall}"
            );
            assert!((shape.drop_s - drop).abs() < room, "{d:?} {shape:?} {drop}");
            assert!((shape.steepest - steepest).abs() < 1e-3, "{d:?} {} {steepest}", shape.steepest);
        }
    }

    /// A queue grows by more than 50 ms and loses more than half of it at once.
    #[test]
    fn a_queue_is_flushed_by_more_than_half_of_its_growth() {
        let grows_by_fifth_of_second_and_drops =
            |by: f64| word(&[(Bend, 20.0, 0.001), (Bend, 220.0, -0.001), (Step, 220.0, -by)]);
        assert_eq!(grows_by_fifth_of_second_and_drops(0.11), DelayKind::Queues);
        assert_eq!(grows_by_fifth_of_second_and_drops(0.09), DelayKind::Drifts);
        let small = word(&[(Bend, 20.0, 0.000_2), (Bend, 220.0, -0.000_2), (Step, 220.0, -0.04)]);
        assert_ne!(small, DelayKind::Queues);
    }
}
