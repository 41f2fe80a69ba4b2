//! Finds the flights below a folder.

use crate::platform::{FileIdentity, identity};
use binding::{IngestError, MapLibrary};
use formats::bag_folder::{self, Metadata};
use formats::sniff::{self, Content};
use formats::{
    FlightUnit, Limits, LogKind, PACKED_ENDINGS, Packing, ReadContext, file_name, is_packed_of, members,
    write_ahead_log_of,
};
use logscan::ScanError;
use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};
use std::fs::{self, File, FileType};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

/// The deepest level of nested folders that is searched.
const DEPTH: usize = 64;

/// The flights below a folder, and the files that are not flights.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Discovery {
    /// Flights, sorted by id.
    pub units: Vec<FlightUnit>,
    /// Files that are not logs, by their path below the root and with the reason; sorted.
    pub ignored: Vec<(String, String)>,
    /// Files, folders and links that could not be read, in the same form. They may be logs.
    pub unreadable: Vec<(String, String)>,
}

/// Searches `root`, a folder or a single file. Files are recognised by their content. Tables in one folder are one
/// flight if their names end in the topics of a channel map, or if they differ only in the last word and that says what
/// they hold (`x_GPS.csv`, `x_IMU.csv`), or if they are TRACK.CSV, SENSOR.CSV and EVENT.CSV of a FlySight 2. Only
/// regular files are opened, every file counts once, and circular links are not followed endlessly. The order does not
/// depend on the file system.
///
/// # Errors
/// [`IngestError::Log`] if the root itself cannot be read. What cannot be read below it is listed as unreadable, with
/// the reason.
pub fn discover(root: &Path, library: &MapLibrary) -> Result<Discovery, IngestError> {
    let failed = |source| IngestError::from(ScanError::Io { file: root.display().to_string(), offset: 0, source });
    let about = fs::metadata(root).map_err(failed)?;
    let mut search = Search { library, found: Discovery::default(), seen: HashMap::new() };
    if about.is_dir() {
        let entries = fs::read_dir(root).map_err(failed)?;
        let name = root.canonicalize().ok().and_then(|p| p.file_name().map(|n| n.to_string_lossy().into_owned()));
        let mut above = vec![identity(root)];
        search.folder(entries, "", &name.unwrap_or_else(|| "flight".into()), &mut above);
    } else {
        let name = file_name(root);
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

/// Names that are not UTF-8 may become equal once they are converted.
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

/// A table that may be one topic of a flight.
struct TableFile {
    path: PathBuf,
    id: String,
    stem: String,
    flysight2: bool,
    /// Whether a header names the columns. Without a header only the file name shows what the table holds.
    named: bool,
}

fn table_file(path: &Path, id: &str, flysight2: bool, named: bool) -> TableFile {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    TableFile { path: path.to_owned(), id: id.to_owned(), stem, flysight2, named }
}

/// What a packed file holds.
enum Inside {
    /// One log, or the tables of one flight.
    Log(LogKind),
    /// One table, which may be one of several of its flight.
    Table(TableFile),
}

struct Search<'a> {
    library: &'a MapLibrary,
    found: Discovery,
    /// Files by identity, with the path under which each was first found.
    seen: HashMap<FileIdentity, String>,
}

impl Search<'_> {
    fn ignore(&mut self, id: &str, reason: impl Into<String>) {
        self.found.ignored.push((id.to_owned(), reason.into()));
    }

    fn unreadable(&mut self, id: &str, verb: &str, error: &std::io::Error) {
        self.found.unreadable.push((id.to_owned(), format!("cannot be {verb}: {error}")));
    }

    fn folder(&mut self, entries: fs::ReadDir, below: &str, name: &str, above: &mut Vec<Option<FileIdentity>>) {
        let mut paths: Vec<PathBuf> = vec![];
        for entry in entries {
            match entry {
                Ok(entry) => paths.push(entry.path()),
                Err(error) => self.unreadable(below, "listed", &error),
            }
        }
        paths.sort();
        let (mut tables, first) = (vec![], self.found.units.len());
        for path in &paths {
            let name = file_name(path);
            let id = if below.is_empty() { name.clone() } else { format!("{below}/{name}") };
            if name.starts_with('.') {
                self.ignore(&id, "hidden");
                continue;
            }
            match fs::metadata(path) {
                Err(error) => self.unreadable(&id, "read", &error),
                Ok(about) if about.is_dir() => self.enter(path, &id, &name, above),
                Ok(about) => self.file(path, &id, about.file_type(), &mut tables),
            }
        }
        self.group(tables, below, name);
        self.join_recording(&paths, first, below, name);
    }

    /// Makes one flight of the files of a ROS 2 bag: those that its `metadata.yaml` names or, if the recorder was
    /// killed before writing that, those named after the folder with a number.
    fn join_recording(&mut self, paths: &[PathBuf], first: usize, below: &str, folder: &str) {
        let described = paths.iter().find(|path| path.file_name().is_some_and(|name| name == bag_folder::NAME));
        let metadata = described.and_then(|path| Some((path, Metadata::read(path).ok()??)));
        self.leave_out_copies(paths, metadata.as_ref().map(|(_, metadata)| metadata), first);
        let names = match &metadata {
            Some((_, metadata)) if !metadata.files.is_empty() => metadata.files.clone(),
            _ => self.numbered(paths, folder),
        };
        let mut parts = vec![];
        for name in names {
            let here = |unit: &FlightUnit| unit.files.first().is_some_and(|f| paths.contains(f) && f.ends_with(&name));
            let found = (first..self.found.units.len()).find(|&i| self.found.units.get(i).is_some_and(here));
            if let Some(index) = found {
                let is_bag = |unit: &FlightUnit| matches!(unit.kind, LogKind::Db3 | LogKind::Mcap);
                let kind = parts.first().map(|part: &FlightUnit| part.kind);
                let fits = |unit: &FlightUnit| is_bag(unit) && kind.is_none_or(|kind| kind == unit.kind);
                if self.found.units.get(index).is_some_and(fits) {
                    parts.push(self.found.units.remove(index));
                }
            }
        }
        if parts.is_empty() && metadata.is_some() {
            parts.extend(self.only_bag(paths, first));
        }
        let Some(one) = parts.first() else { return };
        let id = if parts.len() == 1 { one.id.clone() } else { folder_id(below, folder) };
        let kind = one.kind;
        let mut files: Vec<PathBuf> = parts.into_iter().flat_map(|part| part.files).collect();
        if let Some((path, _)) = metadata {
            let own = join(below, bag_folder::NAME);
            self.found.ignored.retain(|(id, _)| *id != own);
            files.push(path.clone());
        }
        self.found.units.push(FlightUnit { id, files, kind });
    }

    /// The only bag of a folder with a `metadata.yaml` that names missing files: the bag was renamed.
    fn only_bag(&mut self, paths: &[PathBuf], first: usize) -> Option<FlightUnit> {
        let is_here = |unit: &FlightUnit| unit.files.first().is_some_and(|file| paths.contains(file));
        let is_bag = |unit: &FlightUnit| matches!(unit.kind, LogKind::Db3 | LogKind::Mcap) && is_here(unit);
        let mut bags = (first..self.found.units.len()).filter(|&i| self.found.units.get(i).is_some_and(is_bag));
        let only = bags.next().filter(|_| bags.next().is_none())?;
        Some(self.found.units.remove(only))
    }

    /// Removes copies: playing a compressed bag leaves its files unpacked next to it. The log is the file that
    /// `metadata.yaml` names, or without metadata the packed file, which the recorder wrote. A file with another length
    /// than the packed header states is not a copy.
    fn leave_out_copies(&mut self, paths: &[PathBuf], metadata: Option<&Metadata>, first: usize) {
        for packed in paths.iter().filter(|path| path.extension().is_some_and(|ending| ending == "zstd")) {
            let plain = packed.with_extension("");
            let is_named = |path: &Path| metadata.is_some_and(|m| m.files.iter().any(|name| path.ends_with(name)));
            let (kept, copy) = if is_named(&plain) { (&plain, packed) } else { (packed, &plain) };
            let bag_of = |found: &Discovery, path: &PathBuf| {
                let is_it = |unit: &FlightUnit| {
                    unit.files == [path.clone()] && matches!(unit.kind, LogKind::Db3 | LogKind::Mcap)
                };
                found.units.iter().skip(first).position(is_it).map(|index| first + index)
            };
            let copy =
                bag_of(&self.found, kept).and(bag_of(&self.found, copy)).filter(|_| is_packed_of(packed, &plain));
            if let Some(copy) = copy {
                let kept = file_name(kept);
                let copy = self.found.units.remove(copy);
                self.ignore(&copy.id, format!("the same as {kept}, packed or unpacked"));
            }
        }
    }

    /// Files named `FOLDER_0.mcap`, `FOLDER_1.mcap`, ... if there are several.
    fn numbered(&self, paths: &[PathBuf], folder: &str) -> Vec<String> {
        let number = |name: &str| {
            let (number, ending) = name.strip_prefix(folder)?.strip_prefix('_')?.split_once('.')?;
            let bag = ["db3", "mcap", "db3.zstd", "mcap.zstd"].contains(&ending);
            number.parse::<u32>().ok().filter(|_| bag)
        };
        let name = |path: &PathBuf| path.file_name().map(|name| name.to_string_lossy().into_owned());
        let mut found: Vec<(u32, String)> =
            paths.iter().filter_map(name).filter_map(|name| Some((number(&name)?, name))).collect();
        found.sort();
        if found.len() < 2 { vec![] } else { found.into_iter().map(|(_, name)| name).collect() }
    }

    fn enter(&mut self, path: &Path, id: &str, name: &str, above: &mut Vec<Option<FileIdentity>>) {
        let this = identity(path);
        if above.contains(&this) {
            return self.ignore(id, "link to a folder that contains it");
        }
        if above.len() >= DEPTH {
            return self.ignore(id, format!("more than {DEPTH} folders deep"));
        }
        // A folder with two names is searched once.
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

    /// The name under which this file or folder was first found.
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
            return self.ignore(id, "not a regular file; not opened");
        }
        if self.found.units.iter().any(|unit| unit.files.iter().skip(1).any(|file| file == path)) {
            return;
        }
        if is_sidecar_of_database(path) {
            return self.ignore(id, "belongs to a database in the same folder; the database is read without it");
        }
        if let Some(first) = self.first_name(path, id) {
            return self.ignore(id, format!("same file as {first}"));
        }
        let head = match head_of(path) {
            Ok(head) => head,
            Err(error) => return self.unreadable(id, "read", &error),
        };
        match content_of(path, &head) {
            Content::Other(reason) => self.ignore(id, reason),
            Content::Log(kind) => self.unit(id, vec![path.to_owned()], kind),
            Content::Packed(packing) => match self.inside(path, packing) {
                Ok(Inside::Log(kind)) => self.unit(id, vec![path.to_owned()], kind),
                // Tables of several packed files may be one flight, as may those of several plain files.
                Ok(Inside::Table(table)) => {
                    tables.push(TableFile { path: path.to_owned(), id: id.to_owned(), ..table })
                }
                Err(reason) => self.ignore(id, reason),
            },
            Content::Table { flysight2, named } if named || self.is_topic(path) => {
                tables.push(table_file(path, id, flysight2, named));
            }
            Content::Table { .. } => {
                self.ignore(id, "a table of numbers without a header, and no channel map has its name")
            }
        }
    }

    /// Whether a channel map names a topic that matches the file name.
    fn is_topic(&self, path: &Path) -> bool {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        self.library.flight_prefix(&stem, true).is_some()
    }

    /// The kind of log a packed file holds; the reason if it is not one flight.
    fn inside(&self, path: &Path, packing: Packing) -> Result<Inside, String> {
        let (mut logs, mut tables, mut others) = (vec![], vec![], vec![]);
        for member in members(path, packing).map_err(|e| e.to_string())? {
            let name = member.name.display().to_string();
            if let Some(fault) = member.fault {
                others.push(format!("{name} cannot be unpacked: {fault}"));
                continue;
            }
            if !member.head.is_empty() && member.head.iter().all(|b| *b == 0) {
                others.push(format!("{name} holds only zero bytes"));
                continue;
            }
            match content_of(&member.name, &member.head) {
                Content::Log(kind) => logs.push((name, kind)),
                Content::Table { flysight2, named } if named || self.is_topic(&member.name) => {
                    tables.push(table_file(&member.name, &name, flysight2, named));
                }
                Content::Table { .. } => others.push(format!("{name} is a table without a header")),
                Content::Packed(_) => others.push(format!("{name} is packed again; unpack it first")),
                Content::Other(reason) => others.push(format!("{name} is {reason}")),
            }
        }
        let several = |names: Vec<&str>| Err(format!("archive of several logs, {}; unpack it first", names.join(", ")));
        match logs.as_slice() {
            [(_, kind)] => return Ok(Inside::Log(*kind)),
            [] if packing != Packing::Zip && tables.len() == 1 => {
                return tables.pop().map(Inside::Table).ok_or_else(String::new);
            }
            [] => {}
            several_logs => return several(several_logs.iter().map(|(name, _)| name.as_str()).collect()),
        }
        let mut inner = Search { library: self.library, found: Discovery::default(), seen: HashMap::new() };
        inner.group(tables, "", "flight");
        match inner.found.units.as_slice() {
            [_] => Ok(Inside::Log(LogKind::Csv)),
            [] => Err(others.first().map_or("archive without a file".to_owned(), |other| format!("packed: {other}"))),
            units => several(units.iter().map(|u| u.id.as_str()).collect()),
        }
    }

    fn unit(&mut self, id: &str, mut files: Vec<PathBuf>, kind: LogKind) {
        if let (LogKind::Db3, [database]) = (kind, files.as_slice()) {
            files.extend(write_ahead_log(database));
        }
        self.found.units.push(FlightUnit { id: id.to_owned(), files, kind });
    }

    /// Groups the tables of one folder into flights.
    fn group(&mut self, tables: Vec<TableFile>, below: &str, folder: &str) {
        let prefixes = self.prefixes(&tables);
        let shared = shared_prefixes(&tables);
        let one_flysight = is_one_flysight2(&tables);
        let mut groups: BTreeMap<String, Vec<TableFile>> = BTreeMap::new();
        for table in tables {
            let of_topics = prefixes.iter().filter(|p| table.stem.starts_with(p.as_str())).max_by_key(|p| p.len());
            let prefix = of_topics.or_else(|| shared.get(&table.stem));
            let name = match prefix {
                _ if one_flysight && table.flysight2 => folder_id(below, folder),
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

    /// The prefixes before the topic names: those of flights or, if there are none, those of a bench. With an empty
    /// prefix two files must match, because all tables of the folder then belong together.
    fn prefixes(&self, tables: &[TableFile]) -> BTreeSet<String> {
        let of = |sensed: bool| -> Vec<&str> {
            tables.iter().filter_map(|t| self.library.flight_prefix(&t.stem, sensed)).collect()
        };
        let found = Some(of(false)).filter(|found| !found.is_empty()).unwrap_or_else(|| of(true));
        let without_prefix = found.iter().filter(|p| p.is_empty()).count();
        // A table without a header was recognised by its name.
        let together = without_prefix > 1 || tables.iter().any(|t| !t.named);
        found.iter().filter(|p| !p.is_empty() || together).map(|p| (*p).to_owned()).collect()
    }
}

/// What the files of one flight may hold, as the last word of their names.
const PARTS: [&str; 19] = [
    "gps", "gnss", "pos", "position", "vel", "velocity", "nav", "ins", "ekf", "imu", "att", "attitude", "acc", "accel",
    "gyro", "mag", "baro", "wind", "airdata",
];
/// Separators before such a word.
const BEFORE_PART: [char; 4] = ['_', '-', '.', ' '];

/// The common part of several table names next to a word for the part of the flight that they hold: `x` in `x_GPS` and
/// `x_POS`, or in `GPS_x` and `POS_x`; nothing in `gps` and `imu`. Keyed by table.
fn shared_prefixes(tables: &[TableFile]) -> BTreeMap<String, String> {
    let mut fronts: BTreeMap<&str, BTreeMap<String, &str>> = BTreeMap::new();
    for table in tables.iter().filter(|t| t.named) {
        let stem = table.stem.as_str();
        let splits =
            [Some(("", stem)), stem.rsplit_once(BEFORE_PART), stem.split_once(BEFORE_PART).map(|(a, b)| (b, a))];
        for (front, part) in splits.into_iter().flatten() {
            let part = part.to_ascii_lowercase();
            if PARTS.contains(&part.as_str()) {
                fronts.entry(front).or_default().insert(part, stem);
            }
        }
    }
    let several = fronts.into_iter().filter(|(_, parts)| parts.len() > 1);
    several.flat_map(|(front, parts)| parts.into_values().map(|stem| (stem.to_owned(), front.to_owned()))).collect()
}

/// Whether the files of a FlySight 2 are one flight: one track with its sensor and event files.
fn is_one_flysight2(tables: &[TableFile]) -> bool {
    let is = |name: &str, table: &TableFile| table.stem.eq_ignore_ascii_case(name);
    let own: Vec<&TableFile> = tables.iter().filter(|t| t.flysight2).collect();
    own.iter().filter(|t| is("TRACK", t)).count() == 1
        && own.iter().all(|t| ["TRACK", "SENSOR", "EVENT"].iter().any(|name| is(name, t)))
}

fn folder_id(below: &str, folder: &str) -> String {
    if below.is_empty() { folder.to_owned() } else { below.to_owned() }
}

fn join(below: &str, name: &str) -> String {
    if below.is_empty() { name.to_owned() } else { format!("{below}/{name}") }
}

/// The write-ahead log of a database that was not closed, also if the database was packed later.
fn write_ahead_log(database: &Path) -> Option<PathBuf> {
    let packed = database.extension().is_some_and(|e| PACKED_ENDINGS.iter().any(|ending| e == *ending));
    let unpacked = if packed { database.with_extension("") } else { database.to_owned() };
    let path = write_ahead_log_of(&unpacked);
    fs::metadata(&path).is_ok_and(|about| about.is_file() && about.len() > 0).then_some(path)
}

/// Whether a file is a write-ahead log, its index, or a journal, as SQLite leaves them next to a database.
fn is_sidecar_of_database(path: &Path) -> bool {
    let name = path.to_string_lossy();
    let database = ["-wal", "-shm", "-journal"].iter().find_map(|end| name.strip_suffix(end));
    let is_there = |database: &str| {
        let packed = |ending: &&str| Path::new(&format!("{database}.{ending}")).is_file();
        Path::new(database).is_file() || PACKED_ENDINGS.iter().any(packed)
    };
    database.is_some_and(|database| database.ends_with(".db3") && is_there(database))
}

fn content_of(path: &Path, head: &[u8]) -> Content {
    let cancel = AtomicBool::new(false);
    let context = ReadContext { limits: Limits::default(), cancel: &cancel, on_bytes: &|_| () };
    sniff::content_of(path, head, &context)
}

fn head_of(path: &Path) -> std::io::Result<Vec<u8>> {
    let mut head = vec![];
    File::open(path)?.take(sniff::HEAD as u64).read_to_end(&mut head)?;
    Ok(head)
}
