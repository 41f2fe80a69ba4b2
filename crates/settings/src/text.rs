//! TOML text: values, or complaints with their lines.

use crate::nearest::likely;
use serde::de::DeserializeOwned;
use toml::Spanned;
use toml::de::{DeTable, DeValue, Deserializer, Error};

/// Most complaints about one file; what comes after them is seldom news.
const MOST: usize = 10;

/// What is wrong with a settings file, and where.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Complaint {
    /// Line, from 1, of the first that is wrong.
    pub line: Option<usize>,
    /// What is wrong there, what would be right, and the same of other lines.
    pub what: String,
}

/// Reads a file as `T`. One error names all its unknown keys.
///
/// # Errors
/// No TOML, an unknown or missing key, or a value of another type.
pub fn read<T: DeserializeOwned>(text: &str) -> Result<T, Complaint> {
    let mut table = DeTable::parse(text).map_err(|e| complaint(&e, text))?;
    let mut found = vec![];
    loop {
        let error = match T::deserialize(Deserializer::from(table.clone())) {
            Ok(value) if found.is_empty() => return Ok(value),
            Ok(_) => return Err(all(found)),
            Err(error) => error,
        };
        found.push(complaint(&error, text));
        let at = error.span().zip(unknown(error.message()));
        let go_on = at.is_some_and(|(span, (name, known))| correct(table.get_mut(), span.start, likely(name, known)));
        if !go_on {
            return Err(all(found));
        }
        if found.len() == MOST {
            let Complaint { line, what } = all(found);
            return Err(Complaint { line, what: what + "; the rest of the file was not checked" });
        }
    }
}

/// The unknown key, and the known ones in its place.
fn unknown(message: &str) -> Option<(&str, Vec<&str>)> {
    let (name, rest) = message.strip_prefix("unknown field `")?.split_once('`')?;
    Some((name, quoted(rest)))
}

fn all(mut complaints: Vec<Complaint>) -> Complaint {
    complaints.sort_by_key(|complaint| complaint.line);
    let mut complaints = complaints.into_iter();
    let first = complaints.next().unwrap_or(Complaint { line: None, what: String::new() });
    let told = |other: Complaint| match other.line {
        Some(line) => format!("; line {line}: {}", other.what),
        None => format!("; {}", other.what),
    };
    let others: String = complaints.map(told).collect();
    Complaint { line: first.line, what: first.what + &others }
}

/// Gives the key that begins at a byte, in the table or below it, the name that was meant; without one the key goes. So one
/// typo is one complaint, and not also a missing key.
fn correct(table: &mut DeTable<'_>, start: usize, meant: Option<&str>) -> bool {
    let Some(key) = table.keys().find(|key| key.span().start == start).cloned() else {
        return table.iter_mut().any(|(_, value)| correct_in(value, start, meant));
    };
    let value = table.remove(&key);
    if let (Some(value), Some(meant)) = (value, meant.filter(|meant| table.keys().all(|k| k.get_ref() != meant))) {
        table.insert(Spanned::new(key.span(), meant.to_owned().into()), value);
    }
    true
}

fn correct_in(value: &mut Spanned<DeValue<'_>>, start: usize, meant: Option<&str>) -> bool {
    match value.get_mut() {
        DeValue::Table(table) => correct(table, start, meant),
        DeValue::Array(array) => array.iter_mut().any(|value| correct_in(value, start, meant)),
        _ => false,
    }
}

/// The parser's own complaint, in our words and with its line.
#[must_use]
pub fn complaint(error: &Error, text: &str) -> Complaint {
    let message = error.message();
    let what = match unknown(message) {
        Some((name, known)) => unknown_key(name, &known),
        None => {
            with_likely(&message.replace("missing field", "missing key").replace("unknown variant", "unknown value"))
        }
    };
    Complaint { line: error.span().map(|span| line_of(text, span.start)), what: what.trim_end().replace('\n', ": ") }
}

/// `unknown value ..., expected one of ...` with the value that may have been meant.
fn with_likely(message: &str) -> String {
    let unknown = message.strip_prefix("unknown value `").and_then(|rest| rest.split_once('`'));
    match unknown.and_then(|(name, rest)| likely(name, quoted(rest))) {
        Some(near) => format!("{message}; did you mean `{near}`?"),
        None => message.to_owned(),
    }
}

/// The names between grave accents.
fn quoted(message: &str) -> Vec<&str> {
    message.split('`').skip(1).step_by(2).collect()
}

/// Message for an unknown key: the key that was probably meant, else the known ones in its place.
#[must_use]
pub fn unknown_key(name: &str, known: &[&str]) -> String {
    match likely(name, known.iter().copied()) {
        Some(near) => format!("unknown key `{name}`: did you mean `{near}`?"),
        None if known.is_empty() => format!("unknown key `{name}`: no key is known here"),
        None => format!("unknown key `{name}`; the keys here are `{}`", known.join("`, `")),
    }
}

/// The line, from 1, of a byte.
#[must_use]
pub fn line_of(text: &str, byte: usize) -> usize {
    text.bytes().take(byte).filter(|&b| b == b'\n').count() + 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, serde::Deserialize)]
    #[serde(deny_unknown_fields)]
    #[expect(dead_code)]
    struct Whole {
        title: String,
        #[serde(default)]
        part: Vec<Part>,
        mode: Option<Mode>,
    }

    #[derive(Debug, serde::Deserialize)]
    #[serde(deny_unknown_fields)]
    #[expect(dead_code)]
    struct Part {
        length_m: f64,
        width_m: Option<f64>,
    }

    #[derive(Debug, serde::Deserialize)]
    #[serde(rename_all = "lowercase")]
    enum Mode {
        Warm,
        Cold,
    }

    fn refused(text: &str) -> Complaint {
        read::<Whole>(text).unwrap_err()
    }

    #[test]
    fn every_unknown_key_of_a_file_is_told_in_one_run_with_its_line_and_the_nearest_name() {
        let told = refused("titel = \"x\"\n[[part]]\nlength_m = 1\n[[part]]\nlenght_m = 2\ncolour = \"red\"\n");
        assert_eq!(told.line, Some(1));
        assert_eq!(
            told.what,
            "unknown key `titel`: did you mean `title`?; \
             line 5: unknown key `lenght_m`: did you mean `length_m`?; \
             line 6: unknown key `colour`; the keys here are `length_m`, `width_m`"
        );
    }

    #[test]
    fn a_key_that_is_missing_for_a_typo_is_told_once_and_any_other_is_told_too() {
        let told = refused("[[part]]\nwidht_m = 1\n");
        assert!(
            told.what.contains("did you mean `width_m`?") && told.what.contains("missing key `length_m`"),
            "{told:?}"
        );
        assert_eq!(refused("titel = \"x\"\n").what.matches("title").count(), 1);
    }

    #[test]
    fn a_value_of_another_type_or_an_unknown_word_has_its_line() {
        let wrong = refused("title = \"x\"\nmode = \"wram\"\n");
        assert_eq!(wrong.line, Some(2));
        assert_eq!(wrong.what, "unknown value `wram`, expected `warm` or `cold`; did you mean `warm`?");
        assert_eq!(refused("title = 3\n").line, Some(1));
        assert_eq!(refused("title = \"x\"\nmode = \n").line, Some(2));
        assert!(refused("title").what.lines().count() == 1);
    }

    #[test]
    fn many_unknown_keys_end_the_list() {
        let text: String = (0..100).map(|n| format!("z{n} = 1\n")).collect();
        let told = refused(&text);
        assert!(
            told.what.matches("unknown key").count() == MOST && told.what.ends_with("not checked"),
            "{}",
            told.what
        );
    }

    #[test]
    fn a_right_file_is_read() {
        let whole = read::<Whole>("title = \"x\"\nmode = \"cold\"\n[[part]]\nlength_m = 2\n").unwrap();
        assert!(whole.part.len() == 1 && matches!(whole.mode, Some(Mode::Cold)));
        assert!(matches!(read::<Whole>("title = \"\"\nmode = \"warm\"").unwrap().mode, Some(Mode::Warm)));
    }
}
