#!/bin/sh
# What training in bf16 costs: bits/frame on the test clips after the same steps on the same batches, of the two-level model beside
# the one trained in f32, and the paired difference.
#
#     sh ../shared/data/unpack.sh DATA && scripts/reproduce/bf16.sh DATA ../shared/data/splits OUT
#
# Variables: SETS ("cmu-dance bandai-2"), JOINTS (18); common.sh has the others, STEPS is 1000 here.
set -eu
call="the call is: $0 DATA SPLITS OUT"
data=${1:?$call} splits=${2:?$call} out=${3:?$call}
CONFIG=${CONFIG:-$(dirname "$0")/../../configs/train/two-level.toml}
DROPOUT=${DROPOUT:-0} STEPS=${STEPS:-1000} WINDOWS=${WINDOWS:-0}
. "$(dirname "$0")/common.sh"
sets=${SETS:-cmu-dance bandai-2}

configured "$out/runs/config.toml"
for set in $sets; do
    tokenizer "$set" "$data/$set" --labels "$splits/$set.csv" $(read_as "$set") --joints "${JOINTS:-18}" --fps 20
    corpus "$set" "$set" "$set"
done
for seed in $seeds; do
    for set in $sets; do
        for precision in f32 bf16; do
            training pretrain "$set-$precision" "$seed" --config "$out/runs/config.toml" --corpus "$out/corpora/$set" \
                --precision "$precision"
            measured "$set-$precision" "$set" "$seed"
        done
    done
done
table "Training in bf16"
python3 - "$out" "$seeds" $sets <<'PYTHON'
import json, sys
from pathlib import Path

out, seeds, sets = Path(sys.argv[1]), sys.argv[2].split(), sys.argv[3:]
print("| corpus | bf16 above f32, % of bits/frame, a seed each | mean |\n|---|---|---|")
for name in sets:
    bits = lambda kind, seed: json.loads((out / f"results/{name}-{kind}-{seed}.json").read_text())["bits_per_frame"]
    more = [100 * (bits("bf16", seed) / bits("f32", seed) - 1) for seed in seeds]
    print(f"| {name} | {', '.join(f'{x:+.3f}' for x in more)} | {sum(more) / len(more):+.3f} |")
PYTHON
