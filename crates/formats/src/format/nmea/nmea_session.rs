//! Routes each sentence to its topic and assigns its time.

use super::epoch_order::{Order, leave_undated};
use super::kind::{Kind, UTC, is_valid, whole_layout};
use super::sentence::{Sentence, plain, time_of_day_ns};
use super::talkers;
use crate::civil::calendar_to_unix_ns;
use crate::decode::{Route, Tally, Times, Topics};
use crate::format::identity::of_version;
use crate::format::report_too_many_topics;
use crate::reader::Log;
use crate::table::{Column, ColumnData, TopicInfo};
use crate::time::{SaidDates, Since};
use flight::{Code, NANOS_PER_SECOND, Notices, Severity, Stamp};
use logscan::Fate;
use std::collections::HashMap;
use std::fmt::Write;

const DAY_NS: i64 = 86_400 * NANOS_PER_SECOND;
/// Most addresses that are distinguished.
const MOST_ADDRESSES: usize = 4096;
/// Most talkers, and addresses of sentences without a time, whose epochs are distinguished.
const MOST_TALKERS: usize = 64;
/// Texts that are kept.
const MOST_TEXTS: usize = 100;

/// `utc_ns` of a sentence before the first date is this plus the time since the first sentence. UTC is never near
/// it, and [`Dates`] replaces it with the date.
const BEFORE_ANY_DATE_NS: i64 = i64::MIN / 2;
/// No log is longer, but in one with nonsense times each sentence may step by half a day.
const LONGEST_NS: i64 = i64::MAX / 8;

/// Suffix for the address of sentences that are taken raw; it does not occur in addresses.
const WHOLE: &str = " whole";

/// Routes sentences to topics.
#[derive(Default)]
pub(crate) struct Session {
    /// Routes by address.
    routes: HashMap<String, Option<Route>>,
    epochs: Epochs,
    age: Age,
    line: String,
    texts: Vec<String>,
    /// Before the first date.
    early: Tally,
    /// Of types without a time, before the first sentence with one.
    headless: Tally,
    /// Of types with a time, where it is empty.
    timeless: Tally,
    unplaced: Tally,
    /// Of types without a time, after damage.
    broken: Tally,
    heights: Heights,
    order: Order,
}

impl Session {
    /// Bytes are missing here: a sentence without a time may belong to an epoch that was lost.
    pub(crate) fn breaks(&mut self) {
        self.epochs.is_broken = true;
    }

    /// Takes a sentence, and the time at which it was logged, ns of UTC.
    pub(crate) fn sentence(
        &mut self,
        sentence: &Sentence<'_>,
        logged_ns: Option<i64>,
        topics: &mut Topics<'_>,
    ) -> Fate {
        let (talker, name) = sentence.address();
        self.note(name, sentence);
        let date = midnight(name, sentence);
        self.age.look(talker, name, sentence, date);
        self.heights.look(name, sentence);
        let kind = Kind::of(name).filter(|_| is_read(name, sentence));
        let whole = kind.is_none() && topics.takes_extras();
        let Some(route) = self.route(talker, name, whole, topics) else {
            self.unplaced.add(|| format!("{talker}{name}"));
            return Fate::Skipped;
        };
        let times = Times { logged_ns: logged_ns.unwrap_or_default(), published_ns: None };
        let Some(kind) = kind else {
            if !whole {
                return topics.unread(route, times, sentence.length as u64);
            }
            let (utc_ns, elapsed_ns) = self.epochs.stamp(date, None, (talker, name), sentence);
            self.begin_line(utc_ns, elapsed_ns, logged_ns);
            self.line.push(',');
            self.line.push_str(sentence.body);
            return topics.message(route, times, self.line.as_bytes());
        };
        let (utc_ns, elapsed_ns) = self.epochs.stamp(date, kind.time, (talker, name), sentence);
        if let Some(elapsed_ns) = elapsed_ns {
            match name {
                "VTG" => self.order.vtg(sentence),
                _ if kind.time.is_some() => self.order.timed(name, sentence, elapsed_ns),
                _ => {}
            }
        }
        match (utc_ns, elapsed_ns) {
            (None, Some(_)) => self.early.add(|| format!("{talker}{name}")),
            (_, None) => self.without_time(&kind, sentence, route.is_wanted()),
            _ => {}
        }
        self.begin_line(utc_ns, elapsed_ns, logged_ns);
        kind.write(sentence, &mut self.line);
        topics.message(route, times, self.line.as_bytes())
    }

    /// Counts a sentence that gets no time.
    #[inline]
    fn without_time(&mut self, kind: &Kind, sentence: &Sentence<'_>, is_wanted: bool) {
        let tally = match kind.time {
            None if self.epochs.time_of_day_ns.is_some() => &mut self.broken,
            _ if !is_wanted || !kind.says_something(sentence) => return,
            None => &mut self.headless,
            Some(_) => &mut self.timeless,
        };
        tally.add(|| sentence.body.to_owned());
    }

    /// Writes the timestamps of a sentence.
    fn begin_line(&mut self, utc_ns: Option<i64>, elapsed_ns: Option<i64>, logged_ns: Option<i64>) {
        let utc_ns = utc_ns.or_else(|| elapsed_ns.map(|elapsed_ns| utc_cell(None, elapsed_ns)));
        self.line.clear();
        for (index, stamp) in [utc_ns, elapsed_ns, logged_ns].into_iter().enumerate() {
            let comma = if index == 0 { "" } else { "," };
            let _ = match stamp {
                Some(ns) => write!(self.line, "{comma}{ns}"),
                None => self.line.write_str(comma),
            };
        }
    }

    /// Destinations for sentences of this address, decoded and raw.
    fn route(&mut self, talker: &str, name: &str, whole: bool, topics: &mut Topics<'_>) -> Option<Route> {
        let address = format!("{talker}{name}");
        let key = if whole { address.clone() + WHOLE } else { address.clone() };
        if let Some(route) = self.routes.get(&key) {
            return *route;
        }
        if self.routes.len() >= MOST_ADDRESSES {
            return None;
        }
        // It has a topic of its own, separate from the decoded one of its type.
        let topic = if whole && Kind::of(name).is_some() { address.clone() + "-whole" } else { address };
        let info = TopicInfo { name: topic, type_name: name.to_owned(), encoding: "nmea".to_owned() };
        let layout =
            || Kind::of(name).map(|kind| kind.layout()).ok_or_else(|| "sentences of its type are not read".into());
        let route = match whole {
            true => topics.cells_route(info, WHOLE.as_bytes(), || Ok(whole_layout())).ok(),
            false => topics.cells_route(info, name.as_bytes(), layout).ok(),
        };
        self.routes.insert(key, route);
        route
    }

    /// What receivers say about themselves.
    fn note(&mut self, name: &str, sentence: &Sentence<'_>) {
        if name != "TXT" {
            return;
        }
        let text = sentence.field(4);
        if self.texts.len() < MOST_TEXTS && !self.texts.iter().any(|known| known == text) {
            self.texts.push(text.to_owned());
        }
    }

    /// Writes what the receiver says about itself, and what was wrong. The returned value dates the tables once they
    /// are made.
    pub(crate) fn finish(self, log: &mut Log, notices: &mut Notices) -> Dates {
        let text = match self.epochs.begin_ns {
            Some(_) => "sentences before the first date are dated backwards from it",
            None => "sentences have no date: the log has no RMC with a valid fix and no ZDA",
        };
        self.early.report(Code::Undated, "", text, notices);
        let text = "sentences before the first time, because the log begins inside an epoch: they are not used";
        self.headless.report(Code::Undated, "", text, notices);
        let text = "sentences without a time come after damage, or where the receiver lost the time; the sentences \
            before them may be of another epoch. They are not used";
        self.broken.report(Code::Undated.at(Severity::Warning), "", text, notices);
        let text = "sentences lack the time that their type should have: they cannot be dated";
        self.timeless.report(Code::Undecodable, "", text, notices);
        report_too_many_topics(&self.unplaced, "sentences", "", notices);
        if let Some((text, dates)) = self.age.suspicion() {
            notices.push(Code::DateInferred.at(Severity::Warning), "", dates, text);
        }
        if log.health.about.receiver_identities.is_empty() {
            log.health.about.receiver_identities = of_version(&self.texts, "TXT", "NMEA").into_iter().collect();
        }
        log.health.about.texts.extend(self.texts);
        log.health.extras.extend(self.heights.remark());
        Dates { begin_ns: self.epochs.begin_ns, vtg_leads: self.order.finish(notices) }
    }
}

/// Content of the UTC column: before the first date a value that [`Dates`] replaces.
fn utc_cell(utc_ns: Option<i64>, elapsed_ns: i64) -> i64 {
    utc_ns.unwrap_or(BEFORE_ANY_DATE_NS + elapsed_ns)
}

/// The dates of sentences before the first date, and the times that sentences should not have.
#[must_use]
pub(crate) struct Dates {
    begin_ns: Option<i64>,
    vtg_leads: bool,
}

impl Dates {
    /// Puts them into the tables; if the log has no date, such sentences have no UTC. Then it merges what one receiver
    /// sent under several addresses into one table.
    pub(crate) fn put(&self, log: &mut Log) {
        if self.vtg_leads {
            leave_undated(log);
        }
        for table in log.tables.iter_mut().filter(|table| table.topic.encoding == "nmea") {
            table.columns.retain_mut(|column| column.path != UTC || self.put_into(column));
        }
        talkers::unite(log);
    }

    /// Whether any row of the column has a date afterwards.
    fn put_into(&self, column: &mut Column) -> bool {
        let ColumnData::I64(stamps) = &mut column.data else { return true };
        let early = |ns: i64| ns < BEFORE_ANY_DATE_NS / 2;
        let Some(begin_ns) = self.begin_ns else {
            let valid = column.valid.get_or_insert_with(|| vec![true; stamps.len()]);
            for (valid, ns) in valid.iter_mut().zip(stamps) {
                *valid &= !early(*ns);
                *ns = if *valid { *ns } else { 0 };
            }
            return valid.contains(&true);
        };
        for ns in stamps.iter_mut().filter(|ns| early(**ns)) {
            *ns = begin_ns.saturating_add(*ns - BEFORE_ANY_DATE_NS);
        }
        true
    }
}

/// `PASHR` is an attitude only in the form `time,heading,T,roll,pitch,...`.
fn is_read(name: &str, sentence: &Sentence<'_>) -> bool {
    name != "PASHR" || sentence.field(3) == "T"
}

/// UTC from sentences with the time of day, some of which have the date.
#[derive(Debug, Default)]
struct Epochs {
    /// UTC of the last sentence with a time, once a date is known.
    utc_ns: Option<i64>,
    /// Time of day of the last sentence with a time.
    time_of_day_ns: Option<i64>,
    elapsed_ns: i64,
    /// UTC of the first sentence with a time, by the first date.
    begin_ns: Option<i64>,
    /// By talker: two receivers may alternate.
    by_talker: Vec<Talker>,
    /// Sentences without a time, by address.
    given: Vec<Given>,
    /// Bytes are missing after the last sentence with a time.
    is_broken: bool,
    /// The receiver has no time at present.
    is_timeless: bool,
    /// Timestamps of the last sentence with a time, except ZDA, which may come at any moment.
    epoch: Option<Stamped>,
    /// Timestamps of a ZDA after it, and whether ZDA has the time of the next epoch.
    by_zda: Option<Stamped>,
    zda_leads: Votes,
    /// Addresses of sentences in the epoch that normally have a time.
    said: Vec<String>,
}

/// UTC and elapsed time, ns.
type Stamped = (Option<i64>, i64);

impl Epochs {
    /// UTC, and the time since the first sentence with one. A sentence without a time belongs to the epoch of the
    /// previous sentence, of its own talker if that one sends times.
    /// `date` is the start of the day that the sentence states.
    fn stamp(
        &mut self,
        date: Option<i64>,
        time: Option<usize>,
        address: (&str, &str),
        sentence: &Sentence<'_>,
    ) -> (Option<i64>, Option<i64>) {
        let Some(field) = time else { return self.of_epoch(address) };
        let stamps = self.of_time(date, field, sentence);
        if let (utc_ns, Some(elapsed_ns)) = stamps {
            (self.is_broken, self.is_timeless) = (false, false);
            if address.1 == "ZDA" {
                self.by_zda = Some((utc_ns, elapsed_ns));
            } else {
                self.says_time(address, (utc_ns, elapsed_ns));
            }
        } else if sentence.body.split(',').nth(field) == Some("") {
            self.says_no_time(address);
        }
        stamps
    }

    fn says_time(&mut self, (talker, name): (&str, &str), stamped: Stamped) {
        if self.epoch.is_none_or(|(_, elapsed_ns)| elapsed_ns != stamped.1) {
            self.said.clear();
            if let Some((_, zda_ns)) = self.by_zda {
                self.zda_leads.add(zda_ns == stamped.1);
            }
        }
        self.note(talker, name);
        (self.epoch, self.by_zda) = (Some(stamped), None);
        if let Some(known) = self.talker(talker) {
            if let Some(common_ns) = known.pending_ns.take() {
                let own_ns = known.own.map(|(_, elapsed_ns)| elapsed_ns);
                known.shares.add(common_ns == stamped.1 && own_ns != Some(common_ns));
            }
            known.own = Some(stamped);
        }
    }

    /// A sentence whose time is empty: the receiver has lost the time, unless another receiver sends the times, or
    /// another sentence of this epoch has one.
    fn says_no_time(&mut self, (talker, name): (&str, &str)) {
        let says_times = |known: &Talker| known.own.is_some();
        let is_other = self.by_talker.iter().any(says_times)
            && !self.by_talker.iter().any(|known| known.name == talker && says_times(known));
        let is_next = self.said.iter().any(|said| said.strip_prefix(talker) == Some(name));
        self.is_timeless |= is_next && !is_other;
        self.note(talker, name);
    }

    fn note(&mut self, talker: &str, name: &str) {
        let is_it = |said: &String| said.strip_prefix(talker) == Some(name);
        if self.said.len() < MOST_TALKERS && !self.said.iter().any(is_it) {
            self.said.push(format!("{talker}{name}"));
        }
    }

    /// State of a talker; `None` if there are too many.
    fn talker(&mut self, talker: &str) -> Option<&mut Talker> {
        let known = self.by_talker.iter().position(|known| known.name == talker);
        let index = known.unwrap_or(self.by_talker.len());
        if known.is_none() && index < MOST_TALKERS {
            self.by_talker.push(Talker { name: talker.to_owned(), ..Talker::default() });
        }
        self.by_talker.get_mut(index)
    }

    /// The timestamps of a sentence without a time; it has none after damage.
    fn of_epoch(&mut self, (talker, name): (&str, &str)) -> (Option<i64>, Option<i64>) {
        let by_zda = self.by_zda.filter(|_| self.epoch.is_none() || self.zda_leads.are_most());
        let common = by_zda.or(self.epoch).filter(|_| !self.is_broken && !self.is_timeless);
        let Some(common) = common else { return (None, None) };
        let own = self.talker(talker).and_then(|known| {
            known.pending_ns = Some(common.1);
            known.own.filter(|_| !known.shares.are_most())
        });
        let own_ns = own.map(|(_, at)| at);
        let is_it = |given: &&mut Given| given.address.strip_prefix(talker) == Some(name);
        let mut is_common = false;
        if let Some(given) = self.given.iter_mut().find(is_it) {
            // Its talker sends times less often, or has stopped: they are not those of its epochs.
            given.is_common |= own_ns.is_some() && given.own_ns == own_ns;
            given.own_ns = own_ns;
            is_common = given.is_common;
        } else if self.given.len() < MOST_TALKERS {
            self.given.push(Given { address: format!("{talker}{name}"), own_ns, is_common });
        }
        let (utc_ns, elapsed_ns) = own.filter(|_| !is_common).unwrap_or(common);
        (utc_ns, Some(elapsed_ns))
    }

    fn of_time(&mut self, date: Option<i64>, field: usize, sentence: &Sentence<'_>) -> (Option<i64>, Option<i64>) {
        let Some(time_ns) = time_of_day_ns(sentence.field(field)) else { return (None, None) };
        if let Some(before_ns) = self.time_of_day_ns.replace(time_ns) {
            let elapsed_ns = self.elapsed_ns.saturating_add(nearest_step(time_ns - before_ns));
            self.elapsed_ns = elapsed_ns.clamp(-LONGEST_NS, LONGEST_NS);
        }
        self.utc_ns = match date {
            Some(midnight_ns) => Some(midnight_ns + time_ns),
            // The day nearest to the previous sentence: at midnight the time changes before the date does.
            None => self
                .utc_ns
                .map(|before_ns| before_ns.saturating_add(nearest_step(time_ns - before_ns.rem_euclid(DAY_NS)))),
        };
        self.begin_ns = self.begin_ns.or(self.utc_ns.map(|utc_ns| utc_ns.saturating_sub(self.elapsed_ns)));
        (self.utc_ns, Some(self.elapsed_ns))
    }
}

/// State of a talker.
#[derive(Debug, Default)]
struct Talker {
    name: String,
    /// The last time that it sent.
    own: Option<Stamped>,
    /// The last time from any talker when this one sent a sentence without a time.
    pending_ns: Option<i64>,
    /// Whether that was the time that it sent next: one receiver may send one sentence as GN and the other as GP. Two
    /// receivers that alternate have different times, or one follows the other.
    shares: Votes,
}

/// How often a condition held, and how often not.
#[derive(Debug, Default)]
struct Votes {
    ayes: u64,
    noes: u64,
}

impl Votes {
    fn add(&mut self, aye: bool) {
        *if aye { &mut self.ayes } else { &mut self.noes } += 1;
    }

    /// Whether it nearly always held.
    fn are_most(&self) -> bool {
        self.ayes > 2 * self.noes
    }
}

/// Sentences of one address, without a time.
#[derive(Debug)]
struct Given {
    address: String,
    /// The last time from its own talker before the last of them.
    own_ns: Option<i64>,
    /// The epochs are not those of its own talker.
    is_common: bool,
}

/// The earliest date at which the receiver can have existed, and the dates that it sends.
#[derive(Debug)]
struct Age {
    since: Since,
    /// Start of the day by valid RMC, and by ZDA, which has a date even without a fix.
    dates: [SaidDates; 2],
}

impl Default for Age {
    fn default() -> Age {
        Age { since: NO_LOG_BEFORE, dates: Default::default() }
    }
}

/// As the weeks of other logs are interpreted: only ten-bit weeks are below 1024.
const NO_LOG_BEFORE: Since = Since {
    week: 1024,
    why: "flightlag assumes that no log is from before 1999-08-22, when the GPS week first \
        rolled over",
};
/// NMEA 0183, version 4.10, of June 2012: it defines talkers for Galileo and others, and RMC has one more field.
const VERSION_4_10: Since =
    Since { week: 1691, why: "its sentences are of NMEA 0183 version 4.10, published in June 2012" };

impl Age {
    fn look(&mut self, talker: &str, name: &str, sentence: &Sentence<'_>, date: Option<i64>) {
        // Navigational status: safe, caution, unsafe, not valid. It follows the mode.
        let has_status = || {
            let [mode, status] = [12, 13].map(|field| sentence.field(field));
            name == "RMC" && mode.len() == 1 && ["S", "C", "U", "V"].contains(&status)
        };
        if self.since != VERSION_4_10 && (["GA", "GB", "GI", "GQ"].contains(&talker) || has_status()) {
            self.since = VERSION_4_10;
        }
        let [by_rmc, by_zda] = &mut self.dates;
        if let Some(date) = date {
            if name == "RMC" { by_rmc } else { by_zda }.add(Stamp(date));
        }
    }

    /// What is suspect about the dates, and how many are affected.
    fn suspicion(&self) -> Option<(String, u64)> {
        let [by_rmc, by_zda] = &self.dates;
        if by_rmc.is_empty() { by_zda } else { by_rmc }.suspicion(self.since)
    }
}

/// How many sentences have heights, and how many the geoid separation.
#[derive(Debug, Default)]
struct Heights {
    altitude: u64,
    separation: u64,
}

impl Heights {
    fn look(&mut self, name: &str, sentence: &Sentence<'_>) {
        let separation = match name {
            "GGA" => 11,
            "GNS" => 10,
            _ => return,
        };
        self.altitude += u64::from(plain(sentence.field(9)).is_some());
        self.separation += u64::from(plain(sentence.field(separation)).is_some());
    }

    /// What the channel map asks for: without the separation, as in most sentences of such a log, there is no height
    /// above the ellipsoid.
    fn remark(&self) -> Option<String> {
        (2 * self.separation < self.altitude).then(|| "NMEA height = above mean sea level".to_owned())
    }
}

/// A step between two times of day, of less than half a day.
fn nearest_step(step_ns: i64) -> i64 {
    (step_ns + DAY_NS / 2).rem_euclid(DAY_NS) - DAY_NS / 2
}

/// The start of the day that the sentence states: `ddmmyy` of a valid RMC and of PUBX,04, `mmddyy` of PTNL,GGK with a
/// fix, or the fields of ZDA.
fn midnight(name: &str, sentence: &Sentence<'_>) -> Option<i64> {
    let number = |text: &str| text.parse::<i64>().ok();
    let pairs = |field: usize| {
        let date = Some(sentence.field(field)).filter(|date| date.len() == 6)?;
        let two = |at: usize| number(date.get(at..at + 2)?);
        let year = two(4)?;
        // NMEA has two digits, and GPS began in 1980.
        Some([two(0)?, two(2)?, if year < 80 { 2000 + year } else { 1900 + year }])
    };
    let [day, month, year] = match name {
        "RMC" if is_valid(sentence.field(2)) => pairs(9)?,
        "PUBX,04" => pairs(3)?,
        "PTNL,GGK" if sentence.field(8) != "0" => pairs(3).map(|[month, day, year]| [day, month, year])?,
        "ZDA" => [number(sentence.field(2))?, number(sentence.field(3))?, number(sentence.field(4))?],
        _ => return None,
    };
    // There were no receivers before GPS.
    calendar_to_unix_ns([year, month, day, 0, 0, 0], 0).filter(|_| year >= 1980)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stamps(bodies: &[&str]) -> Vec<(Option<i64>, Option<i64>)> {
        let mut epochs = Epochs::default();
        let stamp = |body: &&str| {
            let sentence = Sentence { body, length: 0, checked: true };
            let (_, name) = sentence.address();
            epochs.stamp(midnight(name, &sentence), Kind::of(name).unwrap().time, sentence.address(), &sentence)
        };
        bodies.iter().map(stamp).collect()
    }

    #[test]
    fn the_date_of_rmc_dates_adjacent_sentences_even_across_midnight() {
        let s = NANOS_PER_SECOND;
        // date -u -d '2026-11-21T23:59:59Z' +%s
        let last_second = 1_795_305_599;
        let found = stamps(&[
            "GPGGA,235958.5",
            "GPRMC,235959,A,,,,,1,2,211126",
            "GPVTG,2,T,,M,1,N",
            "GPGGA,000000.25",
            "GPRMC,000000.25,V,,,,,,,010180",
            "GPGGA,235959.75",
            "GPZDA,000001,22,11,2026",
        ]);
        let utc: Vec<Option<i64>> = found.iter().map(|(utc, _)| *utc).collect();
        let at = |ns: i64| Some(last_second * s + ns);
        let quarter = s / 4;
        assert_eq!(utc, [None, at(0), at(0), at(s + quarter), at(s + quarter), at(3 * quarter), at(2 * s)]);
        let elapsed_ms: Vec<i64> = found.iter().map(|(_, elapsed)| elapsed.unwrap() / 1_000_000).collect();
        assert_eq!(elapsed_ms, [0, 500, 500, 1750, 1750, 1250, 2500]);
    }

    #[test]
    fn nonsense_times_do_not_overflow() {
        let mut epochs = Epochs::default();
        for sentence in 0..1_000_000 {
            let body = ["GPGGA,000000", "GPGGA,080000", "GPGGA,160000"][sentence % 3];
            epochs.stamp(None, Some(1), ("GP", "GGA"), &Sentence { body, length: 0, checked: true });
        }
        assert_eq!(epochs.elapsed_ns, LONGEST_NS);
        let body = "GPRMC,080000,A,,,,,1,2,211126";
        let sentence = Sentence { body, length: 0, checked: true };
        let (utc_ns, _) = epochs.stamp(midnight("RMC", &sentence), Some(1), ("GP", "RMC"), &sentence);
        assert_eq!(epochs.begin_ns, utc_ns.map(|utc_ns| utc_ns - LONGEST_NS));
    }

    #[test]
    fn a_sentence_without_time_has_no_timestamp() {
        assert_eq!(stamps(&["GPVTG,2,T,,M,1,N", "GPGGA,", "GPRMC,,V"]), [(None, None); 3]);
    }
}
