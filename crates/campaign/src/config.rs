//! The pipeline file: as the user wrote it, then as it is meant.
//!
//! [`Pipeline::read`] turns a TOML file into settings whose every value is given and checked.
//! What is meant, not what is written, names the results: a comment or a default spelled out
//! changes nothing.

use compensation_replay::Settings;
use flight::Delay;
use record::{PipelineUse, StartRule};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use toml::Spanned;

/// The pipeline that is used when none is given: `pipelines/default.toml`, compiled in.
pub const DEFAULT_PIPELINE: &str = include_str!("../../../pipelines/default.toml");

/// The pipeline of the simulated campaign: `pipelines/demo.toml`, compiled in.
pub const DEMO_PIPELINE: &str = include_str!("../../../pipelines/demo.toml");

/// Longest delay that is taken for one, s; a larger number is a delay in milliseconds.
const LONGEST_DELAY_S: f64 = 10.0;

/// A pipeline file is wrong, and where.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}{}: {what}", file.display(), line.map(|l| format!(":{l}")).unwrap_or_default())]
pub struct PipelineError {
    /// The file.
    pub file: PathBuf,
    /// Line, from 1, where there is one.
    pub line: Option<usize>,
    /// What is wrong, and what would be right.
    pub what: String,
}

/// A pipeline as the user wrote it.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "flightlag pipeline")]
struct Written {
    /// Version of this file's layout: 1.
    #[schemars(with = "u32", range(min = 1, max = 1))]
    schema: Spanned<u32>,
    /// Name of this kind of campaign, for the pages.
    #[serde(default = "default_title")]
    title: String,
    /// The delay that is removed.
    delay: WrittenDelay,
    /// Which channels of a flight are used: the first of each list that the flight holds.
    #[serde(default)]
    channels: WrittenChannels,
    /// How the compensators run.
    #[serde(default)]
    replay: WrittenReplay,
    /// Where channel maps come from.
    #[serde(default)]
    maps: WrittenMaps,
}

#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct WrittenDelay {
    /// How late position is against velocity, s; positive means late.
    #[schemars(with = "f64", extend("exclusiveMinimum" = 0.0), range(max = 10.0))]
    position_s: Spanned<f64>,
    /// Its standard uncertainty (k = 1), s; leave out if it is not known.
    #[schemars(with = "Option<f64>")]
    standard_uncertainty_s: Option<Spanned<f64>>,
    /// Where the number comes from, in words; it is printed on every page.
    #[schemars(with = "String")]
    source: Spanned<String>,
}

#[derive(Debug, Clone, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct WrittenChannels {
    /// Late position, best first. Default: position.gps, position.ins, position.ekf.
    #[schemars(with = "Option<Vec<String>>")]
    position: Option<Spanned<Vec<String>>>,
    /// Velocity on time, best first. Default: velocity.ekf, velocity.ins, velocity.gps.
    #[schemars(with = "Option<Vec<String>>")]
    velocity: Option<Spanned<Vec<String>>>,
    /// Independent position to score against. Default: position.truth.
    #[schemars(with = "Option<Vec<String>>")]
    reference: Option<Spanned<Vec<String>>>,
}

#[derive(Debug, Clone, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct WrittenReplay {
    /// What a compensator assumes before its first sample. Default: warm.
    start: Option<WrittenStart>,
    /// Velocity gaps up to this long are bridged, s. Default: two delays, and at least 2.5 velocity intervals.
    #[schemars(with = "Option<f64>", range(min = 0.0, max = 600.0))]
    bridge_s: Option<Spanned<f64>>,
    /// A flight whose ground speed stays below this is not measurable, m/s. Default: 2.
    #[schemars(with = "Option<f64>", range(min = 0.0))]
    min_speed_mps: Option<Spanned<f64>>,
    /// Length of the zoom on the hardest manoeuvre, s. Default: 20.
    #[schemars(with = "Option<f64>")]
    zoom_s: Option<Spanned<f64>>,
    /// Rows at this rate instead of one for each velocity sample, Hz.
    #[schemars(with = "Option<f64>")]
    output_rate_hz: Option<Spanned<f64>>,
}

/// What a compensator assumes before its first sample.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
enum WrittenStart {
    /// The first velocity has always been flown.
    Warm,
    /// State zero.
    Cold,
    /// No output until one delay of velocity has been seen.
    InvalidUntilTd,
}

impl From<WrittenStart> for StartRule {
    fn from(written: WrittenStart) -> StartRule {
        match written {
            WrittenStart::Warm => StartRule::Warm,
            WrittenStart::Cold => StartRule::Cold,
            WrittenStart::InvalidUntilTd => StartRule::InvalidUntilTd,
        }
    }
}

#[derive(Debug, Clone, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct WrittenMaps {
    /// Folder with further channel maps, relative to this file.
    folder: Option<PathBuf>,
    /// Name of the map for every flight; leave out to let the log decide.
    force: Option<String>,
}

fn default_title() -> String {
    "Flight campaign".to_owned()
}

/// A pipeline as it is meant, in the layout of the file: every value given.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Meant {
    schema: u32,
    title: String,
    delay: MeantDelay,
    channels: MeantChannels,
    replay: MeantReplay,
    maps: MeantMaps,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
struct MeantDelay {
    position_s: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    standard_uncertainty_s: Option<f64>,
    source: String,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
struct MeantChannels {
    position: Vec<String>,
    velocity: Vec<String>,
    reference: Vec<String>,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
struct MeantReplay {
    start: StartRule,
    #[serde(skip_serializing_if = "Option::is_none")]
    bridge_s: Option<f64>,
    min_speed_mps: f64,
    zoom_s: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    output_rate_hz: Option<f64>,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
struct MeantMaps {
    #[serde(skip_serializing_if = "Option::is_none")]
    force: Option<String>,
}

/// Settings of a campaign, checked and complete.
#[derive(Debug, Clone, PartialEq)]
pub struct Pipeline {
    meant: Meant,
    delay: Delay,
    maps_folder: Option<PathBuf>,
    file_name: String,
}

impl Pipeline {
    /// Reads a pipeline file.
    ///
    /// # Errors
    /// The file cannot be read, is no TOML, has an unknown key, or a value makes no sense; with file and line.
    pub fn read(path: &Path) -> Result<Pipeline, PipelineError> {
        let unreadable = |e: std::io::Error| fault(path, None, format!("cannot be read: {e}"));
        let text = std::fs::read_to_string(path).map_err(unreadable)?;
        Pipeline::parse(&text, path)
    }

    /// The pipeline that is used when none is given.
    ///
    /// # Errors
    /// Never in a tested build: the text is compiled in, and a test reads it.
    pub fn shipped_default() -> Result<Pipeline, PipelineError> {
        Pipeline::parse(DEFAULT_PIPELINE, Path::new("default.toml"))
    }

    /// Reads a pipeline from `text`; `path` is for errors and for paths relative to the file.
    ///
    /// # Errors
    /// As [`Pipeline::read`].
    pub fn parse(text: &str, path: &Path) -> Result<Pipeline, PipelineError> {
        let written: Written = toml::from_str(text).map_err(|e| from_toml(&e, text, path))?;
        Checker { text, path }.meaning_of(written)
    }

    /// The same pipeline with another map forced on every flight.
    #[must_use]
    pub fn with_forced_map(mut self, name: Option<String>) -> Pipeline {
        self.meant.maps.force = name.or(self.meant.maps.force);
        self
    }

    /// The same pipeline with another folder of channel maps.
    #[must_use]
    pub fn with_maps_folder(mut self, folder: Option<PathBuf>) -> Pipeline {
        self.maps_folder = folder.or(self.maps_folder);
        self
    }

    /// Folder with further channel maps. Not part of the meaning: the content of the maps is.
    #[must_use]
    pub fn maps_folder(&self) -> Option<&Path> {
        self.maps_folder.as_deref()
    }

    /// Name of the file without its folder.
    #[must_use]
    pub fn file_name(&self) -> &str {
        &self.file_name
    }

    /// Name of the map that every flight is read with.
    #[must_use]
    pub fn forced_map(&self) -> Option<&str> {
        self.meant.maps.force.as_deref()
    }

    /// The settings for a record: title, hash and text of what is meant.
    #[must_use]
    pub fn as_used(&self) -> PipelineUse {
        let toml = toml::to_string(&self.meant).unwrap_or_else(|e| format!("# cannot be written: {e}\n"));
        PipelineUse {
            title: self.meant.title.clone(),
            blake3: blake3::hash(toml.as_bytes()).to_hex().to_string(),
            toml,
        }
    }

    /// The settings of the replay.
    #[must_use]
    pub fn replay_settings(&self) -> Settings {
        let Meant { delay, channels, replay, .. } = self.meant.clone();
        Settings {
            delay: self.delay,
            delay_uncertainty_s: delay.standard_uncertainty_s,
            delay_source: delay.source,
            start: replay.start,
            bridge_s: replay.bridge_s,
            min_speed_mps: replay.min_speed_mps,
            zoom_s: replay.zoom_s,
            output_rate_hz: replay.output_rate_hz,
            position: channels.position,
            velocity: channels.velocity,
            reference: channels.reference,
        }
    }
}

/// The JSON schema of a pipeline file, as text.
#[must_use]
pub fn pipeline_schema() -> String {
    let schema = schemars::schema_for!(Written);
    serde_json::to_string_pretty(&schema).map(|text| text + "\n").unwrap_or_default()
}

/// Which settings differ between two pipelines as they are meant, as `delay.position_s: was 0.4, is 0.35`.
#[must_use]
pub(crate) fn differences(was: &str, is: &str) -> Vec<String> {
    let flat = |text: &str| toml::from_str::<toml::Table>(text).map(|t| flatten(&t)).unwrap_or_default();
    let (was, is) = (flat(was), flat(is));
    let keys: std::collections::BTreeSet<&String> = was.keys().chain(is.keys()).collect();
    let shown = |v: Option<&String>| v.cloned().unwrap_or_else(|| "not given".to_owned());
    keys.into_iter()
        .filter(|k| was.get(*k) != is.get(*k))
        .map(|k| format!("{k}: was {}, is {}", shown(was.get(k)), shown(is.get(k))))
        .collect()
}

fn flatten(table: &toml::Table) -> std::collections::BTreeMap<String, String> {
    let mut flat = std::collections::BTreeMap::new();
    for (key, value) in table {
        match value.as_table() {
            Some(inner) => flat.extend(flatten(inner).into_iter().map(|(k, v)| (format!("{key}.{k}"), v))),
            None => {
                flat.insert(key.clone(), value.to_string());
            }
        }
    }
    flat
}

/// Knows the text, so that every complaint has its line.
struct Checker<'a> {
    text: &'a str,
    path: &'a Path,
}

impl Checker<'_> {
    fn meaning_of(&self, written: Written) -> Result<Pipeline, PipelineError> {
        if *written.schema.get_ref() != 1 {
            return Err(self.fault(&written.schema, "schema must be 1, the only layout that this flightlag knows"));
        }
        let delay = self.delay(&written.delay)?;
        let meant = Meant {
            schema: 1,
            title: written.title,
            channels: self.channels(written.channels)?,
            replay: self.replay(&written.replay)?,
            delay: self.delay_in_words(written.delay)?,
            maps: MeantMaps { force: written.maps.force },
        };
        let beside = self.path.parent().unwrap_or(Path::new(""));
        let file_name = self.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        Ok(Pipeline { meant, delay, maps_folder: written.maps.folder.map(|f| beside.join(f)), file_name })
    }

    fn delay(&self, written: &WrittenDelay) -> Result<Delay, PipelineError> {
        let seconds = *written.position_s.get_ref();
        let can_be_removed = seconds > 0.0 && seconds <= LONGEST_DELAY_S;
        Delay::from_seconds(seconds).filter(|_| can_be_removed).ok_or_else(|| {
            let what = "a delay is in seconds, above 0 (only a late position can be compensated) and up to 10";
            self.fault(&written.position_s, format!("delay.position_s = {seconds}: {what}"))
        })
    }

    fn delay_in_words(&self, written: WrittenDelay) -> Result<MeantDelay, PipelineError> {
        if written.source.get_ref().trim().is_empty() {
            return Err(self.fault(&written.source, "delay.source must say where the delay comes from"));
        }
        let uncertainty = written.standard_uncertainty_s.as_ref();
        let standard_uncertainty_s =
            uncertainty.map(|u| self.within(u, "delay.standard_uncertainty_s", 0.0, LONGEST_DELAY_S)).transpose()?;
        Ok(MeantDelay {
            position_s: plain_zero(*written.position_s.get_ref()),
            standard_uncertainty_s,
            source: written.source.into_inner(),
        })
    }

    fn channels(&self, written: WrittenChannels) -> Result<MeantChannels, PipelineError> {
        let position = ["position.gps", "position.ins", "position.ekf"];
        let velocity = ["velocity.ekf", "velocity.ins", "velocity.gps"];
        Ok(MeantChannels {
            position: self.names(written.position, "position", &position)?,
            velocity: self.names(written.velocity, "velocity", &velocity)?,
            reference: self.names(written.reference, "position", &["position.truth"])?,
        })
    }

    /// The channel names of a list; every one must hold `quantity`.
    fn names(
        &self,
        written: Option<Spanned<Vec<String>>>,
        quantity: &str,
        default: &[&str],
    ) -> Result<Vec<String>, PipelineError> {
        let Some(list) = written else { return Ok(default.iter().map(|&s| s.to_owned()).collect()) };
        let is_odd =
            |name: &&String| name.strip_prefix(quantity).and_then(|n| n.strip_prefix('.')).is_none_or(str::is_empty);
        match list.get_ref().iter().find(is_odd) {
            Some(odd) => {
                let what =
                    format!("channel `{odd}` is no {quantity}; names are `{quantity}.source`, as `{}`", default[0]);
                Err(self.fault(&list, what))
            }
            None => Ok(list.into_inner()),
        }
    }

    fn replay(&self, written: &WrittenReplay) -> Result<MeantReplay, PipelineError> {
        let value = |given: &Option<Spanned<f64>>, key: &str, low: f64, high: f64| {
            given.as_ref().map(|v| self.within(v, key, low, high)).transpose()
        };
        Ok(MeantReplay {
            start: written.start.unwrap_or(WrittenStart::Warm).into(),
            bridge_s: value(&written.bridge_s, "replay.bridge_s", 0.0, 600.0)?,
            min_speed_mps: value(&written.min_speed_mps, "replay.min_speed_mps", 0.0, 1000.0)?.unwrap_or(2.0),
            zoom_s: value(&written.zoom_s, "replay.zoom_s", 1.0, 3600.0)?.unwrap_or(20.0),
            output_rate_hz: value(&written.output_rate_hz, "replay.output_rate_hz", 1.0, 10_000.0)?,
        })
    }

    fn within(&self, value: &Spanned<f64>, key: &str, low: f64, high: f64) -> Result<f64, PipelineError> {
        let v = *value.get_ref();
        if (low..=high).contains(&v) {
            return Ok(plain_zero(v));
        }
        Err(self.fault(value, format!("{key} = {v}: must be from {low} to {high}")))
    }

    fn fault<T>(&self, at: &Spanned<T>, what: impl Into<String>) -> PipelineError {
        fault(self.path, Some(line_of(self.text, at.span().start)), what)
    }
}

fn fault(path: &Path, line: Option<usize>, what: impl Into<String>) -> PipelineError {
    PipelineError { file: path.to_owned(), line, what: what.into() }
}

/// The parser's own complaint, in our words and with its line.
fn from_toml(error: &toml::de::Error, text: &str, path: &Path) -> PipelineError {
    let what = error.message().replace("unknown field", "unknown key").replace("missing field", "missing key");
    fault(path, error.span().map(|s| line_of(text, s.start)), what)
}

fn line_of(text: &str, byte: usize) -> usize {
    text.bytes().take(byte).filter(|&b| b == b'\n').count() + 1
}

/// Minus zero is zero, and shall not name another result.
fn plain_zero(v: f64) -> f64 {
    if v == 0.0 { 0.0 } else { v }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Pipeline, PipelineError> {
        Pipeline::parse(text, Path::new("settings/p.toml"))
    }

    const SMALL: &str = "schema = 1\n[delay]\nposition_s = 0.4\nsource = \"bench\"\n";

    #[test]
    fn every_shipped_pipeline_is_right_and_names_its_source() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../pipelines");
        let files = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path());
        let pipelines: Vec<PathBuf> = files.filter(|p| p.extension().is_some_and(|e| e == "toml")).collect();
        assert!(pipelines.len() >= 3, "{pipelines:?}");
        for path in pipelines {
            let pipeline = Pipeline::read(&path).unwrap();
            assert!(!pipeline.replay_settings().delay_source.is_empty(), "{}", path.display());
        }
    }

    #[test]
    fn an_unknown_key_is_refused_with_file_line_and_the_keys_that_are_known() {
        let error = parse("schema = 1\n[delay]\nposition_s = 0.4\nsource = \"bench\"\npositon_s = 1\n").unwrap_err();
        let text = error.to_string();
        assert!(text.starts_with("settings/p.toml:5: unknown key `positon_s`"), "{text}");
        assert!(text.contains("`standard_uncertainty_s`"), "{text}");
    }

    #[test]
    fn a_delay_in_milliseconds_or_of_a_position_that_is_not_late_is_refused_with_its_line() {
        for delay in ["400", "0", "-0.5", "nan", "inf"] {
            let error = parse(&SMALL.replace("0.4", delay)).unwrap_err();
            assert_eq!(error.line, Some(3));
            assert!(error.what.contains("in seconds, above 0"), "{error}");
        }
    }

    #[test]
    fn a_value_that_makes_no_sense_is_refused_with_its_line() {
        for (line, number) in [
            ("[replay]\nbridge_s = -1.0", 6),
            ("[replay]\nzoom_s = nan", 6),
            ("[channels]\nvelocity = [\"position.gps\"]", 6),
            ("[channels]\nposition = [\"position.\"]", 6),
            ("[replay]\nstart = \"lukewarm\"", 6),
        ] {
            let error = parse(&format!("{SMALL}{line}\n")).unwrap_err();
            assert_eq!(error.line, Some(number), "{line}: {error}");
        }
        assert_eq!(parse(&SMALL.replace("schema = 1", "schema = 2")).unwrap_err().line, Some(1));
        assert_eq!(parse("schema = 1\n[delay]\nposition_s = 0.4\nsource = \" \"\n").unwrap_err().line, Some(4));
    }

    #[test]
    fn a_default_spelled_out_or_a_comment_means_the_same() {
        let spelled = format!(
            "# a comment\n{SMALL}[replay]\nzoom_s = 20\nstart = \"warm\"\n[channels]\nreference = [\"position.truth\"]\n"
        );
        assert_eq!(parse(SMALL).unwrap().as_used(), parse(&spelled).unwrap().as_used());
    }

    #[test]
    fn what_is_meant_is_itself_a_pipeline_with_the_same_meaning() {
        let meant = parse(SMALL).unwrap().with_forced_map(Some("mavros".into())).as_used();
        assert_eq!(parse(&meant.toml).unwrap().as_used(), meant);
    }

    #[test]
    fn a_changed_setting_is_named_with_what_it_was() {
        let was = parse(SMALL).unwrap().as_used().toml;
        let is = parse(&SMALL.replace("0.4", "0.35")).unwrap().as_used().toml;
        let changed = differences(&was, &is);
        assert_eq!(changed, ["delay.position_s: was 0.4, is 0.35"]);
    }

    #[test]
    fn maps_are_found_beside_the_pipeline_file() {
        let pipeline = parse(&format!("{SMALL}[maps]\nfolder = \"maps\"\n")).unwrap();
        assert_eq!(pipeline.maps_folder(), Some(Path::new("settings/maps")));
    }

    /// `FLIGHTLAG_BLESS=1` writes it anew.
    #[test]
    fn the_schema_file_is_the_schema_of_the_code() {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../pipelines/pipeline.schema.json");
        if std::env::var_os("FLIGHTLAG_BLESS").is_some() {
            std::fs::write(&file, pipeline_schema()).unwrap();
        }
        assert_eq!(std::fs::read_to_string(&file).unwrap(), pipeline_schema());
    }
}
