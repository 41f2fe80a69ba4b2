//! Pages that a command writes itself.

use crate::failure::Failure;
use campaign::Exit;
use report::Site;
use std::path::Path;

/// Writes the files of a site and some texts to a folder, each to a temporary name first. A folder with anything other
/// than an earlier page of the same kind is rejected: the first of the texts is the marker of that kind.
pub(crate) fn write_site(out: &Path, site: &Site, texts: &[(&str, &str)]) -> Result<(), Failure> {
    let holds_page = out.join("index.html").exists();
    if let Some((mark, _)) = texts.first().filter(|(mark, _)| holds_page && !out.join(mark).exists()) {
        let what = format!(
            "{}: already holds another page (it has an index.html, but no {mark}); give an empty or new folder",
            out.display()
        );
        return Err(Failure::new(Exit::Wrong, what));
    }
    let texts = texts.iter().map(|(name, text)| (*name, text.as_bytes()));
    // The page last: if it exists, it is complete.
    let pages = site.to_write();
    let mut files: Vec<(&str, &[u8])> =
        texts.chain(pages.iter().map(|(name, bytes)| (*name, bytes.as_ref()))).collect();
    files.sort_by_key(|(name, _)| *name == "index.html");
    for (name, bytes) in files {
        history::write_file(&out.join(name), bytes)?;
    }
    Ok(())
}
