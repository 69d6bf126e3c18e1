#!/bin/sh
# Instructions of each kernel and of commands, counted by valgrind's callgrind: the same on a busy machine, so a
# regression shows.
#
#   scripts/bench/instructions.sh            compares with instructions.txt beside this file; exit code 1 beyond 2 %
#   scripts/bench/instructions.sh --record   writes that file
#
# Needs valgrind (Debian: apt-get install valgrind). It runs AVX2 and knows no AVX-512: counts are of the AVX2 kernels,
# also where the CPU has more. They depend on the compiler, which the file names; fewer instructions are not always less
# time, so measure what you change (cargo bench -p kinelm-engine --bench kernels). Of a command those of the crate sha2
# are left out: valgrind knows no SHA instructions, so that it hashes in software. Commands need cmu-dance, which the
# tests unpack (target/shared-data); without it their rows are left out too.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
cd "$here/../.."
table=$here/instructions.txt
command -v valgrind >/dev/null || { echo "instructions.sh: valgrind is not installed" >&2; exit 2; }
# incremental builds are cut into more pieces, which inline less
bench=$(CARGO_INCREMENTAL=0 cargo bench -q -p kinelm-engine --bench kernels --no-run --message-format=json --locked |
    sed -n 's/.*"executable":"\([^"]*kernels[^"]*\)".*/\1/p')
kinelm=$(CARGO_INCREMENTAL=0 cargo build -q --release --bin kinelm --message-format=json --locked |
    sed -n 's/.*"executable":"\([^"]*kinelm\)".*/\1/p')
salsa=target/shared-data/cmu-dance/salsa/03.bvh
export KINELM_KERNELS=avx2
found=$(mktemp)
trap 'rm -rf "$found" "$found.log" "$found.calls" "$found.dir"' EXIT

count() {
    valgrind --tool=callgrind --callgrind-out-file=/dev/null --toggle-collect='kernels::counted*' \
        "$bench" --count "$1" >/dev/null 2>"$found.log" || { cat "$found.log" >&2; exit 2; }
    sed -n 's/.*Collected : \([0-9]*\).*/\1/p' "$found.log"
}

count_command() {
    mkdir -p "$found.dir"
    # once before, so that the ready model lies in the cache
    for program in "$kinelm" "valgrind --tool=callgrind --callgrind-out-file=$found.calls $kinelm"; do
        XDG_CACHE_HOME="$found.dir" $program "$@" --out "$found.dir/out" --force --threads 1 -q 2>"$found.log" ||
            { cat "$found.log" >&2; exit 2; }
    done
    callgrind_annotate --threshold=100 "$found.calls" | awk '
        { n = $1; gsub(",", "", n) }
        /PROGRAM TOTALS/ { all = n }
        /sha2::/ { hashing += n }
        END { print all - hashing }'
}

{
    echo "# instructions of a run, $("$bench" --names | sed -n 's/^# //p'), $(rustc --version | cut -d' ' -f1,2)"
    for name in $("$bench" --names | grep -v '^#'); do
        printf '%-24s %12d\n' "$name" "$(count "$name")"
    done
    if [ -e "$salsa" ]; then
        printf '%-24s %12d\n' tokenize "$(count_command tokenize "$salsa" --tokenizer ready)"
    fi
} | tee /dev/stderr >"$found"

if [ "${1:-}" = --record ]; then
    cp "$found" "$table"
    exit
fi
awk -v limit=2 '
    FNR == NR { if (/^#/) said = $0; else before[$1] = $2; next }
    /^#/ { if ($0 != said) print "# recorded with another compiler or other kernels: " said; print; next }
    !($1 in before) { printf "%-24s %12d  new: record it\n", $1, $2; next }
    {
        change = 100 * ($2 / before[$1] - 1); delete before[$1]
        much = change > limit
        printf "%-24s %12d %+7.2f %%%s\n", $1, $2, change, much ? "  MORE" : ""
        worse += much
    }
    END {
        for (name in before) {
            if (name == "tokenize") { print name " is not counted: no motion data"; continue }
            printf "%-24s is gone: record again\n", name; worse++
        }
        exit worse > 0
    }' "$table" "$found"
