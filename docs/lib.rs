//! Pages of the book that the command prints: one text for readers of the book and of the terminal.

/// Every code of a notice or an alarm, in tables by part: `flightlag explain` prints its rows.
pub const NOTICES: &str = include_str!("src/notices.md");
