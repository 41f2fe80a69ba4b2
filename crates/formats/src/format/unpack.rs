//! Packed logs: gzip, Zstandard, bzip2, LZ4, ZIP with one log, and text in UTF-16. They are unpacked into a
//! temporary folder, deleted after reading, and read there like any file.
//!
//! The ledger of such a log counts the unpacked bytes: it is exact for what was unpacked. Bytes of the packed file that
//! could not be unpacked are a notice of severity loss with their position.

mod utf16;
mod zip;

use super::db3::write_ahead_log_of;
use super::inflate::SKIPPABLE_LZ4;
use super::read_files;
use crate::bytes::{Bytes, is_zero};
use crate::error::{LogError, file_name};
use crate::reader::{Log, ReadContext, Select};
use crate::sniff::{self, Content, LogKind};
use crate::unit::FlightUnit;
use bzip2::bufread::BzDecoder;
use flate2::bufread::GzDecoder;
use flight::{Code, Notices};
use logscan::ScanError;
use lz4_flex::frame::FrameDecoder;
use std::cell::Cell;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Cursor, Read, Seek, SeekFrom, Write};
use std::marker::PhantomData;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Bytes that are unpacked per step. If Zstandard fails within a step, all of that step is lost.
const STEP: usize = 256 << 10;
const UNPACKED_STEP: usize = 16 << 10;
/// Maximum archive members that are examined, and maximum memory for their first bytes.
const MOST_MEMBERS: usize = 1000;
const MOST_HEADS: usize = 16 << 20;
/// Window of a Zstandard frame, as a power of two: 128 MiB, the largest that `zstd` itself accepts by default. Only a
/// log of that size takes that much memory.
const WINDOW_LOG: u32 = 27;
/// No log expands by a larger factor: such a file is a decompression bomb or nearly all zeros. The ratio is ignored
/// below this size in bytes.
const MOST_TIMES: u64 = 100;
const AT_ANY_RATIO: u64 = 32 << 20;

/// Name suffixes of packed files, appended to the name of the content.
pub const ENDINGS: &[&str] = &["gz", "gzip", "zst", "zstd", "bz2", "lz4"];

/// How a file is packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Packing {
    /// gzip.
    Gzip,
    /// Zstandard.
    Zstd,
    /// bzip2.
    Bzip2,
    /// LZ4 frames.
    Lz4,
    /// ZIP.
    Zip,
    /// Not packed, but text in UTF-16.
    Utf16 {
        /// Big-endian.
        big: bool,
    },
}

impl Packing {
    /// Detected from the first bytes of a file; `text` says that it is named like a text file.
    pub fn of(head: &[u8], text: bool) -> Option<Packing> {
        const MAGIC: [(&[u8], Packing); 8] = [
            (b"\x1f\x8b\x08", Packing::Gzip),
            (b"\x28\xb5\x2f\xfd", Packing::Zstd),
            (b"BZh", Packing::Bzip2),
            (b"\x04\x22\x4d\x18", Packing::Lz4),
            (b"PK\x03\x04", Packing::Zip),
            (b"PK\x05\x06", Packing::Zip),
            (b"\xff\xfe", Packing::Utf16 { big: false }),
            (b"\xfe\xff", Packing::Utf16 { big: true }),
        ];
        let start = behind_skippable(head);
        let known = MAGIC.iter().find(|(magic, _)| start.starts_with(magic)).map(|(_, packing)| *packing);
        let known =
            known.filter(|packing| start.len() == head.len() || matches!(packing, Packing::Zstd | Packing::Lz4));
        known.or_else(|| utf16::without_mark(head).filter(|_| text))
    }

    fn name(self) -> &'static str {
        match self {
            Packing::Gzip => "gzip",
            Packing::Zstd => "Zstandard",
            Packing::Bzip2 => "bzip2",
            Packing::Lz4 => "LZ4",
            Packing::Zip => "ZIP",
            Packing::Utf16 { big: false } => "UTF-16 (little-endian)",
            Packing::Utf16 { big: true } => "UTF-16 (big-endian)",
        }
    }
}

/// The data after the skippable frames at the start (RFC 8878, 3.1.2; LZ4 has the same): `pzstd` writes one before
/// every frame.
fn behind_skippable(mut head: &[u8]) -> &[u8] {
    while let Some(([0x50..=0x5f, 0x2a, 0x4d, 0x18], rest)) = head.split_first_chunk::<4>() {
        let mut rest = Bytes(rest);
        match rest.u32().and_then(|length| rest.take(length as usize)) {
            Some(_) => head = rest.0,
            None => break,
        }
    }
    head
}

/// A file in a packed file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Member {
    /// Its name, without folders.
    pub name: PathBuf,
    /// Its first bytes.
    pub head: Vec<u8>,
    /// Why there are none, unless the file is empty.
    pub fault: Option<String>,
    entry: Option<zip::Entry>,
}

/// The files in a packed file, with their first bytes.
pub fn members(path: &Path, packing: Packing) -> io::Result<Vec<Member>> {
    let file = File::open(path)?;
    if packing != Packing::Zip {
        let (at, bad) = (Cell::new(0), Cell::new(0));
        let packed = Packed::new(&file, 0..u64::MAX, &at);
        let (head, fault) = head_of(decoder(packing, packed, &bad), packing, sniff::HEAD);
        return Ok(vec![Member { name: inner_name(path, packing), head, fault, entry: None }]);
    }
    let entries = zip::entries(&file, MOST_MEMBERS)?;
    let most = sniff::HEAD.min(MOST_HEADS / entries.len().max(1));
    let member = |entry: zip::Entry| {
        let at = Cell::new(0);
        let unpacked = entry.place.clone().and_then(|place| zip::decoder(&entry, Packed::new(&file, place, &at)));
        let (head, fault) = head_of(unpacked, packing, most);
        Member { name: entry.file_name(), head, fault, entry: Some(entry) }
    };
    Ok(entries.into_iter().map(member).collect())
}

/// Whether the header of a zstd file states the length of the other file.
#[must_use]
pub fn is_packed_of(packed: &Path, plain: &Path) -> bool {
    let mut head = [0; 18];
    let read = File::open(packed).and_then(|mut file| file.read(&mut head)).unwrap_or(0);
    let stated = zstd::zstd_safe::get_frame_content_size(head.get(..read).unwrap_or_default());
    let length = std::fs::metadata(plain).map(|about| about.len()).ok();
    matches!(stated, Ok(Some(bytes)) if Some(bytes) == length)
}

/// As many of the first bytes as can be unpacked, up to `most`; or the reason for having none.
fn head_of(decoder: Result<Box<dyn Read + '_>, String>, packing: Packing, most: usize) -> (Vec<u8>, Option<String>) {
    let mut head = vec![];
    let fault = match decoder {
        // The vector keeps what was unpacked before an error.
        Ok(decoder) => decoder.take(most as u64).read_to_end(&mut head).err().map(|e| fault_of(&e, packing)),
        Err(fault) => Some(fault),
    };
    let fault = fault.filter(|_| head.is_empty());
    (head, fault)
}

/// The name without the packing suffix.
fn inner_name(path: &Path, packing: Packing) -> PathBuf {
    let name = PathBuf::from(path.file_name().unwrap_or(path.as_os_str()));
    let ending = name.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let own: &[&str] = match packing {
        Packing::Gzip => &["gz", "gzip"],
        Packing::Zstd => &["zst", "zstd"],
        Packing::Bzip2 => &["bz2"],
        Packing::Lz4 => &["lz4"],
        Packing::Zip | Packing::Utf16 { .. } => &[],
    };
    match ending.as_str() {
        "tgz" => name.with_extension("tar"),
        ending if own.contains(&ending) => name.with_extension(""),
        _ => name,
    }
}

/// Unpacks a file; `bad` counts invalid UTF-16 characters.
fn decoder<'r>(packing: Packing, packed: impl BufRead + 'r, bad: &'r Cell<u64>) -> Result<Box<dyn Read + 'r>, String> {
    let text = |error: io::Error| error.to_string();
    Ok(match packing {
        Packing::Gzip => Box::new(Parts::<_, GzDecoder<_>>::begin(packed).map_err(text)?),
        Packing::Zstd => zstandard(packed)?,
        Packing::Bzip2 => Box::new(Parts::<_, BzDecoder<_>>::begin(packed).map_err(text)?),
        Packing::Lz4 => Box::new(Parts::<_, FrameDecoder<_>>::begin(packed).map_err(text)?),
        Packing::Utf16 { big } => Box::new(utf16::Reader::new(packed, big, bad)),
        Packing::Zip => return Err("a ZIP archive in a packed file".to_owned()),
    })
}

fn zstandard<'r>(packed: impl BufRead + 'r) -> Result<Box<dyn Read + 'r>, String> {
    let mut decoder = zstd::stream::read::Decoder::with_buffer(packed).map_err(|e| e.to_string())?;
    decoder.window_log_max(WINDOW_LOG).map_err(|e| e.to_string())?;
    Ok(Box::new(decoder))
}

/// Unpacks one of several parts in sequence: a member of gzip (RFC 1952, 2.2), a stream of bzip2, a frame of
/// LZ4.
trait Part<R>: Read + Sized {
    fn begin(packed: R) -> io::Result<Self>;

    /// The data after it, if it has an end.
    fn end(self) -> io::Result<R>;
}

impl<R: BufRead> Part<R> for GzDecoder<R> {
    fn begin(packed: R) -> io::Result<Self> {
        Ok(GzDecoder::new(packed))
    }

    fn end(self) -> io::Result<R> {
        Ok(self.into_inner())
    }
}

impl<R: BufRead> Part<R> for BzDecoder<R> {
    fn begin(packed: R) -> io::Result<Self> {
        Ok(BzDecoder::new(packed))
    }

    fn end(self) -> io::Result<R> {
        Ok(self.into_inner())
    }
}

/// One LZ4 frame. Its decoder takes a file that ends between two blocks for a whole one, so the end is noted here.
struct Lz4Frame<R> {
    /// Its first four bytes; none if only skippable frames were left.
    magic: Cursor<Vec<u8>>,
    packed: R,
    truncated: bool,
}

impl<R: Read> Read for Lz4Frame<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let got = self.magic.read(buffer)?;
        if got > 0 || self.magic.get_ref().is_empty() {
            return Ok(got);
        }
        let got = self.packed.read(buffer)?;
        self.truncated |= got == 0 && !buffer.is_empty();
        Ok(got)
    }
}

impl<R: BufRead> Part<R> for FrameDecoder<Lz4Frame<R>> {
    fn begin(mut packed: R) -> io::Result<Self> {
        let mut magic = vec![];
        while magic.is_empty() && !packed.fill_buf()?.is_empty() {
            let mut word = [0; 4];
            packed.read_exact(&mut word)?;
            if u32::from_le_bytes(word) & !0xf != SKIPPABLE_LZ4 {
                magic = word.to_vec();
                continue;
            }
            packed.read_exact(&mut word)?;
            let length = u64::from(u32::from_le_bytes(word));
            if io::copy(&mut packed.by_ref().take(length), &mut io::sink())? < length {
                return Err(unended());
            }
        }
        Ok(FrameDecoder::new(Lz4Frame { magic: Cursor::new(magic), packed, truncated: false }))
    }

    fn end(self) -> io::Result<R> {
        let Lz4Frame { packed, truncated, .. } = self.into_inner();
        if truncated { Err(unended()) } else { Ok(packed) }
    }
}

fn unended() -> io::Error {
    io::Error::new(io::ErrorKind::UnexpectedEof, "the frame does not end")
}

/// All parts of a file.
struct Parts<R, D> {
    decoder: Option<D>,
    packed: PhantomData<R>,
}

impl<R, D: Part<R>> Parts<R, D> {
    fn begin(packed: R) -> io::Result<Parts<R, D>> {
        Ok(Parts { decoder: Some(D::begin(packed)?), packed: PhantomData })
    }
}

impl<R: BufRead, D: Part<R>> Read for Parts<R, D> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        while let Some(mut decoder) = self.decoder.take() {
            let got = decoder.read(buffer)?;
            if got > 0 || buffer.is_empty() {
                self.decoder = Some(decoder);
                return Ok(got);
            }
            let mut packed = decoder.end()?;
            if !packed.fill_buf()?.is_empty() {
                *self = Parts::begin(packed)?;
            }
        }
        Ok(0)
    }
}

/// Reads the files of a flight as [`read_files`], unpacking them first where they are packed. The byte ledger of a packed
/// log counts unpacked bytes.
///
/// # Errors
/// As [`read_files`].
pub fn read(unit: &FlightUnit, want: &dyn Select, context: &ReadContext<'_>) -> Result<Log, LogError> {
    let packings = unit.files.iter().map(|path| packing_of(path)).collect::<Result<Vec<_>, _>>()?;
    let Some(first) = packings.iter().flatten().next().copied() else {
        return read_files(unit.kind, &unit.files, want, context);
    };
    let mut unpacking = Unpacking::new(unit.kind, context)?;
    let packed = |(path, packing): (&PathBuf, &Option<Packing>)| Some((path.clone(), (*packing)?));
    let packed: Vec<_> = unit.files.iter().zip(&packings).filter_map(packed).collect();
    for (path, packing) in unit.files.iter().zip(&packings) {
        match packing {
            // It is unpacked along with its database.
            None if packed.iter().any(|(packed, packing)| *path == newest_pages(packed, *packing)) => {}
            None => unpacking.files.push(path.clone()),
            Some(packing) => unpacking.file(path, *packing)?,
        }
    }
    // The progress is that of the packed bytes, which have been read.
    let plain = packings.iter().all(Option::is_some);
    let quiet = ReadContext { limits: context.limits, cancel: context.cancel, on_bytes: &|_| () };
    let mut log = read_files(unit.kind, &unpacking.files, want, if plain { &quiet } else { context })?;
    log.health.format = format!("{}, in {}", log.health.format, first.name());
    let mut notices = unpacking.notices;
    notices.extend(log.notices);
    log.notices = notices;
    Ok(log)
}

/// SQLite's sidecars of a database that was packed later.
fn newest_pages(packed: &Path, packing: Packing) -> PathBuf {
    write_ahead_log_of(&packed.with_file_name(inner_name(packed, packing)))
}

/// The packing of a file, from its first bytes.
fn packing_of(path: &Path) -> Result<Option<Packing>, LogError> {
    let mut head = vec![];
    let file = File::open(path).map_err(|e| LogError::of_file(path, e))?;
    file.take(utf16::TELLING as u64).read_to_end(&mut head).map_err(|e| LogError::of_file(path, e))?;
    Ok(Packing::of(&head, named_text(path)))
}

/// Whether the file is named like a text file.
pub(crate) fn named_text(path: &Path) -> bool {
    let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    ["csv", "txt", "tsv", "log"].contains(&ending.as_str())
}

/// The unpacked files of one unit, and what was lost in the process.
struct Unpacking<'c> {
    kind: LogKind,
    context: &'c ReadContext<'c>,
    folder: tempfile::TempDir,
    files: Vec<PathBuf>,
    /// Bytes written so far.
    written: u64,
    notices: Notices,
}

impl<'c> Unpacking<'c> {
    fn new(kind: LogKind, context: &'c ReadContext<'c>) -> Result<Unpacking<'c>, LogError> {
        let folder = tempfile::Builder::new().prefix("flightlag-").tempdir();
        let folder = folder.map_err(|e| LogError::of_file(&std::env::temp_dir(), e))?;
        Ok(Unpacking { kind, context, folder, files: vec![], written: 0, notices: Notices::new() })
    }

    fn file(&mut self, path: &Path, packing: Packing) -> Result<(), LogError> {
        let unusable = |what: String| LogError::Unusable { file: file_name(path), what };
        let file = File::open(path).map_err(|e| LogError::of_file(path, e))?;
        let size = file.metadata().map_err(|e| LogError::of_file(path, e))?.len();
        if packing == Packing::Zip {
            return self.archive(path, file, size);
        }
        let (at, bad) = (Cell::new(0), Cell::new(0));
        let decoder = decoder(packing, Packed::new(&file, 0..size, &at), &bad).map_err(unusable)?;
        let target = self.target(&inner_name(path, packing))?;
        self.copy(&Piece { path, size, packing, at: &at, place: 0..size }, &target, decoder)?;
        self.newest_pages(&newest_pages(path, packing), &target)?;
        if bad.get() > 0 {
            let text = "invalid UTF-16 was replaced with U+FFFD";
            self.notices.push(Code::Corrupt, file_name(path), bad.get(), text);
        }
        Ok(())
    }

    fn wants(&self, content: &Content) -> bool {
        match content {
            Content::Log(kind) => *kind == self.kind,
            Content::Table { .. } => self.kind == LogKind::Csv,
            Content::Packed(_) | Content::Other(_) => false,
        }
    }

    /// Unpacks the logs of a ZIP archive.
    fn archive(&mut self, path: &Path, file: File, size: u64) -> Result<(), LogError> {
        let unusable = |what: String| LogError::Unusable { file: file_name(path), what };
        let failed = |e: io::Error| LogError::of_file(path, e);
        let packing = Packing::Zip;
        let members = members(path, packing).map_err(|e| match e.raw_os_error() {
            Some(_) => failed(e),
            None => unusable(e.to_string()),
        })?;
        let mut wanted = vec![];
        for member in &members {
            let is_wanted = self.wants(&sniff::content_of(&member.name, &member.head, self.context));
            let Some(entry) = member.entry.as_ref().filter(|_| is_wanted) else { continue };
            let target = self.target(&member.name)?;
            // The write-ahead log that a killed recorder left next to its bag belongs to it.
            let ahead = members.iter().filter_map(|m| m.entry.as_ref()).find(|e| e.is_write_ahead_log_of(entry));
            let ahead = ahead.filter(|_| self.kind == LogKind::Db3).map(|ahead| (ahead, write_ahead_log_of(&target)));
            wanted.extend([Some((entry, target)), ahead].into_iter().flatten());
        }
        for (entry, target) in wanted {
            let at = Cell::new(0);
            let place = entry.place.clone().map_err(unusable)?;
            let decoder = zip::decoder(entry, Packed::new(&file, place.clone(), &at)).map_err(unusable)?;
            self.copy(&Piece { path, size, packing, at: &at, place }, &target, decoder)?;
        }
        if self.files.is_empty() {
            return Err(unusable("the ZIP archive has no log of this kind".to_owned()));
        }
        Ok(())
    }

    /// Target path for the next log.
    fn target(&mut self, name: &Path) -> Result<PathBuf, LogError> {
        // One folder each, because two logs may have the same name.
        let folder = self.folder.path().join(self.files.len().to_string());
        let target = folder.join(name);
        std::fs::create_dir(&folder).map_err(|e| LogError::of_file(&target, e))?;
        self.files.push(target.clone());
        Ok(target)
    }

    /// Copies the write-ahead log next to a packed database.
    fn newest_pages(&mut self, ahead: &Path, target: &Path) -> Result<(), LogError> {
        let bytes = match std::fs::metadata(ahead) {
            Ok(about) if about.is_file() && self.kind == LogKind::Db3 => about.len(),
            _ => return Ok(()),
        };
        self.written += bytes;
        let limit = self.context.limits.unpacked_bytes;
        if self.written > limit {
            let what = format!("together with the database it is larger than the limit of {limit} bytes");
            return Err(LogError::Unusable { file: file_name(ahead), what });
        }
        std::fs::copy(ahead, write_ahead_log_of(target)).map(|_| ()).map_err(|e| LogError::of_file(ahead, e))
    }

    /// Unpacks one file of a packed file.
    fn copy(&mut self, piece: &Piece<'_>, target: &Path, mut decoder: Box<dyn Read + '_>) -> Result<(), LogError> {
        let Piece { path, size, packing, at, .. } = *piece;
        let mut out = File::create(target).map_err(|e| LogError::of_file(target, e))?;
        let mut buffer = vec![0; UNPACKED_STEP];
        let (mut reported, mut bytes) = (piece.place.start, 0_u64);
        let fault = loop {
            let got = match decoder.read(&mut buffer) {
                Ok(0) => break None,
                Ok(got) => got,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                // The disk or network failed, not the log: another attempt may get all of it.
                Err(source) if source.raw_os_error().is_some() => {
                    return Err(LogError::Read(ScanError::Io { file: file_name(path), offset: at.get(), source }));
                }
                Err(error) => break Some(fault_of(&error, packing)),
            };
            bytes += got as u64;
            self.written += got as u64;
            if self.written > self.context.limits.unpacked_bytes {
                let limit = self.context.limits.unpacked_bytes;
                let what = format!("{}: the unpacked log is larger than the limit of {limit} bytes", packing.name());
                return Err(LogError::Unusable { file: file_name(path), what });
            }
            if self.written > AT_ANY_RATIO.max(size.saturating_mul(MOST_TIMES)) {
                bytes -= got as u64;
                break Some(beyond_any_ratio(packing));
            }
            write_sparse(&mut out, buffer.get(..got).unwrap_or_default()).map_err(|e| LogError::of_file(target, e))?;
            self.context.advance(at.get() - reported)?;
            reported = at.get();
        };
        out.set_len(bytes).map_err(|e| LogError::of_file(target, e))?;
        fault.map_or(Ok(()), |fault| self.report_fault(piece, &fault, bytes))
    }

    /// Reports what was lost after the unpacked bytes; without any unpacked bytes there is nothing to read.
    fn report_fault(&mut self, piece: &Piece<'_>, fault: &str, bytes: u64) -> Result<(), LogError> {
        let (file, at, end) = (file_name(piece.path), piece.at.get(), piece.place.end);
        if bytes == 0 {
            return Err(LogError::Unusable { file, what: format!("{fault}; nothing could be unpacked") });
        }
        let what = format!("{fault}; only the {bytes} bytes unpacked before it are read");
        self.notices.push(Code::Corrupt, format!("{file}, near byte {at}"), end - at.min(end) + 1, what);
        Ok(())
    }
}

/// Packed bytes of one log.
struct Piece<'p> {
    path: &'p Path,
    /// Size of the whole packed file.
    size: u64,
    packing: Packing,
    /// How many of the packed bytes were consumed.
    at: &'p Cell<u64>,
    /// Their position in the file.
    place: Range<u64>,
}

/// The meaning of a decoder error.
fn fault_of(error: &io::Error, packing: Packing) -> String {
    let (name, text) = (packing.name(), error.to_string());
    match error.kind() {
        // In the library's words.
        _ if packing == Packing::Zstd && text.contains("too much memory") => {
            format!("the window is larger than the limit of 2^{WINDOW_LOG} bytes; unpack it with zstd -d --long=31")
        }
        _ if packing == Packing::Zstd && text.contains("Dictionary mismatch") => {
            "the Zstandard data need the dictionary that they were compressed with; unpack them with zstd -d -D"
                .to_owned()
        }
        _ if error.raw_os_error().is_some() => text,
        io::ErrorKind::UnexpectedEof => format!("the {name} data are truncated: the end mark is missing"),
        _ => format!("the {name} data are damaged (decoder: {text})"),
    }
}

/// Zeros become holes in the file, so that a bomb of zeros takes no disk space; its length must be set at the end.
fn write_sparse(out: &mut File, bytes: &[u8]) -> io::Result<()> {
    if is_zero(bytes) {
        return out.seek(SeekFrom::Current(bytes.len() as i64)).map(|_| ());
    }
    out.write_all(bytes)
}

/// Packed bytes of a file, and how many of them were consumed.
struct Packed<'r> {
    inner: BufReader<io::Take<At<'r>>>,
    at: &'r Cell<u64>,
}

impl<'r> Packed<'r> {
    fn new(file: &'r File, place: Range<u64>, at: &'r Cell<u64>) -> Packed<'r> {
        at.set(place.start);
        let bytes = At { file, next: place.start }.take(place.end - place.start);
        Packed { inner: BufReader::with_capacity(STEP, bytes), at }
    }
}

impl Read for Packed<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let got = self.fill_buf()?.read(buffer)?;
        self.consume(got);
        Ok(got)
    }
}

impl BufRead for Packed<'_> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        self.inner.fill_buf()
    }

    fn consume(&mut self, bytes: usize) {
        self.inner.consume(bytes);
        self.at.set(self.at.get() + bytes as u64);
    }
}

struct At<'r> {
    file: &'r File,
    next: u64,
}

impl Read for At<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let got = logscan::read_at(self.file, buffer, self.next)?;
        self.next += got as u64;
        Ok(got)
    }
}

fn beyond_any_ratio(packing: Packing) -> String {
    let name = packing.name();
    format!(
        "the {name} content is more than {MOST_TIMES} times as large as the packed file; no log is compressed so much"
    )
}
