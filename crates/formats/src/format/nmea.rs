//! NMEA 0183: lines of text with a checksum, as receivers write them
//! (<https://gpsd.gitlab.io/gpsd/NMEA.html> collects what is public of the standard).
//!
//! A topic is named after the address, `GNRMC`, and its type is `RMC`; messages of u-blox and Trimble have their own,
//! `PUBX,00`. If a receiver changed its talker, the topic is named `RMC`. The date comes from RMC, ZDA, PUBX,04
//! and PTNL,GGK. A sentence with only a time of day gets the day nearest to the previous sentence. VTG,
//! which has neither, gets the time of the previous sentence, or of the next one if RMC shows that order. Sentences
//! before the first date are dated backwards from it. A logger may have put the Unix time, or a date and time
//! with its zone, before each line or in a tag block (NMEA 0183, version 4): that is when the
//! sentence was logged.
//!
//! Fields are parsed here, not by the `nmea` crate, whose single-precision floats lose the
//! last digits of speeds, tracks and heights. Latitude and longitude are the doubles nearest to the text.

mod epoch_order;
mod kind;
mod nmea_session;
mod sentence;
mod talkers;

use self::kind::Kind;
pub(super) use self::nmea_session::Dates;
use self::nmea_session::Session;
use self::sentence::{Fault, Sentence};
use crate::bytes::is_plain;
use crate::civil::{Tick, iso_to_unix_ns};
use crate::decode::Topics;
use crate::error::LogError;
use crate::reader::Log;
use flight::{Code, Graded, Notices, Severity};
use logscan::{Fate, LogFile, Parsed, Source, Trust};
use memchr::{memchr, memchr_iter, memchr2};
use std::borrow::Cow;

/// Bytes searched for the first sentence.
const SOUGHT: u64 = 64 << 20;
/// Number of lines that distinguish sentences from other text.
const LOOKED_AT: usize = 100;
/// Consecutive lines that show whether a logger keeps checksums, and most bytes of these.
const DECIDED_BY: usize = 20;
const DECIDING: usize = 8 << 10;
/// Longest line of text, or of a sentence with the text before it, bytes.
const LONGEST_LINE: usize = 4096;

/// Longest text after a sentence, such as a time, that is skipped.
const LONGEST_SUFFIX: usize = 64;

const STX: u8 = 0x02;
const ETX: u8 = 0x03;

/// Whether these first bytes of a file hold sentences: two with a right checksum, or one and nothing else; or
/// sentences of the types that are read, and no checksum anywhere.
pub(crate) fn looks_like(head: &[u8]) -> bool {
    // Another logger may have continued the file.
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

/// A line that is a sentence with a right checksum if a `$` is prepended: some loggers remove it.
fn with_dollar(line: &[u8]) -> Option<Vec<u8>> {
    let may_be =
        line.first().is_some_and(u8::is_ascii_uppercase) && memchr(b'*', line).is_some() && begin_of(line).is_none();
    let whole = may_be.then(|| [b"$", line].concat())?;
    let is_one = Sentence::at(&whole, false).is_ok_and(|sentence| sentence.checked && sentence.body.contains(','));
    is_one.then_some(whole)
}

/// Whether lines are sentences of types that are read, as far as this shows without a checksum.
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

/// Whether there are sentences and most have no checksum: some loggers remove it. Text after the last line end does
/// not count, because it may be truncated.
fn is_bare(head: &[u8]) -> bool {
    let (bare, checked) = bare_and_checked(head);
    bare > checked
}

/// Sentences without a checksum in these lines, and lines with one, right or wrong.
fn bare_and_checked(head: &[u8]) -> (usize, usize) {
    let whole = head.get(..memchr::memrchr(b'\n', head).map_or(0, |end| end + 1)).unwrap_or_default();
    let (mut bare, mut checked) = (0, 0);
    for line in whole.split_inclusive(|b| *b == b'\n').filter(|line| memchr(b'$', line).is_some()).take(1000) {
        // What other devices write after a `$` is irrelevant.
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

/// Like [`is_bare`], for the first block of a file with sentences: zeros or junk may precede it.
pub(super) fn has_bare_sentences(file: &mut LogFile) -> Result<bool, LogError> {
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

/// Whether the next lines are sentences of types that are read and either all or none have a checksum. Enough lines to
/// decide are examined, or those up to the end if there are a few.
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

/// Text without STX and ETX, which may frame a sentence.
fn unmarked(text: &[u8]) -> Cow<'_, [u8]> {
    if memchr2(STX, ETX, text).is_none() {
        return text.into();
    }
    text.iter().copied().filter(|b| ![STX, ETX].contains(b)).collect()
}

/// The lines of a log: sentences, what a logger wrote around them, and text.
pub(super) struct Lines {
    session: Session,
    /// Text may occur between and before the sentences; otherwise there are only frames and sentences.
    has_text: bool,
    /// Sentences may have no checksum.
    bare: bool,
    number: u64,
    /// A line begins here.
    is_begin: bool,
    counts: Counts,
}

/// Deviations from the standard.
#[derive(Debug, Default)]
struct Counts {
    unchecked: u64,
    /// Text before sentences that is not such a time.
    prefixes: u64,
    /// Bytes of text before the first sentence, of comments, and of lines of text.
    preamble: u64,
    sentences: u64,
    /// Without a `$`.
    headless: u64,
}

impl Lines {
    pub(super) fn new(has_text: bool, bare: bool) -> Lines {
        let (session, counts) = (Session::default(), Counts::default());
        let mut lines = Lines { session, has_text, bare, number: 1, is_begin: true, counts };
        lines.breaks();
        lines
    }

    /// Bytes are missing here.
    pub(super) fn breaks(&mut self) {
        self.session.breaks();
    }

    pub(super) fn has_text(&self) -> bool {
        self.has_text
    }

    /// There is a frame between the lines.
    pub(super) fn begin_line(&mut self) {
        self.is_begin = true;
    }

    /// What these bytes begin with: a sentence with what precedes it, a line end, or text.
    pub(super) fn parse(&self, bytes: &[u8]) -> Parsed {
        let length = match bytes {
            [b'\r', b'\n', ..] => Some(2),
            [b'\r' | b'\n', ..] => Some(1),
            // Some receivers double it.
            [b'$', rest @ ..] if rest.starts_with(b"$") => self.sentence(rest).ok().map(|_| 1),
            [b'$' | b'!', ..] => self.sentence(bytes).ok().map(|sentence| sentence.length),
            _ if self.has_text => self.text(bytes),
            _ => None,
        };
        match length {
            Some(length) => Parsed::Frame(length, Trust::Proven),
            None if bytes.len() < LONGEST_LINE
                && memchr(b'\n', bytes).is_none()
                && (self.has_text || bytes.starts_with(b"$")) =>
            {
                Parsed::Cut
            }
            None => Parsed::Not(1),
        }
    }

    fn sentence<'b>(&self, bytes: &'b [u8]) -> Result<Sentence<'b>, Fault> {
        let sentence = Sentence::at(bytes, self.bare);
        let is_next_bare = || are_all(bytes.get(..DECIDING).unwrap_or(bytes), false);
        match sentence {
            // Another logger took over.
            Err(Fault::Unchecked) if self.has_text && !self.bare && is_next_bare() => Sentence::at(bytes, true),
            sentence => sentence,
        }
    }

    /// Bytes at the start of a line that are not yet a sentence: text before a sentence, or only text.
    fn text(&self, bytes: &[u8]) -> Option<usize> {
        let line = line_of(bytes);
        if self.is_comment(line) {
            return Some(line.len());
        }
        if let Some(length) = self.headless(line) {
            return Some(length);
        }
        let Some(at) = begin_of(line) else { return self.is_aside(line).then_some(line.len()) };
        let (prefix, rest) = bytes.split_at_checked(at)?;
        let text = unmarked(prefix);
        let sentence = self.sentence(rest).ok().filter(|_| is_plain(&text) && !is_damaged_tag(&text))?;
        Some(at + sentence.length)
    }

    fn is_comment(&self, line: &[u8]) -> bool {
        self.is_begin && line.starts_with(b"#") && line.ends_with(b"\n") && is_plain(line)
    }

    /// Length of a sentence without its `$`. Where other sentences have one, it was lost with the preceding bytes.
    fn headless(&self, line: &[u8]) -> Option<usize> {
        let whole = with_dollar(line).filter(|_| self.is_begin && self.counts.sentences == self.counts.headless)?;
        Sentence::at(&whole, false).ok().map(|sentence| sentence.length - 1)
    }

    /// Whether text without a sentence is not damage: blanks, text before the first sentence or after one, and
    /// whole lines that a receiver or logger wrote between sentences and that are not fragments of one: fragments have
    /// commas and no blanks. Where text precedes the sentences too, it may have any form.
    fn is_aside(&self, text: &[u8]) -> bool {
        let plain = unmarked(text);
        let is_line = || self.is_begin && text.ends_with(b"\n") && (self.counts.prefixes > 0 || is_prose(text));
        let is_suffix =
            || !self.is_begin && text.first().is_some_and(|b| b",; \t".contains(b)) && text.len() <= LONGEST_SUFFIX;
        is_blank(&plain)
            || (is_plain(&plain)
                && memchr(b'*', text).is_none()
                && (self.counts.sentences == 0 || is_line() || is_suffix()))
    }

    /// Takes what was found here; `after` is what follows it.
    pub(super) fn take(&mut self, piece: &[u8], after: &[u8], topics: &mut Topics<'_>) -> Fate {
        let ends_line = piece.ends_with(b"\n");
        let headless = if ends_line { None } else { self.headless(piece) };
        let fate = match begin_of(piece) {
            _ if headless.is_some() => {
                self.counts.headless += 1;
                let whole = [b"$", piece].concat();
                self.take_sentence(&Sentence::of(&whole), &[], after, topics)
            }
            Some(at) if !ends_line && piece.len() > 1 => {
                let (prefix, sentence) = piece.split_at_checked(at).unwrap_or_default();
                self.take_sentence(&Sentence::of(sentence), prefix, after, topics)
            }
            // A line end, or the first of two `$`.
            _ if is_blank(&unmarked(piece)) || piece == b"$" => Fate::Structure,
            _ => {
                self.counts.preamble += piece.len() as u64;
                Fate::Skipped
            }
        };
        self.number += u64::from(ends_line);
        self.is_begin = ends_line;
        fate
    }

    fn take_sentence(&mut self, sentence: &Sentence<'_>, prefix: &[u8], after: &[u8], topics: &mut Topics<'_>) -> Fate {
        self.counts.sentences += 1;
        self.counts.unchecked += u64::from(!sentence.checked);
        if !sentence.checked || (self.bare && are_all(after.get(..DECIDING).unwrap_or(after), true)) {
            self.bare = !sentence.checked;
        }
        let prefix = unmarked(prefix);
        let logged_ns = logged(&prefix);
        self.counts.prefixes += u64::from(logged_ns.is_none() && !is_blank(&prefix));
        self.session.sentence(sentence, logged_ns, topics)
    }

    /// Describes what is wrong where nothing was found.
    pub(super) fn fault(&self, bytes: &[u8]) -> Cow<'static, str> {
        let line = line_of(bytes);
        let (prefix, rest) = begin_of(line).and_then(|at| line.split_at_checked(at)).unwrap_or((line, b""));
        let reason = match self.sentence(rest) {
            Ok(_) if is_damaged_tag(&unmarked(prefix)) => "the checksum of a tag block is wrong".to_owned(),
            Err(fault) if !rest.is_empty() => fault.to_string(),
            _ => "not a sentence".to_owned(),
        };
        if self.has_text { format!("line {}: {reason}", self.number).into() } else { reason.into() }
    }

    /// Reports deviations of a file from the standard.
    pub(super) fn report(&self, file: &str, notices: &mut Notices) {
        let mut say = |what: Graded, count, text: &str| {
            if count > 0 {
                notices.push(what, file, count, text);
            }
        };
        let Counts { unchecked, prefixes, preamble, headless, .. } = self.counts;
        say(Code::NoChecksum.into(), unchecked, "sentences have no checksum: their content cannot be verified");
        say(
            Code::ReadLeniently.at(Severity::Info),
            headless,
            "sentences begin without `$`; their checksums are \
            correct",
        );
        say(
            Code::Skipped.into(),
            prefixes,
            "sentences follow text that is neither a Unix time nor a date with time and zone; this text was not read",
        );
        say(
            Code::Skipped.into(),
            preamble,
            "bytes of text outside sentences: comments, text before or after a sentence, and lines between sentences",
        );
    }

    /// Writes what the receiver says about itself. The returned value dates the tables once they are made.
    pub(super) fn finish(self, log: &mut Log, notices: &mut Notices) -> Dates {
        self.session.finish(log, notices)
    }
}

/// A line with its end, or the part of it that is examined.
fn line_of(bytes: &[u8]) -> &[u8] {
    let head = bytes.get(..LONGEST_LINE).unwrap_or(bytes);
    head.get(..memchr(b'\n', head).map_or(head.len(), |end| end + 1)).unwrap_or_default()
}

fn is_blank(text: &[u8]) -> bool {
    text.iter().all(u8::is_ascii_whitespace)
}

/// Whether a line of text is not a fragment of a sentence.
fn is_prose(line: &[u8]) -> bool {
    memchr(b' ', line).is_some() && memchr(b',', line).is_none()
}

/// The time before a sentence, ns of UTC, if nothing else precedes it: the Unix time, or a date and time with its zone.
fn logged(prefix: &[u8]) -> Option<i64> {
    let text = std::str::from_utf8(prefix).ok()?.trim_matches([' ', '\t', ',', ';', ':', '[', ']']);
    unix_time(text).or_else(|| zoned_time(text)).or_else(|| tag_time(text))
}

/// The content of a tag block between its backslashes, and its checksum: `\s:r1,c:1699999999*1F\`.
fn tag(text: &str) -> Option<(&str, u8)> {
    let (said, sum) = text.strip_prefix('\\')?.strip_suffix('\\')?.rsplit_once('*')?;
    Some((said, u8::from_str_radix(sum, 16).ok()?))
}

fn is_intact(said: &str, sum: u8) -> bool {
    said.bytes().fold(0, |sum, b| sum ^ b) == sum
}

/// Whether the text before a sentence is a tag block with a wrong checksum.
fn is_damaged_tag(prefix: &[u8]) -> bool {
    let text = std::str::from_utf8(prefix).unwrap_or_default().trim();
    tag(text).is_some_and(|(said, sum)| !is_intact(said, sum))
}

/// `c` of a tag block: the Unix time at its source, in s or, by some devices, in ms.
fn tag_time(text: &str) -> Option<i64> {
    let (said, _) = tag(text).filter(|(said, sum)| is_intact(said, *sum))?;
    unix_time(said.split(',').find_map(|part| part.strip_prefix("c:"))?)
}

/// Seconds, or milli-, micro- or nanoseconds, depending on the number of digits.
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

/// ISO 8601. Without a zone it is local time at an unknown place.
fn zoned_time(text: &str) -> Option<i64> {
    let behind = text.get("2024-05-10T17:27".len()..)?;
    let zoned = behind.ends_with(['Z', 'z']) || behind.contains(['+', '-']);
    if zoned { iso_to_unix_ns(text) } else { None }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_unix_time_or_one_with_a_zone_before_a_sentence_is_its_log_time() {
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
    fn half_of_the_next_twenty_sentences_must_be_of_types_that_are_read() {
        let (read, unread) = ("$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,", "$GPABC,1");
        let sealed = |body: &str| format!("{body}*{:02X}", body.bytes().skip(1).fold(0, |sum, byte| sum ^ byte));
        let lines = |known: usize, unknown: usize, checked: bool| -> String {
            let bodies = std::iter::repeat_n(unread, unknown).chain(std::iter::repeat_n(read, known));
            bodies.map(|body| if checked { sealed(body) } else { body.to_owned() } + "\r\n").collect()
        };
        for checked in [false, true] {
            for (known, unknown) in [(10, 0), (10, 10), (11, 9), (20, 100)] {
                let unknown_after = lines(known, unknown.min(20 - known), checked) + &lines(0, unknown, checked);
                assert!(are_all(unknown_after.as_bytes(), checked), "{known} and {unknown}");
                assert!(!are_all(unknown_after.as_bytes(), !checked), "{known} and {unknown}");
            }
            for (known, unknown) in [(9, 0), (9, 11), (0, 20)] {
                assert!(!are_all(lines(known, unknown, checked).as_bytes(), checked), "{known} and {unknown}");
            }
            let mixed = lines(10, 9, checked) + &lines(1, 0, !checked);
            assert!(!are_all(mixed.as_bytes(), checked));
            // Other lines, and one that is not complete, do not count.
            let between = lines(5, 0, checked)
                + "a remark\n"
                + &lines(5, 0, checked)
                + &lines(1, 0, !checked).replace("\r\n", "");
            assert!(are_all(between.as_bytes(), checked));
        }
    }

    #[test]
    fn text_is_distinguished_from_sentences() {
        assert!(looks_like(b"$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\r\n"));
        assert!(!looks_like(b"$FLYS,1\r\n$COL,GNSS,time\r\n$DATA\r\n"));
        assert!(!looks_like(b"time,lat,lon\n1,2,3\n"));
    }
}
