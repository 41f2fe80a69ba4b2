//! `flightlag maps`: the channel maps that there are, and the text of one.

use crate::arguments::MapsArguments;
use crate::failure::{End, Failure};
use crate::show::Table;
use campaign::Exit;
use ingest::{IngestError, MapLibrary};
use std::io::Write;
use std::path::Path;

pub(crate) fn run(arguments: &MapsArguments) -> Result<End, Failure> {
    let library = library(arguments.maps.as_deref())?;
    if let Some(name) = &arguments.name {
        check_name(&library, Some(name))?;
        write!(std::io::stdout(), "{}", library.get(name)?.text())?;
        return Ok(Exit::Well.into());
    }
    let mut table = Table::new(&["map", "for"]);
    for map in library.iter() {
        table.row(vec![map.name.clone(), map.title.clone()]);
    }
    write!(std::io::stdout(), "{}", table.text())?;
    Ok(Exit::Well.into())
}

/// A map that does not exist is a wrong command, and not a log that cannot be read.
pub(crate) fn check_name(library: &MapLibrary, name: Option<&str>) -> Result<(), Failure> {
    match name.map(|name| library.get(name)) {
        Some(Err(unknown)) => Err(Failure::new(Exit::Wrong, unknown.to_string())),
        _ => Ok(()),
    }
}

/// The shipped maps and those of a folder.
pub(crate) fn library(folder: Option<&Path>) -> Result<MapLibrary, IngestError> {
    let shipped = MapLibrary::shipped()?;
    match folder {
        Some(folder) => shipped.with_folder(folder),
        None => Ok(shipped),
    }
}
