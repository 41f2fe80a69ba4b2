//! Writes one long flight as a log of every format, for `just perf`: `perf_logs DIR [SECONDS]`, half an hour if not said.

use simulate::{
    BagCompression, BagSettings, Container, Db3Settings, FlightSettings, McapCompression, McapSettings, SensorSettings,
    simulate,
};
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = PathBuf::from(arguments.next().ok_or("usage: perf_logs DIR [SECONDS]")?);
    let duration_s = arguments.next().map_or(Ok(1800.0), |s| s.parse())?;
    let position = SensorSettings { delay_s: 0.4, white_std: 0.3, ..SensorSettings::clean(100.0) };
    let velocity = SensorSettings { white_std: 0.1, ..SensorSettings::clean(200.0) };
    let flight = simulate(&FlightSettings { duration_s, position, velocity, ..FlightSettings::default() })?;
    let mcap = |compression| Container::Mcap(McapSettings { compression, ..McapSettings::default() });
    let bag = |compression| Container::Bag(BagSettings { compression, ..BagSettings::default() });
    let logs = [
        ("mcap-zstd", mcap(McapCompression::Zstd)),
        ("mcap-lz4", mcap(McapCompression::Lz4)),
        ("mcap-none", mcap(McapCompression::None)),
        ("bag-lz4", bag(BagCompression::Lz4Linked)),
        ("bag-none", bag(BagCompression::None)),
        ("bag-bz2", bag(BagCompression::Bz2)),
        ("db3", Container::Db3(Db3Settings::default())),
        ("ulog", Container::Ulog),
        ("dataflash", Container::DataFlash),
        ("csv", Container::CsvWide),
    ];
    for (name, container) in logs {
        for file in container.files(&flight, name)? {
            let path = folder.join(&file.path);
            path.parent().map_or(Ok(()), std::fs::create_dir_all)?;
            std::fs::write(path, &file.bytes)?;
        }
    }
    Ok(())
}
