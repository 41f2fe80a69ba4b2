//! `flightlag gc`: removes results that no report refers to.

use crate::arguments::GcArguments;
use crate::failure::{End, Failure};
use crate::show::{bytes, count};
use crate::stop::Stop;
use campaign::{Event, Exit, Garbage, RunContext, gc};
use std::io::Write;

pub(crate) fn run(arguments: &GcArguments, stop: &Stop) -> Result<End, Failure> {
    let context = RunContext { threads: 1, cancel: stop.flag(), events: &|_: &Event| {} };
    let garbage = gc(&arguments.out, arguments.dry_run, &context)?;
    writeln!(std::io::stdout(), "{}", line(&garbage, arguments.dry_run))?;
    Ok(Exit::Well.into())
}

fn line(Garbage { results, bytes: size, kept }: &Garbage, dry_run: bool) -> String {
    let done = if dry_run { "would remove" } else { "removed" };
    let results = count(*results as u64, "result");
    format!("{done} {results} that no report refers to, {}; {} kept", bytes(*size), count(*kept as u64, "result"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_shows_what_was_removed_and_what_was_kept() {
        let garbage = Garbage { results: 1, bytes: 2048, kept: 12 };
        assert!(
            line(&garbage, true).starts_with("would remove 1 result that no report refers to, 2"),
            "{}",
            line(&garbage, true)
        );
        assert!(
            line(&garbage, false).starts_with("removed 1 result") && line(&garbage, false).ends_with("12 results kept")
        );
    }
}
