//! A small flight with all values known, in every encoding and container.

use crate::support::read_files;
use flight::Severity;
use ingest::{ColumnData, Limits, Log, LogError, LogKind, ReadContext, Select, Selection, Table, TopicInfo};
use mcap::Compression;
use mcap::records::MessageHeader;
use std::collections::BTreeMap;
use std::io::{Cursor, Seek, Write};
use std::path::PathBuf;

/// The wanted topic, and the unwanted one.
pub const FIX: &str = "/gps/fix";
pub const CAMERA: &str = "/camera";

/// A message of either topic.
#[derive(Clone)]
pub struct Sent {
    pub topic: &'static str,
    pub logged_ns: i64,
    pub published_ns: i64,
    pub stamp_ns: i64,
    pub latitude: f64,
    pub status: i32,
    pub frame: String,
}

/// `count` fixes, each followed by two images.
pub fn flight(count: i64) -> Vec<Sent> {
    (0..3 * count)
        .map(|i| {
            let fix = i % 3 == 0;
            let logged_ns = 1_700_000_000_000_000_000 + i * 33_333_333;
            Sent {
                topic: if fix { FIX } else { CAMERA },
                logged_ns,
                published_ns: logged_ns - 1_000_001,
                stamp_ns: logged_ns - 120_000_007,
                latitude: 47.0 + 1e-7 * (i * i) as f64,
                status: (i % 5 - 2) as i32,
                frame: format!("gps{}", "x".repeat((i % 4) as usize)),
            }
        })
        .collect()
}

/// How messages are encoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    Ros1,
    Cdr,
    Json,
}

const ROS1: &str = "# A fix.\nstd_msgs/Header header\nint32 OLD=-1\nint32 status\nfloat64 latitude\nfloat64[3] variance\n\
    uint8[] raw\n================================================================================\n\
    MSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n";
const ROS2: &str = "std_msgs/Header header\nint32 status\nfloat64 latitude\nfloat64[3] variance\nuint8[] raw\n\
    ================================================================================\nMSG: std_msgs/Header\n\
    builtin_interfaces/Time stamp\nstring frame_id\n\
    ================================================================================\n\
    MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n";

impl Encoding {
    pub const ALL: [Encoding; 3] = [Encoding::Ros1, Encoding::Cdr, Encoding::Json];

    fn names(self) -> (&'static str, &'static str, &'static str, &'static str) {
        match self {
            Encoding::Ros1 => ("ros1", "ros1msg", "test_msgs/Fix", ROS1),
            Encoding::Cdr => ("cdr", "ros2msg", "test_msgs/msg/Fix", ROS2),
            Encoding::Json => ("json", "jsonschema", "test.Fix", "{\"type\":\"object\"}"),
        }
    }

    pub fn payload(self, sent: &Sent) -> Vec<u8> {
        let (sec, nsec) = ((sent.stamp_ns / 1_000_000_000) as u32, (sent.stamp_ns % 1_000_000_000) as u32);
        let variance = [1.5, sent.latitude, -0.25];
        let raw = vec![7_u8; if sent.topic == CAMERA { 300 } else { 3 }];
        let mut out = vec![];
        match self {
            Encoding::Json => {
                return format!(
                    r#"{{"header":{{"stamp":{{"sec":{sec},"nanosec":{nsec}}},"frame_id":"{}"}},"status":{},"latitude":{:?},"variance":{variance:?}}}"#,
                    sent.frame, sent.status, sent.latitude
                )
                .into_bytes();
            }
            Encoding::Ros1 => {
                out.extend(9_u32.to_le_bytes());
                out.extend([sec, nsec, sent.frame.len() as u32].map(u32::to_le_bytes).concat());
                out.extend(sent.frame.as_bytes());
            }
            Encoding::Cdr => {
                out.extend([sec, nsec, sent.frame.len() as u32 + 1].map(u32::to_le_bytes).concat());
                out.extend(sent.frame.as_bytes());
                out.push(0);
                out.resize(out.len().next_multiple_of(4), 0);
            }
        }
        out.extend(sent.status.to_le_bytes());
        if self == Encoding::Cdr {
            out.resize(out.len().next_multiple_of(8), 0);
        }
        out.extend(sent.latitude.to_le_bytes());
        out.extend(variance.map(f64::to_le_bytes).concat());
        out.extend((raw.len() as u32).to_le_bytes());
        out.extend(raw);
        if self == Encoding::Cdr { [vec![0, 1, 0, 0], out].concat() } else { out }
    }
}

/// How an MCAP file is laid out.
#[derive(Clone, Copy, Debug)]
pub struct Layout {
    pub compression: Option<Compression>,
    pub chunked: bool,
    pub chunk_bytes: u64,
    pub summary: bool,
    /// Whether the summary repeats the schemas; the channels it repeats in any case.
    pub repeat_schemas: bool,
    pub data_crc: bool,
    pub chunk_crc: bool,
}

impl Layout {
    pub const PLAIN: Layout = Layout {
        compression: None,
        chunked: true,
        chunk_bytes: 1500,
        summary: true,
        repeat_schemas: true,
        data_crc: true,
        chunk_crc: true,
    };
    pub const UNCHUNKED: Layout = Layout { chunked: false, ..Layout::PLAIN };
    pub const ZSTD: Layout = Layout { compression: Some(Compression::Zstd), ..Layout::PLAIN };
    pub const LZ4: Layout = Layout { compression: Some(Compression::Lz4), ..Layout::PLAIN };

    fn options(self) -> mcap::WriteOptions {
        mcap::WriteOptions::new()
            .compression(self.compression)
            .compression_threads(0)
            .use_chunks(self.chunked)
            .chunk_size(Some(self.chunk_bytes))
            .calculate_data_section_crc(self.data_crc)
            .calculate_chunk_crcs(self.chunk_crc)
            .emit_summary_records(self.summary)
            .emit_summary_offsets(self.summary)
            .repeat_schemas(self.repeat_schemas)
            .library("test")
    }
}

/// Writes the messages as MCAP; `more` may add records before the file is closed.
pub fn mcap_with(
    sent: &[Sent],
    encoding: Encoding,
    layout: Layout,
    more: impl FnOnce(&mut mcap::Writer<Cursor<Vec<u8>>>),
) -> Vec<u8> {
    let mut writer = mcap::Writer::with_options(Cursor::new(vec![]), layout.options()).unwrap();
    let (message_encoding, schema_encoding, type_name, text) = encoding.names();
    let schema = writer.add_schema(type_name, schema_encoding, text.as_bytes()).unwrap();
    let channels: Vec<u16> = [FIX, CAMERA]
        .map(|topic| writer.add_channel(schema, topic, message_encoding, &BTreeMap::new()).unwrap())
        .to_vec();
    for (sequence, s) in sent.iter().enumerate() {
        let header = MessageHeader {
            channel_id: channels[usize::from(s.topic == CAMERA)],
            sequence: sequence as u32,
            log_time: s.logged_ns as u64,
            publish_time: s.published_ns as u64,
        };
        writer.write_to_known_channel(&header, &encoding.payload(s)).unwrap();
    }
    more(&mut writer);
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

pub fn mcap(sent: &[Sent], encoding: Encoding, layout: Layout) -> Vec<u8> {
    mcap_with(sent, encoding, layout, |_| ())
}

/// How the chunks of a bag are compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BagCodec {
    None,
    Lz4Independent,
    Lz4Linked,
    Bz2,
}

impl BagCodec {
    pub const ALL: [BagCodec; 4] = [BagCodec::None, BagCodec::Lz4Independent, BagCodec::Lz4Linked, BagCodec::Bz2];

    fn pack(self, content: &[u8]) -> (&'static str, Vec<u8>) {
        let lz4 = |mode| {
            let mut encoder = lz4::EncoderBuilder::new().block_mode(mode).build(vec![]).unwrap();
            encoder.write_all(content).unwrap();
            encoder.finish().0
        };
        match self {
            BagCodec::None => ("none", content.to_vec()),
            BagCodec::Lz4Independent => ("lz4", lz4(lz4::BlockMode::Independent)),
            BagCodec::Lz4Linked => ("lz4", lz4(lz4::BlockMode::Linked)),
            BagCodec::Bz2 => {
                let mut encoder = bzip2::write::BzEncoder::new(vec![], bzip2::Compression::best());
                encoder.write_all(content).unwrap();
                ("bz2", encoder.finish().unwrap())
            }
        }
    }
}

fn fields(fields: &[(&str, &[u8])]) -> Vec<u8> {
    let mut out = vec![];
    for (name, value) in fields {
        out.extend((name.len() as u32 + 1 + value.len() as u32).to_le_bytes());
        out.extend(name.as_bytes());
        out.push(b'=');
        out.extend(*value);
    }
    out
}

fn record(header: &[(&str, &[u8])], data: &[u8]) -> Vec<u8> {
    let header = fields(header);
    [&(header.len() as u32).to_le_bytes()[..], &header, &(data.len() as u32).to_le_bytes(), data].concat()
}

fn connection(topic: &str) -> Vec<u8> {
    let id = u32::from(topic == CAMERA).to_le_bytes();
    let about = fields(&[
        ("topic", topic.as_bytes()),
        ("type", b"test_msgs/Fix"),
        ("md5sum", b"00000000000000000000000000000000"),
        ("message_definition", ROS1.as_bytes()),
    ]);
    record(&[("conn", &id), ("op", &[7]), ("topic", topic.as_bytes())], &about)
}

fn bag_message(sent: &Sent) -> Vec<u8> {
    let id = u32::from(sent.topic == CAMERA).to_le_bytes();
    let time = [(sent.logged_ns / 1_000_000_000) as u32, (sent.logged_ns % 1_000_000_000) as u32].map(u32::to_le_bytes);
    record(&[("conn", &id), ("op", &[2]), ("time", &time.concat())], &Encoding::Ros1.payload(sent))
}

fn bag_header(index_at: u64, chunks: u32) -> Vec<u8> {
    let header = fields(&[
        ("chunk_count", &chunks.to_le_bytes()),
        ("conn_count", &2_u32.to_le_bytes()),
        ("index_pos", &index_at.to_le_bytes()),
        ("op", &[3]),
    ]);
    let padding = vec![b' '; 4096 - 8 - header.len()];
    [&(header.len() as u32).to_le_bytes()[..], &header, &(padding.len() as u32).to_le_bytes(), &padding].concat()
}

/// Writes the messages as a bag with chunks of `per_chunk` messages. Connections lie in the first
/// chunk if `in_chunks`, and at the end unless the bag is not `closed`.
pub fn bag(sent: &[Sent], codec: BagCodec, per_chunk: usize, in_chunks: bool, closed: bool) -> Vec<u8> {
    let mut out = [b"#ROSBAG V2.0\n".to_vec(), bag_header(0, 0)].concat();
    let mut infos = vec![];
    for (number, messages) in sent.chunks(per_chunk).enumerate() {
        let mut content = vec![];
        if number == 0 && in_chunks {
            content.extend([connection(FIX), connection(CAMERA)].concat());
        }
        for message in messages {
            content.extend(bag_message(message));
        }
        let (name, data) = codec.pack(&content);
        let place = (out.len() as u64).to_le_bytes();
        let size = (content.len() as u32).to_le_bytes();
        out.extend(record(&[("compression", name.as_bytes()), ("op", &[5]), ("size", &size)], &data));
        let mut counts = vec![];
        for (id, topic) in [FIX, CAMERA].iter().enumerate() {
            let count = messages.iter().filter(|m| m.topic == *topic).count();
            // Times and offsets, which reading a whole log does not need.
            let entries = vec![0; 12 * count];
            let (id, count) = ((id as u32).to_le_bytes(), (count as u32).to_le_bytes());
            counts.extend([id, count].concat());
            let header: [(&str, &[u8]); 4] =
                [("ver", &1_u32.to_le_bytes()), ("op", &[4]), ("conn", &id), ("count", &count)];
            out.extend(record(&header, &entries));
        }
        let conns = 2_u32.to_le_bytes();
        infos.push(record(
            &[("ver", &1_u32.to_le_bytes()), ("op", &[6]), ("chunk_pos", &place), ("count", &conns)],
            &counts,
        ));
    }
    if closed {
        let index_at = out.len() as u64;
        out.extend([connection(FIX), connection(CAMERA), infos.concat()].concat());
        out.splice(13..13 + 4096, bag_header(index_at, infos.len() as u32));
    }
    out
}

/// A file that can be changed in place and read again.
pub struct OnDisk {
    file: std::fs::File,
    folder: tempfile::TempDir,
    pub is_bag: bool,
}

/// Overwrites a part of a file.
pub fn write_at(mut file: &std::fs::File, bytes: &[u8], offset: u64) {
    file.seek(std::io::SeekFrom::Start(offset)).unwrap();
    file.write_all(bytes).unwrap();
}

impl OnDisk {
    pub fn new(content: &[u8], is_bag: bool) -> OnDisk {
        let folder = tempfile::tempdir().unwrap();
        let mut file = std::fs::File::create_new(folder.path().join("log")).unwrap();
        file.write_all(content).unwrap();
        OnDisk { file, folder, is_bag }
    }

    pub fn path(&self) -> PathBuf {
        self.folder.path().join("log")
    }

    pub fn write_at(&self, offset: u64, bytes: &[u8]) {
        write_at(&self.file, bytes, offset);
    }

    pub fn set_len(&self, length: u64) {
        self.file.set_len(length).unwrap();
    }

    /// Reads the fixes; the camera is not wanted. Every byte must be accounted for.
    pub fn read(&self) -> Result<Log, LogError> {
        self.read_where(|topic| if topic.name == FIX { Selection::All } else { Selection::Skip })
    }

    pub fn read_where(&self, want: impl Fn(&TopicInfo) -> Selection) -> Result<Log, LogError> {
        let kind = if self.is_bag { LogKind::Bag } else { LogKind::Mcap };
        let log = read_files(Limits::default(), kind, &[self.path()], &want)?;
        assert_balanced(&log);
        Ok(log)
    }
}

pub fn read_at(path: PathBuf, is_bag: bool, want: &dyn Select, context: &ReadContext<'_>) -> Result<Log, LogError> {
    ingest::read_files(if is_bag { LogKind::Bag } else { LogKind::Mcap }, &[path], want, context)
}

/// Calls `body` with `cases` copies of `content`, each with one stretch zeroed, filled, scrambled, cut
/// out, doubled or swapped with another. The sequence is fixed.
pub fn each_damage(content: &[u8], cases: u64, mut body: impl FnMut(&[u8])) {
    let mut seed = 0x9e37_79b9_7f4a_7c15_u64;
    let mut next = |below: usize| {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 33) as usize % below
    };
    for case in 0..cases {
        let mut damaged = content.to_vec();
        let length = [1, 16, 100, 512, 2000][next(5)].min(content.len() / 3);
        let start = next(content.len() - length);
        let stretch = start..start + length;
        match case % 6 {
            0 => damaged[stretch].fill(0),
            1 => damaged[stretch].fill(0xff),
            2 => damaged[stretch].iter_mut().for_each(|b| *b = next(256) as u8),
            3 => drop(damaged.drain(stretch)),
            4 => damaged.splice(start..start, content[stretch].iter().copied()).for_each(drop),
            _ => {
                let other = next(content.len() - length);
                damaged.copy_within(other..other + length, start);
                damaged[other..other + length].copy_from_slice(&content[stretch]);
            }
        }
        if damaged != content {
            body(&damaged);
        }
    }
}

/// Every byte is accounted for once, and damage always has a notice.
pub fn assert_balanced(log: &Log) {
    let b = &log.health.bytes;
    assert_eq!(b.sum(), b.size, "{b:?}");
    assert!(b.damaged == 0 || lost(log), "{b:?}");
    let messages: u64 = log.health.topics.iter().map(|t| t.messages).sum();
    assert_eq!(messages, log.health.messages);
}

pub fn lost(log: &Log) -> bool {
    log.notices.iter().any(|n| n.severity == Severity::Loss)
}

/// Whether a notice of this code is a loss.
pub fn is_loss(log: &Log, code: &str) -> bool {
    log.notices.iter().any(|n| n.code == code && n.severity == Severity::Loss)
}

/// The notice of this code.
pub fn notice<'l>(log: &'l Log, code: &str) -> &'l flight::Notice {
    log.notices.iter().find(|n| n.code == code).unwrap_or_else(|| panic!("no {code} in {:?}", log.notices))
}

/// The rows of a table of fixes, as sent. Checks that no value is absent.
pub fn received(table: &Table, published: bool) -> Vec<Sent> {
    let integer = |path: &str, row| table.column(path).unwrap().integer(row).unwrap();
    (0..table.rows)
        .map(|row| Sent {
            topic: FIX,
            logged_ns: table.logged_ns.as_ref().unwrap()[row],
            published_ns: if published { table.published_ns.as_ref().unwrap()[row] } else { 0 },
            stamp_ns: integer("header.stamp", row),
            latitude: table.column("latitude").unwrap().number(row).unwrap(),
            status: integer("status", row) as i32,
            frame: table.column("header.frame_id").unwrap().text(row).unwrap().to_string(),
        })
        .collect()
}

/// Bit for bit the same message. Bags have no time of publishing.
pub fn same(a: &Sent, b: &Sent, published: bool) -> bool {
    (a.logged_ns, a.stamp_ns, a.latitude.to_bits(), a.status, &a.frame)
        == (b.logged_ns, b.stamp_ns, b.latitude.to_bits(), b.status, &b.frame)
        && (!published || a.published_ns == b.published_ns)
}

/// Asserts that exactly these fixes came, in this order.
pub fn assert_received(log: &Log, sent: &[Sent], published: bool) {
    let fixes: Vec<&Sent> = sent.iter().filter(|s| s.topic == FIX).collect();
    let got = log.tables.iter().find(|t| t.topic.name == FIX).map(|t| received(t, published)).unwrap_or_default();
    assert_eq!(got.len(), fixes.len());
    assert!(got.iter().zip(&fixes).all(|(a, b)| same(a, b, published)));
}

/// How many of the fixes came; asserts that they came unchanged and in order.
pub fn assert_subset(log: &Log, sent: &[Sent], published: bool) -> usize {
    let mut fixes = sent.iter().filter(|s| s.topic == FIX);
    let got = log.tables.iter().find(|t| t.topic.name == FIX).map(|t| received(t, published)).unwrap_or_default();
    for one in &got {
        assert!(fixes.any(|fix| same(one, fix, published)), "row at {} was never sent", one.logged_ns);
    }
    got.len()
}

/// Cuts a log of `sent` to each of these lengths, which fall. What is then read is the beginning of the flight and a loss,
/// and with the last cuts all fixes are there.
pub fn check_cuts(content: &[u8], is_bag: bool, lengths: impl Iterator<Item = usize>, sent: &[Sent], case: &str) {
    let disk = OnDisk::new(content, is_bag);
    let mut most = 0;
    for length in lengths {
        disk.set_len(length as u64);
        let Ok(log) = disk.read() else { continue };
        assert!(lost(&log), "{case} cut at {length}");
        let rows = assert_subset(&log, sent, !is_bag);
        assert_received(&log, &sent[..(3 * rows).min(sent.len())], !is_bag);
        most = most.max(rows);
    }
    assert_eq!(most, sent.iter().filter(|s| s.topic == FIX).count(), "{case}");
}

/// Sum and number of all present values of a column.
pub fn sum(table: &Table, path: &str) -> (usize, f64) {
    let column = table.column(path).unwrap_or_else(|| panic!("no column {path}"));
    let values: Vec<f64> = (0..table.rows).filter_map(|row| column.number(row)).collect();
    (values.len(), exact_sum(&values))
}

/// Sum of whole numbers, exactly.
pub fn whole_sum(table: &Table, path: &str) -> i128 {
    match &table.column(path).unwrap().data {
        ColumnData::I64(values) => values.iter().map(|&v| i128::from(v)).sum(),
        other => panic!("{path}: {other:?}"),
    }
}

/// Correctly rounded for our sizes: two-sum compensation (Neumaier 1974).
fn exact_sum(values: &[f64]) -> f64 {
    let (mut sum, mut rest) = (0.0_f64, 0.0);
    for &v in values {
        let next = sum + v;
        rest += if sum.abs() >= v.abs() { (sum - next) + v } else { (v - next) + sum };
        sum = next;
    }
    sum + rest
}
