//! One run at a time on an output folder.

use crate::error::CampaignError;
use crate::event::Event;
use crate::plan::Desk;
use crate::process::host_name;
use crate::store::Store;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Read, Seek, Write};

/// The lock's file; it also marks the folder as one of ours.
pub(crate) const LOCK: &str = ".flightlag/lock";

/// Held while a run or a reduce is at work. The system lets go of it when the process ends,
/// however it ends, so that there is no stale lock.
#[derive(Debug)]
pub(crate) struct OutputLock {
    _file: File,
}

impl OutputLock {
    /// Takes the lock, or says who has it.
    pub(crate) fn take(store: &Store, desk: &Desk<'_>) -> Result<OutputLock, CampaignError> {
        let path = store.path(LOCK)?;
        let failed = |doing| move |source| crate::store::StoreError { path: path.clone(), doing, source };
        let folder = store.path(".flightlag")?;
        std::fs::create_dir_all(&folder).map_err(failed.clone()("make the folder of"))?;
        let open = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(store.path(LOCK)?);
        let mut file = open.map_err(failed.clone()("open"))?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                return Err(CampaignError::Busy { out: store.root().to_owned(), owner: owner(&mut file) });
            }
            Err(TryLockError::Error(e)) => {
                let text = format!("this file system knows no locks ({e}): do not start a second run on this folder");
                desk.tell(Event::Remark { text });
            }
        }
        sign(&mut file).map_err(failed("write"))?;
        Ok(OutputLock { _file: file })
    }
}

fn sign(file: &mut File) -> std::io::Result<()> {
    file.set_len(0)?;
    file.rewind()?;
    writeln!(file, "process {} on {}", std::process::id(), host_name())
}

fn owner(file: &mut File) -> String {
    let mut text = String::new();
    let _ = file.take(200).read_to_string(&mut text);
    let line = text.lines().next().unwrap_or_default().trim().to_owned();
    if line.is_empty() { "its process is not known".to_owned() } else { line }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_run_is_refused_with_the_owner_and_may_start_when_the_first_has_ended() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        let cancel = std::sync::atomic::AtomicBool::new(false);
        let desk = Desk { threads: 1, cancel: &cancel, events: &|_: &Event| {} };
        let first = OutputLock::take(&store, &desk).unwrap();
        let refusal = OutputLock::take(&store, &desk).unwrap_err().to_string();
        assert!(refusal.contains(&format!("process {} on", std::process::id())), "{refusal}");
        drop(first);
        OutputLock::take(&store, &desk).unwrap();
    }
}
