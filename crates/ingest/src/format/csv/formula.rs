//! Texts that a spreadsheet would take for a formula: what is written instead, and back.

use std::borrow::Cow;

/// What a formula may begin with, in the wide forms too, and the apostrophe that keeps a text from being one.
const BEGINS: [char; 13] = ['=', '+', '-', '@', '\t', '\r', '\n', '\0', '\'', '＝', '＋', '－', '＠'];

fn begins_formula(text: &str) -> bool {
    // A spreadsheet that trims spaces would see the formula behind them.
    text.trim_start_matches([' ', '\u{a0}', '\u{feff}']).starts_with(BEGINS)
}

/// A text that no spreadsheet takes for a formula: one that could begin a formula gets a leading apostrophe, and so does
/// one that begins with an apostrophe. The reader of text tables takes it away again.
#[must_use]
pub fn inert(text: &str) -> Cow<'_, str> {
    if begins_formula(text) { Cow::Owned(format!("'{text}")) } else { Cow::Borrowed(text) }
}

/// The text that [`inert`] was given.
pub(super) fn restored(text: &str) -> &str {
    text.strip_prefix('\'').filter(|rest| begins_formula(rest)).unwrap_or(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_text_cell_begins_a_formula_and_every_name_is_restored() {
        let begins = ["=", "+", "-", "@", "\t", "\r", "\n", "\0", "'", "＝", "＋", "－", "＠", " =", "\u{feff}="];
        for begin in begins {
            let name = format!("{begin}cmd|' /C calc'!A0");
            let cell = inert(&name);
            assert!(cell.starts_with('\''), "{cell}");
            assert_eq!(restored(&cell), name);
        }
        for plain in ["swing-07.mcap", "a=b", "", "7", "it's"] {
            assert_eq!((&*inert(plain), restored(plain)), (plain, plain));
        }
        assert_eq!(restored("'90s"), "'90s");
    }
}
