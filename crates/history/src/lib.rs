//! Campaigns over many nights.
//!
//! A [`History`] is a folder of Parquet files, one for each run. A run adds one [`Row`] for each flight whose finding
//! is new or changed. Each row has two time axes: when the flight was flown and when the run took place. [`collect`]
//! makes the rows from the report of a campaign. A [`Fleet`] file supplies identities that a log does not state.
//!
//! ```
//! use history::{History, Row, Run};
//! let folder = tempfile::tempdir()?;
//! let history = History::new(folder.path());
//! let run = Run::at("2026-11-25T22:00:00Z".parse()?);
//! let row = Row { run_id: run.id.clone(), run_ns: run.start_ns, campaign: "may".into(), flight: "1.bin".into(), ..Row::default() };
//! history.append(&run, &[row])?;
//! assert_eq!(history.latest("may", &["1.bin"].into())?.len(), 1);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#[cfg(feature = "query")]
mod answer;
mod brief;
mod change_points;
mod collect;
mod compare;
mod config;
mod dataset;
mod diff;
mod error;
mod fleet;
mod latency;
mod night;
mod proof;
mod query;
mod row;
mod runs;
mod schema;
mod summary;
mod trend;

#[cfg(feature = "query")]
pub use answer::{Answer, answer};
pub use brief::{Brief, Briefs, PageOf, latest_briefs};
pub use change_points::{FALSE_ALARM, Looks};
pub use collect::{Collecting, collect, read_campaign, texts_of};
pub use compare::{Texts, causes, compare};
pub use config::NightlyConfig;
pub use dataset::{History, Latest, Run, latest_of};
pub use diff::diff;
pub use error::HistoryError;
pub use fleet::{Aircraft, Fleet};
pub use latency::{LatencyLine, latency};
pub use night::{Night, nightly, write_file};
pub use proof::proofs;
pub use query::Query;
pub use row::{COLUMNS, Dimension, Row};
pub use runs::{RunLine, runs};
pub use schema::HISTORY_SCHEMA;
pub use trend::{Trend, new_changes, trend};

/// The JSON schemas of the files of a night, with their files in the repository.
#[cfg(feature = "schema")]
#[must_use]
pub fn schemas() -> Vec<(&'static str, String)> {
    vec![
        ("pipelines/nightly/nightly.schema.json", config::nightly_schema()),
        ("pipelines/nightly/fleet.schema.json", fleet::fleet_schema()),
    ]
}
