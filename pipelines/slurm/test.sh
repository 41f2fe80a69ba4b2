#!/bin/bash
# Runs campaign.sh on a real Slurm of three nodes, breaks what can break, and compares the report with that of one machine.
#
#   test.sh FLIGHTLAG FLIGHTS [PIPELINE]
#
# FLIGHTLAG is the program, FLIGHTS a folder with some dozens of short logs. The hosts are namespaces of this machine, and so are
# /run and all processes: nothing is left behind. Needs root and Debian's slurm-wlm, slurm-client and munge; without them, or
# where namespaces are not allowed, it says that it was skipped, and ends with 0. Else it closes with "N passed, N failed".
set -uo pipefail
HERE=$(cd "$(dirname "$0")" && pwd)

skip() { echo "skipped: $*"; exit 0; }

if [ "${1:-}" != --inside ]; then
    [ $# -ge 2 ] || { echo "usage: test.sh FLIGHTLAG FLIGHTS [PIPELINE]" >&2; exit 2; }
    [ "$(id -u)" = 0 ] || skip "only root may make hosts of namespaces"
    for command in slurmctld slurmd sbatch munged ip nsenter unshare setpriv; do
        command -v "$command" > /dev/null || skip "$command is not installed (apt-get install slurm-wlm slurm-client munge)"
    done
    getent passwd munge nobody > /dev/null && [ -d /etc/slurm ] || skip "there is no user munge or nobody, or no /etc/slurm"
    inside=(unshare --mount --propagation private --uts --pid --fork --kill-child --mount-proc --)
    "${inside[@]}" true 2> /dev/null || skip "namespaces are not allowed here"
    "${inside[@]}" bash -c 'mount -t tmpfs none /run && ip netns add a && ip netns add b &&
        ip -n a link add br0 type bridge && ip -n a link add to-b type veth peer name eth0 netns b' 2> /dev/null ||
        skip "network namespaces, bridges or mounts are not allowed here"
    exec "${inside[@]}" bash "$HERE/test.sh" --inside "$(realpath "$1")" "$(realpath "$2")" "${3:+$(realpath "$3")}"
fi

trap 'exit 130' INT TERM
# shellcheck source=testcluster/cluster.sh
. "$HERE/testcluster/cluster.sh"
passed=0 failed=0 begun=$SECONDS
check() {
    if [ "$2" = "$3" ]; then passed=$((passed + 1)) && echo "ok    $1"; else
        failed=$((failed + 1))
        echo "FAIL  $1: expected '$3', found '$2'"
    fi
}
# patiently SECONDS COMMAND...: until it succeeds, on a busy machine up to three times as long.
patiently() {
    local until=$((SECONDS + 3 * $1))
    shift
    until "$@"; do
        [ "$SECONDS" -lt "$until" ] || return 1
        sleep 0.2
    done
}
# must WHAT SECONDS COMMAND...: the test cannot go on without it.
must() {
    if patiently "${@:2}"; then check "$1" yes yes && return; fi
    echo "FAIL  $1: not within $2 s"
    on ctl squeue -o '%i %j %T %r %N %k'
    on ctl sinfo -N -l
    tail -n 5 "$WORK"/cluster/log/* "$LOGS"/* 2> /dev/null
    echo "$passed passed, $((failed + 1)) failed"
    exit 1
}
stage() { echo "      $* ($((SECONDS - begun)) s)"; }

# --- The cluster, and the folders that its hosts share -------------------------------------------------------------------

mount -t tmpfs -o mode=755 none /run && mkdir -p /run/munge /run/test || exit 1
WORK=/run/test SHARED=/run/test/shared
FLIGHTS=$SHARED/flights OUT=$SHARED/report LOGS=$SHARED/report.slurm
mkdir -p "$SHARED" && cp -r "$3" "$FLIGHTS" && install -m 755 "$2" "$SHARED/flightlag" || exit 1
cp "$HERE"/{campaign.sh,common.sh,step.sbatch,task.sbatch} "$SHARED"
options=()
if [ -n "$4" ]; then cp "$4" "$SHARED/pipeline.toml" && options=(--pipeline "$SHARED/pipeline.toml"); fi
cat > "$SHARED/site.env" <<END
FLIGHTLAG=$SHARED/flightlag
TASK_OPTIONS="--time=20 --mem=100M \${ON_NODE:-}"
STEP_OPTIONS="--time=20 --mem=100M \${ON_NODE:-}"
MAX_SHARDS=8
END
# One log is kept back. It takes the place of another when the plan is made.
spare=$(find "$FLIGHTS" -type f -name '*.mcap' | sort | tail -n 1)
mv "$spare" "$WORK/spare.mcap"
flights=$(find "$FLIGHTS" -type f -name '*.mcap' | wc -l)
chown -R nobody "$SHARED"

# As a user of the cluster, on a host.
as_user() { on "$1" setpriv --reuid=nobody --regid=nogroup --clear-groups env HOME=/nonexistent "${@:2}"; }
submit() { as_user ctl "$@" "$SHARED/campaign.sh" "$FLIGHTS" "$OUT" "${options[@]}"; }
queue_is_empty() { local jobs; jobs=$(on ctl squeue -h -o %i) && [ -z "$jobs" ]; }
has() { grep -qs -- "$@"; }

# n3 has its own copy of the logs: the same content and times, other files.
cp -rp "$FLIGHTS" "$WORK/copy-of-n3"
mkdir -p "$WORK/cluster/hook"
echo "mount --bind '$WORK/copy-of-n3' '$FLIGHTS'" > "$WORK/cluster/hook/n3"
cluster_start "$WORK/cluster" n1 n2 n3 || skip "the network of the test cluster cannot be made"
three_idle() { [ "$(idle_nodes)" = 3 ]; }
must "a $(slurmctld -V) of three nodes is up" 60 three_idle

# --- Processes of flightlag: they are stopped in the middle of their work -------------------------------------------------

# of_job PID NAME: what the job of a process has in its environment under this name.
of_job() { cat "/proc/$1/environ" 2> /dev/null | tr '\0' '\n' | sed -n "s/^$2=//p"; }
# workers STEP: processes of `flightlag campaign STEP`.
workers() {
    local pid
    for pid in $(pgrep -x flightlag); do
        cat "/proc/$pid/cmdline" 2> /dev/null | tr '\0' ' ' | grep -q " campaign $1 " && echo "$pid"
    done
}
# hold PID COMMAND...: lets a process work in slices until the command succeeds, and then holds it. Fails if it ends before.
hold() {
    local pid=$1
    shift
    while kill -STOP "$pid" 2> /dev/null; do
        "$@" && return
        kill -CONT "$pid" && sleep 0.1
    done
    return 1
}
log_of_task() { echo "$LOGS/$(of_job "$1" SLURM_ARRAY_JOB_ID)_$(of_job "$1" SLURM_ARRAY_TASK_ID).log"; }
has_finished_a_flight() { has '^\[[0-9]*/[0-9]*\]' "$1"; }
declare -A held=()
# Holds one task on each node, after its first flight.
hold_tasks() {
    local pid node
    for pid in $(workers task); do
        node=$(of_job "$pid" SLURMD_NODENAME)
        if [ -n "$node" ] && [ "${held[$node]:-}" != "$pid" ]; then
            hold "$pid" has_finished_a_flight "$(log_of_task "$pid")" && held[$node]=$pid
        fi
    done
    [ "${#held[@]}" = 3 ]
}
# TERM reaches a process that is held, and waits for it.
term_waits_for() { grep -qsE '^ShdPnd:\s+[0-9a-f]{12}[4-7c-f]' "/proc/$1/status"; }
# ends_by_term JOB PID: the time limit comes near, so Slurm sends TERM.
ends_by_term() {
    on ctl scontrol update "jobid=$1" TimeLimit=1
    must "before the time limit the script passes TERM on" 120 term_waits_for "$2"
    on ctl scontrol update "jobid=$1" TimeLimit=20
    kill -CONT "$2"
}

# --- A campaign through faults --------------------------------------------------------------------------------------------

submit > "$WORK/submitted" || { cat "$WORK/submitted"; exit 1; }
must "tasks of three nodes are held in the middle" 180 hold_tasks
array=$(of_job "${held[n1]}" SLURM_ARRAY_JOB_ID)
task_n1=${array}_$(of_job "${held[n1]}" SLURM_ARRAY_TASK_ID)
task_n2=${array}_$(of_job "${held[n2]}" SLURM_ARRAY_TASK_ID)
task_n3=${array}_$(of_job "${held[n3]}" SLURM_ARRAY_TASK_ID)

manifest=$(find "$OUT/.flightlag/plans" -name '*.json')
sha256sum $manifest > "$WORK/manifests"
other=$(as_user ctl "$SHARED/flightlag" campaign plan "$FLIGHTS" --out "$OUT" --max-shards 2 --quiet "${options[@]}")
check "a second plan has a manifest of its own" "$([ -f "${other##*manifest=}" ] && [ "${other##*manifest=}" != "$manifest" ] && echo yes)" yes

# The first flight of the last shard, which no task has begun.
changed=$(sed 's/{"flight":"/\n&/g' "$manifest" | grep '"shard":7[,}]' | sed 's/^{"flight":"\([^"]*\)".*/\1/' | head -n 1)
cp "$WORK/spare.mcap" "$FLIGHTS/$changed" && cp -p "$FLIGHTS/$changed" "$WORK/copy-of-n3/$changed"

power_off n2
echo "mount -t tmpfs -o mode=777 none '$OUT'" > "$WORK/cluster/hook/n2"
stage "n2 has lost its power"
ends_by_term "$task_n1" "${held[n1]}"
must "a task that gets TERM before its time limit ends with 75 and goes back to the queue" 60 has "exit code 75, restart 0 of 3: back to the queue" "$LOGS/$task_n1.log"
kill -CONT "${held[n3]}"
n2_is_down() { case $(on ctl sinfo -h -n n2 -o %T) in down*) ;; *) false ;; esac }
must "n2 is down" 120 n2_is_down
power_on n2
stage "n2 has power again, and does not see the report's folder"

# As many tasks as there are nodes wait in the second stage, so one runs on n2.
not_mounted() { grep -ls "may not be mounted here" "$LOGS"/*_*.log > "$WORK/hidden"; }
must "a task runs on n2" 240 not_mounted
must "a task that does not see the report's folder ends with 75" 60 has "exit code 75, restart 0" "$(head -n 1 "$WORK/hidden")"
check "it makes nothing there" "$(on n2 find "$OUT" -mindepth 1 | wc -l)" 0
on n2 umount "$OUT" && rm "$WORK/cluster/hook/n2"
stage "n2 sees it again"

hold_reduce() {
    local pid
    pid=$(workers reduce | head -n 1)
    [ -n "$pid" ] && hold "$pid" has_pages && reduce=$pid
}
pages() { find "$OUT/flights" -name index.html 2> /dev/null | wc -l; }
has_pages() { [ "$(pages)" -ge 3 ]; }
must "a reduction is held in the middle" 300 hold_reduce
made=$(pages) step=$(of_job "$reduce" SLURM_JOB_ID)
stage "the reduction is held after $made pages"
ends_by_term "$step" "$reduce"
must "the campaign ends" 240 queue_is_empty
stage "all jobs have ended"

job() { on ctl scontrol -o show job "$1" | grep -o "\b$2=[^ ]*" | cut -d= -f2; }
check "the manifests are as they were" "$(sha256sum --check --quiet "$WORK/manifests" 2>&1)" ""
check "the task of the node that was cut was run again" \
    "$([ "$(job "$task_n2" Restarts)" -ge 1 ] && job "$task_n2" ExitCode)" 0:0
check "the task of n1 was run again" "$([ "$(job "$task_n1" Restarts)" -ge 1 ] && job "$task_n1" ExitCode)" 0:0
check "a node with its own copy of the logs makes results" "$(job "$task_n3" Restarts) $(job "$task_n3" ExitCode)" "0 0:0"
check "the task of a log that changed after the plan ends with 3" "$(job "${array}_7" ExitCode)" 3:0
check "it names that log" "$(grep -c "^.*$changed: the log has changed since it was planned" "$LOGS/${array}_7.log")" 1
kept=$(grep -o 'made, [0-9]* kept' "$LOGS/step-$step.log" | grep -o '[0-9]*' | tail -n 1)
check "a reduction that was stopped goes on: pages made before are kept" "$([ "${kept:-0}" -ge "$made" ] && echo yes)" yes
check "the reduction ends with 0" "$(has "reduce ended with exit code 0" "$LOGS/step-$step.log" && job "$step" ExitCode)" 0:0
check "run.json counts all flights" "$(grep -c "\"flights\": $flights," "$OUT/run.json")" 1
check "no temporary file is left" "$(find "$OUT" -name '*flightlag-tmp')" ""

# --- The same report as of one machine ------------------------------------------------------------------------------------

"$SHARED/flightlag" campaign "$FLIGHTS" --out "$WORK/one/report" --quiet "${options[@]}"
check "one machine ends with 0" $? 0
# What ARCHITECTURE.md names: the day and the host, what this machine remembers, and notes of attempts without a result.
diff -rq --exclude=run.json --exclude=.flightlag --exclude=trouble.json "$WORK/one/report" "$OUT" > "$WORK/differences"
grep -v "^Only in $OUT/by-key" "$WORK/differences" | head -n 20
check "the report is that of one machine, byte for byte, in $(find "$WORK/one/report" -type f | wc -l) files" \
    "$(grep -vc "^Only in $OUT/by-key" "$WORK/differences")" 0

# --- The next night: a step on a node that does not see the folder, and nothing to do --------------------------------------

before=$(cd "$OUT" && find . -type f ! -path './.flightlag/*' ! -name run.json -exec sha256sum {} + | sort | sha256sum)
on n2 mount -t tmpfs -o mode=777 none "$OUT"
step=$(submit ON_NODE=--nodelist=n2 | sed -n 's/^submitted step \([0-9]*\);.*/\1/p')
must "a step that does not see the report's folder ends with 75" 120 has "exit code 75, restart 0" "$LOGS/step-$step.log"
check "it too makes nothing there" "$(on n2 find "$OUT" -mindepth 1 | wc -l)" 0
on n2 umount "$OUT"
must "it ends once the folder is there" 240 queue_is_empty
check "with nothing changed there are no tasks" "$(grep -c 'shards=0' "$LOGS/step-$step.log") $(grep -c 'array=' "$LOGS/step-$step.log")" "1 0"
check "and no byte changes" "$(cd "$OUT" && find . -type f ! -path './.flightlag/*' ! -name run.json -exec sha256sum {} + | sort | sha256sum)" "$before"

stage "all"
echo "$passed passed, $failed failed"
[ "$failed" = 0 ]
