//! The compensated track of a flight, in the formats of maps and players.

mod layouts;
mod map_files;
mod track_recording;

use crate::error::ConvertError;
use crate::guard::may_write;
use crate::output::Output;
use crate::sheet::{Cells, ReadTable, Sheet, SheetColumn, read_parquet, write_csv, write_parquet_parts};
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// Key of the provenance in the metadata of a `track.parquet`.
const METADATA: &str = "flightlag-track";

/// Output format of a track.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TrackTo {
    /// `GeoJSON` (RFC 7946): one line for raw and one for each compensated track.
    GeoJson,
    /// KML with times (`gx:Track`), which Google Earth plays.
    Kml,
    /// GPX 1.1: one track for raw and one for each compensated.
    Gpx,
    /// CSV: one row per instant.
    Csv,
    /// MCAP: `sensor_msgs/msg/NavSatFix` (ROS 2) and `foxglove.LocationFix` for raw and compensated, with layouts for
    /// Foxglove and `PlotJuggler` under the names of [`layouts_of`].
    Mcap,
}

/// A track request.
#[derive(Debug, Clone, Copy)]
pub struct TrackOrder<'a> {
    /// The `track.parquet` of a flight.
    pub track: &'a Path,
    /// Name of the flight.
    pub name: &'a str,
    /// Output format.
    pub to: TrackTo,
    /// Maximum points per second; `None`: every row.
    pub most_hz: Option<f64>,
    /// The output file.
    pub out: &'a Path,
}

/// The result of writing a track.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct WrittenTrack {
    /// Names of the lines: `raw`, `exact`.
    pub lines: Vec<String>,
    /// Instants written.
    pub points: u64,
    /// Rows of the track.
    pub of: u64,
    /// Whether the points have UTC times.
    pub has_utc: bool,
}

/// Paths of the layouts written with an MCAP: for Foxglove, for `PlotJuggler`.
#[must_use]
pub fn layouts_of(recording: &Path) -> [PathBuf; 2] {
    ["foxglove.json", "plotjuggler.xml"].map(|ending| recording.with_extension(ending))
}

/// Writes the result table of a flight with its descriptions, as `track.parquet`: the first part of its rows, then the
/// others.
///
/// # Errors
/// The file cannot be written, or a part has different columns from the first.
pub fn write_track_table(
    first: &Sheet,
    others: impl Iterator<Item = Sheet>,
    about: &str,
    file: impl Write + Send,
) -> io::Result<()> {
    write_parquet_parts(first, others, &[(METADATA.to_owned(), about.to_owned())], file)
}

/// A position, degrees and metres.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Place {
    latitude_deg: f64,
    longitude_deg: f64,
    height_m: f64,
}

/// An instant, and the position of each line.
#[derive(Debug, Clone, PartialEq)]
struct Instant {
    t_s: f64,
    utc_ns: Option<i64>,
    places: [Option<Place>; 2],
}

/// The content of a `track.parquet`.
struct Track {
    name: String,
    instants: Vec<Instant>,
    rows: u64,
    /// The file's metadata.
    about: String,
}

/// The lines of a track, and their names in files.
const LINES: [(&str, &str, &str); 2] = [
    ("raw", "raw", "Position as logged, with the newest fix held"),
    ("compensated", "exact_async", "Position with its delay removed, p + ∫v (exact asynchronous)"),
];

impl Track {
    /// Instants with a position on this line, split at gaps.
    fn pieces(&self, line: usize) -> impl Iterator<Item = Vec<(&Instant, Place)>> {
        self.instants
            .split(move |i| i.places[line].is_none())
            .filter(|piece| !piece.is_empty())
            .map(move |piece| piece.iter().filter_map(|i| Some((i, i.places[line]?))).collect::<Vec<_>>())
    }
}

/// Writes the track of a flight as a file for maps and players. The file appears complete or not at all.
///
/// # Errors
/// The track cannot be read or has no positions, or the output cannot be written.
pub fn export_track(order: &TrackOrder<'_>) -> Result<WrittenTrack, ConvertError> {
    let layouts = if order.to == TrackTo::Mcap { layouts_of(order.out).into() } else { vec![] };
    for path in layouts.iter().map(PathBuf::as_path).chain([order.out]) {
        may_write(path, &[order.track.to_owned()])?;
    }
    let track = read(order)?;
    let output = Output::begin(order.out)?;
    let mut file = BufWriter::new(output.file()?);
    let failed = |e| ConvertError::write(order.out, "write")(e);
    match order.to {
        TrackTo::GeoJson => map_files::geojson(&track, &mut file).map_err(failed)?,
        TrackTo::Kml => map_files::kml(&track, &mut file).map_err(failed)?,
        TrackTo::Gpx => map_files::gpx(&track, &mut file).map_err(failed)?,
        TrackTo::Csv => write_csv(&sheet(&track), &mut file).map_err(failed)?,
        TrackTo::Mcap => track_recording::write(&track, order.out, output.file()?)?,
    }
    file.flush().map_err(failed)?;
    drop(file);
    output.keep()?;
    let recording = order.out.file_name().unwrap_or_default().to_string_lossy();
    for (path, text) in layouts.iter().zip([layouts::foxglove(&track), layouts::plotjuggler(&recording)]) {
        let output = Output::begin(path)?;
        output.file()?.write_all(text.as_bytes()).map_err(ConvertError::write(path, "write"))?;
        output.keep()?;
    }
    Ok(WrittenTrack {
        lines: LINES.iter().map(|(name, ..)| (*name).to_owned()).collect(),
        points: track.instants.len() as u64,
        of: track.rows,
        has_utc: track.instants.iter().any(|i| i.utc_ns.is_some()),
    })
}

fn read(order: &TrackOrder<'_>) -> Result<Track, ConvertError> {
    let refused = |what: String| ConvertError::Refused { path: order.track.to_owned(), what };
    let file = File::open(order.track).map_err(|e| refused(e.to_string()))?;
    let ReadTable { sheet, mut about } = read_parquet(file).map_err(|e| refused(format!("no track: {e}")))?;
    let instants = instants(&sheet, order.most_hz).map_err(refused)?;
    if !instants.iter().any(|i| i.places[1].is_some()) {
        return Err(refused("the flight has no latitude and longitude to plot".to_owned()));
    }
    Ok(Track {
        name: order.name.to_owned(),
        instants,
        rows: sheet.rows() as u64,
        about: about.remove(METADATA).unwrap_or_default(),
    })
}

/// Up to `most_hz` rows of a track per second, or what the table lacks.
fn instants(sheet: &Sheet, most_hz: Option<f64>) -> Result<Vec<Instant>, String> {
    let needed = |name: &str| match sheet.cells(name) {
        Some(Cells::F64(numbers)) => Ok(numbers),
        _ => Err(format!("no column {name}: run the campaign again, then export again")),
    };
    let (t, height) = (needed("t_s")?, needed("height_m")?);
    let utc = match sheet.cells("utc_ns") {
        Some(Cells::I64(utc)) => utc.iter().collect(),
        _ => vec![None; t.len()],
    };
    let mut lines = vec![];
    for (_, column, _) in LINES {
        lines.push((needed(&format!("{column}_latitude_deg"))?, needed(&format!("{column}_longitude_deg"))?));
    }
    let place = |line: usize, row: usize| {
        let (latitude, longitude) = &lines[line];
        Some(Place { latitude_deg: latitude.get(row)?, longitude_deg: longitude.get(row)?, height_m: height.get(row)? })
    };
    let mut instants: Vec<Instant> = vec![];
    let mut last = None;
    for (row, utc_ns) in utc.into_iter().enumerate() {
        let Some(t_s) = t.get(row) else { continue };
        // The first row of each interval: a slightly slow or fast clock leaves no interval empty.
        let interval = most_hz.map(|hz| (t_s * hz + 1e-6).floor());
        if interval.is_none() || interval != last {
            last = interval;
            instants.push(Instant { t_s, utc_ns, places: [place(0, row), place(1, row)] });
        }
    }
    Ok(instants)
}

/// One row per instant.
fn sheet(track: &Track) -> Sheet {
    let number = |name: &str, of: &dyn Fn(&Instant) -> Option<f64>| SheetColumn {
        name: name.to_owned(),
        cells: Cells::F64(track.instants.iter().map(of).collect()),
    };
    let utc = Cells::I64(track.instants.iter().map(|i| i.utc_ns).collect());
    let mut columns = vec![SheetColumn { name: "utc_ns".to_owned(), cells: utc }, number("t_s", &|i| Some(i.t_s))];
    for (line, (name, ..)) in LINES.iter().enumerate() {
        columns.push(number(&format!("{name}_latitude_deg"), &|i| Some(i.places[line]?.latitude_deg)));
        columns.push(number(&format!("{name}_longitude_deg"), &|i| Some(i.places[line]?.longitude_deg)));
    }
    columns.push(number("height_m", &|i| Some(i.places[0].or(i.places[1])?.height_m)));
    Sheet { columns }
}
