//! A campaign on a real Slurm, if available.

use crate::program::{flightlag, text};
use std::io::Write;
use std::path::Path;
use std::process::Command;

#[test]
#[ignore = "on its own, for it waits for what nodes do in seconds: `just slurm-test`, and `.ci/run`"]
fn a_campaign_on_a_real_slurm_with_failures_gives_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let (flights, known) = (folder.path().join("flights"), folder.path().join("known.toml"));
    // Six flights for each of eight tasks, and one that replaces another.
    simulate::write_campaign(&flights, 49, 30.0, 7).unwrap();
    std::fs::write(&known, "schema = 1\n[delay]\nposition_s = 0.4\nsource = \"simulated\"\n").unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../pipelines/slurm/test.sh");
    let program = flightlag([""]).get_program().to_owned();
    let output = Command::new("bash").arg(script).arg(program).args([&flights, &known]).output().unwrap();
    let printed = text(&output.stdout);
    if printed.starts_with("skipped: ") {
        // Directly to standard error: the test runner hides standard output of tests that pass.
        let _ = write!(std::io::stderr(), "{printed}");
    }
    assert!(output.status.success(), "{printed}{}", text(&output.stderr));
    assert!(printed.starts_with("skipped: ") || printed.trim_end().ends_with(" passed, 0 failed"), "{printed}");
    print!("{printed}");
}
