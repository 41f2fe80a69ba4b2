//! Infers which column of a table is the time, and its unit.

use super::names::{Named, Role};
use super::write::with_unit;
use binding::stamps_by;
use flight::{Clock, Unit};
use formats::Table;
use std::rc::Rc;

/// Steps between rows at plausible logging rates, s.
const STEPS_S: std::ops::RangeInclusive<f64> = 4e-4..=10.0;
/// The plausible range of seconds since 1970, 2001 to 2096.
const UNIX_S: std::ops::Range<f64> = 1e9..4e9;
/// Possible units of a number where no unit is stated.
const UNITS: [(&str, f64); 4] = [("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)];

/// Words of a time next to a week.
const OF_WEEK: &[&str] = &["time", "seconds", "sec", "secs", "sow"];

/// Units that are read only where the table states them, as in a map, and their seconds.
const STATED_UNITS: [(&[&str], (&str, f64)); 2] =
    [(&["min", "minute", "minutes"], ("min", 60.0)), (&["h", "hr", "hour", "hours"], ("h", 3600.0))];

/// A reading of the time of a table.
#[derive(Debug, Clone)]
pub(super) struct Timing {
    /// As written in a map.
    pub(super) entry: String,
    /// `measured` or `logged`.
    pub(super) kind: &'static str,
    pub(super) clock: Clock,
    /// For each row, s; NaN for a row without. Tables may be long: all users share it.
    pub(super) times_s: Rc<[f64]>,
    /// For the user: `time [s], clock elapsed`.
    pub(super) label: String,
    /// The reason for this reading.
    pub(super) why: String,
    /// The unit is stated or follows from the size.
    pub(super) is_certain: bool,
}

/// The possible readings of the time of a table, from the first column that is a time; several where its unit is
/// unknown.
pub(super) fn timings(table: &Table, columns: &[Named]) -> Vec<Timing> {
    let of_role = |role: Role| columns.iter().filter(move |c| c.role == role);
    for week in of_role(Role::Week) {
        for time in
            of_role(Role::Time).filter(|c| c.words.iter().any(|w| w.contains("tow") || OF_WEEK.contains(&w.as_str())))
        {
            let found = of_week(table, week, time);
            if found.is_some() {
                return found.into_iter().collect();
            }
        }
    }
    let date = of_role(Role::Time).find(|c| c.words == ["date"] && table.texts(&c.path).is_some());
    if let Some(date) = date {
        let times = of_role(Role::Time).filter(|c| c.path != date.path);
        let both = times.filter_map(|time| {
            let clock = if is_gps_time(time) { ", clock = \"gps\"" } else { "" };
            let entry = format!(
                "{{ date = {}, time = {}{clock} }}",
                super::names::quoted(&date.path),
                super::names::quoted(&time.path)
            );
            let by_name = if clock.is_empty() { "" } else { ", clock gps by its name" };
            let label = format!("{} and {}{by_name}", date.path, time.path);
            timing(table, (entry, label), "measured", "a column of dates and one of times".into(), true)
        });
        if let Some(found) = both.into_iter().next() {
            return vec![found];
        }
    }
    let mut readings = of_role(Role::Time).map(|column| of_column(table, column)).filter(|found| !found.is_empty());
    let Some(first) = readings.next() else { return vec![] };
    if first.iter().any(|timing| repeats(timing) && columns.iter().any(|column| moves_within(table, timing, column))) {
        // Where values change while the time does not, only a finer time gives when each was taken.
        return readings.find(|other| !other.iter().any(repeats)).map_or(first, finer);
    }
    first
}

/// Whether a position or velocity column changes in most rows that repeat the time of the row before.
fn moves_within(table: &Table, timing: &Timing, column: &Named) -> bool {
    let is_time = matches!(column.role, Role::Time | Role::Week);
    let Some(values) = table.numbers(&column.path).filter(|_| !is_time) else { return false };
    let again = timing.times_s.iter().zip(timing.times_s.iter().skip(1)).enumerate().filter(|(_, (a, b))| a == b);
    let changes = |row: usize| values.number(row).zip(values.number(row + 1)).is_some_and(|(a, b)| a != b);
    let (all, changed) = again.fold((0, 0), |(all, changed), (row, _)| (all + 1, changed + usize::from(changes(row))));
    2 * changed > all
}

/// Whether at least every second row repeats the time of the one before.
pub(super) fn repeats(timing: &Timing) -> bool {
    let again = timing.times_s.iter().zip(timing.times_s.iter().skip(1)).filter(|(a, b)| a == b).count();
    2 * again >= timing.times_s.len()
}

fn finer(readings: Vec<Timing>) -> Vec<Timing> {
    let with_why = |reading: Timing| Timing {
        why: format!("{}; the time column before it repeats while the values change", reading.why),
        ..reading
    };
    readings.into_iter().map(with_why).collect()
}

fn kind_of(column: &Named) -> &'static str {
    let of_receiver =
        |word: &String| ["gps", "gnss", "utc", "tow", "itow", "gpstime", "utctime"].contains(&word.as_str());
    if column.words.iter().any(of_receiver) { "measured" } else { "logged" }
}

fn of_week(table: &Table, week: &Named, time: &Named) -> Option<Timing> {
    let values = table.numbers(&time.path)?;
    let most = (0..table.rows).filter_map(|row| values.number(row)).fold(0.0, f64::max);
    let unit = time.unit.map_or(if most > 604_800.0 { "ms" } else { "s" }, Unit::symbol);
    let label = format!("{} and {} [{unit}], clock gps", week.path, time.path);
    let (week, field) = (super::names::quoted(&week.path), super::names::quoted(&time.path));
    timing(
        table,
        (format!("{{ week = {week}, field = {field}, unit = \"{unit}\" }}"), label),
        "measured",
        "a GPS week and the time in it".into(),
        true,
    )
}

fn of_column(table: &Table, column: &Named) -> Vec<Timing> {
    if table.numbers(&column.path).is_none() {
        // A zone in the text makes it UTC.
        if let Some(found) = of_gps_text(table, column) {
            return vec![found];
        }
        return of_text(table, column, &["iso-8601", "time-of-day", "day-of-year"]).into_iter().collect();
    }
    if column.unit.is_none() && is_hours_minutes_seconds(table, column) {
        return of_text(table, column, &["time-of-day"]).into_iter().collect();
    }
    middles(table, column).map_or(vec![], |values| of_numbers(table, column, values))
}

/// The possible readings of a column of numbers with this median value and this median step.
fn of_numbers(table: &Table, column: &Named, (middle, step): (f64, f64)) -> Vec<Timing> {
    let field = super::names::quoted(&column.path);
    let gps = column.words.iter().any(|word| word.contains("gps"));
    let of_unit = |(unit, scale): (&str, f64), why: &str, is_certain: bool| {
        let clock = match UNIX_S.contains(&(middle * scale)) {
            true if gps => "gps",
            true => "unix",
            false => "elapsed",
        };
        let entry = format!("{{ field = {field}, unit = \"{unit}\", clock = \"{clock}\" }}");
        let label = format!("{}, clock {clock}", with_unit(&column.path, unit));
        timing(table, (entry, label), kind_of(column), format!("{why}, clock {clock}"), is_certain)
    };
    if let Some(unit) = column.unit {
        let found = of_unit((unit.symbol(), unit.to_si(1.0)), "the table states its unit", true);
        return found.into_iter().collect();
    }
    if let Some(unit) = column.odd_unit.as_deref().and_then(stated_unit) {
        return of_unit(unit, "the table states its unit", true).into_iter().collect();
    }
    if let Some(unit) = UNITS.into_iter().find(|(_, scale)| UNIX_S.contains(&(middle * scale)) && step * scale < 1e3) {
        return of_unit(unit, &format!("by its size it counts {} since 1970 or 1980", unit.0), true)
            .into_iter()
            .collect();
    }
    let plausible = UNITS.into_iter().filter(|(_, scale)| STEPS_S.contains(&(step * scale)));
    let mut found: Vec<Timing> =
        plausible.filter_map(|unit| of_unit(unit, &format!("its steps are those of {}", unit.0), false)).collect();
    let is_only = found.len() == 1;
    found.iter_mut().for_each(|timing| timing.is_certain = is_only);
    found
}

fn stated_unit(stated: &str) -> Option<(&'static str, f64)> {
    let word = stated.trim_matches(|c: char| !c.is_alphanumeric()).to_lowercase();
    STATED_UNITS.into_iter().find(|(words, _)| words.contains(&word.as_str())).map(|(_, unit)| unit)
}

/// Whether numbers are times as `hhmmss`: no minute and no second reaches 60, and at the end of a minute they jump to
/// the next hundred.
fn is_hours_minutes_seconds(table: &Table, column: &Named) -> bool {
    const MINUTE: f64 = 100.0;
    let Some(values) = table.numbers(&column.path) else { return false };
    let all = || (0..table.rows).filter_map(|row| values.number(row));
    let fits = |x: f64| (0.0..240_000.0).contains(&x) && x % MINUTE < 60.0 && (x / MINUTE) % MINUTE < 60.0;
    let ends = || all().zip(all().skip(1)).filter(|(a, b)| (a / MINUTE).floor() < (b / MINUTE).floor());
    let jumps = |(a, b): (f64, f64)| b - a > 40.0 && b % MINUTE < a % MINUTE;
    ends().next().is_some() && all().all(fits) && ends().all(jumps)
}

/// Whether a column is called GPS time, which is ahead of UTC by the leap seconds.
fn is_gps_time(column: &Named) -> bool {
    let has = |any: &[&str]| column.words.iter().any(|word| any.contains(&word.as_str()));
    (has(&["gpst", "gpstime"]) || has(&["gps", "gnss"]) && has(&["time"])) && !has(&["utc", "gmt"])
}

/// A date as text, in a column that is called GPS time.
fn of_gps_text(table: &Table, column: &Named) -> Option<Timing> {
    if !is_gps_time(column) {
        return None;
    }
    let field = super::names::quoted(&column.path);
    let entry = format!("{{ field = {field}, text = \"iso-8601\", clock = \"gps\" }}");
    let label = format!("{} as iso-8601, clock gps by its name", column.path);
    let why = "its text is iso-8601, and by its name it is GPS time, without leap seconds; if it is UTC, remove the \
        clock";
    timing(table, (entry, label), "measured", why.to_owned(), true)
}

fn of_text(table: &Table, column: &Named, texts: &[&str]) -> Option<Timing> {
    let field = super::names::quoted(&column.path);
    texts.iter().find_map(|text| {
        let why = format!("its text is {text}");
        let label = format!("{} as {text}", column.path);
        timing(table, (format!("{{ field = {field}, text = \"{text}\" }}"), label), kind_of(column), why, true)
    })
}

/// The median value and the median step.
fn middles(table: &Table, column: &Named) -> Option<(f64, f64)> {
    let values = table.numbers(&column.path)?;
    let all = || (0..table.rows).filter_map(|row| values.number(row));
    // One after the other: one copy of the column in memory is enough.
    let step = middle(all().zip(all().skip(1)).map(|(a, b)| b - a).filter(|step| *step > 0.0).collect())?;
    Some((middle(all().collect())?, step))
}

/// The median, the upper one of two; `None` without any value.
pub(super) fn middle(mut values: Vec<f64>) -> Option<f64> {
    let half = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(half, f64::total_cmp).1)
}

/// Timestamps that nine of ten rows have, and that increase in as many.
fn timing(
    table: &Table,
    (entry, label): (String, String),
    kind: &'static str,
    why: String,
    is_certain: bool,
) -> Option<Timing> {
    let (clock, nanos) = stamps_by(&entry, table)?;
    let first = nanos.given().next()?;
    let times = || nanos.given();
    let goes_on = times().zip(times().skip(1)).filter(|(a, b)| b >= a).count();
    let moves = times().any(|t| t != first);
    let most = |count: usize| 10 * count >= 9 * table.rows.saturating_sub(1);
    let is_time = moves && most(times().count()) && most(goes_on);
    let times_s = nanos.iter().map(|ns| ns.map_or(f64::NAN, |ns| ns as f64 * 1e-9)).collect();
    is_time.then_some(Timing { entry, kind, clock, times_s, label, why, is_certain })
}

/// Words in brackets or in a line of units that name the clock of a time and are not a unit.
const CLOCKS: &[&str] =
    &["utc", "gps", "gpst", "gnss", "unix", "posix", "epoch", "tai", "local", "boot", "iso", "hh", "h"];

/// The message for a table whose first time has an unknown unit.
pub(super) fn unknown_unit(table: &Table, columns: &[Named]) -> Option<String> {
    let times = columns.iter().filter(|column| column.role == Role::Time);
    let first = times.into_iter().find(|column| !of_column(table, column).is_empty())?;
    let stated = first.odd_unit.as_ref()?;
    let is_clock = stated.to_lowercase().split(|c: char| !c.is_alphanumeric()).any(|word| CLOCKS.contains(&word));
    let is_known = is_clock || stated_unit(stated).is_some();
    (!is_known && table.numbers(&first.path).is_some()).then(|| {
        format!(
            "the table states the unit {stated:?} for the time {}, which flightlag does not know as a unit of time",
            first.path
        )
    })
}

/// A step back of this many usual steps is more than disorder.
const DEEP_STEPS: f64 = 4.0;

/// Where a time goes back, as it does where a second recording begins.
pub(super) fn goes_back(table: &Table, timing: &Timing) -> Option<String> {
    let given = || timing.times_s.iter().copied().enumerate().filter(|(_, time_s)| time_s.is_finite());
    let steps = || given().zip(given().skip(1)).map(|((_, before), (row, now))| (row, now - before));
    let usual = middle(steps().map(|(_, step)| step).filter(|step| *step > 0.0).collect())?;
    let (row, step) = steps().find(|(_, step)| *step < -DEEP_STEPS * usual)?;
    let (label, line) = (&timing.label, table.origin_of(row));
    Some(format!(
        "the time ({label}) goes back by {:.3} s at line {line}: if another recording begins there, put it into a file \
         of its own",
        -step
    ))
}

/// How a map reads the times that a guess does not.
const OTHER_TIMES: &str = "a channel map reads serial days and dates in another order, see `flightlag maps wide-csv`";

/// Why the time of a table cannot be read; `None` if no column is named like one, and for a table of one row, where no
/// time increases.
pub(super) fn unreadable(table: &Table, names: &[String], columns: &[Named]) -> Option<String> {
    if table.rows < 2 {
        return None;
    }
    let topic = &table.topic.name;
    if let [minute, second] = parts_of_time(table, names)[..] {
        return Some(format!(
            "the time of {topic} is written in several columns, {minute} and {second} among them: write one column as \
             h:mm:ss.sss, or read year to second as a calendar in a channel map, see `flightlag maps wide-csv`"
        ));
    }
    let first = columns.iter().find(|column| column.role == Role::Time)?;
    let text = |row| {
        let cell = table.texts(&first.path).and_then(|values| values.text(row).map(|text| text.trim().to_owned()));
        cell.or_else(|| table.numbers(&first.path)?.number(row).map(|number| number.to_string()))
    };
    let cell = |row: &usize| text(*row).filter(|text| !text.is_empty());
    let missing = table.rows - (0..table.rows).filter(|row| cell(row).is_some()).count();
    if 10 * missing > table.rows && missing < table.rows {
        return Some(format!(
            "{missing} of the {} cells of the time {} of {topic} are empty: give every row a time, or leave out the rows \
             without one",
            table.rows, first.path
        ));
    }
    if let Some(line) = out_of_order(table, first) {
        return Some(format!(
            "the times {} of {topic} are not in order at line {line}: sort the rows by time",
            first.path
        ));
    }
    let cell = (0..table.rows).find_map(|row| cell(&row))?;
    Some(format!(
        "the time {} of {topic} begins with {cell:?}, which cannot be read; a time must be ISO 8601, h:mm:ss of 24 \
         hours, the day of a year, or a rising number of s, ms, us or ns; {OTHER_TIMES}",
        first.path
    ))
}

/// The line of the first number that is less than the one before, if more than a tenth of them are.
fn out_of_order(table: &Table, column: &Named) -> Option<u64> {
    let values = table.numbers(&column.path)?;
    let given = || (0..table.rows).filter_map(|row| Some((row, values.number(row)?)));
    let mut back = given().zip(given().skip(1)).filter(|((_, before), (_, now))| now < before).map(|(_, (row, _))| row);
    let first = back.next()?;
    (10 * (1 + back.count()) > table.rows).then(|| table.origin_of(first))
}

/// The columns of minutes and of seconds below 60, if the time is written in several columns.
pub(super) fn parts_of_time<'n>(table: &Table, names: &'n [String]) -> Vec<&'n str> {
    let called = |any: [&str; 4]| names.iter().find(|name| any.contains(&name.trim().to_lowercase().as_str()));
    let minute = called(["minute", "minutes", "min", "mm"]);
    let is_part = |path: &&String| {
        table.numbers(path).is_none_or(|v| (0..table.rows).filter_map(|row| v.number(row)).all(|s| s <= 60.0))
    };
    let second = called(["second", "seconds", "sec", "ss"]).filter(is_part);
    minute.zip(second).map_or(vec![], |(minute, second)| vec![minute, second])
}

/// The most columns that are tried as the time if none is named like one.
const MOST_RISING: usize = 4;
/// A time increases in this percentage of rows, and most of its steps are similar.
const RISES: usize = 99;
/// Steps within this factor of the median are similar.
const ALIKE: f64 = 3.0;

/// The possible readings of the time where no column is named like one: from the columns that rise steadily.
pub(super) fn by_rise(table: &Table, names: &[String], taken: &[Named]) -> Vec<Timing> {
    let is_free = |path: &&String| !taken.iter().any(|column| column.path == **path);
    let rising = names.iter().filter(is_free).filter(|path| table.numbers(path).is_none() || rises(table, path));
    let readings =
        rising.map(|path| of_column(table, &Named::with_role(path, Role::Time))).filter(|all| !all.is_empty());
    readings.take(MOST_RISING).flatten().map(unnamed).collect()
}

fn unnamed(timing: Timing) -> Timing {
    Timing {
        label: format!("{} (no column is named like a time; this one rises steadily)", timing.label),
        why: format!("no column is named like a time, and this one rises steadily; {}; confirm it", timing.why),
        is_certain: false,
        ..timing
    }
}

/// Whether a column rises in nearly all rows, in similar steps.
fn rises(table: &Table, path: &str) -> bool {
    let Some(values) = table.numbers(path) else { return false };
    let all: Vec<f64> = (0..table.rows).filter_map(|row| values.number(row)).collect();
    let mut steps: Vec<f64> = all.iter().zip(all.iter().skip(1)).map(|(a, b)| b - a).collect();
    let goes_on = steps.iter().filter(|step| **step >= 0.0).count();
    steps.retain(|step| *step > 0.0);
    steps.sort_by(f64::total_cmp);
    let Some(middle) = steps.get(steps.len() / 2).copied() else { return false };
    let alike = steps.iter().filter(|step| (middle / ALIKE..=middle * ALIKE).contains(*step)).count();
    let most = |count: usize, of: usize| 100 * count >= RISES * of;
    most(all.len(), table.rows) && most(goes_on, all.len().saturating_sub(1)) && 10 * alike >= 9 * steps.len()
}
