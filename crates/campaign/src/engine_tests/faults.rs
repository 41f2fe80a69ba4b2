//! A disk that is full or fails, and power loss, at any step of a campaign.

use super::*;
use crate::disk::{Disk, System};
use std::cell::RefCell;
use std::collections::BTreeSet;
use std::fs::File;
use std::io;
use std::sync::Arc;

thread_local! {
    static DISK: RefCell<Option<Faulty>> = const { RefCell::new(None) };
}

/// The disk of the stores that this thread opens.
pub(crate) fn disk() -> Box<dyn Disk> {
    DISK.with_borrow(|faulty| match faulty {
        Some(faulty) => Box::new(faulty.clone()) as Box<dyn Disk>,
        None => Box::new(System),
    })
}

/// A disk on which one step fails.
#[derive(Debug, Clone, Default)]
struct Faulty(Arc<Fault>);

#[derive(Debug, Default)]
struct Fault {
    /// The step that fails, counted from 0.
    at: usize,
    /// Whether all later steps fail too.
    ever_after: bool,
    /// System error number.
    error: i32,
    done: Mutex<usize>,
    /// Files with content that may not be on the disk yet.
    unsynced: Mutex<BTreeSet<PathBuf>>,
}

impl Faulty {
    fn new(at: usize, ever_after: bool, error: i32) -> Faulty {
        Faulty(Arc::new(Fault { at, ever_after, error, ..Fault::default() }))
    }

    fn step(&self) -> io::Result<()> {
        let mut done = self.0.done.lock().unwrap();
        let fails = *done == self.0.at || self.0.ever_after && *done > self.0.at;
        *done += 1;
        if fails { Err(io::Error::from_raw_os_error(self.0.error)) } else { Ok(()) }
    }

    /// Does `work` with stores on this disk; returns the number of steps.
    fn while_at<T>(&self, work: impl FnOnce() -> T) -> (T, usize) {
        DISK.set(Some(self.clone()));
        let answer = work();
        DISK.set(None);
        let steps = *self.0.done.lock().unwrap();
        (answer, steps)
    }

    /// Discards the unsynced content of every second file.
    fn lose_power(&self) -> usize {
        let unsynced = self.0.unsynced.lock().unwrap();
        let lost = unsynced.iter().filter(|path| path.exists()).skip(self.0.at % 2).step_by(2);
        lost.map(|path| File::options().write(true).open(path).unwrap().set_len(0).unwrap()).count()
    }
}

impl Disk for Faulty {
    fn create(&self, path: &Path) -> io::Result<File> {
        self.step()?;
        let file = System.create(path)?;
        self.0.unsynced.lock().unwrap().insert(path.to_owned());
        match self.step() {
            Ok(()) => Ok(file),
            // The file exists, and all writes to it fail.
            Err(_) => File::options().write(true).open("/dev/full"),
        }
    }

    fn sync(&self, file: &File, path: &Path) -> io::Result<()> {
        self.step()?;
        self.0.unsynced.lock().unwrap().remove(path);
        System.sync(file, path)
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        self.step()?;
        let mut unsynced = self.0.unsynced.lock().unwrap();
        let is_unsynced = unsynced.remove(from);
        if is_unsynced {
            unsynced.insert(to.to_owned())
        } else {
            unsynced.remove(to)
        };
        System.rename(from, to)
    }

    fn sync_folder(&self, path: &Path) -> io::Result<()> {
        self.step()?;
        System.sync_folder(path)
    }
}

/// ENOSPC, EIO, EDQUOT, EFBIG.
const ERRORS: [i32; 4] = [28, 5, 122, 27];

/// A campaign of two flights, its report, and the number of steps.
struct Whole {
    bench: Bench,
    tree: BTreeMap<PathBuf, Vec<u8>>,
    steps: usize,
}

impl Whole {
    fn new() -> Whole {
        let bench = Bench::new(&[("a.csv", "one"), ("b.csv", "late 0.2")]);
        let (ran, steps) = Faulty::new(usize::MAX, false, 0).while_at(|| bench.run_into(&bench.out(), 1, false));
        assert_eq!(ran.verdict().totals.compensated, 2);
        let tree = bench.tree(&bench.out());
        Whole { bench, tree, steps }
    }

    fn run(&self, out: &Path) -> Ran {
        self.bench.run_into(out, 1, false)
    }

    /// The disk fails at a step: the run reports where and leaves no partial file, and the next run ends with the same
    /// bytes.
    fn fails_at(&self, at: usize, ever_after: bool) {
        let error = ERRORS[at % ERRORS.len()];
        let what = format!("step {at} of {}, error {error}, ever after: {ever_after}", self.steps);
        let out = self.bench.folder.path().join(format!("at-{at}-{ever_after}"));
        let (ran, _) = Faulty::new(at, ever_after, error).while_at(|| self.run(&out));
        match ran.verdict {
            Ok(_) => assert_eq!(self.bench.tree(&out), self.tree, "{what}"),
            Err(failed) => {
                let heals = error != 27;
                let full_disk = failed.to_string().contains("No space left");
                let exit = if heals || full_disk { Exit::TryAgain } else { Exit::Failed };
                assert_eq!(failed.exit(), exit, "{what}: {failed}");
                assert!(failed.to_string().contains("at-"), "{what}: it names no file: {failed}");
                let left = if out.exists() { self.bench.tree(&out) } else { BTreeMap::new() };
                for (path, bytes) in left {
                    assert!(self.tree.get(&path) == Some(&bytes), "{what}: {} is not whole", path.display());
                }
            }
        }
        self.ends_well(&out, &what);
    }

    /// The machine loses power at a step, and with it all unsynced content.
    fn loses_power_at(&self, at: usize) -> usize {
        let out = self.bench.folder.path().join(format!("power-{at}"));
        let faulty = Faulty::new(at, true, 5);
        faulty.while_at(|| self.run(&out).verdict.is_ok());
        let lost = faulty.lose_power();
        self.ends_well(&out, &format!("power is lost at step {at} of {}, {lost} files", self.steps));
        lost
    }

    fn ends_well(&self, out: &Path, what: &str) {
        let again = self.run(out);
        assert_eq!(again.verdict().totals.compensated, 2, "{what}");
        let tree = self.bench.tree(out);
        assert_eq!(tree.keys().collect::<Vec<_>>(), self.tree.keys().collect::<Vec<_>>(), "{what}");
        assert!(tree == self.tree, "{what}: other bytes");
        fs::remove_dir_all(out).unwrap();
    }
}

#[test]
#[cfg(target_os = "linux")]
fn a_disk_failure_at_some_steps_leaves_no_partial_files() {
    let whole = Whole::new();
    assert!(whole.steps > 100, "{}", whole.steps);
    for at in (0..whole.steps).step_by(17) {
        whole.fails_at(at, at % 2 == 0);
    }
}

#[test]
#[cfg(target_os = "linux")]
fn outputs_not_synced_at_a_power_loss_are_made_again() {
    let whole = Whole::new();
    let lost: usize = (0..whole.steps).step_by(13).map(|at| whole.loses_power_at(at)).sum();
    assert!(lost > 10, "{lost}");
}

#[test]
#[cfg(target_os = "linux")]
#[ignore = "every step, minutes: just faults-outputs"]
fn a_disk_failure_at_any_step_leaves_no_partial_files() {
    let whole = Whole::new();
    for at in 0..whole.steps {
        whole.fails_at(at, false);
        whole.fails_at(at, true);
        whole.loses_power_at(at);
        // And again during the next run.
        let out = whole.bench.folder.path().join("at-twice");
        for step in [at, at / 2, at / 3] {
            drop(Faulty::new(step, true, 28).while_at(|| whole.run(&out)));
        }
        whole.ends_well(&out, &format!("step {at}, thrice"));
    }
}
