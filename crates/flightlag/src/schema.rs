//! `flightlag schema`: JSON schemas of settings files and of machine-readable output, for editors and programs.

use crate::arguments::{SchemaArguments, SchemaOf};
use crate::failure::{End, Failure};
use campaign::Exit;
use std::io::Write;

pub(crate) fn run(arguments: &SchemaArguments) -> Result<End, Failure> {
    write!(std::io::stdout(), "{}", text(arguments.of))?;
    Ok(Exit::Well.into())
}

fn text(of: SchemaOf) -> &'static str {
    match of {
        SchemaOf::Pipeline => pipelines::PIPELINE_SCHEMA,
        SchemaOf::Criteria => pipelines::CRITERIA_SCHEMA,
        SchemaOf::Rig => pipelines::RIG_SCHEMA,
        SchemaOf::Card => pipelines::CARD_SCHEMA,
        SchemaOf::ChannelMap => pipelines::CHANNEL_MAP_SCHEMA,
        SchemaOf::TestCard => pipelines::TEST_CARD_SCHEMA,
        SchemaOf::Nightly => pipelines::NIGHTLY_SCHEMA,
        SchemaOf::Fleet => pipelines::FLEET_SCHEMA,
        SchemaOf::Delay => docs::DELAY_SCHEMA,
        SchemaOf::Record => docs::RECORD_SCHEMA,
        SchemaOf::BenchRecord => docs::BENCH_RECORD_SCHEMA,
        SchemaOf::Campaign => docs::CAMPAIGN_SCHEMA,
        SchemaOf::Events => docs::EVENTS_SCHEMA,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    /// Names of all properties below a schema.
    fn keys_of(schema: &serde_json::Value, keys: &mut BTreeSet<String>) {
        if let Some(properties) = schema.get("properties").and_then(|p| p.as_object()) {
            keys.extend(properties.keys().cloned());
        }
        match schema {
            serde_json::Value::Object(parts) => parts.values().for_each(|part| keys_of(part, keys)),
            serde_json::Value::Array(parts) => parts.iter().for_each(|part| keys_of(part, keys)),
            _ => {}
        }
    }

    /// Whether a text sets a key, in a comment or not: `key = `, `[key]`, `[[a.key]]`.
    fn explains(text: &str, key: &str) -> bool {
        let names = |line: &str| -> bool {
            let is_part = |c: char| c.is_ascii_alphanumeric() || "_-".contains(c);
            let begins = |at: usize| !line[..at].ends_with(is_part);
            line.match_indices(key).filter(|(at, _)| begins(*at)).any(|(at, _)| {
                let rest = &line[at + key.len()..];
                rest.starts_with(" = ") || (line.contains('[') && rest.starts_with(']'))
            })
        };
        text.lines().any(names)
    }

    #[test]
    fn every_schema_key_is_explained_in_the_commented_example() {
        for (of, example) in [
            (SchemaOf::Pipeline, pipelines::DEFAULT_PIPELINE),
            (SchemaOf::Criteria, pipelines::EXAMPLE_CRITERIA),
            (SchemaOf::Rig, pipelines::DEFAULT_RIG),
            (SchemaOf::ChannelMap, pipelines::EXAMPLE_MAP),
            (SchemaOf::Nightly, pipelines::EXAMPLE_NIGHTLY),
            (SchemaOf::Fleet, pipelines::EXAMPLE_FLEET),
        ] {
            let mut keys = BTreeSet::new();
            keys_of(&serde_json::from_str(text(of)).unwrap(), &mut keys);
            let missing: Vec<&String> = keys.iter().filter(|key| !explains(example, key)).collect();
            assert!(keys.len() > 5 && missing.is_empty(), "{of:?}: {missing:?} of {} keys", keys.len());
        }
        assert!(!explains("positions = 1\n# a position of", "position"));
    }
}
