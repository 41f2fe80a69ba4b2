//! Timelines and series, validated once at construction.

use crate::time::{Clock, Stamp, StampKind};
use std::sync::Arc;

/// Strictly increasing timestamps of one kind, read from one clock.
#[derive(Debug, Clone, PartialEq)]
pub struct Timeline {
    kind: StampKind,
    clock: Clock,
    /// Shared, because channels of one topic often have the same timestamps.
    stamps: Arc<Vec<Stamp>>,
    shared_step_s: f64,
}

/// Why timestamps and values do not form a series.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SeriesError {
    /// A timestamp is not later than the previous one.
    #[error("timestamp {index} ({now} ns) is not later than the one before it ({before} ns)")]
    NotRising {
        /// Row of the offending timestamp.
        index: usize,
        /// The previous timestamp.
        before: i64,
        /// The offending timestamp.
        now: i64,
    },
    /// A value is NaN or infinite.
    #[error("component {component}, row {row}: {value} is not finite")]
    NotFinite {
        /// Component (column) of the value.
        component: usize,
        /// Row of the value.
        row: usize,
        /// The value.
        value: f64,
    },
    /// A component has a different number of rows than the timeline.
    #[error("component {component} has {rows} rows, but the timeline has {stamps} timestamps")]
    Length {
        /// The component.
        component: usize,
        /// Its rows.
        rows: usize,
        /// Number of timestamps in the timeline.
        stamps: usize,
    },
}

impl Timeline {
    /// Checks that the timestamps increase strictly.
    ///
    /// # Errors
    /// [`SeriesError::NotRising`] with the first timestamp that does not.
    pub fn new(kind: StampKind, clock: Clock, stamps: Vec<Stamp>) -> Result<Timeline, SeriesError> {
        for (i, pair) in stamps.windows(2).enumerate() {
            if pair[1] <= pair[0] {
                return Err(SeriesError::NotRising { index: i + 1, before: pair[0].0, now: pair[1].0 });
            }
        }
        Ok(Timeline { kind, clock, stamps: Arc::new(stamps), shared_step_s: 0.0 })
    }

    /// The same timeline for a clock so coarse that several rows shared a timestamp and only one of them was kept: its
    /// timestamps are `step_s` apart, and a row may have been measured at any time between two.
    #[must_use]
    pub fn with_shared_step(self, step_s: f64) -> Timeline {
        Timeline { shared_step_s: step_s, ..self }
    }

    /// Distance between the timestamps that several rows shared, s; 0 if each row had its own.
    #[must_use]
    pub fn shared_step_s(&self) -> f64 {
        self.shared_step_s
    }

    /// Kind of these timestamps.
    #[must_use]
    pub fn kind(&self) -> StampKind {
        self.kind
    }

    /// The clock they were read from.
    #[must_use]
    pub fn clock(&self) -> Clock {
        self.clock
    }

    /// The timestamps, strictly increasing.
    #[must_use]
    pub fn stamps(&self) -> &[Stamp] {
        &self.stamps
    }

    /// Seconds from `origin` to every timestamp.
    #[must_use]
    pub fn seconds_since(&self, origin: Stamp) -> Vec<f64> {
        self.stamps.iter().map(|s| s.seconds_since(origin)).collect()
    }

    /// First timestamp, if any.
    #[must_use]
    pub fn first(&self) -> Option<Stamp> {
        self.stamps.first().copied()
    }

    /// Last timestamp, if any.
    #[must_use]
    pub fn last(&self) -> Option<Stamp> {
        self.stamps.last().copied()
    }

    /// Time from the first timestamp to the last, s; 0 if there are fewer than two.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        match (self.first(), self.last()) {
            (Some(first), Some(last)) => last.seconds_since(first),
            _ => 0.0,
        }
    }
}

/// Finite values of one or more components over one [`Timeline`], by column.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    timeline: Timeline,
    components: Vec<Vec<f64>>,
}

impl Series {
    /// Checks that every component has one finite value per timestamp.
    ///
    /// # Errors
    /// [`SeriesError::Length`] or [`SeriesError::NotFinite`] for the first fault found.
    pub fn new(timeline: Timeline, components: Vec<Vec<f64>>) -> Result<Series, SeriesError> {
        for (component, values) in components.iter().enumerate() {
            if values.len() != timeline.stamps.len() {
                return Err(SeriesError::Length { component, rows: values.len(), stamps: timeline.stamps.len() });
            }
            if let Some((row, &value)) = values.iter().enumerate().find(|(_, v)| !v.is_finite()) {
                return Err(SeriesError::NotFinite { component, row, value });
            }
        }
        Ok(Series { timeline, components })
    }

    /// The timestamps.
    #[must_use]
    pub fn timeline(&self) -> &Timeline {
        &self.timeline
    }

    /// Shares the timestamps of another series if they are equal, so that those of a long record are held in memory
    /// once.
    pub(crate) fn share_stamps(&mut self, other: &Series) -> bool {
        let is_equal = self.timeline.stamps == other.timeline.stamps;
        if is_equal {
            self.timeline.stamps = Arc::clone(&other.timeline.stamps);
        }
        is_equal
    }

    /// All components, each with one value per timestamp.
    #[must_use]
    pub fn components(&self) -> &[Vec<f64>] {
        &self.components
    }

    /// All components, without the timeline, so that a long record is not held twice.
    #[must_use]
    pub fn into_components(self) -> Vec<Vec<f64>> {
        self.components
    }

    /// One component.
    ///
    /// # Panics
    /// If `index` is out of range.
    #[must_use]
    pub fn component(&self, index: usize) -> &[f64] {
        &self.components[index]
    }

    /// Number of rows.
    #[must_use]
    pub fn len(&self) -> usize {
        self.timeline.stamps.len()
    }

    /// Whether there are no rows.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.timeline.stamps.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stamps(nanos: &[i64]) -> Vec<Stamp> {
        nanos.iter().copied().map(Stamp).collect()
    }

    #[test]
    fn equal_and_decreasing_stamps_are_rejected_with_their_row() {
        for bad in [[0, 5, 5], [0, 5, 4]] {
            let error = Timeline::new(StampKind::Logged, Clock::Unix, stamps(&bad)).unwrap_err();
            assert_eq!(error, SeriesError::NotRising { index: 2, before: 5, now: bad[2] });
        }
    }

    #[test]
    fn non_finite_and_misaligned_values_are_rejected() {
        let line = || Timeline::new(StampKind::Logged, Clock::Unix, stamps(&[0, 1])).unwrap();
        assert!(matches!(
            Series::new(line(), vec![vec![1.0, 2.0], vec![1.0, f64::INFINITY]]),
            Err(SeriesError::NotFinite { component: 1, row: 1, .. })
        ));
        assert!(matches!(Series::new(line(), vec![vec![1.0]]), Err(SeriesError::Length { rows: 1, stamps: 2, .. })));
    }

    #[test]
    fn an_empty_series_is_valid() {
        let empty =
            Series::new(Timeline::new(StampKind::Measured, Clock::Boot, vec![]).unwrap(), vec![vec![]]).unwrap();
        assert!(empty.is_empty());
        assert_eq!(empty.timeline().duration_s(), 0.0);
    }
}
