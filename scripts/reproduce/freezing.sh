#!/bin/sh
# Whether dances freeze, greedy and drawn, the more is given the less (docs/measures.md, "Freezing"): 30 s dances that begin with
# the first second of each prompt and follow none of it, the root, the root and the right arm, the root and the legs.
#
#     scripts/reproduce/freezing.sh RUN CORPUS OUT PROMPT..        prompts of 30 s or more; OPTIONS="--fps-source 60" reads them
#
# Variables: DRAWS, drawn dances a prompt (4); KINELM, OPTIONS. What is there is not made again.
set -eu
call="the call is: $0 RUN CORPUS OUT PROMPT.."
run=${1:?$call} corpus=${2:?$call} out=${3:?$call}
shift 3
here=$(cd "$(dirname "$0")/../.." && pwd)
kinelm=${KINELM:-$here/target/release/kinelm}
mkdir -p "$out"
for joints in none root root,right_arm root,legs; do
    for draw in greedy drawn; do
        name=${joints}_$draw
        [ ! -e "$out/$name.json" ] || continue
        mkdir -p "$out/$name"
        follow="--joints $joints" how="--variations ${DRAWS:-4}"
        [ $joints != none ] || follow=""
        [ $draw != greedy ] || how=--greedy
        for prompt in "$@"; do
            "$kinelm" generate --run "$run" --fps 20 --prompt "$prompt" ${OPTIONS:-} --from-frame 20 --frames 600 $follow $how \
                --out "$out/$name/$(basename "${prompt%.*}").bvh" --quiet
        done
        "$kinelm" evaluate dance "$out/$name"/*.bvh --real "$corpus" --copying --json --quiet > "$out/$name.new"
        mv "$out/$name.new" "$out/$name.json"
    done
done
python3 - "$out" <<'PYTHON'
import json, sys
from pathlib import Path

rows = ["| prompt | draw | dances | freeze % (sd) | pose % | median s to freeze | never % | repeats % | answer | copies % |", "|---|---|---|---|---|---|---|---|---|---|"]


def row(joints, draw, group, found):
    world = group["world"]
    freeze = world["median_time_to_freeze_s"]
    effects = [p["coordination"]["effect"] for _, p in found["prompted"] or [] if p.get("coordination")]
    answer = f"{sum(effects) / len(effects):.3f}" if effects and group["name"] == "dances" else ""
    copied = found["copied"]["copy_rate"] if found.get("copied") and group["name"] == "dances" else None
    rows.append(
        f"| {joints} | {draw} | {world['dances']} | {100 * world['freeze_rate']:.2f} ({100 * world['freeze_rate_sd']:.2f}) | "
        f"{100 * group['pose']['freeze_rate']:.2f} | {'over' if freeze is None else round(freeze, 1)} | {100 * world['never']:.0f} | "
        f"{100 * group['repeat_rate']:.2f} | {answer} | {'' if copied is None else format(100 * copied, '.1f')} |"
    )


for joints in ["none", "root", "root,right_arm", "root,legs"]:
    for draw in ["greedy", "drawn"]:
        found = json.loads((Path(sys.argv[1]) / f"{joints}_{draw}.json").read_text())
        groups = {g["name"]: g for g in found["groups"]}
        if len(rows) == 2:
            for name in ["train", "valid"]:
                row("real", name, groups[name], found)
        row(joints, draw, groups["dances"], found)
table = "\n".join(rows) + "\n"
(Path(sys.argv[1]) / "table.md").write_text(table)
print(table)
PYTHON
