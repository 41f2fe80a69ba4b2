//! Prepares text from a log for a page: markup is escaped, and hidden characters become visible.

use maud::{Escaper, Markup, Render, html};
use std::fmt::Write;

/// Longest text of one table cell, in characters: names in a hostile file can have any length.
const CELL: usize = 300;
/// A word of up to this many bytes fits on a line of any column.
const LONG_WORD: usize = 20;
/// Longest block (settings, a command, a reason), in characters.
const BLOCK: usize = 30_000;

/// Text from a record, ready for a page. Markup is escaped; control characters, direction
/// overrides and invisible characters become visible; overlong text is shortened with a note.
pub(crate) struct Shown<'a> {
    text: &'a str,
    limit: usize,
    lines: bool,
}

/// Text of a name, a sentence or a cell.
pub(crate) fn shown(text: &str) -> Shown<'_> {
    Shown { text, limit: CELL, lines: false }
}

/// A sentence with a full stop, added if it is missing.
pub(crate) fn ended(text: &str) -> Markup {
    let is_ended = text.ends_with(['.', '!', '?']);
    html! { (shown(text)) @if !is_ended { "." } }
}

/// A longer text; line breaks are kept.
pub(crate) fn shown_block(text: &str) -> Shown<'_> {
    Shown { text, limit: BLOCK, lines: true }
}

impl Render for Shown<'_> {
    fn render_to(&self, buffer: &mut String) {
        let text = visible(self.text, self.limit, self.lines);
        // Commands in a sentence are in backticks.
        let quoted = text.matches('`').count() / 2 * 2;
        for (place, part) in text.splitn(quoted + 1, '`').enumerate() {
            if place % 2 == 1 {
                buffer.push_str("<code>");
            }
            self.part(buffer, part);
            if place % 2 == 1 {
                buffer.push_str("</code>");
            }
        }
    }
}

impl Shown<'_> {
    fn part(&self, buffer: &mut String, text: &str) {
        if self.lines {
            return escape(buffer, text);
        }
        for word in text.split_inclusive(' ') {
            if word.len() > LONG_WORD { breakable(buffer, word) } else { escape(buffer, word) }
        }
    }
}

/// Lets a long name break after the characters that join its parts, rather than within a part.
fn breakable(buffer: &mut String, word: &str) {
    let mut parts = word.split_inclusive(['/', '_', '.', ',', ':', '=']).peekable();
    while let Some(part) = parts.next() {
        escape(buffer, part);
        if parts.peek().is_some() {
            buffer.push_str("<wbr>");
        }
    }
}

fn escape(buffer: &mut String, text: &str) {
    // Writing to a String cannot fail.
    let _ = Escaper::new(buffer).write_str(text);
}

/// Plain text shortened for a legend; the caller escapes it.
pub(crate) fn label(text: &str) -> String {
    visible(text, 72, false)
}

/// Plain text shortened to fit an axis; the caller escapes it.
pub(crate) fn short_label(text: &str) -> String {
    visible(text, 20, false)
}

/// Plain text shortened to fit a cell; the caller escapes it.
pub(crate) fn sentence(text: &str) -> String {
    visible(text, CELL, false)
}

fn visible(text: &str, limit: usize, lines: bool) -> String {
    let mut out = String::with_capacity(text.len().min(limit));
    let length = text.chars().count();
    // The note would be longer than the text that it replaces.
    let rest = if length > limit + limit / 4 { length - limit } else { 0 };
    for c in text.chars().take(length - rest) {
        push_visible(&mut out, c, lines);
    }
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

/// Characters that are invisible, change the direction of text, or break lines where HTML does not.
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
    fn a_command_in_backticks_is_marked_up_as_code() {
        let html = |text: &str| shown(text).render().into_string();
        assert_eq!(html("run `flightlag maps` & `x"), "run <code>flightlag maps</code> &amp; `x");
        assert_eq!(html("`a` and `<b>`"), "<code>a</code> and <code>&lt;b&gt;</code>");
        assert_eq!(html("one ` alone"), "one ` alone");
    }

    #[test]
    fn markup_in_a_log_is_escaped() {
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
    fn a_shortened_text_says_how_much_is_missing() {
        assert_eq!(visible(&"é".repeat(13), 10, false), format!("{}… (3 characters more)", "é".repeat(10)));
    }

    #[test]
    fn a_text_that_is_barely_too_long_is_not_shortened() {
        assert_eq!(visible(&"é".repeat(12), 10, false), "é".repeat(12));
        assert_eq!(visible(&"y".repeat(375), CELL, false), "y".repeat(375));
        assert!(visible(&"y".repeat(376), CELL, false).ends_with("… (76 characters more)"));
    }

    #[test]
    fn a_long_name_may_break_between_its_parts_and_a_short_one_stays_whole() {
        let html = |text: &str| shown(text).render().into_string();
        assert_eq!(html("position.truth is on time"), "position.truth is on time");
        assert_eq!(
            html("of px4_msgs/msg/VehicleLocalPosition <b>"),
            "of px4_<wbr>msgs/<wbr>msg/<wbr>VehicleLocalPosition &lt;b&gt;"
        );
        // A block is unchanged, so that a command can also be copied from the page source.
        assert_eq!(shown_block("px4_msgs/msg/VehicleLocalPosition").render().into_string().matches("<wbr>").count(), 0);
    }

    #[test]
    fn a_file_name_cannot_become_a_scheme_or_a_host() {
        assert_eq!(href("javascript:alert(1)"), "javascript%3Aalert%281%29");
        assert_eq!(href("//evil.example/x"), "evil.example/x");
        assert_eq!(href("flights/a b?#ü/index.html"), "flights/a%20b%3F%23%C3%BC/index.html");
        assert_eq!(href("../../index.html"), "../../index.html");
    }
}
