#!/usr/bin/env bash
# Time, memory and sizes of a large campaign of simulated flights: scale.sh [FLIGHTS] [SECONDS] [SHARDS] [THREADS]
#
# It is planned, run shard by shard, and reduced, as on a cluster, one task after the other; then run again with nothing changed
# and with one new flight. Needs about 0.3 MB of disk for each flight in TMPDIR. Build first: cargo build --release -p flightlag;
# cargo build --release -p flightlag-simulate --example campaign
set -euo pipefail
flights=${1:-1000} seconds=${2:-20} shards=${3:-20} threads=${4:-2}
flightlag=$(realpath "${FLIGHTLAG:-${CARGO_TARGET_DIR:-target}/release/flightlag}")
generate=$(realpath "${CARGO_TARGET_DIR:-target}/release/examples/campaign")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
logs=$work/logs out=$work/out

# measured NAME COMMAND: wall seconds, CPU seconds, largest memory in MiB. Exit 3 is a finding.
measured() {
    local name=$1 code=0
    shift
    /usr/bin/time -a -o "$work/times" -f "%e %U %S %M" "$@" >"$work/said" 2>"$work/errors" || code=$?
    if [ "$code" != 0 ] && [ "$code" != 3 ]; then cat "$work/errors" >&2; exit "$code"; fi
    grep -E '^[0-9.]+ [0-9.]+ [0-9.]+ [0-9]+$' "$work/times" | tail -n 1 |
        awk -v name="$name" '{ printf "%-34s %8.1f s %8.1f CPU s %6.0f MiB\n", name, $1, $2 + $3, $4 / 1024 }'
}

# of_tasks NAME: the tasks of a plan, summed up.
of_tasks() {
    local shard
    for ((shard = 0; shard < $2; shard++)); do
        measured task "$flightlag" campaign task --manifest "$manifest" --shard "$shard" --threads "$threads" >/dev/null
    done
    tail -n $((2 * $2)) "$work/times" | grep -E '^[0-9.]+ [0-9.]+ [0-9.]+ [0-9]+$' | tail -n "$2" | awk -v name="$1" '
        { wall += $1; cpu += $2 + $3; if ($4 > most) most = $4 }
        END { printf "%-34s %8.1f s %8.1f CPU s %6.0f MiB at most\n", name, wall, cpu, most / 1024 }'
}

plan() {
    measured "$1" "$flightlag" campaign plan "$logs" --out "$out" --max-shards "$shards" --quiet
    count=$(sed -n 's/.*\bshards=\([0-9]*\).*/\1/p' "$work/said" | head -n 1)
    manifest=$(sed -n 's/.* manifest=//p' "$work/said" | head -n 1)
}

"$generate" "$logs" "$flights" "$seconds"
echo "$flights flights of $seconds s, $(($(du -sb --apparent-size "$logs" | cut -f1) / flights / 1000)) kB each"
plan "plan"
of_tasks "$count tasks that measure" "$count"
plan "plan again"
of_tasks "$count tasks that replay" "$count"
plan "plan, nothing left"
measured "reduce, every page new" "$flightlag" campaign reduce --manifest "$manifest" --threads "$threads"
measured "reduce again" "$flightlag" campaign reduce --manifest "$manifest" --threads "$threads"
campaign() { measured "$1" "$flightlag" campaign "$logs" --out "$out" --threads "$threads" --quiet; }
campaign "campaign, nothing changed"
"$generate" "$work/more" 2 "$((seconds + 1))"
mv "$work/more/flight-0002.mcap" "$logs/one-more.mcap"
campaign "campaign, one new flight"
for name in campaign.json flights.jsonl.gz flights.parquet flights.csv index.html .flightlag/state.json; do
    printf '%-34s %10.1f kB\n' "$name" "$(($(stat -c %s "$out/$name") / 100))e-1"
done
tables=("$out"/table/*.html)
if [ -e "${tables[0]}" ]; then
    printf '%-34s %10.1f kB\n' "largest of ${#tables[@]} pages of the table" "$(($(stat -c %s "${tables[@]}" | sort -n | tail -n 1) / 100))e-1"
fi
files=$(find "$out/flights" "$out/by-key" -type f | wc -l)
bytes=$(du -sb --apparent-size "$out/flights" "$out/by-key" | awk '{ sum += $1 } END { printf "%.0f", sum }')
echo "results of a flight: $((bytes / (flights + 1) / 1000)) kB in $((files / (flights + 1))) files"
