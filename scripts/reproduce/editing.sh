#!/bin/sh
# The pictures of docs/editing.md: a model of cmu-dance alone, a gap, an arm, a loop, a plan of three clips, and a dance with
# its feet held and not.
#
#     scripts/reproduce/editing.sh DATA SPLITS OUT
#
# DATA and SPLITS as ../shared/data/unpack.sh leaves them. What is there is not made again, and training that was stopped goes
# on. Variables: PRECISION (f32), THREADS (2), KINELM, PYTHON (python3, with pillow).
set -eu
call="the call is: $0 DATA SPLITS OUT"
data=$(realpath "${1:?$call}")/cmu-dance labels=$(realpath "${2:?$call}")/cmu-dance.csv out=${3:?$call}
here=$(cd "$(dirname "$0")/../.." && pwd)
kinelm=${KINELM:-$here/target/release/kinelm}
how="--precision ${PRECISION:-f32} --threads ${THREADS:-2}"
mkdir -p "$out"
cd "$out"

train() { # RUN, then how it begins
    run=$1
    shift
    if [ -e "$run.done" ]; then return; fi
    if [ -e "$run/latest" ]; then
        "$kinelm" "$1" resume "$run" --threads "${THREADS:-2}"
    else
        "$kinelm" "$@" --corpus corpus --run "$run" $how
    fi
    touch "$run.done"
}
[ -e tokenizer.json ] || "$kinelm" tokenizer fit "$data" --labels "$labels" --out tokenizer.json
[ -e corpus/corpus.json ] || "$kinelm" tokenize "$data" --labels "$labels" --tokenizer tokenizer.json --out corpus
train run pretrain --config two-level
train run-goal finetune --from run --config ahead

read="--fps-source 60 --skip 10"
make() { # NAME, what is asked for
    name=$1
    shift
    [ -e "$name.bvh" ] || "$kinelm" generate "$@" --run run-goal --out "$name.bvh"
}
clip=$data/salsa/03.bvh
make middle --prompt "$clip" $read --free all@4s:6s
make arm --prompt "$clip" $read --free left_arm@4s:8s
make loop --prompt "$clip" $read --loop
for feet in lock off; do
    make $feet --prompt "$clip" $read --joints root,right_arm --rig prompt --seconds 12 --feet $feet
done
[ -e three.toml ] || {
    echo 'rig = "first"'
    for of in first:03 second:11 third:22; do
        printf '[clips.%s]\nfile = "%s/salsa/%s.bvh"\nfps_source = 60\nskip = 10\n' "${of%:*}" "$data" "${of#*:}"
    done
    for of in "first 0 3 2" "second 5 8 5" "third 10 13 12"; do
        set -- $of
        printf '[[segment]]\nclip = "%s"\nfrom = %s\nto = %s\nat = %s\n' "$@"
    done
} > three.toml
make three timeline three.toml

picture() { # NAME, the clips, what is new and when
    name=$1 clips=$2
    shift 2
    [ -e "$name.html" ] || "$kinelm" view $clips --out "$name.html"
    [ -e "editing-$name.png" ] || "${PYTHON:-python3}" "$here/scripts/strip.py" "$name.html" "editing-$name.png" "$@"
}
of=$clip:fps=60,skip=10
picture middle "$of middle.bvh" --new 4:6 3.8 4.3 4.6 5 5.4 6.2
picture arm "$of arm.bvh" --new 4:8 3.8 4.6 5.4 6.2 7 8.2
picture loop "$of loop.bvh" --new 28.35:30.35 28 28.6 29.2 29.6 30 30.3
picture three three.bvh --new 3:5 --new 8:10 2.5 3.5 4 4.5 5.5 7.5 8.5 9 9.5 10 11 12
picture feet "off.bvh lock.bvh" 2 3 4 5 6 7
