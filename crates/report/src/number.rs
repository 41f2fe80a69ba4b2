//! Numbers as people read them: rounding by uncertainty, one minus sign, one clock.

use flight::with_minus;
use record::Estimate;

/// The minus sign of all pages (U+2212), as wide as the plus.
const MINUS: &str = "\u{2212}";
/// Between groups of three digits: a narrow space that does not break.
const GROUP: char = '\u{202f}';
/// Coverage factor of all expanded uncertainties: about 95 % for a normal distribution.
pub(crate) const COVERAGE_FACTOR: f64 = 2.0;

/// A value and its expanded uncertainty U = k·u, both rounded to the second significant digit of U (GUM 7.2.6).
/// `u` is the standard uncertainty. Without one, U is `None` and the value has three significant digits.
pub(crate) fn measured(value: f64, standard_uncertainty: Option<f64>) -> (String, Option<String>) {
    let expanded = standard_uncertainty.map(|u| COVERAGE_FACTOR * u).filter(|u| u.is_finite() && *u > 0.0);
    match expanded {
        Some(expanded) if value.is_finite() => {
            let last = leading_digit(expanded, 2) - 1;
            (rounded(value, last), Some(rounded(expanded, last)))
        }
        _ => (significant(value, 3), None),
    }
}

/// `6.984 ± 0.020` as one string, or the value alone.
pub(crate) fn with_uncertainty(estimate: &Estimate) -> String {
    match measured(estimate.value, estimate.standard_uncertainty) {
        (value, Some(expanded)) => format!("{value}\u{a0}±\u{a0}{expanded}"),
        (value, None) => value,
    }
}

/// The same number in another unit; `factor` new units equal one old unit.
pub(crate) fn scaled(estimate: &Estimate, factor: f64) -> Estimate {
    Estimate {
        value: estimate.value * factor,
        standard_uncertainty: estimate.standard_uncertainty.map(|u| u * factor.abs()),
    }
}

/// Both ends of an interval, rounded like a value with this standard uncertainty.
pub(crate) fn interval([low, high]: [f64; 2], standard_uncertainty: f64) -> String {
    let end = |value| measured(value, Some(standard_uncertainty)).0;
    format!("{}\u{a0}to\u{a0}{}", end(low), end(high))
}

/// A value with the given number of significant digits.
pub(crate) fn significant(value: f64, digits: i32) -> String {
    if value == 0.0 { "0".to_owned() } else { rounded(value, leading_digit(value, digits) - digits + 1) }
}

/// A value rounded to the given number of significant digits.
pub(crate) fn to_significant(value: f64, digits: i32) -> f64 {
    format!("{:.*e}", usize::try_from(digits - 1).unwrap_or(0), value).parse().unwrap_or(value)
}

/// A configured number: up to seven digits, without trailing zeros.
pub(crate) fn exact(value: f64) -> String {
    let text = significant(value, 7);
    match text.contains('.') && !text.contains('e') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => text,
    }
}

/// A probability, as `p = 0.62`: three decimals at most, and never 0.
pub(crate) fn probability(p: f64) -> String {
    match p {
        p if p < 0.001 => "p < 0.001".to_owned(),
        p if p < 0.1 => format!("p = {}", fixed(p, 3)),
        p => format!("p = {}", fixed(p, 2)),
    }
}

/// A value with the given number of decimals.
pub(crate) fn fixed(value: f64, decimals: i32) -> String {
    rounded(value, -decimals)
}

/// Power of ten of the first digit, once the value is rounded to `digits` digits: 0.0996 is
/// 0.10 with two digits, so its first digit is at 10⁻¹.
fn leading_digit(value: f64, digits: i32) -> i32 {
    let text = format!("{:.*e}", usize::try_from(digits - 1).unwrap_or(0), value);
    text.rsplit_once('e').and_then(|(_, exponent)| exponent.parse().ok()).unwrap_or(0)
}

/// A value rounded to multiples of 10^`last`.
fn rounded(value: f64, last: i32) -> String {
    if !value.is_finite() {
        return "not finite".to_owned();
    }
    if last < -9 || value.abs() >= 1e12 {
        return with_minus(&format!("{value:.2e}"));
    }
    if last <= 0 {
        return with_minus(&format!("{value:.*}", usize::try_from(-last).unwrap_or(0)));
    }
    let unit = 10f64.powi(last);
    with_minus(&format!("{:.0}", (value / unit).round() * unit))
}

/// A count, in groups of three digits.
pub(crate) fn count(value: u64) -> String {
    let digits = value.to_string();
    let mut text = String::with_capacity(digits.len() * 2);
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(GROUP);
        }
        text.push(digit);
    }
    text
}

/// `1 file`, `2 files`.
pub(crate) fn counted(value: u64, singular: &str, plural: &str) -> String {
    format!("{} {}", count(value), if value == 1 { singular } else { plural })
}

/// A size, in powers of 1000.
pub(crate) fn bytes(value: u64) -> String {
    const UNITS: [&str; 6] = ["kB", "MB", "GB", "TB", "PB", "EB"];
    if value < 1000 {
        return format!("{value} B");
    }
    let mut scaled = value as f64 / 1e3;
    let mut unit = 0;
    // From 999.5 on, three digits would read 1000.
    while scaled >= 999.5 && unit + 1 < UNITS.len() {
        scaled /= 1e3;
        unit += 1;
    }
    format!("{} {}", significant(scaled, 3), UNITS[unit])
}

/// A share between 0 and 1 in percent. Only exactly 1 reads as 100 %, only exactly 0 as 0 %.
pub(crate) fn percent(share: f64) -> String {
    if !share.is_finite() {
        return "not finite".to_owned();
    }
    let text = fixed(share * 100.0, 1);
    match text.as_str() {
        "100.0" if share < 1.0 => "> 99.9".to_owned(),
        "0.0" if share > 0.0 => "< 0.1".to_owned(),
        "100.0" => "100".to_owned(),
        "0.0" => "0".to_owned(),
        _ => text,
    }
}

/// Seconds as `h:mm:ss`, with the given number of decimals.
pub(crate) fn clock(seconds: f64, decimals: usize) -> String {
    let (hours, rest) = hours_and_seconds(seconds, decimals);
    format!("{}{}:{}", sign(seconds, decimals), hours, minutes(rest, decimals, true))
}

/// A duration in running text: `52 s`, `1 min 52 s`, `2 h 5 min`.
pub(crate) fn lasting(seconds: f64) -> String {
    let whole = seconds.abs().round() as u64;
    let (hours, minutes, rest) = (whole / 3600, whole / 60 % 60, whole % 60);
    match (hours, minutes) {
        (0, 0) => format!("{rest}\u{a0}s"),
        (0, _) => format!("{minutes}\u{a0}min {rest}\u{a0}s"),
        _ => format!("{}\u{a0}h {minutes}\u{a0}min", count(hours)),
    }
}

/// Seconds as `m:ss` for durations under an hour; longer ones as in [`clock`].
pub(crate) fn short_clock(seconds: f64, decimals: usize) -> String {
    let (hours, rest) = hours_and_seconds(seconds, decimals);
    if hours > 0 {
        return clock(seconds, decimals);
    }
    format!("{}{}", sign(seconds, decimals), minutes(rest, decimals, false))
}

/// Whole hours, and the remaining ticks (10^-decimals s). Rounded once, so that 59.96 s is
/// 1:00.0 and not 0:60.0. Out-of-range times saturate.
fn hours_and_seconds(seconds: f64, decimals: usize) -> (u64, u64) {
    let per_second = 10u64.pow(u32::try_from(decimals.min(6)).unwrap_or(0));
    let ticks = (seconds.abs() * per_second as f64).round() as u64;
    (ticks / (3600 * per_second), ticks % (3600 * per_second))
}

fn minutes(ticks: u64, decimals: usize, two_digits: bool) -> String {
    let decimals = decimals.min(6);
    let per_second = 10u64.pow(u32::try_from(decimals).unwrap_or(0));
    let (minutes, seconds) = (ticks / (60 * per_second), ticks / per_second % 60);
    let whole = if two_digits { format!("{minutes:02}:{seconds:02}") } else { format!("{minutes}:{seconds:02}") };
    if decimals == 0 { whole } else { format!("{whole}.{:0decimals$}", ticks % per_second) }
}

fn sign(seconds: f64, decimals: usize) -> &'static str {
    if seconds < 0.0 && hours_and_seconds(seconds, decimals) != (0, 0) { MINUS } else { "" }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pair(value: f64, u: f64) -> (String, String) {
        let (value, expanded) = measured(value, Some(u));
        (value, expanded.unwrap())
    }

    fn texts(value: &str, expanded: &str) -> (String, String) {
        (value.to_owned(), expanded.to_owned())
    }

    #[test]
    fn an_uncertainty_has_two_digits_and_its_value_ends_at_the_same_digit() {
        assert_eq!(pair(118.4321, 1.55), texts("118.4", "3.1"));
        assert_eq!(pair(0.037_123, 0.002), texts("0.0371", "0.0040"));
        assert_eq!(pair(6.984, 0.01), texts("6.984", "0.020"));
        assert_eq!(pair(-0.5, 0.05), texts("\u{2212}0.50", "0.10"));
        assert_eq!(pair(56_789.0, 617.0), texts("56800", "1200"));
    }

    #[test]
    fn rounding_that_carries_keeps_two_digits() {
        // 2 × 0.0498 = 0.0996, which is 0.10 with two digits.
        assert_eq!(pair(1.0, 0.0498), texts("1.00", "0.10"));
        assert_eq!(pair(1.0, 4.98), texts("1", "10"));
        assert_eq!(pair(100.0, 49.8), texts("100", "100"));
    }

    #[test]
    fn every_rounding_stays_within_half_of_its_last_digit() {
        for exponent in -6..6 {
            for mantissa in [1.0, 1.049, 1.0501, 2.5, 4.975, 9.94, 9.96, 9.999] {
                let u = mantissa * 10f64.powi(exponent);
                for value in [0.0, 3.3 * u, -123.456 * u, 0.01 * u] {
                    let (value_text, expanded_text) = measured(value, Some(u));
                    let expanded_text = expanded_text.unwrap();
                    let shown: f64 = value_text.replace(MINUS, "-").parse().unwrap();
                    let expanded: f64 = expanded_text.parse().unwrap();
                    let last = 10f64.powi(leading_digit(2.0 * u, 2) - 1);
                    assert!((shown - value).abs() <= last * 0.500_001, "{value} ± {u}: {value_text}");
                    assert!((expanded - 2.0 * u).abs() <= last * 0.500_001, "{u}: {expanded_text}");
                    // Two significant digits: between 10 and 100 units of the last digit.
                    assert!((9.5..100.5).contains(&(expanded / last)), "{u}: {expanded_text}");
                    let decimals = |text: &str| text.split_once('.').map_or(0, |(_, d)| d.len());
                    assert_eq!(decimals(&value_text), decimals(&expanded_text));
                }
            }
        }
    }

    #[test]
    fn a_configured_number_has_no_trailing_zeros() {
        let texts = [2000.0, -1.28, 0.05, 0.1 + 0.2, 15.0].map(exact);
        assert_eq!(texts, ["2000", "\u{2212}1.28", "0.05", "0.3", "15"]);
    }

    #[test]
    fn without_an_uncertainty_there_are_three_digits_and_no_plus_minus() {
        assert_eq!(measured(6.9841, None), ("6.98".to_owned(), None));
        assert_eq!(measured(0.0, Some(0.0)), ("0".to_owned(), None));
        assert_eq!(measured(12_345.0, Some(f64::NAN)), ("12300".to_owned(), None));
        assert_eq!(measured(f64::NAN, Some(0.1)), ("not finite".to_owned(), None));
    }

    #[test]
    fn there_is_no_negative_zero() {
        assert_eq!(fixed(-0.0001, 2), "0.00");
        assert_eq!(fixed(-0.006, 2), "\u{2212}0.01");
        assert_eq!(clock(-0.2, 0), "0:00:00");
    }

    #[test]
    fn a_clock_carries_into_minutes_and_hours() {
        assert_eq!(clock(3_599.7, 0), "1:00:00");
        assert_eq!(clock(59.96, 1), "0:01:00.0");
        assert_eq!(clock(45_296.0, 0), "12:34:56");
        assert_eq!(short_clock(59.96, 1), "1:00.0");
        assert_eq!(short_clock(-75.0, 0), "\u{2212}1:15");
        assert_eq!(short_clock(3_600.0, 0), "1:00:00");
        assert!(!clock(1e300, 3).is_empty() && !clock(f64::NAN, 0).is_empty());
    }

    #[test]
    fn a_partial_share_never_reads_as_0_or_100_percent() {
        assert_eq!(percent(0.99999), "> 99.9");
        assert_eq!(percent(1.0), "100");
        assert_eq!(percent(1e-6), "< 0.1");
        assert_eq!(percent(0.9876), "98.8");
    }

    #[test]
    fn sizes_and_counts_are_grouped() {
        assert_eq!(bytes(999), "999 B");
        assert_eq!(bytes(999_950), "1.00 MB");
        assert_eq!(bytes(425_000_000), "425 MB");
        assert_eq!(bytes(u64::MAX), "18.4 EB");
        assert_eq!(count(1_234_567), "1\u{202f}234\u{202f}567");
        assert_eq!(counted(1, "file", "files"), "1 file");
    }

    #[test]
    fn durations_have_their_two_largest_units() {
        for (seconds, text) in [
            (0.4, "0 s"),
            (52.0, "52 s"),
            (59.5, "1 min 0 s"),
            (112.0, "1 min 52 s"),
            (3599.4, "59 min 59 s"),
            (3600.0, "1 h 0 min"),
            (7_530.0, "2 h 5 min"),
            (-52.0, "52 s"),
        ] {
            assert_eq!(lasting(seconds).replace('\u{a0}', " "), text, "{seconds}");
        }
    }

    #[test]
    fn a_probability_has_three_decimals_below_a_tenth_and_is_never_zero() {
        for (p, text) in [
            (0.0, "p < 0.001"),
            (0.000_9, "p < 0.001"),
            (0.001, "p = 0.001"),
            (0.046_2, "p = 0.046"),
            (0.1, "p = 0.10"),
            (0.623, "p = 0.62"),
        ] {
            assert_eq!(probability(p), text);
        }
    }
}
