//! ZIP archives (PKWARE APPNOTE 6.3), by their list of files at the end.

use rawzip::{CompressionMethod, RECOMMENDED_BUFFER_SIZE, ZipArchive, ZipFileHeaderRecord};
use std::fs::File;
use std::io::{self, BufRead, Read};
use std::ops::Range;
use std::path::PathBuf;

/// A file in the archive.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Entry {
    name: String,
    method: CompressionMethod,
    encrypted: bool,
    /// CRC-32 of the content.
    crc: u32,
    /// Position of the packed bytes in the archive; an error if the list of files does not point to a file.
    pub(super) place: Result<Range<u64>, String>,
}

impl Entry {
    /// Its name without folders.
    pub(super) fn file_name(&self) -> PathBuf {
        let name = self.name.rsplit(['/', '\\']).next().filter(|n| !n.is_empty() && *n != "." && *n != "..");
        PathBuf::from(name.unwrap_or("file").replace('\0', ""))
    }

    /// Whether this is the write-ahead log that SQLite kept next to that database.
    pub(super) fn is_write_ahead_log_of(&self, database: &Entry) -> bool {
        self.name.strip_suffix("-wal").is_some_and(|name| name == database.name)
    }
}

/// Whether a name is that of a file that may be a log.
fn is_file(name: &str) -> bool {
    // ROS stores its logs in `.ros`.
    let hidden = name.rsplit('/').next().is_some_and(|name| name.starts_with('.'));
    !name.ends_with('/') && !hidden && !name.split('/').any(|part| part == "__MACOSX")
}

/// The files of an archive in the order of its list.
pub(super) fn entries(file: &File, most: usize) -> io::Result<Vec<Entry>> {
    let mut buffer = vec![0; RECOMMENDED_BUFFER_SIZE];
    let archive = ZipArchive::from_file(file.try_clone()?, &mut buffer).map_err(damaged)?;
    let (mut entries, mut files) = (vec![], 0_usize);
    let mut list = archive.entries(&mut buffer);
    for _ in 0..archive.entries_hint() {
        let record = list.next_entry().map_err(damaged)?.ok_or_else(|| io::Error::other(DAMAGED))?;
        let name = String::from_utf8_lossy(record.file_path().as_bytes()).into_owned();
        if is_file(&name) {
            files += 1;
            if files <= most {
                entries.push(entry(&archive, &record, name));
            }
        }
    }
    // More files than the archive states: which of the two is wrong is unknown.
    if matches!(list.next_entry(), Ok(Some(_))) {
        return Err(io::Error::other(DAMAGED));
    }
    if files > most {
        let what = format!("ZIP archive of {files} files; archives of more than {most} are not examined");
        return Err(io::Error::other(what));
    }
    Ok(entries)
}

const DAMAGED: &str = "ZIP archive without a valid list of files at its end: it is truncated or damaged; `zip -FF` may \
                       repair it";

/// An error of the disk as it is, otherwise that the archive is damaged.
fn damaged(error: rawzip::Error) -> io::Error {
    match error.into_kind() {
        rawzip::ErrorKind::IO(error) => error,
        _ => io::Error::other(DAMAGED),
    }
}

fn entry<R: rawzip::ReaderAt>(archive: &ZipArchive<R>, record: &ZipFileHeaderRecord<'_>, name: String) -> Entry {
    let place = archive.get_entry(record.wayfinder()).map(|entry| entry.compressed_data_range());
    Entry {
        name,
        method: record.compression_method(),
        encrypted: record.flags().is_encrypted(),
        crc: record.crc32(),
        place: place
            .map(|(start, end)| start..end)
            .map_err(|e| format!("the list of files does not point to its content: {e}")),
    }
}

/// The content of an entry; an error at its end if its CRC is wrong.
pub(super) fn decoder<'r>(entry: &Entry, packed: impl BufRead + 'r) -> Result<Box<dyn Read + 'r>, String> {
    if entry.encrypted {
        return Err("the ZIP archive is encrypted".to_owned());
    }
    let content: Box<dyn Read + 'r> = match entry.method {
        CompressionMethod::STORE => Box::new(packed),
        CompressionMethod::DEFLATE => Box::new(flate2::bufread::DeflateDecoder::new(packed)),
        CompressionMethod::BZIP2 => Box::new(bzip2::bufread::BzDecoder::new(packed)),
        CompressionMethod::ZSTD => super::zstandard(packed)?,
        other => return Err(format!("the ZIP archive uses an unsupported compression, {other}")),
    };
    Ok(Box::new(Checked { inner: content, crc: crc32fast::Hasher::new(), expected: Some(entry.crc) }))
}

/// Compares the CRC-32 at the end.
struct Checked<R> {
    inner: R,
    crc: crc32fast::Hasher,
    expected: Option<u32>,
}

impl<R: Read> Read for Checked<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let got = self.inner.read(buffer)?;
        self.crc.update(buffer.get(..got).unwrap_or_default());
        let wrong = got == 0
            && !buffer.is_empty()
            && self.expected.take().is_some_and(|expected| self.crc.clone().finalize() != expected);
        if wrong {
            Err(io::Error::new(io::ErrorKind::InvalidData, "the CRC-32 of the content is wrong"))
        } else {
            Ok(got)
        }
    }
}
