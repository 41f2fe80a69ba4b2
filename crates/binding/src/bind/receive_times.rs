//! Places messages without a time on the clock since boot, between messages of the same vehicle that state it.
//!
//! A link keeps the order of messages. One received after a message of boot time `a` and before one of `b` was sent
//! between the two, if `a` and `b` are send times. Its timestamp is interpolated linearly between both by receive time,
//! so that a slowly changing latency cancels. The error is at most `b - a`.

use super::repair::Repair;
use super::stamp_columns::{Stamps, read_stamps};
use crate::map::{TieRule, TimeSource};
use flight::{Clock, Code, NANOS_PER_SECOND, StampKind};
use formats::stamps::distribution;
use formats::{Log, Table};
use std::rc::Rc;

/// Messages further than this from one that states its time are not placed, ns. The two clocks drift by less between
/// two such messages; a larger drift means that one of them was set, or the vehicle restarted.
const FARTHEST_NS: i64 = NANOS_PER_SECOND;

/// When a message was received and the time it states, ns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Pair {
    logged: i64,
    boot: i64,
}

/// Timestamps on the clock since boot for the rows of a table; `None` if no message near any of them states a time.
pub(super) fn by_receive_time(kind: StampKind, rules: &[TieRule], log: &Log, table: &Table) -> Option<Stamps> {
    let logged = table.logged_ns.as_ref()?;
    let (mut pairs, mut topics) = (vec![], vec![]);
    for rule in rules.iter().filter(|rule| rule.clock == Clock::Boot && matches!(rule.utc, TimeSource::ContainerLogged))
    {
        let of_vehicle = |other: &&Table| rule.meets(&other.topic).is_some() && sender(other) == sender(table);
        for other in log.tables.iter().filter(of_vehicle) {
            let found = pairs_of(rule, other);
            topics.extend((!found.is_empty()).then_some(other.topic.name.as_str()));
            pairs.extend(found);
        }
    }
    pairs.sort_unstable();
    let rows: Vec<Option<(i64, i64)>> = logged.iter().map(|at| place(&pairs, *at)).collect();
    let wide: Vec<f64> = rows.iter().flatten().map(|(_, width)| *width as f64 / NANOS_PER_SECOND as f64).collect();
    let widths = distribution(&wide)?;
    let text = format!(
        "its messages have no timestamp. They are placed on the clock since boot by their receive times, between \
         messages of {} that have one. The error is at most the time between those: usually {:.3} s, {:.3} s at most",
        topics.join(", "),
        widths.median,
        widths.max
    );
    let repairs = vec![Repair { what: Code::StampKind.into(), count: wide.len() as u64, text: text.into() }];
    let nanos = rows.into_iter().map(|row| row.map(|(boot, _)| boot)).collect::<Vec<_>>();
    let label = TimeSource::LoggedOnBoot.label();
    Some(Stamps {
        kind,
        clock: Clock::Boot,
        label,
        nanos: Rc::new(nanos.into()),
        repairs,
        counters: vec![],
        wrapped_at: None,
    })
}

/// The vehicle, component and run of a topic: `@2` of `ATTITUDE@2`.
fn sender(table: &Table) -> &str {
    let name = table.topic.name.as_str();
    name.find(['@', '#']).and_then(|at| name.get(at..)).unwrap_or_default()
}

fn pairs_of(rule: &TieRule, table: &Table) -> Vec<Pair> {
    let stamps = read_stamps(StampKind::Logged, &rule.stamp, table, || None).filter(|s| s.clock == Clock::Boot);
    let boot = stamps.map(|stamps| stamps.nanos).unwrap_or_default();
    let logged = table.logged_ns.iter().flatten();
    logged.zip(boot.iter()).filter_map(|(logged, boot)| Some(Pair { logged: *logged, boot: boot? })).collect()
}

/// The boot time of a message received at a time, and the distance of the messages around it, ns.
fn place(pairs: &[Pair], logged: i64) -> Option<(i64, i64)> {
    let before = pairs.partition_point(|pair| pair.logged < logged).checked_sub(1).and_then(|at| pairs.get(at));
    let after = pairs.get(pairs.partition_point(|pair| pair.logged <= logged));
    let same = pairs.iter().skip(pairs.partition_point(|pair| pair.logged < logged)).find(|pair| pair.logged == logged);
    let near = |pair: &&Pair| pair.logged.abs_diff(logged) <= FARTHEST_NS as u64;
    match (before.filter(near), after.filter(near)) {
        (Some(before), Some(after)) if agree(*before, *after) => {
            let (received, sent) = (after.logged - before.logged, after.boot - before.boot);
            let share = (logged - before.logged) as f64 / received as f64;
            let boot = same.map_or(before.boot + (share * sent as f64).round() as i64, |same| same.boot);
            Some((boot, sent.abs()))
        }
        (before, after) => {
            let nearest =
                [same, before, after].into_iter().flatten().min_by_key(|pair| pair.logged.abs_diff(logged))?;
            let off = logged - nearest.logged;
            Some((nearest.boot.checked_add(off)?, off.abs()))
        }
    }
}

/// Whether both clocks ran at the same rate between two messages.
fn agree(before: Pair, after: Pair) -> bool {
    let apart = after.boot.checked_sub(before.boot).and_then(|sent| sent.checked_sub(after.logged - before.logged));
    apart.is_some_and(|apart| apart.abs() <= FARTHEST_NS)
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    /// Messages every 100 ms, sent 5 s after boot and received 1000 s later with a latency.
    fn pairs(latency_ms: impl Fn(i64) -> i64) -> Vec<Pair> {
        (0..20)
            .map(|i| Pair { boot: (5000 + 100 * i) * MS, logged: (1_005_000 + 100 * i + latency_ms(i)) * MS })
            .collect()
    }

    #[test]
    fn a_slowly_changing_latency_cancels_within_the_stated_error() {
        let latency = |i: i64| 40 + 3 * i;
        let pairs = pairs(latency);
        for i in 0..19 {
            // Sent 30 ms after the message before.
            let received = (1_005_030 + 100 * i + latency(i) + 1) * MS;
            let (boot, width) = place(&pairs, received).unwrap();
            let off = boot - (5030 + 100 * i) * MS;
            assert!(off.abs() <= MS && off.abs() <= width && width == 100 * MS, "{i}: {off} {width}");
        }
    }

    #[test]
    fn the_nearest_message_decides_at_a_restart_and_far_rows_are_not_placed() {
        let mut pairs = pairs(|_| 0);
        for pair in &mut pairs[10..] {
            pair.boot -= 4000 * MS;
            pair.logged += 1200 * MS;
        }
        let place = |ms: i64| place(&pairs, (1_005_000 + ms) * MS).map(|(boot, _)| boot / MS);
        assert_eq!(place(950), Some(5950));
        assert_eq!(place(2180), Some(1980));
        assert_eq!((place(4200), place(4101), place(-999), place(-1001)), (None, None, Some(4001), None));
    }

    #[test]
    fn a_message_received_together_with_another_gets_its_time() {
        assert_eq!(place(&pairs(|_| 7), 1_005_507 * MS), Some((5500 * MS, 200 * MS)));
    }
}
