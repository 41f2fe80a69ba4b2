//! JSON schemas that the command prints, and pages of the book whose tables explain words.

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

/// Pages with tables of words and their meanings.
pub const WORDS: [&str; 3] =
    [include_str!("src/science/varying.md"), include_str!("src/campaigns.md"), include_str!("src/glossary.md")];
