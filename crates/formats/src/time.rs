//! Faults of the clocks of a log, and their ties to UTC.

mod midnight;
mod suspect;
mod tie;
mod week;
mod wrap;

pub use midnight::redate_days;
pub use suspect::suspicion;
pub(crate) use suspect::{SaidDates, Since};
pub use tie::tie;
pub use week::{Week, WeekCount, redate_weeks};
pub use wrap::{TOLERATED, unwrap};
