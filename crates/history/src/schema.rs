//! The layout of a history file.

use convert::{ReadTable, Sheet};

/// Version of the layout that is written.
pub const HISTORY_SCHEMA: u32 = 3;

/// Name of the version in the file's metadata.
pub(crate) const SCHEMA_KEY: &str = "flightlag-history-schema";

/// The sheet of a table in the current layout.
///
/// # Errors
/// The file does not state its layout, or states another one.
pub(crate) fn current(table: ReadTable) -> Result<Sheet, String> {
    let stated = table.about.get(SCHEMA_KEY).ok_or("states no layout: it is not a history file")?;
    match stated.parse::<u32>() {
        Ok(HISTORY_SCHEMA) => Ok(table.sheet),
        Ok(other) => Err(format!(
            "has layout {other}; this flightlag reads layout {HISTORY_SCHEMA}: use the flightlag that wrote it"
        )),
        _ => Err(format!("states layout {stated:?}, which does not exist")),
    }
}

/// Nanoseconds since 1970 for an instant such as `2026-05-04T09:30:00Z`.
pub(crate) fn nanoseconds(instant: &str) -> Result<i64, String> {
    let parsed: jiff::Timestamp = instant.parse().map_err(|e| format!("{instant:?} is not a time: {e}"))?;
    i64::try_from(parsed.as_nanosecond()).map_err(|_| format!("{instant:?} is too far from 1970"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::row::{Row, rows_of, sheet_of};

    pub(crate) fn row() -> Row {
        Row {
            run_id: "2026-11-25T220000Z".into(),
            run_ns: 1_795_644_000_000_000_000,
            campaign: "goheung".into(),
            flight: "day-1/a.bin".into(),
            flown_ns: Some(1_777_887_000_000_000_000),
            lateness_s: Some(0.118),
            lateness_u_s: Some(0.002),
            lateness_model_u_s: Some(0.0015),
            lateness_low_s: Some(0.114),
            settings_hash: "ab".into(),
            outcome: "compensated".into(),
            data: "whole".into(),
            ..Row::default()
        }
    }

    fn table(schema: &str, sheet: Sheet) -> ReadTable {
        ReadTable { sheet, about: [(SCHEMA_KEY.to_owned(), schema.to_owned())].into() }
    }

    #[test]
    fn rows_of_the_current_layout_are_read_back_exactly() {
        assert_eq!(rows_of(current(table("3", sheet_of(&[row()]))).unwrap()).unwrap(), [row()]);
    }

    #[test]
    fn other_and_missing_layouts_are_rejected_with_advice() {
        for stated in ["2", "4"] {
            let other = current(table(stated, sheet_of(&[row()]))).unwrap_err();
            let expected =
                format!("has layout {stated}; this flightlag reads layout 3: use the flightlag that wrote it");
            assert_eq!(other, expected);
        }
        let other = current(ReadTable { sheet: sheet_of(&[row()]), ..ReadTable::default() }).unwrap_err();
        assert!(other.contains("not a history file"), "{other}");
        let mut short = sheet_of(&[row()]);
        short.columns.retain(|column| column.name != "flight");
        assert_eq!(rows_of(current(table("3", short)).unwrap()).unwrap_err(), "column flight is missing");
    }
}
