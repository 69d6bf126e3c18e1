#!/bin/sh
# The tables of docs/results/two-level.md: a two-level and a flat model on the same tokens of three sets, their bits, and their
# dances after the six held-out salsas, free and with root and right arm given.
#
#     scripts/reproduce/two-level.sh DATA SPLITS OUT
#
# DATA and SPLITS as ../shared/data/unpack.sh leaves them. What is there is not made again. Variables: JOINTS (18), STEPS of the two
# levels (16000) and of the flat model (FLAT_STEPS, 12500), SEEDS ("1"), FRAMES of a free dance (400), PRECISION (bf16), THREADS (1),
# KINELM.
set -eu
call="the call is: $0 DATA SPLITS OUT"
data=${1:?$call} splits=${2:?$call} out=${3:?$call}
here=$(cd "$(dirname "$0")/../.." && pwd)
kinelm=${KINELM:-$here/target/release/kinelm}
threads="--threads ${THREADS:-1} --quiet"
mkdir -p "$out"
for set in bandai-1 bandai-2 cmu-dance; do
    # cmu-dance begins with a rest pose that settles
    skip=0
    [ $set != cmu-dance ] || skip=10
    awk -v skip=$skip 'NR == 1 { print $0 ",skip" } NR > 1 { print $0 "," skip }' "$splits/$set.csv" > "$out/$set.csv"
done
tokenizer=$out/tokenizer.json
[ -e "$tokenizer" ] || "$kinelm" tokenizer fit "$data/cmu-dance" "$data/bandai-1" "$data/bandai-2" --labels "$out/cmu-dance.csv" \
    --labels "$out/bandai-1.csv" --labels "$out/bandai-2.csv" --joints "${JOINTS:-18}" --out "$tokenizer" --quiet
corpora=""
for set in cmu-dance bandai-1 bandai-2; do
    [ -e "$out/$set/corpus.json" ] ||
        "$kinelm" tokenize "$data/$set" --labels "$out/$set.csv" --tokenizer "$tokenizer" --out "$out/$set" --quiet
    weight=""
    [ $set != cmu-dance ] || weight="=10"
    corpora="$corpora --corpus $out/$set$weight"
done
[ -e "$out/floors.txt" ] || { "$kinelm" evaluate baselines --corpus "$out/cmu-dance" > "$out/floors.new" && mv "$out/floors.new" "$out/floors.txt"; }
# the flat model learns as the other does
[ -e "$out/flat.toml" ] ||
    awk '{ print } /^\[train\]/ { print "table_rate = 3.0" } END { print "\n[augment]\nmirror = 0.5" }' "$here/configs/train/tiny.toml" > "$out/flat.toml"
salsas=$(for take in 03 07 11 18 22 26; do echo "$data/cmu-dance/salsa/$take.bvh"; done)

# NAME RUN OPTIONS.. : dances of a run beside the real ones
danced() {
    name=$1 run=$2
    shift 2
    [ ! -e "$out/$name.json" ] || return 0
    mkdir -p "$out/$name"
    for prompt in $salsas; do
        "$kinelm" generate --run "$run" --fps 20 --prompt "$prompt" --fps-source 60 --skip 10 "$@" --seed 3 $threads \
            --out "$out/$name/$(basename "$prompt")"
    done
    "$kinelm" evaluate dance "$out/$name"/*.bvh --real "$out/cmu-dance" --json $threads > "$out/$name.new"
    mv "$out/$name.new" "$out/$name.json"
}

for seed in ${SEEDS:-1}; do
    for model in two-level flat; do
        run=$out/$model-$seed
        case $model in
            flat) config=$out/flat.toml steps=${FLAT_STEPS:-12500} ;;
            *) config=two-level steps=${STEPS:-16000} ;;
        esac
        if [ ! -e "$run.done" ]; then
            if [ -e "$run/config.toml" ]; then
                "$kinelm" pretrain resume "$run" $threads
            else
                "$kinelm" pretrain --config "$config" $corpora --run "$run" --steps "$steps" --seed "$seed" \
                    --precision "${PRECISION:-bf16}" $threads
            fi
            touch "$run.done"
        fi
        for set in cmu-dance bandai-2; do
            [ -e "$run-$set.json" ] || {
                "$kinelm" evaluate likelihood --run "$run" --corpus "$out/$set" --json $threads > "$run-$set.new"
                mv "$run-$set.new" "$run-$set.json"
            }
        done
        danced "$model-$seed-free" "$run" --from-frame 20 --frames $((20 + ${FRAMES:-400})) --variations 2
        danced "$model-$seed-given" "$run" --joints root,right_arm --variations 4
        danced "$model-$seed-given-off" "$run" --joints root,right_arm --variations 4 --feet off
    done
done
python3 - "$out" <<'PYTHON'
import json, sys
from pathlib import Path

out = Path(sys.argv[1])
read = lambda name: json.loads((out / name).read_text())
mean = lambda numbers: sum(numbers) / len(numbers)
number = lambda x, digits: "n/a" if x is None else f"{x:.{digits}f}"
percent = lambda x: "n/a" if x is None else f"{100 * x:.1f}"
rows = ["| run | bits/frame, cmu-dance | bandai-2 |", "|---|---|---|"]
free = ["| dances | frozen % | speed cm/s | jitter m/s³ | skate cm/s | in floor % | floating % |", "|---|---|---|---|---|---|---|"]
given = ["| dances | free joints' jitter | skate | answer | mismatch |", "|---|---|---|---|---|"]


def group(name, g):
    cells = [percent(g["world"]["freeze_rate"]), number(g["speed_cm_s"], 0), number(g["jitter_m_s3"], 0), number(g["skate_cm_s"], 0)]
    free.append(f"| {name} | {' | '.join(cells)} | {percent(g['penetration_share'])} | {percent(g['floating_share'])} |")


for path in sorted(out.glob("*-[0-9]*-cmu-dance.json")):
    run = path.name.removesuffix("-cmu-dance.json")
    bits = [read(f"{run}-{name}.json")["bits_per_frame"] for name in ("cmu-dance", "bandai-2")]
    rows.append(f"| {run} | {bits[0]:.2f} | {bits[1]:.2f} |")
    found = read(f"{run}-free.json")
    groups = {g["name"]: g for g in found["groups"]}
    if len(free) == 2:
        group("real, train", groups["train"])
    group(run, groups["dances"])
    for care in ("given", "given-off"):
        told = [p for _, p in read(f"{run}-{care}.json")["prompted"]]
        jitter, skate = ([p[key] for p in told] for key in ("free_jitter", "free_skate"))
        answer = mean([p["coordination"]["effect"] for p in told if p["coordination"]])
        mismatch = max(p["mismatch"] for p in told if p["mismatch"] is not None)
        given.append(f"| {run}, {care} | {mean(jitter):.2f} | {mean(skate):.2f} | {answer:.2f} | {mismatch:.4f} |")
table = "\n\n".join("\n".join(t) for t in (rows, free, given)) + "\n"
(out / "table.md").write_text(table)
print((out / "floors.txt").read_text(), table, sep="\n")
PYTHON
