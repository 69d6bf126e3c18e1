#!/bin/sh
# kinelm's own model (crates/ready) and the figures of its card: a two-level model of cmu-dance's train clips alone, taught
# genres and goals.
#
#     scripts/reproduce/ready.sh DATA SPLITS OUT
#
# DATA and SPLITS as ../shared/data/unpack.sh leaves them. What is there is not made again. OUT/run is then packed by
# `cargo run --release -p kinelm-ready --example pack -- OUT/run`. Variables: STEPS (12000), PRECISION (auto), THREADS (2), KINELM,
# PYTHON with numpy, scipy and scikit-learn.
set -eu
call="the call is: $0 DATA SPLITS OUT"
data=${1:?$call}/cmu-dance splits=${2:?$call} out=${3:?$call}
here=$(cd "$(dirname "$0")/../.." && pwd)
kinelm=${KINELM:-$here/target/release/kinelm} python=${PYTHON:-python3}
threads="--threads ${THREADS:-2} --quiet"
precision="--precision ${PRECISION:-auto}"
mkdir -p "$out"
# cmu-dance begins with a rest pose that settles
awk 'NR == 1 { print $0 ",skip" } NR > 1 { print $0 ",10" }' "$splits/cmu-dance.csv" > "$out/labels.csv"
[ -e "$out/tokenizer.json" ] ||
    "$kinelm" tokenizer fit "$data" --labels "$out/labels.csv" --joints 18 --out "$out/tokenizer.json" --quiet
[ -e "$out/corpus/corpus.json" ] ||
    "$kinelm" tokenize "$data" --labels "$out/labels.csv" --tokenizer "$out/tokenizer.json" --out "$out/corpus" --quiet
[ -e "$out/floors.txt" ] || "$kinelm" evaluate baselines --corpus "$out/corpus" --quiet > "$out/floors.txt"

# little data: more dropout, and more of what changes a clip's speed
sed 's/^dropout = 0.2 /dropout = 0.3 /; s/^speed = 0.1 /speed = 0.15 /' "$here/configs/train/two-level.toml" > "$out/two-level.toml"
[ -e "$out/base.done" ] || {
    "$kinelm" pretrain --config "$out/two-level.toml" --corpus "$out/corpus" --run "$out/base" --steps "${STEPS:-12000}" $precision $threads
    touch "$out/base.done"
}
[ -e "$out/labels.done" ] || {
    "$kinelm" finetune --from "$out/base" --config labels --conditions genre --corpus "$out/corpus" --run "$out/labels" $precision $threads
    touch "$out/labels.done"
}
[ -e "$out/run.done" ] || {
    "$kinelm" finetune --from "$out/labels" --config goal --corpus "$out/corpus" --run "$out/run" $precision $threads
    touch "$out/run.done"
}
for run in base labels run; do
    [ -e "$out/$run.json" ] || {
        "$kinelm" evaluate likelihood --run "$out/$run" --corpus "$out/corpus" --json $threads > "$out/$run.new"
        mv "$out/$run.new" "$out/$run.json"
    }
done

# seconds that the model itself made, instead of parts of clips: the two likeliest dances of eight of each genre
[ -e "$out/leads/corpus.json" ] || {
    for genre in salsa indian martial; do
        mkdir -p "$out/made/$genre"
        [ -e "$out/made/$genre/2-8.bvh" ] || for seed in 1 2; do
            "$kinelm" generate --run "$out/run" --label genre=$genre --guidance 2 --seconds 12 --variations 8 --seed $seed \
                --out "$out/made/$genre/$seed.bvh" $threads
        done
    done
    { echo clip,genre,split; for genre in salsa indian martial; do for dance in "$out/made/$genre"/*.bvh; do
        echo "$genre/$(basename "$dance" .bvh),$genre,train"; done; done; } > "$out/made.csv"
    "$kinelm" tokenize "$out/made" --labels "$out/made.csv" --tokenizer "$out/run/tokenizer.json" --out "$out/leads" --quiet
}
# a run that begins with that corpus keeps seconds of it
[ -e "$out/lead-run/lead_ins.json" ] ||
    "$kinelm" finetune --from "$out/run" --config goal --steps 1 --corpus "$out/leads" --run "$out/lead-run" $threads
cp "$out/lead-run/lead_ins.json" "$out/run/lead_ins.json"

# how surprising its held-out clips are
"$python" - "$out" <<'PYTHON'
import json, sys
from pathlib import Path

import numpy as np

out = Path(sys.argv[1])
found = json.loads((out / "run.json").read_text())
bits = [clip["bits_per_frame"] for clip in found["clips"]]
text = json.dumps({"median": round(float(np.median(bits)), 2), "p95": round(float(np.percentile(bits, 95)), 2)})
(out / "run/held_out.json").write_text(text + "\n")
print("held out:", text)
PYTHON

# the card's figures
salsas=$(for take in 03 07 11 18 22 26; do echo "$data/salsa/$take.bvh"; done)
KINELM=$kinelm THREADS=${THREADS:-2} SEED=5 "$here/scripts/reproduce/aims.sh" "$out/run" "$out/corpus" "${data%/*}" "$splits" "$out/aims" > "$out/aims.txt"
KINELM=$kinelm OPTIONS="--fps-source 60 --skip 10" LEAD_IN=train GUIDANCE=2 DANCES=16 \
    "$here/scripts/reproduce/conditions.sh" "$out/run" "$out/corpus" genre "$out/conditions" $salsas > /dev/null
for frames in 10 20 40; do
    [ -e "$out/gaps-$frames.json" ] || {
        "$kinelm" evaluate gaps --run "$out/run" --corpus "$out/corpus" --frames $frames --gaps 100 --json $threads > "$out/gaps.new"
        mv "$out/gaps.new" "$out/gaps-$frames.json"
    }
done
mkdir -p "$out/free"
[ -e "$out/free/4-12.bvh" ] || for seed in 1 2 3 4; do
    "$kinelm" generate --run "$out/run" --seconds 20 --variations 12 --seed $seed --out "$out/free/$seed.bvh" $threads
done
[ -e "$out/free.json" ] || {
    "$kinelm" evaluate dance "$out/free"/*.bvh --real "$out/corpus" --copying --json $threads > "$out/free.new"
    mv "$out/free.new" "$out/free.json"
}
# what it says of dances that it doesn't know: walks of bandai-2
[ -e "$out/walks/corpus.json" ] || {
    mkdir -p "$out/walk"
    cp "${data%/*}"/bandai-2/dataset-2_walk_*_00[1-3].bvh "$out/walk/"
    { echo clip,split; for walk in "$out/walk"/*.bvh; do echo "$(basename "$walk" .bvh),test"; done; } > "$out/walks.csv"
    "$kinelm" tokenize "$out/walk" --labels "$out/walks.csv" --tokenizer "$out/run/tokenizer.json" --out "$out/walks" --quiet
}
[ -e "$out/walks.json" ] ||
    "$kinelm" evaluate likelihood --run "$out/run" --corpus "$out/walks" --conditions none --json $threads > "$out/walks.json"
