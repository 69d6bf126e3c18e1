#!/bin/sh
# What a choreographer may ask of dances whose root and right arm are given, with feet locked and as decoded: the table "Aims" of
# docs/results/two-level.md. Six held-out salsas, four variations each, 24 dances.
#
#     scripts/reproduce/aims.sh RUN CORPUS DATA SPLITS OUT
#
# RUN: a two-level run on 18 joints; CORPUS: cmu-dance as its tokenizer codes it. DATA and SPLITS as ../shared/data/unpack.sh
# leaves them. What is there is not made again. Variables: SEED (5), FIRST_FRAMES (64 candidates), TOP_P (generate's own), THREADS
# (1), KINELM, PYTHON with numpy, scipy and scikit-learn.
set -eu
call="the call is: $0 RUN CORPUS DATA SPLITS OUT"
run=${1:?$call} corpus=${2:?$call} data=${3:?$call}/cmu-dance/salsa splits=${4:?$call} out=${5:?$call}
for input in "$run" "$corpus" "$data" "$splits/cmu-dance.csv"; do
    [ -e "$input" ] || { echo "$0: $input: there is no such file; $call" >&2; exit 1; }
done
here=$(cd "$(dirname "$0")/../.." && pwd)
kinelm=${KINELM:-$here/target/release/kinelm}
threads="--threads ${THREADS:-1} --quiet"
read="--fps-source 60 --skip 10"
takes="03 07 11 18 22 26"
mkdir -p "$out/lock" "$out/off" "$out/real"
for take in $takes; do
    for feet in lock off; do
        [ -e "$out/$feet/$take-4.bvh" ] || "$kinelm" generate --run "$run" --fps 20 --prompt "$data/$take.bvh" $read --joints root,right_arm \
            --variations 4 --seed "${SEED:-5}" --first-frames "${FIRST_FRAMES:-64}" ${TOP_P:+--top-p "$TOP_P"} --feet $feet --out "$out/$feet/$take.bvh" $threads
    done
    real=$out/real/$take
    [ -e "$real.bvh" ] || {
        "$kinelm" tokenizer text "$data/$take.bvh" $read --tokenizer "$run/tokenizer.json" --quiet > "$real.txt"
        "$kinelm" tokenizer decode "$real.txt" "$real.bvh" --tokenizer "$run/tokenizer.json" --quiet
    }
done
for dances in lock off real; do
    # of dances the sidecars know the floor
    floor=""
    [ $dances != real ] || floor="--floor 0"
    [ -e "$out/$dances.json" ] || {
        "$kinelm" evaluate dance "$out/$dances"/*.bvh --real "$corpus" $floor --json $threads > "$out/$dances.new"
        mv "$out/$dances.new" "$out/$dances.json"
    }
    for dance in "$out/$dances"/*.bvh; do
        [ -e "${dance%.bvh}.npz" ] || "$kinelm" convert "$dance" "${dance%.bvh}.npz" --positions --quiet
    done
    [ -e "$out/words/$dances/corpus.json" ] ||
        "$kinelm" tokenize "$out/$dances" --tokenizer "$run/tokenizer.json" --floor 0 --out "$out/words/$dances" --quiet
done
"${PYTHON:-python3}" "$here/scripts/reproduce/aims.py" "$out" "$corpus" "$splits/cmu-dance.csv"
