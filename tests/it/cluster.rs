//! A campaign on a real Slurm, where there is one.

use crate::program::{flightlag, text};
use std::io::Write;
use std::path::Path;
use std::process::Command;

#[test]
#[ignore = "on its own, for it waits for what nodes do in seconds: `just slurm-test`, and `.ci/run`"]
fn a_campaign_on_a_real_slurm_that_breaks_gives_the_bytes_of_one_machine() {
    let folder = tempfile::tempdir().unwrap();
    let (flights, known) = (folder.path().join("flights"), folder.path().join("known.toml"));
    // Six flights for each of eight tasks, and one that takes the place of another.
    simulate::write_campaign(&flights, 49, 30.0, 7).unwrap();
    std::fs::write(&known, "schema = 1\n[delay]\nposition_s = 0.4\nsource = \"simulated\"\n").unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../pipelines/slurm/test.sh");
    let program = flightlag([""]).get_program().to_owned();
    let output = Command::new("bash").arg(script).arg(program).args([&flights, &known]).output().unwrap();
    let said = text(&output.stdout);
    if said.starts_with("skipped: ") {
        // Straight to standard error: what is printed, the test runner keeps to itself when a test passes.
        let _ = write!(std::io::stderr(), "{said}");
    }
    assert!(output.status.success(), "{said}{}", text(&output.stderr));
    assert!(said.starts_with("skipped: ") || said.trim_end().ends_with(" passed, 0 failed"), "{said}");
    print!("{said}");
}
