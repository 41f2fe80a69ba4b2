//! ROS 1 bags, version 2.0 (<http://wiki.ros.org/Bags/Format/2.0>), record by record.
//!
//! The index at the end is used only for its connections and counts. A bag whose recorder crashed has
//! no index, and reads the same.

mod bag_record;
mod bag_records;
mod connections;
mod index;

use self::bag_record::{Kind, LONGEST, MAGIC, Record};
use self::bag_records::{Records, WRONG_START};
use crate::error::LogError;
use crate::format::Reading;
use crate::reader::{Log, ReadContext, Select};
use logscan::{LogFile, Source, scan};
use std::path::PathBuf;

/// Reads a ROS 1 bag.
pub(crate) fn read(files: &[PathBuf], want: &dyn Select, context: &ReadContext<'_>) -> Result<Log, LogError> {
    let (mut file, Reading { name, mut ledger, mut notices, mut topics }) = Reading::open(files, want, context)?;
    let mut log = Log::default();
    check_version(&mut file, context)?;
    check_encryption(&mut file)?;
    let mut records = Records::new(&name, &file, context, &mut topics, &mut notices);
    scan(&mut file, &mut ledger, context, &mut records)?;
    log.health.undecodable = records.finish();
    log.health.format = "ROS 1 bag 2.0".to_owned();
    Reading { name, ledger, notices, topics }.conclude(log)
}

fn check_version(file: &mut LogFile, context: &ReadContext<'_>) -> Result<(), LogError> {
    let first = String::from_utf8_lossy(file.up_to(0, 16)?).into_owned();
    match first.strip_prefix("#ROSBAG V") {
        Some(version) if version.starts_with('1') => Err(LogError::NotALog {
            file: file.name().to_owned(),
            what: "a ROS bag of version 1, which is not supported; convert it with rosbag fix".to_owned(),
        }),
        _ => super::refuse_foreign(file, WRONG_START, context),
    }
}

/// The bag header of an encrypted bag names the plugin (rosbag, `Encryptor`): chunks and connections are not records.
fn check_encryption(file: &mut LogFile) -> Result<(), LogError> {
    let head = file.up_to(MAGIC.len() as u64, LONGEST)?;
    match Record::of(head).map(|record| record.kind) {
        Some(Kind::BagHeader { encryptor, .. }) if !encryptor.is_empty() => {
            let plugin = String::from_utf8_lossy(encryptor).into_owned();
            Err(LogError::NotALog {
                file: file.name().to_owned(),
                what: format!("an encrypted ROS bag ({plugin:.100}); decrypt it first"),
            })
        }
        _ => Ok(()),
    }
}
