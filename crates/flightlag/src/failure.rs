//! How the command ends.

use crate::show::visible;
use campaign::{CampaignError, Exit};
use std::io::Write;
use std::process::ExitCode;

/// An exit code.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct End(Exit);

impl From<Exit> for End {
    fn from(exit: Exit) -> End {
        End(exit)
    }
}

impl From<End> for ExitCode {
    fn from(end: End) -> ExitCode {
        ExitCode::from(end.0 as u8)
    }
}

/// Why the command failed; printed once, on standard error.
#[derive(Debug)]
pub(crate) struct Failure {
    exit: Exit,
    text: String,
}

impl Failure {
    pub(crate) fn new(exit: Exit, text: impl Into<String>) -> Failure {
        Failure { exit, text: text.into() }
    }

    /// Prints it, and returns the exit code.
    pub(crate) fn report(self) -> ExitCode {
        if !self.text.is_empty() {
            // If standard error is closed too, the message cannot be shown.
            let text: Vec<String> = self.text.lines().map(visible).collect();
            let _ = writeln!(std::io::stderr(), "flightlag: {}", text.join("\n"));
        }
        ExitCode::from(self.exit as u8)
    }
}

impl From<CampaignError> for Failure {
    fn from(error: CampaignError) -> Failure {
        // SIGTERM and SIGHUP come from a machine that may restart us.
        let exit = match error.exit() {
            Exit::Stopped => crate::stop::exit_of_last_signal(),
            exit => exit,
        };
        Failure::new(exit, error.to_string())
    }
}

impl From<history::HistoryError> for Failure {
    fn from(error: history::HistoryError) -> Failure {
        match error {
            history::HistoryError::Campaign(error) => error.into(),
            other => Failure::new(other.exit(), other.to_string()),
        }
    }
}

impl From<ingest::IngestError> for Failure {
    fn from(error: ingest::IngestError) -> Failure {
        CampaignError::from(error).into()
    }
}

impl From<std::io::Error> for Failure {
    /// Standard output cannot be written. If its reader has closed it, as `head` does, that is not a failure.
    fn from(error: std::io::Error) -> Failure {
        match error.kind() {
            std::io::ErrorKind::BrokenPipe => Failure::new(Exit::Well, ""),
            _ => Failure::new(Exit::Failed, format!("standard output: {error}")),
        }
    }
}
