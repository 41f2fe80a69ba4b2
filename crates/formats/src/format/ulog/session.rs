//! State of a log while it is read; routes its messages to the topics.

use super::about::Gathered;
use super::beside::Beside;
use super::boots::LastStamp;
use super::formats::{Extent, Formats, Stamp};
use super::ulog_record::{Entry, FLAG_BITS, FlagBits, Kind, Subscription, Trust, judge};
use crate::bytes::Bytes;
use crate::decode::packed::float_of;
use crate::decode::schema::Number;
use crate::decode::{Route, Tally, Times, Topics};
use crate::format::report_unplaced;
use crate::table::TopicInfo;
use flight::{Code, Notices, Severity};
use logscan::Fate;
use std::collections::HashMap;
use std::rc::Rc;

/// The topic with the flight modes, and its field.
const STATUS: (&str, &str) = ("vehicle_status", "nav_state");
/// The topic that lists the receivers, and its field.
const RECEIVER: (&str, &str) = ("sensor_gps", "device_id");

/// The state of one log.
pub(super) struct Session<'t, 'w> {
    topics: &'t mut Topics<'w>,
    /// No message was accepted yet.
    is_fresh: bool,
    formats: Formats,
    /// By the number of their messages.
    known: Vec<Option<Known>>,
    /// Resolved subscriptions: by name and instance.
    meanings: HashMap<(String, u8), Meaning>,
    pub(super) gathered: Gathered,
    beside: Beside,
    pub(super) flags: FlagBits,
    /// Offset from message timestamps to log time.
    pub(super) offset_us: u64,
    /// Timestamp of the last message.
    latest_us: Option<u64>,
    /// The same, without wrong timestamps.
    pub(super) last_stamp: LastStamp,
    /// Whether the definitions are over.
    began: bool,
    dropouts: Dropouts,
    pub(super) unplaced: Tally,
    redefined: Tally,
    unknown: Tally,
    back_jumps: Tally,
    odd: Odd,
}

/// Messages whose format has defects.
#[derive(Debug, Default)]
struct Odd {
    bad_formats: Tally,
    without_stamp: Tally,
    /// For formats that end with padding, with it and without.
    padded: Tally,
    unpadded: Tally,
}

impl Odd {
    #[inline]
    fn look(&mut self, known: &Known, payload: &[u8]) {
        let extent = match &known.meaning.extent {
            Ok(extent) => extent,
            Err(reason) => return self.bad_formats.add(|| reason.as_ref().to_owned()),
        };
        if extent.stamp.is_none() {
            self.without_stamp.add(|| format!("topic {}", known.name));
        }
        if extent.full > extent.shortest {
            let tally = if payload.len() == extent.full { &mut self.padded } else { &mut self.unpadded };
            tally.add(|| known.name.clone());
        }
    }

    /// The less frequent of messages with padding and without, if both occur.
    fn rarer(&self) -> Option<&Tally> {
        let rarer = if self.padded.count <= self.unpadded.count { &self.padded } else { &self.unpadded };
        (rarer.count > 0).then_some(rarer)
    }
}

/// A subscribed topic.
struct Known {
    name: String,
    instance: u8,
    meaning: Meaning,
    last_us: u64,
}

/// How to read the messages of a topic.
#[derive(Debug, Clone)]
struct Meaning {
    /// How often a format had been replaced by then, and how many there were.
    replaced: u64,
    version: u64,
    route: Route,
    /// What is wrong with the format, if it cannot be used.
    extent: Result<Extent, Rc<str>>,
    observed: Option<Observed>,
}

/// What a message says about the vehicle, and the position of the value.
#[derive(Debug, Clone, Copy)]
enum Observed {
    /// [`STATUS`].
    Mode(usize),
    /// [`RECEIVER`].
    Receiver(usize),
}

#[derive(Debug, Default)]
struct Dropouts {
    count: u64,
    total_ms: u64,
    longest_ms: u16,
}

impl<'t, 'w> Session<'t, 'w> {
    pub(super) fn new(topics: &'t mut Topics<'w>) -> Session<'t, 'w> {
        Session {
            topics,
            is_fresh: true,
            formats: Formats::default(),
            known: vec![],
            meanings: HashMap::new(),
            gathered: Gathered::default(),
            beside: Beside::default(),
            flags: FlagBits::default(),
            offset_us: 0,
            latest_us: None,
            last_stamp: LastStamp::default(),
            began: false,
            dropouts: Dropouts::default(),
            unplaced: Tally::default(),
            redefined: Tally::default(),
            unknown: Tally::default(),
            back_jumps: Tally::default(),
            odd: Odd::default(),
        }
    }

    /// State for the next log in the file.
    pub(super) fn next(self, offset_us: u64) -> Session<'t, 'w> {
        Session { offset_us, ..Session::new(self.topics) }
    }

    /// How well a message vouches for itself.
    pub(super) fn judge(&self, kind: Kind, body: &[u8]) -> Trust {
        match kind {
            Kind::FlagBits if self.is_fresh && body.len() == FLAG_BITS => Trust::Sure,
            Kind::FlagBits if self.is_fresh && body.len() > FLAG_BITS => Trust::Fits,
            Kind::Data => match self.known_of(body).map(|known| &known.meaning.extent) {
                Some(Ok(extent)) if extent.fits(body) => Trust::Sure,
                Some(Ok(_)) => Trust::Wrong("a message with a length that does not fit its format"),
                Some(Err(_)) | None => judge(kind, body),
            },
            Kind::Subscribe => match Subscription::parse(body).and_then(|s| std::str::from_utf8(s.name).ok()) {
                Some(name) if self.formats.has(name) => Trust::Sure,
                _ => judge(kind, body),
            },
            _ => judge(kind, body),
        }
    }

    #[inline]
    fn known_of(&self, body: &[u8]) -> Option<&Known> {
        self.known.get(usize::from(Bytes(body).u16()?))?.as_ref()
    }

    /// Whether a message, whose number and length agree with its topic's format, was logged near the last one.
    pub(super) fn is_near(&self, body: &[u8]) -> bool {
        let stamp = self.known_of(body).and_then(|known| known.meaning.extent.as_ref().ok()?.stamp);
        let stamp = stamp.filter(|stamp| stamp.number == Number::U64);
        let at_us = stamp.zip(body.get(2..)).and_then(|(stamp, payload)| stamp.read(payload, None));
        at_us.is_some_and(|at_us| at_us > 0 && self.last_stamp.is_near(at_us))
    }

    /// Takes a message. The error returned says what is wrong with it.
    pub(super) fn take(&mut self, kind: Kind, body: &[u8]) -> Result<Fate, String> {
        self.is_fresh = false;
        self.began |= matches!(kind, Kind::Subscribe | Kind::Text | Kind::TaggedText);
        if kind != Kind::Data && self.topics.takes_extras() {
            let at_us = self.began.then(|| self.latest_us.unwrap_or_default());
            self.beside.take(kind, body, at_us, self.topics);
        }
        match kind {
            Kind::Data => return Ok(self.data(body)),
            Kind::Format => self.formats.add(body)?,
            Kind::Subscribe => self.subscribe(body)?,
            Kind::Info => Entry::parse(body).iter().for_each(|entry| self.gathered.information(entry)),
            Kind::InfoPart => behind_flag(body).iter().for_each(|entry| self.gathered.part(entry)),
            Kind::DefaultParameter => {
                behind_flag(body).iter().for_each(|entry| self.gathered.default_parameter(entry));
            }
            Kind::Parameter => {
                let at_us = self.began.then(|| self.latest_us.unwrap_or_default());
                Entry::parse(body).iter().for_each(|entry| self.gathered.parameter(entry, at_us));
            }
            Kind::Text => self.text(body, false).unwrap_or_default(),
            Kind::TaggedText => self.text(body, true).unwrap_or_default(),
            Kind::Dropout => self.dropouts.add(Bytes(body).u16().unwrap_or_default()),
            Kind::FlagBits => self.flags = FlagBits::parse(body).unwrap_or_default(),
            // Messages after an unsubscribe still belong to the topic.
            Kind::Unsubscribe | Kind::Sync => {}
        }
        Ok(Fate::Structure)
    }

    /// A message of unknown type.
    pub(super) fn take_unknown(&mut self, letter: u8, length: usize) -> Fate {
        self.unknown.add(|| format!("type {:?}, {length} bytes", char::from(letter)));
        Fate::Skipped
    }

    fn text(&mut self, body: &[u8], tagged: bool) -> Option<()> {
        let mut rest = Bytes(body);
        let level = rest.u8()?;
        let tag = if tagged { Some(rest.u16()?) } else { None };
        let at_us = rest.u64()?;
        self.gathered.text(level, tag, at_us, &String::from_utf8_lossy(rest.0));
        Some(())
    }

    fn subscribe(&mut self, body: &[u8]) -> Result<(), String> {
        let Subscription { instance, number, name } = Subscription::parse(body).ok_or("a truncated subscription")?;
        let name = std::str::from_utf8(name).map_err(|_| "a subscription without a name")?;
        let place = usize::from(number);
        if self.known.len() <= place {
            self.known.resize_with(place + 1, || None);
        }
        let former = self.known.get_mut(place).and_then(Option::take);
        if former.is_some_and(|known| known.name != name || known.instance != instance) {
            self.redefined.add(|| format!("{number}, now {name:.128}"));
        }
        let meaning = self.meaning(name, instance)?;
        if let Some(slot) = self.known.get_mut(place) {
            *slot = Some(Known { name: name.to_owned(), instance, meaning, last_us: 0 });
        }
        Ok(())
    }

    fn meaning(&mut self, name: &str, instance: u8) -> Result<Meaning, String> {
        let key = (name.to_owned(), instance);
        // An additional format only matters if one was missing.
        let holds = |m: &&Meaning| {
            m.replaced == self.formats.replaced && (m.extent.is_ok() || m.version == self.formats.version)
        };
        if let Some(meaning) = self.meanings.get(&key).filter(holds) {
            return Ok(meaning.clone());
        }
        let meaning = self.find_meaning(name, instance)?;
        self.meanings.insert(key, meaning.clone());
        Ok(meaning)
    }

    fn find_meaning(&mut self, name: &str, instance: u8) -> Result<Meaning, String> {
        let topic = if instance == 0 { name.to_owned() } else { format!("{name}_{instance}") };
        let info = TopicInfo { name: topic, type_name: name.to_owned(), encoding: "ulog".to_owned() };
        let extent = self.formats.extent(name);
        let formats = &self.formats;
        let layout = |wanted: &_| extent.clone().and_then(|_| formats.layout(name, wanted));
        let route = self.topics.packed_route(info, formats.identity(name).as_bytes(), layout)?;
        let observed = match (name, instance) {
            (topic, 0) if topic == STATUS.0 => formats.place(name, STATUS.1, Number::U8).map(Observed::Mode),
            (topic, _) if topic == RECEIVER.0 => formats.place(name, RECEIVER.1, Number::U32).map(Observed::Receiver),
            _ => None,
        };
        let Formats { replaced, version, .. } = self.formats;
        Ok(Meaning { replaced, version, route, extent: extent.map_err(Rc::from), observed })
    }

    #[inline]
    fn data(&mut self, body: &[u8]) -> Fate {
        self.began = true;
        let mut rest = Bytes(body);
        let number = rest.u16().unwrap_or_default();
        let payload = rest.0;
        let Some(known) = self.known.get_mut(usize::from(number)).and_then(Option::as_mut) else {
            self.unplaced.add(|| format!("number {number}"));
            return Fate::Skipped;
        };
        self.odd.look(known, payload);
        let Meaning { route, extent, observed, .. } = &known.meaning;
        let stamp = extent.as_ref().ok().and_then(|extent| extent.stamp);
        let at_us = stamp.and_then(|s| s.read(payload, self.latest_us)).or(self.latest_us).unwrap_or_default();
        if at_us < known.last_us {
            self.back_jumps.add(|| format!("topic {} at {} µs", known.name, known.last_us));
        }
        known.last_us = at_us;
        // A message published without a timestamp has zero, which says nothing about the time of the next one.
        if at_us > 0 {
            self.latest_us = Some(at_us);
            self.last_stamp.add(at_us);
        }
        let nanos = |us: u64| i64::try_from(us.saturating_mul(1000)).unwrap_or(i64::MAX);
        if let Some(observed) = observed {
            observed.observe(payload, known.instance, nanos(at_us), &mut self.gathered);
        }
        let logged_ns = nanos(at_us.saturating_add(self.offset_us));
        self.topics.message(*route, Times { logged_ns, published_ns: None }, payload)
    }

    /// Passes everything besides the topics to its receiver.
    pub(super) fn hand_on(&mut self) {
        self.beside.hand_on(self.topics);
    }

    /// Reports what happened, except damage.
    pub(super) fn conclude(&self, file: &str, notices: &mut Notices) {
        self.report_lost(file, notices);
        self.report_lenient(file, notices);
        if self.gathered.not_kept > 0 {
            let text = "more names, or changes of parameters and modes, than are listed";
            notices.push(Code::NotListed, file, self.gathered.not_kept, text);
        }
        let more = self.gathered.texts_not_kept();
        if more > 0 {
            notices.push(Code::NotListed, file, more, "more logged texts; they are counted, but not listed");
        }
    }

    /// Reports what is missing, or was not understood.
    fn report_lost(&self, file: &str, notices: &mut Notices) {
        let Dropouts { count, total_ms, longest_ms } = self.dropouts;
        if count > 0 {
            let text = format!(
                "the logger could not keep up: dropouts of {:.3} s in total, the longest {longest_ms} ms; messages \
                 published during them were not written",
                total_ms as f64 * 1e-3
            );
            notices.push(Code::Dropout, file, count, text);
        }
        report_unplaced(&self.unplaced, file, notices);
        self.odd.bad_formats.report(Code::Undecodable, file, "messages with a format that cannot be used", notices);
        let what = Code::UnknownRecord.at(Severity::Loss);
        self.unknown.report(what, file, "messages of an unknown type", notices);
        if self.flags.unknown() {
            let text = "the log states that it uses features that flightlag does not know: what was read may be \
                wrong";
            notices.push(what, file, 1, text);
        }
    }

    /// Reports irregular data that were read.
    fn report_lenient(&self, file: &str, notices: &mut Notices) {
        self.redefined.report(Code::Redefined, file, "numbers of topics were reused for other topics", notices);
        if self.formats.replaced > 0 {
            let text = "formats were replaced by others with the same name; each topic is read with the format \
                before it";
            notices.push(Code::Redefined, file, self.formats.replaced, text);
        }
        let text = "messages with a timestamp earlier than that of the message before";
        self.back_jumps.report(Code::UnreliableStamps, file, text, notices);
        if let Some(rarer) = self.odd.rarer() {
            let text =
                "messages with a different padding than all others: they may have been written with another format";
            rarer.report(Code::ReadLeniently, file, text, notices);
        }
        let text = "messages without a timestamp get that of the message before";
        self.odd.without_stamp.report(Code::Undated.at(Severity::Warning), file, text, notices);
    }
}

/// Information and parameters after a byte of flags.
fn behind_flag(body: &[u8]) -> Option<Entry<'_>> {
    Entry::parse(body.get(1..)?)
}

impl Observed {
    fn observe(self, payload: &[u8], instance: u8, at_ns: i64, gathered: &mut Gathered) {
        let behind = |offset: usize| Bytes(payload.get(offset..).unwrap_or_default());
        match self {
            Observed::Mode(offset) => behind(offset).u8().into_iter().for_each(|state| gathered.mode(state, at_ns)),
            Observed::Receiver(offset) => {
                behind(offset).u32().into_iter().for_each(|id| gathered.receiver(instance, id))
            }
        }
    }
}

impl Dropouts {
    fn add(&mut self, ms: u16) {
        self.count += 1;
        self.total_ms += u64::from(ms);
        self.longest_ms = self.longest_ms.max(ms);
    }
}

impl Stamp {
    /// In µs. Timestamps of fewer than 64 bits wrap around: the candidate nearest to `latest_us` is chosen.
    #[inline]
    fn read(self, payload: &[u8], latest_us: Option<u64>) -> Option<u64> {
        let bytes = payload.get(self.offset..)?;
        if self.number == Number::U64 {
            return bytes.first_chunk().copied().map(u64::from_le_bytes);
        }
        // 8 bits, in ms.
        let unit_us = if self.number.size() == 1 { 1000 } else { 1 };
        let stamp = float_of(self.number, bytes).filter(|x| *x >= 0.0)? as u64 * unit_us;
        let turn = (1_u64 << (8 * self.number.size()).min(63)) * unit_us;
        Some(latest_us.map_or(stamp, |latest| nearest(stamp, turn, latest)))
    }
}

/// The value nearest to `to` among `stamp`, `stamp + turn`, ...
fn nearest(stamp: u64, turn: u64, to: u64) -> u64 {
    let turns = to.saturating_sub(stamp).saturating_add(turn / 2) / turn;
    stamp.saturating_add(turns.saturating_mul(turn))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_short_timestamp_is_unwrapped_to_the_value_nearest_to_the_log() {
        let turn = 1_u64 << 16;
        for truth in [0_u64, 5, 40_000, 65_535, 65_536, 1_000_000, 123_456_789] {
            for latest in [truth, truth + 30_000, truth.saturating_sub(30_000)] {
                assert_eq!(nearest(truth % turn, turn, latest), truth, "{latest}");
            }
        }
        let stamp = Stamp { offset: 1, number: Number::U8 };
        assert_eq!(stamp.read(&[0, 20], Some(256_000)), Some(276_000));
        assert_eq!(stamp.read(&[0, 20], None), Some(20_000));
    }
}
