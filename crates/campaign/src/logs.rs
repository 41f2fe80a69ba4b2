//! The logs of this crate: flights in a folder, and the channel maps to read them with.

use crate::config::Pipeline;
use crate::error::CampaignError;
use crate::fetch::Logs;
use crate::file_stamp::FileStamp;
use crate::losses;
use crate::manifest::{FLIGHTLAG_VERSION, hash_of_parts};
use crate::run_context::RunContext;
use crate::store::Store;
use compensation_replay::{REFERENCE_POSITION, REFERENCE_VELOCITY};
use ingest::{FlightUnit, IngestError, Loaded, LogError, MapLibrary, ReadContext, ScanError, discover, load};
use record::IgnoredInput;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// Maximum number of names suggested for a channel that no map binds.
const NEAREST: usize = 5;

/// The channel maps of a campaign with the message definitions next to them, and the hash of their rules.
pub(crate) struct Library {
    maps: MapLibrary,
    blake3: String,
}

impl Library {
    /// The shipped maps and those of a folder. A forced map alone decides: a change of the others then
    /// changes no result.
    pub(crate) fn open(folder: Option<&Path>, forced: Option<&str>) -> Result<Library, CampaignError> {
        let shipped = MapLibrary::shipped()?;
        let maps = folder.map_or(Ok(shipped.clone()), |f| shipped.with_folder(f)).map_err(as_asked)?;
        let mut hasher = blake3::Hasher::new();
        match forced {
            Some(name) => hash_map(&mut hasher, maps.get(name).map_err(as_asked)?),
            None => maps.iter().for_each(|map| hash_map(&mut hasher, map)),
        }
        maps.definitions().flat_map(|(name, text)| [name, text]).for_each(|text| hash_text(&mut hasher, text));
        Ok(Library { blake3: hasher.finalize().to_hex().to_string(), maps })
    }

    /// Checks that some map binds every channel of the pipeline. Otherwise a misspelt name would count as a channel
    /// that no flight has, and the next in the list would be used.
    pub(crate) fn check(&self, pipeline: &Pipeline) -> Result<(), CampaignError> {
        let known: BTreeSet<&str> = self.maps.channel_names().collect();
        let of_reference_file = |name: &str| [REFERENCE_POSITION, REFERENCE_VELOCITY].contains(&name);
        let is_known = |name: &&str| known.contains(name) || of_reference_file(name);
        let file = pipeline.file_name();
        let complaint = |name: &str| {
            let near = settings::nearest_few(name, known.iter().copied(), NEAREST).join(", ");
            let line = pipeline.line_of_channel(name).map(|line| format!(":{line}")).unwrap_or_default();
            format!("{file}{line}: [channels]: no channel map binds {name:?}; the nearest are {near}")
        };
        let mut unknown: Vec<&str> = pipeline.channel_names().filter(|name| !is_known(name)).collect();
        unknown.dedup();
        match unknown.is_empty() {
            true => Ok(()),
            false => {
                let all: Vec<String> = unknown.into_iter().map(complaint).collect();
                Err(CampaignError::Asked(all.join("\n")))
            }
        }
    }

    /// Hash of the rules of the maps.
    pub(crate) fn blake3(&self) -> &str {
        &self.blake3
    }

    /// The logs below a path.
    pub(crate) fn discover(&self, path: &Path) -> Result<ingest::Discovery, IngestError> {
        discover(path, &self.maps)
    }

    /// Reads one flight. Losses that affect no result become warnings.
    pub(crate) fn load(
        &self,
        unit: &FlightUnit,
        forced: Option<&str>,
        context: &ReadContext<'_>,
    ) -> Result<Loaded, IngestError> {
        let mut loaded = load(unit, &self.maps, forced, context)?;
        if let Ok(binding) = &loaded.binding {
            losses::weigh(&mut loaded.flight.notices, &loaded.health, binding);
        }
        Ok(loaded)
    }
}

/// Hashes the rules of a map: its debug text shows every rule, but neither comments nor the file's location.
fn hash_map(hasher: &mut blake3::Hasher, map: &ingest::ChannelMap) {
    hash_text(hasher, &format!("{map:?}"));
}

fn hash_text(hasher: &mut blake3::Hasher, text: &str) {
    hasher.update(&(text.len() as u64).to_le_bytes());
    hasher.update(text.as_bytes());
}

/// Turns the error of a missing map or folder of maps into an error of the request.
fn as_asked(error: IngestError) -> CampaignError {
    match error {
        IngestError::Log(LogError::Read(ScanError::Io { file, source, .. })) => {
            CampaignError::Asked(format!("{file}: {source}"))
        }
        IngestError::Map(what) => CampaignError::Asked(what),
        other => CampaignError::Ingest(other),
    }
}

/// Content of a folder.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Found {
    pub(crate) units: Vec<FlightUnit>,
    /// Files that are not logs, sorted by path.
    pub(crate) ignored: Vec<IgnoredInput>,
    /// Unreadable files and folders: they may be logs, and so are rows of the table
    /// instead of being skipped.
    pub(crate) unreadable: Vec<IgnoredInput>,
}

impl Found {
    fn with_files(mut self, name: impl Fn(&Path) -> PathBuf) -> Found {
        let files = self.units.iter_mut().flat_map(|unit| &mut unit.files);
        files.for_each(|file| *file = name(file));
        self
    }
}

fn look(logs: &Logs, library: &Library, context: &RunContext<'_>) -> Result<Found, CampaignError> {
    logs.fetch_heads(context.threads, context.cancel)?;
    let found = library.discover(logs.root())?;
    let inputs = |list: Vec<(String, String)>| {
        list.into_iter().map(|(path, reason)| IgnoredInput { path, reason }).collect::<Vec<_>>()
    };
    Ok(Found { units: found.units, ignored: inputs(found.ignored), unreadable: inputs(found.unreadable) })
}

/// The last search of a folder. It is reused while nothing in the folder has changed, because
/// recognising a log means opening it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct LastLook {
    /// Hash of the folder's listing and of the channel maps.
    of: String,
    found: Found,
}

const LAST_LOOK: &str = ".flightlag/found.json";

/// Searches for flights; opens no file if `fresh` is false and nothing has changed since the last search.
pub(crate) fn find(
    logs: &Logs,
    library: &Library,
    store: &Store,
    fresh: bool,
    context: &RunContext<'_>,
) -> Result<Found, CampaignError> {
    find_by(logs, library, store, fresh, || look(logs, library, context))
}

fn find_by(
    logs: &Logs,
    library: &Library,
    store: &Store,
    fresh: bool,
    look: impl FnOnce() -> Result<Found, CampaignError>,
) -> Result<Found, CampaignError> {
    let listing = logs.listing().or_else(|| listing_hash(logs.root()));
    let listing = listing.map(|listing| hash_of_parts(&[&listing, library.blake3(), FLIGHTLAG_VERSION]));
    let last: Option<LastLook> = store.read_sealed(LAST_LOOK);
    if let Some(last) = last.filter(|l| !fresh && Some(&l.of) == listing.as_ref()) {
        return Ok(last.found.with_files(|file| logs.local(file)));
    }
    let found = look()?;
    // An unreadable file may be readable next time without new timestamps.
    match listing.filter(|_| found.unreadable.is_empty() && found.units.iter().all(is_text)) {
        Some(of) => {
            let found = found.clone().with_files(|file| logs.shown(file));
            store.write_sealed(LAST_LOOK, &LastLook { of, found })?;
        }
        None => store.remove(LAST_LOOK)?,
    }
    Ok(found)
}

/// Whether the paths of a flight are valid text. Others cannot be saved, so that the next run searches again.
fn is_text(unit: &FlightUnit) -> bool {
    unit.files.iter().all(|path| path.to_str().is_some())
}

/// Hash of the names, sizes and timestamps of everything below `root`. `None` if something is
/// unreadable, or so new that it could change again without a new timestamp.
fn listing_hash(root: &Path) -> Option<String> {
    let mut hasher = blake3::Hasher::new();
    let mut open = vec![(root.to_owned(), 0)];
    while let Some((path, depth)) = open.pop() {
        let about = std::fs::metadata(&path).ok()?;
        let stamp = FileStamp::of(&path).ok()?;
        let is_folder = about.is_dir();
        if stamp.is_too_fresh(SystemTime::now()) && !is_folder {
            return None;
        }
        hasher.update(path.as_os_str().as_encoded_bytes());
        hasher.update(format!("\0{stamp:?}\0{is_folder}\0").as_bytes());
        if is_folder {
            let entries = std::fs::read_dir(&path).ok()?.collect::<Result<Vec<_>, _>>().ok()?;
            let mut below: Vec<PathBuf> = entries.iter().map(std::fs::DirEntry::path).collect();
            below.sort();
            open.extend(below.into_iter().map(|p| (p, depth + 1)));
        }
        if depth > DEEPEST || open.len() > MOST_OPEN {
            return None;
        }
    }
    Some(hasher.finalize().to_hex().to_string())
}

/// A deeper tree, or one with more than [`MOST_OPEN`] pending entries, is searched each time: links may form cycles.
const DEEPEST: usize = 20;
const MOST_OPEN: usize = 1_000_000;

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn an_unreadable_log_is_examined_again() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().join("flights");
        std::fs::create_dir(&root).unwrap();
        std::fs::write(root.join("a.csv"), "time,word\n0,one\n").unwrap();
        std::thread::sleep(Duration::from_millis(60));
        let logs = Logs::below(&root).unwrap();
        let (store, library) = (Store::open(&folder.path().join("out")).unwrap(), Library::open(None, None).unwrap());
        let unreadable = IgnoredInput { path: "a.csv".into(), reason: "cannot be read: Input/output error".into() };
        let failing = Found { unreadable: vec![unreadable], ..Found::default() };
        let found = find_by(&logs, &library, &store, false, || Ok(failing.clone())).unwrap();
        assert_eq!(found, failing);
        let cancel = std::sync::atomic::AtomicBool::new(false);
        let context = RunContext { threads: 1, cancel: &cancel, events: &|_: &crate::Event| {} };
        let found = find(&logs, &library, &store, false, &context).unwrap();
        assert_eq!((found.units.len(), found.unreadable.len()), (1, 0));
        let again = find_by(&logs, &library, &store, false, || panic!("nothing has changed")).unwrap();
        assert_eq!(again, found);
    }
}
