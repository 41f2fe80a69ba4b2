//! Pages of the book and JSON schemas that the command prints: one text for readers of the book and of the terminal.

/// Every code of a notice or an alarm, in tables by part: `flightlag explain` prints its rows.
pub const NOTICES: &str = include_str!("src/notices.md");

/// JSON schema of the `record.json` of a flight.
pub const RECORD_SCHEMA: &str = include_str!("record.schema.json");
/// JSON schema of the `record.json` of a bench record.
pub const BENCH_RECORD_SCHEMA: &str = include_str!("bench-record.schema.json");
/// JSON schema of `campaign.json`.
pub const CAMPAIGN_SCHEMA: &str = include_str!("campaign.schema.json");
/// JSON schema of a line of `--json`.
pub const EVENTS_SCHEMA: &str = include_str!("events.schema.json");
/// JSON schema of `delay --json`.
pub const DELAY_SCHEMA: &str = include_str!("delay.schema.json");
