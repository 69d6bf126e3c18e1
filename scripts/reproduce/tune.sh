#!/bin/sh
# Whether `kinelm tune` helps a user: the ready model's recipe without martial arts, tuned on the five train clips of martial
# arts, before and after on their two test clips, in bits and in dances that are given their root and right arm.
#
#     scripts/reproduce/tune.sh DATA SPLITS OUT
#
# As scripts/reproduce/ready.sh, whose variables it takes.
set -eu
call="the call is: $0 DATA SPLITS OUT"
data=${1:?$call} splits=${2:?$call} out=${3:?$call}
here=$(cd "$(dirname "$0")/../.." && pwd)
kinelm=${KINELM:-$here/target/release/kinelm}
threads="--threads ${THREADS:-2} --quiet"
GENRES="salsa indian" "$here/scripts/reproduce/ready.sh" "$data" "$splits" "$out"
martial=$data/cmu-dance/martial
awk -F, 'NR == 1 { print $0 ",skip" } $3 == "martial" { sub("martial/", ""); print $0 ",10" }' "$splits/cmu-dance.csv" > "$out/martial.csv"
[ -e "$out/martial/corpus.json" ] ||
    "$kinelm" tokenize "$martial" --labels "$out/martial.csv" --tokenizer "$out/run/tokenizer.json" --out "$out/martial" --quiet
[ -e "$out/tuned.done" ] || {
    "$kinelm" finetune --from "$out/run" --config tune --corpus "$out/martial" --run "$out/tuned" $threads
    touch "$out/tuned.done"
}
"$kinelm" evaluate baselines --corpus "$out/martial" --quiet
for run in run tuned; do
    echo
    echo "$run"
    "$kinelm" evaluate likelihood --run "$out/$run" --corpus "$out/martial" $threads
    mkdir -p "$out/dances/$run"
    for take in 05 07; do
        [ -e "$out/dances/$run/$take-8.bvh" ] || "$kinelm" generate --run "$out/$run" --fps 20 --prompt "$martial/$take.bvh" --fps-source 120 \
            --skip 10 --joints root,right_arm --variations 8 --seed 5 --out "$out/dances/$run/$take.bvh" $threads
    done
    "$kinelm" evaluate dance "$out/dances/$run"/*.bvh --real "$out/martial" $threads
done
