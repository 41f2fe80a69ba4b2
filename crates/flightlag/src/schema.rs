//! `flightlag schema`: the JSON schemas of settings files and of what programs read, for editors and programs.

use crate::arguments::{SchemaArguments, SchemaOf};
use crate::failure::{End, Failure};
use campaign::Exit;
use std::io::Write;

pub(crate) fn run(arguments: &SchemaArguments) -> Result<End, Failure> {
    write!(std::io::stdout(), "{}", text(arguments.of))?;
    Ok(Exit::Well.into())
}

fn text(of: SchemaOf) -> String {
    match of {
        SchemaOf::Pipeline => campaign::pipeline_schema(),
        SchemaOf::Criteria => campaign::criteria_schema(),
        SchemaOf::Rig => campaign::rig_schema(),
        SchemaOf::Card => campaign::card_schema(),
        SchemaOf::ChannelMap => ingest::channel_map_schema(),
        SchemaOf::TestCard => campaign::test_card_schema(),
        SchemaOf::Nightly => history::nightly_schema(),
        SchemaOf::Fleet => history::fleet_schema(),
        SchemaOf::Delay => campaign::delay_schema(),
        SchemaOf::Record => campaign::record_schema(),
        SchemaOf::BenchRecord => campaign::bench_record_schema(),
        SchemaOf::Campaign => campaign::campaign_schema(),
        SchemaOf::Events => campaign::events_schema(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::ValueEnum;
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

    /// Whether a text gives a value to a key, in a comment or not: `key = `, `[key]`, `[[a.key]]`.
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
    fn every_key_of_every_schema_is_explained_in_the_commented_example() {
        let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let rig = std::fs::read_to_string(root.join("pipelines/bench.rig.toml")).unwrap();
        for (of, example) in [
            (SchemaOf::Pipeline, campaign::DEFAULT_PIPELINE),
            (SchemaOf::Criteria, campaign::EXAMPLE_CRITERIA),
            (SchemaOf::Rig, rig.as_str()),
            (SchemaOf::ChannelMap, ingest::EXAMPLE_MAP),
            (SchemaOf::Nightly, history::EXAMPLE_NIGHTLY),
            (SchemaOf::Fleet, history::EXAMPLE_FLEET),
        ] {
            let mut keys = BTreeSet::new();
            keys_of(&serde_json::from_str(&text(of)).unwrap(), &mut keys);
            let missing: Vec<&String> = keys.iter().filter(|key| !explains(example, key)).collect();
            assert!(keys.len() > 5 && missing.is_empty(), "{of:?}: {missing:?} of {} keys", keys.len());
        }
        assert!(!explains("positions = 1\n# a position of", "position"));
    }

    #[test]
    fn every_schema_of_the_repository_can_be_written_out() {
        let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        for of in SchemaOf::value_variants() {
            let name = of.to_possible_value().unwrap().get_name().to_owned();
            let folder = match of {
                SchemaOf::Pipeline | SchemaOf::Criteria | SchemaOf::Rig | SchemaOf::Card | SchemaOf::TestCard => {
                    "pipelines"
                }
                SchemaOf::Nightly | SchemaOf::Fleet => "pipelines/nightly",
                SchemaOf::ChannelMap => "pipelines/channel-maps",
                _ => "docs",
            };
            let file = root.join(folder).join(format!("{name}.schema.json"));
            assert_eq!(text(*of), std::fs::read_to_string(file).unwrap(), "{name}");
        }
    }
}
