//! Parses time written as text or as a number, to integer nanoseconds. Never uses the machine's time zone.

use jiff::civil::{Date, DateTime, ISOWeekDate, Time, Weekday};
use jiff::tz::Offset;
use std::ops::Deref;

/// A unit of time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub enum Tick {
    /// Days.
    #[serde(rename = "d")]
    Days,
    /// Hours.
    #[serde(rename = "h")]
    Hours,
    /// Minutes.
    #[serde(rename = "min")]
    Minutes,
    /// Seconds.
    #[serde(rename = "s")]
    Seconds,
    /// Milliseconds.
    #[serde(rename = "ms")]
    Millis,
    /// 100 microseconds.
    #[serde(rename = "100us")]
    TenthMillis,
    /// Microseconds.
    #[serde(rename = "us")]
    Micros,
    /// Nanoseconds.
    #[serde(rename = "ns")]
    Nanos,
}

/// Order of day, month and year in a date.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum DateOrder {
    /// `23/06/2021`.
    DayMonthYear,
    /// `06/23/2021`.
    MonthDayYear,
    /// `21/06/23`.
    YearMonthDay,
}

impl Tick {
    /// Nanoseconds in one tick.
    pub fn nanos(self) -> i64 {
        match self {
            Tick::Days => 86_400_000_000_000,
            Tick::Hours => 3_600_000_000_000,
            Tick::Minutes => 60_000_000_000,
            Tick::Seconds => 1_000_000_000,
            Tick::Millis => 1_000_000,
            Tick::TenthMillis => 100_000,
            Tick::Micros => 1_000,
            Tick::Nanos => 1,
        }
    }

    /// Nanoseconds of a decimal number as text. Plain decimals are exact to the nanosecond; digits past it are rounded.
    /// Others, such as `1.5e9`, go through a double.
    pub fn of_text(self, text: &str) -> Option<i64> {
        self.text_since(text, 0)
    }

    /// Nanoseconds of an exact number of ticks since an instant `zero_s` seconds after the zero of the result; `None`
    /// outside the range of `i64`.
    pub fn integer_since(self, ticks: i64, zero_s: i64) -> Option<i64> {
        since(self.wide(ticks), zero_s)
    }

    /// Nanoseconds of a double of ticks since such an instant; `None` outside the range of `i64`. Only its fraction is
    /// rounded: a double of all the nanoseconds since 1970 would be a multiple of 256.
    pub fn float_since(self, ticks: f64, zero_s: i64) -> Option<i64> {
        since(self.wide_of_float(ticks)?, zero_s)
    }

    /// As [`Tick::of_text`], for ticks since such an instant.
    pub fn text_since(self, text: &str, zero_s: i64) -> Option<i64> {
        let float = || self.wide_of_float(text.parse().ok().filter(|t: &f64| t.is_finite())?);
        since(self.wide_of_decimal(text).or_else(float)?, zero_s)
    }

    fn wide(self, ticks: i64) -> i128 {
        i128::from(ticks) * i128::from(self.nanos())
    }

    fn wide_of_float(self, ticks: f64) -> Option<i128> {
        let whole = Some(ticks.trunc()).filter(|whole| whole.abs() < 9.2e18)?;
        Some(self.wide(whole as i64) + ((ticks - whole) * self.nanos() as f64).round() as i128)
    }

    fn wide_of_decimal(self, text: &str) -> Option<i128> {
        let (negative, digits) = match text.strip_prefix('-') {
            Some(rest) => (true, rest),
            None => (false, text.strip_prefix('+').unwrap_or(text)),
        };
        let (whole, fraction) = digits.split_once('.').unwrap_or((digits, ""));
        let whole: i64 = if whole.is_empty() && !fraction.is_empty() { 0 } else { unsigned(whole)? };
        let nanos = self.wide(whole) + i128::from(fraction_of(fraction, self.nanos())?);
        Some(if negative { -nanos } else { nanos })
    }
}

/// Nanoseconds counted from `zero_s` seconds after the zero of the result.
fn since(nanos: i128, zero_s: i64) -> Option<i64> {
    i64::try_from(nanos + i128::from(zero_s) * 1_000_000_000).ok()
}

/// Digits only, at least one.
fn unsigned(digits: &str) -> Option<i64> {
    (!digits.is_empty() && digits.bytes().all(|b| b.is_ascii_digit())).then(|| digits.parse().ok())?
}

/// `0.fraction` of `unit`, rounded to the nearest integer.
fn fraction_of(fraction: &str, unit: i64) -> Option<i64> {
    if fraction.is_empty() {
        return Some(0);
    }
    // Eighteen digits of any unit up to a day fit into an i128, and more are not significant.
    let digits = fraction.get(..fraction.len().min(18))?;
    let scale = 10_i128.pow(u32::try_from(digits.len()).ok()?);
    if !fraction.bytes().all(|b| b.is_ascii_digit()) {
        return None;
    }
    let scaled = i128::from(unsigned(digits)?) * i128::from(unit);
    i64::try_from((2 * scaled + scale) / (2 * scale)).ok()
}

/// Nanoseconds since 1970 of an ISO 8601 instant, such as `2024-05-10T17:27:44.30Z`, `2024-05-10 17:27:44.3+02:00`, or
/// without a zone, which then means UTC. Also with another date in a certain order: `2024/05/10`, or `10.05.2024`,
/// because dots are used only with the day first.
pub(crate) fn iso_to_unix_ns(text: &str) -> Option<i64> {
    local_to_unix_ns(text, "Z")
}

/// An ISO 8601 instant in ns of UTC; one without a zone has the given offset from UTC. The date may also be
/// `2024/05/10` or `10.05.2024`.
pub fn local_to_unix_ns(text: &str, offset: &str) -> Option<i64> {
    let text = text.trim();
    let at = break_of(text)?;
    let (date, time) = (text.get(..at)?, text.get(at + 1..)?);
    if matches!(date.len(), 7 | 8) && unsigned(date).is_some() && text.get(at..=at) != Some(" ") {
        let (hour, minute, second) = (time.get(..2)?, time.get(2..4)?, time.get(4..)?);
        return unix_ns(plain_date(date)?, &format!("{hour}:{minute}:{second}"), offset);
    }
    let has_points = date.rsplit_once('.').is_some_and(|(_, year)| year.len() == 4);
    let with_points = || Some(date).filter(|_| has_points).and_then(|date| DateOrder::DayMonthYear.date(date));
    unix_ns(plain_date(date).or_else(with_points)?, time, offset)
}

/// The position of the `T` or space between the date and the time of an instant.
fn break_of(text: &str) -> Option<usize> {
    let digit = |at: usize| text.as_bytes().get(at).is_some_and(u8::is_ascii_digit);
    let mut breaks = text.match_indices(['T', 't', ' ']).map(|(at, _)| at);
    breaks.find(|at| *at > 0 && digit(at - 1) && digit(at + 1))
}

/// Whether an instant states its zone.
pub fn says_zone(text: &str) -> bool {
    let text = text.trim();
    zone_at(text.get(break_of(text).map_or(0, |at| at + 1)..).unwrap_or_default()).is_some()
}

/// Where the zone after a time of day begins.
fn zone_at(time: &str) -> Option<usize> {
    time.find(['Z', 'z', '+', '-', 'U', 'G'])
}

/// Nanoseconds since 1970 of a date, a time of day `hh:mm:ss[.fff]`, optionally followed by `AM` or `PM`, and an offset
/// `+hh:mm`, `Z`, `UTC` or `GMT`. An offset after the time takes precedence.
pub fn unix_ns(date: Date, time: &str, offset: &str) -> Option<i64> {
    let (time, own) = time.split_at_checked(zone_at(time).unwrap_or(time.len()))?;
    let offset = if own.is_empty() { offset } else { own };
    let (time, nanos) = time_of_day(time.trim_end())?;
    let seconds =
        Offset::from_seconds(offset_seconds(offset)?).ok()?.to_timestamp(DateTime::from_parts(date, time)).ok()?;
    seconds.as_second().checked_mul(1_000_000_000)?.checked_add(nanos)
}

/// Nanoseconds since midnight of a time of day `hh:mm:ss[.fff]`, ignoring an offset after it.
pub fn since_midnight_ns(time: &str) -> Option<i64> {
    with_offset(time).map(|(nanos, _)| nanos)
}

/// The same, with the offset after it if there is one, ns east of UTC.
fn with_offset(time: &str) -> Option<(i64, Option<i64>)> {
    let time = time.trim();
    let (time, own) = time.split_at_checked(zone_at(time).unwrap_or(time.len()))?;
    let east_ns = match own {
        "" => None,
        own => Some(i64::from(Offset::from_seconds(offset_seconds(own)?).ok()?.seconds()) * 1_000_000_000),
    };
    let (time, nanos) = time_of_day(time.trim_end())?;
    let seconds = 3600 * i64::from(time.hour()) + 60 * i64::from(time.minute()) + i64::from(time.second());
    Some(((seconds * 1_000_000_000).checked_add(nanos)?, east_ns))
}

/// A time of day written as a number, `hhmmss[.fff]`, with colons; leading zeros may be missing. `None` if it has fewer
/// than four digits, which may not be a time of day, or is not a time of day.
pub fn with_colons(time: &str) -> Option<String> {
    let time = time.trim();
    let whole = time.bytes().take_while(u8::is_ascii_digit).count();
    let (digits, rest) = time.split_at_checked(whole).filter(|_| (1..=6).contains(&whole))?;
    let digits = format!("{digits:0>6}");
    let text = format!("{}:{}:{}{rest}", digits.get(..2)?, digits.get(2..4)?, digits.get(4..)?);
    (!rest.contains(':') && since_midnight_ns(&text).is_some()).then_some(text)
}

/// A day of a year and the time in it, as range time codes are written (IRIG 200 counts days like this):
/// `[yyyy:]ddd:hh:mm:ss[.ffffff]`. The colon before the hours may also be `-`, `/`, `T` or a space; an offset from UTC
/// may follow.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DayOfYear {
    /// If given.
    pub year: Option<i16>,
    /// From 1.
    pub day: i64,
    /// Since midnight.
    pub nanos: i64,
    /// Offset east of UTC, ns, if given.
    pub east_ns: Option<i64>,
}

impl DayOfYear {
    /// `None` if the text is not a day of a year.
    pub fn of_text(text: &str) -> Option<DayOfYear> {
        let (first, rest) = number_in_front(text.trim())?;
        let (year, day, time) = match (first.len(), rest) {
            (4, rest) => {
                let (day, time) = number_in_front(rest)?;
                (Some(i16::try_from(unsigned(first)?).ok()?), day, time)
            }
            (1..=3, rest) => (None, first, rest),
            _ => return None,
        };
        let days = year.map_or(Some(366), days_in)?;
        let day = unsigned(day).filter(|n| day.len() <= 3 && (1..=days).contains(n))?;
        // Without seconds it may as well be hours, minutes and seconds without a day.
        if time.matches(':').count() < 2 {
            return None;
        }
        let (nanos, east_ns) = with_offset(time)?;
        Some(DayOfYear { year, day, nanos, east_ns })
    }
}

/// Leading digits, and what follows the separator after them.
fn number_in_front(text: &str) -> Option<(&str, &str)> {
    let (digits, rest) = text.split_at_checked(text.bytes().take_while(u8::is_ascii_digit).count())?;
    Some((digits, rest.strip_prefix([':', '-', '/', ' ', 'T'])?))
}

/// The number of days in a year.
fn days_in(year: i16) -> Option<i64> {
    Some(i64::from(Date::new(year, 1, 1).ok()?.days_in_year()))
}

/// Nanoseconds since 1970 at the start of a year, UTC.
pub fn year_begin_unix_ns(year: i16) -> Option<i64> {
    unix_ns(Date::new(year, 1, 1).ok()?, "00:00", "Z")
}

/// Nanoseconds since 1970 of year, month, day, hour, minute, second and nanosecond, UTC.
pub fn calendar_to_unix_ns(parts: [i64; 6], nanos: i64) -> Option<i64> {
    let [year, month, day, hour, minute, second] = parts;
    let small = |v: i64| i8::try_from(v).ok();
    let (second, leap) = if second == 60 { (59, 1) } else { (second, 0) };
    let date = Date::new(i16::try_from(year).ok()?, small(month)?, small(day)?).ok()?;
    let time = Time::new(small(hour)?, small(minute)?, small(second)?, 0).ok()?;
    let instant = Offset::UTC.to_timestamp(DateTime::from_parts(date, time)).ok()?;
    instant.as_second().checked_add(leap)?.checked_mul(1_000_000_000)?.checked_add(nanos)
}

/// The whole second, and the fraction in ns, of `hh:mm[:ss[.fff]]` or `hh:mm:ss:fff`. A leap second counts as the
/// second after, as in Unix time.
fn time_of_day(text: &str) -> Option<(Time, i64)> {
    let (text, half) = half_of_day(text);
    let mut parts = text.split(':');
    let hour = parts.next()?;
    let hour = if hour.len() == 1 { i8::try_from(unsigned(hour)?).ok()? } else { two_digits(hour)? };
    let hour = match half {
        None => hour,
        Some(later) => Some(hour % 12 + later).filter(|_| (1..=12).contains(&hour))?,
    };
    let minute = two_digits(parts.next()?)?;
    let (second, fraction) = parts.next().map_or(("00", ""), |s| s.split_once('.').unwrap_or((s, "")));
    // After another colon, three digits are milliseconds; anything else is unknown.
    let fraction = match parts.next() {
        Some(millis) if millis.len() == 3 && fraction.is_empty() => millis,
        Some(_) => return None,
        None => fraction,
    };
    if parts.next().is_some() {
        return None;
    }
    let second = two_digits(second)?;
    let (second, leap) = if second == 60 { (59, 1_000_000_000) } else { (second, 0) };
    Some((Time::new(hour, minute, second, 0).ok()?, fraction_of(fraction, 1_000_000_000)? + leap))
}

/// The time without `AM` or `PM`, and the hours that they add.
fn half_of_day(text: &str) -> (&str, Option<i8>) {
    let Some((time, half)) = text.len().checked_sub(2).and_then(|at| text.split_at_checked(at)) else {
        return (text, None);
    };
    match half.to_ascii_lowercase().as_str() {
        "am" => (time.trim_end(), Some(0)),
        "pm" => (time.trim_end(), Some(12)),
        _ => (text, None),
    }
}

fn two_digits(text: &str) -> Option<i8> {
    (text.len() == 2).then(|| unsigned(text))?.and_then(|v| i8::try_from(v).ok())
}

/// `Z`, `UTC`, `GMT`, `+hh:mm`, `+hhmm` or `+hh`, in seconds east.
pub fn offset_seconds(text: &str) -> Option<i32> {
    if text.eq_ignore_ascii_case("Z") || ["UTC", "GMT"].contains(&text) {
        return Some(0);
    }
    let (sign, rest) = match text.strip_prefix('-') {
        Some(rest) => (-1, rest),
        None => (1, text.strip_prefix('+')?),
    };
    let digits = rest.replace(':', "");
    let hours = two_digits(digits.get(..2)?)?;
    let minutes = if digits.len() == 2 { 0 } else { two_digits(digits.get(2..)?)? };
    (minutes < 60).then_some(sign * (i32::from(hours) * 3600 + i32::from(minutes) * 60))
}

/// A date in a certain order: `yyyy-mm-dd`, `yyyy/mm/dd`, `yyyymmdd`, or with the month in English letters,
/// `dd-Mon-yyyy` or `dd Mon yyyy`; by the day of the year, `yyyy-ddd` or `yyyyddd`, or by the week, `yyyy-Www-d`.
pub fn plain_date(text: &str) -> Option<Date> {
    if let Some(date) = named_month(text).or_else(|| ordinal_date(text)).or_else(|| week_date(text)) {
        return Some(date);
    }
    if text.len() == 8 && text.bytes().all(|b| b.is_ascii_digit()) {
        let (year, rest) = text.split_at_checked(4)?;
        let (month, day) = rest.split_at_checked(2)?;
        return iso_date(&format!("{year}-{month}-{day}"));
    }
    iso_date(text).or_else(|| iso_date(&text.replace('/', "-")))
}

/// `yyyy-ddd` or `yyyyddd`.
fn ordinal_date(text: &str) -> Option<Date> {
    let (year, day) = text.split_at_checked(4)?;
    let day = day.strip_prefix('-').unwrap_or(day);
    let day = i16::try_from(unsigned(day).filter(|_| day.len() == 3)?).ok()?;
    Date::new(i16::try_from(unsigned(year)?).ok()?, 1, 1).ok()?.with().day_of_year(day).build().ok()
}

/// `yyyy-Www-d` or `yyyyWwwd`; 1 is Monday.
fn week_date(text: &str) -> Option<Date> {
    let (year, rest) = text.split_once('W')?;
    let year = year.strip_suffix('-').unwrap_or(year);
    let (week, day) = rest.split_at_checked(2)?;
    let day = day.strip_prefix('-').unwrap_or(day);
    let year = i16::try_from(unsigned(year).filter(|_| year.len() == 4)?).ok()?;
    let weekday = Weekday::from_monday_one_offset(i8::try_from(unsigned(day)?).ok()?).ok()?;
    Some(ISOWeekDate::new(year, two_digits(week)?, weekday).ok()?.date())
}

fn named_month(text: &str) -> Option<Date> {
    const MONTHS: [&str; 12] = ["jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec"];
    let mut parts = text.split(['-', ' ']);
    let (day, name, year) = (parts.next()?, parts.next()?.to_ascii_lowercase(), parts.next()?);
    let month = MONTHS.iter().position(|month| name == *month)? + 1;
    let day = if day.len() == 1 { i8::try_from(unsigned(day)?).ok()? } else { two_digits(day)? };
    let year = Some(year).filter(|year| year.len() == 4 && parts.next().is_none())?;
    Date::new(i16::try_from(unsigned(year)?).ok()?, i8::try_from(month).ok()?, day).ok()
}

/// `yyyy-mm-dd`.
fn iso_date(text: &str) -> Option<Date> {
    let mut parts = text.split('-');
    let year = parts.next().filter(|y| y.len() == 4)?;
    let (month, day) = (parts.next()?, parts.next()?);
    if parts.next().is_some() {
        return None;
    }
    Date::new(i16::try_from(unsigned(year)?).ok()?, two_digits(month)?, two_digits(day)?).ok()
}

/// For ambiguous dates: `05/06/2021`, `5-6-2021`, `05.06.21`, `050621`.
impl DateOrder {
    const ALL: [DateOrder; 3] = [DateOrder::DayMonthYear, DateOrder::MonthDayYear, DateOrder::YearMonthDay];

    /// What the date begins with.
    pub fn word(self) -> &'static str {
        match self {
            DateOrder::DayMonthYear => "day",
            DateOrder::MonthDayYear => "month",
            DateOrder::YearMonthDay => "year",
        }
    }

    /// The order that the dates of a whole column show, and the date that proves it; `None` if no date is ambiguous.
    /// Dots are used only with the day first.
    ///
    /// # Errors
    /// A date that stays ambiguous.
    pub fn shown_by<T: Deref<Target = str> + Default + Copy>(
        dates: impl Iterator<Item = T>,
    ) -> Result<Option<(DateOrder, T)>, T> {
        let (mut left, mut decisive, mut last) = (DateOrder::ALL.to_vec(), None, T::default());
        for text in dates {
            if *std::mem::replace(&mut last, text) == *text {
                continue;
            }
            let fits = |order: &DateOrder| {
                order.date(&text).is_some() && (*order == DateOrder::DayMonthYear || !text.contains('.'))
            };
            if DateOrder::ALL.iter().any(fits) {
                let before = left.len();
                left.retain(fits);
                let shows = left.len() < before || decisive.is_none();
                decisive = if shows { Some(text) } else { decisive };
            }
        }
        match (decisive, left.as_slice()) {
            (None, _) => Ok(None),
            (Some(text), [order]) => Ok(Some((*order, text))),
            (Some(text), _) => Err(text),
        }
    }

    /// The date, if it is an ambiguous one and has this order. Two-digit years are 1980 to 2079.
    pub fn date(self, text: &str) -> Option<Date> {
        if text.bytes().all(|b| b.is_ascii_digit()) {
            return self.of_digits(text);
        }
        let mut parts = text.split(text.chars().find(|c| matches!(c, '/' | '-' | '.'))?);
        let parts = [parts.next()?, parts.next()?, parts.next().filter(|_| parts.next().is_none())?];
        let [day, month, year] = match (self, parts) {
            (DateOrder::DayMonthYear, [day, month, year]) | (DateOrder::MonthDayYear, [month, day, year]) => {
                [day, month, year]
            }
            (DateOrder::YearMonthDay, [year, month, day]) => [day, month, year],
        };
        let small = |part: &str| i8::try_from(unsigned(part).filter(|_| part.len() < 3)?).ok();
        let year = match (year.len(), self) {
            (4, DateOrder::DayMonthYear | DateOrder::MonthDayYear) => i16::try_from(unsigned(year)?).ok()?,
            (2, _) => Some(i16::from(small(year)?)).map(|year| if year < 80 { 2000 + year } else { 1900 + year })?,
            _ => return None,
        };
        Date::new(year, small(month)?, small(day)?).ok()
    }

    /// The same without separators: `050621`, or with a four-digit year at the end, `05062021`.
    fn of_digits(self, text: &str) -> Option<Date> {
        let (first, rest) = text.split_at_checked(2).filter(|_| matches!(text.len(), 6 | 8))?;
        let (second, third) = rest.split_at_checked(2)?;
        // No month is 19 or 20, so that yyyymmdd never matches.
        if third.len() == 4 && !third.starts_with("19") && !third.starts_with("20") {
            return None;
        }
        self.date(&format!("{first}/{second}/{third}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn iso_instants_convert_to_unix_time() {
        // GNU date: date -u -d '2024-05-10T17:27:44Z' +%s
        assert_eq!(iso_to_unix_ns("2024-05-10T17:27:44.30Z"), Some(1_715_362_064_300_000_000));
        assert_eq!(iso_to_unix_ns("2024-05-10T17:27:44.000000001"), Some(1_715_362_064_000_000_001));
        assert_eq!(iso_to_unix_ns("2024-05-10 19:27:44.3+02:00"), Some(1_715_362_064_300_000_000));
        assert_eq!(iso_to_unix_ns("2024-05-10T07:57:44.3-0930"), Some(1_715_362_064_300_000_000));
        for same in [
            "2024/05/10 17:27:44.30",
            "10.05.2024 17:27:44.30",
            "2024-05-10 17:27:44.3 UTC",
            "2024-05-10 05:27:44.3 PM GMT",
            "2024-05-10 17:27:44:300",
            "10-May-2024 17:27:44.3",
            "20240510T172744.300Z",
        ] {
            assert_eq!(iso_to_unix_ns(same), Some(1_715_362_064_300_000_000), "{same}");
        }
        assert_eq!(iso_to_unix_ns("20240510 17:27:44.3"), Some(1_715_362_064_300_000_000));
        // The t of a month is not a T.
        assert_eq!(iso_to_unix_ns("05-Oct-2024 10:00:00"), iso_to_unix_ns("2024-10-05T10:00:00"));
        assert_eq!(iso_to_unix_ns("1.5.2024T10:00:00"), iso_to_unix_ns("2024-05-01T10:00:00"));
        assert_eq!(iso_to_unix_ns("1970-01-01T00:00:00Z"), Some(0));
        assert_eq!(iso_to_unix_ns("1969-12-31T23:59:59.5Z"), Some(-500_000_000));
        // 2016 ended in a leap second; Unix time gives it the number of the second after.
        assert_eq!(iso_to_unix_ns("2016-12-31T23:59:60.25Z"), Some(1_483_228_800_250_000_000));
    }

    #[test]
    fn invalid_instants_are_rejected() {
        for text in [
            "",
            "2024-05-10",
            "2024-13-10T00:00:00Z",
            "2024-02-30T00:00:00Z",
            "2024-05-10T25:00:00Z",
            "2024-05-10T17:27:44.3x",
            "2024-05-10T1:2:3Z",
            "05/10/2024 17:27:44",
            "2024-05-10 17:27:44:30",
            "2024-05-10 17:27:44.3:300",
            "2024-05-10 172744",
            "24.05.10 17:27:44",
            "10.5.2024",
            "2024-05-10 17:27:44 CET",
            "44.3",
            "2024-05-10T17:27:44+99:00",
            "２０２４-05-10T00:00:00",
        ] {
            assert_eq!(iso_to_unix_ns(text), None, "{text}");
        }
    }

    #[test]
    fn decimal_seconds_are_exact_to_the_nanosecond() {
        assert_eq!(Tick::Seconds.of_text("1396293888.886"), Some(1_396_293_888_886_000_000));
        assert_eq!(Tick::Seconds.of_text("0.09998099999999965"), Some(99_981_000));
        assert_eq!(Tick::Seconds.of_text("-0.0000000015"), Some(-2));
        assert_eq!(Tick::Millis.of_text("1.5"), Some(1_500_000));
        assert_eq!(Tick::Seconds.of_text("1.5e1"), Some(15_000_000_000));
        assert_eq!(Tick::Nanos.of_text("9223372036854775807"), Some(i64::MAX));
        assert_eq!(Tick::Seconds.of_text("9223372037"), None);
        assert_eq!(Tick::Seconds.of_text("."), None);
    }

    #[test]
    fn a_double_of_seconds_is_exact_to_its_last_bit() {
        // Its neighbours are 238 ns away; python3: decimal.Decimal(1700000000.123456) = 1700000000.1234560013...
        assert_eq!(Tick::Seconds.float_since(1_700_000_000.123_456, 0), Some(1_700_000_000_123_456_001));
        assert_eq!(Tick::Seconds.float_since(-0.25, 0), Some(-250_000_000));
        assert_eq!(Tick::Micros.float_since(1.5, 0), Some(1500));
        for none in [f64::NAN, f64::INFINITY, 1e10, -1e300] {
            assert_eq!(Tick::Seconds.float_since(none, 0), None, "{none}");
        }
    }

    #[test]
    fn days_since_other_epochs_are_exact_outside_64_bits_of_nanoseconds() {
        // 2024-05-10T17:27:44.3Z is day 60440.7275960648... of the modified Julian date.
        let truth = 1_715_362_064_300_000_000_i64;
        let nanos_of_day = truth % (86_400 * 1_000_000_000);
        for (day_of_1970, digits) in [(0_i64, 15), (25_569, 15), (719_529, 15), (2_440_588, 15)] {
            let day = truth / (86_400 * 1_000_000_000) + day_of_1970;
            let fraction = i128::from(nanos_of_day) * 10_i128.pow(digits) / (86_400 * 1_000_000_000_i128);
            let text = format!("{day}.{fraction:0width$}", width = digits as usize);
            let found = Tick::Days.text_since(&text, -day_of_1970 * 86_400).unwrap();
            assert!(found.abs_diff(truth) <= 1, "{text}: {found}");
        }
        assert_eq!(Tick::Days.integer_since(719_529, -719_529 * 86_400), Some(0));
        assert_eq!(Tick::Days.float_since(2_440_588.0, -2_440_587 * 86_400 - 43_200), Some(43_200_000_000_000));
        assert_eq!(Tick::Days.of_text("719529"), None);
    }

    #[test]
    fn a_day_of_a_year_is_read_in_every_time_code_notation() {
        // date -u -d '2024-05-10' +%j is 131.
        let nanos = ((17 * 60 + 27) * 60 + 44) * 1_000_000_000 + 300_000_000;
        let plain = DayOfYear { year: None, day: 131, nanos, east_ns: None };
        for text in ["131:17:27:44.300000", "131 17:27:44.3", " 131-17:27:44.3 ", "131/17:27:44:300"] {
            assert_eq!(DayOfYear::of_text(text), Some(plain), "{text}");
        }
        for (text, east_s) in [("131:17:27:44.3Z ", 0), ("131-17:27:44.3 UTC", 0), ("131:17:27:44.3-0930", -34_200)] {
            let east_ns = Some(east_s * 1_000_000_000);
            assert_eq!(DayOfYear::of_text(text), Some(DayOfYear { east_ns, ..plain }), "{text}");
        }
        for text in ["2024:131:17:27:44.300", "2024-131T17:27:44.3", "2024 131 17:27:44.3", "2024/131/17:27:44.3"] {
            assert_eq!(DayOfYear::of_text(text), Some(DayOfYear { year: Some(2024), ..plain }), "{text}");
            let unix = year_begin_unix_ns(2024).unwrap() + 130 * 86_400_000_000_000 + nanos;
            assert_eq!(unix, 1_715_362_064_300_000_000);
        }
        assert_eq!(DayOfYear::of_text("007:00:00:00").map(|d| d.day), Some(7));
        assert_eq!(DayOfYear::of_text("2024:366:00:00:00").map(|d| d.day), Some(366));
    }

    #[test]
    fn an_invalid_day_of_a_year_with_a_time_is_rejected() {
        for text in [
            "",
            "131",
            "000:17:27:44",
            "367:17:27:44",
            "24:131:17:27:44",
            "131:24:27:44",
            "17:27:44.3",
            "17:05:00",
            "2024:131:17:27",
            "2023:366:17:27:44",
            "131:17:27:44.3x",
            "131:17:27:44.3+garbage",
            "131:17:27:44.3 Garbage",
            "131:17:27:44.3+99:00",
        ] {
            assert_eq!(DayOfYear::of_text(text), None, "{text}");
        }
    }

    #[test]
    fn ordinal_and_week_dates_match_gnu_date() {
        // date -u -d '2024-05-10' '+%G-W%V-%u' is 2024-W19-5; 2020-12-31 is day 366 and 2020-W53-4; 2021-01-03 is 2020-W53-7.
        for (text, date) in [
            ("2024-131", "2024-05-10"),
            ("2024131", "2024-05-10"),
            ("2024-W19-5", "2024-05-10"),
            ("2024W195", "2024-05-10"),
            ("2020-366", "2020-12-31"),
            ("2020-W53-7", "2021-01-03"),
        ] {
            assert_eq!(plain_date(text), iso_date(date), "{text}");
        }
        for none in ["2023-366", "2024-000", "2024-W54-1", "2024-W19-8", "2024-W19", "2024-31"] {
            assert_eq!(plain_date(none), None, "{none}");
        }
        for instant in ["2024-131T17:27:44.30Z", "2024131T172744.3Z", "2024-W19-5T17:27:44.3"] {
            assert_eq!(iso_to_unix_ns(instant), Some(1_715_362_064_300_000_000), "{instant}");
        }
    }

    #[test]
    fn digits_without_colons_are_a_time_of_day_only_if_valid() {
        for (text, colons) in
            [("172744.30", "17:27:44.30"), ("92344", "09:23:44"), ("5", "00:00:05"), ("000005.25Z", "00:00:05.25Z")]
        {
            assert_eq!(with_colons(text).as_deref(), Some(colons));
        }
        for none in ["", "62864.30", "246060", "1727440", "17:27:44", "-5", "x", "172744-x"] {
            assert_eq!(with_colons(none), None, "{none}");
        }
        assert!(says_zone("2024-05-10T17:27:44Z") && says_zone("172744+02") && says_zone("2024-05-10 5:27:44 PM GMT"));
        assert!(!says_zone("2024-05-10T17:27:44") && !says_zone("05-Oct-2024 10:00:00") && !says_zone("17:27:44.3"));
    }

    #[test]
    fn the_order_of_ambiguous_dates_is_inferred_from_the_whole_column() {
        let shown =
            |dates: &[&str]| DateOrder::shown_by(dates.iter().copied()).map(|o| o.map(|o| o.0)).map_err(str::to_owned);
        assert_eq!(shown(&["05/06/2021", "23/06/2021"]), Ok(Some(DateOrder::DayMonthYear)));
        assert_eq!(shown(&["06-05-2021", "", "06-23-2021", "n/a", "06-05-2021"]), Ok(Some(DateOrder::MonthDayYear)));
        assert_eq!(shown(&["05.06.2021"]), Ok(Some(DateOrder::DayMonthYear)));
        assert_eq!(shown(&["05.06.21"]), Ok(Some(DateOrder::DayMonthYear)));
        assert_eq!(shown(&["85/06/05"]), Ok(Some(DateOrder::YearMonthDay)));
        assert_eq!(shown(&["2021-06-05", "20210605", "5 Jun 2021", ""]), Ok(None));
        // Ambiguous; two contradict; day or year.
        for unclear in
            [&["05/06/2021"][..], &["05/16/2021", "23/06/2021"], &["23/06/21"], &["05.06.2021", "06/23/2021"]]
        {
            assert!(shown(unclear).is_err(), "{unclear:?}");
        }
        // The date that proves it is shown to the user.
        let proof = |dates: &[&str]| {
            DateOrder::shown_by(dates.iter().copied()).map_or_else(str::to_owned, |o| o.unwrap().1.to_owned())
        };
        assert_eq!(proof(&["05/06/2021", "23/06/2021", "24/06/2021"]), "23/06/2021");
        assert_eq!(proof(&["2021-06-05", "05.06.2021", "06.06.2021"]), "05.06.2021");
        assert_eq!(proof(&["05/06/2021", "05/16/2021", "23/06/2021", "24/06/2021"]), "23/06/2021");
    }

    #[test]
    fn an_ambiguous_date_is_read_in_its_order_or_not_at_all() {
        let day = iso_date("2021-06-05");
        for text in ["05/06/2021", "5-6-2021", "05.06.2021", "5.6.21", "05/06/21", "050621", "05062021"] {
            assert_eq!(DateOrder::DayMonthYear.date(text), day, "{text}");
        }
        assert_eq!(DateOrder::MonthDayYear.date("06/05/2021"), day);
        assert_eq!(DateOrder::YearMonthDay.date("21-06-05"), day);
        assert_eq!(DateOrder::DayMonthYear.date("05/06/99"), iso_date("1999-06-05"));
        for none in [
            "2021/06/05",
            "05/06/021",
            "31/02/2021",
            "05/06-2021",
            "5/6",
            "5/6/21/1",
            "50621",
            "20210605",
            "٥/6/2021",
            "-5/6/2021",
        ] {
            assert_eq!(DateOrder::DayMonthYear.date(none), None, "{none}");
        }
    }

    #[test]
    fn an_unambiguous_date_is_read_in_every_notation() {
        for text in ["2021-06-05", "2021/06/05", "20210605", "05-Jun-2021", "5 JUN 2021"] {
            assert_eq!(plain_date(text), iso_date("2021-06-05"), "{text}");
        }
        for text in [
            "05/06/2021",
            "5-6-2021",
            "2021.06.05",
            "210605",
            "2021-6-5",
            "05.06.2021",
            "２０２1",
            "5-Juni-2021",
            "05-Jun-21",
        ] {
            assert_eq!(plain_date(text), None, "{text}");
        }
        assert_eq!(iso_to_unix_ns("20240510T172744.30Z"), Some(1_715_362_064_300_000_000));
        assert_eq!(iso_to_unix_ns("20240510T172744.30"), Some(1_715_362_064_300_000_000));
        assert_eq!(iso_to_unix_ns("20240510T17:27:44"), None);
    }

    #[test]
    fn calendar_numbers_give_the_same_instant_as_their_text() {
        assert_eq!(calendar_to_unix_ns([2024, 5, 10, 17, 27, 44], 300_000_000), Some(1_715_362_064_300_000_000));
        assert_eq!(calendar_to_unix_ns([2016, 12, 31, 23, 59, 60], 0), Some(1_483_228_800_000_000_000));
        for parts in [[0, 0, 0, 0, 0, 0], [2024, 13, 1, 0, 0, 0], [2024, 5, 10, 24, 0, 0], [2024, 5, 10, 0, 0, 61]] {
            assert_eq!(calendar_to_unix_ns(parts, 0), None, "{parts:?}");
        }
    }

    #[test]
    fn a_local_time_with_its_offset_converts_to_the_right_instant() {
        let date = iso_date("2022-04-17").unwrap();
        // date -u -d '2022-04-17T10:50:02Z' +%s
        assert_eq!(unix_ns(date, "12:50:02", "+02:00"), Some(1_650_192_602_000_000_000));
        assert_eq!(unix_ns(date, "12:50:02", ""), None);
        for (time, offset) in
            [("10:50:02Z", ""), ("12:50:02+02:00", "Z"), ("06:20:02-0430", "+01:00"), ("10:50:02 AM", "Z")]
        {
            assert_eq!(unix_ns(date, time, offset), Some(1_650_192_602_000_000_000), "{time}");
        }
        assert_eq!(unix_ns(date, "12:50:02 am", "Z"), unix_ns(date, "00:50:02", "Z"));
        assert_eq!(unix_ns(date, "12:50:02PM", "Z"), unix_ns(date, "12:50:02", "Z"));
        assert_eq!(unix_ns(date, "07:50:02.5 PM", "Z"), unix_ns(date, "19:50:02.5", "Z"));
        assert_eq!((unix_ns(date, "13:50:02 PM", "Z"), unix_ns(date, "0:50:02 AM", "Z")), (None, None));
    }
}
