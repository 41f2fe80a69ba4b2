//! The pages of a SQLite database, those in its write-ahead log first
//! (<https://www.sqlite.org/fileformat2.html>, sections 1.2, 1.3 and 4).
//!
//! Files are opened only for reading, and nothing is executed: a database on read-only media, one
//! whose log was never copied back, and a hostile one make no difference.

use super::wal::Wal;
use crate::error::LogError;
use logscan::read_exactly;
use std::fs::File;

/// Pages read in one go when they are read in order, bytes.
const READ_AHEAD: u32 = 256 << 10;
/// The magic of a database.
pub(super) const MAGIC: &[u8] = b"SQLite format 3\0";
/// Bytes of the header on the first page.
pub(super) const HEADER_BYTES: usize = 100;

/// The content of the first hundred bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Header {
    /// Bytes of a page, a power of two from 512 to 65536.
    pub(super) page_bytes: u32,
    /// Bytes of a page that hold content.
    pub(super) usable: u32,
    /// Pages of the database, `None` where the header is older than the file.
    pub(super) pages: Option<u32>,
    /// First page of the list of unused pages, and their number.
    pub(super) free: (u32, u32),
    /// Whether there are pointer map pages.
    pub(super) pointer_maps: bool,
    /// Text is UTF-16, big-endian if the inner value is true.
    pub(super) utf16: Option<bool>,
    /// The database was kept with a write-ahead log, which a recorder removes when it is closed.
    pub(super) write_ahead: bool,
}

impl Header {
    /// `None` if this is not a database, or its header is corrupt.
    pub(super) fn parse(head: &[u8]) -> Option<Header> {
        let page_bytes = stated_page_bytes(head).filter(|_| head.starts_with(MAGIC))?;
        let u32_at = |at: usize| head.get(at..)?.first_chunk().map(|b| u32::from_be_bytes(*b));
        let usable = page_bytes.checked_sub(u32::from(*head.get(20)?))?;
        // These three never change.
        if head.len() < HEADER_BYTES || usable < 480 || head.get(21..24) != Some(&[64, 32, 32]) {
            return None;
        }
        let current = u32_at(24)? == u32_at(92)?;
        Some(Header {
            page_bytes,
            usable,
            pages: u32_at(28).filter(|&pages| current && pages > 0),
            free: (u32_at(32)?, u32_at(36)?),
            pointer_maps: u32_at(52)? != 0,
            utf16: match u32_at(56)? {
                2 => Some(false),
                3 => Some(true),
                _ => None,
            },
            write_ahead: head.get(19) == Some(&2),
        })
    }

    /// The page with the lock byte, which holds no content.
    pub(super) fn lock_page(&self) -> u32 {
        (1 << 30) / self.page_bytes + 1
    }

    /// The pointer map pages up to `last`.
    pub(super) fn pointer_maps(&self, last: u32) -> impl Iterator<Item = u32> + use<> {
        let last = if self.pointer_maps { last } else { 0 };
        (2..=last).step_by(self.usable as usize / 5 + 1)
    }
}

/// The page size stated by the header; `None` if invalid.
fn stated_page_bytes(head: &[u8]) -> Option<u32> {
    let bytes = match u16::from_be_bytes(*head.get(16..)?.first_chunk()?) {
        1 => 65_536,
        bytes => u32::from(bytes),
    };
    (bytes.is_power_of_two() && bytes >= 512).then_some(bytes)
}

/// The pages of one database.
#[derive(Debug)]
pub(super) struct Pages {
    file: File,
    name: String,
    /// Bytes of the file.
    size: u64,
    pub(super) header: Header,
    wal: Option<Wal>,
    /// Pages in the write-ahead log after those of the file, in order.
    beyond: Vec<u32>,
    window: Vec<u8>,
    window_at: u64,
}

impl Pages {
    /// The pages of a file of `size` bytes. The header is read from the newest first page; `None` if that is corrupt.
    pub(super) fn open(file: File, name: String, size: u64, wal: Option<Wal>) -> Result<Option<Pages>, LogError> {
        let mut head = [0; HEADER_BYTES];
        if let Some((wal, at)) = wal.as_ref().and_then(|wal| Some((wal, wal.place(1)?))) {
            read_exactly(&wal.file, &wal.name, &mut head, at)?;
        } else if size >= HEADER_BYTES as u64 {
            read_exactly(&file, &name, &mut head, 0)?;
        }
        let Some(header) = Header::parse(&head) else { return Ok(None) };
        let mut pages = Pages { file, name, size, header, wal, beyond: vec![], window: vec![], window_at: 0 };
        let last = pages.last_in_file();
        pages.beyond = pages.wal.as_ref().map_or(vec![], |wal| wal.pages_behind(last));
        Ok(Some(pages))
    }

    /// Pages stated by the database, or by its length if it states none.
    pub(super) fn stated(&self) -> u32 {
        self.wal.as_ref().map(|wal| wal.pages).or(self.header.pages).unwrap_or(self.in_file())
    }

    /// Complete pages in the file.
    fn in_file(&self) -> u32 {
        u32::try_from(self.size / u64::from(self.header.page_bytes)).unwrap_or(u32::MAX - 1)
    }

    /// The last page of the file that is part of the database: a transaction in an intact write-ahead log may have made
    /// it shorter.
    fn last_in_file(&self) -> u32 {
        let sound = self.wal.as_ref().filter(|wal| wal.unfinished == 0);
        self.in_file().min(sound.map_or(u32::MAX, |wal| wal.pages))
    }

    /// Number of pages in the file and in its write-ahead log.
    pub(super) fn count(&self) -> usize {
        self.last_in_file() as usize + self.beyond.len()
    }

    /// The index of a page among the existing ones.
    pub(super) fn index(&self, page: u32) -> Option<usize> {
        let in_file = self.last_in_file();
        match page.checked_sub(1)? {
            index if index < in_file => Some(index as usize),
            _ => self.beyond.binary_search(&page).ok().map(|at| in_file as usize + at),
        }
    }

    /// The page at an index among the existing ones.
    pub(super) fn at(&self, index: usize) -> u32 {
        let beyond = index.checked_sub(self.last_in_file() as usize);
        match beyond {
            Some(at) => self.beyond.get(at).copied().unwrap_or(0),
            None => u32::try_from(index + 1).unwrap_or(0),
        }
    }

    /// Start of a page in the database file.
    fn offset(&self, page: u32) -> u64 {
        u64::from(page.saturating_sub(1)) * u64::from(self.header.page_bytes)
    }

    /// The bytes after the last whole page: their start and their number.
    pub(super) fn tail(&self) -> (u64, u64) {
        let whole = u64::from(self.in_file()) * u64::from(self.header.page_bytes);
        (whole, self.size - whole)
    }

    /// The file that holds the content of a page, and the position there.
    pub(super) fn place(&self, page: u32) -> (&str, u64) {
        let newer = self.wal.as_ref().and_then(|wal| Some((wal.name.as_str(), wal.place(page)?)));
        newer.unwrap_or((&self.name, self.offset(page)))
    }

    /// Whether the write-ahead log holds the content of a page.
    pub(super) fn is_in_wal(&self, page: u32) -> bool {
        self.wal.as_ref().is_some_and(|wal| wal.place(page).is_some())
    }

    /// Reads the pages from `first` to `last` in one go, unless the first is already held.
    pub(super) fn ahead(&mut self, first: u32, last: u32) -> Result<(), LogError> {
        let most = (READ_AHEAD / self.header.page_bytes).max(1);
        let last = last.min(first.saturating_add(most - 1)).min(self.in_file());
        if first == 0 || last < first || self.held(first).is_some() {
            return Ok(());
        }
        self.window.resize((last - first + 1) as usize * self.header.page_bytes as usize, 0);
        self.window_at = self.offset(first);
        Ok(read_exactly(&self.file, &self.name, &mut self.window, self.window_at)?)
    }

    /// Position of a page in the window.
    fn held(&self, page: u32) -> Option<std::ops::Range<usize>> {
        let at = usize::try_from(self.offset(page).checked_sub(self.window_at)?).ok()?;
        let end = at.checked_add(self.header.page_bytes as usize)?;
        (page > 0 && end <= self.window.len()).then_some(at..end)
    }

    /// Copies a page. False if there is no such page.
    pub(super) fn look(&mut self, page: u32, into: &mut Vec<u8>) -> Result<bool, LogError> {
        if let Some(held) = self.held(page).filter(|_| !self.is_in_wal(page)) {
            into.clear();
            into.extend_from_slice(self.window.get(held).unwrap_or_default());
            return Ok(true);
        }
        into.resize(self.header.page_bytes as usize, 0);
        self.start(page, into)
    }

    /// The first bytes of a page.
    fn start(&self, page: u32, into: &mut [u8]) -> Result<bool, LogError> {
        if let Some((wal, at)) = self.wal.as_ref().and_then(|wal| Some((wal, wal.place(page)?))) {
            read_exactly(&wal.file, &wal.name, into, at)?;
            return Ok(true);
        }
        if page == 0 || page > self.in_file() {
            return Ok(false);
        }
        if let Some(held) = self.held(page).and_then(|held| self.window.get(held)?.get(..into.len())) {
            into.copy_from_slice(held);
            return Ok(true);
        }
        read_exactly(&self.file, &self.name, into, self.offset(page))?;
        Ok(true)
    }

    /// The four bytes of an overflow page that name the next one.
    pub(super) fn link(&self, page: u32) -> Result<Option<u32>, LogError> {
        let mut bytes = [0; 4];
        Ok(self.start(page, &mut bytes)?.then(|| u32::from_be_bytes(bytes)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn head(change: &[(usize, &[u8])]) -> Vec<u8> {
        let mut head = vec![0; HEADER_BYTES];
        head[..16].copy_from_slice(MAGIC);
        head[16..18].copy_from_slice(&4096_u16.to_be_bytes());
        head[21..24].copy_from_slice(&[64, 32, 32]);
        head[28..32].copy_from_slice(&7_u32.to_be_bytes());
        for (at, bytes) in change {
            head[*at..at + bytes.len()].copy_from_slice(bytes);
        }
        head
    }

    #[test]
    fn a_page_size_of_65536_is_stored_as_one() {
        assert_eq!(Header::parse(&head(&[(16, &[0, 1])])).unwrap().page_bytes, 65_536);
    }

    #[test]
    fn an_impossible_header_is_rejected() {
        for change in [(16, &[0, 0][..]), (16, &[0, 3]), (16, &[1, 0]), (0, b"X"), (16, &[2, 0, 0, 0, 200]), (21, &[0])]
        {
            assert_eq!(Header::parse(&head(&[change])), None, "{change:?}");
        }
        assert_eq!(Header::parse(&head(&[])[..99]), None);
    }

    #[test]
    fn the_number_of_pages_counts_only_if_the_last_writer_wrote_it() {
        assert_eq!(Header::parse(&head(&[])).unwrap().pages, Some(7));
        assert_eq!(Header::parse(&head(&[(24, &[1])])).unwrap().pages, None);
    }
}
