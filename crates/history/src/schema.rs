//! The layout of a history file, and reading of earlier layouts.

use convert::{Cells, ReadTable, Sheet};

/// Version of the layout that is written.
pub const HISTORY_SCHEMA: u32 = 3;

/// Name of the version in the file's metadata.
pub(crate) const SCHEMA_KEY: &str = "flightlag-history-schema";

/// Columns missing from layout 1: they are empty in rows from such files.
const SINCE_2: [&str; 14] = [
    "identity_from",
    "vehicle",
    "system",
    "system_firmware",
    "position_minus_velocity_s",
    "position_minus_velocity_u_s",
    "criteria_hash",
    "duplicate_of",
    "parameter",
    "parameter_s",
    "advised_s",
    "advised_from_s",
    "advised_from_u_s",
    "duration_s",
];

/// Columns missing from layout 2.
const SINCE_3: [&str; 1] = ["lateness_model_u_s"];

/// A table in the current layout, whatever layout its file has.
///
/// # Errors
/// The file does not state its layout, states an unknown one, or does not follow it.
pub(crate) fn current(table: ReadTable) -> Result<Sheet, String> {
    let stated = table.about.get(SCHEMA_KEY).ok_or("states no layout: it is not a history file")?;
    match stated.parse() {
        Ok(1) => from_1(table.sheet).map(|sheet| with_empty(sheet, &SINCE_2)).map(|sheet| with_empty(sheet, &SINCE_3)),
        Ok(2) => Ok(with_empty(table.sheet, &SINCE_3)),
        Ok(HISTORY_SCHEMA) => Ok(table.sheet),
        Ok(newer) if newer > HISTORY_SCHEMA => Err(format!(
            "has layout {newer}; this flightlag reads up to layout {HISTORY_SCHEMA}: use the flightlag that wrote it, or a newer one"
        )),
        _ => Err(format!("states layout {stated:?}, which does not exist")),
    }
}

/// Whether a table has layout 1, whose columns have other names.
pub(crate) fn is_of_layout_1(table: &ReadTable) -> bool {
    table.about.get(SCHEMA_KEY).is_some_and(|stated| stated == "1")
}

/// Layout 1 had instants as text (`flown_at`, `run_at`) and delays in milliseconds.
fn from_1(mut sheet: Sheet) -> Result<Sheet, String> {
    for column in &mut sheet.columns {
        if let Some(base) = column.name.strip_suffix("_at") {
            let Cells::Text(texts) = &column.cells else { return Err(format!("column {} holds no text", column.name)) };
            let instants = texts.iter().map(|text| text.as_deref().map(nanoseconds).transpose());
            column.cells = Cells::I64(instants.collect::<Result<_, _>>()?);
            column.name = format!("{base}_ns");
        } else if let Some(base) = column.name.strip_suffix("_ms") {
            let Cells::F64(values) = &column.cells else {
                return Err(format!("column {} holds no numbers", column.name));
            };
            column.cells = Cells::F64(values.iter().map(|value| value.map(|ms| ms / 1e3)).collect());
            column.name = format!("{base}_s");
        }
    }
    Ok(sheet)
}

/// Adds the columns of a later layout, all empty.
fn with_empty(mut sheet: Sheet, columns: &[&str]) -> Sheet {
    let rows = sheet.rows();
    let missing: Vec<&str> = columns.iter().copied().filter(|name| sheet.cells(name).is_none()).collect();
    for name in missing {
        let is_text = !name.ends_with("_s");
        sheet.push(
            name,
            if is_text {
                Cells::Text((0..rows).map(|_| None::<&str>).collect())
            } else {
                Cells::F64(vec![None; rows].into())
            },
        );
    }
    sheet
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

    /// The sheet in layout 1.
    fn layout_1(rows: &[Row]) -> Sheet {
        let mut sheet = sheet_of(rows);
        sheet.columns.retain(|c| !SINCE_2.contains(&c.name.as_str()) && !SINCE_3.contains(&c.name.as_str()));
        for column in &mut sheet.columns {
            if let Some(base) = column.name.strip_suffix("_ns").map(str::to_owned) {
                let Cells::I64(stamps) = &column.cells else { unreachable!() };
                let text = |ns: &i64| jiff::Timestamp::from_nanosecond(i128::from(*ns)).unwrap().to_string();
                column.cells = Cells::Text(stamps.iter().map(|ns| ns.as_ref().map(text)).collect());
                column.name = format!("{base}_at");
            } else if let Some(base) = column.name.strip_suffix("_s").map(str::to_owned) {
                let Cells::F64(values) = &column.cells else { unreachable!() };
                column.cells = Cells::F64(values.iter().map(|v| v.map(|s| s * 1e3)).collect());
                column.name = format!("{base}_ms");
            }
        }
        sheet
    }

    fn table(schema: &str, sheet: Sheet) -> ReadTable {
        ReadTable { sheet, about: [(SCHEMA_KEY.to_owned(), schema.to_owned())].into() }
    }

    #[test]
    fn rows_of_layout_1_are_read_in_seconds_and_nanoseconds() {
        let dated = Row { lateness_model_u_s: None, ..row() };
        let undated = Row { flown_ns: None, ..dated.clone() };
        let old = layout_1(&[row(), undated.clone()]);
        assert!(old.cells("lateness_ms").is_some() && old.cells("flown_at").is_some());
        let read = rows_of(current(table("1", old)).unwrap()).unwrap();
        assert_eq!(read, [dated, undated]);
    }

    #[test]
    fn rows_of_layout_2_have_no_shared_part() {
        let mut old = sheet_of(&[row()]);
        old.columns.retain(|column| !SINCE_3.contains(&column.name.as_str()));
        let read = rows_of(current(table("2", old)).unwrap()).unwrap();
        assert_eq!(read, [Row { lateness_model_u_s: None, ..row() }]);
    }

    #[test]
    fn rows_of_the_current_layout_are_read_back_exactly() {
        assert_eq!(rows_of(current(table("3", sheet_of(&[row()]))).unwrap()).unwrap(), [row()]);
    }

    #[test]
    fn newer_and_missing_layouts_are_rejected_with_advice() {
        let newer = current(table("4", sheet_of(&[row()]))).unwrap_err();
        assert!(newer.contains("layout 4") && newer.contains("up to layout 3"), "{newer}");
        let other = current(ReadTable { sheet: sheet_of(&[row()]), ..ReadTable::default() }).unwrap_err();
        assert!(other.contains("not a history file"), "{other}");
        let mut short = sheet_of(&[row()]);
        short.columns.retain(|column| column.name != "flight");
        assert_eq!(rows_of(current(table("3", short)).unwrap()).unwrap_err(), "column flight is missing");
    }
}
