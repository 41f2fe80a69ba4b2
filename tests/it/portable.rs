//! The command runs on Windows too: Unix-only code is confined to few files, each with an alternative for other
//! systems.

use std::fs;
use std::path::{Path, PathBuf};

/// Files that may name an operating system.
const NAMED_FOR_IT: [&str; 8] = [
    "campaign/src/disk.rs",
    "campaign/src/fetch/cache.rs",
    "campaign/src/file_stamp.rs",
    "convert/src/guard.rs",
    "flightlag/src/stop.rs",
    "history/src/dataset.rs",
    "ingest/src/platform.rs",
    "logscan/src/platform.rs",
];

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        match path.is_dir() {
            true => sources(&path, found),
            false if path.extension().is_some_and(|e| e == "rs") => found.push(path),
            false => {}
        }
    }
}

#[test]
fn only_the_listed_files_use_platform_specific_code() {
    let crates = Path::new(env!("CARGO_MANIFEST_DIR")).join("../crates");
    let mut named = vec![];
    for entry in fs::read_dir(&crates).unwrap() {
        let mut files = vec![];
        sources(&entry.unwrap().path().join("src"), &mut files);
        let is_test =
            |file: &&PathBuf| file.to_string_lossy().ends_with("tests.rs") || file.to_string_lossy().contains("_tests");
        for file in files.iter().filter(|file| !is_test(file)) {
            let text = fs::read_to_string(file).unwrap();
            if ["os::unix", "os::linux", "cfg(unix)", "signal_hook::iterator"].iter().any(|word| text.contains(word)) {
                let name = file.strip_prefix(&crates).unwrap().to_string_lossy().replace('\\', "/");
                let elsewhere = ["cfg(not(unix))", "cfg(windows)"].iter().any(|word| text.contains(word));
                assert!(elsewhere, "{name} says nothing for systems other than Unix");
                named.push(name);
            }
        }
    }
    named.sort();
    assert_eq!(named, NAMED_FOR_IT);
}
