#!/bin/sh
# The tables of docs/results/aclstm.md: auto-conditioned LSTMs in three forms on the salsas of cmu-dance, what they foretell
# and for how long they dance, and a page with one seed that all of them go on from.
#
#     scripts/reproduce/aclstm.sh DATA SPLITS OUT
#
# DATA and SPLITS as ../shared/data/unpack.sh leaves them. What is there is not made again, and a run that was stopped goes
# on. Variables: STEPS of every run (6000), RATE (the configuration's, 1e-3), SEEDS ("1 2 3"), MORE ("yes": one run each of
# the compat wiring, of the rate in the files' headers and of another order of the root's angles), SEED_COUNT of an
# evaluation (50), FRAMES made of each (4000), CONFIG (256), THREADS (1), KINELM.
set -eu
call="the call is: $0 DATA SPLITS OUT"
data=${1:?$call} splits=${2:?$call} out=${3:?$call}
here=$(cd "$(dirname "$0")/../.." && pwd)
kinelm=${KINELM:-$here/target/release/kinelm}
threads="--threads ${THREADS:-1} --quiet"
mkdir -p "$out"
# without their true rate, as the files' headers say it: 120, so that every fourth frame is taken
awk -F, -v OFS=, '{ print $1, $2, $3, $4, $5 }' "$splits/cmu-dance.csv" > "$out/header-rate.csv"

# NAME SEED LABELS OPTIONS.. : a run and its figures
row() {
    name=$1-$2 seed=$2 labels=$3
    shift 3
    run=$out/$name
    if [ ! -e "$run.done" ]; then
        if [ -e "$run/config.toml" ]; then
            "$kinelm" aclstm train --run "$run" --resume --steps "${STEPS:-6000}" $threads
        else
            "$kinelm" aclstm train "$data/cmu-dance" --labels "$labels" --only genre=salsa --config "${CONFIG:-256}" \
                ${RATE:+--rate "$RATE"} --steps "${STEPS:-6000}" --seed "$seed" --run "$run" "$@" $threads
        fi
        touch "$run.done"
    fi
    [ -e "$run.json" ] || {
        "$kinelm" aclstm evaluate --run "$run" --seeds "${SEED_COUNT:-50}" --frames "${FRAMES:-4000}" --json $threads > "$run.new"
        mv "$run.new" "$run.json"
    }
    [ -e "$run.bvh" ] || "$kinelm" aclstm generate --run "$run" --seed-clip "$data/cmu-dance/salsa/03.bvh" --fps-source 60 \
        --seed-frames 300 --with-seed --frames 400 --out "$run.bvh" $threads
}

csv=$splits/cmu-dance.csv
for seed in ${SEEDS:-1 2 3}; do
    for cell in positional:5 euler:5 quaternion:5 quaternion:30 quaternion:45; do
        row "$(echo $cell | tr : -)" "$seed" "$csv" --representation "${cell%:*}" --condition "${cell#*:}"
    done
done
if [ "${MORE:-yes}" = yes ]; then
    row compat 1 "$csv" --representation quaternion --condition 45 --wiring compat
    row header-rate 1 "$out/header-rate.csv" --representation quaternion --condition 45
    row euler-YXZ 1 "$csv" --representation euler --condition 5 --root-order YXZ
fi
first=${SEEDS:-1 2 3}
first=${first%% *}
[ -e "$out/page.html" ] || "$kinelm" view "$data/cmu-dance/salsa/03.bvh:fps=60,skip=10" $(for cell in positional-5 euler-5 quaternion-5 \
    quaternion-30 quaternion-45; do echo "$out/$cell-$first.bvh"; done) --out "$out/page.html"
python3 "$here/scripts/reproduce/aclstm.py" "$out"
