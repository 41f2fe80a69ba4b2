//! `flightlag campaign`: a whole campaign on this machine, or one step of it on a cluster.

use crate::aircraft;
use crate::arguments::{AircraftArguments, CampaignArguments, OrderArguments, RunArguments, Step, clock_rule_name};
use crate::delay_command;
use crate::failure::{End, Failure};
use crate::listen::listener;
use crate::show::{count, visible};
use crate::stop::Stop;
use campaign::{
    CampaignError, ClockRule, Criteria, EventSink, Exit, GroupLine, LogCache, Manifest, Order, Pipeline, RunContext,
    Status, TaskReport, Verdict,
};
use record::{CampaignCriteria, CriterionSummary, VerdictTally};
use std::io::Write;
use std::path::{Path, PathBuf};

pub(crate) fn run(arguments: CampaignArguments, stop: &Stop) -> Result<End, Failure> {
    match (arguments.step, arguments.order) {
        (Some(step), _) => take(step, stop),
        (None, Some(order)) => whole(&order, &arguments.aircraft, &arguments.common, stop),
        (None, None) => {
            let usage = "the folder of flights is missing: flightlag campaign FLIGHTS [--out DIR] (more: flightlag \
                campaign --help)";
            Err(Failure::new(Exit::Wrong, usage))
        }
    }
}

fn whole(
    order: &OrderArguments,
    files: &AircraftArguments,
    arguments: &RunArguments,
    stop: &Stop,
) -> Result<End, Failure> {
    let verdict = run_order(&order_of(order)?, arguments, stop)?;
    aircraft::write(files, &verdict.groups)?;
    Ok(verdict.exit().into())
}

/// Runs a campaign and reports how it went.
pub(crate) fn run_order(order: &Order, arguments: &RunArguments, stop: &Stop) -> Result<Verdict, Failure> {
    let events = listener(arguments);
    let verdict = campaign::run(order, &run_context(arguments, stop, events.as_ref()))?;
    print_verdict(&verdict, &order.out, arguments)?;
    Ok(verdict)
}

fn take(step: Step, stop: &Stop) -> Result<End, Failure> {
    match step {
        Step::Plan { order, manifest, max_shards, common } => {
            plan(&order, manifest.as_deref(), max_shards, &common, stop)
        }
        Step::Task { manifest, shard, common } => task(&manifest, shard, &common, stop),
        Step::Reduce { manifest, aircraft, common } => reduce(&manifest, &aircraft, &common, stop),
        Step::Status { manifest, json } => status(&manifest, json),
    }
}

fn plan(
    order: &OrderArguments,
    path: Option<&Path>,
    max_shards: u32,
    arguments: &RunArguments,
    stop: &Stop,
) -> Result<End, Failure> {
    let events = listener(arguments);
    let order = order_of(order)?;
    let manifest = campaign::plan_shards(&order, &run_context(arguments, stop, events.as_ref()), max_shards)?;
    let kept = manifest.keep()?;
    path.map_or(Ok(()), |path| manifest.write(path))?;
    let path = path.unwrap_or(&kept);
    let (flights, stale, shards) = (manifest.flight_count(), manifest.stale_count(), manifest.shards());
    let stage = manifest.stage().map_or("done".to_owned(), |stage| stage.to_string());
    let line = format!("flights={flights} stage={stage} stale={stale} shards={shards} manifest={}", path.display());
    // Scripts read this line, so it is printed even with --quiet.
    match arguments.quiet && !arguments.json {
        true => writeln!(std::io::stdout(), "{}", visible(&line))?,
        false => say(arguments, &line)?,
    }
    Ok(Exit::Well.into())
}

fn task(path: &Path, shard: u32, arguments: &RunArguments, stop: &Stop) -> Result<End, Failure> {
    let events = listener(arguments);
    let report = campaign::task(&Manifest::read(path)?, shard, &run_context(arguments, stop, events.as_ref()))?;
    let TaskReport { made, found, troubled, lasting } = &report;
    say(arguments, &format!("made={made} found={found} troubled={}", troubled.len() + lasting.len()))?;
    Ok(report.exit().into())
}

fn reduce(path: &Path, files: &AircraftArguments, arguments: &RunArguments, stop: &Stop) -> Result<End, Failure> {
    let events = listener(arguments);
    let manifest = Manifest::read(path)?;
    let verdict = campaign::reduce(&manifest, &run_context(arguments, stop, events.as_ref()))?;
    print_verdict(&verdict, manifest.out(), arguments)?;
    if let Some(next) = next_step(&verdict, &manifest) {
        say(arguments, &next)?;
    }
    aircraft::write(files, &verdict.groups)?;
    Ok(verdict.exit().into())
}

/// What to do about flights without a result; `None` if all have a result.
fn next_step(verdict: &Verdict, manifest: &Manifest) -> Option<String> {
    let pending = verdict.totals.pending;
    let is_measured = || {
        let status = campaign::status(manifest).ok();
        manifest.stage() == Some(campaign::Stage::Measure) && status.is_some_and(|s| s.done == s.flights)
    };
    let flights = count(pending, "flight");
    (pending > 0).then(|| match is_measured() {
        true => format!(
            "{flights} pending: all flights are measured, but none is replayed yet. Run `flightlag campaign plan` \
             again, then its tasks, then reduce"
        ),
        false => format!("{flights} pending: run the missing tasks of the manifest, then plan again"),
    })
}

fn status(path: &Path, json: bool) -> Result<End, Failure> {
    let status = campaign::status(&Manifest::read(path)?)?;
    let mut out = std::io::stdout().lock();
    match json {
        true => writeln!(out, "{}", serde_json::to_string(&status).unwrap_or_default())?,
        false => write!(out, "{}", status_text(&status))?,
    }
    Ok(status.exit().into())
}

fn status_text(status: &Status) -> String {
    let what = match status.stage {
        Some(campaign::Stage::Measure) => "are measured",
        _ => "have a result",
    };
    let mut text = format!("{} of {} flights {what}\n", status.done, status.flights);
    for trouble in &status.troubled {
        text += &format!("  in trouble: {}: {}\n", visible(&trouble.flight), visible(&trouble.reason));
    }
    for flight in &status.missing {
        text += &format!("  missing: {}\n", visible(flight));
    }
    text
}

fn print_verdict(verdict: &Verdict, out: &Path, arguments: &RunArguments) -> Result<(), Failure> {
    let totals = &verdict.totals;
    let groups: Vec<GroupLine> = verdict.groups.clone();
    for line in delay_command::short_text(&verdict.lines, &groups).lines() {
        say(arguments, line)?;
    }
    let listed = |of: &[(u64, &str)]| {
        of.iter().filter(|(n, _)| *n > 0).map(|(n, what)| format!("{n} {what}")).collect::<Vec<String>>().join(", ")
    };
    let mut text = format!("{} helped", totals.helped);
    let others = listed(&[
        (totals.harmed, "HARMED"),
        (totals.compensated.saturating_sub(totals.helped + totals.harmed), "with no clear effect"),
        (totals.uncompensated, "measured with nothing removed"),
        (totals.not_measurable, "not measurable"),
        (totals.pending, "pending"),
        (totals.failed, "failed"),
    ]);
    // Each flight is counted once above, and may also be one of these.
    let among = listed(&[
        (totals.varying, "with a delay that changes"),
        (totals.lossy, "with damaged logs"),
        (verdict.troubled.saturating_sub(totals.pending), "to be repeated"),
    ]);
    for (joint, part) in [(", ", others), ("; among them ", among)] {
        if !part.is_empty() {
            text += joint;
            text += &part;
        }
    }
    let nothing = if verdict.nothing_changed { "nothing changed: " } else { "" };
    say(arguments, &format!("{nothing}{}: {text}", count(totals.flights, "flight")))?;
    if let Some(criteria) = &verdict.criteria {
        print_criteria(criteria, arguments)?;
    }
    say(arguments, &format!("open {}", out.join("index.html").display()))
}

/// Maximum number of failing flights named in a line; the page lists all.
const MOST_NAMES: usize = 3;

/// A line for all flights, and one for each criterion that some flight fails or that no flight answers.
fn print_criteria(criteria: &CampaignCriteria, arguments: &RunArguments) -> Result<(), Failure> {
    say(arguments, &format!("criteria, flights by worst verdict: {}", tally(&criteria.flights)))?;
    for failed in criteria.each.iter().filter(|each| each.tally.fail > 0) {
        let names: Vec<&str> = failed.failed.iter().take(MOST_NAMES).map(String::as_str).collect();
        let more = match failed.failed.len().saturating_sub(MOST_NAMES) {
            0 => String::new(),
            n => format!(" and {n} more"),
        };
        let CriterionSummary { id, metric, limit, .. } = failed;
        say(arguments, &format!("  FAIL {id} ({metric} {limit}): {}{more}", names.join(", ")))?;
    }
    for CriterionSummary { id, metric, limit, never_evaluated, .. } in &criteria.each {
        if let Some(reason) = never_evaluated {
            say(arguments, &format!("  NOT EVALUATED for any flight: {id} ({metric} {limit}): {reason}"))?;
        }
    }
    Ok(())
}

/// `2 FAIL, 9 PASS`.
fn tally(tally: &VerdictTally) -> String {
    let VerdictTally { fail, inconclusive, not_evaluated, pass, not_applicable } = *tally;
    let all = [
        (fail, "FAIL"),
        (inconclusive, "INCONCLUSIVE"),
        (not_evaluated, "NOT EVALUATED"),
        (pass, "PASS"),
        (not_applicable, "NOT APPLICABLE"),
    ];
    all.iter().filter(|(n, _)| *n > 0).map(|(n, word)| format!("{n} {word}")).collect::<Vec<_>>().join(", ")
}

/// Reports to a person on standard output; machines have events.
pub(crate) fn say(arguments: &RunArguments, text: &str) -> Result<(), Failure> {
    if arguments.json || arguments.quiet {
        return Ok(());
    }
    match writeln!(std::io::stdout(), "{}", visible(text)) {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => Err(e.into()),
        _ => Ok(()),
    }
}

pub(crate) fn run_context<'a>(arguments: &RunArguments, stop: &'a Stop, events: &'a dyn EventSink) -> RunContext<'a> {
    let usual = LogCache::default();
    let folder = arguments.cache.cache.clone();
    campaign::keep_logs_in(LogCache { folder, most_bytes: arguments.cache.cache_size.unwrap_or(usual.most_bytes) });
    RunContext { threads: threads(arguments), cancel: stop.flag(), events }
}

/// As requested, otherwise as allocated by the cluster, otherwise every core.
fn threads(arguments: &RunArguments) -> usize {
    let of_cluster =
        || std::env::var("SLURM_CPUS_PER_TASK").ok().and_then(|n| n.parse::<usize>().ok()).filter(|n| *n > 0);
    let cores = || std::thread::available_parallelism().map_or(1, usize::from);
    arguments.threads.map(usize::from).or_else(of_cluster).unwrap_or_else(cores)
}

/// The pipeline from a file, otherwise the shipped one.
pub(crate) fn pipeline_of(
    file: Option<&Path>,
    map: Option<String>,
    maps: Option<PathBuf>,
) -> Result<Pipeline, Failure> {
    let pipeline = match file {
        Some(path) => Pipeline::read(path).map_err(campaign::CampaignError::from)?,
        None => Pipeline::shipped_default().map_err(campaign::CampaignError::from)?,
    };
    Ok(pipeline.with_forced_map(map).with_maps_folder(maps))
}

/// The pipeline with the reference file given in the arguments. A path that exists relative to here is used as such.
pub(crate) fn with_reference(
    pipeline: Pipeline,
    file: Option<&str>,
    clock: Option<ClockRule>,
) -> Result<Pipeline, CampaignError> {
    let here = |file: &str| std::path::absolute(file).ok().filter(|path| path.is_file());
    let file = file.map(|file| here(file).map_or_else(|| file.to_owned(), |path| path.display().to_string()));
    pipeline.with_reference(file, clock)
}

fn order_of(arguments: &OrderArguments) -> Result<Order, Failure> {
    let pipeline = pipeline_of(arguments.pipeline.as_deref(), arguments.map.clone(), arguments.maps.clone())?;
    let pipeline = with_reference(pipeline, arguments.reference.as_deref(), arguments.reference_clock)?;
    let criteria = arguments.criteria.as_deref().map(Criteria::read).transpose();
    let pipeline = pipeline.with_criteria(criteria.map_err(campaign::CampaignError::from)?);
    Ok(Order {
        flights: arguments.flights.clone(),
        out: out_of(arguments),
        pipeline,
        verify: arguments.verify,
        replace: arguments.replace,
        command: command_of(arguments),
        settle: None,
    })
}

/// The report folder; by default `reports/NAME` in the working folder.
fn out_of(arguments: &OrderArguments) -> PathBuf {
    let usual = || {
        let flights = arguments.flights.canonicalize().unwrap_or_else(|_| arguments.flights.clone());
        Path::new("reports").join(flights.file_name().unwrap_or("campaign".as_ref()))
    };
    arguments.out.clone().unwrap_or_else(usual)
}

/// The command that reproduces the report, with names instead of paths: the same on every machine.
fn command_of(arguments: &OrderArguments) -> String {
    let mut command = format!("flightlag campaign {}", name_for_shell(&arguments.flights));
    let files = [("--pipeline", &arguments.pipeline), ("--criteria", &arguments.criteria), ("--maps", &arguments.maps)];
    for (option, path) in files {
        if let Some(path) = path {
            command += &format!(" {option} {}", name_for_shell(path));
        }
    }
    if let Some(map) = &arguments.map {
        command += &format!(" --map {}", quoted(map));
    }
    if let Some(file) = &arguments.reference {
        let file = Path::new(file);
        let name = if file.is_file() { name_for_shell(file) } else { quoted(&file.to_string_lossy()) };
        command += &format!(" --reference {name}");
    }
    if let Some(rule) = arguments.reference_clock {
        command += &format!(" --reference-clock {}", clock_rule_name(rule));
    }
    command + " --out REPORT"
}

/// The name of a path without its folder, quoted for a shell.
pub(crate) fn name_for_shell(path: &Path) -> String {
    let whole = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    quoted(&whole.file_name().unwrap_or_default().to_string_lossy())
}

/// A word quoted for a shell.
pub(crate) fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./:=@%+,".contains(c);
    match !word.is_empty() && word.chars().all(plain) && !word.starts_with('-') {
        true => word.to_owned(),
        false => format!("'{}'", word.replace('\'', "'\\''")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quoted_word_survives_the_shell() {
        assert_eq!(quoted("day-1"), "day-1");
        assert_eq!(quoted("it's $HOME"), "'it'\\''s $HOME'");
        assert_eq!(quoted("-rf"), "'-rf'");
        assert_eq!(quoted(""), "''");
    }
}
