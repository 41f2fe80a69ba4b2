//! What a figure draws, as a table.

use super::Figure;
use std::fmt::Write;

/// Rows of comma-separated values: the panel, counted from the top; the curve; its piece, counted from 1 (the curve is
/// interrupted between pieces); then the two coordinates. The column names of the coordinates are the axis labels.
///
/// Nine significant digits. The curves are as drawn, decimated as stated in the caption.
pub(crate) fn csv(figure: &Figure) -> String {
    let words = |of: fn(&super::Panel) -> &str| {
        let mut all: Vec<&str> = figure.panels.iter().map(of).collect();
        all.dedup();
        all.join("; ")
    };
    let (x, y) = (words(|panel| &panel.x.label), words(|panel| &panel.y.label));
    let mut out = format!("panel,curve,piece,{},{}\n", quoted(&x), quoted(&y));
    for (panel_number, panel) in (1..).zip(&figure.panels) {
        for line in &panel.lines {
            let curve = quoted(&line.name);
            for (piece_number, piece) in (1..).zip(&line.pieces) {
                for &(x, y) in piece {
                    let (x, y) = (nine_digits(x), nine_digits(y));
                    // Writing to a String cannot fail.
                    let _ = writeln!(out, "{panel_number},{curve},{piece_number},{x},{y}");
                }
            }
        }
    }
    out
}

/// Quoted, and prefixed with an apostrophe where a spreadsheet might evaluate it as a formula.
fn quoted(text: &str) -> String {
    let guard = if text.starts_with(['=', '+', '-', '@', '\t']) { "'" } else { "" };
    format!("\"{guard}{}\"", text.replace('"', "\"\""))
}

fn nine_digits(value: f64) -> f64 {
    format!("{value:.8e}").parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::figure::{Axis, Line, Panel, Pen};

    #[test]
    fn a_table_holds_every_point_of_every_piece_with_the_axis_labels() {
        let line = Line {
            name: "=1+\"1\"".to_owned(),
            pen: Pen::Raw,
            pieces: vec![vec![(0.1 + 0.2, -1.0), (1.0, 2.5)], vec![(3.0, 1e-7)]],
        };
        let axis = |label: &str| Axis::exactly(label, (0.0, 3.0), 3);
        let figure = Figure {
            id: "f".to_owned(),
            number: 1,
            title: String::new(),
            caption: String::new(),
            how_to_read: "",
            panels: ["north (m)", "east (m)"].map(|y| Panel::of(axis("time (s)"), axis(y), vec![line.clone()])).into(),
            panel_size: (10, 10),
            fine: false,
        };
        let text = csv(&figure);
        let mut lines = text.lines();
        assert_eq!(lines.next(), Some("panel,curve,piece,\"time (s)\",\"north (m); east (m)\""));
        assert_eq!(lines.next(), Some("1,\"'=1+\"\"1\"\"\",1,0.3,-1"));
        assert_eq!((lines.nth(1), text.matches("\n").count()), (Some("1,\"'=1+\"\"1\"\"\",2,3,0.0000001"), 7));
    }
}
