//! Texts that a spreadsheet would interpret as a formula: how they are written, and read back.

use std::borrow::Cow;

/// Characters that may start a formula, full-width forms included, and the apostrophe that prevents it.
const BEGINS: [char; 13] = ['=', '+', '-', '@', '\t', '\r', '\n', '\0', '\'', '＝', '＋', '－', '＠'];

fn begins_formula(text: &str) -> bool {
    // A spreadsheet that trims spaces would see the formula after them.
    text.trim_start_matches([' ', '\u{a0}', '\u{feff}']).starts_with(BEGINS)
}

/// A text that no spreadsheet interprets as a formula: one that could start a formula gets a leading apostrophe, and so
/// does one that begins with an apostrophe. The reader of text tables removes it.
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
