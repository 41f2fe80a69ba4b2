#!/bin/bash
# The first process of a host of the test cluster: host.sh DIR HOST
set -euo pipefail
dir=$1 host=$2
hostname "$host"
# As on a real host, these are its own.
mount -t tmpfs -o mode=755 none /run/munge
mount -t tmpfs -o mode=755 none /etc/slurm
cp "$dir/slurm.conf" /etc/slurm/slurm.conf
cp "$dir/munge.key" /run/munge/key
chown -R munge: /run/munge
chmod 0400 /run/munge/key
setpriv --reuid=munge --regid=munge --clear-groups munged --force --key-file=/run/munge/key --socket=/run/munge/socket \
    --pid-file=/run/munge/pid --log-file=/run/munge/log --seed-file=/run/munge/seed
if [ -e "$dir/hook/$host" ]; then
    # shellcheck source=/dev/null
    . "$dir/hook/$host"
fi
case $host in
ctl) slurmctld -D & ;;
*) slurmd -D & ;;
esac
wait
