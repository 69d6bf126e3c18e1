#!/bin/sh
# The thesis's table 4.8 on the shared data: class tokens on a pre-trained model and on drawn weights, beside plain classifiers,
# and how many labels they need.
#
#     sh ../shared/data/unpack.sh DATA && scripts/reproduce/classification.sh DATA ../shared/data/splits OUT
#
# bandai-2: content and style, split by running number; content with the styles elderly and youthful held out. cmu-dance: genre,
# and the dancer of the salsa. Words at 10 frames a second, so that a window of 1,024 tokens shows 2.3 s.
#   STEPS (1500) of pre-training, on bandai-1 and bandai-2; TUNE (600) of a classifier; SHARES ("0.01 0.05 0.2 1") of the labels;
#   SEEDS ("1 2 3"); KINELM. Whatever is done is kept.
set -eu
call="the call is: $0 DATA SPLITS OUT"
data=${1:?$call} splits=${2:?$call} out=${3:?$call}
here=$(cd "$(dirname "$0")/../.." && pwd)
kinelm=${KINELM:-$here/target/release/kinelm}
steps=${STEPS:-1500} tune=${TUNE:-600} shares=${SHARES:-0.01 0.05 0.2 1} seeds=${SEEDS:-1 2 3}
mkdir -p "$out/results" "$out/classifiers"

awk -F, -v OFS=, 'NR == 1 { for (i = 1; i <= NF; i++) at[$i] = i }
    NR > 1 { $at["split"] = $at["style"] ~ /^(elderly|youthful)$/ ? "test" : $at["split"] == "test" ? "valid" : $at["split"] }
    { print }' "$splits/bandai-2.csv" > "$out/held-out.csv"
awk -v OFS=, 'NR == 1 { print $0, "skip" } NR > 1 { print $0, 10 }' "$splits/cmu-dance.csv" > "$out/cmu-dance.csv"
[ -e "$out/tokenizer.json" ] || "$kinelm" tokenizer fit "$data/bandai-1" "$data/bandai-2" "$data/cmu-dance" --joints 13 --fps 10 \
    --labels "$splits/bandai-1.csv" --labels "$splits/bandai-2.csv" --labels "$out/cmu-dance.csv" --out "$out/tokenizer.json" --quiet
corpus() {
    [ -e "$out/$1/corpus.json" ] || "$kinelm" tokenize "$data/$2" --labels "$3" --tokenizer "$out/tokenizer.json" --out "$out/$1" --quiet
}
corpus by-number bandai-2 "$splits/bandai-2.csv"
corpus held-out bandai-2 "$out/held-out.csv"
corpus bandai-1 bandai-1 "$splits/bandai-1.csv"
corpus cmu-dance cmu-dance "$out/cmu-dance.csv"

sed -e 's/^context = .*/context = 1024/' -e 's/^dropout = .*/dropout = 0.1/' -e 's/^batch = .*/batch = 4/' \
    -e 's/^eval_windows = .*/eval_windows = 64/' "$here/configs/train/tiny.toml" > "$out/model.toml"
# what is held out of a classifier is held out of the model below it
for held in by-number held-out; do
    [ -e "$out/run-$held.done" ] || {
        rm -rf "$out/run-$held"
        "$kinelm" pretrain --config "$out/model.toml" --corpus "$out/$held" --corpus "$out/bandai-1" --run "$out/run-$held" \
            --steps "$steps" --quiet
        touch "$out/run-$held.done"
    }
done

# NAME CORPUS RUN FIELDS OPTIONS.. : a classifier a seed, measured on the test clips; the plain ones beside the first
cell() {
    name=$1 corpus=$2 run=$3 fields=$4
    shift 4
    for seed in $seeds; do
        folder=$out/classifiers/$name-$seed result=$out/results/$name-$seed.json
        [ ! -e "$result" ] || continue
        rm -rf "$folder"
        "$kinelm" classify train --run "$out/$run" --corpus "$out/$corpus" --fields "$fields" --steps "$tune" --seed "$seed" \
            --out "$folder" "$@" --quiet
        "$kinelm" classify eval --classifier "$folder" --corpus "$out/$corpus" --baselines --run "$out/$run" --json --quiet > "$result.new"
        mv "$result.new" "$result"
    done
}
for share in $shares; do
    for begin in pretrained scratch; do
        # all weights learn from nothing, or tune what is there
        rate="--rate 1e-4"
        [ $begin = pretrained ] || rate="--scratch --rate 1e-3"
        cell "by-number_${begin}_$share" by-number run-by-number content,style --share "$share" $rate
        cell "held-out_${begin}_$share" held-out run-held-out content --share "$share" $rate
    done
done
for begin in pretrained scratch; do
    rate="--rate 1e-4"
    [ $begin = pretrained ] || rate="--scratch --rate 1e-3"
    cell "genre_${begin}_1" cmu-dance run-by-number genre $rate
    cell "dancer_${begin}_1" cmu-dance run-by-number dancer --only genre=salsa $rate
done
python3 "$here/scripts/reproduce/classification.py" "$out" "$seeds"
