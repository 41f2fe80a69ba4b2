//! Paths known at every instant.

use crate::error::{SimulateError, within};
use crate::random::generator;
use rand::RngExt;
use std::f64::consts::{PI, TAU};

/// Spacing of the nodes between which the path is interpolated, s.
const STEP_S: f64 = 0.005;
/// The path is known this long before time zero and after its duration, s, for late and early sensors.
pub(crate) const MARGIN_S: f64 = 10.0;
/// Radius of the circuit's turns, m.
const TURN_RADIUS_M: f64 = 30.0;
/// Width of each of the two raised cosines that smooth the roll-in, s.
const ROLL_IN_S: f64 = 0.6;
/// Mean speed of the circuit, its variation (both m/s) and the period of the variation (s): 15 to 20 m/s.
const SPEED: (f64, f64, f64) = (17.5, 2.5, 23.0);
/// Half the height climbed (m) and the period of up and down (s).
const CLIMB: (f64, f64) = (10.0, 90.0);

/// Position and velocity of the aircraft, in metres and m/s north, east, down of the origin's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// North, east, down, m.
    pub position: [f64; 3],
    /// North, east, down, m/s: the derivative of the position.
    pub velocity: [f64; 3],
}

/// A flown path: position and velocity at every instant of the flight.
///
/// Velocity is a closed formula of time and heading; heading and position are its integrals
/// (Simpson's rule over nodes 5 ms apart, cubic Hermite between them). Position is the integral of
/// velocity to better than 1e-7 m over five minutes (test
/// `position_is_the_integral_of_velocity_within_a_tenth_of_a_micrometre`).
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    law: Law,
    duration_s: f64,
    headings: Vec<f64>,
    positions: Vec<[f64; 2]>,
}

/// The law of velocity over time and heading.
#[derive(Debug, Clone, PartialEq)]
enum Law {
    Circuit(Circuit),
    Straight { speed_mps: f64, heading_rad: f64 },
    Still,
}

/// Straights and turns of the design note, section 5.7.
#[derive(Debug, Clone, PartialEq)]
struct Circuit {
    turns: Vec<Turn>,
    heading_rad: f64,
    speed_phase_rad: f64,
}

/// A turn from `begin_s` to `end_s`, to the right if `sign` is positive.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Turn {
    begin_s: f64,
    end_s: f64,
    sign: f64,
}

impl Trajectory {
    /// The circuit of the design note, section 5.7: 15 to 20 m/s with a period of 23 s, straights of 2.5 to 4.5 s,
    /// turns of 180, 270 or 360 degrees to either side with R = 30 m and a smooth roll-in, and a climb of 20 m and back
    /// every 90 s. `seed` determines the turns.
    ///
    /// # Errors
    /// [`SimulateError::Setting`] if the duration is not between 0 and 86 400 s.
    pub fn circuit(duration_s: f64, seed: u64) -> Result<Trajectory, SimulateError> {
        Trajectory::integrate(Law::Circuit(Circuit::draw(duration_s, seed)), duration_s)
    }

    /// Level flight at constant speed, m/s, and heading, rad from north over east.
    ///
    /// # Errors
    /// [`SimulateError::Setting`] if the duration is not between 0 and 86 400 s, the speed not between
    /// -1000 and 1000 m/s or the heading not finite.
    pub fn straight(duration_s: f64, speed_mps: f64, heading_rad: f64) -> Result<Trajectory, SimulateError> {
        within("speed_mps", speed_mps, -1000.0, 1000.0, "between -1000 and 1000 m/s")?;
        within("heading_rad", heading_rad, f64::MIN, f64::MAX, "a finite number")?;
        Trajectory::integrate(Law::Straight { speed_mps, heading_rad }, duration_s)
    }

    /// A stationary aircraft at the origin.
    ///
    /// # Errors
    /// [`SimulateError::Setting`] if the duration is not between 0 and 86 400 s.
    pub fn still(duration_s: f64) -> Result<Trajectory, SimulateError> {
        Trajectory::integrate(Law::Still, duration_s)
    }

    /// Duration from time zero to the end, s.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.duration_s
    }

    /// Motion at `t_s` seconds after the start. Known from 10 s before time zero to 10 s after the end; outside, the
    /// aircraft continues straight from that edge.
    #[must_use]
    pub fn at(&self, t_s: f64) -> Motion {
        let inside = t_s.clamp(-MARGIN_S, self.duration_s + MARGIN_S);
        let (node, share) = self.locate(inside);
        let velocity = self.law.velocity(inside, self.heading(node, share));
        let beyond = t_s - inside;
        let horizontal = self.horizontal(node, share);
        Motion {
            position: [
                horizontal[0] + velocity[0] * beyond,
                horizontal[1] + velocity[1] * beyond,
                self.law.down(inside) + velocity[2] * beyond,
            ],
            velocity,
        }
    }

    fn integrate(law: Law, duration_s: f64) -> Result<Trajectory, SimulateError> {
        within("duration_s", duration_s, 0.0, 86_400.0, "between 0 and 86 400 s")?;
        let nodes = ((duration_s + 2.0 * MARGIN_S) / STEP_S).ceil() as usize + 2;
        let mut path = Trajectory { headings: headings(&law, nodes), positions: vec![], law, duration_s };
        path.positions = path.integrated_positions();
        Ok(path)
    }

    /// Simpson's rule over each step, so that the error of the step size is h^4 only; then shifted so that time zero is
    /// at the origin.
    fn integrated_positions(&self) -> Vec<[f64; 2]> {
        let mut positions = vec![[0.0, 0.0]];
        for node in 0..self.headings.len() - 1 {
            let [a, m, b] = [0.0, 0.5, 1.0].map(|share| self.node_velocity(node, share));
            let last = positions[node];
            positions.push([0, 1].map(|k| last[k] + STEP_S / 6.0 * (a[k] + 4.0 * m[k] + b[k])));
        }
        let zero = positions[(MARGIN_S / STEP_S).round() as usize];
        positions.iter().map(|p| [p[0] - zero[0], p[1] - zero[1]]).collect()
    }

    fn node_velocity(&self, node: usize, share: f64) -> [f64; 3] {
        self.law.velocity(node_time(node) + share * STEP_S, self.heading(node, share))
    }

    /// The node before `t_s`, and the distance after it in steps.
    fn locate(&self, t_s: f64) -> (usize, f64) {
        let steps = (t_s + MARGIN_S) / STEP_S;
        let node = (steps.floor().max(0.0) as usize).min(self.headings.len() - 2);
        (node, steps - node as f64)
    }

    fn heading(&self, node: usize, share: f64) -> f64 {
        let rate = |n| self.law.turn_rate(node_time(n));
        hermite(share, (self.headings[node], self.headings[node + 1]), (rate(node), rate(node + 1)))
    }

    fn horizontal(&self, node: usize, share: f64) -> [f64; 2] {
        let (a, b) = (self.node_velocity(node, 0.0), self.node_velocity(node, 1.0));
        [0, 1].map(|k| hermite(share, (self.positions[node][k], self.positions[node + 1][k]), (a[k], b[k])))
    }
}

impl Law {
    fn velocity(&self, t_s: f64, heading_rad: f64) -> [f64; 3] {
        let speed = self.speed(t_s);
        let (east, north) = heading_rad.sin_cos();
        [speed * north, speed * east, self.down_rate(t_s)]
    }

    fn speed(&self, t_s: f64) -> f64 {
        match self {
            Law::Circuit(circuit) => SPEED.0 + SPEED.1 * (TAU * t_s / SPEED.2 + circuit.speed_phase_rad).sin(),
            Law::Straight { speed_mps, .. } => *speed_mps,
            Law::Still => 0.0,
        }
    }

    fn first_heading(&self) -> f64 {
        match self {
            Law::Circuit(circuit) => circuit.heading_rad,
            Law::Straight { heading_rad, .. } => *heading_rad,
            Law::Still => 0.0,
        }
    }

    fn turn_rate(&self, t_s: f64) -> f64 {
        match self {
            Law::Circuit(circuit) => self.speed(t_s) * circuit.curvature(t_s),
            Law::Straight { .. } | Law::Still => 0.0,
        }
    }

    fn down(&self, t_s: f64) -> f64 {
        match self {
            Law::Circuit(_) => -CLIMB.0 * (1.0 - (TAU * t_s / CLIMB.1).cos()),
            Law::Straight { .. } | Law::Still => 0.0,
        }
    }

    fn down_rate(&self, t_s: f64) -> f64 {
        match self {
            Law::Circuit(_) => -CLIMB.0 * TAU / CLIMB.1 * (TAU * t_s / CLIMB.1).sin(),
            Law::Straight { .. } | Law::Still => 0.0,
        }
    }
}

impl Circuit {
    fn draw(duration_s: f64, seed: u64) -> Circuit {
        let mut random = generator(seed, "circuit");
        let heading_rad = random.random_range(-PI..PI);
        let speed_phase_rad = random.random_range(-PI..PI);
        let (mut turns, mut now, mut sign) = (vec![], -MARGIN_S, 1.0);
        while now < duration_s + MARGIN_S {
            let begin_s = now + random.random_range(2.5..4.5);
            let angle = [PI, 1.5 * PI, TAU][random.random_range(0..3)];
            now = begin_s + angle * TURN_RADIUS_M / SPEED.0;
            turns.push(Turn { begin_s, end_s: now, sign });
            sign = if random.random_bool(0.5) { 1.0 } else { -1.0 };
        }
        Circuit { turns, heading_rad, speed_phase_rad }
    }

    /// 1/m, positive to the right.
    fn curvature(&self, t_s: f64) -> f64 {
        let first = self.turns.partition_point(|turn| turn.end_s + ROLL_IN_S < t_s);
        let near = self.turns[first..].iter().take_while(|turn| turn.begin_s - ROLL_IN_S < t_s);
        near.map(|turn| turn.sign * (roll_in(t_s - turn.begin_s) - roll_in(t_s - turn.end_s))).sum::<f64>()
            / TURN_RADIUS_M
    }
}

fn node_time(node: usize) -> f64 {
    node as f64 * STEP_S - MARGIN_S
}

/// Simpson's rule over the turn rate, with the heading at time zero given by the law.
fn headings(law: &Law, nodes: usize) -> Vec<f64> {
    let mut headings = vec![0.0];
    for node in 0..nodes - 1 {
        let rate = |share: f64| law.turn_rate(node_time(node) + share * STEP_S);
        headings.push(headings[node] + STEP_S / 6.0 * (rate(0.0) + 4.0 * rate(0.5) + rate(1.0)));
    }
    let shift = law.first_heading() - headings[(MARGIN_S / STEP_S).round() as usize];
    headings.iter().map(|heading| heading + shift).collect()
}

/// A step from 0 to 1 between -0.6 and 0.6 s: a unit step smoothed by two raised cosines of
/// 0.6 s, in closed form.
fn roll_in(t_s: f64) -> f64 {
    if t_s.abs() >= ROLL_IN_S {
        return if t_s > 0.0 { 1.0 } else { 0.0 };
    }
    let (w, x, a) = (ROLL_IN_S, t_s.abs(), TAU / ROLL_IN_S);
    let (sin, cos) = (a * x).sin_cos();
    let half = (w * x - x * x / 2.0 + (w - x) * sin / (2.0 * a) + 2.0 * (1.0 - cos) / (a * a)) / (w * w);
    0.5 + half * t_s.signum()
}

/// Cubic between two nodes one step apart, from values and rates.
fn hermite(share: f64, value: (f64, f64), rate: (f64, f64)) -> f64 {
    let (s, r) = (share, 1.0 - share);
    value.0 + (value.1 - value.0) * s * s * (3.0 - 2.0 * s) + STEP_S * s * r * (rate.0 * r - rate.1 * s)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Gauss-Legendre with five points, on steps that do not share any node with the path's.
    fn integral_of_velocity(path: &Trajectory, from: f64, to: f64) -> [f64; 3] {
        const NODES: [(f64, f64); 3] = [
            (0.0, 0.568_888_888_888_888_9),
            (0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
            (0.906_179_845_938_664, 0.236_926_885_056_189_08),
        ];
        let pieces = ((to - from) / 0.011).ceil();
        let half = (to - from) / pieces / 2.0;
        let mut sum = [0.0; 3];
        for piece in 0..pieces as usize {
            let middle = from + half * (2.0 * piece as f64 + 1.0);
            for (x, weight) in NODES {
                for side in if x == 0.0 { &[1.0][..] } else { &[-1.0, 1.0] } {
                    let v = path.at(middle + side * x * half).velocity;
                    (0..3).for_each(|k| sum[k] += weight * half * v[k]);
                }
            }
        }
        sum
    }

    #[test]
    fn position_is_the_integral_of_velocity_within_a_tenth_of_a_micrometre() {
        let path = Trajectory::circuit(300.0, 3).unwrap();
        let start = path.at(-7.3).position;
        for end in [0.0, 0.0123, 55.557, 180.0, 299.9991] {
            let moved = integral_of_velocity(&path, -7.3, end);
            let there = path.at(end).position;
            for k in 0..3 {
                let error = there[k] - start[k] - moved[k];
                assert!(error.abs() < 1e-7, "axis {k} at {end} s: {error} m");
            }
        }
    }

    #[test]
    fn the_derivative_of_position_is_velocity_between_nodes() {
        // Fourth-order central difference with h = 20 ms: truncation h^4/30 |p^(5)| < 1e-6 m/s here.
        let path = Trajectory::circuit(60.0, 8).unwrap();
        let h = 0.02;
        for i in 0..4000 {
            let t = f64::from(i) * 0.014_93;
            let p = |dt: f64| path.at(t + dt).position;
            let velocity = path.at(t).velocity;
            for (k, v) in velocity.iter().enumerate() {
                let slope = (p(-2.0 * h)[k] - 8.0 * p(-h)[k] + 8.0 * p(h)[k] - p(2.0 * h)[k]) / (12.0 * h);
                assert!((slope - v).abs() < 2e-5, "axis {k} at {t} s: {slope} and {v}");
            }
        }
    }

    #[test]
    fn the_circuit_covers_speeds_from_15_to_20_metres_per_second() {
        let path = Trajectory::circuit(180.0, 1).unwrap();
        let speeds: Vec<f64> =
            (0..18_000).map(|i| path.at(f64::from(i) * 0.01).velocity).map(|v| v[0].hypot(v[1])).collect();
        let (low, high) = speeds.iter().fold((f64::MAX, 0.0_f64), |(l, h), &s| (l.min(s), h.max(s)));
        assert!((15.0 - 1e-9..15.001).contains(&low) && (19.999..=20.0 + 1e-9).contains(&high), "{low} {high}");
    }

    #[test]
    fn turns_have_a_radius_of_thirty_metres_and_go_both_ways() {
        let path = Trajectory::circuit(300.0, 5).unwrap();
        let curvature = |t: f64| {
            let (a, b) = (path.at(t - 0.005).velocity, path.at(t + 0.005).velocity);
            let turned = (b[1].atan2(b[0]) - a[1].atan2(a[0]) + 3.0 * PI).rem_euclid(TAU) - PI;
            let v = path.at(t).velocity;
            turned / 0.01 / v[0].hypot(v[1])
        };
        let all: Vec<f64> = (0..3000).map(|i| curvature(f64::from(i) * 0.1)).collect();
        let (low, high) = all.iter().fold((0.0_f64, 0.0_f64), |(l, h), &c| (l.min(c), h.max(c)));
        assert!((1.0 / high - 30.0).abs() < 0.01 && (1.0 / low + 30.0).abs() < 0.01, "{low} {high}");
        assert!(all.iter().any(|c| c.abs() < 1e-9), "there are straights");
    }

    #[test]
    fn a_straight_flight_has_the_position_of_the_closed_formula() {
        let path = Trajectory::straight(100.0, 20.0, 0.5).unwrap();
        for t in [-12.0, 0.0, 33.333, 100.0, 115.0] {
            let p = path.at(t).position;
            assert!((p[0] - 20.0 * t * 0.5f64.cos()).abs() < 1e-8 && (p[1] - 20.0 * t * 0.5f64.sin()).abs() < 1e-8);
        }
    }

    #[test]
    fn roll_in_is_a_smooth_step_from_zero_to_one() {
        assert_eq!((roll_in(-0.6), roll_in(0.0), roll_in(0.6)), (0.0, 0.5, 1.0));
        // Its slope is the convolution of two raised cosines, computed here by brute force.
        let hann = |x: f64| if x.abs() < 0.3 { (1.0 + (TAU * x / 0.6).cos()) / 0.6 } else { 0.0 };
        for x in [-0.55, -0.2, 0.01, 0.31, 0.5] {
            let direct: f64 = (0..6000).map(|i| f64::from(i) * 1e-4 - 0.3).map(|s| hann(s) * hann(x - s) * 1e-4).sum();
            let slope = (roll_in(x + 1e-5) - roll_in(x - 1e-5)) / 2e-5;
            assert!((slope - direct).abs() < 1e-6, "{x}: {slope} {direct}");
        }
    }

    #[test]
    fn different_seeds_give_different_circuits() {
        let end = |seed| Trajectory::circuit(60.0, seed).unwrap().at(60.0).position;
        assert_eq!(end(4), end(4));
        assert_ne!(end(4), end(5));
    }

    #[test]
    fn a_path_with_non_finite_numbers_is_rejected() {
        assert!(Trajectory::still(f64::NAN).is_err() && Trajectory::circuit(-1.0, 0).is_err());
        assert!(Trajectory::straight(1.0, f64::NAN, 0.0).is_err());
        assert!(Trajectory::straight(1.0, 20.0, f64::INFINITY).is_err());
    }
}
