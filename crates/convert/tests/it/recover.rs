//! What is good of a log, and nothing else, comes out.

use crate::flight::{in_context, read, unit, write};
use convert::{ConvertError, How, Recovered, recover};
use ingest::{Selection, Table, TopicInfo};
use simulate::{BagCompression, BagSettings, Container, McapSettings, cut_off, zero_block};
use std::path::Path;

fn recovered(log: &Path, out: &Path) -> Result<Recovered, ConvertError> {
    in_context(|context| recover(&unit(log), out, context))
}

fn containers() -> [Container; 3] {
    let bag = |compression| Container::Bag(BagSettings { compression, ..BagSettings::default() });
    [Container::Mcap(McapSettings::default()), bag(BagCompression::None), bag(BagCompression::Lz4Linked)]
}

#[test]
fn an_intact_log_comes_out_with_the_same_channels_to_the_bit() {
    for container in containers() {
        let folder = tempfile::tempdir().unwrap();
        let log = write(container, folder.path());
        let out = folder.path().join("out.mcap");
        let report = recovered(&log, &out).unwrap();
        assert_eq!((report.how, report.any_loss()), (How::Copied, false));
        assert!(report.topics.iter().all(|t| t.found == t.written && t.written > 0), "{:?}", report.topics);
        let (before, after) = (read(&log), read(&out));
        assert_eq!(before.flight.channels, after.flight.channels, "{container:?}");
        assert_eq!(std::fs::metadata(&out).unwrap().len(), report.bytes);
    }
}

#[test]
fn all_that_is_good_of_a_damaged_log_comes_out_and_the_rest_is_told() {
    for container in containers() {
        let folder = tempfile::tempdir().unwrap();
        let log = write(container, folder.path());
        let mut bytes = std::fs::read(&log).unwrap();
        cut_off(&mut bytes, 0.8);
        zero_block(&mut bytes, 0.5, 600);
        std::fs::write(&log, &bytes).unwrap();
        let before = read(&log);
        assert!(before.health.bytes.damaged > 0 && before.health.messages > 0);
        let out = folder.path().join("out.mcap");
        let report = recovered(&log, &out).unwrap();
        assert!(report.any_loss());
        assert_eq!(report.topics.iter().map(|t| t.written).sum::<u64>(), before.health.messages);
        let after = read(&out);
        assert!(!after.flight.notices.any_loss(), "{:?}", after.flight.notices);
        assert_eq!(before.flight.channels, after.flight.channels, "{container:?}");
    }
}

#[test]
fn formats_whose_messages_mean_nothing_elsewhere_come_out_as_typed_tables() {
    for container in [Container::Ulog, Container::DataFlash] {
        let folder = tempfile::tempdir().unwrap();
        let log = write(container, folder.path());
        let out = folder.path().join("out.mcap");
        let report = recovered(&log, &out).unwrap();
        assert_eq!((report.how, report.any_loss()), (How::Rewritten, false), "{:?}", report.notices);
        assert!(report.topics.iter().all(|t| t.found == t.written), "{:?}", report.topics);
        let (before, after) = (tables(&log), tables(&out));
        assert_eq!(before.len(), after.len());
        for (table, twin) in before.iter().zip(&after) {
            assert_eq!(
                (&table.topic.name, table.rows, &table.logged_ns),
                (&twin.topic.name, twin.rows, &twin.logged_ns)
            );
            // Columns keep their order, whatever ROS allows as their names.
            let sum = |t: &Table| -> Vec<f64> {
                let of = |c: &ingest::Column| (0..t.rows).filter_map(|r| c.number(r)).filter(|x| x.is_finite()).sum();
                let mut sums: Vec<f64> = t.columns.iter().map(of).collect();
                sums.sort_by(f64::total_cmp);
                sums
            };
            assert_eq!(sum(table), sum(twin), "{}", table.topic.name);
        }
    }
}

fn tables(log: &Path) -> Vec<Table> {
    let unit = unit(log);
    in_context(|c| ingest::open(&unit).read(&|_: &TopicInfo| Selection::All, c)).unwrap().tables
}

#[test]
fn text_the_log_itself_and_a_log_without_a_message_are_refused_and_nothing_is_left() {
    let folder = tempfile::tempdir().unwrap();
    let csv = write(Container::CsvWide, folder.path());
    let out = folder.path().join("out.mcap");
    assert!(recovered(&csv, &out).unwrap_err().to_string().contains("flightlag export"));
    let mcap = write(Container::Mcap(McapSettings::default()), folder.path());
    assert!(recovered(&mcap, &mcap).unwrap_err().to_string().contains("the log itself"));
    let bytes = std::fs::read(&mcap).unwrap();
    std::fs::write(&mcap, &bytes[..40]).unwrap();
    assert!(recovered(&mcap, &out).is_err());
    let left: Vec<String> = std::fs::read_dir(folder.path())
        .unwrap()
        .map(|e| e.unwrap().file_name().to_string_lossy().into_owned())
        .filter(|name| name.contains("flightlag-tmp") || name == "out.mcap")
        .collect();
    assert!(left.is_empty(), "{left:?}");
}
