//! JSON schemas of settings files and of machine-readable output, generated from the types.

use crate::event::Event;
use record::{BenchRecord, CampaignRecord, FlightRecord};
use schemars::JsonSchema;
use schemars::generate::SchemaSettings;

/// Every schema of this crate and its dependencies, with its file in the repository.
#[must_use]
pub fn schemas() -> Vec<(&'static str, String)> {
    vec![
        ("docs/record.schema.json", written::<FlightRecord>("flightlag: record.json of a flight")),
        ("docs/bench-record.schema.json", written::<BenchRecord>("flightlag: record.json of a bench record")),
        ("docs/campaign.schema.json", written::<CampaignRecord>("flightlag: campaign.json")),
        ("docs/events.schema.json", written::<Event>("flightlag: a line of --json")),
        ("docs/delay.schema.json", crate::delay_report::delay_schema()),
        ("pipelines/pipeline.schema.json", crate::config::pipeline_schema()),
        ("pipelines/criteria.schema.json", crate::criteria::criteria_schema()),
        ("pipelines/test-card.schema.json", crate::test_cards::test_card_schema()),
        ("pipelines/rig.schema.json", bench_analysis::rig_schema()),
        ("pipelines/card.schema.json", bench_analysis::card_schema()),
        ("pipelines/channel-maps/channel-map.schema.json", ingest::channel_map_schema()),
    ]
}

/// The schema for serialization, not for deserialization: a field that is always written is required.
fn written<T: JsonSchema>(title: &str) -> String {
    let mut schema = SchemaSettings::draft2020_12().for_serialize().into_generator().into_root_schema_for::<T>();
    schema.insert("title".to_owned(), title.into());
    format!("{:#}\n", schema.as_value())
}
