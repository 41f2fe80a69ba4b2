//! Work that the reader of a log gives to idle threads.
//!
//! The result does not depend on the threads. The reader never waits for a thread that is busy elsewhere: it does a job
//! itself if no thread has started it. In a campaign the threads are those of its pool, and they are idle only during
//! the last flights. Elsewhere one pool serves all logs of the process. With one thread no work is given away.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, OnceLock, PoisonError};

/// The most threads that work for one file: the reader could not keep up with more.
const MOST_THREADS: usize = 4;

/// The threads that work for one reader.
pub(crate) struct Workers {
    /// The pool of the process; `None` for the pool of the reader's own thread.
    shared: Option<&'static rayon::ThreadPool>,
    /// The most jobs that are in progress or ready.
    most: usize,
    /// The number of jobs handed over that no thread has started, including ones that are no longer wanted.
    handed_over: Arc<AtomicUsize>,
}

impl Workers {
    /// `None` if there is only one thread, or threads cannot be started.
    pub(crate) fn available() -> Option<Workers> {
        static SHARED: OnceLock<Option<rayon::ThreadPool>> = OnceLock::new();
        let start = || rayon::ThreadPoolBuilder::new().num_threads(shared_threads()).build().ok();
        let shared = match rayon::current_thread_index() {
            Some(_) => None,
            None if shared_threads() < 2 => return None,
            None => Some(SHARED.get_or_init(start).as_ref()?),
        };
        let threads = shared.map_or_else(rayon::current_num_threads, rayon::ThreadPool::current_num_threads);
        let most = threads.min(MOST_THREADS) + 1;
        (threads > 1).then(|| Workers { shared, most, handed_over: Arc::default() })
    }

    /// Whether another job may be handed over in addition to `begun` ones.
    pub(crate) fn has_capacity(&self, begun: usize) -> bool {
        begun < self.most && self.handed_over.load(Ordering::Relaxed) < self.most
    }

    /// Hands over `work` on `item` to an idle thread.
    pub(crate) fn begin<T: Send + 'static>(&self, item: T, work: impl FnOnce(&mut T) + Send + 'static) -> Arc<Job<T>> {
        let job = Arc::new(Job::new(item));
        let (shared_job, handed_over) = (Arc::clone(&job), Arc::clone(&self.handed_over));
        handed_over.fetch_add(1, Ordering::Relaxed);
        let task = move || {
            handed_over.fetch_sub(1, Ordering::Relaxed);
            shared_job.run(work);
        };
        match self.shared {
            Some(pool) => pool.spawn(task),
            None => rayon::spawn(task),
        }
        job
    }
}

/// The number of cores, or fewer if `RAYON_NUM_THREADS` is lower.
fn shared_threads() -> usize {
    let cores = std::thread::available_parallelism().map_or(1, usize::from).min(MOST_THREADS);
    let asked =
        std::env::var("RAYON_NUM_THREADS").ok().and_then(|text| text.parse().ok()).filter(|&threads| threads > 0);
    asked.map_or(cores, |asked| cores.min(asked))
}

/// Work that a thread may start.
pub(crate) struct Job<T> {
    state: Mutex<State<T>>,
    changed: Condvar,
}

enum State<T> {
    Running,
    Idle(Outcome<T>),
    /// Returned to the reader.
    Gone,
}

/// The state of a job that no thread is working on.
pub(crate) enum Outcome<T> {
    /// No thread has started it.
    Open(T),
    Done(T),
    /// The thread panicked. The reader panics as well when it does the same work.
    Failed(T),
}

impl<T> Job<T> {
    fn new(item: T) -> Job<T> {
        Job { state: Mutex::new(State::Idle(Outcome::Open(item))), changed: Condvar::new() }
    }

    fn state(&self) -> MutexGuard<'_, State<T>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Does the work if it is still open. Returns whether it did.
    pub(crate) fn run(&self, work: impl FnOnce(&mut T)) -> bool {
        let mut state = self.state();
        let mut item = match std::mem::replace(&mut *state, State::Running) {
            State::Idle(Outcome::Open(item)) => item,
            other => {
                *state = other;
                return false;
            }
        };
        drop(state);
        let worked = catch_unwind(AssertUnwindSafe(|| work(&mut item)));
        *self.state() = State::Idle(if worked.is_ok() { Outcome::Done(item) } else { Outcome::Failed(item) });
        self.changed.notify_one();
        true
    }

    /// Whether a thread is working on it.
    pub(crate) fn is_running(&self) -> bool {
        matches!(*self.state(), State::Running)
    }

    /// Waits for the result. A job that no thread has started is withdrawn.
    pub(crate) fn wait(&self) -> Option<Outcome<T>> {
        let is_running = |state: &mut State<T>| matches!(state, State::Running);
        let mut state = self.changed.wait_while(self.state(), is_running).unwrap_or_else(PoisonError::into_inner);
        match std::mem::replace(&mut *state, State::Gone) {
            State::Idle(outcome) => Some(outcome),
            State::Running | State::Gone => None,
        }
    }

    /// Withdraws the work. `None` if a thread is working on it.
    pub(crate) fn withdraw(&self) -> Option<Outcome<T>> {
        let mut state = self.state();
        match std::mem::replace(&mut *state, State::Gone) {
            State::Idle(outcome) => Some(outcome),
            State::Running => {
                *state = State::Running;
                None
            }
            State::Gone => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_that_has_not_begun_is_withdrawn_and_never_done() {
        let job = Job::new(7);
        assert!(matches!(job.wait(), Some(Outcome::Open(item)) if item == 7));
        assert!(!job.run(|_| panic!("begun all the same")));
        assert!(job.wait().is_none() && job.withdraw().is_none());
    }

    #[test]
    fn a_thread_that_panics_returns_its_work() {
        let job = Job::new(7);
        assert!(job.run(|_| panic!("this is meant to be seen: a test of failure")));
        assert!(matches!(job.wait(), Some(Outcome::Failed(item)) if item == 7));
    }

    #[test]
    fn no_more_work_is_handed_over_than_threads_can_begin() {
        let (begun, has_begun) = std::sync::mpsc::channel();
        let (end, may_end) = std::sync::mpsc::channel::<()>();
        rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap().install(move || {
            // The other thread is busy until all is handed over.
            rayon::spawn(move || {
                begun.send(()).unwrap();
                may_end.recv().unwrap_err();
            });
            has_begun.recv().unwrap();
            let workers = Workers::available().unwrap();
            let mut handed_over = 0;
            while workers.has_capacity(0) {
                assert!(workers.begin((), |()| ()).withdraw().is_some());
                handed_over += 1;
            }
            assert_eq!((handed_over, workers.has_capacity(3)), (3, false));
            drop(end);
        });
    }

    #[test]
    fn one_thread_does_nothing_ahead() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert!(pool.install(Workers::available).is_none());
    }
}
