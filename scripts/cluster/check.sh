#!/bin/sh
# Does training with PyTorch on two processes do what kinelm does? For each form of the model: both train ten steps from one
# beginning, by the order that `kinelm corpus order` writes; losses and validation are compared, the result is taken back
# with `kinelm import`, measured, made to dance and trained on.
#
#   [KINELM=PROGRAM] [PYTHON=PROGRAM] scripts/cluster/check.sh [OUT]        OUT: a folder to make, target/cluster-check
#
# Needs no data and no network but what pip fetches where PYTHON (3.11, with requirements.txt) isn't given.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
kinelm=${KINELM:-$root/target/release/kinelm}
out=${1:-$root/target/cluster-check}
fail() { echo "check.sh: $*" >&2; exit 1; }
[ -x "$kinelm" ] || fail "$kinelm is not there; build it with cargo build --release, or name it by KINELM"
[ ! -e "$out" ] || fail "$out exists; give another folder"
mkdir -p "$out"
out=$(cd "$out" && pwd)
if [ -z "${PYTHON:-}" ]; then
    python3 -m venv "$out/venv"
    "$out/venv/bin/pip" install --quiet -r "$here/requirements.txt"
    PYTHON=$out/venv/bin/python
fi
export OMP_NUM_THREADS=1
kinelm() { "$kinelm" "$@" --quiet || fail "kinelm $* failed"; }

kinelm demo --steps 0 --out "$out/demo" > "$out/demo.md"
kinelm demo --steps 0 --seed 2 --out "$out/other" > "$out/other.md"
kinelm tokenize "$out/other/motion" --labels "$out/other/labels.csv" --tokenizer "$out/demo/tokenizer.json" --out "$out/second"
kinelm tokenizer fit "$out/demo/motion" --labels "$out/demo/labels.csv" \
    --config "$root/configs/tokenizer/lapped.toml" --out "$out/lapped.json"
kinelm tokenize "$out/demo/motion" --labels "$out/demo/labels.csv" --tokenizer "$out/lapped.json" --out "$out/lapped"

# name, corpora; keys of [model] and of [train] over the smallest ones; the window's key
form() {
    name=$1 corpus=$2 at=$out/$1
    mkdir "$at"
    {
        printf '[model]\nlayers = 2\nheads = 2\nwidth = 64\n%s\n%b\n' "${5:-context = 300}" "$3"
        printf '[train]\nbatch = 6\nsteps = 10\nwarmup = 3\nlearning_rate = 2e-3\neval_every = 5\neval_windows = 64\n%b\n' "$4"
    } > "$at/config.toml"
    begin="--config $at/config.toml --corpus $corpus"
    kinelm pretrain $begin --run "$at/begin" --steps 0
    kinelm export --run "$at/begin" --format kinelm --out "$at/first"
    kinelm pretrain $begin --from "$at/first" --run "$at/run"
    # their order by kinelm, which has none of windows that grow, and with the same seed by themselves
    order="--out $at/two"
    case $4 in
        *train.stages*) ;;
        *)
            kinelm corpus order $begin --steps 10 --out "$at/order.npz"
            order="--order $at/order.npz $order"
            ;;
    esac
    for order in "$order" "--out $at/own --fresh"; do
        "$PYTHON" -m torch.distributed.run --nproc-per-node 2 --rdzv-backend c10d --rdzv-endpoint localhost:0 \
            "$here/train.py" $begin --from "$at/first" $order --device cpu > "$at/log" 2>&1 || { cat "$at/log"; fail "$name"; }
    done
    for run in two own; do
        found=$("$PYTHON" "$here/compare.py" "$at/run" "$at/$run") || fail "$name, $run: $found"
        echo "$name, $run: $found"
    done
    kinelm import "$at/two" --run "$at/taken"
    measure "$at/run" > "$at/run.bits"
    measure "$at/taken" > "$at/taken.bits"
    apart "$at/run.bits" "$at/taken.bits" || fail "$name: after import $(cat "$at/taken.bits") bits/frame, before $(cat "$at/run.bits")"
    echo "$name: $(cat "$at/taken.bits") bits/frame on validation clips, kinelm's own $(cat "$at/run.bits")"
    kinelm pretrain $begin --from "$at/two" --run "$at/on" --steps 2
}
measure() {
    kinelm evaluate likelihood --run "$1" --corpus "${corpus%%[= ]*}" --split valid --windows 200 --json > "$at/likelihood.json"
    "$PYTHON" -c 'import json, sys; print(json.load(sys.stdin)["bits_per_frame"])' < "$at/likelihood.json"
}
apart() { awk 'NR == FNR { a = $1; next } { d = a - $1; exit !(a > 0 && d < 1e-3 && d > -1e-3) }' "$1" "$2"; }
dances() {
    kinelm generate --run "$out/$1/taken" --frames 40 --out "$out/$1/dance.bvh"
    [ -s "$out/$1/dance.bvh" ] || fail "$1: no dance"
}

form ours "$out/demo/corpus" '' ''
dances ours
form thesis "$out/demo/corpus" 'positions = "absolute"\nprevious_frame = false\nhead = "absolute"' ''
dances thesis
form masked "$out/demo/corpus" 'kind = "masked"\npositions = "frame_joint"' ''
form labels "$out/demo/corpus" 'positions = "rope"\ntied_head = false' \
    'conditions = ["dancer", "genre"]\nlabel_dropout = 0.3\nloss = "ordinal"\naccumulate = 2\nema = 0.9'
dances labels
form corpora "$out/demo/corpus=0.7 --corpus $out/second=1.5" '' ''
form varying "$out/lapped" 'positions = "frame_joint"' ''
dances varying

levels='architecture = "two_level"\n[model.decoder]\nlayers = 2\nheads = 2\nwidth = 32\ncharacter_width = 6'
form levels "$out/demo/corpus" "$levels" 'table_rate = 3.0' 'window = 7'
dances levels
form grows "$out/demo/corpus=0.7 --corpus $out/second=1.5" "$levels" \
    'conditions = ["dancer", "genre"]\nema = 0.9\naccumulate = 2\n[[train.stages]]\nuntil = 0.45\nframes = 3\nbatch = 5' 'window = 7'
dances grows

# GPT-2's folder, as train.py writes it and as kinelm does
name=gpt2 at=$out/gpt2 corpus=$out/demo/corpus
mkdir "$at"
"$PYTHON" "$here/train.py" --config "$out/thesis/config.toml" --corpus "$corpus" --from "$out/thesis/first" \
    --out "$at/one" --hf "$at/hf" --device cpu > "$at/log" 2>&1 || { cat "$at/log"; fail "$name"; }
kinelm import "$at/hf" --run "$at/taken"
measure "$at/taken" > "$at/taken.bits"
apart "$out/thesis/run.bits" "$at/taken.bits" || fail "gpt2: $(cat "$at/taken.bits") bits/frame, kinelm's own $(cat "$out/thesis/run.bits")"
"$PYTHON" "$root/scripts/reference/hf_round_trip.py" "$kinelm" "$at/taken" "$corpus" || fail "the GPT-2 folder differs"
echo "check.sh: all the same"
