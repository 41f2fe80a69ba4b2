//! Finds the flights below a folder.

use crate::error::IngestError;
use crate::map::MapLibrary;
use crate::reader::{Limits, ReadContext};
use crate::sniff::{self, Content};
use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};
use std::fs::{self, File, FileType};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

/// Folders within folders that are gone into.
const DEPTH: usize = 64;

/// The flights below a folder, and the files that are none.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Discovery {
    /// Flights, sorted by id.
    pub units: Vec<FlightUnit>,
    /// What is no log, by its path below the root and with the reason; sorted.
    pub ignored: Vec<(String, String)>,
    /// Files, folders and links that could not be looked at, in the same way. They may be logs.
    pub unreadable: Vec<(String, String)>,
}

/// The files of one flight.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct FlightUnit {
    /// Path below the root with `/` between folders. Of several files that make one flight: their
    /// folder and the beginning that their names share.
    pub id: String,
    /// Its files, sorted.
    pub files: Vec<PathBuf>,
    /// How they are read.
    pub kind: LogKind,
}

/// A format that is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LogKind {
    /// Text tables.
    Csv,
    /// MCAP.
    Mcap,
    /// ROS 1 bag.
    Bag,
    /// PX4 ULog.
    Ulog,
    /// ArduPilot DataFlash, binary or text.
    DataFlash,
    /// MAVLink telemetry log.
    Tlog,
    /// ROS 2 bag in SQLite.
    Db3,
    /// NMEA 0183 sentences.
    Nmea,
    /// u-blox binary.
    Ubx,
}

/// Looks through `root`, a folder or a single file. Files are recognised by their content; tables in
/// one folder whose names end in the topics of a channel map are one flight, and so are TRACK.CSV and
/// SENSOR.CSV of a FlySight 2. Nothing that is no regular file is opened, every file counts once, and
/// links in a circle end. The order does not depend on the file system.
///
/// # Errors
/// [`IngestError::Io`] if the root itself cannot be looked at. What cannot be read below it is listed
/// as unreadable, with the reason.
pub fn discover(root: &Path, library: &MapLibrary) -> Result<Discovery, IngestError> {
    let failed = |source| IngestError::Io { file: root.display().to_string(), offset: 0, source };
    let about = fs::metadata(root).map_err(failed)?;
    let mut search = Search { library, found: Discovery::default(), seen: HashMap::new() };
    if about.is_dir() {
        let entries = fs::read_dir(root).map_err(failed)?;
        let name = root.canonicalize().ok().and_then(|p| p.file_name().map(|n| n.to_string_lossy().into_owned()));
        let mut above = vec![identity(root)];
        search.folder(entries, "", &name.unwrap_or_else(|| "flight".into()), &mut above);
    } else {
        let name = root.file_name().unwrap_or(root.as_os_str()).to_string_lossy().into_owned();
        let mut tables = vec![];
        search.file(root, &name, about.file_type(), &mut tables);
        search.group(tables, "", &name);
    }
    let mut found = search.found;
    found.units.sort_by(|a, b| a.id.cmp(&b.id).then_with(|| a.files.cmp(&b.files)));
    found.ignored.sort();
    found.unreadable.sort();
    make_unique(&mut found.units);
    Ok(found)
}

/// Names that are no UTF-8 may look alike once they are.
fn make_unique(units: &mut [FlightUnit]) {
    let mut taken = HashSet::new();
    for unit in units {
        let mut count = 1;
        let plain = unit.id.clone();
        while !taken.insert(unit.id.clone()) {
            count += 1;
            unit.id = format!("{plain}~{count}");
        }
    }
}

/// Device and number of a file: the same for every name that it has.
type Identity = Option<(u64, u64)>;

fn identity(path: &Path) -> Identity {
    use std::os::unix::fs::MetadataExt;
    fs::metadata(path).ok().map(|m| (m.dev(), m.ino()))
}

/// A table that may be one topic of a flight.
struct TableFile {
    path: PathBuf,
    id: String,
    stem: String,
    flysight2: bool,
}

struct Search<'a> {
    library: &'a MapLibrary,
    found: Discovery,
    /// Files by identity, with the path under which each was found first.
    seen: HashMap<(u64, u64), String>,
}

impl Search<'_> {
    fn ignore(&mut self, id: &str, reason: impl Into<String>) {
        self.found.ignored.push((id.to_owned(), reason.into()));
    }

    fn unreadable(&mut self, id: &str, verb: &str, error: &std::io::Error) {
        self.found.unreadable.push((id.to_owned(), format!("cannot be {verb}: {error}")));
    }

    fn folder(&mut self, entries: fs::ReadDir, below: &str, name: &str, above: &mut Vec<Identity>) {
        let mut paths: Vec<PathBuf> = vec![];
        for entry in entries {
            match entry {
                Ok(entry) => paths.push(entry.path()),
                Err(error) => self.unreadable(below, "listed", &error),
            }
        }
        paths.sort();
        let mut tables = vec![];
        for path in paths {
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let id = if below.is_empty() { name.clone() } else { format!("{below}/{name}") };
            if name.starts_with('.') {
                self.ignore(&id, "hidden");
                continue;
            }
            match fs::metadata(&path) {
                Err(error) => self.unreadable(&id, "read", &error),
                Ok(about) if about.is_dir() => self.enter(&path, &id, &name, above),
                Ok(about) => self.file(&path, &id, about.file_type(), &mut tables),
            }
        }
        self.group(tables, below, name);
    }

    fn enter(&mut self, path: &Path, id: &str, name: &str, above: &mut Vec<Identity>) {
        let this = identity(path);
        if above.contains(&this) {
            return self.ignore(id, "link to a folder around it");
        }
        if above.len() >= DEPTH {
            return self.ignore(id, format!("more than {DEPTH} folders deep"));
        }
        // A folder with two names is gone into once.
        if let Some(first) = self.first_name(path, id) {
            return self.ignore(id, format!("same folder as {first}"));
        }
        match fs::read_dir(path) {
            Err(error) => self.unreadable(id, "listed", &error),
            Ok(entries) => {
                above.push(this);
                self.folder(entries, id, name, above);
                above.pop();
            }
        }
    }

    /// The name under which this file or folder was found before.
    fn first_name(&mut self, path: &Path, id: &str) -> Option<String> {
        let identity = identity(path)?;
        match self.seen.get(&identity) {
            Some(first) => Some(first.clone()),
            None => {
                self.seen.insert(identity, id.to_owned());
                None
            }
        }
    }

    fn file(&mut self, path: &Path, id: &str, file_type: FileType, tables: &mut Vec<TableFile>) {
        if !file_type.is_file() {
            return self.ignore(id, "no regular file; not opened");
        }
        if let Some(first) = self.first_name(path, id) {
            return self.ignore(id, format!("same file as {first}"));
        }
        let head = match head_of(path) {
            Ok(head) => head,
            Err(error) => return self.unreadable(id, "read", &error),
        };
        let cancel = AtomicBool::new(false);
        let context = ReadContext { limits: Limits::default(), cancel: &cancel, on_bytes: &|_| () };
        match sniff::content_of(path, &head, &context) {
            Content::Other(reason) => self.ignore(id, reason),
            Content::Log(kind) => self.unit(id, vec![path.to_owned()], kind),
            Content::Table { flysight2 } => {
                let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
                tables.push(TableFile { path: path.to_owned(), id: id.to_owned(), stem, flysight2 });
            }
        }
    }

    fn unit(&mut self, id: &str, files: Vec<PathBuf>, kind: LogKind) {
        self.found.units.push(FlightUnit { id: id.to_owned(), files, kind });
    }

    /// Sorts the tables of one folder into flights.
    fn group(&mut self, tables: Vec<TableFile>, below: &str, folder: &str) {
        let prefixes = self.prefixes(&tables);
        let pair = is_flysight2_pair(&tables);
        let mut groups: BTreeMap<String, Vec<TableFile>> = BTreeMap::new();
        for table in tables {
            let prefix = prefixes.iter().filter(|p| table.stem.starts_with(p.as_str())).max_by_key(|p| p.len());
            let name = match prefix {
                _ if pair && table.flysight2 => folder_id(below, folder),
                Some(prefix) if prefix.is_empty() => folder_id(below, folder),
                Some(prefix) => join(below, prefix.trim_end_matches(['-', '_', ' ', '.'])),
                None => {
                    self.unit(&table.id, vec![table.path], LogKind::Csv);
                    continue;
                }
            };
            groups.entry(name).or_default().push(table);
        }
        for (name, tables) in groups {
            let id = if let [only] = tables.as_slice() { only.id.clone() } else { name };
            self.unit(&id, tables.into_iter().map(|t| t.path).collect(), LogKind::Csv);
        }
    }

    /// What stands before the topics' names: of those of flights, or where there are none, of those of a bench.
    /// Without anything before them two files must agree, for then all tables of the folder belong together.
    fn prefixes(&self, tables: &[TableFile]) -> BTreeSet<String> {
        let of = |sensed: bool| -> Vec<&str> {
            tables.iter().filter_map(|t| self.library.flight_prefix(&t.stem, sensed)).collect()
        };
        let found = Some(of(false)).filter(|found| !found.is_empty()).unwrap_or_else(|| of(true));
        let bare = found.iter().filter(|p| p.is_empty()).count();
        found.iter().filter(|p| !p.is_empty() || bare > 1).map(|p| (*p).to_owned()).collect()
    }
}

fn is_flysight2_pair(tables: &[TableFile]) -> bool {
    let own: Vec<&TableFile> = tables.iter().filter(|t| t.flysight2).collect();
    own.len() == 2 && ["TRACK", "SENSOR"].iter().all(|name| own.iter().any(|t| t.stem.eq_ignore_ascii_case(name)))
}

fn folder_id(below: &str, folder: &str) -> String {
    if below.is_empty() { folder.to_owned() } else { below.to_owned() }
}

fn join(below: &str, name: &str) -> String {
    if below.is_empty() { name.to_owned() } else { format!("{below}/{name}") }
}

fn head_of(path: &Path) -> std::io::Result<Vec<u8>> {
    let mut head = vec![];
    File::open(path)?.take(sniff::HEAD as u64).read_to_end(&mut head)?;
    Ok(head)
}
