#!/bin/sh
# What can be checked of a build with CUDA where there is no card: that it links with the CUDA libraries, and that a card
# that isn't there is a readable error.   usage: scripts/cuda/check.sh [FOLDER OF build.sh --dir]
set -eu
cd "$(dirname "$0")/../.."
dir=$(cd "${1:-target/cuda}" && pwd)
binary=$PWD/target/cuda-build/release/kinelm
root=$(echo "$dir"/venv/lib/python3*/site-packages/nvidia/cu13)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
fail() { echo "check.sh: $*" >&2 && exit 1; }

[ -x "$binary" ] || fail "no $binary; run scripts/cuda/build.sh first"
needed=$(readelf -d "$binary" | sed -nE 's/.*NEEDED.*\[(.*)\]/\1/p')
for lib in libcuda.so.1 libcudart.so.13 libcublas.so.13 libcurand.so.10; do
    echo "$needed" | grep -qxF "$lib" || fail "$binary doesn't link with $lib; found: $(echo $needed)"
done
export LD_LIBRARY_PATH="$root/lib:$dir/stub"
missing=$(ldd "$binary" | grep 'not found' || true)
[ -z "$missing" ] || fail "libraries that are not there: $missing"

# the stub stands for a machine without a driver
cd "$work"
"$binary" --version >version || fail "it doesn't start"
if "$binary" demo --device cuda:0 >out 2>err; then fail "a card was found behind the stub"; fi
grep -q '^kinelm: device cuda:0: .*stub' err || fail "expected an error that names the device; found: $(cat err)"
grep -q 'nvidia-smi' err || fail "expected an error that says what to look at; found: $(cat err)"
[ "$(wc -l <err)" = 1 ] || fail "expected an error of one line; found: $(cat err)"
[ ! -e demo ] || fail "files were written before the device was opened"
echo "check.sh: $(cat version), $(stat -c %s "$binary") bytes, links with $(echo $needed)"
echo "check.sh: without a card: $(head -n 1 err)"
