#!/usr/bin/env bash
# Wall seconds of a campaign of simulated one-minute flights: one thread and two in turn, then reruns with nothing
# changed. Build first: cargo build --release -p flightlag; cargo build --release -p flightlag-simulate --example campaign
set -euo pipefail
flights=${1:-200}
flightlag=$(realpath "${CARGO_TARGET_DIR:-target}/release/flightlag")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
TIMEFORMAT=%R
wall() { { time "$@" >/dev/null 2>&1; } 2>&1; }

"$(dirname "$flightlag")/examples/campaign" "$work/flights" "$flights" 60
run() { "$flightlag" campaign "$work/flights" --out "$work/$2" --threads "$1" || [ $? = 3 ]; }
# A new folder each time: ext4 is slow to hand out inodes that were freed a moment ago.
fresh() { sync; wall run "$1" "$2"; }
fresh 2 warm-up >/dev/null
for round in 1 2 3 4 5; do
    one=$(fresh 1 "one$round"); two=$(fresh 2 "two$round"); again=$(wall run 2 "two$round")
    echo "$one s with one thread, $two s with two ($(awk "BEGIN { printf \"%.2f\", $one / $two }") times as fast), $again s with nothing changed"
done
