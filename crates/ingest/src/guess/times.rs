//! Which column of a table is the time, and what it counts.

use super::names::{Named, Role};
use crate::bind::stamps_by;
use crate::map::time_source_of;
use crate::table::{Table, numbers, texts};
use flight::{Clock, Unit};

/// Rates at which tables are written, as the steps between rows, s.
const STEPS_S: std::ops::RangeInclusive<f64> = 4e-4..=10.0;
/// Seconds since 1970 are within, 2001 to 2096.
const UNIX_S: std::ops::Range<f64> = 1e9..4e9;
/// Units that a number may count where nothing says so.
const UNITS: [(&str, f64); 4] = [("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)];

/// A way to read the time of a table.
#[derive(Debug, Clone)]
pub(super) struct Timing {
    /// As a map writes it.
    pub(super) entry: String,
    /// `measured` or `logged`.
    pub(super) kind: &'static str,
    pub(super) clock: Clock,
    /// Of each row, s.
    pub(super) times_s: Vec<Option<f64>>,
    /// Why it is taken so.
    pub(super) why: String,
    /// The table states its unit, or its size does.
    pub(super) is_certain: bool,
}

/// The ways to read the time of a table, of the first column that is one; several where its unit is not known.
pub(super) fn timings(table: &Table, columns: &[Named]) -> Vec<Timing> {
    let of_role = |role: Role| columns.iter().filter(move |c| c.role == role);
    for week in of_role(Role::Week) {
        for time in
            of_role(Role::Time).filter(|c| c.words.iter().any(|w| w.contains("tow") || w == "time" || w == "seconds"))
        {
            let found = of_week(table, week, time);
            if found.is_some() {
                return found.into_iter().collect();
            }
        }
    }
    let date = of_role(Role::Time).find(|c| c.words == ["date"] && texts(table, &c.path).is_some());
    if let Some(date) = date {
        let times = of_role(Role::Time).filter(|c| c.path != date.path);
        let both = times.filter_map(|time| {
            let entry = format!("{{ date = {}, time = {} }}", super::quoted(&date.path), super::quoted(&time.path));
            timing(table, entry, "measured", "a column of dates and one of times".into(), true)
        });
        if let Some(found) = both.into_iter().next() {
            return vec![found];
        }
    }
    of_role(Role::Time).map(|column| of_column(table, column)).find(|found| !found.is_empty()).unwrap_or_default()
}

fn kind_of(column: &Named) -> &'static str {
    let of_receiver =
        |word: &String| ["gps", "gnss", "utc", "tow", "itow", "gpstime", "utctime"].contains(&word.as_str());
    if column.words.iter().any(of_receiver) { "measured" } else { "logged" }
}

fn of_week(table: &Table, week: &Named, time: &Named) -> Option<Timing> {
    let values = numbers(table, &time.path)?;
    let most = (0..table.rows).filter_map(|row| values.number(row)).fold(0.0, f64::max);
    let unit = time.unit.map_or(if most > 604_800.0 { "ms" } else { "s" }, Unit::symbol);
    let (week, field) = (super::quoted(&week.path), super::quoted(&time.path));
    timing(
        table,
        format!("{{ week = {week}, field = {field}, unit = \"{unit}\" }}"),
        "measured",
        "a GPS week and the time in it".into(),
        true,
    )
}

fn of_column(table: &Table, column: &Named) -> Vec<Timing> {
    let field = super::quoted(&column.path);
    if numbers(table, &column.path).is_none() {
        let texts = ["iso-8601", "time-of-day", "day-of-year"].into_iter().filter_map(|text| {
            let why = format!("its text is {text}");
            timing(table, format!("{{ field = {field}, text = \"{text}\" }}"), kind_of(column), why, true)
        });
        return texts.into_iter().next().into_iter().collect();
    }
    let Some((middle, step)) = middles(table, column) else { return vec![] };
    let gps = column.words.iter().any(|word| word.contains("gps"));
    let of_unit = |(unit, scale): (&str, f64), why: &str, is_certain: bool| {
        let clock = match UNIX_S.contains(&(middle * scale)) {
            true if gps => "gps",
            true => "unix",
            false => "elapsed",
        };
        let entry = format!("{{ field = {field}, unit = \"{unit}\", clock = \"{clock}\" }}");
        timing(table, entry, kind_of(column), format!("{why}, clock {clock}"), is_certain)
    };
    if let Some(unit) = column.unit {
        let found = of_unit((unit.symbol(), unit.to_si(1.0)), "the table states its unit", true);
        return found.into_iter().collect();
    }
    if let Some(unit) = UNITS.into_iter().find(|(_, scale)| UNIX_S.contains(&(middle * scale)) && step * scale < 1e3) {
        return of_unit(unit, &format!("its size says {} since 1970 or 1980", unit.0), true).into_iter().collect();
    }
    let plausible = UNITS.into_iter().filter(|(_, scale)| STEPS_S.contains(&(step * scale)));
    let mut found: Vec<Timing> =
        plausible.filter_map(|unit| of_unit(unit, &format!("its steps are those of {}", unit.0), false)).collect();
    let is_only = found.len() == 1;
    found.iter_mut().for_each(|timing| timing.is_certain = is_only);
    found
}

/// The value and the step in the middle of all.
fn middles(table: &Table, column: &Named) -> Option<(f64, f64)> {
    let values = numbers(table, &column.path)?;
    let mut all: Vec<f64> = (0..table.rows).filter_map(|row| values.number(row)).collect();
    let mut steps: Vec<f64> =
        all.iter().zip(all.iter().skip(1)).map(|(a, b)| b - a).filter(|step| *step > 0.0).collect();
    all.sort_by(f64::total_cmp);
    steps.sort_by(f64::total_cmp);
    Some((*all.get(all.len() / 2)?, *steps.get(steps.len() / 2)?))
}

/// Stamps that nine rows of ten have, and that go on in as many.
fn timing(table: &Table, entry: String, kind: &'static str, why: String, is_certain: bool) -> Option<Timing> {
    let source = time_source_of(&entry)?;
    let (clock, nanos) = stamps_by(&source, table)?;
    let first = nanos.iter().flatten().next().copied()?;
    let times: Vec<i64> = nanos.iter().flatten().copied().collect();
    let goes_on = times.iter().zip(times.iter().skip(1)).filter(|(a, b)| b >= a).count();
    let moves = times.iter().any(|t| *t != first);
    let most = |count: usize| 10 * count >= 9 * table.rows.saturating_sub(1);
    let is_time = moves && most(times.len()) && most(goes_on);
    let times_s = nanos.iter().map(|ns| ns.map(|ns| ns as f64 * 1e-9)).collect();
    is_time.then_some(Timing { entry, kind, clock, times_s, why, is_certain })
}
