//! What can be typed, and its help.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args, Parser, Subcommand};
use history::Dimension;
use std::path::PathBuf;

const EXIT_CODES: &str = "\
Exit codes:
  0    all well
  1    failed
  2    wrong command, pipeline, criteria, rig file, sensor card or channel map
  3    finished, but some flights or records failed, lost data, have a delay that changes, have a reference file that
       cannot be used, or contradict their rig file; or no flight has the number of a criterion
  4    finished, but a flight fails a criterion or was harmed (also if 3 applies)
  75   busy or temporary failure, try again (another run uses the folder, the disk is full, a log is being written)
  130  stopped by Ctrl-C";

const SCHEMA: &str = "\
Print the JSON schema of a settings file or of a machine-readable output.

An editor with TOML support completes and checks the keys of a file if the first line of the file names a schema in the \
same folder. Write the schema with `flightlag schema pipeline > pipeline.schema.json`. The first line is then \
`#:schema ./pipeline.schema.json`.";

const EXIT_CODES_OF_A_LOG: &str = "\
Exit codes:
  0    all well
  1    nothing in the log can be used, or the output cannot be written
  2    wrong command or channel map
  3    finished, but the log is damaged or data were lost
  130  stopped by Ctrl-C";

const INSPECT: &str = "\
Show what a log contains: topics, timestamps, damage, and which channel map matches.

Every byte is accounted for as decoded (holds values that a channel map wants; a compressed chunk counts completely), \
not wanted (intact as far as checksums show, but no map asks for it), structure (headers, indexes and definitions of the \
container) or damaged. Long lists are shortened unless --all is given. --json holds everything.";

const RECOVER: &str = "\
Write everything recoverable from a damaged log as MCAP, read it back and compare.

Messages of MCAP, ROS 1 and ROS 2 bags are copied byte for byte, with their definitions, attachments and metadata. In \
other logs (ULog, DataFlash, MAVLink, UBX, NMEA, text tables), each topic becomes a typed topic; parameters, information \
and texts of a ULog become metadata. Rows without a log timestamp, as in the output of a receiver, keep their own \
timestamp. The metadata record `flightlag-recover` of OUT names the source file, what was lost, and which clock \
`log_time` uses. OUT must be a plain file and must not be the log itself.";

const EXPORT: &str = "\
Write the channels of a log, or its topics as logged, as Parquet, CSV or MCAP.

Channels are in SI units, latitude and longitude in degrees; the name of a column ends with its unit. Velocities are \
north, east, down. Body axes are forward, right, down, and the quaternion w, x, y, z turns them to north, east, down, \
whatever the axes of the log are. Timestamps are in \
nanoseconds (`..._ns`); `t_s` is seconds since the first timestamp. If the clock of a table is not UTC and the log ties it to UTC, \
the table also has `utc_ns`, and the log time of an MCAP is UTC. provenance.json in the same folder holds the hash of the log, the \
map, units as written and as logged, clocks and how they are tied to UTC, and notices. An MCAP holds the same as metadata \
`flightlag-export`; a Parquet file holds its own part. Topics are written unconverted; variable-length arrays are skipped and listed. The log itself is never overwritten. In CSV, text that a \
spreadsheet might evaluate is prefixed with an apostrophe; numbers are unchanged. Channels as CSV come with channel-map.toml: with \
`--maps FOLDER`, the folder is one flight again.";

const CAMPAIGN: &str = "\
Make a report of a folder of flight logs: tables, records, pages.

Every log below FLIGHTS is a flight. A folder with one CSV file for each topic is also a flight. A flight is \
read once. Its result is stored in OUT under a name made from log, settings and analysis. A second run computes only \
what is new, and reports why. Run the same command again to resume a run that was stopped or killed.

In OUT: index.html (open this), flights/NAME/ (page, figures and record of each flight), \
flights.csv and flights.parquet (one row for each flight), campaign.json, since-last-run.html and .json \
(what is new, moved or newly failing, and why), and run.json, the only file with the time of day. All other \
files depend only on logs, settings and build, except since-last-run.html and .json.

The steps plan, task, reduce and status do the same work on a cluster, shard by shard.";

const GC: &str = "\
Remove the results of a campaign that no report refers to.

OUT/by-key keeps a result for each combination of log, settings and version that was ever used. A run with earlier settings reuses \
its results. This command removes results that neither the report in OUT nor a plan of the last 14 days refers to.";

/// Arguments of `flightlag gc`.
#[derive(Debug, Args)]
pub(crate) struct GcArguments {
    /// Output folder of a campaign.
    pub(crate) out: PathBuf,
    /// Remove nothing; show what would be removed.
    #[arg(long)]
    pub(crate) dry_run: bool,
}

const BENCH: &str = "\
Measure a sensor on the swing bench, and write a sensor card and pages.

A RECORD is a log with the encoder of the bar and the sensor, or a folder with one log of the encoder and one \
of the sensor (distinguished by the channels that they bind), or a folder of such records. All records must be of the same sensor: \
they are combined into one card, with the spread between them.

The rig file describes the bench: sensor, bar, lever arms, encoder, site. Without --rig, each record uses the rig file in its \
folder: NAME.rig.toml, or the only one there.

In OUT: index.html (the card's page, open this), SENSOR.card.toml (for `flightlag campaign`: [delay] card = ...), \
records/NAME/ (page, record.json), and run.json, the only file that holds the time of day.";

const NIGHTLY: &str = "\
Run every campaign of a night, add to the history, and write the page of the morning.

CONFIG names folders of logs, settings, criteria, the folder of the reports, the history and a fleet file; \
pipelines/nightly/nightly.toml is a commented example. Only what is new or changed is computed. A log that is still being \
written is skipped until the next night, and reported.

In the folder of the reports: morning.html (open this), summary.txt, .json, .md and .xml (JUnit) with the five printed \
lines, nights/RUN/ (the same for each night, and night.json), and a report for each campaign. The history gets one Parquet file \
with a row for each flight with a new or changed finding.";

const EXIT_CODES_OF_A_NIGHT: &str = "\
Exit codes, the gravest of all campaigns:
  0    all well
  3    finished, but some flights failed, lost data or have a delay that changes, or a trend has a new change
  4    finished, but a flight fails a criterion or was harmed, or a setting did not remove the delay as predicted
  75   a campaign could not run now: run again
  1    a campaign failed, or an output cannot be written
  2    wrong command, nightly file, or file named in it
  130  stopped by Ctrl-C";

const TREND: &str = "\
Show control charts of a history, and where they change.

A chart shows how late the position of each flight is, in the order of the flights, for one aircraft, serial number, \
receiver, firmware, rate or baud. Each flight is weighted by its own uncertainty and the spread between flights. A change is a step of \
the mean. The probability of a false change is 1 % each time a chart is computed. `flightlag nightly` computes the charts every night \
and reports a change only if it is large enough for 1 % over all nights.";

const QUERY: &str = "\
Query a history: select rows, group them, and aggregate each group.

CONDITION compares columns with values, such as `delay_s > 0.3 and firmware == '3.01'`. It accepts and, or, not, parentheses, == != < <= > >= \
and `is null`. Put texts in quotes. Times may be dates. Aggregates are count(), median, mean, min, max, std, sum and quantile(column, share). \
--columns lists the columns; delay_s is another name for lateness_s. The latest row of each flight is used.

This command needs a build with polars: `cargo build --release -p flightlag --features query`, or `just query`.";

const DIFF: &str = "\
Compare two reports of campaigns: what moved, by how many sigma, and why.

A cause is the log, the settings, the build of flightlag, the criteria, or the other flights of a group. With --flights, RUN_A and \
RUN_B are two pipelines: both are run over the same flights and write to OUT/first and OUT/second.";

/// Measures how late each channel of a sensor is on a swing bench, and replays delay compensators over flight logs with
/// a late position.
#[derive(Debug, Parser)]
#[command(name = "flightlag", version, after_help = EXIT_CODES, max_term_width = 110)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    pub(crate) command: Command,
}

const DELAY: &str = "\
Show how late the position of each log is, and what to do about it.

For each flight: lateness of the position with its expanded uncertainty (k = 2) and its reference, the kind of delay \
(constant, on time, early, steps, drifts, queues, ... or why it is unknown and what to fly), the delay between position and \
velocity, what `flightlag campaign` would remove and whether that helps, settings that remove the delay, and alarms. Flights \
with the same receiver, firmware, rate and log kind are pooled. Logs are only read. Files are written only where an option asks for them.

Lateness against `imu` is absolute if the IMU is on time. `relative to velocity.gps` means that the log does not show how \
late both are.";

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Show how late the position of each log is, and what to do about it.
    #[command(long_about = DELAY, after_help = EXIT_CODES)]
    Delay(DelayArguments),
    /// Make a report of a folder of flight logs: tables, records, pages.
    #[command(long_about = CAMPAIGN, after_help = EXIT_CODES)]
    Campaign(Box<CampaignArguments>),
    /// Remove the results of a campaign that no report refers to.
    #[command(long_about = GC, after_help = EXIT_CODES)]
    Gc(GcArguments),
    /// Run every campaign of a night, add to the history, and write the page of the morning.
    #[command(long_about = NIGHTLY, after_help = EXIT_CODES_OF_A_NIGHT)]
    Nightly(NightlyArguments),
    /// List the runs of a history, or how late positions are by receiver, firmware, rate and baud.
    #[command(after_help = EXIT_CODES)]
    History(HistoryArguments),
    /// Show control charts of a history, and where they change.
    #[command(long_about = TREND, after_help = EXIT_CODES)]
    Trend(TrendArguments),
    /// Query a history: select rows, group them, and aggregate each group.
    #[command(long_about = QUERY, after_help = EXIT_CODES)]
    Query(QueryArguments),
    /// Compare two reports: what moved, by how many sigma, and why.
    #[command(long_about = DIFF, after_help = EXIT_CODES)]
    Diff(DiffArguments),
    /// Measure a sensor on the swing bench, and write a sensor card and pages.
    #[command(long_about = BENCH, after_help = EXIT_CODES)]
    Bench(Box<BenchArguments>),
    /// Show what a log contains: topics, timestamps, damage, and which channel map matches.
    #[command(long_about = INSPECT, after_help = EXIT_CODES_OF_A_LOG)]
    Inspect(InspectArguments),
    /// Write everything recoverable from a damaged log as MCAP, read it back and report the counts.
    #[command(long_about = RECOVER, after_help = EXIT_CODES_OF_A_LOG)]
    Recover(RecoverArguments),
    /// Write the channels of a log, or its topics as logged, as Parquet, CSV or MCAP.
    #[command(long_about = EXPORT, after_help = EXIT_CODES_OF_A_LOG)]
    Export(ExportArguments),
    /// Write simulated flights and bench records with known truth.
    #[command(after_help = EXIT_CODES)]
    Demo(DemoArguments),
    /// Write a compensator as C for the aircraft. Print where it helps and which autopilot parameter does the same.
    #[command(after_help = crate::compensator::names_and(EXIT_CODES))]
    Compensator(CompensatorArguments),
    /// List the metrics that criteria can use, or check a criteria file.
    #[command(after_help = EXIT_CODES)]
    Criteria(CriteriaArguments),
    /// Explain a code of a notice or an alarm, or list all codes.
    #[command(after_help = EXIT_CODES)]
    Explain(ExplainArguments),
    /// List the channel maps that come with flightlag, or print one.
    Maps(MapsArguments),
    /// Print the JSON schema of a settings file or of a machine-readable output.
    #[command(long_about = SCHEMA)]
    Schema(SchemaArguments),
    /// Print completions for a shell.
    ///
    /// For bash: `flightlag completions bash > ~/.local/share/bash-completion/completions/flightlag`.
    Completions(CompletionsArguments),
    /// Write manual pages: one for each command.
    Man(ManArguments),
}

#[derive(Debug, Args)]
pub(crate) struct CompletionsArguments {
    /// Shell to complete for.
    pub(crate) shell: clap_complete::Shell,
}

#[derive(Debug, Args)]
pub(crate) struct ManArguments {
    /// Folder for the pages, such as ~/.local/share/man/man1. It is created if it is missing.
    pub(crate) dir: PathBuf,
}

#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub(crate) struct CampaignArguments {
    #[command(subcommand)]
    pub(crate) step: Option<Step>,
    /// `None` for a step. (An optional group must hold its arguments itself: clap does not see
    /// through a second flattening, and then never finds it present.)
    #[command(flatten)]
    pub(crate) order: Option<OrderArguments>,
    #[command(flatten)]
    pub(crate) aircraft: AircraftArguments,
    #[command(flatten)]
    pub(crate) common: RunArguments,
}

#[derive(Debug, Args)]
pub(crate) struct DelayArguments {
    /// Logs or folders of logs, local or in a bucket (s3://BUCKET/PREFIX). They are only read.
    #[arg(value_name = "LOG|FOLDER", required = true)]
    pub(crate) logs: Vec<PathBuf>,
    /// Print JSON; `flightlag schema delay` prints its schema.
    #[arg(long, conflicts_with = "csv")]
    pub(crate) json: bool,
    /// Print CSV, one row for each flight.
    #[arg(long)]
    pub(crate) csv: bool,
    /// Also write values for the design of a Kalman filter to this folder, one TOML file for each flight: noise density,
    /// wander and delay of each channel, each with its uncertainty and formula.
    #[arg(long, value_name = "DIR")]
    pub(crate) ekf: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) aircraft: AircraftArguments,
    /// Settings (TOML), as for `flightlag campaign`. A delay stated in them is tested against each flight.
    #[arg(long, value_name = "FILE")]
    pub(crate) pipeline: Option<PathBuf>,
    /// Read every flight with this channel map.
    #[arg(long, value_name = "NAME")]
    pub(crate) map: Option<String>,
    /// Folder with more channel maps, and with message definitions that are missing in logs (PACKAGE/msg/TYPE.msg).
    #[arg(long, value_name = "DIR")]
    pub(crate) maps: Option<PathBuf>,
    /// Second file of each flight with a reference or a velocity: a PPK solution, a truth, an export of motion capture. For
    /// several flights, give a pattern relative to the folder of each log, such as {stem}.pos. {stem} is the name of the log
    /// without its ending; * matches anything.
    #[arg(long, value_name = "FILE")]
    pub(crate) reference: Option<String>,
    /// Relation of its clock to the clock of the log: same, own (the offset is estimated), or auto (own unless both use UTC
    /// or GPS time). Without --reference, only same: the reference in the log is on time.
    #[arg(long, value_name = "RULE", value_parser = clock_rule)]
    pub(crate) reference_clock: Option<campaign::ClockRule>,
    /// Number of threads. Default: all cores, or SLURM_CPUS_PER_TASK.
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(crate) threads: Option<u16>,
    /// Show no progress.
    #[arg(long)]
    pub(crate) quiet: bool,
    #[command(flatten)]
    pub(crate) cache: CacheArguments,
}

/// What is written for the aircraft.
#[derive(Debug, Args)]
pub(crate) struct AircraftArguments {
    /// Also write compensators as C to this folder, with delay and interval: the exact form and the form of the paper (Padé
    /// [1/1]), each as a header and a C file, for each group of flights with a known lateness. Existing files are replaced.
    #[arg(long, value_name = "DIR")]
    pub(crate) c: Option<PathBuf>,
    /// Time step of the loop that the C runs in, s.
    #[arg(long, value_name = "S", default_value_t = 0.01, requires = "c", allow_negative_numbers = true, value_parser = step_s)]
    pub(crate) step_s: f64,
    /// Also write the parameter that removes the delay, for ArduPilot (NAME,VALUE) or PX4 (columns of QGroundControl). An
    /// existing FILE is replaced.
    #[arg(long, value_name = "FILE")]
    pub(crate) params: Option<PathBuf>,
}

fn clock_rule(text: &str) -> Result<campaign::ClockRule, String> {
    match text {
        "auto" => Ok(campaign::ClockRule::Auto),
        "same" => Ok(campaign::ClockRule::Same),
        "own" => Ok(campaign::ClockRule::Own),
        _ => Err("must be auto, same or own".to_owned()),
    }
}

/// What [`clock_rule`] reads as this rule.
pub(crate) fn clock_rule_name(rule: campaign::ClockRule) -> &'static str {
    match rule {
        campaign::ClockRule::Auto => "auto",
        campaign::ClockRule::Same => "same",
        campaign::ClockRule::Own => "own",
    }
}

/// A delay that a compensator can remove, as far as one is searched.
fn delay_s(text: &str) -> Result<f64, String> {
    let above_zero = |what: String| what.replace("from 0 to 30 s", "above 0 and at most 30 s");
    let seconds = settings::seconds(text, 0.0, 30.0).map_err(above_zero)?;
    if seconds > 0.0 { Ok(seconds) } else { Err("must be above 0 and at most 30 s".to_owned()) }
}

fn positive_s(text: &str) -> Result<f64, String> {
    settings::seconds(text, 0.0, 30.0)
}

/// The step of a loop that flies: 100 kHz to 1 Hz.
fn step_s(text: &str) -> Result<f64, String> {
    settings::seconds(text, 1e-5, 1.0)
}

/// Which campaign.
#[derive(Debug, Args)]
pub(crate) struct OrderArguments {
    /// Folder of the flights, local or in a bucket (s3://BUCKET/PREFIX). It is only read.
    #[arg(value_name = "FLIGHTS")]
    pub(crate) flights: PathBuf,
    /// Folder of the report, local or in a bucket: new, empty, or of an earlier run. Default: reports/NAME in the current
    /// folder, with the name of FLIGHTS.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Settings (TOML). Default: `pipelines/default.toml`, which removes the delay measured in the flights.
    #[arg(long, value_name = "FILE")]
    pub(crate) pipeline: Option<PathBuf>,
    /// Criteria for the flights (TOML), instead of the file that the pipeline names, if any. `flightlag criteria` lists
    /// the metrics.
    #[arg(long, value_name = "FILE")]
    pub(crate) criteria: Option<PathBuf>,
    /// Read every flight with this channel map.
    #[arg(long, value_name = "NAME")]
    pub(crate) map: Option<String>,
    /// Folder with more channel maps, and with message definitions that are missing in logs (PACKAGE/msg/TYPE.msg).
    #[arg(long, value_name = "DIR")]
    pub(crate) maps: Option<PathBuf>,
    /// Second file of each flight with a reference or a velocity, as for `flightlag delay`. It replaces the one in the
    /// pipeline.
    #[arg(long, value_name = "FILE")]
    pub(crate) reference: Option<String>,
    /// Relation of its clock to the clock of the log: auto, same or own. Without a second file, only same: the reference in
    /// the log is on time.
    #[arg(long, value_name = "RULE", value_parser = clock_rule)]
    pub(crate) reference_clock: Option<campaign::ClockRule>,
    /// Replace the report in OUT even if it is of other logs.
    #[arg(long)]
    pub(crate) replace: bool,
    /// Hash every log again instead of trusting its size and modification time.
    #[arg(long)]
    pub(crate) verify: bool,
}

/// How the work is done and reported.
#[derive(Debug, Clone, Args)]
pub(crate) struct RunArguments {
    /// Number of threads. Default: all cores, or SLURM_CPUS_PER_TASK.
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(crate) threads: Option<u16>,
    /// Print events as JSON Lines on standard output, and nothing else.
    #[arg(long)]
    pub(crate) json: bool,
    /// Print only errors.
    #[arg(long, conflicts_with = "json")]
    pub(crate) quiet: bool,
    #[command(flatten)]
    pub(crate) cache: CacheArguments,
}

/// Where copies of logs from a bucket are stored.
#[derive(Debug, Clone, Default, Args)]
pub(crate) struct CacheArguments {
    /// Folder for copies of logs from a bucket (s3://BUCKET/PREFIX). Default: flightlag in the cache folder of the system
    /// ($XDG_CACHE_HOME, or .cache in the home folder).
    #[arg(long, value_name = "DIR")]
    pub(crate) cache: Option<PathBuf>,
    /// Maximum size of these copies, GB. The least recently used copies are removed first. Default: 10.
    #[arg(long, value_name = "GB", value_parser = room)]
    pub(crate) cache_size: Option<u64>,
}

/// A size in GB as bytes.
fn room(text: &str) -> Result<u64, String> {
    let size: f64 = text.parse().map_err(|_| "is not a number".to_owned())?;
    match size > 0.0 && size < 1e9 {
        true => Ok((size * 1e9) as u64),
        false => Err("must be more than 0 and less than 1e9".to_owned()),
    }
}

#[derive(Debug, Subcommand)]
pub(crate) enum Step {
    /// Write a manifest of the work to do: shards of roughly equal size, all of one stage (measure, then replay). Run its
    /// tasks and plan again until a plan has no shards. Then reduce.
    Plan {
        #[command(flatten)]
        order: OrderArguments,
        /// File for the manifest. Default: a new file in OUT/.flightlag/plans.
        #[arg(long, value_name = "FILE")]
        manifest: Option<PathBuf>,
        /// Maximum number of shards.
        #[arg(long, value_name = "N", default_value_t = 1000, allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..))]
        max_shards: u32,
        #[command(flatten)]
        common: RunArguments,
    },
    /// Make the results of one shard. Exit 0: every flight in it has a result. 75: temporary failure, run again. 3: permanent
    /// failure.
    Task {
        /// Manifest of the plan.
        #[arg(long, value_name = "FILE")]
        manifest: PathBuf,
        /// Which shard, from 0.
        #[arg(long, value_name = "I", allow_negative_numbers = true)]
        shard: u32,
        #[command(flatten)]
        common: RunArguments,
    },
    /// Make tables and pages from the available results. Can be run at any time.
    Reduce {
        /// Manifest of the plan.
        #[arg(long, value_name = "FILE")]
        manifest: PathBuf,
        #[command(flatten)]
        aircraft: AircraftArguments,
        #[command(flatten)]
        common: RunArguments,
    },
    /// Count the flights that have a result. Exit 3 if results are missing.
    Status {
        /// Manifest of the plan.
        #[arg(long, value_name = "FILE")]
        manifest: PathBuf,
        /// Print JSON.
        #[arg(long)]
        json: bool,
    },
}

#[derive(Debug, Args)]
pub(crate) struct NightlyArguments {
    /// The nightly file (TOML). `flightlag schema nightly` prints its schema.
    #[arg(value_name = "CONFIG")]
    pub(crate) config: PathBuf,
    #[command(flatten)]
    pub(crate) common: RunArguments,
}

#[derive(Debug, Args)]
pub(crate) struct HistoryArguments {
    /// Folder of the history.
    #[arg(value_name = "HISTORY")]
    pub(crate) history: PathBuf,
    /// Show how late positions are by receiver, firmware, rate and baud, instead of the runs.
    #[arg(long)]
    pub(crate) latency: bool,
    /// Print JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct TrendArguments {
    /// Folder of the history.
    #[arg(value_name = "HISTORY")]
    pub(crate) history: PathBuf,
    /// Properties that separate the flights into charts. Default: all of these.
    #[arg(long, value_parser = dimension(), value_name = "NAME", value_delimiter = ',')]
    pub(crate) by: Vec<Dimension>,
    /// Print JSON.
    #[arg(long)]
    pub(crate) json: bool,
    /// Also write a page with the charts, trend.json and trend.csv to this folder.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Folder of the reports, relative to the page, for links to the flights.
    #[arg(long, value_name = "PATH", requires = "out")]
    pub(crate) reports: Option<String>,
}

/// The dimensions of a trend by their names.
fn dimension() -> impl TypedValueParser<Value = Dimension> {
    let names = Dimension::ALL.map(|dimension| PossibleValue::new(dimension.name()).help(dimension.what()));
    PossibleValuesParser::new(names).try_map(|name| {
        Dimension::ALL.into_iter().find(|dimension| dimension.name() == name).ok_or(
            "not a property that separates \
            charts",
        )
    })
}

#[derive(Debug, Args)]
pub(crate) struct QueryArguments {
    /// Use only rows that meet this condition. Default: all rows.
    #[arg(value_name = "CONDITION")]
    pub(crate) condition: Option<String>,
    /// Folder of the history.
    #[arg(long, value_name = "DIR", default_value = "reports/history")]
    pub(crate) history: PathBuf,
    /// Columns to group by, separated by commas.
    #[arg(long, value_name = "COLUMNS", value_delimiter = ',')]
    pub(crate) by: Vec<String>,
    /// Aggregates of each group, separated by commas. Default: count() with --by, otherwise the rows themselves.
    #[arg(long, value_name = "AGGREGATES")]
    pub(crate) agg: Option<String>,
    /// Use every row of every run, not only the latest row of each flight.
    #[arg(long)]
    pub(crate) every_run: bool,
    /// Output format. Default: a table for people.
    #[arg(long, value_enum, value_name = "KIND")]
    pub(crate) to: Option<QueryTo>,
    /// File to write instead of standard output. Parquet needs one.
    #[arg(long, value_name = "FILE", requires = "to")]
    pub(crate) out: Option<PathBuf>,
    /// List the columns and stop.
    #[arg(long)]
    pub(crate) columns: bool,
}

/// What an answer is written as.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum QueryTo {
    /// Comma-separated values.
    Csv,
    /// A list of objects.
    Json,
    /// A Parquet file.
    Parquet,
}

#[derive(Debug, Args)]
pub(crate) struct DiffArguments {
    /// The first report; with --flights the first pipeline.
    #[arg(value_name = "RUN_A")]
    pub(crate) before: PathBuf,
    /// The second report; with --flights the second pipeline.
    #[arg(value_name = "RUN_B")]
    pub(crate) now: PathBuf,
    /// Run both pipelines over this folder of logs first.
    #[arg(long, value_name = "FLIGHTS", requires = "out")]
    pub(crate) flights: Option<PathBuf>,
    /// Write a page and diff.json to this folder.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) common: RunArguments,
}

#[derive(Debug, Args)]
pub(crate) struct BenchArguments {
    /// Logs or folders of logs; they are only read.
    #[arg(value_name = "RECORD", required = true)]
    pub(crate) records: Vec<PathBuf>,
    /// Rig file (TOML) for all records.
    #[arg(long, value_name = "FILE")]
    pub(crate) rig: Option<PathBuf>,
    /// Log of the encoder, if RECORD is a log without an encoder.
    #[arg(long, value_name = "LOG")]
    pub(crate) encoder: Option<PathBuf>,
    /// Folder of the report: new, empty, or of an earlier bench run. Default: reports/bench-NAME in the current folder, with
    /// the name of the first RECORD.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Read every log with this channel map.
    #[arg(long, value_name = "NAME")]
    pub(crate) map: Option<String>,
    /// Folder with more channel maps, and with message definitions that are missing in logs (PACKAGE/msg/TYPE.msg).
    #[arg(long, value_name = "DIR")]
    pub(crate) maps: Option<PathBuf>,
    /// Replace the report in OUT even if it is of other records.
    #[arg(long)]
    pub(crate) replace: bool,
    /// Also write the sensor card to this file.
    #[arg(long, value_name = "FILE")]
    pub(crate) card: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) common: RunArguments,
}

#[derive(Debug, Args)]
pub(crate) struct InspectArguments {
    /// A log, or a folder that holds one flight (a ROS 2 bag; one CSV file for each topic).
    #[arg(value_name = "LOG")]
    pub(crate) log: PathBuf,
    /// Print JSON.
    #[arg(long)]
    pub(crate) json: bool,
    /// List everything, without shortening.
    #[arg(long, conflicts_with = "json")]
    pub(crate) all: bool,
    /// Bind with this channel map.
    #[arg(long, value_name = "NAME")]
    pub(crate) map: Option<String>,
    /// Folder with more channel maps, and with message definitions that are missing in logs (PACKAGE/msg/TYPE.msg).
    #[arg(long, value_name = "DIR")]
    pub(crate) maps: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub(crate) struct RecoverArguments {
    /// A log, or a folder that holds one flight; it is only read.
    #[arg(value_name = "IN")]
    pub(crate) log: PathBuf,
    /// MCAP file to write. It is written completely or not at all.
    #[arg(value_name = "OUT")]
    pub(crate) out: PathBuf,
    /// Overwrite OUT if it exists.
    #[arg(long)]
    pub(crate) force: bool,
}

#[derive(Debug, Args)]
pub(crate) struct ExportArguments {
    /// A log, or a folder that holds one flight (a ROS 2 bag; one CSV file for each topic). With --track: the folder of a
    /// flight in a report, or its track.parquet.
    #[arg(value_name = "LOG")]
    pub(crate) log: PathBuf,
    /// Output format.
    #[arg(long, value_enum, value_name = "KIND", default_value = "parquet", default_value_if("track", "true", "kml"))]
    pub(crate) to: ExportKind,
    /// Folder of the tables, or the file. Default: the name of the log in the current folder, followed by `.parquet` or
    /// `.csv.d` (folders), `.export.mcap`, or with --track `.track.KIND`.
    #[arg(long, value_name = "PATH")]
    pub(crate) out: Option<PathBuf>,
    /// Write the track of a flight of a report, raw and compensated, for maps and players.
    #[arg(long, conflicts_with_all = ["topics", "map", "maps"])]
    pub(crate) track: bool,
    /// Write at most this many points per second; 0 writes every row. Default: 5 for maps, every row for CSV and MCAP.
    #[arg(long, value_name = "HZ", requires = "track", allow_negative_numbers = true)]
    pub(crate) rate: Option<f64>,
    /// Write all topics with all fields, unconverted, instead of the channels that a map binds.
    #[arg(long)]
    pub(crate) topics: bool,
    /// Replace an earlier export: its tables are removed, other files in the folder are kept.
    #[arg(long)]
    pub(crate) force: bool,
    /// Bind with this channel map.
    #[arg(long, value_name = "NAME", conflicts_with = "topics")]
    pub(crate) map: Option<String>,
    /// Folder with more channel maps, and with message definitions that are missing in logs (PACKAGE/msg/TYPE.msg).
    #[arg(long, value_name = "DIR")]
    pub(crate) maps: Option<PathBuf>,
}

/// A format that is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum ExportKind {
    /// One Parquet file for each channel or topic.
    Parquet,
    /// One CSV file for each channel or topic.
    Csv,
    /// One MCAP with a typed topic for each; with --track, fixes of `NavSatFix` and `foxglove.LocationFix`, and layouts
    /// for Foxglove and PlotJuggler.
    Mcap,
    /// GeoJSON; with --track only.
    Geojson,
    /// KML for Google Earth; with --track only.
    Kml,
    /// GPX; with --track only.
    Gpx,
}

#[derive(Debug, Args)]
pub(crate) struct DemoArguments {
    /// Folder for the output: flights in DIR/flights, bench records in DIR/bench, reports in DIR/report and
    /// DIR/bench-report.
    #[arg(value_name = "DIR")]
    pub(crate) folder: PathBuf,
    /// Also run bench and campaign on them, and print which pages to open. The truncated log and the failed criteria are intentional and
    /// do not affect the exit code.
    #[arg(long)]
    pub(crate) run: bool,
    /// Seed of all random numbers in flights and records.
    #[arg(long, value_name = "N", default_value_t = 1, allow_negative_numbers = true)]
    pub(crate) seed: u64,
    #[command(flatten)]
    pub(crate) common: RunArguments,
}

#[derive(Debug, Args)]
pub(crate) struct CompensatorArguments {
    /// Compensator: pade-1-1-tustin (of the paper), pade-M-N-RULE (a Padé form) with N from 1 to 8, M from N − 2 to N, and RULE
    /// zoh, foh, tustin or (for N = 1) matched, or exact-async, which uses the age of each fix and stores the velocities of
    /// that time.
    #[arg(value_name = "NAME")]
    pub(crate) name: String,
    /// Lateness of the position, s, as `flightlag delay` reports it; positive is late.
    #[arg(long, value_name = "S", allow_negative_numbers = true, value_parser = delay_s)]
    pub(crate) delay_s: f64,
    /// Its standard uncertainty (k = 1), s.
    #[arg(long, value_name = "S", allow_negative_numbers = true, value_parser = positive_s)]
    pub(crate) uncertainty_s: Option<f64>,
    /// Origin of the delay, for a comment in the source.
    #[arg(long, value_name = "TEXT", default_value = "given on the command line")]
    pub(crate) source: String,
    /// Time step of the loop that it runs in, s.
    #[arg(long, value_name = "S", allow_negative_numbers = true, value_parser = step_s)]
    pub(crate) step_s: f64,
    /// Maximum age of a fix for exact-async, s.
    #[arg(long, value_name = "S", default_value_t = 1.0, allow_negative_numbers = true, value_parser = positive_s)]
    pub(crate) max_age_s: f64,
    /// Use single precision instead of double.
    #[arg(long)]
    pub(crate) float: bool,
    /// Prefix of all names in the source and of the files.
    #[arg(long, value_name = "NAME", default_value = "position_delay")]
    pub(crate) prefix: String,
    /// Folder for the two files.
    #[arg(long, value_name = "DIR", default_value = ".")]
    pub(crate) out: PathBuf,
}

#[derive(Debug, Args)]
pub(crate) struct CriteriaArguments {
    /// Check this file and print what it means.
    #[arg(value_name = "FILE")]
    pub(crate) file: Option<PathBuf>,
    /// Print the commented example, as a start for your own file.
    #[arg(long, conflicts_with = "file")]
    pub(crate) example: bool,
}

#[derive(Debug, Args)]
pub(crate) struct ExplainArguments {
    /// The code, such as `tail-cut`, or a word of a table, such as `scatters`. Default: list all codes.
    #[arg(value_name = "CODE")]
    pub(crate) code: Option<String>,
}

#[derive(Debug, Args)]
pub(crate) struct SchemaArguments {
    /// Name of the schema.
    #[arg(value_enum, value_name = "NAME")]
    pub(crate) of: SchemaOf,
}

/// What has a schema.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum SchemaOf {
    /// Settings of `campaign` and `delay`.
    Pipeline,
    /// Acceptance criteria of flights.
    Criteria,
    /// The rig of a bench.
    Rig,
    /// A sensor card.
    Card,
    /// A channel map.
    ChannelMap,
    /// A test card: objective, configuration, instrumentation.
    TestCard,
    /// Settings of `nightly`.
    Nightly,
    /// Aircraft and receiver of each flight.
    Fleet,
    /// Output of `delay --json`.
    Delay,
    /// record.json of a flight.
    Record,
    /// record.json of a bench record.
    BenchRecord,
    /// campaign.json.
    Campaign,
    /// A line of `--json` of `campaign`, `bench` and `demo`.
    Events,
}

#[derive(Debug, Args)]
pub(crate) struct MapsArguments {
    /// Print this map, as a start for your own.
    #[arg(value_name = "NAME")]
    pub(crate) name: Option<String>,
    /// Folder with more channel maps, and with message definitions that are missing in logs (PACKAGE/msg/TYPE.msg).
    #[arg(long, value_name = "DIR")]
    pub(crate) maps: Option<PathBuf>,
    /// Print the commented example that uses every key, as a start for your own map.
    #[arg(long, conflicts_with_all = ["name", "suggest"])]
    pub(crate) example: bool,
    /// Print a channel map for this table, guessed from column names, units and motion.
    #[arg(long, value_name = "LOG", conflicts_with = "name")]
    pub(crate) suggest: Option<PathBuf>,
}
