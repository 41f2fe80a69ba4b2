//! Writes flights as logs of every format, for `just perf`: `perf_logs DIR [SECONDS]`. A long flight with almost only
//! relevant data (default: a quarter of an hour), and one half as long that also has a camera and a laser scanner.

use simulate::{
    BagCompression, BagSettings, Container, Db3Settings, FlightSettings, LogFile, McapCompression, McapSettings,
    SensorSettings, SimulateError, SimulatedFlight, simulate,
};
use std::error::Error;
use std::path::{Path, PathBuf};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = PathBuf::from(arguments.next().ok_or("usage: perf_logs DIR [SECONDS]")?);
    let duration_s = arguments.next().map_or(Ok(900.0), |s| s.parse())?;
    let mcap = |compression| Container::Mcap(McapSettings { compression, ..McapSettings::default() });
    let bag = |compression| Container::Bag(BagSettings { compression, ..BagSettings::default() });
    let ros = [
        ("mcap-zstd", mcap(McapCompression::Zstd)),
        ("mcap-lz4", mcap(McapCompression::Lz4)),
        ("mcap-none", mcap(McapCompression::None)),
        ("bag-lz4", bag(BagCompression::Lz4Linked)),
        ("bag-none", bag(BagCompression::None)),
        ("db3", Container::Db3(Db3Settings::default())),
    ];
    let others = [
        ("bag-bz2", bag(BagCompression::Bz2)),
        ("ulog", Container::Ulog),
        ("dataflash", Container::DataFlash),
        ("csv", Container::CsvWide),
    ];
    let flight = flown(duration_s)?;
    for (name, container) in ros.into_iter().chain(others) {
        save(&folder, container.files(&flight, name)?)?;
    }
    let flight = flown(duration_s / 2.0)?;
    for (name, container) in ros {
        save(&folder, container.files_with_camera(&flight, &format!("camera-{name}"), false)?)?;
    }
    save(&folder, mcap(McapCompression::Zstd).files_with_camera(&flight, "camera-mcap-split", true)?)
}

fn flown(duration_s: f64) -> Result<SimulatedFlight, SimulateError> {
    let position = SensorSettings { delay_s: 0.4, white_std: 0.3, ..SensorSettings::clean(100.0) };
    let velocity = SensorSettings { white_std: 0.1, ..SensorSettings::clean(200.0) };
    simulate(&FlightSettings { duration_s, position, velocity, ..FlightSettings::default() })
}

fn save(folder: &Path, files: Vec<LogFile>) -> Result<(), Box<dyn Error>> {
    for file in files {
        let path = folder.join(&file.path);
        path.parent().map_or(Ok(()), std::fs::create_dir_all)?;
        std::fs::write(path, &file.bytes)?;
    }
    Ok(())
}
