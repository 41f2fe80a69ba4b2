//! Text from a log on its way to a page: nothing in it is markup, nothing in it is hidden.

use maud::{Escaper, Render};
use std::fmt::Write;

/// Longest text of one table cell, in characters: a name can be as long as a hostile file likes.
const CELL: usize = 300;
/// Longest block (settings, a command, a reason), in characters.
const BLOCK: usize = 30_000;

/// Text from a record, ready for a page. Markup is escaped; control characters, direction
/// overrides and invisible characters become visible; overlong text is cut and says so.
pub(crate) struct Shown<'a> {
    text: &'a str,
    limit: usize,
    lines: bool,
}

/// A name, a sentence, a cell.
pub(crate) fn shown(text: &str) -> Shown<'_> {
    Shown { text, limit: CELL, lines: false }
}

/// A longer text whose lines are kept.
pub(crate) fn shown_block(text: &str) -> Shown<'_> {
    Shown { text, limit: BLOCK, lines: true }
}

impl Render for Shown<'_> {
    fn render_to(&self, buffer: &mut String) {
        // A String cannot refuse a write.
        let _ = Escaper::new(buffer).write_str(&visible(self.text, self.limit, self.lines));
    }
}

/// A short plain text, as a legend holds it; whoever writes it escapes it.
pub(crate) fn label(text: &str) -> String {
    visible(text, 72, false)
}

/// A plain text as short as an axis has room for; whoever writes it escapes it.
pub(crate) fn short_label(text: &str) -> String {
    visible(text, 20, false)
}

/// A plain text as long as a cell; whoever writes it escapes it.
pub(crate) fn sentence(text: &str) -> String {
    visible(text, CELL, false)
}

fn visible(text: &str, limit: usize, lines: bool) -> String {
    let mut out = String::with_capacity(text.len().min(limit));
    let mut characters = text.chars();
    for c in characters.by_ref().take(limit) {
        push_visible(&mut out, c, lines);
    }
    let rest = characters.count();
    if rest > 0 {
        let _ = write!(out, "… ({rest} characters more)");
    }
    out
}

fn push_visible(out: &mut String, c: char, lines: bool) {
    match c {
        '\n' | '\t' if lines => out.push(c),
        '\0'..='\u{1f}' => out.push(char::from_u32(0x2400 + u32::from(c)).unwrap_or('\u{fffd}')),
        '\u{7f}' => out.push('\u{2421}'),
        c if is_hidden(c) => {
            let _ = write!(out, "⟨U+{:04X}⟩", u32::from(c));
        }
        c => out.push(c),
    }
}

/// Characters that show nothing, turn the direction of text, or break lines where HTML does not.
fn is_hidden(c: char) -> bool {
    matches!(c,
        '\u{80}'..='\u{9f}' | '\u{ad}' | '\u{61c}' | '\u{180e}' | '\u{200b}'..='\u{200f}'
        | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{feff}' | '\u{fff0}'..='\u{fffb}'
        | '\u{fffe}' | '\u{ffff}' | '\u{e0000}'..='\u{e007f}')
}

/// A relative link to a path: every byte that is not plain is percent-encoded, so that no
/// name can become a scheme, a query or another host.
pub(crate) fn href(path: &str) -> String {
    let mut out = String::with_capacity(path.len());
    for byte in path.trim_start_matches(['/', '\\']).bytes() {
        match byte {
            b'A'..=b'Z' | b'a'..=b'z' | b'0'..=b'9' | b'-' | b'.' | b'_' | b'~' | b'/' => out.push(char::from(byte)),
            _ => {
                let _ = write!(out, "%{byte:02X}");
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn markup_in_a_log_is_text_on_the_page() {
        assert_eq!(
            shown("<img src=x onerror=\"a&b\">").render().into_string(),
            "&lt;img src=x onerror=&quot;a&amp;b&quot;&gt;"
        );
    }

    #[test]
    fn hidden_characters_become_visible() {
        assert_eq!(visible("a\u{202e}b\u{2028}c\u{0}d\ne", 99, false), "a⟨U+202E⟩b⟨U+2028⟩c␀d␊e");
        assert_eq!(visible("a\n\tb\r", 99, true), "a\n\tb␍");
    }

    #[test]
    fn an_overlong_text_says_how_much_is_missing() {
        assert_eq!(visible(&"é".repeat(12), 10, false), format!("{}… (2 characters more)", "é".repeat(10)));
    }

    #[test]
    fn a_file_name_cannot_become_a_scheme_or_a_host() {
        assert_eq!(href("javascript:alert(1)"), "javascript%3Aalert%281%29");
        assert_eq!(href("//evil.example/x"), "evil.example/x");
        assert_eq!(href("flights/a b?#ü/index.html"), "flights/a%20b%3F%23%C3%BC/index.html");
        assert_eq!(href("../../index.html"), "../../index.html");
    }
}
