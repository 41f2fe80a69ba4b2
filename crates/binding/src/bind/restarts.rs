//! Handles a vehicle that restarts within a log: its clock since boot starts over, and equal timestamps of two sessions
//! are different times.
//!
//! Each session is dated separately, and its timestamps are moved onto the clock of the first: the sessions are then as
//! far apart as their dates, and nothing changes within a session. A session that cannot be dated is lost.

use super::plan::Plan;
use super::stamp_columns::{NO_UTC_BEFORE_NS, Stamps, Tied, pairs_of};
use crate::map::{TieRule, TimeSource};
use flight::{Clock, Code, NANOS_PER_SECOND, Notices, Severity, UtcTie};
use formats::time::tie;
use formats::{Log, Restart, Table};
use std::collections::BTreeMap;

/// Dates of two sessions that differ by less than this are the same, ns.
const SAME_NS: u64 = NANOS_PER_SECOND as u64;

/// The dates of a log's sessions from one source; `None` for those that it does not date.
struct Dates {
    sessions: Vec<Option<UtcTie>>,
    from_gps: bool,
    /// Dated by when the log has the messages, not by their content.
    by_log: bool,
}

impl Dates {
    fn offset(&self, session: usize) -> Option<i64> {
        self.sessions.get(session)?.as_ref().map(|tie| tie.offset_ns)
    }

    fn all(&self) -> bool {
        self.sessions.iter().all(Option::is_some)
    }

    /// Whether a session is dated before the end of an earlier one in the log: the dates are then invalid.
    fn overlap(&self, ends: &[Option<[i64; 2]>]) -> bool {
        let dated = (0..).zip(ends).filter_map(|(session, ends)| {
            let (offset, ends) = (self.offset(session)?, (*ends)?);
            Some(ends.map(|end| end.saturating_add(offset)))
        });
        let dated: Vec<[i64; 2]> = dated.collect();
        dated.windows(2).any(|pair| matches!(pair, [[_, end], [begin, _]] if begin < end))
    }
}

/// The sessions of a log on one clock.
pub(super) struct Joined {
    restarts: Vec<Restart>,
    axis: Axis,
    /// Rows of all topics whose timestamps count since boot.
    rows: Vec<u64>,
}

/// Finds the sessions, and what dates them; `None` if the clock did not restart.
pub(super) fn join(plans: &[Plan<'_>], rules: &[TieRule], log: &Log) -> Option<Joined> {
    if log.restarts.is_empty() {
        return None;
    }
    let mut found = log.restarts.clone();
    found.sort_by_key(|restart| restart.logged_ns);
    let all = dates(plans, rules, log, &found);
    let kept = (0..).zip(&found).filter(|(i, r)| r.certain || is_dated_differently(&all, *i));
    let restarts: Vec<Restart> = kept.map(|(_, restart)| *restart).collect();
    if restarts.is_empty() {
        return None;
    }
    let all = if restarts.len() == found.len() { all } else { dates(plans, rules, log, &restarts) };
    let (ends, rows) = (ends(plans, &restarts), rows_of(plans, &restarts));
    let axis = Axis::of(all.into_iter().filter(|dates| !dates.overlap(&ends)).collect(), &rows);
    Some(Joined { restarts, axis, rows })
}

impl Joined {
    /// Moves the timestamps of a table onto the clock of the first session, if they count since boot. A row of an
    /// undated session has no timestamp.
    pub(super) fn shift(&self, table: &Table, clock: Clock, nanos: &mut [Option<i64>]) {
        if clock != Clock::Boot {
            return;
        }
        for (row, stamp) in nanos.iter_mut().enumerate() {
            let Some(session) = session_of(table, &self.restarts, row) else { continue };
            let shift = self.axis.shifts.get(session).copied().flatten();
            *stamp = stamp.zip(shift).and_then(|(ns, by)| ns.checked_add(by));
        }
    }

    /// The tie of the first dated session.
    pub(super) fn into_tie(self) -> Option<Tied> {
        self.axis.tied
    }

    /// Reports how the sessions were dated, and what is lost.
    pub(super) fn report(&self, notices: &mut Notices) {
        let sessions = self.axis.shifts.len() as u64;
        if let Some(source) = &self.axis.source {
            let text =
                "the clock since boot restarted; each session is dated by itself and moved to the clock of the first";
            notices.push(Code::SeveralSessions, source, sessions - 1, text);
        }
        // A session without rows has nothing to lose.
        let lost = || self.axis.shifts.iter().zip(&self.rows).filter(|(shift, rows)| shift.is_none() && **rows > 0);
        if lost().next().is_some() {
            let text = format!(
                "the clock since boot restarted, and {} of {sessions} sessions cannot be dated: their rows are not \
                 used",
                lost().count()
            );
            notices.push(Code::Undated.at(Severity::Loss), "", lost().map(|(_, rows)| rows).sum(), text);
        }
    }
}

/// A clock that did not go back has restarted only where the messages date it differently, and where the log's own
/// clock agrees if it has one. That clock may be set, and messages may arrive late.
fn is_dated_differently(all: &[Dates], restart: usize) -> bool {
    let step = |dates: &Dates| dates.offset(restart + 1)?.checked_sub(dates.offset(restart)?);
    let steps = |by_log: bool| all.iter().filter(move |d| d.by_log == by_log).find_map(step);
    let Some(stated) = steps(false) else { return false };
    stated.unsigned_abs() > SAME_NS && steps(true).is_none_or(|logged| stated.abs_diff(logged) <= SAME_NS)
}

fn session_at(restarts: &[Restart], logged_ns: i64) -> usize {
    restarts.partition_point(|r| r.logged_ns <= logged_ns)
}

/// The session of a row; `None` in a table of another vehicle than the log's.
fn session_of(table: &Table, restarts: &[Restart], row: usize) -> Option<usize> {
    let logged = table.logged_ns.as_ref()?.get(row).filter(|_| is_own(table))?;
    Some(session_at(restarts, *logged))
}

fn is_own(table: &Table) -> bool {
    !table.topic.name.contains('@')
}

/// Dates by each rule, and finally by the log.
fn dates(plans: &[Plan<'_>], rules: &[TieRule], log: &Log, restarts: &[Restart]) -> Vec<Dates> {
    let by_rule = |rule: &TieRule| {
        pairs_of(rule, log).into_iter().find_map(|(table, pairs)| {
            let sessions = pairs.ties(restarts.len() + 1, |row| session_of(table, restarts, row));
            let by_log = matches!(rule.utc, TimeSource::ContainerLogged);
            sessions.iter().any(Option::is_some).then_some(Dates { sessions, from_gps: pairs.from_gps, by_log })
        })
    };
    let mut all: Vec<Dates> = rules.iter().filter_map(by_rule).collect();
    all.extend(by_log(plans, restarts));
    all
}

/// Dates by when the log has the messages of one topic: the one with the most rows in its smallest session.
fn by_log(plans: &[Plan<'_>], restarts: &[Restart]) -> Option<Dates> {
    let count = |plan: &&Plan<'_>| counts(plan.table, restarts).into_iter().min();
    let plan = plans.iter().filter(|plan| boot_stamps(plan).is_some()).rev().max_by_key(count)?;
    let (stamps, logged) = (boot_stamps(plan)?, plan.table.logged_ns.as_ref()?);
    let source = format!("{}: {} and log", plan.table.topic.name, stamps.label);
    let mut pairs = vec![vec![]; restarts.len() + 1];
    for (stamp, logged) in stamps.nanos.iter().zip(logged).filter(|(_, logged)| **logged > NO_UTC_BEFORE_NS) {
        let session = stamp.zip(pairs.get_mut(session_at(restarts, *logged)));
        session.into_iter().for_each(|(stamp, pairs)| pairs.push((stamp, *logged)));
    }
    let sessions = pairs.iter().map(|pairs| tie(Clock::Boot, source.clone(), pairs)).collect();
    Some(Dates { sessions, from_gps: false, by_log: true })
}

fn boot_stamps<'p>(plan: &'p Plan<'_>) -> Option<&'p Stamps> {
    plan.stamps.iter().find(|stamps| stamps.clock == Clock::Boot).filter(|_| is_own(plan.table))
}

/// The range of timestamps that holds nine tenths of the rows of each session, ns, in the topic with the most of them.
fn ends(plans: &[Plan<'_>], restarts: &[Restart]) -> Vec<Option<[i64; 2]>> {
    let mut most: Vec<Vec<i64>> = vec![vec![]; restarts.len() + 1];
    for (plan, stamps) in plans.iter().filter_map(|plan| Some((plan, boot_stamps(plan)?))) {
        let mut own: Vec<Vec<i64>> = vec![vec![]; restarts.len() + 1];
        for (row, stamp) in stamps.nanos.iter().enumerate() {
            let session = session_of(plan.table, restarts, row).and_then(|session| own.get_mut(session));
            session.zip(stamp).into_iter().for_each(|(own, stamp)| own.push(stamp));
        }
        let longer = most.iter_mut().zip(own).filter(|(most, own)| own.len() > most.len());
        longer.for_each(|(most, own)| *most = own);
    }
    let ends = |mut stamps: Vec<i64>| {
        stamps.sort_unstable();
        let margin = stamps.len() / 20;
        Some([*stamps.get(margin)?, *stamps.iter().rev().nth(margin)?])
    };
    most.into_iter().map(ends).collect()
}

/// The number of rows of a table in each session.
fn counts(table: &Table, restarts: &[Restart]) -> Vec<u64> {
    let mut counts = vec![0; restarts.len() + 1];
    for row in 0..table.rows {
        let count = session_of(table, restarts, row).and_then(|session| counts.get_mut(session));
        count.into_iter().for_each(|count| *count += 1);
    }
    counts
}

/// The same for all topics whose timestamps count since boot.
fn rows_of(plans: &[Plan<'_>], restarts: &[Restart]) -> Vec<u64> {
    let of_boot = plans.iter().filter(|plan| boot_stamps(plan).is_some());
    let tables: BTreeMap<&str, &Table> = of_boot.map(|plan| (plan.table.topic.name.as_str(), plan.table)).collect();
    let mut rows = vec![0; restarts.len() + 1];
    for table in tables.into_values() {
        rows.iter_mut().zip(counts(table, restarts)).for_each(|(sum, count)| *sum += count);
    }
    rows
}

/// The clock of the first dated session, and the shifts of the others.
#[derive(Default)]
struct Axis {
    /// What is added to the timestamps of each session, ns; `None` for a lost one.
    shifts: Vec<Option<i64>>,
    /// What dates the sessions.
    source: Option<String>,
    tied: Option<Tied>,
}

impl Axis {
    /// Uses the first of the dates that covers every session, or else the one that covers most rows.
    fn of(mut all: Vec<Dates>, rows: &[u64]) -> Axis {
        let dated = |dates: &Dates| -> u64 {
            dates.sessions.iter().zip(rows).filter(|(tie, _)| tie.is_some()).map(|(_, rows)| rows).sum()
        };
        all.retain(|dates| dates.sessions.iter().any(Option::is_some));
        let Some(chosen) = (0..all.len()).rev().max_by_key(|i| all.get(*i).map(|d| (d.all(), dated(d)))) else {
            return Axis::undated(rows);
        };
        let stated = first_stated(&all);
        let dates = all.swap_remove(chosen);
        let first = dates.sessions.iter().flatten().next();
        let shifts: Vec<Option<i64>> =
            (0..rows.len()).map(|session| dates.offset(session)?.checked_sub(first?.offset_ns)).collect();
        let (tie, from_gps) = match stated.filter(|_| dates.by_log) {
            Some((session, tie, from_gps)) => {
                let shift = shifts.get(session).copied().flatten().unwrap_or(0);
                (Some(UtcTie { offset_ns: tie.offset_ns.saturating_sub(shift), ..tie }), from_gps)
            }
            None => (first.map(|tie| summed(tie, &dates.sessions)), dates.from_gps),
        };
        let source = first.map(|tie| tie.source.clone());
        Axis { shifts, source, tied: tie.map(|tie| Tied { tie, from_gps, repairs: vec![] }) }
    }

    /// Without any date, the longest session is kept.
    fn undated(rows: &[u64]) -> Axis {
        let longest = (0..rows.len()).rev().max_by_key(|session| rows.get(*session));
        let shifts = (0..rows.len()).map(|session| (Some(session) == longest).then_some(0)).collect();
        Axis { shifts, ..Axis::default() }
    }
}

/// The first session that messages date, its tie, and whether that is from GPS time: a better date than when the log
/// has the messages.
fn first_stated(all: &[Dates]) -> Option<(usize, UtcTie, bool)> {
    let stated = all.iter().find(|dates| !dates.by_log)?;
    let (session, tie) = (0..).zip(&stated.sessions).find_map(|(i, tie)| Some((i, tie.clone()?)))?;
    Some((session, tie, stated.from_gps))
}

/// The tie of the first session with the pairs of all, and the widest spread.
fn summed(first: &UtcTie, sessions: &[Option<UtcTie>]) -> UtcTie {
    let ties = || sessions.iter().flatten();
    let width = |tie: &&UtcTie| tie.spread_s.max - tie.spread_s.min;
    let widest = ties().max_by(|a, b| width(a).total_cmp(&width(b)));
    UtcTie {
        spread_s: widest.map_or(first.spread_s, |tie| tie.spread_s),
        pairs: ties().map(|tie| tie.pairs).sum(),
        outliers: ties().map(|tie| tie.outliers).sum(),
        ..first.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_undated_session_is_reported_lost_only_if_it_has_rows() {
        let reported = |rows: [u64; 3]| {
            let axis = Axis { shifts: vec![Some(0), None, None], ..Axis::default() };
            let mut notices = Notices::new();
            Joined { restarts: vec![], axis, rows: rows.to_vec() }.report(&mut notices);
            notices.iter().map(|n| (n.severity, n.count, n.text.clone())).collect::<Vec<_>>()
        };
        assert_eq!(reported([5, 0, 0]), []);
        let lost = reported([5, 7, 0]);
        assert_eq!((lost.len(), lost[0].0, lost[0].1), (1, flight::Severity::Loss, 7));
        assert!(lost[0].2.contains("1 of 3 sessions cannot be dated"), "{}", lost[0].2);
    }
}
