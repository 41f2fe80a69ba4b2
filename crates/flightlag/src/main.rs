//! The command: converts the command line to calls of the other crates, and their findings to text.

mod aircraft;
mod arguments;
mod bench_command;
mod campaign_command;
mod compensator;
mod criteria;
mod delay_command;
mod demo;
mod diff_command;
mod explain;
mod export;
mod failure;
mod files;
mod findings;
mod gc;
mod heap;
mod history_command;
mod inspect;
mod listen;
mod manual;
mod maps;
mod nightly_command;
mod query_command;
mod recover;
mod schema;
mod show;
mod stop;

use crate::arguments::{Arguments, Command};
use crate::failure::{End, Failure};
use campaign::Exit;
use clap::Parser;
use std::process::ExitCode;

fn main() -> ExitCode {
    heap::return_large_blocks();
    let arguments = Arguments::parse();
    campaign::quiet_caught_panics();
    match run(arguments.command) {
        Ok(exit) => exit.into(),
        Err(failure) => failure.report(),
    }
}

fn run(command: Command) -> Result<End, Failure> {
    let deaf = |e| Failure::new(Exit::Failed, format!("cannot listen for signals: {e}"));
    let stop = stop::Stop::listen().map_err(deaf)?;
    match command {
        Command::Delay(arguments) => delay_command::run(&arguments, &stop),
        Command::Campaign(arguments) => campaign_command::run(*arguments, &stop),
        Command::Gc(arguments) => gc::run(&arguments, &stop),
        Command::Bench(arguments) => bench_command::run(&arguments, &stop),
        Command::Nightly(arguments) => nightly_command::run(&arguments, &stop),
        Command::History(arguments) => history_command::history(&arguments),
        Command::Trend(arguments) => history_command::trend_over(&arguments),
        Command::Query(arguments) => query_command::run(&arguments),
        Command::Diff(arguments) => diff_command::run(&arguments, &stop),
        Command::Inspect(arguments) => inspect::run(&arguments, &stop),
        Command::Recover(arguments) => recover::run(&arguments, &stop),
        Command::Export(arguments) => export::run(&arguments, &stop),
        Command::Demo(arguments) => demo::run(&arguments, &stop),
        Command::Compensator(arguments) => compensator::run(&arguments),
        Command::Criteria(arguments) => criteria::run(&arguments),
        Command::Explain(arguments) => explain::run(&arguments),
        Command::Maps(arguments) => maps::run(&arguments, &stop),
        Command::Schema(arguments) => schema::run(&arguments),
        Command::Completions(arguments) => manual::completions(&arguments),
        Command::Man(arguments) => manual::man(&arguments),
    }
}
