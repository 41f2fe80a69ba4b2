//! The time of a pulse that the receiver emits, `TIM-TP`, or receives, `TIM-TM2`.
//!
//! Bits and numbers are those of u-blox's interface descriptions (M8, F9, F10), as pyubx2 and the crate `ublox` have
//! them.

use crate::decode::Tally;
use crate::reader::Log;
use crate::table::ColumnData;
use flight::{GPS_EPOCH_UNIX_S, NANOS_PER_SECOND, Stamp, WEEK_S, gps_ahead_of_utc_s};

/// Weeks in messages are before this one, of the year 2117.
pub(super) const LAST_WEEK: i64 = 0x1c00;
const WEEK_MS: i64 = WEEK_S * 1000;
/// BeiDou time begins on 2006-01-01, and has had no leap seconds since.
const BEIDOU_MS: i64 = 1356 * WEEK_MS + 14_000;
/// Galileo counts seconds as GPS does, and weeks from 1999-08-22 on.
const GALILEO_WEEKS: i64 = 1024;

/// Time system of a pulse.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) enum System {
    /// GPS, or unspecified.
    #[default]
    Gps,
    Glonass,
    BeiDou,
    Galileo,
    NavIc,
}

impl System {
    /// `timeRefGnss`. Receivers of the generations 4 to 6 have another field in its place.
    fn of(reference: u8) -> System {
        match reference & 0xf {
            1 => System::Glonass,
            2 => System::BeiDou,
            3 => System::Galileo,
            4 => System::NavIc,
            _ => System::Gps,
        }
    }
}

/// Time base of a pulse.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Base {
    Of(System),
    /// Weeks and times of week like those of GPS, but with leap seconds: the default configuration.
    Utc,
    /// The receiver's own clock.
    Receiver,
    NotValid,
}

/// A pulse with the time in its message.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pulse {
    week: u16,
    tow_ms: u32,
    base: Base,
}

impl Pulse {
    /// From `TIM-TP`.
    pub(super) fn predicted(week: u16, tow_ms: u32, flags: u8, reference: u8) -> Pulse {
        let base = if flags & 1 == 1 { Base::Utc } else { Base::Of(System::of(reference)) };
        Pulse { week, tow_ms, base }
    }

    /// From `TIM-TM2`, the rising edge; `system` is the one that is configured for the receiver's own pulses.
    pub(super) fn marked(week: u16, tow_ms: u32, flags: u8, system: System) -> Pulse {
        let is_valid = flags >> 6 & 1 == 1;
        let base = match flags >> 3 & 3 {
            _ if !is_valid => Base::NotValid,
            1 => Base::Of(system),
            2 => Base::Utc,
            _ => Base::Receiver,
        };
        Pulse { week, tow_ms, base }
    }

    /// The time system, if the time is in that of a system.
    pub(super) fn system(self) -> Option<System> {
        match self.base {
            Base::Of(system) => Some(system),
            _ => None,
        }
    }

    /// GPS week and time of week, ms; otherwise why they are unknown. `known_week` is the week from the receiver's other
    /// messages.
    pub(super) fn gps(self, known_week: Option<i64>) -> Result<(i64, i64), &'static str> {
        let count_ms = i64::from(self.week) * WEEK_MS + i64::from(self.tow_ms);
        let is_known = |week: i64| known_week.is_some_and(|known_week| (week - known_week).abs() <= 1);
        let ahead_ms = match self.base {
            Base::Of(System::BeiDou) => BEIDOU_MS,
            Base::Of(System::Galileo) if is_known(i64::from(self.week) + GALILEO_WEEKS) => GALILEO_WEEKS * WEEK_MS,
            Base::Of(System::Gps | System::Galileo) => 0,
            Base::Utc => 1000 * leaps_s(count_ms),
            Base::Of(System::Glonass) => return Err("in GLONASS time"),
            Base::Of(System::NavIc) => return Err("in NavIC time"),
            Base::Receiver => return Err("in receiver time"),
            Base::NotValid => return Err("the time is not valid"),
        };
        let gps_ms = count_ms + ahead_ms;
        match gps_ms.div_euclid(WEEK_MS) {
            week if week < LAST_WEEK => Ok((week, gps_ms.rem_euclid(WEEK_MS))),
            _ => Err("in an invalid week"),
        }
    }
}

/// The pulses of a log.
#[derive(Debug, Default)]
pub(super) struct Pulses {
    /// Time base of pulses by the last TIM-TP; TIM-TM2 does not state it itself.
    system: Option<System>,
    /// Time base by the first TIM-TP.
    first: Option<System>,
    /// TIM-TM2 pulses before that; assumed to be in GPS time.
    early: Vec<Pulse>,
    /// Pulses without a known GPS time, and why the first has none.
    pub(super) untimed: Tally,
}

impl Pulses {
    /// A pulse that the receiver emits; GPS week and time of week, ms, or 0 for both. `known_week` is the week from other
    /// messages.
    pub(super) fn given(&mut self, pulse: Pulse, known_week: Option<i64>) -> (i64, i64) {
        self.system = pulse.system().or(self.system);
        self.first = self.first.or(self.system);
        self.time(pulse, known_week, "TIM-TP")
    }

    /// A pulse that the receiver receives, from the fields of `TIM-TM2`.
    pub(super) fn taken(&mut self, week: u16, tow_ms: u32, flags: u8, known_week: Option<i64>) -> (i64, i64) {
        let pulse = Pulse::marked(week, tow_ms, flags, self.system.unwrap_or_default());
        if self.first.is_none() {
            self.early.push(pulse);
        }
        self.time(pulse, known_week, "TIM-TM2")
    }

    fn time(&mut self, pulse: Pulse, known_week: Option<i64>, name: &str) -> (i64, i64) {
        pulse.gps(known_week).unwrap_or_else(|why| {
            self.untimed.add(|| format!("{name}, {why}"));
            (0, 0)
        })
    }

    /// The times of the first rows of TIM-TM2, by the TIM-TP after them; `None` for one that is kept.
    pub(super) fn early(&mut self, known_week: Option<i64>) -> EarlyMarks {
        let Some(system) = self.first.filter(|system| *system != System::Gps) else { return EarlyMarks::default() };
        let early = std::mem::take(&mut self.early).into_iter();
        let anew = early.map(|pulse| {
            let is_of_system = matches!(pulse.base, Base::Of(_));
            is_of_system.then(|| self.time(Pulse { base: Base::Of(system), ..pulse }, known_week, "TIM-TM2"))
        });
        EarlyMarks(anew.collect())
    }
}

/// GPS week and time of week, ms, of the first rows of TIM-TM2.
#[derive(Debug, Default)]
pub(crate) struct EarlyMarks(Vec<Option<(i64, i64)>>);

impl EarlyMarks {
    /// Puts them into the table.
    pub(crate) fn put(&self, log: &mut Log) {
        let tables = log.tables.iter_mut().filter(|t| t.topic.encoding == "ubx" && t.topic.name == "TIM-TM2");
        for column in tables.flat_map(|table| &mut table.columns) {
            let part: fn((i64, i64)) -> i64 = match &*column.path {
                "gps_week" => |(week, _)| week,
                "gps_tow_ms" => |(_, tow_ms)| tow_ms,
                _ => continue,
            };
            let ColumnData::F64(cells) = &mut column.data else { continue };
            for (cell, time) in cells.iter_mut().zip(&self.0) {
                *cell = time.map_or(*cell, |time| part(time) as f64);
            }
        }
    }
}

/// Leap seconds at a time that counts UTC as GPS counts its own.
fn leaps_s(count_ms: i64) -> i64 {
    let unix_s = GPS_EPOCH_UNIX_S + count_ms.div_euclid(1000);
    unix_s.checked_mul(NANOS_PER_SECOND).map_or(0, |ns| gps_ahead_of_utc_s(Stamp(ns)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tp(tow_ms: u32, week: u16, flags: u8, reference: u8) -> Result<(i64, i64), &'static str> {
        Pulse::predicted(week, tow_ms, flags, reference).gps(None)
    }

    #[test]
    fn a_pulse_in_utc_is_later_in_gps_time_by_the_leap_seconds() {
        // A receiver of 2021: the pulse at 237888 s of GPS time is reported at 237887 s, in UTC.
        assert_eq!(tp(237_870_000, 2146, 0xb, 15), Ok((2146, 237_888_000)));
        assert_eq!(tp(237_888_000, 2146, 0xa, 15), Ok((2146, 237_888_000)));
        // The time system is not valid then.
        assert_eq!(tp(237_870_000, 2146, 0xb, 2), Ok((2146, 237_888_000)));
        // The last seconds of a week are the first of the next; in 2012 there were 15 and 16 leap seconds.
        assert_eq!(tp(604_790_000, 2146, 1, 15), Ok((2147, 8000)));
        assert_eq!([tp(604_799_000, 1694, 1, 0), tp(0, 1695, 1, 0)], [Ok((1695, 14_000)), Ok((1695, 16_000))]);
    }

    #[test]
    fn a_pulse_in_another_systems_time_is_converted_or_has_no_time() {
        // 2022-11-30 12:52:37 UTC is second 305575 of GPS week 2238, 305561 of BeiDou week 882 and 305575 of Galileo
        // week 1214.
        assert_eq!(tp(305_561_000, 882, 0, 0x72), Ok((2238, 305_575_000)));
        // The first seconds of a GPS week are the last of BeiDou's.
        assert_eq!(tp(604_790_000, 1089, 0, 2), Ok((2446, 4000)));
        let galileo = Pulse::predicted(1214, 305_575_000, 0, 3);
        assert_eq!(
            [galileo.gps(Some(2238)), galileo.gps(Some(1214))],
            [Ok((2238, 305_575_000)), Ok((1214, 305_575_000))]
        );
        assert_eq!([tp(0, 2445, 0, 1), tp(0, 2445, 0, 4)], [Err("in GLONASS time"), Err("in NavIC time")]);
        assert_eq!(tp(0, 0xffff, 0, 0), Err("in an invalid week"));
        // Unspecified, and the reserved byte of old receivers.
        assert!([0, 3, 5, 15, 0xf0].iter().all(|&reference| tp(7, 2445, 0, reference) == Ok((2445, 7))));
    }

    #[test]
    fn a_time_mark_has_a_time_if_valid_and_not_in_the_receivers_clock() {
        let at = |flags: u8| Pulse::marked(2146, 1000, flags, System::Gps).gps(None);
        let valid = 1 << 6;
        assert_eq!([at(valid | 1 << 3), at(valid | 2 << 3)], [Ok((2146, 1000)), Ok((2146, 19_000))]);
        assert_eq!([at(valid), at(valid | 3 << 3)], [Err("in receiver time"); 2]);
        assert_eq!([at(0x80), at(1 << 3), at(2 << 3)], [Err("the time is not valid"); 3]);
    }
}
