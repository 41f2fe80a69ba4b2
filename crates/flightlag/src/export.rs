//! `flightlag export`: a log as tables.

use crate::arguments::{ExportArguments, ExportKind};
use crate::failure::{End, Failure};
use crate::findings::{damage, notices};
use crate::inspect::unit_of;
use crate::maps::{check_name, library};
use crate::recover::{Output, check_output};
use crate::show::{Table, count, visible};
use crate::stop::Stop;
use campaign::Exit;
use convert::{ExportOrder, ExportTo, ExportWhat, Exported, export};
use ingest::{Limits, ReadContext};
use std::io::Write;
use std::path::{Path, PathBuf};

pub(crate) fn run(arguments: &ExportArguments, stop: &Stop) -> Result<End, Failure> {
    let out = arguments.out.clone().unwrap_or_else(|| usual_out(&arguments.log, arguments.to));
    let kind = if arguments.to == ExportKind::Mcap { Output::File } else { Output::Folder };
    check_output(&out, kind, arguments.force)?;
    let library = library(arguments.maps.as_deref())?;
    check_name(&library, arguments.map.as_deref())?;
    let unit = unit_of(&arguments.log, &library)?;
    let what = if arguments.topics { ExportWhat::Topics } else { ExportWhat::Channels };
    let to = match arguments.to {
        ExportKind::Parquet => ExportTo::Parquet,
        ExportKind::Csv => ExportTo::Csv,
        ExportKind::Mcap => ExportTo::Mcap,
    };
    let command = command(arguments);
    let order = ExportOrder {
        unit: &unit,
        library: &library,
        map: arguments.map.as_deref(),
        what,
        to,
        out: &out,
        command: &command,
    };
    let context = ReadContext { limits: Limits::default(), cancel: stop.flag(), on_bytes: &|_| {} };
    let exported = export(&order, &context)?;
    std::io::stdout().lock().write_all(page(&out, &exported).as_bytes())?;
    Ok(if exported.notices.any_loss() { Exit::Incomplete } else { Exit::Well }.into())
}

/// Beside where the user stands, named after the log.
fn usual_out(log: &Path, to: ExportKind) -> PathBuf {
    let name = log.file_name().map(|n| n.to_string_lossy().into_owned());
    let name = name.unwrap_or_else(|| "flight".to_owned());
    PathBuf::from(match to {
        ExportKind::Parquet => format!("{name}.parquet"),
        ExportKind::Csv => format!("{name}.csv.d"),
        ExportKind::Mcap => format!("{name}.export.mcap"),
    })
}

/// The command that makes it again.
fn command(arguments: &ExportArguments) -> String {
    let kind = match arguments.to {
        ExportKind::Parquet => "parquet",
        ExportKind::Csv => "csv",
        ExportKind::Mcap => "mcap",
    };
    let name = arguments.log.file_name().unwrap_or(arguments.log.as_os_str()).to_string_lossy();
    let topics = if arguments.topics { " --topics" } else { "" };
    let map = arguments.map.as_ref().map_or(String::new(), |m| format!(" --map {m}"));
    format!("flightlag export {name} --to {kind}{topics}{map}")
}

fn page(out: &Path, exported: &Exported) -> String {
    let mut table = Table::new(&["name", "written as", "rows|", "columns|"]);
    for sheet in &exported.sheets {
        table.row(vec![sheet.name.clone(), sheet.place.clone(), sheet.rows.to_string(), sheet.columns.to_string()]);
    }
    let head = format!(
        "{}: {} from {}, {} of {} bytes damaged\n",
        visible(&out.display().to_string()),
        count(exported.sheets.len() as u64, "table"),
        visible(&exported.health.format),
        exported.health.bytes.damaged,
        exported.health.bytes.size,
    );
    let parts = [head, table.text(), damage(&exported.health), notices(&exported.notices)];
    let parts: Vec<String> = parts.into_iter().filter(|p| !p.is_empty()).collect();
    parts.join("\n")
}
