//! Folders that several tests read: the first test that asks for one makes it, once for each build.

use crate::program::{program, run};
use std::fs::{self, File};
use std::path::{Path, PathBuf};

/// The folder of this name, made by `make` if this build has not yet made it. No test may change what is in it.
pub fn folder(name: &str, make: impl FnOnce(&Path)) -> PathBuf {
    let root = Path::new(env!("CARGO_TARGET_TMPDIR")).join("shared");
    fs::create_dir_all(&root).unwrap();
    // Locked until the end of this function: other tests, in this process or another, wait for the folder.
    let lock = File::create(root.join(format!("{name}.lock"))).unwrap();
    lock.lock().unwrap();
    let (folder, made_by) = (root.join(name), root.join(format!("{name}.made-by")));
    let build = build();
    if fs::read_to_string(&made_by).ok() != Some(build.clone()) {
        if folder.exists() {
            fs::remove_dir_all(&folder).unwrap();
        }
        fs::create_dir(&folder).unwrap();
        make(&folder);
        fs::write(made_by, build).unwrap();
    }
    folder
}

/// The build of the tests and of the program: path, size and time of both files.
fn build() -> String {
    let test = std::env::current_exe().unwrap();
    let of = |path: &Path| {
        let file = fs::metadata(path).unwrap();
        format!("{} {} {:?}", path.display(), file.len(), file.modified().unwrap())
    };
    format!("{}\n{}\n", of(&test), of(program()))
}

/// What `flightlag demo --run` writes, with what it prints in `printed.txt`.
pub fn demo() -> PathBuf {
    folder("demo", |folder| {
        let demo = folder.join("demo");
        let printed = run(["demo".as_ref(), demo.as_os_str(), "--run".as_ref()], 0).stdout;
        fs::write(folder.join("printed.txt"), printed).unwrap();
    })
}
