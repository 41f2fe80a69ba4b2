# What the scripts of this folder share. Sourced, not run.
# shellcheck shell=bash

if [ -f "$HERE/site.env" ]; then
    set -a
    # shellcheck source=/dev/null
    . "$HERE/site.env"
    set +a
fi
: "${FLIGHTLAG:=flightlag}" "${SBATCH_OPTIONS:=}" "${TASK_OPTIONS:=--time=60 --mem=1G}" "${STEP_OPTIONS:=--time=60 --mem=2G}"
: "${MAX_RUNNING:=}" "${MAX_SHARDS:=}" "${MAX_ROUNDS:=4}" "${RETRIES:=3}" "${RETRY_WAIT:=60}"
export FLIGHTLAG SBATCH_OPTIONS TASK_OPTIONS STEP_OPTIONS MAX_RUNNING MAX_SHARDS MAX_ROUNDS RETRIES RETRY_WAIT

# submit NAME LOG SCRIPT [ARGUMENTS]: submits the next step and prints its number. DEPENDENCY may hold a job to wait for.
submit() {
    local name=$1 log=$2
    shift 2
    # shellcheck disable=SC2086  # options are words
    sbatch --parsable --requeue --open-mode=append --ntasks=1 --signal=B:TERM@60 $SBATCH_OPTIONS $STEP_OPTIONS \
        ${DEPENDENCY:+"--dependency=$DEPENDENCY"} --job-name="$name" --output="$log" --export=ALL "$@"
}

# supervised COMMAND: runs it, passes SIGTERM on, and returns its exit code.
supervised() {
    local pid='' termed='' code again
    # Before the command starts: SIGTERM may come at any moment.
    trap 'if [ -n "$pid" ]; then kill -TERM "$pid" 2>/dev/null; else termed=1; fi' TERM
    "$@" &
    pid=$!
    [ -z "$termed" ] || kill -TERM "$pid" 2>/dev/null
    wait "$pid"
    code=$?
    # A trap ends the wait, and not the command.
    while kill -0 "$pid" 2>/dev/null; do
        wait "$pid"
        code=$?
    done
    # The command may have ended between the trap and the loop. bash keeps its exit code.
    wait "$pid" 2>/dev/null
    again=$?
    [ "$again" = 127 ] || code=$again
    trap - TERM
    # 128 + 15: SIGTERM came before the command could ask for it. Time heals that.
    [ "$code" != 143 ] || code=75
    return "$code"
}

# retry_on_75 CODE JOB: sends the job back to the queue if time may heal what happened, RETRIES times at most.
retry_on_75() {
    if [ "$1" = 75 ] && [ "${SLURM_RESTART_COUNT:-0}" -lt "$RETRIES" ]; then
        echo "exit code 75, restart ${SLURM_RESTART_COUNT:-0} of $RETRIES: back to the queue"
        # Slurm ends this run of the job while it waits.
        scontrol requeue "$2" && sleep "$RETRY_WAIT"
    fi
}
