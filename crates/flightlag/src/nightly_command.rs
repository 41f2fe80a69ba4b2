//! `flightlag nightly`: every campaign of a night, the history, and the morning page.

use crate::arguments::NightlyArguments;
use crate::campaign_command::{run_context, say};
use crate::failure::{End, Failure};
use crate::listen::listener;
use crate::stop::Stop;
use history::{NightlyConfig, nightly};

pub(crate) fn run(arguments: &NightlyArguments, stop: &Stop) -> Result<End, Failure> {
    let config = NightlyConfig::read(&arguments.config)?;
    let events = listener(&arguments.run);
    let night = nightly(&config, &run_context(&arguments.run, stop, events.as_ref()))?;
    for line in &night.record.summary {
        say(&arguments.run, line)?;
    }
    for error in night.errors() {
        say(&arguments.run, &error)?;
    }
    say(&arguments.run, &format!("open {}", night.page.display()))?;
    Ok(night.exit.into())
}
