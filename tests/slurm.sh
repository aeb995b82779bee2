#!/usr/bin/env bash
# Trains a clip in windows of time on a real Slurm, one controller and two node daemons on this machine, kills one daemon and one
# task midway, and compares the scenes with those of one process; and the same in two processes of xargs:
# tests/slurm.sh DASH [WINDOWS [STEPS]]. It starts daemons and needs root, and Debian's packages slurmctld, slurmd, slurm-client and
# munge. A node whose daemon is gone is given up after half a minute: what still runs on it then is queued again, and waits for
# it.
set -euo pipefail
[ "$(id -u)" -eq 0 ] || exec sudo -E "$0" "$@"
dash=$(realpath "$1")
windows=${2:-6}
steps=${3:-1500}
work=$(mktemp -d)
host=$(hostname -s)
export SLURM_CONF=$work/slurm.conf
# Each node has one CPU.
export RAYON_NUM_THREADS=1

finish() {
    code=$?
    for pid in "$work"/*.pid; do
        [ ! -s "$pid" ] || kill -9 "$(cat "$pid")" 2>/dev/null || true
    done
    pkill -9 -f "slurmstepd.*$work" 2>/dev/null || true
    if [ "$code" -ne 0 ]; then
        tail -n 20 "$work"/*.log "$work"/shared/*.log 2>/dev/null || true
    fi
    rm -rf "$work"
    exit "$code"
}
trap finish EXIT

cat > "$SLURM_CONF" <<CONF
ClusterName=dash
SlurmctldHost=$host(127.0.0.1)
SlurmUser=root
AuthType=auth/munge
# A task that was requeued waits as long as a credential lasts.
AuthInfo=socket=$work/munge.socket,cred_expire=5
StateSaveLocation=$work/state
SlurmdSpoolDir=$work/spool-%n
SlurmctldPidFile=$work/slurmctld.pid
SlurmdPidFile=$work/slurmd-%n.pid
SlurmctldLogFile=$work/slurmctld.log
SlurmdLogFile=$work/slurmd-%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SlurmdParameters=config_overrides
SlurmdTimeout=6
ReturnToService=2
JobRequeue=1
NodeName=n0 NodeHostname=$host NodeAddr=127.0.0.1 Port=17017 CPUs=1
NodeName=n1 NodeHostname=$host NodeAddr=127.0.0.1 Port=17018 CPUs=1
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
CONF
head -c 1024 /dev/urandom > "$work/munge.key"
chmod 600 "$work/munge.key"
mkdir "$work/state" "$work/spool-n0" "$work/spool-n1"
munged --force --socket="$work/munge.socket" --key-file="$work/munge.key" --pid-file="$work/munged.pid" \
    --log-file="$work/munged.log" --seed-file="$work/munged.seed" 2>/dev/null
slurmctld -c
slurmd -N n0
slurmd -N n1

# Waits until a command succeeds, so many seconds at most.
wait_for() {
    left=$1
    shift
    until "$@"; do
        left=$((left - 1))
        [ "$left" -gt 0 ] || { echo "waited in vain: $*"; return 1; }
        sleep 1
    done
}
are_idle() { [ "$(sinfo -h -t idle -o %D)" = 2 ]; }
are_running() { [ "$(pgrep -f -c "^$dash work $work/shared")" -ge 2 ]; }
# A checkpoint is there to go on from.
have_begun() { ls "$work"/shared/window-*/checkpoints/[0-9]* >/dev/null 2>&1; }
is_drained() { [ -z "$(squeue -h)" ]; }
wait_for 60 are_idle

cd "$work"
# Windows of four frames, of which neighbours share one, and the room that they share.
"$dash" synth clip --scene day --cameras 4 --frames $((3 * windows + 1)) --size 32x24 -q > /dev/null
trained=(train clip --window 4 --overlap 1 --room yes --iterations "$steps" --device flex -q
    --set checkpoint_interval=50 --set "initial_points=[0, 300]")
"$dash" plan "${trained[@]}" --out shared --slurm > tasks.sh
sh tasks.sh > /dev/null
wait_for 120 have_begun
wait_for 60 are_running
sinfo -h -N -o "%N %T"
squeue -h -o "%i %T %N" | head -n 4
kill -9 "$(cat slurmd-n1.pid)"
kill -9 "$(pgrep -f "^$dash work $work/shared" | head -n 1)"
echo "killed: the daemon of n1, and a task"
wait_for 600 is_drained
echo "drained; the nodes are: $(sinfo -h -N -o "%N %T" | tr '\n' ' ')"
restarts=$(scontrol -o show job | grep -c " Restarts=[1-9]" || true)
echo "queued again: $restarts tasks"
[ "$restarts" -ge 1 ]
grep -q "mean over the windows" shared/join.log || { cat shared/join.log; exit 1; }

"$dash" "${trained[@]}" --out whole > /dev/null
"$dash" plan "${trained[@]}" --out parallel > /dev/null
seq 0 "$windows" | xargs -P 2 -I N "$dash" work parallel --task N -q --device flex > /dev/null
for run in whole/room whole/window-*; do
    for other in shared parallel; do
        cmp "$run/scene/scene.safetensors" "$other/${run#whole/}/scene/scene.safetensors"
    done
    echo "same bits: $run"
done
[ "$(ls -d whole/window-* | wc -l)" -eq "$windows" ]
