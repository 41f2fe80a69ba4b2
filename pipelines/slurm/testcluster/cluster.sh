# Starts and breaks a Slurm of several hosts on one machine. Sourced by test.sh, in mount and process namespaces of its own.
# shellcheck shell=bash
#
# Each host has its own network, process, mount and name space, its own munged, and an address on a bridge that exists only in
# the controller's network. Process 1 of a host is host.sh: when that is killed, the kernel ends everything on the host at once.

# cluster_start DIR NODE...: the controller `ctl` and nodes with one processor each.
cluster_start() {
    DIR=$1
    shift
    mkdir -p "$DIR"/{state,log,spool,hook}
    head -c 128 /dev/urandom > "$DIR/munge.key"
    sed "s|@DIR@|$DIR|g" "$HERE/testcluster/slurm.conf.in" > "$DIR/slurm.conf"
    ip netns add ctl && ip -n ctl link set lo up || return 1
    ip -n ctl link add br0 type bridge && ip -n ctl addr add 10.77.0.1/24 dev br0 && ip -n ctl link set br0 up || return 1
    local node number=10
    for node; do
        number=$((number + 1))
        mkdir -p "$DIR/spool/$node"
        echo "NodeName=$node NodeAddr=10.77.0.$number CPUs=1 RealMemory=2000 State=UNKNOWN" >> "$DIR/slurm.conf"
        ip netns add "$node" && ip -n "$node" link set lo up || return 1
        ip -n ctl link add "to-$node" type veth peer name eth0 netns "$node" || return 1
        ip -n ctl link set "to-$node" master br0 up || return 1
        ip -n "$node" addr add "10.77.0.$number/24" dev eth0 && ip -n "$node" link set eth0 up || return 1
    done
    echo "PartitionName=main Nodes=ALL Default=YES MaxTime=INFINITE State=UP" >> "$DIR/slurm.conf"
    for node in ctl "$@"; do power_on "$node"; done
}

# power_on HOST: if DIR/hook/HOST is there, the host runs it before its daemons.
power_on() {
    setsid nsenter --net="/run/netns/$1" unshare --uts --pid --mount --fork --kill-child --mount-proc -- \
        bash "$HERE/testcluster/host.sh" "$DIR" "$1" > "$DIR/log/$1.out" 2>&1 < /dev/null &
    echo $! > "$DIR/$1.started"
    disown # its end is no news
}

# power_off HOST: every process of the host dies at once.
power_off() {
    kill -KILL "$(cat "$DIR/$1.started")"
}

# on HOST COMMAND...: runs it there, as root.
on() {
    local first
    first=$(pgrep -P "$(cat "$DIR/$1.started")" | head -n 1) && [ -n "$first" ] || return 1
    nsenter --target "$first" --net --uts --mount --pid -- "${@:2}"
}

# idle_nodes: how many there are.
idle_nodes() {
    on ctl sinfo -h -N -t idle -o %N 2> /dev/null | wc -l
}
