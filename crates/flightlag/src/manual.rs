//! `flightlag completions` and `flightlag man`: shell completions and manual pages, generated from the help texts.

use crate::arguments::{Arguments, CompletionsArguments, ManArguments};
use crate::failure::{End, Failure};
use campaign::Exit;
use clap::CommandFactory;
use std::io::Write;

const NAME: &str = "flightlag";

pub(crate) fn completions(arguments: &CompletionsArguments) -> Result<End, Failure> {
    let mut script = vec![];
    clap_complete::generate(arguments.shell, &mut Arguments::command(), NAME, &mut script);
    std::io::stdout().write_all(&script)?;
    Ok(Exit::Well.into())
}

pub(crate) fn man(arguments: &ManArguments) -> Result<End, Failure> {
    let folder = &arguments.dir;
    let failed = |e| Failure::new(Exit::Failed, format!("cannot write manual pages to {}: {e}", folder.display()));
    std::fs::create_dir_all(folder)
        .and_then(|()| clap_mangen::generate_to(Arguments::command().name(NAME), folder))
        .map_err(failed)?;
    Ok(Exit::Well.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_command_has_a_man_page() {
        let folder = tempfile::tempdir().unwrap();
        let dir = folder.path().join("man1");
        man(&ManArguments { dir: dir.clone() }).unwrap();
        for command in Arguments::command().get_subcommands() {
            let page = dir.join(format!("{NAME}-{}.1", command.get_name()));
            assert!(std::fs::read_to_string(&page).unwrap().contains(".SH SYNOPSIS"), "{page:?}");
        }
    }
}
