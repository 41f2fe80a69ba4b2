//! Finds the flights, hashes their contents, and decides which results to make.

use crate::config::Pipeline;
use crate::criteria::Criteria;
use crate::decide::decide;
use crate::error::CampaignError;
use crate::error::STILL_WRITTEN;
use crate::event::Event;
use crate::fetch::Logs;
use crate::logs::{self, Found, Library};
use crate::run_context::RunContext;

use crate::file_stamp::FileStamp;
use crate::lock::LOCK;
use crate::manifest::FoundReference;
use crate::manifest::{Manifest, Planned, PlannedFile, PlannedReference, Stage, content_hash};
use crate::memory::{Memory, hash_file};
use crate::reference::{FlightFiles, with_references};
use crate::results;
use crate::s3;
use crate::source;
use crate::state::State;
use crate::store::{Check, Store, first_names, is_temporary, read_unopened};
use crate::test_cards::TestCardFiles;
use crate::work::Workers;
use ingest::FlightUnit;
use record::{Decision, FlightLateness, IgnoredInput};
use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::{Duration, SystemTime};

/// Size of the buffer for hashing files, bytes.
const PIECE: usize = 1 << 20;
/// Maximum number of reasons reported for a folder without a flight.
const MOST_REASONS: usize = 3;

/// The request of the user.
#[derive(Debug, Clone, PartialEq)]
pub struct Order {
    /// Folder of the flights.
    pub flights: PathBuf,
    /// Output folder.
    pub out: PathBuf,
    /// Settings.
    pub pipeline: Pipeline,
    /// Hash every file again, regardless of its size and timestamps.
    pub verify: bool,
    /// Whether the report of other logs may be replaced.
    pub replace: bool,
    /// Command that reproduces the campaign, with names instead of paths, for the pages.
    pub command: String,
    /// Logs modified less than this ago are skipped: they are still being written.
    pub settle: Option<Duration>,
}

impl Order {
    /// How thoroughly earlier outputs are compared with what was written.
    pub(crate) fn check(&self) -> Check {
        if self.verify { Check::Full } else { Check::Quick }
    }
}

/// Why a folder without files is not a flight.
pub const EMPTY_FOLDER: &str = "the folder is empty";

/// The plan of a campaign: which results exist, which to make, and why.
pub(crate) fn plan(
    order: &Order,
    context: &RunContext<'_>,
    store: &Store,
    state: &State,
) -> Result<Manifest, CampaignError> {
    let (root, out) = folders(order)?;
    let library = Library::open(order.pipeline.maps_folder(), order.pipeline.forced_map())?;
    library.check(&order.pipeline)?;
    let logs = Logs::below(&root)?;
    let planner = Planner { order, context, store, state, root, library, logs };
    let mut found = logs::find(&planner.logs, &planner.library, store, order.verify, context)?;
    let kept = match order.settle {
        Some(settle) => planner.leave_unsettled(&mut found, settle)?,
        None => BTreeSet::new(),
    };
    let Found { units, ignored, unreadable } = found;
    let mut manifest = planner.manifest(out, ignored)?;
    if units.is_empty() && unreadable.is_empty() {
        return Err(CampaignError::NoFlights { path: planner.root, what: no_logs(&manifest.ignored) });
    }
    manifest.test_cards = planner.test_cards(&units, &mut manifest.ignored)?;
    let cases = planner.with_references(units)?;
    let mut contents = Contents::look_at(&planner, &cases, &kept);
    context.send(contents.found(cases.len() + unreadable.len(), manifest.ignored.len()));
    contents.learn(&planner)?;
    manifest.flights = contents.flights(cases, unreadable);
    judge(&mut manifest, &order.pipeline, store, state, Retry::Troubled)?;
    Ok(manifest)
}

/// Plans one campaign.
struct Planner<'a> {
    order: &'a Order,
    context: &'a RunContext<'a>,
    store: &'a Store,
    /// State of the last run.
    state: &'a State,
    /// The folder of the flights, absolute.
    root: PathBuf,
    library: Library,
    logs: Logs,
}

impl Planner<'_> {
    fn test_cards(
        &self,
        units: &[FlightUnit],
        ignored: &mut Vec<IgnoredInput>,
    ) -> Result<TestCardFiles, CampaignError> {
        let names = units.iter().map(|unit| unit.id.as_str());
        TestCardFiles::find(self.logs.root(), names, ignored).map_err(|error| self.as_shown(error))
    }

    /// A manifest without flights.
    fn manifest(&self, out: PathBuf, ignored: Vec<IgnoredInput>) -> Result<Manifest, CampaignError> {
        let pipeline = &self.order.pipeline;
        let mut manifest = Manifest::new(
            self.root.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            self.root.clone(),
            (out, self.store.id()?),
            (pipeline.as_used(), pipeline.measure_blake3(), pipeline.replay_blake3()),
            pipeline.card_files(),
            pipeline.maps_folder().map(absolute).transpose()?,
            self.library.blake3().to_owned(),
            self.order.command.clone(),
            ignored,
        );
        manifest.criteria = pipeline.criteria().map(Criteria::as_used);
        Ok(manifest)
    }

    /// The flights with their reference files.
    fn with_references(&self, units: Vec<FlightUnit>) -> Result<Vec<FlightFiles>, CampaignError> {
        let wanted = self.order.pipeline.reference_file();
        if wanted.is_some() {
            self.logs.fetch_heads(self.context.threads, self.context.cancel)?;
        }
        let cases = with_references(units, wanted, &self.library).map_err(|error| self.as_shown(error))?;
        self.logs.drop_heads();
        Ok(cases)
    }

    /// Replaces the local file in an error by the name of the object, where it is a copy of one.
    fn as_shown(&self, error: CampaignError) -> CampaignError {
        match error {
            CampaignError::Asked(text) => CampaignError::Asked(self.logs.with_shown_names(text)),
            other => other,
        }
    }

    /// Removes flights with files modified less than `settle` ago from the list, and reports them. A flight with
    /// a result keeps it, unread: the files of such flights are returned. A modification time later than now by more
    /// than `settle` is a wrong clock, not a recent write.
    fn leave_unsettled(&self, found: &mut Found, settle: Duration) -> Result<BTreeSet<PathBuf>, CampaignError> {
        let now = SystemTime::now();
        let is_fresh = |file: &PathBuf| {
            let written = self.logs.modified(file);
            let apart = written.map(|at| now.duration_since(at).unwrap_or_else(|ahead| ahead.duration()));
            apart.is_some_and(|apart| apart < settle)
        };
        let (unsettled, settled): (Vec<FlightUnit>, Vec<FlightUnit>) =
            std::mem::take(&mut found.units).into_iter().partition(|unit| unit.files.iter().any(is_fresh));
        found.units = settled;
        let memory = Memory::recall(self.store, &self.root);
        let (kept, left): (Vec<FlightUnit>, Vec<FlightUnit>) =
            unsettled.into_iter().partition(|unit| self.has_result(unit, &memory));
        let minutes = settle.as_secs_f64() / 60.0;
        let reason = format!("{STILL_WRITTEN} (last written less than {minutes} min before this run)");
        self.ignore(&left, &reason, found);
        self.ignore(&kept, &format!("{reason}; its result of the last run is kept"), found);
        // A file that is just being copied is not recognised as a log yet.
        for input in found.ignored.iter_mut().filter(|input| self.state.has_flight(&input.path)) {
            if !input.reason.starts_with(STILL_WRITTEN) && is_fresh(&self.logs.root().join(&input.path)) {
                input.reason = format!("{STILL_WRITTEN} (now: {})", input.reason);
            }
        }
        found.ignored.sort_by(|a, b| a.path.cmp(&b.path));
        if !left.is_empty() && kept.is_empty() && found.units.is_empty() && found.unreadable.is_empty() {
            return Err(CampaignError::AllStillWritten(left.into_iter().map(|unit| unit.id).collect()));
        }
        let files = kept.iter().flat_map(|unit| unit.files.clone()).collect();
        found.units.extend(kept);
        Ok(files)
    }

    /// Whether the last run has a result of a flight, and the contents of its files.
    fn has_result(&self, unit: &FlightUnit, memory: &Memory) -> bool {
        let is_remembered = |file: &PathBuf| memory.latest_hash_of(&name_below(self.logs.root(), file)).is_some();
        self.state.has_flight(&unit.id) && unit.files.iter().all(is_remembered)
    }

    /// Lists flights as ignored, and reports them.
    fn ignore(&self, units: &[FlightUnit], reason: &str, found: &mut Found) {
        for unit in units {
            self.context.send(Event::Remark { text: format!("{}: {reason}", unit.id) });
            found.ignored.push(IgnoredInput { path: unit.id.clone(), reason: reason.to_owned() });
        }
    }
}

fn no_logs(ignored: &[IgnoredInput]) -> String {
    why_no_logs(ignored.iter().map(|file| (file.path.as_str(), file.reason.as_str())))
}

/// The most frequent reasons why files are not logs, each with an example.
pub(crate) fn why_no_logs<'a>(files: impl Iterator<Item = (&'a str, &'a str)>) -> String {
    let mut reasons: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    files.for_each(|(path, reason)| reasons.entry(reason).or_default().push(path));
    let mut reasons: Vec<_> = reasons.into_iter().collect();
    reasons.sort_by_key(|(_, files)| std::cmp::Reverse(files.len()));
    let worded = |(reason, files): &(&str, Vec<&str>)| match files.as_slice() {
        [one] => format!("{one}: {reason}"),
        [first, rest @ ..] => format!("{first} and {} more: {reason}", rest.len()),
        [] => String::new(),
    };
    match reasons.len() {
        0 => EMPTY_FOLDER.to_owned(),
        n if n > MOST_REASONS => {
            let listed: Vec<String> = reasons.iter().take(MOST_REASONS).map(worded).collect();
            format!(
                "{}; and files with {}",
                listed.join("; "),
                crate::answer::counted(n - MOST_REASONS, "other reason")
            )
        }
        _ => reasons.iter().map(worded).collect::<Vec<_>>().join("; "),
    }
}

/// Whether to retry flights after an attempt that ended in trouble.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Retry {
    /// Retry them.
    Troubled,
    /// Do not: they were just tried.
    Nobody,
}

/// Finds the remaining work: first measurements; once all usable flights are measured, decisions and replays.
pub(crate) fn judge(
    manifest: &mut Manifest,
    pipeline: &Pipeline,
    store: &Store,
    state: &State,
    retry: Retry,
) -> Result<(), CampaignError> {
    let mut lateness: Vec<Option<FlightLateness>> = vec![];
    let mut untried = false;
    for i in 0..manifest.flights.len() {
        let key = manifest.flights[i].content.as_deref().map(|content| manifest.measure_key(content));
        let found = match &key {
            Some(key) if state.has_result(store, key)? => results::read_lateness(store, key, state.results.get(key))?,
            _ => None,
        };
        let why = match (&key, &found) {
            (Some(key), None) => {
                let had_trouble = results::had_trouble(store, key);
                untried |= !had_trouble;
                let again = !had_trouble || retry == Retry::Troubled;
                let flight = Planned { measure_key: Some(key.clone()), ..manifest.flights[i].clone() };
                if again { state.why(&flight, manifest, Stage::Measure, had_trouble) } else { vec![] }
            }
            _ => vec![],
        };
        let flight = &mut manifest.flights[i];
        (flight.decision, flight.key, flight.shard) = (None, None, None);
        flight.stage = (!why.is_empty()).then_some(Stage::Measure);
        (flight.measure_key, flight.why) = (key, why);
        lateness.push(found);
    }
    if !untried {
        let decided = decide(&manifest.flights, &lateness, pipeline);
        for (i, decision) in decided.into_iter().enumerate() {
            judge_replay(manifest, i, decision, store, state)?;
        }
    }
    Ok(())
}

/// Sets the key of a flight's result, and if the result is missing, why it must be made.
fn judge_replay(
    manifest: &mut Manifest,
    i: usize,
    decision: Option<Decision>,
    store: &Store,
    state: &State,
) -> Result<(), CampaignError> {
    let measured = manifest.flights[i].measure_key.clone().filter(|_| manifest.flights[i].stage.is_none());
    let (Some(decision), Some(measured)) = (decision, measured) else { return Ok(()) };
    // A log that is still being written cannot be replayed: its last decision stays, whatever other flights show.
    let flight = &manifest.flights[i];
    if let Some((decision, key)) = state.latest_of(&flight.flight).filter(|_| flight.is_kept)
        && state.has_result(store, &key)?
    {
        let flight = &mut manifest.flights[i];
        (flight.key, flight.decision) = (Some(key), Some(decision));
        return Ok(());
    }
    let key = manifest.result_key(&measured, &decision);
    let whole = state.has_result(store, &key)?;
    let had_trouble = !whole && results::had_trouble(store, &key);
    let flight = &mut manifest.flights[i];
    (flight.key, flight.decision) = (Some(key), Some(decision));
    if !whole {
        let flight = flight.clone();
        let why = state.why(&flight, manifest, Stage::Replay, had_trouble);
        let flight = &mut manifest.flights[i];
        (flight.stage, flight.why) = (Some(Stage::Replay), why);
    }
    Ok(())
}

/// The absolute path without links that a folder has, or will have once it is created.
fn to_be(path: &Path) -> std::io::Result<PathBuf> {
    let path = std::path::absolute(path)?;
    let exists = path.ancestors().find(|a| a.exists()).unwrap_or(&path);
    let rest = path.strip_prefix(exists).unwrap_or(Path::new(""));
    Ok(exists.canonicalize()?.join(rest))
}

/// The folder of flights and the output folder, absolute.
fn folders(order: &Order) -> Result<(PathBuf, PathBuf), CampaignError> {
    let whole = |path: &Path| match path.to_str() {
        Some(url) if s3::is_in_bucket(path) => Ok(PathBuf::from(url.trim_end_matches('/'))),
        _ => absolute(path),
    };
    Ok((whole(&order.flights)?, whole(&order.out)?))
}

/// Rejects a non-empty output folder that flightlag did not create, before anything is written.
pub(crate) fn check_output(order: &Order) -> Result<(), CampaignError> {
    check_out(&order.flights, &order.out)?;
    source::check(&order.out, std::slice::from_ref(&order.flights), order.replace)?;
    refuse_other_kind(&order.out, BENCH_MARK, "a bench")
}

/// Marks a folder with a bench report.
pub(crate) const BENCH_MARK: &str = ".flightlag/bench.json";

/// Rejects a folder with a report of another kind, which would be overwritten page by page.
pub(crate) fn refuse_other_kind(out: &Path, mark: &str, kind: &str) -> Result<(), CampaignError> {
    match read_unopened(out, mark)?.is_some() {
        true => Err(CampaignError::Asked(format!(
            "{}: already holds the report of {kind}; give another --out",
            out.display()
        ))),
        false => Ok(()),
    }
}

/// Rejects an output folder that contains the input, is inside it, or contains foreign files.
pub(crate) fn check_out(input: &Path, out_folder: &Path) -> Result<(), CampaignError> {
    let whole = |path: &Path, to_be: &dyn Fn(&Path) -> std::io::Result<PathBuf>| match s3::is_in_bucket(path) {
        true => Ok(path.to_owned()),
        false => to_be(path).map_err(|e| CampaignError::Asked(format!("{}: {e}", path.display()))),
    };
    let (root, out) = (whole(input, &|path| path.canonicalize())?, whole(out_folder, &to_be)?);
    if out.starts_with(&root) || root.starts_with(&out) {
        let what = "the output folder must not be inside the folder of the logs, nor the logs inside it";
        return Err(CampaignError::Asked(format!("{} and {}: {what}", input.display(), out_folder.display())));
    }
    // A run killed at its very start leaves at most these.
    let foreign = |name: &OsStr| name != ".flightlag" && !is_temporary(name);
    if read_unopened(out_folder, LOCK)?.is_some() || !first_names(out_folder)?.iter().any(|name| foreign(name)) {
        return Ok(());
    }
    let what = "this folder holds files that flightlag did not write; give an empty or new folder for --out";
    Err(CampaignError::Asked(format!("{}: {what}", out_folder.display())))
}

fn absolute(path: &Path) -> Result<PathBuf, CampaignError> {
    path.canonicalize().map_err(|e| CampaignError::Asked(format!("{}: {e}", path.display())))
}

/// An unreadable input counts as a failed flight until it can be read.
fn unreadable_flight(input: IgnoredInput) -> Planned {
    let trouble = Some(format!("{}: {}", input.path, input.reason));
    Planned { trouble, ..Planned::unread(input.path) }
}

/// The path below the folder of flights; the file name if that "folder" is a file.
fn name_below(root: &Path, path: &Path) -> String {
    let below = path.strip_prefix(root).ok().filter(|p| !p.as_os_str().is_empty());
    let name = below.map(Path::as_os_str).or(path.file_name()).unwrap_or_default();
    name.to_string_lossy().into_owned()
}

/// A file and what is known about it.
struct Looked {
    path: PathBuf,
    /// Path below the folder of flights.
    name: String,
    stamp: Result<FileStamp, String>,
    blake3: Option<String>,
}

/// The contents of all files of a campaign.
struct Contents<'a> {
    logs: &'a Logs,
    files: BTreeMap<PathBuf, Looked>,
    memory: Remembered,
    /// Files that are still being written, which count with their earlier content.
    kept: &'a BTreeSet<PathBuf>,
}

/// The memory, and whether it has changed.
struct Remembered {
    before: Memory,
    now: Memory,
}

impl Remembered {
    fn save_if_changed(&self, store: &Store) -> Result<(), CampaignError> {
        if self.before == self.now { Ok(()) } else { self.now.save(store) }
    }
}

impl<'a> Contents<'a> {
    fn look_at(planner: &'a Planner<'_>, cases: &[FlightFiles], kept: &'a BTreeSet<PathBuf>) -> Contents<'a> {
        let (logs, verify) = (&planner.logs, planner.order.verify);
        let mut now = Memory::recall(planner.store, &planner.root);
        let before = now.clone();
        let look = |path: &PathBuf| {
            let name = name_below(logs.root(), path);
            let stamp = logs.stamp(path).map_err(|e| format!("{name}: {e}"));
            let known = match kept.contains(path) {
                true => now.latest_hash_of(&name),
                false => stamp.as_ref().ok().filter(|_| !verify).and_then(|s| now.hash_of(&name, s)),
            };
            let blake3 = known.map(str::to_owned);
            (path.clone(), Looked { path: path.clone(), name, stamp, blake3 })
        };
        let files: BTreeMap<PathBuf, Looked> = cases.iter().flat_map(FlightFiles::all).map(look).collect();
        let names: BTreeSet<&str> = files.values().map(|f| f.name.as_str()).collect();
        now.retain(|name| names.contains(name));
        Contents { logs, files, memory: Remembered { before, now }, kept }
    }

    fn found(&self, flights: usize, ignored: usize) -> Event {
        Event::Found { flights, ignored, bytes: self.files.values().map(Looked::bytes).sum() }
    }

    /// Hashes all unknown contents. Hashes made before the user stopped are kept.
    fn learn(&mut self, planner: &Planner<'_>) -> Result<(), CampaignError> {
        self.read_unknown(planner.context)?;
        self.memory.save_if_changed(planner.store)?;
        planner.context.stopped()
    }

    /// Hashes every file with unknown content.
    fn read_unknown(&mut self, context: &RunContext<'_>) -> Result<(), CampaignError> {
        let unknown: Vec<&Looked> = self.files.values().filter(|f| f.stamp.is_ok() && f.blake3.is_none()).collect();
        if unknown.is_empty() {
            return Ok(());
        }
        let bytes = unknown.iter().map(|f| f.bytes()).sum();
        context.send(Event::Hashing { files: unknown.len(), bytes });
        let advance = |bytes| {
            context.send(Event::Hashed { bytes });
            !context.cancel.load(Ordering::Relaxed)
        };
        let hash = |piece: &mut Vec<u8>, file: &&Looked| {
            let _here = self.logs.bring(std::slice::from_ref(&file.path), context.cancel)?;
            hash_file(&file.path, piece, advance)
        };
        let hashes = Workers::start(context.threads)?.each(&unknown, context.cancel, || vec![0; PIECE], hash);
        let paths: Vec<PathBuf> = unknown.iter().map(|f| f.path.clone()).collect();
        for (path, hash) in paths.iter().zip(hashes) {
            self.note(path, hash);
        }
        Ok(())
    }

    fn note(&mut self, path: &Path, hash: Option<std::io::Result<Option<String>>>) {
        let Some(file) = self.files.get_mut(path) else { return };
        match hash {
            Some(Ok(Some(hash))) => {
                if let Ok(stamp) = &file.stamp {
                    self.memory.now.learn(&file.name, stamp, &hash);
                }
                file.blake3 = Some(hash);
            }
            Some(Err(e)) => file.stamp = Err(format!("{}: {e}", file.name)),
            Some(Ok(None)) | None => {}
        }
    }

    /// All flights by name.
    fn flights(&self, cases: Vec<FlightFiles>, unreadable: Vec<IgnoredInput>) -> Vec<Planned> {
        let readable = cases.into_iter().map(|case| self.planned(case));
        let mut flights: Vec<Planned> = readable.chain(unreadable.into_iter().map(unreadable_flight)).collect();
        flights.sort_by(|a, b| a.flight.cmp(&b.flight));
        flights
    }

    fn planned(&self, case: FlightFiles) -> Planned {
        let trouble = case.all().filter_map(|p| self.files.get(p)).find_map(|f| f.stamp.as_ref().err().cloned());
        let file = |path: &PathBuf| {
            let f = self.files.get(path)?;
            Some(PlannedFile {
                path: self.logs.shown(&f.path),
                stamp: f.stamp.clone().ok()?,
                blake3: f.blake3.clone()?,
            })
        };
        let planned = |unit: &FlightUnit| unit.files.iter().filter_map(file).collect::<Vec<PlannedFile>>();
        let whole = case.all().all(|path| file(path).is_some());
        let files = planned(&case.unit);
        let reference = case.reference.as_ref().map(|reference| match reference {
            FoundReference::There(unit) => PlannedReference::Files { kind: unit.kind, files: planned(unit) },
            FoundReference::Missing { file, reason } => {
                PlannedReference::Missing { file: file.clone(), reason: reason.clone() }
            }
        });
        let content = (trouble.is_none() && whole).then(|| content_hash(&files, reference.as_ref()));
        let is_kept = case.unit.files.iter().any(|file| self.kept.contains(file));
        let unread = Planned::unread(case.unit.id);
        Planned { kind: Some(case.unit.kind), files, reference, content, trouble, is_kept, ..unread }
    }
}

impl Looked {
    fn bytes(&self) -> u64 {
        self.stamp.as_ref().map(|s| s.bytes).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_most_frequent_reasons_come_first_and_more_than_three_are_counted() {
        let files =
            [("a.txt", "text"), ("b.png", "a picture"), ("c.txt", "text"), ("d.zip", "empty"), ("e.exe", "a program")];
        assert_eq!(why_no_logs(files[..1].iter().copied()), "a.txt: text");
        let three = why_no_logs(files[..4].iter().copied());
        assert_eq!(three, "a.txt and 1 more: text; b.png: a picture; d.zip: empty");
        let four = why_no_logs(files.iter().copied());
        assert_eq!(four, "a.txt and 1 more: text; b.png: a picture; e.exe: a program; and files with 1 other reason");
        assert_eq!(why_no_logs([].into_iter()), EMPTY_FOLDER);
    }
}
