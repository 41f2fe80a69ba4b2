//! An output file that appears complete or not at all.

use crate::error::ConvertError;
use crate::leftover::{claim, folder_of, is_abandoned, temporaries_of, temporary_name};
use std::fs::{self, File, OpenOptions};
use std::path::{Path, PathBuf};

/// A file under its temporary name: removed if it is dropped before it is kept.
pub(crate) struct Output<'p> {
    path: &'p Path,
    temporary: PathBuf,
    file: File,
    is_kept: bool,
}

impl<'p> Output<'p> {
    /// Creates a file next to its final path, and removes what killed processes left there.
    pub(crate) fn begin(path: &'p Path) -> Result<Output<'p>, ConvertError> {
        let leftovers = temporaries_of(path).into_iter().filter(|file| file.is_file() && is_abandoned(file));
        leftovers.for_each(|file| drop(fs::remove_file(file)));
        let temporary = temporary_name(path);
        let made = OpenOptions::new().read(true).write(true).create_new(true).open(&temporary);
        let file = made.map_err(ConvertError::write(folder_of(path), "write to this folder"))?;
        claim(&file);
        Ok(Output { path, temporary, file, is_kept: false })
    }

    /// A handle to write through.
    pub(crate) fn file(&self) -> Result<File, ConvertError> {
        OpenOptions::new().read(true).write(true).open(&self.temporary).map_err(ConvertError::write(self.path, "open"))
    }

    /// The temporary path.
    pub(crate) fn written(&self) -> &Path {
        &self.temporary
    }

    /// Syncs the file and renames it to its final path.
    pub(crate) fn keep(mut self) -> Result<(), ConvertError> {
        let failed = |doing| ConvertError::write(self.path, doing);
        self.file.sync_all().map_err(failed("sync"))?;
        fs::rename(&self.temporary, self.path).map_err(failed("rename to"))?;
        self.is_kept = true;
        Ok(())
    }
}

impl Drop for Output<'_> {
    fn drop(&mut self) {
        if !self.is_kept {
            let _ = fs::remove_file(&self.temporary);
        }
    }
}
