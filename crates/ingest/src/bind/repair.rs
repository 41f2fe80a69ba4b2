//! What was done to stamps, for people to know.

use flight::Severity;
use std::borrow::Cow;

/// Stamps that were put right, or of which there was a choice.
pub(super) struct Repair {
    pub(super) severity: Severity,
    pub(super) code: &'static str,
    pub(super) count: u64,
    pub(super) text: Cow<'static, str>,
}
