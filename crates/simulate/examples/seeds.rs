//! Writes the seeds of the fuzz targets, one folder per target: seeds FOLDER

use simulate::{Container, LogFile, McapEncoding};
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
        if let Container::Mcap(settings) = seed.container {
            let folder = Path::new(&folder).join("definition");
            std::fs::create_dir_all(&folder)?;
            definitions(&seed.files[0].bytes, settings.encoding, &folder.join(seed.name))?;
        }
        if seed.name == "db3-folder" {
            bag_folder(&seed.files, &Path::new(&folder).join("bag-folder"))?;
        }
    }
    Ok(())
}

/// Length of the metadata, metadata, length of the database, database, its write-ahead log; in the target's format.
fn bag_folder(files: &[LogFile], folder: &Path) -> Result<(), Box<dyn Error>> {
    let named = |end: &str| files.iter().find(|file| file.path.to_string_lossy().ends_with(end));
    let (metadata, database) = (named(".yaml").ok_or("no metadata")?, named(".db3").ok_or("no database")?);
    let scratch = tempfile::tempdir()?;
    let path = scratch.path().join("log.db3");
    std::fs::write(&path, &database.bytes)?;
    let connection = rusqlite::Connection::open(&path)?;
    connection.execute_batch(
        "PRAGMA journal_mode = WAL; PRAGMA wal_autocheckpoint = 0;
        INSERT INTO messages SELECT NULL, topic_id, timestamp + 1, data FROM messages;
        DELETE FROM messages WHERE id < 5;",
    )?;
    let (before, ahead) = (std::fs::read(&path)?, std::fs::read(scratch.path().join("log.db3-wal"))?);
    let metadata_length = u16::try_from(metadata.bytes.len())?.to_le_bytes();
    let seed = |database: &[u8], ahead: &[u8]| {
        let length = u32::try_from(database.len())?.to_le_bytes();
        Ok::<_, Box<dyn Error>>([&metadata_length[..], &metadata.bytes, &length, database, ahead].concat())
    };
    std::fs::create_dir_all(folder)?;
    std::fs::write(folder.join("with-write-ahead-log"), seed(&before, &ahead)?)?;
    std::fs::write(folder.join("alone"), seed(&database.bytes, &[])?)?;
    Ok(())
}

/// A file for each channel: encoding, length of the definition, definition, first message; in the target's format.
fn definitions(mcap: &[u8], encoding: McapEncoding, stem: &Path) -> Result<(), Box<dyn Error>> {
    let encoding = match encoding {
        McapEncoding::Ros1 => 0,
        McapEncoding::Cdr => 1,
        McapEncoding::Idl => 2,
        McapEncoding::Protobuf => 3,
        McapEncoding::Json => 4,
    };
    for message in mcap::MessageStream::new(mcap)? {
        let message = message?;
        let definition = message.channel.schema.as_ref().map_or(&[][..], |schema| &schema.data);
        let length = u16::try_from(definition.len())?.to_le_bytes();
        let path = stem.with_extension(message.channel.id.to_string());
        if !path.exists() {
            std::fs::write(path, [&[encoding][..], &length, definition, &message.data].concat())?;
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
