//! `flightlag export`: exports a log as tables.

use crate::arguments::{ExportArguments, ExportKind};
use crate::failure::{End, Failure};
use crate::findings::{damage, notices};
use crate::inspect::unit_of;
use crate::maps::{check_name, library};
use crate::recover::{Output, check_output};
use crate::show::{Table, count, visible};
use crate::stop::Stop;
use campaign::Exit;
use convert::{
    ExportOrder, ExportTo, ExportWhat, Exported, TABLES_MAP, TrackOrder, TrackTo, export, export_track, layouts_of,
};
use ingest::{Limits, ReadContext};
use std::io::Write;
use std::path::{Path, PathBuf};

pub(crate) fn run(arguments: &ExportArguments, stop: &Stop) -> Result<End, Failure> {
    if arguments.track {
        return track(arguments);
    }
    let to = match arguments.to {
        ExportKind::Parquet => ExportTo::Parquet,
        ExportKind::Csv => ExportTo::Csv,
        ExportKind::Mcap => ExportTo::Mcap,
        ExportKind::Geojson | ExportKind::Kml | ExportKind::Gpx => {
            return Err(Failure::new(
                Exit::Wrong,
                "--to geojson, kml and gpx are only for the track of a flight: add --track",
            ));
        }
    };
    let out = arguments.out.clone().unwrap_or_else(|| usual_out(&arguments.log, arguments.to));
    let kind = if arguments.to == ExportKind::Mcap { Output::File } else { Output::Folder };
    check_output(&out, kind, arguments.force)?;
    let library = library(arguments.maps.as_deref())?;
    check_name(&library, arguments.map.as_deref())?;
    let unit = unit_of(&arguments.log, &library)?;
    let what = if arguments.topics { ExportWhat::Topics } else { ExportWhat::Channels };
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

/// Points per second on a map: a line needs no more, and maps become slow.
const MAP_HZ: f64 = 5.0;

/// Maximum sensible number of points per second.
const MOST_HZ: f64 = 1e4;

/// The track of the flight whose page is in this folder: its record names the result with the track.
fn track_in(folder: &Path) -> Option<PathBuf> {
    let json = campaign::record_of_page(&folder.join("index.html")).ok()??;
    let record: serde_json::Value = serde_json::from_slice(&json).ok()?;
    let key = record.get("key")?.as_str()?;
    let key = key.bytes().all(|byte| byte.is_ascii_hexdigit()).then_some(key)?;
    Some(folder.canonicalize().ok()?.join("../../by-key").join(key.get(..2)?).join(key).join("track.parquet"))
}

/// Exports the track of a flight of a report.
fn track(arguments: &ExportArguments) -> Result<End, Failure> {
    let (to, ending) = track_to(arguments.to)?;
    let most_hz = most_hz(arguments.rate, to)?;
    let (folder, table) = flight_of(&arguments.log)?;
    let name = folder.canonicalize().ok().and_then(|f| Some(f.file_name()?.to_string_lossy().into_owned()));
    let name = name.unwrap_or_else(|| "flight".to_owned());
    let out = arguments.out.clone().unwrap_or_else(|| PathBuf::from(format!("{name}.track.{ending}")));
    let layouts = if to == TrackTo::Mcap { layouts_of(&out).into() } else { vec![] };
    for path in layouts.iter().chain([&out]) {
        check_output(path, Output::File, arguments.force)?;
    }
    let written = export_track(&TrackOrder { track: &table, name: &name, to, most_hz, out: &out })?;
    let utc = if written.has_utc { "" } else { "; UTC is unknown in this log, so the points have no date" };
    let mut text = format!(
        "{}: {} of {} rows, {}{utc}\n",
        visible(&out.display().to_string()),
        written.points,
        written.of,
        written.lines.join(" and "),
    );
    for (path, program) in layouts.iter().zip(["Foxglove", "PlotJuggler"]) {
        text += &format!("{}: layout for {program}\n", visible(&path.display().to_string()));
    }
    std::io::stdout().lock().write_all(text.as_bytes())?;
    Ok(Exit::Well.into())
}

/// Output format of a track, and its file name extension.
fn track_to(kind: ExportKind) -> Result<(TrackTo, &'static str), Failure> {
    match kind {
        ExportKind::Geojson => Ok((TrackTo::GeoJson, "geojson")),
        ExportKind::Kml => Ok((TrackTo::Kml, "kml")),
        ExportKind::Gpx => Ok((TrackTo::Gpx, "gpx")),
        ExportKind::Csv => Ok((TrackTo::Csv, "csv")),
        ExportKind::Mcap => Ok((TrackTo::Mcap, "mcap")),
        ExportKind::Parquet => {
            Err(Failure::new(Exit::Wrong, "--track --to parquet: the file exists already, it is track.parquet"))
        }
    }
}

/// Maximum points per second of a track; `None` for all.
fn most_hz(asked: Option<f64>, to: TrackTo) -> Result<Option<f64>, Failure> {
    let is_map = matches!(to, TrackTo::GeoJson | TrackTo::Kml | TrackTo::Gpx);
    match asked {
        None => Ok(is_map.then_some(MAP_HZ)),
        Some(0.0) => Ok(None),
        Some(rate) if rate > 0.0 && rate <= MOST_HZ => Ok(Some(rate)),
        Some(rate) => Err(Failure::new(Exit::Wrong, format!("--rate {rate}: must be from 0 to {MOST_HZ} Hz"))),
    }
}

/// The folder of a flight in a report and its track, given either of them.
fn flight_of(given: &Path) -> Result<(&Path, PathBuf), Failure> {
    let (folder, table) = match given.is_dir() {
        true => (given, track_in(given).unwrap_or_default()),
        false => (given.parent().unwrap_or(Path::new("")), given.to_owned()),
    };
    if table.is_file() {
        return Ok((folder, table));
    }
    let what = "no track.parquet found. Give the folder of a flight in a report, such as \
        reports/NAME/flights/FLIGHT; a flight without a removed delay has no track";
    Err(Failure::new(Exit::Wrong, format!("{}: {what}", given.display())))
}

/// Default output: in the working folder, named after the log.
fn usual_out(log: &Path, to: ExportKind) -> PathBuf {
    let name = log.file_name().map(|n| n.to_string_lossy().into_owned());
    let name = name.unwrap_or_else(|| "flight".to_owned());
    PathBuf::from(match to {
        ExportKind::Parquet => format!("{name}.parquet"),
        ExportKind::Csv => format!("{name}.csv.d"),
        _ => format!("{name}.export.mcap"),
    })
}

/// The command that repeats the export.
fn command(arguments: &ExportArguments) -> String {
    let kind = match arguments.to {
        ExportKind::Parquet => "parquet",
        ExportKind::Csv => "csv",
        _ => "mcap",
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
    let folder = visible(&out.display().to_string());
    let again = format!("{TABLES_MAP} reads these tables again: flightlag delay {folder} --maps {folder}\n");
    let again = if out.join(TABLES_MAP).is_file() { again } else { String::new() };
    let parts = [head, table.text(), again, damage(&exported.health), notices(&exported.notices)];
    let parts: Vec<String> = parts.into_iter().filter(|p| !p.is_empty()).collect();
    parts.join("\n")
}
