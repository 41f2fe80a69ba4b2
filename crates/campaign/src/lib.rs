//! Analysis of many flights on many cores: which results exist, which to make, and why.
//!
//! [`run`] plans, makes the missing results, and reduces them to tables and pages. A cluster can
//! do the same three steps: [`plan_shards`], [`task`] for each shard, [`reduce`]; [`status`]
//! shows the progress.
//!
//! A result is named by what it depends on: content and names of the log's files, the resolved
//! settings, the channel maps, and the versions of analysis and records. So an existing result
//! is correct, whoever made it and when; no other file marks it as done.
//! Time of day, host and durations are only in `run.json`. State of this machine that saves
//! time is in `.flightlag/`. All other bytes follow from logs, settings and build.
//!
//! ```
//! use campaign::Pipeline;
//! use std::path::Path;
//! let text = "schema = 1\n[delay]\nposition_s = 0.4\nsource = \"bench\"\nwindow = 3\n";
//! let error = Pipeline::parse(text, Path::new("mine.toml")).unwrap_err();
//! assert!(error.to_string().starts_with("mine.toml:5: unknown key `window`"));
//! ```

mod answer;
mod bench;
#[cfg(test)]
mod card_tests;
mod cards;
mod changes;
mod config;
mod criteria;
mod decide;
mod delay;
mod delay_report;
mod details;
mod disk;
#[cfg(test)]
mod engine_tests;
mod error;
mod event;
mod fetch;
mod file_stamp;
mod filter_values;
mod gc;
mod group;
mod known_lateness;
mod lever;
mod line;
mod lock;
mod logs;
mod losses;
mod manifest;
mod memory;
mod no_position;
pub mod pattern;
mod plan;
mod points;
mod process;
mod rate;
mod reduce;
mod reference;
mod reference_rule;
mod reports;
mod results;
mod rows;
mod run;
mod run_context;
mod s3;
#[cfg(feature = "schema")]
mod schemas;
mod sketch;
mod slug;
mod source;
mod state;
mod status;
mod store;
mod study;
mod table;
mod task;
mod test_cards;
mod work;

pub use bench::{BENCH_ANALYSIS_VERSION, BenchOrder, BenchRow, BenchVerdict, bench_index, bench_run};
pub use changes::moved_groups;
pub use compensation_replay::{ClockRule, error_words};
pub use config::{DEFAULT_PIPELINE, DEMO_PIPELINE, Pipeline};
pub use criteria::{Criteria, DEMO_CRITERIA, Dimension, EXAMPLE_CRITERIA, METRICS, MetricEntry, Takes};
pub use delay_report::{DelayOrder, DelayReport, GroupLine, delay_report};
pub use disk::may_heal;
pub use error::{CampaignError, Exit, STILL_WRITTEN, StoreError};
pub use event::{Event, EventSink};
pub use fetch::{LogCache, keep_logs_in};
pub use gc::{Garbage, gc};
pub use group::{content_of, duplicates, fingerprint, group_of, receiver_number, shared_content, usual_rate_hz};
pub use line::{DelayLine, LineAlarm, LineSetting};
pub use manifest::{Manifest, Stage, Why};
pub use plan::{EMPTY_FOLDER, Order};
pub use reduce::{Verdict, reduce};
pub use results::record_of_page;
pub use rows::read_report;
pub use run::{plan_shards, run};
pub use run_context::RunContext;
pub use s3::is_in_bucket;
#[cfg(feature = "schema")]
pub use schemas::schemas;
pub use settings::SettingsError;
pub use status::{Status, Trouble, status};
pub use task::{TaskReport, quiet_caught_panics, task};

/// Raised by hand when reading, binding or replaying a flight gives different results: earlier results are then made
/// again. The build's own hash is not part of a result's key, because most code changes affect no number.
pub const ANALYSIS_VERSION: u32 = 46;
