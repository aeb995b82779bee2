#!/bin/sh
# Trains short runs of every preset and method on the CPU and prints a hash of every parameter of each scene and of
# each test picture. Run it before and after a change that must not change results, and compare:
#   tests/same_bits.sh > before; ..; tests/same_bits.sh > after; diff before after
#
#   DASH   the binary [target/release/dash]
#   DATA   the folder of the captures zju313, mujoco and nr_nerf [../shared/data]; without it their runs fail
#   WORK   where runs are made [a temporary folder]
#   ONLY   a word of the runs' names, to run some of them
#
# Hashes are equal on one kind of processor: kernels take the widest vectors that it has.
set -eu
cd "$(dirname "$0")/.."
DASH=${DASH:-target/release/dash}
DATA=${DATA:-../shared/data}
WORK=${WORK:-$(mktemp -d)}
ONLY=${ONLY:-}
here=$(pwd)

# Name, dataset, then options of `dash train`.
run() {
    name=$1 dataset=$2
    shift 2
    case $name in *"$ONLY"*) ;; *) return 0 ;; esac
    "$DASH" -q --device flex --threads 2 train "$dataset" --out "$WORK/$name" --seed 3 "$@" >"$WORK/$name.log" 2>&1 ||
        { cat "$WORK/$name.log"; echo "$name failed"; exit 1; }
    hashes "$name"
}

hashes() {
    "$DASH" -q --device flex render "$WORK/$1" --cameras test --out "$WORK/$1/test" >"$WORK/$1.log" 2>&1 ||
        { cat "$WORK/$1.log"; echo "$1: no pictures"; exit 1; }
    python3 "$here/tests/hash_run.py" "$1" "$WORK/$1"
}

mkdir -p "$WORK"
[ -d "$WORK/bounce" ] || "$DASH" -q synth "$WORK/bounce" --scene bounce >"$WORK/synth.log"
[ -d "$WORK/tiny" ] || "$DASH" -q synth "$WORK/tiny" --scene tiny >"$WORK/synth.log"

run bounce-quick "$WORK/bounce" --preset quick --iterations 600
run zju313-default "$DATA/zju313" --preset default --iterations 150 --downscale 4 --test-cameras 5,12
run zju313-paper "$DATA/zju313" --preset paper --iterations 150 --downscale 4 --test-cameras 5,12
run zju313-reference "$DATA/zju313" --preset reference --iterations 100 --downscale 4 --test-cameras 5,12
run zju313-masked-size "$DATA/zju313" --preset quick --iterations 100 --downscale 2 --test-cameras 5,12
run scene5-quick "$DATA/mujoco/scene5" --preset quick --iterations 300 --downscale 4
run nr_nerf-quick "$DATA/nr_nerf" --preset quick --iterations 200 --downscale 4
run beer_can-quick "$DATA/beer_can" --preset quick --iterations 100 --downscale 8
for method in dash w/o-dec w/o-ctrl w/o-reg hash hexplane hexplane+dec grid4d grid4d+dec embedding static; do
    run "tiny-$(echo $method | tr -d /)" "$WORK/tiny" --preset quick --iterations 60 --method $method
done

# A run that is killed after its second checkpoint and goes on has the bits of one that was not.
case bounce-resumed in *"$ONLY"*)
    cut=$WORK/bounce-resumed
    "$DASH" -q --device flex --threads 2 train "$WORK/bounce" --out "$cut" --seed 3 --preset quick --iterations 600 \
        --set checkpoint_interval=150 >"$cut.log" 2>&1 &
    pid=$!
    while [ ! -d "$cut/checkpoints/000300" ]; do
        kill -0 $pid 2>/dev/null || { cat "$cut.log"; echo "it ended before it could be killed"; exit 1; }
        sleep 0.05
    done
    kill -9 $pid
    wait $pid 2>/dev/null || true
    "$DASH" -q --device flex --threads 2 train "$WORK/bounce" --out "$cut" --resume >"$cut.log" 2>&1
    hashes bounce-resumed
    ;;
esac
