//! Timelines and series, checked once at birth and total afterwards.

use crate::time::{Clock, Stamp, StampKind};
use std::sync::Arc;

/// Strictly rising stamps of one kind, read from one clock.
#[derive(Debug, Clone, PartialEq)]
pub struct Timeline {
    kind: StampKind,
    clock: Clock,
    /// Channels of one topic often have the same ones, and then share them.
    stamps: Arc<Vec<Stamp>>,
    shared_step_s: f64,
}

/// Why stamps and values do not make a series.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SeriesError {
    /// A stamp is not later than the one before it.
    #[error("stamp {index} ({now} ns) is not later than the one before it ({before} ns)")]
    NotRising {
        /// Row of the offending stamp.
        index: usize,
        /// The stamp before it.
        before: i64,
        /// The offending stamp.
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
    /// A component has another number of rows than the timeline.
    #[error("component {component} has {rows} rows where the timeline has {stamps} stamps")]
    Length {
        /// The component.
        component: usize,
        /// Its rows.
        rows: usize,
        /// Stamps in the timeline.
        stamps: usize,
    },
}

impl Timeline {
    /// Checks that the stamps rise strictly.
    ///
    /// # Errors
    /// [`SeriesError::NotRising`] with the first stamp that does not.
    pub fn new(kind: StampKind, clock: Clock, stamps: Vec<Stamp>) -> Result<Timeline, SeriesError> {
        for (i, pair) in stamps.windows(2).enumerate() {
            if pair[1] <= pair[0] {
                return Err(SeriesError::NotRising { index: i + 1, before: pair[0].0, now: pair[1].0 });
            }
        }
        Ok(Timeline { kind, clock, stamps: Arc::new(stamps), shared_step_s: 0.0 })
    }

    /// The same timeline of a clock so coarse that several rows had one stamp, of which one row is left: its stamps are
    /// `step_s` apart, and a row may have been measured at any time between two.
    #[must_use]
    pub fn with_shared_step(self, step_s: f64) -> Timeline {
        Timeline { shared_step_s: step_s, ..self }
    }

    /// How far apart the stamps are that several rows shared, s; 0 if each row had its own.
    #[must_use]
    pub fn shared_step_s(&self) -> f64 {
        self.shared_step_s
    }

    /// Which stamps these are.
    #[must_use]
    pub fn kind(&self) -> StampKind {
        self.kind
    }

    /// The clock they were read from.
    #[must_use]
    pub fn clock(&self) -> Clock {
        self.clock
    }

    /// The stamps, strictly rising.
    #[must_use]
    pub fn stamps(&self) -> &[Stamp] {
        &self.stamps
    }

    /// Seconds of every stamp after `origin`.
    #[must_use]
    pub fn seconds_since(&self, origin: Stamp) -> Vec<f64> {
        self.stamps.iter().map(|s| s.seconds_since(origin)).collect()
    }

    /// First stamp, if there is one.
    #[must_use]
    pub fn first(&self) -> Option<Stamp> {
        self.stamps.first().copied()
    }

    /// Last stamp, if there is one.
    #[must_use]
    pub fn last(&self) -> Option<Stamp> {
        self.stamps.last().copied()
    }

    /// From the first stamp to the last, s; 0 when there are fewer than two.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        match (self.first(), self.last()) {
            (Some(first), Some(last)) => last.seconds_since(first),
            _ => 0.0,
        }
    }
}

/// Finite values of one or more components over one [`Timeline`], column by column.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    timeline: Timeline,
    components: Vec<Vec<f64>>,
}

impl Series {
    /// Checks that every component has one finite value for every stamp.
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

    /// When.
    #[must_use]
    pub fn timeline(&self) -> &Timeline {
        &self.timeline
    }

    /// Takes the stamps of another series in place of its own if they are equal: those of a long record are then held once.
    pub(crate) fn share_stamps(&mut self, other: &Series) -> bool {
        let is_equal = self.timeline.stamps == other.timeline.stamps;
        if is_equal {
            self.timeline.stamps = Arc::clone(&other.timeline.stamps);
        }
        is_equal
    }

    /// All components, each with one value per stamp.
    #[must_use]
    pub fn components(&self) -> &[Vec<f64>] {
        &self.components
    }

    /// All components, without the timeline: a long record is not held twice.
    #[must_use]
    pub fn into_components(self) -> Vec<Vec<f64>> {
        self.components
    }

    /// One component.
    ///
    /// # Panics
    /// If there are not that many.
    #[must_use]
    pub fn component(&self, index: usize) -> &[f64] {
        &self.components[index]
    }

    /// Rows.
    #[must_use]
    pub fn len(&self) -> usize {
        self.timeline.stamps.len()
    }

    /// Without rows.
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
    fn equal_and_falling_stamps_are_refused_with_their_row() {
        for bad in [[0, 5, 5], [0, 5, 4]] {
            let error = Timeline::new(StampKind::Logged, Clock::Unix, stamps(&bad)).unwrap_err();
            assert_eq!(error, SeriesError::NotRising { index: 2, before: 5, now: bad[2] });
        }
    }

    #[test]
    fn values_that_are_not_finite_or_do_not_fit_are_refused() {
        let line = || Timeline::new(StampKind::Logged, Clock::Unix, stamps(&[0, 1])).unwrap();
        assert!(matches!(
            Series::new(line(), vec![vec![1.0, 2.0], vec![1.0, f64::INFINITY]]),
            Err(SeriesError::NotFinite { component: 1, row: 1, .. })
        ));
        assert!(matches!(Series::new(line(), vec![vec![1.0]]), Err(SeriesError::Length { rows: 1, stamps: 2, .. })));
    }

    #[test]
    fn an_empty_series_is_a_series() {
        let empty =
            Series::new(Timeline::new(StampKind::Measured, Clock::Boot, vec![]).unwrap(), vec![vec![]]).unwrap();
        assert!(empty.is_empty());
        assert_eq!(empty.timeline().duration_s(), 0.0);
    }
}
