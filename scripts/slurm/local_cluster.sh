#!/usr/bin/env bash
# A Slurm of one node on this machine, to try batch scripts on: scripts/slurm/local_cluster.sh start|stop|status
# Everything it writes is in one folder, $DDMPI_SLURM (by default ddmpi-slurm-UID in TMPDIR or /tmp): key, sockets,
# configuration, spool, logs, process numbers. Its ports are free ones. `start` prints the line that points
# sbatch, srun and squeue at it:
#     eval "$(scripts/slurm/local_cluster.sh start)"
# Wants munge and Slurm. Debian: apt-get install --no-install-recommends slurm-wlm munge libpmix-dev
set -euo pipefail

DIR=${DDMPI_SLURM:-${TMPDIR:-/tmp}/ddmpi-slurm-$(id -u)}
CONF=$DIR/slurm.conf
OURS="# Written by local_cluster.sh for $DIR"
DAEMONS="slurmd slurmctld munged"
export PATH=$PATH:/usr/sbin:/sbin

give_up() { echo "local_cluster.sh: $*" >&2; exit 1; }

# Is the process in that file one of ours? Its command line names our folder.
alive() {
    local pid
    pid=$(cat "$DIR/$1.pid" 2>/dev/null) && [ -n "$pid" ] || return 1
    tr '\0' ' ' <"/proc/$pid/cmdline" 2>/dev/null | grep -qF "$DIR/"
}

await() { # seconds, command…
    local tries=$(($1 * 10))
    shift
    while ! "$@" >/dev/null 2>&1; do
        [ $((tries -= 1)) -gt 0 ] || return 1
        sleep 0.1
    done
}

free_port() {
    local port
    while :; do
        port=$((20000 + RANDOM % 10000))
        (: <"/dev/tcp/127.0.0.1/$port") 2>/dev/null || break
    done
    echo "$port"
}

write_configuration() {
    local user cores
    user=$(id -un)
    cores=$(nproc)
    cat >"$CONF" <<CONF
$OURS
ClusterName=local
SlurmctldHost=localhost(127.0.0.1)
SlurmctldPort=$(free_port)
SlurmdPort=$(free_port)
SlurmUser=$user
SlurmdUser=$user
AuthType=auth/munge
CredType=cred/munge
# A requeued job may start after as many seconds as credentials live: five, not the usual two minutes.
AuthInfo=socket=$DIR/munge.socket,cred_expire=5
StateSaveLocation=$DIR/state
SlurmdSpoolDir=$DIR/spool
SlurmctldPidFile=$DIR/slurmctld.pid
SlurmdPidFile=$DIR/slurmd.pid
SlurmctldLogFile=$DIR/slurmctld.log
SlurmdLogFile=$DIR/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SwitchType=switch/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
MpiDefault=pmix
ReturnToService=2
KillWait=5
SchedulerParameters=batch_sched_delay=0,sched_min_interval=0,bf_interval=1
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
# Two ranks also where there is one core.
SlurmdParameters=config_overrides
NodeName=localhost NodeAddr=127.0.0.1 CPUs=$((cores > 2 ? cores : 2)) RealMemory=8000
PartitionName=debug Nodes=ALL Default=YES MaxTime=INFINITE State=UP
CONF
    case "$(slurmd -V)" in # older ones know no such plugin, newer ones look for control groups without it
        "slurm-wlm 2"[0-2].* | "slurm 2"[0-2].*) : >"$DIR/cgroup.conf" ;;
        *) echo CgroupPlugin=disabled >"$DIR/cgroup.conf" ;;
    esac
}

start() {
    local program
    for program in munged slurmctld slurmd sbatch; do
        command -v "$program" >/dev/null || give_up "there is no $program; Debian has it in slurm-wlm and munge"
    done
    if status >/dev/null; then
        give_up "it is running already, in $DIR"
    fi
    [ ! -e "$DIR" ] || { [ -O "$DIR" ] && { [ -z "$(ls -A "$DIR")" ] || grep -qsxF "$OURS" "$CONF"; }; } ||
        give_up "$DIR is there, and is not ours; move it away"
    mkdir -p "$DIR"
    (cd "$DIR" && rm -rf -- state spool munge.* munged.* slurm.conf slurmd.* slurmctld.* cgroup.conf start.log)
    mkdir "$DIR/state" "$DIR/spool"
    chmod 755 "$DIR"
    head -c 1024 /dev/urandom >"$DIR/munge.key"
    chmod 600 "$DIR/munge.key"
    write_configuration
    export SLURM_CONF=$CONF
    # What these daemons inherit must not hold the pipe that somebody reads our own words from.
    munged --force --key-file="$DIR/munge.key" --socket="$DIR/munge.socket" --pid-file="$DIR/munged.pid" \
        --log-file="$DIR/munged.log" --seed-file="$DIR/munge.seed" >"$DIR/start.log" 2>&1 ||
        give_up "munged does not start: $(tail -n 3 "$DIR/munged.log" "$DIR/start.log")"
    slurmctld -f "$CONF" >>"$DIR/start.log" 2>&1 ||
        { stop; give_up "slurmctld does not start: $(tail -n 3 "$DIR/start.log")"; }
    slurmd -N localhost -f "$CONF" >>"$DIR/start.log" 2>&1 ||
        { stop; give_up "slurmd does not start: $(tail -n 3 "$DIR/start.log")"; }
    await 20 bash -c 'sinfo -h -o %t | grep -qx idle' || {
        tail -n 5 "$DIR/slurmctld.log" "$DIR/slurmd.log" >&2
        stop
        give_up "the node is not ready after 20 s (logs above)"
    }
    echo "export SLURM_CONF='$CONF'"
}

stop() {
    local name pid
    if alive slurmctld; then
        export SLURM_CONF=$CONF
        timeout 5 scancel --user="$(id -un)" >/dev/null 2>&1 || true
        await 15 bash -c '[ -z "$(squeue -h)" ]' || true # they are killed after KillWait
    fi
    for name in $DAEMONS; do
        if alive "$name"; then
            pid=$(cat "$DIR/$name.pid")
            kill "$pid"
            await 10 bash -c "! kill -0 $pid" || kill -9 "$pid"
        fi
    done
}

status() {
    local name
    for name in $DAEMONS; do
        alive "$name" || { echo "$name does not run (folder $DIR)"; return 1; }
    done
    echo "running; export SLURM_CONF='$CONF'"
}

case "${1:-}" in
    start) start ;;
    stop) stop ;;
    status) status ;;
    *) give_up "usage: local_cluster.sh start|stop|status" ;;
esac
