#!/bin/sh
# The thesis's table 4.8 on the shared data: class tokens on a pre-trained model and on drawn weights, beside plain classifiers,
# and how many labels they need.
#
#     sh ../shared/data/unpack.sh DATA && scripts/reproduce/classification.sh DATA ../shared/data/splits OUT
#
# bandai-2: content and style, split by running number; content with the styles elderly and youthful held out. cmu-dance: genre,
# and the dancer of the salsa. Words at FPS (5) frames a second, so that a window of 512 tokens shows 11 of them.
#   STEPS (1500) of pre-training on the training clips of all three sets, without labels; TUNE (600) of a classifier on
#   all of bandai-2, half as many on cmu-dance, a quarter on a share; SHARES ("0.01 0.05 0.2") of the labels beside all; SEEDS ("1 2 3"); BEGINS ("pretrained
#   scratch"); KINELM. Whatever is done is kept.
set -eu
call="the call is: $0 DATA SPLITS OUT"
data=${1:?$call} splits=${2:?$call} out=${3:?$call}
here=$(cd "$(dirname "$0")/../.." && pwd)
kinelm=${KINELM:-$here/target/release/kinelm}
fps=${FPS:-5} steps=${STEPS:-1500} tune=${TUNE:-600} shares=${SHARES:-0.01 0.05 0.2}
seeds=${SEEDS-1 2 3} begins=${BEGINS-pretrained scratch}
mkdir -p "$out/results" "$out/classifiers"

awk -F, -v OFS=, 'NR == 1 { for (i = 1; i <= NF; i++) at[$i] = i }
    NR > 1 { $at["split"] = $at["style"] ~ /^(elderly|youthful)$/ ? "test" : $at["split"] == "test" ? "valid" : $at["split"] }
    { print }' "$splits/bandai-2.csv" > "$out/held-out.csv"
awk -v OFS=, 'NR == 1 { print $0, "skip" } NR > 1 { print $0, 10 }' "$splits/cmu-dance.csv" > "$out/cmu-dance.csv"
[ -e "$out/tokenizer.json" ] || "$kinelm" tokenizer fit "$data/bandai-1" "$data/bandai-2" "$data/cmu-dance" --joints 13 --fps "$fps" --root-rotation absolute --height velocity \
    --labels "$splits/bandai-1.csv" --labels "$splits/bandai-2.csv" --labels "$out/cmu-dance.csv" --out "$out/tokenizer.json" --quiet
corpus() {
    [ -e "$out/$1/corpus.json" ] || "$kinelm" tokenize "$data/$2" --labels "$3" --tokenizer "$out/tokenizer.json" --out "$out/$1" --quiet
}
corpus by-number bandai-2 "$splits/bandai-2.csv"
corpus held-out bandai-2 "$out/held-out.csv"
corpus bandai-1 bandai-1 "$splits/bandai-1.csv"
corpus cmu-dance cmu-dance "$out/cmu-dance.csv"

sed -e 's/^context = .*/context = 512/' -e 's/^dropout = .*/dropout = 0.1/' -e 's/^batch = .*/batch = 8/' \
    -e 's/^eval_every = .*/eval_every = 500/' -e 's/^checkpoint_every = .*/checkpoint_every = 500/' \
    -e 's/^eval_windows = .*/eval_windows = 64/' "$here/configs/train/tiny.toml" > "$out/model.toml"
# what is held out of a classifier is held out of the model below it
for held in by-number held-out; do
    [ -e "$out/run-$held.done" ] || {
        rm -rf "$out/run-$held"
        "$kinelm" pretrain --config "$out/model.toml" --corpus "$out/$held" --corpus "$out/bandai-1" --corpus "$out/cmu-dance" \
            --run "$out/run-$held" --steps "$steps" --quiet
        touch "$out/run-$held.done"
    }
done

# TASK BEGIN SHARE STEPS CORPUS RUN FIELDS OPTIONS.. : a classifier, measured on the test clips. Plain ones stand beside the
# pre-trained; those that learn from all labels are the same for every seed.
cell() {
    task=$1 begin=$2 share=$3 updates=$4 corpus=$5 run=$6 fields=$7
    shift 7
    name=${task}_${begin}_$share-$seed
    folder=$out/classifiers/$name result=$out/results/$name.json
    [ ! -e "$result" ] || return 0
    rates="--rate 1e-3 --head-rate 3e-3"
    [ "$begin" = pretrained ] || rates="--scratch $rates"
    plain=
    [ "$begin" = scratch ] || [ "$share" = 1 ] || plain=--baselines
    [ "$begin" = scratch ] || [ "$share$seed" != "1${seeds%% *}" ] || plain="--baselines --run $out/$run"
    rm -rf "$folder"
    "$kinelm" classify train --run "$out/$run" --corpus "$out/$corpus" --fields "$fields" --steps "$updates" \
        --eval-every $((updates / 4)) --patience 0 --seed "$seed" --share "$share" $rates --out "$folder" "$@" --quiet
    "$kinelm" classify eval --classifier "$folder" --corpus "$out/$corpus" $plain --plot "$out/results/$name.png" --json --quiet \
        > "$result.new"
    mv "$result.new" "$result"
}
half=$((tune / 2)) quarter=$((tune / 4))
for seed in $seeds; do
    for begin in $begins; do
        cell by-number "$begin" 1 "$tune" by-number run-by-number content,style
        cell held-out "$begin" 1 "$tune" held-out run-held-out content
        cell genre "$begin" 1 $half cmu-dance run-by-number genre
        cell dancer "$begin" 1 $half cmu-dance run-by-number dancer --only genre=salsa
    done
done
for seed in $seeds; do
    for begin in $begins; do
        for share in $shares; do
            cell by-number "$begin" "$share" $quarter by-number run-by-number content,style
        done
    done
done
python3 "$here/scripts/reproduce/classification.py" "$out" "$seeds"
