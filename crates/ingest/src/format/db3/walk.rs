//! The walk over all pages of a database: which page belongs to what, the rows of its tables, and
//! those of pages that nothing leads to any more.
//!
//! A table is a tree; its leaves are listed first, from the pages above them, and then read in
//! order. Where a page above is damaged, the leaves below it are found by their look. In the end
//! every page belongs to something or is damaged.

use super::pages::Pages;
use super::tree::{Cell, Kind, Node};
use crate::bytes::is_zero;
use crate::decode::Tally;
use crate::error::IngestError;
use crate::format::MOST_ZEROS;
use crate::ledger::{Fate, Ledger};
use crate::reader::ReadContext;

/// SQLite's own trees are never deeper.
const DEEPEST: usize = 20;
/// Pages between two leaves that are read along with them, and leaves that are looked ahead at.
const MOST_BETWEEN: u32 = 4;
const MOST_AHEAD: usize = 64;

/// Pages that belong to something.
#[derive(Debug)]
struct Claims {
    bits: Vec<u64>,
    last: u32,
    count: u64,
}

impl Claims {
    fn new(last: u32) -> Claims {
        Claims { bits: vec![0; last as usize / 64 + 1], last, count: 0 }
    }

    fn has(&self, page: u32) -> bool {
        self.bits.get(page as usize / 64).is_some_and(|word| word >> (page % 64) & 1 == 1)
    }

    /// False if there is no such page, or if it belongs to something already.
    fn claim(&mut self, page: u32) -> bool {
        if page == 0 || page > self.last || self.has(page) {
            return false;
        }
        if let Some(word) = self.bits.get_mut(page as usize / 64) {
            *word |= 1 << (page % 64);
            self.count += 1;
        }
        true
    }
}

/// What is to be done with a row.
pub(super) enum Look {
    /// It is wanted whole.
    Wanted,
    /// It is one of this table and not wanted.
    Unwanted,
    /// It cannot be one of this table.
    Bad(&'static str),
}

/// Who is shown the rows of a table.
pub(super) trait Sink {
    /// A row as far as it is on its page.
    fn look(&mut self, cell: &Cell<'_>) -> Look;

    /// A whole row that was wanted.
    fn whole(&mut self, cell: &Cell<'_>, row: &[u8]) -> Fate;

    /// One that was not wanted and is there.
    fn unwanted(&mut self, cell: &Cell<'_>);
}

/// A walk in progress.
pub(super) struct Walk<'w, 'c> {
    pub(super) pages: Pages,
    ledger: &'w mut Ledger,
    context: &'w ReadContext<'c>,
    claims: Claims,
    /// The rest of rows that were not wanted: where it begins, and its bytes. It is walked only if
    /// the number of pages says that something is amiss.
    put_off: Vec<(u32, u64)>,
    pages_put_off: u64,
    index_leaves: Vec<u32>,
    /// Something leads nowhere: what is left is to be searched.
    pub(super) astray: bool,
    /// What became of rows and pages.
    pub(super) lost: Lost,
    page: Vec<u8>,
    link: Vec<u8>,
    row: Vec<u8>,
    told: u64,
}

/// What could not be read, and what was found without being led to it.
#[derive(Debug, Default)]
pub(super) struct Lost {
    /// Pages that the database should have beyond the end of the file.
    pub(super) missing_pages: u64,
    /// Rows on pages that can be read.
    pub(super) bad_rows: u64,
    /// Pages of rows to which nothing led.
    pub(super) found_pages: u64,
    /// Pages that belong to nothing.
    pub(super) stray_pages: u64,
}

impl<'w, 'c> Walk<'w, 'c> {
    pub(super) fn new(pages: Pages, ledger: &'w mut Ledger, context: &'w ReadContext<'c>) -> Self {
        let last = pages.last();
        let missing_pages = u64::from(pages.stated().saturating_sub(last));
        let mut walk = Walk {
            pages,
            ledger,
            context,
            claims: Claims::new(last),
            put_off: vec![],
            pages_put_off: 0,
            index_leaves: vec![],
            astray: missing_pages > 0,
            lost: Lost { missing_pages, ..Lost::default() },
            page: vec![],
            link: vec![],
            row: vec![],
            told: 0,
        };
        for page in walk.pages.header.special_pages(last) {
            walk.claims.claim(page);
        }
        walk
    }

    fn usable(&self) -> u32 {
        self.pages.header.usable
    }

    /// The unused pages; what stands on them is of no interest.
    pub(super) fn unused(&mut self) -> Result<(), IngestError> {
        let (mut trunk, stated) = self.pages.header.free;
        let before = self.claims.count;
        while trunk != 0 {
            if !self.claims.claim(trunk) || !self.pages.look(trunk, &mut self.page)? {
                self.astray = true;
                break;
            }
            let words = self.page.as_chunks::<4>().0.iter().map(|b| u32::from_be_bytes(*b));
            let count = words.clone().nth(1).unwrap_or(0) as usize;
            for leaf in words.clone().skip(2).take(count) {
                self.astray |= !self.claims.claim(leaf);
            }
            trunk = words.clone().next().unwrap_or(0);
        }
        self.astray |= self.claims.count - before != u64::from(stated);
        Ok(())
    }

    /// The leaves of a tree in order. All its pages are claimed.
    pub(super) fn leaves(&mut self, root: u32, table: bool) -> Result<Vec<u32>, IngestError> {
        let depth = self.depth(root, table)?;
        let mut leaves = vec![];
        let mut open = vec![(root, 0)];
        while let Some((page, at)) = open.pop() {
            if !self.claims.claim(page) {
                self.astray = true;
            } else if at == depth {
                leaves.push(page);
            } else {
                let children = self.children(page, table)?;
                if children.iter().all(|child| *child > self.pages.last()) {
                    self.astray = true;
                    self.damaged(page, "a page of a table's tree cannot be read");
                }
                open.extend(children.into_iter().rev().map(|child| (child, at + 1)));
            }
        }
        if !table {
            self.index_leaves.extend(&leaves);
        }
        Ok(leaves)
    }

    /// How many pages are above a leaf: along the first way down that is intact.
    fn depth(&mut self, root: u32, table: bool) -> Result<usize, IngestError> {
        let mut page = root;
        for depth in 0..DEEPEST {
            let mut below = None;
            let children = self.children(page, table)?;
            for &child in &children {
                if self.pages.look(child, &mut self.page)? && Node::parse(child, &self.page, self.usable()).is_some() {
                    below = Some(child);
                    break;
                }
            }
            match below {
                Some(child) => page = child,
                None => return Ok(depth + usize::from(!children.is_empty())),
            }
        }
        Ok(DEEPEST)
    }

    /// Whether a tree is that of an index: tables without row numbers are stored as one.
    pub(super) fn is_index(&mut self, root: u32) -> Result<bool, IngestError> {
        let there = self.pages.look(root, &mut self.page)?;
        let node = Node::parse(root, &self.page, self.usable()).filter(|_| there);
        Ok(node.is_some_and(|node| matches!(node.kind, Kind::IndexLeaf | Kind::IndexInterior)))
    }

    /// The pages below an interior page; none if it is a leaf, or damaged.
    fn children(&mut self, page: u32, table: bool) -> Result<Vec<u32>, IngestError> {
        let there = self.pages.look(page, &mut self.page)?;
        let kind = if table { Kind::TableInterior } else { Kind::IndexInterior };
        let node = Node::parse(page, &self.page, self.usable()).filter(|node| there && node.kind == kind);
        let Some(node) = node else { return Ok(vec![]) };
        let children: Vec<u32> = node.children().flatten().collect();
        self.astray |= children.len() <= node.len();
        Ok(children)
    }

    /// Shows the rows of leaves, one after the other.
    pub(super) fn read(&mut self, leaves: &[u32], sink: &mut dyn Sink) -> Result<(), IngestError> {
        for (index, &leaf) in leaves.iter().enumerate() {
            // Neighbours are read in one go; what lies between far ones is not wanted.
            let near = |pair: &&[u32]| matches!(pair, [a, b] if *b > *a && *b - *a <= MOST_BETWEEN);
            let rest = leaves.get(index..).unwrap_or_default();
            let run = rest.windows(2).take(MOST_AHEAD).take_while(near).count();
            self.pages.ahead(leaf, rest.get(run).copied().unwrap_or(leaf))?;
            self.rows(leaf, sink)?;
        }
        Ok(())
    }

    /// Shows the rows of a leaf.
    fn rows(&mut self, page: u32, sink: &mut dyn Sink) -> Result<(), IngestError> {
        let mut bytes = std::mem::take(&mut self.page);
        let there = self.pages.look(page, &mut bytes)?;
        let node = Node::parse(page, &bytes, self.usable()).filter(|node| there && node.kind == Kind::TableLeaf);
        match node {
            Some(node) => self.rows_of(page, &node, sink)?,
            None => self.damaged(page, "a page that should hold rows cannot be read"),
        }
        self.page = bytes;
        self.progress(self.claims.count + self.pages_put_off)
    }

    fn rows_of(&mut self, page: u32, node: &Node<'_>, sink: &mut dyn Sink) -> Result<(), IngestError> {
        // Rows that lie over each other would be a way to make much of little.
        let mut room = self.usable() as usize;
        let mut bad = Tally::default();
        let mut listed = 0;
        for index in 0..node.len() {
            let Some(cell) = node.row(index).filter(|cell| cell.local.len() <= room) else {
                bad.add(|| "it does not fit on its page".to_owned());
                continue;
            };
            listed += cell.extent;
            match self.take(&cell, sink)? {
                Ok(()) => room -= cell.local.len(),
                Err(why) => bad.add(|| why),
            }
        }
        if bad.count > 0 {
            self.lost.bad_rows += bad.count;
            self.astray = true;
            let good = self.usable() as usize - room;
            let reason =
                format!("{} of {} rows on a page cannot be read; the first: {}", bad.count, node.len(), bad.first);
            self.damaged_but(page, good as u64, &reason);
        } else if node.unlisted(listed) > 0 {
            let good = self.usable() as usize - room;
            self.damaged_but(page, good as u64, "a page of rows holds more than it lists");
        }
        Ok(())
    }

    /// Takes one row and accounts for its bytes.
    fn take(&mut self, cell: &Cell<'_>, sink: &mut dyn Sink) -> Result<Result<(), String>, IngestError> {
        match sink.look(cell) {
            Look::Bad(why) => return Ok(Err(why.to_owned())),
            Look::Wanted if cell.overflow == 0 => {
                let fate = sink.whole(cell, cell.local);
                self.ledger.count(fate, cell.length);
            }
            Look::Wanted => {
                if let Err(why) = self.gather(cell)? {
                    return Ok(Err(why));
                }
                let fate = sink.whole(cell, &self.row);
                self.ledger.count(fate, cell.length);
            }
            Look::Unwanted => {
                if let Err(why) = self.pass_over(cell)? {
                    return Ok(Err(why));
                }
                sink.unwanted(cell);
            }
        }
        Ok(Ok(()))
    }

    /// Puts a row together from its pages.
    fn gather(&mut self, cell: &Cell<'_>) -> Result<Result<(), String>, IngestError> {
        if cell.length > self.context.limits.record_bytes {
            let limit = self.context.limits.record_bytes;
            return Ok(Err(format!("its {} bytes are more than the limit of {limit}", cell.length)));
        }
        self.row.clear();
        self.row.extend_from_slice(cell.local);
        let room = self.usable() as usize - 4;
        let mut page = cell.overflow;
        let mut walked = vec![];
        while (self.row.len() as u64) < cell.length {
            let left = (cell.length - self.row.len() as u64).div_ceil(room as u64);
            self.pages.ahead(page, page.saturating_add(u32::try_from(left).unwrap_or(u32::MAX) - 1))?;
            if !self.claims.claim(page) || !self.pages.look(page, &mut self.link)? {
                return Ok(Err(self.broken(&walked)));
            }
            walked.push(page);
            let (next, content) = self.link.split_first_chunk::<4>().unwrap_or((&[0; 4], &[]));
            let here = room.min((cell.length - self.row.len() as u64) as usize);
            self.row.extend_from_slice(content.get(..here).unwrap_or_default());
            page = u32::from_be_bytes(*next);
        }
        Ok(Ok(()))
    }

    /// A row that is not wanted. The rest of it on other pages is walked only where something is astray.
    fn pass_over(&mut self, cell: &Cell<'_>) -> Result<Result<(), String>, IngestError> {
        let (local, pages) = (cell.local.len() as u64, cell.overflow_pages(self.usable()));
        if pages == 0 {
            self.ledger.count(Fate::Skipped, local);
            return Ok(Ok(()));
        }
        self.astray |= self.claims.count + self.pages_put_off + pages > self.pages.last().into();
        if !self.astray {
            self.ledger.count(Fate::Skipped, local);
            self.put_off.push((cell.overflow, cell.length - local));
            self.pages_put_off += pages;
            return Ok(Ok(()));
        }
        let (walked, whole) = self.chain(cell.overflow, cell.length - local)?;
        if !whole {
            return Ok(Err(self.broken(&walked)));
        }
        self.ledger.count(Fate::Skipped, cell.length);
        Ok(Ok(()))
    }

    /// Claims a chain of overflow pages of so many bytes; its pages, and whether it is whole.
    fn chain(&mut self, first: u32, bytes: u64) -> Result<(Vec<u32>, bool), IngestError> {
        let count = bytes.div_ceil(u64::from(self.usable()) - 4);
        let (mut page, mut walked) = (first, vec![]);
        while (walked.len() as u64) < count {
            let next = if self.claims.claim(page) { self.pages.link(page)? } else { None };
            let Some(next) = next else { return Ok((walked, false)) };
            walked.push(page);
            page = next;
        }
        Ok((walked, true))
    }

    fn broken(&mut self, walked: &[u32]) -> String {
        for &page in walked {
            self.damaged(page, "a part of a row whose other parts are not there");
        }
        "its rest on other pages is not there".to_owned()
    }

    /// Nothing on the page is of use.
    fn damaged(&mut self, page: u32, reason: &str) {
        self.damaged_but(page, 0, reason);
    }

    /// All of the page but so many bytes is of no use.
    fn damaged_but(&mut self, page: u32, good: u64, reason: &str) {
        let (file, at) = self.pages.place(page);
        let bytes = u64::from(self.pages.header.page_bytes) - good;
        self.ledger.damaged(file, at, bytes, reason);
    }

    /// Neighbours at once, where the write-ahead log does not hold them: there may be millions.
    fn damaged_run(&mut self, first: u32, count: u32) {
        let reason = "pages that belong to nothing that can be reached";
        let mut page = first;
        while page < first + count {
            let run = (page..first + count).take_while(|&p| !self.pages.is_in_wal(p)).count() as u32;
            if run == 0 {
                self.damaged(page, reason);
            } else {
                let bytes = u64::from(run) * u64::from(self.pages.header.page_bytes);
                let (file, at) = self.pages.place(page);
                self.ledger.damaged(file, at, bytes, reason);
            }
            page += run.max(1);
        }
    }

    fn progress(&mut self, pages: u64) -> Result<(), IngestError> {
        const STEP: u64 = 1 << 20;
        let done = pages * u64::from(self.pages.header.page_bytes);
        if done >= self.told + STEP {
            self.context.advance(done - self.told)?;
            self.told = done;
        }
        Ok(())
    }

    /// Bytes that have been told to be read.
    pub(super) fn told(&self) -> u64 {
        self.told
    }

    /// Pages to which nothing leads that `look` as if they held rows of a table, by the number of their
    /// first row. They are claimed.
    pub(super) fn found(&mut self, look: impl Fn(&Cell<'_>) -> bool) -> Result<Vec<(i64, u32)>, IngestError> {
        let mut found = vec![];
        self.unclaimed(|walk, page| {
            let node = Node::parse(page, &walk.page, walk.usable()).filter(|node| node.kind == Kind::TableLeaf);
            let Some(node) = node.filter(|node| node.len() > 0) else { return };
            let good = (0..node.len()).filter_map(|i| node.row(i)).filter(&look);
            let rowid = good.clone().next().map(|cell| cell.rowid);
            if let Some(rowid) = rowid.filter(|_| 2 * good.count() > node.len()) {
                found.push((rowid, page));
            }
        })?;
        found.sort_unstable();
        for &(_, page) in &found {
            self.claims.claim(page);
        }
        self.lost.found_pages += found.len() as u64;
        Ok(found)
    }

    /// First and last row of each leaf, for those that can be read.
    pub(super) fn spans(&mut self, leaves: &[u32]) -> Result<Vec<(i64, i64, u32)>, IngestError> {
        let mut spans = vec![];
        for &page in leaves {
            let there = self.pages.look(page, &mut self.page)?;
            let node = Node::parse(page, &self.page, self.usable()).filter(|node| there && node.len() > 0);
            let rowid = |node: &Node<'_>, index| node.row(index).map(|cell| cell.rowid);
            let span = node.and_then(|node| Some((rowid(&node, 0)?, rowid(&node, node.len() - 1)?)));
            // One that cannot be read keeps its place behind the one before.
            let (first, last) = span.unwrap_or(spans.last().map_or((i64::MIN, i64::MIN), |s: &(_, i64, _)| (s.1, s.1)));
            spans.push((first, last, page));
        }
        Ok(spans)
    }

    /// Calls `each` for the pages that belong to nothing, which are then in `self.page`.
    fn unclaimed(&mut self, mut each: impl FnMut(&mut Self, u32)) -> Result<(), IngestError> {
        let mut zeros = 0;
        for page in 1..=self.pages.last() {
            if self.claims.has(page) {
                continue;
            }
            self.pages.ahead(page, u32::MAX)?;
            if !self.pages.look(page, &mut self.page)? {
                continue;
            }
            if is_zero(&self.page) {
                zeros += u64::from(self.pages.header.page_bytes);
                if zeros > MOST_ZEROS {
                    return Ok(());
                }
            } else {
                zeros = 0;
                each(self, page);
            }
            if page % 256 == 0 {
                self.context.advance(0)?;
            }
        }
        Ok(())
    }

    /// Accounts for all pages that are left. `look` says what rows of interest look like: their pages are
    /// given back, for something may be made of them.
    pub(super) fn account(&mut self, look: impl Fn(&Cell<'_>) -> bool) -> Result<Vec<(i64, u32)>, IngestError> {
        let put_off = std::mem::take(&mut self.put_off);
        if !self.astray && self.claims.count + self.pages_put_off == u64::from(self.pages.last()) {
            self.ledger.count(Fate::Skipped, put_off.iter().map(|(_, bytes)| bytes).sum());
            return Ok(vec![]);
        }
        self.astray = true;
        self.pages_put_off = 0;
        for (first, bytes) in put_off {
            let (walked, whole) = self.chain(first, bytes)?;
            let there = (walked.len() as u64 * (u64::from(self.usable()) - 4)).min(bytes);
            self.ledger.count(Fate::Skipped, there);
            self.lost.bad_rows += u64::from(!whole);
        }
        self.index_overflow()?;
        self.found(look)
    }

    /// Indexes of long texts have overflow pages too.
    fn index_overflow(&mut self) -> Result<(), IngestError> {
        for leaf in std::mem::take(&mut self.index_leaves) {
            let mut bytes = vec![];
            self.pages.look(leaf, &mut bytes)?;
            match Node::parse(leaf, &bytes, self.usable()).filter(|node| node.kind == Kind::IndexLeaf) {
                Some(node) => {
                    for cell in (0..node.len()).filter_map(|i| node.entry(i)) {
                        self.chain(cell.overflow, cell.length - cell.local.len() as u64)?;
                    }
                }
                None => self.damaged(leaf, "a page of an index cannot be read"),
            }
        }
        Ok(())
    }

    /// What still belongs to nothing is damage.
    pub(super) fn conclude(&mut self) -> Result<(), IngestError> {
        if !self.astray {
            return Ok(());
        }
        let mut stray = 0;
        let mut page = 1;
        while page <= self.pages.last() {
            let run = (page..=self.pages.last()).take_while(|&p| self.claims.claim(p)).count() as u32;
            self.damaged_run(page, run);
            stray += u64::from(run);
            page += run + 1;
        }
        self.lost.stray_pages = stray;
        Ok(())
    }
}
