//! What each flight of a group knows about its own delay, and what the other flights show.

use super::{FlightSources, PositionLateness, RelativeLateness};
use crate::pool::{FlightLateness, Group, OUTLIER_Z, Others, pool};
use crate::solve::trusted;
use record::{DelayPool, Estimate, NetworkDatum};
use signal::{median_by_selection, robust_sigma};
use std::collections::BTreeMap;

/// Least number of other flights for a mean.
const LEAST_OTHERS: usize = 2;
/// Smallest difference of position against velocity between flights that counts, s.
const LEAST_UNLIKE_S: f64 = 0.02;

/// Evidence on the delay of one flight.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Evidence {
    /// Lateness from the flight's own network, if it may be used for removal.
    pub(crate) own: Option<Estimate>,
    /// Mean of at least two other flights.
    pub(crate) others: Option<Others>,
    /// Studentised difference between the two.
    pub(crate) z: Option<f64>,
    /// Whether the group consists of several clusters and this flight's cluster is unknown.
    pub(crate) cluster_unknown: bool,
    /// How much later the position of the other flights is than the same velocity, s, if this flight differs from it
    /// and has no lateness of its own: their mean is not its delay.
    pub(crate) unlike_s: Option<f64>,
}

impl Evidence {
    /// Whether the flight differs from its group.
    pub(crate) fn differs(&self) -> bool {
        self.z.is_some_and(|z| z.abs() > OUTLIER_Z)
    }
}

/// Flights of one cluster with a pool of their own.
#[derive(Debug)]
struct Cluster {
    /// Flights that are not outliers; `None` if there are none.
    kept: Option<Group>,
    kept_flights: usize,
}

/// Flights of a group, pooled.
#[derive(Debug)]
pub(crate) struct GroupFlights {
    evidence: Vec<Evidence>,
    pools: Vec<DelayPool>,
}

impl GroupFlights {
    pub(crate) fn new(flights: &[FlightSources], datum_uncertainty_s: f64) -> GroupFlights {
        let own: Vec<Option<FlightLateness>> = flights.iter().enumerate().map(own_lateness).collect();
        let mut evidence: Vec<Evidence> =
            own.iter().map(|own| Evidence { own: own.as_ref().map(estimate), ..Evidence::default() }).collect();
        let pooled: Vec<usize> =
            (0..flights.len()).filter(|&at| own[at].is_some() && flights[at].keep_out_of_pool.is_none()).collect();
        let mut pools = Vec::new();
        let mut clusters = Vec::new();
        cluster_by_cluster(&pooled, &own, datum_uncertainty_s, &mut |members, found, is_cluster| {
            if is_cluster {
                clusters.push(pool_cluster(members, &found, &own, datum_uncertainty_s, &mut evidence));
            }
            pools.push(found);
        });
        for (at, flight) in flights.iter().enumerate() {
            if own[at].is_none() || flight.keep_out_of_pool.is_some() {
                judge_outsider(&mut evidence[at], own[at].as_ref(), &clusters, datum_uncertainty_s);
            }
        }
        let usual = usual_relative(flights, &pooled);
        for (at, flight) in flights.iter().enumerate().filter(|(at, _)| own[*at].is_none()) {
            let pair = flight.relative.as_ref().filter(|_| evidence[at].others.is_some());
            evidence[at].unlike_s = pair.and_then(|pair| usual.get(pair.velocity.as_str())?.unlike(pair));
        }
        for pool in &mut pools {
            rename(pool, flights);
        }
        GroupFlights { evidence, pools }
    }

    pub(crate) fn evidence(&self, at: usize) -> Evidence {
        self.evidence.get(at).copied().unwrap_or_default()
    }

    pub(crate) fn into_pools(self) -> Vec<DelayPool> {
        self.pools
    }
}

/// Position against one velocity in the flights of a mean.
struct UsualRelative {
    median_s: f64,
    /// Spread between the flights and the uncertainty of one of them together.
    deviation_s: f64,
}

impl UsualRelative {
    /// The usual value, if that of a flight differs from it.
    fn unlike(&self, pair: &RelativeLateness) -> Option<f64> {
        let deviation_s = self.deviation_s.hypot(pair.delay_s.standard_uncertainty?);
        let apart_s = (pair.delay_s.value - self.median_s).abs();
        (apart_s > LEAST_UNLIKE_S.max(OUTLIER_Z * deviation_s)).then_some(self.median_s)
    }
}

/// By velocity. Medians, because outliers are among the flights.
fn usual_relative<'a>(flights: &'a [FlightSources], pooled: &[usize]) -> BTreeMap<&'a str, UsualRelative> {
    let mut all: BTreeMap<&str, [Vec<f64>; 2]> = BTreeMap::new();
    for pair in pooled.iter().filter_map(|&at| flights[at].relative.as_ref()) {
        if let Estimate { value, standard_uncertainty: Some(u) } = pair.delay_s
            && value.is_finite()
            && u.is_finite()
        {
            let [values, us] = all.entry(&pair.velocity).or_default();
            values.push(value);
            us.push(u);
        }
    }
    let usual = |[values, us]: &[Vec<f64>; 2]| {
        let deviation_s = robust_sigma(values)?.hypot(median_by_selection(us)?);
        Some(UsualRelative { median_s: median_by_selection(values)?, deviation_s })
    };
    let enough = all.iter().filter(|(_, [values, _])| values.len() >= LEAST_OTHERS);
    enough.filter_map(|(velocity, both)| Some((*velocity, usual(both)?))).collect()
}

/// Own delay of a flight, if it is against the IMU (or a requested reference), decided and not weak. Identified by its
/// index because names may repeat.
fn own_lateness((at, flight): (usize, &FlightSources)) -> Option<FlightLateness> {
    let position = flight.position.as_ref()?;
    let tied = matches!(position.datum, NetworkDatum::Imu | NetworkDatum::Reference);
    let own = FlightLateness {
        flight: at.to_string(),
        lateness_s: position.lateness_s.value,
        standard_uncertainty_s: position.lateness_s.standard_uncertainty?,
        model_uncertainty_s: position.model_uncertainty_s,
    };
    (tied && trusted(position.verdict) && !position.weak && own.usable()).then_some(own)
}

fn estimate(own: &FlightLateness) -> Estimate {
    Estimate { value: own.lateness_s, standard_uncertainty: Some(own.standard_uncertainty_s) }
}

/// Pools the flights. If they are not one group, also pools each side, recursively. `each` gets the members of every
/// pool, the pool, and whether it was left whole.
fn cluster_by_cluster(
    members: &[usize],
    own: &[Option<FlightLateness>],
    datum_uncertainty_s: f64,
    each: &mut dyn FnMut(&[usize], DelayPool, bool),
) {
    let flights: Vec<FlightLateness> = members.iter().filter_map(|at| own[*at].clone()).collect();
    let Some(found) = pool(&flights, datum_uncertainty_s) else { return };
    let places = |names: &[String]| names.iter().filter_map(|name| name.parse().ok()).collect::<Vec<usize>>();
    let sides = found.split.as_ref().map(|split| [places(&split.early), places(&split.late)]);
    each(members, found, sides.is_none());
    for side in sides.iter().flatten() {
        cluster_by_cluster(side, own, datum_uncertainty_s, each);
    }
}

/// Means of the other flights, for the flights of a cluster. Outliers are in no mean.
fn pool_cluster(
    members: &[usize],
    found: &DelayPool,
    own: &[Option<FlightLateness>],
    datum_uncertainty_s: f64,
    evidence: &mut [Evidence],
) -> Cluster {
    if found.described().is_none() {
        members.iter().for_each(|&at| evidence[at].cluster_unknown = true);
        return Cluster { kept: None, kept_flights: 0 };
    }
    // if two flights differ, neither can be identified as the outlier
    let several = members.len() > LEAST_OTHERS;
    let outlier = |place: usize| several && found.members.get(place).is_some_and(|member| member.outlier);
    let kept: Vec<usize> =
        members.iter().enumerate().filter(|(place, _)| !outlier(*place)).map(|(_, at)| *at).collect();
    let flights: Vec<&FlightLateness> = kept.iter().filter_map(|at| own[*at].as_ref()).collect();
    let group = Group::new(&flights, datum_uncertainty_s);
    let enough = |others: &Others| others.flights >= LEAST_OTHERS;
    let left: BTreeMap<usize, Option<Others>> =
        group.as_ref().map(|group| kept.iter().copied().zip(group.leave_one_out()).collect()).unwrap_or_default();
    for (place, &at) in members.iter().enumerate() {
        let others = match left.get(&at) {
            Some(others) => *others,
            None => group.as_ref().map(Group::all),
        };
        evidence[at].others = others.filter(enough);
        evidence[at].z = found.members.get(place).and_then(|member| member.z).filter(|_| several);
    }
    Cluster { kept: group, kept_flights: kept.len() }
}

/// Mean for a flight that is in no mean: all flights of the only cluster.
fn judge_outsider(
    evidence: &mut Evidence,
    own: Option<&FlightLateness>,
    clusters: &[Cluster],
    datum_uncertainty_s: f64,
) {
    match clusters {
        [Cluster { kept: Some(group), kept_flights }] if *kept_flights >= LEAST_OTHERS => {
            evidence.others = Some(group.all());
            evidence.z = own.map(|own| group.z_of(own, datum_uncertainty_s));
        }
        [_, _, ..] => evidence.cluster_unknown = true,
        _ => {}
    }
}

/// Replaces the indices by the names of the flights.
fn rename(pool: &mut DelayPool, flights: &[FlightSources]) {
    let name = |place: &mut String| {
        if let Some(flight) = place.parse::<usize>().ok().and_then(|at| flights.get(at)) {
            place.clone_from(&flight.flight);
        }
    };
    pool.members.iter_mut().for_each(|member| name(&mut member.flight));
    if let Some(split) = &mut pool.split {
        split.early.iter_mut().chain(&mut split.late).for_each(name);
    }
}

/// Why a flight has no delay of its own, in words; `None` if it has one or there is no network.
pub(crate) fn why_not_own(position: &PositionLateness) -> Option<&'static str> {
    use record::NetworkVerdict::{Scattered, Undecided};
    match (position.datum, position.verdict) {
        (NetworkDatum::None, _) => Some("no sensor of this flight ties it to true time"),
        (NetworkDatum::Refused, _) => Some("its IMU is itself late"),
        (_, Undecided) => Some("its pairs of channels do not agree, and which one is wrong is unknown"),
        (_, Scattered) => Some("its pairs of channels do not agree"),
        _ if position.weak => Some("its only link to true time is a filter that is computed from it"),
        _ => None,
    }
}
