#!/bin/sh
# The tables of docs/results/aclstm.md: auto-conditioned LSTMs in three forms on the salsas of cmu-dance, what they foretell
# and for how long they dance, a GPT of as much data and CPU time beside them, curves (curves.svg), and a page with one seed that
# all of them go on from (page.html).
#
#     scripts/reproduce/aclstm.sh DATA SPLITS OUT
#
# DATA and SPLITS as ../shared/data/unpack.sh leaves them. What is there is not made again, and a run that was stopped goes
# on. Variables: STEPS of every run (6000), RATE (the configuration's, 1e-3), SEEDS ("1 2 3"), MORE ("yes": one run each of
# the compat wiring, of the rate in the files' headers and of another order of the root's angles), SEED_COUNT of an
# evaluation (50), FRAMES made of each (4000), GPT_STEPS of the GPT (7 for 3 STEPS, which took as much CPU time on the machine of
# the results; 0: no GPT), PRECISION of its training (bf16), CONFIG (256), THREADS (1), KINELM.
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
            "$kinelm" aclstm resume "$run" --steps "${STEPS:-6000}" $threads
        else
            "$kinelm" aclstm train "$data/cmu-dance" --labels "$labels" --only genre=salsa --config "${CONFIG:-256}" \
                ${RATE:+--set "learning_rate=$RATE"} --set "steps=${STEPS:-6000}" --set "seed=$seed" --run "$run" "$@" $threads
        fi
        touch "$run.done"
    fi
    # reports of older versions have no curves
    grep -qs '"curves"' "$run.json" || {
        "$kinelm" aclstm evaluate --run "$run" --seeds "${SEED_COUNT:-50}" --frames "${FRAMES:-4000}" --json $threads > "$run.new"
        mv "$run.new" "$run.json"
    }
    [ -e "$run.bvh" ] || "$kinelm" aclstm generate --run "$run" --seed-clip "$data/cmu-dance/salsa/03.bvh" --fps-source 60 \
        --seed-frames 300 --with-seed --frames 400 --out "$run.bvh" $threads
}

csv=$splits/cmu-dance.csv
for seed in ${SEEDS:-1 2 3}; do
    for cell in positional:5 euler:5 quaternion:5 quaternion:30 quaternion:45; do
        row "$(echo $cell | tr : -)" "$seed" "$csv" --set "form=${cell%:*}" --set "condition=${cell#*:}"
    done
done
if [ "${MORE:-yes}" = yes ]; then
    row compat 1 "$csv" --set form=quaternion --set condition=45 --set wiring=compat
    row header-rate 1 "$out/header-rate.csv" --set form=quaternion --set condition=45
    row euler-YXZ 1 "$csv" --set form=euler --set condition=5 --set root_order=YXZ
fi
first=${SEEDS:-1 2 3}
first=${first%% *}
models="positional-5-$first euler-5-$first quaternion-5-$first quaternion-30-$first quaternion-45-$first"

# the GPT learns the same clips without their first frames, goes on from the seeds of the others, and is measured as they are
gpt_steps=${GPT_STEPS:-$((${STEPS:-6000} * 7 / 3))}
if [ "$gpt_steps" != 0 ]; then
    gpt=$out/gpt judge="--run $out/quaternion-45-$first --seeds ${SEED_COUNT:-50} --frames ${FRAMES:-4000} $threads"
    mkdir -p "$gpt/dances"
    # names below the folder of the salsas
    awk -F, 'NR == 1 { print $0 ",skip" } $3 == "salsa" { sub("^salsa/", ""); print $0 ",10" }' "$csv" > "$gpt/salsa.csv"
    salsas="$data/cmu-dance/salsa --labels $gpt/salsa.csv"
    [ -e "$gpt/tokenizer.json" ] || "$kinelm" tokenizer fit $salsas --out "$gpt/tokenizer.json" --quiet
    [ -e "$gpt/corpus/corpus.json" ] ||
        "$kinelm" tokenize $salsas --tokenizer "$gpt/tokenizer.json" --out "$gpt/corpus" --quiet
    if [ ! -e "$gpt/run.done" ]; then
        if [ -e "$gpt/run/config.toml" ]; then
            "$kinelm" pretrain resume "$gpt/run" $threads
        else
            "$kinelm" pretrain --config two-level --corpus "$gpt/corpus" --run "$gpt/run" --steps "$gpt_steps" \
                --precision "${PRECISION:-bf16}" $threads
        fi
        touch "$gpt/run.done"
    fi
    "$kinelm" aclstm evaluate $judge --write-seeds "$gpt/seeds"
    # 300 frames at 30 a second are 200 of the model's
    goes_on="--rig prompt --from-frame 200 --fps 30 $threads"
    for seed in "$gpt"/seeds/*.bvh; do
        dance=$gpt/dances/$(basename "$seed")
        [ -e "$dance" ] || "$kinelm" generate --run "$gpt/run" --fps 20 --prompt "$seed" --frames $((202 + ${FRAMES:-4000} * 2 / 3)) \
            --feet off $goes_on --out "$dance"
    done
    [ -e "$out/gpt-1.json" ] || {
        "$kinelm" aclstm evaluate $judge --dances "$gpt/dances" --json > "$out/gpt-1.new"
        mv "$out/gpt-1.new" "$out/gpt-1.json"
    }
    # a copy, without the file beside it: a page puts a dance of which it knows the prompt where that stands
    [ -e "$out/gpt-1.bvh" ] || {
        "$kinelm" generate --run "$gpt/run" --fps 20 --prompt "$data/cmu-dance/salsa/03.bvh" --fps-source 60 --skip 10 --frames 467 \
            $goes_on --out "$gpt/03.bvh"
        cp "$gpt/03.bvh" "$out/gpt-1.bvh"
    }
    models="$models gpt-1"
fi
[ -e "$out/page.html" ] || "$kinelm" view "$data/cmu-dance/salsa/03.bvh:fps=60,skip=10" \
    $(for model in $models; do echo "$out/$model.bvh"; done) --out "$out/page.html"
reports=""
for row in positional-5 euler-5 quaternion-5 quaternion-30 quaternion-45 gpt; do
    for report in "$out/$row"-[0-9].json; do
        [ ! -e "$report" ] || reports="$reports $report"
    done
done
"$kinelm" aclstm plot $reports --out "$out/curves.svg" --force
python3 "$here/scripts/reproduce/aclstm.py" "$out"
