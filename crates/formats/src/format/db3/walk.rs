//! The walk over all pages of a database: the owner of each page, and the rows of its tables.
//!
//! A table is a tree. Its leaves are listed first, from the pages above them, and then read in
//! order. In the end every page has an owner or is damaged.

use super::pages::Pages;
use super::tree::{Cell, Kind, Node};
use crate::bytes::is_zero;
use crate::decode::Tally;
use crate::error::LogError;
use crate::reader::ReadContext;
use logscan::MOST_ZEROS;
use logscan::{Fate, Ledger};

/// SQLite's own trees are never deeper than this.
const DEEPEST: usize = 20;
/// Pages between two leaves that are read along with them, and maximum leaves read ahead.
const MOST_BETWEEN: u32 = 4;
const MOST_AHEAD: usize = 64;

const UNLISTED: &str = "a page of rows holds more than it lists";

/// A page that should hold rows, and the possible range of row numbers.
#[derive(Debug, Clone, Copy)]
pub(super) struct Leaf {
    page: u32,
    from: i64,
    up_to: i64,
}

impl Leaf {
    fn root(page: u32) -> Leaf {
        Leaf { page, from: i64::MIN, up_to: i64::MAX }
    }
}

/// What to do with a row.
pub(super) enum Look {
    /// The whole row is wanted.
    Wanted,
    /// It belongs to this table and is not wanted.
    Unwanted,
    /// It cannot belong to this table.
    Bad(&'static str),
}

/// A receiver of the rows of a table.
pub(super) trait Sink {
    /// The part of a row on its page.
    fn look(&mut self, cell: &Cell<'_>) -> Look;

    /// A whole wanted row.
    fn whole(&mut self, cell: &Cell<'_>, row: &[u8]) -> Fate;

    /// An unwanted row that is present.
    fn unwanted(&mut self, _: &Cell<'_>) {
        // Only messages are counted.
    }
}

/// A walk in progress.
pub(super) struct Walk<'w, 'c> {
    pub(super) pages: Pages,
    ledger: &'w mut Ledger,
    context: &'w ReadContext<'c>,
    /// Which pages have an owner, by their index among the existing ones; and how many do.
    claims: Vec<bool>,
    claimed: u64,
    /// The rest of unwanted rows: its start and its length in bytes. It is walked only if
    /// the number of pages shows that something is wrong.
    put_off: Vec<(u32, u64)>,
    pages_put_off: u64,
    index_pages: Vec<u32>,
    /// A reference is broken: the remaining pages must be accounted for one by one.
    astray: bool,
    /// The fate of rows and pages.
    pub(super) lost: Lost,
    page: Vec<u8>,
    link: Vec<u8>,
    row: Vec<u8>,
    reported: u64,
}

/// What could not be read.
#[derive(Debug, Default)]
pub(super) struct Lost {
    /// Pages that the database should have but that are missing.
    pub(super) missing_pages: u64,
    /// Positions of trees that refer to missing pages, or to pages of another owner.
    pub(super) dead_ends: u64,
    /// Rows on readable pages.
    pub(super) bad_rows: u64,
    /// The list of unused pages is wrong.
    pub(super) spare_pages: bool,
}

impl<'w, 'c> Walk<'w, 'c> {
    pub(super) fn new(pages: Pages, ledger: &'w mut Ledger, context: &'w ReadContext<'c>) -> Self {
        let missing_pages = u64::from(pages.stated()).saturating_sub(pages.count() as u64);
        let mut walk = Walk {
            claims: vec![false; pages.count()],
            claimed: 0,
            pages,
            ledger,
            context,
            put_off: vec![],
            pages_put_off: 0,
            index_pages: vec![],
            astray: missing_pages > 0,
            lost: Lost { missing_pages, ..Lost::default() },
            page: vec![],
            link: vec![],
            row: vec![],
            reported: 0,
        };
        walk.claim(walk.pages.header.lock_page());
        walk
    }

    fn usable(&self) -> u32 {
        self.pages.header.usable
    }

    /// False if the page does not exist, or already has an owner.
    fn claim(&mut self, page: u32) -> bool {
        let is_open = self.is_open(page);
        if let Some(claim) = self.pages.index(page).and_then(|index| self.claims.get_mut(index)) {
            self.claimed += u64::from(is_open);
            *claim = true;
        }
        is_open
    }

    /// Whether the page exists and has no owner.
    fn is_open(&self, page: u32) -> bool {
        self.pages.index(page).and_then(|index| self.claims.get(index)) == Some(&false)
    }

    /// The pointer map pages and the unused ones: their content does not matter. Pages of the trees
    /// are claimed before. A list of unused pages that contradicts them is not trusted.
    pub(super) fn unused(&mut self) -> Result<(), LogError> {
        let last = self.pages.at(self.pages.count().saturating_sub(1));
        for page in self.pages.header.pointer_maps(last) {
            self.claim(page);
        }
        let (mut trunk, stated) = self.pages.header.free;
        let most = self.usable() as usize / 4 - 2;
        let mut listed = vec![];
        while trunk != 0 && listed.len() <= stated as usize && self.pages.look(trunk, &mut self.page)? {
            let mut words = self.page.as_chunks::<4>().0.iter().map(|b| u32::from_be_bytes(*b));
            let next = words.next().unwrap_or(0);
            let count = words.next().map_or(0, |count| count as usize);
            listed.push(trunk);
            listed.extend(words.take(count.min(most)));
            trunk = next;
        }
        let is_sound = listed.len() == stated as usize && listed.iter().all(|page| self.is_open(*page));
        if is_sound {
            for page in listed {
                self.claim(page);
            }
        }
        self.lost.spare_pages = !is_sound;
        self.astray |= !is_sound;
        self.beyond_the_end()
    }

    /// Zeros after the pages that the database claims: preallocated room.
    fn beyond_the_end(&mut self) -> Result<(), LogError> {
        let stated = self.pages.stated() as usize;
        let beyond = self.pages.count().saturating_sub(stated);
        if beyond as u64 * u64::from(self.pages.header.page_bytes) > MOST_ZEROS {
            return Ok(());
        }
        for index in stated..stated + beyond {
            let page = self.pages.at(index);
            if self.pages.look(page, &mut self.page)? && is_zero(&self.page) {
                self.claim(page);
            }
        }
        Ok(())
    }

    /// The leaves of a tree in order. All its pages are claimed.
    pub(super) fn leaves(&mut self, root: u32, table: bool) -> Result<Vec<Leaf>, LogError> {
        let depth = self.depth(root, table)?;
        let mut leaves = vec![];
        let mut open = vec![(Leaf::root(root), 0)];
        while let Some((at, above)) = open.pop() {
            if !self.claim(at.page) {
                self.astray = true;
                self.lost.dead_ends += 1;
                continue;
            }
            let below = if above == depth { None } else { self.below(at, table)? };
            match below {
                Some(children) => {
                    // An index has entries there, too.
                    self.index_pages.extend((!table).then_some(at.page));
                    open.extend(children.into_iter().rev().map(|child| (child, above + 1)));
                }
                None => {
                    self.astray |= above != depth;
                    leaves.push(at);
                }
            }
        }
        if !table {
            self.index_pages.extend(leaves.iter().map(|leaf| leaf.page));
        }
        Ok(leaves)
    }

    /// Number of pages above a leaf: along the first intact way down.
    fn depth(&mut self, root: u32, table: bool) -> Result<usize, LogError> {
        let mut page = root;
        for depth in 0..DEEPEST {
            let Some(children) = self.below(Leaf::root(page), table)? else { return Ok(depth) };
            match self.first_node(&children)? {
                Some(child) => page = child,
                None => return Ok(depth + 1),
            }
        }
        Ok(DEEPEST)
    }

    fn first_node(&mut self, children: &[Leaf]) -> Result<Option<u32>, LogError> {
        for child in children {
            let there = self.pages.look(child.page, &mut self.page)?;
            if there && Node::parse(child.page, &self.page, self.usable()).is_some() {
                return Ok(Some(child.page));
            }
        }
        Ok(None)
    }

    /// The child pages of a tree page; `None` if it is a leaf, or not a page of such a tree.
    fn below(&mut self, at: Leaf, table: bool) -> Result<Option<Vec<Leaf>>, LogError> {
        let there = self.pages.look(at.page, &mut self.page)?;
        let kind = if table { Kind::TableInterior } else { Kind::IndexInterior };
        let node = Node::parse(at.page, &self.page, self.usable()).filter(|node| there && node.kind == kind);
        let Some(node) = node else { return Ok(None) };
        let children = children(&node, at, table);
        self.astray |= children.len() <= node.len();
        Ok(Some(children))
    }

    /// Passes on the rows of leaves, one after the other.
    pub(super) fn read(&mut self, leaves: &[Leaf], sink: &mut dyn Sink) -> Result<(), LogError> {
        (0..leaves.len()).try_for_each(|index| self.rows(leaves, index, sink))
    }

    /// Passes on the rows of the leaf at `index`.
    fn rows(&mut self, leaves: &[Leaf], index: usize, sink: &mut dyn Sink) -> Result<(), LogError> {
        let rest = leaves.get(index..).unwrap_or_default();
        let Some(&leaf) = rest.first() else { return Ok(()) };
        // Neighbours are read in one go; pages between distant ones are not wanted.
        let near = |pair: &&[Leaf]| matches!(pair, [a, b] if b.page > a.page && b.page - a.page <= MOST_BETWEEN);
        let run = rest.windows(2).take(MOST_AHEAD).take_while(near).count();
        self.pages.ahead(leaf.page, rest.get(run).copied().unwrap_or(leaf).page)?;
        let mut bytes = std::mem::take(&mut self.page);
        let there = self.pages.look(leaf.page, &mut bytes)?;
        match Node::parse(leaf.page, &bytes, self.usable()).filter(|node| there && node.kind == Kind::TableLeaf) {
            Some(node) => self.rows_of(leaf, &node, sink)?,
            None => {
                self.astray = true;
                self.damaged(leaf.page, "a page that should hold rows cannot be read");
            }
        }
        self.page = bytes;
        self.progress(self.claimed + self.pages_put_off)
    }

    fn rows_of(&mut self, leaf: Leaf, node: &Node<'_>, sink: &mut dyn Sink) -> Result<(), LogError> {
        let OnPage { bad, good, listed } = self.take_all(leaf, node, sink)?;
        self.lost.bad_rows += bad.count;
        self.astray |= bad.count > 0;
        if bad.count > 0 {
            let reason =
                format!("{} of {} rows on a page cannot be read; the first: {}", bad.count, node.len(), bad.first);
            self.damaged_but(leaf.page, good, &reason);
        } else if node.unlisted(listed) > 0 {
            self.astray = true;
            self.damaged_but(leaf.page, good, UNLISTED);
        }
        Ok(())
    }

    /// Takes the rows of a page, one by one: their numbers are in the range of the page, and increase.
    fn take_all(&mut self, leaf: Leaf, node: &Node<'_>, sink: &mut dyn Sink) -> Result<OnPage, LogError> {
        let mut page = OnPage::default();
        // Overlapping rows could inflate a small file.
        let mut room = self.usable() as usize;
        let mut next = leaf.from;
        for index in 0..node.len() {
            let Some(cell) = node.row(index).filter(|cell| cell.local.len() <= room) else {
                page.bad.add(|| "it does not fit on its page".to_owned());
                continue;
            };
            page.listed += cell.extent;
            if !(next..=leaf.up_to).contains(&cell.rowid) {
                page.bad.add(|| format!("its number {} does not belong there", cell.rowid));
                continue;
            }
            next = cell.rowid.saturating_add(1);
            match self.take(&cell, sink)? {
                Ok(()) => room -= cell.local.len(),
                Err(why) => page.bad.add(|| why),
            }
        }
        page.good = (self.usable() as usize - room) as u64;
        Ok(page)
    }

    /// Takes one row and accounts for its bytes.
    fn take(&mut self, cell: &Cell<'_>, sink: &mut dyn Sink) -> Result<Result<(), String>, LogError> {
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

    /// Assembles a row from its pages.
    fn gather(&mut self, cell: &Cell<'_>) -> Result<Result<(), String>, LogError> {
        if cell.length > self.context.limits.record_bytes {
            let limit = self.context.limits.record_bytes;
            return Ok(Err(format!("its {} bytes exceed the limit of {limit}", cell.length)));
        }
        self.row.clear();
        self.row.extend_from_slice(cell.local);
        let room = self.usable() as usize - 4;
        let mut page = cell.overflow;
        let mut walked = vec![];
        while (self.row.len() as u64) < cell.length {
            let left = (cell.length - self.row.len() as u64).div_ceil(room as u64);
            self.pages.ahead(page, page.saturating_add(u32::try_from(left).unwrap_or(u32::MAX) - 1))?;
            if !self.claim(page) {
                return Ok(Err(self.broken(&walked)));
            }
            walked.push(page);
            if !self.pages.look(page, &mut self.link)? {
                return Ok(Err(self.broken(&walked)));
            }
            let (next, content) = self.link.split_first_chunk::<4>().unwrap_or((&[0; 4], &[]));
            let here = room.min((cell.length - self.row.len() as u64) as usize);
            self.row.extend_from_slice(content.get(..here).unwrap_or_default());
            page = u32::from_be_bytes(*next);
        }
        // The last page of a row has no successor; if it has one, it belongs to a longer row.
        Ok(if page == 0 || walked.is_empty() { Ok(()) } else { Err(self.broken(&walked)) })
    }

    /// An unwanted row. The rest of it on other pages is walked only if something is wrong.
    fn pass_over(&mut self, cell: &Cell<'_>) -> Result<Result<(), String>, LogError> {
        let (local, pages) = (cell.local.len() as u64, cell.overflow_pages(self.usable()));
        if pages == 0 {
            self.ledger.count(Fate::Skipped, local);
            return Ok(Ok(()));
        }
        self.astray |= self.claimed + self.pages_put_off + pages > self.pages.count() as u64;
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

    /// Claims a chain of overflow pages of this many bytes. Returns its pages, and whether it is complete.
    fn chain(&mut self, first: u32, bytes: u64) -> Result<(Vec<u32>, bool), LogError> {
        let count = bytes.div_ceil(u64::from(self.usable()) - 4);
        let (mut page, mut walked) = (first, vec![]);
        while (walked.len() as u64) < count {
            let next = if self.claim(page) { self.pages.link(page)? } else { None };
            let Some(next) = next else { return Ok((walked, false)) };
            walked.push(page);
            page = next;
        }
        let whole = page == 0 || walked.is_empty();
        Ok((walked, whole))
    }

    /// A row whose remaining pages do not hold its rest.
    fn broken(&mut self, walked: &[u32]) -> String {
        for &page in walked {
            self.damaged(page, "a part of a row whose other parts are missing");
        }
        "the rest of it, on other pages, is missing".to_owned()
    }

    /// Nothing on the page is usable.
    fn damaged(&mut self, page: u32, reason: &str) {
        self.damaged_but(page, 0, reason);
    }

    /// All but this many bytes of the page are unusable.
    fn damaged_but(&mut self, page: u32, good: u64, reason: &str) {
        let (file, at) = self.pages.place(page);
        let bytes = u64::from(self.pages.header.page_bytes) - good;
        self.ledger.damaged(file, at, bytes, reason);
    }

    /// Neighbours at once, unless the write-ahead log holds them: there may be millions.
    fn damaged_run(&mut self, pages: std::ops::Range<usize>) {
        let reason = "pages without a reference to them";
        let mut index = pages.start;
        while index < pages.end {
            let page = self.pages.at(index);
            let run = (index..pages.end).take_while(|&i| !self.pages.is_in_wal(self.pages.at(i))).count();
            if run == 0 {
                self.damaged(page, reason);
            } else {
                let bytes = run as u64 * u64::from(self.pages.header.page_bytes);
                let (file, at) = self.pages.place(page);
                self.ledger.damaged(file, at, bytes, reason);
            }
            index += run.max(1);
        }
    }

    fn progress(&mut self, pages: u64) -> Result<(), LogError> {
        const STEP: u64 = 1 << 20;
        let done = pages * u64::from(self.pages.header.page_bytes);
        if done >= self.reported + STEP {
            self.context.advance(done - self.reported)?;
            self.reported = done;
        }
        Ok(())
    }

    /// Bytes that have been reported as read.
    pub(super) fn reported(&self) -> u64 {
        self.reported
    }

    /// Accounts for all remaining pages: those that still have no owner are damage.
    pub(super) fn account(&mut self) -> Result<(), LogError> {
        let put_off = std::mem::take(&mut self.put_off);
        if !self.astray && self.claimed + self.pages_put_off == self.pages.count() as u64 {
            self.ledger.count(Fate::Skipped, put_off.iter().map(|(_, bytes)| bytes).sum());
            return Ok(());
        }
        self.astray = true;
        self.pages_put_off = 0;
        for (first, bytes) in put_off {
            let (walked, whole) = self.chain(first, bytes)?;
            if whole {
                self.ledger.count(Fate::Skipped, bytes);
            } else {
                self.lost.bad_rows += 1;
                self.broken(&walked);
            }
        }
        self.index_overflow()?;
        let mut index = 0;
        while index < self.pages.count() {
            let run = self.claims.iter().skip(index).take_while(|is_claimed| !**is_claimed).count();
            self.damaged_run(index..index + run);
            index += run + 1;
        }
        Ok(())
    }

    /// Indexes of long texts have overflow pages too.
    fn index_overflow(&mut self) -> Result<(), LogError> {
        for page in std::mem::take(&mut self.index_pages) {
            let mut bytes = vec![];
            self.pages.look(page, &mut bytes)?;
            match Node::parse(page, &bytes, self.usable()).filter(|node| node.is_index()) {
                Some(node) => {
                    for cell in (0..node.len()).filter_map(|i| node.entry(i)) {
                        self.chain(cell.overflow, cell.length - cell.local.len() as u64)?;
                    }
                }
                None => self.damaged(page, "a page of an index cannot be read"),
            }
        }
        Ok(())
    }
}

/// The fate of the rows of a page.
#[derive(Default)]
struct OnPage {
    bad: Tally,
    /// Bytes of the rows that were taken.
    good: u64,
    /// Bytes of the rows that the page lists.
    listed: usize,
}

/// The child pages of a page, each with its possible range of row numbers.
fn children(node: &Node<'_>, at: Leaf, table: bool) -> Vec<Leaf> {
    let mut from = at.from;
    let child = |(page, key): (u32, Option<i64>)| {
        if !table {
            return Leaf::root(page);
        }
        let up_to = key.map_or(at.up_to, |key| key.min(at.up_to));
        let child = Leaf { page, from, up_to };
        from = up_to.saturating_add(1);
        child
    };
    node.children().flatten().map(child).collect()
}
