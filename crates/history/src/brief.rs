//! The parts of a row needed for trends, latencies and proofs, in little memory: a history of years has a million rows.

use crate::dataset::History;
use crate::error::HistoryError;
use crate::row::{Dimension, Row, column};
use crate::schema::current;
use convert::{Sheet, read_parquet_columns};
use record::NamedFlight;
use std::collections::{HashMap, HashSet};
use std::fs::File;
use std::path::Path;
use std::sync::Arc;

/// The first 64 bits of a hexadecimal BLAKE3; for hashes of several files, combined. `None` for other texts.
fn short(hashes: &str) -> Option<u64> {
    let mut bits = hashes.split('+').map(|hash| u64::from_str_radix(hash.get(..16)?, 16).ok());
    bits.try_fold(0_u64, |all, one| Some(all.rotate_left(1) ^ one?))
}

/// A text shared by many rows.
type Shared = Option<Arc<str>>;

/// The page of a campaign's flight, relative to the page that links to it.
pub type PageOf<'a> = &'a dyn Fn(&str, &str) -> Option<String>;

/// Defines the struct, its columns, and its conversion from a row and from a sheet.
macro_rules! brief {
    (boxed { $($boxed:ident,)+ } own { $($own:ident: $kind:ty,)+ } hash { $($hash:ident,)+ } one { $($one:ident,)+ } shared { $($shared:ident,)+ }) => {
        /// Some columns of a [`Row`].
        #[derive(Debug, Clone, PartialEq)]
        pub struct Brief {
            $(pub(crate) $boxed: Box<str>,)+
            $(pub(crate) $own: $kind,)+
            $(pub(crate) $hash: Option<u64>,)+
            $(pub(crate) $one: Arc<str>,)+
            $(pub(crate) $shared: Shared,)+
        }

        const COLUMNS: &[&str] = &[$(stringify!($boxed),)+ $(stringify!($own),)+ $(stringify!($hash),)+ $(stringify!($one),)+ $(stringify!($shared),)+];

        impl From<&Row> for Brief {
            fn from(row: &Row) -> Brief {
                Brief {
                    $($boxed: row.$boxed.as_str().into(),)+
                    $($own: row.$own,)+
                    $($hash: row.$hash.as_deref().and_then(short),)+
                    $($one: row.$one.as_str().into(),)+
                    $($shared: row.$shared.as_deref().map(Into::into),)+
                }
            }
        }

        impl Texts {
            /// # Errors
            /// Names a column that is missing or has the wrong type.
            fn briefs_of(&mut self, mut sheet: Sheet) -> Result<Vec<Brief>, String> {
                let rows = sheet.rows();
                $(let mut $boxed = column::<String>(&mut sheet, stringify!($boxed))?.into_iter();)+
                $(let mut $own = column::<$kind>(&mut sheet, stringify!($own))?.into_iter();)+
                $(let mut $hash = column::<Option<String>>(&mut sheet, stringify!($hash))?.into_iter();)+
                $(let mut $one = column::<String>(&mut sheet, stringify!($one))?.into_iter();)+
                $(let mut $shared = column::<Option<String>>(&mut sheet, stringify!($shared))?.into_iter();)+
                let uneven = || "columns of unequal length".to_owned();
                (0..rows)
                    .map(|_| {
                        Ok(Brief {
                            $($boxed: $boxed.next().ok_or_else(uneven)?.into(),)+
                            $($own: $own.next().ok_or_else(uneven)?,)+
                            $($hash: $hash.next().ok_or_else(uneven)?.as_deref().and_then(short),)+
                            $($one: self.shared($one.next().ok_or_else(uneven)?),)+
                            $($shared: $shared.next().ok_or_else(uneven)?.map(|text| self.shared(text)),)+
                        })
                    })
                    .collect()
            }
        }
    };
}

brief! {
    boxed {
        flight,
        page,
    }
    own {
        run_ns: i64,
        flown_ns: Option<i64>,
        analysis_version: i64,
        rate_hz: Option<f64>,
        baud: Option<i64>,
        lateness_s: Option<f64>,
        lateness_u_s: Option<f64>,
        lateness_model_u_s: Option<f64>,
        parameter_s: Option<f64>,
        advised_s: Option<f64>,
        advised_from_s: Option<f64>,
        advised_from_u_s: Option<f64>,
    }
    hash {
        log_hash,
    }
    one {
        run_id,
        campaign,
        settings_hash,
        build,
    }
    shared {
        group,
        airframe,
        receiver,
        firmware,
        serial,
        system_firmware,
        datum,
        parameter,
        duplicate_of,
    }
}

/// Distinct texts seen so far.
#[derive(Default)]
struct Texts(HashSet<Arc<str>>);

impl Texts {
    fn shared(&mut self, text: String) -> Arc<str> {
        if let Some(known) = self.0.get(text.as_str()) {
            return Arc::clone(known);
        }
        let new: Arc<str> = text.into();
        self.0.insert(Arc::clone(&new));
        new
    }
}

/// Rows read in brief, and files that could not be read.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Briefs {
    /// Rows, by run, then in file order.
    pub rows: Vec<Brief>,
    /// Files that could not be read, each with the reason.
    pub unreadable: Vec<String>,
}

impl History {
    /// Every row of every run of the wanted campaigns.
    ///
    /// # Errors
    /// The folder cannot be listed. A file that cannot be read is listed in the result.
    pub fn briefs(&self, is_wanted: &dyn Fn(&str) -> bool) -> Result<Briefs, HistoryError> {
        let mut all = Briefs::default();
        let mut texts = Texts::default();
        for path in self.files()? {
            match read(&path, &mut texts) {
                Ok(rows) => all.rows.extend(rows.into_iter().filter(|row| is_wanted(&row.campaign))),
                Err(what) => all.unreadable.push(format!("{}: {what}", path.display())),
            }
        }
        all.rows.sort_by_key(|row| row.run_ns);
        Ok(all)
    }
}

fn read(path: &Path, texts: &mut Texts) -> Result<Vec<Brief>, String> {
    let file = File::open(path).map_err(|e| format!("cannot be opened: {e}"))?;
    let table =
        read_parquet_columns(file, &|name| COLUMNS.contains(&name)).map_err(|e| format!("cannot be read: {e}"))?;
    texts.briefs_of(current(table)?)
}

/// The latest row of each flight, by campaign and flight. A renamed log is the same flight, also in a renamed campaign or
/// in two campaigns: of rows with the same content, the one of the latest run counts.
#[must_use]
pub fn latest_briefs(rows: &[Brief]) -> Vec<&Brief> {
    let mut latest: HashMap<(&str, &str), &Brief> = HashMap::with_capacity(rows.len());
    for row in rows {
        let known = latest.entry((&row.campaign, &row.flight)).or_insert(row);
        if known.run_ns <= row.run_ns {
            *known = row;
        }
    }
    // Of copies in one run, the flight that counts comes first.
    let newer = |row: &Brief, known: &Brief| {
        (row.run_ns, row.duplicate_of.is_none(), &known.campaign, &known.flight)
            > (known.run_ns, known.duplicate_of.is_none(), &row.campaign, &row.flight)
    };
    let mut by_content: HashMap<u64, &Brief> = HashMap::new();
    for row in latest.values() {
        let Some(hash) = row.log_hash else { continue };
        let known = by_content.entry(hash).or_insert(row);
        if newer(row, known) {
            *known = row;
        }
    }
    let is_same = |a: &Brief, b: &Brief| (&a.campaign, &a.flight) == (&b.campaign, &b.flight);
    let counts =
        |row: &&Brief| row.log_hash.is_none_or(|hash| by_content.get(&hash).is_none_or(|one| is_same(one, row)));
    let mut latest: Vec<&Brief> = latest.into_values().filter(counts).collect();
    latest.sort_unstable_by(|a, b| (&a.campaign, &a.flight).cmp(&(&b.campaign, &b.flight)));
    latest
}

impl Brief {
    /// The flight's value of a dimension; `None` if unknown.
    #[must_use]
    pub fn of(&self, dimension: Dimension) -> Option<String> {
        let text = |text: &Shared| text.as_deref().map(str::to_owned);
        match dimension {
            Dimension::Airframe => text(&self.airframe),
            Dimension::Serial => text(&self.serial),
            Dimension::Receiver => text(&self.receiver),
            Dimension::Firmware => text(&self.firmware),
            Dimension::Rate => self.rate_hz.map(|hz| format!("{hz} Hz")),
            Dimension::Baud => self.baud.map(|baud| format!("{baud} baud")),
        }
    }

    /// Time of the flight; if its log has no date, time of its first run.
    pub(crate) fn order(&self) -> i64 {
        self.flown_ns.unwrap_or(self.run_ns)
    }

    /// The flight with its page.
    pub(crate) fn named(&self, page: PageOf<'_>) -> NamedFlight {
        let (campaign, flight) = (self.campaign.to_string(), self.flight.to_string());
        NamedFlight { campaign, flight, page: page(&self.campaign, &self.page) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::Run;

    #[test]
    fn a_brief_from_a_file_matches_its_row() {
        let folder = tempfile::tempdir().unwrap();
        let history = History::new(folder.path());
        let rows = [0, 86_400].map(|second| {
            let run = Run::at(jiff::Timestamp::from_second(1_795_644_000 + second).unwrap());
            let row = Row {
                run_id: run.id.clone(),
                run_ns: run.start_ns,
                campaign: "c".into(),
                flight: "a".into(),
                page: "flights/a/index.html".into(),
                serial: Some("D9".into()),
                log_hash: Some("0123456789abcdef0000".into()),
                rate_hz: Some(5.0),
                lateness_s: Some(0.118),
                ..Row::default()
            };
            history.append(&run, std::slice::from_ref(&row)).unwrap();
            row
        });
        let read = history.briefs(&|campaign| campaign == "c").unwrap();
        assert_eq!(read, Briefs { rows: rows.iter().map(Brief::from).collect(), unreadable: vec![] });
        assert!(Arc::ptr_eq(read.rows[0].serial.as_ref().unwrap(), read.rows[1].serial.as_ref().unwrap()));
        assert_eq!(latest_briefs(&read.rows), [&read.rows[1]]);
        assert_eq!(read.rows[0].log_hash, Some(0x0123_4567_89ab_cdef));
        assert_eq!(read.rows[0].of(Dimension::Rate).as_deref(), Some("5 Hz"));
        assert_eq!(history.briefs(&|_| false).unwrap(), Briefs::default());
    }

    #[test]
    fn a_renamed_log_is_the_same_flight() {
        let row = |flight: &str, run_ns: i64, content: Option<&str>, duplicate_of: Option<&str>| {
            let text = |text: &str| text.to_owned();
            let (log_hash, duplicate_of) = (content.map(text), duplicate_of.map(text));
            Brief::from(&Row {
                campaign: "c".into(),
                flight: flight.into(),
                run_ns,
                log_hash,
                duplicate_of,
                ..Row::default()
            })
        };
        let same = Some("00000000000000010000");
        let rows = [
            row("old", 1, same, None),
            row("new", 2, same, None),
            row("new-copy", 2, same, Some("new")),
            row("other", 1, Some("00000000000000020000"), None),
            row("unread", 1, None, None),
            row("odd", 1, Some("?"), None),
            row("odd-too", 1, Some("?"), None),
            row("unread-too", 1, None, None),
        ];
        let names = |rows: &[Brief]| -> Vec<String> {
            latest_briefs(rows).iter().map(|row| format!("{}/{}", row.campaign, row.flight)).collect()
        };
        assert_eq!(names(&rows), ["c/new", "c/odd", "c/odd-too", "c/other", "c/unread", "c/unread-too"]);
        // The campaign was renamed, or another one has the same logs.
        let in_other = |row: &Brief, run_ns: i64| Brief { campaign: "d".into(), run_ns, ..row.clone() };
        let later = [&rows[..], &[in_other(&rows[3], 3)]].concat();
        assert_eq!(names(&later), ["c/new", "c/odd", "c/odd-too", "c/unread", "c/unread-too", "d/other"]);
        let same_run = [&rows[..], &[in_other(&rows[3], 1)]].concat();
        assert_eq!(names(&same_run), names(&rows));
    }
}
