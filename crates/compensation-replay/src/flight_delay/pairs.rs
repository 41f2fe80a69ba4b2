//! Which channels of a flight can be compared, and what their delay means.

use super::FlightDelaySettings;
use flight::{Flight, Quantity};
use record::DelayPairKind;

/// How the second channel becomes a reference.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Second {
    /// ∫ velocity.
    Velocity(String),
    /// ∫ of the specific force turned by the attitude.
    Acceleration { attitude: String, specific_force: String },
    /// A track.
    Position(String),
    /// A velocity, as it is.
    Rate(String),
}

/// One comparison.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Pair {
    pub(crate) kind: DelayPairKind,
    /// Channel that is measured.
    pub(crate) first: String,
    pub(crate) second: Second,
    /// The fit runs the other way round: the second channel of the finding is `first` here and δ changes sign.
    pub(crate) reversed: bool,
}

impl Pair {
    /// Names as the finding has them.
    pub(crate) fn names(&self) -> (String, String) {
        let second = match &self.second {
            Second::Velocity(name) | Second::Position(name) | Second::Rate(name) => name.clone(),
            Second::Acceleration { attitude, specific_force } => format!("{attitude} + {specific_force}"),
        };
        if self.reversed { (second, self.first.clone()) } else { (self.first.clone(), second) }
    }

    /// What δ means and what it hides.
    pub(crate) fn meaning(&self) -> String {
        let (first, second) = self.names();
        match self.kind {
            DelayPairKind::PositionAgainstVelocity => format!(
                "δ = Tp − Tv: how much later {first} is than {second}. A delay that both share \
                 cannot be seen, so this is not how late either is"
            ),
            DelayPairKind::VelocityAgainstAcceleration => format!(
                "δ = Tv − Ta: how much later {first} is than the acceleration from {second}. A delay that both share \
                 cannot be seen"
            ),
            DelayPairKind::PositionAgainstReference => format!(
                "δ = Tp: how late {first} is against {second}, which is taken to be on time; its own delay would count \
                 against it"
            ),
            DelayPairKind::VelocityAgainstReference => format!(
                "δ = Tv: how late {first} is against {second}, which is taken to be on time; its own delay would count \
                 against it"
            ),
            DelayPairKind::BetweenReceivers => {
                format!("δ = T₁ − T₂: how much later {first} is than {second}. A delay that both share cannot be seen")
            }
        }
    }
}

/// Channel names of the kinds that take part.
struct Channels<'a> {
    settings: &'a FlightDelaySettings,
    positions: Vec<&'a str>,
    velocities: Vec<&'a str>,
    accelerations: Vec<(&'a str, &'a str)>,
}

/// All comparisons that the channels of the flight allow, in the order of the finding.
pub(crate) fn pairs_of(flight: &Flight, settings: &FlightDelaySettings) -> Vec<Pair> {
    let of = |wanted: &[Quantity]| -> Vec<&str> {
        flight.channels.iter().filter(|(_, c)| wanted.contains(&c.quantity)).map(|(name, _)| name.as_str()).collect()
    };
    let attitudes = of(&[Quantity::Attitude]);
    let accelerations = of(&[Quantity::SpecificForce])
        .into_iter()
        .flat_map(|force| {
            // Attitudes of the same device before any other; which one serves best is seen from the delays.
            let mut usable: Vec<&str> = attitudes.iter().copied().filter(|a| same_clock(flight, a, force)).collect();
            usable.sort_by_key(|a| source(a) != source(force));
            usable.into_iter().take(MOST_ATTITUDES).map(move |attitude| (attitude, force))
        })
        .collect();
    let channels = Channels {
        settings,
        positions: of(&[Quantity::PositionGeodetic, Quantity::PositionNed]),
        velocities: of(&[Quantity::VelocityNed]),
        accelerations,
    };
    let mut pairs = channels.all();
    pairs.sort_by_key(|p| (p.kind, p.names()));
    pairs
}

/// Attitudes that are tried with one specific force.
const MOST_ATTITUDES: usize = 4;

fn same_clock(flight: &Flight, a: &str, b: &str) -> bool {
    let clock = |name: &str| flight.channels.get(name).map(|c| c.series.timeline().clock());
    clock(a) == clock(b)
}

impl Channels<'_> {
    fn all(&self) -> Vec<Pair> {
        let (reference_positions, positions): (Vec<&str>, Vec<&str>) =
            self.positions.iter().partition(|name| self.is_reference(name));
        let (reference_velocities, velocities): (Vec<&str>, Vec<&str>) =
            self.velocities.iter().partition(|name| self.is_reference(name));
        // A reference position says all that its velocity says.
        let alone: Vec<&str> = reference_velocities
            .iter()
            .copied()
            .filter(|v| reference_positions.iter().all(|p| source(p) != source(v)))
            .collect();
        let mut out = vec![];
        let mut add = |kind, first: &str, second, reversed| {
            out.push(Pair { kind, first: first.to_owned(), second, reversed });
        };
        let owned = |name: &str| name.to_owned();
        for p in &positions {
            for v in &velocities {
                add(DelayPairKind::PositionAgainstVelocity, p, Second::Velocity(owned(v)), false);
            }
            for r in &reference_positions {
                add(DelayPairKind::PositionAgainstReference, p, Second::Position(owned(r)), false);
            }
            for r in &alone {
                add(DelayPairKind::PositionAgainstReference, p, Second::Velocity(owned(r)), false);
            }
        }
        for v in &velocities {
            // A filter's velocity is made from this IMU and says little of it: one attitude is enough.
            let mut forces: Vec<&str> = vec![];
            for (attitude, force) in &self.accelerations {
                if !is_receiver(v) && forces.contains(force) {
                    continue;
                }
                forces.push(force);
                let second = Second::Acceleration { attitude: owned(attitude), specific_force: owned(force) };
                add(DelayPairKind::VelocityAgainstAcceleration, v, second, false);
            }
            for r in &reference_positions {
                add(DelayPairKind::VelocityAgainstReference, r, Second::Velocity(owned(v)), true);
            }
            for r in &alone {
                add(DelayPairKind::VelocityAgainstReference, v, Second::Rate(owned(r)), false);
            }
        }
        for r in &reference_positions {
            for v in reference_velocities.iter().filter(|v| source(v) == source(r)) {
                add(DelayPairKind::PositionAgainstVelocity, r, Second::Velocity(owned(v)), false);
            }
        }
        for (k, a) in positions.iter().enumerate() {
            for b in positions[k + 1..].iter().filter(|b| is_receiver(a) && is_receiver(b)) {
                add(DelayPairKind::BetweenReceivers, b, Second::Position(owned(a)), false);
            }
        }
        out
    }

    fn is_reference(&self, name: &str) -> bool {
        self.settings.references.iter().any(|r| r == source(name))
    }
}

/// What is behind the first dot of a channel's name.
fn source(name: &str) -> &str {
    name.split_once('.').map_or(name, |(_, source)| source)
}

fn is_receiver(name: &str) -> bool {
    ["gps", "gnss", "receiver"].iter().any(|r| source(name).starts_with(r))
}
