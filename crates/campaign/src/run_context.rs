//! How a run executes, and where it reports.

use crate::error::CampaignError;
use crate::event::{Event, EventSink};
use std::sync::atomic::{AtomicBool, Ordering};

/// The run context: how to execute, and where to report. Does not affect any result.
pub struct RunContext<'a> {
    /// Number of threads.
    pub threads: usize,
    /// Set when the user wants to stop.
    pub cancel: &'a AtomicBool,
    /// Receiver of events.
    pub events: &'a dyn EventSink,
}

impl RunContext<'_> {
    pub(crate) fn send(&self, event: Event) {
        self.events.event(&event);
    }

    pub(crate) fn stopped(&self) -> Result<(), CampaignError> {
        if self.cancel.load(Ordering::Relaxed) { Err(CampaignError::Cancelled) } else { Ok(()) }
    }
}
