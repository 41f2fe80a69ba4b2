//! The JSON schemas of what flightlag writes for programs.

use crate::event::Event;
use record::{BenchRecord, CampaignRecord, FlightRecord};
use schemars::JsonSchema;
use schemars::generate::SchemaSettings;

/// The schema of the `record.json` of a flight, as text.
#[must_use]
pub fn record_schema() -> String {
    schema::<FlightRecord>("flightlag: record.json of a flight")
}

/// The schema of the `record.json` of a bench record, as text.
#[must_use]
pub fn bench_record_schema() -> String {
    schema::<BenchRecord>("flightlag: record.json of a bench record")
}

/// The schema of `campaign.json`, as text.
#[must_use]
pub fn campaign_schema() -> String {
    schema::<CampaignRecord>("flightlag: campaign.json")
}

/// The schema of each line of `--json` of `campaign`, `bench` and `demo`, as text.
#[must_use]
pub fn events_schema() -> String {
    schema::<Event>("flightlag: a line of --json")
}

/// As values are written, not as they are read: a field that is always there is required.
fn schema<T: JsonSchema>(title: &str) -> String {
    let mut schema = SchemaSettings::draft2020_12().for_serialize().into_generator().into_root_schema_for::<T>();
    schema.insert("title".to_owned(), title.into());
    format!("{:#}\n", schema.as_value())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `FLIGHTLAG_BLESS=1` writes them again.
    #[test]
    fn the_published_schemas_are_those_of_what_is_written() {
        let docs = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs");
        for (name, text) in [
            ("record", record_schema()),
            ("bench-record", bench_record_schema()),
            ("campaign", campaign_schema()),
            ("events", events_schema()),
        ] {
            let file = docs.join(format!("{name}.schema.json"));
            if std::env::var_os("FLIGHTLAG_BLESS").is_some() {
                std::fs::write(&file, &text).unwrap();
            }
            assert_eq!(std::fs::read_to_string(&file).unwrap(), text, "{name}: accept a change with `just bless`");
        }
    }
}
