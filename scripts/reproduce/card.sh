#!/bin/sh
# The figures of the ready model's card (crates/ready/CARD.md), of the weights as they are in the program.
#
#     scripts/reproduce/card.sh DATA SPLITS OUT
#
# DATA and SPLITS as ../shared/data/unpack.sh leaves them. What is there is not made again. Variables: RUN (ready), THREADS (2),
# KINELM, PYTHON with numpy, scipy and scikit-learn.
set -eu
call="the call is: $0 DATA SPLITS OUT"
data=${1:?$call}/cmu-dance splits=${2:?$call} out=${3:?$call}
here=$(cd "$(dirname "$0")/../.." && pwd)
kinelm=${KINELM:-$here/target/release/kinelm} python=${PYTHON:-python3}
threads="--threads ${THREADS:-2} --quiet"
mkdir -p "$out"
if [ -n "${RUN:-}" ]; then
    run=$RUN
else
    # the first dance writes the model into a cache folder
    export XDG_CACHE_HOME="$out/cache"
    [ -d "$XDG_CACHE_HOME/kinelm" ] || "$kinelm" generate --seconds 1 --out "$out/first.bvh" --quiet
    run=$(echo "$XDG_CACHE_HOME"/kinelm/ready-*)
fi
awk 'NR == 1 { print $0 ",skip" } NR > 1 { print $0 ",10" }' "$splits/cmu-dance.csv" > "$out/labels.csv"
[ -e "$out/corpus/corpus.json" ] ||
    "$kinelm" tokenize "$data" --labels "$out/labels.csv" --tokenizer "$run/tokenizer.json" --out "$out/corpus" --quiet
once() { # FILE COMMAND..: its output, made once
    file=$1
    shift
    [ -e "$out/$file" ] || { "$@" > "$out/$file.new"; mv "$out/$file.new" "$out/$file"; }
}
once floors.txt "$kinelm" evaluate baselines --corpus "$out/corpus" --quiet
once test.json "$kinelm" evaluate likelihood --run "$run" --corpus "$out/corpus" --json $threads
for frames in 10 20 40; do
    once gaps-$frames.txt "$kinelm" evaluate gaps --run "$run" --corpus "$out/corpus" --frames $frames --gaps 60 $threads
done

# 48 free dances beside the validation clips: does the model give a clip back?
mkdir -p "$out/free"
for seed in 1 2 3 4; do
    [ -e "$out/free/$seed-12.bvh" ] ||
        "$kinelm" generate --run "$run" --fps 20 --seconds 20 --variations 12 --seed $seed --out "$out/free/$seed.bvh" $threads
done
once copying.json "$kinelm" evaluate dance "$out/free"/*.bvh --real "$out/corpus" --copying --json $threads

# what it says of dances that it doesn't know: walks of bandai-2
[ -e "$out/walks/corpus.json" ] || {
    mkdir -p "$out/walk"
    cp "${data%/*}"/bandai-2/dataset-2_walk_*_00[1-3].bvh "$out/walk/"
    { echo clip,split; for walk in "$out/walk"/*.bvh; do echo "$(basename "$walk" .bvh),test"; done; } > "$out/walks.csv"
    "$kinelm" tokenize "$out/walk" --labels "$out/walks.csv" --tokenizer "$run/tokenizer.json" --out "$out/walks" --quiet
}
once walks.json "$kinelm" evaluate likelihood --run "$run" --corpus "$out/walks" --conditions none --json $threads

export PYTHON="$python"
KINELM=$kinelm THREADS=${THREADS:-2} SEED=5 once aims.txt "$here/scripts/reproduce/aims.sh" "$run" "$out/corpus" "${data%/*}" "$splits" "$out/aims"
salsas=$(for take in 03 07 11 18 22 26; do echo "$data/salsa/$take.bvh"; done)
KINELM=$kinelm OPTIONS="--fps-source 60 --skip 10" LEAD_IN=train GUIDANCE=2 DANCES=16 once conditions.txt \
    "$here/scripts/reproduce/conditions.sh" "$run" "$out/corpus" genre "$out/conditions" $salsas

"$python" - "$out" "$run" <<'PYTHON'
import json, sys
from pathlib import Path

import numpy as np

out, run = map(Path, sys.argv[1:])
test, walks, copied = (json.loads((out / f"{name}.json").read_text()) for name in ("test", "walks", "copying"))
limit = json.loads((run / "held_out.json").read_text())["p95"]
bits = {clip["name"]: clip["bits_per_frame"] for clip in test["clips"]}
print((out / "floors.txt").read_text())
print(f"test clips: {test['bits_per_frame']:.2f} bits/frame; median of the clips {np.median(list(bits.values())):.2f}, 95th percentile {limit}")
print("by clip:", ", ".join(f"{name} {b:.1f}" for name, b in sorted(bits.items())))
over = [clip["bits_per_frame"] for clip in walks["clips"]]
print(f"called surprising: {sum(b > limit for b in over)} of {len(over)} walks ({min(over):.0f} to {max(over):.0f} bits/frame), "
      f"{sum(b > limit for name, b in bits.items() if name.startswith('salsa'))} of 6 salsas")
print("copying, dances and validation clips:", json.dumps(copied["copied"]))
for name in ["gaps-10", "gaps-20", "gaps-40", "aims", "conditions"]:
    print(f"\n{name}\n{(out / (name + '.txt')).read_text()}")
PYTHON
