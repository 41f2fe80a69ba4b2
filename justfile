# The verbs of flightlag. `just` alone lists them.

set positional-arguments

[private]
default:
    @just --list --unsorted

# Measure how late the position of each log is: just delay LOG|FOLDER ... [--json|--csv]
[no-exit-message]
delay +logs:
    @cargo run --release --quiet -p flightlag -- delay "$@"

# Replay every flight of a folder and write the pages: just campaign FLIGHTS [--pipeline P] [--out DIR] ...
[no-exit-message]
campaign flights *options:
    @cargo run --release --quiet -p flightlag -- campaign "$@"

# Run the campaigns of a night: just nightly [CONFIG] (a TOML as pipelines/nightly/nightly.toml)
[no-exit-message]
nightly config="nightly.toml" *options:
    @cargo run --release --quiet -p flightlag -- nightly "$@"

# Query a history (builds polars): just query 'delay_s > 0.3' --by firmware --agg 'median(delay_s), count()' [--to csv|parquet|json]
[no-exit-message]
query *question:
    @cargo run --release --quiet -p flightlag --features query -- query "$@"

# Test `flightlag query`, which the default build does not include
test-query:
    cargo test -p flightlag -p flightlag-history --features flightlag/query --locked

# Compare two reports: just diff RUN_A RUN_B [--out DIR]
[no-exit-message]
diff a b *options:
    @cargo run --release --quiet -p flightlag -- diff "$@"

# Make the card and pages of one sensor from its bench records: just bench RECORD... [--rig R] [--out DIR] ...
[no-exit-message]
bench +records:
    @cargo run --release --quiet -p flightlag -- bench "$@"

# Simulate flights and bench records whose truth is known, and report on them
demo folder="reports/demo":
    @cargo run --release -p flightlag -- demo "$1" --run

# The bench on simulated records of one sensor, each with its rig file next to it
bench-demo folder="reports/demo":
    @cargo run --release --quiet -p flightlag -- demo "$1" --quiet
    @cargo run --release --quiet -p flightlag -- bench "$1"/bench/gps-*.mcap "$1"/bench/gps-*.bag "$1"/bench/gps-*.csv "$1"/bench/hanging.mcap --out "$1"/bench-report/sim-0001

# Test the estimators on simulated data: the size of an uncertainty to a tenth, then benches (rms, coverage, verdicts)
monte-carlo *options:
    cargo test --release -p flightlag-signal -- --ignored
    cargo run --release -p flightlag-bench-analysis --example monte_carlo -- "$@"

# Count how often a trend shows a false change, over a year of nights and for one look (an hour)
trend-calibration:
    cargo test --release -p flightlag-history --lib -- --ignored --nocapture change_points

# Table 5.7 of the design note: every compensator on six kinds of data, computed and noted values side by side
table-5-7:
    cargo run --release -p flightlag-compensation-replay --example table_5_7

# Test the accuracy of the delay from simulated circuits, compared with integer shifts of velocity differences
delay-study *options:
    cargo run --release -p flightlag-delay-from-flight --example flight_delay_study -- "$@"

# Measure samples per second and core of every compensator, one hour at 100 Hz
perf-compensators:
    cargo run --release -p flightlag-compensation-replay --example compensator_speed

# Show what a log contains, and the quality of its timestamps
[no-exit-message]
inspect log *options:
    @cargo run --release --quiet -p flightlag -- inspect "$@"

# Run all tests
test:
    cargo test --workspace

# Compare a campaign on a real Slurm of three nodes, one of which is disconnected, with one machine (root; Debian's slurm-wlm and munge)
slurm-test:
    cargo test -p whole --test it on_a_real_slurm -- --ignored --nocapture

# Run campaigns with logs and results in a bucket of a local S3 server (moto from PyPI): just s3-test [PART-OF-A-NAME ...]
s3-test *parts:
    @tests/s3/run "$@"

# Change the source in N places, one at a time, and count what the tests detect (cargo-mutants lists the changes): just mutants CRATE|all N [SEED] [--own-tests]
mutants +sample:
    @tests/mutants/run "$@"

# Run everything that CI checks
check:
    bash .ci/run

# Accept changed generated files (JSON schemas, the pages of notices and commands, golden texts) after reading the diff
bless:
    rm -rf crates/*/tests/golden tests/golden
    FLIGHTLAG_BLESS=1 cargo test -p whole -- the_published_schemas the_page_of_commands golden::
    FLIGHTLAG_BLESS=1 cargo test -p flightlag-flight --test catalogue the_page_of_notices
    FLIGHTLAG_BLESS=1 cargo test -p flightlag-report as_accepted
    FLIGHTLAG_BLESS=1 cargo test -p flightlag-bench-analysis -p flightlag-compensation-replay -p flightlag-delay-over-time
    FLIGHTLAG_BLESS=1 cargo test -p flightlag-ingest --test it
    git diff --stat

# Print a page of a report as an A4 PDF with Chromium: just pdf PAGE.html|FOLDER [OUT.pdf]
[no-exit-message]
pdf report out="":
    #!/usr/bin/env bash
    set -euo pipefail
    page="$1"; out="${2:-}"
    if [ -d "$page" ]; then page="$page/index.html"; fi
    if [ ! -f "$page" ]; then echo "just pdf: no page at $page" >&2; exit 1; fi
    browser=$(command -v chromium || command -v chromium-browser || command -v google-chrome || true)
    if [ -z "$browser" ]; then
        echo "just pdf needs Chromium. Install it (Debian, Ubuntu: apt-get install chromium), or print $page from any browser." >&2
        exit 1
    fi
    out="${out:-${page%.html}.pdf}"
    profile=$(mktemp -d); trap 'rm -rf "$profile"' EXIT
    "$browser" --headless --no-sandbox --disable-gpu --disable-background-networking --user-data-dir="$profile" \
        --no-pdf-header-footer --print-to-pdf="$out" "file://$(realpath "$page")" 2>"$profile/log" \
        || { cat "$profile/log" >&2; exit 1; }
    echo "$out"

# Renew the page in reports/specimen from a fresh demo. Links to files that are not in the same folder become text
specimen: (demo "reports/demo")
    cp reports/demo/report/flights/2026-05-04-flight-01.mcap/figures.zip reports/specimen/
    sed -E 's#<a [^>]*href="(\.\./[^"]*|(record|details)\.json\.gz)"[^>]*>(([^<]|<bdi>|</bdi>|<wbr>)*)</a>#\3 #g' reports/demo/report/flights/2026-05-04-flight-01.mcap/index.html > reports/specimen/index.html
    unzip -qop reports/specimen/figures.zip fig-7.svg > reports/specimen/fig-7.svg

# Measure CPU time of reading the data for a delay in every format, compared with the minimum and with Python readers
perf *folder:
    cargo build --release -p flightlag-ingest -p flightlag-simulate --examples
    python3 tests/perf/formats.py "$@"

# Compare CPU time of reading three topics of an MCAP with that of decompressing it: just perf-mcap FILE TOPIC=FIELD,FIELD ...
perf-mcap file *topics:
    cargo build --release -p flightlag-ingest --examples
    tests/perf/mcap.sh "$@"

# Time a campaign of 200 simulated flights: one and two threads, and an unchanged rerun
perf-campaign flights="200":
    cargo build --release -p flightlag
    cargo build --release -p flightlag-simulate --example campaign
    tests/perf/campaign.sh "$1"

# Measure time, memory and sizes of a large simulated campaign: planned, run shard by shard, reduced
perf-scale flights="1000" seconds="20" shards="20":
    cargo build --release -p flightlag
    cargo build --release -p flightlag-simulate --example campaign
    tests/perf/scale.sh "$@"

# Recover everything readable from a damaged log, as MCAP
[no-exit-message]
recover log out *options:
    @cargo run --release --quiet -p flightlag -- recover "$@"

# Export the channels of a log as tables: just export LOG --to parquet|csv|mcap [--topics] [--out PATH]
[no-exit-message]
export log *options:
    @cargo run --release --quiet -p flightlag -- export "$@"

# Fuzz a parser: mcap bag db3 bag-folder ulog dataflash csv tlog ubx nmea flight definition channel-map rig card pipeline criteria
fuzz target seconds="60" *options:
    fuzz/run "$@"

# Try every truncation, bit flip and hostile number of the seeds of every format (an hour); prints a table
faults *filter:
    cargo test --release -p flightlag-ingest --test faults -- --ignored --nocapture --test-threads 2 "$@"

# Simulate a disk that is full, fails or loses power at every step of a campaign, and system limits (minutes)
faults-outputs:
    cargo test -p flightlag-campaign --lib -- --ignored faults
    cargo test -p whole --test it limits_of_the_system -- --ignored

# Fail every read of a log of each kind, start two runs of six kinds on one report at fifty delays, vary twenty environments (an hour; strace)
faults-runs:
    cargo test --release -p whole --test it faults -- --ignored --nocapture --test-threads 1

# Check peak memory for tables of 256 MiB, a line of a GiB, 65,000 topics: 256 MiB plus the columns (minutes)
memory:
    cargo test --release -p whole --test it memory -- --include-ignored --nocapture --test-threads 1

# Compare every value of every log with the Python packages pyulog, pymavlink, rosbags, mcap, pyubx2 and pynmeagps: just peers [LOGS] [PART-OF-A-PATH ...]
peers logs="../shared/logs" *parts:
    cargo build --release --quiet -p flightlag-ingest --example dump_topics
    python3 tests/peers/compare.py "${CARGO_TARGET_DIR:-target}"/release/examples/dump_topics "$@"
