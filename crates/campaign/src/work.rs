//! Parallel work on many items. The answer does not depend on the distribution over threads.

use crate::error::CampaignError;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// A private thread pool, so that `--threads` is exact on a shared node.
pub(crate) struct Workers {
    pool: rayon::ThreadPool,
}

impl Workers {
    /// Starts `threads` threads.
    pub(crate) fn start(threads: usize) -> Result<Workers, CampaignError> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.max(1)).build();
        let failed = |e| CampaignError::TryAgain(format!("cannot start {threads} threads: {e}"));
        Ok(Workers { pool: pool.map_err(failed)? })
    }

    /// Does `work` on every item, in order, as threads become free. Returns answers in the order of
    /// the items; `None` for items not started when the user stopped.
    pub(crate) fn each<T: Sync, R: Send, S>(
        &self,
        items: &[T],
        cancel: &AtomicBool,
        context: impl Fn() -> S + Sync,
        work: impl Fn(&mut S, &T) -> R + Sync,
    ) -> Vec<Option<R>> {
        let next = AtomicUsize::new(0);
        let of_thread = self.pool.broadcast(|_| {
            let mut own = context();
            let mut done = vec![];
            while !cancel.load(Ordering::Relaxed) {
                let i = next.fetch_add(1, Ordering::Relaxed);
                let Some(item) = items.get(i) else { break };
                done.push((i, work(&mut own, item)));
            }
            done
        });
        let mut answers: Vec<Option<R>> = items.iter().map(|_| None).collect();
        for (i, answer) in of_thread.into_iter().flatten() {
            if let Some(place) = answers.get_mut(i) {
                *place = Some(answer);
            }
        }
        answers
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_come_in_the_order_of_the_items() {
        let items: Vec<u64> = (0..500).collect();
        let workers = Workers::start(4).unwrap();
        let squares = workers.each(&items, &AtomicBool::new(false), || (), |(), &n| n * n);
        assert_eq!(squares, items.iter().map(|n| Some(n * n)).collect::<Vec<_>>());
    }

    #[test]
    fn nothing_is_started_after_the_user_has_stopped() {
        let cancel = AtomicBool::new(false);
        let items: Vec<usize> = (0..1000).collect();
        let workers = Workers::start(2).unwrap();
        let stop_at_ten = |(): &mut (), &n: &usize| {
            if n == 10 {
                cancel.store(true, Ordering::Relaxed);
            }
        };
        let begun = workers.each(&items, &cancel, || (), stop_at_ten).iter().flatten().count();
        assert!((11..1000).contains(&begun), "{begun}");
    }
}
