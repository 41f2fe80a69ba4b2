#!/usr/bin/env bash
# CPU seconds of reading topics of an MCAP against decompressing it with CRCs checked, in turn,
# nine times after one warm-up; the ratio pair by pair. Build first: cargo build --release -p flightlag-ingest --examples
set -euo pipefail
file=${1:?usage: mcap.sh FILE TOPIC[=FIELD,FIELD]...}
shift
bin=${CARGO_TARGET_DIR:-target}/release/examples
TIMEFORMAT='%U %S'
cpu() { { time "$@" >/dev/null; } 2>&1 | awk '{print $1 + $2}'; }

cpu "$bin/decompress_only" "$file" >/dev/null
cpu "$bin/read_topics" "$file" "$@" >/dev/null
for round in 1 2 3 4 5 6 7 8 9; do
    echo "$(cpu "$bin/decompress_only" "$file") $(cpu "$bin/read_topics" "$file" "$@")"
done | awk '
    { limit[NR] = $1; ours[NR] = $2; ratio[NR] = $2 / $1 }
    function median(x, n,   i, j, t) { for (i = 2; i <= n; i++) for (j = i; j > 1 && x[j] < x[j-1]; j--) { t = x[j]; x[j] = x[j-1]; x[j-1] = t } return x[int((n + 1) / 2)] }
    END {
        r = median(ratio, NR)
        printf "decompress only  %.3f CPU s\nread topics      %.3f CPU s\nratio            %.2f [%.2f to %.2f]\n", median(limit, NR), median(ours, NR), r, ratio[1], ratio[NR]
    }'
