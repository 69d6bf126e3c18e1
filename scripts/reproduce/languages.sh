#!/bin/sh
# Is a shorter text the better language? The same tiny model for the same number of steps on four texts of cmu-dance:
# uniform bins, quantile bins, DCT tiles of principal components, lapped tiles. Prints the bits per second of each on the
# test clips beside the static floors, and makes a minute of each to watch.
#
#     sh ../shared/data/unpack.sh DATA && scripts/reproduce/languages.sh DATA ../shared/data/splits OUT [STEPS]
#
# DATA has the folder cmu-dance; OUT takes everything. With 1000 steps some 20 minutes on two cores.
set -eu
data=$1 splits=$2 out=$3 steps=${4:-1000}
here=$(cd "$(dirname "$0")/../.." && pwd)
kinelm=${KINELM:-$here/target/release/kinelm}
mkdir -p "$out"

# short texts are read many times over: dropout for all, and the best of many checkpoints
sed -e 's/^dropout = 0.0/dropout = 0.1/' -e 's/^eval_every = 250/eval_every = 50/' "$here/configs/train/tiny.toml" > "$out/tiny.toml"

language() {
    name=$1
    shift
    [ -e "$out/$name/done" ] && return
    rm -rf "$out/$name"
    mkdir -p "$out/$name"
    set -- "$data/cmu-dance" --labels "$splits/cmu-dance.csv" --skip 10 --joints 13 --fps 20 "$@"
    "$kinelm" tokenizer fit "$@" --out "$out/$name/tokenizer.json"
    "$kinelm" tokenize "$data/cmu-dance" --labels "$splits/cmu-dance.csv" --skip 10 \
        --tokenizer "$out/$name/tokenizer.json" --out "$out/$name/corpus"
    "$kinelm" pretrain --config "$out/tiny.toml" --corpus "$out/$name/corpus" --run "$out/$name/run" --steps "$steps"
    "$kinelm" evaluate likelihood --run "$out/$name/run" --corpus "$out/$name/corpus" > "$out/$name/likelihood.txt"
    for clip in salsa/03 indian/13; do
        "$kinelm" generate --run "$out/$name/run" --fps 20 --prompt "$data/cmu-dance/$clip.bvh" --skip 10 --from-frame 60 \
            --frames 1200 --out "$out/$name/$(basename "$clip").bvh"
    done
    touch "$out/$name/done"
}

language uniform --config "$here/configs/tokenizer/uniform.toml" --root-rotation heading_delta --height velocity
language quantile --config "$here/configs/tokenizer/quantile.toml" --root-rotation heading_delta --height velocity
language dct-pca --config "$here/configs/tokenizer/dct-pca.toml" --root-rotation heading_delta --height velocity --set tile=20
language lapped --config "$here/configs/tokenizer/lapped.toml" --root-rotation heading_delta --height absolute

for name in uniform quantile dct-pca lapped; do
    echo "== $name"
    cat "$out/$name/likelihood.txt"
done
