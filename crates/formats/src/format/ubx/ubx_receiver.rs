//! Time and identity of the receiver from its messages.

use super::message::{Derived, Message};
use super::pulse::{EarlyMarks, LAST_WEEK, Pulse, Pulses};
use super::ubx_identity::Identity;
use crate::civil::calendar_to_unix_ns;
use crate::decode::packed::text_of;
use crate::reader::Log;
use crate::table::ColumnData;
use crate::time::{SaidDates, Since};
use flight::{Geodetic, Stamp, WEEK_S, gps_of_unix};

/// Most receivers that are listed.
const MOST_RECEIVERS: usize = 20;
/// Placeholder for the week of the first message until a week is known; no real week is near it.
const UNTOLD: i64 = 0x8000;
/// Placeholder weeks of one run of a receiver's clock before a week is known. A clock that does not know the time
/// starts anywhere, and jumps when the time becomes known: then a new run begins.
const OF_RUN: i64 = 64;
const MOST_RUNS: i64 = 500;
/// Smaller steps are not jumps: messages of one epoch come in any order, and some are missing, ms.
const LATE_MS: i64 = 1000;
const GAP_MS: i64 = 10_000;
/// Information from the messages so far.
#[derive(Debug, Default)]
pub(super) struct Receiver {
    /// The latest known week, or [`UNTOLD`], and the time of week then, ms.
    week: Option<(i64, i64)>,
    /// The time of week of the last message before any week was known, ms.
    last_ms: Option<i64>,
    /// The receiver reported in this run of its clock that it does not know the time, and that is its last report.
    is_untimed_run: bool,
    is_untimed: bool,
    /// Difference between the first known week and the weeks counted until then.
    pub(super) weeks: Weeks,
    /// Of fixes.
    dates: SaidDates,
    /// The latest position, ECEF, m, and the time of week then, ms.
    place: Option<([f64; 3], i64)>,
    /// ECEF velocities without a known position.
    pub(super) nowhere: u64,
    pub(super) pulses: Pulses,
    pub(super) names: Vec<String>,
    pub(super) identity: Identity,
}

/// A velocity is rotated with a position at most this far from it in time, ms: after ten seconds of flight north has
/// turned by some 1e-4 rad.
const NEAR_MS: i64 = 10_000;

/// NAV-PVT came with the receivers of generation 7 (protocol 14, 2012), HNR-PVT later.
const PVT: Since = Since { week: 1669, why: "its messages exist only in receivers since 2012" };

impl Receiver {
    /// Takes a message; returns what is to be prepended to its payload.
    pub(super) fn observe(&mut self, message: Message, payload: &[u8]) -> Derived {
        let read = Read(payload);
        let itow_at = match message.name {
            "NAV-HPPOSLLH" | "NAV-HPPOSECEF" => 4,
            "HNR-INS" | "ESF-INS" => 8,
            _ => 0,
        };
        let itow_ms = i64::from(read.u32(itow_at));
        let is_dated = payload.len() >= message.shortest && !message.is_pulse();
        if is_dated {
            self.runs_to(itow_ms);
        }
        match message.name {
            // `weekValid` is bit 1 of NAV-TIMEGPS, bit 2 (and bit 3 for the time of week) of the flags of NAV-SOL.
            "NAV-TIMEGPS" if read.u8(11) & 2 != 0 => self.learn(read.u16(8).into(), itow_ms),
            "NAV-SOL" if read.u8(11) & 0xc == 0xc => self.learn(read.u16(8).into(), itow_ms),
            "NAV-PVT" | "NAV2-PVT" | "HNR-PVT" if read.u8(11) & 3 == 3 => self.learn_fix_date(read, 4, itow_ms),
            "NAV-PVAT" if read.u8(5) & 3 == 3 => self.learn_fix_date(read, 6, itow_ms),
            // The time of week and the week are valid; without the last bit its leap seconds are a default.
            "NAV-TIMEUTC" if read.u8(19) & 3 == 3 => drop(self.learn_date(read, 12, itow_ms)),
            _ => {}
        }
        let is_timed = is_timed(message.name, read);
        self.is_untimed = !is_timed.unwrap_or(!self.is_untimed);
        self.is_untimed_run |= self.is_untimed;
        if let Some(place) = place_of(message.name, read).filter(|_| payload.len() >= message.shortest) {
            self.place = Some((place, itow_ms));
        }
        let (week, tow_ms) = match payload.len() >= message.shortest {
            true if message.is_pulse() => self.pulse(message, read),
            true => (self.week_at(itow_ms), itow_ms),
            false => (0, 0),
        };
        Derived {
            week: u16::try_from(week).unwrap_or(0),
            tow_ms: u32::try_from(tow_ms).unwrap_or(0),
            fix_ok: is_fix_ok(message.name, read),
            carrier: carrier_of(message.name, read),
            place: match message.name {
                "NAV-HPPOSLLH" => precise(read),
                "NAV-HPPOSECEF" => precise_ecef(read),
                "NAV-VELECEF" => self.place_at(itow_ms),
                _ => [0.0; 3],
            },
        }
    }

    /// Position of the receiver, ECEF, m; the origin, and counted, if no position was received within seconds.
    fn place_at(&mut self, itow_ms: i64) -> [f64; 3] {
        let near = self.place.filter(|(_, told_ms)| (itow_ms - told_ms).abs() <= NEAR_MS);
        self.nowhere += u64::from(near.is_none());
        near.map_or([0.0; 3], |(place, _)| place)
    }

    fn learn_fix_date(&mut self, read: Read<'_>, at: usize, itow_ms: i64) {
        let unix_ns = self.learn_date(read, at, itow_ms);
        unix_ns.into_iter().for_each(|ns| self.dates.add(Stamp(ns)));
    }

    fn learn(&mut self, week: i64, itow_ms: i64) {
        if (0..LAST_WEEK).contains(&week) {
            let counted = self.week_at(itow_ms);
            self.weeks.ahead.get_or_insert(week - counted);
            self.week = Some((week, itow_ms));
        }
    }

    /// What is suspect about the dates, and how many are affected.
    pub(super) fn suspicion(&self) -> Option<(String, u64)> {
        self.dates.suspicion(PVT)
    }

    /// GPS week and time of week, ms, of a pulse; week 0 if they are unknown.
    fn pulse(&mut self, message: Message, read: Read<'_>) -> (i64, i64) {
        let known_week = self.week.map(|(week, _)| week);
        match message.name {
            "TIM-TP" => {
                let (flags, reference) = (read.u8(14), read.u8(15));
                self.pulses.given(Pulse::predicted(read.u16(12), read.u32(0), flags, reference), known_week)
            }
            _ => self.pulses.taken(read.u16(4), read.u32(8), read.u8(1), known_week),
        }
    }

    /// The week of the date whose fields begin at `at`; near week boundaries the time of week decides. Returns the
    /// date, UTC.
    fn learn_date(&mut self, read: Read<'_>, at: usize, itow_ms: i64) -> Option<i64> {
        let [month, day, hour, minute, second] = [2, 3, 4, 5, 6].map(|field| i64::from(read.u8(at + field)));
        let unix = calendar_to_unix_ns([read.u16(at).into(), month, day, hour, minute, second], 0);
        if let Some(gps) = unix.and_then(|unix| gps_of_unix(Stamp(unix))) {
            let start_ms = gps.0 / 1_000_000 - itow_ms;
            self.learn((start_ms + WEEK_S * 500).div_euclid(WEEK_S * 1000), itow_ms);
        }
        unix
    }

    /// The week of a time of week: it restarts on Sunday, and messages of one epoch come in any order.
    fn week_at(&mut self, itow_ms: i64) -> i64 {
        const HALF_MS: i64 = WEEK_S * 500;
        let (week, told_ms) = *self.week.get_or_insert((UNTOLD + OF_RUN * self.weeks.run, itow_ms));
        let week = match itow_ms - told_ms {
            step if step < -HALF_MS => week + 1,
            step if step > HALF_MS => return week - 1,
            step if step < 0 => return week,
            _ => week,
        };
        // A log may continue for more than half a week after the last message with a week.
        if !(self.is_untimed && self.weeks.are_told()) {
            self.week = Some((week, itow_ms));
        }
        week
    }

    /// Advances the clock to this time of week; before any week is known it may have jumped.
    fn runs_to(&mut self, itow_ms: i64) {
        const HALF_MS: i64 = WEEK_S * 500;
        if self.weeks.are_told() {
            return;
        }
        let step = |last_ms: i64| (itow_ms - last_ms + HALF_MS).rem_euclid(2 * HALF_MS) - HALF_MS;
        let leaps = self.last_ms.is_some_and(|last_ms| !(-LATE_MS..=GAP_MS).contains(&step(last_ms)));
        if leaps && self.is_untimed_run && self.weeks.run < MOST_RUNS {
            self.weeks.run += 1;
            (self.week, self.is_untimed_run) = (None, false);
        }
        self.last_ms = Some(itow_ms);
    }

    /// The times of marks before the message that states their time base.
    pub(super) fn early_marks(&mut self) -> EarlyMarks {
        let known_week = self.week.map(|(week, _)| week);
        self.pulses.early(known_week)
    }

    /// The last known week and time of week, ms.
    pub(super) fn known_time(&self) -> Option<(i64, i64)> {
        self.week
    }

    /// `MON-VER`: software, hardware, and thirty characters for each further line.
    pub(super) fn version(&mut self, payload: &[u8]) {
        let (software, rest) = payload.split_at_checked(30).unwrap_or((payload, &[]));
        let (hardware, more) = rest.split_at_checked(10).unwrap_or((rest, &[]));
        let more = more.chunks(30).map(text_of).filter(|text| !text.is_empty());
        let first = [format!("u-blox HW {}", text_of(hardware)), format!("SW {}", text_of(software))];
        let name = first.into_iter().chain(more.map(|text| text.into_owned())).collect::<Vec<_>>().join(", ");
        if self.names.len() < MOST_RECEIVERS && !self.names.contains(&name) {
            self.names.push(name);
        }
    }
}

/// The weeks of messages before the first known week.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Weeks {
    ahead: Option<i64>,
    /// The run of the clock in which it became known.
    run: i64,
}

impl Weeks {
    /// Whether any week was known.
    pub(super) fn are_told(self) -> bool {
        self.ahead.is_some()
    }

    /// Whether a week was known in this run of the clock.
    pub(super) fn are_of(self, run: i64) -> bool {
        self.are_told() && self.run == run
    }

    /// Whether this week of a message was a placeholder when it came.
    pub(super) fn is_unknown(week: u16) -> bool {
        i64::from(week) >= LAST_WEEK
    }

    /// The run of the clock that a placeholder week belongs to.
    pub(super) fn run_of(week: u16) -> i64 {
        (i64::from(week) - UNTOLD + OF_RUN / 2).div_euclid(OF_RUN)
    }

    /// Puts the weeks into the tables, except for runs of a clock that did not know the time; 0 if no week became
    /// known.
    pub(crate) fn put(self, log: &mut Log) {
        let tables = log.tables.iter_mut().filter(|table| table.topic.encoding == "ubx");
        for column in tables.flat_map(|table| &mut table.columns).filter(|column| column.path == "gps_week") {
            let ColumnData::F64(weeks) = &mut column.data else { continue };
            let is_unknown = |week: &f64| *week >= LAST_WEEK as f64;
            let is_untimed =
                |week: &f64| self.are_told() && is_unknown(week) && Weeks::run_of(*week as u16) != self.run;
            if weeks.iter().any(is_untimed) {
                let valid = column.valid.get_or_insert_with(|| vec![true; weeks.len()]);
                valid.iter_mut().zip(weeks.iter()).for_each(|(valid, week)| *valid &= !is_untimed(week));
            }
            for week in weeks.iter_mut().filter(|week| is_unknown(week)) {
                let ahead = self.ahead.filter(|_| !is_untimed(week));
                *week = ahead.map_or(0.0, |ahead| *week + ahead as f64);
            }
        }
    }
}

/// A position is good enough to define north if its accuracy is better than this, m: that far off, north is rotated by
/// some 1e-3 rad.
const WORST_PLACE_M: f64 = 10_000.0;

/// Position of the receiver, ECEF, m, from messages that have it, and its accuracy.
fn place_of(name: &str, read: Read<'_>) -> Option<[f64; 3]> {
    let ecef = |at: usize| [at, at + 4, at + 8].map(|at| f64::from(read.i32(at)) / 100.0);
    let accuracy = |at: usize, per_m: f64| f64::from(read.u32(at)) / per_m;
    let (place, accuracy_m) = match name {
        "NAV-POSECEF" => (ecef(4), accuracy(16, 100.0)),
        "NAV-SOL" => (ecef(12), accuracy(24, 100.0)),
        // Bit 0 of its flags says that the position is invalid.
        "NAV-HPPOSECEF" if read.u8(23) & 1 == 0 => (precise_ecef(read), accuracy(24, 1e4)),
        "NAV-POSLLH" => {
            let [longitude, latitude] = [4, 8].map(|at| f64::from(read.i32(at)) / 1e7);
            let at = Geodetic::from_degrees(latitude, longitude, f64::from(read.i32(12)) / 1000.0).to_ecef();
            ([at.x, at.y, at.z], accuracy(20, 1000.0))
        }
        _ => return None,
    };
    (accuracy_m < WORST_PLACE_M).then_some(place)
}

/// The position of `NAV-HPPOSECEF`, m: cm, and tenths of mm.
fn precise_ecef(read: Read<'_>) -> [f64; 3] {
    [(8, 20), (12, 21), (16, 22)].map(|(at, fine_at)| {
        let tenths_mm = i64::from(read.i32(at)) * 100 + i64::from(read.u8(fine_at) as i8);
        tenths_mm as f64 / 1e4
    })
}

/// Latitude and longitude, deg, and height, m, of `NAV-HPPOSLLH`: 1e-7 deg and mm, and hundredths and tenths of those.
fn precise(read: Read<'_>) -> [f64; 3] {
    let whole = |at, fine_at, share: i64| i64::from(read.i32(at)) * share + i64::from(read.u8(fine_at) as i8);
    [whole(12, 25, 100) as f64 / 1e9, whole(8, 24, 100) as f64 / 1e9, whole(16, 26, 10) as f64 / 1e4]
}

/// Little-endian numbers of a payload; zero where it is too short, which the decoder refuses.
#[derive(Debug, Clone, Copy)]
struct Read<'p>(&'p [u8]);

impl Read<'_> {
    fn bytes<const N: usize>(self, at: usize) -> [u8; N] {
        self.0.get(at..).and_then(<[u8]>::first_chunk).copied().unwrap_or([0; N])
    }

    fn u8(self, at: usize) -> u8 {
        u8::from_le_bytes(self.bytes(at))
    }

    fn u16(self, at: usize) -> u16 {
        u16::from_le_bytes(self.bytes(at))
    }

    fn u32(self, at: usize) -> u32 {
        u32::from_le_bytes(self.bytes(at))
    }

    fn i32(self, at: usize) -> i32 {
        i32::from_le_bytes(self.bytes(at))
    }
}

/// Whether the receiver says that its fix is usable; true for a message that does not say.
fn is_fix_ok(name: &str, read: Read<'_>) -> bool {
    match name {
        "NAV-PVT" | "NAV2-PVT" => read.u8(21) & 1 != 0,
        "NAV-PVAT" => read.u8(25) & 1 != 0,
        "HNR-PVT" => read.u8(17) & 1 != 0,
        "NAV-SOL" => read.u8(11) & 1 != 0,
        "NAV-STATUS" => read.u8(5) & 1 != 0,
        // Bit 0 says that the position is invalid.
        "NAV-HPPOSLLH" => read.u8(3) & 1 == 0,
        "NAV-HPPOSECEF" => read.u8(23) & 1 == 0,
        // The turn rates about all three axes are valid.
        "ESF-INS" | "HNR-INS" => read.u8(1) & 7 == 7,
        _ => true,
    }
}

/// State of the carrier phase solution: 0 none, 1 float, 2 fixed.
fn carrier_of(name: &str, read: Read<'_>) -> u8 {
    match name {
        "NAV-PVT" | "NAV2-PVT" => read.u8(21) >> 6,
        "NAV-PVAT" => read.u8(25) >> 6,
        _ => 0,
    }
}

/// Whether the time of a message is valid; `None` for one that does not say.
fn is_timed(name: &str, read: Read<'_>) -> Option<bool> {
    match name {
        "NAV-TIMEGPS" => Some(read.u8(11) & 2 != 0),
        "NAV-SOL" => Some(read.u8(11) & 0xc == 0xc),
        "NAV-PVT" | "NAV2-PVT" | "HNR-PVT" => Some(read.u8(11) & 3 == 3),
        "NAV-PVAT" => Some(read.u8(5) & 3 == 3),
        "NAV-TIMEUTC" => Some(read.u8(19) & 3 == 3),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn observe(receiver: &mut Receiver, class: u8, number: u8, payload: &[u8]) -> Derived {
        receiver.observe(Message::of(class, number).unwrap(), payload)
    }

    fn pvt(itow_ms: u32, year: u16, rest: [u8; 5], valid: u8) -> Vec<u8> {
        let mut payload = [&itow_ms.to_le_bytes()[..], &year.to_le_bytes(), &rest, &[valid]].concat();
        payload.resize(92, 0);
        payload[21] = 1;
        payload
    }

    #[test]
    fn the_week_comes_from_the_date_and_increments_on_sunday() {
        let mut receiver = Receiver::default();
        // No week known yet, and a date that is not valid.
        assert!(Weeks::is_unknown(observe(&mut receiver, 1, 2, &[0; 28]).week));
        assert!(Weeks::is_unknown(observe(&mut receiver, 1, 7, &pvt(5, 2026, [11, 21, 23, 59, 42], 1)).week));
        assert!(!receiver.weeks.are_told());
        // 2026-11-21 is a Saturday: with 18 leap seconds week 2445 ends at 23:59:42 UTC.
        let last = observe(&mut receiver, 1, 7, &pvt(604_799_900, 2026, [11, 21, 23, 59, 41], 3));
        assert_eq!((last.week, last.fix_ok), (2445, true));
        let mut next = [0; 28];
        next[..4].copy_from_slice(&100_u32.to_le_bytes());
        assert_eq!(observe(&mut receiver, 1, 2, &next).week, 2446);
        next[..4].copy_from_slice(&604_799_950_u32.to_le_bytes());
        assert_eq!(observe(&mut receiver, 1, 2, &next).week, 2445);
        // Weeks after the last known one, and epochs that come late.
        for hour in 1..24 * 17 {
            for (back, expected) in [(0, hour), (1, hour - 1)] {
                let now_ms = 3_600_000 * u64::from(hour - back);
                next[..4].copy_from_slice(&((now_ms % (WEEK_S as u64 * 1000)) as u32).to_le_bytes());
                assert_eq!(u32::from(observe(&mut receiver, 1, 2, &next).week), 2446 + expected / (24 * 7), "{hour}");
            }
        }
    }

    #[test]
    fn a_time_mark_uses_the_time_base_of_the_receivers_own_pulses() {
        let mut receiver = Receiver::default();
        let mut mark = [0; 28];
        mark[1] = 1 << 6 | 1 << 3;
        mark[4..6].copy_from_slice(&1089_u16.to_le_bytes());
        mark[8..12].copy_from_slice(&1000_u32.to_le_bytes());
        let tp = |flags, reference| [&[0; 12][..], &1089_u16.to_le_bytes(), &[flags, reference]].concat();
        let mut week = |pulse: &[u8]| {
            observe(&mut receiver, 0x0d, 1, pulse);
            let derived = observe(&mut receiver, 0x0d, 3, &mark);
            (derived.week, derived.tow_ms)
        };
        // In GPS time; in BeiDou time; in UTC, which does not show the system; in GLONASS time.
        let marks = [tp(0, 0), tp(0, 2), tp(1, 0), tp(0, 1)].map(|pulse| week(&pulse));
        assert_eq!(marks, [(1089, 1000), (2445, 15_000), (2445, 15_000), (0, 0)]);
        let untimed = &receiver.pulses.untimed;
        assert_eq!((untimed.count, &*untimed.first), (2, "TIM-TP, in GLONASS time"));
    }

    #[test]
    fn the_digits_of_a_high_precision_position_are_combined() {
        let mut payload = vec![0; 36];
        payload[8..12].copy_from_slice(&(-1_220_312_345_i32).to_le_bytes());
        payload[12..16].copy_from_slice(&373_412_345_i32.to_le_bytes());
        payload[16..20].copy_from_slice(&12_345_i32.to_le_bytes());
        payload[24..27].copy_from_slice(&[-67_i8 as u8, 89, 4]);
        let derived = observe(&mut Receiver::default(), 1, 0x14, &payload);
        assert_eq!((derived.place, derived.fix_ok), ([37.341_234_589, -122.031_234_567, 12.3454], true));
    }

    #[test]
    fn a_receiver_is_listed_once() {
        let mut receiver = Receiver::default();
        let field = |text: &str, size: usize| {
            let mut field = text.as_bytes().to_vec();
            field.resize(size, 0);
            field
        };
        let version = [field("EXT CORE 1.00", 30), field("00190000", 10), field("MOD=ZED-F9P", 30)].concat();
        receiver.version(&version);
        receiver.version(&version);
        receiver.version(&[]);
        assert_eq!(receiver.names, ["u-blox HW 00190000, SW EXT CORE 1.00, MOD=ZED-F9P", "u-blox HW , SW "]);
    }
}
