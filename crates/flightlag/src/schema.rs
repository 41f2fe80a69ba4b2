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

    #[test]
    fn every_schema_of_the_repository_can_be_written_out() {
        let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        for of in SchemaOf::value_variants() {
            let name = of.to_possible_value().unwrap().get_name().to_owned();
            let folder = match of {
                SchemaOf::Pipeline | SchemaOf::Criteria | SchemaOf::Rig | SchemaOf::Card | SchemaOf::TestCard => {
                    "pipelines"
                }
                SchemaOf::ChannelMap => "pipelines/channel-maps",
                _ => "docs",
            };
            let file = root.join(folder).join(format!("{name}.schema.json"));
            assert_eq!(text(*of), std::fs::read_to_string(file).unwrap(), "{name}");
        }
    }
}
