//! Rules for the source files: names are unique within a crate, and ARCHITECTURE.md names files that exist.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_owned()
}

/// Source files of each crate, relative to `crates`, with `/`.
fn sources() -> BTreeMap<String, Vec<String>> {
    let crates = root().join("crates");
    let mut open: Vec<PathBuf> =
        fs::read_dir(&crates).unwrap().map(|entry| entry.unwrap().path().join("src")).collect();
    let mut found: BTreeMap<String, Vec<String>> = BTreeMap::new();
    while let Some(folder) = open.pop() {
        for path in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
            if path.is_dir() {
                open.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                let name = path.strip_prefix(&crates).unwrap().to_string_lossy().replace('\\', "/");
                found.entry(name.split('/').next().unwrap().to_owned()).or_default().push(name);
            }
        }
    }
    assert!(found.len() > 10);
    found
}

#[test]
fn no_two_files_of_a_crate_share_a_name() {
    for (name, files) in sources() {
        let mut known: BTreeMap<&str, &str> = BTreeMap::new();
        for file in files.iter().filter(|file| !file.ends_with("/tests.rs")) {
            let twin = known.insert(file.rsplit('/').next().unwrap(), file);
            assert_eq!(twin, None, "{name}: {file} has the name of another file");
        }
    }
}

#[test]
fn architecture_names_files_that_exist() {
    let page = fs::read_to_string(root().join("ARCHITECTURE.md")).unwrap();
    let files: Vec<String> = sources().into_values().flatten().collect();
    let mut named = 0;
    for name in page.split('`').filter(|text| text.ends_with(".rs") && !text.contains(' ')) {
        let of_source = files.iter().any(|file| *file == name || file.ends_with(&format!("/{name}")));
        // Tests are named below their crate.
        let of_tests = root().join("crates").join(name).is_file() || root().join("crates/ingest").join(name).is_file();
        assert!(of_source || of_tests, "ARCHITECTURE.md names {name}, which does not exist");
        named += 1;
    }
    assert!(named > 10, "{named} names");
}
