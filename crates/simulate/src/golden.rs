//! Golden texts: what the program wrote once, looked at by a person, and compared with what it writes now.
//!
//! A golden text only says that nothing changed. It covers layout, wording and the numbers of a whole record; what has a
//! known answer is also tested against that.

use serde_json::{Map, Value};
use std::cell::Cell;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write as _};
use std::path::Path;

/// More numbers than this are shown by their statistics.
const LONGEST: usize = 12;
/// Characters of a tag and its text that are kept.
const TAG: usize = 400;
/// Golden texts of one test.
const TEXTS: usize = 4;
/// What stands before the name of a golden text in the file of a module.
const HEADING: &str = "\n== ";

/// Compares a text with the golden one of the running test: its first text with the first, its second with the second, up
/// to the fourth. `folder` holds a file for each module of tests. Numbers with decimals may differ by one unit of their
/// last digit, because sine and cosine differ between systems. `FLIGHTLAG_BLESS=1` writes the texts.
///
/// Functions that many tests use to read or to compute call it, so what these tests see is frozen. Texts of threads that a
/// test starts are not compared, for their order is not known.
///
/// # Panics
/// If the text differs, or the file cannot be read or written.
#[track_caller]
pub fn assert_golden(folder: &Path, text: &str) {
    thread_local!(static COMPARED: Cell<usize> = const { Cell::new(0) });
    let thread = std::thread::current();
    // libtest runs each test in a thread that has its name.
    let Some(name) = thread.name().filter(|name| *name != "main") else { return };
    let (module, test) = name.rsplit_once("::").unwrap_or(("tests", name));
    let number = COMPARED.replace(COMPARED.get() + 1) + 1;
    if number > TEXTS {
        return;
    }
    let path = folder.join(format!("{}.txt", module.replace("::", "-")));
    let name = format!("{test} {number}");
    let text = text.trim_end();
    if std::env::var_os("FLIGHTLAG_BLESS").is_some() {
        return write_section(&path, name, text).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    }
    let golden = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let sections = sections(&golden);
    let golden = sections.get(&name).unwrap_or_else(|| panic!("{} has no {name}: run `just bless`", path.display()));
    let difference = first_difference(golden, text);
    assert!(difference.is_none(), "{}: {name}: {}", path.display(), difference.unwrap_or_default());
}

/// The golden texts of a module by their names.
fn sections(file: &str) -> BTreeMap<String, &str> {
    let parts = file.split(HEADING).filter_map(|part| part.split_once('\n'));
    parts.map(|(name, text)| (name.to_owned(), text.trim_end())).collect()
}

/// Writes one golden text. Other processes may write theirs into the same file meanwhile.
fn write_section(path: &Path, name: String, text: &str) -> io::Result<()> {
    std::fs::create_dir_all(path.parent().unwrap_or(Path::new(".")))?;
    let mut file = File::options().read(true).write(true).create(true).truncate(false).open(path)?;
    file.lock()?;
    let mut old = String::new();
    file.read_to_string(&mut old)?;
    let mut sections = sections(&old);
    sections.insert(name, text);
    let new: String = sections.iter().map(|(name, text)| format!("{HEADING}{name}\n{text}\n")).collect();
    file.seek(SeekFrom::Start(0))?;
    file.set_len(0)?;
    file.write_all(new.as_bytes())
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

/// One field of a record per line, with its path; of an array of records the values of all items. Numbers have four
/// significant digits. Many numbers are shown by their count, first and last, mean, and rms about the mean.
#[must_use]
pub fn one_field_per_line(record: &Value) -> String {
    let mut text = String::new();
    add(&mut text, "", &[record]);
    text
}

/// Adds a field, of one record or of all items of an array.
fn add(text: &mut String, path: &str, values: &[&Value]) {
    let fields: BTreeSet<&String> = values.iter().filter_map(|value| value.as_object()).flat_map(Map::keys).collect();
    for name in fields {
        let of: Vec<&Value> = values.iter().filter_map(|value| value.get(name)).collect();
        add(text, &format!("{path}.{name}"), &of);
    }
    let arrays: Vec<&Vec<Value>> = values.iter().filter_map(|value| value.as_array()).collect();
    if !arrays.is_empty() {
        add(text, &format!("{path}[]"), &arrays.into_iter().flatten().collect::<Vec<&Value>>());
    }
    let numbers: Vec<f64> = values.iter().filter_map(|value| value.as_f64()).collect();
    if !numbers.is_empty() {
        _ = writeln!(text, "{path}: {}", numbers_in_words(&numbers));
    }
    let others = values.iter().filter(|value| !(value.is_object() || value.is_array() || value.is_number()));
    let others: Vec<String> = others.map(ToString::to_string).collect();
    for same in others.chunk_by(|a, b| a == b) {
        _ = writeln!(text, "{path}: {} × {}", same.len(), same[0]);
    }
}

fn numbers_in_words(numbers: &[f64]) -> String {
    if numbers.len() <= LONGEST {
        return numbers.iter().map(|x| rounded(*x)).collect::<Vec<String>>().join(" ");
    }
    let n = numbers.len() as f64;
    let mean = numbers.iter().sum::<f64>() / n;
    let rms = (numbers.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n).sqrt();
    let [first, last, mean, rms] = [numbers[0], numbers[numbers.len() - 1], mean, rms].map(rounded);
    format!("{n} numbers, {first} to {last}, mean {mean}, rms {rms}")
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
    use serde_json::json;

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
    fn records_have_a_line_for_each_field_and_statistics_of_many_numbers() {
        let long: Vec<f64> = (0..21).map(f64::from).collect();
        let items = [json!({"d": 1, "e": "x"}), json!({"d": 2.5, "e": "x"}), json!({"d": null})];
        let record = json!({"a": {"b": [1.23456, null]}, "c": long, "f": items, "g": 1e-12});
        // Mean of 0 to 20, and the square root of (21² − 1)/12.
        let expected = ".a.b[]: 1.235e0\n.a.b[]: 1 × null\n\
                        .c[]: 21 numbers, 0 to 2.000e1, mean 1.000e1, rms 6.055e0\n\
                        .f[].d: 1.000e0 2.500e0\n.f[].d: 1 × null\n.f[].e: 2 × \"x\"\n.g: 0\n";
        assert_eq!(one_field_per_line(&record), expected);
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
