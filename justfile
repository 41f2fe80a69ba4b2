# The verbs of flightlag. `just` alone lists them.

set positional-arguments

[private]
default:
    @just --list --unsorted

# How late the position of each log is: just delay LOG|FOLDER ... [--json|--csv]
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

# Ask a history (builds polars): just query 'delay_s > 0.3' --by firmware --agg 'median(delay_s), count()' [--to csv|parquet|json]
[no-exit-message]
query *question:
    @cargo run --release --quiet -p flightlag --features query -- query "$@"

# The tests of `flightlag query`, which the usual build lacks
test-query:
    cargo test -p flightlag --features query query

# Compare two reports: just diff RUN_A RUN_B [--out DIR]
[no-exit-message]
diff a b *options:
    @cargo run --release --quiet -p flightlag -- diff "$@"

# From bench records of one sensor to its card and pages: just bench RECORD... [--rig R] [--out DIR] ...
[no-exit-message]
bench +records:
    @cargo run --release --quiet -p flightlag -- bench "$@"

# Simulate flights and bench records whose truth is known, and report on them
demo folder="reports/demo":
    @cargo run --release -p flightlag -- demo "$1" --run

# The bench on simulated records of one sensor, each with its rig file beside it
bench-demo folder="reports/demo":
    @cargo run --release --quiet -p flightlag -- demo "$1" --quiet
    @cargo run --release --quiet -p flightlag -- bench "$1"/bench/gps-*.mcap "$1"/bench/gps-*.bag "$1"/bench/gps-*.csv "$1"/bench/hanging.mcap --out "$1"/bench-report/sim-0001

# How well the estimators do on simulated data: the size of an uncertainty to a tenth, then benches (rms, coverage, verdicts)
monte-carlo *options:
    cargo test --release -p flightlag-signal -- --ignored
    cargo run --release -p flightlag-bench-analysis --example monte_carlo -- "$@"

# How often a trend shows a change that is not there, over a year of nights and for one look (an hour)
trend-calibration:
    cargo test --release -p flightlag-history --lib -- --ignored --nocapture change_points

# Table 5.7 of the design note: every compensator on six kinds of data, found beside noted
table-5-7:
    cargo run --release -p flightlag-compensation-replay --example table_5_7

# How good the delay from a flight is over simulated circuits, and beside integer shifts of velocity differences
delay-study *options:
    cargo run --release -p flightlag-compensation-replay --example flight_delay_study -- "$@"

# Samples per second and core of every compensator, one hour at 100 Hz
perf-compensators:
    cargo run --release -p flightlag-compensation-replay --example compensator_speed

# What a log holds, and how good its time stamps are
[no-exit-message]
inspect log *options:
    @cargo run --release --quiet -p flightlag -- inspect "$@"

# All tests
test:
    cargo test --workspace

# A campaign on a real Slurm of three nodes, one of which is cut, against one machine (root; Debian's slurm-wlm and munge)
slurm-test:
    cargo test -p whole --test it on_a_real_slurm -- --ignored --nocapture

# Campaigns whose logs and results lie in a bucket, of an S3 server on loopback (moto of PyPI): just s3-test [PART-OF-A-NAME ...]
s3-test *parts:
    @tests/s3/run "$@"

# Change the source in N places, one at a time, and count what the tests of a crate notice (cargo-mutants): just mutants CRATE N [SEED]
mutants +sample:
    @tests/mutants/run "$@"

# What CI checks
check:
    bash .ci/run

# Accept changed generated files (JSON schemas, the pages of notices and commands) after reading the diff
bless:
    FLIGHTLAG_BLESS=1 cargo test -p whole the_published_schemas
    FLIGHTLAG_BLESS=1 cargo test -p whole the_page_of_commands
    FLIGHTLAG_BLESS=1 cargo test -p flightlag-flight --test catalogue the_page_of_notices
    git diff --stat

# Print a page of a report as PDF, A4, by Chromium: just pdf PAGE.html|FOLDER [OUT.pdf]
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

# Renew the page in reports/specimen from a fresh demo. Links to files that are not beside it become text
specimen: (demo "reports/demo")
    cp reports/demo/report/flights/2026-05-04-flight-01.mcap/figures.zip reports/specimen/
    sed -E 's#<a [^>]*href="(\.\./[^"]*|(record|details)\.json\.gz)"[^>]*>(([^<]|<bdi>|</bdi>|<wbr>)*)</a>#\3 #g' reports/demo/report/flights/2026-05-04-flight-01.mcap/index.html > reports/specimen/index.html
    unzip -qop reports/specimen/figures.zip fig-7.svg > reports/specimen/fig-7.svg

# Reading what a delay needs of one flight in every format: CPU against the least it can cost, and against Python readers
perf *folder:
    cargo build --release -p flightlag-ingest -p flightlag-simulate --examples
    python3 tests/perf/formats.py "$@"

# CPU of reading three topics of an MCAP against decompressing it: just perf-mcap FILE TOPIC=FIELD,FIELD ...
perf-mcap file *topics:
    cargo build --release -p flightlag-ingest --examples
    tests/perf/mcap.sh "$@"

# Campaign of 200 simulated flights: one and two threads, and a rerun with nothing changed
perf-campaign flights="200":
    cargo build --release -p flightlag
    cargo build --release -p flightlag-simulate --example campaign
    tests/perf/campaign.sh "$1"

# Time, memory and sizes of a campaign of many simulated flights, planned, run shard by shard and reduced
perf-scale flights="1000" seconds="20" shards="20":
    cargo build --release -p flightlag
    cargo build --release -p flightlag-simulate --example campaign
    tests/perf/scale.sh "$@"

# What is good of a damaged log, as MCAP
[no-exit-message]
recover log out *options:
    @cargo run --release --quiet -p flightlag -- recover "$@"

# The channels of a log as tables: just export LOG --to parquet|csv|mcap [--topics] [--out PATH]
[no-exit-message]
export log *options:
    @cargo run --release --quiet -p flightlag -- export "$@"

# Fuzzes a parser: mcap bag db3 bag-folder ulog dataflash csv tlog ubx nmea flight definition channel-map rig card pipeline criteria
fuzz target seconds="60" *options:
    fuzz/run "$@"

# Every truncation, every bit flip, every hostile number of the seeds of every format (an hour); prints a table
faults *filter:
    cargo test --release -p flightlag-ingest --test faults -- --ignored --nocapture --test-threads 2 "$@"

# A disk that is full, fails or loses power at every step of a campaign, and limits of the system (minutes)
faults-outputs:
    cargo test -p flightlag-campaign --lib -- --ignored faults
    cargo test -p whole --test it limits_of_the_system -- --ignored

# A disk that fails at every read of a log of each kind, two runs of six kinds on one report at fifty moments, twenty surroundings (an hour; strace)
faults-runs:
    cargo test --release -p whole --test it faults -- --ignored --nocapture --test-threads 1

# Peak memory for tables of 256 MiB, a line of a GiB, 65,000 topics: 256 MiB above the columns (minutes)
memory:
    cargo test --release -p whole --test it memory -- --include-ignored --nocapture --test-threads 1

# Every value of every log beside pyulog, pymavlink, rosbags, mcap, pyubx2 and pynmeagps of Python: just peers [LOGS] [PART-OF-A-PATH ...]
peers logs="../shared/logs" *parts:
    cargo build --release --quiet -p flightlag-ingest --example dump_topics
    python3 tests/peers/compare.py "${CARGO_TARGET_DIR:-target}"/release/examples/dump_topics "$@"
