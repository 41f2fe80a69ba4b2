//! One file, whole or not at all.

use crate::error::ConvertError;
use std::fs::File;
use std::path::Path;
use tempfile::NamedTempFile;

/// A file on the way to its name: gone if it is dropped before.
pub(crate) struct Output<'p> {
    path: &'p Path,
    temporary: NamedTempFile,
}

impl<'p> Output<'p> {
    /// Begins a file beside its final place.
    pub(crate) fn begin(path: &'p Path) -> Result<Output<'p>, ConvertError> {
        let folder = path.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let temporary = tempfile::Builder::new()
            .prefix(".flightlag-")
            .suffix(".flightlag-tmp")
            .tempfile_in(folder)
            .map_err(ConvertError::write(folder, "write to this folder"))?;
        Ok(Output { path, temporary })
    }

    /// A handle to write through.
    pub(crate) fn file(&self) -> Result<File, ConvertError> {
        self.temporary.reopen().map_err(ConvertError::write(self.path, "open"))
    }

    /// Where the bytes are for now.
    pub(crate) fn written(&self) -> &Path {
        self.temporary.path()
    }

    /// Syncs and renames. The file gets the rights that any new file of this user gets.
    pub(crate) fn keep(self) -> Result<(), ConvertError> {
        let failed = |doing| ConvertError::write(self.path, doing);
        self.temporary.as_file().sync_all().map_err(failed("sync"))?;
        let usual = usual_rights(self.path).map_err(failed("find the usual rights of"))?;
        self.temporary.as_file().set_permissions(usual).map_err(failed("set the rights of"))?;
        self.temporary.persist(self.path).map(drop).map_err(|e| ConvertError::write(self.path, "rename to")(e.error))
    }
}

/// A temporary file is for its owner alone; the final one is as the user's mask has it.
fn usual_rights(path: &Path) -> std::io::Result<std::fs::Permissions> {
    let folder = path.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let probe = folder.join(format!(".flightlag-{}.probe.flightlag-tmp", std::process::id()));
    let rights = File::create(&probe)?.metadata()?.permissions();
    std::fs::remove_file(&probe)?;
    Ok(rights)
}
