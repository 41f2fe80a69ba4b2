//! Position of VTG, which has no time, among the sentences of its epoch: by default after another one, but
//! receivers can be configured to send it first. It would then get the time of the previous epoch. RMC also has speed
//! and track, with a time. They usually change from one RMC to the next, and VTG then agrees with only one
//! of its neighbours. VTG that comes before its epoch is not used:
//! the RMC that shows it has the same speed and track.

use super::sentence::{Sentence, plain};
use crate::reader::Log;
use crate::table::Table;
use flight::{Code, Notices, Severity};

/// A lower speed shows nothing, kt: its track is noise, or absent.
const SLOWEST_KT: f64 = 0.3;
/// Speeds, kt, and tracks, deg, that differ by less are equal, rounded to a tenth.
const SAME: f64 = 0.06;
/// This many that agree with only one neighbour decide.
const DECIDED_BY: u64 = 5;
/// Fewer than one in this many of them may disagree.
const RARE: u64 = 10;
/// Speed, kt, and track, deg.
type Motion = [f64; 2];

/// Evidence from the sentences so far.
#[derive(Debug, Default)]
pub(super) struct Order {
    by_rmc: Option<Motion>,
    /// The last VTG since then, and speed and track of the RMC before it.
    by_vtg: Option<(Motion, Option<Motion>)>,
    /// Number of VTG that agree with only the RMC before or only the RMC after them.
    before: u64,
    behind: u64,
    /// Number of VTG in all, and of those after which the time changes.
    count: u64,
    ahead: u64,
    /// VTG that have not been followed by a sentence with a time yet.
    open: u64,
    /// The last timestamp of an epoch.
    last_ns: Option<i64>,
}

impl Order {
    /// Takes a VTG that gets the time of the sentence before it.
    pub(super) fn vtg(&mut self, sentence: &Sentence<'_>) {
        if let Some(motion) = motion(sentence, 5, 1) {
            self.by_vtg = Some((motion, self.by_rmc));
        }
        self.count += 1;
        self.open += 1;
    }

    /// Takes a sentence with a time.
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

    /// Whether VTG is the first of its epoch. In the middle of it, where the next time is the same, its time is right.
    fn leads(&self) -> bool {
        self.behind >= DECIDED_BY && self.behind > RARE * self.before && 2 * self.ahead > self.count
    }

    /// Whether the timestamps of VTG are to be removed.
    pub(super) fn finish(self, notices: &mut Notices) -> bool {
        let leads = self.leads();
        if leads {
            let text = "VTG has no time and comes before the other sentences of its epoch: it agrees with the next \
                RMC and not with the one before. It is not used; RMC has the same speed and track";
            notices.push(Code::Undated.at(Severity::Warning), "VTG", self.count, text);
        }
        leads
    }
}

/// Speed and track of a sentence that has both and is not slow.
fn motion(sentence: &Sentence<'_>, speed: usize, track: usize) -> Option<Motion> {
    let [speed, track] = [speed, track].map(|field| plain(sentence.field(field))?.parse::<f64>().ok());
    Some([speed.filter(|speed| *speed >= SLOWEST_KT)?, track?])
}

fn is_same(vtg: Motion, rmc: Option<Motion>) -> bool {
    rmc.is_some_and(|rmc| vtg.iter().zip(rmc).all(|(a, b)| (a - b).abs() <= SAME))
}

/// Removes the timestamps of all VTG.
pub(super) fn leave_undated(log: &mut Log) {
    let is_vtg = |table: &&mut Table| table.topic.encoding == "nmea" && table.topic.type_name == "VTG";
    for table in log.tables.iter_mut().filter(is_vtg) {
        table.columns.retain(|column| !["utc_ns", "elapsed_ns"].contains(&&*column.path));
    }
}
