//! What was done to stamps, for people to know.

use flight::Graded;
use std::borrow::Cow;

/// Stamps that were put right, or of which there was a choice.
pub(super) struct Repair {
    pub(super) what: Graded,
    pub(super) count: u64,
    pub(super) text: Cow<'static, str>,
}
