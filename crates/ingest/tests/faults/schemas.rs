//! T6: definitions that describe more than the log contains.

use crate::lab::Lab;
use crate::verdict;
use ingest::{Log, LogError, LogKind};
use std::fmt::Write;

/// A ULog of these formats, an instance of each, and a message of 8 bytes for each.
fn ulog(formats: &[&str]) -> Vec<u8> {
    let message = |kind: u8, body: &[u8]| [&(body.len() as u16).to_le_bytes(), &[kind][..], body].concat();
    let mut bytes = b"ULog\x01\x12\x35\x01\0\0\0\0\0\0\0\0".to_vec();
    formats.iter().for_each(|format| bytes.extend(message(b'F', format.as_bytes())));
    for (id, format) in formats.iter().enumerate() {
        let name = format.split(':').next().unwrap();
        bytes.extend(message(b'A', &[&[0][..], &(id as u16).to_le_bytes(), name.as_bytes()].concat()));
    }
    for id in 0..formats.len() as u16 {
        bytes.extend(message(b'D', &[&id.to_le_bytes()[..], &[7; 8]].concat()));
    }
    bytes
}

fn mcap(records: &[(u8, Vec<u8>)]) -> Vec<u8> {
    let magic = b"\x89MCAP0\r\n".as_slice();
    let frame = |opcode: u8, body: &[u8]| [&[opcode][..], &(body.len() as u64).to_le_bytes(), body].concat();
    let body: Vec<u8> = records.iter().flat_map(|(opcode, body)| frame(*opcode, body)).collect();
    [magic, &frame(1, &[0; 8]), &body, &frame(2, &[0; 20]), magic].concat()
}

fn text(text: &[u8]) -> Vec<u8> {
    [&(text.len() as u32).to_le_bytes(), text].concat()
}

fn schema(id: u16, encoding: &str, definition: &[u8]) -> (u8, Vec<u8>) {
    (3, [&id.to_le_bytes()[..], &text(b"a_msgs/msg/A"), &text(encoding.as_bytes()), &text(definition)].concat())
}

fn channel(id: u16, schema: u16, encoding: &str) -> (u8, Vec<u8>) {
    let topic = format!("/topic{id}");
    let head = [id.to_le_bytes(), schema.to_le_bytes()].concat();
    (4, [head, text(topic.as_bytes()), text(encoding.as_bytes()), text(b"")].concat())
}

fn message(channel: u16, payload: &[u8]) -> (u8, Vec<u8>) {
    (5, [&channel.to_le_bytes()[..], &[0; 20], payload].concat())
}

fn rows(read: &Result<Log, LogError>) -> usize {
    read.as_ref().map_or(0, verdict::rows)
}

#[test]
fn huge_deeply_nested_or_circular_ulog_formats_take_little_memory() {
    let mut lab = Lab::new();
    let subject = lab.single(LogKind::Ulog, "schema.ulg");
    let mut nested = vec!["a0:uint64_t timestamp;uint8_t x;".to_owned()];
    (1..10).for_each(|i| nested.push(format!("a{i}:uint64_t timestamp;a{}[1000] x;", i - 1)));
    let nested: Vec<&str> = nested.iter().map(String::as_str).collect();
    for (case, formats) in [
        ("a huge array", &["big:uint64_t timestamp;uint8_t[2000000000] x;"][..]),
        ("an array beyond all numbers", &["big:uint64_t timestamp;uint8_t[99999999999999999999] x;"]),
        ("a circle", &["a:uint64_t timestamp;b x;", "b:uint64_t timestamp;a x;"]),
        ("itself", &["a:uint64_t timestamp;a x;"]),
        ("arrays in arrays", &nested),
    ] {
        let read = lab.read(&subject, &ulog(formats), case);
        assert_eq!(rows(&read), 0, "{case}: {read:?}");
    }
}

#[test]
fn circular_long_or_huge_message_definitions_take_little_memory() {
    let mut lab = Lab::new();
    let subject = lab.single(LogKind::Mcap, "schema.mcap");
    let separator = "=".repeat(80);
    let circle = format!("a_msgs/B b\n{separator}\nMSG: a_msgs/B\na_msgs/A a\n");
    let mut wide = String::new();
    (0..200_000).for_each(|i| writeln!(wide, "uint8 f{i}").unwrap());
    let mut nested = "a_msgs/T0[1000] x\n".to_owned();
    for i in 0..10 {
        write!(nested, "{separator}\nMSG: a_msgs/T{i}\na_msgs/T{}[1000] x\n", i + 1).unwrap();
    }
    write!(nested, "{separator}\nMSG: a_msgs/T10\nuint8 x\n").unwrap();
    for (case, definition) in [
        ("a circle", circle.as_str()),
        ("200 000 fields", &wide),
        ("an array of 2^31", "float64[2147483648] x\n"),
        ("an array of 2^64", "float64[18446744073709551616] x\n"),
        ("arrays in arrays", &nested),
        ("nothing", ""),
    ] {
        for (encoding, wire) in [("ros1msg", "ros1"), ("ros2msg", "cdr")] {
            let records = [schema(1, encoding, definition.as_bytes()), channel(1, 1, wire), message(1, &[0; 64])];
            let read = lab.read(&subject, &mcap(&records), &format!("{encoding}: {case}"));
            assert_eq!(rows(&read), usize::from(rows(&read) == 1 && definition.is_empty()), "{encoding}: {case}");
        }
    }
    let modules = "module a { ".repeat(20_000);
    for (case, definition) in
        [("modules in modules", modules.as_str()), ("an array of 2^40", "struct A { double x[1099511627776]; };")]
    {
        let records = [schema(1, "ros2idl", definition.as_bytes()), channel(1, 1, "cdr"), message(1, &[0; 64])];
        let read = lab.read(&subject, &mcap(&records), &format!("ros2idl: {case}"));
        assert_eq!(rows(&read), 0, "ros2idl: {case}");
    }
    let json = "[".repeat(200_000);
    let records = [schema(1, "jsonschema", b"{}"), channel(1, 1, "json"), message(1, json.as_bytes())];
    assert_eq!(rows(&lab.read(&subject, &mcap(&records), "json: arrays in arrays")), 0);
    // A group of Protocol Buffers in a group, and so on.
    let records = [schema(1, "protobuf", &[0x0b; 100_000]), channel(1, 1, "protobuf"), message(1, &[0x0b; 100_000])];
    assert_eq!(rows(&lab.read(&subject, &mcap(&records), "protobuf: groups in groups")), 0);
}

#[test]
fn endless_channels_and_schemas_take_little_memory() {
    let mut lab = Lab::new();
    let subject = lab.single(LogKind::Mcap, "many.mcap");
    let channels: Vec<_> = (0..=u16::MAX).map(|id| channel(id, 0, "json")).collect();
    // As many topics as the limit has, of less than two kilobytes each.
    lab.memory = 128 << 20;
    lab.read(&subject, &mcap(&channels), "65 536 channels").unwrap();
    let definition = vec![b'#'; 2000];
    let schemas: Vec<_> = (1..20_000).map(|id| schema(id, "ros1msg", &definition)).collect();
    lab.read(&subject, &mcap(&schemas), "20 000 schemas").unwrap();
    let mut map = channel(1, 0, "json");
    let at = map.1.len() - 4;
    map.1[at..].copy_from_slice(&u32::MAX.to_le_bytes());
    let _ = lab.read(&subject, &mcap(&[map]), "metadata of 4 GiB");
}

#[test]
fn dataflash_formats_with_nonsense_lengths_take_little_memory() {
    let mut lab = Lab::new();
    let subject = lab.single(LogKind::DataFlash, "fmt.bin");
    let format = |id: u8, length: u8, name: &str, types: &str, labels: &str| {
        let padded = |text: &str, width: usize| [text.as_bytes(), &vec![0; width - text.len()]].concat();
        [vec![0xa3, 0x95, 128, id, length], padded(name, 4), padded(types, 16), padded(labels, 64)].concat()
    };
    let first = format(128, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns");
    for length in [0, 1, 2, 3, 255] {
        let bytes =
            [first.clone(), format(7, length, "ABC", "Q", "TimeUS"), vec![0xa3, 0x95, 7, 0, 0, 0, 0, 0, 0, 0, 0]]
                .concat();
        let _ = lab.read(&subject, &bytes, &format!("length {length}"));
    }
    let twice: Vec<u8> = (0..20_000).flat_map(|i| format(7, 11 + (i % 9) as u8, "ABC", "Q", "TimeUS")).collect();
    let _ = lab.read(&subject, &[first, twice].concat(), "a type defined 20 000 times");
}

#[test]
fn tables_of_a_million_columns_endless_lines_and_open_quotes_take_little_memory() {
    let mut lab = Lab::new();
    let subject = lab.single(LogKind::Csv, "wide.csv");
    let columns: String = (0..300_000).map(|i| format!("c{i},")).collect();
    let _ = lab.read(&subject, format!("{columns}\n").as_bytes(), "300 000 columns");
    let _ = lab.read(&subject, &[b"a,b\n1,2\n".as_slice(), &vec![b'7'; 16 << 20]].concat(), "a line of 16 MiB");
    let rows = "1,2\n".repeat(100_000);
    let log = lab.read(&subject, format!("a,b\n1,2\n1,\"2\n{rows}").as_bytes(), "an open quote").unwrap();
    assert!(log.tables[0].rows >= 100_000, "{} rows", log.tables[0].rows);
}
