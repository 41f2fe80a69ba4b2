//! Anomalies of a flight with their times, for the table of the page and the marks in the explorer.

use super::Head::{Number, Text};
use super::flight_delay::main_pair;
use super::{rows, table};
use crate::number;
use crate::text::{sentence, shown};
use flight::{Clock, StampHealth};
use maud::{Markup, html};
use record::{DelayKind, DelayPiece, DelayTermKind, FlightRecord, PairDelay, ReplayRecord};
use serde::Serialize;

/// An anomaly.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Anomaly {
    /// Seconds after the origin of the replay, or after the first position without one; `None` if unknown.
    pub(super) t_s: Option<f64>,
    /// Duration, s; 0 for an instant.
    pub(super) length_s: f64,
    /// Kind in one or two words.
    pub(super) kind: &'static str,
    /// What was detected.
    pub(super) what: String,
}

/// Maximum number of anomalies of each kind; the record has all.
const MOST_OF_A_KIND: usize = 10;

/// All anomalies of a flight in order of time. Those without a time come last.
pub(super) fn of(record: &FlightRecord) -> Vec<Anomaly> {
    let origin = Origin::of(record);
    let mut all: Vec<Anomaly> = main_pair(record).map(|pair| of_delay(pair, origin)).unwrap_or_default();
    all.extend(record.drawable().and_then(resets));
    all.extend(gaps(record, origin));
    all.extend(damage(record, origin));
    let order = |a: &Anomaly| a.t_s.unwrap_or(f64::INFINITY);
    all.sort_by(|a, b| order(a).total_cmp(&order(b)));
    all
}

/// Seconds from the origin of the replay to the origin of the pair; `None` if their clocks differ.
pub(super) fn shift_s(pair: &PairDelay, replay: &ReplayRecord) -> Option<f64> {
    let origin = pair.origin.filter(|origin| origin.clock == replay.clock)?;
    Some(origin.origin_ns.saturating_sub(replay.origin_ns) as f64 * 1e-9)
}

/// What the times of a page count from.
#[derive(Clone, Copy)]
struct Origin {
    clock: Clock,
    ns: i64,
}

impl Origin {
    /// That of the replay; without one, the first timestamp of the position.
    fn of(record: &FlightRecord) -> Option<Origin> {
        if let Some(replay) = record.drawable() {
            return Some(Origin { clock: replay.clock, ns: replay.origin_ns });
        }
        let position = record.lateness.as_ref()?.position.as_deref()?;
        let channel = record.binding.as_ref()?.channels.iter().find(|c| c.name == position)?;
        channel.stamps.as_ref().map(|stamps| Origin { clock: stamps.clock, ns: stamps.first_ns })
    }

    /// Seconds from it to a timestamp of this clock; `None` for another clock.
    fn seconds_to(self, clock: Clock, stamp_ns: i64) -> Option<f64> {
        (self.clock == clock).then(|| stamp_ns.saturating_sub(self.ns) as f64 * 1e-9)
    }
}

/// Changes of the delay, resets that cut the fit, and fixes that arrived late or in bursts.
fn of_delay(pair: &PairDelay, origin: Option<Origin>) -> Vec<Anomaly> {
    let shift = origin.zip(pair.origin).and_then(|(origin, pair)| origin.seconds_to(pair.clock, pair.origin_ns));
    let one = |t_s: f64, kind, what: String| Anomaly { t_s: shift.map(|s| s + t_s), length_s: 0.0, kind, what };
    let pieces = pair.delay.found().map_or(&[][..], |found| &found.pieces);
    let is_reset = |piece: &&DelayPiece| piece.begun_by.starts_with("a reset");
    let cuts = pieces.iter().filter(is_reset).take(MOST_OF_A_KIND);
    let cuts =
        cuts.map(|piece| one(piece.start_s, "position reset", format!("{}: the fit is cut there", piece.begun_by)));
    let mut all: Vec<Anomaly> = cuts.collect();
    let Some(varies) = &pair.varies else { return all };
    let terms = varies.terms.iter().take(MOST_OF_A_KIND).map(|term| match term.kind {
        DelayTermKind::Step => {
            one(term.at_s, "delay", format!("the delay jumps by {} ms", number::significant(1e3 * term.size, 2)))
        }
        DelayTermKind::Bend => one(
            term.at_s,
            "delay",
            format!("the delay begins to change by {} ms/s", number::significant(1e3 * term.size, 2)),
        ),
    });
    let late = varies.late_fixes.iter().take(MOST_OF_A_KIND);
    let late = late.map(|fix| {
        one(
            fix.t_s,
            "late fix",
            format!("a fix {} ms later than its neighbours", number::significant(1e3 * fix.late_s, 2)),
        )
    });
    let bursts = varies.bursts.iter().take(MOST_OF_A_KIND);
    let bursts = bursts.map(|b| {
        let hold = number::significant(b.hold_s, 2);
        one(b.start_s, "burst", format!("{} at once after {hold} s", number::counted(b.fixes, "fix", "fixes")))
    });
    all.extend(terms.chain(late).chain(bursts));
    all
}

/// Position resets: fixes that jump.
fn resets(replay: &ReplayRecord) -> Option<Anomaly> {
    let resets = replay.coverage.position_resets;
    let what =
        format!("{} by more than five sigma against the velocity", number::counted(resets, "fix jumps", "fixes jump"));
    (resets > 0).then_some(Anomaly { t_s: None, length_s: 0.0, kind: "position reset", what })
}

/// The longest gaps of the replayed channels, or of all channels if there is no replay.
fn gaps(record: &FlightRecord, origin: Option<Origin>) -> Vec<Anomaly> {
    let pair = record.drawable().map(|replay| &replay.pair);
    let is_used = |name: &str| {
        pair.is_none_or(|p| p.position == name || p.velocity == name || p.reference.as_deref() == Some(name))
    };
    let channels = record.binding.iter().flat_map(|b| &b.channels).filter(|c| is_used(&c.name));
    let of = |name: &str, stamps: &StampHealth| -> Vec<Anomaly> {
        let start = origin.and_then(|origin| origin.seconds_to(stamps.clock, stamps.first_ns));
        let gap = |gap: &flight::Gap| Anomaly {
            t_s: start.map(|s| s + gap.start_s),
            length_s: gap.length_s,
            kind: "gap",
            what: format!("{} without a row for {} s", sentence(name), number::significant(gap.length_s, 3)),
        };
        stamps.gaps.iter().take(MOST_OF_A_KIND).map(gap).collect()
    };
    channels.filter_map(|c| Some(of(&c.name, c.stamps.as_ref()?))).flatten().collect()
}

/// Damaged ranges of the log. They have a time if the first message and the page use the same clock.
fn damage(record: &FlightRecord, origin: Option<Origin>) -> Vec<Anomaly> {
    let Some(log) = &record.log else { return vec![] };
    let stamps = log.topics.iter().flat_map(|t| &t.stamps);
    let start = origin.and_then(|origin| {
        let first_ns = stamps.filter(|s| s.clock == origin.clock).map(|s| s.first_ns).min()?;
        origin.seconds_to(origin.clock, first_ns)
    });
    let one = |range: &flight::DamagedRange| Anomaly {
        t_s: start.zip(range.after_s()).map(|(start, after)| start + after),
        length_s: 0.0,
        kind: "damage",
        what: format!("{} of {} lost: {}", number::bytes(range.length), sentence(&range.file), sentence(&range.reason)),
    };
    log.damage.iter().take(MOST_OF_A_KIND).map(one).collect()
}

/// The table of anomalies. The time of an anomaly is a link that opens it in the explorer.
pub(super) fn section(record: &FlightRecord, all: &[Anomaly], has_explorer: bool) -> Markup {
    let of_delay = match record.lateness.as_ref().map(|lateness| lateness.kind) {
        Some(kind) if kind.varies() => " The delay changes.",
        Some(DelayKind::Constant | DelayKind::OnTime | DelayKind::Early) => " No change of the delay was detected.",
        _ => " Whether the delay changes is unknown.",
    };
    let numbered: Vec<(usize, &Anomaly)> = (1..).zip(all).collect();
    let row = |(id, anomaly): &(usize, &Anomaly)| {
        let time = anomaly.t_s.map(|t_s| (t_s, number::clock(t_s, 1)));
        html! {
            tr id={ "anomaly-" (id) } {
                th scope="row" { (id) }
                td.n {
                    @match time {
                        Some((t_s, text)) if has_explorer => {
                            a href="#explorer" data-t=(t_s) data-length=(anomaly.length_s) { (text) }
                        }
                        Some((_, text)) => { (text) }
                        None => { "—" }
                    }
                }
                td { (anomaly.kind) }
                td.any { (shown(&anomaly.what)) }
            }
        }
    };
    let head = [Text("#"), Number("When (h:mm:ss)"), Text("What"), Text("Evidence")];
    // Only what was looked for.
    let without = match main_pair(record) {
        Some(pair) if pair.varies.is_some() => ", no late fix, no position reset",
        Some(pair) if pair.delay.found().is_some() => ", no position reset",
        _ => "",
    };
    html! {
        h2 id="anomalies" { "Anomalies" }
        @if all.is_empty() { p { "None: no gap, no damage" (without) "." (of_delay) } }
        @else { (table("What is odd in this flight, in order of time; a time opens it in the explorer", &head, rows(&numbered, 60, head.len(), row))) }
    }
}
