//! The work of a campaign: every flight with its keys, and the shard that does its work.
//!
//! A campaign has two stages. *Measure* finds how late each flight's channels are. *Replay* removes a delay that may
//! come from all flights of a group, and so needs all measurements first. A manifest assigns the work of one stage:
//! plan, run its tasks, plan again, until a plan has no shards left.
//!
//! A manifest is written once and never changed. An engine (a job array, a shell loop) only
//! passes a shard number and reads an exit code.

use crate::ANALYSIS_VERSION;
use crate::cards::CardFile;
use crate::disk::may_heal;
use crate::error::CampaignError;
use crate::file_stamp::FileStamp;
use crate::s3;
use crate::store::{Keep, Store, read_unopened};
use crate::test_cards::TestCardFiles;
use ingest::{FlightUnit, LogKind};
use record::{CriteriaUse, Decision, IgnoredInput, InputFile, PipelineUse, RECORD_VERSION};
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::time::Duration;

const MANIFEST_VERSION: u32 = 6;

/// Folder of plans, below the output folder.
pub(crate) const PLANS: &str = ".flightlag/plans";
/// The tasks of a plan end within this time.
const PLAN_LIFE: Duration = Duration::from_secs(14 * 24 * 3600);

/// Version of this flightlag.
pub(crate) const FLIGHTLAG_VERSION: &str = env!("CARGO_PKG_VERSION");

/// The plan of a campaign.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    manifest_version: u32,
    pub(crate) flightlag_version: String,
    pub(crate) analysis_version: u32,
    pub(crate) record_version: u32,
    /// Name of the campaign.
    pub(crate) name: String,
    /// Folder of the flights, absolute.
    pub(crate) root: PathBuf,
    /// Output folder, absolute.
    pub(crate) out: PathBuf,
    /// The identifier that the output folder got at its first write.
    pub(crate) out_id: String,
    pub(crate) pipeline: PipelineUse,
    /// Hash of the settings that a measurement depends on.
    pub(crate) measure_blake3: String,
    /// Hash of the settings that a result depends on.
    pub(crate) replay_blake3: String,
    /// Criteria that flights are judged by; not part of a result's key.
    pub(crate) criteria: Option<CriteriaUse>,
    /// The planned test cards; not part of a result's key either.
    #[serde(default)]
    pub(crate) test_cards: TestCardFiles,
    /// Sensor cards that provide delays; their hashes are part of the pipeline.
    pub(crate) cards: Vec<CardFile>,
    pub(crate) maps_folder: Option<PathBuf>,
    /// Content of all channel maps.
    pub(crate) maps_blake3: String,
    /// Command that reproduces this campaign, with names instead of paths.
    pub(crate) command: String,
    /// Number of shards; 0 if every result exists.
    pub(crate) shards: u32,
    /// Sorted by name.
    pub(crate) flights: Vec<Planned>,
    /// Sorted by path.
    pub(crate) ignored: Vec<IgnoredInput>,
}

/// The plan of a flight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Planned {
    /// Path below the folder of flights.
    pub(crate) flight: String,
    /// Format; `None` if it was not detected.
    pub(crate) kind: Option<LogKind>,
    /// Its files, sorted.
    pub(crate) files: Vec<PlannedFile>,
    /// Its reference file, and whether it exists; `None` without a rule.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) reference: Option<PlannedReference>,
    /// Hash of the names and contents of its files; `None` if one is unreadable.
    pub(crate) content: Option<String>,
    /// Key of the measurement of its delays; `None` as above.
    pub(crate) measure_key: Option<String>,
    /// The delay to remove from its position; `None` until every flight is measured.
    pub(crate) decision: Option<Decision>,
    /// Key of its result; `None` until the delay is decided.
    pub(crate) key: Option<String>,
    /// Why a file is unreadable.
    pub(crate) trouble: Option<String>,
    /// The stage with work to do; `None` if its result exists, or cannot be made.
    pub(crate) stage: Option<Stage>,
    /// Why that work is necessary; empty if there is none.
    pub(crate) why: Vec<Why>,
    /// The shard that does it; `None` if there is no work, or a flight with the same key has it.
    pub(crate) shard: Option<u32>,
    /// Whether its log is still being written, so that its content of the last run is used.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub(crate) is_kept: bool,
}

/// A stage of a campaign.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Stage {
    /// How late each channel of a flight is.
    Measure,
    /// What compensation achieves with the removed delay.
    Replay,
}

impl fmt::Display for Stage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Stage::Measure => "measure",
            Stage::Replay => "replay",
        })
    }
}

/// A file of a flight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct PlannedFile {
    /// Absolute path.
    pub(crate) path: PathBuf,
    /// Metadata from the file system when its content was hashed.
    pub(crate) stamp: FileStamp,
    /// BLAKE3 of its content.
    pub(crate) blake3: String,
}

/// The reference file in the plan of a flight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum PlannedReference {
    /// Its format and files.
    Files { kind: LogKind, files: Vec<PlannedFile> },
    /// Why there is none.
    Missing { file: String, reason: String },
}

impl PlannedReference {
    fn files(&self) -> &[PlannedFile] {
        match self {
            PlannedReference::Files { files, .. } => files,
            PlannedReference::Missing { .. } => &[],
        }
    }

    fn files_mut(&mut self) -> &mut [PlannedFile] {
        match self {
            PlannedReference::Files { files, .. } => files,
            PlannedReference::Missing { .. } => &mut [],
        }
    }

    /// The form in which it is read.
    pub(crate) fn found(&self) -> FoundReference {
        match self {
            PlannedReference::Files { kind, files } => {
                let files: Vec<PathBuf> = files.iter().map(|f| f.path.clone()).collect();
                FoundReference::There(FlightUnit { id: String::new(), files, kind: *kind })
            }
            PlannedReference::Missing { file, reason } => {
                FoundReference::Missing { file: file.clone(), reason: reason.clone() }
            }
        }
    }
}

/// The reference file of a flight.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum FoundReference {
    /// The file to read.
    There(FlightUnit),
    /// It is missing.
    Missing { file: String, reason: String },
}

/// Why a log must be read.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(tag = "why", rename_all = "kebab-case")]
pub enum Why {
    /// The flight is new to this output folder.
    NewFlight,
    /// The content or name of one of its files changed.
    LogChanged,
    /// The resolved pipeline changed.
    SettingsChanged {
        /// As `delay.position_s: was 0.4, is 0.35`.
        settings: Vec<String>,
    },
    /// A channel map was added, removed or changed.
    MapsChanged,
    /// The analysis version changed.
    AnalysisChanged {
        /// Version before.
        was: u32,
        /// Version now.
        is: u32,
    },
    /// The record version changed.
    RecordsChanged {
        /// Version before.
        was: u32,
        /// Version now.
        is: u32,
    },
    /// The delay to remove changed, because measurements of the flight or of its group did.
    DelayChanged {
        /// Delay and source before.
        was: String,
        /// Delay and source now.
        is: String,
    },
    /// The result was made before, but is now incomplete.
    ResultMissing,
    /// An earlier attempt ended in trouble that may have passed.
    EarlierTrouble,
}

impl fmt::Display for Why {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Why::NewFlight => f.write_str("new flight"),
            Why::LogChanged => f.write_str("the log has changed"),
            Why::SettingsChanged { settings } => write!(f, "settings have changed: {}", settings.join(", ")),
            Why::MapsChanged => f.write_str("channel maps have changed"),
            Why::AnalysisChanged { was, is } => write!(f, "analysis version was {was}, is {is}"),
            Why::RecordsChanged { was, is } => write!(f, "record version was {was}, is {is}"),
            Why::DelayChanged { was, is } => write!(f, "the delay to remove was {was}, is {is}"),
            Why::ResultMissing => f.write_str("its result is missing or damaged"),
            Why::EarlierTrouble => f.write_str("the last attempt failed"),
        }
    }
}

impl Planned {
    /// A flight with only a name.
    pub(crate) fn unread(flight: String) -> Planned {
        Planned {
            flight,
            kind: None,
            files: vec![],
            reference: None,
            content: None,
            measure_key: None,
            decision: None,
            key: None,
            trouble: None,
            stage: None,
            why: vec![],
            is_kept: false,
            shard: None,
        }
    }

    /// Key of the output of its stage.
    pub(crate) fn work_key(&self) -> Option<&str> {
        match self.stage? {
            Stage::Measure => self.measure_key.as_deref(),
            Stage::Replay => self.key.as_deref(),
        }
    }

    /// Total size of its files.
    pub(crate) fn bytes(&self) -> u64 {
        self.all_files().map(|f| f.stamp.bytes).sum()
    }

    /// Its files and those of its reference.
    pub(crate) fn all_files(&self) -> impl Iterator<Item = &PlannedFile> {
        self.files.iter().chain(self.reference.iter().flat_map(PlannedReference::files))
    }

    /// The same flight with other names for its files.
    pub(crate) fn with_files(mut self, name: impl Fn(&Path) -> PathBuf) -> Planned {
        let own = self.files.iter_mut();
        let reference = self.reference.iter_mut().flat_map(PlannedReference::files_mut);
        own.chain(reference).for_each(|file| file.path = name(&file.path));
        self
    }

    /// Its files in the form of a record.
    pub(crate) fn inputs(&self) -> Vec<InputFile> {
        let input = |f: &PlannedFile| InputFile { name: f.name(), bytes: f.stamp.bytes, blake3: f.blake3.clone() };
        self.all_files().map(input).collect()
    }

    /// The flight in the form of ingest; `None` if its format was not detected.
    pub(crate) fn unit(&self) -> Option<FlightUnit> {
        let files = self.files.iter().map(|f| f.path.clone()).collect();
        self.kind.map(|kind| FlightUnit { id: self.flight.clone(), files, kind })
    }
}

impl PlannedFile {
    /// Name without its folder.
    pub(crate) fn name(&self) -> String {
        self.path.file_name().unwrap_or_default().to_string_lossy().into_owned()
    }
}

impl Manifest {
    /// Key of the measurement of a flight with this content.
    pub(crate) fn measure_key(&self, content: &str) -> String {
        let (analysis, records) = (ANALYSIS_VERSION.to_string(), RECORD_VERSION.to_string());
        hash_of_parts(&["flightlag measure", content, &self.measure_blake3, &self.maps_blake3, &analysis, &records])
    }

    /// Key of the result of a flight: measurement, settings, and removed delay.
    pub(crate) fn result_key(&self, measure_key: &str, decision: &Decision) -> String {
        let decided = serde_json::to_string(decision).unwrap_or_default();
        hash_of_parts(&["flightlag result", measure_key, &self.replay_blake3, &decided])
    }
}

/// Hash of the names and contents of a flight's files, and of its reference if a rule asks for one.
pub(crate) fn content_hash(files: &[PlannedFile], reference: Option<&PlannedReference>) -> String {
    let hash = |files: &[PlannedFile]| {
        let mut parts: Vec<(String, &str)> = files.iter().map(|f| (f.name(), f.blake3.as_str())).collect();
        parts.sort();
        let flat: Vec<&str> = parts.iter().flat_map(|(name, hash)| [name.as_str(), hash]).collect();
        hash_of_parts(&flat)
    };
    let own = hash(files);
    match reference {
        None => own,
        Some(PlannedReference::Files { files, .. }) => hash_of_parts(&[&own, "reference", &hash(files)]),
        Some(PlannedReference::Missing { file, reason }) => hash_of_parts(&[&own, "no reference", file, reason]),
    }
}

/// BLAKE3 of texts, each with its length, so that different lists have different hashes.
pub(crate) fn hash_of_parts(parts: &[&str]) -> String {
    let mut hasher = blake3::Hasher::new();
    for part in parts {
        hasher.update(&(part.len() as u64).to_le_bytes());
        hasher.update(part.as_bytes());
    }
    hasher.finalize().to_hex().to_string()
}

impl Manifest {
    /// A manifest of this flightlag version; shards are not assigned yet.
    #[expect(clippy::too_many_arguments, reason = "the fields by name, in one place")]
    pub(crate) fn new(
        name: String,
        root: PathBuf,
        (out, out_id): (PathBuf, String),
        (pipeline, measure_blake3, replay_blake3): (PipelineUse, String, String),
        cards: Vec<CardFile>,
        maps_folder: Option<PathBuf>,
        maps_blake3: String,
        command: String,
        ignored: Vec<IgnoredInput>,
    ) -> Manifest {
        Manifest {
            manifest_version: MANIFEST_VERSION,
            flightlag_version: FLIGHTLAG_VERSION.to_owned(),
            analysis_version: ANALYSIS_VERSION,
            record_version: RECORD_VERSION,
            name,
            root,
            out,
            out_id,
            pipeline,
            measure_blake3,
            replay_blake3,
            criteria: None,
            test_cards: TestCardFiles::default(),
            cards,
            maps_folder,
            maps_blake3,
            command,
            shards: 0,
            flights: vec![],
            ignored,
        }
    }

    /// Inputs of pages other than results: file name and resolved text of the criteria.
    pub(crate) fn criteria_parts(&self) -> [&str; 2] {
        self.criteria.as_ref().map_or(["", ""], |c| [c.file.as_str(), c.blake3.as_str()])
    }

    /// Output folder, absolute.
    #[must_use]
    pub fn out(&self) -> &Path {
        &self.out
    }

    /// Number of shards with work; zero if every result exists.
    #[must_use]
    pub fn shards(&self) -> u32 {
        self.shards
    }

    /// Number of flights.
    #[must_use]
    pub fn flight_count(&self) -> usize {
        self.flights.len()
    }

    /// Number of flights with work to do.
    #[must_use]
    pub fn stale_count(&self) -> usize {
        self.flights.iter().filter(|f| f.shard.is_some()).count()
    }

    /// The flights of a shard, largest first.
    pub(crate) fn of_shard(&self, shard: u32) -> Vec<&Planned> {
        largest_first(self.flights.iter().filter(|f| f.shard == Some(shard)))
    }

    /// Every flight with work of a stage, largest first, so that the last to finish is a small one.
    pub(crate) fn stale(&self, stage: Stage) -> Vec<&Planned> {
        largest_first(self.flights.iter().filter(|f| f.shard.is_some() && f.stage == Some(stage)))
    }

    /// Assigns every result to make to one of at most `max_shards` shards of roughly equal size.
    pub(crate) fn deal(&mut self, max_shards: u32) {
        self.flights.iter_mut().for_each(|flight| flight.shard = None);
        let first_of_key = self.first_of_each_key();
        let mut order: Vec<usize> = first_of_key.into_values().collect();
        let (flights, count) = (&mut self.flights, order.len());
        order.sort_by_key(|&i| flights.get(i).map(|f| (std::cmp::Reverse(f.bytes()), f.flight.clone())));
        let shards = u32::try_from(count).unwrap_or(u32::MAX).min(max_shards.max(1));
        let mut load = vec![0u64; shards as usize];
        for i in order {
            let lightest = (0..load.len()).min_by_key(|&s| load.get(s).copied()).unwrap_or_default();
            if let (Some(flight), Some(sum)) = (flights.get_mut(i), load.get_mut(lightest)) {
                // At least one byte, so that empty files are distributed too.
                *sum += flight.bytes().max(1);
                flight.shard = u32::try_from(lightest).ok();
            }
        }
        self.shards = shards;
    }

    /// The stage of the assigned work; `None` if nothing is left to do.
    #[must_use]
    pub fn stage(&self) -> Option<Stage> {
        self.flights.iter().filter_map(|f| f.stage).min()
    }

    /// Flights with work by key: flights with the same content share a result, which is made once.
    fn first_of_each_key(&self) -> BTreeMap<&str, usize> {
        let mut first = BTreeMap::new();
        for (i, flight) in self.flights.iter().enumerate() {
            if let Some(key) = flight.work_key() {
                first.entry(key).or_insert(i);
            }
        }
        first
    }

    /// Writes the manifest to its output folder, under a unique name made from its content. Returns the path.
    ///
    /// # Errors
    /// The file cannot be written, or a path is not valid text.
    pub fn keep(&self) -> Result<PathBuf, CampaignError> {
        let text = self.text(&self.out)?;
        let hash: String = blake3::hash(&text).to_hex().chars().take(16).collect();
        let (store, name) = (Store::open(&self.out)?, format!("{PLANS}/{hash}.json"));
        if store.read(&name)?.as_ref() != Some(&text) {
            store.write(&name, &text, Keep::Synced)?;
        }
        Ok(store.path(&name)?)
    }

    fn text(&self, path: &Path) -> Result<Vec<u8>, CampaignError> {
        let wrong = |e| CampaignError::Manifest { path: path.to_owned(), what: format!("cannot be written: {e}") };
        let mut text = serde_json::to_vec(self).map_err(wrong)?;
        text.push(b'\n');
        Ok(text)
    }

    /// Writes the manifest atomically. Does not overwrite that of another plan: its tasks may still be queued.
    ///
    /// # Errors
    /// The file cannot be written, has other content, or a path is not valid text.
    pub fn write(&self, path: &Path) -> Result<(), CampaignError> {
        let wrong = |what: String| CampaignError::Manifest { path: path.to_owned(), what };
        let text = self.text(path)?;
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let name = path.file_name().and_then(|n| n.to_str()).ok_or_else(|| wrong("not a file name".into()))?;
        match read_unopened(folder, name)? {
            Some(there) if there == text => return Ok(()),
            Some(_) => {
                return Err(CampaignError::Asked(format!("{}: already exists; name another file", path.display())));
            }
            None => {}
        }
        Ok(Store::open(folder)?.write(name, &text, Keep::Synced).map(drop)?)
    }

    /// Removes plans older than [`PLAN_LIFE`]: their tasks have ended.
    pub(crate) fn remove_old(store: &Store) -> Result<(), CampaignError> {
        let is_old = |name: &&String| store.age(name).is_some_and(|age| age >= PLAN_LIFE);
        let plans = store.list(PLANS).into_iter().filter(|name| name.ends_with(".json"));
        plans.filter(|name| is_old(&name)).try_for_each(|name| Ok(store.remove(&name)?))
    }

    /// The plans of the last days: their tasks may still be running.
    pub(crate) fn recent(store: &Store) -> Vec<Manifest> {
        let is_recent = |name: &&String| store.age(name).is_none_or(|age| age < PLAN_LIFE);
        store
            .list(PLANS)
            .iter()
            .filter(is_recent)
            .filter_map(|name| Manifest::read(&store.path(name).ok()?).ok())
            .collect()
    }

    /// Keys of its results and measurements.
    pub(crate) fn keys(&self) -> impl Iterator<Item = &str> {
        self.flights.iter().flat_map(|f| [&f.measure_key, &f.key]).flatten().map(String::as_str)
    }

    /// Reads a manifest of this version of flightlag.
    ///
    /// # Errors
    /// It cannot be read, is not a manifest, or another version made it. If its folder is missing too, or the disk is
    /// unavailable, trying again may help: the folder may not be mounted on this node.
    pub fn read(path: &Path) -> Result<Manifest, CampaignError> {
        let wrong = |what: String| CampaignError::Manifest { path: path.to_owned(), what };
        let bytes = read_file(path).map_err(|e| {
            let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
            let is_away = e.kind() == std::io::ErrorKind::NotFound
                && folder.is_some_and(|folder| !s3::is_in_bucket(folder) && !folder.is_dir());
            match is_away || may_heal(&e) {
                true => CampaignError::TryAgain(format!(
                    "{}: cannot be read ({e}); its folder may not be mounted here",
                    path.display()
                )),
                false => wrong(format!("cannot be read: {e}")),
            }
        })?;
        let manifest: Manifest =
            serde_json::from_slice(&bytes).map_err(|e| wrong(format!("is not a manifest of a campaign: {e}")))?;
        let versions = |m: &Manifest| (m.manifest_version, m.analysis_version, m.record_version);
        if versions(&manifest) != (MANIFEST_VERSION, ANALYSIS_VERSION, RECORD_VERSION) {
            let by = &manifest.flightlag_version;
            return Err(wrong(format!("was made by another flightlag ({by}): plan the campaign again")));
        }
        Ok(manifest)
    }
}

/// Content of a file, or of an object of a bucket.
fn read_file(path: &Path) -> std::io::Result<Vec<u8>> {
    match s3::is_in_bucket(path) {
        false => std::fs::read(path),
        #[cfg(feature = "s3")]
        true => s3::read_url(path)?.ok_or(std::io::ErrorKind::NotFound.into()),
        #[cfg(not(feature = "s3"))]
        true => Err(s3::not_built()),
    }
}

fn largest_first<'a>(flights: impl Iterator<Item = &'a Planned>) -> Vec<&'a Planned> {
    let mut flights: Vec<&Planned> = flights.collect();
    flights.sort_by(|a, b| b.bytes().cmp(&a.bytes()).then_with(|| a.flight.cmp(&b.flight)));
    flights
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    fn planned(flight: &str, key: &str, bytes: u64, folder: &Path) -> Planned {
        let path = folder.join(flight);
        std::fs::write(&path, vec![b'x'; bytes as usize]).unwrap();
        let stamp = FileStamp::of(&path).unwrap();
        Planned {
            flight: flight.to_owned(),
            kind: Some(LogKind::Csv),
            reference: None,
            files: vec![PlannedFile { path, stamp, blake3: key.to_owned() }],
            content: Some(key.to_owned()),
            measure_key: Some(key.to_owned()),
            decision: None,
            key: None,
            trouble: None,
            stage: Some(Stage::Measure),
            why: vec![Why::NewFlight],
            shard: None,
            is_kept: false,
        }
    }

    fn manifest(flights: Vec<Planned>) -> Manifest {
        let pipeline = PipelineUse { title: "t".into(), blake3: "p".into(), toml: String::new() };
        let mut manifest = Manifest::new(
            "n".into(),
            "/r".into(),
            ("/o".into(), "id".into()),
            (pipeline, "m".into(), "r".into()),
            vec![],
            None,
            "m".into(),
            "c".into(),
            vec![],
        );
        manifest.flights = flights;
        manifest
    }

    #[test]
    fn shards_have_similar_loads_and_every_result_is_made_once() {
        let folder = tempfile::tempdir().unwrap();
        let sizes = [900, 500, 400, 300, 200, 100];
        let mut flights: Vec<Planned> =
            sizes.iter().map(|&n| planned(&format!("f{n}"), &format!("k{n}"), n, folder.path())).collect();
        flights.push(planned("twin", "k900", 900, folder.path()));
        flights.push(Planned { why: vec![], stage: None, ..planned("done", "kd", 9, folder.path()) });
        let mut manifest = manifest(flights);
        manifest.deal(2);
        let loads: Vec<u64> = (0..2).map(|s| manifest.of_shard(s).iter().map(|f| f.bytes()).sum()).collect();
        assert_eq!(loads, [1200, 1200]);
        assert_eq!(manifest.stale_count(), 6);
        manifest.deal(100);
        assert_eq!(manifest.shards(), 6);
    }

    #[test]
    fn a_name_cannot_be_mistaken_for_content() {
        assert_ne!(hash_of_parts(&["ab", "c"]), hash_of_parts(&["a", "bc"]));
        assert_ne!(hash_of_parts(&["a", ""]), hash_of_parts(&["a"]));
    }

    #[test]
    fn a_manifest_is_read_back_and_one_of_another_version_is_rejected() {
        let folder = tempfile::tempdir().unwrap();
        let mut written = manifest(vec![planned("f1", "k1", 5, folder.path())]);
        let path = folder.path().join("m.json");
        written.write(&path).unwrap();
        assert_eq!(Manifest::read(&path).unwrap(), written);
        written.analysis_version += 1;
        assert_eq!(written.write(&path).unwrap_err().exit(), crate::Exit::Wrong, "another plan has this name");
        std::fs::remove_file(&path).unwrap();
        written.write(&path).unwrap();
        assert!(Manifest::read(&path).unwrap_err().to_string().contains("plan the campaign again"));
    }
}
