//! One run at a time on an output folder, also across hosts and containers.

#[cfg(feature = "s3")]
mod bucket_lock;

use crate::error::CampaignError;
use crate::error::StoreError;
use crate::event::Event;
use crate::file_stamp::is_still_at;
use crate::process::Process;
use crate::run_context::RunContext;
use crate::store::Store;
use serde::{Deserialize, Serialize};
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// The lock's file; it also marks the folder as an output folder of flightlag.
pub(crate) const LOCK: &str = ".flightlag/lock";

/// The owner increments its heartbeat at this interval.
const HEARTBEAT: Duration = Duration::from_secs(5);
/// An owner on another host or container without a new heartbeat for this long counts as ended.
const SILENCE: Duration = Duration::from_secs(16);
/// How long two runs that start at once on a file system without locks wait to see each other's name.
const SETTLE: Duration = Duration::from_secs(1);
/// Attempts to take a lock while others remove its file.
const ATTEMPTS: u32 = 5;
const LOOK: Duration = Duration::from_millis(100);
/// Fixed size of the text in the lock's file, so that a shorter text overwrites a longer one completely.
const WIDTH: usize = 240;

/// Held during a run or a reduction.
///
/// The system releases the file lock when the process ends, however it ends. Some network file systems have no such
/// locks, or do not show them to other hosts. So the owner also writes its name and a heartbeat count. A second run on
/// the same host and container checks whether the owner's process is running. Elsewhere it waits for the next
/// heartbeat, or for too long a silence. Clocks of different hosts are never compared.
#[derive(Debug)]
pub(crate) struct OutputLock {
    stop: Option<Sender<()>>,
    heart: Option<JoinHandle<()>>,
}

/// Content of the lock's file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct Owner {
    /// Owner, for display.
    owner: String,
    host: String,
    /// Boot and namespace of process numbers.
    system: String,
    process: u32,
    process_start: u64,
    /// Incremented while the owner is running.
    heartbeat: u64,
    /// Whether the owner has released the lock.
    released: bool,
}

impl OutputLock {
    /// Takes the lock, or reports its owner.
    pub(crate) fn take(store: &Store, context: &RunContext<'_>) -> Result<OutputLock, CampaignError> {
        #[cfg(feature = "s3")]
        if let Some(storage) = store.bucket() {
            return bucket_lock::take(store.root(), storage, context);
        }
        OutputLock::take_after(store, context, SILENCE)
    }

    fn take_after(store: &Store, context: &RunContext<'_>, silence: Duration) -> Result<OutputLock, CampaignError> {
        for _ in 1..ATTEMPTS {
            match OutputLock::try_take(store, context, silence) {
                Ok(Some(lock)) => return Ok(lock),
                // A failed run removed its new folder at this moment.
                Ok(None) => {}
                Err(CampaignError::Store(error)) if error.source.kind() == ErrorKind::NotFound => {}
                Err(error) => return Err(error),
            }
        }
        OutputLock::try_take(store, context, silence)?.ok_or_else(|| busy(store, None))
    }

    /// Takes the lock; `None` if its file was removed meanwhile.
    fn try_take(
        store: &Store,
        context: &RunContext<'_>,
        silence: Duration,
    ) -> Result<Option<OutputLock>, CampaignError> {
        let path = store.path(LOCK)?;
        let failed = |doing| move |source| StoreError { path: path.clone(), doing, source };
        let folder = store.path(".flightlag")?;
        std::fs::create_dir_all(&folder).map_err(failed.clone()("make the folder of"))?;
        let open = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(store.path(LOCK)?);
        let mut file = open.map_err(failed.clone()("open"))?;
        let locked = match file.try_lock() {
            Ok(()) => true,
            Err(TryLockError::WouldBlock) => return Err(busy(store, read(&mut file))),
            Err(TryLockError::Error(_)) => false,
        };
        if let Some(owner) = owner_at_work(&mut file, silence, context)? {
            return Err(busy(store, Some(owner)));
        }
        let mine = Owner::this();
        write(&mut file, &mine).map_err(failed.clone()("write"))?;
        if !locked {
            std::thread::sleep(SETTLE);
            if let Some(other) = read(&mut file).filter(|owner| *owner != mine) {
                return Err(busy(store, Some(other)));
            }
        }
        let mut there = File::open(store.path(LOCK)?).map_err(failed("open"))?;
        if read(&mut there).as_ref() != Some(&mine) || !is_still_at(&file, &store.path(LOCK)?) {
            return Ok(None);
        }
        Ok(Some(OutputLock::with_heart(move |stopped| beat(file, mine, stopped))))
    }

    /// A lock with `beat` in a thread, which ends at the signal of its receiver.
    fn with_heart(beat: impl FnOnce(&Receiver<()>) + Send + 'static) -> OutputLock {
        let (stop, stopped) = channel();
        let heart = std::thread::spawn(move || beat(&stopped));
        OutputLock { stop: Some(stop), heart: Some(heart) }
    }
}

impl Drop for OutputLock {
    fn drop(&mut self) {
        drop(self.stop.take());
        if let Some(heart) = self.heart.take() {
            let _ = heart.join();
        }
    }
}

fn busy(store: &Store, owner: Option<Owner>) -> CampaignError {
    CampaignError::Busy {
        out: store.root().to_owned(),
        owner: owner.map_or("its process is unknown".to_owned(), |owner| owner.owner),
    }
}

/// Does `work` on a local output folder while holding its lock. Does nothing if another process holds it.
pub(crate) fn while_unused(out: &Path, work: impl FnOnce()) {
    let path = out.join(LOCK);
    let open = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(&path);
    // Without a folder for the lock, it is not taken.
    let Ok(mut file) = open else { return work() };
    // Another process may have removed this file, and a third may hold the lock of a new one.
    let unused = file.try_lock().is_ok()
        && is_still_at(&file, &path)
        && read(&mut file).is_none_or(|owner| owner.released || owner.has_ended() == Some(true));
    if unused {
        work();
    }
}

/// Writes heartbeats until the lock is released.
fn beat(mut file: File, mut owner: Owner, stopped: &Receiver<()>) {
    while stopped.recv_timeout(HEARTBEAT) == Err(RecvTimeoutError::Timeout) {
        owner.heartbeat += 1;
        // A disk that is temporarily full or unavailable is no reason to stop.
        let _ = write(&mut file, &owner);
    }
    owner.released = true;
    let _ = write(&mut file, &owner);
}

impl Owner {
    fn this() -> Owner {
        let Process { host, system, pid, started } = Process::this().clone();
        let owner = format!("process {pid} on {host}");
        Owner { owner, host, system, process: pid, process_start: started, heartbeat: 0, released: false }
    }

    fn has_ended(&self) -> Option<bool> {
        let (host, system) = (self.host.clone(), self.system.clone());
        Process { host, system, pid: self.process, started: self.process_start }.has_ended()
    }
}

/// The owner, if one is running although the file could be locked.
fn owner_at_work(file: &mut File, silence: Duration, context: &RunContext<'_>) -> Result<Option<Owner>, CampaignError> {
    let Some(owner) = read(file).filter(|owner| !owner.released) else { return Ok(None) };
    match owner.has_ended() {
        Some(true) => return Ok(None),
        Some(false) => return Ok(Some(owner)),
        None => {}
    }
    let text = format!("{} did not release this folder; checking whether it is still running", owner.owner);
    context.send(Event::Remark { text });
    let since = Instant::now();
    while since.elapsed() < silence {
        context.stopped()?;
        std::thread::sleep(LOOK);
        match read(file) {
            Some(now) if now.released => return Ok(None),
            Some(now) if now != owner => return Ok(Some(now)),
            _ => {}
        }
    }
    Ok(None)
}

fn write(file: &mut File, owner: &Owner) -> std::io::Result<()> {
    let text = serde_json::to_string(owner).unwrap_or_default();
    file.seek(SeekFrom::Start(0))?;
    file.write_all(format!("{text:<WIDTH$}\n").as_bytes())?;
    let end = file.stream_position()?;
    file.set_len(end)
}

fn read(file: &mut File) -> Option<Owner> {
    let mut text = String::new();
    file.seek(SeekFrom::Start(0)).ok()?;
    file.take(4096).read_to_string(&mut text).ok()?;
    serde_json::from_str(text.trim()).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

    const SHORT: Duration = Duration::from_millis(400);

    fn take(store: &Store) -> Result<OutputLock, CampaignError> {
        let cancel = AtomicBool::new(false);
        OutputLock::take_after(store, &RunContext { threads: 1, cancel: &cancel, events: &|_: &Event| {} }, SHORT)
    }

    fn store() -> (tempfile::TempDir, Store) {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        (folder, store)
    }

    #[test]
    fn a_second_run_is_rejected_until_the_first_has_ended() {
        let (_folder, store) = store();
        let first = take(&store).unwrap();
        let refusal = take(&store).unwrap_err();
        assert!(refusal.to_string().contains(&format!("process {} on", std::process::id())), "{refusal}");
        assert_eq!(refusal.exit(), crate::Exit::TryAgain);
        drop(first);
        take(&store).unwrap();
    }

    /// Failed runs remove the lock with their new folder while others take it. Two never hold it at once.
    #[test]
    fn a_lock_whose_file_is_removed_is_still_held_by_one_at_a_time() {
        let (folder, store) = store();
        let out = folder.path();
        let (held, taken) = (AtomicU32::new(0), AtomicU32::new(0));
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for _ in 0..100 {
                        if let Ok(lock) = take(&store) {
                            assert_eq!(held.fetch_add(1, Ordering::SeqCst), 0, "two hold the lock");
                            taken.fetch_add(1, Ordering::SeqCst);
                            std::thread::yield_now();
                            held.fetch_sub(1, Ordering::SeqCst);
                            drop(lock);
                        }
                        while_unused(out, || drop(std::fs::remove_file(out.join(LOCK))));
                    }
                });
            }
        });
        assert!(taken.into_inner() > 0);
    }

    /// The file of an owner without a system lock.
    fn owned_by(store: &Store, owner: &Owner) -> File {
        let path = store.path(LOCK).unwrap();
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        let mut file = OpenOptions::new().read(true).write(true).create(true).truncate(true).open(path).unwrap();
        write(&mut file, owner).unwrap();
        file
    }

    fn other_host() -> Owner {
        let (host, owner) = ("node7".to_owned(), format!("process {} on node7", std::process::id()));
        Owner { owner, host, system: "0badcafe".to_owned(), ..Owner::this() }
    }

    #[test]
    fn an_owner_on_another_host_with_heartbeats_keeps_the_folder() {
        let (_folder, store) = store();
        let mut file = owned_by(&store, &other_host());
        let counting = std::thread::spawn(move || {
            std::thread::sleep(SHORT / 2);
            write(&mut file, &Owner { heartbeat: 1, ..other_host() }).unwrap();
        });
        let refusal = take(&store).unwrap_err().to_string();
        assert!(refusal.contains("on node7"), "{refusal}");
        counting.join().unwrap();
    }

    #[test]
    fn an_owner_on_another_host_that_is_silent_or_released_loses_the_folder() {
        let (_folder, store) = store();
        drop(owned_by(&store, &other_host()));
        drop(take(&store).unwrap());
        let mut file = owned_by(&store, &other_host());
        let letting_go = std::thread::spawn(move || {
            std::thread::sleep(SHORT / 2);
            write(&mut file, &Owner { released: true, ..other_host() }).unwrap();
        });
        drop(take(&store).unwrap());
        letting_go.join().unwrap();
    }

    #[test]
    fn an_owner_on_this_host_counts_only_while_its_process_runs() {
        let (_folder, store) = store();
        drop(owned_by(&store, &Owner::this()));
        assert!(take(&store).is_err(), "it runs, and some file system hid its lock");
        drop(owned_by(&store, &Owner { process_start: 1, ..Owner::this() }));
        take(&store).unwrap();
    }
}
