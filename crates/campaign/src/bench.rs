//! The bench: turns records of a swing into a sensor card and pages.
//!
//! [`bench_run`] reads every log once, detects by the bound channels which log holds the encoder and which the sensor,
//! lets `bench_analysis` measure each record, and combines them into one card. It is fast enough to start from scratch
//! each time, and reuses nothing from an earlier run.

mod bench_logs;
mod bench_study;
mod output;
mod pair;
mod rigs;

use crate::error::{CampaignError, Exit};
use crate::event::Event;
use crate::lock::OutputLock;
use crate::logs::Library;
use crate::manifest::FLIGHTLAG_VERSION;
use crate::plan::{check_out, refuse_other_kind};
use crate::reports::{self, Summary};
use crate::run_context::RunContext;
use crate::s3;
use crate::source;
use crate::store::{Keep, Store};
use crate::task::caught;
use crate::work::Workers;
use bench_analysis::{CardTerms, MagneticEvidence, Rig, card_magnetometer, combine, copies, identity_conflict};
use bench_logs::ReadLog;
use flight::{Code, Notices, Quantity};
use pair::Swing;
use record::{BenchOutcome, BenchRecord, CardChannel, CardMagnetometer, Finding, SensorCard};
use report::{IndexedCard, cards_site};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Raised by hand when reading, binding or measuring a bench record gives different results.
pub const BENCH_ANALYSIS_VERSION: u32 = 24;

/// The request of the user.
#[derive(Debug, Clone, PartialEq)]
pub struct BenchOrder {
    /// Logs, and folders of logs: encoder and sensor in one log, or in two in the same folder.
    pub records: Vec<PathBuf>,
    /// Log of the encoder, if `records` is one log without it.
    pub encoder: Option<PathBuf>,
    /// Rig file for all records; default: the one next to each record.
    pub rig: Option<PathBuf>,
    /// Output folder.
    pub out: PathBuf,
    /// Name of the channel map forced on every log.
    pub forced_map: Option<String>,
    /// Folder with further channel maps.
    pub maps_folder: Option<PathBuf>,
    /// Whether the report of other records may be replaced.
    pub replace: bool,
    /// Additional destination of the card.
    pub card: Option<PathBuf>,
    /// Command that reproduces the report, with names instead of paths, for the pages.
    pub command: String,
}

/// The result of one record.
#[derive(Debug, Clone, PartialEq)]
pub struct BenchRow {
    /// Display name.
    pub name: String,
    /// Its outcome.
    pub outcome: BenchOutcome,
    /// Bytes or messages were lost.
    pub lossy: bool,
}

/// How a bench run ended.
#[derive(Debug, Clone, PartialEq)]
pub struct BenchVerdict {
    /// Every record, in the order of the pages.
    pub rows: Vec<BenchRow>,
    /// The card; `None` if nothing was measured.
    pub card: Option<SensorCard>,
    /// Its file, below the output folder.
    pub card_file: Option<PathBuf>,
    /// Whether records hold a position that is not on the card.
    pub lacks_position: bool,
    /// Notices about the records that the card is based on.
    pub notices: Notices,
    /// The page to open.
    pub page: PathBuf,
}

impl BenchVerdict {
    /// 0 if every record was read completely and measured. 3 if some failed or lost data, if records disagree, if one
    /// of their positions could not be measured, or if a channel of the card is in doubt: data that contradict the rig
    /// file, a slipping encoder, a changing delay.
    #[must_use]
    pub fn exit(&self) -> Exit {
        let whole = |row: &BenchRow| row.outcome == BenchOutcome::Measured && !row.lossy;
        let no_doubt = !self.channels().iter().any(CardChannel::is_in_doubt);
        let records_agree = output::without_mean(&self.notices).next().is_none();
        if self.card.is_some() && no_doubt && records_agree && !self.lacks_position && self.rows.iter().all(whole) {
            Exit::Well
        } else {
            Exit::Incomplete
        }
    }

    /// The channels of the card.
    #[must_use]
    pub fn channels(&self) -> &[CardChannel] {
        self.card.as_ref().map(|card| card.channels.as_slice()).unwrap_or_default()
    }
}

/// A record with its name and the folder of its page.
struct Measured {
    name: String,
    slug: String,
    record: BenchRecord,
    /// Evidence from its magnetometer, if the record was measured.
    magnetic: Option<MagneticEvidence>,
}

/// Measures records of one sensor and writes card and pages. The bytes do not depend on the number of threads.
///
/// # Errors
/// See [`CampaignError`]: a missing log, a wrong rig file, records of different sensors, an output that cannot be
/// written. A record that cannot be read or measured is not an error: it is a row of the table.
pub fn bench_run(order: &BenchOrder, context: &RunContext<'_>) -> Result<BenchVerdict, CampaignError> {
    source::leaving_no_empty_folder(&order.out, || run_here(order, context))
}

/// Writes `index.html` into `folder`: a page over the reports of several sensors, each in its own folder below it.
///
/// # Errors
/// The page cannot be written.
pub fn bench_index(folder: &Path, verdicts: &[BenchVerdict]) -> Result<PathBuf, CampaignError> {
    let path_of = |verdict: &BenchVerdict| {
        let below = verdict.page.strip_prefix(folder).unwrap_or(&verdict.page);
        below.to_string_lossy().into_owned()
    };
    let hrefs: Vec<String> = verdicts.iter().map(path_of).collect();
    let cards = verdicts.iter().zip(&hrefs).map(|(verdict, href)| IndexedCard {
        card: verdict.card.as_ref(),
        records: verdict.rows.len() as u64,
        href,
    });
    let cards: Vec<IndexedCard<'_>> = cards.collect();
    let store = Store::open(folder)?;
    for (name, bytes) in cards_site(&cards).to_write() {
        store.write(name, &bytes, Keep::Renewable)?;
    }
    Ok(store.root().join("index.html"))
}

fn run_here(order: &BenchOrder, context: &RunContext<'_>) -> Result<BenchVerdict, CampaignError> {
    let clock = (jiff::Timestamp::now(), Instant::now());
    let mut paths = order.records.iter().chain(&order.encoder).chain([&order.out]);
    if let Some(path) = paths.find(|path| s3::is_in_bucket(path)) {
        let what = "`flightlag bench` reads and writes local files; buckets are for `flightlag campaign` and \
            `flightlag delay`";
        return Err(CampaignError::Asked(format!("{}: {what}", path.display())));
    }
    for input in order.records.iter().chain(&order.encoder) {
        check_out(input, &order.out)?;
    }
    refuse_other_kind(&order.out, ".flightlag/state.json", "a campaign")?;
    source::check(&order.out, &order.records, order.replace)?;
    let library = Library::open(order.maps_folder.as_deref(), order.forced_map.as_deref())?;
    let sources = bench_logs::find(order, &library)?;
    let shared_rig = order.rig.as_deref().map(Rig::read).transpose()?;

    let store = Store::open(&order.out)?;
    let _lock = OutputLock::take(&store, context)?;
    store.clean();
    source::claim(&store, &order.records)?;
    let logs = bench_logs::read(&sources, &library, order.forced_map.as_deref(), context)?;
    let swings = pair::pair(&logs, order.encoder.is_some());
    let rigs = rigs::of(&swings, &logs, shared_rig)?;
    one_sensor(&swings, &rigs)?;
    let measured = measure(&swings, &rigs, &logs, context)?;
    let valid_days = rigs.iter().filter_map(|rig| rig.card_valid_days).min();
    let verdict = carded(order, measured, valid_days, &store)?;
    output::write_run(&store, context, clock, &verdict)?;
    reports::list(&store, &summary_of(&verdict), context)?;
    context.send(Event::Carded {
        sensor: rigs.first().map(|rig| bench_analysis::sensor_name(&rig.sensor)).unwrap_or_default(),
        card: verdict.card_file.as_ref().and_then(|p| Some(p.file_name()?.to_string_lossy().into_owned())),
        report: verdict.page.clone(),
        records: verdict.rows.len(),
        measured: verdict.rows.iter().filter(|row| row.outcome == BenchOutcome::Measured).count(),
        channels: verdict.channels().to_vec(),
        notices: verdict.notices.clone(),
    });
    Ok(verdict)
}

/// Maximum number of channels on the page over all reports; the card's own page has all.
const MOST_CHANNELS: usize = 4;

fn summary_of(verdict: &BenchVerdict) -> Summary {
    let channel = |channel: &CardChannel| {
        // Rounded here, so that a tiny negative value is not shown as minus zero.
        let tenths = |ms: f64| (10.0 * ms).round() / 10.0 + 0.0;
        let delay_ms = tenths(1e3 * channel.delay_s);
        let expanded_ms = tenths(2e3 * channel.delay_standard_uncertainty_s);
        format!("{} {delay_ms:.1} ± {expanded_ms:.1} ms (k = 2)", channel.name)
    };
    let mut answers: Vec<String> = verdict.channels().iter().take(MOST_CHANNELS).map(channel).collect();
    let more = verdict.channels().len().saturating_sub(MOST_CHANNELS);
    match (answers.len(), more) {
        (0, _) => answers.push("nothing was measured".to_owned()),
        (_, 0) => {}
        (_, more) => answers.push(format!("and {more} more channels")),
    }
    Summary { size: verdict.rows.len() as u64, answers }
}

/// Rejects rig files of two sensors before anything is measured: a card is for one sensor.
fn one_sensor(swings: &[Swing], rigs: &[Rig]) -> Result<(), CampaignError> {
    for (i, (swing, rig)) in swings.iter().zip(rigs).enumerate() {
        let before = swings.iter().zip(rigs).take(i);
        let conflict = before.filter_map(|(s, r)| Some((s, identity_conflict(&r.sensor, &rig.sensor)?))).next();
        if let Some((other, conflict)) = conflict {
            let (other, this) = (&other.name, &swing.name);
            let what = format!("{other} and {this} are of different sensors according to their rig files: {conflict}");
            return Err(CampaignError::Asked(format!("{what}; give the records of one sensor")));
        }
    }
    Ok(())
}

fn measure(
    swings: &[Swing],
    rigs: &[Rig],
    logs: &[ReadLog],
    context: &RunContext<'_>,
) -> Result<Vec<Measured>, CampaignError> {
    let slugs = crate::slug::slugs(swings.iter().map(|s| s.name.as_str()));
    context.send(Event::Measuring { records: swings.len() });
    let work: Vec<(&Swing, &Rig)> = swings.iter().zip(rigs).collect();
    let one = |(): &mut (), (swing, rig): &(&Swing, &Rig)| {
        let (record, magnetic) = caught(|| bench_study::record_of(swing, rig, logs))
            .unwrap_or_else(|panic| (bench_study::defect(swing, rig, logs, &panic), None));
        context.send(Event::Measured {
            record: swing.name.clone(),
            outcome: bench_study::outcome_name(&record.outcome),
            reason: bench_study::outcome_reason(&record.outcome),
            lossy: record.notices.any_loss(),
        });
        let slug = slugs.get(&swing.name).cloned().unwrap_or_default();
        Measured { name: swing.name.clone(), slug, record, magnetic }
    };
    let measured = Workers::start(context.threads)?.each(&work, context.cancel, || (), one);
    context.stopped()?;
    Ok(measured.into_iter().flatten().collect())
}

/// Combines the records, and writes all outputs.
fn carded(
    order: &BenchOrder,
    measured: Vec<Measured>,
    valid_days: Option<u32>,
    store: &Store,
) -> Result<BenchVerdict, CampaignError> {
    let named: Vec<(String, BenchRecord)> = measured.iter().map(|m| (m.name.clone(), m.record.clone())).collect();
    let is_measured = |(_, record): &(String, BenchRecord)| record.outcome == BenchOutcome::Measured;
    let terms = CardTerms { valid_days, flightlag_version: FLIGHTLAG_VERSION };
    let mut notices = Notices::new();
    let card = match named.iter().any(is_measured).then(|| combine(&named, &terms)) {
        Some(Ok(combined)) => {
            notices = combined.notices;
            let copies = copies(&named);
            let of_its_own = measured.iter().enumerate().filter(|(at, _)| !copies.contains_key(at)).map(|(_, m)| m);
            Some(SensorCard { magnetometer: magnetometer(&of_its_own.collect::<Vec<_>>()), ..combined.card })
        }
        Some(Err(why)) => {
            notices.push(Code::LeftOffCard, "", 1, why.to_string());
            None
        }
        None => None,
    };
    let card_file = output::write(store, order, &measured, card.as_ref(), &notices)?;
    let row = |m: &Measured| BenchRow {
        name: m.name.clone(),
        outcome: m.record.outcome.clone(),
        lossy: m.record.notices.any_loss(),
    };
    let page = store.root().join("index.html");
    let lacks_position = lacks_position(&named, card.as_ref());
    Ok(BenchVerdict { rows: measured.iter().map(row).collect(), card, card_file, lacks_position, notices, page })
}

/// Hard and soft iron, unless the angles of a record with swings are in doubt: a wrong azimuth turns the field.
fn magnetometer(measured: &[&Measured]) -> Option<CardMagnetometer> {
    let magnetic: Vec<&MagneticEvidence> = measured.iter().filter_map(|m| m.magnetic.as_ref()).collect();
    let found = card_magnetometer(&magnetic)?;
    let with_swings = measured.iter().filter(|m| m.magnetic.as_ref().is_some_and(|e| !e.swings.is_empty()));
    let doubt = |m: &&Measured| Some(format!("{}: {}", m.name, m.record.doubts_of_angles().first()?));
    Some(match with_swings.filter_map(doubt).next() {
        Some(doubt) => {
            CardMagnetometer { iron: Finding::CannotTell(format!("an angle is in doubt ({doubt})")), ..found }
        }
        None => found,
    })
}

/// Whether records hold a position that is not on the card: positions are the purpose of a bench.
fn lacks_position(records: &[(String, BenchRecord)], card: Option<&SensorCard>) -> bool {
    let held = records.iter().flat_map(|(_, r)| &r.findings).flat_map(|f| &f.channels);
    let mut positions =
        held.filter(|c| matches!(c.quantity, Quantity::PositionGeodetic | Quantity::PositionNed)).map(|c| &c.name);
    positions.any(|name| !card.is_some_and(|card| card.channels.iter().any(|c| c.name == *name)))
}

#[cfg(test)]
mod tests;
