//! Control charts: the lateness of flights in flying order, and where it changes.

use crate::brief::{Brief, PageOf};
use crate::change_points::{ChangePoints, FALSE_ALARM, Looks, SharedMean, change_points, weighted_mean};
use crate::row::Dimension;
use record::{
    Estimate, NewTrendChange, RECORD_VERSION, TrendChange, TrendChart, TrendPoint, TrendRecord, TrendSegment,
};
use std::collections::{BTreeMap, BTreeSet};

/// Minimum number of flights in a chart.
const FEWEST: usize = 3;
/// Maximum number of points that a chart lists, the newest.
const MOST_POINTS: usize = 1000;
/// Limits are this many standard deviations from the centre.
const LIMIT_SIGMAS: f64 = 3.0;

/// Control charts, and the intervals of their changes.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Trend {
    /// The charts.
    pub record: TrendRecord,
    /// For each chart and each of its changes: first and last instant at which it may have happened.
    spans: Vec<Vec<(i64, i64)>>,
}

/// Subject of a chart: dimension, value, datum.
type ChartKey = (Dimension, String, String);

/// The control charts of the latest row of each flight, for each of the dimensions. `looks` states whether the false
/// alarm probability is for one look, or for all looks as the charts grow.
#[must_use]
pub fn trend(latest: &[&Brief], dimensions: &[Dimension], looks: Looks, page: PageOf<'_>) -> Trend {
    let mut left_out: BTreeMap<String, u64> = BTreeMap::new();
    let mut series: BTreeMap<ChartKey, Vec<&Brief>> = BTreeMap::new();
    for &row in latest {
        match why_not(row) {
            Some(why) => *left_out.entry(why.to_owned()).or_default() += 1,
            None => dimensions.iter().for_each(|&dimension| match row.of(dimension) {
                Some(value) => {
                    let datum = row.datum.as_deref().unwrap_or_default().to_owned();
                    series.entry((dimension, value, datum)).or_default().push(row);
                }
                None => *left_out.entry(format!("without {}", dimension.name())).or_default() += 1,
            }),
        }
    }
    let mut trend = Trend::default();
    for (key, mut rows) in series {
        if rows.len() < FEWEST {
            *left_out.entry(format!("whose chart would have fewer than {FEWEST} flights")).or_default() +=
                rows.len() as u64;
            continue;
        }
        rows.sort_by_key(|row| (row.order(), &row.campaign, &row.flight));
        let (chart, spans) = chart(key, &rows, looks, page);
        trend.record.charts.push(chart);
        trend.spans.push(spans);
    }
    trend.record.record_version = RECORD_VERSION;
    trend.record.false_alarm = FALSE_ALARM;
    trend.record.every_look = looks == Looks::Every;
    trend.record.left_out = left_out.into_iter().map(|(why, count)| format!("{count} {why}")).collect();
    trend
}

/// Changes that another look did not show: its chart has no change at the same place, and no other chart has one at the
/// same flight (as after an edit of the fleet file).
#[must_use]
pub fn new_changes(before: &Trend, now: &Trend) -> Vec<NewTrendChange> {
    let key = |chart: &TrendChart| (chart.dimension.clone(), chart.value.clone(), chart.datum.clone());
    let known: BTreeMap<_, _> = before.record.charts.iter().map(key).zip(&before.spans).collect();
    let charts = before.record.charts.iter();
    let flights: BTreeSet<(&str, &str)> =
        charts.flat_map(|chart| &chart.changes).map(|c| (c.at.campaign.as_str(), c.at.flight.as_str())).collect();
    let mut new = vec![];
    for (chart, spans) in now.record.charts.iter().zip(&now.spans) {
        let old = known.get(&key(chart));
        let is_known = |(from, to): &(i64, i64)| old.is_some_and(|old| old.iter().any(|(f, t)| f <= to && from <= t));
        for (change, _) in chart.changes.iter().zip(spans).filter(|(_, span)| !is_known(span)) {
            if flights.contains(&(change.at.campaign.as_str(), change.at.flight.as_str())) {
                continue;
            }
            let chart = chart.name();
            new.push(NewTrendChange { chart, change: change.clone() });
        }
    }
    new
}

/// Why a flight is not on any chart.
fn why_not(row: &Brief) -> Option<&'static str> {
    let known = row.lateness_s.is_some_and(f64::is_finite);
    let uncertain = row.lateness_u_s.is_some_and(|u| u.is_finite() && u > 0.0);
    match (known, uncertain) {
        (false, _) => Some("without a lateness"),
        (_, false) => Some("without an uncertainty"),
        _ if row.duplicate_of.is_some() => Some("copied from another flight"),
        _ => None,
    }
}

fn chart(
    (dimension, value, datum): ChartKey,
    rows: &[&Brief],
    looks: Looks,
    page: PageOf<'_>,
) -> (TrendChart, Vec<(i64, i64)>) {
    let number =
        |of: &dyn Fn(&Brief) -> Option<f64>| rows.iter().map(|row| of(row).unwrap_or_default()).collect::<Vec<f64>>();
    let (x, u) = (number(&|row| row.lateness_s), number(&|row| row.lateness_u_s));
    let model: Vec<Option<f64>> = rows.iter().map(|row| row.lateness_model_u_s).collect();
    let found = change_points(&x, &u, looks);
    let starts: Vec<usize> = [0].into_iter().chain(found.changes.iter().copied()).collect();
    let ends = found.changes.iter().copied().chain([rows.len()]);
    let parts: Vec<Part> =
        starts.iter().zip(ends).map(|(&from, to)| Part::of(from, to, (&x, &u, &model), &found)).collect();
    let named = |i: usize| rows[i].named(page);
    let segments = parts.iter().map(|part| TrendSegment {
        first: named(part.from),
        last: named(part.to - 1),
        flights: part.counted,
        mean_s: part.mean(),
    });
    let changes = (0..found.changes.len()).map(|k| change(k, &parts, &found, rows, page));
    let points = points(rows, (&x, &u), &parts, &found, page);
    let spans = found.ranges.iter().map(|&(first, last)| (rows[first].order(), rows[last].order()));
    let chart = TrendChart {
        dimension: dimension.name().to_owned(),
        value,
        datum,
        between_s: found.between,
        threshold: found.threshold,
        older_points: rows.len().saturating_sub(MOST_POINTS) as u64,
        segments: segments.collect(),
        changes: changes.collect(),
        points,
    };
    (chart, spans.collect())
}

/// A segment without a change.
struct Part {
    from: usize,
    to: usize,
    counted: u64,
    mean_s: f64,
    /// Standard uncertainty of the mean as a lateness.
    u_s: f64,
    /// The same for a difference to other flights of the chart: the error that all share cancels. Their model errors
    /// may differ, so each flight counts with its full uncertainty.
    difference_u_s: f64,
}

impl Part {
    fn of(from: usize, to: usize, (x, u, model): (&[f64], &[f64], &[Option<f64>]), found: &ChangePoints) -> Part {
        let counts: Vec<usize> = (from..to).filter(|i| found.outliers.binary_search(i).is_err()).collect();
        // If all of them are outliers, use them all.
        let counts = if counts.is_empty() { (from..to).collect() } else { counts };
        let of = |values: &[f64]| counts.iter().map(|&i| values[i]).collect::<Vec<f64>>();
        let (x, u) = (of(x), of(u));
        let model: Vec<Option<f64>> = counts.iter().map(|&i| model[i]).collect();
        let (mean_s, difference_u_s) = weighted_mean(&x, &u, found.between).unwrap_or((f64::NAN, f64::NAN));
        let u_s = SharedMean::of(&x, &u, &model).map_or(f64::NAN, |mean| mean.u());
        Part { from, to, counted: counts.len() as u64, mean_s, u_s, difference_u_s }
    }

    fn mean(&self) -> Estimate {
        Estimate { value: self.mean_s, standard_uncertainty: Some(self.u_s) }
    }
}

fn change(k: usize, parts: &[Part], found: &ChangePoints, rows: &[&Brief], page: PageOf<'_>) -> TrendChange {
    let (before, after) = (&parts[k], &parts[k + 1]);
    let step_s = after.mean_s - before.mean_s;
    let u_s = before.difference_u_s.hypot(after.difference_u_s);
    let (first, last) = found.ranges[k];
    let at = rows[found.changes[k]];
    TrendChange {
        at: at.named(page),
        flown_at: at.flown_ns.and_then(instant),
        earliest: rows[first].named(page),
        latest: rows[last].named(page),
        step_s: Estimate { value: step_s, standard_uncertainty: Some(u_s) },
        sigmas: step_s / u_s,
        with_it: with_it(&rows[before.from..before.to], &rows[after.from..after.to]),
    }
}

fn points(
    rows: &[&Brief],
    (x, u): (&[f64], &[f64]),
    parts: &[Part],
    found: &ChangePoints,
    page: PageOf<'_>,
) -> Vec<TrendPoint> {
    let newest = rows.len().saturating_sub(MOST_POINTS);
    let point = |i: usize| {
        let part = parts.iter().find(|part| i < part.to);
        let (centre_s, centre_u_s) = part.map_or((f64::NAN, 0.0), |part| (part.mean_s, part.difference_u_s));
        let limit_s = LIMIT_SIGMAS * u[i].hypot(found.between).hypot(centre_u_s);
        TrendPoint {
            flight: rows[i].named(page),
            flown_at: rows[i].flown_ns.and_then(instant),
            lateness_s: Estimate { value: x[i], standard_uncertainty: Some(u[i]) },
            centre_s,
            limit_s,
            is_outside: (x[i] - centre_s).abs() > limit_s,
            is_odd: found.outliers.binary_search(&i).is_ok(),
        }
    };
    (newest..rows.len()).map(point).collect()
}

/// Other properties that most flights after a change have and most flights before it did not.
fn with_it(before: &[&Brief], after: &[&Brief]) -> Vec<String> {
    type Fact = fn(&Brief) -> Option<String>;
    let facts: [(&str, Fact); 10] = [
        ("airframe", |row| row.of(Dimension::Airframe)),
        ("serial", |row| row.of(Dimension::Serial)),
        ("receiver", |row| row.of(Dimension::Receiver)),
        ("firmware", |row| row.of(Dimension::Firmware)),
        ("rate", |row| row.of(Dimension::Rate)),
        ("baud", |row| row.of(Dimension::Baud)),
        ("autopilot firmware", |row| row.system_firmware.as_deref().map(str::to_owned)),
        ("settings", |row| row.settings_hash.get(..8).map(str::to_owned)),
        ("analysis", |row| Some(row.analysis_version.to_string())),
        ("build", |row| Some(row.build.to_string())),
    ];
    let changed = |(name, of): &(&str, Fact)| {
        let (was, is) = (most_frequent(before, *of), most_frequent(after, *of));
        let word = |value: Option<String>| value.unwrap_or_else(|| "unknown".to_owned());
        (was != is).then(|| format!("{name}: {} → {}", word(was), word(is)))
    };
    facts.iter().filter_map(changed).collect()
}

fn most_frequent(rows: &[&Brief], of: fn(&Brief) -> Option<String>) -> Option<String> {
    let mut counts: BTreeMap<Option<String>, usize> = BTreeMap::new();
    rows.iter().for_each(|row| *counts.entry(of(row)).or_default() += 1);
    counts.into_iter().max_by_key(|(_, count)| *count).and_then(|(value, _)| value)
}

/// An instant as text, UTC.
pub(crate) fn instant(ns: i64) -> Option<String> {
    jiff::Timestamp::from_nanosecond(i128::from(ns)).ok().map(|at| at.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brief::latest_briefs;
    use crate::row::Row;

    const DAY_NS: i64 = 86_400_000_000_000;

    /// Forty flights a day apart; from the 24th on with another firmware and 20 ms later.
    fn fleet() -> Vec<Row> {
        let wiggle = [0.4, -1.1, 0.9, -0.3, 1.3, -0.8, 0.1, -0.6, 0.7, -0.2];
        let row = |n: usize| Row {
            campaign: "c".into(),
            flight: format!("{n:02}.bin"),
            flown_ns: Some(1_777_852_800_000_000_000 + n as i64 * DAY_NS),
            airframe: Some("uav-1".into()),
            serial: Some("D9-0412".into()),
            firmware: Some(if n < 24 { "3.01" } else { "4.04" }.into()),
            settings_hash: "0123456789".into(),
            datum: Some("imu".into()),
            lateness_s: Some(0.118 + if n < 24 { 0.0 } else { 0.020 } + 0.003 * wiggle[n % 10]),
            lateness_u_s: Some(0.003),
            ..Row::default()
        };
        (0..40).map(row).collect()
    }

    fn charts(rows: &[Row]) -> Trend {
        let briefs: Vec<Brief> = rows.iter().map(Brief::from).collect();
        trend(&latest_briefs(&briefs), &Dimension::ALL, Looks::Every, &|_, page| Some(page.to_owned()))
    }

    fn chart_of<'a>(trend: &'a Trend, dimension: &str) -> &'a TrendChart {
        trend.record.charts.iter().find(|chart| chart.dimension == dimension).unwrap()
    }

    #[test]
    fn a_firmware_update_is_a_change_by_serial_but_not_by_firmware() {
        let found = charts(&fleet());
        let serial = chart_of(&found, "serial");
        assert_eq!(serial.changes.len(), 1);
        let change = &serial.changes[0];
        assert_eq!(change.at.flight, "24.bin");
        assert!((change.step_s.value - 0.020).abs() < 2.0 * change.step_s.standard_uncertainty.unwrap());
        assert_eq!(change.with_it, ["firmware: 3.01 → 4.04"]);
        assert_eq!(serial.segments.iter().map(|s| s.flights).collect::<Vec<_>>(), [24, 16]);
        let of_firmware = found.record.charts.iter().filter(|chart| chart.dimension == "firmware");
        assert_eq!(of_firmware.clone().count(), 2);
        assert!(of_firmware.clone().all(|chart| chart.changes.is_empty()));
        assert!(serial.points.iter().all(|point| !point.is_outside));
        assert_eq!(found.record.left_out, ["40 without baud", "40 without rate", "40 without receiver"]);
    }

    #[test]
    fn the_shared_error_is_in_the_mean_but_not_in_the_step() {
        let flights =
            |model_u_s: f64| fleet().into_iter().map(move |row| Row { lateness_model_u_s: Some(model_u_s), ..row });
        let [none, most] = [0.0, 0.0029].map(|model| charts(&flights(model).collect::<Vec<Row>>()));
        let [none, most] = [&none, &most].map(|found| chart_of(found, "serial"));
        assert_eq!(none.changes, most.changes);
        let u = |chart: &TrendChart| chart.segments[0].mean_s.standard_uncertainty.unwrap();
        assert!((u(none) - 0.003 / 24f64.sqrt()).abs() < 0.2e-3, "{}", u(none));
        assert!((2.9e-3..3.0e-3).contains(&u(most)), "{}", u(most));
    }

    #[test]
    fn flights_are_in_the_order_of_their_dates_whatever_their_names_and_runs() {
        let points = |rows: Vec<Row>| {
            let found = charts(&rows);
            let chart = chart_of(&found, "serial");
            (chart.points.iter().map(|p| p.lateness_s.value).collect::<Vec<f64>>(), chart.changes.len())
        };
        let expected = points(fleet());
        let renamed = |dated: bool| {
            let row = |(n, row): (usize, Row)| Row {
                flight: format!("{:02}.bin", 39 - n),
                run_ns: if dated { -(n as i64) } else { 1 + n as i64 },
                flown_ns: row.flown_ns.filter(|_| dated),
                ..row
            };
            fleet().into_iter().enumerate().map(row).rev().collect::<Vec<Row>>()
        };
        assert_eq!(expected.1, 1);
        assert_eq!(points(renamed(true)), expected);
        assert_eq!(points(renamed(false)), expected, "without dates, in the order of their runs");
    }

    #[test]
    fn a_change_is_new_only_in_the_first_night_that_shows_it() {
        let rows = fleet();
        let nights: Vec<Trend> = (24..=30).map(|n| charts(&rows[..n])).collect();
        let new: Vec<usize> = nights.windows(2).map(|pair| new_changes(&pair[0], &pair[1]).len()).collect();
        // Airframe and serial; one each.
        assert_eq!(new.iter().sum::<usize>(), 2, "{new:?}");
        assert_eq!(new[..2], [0, 0], "two flights may be outliers, three are a change");
    }

    #[test]
    fn a_change_that_later_flights_do_not_support_is_withdrawn() {
        let rows = fleet();
        let night = charts(&rows[..30]);
        // The flights after the change are measured again, at the level before it.
        let mut again = rows[..30].to_vec();
        again.iter_mut().skip(24).for_each(|row| row.lateness_s = row.lateness_s.map(|late| late - 0.020));
        let next = charts(&again);
        let withdrawn = new_changes(&next, &night);
        assert_eq!(withdrawn.len(), 2, "{withdrawn:?}");
        assert_eq!(withdrawn[0].change.at.flight, "24.bin");
        assert!(new_changes(&night, &next).is_empty() && new_changes(&night, &night).is_empty());
    }

    #[test]
    fn another_datum_has_its_own_chart_and_copies_are_excluded() {
        let mut rows = fleet();
        rows.iter_mut().take(10).for_each(|row| row.datum = Some("reference".into()));
        rows[39].duplicate_of = Some("38.bin".into());
        rows[38].lateness_u_s = None;
        let found = charts(&rows);
        let sizes: Vec<usize> =
            found.record.charts.iter().filter(|c| c.dimension == "serial").map(|c| c.points.len()).collect();
        assert_eq!(sizes, [28, 10]);
        assert!(found.record.left_out.contains(&"1 copied from another flight".to_owned()));
        assert!(found.record.left_out.contains(&"1 without an uncertainty".to_owned()));
    }
}
