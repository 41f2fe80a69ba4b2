//! Notices about the timestamps of a topic. Channels that share timestamps share the notice.

use super::order::Reason;
use super::plan::Plan;
use flight::{ChannelHealth, Code, Graded, Notices, Severity, StampOffset};

/// One notice, and the channels that it is about.
struct StampNotice<'p> {
    what: Graded,
    topic: &'p str,
    count: u64,
    text: String,
    first: &'p str,
    channels: usize,
}

/// Reports corrected and substituted timestamps of the plans.
pub(super) fn note_stamps(plans: &[Plan<'_>], notices: &mut Notices) {
    let mut all: Vec<StampNotice<'_>> = vec![];
    for notice in plans.iter().flat_map(of_plan) {
        let same = |known: &&mut StampNotice<'_>| {
            (known.what, known.topic, &known.text) == (notice.what, notice.topic, &notice.text)
        };
        match all.iter_mut().find(same) {
            Some(known) => known.channels += 1,
            None => all.push(notice),
        }
    }
    for StampNotice { what, topic, count, text, first, channels } in all {
        notices.push(what, topic, count, format!("{}: {text}", which(first, channels)));
    }
}

fn of_plan<'p>(plan: &'p Plan<'_>) -> Vec<StampNotice<'p>> {
    let notice = |what, count, text| {
        let (topic, first) = (plan.table.topic.name.as_str(), plan.rule.name.as_str());
        StampNotice { what, topic, count, text, first, channels: 1 }
    };
    let rows = plan.table.rows as u64;
    let remarks = plan.remarks.iter().map(|remark| notice(Code::StampKind.at(Severity::Warning), rows, remark.clone()));
    let repairs = plan.stamps.iter().flat_map(|stamps| {
        stamps.repairs.iter().map(move |repair| {
            let text = format!("{} timestamps in {}: {}", stamps.kind, stamps.label, repair.text);
            notice(repair.what, repair.count, text)
        })
    });
    remarks.chain(repairs).collect()
}

/// Kinds of timestamp that are more than a day apart in these channels: they count different clocks. Usually one clock
/// is wrong, in all of them.
pub(super) fn note_apart(apart: &[(ChannelHealth, StampOffset)], notices: &mut Notices) {
    let days = |o: &StampOffset| o.offset_s.median / 86_400.0;
    let is_same =
        |a: &StampOffset, b: &StampOffset| (a.of, a.against) == (b.of, b.against) && (days(a) - days(b)).abs() < 1.0;
    for (at, (health, o)) in apart.iter().enumerate() {
        if apart.iter().take(at).any(|(_, earlier)| is_same(earlier, o)) {
            continue;
        }
        let same = || apart.iter().filter(|(_, other)| is_same(other, o));
        let days = days(o);
        let text = format!(
            "{}: {} timestamps are {:.1} days {} than {} ones, so they use different clocks",
            which(&health.name, same().count()),
            o.of,
            days.abs(),
            if days > 0.0 { "later" } else { "earlier" },
            o.against
        );
        let rows = same().map(|(health, _)| health.used).sum();
        notices.push(Code::ClockSuspect, &health.source.topic, rows, text);
    }
}

/// Channels whose rows share timestamps, and their resolution, s: once for each topic. It is unknown whether the first
/// of the rows is the one at that time.
pub(super) fn note_coarse(coarse: &[(ChannelHealth, f64)], notices: &mut Notices) {
    let shared = |health: &ChannelHealth| -> u64 {
        health.rejected.iter().filter(|r| r.reason == Reason::Shared.text()).map(|r| r.count).sum()
    };
    for (at, (health, step_s)) in coarse.iter().enumerate() {
        let same = |other: &&(ChannelHealth, f64)| other.0.source.topic == health.source.topic;
        if coarse.iter().take(at).any(|earlier| same(&earlier)) {
            continue;
        }
        let count = shared(health);
        let text = format!(
            "{}: {count} of {} rows have the timestamp of another row but a different value, and are not used; the \
             timestamps are no finer than {step_s:.3} s, and a delay against other channels may be wrong by as much",
            which(&health.name, coarse.iter().filter(same).count()),
            count + health.used
        );
        notices.push(Code::DuplicateStamp, &health.source.topic, count, text);
    }
}

/// The channel, or the number of channels.
pub(super) fn which(first: &str, channels: usize) -> String {
    match channels {
        1 => format!("channel {first}"),
        several => format!("{several} channels, the first of them {first}"),
    }
}
