//! ROS 1 bags whose definitions lack types that they refer to, as rosjava writes them.

use crate::made::{OnDisk, notice};
use crate::support::read_files;
use ingest::{Limits, Log, MapLibrary};
use simulate::{BagCompression, BagSettings, Container, FlightSettings};

const SEPARATOR: &str = "\n================================================================================\n";

fn u32_at(bytes: &[u8], at: usize) -> usize {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize
}

/// A length-prefixed text.
fn counted(content: &[u8]) -> Vec<u8> {
    [&(content.len() as u32).to_le_bytes()[..], content].concat()
}

/// Header and data of each record.
fn records(mut bytes: &[u8]) -> Vec<(&[u8], &[u8])> {
    let mut all = vec![];
    while !bytes.is_empty() {
        let data_at = 4 + u32_at(bytes, 0);
        let end = data_at + 4 + u32_at(bytes, data_at);
        all.push((&bytes[4..data_at], &bytes[data_at + 4..end]));
        bytes = &bytes[end..];
    }
    all
}

fn fields(mut header: &[u8]) -> Vec<(String, Vec<u8>)> {
    let mut all = vec![];
    while !header.is_empty() {
        let end = 4 + u32_at(header, 0);
        let equals = header.iter().position(|&byte| byte == b'=').unwrap();
        all.push((String::from_utf8(header[4..equals].to_vec()).unwrap(), header[equals + 1..end].to_vec()));
        header = &header[end..];
    }
    all
}

/// The data of a connection, each field as `change` makes it.
fn changed(data: &[u8], change: &dyn Fn(&str, String) -> String) -> Vec<u8> {
    let entry = |(name, value): (String, Vec<u8>)| {
        let value = change(&name, String::from_utf8(value).unwrap());
        counted(format!("{name}={value}").as_bytes())
    };
    fields(data).into_iter().flat_map(entry).collect()
}

/// A flight as a bag without chunks, the fields of its connections as `change` makes them.
fn flight_with(change: &dyn Fn(&str, String) -> String) -> Log {
    let flight = simulate::simulate(&FlightSettings { duration_s: 5.0, ..FlightSettings::default() }).unwrap();
    let settings = BagSettings { compression: BagCompression::None, indexed: false };
    let files = Container::Bag(settings).files(&flight, "f").unwrap();
    let (magic, rest) = files[0].bytes.split_at(13);
    let op = |header: &[u8]| fields(header).into_iter().find(|(name, _)| name == "op").unwrap().1[0];
    let all = records(rest);
    let (first, chunks) = all.split_first().unwrap();
    let mut bag = [magic, &counted(first.0), &counted(first.1)].concat();
    for (header, data) in chunks.iter().filter(|(header, _)| op(header) == 5).flat_map(|(_, data)| records(data)) {
        let data = if op(header) == 7 { changed(data, change) } else { data.to_vec() };
        bag.extend(counted(header));
        bag.extend(counted(&data));
    }
    read(&bag, &MapLibrary::default())
}

fn read(bag: &[u8], library: &MapLibrary) -> Log {
    read_files(Limits::default(), ingest::LogKind::Bag, &[OnDisk::new(bag, true).path()], &library.select_all())
        .unwrap()
}

/// A definition without the part of one type.
fn without(definition: &str, type_name: &str) -> String {
    let is_other = |part: &&str| !part.starts_with(&format!("MSG: {type_name}\n"));
    definition.split(SEPARATOR).filter(is_other).collect::<Vec<_>>().join(SEPARATOR)
}

#[test]
fn a_bag_whose_definitions_lack_the_header_reads_as_the_intact_one() {
    let intact = flight_with(&|_, value| value);
    assert!(intact.tables.len() >= 2);
    assert!(intact.notices.iter().all(|notice| notice.code == "incomplete-recording"), "{:?}", intact.notices);
    let own_text = |text: &str| text.split(SEPARATOR).next().unwrap().to_owned();
    let lacking: [&dyn Fn(&str) -> String; 3] =
        [&|text| without(text, "std_msgs/Header"), &own_text, &|_| String::new()];
    // One topic has messages without a header, `std_msgs/String`.
    for (lack, headless) in lacking.into_iter().zip([1, 1, 0]) {
        let log = flight_with(&|name, value| if name == "message_definition" { lack(&value) } else { value });
        assert_eq!(log.tables, intact.tables);
        assert_eq!(notice(&log, "definition-supplied").count, intact.tables.len() as u64 - headless);
        assert!(log.health.topics.iter().all(|topic| topic.decoded), "{:?}", log.health.topics);
    }
}

#[test]
fn a_definition_that_fails_its_md5_sum_is_rejected_with_topic_and_type() {
    let log = flight_with(&|name, value| match name {
        "message_definition" => without(&value, "std_msgs/Header"),
        "md5sum" => value.replace("2d3a8cd499b9b4a0249fb98fd05cfa48", "2d3a8cd499b9b4a0249fb98fd05cfa49"),
        _ => value,
    });
    let intact = flight_with(&|_, value| value);
    let (fixes, others): (Vec<_>, Vec<_>) =
        intact.tables.into_iter().partition(|table| table.topic.type_name == "sensor_msgs/NavSatFix");
    assert!(!fixes.is_empty() && log.tables == others);
    let text = &notice(&log, "not-decoded").text;
    for part in [
        "the definition of sensor_msgs/NavSatFix lacks std_msgs/Header",
        "the MD5 sum of the completed definition is 2d3a8cd499b9b4a0249fb98fd05cfa48, but the log states 2d3a8cd499b9b4a0249fb98fd05cfa49",
        fixes[0].topic.name.as_str(),
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    for fix in fixes {
        let topic = log.health.topics.iter().find(|topic| topic.name == fix.topic.name).unwrap();
        assert_eq!((topic.decoded, topic.messages), (false, fix.rows as u64));
    }
}

#[test]
fn a_definition_without_an_md5_sum_is_not_completed() {
    let log = flight_with(&|name, value| match name {
        "message_definition" => without(&value, "std_msgs/Header"),
        "md5sum" => "*".to_owned(),
        _ => value,
    });
    // The only complete type.
    assert!(log.tables.iter().all(|table| table.topic.type_name == "std_msgs/String"), "{:?}", log.health.topics);
    assert!(notice(&log, "not-decoded").text.contains("the log states no MD5 sum"));
}

/// A bag with one message of `my_msgs/Own`, and what a folder with this definition of `my_msgs/Part` makes of it.
fn own_type(own: &str, part: &str) -> Log {
    let folder = tempfile::tempdir().unwrap();
    let msg = folder.path().join("my_msgs/msg");
    std::fs::create_dir_all(&msg).unwrap();
    std::fs::write(msg.join("Part.msg"), part).unwrap();
    std::fs::write(msg.join("Own.msg"), OWN).unwrap();
    let record = |fields: &[(&str, &[u8])], data: &[u8]| {
        let field = |(name, value): &(&str, &[u8])| counted(&[name.as_bytes(), b"=", value].concat());
        [counted(&fields.iter().flat_map(field).collect::<Vec<u8>>()), counted(data)].concat()
    };
    let about = [("type", "my_msgs/Own"), ("md5sum", OWN_SUM), ("message_definition", own)];
    let about: Vec<u8> = about.iter().flat_map(|(name, value)| counted(format!("{name}={value}").as_bytes())).collect();
    let message = [
        &7_u32.to_le_bytes()[..],
        &[1, 0, 0, 0, 0, 0, 0, 0],
        &counted(b"map"),
        &2_u32.to_le_bytes(),
        &[0.5_f32.to_le_bytes().as_slice(), &2.0_f64.to_le_bytes()].concat(),
        &[1.5_f32.to_le_bytes().as_slice(), &3.0_f64.to_le_bytes()].concat(),
    ]
    .concat();
    let bag = [
        b"#ROSBAG V2.0\n".to_vec(),
        record(&[("op", &[3]), ("index_pos", &[0; 8]), ("conn_count", &[0; 4]), ("chunk_count", &[0; 4])], b""),
        record(&[("op", &[7]), ("conn", &[0; 4]), ("topic", b"/own")], &about),
        record(&[("op", &[2]), ("conn", &[0; 4]), ("time", &[1, 0, 0, 0, 0, 0, 0, 0])], &message),
    ]
    .concat();
    read(&bag, &MapLibrary::default().with_folder(folder.path()).unwrap())
}

const OWN: &str = "uint8 KIND = 3\nHeader header\nPart[] parts\n";
/// Worked out by hand after `genmsg`, with another MD5 program.
const OWN_SUM: &str = "c6a5af61840f6289423d34fa36b336f6";
const PART: &str = "# both\nfloat32 gain\nfloat64 level\n";

#[test]
fn definitions_next_to_the_maps_serve_ros_1_if_the_md5_sum_matches() {
    for own in [OWN, ""] {
        let log = own_type(own, PART);
        let value = |path: &str| log.tables[0].column(path).unwrap().number(0);
        assert_eq!(value("header.seq"), Some(7.0), "{own:?}");
        assert_eq!(notice(&log, "definition-supplied").count, 1);
        // Another version of the type, of the same length.
        let log = own_type(own, &PART.replace("gain", "bias"));
        assert!(log.tables.is_empty() && notice(&log, "not-decoded").text.contains("/own"));
        assert!(notice(&log, "not-decoded").text.contains("my_msgs/Own"));
    }
}

#[test]
fn an_unknown_type_is_named_with_the_file_that_would_define_it() {
    let log = own_type("Alien alien\n", PART);
    assert!(notice(&log, "not-decoded").text.contains("my_msgs/msg/Alien.msg"), "{:?}", log.notices);
}
