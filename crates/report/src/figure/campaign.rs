//! The figures of a campaign: how large is each correction, and what the flights say of the delay.

use super::axis::Tick;
use super::{Axis, Figure, Line, Panel, Pen, extent, is_drawable, pieces, stroke, upright};
use crate::number::{self, COVERAGE_FACTOR};
use crate::text::label;
use record::{CampaignDelay, CampaignRecord, ControlPoint, FlightRow};

/// Most flights in a figure with a row for each; the table and the record have all.
const MOST_ROWS: usize = 40;

/// How late each flight's position is, and what removing a delay did to each: the flights by name, the newest first.
pub(crate) fn flights_figures(record: &CampaignRecord) -> Vec<Figure> {
    let numbered = |(figure, number): (Figure, u32)| Figure { number, ..figure };
    [forest(record), effects(record)].into_iter().flatten().zip(1..).map(numbered).collect()
}

/// Flights in groups, the newest first; of too many the newest, and every one that stands out.
fn chosen(record: &CampaignRecord, shown: impl Fn(&FlightRow) -> bool) -> (Vec<&FlightRow>, usize) {
    let mut rows: Vec<&FlightRow> = record.flights.iter().filter(|row| shown(row)).collect();
    rows.sort_by(|a, b| (&b.flown_at, &b.flight).cmp(&(&a.flown_at, &a.flight)));
    let outliers: Vec<&String> = record.groups.iter().flat_map(|g| &g.outliers).collect();
    let stands_out = |row: &FlightRow| outliers.contains(&&row.flight);
    let all = rows.len();
    let mut rank = 0;
    rows.retain(|row| {
        rank += 1;
        rank <= MOST_ROWS || stands_out(row)
    });
    rows.truncate(2 * MOST_ROWS);
    let group = |row: &FlightRow| {
        let name = row.lateness.as_ref().map(|l| &l.group);
        record.groups.iter().position(|g| Some(&g.group) == name).unwrap_or(usize::MAX)
    };
    rows.sort_by_key(|row| group(row));
    let missing = all - rows.len();
    (rows, missing)
}

/// Names at the left, the first row at the top.
fn rows_axis(rows: &[&FlightRow]) -> Axis {
    let count = rows.len();
    let tick = |(k, row): (usize, &&FlightRow)| Tick { at: (count - k) as f64, label: row_name(&row.flight) };
    Axis::ticked("", (0.4, count as f64 + 0.6), rows.iter().enumerate().map(tick).collect())
}

/// The file's name without its ending; of a long one the end, in which names of logs differ.
fn row_name(flight: &str) -> String {
    const MOST: usize = 24;
    let name = flight.rsplit('/').next().unwrap_or(flight);
    let name = label(name.rsplit_once('.').map_or(name, |(stem, _)| stem));
    let length = name.chars().count();
    if length <= MOST { name } else { format!("…{}", name.chars().skip(length - MOST + 1).collect::<String>()) }
}

fn missing_words(missing: usize) -> String {
    match missing {
        0 => String::new(),
        n => format!(" Not drawn, but in the table: {}, the oldest.", number::counted(n as u64, "flight", "flights")),
    }
}

/// How late each position is, with its expanded uncertainty, and the mean of its group.
fn forest(record: &CampaignRecord) -> Option<Figure> {
    let late = |row: &FlightRow| row.lateness.as_ref()?.lateness_s().filter(|e| is_drawable(e.value));
    let (rows, missing) = chosen(record, |row| late(row).is_some());
    let outliers: &Vec<&String> = &record.groups.iter().flat_map(|g| &g.outliers).collect();
    let at = |k: usize| (rows.len() - k) as f64;
    let of = |outside: bool| {
        let wanted = rows.iter().enumerate().filter(move |(_, row)| outliers.contains(&&row.flight) == outside);
        let piece = |(k, row): (usize, &&FlightRow)| {
            let e = late(row)?;
            let half = 1e3 * COVERAGE_FACTOR * e.standard_uncertainty.unwrap_or(0.0);
            let (x, y) = (1e3 * e.value, at(k));
            is_drawable(half).then(|| vec![(x, y), (x - half, y), (x + half, y)])
        };
        wanted.filter_map(piece).collect::<Vec<_>>()
    };
    let (inside, outside) = (of(false), of(true));
    let mut lines = vec![
        Line { name: "flight, ± U (k = 2)".to_owned(), pen: Pen::Points, pieces: inside },
        Line { name: "differs from its group".to_owned(), pen: Pen::HollowPoints, pieces: outside },
        Line { name: "mean of the group".to_owned(), pen: Pen::Rule, pieces: group_means(record, &rows) },
        Line { name: "removed".to_owned(), pen: Pen::DoubtfulPoints, pieces: removed(&rows) },
    ];
    lines.retain(|line| !line.pieces.is_empty());
    let x = Axis::linear("how late the position is (ms)", extent(&lines, |p| p.0)?, 7);
    Some(Figure {
        id: "lateness".to_owned(),
        number: 0,
        title: "How late each position is".to_owned(),
        caption: format!(
            "Lateness (ms) of {}, by group, the newest first.{}",
            number::counted(rows.len() as u64, "flight", "flights"),
            missing_words(missing)
        ),
        how_to_read: "Good: the bars of a group reach its line. Bad: a flight whose bar does not (another cable, rate or \
                      firmware), and a grey ring far from its point (a wrong delay was removed).",
        panels: vec![Panel::of(x, rows_axis(&rows), lines)],
        panel_size: (620, 24 + 15 * rows.len() as u32),
        fine: true,
    })
}

/// An upright through the rows of each group at its mean.
fn group_means(record: &CampaignRecord, rows: &[&FlightRow]) -> Vec<Vec<(f64, f64)>> {
    let of_group = |group: &record::GroupLateness| {
        let mean = 1e3 * group.lateness_s?.value;
        let is_in = |row: &&FlightRow| row.lateness.as_ref().is_some_and(|l| l.group == group.group);
        let first = rows.iter().position(is_in)?;
        let last = rows.iter().rposition(is_in)?;
        let y = |k: usize| (rows.len() - k) as f64;
        is_drawable(mean).then(|| vec![(mean, y(first) + 0.45), (mean, y(last) - 0.45)])
    };
    record.groups.iter().filter_map(of_group).collect()
}

/// Delays that were removed.
fn removed(rows: &[&FlightRow]) -> Vec<Vec<(f64, f64)>> {
    let point = |(k, row): (usize, &&FlightRow)| {
        let x = 1e3 * row.delay_s.filter(|s| is_drawable(*s))?;
        let y = (rows.len() - k) as f64;
        Some(vec![(x, y), (x, y), (x, y)])
    };
    rows.iter().enumerate().filter_map(point).collect()
}

/// Error of each flight before and after a delay was removed.
fn effects(record: &CampaignRecord) -> Option<Figure> {
    let errors = |row: &FlightRow| {
        row.delay_s?;
        let effect = row.effect.as_ref()?;
        let both = [effect.error_raw_m?.value, effect.error_compensated_m?.value];
        both.into_iter().all(|e| is_drawable(e) && e > 0.0).then_some(both)
    };
    let (rows, missing) = chosen(record, |row| errors(row).is_some());
    let y = |k: usize| (rows.len() - k) as f64;
    let all: Vec<(f64, [f64; 2])> = rows.iter().enumerate().filter_map(|(k, row)| Some((y(k), errors(row)?))).collect();
    let points = |k: usize| all.iter().map(|(y, e)| vec![(e[k], *y), (e[k], *y), (e[k], *y)]).collect::<Vec<_>>();
    let ways = all.iter().map(|(y, e)| vec![(e[0], *y), (e[1], *y)]).collect();
    let lines = vec![
        Line { name: String::new(), pen: Pen::Faint, pieces: ways },
        Line { name: "as logged".to_owned(), pen: Pen::HollowPoints, pieces: points(0) },
        Line { name: "after removal".to_owned(), pen: Pen::Points, pieces: points(1) },
    ];
    let (least, largest) = extent(&lines, |p| p.0)?;
    let x = Axis::logarithmic("error of the position, 2‑D rms (m)", (least / 1.15, largest * 1.15));
    let better = all.iter().filter(|(_, [raw, after])| after < raw).count();
    Some(Figure {
        id: "effect".to_owned(),
        number: 0,
        title: "What the removal did".to_owned(),
        caption: format!(
            "Error (2‑D rms, m) before and after, of {}; smaller in {}.{}",
            number::counted(rows.len() as u64, "flight", "flights"),
            number::count(better as u64),
            missing_words(missing)
        ),
        how_to_read: "Good: the full point lies left of the ring. Bad: it lies right of it. Against a reference where the log \
                      has one, else by the lateness that is left.",
        panels: vec![Panel::of(x, rows_axis(&rows), lines)],
        panel_size: (620, 24 + 15 * rows.len() as u32),
        fine: true,
    })
}

/// Most flights on the control chart; the record holds all.
const MOST_FLIGHTS: usize = 400;

/// Measured delays over the flights, with what they should be. `None` without one. Its number is the page's.
pub(crate) fn control_chart(delay: &CampaignDelay, number: u32) -> Option<Figure> {
    // Of too many the newest.
    let left_out = delay.control.len().saturating_sub(MOST_FLIGHTS);
    let points = || (1u32..).zip(&delay.control).skip(left_out);
    let of = |outside: bool| {
        let wanted = points().filter(move |(_, p)| p.is_outside == outside);
        let pieces = wanted.filter_map(|(n, p)| {
            let half = COVERAGE_FACTOR * p.delay_s.standard_uncertainty.unwrap_or(0.0);
            upright(f64::from(n), p.delay_s.value * 1e3, half * 1e3)
        });
        pieces.collect::<Vec<_>>()
    };
    let level = |of: &dyn Fn(&ControlPoint) -> f64| {
        let step = |(n, p): (u32, &ControlPoint)| {
            let (n, y) = (f64::from(n), of(p) * 1e3);
            is_drawable(y).then_some([(n - 0.5, y), (n + 0.5, y)])
        };
        points().filter_map(step).flatten().collect::<Vec<_>>()
    };
    let should = if delay.card_s.is_some() { "sensor card" } else { "should be (card, or mean of the flights)" };
    let mut lines = vec![
        Line { name: "flight, ± U (k = 2)".to_owned(), pen: Pen::Points, pieces: of(false) },
        Line { name: "flight outside its limits".to_owned(), pen: Pen::HollowPoints, pieces: of(true) },
        stroke(should, Pen::Rule, level(&|p| p.centre_s)),
        stroke("limits, ± 3 σ of the difference", Pen::Dashed, level(&|p| p.centre_s + p.limit_s)),
        stroke("", Pen::Dashed, level(&|p| p.centre_s - p.limit_s)),
    ];
    lines.retain(|line| line.pieces.iter().any(|piece| !piece.is_empty()));
    let y = Axis::linear("position later than velocity (ms)", extent(&lines, |p| p.1)?, 7);
    let last = points().count();
    let every = last.div_ceil(25).max(1);
    let tick = |n: usize| Tick { at: n as f64, label: n.to_string() };
    let (first, end) = (left_out + 1, left_out + last);
    let x = Axis::ticked(
        "flight",
        (first as f64 - 0.6, end as f64 + 0.6),
        (first..=end).step_by(every).map(tick).collect(),
    );
    let order =
        if delay.in_time_order { "in the order in which they were flown" } else { "in the order of their names" };
    let outside = delay.control.iter().filter(|p| p.is_outside).count();
    let mut caption = format!(
        "How much later than the velocity each flight shows its position, {} {order}; {} outside.",
        number::counted(last as u64, "flight", "flights"),
        number::count(outside as u64),
    );
    if left_out > 0 {
        caption += &format!(" Not drawn, but in the record: the first {}.", number::count(left_out as u64));
    }
    Some(Figure {
        id: "control-chart".to_owned(),
        number,
        title: "Position later than velocity, from flight to flight".to_owned(),
        caption,
        how_to_read: "Good: bars around the line, none beyond the dashes, no trend. Bad: a step (another firmware, another \
                      rate, another cable) or a trend. About 3 flights of 1000 lie outside by chance. The dashes are wide \
                      where a flight says little.",
        panels: vec![Panel::of(x, y, lines)],
        panel_size: (860, 240),
        fine: false,
    })
}

/// The score of all flights over one delay for all. `None` without a curve.
pub(crate) fn pooled_sweep(delay: &CampaignDelay, number: u32) -> Option<Figure> {
    let pooled = delay.curve.found()?;
    let x_ms: Vec<f64> = pooled.delay_s.iter().map(|s| s * 1e3).collect();
    let (curve, _) = pieces(&x_ms, &pooled.rms_m, &[]);
    let mut lines = vec![Line { name: "all flights, 2‑D rms".to_owned(), pen: Pen::Raw, pieces: curve }];
    let x = Axis::linear("delay removed from all flights (ms)", extent(&lines, |p| p.0)?, 8);
    let (what, label) = match pooled.against_reference {
        true => ("Error of the exact asynchronous form against the reference", "error, 2‑D rms (m)"),
        false => ("Step of the exact asynchronous form at each fix", "step at a fix, 2‑D rms (m)"),
    };
    let y = Axis::linear(label, extent(&lines, |p| p.1)?, 6);
    let mut upright_at = |name: &str, pen: Pen, at_s: f64| {
        let at = at_s * 1e3;
        if (x.low..=x.high).contains(&at) {
            lines.push(stroke(name, pen, vec![(at, y.low), (at, y.high)]));
        }
    };
    if let Some(card) = &delay.card_s {
        upright_at("sensor card", Pen::Dashed, card.value);
    }
    if let Some(measured) = delay.measured.found() {
        upright_at("measured in the flights, mean", Pen::Rule, measured.delay_s.value);
    }
    if let Some(swept) = delay.swept.found() {
        upright_at("best of each flight, mean", Pen::Dotted, swept.delay_s.value);
    }
    Some(Figure {
        id: "campaign-sweep".to_owned(),
        number,
        title: "One delay for all flights".to_owned(),
        caption: format!(
            "{what} (2‑D rms, m) over one delay for {}, {}; mean squares weighted by {}.",
            number::counted(pooled.flights, "flight", "flights"),
            number::counted(pooled.samples, "sample", "samples"),
            if pooled.against_reference { "time flown" } else { "the number of fixes" },
        ),
        how_to_read: "Good: a clear valley with the card at its bottom. Where flights differ, the valley is shallow and one \
                      delay for all costs what its bottom lies above the flights' own.",
        panels: vec![Panel::of(x, y, lines)],
        panel_size: (860, 220),
        fine: false,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_named_by_what_tells_logs_apart() {
        assert_eq!(row_name("data/00000130.BIN"), "00000130");
        assert_eq!(row_name("a/flightlogstats_log_220622_125002_LFQA.csv"), "…_log_220622_125002_LFQA");
    }
}
