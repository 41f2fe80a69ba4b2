//! Where VTG, which says no time, stands among the sentences of its epoch: behind one of them, as receivers have it by
//! themselves, or in front, as receivers may be told. In front it would have the time of the epoch before. Speed and track
//! are told by RMC too, which has a time: most of the time they change from one to the next, and then VTG agrees with one
//! of its neighbours alone. VTG that comes before its epoch is not used:
//! the RMC that shows it has the same speed and track.

use super::kind::Kind;
use super::sentence::{Sentence, plain};
use crate::reader::Log;
use crate::table::{ColumnData, Table};
use flight::{Code, Notices, Severity};
use std::collections::{HashSet, VecDeque};

/// A slower one says nothing, kt: its track is noise, or absent.
const SLOWEST_KT: f64 = 0.3;
/// Speeds, kt, and tracks, deg, that differ by less are the same, rounded to a tenth.
const SAME: f64 = 0.06;
/// So many that agree with one neighbour alone decide.
const DECIDED_BY: u64 = 5;
/// The others among them are fewer than one in so many.
const RARE: u64 = 10;
/// So many steps before damage show how far apart epochs were at the time.
const NEIGHBOURS: usize = 5;
/// Sentences whose epoch nobody knows that are remembered.
const MOST_LOST: usize = 1 << 20;

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
    /// VTG in all, and those behind which the next time is another.
    count: u64,
    ahead: u64,
    /// VTG behind which no sentence with a time has come yet.
    open: u64,
    /// The last stamp of an epoch and how far apart they were.
    last_ns: Option<i64>,
    recent: VecDeque<i64>,
    /// What sentences without a time have behind damage, where no sentence with a time has come yet; and those of them whose
    /// epoch nobody knows.
    doubt: Option<Stamps>,
    lost: Vec<Stamps>,
}

/// The cells of a sentence: UTC, and the time since the first, ns.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stamps {
    pub(super) utc_ns: i64,
    pub(super) elapsed_ns: i64,
}

impl Order {
    /// A VTG that has the time of the sentence before it.
    pub(super) fn vtg(&mut self, sentence: &Sentence<'_>) {
        if let Some(motion) = motion(sentence, 5, 1) {
            self.by_vtg = Some((motion, self.by_rmc));
        }
        self.count += 1;
        self.open += 1;
    }

    /// A sentence without a time behind damage, which has these stamps from the sentence before it.
    pub(super) fn doubtful(&mut self, stamps: Stamps) {
        self.doubt = Some(stamps);
    }

    /// Whether damage hides an epoch is shown by the next one: it comes later than epochs did.
    fn next_epoch(&mut self, elapsed_ns: i64) {
        let step_ns = elapsed_ns.saturating_sub(self.last_ns.unwrap_or(elapsed_ns));
        if step_ns == 0 {
            return;
        }
        if let Some(stamps) = self.doubt.take() {
            let mut usual: Vec<i64> = self.recent.iter().copied().collect();
            usual.sort_unstable();
            let usual_ns = usual.get(usual.len() / 2).copied().unwrap_or_default();
            let is_next = (1..=usual_ns.saturating_add(usual_ns / 2)).contains(&(elapsed_ns - stamps.elapsed_ns));
            if !is_next && self.lost.len() < MOST_LOST {
                self.lost.push(stamps);
            }
        }
        self.recent.push_back(step_ns);
        if self.recent.len() > NEIGHBOURS {
            self.recent.pop_front();
        }
    }

    /// A sentence with a time.
    pub(super) fn timed(&mut self, name: &str, sentence: &Sentence<'_>, elapsed_ns: i64) {
        self.next_epoch(elapsed_ns);
        let open = std::mem::take(&mut self.open);
        if self.last_ns.replace(elapsed_ns) != Some(elapsed_ns) {
            self.ahead += open;
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
    }

    /// Whether VTG stands in front of its epoch. In the midst of it, where the next time is the same, it has the right one.
    fn leads(&self) -> bool {
        self.behind >= DECIDED_BY && self.behind > RARE * self.before && 2 * self.ahead > self.count
    }

    /// Which stamps of sentences without a time are to be taken away.
    pub(super) fn finish(self, notices: &mut Notices) -> Doubtful {
        let all = || self.lost.iter().chain(&self.doubt);
        let doubtful = Doubtful {
            vtg: self.leads(),
            utc: all().map(|stamps| stamps.utc_ns).collect(),
            elapsed: all().map(|stamps| stamps.elapsed_ns).collect(),
        };
        let text = "sentences that say no time stand behind damage in which an epoch may be lost: when they were nobody can tell, \
                    and they are not used";
        let mut say = |place: &str, count: u64, text: &str| {
            if count > 0 {
                notices.push(Code::Undated.at(Severity::Warning), place, count, text);
            }
        };
        say("", doubtful.elapsed.len() as u64, text);
        let text = "VTG has no time and comes before the other sentences of its epoch: it agrees with the next RMC and not with \
                    the previous one. It is not used; RMC has the same speed and track";
        say("VTG", if doubtful.vtg { self.count } else { 0 }, text);
        doubtful
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

/// Stamps that sentences without a time have, and should not.
#[derive(Debug)]
pub(super) struct Doubtful {
    /// All of VTG.
    vtg: bool,
    /// Of the others these cells.
    utc: HashSet<i64>,
    elapsed: HashSet<i64>,
}

impl Doubtful {
    pub(super) fn put(&self, log: &mut Log) {
        let timeless = |table: &&mut Table| {
            let kind = Kind::of(&table.topic.type_name);
            table.topic.encoding == "nmea" && kind.is_some_and(|kind| kind.time.is_none())
        };
        for table in log.tables.iter_mut().filter(timeless) {
            if self.vtg && table.topic.type_name == "VTG" {
                table.columns.retain(|column| !["utc_ns", "elapsed_ns"].contains(&&*column.path));
            }
            for column in &mut table.columns {
                let lost = match &*column.path {
                    "utc_ns" => &self.utc,
                    "elapsed_ns" => &self.elapsed,
                    _ => continue,
                };
                let ColumnData::I64(cells) = &mut column.data else { continue };
                if lost.is_empty() {
                    continue;
                }
                let valid = column.valid.get_or_insert_with(|| vec![true; cells.len()]);
                for (cell, valid) in cells.iter_mut().zip(valid).filter(|(cell, _)| lost.contains(cell)) {
                    (*cell, *valid) = (0, false);
                }
            }
        }
    }
}
