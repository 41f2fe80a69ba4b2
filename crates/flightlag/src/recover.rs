//! `flightlag recover`: what is good of a damaged log.

use crate::arguments::RecoverArguments;
use crate::failure::{End, Failure};
use crate::inspect::{damage, notices, unit_of};
use crate::maps::library;
use crate::show::{Table, bytes, count, visible};
use crate::stop::Stop;
use campaign::Exit;
use convert::{ConvertError, How, Recovered, recover};
use ingest::{Limits, ReadContext};
use std::io::Write;
use std::path::Path;

pub(crate) fn run(arguments: &RecoverArguments, stop: &Stop) -> Result<End, Failure> {
    refuse_existing(&arguments.out, arguments.force)?;
    let unit = unit_of(&arguments.log, &library(None)?)?;
    let context = ReadContext { limits: Limits::default(), cancel: stop.flag(), on_bytes: &|_| {} };
    let recovered = recover(&unit, &arguments.out, &context)?;
    std::io::stdout().lock().write_all(page(&arguments.out, &recovered).as_bytes())?;
    Ok(if recovered.any_loss() { Exit::Incomplete } else { Exit::Well }.into())
}

/// What is there is not written over unasked.
pub(crate) fn refuse_existing(out: &Path, force: bool) -> Result<(), Failure> {
    if !force && out.exists() {
        return Err(Failure::new(Exit::Wrong, format!("{} is there already; --force writes over it", out.display())));
    }
    Ok(())
}

impl From<ConvertError> for Failure {
    fn from(error: ConvertError) -> Failure {
        match error {
            ConvertError::Log(error) => error.into(),
            error => Failure::new(Exit::Failed, error.to_string()),
        }
    }
}

fn page(out: &Path, recovered: &Recovered) -> String {
    let mut table = Table::new(&["topic", "found|", "written|"]);
    for topic in &recovered.topics {
        table.row(vec![topic.name.clone(), topic.found.to_string(), topic.written.to_string()]);
    }
    let written = recovered.topics.iter().map(|t| t.written).sum();
    let how = match recovered.how {
        How::Copied => "copied byte for byte",
        How::Rewritten => "written anew as typed tables",
    };
    let b = &recovered.health.bytes;
    let head = format!(
        "{}: {}, {}, {how}, read again and found equal\n  from {}, {} of {} bytes damaged\n",
        visible(&out.display().to_string()),
        bytes(recovered.bytes),
        count(written, "message"),
        visible(&recovered.health.format),
        b.damaged,
        b.size,
    );
    let parts = [head, format!("topics\n{}", table.text()), damage(&recovered.health), notices(&recovered.notices)];
    let parts: Vec<String> = parts.into_iter().filter(|p| !p.is_empty()).collect();
    parts.join("\n")
}
