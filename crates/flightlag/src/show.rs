//! Text for a terminal.

use std::fmt::Write;

/// Text from a log, with everything that could control a terminal or reverse text direction made visible.
pub(crate) fn visible(text: &str) -> String {
    let mut shown = String::with_capacity(text.len());
    for c in text.chars() {
        match is_hidden(c) {
            true => shown.extend(c.escape_default()),
            false => shown.push(c),
        }
    }
    shown
}

fn is_hidden(c: char) -> bool {
    let reverses_text =
        matches!(c, '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{feff}');
    c.is_control() || reverses_text
}

/// Bytes for people: three digits and a decimal unit.
pub(crate) fn bytes(n: u64) -> String {
    let units = ["kB", "MB", "GB", "TB", "PB", "EB"];
    let mut value = n as f64;
    let mut unit = "B";
    for next in units {
        if value < 999.5 {
            break;
        }
        value /= 1000.0;
        unit = next;
    }
    match (unit, value) {
        ("B", _) => format!("{n} B"),
        (_, v) if v < 9.995 => format!("{v:.2} {unit}"),
        (_, v) if v < 99.95 => format!("{v:.1} {unit}"),
        (_, v) => format!("{v:.0} {unit}"),
    }
}

/// `1 flight`, `2 flights`.
pub(crate) fn count(n: u64, noun: &str) -> String {
    if n == 1 { format!("1 {noun}") } else { format!("{n} {noun}s") }
}

/// A number with `digits` decimals, or a dash.
pub(crate) fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "-".to_owned(), |v| format!("{v:.digits$}"))
}

/// Alignment of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Align {
    Left,
    Right,
}

/// Rows under aligned headings.
pub(crate) struct Table {
    heads: Vec<(&'static str, Align)>,
    rows: Vec<Vec<String>>,
}

impl Table {
    /// Columns; a heading that ends in a bar `|` is right-aligned.
    pub(crate) fn new(heads: &[&'static str]) -> Table {
        let align = |h: &&'static str| match h.strip_suffix('|') {
            Some(plain) => (plain, Align::Right),
            None => (*h, Align::Left),
        };
        Table { heads: heads.iter().map(align).collect(), rows: vec![] }
    }

    /// Adds a row.
    pub(crate) fn row(&mut self, cells: Vec<String>) {
        self.rows.push(cells.iter().map(|c| visible(c)).collect());
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    fn widths(&self) -> Vec<usize> {
        let width = |i: usize| {
            let cells = self.rows.iter().filter_map(|r| r.get(i)).map(|c| c.chars().count());
            cells.chain(self.heads.get(i).map(|h| h.0.chars().count())).max().unwrap_or(0)
        };
        (0..self.heads.len()).map(width).collect()
    }

    /// The table as lines, each indented by two.
    pub(crate) fn text(&self) -> String {
        let widths = self.widths();
        let heads: Vec<String> = self.heads.iter().map(|h| h.0.to_owned()).collect();
        let mut text = String::new();
        for row in std::iter::once(&heads).chain(&self.rows) {
            let mut line = String::new();
            for ((cell, width), (_, align)) in row.iter().zip(&widths).zip(&self.heads) {
                let _ = match align {
                    Align::Left => write!(line, "  {cell:<width$}"),
                    Align::Right => write!(line, "  {cell:>width$}"),
                };
            }
            text.push_str(line.trim_end());
            text.push('\n');
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_log_cannot_control_the_terminal() {
        assert_eq!(visible("/imu\u{1b}[2J\n\u{202e}x é"), "/imu\\u{1b}[2J\\n\\u{202e}x é");
    }

    #[test]
    fn sizes_have_three_digits() {
        let shown = [0, 999, 1000, 9_994, 10_000, 999_499, 999_500, 425_000_000, 18_446_744_073_709_551_615].map(bytes);
        assert_eq!(shown, ["0 B", "999 B", "1.00 kB", "9.99 kB", "10.0 kB", "999 kB", "1.00 MB", "425 MB", "18.4 EB"]);
    }

    #[test]
    fn columns_are_aligned_under_their_headings() {
        let mut table = Table::new(&["topic", "rate|"]);
        table.row(vec!["/gps".into(), "10.0".into()]);
        table.row(vec!["/imu/data".into(), "400.0".into()]);
        assert_eq!(table.text(), "  topic       rate\n  /gps        10.0\n  /imu/data  400.0\n");
    }
}
