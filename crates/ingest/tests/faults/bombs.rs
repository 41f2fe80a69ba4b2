//! T5: few bytes that become many.

use crate::lab::{Lab, resident};
use crate::verdict::is_reported;
use ingest::{Log, LogError, LogKind};
use std::io::Write;

/// Resident memory that a bomb may take (T5), bytes.
const RESIDENT: u64 = 64 << 20;

/// A Zstandard frame of zeros, `blocks` of 128 KiB in four bytes each: a window of 1 MiB and no content size.
fn zstd_bomb(blocks: usize) -> Vec<u8> {
    let mut frame = vec![0x28, 0xb5, 0x2f, 0xfd, 0, 0x50];
    for block in 0..blocks {
        let head = u32::from(block + 1 == blocks) | 1 << 1 | (128 << 10) << 3;
        frame.extend(&head.to_le_bytes()[..3]);
        frame.push(0);
    }
    frame
}

/// An LZ4 frame of 4 MiB blocks of zeros.
fn lz4_bomb(mebibytes: usize) -> Vec<u8> {
    let mut encoder = lz4::EncoderBuilder::new().block_size(lz4::BlockSize::Max4MB).build(vec![]).unwrap();
    let zeros = vec![0; 1 << 20];
    (0..mebibytes).for_each(|_| encoder.write_all(&zeros).unwrap());
    encoder.finish().0
}

fn bz2_bomb(mebibytes: usize) -> Vec<u8> {
    let mut encoder = bzip2::write::BzEncoder::new(vec![], bzip2::Compression::best());
    let zeros = vec![0; 1 << 20];
    (0..mebibytes).for_each(|_| encoder.write_all(&zeros).unwrap());
    encoder.finish().unwrap()
}

fn gzip_bomb(mebibytes: usize) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(vec![], flate2::Compression::best());
    let zeros = vec![0; 1 << 20];
    (0..mebibytes).for_each(|_| encoder.write_all(&zeros).unwrap());
    encoder.finish().unwrap()
}

/// An MCAP of one chunk.
fn mcap_of(compression: &str, declared: u64, data: &[u8]) -> Vec<u8> {
    let mut chunk = [[0; 16].as_slice(), &declared.to_le_bytes(), &[0; 4]].concat();
    chunk.extend((compression.len() as u32).to_le_bytes());
    chunk.extend(compression.as_bytes());
    chunk.extend((data.len() as u64).to_le_bytes());
    chunk.extend(data);
    let record = |opcode: u8, content: &[u8]| [&[opcode][..], &(content.len() as u64).to_le_bytes(), content].concat();
    let magic = b"\x89MCAP0\r\n";
    [magic, &record(1, &[0; 8])[..], &record(6, &chunk), &record(2, &[0; 20]), magic].concat()
}

/// A ROS 1 bag of one chunk.
fn bag_of(compression: &str, declared: u32, data: &[u8]) -> Vec<u8> {
    let field = |name: &str, value: &[u8]| {
        [&((name.len() + 1 + value.len()) as u32).to_le_bytes(), name.as_bytes(), b"=", value].concat()
    };
    let record = |header: &[u8], data: &[u8]| {
        [&(header.len() as u32).to_le_bytes(), header, &(data.len() as u32).to_le_bytes(), data].concat()
    };
    let first =
        [field("op", &[3]), field("index_pos", &[0; 8]), field("conn_count", &[0; 4]), field("chunk_count", &[0; 4])];
    let head =
        [field("op", &[5]), field("compression", compression.as_bytes()), field("size", &declared.to_le_bytes())];
    [b"#ROSBAG V2.0\n", &record(&first.concat(), &[b' '; 64])[..], &record(&head.concat(), data)].concat()
}

/// Reads a bomb, which must be reported and take little memory.
fn defused(lab: &mut Lab, kind: LogKind, name: &str, bytes: &[u8], case: &str) -> Result<Log, LogError> {
    let subject = lab.single(kind, name);
    let (read, peak) = resident(|| lab.read(&subject, bytes, case));
    assert!(peak <= RESIDENT + 4 * bytes.len() as u64, "{case}: {peak} bytes resident");
    if let Ok(log) = &read {
        assert!(is_reported(&read, &Log::default()), "{case}: {:?}", log.notices);
        assert!(log.tables.iter().all(|table| table.rows == 0), "{case}");
    }
    read
}

fn reasons(read: &Result<Log, LogError>) -> String {
    match read {
        Ok(log) => log.health.damage.iter().map(|d| d.reason.as_str()).collect::<Vec<_>>().join("; "),
        Err(error) => error.to_string(),
    }
}

#[test]
fn two_gibibytes_in_an_mcap_chunk_are_rejected_for_any_declared_size() {
    let mut lab = Lab::new();
    let bombs = [("zstd", zstd_bomb(16_384)), ("lz4", lz4_bomb(300))];
    for (compression, bomb) in &bombs {
        for (declared, reason) in [(2 << 30, "limit"), (100, ""), (1 << 40, "limit"), (u64::MAX, "limit")] {
            let case = format!("{compression}, {declared} bytes declared");
            let read = defused(&mut lab, LogKind::Mcap, "bomb.mcap", &mcap_of(compression, declared, bomb), &case);
            assert!(reasons(&read).contains(reason), "{case}: {}", reasons(&read));
        }
    }
}

#[test]
fn a_bomb_in_a_bag_chunk_is_rejected_for_any_declared_size() {
    let mut lab = Lab::new();
    for (compression, bomb) in [("lz4", lz4_bomb(300)), ("bz2", bz2_bomb(40))] {
        for declared in [100, 1 << 30, u32::MAX] {
            let case = format!("{compression}, {declared} bytes declared");
            let _ = defused(&mut lab, LogKind::Bag, "bomb.bag", &bag_of(compression, declared, &bomb), &case);
        }
    }
}

#[test]
fn a_chunk_with_a_true_size_within_the_limit_is_read() {
    let mut lab = Lab::new();
    let bomb = zstd_bomb(64);
    let subject = lab.single(LogKind::Mcap, "chunk.mcap");
    // 8 MiB of zeros are not records, but the chunk itself is sound.
    let read = lab.read(&subject, &mcap_of("zstd", 8 << 20, &bomb), "8 MiB");
    assert!(!reasons(&read).contains("zstd"), "{}", reasons(&read));
    let read = lab.read(&subject, &mcap_of("zstd", 7 << 20, &bomb), "8 MiB that declare 7");
    assert!(is_reported(&read, &Log::default()));
}

#[test]
fn a_packed_bomb_stops_at_the_limit_and_names_it() {
    let mut lab = Lab::new();
    lab.limits.unpacked_bytes = 16 << 20;
    for (name, bomb) in [
        ("bomb.csv.zst", zstd_bomb(16_384)),
        ("bomb.csv.lz4", lz4_bomb(300)),
        ("bomb.csv.gz", gzip_bomb(80)),
        ("bomb.csv.bz2", bz2_bomb(80)),
    ] {
        let error = defused(&mut lab, LogKind::Csv, name, &bomb, name).unwrap_err();
        assert!(error.to_string().contains("larger than the limit of 16777216 bytes"), "{name}: {error}");
    }
}

#[test]
fn unpacking_stops_at_an_implausible_compression_ratio() {
    let mut lab = Lab::new();
    let head = b"ULog\x01\x12\x35\x01\0\0\0\0\0\0\0\0";
    let start = zstd::bulk::compress(head, 1).unwrap();
    for (name, kind, bomb) in [
        ("bomb.ulg.zst", LogKind::Ulog, [start, zstd_bomb(16_384)].concat()),
        ("bomb.csv.gz", LogKind::Csv, gzip_bomb(80)),
        ("bomb.nmea.bz2", LogKind::Nmea, bz2_bomb(80)),
    ] {
        let subject = lab.single(kind, name);
        let (read, peak) = resident(|| lab.read(&subject, &bomb, name));
        assert!(peak <= RESIDENT, "{name}: {peak} bytes resident");
        assert!(is_reported(&read, &Log::default()), "{name}");
        if let Ok(log) = &read {
            assert!(log.health.bytes.size <= 33 << 20, "{name}: {:?}", log.health.bytes);
            assert!(log.notices.iter().any(|n| n.text.contains("100 times")), "{name}: {:?}", log.notices);
        }
    }
}

#[test]
fn a_zstandard_window_of_two_gibibytes_is_rejected() {
    let mut lab = Lab::new();
    // Window descriptor: exponent 21 above 2^10.
    let mut frame = zstd_bomb(16);
    frame[5] = 21 << 3;
    let read = defused(&mut lab, LogKind::Csv, "window.csv.zst", &frame, "window of 2 GiB");
    assert!(read.unwrap_err().to_string().contains("the window is larger than the limit of 2^27 bytes"));
    let _ =
        defused(&mut lab, LogKind::Mcap, "window.mcap", &mcap_of("zstd", 100, &frame), "window of 2 GiB in a chunk");
}

#[test]
fn concatenated_and_skippable_frames_are_read() {
    let mut lab = Lab::new();
    let table = b"time_s,latitude_deg\n1,47.1\n2,47.2\n3,47.3\n4,47.4\n5,47.5\n".as_slice();
    let zstd = |bytes: &[u8]| zstd::bulk::compress(bytes, 1).unwrap();
    let (front, back) = table.split_at(25);
    let skipped = [&0x184D_2A50_u32.to_le_bytes()[..], &3_u32.to_le_bytes(), b"abc"].concat();
    for (case, packed) in [
        ("two frames", [zstd(front), zstd(back)].concat()),
        ("a frame to skip between two", [zstd(front), skipped.clone(), zstd(back)].concat()),
    ] {
        let subject = lab.single(LogKind::Csv, "t.csv.zst");
        let log = lab.read(&subject, &packed, case).unwrap();
        assert_eq!(log.tables[0].rows, 5, "{case}: {:?}", log.notices);
    }
}
