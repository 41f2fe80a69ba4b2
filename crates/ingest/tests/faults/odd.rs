//! T16: files that are empty, of another kind or under a wrong name.

use crate::lab::{Lab, seeds};
use crate::verdict::{is_reported, rows};
use ingest::{LogError, LogKind, MapLibrary, ScanError, discover};

const KINDS: [(LogKind, &str); 9] = [
    (LogKind::Csv, "csv"),
    (LogKind::Mcap, "mcap"),
    (LogKind::Bag, "bag"),
    (LogKind::Db3, "db3"),
    (LogKind::Ulog, "ulg"),
    (LogKind::DataFlash, "bin"),
    (LogKind::Tlog, "tlog"),
    (LogKind::Ubx, "ubx"),
    (LogKind::Nmea, "nmea"),
];

#[test]
fn files_that_are_not_logs_are_rejected_or_reported_as_all_damage() {
    let mut lab = Lab::new();
    for (kind, ending) in KINDS {
        let subject = lab.single(kind, &format!("odd.{ending}"));
        for (case, bytes) in [
            ("nothing", vec![]),
            ("one byte", vec![b'x']),
            ("one zero", vec![0]),
            ("a kilobyte of zeros", vec![0; 1024]),
            ("a megabyte of zeros", vec![0; 1 << 20]),
            ("an HTML page", b"<!DOCTYPE html>\n<html><body>404: not found</body></html>\n".to_vec()),
            ("a Git-LFS pointer", b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 12\n".to_vec()),
        ] {
            // A page and a pointer may well be read as tables; discovery knows them.
            if kind == LogKind::Csv && bytes.len() > 1 && bytes[0] != 0 {
                continue;
            }
            let case = format!("{kind:?}: {case}");
            let read = lab.read(&subject, &bytes, &case);
            assert_eq!(read.as_ref().map_or(0, rows), 0, "{case}");
            assert!(read.is_err() || is_reported(&read, &ingest::Log::default()), "{case}: {read:?}");
        }
    }
}

#[test]
fn a_log_that_ends_with_its_magic_or_header_does_not_panic() {
    let mut lab = Lab::new();
    for family in
        ["mcap-cdr-none", "bag-none", "db3-bare", "ulog", "dataflash-binary", "tlog", "ubx", "nmea", "csv-wide"]
    {
        let seed = &seeds(family)[0];
        let subject = lab.seed(seed, 0);
        for length in [4, 8, 16, 100] {
            let case = format!("{family}, {length} bytes");
            if let Err(error) = lab.read(&subject, &seed.files[0].bytes[..length], &case) {
                assert!(
                    !matches!(error, LogError::Read(ScanError::Io { .. }) | LogError::Read(ScanError::Cancelled)),
                    "{case}: {error}"
                );
            }
        }
    }
}

#[test]
fn every_seed_is_detected_by_content_under_any_name() {
    let mut lab = Lab::new();
    let library = MapLibrary::shipped().unwrap();
    for family in ["mcap-cdr-none", "bag-none", "db3-bare", "ulog", "dataflash-binary", "ubx"] {
        let seed = &seeds(family)[0];
        let kind = crate::lab::kind_of(seed.container);
        let bytes = &seed.files[0].bytes;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.bag.active");
        std::fs::write(&path, bytes).unwrap();
        let found = discover(&path, &library).unwrap();
        assert_eq!(found.units.iter().map(|unit| unit.kind).collect::<Vec<_>>(), [kind], "{family}");
        for (other, ending) in KINDS.into_iter().filter(|(other, _)| *other != kind) {
            let subject = lab.single(other, &format!("wrong.{ending}"));
            let case = format!("{family} read as {other:?}");
            let read = lab.read(&subject, bytes, &case);
            assert!(read.is_err() || is_reported(&read, &ingest::Log::default()), "{case}");
        }
    }
}

#[test]
fn discovery_names_files_that_are_not_logs() {
    let library = MapLibrary::shipped().unwrap();
    for (name, bytes, what) in [
        ("page.txt", b"<!DOCTYPE html>\n<html></html>".as_slice(), "HTML page"),
        ("pointer.txt", b"version https://git-lfs.github.com/spec/v1\n", "Git LFS pointer"),
        ("empty.txt", b"", "empty file"),
        ("zeros.txt", &[0; 1024], "binary file"),
        ("packed.7z", b"7z\xbc\xaf\x27\x1c\0\0", "7-Zip archive"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join(name), bytes).unwrap();
        let found = discover(folder.path(), &library).unwrap();
        assert!(found.units.is_empty(), "{name}: {:?}", found.units);
        assert!(found.ignored[0].1.contains(what), "{name}: {:?}", found.ignored);
    }
}

#[test]
fn a_log_copied_as_text_is_reported_as_such() {
    let mut lab = Lab::new();
    let lines = |bytes: &[u8], from: &[u8], to: &[u8]| -> Vec<u8> {
        let mut out = vec![];
        let mut rest = bytes;
        while let Some(at) = rest.windows(from.len()).position(|w| w == from) {
            out.extend([&rest[..at], to].concat());
            rest = &rest[at + from.len()..];
        }
        [out.as_slice(), rest].concat()
    };
    for name in ["mcap-cdr-none", "mcap-cdr-zstd", "mcap-cdr-unchunked", "bag-none", "bag-lz4-linked"] {
        let seed = &seeds(name)[0];
        let subject = lab.seed(seed, 0);
        let bytes = &seed.files[0].bytes;
        let mut changed = vec![lines(bytes, b"\n", b"\r\n")];
        if name.starts_with("mcap") {
            changed.push(lines(bytes, b"\r\n", b"\n"));
            changed.push(String::from_utf8_lossy(bytes).into_owned().into_bytes());
        }
        for bytes in changed {
            let message = match lab.read(&subject, &bytes, name) {
                Ok(log) => log.notices.iter().map(|n| n.text.clone()).collect(),
                Err(error) => error.to_string(),
            };
            assert!(message.contains("copied in text mode"), "{name}: {message}");
        }
    }
}
