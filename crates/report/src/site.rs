//! A report: files in memory, before they are written.

use crate::draw;
use crate::figure::{self, Figure};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::Write;

/// The folder of the figures in [`Site::files`].
const FIGURES: &str = "figures/";

/// The file next to a page that holds its figures.
pub(crate) const FIGURES_ZIP: &str = "figures.zip";

/// The files of one report, by path relative to the report's folder. Paths use `/` and never leave the folder.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Site {
    /// Content by path. `figures/` repeats the figures of the page, as SVG and as CSV.
    pub files: BTreeMap<String, Vec<u8>>,
}

impl Site {
    /// Adds a text file.
    pub(crate) fn add(&mut self, path: &str, text: String) {
        self.files.insert(path.to_owned(), text.into_bytes());
    }

    /// Adds a figure next to the page that shows it: as drawn, and as a table.
    pub(crate) fn add_figure(&mut self, figure: &Figure) {
        self.add(&format!("{FIGURES}{}.svg", figure.id), draw::svg_file(figure));
        self.add(&format!("{FIGURES}{}.csv", figure.id), figure::csv(figure));
    }

    /// The files as written: one `figures.zip` holds the figures and needs a fifth of the space of a dozen files.
    #[must_use]
    pub fn to_write(&self) -> BTreeMap<&str, Cow<'_, [u8]>> {
        let plain = self.files.iter().filter(|(path, _)| !path.starts_with(FIGURES));
        let mut files: BTreeMap<&str, Cow<'_, [u8]>> =
            plain.map(|(path, bytes)| (path.as_str(), Cow::Borrowed(bytes.as_slice()))).collect();
        let figures =
            self.files.iter().filter_map(|(path, bytes)| Some((path.strip_prefix(FIGURES)?, bytes.as_slice())));
        let figures: Vec<(&str, &[u8])> = figures.collect();
        if !figures.is_empty() {
            // Writing to memory cannot fail.
            files.insert(FIGURES_ZIP, Cow::Owned(zipped(&figures).unwrap_or_default()));
        }
        files
    }
}

/// The date of all files in an archive, 1980-01-01, so that the same files give the same bytes.
const DATE_S: i64 = 315_532_800;

fn zipped(files: &[(&str, &[u8])]) -> Result<Vec<u8>, rawzip::Error> {
    let mut archive = rawzip::ZipArchiveWriter::new(vec![]);
    for (name, bytes) in files {
        let file = archive.new_file(*name).compression_method(rawzip::CompressionMethod::DEFLATE);
        let (mut entry, sums) = file.last_modified(rawzip::time::UtcDateTime::from_unix(DATE_S)).start()?;
        let mut writer = sums.wrap(flate2::write::DeflateEncoder::new(&mut entry, flate2::Compression::default()));
        writer.write_all(bytes)?;
        let (encoder, descriptor) = writer.finish()?;
        encoder.finish()?;
        entry.finish(descriptor)?;
    }
    archive.finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Read;

    #[test]
    fn figures_are_written_into_one_zip_and_other_files_separately() {
        let mut site = Site::default();
        site.add("index.html", "page".to_owned());
        site.add("figures/a.csv", "1,2\n".repeat(100));
        site.add("figures/a.svg", "<svg/>".to_owned());
        let files = site.to_write();
        assert_eq!(files.keys().copied().collect::<Vec<_>>(), ["figures.zip", "index.html"]);
        let zip = &files["figures.zip"];
        assert!(zip.len() < 400 && *zip == site.to_write()["figures.zip"], "{}", zip.len());
        let mut read = zip::ZipArchive::new(std::io::Cursor::new(zip.as_ref())).unwrap();
        assert_eq!(read.len(), 2);
        let mut text = String::new();
        read.by_name("a.csv").unwrap().read_to_string(&mut text).unwrap();
        assert_eq!(text.as_bytes(), site.files["figures/a.csv"]);
    }
}
