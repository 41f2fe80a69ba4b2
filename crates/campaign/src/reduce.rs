//! Reduces all results to one table, one record, and pages. Safe to repeat at any time: a page or
//! a row with unchanged inputs is kept.

use crate::changes::changes;
use crate::config::Pipeline;
use crate::criteria::{Criteria, row_verdicts};
use crate::decide;
use crate::delay::campaign_delay;
use crate::delay_report::GroupLine;
use crate::error::{CampaignError, Exit};
use crate::event::Event;
use crate::line::DelayLine;
use crate::lock::OutputLock;
use crate::losses;
use crate::manifest::{FLIGHTLAG_VERSION, Manifest, Planned, hash_of_parts};
use crate::process::host_name;
use crate::rate::rate_of;
use crate::reports::{self, Summary};
use crate::results;
use crate::results::{Damaged, ResultFiles};
use crate::rows::{self, RECORD, ROWS};
use crate::run_context::RunContext;
use crate::sketch::sketch;
use crate::slug::slugs;
use crate::state::{PageState, State, WholeState};
use crate::store::{Check, Files, Keep, Store};
use crate::study::failed_record;
use crate::table;
use crate::task::caught;
use crate::test_cards::{TestCards, row_cards};
use crate::work::Workers;
use flight::{Code, Notice, Severity};
use record::{
    CampaignChanges, CampaignCriteria, CampaignDelay, CampaignRecord, CampaignTotals, CompensatorResult,
    CriterionVerdict, DelaySource, EffectVerdict, Estimate, FlightRecord, FlightRow, Gravity, GroupLateness, Outcome,
    RECORD_VERSION, flight_alarms,
};
use report::{FlightPage, REPORT_VERSION, Site, TrackExcerpt};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// What changed since the previous run: apart from `run.json`, the only output that depends on that run.
const CHANGES: &str = "since-last-run.json";

/// How a campaign ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Verdict {
    /// Counts over all flights.
    pub totals: CampaignTotals,
    /// Results of the criteria; `None` without criteria.
    pub criteria: Option<CampaignCriteria>,
    /// Flights without a lasting result, a subset of the pending and failed ones.
    pub troubled: u64,
    /// Lateness of the position, by group of flights.
    pub groups: Vec<GroupLine>,
    /// One line for each flight.
    pub lines: Vec<DelayLine>,
    /// The page to open.
    pub page: PathBuf,
    /// Whether everything was already up to date.
    pub nothing_changed: bool,
}

impl Verdict {
    /// 4 if a flight fails a criterion or was harmed; else 3 if some failed, lost data, have a changing delay or an
    /// unusable reference file, or if no flight has the number of a criterion; else 0.
    #[must_use]
    pub fn exit(&self) -> Exit {
        if self.totals.harmed > 0 || self.criteria.as_ref().is_some_and(|c| c.flights.fail > 0) {
            return Exit::CriterionFailed;
        }
        let CampaignTotals { failed, lossy, varying, .. } = self.totals;
        let lacks_reference = self.lines.iter().any(DelayLine::lacks_reference);
        let unjudged = self.criteria.iter().flat_map(|c| &c.each).any(|c| c.never_evaluated.is_some());
        let whole = failed == 0 && lossy == 0 && varying == 0 && self.troubled == 0 && !lacks_reference && !unjudged;
        if whole { Exit::Well } else { Exit::Incomplete }
    }
}

/// Makes table, record and pages from the existing results. Names flights without one.
///
/// # Errors
/// An output cannot be written, another process uses the folder, or the user stopped.
pub fn reduce(manifest: &Manifest, context: &RunContext<'_>) -> Result<Verdict, CampaignError> {
    let clock = (jiff::Timestamp::now(), Instant::now());
    let store = Store::open_planned(manifest.out(), &manifest.out_id)?;
    let _lock = OutputLock::take(&store, context)?;
    store.clean();
    let mut state = State::recall(&store);
    let of_plan: Vec<&str> = manifest.keys().filter(|key| state.results.contains_key(*key)).collect();
    compare(&mut state, &store, Check::Quick, context)?;
    let damaged = of_plan.iter().filter(|key| !state.results.contains_key(**key)).count();
    if damaged > 0 {
        return Err(plan_again(damaged));
    }
    match reduce_locked(manifest, context, &store, &mut state)? {
        Reduction::Finished(verdict) => {
            write_run(&store, context, clock, None, &verdict)?;
            Ok(*verdict)
        }
        Reduction::Damaged(flights) => Err(plan_again(flights.len())),
    }
}

fn plan_again(count: usize) -> CampaignError {
    CampaignError::Outdated(format!("{count} damaged results were removed"))
}

/// Maximum number of changed files that are named.
const MOST_CHANGED: usize = 3;

/// Compares the outputs of an earlier run with the disk, and reports which files are made again.
pub(crate) fn compare(
    state: &mut State,
    store: &Store,
    check: Check,
    context: &RunContext<'_>,
) -> Result<(), CampaignError> {
    let changed = state.compare(store, check, context)?;
    let more = match changed.len().saturating_sub(MOST_CHANGED) {
        0 => String::new(),
        n => format!(" and {n} more"),
    };
    let names: Vec<&str> = changed.iter().take(MOST_CHANGED).map(String::as_str).collect();
    if !names.is_empty() {
        let text = format!("files that were missing or changed were written again: {}{more}", names.join(", "));
        context.send(Event::Remark { text });
    }
    Ok(())
}

/// Outcome of a reduction.
pub(crate) enum Reduction {
    Finished(Box<Verdict>),
    /// Results of these flights were damaged, and are removed.
    Damaged(Vec<String>),
}

/// Reduces while the caller holds the lock.
pub(crate) fn reduce_locked(
    manifest: &Manifest,
    context: &RunContext<'_>,
    store: &Store,
    state: &mut State,
) -> Result<Reduction, CampaignError> {
    let lines = lines(manifest, store, state)?;
    let made_from = whole_hash(manifest, &lines);
    let before = previous_record(store);
    let old = before.as_ref().filter(|before| before.blake3 == state.record_blake3);
    let up_to_date = state.whole.as_ref().is_some_and(|whole| whole.made_from == made_from);
    if let Some(old) = old.filter(|_| up_to_date) {
        if state.refreshed {
            state.save(store)?;
        }
        return nothing_changed(&lines, &old.record, store, context);
    }
    let criteria = manifest.criteria.as_ref().map(Criteria::of_use).transpose()?;
    let is_usable = old.is_some();
    let mut before = before.map(|before| before.record);
    let usable = before.as_mut().filter(|_| is_usable).map(|record| std::mem::take(&mut record.flights));
    let rows = usable.into_iter().flatten().map(|row| (row.flight.clone(), Box::new(row))).collect();
    let pipeline = Pipeline::of_manifest(&manifest.pipeline.toml, &manifest.cards)?;
    let test_cards = TestCards::of_files(&manifest.test_cards)?;
    let rows = Mutex::new(rows);
    let reducer = Reducer { manifest, pipeline, criteria, test_cards, context, store, before, rows };
    reducer.reduce(&lines, made_from, state)
}

/// The verdict if everything is already up to date.
fn nothing_changed(
    lines: &[Line<'_>],
    record: &CampaignRecord,
    store: &Store,
    context: &RunContext<'_>,
) -> Result<Reduction, CampaignError> {
    context.send(Event::NothingChanged);
    let verdict = verdict(store, record, troubled(lines), true);
    if reports::is_unlisted(store) {
        reports::list(store, &summary_of(&verdict), context)?;
    }
    report_end(context, store, record, &verdict);
    Ok(Reduction::Finished(Box::new(verdict)))
}

/// Flights without a lasting result.
fn troubled(lines: &[Line<'_>]) -> u64 {
    lines.iter().filter(|line| matches!(line.source, Source::Without(_))).count() as u64
}

/// A flight and the source of its result.
struct Line<'a> {
    planned: &'a Planned,
    slug: String,
    /// The flights before and after it, with their folders.
    neighbours: [Option<(&'a str, String)>; 2],
    source: Source,
    /// Hash of all inputs of its page.
    made_from: String,
}

/// Source of the result of a flight.
enum Source {
    /// A result with this key.
    Result(String),
    /// No result; the record gives the reason.
    Without(Box<FlightRecord>),
}

fn lines<'a>(manifest: &'a Manifest, store: &Store, state: &State) -> Result<Vec<Line<'a>>, CampaignError> {
    let slugs = slugs(manifest.flights.iter().map(|f| f.flight.as_str()));
    let flights = &manifest.flights;
    let slug_of = |planned: &Planned| slugs.get(&planned.flight).cloned().unwrap_or_default();
    let line = |(n, planned): (usize, &'a Planned)| {
        let source = source_of(planned, manifest, store, state)?;
        let slug = slug_of(planned);
        let neighbour = |n: Option<usize>| n.and_then(|n| flights.get(n)).map(|p| (p.flight.as_str(), slug_of(p)));
        let neighbours = [neighbour(n.checked_sub(1)), neighbour(n.checked_add(1))];
        let made_from = page_hash(manifest, planned, &slug, &neighbours, &source);
        Ok(Line { planned, slug, neighbours, source, made_from })
    };
    flights.iter().enumerate().map(line).collect()
}

fn source_of(planned: &Planned, manifest: &Manifest, store: &Store, state: &State) -> Result<Source, CampaignError> {
    if let Some(key) = &planned.key
        && state.has_result(store, key)?
    {
        return Ok(Source::Result(key.clone()));
    }
    let keys = [&planned.key, &planned.measure_key];
    let attempt = keys.into_iter().flatten().find_map(|key| results::read_trouble(store, key));
    let without = || match &planned.trouble {
        Some(trouble) => failed_record(planned, manifest, trouble.clone()),
        None => {
            let outcome = Outcome::Pending { reason: "there is no result yet".to_owned() };
            FlightRecord { outcome, ..failed_record(planned, manifest, String::new()) }
        }
    };
    Ok(Source::Without(Box::new(attempt.unwrap_or_else(without))))
}

fn page_hash(
    manifest: &Manifest,
    planned: &Planned,
    slug: &str,
    neighbours: &[Option<(&str, String)>; 2],
    source: &Source,
) -> String {
    let from = match source {
        Source::Result(key) => format!("result {key}"),
        Source::Without(record) => format!("without {}", record.outcome.reason().unwrap_or_default()),
    };
    let version = REPORT_VERSION.to_string();
    let criteria = manifest.criteria_parts();
    let names = neighbours.each_ref().map(|n| n.as_ref().map_or("", |(name, _)| *name));
    let [before, after] = names;
    let cards = manifest.test_cards.hash_of(&planned.flight);
    let (pipeline, build) = (&manifest.pipeline.blake3, &manifest.flightlag_version);
    let parts =
        [&planned.flight, slug, before, after, &from, &version, &manifest.command, build, pipeline, cards.as_str()];
    hash_of_parts(&[parts.as_slice(), &criteria].concat())
}

fn whole_hash(manifest: &Manifest, lines: &[Line<'_>]) -> String {
    let cards = manifest.test_cards.hash();
    let mut parts = vec![manifest.name.as_str(), &manifest.pipeline.blake3, &manifest.command, &cards];
    parts.extend(manifest.ignored.iter().flat_map(|i| [i.path.as_str(), i.reason.as_str()]));
    parts.extend(lines.iter().map(|l| l.made_from.as_str()));
    parts.extend(manifest.criteria_parts());
    hash_of_parts(&parts)
}

/// The campaign record in the folder, and its hash.
pub(crate) struct Previous {
    pub(crate) record: CampaignRecord,
    pub(crate) blake3: String,
}

/// Reads the record of an earlier run; `None` if unreadable.
pub(crate) fn previous_record(store: &Store) -> Option<Previous> {
    let [text, rows] = [RECORD, ROWS].map(|name| store.read(name).ok().flatten());
    let (text, rows) = (text?, rows?);
    let record = rows::unpacked(&text, &rows).ok()?;
    let is_ours = record.record_version == RECORD_VERSION;
    is_ours.then(|| Previous { record, blake3: hash_of_bytes(&[&text, &rows]) })
}

struct Reducer<'a> {
    manifest: &'a Manifest,
    pipeline: Pipeline,
    criteria: Option<Criteria>,
    test_cards: TestCards,
    context: &'a RunContext<'a>,
    store: &'a Store,
    /// Record of an earlier run, without the rows that may be reused.
    before: Option<CampaignRecord>,
    /// Reusable rows of that run. They are moved out, because many thousands would use much memory twice.
    rows: Mutex<BTreeMap<String, Box<FlightRow>>>,
}

/// Files of results, by key.
type Results = BTreeMap<String, Files>;

/// A finished line.
struct Reduced {
    row: Box<FlightRow>,
    /// Whether that is the row of the previous run.
    same_row: bool,
    /// The page, if made now.
    page: Option<PageState>,
    /// The files of the result that the page shows, if it was made now.
    files: Option<Files>,
}

/// Progress of a reduction, saved from time to time so that a stopped one continues from there.
struct Progress<'a> {
    state: &'a mut State,
    saved: Instant,
}

/// Finished pages are saved in the state at this interval.
const SAVE_EVERY: Duration = Duration::from_secs(20);

impl Progress<'_> {
    fn done(&mut self, slug: &str, page: &PageState, store: &Store) -> Result<(), CampaignError> {
        self.state.pages.insert(slug.to_owned(), PageState { has_row: false, ..page.clone() });
        if self.saved.elapsed() > SAVE_EVERY {
            self.state.save(store)?;
            self.saved = Instant::now();
        }
        Ok(())
    }
}

impl Reducer<'_> {
    fn reduce(&self, lines: &[Line<'_>], made_from: String, state: &mut State) -> Result<Reduction, CampaignError> {
        let kept_pages = self.withdraw(lines, state)?;
        let reduced = self.each_line(lines, &kept_pages, state)?;
        let damaged: Vec<String> =
            lines.iter().zip(&reduced).filter(|(_, r)| r.is_none()).map(|(l, _)| l.planned.flight.clone()).collect();
        if !damaged.is_empty() {
            return Ok(Reduction::Damaged(damaged));
        }
        let reduced: Vec<Reduced> = reduced.into_iter().flatten().collect();
        let pages = reduced.iter().filter(|r| r.page.is_some()).count();
        self.context.send(Event::Reduced { pages, kept: reduced.len() - pages });
        self.finish(lines, reduced, made_from, state)
    }

    /// Removes everything from the state that will be replaced, so that a killed run leaves no wrong claim. Returns the
    /// pages that stay, by folder name, and whether the campaign's record has their rows.
    fn withdraw(&self, lines: &[Line<'_>], state: &mut State) -> Result<BTreeMap<String, bool>, CampaignError> {
        let made_from: BTreeMap<&str, &str> = lines.iter().map(|l| (l.slug.as_str(), l.made_from.as_str())).collect();
        state.pages.retain(|slug, page| made_from.get(slug.as_str()) == Some(&page.made_from.as_str()));
        state.whole = None;
        state.save(self.store)?;
        Ok(state.pages.iter().map(|(slug, page)| (slug.clone(), page.has_row)).collect())
    }

    fn each_line(
        &self,
        lines: &[Line<'_>],
        kept_pages: &BTreeMap<String, bool>,
        state: &mut State,
    ) -> Result<Vec<Option<Reduced>>, CampaignError> {
        let progress = Mutex::new(Progress { state, saved: Instant::now() });
        let one = |(): &mut (), line: &Line<'_>| {
            let reduced = match kept_pages.get(&line.slug) {
                Some(has_row) => self.kept(line, *has_row)?,
                None => self.made(line)?,
            };
            if let Some(page) = reduced.as_ref().and_then(|r: &Reduced| r.page.as_ref()) {
                let mut progress = progress.lock().unwrap_or_else(|e| e.into_inner());
                progress.done(&line.slug, page, self.store)?;
            }
            Ok(reduced)
        };
        let answers = Workers::start(self.context.threads)?.each(lines, self.context.cancel, || (), one);
        if let Err(stopped) = self.context.stopped() {
            progress.into_inner().unwrap_or_else(|e| e.into_inner()).state.save(self.store)?;
            return Err(stopped);
        }
        answers.into_iter().map(|a| a.unwrap_or(Err(CampaignError::Cancelled))).collect()
    }

    /// A line with an up-to-date page. Its row is too, or is made from the record.
    fn kept(&self, line: &Line<'_>, has_row: bool) -> Result<Option<Reduced>, CampaignError> {
        let mut rows = self.rows.lock().unwrap_or_else(|e| e.into_inner());
        let row = if has_row { rows.remove(&line.planned.flight) } else { None };
        drop(rows);
        let same_row = row.is_some();
        let row = match row {
            Some(row) => row,
            None => match self.record_of(line)? {
                Some((record, _)) => Box::new(row_of(line, &record)),
                None => return Ok(None),
            },
        };
        Ok(Some(Reduced { row, same_row, page: None, files: None }))
    }

    /// Files of measurement and result of each line: from this run, else from the state, else from the disk.
    fn files_of(&self, lines: &[Line<'_>], reduced: &mut [Reduced], mut known: Results) -> Results {
        let mut results = Results::new();
        for (line, done) in lines.iter().zip(reduced) {
            let result = match &line.source {
                Source::Result(key) => Some(key),
                Source::Without(_) => None,
            };
            for (key, fresh) in [(line.planned.measure_key.as_ref(), None), (result, done.files.take())] {
                let Some(key) = key.filter(|key| !results.contains_key(*key)) else { continue };
                let files = fresh.or_else(|| known.remove(key));
                let files = files.or_else(|| Some(ResultFiles::of(self.store, key)?.kept(self.store)));
                results.extend(files.map(|files| (key.clone(), files)));
            }
        }
        results
    }

    /// The record of a line for its page, and the files of its result; `None` if the result turns out to be damaged.
    fn record_of(&self, line: &Line<'_>) -> Result<Option<(FlightRecord, Option<ResultFiles>)>, CampaignError> {
        let (record, list) = match &line.source {
            Source::Without(record) => ((**record).clone(), None),
            Source::Result(key) => match results::read(self.store, key)? {
                Some((record, list)) => (record, Some(list)),
                None => return Ok(None),
            },
        };
        let mut record = FlightRecord { pipeline: self.manifest.pipeline.clone(), ..record };
        record.criteria = self.criteria.as_ref().map(|c| c.judge(&line.planned.flight, &record));
        record.test = self.test_cards.of_flight(&line.planned.flight, &record);
        Ok(Some((record, list)))
    }

    /// Page and row of a line; `None` if its result turns out to be damaged.
    fn made(&self, line: &Line<'_>) -> Result<Option<Reduced>, CampaignError> {
        let Some((record, list)) = self.record_of(line)? else { return Ok(None) };
        let Ok(files) = self.write_page(line, &record, list.as_ref())? else { return Ok(None) };
        let row = Box::new(row_of(line, &record));
        let page = PageState { made_from: line.made_from.clone(), files, has_row: true };
        let files = list.map(|list| list.kept(self.store));
        Ok(Some(Reduced { row, same_row: false, page: Some(page), files }))
    }

    fn write_page(
        &self,
        line: &Line<'_>,
        record: &FlightRecord,
        list: Option<&ResultFiles>,
    ) -> Result<Result<Files, Damaged>, CampaignError> {
        let folder = format!("flights/{}", line.slug);
        let drawn = list.filter(|_| record.drawable().is_some());
        let explorer = match drawn.map(|list| results::read_explorer(self.store, list)).transpose()? {
            Some(Err(damaged)) => return Ok(Err(damaged)),
            Some(Ok(rows)) => rows,
            None => None,
        };
        let track = match list.map(|list| results::track_of(self.store, list)).transpose()? {
            Some(Err(damaged)) => return Ok(Err(damaged)),
            Some(Ok(track)) => track.map(|track| format!("../../{track}")),
            None => None,
        };
        let neighbours =
            line.neighbours.each_ref().map(|n| n.as_ref().map(|(name, slug)| (*name, format!("../{slug}/index.html"))));
        // With settings, verdicts and test cards, next to the page where users look for it.
        let files_for_page = list.map(|_| results::for_page(record));
        let page = FlightPage {
            name: &line.planned.flight,
            record,
            has_details: files_for_page.as_ref().is_some_and(|(_, details)| details.is_some()),
            explorer: explorer.as_ref(),
            track_href: track.as_deref(),
            index_href: "../../index.html",
            neighbours: neighbours.each_ref().map(|n| n.as_ref().map(|(name, href)| (*name, href.as_str()))),
            command: &self.manifest.command,
        };
        let site = caught(|| report::flight_site(&page)).map_err(|what| defect(&folder, what))?;
        let mut files = self.write_site(&folder, &site)?;
        let (short, details) = files_for_page.unzip();
        for (base, bytes) in [(results::RECORD, short), (results::DETAILS, details.flatten())] {
            let (Some(bytes), name) = (bytes, format!("{folder}/{base}")) else { continue };
            let kept = self.store.write(&name, &bytes, Keep::Renewable)?;
            files.insert(name, kept);
        }
        self.remove_other_files(&folder, &files)?;
        Ok(Ok(files))
    }

    /// Removes files of an earlier page of the flight that the new one does not have.
    fn remove_other_files(&self, folder: &str, files: &Files) -> Result<(), CampaignError> {
        for name in self.store.list(folder).iter().filter(|n| is_ours(n) && !files.contains_key(*n)) {
            self.store.remove(name)?;
        }
        Ok(())
    }

    fn write_site(&self, folder: &str, site: &Site) -> Result<Files, CampaignError> {
        let mut files = Files::new();
        for (path, bytes) in site.to_write() {
            let name = if folder.is_empty() { path.to_owned() } else { format!("{folder}/{path}") };
            let kept = self.store.write(&name, &bytes, Keep::Renewable)?;
            files.insert(name, kept);
        }
        Ok(files)
    }

    fn finish(
        &self,
        lines: &[Line<'_>],
        mut reduced: Vec<Reduced>,
        made_from: String,
        state: &mut State,
    ) -> Result<Reduction, CampaignError> {
        let (mut rows, mut same) = (Vec::with_capacity(lines.len()), BTreeSet::new());
        state.results = self.files_of(lines, &mut reduced, std::mem::take(&mut state.results));
        let mut kept_pages = std::mem::take(&mut state.pages);
        for (line, done) in lines.iter().zip(reduced) {
            if done.same_row {
                same.insert(line.planned.flight.as_str());
            }
            rows.push(*done.row);
            let page = done.page.or_else(|| kept_pages.remove(&line.slug));
            state.pages.extend(page.map(|page| (line.slug.clone(), PageState { has_row: true, ..page })));
        }
        let record = self.campaign_record(rows);
        let excerpts = match self.excerpts(&record)? {
            Ok(excerpts) => excerpts,
            Err(damaged) => return Ok(Reduction::Damaged(vec![damaged])),
        };
        self.remove_other_pages(state)?;
        let changes = self.changes(lines, &record, &same, state);
        let (files, record_blake3) = self.write_whole(&record, &changes, &excerpts)?;
        let verdict = verdict(self.store, &record, troubled(lines), false);
        state.whole = Some(WholeState { made_from, files });
        state.record_blake3 = record_blake3;
        state.learn(self.manifest);
        state.save(self.store)?;
        reports::list(self.store, &summary_of(&verdict), self.context)?;
        report_end(self.context, self.store, &record, &verdict);
        Ok(Reduction::Finished(Box::new(verdict)))
    }

    /// Removes pages of flights that are gone; files that flightlag did not write stay.
    fn remove_other_pages(&self, state: &State) -> Result<(), CampaignError> {
        let gone = |name: &&String| {
            let slug = name.strip_prefix("flights/").and_then(|n| n.split('/').next());
            slug.is_some_and(|s| !state.pages.contains_key(s))
        };
        let mut pages = 0_usize;
        for name in self.store.list("flights").iter().filter(gone) {
            match is_ours(name) {
                true => self.store.remove(name)?,
                false => self.store.remove_empty_folder(name),
            }
            pages += usize::from(name.ends_with("/index.html"));
        }
        if pages > 0 {
            let text = format!(
                "removed pages of flights that are no longer in the folder: {pages}; their results are kept in \
                 by-key"
            );
            self.context.send(Event::Remark { text });
        }
        Ok(())
    }

    /// Changes since the previous run; the existing ones if this run changes nothing.
    fn changes(
        &self,
        lines: &[Line<'_>],
        record: &CampaignRecord,
        same: &BTreeSet<&str>,
        state: &State,
    ) -> CampaignChanges {
        let planned: BTreeMap<&str, &Planned> = lines.iter().map(|l| (l.planned.flight.as_str(), l.planned)).collect();
        let causes = |flight: &str| planned.get(flight).map(|p| state.causes(p, self.manifest)).unwrap_or_default();
        let rows = self.rows.lock().unwrap_or_else(|e| e.into_inner());
        let others = self.before.iter().flat_map(|before| &before.flights).chain(rows.values().map(Box::as_ref));
        let found = changes(self.before.as_ref().map(|before| (before, others.collect())), record, same, &causes);
        let kept = self.store.read(CHANGES).ok().flatten().and_then(|bytes| serde_json::from_slice(&bytes).ok());
        kept.filter(|_| found.is_empty()).unwrap_or(found)
    }

    /// Hardest turns of the flights whose tracks are on the campaign's page. The error is the flight whose result turns
    /// out to be damaged.
    fn excerpts(&self, record: &CampaignRecord) -> Result<Result<Vec<TrackExcerpt>, String>, CampaignError> {
        let mut excerpts = vec![];
        for row in report::excerpt_flights(record) {
            let Some((record, _)) = results::read(self.store, &row.key)? else { return Ok(Err(row.flight.clone())) };
            let zoom = record.replay.and_then(|replay| replay.zoom);
            excerpts.extend(zoom.map(|zoom| TrackExcerpt { flight: row.flight.clone(), zoom }));
        }
        Ok(Ok(excerpts))
    }

    fn write_whole(
        &self,
        record: &CampaignRecord,
        changes: &CampaignChanges,
        excerpts: &[TrackExcerpt],
    ) -> Result<(Files, String), CampaignError> {
        let tables = caught(|| table::write_flights(self.store, &record.flights));
        let mut files = tables.map_err(|what| defect("flights.parquet", what))??;
        // Before the record: after a kill in between, the next run compares the same two again.
        let mut site = caught(|| report::changes_site(changes, &record.flights))
            .map_err(|what| defect("since-last-run.html", what))?;
        let kept = self.store.write(CHANGES, &pretty(changes), Keep::Renewable)?;
        files.insert(CHANGES.to_owned(), kept);
        files.extend(self.write_site("", &site)?);
        let (text, rows) = (record.to_json(), rows::packed(record));
        for (name, bytes) in [(ROWS, &rows), (RECORD, &text)] {
            files.insert(name.to_owned(), self.store.write(name, bytes, Keep::Renewable)?);
        }
        let blake3 = hash_of_bytes(&[&text, &rows]);
        site = caught(|| report::campaign_site(record, excerpts)).map_err(|what| defect("index.html", what))?;
        files.extend(self.write_site("", &site)?);
        self.remove_other_tables(&files)?;
        Ok((files, blake3))
    }

    /// Removes pages that the table no longer needs, and figures that are no longer drawn.
    fn remove_other_tables(&self, files: &Files) -> Result<(), CampaignError> {
        for (folder, ending) in [(report::TABLE_FOLDER, ".html"), ("figures", ".svg")] {
            let ours = self.store.list(folder).into_iter().filter(|name| name.ends_with(ending));
            for name in ours.filter(|name| !files.contains_key(name)) {
                self.store.remove(&name)?;
            }
        }
        Ok(())
    }

    fn campaign_record(&self, mut flights: Vec<FlightRow>) -> CampaignRecord {
        let decided = decide::of_rows(&flights, &self.pipeline);
        let mut groups = decided.groups;
        let duplicate_of: BTreeMap<String, String> =
            decided.duplicate_of.into_iter().map(|(copy, of)| (copy.to_owned(), of.to_owned())).collect();
        for row in &mut flights {
            row.duplicate_of = duplicate_of.get(&row.flight).cloned();
        }
        for group in groups.iter_mut().filter(|group| group.split.is_none()) {
            group.consistency = consistency(group, &flights);
        }
        CampaignRecord {
            groups,
            record_version: self.manifest.record_version,
            analysis_version: self.manifest.analysis_version,
            flightlag_version: self.manifest.flightlag_version.clone(),
            name: self.manifest.name.clone(),
            pipeline: self.manifest.pipeline.clone(),
            command: self.manifest.command.clone(),
            criteria: self.criteria.as_ref().map(|c| c.summary(&flights)),
            test: self.test_cards.of_campaign(&flights),
            totals: totals_of(&flights),
            flights,
            ignored: self.manifest.ignored.clone(),
        }
    }
}

/// Position against velocity over the flights of a group.
fn consistency(group: &GroupLateness, flights: &[FlightRow]) -> Option<CampaignDelay> {
    let members: BTreeSet<&str> = group.members.iter().map(String::as_str).collect();
    let rows: Vec<&FlightRow> = flights.iter().filter(|row| members.contains(row.flight.as_str())).collect();
    campaign_delay(&rows, &group.outliers)
}

fn hash_of_bytes(parts: &[&[u8]]) -> String {
    let mut hasher = blake3::Hasher::new();
    for part in parts {
        hasher.update(part);
    }
    hasher.finalize().to_hex().to_string()
}

fn pretty(record: &impl serde::Serialize) -> Vec<u8> {
    // The record's types have text keys and cannot fail.
    let mut text = serde_json::to_vec_pretty(record).unwrap_or_default();
    text.push(b'\n');
    text
}

fn defect(path: &str, what: String) -> CampaignError {
    CampaignError::Table { path: path.to_owned(), what: format!("a defect in flightlag, please report it: {what}") }
}

/// Whether a file below `flights/` has a name that only flightlag uses.
fn is_ours(name: &str) -> bool {
    let mut parts = name.split('/').skip(2);
    match (parts.next(), parts.next(), parts.next()) {
        (
            Some("index.html" | results::RECORD | results::DETAILS | "record.json" | "track.parquet" | "figures.zip"),
            None,
            _,
        ) => true,
        (Some(_), Some(figure), None) => figure.ends_with(".svg") || figure.ends_with(".csv"),
        _ => false,
    }
}

fn verdict(store: &Store, record: &CampaignRecord, troubled: u64, nothing_changed: bool) -> Verdict {
    let (totals, criteria) = (record.totals.clone(), record.criteria.clone());
    let (groups, lines) =
        (record.groups.iter().map(GroupLine::of).collect(), record.flights.iter().map(DelayLine::of_row).collect());
    Verdict { totals, criteria, troubled, groups, lines, page: store.root().join("index.html"), nothing_changed }
}

/// Maximum number of groups on the page over all reports; the campaign's own page has all.
const MOST_GROUPS: usize = 3;

fn summary_of(verdict: &Verdict) -> Summary {
    let group = |group: &GroupLine| match group.group.as_str() {
        "" => group.words.clone(),
        name => format!("{name}: {}", group.words),
    };
    let mut answers: Vec<String> = verdict.groups.iter().take(MOST_GROUPS).map(group).collect();
    if verdict.groups.len() > MOST_GROUPS {
        let more = verdict.groups.len() - MOST_GROUPS;
        answers.push(format!("and {more} more {}", if more == 1 { "group" } else { "groups" }));
    }
    Summary { size: verdict.totals.flights, answers }
}

/// Sends one event for each flight, then the totals.
fn report_end(context: &RunContext<'_>, store: &Store, record: &CampaignRecord, verdict: &Verdict) {
    for (row, line) in record.flights.iter().zip(&verdict.lines) {
        context.send(Event::Flight {
            outcome: row.outcome.word(),
            reason: row.outcome.reason().map(str::to_owned),
            page: store.root().join(&row.page),
            line: Box::new(line.clone()),
        });
    }
    let Verdict { totals, criteria, page, nothing_changed, .. } = verdict.clone();
    context.send(Event::Done { report: page, nothing_changed, totals, verdicts: criteria.map(|c| c.flights) });
}

/// The table row of a record.
fn row_of(line: &Line<'_>, record: &FlightRecord) -> FlightRow {
    let (replay, log) = (record.replay.as_ref(), record.log.as_ref());
    let lateness = record.lateness.as_ref();
    let position = replay.map(|r| r.pair.position.clone()).or_else(|| lateness?.position.clone());
    let velocity = replay.map(|r| r.pair.velocity.clone()).or_else(|| lateness?.velocity.clone());
    FlightRow {
        flight: line.planned.flight.clone(),
        key: record.key.clone(),
        page: format!("flights/{}/index.html", line.slug),
        outcome: record.outcome.clone(),
        lossy: record.has_loss(),
        minor_loss: record.has_minor_loss(),
        damage: log.and_then(|log| losses::damage(&record.notices, log)),
        tail_cut_bytes: log.map_or(0, |log| log.bytes.tail_cut),
        format: log.map(|log| log.format.clone()).unwrap_or_default(),
        map: record.binding.as_ref().map(|b| b.map.clone()),
        bytes: record.inputs.iter().map(|i| i.bytes).sum(),
        duration_s: replay.map(|r| r.coverage.duration_s).or_else(|| span_of(record, position.as_deref())),
        position_rate_hz: rate(record, position.as_deref()),
        velocity_rate_hz: rate(record, velocity.as_deref()),
        position,
        velocity,
        speed_median_mps: record.drawable().map(|r| r.speed_mps.median),
        delay_s: replay.map(|r| r.settings.delay.seconds()),
        measured_delay_s: record.lateness.as_ref().and_then(|l| l.position_minus_velocity_s),
        delay_from: replay.and_then(|r| Some(r.choice.as_ref()?.used)),
        card_delay_s: card_delay(record),
        flown_at: flown_at(record),
        track_sketch_m: record.drawable().and_then(|r| sketch(&r.lead.as_ref()?.track)),
        sweep: replay.and_then(|r| r.sweep.clone()),
        correction_rms_m: finite(record, "exact-async", |c| Some(c.raw_minus_this_rms_m)),
        raw_error_rms_m: finite(record, "raw", |c| c.error_rms_m),
        pade_error_rms_m: finite(record, "pade-1-1", |c| c.error_rms_m),
        exact_error_rms_m: finite(record, "exact-async", |c| c.error_rms_m),
        valid_share: replay.and_then(valid_share),
        criteria: record.criteria.as_ref().map(row_verdicts),
        cards: record.test.as_ref().map(row_cards).unwrap_or_default(),
        lateness: record.lateness.clone(),
        decision: record.decision.clone(),
        effect: record.effect.clone(),
        duplicate_of: None,
        attention: attention(record),
        warnings: record.notices.count_of(Severity::Warning),
        losses: record.notices.count_of(Severity::Loss),
    }
}

fn flown_at(record: &FlightRecord) -> Option<String> {
    Some(jiff::Timestamp::from_nanosecond(i128::from(record.began()?.0)).ok()?.to_string())
}

/// A number of the compensator with this name, if it ran and the number is finite.
fn finite(record: &FlightRecord, name: &str, of: impl Fn(&CompensatorResult) -> Option<Estimate>) -> Option<Estimate> {
    let result = record.replay.as_ref()?.compensators.iter().find(|c| c.name == name)?;
    of(result).filter(|e| e.value.is_finite())
}

/// The sensor card's delay of the replayed pair, s.
fn card_delay(record: &FlightRecord) -> Option<Estimate> {
    let candidates = &record.replay.as_ref()?.choice.as_ref()?.candidates;
    candidates.iter().find(|c| c.source == DelaySource::Card)?.delay_s.found().copied()
}

fn valid_share(replay: &record::ReplayRecord) -> Option<f64> {
    let coverage = &replay.coverage;
    (coverage.duration_s > 0.0).then(|| coverage.valid_s / coverage.duration_s)
}

/// Warnings that make the numbers of a flight doubtful.
const GRAVE: [Code; 4] =
    [Code::VelocityContradictsPosition, Code::StampsCoarserThanDelay, Code::CardMismatch, Code::CardRelative];
/// Below this share of time with output, a flight needs attention.
const FEW_VALID: f64 = 0.95;

/// Why this flight needs attention.
fn attention(record: &FlightRecord) -> Vec<String> {
    let harmed = record.effect.as_ref().filter(|e| e.verdict == EffectVerdict::Harmed);
    let alarms = flight_alarms(record.lateness.as_ref(), record.decision.as_ref());
    let mut reasons: Vec<String> = harmed.map(|e| e.words.clone()).into_iter().collect();
    reasons.extend(alarms.into_iter().filter(|a| a.gravity != Gravity::Grey).map(|a| a.text));
    let grave: Vec<String> =
        record.notices.iter().filter(|n| GRAVE.iter().any(|grave| n.code == *grave)).map(|n| n.text.clone()).collect();
    reasons.extend(grave);
    let findings = record.criteria.iter().flat_map(|c| &c.findings);
    reasons.extend(findings.filter(|f| f.verdict == CriterionVerdict::Fail).map(report::criterion_sentence));
    reasons.extend(loss_reasons(record));
    reasons.extend(record.replay.iter().flat_map(output_reasons));
    reasons
}

/// Losses of the log.
fn loss_reasons(record: &FlightRecord) -> Vec<String> {
    let worded = |n: &Notice| if n.place.is_empty() { n.text.clone() } else { format!("{}: {}", n.place, n.text) };
    let mut reasons: Vec<String> = vec![];
    reasons.extend(record.notices.iter().find(|n| n.code == Code::MinorLoss).map(worded));
    let damage = record.log.as_ref().map(|l| l.bytes.damaged).filter(|bytes| *bytes > 0 && record.has_loss());
    if let Some(damage) = damage {
        reasons.push(format!("{damage} bytes of the log are damaged"));
    }
    let losses: Vec<&Notice> = record.notices.iter().filter(|n| n.severity == Severity::Loss).collect();
    reasons.extend(losses.first().map(|first| worded(first)));
    if losses.len() > 1 {
        let more = losses.len() - 1;
        let notices = if more == 1 { "notice" } else { "notices" };
        reasons.push(format!("{more} more {notices} of damage on the flight's page"));
    }
    reasons
}

/// When the compensators gave no output.
fn output_reasons(replay: &record::ReplayRecord) -> Vec<String> {
    let mut reasons = vec![];
    match replay.coverage.restarts {
        0 => {}
        1 => reasons.push("a velocity gap: the compensators restarted once".to_owned()),
        restarts => reasons.push(format!("velocity gaps: the compensators restarted {restarts} times")),
    }
    if let Some(share) = valid_share(replay).filter(|share| *share < FEW_VALID) {
        reasons.push(format!("compensated for only {:.0} % of the time", 100.0 * share));
    }
    reasons
}

fn rate(record: &FlightRecord, channel: Option<&str>) -> Option<f64> {
    rate_of(&record.binding.as_ref()?.channels, channel?)
}

/// Time from the first to the last row of a channel, s.
fn span_of(record: &FlightRecord, channel: Option<&str>) -> Option<f64> {
    let channels = &record.binding.as_ref()?.channels;
    let stamps = channels.iter().find(|c| Some(c.name.as_str()) == channel)?.stamps.as_ref()?;
    Some(stamps.last_ns.abs_diff(stamps.first_ns) as f64 * 1e-9)
}

fn totals_of(rows: &[FlightRow]) -> CampaignTotals {
    let count = |of: &dyn Fn(&&FlightRow) -> bool| rows.iter().filter(of).count() as u64;
    let effect = |row: &FlightRow| row.effect.as_ref().map(|e| e.verdict);
    CampaignTotals {
        flights: rows.len() as u64,
        compensated: count(&|r| r.outcome == Outcome::Compensated),
        uncompensated: count(&|r| matches!(r.outcome, Outcome::Uncompensated { .. })),
        harmed: count(&|r| effect(r) == Some(EffectVerdict::Harmed)),
        helped: count(&|r| effect(r) == Some(EffectVerdict::Helped)),
        varying: count(&|r| r.lateness.as_ref().is_some_and(|l| l.kind.varies())),
        not_measurable: count(&|r| matches!(r.outcome, Outcome::NotMeasurable { .. })),
        failed: count(&|r| matches!(r.outcome, Outcome::Failed { .. })),
        pending: count(&|r| matches!(r.outcome, Outcome::Pending { .. })),
        lossy: count(&|r| r.lossy),
        bytes: rows.iter().map(|r| r.bytes).sum(),
        // The sum of no values would be minus zero.
        duration_s: rows
            .iter()
            .filter(|r| r.delay_s.is_some())
            .filter_map(|r| r.duration_s)
            .fold(0.0, |sum, s| sum + s),
    }
}

/// The only output with the time of day, the host, and the duration.
#[derive(Serialize)]
struct RunRecord {
    flightlag_version: &'static str,
    started: String,
    seconds: f64,
    host: String,
    threads: usize,
    flights: u64,
    /// Absent if the tasks of a cluster made them.
    #[serde(skip_serializing_if = "Option::is_none")]
    results_made: Option<usize>,
    flights_in_trouble: u64,
    nothing_changed: bool,
}

pub(crate) fn write_run(
    store: &Store,
    context: &RunContext<'_>,
    (started, clock): (jiff::Timestamp, Instant),
    results_made: Option<usize>,
    verdict: &Verdict,
) -> Result<(), CampaignError> {
    let run = RunRecord {
        flightlag_version: FLIGHTLAG_VERSION,
        started: started.to_string(),
        seconds: clock.elapsed().as_secs_f64(),
        host: host_name(),
        threads: context.threads,
        flights: verdict.totals.flights,
        results_made,
        flights_in_trouble: verdict.troubled,
        nothing_changed: verdict.nothing_changed,
    };
    let mut text = serde_json::to_vec_pretty(&run).unwrap_or_default();
    text.push(b'\n');
    Ok(store.write("run.json", &text, Keep::Renewable).map(drop)?)
}
