//! Faults of the clocks of a log, and their ties to UTC.

mod midnight;
mod suspect;
mod tie;
mod week;
mod wrap;

pub(crate) use midnight::redate_days;
pub(crate) use suspect::{SaidDates, Since, suspicion};
pub(crate) use tie::tie;
pub(crate) use week::{Week, WeekCount, redate_weeks};
pub(crate) use wrap::{TOLERATED, unwrap};
