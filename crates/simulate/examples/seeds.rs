//! Writes the seeds of the fuzz targets, a folder for each target: seeds FOLDER

use simulate::Container;
use std::error::Error;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args_os().nth(1).ok_or("usage: seeds FOLDER")?;
    for seed in simulate::seeds()? {
        for target in [target_of(seed.container), "flight"] {
            let folder = Path::new(&folder).join(target);
            std::fs::create_dir_all(&folder)?;
            for file in &seed.files {
                let name = file.path.to_string_lossy().replace('/', "-");
                std::fs::write(folder.join(name), &file.bytes)?;
            }
        }
    }
    Ok(())
}

fn target_of(container: Container) -> &'static str {
    match container {
        Container::CsvWide | Container::CsvFolder => "csv",
        Container::Mcap(_) => "mcap",
        Container::Bag(_) => "bag",
        Container::Ulog => "ulog",
        Container::DataFlash | Container::DataFlashText => "dataflash",
        Container::Db3(_) => "db3",
        Container::Nmea => "nmea",
        Container::Ubx => "ubx",
        Container::Tlog => "tlog",
    }
}
