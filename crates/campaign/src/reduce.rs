//! All results become one table, one record, and pages. Safe to run again at any time: a page or
//! a row that was made from the same things stands.

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
use crate::manifest::{Manifest, Planned, hash_of_parts};
use crate::plan::Desk;
use crate::rate::rate_of;
use crate::reports::{self, Summary};
use crate::results;
use crate::slug::slugs;
use crate::state::{PageState, Sizes, State, WholeState, stand};
use crate::store::{Keep, Store};
use crate::study::failed_record;
use crate::table;
use crate::task::caught;
use crate::test_cards::{TestCards, row_cards};
use crate::work::Workers;
use flight::{Notice, Severity};
use record::{
    CampaignChanges, CampaignCriteria, CampaignDelay, CampaignRecord, CampaignTotals, CompensatorResult,
    CriterionVerdict, DelaySource, EffectVerdict, Estimate, FlightRecord, FlightRow, Gravity, GroupLateness,
    MINOR_LOSS, Outcome, flight_alarms,
};
use report::{FlightPage, REPORT_VERSION, Site, TrackExcerpt};
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

const RECORD: &str = "campaign.json";
/// What changed since the run before: besides `run.json` the only output that depends on it.
const CHANGES: &str = "since-last-run.json";

/// How a campaign ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Verdict {
    /// Counts over all flights.
    pub totals: CampaignTotals,
    /// What the criteria say; `None` where none were given.
    pub criteria: Option<CampaignCriteria>,
    /// Flights without a lasting result; they are among the pending and the failed ones.
    pub troubled: u64,
    /// How late the position is, by group of flights.
    pub groups: Vec<GroupLine>,
    /// One line for each flight.
    pub lines: Vec<DelayLine>,
    /// The page to open.
    pub page: PathBuf,
    /// Whether everything stood already.
    pub nothing_changed: bool,
}

impl Verdict {
    /// 4 if a flight fails a criterion or was harmed, else 3 if some failed, lost data, have a delay that changes or a
    /// reference file that cannot be used, else 0.
    #[must_use]
    pub fn exit(&self) -> Exit {
        if self.totals.harmed > 0 || self.criteria.as_ref().is_some_and(|c| c.flights.fail > 0) {
            return Exit::CriterionFailed;
        }
        let CampaignTotals { failed, lossy, varying, .. } = self.totals;
        let lacks_reference = self.lines.iter().any(DelayLine::lacks_reference);
        let whole = failed == 0 && lossy == 0 && varying == 0 && self.troubled == 0 && !lacks_reference;
        if whole { Exit::Well } else { Exit::Incomplete }
    }
}

/// Makes table, record and pages from whatever results are there. Flights without one are named.
///
/// # Errors
/// An output cannot be written, another process is at work on the folder, or the user stopped.
pub fn reduce(manifest: &Manifest, desk: &Desk<'_>) -> Result<Verdict, CampaignError> {
    let store = Store::open(manifest.out())?;
    let _lock = OutputLock::take(&store, desk.events)?;
    store.clean();
    let mut state = State::recall(&store);
    match reduce_locked(manifest, desk, &store, &mut state)? {
        Reduction::Finished(verdict) => Ok(*verdict),
        Reduction::Damaged(flights) => {
            let count = flights.len();
            Err(CampaignError::TryAgain(format!("{count} results were damaged and have been removed: plan again")))
        }
    }
}

/// What a reduction came to.
pub(crate) enum Reduction {
    Finished(Box<Verdict>),
    /// Results of these flights were there and not whole. They are removed.
    Damaged(Vec<String>),
}

/// Reduces under a lock that the caller holds.
pub(crate) fn reduce_locked(
    manifest: &Manifest,
    desk: &Desk<'_>,
    store: &Store,
    state: &mut State,
) -> Result<Reduction, CampaignError> {
    let lines = lines(manifest, store);
    let made_from = whole_hash(manifest, &lines);
    let before = previous_record(store);
    let old = before.as_ref().filter(|before| state.whole.as_ref().is_some_and(|w| w.record_blake3 == before.blake3));
    let stands = |w: &&WholeState| w.made_from == made_from && everything_stands(store, state, w);
    if let (Some(whole), Some(old)) = (state.whole.as_ref().filter(stands), old) {
        desk.tell(Event::NothingChanged);
        let verdict = verdict(store, whole, &old.record, true);
        if reports::is_unlisted(store) {
            reports::list(store, &summary_of(&verdict), desk)?;
        }
        tell_end(desk, store, &old.record, &verdict);
        return Ok(Reduction::Finished(Box::new(verdict)));
    }
    let criteria = manifest.criteria.as_ref().map(Criteria::of_use).transpose()?;
    let rows = old.into_iter().flat_map(|r| &r.record.flights).map(|row| (row.flight.clone(), row.clone())).collect();
    let before = before.map(|before| before.record);
    let pipeline = Pipeline::of_manifest(&manifest.pipeline.toml, &manifest.cards)?;
    let test_cards = TestCards::of_files(&manifest.test_cards)?;
    let reducer = Reducer { manifest, pipeline, criteria, test_cards, desk, store, before, rows };
    reducer.reduce(&lines, made_from, state)
}

/// A flight and where its result comes from.
struct Line<'a> {
    planned: &'a Planned,
    slug: String,
    /// The flights before and after it, with their folders.
    neighbours: [Option<(&'a str, String)>; 2],
    source: Source,
    /// Hash of everything that its page is made from.
    made_from: String,
}

/// Where the result of a flight comes from.
enum Source {
    /// A result with this key.
    Result(String),
    /// There is none; the record says why.
    Without(Box<FlightRecord>),
}

fn lines<'a>(manifest: &'a Manifest, store: &Store) -> Vec<Line<'a>> {
    let slugs = slugs(manifest.flights.iter().map(|f| f.flight.as_str()));
    let flights = &manifest.flights;
    let slug_of = |planned: &Planned| slugs.get(&planned.flight).cloned().unwrap_or_default();
    let line = |(n, planned): (usize, &'a Planned)| {
        let source = source_of(planned, manifest, store);
        let slug = slug_of(planned);
        let neighbour = |n: Option<usize>| n.and_then(|n| flights.get(n)).map(|p| (p.flight.as_str(), slug_of(p)));
        let neighbours = [neighbour(n.checked_sub(1)), neighbour(n.checked_add(1))];
        let made_from = page_hash(manifest, planned, &slug, &neighbours, &source);
        Line { planned, slug, neighbours, source, made_from }
    };
    flights.iter().enumerate().map(line).collect()
}

fn source_of(planned: &Planned, manifest: &Manifest, store: &Store) -> Source {
    if let Some(key) = planned.key.as_ref().filter(|key| results::is_there(store, key)) {
        return Source::Result(key.clone());
    }
    let keys = [&planned.key, &planned.measure_key];
    let attempt = keys.into_iter().flatten().find_map(|key| results::read_trouble(store, key));
    let without = || match &planned.trouble {
        Some(trouble) => failed_record(planned, manifest, trouble.clone()),
        None => {
            let outcome = Outcome::Pending { reason: "no result has been made yet".to_owned() };
            FlightRecord { outcome, ..failed_record(planned, manifest, String::new()) }
        }
    };
    Source::Without(Box::new(attempt.unwrap_or_else(without)))
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
        Source::Without(record) => format!("without {}", table::outcome_reason(&record.outcome).unwrap_or_default()),
    };
    let version = REPORT_VERSION.to_string();
    let criteria = manifest.criteria_parts();
    let beside = neighbours.each_ref().map(|n| n.as_ref().map_or("", |(name, _)| *name));
    let [before, after] = beside;
    let cards = manifest.test_cards.hash_of(&planned.flight);
    let parts =
        [&planned.flight, slug, before, after, &from, &version, &manifest.command, &manifest.flightlag_version, &cards];
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

fn everything_stands(store: &Store, state: &State, whole: &WholeState) -> bool {
    stand(store, &whole.files)
        && state.pages.values().all(|page| stand(store, &page.files))
        && state.results.values().all(|files| stand(store, files))
}

/// The campaign's record that the folder holds, and its hash.
struct Previous {
    record: CampaignRecord,
    blake3: String,
}

/// What the folder holds of an earlier run; `None` if it cannot be read.
fn previous_record(store: &Store) -> Option<Previous> {
    let bytes = store.read(RECORD).ok().flatten()?;
    let record = serde_json::from_slice::<CampaignRecord>(&bytes).ok()?;
    Some(Previous { record, blake3: blake3::hash(&bytes).to_hex().to_string() })
}

struct Reducer<'a> {
    manifest: &'a Manifest,
    pipeline: Pipeline,
    criteria: Option<Criteria>,
    test_cards: TestCards,
    desk: &'a Desk<'a>,
    store: &'a Store,
    /// What the folder holds of an earlier run.
    before: Option<CampaignRecord>,
    /// Rows of that run that may be used again.
    rows: BTreeMap<String, FlightRow>,
}

/// A line that is done.
struct Reduced {
    row: FlightRow,
    page: PageState,
    result: Option<(String, Sizes)>,
    fresh: bool,
}

impl Reducer<'_> {
    fn reduce(&self, lines: &[Line<'_>], made_from: String, state: &mut State) -> Result<Reduction, CampaignError> {
        let standing: BTreeSet<&str> =
            lines.iter().filter(|l| self.stands(l, state)).map(|l| l.slug.as_str()).collect();
        self.withdraw(&standing, state)?;
        let reduced = self.each_line(lines, &standing, state)?;
        let damaged: Vec<String> =
            lines.iter().zip(&reduced).filter(|(_, r)| r.is_none()).map(|(l, _)| l.planned.flight.clone()).collect();
        if !damaged.is_empty() {
            return Ok(Reduction::Damaged(damaged));
        }
        let reduced: Vec<Reduced> = reduced.into_iter().flatten().collect();
        let pages = reduced.iter().filter(|r| r.fresh).count();
        self.desk.tell(Event::Reduced { pages, kept: reduced.len() - pages });
        let troubled = lines.iter().filter(|l| matches!(l.source, Source::Without(_))).count() as u64;
        self.finish(lines, reduced, made_from, troubled, state)
    }

    /// Whether page and row of a line can stay as they are.
    fn stands(&self, line: &Line<'_>, state: &State) -> bool {
        let page = state.pages.get(&line.slug).filter(|p| p.made_from == line.made_from);
        page.is_some_and(|p| stand(self.store, &p.files)) && self.rows.contains_key(&line.planned.flight)
    }

    /// From here on, only what stays is claimed to stand: a kill must not leave a claim that is wrong.
    fn withdraw(&self, standing: &BTreeSet<&str>, state: &mut State) -> Result<(), CampaignError> {
        state.pages.retain(|slug, _| standing.contains(slug.as_str()));
        state.whole = None;
        state.save(self.store)
    }

    fn each_line(
        &self,
        lines: &[Line<'_>],
        standing: &BTreeSet<&str>,
        state: &State,
    ) -> Result<Vec<Option<Reduced>>, CampaignError> {
        let one = |(): &mut (), line: &Line<'_>| match standing.contains(line.slug.as_str()) {
            true => Ok(self.kept(line, state)),
            false => self.made(line),
        };
        let answers = Workers::start(self.desk.threads)?.each(lines, self.desk.cancel, || (), one);
        self.desk.stopped()?;
        answers.into_iter().map(|a| a.unwrap_or(Err(CampaignError::Cancelled))).collect()
    }

    fn kept(&self, line: &Line<'_>, state: &State) -> Option<Reduced> {
        let row = self.rows.get(&line.planned.flight)?.clone();
        let page = state.pages.get(&line.slug)?.clone();
        let result = self.result_files(line, state);
        Some(Reduced { row, page, result, fresh: false })
    }

    fn result_files(&self, line: &Line<'_>, state: &State) -> Option<(String, Sizes)> {
        let Source::Result(key) = &line.source else { return None };
        let files = state.results.get(key).cloned().unwrap_or_else(|| results::sizes(self.store, key));
        Some((key.clone(), files))
    }

    /// Files of the measurement of a line.
    fn measured_files(&self, line: &Line<'_>, state: &State) -> Option<(String, Sizes)> {
        let key = line.planned.measure_key.as_ref().filter(|key| results::is_measured(self.store, key))?;
        let files = state.results.get(key).cloned().unwrap_or_else(|| results::sizes(self.store, key));
        Some((key.clone(), files))
    }

    /// Page and row of a line; `None` if its result turns out not to be whole.
    fn made(&self, line: &Line<'_>) -> Result<Option<Reduced>, CampaignError> {
        let (mut record, result) = match &line.source {
            Source::Without(record) => ((**record).clone(), None),
            Source::Result(key) => match results::read(self.store, key)? {
                Some(record) => (record, Some((key.clone(), results::sizes(self.store, key)))),
                None => return Ok(None),
            },
        };
        record.criteria = self.criteria.as_ref().map(|c| c.judge(&line.planned.flight, &record));
        record.test = self.test_cards.of_flight(&line.planned.flight, &record);
        let row = row_of(line, &record);
        let page = PageState { made_from: line.made_from.clone(), files: self.write_page(line, &record)? };
        Ok(Some(Reduced { row, page, result, fresh: true }))
    }

    fn write_page(&self, line: &Line<'_>, record: &FlightRecord) -> Result<Sizes, CampaignError> {
        let folder = format!("flights/{}", line.slug);
        let explorer = match (&line.source, record.drawable()) {
            (Source::Result(key), Some(_)) => results::read_explorer(self.store, key)?,
            _ => None,
        };
        let neighbours =
            line.neighbours.each_ref().map(|n| n.as_ref().map(|(name, slug)| (*name, format!("../{slug}/index.html"))));
        let page = FlightPage {
            name: &line.planned.flight,
            record,
            explorer: explorer.as_ref(),
            index_href: "../../index.html",
            neighbours: neighbours.each_ref().map(|n| n.as_ref().map(|(name, href)| (*name, href.as_str()))),
            command: &self.manifest.command,
        };
        let site = caught(|| report::flight_site(&page)).map_err(|what| defect(&folder, what))?;
        let mut files = self.write_site(&folder, &site)?;
        files.extend(self.place_results(&folder, line, record)?);
        for name in self.store.list(&folder).iter().filter(|n| is_ours(n) && !files.contains_key(*n)) {
            self.store.remove(name)?;
        }
        Ok(files)
    }

    /// Puts record and track beside the page, where a person looks for them; the record with its verdicts and
    /// test cards, if there are any.
    fn place_results(&self, folder: &str, line: &Line<'_>, record: &FlightRecord) -> Result<Sizes, CampaignError> {
        let beside =
            [("record.json", results::record_name(&record.key)), ("track.parquet", results::track_name(&record.key))];
        let mut files = Sizes::new();
        for (base, from) in beside {
            let name = format!("{folder}/{base}");
            let (Source::Result(_), Some(bytes)) = (&line.source, self.store.size(&from)) else { continue };
            if base == "record.json" && (record.criteria.is_some() || record.test.is_some()) {
                let text = results::text_of(record);
                self.store.write(&name, &text, Keep::Renewable)?;
                files.insert(name, text.len() as u64);
            } else {
                self.store.link(&from, &name)?;
                files.insert(name, bytes);
            }
        }
        Ok(files)
    }

    fn write_site(&self, folder: &str, site: &Site) -> Result<Sizes, CampaignError> {
        let mut files = Sizes::new();
        for (path, bytes) in &site.files {
            let name = if folder.is_empty() { path.clone() } else { format!("{folder}/{path}") };
            self.store.write(&name, bytes, Keep::Renewable)?;
            files.insert(name, bytes.len() as u64);
        }
        Ok(files)
    }

    fn finish(
        &self,
        lines: &[Line<'_>],
        reduced: Vec<Reduced>,
        made_from: String,
        troubled: u64,
        state: &mut State,
    ) -> Result<Reduction, CampaignError> {
        let mut rows = vec![];
        let measured: Vec<_> = lines.iter().filter_map(|line| self.measured_files(line, state)).collect();
        state.results = measured.into_iter().collect();
        state.pages.clear();
        for (line, done) in lines.iter().zip(reduced) {
            rows.push(done.row);
            state.results.extend(done.result);
            state.pages.insert(line.slug.clone(), done.page);
        }
        self.remove_other_pages(state)?;
        let record = self.campaign_record(rows);
        let changes = self.changes(lines, &record, state);
        let (files, record_blake3) = self.write_whole(&record, &changes)?;
        let (totals, criteria) = (record.totals.clone(), record.criteria.clone());
        let whole = WholeState { made_from, files, record_blake3, totals, criteria, troubled };
        let verdict = verdict(self.store, &whole, &record, false);
        state.whole = Some(whole);
        state.learn(self.manifest);
        state.save(self.store)?;
        reports::list(self.store, &summary_of(&verdict), self.desk)?;
        tell_end(self.desk, self.store, &record, &verdict);
        Ok(Reduction::Finished(Box::new(verdict)))
    }

    /// Pages of flights that are gone go too; files that we did not write stay.
    fn remove_other_pages(&self, state: &State) -> Result<(), CampaignError> {
        let gone = |name: &&String| {
            let slug = name.strip_prefix("flights/").and_then(|n| n.split('/').next());
            slug.is_some_and(|s| !state.pages.contains_key(s))
        };
        let mut pages = 0;
        for name in self.store.list("flights").iter().filter(gone) {
            match is_ours(name) {
                true => self.store.remove(name)?,
                false => self.store.remove_empty_folder(name),
            }
            pages += u64::from(name.ends_with("/index.html"));
        }
        if pages > 0 {
            let text = format!(
                "{pages} pages are removed: their flights are no longer in the folder (their results stay in by-key)"
            );
            self.desk.tell(Event::Remark { text });
        }
        Ok(())
    }

    /// Against the run before; what is there already if this run changes nothing.
    fn changes(&self, lines: &[Line<'_>], record: &CampaignRecord, state: &State) -> CampaignChanges {
        let planned: BTreeMap<&str, &Planned> = lines.iter().map(|l| (l.planned.flight.as_str(), l.planned)).collect();
        let causes = |flight: &str| planned.get(flight).map(|p| state.causes(p, self.manifest)).unwrap_or_default();
        let found = changes(self.before.as_ref(), record, &causes);
        let kept = self.store.read(CHANGES).ok().flatten().and_then(|bytes| serde_json::from_slice(&bytes).ok());
        kept.filter(|_| found.is_empty()).unwrap_or(found)
    }

    /// Where the aircraft turned hardest, of the flights whose tracks the campaign's page shows.
    fn excerpts(&self, record: &CampaignRecord) -> Result<Vec<TrackExcerpt>, CampaignError> {
        let mut excerpts = vec![];
        for row in report::excerpt_flights(record) {
            let zoom = results::read(self.store, &row.key)?.and_then(|record| record.replay?.zoom);
            excerpts.extend(zoom.map(|zoom| TrackExcerpt { flight: row.flight.clone(), zoom }));
        }
        Ok(excerpts)
    }

    fn write_whole(
        &self,
        record: &CampaignRecord,
        changes: &CampaignChanges,
    ) -> Result<(Sizes, String), CampaignError> {
        let tables = caught(|| table::write_flights(self.store, &record.flights));
        tables.map_err(|what| defect("flights.parquet", what))??;
        // Before the record: a run that is killed in between compares the same two again.
        let mut site = caught(|| report::changes_site(changes, &record.flights))
            .map_err(|what| defect("since-last-run.html", what))?;
        self.store.write(CHANGES, &pretty(changes), Keep::Renewable)?;
        let mut files = self.write_site("", &site)?;
        let text = pretty(record);
        self.store.write(RECORD, &text, Keep::Renewable)?;
        let excerpts = self.excerpts(record)?;
        site = caught(|| report::campaign_site(record, &excerpts)).map_err(|what| defect("index.html", what))?;
        files.extend(self.write_site("", &site)?);
        self.remove_other_tables(&files)?;
        for name in [RECORD, CHANGES, "flights.parquet", "flights.csv"] {
            files.extend(self.store.size(name).map(|bytes| (name.to_owned(), bytes)));
        }
        Ok((files, blake3::hash(&text).to_hex().to_string()))
    }

    /// Pages of flights that the table no longer needs, and figures that are no longer drawn.
    fn remove_other_tables(&self, files: &Sizes) -> Result<(), CampaignError> {
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
    campaign_delay(&rows)
}

fn pretty(record: &impl serde::Serialize) -> Vec<u8> {
    // The record's types have text keys and no way to fail.
    let mut text = serde_json::to_vec_pretty(record).unwrap_or_default();
    text.push(b'\n');
    text
}

fn defect(path: &str, what: String) -> CampaignError {
    CampaignError::Table { path: path.to_owned(), what: format!("a defect in flightlag, please report it: {what}") }
}

/// Whether a file below `flights/` has a name that only we give.
fn is_ours(name: &str) -> bool {
    let mut parts = name.split('/').skip(2);
    match (parts.next(), parts.next(), parts.next()) {
        (Some("index.html" | "record.json" | "track.parquet"), None, _) => true,
        (Some(_), Some(figure), None) => figure.ends_with(".svg") || figure.ends_with(".csv"),
        _ => false,
    }
}

fn verdict(store: &Store, whole: &WholeState, record: &CampaignRecord, nothing_changed: bool) -> Verdict {
    let WholeState { totals, criteria, troubled, .. } = whole.clone();
    let (groups, lines) =
        (record.groups.iter().map(GroupLine::of).collect(), record.flights.iter().map(DelayLine::of_row).collect());
    Verdict { totals, criteria, troubled, groups, lines, page: store.root().join("index.html"), nothing_changed }
}

/// Groups named on the page over all reports; the campaign's own page has all.
const MOST_GROUPS: usize = 3;

fn summary_of(verdict: &Verdict) -> Summary {
    let group = |group: &GroupLine| match group.group.as_str() {
        "" => group.words.clone(),
        name => format!("{name}: {}", group.words),
    };
    let mut answers: Vec<String> = verdict.groups.iter().take(MOST_GROUPS).map(group).collect();
    if verdict.groups.len() > MOST_GROUPS {
        answers.push(format!("and {} more groups", verdict.groups.len() - MOST_GROUPS));
    }
    Summary { size: verdict.totals.flights, answers }
}

/// One event for each flight, then the totals as the last.
fn tell_end(desk: &Desk<'_>, store: &Store, record: &CampaignRecord, verdict: &Verdict) {
    for (row, line) in record.flights.iter().zip(&verdict.lines) {
        desk.tell(Event::Flight {
            outcome: table::outcome_name(&row.outcome),
            reason: table::outcome_reason(&row.outcome).map(str::to_owned),
            page: store.root().join(&row.page),
            line: Box::new(line.clone()),
        });
    }
    let Verdict { totals, criteria, page, nothing_changed, .. } = verdict.clone();
    desk.tell(Event::Done { report: page, nothing_changed, totals, verdicts: criteria.map(|c| c.flights) });
}

/// The line of the table that a record gives.
fn row_of(line: &Line<'_>, record: &FlightRecord) -> FlightRow {
    let replay = record.replay.as_ref();
    let result = |name: &str| replay.and_then(|r| r.compensators.iter().find(|c| c.name == name));
    let error = |name: &str| result(name).and_then(|c: &CompensatorResult| c.error_rms_m);
    let known = |e: Estimate| e.value.is_finite().then_some(e);
    let count = |severity| record.notices.iter().filter(|n| n.severity == severity).count() as u64;
    let position = replay.map(|r| r.pair.position.clone());
    let velocity = replay.map(|r| r.pair.velocity.clone());
    FlightRow {
        flight: line.planned.flight.clone(),
        key: record.key.clone(),
        page: format!("flights/{}/index.html", line.slug),
        outcome: record.outcome.clone(),
        lossy: record.has_loss(),
        minor_loss: record.has_minor_loss(),
        tail_cut_bytes: record.log.as_ref().map_or(0, |log| log.bytes.tail_cut),
        format: record.log.as_ref().map(|l| l.format.clone()).unwrap_or_default(),
        map: record.binding.as_ref().map(|b| b.map.clone()),
        bytes: record.inputs.iter().map(|i| i.bytes).sum(),
        duration_s: replay.map(|r| r.coverage.duration_s),
        position_rate_hz: rate(record, position.as_deref()),
        velocity_rate_hz: rate(record, velocity.as_deref()),
        position,
        velocity,
        speed_median_mps: replay.map(|r| r.speed_mps.median),
        delay_s: replay.map(|r| r.settings.delay.seconds()),
        measured_delay_s: record.lateness.as_ref().and_then(|l| l.position_minus_velocity_s),
        delay_from: replay.and_then(|r| r.choice.as_ref()).map(|choice| choice.used),
        card_delay_s: card_delay(record),
        flown_at: record
            .began()
            .and_then(|t| Some(jiff::Timestamp::from_nanosecond(i128::from(t.0)).ok()?.to_string())),
        sweep: replay.and_then(|r| r.sweep.clone()),
        correction_rms_m: result("exact-async").map(|c| c.raw_minus_this_rms_m).and_then(known),
        raw_error_rms_m: error("raw").and_then(known),
        pade_error_rms_m: error("pade-1-1").and_then(known),
        exact_error_rms_m: error("exact-async").and_then(known),
        valid_share: replay.and_then(valid_share),
        criteria: record.criteria.as_ref().map(row_verdicts),
        cards: record.test.as_ref().map(row_cards).unwrap_or_default(),
        lateness: record.lateness.clone(),
        decision: record.decision.clone(),
        effect: record.effect.clone(),
        duplicate_of: None,
        attention: attention(record),
        warnings: count(Severity::Warning),
        losses: count(Severity::Loss),
    }
}

/// What the sensor card says of the delay of the pair that was replayed, s.
fn card_delay(record: &FlightRecord) -> Option<Estimate> {
    let candidates = &record.replay.as_ref()?.choice.as_ref()?.candidates;
    candidates.iter().find(|c| c.source == DelaySource::Card)?.delay_s.found().copied()
}

fn valid_share(replay: &record::ReplayRecord) -> Option<f64> {
    let coverage = &replay.coverage;
    (coverage.duration_s > 0.0).then(|| coverage.valid_s / coverage.duration_s)
}

/// Warnings that make the numbers of a flight doubtful.
const GRAVE: [&str; 7] = [
    "delay-fallback",
    "velocity-contradicts-position",
    "stamps-coarser-than-delay",
    "card-expired",
    "card-not-yet-valid",
    "card-stamp-kind",
    "card-relative",
];
/// Below this share of time with output, a flight wants a look.
const FEW_VALID: f64 = 0.95;

/// Why somebody should look at this flight.
fn attention(record: &FlightRecord) -> Vec<String> {
    let told = |n: &Notice| if n.place.is_empty() { n.text.clone() } else { format!("{}: {}", n.place, n.text) };
    let harmed = record.effect.as_ref().filter(|e| e.verdict == EffectVerdict::Harmed);
    let alarms = flight_alarms(record.lateness.as_ref(), record.decision.as_ref());
    let mut reasons: Vec<String> = harmed.map(|e| e.words.clone()).into_iter().collect();
    reasons.extend(alarms.into_iter().filter(|a| a.gravity != Gravity::Grey).map(|a| a.text));
    let grave: Vec<String> =
        record.notices.iter().filter(|n| GRAVE.contains(&n.code.as_str())).map(|n| n.text.clone()).collect();
    reasons.extend(grave);
    let findings = record.criteria.iter().flat_map(|c| &c.findings);
    reasons.extend(findings.filter(|f| f.verdict == CriterionVerdict::Fail).map(report::criterion_sentence));
    reasons.extend(record.notices.iter().find(|n| n.code == MINOR_LOSS).map(told));
    let damage = record.log.as_ref().map(|l| l.bytes.damaged).filter(|bytes| *bytes > 0 && record.has_loss());
    if let Some(damage) = damage {
        reasons.push(format!("{damage} bytes of the log are damaged"));
    }
    let losses: Vec<&Notice> = record.notices.iter().filter(|n| n.severity == Severity::Loss).collect();
    reasons.extend(losses.first().map(|first| told(first)));
    if losses.len() > 1 {
        let more = losses.len() - 1;
        let notices = if more == 1 { "notice" } else { "notices" };
        reasons.push(format!("{more} more {notices} of damage on the flight's page"));
    }
    if let Some(replay) = &record.replay {
        match replay.coverage.restarts {
            0 => {}
            1 => reasons.push("a velocity gap: the compensators restarted once".to_owned()),
            restarts => reasons.push(format!("velocity gaps: the compensators restarted {restarts} times")),
        }
        if let Some(share) = valid_share(replay).filter(|share| *share < FEW_VALID) {
            reasons.push(format!("compensated for {:.0} % of the time only", 100.0 * share));
        }
    }
    reasons
}

fn rate(record: &FlightRecord, channel: Option<&str>) -> Option<f64> {
    rate_of(&record.binding.as_ref()?.channels, channel?)
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
        // The sum of nothing is minus zero.
        duration_s: rows.iter().filter_map(|r| r.duration_s).fold(0.0, |sum, s| sum + s),
    }
}
