//! The values of a YAML file, each with its parent keys. Anchors are not followed, so that no file can expand into a
//! larger one.

use saphyr_parser::{Event, Parser};

/// Deepest nesting of collections that is followed.
const DEEPEST: usize = 64;

/// Key that represents a list element.
pub(super) const ELEMENT: &str = "-";

/// A collection that has not ended.
enum Open {
    /// With the key of the next value.
    Map(Option<String>),
    List,
}

impl Open {
    fn key(&self) -> &str {
        match self {
            Open::Map(key) => key.as_deref().unwrap_or_default(),
            Open::List => ELEMENT,
        }
    }
}

/// Passes on every value with its parent keys from the outermost on, and `None` where a collection begins.
///
/// # Errors
/// Where and why the file is not valid YAML, or nested too deeply; everything before that has been passed on.
pub(super) fn walk(text: &str, mut take: impl FnMut(&[&str], Option<&str>)) -> Result<(), String> {
    let mut open: Vec<Open> = vec![];
    let text = text.trim_start_matches('\u{feff}');
    for event in Parser::new_from_str(text) {
        let (event, span) = event.map_err(|e| format!("line {}: {}", e.marker().line(), e.info()))?;
        let value = match &event {
            Event::Scalar(value, ..) => Some(Some(value.as_ref())),
            Event::Alias(_) => Some(Some("")),
            Event::MappingStart(..) | Event::SequenceStart(..) => Some(None),
            Event::MappingEnd | Event::SequenceEnd => {
                open.pop();
                end_value(&mut open);
                None
            }
            _ => None,
        };
        let Some(value) = value else { continue };
        if let (Some(Open::Map(key @ None)), Some(name)) = (open.last_mut(), value) {
            *key = Some(name.to_owned());
            continue;
        }
        let path: Vec<&str> = open.iter().map(Open::key).collect();
        take(&path, value);
        match event {
            Event::MappingStart(..) | Event::SequenceStart(..) if open.len() >= DEEPEST => {
                return Err(format!("line {}: nested more than {DEEPEST} levels deep", span.start.line()));
            }
            Event::MappingStart(..) => open.push(Open::Map(None)),
            Event::SequenceStart(..) => open.push(Open::List),
            _ => end_value(&mut open),
        }
    }
    Ok(())
}

/// The value of a key is complete: another key comes next.
fn end_value(open: &mut [Open]) {
    if let Some(Open::Map(key)) = open.last_mut() {
        *key = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn values(text: &str) -> (Vec<String>, Result<(), String>) {
        let mut found = vec![];
        let end = walk(text, |path, value| found.push(format!("{}={}", path.join("."), value.unwrap_or("("))));
        (found, end)
    }

    #[test]
    fn values_have_their_parent_keys_in_every_notation() {
        let expected = ["=(", "a=(", "a.b=1", "a.c=(", "a.c.-=x y", "a.c.-=(", "a.c.-.d=2", "e="];
        for text in [
            "a:\n  b: 1\n  c:\n  - x y\n  - d: 2\ne: ''\n",
            "\u{feff}{\"a\": {\"b\": 1, \"c\": [\"x y\", {\"d\": 2}]}, \"e\": \"\"}",
            "# mine\r\na: {b: 1, c: [x y, d: 2]} # all\r\ne: \"\"\r\n",
        ] {
            assert_eq!(values(text), (expected.map(str::to_owned).into(), Ok(())), "{text}");
        }
    }

    #[test]
    fn values_before_damage_are_passed_on_and_no_file_expands() {
        let (found, end) = values("a: 1\nb: [2, 3\nc: }\n");
        assert_eq!(found[..2], ["=(", "a=1"]);
        assert!(end.unwrap_err().starts_with("line "));
        for hostile in ["[".repeat(1 << 20), "- ".repeat(1 << 20), "? ".repeat(1 << 20), "{a: ".repeat(1 << 18)] {
            assert!(values(&hostile).1.is_err(), "{:.8}", hostile);
        }
        // Each alias would be ten of the previous ones.
        let bomb = "a: &a [x,x]\nb: &b [*a,*a]\nc: [*b,*b]\n";
        assert_eq!(values(bomb).0.len(), 10);
    }

    #[test]
    fn no_flipped_bit_of_a_file_causes_a_panic() {
        let text = "root:\n  list:\n    - \"a\": {b: [1, 'c']}\n      d: |\n        text\n    - *x\n  e: &y 5 # six\n";
        for bit in 0..8 * text.len() {
            let mut bytes = text.as_bytes().to_vec();
            bytes[bit / 8] ^= 1 << (bit % 8);
            let _ = values(&String::from_utf8_lossy(&bytes));
        }
    }
}
