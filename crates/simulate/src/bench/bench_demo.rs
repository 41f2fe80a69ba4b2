//! Bench records that show every feature once.

use super::bar::{FlexibleBar, Mount};
use super::bench_samples::SimulatedBench;
use super::quantity::BenchChannel;
use super::rig::{RigText, day};
use super::settings::{BenchClocks, BenchSensor, BenchSettings, ClockError, Pulses};
use super::simulate_bench;
use super::swing::Swing;
use crate::demo::TRUTH_FILE;
use crate::error::SimulateError;
use crate::write::{BagSettings, Container, LogFile, McapSettings, save};
use flight::{NANOS_PER_SECOND, Stamp};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// Truth of the bench records of a demo: content of [`TRUTH_FILE`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BenchDemo {
    /// Seed of all records.
    pub seed: u64,
    /// Records, in the order of recording.
    pub records: Vec<BenchDemoRecord>,
}

/// Truth of a bench record of a demo. Paths are relative to the demo's folder, their parts separated by `/`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BenchDemoRecord {
    /// Short name.
    pub name: String,
    /// The rig file.
    pub rig: String,
    /// The log of the encoder.
    pub encoder: String,
    /// The log of the sensor: the same if one log has both.
    pub sensor: String,
    /// Format, as readable text.
    pub format: String,
    /// UTC day, `yyyy-mm-dd`.
    pub date: String,
    /// Model of the sensor.
    pub model: String,
    /// Serial number of the sensor.
    pub serial: String,
    /// Seconds of swing.
    pub swing_s: f64,
    /// Seconds of rest before and after.
    pub rest_s: [f64; 2],
    /// Kind of motion.
    pub swing: Swing,
    /// Direction in which counts rise with the bar's angle.
    pub encoder_sign: f64,
    /// Bar angle at count zero, rad.
    pub encoder_zero_rad: f64,
    /// Azimuth of the swing plane from north over east, rad.
    pub azimuth_rad: f64,
    /// Bending of the bar; absent if it is stiff.
    pub flexible: Option<FlexibleBar>,
    /// The clocks other than the encoder's.
    pub clocks: BenchClocks,
    /// The channels by name.
    pub channels: BTreeMap<String, BenchSensor>,
    /// Faults of the record, as readable text.
    pub faults: Vec<String>,
}

/// Writes five bench records with their rig files (`NAME.rig.toml`), and [`TRUTH_FILE`] next to them. The same seed
/// gives the same bytes. Nothing else in `folder` is changed.
///
/// Three records of one sensor on three days: a 4 Hz position, 0.4 s late and held in 100 Hz rows, as MCAP, as bag and
/// as one wide table. A second sensor with a 100 Hz position, 0.4 s late, its encoder in a separate log with a separate
/// clock, on a bar that bends. The first sensor once more, under a pushed, hanging bar. Each record of the first
/// sensor, whose magnetometer has hard and soft iron, has another azimuth; the second sensor has one record.
///
/// # Errors
/// [`SimulateError::Write`] with the first file that cannot be written.
pub fn write_bench_demo(folder: &Path, seed: u64) -> Result<BenchDemo, SimulateError> {
    let mut records = vec![];
    for (index, plan) in plans().into_iter().enumerate() {
        let settings = BenchSettings {
            seed: seed.wrapping_mul(1000).wrapping_add(index as u64 + 1),
            start: Stamp(BenchSettings::default().start.0 + index as i64 * DAY_NS + HOUR_NS),
            ..plan.settings.clone()
        };
        let bench = simulate_bench(&settings)?;
        let (files, record) = plan.files(&bench)?;
        save(folder, &files)?;
        records.push(record);
    }
    let demo = BenchDemo { seed, records };
    save(folder, &[LogFile { path: TRUTH_FILE.into(), bytes: serde_json::to_vec_pretty(&demo)? }])?;
    Ok(demo)
}

const HOUR_NS: i64 = 3600 * NANOS_PER_SECOND;
const DAY_NS: i64 = 24 * HOUR_NS;
const MCAP: Container = Container::Mcap(McapSettings {
    encoding: crate::write::McapEncoding::Cdr,
    compression: crate::write::McapCompression::Zstd,
    summary: true,
});

/// A record of the demo before it is simulated.
struct Plan {
    name: &'static str,
    serial: &'static str,
    settings: BenchSettings,
    format: &'static str,
    /// Paths of the one log, or of encoder and sensor.
    logs: Logs,
    to_be_fitted: bool,
    faults: &'static [&'static str],
}

#[derive(Clone, Copy)]
enum Logs {
    One(Container),
    Two { encoder: Container, sensor: Container },
}

impl Plan {
    fn files(&self, bench: &SimulatedBench) -> Result<(Vec<LogFile>, BenchDemoRecord), SimulateError> {
        let path = |container: Container, stem: &str| container.path(stem).to_string_lossy().into_owned();
        let (mut files, encoder, sensor) = match self.logs {
            Logs::One(container) => {
                let log = path(container, self.name);
                (bench.files(container, self.name)?, log.clone(), log)
            }
            Logs::Two { encoder, sensor } => {
                let stems = ["encoder", "sensor"].map(|part| format!("{}-{part}", self.name));
                let mut files = bench.encoder_files(encoder, &stems[0])?;
                files.extend(bench.sensor_files(sensor, &stems[1])?);
                (files, path(encoder, &stems[0]), path(sensor, &stems[1]))
            }
        };
        let rig = format!("{}.rig.toml", self.name);
        let text = RigText { model: MODEL.to_owned(), serial: self.serial.to_owned(), to_be_fitted: self.to_be_fitted };
        files.push(LogFile { path: rig.clone().into(), bytes: bench.rig_text(&text).into_bytes() });
        Ok((files, self.truth(bench, rig, encoder, sensor)))
    }

    fn truth(&self, bench: &SimulatedBench, rig: String, encoder: String, sensor: String) -> BenchDemoRecord {
        let s = &bench.settings;
        BenchDemoRecord {
            name: self.name.to_owned(),
            rig,
            encoder,
            sensor,
            format: self.format.to_owned(),
            date: day(s.start.0),
            model: MODEL.to_owned(),
            serial: self.serial.to_owned(),
            swing_s: s.swing_s,
            rest_s: s.rest_s,
            swing: s.swing,
            encoder_sign: s.encoder.sign,
            encoder_zero_rad: s.encoder.zero_rad,
            azimuth_rad: s.bar.azimuth_rad,
            flexible: s.bar.flexible,
            clocks: s.clocks,
            channels: s.sensor.iter().map(|(channel, sensor)| (channel.name().to_owned(), sensor.clone())).collect(),
            faults: self.faults.iter().map(|fault| (*fault).to_owned()).collect(),
        }
    }
}

/// A battery next to the magnetometer, and a steel screw.
const HARD_IRON_T: [f64; 3] = [12e-6, -7e-6, 20e-6];
const SOFT_IRON: [[f64; 3]; 3] = [[1.05, 0.02, -0.03], [0.01, 0.97, 0.04], [-0.02, 0.03, 1.01]];

const MODEL: &str = "Simulated MTi-G";
const FIRST: &str = "SIM-0001";
const SECOND: &str = "SIM-0002";

fn plans() -> [Plan; 5] {
    let plan = |name, logs, format| Plan {
        name,
        serial: FIRST,
        settings: placed(BenchSettings::default()),
        format,
        logs,
        to_be_fitted: false,
        faults: &[],
    };
    [
        plan("gps-1", Logs::One(MCAP), "MCAP, CDR, zstd"),
        Plan {
            settings: lossy(at_azimuth(165.0, placed(BenchSettings::default()))),
            faults: &["2 % of the rows are missing, timestamps of the encoder jitter by 0.2 ms"],
            ..plan("gps-2", Logs::One(Container::Bag(BagSettings::default())), "ROS 1 bag, not compressed")
        },
        Plan {
            settings: turned(placed(BenchSettings::default())),
            to_be_fitted: true,
            faults: &["the rig file does not state azimuth, sign or zero of the encoder"],
            ..plan("gps-3", Logs::One(Container::CsvWide), "CSV, one wide table")
        },
        Plan {
            serial: SECOND,
            settings: two_clocks(placed(BenchSettings::ins())),
            faults: &["encoder and sensor have separate logs and clocks", "the bar bends at 5 Hz"],
            ..plan("ins", Logs::Two { encoder: Container::CsvWide, sensor: MCAP }, "CSV and MCAP, CDR, zstd")
        },
        Plan {
            settings: hanging(at_azimuth(75.0, BenchSettings::default())),
            faults: &["a free pendulum: hardly any signal along the sensor's first accelerometer axis"],
            ..plan("hanging", Logs::One(MCAP), "MCAP, CDR, zstd")
        },
    ]
}

/// The inertial part is slightly below the end of the bar, where the antenna is; two channels are slow.
fn placed(mut settings: BenchSettings) -> BenchSettings {
    let [x, y, z] = settings.bar.lever_arm_m();
    let inner = [x, y, z - 0.02 * z.signum()];
    for (channel, sensor) in &mut settings.sensor {
        let gps = matches!(channel, BenchChannel::PositionGps | BenchChannel::PositionIns);
        sensor.lever_arm_m = (!gps).then_some(inner);
        match channel {
            BenchChannel::MagneticField => {
                sensor.sampling.delay_s = 0.012;
                sensor.sampling.bias = HARD_IRON_T;
                sensor.soft_iron = Some(SOFT_IRON);
            }
            BenchChannel::Height => sensor.lags_s = vec![0.15],
            _ => {}
        }
    }
    settings
}

fn at_azimuth(azimuth_deg: f64, mut settings: BenchSettings) -> BenchSettings {
    settings.bar.azimuth_rad = azimuth_deg.to_radians();
    settings
}

fn lossy(mut settings: BenchSettings) -> BenchSettings {
    settings.sensor.values_mut().for_each(|sensor| sensor.sampling.drop_share = 0.02);
    settings.encoder.sampling.stamp_jitter_s = 0.0002;
    settings
}

fn turned(mut settings: BenchSettings) -> BenchSettings {
    settings.encoder.sign = -1.0;
    settings.encoder.zero_rad = 17.3_f64.to_radians();
    settings.bar.azimuth_rad = (-52.0_f64).to_radians();
    settings
}

fn two_clocks(mut settings: BenchSettings) -> BenchSettings {
    settings.encoder.lines = 2000;
    settings.encoder.decoding = 4;
    settings.encoder.sampling.rate_hz = 200.0;
    settings.bar.flexible = Some(FlexibleBar::of_tip_mass(1.0, 5.0, 0.02));
    settings.clocks = BenchClocks {
        device: Some(ClockError { offset_s: 417.25, skew: 25e-6 }),
        logger: ClockError { offset_s: 0.38, skew: -4e-6 },
    };
    for sensor in settings.sensor.values_mut() {
        sensor.sampling.log_latency_s = 0.006;
        sensor.sampling.log_jitter_s = 0.0008;
    }
    settings
}

fn hanging(mut settings: BenchSettings) -> BenchSettings {
    settings.bar.mount = Mount::Hanging;
    settings.swing = Swing::pushed();
    settings.pulses = Some(Pulses { stamp_jitter_s: 5e-6, drop_share: 0.0 });
    placed(settings)
}
