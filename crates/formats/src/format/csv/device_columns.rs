//! Non-numeric information in tables of known devices: the zone or the device in column names, and status words. The
//! reader turns it into names that channel maps have, and into derived columns.

use crate::reader::{FieldRequest, Selection, ValueKind};
use crate::table::{Column, ColumnData, Table};
use flight::{Code, Notices};

/// A derived column: 1 where the receiver of an inertial system has a position, else 0.
const FIX: &str = "fix_ok";
/// A derived column: the offset of the dates and times from UTC, `+hh:mm`.
const OFFSET: &str = "utc_offset";
/// A derived column: `UTC_Year` where `UTC_Valid` shows that UTC is known.
const YEAR: &str = "utc_year";

/// Modes of an OxTS receiver without a position: none, searching, Doppler alone (at once, from two kinds of its raw
/// data, or afterwards), no data, blanked, not known (OxTS' ROS 2 driver, `GNSS_POS_MODE` and `nav_sat_status`).
const OXTS_WITHOUT_FIX: [i64; 10] = [0, 1, 2, 10, 11, 12, 19, 20, 25, 36];
/// The column of the mode, as the versions of NAVsuite name it.
const OXTS_MODES: [&str; 3] = ["GpsPosMode", "GPS position mode", "GNSS position mode"];
/// Bit of Xsens' status word: the receiver has a fix (MT Low Level Communication Protocol, `StatusWord`).
const XSENS_FIX: i64 = 1 << 2;
/// Derived columns that show whether a sample has a quantity, and its columns in an export of MT Manager. MT Manager can
/// be set to write zeros for a quantity that a sample lacks: a quantity is present if one of its columns is not zero. A
/// velocity of zero is present where there is a position.
const XSENS_GIVEN: [(&str, [&str; 3]); 7] = [
    ("position_given", ["Latitude", "Longitude", "Altitude"]),
    ("velocity_given", ["Vel_X", "Vel_Y", "Vel_Z"]),
    ("velocity_given", ["Vel_E", "Vel_N", "Vel_U"]),
    ("orientation_given", ["Roll", "Pitch", "Yaw"]),
    ("rate_given", ["Gyr_X", "Gyr_Y", "Gyr_Z"]),
    ("force_given", ["Acc_X", "Acc_Y", "Acc_Z"]),
    ("field_given", ["Mag_X", "Mag_Y", "Mag_Z"]),
];
/// Xsens' position, and the column that shows whether there is one.
const XSENS_POSITION: [&str; 3] = XSENS_GIVEN[0].1;
/// Xsens' status word, read as text. A number would lose the leading zeros that show its base.
const XSENS_WORD: &str = "StatusWord";
/// Bits of Xsens' `UTC_Valid`: the date, the time of day, and the leap seconds are known.
const XSENS_UTC: i64 = 0b111;

/// A table's names as channel maps have them, and its derived columns.
#[derive(Debug, Default)]
pub(super) struct DeviceColumns {
    pub(super) names: Vec<String>,
    /// A notice about the names.
    pub(super) notice: Option<String>,
    derived: Vec<DerivedColumn>,
}

/// A column that the reader derives, and its source.
#[derive(Debug)]
enum DerivedColumn {
    /// The same text in every row.
    Offset(String),
    Mode(String),
    Status,
    Year,
    Given(&'static str, [&'static str; 3]),
}

impl DeviceColumns {
    pub(super) fn of(names: &[String]) -> DeviceColumns {
        let (names, notice) = of_one_device(names);
        let (names, offset) = without_zone(names);
        let has = |name: &str| names.iter().any(|n| n == name);
        let mode = names.iter().find(|name| OXTS_MODES.contains(&without_unit(name)));
        let xsens = has("SampleTimeFine");
        let derived = [
            offset.map(DerivedColumn::Offset),
            mode.cloned().map(DerivedColumn::Mode),
            (xsens && has(XSENS_WORD)).then_some(DerivedColumn::Status),
            (xsens && has("UTC_Year")).then_some(DerivedColumn::Year),
        ];
        let given = XSENS_GIVEN.iter().filter(|(_, columns)| xsens && columns.iter().all(|column| has(column)));
        let given = given.map(|(path, columns)| DerivedColumn::Given(path, *columns));
        let mut derived: Vec<DerivedColumn> =
            derived.into_iter().flatten().chain(given).filter(|derived| !has(derived.path())).collect();
        derived.dedup_by_key(|derived| derived.path());
        DeviceColumns { names, notice, derived }
    }

    /// A column that must be kept as written.
    pub(super) fn kept_as_text(&self) -> Option<&'static str> {
        self.derived.iter().any(|derived| matches!(derived, DerivedColumn::Status)).then_some(XSENS_WORD)
    }

    /// The selection, extended by the sources of the wanted derived columns.
    pub(super) fn sources(&self, wanted: &Selection) -> Selection {
        let Selection::Fields(fields) = wanted else { return wanted.clone() };
        let asked = self.derived.iter().filter(|derived| fields.iter().any(|f| f.path == derived.path()));
        let mut all = fields.clone();
        for source in asked.flat_map(DerivedColumn::sources) {
            if !all.contains(&source) {
                all.push(source);
            }
        }
        Selection::Fields(all)
    }

    /// Adds the wanted derived columns, and removes columns that only they needed.
    pub(super) fn add_derived(&self, table: &mut Table, wanted: &Selection, notices: &mut Notices) {
        if self.derived.is_empty() {
            return;
        }
        let made: Vec<Column> = self
            .derived
            .iter()
            .filter(|derived| is_wanted(wanted, derived.path()))
            .filter_map(|derived| derived.column(table, notices))
            .collect();
        if let Selection::Fields(fields) = wanted {
            let kind = |column: &Column| match column.data {
                ColumnData::Text(_) => ValueKind::Text,
                _ => ValueKind::Number,
            };
            table.columns.retain(|c| fields.iter().any(|f| f.path == c.path && f.kind == kind(c)));
        }
        table.columns.extend(made);
        table.columns.sort_by(|a, b| a.path.cmp(&b.path));
    }
}

fn is_wanted(wanted: &Selection, path: &str) -> bool {
    match wanted {
        Selection::Skip => false,
        Selection::All | Selection::Raw => true,
        Selection::Fields(fields) => fields.iter().any(|f| f.path == path),
    }
}

impl DerivedColumn {
    fn path(&self) -> &'static str {
        match self {
            DerivedColumn::Offset(_) => OFFSET,
            DerivedColumn::Mode(_) | DerivedColumn::Status => FIX,
            DerivedColumn::Year => YEAR,
            DerivedColumn::Given(path, _) => path,
        }
    }

    fn sources(&self) -> Vec<FieldRequest> {
        let of = |path: &str, kind| FieldRequest { path: path.to_owned(), kind };
        match self {
            // Any column would do: a table without wanted columns is not read.
            DerivedColumn::Offset(_) => vec![of("Date", ValueKind::Text)],
            DerivedColumn::Mode(name) => vec![of(name, ValueKind::Text)],
            DerivedColumn::Status => vec![of(XSENS_WORD, ValueKind::Text)],
            DerivedColumn::Year => vec![of("UTC_Year", ValueKind::Number), of("UTC_Valid", ValueKind::Number)],
            DerivedColumn::Given(_, columns) => {
                columns.iter().chain(&XSENS_POSITION).map(|column| of(column, ValueKind::Number)).collect()
            }
        }
    }

    fn column(&self, table: &Table, notices: &mut Notices) -> Option<Column> {
        match self {
            DerivedColumn::Offset(offset) => Some(Column {
                path: OFFSET.into(),
                data: ColumnData::Text(std::iter::repeat_n(offset, table.rows).collect()),
                valid: None,
            }),
            DerivedColumn::Mode(name) => {
                let column = table.column(name)?;
                let words: Vec<Option<String>> = (0..table.rows).map(|row| cell_text(column, row)).collect();
                let has_fix = |mode: i64| i64::from(!OXTS_WITHOUT_FIX.contains(&mode));
                fixes(column, &words, |text| mode_of(text).map(has_fix), table, notices)
            }
            DerivedColumn::Status => {
                let column = table.texts(XSENS_WORD)?;
                // A device that measures sets some bit: all zeros mean that there is no status word.
                let is_word = |word: &String| word.bytes().any(|digit| digit != b'0');
                let words: Vec<Option<String>> =
                    (0..table.rows).map(|row| cell_text(column, row).filter(is_word)).collect();
                let radix = radix_of(words.iter().flatten().map(String::as_str));
                let has_fix = |word: i64| i64::from(word & XSENS_FIX != 0);
                fixes(column, &words, |text| word_of(text, radix?).map(has_fix), table, notices)
            }
            DerivedColumn::Year => Some(year(table, notices)),
            DerivedColumn::Given(path, columns) => given(path, columns, table),
        }
    }
}

/// Whether a row has the values that Xsens exports in these columns.
fn given(path: &str, columns: &[&str; 3], table: &Table) -> Option<Column> {
    let columns: Vec<&Column> = columns.iter().map(|column| table.column(column)).collect::<Option<_>>()?;
    let values = |row| columns.iter().map(|column| column.number(row)).collect::<Option<Vec<f64>>>();
    let is_there = |values: &[f64]| values.iter().any(|value| *value != 0.0);
    let place =
        |row| -> Vec<f64> { XSENS_POSITION.iter().filter_map(|column| table.column(column)?.number(row)).collect() };
    let is_at_rest = |row| path.starts_with("velocity") && is_there(&place(row));
    let given = |row| Some(i64::from(is_there(&values(row)?) || is_at_rest(row)));
    Some(of_integers(path, &(0..table.rows).map(given).collect::<Vec<_>>()))
}

/// The trimmed text of a row.
fn cell_text(column: &Column, row: usize) -> Option<String> {
    let number = || column.integer(row).map(|number| number.to_string());
    column.text(row).map(|text| text.trim().to_owned()).or_else(number).filter(|text| !text.is_empty())
}

/// Whether there is a fix, row by row; unknown words are reported.
fn fixes(
    column: &Column,
    words: &[Option<String>],
    understood: impl Fn(&str) -> Option<i64>,
    table: &Table,
    notices: &mut Notices,
) -> Option<Column> {
    let fixes: Vec<Option<i64>> = words.iter().map(|word| understood(word.as_ref()?)).collect();
    let foreign = || words.iter().zip(&fixes).filter(|(_, fix)| fix.is_none()).filter_map(|(word, _)| word.as_ref());
    if let Some(word) = foreign().next() {
        let text = format!("{} has unknown words such as {word:?}: it is unknown whether there was a fix", column.path);
        notices.push(Code::UnknownWord, &table.topic.name, foreign().count() as u64, text);
    }
    fixes.iter().any(Option::is_some).then(|| of_integers(FIX, &fixes))
}

/// The year of rows whose UTC is known; without that information, the year as written.
fn year(table: &Table, notices: &mut Notices) -> Column {
    let integer = |path: &str, row| table.column(path).and_then(|column| column.integer(row));
    let known = |row| integer("UTC_Valid", row).is_none_or(|valid| valid & XSENS_UTC == XSENS_UTC);
    let years: Vec<Option<i64>> = (0..table.rows).map(|row| integer("UTC_Year", row).filter(|_| known(row))).collect();
    let unsure = (0..table.rows).filter(|&row| integer("UTC_Year", row).is_some() && !known(row)).count();
    if unsure > 0 {
        let text = "rows without UTC: UTC_Valid does not state that date, time and leap seconds are known";
        notices.push(Code::Undated, &table.topic.name, unsure as u64, text);
    }
    of_integers(YEAR, &years)
}

fn of_integers(path: &str, values: &[Option<i64>]) -> Column {
    let data = ColumnData::F64(values.iter().map(|value| value.unwrap_or_default() as f64).collect());
    let valid = values.iter().any(Option::is_none).then(|| values.iter().map(Option::is_some).collect());
    Column { path: path.into(), data, valid }
}

/// The mode of an OxTS receiver: `6`, or in words followed by the number, `Integer (6)`.
fn mode_of(text: &str) -> Option<i64> {
    let number = text.rsplit_once('(').and_then(|(_, number)| number.strip_suffix(')')).unwrap_or(text);
    let number: f64 = number.trim().parse().ok()?;
    (number.fract() == 0.0).then_some(number as i64)
}

/// Number base of the words in a column: binary, decimal or hexadecimal; `None` if it is ambiguous.
fn radix_of<'t>(words: impl Iterator<Item = &'t str>) -> Option<u32> {
    let words: Vec<&str> = words.collect();
    let any = |is: fn(&&str) -> bool| words.iter().any(is);
    let all = |is: fn(&&str) -> bool| words.iter().all(is);
    if words.is_empty() {
        None
    } else if all(|word| word.len() == 32 && word.bytes().all(|b| matches!(b, b'0' | b'1'))) {
        Some(2)
    } else if any(|word| word.bytes().any(|b| b.is_ascii_alphabetic()) || (word.len() > 1 && word.starts_with('0'))) {
        Some(16)
    } else {
        // Eight decimal digits may also be a hexadecimal word.
        any(|word| word.len() != 8).then_some(10)
    }
}

fn word_of(text: &str, radix: u32) -> Option<i64> {
    i64::from_str_radix(text.strip_prefix("0x").or_else(|| text.strip_prefix("0X")).unwrap_or(text), radix).ok()
}

fn without_unit(name: &str) -> &str {
    name.strip_suffix("()").unwrap_or(name).trim_end()
}

/// NAVgraph puts the device before each name, `[Tag 0 SN1234 Real-Time]Latitude (deg)`. The names of the first device
/// are used as they are.
fn of_one_device(names: &[String]) -> (Vec<String>, Option<String>) {
    let split = |name: &'_ str| -> Option<(usize, bool)> {
        let (_, plain) = name.strip_prefix('[')?.split_once(']')?;
        Some((name.len() - plain.len(), plain.starts_with("Time (GPS")))
    };
    let Some(device) = names.iter().find_map(|name| name.get(..split(name).filter(|(_, time)| *time)?.0)) else {
        return (names.to_vec(), None);
    };
    let others = names.iter().any(|name| split(name).is_some() && !name.starts_with(device));
    let notice = others.then(|| format!("the table has the columns of several devices; those of {device} are used"));
    let taken = |plain: &str| names.iter().any(|name| name == plain);
    let plain = |name: &String| match name.strip_prefix(device) {
        Some(plain) if !plain.is_empty() && !taken(plain) => plain.to_owned(),
        _ => name.clone(),
    };
    (names.iter().map(plain).collect(), notice)
}

/// NAVgraph puts the zone into the names of two columns, `Date (UTC+1,00)` and `Time (UTC+1,00)`: they become `Date`
/// and `Time`.
fn without_zone(names: Vec<String>) -> (Vec<String>, Option<String>) {
    let zone = |column: &str, name: &str| {
        let zone = name.strip_prefix(column)?.strip_prefix(" (UTC")?.strip_suffix(')')?;
        offset_of(zone)
    };
    let of = |column: &str| names.iter().find_map(|name| zone(column, name));
    let taken = names.iter().any(|name| name == "Date" || name == "Time");
    let Some(offset) = of("Date").filter(|date| !taken && of("Time").as_ref() == Some(date)) else {
        return (names, None);
    };
    let plain = |name: String| {
        let column = ["Date", "Time"].into_iter().find(|column| zone(column, &name).is_some());
        column.map_or(name, str::to_owned)
    };
    (names.into_iter().map(plain).collect(), Some(offset))
}

/// `+1,00` or `-9.50` as `+01:00` and `-09:30`. Zones are whole quarters of an hour, which distinguishes hundredths
/// from minutes.
fn offset_of(zone: &str) -> Option<String> {
    let sign = zone.chars().next().filter(|sign| matches!(sign, '+' | '-'))?;
    let (hours, rest) = zone.get(1..)?.split_once(['.', ',', ':'])?;
    let digits = |text: &&str| text.bytes().all(|b| b.is_ascii_digit());
    let hours: u8 = Some(hours).filter(digits)?.parse().ok().filter(|hours| *hours <= 14)?;
    let minutes = match rest {
        "00" => 0,
        "15" | "25" => 15,
        "30" | "50" => 30,
        "45" | "75" => 45,
        _ => return None,
    };
    Some(format!("{sign}{hours:02}:{minutes:02}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_zone_is_read_in_hundredths_of_hours_or_minutes_and_nonsense_rejected() {
        for (zone, offset) in [
            ("+1,00", Some("+01:00")),
            ("+0.00", Some("+00:00")),
            ("-3.50", Some("-03:30")),
            ("+5,75", Some("+05:45")),
            ("+5:30", Some("+05:30")),
            ("+14.00", Some("+14:00")),
            ("+15.00", None),
            ("++1.00", None),
            ("+1", None),
            ("1.00", None),
            ("", None),
            ("+1.10", None),
        ] {
            assert_eq!(offset_of(zone).as_deref(), offset, "{zone}");
        }
    }

    #[test]
    fn the_digits_of_a_status_word_show_their_base_where_they_can() {
        let fix = |words: &[&str]| {
            let radix = radix_of(words.iter().copied());
            words.iter().map(|word| word_of(word, radix?).map(|word| word & XSENS_FIX != 0)).collect::<Vec<_>>()
        };
        assert_eq!(fix(&["131", "135", "8388743"]), [Some(false), Some(true), Some(true)]);
        assert_eq!(fix(&["00000083", "00000087"]), [Some(false), Some(true)]);
        assert_eq!(fix(&["0x83", "0x0C"]), [Some(false), Some(true)]);
        assert_eq!(fix(&["1000008b", "10000087"]), [Some(false), Some(true)]);
        let binary = |low: u8| format!("{low:032b}");
        assert_eq!(fix(&[&binary(0b11), &binary(0b111)]), [Some(false), Some(true)]);
        assert_eq!(fix(&["25165831", "25165827"]), [None, None]);
    }

    #[test]
    fn a_mode_is_a_number_or_words_followed_by_one() {
        let modes = ["6", "6.000", "Integer (6)", "Integer", "6.5"].map(mode_of);
        assert_eq!(modes, [Some(6), Some(6), Some(6), None, None]);
    }
}
