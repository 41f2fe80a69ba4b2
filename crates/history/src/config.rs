//! The nightly file: which campaigns a night runs, and where the outputs go.

use crate::error::HistoryError;
use crate::fleet::Fleet;
use campaign::{CampaignError, Criteria, Order, Pipeline};
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::Deserialize;
use settings::{Refused, SettingsFile};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;
use toml::Spanned;

/// Names that a campaign must not have: the night writes files with these names into the same folder.
const TAKEN: [&str; 6] = ["nights", "history", "index.html", "morning.html", "figures.zip", "summary"];

/// The nightly file.
#[derive(Debug, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "schema", schemars(title = "flightlag nightly"))]
struct NightlyFile {
    /// Version of this file's layout: 1.
    #[cfg_attr(feature = "schema", schemars(with = "u32", range(min = 1, max = 1)))]
    schema: Spanned<u32>,
    /// Name of the night, for its page.
    #[serde(default = "default_title")]
    title: String,
    /// Folder of the reports: each campaign in OUT/NAME, the page of the latest night in OUT/morning.html.
    #[cfg_attr(feature = "schema", schemars(with = "String"))]
    out: Spanned<PathBuf>,
    /// Folder of the history: one Parquet file for each night. Default: OUT/history.
    #[cfg_attr(feature = "schema", schemars(with = "Option<String>"))]
    history: Option<Spanned<PathBuf>>,
    /// Fleet file: aircraft and receivers that logs do not state.
    #[cfg_attr(feature = "schema", schemars(with = "Option<String>"))]
    fleet: Option<Spanned<PathBuf>>,
    /// Settings of all campaigns (TOML). Default: the shipped ones.
    #[cfg_attr(feature = "schema", schemars(with = "Option<String>"))]
    pipeline: Option<Spanned<PathBuf>>,
    /// Criteria of all campaigns (TOML). Default: those in the pipeline, if any.
    #[cfg_attr(feature = "schema", schemars(with = "Option<String>"))]
    criteria: Option<Spanned<PathBuf>>,
    /// A log modified less than this ago is left for the next night, minutes. Default: 10.
    #[serde(default = "default_settle")]
    #[cfg_attr(feature = "schema", schemars(with = "f64", range(min = 0.0, max = 1440.0)))]
    settle_min: Spanned<f64>,
    /// Campaigns, run one after the other.
    #[serde(default)]
    #[cfg_attr(feature = "schema", schemars(with = "Vec<CampaignTable>", length(min = 1)))]
    campaign: Vec<Spanned<CampaignTable>>,
}

fn default_title() -> String {
    "Night".to_owned()
}

fn default_settle() -> Spanned<f64> {
    Spanned::new(0..0, 10.0)
}

/// One campaign.
#[derive(Debug, Clone, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
struct CampaignTable {
    /// Folder of the logs. It is only read.
    #[cfg_attr(feature = "schema", schemars(with = "String"))]
    flights: Spanned<PathBuf>,
    /// Name of the campaign in reports and history. Default: the name of the folder.
    #[cfg_attr(feature = "schema", schemars(with = "Option<String>", regex(pattern = "^[A-Za-z0-9._-]+$")))]
    name: Option<Spanned<String>>,
    /// Settings of this campaign, instead of the common ones.
    #[cfg_attr(feature = "schema", schemars(with = "Option<String>"))]
    pipeline: Option<Spanned<PathBuf>>,
    /// Criteria of this campaign, instead of the common ones.
    #[cfg_attr(feature = "schema", schemars(with = "Option<String>"))]
    criteria: Option<Spanned<PathBuf>>,
    /// Channel map for every flight.
    map: Option<String>,
    /// Folder with further channel maps.
    #[cfg_attr(feature = "schema", schemars(with = "Option<String>"))]
    maps: Option<PathBuf>,
}

/// The resolved configuration of a night.
#[derive(Debug, Clone, PartialEq)]
pub struct NightlyConfig {
    /// Name of the night.
    pub title: String,
    /// Folder of the reports.
    pub out: PathBuf,
    /// Folder of the history.
    pub history: PathBuf,
    /// Identities that logs do not state.
    pub fleet: Fleet,
    /// Campaigns in order: name and request.
    pub campaigns: Vec<(String, Order)>,
}

impl NightlyConfig {
    /// Reads a nightly file, and the pipelines, criteria and fleet files it refers to. Paths are relative to its
    /// folder.
    ///
    /// # Errors
    /// Everything that is wrong with the file, with lines; or what is wrong with a file it refers to.
    pub fn read(path: &Path) -> Result<NightlyConfig, HistoryError> {
        NightlyConfig::parse(&settings::read_text(path)?, path)
    }

    /// Reads a nightly file from `text`; `path` is for errors and relative paths.
    ///
    /// # Errors
    /// As [`NightlyConfig::read`].
    pub fn parse(text: &str, path: &Path) -> Result<NightlyConfig, HistoryError> {
        let file = SettingsFile::new(text, path);
        let reader = Reader { file: &file, folder: path.parent().unwrap_or(Path::new("")) };
        let meant = file.read().and_then(|written| reader.meaning_of(written));
        Ok(file.finish(meant)?)
    }
}

struct Reader<'a> {
    file: &'a SettingsFile<'a>,
    folder: &'a Path,
}

impl Reader<'_> {
    fn meaning_of(&self, written: NightlyFile) -> Result<NightlyConfig, Refused> {
        self.file.known_layout(&written.schema)?;
        let some = match written.campaign.is_empty() {
            true => Err(self.file.reject_whole("has no [[campaign]]: there is nothing to run")),
            false => Ok(()),
        };
        let settle = self.settle(&written.settle_min);
        let fleet = written.fleet.as_ref().map(|at| self.named_file(at, Fleet::read)).transpose();
        let all = (written.pipeline.as_ref(), written.criteria.as_ref());
        let out = self.out(&written);
        let names = self.names(&written.campaign);
        let history = written.history.as_ref().map(|at| self.history(at, &written, names.as_deref())).transpose();
        let campaigns: Vec<Result<Order, Refused>> =
            written.campaign.iter().map(|table| self.order(table.get_ref(), all, settle.unwrap_or_default())).collect();
        let campaigns: Result<Vec<Order>, Refused> = campaigns.into_iter().collect();
        some?;
        settle?;
        let out = out?;
        let history = history?.unwrap_or_else(|| out.join("history"));
        let orders = names?.into_iter().zip(campaigns?);
        Ok(NightlyConfig {
            title: written.title,
            history,
            fleet: fleet?.unwrap_or_default(),
            campaigns: orders.map(|(name, order)| (name.clone(), Order { out: out.join(&name), ..order })).collect(),
            out,
        })
    }

    /// An output folder. A night never writes into a folder of logs.
    fn outside_logs(
        &self,
        key: &str,
        output: &Spanned<PathBuf>,
        campaigns: &[Spanned<CampaignTable>],
    ) -> Result<PathBuf, Refused> {
        let folder = self.folder.join(output.get_ref());
        let of_logs = |table: &&Spanned<CampaignTable>| {
            let flights = table.get_ref().flights.get_ref();
            !campaign::is_in_bucket(flights) && is_within(&folder, &self.folder.join(flights))
        };
        match campaigns.iter().find(of_logs) {
            None => Ok(folder),
            Some(table) => Err(self.file.reject(
                output,
                format!(
                    "{key} is inside the folder of logs {}, which must not be written to",
                    table.get_ref().flights.get_ref().display()
                ),
            )),
        }
    }

    /// The output folder of the night.
    fn out(&self, written: &NightlyFile) -> Result<PathBuf, Refused> {
        let refusal = "out must be a folder; only flights may be in a bucket";
        match campaign::is_in_bucket(written.out.get_ref()) {
            true => Err(self.file.reject(&written.out, refusal)),
            false => self.outside_logs("out", &written.out, &written.campaign),
        }
    }

    /// The folder of the history. It must not be the report folder of a campaign.
    fn history(
        &self,
        at: &Spanned<PathBuf>,
        written: &NightlyFile,
        names: Result<&[String], &Refused>,
    ) -> Result<PathBuf, Refused> {
        if campaign::is_in_bucket(at.get_ref()) {
            return Err(self.file.reject(at, "history must be a folder; only flights may be in a bucket"));
        }
        let history = self.outside_logs("history", at, &written.campaign)?;
        let reports = self.folder.join(written.out.get_ref());
        let of_report = |name: &&String| is_within(&history, &reports.join(name));
        match names.unwrap_or_default().iter().find(of_report) {
            None => Ok(history),
            Some(name) => Err(self
                .file
                .reject(at, format!("history is inside the report of the campaign {name}: give it a separate folder"))),
        }
    }

    fn settle(&self, minutes: &Spanned<f64>) -> Result<Duration, Refused> {
        match *minutes.get_ref() {
            m if (0.0..=1440.0).contains(&m) => Ok(Duration::from_secs_f64(60.0 * m)),
            _ => Err(self.file.reject(minutes, "settle_min must be from 0 to 1440 minutes")),
        }
    }

    /// The names of all campaigns; each is a folder name, and all are unique.
    fn names(&self, campaigns: &[Spanned<CampaignTable>]) -> Result<Vec<String>, Refused> {
        let mut lines: BTreeMap<String, usize> = BTreeMap::new();
        let mut names = vec![];
        let mut right = Ok(());
        for table in campaigns {
            let flights = &table.get_ref().flights;
            let given = table.get_ref().name.as_ref();
            let of_folder =
                || self.folder.join(flights.get_ref()).file_name().map(|n| n.to_string_lossy().into_owned());
            let name = given.map(|name| name.get_ref().clone()).or_else(of_folder).unwrap_or_default();
            let line = given.map_or_else(|| self.file.line_of(flights), |name| self.file.line_of(name));
            let complain = |what: String| match given {
                Some(name) => self.file.reject(name, what),
                None => self.file.reject(flights, format!("{what}; give the campaign a `name`")),
            };
            let plain = |c: char| c.is_ascii_alphanumeric() || "._-".contains(c);
            if name.is_empty() || name.starts_with('.') || !name.chars().all(plain) {
                right = Err(complain(format!("name {name:?} must be letters, digits, `-`, `_` and `.`")));
            } else if TAKEN.contains(&name.as_str()) {
                right = Err(complain(format!("name {name:?} is reserved")));
            } else if let Some(other) = lines.insert(name.clone(), line) {
                right = Err(complain(format!("name {name:?} is already the name of the campaign on line {other}")));
            }
            names.push(name);
        }
        right.map(|()| names)
    }

    /// The request for a campaign. Its output folder follows from its name.
    fn order(
        &self,
        table: &CampaignTable,
        (pipeline, criteria): (Option<&Spanned<PathBuf>>, Option<&Spanned<PathBuf>>),
        settle: Duration,
    ) -> Result<Order, Refused> {
        let in_bucket = campaign::is_in_bucket(table.flights.get_ref());
        let flights = match in_bucket {
            true => table.flights.get_ref().clone(),
            false => self.folder.join(table.flights.get_ref()),
        };
        // A missing folder may be mounted by the next night; the campaign reports it.
        let there = match in_bucket || flights.is_dir() || !flights.exists() {
            true => Ok(()),
            false => Err(self.file.reject(&table.flights, format!("flights: {} is not a folder", flights.display()))),
        };
        let pipeline = table.pipeline.as_ref().or(pipeline);
        let criteria = table.criteria.as_ref().or(criteria);
        let settings = match pipeline {
            Some(at) => self.named_file(at, |path| Pipeline::read(path).map_err(campaign_error)),
            None => Pipeline::shipped_default().map_err(|e| self.file.reject_whole(e.to_string())),
        };
        let judged =
            criteria.map(|at| self.named_file(at, |path| Criteria::read(path).map_err(campaign_error))).transpose();
        there?;
        let maps = table.maps.as_ref().map(|maps| self.folder.join(maps));
        let settings = settings?.with_criteria(judged?).with_forced_map(table.map.clone()).with_maps_folder(maps);
        Ok(Order {
            command: command(&flights, pipeline, criteria),
            flights,
            out: PathBuf::new(),
            pipeline: settings,
            verify: false,
            replace: false,
            settle: Some(settle),
        })
    }

    /// The result of `read` for a file referred to here.
    fn named_file<T>(
        &self,
        at: &Spanned<PathBuf>,
        read: impl FnOnce(&Path) -> Result<T, HistoryError>,
    ) -> Result<T, Refused> {
        read(&self.folder.join(at.get_ref())).map_err(|e| self.file.reject(at, e.to_string()))
    }
}

/// Whether a path is a folder or below it.
fn is_within(path: &Path, folder: &Path) -> bool {
    let full = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    full(path).starts_with(full(folder))
}

fn campaign_error(error: impl Into<CampaignError>) -> HistoryError {
    HistoryError::Campaign(error.into())
}

/// The command that produces the same report by hand, with names instead of paths.
fn command(flights: &Path, pipeline: Option<&Spanned<PathBuf>>, criteria: Option<&Spanned<PathBuf>>) -> String {
    let name = |path: &Path| {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let plain = |c: char| c.is_ascii_alphanumeric() || "-_./:=@%+,".contains(c);
        match !name.is_empty() && name.chars().all(plain) && !name.starts_with('-') {
            true => name,
            false => format!("'{}'", name.replace('\'', "'\\''")),
        }
    };
    let mut command = format!("flightlag campaign {}", name(flights));
    for (option, file) in [("--pipeline", pipeline), ("--criteria", criteria)] {
        if let Some(file) = file {
            command += &format!(" {option} {}", name(file.get_ref()));
        }
    }
    command + " --out REPORT"
}

/// The JSON schema of a nightly file, as text.
#[cfg(feature = "schema")]
pub(crate) fn nightly_schema() -> String {
    let schema = schemars::schema_for!(NightlyFile);
    serde_json::to_string_pretty(&schema).map(|text| text + "\n").unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder() -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for name in ["may", "june"] {
            std::fs::create_dir(folder.path().join(name)).unwrap();
        }
        folder
    }

    #[test]
    fn paths_are_relative_to_the_file_and_names_follow_from_folders() {
        let folder = folder();
        let text = "schema = 1\nout = \"reports\"\nsettle_min = 5\n[[campaign]]\nflights = \"may\"\n\
                    [[campaign]]\nflights = \"june\"\nname = \"summer\"\n";
        let config = NightlyConfig::parse(text, &folder.path().join("n.toml")).unwrap();
        let names: Vec<&str> = config.campaigns.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, ["may", "summer"]);
        let order = &config.campaigns[1].1;
        assert_eq!(order.out, folder.path().join("reports/summer"));
        assert_eq!((order.settle, &order.flights), (Some(Duration::from_secs(300)), &folder.path().join("june")));
        assert_eq!(config.history, folder.path().join("reports/history"));
    }

    #[test]
    fn all_errors_are_reported_at_once_with_their_lines() {
        let folder = folder();
        std::fs::write(folder.path().join("p.toml"), "schema = 1\n[delay]\npositon_s = 0.4\nsource = \"x\"\n").unwrap();
        std::fs::write(folder.path().join("july"), "a file").unwrap();
        let text = "schema = 1\nout = \"reports\"\nsettle_min = -1\npipeline = \"p.toml\"\nfleet = \"none.toml\"\n\
                    [[campaign]]\nflights = \"may\"\n[[campaign]]\nflights = \"may\"\n[[campaign]]\nflights = \"july\"\n\
                    name = \"nights\"\nflihgts = 1\n";
        let error = NightlyConfig::parse(text, &folder.path().join("n.toml")).unwrap_err().to_string();
        for part in [
            "n.toml:3: settle_min must be from 0 to 1440 minutes",
            "p.toml:3: unknown key `positon_s`",
            "n.toml:5: ",
            "none.toml: cannot be read",
            "n.toml:9: name \"may\" is already the name of the campaign on line 7; give the campaign a `name`",
            "n.toml:11: flights: ",
            "july is not a folder",
            "n.toml:12: name \"nights\" is reserved",
            "n.toml:13: unknown key `flihgts`: did you mean `flights`?",
        ] {
            assert!(error.contains(part), "{part}\nis not in\n{error}");
        }
    }

    #[test]
    fn a_night_does_not_write_into_a_folder_of_logs() {
        let folder = folder();
        let text =
            "schema = 1\nout = \"may/reports\"\n[[campaign]]\nflights = \"june\"\n[[campaign]]\nflights = \"may\"\n";
        let error = NightlyConfig::parse(text, &folder.path().join("n.toml")).unwrap_err().to_string();
        assert!(
            error.ends_with("n.toml:2: out is inside the folder of logs may, which must not be written to"),
            "{error}"
        );
    }

    #[test]
    fn a_history_needs_its_own_folder() {
        let folder = folder();
        let history_of = |history: &str| {
            let text =
                format!("schema = 1\nout = \"reports\"\nhistory = \"{history}\"\n[[campaign]]\nflights = \"may\"\n");
            NightlyConfig::parse(&text, &folder.path().join("n.toml")).map(|config| config.history)
        };
        assert_eq!(history_of("years").unwrap(), folder.path().join("years"));
        let refused = |history: &str| history_of(history).unwrap_err().to_string();
        let of_report = "n.toml:3: history is inside the report of the campaign may: give it a separate folder";
        assert!(refused("reports/may/history").ends_with(of_report));
        let of_logs = "n.toml:3: history is inside the folder of logs may, which must not be written to";
        assert!(refused("may").ends_with(of_logs));
        assert!(refused("s3://bucket/history").ends_with("history must be a folder; only flights may be in a bucket"));
    }

    #[test]
    fn the_example_is_valid_except_for_its_folders() {
        let folder = tempfile::tempdir().unwrap();
        let error = NightlyConfig::parse(pipelines::EXAMPLE_NIGHTLY, &folder.path().join("nightly.toml"))
            .unwrap_err()
            .to_string();
        let others: Vec<&str> = error.lines().filter(|line| !line.contains("cannot be read")).collect();
        assert_eq!(others, [] as [&str; 0], "{error}");
    }
}
