//! ZIP archives (PKWARE APPNOTE 6.3): the list of files at the end, or where it is lost, the headers one after another.

use crate::bytes::Bytes;
use std::fs::File;
use std::io::{self, BufRead, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::PathBuf;

/// The end record is followed by a comment of at most 64 KiB.
const END_BYTES: u64 = 22;
const MOST_COMMENT: u64 = 65_535;
/// Maximum memory for the list of files.
const MOST_LIST: u64 = 64 << 20;
/// Maximum candidates for the end record that are examined.
const MOST_ENDS: usize = 100;
/// Placeholder if the 64-bit field holds the number.
const IN_EXTRA: u64 = 0xffff_ffff;

/// A file in the archive.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Entry {
    name: String,
    method: u16,
    encrypted: bool,
    /// CRC-32 of the content, if a header states it before the content.
    crc: Option<u32>,
    /// Packed size, bytes.
    pub(super) packed_bytes: u64,
    header_at: u64,
    /// The list of files at the end of the archive names it.
    pub(super) listed: bool,
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

    fn is_file(&self) -> bool {
        // ROS stores its logs in `.ros`.
        let hidden = self.name.rsplit('/').next().is_some_and(|name| name.starts_with('.'));
        !self.name.ends_with('/') && !hidden && !self.name.split('/').any(|part| part == "__MACOSX")
    }
}

/// The files of an archive in the order of its list.
pub(super) fn entries(file: &mut File, most: usize) -> io::Result<Vec<Entry>> {
    let size = file.metadata()?.len();
    let mut entries = match list_at_end(file, size)? {
        Some(entries) => entries,
        None => headers(file, size, most)?,
    };
    for entry in entries.iter_mut().filter(|entry| !entry.is_file()).take(most) {
        // The list may be corrupt: each name is also stored before the content.
        let head = read_at(file, entry.header_at, 30 + MOST_COMMENT)?;
        if let Some((own, _)) = header(&head, entry.header_at) {
            entry.name = own.name;
        }
    }
    entries.retain(Entry::is_file);
    if entries.len() > most {
        let what = format!("ZIP archive of {} files; archives of more than {most} are not examined", entries.len());
        return Err(io::Error::other(what));
    }
    Ok(entries)
}

fn read_at(file: &mut File, offset: u64, length: u64) -> io::Result<Vec<u8>> {
    let mut bytes = vec![];
    file.seek(SeekFrom::Start(offset))?;
    file.take(length).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// The list of files; `None` if it is missing or inconsistent.
fn list_at_end(file: &mut File, size: u64) -> io::Result<Option<Vec<Entry>>> {
    let tail_at = size.saturating_sub(END_BYTES + MOST_COMMENT);
    let tail = read_at(file, tail_at, size - tail_at)?;
    let ends = || memchr::memmem::rfind_iter(&tail, b"PK\x05\x06").take(MOST_ENDS);
    let record = |found: usize| tail.get(found..).unwrap_or_default();
    // A comment may contain what looks like an end record.
    let reaches_end = |found: &usize| EndRecord::parse(record(*found)).is_some_and(|end| end.reaches_end);
    let Some(found) = ends().find(reaches_end).or_else(|| ends().next()) else { return Ok(None) };
    let Some(mut end) = EndRecord::parse(record(found)) else { return Ok(None) };
    let mut end_at = tail_at + found as u64;
    if (end.list_at == IN_EXTRA || end.list_bytes == IN_EXTRA)
        && let Some((list_at, list_bytes, record_at)) = end_record_64(file, end_at)?
    {
        (end.list_at, end.list_bytes, end_at) = (list_at, list_bytes, record_at);
    }
    if end.list_bytes > MOST_LIST || end.list_at.checked_add(end.list_bytes).is_none_or(|end| end > end_at) {
        return Ok(None);
    }
    let list = read_at(file, end.list_at, end.list_bytes)?;
    let mut bytes = Bytes(&list);
    let mut entries = vec![];
    while !bytes.0.is_empty() {
        match listed(&mut bytes) {
            Some(entry) if entry.header_at < size => entries.push(entry),
            _ => return Ok(None),
        }
    }
    // It counts modulo 65536.
    Ok(Some(entries).filter(|entries| end.files == u16::MAX || entries.len() & 0xffff == usize::from(end.files)))
}

/// The record after the list of files.
struct EndRecord {
    files: u16,
    list_bytes: u64,
    list_at: u64,
    /// Its comment ends at the end of the file.
    reaches_end: bool,
}

impl EndRecord {
    fn parse(record: &[u8]) -> Option<EndRecord> {
        let mut bytes = Bytes(record.get(10..)?);
        let files = bytes.u16()?;
        let (list_bytes, list_at) = (u64::from(bytes.u32()?), u64::from(bytes.u32()?));
        let comment = usize::from(bytes.u16()?);
        Some(EndRecord { files, list_bytes, list_at, reaches_end: bytes.0.len() == comment })
    }
}

/// For an archive over 4 GiB: a locator before the end record points to the longer one. Returns place and bytes of the
/// list, and the start of the longer record.
fn end_record_64(file: &mut File, end_at: u64) -> io::Result<Option<(u64, u64, u64)>> {
    let Some(locator_at) = end_at.checked_sub(20) else { return Ok(None) };
    let locator = read_at(file, locator_at, 20)?;
    let record_at = locator.strip_prefix(b"PK\x06\x07").and_then(|rest| Bytes(rest.get(4..)?).u64());
    let Some(record_at) = record_at.filter(|at| *at < end_at) else { return Ok(None) };
    let record = read_at(file, record_at, 56)?;
    let found = record.strip_prefix(b"PK\x06\x06").and_then(|rest| {
        let mut bytes = Bytes(rest.get(36..)?);
        let list_bytes = bytes.u64()?;
        Some((bytes.u64()?, list_bytes, record_at))
    });
    Ok(found)
}

/// One entry of the list.
fn listed(bytes: &mut Bytes<'_>) -> Option<Entry> {
    if bytes.take(4)? != b"PK\x01\x02" {
        return None;
    }
    bytes.take(4)?;
    let (flags, method) = (bytes.u16()?, bytes.u16()?);
    bytes.take(4)?;
    let crc = bytes.u32()?;
    let (packed, plain) = (u64::from(bytes.u32()?), u64::from(bytes.u32()?));
    let [name, extra, comment] = [bytes.u16()?, bytes.u16()?, bytes.u16()?].map(usize::from);
    bytes.take(8)?;
    let header_at = u64::from(bytes.u32()?);
    let name = String::from_utf8_lossy(bytes.take(name)?).into_owned();
    let extra = bytes.take(extra)?;
    bytes.take(comment)?;
    let mut wide = wide_numbers(extra);
    let mut full = |number: u64| if number == IN_EXTRA { wide.u64() } else { Some(number) };
    let _plain = full(plain)?;
    let packed_bytes = full(packed)?;
    let header_at = full(header_at)?;
    Some(Entry { name, method, encrypted: flags & 1 == 1, crc: Some(crc), packed_bytes, header_at, listed: true })
}

/// Field 1 of an extra: 64-bit numbers for those that do not fit.
fn wide_numbers(extra: &[u8]) -> Bytes<'_> {
    let mut bytes = Bytes(extra);
    while let (Some(id), Some(length)) = (bytes.u16(), bytes.u16()) {
        match bytes.take(usize::from(length)) {
            Some(content) if id == 1 => return Bytes(content),
            Some(_) => {}
            None => break,
        }
    }
    Bytes(&[])
}

/// The entries of an archive whose list is lost, from their headers. An entry of unknown length ends the search
/// and may extend to the end.
fn headers(file: &mut File, size: u64, most: usize) -> io::Result<Vec<Entry>> {
    let mut entries = vec![];
    let mut at = 0;
    while at < size && entries.len() <= most {
        let head = read_at(file, at, 30 + 2 * MOST_COMMENT)?;
        let Some((mut entry, content_at)) = header(&head, at) else { break };
        let rest = size.saturating_sub(content_at);
        let open = entry.crc.is_none();
        if open || entry.packed_bytes > rest {
            entry.packed_bytes = rest;
        }
        at = content_at + entry.packed_bytes;
        entries.push(entry);
        if open {
            break;
        }
    }
    Ok(entries)
}

/// A header before its content, and the start of the content.
fn header(head: &[u8], at: u64) -> Option<(Entry, u64)> {
    let mut bytes = Bytes(head);
    if bytes.take(4)? != b"PK\x03\x04" {
        return None;
    }
    bytes.take(2)?;
    let (flags, method) = (bytes.u16()?, bytes.u16()?);
    bytes.take(4)?;
    let crc = bytes.u32()?;
    let (packed, plain) = (u64::from(bytes.u32()?), u64::from(bytes.u32()?));
    let (name, extra) = (bytes.u16()?, bytes.u16()?);
    let content_at = at + 30 + u64::from(name) + u64::from(extra);
    let name = String::from_utf8_lossy(bytes.take(usize::from(name))?).into_owned();
    let mut wide = wide_numbers(bytes.take(usize::from(extra)).unwrap_or_default());
    let mut full = |number: u64| if number == IN_EXTRA { wide.u64() } else { Some(number) };
    let _plain = full(plain)?;
    let packed_bytes = full(packed)?;
    // With bit 3 the numbers come after the content.
    let crc = (flags & 8 == 0).then_some(crc);
    let entry = Entry { name, method, encrypted: flags & 1 == 1, crc, packed_bytes, header_at: at, listed: false };
    Some((entry, content_at))
}

/// Position of the packed bytes of an entry.
pub(super) fn place(file: &mut File, entry: &Entry) -> io::Result<Range<u64>> {
    let head = read_at(file, entry.header_at, 30 + 2 * MOST_COMMENT)?;
    let broken = || io::Error::new(io::ErrorKind::InvalidData, "the list of files does not point to a header");
    let (_, start) = header(&head, entry.header_at).ok_or_else(broken)?;
    Ok(start..start.saturating_add(entry.packed_bytes))
}

/// The content of an entry; an error at its end if its CRC is wrong.
pub(super) fn decoder<'r>(entry: &Entry, packed: impl BufRead + 'r) -> Result<Box<dyn Read + 'r>, String> {
    if entry.encrypted {
        return Err("the ZIP archive is encrypted".to_owned());
    }
    let content = unpacked(entry.method, packed)?;
    Ok(Box::new(Checked { inner: content, crc: crc32fast::Hasher::new(), expected: entry.crc }))
}

fn unpacked<'r>(method: u16, packed: impl BufRead + 'r) -> Result<Box<dyn Read + 'r>, String> {
    Ok(match method {
        0 => Box::new(packed),
        8 => Box::new(flate2::bufread::DeflateDecoder::new(packed)),
        12 => Box::new(bzip2::bufread::BzDecoder::new(packed)),
        93 => super::zstandard(packed)?,
        other => return Err(format!("the ZIP archive uses an unsupported compression (method {other})")),
    })
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
