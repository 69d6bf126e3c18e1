#!/bin/sh
# Trains kinelm's own model (crates/ready): a two-level model of cmu-dance's train clips alone, taught goals and genres, with
# seconds and dances of its own. scripts/reproduce/card.sh measures it.
#
#     scripts/reproduce/ready.sh DATA SPLITS OUT
#
# DATA and SPLITS as ../shared/data/unpack.sh leaves them. What is there is not made again. OUT/run is then packed by
# `cargo run --release -p kinelm-ready --example pack -- OUT/run`. Variables: GENRES (salsa indian martial), STEPS (12000),
# PRECISION (auto), SEED (1), THREADS (2), KINELM, PYTHON with numpy.
set -eu
call="the call is: $0 DATA SPLITS OUT"
data=${1:?$call}/cmu-dance splits=${2:?$call} out=${3:?$call}
here=$(cd "$(dirname "$0")/../.." && pwd)
kinelm=${KINELM:-$here/target/release/kinelm} python=${PYTHON:-python3}
threads="--threads ${THREADS:-2} --quiet"
precision="--precision ${PRECISION:-auto} --seed ${SEED:-1}"
mkdir -p "$out"
genres=${GENRES:-salsa indian martial}
# cmu-dance begins with a rest pose that settles
awk -F, -v genres=" $genres " 'NR == 1 { print $0 ",skip" } NR > 1 && index(genres, " " $3 " ") { print $0 ",10" }' \
    "$splits/cmu-dance.csv" > "$out/labels.csv"
folders=$(for genre in $genres; do echo "$data/$genre"; done)
[ -e "$out/data" ] || { mkdir -p "$out/data.new"; cp -r $folders "$out/data.new"; mv "$out/data.new" "$out/data"; }
[ -e "$out/tokenizer.json" ] ||
    "$kinelm" tokenizer fit "$out/data" --labels "$out/labels.csv" --joints 18 --out "$out/tokenizer.json" --quiet
[ -e "$out/corpus/corpus.json" ] ||
    "$kinelm" tokenize "$out/data" --labels "$out/labels.csv" --tokenizer "$out/tokenizer.json" --out "$out/corpus" --quiet
[ -e "$out/floors.txt" ] || "$kinelm" evaluate baselines --corpus "$out/corpus" --quiet > "$out/floors.txt"

# little data: more dropout, and more of what changes a clip's speed
sed 's/^dropout = 0.2 /dropout = 0.3 /; s/^speed = 0.1 /speed = 0.15 /' "$here/configs/train/two-level.toml" > "$out/two-level.toml"
[ -e "$out/base.done" ] || {
    "$kinelm" pretrain --config "$out/two-level.toml" --corpus "$out/corpus" --run "$out/base" --steps "${STEPS:-12000}" $precision $threads
    touch "$out/base.done"
}
[ -e "$out/goals.done" ] || {
    "$kinelm" finetune --from "$out/base" --config goal --corpus "$out/corpus" --run "$out/goals" $precision $threads
    touch "$out/goals.done"
}
# labels last, as goals make a model forget them, and of every genre as many windows: taught by the clips' lengths, dances of
# the two small genres turn into salsas
[ -e "$out/run.done" ] || {
    equally=""
    for genre in $genres; do
        sed -n "1p; s:^$genre/::p" "$out/labels.csv" > "$out/labels-$genre.csv"
        [ -e "$out/by/$genre/corpus.json" ] || "$kinelm" tokenize "$out/data/$genre" --labels "$out/labels-$genre.csv" \
            --tokenizer "$out/tokenizer.json" --out "$out/by/$genre" --quiet
        equally="$equally --corpus $out/by/$genre=1"
    done
    "$kinelm" finetune --from "$out/goals" --config labels --conditions genre --steps 2400 $equally --run "$out/run" $precision $threads
    touch "$out/run.done"
}
for run in base goals run; do
    [ -e "$out/$run.json" ] || {
        "$kinelm" evaluate likelihood --run "$out/$run" --corpus "$out/corpus" --json $threads > "$out/$run.new"
        mv "$out/$run.new" "$out/$run.json"
    }
done

# seconds that the model itself made, instead of parts of clips: of sixteen dances of each genre
made=""
for genre in $genres; do
    mkdir -p "$out/made/$genre"
    for seed in 1 2; do
        [ -e "$out/made/$genre/$seed-8.bvh" ] || "$kinelm" generate --run "$out/run" --fps 20 --label genre=$genre --guidance 3 \
            --look-ahead 8 --seconds 12 --variations 8 --seed $seed --out "$out/made/$genre/$seed.bvh" $threads
    done
    { echo clip,genre,split; for dance in "$out/made/$genre"/*.bvh; do
        echo "$(basename "$dance" .bvh),$genre,train"; done; } > "$out/made-$genre.csv"
    [ -e "$out/leads/$genre/corpus.json" ] || "$kinelm" tokenize "$out/made/$genre" --labels "$out/made-$genre.csv" \
        --tokenizer "$out/run/tokenizer.json" --out "$out/leads/$genre" --quiet
    # dances begin with a genre as often as the train clips are of it
    share=$("$python" - "$out/corpus" $genre <<'PYTHON'
import json, sys
from pathlib import Path

clips = [json.loads(line) for line in (Path(sys.argv[1]) / "clips.jsonl").read_text().splitlines()]
train = [clip for clip in clips if clip["split"] == "train"]
own = [clip for clip in train if clip["labels"]["genre"] == sys.argv[2]]
print(f"{100 * sum(clip['frames'] for clip in own) / sum(clip['frames'] for clip in train):.1f}")
PYTHON
)
    made="$made --corpus $out/leads/$genre=$share"
done
# a run that begins with those corpora keeps seconds of them; of eight, by seed 2, six, one and one are of the three genres
[ -e "$out/lead-run/lead_ins.json" ] || "$kinelm" finetune --from "$out/run" --config goal --steps 1 --seed 2 $made --run "$out/lead-run" $threads
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
