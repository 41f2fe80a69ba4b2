//! Idle threads, and work that the walk through a log leaves to them.
//!
//! Their work does not change what is read, and the walk never waits for a thread that is busy elsewhere: it does work
//! that no thread has begun itself. In a campaign the threads are those of its pool, which all have flights of their
//! own until the last ones; elsewhere one pool serves all logs of the process. With one thread nothing is done ahead.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, OnceLock, PoisonError};

/// Most threads that work for one file: its walk could not keep up with more.
const MOST_THREADS: usize = 4;

/// The threads that work for one walk.
pub(crate) struct Crew {
    /// The pool of the process; `None` for that of the thread that walks.
    shared: Option<&'static rayon::ThreadPool>,
    /// Most items that are in progress or ready.
    most: usize,
    /// Items handed over that no thread has begun, including ones that are no longer wanted.
    handed_over: Arc<AtomicUsize>,
}

impl Crew {
    /// `None` if there is only one thread, or threads cannot be started.
    pub(crate) fn at_hand() -> Option<Crew> {
        static SHARED: OnceLock<Option<rayon::ThreadPool>> = OnceLock::new();
        let start = || rayon::ThreadPoolBuilder::new().num_threads(shared_threads()).build().ok();
        let shared = match rayon::current_thread_index() {
            Some(_) => None,
            None if shared_threads() < 2 => return None,
            None => Some(SHARED.get_or_init(start).as_ref()?),
        };
        let threads = shared.map_or_else(rayon::current_num_threads, rayon::ThreadPool::current_num_threads);
        let most = threads.min(MOST_THREADS) + 1;
        (threads > 1).then(|| Crew { shared, most, handed_over: Arc::default() })
    }

    /// Whether another item may be begun in addition to `begun`.
    pub(crate) fn has_time(&self, begun: usize) -> bool {
        begun < self.most && self.handed_over.load(Ordering::Relaxed) < self.most
    }

    /// Gives `work` on `item` to an idle thread.
    pub(crate) fn begin<T: Send + 'static>(
        &self,
        item: T,
        work: impl FnOnce(&mut T) + Send + 'static,
    ) -> Arc<Order<T>> {
        let order = Arc::new(Order::new(item));
        let (theirs, handed_over) = (Arc::clone(&order), Arc::clone(&self.handed_over));
        handed_over.fetch_add(1, Ordering::Relaxed);
        let task = move || {
            handed_over.fetch_sub(1, Ordering::Relaxed);
            theirs.carry_out(work);
        };
        match self.shared {
            Some(pool) => pool.spawn(task),
            None => rayon::spawn(task),
        }
        order
    }
}

/// The number of cores, or fewer if rayon's own variable says so.
fn shared_threads() -> usize {
    let cores = std::thread::available_parallelism().map_or(1, usize::from).min(MOST_THREADS);
    let asked =
        std::env::var("RAYON_NUM_THREADS").ok().and_then(|text| text.parse().ok()).filter(|&threads| threads > 0);
    asked.map_or(cores, |asked| cores.min(asked))
}

/// Work that a thread may begin.
pub(crate) struct Order<T> {
    state: Mutex<State<T>>,
    changed: Condvar,
}

enum State<T> {
    TakenUp,
    Is(Outcome<T>),
    /// Given back to the walk.
    Gone,
}

/// State of a piece of work.
pub(crate) enum Outcome<T> {
    /// No thread has begun it.
    Open(T),
    Done(T),
    /// The thread panicked. The walk panics again when it does the same work.
    Failed(T),
}

impl<T> Order<T> {
    fn new(item: T) -> Order<T> {
        Order { state: Mutex::new(State::Is(Outcome::Open(item))), changed: Condvar::new() }
    }

    fn state(&self) -> MutexGuard<'_, State<T>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Does the work if it is still open. Returns whether it did.
    pub(crate) fn carry_out(&self, work: impl FnOnce(&mut T)) -> bool {
        let mut state = self.state();
        let mut item = match std::mem::replace(&mut *state, State::TakenUp) {
            State::Is(Outcome::Open(item)) => item,
            other => {
                *state = other;
                return false;
            }
        };
        drop(state);
        let worked = catch_unwind(AssertUnwindSafe(|| work(&mut item)));
        *self.state() = State::Is(if worked.is_ok() { Outcome::Done(item) } else { Outcome::Failed(item) });
        self.changed.notify_one();
        true
    }

    /// Whether a thread is working on it.
    pub(crate) fn is_under_way(&self) -> bool {
        matches!(*self.state(), State::TakenUp)
    }

    /// The result, as soon as it is available; work that has not begun is withdrawn.
    pub(crate) fn wait(&self) -> Option<Outcome<T>> {
        let is_under_way = |state: &mut State<T>| matches!(state, State::TakenUp);
        let mut state = self.changed.wait_while(self.state(), is_under_way).unwrap_or_else(PoisonError::into_inner);
        match std::mem::replace(&mut *state, State::Gone) {
            State::Is(outcome) => Some(outcome),
            State::TakenUp | State::Gone => None,
        }
    }

    /// Withdraws the work. `None` if a thread is working on it.
    pub(crate) fn revoke(&self) -> Option<Outcome<T>> {
        let mut state = self.state();
        match std::mem::replace(&mut *state, State::Gone) {
            State::Is(outcome) => Some(outcome),
            State::TakenUp => {
                *state = State::TakenUp;
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
        let order = Order::new(7);
        assert!(matches!(order.wait(), Some(Outcome::Open(item)) if item == 7));
        assert!(!order.carry_out(|_| panic!("begun all the same")));
        assert!(order.wait().is_none() && order.revoke().is_none());
    }

    #[test]
    fn a_thread_that_panics_returns_its_work() {
        let order = Order::new(7);
        assert!(order.carry_out(|_| panic!("this is meant to be seen: a test of failure")));
        assert!(matches!(order.wait(), Some(Outcome::Failed(item)) if item == 7));
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
            let crew = Crew::at_hand().unwrap();
            let mut handed_over = 0;
            while crew.has_time(0) {
                assert!(crew.begin((), |()| ()).revoke().is_some());
                handed_over += 1;
            }
            assert_eq!((handed_over, crew.has_time(3)), (3, false));
            drop(end);
        });
    }

    #[test]
    fn one_thread_does_nothing_ahead() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert!(pool.install(Crew::at_hand).is_none());
    }
}
