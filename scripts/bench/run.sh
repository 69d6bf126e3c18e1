#!/bin/sh
# kinelm against PyTorch on this machine, in turn: builds kinelm, installs PyTorch into a throw-away environment, measures,
# prints a table in Markdown and says whether the machine was quiet.
#
#   scripts/bench/run.sh [--only train|bf16|decode|lstm] [--rounds 5] [--quick] [--threads N] [--json FILE]
#   scripts/bench/run.sh --torch PYTHON ..     an interpreter that has PyTorch already: nothing is installed
#   scripts/bench/run.sh --no-torch ..         kinelm alone
#
# Needs Rust, Python 3.11 with venv, a C++ compiler for the torch.compile rows, and 8 GB in the folder for temporary files
# where only PyPI's PyTorch can be had, which brings its CUDA libraries along.
set -eu
for argument in "$@"; do
    case $argument in -h | --help) sed -n '2,/^[^#]/s/^# \{0,1\}//p' "$0"; exit ;; esac
done
cd "$(dirname "$0")/../.."
version=2.15.0
python=
alone=
for argument in "$@"; do
    case $argument in
    --torch) python=next ;;
    --torch=*) python=${argument#--torch=} ;;
    --no-torch) alone=yes ;;
    *) [ "$python" != next ] || python=$argument ;;
    esac
done
[ "$python" != next ] || { echo "run.sh: --torch: expected an interpreter behind it" >&2; exit 2; }

cargo build --release --locked --quiet -p kinelm-lab
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
trap 'exit 130' INT TERM
export TORCHINDUCTOR_CACHE_DIR="$folder/compiled"
if [ -z "$python" ] && [ -z "$alone" ]; then
    echo "run.sh: installing PyTorch $version into $folder" >&2
    python3 -m venv "$folder/env"
    python=$folder/env/bin/python
    # PyPI's build brings CUDA along; an index with the build without it can be named in PIP_INDEX_URL
    "$python" -m pip install --quiet --no-cache-dir "torch==$version"
fi
"${python:-python3}" scripts/bench/compare.py "$@"
