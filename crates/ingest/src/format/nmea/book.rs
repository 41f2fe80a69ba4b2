//! The way of each sentence to its topic, and the time that it is given.

use super::kind::{Kind, UTC, is_valid, whole_layout};
use super::order::{Order, leave_undated};
use super::sentence::{Sentence, plain, time_of_day_ns};
use super::talkers;
use crate::civil::calendar_to_unix_ns;
use crate::decode::{Route, Tally, Times, Topics, Vouch};
use crate::format::identity::of_version;
use crate::format::tell_too_many_topics;
use crate::reader::Log;
use crate::table::{Column, ColumnData, TopicInfo};
use crate::time::{SaidDates, Since};
use flight::{Code, NANOS_PER_SECOND, Notices, Severity, Stamp};
use logscan::Fate;
use std::collections::HashMap;
use std::fmt::Write;

const DAY_NS: i64 = 86_400 * NANOS_PER_SECOND;
/// Addresses that are told apart.
const MOST_ADDRESSES: usize = 4096;
/// Talkers, and addresses of sentences without a time, whose epochs are told apart.
const MOST_TALKERS: usize = 64;
/// Texts that are kept.
const MOST_TEXTS: usize = 100;

/// What `utc_ns` holds of a sentence before the first date: this and the time since the first sentence. UTC is never near
/// it, and [`Dates`] puts the date in.
const BEFORE_ANY_DATE_NS: i64 = i64::MIN / 2;
/// No log is longer, but one whose times are nonsense may step on by half a day with each sentence.
const LONGEST_NS: i64 = i64::MAX / 8;

/// Behind the address of sentences that are taken whole; no address has it.
const WHOLE: &str = " whole";

/// Gives sentences to the topics.
#[derive(Default)]
pub(crate) struct Book {
    /// By address.
    routes: HashMap<String, Option<Route>>,
    epochs: Epochs,
    age: Age,
    line: String,
    texts: Vec<String>,
    /// Before the first date.
    early: Tally,
    /// Of types that say no time, before the first that does.
    headless: Tally,
    /// Of types that say the time, without it.
    timeless: Tally,
    unplaced: Tally,
    /// Of types that say no time, behind damage.
    broken: Tally,
    heights: Heights,
    order: Order,
}

impl Book {
    /// Something is missing here: a sentence without a time may be of an epoch that was lost.
    pub(crate) fn breaks(&mut self) {
        self.epochs.is_broken = true;
    }

    /// A sentence, and when the logger had it, ns of UTC.
    pub(crate) fn sentence(
        &mut self,
        sentence: &Sentence<'_>,
        logged_ns: Option<i64>,
        topics: &mut Topics<'_>,
    ) -> Fate {
        let (talker, name) = sentence.address();
        topics.vouch(if sentence.checked { Vouch::Checksum } else { Vouch::Nothing });
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

    /// Counts a sentence that is given no time.
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

    /// Writes the stamps of a sentence.
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

    /// Where sentences of this address go, and where those of them go that are taken whole.
    fn route(&mut self, talker: &str, name: &str, whole: bool, topics: &mut Topics<'_>) -> Option<Route> {
        let address = format!("{talker}{name}");
        let key = if whole { address.clone() + WHOLE } else { address.clone() };
        if let Some(route) = self.routes.get(&key) {
            return *route;
        }
        if self.routes.len() >= MOST_ADDRESSES {
            return None;
        }
        // Beside those of its type that are read it has a topic of its own.
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

    /// What receivers say of themselves.
    fn note(&mut self, name: &str, sentence: &Sentence<'_>) {
        if name != "TXT" {
            return;
        }
        let text = sentence.field(4);
        if self.texts.len() < MOST_TEXTS && !self.texts.iter().any(|known| known == text) {
            self.texts.push(text.to_owned());
        }
    }

    /// Writes what the receiver says of itself, and what was wrong. What is returned dates the tables when they are made.
    pub(crate) fn finish(self, log: &mut Log, notices: &mut Notices) -> Dates {
        let text = match self.epochs.begin_ns {
            Some(_) => "sentences come before the first date, and are dated backwards from it",
            None => "sentences have no date: the log has no RMC with a valid fix and no ZDA",
        };
        self.early.tell(Code::Undated, "", text, notices);
        let text = "sentences come before the first time, because the log begins inside an epoch: they are not used";
        self.headless.tell(Code::Undated, "", text, notices);
        let text = "sentences that say no time stand behind damage, or where the receiver has lost the time, and those before them \
                    may be of another epoch: they are not used";
        self.broken.tell(Code::Undated.at(Severity::Warning), "", text, notices);
        let text = "sentences lack the time that their type has: nothing dates them";
        self.timeless.tell(Code::Undecodable, "", text, notices);
        tell_too_many_topics(&self.unplaced, "sentences", "", notices);
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

/// What the column of UTC holds: before the first date what [`Dates`] puts it into.
fn utc_cell(utc_ns: Option<i64>, elapsed_ns: i64) -> i64 {
    utc_ns.unwrap_or(BEFORE_ANY_DATE_NS + elapsed_ns)
}

/// The dates of sentences that stood before the first one, and the times that sentences should not have.
#[must_use]
pub(crate) struct Dates {
    begin_ns: Option<i64>,
    vtg_leads: bool,
}

impl Dates {
    /// Puts them into the tables; without any date in the log such sentences have no UTC. Then what one receiver said
    /// under several addresses is one table.
    pub(crate) fn put(&self, log: &mut Log) {
        if self.vtg_leads {
            leave_undated(log);
        }
        for table in log.tables.iter_mut().filter(|table| table.topic.encoding == "nmea") {
            table.columns.retain_mut(|column| column.path != UTC || self.put_into(column));
        }
        talkers::unite(log);
    }

    /// Whether any row of the column has a date then.
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

/// UTC from sentences that say the time of day, and some of which say the date.
#[derive(Debug, Default)]
struct Epochs {
    /// Of the last sentence with a time, once a date is known.
    utc_ns: Option<i64>,
    /// Of the last sentence with a time.
    time_of_day_ns: Option<i64>,
    elapsed_ns: i64,
    /// UTC of the first sentence with a time, by the first date.
    begin_ns: Option<i64>,
    /// By talker: two receivers may speak in turns.
    by_talker: Vec<Talker>,
    /// Sentences without a time, by address.
    given: Vec<Given>,
    /// Something is missing behind the last sentence with a time.
    is_broken: bool,
    /// The receiver has lost the time.
    is_timeless: bool,
    /// Stamps of the last sentence with a time that is no ZDA, which says the time whenever it likes.
    epoch: Option<Stamped>,
    /// Stamps of a ZDA behind it, and whether ZDA says the time of the epoch behind.
    by_zda: Option<Stamped>,
    zda_leads: Votes,
    /// Addresses of sentences of the epoch that have a time as a rule.
    said: Vec<String>,
}

/// UTC and elapsed time, ns.
type Stamped = (Option<i64>, i64);

impl Epochs {
    /// UTC, and the time since the first sentence with one. A sentence without a time is of the epoch of the one
    /// before it, of its own talker if that says times.
    /// `date` is the begin of the day that the sentence names.
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

    /// A sentence that lacks the time: the receiver has lost it, unless another one says the times, or another sentence has
    /// said that of this epoch.
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

    /// What is known of a talker; `None` if there are too many.
    fn talker(&mut self, talker: &str) -> Option<&mut Talker> {
        let known = self.by_talker.iter().position(|known| known.name == talker);
        let index = known.unwrap_or(self.by_talker.len());
        if known.is_none() && index < MOST_TALKERS {
            self.by_talker.push(Talker { name: talker.to_owned(), ..Talker::default() });
        }
        self.by_talker.get_mut(index)
    }

    /// The stamps of a sentence without a time; behind damage it has none.
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
            // Its talker says times more seldom, or no more: they are not those of its epochs.
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
            // The day that is nearest to the sentence before: at midnight the time is new before the date is.
            None => self
                .utc_ns
                .map(|before_ns| before_ns.saturating_add(nearest_step(time_ns - before_ns.rem_euclid(DAY_NS)))),
        };
        self.begin_ns = self.begin_ns.or(self.utc_ns.map(|utc_ns| utc_ns.saturating_sub(self.elapsed_ns)));
        (self.utc_ns, Some(self.elapsed_ns))
    }
}

/// Who says something.
#[derive(Debug, Default)]
struct Talker {
    name: String,
    /// The last time that it said.
    own: Option<Stamped>,
    /// The last time that anybody had said when it said something without one.
    pending_ns: Option<i64>,
    /// Whether that was the time which it said next: one receiver may say the one sentence as GN and the other as GP. Two
    /// receivers that speak in turns have different times, or one comes behind the other.
    shares: Votes,
}

/// How often something was so, and how often not.
#[derive(Debug, Default)]
struct Votes {
    ayes: u64,
    noes: u64,
}

impl Votes {
    fn add(&mut self, aye: bool) {
        *if aye { &mut self.ayes } else { &mut self.noes } += 1;
    }

    /// Whether it nearly always was.
    fn are_most(&self) -> bool {
        self.ayes > 2 * self.noes
    }
}

/// Sentences of one address, which say no time.
#[derive(Debug)]
struct Given {
    address: String,
    /// When its own talker had last said a time at the last of them.
    own_ns: Option<i64>,
    /// The epochs are not those of its own talker.
    is_common: bool,
}

/// Since when the receiver can have been, and the dates that it says.
#[derive(Debug)]
struct Age {
    since: Since,
    /// By valid RMC, and by ZDA, which says its date without a fix too: the begin of the day.
    dates: [SaidDates; 2],
}

impl Default for Age {
    fn default() -> Age {
        Age { since: NO_LOG_BEFORE, dates: Default::default() }
    }
}

/// As the weeks of other logs are read, which are below 1024 only in ten bits.
const NO_LOG_BEFORE: Since =
    Since { week: 1024, why: "no log read here is from before 1999-08-22, when the GPS week first rolled over" };
/// NMEA 0183, version 4.10, of June 2012: it names talkers of Galileo and others, and RMC has a field more.
const VERSION_4_10: Since =
    Since { week: 1691, why: "its sentences are those of NMEA 0183, version 4.10, which is of June 2012" };

impl Age {
    fn look(&mut self, talker: &str, name: &str, sentence: &Sentence<'_>, date: Option<i64>) {
        // Navigational status: safe, caution, unsafe, not valid. It stands behind the mode.
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

    /// What is suspected of the dates, and of how many.
    fn suspicion(&self) -> Option<(String, u64)> {
        let [by_rmc, by_zda] = &self.dates;
        if by_rmc.is_empty() { by_zda } else { by_rmc }.suspicion(self.since)
    }
}

/// How many sentences say heights, and how many how high the sea is there.
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

    /// What the map asks for: without the separation, as in most sentences of such a log, there is no height above the
    /// ellipsoid.
    fn remark(&self) -> Option<String> {
        (2 * self.separation < self.altitude).then(|| "NMEA height = above mean sea level".to_owned())
    }
}

/// A step between two times of day, by less than half a day.
fn nearest_step(step_ns: i64) -> i64 {
    (step_ns + DAY_NS / 2).rem_euclid(DAY_NS) - DAY_NS / 2
}

/// The begin of the day that the sentence names: `ddmmyy` of a valid RMC and of PUBX,04, `mmddyy` of PTNL,GGK with a fix,
/// or the fields of ZDA.
fn midnight(name: &str, sentence: &Sentence<'_>) -> Option<i64> {
    let number = |text: &str| text.parse::<i64>().ok();
    let pairs = |field: usize| {
        let date = Some(sentence.field(field)).filter(|date| date.len() == 6)?;
        let two = |at: usize| number(date.get(at..at + 2)?);
        let year = two(4)?;
        // NMEA has two digits, GPS began in 1980.
        Some([two(0)?, two(2)?, if year < 80 { 2000 + year } else { 1900 + year }])
    };
    let [day, month, year] = match name {
        "RMC" if is_valid(sentence.field(2)) => pairs(9)?,
        "PUBX,04" => pairs(3)?,
        "PTNL,GGK" if sentence.field(8) != "0" => pairs(3).map(|[month, day, year]| [day, month, year])?,
        "ZDA" => [number(sentence.field(2))?, number(sentence.field(3))?, number(sentence.field(4))?],
        _ => return None,
    };
    // No receiver was there before GPS.
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
    fn the_date_of_rmc_dates_the_sentences_around_it_also_across_midnight() {
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
    fn times_that_are_nonsense_do_not_overflow() {
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
    fn a_sentence_without_time_has_no_stamp() {
        assert_eq!(stamps(&["GPVTG,2,T,,M,1,N", "GPGGA,", "GPRMC,,V"]), [(None, None); 3]);
    }
}
