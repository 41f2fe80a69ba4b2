//! One settings file: its text, its values, and every complaint about it.

use crate::nearest::likely;
use crate::number::{unit_of_key, within};
use serde::de::DeserializeOwned;
use std::cell::RefCell;
use std::ops::Range;
use std::path::{Path, PathBuf};
use toml::Spanned;
use toml::de::{DeTable, DeValue, Deserializer, Error};

/// Maximum number of complaints listed for one file.
const MOST: usize = 20;

/// Placeholders for wrong or missing values, so that the rest of the file can be checked.
const PLACEHOLDERS: &str =
    r#"v = [1, "", false, {}, [], [1, 1], [1, 1, 1], ["", "", ""], [[1, 1, 1], [1, 1, 1], [1, 1, 1]]]"#;

/// What is wrong with a settings file, and where.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}{}: {what}", file.display(), line.map(|line| format!(":{line}")).unwrap_or_default())]
pub struct SettingsError {
    /// The file.
    pub file: PathBuf,
    /// Line, from 1, of the first complaint, if known.
    pub line: Option<usize>,
    /// What is wrong there and what would be right. Complaints about other lines follow, one per line, as
    /// `file:line: what`.
    pub what: String,
}

/// The text of a settings file.
///
/// # Errors
/// It cannot be read.
pub fn read_text(path: &Path) -> Result<String, SettingsError> {
    let unreadable = |e| SettingsError { file: path.to_owned(), line: None, what: format!("cannot be read: {e}") };
    std::fs::read_to_string(path).map_err(unreadable)
}

#[derive(Debug, Clone, PartialEq, Eq)]
struct Complaint {
    line: Option<usize>,
    what: String,
}

/// The [`SettingsFile`] already holds the complaint.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Refused;

/// A settings file while it is read and checked. Collects all complaints, so that one run reports them all.
#[derive(Debug)]
pub struct SettingsFile<'a> {
    text: &'a str,
    file: &'a Path,
    complaints: RefCell<Vec<Complaint>>,
    /// Byte ranges of values replaced by placeholders.
    replaced: RefCell<Vec<Range<usize>>>,
}

impl<'a> SettingsFile<'a> {
    /// A file with this text; `file` appears in complaints.
    #[must_use]
    pub fn new(text: &'a str, file: &'a Path) -> SettingsFile<'a> {
        SettingsFile { text, file, complaints: RefCell::default(), replaced: RefCell::default() }
    }

    /// Reads the file as `T`. Unknown keys, missing keys and values of a wrong type become complaints. Placeholders of
    /// the right type replace them so that other values can be checked too: call [`SettingsFile::finish`] before use.
    ///
    /// # Errors
    /// The text is not TOML, or nothing of the right type was found.
    pub fn read<T: DeserializeOwned>(&self) -> Result<T, Refused> {
        let mut table = self.table()?;
        while self.complaints.borrow().len() < MOST {
            let error = match T::deserialize(Deserializer::from(table.clone())) {
                Ok(value) => return Ok(value),
                Err(error) => error,
            };
            let is_within = |span: Range<usize>| {
                self.replaced.borrow().iter().any(|place| place.start <= span.start && span.end <= place.end)
            };
            if !error.span().is_some_and(is_within) {
                self.complaints.borrow_mut().push(complaint(&error, Some(table.get_ref()), self.text));
            }
            let past_end = self.text.len() + 1 + self.replaced.borrow().len();
            let Some((better, place)) = repaired::<T>(&table, &error, past_end) else { break };
            self.replaced.borrow_mut().extend(place);
            table = better;
        }
        Err(self.reject_whole("the rest of the file was not checked"))
    }

    /// The file as TOML, for checks that need the position of a value.
    ///
    /// # Errors
    /// The text is not TOML.
    pub fn table(&self) -> Result<Spanned<DeTable<'a>>, Refused> {
        DeTable::parse(self.text).map_err(|error| {
            self.complaints.borrow_mut().push(complaint(&error, None, self.text));
            Refused
        })
    }

    /// Complains about a value, unless it is or contains a placeholder, which already has its complaint.
    pub fn reject<T>(&self, at: &Spanned<T>, what: impl Into<String>) -> Refused {
        let span = at.span();
        let holds = |place: &Range<usize>| span.start <= place.start && place.end <= span.end;
        if !self.replaced.borrow().iter().any(holds) {
            self.complaints.borrow_mut().push(Complaint { line: Some(self.line_of(at)), what: what.into() });
        }
        Refused
    }

    /// Complains about a line, from 1.
    pub fn reject_line(&self, line: usize, what: impl Into<String>) -> Refused {
        self.complaints.borrow_mut().push(Complaint { line: Some(line), what: what.into() });
        Refused
    }

    /// Complains about the file as a whole.
    pub fn reject_whole(&self, what: impl Into<String>) -> Refused {
        self.complaints.borrow_mut().push(Complaint { line: None, what: what.into() });
        Refused
    }

    /// Rejects a layout other than 1.
    ///
    /// # Errors
    /// It is another one.
    pub fn known_layout(&self, schema: &Spanned<u32>) -> Result<(), Refused> {
        match schema.get_ref() {
            1 => Ok(()),
            _ => Err(self.reject(schema, "schema must be 1, the only version that this flightlag knows")),
        }
    }

    /// A number within its bounds; minus zero becomes zero.
    ///
    /// # Errors
    /// It is not.
    pub fn within(&self, value: &Spanned<f64>, key: &str, low: f64, high: f64) -> Result<f64, Refused> {
        within(key, *value.get_ref(), low, high).map_err(|what| self.reject(value, what))
    }

    /// The same for a number that may be missing.
    ///
    /// # Errors
    /// It is given, and not within its bounds.
    pub fn optional(
        &self,
        value: &Option<Spanned<f64>>,
        key: &str,
        low: f64,
        high: f64,
    ) -> Result<Option<f64>, Refused> {
        value.as_ref().map(|value| self.within(value, key, low, high)).transpose()
    }

    /// Whether anything was rejected so far.
    #[must_use]
    pub fn has_complaints(&self) -> bool {
        !self.complaints.borrow().is_empty()
    }

    /// The line, from 1, of a value.
    pub fn line_of<T>(&self, at: &Spanned<T>) -> usize {
        line_of(self.text, at.span().start)
    }

    /// The value, if there are no complaints.
    ///
    /// # Errors
    /// All complaints, by line.
    pub fn finish<T>(&self, value: Result<T, Refused>) -> Result<T, SettingsError> {
        let mut found = self.complaints.borrow().clone();
        found.sort_by_key(|complaint| complaint.line.unwrap_or(usize::MAX));
        found.dedup();
        let more = found.len().saturating_sub(MOST + 1);
        let mut found = found.into_iter().take(MOST + 1);
        match (value, found.next()) {
            (Ok(value), None) => Ok(value),
            (_, first) => {
                let Complaint { line, mut what } = first.unwrap_or(Complaint { line: None, what: String::new() });
                let file = self.file.display();
                for other in found {
                    let line = other.line.map(|line| format!(":{line}")).unwrap_or_default();
                    what += &format!("\n{file}{line}: {}", other.what);
                }
                if more > 0 {
                    what += &format!("\n{file}: {more} more errors are not listed");
                }
                Err(SettingsError { file: self.file.to_owned(), line, what })
            }
        }
    }
}

/// The table with the cause of the error corrected, and the byte range of the placeholder, if any. A missing key has no
/// bytes: it gets the byte `past_end`, which is after the text and belongs to no other placeholder.
fn repaired<'t, T: DeserializeOwned>(
    table: &Spanned<DeTable<'t>>,
    error: &Error,
    past_end: usize,
) -> Option<(Spanned<DeTable<'t>>, Option<Range<usize>>)> {
    let span = error.span()?;
    let message = error.message();
    if let Some((name, known)) = quoted_name("unknown field", message) {
        let mut table = table.clone();
        return correct(table.get_mut(), span.start, likely(name, known)).then_some((table, None));
    }
    let missing = quoted_name("missing field", message).map(|(name, _)| name);
    let place = if missing.is_some() { past_end..past_end } else { span.clone() };
    let word = quoted_name("unknown variant", message).and_then(|(name, known)| {
        let word = likely(name, known.iter().copied()).or(known.first().copied())?;
        Some(DeValue::String(word.to_owned().into()))
    });
    let helps = |table: &Spanned<DeTable<'t>>| match T::deserialize(Deserializer::from(table.clone())) {
        Ok(_) => true,
        Err(next) => {
            let is_there = next.span().is_some_and(|at| at == place || at == span);
            let misses_other = next.message().starts_with("missing field") && next.message() != message;
            !is_there || misses_other
        }
    };
    word.into_iter().chain(placeholders()).find_map(|placeholder| {
        let mut table = table.clone();
        let value = placed(placeholder, &place);
        match missing {
            Some(key) => insert(&mut table, &span, key, value)?,
            None => *value_at(table.get_mut(), &span)? = value,
        }
        helps(&table).then(|| (table, Some(place.clone())))
    })
}

fn placeholders() -> impl Iterator<Item = DeValue<'static>> {
    let table = DeTable::parse(PLACEHOLDERS).map(Spanned::into_inner).unwrap_or_default();
    let values = table.into_iter().filter_map(|(_, value)| match value.into_inner() {
        DeValue::Array(values) => Some(values),
        _ => None,
    });
    values.flat_map(|values| values.iter().map(|value| value.get_ref().clone()).collect::<Vec<_>>())
}

/// A value all of whose parts are at `place`.
fn placed<'t>(mut value: DeValue<'t>, place: &Range<usize>) -> Spanned<DeValue<'t>> {
    if let DeValue::Array(array) = &mut value {
        for part in array.iter_mut() {
            *part = placed(part.get_ref().clone(), place);
        }
    }
    Spanned::new(place.clone(), value)
}

/// Puts a key into the table at `span`.
fn insert<'t>(
    root: &mut Spanned<DeTable<'t>>,
    span: &Range<usize>,
    key: &str,
    value: Spanned<DeValue<'t>>,
) -> Option<()> {
    let key = Spanned::new(value.span(), key.to_owned().into());
    if root.span() == *span {
        root.get_mut().insert(key, value);
        return Some(());
    }
    match value_at(root.get_mut(), span)?.get_mut() {
        DeValue::Table(table) => {
            table.insert(key, value);
            Some(())
        }
        _ => None,
    }
}

/// The value at `span`, in the table or in a nested one.
fn value_at<'b, 't>(table: &'b mut DeTable<'t>, span: &Range<usize>) -> Option<&'b mut Spanned<DeValue<'t>>> {
    table.iter_mut().find_map(|(_, value)| value_in(value, span))
}

fn value_in<'b, 't>(value: &'b mut Spanned<DeValue<'t>>, span: &Range<usize>) -> Option<&'b mut Spanned<DeValue<'t>>> {
    // A list of tables has the same start as its first table.
    let is_first_table = |one: &Spanned<DeValue<'_>>| one.span() == *span && matches!(one.get_ref(), DeValue::Table(_));
    let holds_it = matches!(value.get_ref(), DeValue::Array(array) if array.iter().any(is_first_table));
    if value.span() == *span && !holds_it {
        return Some(value);
    }
    match value.get_mut() {
        DeValue::Table(table) => value_at(table, span),
        DeValue::Array(array) => array.iter_mut().find_map(|value| value_in(value, span)),
        _ => None,
    }
}

/// The first name after these words, and the remaining names.
fn quoted_name<'m>(words: &str, message: &'m str) -> Option<(&'m str, Vec<&'m str>)> {
    let (name, rest) = message.strip_prefix(words)?.strip_prefix(" `")?.split_once('`')?;
    Some((name, quoted(rest)))
}

/// Renames the key that starts at a byte, in the table or in a nested one, to the likely name. Without one, removes the
/// key. So a typo gives one complaint, and not a second one about a missing key.
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

/// The parser's error as a complaint in our words, with its line.
fn complaint(error: &Error, table: Option<&DeTable<'_>>, text: &str) -> Complaint {
    let message = error.message();
    let what = match (quoted_name("unknown field", message), quoted_name("unknown variant", message)) {
        (Some((name, known)), _) => unknown_key(name, &known),
        (_, Some((name, known))) => {
            let near = likely(name, known).map(|near| format!("; did you mean `{near}`?"));
            message.replacen("unknown variant", "unknown value", 1) + &near.unwrap_or_default()
        }
        _ => wrong_type(error, table, text).unwrap_or_else(|| message.replace("missing field", "missing key")),
    };
    let line = error.span().map(|span| line_of(text, span.start));
    Complaint { line, what: what.trim_end().replace('\n', ": ") }
}

/// `key = value: must be a number in s`, for a value of another type.
fn wrong_type(error: &Error, table: Option<&DeTable<'_>>, text: &str) -> Option<String> {
    let (found, expected) = error.message().strip_prefix("invalid ")?.split_once(", expected ")?;
    let span = error.span()?;
    let path = path_to(table?, &span)?;
    let value = text.get(span).filter(|value| value.len() <= 40 && !value.contains('\n'));
    let right = match expected {
        "f32" | "f64" => "a number",
        whole if whole.trim_start_matches(['u', 'i']).parse::<u8>().is_ok() => "a whole number",
        "usize" | "isize" => "a whole number",
        "path string" => "a string",
        "a boolean" => "true or false",
        "a sequence" => "a list",
        "a map" => "a table",
        table if table.starts_with("struct ") => "a table",
        other => other,
    };
    let unit = match right {
        "a number" | "a whole number" => unit_of_key(&path),
        _ => "",
    };
    let unit = if unit.is_empty() { String::new() } else { format!(" in{unit}") };
    Some(match value {
        Some(value) => format!("{path} = {value}: must be {right}{unit}"),
        None => {
            format!("{path}: must be {right}{unit}, not {}", found.split_once(": ").map_or(found, |(_, kind)| kind))
        }
    })
}

/// The path of keys to the value at `span`, as `delay.position_s`.
fn path_to(table: &DeTable<'_>, span: &Range<usize>) -> Option<String> {
    table.iter().find_map(|(key, value)| {
        let below = path_below(value, span)?;
        Some(if below.is_empty() { key.get_ref().to_string() } else { format!("{}.{below}", key.get_ref()) })
    })
}

fn path_below(value: &Spanned<DeValue<'_>>, span: &Range<usize>) -> Option<String> {
    if value.span() == *span {
        return Some(String::new());
    }
    match value.get_ref() {
        DeValue::Table(table) => path_to(table, span),
        DeValue::Array(array) => array.iter().find_map(|value| path_below(value, span)),
        _ => None,
    }
}

/// The names between backticks.
fn quoted(message: &str) -> Vec<&str> {
    message.split('`').skip(1).step_by(2).collect()
}

/// Message for an unknown key: the likely key, else the known keys of that table.
fn unknown_key(name: &str, known: &[&str]) -> String {
    match likely(name, known.iter().copied()) {
        Some(near) => format!("unknown key `{name}`: did you mean `{near}`?"),
        None if known.is_empty() => format!("unknown key `{name}`: no keys are allowed here"),
        None => format!("unknown key `{name}`; the keys here are `{}`", known.join("`, `")),
    }
}

/// The line, from 1, of a byte.
fn line_of(text: &str, byte: usize) -> usize {
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
        search_s: Option<Spanned<[f64; 2]>>,
    }

    #[derive(Debug, serde::Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Part {
        length_m: Spanned<f64>,
        #[expect(dead_code)]
        width_m: Option<f64>,
    }

    #[derive(Debug, serde::Deserialize)]
    #[serde(rename_all = "lowercase")]
    enum Mode {
        Warm,
        Cold,
    }

    /// Reads and checks a file as the callers do: every length must be above zero.
    fn read(text: &str) -> Result<Whole, SettingsError> {
        let file = SettingsFile::new(text, Path::new("p.toml"));
        file.finish(file.read::<Whole>().inspect(|whole| {
            for part in whole.part.iter().filter(|part| *part.length_m.get_ref() <= 0.0) {
                file.reject(&part.length_m, "length_m must be above zero");
            }
        }))
    }

    fn refused(text: &str) -> SettingsError {
        read(text).unwrap_err()
    }

    #[test]
    fn one_run_reports_every_unknown_key_with_its_line_and_the_nearest_name() {
        let found = refused("titel = \"x\"\n[[part]]\nlength_m = 1\n[[part]]\nlenght_m = 2\ncolour = \"red\"\n");
        assert_eq!(found.line, Some(1));
        assert_eq!(
            found.what,
            "unknown key `titel`: did you mean `title`?\n\
             p.toml:5: unknown key `lenght_m`: did you mean `length_m`?\n\
             p.toml:6: unknown key `colour`; the keys here are `length_m`, `width_m`"
        );
    }

    #[test]
    fn one_run_reports_wrong_types_missing_keys_typos_and_values_out_of_range() {
        let text = "mode = \"wram\"\nsearch_s = [0, \"1 s\"]\n[[part]]\nlength_m = -1\n[[part]]\nwidth_m = \"2\"\n\
                    [[part]]\nlenght_m = 0\nwidth_m = true\n";
        let found = refused(text);
        let lines: Vec<&str> = found.what.lines().collect();
        assert_eq!(
            lines,
            [
                "unknown value `wram`, expected `warm` or `cold`; did you mean `warm`?",
                "p.toml:1: missing key `title`",
                "p.toml:2: search_s = \"1 s\": must be a number in s",
                "p.toml:4: length_m must be above zero",
                "p.toml:5: missing key `length_m`",
                "p.toml:6: part.width_m = \"2\": must be a number in m",
                "p.toml:8: unknown key `lenght_m`: did you mean `length_m`?",
                "p.toml:8: length_m must be above zero",
                "p.toml:9: part.width_m = true: must be a number in m",
            ]
        );
    }

    #[test]
    fn a_placeholder_for_a_wrong_value_gets_no_complaint() {
        let found = refused("title = \"x\"\n[[part]]\nlength_m = \"long\"\n[[part]]\n");
        assert_eq!(found.what, "part.length_m = \"long\": must be a number in m\np.toml:4: missing key `length_m`");
    }

    #[test]
    fn a_missing_key_in_the_first_table_of_a_list_does_not_hide_others() {
        let found = refused("title = \"x\"\n[[part]]\nwidth_m = 1\n[[part]]\nwidth_m = \"2\"\n");
        assert_eq!(found.line, Some(2));
        let lines: Vec<&str> = found.what.lines().collect();
        assert_eq!(
            lines,
            [
                "missing key `length_m`",
                "p.toml:4: missing key `length_m`",
                "p.toml:5: part.width_m = \"2\": must be a number in m",
            ]
        );
    }

    #[test]
    fn every_missing_key_of_a_table_is_reported() {
        #[derive(Debug, serde::Deserialize)]
        #[expect(dead_code)]
        struct Pair {
            first: Part,
            second: String,
        }
        let file = SettingsFile::new("# nothing\n", Path::new("p.toml"));
        let found = file.finish(file.read::<Pair>()).unwrap_err();
        assert_eq!(found.what, "missing key `first`\np.toml:1: missing key `second`");
    }

    #[test]
    fn a_wrong_value_does_not_hide_a_missing_key() {
        #[derive(Debug, serde::Deserialize)]
        #[expect(dead_code)]
        struct Card {
            sensor: Part,
            rig: String,
            method: String,
        }
        let file = SettingsFile::new("version = 1\nsensor = 3\n", Path::new("p.toml"));
        let found = file.finish(file.read::<Card>()).unwrap_err();
        let lines: Vec<&str> = found.what.lines().collect();
        let expected = ["missing key `rig`", "p.toml:1: missing key `method`", "p.toml:2: sensor = 3: must be a table"];
        assert_eq!(lines, expected);
    }

    #[test]
    fn a_key_that_is_missing_because_of_a_typo_is_reported_once() {
        let found = refused("[[part]]\nwidht_m = 1\n");
        assert!(found.what.contains("did you mean `width_m`?") && found.what.contains("missing key `length_m`"));
        assert_eq!(refused("titel = \"x\"\n").what.matches("title").count(), 1);
    }

    #[test]
    fn text_that_is_not_toml_is_reported_with_its_line() {
        assert_eq!(refused("title = \"x\"\nmode = \n").line, Some(2));
        assert_eq!(refused("title").what.lines().count(), 1);
        assert_eq!(refused("title = \"x\"\nmode = 3\n").line, Some(2));
    }

    #[test]
    fn the_list_of_many_unknown_keys_is_limited() {
        let text: String = (0..100).map(|n| format!("z{n} = 1\n")).collect();
        let found = refused(&text);
        assert_eq!(found.what.matches("unknown key").count(), MOST);
        assert!(found.what.ends_with("p.toml: the rest of the file was not checked"), "{}", found.what);
        let parts: String = (0..100).map(|_| "[[part]]\nlength_m = 0\n").collect();
        let found = refused(&format!("title = \"x\"\n{parts}"));
        assert!(found.what.ends_with("p.toml: 79 more errors are not listed"), "{}", found.what);
    }

    #[test]
    fn a_correct_file_is_read() {
        let whole = read("title = \"x\"\nmode = \"cold\"\n[[part]]\nlength_m = 2\n").unwrap();
        assert!(whole.part.len() == 1 && matches!(whole.mode, Some(Mode::Cold)));
        assert!(matches!(read("title = \"\"\nmode = \"warm\"").unwrap().mode, Some(Mode::Warm)));
    }
}
