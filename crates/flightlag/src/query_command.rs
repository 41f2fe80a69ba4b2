//! `flightlag query`: queries a history.

use crate::arguments::QueryArguments;
use crate::failure::{End, Failure};
use crate::show::Table;
use campaign::Exit;
use history::{COLUMNS, Query};
use std::io::Write;

pub(crate) fn run(arguments: &QueryArguments) -> Result<End, Failure> {
    if arguments.columns {
        let mut table = Table::new(&["column", "what"]);
        COLUMNS.iter().for_each(|(name, what)| table.row(vec![(*name).to_owned(), what.trim().to_owned()]));
        write!(std::io::stdout(), "{}", table.text())?;
        return Ok(Exit::Well.into());
    }
    // An invalid query is rejected by every build.
    let query =
        Query::parse(arguments.condition.as_deref(), &arguments.by, arguments.agg.as_deref(), arguments.every_run)?;
    answer(arguments, &query)
}

#[cfg(not(feature = "query"))]
fn answer(_arguments: &QueryArguments, _query: &Query) -> Result<End, Failure> {
    let what = "flightlag was built without queries; build it with `cargo build --release -p flightlag --features \
        query`, or run `just query …`";
    Err(Failure::new(Exit::Wrong, what))
}

#[cfg(feature = "query")]
use with_polars::answer;

#[cfg(feature = "query")]
mod with_polars {
    use super::*;
    use crate::arguments::QueryTo;
    use crate::history_command::{existing, warn};
    use convert::{Cells, Sheet};
    use history::write_file;

    /// Maximum number of rows in the table for people.
    const MOST: usize = 100;

    pub(super) fn answer(arguments: &QueryArguments, query: &Query) -> Result<End, Failure> {
        let history = existing(&arguments.history)?;
        let found = history::answer(&history, query)?;
        let mut bytes = vec![];
        let unwritten = |e: std::io::Error| Failure::new(Exit::Failed, format!("the answer cannot be written: {e}"));
        match arguments.to {
            None => bytes = text(&found.table, found.matched, found.of).into_bytes(),
            Some(QueryTo::Csv) => convert::write_csv(&found.table, &mut bytes).map_err(unwritten)?,
            Some(QueryTo::Json) => bytes = json(&found.table).into_bytes(),
            Some(QueryTo::Parquet) => convert::write_parquet(&found.table, &mut bytes).map_err(unwritten)?,
        }
        match (&arguments.out, arguments.to) {
            (Some(out), _) => write_file(out, &bytes)?,
            (None, Some(QueryTo::Parquet)) => {
                return Err(Failure::new(Exit::Wrong, "--to parquet needs a file: give --out FILE"));
            }
            (None, _) => std::io::stdout().write_all(&bytes)?,
        }
        warn(&found.unreadable)
    }

    fn cell(cells: &Cells, row: usize) -> serde_json::Value {
        match cells {
            Cells::I64(values) => values.get(row).into(),
            Cells::U64(values) => values.get(row).into(),
            Cells::F64(values) => values.get(row).into(),
            Cells::Text(values) => values.get(row).map(|text| text.to_string()).into(),
        }
    }

    fn json(table: &Sheet) -> String {
        let row = |row: usize| -> serde_json::Value {
            let fields = table.columns.iter().map(|column| (column.name.clone(), cell(&column.cells, row)));
            serde_json::Value::Object(fields.collect())
        };
        let rows: Vec<serde_json::Value> = (0..table.rows()).map(row).collect();
        serde_json::to_string(&rows).unwrap_or_default() + "\n"
    }

    fn text(table: &Sheet, matched: usize, of: usize) -> String {
        let mut lines = format!("{matched} of {of} rows\n");
        let shown = |value: serde_json::Value| match value {
            serde_json::Value::Null => "-".to_owned(),
            serde_json::Value::String(text) => crate::show::visible(&text),
            // Six digits exceed the precision of any uncertainty; CSV, JSON and Parquet have all.
            serde_json::Value::Number(number) if number.is_f64() => {
                format!("{:.6}", number.as_f64().unwrap_or(f64::NAN))
            }
            other => other.to_string(),
        };
        let rows: Vec<Vec<String>> = std::iter::once(table.columns.iter().map(|c| c.name.clone()).collect())
            .chain(
                (0..table.rows().min(MOST))
                    .map(|row| table.columns.iter().map(|c| shown(cell(&c.cells, row))).collect()),
            )
            .collect();
        let widths: Vec<usize> = (0..table.columns.len())
            .map(|column| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0))
            .collect();
        for row in &rows {
            let line: String = row.iter().zip(&widths).map(|(cell, width)| format!("  {cell:<width$}")).collect();
            lines += line.trim_end();
            lines += "\n";
        }
        if table.rows() > MOST {
            lines += &format!("  and {} more; --to csv, json or parquet has all\n", table.rows() - MOST);
        }
        lines
    }

    #[cfg(test)]
    mod tests {
        use super::*;
        use history::{History, Row, Run};

        /// A history of two nights; flight `a` was run on both.
        fn history(folder: &std::path::Path) {
            let history = History::new(folder);
            for (night, late_s) in [(0, [0.4, 0.2]), (1, [0.5, 0.3])] {
                let run = Run::at(jiff::Timestamp::from_second(1_795_644_000 + night * 86_400).unwrap());
                let flight = |name: String, late_s| Row {
                    run_id: run.id.clone(),
                    run_ns: run.start_ns,
                    campaign: "c".into(),
                    flight: name,
                    firmware: Some("3.01".into()),
                    lateness_s: Some(late_s),
                    ..Row::default()
                };
                history.append(&run, &[flight("a".into(), late_s[0]), flight(format!("b{night}"), late_s[1])]).unwrap();
            }
        }

        fn asked(to: Option<QueryTo>, question: (&str, &[&str], &str)) -> String {
            let folder = tempfile::tempdir().unwrap();
            history(&folder.path().join("history"));
            let out = folder.path().join("answer");
            let arguments = QueryArguments {
                condition: Some(question.0.to_owned()),
                history: folder.path().join("history"),
                by: question.1.iter().map(|name| (*name).to_owned()).collect(),
                agg: Some(question.2.to_owned()),
                to,
                out: Some(out.clone()),
                every_run: false,
                columns: false,
            };
            assert!(run(&arguments).is_ok());
            String::from_utf8_lossy(&std::fs::read(out).unwrap()).into_owned()
        }

        #[test]
        fn an_answer_is_the_same_as_text_csv_json_and_parquet() {
            let question = ("delay_s > 0.25", &["firmware"][..], "median(delay_s), count()");
            let text = "2 of 3 rows\n  firmware  median(delay_s)  count()\n  3.01      0.400000         2\n";
            assert_eq!(asked(None, question), text);
            assert_eq!(asked(Some(QueryTo::Csv), question), "firmware,median(delay_s),count()\n3.01,0.4,2\n");
            let json: serde_json::Value = serde_json::from_str(&asked(Some(QueryTo::Json), question)).unwrap();
            assert_eq!(json, serde_json::json!([{"firmware": "3.01", "median(delay_s)": 0.4, "count()": 2}]));
            assert!(asked(Some(QueryTo::Parquet), question).starts_with("PAR1"));
        }
    }
}
