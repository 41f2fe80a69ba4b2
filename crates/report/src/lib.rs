//! Turns records into pages for people to read.
//!
//! [`flight_site`], [`campaign_site`], [`bench_site`], [`card_site`] and [`cards_site`]
//! turn a record into a [`Site`], a map from path to bytes. This crate opens and measures nothing: a page can be
//! rebuilt from the record alone years later, and the same record gives the same bytes. Pages are self-contained
//! (no external requests) and readable without scripts. Text from a log is always escaped.
//!
//! Internally, `figure` turns curves into figures (data only), `draw` turns figures into SVG (the only file that uses
//! plotters), and `page` adds the numbers.
//!
//! ```
//! # use record::*;
//! let record = CampaignRecord {
//!     record_version: RECORD_VERSION,
//!     analysis_version: 1,
//!     flightlag_version: "0.1.0".into(),
//!     name: "Goheung, <autumn>".into(),
//!     pipeline: PipelineUse { title: "replay".into(), blake3: "00".into(), toml: String::new() },
//!     command: "flightlag campaign flights".into(),
//!     criteria: None,
//!     test: None,
//!     flights: vec![],
//!     groups: vec![],
//!     ignored: vec![],
//!     totals: CampaignTotals::default(),
//! };
//! let site = report::campaign_site(&record, &[]);
//! let page = String::from_utf8_lossy(&site.files["index.html"]);
//! assert!(page.contains("Goheung, &lt;autumn&gt;"));
//! ```

mod criterion;
mod draw;
mod figure;
mod number;
mod page;
mod site;
mod text;
mod verdict;

pub use criterion::criterion_sentence;
pub use page::{
    BenchPage, CardPage, CardRecord, FlightPage, IndexedCard, REPORTS_TITLE, ReportEntry, TABLE_FOLDER, TrackExcerpt,
    WithoutMean, bench_site, campaign_site, card_site, cards_site, changes_site, diff_site, excerpt_flights,
    flight_site, night_site, reports_page, trend_site,
};
pub use site::Site;

/// Version of the pages: incremented by hand when the same record gives different bytes.
pub const REPORT_VERSION: u32 = 23;
