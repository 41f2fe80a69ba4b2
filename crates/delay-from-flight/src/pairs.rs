//! Pairs of comparable channels of a flight, and the meaning of their delay.

use super::{FlightDelaySettings, attitude};
use flight::{Flight, Notices, Quantity};
use rayon::prelude::*;
use record::DelayPairKind;

/// How the second channel serves as a reference.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Second {
    /// Integrated velocity.
    Velocity(String),
    /// Integral of the specific force rotated by the attitude.
    Acceleration(Rotated),
    /// A track, interpolated.
    Position(String),
    /// A velocity, as it is.
    Rate(String),
}

/// A specific force and what rotates it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Rotated {
    pub(crate) attitude: String,
    pub(crate) specific_force: String,
    /// How much later the attitude is than the gyro of the device, s; `None` if this is unknown.
    pub(crate) attitude_late_s: Option<f64>,
}

impl Second {
    /// Name as in the finding.
    pub(crate) fn name(&self) -> String {
        match self {
            Second::Velocity(name) | Second::Position(name) | Second::Rate(name) => name.clone(),
            Second::Acceleration(of) => format!("{} + {}", of.attitude, of.specific_force),
        }
    }

    /// The channels. The samples of the first one are used.
    pub(crate) fn channels(&self) -> Vec<&str> {
        match self {
            Second::Velocity(name) | Second::Position(name) | Second::Rate(name) => vec![name],
            Second::Acceleration(of) => vec![&of.specific_force, &of.attitude],
        }
    }
}

/// One comparison.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Pair {
    pub(crate) kind: DelayPairKind,
    /// The measured channel.
    pub(crate) first: String,
    pub(crate) second: Second,
    /// The fit is reversed: the second channel of the finding is `first` here and δ changes sign.
    pub(crate) reversed: bool,
}

impl Pair {
    /// Names as in the finding.
    pub(crate) fn names(&self) -> (String, String) {
        let second = self.second.name();
        if self.reversed { (second, self.first.clone()) } else { (self.first.clone(), second) }
    }

    /// Meaning of δ and what it cannot show.
    pub(crate) fn meaning(&self) -> String {
        let (first, second) = self.names();
        match self.kind {
            DelayPairKind::PositionAgainstVelocity => format!(
                "δ = Tp − Tv: how much later {first} is than {second}. A delay that both share cannot be seen, so this \
                 is not the lateness of either"
            ),
            DelayPairKind::VelocityAgainstAcceleration => format!(
                "δ = Tv − Ta: how much later {first} is than the acceleration from {second}. A delay that both share \
                 cannot be seen"
            ),
            DelayPairKind::PositionAgainstReference => format!(
                "δ = Tp: how late {first} is against {second}, which is assumed to be on time; any delay of its own \
                 would be subtracted"
            ),
            DelayPairKind::VelocityAgainstReference => format!(
                "δ = Tv: how late {first} is against {second}, which is assumed to be on time; any delay of its own \
                 would be subtracted"
            ),
            DelayPairKind::BetweenReceivers => {
                format!("δ = T₁ − T₂: how much later {first} is than {second}. A delay that both share cannot be seen")
            }
        }
    }
}

/// Channel names by kind.
struct Channels<'a> {
    positions: Vec<&'a str>,
    reference_positions: Vec<&'a str>,
    velocities: Vec<&'a str>,
    reference_velocities: Vec<&'a str>,
    accelerations: Vec<Rotated>,
}

/// All comparisons that the channels of the flight allow, in the order of the findings.
pub(crate) fn pairs_of(flight: &Flight, settings: &FlightDelaySettings, notices: &mut Notices) -> Vec<Pair> {
    let channels = Channels::of(flight, settings, notices);
    let mut pairs = [
        channels.pairs_of_positions(),
        channels.pairs_of_velocities(),
        channels.pairs_of_references(),
        channels.pairs_of_receivers(),
    ]
    .concat();
    pairs.sort_by_key(|p| (p.kind, p.names()));
    pairs
}

fn names_of<'a>(flight: &'a Flight, wanted: &[Quantity]) -> Vec<&'a str> {
    flight.channels.iter().filter(|(_, c)| wanted.contains(&c.quantity)).map(|(name, _)| name.as_str()).collect()
}

/// Maximum number of attitudes tried with one specific force.
const MOST_ATTITUDES: usize = 4;

fn accelerations(flight: &Flight, notices: &mut Notices) -> Vec<Rotated> {
    let attitudes = names_of(flight, &[Quantity::Attitude]);
    let rotated: Vec<(&str, &str)> = names_of(flight, &[Quantity::SpecificForce])
        .into_iter()
        .flat_map(|force| {
            // Attitudes of the same device come first; the delays show which one serves best.
            let mut usable: Vec<&str> = attitudes.iter().copied().filter(|a| same_clock(flight, a, force)).collect();
            usable.sort_by_key(|a| source(a) != source(force));
            usable.into_iter().take(MOST_ATTITUDES).map(move |attitude| (attitude, force))
        })
        .collect();
    let with_lateness = |(attitude, force): &(&str, &str)| {
        let mut own = Notices::new();
        let attitude_late_s = attitude::lateness_s(flight, attitude, force, &mut own);
        (Rotated { attitude: (*attitude).to_owned(), specific_force: (*force).to_owned(), attitude_late_s }, own)
    };
    let found: Vec<(Rotated, Notices)> = rotated.par_iter().map(with_lateness).collect();
    let (rotated, own): (Vec<_>, Vec<_>) = found.into_iter().unzip();
    own.into_iter().for_each(|own| notices.extend_unsaid(own));
    rotated
}

fn same_clock(flight: &Flight, a: &str, b: &str) -> bool {
    let clock = |name: &str| flight.channels.get(name).map(|c| c.series.timeline().clock());
    clock(a) == clock(b)
}

fn pair(kind: DelayPairKind, first: &str, second: Second) -> Pair {
    Pair { kind, first: first.to_owned(), second, reversed: false }
}

impl<'a> Channels<'a> {
    fn of(flight: &'a Flight, settings: &FlightDelaySettings, notices: &mut Notices) -> Channels<'a> {
        let is_reference = |name: &&str| settings.references.iter().any(|r| r == source(name));
        let positions = names_of(flight, &[Quantity::PositionGeodetic, Quantity::PositionNed]);
        let (reference_positions, positions) = positions.into_iter().partition(is_reference);
        let velocities = names_of(flight, &[Quantity::VelocityNed]);
        let (reference_velocities, velocities): (_, Vec<&str>) = velocities.into_iter().partition(is_reference);
        let accelerations = if velocities.is_empty() { vec![] } else { accelerations(flight, notices) };
        Channels { positions, reference_positions, velocities, reference_velocities, accelerations }
    }

    /// Reference velocities without a reference position, which would make them redundant.
    fn lone_reference_velocities(&self) -> impl Iterator<Item = &&'a str> {
        let has_position = |v: &str| self.reference_positions.iter().any(|p| source(p) == source(v));
        self.reference_velocities.iter().filter(move |v| !has_position(v))
    }

    fn pairs_of_positions(&self) -> Vec<Pair> {
        use DelayPairKind::{PositionAgainstReference, PositionAgainstVelocity};
        let mut out = vec![];
        for p in &self.positions {
            let velocity = |kind, v: &str| pair(kind, p, Second::Velocity(v.to_owned()));
            let position = |r: &&str| pair(PositionAgainstReference, p, Second::Position((*r).to_owned()));
            out.extend(self.velocities.iter().map(|v| velocity(PositionAgainstVelocity, v)));
            out.extend(self.reference_positions.iter().map(position));
            out.extend(self.lone_reference_velocities().map(|r| velocity(PositionAgainstReference, r)));
        }
        out
    }

    fn pairs_of_velocities(&self) -> Vec<Pair> {
        use DelayPairKind::VelocityAgainstReference;
        let mut out = vec![];
        for v in &self.velocities {
            out.extend(self.pairs_with_accelerations(v));
            let reversed = |r: &&str| Pair {
                reversed: true,
                ..pair(VelocityAgainstReference, r, Second::Velocity((*v).to_owned()))
            };
            out.extend(self.reference_positions.iter().map(reversed));
            let rate = |r: &&str| pair(VelocityAgainstReference, v, Second::Rate((*r).to_owned()));
            out.extend(self.lone_reference_velocities().map(rate));
        }
        out
    }

    fn pairs_with_accelerations(&self, velocity: &str) -> Vec<Pair> {
        // A filter's velocity is made from this IMU and carries little information on it: one attitude is enough.
        let mut forces: Vec<&str> = vec![];
        let mut out = vec![];
        for of in &self.accelerations {
            if !is_receiver(velocity) && forces.contains(&of.specific_force.as_str()) {
                continue;
            }
            forces.push(&of.specific_force);
            out.push(pair(DelayPairKind::VelocityAgainstAcceleration, velocity, Second::Acceleration(of.clone())));
        }
        out
    }

    /// The position of a reference against its own velocity.
    fn pairs_of_references(&self) -> Vec<Pair> {
        let mut out = vec![];
        for r in &self.reference_positions {
            for v in self.reference_velocities.iter().filter(|v| source(v) == source(r)) {
                out.push(pair(DelayPairKind::PositionAgainstVelocity, r, Second::Velocity((*v).to_owned())));
            }
        }
        out
    }

    fn pairs_of_receivers(&self) -> Vec<Pair> {
        let receivers: Vec<&str> = self.positions.iter().copied().filter(|p| is_receiver(p)).collect();
        let mut out = vec![];
        for (k, a) in receivers.iter().enumerate() {
            for b in &receivers[k + 1..] {
                out.push(pair(DelayPairKind::BetweenReceivers, b, Second::Position((*a).to_owned())));
            }
        }
        out
    }
}

/// The part of a channel's name after the first dot.
fn source(name: &str) -> &str {
    name.split_once('.').map_or(name, |(_, source)| source)
}

fn is_receiver(name: &str) -> bool {
    ["gps", "gnss", "receiver"].iter().any(|r| source(name).starts_with(r))
}
