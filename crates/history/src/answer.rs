//! Answers a [`Query`] with polars.

use crate::dataset::History;
use crate::error::HistoryError;
use crate::query::{Aggregate, Condition, Function, Operator, Query, Value};
use crate::schema::current;
use convert::{Cells, Sheet, read_parquet_columns};
use polars::prelude::{
    BooleanChunked, ChunkAgg, ChunkCompareEq, ChunkCompareIneq, ChunkQuantile, DataFrame, DataType, IdxCa,
    ParquetReader, PolarsError, PolarsResult, QuantileMethod, SerReader,
};
use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::path::Path;

/// The answer to a query.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Answer {
    /// The table: rows of the history, or one row for each group.
    pub table: Sheet,
    /// Number of rows that match.
    pub matched: usize,
    /// Number of rows examined.
    pub of: usize,
    /// Files that could not be read, each with the reason.
    pub unreadable: Vec<String>,
}

/// Answers a query.
///
/// # Errors
/// The folder cannot be listed. A file that cannot be read is listed in the answer.
pub fn answer(history: &History, query: &Query) -> Result<Answer, HistoryError> {
    let names = query.columns();
    let mut frame: Option<DataFrame> = None;
    let mut unreadable = vec![];
    for path in history.files()? {
        match read(&path, &names) {
            Ok(part) if part.height() == 0 => {}
            Ok(part) => match &mut frame {
                None => frame = Some(part),
                Some(all) => drop(all.vstack_mut(&part).map_err(|e| failed(&path, &e))?),
            },
            Err(what) => unreadable.push(format!("{}: {what}", path.display())),
        }
    }
    let Some(frame) = frame else { return Ok(Answer { unreadable, ..Answer::default() }) };
    let answered = answered(&frame, query, &names).map_err(|e| failed(history.folder(), &e))?;
    Ok(Answer { unreadable, ..answered })
}

fn failed(path: &Path, error: &PolarsError) -> HistoryError {
    HistoryError::Report { path: path.to_owned(), what: error.to_string() }
}

/// The wanted columns of a file.
fn read(path: &Path, names: &[&str]) -> Result<DataFrame, String> {
    let open = || File::open(path).map_err(|e| format!("cannot be opened: {e}"));
    current(read_parquet_columns(open()?, &|_| false).map_err(|e| format!("cannot be read: {e}"))?)?;
    let wanted = names.iter().map(|name| (*name).to_owned()).collect();
    let frame = ParquetReader::new(open()?).with_columns(Some(wanted)).finish();
    frame.and_then(|frame| frame.select(names.iter().copied())).map_err(|e| e.to_string())
}

fn answered(frame: &DataFrame, query: &Query, names: &[&str]) -> PolarsResult<Answer> {
    let latest;
    let frame = if query.every_run {
        frame
    } else {
        latest = latest_rows(frame)?;
        &latest
    };
    let chosen = match &query.condition {
        Some(condition) => frame.filter(&mask(frame, condition)?)?,
        None => frame.clone(),
    };
    let table = match query.by.is_empty() && query.aggregates.is_empty() {
        true => sheet_of(&chosen, names)?,
        false => groups(&chosen, query)?,
    };
    Ok(Answer { table, matched: chosen.height(), of: frame.height(), unreadable: vec![] })
}

/// The latest row of each flight.
fn latest_rows(frame: &DataFrame) -> PolarsResult<DataFrame> {
    let (campaigns, flights) = (frame.column("campaign")?.str()?.clone(), frame.column("flight")?.str()?.clone());
    let runs = frame.column("run_ns")?.i64()?.clone();
    let mut latest: HashMap<(&str, &str), (i64, u32)> = HashMap::new();
    for (row, ((campaign, flight), run)) in campaigns.iter().zip(flights.iter()).zip(runs.iter()).enumerate() {
        let (Some(campaign), Some(flight), Some(run)) = (campaign, flight, run) else { continue };
        let row = u32::try_from(row).unwrap_or(u32::MAX);
        let known = latest.entry((campaign, flight)).or_insert((run, row));
        if known.0 <= run {
            *known = (run, row);
        }
    }
    let mut rows: Vec<u32> = latest.into_values().map(|(_, row)| row).collect();
    rows.sort_unstable();
    frame.take(&IdxCa::from_vec("row".into(), rows))
}

/// Which rows match. A comparison with an absent value is absent, and such a row does not match.
fn mask(frame: &DataFrame, condition: &Condition) -> PolarsResult<BooleanChunked> {
    match condition {
        Condition::And(one, other) => Ok(&mask(frame, one)? & &mask(frame, other)?),
        Condition::Or(one, other) => Ok(&mask(frame, one)? | &mask(frame, other)?),
        Condition::Not(one) => Ok(!&mask(frame, one)?),
        Condition::IsNull { column } => Ok(frame.column(column)?.is_null()),
        Condition::Compare { column, operator, value } => {
            let column = frame.column(column)?;
            match value {
                Value::Number(number) => Ok(compared(column.f64()?, *operator, *number)),
                Value::Integer(number) => Ok(compared(column.i64()?, *operator, *number)),
                Value::Text(text) => Ok(compared(column.str()?, *operator, text.as_str())),
            }
        }
    }
}

fn compared<C, T>(column: &C, operator: Operator, value: T) -> BooleanChunked
where
    C: ChunkCompareEq<T, Item = BooleanChunked> + ChunkCompareIneq<T, Item = BooleanChunked>,
{
    match operator {
        Operator::Equal => column.equal(value),
        Operator::NotEqual => column.not_equal(value),
        Operator::Less => column.lt(value),
        Operator::LessOrEqual => column.lt_eq(value),
        Operator::Greater => column.gt(value),
        Operator::GreaterOrEqual => column.gt_eq(value),
    }
}

/// A value by which rows are grouped, with its order.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
enum Key {
    Absent,
    Integer(i64),
    /// The bits of a number, in numeric order.
    Number(i64),
    Text(String),
}

impl Key {
    fn of(number: f64) -> Key {
        let bits = number.to_bits().cast_signed();
        Key::Number(if bits < 0 { bits ^ i64::MAX } else { bits })
    }
}

fn keys(frame: &DataFrame, name: &str) -> PolarsResult<Vec<Key>> {
    let column = frame.column(name)?;
    Ok(match column.dtype() {
        DataType::Int64 => column.i64()?.iter().map(|v| v.map_or(Key::Absent, Key::Integer)).collect(),
        DataType::Float64 => column.f64()?.iter().map(|v| v.map_or(Key::Absent, Key::of)).collect(),
        _ => column.str()?.iter().map(|v| v.map_or(Key::Absent, |text| Key::Text(text.to_owned()))).collect(),
    })
}

/// One row for each group, ordered by the grouping columns.
fn groups(frame: &DataFrame, query: &Query) -> PolarsResult<Sheet> {
    let columns: Vec<Vec<Key>> = query.by.iter().map(|name| keys(frame, name)).collect::<PolarsResult<_>>()?;
    let mut groups: BTreeMap<Vec<&Key>, Vec<u32>> = BTreeMap::new();
    for row in 0..frame.height() {
        let key = columns.iter().map(|column| &column[row]).collect();
        groups.entry(key).or_default().push(u32::try_from(row).unwrap_or(u32::MAX));
    }
    if query.by.is_empty() {
        // A query over all rows has one answer, even if there are no rows.
        groups.entry(vec![]).or_default();
    }
    let firsts: Vec<u32> = groups.values().filter_map(|rows| rows.first().copied()).collect();
    let by: Vec<&str> = query.by.iter().map(String::as_str).collect();
    let mut sheet = match by.is_empty() {
        true => Sheet::default(),
        false => sheet_of(&frame.take(&IdxCa::from_vec("row".into(), firsts))?, &by)?,
    };
    let count = Aggregate { name: "count()".to_owned(), function: Function::Count, column: None };
    let wanted = if query.aggregates.is_empty() { std::slice::from_ref(&count) } else { &query.aggregates };
    for aggregate in wanted {
        sheet.push(aggregate.name.clone(), numbers(frame, aggregate, groups.values())?);
    }
    Ok(sheet)
}

/// One aggregate of each group.
fn numbers<'a>(
    frame: &DataFrame,
    aggregate: &Aggregate,
    groups: impl Iterator<Item = &'a Vec<u32>>,
) -> PolarsResult<Cells> {
    let Some(column) = &aggregate.column else {
        return Ok(Cells::I64(groups.map(|rows| i64::try_from(rows.len()).ok()).collect()));
    };
    let values = frame.column(column)?.cast(&DataType::Float64)?;
    let one = |rows: &Vec<u32>| -> PolarsResult<Option<f64>> {
        let part = values.take(&IdxCa::from_vec("row".into(), rows.clone()))?;
        let part = part.f64()?;
        Ok(match aggregate.function {
            Function::Count => None,
            Function::Median => part.median(),
            Function::Mean => part.mean(),
            Function::Min => part.iter().flatten().reduce(f64::min),
            Function::Max => part.iter().flatten().reduce(f64::max),
            Function::Sum => part.iter().flatten().reduce(|a, b| a + b),
            Function::Std => standard_deviation(&part.iter().flatten().collect::<Vec<f64>>()),
            Function::Quantile(share) => part.quantile(share, QuantileMethod::Linear)?,
        })
    };
    Ok(Cells::F64(groups.map(one).collect::<PolarsResult<_>>()?))
}

/// Sample standard deviation; `None` for fewer than two values.
fn standard_deviation(values: &[f64]) -> Option<f64> {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let squares: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    (values.len() > 1).then(|| (squares / (n - 1.0)).sqrt())
}

/// Columns of a frame as a sheet.
fn sheet_of(frame: &DataFrame, names: &[&str]) -> PolarsResult<Sheet> {
    let mut sheet = Sheet::default();
    for name in names {
        let column = frame.column(name)?;
        let cells = match column.dtype() {
            DataType::Int64 => Cells::I64(column.i64()?.iter().collect()),
            DataType::Float64 => Cells::F64(column.f64()?.iter().collect()),
            _ => Cells::Text(column.str()?.iter().collect()),
        };
        sheet.push(*name, cells);
    }
    Ok(sheet)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::Run;
    use crate::row::Row;

    fn history(folder: &Path) -> History {
        let history = History::new(folder);
        let row = |run: &Run, flight: &str, firmware: Option<&str>, late_s: Option<f64>| Row {
            run_id: run.id.clone(),
            run_ns: run.start_ns,
            campaign: "c".into(),
            flight: flight.into(),
            firmware: firmware.map(str::to_owned),
            lateness_s: late_s,
            ..Row::default()
        };
        let run = |second| Run::at(jiff::Timestamp::from_second(second).unwrap());
        let (first, second) = (run(1_795_644_000), run(1_795_730_400));
        let rows = [
            row(&first, "a", Some("3.01"), Some(0.9)),
            row(&first, "b", Some("3.01"), Some(0.4)),
            row(&first, "c", Some("4.04"), Some(0.32)),
            row(&first, "d", None, Some(0.5)),
            row(&first, "e", Some("4.04"), None),
        ];
        history.append(&first, &rows).unwrap();
        let rows = [row(&second, "a", Some("3.01"), Some(0.6)), row(&second, "f", Some("3.01"), Some(0.1))];
        history.append(&second, &rows).unwrap();
        history
    }

    fn ask(condition: Option<&str>, by: &[&str], aggregates: Option<&str>) -> Answer {
        let folder = tempfile::tempdir().unwrap();
        let by: Vec<String> = by.iter().map(|name| (*name).to_owned()).collect();
        let query = Query::parse(condition, &by, aggregates, false).unwrap();
        answer(&history(folder.path()), &query).unwrap()
    }

    fn texts(answer: &Answer, name: &str) -> Vec<Option<String>> {
        match answer.table.cells(name) {
            Some(Cells::Text(texts)) => texts.iter().map(|text| text.map(|text| text.to_string())).collect(),
            other => panic!("{name}: {other:?}"),
        }
    }

    /// Every table of a campaign, of a history and of an export is written by `convert`.
    #[test]
    fn polars_reads_what_convert_writes_to_the_bit() {
        let mut sheet = Sheet::default();
        sheet
            .push("stamp_ns", Cells::I64(vec![Some(i64::MIN), None, Some(1_700_000_000_123_456_789), Some(-1)].into()));
        sheet.push("count", Cells::U64(vec![Some(u64::MAX), Some(0), None, Some(7)].into()));
        sheet.push("north_m", Cells::F64(vec![Some(-0.0), Some(f64::NAN), None, Some(0.1 + 0.2)].into()));
        sheet.push("text", Cells::Text([Some(""), Some("Grüße, 高度"), None, Some("=1+1")].into_iter().collect()));
        sheet.push("nothing_m", Cells::F64(vec![None; 4].into()));
        // Long columns have encodings of their own: differences for timestamps, bytes apart for numbers that move.
        let stamps: Vec<Option<i64>> = (0..6000_i64).map(|i| (i % 50 != 9).then_some(i * 10_000_000 + i % 7)).collect();
        let track = |i: i32| 100.0 * (f64::from(i) / 300.0).sin();
        let north: Vec<Option<f64>> = (0..6000).map(|i| (i % 90 > 3).then(|| track(i))).collect();
        let held: Vec<Option<f64>> = (0..6000).map(|i| Some(track(i / 20))).collect();
        let mut long = Sheet::default();
        long.push("stamp_ns", Cells::I64(stamps.clone().into()));
        long.push("north_m", Cells::F64(north.clone().into()));
        long.push("held_m", Cells::F64(held.clone().into()));
        let read = |sheet: &Sheet| -> DataFrame {
            let mut file = tempfile::tempfile().unwrap();
            convert::write_parquet(sheet, &mut file).unwrap();
            ParquetReader::new(file).finish().unwrap()
        };
        let frame = read(&long);
        assert_eq!(frame.column("stamp_ns").unwrap().i64().unwrap().to_vec(), stamps);
        assert_eq!(frame.column("north_m").unwrap().f64().unwrap().to_vec(), north);
        assert_eq!(frame.column("held_m").unwrap().f64().unwrap().to_vec(), held);
        let frame = read(&sheet);
        let stamps = frame.column("stamp_ns").unwrap().i64().unwrap().to_vec();
        assert_eq!(stamps, [Some(i64::MIN), None, Some(1_700_000_000_123_456_789), Some(-1)]);
        let counts = frame.column("count").unwrap().u64().unwrap().to_vec();
        assert_eq!(counts, [Some(u64::MAX), Some(0), None, Some(7)]);
        let bits = |name: &str| -> Vec<Option<u64>> {
            frame.column(name).unwrap().f64().unwrap().iter().map(|x| x.map(f64::to_bits)).collect()
        };
        assert_eq!(bits("north_m"), [Some(-0.0), Some(f64::NAN), None, Some(0.1 + 0.2)].map(|x| x.map(f64::to_bits)));
        assert_eq!(bits("nothing_m"), [None; 4]);
        let texts: Vec<Option<&str>> = frame.column("text").unwrap().str().unwrap().iter().collect();
        assert_eq!(texts, [Some(""), Some("Grüße, 高度"), None, Some("=1+1")]);
    }

    #[test]
    fn the_latest_row_of_each_flight_answers_by_group() {
        let found = ask(Some("delay_s > 0.3"), &["firmware"], Some("median(delay_s), count()"));
        assert_eq!((found.matched, found.of), (4, 6));
        assert_eq!(texts(&found, "firmware"), [None, Some("3.01".to_owned()), Some("4.04".to_owned())]);
        let medians = found.table.cells("median(delay_s)");
        assert_eq!(medians, Some(&Cells::F64(vec![0.5, 0.5, 0.32].into())), "0.6 and 0.4 have the median 0.5");
        assert_eq!(found.table.cells("count()"), Some(&Cells::I64(vec![1, 2, 1].into())));
    }

    #[test]
    fn an_absent_value_matches_neither_a_comparison_nor_its_negation() {
        let flights = |condition: &str| {
            texts(&ask(Some(condition), &[], None), "flight").into_iter().flatten().collect::<Vec<_>>().join("")
        };
        assert_eq!(flights("delay_s <= 0.3"), "f");
        assert_eq!(flights("not delay_s > 0.3"), "f");
        assert_eq!(flights("delay_s is null"), "e");
        assert_eq!(flights("firmware != '3.01'"), "ce");
        assert_eq!(flights("firmware == '4.04' and delay_s is not null or flight == 'd'"), "cd");
        assert_eq!(flights("run_ns >= '2026-11-26'"), "af");
    }

    #[test]
    fn a_query_over_all_rows_has_one_answer() {
        let found = ask(
            None,
            &[],
            Some("count(), min(delay_s), max(delay_s), sum(delay_s), quantile(delay_s, 0.5), std(delay_s)"),
        );
        let number = |name: &str| match found.table.cells(name) {
            Some(Cells::F64(values)) => values.get(0).unwrap(),
            other => panic!("{other:?}"),
        };
        assert_eq!(found.table.cells("count()"), Some(&Cells::I64(vec![6].into())));
        assert_eq!((number("min(delay_s)"), number("max(delay_s)")), (0.1, 0.6));
        assert!(
            (number("sum(delay_s)") - 1.92).abs() < 1e-12 && (number("quantile(delay_s, 0.5)") - 0.4).abs() < 1e-12
        );
        assert!((number("std(delay_s)") - 0.190_473).abs() < 1e-6);
        let none = ask(Some("delay_s > 9"), &[], Some("count(), median(delay_s)"));
        assert_eq!(none.table.cells("count()"), Some(&Cells::I64(vec![0].into())));
        assert_eq!(none.table.cells("median(delay_s)"), Some(&Cells::F64(vec![None].into())));
    }
}
