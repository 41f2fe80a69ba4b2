//! One attitude source for each velocity: accelerations of one vehicle are one witness.

use crate::graph::Usable;
use crate::lineage::Role;
use record::UnusedPair;
use std::collections::{BTreeMap, BTreeSet};

/// How good an acceleration is for the velocities that still need one: more measured velocities, more velocities, less
/// variance, in this order.
#[derive(Debug, Default)]
struct Merit {
    measured: usize,
    velocities: BTreeSet<String>,
    variance_s2: f64,
}

/// Splits pairs into those kept and those whose velocity has an acceleration already. The best acceleration serves
/// all velocities that were compared with it, the next best what is left, and so on.
///
/// All share one model error, so the others add no information, but they close loops: an attitude that is wrong
/// by 1 ms for one velocity alone, at u = 1 ms, made 44 % of simulated networks `scattered`.
pub(crate) fn one_per_velocity(pairs: Vec<Usable>, role: &dyn Fn(&str) -> Role) -> (Vec<Usable>, Vec<UnusedPair>) {
    let is_acceleration = |pair: &Usable| role(&pair.second) == Role::Acceleration;
    let mut served: BTreeMap<String, String> = BTreeMap::new();
    while let Some((best, merit)) = best_left(pairs.iter().filter(|pair| is_acceleration(pair)), &served, role) {
        served.extend(merit.velocities.into_iter().map(|velocity| (velocity, best.clone())));
    }
    let (mut kept, mut unused) = (Vec::new(), Vec::new());
    for pair in pairs {
        match served.get(&pair.first) {
            Some(best) if is_acceleration(&pair) && *best != pair.second => {
                let why = format!("{best} says the same from another attitude, and one IMU is one witness");
                unused.push(UnusedPair { first: pair.first, second: pair.second, why });
            }
            _ => kept.push(pair),
        }
    }
    (kept, unused)
}

/// Best acceleration for the velocities without one.
fn best_left<'a>(
    pairs: impl Iterator<Item = &'a Usable>,
    served: &BTreeMap<String, String>,
    role: &dyn Fn(&str) -> Role,
) -> Option<(String, Merit)> {
    let mut merits: BTreeMap<&str, Merit> = BTreeMap::new();
    for pair in pairs.filter(|pair| !served.contains_key(&pair.first)) {
        let merit = merits.entry(&pair.second).or_default();
        if merit.velocities.insert(pair.first.clone()) {
            merit.measured += usize::from(role(&pair.first) == Role::Measured);
        }
        merit.variance_s2 += pair.uncertainty_s.powi(2);
    }
    merits
        .into_iter()
        .max_by(|(name_a, a), (name_b, b)| {
            (a.measured, a.velocities.len())
                .cmp(&(b.measured, b.velocities.len()))
                .then(b.variance_s2.total_cmp(&a.variance_s2))
                .then(name_b.cmp(name_a))
        })
        .map(|(name, merit)| (name.to_owned(), merit))
}
