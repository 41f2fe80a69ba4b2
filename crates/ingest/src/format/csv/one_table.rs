//! One table in a file: a header, perhaps a units line, and rows below. The header may be repeated between the rows.

use super::ahead::Rules;
use super::columns::Topic;
use super::header::{Changes, Header};
use super::layout::TableLayout;
use super::lines::{Extent, comment_mark};
use super::plain::Cutter;
use super::{Between, Books, EXTRAS, Open, bare, fields, remark_of, unmarked, without_bom};
use crate::error::IngestError;
use crate::format::crew::Crew;
use flight::{Code, Notices, Severity};
use std::sync::Arc;

/// A table while its rows are read.
pub(super) struct OneTable<'t> {
    layout: &'t TableLayout,
    pub(super) topic: Topic,
    header: Arc<Header>,
    /// How plain rows are read; `None` while rows are examined one by one.
    rules: Option<Rules>,
    /// Rules made so far.
    made: u64,
    /// Longest line, bytes.
    longest: usize,
    changes: Changes,
    /// Whether the header is a comment.
    is_marked: bool,
    /// The line of units.
    units: Vec<u8>,
    /// Whether the previous line repeats a header.
    behind_header: bool,
    /// Lines before the header.
    preamble: u64,
    /// Repeated headers.
    repeated: u64,
}

impl<'t> OneTable<'t> {
    pub(super) fn new(layout: &'t TableLayout, topic: Topic, longest: usize) -> OneTable<'t> {
        let mut table = OneTable {
            layout,
            topic,
            header: Arc::default(),
            rules: None,
            made: 0,
            longest,
            changes: Changes::default(),
            is_marked: false,
            units: vec![],
            behind_header: false,
            preamble: 0,
            repeated: 0,
        };
        table.renew_rules();
        table
    }

    /// Reads all lines of the file.
    pub(super) fn read(
        &mut self,
        books: &mut Books,
        open: &mut Open<'_>,
        crew: Option<&Crew>,
    ) -> Result<(), IngestError> {
        loop {
            if let Some(rules) = self.rules.as_mut().filter(|_| open.lines.number >= self.layout.first_row_line) {
                let line = open.lines.number;
                books.plain_rows(open, &mut self.topic, rules, crew)?;
                self.behind_header &= open.lines.number == line;
            }
            let Some((extent, line)) = books.next_record(open, self.layout.delimiter)? else { return Ok(()) };
            self.head(open, extent, line);
            self.line(books, open, extent, line);
        }
    }

    /// What was noticed of the whole table.
    pub(super) fn tell(&self, file: &str, notices: &mut Notices) {
        self.changes.tell(file, notices);
        if let Some((first, rows)) = self.layout.other_rows {
            let text = format!(
                "rows of another table, from line {first} on, come before this table; they are not \
                read"
            );
            notices.push(Code::IrregularTable.at(Severity::Loss), file, rows, text);
        }
        if self.topic.rows == 0 && self.layout.header_line.is_some() {
            notices.push(Code::NoRows, file, 1, "a header without rows");
        }
        if self.repeated > 0 {
            let text = "the header is repeated between the rows";
            notices.push(Code::IrregularTable, file, self.repeated, text);
        }
        if self.preamble > 0 {
            let text = "lines before the header were skipped";
            notices.push(Code::Skipped, file, self.preamble, text);
        }
    }

    fn renew_rules(&mut self) {
        // Rows below another header are skipped one by one.
        let topic = &self.topic;
        let plain = topic.decoded && self.layout.delimiter != fields::BLANKS && !topic.is_lost;
        self.made += 1;
        self.rules = plain.then(|| Rules {
            number: self.made,
            cutter: Cutter::new(self.layout.delimiter, topic.width, &topic.places(), &self.header),
            header: Arc::clone(&self.header),
            longest: self.longest,
        });
    }

    /// Takes names and units from the lines that hold them.
    fn head(&mut self, open: &mut Open<'_>, extent: Extent, line: u64) {
        let delimiter = self.layout.delimiter;
        // Where files were concatenated, a comment mark may precede a header.
        let mark = comment_mark(trimmed(open, extent));
        if self.layout.header_line == Some(line) {
            // Names may be missing at the beginning of the line.
            let whole = open.lines.text(extent);
            let names = if mark > 0 { unmarked(without_bom(whole.trim_ascii_start())) } else { without_bom(whole) };
            open.fields.split(names, delimiter);
            let numbers = self.layout.numbers.clone();
            self.header = Arc::new(Header::new(bare(open.lines.text(extent)), &open.fields, delimiter, numbers));
            self.renew_rules();
            self.is_marked = mark > 0;
        }
        if self.layout.units_line == Some(line) {
            self.units = trimmed(open, extent).to_vec();
            // Cells may be empty at the beginning of the line.
            let whole = open.lines.text(extent);
            let cells = if mark > 0 { unmarked(without_bom(whole.trim_ascii())) } else { without_bom(whole) };
            open.fields.split(cells, delimiter);
            self.topic.units = open.fields.texts();
        }
        if line < self.layout.first_row_line && !self.units.is_empty() {
            // Nobody else has the header before the first row.
            drop(self.rules.take());
            let begin = self.units.split(|b| *b == delimiter).next().unwrap_or_default().trim_ascii();
            Arc::get_mut(&mut self.header).into_iter().for_each(|header| header.has_units(begin));
            self.renew_rules();
        }
    }

    /// Decides what a line is: a row, another header, the header repeated, or something else.
    fn line(&mut self, books: &mut Books, open: &mut Open<'_>, extent: Extent, line: u64) {
        let text = trimmed(open, extent);
        let is_comment = comment_mark(text) > 0;
        let is_plain = !text.is_empty() && !is_comment;
        let is_row = line >= self.layout.first_row_line;
        let again = is_row && self.header.is(bare(open.lines.text(extent)));
        let again_units = is_row && self.behind_header && !self.units.is_empty() && text == self.units;
        self.behind_header = again;
        if is_comment && is_row && !again {
            if self.is_marked && matches!(self.other_header(books, open, extent), Between::Header) {
                return;
            }
            open.fields.split(without_bom(open.lines.text(extent).trim_ascii()), self.layout.delimiter);
            if !self.is_marked && self.header.is_like_row(&open.fields) {
                self.changes.remark(line);
            }
            books.structure(open, extent);
        } else if !is_plain || again || again_units || !is_row {
            if !is_row {
                self.before_rows(books, open, extent, line, is_plain);
            }
            if again {
                self.repeated += 1;
                self.topic.is_lost = false;
                self.renew_rules();
            }
            books.structure(open, extent);
        } else if let Between::Row { is_split } = self.other_header(books, open, extent) {
            books.row(open, extent, &mut self.topic, 0, self.layout.delimiter, is_split);
        }
    }

    /// Checks whether the line is another header.
    fn other_header(&mut self, books: &mut Books, open: &mut Open<'_>, extent: Extent) -> Between {
        let between = books.other_header(open, extent, &mut self.topic, &self.header, &mut self.changes);
        if matches!(between, Between::Header) {
            self.renew_rules();
            self.behind_header = true;
        }
        between
    }

    /// Keeps a remark before the rows, and counts what is neither a remark nor a header.
    fn before_rows(&mut self, books: &mut Books, open: &Open<'_>, extent: Extent, line: u64, is_plain: bool) {
        let remark = remark_of(trimmed(open, extent)).filter(|_| books.health.extras.len() < EXTRAS);
        books.health.extras.extend(remark);
        let is_head = [self.layout.header_line, self.layout.units_line].contains(&Some(line));
        self.preamble += u64::from(is_plain && !is_head);
    }
}

fn trimmed<'l>(open: &'l Open<'_>, extent: Extent) -> &'l [u8] {
    without_bom(open.lines.text(extent).trim_ascii())
}
