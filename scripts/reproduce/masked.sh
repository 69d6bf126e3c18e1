#!/bin/sh
# A causal and two masked models of one size and CPU time, and how they fill gaps of cmu-dance's test clips
# (docs/results/gaps.md, "Masked and causal").
#
#     scripts/reproduce/masked.sh DATA SPLITS OUT
#
# DATA and SPLITS as ../shared/data/unpack.sh leaves them. What is there is not made again, and training that was stopped goes
# on. Variables: KINDS ("causal tokens spans"), CAUSAL (1000) and MASKED (800) steps, FRAMES ("5 10"), PASSES ("1 8"),
# GAPS (40), SAMPLES (5), KINELM.
set -eu
call="the call is: $0 DATA SPLITS OUT"
data=$(realpath "${1:?$call}")/cmu-dance labels=$(realpath "${2:?$call}")/cmu-dance.csv out=${3:?$call}
here=$(cd "$(dirname "$0")/../.." && pwd)
kinelm=${KINELM:-$here/target/release/kinelm}
mkdir -p "$out"
cd "$out"

read="--labels $labels --skip 10"
[ -e tokenizer.json ] || "$kinelm" tokenizer fit "$data" $read --joints 13 --fps 20 --out tokenizer.json --quiet
[ -e corpus/corpus.json ] || "$kinelm" tokenize "$data" $read --tokenizer tokenizer.json --out corpus --quiet

configuration() { # NAME KIND STEPS MASKING
    cat > "$1.toml" << END
[model]
kind = "$2"
layers = 4
heads = 4
width = 128
context = 1024   # 23 frames
positions = "rope"
dropout = 0.1
[train]
batch = 4
steps = $3
learning_rate = 2e-3
warmup = 50
eval_every = 0
checkpoint_every = 100
masking = "$4"
[augment]
mirror = 0.5
speed = 0.1
END
}

measured() { # NAME FRAMES OPTIONS..
    name=$1 frames=$2
    shift 2
    result=$name-$frames$(echo "$*" | tr -d ' ').json
    [ -e "$result" ] && return
    "$kinelm" evaluate gaps --run "run-$name" --corpus corpus --frames "$frames" --gaps "${GAPS:-40}" \
        --samples "${SAMPLES:-5}" "$@" --json --quiet > "$result.new"
    mv "$result.new" "$result"
}

for name in ${KINDS:-causal tokens spans}; do
    case $name in
    causal) configuration causal causal "${CAUSAL:-1000}" tokens ;;
    *) configuration "$name" masked "${MASKED:-800}" "$name" ;;
    esac
    if [ -e "run-$name/latest" ]; then
        [ -e "$name.done" ] || "$kinelm" pretrain resume "run-$name" --threads 1 --quiet
    else
        "$kinelm" pretrain --config "$name.toml" --corpus corpus --run "run-$name" --threads 1 --precision bf16 --quiet
    fi
    touch "$name.done"
    for frames in ${FRAMES:-5 10}; do
        case $name in
        causal) measured causal "$frames" ;;
        *) for passes in ${PASSES:-1 8}; do measured "$name" "$frames" --passes "$passes"; done ;;
        esac
    done
done
case " ${KINDS:-spans} " in *" spans "*) measured spans 10 --passes 8 --top-p 0.7 ;; esac
