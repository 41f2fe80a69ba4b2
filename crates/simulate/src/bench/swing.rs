//! Motion of the bar: laws with exact derivatives that start and end at rest.

use super::bar::Bar;
use super::lag::{Nodes, STEP_S};
use crate::error::{SimulateError, within};
use crate::random::generator;
use rand::{Rng, RngExt};
use rand_distr::{Distribution, Exp1, StandardNormal};
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};

/// Time to fade a swing in at its start and out at its end, s; at most a quarter of the swing.
const EASE_S: f64 = 2.0;

/// A kind of motion of the bar.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "moved", rename_all = "kebab-case")]
pub enum Swing {
    /// Waved by hand: a sum of sines determined by the seed, most of them about `centre_hz`, a few faster and smaller.
    Hand {
        /// Largest angle, rad.
        amplitude_rad: f64,
        /// Mean frequency of the swing, Hz.
        centre_hz: f64,
        /// Standard deviation of the frequencies about it, Hz.
        spread_hz: f64,
        /// Fastest of the small motions, Hz.
        fastest_hz: f64,
    },
    /// A hanging pendulum, pushed about twice per swing: `θ″ = −(g/L) sin θ − c θ′ + pushes`.
    Pushed {
        /// Largest angle, rad; reached within a percent.
        amplitude_rad: f64,
        /// Damping c, 1/s.
        damping_per_s: f64,
    },
    /// One sine, which makes a lag hard to distinguish from a delay.
    Sine {
        /// Largest angle, rad.
        amplitude_rad: f64,
        /// Frequency, Hz.
        frequency_hz: f64,
    },
    /// It rests.
    Still,
}

impl Swing {
    /// Waved by hand to ±60° about 0.5 Hz, with faster motions up to 2.5 Hz (design note 2).
    #[must_use]
    pub fn hand() -> Swing {
        Swing::Hand { amplitude_rad: PI / 3.0, centre_hz: 0.5, spread_hz: 0.12, fastest_hz: 2.5 }
    }

    /// A hanging pendulum pushed to ±60° (design note 2).
    #[must_use]
    pub fn pushed() -> Swing {
        Swing::Pushed { amplitude_rad: PI / 3.0, damping_per_s: 0.12 }
    }

    pub(super) fn check(&self) -> Result<(), SimulateError> {
        let amplitude = |a: f64| within("swing.amplitude_rad", a, 0.0, 3.0, "between 0 and 3 rad");
        match *self {
            Swing::Hand { amplitude_rad, centre_hz, spread_hz, fastest_hz } => {
                check_hand(centre_hz, spread_hz, fastest_hz)?;
                amplitude(amplitude_rad)
            }
            Swing::Pushed { amplitude_rad, damping_per_s } => {
                within("swing.damping_per_s", damping_per_s, 0.0, 10.0, "between 0 and 10 1/s")?;
                amplitude(amplitude_rad)
            }
            Swing::Sine { amplitude_rad, frequency_hz } => {
                within("swing.frequency_hz", frequency_hz, 0.01, 20.0, "between 0.01 and 20 Hz")?;
                amplitude(amplitude_rad)
            }
            Swing::Still => Ok(()),
        }
    }
}

/// The frequencies of a hand-waved bar.
fn check_hand(centre_hz: f64, spread_hz: f64, fastest_hz: f64) -> Result<(), SimulateError> {
    within("swing.centre_hz", centre_hz, 0.05, 10.0, "between 0.05 and 10 Hz")?;
    within("swing.spread_hz", spread_hz, 0.0, 10.0, "between 0 and 10 Hz")?;
    within("swing.fastest_hz", fastest_hz, 0.8, 20.0, "between 0.8 and 20 Hz")
}

/// A swing with its random values: angle about the angle at rest and its derivatives, from start to end.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct SwingCurve {
    law: Law,
    swing_s: f64,
}

#[derive(Debug, Clone, PartialEq)]
enum Law {
    Still,
    Sines(Vec<Sine>),
    Pendulum(Nodes),
}

/// `amplitude · sin(ω t + phase)`.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Sine {
    amplitude: f64,
    omega: f64,
    phase: f64,
}

impl SwingCurve {
    pub(super) fn draw(swing: Swing, swing_s: f64, bar: &Bar, gravity_mps2: f64, seed: u64) -> SwingCurve {
        let mut random = generator(seed, "bench swing");
        let law = match swing {
            Swing::Still => Law::Still,
            Swing::Sine { amplitude_rad, frequency_hz } => {
                Law::Sines(vec![Sine { amplitude: amplitude_rad, omega: TAU * frequency_hz, phase: 0.0 }])
            }
            Swing::Hand { amplitude_rad, centre_hz, spread_hz, fastest_hz } => {
                let sines = hand(centre_hz, spread_hz, fastest_hz, &mut random);
                SwingCurve { law: Law::Sines(sines), swing_s }.scaled_to(amplitude_rad)
            }
            Swing::Pushed { amplitude_rad, damping_per_s } => {
                let pushes = Pushes::draw(swing_s, gravity_mps2, bar.length_m, damping_per_s, &mut random);
                Law::Pendulum(pushes.scaled_to(amplitude_rad).integrate(STEP_S))
            }
        };
        SwingCurve { law, swing_s }
    }

    /// Angle, rate, acceleration, jerk at `t_s` after its start: rad and seconds. Zero outside.
    pub(super) fn at(&self, t_s: f64) -> [f64; 4] {
        if !(0.0..=self.swing_s).contains(&t_s) {
            return [0.0; 4];
        }
        let free = match &self.law {
            Law::Still => [0.0; 4],
            Law::Sines(sines) => sum_of(sines, t_s),
            Law::Pendulum(nodes) => nodes.at(t_s),
        };
        let ease_s = EASE_S.min(self.swing_s / 4.0);
        let window = product(ease(t_s, ease_s), turned(ease(self.swing_s - t_s, ease_s)));
        product(window, free)
    }

    /// Largest angle, to within its change in 5 ms.
    fn largest(&self) -> f64 {
        let count = (self.swing_s / 0.005) as usize;
        (0..=count).map(|i| self.at(i as f64 * 0.005)[0].abs()).fold(0.0, f64::max)
    }

    /// The sines, scaled to the requested largest angle of the swing.
    fn scaled_to(self, amplitude: f64) -> Law {
        let factor = amplitude / self.largest().max(f64::MIN_POSITIVE);
        match self.law {
            Law::Sines(sines) => {
                Law::Sines(sines.into_iter().map(|s| Sine { amplitude: s.amplitude * factor, ..s }).collect())
            }
            law => law,
        }
    }
}

/// Sixteen sines of the swing itself, eight faster and smaller ones.
fn hand(centre_hz: f64, spread_hz: f64, fastest_hz: f64, random: &mut impl Rng) -> Vec<Sine> {
    let mut sines = vec![];
    let mut sine = |f: f64, amplitude: f64, random: &mut dyn FnMut() -> f64| {
        sines.push(Sine { amplitude, omega: TAU * f, phase: random() });
    };
    for _ in 0..16 {
        let normal: f64 = StandardNormal.sample(random);
        let amplitude = rayleigh(random);
        let f = (centre_hz + spread_hz * normal).clamp(0.3 * centre_hz, 2.4 * centre_hz);
        sine(f, amplitude, &mut || random.random_range(0.0..TAU));
    }
    for _ in 0..8 {
        let f = random.random_range(0.8..=fastest_hz);
        let amplitude = 0.16 * rayleigh(random) * (0.8 / f).powi(2);
        sine(f, amplitude, &mut || random.random_range(0.0..TAU));
    }
    sines
}

fn rayleigh(random: &mut impl Rng) -> f64 {
    let e: f64 = Exp1.sample(random);
    (2.0 * e).sqrt()
}

fn sum_of(sines: &[Sine], t_s: f64) -> [f64; 4] {
    let mut sum = [0.0; 4];
    for Sine { amplitude, omega, phase } in sines {
        let (sin, cos) = (omega * t_s + phase).sin_cos();
        let terms = [sin, omega * cos, -omega * omega * sin, -omega.powi(3) * cos];
        sum.iter_mut().zip(terms).for_each(|(sum, term)| *sum += amplitude * term);
    }
    sum
}

/// Pushes on a hanging pendulum: acceleration `height · sin⁴` over the width of each.
#[derive(Debug, Clone)]
struct Pushes {
    swing_s: f64,
    stiffness: f64,
    damping: f64,
    pushes: Vec<Push>,
}

#[derive(Debug, Clone, Copy)]
struct Push {
    begin_s: f64,
    width_s: f64,
    height: f64,
}

impl Pushes {
    fn draw(swing_s: f64, gravity: f64, length: f64, damping: f64, random: &mut impl Rng) -> Pushes {
        let stiffness = gravity / length;
        // A swing of 60 degrees takes 7 % longer than a small one.
        let half_period = 1.07 * PI / stiffness.sqrt().max(1e-3);
        let count = (swing_s / half_period) as usize;
        let mut pushes = vec![];
        for i in 0..count {
            let [late, strong] = [0, 1].map(|_| -> f64 { StandardNormal.sample(random) });
            let side = if i % 2 == 0 { 1.0 } else { -1.0 };
            pushes.push(Push {
                begin_s: 0.2 + i as f64 * half_period + 0.05 * late,
                width_s: random.random_range(0.35..0.6),
                height: side * (1.35 + 0.35 * strong),
            });
        }
        Pushes { swing_s, stiffness, damping, pushes }
    }

    /// Pushes of the smallest strength that reaches the requested angle: steps up to the first that exceeds it, then
    /// bisection. (A growing swing gets out of step with its pushes: stronger pushes do not always swing further.)
    fn scaled_to(self, amplitude: f64) -> Pushes {
        let scaled = |factor: f64| {
            let pushes = self.pushes.iter().map(|push| Push { height: push.height * factor, ..*push }).collect();
            Pushes { pushes, ..self.clone() }
        };
        let far_enough = |factor: &f64| {
            let law = Law::Pendulum(scaled(*factor).integrate(0.005));
            SwingCurve { law, swing_s: self.swing_s }.largest() >= amplitude
        };
        let mut high = (0..40).map(|step| 0.1 * 1.15_f64.powi(step)).find(far_enough).unwrap_or(26.8);
        let mut low = high / 1.15;
        for _ in 0..16 {
            let middle = (low + high) / 2.0;
            if far_enough(&middle) {
                high = middle;
            } else {
                low = middle;
            }
        }
        scaled(high)
    }

    /// RK4 from rest; acceleration at the nodes is that of the equation of motion.
    fn integrate(&self, step_s: f64) -> Nodes {
        let count = (self.swing_s / step_s).ceil() as usize + 1;
        let mut rows = Vec::with_capacity(count + 1);
        let (mut x, mut v) = (0.0, 0.0);
        let mut first = 0;
        for node in 0..=count {
            let t = node as f64 * step_s;
            while self.pushes.get(first).is_some_and(|p| p.begin_s + p.width_s < t) {
                first += 1;
            }
            let [u0, um, u1] = [0.0, 0.5, 1.0].map(|share| self.push(first, t + share * step_s));
            let law = |x: f64, v: f64, u: f64| -self.stiffness * x.sin() - self.damping * v + u;
            let a = law(x, v, u0);
            rows.push([x, v, a]);
            let h = step_s;
            let (v2, a2) = (v + h / 2.0 * a, law(x + h / 2.0 * v, v + h / 2.0 * a, um));
            let (v3, a3) = (v + h / 2.0 * a2, law(x + h / 2.0 * v2, v + h / 2.0 * a2, um));
            let (v4, a4) = (v + h * a3, law(x + h * v3, v + h * a3, u1));
            x += h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4);
            v += h / 6.0 * (a + 2.0 * a2 + 2.0 * a3 + a4);
        }
        Nodes { first_s: 0.0, step_s, rows }
    }

    /// Acceleration of the pushes from number `first` on; each ends before the next but one starts.
    fn push(&self, first: usize, t_s: f64) -> f64 {
        let near = self.pushes.iter().skip(first).take(3);
        let inside = near.filter(|p| (p.begin_s..p.begin_s + p.width_s).contains(&t_s));
        inside.map(|p| p.height * (PI * (t_s - p.begin_s) / p.width_s).sin().powi(4)).sum()
    }
}

/// From 0 at 0 to 1 at `width_s`, with four continuous derivatives; value and three derivatives.
fn ease(t_s: f64, width_s: f64) -> [f64; 4] {
    let x = t_s / width_s;
    if x >= 1.0 {
        return [1.0, 0.0, 0.0, 0.0];
    }
    if x <= 0.0 {
        return [0.0; 4];
    }
    // The derivative is 630 x⁴ (1 − x)⁴.
    let y = 1.0 - x;
    let value = x.powi(5) * (126.0 + x * (-420.0 + x * (540.0 + x * (-315.0 + 70.0 * x))));
    let first = 630.0 * (x * y).powi(4);
    let second = 2520.0 * (x * y).powi(3) * (y - x);
    let third = 2520.0 * (x * y).powi(2) * (3.0 * (y - x).powi(2) - 2.0 * x * y);
    [value, first / width_s, second / width_s.powi(2), third / width_s.powi(3)]
}

/// Of a function of −t.
fn turned([value, first, second, third]: [f64; 4]) -> [f64; 4] {
    [value, -first, second, -third]
}

/// Leibniz' rule up to the third derivative.
fn product(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    [
        a[0] * b[0],
        a[1] * b[0] + a[0] * b[1],
        a[2] * b[0] + 2.0 * a[1] * b[1] + a[0] * b[2],
        a[3] * b[0] + 3.0 * a[2] * b[1] + 3.0 * a[1] * b[2] + a[0] * b[3],
    ]
}
