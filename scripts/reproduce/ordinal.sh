#!/bin/sh
# Whether targets that know their neighbours help (`[train] loss = "ordinal"`): bits/frame on the test clips, and the angle error
# of what is foretold of them, beside plain cross-entropy.
#
#     sh ../shared/data/unpack.sh DATA && scripts/reproduce/ordinal.sh DATA ../shared/data/splits OUT
#
# SET names the data (cmu-dance); common.sh has the other variables.
set -eu
call="the call is: $0 DATA SPLITS OUT"
data=${1:?$call} splits=${2:?$call} out=${3:?$call}
. "$(dirname "$0")/common.sh"
set=${SET:-cmu-dance}

tokenizer "$set" "$data/$set" --labels "$splits/$set.csv" $(read_as "$set") --joints 13 --fps 20
corpus "$set" "$set" "$set"
for loss in cross_entropy ordinal; do
    configured "$out/runs/$loss.toml" "train.loss=\"$loss\""
    for seed in $seeds; do
        training pretrain "$loss" "$seed" --config "$out/runs/$loss.toml" --corpus "$out/corpora/$set"
        measured "$loss" "$set" "$seed"
        foretold=$out/runs/$loss-$seed.foretold.json
        [ -e "$foretold" ] || "$kinelm" evaluate prediction "$data/$set" --labels "$splits/$set.csv" $(read_as "$set") \
            --run "$out/runs/$loss-$seed" --samples 0 --json --quiet > "$foretold"
    done
done
table "Targets, $set"
python3 - "$out" $seeds <<'PYTHON'
import json, sys
from pathlib import Path

print("| targets | sum of angle errors, rad, up to 100, 200, 300, 400 ms, greedy (lowest to highest of the seeds) |\n|---|---|")
for loss in ["cross_entropy", "ordinal"]:
    found = [json.loads((Path(sys.argv[1]) / f"runs/{loss}-{seed}.foretold.json").read_text()) for seed in sys.argv[2:]]
    greedy = [next(row for row in f["rows"] if row["name"] == "the model, greedy") for f in found]
    rows = [[until["angle"] for until in row["up_to"]] for row in greedy]
    spread = [f"{sum(c) / len(c):.3f} ({min(c):.3f} to {max(c):.3f})" for c in zip(*rows)]
    print(f"| {loss} | {', '.join(spread)} |")
PYTHON
