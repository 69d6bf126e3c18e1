# Parts of positions.sh, simplification.sh and pretraining.sh, which set `data`, `splits`, `out` and read this file.
#
# Whatever is done is kept: called again, a script goes on where it stood. Variables, each with its default:
#   CONFIG   training file that the cells change          configs/train/tiny.toml
#   STEPS    steps of every training                      600
#   SEEDS    a training each                              "1 2 3"
#   DROPOUT  of the model                                 0.1
#   KEYS     of the training file in every cell           none, e.g. "augment.mirror=0.5 train.ema=0.999"
#   WINDOWS  of the test clips, spread evenly; 0: all     1000
#   KINELM   the program                                  target/release/kinelm
#   DEVICE   cpu or cuda:0                                cpu

here=$(cd "$(dirname "$0")/../.." && pwd)
kinelm=${KINELM:-$here/target/release/kinelm}
config=${CONFIG:-$here/configs/train/tiny.toml}
steps=${STEPS:-600} seeds=${SEEDS:-1 2 3} device=${DEVICE:-cpu}
fail() { echo "$(basename "$0"): $*" >&2; exit 1; }
[ -x "$kinelm" ] || fail "$kinelm is not there; build it with cargo build --release, or name it by KINELM"
[ -d "$data" ] || fail "$data is not there; unpack the motion with sh ../shared/data/unpack.sh DATA"
mkdir -p "$out/results" "$out/floors" "$out/runs" "$out/corpora"
# as the cells are to stand in the table
: > "$out/cells.txt"

# the words that a set is read with: cmu-dance begins with a rest pose that settles
read_as() { case $1 in cmu-dance) echo --skip 10 ;; esac; }

# NAME OPTIONS.. : a tokenizer; the options name the sets and the settings
tokenizer() {
    name=$1
    shift
    [ -e "$out/corpora/$name.json" ] || "$kinelm" tokenizer fit "$@" --root-rotation absolute --height velocity --out "$out/corpora/$name.json" --quiet
}

# NAME SET TOKENIZER : a corpus, and its static floors
corpus() {
    if [ ! -e "$out/corpora/$1/corpus.json" ]; then
        "$kinelm" tokenize "$data/$2" --labels "$splits/$2.csv" $(read_as "$2") \
            --tokenizer "$out/corpora/$3.json" --out "$out/corpora/$1" --quiet
    fi
    if [ ! -e "$out/floors/$1.json" ]; then
        "$kinelm" evaluate baselines --corpus "$out/corpora/$1" --json > "$out/floors/$1.new"
        mv "$out/floors/$1.new" "$out/floors/$1.json"
    fi
}

# FILE TABLE.KEY=VALUE.. : the training file with these keys
configured() {
    file=$1
    shift
    cp "$config" "$file"
    for pair in "model.dropout=${DROPOUT:-0.1}" ${KEYS:-} "$@"; do
        table=${pair%%.*} rest=${pair#*.}
        awk -v table="[$table]" -v key="${rest%%=*}" -v value="${rest#*=}" '
            /^\[/ { inside = $1 == table }
            inside && $1 == key { next }
            { print }
            $1 == table { print key " = " value; found = 1 }
            END { if (!found) print "\n" table "\n" key " = " value }' "$file" > "$file.new"
        mv "$file.new" "$file"
    done
}

# COMMAND CELL SEED OPTIONS.. : a training of these options, begun or gone on with; COMMAND is pretrain or finetune
training() {
    command=$1 run=$out/runs/$2-$3 seed=$3
    shift 3
    [ ! -e "$run.done" ] || return 0
    if [ -e "$run/config.toml" ]; then
        "$kinelm" pretrain resume "$run" --device "$device" --quiet
    else
        rm -rf "$run"
        "$kinelm" "$command" "$@" --run "$run" --seed "$seed" --steps "$steps" --device "$device" --quiet
    fi
    touch "$run.done"
}

# CELL CORPUS SEED [RUN] : its bits on the test clips
measured() {
    result=$out/results/$1-$3.json
    grep -qxF "$1	$2" "$out/cells.txt" || printf '%s\t%s\n' "$1" "$2" >> "$out/cells.txt"
    [ ! -e "$result" ] || return 0
    "$kinelm" evaluate likelihood --run "${4:-$out/runs/$1-$3}" --corpus "$out/corpora/$2" \
        --windows "${WINDOWS:-1000}" --device "$device" --json --quiet > "$result.new"
    mv "$result.new" "$result"
    bits=$(python3 -c 'import json, sys; print(round(json.load(sys.stdin)["bits_per_frame"], 2))' < "$result")
    echo "$1, seed $3: $bits bits/frame" >&2
}

# TITLE : all of it
table() {
    told="$1, $steps steps of $(basename "$config"), $("$kinelm" --version), $(date +%Y-%m-%d)"
    python3 "$here/scripts/reproduce/table.py" "$out" "$told"
}
