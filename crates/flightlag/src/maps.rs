//! `flightlag maps`: lists the channel maps, and prints one of them.

use crate::arguments::MapsArguments;
use crate::failure::{End, Failure};
use crate::inspect::unit_of;
use crate::show::Table;
use crate::stop::Stop;
use campaign::Exit;
use ingest::{FlightUnit, IngestError, Limits, LogKind, MapLibrary, ReadContext, suggest};
use std::io::Write;
use std::path::Path;

pub(crate) fn run(arguments: &MapsArguments, stop: &Stop) -> Result<End, Failure> {
    if arguments.example {
        write!(std::io::stdout(), "{}", ingest::EXAMPLE_MAP)?;
        return Ok(Exit::Well.into());
    }
    let library = library(arguments.maps.as_deref())?;
    if let Some(log) = &arguments.suggest {
        let unit = unit_of_table(log, &library)?;
        let context = ReadContext { limits: Limits::default(), cancel: stop.flag(), on_bytes: &|_| {} };
        let text =
            suggest(&unit, &context).map_err(|e| Failure::new(Exit::Failed, format!("{}: {e}", log.display())))?;
        write!(std::io::stdout(), "{text}")?;
        return Ok(Exit::Well.into());
    }
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

/// A flight, or a table without a header, which is a flight only by means of a map.
fn unit_of_table(path: &Path, library: &MapLibrary) -> Result<FlightUnit, Failure> {
    let is_text = path.extension().is_some_and(|ending| ending == "csv" || ending == "txt");
    unit_of(path, library).or_else(|failure| {
        let unit = FlightUnit { id: path.display().to_string(), files: vec![path.to_owned()], kind: LogKind::Csv };
        if path.is_file() && is_text { Ok(unit) } else { Err(failure) }
    })
}

/// An unknown map is a usage error, not an unreadable log.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unknown_map_is_a_usage_error_with_the_nearest_names() {
        let library = library(None).unwrap();
        let known = library.iter().next().unwrap().name.clone();
        assert!(check_name(&library, None).is_ok() && check_name(&library, Some(&known)).is_ok());
        let misspelt = format!("{known}x");
        let failure = format!("{:?}", check_name(&library, Some(&misspelt)).unwrap_err());
        assert!(
            failure.starts_with("Failure { exit: Wrong") && failure.contains(&format!("nearest are {known}")),
            "{failure}"
        );
    }

    #[test]
    fn a_text_file_that_is_not_a_flight_may_still_be_a_table() {
        let folder = tempfile::tempdir().unwrap();
        let library = library(None).unwrap();
        for (name, is_table) in [("a.csv", true), ("a.txt", true), ("a.bin", false), ("missing.csv", false)] {
            let path = folder.path().join(name);
            if name.starts_with('a') {
                std::fs::write(&path, "hello\n").unwrap();
            }
            let unit = unit_of_table(&path, &library);
            assert_eq!(unit.is_ok_and(|unit| unit.kind == LogKind::Csv && unit.files == [path]), is_table, "{name}");
        }
    }
}
