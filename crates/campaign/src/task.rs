//! Makes results. The failure of one flight does not affect the others.

use crate::error::{CampaignError, Exit};
use crate::event::Event;
use crate::fetch::{Brought, Logs};
use crate::file_stamp::FileStamp;
use crate::manifest::{Manifest, Planned, PlannedFile, Stage};
use crate::memory::hash_file;
use crate::results;
use crate::run_context::RunContext;
use crate::store::{Check, Store};
use crate::study::{Interrupted, Replaying, Study, failed_record};
use crate::work::Workers;
use std::any::Any;
use std::cell::{Cell, RefCell};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

/// Outcome of a shard, or of a whole run.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct TaskReport {
    /// Number of results made.
    pub made: usize,
    /// Number of results that already existed at their turn.
    pub found: usize,
    /// Flights without a lasting result, with the reason. Trying again may help.
    pub troubled: Vec<(String, String)>,
    /// Flights without a lasting result for a permanent reason: the log has changed since the plan, or a defect.
    pub lasting: Vec<(String, String)>,
}

impl TaskReport {
    /// Adds the counts of another step.
    pub(crate) fn add(&mut self, other: TaskReport) {
        self.made += other.made;
        self.found += other.found;
        self.troubled.extend(other.troubled);
        self.lasting.extend(other.lasting);
    }

    /// 0 if every flight has a result (an unusable log is one), 75 if trying again may help, 3 if it does not.
    #[must_use]
    pub fn exit(&self) -> Exit {
        match (self.troubled.is_empty(), self.lasting.is_empty()) {
            (false, _) => Exit::TryAgain,
            (true, false) => Exit::Incomplete,
            (true, true) => Exit::Well,
        }
    }
}

/// Makes the results of one shard of a manifest. Takes no lock: shards run in parallel, and a
/// result made twice has the same bytes.
///
/// # Errors
/// No such shard, maps or logs that changed since the plan, an output that cannot be written, or the user stopped.
pub fn task(manifest: &Manifest, shard: u32, context: &RunContext<'_>) -> Result<TaskReport, CampaignError> {
    if shard >= manifest.shards {
        let count = manifest.shards;
        return Err(CampaignError::Asked(format!("no shard {shard}: this manifest has {count}, counted from 0")));
    }
    let store = Store::open_planned(manifest.out(), &manifest.out_id)?;
    let flights = manifest.of_shard(shard);
    let study = Replaying::prepare(manifest)?;
    let to_do: Vec<&&Planned> = flights.iter().filter(|flight| is_to_do(flight, &store)).collect();
    context.send(Event::Planned {
        stage: manifest.stage(),
        flights: flights.len(),
        reused: flights.len() - to_do.len(),
        to_run: to_do.len(),
        bytes: to_do.iter().map(|flight| flight.bytes()).sum(),
    });
    make(&flights, manifest, &study, &store, context)
}

/// Whether a flight has work left: its result is missing, or the plan marks it as damaged.
fn is_to_do(flight: &Planned, store: &Store) -> bool {
    let Some(key) = flight.work_key() else { return false };
    !results::is_there(store, key, Check::Quick) || flight.why.contains(&crate::manifest::Why::ResultMissing)
}

/// Does the work of `flights`, largest first.
pub(crate) fn make(
    flights: &[&Planned],
    manifest: &Manifest,
    study: &dyn Study,
    store: &Store,
    context: &RunContext<'_>,
) -> Result<TaskReport, CampaignError> {
    let (broken, logs) = (AtomicBool::new(false), Logs::planned(&manifest.root)?);
    let worker = Worker { manifest, study, store, context, logs, broken, error: Mutex::new(None) };
    let answers =
        Workers::start(context.threads)?.each(flights, context.cancel, || (), |(), flight| worker.attempt(flight));
    if let Some(error) = worker.error.into_inner().unwrap_or_else(|e| e.into_inner()) {
        return Err(error);
    }
    context.stopped()?;
    let mut report = TaskReport::default();
    for (flight, answer) in flights.iter().zip(answers.into_iter().flatten()) {
        report.count(&flight.flight, answer);
    }
    Ok(report)
}

/// Outcome of one flight.
enum Attempt {
    Made,
    Found,
    Troubled(Trouble),
    NotDone,
}

impl TaskReport {
    fn count(&mut self, flight: &str, attempt: Attempt) {
        match attempt {
            Attempt::Made => self.made += 1,
            Attempt::Found => self.found += 1,
            Attempt::Troubled(Trouble { reason, may_heal: true }) => self.troubled.push((flight.to_owned(), reason)),
            Attempt::Troubled(Trouble { reason, .. }) => self.lasting.push((flight.to_owned(), reason)),
            Attempt::NotDone => {}
        }
    }
}

struct Worker<'a> {
    manifest: &'a Manifest,
    study: &'a dyn Study,
    store: &'a Store,
    context: &'a RunContext<'a>,
    logs: Logs,
    /// Whether an output could not be written: no thread starts another flight.
    broken: AtomicBool,
    error: Mutex<Option<CampaignError>>,
}

impl Worker<'_> {
    fn attempt(&self, flight: &Planned) -> Attempt {
        if self.broken.load(Ordering::Relaxed) {
            return Attempt::NotDone;
        }
        match self.result_of(flight) {
            Ok(attempt) => attempt,
            Err(error) => {
                self.broken.store(true, Ordering::Relaxed);
                self.error.lock().unwrap_or_else(|e| e.into_inner()).get_or_insert(error);
                Attempt::NotDone
            }
        }
    }

    fn result_of(&self, flight: &Planned) -> Result<Attempt, CampaignError> {
        let Some(stage) = flight.stage.filter(|_| flight.work_key().is_some()) else { return Ok(Attempt::NotDone) };
        if !is_to_do(flight, self.store) {
            return Ok(Attempt::Found);
        }
        let (name, why) = (flight.flight.clone(), flight.why.clone());
        self.context.send(Event::Started { flight: name, stage, why, bytes: flight.bytes() });
        let work = || match stage {
            Stage::Measure => self.measured(flight),
            Stage::Replay => self.studied(flight),
        };
        match caught(work) {
            Ok(Ok(attempt)) => Ok(attempt),
            Ok(Err(Stop::Cancelled)) => Ok(Attempt::NotDone),
            Ok(Err(Stop::Trouble(trouble))) => self.troubled(flight, trouble),
            Ok(Err(Stop::Failed(error))) => Err(error),
            Err(panic) => {
                let reason = format!("a defect in flightlag, please report it: {panic}");
                self.troubled(flight, Trouble { reason, may_heal: false })
            }
        }
    }

    fn measured(&self, flight: &Planned) -> Result<Attempt, Stop> {
        let (flight, files, _here) = self.here(flight)?;
        let measured = self.study.measure(&flight, self.manifest, self.context)?;
        self.refuse_changed(&flight, &files)?;
        results::write_measured(self.store, &measured)?;
        let lateness = &measured.lateness;
        self.context.send(Event::DelayMeasured {
            flight: flight.flight.clone(),
            kind: lateness.kind,
            lateness_s: lateness.lateness_s(),
            words: lateness.words.clone(),
        });
        Ok(Attempt::Made)
    }

    fn studied(&self, flight: &Planned) -> Result<Attempt, Stop> {
        let again = || lasting("its measurement was incomplete; the next run makes it again".to_owned());
        let key = flight.measure_key.as_deref().unwrap_or_default();
        let measured = results::read_measured(self.store, key)?.ok_or_else(again)?;
        let (flight, files, _here) = self.here(flight)?;
        let studied = self.study.study(&flight, measured, self.manifest, self.context)?;
        self.refuse_changed(&flight, &files)?;
        results::write(self.store, &studied)?;
        let record = &studied.record;
        self.context.send(Event::Finished {
            flight: flight.flight.clone(),
            outcome: record.outcome.word(),
            reason: record.outcome.reason().map(str::to_owned),
            lossy: record.has_loss(),
            lateness_s: record.lateness.as_ref().and_then(record::FlightLateness::lateness_s),
            removed_s: record.replay.as_ref().map(|replay| replay.settings.delay.seconds()),
            effect: record.effect.as_ref().map(|e| e.verdict),
        });
        Ok(Attempt::Made)
    }

    fn troubled(&self, flight: &Planned, trouble: Trouble) -> Result<Attempt, CampaignError> {
        let reason = &trouble.reason;
        let key = flight.work_key().unwrap_or_default();
        results::write_trouble(self.store, key, &failed_record(flight, self.manifest, reason.clone()))?;
        self.context.send(Event::Troubled { flight: flight.flight.clone(), reason: reason.clone() });
        Ok(Attempt::Troubled(trouble))
    }
}

/// Why a flight has no lasting result.
struct Trouble {
    reason: String,
    /// Whether it may be temporary.
    may_heal: bool,
}

fn lasting(reason: String) -> Stop {
    Stop::Trouble(Trouble { reason, may_heal: false })
}

/// A flight with local files, their current metadata, and the guards that keep them local.
type Here<'a> = (Planned, Vec<FileStamp>, Vec<Brought<'a>>);

impl Worker<'_> {
    /// Fetches the files of a flight and checks that they are as planned. If another node has its own copy with other
    /// timestamps, or a bucket has other tags, the content is compared.
    fn here(&self, flight: &Planned) -> Result<Here<'_>, Stop> {
        let flight = flight.clone().with_files(|file| self.logs.local(file));
        let files: Vec<FileStamp> =
            flight.all_files().map(|file| self.stamp_of_planned(file)).collect::<Result<_, Stop>>()?;
        let paths: Vec<PathBuf> = flight.all_files().map(|file| file.path.clone()).collect();
        let here = self.logs.bring(&paths, self.context.cancel).map_err(|e| self.unreadable(&flight.flight, &e))?;
        Ok((flight, files, here))
    }

    fn unreadable(&self, name: &str, error: &std::io::Error) -> Stop {
        match error.kind() {
            std::io::ErrorKind::Interrupted => Stop::Cancelled,
            _ => Stop::Trouble(Trouble { reason: format!("{name}: {error}"), may_heal: self.logs.may_heal(error) }),
        }
    }

    fn stamp_of_planned(&self, file: &PlannedFile) -> Result<FileStamp, Stop> {
        let unreadable = |e: std::io::Error| self.unreadable(&file.name(), &e);
        let stamp = self.logs.stamp_now(&file.path).map_err(unreadable)?;
        let is_planned = stamp == file.stamp
            || stamp.bytes == file.stamp.bytes && {
                let paths = std::slice::from_ref(&file.path);
                let _here = self.logs.bring(paths, self.context.cancel).map_err(unreadable)?;
                let hash = hash_file(&file.path, &mut vec![0; 1 << 16], |_| true).map_err(unreadable)?;
                hash.as_ref() == Some(&file.blake3)
            };
        let changed = || lasting(format!("{}: the log has changed since it was planned", file.name()));
        if is_planned { Ok(stamp) } else { Err(changed()) }
    }

    /// Rejects a log that changed meanwhile: its result would have the wrong key.
    fn refuse_changed(&self, flight: &Planned, before: &[FileStamp]) -> Result<(), Stop> {
        for (file, before) in flight.all_files().zip(before) {
            match self.logs.stamp_now(&file.path) {
                Ok(now) if now == *before => {}
                Err(e) if e.kind() != std::io::ErrorKind::NotFound => return Err(self.unreadable(&file.name(), &e)),
                _ => return Err(lasting(format!("{}: the file changed while it was read", file.name()))),
            }
        }
        Ok(())
    }
}

/// Why a study gave no result.
enum Stop {
    Cancelled,
    Trouble(Trouble),
    Failed(CampaignError),
}

impl From<Interrupted> for Stop {
    fn from(interrupted: Interrupted) -> Stop {
        match interrupted {
            Interrupted::Cancelled => Stop::Cancelled,
            Interrupted::Trouble(reason) => Stop::Trouble(Trouble { reason, may_heal: true }),
            Interrupted::Lasting(reason) => lasting(reason),
        }
    }
}

impl From<CampaignError> for Stop {
    fn from(error: CampaignError) -> Stop {
        Stop::Failed(error)
    }
}

thread_local! {
    static CATCHING: Cell<bool> = const { Cell::new(false) };
    static PLACE: RefCell<String> = const { RefCell::new(String::new()) };
}

/// Hides panics that become a row of the table from the terminal; others are shown as usual.
/// A program calls it once at startup; without it, such panics are also printed.
pub fn quiet_caught_panics() {
    let usual = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |info| {
        if !CATCHING.get() {
            return usual(info);
        }
        let place = info.location().map(ToString::to_string).unwrap_or_default();
        PLACE.with(|p| p.replace(place));
    }));
}

/// Runs `work`; returns a panic as its message, with its location if known.
pub(crate) fn caught<T>(work: impl FnOnce() -> T) -> Result<T, String> {
    CATCHING.set(true);
    let answer = catch_unwind(AssertUnwindSafe(work));
    CATCHING.set(false);
    answer.map_err(|panic| {
        let place = PLACE.take();
        let message = message_of(panic.as_ref());
        if place.is_empty() { message } else { format!("{message} ({place})") }
    })
}

fn message_of(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|s| (*s).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "a panic without a message".to_owned())
}
