//! One table in a file: a header, perhaps a units line, and rows below. The header may be repeated between the rows.

use super::columns::Topic;
use super::extent::Extent;
use super::header::{Header, HeaderFindings};
use super::layout::TableLayout;
use super::plain::RowSplitter;
use super::plain::comment_mark;
use super::read_ahead::Rules;
use super::{Accounting, EXTRAS, Open, RowOrHeader, fields, remark_of, trimmed_header, unmarked, without_bom};
use crate::error::LogError;
use crate::format::workers::Workers;
use flight::{Code, Notices, Severity};
use std::sync::Arc;

/// A table while its rows are read.
pub(super) struct OneTable<'t> {
    layout: &'t TableLayout,
    pub(super) topic: Topic,
    header: Arc<Header>,
    /// How plain rows are read; `None` while rows are examined one by one.
    rules: Option<Rules>,
    /// The number of rules made so far.
    rules_made: u64,
    /// The length limit of a line, bytes.
    longest: usize,
    findings: HeaderFindings,
    /// Whether the header is a comment.
    is_marked: bool,
    /// The line of units.
    units: Vec<u8>,
    /// Whether the previous line repeats a header.
    after_header: bool,
    /// The number of lines before the header.
    preamble: u64,
    /// The number of repeated headers.
    repeated: u64,
}

impl<'t> OneTable<'t> {
    pub(super) fn new(layout: &'t TableLayout, topic: Topic, longest: usize) -> OneTable<'t> {
        let mut table = OneTable {
            layout,
            topic,
            header: Arc::default(),
            rules: None,
            rules_made: 0,
            longest,
            findings: HeaderFindings::default(),
            is_marked: false,
            units: vec![],
            after_header: false,
            preamble: 0,
            repeated: 0,
        };
        table.renew_rules();
        table
    }

    /// Reads all lines of the file.
    pub(super) fn read(
        &mut self,
        accounting: &mut Accounting,
        open: &mut Open<'_>,
        workers: Option<&Workers>,
    ) -> Result<(), LogError> {
        loop {
            if let Some(rules) = self.rules.as_mut().filter(|_| open.lines.number >= self.layout.first_row_line) {
                let line = open.lines.number;
                accounting.plain_rows(open, &mut self.topic, rules, workers)?;
                self.after_header &= open.lines.number == line;
            }
            let Some((extent, line)) = accounting.next_record(open, self.layout.delimiter)? else { return Ok(()) };
            self.head(open, extent, line);
            self.line(accounting, open, extent, line);
        }
    }

    /// Reports what was found in the whole table.
    pub(super) fn report(&self, file: &str, notices: &mut Notices) {
        self.findings.report(file, notices);
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
        let plain = topic.decoded && self.layout.delimiter != fields::BLANKS && !topic.is_below_other_header;
        self.rules_made += 1;
        self.rules = plain.then(|| Rules {
            number: self.rules_made,
            splitter: RowSplitter::new(self.layout.delimiter, topic.width, &topic.places(), &self.header),
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
            self.header =
                Arc::new(Header::new(trimmed_header(open.lines.text(extent)), &open.fields, delimiter, numbers));
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
            // Before the first row no rules of other threads share the header.
            drop(self.rules.take());
            let begin = self.units.split(|b| *b == delimiter).next().unwrap_or_default().trim_ascii();
            Arc::get_mut(&mut self.header).into_iter().for_each(|header| header.set_units(begin));
            self.renew_rules();
        }
    }

    /// Reads a line: a row, another header, the header repeated, or something else.
    fn line(&mut self, accounting: &mut Accounting, open: &mut Open<'_>, extent: Extent, line: u64) {
        let text = trimmed(open, extent);
        let is_comment = comment_mark(text) > 0;
        let is_plain = !text.is_empty() && !is_comment;
        let is_row = line >= self.layout.first_row_line;
        let is_repeated = is_row && self.header.is(trimmed_header(open.lines.text(extent)));
        let is_repeated_units = is_row && self.after_header && !self.units.is_empty() && text == self.units;
        self.after_header = is_repeated;
        if is_comment && is_row && !is_repeated {
            if self.is_marked && matches!(self.other_header(accounting, open, extent), RowOrHeader::Header) {
                return;
            }
            open.fields.split(without_bom(open.lines.text(extent).trim_ascii()), self.layout.delimiter);
            if !self.is_marked && self.header.is_like_row(&open.fields) {
                self.findings.count_remark(line);
            }
            accounting.structure(open, extent);
        } else if !is_plain || is_repeated || is_repeated_units || !is_row {
            if !is_row {
                self.before_rows(accounting, open, extent, line, is_plain);
            }
            if is_repeated {
                self.repeated += 1;
                self.topic.is_below_other_header = false;
                self.renew_rules();
            }
            accounting.structure(open, extent);
        } else if let RowOrHeader::Row { is_split } = self.other_header(accounting, open, extent) {
            accounting.row(open, extent, &mut self.topic, 0, self.layout.delimiter, is_split);
        }
    }

    /// Checks whether the line is another header.
    fn other_header(&mut self, accounting: &mut Accounting, open: &mut Open<'_>, extent: Extent) -> RowOrHeader {
        let between = accounting.other_header(open, extent, &mut self.topic, &self.header, &mut self.findings);
        if matches!(between, RowOrHeader::Header) {
            self.renew_rules();
            self.after_header = true;
        }
        between
    }

    /// Keeps a remark before the rows, and counts what is neither a remark nor a header.
    fn before_rows(&mut self, accounting: &mut Accounting, open: &Open<'_>, extent: Extent, line: u64, is_plain: bool) {
        let remark = remark_of(trimmed(open, extent)).filter(|_| accounting.health.extras.len() < EXTRAS);
        accounting.health.extras.extend(remark);
        let is_head = [self.layout.header_line, self.layout.units_line].contains(&Some(line));
        self.preamble += u64::from(is_plain && !is_head);
    }
}

fn trimmed<'l>(open: &'l Open<'_>, extent: Extent) -> &'l [u8] {
    without_bom(open.lines.text(extent).trim_ascii())
}
