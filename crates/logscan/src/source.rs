//! A file read by position into one reused buffer. Never memory-mapped: a mapped file that shrinks
//! kills the process, and its pages count as our memory.

use crate::bytes::is_zero;
use crate::error::ScanError;
use crate::limits::{MOST_ZEROS, ReadContext};
use crate::platform::read_exact_at;
use std::fs::File;
use std::io;
use std::path::Path;
use std::sync::Arc;

/// Bytes fetched at once during a sequence of small requests.
const READ_AHEAD: usize = 256 << 10;
/// Bytes fetched after a jump, or after a large request: the next one may be close. Each further
/// fetch is four times as large.
const FIRST_AHEAD: usize = 512;
/// A step of up to this length is not a jump: the disk reads these bytes anyway.
const LONGEST_STEP: u64 = 64 << 10;
/// Bytes before the requested ones that stay in the buffer: after a look ahead, the walk resumes where it was.
const KEPT_BEHIND: u64 = 4 << 10;
/// Bytes between two progress reports and checks for a stop request.
const PROGRESS_STEP: u64 = 1 << 20;

/// What is scanned: a file, or bytes in memory.
pub trait Source {
    /// Total size, bytes.
    fn size(&self) -> u64;

    /// `length` bytes at `offset`; `None` if the source ends earlier.
    ///
    /// # Errors
    /// If the source cannot be read.
    fn bytes(&mut self, offset: u64, length: usize) -> Result<Option<&[u8]>, ScanError>;

    /// The buffered bytes from `offset` on: `least` bytes, or all up to the end. If fewer are buffered, fetches `most`.
    ///
    /// # Errors
    /// If the source cannot be read.
    fn ahead(&mut self, offset: u64, least: usize, most: usize) -> Result<&[u8], ScanError>;

    /// Up to `most` bytes, fewer at the end of the source.
    ///
    /// # Errors
    /// If the source cannot be read.
    fn up_to(&mut self, offset: u64, most: usize) -> Result<&[u8], ScanError> {
        let there = self.size().saturating_sub(offset).min(most as u64) as usize;
        Ok(self.bytes(offset, there)?.unwrap_or_default())
    }

    /// Reports that the walk has reached `offset`.
    ///
    /// # Errors
    /// If the user requested a stop.
    fn progress(&mut self, _offset: u64, _context: &ReadContext<'_>) -> Result<(), ScanError> {
        Ok(())
    }

    /// The file, if the source is one.
    fn file(&mut self) -> Option<&mut LogFile> {
        None
    }
}

impl Source for LogFile {
    fn size(&self) -> u64 {
        self.size
    }

    fn bytes(&mut self, offset: u64, length: usize) -> Result<Option<&[u8]>, ScanError> {
        let Some(end) = offset.checked_add(length as u64).filter(|&end| end <= self.size) else { return Ok(None) };
        if offset < self.start || end > self.start + self.filled as u64 {
            self.fill(offset, length)?;
        }
        let at = (offset - self.start) as usize;
        Ok(self.buffer.get(at..at + length))
    }

    fn ahead(&mut self, offset: u64, least: usize, most: usize) -> Result<&[u8], ScanError> {
        let left = self.size.saturating_sub(offset);
        let [least, most] = [least, most].map(|count| left.min(count as u64) as usize);
        let end = self.start + self.filled as u64;
        if offset < self.start || offset + least as u64 > end {
            self.fill(offset, most)?;
        }
        let at = (offset - self.start) as usize;
        Ok(self.buffer.get(at..self.filled).unwrap_or_default())
    }

    fn progress(&mut self, offset: u64, context: &ReadContext<'_>) -> Result<(), ScanError> {
        if offset >= self.reported + PROGRESS_STEP || (offset == self.size && offset > self.reported) {
            let more = offset - self.reported;
            self.reported = offset;
            context.advance(more)?;
        }
        Ok(())
    }

    fn file(&mut self) -> Option<&mut LogFile> {
        Some(self)
    }
}

impl Source for &[u8] {
    fn size(&self) -> u64 {
        self.len() as u64
    }

    fn bytes(&mut self, offset: u64, length: usize) -> Result<Option<&[u8]>, ScanError> {
        let start = usize::try_from(offset).ok();
        Ok(start.and_then(|start| self.get(start..start.checked_add(length)?)))
    }

    fn ahead(&mut self, offset: u64, _least: usize, most: usize) -> Result<&[u8], ScanError> {
        self.up_to(offset, most)
    }
}

/// An open log file. Its size is fixed when it is opened.
#[derive(Debug)]
pub struct LogFile {
    file: Arc<File>,
    name: Arc<str>,
    size: u64,
    buffer: Vec<u8>,
    filled: usize,
    start: u64,
    ahead: usize,
    longest_step: u64,
    reported: u64,
}

impl LogFile {
    /// Opens a regular file.
    ///
    /// # Errors
    /// If it is not a regular file, or cannot be opened.
    pub fn open(path: &Path) -> Result<LogFile, ScanError> {
        let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
        let io_error = |source| ScanError::Io { file: name.clone(), offset: 0, source };
        // Examined before it is opened: opening a pipe would wait for its writer.
        if !std::fs::metadata(path).map_err(io_error)?.is_file() {
            return Err(ScanError::NotAFile { file: name });
        }
        let file = File::open(path).map_err(io_error)?;
        let size = file.metadata().map_err(io_error)?.len();
        Ok(LogFile::new(Arc::new(file), name.into(), size))
    }

    fn new(file: Arc<File>, name: Arc<str>, size: u64) -> LogFile {
        LogFile {
            file,
            name,
            size,
            buffer: vec![],
            filled: 0,
            start: 0,
            ahead: FIRST_AHEAD,
            longest_step: LONGEST_STEP,
            reported: 0,
        }
    }

    /// Another handle to the same file, with its own buffer.
    pub fn again(&self) -> LogFile {
        LogFile::new(Arc::clone(&self.file), Arc::clone(&self.name), self.size)
    }

    /// Swaps buffers with another handle to the same file.
    pub fn swap_buffer(&mut self, other: &mut LogFile) {
        std::mem::swap(&mut self.buffer, &mut other.buffer);
        std::mem::swap(&mut self.start, &mut other.start);
        std::mem::swap(&mut self.filled, &mut other.filled);
        self.ahead = FIRST_AHEAD;
    }

    /// From now on only requested bytes are fetched: every step over something is a jump.
    pub fn expect_jumps(&mut self) {
        self.longest_step = 0;
    }

    /// Memory used by the buffer, bytes.
    pub fn held(&self) -> usize {
        self.buffer.capacity()
    }

    /// Name without its folder.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Reads a few bytes without moving the buffer, for looks far ahead.
    pub fn peek<const N: usize>(&mut self, offset: u64) -> Result<Option<[u8; N]>, ScanError> {
        if offset.checked_add(N as u64).is_none_or(|end| end > self.size) {
            return Ok(None);
        }
        let held = offset.checked_sub(self.start).and_then(|at| self.buffer.get(at as usize..self.filled));
        if let Some(bytes) = held.and_then(|held| held.first_chunk::<N>()) {
            return Ok(Some(*bytes));
        }
        let mut bytes = [0; N];
        self.read(&mut bytes, offset)?;
        Ok(Some(bytes))
    }

    /// The position after the next LF at or after `from`, and `true`. Without an LF, `false` and the end of the file,
    /// or of the part that was examined because only zeros follow.
    pub fn line_end(&mut self, from: u64, context: &ReadContext<'_>) -> Result<(u64, bool), ScanError> {
        let (mut at, mut zeros) = (from, 0);
        while at < self.size && zeros <= MOST_ZEROS {
            let block = self.up_to(at, READ_AHEAD)?;
            if let Some(end) = memchr::memchr(b'\n', block) {
                return Ok((at + end as u64 + 1, true));
            }
            zeros = if is_zero(block) { zeros + block.len() as u64 } else { 0 };
            at += block.len() as u64;
            self.progress(at, context)?;
        }
        Ok((self.size, false))
    }

    /// Makes the buffer hold at least `length` bytes at `offset`. The file must have them.
    fn fill(&mut self, offset: u64, length: usize) -> Result<(), ScanError> {
        let end = self.start + self.filled as u64;
        let jump = offset < self.start || offset > end + self.longest_step;
        let alone = jump || length >= READ_AHEAD;
        self.ahead = if alone { FIRST_AHEAD } else { READ_AHEAD.min(4 * self.ahead) };
        let held = (self.start..=end).contains(&offset);
        let front = if held { self.start.max(offset.saturating_sub(KEPT_BEHIND)) } else { offset };
        let kept = self.keep_from(front);
        let wanted = (self.size - offset).min(length.max(self.ahead) as u64) as usize + (offset - front) as usize;
        if self.buffer.len() < wanted {
            self.buffer.resize(wanted, 0);
        }
        let mut buffer = std::mem::take(&mut self.buffer);
        let result = self.read(buffer.get_mut(kept..wanted).unwrap_or_default(), front + kept as u64);
        self.buffer = buffer;
        result?;
        self.filled = wanted;
        Ok(())
    }

    fn read(&self, space: &mut [u8], from: u64) -> Result<(), ScanError> {
        read_exactly(&self.file, &self.name, space, from)
    }

    /// Moves the buffered bytes from `offset` on to the front of the buffer; returns their number.
    fn keep_from(&mut self, offset: u64) -> usize {
        let held = self.start..self.start + self.filled as u64;
        let kept = if held.contains(&offset) { (held.end - offset) as usize } else { 0 };
        self.buffer.copy_within(self.filled - kept..self.filled, 0);
        self.start = offset;
        self.filled = kept;
        kept
    }
}

/// Fills `space` from a position in the file that existed when the file was opened.
pub fn read_exactly(file: &File, name: &str, space: &mut [u8], from: u64) -> Result<(), ScanError> {
    read_exact_at(file, space, from).map_err(|source| match source.kind() {
        io::ErrorKind::UnexpectedEof => ScanError::Changed { file: name.to_owned() },
        _ => ScanError::Io { file: name.to_owned(), offset: from, source },
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    #[test]
    fn any_range_reads_the_bytes_of_the_file() {
        let content: Vec<u8> =
            (0..3 * READ_AHEAD as u32 + 17).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
        let mut on_disk = tempfile::NamedTempFile::new().unwrap();
        on_disk.write_all(&content).unwrap();
        let mut file = LogFile::open(on_disk.path()).unwrap();
        let mut seed = 1_u64;
        for _ in 0..2000 {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            let offset = (seed >> 33) as usize % (content.len() + 10);
            let length = (seed >> 11) as usize % (READ_AHEAD * 2);
            assert_eq!(file.bytes(offset as u64, length).unwrap(), content.get(offset..offset + length));
            let far = (seed >> 20) as usize % (content.len() + 10);
            let peeked = file.peek::<9>(far as u64).unwrap();
            assert_eq!(peeked.as_ref().map(<[u8; 9]>::as_slice), content.get(far..far + 9));
        }
        assert_eq!(file.bytes(u64::MAX, 2).unwrap(), None);
    }

    #[test]
    fn a_file_that_shrinks_is_an_error_and_not_a_crash() {
        let mut on_disk = tempfile::NamedTempFile::new().unwrap();
        on_disk.write_all(&[7; 4096]).unwrap();
        let mut file = LogFile::open(on_disk.path()).unwrap();
        on_disk.as_file().set_len(100).unwrap();
        assert!(matches!(file.bytes(50, 1000), Err(ScanError::Changed { .. })));
    }

    #[test]
    fn a_folder_is_rejected_as_a_log() {
        assert!(matches!(LogFile::open(Path::new("/")), Err(ScanError::NotAFile { .. })));
    }
}
