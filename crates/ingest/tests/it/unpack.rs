//! Packed logs, intact or damaged, read like the logs inside them.

use crate::made;
use crate::support::*;
use ingest::{FlightUnit, IngestError, Limits, Loaded, LogError, LogKind, MapLibrary, ScanError};
use std::io::Write;
use std::path::Path;

/// A FlySight table with this many rows.
fn flysight(rows: u32) -> Vec<u8> {
    let mut text = "time,lat,lon,hMSL,velN,velE,velD,gpsFix\n,(deg),(deg),(m),(m/s),(m/s),(m/s),\n".to_owned();
    for i in 0..rows {
        let (s, tenth) = (i / 10, i % 10);
        let time = format!("2024-05-10T{:02}:{:02}:{:02}.{tenth}0Z", 10 + s / 3600, s / 60 % 60, s % 60);
        let noise = f64::from(i.wrapping_mul(2_654_435_761) >> 16) * 1e-6;
        text += &format!("{time},{:.7},7.0,100,{noise:.6},1,0,3\n", 47.0 + 1e-6 * f64::from(i));
    }
    text.into_bytes()
}

fn gzip(content: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(vec![], flate2::Compression::default());
    encoder.write_all(content).unwrap();
    encoder.finish().unwrap()
}

fn bzip2(content: &[u8]) -> Vec<u8> {
    let mut encoder = bzip2::write::BzEncoder::new(vec![], bzip2::Compression::fast());
    encoder.write_all(content).unwrap();
    encoder.finish().unwrap()
}

fn lz4(content: &[u8]) -> Vec<u8> {
    let mut encoder = lz4::EncoderBuilder::new().build(vec![]).unwrap();
    encoder.write_all(content).unwrap();
    encoder.finish().0
}

fn zstd(content: &[u8]) -> Vec<u8> {
    zstd::stream::encode_all(content, 1).unwrap()
}

/// A ZIP archive, deflated or stored (PKWARE APPNOTE 6.3).
fn zip(files: &[(&str, &[u8])], deflate: bool) -> Vec<u8> {
    let (mut archive, mut list) = (vec![], vec![]);
    for (name, content) in files {
        let mut packed = content.to_vec();
        if deflate {
            let mut encoder = flate2::write::DeflateEncoder::new(vec![], flate2::Compression::default());
            encoder.write_all(content).unwrap();
            packed = encoder.finish().unwrap();
        }
        let header_at = archive.len() as u32;
        let mut shared = vec![20, 0, 0, 0, if deflate { 8 } else { 0 }, 0, 0, 0, 0, 0];
        shared.extend(crc32fast::hash(content).to_le_bytes());
        shared.extend((packed.len() as u32).to_le_bytes());
        shared.extend((content.len() as u32).to_le_bytes());
        shared.extend((name.len() as u16).to_le_bytes());
        shared.extend([0, 0]);
        archive.extend(b"PK\x03\x04");
        archive.extend(&shared);
        archive.extend(name.as_bytes());
        archive.extend(packed);
        list.extend(b"PK\x01\x02\x14\x00");
        list.extend(shared);
        list.extend([0; 10]);
        list.extend(header_at.to_le_bytes());
        list.extend(name.as_bytes());
    }
    let (at, count) = (archive.len() as u32, files.len() as u16);
    let bytes = list.len() as u32;
    archive.extend(list);
    archive.extend(b"PK\x05\x06\0\0\0\0");
    archive.extend([count.to_le_bytes(), count.to_le_bytes()].concat());
    archive.extend([bytes.to_le_bytes(), at.to_le_bytes()].concat());
    archive.extend([0, 0]);
    archive
}

fn utf16(text: &[u8], big: bool, mark: bool) -> Vec<u8> {
    let text = std::str::from_utf8(text).unwrap();
    let units = mark.then_some('\u{feff}').into_iter().chain(text.chars()).collect::<String>();
    units.encode_utf16().flat_map(|u| if big { u.to_be_bytes() } else { u.to_le_bytes() }).collect()
}

fn bag() -> Vec<u8> {
    made::bag(&made::flight(40), made::BagCodec::None, 10, true, true)
}

/// Loads the only flight found in a file.
fn load_found(path: &Path) -> Loaded {
    let found = ingest::discover(path.parent().unwrap(), &MapLibrary::shipped().unwrap()).unwrap();
    assert_eq!(found.units.len(), 1, "{found:?}");
    let loaded = load(&found.units[0]).unwrap();
    assert_ledger(&loaded);
    loaded
}

fn load_packed(name: &str, content: &[u8]) -> Loaded {
    let (_folder, path) = file(name, content);
    load_found(&path)
}

fn refused(name: &str, content: &[u8]) -> String {
    let (folder, _path) = file(name, content);
    let found = ingest::discover(folder.path(), &MapLibrary::shipped().unwrap()).unwrap();
    assert!(found.units.is_empty(), "{found:?}");
    found.ignored[0].1.clone()
}

#[test]
fn a_packed_log_yields_the_same_flight_and_counts_unpacked_bytes() {
    let table = flysight(300);
    let plain = load_packed("jump.csv", &table);
    let half = table.len() / 2;
    for (name, content) in [
        ("jump.csv.gz", gzip(&table)),
        ("jump.csv.gz", [gzip(&table[..half]), gzip(&table[half..])].concat()),
        ("jump.csv.zst", zstd(&table)),
        ("jump.csv.zst", [zstd(&table[..half]), zstd(&table[half..])].concat()),
        ("jump.csv.bz2", bzip2(&table)),
        ("jump.csv.lz4", lz4(&table)),
        ("jump.zip", zip(&[("card/jump.csv", &table)], true)),
        ("jump.zip", zip(&[("card/.ros/log/jump.csv", &table), ("card/._jump.csv", b"\0\x05\x16\x07")], true)),
        ("jump.zip", zip(&[("../../../jump.csv", &table)], true)),
        ("jump.zip", zip(&[("jump.csv", &table), ("card/readme.md", b"# Hello"), ("photo.png", b"\x89PNG")], false)),
        ("jump.csv", utf16(&table, false, true)),
        ("jump.csv", utf16(&table, true, true)),
        ("jump.txt", utf16(&table, false, false)),
    ] {
        let loaded = load_packed(name, &content);
        assert_eq!(loaded.flight.channels, plain.flight.channels, "{name}");
        assert_eq!(loaded.health.bytes, plain.health.bytes, "{name}");
        assert!(loaded.health.format.starts_with(&format!("{}, in ", plain.health.format)), "{}", loaded.health.format);
        assert!(!lossy(&loaded), "{name}");
    }
}

#[test]
fn a_packed_log_of_messages_is_read_as_well() {
    let bag = bag();
    let plain = load_packed("flight.bag", &bag);
    for (name, content) in [("flight.bag.gz", gzip(&bag)), ("flight.zip", zip(&[("flight.bag", &bag)], true))] {
        let loaded = load_packed(name, &content);
        assert_eq!(loaded.health.messages, plain.health.messages, "{name}");
        assert_eq!(loaded.flight.channels, plain.flight.channels, "{name}");
    }
}

#[test]
fn a_bag_of_a_killed_recorder_is_unpacked_with_its_sidecars() {
    let folder = tempfile::tempdir().unwrap();
    let bag = crate::db3::killed(folder.path(), &made::flight(60));
    let wal = folder.path().join("bag.db3-wal");
    let plain = load_found(&bag).health.messages;
    let (database, ahead) = (std::fs::read(&bag).unwrap(), std::fs::read(&wal).unwrap());
    let packed = zip(&[("b/bag.db3", &database), ("b/bag.db3-wal", &ahead)], true);
    assert_eq!(load_packed("bag.zip", &packed).health.messages, plain);
    std::fs::remove_file(&bag).unwrap();
    for (name, content) in [("bag.db3.gz", gzip(&database)), ("bag.db3.zstd", zstd(&database))] {
        let path = folder.path().join(name);
        std::fs::write(&path, content).unwrap();
        assert_eq!(load_found(&path).health.messages, plain, "{name}");
        std::fs::remove_file(path).unwrap();
    }
}

#[test]
fn a_zip_without_a_valid_list_of_files_is_refused() {
    let bag = bag();
    let archive = zip(&[("readme.md", b"# Hello"), ("flight.bag", &bag), ("another.bag", &bag)], false);
    // The end record says that the list begins at its last file.
    let entry = |name: &str| 46 + name.len() as u32;
    let (bytes, at) = (archive.len() - 10, archive.len() - 6);
    let begin = u32::from_le_bytes(archive[at..at + 4].try_into().unwrap());
    let mut lying = archive.clone();
    lying[bytes..bytes + 4].copy_from_slice(&entry("another.bag").to_le_bytes());
    lying[at..at + 4].copy_from_slice(&(begin + entry("readme.md") + entry("flight.bag")).to_le_bytes());
    assert!(refused("two.zip", &lying).contains("without a valid list of files"));
    // Truncated, as after an interrupted download.
    for length in [30, archive.len() / 2, archive.len() - 1] {
        let why = refused("two.zip", &archive[..length]);
        assert!(why.contains("it is truncated or damaged; `zip -FF` may repair it"), "{length}: {why}");
    }
}

#[test]
fn space_after_the_list_of_files_is_no_damage() {
    let plain = zip(&[("jump.csv", &flysight(300))], true);
    let room = [&plain[..plain.len() - 22], &[0; 8], &plain[plain.len() - 22..]].concat();
    assert!(!lossy(&load_packed("jump.zip", &room)));
}

#[test]
fn data_packed_before_the_damage_is_read_and_the_loss_is_located() {
    let table = flysight(20_000);
    for (name, packed, fault) in [
        ("jump.csv.gz", gzip(&table), "the gzip data are truncated"),
        ("jump.csv.zst", zstd(&table), "the Zstandard data are truncated"),
        ("jump.csv.bz2", bzip2(&table), "the bzip2 data are truncated"),
    ] {
        let cut = packed.len() * 7 / 10;
        let loaded = load_packed(name, &packed[..cut]);
        assert!(lossy(&loaded), "{name}");
        let notice = loaded.flight.notices.iter().find(|n| n.code == "corrupt").unwrap();
        assert!(notice.place.starts_with(name) && notice.place.contains("byte"), "{}", notice.place);
        let kept = format!("; only the {} bytes unpacked before it are read", loaded.health.bytes.size);
        assert!(notice.text.starts_with(fault) && notice.text.contains(&kept), "{name}: {}", notice.text);
        assert!(loaded.health.messages > 8000, "{name}: {}", loaded.health.messages);
    }
}

#[test]
fn a_wrong_checksum_costs_a_line_at_most() {
    let table = flysight(3000);
    let mut encoder = zstd::stream::Encoder::new(vec![], 1).unwrap();
    encoder.include_checksum(true).unwrap();
    encoder.write_all(&table).unwrap();
    let mut packed = encoder.finish().unwrap();
    *packed.last_mut().unwrap() ^= 1;
    let loaded = load_packed("jump.csv.zst", &packed);
    assert!(lossy(&loaded));
    assert!(table.len() as u64 - loaded.health.bytes.size < 1024, "{}", loaded.health.bytes.size);
}

#[test]
fn a_changed_byte_in_a_packed_log_is_never_silent() {
    let table = flysight(300);
    let plain = load_packed("jump.csv", &table);
    for (name, packed) in [
        ("jump.csv.gz", gzip(&table)),
        ("jump.csv.bz2", bzip2(&table)),
        ("jump.zip", zip(&[("jump.csv", &table)], true)),
    ] {
        for at in (0..packed.len()).step_by(packed.len() / 40) {
            let mut damaged = packed.clone();
            damaged[at] ^= 0x10;
            let (folder, _path) = file(name, &damaged);
            let found = ingest::discover(folder.path(), &MapLibrary::shipped().unwrap()).unwrap();
            let Some(unit) = found.units.first() else { continue };
            let Ok(loaded) = load(unit) else { continue };
            let same = loaded.flight.channels == plain.flight.channels;
            assert!(same || lossy(&loaded), "{name}, byte {at}: {:?}", loaded.flight.notices);
        }
    }
}

#[test]
fn several_logs_no_log_and_a_log_packed_twice_are_rejected_with_a_reason() {
    let table = flysight(20);
    let bag = bag();
    for (name, content, word) in [
        ("a.zip", zip(&[("one.bag", &bag), ("two.bag", &bag)], true), "several logs, one.bag, two.bag"),
        ("a.zip", zip(&[("one.csv", &table), ("two.csv", &table)], true), "several logs, one.csv, two.csv"),
        ("a.zip", zip(&[("photo.png", b"\x89PNG")], true), "photo.png is PNG image"),
        ("a.zip", zip(&[], true), "without a file"),
        ("a.csv.zst", zstd(&table)[..9].to_vec(), "cannot be unpacked: the Zstandard data are truncated"),
        ("a.zip", zip(&[("jump.csv.gz", &gzip(&table))], false), "packed again"),
        ("a.csv.gz.gz", gzip(&gzip(&table)), "packed again"),
        ("a.tar.gz", gzip(&[vec![b'x'; 257], b"ustar".to_vec(), vec![0; 300]].concat()), "tar archive"),
        ("a.csv.gz", gzip(&vec![0; 1 << 20]), "only zero bytes"),
        ("a.xz", b"\xfd7zXZ\0\0\0".to_vec(), "xz file"),
    ] {
        assert!(refused(name, &content).contains(word), "{name}: {}", refused(name, &content));
    }
}

#[test]
fn tables_of_one_flight_in_one_archive_form_that_flight() {
    let rows = |row: &dyn Fn(u32) -> String| (0..30).map(row).collect::<String>().into_bytes();
    let gps = rows(&|i| format!("{} 47.{i:03} 8.5 400 1 2 3\r\n", 200 * i));
    let imu = rows(&|i| format!("  {}  0 0.1 0.2 0.3 1 2 -9.8\r\n", 20 * i));
    let loaded =
        load_packed("log.zip", &zip(&[("GPSraw.txt", &gps), ("IMU.txt", &imu), ("timing.txt", b"1\n2\n")], true));
    assert_eq!(loaded.binding.as_ref().unwrap().map, "inertial-nav");
    assert_eq!(loaded.flight.channels["velocity.gps"].series.components()[1][0], 2.0);
    assert_eq!(loaded.flight.channels["specific-force.imu"].series.len(), 30);
}

#[test]
fn a_bomb_stops_at_the_limit_and_names_it() {
    let mut table = flysight(10);
    table.resize(8 << 20, b' ');
    for (name, packed) in [("jump.csv.gz", gzip(&table)), ("jump.zip", zip(&[("jump.csv", &table)], true))] {
        assert!(packed.len() < 20_000);
        let (_folder, path) = file(name, &packed);
        let unit = FlightUnit { id: "bomb".into(), files: vec![path], kind: LogKind::Csv };
        let limits = Limits { unpacked_bytes: 1 << 20, ..Limits::default() };
        let library = MapLibrary::shipped().unwrap();
        let error = with_limits(limits, |context| ingest::load(&unit, &library, None, context)).unwrap_err();
        assert!(
            matches!(&error, IngestError::Log(LogError::Unusable { what, .. }) if what.contains("limit of 1048576 bytes")),
            "{error}"
        );
    }
}

#[test]
fn zeros_in_a_packed_log_are_zeros_in_the_unpacked_one() {
    let mut table = flysight(10);
    let length = table.len() as u64;
    table.resize(3 << 20, 0);
    let loaded = load_packed("jump.csv.gz", &gzip(&table));
    let b = loaded.health.bytes;
    assert_eq!((b.size, b.damaged, loaded.health.messages), (3 << 20, (3 << 20) - length, 10));
}

#[test]
fn a_stop_request_is_honoured_while_unpacking() {
    let (_folder, path) = file("jump.csv.gz", &gzip(&flysight(20_000)));
    let cancel = std::sync::atomic::AtomicBool::new(true);
    let context = ingest::ReadContext { limits: Limits::default(), cancel: &cancel, on_bytes: &|_| () };
    let library = MapLibrary::shipped().unwrap();
    assert!(matches!(
        ingest::load(&tables(&[path]), &library, None, &context),
        Err(IngestError::Log(LogError::Read(ScanError::Cancelled)))
    ));
}

/// A skippable frame (RFC 8878, 3.1.2), as `pzstd` writes them.
fn skippable(kind: u8, content: &[u8]) -> Vec<u8> {
    [&[0x50 + kind, 0x2a, 0x4d, 0x18], &(content.len() as u32).to_le_bytes()[..], content].concat()
}

#[test]
fn skippable_frames_may_precede_and_follow_a_log() {
    let bag = bag();
    let (front, back) = bag.split_at(bag.len() / 2);
    let plain = load_packed("a.bag", &bag).health;
    for (name, content) in [
        ("a.bag.zst", [skippable(0, b"size"), zstd(&bag)].concat()),
        (
            "a.bag.zst",
            [skippable(15, b""), skippable(3, &[0; 300]), zstd(front), skippable(0, b"more"), zstd(back)].concat(),
        ),
        ("a.bag.lz4", [skippable(7, b"size"), lz4(&bag), skippable(0, b"more")].concat()),
    ] {
        let loaded = load_packed(name, &content);
        assert_eq!((loaded.health.messages, &loaded.health.bytes), (plain.messages, &plain.bytes), "{name}");
        assert!(!lossy(&loaded), "{name}: {:?}", loaded.flight.notices);
    }
}

#[test]
fn a_log_packed_with_a_dictionary_is_reported_to_need_it() {
    let samples: Vec<Vec<u8>> = (0..2000_u32).map(|i| format!("{i:08} {} fix", i * i).into_bytes()).collect();
    let dictionary = zstd::dict::from_samples(&samples, 1000).unwrap();
    let packed = zstd::bulk::Compressor::with_dictionary(3, &dictionary).unwrap().compress(&bag()).unwrap();
    let why = refused("a.bag.zst", &packed);
    assert!(why.contains("need the dictionary"), "{why}");
}

#[test]
fn gzip_members_form_one_log_and_trailing_data_is_reported() {
    let bag = bag();
    let (front, back) = bag.split_at(bag.len() / 2);
    let members = [gzip(front), gzip(back)].concat();
    let loaded = load_packed("a.bag.gz", &members);
    assert!(!lossy(&loaded), "{:?}", loaded.flight.notices);
    assert_eq!((loaded.health.messages, loaded.health.bytes.size), (120, bag.len() as u64));
    for tail in [&b"junk"[..], b"\0\0\0junk", &[0; 512], &gzip(back)[..9]] {
        let loaded = load_packed("a.bag.gz", &[&members, tail].concat());
        assert_eq!((loaded.health.messages, count_of(&loaded, "corrupt") > 0), (120, true), "{tail:?}");
    }
}

#[test]
fn concatenated_packed_parts_are_read_up_to_the_damage() {
    let sentence = |i: usize| {
        let time = format!("12{:02}{:02}.00", i / 60, i % 60);
        let body = format!("GPGGA,{time},4807.{:03},N,01131.000,E,1,08,0.9,5.4,M,46.9,M,,", i * 7 % 1000);
        format!("${body}*{:02X}\r\n", body.bytes().fold(0, |sum, b| sum ^ b))
    };
    type Pack = fn(&[u8]) -> Vec<u8>;
    let packers: [(&str, Pack); 4] =
        [("a.nmea.gz", gzip), ("a.nmea.zst", zstd), ("a.nmea.bz2", bzip2), ("a.nmea.lz4", lz4)];
    for (name, pack) in packers {
        let parts: Vec<Vec<u8>> = (0..5)
            .map(|part| pack((0..200).map(|i| sentence(200 * part + i)).collect::<String>().as_bytes()))
            .collect();
        for hurt in 0..5 {
            let mut zeros = parts.clone();
            let middle = zeros[hurt].len() / 2;
            zeros[hurt][middle..middle + 64].fill(0);
            let (_folder, path) = file(name, &zeros.concat());
            let loaded = load(&FlightUnit { id: "test".into(), files: vec![path], kind: LogKind::Nmea });
            // For LZ4 and bzip2 nothing of the damaged part is unpacked.
            let Ok(loaded) = loaded else {
                assert_eq!(hurt, 0, "{name}");
                continue;
            };
            let (least, most) = (200 * hurt as u64, 200 * (hurt as u64 + 1));
            assert!((least..=most).contains(&loaded.health.messages), "{name} {hurt}: {}", loaded.health.messages);
            let reported: Vec<&flight::Notice> = loaded.flight.notices.iter().filter(|n| n.code == "corrupt").collect();
            assert!(lossy(&loaded) && reported.len() == 1, "{name} {hurt}: {reported:?}");
            let left = zeros[hurt + 1..].concat().len() as u64;
            assert!(
                reported[0].text.contains("unpacked before it are read") && reported[0].count > left,
                "{name} {hurt}: {reported:?}"
            );
        }
    }
}

#[test]
fn a_sparse_end_of_a_packed_log_is_reported_and_not_read_through() {
    let (_folder, path) = file("a.bag.gz", &gzip(&bag()));
    std::fs::OpenOptions::new().write(true).open(&path).unwrap().set_len(100 << 30).unwrap();
    let unit = FlightUnit { id: "test".into(), files: vec![path], kind: LogKind::Bag };
    let loaded = load(&unit).unwrap();
    assert_eq!(loaded.health.messages, 120);
    assert!(count_of(&loaded, "corrupt") > 0, "{:?}", loaded.flight.notices);
}
