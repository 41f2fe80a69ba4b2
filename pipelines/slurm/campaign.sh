#!/bin/bash
# Runs a campaign on Slurm: campaign.sh FLIGHTS OUT [OPTIONS OF flightlag campaign ...]
#
# FLIGHTS and OUT must have the same paths on all nodes. Safe to run again at any time: the results in OUT decide what is
# left to do, not the queue. Settings of the site: site.env beside this script (see site.env.example), or the environment.
set -euo pipefail
if [ $# -lt 2 ]; then echo "usage: campaign.sh FLIGHTS OUT [OPTIONS OF flightlag campaign ...]" >&2; exit 2; fi
HERE=$(cd "$(dirname "$0")" && pwd)
FLIGHTS=$(realpath "$1") OUT=$(realpath -m "$2")
shift 2
LOGS=$OUT.slurm
mkdir -p "$LOGS" "$OUT"
# A node where OUT is empty does not see this folder.
[ -n "$(ls -A "$OUT")" ] || mkdir "$OUT/.flightlag"
export HERE FLIGHTS OUT LOGS ROUND=0
# shellcheck source=common.sh
. "$HERE/common.sh"
job=$(submit flightlag-step "$LOGS/step-%j.log" "$HERE/step.sbatch" "$@")
echo "submitted step $job; its log is $LOGS/step-$job.log"
