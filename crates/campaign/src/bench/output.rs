//! Outputs of a bench run: card, pages, records, `run.json`.

use super::{BenchOrder, BenchVerdict, Measured};
use crate::cards::CARD_ENDING;
use crate::error::CampaignError;
use crate::manifest::FLIGHTLAG_VERSION;
use crate::plan::BENCH_MARK;
use crate::process::host_name;
use crate::run_context::RunContext;
use crate::slug::slugs;
use crate::store::{Keep, Store};
use crate::task::caught;
use bench_analysis::{card_text, sensor_name};
use flight::{Code, Notice, Notices, Severity};
use record::{BenchOutcome, CARD_VERSION, SensorCard};
use report::{BenchPage, CardPage, CardRecord, Site, WithoutMean, bench_site, card_site};
use serde::Serialize;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Writes card and pages, and removes outputs of an earlier run that this one did not write. Returns the card's path.
pub(super) fn write(
    store: &Store,
    order: &BenchOrder,
    measured: &[Measured],
    card: Option<&SensorCard>,
    notices: &Notices,
) -> Result<Option<PathBuf>, CampaignError> {
    store.write(BENCH_MARK, b"{\"kind\": \"bench\"}\n", Keep::Renewable)?;
    let mut writer = Writer { store, written: BTreeSet::new() };
    for one in measured {
        writer.record(one, &order.command)?;
    }
    let card_file = card.map(|card| writer.card(card, notices, order.card.as_deref())).transpose()?;
    writer.index(measured, card, notices, &order.command)?;
    writer.remove_others()?;
    Ok(card_file)
}

struct Writer<'a> {
    store: &'a Store,
    /// Written names below the output folder.
    written: BTreeSet<String>,
}

impl Writer<'_> {
    fn put(&mut self, name: String, bytes: &[u8], keep: Keep) -> Result<(), CampaignError> {
        self.store.write(&name, bytes, keep)?;
        self.written.insert(name);
        Ok(())
    }

    fn site(&mut self, folder: &str, site: &Site) -> Result<(), CampaignError> {
        let mut files = site.to_write().into_iter();
        files.try_for_each(|(path, bytes)| self.put(format!("{folder}{path}"), &bytes, Keep::Renewable))
    }

    fn record(&mut self, one: &Measured, command: &str) -> Result<(), CampaignError> {
        let folder = format!("records/{}/", one.slug);
        self.put(format!("{folder}record.json"), &one.record.to_json(), Keep::Synced)?;
        let page = BenchPage { name: &one.name, record: &one.record, command, index_href: Some("../../index.html") };
        let site = caught(|| bench_site(&page)).map_err(|what| defect(&folder, &what))?;
        self.site(&folder, &site)
    }

    /// Writes the card, with the notices of its making as comments at its end.
    fn card(&mut self, card: &SensorCard, notices: &Notices, copy: Option<&Path>) -> Result<PathBuf, CampaignError> {
        let text = card_text(card) + &remarks(notices);
        let name = card_name(card);
        self.put(name.clone(), text.as_bytes(), Keep::Synced)?;
        if let Some(path) = copy {
            let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
            let base = path.file_name().and_then(|n| n.to_str());
            let base = base.ok_or_else(|| CampaignError::Asked(format!("{}: not a file name", path.display())))?;
            Store::open(folder)?.write(base, text.as_bytes(), Keep::Synced)?;
            // Keeps this card, because the card of an earlier sensor is removed.
            if folder.canonicalize().ok() == self.store.root().canonicalize().ok() {
                self.written.insert(base.to_owned());
            }
        }
        Ok(self.store.root().join(name))
    }

    fn index(
        &mut self,
        measured: &[Measured],
        card: Option<&SensorCard>,
        notices: &Notices,
        command: &str,
    ) -> Result<(), CampaignError> {
        let hrefs: Vec<String> = measured.iter().map(|m| format!("records/{}/index.html", m.slug)).collect();
        let is_on_card = |m: &Measured| m.record.outcome == BenchOutcome::Measured;
        // Records that the card is based on come first, as on the card.
        let all = || measured.iter().zip(&hrefs);
        let mut records: Vec<CardRecord<'_>> =
            all().filter(|(m, _)| is_on_card(m)).map(|(m, href)| record_row(m, href)).collect();
        records.extend(all().filter(|(m, _)| !is_on_card(m)).map(|(m, href)| record_row(m, href)));
        let empty = empty_card(measured);
        let card_file = card.map(card_name);
        let without_mean: Vec<WithoutMean<'_>> = without_mean(notices)
            .filter_map(|notice| notice.text.split_once(": "))
            .map(|(channel, why)| WithoutMean { channel, why })
            .collect();
        let line_of = |notice: &Notice| match notice.place.as_str() {
            "" => notice.text.clone(),
            place => format!("{place}: {}", notice.text),
        };
        // The card itself states doubts about its channels.
        let of_card = [Code::RigContradicted, Code::FlightDelayChanges];
        let is_remark = |notice: &&Notice| {
            notice.severity != Severity::Info
                && !is_without_mean(notice)
                && !of_card.iter().any(|code| notice.code == *code)
        };
        let remarks: Vec<String> = notices.iter().filter(is_remark).map(line_of).collect();
        let page = CardPage {
            card: card.unwrap_or(&empty),
            card_file: card_file.as_deref(),
            records: &records,
            without_mean: &without_mean,
            remarks: &remarks,
            command,
        };
        let site = caught(|| card_site(&page)).map_err(|what| defect("index.html", &what))?;
        self.site("", &site)
    }

    /// Removes obsolete files of an earlier run; files that flightlag did not write stay.
    fn remove_others(&self) -> Result<(), CampaignError> {
        let mut old = self.store.list("records");
        old.extend(self.store.list("figures"));
        old.extend(self.store.files_of_root().into_iter().filter(|name| name.ends_with(CARD_ENDING)));
        for name in old.iter().filter(|name| !self.written.contains(*name)) {
            match is_ours(name) {
                true => self.store.remove(name)?,
                false => self.store.remove_empty_folder(name),
            }
        }
        Ok(())
    }
}

/// Notices about channels with a delay on which the records disagree.
pub(super) fn without_mean(notices: &Notices) -> impl Iterator<Item = &Notice> {
    notices.iter().filter(|notice| is_without_mean(notice))
}

fn is_without_mean(notice: &Notice) -> bool {
    notice.code == Code::NotComparable && notice.place.is_empty()
}

fn record_row<'a>(measured: &'a Measured, href: &'a str) -> CardRecord<'a> {
    CardRecord { name: &measured.name, record: &measured.record, href: Some(href) }
}

fn is_ours(name: &str) -> bool {
    let parts: Vec<&str> = name.split('/').collect();
    match parts.as_slice() {
        ["records", _, "index.html" | "record.json" | "figures.zip"] | ["figures.zip"] => true,
        ["records", _, "figures", figure] | ["figures", figure] => figure.ends_with(".svg") || figure.ends_with(".csv"),
        [card] => card.ends_with(CARD_ENDING),
        _ => false,
    }
}

/// `xsens-mti-g-00500123.card.toml`.
fn card_name(card: &SensorCard) -> String {
    let name = sensor_name(&card.sensor).to_lowercase();
    let slug = slugs([name.as_str()]).remove(&name).unwrap_or_default();
    format!("{slug}{CARD_ENDING}")
}

/// The card if nothing was measured: its page has no channels and gives the reason for each record.
fn empty_card(measured: &[Measured]) -> SensorCard {
    let first = measured.first().map(|m| &m.record);
    SensorCard {
        card_version: CARD_VERSION,
        sensor: first.map(|r| r.sensor.clone()).unwrap_or_default(),
        rig: first.map(|r| r.rig.title.clone()).unwrap_or_default(),
        method: "Nothing was measured: there is no card.".to_owned(),
        flightlag_version: FLIGHTLAG_VERSION.to_owned(),
        analysis_version: super::BENCH_ANALYSIS_VERSION,
        measured_on: None,
        valid_from: None,
        valid_until: None,
        magnetometer: None,
        channels: vec![],
        records: vec![],
    }
}

fn remarks(notices: &Notices) -> String {
    if notices.is_empty() {
        return String::new();
    }
    let line = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
    let remark = |n: &flight::Notice| {
        let severity = if n.severity == Severity::Info { "" } else { "warning: " };
        let place = if n.place.is_empty() { String::new() } else { format!("{}: ", n.place) };
        line(&format!("# - {severity}{place}{}", n.text)) + "\n"
    };
    format!("\n# Notices when these records were combined:\n{}", notices.iter().map(remark).collect::<String>())
}

fn defect(path: &str, what: &str) -> CampaignError {
    CampaignError::Table { path: path.to_owned(), what: format!("a defect in flightlag, please report it: {what}") }
}

/// The only output with the time of day, the host, and the duration.
#[derive(Serialize)]
struct BenchRun {
    flightlag_version: &'static str,
    started: String,
    seconds: f64,
    host: String,
    threads: usize,
    records: usize,
    measured: usize,
}

pub(super) fn write_run(
    store: &Store,
    context: &RunContext<'_>,
    (started, clock): (jiff::Timestamp, Instant),
    verdict: &BenchVerdict,
) -> Result<(), CampaignError> {
    let run = BenchRun {
        flightlag_version: FLIGHTLAG_VERSION,
        started: started.to_string(),
        seconds: clock.elapsed().as_secs_f64(),
        host: host_name(),
        threads: context.threads,
        records: verdict.rows.len(),
        measured: verdict.rows.iter().filter(|r| r.outcome == BenchOutcome::Measured).count(),
    };
    let mut text = serde_json::to_vec_pretty(&run).unwrap_or_default();
    text.push(b'\n');
    Ok(store.write("run.json", &text, Keep::Renewable).map(drop)?)
}
