//! `flightlag recover`: writes everything recoverable from a damaged log.

use crate::arguments::RecoverArguments;
use crate::failure::{End, Failure};
use crate::findings::{damage, notices, section};
use crate::inspect::unit_of;
use crate::maps::library;
use crate::show::{Table, bytes, count, visible};
use crate::stop::Stop;
use campaign::Exit;
use convert::{ConvertError, How, Recovered, recover};
use ingest::{Limits, ReadContext};
use std::io::Write;
use std::path::Path;

/// Maximum number of topics listed although all of their messages were written.
const MOST_TOPICS: usize = 60;

pub(crate) fn run(arguments: &RecoverArguments, stop: &Stop) -> Result<End, Failure> {
    check_output(&arguments.out, Output::File, arguments.force)?;
    let library = library(None)?;
    let unit = unit_of(&arguments.log, &library)?;
    let context = ReadContext { limits: Limits::default(), cancel: stop.flag(), on_bytes: &|_| {} };
    let recovered = recover(&unit, &library, &arguments.out, &context)?;
    std::io::stdout().lock().write_all(page(&arguments.out, &recovered).as_bytes())?;
    Ok(if recovered.any_loss() { Exit::Incomplete } else { Exit::Well }.into())
}

/// Kind of output of a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Output {
    File,
    /// A folder with files.
    Folder,
}

/// Checks before any work whether `out` can be the output. An existing one is not overwritten unless `force`.
pub(crate) fn check_output(out: &Path, output: Output, force: bool) -> Result<(), Failure> {
    let wrong = |what: &str| Err(Failure::new(Exit::Wrong, format!("{} {what}", out.display())));
    let folder = out.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."));
    match output {
        _ if is_special(out) => wrong("is a device, a pipe or a socket; name a file or a folder"),
        Output::File if out.is_dir() => wrong("is a folder; name the file to write"),
        Output::Folder if out.exists() && !out.is_dir() => wrong("is a file; name a folder for the tables"),
        _ if out.exists() && !force => wrong("exists; add --force to overwrite it"),
        Output::File if !folder.is_dir() => wrong("cannot be written: there is no such folder"),
        _ => Ok(()),
    }
}

/// Neither file nor folder, with links resolved.
fn is_special(path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|about| !about.is_file() && !about.is_dir())
}

impl From<ConvertError> for Failure {
    fn from(error: ConvertError) -> Failure {
        match error {
            ConvertError::Log(error) => error.into(),
            error @ ConvertError::Refused { .. } => Failure::new(Exit::Wrong, error.to_string()),
            error => Failure::new(Exit::Failed, error.to_string()),
        }
    }
}

fn page(out: &Path, recovered: &Recovered) -> String {
    let written = recovered.topics.iter().map(|t| t.written).sum();
    let how = match recovered.how {
        How::Copied => "copied byte for byte",
        How::Rewritten => "rewritten as typed tables",
    };
    let b = &recovered.health.bytes;
    let head = format!(
        "{}: {}, {}, {how}, read back and equal\n  from {}, {} of {} bytes damaged\n",
        visible(&out.display().to_string()),
        bytes(recovered.bytes),
        count(written, "message"),
        visible(&recovered.health.format),
        b.damaged,
        b.size,
    );
    let parts = [head, topics(recovered), extras(recovered), damage(&recovered.health), notices(&recovered.notices)];
    let parts: Vec<String> = parts.into_iter().filter(|p| !p.is_empty()).collect();
    parts.join("\n")
}

fn topics(recovered: &Recovered) -> String {
    let mut table = Table::new(&["topic", "found|", "written|"]);
    let many = recovered.topics.len() > MOST_TOPICS;
    let (whole, short): (Vec<_>, Vec<_>) = recovered.topics.iter().partition(|t| t.found == t.written);
    let listed = short.iter().chain(if many { &[] } else { whole.as_slice() });
    for topic in listed {
        table.row(vec![topic.name.clone(), topic.found.to_string(), topic.written.to_string()]);
    }
    let mut text = section("topics", &table);
    if many {
        text += &format!("{} topics with every message that was found\n", whole.len());
    }
    text
}

fn extras(recovered: &Recovered) -> String {
    let mut table = Table::new(&["besides the messages", "written|"]);
    for extra in &recovered.extras {
        table.row(vec![extra.what.clone(), extra.count.to_string()]);
    }
    if table.is_empty() { String::new() } else { table.text() }
}
