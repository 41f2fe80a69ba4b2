//! One night: every campaign, the history, what changed, trends, and whether settings had the predicted effect.

use crate::brief::{Brief, latest_briefs};
use crate::change_points::Looks;
use crate::collect::{Collecting, collect, read_campaign, texts_of};
use crate::compare::{FAILED, Texts, compare};
use crate::config::NightlyConfig;
use crate::dataset::{History, Latest, Run};
use crate::error::HistoryError;
use crate::proof::proofs;
use crate::row::{Dimension, Row};
use crate::summary;
use crate::trend::{Trend, new_changes, trend};
use campaign::{CampaignError, EMPTY_FOLDER, Event, Exit, Order, RunContext, STILL_WRITTEN, Verdict};
use record::{
    CampaignRecord, GroupLateness, IgnoredInput, LeftLog, NamedFlight, NightCampaign, NightGroup, NightRecord,
    ProofVerdict, RECORD_VERSION, TrendRecord,
};
use std::collections::BTreeSet;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Folder of the pages and summaries of all nights, below the folder of the reports.
const NIGHTS: &str = "nights";
/// Page of the latest night, in the folder of the reports.
const MORNING: &str = "morning.html";
/// Held while a night is running.
const LOCK: &str = ".nightly-lock";

/// The result of a night.
#[derive(Debug, Clone, PartialEq)]
pub struct Night {
    /// Everything it found.
    pub record: NightRecord,
    /// Page to open.
    pub page: PathBuf,
    /// Folder with the page, night.json and the summaries of this night.
    pub folder: PathBuf,
    /// The new file of the history.
    pub history: PathBuf,
    /// How the night ended.
    pub exit: Exit,
}

/// Runs a night.
///
/// # Errors
/// The user stopped, another night is running on the same folder, or an output cannot be written. A campaign that fails
/// is a row of the night's page.
pub fn nightly(config: &NightlyConfig, run_context: &RunContext<'_>) -> Result<Night, HistoryError> {
    let clock = (jiff::Timestamp::now(), Instant::now());
    std::fs::create_dir_all(&config.out).map_err(|e| HistoryError::io(&config.out, "make this folder", e))?;
    let _lock = lock(&config.out)?;
    let history = History::new(&config.history);
    let run = unused_run(config, clock.0);
    let names: BTreeSet<&str> = config.campaigns.iter().map(|(name, _)| name.as_str()).collect();
    let known = history.briefs(&|campaign| names.contains(campaign))?;
    let since = if known.rows.is_empty() { None } else { history.last_run()? };
    let mut made = Made { since, problems: known.unreadable, ..Made::default() };
    for (name, order) in &config.campaigns {
        run_context.events.event(&Event::Campaign { name: name.clone(), flights: order.flights.clone() });
        made.campaign(name, order, &Context { run: &run, config, history: &history, run_context })?;
    }
    let fresh = made.fresh();
    let record = record(config, &run, clock, known.rows, &fresh, made);
    let exit = exit_of(record.exit);
    let folder = config.out.join(NIGHTS).join(&run.id);
    write(&record, config, &folder)?;
    let history = history.append(&run, &fresh)?;
    let night = Night { page: config.out.join(MORNING), record, folder, history, exit };
    run_context.events.event(&night.event());
    Ok(night)
}

impl Night {
    /// What went wrong: failed campaigns, then problems of the others.
    pub fn errors(&self) -> impl Iterator<Item = String> {
        let failed = self.record.campaigns.iter();
        let failed = failed.filter_map(|campaign| Some(format!("{}: {}", campaign.name, campaign.error.as_ref()?)));
        failed.chain(self.record.problems.iter().cloned())
    }

    fn event(&self) -> Event {
        Event::Night {
            run_id: self.record.run_id.clone(),
            exit: self.record.exit,
            page: self.page.clone(),
            folder: self.folder.clone(),
            history: self.history.clone(),
            summary: self.record.summary.clone(),
            errors: self.errors().collect(),
        }
    }
}

/// A run whose name is unused by nights and history.
fn unused_run(config: &NightlyConfig, start: jiff::Timestamp) -> Run {
    let nights = config.out.join(NIGHTS);
    let is_used = |id: &str| nights.join(id).exists() || config.history.join(format!("{id}.parquet")).exists();
    Run::unused(start, &is_used)
}

/// Whether the history already has the same result.
fn is_recorded(row: &Row, before: &Latest) -> bool {
    before.get(&(row.campaign.clone(), row.flight.clone())).is_some_and(|known| known.says_the_same(row))
}

/// Locks the folder: two nights at once would write the same pages.
fn lock(out: &Path) -> Result<File, HistoryError> {
    let path = out.join(LOCK);
    let file = File::create(&path).map_err(|e| HistoryError::io(&path, "make", e))?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(std::fs::TryLockError::WouldBlock) => {
            let what = format!("{}: another nightly run is using this folder", out.display());
            Err(CampaignError::TryAgain(what).into())
        }
        // Some network file systems have no locks: the campaigns have locks of their own.
        Err(std::fs::TryLockError::Error(_)) => Ok(file),
    }
}

/// What a campaign needs from its night.
struct Context<'a> {
    run: &'a Run,
    config: &'a NightlyConfig,
    history: &'a History,
    run_context: &'a RunContext<'a>,
}

/// Results so far.
#[derive(Default)]
struct Made {
    /// The last run before.
    since: Option<String>,
    campaigns: Vec<NightCampaign>,
    rows: Vec<Row>,
    /// Texts of the alarms and failures of these rows.
    texts: Texts,
    /// Earlier rows of the same flights in the history.
    before: Latest,
    gone: Vec<NamedFlight>,
    groups: Vec<NightGroup>,
    left: Vec<LeftLog>,
    problems: Vec<String>,
}

impl Made {
    /// Rows that the history does not have yet.
    fn fresh(&self) -> Vec<Row> {
        self.rows.iter().filter(|row| !is_recorded(row, &self.before)).cloned().collect()
    }

    /// Runs one campaign and records its results. Only a stop by the user ends the night.
    fn campaign(&mut self, name: &str, order: &Order, context: &Context<'_>) -> Result<(), HistoryError> {
        let earlier = read_campaign(&order.out).ok();
        let is_there = campaign::is_in_bucket(&order.flights) || order.flights.is_dir();
        let ran = match is_there {
            true => campaign::run(order, context.run_context),
            // A disk that is not mounted: the other campaigns continue.
            false => Err(CampaignError::TryAgain(format!("{}: the folder does not exist", order.flights.display()))),
        };
        let ended = match ran {
            Err(CampaignError::Cancelled) => return Err(CampaignError::Cancelled.into()),
            Ok(verdict) => self.collected(name, order, context, earlier.as_ref(), &verdict).map(|()| verdict),
            // A folder that used to have flights is more often an unmounted disk than a folder that somebody emptied.
            Err(CampaignError::NoFlights { path, what }) if earlier.is_some() && what == EMPTY_FOLDER => {
                let what = format!("{}: no flight found, but the report has some: {what}", path.display());
                Err(CampaignError::TryAgain(what).into())
            }
            Err(error) => {
                if let CampaignError::AllStillWritten(logs) = &error {
                    let left = |path: &String| LeftLog {
                        campaign: name.to_owned(),
                        path: path.clone(),
                        reason: STILL_WRITTEN.to_owned(),
                    };
                    self.left.extend(logs.iter().map(left));
                }
                Err(error.into())
            }
        };
        self.campaigns.push(row_of(name, order, ended));
        Ok(())
    }

    fn collected(
        &mut self,
        name: &str,
        order: &Order,
        context: &Context<'_>,
        earlier: Option<&CampaignRecord>,
        verdict: &Verdict,
    ) -> Result<(), HistoryError> {
        let record = read_campaign(&order.out)?;
        let fleet = &context.config.fleet;
        let now: BTreeSet<&str> = record.flights.iter().map(|row| row.flight.as_str()).collect();
        let left = left_of(name, &record);
        let before = earlier.iter().flat_map(|record| &record.flights).map(|row| row.flight.as_str());
        let unusable = self.missing(name, before.filter(|flight| !now.contains(flight)), &record, &left);
        let names = now.iter().copied().chain(unusable.iter().map(|input| input.path.as_str())).collect();
        let known = context.history.latest(name, &names)?;
        let with = Collecting { run: context.run, campaign: name, fleet, known: &known };
        self.rows.extend(collect(&record, &order.out, &with)?);
        self.rows.extend(unusable.iter().map(|input| unusable_row(input, &record, &with)));
        self.texts.extend(texts_of(&record, name));
        self.before.extend(known);
        self.groups.extend(divided_groups(name, &record, earlier));
        self.left.extend(left);
        if verdict.troubled > 0 {
            self.problems
                .push(format!("{name}: {} flights have no final result: the next night tries again", verdict.troubled));
        }
        Ok(())
    }

    /// Records which flights of the previous report are gone. Returns those whose files still exist but are no longer
    /// flights, except those just `left` for the next night.
    fn missing<'a>(
        &mut self,
        campaign: &str,
        flights: impl Iterator<Item = &'a str>,
        record: &'a CampaignRecord,
        left: &[LeftLog],
    ) -> Vec<&'a IgnoredInput> {
        let mut unusable = vec![];
        for flight in flights {
            match record.ignored.iter().find(|input| input.path == flight) {
                Some(_) if left.iter().any(|log| log.path == flight) => {}
                Some(input) => unusable.push(input),
                None => {
                    let (campaign, flight) = (campaign.to_owned(), flight.to_owned());
                    self.gone.push(NamedFlight { campaign, flight, page: None });
                }
            }
        }
        unusable
    }
}

/// The row of a log that used to be a flight and is now unusable.
fn unusable_row(input: &IgnoredInput, record: &CampaignRecord, with: &Collecting<'_>) -> Row {
    Row {
        run_id: with.run.id.clone(),
        run_ns: with.run.start_ns,
        campaign: with.campaign.to_owned(),
        flight: input.path.clone(),
        outcome: FAILED.to_owned(),
        reason: Some(format!("no longer a flight: {}", input.reason)),
        data: FAILED.to_owned(),
        settings_hash: record.pipeline.blake3.clone(),
        analysis_version: i64::from(record.analysis_version),
        build: record.flightlag_version.clone(),
        ..Row::default()
    }
}

/// Groups whose flights do not share one delay, or of which some differ from the others. A split group is reported as a
/// whole, not by its parts. A group that was divided before is new again if a new flight is unlike all earlier ones.
fn divided_groups(name: &str, record: &CampaignRecord, earlier: Option<&CampaignRecord>) -> Vec<NightGroup> {
    let before: Vec<&GroupLateness> = earlier.iter().flat_map(|record| &record.groups).collect();
    let of = |group: &GroupLateness| {
        let same = |other: &&&GroupLateness| other.group.key == group.group.key && other.against == group.against;
        let was_divided = before.iter().filter(same).any(|other| other.is_apart());
        let known: Vec<&String> = before.iter().filter(same).flat_map(|other| &other.outliers).collect();
        let members: BTreeSet<&String> = before.iter().filter(same).flat_map(|other| &other.members).collect();
        let (is_new, words) = match (group.is_apart(), group.lone_outliers()) {
            (true, _) => {
                let words = group.split.clone().unwrap_or_else(|| group.words.clone());
                match unlike_all_earlier(record, group, &members) {
                    Some(flight) if was_divided => (true, format!("{flight}; {words}")),
                    _ => (!was_divided, words),
                }
            }
            (false, []) => return None,
            (false, lone) => {
                let is_old = |flight: &String| known.contains(&flight) || (was_divided && members.contains(flight));
                (!lone.iter().all(is_old), group.words.clone())
            }
        };
        Some(NightGroup { campaign: name.to_owned(), is_new, group: group.group.name.clone(), words })
    };
    record.groups.iter().filter_map(of).collect()
}

/// Distance at which a new flight is unlike the earlier ones of a group without a mean, in standard uncertainties.
const UNLIKE: f64 = 3.0;

/// The new flights of a group that are clearly earlier or later than every earlier flight: a group without a mean has
/// no outliers.
fn unlike_all_earlier(record: &CampaignRecord, group: &GroupLateness, earlier: &BTreeSet<&String>) -> Option<String> {
    let latenesses = |is_earlier: bool| {
        let rows = record
            .flights
            .iter()
            .filter(move |row| group.members.contains(&row.flight) && earlier.contains(&row.flight) == is_earlier);
        rows.filter_map(|row| {
            let of_datum = row.lateness.as_ref().filter(|lateness| lateness.against == group.against);
            let lateness = of_datum?.lateness_s()?;
            Some((row.flight.as_str(), lateness.value, lateness.standard_uncertainty?))
        })
    };
    let is_unlike = |&(_, value, u): &(&str, f64, f64)| {
        let apart = |(_, other, other_u): (&str, f64, f64)| (value - other) / u.hypot(other_u);
        let sides: Vec<f64> = latenesses(true).map(apart).collect();
        !sides.is_empty() && (sides.iter().all(|z| *z > UNLIKE) || sides.iter().all(|z| *z < -UNLIKE))
    };
    let unlike = latenesses(false).filter(is_unlike);
    let shown: Vec<String> = unlike.map(|(flight, value, _)| format!("{flight} ({:.0} ms)", 1e3 * value)).collect();
    let verb = if shown.len() == 1 { "is new and differs" } else { "are new and differ" };
    (!shown.is_empty()).then(|| format!("{} {verb} from every earlier flight", shown.join(", ")))
}

/// Logs left for the next night.
fn left_of(name: &str, record: &CampaignRecord) -> Vec<LeftLog> {
    let unsettled = record.ignored.iter().filter(|input| input.reason.starts_with(STILL_WRITTEN));
    let left = unsettled.map(|input| (input.path.clone(), input.reason.clone()));
    left.map(|(path, reason)| LeftLog { campaign: name.to_owned(), path, reason }).collect()
}

/// The campaign's row of the night.
fn row_of(name: &str, order: &Order, ended: Result<Verdict, HistoryError>) -> NightCampaign {
    let row = NightCampaign {
        name: name.to_owned(),
        flights: order.flights.display().to_string(),
        report: if order.out.join("index.html").is_file() { format!("{name}/index.html") } else { String::new() },
        totals: None,
        criteria_failed: 0,
        exit: Exit::Well as u8,
        error: None,
        nothing_changed: false,
    };
    match ended {
        Err(error) => NightCampaign { exit: error.exit() as u8, error: Some(error.to_string()), ..row },
        Ok(verdict) => NightCampaign {
            exit: verdict.exit() as u8,
            criteria_failed: verdict.criteria.as_ref().map_or(0, |c| c.flights.fail),
            nothing_changed: verdict.nothing_changed,
            totals: Some(verdict.totals),
            ..row
        },
    }
}

fn record(
    config: &NightlyConfig,
    run: &Run,
    (started, clock): (jiff::Timestamp, Instant),
    known: Vec<Brief>,
    fresh: &[Row],
    made: Made,
) -> NightRecord {
    let page = |campaign: &str, page: &str| Some(format!("{campaign}/{page}")).filter(|_| !page.is_empty());
    let mut changes = compare(&made.before, &made.rows, &made.texts, &page);
    changes.gone = made.gone;
    let charts = |rows: &[Brief]| trend(&latest_briefs(rows), &Dimension::ALL, Looks::Every, &page);
    let earlier = charts(&known);
    let mut all = known;
    all.extend(fresh.iter().map(Brief::from));
    let now = charts(&all);
    let mut record = NightRecord {
        record_version: RECORD_VERSION,
        title: config.title.clone(),
        run_id: run.id.clone(),
        started: started.to_string(),
        seconds: clock.elapsed().as_secs_f64(),
        flightlag_version: env!("CARGO_PKG_VERSION").to_owned(),
        before: made.since,
        exit: Exit::Well as u8,
        summary: vec![],
        campaigns: made.campaigns,
        changes,
        left: made.left,
        groups: made.groups,
        new_trend_changes: new_changes(&earlier, &now),
        withdrawn_trend_changes: new_changes(&now, &earlier),
        trend: with_changes(now),
        proofs: proofs(&all, &page),
        problems: made.problems,
    };
    record.exit = code(&record);
    record.summary = summary::lines(&record);
    record
}

/// Only the charts with a change: `flightlag trend` shows all.
fn with_changes(trend: Trend) -> TrendRecord {
    let mut record = trend.record;
    let all = record.charts.len();
    record.charts.retain(|chart| !chart.changes.is_empty());
    record.without_change = (all - record.charts.len()) as u64;
    record
}

/// The most severe exit code: first what no retry fixes, then what a retry may fix, then findings.
fn code(record: &NightRecord) -> u8 {
    let is_failed = record.proofs.iter().any(|proof| proof.verdict == ProofVerdict::Fail);
    let proof = if is_failed { Exit::CriterionFailed } else { Exit::Well };
    let is_apart = record.groups.iter().any(|group| group.is_new);
    let trends = [&record.new_trend_changes, &record.withdrawn_trend_changes];
    let changed = trends.iter().any(|all| !all.is_empty()) || !record.changes.failing.is_empty() || is_apart;
    let incomplete = !record.problems.is_empty() || changed;
    let own = if incomplete { Exit::Incomplete } else { Exit::Well };
    let codes = record.campaigns.iter().map(|c| c.exit).chain([proof as u8, own as u8]);
    codes.max_by_key(|code| GRAVEST_LAST.iter().position(|known| *known as u8 == *code)).unwrap_or_default()
}

const GRAVEST_LAST: [Exit; 6] =
    [Exit::Well, Exit::Incomplete, Exit::CriterionFailed, Exit::TryAgain, Exit::Failed, Exit::Wrong];

fn exit_of(code: u8) -> Exit {
    GRAVEST_LAST.into_iter().find(|known| *known as u8 == code).unwrap_or(Exit::Failed)
}

/// Writes the pages and summaries: those of this night into its folder, and the page of the latest night above it.
fn write(record: &NightRecord, config: &NightlyConfig, folder: &Path) -> Result<(), HistoryError> {
    let site = report::night_site(record, "../../");
    for (path, bytes) in site.to_write() {
        write_file(&folder.join(path), &bytes)?;
    }
    let text = summary::text(record);
    let files = [
        ("night.json", serde_json::to_string_pretty(record).unwrap_or_default() + "\n"),
        ("summary.txt", text.clone()),
        ("summary.json", summary::json(record)),
        ("summary.md", summary::markdown(record)),
        ("summary.xml", summary::junit(record)),
    ];
    for (name, text) in &files {
        write_file(&folder.join(name), text.as_bytes())?;
    }
    let latest = report::night_site(record, "");
    for (path, bytes) in latest.to_write() {
        let name = if path == "index.html" { MORNING } else { path };
        write_file(&config.out.join(name), &bytes)?;
    }
    for (name, text) in files.iter().filter(|(name, _)| name.starts_with("summary.")) {
        write_file(&config.out.join(name), text.as_bytes())?;
    }
    Ok(())
}

/// Writes a file atomically: to a temporary name in its folder, then renamed.
///
/// # Errors
/// The file cannot be written.
pub fn write_file(path: &Path, bytes: &[u8]) -> Result<(), HistoryError> {
    let folder = path.parent().unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder).map_err(|e| HistoryError::io(folder, "make this folder", e))?;
    let failed = |e| HistoryError::io(path, "write", e);
    let mut file = tempfile::Builder::new().prefix(".").suffix(".flightlag-tmp").tempfile_in(folder).map_err(failed)?;
    file.write_all(bytes).and_then(|()| crate::dataset::readable_by_all(file.as_file())).map_err(failed)?;
    file.persist(path).map_err(|e| failed(e.error))?;
    Ok(())
}
