//! Lateness of each flight of a campaign: one row per flight, and over the date.

use super::axis::Tick;
use super::{Axis, Figure, Line, Mark, Panel, Pen, extent, is_drawable, outline, stroke, upright};
use crate::number::{self, COVERAGE_FACTOR};
use crate::text::label;
use crate::verdict::{has_no_common_delay, in_millis, is_relative};
use record::{CampaignRecord, ControlPoint, Estimate, FlightRow, GroupLateness};
use std::collections::BTreeSet;

/// Maximum number of flights drawn in a trend.
const MOST_OF_TREND: usize = 2_000;

/// Number of flights in a figure with one row per flight: the newest. The table has all.
const NEWEST: usize = 60;
/// Maximum number of older flights shown in addition because they stand out.
const MOST_OTHERS: usize = 60;
/// Maximum number of groups over the date, each in its own panel.
const MOST_PANELS: usize = 4;
/// Maximum number of points of a group with a name on hover: the newest.
const MOST_NAMED: usize = 30;

/// The newest flights and every older one that stands out, newest first, and the number of flights left out.
pub(super) fn newest(
    flights: &[FlightRow],
    is_shown: impl Fn(&FlightRow) -> bool,
    stands_out: impl Fn(&FlightRow) -> bool,
) -> (Vec<&FlightRow>, usize) {
    let mut rows: Vec<&FlightRow> = flights.iter().filter(|row| is_shown(row)).collect();
    rows.sort_by(|a, b| (&b.flown_at, &b.flight).cmp(&(&a.flown_at, &a.flight)));
    let all = rows.len();
    let older = rows.split_off(all.min(NEWEST));
    rows.extend(older.into_iter().filter(|row| stands_out(row)).take(MOST_OTHERS));
    let missing = all - rows.len();
    (rows, missing)
}

/// Names at the left, the first row at the top.
pub(super) fn flights_axis(flights: &[&str]) -> Axis {
    rows_axis(flights.iter().map(|flight| row_name(flight)).collect())
}

fn rows_axis(names: Vec<String>) -> Axis {
    let count = names.len();
    let tick = |(k, label): (usize, String)| Tick { at: (count - k) as f64, label };
    Axis::ticked("", (0.4, count as f64 + 0.6), names.into_iter().enumerate().map(tick).collect())
}

/// The file name without its extension. Long names are shortened to their end, which is where names of logs differ.
fn row_name(flight: &str) -> String {
    const MOST: usize = 24;
    let name = flight.rsplit('/').next().unwrap_or(flight);
    let name = label(name.rsplit_once('.').map_or(name, |(stem, _)| stem));
    let length = name.chars().count();
    if length <= MOST { name } else { format!("…{}", name.chars().skip(length - MOST + 1).collect::<String>()) }
}

pub(super) fn missing_words(missing: usize, which: &str) -> String {
    match missing {
        0 => String::new(),
        n => format!(" Not drawn, but in the table: {}, {which}.", number::counted(n as u64, "flight", "flights")),
    }
}

/// A row of the forest.
enum Row<'a> {
    Flight(&'a FlightRow, Estimate),
    /// After the flights of a group; without a number if no single one describes them all.
    Mean(&'a GroupLateness, Option<Estimate>),
}

/// Flights by group, newest first, each group followed by its mean.
struct Forest<'a> {
    rows: Vec<Row<'a>>,
    flights: usize,
    missing: usize,
}

fn late(row: &FlightRow) -> Option<Estimate> {
    row.lateness.as_ref()?.lateness_s().filter(|e| is_drawable(e.value)).map(|e| in_millis(&e))
}

impl<'a> Forest<'a> {
    fn of(record: &'a CampaignRecord) -> Forest<'a> {
        let is_outlier = |row: &FlightRow| record.groups.iter().any(|g| g.outliers.contains(&row.flight));
        let (rows, missing) = newest(&record.flights, |row| late(row).is_some(), is_outlier);
        let groups: Vec<&GroupLateness> = record.groups.iter().filter(|g| g.split.is_none()).collect();
        let group_of = |row: &FlightRow| groups.iter().position(|g| g.members.contains(&row.flight));
        let placed: Vec<(Option<usize>, &FlightRow)> = rows.iter().map(|row| (group_of(row), *row)).collect();
        let mut out = Forest { rows: vec![], flights: rows.len(), missing };
        for k in (0..groups.len()).map(Some).chain([None]) {
            let members = placed.iter().filter(|(group, _)| *group == k);
            let flights: Vec<Row<'_>> = members.filter_map(|(_, row)| Some(Row::Flight(row, late(row)?))).collect();
            let has_mean = flights.len() > 1;
            out.rows.extend(flights);
            if let Some(group) = k.map(|k| groups[k]).filter(|group| has_mean && group.pooled > 0) {
                let mean = group.lateness_s.filter(|_| !has_no_common_delay(group)).map(|e| in_millis(&e));
                out.rows.push(Row::Mean(group, mean.filter(|e| is_drawable(e.value))));
            }
        }
        out
    }

    /// Height of a row.
    fn y(&self, k: usize) -> f64 {
        (self.rows.len() - k) as f64
    }

    fn placed(&self) -> impl Iterator<Item = (f64, &Row<'a>)> {
        self.rows.iter().enumerate().map(|(k, row)| (self.y(k), row))
    }

    fn names(&self) -> Vec<String> {
        let name = |row: &Row<'_>| match row {
            Row::Flight(row, _) => row_name(&row.flight),
            Row::Mean(group, mean) => {
                let words = if mean.is_some() { "mean" } else { "differ" };
                format!("{words}: {}", ending(&label(&group.group.name), 20))
            }
        };
        self.rows.iter().map(name).collect()
    }

    /// Points with expanded uncertainties, either of the flights that differ from their group or of the others.
    fn points(&self, record: &CampaignRecord, outside: bool) -> Vec<Vec<(f64, f64)>> {
        let is_outlier = |row: &FlightRow| record.groups.iter().any(|g| g.outliers.contains(&row.flight));
        let point = |(y, row): (f64, &Row<'_>)| match row {
            Row::Flight(row, e) if is_outlier(row) == outside => {
                let half = COVERAGE_FACTOR * e.standard_uncertainty.unwrap_or(0.0);
                is_drawable(half).then(|| vec![(e.value, y), (e.value - half, y), (e.value + half, y)])
            }
            _ => None,
        };
        self.placed().filter_map(point).collect()
    }

    /// The removed delays.
    fn removed(&self) -> Vec<Vec<(f64, f64)>> {
        let point = |(y, row): (f64, &Row<'_>)| match row {
            Row::Flight(row, _) => row.delay_s.map(|s| 1e3 * s).filter(|ms| is_drawable(*ms)).map(|x| vec![(x, y); 3]),
            Row::Mean(..) => None,
        };
        self.placed().filter_map(point).collect()
    }

    /// The mean of each group with its expanded uncertainty.
    fn means(&self) -> Vec<Vec<(f64, f64)>> {
        let bar = |(y, row): (f64, &Row<'_>)| match row {
            Row::Mean(_, Some(mean)) => {
                let half = COVERAGE_FACTOR * mean.standard_uncertainty.unwrap_or(0.0);
                is_drawable(half).then(|| vec![(mean.value - half, y - 0.3), (mean.value + half, y + 0.3)])
            }
            Row::Mean(_, None) | Row::Flight(..) => None,
        };
        self.placed().filter_map(bar).collect()
    }

    /// Delay from the sensor card with its expanded uncertainty, drawn behind each run of flights with one card.
    fn cards(&self) -> Vec<Vec<(f64, f64)>> {
        let card = |row: &Row<'_>| match row {
            Row::Flight(row, _) => row.card_delay_s.map(|e| in_millis(&e)),
            Row::Mean(..) => None,
        };
        let area = |(y, row): (f64, &Row<'_>)| {
            let e = card(row)?;
            let half = COVERAGE_FACTOR * e.standard_uncertainty.unwrap_or(0.0);
            let corners = ((e.value - half, y - 0.5), (e.value + half, y + 0.5));
            (is_drawable(e.value) && is_drawable(half)).then(|| outline(corners.0, corners.1))
        };
        self.placed().filter_map(area).collect()
    }

    fn marks(&self) -> Vec<Mark> {
        let mark = |(y, row): (f64, &Row<'_>)| {
            let (name, e) = match row {
                Row::Flight(row, e) => (&row.flight, e),
                Row::Mean(group, e) => (&group.group.name, e.as_ref()?),
            };
            Some(Mark { at: (e.value, y), label: format!("{}: {} ms", label(name), number::with_uncertainty(e)) })
        };
        self.placed().filter_map(mark).collect()
    }
}

/// Lateness of each position with its expanded uncertainty, and the mean of its group.
pub(crate) fn forest(record: &CampaignRecord) -> Option<Figure> {
    let forest = Forest::of(record);
    let mut lines = vec![
        Line { name: "flight, ± U (k = 2)".to_owned(), pen: Pen::Points, pieces: forest.points(record, false) },
        Line { name: "differs from its group".to_owned(), pen: Pen::HollowPoints, pieces: forest.points(record, true) },
        Line { name: "mean of the group, ± U".to_owned(), pen: Pen::Bars, pieces: forest.means() },
        Line { name: "sensor card, ± U".to_owned(), pen: Pen::Uncertainty, pieces: forest.cards() },
        Line { name: "removed".to_owned(), pen: Pen::DoubtfulPoints, pieces: forest.removed() },
    ];
    lines.retain(|line| !line.pieces.is_empty());
    let x = Axis::linear("how late the position is (ms)", extent(&lines, |p| p.0)?, 7);
    let named = Panel { names: forest.marks(), ..Panel::of(x, rows_axis(forest.names()), lines) };
    Some(Figure {
        id: "lateness".to_owned(),
        number: 0,
        title: "How late each position is".to_owned(),
        caption: format!(
            "Lateness (ms) of {}, by group, the newest first{}.{}",
            number::counted(forest.flights as u64, "flight", "flights"),
            if record.groups.iter().any(is_relative) {
                "; relative to the velocity where nothing ties a flight to true time"
            } else {
                ""
            },
            missing_words(forest.missing, "the oldest that agree with their group")
        ),
        how_to_read: "Good: the bars of a group reach the mean below them. Bad: a flight whose bar does not (another cable, \
                      rate or firmware), and a grey ring far from its point (a wrong delay was removed).",
        panels: vec![named],
        panel_size: (540, 24 + 15 * forest.rows.len() as u32),
        fine: true,
    })
}

/// The end of a long name: names of groups differ at the end.
fn ending(name: &str, most: usize) -> String {
    match name.chars().count().checked_sub(most) {
        None | Some(0) => name.to_owned(),
        Some(left_out) => format!("…{}", name.chars().skip(left_out + 1).collect::<String>().trim_start()),
    }
}

/// The flights of a group on its chart: horizontal position and flight.
type Points<'a> = Vec<(f64, &'a ControlPoint)>;

type Chart<'a> = (&'a GroupLateness, Points<'a>);

/// Whether each group keeps its limits, flight by flight: one panel per group.
pub(crate) fn trend(record: &CampaignRecord) -> Option<Figure> {
    let (mut groups, by_date) = largest_first(record);
    let left_out = groups.len().saturating_sub(MOST_PANELS);
    groups.truncate(MOST_PANELS);
    let with_card: BTreeSet<&str> =
        record.flights.iter().filter(|row| row.card_delay_s.is_some()).map(|row| row.flight.as_str()).collect();
    let outside = groups.iter().flat_map(|(_, points)| points).filter(|(_, point)| point.is_outside);
    let [of_card, of_group] =
        outside.fold([0, 0], |[card, group], (_, point)| match with_card.contains(&*point.flight) {
            true => [card + 1, group],
            false => [card, group + 1],
        });
    let most = MOST_OF_TREND / groups.len().max(1);
    let older = groups.iter_mut().map(|(_, points)| keep_newest(points, most)).sum();
    let all = || groups.iter().flat_map(|(_, points)| points.iter().map(|(at, _)| *at));
    let range = (all().reduce(f64::min)?, all().reduce(f64::max)?);
    let x = if by_date { date_axis(range) } else { Axis::linear("flight, in the order of names", range, 8) };
    let drawn = all().count();
    let panels: Vec<Panel> = groups.iter().filter_map(|(group, points)| trend_panel(group, points, &x)).collect();
    let height = 300 / u32::try_from(panels.len()).unwrap_or(1).max(1);
    Some(Figure {
        id: "trend".to_owned(),
        number: 0,
        title: trend_title(of_group, of_card),
        caption: format!(
            "How much later the position is than the velocity, for {}, {}; each group with its own mean and limits. \
             Where the lateness is known, it differs from this by the lateness of the velocity.{}",
            number::counted(drawn as u64, "flight", "flights"),
            if by_date { "by date" } else { "in the order of their names, because their dates are unknown" },
            trend_rest(record, drawn, older, left_out)
        ),
        how_to_read: "Good: bars around the line, none beyond its caps (± 3 σ), no trend. Bad: a step (another \
                      firmware, rate or cable) or a trend. About 3 flights of 1000 lie outside by chance. The caps are \
                      far apart where a flight is uncertain. Point at a flight for its name.",
        panels,
        panel_size: (540, height.max(110)),
        fine: drawn > 150,
    })
}

fn trend_title(of_group: u64, of_card: u64) -> String {
    let are = |n: u64| number::counted(n, "flight is", "flights are");
    let rest = match (of_group, of_card) {
        (0, 0) => "no flight is outside its limits".to_owned(),
        (n, 0) => format!("{} outside the limits of the group", are(n)),
        (0, n) => format!("{} outside the limits of the sensor card", are(n)),
        (n, m) => format!("{} outside the limits of the group, and {m} outside those of the sensor card", are(n)),
    };
    format!("Position − velocity: {rest}")
}

/// The charts of the groups, by date if any flight has one, otherwise by name.
fn largest_first(record: &CampaignRecord) -> (Vec<Chart<'_>>, bool) {
    let dated = charts(record, &|_, point| seconds(point.flown_at.as_deref()?));
    let by_date = !dated.is_empty();
    let mut groups = if by_date { dated } else { charts(record, &|k, _| Some(k as f64 + 1.0)) };
    groups.sort_by_key(|(_, points)| std::cmp::Reverse(points.len()));
    (groups, by_date)
}

/// The charts of the groups with at least three flights.
fn charts<'a>(record: &'a CampaignRecord, place: &dyn Fn(usize, &ControlPoint) -> Option<f64>) -> Vec<Chart<'a>> {
    let of = |group: &'a GroupLateness| {
        let control = &group.consistency.as_ref()?.control;
        let points: Points<'a> = control.iter().enumerate().filter_map(|(k, p)| Some((place(k, p)?, p))).collect();
        (points.len() > 2).then_some((group, points))
    };
    record.groups.iter().filter_map(of).collect()
}

/// Keeps the newest points, prioritising those outside their limits; returns the number dropped.
fn keep_newest(points: &mut Points<'_>, most: usize) -> usize {
    let before = points.len();
    for outside in [false, true] {
        let mut excess = points.len().saturating_sub(most);
        points.retain(|(_, point)| {
            let goes = excess > 0 && point.is_outside == outside;
            excess -= usize::from(goes);
            !goes
        });
    }
    before - points.len()
}

/// Note on what the trend omits.
fn trend_rest(record: &CampaignRecord, drawn: usize, older: usize, groups: usize) -> String {
    let rest = record.flights.len() - drawn - older;
    let mut words = String::new();
    if older > 0 {
        words += &format!(
            " {} are not drawn; those outside their limits are drawn first.",
            number::counted(older as u64, "older flight", "older flights")
        );
    }
    if rest > 0 {
        words += &format!(
            " Not shown: {} without one delay, without a date, or in groups of fewer than three.",
            number::counted(rest as u64, "flight", "flights")
        );
    }
    if groups > 0 {
        words +=
            &format!(" {} in the record.", number::counted(groups as u64, "smaller group is", "smaller groups are"));
    }
    words
}

/// A lateness (s) with the ends of its error bar, ms; `None` if it cannot be drawn.
pub(super) fn late_point(at: f64, late_s: &Estimate) -> Option<Vec<(f64, f64)>> {
    let half = COVERAGE_FACTOR * late_s.standard_uncertainty.unwrap_or(0.0);
    upright(at, late_s.value * 1e3, half * 1e3)
}

/// The flight of a point.
pub(super) fn late_mark(at: f64, flight: &str, late_s: &Estimate) -> Option<Mark> {
    let mark = |height: f64| Mark {
        at: (at, height),
        label: format!("{}: {} ms", label(flight), number::with_uncertainty(&in_millis(late_s))),
    };
    Some(late_s.value * 1e3).filter(|ms| is_drawable(*ms)).map(mark)
}

fn trend_panel(group: &GroupLateness, points: &Points<'_>, x: &Axis) -> Option<Panel> {
    let of = |outside: bool| {
        let wanted = points.iter().filter(move |(_, p)| p.is_outside == outside);
        wanted.filter_map(|(at, p)| late_point(*at, &p.delay_s)).collect::<Vec<_>>()
    };
    let level = |of: &dyn Fn(&ControlPoint) -> f64| {
        let place = |(at, p): &(f64, &ControlPoint)| Some((*at, of(p) * 1e3)).filter(|(_, y)| is_drawable(*y));
        points.iter().filter_map(place).collect::<Vec<_>>()
    };
    // A cap for each flight: flights of one day would otherwise merge into a vertical line.
    let half = 0.006 * (x.high - x.low);
    let caps = |name: &str, of: &dyn Fn(&ControlPoint) -> f64| {
        let pieces = level(of).into_iter().map(|(at, y)| vec![(at - half, y), (at + half, y)]).collect();
        Line { name: name.to_owned(), pen: Pen::Faint, pieces }
    };
    let should = "mean of the group, or its sensor card";
    let mut lines = vec![
        Line { name: "flight, ± U (k = 2)".to_owned(), pen: Pen::Points, pieces: of(false) },
        Line { name: "outside its limits".to_owned(), pen: Pen::HollowPoints, pieces: of(true) },
        stroke(should, Pen::Rule, level(&|p| p.centre_s)),
        caps("limits, ± 3 σ", &|p| p.centre_s + p.limit_s),
        caps("", &|p| p.centre_s - p.limit_s),
    ];
    lines.retain(|line| line.pieces.iter().any(|piece| !piece.is_empty()));
    let y = Axis::linear("position − velocity (ms)", extent(&lines, |p| p.1)?, 5);
    let newest = points.iter().rev().take(MOST_NAMED);
    let names = newest.filter_map(|(at, p)| late_mark(*at, &p.flight, &p.delay_s)).collect();
    Some(Panel { names, heading: label(&group.group.name), ..Panel::of(x.clone(), y, lines) })
}

/// Seconds since 1970 of an instant in the format of records.
pub(super) fn seconds(instant: &str) -> Option<f64> {
    Some(instant.parse::<jiff::Timestamp>().ok()?.as_second() as f64)
}

/// An axis of dates, or of times of day if all are within two days.
pub(super) fn date_axis((low, high): (f64, f64)) -> Axis {
    const DAY: f64 = 86_400.0;
    const STEPS_H: [f64; 8] = [0.25, 1.0, 3.0, 6.0, 24.0, 48.0, 168.0, 336.0];
    let air = ((high - low) * 0.04).max(0.01 * DAY);
    let (low, high) = (low - air, high + air);
    let wanted = (high - low) / 5.0;
    let step = STEPS_H
        .into_iter()
        .map(|h| 3600.0 * h)
        .find(|s| *s >= wanted)
        .unwrap_or_else(|| (wanted / (28.0 * DAY)).ceil() * 28.0 * DAY);
    let format = if step < DAY { "%m-%d %H:%M" } else { "%Y-%m-%d" };
    let first = (low / step).ceil();
    let places = (0..8).map(|k| (first + f64::from(k)) * step).take_while(|at| *at <= high);
    let written = |at: f64| jiff::Timestamp::from_second(at as i64).ok().map(|t| t.strftime(format).to_string());
    let ticks = places.filter_map(|at| Some(Tick { at, label: written(at)? })).collect();
    Axis::ticked("date of flight (UTC)", (low, high), ticks)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_named_by_the_distinctive_part_of_the_log_name() {
        assert_eq!(row_name("data/00000130.BIN"), "00000130");
        assert_eq!(row_name("a/flightlogstats_log_220622_125002_LFQA.csv"), "…_log_220622_125002_LFQA");
    }

    #[test]
    fn dates_have_daily_ticks_and_flights_of_one_day_hourly_ticks() {
        let at = |text: &str| seconds(text).unwrap();
        let labels = |low: &str, high: &str| {
            let axis = date_axis((at(low), at(high)));
            assert!((1..=8).contains(&axis.ticks.len()), "{axis:?}");
            assert!(axis.ticks.iter().all(|t| (axis.low..=axis.high).contains(&t.at)));
            axis.ticks.into_iter().map(|t| t.label).collect::<Vec<_>>()
        };
        assert_eq!(labels("2026-05-04T08:00:00Z", "2026-05-04T16:30:00Z")[0], "05-04 09:00");
        assert!(labels("2026-05-04T08:00:00Z", "2026-11-04T16:30:00Z")[0].starts_with("2026-0"));
        labels("2026-05-04T08:00:00Z", "2026-05-04T08:00:00Z");
        assert_eq!(seconds("yesterday"), None);
    }
}
