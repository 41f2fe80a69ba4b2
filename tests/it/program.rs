//! The command itself, as run by a user.

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

/// The program, built from the code of this workspace.
pub fn program() -> &'static Path {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    PROGRAM.get_or_init(|| {
        // target/PROFILE/deps/it-1234
        let test = std::env::current_exe().unwrap();
        let profile = test.parent().and_then(Path::parent).unwrap();
        let release = profile.file_name() == Some(OsStr::new("release"));
        let mut build = Command::new(std::env::var_os("CARGO").unwrap_or("cargo".into()));
        // A test target makes cargo choose the features of `cargo test --workspace`, for which all else is compiled already.
        build.args(["build", "--quiet", "--workspace", "--bin", "flightlag", "--test", "catalogue"]);
        build.arg("--target-dir").arg(profile.parent().unwrap());
        build.args(release.then_some("--release")).current_dir(env!("CARGO_MANIFEST_DIR"));
        assert!(build.status().unwrap().success(), "flightlag does not build");
        profile.join("flightlag")
    })
}

/// `flightlag` in a neutral environment.
pub fn flightlag<A: AsRef<OsStr>>(arguments: impl IntoIterator<Item = A>) -> Command {
    let mut command = Command::new(program());
    command.args(arguments).env_remove("SLURM_CPUS_PER_TASK");
    command
}

/// Runs `flightlag`, and expects this exit code.
pub fn run<A: AsRef<OsStr>>(arguments: impl IntoIterator<Item = A>, exit: i32) -> Output {
    let output = flightlag(arguments).output().unwrap();
    let (out, err) = (text(&output.stdout), text(&output.stderr));
    assert_eq!(output.status.code(), Some(exit), "standard output:\n{out}\nstandard error:\n{err}");
    output
}

pub fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Every file below a folder.
pub fn tree(root: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut tree = BTreeMap::new();
    let mut open = vec![root.to_owned()];
    while let Some(folder) = open.pop() {
        for entry in fs::read_dir(folder).unwrap().map(Result::unwrap) {
            if entry.file_type().unwrap().is_dir() {
                open.push(entry.path());
            } else {
                let name = entry.path().strip_prefix(root).unwrap().to_owned();
                tree.insert(name, fs::read(entry.path()).unwrap());
            }
        }
    }
    tree
}

/// The results that depend only on logs, settings and build: not on the hour, nor on this machine's caches.
pub fn results(report: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut tree = tree(report);
    let of_earlier_runs = ["run.json", "since-last-run.json", "since-last-run.html"].map(Path::new);
    tree.retain(|path, _| !of_earlier_runs.contains(&path.as_path()) && !path.starts_with(".flightlag"));
    tree
}

/// A log with many topics of two messages each.
pub fn log_of_topics(path: &Path, topics: u64) {
    let mut writer = mcap::Writer::new(BufWriter::new(File::create(path).unwrap())).unwrap();
    let schema =
        writer.add_schema("geometry_msgs/msg/Vector3", "ros2msg", b"float64 x\nfloat64 y\nfloat64 z\n").unwrap();
    let channels: Vec<u16> = (0..topics)
        .map(|n| writer.add_channel(schema, &format!("/topic/{n:05}"), "cdr", &Default::default()).unwrap())
        .collect();
    let payload = [&[0, 1, 0, 0][..], &[0; 24]].concat();
    for (step, channel_id) in (0..2).flat_map(|_| channels.iter()).enumerate() {
        let log_time = 1_700_000_000_000_000_000 + 1000 * step as u64;
        let header =
            mcap::records::MessageHeader { channel_id: *channel_id, sequence: 0, log_time, publish_time: log_time };
        writer.write_to_known_channel(&header, &payload).unwrap();
    }
    writer.finish().unwrap();
}

/// Reports which file differs instead of printing them all.
pub fn assert_same(one: &BTreeMap<PathBuf, Vec<u8>>, other: &BTreeMap<PathBuf, Vec<u8>>) {
    let names = |t: &BTreeMap<PathBuf, Vec<u8>>| t.keys().cloned().collect::<Vec<_>>();
    assert_eq!(names(one), names(other));
    for (path, bytes) in one {
        assert!(other.get(path) == Some(bytes), "{} differs", path.display());
    }
}
