#!/bin/sh
# Instructions of each kernel, counted by valgrind's callgrind: the same on a busy machine, so a regression shows.
#
#   scripts/bench/instructions.sh            compares with instructions.txt beside this file; exit code 1 beyond 2 %
#   scripts/bench/instructions.sh --record   writes that file
#
# Needs valgrind (Debian: apt-get install valgrind). It runs AVX2 and knows no AVX-512: counts are of the AVX2 kernels,
# also where the CPU has more. They depend on the compiler, which the file names; fewer instructions are not always less
# time, so measure what you change (cargo bench -p kinelm-engine --bench kernels).
set -eu
here=$(cd "$(dirname "$0")" && pwd)
cd "$here/../.."
table=$here/instructions.txt
command -v valgrind >/dev/null || { echo "instructions.sh: valgrind is not installed" >&2; exit 2; }
# incremental builds are cut into more pieces, which inline less
bench=$(CARGO_INCREMENTAL=0 cargo bench -q -p kinelm-engine --bench kernels --no-run --message-format=json --locked |
    sed -n 's/.*"executable":"\([^"]*kernels[^"]*\)".*/\1/p')
export KINELM_KERNELS=avx2
found=$(mktemp)
trap 'rm -f "$found" "$found.log"' EXIT

count() {
    valgrind --tool=callgrind --callgrind-out-file=/dev/null --toggle-collect='kernels::counted*' \
        "$bench" --count "$1" >/dev/null 2>"$found.log" || { cat "$found.log" >&2; exit 2; }
    sed -n 's/.*Collected : \([0-9]*\).*/\1/p' "$found.log"
}

{
    echo "# instructions of a run, $("$bench" --names | sed -n 's/^# //p'), $(rustc --version | cut -d' ' -f1,2)"
    for name in $("$bench" --names | grep -v '^#'); do
        printf '%-24s %12d\n' "$name" "$(count "$name")"
    done
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
        for (name in before) { printf "%-24s is gone: record again\n", name; worse++ }
        exit worse > 0
    }' "$table" "$found"
