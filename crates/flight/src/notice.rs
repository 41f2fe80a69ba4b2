//! Notices: what the user must know. Nothing is dropped silently.

mod catalogue;
mod code;

pub use catalogue::{Alarm, Code};
pub use code::{AlarmEntry, CodeEntry, Graded, Gravity};

#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How much a notice matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Severity {
    /// Worth knowing; every number is valid.
    Info,
    /// Something was assumed, skipped or repaired; a number may deserve a second look.
    Warning,
    /// Data that the logger wrote could not be read: bytes are damaged, truncated or fail their checksum.
    Loss,
}

impl Severity {
    /// The word that is serialised and shown.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Severity::Info => "info",
            Severity::Warning => "warning",
            Severity::Loss => "loss",
        }
    }
}

/// One thing that happened to the data, with its place and how often it happened.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct Notice {
    /// How much it matters.
    pub severity: Severity,
    /// A stable name for machines, such as `duplicate-stamp`.
    pub code: String,
    /// File, topic, line or byte, as precise as known; empty for the whole flight.
    pub place: String,
    /// Number of samples, rows, bytes or events concerned.
    pub count: u64,
    /// A sentence for people.
    pub text: String,
}

/// Notices in the order in which they were raised.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(transparent)]
pub struct Notices(Vec<Notice>);

impl Notices {
    /// An empty list.
    #[must_use]
    pub fn new() -> Notices {
        Notices::default()
    }

    /// Adds a notice: a [`Code`] with its usual severity, or [`Code::at`] with another.
    pub fn push(&mut self, what: impl Into<Graded>, place: impl Into<String>, count: u64, text: impl Into<String>) {
        let Graded { code, severity } = what.into();
        let code = code.name().to_owned();
        self.add(Notice { severity, code, place: place.into(), count, text: text.into() });
    }

    /// Adds a notice that was created elsewhere.
    pub fn add(&mut self, notice: Notice) {
        self.0.push(notice);
    }

    /// Appends the notices of a part.
    pub fn extend(&mut self, other: Notices) {
        self.0.extend(other.0);
    }

    /// Appends only notices that are not in the list yet: two studies of one channel find the same things.
    pub fn extend_unsaid(&mut self, other: Notices) {
        for notice in other.0 {
            if !self.0.contains(&notice) {
                self.0.push(notice);
            }
        }
    }

    /// Turns all losses into warnings, for a log whose losses do not affect any result.
    pub fn lower_losses(&mut self) {
        let losses = self.0.iter_mut().filter(|notice| notice.severity == Severity::Loss);
        losses.for_each(|notice| notice.severity = Severity::Warning);
    }

    /// All notices.
    pub fn iter(&self) -> impl Iterator<Item = &Notice> {
        self.0.iter()
    }

    /// Number of notices.
    #[must_use]
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Number of notices of this severity.
    #[must_use]
    pub fn count_of(&self, severity: Severity) -> u64 {
        self.0.iter().filter(|n| n.severity == severity).count() as u64
    }

    /// Whether there are no notices.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Whether data were lost: the reason for exit code 3 and the red mark.
    #[must_use]
    pub fn any_loss(&self) -> bool {
        self.0.iter().any(|n| n.severity == Severity::Loss)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_duplicate_notice_is_not_added_again() {
        let gap = |count| {
            let mut notices = Notices::new();
            notices.push(Code::RecordSplit, "velocity.gps", count, "the record is cut there");
            notices
        };
        let mut notices = gap(2);
        notices.extend_unsaid(gap(2));
        notices.extend_unsaid(gap(3));
        assert_eq!(notices.iter().map(|n| n.count).collect::<Vec<_>>(), [2, 3]);
    }

    #[test]
    fn only_a_loss_marks_a_flight_as_lossy() {
        let mut notices = Notices::new();
        notices.push(Code::HeldRows, "gps", 3, "3 rows repeat the one before");
        assert!(!notices.any_loss());
        notices.push(Code::IncompleteRecording, "a.bag, byte 10", 1, "the file ends inside a record");
        assert!(notices.any_loss());
    }
}
