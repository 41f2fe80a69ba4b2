//! When each channel has rows, and where the log is damaged.

use super::{Axis, Figure, Line, Panel, Pen, extent, is_drawable};
use crate::number;
use crate::text::short_label;
use flight::{ChannelHealth, Clock, StampHealth};
use record::FlightRecord;

/// Maximum number of channels drawn; the table has all.
const MOST_ROWS: usize = 12;

/// Rows of the channels over time; `None` if no channel has known timestamps.
pub(crate) fn timeline(record: &FlightRecord) -> Option<Figure> {
    let (clock, origin_ns) = time_zero(record)?;
    let timed = timed(record, clock);
    let drawn = &timed[..timed.len().min(MOST_ROWS)];
    let seconds = |ns: i64| ns.saturating_sub(origin_ns) as f64 * 1e-9;
    let (mut covered, mut gaps) = (vec![], vec![]);
    for (row, (_, stamps)) in drawn.iter().enumerate() {
        draw_row(row as f64, stamps, &seconds, &mut covered, &mut gaps);
    }
    let mut names: Vec<String> = drawn.iter().map(|(c, _)| short_label(&c.name)).collect();
    let mut lines = vec![
        Line { name: "rows".to_owned(), pen: Pen::Bars, pieces: covered },
        Line { name: "gap".to_owned(), pen: Pen::Rule, pieces: gaps },
    ];
    let damage = damage(record, clock, &seconds, drawn.len() as f64);
    if !damage.is_empty() {
        names.push("log damaged".to_owned());
        lines.push(Line { name: "damage".to_owned(), pen: Pen::HollowPoints, pieces: damage });
    }
    lines.retain(|line| !line.pieces.is_empty());
    let time = Axis::time("time since the first sample", extent(&lines, |p| p.0)?, 10);
    let all = drawn.iter().fold(0_u64, |all, (_, s)| all.saturating_add(s.gap_count));
    let gaps = if all == 0 { "No gap".to_owned() } else { number::counted(all, "gap", "gaps") };
    Some(Figure {
        id: "timeline".to_owned(),
        number: 0,
        title: format!("{gaps} in {}", number::counted(drawn.len() as u64, "channel", "channels")),
        caption: caption(drawn, all, timed.len() - drawn.len()),
        how_to_read: "Good: full bars from end to end. Bad: a mark in position or velocity where the aircraft turned, \
                      because the compensated position has less data there.",
        panels: vec![Panel::of(time, Axis::rows(&names), lines)],
        panel_size: (860, 30 + 24 * names.len() as u32),
        fine: false,
    })
}

/// A channel and its known timestamps.
type Timed<'a> = (&'a ChannelHealth, &'a StampHealth);

/// Channels with timestamps of this clock, the subjects of the page first.
fn timed(record: &FlightRecord, clock: Clock) -> Vec<Timed<'_>> {
    let channels = record.binding.iter().flat_map(|b| &b.channels);
    let mut timed: Vec<Timed<'_>> =
        channels.filter_map(|c| Some((c, c.stamps.as_ref().filter(|s| s.clock == clock)?))).collect();
    let pair = record.drawable().map(|replay| &replay.pair);
    let used = |name: &str| {
        pair.is_some_and(|p| p.position == name || p.velocity == name || p.reference.as_deref() == Some(name))
    };
    timed.sort_by_key(|(c, _)| !used(&c.name));
    timed
}

/// Note on how many of `gaps` gaps are drawn, and how many channels are not.
fn caption(drawn: &[Timed<'_>], gaps: u64, not_drawn: usize) -> String {
    let mut caption = "Rows of each channel over time; a gap is a step of more than 2.5 median steps.".to_owned();
    let listed = drawn.iter().map(|(_, stamps)| stamps.gaps.len() as u64).sum::<u64>();
    if listed < gaps {
        caption += &format!(" Marked are the {} longest of each channel, {} in all.", 10, number::count(listed));
    }
    if not_drawn > 0 {
        let channels = number::counted(not_drawn as u64, "channel", "channels");
        caption += &format!(" Not drawn, but in the table: {channels}.");
    }
    caption
}

/// The bars of a channel and the marks of its gaps.
fn draw_row(
    middle: f64,
    stamps: &StampHealth,
    seconds: &dyn Fn(i64) -> f64,
    covered: &mut Vec<Vec<(f64, f64)>>,
    gaps: &mut Vec<Vec<(f64, f64)>>,
) {
    let first = seconds(stamps.first_ns);
    let mut sorted: Vec<(f64, f64)> =
        stamps.gaps.iter().map(|g| (first + g.start_s, first + g.start_s + g.length_s)).collect();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut from = first;
    for (start, end) in sorted.iter().copied().chain([(seconds(stamps.last_ns), f64::INFINITY)]) {
        if [from, start].into_iter().all(is_drawable) && start > from {
            covered.push(vec![(from, middle - 0.28), (start, middle + 0.28)]);
        }
        from = end;
    }
    let drawable = sorted.iter().filter(|g| is_drawable(g.0));
    gaps.extend(drawable.map(|g| vec![(g.0, middle - 0.42), (g.0, middle + 0.42)]));
}

/// Clock and timestamp of time zero: that of the replay, otherwise the first timestamp of any channel.
fn time_zero(record: &FlightRecord) -> Option<(Clock, i64)> {
    if let Some(replay) = record.drawable() {
        return Some((replay.clock, replay.origin_ns));
    }
    let mut stamps = record.binding.iter().flat_map(|b| &b.channels).filter_map(|c| c.stamps.as_ref());
    let clock = stamps.clone().next()?.clock;
    let first = stamps.by_ref().filter(|s| s.clock == clock).map(|s| s.first_ns).min()?;
    Some((clock, first))
}

/// Damaged stretches whose time is known, in a separate row.
fn damage(record: &FlightRecord, clock: Clock, seconds: &dyn Fn(i64) -> f64, row: f64) -> Vec<Vec<(f64, f64)>> {
    let Some(log) = &record.log else { return vec![] };
    let first = log.topics.iter().flat_map(|t| &t.stamps).filter(|s| s.clock == clock).map(|s| s.first_ns).min();
    let at = |range: &flight::DamagedRange| Some(seconds(first?) + range.after_s()?);
    log.damage.iter().filter_map(at).filter(|t| is_drawable(*t)).map(|t| vec![(t, row)]).collect()
}
