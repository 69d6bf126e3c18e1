#!/bin/sh
# Whether a label changes the dance (docs/measures.md): free dances, and dances that go on from one prompt under
# every label in turn, named by a linear classifier that was trained on the real train clips alone.
#
#     scripts/reproduce/conditions.sh RUN CORPUS FIELD OUT PROMPT..      RUN was trained with conditions = ["FIELD"]
#
# Variables: GUIDANCE ("1 2 3"), DANCES free ones a label and guidance (8), their LEAD_IN (none, or train), OPTIONS for reading the
# prompts, PYTHON with numpy and scikit-learn, KINELM.
set -eu
call="the call is: $0 RUN CORPUS FIELD OUT PROMPT.."
run=${1:?$call} corpus=${2:?$call} field=${3:?$call} out=${4:?$call}
shift 4
here=$(cd "$(dirname "$0")/../.." && pwd)
kinelm=${KINELM:-$here/target/release/kinelm} python=${PYTHON:-python3}
mkdir -p "$out/dances"
labels=$("$python" -c 'import json, sys
print(*sorted({json.loads(line)["labels"][sys.argv[2]] for line in open(sys.argv[1] + "/clips.jsonl")}))' "$corpus" "$field")
for guidance in ${GUIDANCE:-1 2 3}; do
    for label in $labels; do
        how="--label $field=$label --guidance $guidance --frames 600 --quiet"
        free=$out/dances/$guidance/free/$label on=$out/dances/$guidance/prompted/$label
        if [ ! -d "$free" ]; then
            mkdir -p "$free.new"
            "$kinelm" generate --run "$run" --fps 20 $how --lead-in "${LEAD_IN:-none}" --variations "${DANCES:-8}" --out "$free.new/free.bvh"
            mv "$free.new" "$free"
        fi
        [ ! -d "$on" ] || continue
        mkdir -p "$on.new"
        for prompt in "$@"; do
            "$kinelm" generate --run "$run" --fps 20 $how --prompt "$prompt" ${OPTIONS:-} --from-frame 20 --out "$on.new/$(basename "${prompt%.*}").bvh"
        done
        mv "$on.new" "$on"
    done
done
[ -d "$out/corpus" ] || "$kinelm" tokenize "$out/dances" --tokenizer "$corpus/tokenizer.json" --labels '{guidance}/{kind}/{label}/{take}.bvh' \
    --out "$out/corpus" --quiet
"$python" "$here/scripts/reproduce/conditions.py" "$corpus" "$field" "$out/corpus" | tee "$out/table.md"
