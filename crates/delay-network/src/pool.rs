//! One delay from the flights of a group (section 5).

mod random_effects;
mod split;

use self::random_effects::{Mean, Sample};
use self::split::Cut;
use crate::isolate::K95;
use record::{DelayPool, Estimate, FlightsDiffer, GroupSplit, PoolMean, PoolMember};

/// |z| above which a flight is an outlier of its group.
pub(crate) const OUTLIER_Z: f64 = 3.0;
/// Least uncertainty of a flight in addition to what it shares with the group, s.
const LEAST_OWN_S: f64 = 0.2e-3;
const LEAST_ALONE_S: f64 = 1e-9;
/// Probability below which a group is split, and below which its flights are considered different.
const SPLIT_P: f64 = 0.01;
/// Least distance of the means of two clusters, in standard deviations of a cluster.
const SPLIT_SEPARATION: f64 = 4.5;

/// Lateness of one flight as input to the pool.
#[derive(Debug, Clone, PartialEq)]
pub struct FlightLateness {
    /// Name of the flight. Pass duplicates of a flight only once.
    pub flight: String,
    /// Lateness, s.
    pub lateness_s: f64,
    /// Standard uncertainty U, s.
    pub standard_uncertainty_s: f64,
    /// Model part of U, s.
    pub model_uncertainty_s: f64,
}

impl FlightLateness {
    /// Whether the figures can be pooled.
    pub(crate) fn usable(&self) -> bool {
        self.lateness_s.is_finite()
            && self.standard_uncertainty_s.is_finite()
            && self.standard_uncertainty_s > 0.0
            && self.model_uncertainty_s >= 0.0
    }
}

/// Mean lateness of a group; `None` without a flight that has finite figures.
///
/// The smallest model part among the flights is common to all and does not average out. The rest is pooled by random
/// effects: τ by REML, interval by Hartung and Knapp with a factor of at least 1, common part added. Whether flights
/// differ is tested with their full uncertainties less `datum_uncertainty_s` (0.005), because model errors differ from
/// flight to flight but the datum does not.
///
/// Each flight is compared with the pool of the others (externally studentised). Up to 30 flights, each such pool has
/// its own τ. With more, all share the τ of the group and the leave-one-out sums have a closed form: 20 000 flights
/// take a fraction of a second.
///
/// The group is split in two when a single normal group is unlikely to look so divided. The cut is the one with the
/// least weighted variance within. Its t test between both sides has k − 2 degrees of freedom. Its p, multiplied by the
/// 2^(k−1) − 1 ways to cut the group (Bonferroni), must be below 0.01. The means must also be 4.5 standard deviations
/// of a cluster apart (the halves of a uniform spread are 3.5 apart), and the flights must differ by more than their
/// uncertainties (p of Q below 0.01).
#[must_use]
pub fn pool(flights: &[FlightLateness], datum_uncertainty_s: f64) -> Option<DelayPool> {
    let flights: Vec<&FlightLateness> = flights.iter().filter(|flight| flight.usable()).collect();
    let group = Group::new(&flights, datum_uncertainty_s)?;
    let mean = group.own.mean();
    let half = group.half_width_s(&mean);
    let difference = group.difference();
    let interval = |half: f64| [mean.mean - half, mean.mean + half];
    let members = members(&flights, &group);
    Some(DelayPool {
        flights: u32::try_from(flights.len()).unwrap_or(u32::MAX),
        mean_s: group.estimate(&mean),
        interval_95_s: interval(half),
        half_width_95_s: half,
        tau_s: mean.tau,
        common_s: group.common_s,
        difference,
        without_outliers: without_outliers(&flights, &members, datum_uncertainty_s),
        members,
        split: difference.filter(|d| d.p < SPLIT_P).and_then(|_| split(&flights, &group, datum_uncertainty_s)),
    })
}

/// Mean of the flights that are not outliers, if there are outliers and they are the minority.
fn without_outliers(flights: &[&FlightLateness], members: &[PoolMember], datum_uncertainty_s: f64) -> Option<PoolMean> {
    let kept: Vec<&FlightLateness> =
        flights.iter().zip(members).filter(|(_, member)| !member.outlier).map(|(flight, _)| *flight).collect();
    let outliers = flights.len() - kept.len();
    if outliers == 0 || kept.len() <= outliers {
        return None;
    }
    let group = Group::new(&kept, datum_uncertainty_s)?;
    let mean = group.own.mean();
    Some(PoolMean {
        flights: u32::try_from(kept.len()).unwrap_or(u32::MAX),
        mean_s: group.estimate(&mean),
        half_width_95_s: group.half_width_s(&mean),
        tau_s: mean.tau,
    })
}

/// Group as two samples: own uncertainties for the mean, full ones less the datum's for tests.
#[derive(Debug)]
pub(crate) struct Group {
    own: Sample,
    full: Sample,
    common_s: f64,
}

/// Mean of some flights, and how far the delay of a further flight may differ from it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Others {
    /// Flights in the mean.
    pub(crate) flights: usize,
    /// Mean, s.
    pub(crate) mean_s: f64,
    /// Standard uncertainty of one flight's delay around that mean, s: uncertainty of the mean, and τ.
    pub(crate) uncertainty_s: f64,
}

impl Group {
    /// `None` without a flight.
    pub(crate) fn new(flights: &[&FlightLateness], datum_uncertainty_s: f64) -> Option<Group> {
        let common_s = flights.iter().map(|flight| flight.model_uncertainty_s).min_by(f64::total_cmp)?;
        // A flight alone keeps its own uncertainty.
        let least_s = if flights.len() == 1 { LEAST_ALONE_S } else { LEAST_OWN_S };
        let without = |shared_s: f64| {
            Sample::new(flights.iter().map(|flight| {
                let variance = flight.standard_uncertainty_s.powi(2) - shared_s.powi(2);
                (flight.lateness_s, variance.max(least_s.powi(2)))
            }))
        };
        Some(Group { own: without(common_s), full: without(datum_uncertainty_s.min(common_s)), common_s })
    }

    fn estimate(&self, mean: &Mean) -> Estimate {
        Estimate { value: mean.mean, standard_uncertainty: Some(mean.se.hypot(self.common_s)) }
    }

    fn half_width_s(&self, mean: &Mean) -> f64 {
        mean.half().hypot(K95 * self.common_s)
    }

    fn difference(&self) -> Option<FlightsDiffer> {
        let k = self.full.len();
        let (q, tau_s) = (self.full.cochran_q(), self.full.mean().tau?);
        let degrees_of_freedom = k.saturating_sub(1);
        let dof = degrees_of_freedom as f64;
        Some(FlightsDiffer {
            q,
            degrees_of_freedom: u32::try_from(degrees_of_freedom).unwrap_or(u32::MAX),
            p: signal::chi_squared_tail(q, dof),
            i2: if q > 0.0 { ((q - dof) / q).max(0.0) } else { 0.0 },
            tau_s,
        })
    }

    /// Mean of all, for a flight outside the group.
    pub(crate) fn all(&self) -> Others {
        self.others(self.own.len(), &self.own.mean())
    }

    /// Mean of the others of each flight; `None` for a single flight.
    pub(crate) fn leave_one_out(&self) -> Vec<Option<Others>> {
        let flights = self.own.len().saturating_sub(1);
        self.own.leave_one_out().iter().map(|mean| mean.as_ref().map(|mean| self.others(flights, mean))).collect()
    }

    fn others(&self, flights: usize, mean: &Mean) -> Others {
        let uncertainty_s = mean.se.hypot(self.common_s).hypot(mean.tau.unwrap_or(0.0));
        Others { flights, mean_s: mean.mean, uncertainty_s }
    }

    /// Studentised difference of a flight outside this group.
    pub(crate) fn z_of(&self, flight: &FlightLateness, datum_uncertainty_s: f64) -> f64 {
        let shared_s = datum_uncertainty_s.min(self.common_s);
        let variance = (flight.standard_uncertainty_s.powi(2) - shared_s.powi(2)).max(LEAST_OWN_S.powi(2));
        studentised(flight.lateness_s, variance, &self.full.mean())
    }
}

fn studentised(value: f64, variance: f64, others: &Mean) -> f64 {
    (value - others.mean) / (variance + others.tau.unwrap_or(0.0).powi(2) + others.se.powi(2)).sqrt()
}

/// Compares every flight with the pool of the others.
fn members(flights: &[&FlightLateness], group: &Group) -> Vec<PoolMember> {
    let (own, full) = (group.own.leave_one_out(), group.full.leave_one_out());
    flights
        .iter()
        .zip(own.iter().zip(&full))
        .zip(group.full.items())
        .map(|((flight, (own, full)), (value, variance))| {
            let z = full.as_ref().map(|others| studentised(value, variance, others));
            PoolMember {
                flight: flight.flight.clone(),
                others_s: own.as_ref().map(|mean| group.estimate(mean)),
                others_half_width_95_s: own.as_ref().map(|mean| group.half_width_s(mean)),
                z,
                outlier: z.is_some_and(|z| z.abs() > OUTLIER_Z),
            }
        })
        .collect()
}

/// Two clusters, if a single group is too unlikely.
fn split(flights: &[&FlightLateness], group: &Group, datum_uncertainty_s: f64) -> Option<GroupSplit> {
    let items: Vec<(f64, f64)> = group.full.items().collect();
    let Cut { early, late, gap, p, .. } =
        split::best_cut(&items).filter(|cut| cut.p < SPLIT_P && cut.separation > SPLIT_SEPARATION)?;
    let side = |indices: &[usize]| {
        let side: Vec<&FlightLateness> = indices.iter().filter_map(|at| flights.get(*at).copied()).collect();
        let group = Group::new(&side, datum_uncertainty_s)?;
        let names = side.iter().map(|flight| flight.flight.clone()).collect::<Vec<_>>();
        Some((group.estimate(&group.own.mean()), names))
    };
    let ((early_s, early), (late_s, late)) = (side(&early)?, side(&late)?);
    let words = format!(
        "This group has two different delays: {} flights are about {:.0} ms late and {} flights about {:.0} ms. Look \
         for two receivers, two settings or two kinds of log.",
        early.len(),
        1e3 * early_s.value,
        late.len(),
        1e3 * late_s.value
    );
    Some(GroupSplit { early, late, early_s, late_s, gap_s: gap, p, words })
}
