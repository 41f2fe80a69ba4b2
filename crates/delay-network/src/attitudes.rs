//! One attitude source per velocity: all accelerations of one vehicle are one witness.

use crate::lineage::Role;
use crate::observation::Usable;
use record::UnusedPair;
use std::collections::{BTreeMap, BTreeSet};

/// Rank of an acceleration for the velocities that still need one: more measured velocities, then more velocities, then
/// less variance.
#[derive(Debug, Default)]
struct Merit {
    measured: usize,
    velocities: BTreeSet<String>,
    variance_s2: f64,
}

/// Splits pairs into those kept and those whose velocity already has an acceleration. The best acceleration serves all
/// velocities that were compared with it, the next best serves the remaining ones, and so on.
///
/// All share one model error, so the other pairs add no information but close loops. An attitude that was wrong by 1 ms
/// for only one velocity, at u = 1 ms, made 44 % of simulated networks `scattered`.
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
                let why = format!("{best} uses the same IMU with another attitude, so it adds no information");
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

#[cfg(test)]
mod tests {
    use super::*;
    use record::{DelayPairKind, Estimate};

    /// The acceleration that each velocity keeps; pairs of velocity, acceleration and uncertainty, ms.
    fn kept(pairs: &[(&str, &str, f64)]) -> Vec<(String, String)> {
        let role = |name: &str| match name {
            _ if name.starts_with("acc") => Role::Acceleration,
            _ if name.contains("ekf") => Role::Derived,
            _ => Role::Measured,
        };
        let usable = |(first, second, ms): &(&str, &str, f64)| Usable {
            kind: DelayPairKind::VelocityAgainstAcceleration,
            first: (*first).to_owned(),
            second: (*second).to_owned(),
            delay: Estimate { value: 0.1, standard_uncertainty: Some(1e-3 * ms) },
            uncertainty_s: 1e-3 * ms,
            widened_s: 0.0,
            few_windows_s: 0.0,
        };
        let (kept, unused) = one_per_velocity(pairs.iter().map(usable).collect(), &role);
        assert_eq!(kept.len() + unused.len(), pairs.len());
        kept.into_iter().map(|pair| (pair.first, pair.second)).collect()
    }

    /// Two measured velocities beat one plus three filters, more filters beat fewer, variance decides last.
    #[test]
    fn measured_velocities_rank_first_then_all_velocities_then_variance() {
        let all = |acceleration: &'static str, velocities: &[&'static str], ms: f64| -> Vec<(&str, &str, f64)> {
            velocities.iter().map(|v| (*v, acceleration, ms)).collect()
        };
        let winner = |a: Vec<(&str, &str, f64)>, b: Vec<(&str, &str, f64)>| {
            let of_gps = kept(&[a, b].concat()).into_iter().filter(|pair| pair.0 == "velocity.gps");
            of_gps.map(|pair| pair.1).collect::<Vec<_>>().join(", ")
        };
        let (filters, measured) =
            (["velocity.gps", "velocity.ekf", "velocity.ekf-2", "velocity.ekf-3"], ["velocity.gps", "velocity.vo"]);
        assert_eq!(winner(all("acc[a]", &filters, 1.0), all("acc[b]", &measured, 5.0)), "acc[b]");
        assert_eq!(winner(all("acc[a]", &filters[..2], 1.0), all("acc[b]", &filters, 5.0)), "acc[b]");
        assert_eq!(winner(all("acc[a]", &filters, 2.0), all("acc[b]", &filters, 1.0)), "acc[b]");
        assert_eq!(winner(all("acc[a]", &filters, 1.0), all("acc[b]", &filters, 2.0)), "acc[a]");
        assert_eq!(winner(all("acc[b]", &filters, 1.0), all("acc[a]", &filters, 1.0)), "acc[a]", "then the first name");
    }

    #[test]
    fn a_velocity_not_served_by_the_best_acceleration_keeps_another() {
        let pairs =
            [("velocity.gps", "acc[a]", 1.0), ("velocity.vo", "acc[a]", 1.0), ("velocity.radar", "acc[b]", 1.0)];
        let others = [("velocity.gps", "acc[b]", 5.0)];
        let found = kept(&[pairs.as_slice(), &others].concat());
        let expected = pairs.map(|(velocity, acceleration, _)| (velocity.to_owned(), acceleration.to_owned()));
        assert_eq!(found, expected);
    }
}
