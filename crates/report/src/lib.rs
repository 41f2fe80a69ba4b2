//! Records to pages: what was found, for people to read.
//!
//! [`flight_site`], [`campaign_site`], [`bench_site`], [`card_site`], [`cards_site`] and [`monte_carlo_site`]
//! turn a record into a [`Site`], a map from path to bytes. Nothing is opened, asked or measured here: a page can be made again years later
//! from the record alone, and the same record gives the same bytes. Pages are self-contained
//! (no outside request), readable without script, and text from a log is never markup.
//!
//! Inside, a curve becomes a figure (`figure`, data only), the figure becomes SVG (`draw`,
//! the one file that knows plotters), and `page` puts the numbers beside it.
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
    flight_site, monte_carlo_site, night_site, reports_page, trend_site,
};
pub use site::Site;

/// Version of the pages: raised by hand when the same record gives other bytes.
pub const REPORT_VERSION: u32 = 12;
