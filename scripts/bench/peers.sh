#!/bin/sh
# kinelm beside the programs that do a part of it, in turn, and their ratios as a table in Markdown:
#
#   scripts/bench/peers.sh FILE.bvh [--only read,encode,search,train,decode] [--windows 1000000] [--rounds 3] [--threads 1]
#
# One thread is measured by the processor's time: clock.c gives the process's clock as the monotonic one, so that a busy machine
# measures too. Two threads are measured by the wall, on an idle machine. Needs Rust, a C compiler, Python 3.11 with venv, Node 20
# and 16 GB of memory for a million windows. Everything is pinned and installed into PEERS (default: a throw-away folder).
set -eu
case ${1:-} in "" | -h | --help) sed -n '2,/^[^#]/s/^# \{0,1\}//p' "$0"; exit ;; esac
cd "$(dirname "$0")/../.."
file=$(realpath "$1")
shift
folder=${PEERS:-$(mktemp -d)}
[ -n "${PEERS:-}" ] || trap 'rm -rf "$folder"' EXIT
trap 'exit 130' INT TERM
mkdir -p "$folder"
if [ ! -x "$folder/env/bin/python" ]; then
    python3 -m venv "$folder/env"
    "$folder/env/bin/pip" install --quiet numpy==2.4.6 scipy==1.17.1 scikit-learn==1.9.1 pybvh==0.9.0 bvhio==1.5.4 usearch==2.26.6 \
        faiss-cpu==1.15.1 gguf==0.19.0 torch==2.15.0
    npm install --silent --prefix "$folder/llama" node-llama-cpp@3.22.0 >/dev/null
fi
cc -O2 -shared -fPIC -o "$folder/clock.so" scripts/bench/clock.c -ldl
cargo build --release --locked --quiet -p kinelm-lab -p kinelm-python
mkdir -p "$folder/kinelm"
cp bindings/python/kinelm/*.py "$folder/kinelm/"
cp target/release/lib_kinelm.so "$folder/kinelm/_kinelm.abi3.so"
PYTHONPATH=$folder exec "$folder/env/bin/python" scripts/bench/peers.py "$file" --folder "$folder" "$@"
