//! NMEA 0183: lines of text with a checksum, as receivers write them
//! (<https://gpsd.gitlab.io/gpsd/NMEA.html> gathers what is public of the standard).
//!
//! A topic is named after the address, `GNRMC`, and its type is `RMC`; messages of u-blox and Trimble have their own,
//! `PUBX,00`; where a receiver changed its talker in between, it is `RMC` alone. The date comes from RMC, ZDA, PUBX,04
//! and PTNL,GGK; a sentence that says the time alone has the day that is nearest to the sentence before it, and VTG,
//! which says neither, its time, or that of the sentence behind it if RMC shows that the receiver has it so. What
//! stands before the first date is dated backwards from it. A logger may have put the Unix time, or a date and time
//! with its zone, in front of each line, or have said it in a tag block (NMEA 0183, version 4): that is when the
//! sentence was logged.
//!
//! Fields are taken apart here and not by the `nmea` crate, whose values are single-precision floats and have lost the
//! last digits of speeds, tracks and heights. Latitude and longitude are the doubles nearest to what the text says.

mod book;
mod kind;
mod order;
mod sentence;
mod talkers;

pub(super) use self::book::{Book, Dates};
use self::kind::Kind;
use self::sentence::Fault;
pub(super) use self::sentence::Sentence;
use crate::bytes::{is_plain, is_zero};
use crate::civil::{Tick, iso_to_unix_ns};
use crate::decode::Topics;
use crate::error::IngestError;
use crate::format::Reading;
use crate::reader::{Log, ReadContext, Select};
use flight::{Code, Graded, Notices, Severity};
use logscan::LogFile;
use logscan::{Fate, Ledger};
use memchr::{memchr, memchr_iter, memchr2, memchr3};
use std::borrow::Cow;
use std::fmt::Display;
use std::path::PathBuf;

/// Bytes looked through for lines in one go.
const BLOCK: usize = 256 << 10;

/// Bytes looked through for the first sentence.
const SOUGHT: u64 = 64 << 20;
/// Lines by which sentences are told from other text.
const LOOKED_AT: usize = 100;
/// So many lines in a row show whether a logger keeps checksums.
const DECIDED_BY: usize = 20;
/// Topics in one log: talkers and types of sentences.
const MOST_TOPICS: usize = 4096;

/// Longest text behind a sentence, as a time, that is passed over.
const LONGEST_SUFFIX: usize = 64;

const STX: u8 = 0x02;
const ETX: u8 = 0x03;
const ESC: u8 = 0x1b;

/// Reads the sentences of one log, or of several that make up one flight.
pub(super) fn read(files: &[PathBuf], want: &dyn Select, context: &ReadContext<'_>) -> Result<Log, IngestError> {
    let context = &super::with_topics(context, MOST_TOPICS);
    let Reading { mut files, mut ledger, mut notices, mut topics } = Reading::begin(files, want, context)?;
    let mut log = Log::default();
    log.health.format = "NMEA 0183".to_owned();
    let mut book = Book::new();
    for file in &mut files {
        let foreign = is_zero(file.up_to(0, crate::sniff::HEAD)?);
        if foreign {
            super::refuse_foreign(file, "", context)?;
        }
        let bare = has_bare_sentences(file)?;
        book.breaks();
        let mut walk = Walk::new(file, context, &mut ledger, &mut book, &mut topics, bare);
        walk.run()?;
        walk.tell(&mut notices);
    }
    let dates = book.finish(&mut log, &mut notices);
    let first = files.first().map(|file| file.name().to_owned()).unwrap_or_default();
    let mut log = Reading { files, ledger, notices, topics }.conclude(log)?;
    if log.health.topics.is_empty() && log.health.bytes.damaged == 0 {
        return Err(IngestError::NotALog { file: first, what: "there is no NMEA sentence in it".to_owned() });
    }
    dates.put(&mut log);
    super::forget_log_times(&mut log);
    Ok(log)
}

/// Whether these first bytes of a file hold sentences: two whose checksum is right, or one that is all there is; or
/// sentences of the types that are read, and no checksum anywhere.
pub(crate) fn looks_like(head: &[u8]) -> bool {
    // Another logger may have gone on with it.
    let hundred = memchr_iter(b'\n', head).nth(LOOKED_AT).map_or(head.len(), |end| end + 1);
    looks_checked(head) || (is_bare(head.get(..hundred).unwrap_or_default()) && looks_bare(head))
}

fn looks_checked(head: &[u8]) -> bool {
    let mut lines = head.split(|b| *b == b'\n').take(LOOKED_AT);
    let sentence = |line: &[u8]| Some(Sentence::at(line.get(begin_of(line)?..)?, false).is_ok());
    let (mut good, mut bad, mut headless) = (0, 0, 0);
    while let (Some(line), true) = (lines.next(), good < 2 && headless < 2) {
        match sentence(line) {
            Some(true) => good += 1,
            Some(false) => bad += 1,
            None => headless += usize::from(with_dollar(line).is_some()),
        }
    }
    good >= 2 || headless >= 2 || (good == 1 && bad == 0)
}

/// A line that is a sentence with a right checksum but for the `$` in front, with that: some loggers take it off.
fn with_dollar(line: &[u8]) -> Option<Vec<u8>> {
    let may_be =
        line.first().is_some_and(u8::is_ascii_uppercase) && memchr(b'*', line).is_some() && begin_of(line).is_none();
    let whole = may_be.then(|| [b"$", line].concat())?;
    let is_one = Sentence::at(&whole, false).is_ok_and(|sentence| sentence.checked && sentence.body.contains(','));
    is_one.then_some(whole)
}

/// Whether lines are sentences of types that are read, as far as that can be told without a checksum.
fn looks_bare(head: &[u8]) -> bool {
    let lines = head.split_inclusive(|b| *b == b'\n').take(LOOKED_AT);
    let is_read = |line: &&[u8]| {
        let sentence = Sentence::at(line, true).ok().filter(|s| s.body.matches(',').count() > 3);
        sentence.is_some_and(|sentence| Kind::of(sentence.address().1).is_some())
    };
    lines.filter(is_read).count() > 2
}

/// Where the first sentence of a line would begin. Some receivers double the `$`.
fn begin_of(line: &[u8]) -> Option<usize> {
    let at = memchr2(b'$', b'!', line)?;
    let doubled = line.get(at..)?.iter().take_while(|b| **b == b'$').count();
    Some(at + doubled.saturating_sub(1))
}

/// Whether there are sentences and most have no checksum: some loggers take it off. What follows the last line's end does
/// not count, for it may be cut.
pub(super) fn is_bare(head: &[u8]) -> bool {
    let (bare, checked) = bare_and_checked(head);
    bare > checked
}

/// Sentences without a checksum in these lines, and lines that have one, be it a wrong one.
fn bare_and_checked(head: &[u8]) -> (usize, usize) {
    let whole = head.get(..memchr::memrchr(b'\n', head).map_or(0, |end| end + 1)).unwrap_or_default();
    let (mut bare, mut checked) = (0, 0);
    for line in whole.split_inclusive(|b| *b == b'\n').filter(|line| memchr(b'$', line).is_some()).take(1000) {
        // What other devices write behind a `$` says nothing.
        let is_read = || {
            let sentence = begin_of(line).and_then(|at| Sentence::at(line.get(at..)?, true).ok());
            sentence.is_some_and(|sentence| Kind::of(sentence.address().1).is_some())
        };
        match memchr(b'*', line) {
            Some(_) => checked += 1,
            None => bare += usize::from(is_read()),
        }
    }
    (bare, checked)
}

/// As [`is_bare`], of the first block of a file that holds sentences: what stands before may be zeros or junk.
fn has_bare_sentences(file: &mut LogFile) -> Result<bool, IngestError> {
    let mut at = 0;
    while at < file.size().min(SOUGHT) {
        let (bare, checked) = bare_and_checked(file.up_to(at, crate::sniff::HEAD)?);
        if bare + checked > 0 {
            return Ok(bare > checked);
        }
        at += crate::sniff::HEAD as u64;
    }
    Ok(false)
}

/// Whether the next lines are sentences of types that are read and have all a checksum, or all none: as many as decide, or
/// those up to the end if there are a few.
fn are_all(lines: &[u8], checked: bool) -> bool {
    let mut seen = 0;
    let with_dollar = |line: &&[u8]| memchr(b'$', line).is_some() && line.ends_with(b"\n");
    for line in lines.split_inclusive(|b| *b == b'\n').filter(with_dollar).take(DECIDED_BY) {
        let sentence = begin_of(line).and_then(|at| Sentence::at(line.get(at..)?, true).ok());
        let Some(sentence) = sentence.filter(|sentence| sentence.checked == checked) else { return false };
        seen += usize::from(Kind::of(sentence.address().1).is_some());
    }
    2 * seen >= DECIDED_BY
}

/// Whether most of the first lines with a sentence have text in front of it: the time of a logger, a tag block, or what
/// nobody knows.
pub(super) fn is_prefixed(head: &[u8]) -> bool {
    let (mut prefixed, mut others) = (0, 0);
    for line in head.split(|b| *b == b'\n').take(1000) {
        let Some((prefix, rest)) = begin_of(line).and_then(|at| line.split_at_checked(at)) else { continue };
        if Sentence::at(rest, false).is_ok() {
            let prefix = unmarked(prefix);
            let blank = prefix.iter().all(|b| b.is_ascii_whitespace() || *b == b'$');
            *if !blank && is_plain(&prefix) { &mut prefixed } else { &mut others } += 1;
        }
    }
    prefixed > others
}

/// How much of what stands in front of a sentence is binary: an intact frame, or of what is no text all up to the last
/// control character.
fn binary_length(prefix: &[u8]) -> usize {
    if is_plain(&unmarked(prefix)) {
        return 0;
    }
    let is_binary = |b: &u8| b.is_ascii_control() && !b.is_ascii_whitespace();
    let whole = super::ubx::frame_length(prefix);
    whole.or_else(|| Some(prefix.iter().rposition(is_binary)? + 1)).unwrap_or(0)
}

/// Text without STX and ETX, which may frame a sentence, and without what colours it on a screen: ESC and the control
/// sequence that it begins, `ESC[32m` (ECMA-48, 5.4).
fn unmarked(text: &[u8]) -> Cow<'_, [u8]> {
    if memchr3(STX, ETX, ESC, text).is_none() {
        return text.into();
    }
    let mut pieces = text.split(|b| *b == ESC);
    let first = pieces.next().unwrap_or_default();
    let others = pieces.flat_map(|piece| behind_sequence(piece).unwrap_or(piece));
    first.iter().chain(others).copied().filter(|b| ![STX, ETX].contains(b)).collect()
}

/// What follows a control sequence that stands behind its ESC: `[`, parameters, and what it does.
fn behind_sequence(piece: &[u8]) -> Option<&[u8]> {
    let sequence = piece.strip_prefix(b"[")?;
    let end = sequence.iter().position(|b| !(b' '..=b'?').contains(b))?;
    let (does, rest) = sequence.get(end..)?.split_first()?;
    (b'@'..=b'~').contains(does).then_some(rest)
}

/// A walk in progress.
struct Walk<'w, 'c, 't, 's> {
    file: &'w mut LogFile,
    name: String,
    context: &'w ReadContext<'c>,
    ledger: &'w mut Ledger,
    book: &'w mut Book,
    topics: &'t mut Topics<'s>,
    at: u64,
    line: u64,
    /// The line has no end: the file ends in it.
    is_open: bool,
    /// Sentences may have no checksum.
    bare: bool,
    counts: Counts,
}

/// What was not as the standard has it.
#[derive(Debug, Default)]
struct Counts {
    unchecked: u64,
    /// Text in front of sentences that is no such time.
    prefixes: u64,
    /// Bytes of text in front of the first sentence, of comments, and of lines of text.
    preamble: u64,
    sentences: u64,
    /// Without a `$`.
    headless: u64,
}

impl<'w, 'c, 't, 's> Walk<'w, 'c, 't, 's> {
    fn new(
        file: &'w mut LogFile,
        context: &'w ReadContext<'c>,
        ledger: &'w mut Ledger,
        book: &'w mut Book,
        topics: &'t mut Topics<'s>,
        bare: bool,
    ) -> Walk<'w, 'c, 't, 's> {
        let name = file.name().to_owned();
        Walk {
            file,
            name,
            context,
            ledger,
            book,
            topics,
            at: 0,
            line: 0,
            is_open: false,
            bare,
            counts: Counts::default(),
        }
    }

    /// From the first byte to the last.
    fn run(&mut self) -> Result<(), IngestError> {
        while self.at < self.file.size() {
            let (longest, size) = (self.context.limits.line_bytes.max(1), self.file.size());
            let mut block = self.file.up_to(self.at, BLOCK.min(longest))?;
            if memchr(b'\n', block).is_none() {
                block = self.file.up_to(self.at, longest)?;
            }
            let is_last = self.at + block.len() as u64 == size;
            let end = match memchr::memrchr(b'\n', block) {
                _ if is_last => block.len(),
                Some(end) => end + 1,
                None => {
                    self.long_line()?;
                    continue;
                }
            };
            // The lines are taken from a copy: sentences go on while the file stays borrowed.
            let lines = block.get(..end).unwrap_or_default().to_vec();
            self.lines(&lines);
            self.file.progress(self.at, self.context)?;
        }
        Ok(())
    }

    /// Whole lines, or the last one without its end.
    fn lines(&mut self, block: &[u8]) {
        let mut from = 0;
        for end in memchr_iter(b'\n', block).map(|end| end + 1).chain([block.len()]) {
            let line = block.get(from..end).unwrap_or_default();
            if !line.is_empty() {
                self.line += 1;
                self.is_open = !line.ends_with(b"\n");
                self.line(line, block.get(from..).unwrap_or_default());
                self.at += line.len() as u64;
            }
            from = end;
        }
    }

    /// One line with its end, and what there is from it on. Where a line's end is damaged, two sentences stand in one.
    fn line(&mut self, line: &[u8], ahead: &[u8]) {
        if line.starts_with(b"#") && is_plain(line) {
            return self.aside(line);
        }
        let mut from = 0;
        // Where others have a `$`, one without has lost it with what stood before.
        if self.counts.sentences == self.counts.headless
            && let Some(whole) = with_dollar(line)
            && let Ok(sentence) = Sentence::at(&whole, false)
        {
            from = sentence.length - 1;
            self.counts.headless += 1;
            self.sentence(&sentence, &[], from as u64);
        }
        while let Some(dollar) = line.get(from..).and_then(begin_of).map(|at| from + at) {
            let rest = line.get(dollar..).unwrap_or_default();
            let prefix = line.get(from..dollar).unwrap_or_default();
            let next = rest.get(1..).and_then(|r| memchr2(b'$', b'!', r)).map_or(line.len(), |at| dollar + 1 + at);
            match Sentence::at(rest, self.bare) {
                Ok(sentence) => {
                    let binary = binary_length(prefix);
                    if binary > 0 {
                        self.damaged(from, from + binary, "no sentence");
                        from += binary;
                    }
                    let mut prefix = unmarked(line.get(from..dollar).unwrap_or_default());
                    if is_damaged_tag(&prefix) {
                        self.damaged(from, dollar, "the checksum of a tag block is wrong");
                        (from, prefix) = (dollar, Cow::default());
                    }
                    // Another logger took over.
                    if self.bare && sentence.checked && are_all(ahead, true) {
                        self.bare = false;
                    }
                    let end = dollar + sentence.length;
                    self.sentence(&sentence, &prefix, (end - from) as u64);
                    from = end;
                }
                Err(Fault::Unchecked) if !self.bare && are_all(ahead, false) => self.bare = true,
                Err(reason) => {
                    self.damaged(from, next, reason);
                    from = next;
                }
            }
        }
        let rest = line.get(from..).unwrap_or_default();
        let text = unmarked(rest);
        if text.iter().all(u8::is_ascii_whitespace) {
            self.ledger.count(Fate::Structure, rest.len() as u64);
        } else if is_plain(&text)
            && memchr(b'*', rest).is_none()
            && (self.counts.sentences == 0 || self.is_text(line, rest) || is_suffix(from, rest))
        {
            self.aside(rest);
        } else {
            self.damaged(from, line.len(), "no sentence");
        }
    }

    /// Whether a whole line is text that a receiver or a logger put between the sentences, and no piece of one: these have
    /// commas, and no blanks. Where text stands in front of the sentences too, it may look as it likes.
    fn is_text(&self, line: &[u8], rest: &[u8]) -> bool {
        line == rest && line.ends_with(b"\n") && (self.counts.prefixes > 0 || is_prose(line))
    }

    /// A comment, text in front of the first sentence, behind one, or a line of text between.
    fn aside(&mut self, text: &[u8]) {
        self.counts.preamble += text.len() as u64;
        self.ledger.count(Fate::Skipped, text.len() as u64);
    }

    fn sentence(&mut self, sentence: &Sentence<'_>, prefix: &[u8], bytes: u64) {
        self.counts.sentences += 1;
        self.counts.unchecked += u64::from(!sentence.checked);
        let logged_ns = logged(prefix);
        self.counts.prefixes += u64::from(logged_ns.is_none() && !prefix.iter().all(u8::is_ascii_whitespace));
        let fate = self.book.sentence(sentence, logged_ns, self.topics);
        self.ledger.count(fate, bytes);
    }

    fn damaged(&mut self, from: usize, to: usize, reason: impl Display) {
        self.book.breaks();
        let at = self.at + from as u64;
        let (length, reason) = ((to - from) as u64, format!("line {}: {reason}", self.line));
        if self.is_open && at + length == self.file.size() {
            self.ledger.cut(&self.name, at, length, format!("{reason}; the log ends inside it"));
        } else {
            self.ledger.damaged(&self.name, at, length, reason);
        }
    }

    /// A line that is longer than the limit.
    fn long_line(&mut self) -> Result<(), IngestError> {
        self.line += 1;
        let start = self.at;
        (self.at, _) = self.file.line_end(start, self.context)?;
        let reason = format!("line {}: longer than the limit", self.line);
        self.ledger.damaged(&self.name, start, self.at - start, reason);
        Ok(())
    }

    fn tell(&self, notices: &mut Notices) {
        let mut say = |what: Graded, count, text: &str| {
            if count > 0 {
                notices.push(what, self.name.as_str(), count, text);
            }
        };
        let Counts { unchecked, prefixes, preamble, headless, .. } = self.counts;
        say(Code::NoChecksum.into(), unchecked, "sentences have no checksum: nothing shows whether they are intact");
        say(Code::ReadLeniently.at(Severity::Info), headless, "sentences begin without `$`; their checksums are right");
        say(
            Code::ExtraBytes.into(),
            prefixes,
            "sentences stand behind text that is no Unix time and no date with time and zone; it was not read",
        );
        say(
            Code::ExtraBytes.into(),
            preamble,
            "bytes of text that is no sentence: comments, what stands before the first or behind one, and whole lines between",
        );
    }
}

/// Whether a line of text is no piece of a sentence.
fn is_prose(line: &[u8]) -> bool {
    memchr(b' ', line).is_some() && memchr(b',', line).is_none()
}

/// Whether the rest of a line from `from` on, behind a sentence, is what a logger put there.
fn is_suffix(from: usize, rest: &[u8]) -> bool {
    from > 0 && rest.first().is_some_and(|b| b",; \t".contains(b)) && rest.len() <= LONGEST_SUFFIX
}

/// The time in front of a sentence, ns of UTC, if that is all there is: the Unix time, or a date and time with its zone.
fn logged(prefix: &[u8]) -> Option<i64> {
    let text = std::str::from_utf8(prefix).ok()?.trim_matches([' ', '\t', ',', ';', ':', '[', ']']);
    unix_time(text).or_else(|| zoned_time(text)).or_else(|| tag_time(text))
}

/// What a tag block says between its backslashes, and its checksum: `\s:r1,c:1699999999*1F\`.
fn tag(text: &str) -> Option<(&str, u8)> {
    let (said, sum) = text.strip_prefix('\\')?.strip_suffix('\\')?.rsplit_once('*')?;
    Some((said, u8::from_str_radix(sum, 16).ok()?))
}

fn is_intact(said: &str, sum: u8) -> bool {
    said.bytes().fold(0, |sum, b| sum ^ b) == sum
}

/// Whether the text in front of a sentence is a tag block whose checksum is wrong.
fn is_damaged_tag(prefix: &[u8]) -> bool {
    let text = std::str::from_utf8(prefix).unwrap_or_default().trim();
    tag(text).is_some_and(|(said, sum)| !is_intact(said, sum))
}

/// `c` of a tag block: the Unix time at its source, s, or of some ms.
fn tag_time(text: &str) -> Option<i64> {
    let (said, _) = tag(text).filter(|(said, sum)| is_intact(said, *sum))?;
    unix_time(said.split(',').find_map(|part| part.strip_prefix("c:"))?)
}

/// Seconds, or milli-, micro- or nanoseconds as the number of digits tells.
fn unix_time(text: &str) -> Option<i64> {
    let whole = text.split('.').next().unwrap_or_default();
    let digits = text.bytes().all(|b| b.is_ascii_digit() || b == b'.');
    let tick = match whole.len() {
        10 => Tick::Seconds,
        13 => Tick::Millis,
        16 => Tick::Micros,
        19 => Tick::Nanos,
        _ => return None,
    };
    if digits { tick.of_text(text) } else { None }
}

/// ISO 8601. Without a zone it is the time of the place where the logger stood, which nobody knows.
fn zoned_time(text: &str) -> Option<i64> {
    let behind = text.get("2024-05-10T17:27".len()..)?;
    let zoned = behind.ends_with(['Z', 'z']) || behind.contains(['+', '-']);
    if zoned { iso_to_unix_ns(text) } else { None }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_unix_time_or_one_with_its_zone_in_front_is_when_it_was_logged_and_other_text_is_not() {
        assert_eq!(logged(b"1699999999.123 "), Some(1_699_999_999_123_000_000));
        assert_eq!(logged(b"1699999999123,"), Some(1_699_999_999_123_000_000));
        assert_eq!(logged(b"1699999999123456\t"), Some(1_699_999_999_123_456_000));
        assert_eq!(logged(b"1699999999123456789: "), Some(1_699_999_999_123_456_789));
        for text in ["2023-11-14T22:13:19.123Z ", "[2023-11-14T23:13:19.123+01:00] ", "2023-11-14 22:13:19.123Z,"] {
            assert_eq!(logged(text.as_bytes()), Some(1_699_999_999_123_000_000), "{text}");
        }
        // gpsd's AIVDM document.
        assert_eq!(logged(br"\g:1-2-73874,n:157036,s:r003669945,c:1241544035*4A\"), Some(1_241_544_035_000_000_000));
        assert!(!is_damaged_tag(br"\g:1-2-73874,n:157036,s:r003669945,c:1241544035*4A\"));
        assert!(
            is_damaged_tag(br"\g:1-2-73874,n:157036,s:r003669945,c:1241544036*4A\") && !is_damaged_tag(br"C:\log\")
        );
        for text in
            ["2023-11-14T22:13:19.123 ", "", "[12:00:01] ", "16:99:99", "12.5 ", "1699999999.1.2 ", "x1699999999 "]
        {
            assert_eq!(logged(text.as_bytes()), None, "{text}");
        }
    }

    #[test]
    fn text_is_told_from_sentences() {
        assert!(looks_like(b"$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\r\n"));
        assert!(!looks_like(b"$FLYS,1\r\n$COL,GNSS,time\r\n$DATA\r\n"));
        assert!(!looks_like(b"time,lat,lon\n1,2,3\n"));
    }
}
