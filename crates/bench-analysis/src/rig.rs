//! The resolved rig file: every value given and validated, or left open to be fitted.
//!
//! Results are named by the resolved values, not by the text: a comment or an explicit default changes nothing.

use crate::kinematics::rotation;
use crate::rig_file::{
    AnalysisTable, BarTable, CardTable, ClockTable, EncoderTable, MountTable, RigFile, SiteTable, StatedField,
};
use nalgebra::Matrix3;
use record::{RigUse, SensorIdentity};
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use settings::{Refused, SettingsError, SettingsFile, plain_zero};
use std::path::Path;
use toml::Spanned;

/// The default rig: `pipelines/bench.rig.toml`, compiled in.
pub const DEFAULT_RIG: &str = pipelines::DEFAULT_RIG;

/// Position of the sensor on the bar at bar angle zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum MountKind {
    /// Above the pivot: lever arm (0, 0, -length), as Park & Lee 2010.
    Upright,
    /// Below the pivot, sensor upright: lever arm (0, 0, +length).
    Hanging,
    /// Every `mount` entry gives its lever arm.
    Custom,
}

impl std::fmt::Display for MountKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            MountKind::Upright => "upright",
            MountKind::Hanging => "hanging",
            MountKind::Custom => "custom",
        })
    }
}

/// The bar.
#[derive(Debug, Clone, PartialEq)]
pub struct Bar {
    /// Pivot to sensor, m.
    pub length_m: f64,
    /// Position of the sensor on the bar.
    pub mount: MountKind,
    /// Azimuth of the swing's plane, rad; `None` means fitted.
    pub azimuth_rad: Option<f64>,
    /// First expected bending mode, Hz.
    pub first_mode_hz: Option<f64>,
}

/// The encoder.
#[derive(Debug, Clone, PartialEq)]
pub struct EncoderRule {
    /// Its channel; `None` means the only one of the log.
    pub channel: Option<String>,
    /// Counts per revolution: lines times decoding; `None` means inferred.
    pub counts_per_rev: Option<f64>,
    /// Counts per line.
    pub decoding: f64,
    /// +1 or −1; `None` means fitted.
    pub sign: Option<f64>,
    /// Bar angle at count zero, rad; `None` means fitted.
    pub zero_rad: Option<f64>,
}

/// Source of the reference's magnetic field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FieldRule {
    /// Fitted.
    Fit,
    /// World Magnetic Model.
    Wmm,
    /// North, east, down, T.
    Stated([f64; 3]),
}

/// The site.
#[derive(Debug, Clone, PartialEq)]
pub struct Site {
    /// Latitude, rad.
    pub latitude: Option<f64>,
    /// Longitude, rad.
    pub longitude: Option<f64>,
    /// Height above the ellipsoid, m.
    pub height_m: f64,
    /// Day of the record, if the log does not state it.
    pub date: Option<jiff::civil::Date>,
    /// Gravity, m/s².
    pub gravity_mps2: Option<f64>,
    /// Magnetic field.
    pub field: FieldRule,
}

/// Relation of the clocks.
#[derive(Debug, Clone, PartialEq)]
pub struct ClockRule {
    /// Whether one clock timestamps both logs; `None`: inferred from the logs.
    pub shared: Option<bool>,
    /// Channel assumed to be on time if clocks differ; `None`: the first angular rate logged by the sensor.
    pub anchor: Option<String>,
    /// Timestamps used for the measurement.
    pub stamps: StampChoice,
}

/// Kind of timestamps of the sensor that is used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum StampChoice {
    /// The kind that the channel map states.
    Auto,
    /// Time at which the value was true, according to the device.
    Measured,
    /// Time at which the driver sent it.
    Published,
    /// Time at which the logger received it.
    Logged,
}

/// Settings of the delay search.
#[derive(Debug, Clone, PartialEq)]
pub struct AnalysisRule {
    /// Start and end, s.
    pub search_s: (f64, f64),
    /// Margin of the equivalence test, s; `None`: per channel half of its update interval, at least 5 ms.
    pub margin_s: Option<f64>,
    /// Whether the offsets of position, velocity and height may drift.
    pub drift: bool,
    /// Delays to inject and recover, s.
    pub inject_s: Vec<f64>,
    /// Gain to inject with them.
    pub inject_gain: f64,
}

/// Position and orientation of a part of the sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct Mount {
    /// From the pivot, body axes, m.
    pub lever_arm_m: [f64; 3],
    /// Whether the file states the lever arm for this part (otherwise it follows from the bar).
    pub arm_is_stated: bool,
    /// Rotation vector of the mount, sensor axes (after `axes`) to body axes, rad.
    pub rotation_rad: [f64; 3],
    /// Sensor axes of body x, y, z: 0 to 2 and the sign.
    pub axes: [(usize, f64); 3],
}

impl Mount {
    /// The matrix that rotates sensor readings into body axes: `exp([φ]×)` times the axes map.
    #[must_use]
    pub fn body_from_sensor(&self) -> Matrix3<f64> {
        rotation(self.rotation_rad) * axes_matrix(self.axes)
    }
}

fn axes_matrix(axes: [(usize, f64); 3]) -> Matrix3<f64> {
    let mut matrix = Matrix3::zeros();
    for (row, (axis, sign)) in axes.into_iter().enumerate() {
        matrix[(row, axis)] = sign;
    }
    matrix
}

/// A resolved bench.
#[derive(Debug, Clone, PartialEq)]
pub struct Rig {
    /// Name of the bench.
    pub title: String,
    /// The sensor on it.
    pub sensor: SensorIdentity,
    /// The bar.
    pub bar: Bar,
    /// The encoder.
    pub encoder: EncoderRule,
    /// The site.
    pub site: Site,
    /// Stamps.
    pub clock: ClockRule,
    /// Delays.
    pub analysis: AnalysisRule,
    /// Validity of a card in days; `None`: no end.
    pub card_valid_days: Option<u32>,
    mounts: Vec<(Vec<String>, Mount)>,
    resolved: Resolved,
}

impl Rig {
    /// Reads a rig file.
    ///
    /// # Errors
    /// The file cannot be read, is not valid TOML, has an unknown key, or a value is invalid; with file and line.
    pub fn read(path: &Path) -> Result<Rig, SettingsError> {
        Rig::parse(&settings::read_text(path)?, path)
    }

    /// The default rig.
    ///
    /// # Errors
    /// Never in a tested build: the text is compiled in, and a test reads it.
    pub fn shipped_default() -> Result<Rig, SettingsError> {
        Rig::parse(DEFAULT_RIG, Path::new("bench.rig.toml"))
    }

    /// Reads a rig from `text`; `path` is used in errors.
    ///
    /// # Errors
    /// As [`Rig::read`].
    pub fn parse(text: &str, path: &Path) -> Result<Rig, SettingsError> {
        let file = SettingsFile::new(text, path);
        let resolved = file.read().and_then(|written| Checker { file: &file }.resolve(written));
        file.finish(resolved)
    }

    /// Position of the part of the sensor that provides `channel`: from the first `mount` entry that names the channel;
    /// the default is on the bar's axis at its length.
    #[must_use]
    pub fn mount_of(&self, channel: &str) -> Mount {
        let named = |(patterns, _): &&(Vec<String>, Mount)| patterns.iter().any(|p| fits(p, channel));
        self.mounts.iter().find(named).map_or_else(|| mount_on_bar(&self.bar), |(_, mount)| mount.clone())
    }

    /// The rig for a record: title, hash and text of the resolved values.
    #[must_use]
    pub fn as_used(&self) -> RigUse {
        let toml = toml::to_string(&self.resolved).unwrap_or_else(|e| format!("# cannot be written: {e}\n"));
        RigUse { title: self.title.clone(), blake3: blake3::hash(toml.as_bytes()).to_hex().to_string(), toml }
    }
}

/// Whether `name` equals `pattern`, or starts with the part before its final `*`.
fn fits(pattern: &str, name: &str) -> bool {
    match pattern.strip_suffix('*') {
        Some(start) => name.starts_with(start),
        None => name == pattern,
    }
}

fn mount_on_bar(bar: &Bar) -> Mount {
    let z = if bar.mount == MountKind::Hanging { bar.length_m } else { -bar.length_m };
    Mount {
        lever_arm_m: [0.0, 0.0, z],
        arm_is_stated: false,
        rotation_rad: [0.0; 3],
        axes: [(0, 1.0), (1, 1.0), (2, 1.0)],
    }
}

/// The resolved values, in the layout of the file.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Resolved {
    schema: u32,
    title: String,
    sensor: SensorIdentity,
    bar: ResolvedBar,
    encoder: ResolvedEncoder,
    site: ResolvedSite,
    clock: ResolvedClock,
    analysis: ResolvedAnalysis,
    card: ResolvedCard,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    mount: Vec<ResolvedMount>,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
struct ResolvedBar {
    length_m: f64,
    mount: MountKind,
    #[serde(skip_serializing_if = "Option::is_none")]
    azimuth_deg: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    first_mode_hz: Option<f64>,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
struct ResolvedEncoder {
    #[serde(skip_serializing_if = "Option::is_none")]
    channel: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    counts_per_rev: Option<u32>,
    decoding: u32,
    #[serde(skip_serializing_if = "Option::is_none")]
    sign: Option<i32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    zero_deg: Option<f64>,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
struct ResolvedSite {
    #[serde(skip_serializing_if = "Option::is_none")]
    latitude_deg: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    longitude_deg: Option<f64>,
    height_m: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    date: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    gravity_mps2: Option<f64>,
    field: ResolvedField,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
enum ResolvedField {
    Named(&'static str),
    Stated { north_nt: f64, east_nt: f64, down_nt: f64 },
}

impl ResolvedField {
    fn rule(&self) -> FieldRule {
        match self {
            ResolvedField::Named("wmm") => FieldRule::Wmm,
            ResolvedField::Named(_) => FieldRule::Fit,
            ResolvedField::Stated { north_nt, east_nt, down_nt } => {
                FieldRule::Stated([north_nt, east_nt, down_nt].map(|nt| nt * 1e-9))
            }
        }
    }
}

#[derive(Debug, Clone, PartialEq, Serialize)]
struct ResolvedClock {
    #[serde(skip_serializing_if = "Option::is_none")]
    shared: Option<bool>,
    #[serde(skip_serializing_if = "Option::is_none")]
    anchor: Option<String>,
    stamps: StampChoice,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
struct ResolvedAnalysis {
    search_s: [f64; 2],
    #[serde(skip_serializing_if = "Option::is_none")]
    margin_ms: Option<f64>,
    drift: bool,
    inject_ms: Vec<f64>,
    inject_gain: f64,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
struct ResolvedCard {
    #[serde(skip_serializing_if = "Option::is_none")]
    valid_days: Option<u32>,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
struct ResolvedMount {
    channels: Vec<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    lever_arm_m: Option<[f64; 3]>,
    rotation_deg: [f64; 3],
    axes: [String; 3],
}

/// Holds the file, so that every error has its line.
struct Checker<'a> {
    file: &'a SettingsFile<'a>,
}

impl Checker<'_> {
    fn resolve(&self, written: RigFile) -> Result<Rig, Refused> {
        self.file.known_layout(&written.schema)?;
        let model = match written.sensor.get_ref().model.trim() {
            "" => Err(self.fault(&written.sensor, "sensor.model must name the sensor, such as `Xsens MTi-G`")),
            _ => Ok(()),
        };
        let lever_arms = self.a_custom_bar_has_lever_arms(&written);
        let (bar, encoder) = (self.bar(&written.bar), self.encoder(written.encoder));
        let (site, clock) = (self.site(&written.site), self.clock(written.clock));
        let (analysis, card) = (self.analysis(&written.analysis), self.card(&written.card));
        let mounts: Vec<_> = written.mount.into_iter().map(|m| self.mount(m)).collect();
        model.and(lever_arms)?;
        let resolved = Resolved {
            schema: 1,
            title: written.title,
            sensor: written.sensor.into_inner(),
            bar: bar?,
            encoder: encoder?,
            site: site?,
            clock: clock?,
            analysis: analysis?,
            card: card?,
            mount: mounts.into_iter().collect::<Result<_, _>>()?,
        };
        Ok(in_si(resolved))
    }

    /// Without a length along the bar's axis every channel needs its own lever arm.
    fn a_custom_bar_has_lever_arms(&self, written: &RigFile) -> Result<(), Refused> {
        if *written.bar.mount.get_ref() != MountKind::Custom {
            return Ok(());
        }
        if let Some(without) = written.mount.iter().find(|m| m.lever_arm_m.is_none()) {
            return Err(self.fault(&without.channels, "bar.mount = \"custom\": this mount needs its lever_arm_m"));
        }
        let covers_all = |m: &MountTable| m.channels.get_ref().iter().any(|c| c == "*");
        if written.mount.iter().any(covers_all) {
            return Ok(());
        }
        let what = "bar.mount = \"custom\" needs a last [[mount]] with channels = [\"*\"] and its lever_arm_m";
        Err(self.fault(&written.bar.mount, what))
    }

    fn bar(&self, written: &BarTable) -> Result<ResolvedBar, Refused> {
        let length_m = self.file.within(&written.length_m, "bar.length_m", 0.05, 50.0);
        let azimuth_deg = self.file.optional(&written.azimuth_deg, "bar.azimuth_deg", -360.0, 360.0);
        let first_mode_hz = self.file.optional(&written.first_mode_hz, "bar.first_mode_hz", 0.1, 1000.0);
        Ok(ResolvedBar {
            length_m: length_m?,
            mount: *written.mount.get_ref(),
            azimuth_deg: azimuth_deg?,
            first_mode_hz: first_mode_hz?,
        })
    }

    fn encoder(&self, written: EncoderTable) -> Result<ResolvedEncoder, Refused> {
        let counts_per_rev = written.counts_per_rev.map(|c| {
            self.one_of(&c, "encoder.counts_per_rev", (4..=67_108_864).contains(c.get_ref()), "4 to 67108864")
        });
        let decoding =
            written.decoding.map(|d| self.one_of(&d, "encoder.decoding", [1, 2, 4].contains(d.get_ref()), "1, 2 or 4"));
        let sign = written.sign.map(|s| self.one_of(&s, "encoder.sign", matches!(s.get_ref(), -1 | 1), "1 or -1"));
        let zero_deg = self.file.optional(&written.zero_deg, "encoder.zero_deg", -360.0, 360.0);
        Ok(ResolvedEncoder {
            channel: written.channel,
            counts_per_rev: counts_per_rev.transpose()?,
            decoding: decoding.transpose()?.unwrap_or(1),
            sign: sign.transpose()?,
            zero_deg: zero_deg?,
        })
    }

    fn site(&self, written: &SiteTable) -> Result<ResolvedSite, Refused> {
        let day = |date: &Spanned<String>| match date.get_ref().parse::<jiff::civil::Date>() {
            Ok(day) => Ok(day.to_string()),
            Err(_) => {
                Err(self.fault(date, format!("site.date = {:?}: must be a day such as 2010-10-25", date.get_ref())))
            }
        };
        let latitude_deg = self.file.optional(&written.latitude_deg, "site.latitude_deg", -90.0, 90.0);
        let longitude_deg = self.file.optional(&written.longitude_deg, "site.longitude_deg", -180.0, 360.0);
        let height_m = self.file.optional(&written.height_m, "site.height_m", -1000.0, 10_000.0);
        let date = written.date.as_ref().map(day).transpose();
        let gravity_mps2 = self.file.optional(&written.gravity_mps2, "site.gravity_mps2", 9.7, 9.9);
        let field = written.field.as_ref().map(|f| self.field(f)).transpose();
        Ok(ResolvedSite {
            latitude_deg: latitude_deg?,
            longitude_deg: longitude_deg?,
            height_m: height_m?.unwrap_or(0.0),
            date: date?,
            gravity_mps2: gravity_mps2?,
            field: field?.unwrap_or(ResolvedField::Named("fit")),
        })
    }

    fn field(&self, written: &Spanned<toml::Value>) -> Result<ResolvedField, Refused> {
        let right = "must be \"fit\", \"wmm\" or { north_nt = …, east_nt = …, down_nt = … }";
        match written.get_ref() {
            toml::Value::String(name) if name == "fit" => Ok(ResolvedField::Named("fit")),
            toml::Value::String(name) if name == "wmm" => Ok(ResolvedField::Named("wmm")),
            toml::Value::Table(_) => {
                let stated: StatedField = written.get_ref().clone().try_into().map_err(|e: toml::de::Error| {
                    self.fault(written, format!("site.field: {}; it {right}", e.message()))
                })?;
                let size = stated.north_nt.hypot(stated.east_nt).hypot(stated.down_nt);
                if !(1_000.0..=1_000_000.0).contains(&size) {
                    return Err(
                        self.fault(written, format!("site.field is {size} nT: the Earth's field is 22000 to 67000 nT"))
                    );
                }
                let StatedField { north_nt, east_nt, down_nt } = stated;
                Ok(ResolvedField::Stated {
                    north_nt: plain_zero(north_nt),
                    east_nt: plain_zero(east_nt),
                    down_nt: plain_zero(down_nt),
                })
            }
            other => Err(self.fault(written, format!("site.field = {other}: {right}"))),
        }
    }

    fn clock(&self, written: ClockTable) -> Result<ResolvedClock, Refused> {
        let anchor = match written.anchor {
            Some(name) if name.get_ref().trim().is_empty() => {
                return Err(self.fault(&name, "clock.anchor must name a channel, such as `angular-rate.imu`"));
            }
            name => name.map(Spanned::into_inner),
        };
        let stamps = written.stamps.unwrap_or(StampChoice::Auto);
        Ok(ResolvedClock { shared: written.shared, anchor, stamps })
    }

    fn analysis(&self, written: &AnalysisTable) -> Result<ResolvedAnalysis, Refused> {
        let search_s = self.search_s(written.search_s.as_ref());
        let inject_ms = self.inject_ms(written.inject_ms.as_ref());
        let margin_ms = self.file.optional(&written.margin_ms, "analysis.margin_ms", 0.01, 1000.0);
        let inject_gain = self.file.optional(&written.inject_gain, "analysis.inject_gain", 0.5, 2.0);
        Ok(ResolvedAnalysis {
            search_s: search_s?,
            margin_ms: margin_ms?,
            drift: written.drift.unwrap_or(true),
            inject_ms: inject_ms?,
            inject_gain: inject_gain?.unwrap_or(1.05),
        })
    }

    fn search_s(&self, written: Option<&Spanned<[f64; 2]>>) -> Result<[f64; 2], Refused> {
        let Some(given) = written else { return Ok([-1.0, 1.5]) };
        let [from, to] = *given.get_ref();
        if from < to && from >= -10.0 && to <= 10.0 {
            return Ok([plain_zero(from), plain_zero(to)]);
        }
        let what = format!("analysis.search_s = [{from}, {to}]: must be from, to in seconds, within -10 to 10");
        Err(self.fault(given, what))
    }

    fn inject_ms(&self, written: Option<&Spanned<Vec<f64>>>) -> Result<Vec<f64>, Refused> {
        let Some(given) = written else { return Ok(vec![5.0, 50.0]) };
        match given.get_ref().iter().find(|ms| !(-1000.0..=1000.0).contains(*ms)) {
            Some(odd) => {
                let what = format!("analysis.inject_ms holds {odd} ms: must be from -1000 to 1000 ms");
                Err(self.fault(given, what))
            }
            None => Ok(given.get_ref().iter().map(|ms| plain_zero(*ms)).collect()),
        }
    }

    fn card(&self, written: &CardTable) -> Result<ResolvedCard, Refused> {
        let days =
            |d: &Spanned<u32>| self.one_of(d, "card.valid_days", (1..=36_500).contains(d.get_ref()), "1 to 36500");
        Ok(ResolvedCard { valid_days: written.valid_days.as_ref().map(days).transpose()? })
    }

    fn mount(&self, written: MountTable) -> Result<ResolvedMount, Refused> {
        let names = written.channels.get_ref();
        let is_odd = |n: &&String| n.is_empty() || n[..n.len() - 1].contains('*');
        let named = match names.is_empty() || names.iter().any(|n| is_odd(&n)) {
            true => {
                let what = "mount.channels must name channels, such as `position.ins`, `position.*` or `*`";
                Err(self.fault(&written.channels, what))
            }
            false => Ok(()),
        };
        let vector = |given: &Option<Spanned<[f64; 3]>>, key: &str, limit: f64| match given {
            None => Ok(None),
            Some(v) if v.get_ref().iter().all(|x| x.abs() <= limit) => Ok(Some(v.get_ref().map(plain_zero))),
            Some(v) => Err(self.fault(v, format!("{key}: three numbers from {} to {limit}", -limit))),
        };
        let lever_arm_m = vector(&written.lever_arm_m, "mount.lever_arm_m", 50.0);
        let rotation_deg = vector(&written.rotation_deg, "mount.rotation_deg", 360.0);
        let axes = self.axes(written.axes.as_ref());
        named?;
        Ok(ResolvedMount {
            lever_arm_m: lever_arm_m?,
            rotation_deg: rotation_deg?.unwrap_or([0.0; 3]),
            axes: axes?,
            channels: written.channels.into_inner(),
        })
    }

    /// Three different axes that form a right-handed frame.
    fn axes(&self, written: Option<&Spanned<[String; 3]>>) -> Result<[String; 3], Refused> {
        let Some(written) = written else { return Ok(["x", "y", "z"].map(str::to_owned)) };
        let parsed = written.get_ref().clone().map(|a| axis(&a));
        let [Some(x), Some(y), Some(z)] = parsed else {
            return Err(self.fault(written, "mount.axes: each must be x, y, z, -x, -y or -z"));
        };
        if (axes_matrix([x, y, z]).determinant() - 1.0).abs() > 1e-9 {
            let what = "mount.axes are not a right-handed frame of three axes: a sensor cannot be mounted this way";
            return Err(self.fault(written, what));
        }
        Ok(written.get_ref().clone())
    }

    fn one_of<T: Copy + std::fmt::Display>(
        &self,
        value: &Spanned<T>,
        key: &str,
        is_right: bool,
        right: &str,
    ) -> Result<T, Refused> {
        let v = *value.get_ref();
        if is_right { Ok(v) } else { Err(self.fault(value, format!("{key} = {v}: must be {right}"))) }
    }

    fn fault<T>(&self, at: &Spanned<T>, what: impl Into<String>) -> Refused {
        self.file.reject(at, what)
    }
}

/// Converts the units of the file to SI and radians.
fn in_si(resolved: Resolved) -> Rig {
    let bar = Bar {
        length_m: resolved.bar.length_m,
        mount: resolved.bar.mount,
        azimuth_rad: resolved.bar.azimuth_deg.map(f64::to_radians),
        first_mode_hz: resolved.bar.first_mode_hz,
    };
    let decoding = f64::from(resolved.encoder.decoding);
    Rig {
        title: resolved.title.clone(),
        sensor: resolved.sensor.clone(),
        encoder: EncoderRule {
            channel: resolved.encoder.channel.clone(),
            counts_per_rev: resolved.encoder.counts_per_rev.map(|lines| f64::from(lines) * decoding),
            decoding,
            sign: resolved.encoder.sign.map(f64::from),
            zero_rad: resolved.encoder.zero_deg.map(f64::to_radians),
        },
        site: Site {
            latitude: resolved.site.latitude_deg.map(f64::to_radians),
            longitude: resolved.site.longitude_deg.map(f64::to_radians),
            height_m: resolved.site.height_m,
            date: resolved.site.date.as_ref().and_then(|d| d.parse().ok()),
            gravity_mps2: resolved.site.gravity_mps2,
            field: resolved.site.field.rule(),
        },
        clock: ClockRule {
            shared: resolved.clock.shared,
            anchor: resolved.clock.anchor.clone(),
            stamps: resolved.clock.stamps,
        },
        analysis: AnalysisRule {
            search_s: resolved.analysis.search_s.into(),
            margin_s: resolved.analysis.margin_ms.map(|ms| ms / 1e3),
            drift: resolved.analysis.drift,
            inject_s: resolved.analysis.inject_ms.iter().map(|ms| ms / 1e3).collect(),
            inject_gain: resolved.analysis.inject_gain,
        },
        card_valid_days: resolved.card.valid_days,
        mounts: resolved.mount.iter().map(|m| (m.channels.clone(), mount_in_si(m, &bar))).collect(),
        bar,
        resolved,
    }
}

fn mount_in_si(resolved: &ResolvedMount, bar: &Bar) -> Mount {
    let on_bar = mount_on_bar(bar);
    let sensor_axis = |k: usize| axis(&resolved.axes[k]).unwrap_or((k, 1.0));
    Mount {
        lever_arm_m: resolved.lever_arm_m.unwrap_or(on_bar.lever_arm_m),
        arm_is_stated: resolved.lever_arm_m.is_some(),
        rotation_rad: resolved.rotation_deg.map(f64::to_radians),
        axes: [sensor_axis(0), sensor_axis(1), sensor_axis(2)],
    }
}

/// `-y` is axis 1 reversed.
fn axis(name: &str) -> Option<(usize, f64)> {
    let (sign, letter) = name.strip_prefix('-').map_or((1.0, name), |rest| (-1.0, rest));
    let index = ["x", "y", "z"].iter().position(|a| *a == letter)?;
    Some((index, sign))
}
