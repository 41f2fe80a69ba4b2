//! Repairs of timestamps, to be reported.

use flight::Graded;
use std::borrow::Cow;

/// Timestamps that were corrected, or chosen from several.
pub(super) struct Repair {
    pub(super) what: Graded,
    pub(super) count: u64,
    pub(super) text: Cow<'static, str>,
}
