//! Time written as text or as a number, to integer nanoseconds. Never asks the machine for its time zone.

use jiff::civil::{Date, DateTime, Time};
use jiff::tz::Offset;

/// Unit of an epoch number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Tick {
    Seconds,
    Millis,
    /// 100 µs.
    TenthMillis,
    Micros,
    Nanos,
}

impl Tick {
    /// Nanoseconds in one.
    pub(crate) fn nanos(self) -> i64 {
        match self {
            Tick::Seconds => 1_000_000_000,
            Tick::Millis => 1_000_000,
            Tick::TenthMillis => 100_000,
            Tick::Micros => 1_000,
            Tick::Nanos => 1,
        }
    }

    /// Nanoseconds of an exact number of ticks; `None` beyond the range of `i64`.
    pub(crate) fn of_integer(self, ticks: i64) -> Option<i64> {
        ticks.checked_mul(self.nanos())
    }

    /// Nanoseconds of a double; `None` beyond the range of `i64`. Only its fraction is rounded: a double of all the
    /// nanoseconds since 1970 would be a multiple of 256.
    pub(crate) fn of_float(self, ticks: f64) -> Option<i64> {
        let whole = Some(ticks.trunc()).filter(|whole| whole.abs() < 9.2e18)?;
        self.of_integer(whole as i64)?.checked_add(((ticks - whole) * self.nanos() as f64).round() as i64)
    }

    /// Nanoseconds of a decimal number as text. Plain decimals are exact to the nanosecond;
    /// digits beyond it are rounded. Others, such as `1.5e9`, go through a double.
    pub(crate) fn of_text(self, text: &str) -> Option<i64> {
        self.of_decimal(text).or_else(|| self.of_float(text.parse().ok().filter(|t: &f64| t.is_finite())?))
    }

    fn of_decimal(self, text: &str) -> Option<i64> {
        let (negative, digits) = match text.strip_prefix('-') {
            Some(rest) => (true, rest),
            None => (false, text.strip_prefix('+').unwrap_or(text)),
        };
        let (whole, fraction) = digits.split_once('.').unwrap_or((digits, ""));
        let whole: i64 = if whole.is_empty() && !fraction.is_empty() { 0 } else { unsigned(whole)? };
        let nanos = self.of_integer(whole)?.checked_add(fraction_of(fraction, self.nanos())?)?;
        Some(if negative { -nanos } else { nanos })
    }
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
    // Eighteen digits of any unit up to 1e9 fit into an i128, and more do not matter.
    let digits = fraction.get(..fraction.len().min(18))?;
    let scale = 10_i128.pow(u32::try_from(digits.len()).ok()?);
    if !fraction.bytes().all(|b| b.is_ascii_digit()) {
        return None;
    }
    let scaled = i128::from(unsigned(digits)?) * i128::from(unit);
    i64::try_from((2 * scaled + scale) / (2 * scale)).ok()
}

/// Nanoseconds since 1970 of an ISO 8601 instant, such as `2024-05-10T17:27:44.30Z`,
/// `2024-05-10 17:27:44.3+02:00`, or without a zone, which then means UTC. Also with another date whose order is certain:
/// `2024/05/10`, or `10.05.2024`, for points stand only behind a day that comes first.
pub(crate) fn iso_to_unix_ns(text: &str) -> Option<i64> {
    let text = text.trim();
    let digit = |at: usize| text.as_bytes().get(at).is_some_and(u8::is_ascii_digit);
    let breaks = text.match_indices(['T', 't', ' ']).map(|(at, _)| at);
    let at = breaks.into_iter().find(|at| *at > 0 && digit(at - 1) && digit(at + 1))?;
    let (date, time) = (text.get(..at)?, text.get(at + 1..)?);
    if date.len() == 8 && unsigned(date).is_some() && text.get(at..=at) != Some(" ") {
        return basic_to_unix_ns(text);
    }
    let has_points = date.rsplit_once('.').is_some_and(|(_, year)| year.len() == 4);
    let with_points = || Some(date).filter(|_| has_points).and_then(|date| DateOrder::DayMonthYear.date(date));
    unix_ns(plain_date(date).or_else(with_points)?, time, "Z")
}

/// The basic format, `20240510T172744.30Z`.
fn basic_to_unix_ns(text: &str) -> Option<i64> {
    let rest = text.get(9..)?;
    let (hour, minute, second) = (rest.get(..2)?, rest.get(2..4)?, rest.get(4..)?);
    unix_ns(plain_date(text.get(..8)?)?, &format!("{hour}:{minute}:{second}"), "Z")
}

/// Nanoseconds since 1970 of a date, a time of day `hh:mm:ss[.fff]`, which `AM` or `PM` may follow, and an offset
/// `+hh:mm`, `Z`, `UTC` or `GMT`. One that stands behind the time counts instead.
pub(crate) fn unix_ns(date: Date, time: &str, offset: &str) -> Option<i64> {
    let (time, own) = time.split_at_checked(time.find(['Z', 'z', '+', '-', 'U', 'G']).unwrap_or(time.len()))?;
    let offset = if own.is_empty() { offset } else { own };
    let (time, nanos) = time_of_day(time.trim_end())?;
    let seconds =
        Offset::from_seconds(offset_seconds(offset)?).ok()?.to_timestamp(DateTime::from_parts(date, time)).ok()?;
    seconds.as_second().checked_mul(1_000_000_000)?.checked_add(nanos)
}

/// Nanoseconds since 1970 of year, month, day, hour, minute, second and nanosecond, UTC.
pub(crate) fn calendar_to_unix_ns(parts: [i64; 6], nanos: i64) -> Option<i64> {
    let [year, month, day, hour, minute, second] = parts;
    let small = |v: i64| i8::try_from(v).ok();
    let (second, leap) = if second == 60 { (59, 1) } else { (second, 0) };
    let date = Date::new(i16::try_from(year).ok()?, small(month)?, small(day)?).ok()?;
    let time = Time::new(small(hour)?, small(minute)?, small(second)?, 0).ok()?;
    let instant = Offset::UTC.to_timestamp(DateTime::from_parts(date, time)).ok()?;
    instant.as_second().checked_add(leap)?.checked_mul(1_000_000_000)?.checked_add(nanos)
}

/// The whole second, and the fraction in ns, of `hh:mm[:ss[.fff]]` or `hh:mm:ss:fff`. A leap second counts as the second after,
/// as Unix has it.
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
    // Behind another colon stand milliseconds if there are three digits, else nobody knows what.
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
fn offset_seconds(text: &str) -> Option<i32> {
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

/// A date whose order is certain: `yyyy-mm-dd`, `yyyy/mm/dd`, `yyyymmdd`, or with the month in English letters,
/// `dd-Mon-yyyy` or `dd Mon yyyy`.
pub(crate) fn plain_date(text: &str) -> Option<Date> {
    if let Some(date) = named_month(text) {
        return Some(date);
    }
    if text.len() == 8 && text.bytes().all(|b| b.is_ascii_digit()) {
        let (year, rest) = text.split_at_checked(4)?;
        let (month, day) = rest.split_at_checked(2)?;
        return iso_date(&format!("{year}-{month}-{day}"));
    }
    iso_date(text).or_else(|| iso_date(&text.replace('/', "-")))
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
pub(crate) fn iso_date(text: &str) -> Option<Date> {
    let mut parts = text.split('-');
    let year = parts.next().filter(|y| y.len() == 4)?;
    let (month, day) = (parts.next()?, parts.next()?);
    if parts.next().is_some() {
        return None;
    }
    Date::new(i16::try_from(unsigned(year)?).ok()?, two_digits(month)?, two_digits(day)?).ok()
}

/// The order of day, month and year in dates whose writing leaves it open: `05/06/2021`, `5-6-2021`, `05.06.21`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum DateOrder {
    /// `23/06/2021`.
    DayMonthYear,
    /// `06/23/2021`.
    MonthDayYear,
    /// `21/06/23`.
    YearMonthDay,
}

impl DateOrder {
    const ALL: [DateOrder; 3] = [DateOrder::DayMonthYear, DateOrder::MonthDayYear, DateOrder::YearMonthDay];

    /// What it begins with.
    pub(crate) fn word(self) -> &'static str {
        match self {
            DateOrder::DayMonthYear => "day",
            DateOrder::MonthDayYear => "month",
            DateOrder::YearMonthDay => "year",
        }
    }

    /// What the dates of a whole column show, and the one that shows it; `None` if none of them is open. Points stand only
    /// behind a day that comes first.
    ///
    /// # Errors
    /// An open date of which nobody can know what it means.
    pub(crate) fn shown_by<'a>(dates: impl Iterator<Item = &'a str>) -> Result<Option<(DateOrder, &'a str)>, &'a str> {
        let (mut left, mut telling, mut last) = (DateOrder::ALL.to_vec(), None, "");
        for text in dates {
            if std::mem::replace(&mut last, text) == text {
                continue;
            }
            let fits = |order: &DateOrder| {
                order.date(text).is_some() && (*order == DateOrder::DayMonthYear || !text.contains('.'))
            };
            if DateOrder::ALL.iter().any(fits) {
                let before = left.len();
                left.retain(fits);
                let shows = left.len() < before || telling.is_none();
                telling = if shows { Some(text) } else { telling };
            }
        }
        match (telling, left.as_slice()) {
            (None, _) => Ok(None),
            (Some(text), [order]) => Ok(Some((*order, text))),
            (Some(text), _) => Err(text),
        }
    }

    /// The date, if it is an open one and has this order. Years of two digits are those from 1980 to 2079.
    pub(crate) fn date(self, text: &str) -> Option<Date> {
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
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn iso_instants_have_their_unix_time() {
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
        // The t of a month is no T.
        assert_eq!(iso_to_unix_ns("05-Oct-2024 10:00:00"), iso_to_unix_ns("2024-10-05T10:00:00"));
        assert_eq!(iso_to_unix_ns("1.5.2024T10:00:00"), iso_to_unix_ns("2024-05-01T10:00:00"));
        assert_eq!(iso_to_unix_ns("1970-01-01T00:00:00Z"), Some(0));
        assert_eq!(iso_to_unix_ns("1969-12-31T23:59:59.5Z"), Some(-500_000_000));
        // 2016 ended in a leap second; Unix gives it the number of the second after.
        assert_eq!(iso_to_unix_ns("2016-12-31T23:59:60.25Z"), Some(1_483_228_800_250_000_000));
    }

    #[test]
    fn what_is_no_instant_is_refused() {
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
    fn a_double_of_seconds_is_read_to_its_own_last_bit() {
        // Its neighbours are 238 ns away; python3: decimal.Decimal(1700000000.123456) = 1700000000.1234560013...
        assert_eq!(Tick::Seconds.of_float(1_700_000_000.123_456), Some(1_700_000_000_123_456_001));
        assert_eq!(Tick::Seconds.of_float(-0.25), Some(-250_000_000));
        assert_eq!(Tick::Micros.of_float(1.5), Some(1500));
        for none in [f64::NAN, f64::INFINITY, 1e10, -1e300] {
            assert_eq!(Tick::Seconds.of_float(none), None, "{none}");
        }
    }

    #[test]
    fn the_order_of_open_dates_is_what_the_whole_column_shows() {
        let shown =
            |dates: &[&str]| DateOrder::shown_by(dates.iter().copied()).map(|o| o.map(|o| o.0)).map_err(str::to_owned);
        assert_eq!(shown(&["05/06/2021", "23/06/2021"]), Ok(Some(DateOrder::DayMonthYear)));
        assert_eq!(shown(&["06-05-2021", "", "06-23-2021", "n/a", "06-05-2021"]), Ok(Some(DateOrder::MonthDayYear)));
        assert_eq!(shown(&["05.06.2021"]), Ok(Some(DateOrder::DayMonthYear)));
        assert_eq!(shown(&["05.06.21"]), Ok(Some(DateOrder::DayMonthYear)));
        assert_eq!(shown(&["85/06/05"]), Ok(Some(DateOrder::YearMonthDay)));
        assert_eq!(shown(&["2021-06-05", "20210605", "5 Jun 2021", ""]), Ok(None));
        // Nobody can know; two disagree; day or year.
        for unclear in
            [&["05/06/2021"][..], &["05/16/2021", "23/06/2021"], &["23/06/21"], &["05.06.2021", "06/23/2021"]]
        {
            assert!(shown(unclear).is_err(), "{unclear:?}");
        }
    }

    #[test]
    fn an_open_date_is_read_in_its_order_or_not_at_all() {
        let day = iso_date("2021-06-05");
        for text in ["05/06/2021", "5-6-2021", "05.06.2021", "5.6.21", "05/06/21"] {
            assert_eq!(DateOrder::DayMonthYear.date(text), day, "{text}");
        }
        assert_eq!(DateOrder::MonthDayYear.date("06/05/2021"), day);
        assert_eq!(DateOrder::YearMonthDay.date("21-06-05"), day);
        assert_eq!(DateOrder::DayMonthYear.date("05/06/99"), iso_date("1999-06-05"));
        for none in ["2021/06/05", "05/06/021", "31/02/2021", "05/06-2021", "5/6", "5/6/21/1", "٥/6/2021", "-5/6/2021"]
        {
            assert_eq!(DateOrder::DayMonthYear.date(none), None, "{none}");
        }
    }

    #[test]
    fn a_date_whose_order_is_certain_is_read_in_every_way_to_write_it() {
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
    fn calendar_numbers_are_the_instant_that_their_text_is() {
        assert_eq!(calendar_to_unix_ns([2024, 5, 10, 17, 27, 44], 300_000_000), Some(1_715_362_064_300_000_000));
        assert_eq!(calendar_to_unix_ns([2016, 12, 31, 23, 59, 60], 0), Some(1_483_228_800_000_000_000));
        for parts in [[0, 0, 0, 0, 0, 0], [2024, 13, 1, 0, 0, 0], [2024, 5, 10, 24, 0, 0], [2024, 5, 10, 0, 0, 61]] {
            assert_eq!(calendar_to_unix_ns(parts, 0), None, "{parts:?}");
        }
    }

    #[test]
    fn a_local_time_with_its_offset_is_the_right_instant() {
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
