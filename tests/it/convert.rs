//! What `export` and `recover` refuse, and what they leave in that case.

use crate::program::{run, text, tree};
use std::fs;
use std::path::Path;

fn export(log: &Path, kind: &str, out: &Path, exit: i32) -> String {
    let arguments = ["export".as_ref(), log.as_os_str(), "--topics".as_ref(), "--to".as_ref(), kind.as_ref()];
    let rest = ["--out".as_ref(), out.as_os_str(), "--force".as_ref()];
    text(&run(arguments.into_iter().chain(rest), exit).stderr)
}

fn recover(log: &Path, out: &Path, exit: i32) -> String {
    text(&run(["recover".as_ref(), log.as_os_str(), out.as_os_str(), "--force".as_ref()], exit).stderr)
}

#[test]
fn the_log_itself_is_refused_as_an_output_even_with_force() {
    let folder = tempfile::tempdir().unwrap();
    simulate::write_campaign(folder.path(), 1, 10.0, 1).unwrap();
    let log = folder.path().join("flight-0001.mcap");
    let hard = folder.path().join("other-name.mcap");
    fs::hard_link(&log, &hard).unwrap();
    let table = folder.path().join("in/rpm.csv");
    fs::create_dir(folder.path().join("in")).unwrap();
    fs::write(&table, "time_s,rpm\n".to_owned() + &(0..30).map(|i| format!("{i}.5,{i}\n")).collect::<String>())
        .unwrap();
    let before = tree(folder.path());
    for out in [&log, &hard] {
        assert!(export(&log, "mcap", out, 2).contains("the log itself"));
        assert!(recover(&log, out, 2).contains("the log itself"));
    }
    assert!(export(&table, "csv", table.parent().unwrap(), 2).contains("the log itself"));
    assert!(tree(folder.path()) == before);
}

#[cfg(unix)]
#[test]
fn special_files_are_refused_as_an_output_and_left_alone() {
    use std::os::unix::fs::FileTypeExt;
    let folder = tempfile::tempdir().unwrap();
    simulate::write_campaign(folder.path(), 1, 10.0, 1).unwrap();
    let (log, socket) = (folder.path().join("flight-0001.mcap"), folder.path().join("socket"));
    let _listener = std::os::unix::net::UnixListener::bind(&socket).unwrap();
    for printed in [export(&log, "mcap", &socket, 2), export(&log, "csv", &socket, 2), recover(&log, &socket, 2)] {
        assert!(printed.contains("a device, a pipe or a socket"), "{printed}");
    }
    assert!(fs::symlink_metadata(&socket).unwrap().file_type().is_socket());
}

/// The output of `inspect` for a log, without its container: its size, the size of its messages, its other contents.
fn inspected(log: &Path) -> serde_json::Value {
    let printed = run(["inspect".as_ref(), log.as_os_str(), "--json".as_ref()], 0);
    let mut printed: serde_json::Value = serde_json::from_slice(&printed.stdout).unwrap();
    for containers in ["bytes", "extras", "format"] {
        printed["health"].as_object_mut().unwrap().remove(containers);
    }
    printed["flight"] = serde_json::Value::Null;
    for topic in printed["health"]["topics"].as_array_mut().unwrap() {
        topic.as_object_mut().unwrap().remove("payload_bytes");
    }
    printed
}

#[test]
fn inspect_gives_the_same_for_a_recovered_real_log() {
    let logs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/logs");
    let folder = tempfile::tempdir().unwrap();
    for log in ["pyulog/test/sample_log_small.ulg", "DeLorean/data/00000135.BIN"] {
        let (log, out) = (logs.join(log), folder.path().join("out.mcap"));
        if !log.is_file() {
            println!("skipped: {} is not there", log.display());
            continue;
        }
        recover(&log, &out, 0);
        assert!(inspected(&log) == inspected(&out), "{}", log.display());
    }
}
