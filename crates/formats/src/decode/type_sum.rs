//! The MD5 sum by which ROS 1 identifies a message type.
//!
//! It is computed from a text without comments and packages (`genmsg.gentools.compute_md5_text`): first the constants,
//! as `type name=value`, then the fields, as `type name`. Names of message types are replaced by their sums.

use super::schema::{Dialect, Names, Section, array, message_type, sections};
use md5::{Digest, Md5};
use std::collections::HashMap;
use std::fmt::Write;

/// Messages nested deeper than this are rejected.
const MOST_NESTED: usize = 32;
/// The sum of a message without fields.
pub(crate) const MD5_OF_NOTHING: &str = "d41d8cd98f00b204e9800998ecf8427e";

/// The sum of the type `root`, from its definition and those of all types that it uses.
///
/// # Errors
/// If a type is undefined or contains itself, or a line is neither a field nor a constant.
pub(crate) fn type_sum(root: &str, text: &str) -> Result<String, String> {
    let sections = sections(root, text);
    Sums { names: Names::of(&sections), sections: &sections, known: HashMap::new() }.section(0, 0)
}

struct Sums<'t> {
    sections: &'t [Section<'t>],
    names: Names,
    known: HashMap<usize, String>,
}

impl Sums<'_> {
    fn section(&mut self, index: usize, depth: usize) -> Result<String, String> {
        if let Some(sum) = self.known.get(&index) {
            return Ok(sum.clone());
        }
        let Some(section) = self.sections.get(index) else { return Err("a type is not defined".to_owned()) };
        if depth > MOST_NESTED {
            return Err(format!("{}: nested more than {MOST_NESTED} deep", section.name));
        }
        let (mut constants, mut fields) = (vec![], vec![]);
        for line in &section.lines {
            match line.split('#').next().unwrap_or_default().trim() {
                "" => {}
                code if code.contains('=') => constants.push(constant(line, code)),
                code => fields.push(self.field(&section.name, code, depth)?),
            }
        }
        constants.extend(fields);
        let sum = hex(&Md5::digest(constants.join("\n").trim()));
        self.known.insert(index, sum.clone());
        Ok(sum)
    }

    fn field(&mut self, owner: &str, code: &str, depth: usize) -> Result<String, String> {
        let bad = || format!("{owner}: {code:.100}: neither a field nor a constant");
        let (written, name) = code.split_once(char::is_whitespace).ok_or_else(bad)?;
        let (base, _) = array(written)?;
        let Some(full) = message_type(owner, base, Dialect::Ros1) else {
            return Ok(format!("{written} {}", name.trim()));
        };
        let section = self.names.section(&full).ok_or_else(|| format!("{owner}: the type {full} is not defined"))?;
        Ok(format!("{} {}", self.section(section, depth + 1)?, name.trim()))
    }
}

/// A text may contain `#` and keeps its inner spaces.
fn constant(line: &str, code: &str) -> String {
    let written = if code.starts_with("string ") { line } else { code };
    let (front, value) = written.split_once('=').unwrap_or((written, ""));
    let (kind, name) = front.split_once(char::is_whitespace).unwrap_or((front, ""));
    format!("{kind} {}={}", name.trim(), value.trim())
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn constants_come_first_and_comments_count_only_within_texts() {
        let text = "float64[9] a # covariance\n\n  Part[]   parts\nint8  NO_FIX =  -1   # none\nstring WHO = a # b\n\
                    ===\nMSG: p/Part\n# nothing but a comment\n";
        let expected = format!("int8 NO_FIX=-1\nstring WHO=a # b\nfloat64[9] a\n{MD5_OF_NOTHING} parts");
        assert_eq!(type_sum("p/A", text).unwrap(), hex(&Md5::digest(expected)));
        assert_eq!(type_sum("std_msgs/Empty", "").unwrap(), MD5_OF_NOTHING);
    }

    #[test]
    fn a_type_that_is_missing_or_contains_itself_has_no_sum() {
        assert!(type_sum("p/A", "Header header").unwrap_err().contains("std_msgs/Header is not defined"));
        assert!(type_sum("p/A", "B b\n===\nMSG: p/B\nA a").unwrap_err().contains("nested more than"));
        assert!(type_sum("p/A", "float64").unwrap_err().contains("neither"));
    }
}
