//! `flightlag nightly`: every campaign of a night, the history, and the morning page.

use crate::arguments::NightlyArguments;
use crate::campaign_command::{run_context, say};
use crate::failure::{End, Failure};
use crate::listen::listener;
use crate::stop::Stop;
use history::{NightlyConfig, nightly};

pub(crate) fn run(arguments: &NightlyArguments, stop: &Stop) -> Result<End, Failure> {
    let config = NightlyConfig::read(&arguments.config)?;
    let events = listener(&arguments.common);
    let night = nightly(&config, &run_context(&arguments.common, stop, events.as_ref()))?;
    for line in &night.record.summary {
        say(&arguments.common, line)?;
    }
    for error in night.errors() {
        say(&arguments.common, &error)?;
    }
    say(&arguments.common, &format!("open {}", night.page.display()))?;
    Ok(night.exit.into())
}
