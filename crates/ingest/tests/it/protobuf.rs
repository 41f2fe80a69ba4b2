//! Protocol Buffers in MCAP: agreement with `prost-reflect`, which decodes them into trees of values.

use crate::made::{OnDisk, assert_balanced, notice};
use crate::support::{in_context, read_files, real_logs};
use ingest::{FieldRequest, Limits, Log, Selection, Table, TopicInfo, ValueKind};
use prost_reflect::prost::Message as _;
use prost_reflect::prost_types::field_descriptor_proto::{Label, Type};
use prost_reflect::prost_types::{
    DescriptorProto, FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet, OneofDescriptorProto,
};
use prost_reflect::{DescriptorPool, DynamicMessage, Value};
use simulate::{Container, FlightSettings, McapEncoding, McapSettings};
use std::collections::BTreeMap;
use std::io::Cursor;

fn field(name: &str, number: i32, of: Type) -> FieldDescriptorProto {
    FieldDescriptorProto {
        name: Some(name.to_owned()),
        number: Some(number),
        label: Some(Label::Optional as i32),
        r#type: Some(of as i32),
        ..FieldDescriptorProto::default()
    }
}

fn named(name: &str, number: i32, type_name: &str) -> FieldDescriptorProto {
    FieldDescriptorProto { type_name: Some(type_name.to_owned()), ..field(name, number, Type::Message) }
}

fn repeated(field: FieldDescriptorProto) -> FieldDescriptorProto {
    FieldDescriptorProto { label: Some(Label::Repeated as i32), ..field }
}

/// All kinds of values, alone, in arrays, optional, in a `oneof`, and a type that contains itself.
fn file(syntax: &str) -> FileDescriptorSet {
    let scalars = [
        ("double", Type::Double),
        ("float", Type::Float),
        ("int64", Type::Int64),
        ("uint64", Type::Uint64),
        ("int32", Type::Int32),
        ("fixed64", Type::Fixed64),
        ("fixed32", Type::Fixed32),
        ("bool", Type::Bool),
        ("string", Type::String),
        ("uint32", Type::Uint32),
        ("sfixed32", Type::Sfixed32),
        ("sfixed64", Type::Sfixed64),
        ("sint32", Type::Sint32),
        ("sint64", Type::Sint64),
        ("bytes", Type::Bytes),
    ];
    let alone = scalars.iter().enumerate().map(|(i, (name, of))| field(name, i as i32 + 1, *of));
    let many =
        scalars.iter().enumerate().map(|(i, (name, of))| repeated(field(&format!("{name}s"), i as i32 + 101, *of)));
    let mut fields: Vec<FieldDescriptorProto> = alone.chain(many).collect();
    fields.push(FieldDescriptorProto { oneof_index: Some(0), ..field("either", 200, Type::Double) });
    fields.push(FieldDescriptorProto { oneof_index: Some(0), ..field("or", 201, Type::Double) });
    fields.push(named("nested", 300, ".test.All.Nested"));
    fields.push(repeated(named("list", 301, ".test.All.Nested")));
    fields.push(named("self", 302, ".test.All"));
    fields.push(named("stamp", 303, ".google.protobuf.Timestamp"));
    let nested = DescriptorProto {
        name: Some("Nested".to_owned()),
        field: vec![
            field("x", 1, Type::Double),
            field("n", 2, Type::Int64),
            named("stamp", 3, ".google.protobuf.Timestamp"),
        ],
        ..DescriptorProto::default()
    };
    let message = DescriptorProto {
        name: Some("All".to_owned()),
        field: fields,
        nested_type: vec![nested],
        oneof_decl: vec![OneofDescriptorProto { name: Some("choice".to_owned()), options: None }],
        ..DescriptorProto::default()
    };
    let time = FileDescriptorProto {
        name: Some("time.proto".to_owned()),
        package: Some("google.protobuf".to_owned()),
        message_type: vec![DescriptorProto {
            name: Some("Timestamp".to_owned()),
            field: vec![field("seconds", 1, Type::Int64), field("nanos", 2, Type::Int32)],
            ..DescriptorProto::default()
        }],
        syntax: Some("proto3".to_owned()),
        ..FileDescriptorProto::default()
    };
    let file = FileDescriptorProto {
        name: Some("all.proto".to_owned()),
        package: Some("test".to_owned()),
        dependency: vec!["time.proto".to_owned()],
        message_type: vec![message],
        syntax: Some(syntax.to_owned()),
        ..FileDescriptorProto::default()
    };
    FileDescriptorSet { file: vec![time, file] }
}

fn mcap_of(type_name: &str, schema: &[u8], messages: &[Vec<u8>]) -> Vec<u8> {
    let mut writer = mcap::Writer::new(Cursor::new(vec![])).unwrap();
    let schema = writer.add_schema(type_name, "protobuf", schema).unwrap();
    let channel = writer.add_channel(schema, "/all", "protobuf", &BTreeMap::new()).unwrap();
    for (i, data) in messages.iter().enumerate() {
        let header =
            mcap::records::MessageHeader { channel_id: channel, sequence: 0, log_time: i as u64, publish_time: 0 };
        writer.write_to_known_channel(&header, data).unwrap();
    }
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

fn read(content: &[u8], want: impl Fn(&TopicInfo) -> Selection) -> Log {
    let disk = OnDisk::new(content, false);
    let log = read_files(Limits::default(), ingest::LogKind::Mcap, &[disk.path()], &want).unwrap();
    assert_balanced(&log);
    log
}

/// A fixed sequence of numbers that includes zero, one and the extremes.
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let n = self.0 >> 3 ^ self.0 << 29;
        match self.0 >> 60 {
            0..=3 => 0,
            4 => 1,
            5 => u64::MAX,
            6 => 1 << 63,
            _ => n >> (self.0 >> 58 & 63),
        }
    }

    fn value(&mut self, kind: &prost_reflect::Kind) -> Value {
        use prost_reflect::Kind as K;
        let n = self.next();
        match kind {
            K::Double => Value::F64(if n == 0 { 0.0 } else { (n as i64) as f64 / 1e3 }),
            K::Float => Value::F32((n as i32) as f32 / 8.0),
            K::Int64 | K::Sint64 | K::Sfixed64 => Value::I64(n as i64),
            K::Uint64 | K::Fixed64 => Value::U64(n),
            K::Int32 | K::Sint32 | K::Sfixed32 => Value::I32(n as i32),
            K::Uint32 | K::Fixed32 => Value::U32(n as u32),
            K::Bool => Value::Bool(n & 1 == 1),
            K::String => Value::String(if n == 0 { String::new() } else { format!("ä{n}") }),
            K::Bytes => Value::Bytes(n.to_le_bytes().to_vec().into()),
            other => panic!("{other:?}"),
        }
    }
}

/// A number or text as a column would hold it.
fn as_column(value: &Value) -> String {
    match value {
        Value::F64(v) => format!("{v:?}"),
        Value::F32(v) => format!("{:?}", f64::from(*v)),
        Value::I64(v) => v.to_string(),
        Value::U64(v) => v.to_string(),
        Value::I32(v) => format!("{:?}", f64::from(*v)),
        Value::U32(v) => format!("{:?}", f64::from(*v)),
        Value::Bool(v) => format!("{:?}", f64::from(u8::from(*v))),
        Value::String(v) => v.clone(),
        other => panic!("{other:?}"),
    }
}

fn in_table(table: &Table, path: &str, row: usize) -> Option<String> {
    let column = table.column(path)?;
    match &column.data {
        ingest::ColumnData::F64(_) => column.number(row).map(|v| format!("{v:?}")),
        ingest::ColumnData::U64(_) => column.unsigned(row).map(|v| v.to_string()),
        ingest::ColumnData::I64(_) => column.integer(row).map(|v| v.to_string()),
        ingest::ColumnData::Text(_) => column.text(row).map(|text| text.to_string()),
    }
}

#[test]
fn every_kind_of_value_agrees_with_prost_reflect() {
    for syntax in ["proto2", "proto3"] {
        let set = file(syntax);
        let pool = DescriptorPool::from_file_descriptor_set(set.clone()).unwrap();
        let all = pool.get_message_by_name("test.All").unwrap();
        let mut numbers = Numbers(1);
        let mut sent = vec![];
        for _ in 0..300 {
            let mut message = DynamicMessage::new(all.clone());
            for field in all.fields().filter(|f| f.number() < 300) {
                if field.is_list() {
                    let count = numbers.next() % 5;
                    message.set_field(&field, Value::List((0..count).map(|_| numbers.value(&field.kind())).collect()));
                } else if !numbers.next().is_multiple_of(3) {
                    message.set_field(&field, numbers.value(&field.kind()));
                }
            }
            sent.push(message);
        }
        let bytes: Vec<Vec<u8>> = sent.iter().map(DynamicMessage::encode_to_vec).collect();
        let log = read(&mcap_of("test.All", &set.encode_to_vec(), &bytes), |_| Selection::All);
        let table = &log.tables[0];
        assert_eq!((table.rows, log.health.undecodable), (300, 0));
        let mut compared = 0;
        for (row, message) in sent.iter().enumerate() {
            for field in all.fields().filter(|f| f.number() < 300 && !f.name().starts_with("bytes")) {
                let name = field.name().to_owned();
                if field.is_list() {
                    let value = message.get_field(&field);
                    let list = value.as_list().unwrap();
                    for i in 0..5 {
                        assert_eq!(
                            in_table(table, &format!("{name}[{i}]"), row),
                            list.get(i).map(as_column),
                            "{name}[{i}]"
                        );
                    }
                } else {
                    let there = !field.supports_presence() || message.has_field(&field);
                    let expected = there.then(|| as_column(&message.get_field(&field)));
                    assert_eq!(in_table(table, &name, row), expected, "{syntax} {name}, row {row}");
                }
                compared += 1;
            }
        }
        assert_eq!(compared, 300 * 30);
    }
}

#[test]
fn nested_and_repeated_messages_are_reached_by_their_paths() {
    let set = file("proto3");
    let pool = DescriptorPool::from_file_descriptor_set(set.clone()).unwrap();
    let all = pool.get_message_by_name("test.All").unwrap();
    let nested = pool.get_message_by_name("test.All.Nested").unwrap();
    let inner = |x: f64, seconds: i64| {
        let mut message = DynamicMessage::new(nested.clone());
        message.set_field_by_name("x", Value::F64(x));
        let mut stamp = DynamicMessage::new(pool.get_message_by_name("google.protobuf.Timestamp").unwrap());
        stamp.set_field_by_name("seconds", Value::I64(seconds));
        stamp.set_field_by_name("nanos", Value::I32(7));
        message.set_field_by_name("stamp", Value::Message(stamp));
        Value::Message(message)
    };
    let mut within = DynamicMessage::new(all.clone());
    within.set_field_by_name("nested", inner(4.0, 4));
    let mut message = DynamicMessage::new(all.clone());
    message.set_field_by_name("nested", inner(1.0, 1_700_000_000));
    message.set_field_by_name("list", Value::List(vec![inner(2.0, 2), inner(3.0, -3)]));
    message.set_field_by_name("self", Value::Message(within));
    let content = mcap_of("test.All", &set.encode_to_vec(), &[message.encode_to_vec(), vec![]]);
    let paths =
        ["nested.x", "nested.n", "nested.stamp", "list[1].x", "list[1].stamp", "self.nested.x", "list[7].x", "no.such"];
    let fields: Vec<FieldRequest> =
        paths.iter().map(|path| FieldRequest { path: (*path).to_owned(), kind: ValueKind::Number }).collect();
    let log = read(&content, |_| Selection::Fields(fields.clone()));
    let table = &log.tables[0];
    let at = |path: &str, row| in_table(table, path, row);
    assert_eq!(at("nested.x", 0).as_deref(), Some("1.0"));
    // Zero is not written, but its submessage is present; in the second message it is absent.
    assert_eq!((at("nested.n", 0).as_deref(), at("nested.n", 1)), (Some("0"), None));
    assert_eq!(at("nested.stamp", 0).as_deref(), Some("1700000000000000007"));
    assert_eq!((at("list[1].x", 0).as_deref(), at("list[1].stamp", 0).as_deref()), (Some("3.0"), Some("-2999999993")));
    assert_eq!(at("self.nested.x", 0).as_deref(), Some("4.0"));
    assert_eq!(table.columns.len(), 6);
    // A type that contains itself is expanded once.
    let log = read(&content, |_| Selection::All);
    assert!(log.tables[0].columns.iter().all(|c| !c.path.starts_with("self.self")));
}

/// A bytes field as encoded in a message.
fn of_bytes(number: u8, bytes: &[u8]) -> Vec<u8> {
    let length = [bytes.len() as u8 & 0x7f | 0x80, (bytes.len() >> 7) as u8];
    [&[number << 3 | 2][..], &length, bytes].concat()
}

#[test]
fn proto2_groups_are_messages_with_different_delimiters() {
    let group = |field: FieldDescriptorProto| FieldDescriptorProto { r#type: Some(Type::Group as i32), ..field };
    let mut set = file("proto2");
    let fields = &mut set.file[1].message_type[0].field;
    *fields = vec![
        group(named("nested", 1, ".test.All.Nested")),
        group(repeated(named("list", 2, ".test.All.Nested"))),
        field("int32", 5, Type::Int32),
    ];
    let schema = set.encode_to_vec();
    let pool = DescriptorPool::from_file_descriptor_set(set).unwrap();
    let inner = |x: f64, n: i64| {
        let mut message = DynamicMessage::new(pool.get_message_by_name("test.All.Nested").unwrap());
        message.set_field_by_name("x", Value::F64(x));
        message.set_field_by_name("n", Value::I64(n));
        Value::Message(message)
    };
    let mut message = DynamicMessage::new(pool.get_message_by_name("test.All").unwrap());
    message.set_field_by_name("nested", inner(1.5, 7));
    message.set_field_by_name("list", Value::List(vec![inner(2.5, 8), inner(3.5, -9)]));
    message.set_field_by_name("int32", Value::I32(4));
    let payload = message.encode_to_vec();
    assert_eq!(payload[0], 1 << 3 | 3, "not written as a group");
    let cut = payload[..payload.len() - 3].to_vec();
    let paths = ["nested.x", "nested.n", "list[1].x", "list[1].n", "int32"];
    let fields: Vec<FieldRequest> =
        paths.iter().map(|path| FieldRequest { path: (*path).to_owned(), kind: ValueKind::Number }).collect();
    let content = mcap_of("test.All", &schema, &[payload, cut]);
    let log = read(&content, |_| Selection::Fields(fields.clone()));
    let values = paths.map(|path| in_table(&log.tables[0], path, 0).unwrap());
    assert_eq!(values, ["1.5", "7", "3.5", "-9", "4.0"]);
    assert_eq!((log.tables[0].rows, notice(&log, "undecodable").count), (1, 1));
}

#[test]
fn editions_set_field_presence_and_message_encoding_per_field() {
    // `FeatureSet`: `field_presence` is 1 (EXPLICIT 1, IMPLICIT 2, LEGACY_REQUIRED 3), `message_encoding` 5 (DELIMITED 2).
    let presence = |value: u8| vec![1 << 3, value];
    let delimited = vec![5 << 3, 2];
    // Options are field 8 of both descriptors; the features are field 21 of those of a field and 50 of those of a file.
    let options = |tag: [u8; 2], features: &[u8]| of_bytes(8, &[&tag, &[features.len() as u8][..], features].concat());
    let in_field = |features: &[u8]| options([0xaa, 1], features);
    let in_file = |features: &[u8]| options([0x92, 3], features);
    let member = |name: &str, number: i32, features: Option<&[u8]>| {
        let plain = field(name, number, Type::Double).encode_to_vec();
        of_bytes(2, &[plain, features.map(in_field).unwrap_or_default()].concat())
    };
    let set = |of_file: Option<&[u8]>| {
        let within = [named("within", 4, ".t.A").encode_to_vec(), in_field(&delimited)].concat();
        let message = [
            of_bytes(1, b"A"),
            member("plain", 1, None),
            member("implicit", 2, Some(&presence(2))),
            member("explicit", 3, Some(&presence(1))),
            of_bytes(2, &within),
        ];
        let file = [
            of_bytes(1, b"t.proto"),
            of_bytes(2, b"t"),
            of_bytes(4, &message.concat()),
            of_file.map(in_file).unwrap_or_default(),
            of_bytes(12, b"editions"),
        ];
        of_bytes(1, &file.concat())
    };
    let double = |number: u8, x: f64| [&[number << 3 | 1], &x.to_le_bytes()[..]].concat();
    let group = [vec![4 << 3 | 3], double(3, 8.5), vec![4 << 3 | 4], double(1, 2.5)].concat();
    let fields: Vec<FieldRequest> = ["plain", "implicit", "explicit", "within.explicit"]
        .map(|path| FieldRequest { path: path.to_owned(), kind: ValueKind::Number })
        .to_vec();
    for (of_file, plain) in [(None, None), (Some(presence(1)), None), (Some(presence(2)), Some("0.0"))] {
        let schema = set(of_file.as_deref());
        // The crate panics on such a descriptor. If it ever reads one, it is the better oracle.
        let by_crate = std::panic::catch_unwind(|| DescriptorPool::decode(&schema[..]));
        assert!(!matches!(by_crate, Ok(Ok(_))), "prost-reflect knows editions now");
        let log = read(&mcap_of("t.A", &schema, &[vec![], group.clone()]), |_| Selection::Fields(fields.clone()));
        let row =
            |row| ["plain", "implicit", "explicit", "within.explicit"].map(|path| in_table(&log.tables[0], path, row));
        let text = |value: &str| Some(value.to_owned());
        assert_eq!(row(0), [plain.map(str::to_owned), text("0.0"), None, None]);
        assert_eq!(row(1), [text("2.5"), text("0.0"), None, text("8.5")]);
    }
}

#[test]
fn a_descriptor_without_its_imports_is_read() {
    let mut set = file("proto3");
    set.file.remove(0);
    let schema = set.encode_to_vec();
    assert!(DescriptorPool::decode(&schema[..]).is_err(), "prost-reflect reads it now");
    let log = read(&mcap_of("test.All", &schema, &[vec![0x28, 5]]), |_| Selection::All);
    assert_eq!(in_table(&log.tables[0], "int32", 0).as_deref(), Some("5.0"));
}

#[test]
fn bytes_that_are_not_a_message_are_rejected_with_a_reason() {
    let set = file("proto3").encode_to_vec();
    // A truncated number, a length beyond the end, a field 0, an unknown kind, a group without an end, invalid text.
    let bad: [&[u8]; 6] = [&[0x09, 1, 2], &[0x4a, 200, 1], &[0x00, 1], &[0x0f], &[0x0b, 0x08, 1], &[0x4a, 1, 0xff]];
    let good: [&[u8]; 3] =
        [&[], &[0xa3, 0x1f, 0x08, 1, 0xa4, 0x1f, 0x28, 5], &[0xf8, 0xff, 0xff, 0xff, 0x0f, 1, 0x28, 5]];
    let messages: Vec<Vec<u8>> = bad.iter().chain(&good).map(|m| m.to_vec()).collect();
    let log = read(&mcap_of("test.All", &set, &messages), |_| Selection::All);
    assert_eq!((log.tables[0].rows, notice(&log, "undecodable").count), (3, 6));
    assert_eq!(in_table(&log.tables[0], "int32", 2).as_deref(), Some("5.0"));
    for (type_name, schema, word) in [
        ("test.None", &set[..], "not in its descriptor"),
        ("test.All", &set[..100], "truncated or damaged"),
        ("test.All", &[], "not in"),
    ] {
        let log = read(&mcap_of(type_name, schema, &messages), |_| Selection::All);
        assert!(log.health.topics[0].reason.contains(word), "{}", log.health.topics[0].reason);
    }
}

#[test]
fn a_descriptor_that_names_exponentially_many_fields_stays_small() {
    let level = |i: usize| DescriptorProto {
        name: Some(format!("L{i}")),
        field: (0..10)
            .map(|f| {
                if i < 20 {
                    named(&format!("f{f}"), f + 1, &format!(".t.L{}", i + 1))
                } else {
                    field(&format!("f{f}"), f + 1, Type::Double)
                }
            })
            .collect(),
        ..DescriptorProto::default()
    };
    let mut deep = DescriptorProto { name: Some("Deep".to_owned()), ..DescriptorProto::default() };
    for _ in 0..100 {
        deep = DescriptorProto { name: Some("Deep".to_owned()), nested_type: vec![deep], ..DescriptorProto::default() };
    }
    let of = |types| {
        let file = FileDescriptorProto {
            name: Some("t".to_owned()),
            package: Some("t".to_owned()),
            message_type: types,
            ..FileDescriptorProto::default()
        };
        FileDescriptorSet { file: vec![file] }.encode_to_vec()
    };
    let wide = of((0..=20).map(level).collect());
    let log = read(&mcap_of("t.L0", &wide, &[vec![]]), |_| Selection::All);
    assert_eq!(log.health.messages, 1);
    let log = read(&mcap_of("t.Deep", &of(vec![deep]), &[vec![]]), |_| Selection::All);
    assert!(log.health.topics[0].reason.contains("nested more than"), "{}", log.health.topics[0].reason);
}

#[test]
fn a_simulated_flight_reads_the_same_as_with_prost_reflect() {
    let flight = simulate::simulate(&FlightSettings { duration_s: 5.0, ..FlightSettings::default() }).unwrap();
    let container = |encoding| Container::Mcap(McapSettings { encoding, ..McapSettings::default() });
    let bytes = |encoding| container(encoding).files(&flight, "f").unwrap().remove(0).bytes;
    let content = bytes(McapEncoding::Protobuf);
    let log = read(&content, |_| Selection::All);
    let cdr = read(&bytes(McapEncoding::Cdr), |_| Selection::All);
    assert_eq!(log.tables.len(), 4);
    for (ours, theirs) in log.tables.iter().zip(&cdr.tables) {
        assert_eq!(
            (&ours.topic.name, ours.rows, &ours.logged_ns),
            (&theirs.topic.name, theirs.rows, &theirs.logged_ns)
        );
        assert!(ours.columns == theirs.columns, "{}", ours.topic.name);
    }
    let mut rows: BTreeMap<String, usize> = BTreeMap::new();
    for message in mcap::MessageStream::new(&content).unwrap() {
        let message = message.unwrap();
        let schema = message.channel.schema.as_ref().unwrap();
        let pool = DescriptorPool::decode(&schema.data[..]).unwrap();
        let decoded =
            DynamicMessage::decode(pool.get_message_by_name(&schema.name).unwrap(), &message.data[..]).unwrap();
        let table = log.tables.iter().find(|t| t.topic.name == message.channel.topic).unwrap();
        let row = rows.entry(message.channel.topic.clone()).or_default();
        for path in ["latitude", "altitude", "position_covariance_type", "data"]
            .iter()
            .filter(|path| table.column(path).is_some())
        {
            let value = decoded.get_field_by_name(path).unwrap();
            assert_eq!(in_table(table, path, *row), Some(as_column(&value)), "{path}");
        }
        *row += 1;
    }
    assert_eq!(rows.len(), 4);
}

#[test]
fn a_real_log_of_649_channels_has_the_timestamps_that_python_reads() {
    let Some(path) = real_logs("keelson/test.mcap") else { return };
    let log = in_context(|context| {
        ingest::read_files(ingest::LogKind::Mcap, &[path], &|_: &TopicInfo| Selection::All, context)
    })
    .unwrap();
    assert_balanced(&log);
    assert_eq!((log.health.messages, log.health.topics.len(), log.tables.len()), (2172, 649, 649));
    let stamps: i128 = log.tables.iter().map(|table| crate::made::whole_sum(table, "timestamp")).sum();
    // protobuf 6 through mcap-protobuf-support.
    assert_eq!(stamps, 3_765_329_642_317_968_153_082);
}
