//! Where VTG, which says no time, stands among the sentences of its epoch: behind one of them, as receivers have it by
//! themselves, or in front, as receivers may be told. In front it would have the time of the epoch before. Speed and track are told by RMC too, which has a time: most of the
//! time they change from one to the next, and then VTG agrees with one of its neighbours alone.

use super::sentence::{Sentence, plain};
use crate::reader::Log;
use crate::table::{Column, ColumnData, Table};
use flight::{Notices, Severity};
use std::collections::HashMap;

/// A slower one says nothing, kt: its track is noise, or absent.
const SLOWEST_KT: f64 = 0.3;
/// Speeds, kt, and tracks, deg, that differ by less are the same, rounded to a tenth.
const SAME: f64 = 0.06;
/// So many that agree with one neighbour alone decide.
const DECIDED_BY: u64 = 5;
/// The others among them are fewer than one in so many.
const RARE: u64 = 10;

/// Speed, kt, and track, deg.
type Motion = [f64; 2];

/// What the sentences so far show.
#[derive(Debug, Default)]
pub(super) struct Order {
    by_rmc: Option<Motion>,
    /// The last VTG since then, and what RMC said before it.
    by_vtg: Option<(Motion, Option<Motion>)>,
    /// VTG that agree with the RMC before or behind them alone.
    before: u64,
    behind: u64,
    /// What stamps a VTG has behind which no sentence with a time has come yet.
    open: Option<Stamps>,
    steps: Vec<(Stamps, i64)>,
}

/// The cells of a sentence: UTC, and the time since the first, ns.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stamps {
    pub(super) utc_ns: i64,
    pub(super) elapsed_ns: i64,
}

impl Order {
    /// A VTG that has these stamps from the sentence before it.
    pub(super) fn vtg(&mut self, sentence: &Sentence<'_>, stamps: Stamps) {
        if let Some(motion) = motion(sentence, 5, 1) {
            self.by_vtg = Some((motion, self.by_rmc));
        }
        self.open = (!self.is_behind()).then_some(stamps);
    }

    /// A sentence with a time.
    pub(super) fn timed(&mut self, name: &str, sentence: &Sentence<'_>, elapsed_ns: i64) {
        if let Some(open) = self.open.take().filter(|open| open.elapsed_ns != elapsed_ns) {
            self.steps.push((open, elapsed_ns.saturating_sub(open.elapsed_ns)));
        }
        if name != "RMC" {
            return;
        }
        let rmc = motion(sentence, 7, 8);
        if let Some((vtg, before)) = self.by_vtg.take() {
            match (is_same(vtg, before), is_same(vtg, rmc)) {
                (true, false) => self.before += 1,
                (false, true) => self.behind += 1,
                _ => {}
            }
        }
        self.by_rmc = rmc;
        if self.is_behind() {
            self.steps = vec![];
        }
    }

    /// Whether it is certain that VTG stands behind its epoch.
    fn is_behind(&self) -> bool {
        self.before >= DECIDED_BY && self.before > RARE * self.behind
    }

    /// What is to be done with the stamps of VTG: nothing, unless it stands in front of its epoch.
    pub(super) fn finish(self, notices: &mut Notices) -> Steps {
        // In the middle of its epoch it has the right time either way.
        if self.behind < DECIDED_BY || self.behind <= RARE * self.before || self.steps.is_empty() {
            return Steps::default();
        }
        let text = "VTG, which says no time, stands in front of the other sentences of its epoch, for it agrees with the RMC \
                    behind it and not with that before: it has the time of the sentence behind it";
        notices.push(Severity::Info, "epoch-order", "VTG", self.steps.len() as u64, text);
        let by = |of: fn(&Stamps) -> i64| self.steps.iter().map(|(stamps, step)| (of(stamps), *step)).collect();
        Steps { of_utc: by(|stamps| stamps.utc_ns), of_elapsed: by(|stamps| stamps.elapsed_ns) }
    }
}

/// Speed and track of a sentence that says both and is not slow.
fn motion(sentence: &Sentence<'_>, speed: usize, track: usize) -> Option<Motion> {
    let [speed, track] = [speed, track].map(|field| plain(sentence.field(field))?.parse::<f64>().ok());
    Some([speed.filter(|speed| *speed >= SLOWEST_KT)?, track?])
}

fn is_same(vtg: Motion, rmc: Option<Motion>) -> bool {
    rmc.is_some_and(|rmc| vtg.iter().zip(rmc).all(|(a, b)| (a - b).abs() <= SAME))
}

/// How much later than its cell says a VTG was, ns, by that cell.
#[derive(Debug, Default)]
pub(super) struct Steps {
    of_utc: HashMap<i64, i64>,
    of_elapsed: HashMap<i64, i64>,
}

impl Steps {
    /// Puts the stamps of VTG right.
    pub(super) fn put(&self, log: &mut Log) {
        let is_vtg = |table: &&mut Table| table.topic.encoding == "nmea" && table.topic.type_name == "VTG";
        for column in log.tables.iter_mut().filter(is_vtg).flat_map(|table| &mut table.columns) {
            match &*column.path {
                "utc_ns" => add(column, &self.of_utc),
                "elapsed_ns" => add(column, &self.of_elapsed),
                _ => {}
            }
        }
    }
}

fn add(column: &mut Column, steps: &HashMap<i64, i64>) {
    let ColumnData::I64(cells) = &mut column.data else { return };
    for cell in cells {
        *cell = cell.saturating_add(steps.get(cell).copied().unwrap_or(0));
    }
}
