//! Where VTG, which says no time, stands among the sentences of its epoch: behind one of them, as receivers have it by
//! themselves, or in front, as receivers may be told. In front it would have the time of the epoch before. Speed and track
//! are told by RMC too, which has a time: most of the time they change from one to the next, and then VTG agrees with one
//! of its neighbours alone. In front of a gap, be it a cut or the end of a file, a VTG keeps no time: it may be of the epoch
//! that was lost.

use super::kind::Kind;
use super::sentence::{Sentence, plain};
use crate::reader::Log;
use crate::table::{Column, ColumnData, Table};
use flight::{Code, Notices, Severity};
use std::collections::{HashMap, HashSet, VecDeque};

/// A slower one says nothing, kt: its track is noise, or absent.
const SLOWEST_KT: f64 = 0.3;
/// Speeds, kt, and tracks, deg, that differ by less are the same, rounded to a tenth.
const SAME: f64 = 0.06;
/// So many that agree with one neighbour alone decide.
const DECIDED_BY: u64 = 5;
/// The others among them are fewer than one in so many.
const RARE: u64 = 10;
/// So many steps before one and behind it show how far apart epochs were at the time.
const NEIGHBOURS: usize = 5;
/// Steps that are remembered: a day and more at ten a second.
const MOST_STEPS: usize = 1 << 20;

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
    open: Option<Open>,
    steps: Vec<(Open, i64)>,
    /// VTG whose steps are too many to be remembered.
    beyond: u64,
    /// The last stamp of an epoch and how far apart they were.
    last_ns: Option<i64>,
    recent: VecDeque<i64>,
    /// What sentences without a time have behind damage, where no sentence with a time has come yet; and those of them whose
    /// epoch nobody knows.
    doubt: Option<Stamps>,
    lost: Vec<Stamps>,
}

/// What stamps VTG have behind the same sentence, and how many.
#[derive(Debug, Clone, Copy)]
struct Open {
    stamps: Stamps,
    count: u64,
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
        let count = self.open.map_or(1, |open| open.count + 1);
        self.open = (!self.is_behind()).then_some(Open { stamps, count });
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
            if !is_next && self.lost.len() < MOST_STEPS {
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
        self.last_ns = Some(elapsed_ns);
        if let Some(open) = self.open.take().filter(|open| open.stamps.elapsed_ns != elapsed_ns) {
            match self.steps.len() < MOST_STEPS {
                true => self.steps.push((open, elapsed_ns.saturating_sub(open.stamps.elapsed_ns))),
                false => self.beyond += open.count,
            }
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
            (self.steps, self.beyond) = (vec![], 0);
        }
    }

    /// Whether it is certain that VTG stands behind its epoch.
    fn is_behind(&self) -> bool {
        self.before >= DECIDED_BY && self.before > RARE * self.behind
    }

    /// What is to be done with the stamps of sentences without a time.
    pub(super) fn finish(mut self, notices: &mut Notices) -> Steps {
        let lost = std::mem::take(&mut self.lost);
        let doubt = self.doubt.take();
        let mut steps = self.steps(notices);
        steps.lost_utc = lost.iter().chain(&doubt).map(|stamps| stamps.utc_ns).collect();
        steps.lost_elapsed = lost.iter().chain(&doubt).map(|stamps| stamps.elapsed_ns).collect();
        let text = "sentences that say no time stand behind damage in which an epoch may be lost: when they were nobody can tell, \
                    and they are not used";
        let count = steps.lost_elapsed.len() as u64;
        if count > 0 {
            notices.push(Code::Undated.at(Severity::Warning), "", count, text);
        }
        steps
    }

    /// What is to be done with the stamps of VTG: nothing, unless it stands in front of its epoch.
    fn steps(self, notices: &mut Notices) -> Steps {
        // In the middle of its epoch it has the right time either way.
        if self.behind < DECIDED_BY || self.behind <= RARE * self.before || self.steps.is_empty() {
            return Steps::default();
        }
        let mut steps = Steps { is_whole: self.beyond == 0, ..Steps::default() };
        let (mut moved, mut lost) = (0, self.beyond);
        for (at, (open, step_ns)) in self.steps.iter().enumerate() {
            let near = Some(*step_ns).filter(|step_ns| (1..=longest(&self.steps, at)).contains(step_ns));
            *if near.is_some() { &mut moved } else { &mut lost } += open.count;
            steps.add(open.stamps, near);
        }
        // The log ends behind it.
        if let Some(open) = self.open {
            lost += open.count;
            steps.add(open.stamps, None);
        }
        let text = "VTG, which says no time, stands in front of the other sentences of its epoch, for it agrees with the RMC \
                    behind it and not with that before: it has the time of the sentence behind it";
        notices.push(Code::ReadLeniently.at(Severity::Info), "VTG", moved, text);
        if lost > 0 {
            let text = "VTG stand in front of their epochs, and the next sentence with a time comes later than epochs did at the \
                        time, or there is none: when they were nobody can tell, and they are not used";
            notices.push(Code::Undated.at(Severity::Warning), "VTG", lost, text);
        }
        steps
    }
}

/// The longest step that leads from an epoch to the next and not over a gap, ns: one and a half times the median of those
/// around it, for a receiver may be told another rate.
fn longest(steps: &[(Open, i64)], at: usize) -> i64 {
    let around = steps.iter().take(at + NEIGHBOURS + 1).skip(at.saturating_sub(NEIGHBOURS));
    let mut steps_ns: Vec<i64> = around.map(|(_, step_ns)| *step_ns).collect();
    steps_ns.sort_unstable();
    steps_ns.get(steps_ns.len() / 2).map_or(0, |median_ns| median_ns.saturating_add(*median_ns / 2))
}

/// Speed and track of a sentence that says both and is not slow.
fn motion(sentence: &Sentence<'_>, speed: usize, track: usize) -> Option<Motion> {
    let [speed, track] = [speed, track].map(|field| plain(sentence.field(field))?.parse::<f64>().ok());
    Some([speed.filter(|speed| *speed >= SLOWEST_KT)?, track?])
}

fn is_same(vtg: Motion, rmc: Option<Motion>) -> bool {
    rmc.is_some_and(|rmc| vtg.iter().zip(rmc).all(|(a, b)| (a - b).abs() <= SAME))
}

/// How much later than its cell says a VTG was, ns, by that cell; `None` if nobody can tell.
#[derive(Debug)]
pub(super) struct Steps {
    of_utc: HashMap<i64, Option<i64>>,
    of_elapsed: HashMap<i64, Option<i64>>,
    /// Whether what has no step here needs none.
    is_whole: bool,
    /// Cells of sentences without a time that nobody can tell.
    lost_utc: HashSet<i64>,
    lost_elapsed: HashSet<i64>,
}

impl Default for Steps {
    /// Nothing is to be done.
    fn default() -> Steps {
        let (lost_utc, lost_elapsed) = (HashSet::new(), HashSet::new());
        Steps { of_utc: HashMap::new(), of_elapsed: HashMap::new(), is_whole: true, lost_utc, lost_elapsed }
    }
}

impl Steps {
    /// Of two that have the same cell and do not agree nobody can tell either.
    fn add(&mut self, stamps: Stamps, step_ns: Option<i64>) {
        for (steps, cell) in [(&mut self.of_utc, stamps.utc_ns), (&mut self.of_elapsed, stamps.elapsed_ns)] {
            let known = steps.entry(cell).or_insert(step_ns);
            *known = known.filter(|known_ns| Some(*known_ns) == step_ns);
        }
    }

    /// Puts the stamps of VTG right, and takes those away that nobody can.
    pub(super) fn put(&self, log: &mut Log) {
        self.take_away(log);
        if self.of_elapsed.is_empty() {
            return;
        }
        let is_vtg = |table: &&mut Table| table.topic.encoding == "nmea" && table.topic.type_name == "VTG";
        for column in log.tables.iter_mut().filter(is_vtg).flat_map(|table| &mut table.columns) {
            match &*column.path {
                "utc_ns" => self.put_into(column, &self.of_utc),
                "elapsed_ns" => self.put_into(column, &self.of_elapsed),
                _ => {}
            }
        }
    }

    fn take_away(&self, log: &mut Log) {
        if self.lost_elapsed.is_empty() {
            return;
        }
        let is_timeless = |table: &&mut Table| {
            let kind = Kind::of(&table.topic.type_name);
            table.topic.encoding == "nmea" && kind.is_some_and(|kind| kind.time.is_none())
        };
        for column in log.tables.iter_mut().filter(is_timeless).flat_map(|table| &mut table.columns) {
            let lost = match &*column.path {
                "utc_ns" => &self.lost_utc,
                "elapsed_ns" => &self.lost_elapsed,
                _ => continue,
            };
            let ColumnData::I64(cells) = &mut column.data else { continue };
            let valid = column.valid.get_or_insert_with(|| vec![true; cells.len()]);
            for (cell, valid) in cells.iter_mut().zip(valid).filter(|(cell, _)| lost.contains(cell)) {
                (*cell, *valid) = (0, false);
            }
        }
    }

    fn put_into(&self, column: &mut Column, steps: &HashMap<i64, Option<i64>>) {
        let ColumnData::I64(cells) = &mut column.data else { return };
        let valid = column.valid.get_or_insert_with(|| vec![true; cells.len()]);
        for (cell, valid) in cells.iter_mut().zip(valid) {
            let unmoved = self.is_whole.then_some(0);
            match steps.get(cell).copied().unwrap_or(unmoved) {
                Some(step_ns) => *cell = cell.saturating_add(step_ns),
                None => (*cell, *valid) = (0, false),
            }
        }
    }
}
