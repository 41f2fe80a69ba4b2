//! Decides the delay to remove from each flight, over all flights of its group, and summarises the groups.
//!
//! The decision table is that of the delay network ([`delay_network::decide`]). Values in the key of a result are
//! rounded, and independent of the number of flights: one more flight must not redo ten thousand.

use crate::config::Pipeline;
use crate::delay::in_ms;
use crate::manifest::Planned;
use delay_network::{FlightSources, GroupDecision, NetworkSettings, PositionLateness, RelativeLateness};
use flight::Code;
use record::{
    Decision, DelayAdvice, DelayPool, DelaySource, Estimate, Finding, FlightContent, FlightLateness, FlightRow,
    GroupLateness, NetworkDatum, PoolMean, PoolMember, RemovedDelay,
};
use std::collections::BTreeMap;

/// The decision for each flight; `None` for a flight without a measurement.
pub(crate) fn decide(
    flights: &[Planned],
    lateness: &[Option<FlightLateness>],
    pipeline: &Pipeline,
) -> Vec<Option<Decision>> {
    let measured: Vec<(&str, &FlightLateness)> =
        flights.iter().zip(lateness).filter_map(|(f, l)| Some((f.flight.as_str(), l.as_ref()?))).collect();
    let decided = over(&measured, pipeline);
    let mut by_name: BTreeMap<&str, Decision> = decided.decisions;
    flights.iter().map(|flight| by_name.remove(flight.flight.as_str())).collect()
}

/// Decisions and groups of flights, and duplicates.
#[derive(Debug, Default)]
pub(crate) struct Decided<'a> {
    pub(crate) decisions: BTreeMap<&'a str, Decision>,
    pub(crate) groups: Vec<GroupLateness>,
    /// The flight that replaces each duplicate.
    pub(crate) duplicate_of: BTreeMap<&'a str, &'a str>,
}

/// Decides over measured flights, by name.
pub(crate) fn over<'a>(measured: &[(&'a str, &'a FlightLateness)], pipeline: &Pipeline) -> Decided<'a> {
    let mut out = Decided { duplicate_of: duplicates(measured), ..Decided::default() };
    let mut groups: BTreeMap<(&str, &str), Vec<(&'a str, &'a FlightLateness)>> = BTreeMap::new();
    for (flight, lateness) in measured.iter().filter(|(flight, _)| !out.duplicate_of.contains_key(flight)) {
        let position = lateness.position.as_deref().unwrap_or_default();
        groups.entry((&lateness.group.key, position)).or_default().push((flight, lateness));
    }
    for members in groups.into_values() {
        decide_group(&members, pipeline, &mut out);
    }
    let copies: Vec<(&str, Decision)> =
        out.duplicate_of.iter().filter_map(|(copy, of)| Some((*copy, out.decisions.get(of)?.clone()))).collect();
    out.decisions.extend(copies);
    out.groups.sort_by(|a, b| b.flights.cmp(&a.flights).then_with(|| a.group.key.cmp(&b.group.key)));
    out
}

/// Flights with the same samples under another name or in another container, whole or in part: the one with the most
/// fixes counts, and of several one with a lateness in true time.
fn duplicates<'a>(measured: &[(&'a str, &FlightLateness)]) -> BTreeMap<&'a str, &'a str> {
    let is_relative = |l: &FlightLateness| l.lateness.as_ref().is_none_or(|found| found.relative_to.is_some());
    let mut best_first: Vec<&(&str, &FlightLateness)> = measured.iter().collect();
    best_first.sort_by_key(|(flight, lateness)| (is_relative(lateness), *flight));
    let prints: Vec<(&str, Option<FlightContent>)> =
        best_first.into_iter().map(|(f, l)| (*f, l.content.clone())).collect();
    let names: BTreeMap<&str, &'a str> = measured.iter().map(|(flight, _)| (*flight, *flight)).collect();
    let known = |name: &str| names.get(name).copied();
    let all = crate::group::duplicates(&prints);
    let pairs = all.iter().flat_map(|d| d.duplicates.iter().map(|copy| (copy.as_str(), d.counts.as_str())));
    pairs.filter_map(|(copy, of)| Some((known(copy)?, known(of)?))).collect()
}

fn decide_group<'a>(members: &[(&'a str, &'a FlightLateness)], pipeline: &Pipeline, out: &mut Decided<'a>) {
    let sources: Vec<FlightSources> = members.iter().map(|(flight, l)| sources_of(flight, l, pipeline)).collect();
    let decision = delay_network::decide(&sources, pipeline.asked(), NetworkSettings::default().datum_uncertainty_s);
    for ((flight, lateness), removed) in members.iter().zip(&decision.removed) {
        out.decisions.insert(flight, decision_of(pipeline.asked(), removed, lateness));
    }
    out.groups.extend(group_lateness(members, &decision));
}

fn sources_of(flight: &str, lateness: &FlightLateness, pipeline: &Pipeline) -> FlightSources {
    let position = lateness.lateness.as_ref().map(|found| PositionLateness {
        lateness_s: found.lateness_s,
        model_uncertainty_s: found.model_uncertainty_s,
        datum: found.datum,
        verdict: lateness.verdict.unwrap_or(record::NetworkVerdict::Unchecked),
        weak: found.weak,
    });
    let relative = lateness
        .position_minus_velocity_s
        .zip(lateness.velocity.clone())
        .map(|(delay_s, velocity)| RelativeLateness { delay_s, velocity });
    FlightSources {
        flight: flight.to_owned(),
        not_measured: position.is_none().then(|| lateness.words.clone()).filter(|why| !why.is_empty()),
        position,
        relative,
        card_s: lateness.card.as_ref().and_then(|card| card.found()).map(|card| card.delay_s),
        stated_s: pipeline.stated(),
        keep_out_of_pool: lateness.kind.varies().then(|| format!("its delay {}", lateness.kind.word())),
    }
}

/// The decision in a form that one more flight does not change.
fn decision_of(asked: DelaySource, removed: &RemovedDelay, lateness: &FlightLateness) -> Decision {
    let from_others = removed.source == Some(DelaySource::OthersFlights);
    let mut decision = Decision {
        asked,
        row: removed.row,
        used: removed.source,
        delay_s: removed.value_s,
        standard_uncertainty_s: match removed.standard_uncertainty_s {
            Some(u) if from_others => Some(rounded_up(u)),
            other => other,
        },
        circular: removed.circular,
        words: if from_others { others_words(removed) } else { removed.words.clone() },
        contradicted: removed.contradicted.clone(),
    };
    if decision.used == Some(DelaySource::Card) && decision.contradicted.is_none() {
        decision.contradicted =
            doubt_of_card(lateness).or_else(|| crate::known_lateness::contradiction_of_card(lateness, &decision));
    }
    if decision.contradicted.is_none() {
        decision.contradicted = crate::known_lateness::velocity_before_motion(lateness, &decision);
    }
    if let (None, Some(Finding::CannotTell(why))) = (decision.used, &lateness.card) {
        decision.words = why.clone();
    }
    refuse_what_is_not_late(&mut decision, lateness);
    decision
}

/// Why the bench itself doubts the delay on the card.
fn doubt_of_card(lateness: &FlightLateness) -> Option<String> {
    let card = lateness.card.as_ref()?.found()?;
    card.notices.iter().find(|n| n.code == Code::RigContradicted).map(|n| n.text.clone())
}

/// Text without the number of flights, which is in the campaign's table.
fn others_words(removed: &RemovedDelay) -> String {
    match removed.row {
        1 => "the mean of the other flights of its group; the residual in this flight tests it".to_owned(),
        3 => "the mean of the other flights of its group; this flight does not show its own delay".to_owned(),
        _ => "the mean of the other flights of its group".to_owned(),
    }
}

/// Only a late position can be compensated, and only a constant delay with one number.
fn refuse_what_is_not_late(decision: &mut Decision, lateness: &FlightLateness) {
    let forced = matches!(decision.asked, DelaySource::Fixed | DelaySource::Card);
    if !forced && lateness.kind.varies() {
        nothing(decision, format!("there is no single delay: it {} during the flight", lateness.kind.word()));
    } else if let Some(delay_s) = decision.delay_s
        && delay_s <= 0.0
    {
        let words = format!("the position is not late ({:.1} ms): nothing to remove", 1e3 * delay_s);
        nothing(decision, words);
    }
}

fn nothing(decision: &mut Decision, words: String) {
    (decision.used, decision.delay_s, decision.standard_uncertainty_s) = (None, None, None);
    (decision.circular, decision.words) = (false, words);
}

/// The next of 1, 2, 5 times a power of ten.
fn rounded_up(u: f64) -> f64 {
    if !(u.is_finite() && u > 0.0) {
        return u;
    }
    let power = u.log10().floor() as i32;
    // Negative powers divide, so that 0.02 is exactly the float literal 0.02.
    let scaled = |step: f64| if power < 0 { step / 10_f64.powi(-power) } else { step * 10_f64.powi(power) };
    [1.0, 2.0, 5.0, 10.0].into_iter().map(scaled).find(|step| *step >= u * (1.0 - 1e-12)).unwrap_or(u)
}

fn group_lateness(members: &[(&str, &FlightLateness)], decision: &GroupDecision) -> Vec<GroupLateness> {
    let Some((_, first)) = members.first() else { return vec![] };
    let empty = GroupLateness {
        group: first.group.clone(),
        flights: members.len() as u64,
        pooled: 0,
        lateness_s: None,
        interval_95_s: None,
        against: first.against.clone(),
        between_s: None,
        words: "no flight of this group shows how late its position is".to_owned(),
        outliers: vec![],
        advice: DelayAdvice::default(),
        members: members.iter().map(|(flight, _)| (*flight).to_owned()).collect(),
        split: None,
        difference: None,
        consistency: None,
    };
    if decision.pools.is_empty() {
        return relative_groups(members, &empty);
    }
    // The first pool is over all flights; further ones are the parts of a split group.
    let of = |(k, pool): (usize, &DelayPool)| pooled(members, pool, empty.clone(), k > 0);
    let mut groups: Vec<GroupLateness> = decision.pools.iter().enumerate().map(of).collect();
    if let Some(whole) = groups.first_mut() {
        name_unlike(whole, &decision.unlike);
    }
    groups
}

/// Names the flights that show only a difference between position and velocity, and not that of the others. If they are
/// the majority, the mean is not that of the group.
fn name_unlike(group: &mut GroupLateness, unlike: &[String]) {
    let alike = group.pooled.saturating_sub(group.outliers.len() as u64);
    if unlike.is_empty() || group.lateness_s.is_none() {
        return;
    }
    group.words += &format!(
        "; {} without a lateness of {} {} in position - velocity: {}",
        crate::answer::counted(unlike.len(), "flight"),
        if unlike.len() == 1 { "its own" } else { "their own" },
        if unlike.len() == 1 { "differs" } else { "differ" },
        first_of(unlike)
    );
    group.outliers.extend_from_slice(unlike);
    if unlike.len() as u64 > alike {
        group.advice = DelayAdvice::default();
        group.words += ". Do not use one delay for all flights of this group";
    }
}

/// The first names, and how many more there are.
fn first_of(names: &[String]) -> String {
    const MOST: usize = 5;
    let shown = names.iter().take(MOST).cloned().collect::<Vec<_>>().join(", ");
    match names.len().checked_sub(MOST) {
        Some(more @ 1..) => format!("{shown} and {more} more"),
        _ => shown,
    }
}

fn pooled(members: &[(&str, &FlightLateness)], pool: &DelayPool, empty: GroupLateness, is_part: bool) -> GroupLateness {
    let of = |m: &PoolMember| Some(members.iter().find(|(flight, _)| *flight == m.flight)?.1);
    let own: Vec<&FlightLateness> = pool.members.iter().filter_map(of).collect();
    let against = own.first().map_or("imu".to_owned(), |l| l.against.clone());
    let described = pool.described();
    // Without a mean, no flight differs from it.
    let differing = pool.members.iter().filter(|m| m.outlier && described.is_some());
    let outliers: Vec<String> = differing.map(|m| m.flight.clone()).collect();
    let mean_s = described.map(|mean| as_wide_as(&mean.mean_s, mean.half_width_95_s));
    let mut words = match described.zip(mean_s) {
        Some((mean, mean_s)) => {
            let of_all = of_all(mean.flights, members);
            let (apart, side) = apart(&mean_s, LATE);
            format!("position {apart} ms {side} against {against} ({of_all})")
        }
        None => {
            let range = range(own.iter().filter_map(|l| Some(l.lateness_s()?.value)), LATE);
            let of_all = of_all(pool.flights, members);
            format!("no common delay: position {range} against {against} ({of_all})")
        }
    };
    if !outliers.is_empty() {
        words += &differ(&outliers);
    }
    if let Some(split) = &pool.split {
        words += &format!("; {}", split.words);
    }
    // The mean of two receivers suits neither; each follows as its own group.
    let advice = match described {
        Some(mean) if pool.split.is_none() => crate::answer::advice_for(&mean.mean_s, &own),
        _ => DelayAdvice::default(),
    };
    let interval = |mean: PoolMean| [-1.0, 1.0].map(|side| mean.mean_s.value + side * mean.half_width_95_s);
    let empty = if is_part { part_of(empty, pool) } else { empty };
    GroupLateness {
        pooled: u64::from(pool.flights),
        lateness_s: mean_s,
        interval_95_s: described.map(interval),
        against,
        between_s: described.map_or(pool.tau_s, |mean| mean.tau_s),
        words,
        outliers,
        advice,
        split: pool.split.as_ref().map(|split| split.words.clone()),
        difference: pool.difference,
        ..empty
    }
}

/// The same group with only the flights of a pool.
fn part_of(group: GroupLateness, pool: &DelayPool) -> GroupLateness {
    let members: Vec<String> = pool.members.iter().map(|m| m.flight.clone()).collect();
    // The parts of a group differ in their delay, and so in their names.
    let part = pool.described().map_or("without a common delay".to_owned(), |mean| {
        format!("near {} ms", flight::fixed(1e3 * mean.mean_s.value, 0))
    });
    let name = format!("{}, flights {part}", group.group.name);
    let group = GroupLateness { group: record::ReceiverGroup { name, ..group.group.clone() }, ..group };
    GroupLateness { flights: members.len() as u64, members, ..group }
}

/// `3 of 4 flights`.
fn of_all(flights: u32, members: &[(&str, &FlightLateness)]) -> String {
    format!("{flights} of {}", crate::answer::counted(members.len(), "flight"))
}

/// Words for a negative and a positive delay.
const LATE: [&str; 2] = ["early", "late"];
const LATER: [&str; 2] = ["earlier", "later"];

/// Size of a delay in ms with U, and its side: `12.0 ± 3.1`, `early`.
fn apart<'a>(delay_s: &Estimate, [before, after]: [&'a str; 2]) -> (String, &'a str) {
    let side = if delay_s.value < 0.0 { before } else { after };
    (in_ms(&Estimate { value: delay_s.value.abs(), ..*delay_s }), side)
}

/// Least and greatest of some delays, s: `190 to 260 ms late`, `1 to 27 ms early`, `5 ms early to 12 ms late`.
fn range(delays_s: impl Iterator<Item = f64>, [before, after]: [&str; 2]) -> String {
    let ms = delays_s.map(|s| (1e3 * s).round());
    let (low, high) = ms.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), ms| (low.min(ms), high.max(ms)));
    match (low < 0.0, high > 0.0) {
        (true, true) => format!("{:.0} ms {before} to {high:.0} ms {after}", -low),
        (true, false) => format!("{:.0} to {:.0} ms {before}", -high, -low),
        _ => format!("{low:.0} to {high:.0} ms {after}"),
    }
}

/// Probability below which flights count as different.
const DIFFER_P: f64 = 0.01;

/// The mean of a pool. Its standard uncertainty is at least half the half-width of its 95 % interval: few flights have
/// wide tails, and ± U must not be narrower than the interval next to it.
fn as_wide_as(mean_s: &Estimate, half_width_95_s: f64) -> Estimate {
    let wide_s = 0.5 * half_width_95_s;
    Estimate { value: mean_s.value, standard_uncertainty: Some(mean_s.standard_uncertainty.unwrap_or(0.0).max(wide_s)) }
}

fn differ(outliers: &[String]) -> String {
    let flights = match outliers.len() {
        1 => "one flight differs".to_owned(),
        n => format!("{n} flights differ"),
    };
    format!("; {flights} from the others: {}", outliers.join(", "))
}

/// A group without a datum: one group per velocity that positions are compared with, because such numbers have no
/// common mean.
fn relative_groups(members: &[(&str, &FlightLateness)], empty: &GroupLateness) -> Vec<GroupLateness> {
    let is_known = |l: &FlightLateness| l.lateness_s().is_some();
    let mut velocities: Vec<&str> = vec![];
    for (_, lateness) in members.iter().filter(|(_, l)| is_known(l)) {
        if !velocities.contains(&lateness.against.as_str()) {
            velocities.push(&lateness.against);
        }
    }
    let [first, _, ..] = velocities[..] else { return vec![relative_group(members, empty.clone())] };
    let of_velocity = |velocity: &str| {
        let own = |(_, l): &&(&str, &FlightLateness)| match is_known(l) {
            true => l.against == velocity,
            // A flight without a measurement is counted once.
            false => velocity == first,
        };
        let own: Vec<(&str, &FlightLateness)> = members.iter().filter(own).copied().collect();
        let empty = GroupLateness {
            flights: own.len() as u64,
            against: velocity.to_owned(),
            members: own.iter().map(|(flight, _)| (*flight).to_owned()).collect(),
            ..empty.clone()
        };
        relative_group(&own, empty)
    };
    velocities.into_iter().map(of_velocity).collect()
}

/// A group without a datum: difference between position and velocity, weighted over its flights.
fn relative_group(members: &[(&str, &FlightLateness)], empty: GroupLateness) -> GroupLateness {
    let flights: Vec<delay_network::FlightLateness> = members
        .iter()
        .filter(|(_, l)| matches!(l.datum, NetworkDatum::None | NetworkDatum::Refused))
        .filter_map(|(flight, l)| difference(flight, l))
        .collect();
    let Some(all) = delay_network::pool(&flights, 0.0) else { return empty };
    let (pool, outliers) = match without_outliers(&all, &flights) {
        Some(others) => others,
        None => (all, vec![]),
    };
    let velocity = empty.against.strip_prefix("relative to ").unwrap_or(&empty.against);
    let mean_s = as_wide_as(&pool.mean_s, pool.half_width_95_s);
    let of_all = of_all(pool.flights, members);
    let differ = surely_differ(&pool);
    let mut words = if differ {
        let range = range(flights.iter().map(|flight| flight.lateness_s), LATER);
        format!(
            "no common delay: position {range} than {velocity} ({of_all}); the flights differ by more \
             than their uncertainties"
        )
    } else {
        let (apart, side) = apart(&Estimate { value: pool.mean_s.value, ..mean_s }, LATER);
        format!("position {apart} ms {side} than {velocity} ({of_all}); the lateness of both is unknown")
    };
    if !outliers.is_empty() {
        words += &self::differ(&outliers);
    }
    GroupLateness {
        pooled: u64::from(pool.flights) + outliers.len() as u64,
        // A mean of flights that differ describes none of them.
        lateness_s: Some(mean_s).filter(|_| !differ),
        interval_95_s: Some(pool.interval_95_s).filter(|_| !differ),
        between_s: pool.tau_s,
        difference: pool.difference,
        words,
        outliers,
        ..empty
    }
}

/// Smallest number of flights that agree, so that the others are the odd ones.
const LEAST_ALIKE: u32 = 3;

fn surely_differ(pool: &DelayPool) -> bool {
    pool.difference.is_some_and(|test| test.p < DIFFER_P)
}

/// The pool of the other flights, and the outliers, if flights differ only because of those.
fn without_outliers(all: &DelayPool, flights: &[delay_network::FlightLateness]) -> Option<(DelayPool, Vec<String>)> {
    let outliers: Vec<String> = all.members.iter().filter(|m| m.outlier).map(|m| m.flight.clone()).collect();
    if outliers.is_empty() || !surely_differ(all) {
        return None;
    }
    let others: Vec<_> = flights.iter().filter(|f| !outliers.contains(&f.flight)).cloned().collect();
    let pool = delay_network::pool(&others, 0.0).filter(|pool| pool.flights >= LEAST_ALIKE && !surely_differ(pool))?;
    Some((pool, outliers))
}

/// Difference between position and velocity of a flight, if known with an uncertainty.
fn difference(flight: &str, lateness: &FlightLateness) -> Option<delay_network::FlightLateness> {
    let apart = lateness.lateness_s()?;
    Some(delay_network::FlightLateness {
        flight: flight.to_owned(),
        lateness_s: apart.value,
        standard_uncertainty_s: apart.standard_uncertainty.filter(|u| *u > 0.0)?,
        model_uncertainty_s: 0.0,
    })
}

/// Groups and duplicates of the flights of a table.
pub(crate) fn of_rows<'a>(rows: &'a [FlightRow], pipeline: &Pipeline) -> Decided<'a> {
    let measured: Vec<(&str, &FlightLateness)> =
        rows.iter().filter_map(|r| Some((r.flight.as_str(), r.lateness.as_ref()?))).collect();
    over(&measured, pipeline)
}

#[cfg(test)]
mod tests {
    use super::*;
    use record::{CardDelay, CardUse, SensorIdentity};

    /// Former bug: a card marked in doubt was removed, and the page of the campaign said "Nothing to do".
    #[test]
    fn the_doubt_of_the_bench_is_the_doubt_of_the_removed_card() {
        let with = |notices| {
            let delay_s = Estimate { value: 0.504, standard_uncertainty: Some(0.127) };
            let card = CardUse {
                file: "m.card.toml".into(),
                blake3: String::new(),
                sensor: SensorIdentity::default(),
                velocity_delay_s: None,
                channel: "position.gps".into(),
                delay_s,
            };
            let card = CardDelay { delay_s, words: String::new(), card, notices };
            FlightLateness { card: Some(Finding::Found(card)), ..crate::answer::unknown("k") }
        };
        let removed = removed(Some(0.504), Some(DelaySource::Card));
        let mut doubted = flight::Notices::new();
        doubted.push(Code::RigContradicted, "position.gps", 1, "position.gps: the bench marked its delay as doubtful");
        let of = |notices| decision_of(DelaySource::Card, &removed, &with(notices)).contradicted;
        assert_eq!(of(flight::Notices::new()), None);
        assert!(of(doubted).unwrap().contains("marked its delay as doubtful"));
    }

    fn removed(value_s: Option<f64>, source: Option<DelaySource>) -> RemovedDelay {
        RemovedDelay {
            flight: "f".into(),
            value_s,
            standard_uncertainty_s: value_s.map(|_| 0.127),
            row: 7,
            source,
            circular: false,
            words: String::new(),
            pooled_flights: 0,
            z: None,
            card_e_n: None,
            contradicted: None,
        }
    }

    /// Former bug: nothing was removed from a whole campaign, and only the pages of its flights said why.
    #[test]
    fn a_card_that_does_not_apply_to_the_flight_is_an_alarm() {
        let why = "m.card.toml: position.gps is not on the card".to_owned();
        let lateness = FlightLateness { card: Some(Finding::CannotTell(why.clone())), ..crate::answer::unknown("k") };
        let of = |asked, removed: &RemovedDelay| {
            let decision = decision_of(asked, removed, &lateness);
            let alarms = record::flight_alarms(Some(&lateness), Some(&decision));
            alarms.into_iter().filter(|a| a.code == flight::Alarm::CardNotUsed).map(|a| a.text).collect::<Vec<_>>()
        };
        assert_eq!(of(DelaySource::Card, &removed(None, None)), [why]);
        let others = removed(Some(0.4), Some(DelaySource::OthersFlights));
        assert!(of(DelaySource::OthersFlights, &others).is_empty(), "the card was not asked for");
    }

    /// Former bug: one odd flight of eight gave "no common delay". With an IMU the same flight was named.
    #[test]
    fn one_odd_flight_of_a_group_without_a_datum_is_named_and_in_no_mean() {
        let group = |odd_s: &[f64], alike: usize| {
            let values = (0..alike).map(|k| 0.2 + 1e-3 * k as f64).chain(odd_s.iter().copied());
            let flights: Vec<(String, FlightLateness)> = values
                .enumerate()
                .map(|(k, s)| (format!("f{k}"), crate::answer::tests::late(s, Some("velocity.gps"))))
                .collect();
            let members: Vec<(&str, &FlightLateness)> = flights.iter().map(|(name, l)| (name.as_str(), l)).collect();
            let all = relative_group(&members, group_lateness(&members, &GroupDecision::default()).remove(0));
            (all.outliers, all.lateness_s.map(|e| e.value), all.words)
        };
        let (outliers, mean_s, words) = group(&[0.35], 7);
        assert_eq!(outliers, ["f7"]);
        assert!((mean_s.unwrap() - 0.203).abs() < 1e-9, "{words}");
        assert!(
            words.contains("(7 of 8 flights)") && words.contains("one flight differs from the others: f7"),
            "{words}"
        );
        assert_eq!(group(&[], 7).0, Vec::<String>::new());
        // Two against two: which are odd is unknown.
        let (outliers, mean_s, words) = group(&[0.35, 0.351], 2);
        assert!(outliers.is_empty() && mean_s.is_none() && words.contains("no common delay"), "{words}");
    }

    /// Former bug: "120 ms late, 5 of 16 flights, set position_s = 0.12" for a group in which nine others showed 400 ms
    /// between position and velocity.
    #[test]
    fn flights_without_an_own_lateness_that_differ_are_named_and_a_majority_gives_no_setting() {
        let of = |others: usize| {
            let own = |k: usize| {
                let found = crate::answer::tests::late(0.12 + 1e-3 * k as f64, None);
                let apart = Estimate { value: 0.12 + 1e-3 * k as f64, standard_uncertainty: Some(0.003) };
                (format!("a{k}"), FlightLateness { position_minus_velocity_s: Some(apart), ..found })
            };
            let other = |k: usize| {
                let apart = Estimate { value: 0.4, standard_uncertainty: Some(0.003) };
                let found = crate::answer::tests::late(0.4, Some("velocity.gps"));
                (format!("c{k}"), FlightLateness { position_minus_velocity_s: Some(apart), ..found })
            };
            let flights: Vec<(String, FlightLateness)> = (0..5).map(own).chain((0..others).map(other)).collect();
            let members: Vec<(&str, &FlightLateness)> = flights.iter().map(|(name, l)| (name.as_str(), l)).collect();
            over(&members, &Pipeline::parse("schema = 1\n", std::path::Path::new("p.toml")).unwrap()).groups.remove(0)
        };
        let few = of(2);
        assert_eq!(few.outliers, ["c0", "c1"]);
        assert!(
            few.words.contains("; 2 flights without a lateness of their own differ in position - velocity: c0, c1")
        );
        let many = of(6);
        assert!(many.words.ends_with("Do not use one delay for all flights of this group"), "{}", many.words);
        assert!(many.words.contains("c4 and 1 more"), "{}", many.words);
    }

    #[test]
    fn the_side_of_a_delay_is_a_word_and_its_size_has_no_sign() {
        let early = Estimate { value: -0.012, standard_uncertainty: Some(0.0015) };
        assert_eq!(apart(&early, LATE), ("12.0 ± 3.0".to_owned(), "early"));
        assert_eq!(range([0.2, 0.19, 0.26].into_iter(), LATE), "190 to 260 ms late");
        assert_eq!(range([-0.001, -0.027].into_iter(), LATER), "1 to 27 ms earlier");
        assert_eq!(range([0.012, -0.005].into_iter(), LATER), "5 ms earlier to 12 ms later");
    }

    #[test]
    fn an_uncertainty_is_rounded_up_to_a_coarse_grid() {
        for (u, up) in [(0.0078, 0.01), (0.01, 0.01), (0.0101, 0.02), (0.021, 0.05), (0.3, 0.5), (2.0, 2.0)] {
            assert_eq!(rounded_up(u), up, "{u}");
        }
    }
}
