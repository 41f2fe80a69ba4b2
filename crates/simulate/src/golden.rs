//! Golden texts: what the program wrote once, looked at by a person, and compared with what it writes now.
//!
//! A golden text only says that nothing changed. It covers layout, wording and the numbers of a whole record; what has a
//! known answer is also tested against that.

use serde_json::Value;
use std::fmt::Write;
use std::path::Path;

/// Arrays longer than this are shown by their statistics.
const LONGEST: usize = 12;
/// Characters of a tag and its text that are kept.
const TAG: usize = 400;

/// The first difference between a text and the golden one in a file, or `None`. Numbers with decimals may differ by one
/// unit of their last digit, because sine and cosine differ between systems. `FLIGHTLAG_BLESS=1` writes the file.
#[must_use]
pub fn golden_difference(path: &Path, text: &str) -> Option<String> {
    if std::env::var_os("FLIGHTLAG_BLESS").is_some() {
        return std::fs::write(path, text).err().map(|e| format!("{}: {e}", path.display()));
    }
    match std::fs::read_to_string(path) {
        Ok(golden) => first_difference(&golden, text).map(|difference| format!("{} {difference}", path.display())),
        Err(e) => Some(format!("{}: {e}", path.display())),
    }
}

fn first_difference(golden: &str, text: &str) -> Option<String> {
    let (mut was, mut now) = (golden.lines(), text.lines());
    for line in 1.. {
        match (was.next(), now.next()) {
            (None, None) => return None,
            (Some(was), Some(now)) if is_same(was, now) => {}
            (was, now) => {
                let [was, now] = [was, now].map(|line| line.unwrap_or("(end)"));
                return Some(format!("line {line}\nwas: {was}\nnow: {now}"));
            }
        }
    }
    None
}

/// One tag per line, long ones cut; style sheets and scripts are left out.
#[must_use]
pub fn one_tag_per_line(html: &str) -> String {
    let without = |html: &str, name: &str| -> String {
        let (open, close) = (format!("<{name}"), format!("</{name}>"));
        html.split(&open)
            .enumerate()
            .map(|(k, part)| if k == 0 { part } else { part.split_once(&close).map_or("", |p| p.1) })
            .collect()
    };
    let html = without(&without(html, "style"), "script");
    let line = |tag: &str| {
        let kept: String = tag.chars().take(TAG).collect();
        if tag.starts_with('/') { format!("<{kept}") } else { format!("\n<{kept}") }
    };
    html.split('<').skip(1).map(line).collect()
}

/// One value of a record per line, with its path. Numbers have four significant digits. A long array of numbers is shown
/// by its length, first and last, mean, and rms about the mean.
#[must_use]
pub fn one_value_per_line(record: &Value) -> String {
    let mut text = String::new();
    add(&mut text, "", record);
    text
}

fn add(text: &mut String, path: &str, value: &Value) {
    match value {
        Value::Object(fields) => fields.iter().for_each(|(name, value)| add(text, &format!("{path}.{name}"), value)),
        Value::Array(items) => match long_series(items) {
            Some(statistics) => _ = writeln!(text, "{path}: {statistics}"),
            None => items.iter().enumerate().for_each(|(k, item)| add(text, &format!("{path}[{k}]"), item)),
        },
        Value::Number(number) => _ = writeln!(text, "{path}: {}", rounded(number.as_f64().unwrap_or(f64::NAN))),
        other => _ = writeln!(text, "{path}: {other}"),
    }
}

fn long_series(items: &[Value]) -> Option<String> {
    let numbers: Vec<f64> = items.iter().map(Value::as_f64).collect::<Option<_>>()?;
    let (first, last) = (numbers.first()?, numbers.last()?);
    let n = numbers.len() as f64;
    let mean = numbers.iter().sum::<f64>() / n;
    let rms = (numbers.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n).sqrt();
    let [first, last, mean, rms] = [*first, *last, mean, rms].map(rounded);
    (numbers.len() > LONGEST).then(|| format!("{n} numbers, {first} to {last}, mean {mean}, rms {rms}"))
}

/// What is below 1e-9 is rounding noise.
fn rounded(number: f64) -> String {
    if number.abs() < 1e-9 { "0".to_owned() } else { format!("{number:.3e}") }
}

fn is_same(old: &str, new: &str) -> bool {
    let (old, new) = (tokens(old), tokens(new));
    old.len() == new.len() && old.iter().zip(&new).all(|(old, new)| old == new || are_close(old, new))
}

/// Numbers, and the texts between them.
fn tokens(line: &str) -> Vec<&str> {
    let is_number = |c: char| c.is_ascii_digit() || c == '.';
    let mut tokens: Vec<&str> = vec![];
    let mut rest = line;
    while let Some(first) = rest.chars().next() {
        let end = rest.find(|c| is_number(c) != is_number(first)).unwrap_or(rest.len());
        let (token, after) = rest.split_at(end);
        tokens.push(token);
        rest = after;
    }
    tokens
}

fn are_close(old: &str, new: &str) -> bool {
    let decimals = |text: &str| text.split_once('.').map_or(0, |(_, digits)| digits.len());
    let most = decimals(old).max(decimals(new));
    match (old.parse::<f64>(), new.parse::<f64>()) {
        // Whole numbers are counts and exponents.
        (Ok(a), Ok(b)) => most > 0 && (a - b).abs() < 1.5 * 0.1_f64.powi(most as i32),
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_last_digit_of_a_number_may_differ() {
        assert!(is_same("M 12.34 5.6", "M 12.35 5.6"));
        assert!(is_same("U 3", "U 3"));
        for other in ["M 12.36 5.6", "L 12.34 5.6", "M 12.34", "M 12.34 5.6 7", "M -12.34 5.6"] {
            assert!(!is_same("M 12.34 5.6", other), "{other}");
        }
        assert!(!is_same("3 flights", "4 flights") && !is_same("1.000e0", "1.000e1"));
    }

    #[test]
    fn records_have_a_line_for_each_value_and_statistics_of_long_arrays() {
        let long: Vec<f64> = (0..21).map(f64::from).collect();
        let record = serde_json::json!({"a": {"b": [1.23456, null]}, "c": long, "d": "x", "e": 1e-12});
        // Mean of 0 to 20, and the square root of (21² − 1)/12.
        let expected = ".a.b[0]: 1.235e0\n.a.b[1]: null\n\
                        .c: 21 numbers, 0 to 2.000e1, mean 1.000e1, rms 6.055e0\n.d: \"x\"\n.e: 0\n";
        assert_eq!(one_value_per_line(&record), expected);
    }

    #[test]
    fn tags_stand_on_lines_of_their_own_without_style_and_script() {
        let html = "<style>a{}</style><p class=\"x\">one<b>two</b></p><script>if (a<b) {}</script><i>3</i>";
        assert_eq!(one_tag_per_line(html), "\n<p class=\"x\">one\n<b>two</b></p>\n<i>3</i>");
    }

    #[test]
    fn the_first_other_line_is_named() {
        let golden = "a\nb 1.0\n";
        assert_eq!(first_difference(golden, "a\nb 1.0\n"), None);
        assert_eq!(first_difference(golden, "a\nb 1.1\nc"), Some("line 3\nwas: (end)\nnow: c".to_owned()));
        assert_eq!(first_difference(golden, "a"), Some("line 2\nwas: b 1.0\nnow: (end)".to_owned()));
    }
}
