#!/usr/bin/env bash
# Three hosts, a, b and c, on this machine, for as long as a command runs on a: scripts/local_hosts.sh COMMAND …
# Open MPI 4 starts ranks on them as on any hosts that ssh reaches:
#     scripts/local_hosts.sh mpirun -x PYTHONPATH -x OMP_NUM_THREADS -n 4 --host a:2,b:2 python -m ddmpi run SCENE.toml
# Each host has its own name, network, processes and shared memory (namespaces of Linux); all see the same files.
# One network joins them, 10.77.0.0/24, so that ranks on two hosts have only TCP. What Open MPI starts on b or c does
# not inherit the environment, as with ssh; `scripts/local_hosts.sh --on HOST COMMAND`, on a, starts other programs.
# SIGTERM to process 1 of b or c ends that host and all on it; `ip link set eth0 down`, there, cuts it off without a
# word to the others.
# Nothing is left when the command ends, is killed, or whoever has started this dies.
# Exit code: the command's, or 125 where namespaces are not permitted or ip (Debian: iproute2) is missing.
set -Eeuo pipefail
SELF=$(readlink -f "${BASH_SOURCE[0]}")
NAMESPACES=(unshare --mount --net --uts --ipc --pid --fork --kill-child)
PLACE=/dev/shm # each host has its own; on a, files name the first processes of b and c

give_up() { echo "local_hosts.sh: $*" >&2; exit 125; }

# A host's own name, processes and folder; names of all hosts.
settle() {
    hostname "$1"
    mount -t proc proc /proc
    mount -t tmpfs tmpfs "$PLACE"
    printf '10.77.0.%s\n' '1 a' '2 b' '3 c' | cat - <(echo 127.0.0.1 localhost) >"$PLACE/hosts"
    mount --bind "$PLACE/hosts" /etc/hosts
    ip link set lo up
}

# The first process of b or c. It prints its number, as a sees it, once the host is there.
further_host() {
    local number
    read -r number _ </proc/self/stat
    settle "$1"
    trap 'exit 1' TERM
    echo "$number"
    exec >&2
    sleep infinity &
    wait
}

# The first process of a.
first_host() {
    local name number=1 process started
    settle a
    ip link add eth0 address 02:00:0a:4d:00:01 type bridge # else it takes another one when a host goes
    ip addr add 10.77.0.1/24 dev eth0
    ip link set eth0 up
    for name in b c; do
        number=$((number + 1))
        exec {started}< <(exec "${NAMESPACES[@]}" "$SELF" --further "$name" </dev/null)
        read -r process <&"$started"
        exec {started}<&-
        echo "$process" >"$PLACE/$name"
        ip link add "to-$name" type veth peer name eth0 netns "$process"
        ip link set "to-$name" master eth0 up
        nsenter --target "$process" --net ip addr add "10.77.0.$number/24" dev eth0
        nsenter --target "$process" --net ip link set eth0 up
    done
    export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 # everyone is root here
    export OMPI_MCA_mpi_yield_when_idle=1 OMPI_MCA_hwloc_base_binding_policy=none # all hosts have the same cores
    export TMPDIR=$PLACE OMPI_MCA_plm_rsh_agent="$SELF --on"
}

# A command on a host, in place of ssh: its words are joined for a shell, and 255 says that something went wrong.
on() {
    local process
    process=$(cat "$PLACE/$1")
    shift
    nsenter --target "$process" --mount --net --uts --ipc --pid \
        env -i PATH="$PATH" HOME="${HOME:-/}" TMPDIR="$PLACE" sh -c "$*" || exit 255
}

case "${1:-}" in
    "") sed -n '2,/^set/s/^# \{0,1\}//p' "$SELF" >&2; exit 2 ;;
    --on) shift; on "$@" ;;
    --further) further_host "$2" ;;
    --first)
        shift
        trap 'give_up "hosts cannot be made here (above)"' ERR
        first_host
        trap - ERR
        code=0
        "$@" || code=$?
        exit "$code"
        ;;
    *)
        command -v ip >/dev/null || give_up "there is no ip; Debian has it in iproute2"
        [ "$(id -u)" = 0 ] || NAMESPACES+=(--user --map-root-user)
        reason=$("${NAMESPACES[@]}" true 2>&1) || give_up "hosts of one's own are not permitted here: $reason"
        exec setpriv --pdeathsig KILL "${NAMESPACES[@]}" "$SELF" --first "$@"
        ;;
esac
