//! `flightlag nightly`: every campaign of a night, the history, and the morning page.

use crate::arguments::NightlyArguments;
use crate::campaign_command::{desk, say};
use crate::failure::{End, Failure};
use crate::listen::listener;
use crate::stop::Stop;
use history::{NightlyConfig, nightly};

pub(crate) fn run(arguments: &NightlyArguments, stop: &Stop) -> Result<End, Failure> {
    let config = NightlyConfig::read(&arguments.config)?;
    let events = listener(&arguments.desk);
    let night = nightly(&config, &desk(&arguments.desk, stop, events.as_ref()))?;
    for line in &night.record.summary {
        say(&arguments.desk, line)?;
    }
    for error in night.errors() {
        say(&arguments.desk, &error)?;
    }
    say(&arguments.desk, &format!("open {}", night.page.display()))?;
    Ok(night.exit.into())
}
