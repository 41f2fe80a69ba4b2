//! Whole campaigns: one that shows every feature once, and one of any size.

use crate::damage::cut_off;
use crate::error::SimulateError;
use crate::sensor::{Interval, SensorSettings, Wander};
use crate::simulated::{FlightSettings, PathKind, simulate};
use crate::write::{
    BagCompression, BagSettings, Container, LogFile, McapCompression, McapEncoding, McapSettings, save,
};
use flight::{NANOS_PER_SECOND, Stamp};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Name of the truth file next to the demo's flights.
pub const TRUTH_FILE: &str = "truth.json";

/// Delay of every position of the demo, s.
const DELAY_S: f64 = 0.4;
/// Remaining share of the truncated flight.
const KEPT_SHARE: f64 = 0.6;
const MINUTE_S: f64 = 60.0;

/// Truth of the flights of a demo: content of [`TRUTH_FILE`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DemoManifest {
    /// Seed of all flights.
    pub seed: u64,
    /// Flights, sorted by path.
    pub flights: Vec<DemoFlight>,
}

/// Truth of a flight of the demo.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DemoFlight {
    /// Its file or folder, relative to the demo's folder; parts are separated by `/`.
    pub path: String,
    /// Format, as readable text.
    pub format: String,
    /// Duration, s.
    pub duration_s: f64,
    /// Kind of path.
    #[serde(flatten)]
    pub flown: PathKind,
    /// Delay of the position, s; positive is late.
    pub delay_s: f64,
    /// The position sensor.
    pub position: SensorSettings,
    /// The velocity sensor.
    pub velocity: SensorSettings,
    /// Remaining share of the file, if truncated.
    pub kept_share: Option<f64>,
    /// Delay, s, compensated by the aircraft in flight, if any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub onboard_delay_s: Option<f64>,
    /// Faults of the flight, as readable text.
    pub faults: Vec<String>,
}

/// Writes a campaign of twelve simulated flights, in folders by day and in all formats, with [`TRUTH_FILE`] next to
/// them. The same seed gives the same bytes.
///
/// Positions are 0.4 s late at 4, 5, 10 or 100 Hz; velocities are on time at 100 Hz (10 Hz in one flight). One flight
/// logs the compensated position computed by the aircraft, one has gaps, one is truncated, one never moves, one is a
/// wide table with held positions. Nothing else in `folder` is changed.
///
/// # Errors
/// [`SimulateError::Write`] with the first file that cannot be written.
pub fn write_demo(folder: &Path, seed: u64) -> Result<DemoManifest, SimulateError> {
    let mut flights = vec![];
    for (index, plan) in plans().into_iter().enumerate() {
        let number = index as u64 + 1;
        save(folder, &plan.files(seed.wrapping_mul(1000).wrapping_add(number), number)?)?;
        flights.push(plan.truth());
    }
    let manifest = DemoManifest { seed, flights };
    let bytes = serde_json::to_vec_pretty(&manifest)?;
    save(folder, &[LogFile { path: TRUTH_FILE.into(), bytes }])?;
    Ok(manifest)
}

/// Writes `flights` MCAP files of `seconds` each (CDR, zstd; position 5 Hz and 0.4 s late, velocity 100 Hz), named
/// `flight-0001.mcap` and so on, for performance measurements.
///
/// # Errors
/// [`SimulateError::Setting`] if `seconds` is out of range, [`SimulateError::Write`] with the first
/// file that cannot be written.
pub fn write_campaign(folder: &Path, flights: usize, seconds: f64, seed: u64) -> Result<(), SimulateError> {
    (1..=flights as u64).try_for_each(|number| {
        let settings = FlightSettings {
            duration_s: seconds,
            seed: seed.wrapping_mul(1_000_003).wrapping_add(number),
            start: take_off(number),
            position: late(5.0, 0.3),
            velocity: on_time(100.0, 0.1),
            ..FlightSettings::default()
        };
        let files = Container::Mcap(McapSettings::default());
        save(folder, &files.files(&simulate(&settings)?, &format!("flight-{number:04}"))?)
    })
}

/// A flight of the demo before it is simulated.
struct Plan {
    stem: &'static str,
    container: Container,
    format: &'static str,
    minutes: f64,
    path: PathKind,
    position: SensorSettings,
    velocity: SensorSettings,
    cut: bool,
    onboard: bool,
    faults: &'static [&'static str],
}

impl Plan {
    fn files(&self, seed: u64, number: u64) -> Result<Vec<LogFile>, SimulateError> {
        let settings = FlightSettings {
            path: self.path,
            duration_s: self.minutes * MINUTE_S,
            seed,
            start: take_off(number),
            position: self.position.clone(),
            velocity: self.velocity.clone(),
            onboard_delay_s: self.onboard.then_some(DELAY_S),
            ..FlightSettings::default()
        };
        let mut files = self.container.files(&simulate(&settings)?, self.stem)?;
        if self.cut {
            files.iter_mut().for_each(|file| cut_off(&mut file.bytes, KEPT_SHARE));
        }
        Ok(files)
    }

    fn truth(&self) -> DemoFlight {
        DemoFlight {
            path: self.container.path(self.stem).to_string_lossy().into_owned(),
            format: self.format.to_owned(),
            duration_s: self.minutes * MINUTE_S,
            flown: self.path,
            delay_s: self.position.delay_s,
            position: self.position.clone(),
            velocity: self.velocity.clone(),
            kept_share: self.cut.then_some(KEPT_SHARE),
            onboard_delay_s: self.onboard.then_some(DELAY_S),
            faults: self.faults.iter().map(|fault| (*fault).to_owned()).collect(),
        }
    }
}

/// Four flights a day from 2026-05-04 on, an hour apart.
fn take_off(number: u64) -> Stamp {
    let hours = (number - 1) / 4 * 24 + (number - 1) % 4;
    Stamp(FlightSettings::default().start.0 + hours as i64 * 3600 * NANOS_PER_SECOND)
}

fn late(rate_hz: f64, white_std: f64) -> SensorSettings {
    SensorSettings {
        delay_s: DELAY_S,
        white_std,
        log_latency_s: 0.008,
        log_jitter_s: 0.002,
        ..SensorSettings::clean(rate_hz)
    }
}

fn on_time(rate_hz: f64, white_std: f64) -> SensorSettings {
    SensorSettings { white_std, ..SensorSettings::clean(rate_hz) }
}

fn mcap(encoding: McapEncoding, compression: McapCompression) -> Container {
    Container::Mcap(McapSettings { encoding, compression, summary: true })
}

fn bag(compression: BagCompression) -> Container {
    Container::Bag(BagSettings { compression, indexed: true })
}

fn plan(stem: &'static str, container: Container, format: &'static str, minutes: f64) -> Plan {
    Plan {
        stem,
        container,
        format,
        minutes,
        path: PathKind::Circuit,
        position: late(5.0, 0.3),
        velocity: on_time(100.0, 0.1),
        cut: false,
        onboard: false,
        faults: &[],
    }
}

/// The campaign, day by day.
fn plans() -> Vec<Plan> {
    [first_day(), second_day(), third_day()].into_iter().flatten().collect()
}

fn first_day() -> [Plan; 4] {
    let cdr = mcap(McapEncoding::Cdr, McapCompression::Zstd);
    let ros1 = mcap(McapEncoding::Ros1, McapCompression::None);
    [
        plan("2026-05-04/flight-01", cdr, "MCAP, CDR, zstd", 4.0),
        Plan {
            position: late(10.0, 0.02),
            velocity: on_time(100.0, 0.05),
            onboard: true,
            ..plan("2026-05-04/flight-02", ros1, "MCAP, ROS 1, not compressed", 3.0)
        },
        plan("2026-05-04/flight-03", bag(BagCompression::Lz4Linked), "ROS 1 bag, LZ4", 5.0),
        Plan {
            position: late(4.0, 1.0),
            ..plan("2026-05-04/flight-04", bag(BagCompression::None), "ROS 1 bag, not compressed", 3.0)
        },
    ]
}

fn second_day() -> [Plan; 4] {
    let json = mcap(McapEncoding::Json, McapCompression::Zstd);
    [
        Plan {
            position: late(10.0, 0.1),
            faults: &["positions are held over the velocity's rows and have no timestamp of their own"],
            ..plan("2026-05-05/flight-05", Container::CsvWide, "CSV, one wide table", 4.0)
        },
        plan("2026-05-05/flight-06", Container::CsvFolder, "CSV, a table for each topic", 3.0),
        Plan { position: late(100.0, 0.1), ..plan("2026-05-05/flight-07", json, "MCAP, JSON, zstd", 3.0) },
        Plan {
            position: late(10.0, 0.02),
            velocity: on_time(10.0, 0.05),
            ..plan("2026-05-05/flight-08", bag(BagCompression::Bz2), "ROS 1 bag, bz2", 6.0)
        },
    ]
}

fn third_day() -> [Plan; 4] {
    let cdr = mcap(McapEncoding::Cdr, McapCompression::Zstd);
    [
        with_gaps(plan("2026-05-06/flight-09", cdr, "MCAP, CDR, zstd", 4.0)),
        Plan {
            cut: true,
            faults: &["the file is truncated to 60 % of its bytes"],
            ..plan("2026-05-06/flight-10", cdr, "MCAP, CDR, zstd", 4.0)
        },
        Plan {
            path: PathKind::Still,
            faults: &["the aircraft never moves: nothing to compensate"],
            ..plan("2026-05-06/flight-11", bag(BagCompression::Lz4Independent), "ROS 1 bag, LZ4", 3.0)
        },
        Plan {
            faults: &["timestamps jitter, 2 % of the positions are missing, both sensors wander and are biased"],
            ..worn(plan(
                "2026-05-06/flight-12",
                mcap(McapEncoding::Cdr, McapCompression::Unchunked),
                "MCAP, CDR, no chunks",
                3.0,
            ))
        },
    ]
}

fn with_gaps(plan: Plan) -> Plan {
    let gap = |from_s: f64, length_s: f64| Interval { from_s, to_s: from_s + length_s };
    Plan {
        // A gap that is bridged, one too long to bridge, and one in which both channels are missing.
        velocity: SensorSettings { gaps: vec![gap(50.0, 0.5), gap(90.0, 4.0), gap(170.0, 2.0)], ..plan.velocity },
        position: SensorSettings { gaps: vec![gap(130.0, 6.0), gap(170.0, 3.0)], ..plan.position },
        faults: &[
            "no velocity from 50.0 to 50.5, 90 to 94 and 170 to 172 s",
            "no position from 130 to 136 and 170 to 173 s",
        ],
        ..plan
    }
}

fn worn(plan: Plan) -> Plan {
    let wander = |std| Some(Wander { std, time_constant_s: 30.0 });
    Plan {
        position: SensorSettings { wander: wander(0.5), stamp_jitter_s: 0.002, drop_share: 0.02, ..plan.position },
        velocity: SensorSettings {
            wander: wander(0.03),
            bias: [0.03, -0.02, 0.01],
            stamp_jitter_s: 0.0005,
            ..plan.velocity
        },
        ..plan
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn the_demo_writes_the_truth_next_to_its_flights_and_stays_small() {
        let folder = tempfile::tempdir().unwrap();
        let manifest = write_demo(folder.path(), 1).unwrap();
        let text = fs::read_to_string(folder.path().join(TRUTH_FILE)).unwrap();
        assert_eq!(serde_json::from_str::<DemoManifest>(&text).unwrap(), manifest);
        let size = |path: &Path| fs::metadata(path).map_or(0, |data| data.len());
        let mut bytes = 0;
        for flight in &manifest.flights {
            let path = folder.path().join(&flight.path);
            let files: Vec<_> = if path.is_dir() {
                fs::read_dir(&path).unwrap().map(|entry| entry.unwrap().path()).collect()
            } else {
                vec![path]
            };
            let here: u64 = files.iter().map(|file| size(file)).sum();
            assert!(here > 100_000, "{}: {here} bytes", flight.path);
            assert!((180.0..=360.0).contains(&flight.duration_s) && flight.delay_s == 0.4);
            bytes += here;
        }
        assert!(bytes < 60_000_000, "{bytes}");
        assert_eq!(manifest.flights.len(), 12);
        assert_eq!(manifest.flights.iter().filter(|f| f.kept_share.is_some()).count(), 1);
        assert_eq!(manifest.flights.iter().filter(|f| f.flown == PathKind::Still).count(), 1);
        assert!(manifest.flights.windows(2).all(|pair| pair[0].path < pair[1].path));
    }

    #[test]
    fn a_large_campaign_has_the_requested_number_of_distinct_flights() {
        let folder = tempfile::tempdir().unwrap();
        write_campaign(folder.path(), 3, 10.0, 4).unwrap();
        let read = |n| fs::read(folder.path().join(format!("flight-000{n}.mcap"))).unwrap();
        assert!(read(1) != read(2) && read(2) != read(3));
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 3);
    }
}
