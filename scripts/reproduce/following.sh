#!/bin/sh
# The tables of docs/results/music.md, "Following": whether dances of models that are told music keep to it. Made-up dances and
# music; 48 dances of 30 s to pieces of tempi that no model has heard, the same against other music and half a beat off, 48 that
# are told nothing; and 90 dances that begin with a second of 30 others and go on at three tempi.
#
#     scripts/reproduce/following.sh OUT
#
# What is there is not made again. Variables: PIECES (a folder of music of another kind, such as scripts/reproduce/music-lstm.sh
# renders: a dance to 30 s of each), TOLD ("beats features both"), SEED of the demo and its models (1), GUIDANCE (as generate
# has it: 3 where beats are told, else 2), THREADS (1), KINELM.
set -eu
out=${1:?the call is: $0 OUT}
here=$(cd "$(dirname "$0")/../.." && pwd)
kinelm=${KINELM:-$here/target/release/kinelm}
threads="--threads ${THREADS:-1} --quiet"
seed=${SEED:-1}
mkdir -p "$out/music"
# the demo's corpus, and its model, which is told beats
[ -e "$out/demo/report.md" ] || "$kinelm" demo --music --seed "$seed" --out "$out/demo" --threads "${THREADS:-1}" --force
# 12 pieces, three tempi by four styles
pieces=""
for bpm in 90 110 130; do
    for style in pop march lounge disco; do
        piece=$out/music/$style-$bpm.wav
        [ -e "$piece" ] || "$kinelm" music render --bpm $bpm --seconds 30.5 --style $style --seed 7 --out "$piece" --quiet
        pieces="$pieces $piece"
    done
done

# NAME RUN OPTIONS.. : four dances to each piece
danced() {
    name=$1 run=$2
    shift 2
    mkdir -p "$out/$name"
    for piece in $pieces; do
        dance=$out/$name/$(basename "$piece" .wav)
        # the fourth is written last
        [ -e "$dance-4.bvh" ] || "$kinelm" generate --run "$run" --fps 20 --seconds 30 --lead-in none --top-p 0.9 --variations 4 --out "$dance.bvh" --force \
            $([ "$name" = none ] || echo --music "$piece") --seed "$(basename "$piece" .wav | cksum | cut -c1-4)" "$@" $threads
    done
}

# NAME OPTIONS.. : how they keep to it
measured() {
    name=$1
    shift
    [ -e "$out/$name.json" ] || {
        "$kinelm" evaluate dance "$out/$name"/*.bvh --real "$out/demo/corpus" --json "$@" $threads > "$out/$name.new"
        mv "$out/$name.new" "$out/$name.json"
    }
}

for told in ${TOLD:-beats features both}; do
    run=$out/demo/run
    if [ "$told" != beats ]; then
        run=$out/run-$told
        sed "s/music = \"beats\"/music = \"$told\"/" "$here/configs/train/demo-music.toml" > "$out/$told.toml"
        [ -e "$run/best" ] || {
            rm -rf "$run"
            "$kinelm" pretrain --config "$out/$told.toml" --corpus "$out/demo/corpus" --run "$run" --seed "$seed" $threads
        }
    fi
    for conditions in labels none; do
        bits=$out/bits-$told-$conditions.json
        [ -e "$bits" ] || {
            "$kinelm" evaluate likelihood --run "$run" --corpus "$out/demo/corpus" --json \
                $([ $conditions = labels ] || echo --conditions none) $threads > "$bits.new"
            mv "$bits.new" "$bits"
        }
    done
    danced "$told" "$run" ${GUIDANCE:+--guidance $GUIDANCE}
    measured "$told"
    [ -n "${PIECES:-}" ] || continue
    mkdir -p "$out/$told-pieces"
    number=0
    for piece in "$PIECES"/*.wav; do
        number=$((number + 1))
        dance=$out/$told-pieces/$(basename "$piece" .wav).bvh
        # what ends before, or has no beats, is left out
        [ -e "$dance" ] || "$kinelm" generate --run "$run" --fps 20 --seconds 30 --lead-in none --top-p 0.9 --music "$piece" --music-from 10s \
            ${GUIDANCE:+--guidance $GUIDANCE} --seed $number --out "$dance" $threads || continue
    done
    measured "$told-pieces"
done
danced none "$out/demo/run"
# the last three takes: 12 dances of test, 12 of valid, and the six last of train
prompts=$(find "$out/demo/motion" -name '*_0[567].bvh' | sed 's/.*_0\(.\)\.bvh/\1 &/' | sort -r | head -30 | cut -d' ' -f2)
mkdir -p "$out/transfer"
number=0
for prompt in $prompts; do
    number=$((number + 1))
    style=$(echo pop march lounge disco | cut -d' ' -f$((number % 4 + 1)))
    for bpm in 90 110 130; do
        dance=$out/transfer/$(basename "$prompt" .bvh)-$bpm.bvh
        [ -e "$dance" ] || "$kinelm" generate --run "$out/demo/run" --fps 20 --prompt "$prompt" --from-frame 20 --seconds 30 --top-p 0.9 \
            --music "$out/music/$style-$bpm.wav" ${GUIDANCE:+--guidance $GUIDANCE} --rig model --seed $number --out "$dance" $threads
    done
done
measured transfer
# against the pieces that they weren't told of, in the order of their names
each=""
for dance in "$out"/none/*.bvh; do
    each="$each --music $out/music/$(basename "$dance" | sed 's/-[1-4]\.bvh$//').wav"
done
measured none $each
python3 "$here/scripts/reproduce/following.py" "$out"
