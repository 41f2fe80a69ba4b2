//! P6: files that are made to take long. Their intact parts are still read, quickly.

use crate::lab::{Lab, seeds};
use ingest::{LogKind, Selection, TopicInfo};

/// Bytes of a file in the normal suite: searched in vain from every place, each would keep it busy for minutes.
const SMALL: usize = 256 << 10;
/// Bytes for the table of times that `just faults` prints.
const LARGE: usize = 4 << 20;

/// A hostile file: `head`, then `unit` repeatedly, and the end for a file of that length.
struct Hostile {
    name: &'static str,
    kind: LogKind,
    head: Vec<u8>,
    unit: Vec<u8>,
    /// Intact messages in each unit that must be found, as a message after them confirms them.
    intact: u64,
    tail: fn(usize) -> Vec<u8>,
}

impl Hostile {
    fn new(name: &'static str, kind: LogKind, head: Vec<u8>, unit: Vec<u8>, intact: u64) -> Hostile {
        Hostile { name, kind, head, unit, intact, tail: |_| vec![] }
    }

    /// A file of about this size, and the messages that are intact in its units.
    fn of_size(&self, bytes: usize) -> (Vec<u8>, u64) {
        let units = bytes / self.unit.len();
        let body = [self.head.clone(), self.unit.repeat(units)].concat();
        let tail = (self.tail)(body.len());
        ([body, tail].concat(), self.intact * units as u64)
    }
}

fn ulog_message(kind: u8, body: &[u8]) -> Vec<u8> {
    [&(body.len() as u16).to_le_bytes(), &[kind][..], body].concat()
}

fn subscription(number: u16, name: &[u8]) -> Vec<u8> {
    ulog_message(b'A', &[&[0][..], &number.to_le_bytes(), name].concat())
}

fn ulogs() -> Vec<Hostile> {
    let ulog = |name, head: &[&[u8]], unit: &[u8], intact| {
        let start = b"ULog\x01\x12\x35\x01\0\0\0\0\0\0\0\0".as_slice();
        let head = [start, &ulog_message(b'B', &[0; 40]), &head.concat()].concat();
        Hostile::new(name, LogKind::Ulog, head, unit.to_vec(), intact)
    };
    let format = ulog_message(b'F', b"m:uint64_t timestamp;float x;");
    let small = [format.as_slice(), &subscription(0, b"m")].concat();
    let data = ulog_message(b'D', &[0; 14]);
    let wide = |name: &str| {
        let fields: String = (0..4000).map(|i| format!("uint8_t a{i};")).collect();
        ulog_message(b'F', format!("{name}:uint64_t timestamp;{fields}").as_bytes())
    };
    vec![
        ulog("ulog: names of 16 KiB at every byte", &[&small, &data], b"A", 0),
        ulog("ulog: formats at every byte", &[&small, &data], &[&b"\x7f\0"[..], &[b'F'; 125], b":"].concat(), 0),
        ulog("ulog: information at every byte", &[&small, &data], &[&[b'I'; 60][..], b" "].concat(), 0),
        ulog("ulog: good at a glance", &[&small, &data], &[b"~{Fa:b c;".repeat(3640), vec![1]].concat(), 0),
        ulog("ulog: a wide topic again and again", &[&wide("vehicle_status")], &subscription(0, b"vehicle_status"), 0),
        ulog(
            "ulog: two topics in turn",
            &[&wide("w"), &format],
            &[subscription(0, b"w"), subscription(0, b"m")].concat(),
            0,
        ),
        ulog("ulog: a byte behind every third message", &[&small], &[data.repeat(3), vec![b'x']].concat(), 3),
        ulog("ulog: messages of five bytes", &[&ulog_message(b'F', b"m:"), &subscription(0, b"m")], b"\x02\0D\0\0", 1),
    ]
}

fn dataflashes() -> Vec<Hostile> {
    let format = |id: u8, length: u8, name: &[u8], codes: &[u8]| {
        let padded = |text: &[u8], width: usize| [text, &vec![0; width - text.len()]].concat();
        let names: Vec<String> = (0..codes.len()).map(|i| format!("f{i}")).collect();
        let names = names.join(",");
        let text = [padded(name, 4), padded(codes, 16), padded(names.as_bytes(), 64)].concat();
        [&[0xa3, 0x95, 128, id, length][..], &text].concat()
    };
    let head = [format(128, 89, b"FMT", b"BBnNZ"), format(7, 3, b"TINY", b""), format(8, 252, b"BIG", b"ZZZNNNb")];
    let [tiny, big] = [[0xa3, 0x95, 7], [0xa3, 0x95, 8]];
    let log =
        |name, unit: &[&[u8]], intact| Hostile::new(name, LogKind::DataFlash, head.concat(), unit.concat(), intact);
    vec![
        log("dataflash: sync bytes alone", &[&[0xa3, 0x95]], 0),
        log("dataflash: definitions that overlap", &[&[0xa3, 0x95, 128]], 0),
        log("dataflash: types that are not defined", &[&[0xa3, 0x95, 51]], 0),
        log("dataflash: long records in front of short ones", &[&big, &tiny], 1),
        log("dataflash: records of three bytes", &[&tiny], 1),
    ]
}

/// The checksum of MAVLink.
fn crc16(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xffff, |crc, byte| {
        (0..8).fold(crc ^ u16::from(*byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0x8408 } else { crc >> 1 })
    })
}

fn tlogs() -> Vec<Hostile> {
    let time = 1_700_000_000_000_000_u64.to_be_bytes();
    let frame = |message: u8, payload: &[u8], extra: u8| {
        let inner = [&[payload.len() as u8, 0, 0, 7, 1, 1, message, 0, 0][..], payload].concat();
        let crc = crc16(&[inner.as_slice(), &[extra]].concat());
        [&time[..], &[0xfd], &inner, &crc.to_le_bytes()].concat()
    };
    let heartbeat = frame(0, &[0, 0, 0, 0, 2, 3, 81, 4, 3], 50);
    let log =
        |name, unit: &[&[u8]], intact| Hostile::new(name, LogKind::Tlog, heartbeat.repeat(3), unit.concat(), intact);
    vec![
        log("tlog: long frames at every fifth byte", &[&[0, 5, 1, 0xfd, 255]], 0),
        log("tlog: frames at every third byte", &[&[0, 5, 0xfd]], 0),
        log("tlog: a byte behind every frame", &[&heartbeat, b"x"], 1),
        log(
            "tlog: a long frame behind every short one",
            &[&heartbeat, &time, &[0xfd, 0xff, 0, 0, 0, 0, 0, 0, 0, 0]],
            1,
        ),
        log("tlog: messages that are not defined", &[&frame(230, b"abcd", 163), &frame(199, b"abcd", 7)], 2),
    ]
}

fn receivers() -> Vec<Hostile> {
    let poll = [0xb5, 0x62, 0x06, 0x08, 0, 0, 0x0e, 0x30];
    let ubx = |name, unit: &[&[u8]], intact| Hostile::new(name, LogKind::Ubx, poll.repeat(3), unit.concat(), intact);
    let sentence = b"$GPVTG,084.4,T,,M,022.4,N,041.5,K*40\r\n";
    let nmea =
        |name, unit: &[&[u8]], intact| Hostile::new(name, LogKind::Nmea, sentence.repeat(4), unit.concat(), intact);
    vec![
        ubx("ubx: frames of 64 KiB at every sixth byte", &[&[0xb5, 0x62, 1, 7, 0xff, 0xff]], 0),
        ubx("ubx: a frame of 64 KiB behind every short one", &[&poll, &[0xb5, 0x62, 1, 7, 0xff, 0xff]], 1),
        ubx("ubx: a correction of 1 KiB behind every frame", &[&poll, &[0xd3, 3, 0xff]], 1),
        ubx("ubx: dollars", &[b"$"], 0),
        ubx("ubx: sentences that do not end", &[&poll, b"!AAA,"], 1),
        nmea("nmea: dollars on lines of their own", &[b"$\n"], 0),
        nmea("nmea: sentences that do not end", &[&b"!AAA,".repeat(1000), b"\n"], 0),
        nmea("nmea: exclamation marks", &[&[b'!'; 500], b"\n"], 0),
    ]
}

fn mcap_record(opcode: u8, length: usize, body: &[u8]) -> Vec<u8> {
    [&[opcode][..], &(length as u64).to_le_bytes(), body].concat()
}

const MAGIC: &[u8] = b"\x89MCAP0\r\n";

/// A summary at `start` as long as the data before it, whose indexes point to chunks inside the summary.
fn summary_of_no_chunks(start: usize) -> Vec<u8> {
    let index = |at: usize| {
        let place = [(start + at) as u64, 100];
        let content =
            [&[0; 16], place.map(u64::to_le_bytes).as_flattened(), &[0; 4], &[0; 8], &[0; 4], &[0; 16]].concat();
        mcap_record(8, content.len(), &content)
    };
    let length = index(0).len();
    let indexes: Vec<u8> = (0..start / length).flat_map(|number| index(20 + number * (length - 13))).collect();
    let footer = mcap_record(2, 20, &[&(start as u64).to_le_bytes()[..], &[0; 12]].concat());
    [&indexes, &footer, MAGIC].concat()
}

fn mcaps() -> Vec<Hostile> {
    let record = |opcode, body: &[u8]| mcap_record(opcode, body.len(), body);
    let text = |text: &[u8]| [&(text.len() as u32).to_le_bytes(), text].concat();
    let header = record(1, &[0; 8]);
    let schema = record(3, &[&[1, 0][..], &text(b"m"), &text(b"ros1msg"), &text(b"uint8 x\n")].concat());
    let channel = record(4, &[&[1, 0, 1, 0][..], &text(b"/m"), &text(b"ros1"), &text(b"")].concat());
    let message = record(5, &[&[1, 0][..], &[0; 20], &[7]].concat());
    let metadata = record(12, &[0; 8]);
    let start = [MAGIC, &header, &schema, &channel, &message].concat();
    let mcap = |name, unit: &[&[u8]], intact| Hostile::new(name, LogKind::Mcap, start.clone(), unit.concat(), intact);
    // A record with a stated length that reaches `rest` bytes further.
    let reaching = |opcode, body: &[u8], rest: usize| mcap_record(opcode, rest - 9, body);
    let chunk = |codec: &[u8], data: usize| {
        [&[0; 16][..], &64_u64.to_le_bytes(), &1_u32.to_le_bytes(), &text(codec), &(data as u64).to_le_bytes()].concat()
    };
    // Ends with what will be the checksum of an earlier record.
    let attachment = |data: usize| [&[0; 24][..], &(data as u64).to_le_bytes(), &[1; 4]].concat();
    let other_log = [&[0; 20], MAGIC, &header, &[0; 8]].concat();
    let heads = 20_000;
    let over_a_log: Vec<u8> =
        (1..=heads).rev().flat_map(|left| reaching(12, &[], 9 * left + other_log.len())).collect();
    // From the start of a unit up to the byte after the heads of a later one, which is not a head.
    let far = |unit: &[u8]| (LARGE / 2 / (unit.len() + 1)) * (unit.len() + 1) + unit.len();
    let after_each = |opcode, fixed: &dyn Fn(usize) -> Vec<u8>| {
        let unit = [metadata.clone(), reaching(opcode, &fixed(0), 0x7fff)].concat();
        let whole = far(&unit) - metadata.len();
        [metadata.clone(), reaching(opcode, &fixed(whole - (unit.len() - metadata.len())), whole), vec![0]].concat()
    };
    vec![
        mcap("mcap: metadata that reach over another log", &[&over_a_log, &other_log], 0),
        Hostile {
            tail: summary_of_no_chunks,
            ..mcap("mcap: damage before chunks that are nowhere", &[&[0], &metadata, &metadata], 0)
        },
        mcap("mcap: a byte behind every second message", &[&message, &message, &[0]], 1),
        mcap("mcap: long messages at every byte", &[&[5, 0, 0, 1, 0, 0, 0, 0, 0]], 0),
        mcap("mcap: a long chunk behind every record", &[&after_each(6, &|data| chunk(b"", data))], 0),
        mcap("mcap: a long lz4 chunk behind every record", &[&after_each(6, &|data| chunk(b"lz4", data))], 0),
        mcap("mcap: a long attachment behind every record", &[&after_each(9, &|data| attachment(data))], 0),
        mcap("mcap: a long schema behind every record", &[&after_each(3, &|_| vec![0xff; 8])], 0),
        mcap("mcap: a long message index behind every record", &[&after_each(7, &|_| vec![0xff; 8])], 0),
        mcap("mcap: long metadata behind every record", &[&after_each(12, &|_| vec![0xff; 8])], 0),
        mcap("mcap: a long private record behind every record", &[&after_each(0x90, &|_| vec![0xff; 8])], 0),
    ]
}

fn bags() -> Vec<Hostile> {
    let field = |name: &[u8], value: &[u8]| {
        [&((name.len() + 1 + value.len()) as u32).to_le_bytes(), name, b"=", value].concat()
    };
    let record = |fields: &[Vec<u8>], length: usize, data: &[u8]| {
        let header = fields.concat();
        [&(header.len() as u32).to_le_bytes(), &header[..], &(length as u32).to_le_bytes(), data].concat()
    };
    let whole = |fields: &[Vec<u8>], data: &[u8]| record(fields, data.len(), data);
    let op = |kind: u8| field(b"op", &[kind]);
    let connection = field(b"conn", &[0; 4]);
    let definition = [
        field(b"type", b"std_msgs/UInt8"),
        field(b"md5sum", &[b'0'; 32]),
        field(b"message_definition", b"uint8 data\n"),
    ];
    let about = [field(b"chunk_count", &[0; 4]), field(b"conn_count", &[0; 4]), field(b"index_pos", &[0; 8])];
    let start = [
        b"#ROSBAG V2.0\n".to_vec(),
        whole(&[vec![op(3)], about.to_vec()].concat(), &[b' '; 16]),
        whole(&[op(7), connection.clone(), field(b"topic", b"/m")], &definition.concat()),
    ];
    let message = whole(&[op(2), connection.clone(), field(b"time", &[0; 8])], &[7]);
    let chunk = |codec: &[u8], length: usize| {
        record(&[op(5), field(b"compression", codec), field(b"size", &64_u32.to_le_bytes())], length, &[])
    };
    // Headers that seem to span all later types.
    let lengths = [1200_u32.to_le_bytes(), 4_u32.to_le_bytes()].concat();
    let over_types = [lengths.repeat(64), op(2).repeat(400)].concat();
    let head = |index_at: usize| {
        let about = field(b"index_pos", &(index_at as u64).to_le_bytes());
        [&b"#ROSBAG V2.0\n"[..], &whole(&[op(3), about], &[b' '; 16])].concat()
    };
    let length = head(0).len();
    let bags: Vec<u8> = (1..1000).rev().flat_map(|left| head(left * length)).collect();
    // Records that all end at the start of a long header without a type.
    let untyped = [&65_530_u32.to_le_bytes()[..], &b"\x01\0\0\0=".repeat(13_106), &[0; 4]].concat();
    let leading = |fields: &[Vec<u8>]| -> Vec<u8> {
        let one = record(fields, 0, &[]).len();
        let records = (0..120_000 / one).rev().flat_map(|left| record(fields, left * one, &[]));
        records.chain(untyped.clone()).collect()
    };
    let index = leading(&[op(4), connection.clone()]);
    let messages = leading(&[op(2), connection.clone(), field(b"time", &[0; 8])]);
    let chunks = leading(&[op(5), field(b"compression", b"lz4"), field(b"size", &64_u32.to_le_bytes())]);
    // Chunks that all end where a message begins.
    let lz4 = [op(5), field(b"compression", b"lz4"), field(b"size", &64_u32.to_le_bytes())];
    let lz4_bytes = record(&lz4, 0, &[]).len();
    let over_others: Vec<u8> = (0..1500).rev().flat_map(|left| record(&lz4, left * lz4_bytes, &[])).collect();
    let info = whole(&[op(6), field(b"chunk_pos", &[0; 8])], &[0; 8]);
    let bag = |name, unit: &[&[u8]], intact| Hostile::new(name, LogKind::Bag, start.concat(), unit.concat(), intact);
    vec![
        bag("bag: a byte behind every second message", &[&message, &message, b"x"], 1),
        bag("bag: a byte behind every chunk's header", &[&chunk(b"none", 0), b"x"], 0),
        bag("bag: a long chunk at every header", &[&chunk(b"lz4", LARGE / 2), b"x"], 0),
        bag("bag: a long chunk behind every message", &[&message, &chunk(b"bz2", LARGE / 2)], 1),
        bag("bag: indexes that lead to one long header", &[&index], 0),
        bag("bag: messages that lead to one long header", &[&messages], 0),
        bag("bag: chunks that lead to one long header", &[&chunks], 0),
        bag("bag: chunks that lead over others to one message", &[&over_others, &message], 0),
        bag("bag: first lines", &[b"#ROSBAG V2.0\n"], 0),
        bag("bag: types at every eighth byte", &[&op(2)], 0),
        bag("bag: headers over many types", &[&over_types], 0),
        Hostile::new("bag: a thousand bags with one index", LogKind::Bag, bags, info, 0),
    ]
}

/// Columns of the hostile tables.
const COLUMNS: usize = 1000;

fn tables() -> Vec<Hostile> {
    // Longer than what layout detection reads: the short lines must not be taken for the table.
    let head = |columns: usize, cell: &str| {
        let row = |cell: &dyn Fn(usize) -> String| (0..columns).map(cell).collect::<Vec<_>>().join(",") + "\n";
        let row_bytes = row(&|_| cell.to_owned());
        let rows = (300 << 10) / row_bytes.len() + 1;
        [row(&|i| format!("c{i}")), row_bytes.repeat(rows)].concat().into_bytes()
    };
    let csv = |name, head: &[u8], unit: &[u8]| Hostile::new(name, LogKind::Csv, head.to_vec(), unit.to_vec(), 0);
    let (wide, words) = (head(20_000, "7"), head(COLUMNS, "up"));
    let below = |head: &[u8]| [head, b"c0,c1\n"].concat();
    vec![
        csv("csv: empty lines below a wide header", &wide, b"\n"),
        csv("csv: short lines below a wide header", &wide, b"1\n"),
        csv("csv: comments below a wide header", &wide, b"#\n"),
        csv("csv: short headers below a wide one", &wide, b"c0,c1\n"),
        csv("csv: short headers with rows below a wide one", &wide, b"c0,c1\n1,2\nc1,c0\n2,1\n"),
        csv("csv: short rows below a wide header", &below(&wide), b"1,2\n"),
        csv("csv: short rows below a wide header of words", &below(&words), b"up,2\n"),
        csv("csv: short headers below a wide one of words", &words, b"c0,c1\nup,2\n"),
        csv("csv: quotes that do not end", &wide, b"\"c0,c1\n"),
    ]
}

fn all() -> Vec<Hostile> {
    [ulogs(), dataflashes(), tlogs(), receivers(), mcaps(), bags(), tables()].into_iter().flatten().collect()
}

#[test]
fn data_before_a_hundred_gigabytes_of_zeros_is_read_quickly() {
    let one_of_each = [
        "mcap-cdr-none",
        "bag-none",
        "db3-bare",
        "ulog",
        "dataflash-binary",
        "dataflash-text",
        "tlog",
        "ubx",
        "nmea",
        "csv-wide",
    ];
    for seed in one_of_each.iter().flat_map(|name| seeds(name)) {
        let mut lab = Lab::new();
        let subject = lab.seed(&seed, 0);
        let (bytes, all) = (&seed.files[0].bytes, |_: &TopicInfo| Selection::All);
        let intact = lab.read(&subject, bytes, seed.name).unwrap().health;
        let health = lab.stretched(&subject, bytes, 100 << 30, seed.name, &all).unwrap().health;
        // The last record counts only if something confirms it.
        assert!(health.messages + 1 >= intact.messages, "{}: {}", seed.name, health.messages);
        assert!(health.bytes.damaged >= 99 << 30, "{}: {:?}", seed.name, health.bytes);
    }
}

#[test]
fn files_made_to_take_long_lose_nothing_silently() {
    let mut lab = Lab::new();
    for hostile in all() {
        let subject = lab.single(hostile.kind, "hostile.bin");
        let (bytes, intact) = hostile.of_size(SMALL);
        let log = lab.read(&subject, &bytes, hostile.name);
        if hostile.kind == LogKind::Csv {
            let columns = log.as_ref().ok().and_then(|log| log.tables.first()).map_or(0, |table| table.columns.len());
            assert!(columns >= COLUMNS, "{}: {columns} columns", hostile.name);
        }
        let messages = log.as_ref().map_or(0, |log| log.health.messages);
        let reported = log.map_or(true, |log| log.notices.any_loss());
        // The last unit may be taken for damage, as nothing confirms it.
        assert!(messages + 1 >= intact || reported, "{}: {messages} messages of {intact}", hostile.name);
    }
}

#[test]
#[ignore = "prints how long they take; `just faults`"]
fn times_of_files_made_to_take_long() {
    for hostile in all() {
        let mut lab = Lab::new();
        let subject = lab.single(hostile.kind, "hostile.bin");
        let (bytes, _) = hostile.of_size(LARGE);
        let _ = lab.read(&subject, &bytes, hostile.name);
        println!("| {} | {} bytes | {:?} |", hostile.name, bytes.len(), lab.slowest);
    }
}
