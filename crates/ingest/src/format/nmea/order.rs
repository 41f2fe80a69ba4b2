//! Where VTG, which says no time, stands among the sentences of its epoch: behind one of them, as receivers have it by
//! themselves, or in front, as receivers may be told. In front it would have the time of the epoch before. Speed and track
//! are told by RMC too, which has a time: most of the time they change from one to the next, and then VTG agrees with one
//! of its neighbours alone. VTG that comes before its epoch is not used:
//! the RMC that shows it has the same speed and track.

use super::sentence::{Sentence, plain};
use crate::reader::Log;
use crate::table::Table;
use flight::{Code, Notices, Severity};

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
    /// VTG in all, and those behind which the next time is another.
    count: u64,
    ahead: u64,
    /// VTG behind which no sentence with a time has come yet.
    open: u64,
    /// The last stamp of an epoch.
    last_ns: Option<i64>,
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

    /// A sentence with a time.
    pub(super) fn timed(&mut self, name: &str, sentence: &Sentence<'_>, elapsed_ns: i64) {
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

    /// Whether the stamps of VTG are to be taken away.
    pub(super) fn finish(self, notices: &mut Notices) -> bool {
        let leads = self.leads();
        if leads {
            let text = "VTG has no time and comes before the other sentences of its epoch: it agrees with the next RMC and not with \
                        the previous one. It is not used; RMC has the same speed and track";
            notices.push(Code::Undated.at(Severity::Warning), "VTG", self.count, text);
        }
        leads
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

/// Takes away the stamps of all VTG.
pub(super) fn leave_undated(log: &mut Log) {
    let is_vtg = |table: &&mut Table| table.topic.encoding == "nmea" && table.topic.type_name == "VTG";
    for table in log.tables.iter_mut().filter(is_vtg) {
        table.columns.retain(|column| !["utc_ns", "elapsed_ns"].contains(&&*column.path));
    }
}
