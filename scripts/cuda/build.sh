#!/bin/sh
# A kinelm that also computes on Nvidia cards. Needs no CUDA, driver or card, only Linux on x86-64, gcc, g++, Python 3 with
# venv, and the network: compiler and libraries come from PyPI, of the driver's library a stub is made to link with.
# Done steps are not done again.   usage: scripts/cuda/build.sh [--cap 80|90|..] [--dir FOLDER] [--check]
set -eu
cd "$(dirname "$0")/../.."

cap=90 # compute capability: 90 for H100 and H200 alone; 80 for A100 and whatever came later, translated by its driver
dir=target/cuda
check=
while [ $# -gt 0 ]; do
    case $1 in
    --cap) cap=${2:?--cap needs a number} && shift ;;
    --dir) dir=${2:?--dir needs a folder} && shift ;;
    --check) check=yes ;;
    *) echo "build.sh: found \`$1\`, expected --cap N, --dir FOLDER or --check" >&2 && exit 2 ;;
    esac
    shift
done
say() { echo "build.sh: $*" >&2; }
for tool in gcc g++ python3 cargo; do
    command -v $tool >/dev/null || { say "no $tool; nvcc and this script need it, install it first" && exit 1; }
done
started=$(date +%s)
mkdir -p "$dir"
dir=$(cd "$dir" && pwd)

# 1. compiler and libraries; all of one CUDA version, the wheels of nvcc leave out what they need
packages="nvidia-cuda-nvcc==13.0.* nvidia-nvvm==13.0.* nvidia-cuda-crt==13.0.* nvidia-cuda-cccl==13.0.*
nvidia-cuda-runtime==13.0.* nvidia-cublas==13.0.* nvidia-curand nvidia-cuda-nvrtc==13.0.*"
if [ "$(cat "$dir/packages" 2>/dev/null)" != "$packages" ]; then
    say "CUDA 13.0 from PyPI into $dir/venv"
    python3 -m venv --clear "$dir/venv"
    # one word each
    "$dir/venv/bin/pip" install --quiet --disable-pip-version-check --no-cache-dir $packages
    echo "$packages" >"$dir/packages"
fi
root=$(echo "$dir"/venv/lib/python3*/site-packages/nvidia/cu13)
[ -x "$root/bin/nvcc" ] || { say "no nvcc in $root/bin; remove $dir and try again" && exit 1; }

# 2. the names that the linker looks for
for lib in cublas.so.13 cublasLt.so.13 cudart.so.13 nvrtc.so.13 curand.so.10; do
    [ -e "$root/lib/lib$lib" ] || { say "no lib$lib in $root/lib; remove $dir and try again" && exit 1; }
    ln -sfn "lib$lib" "$root/lib/lib${lib%.so.*}.so"
done
ln -sfn lib "$root/lib64"

# 3. a stub of the driver's library: every function of it that the bindings name, and all of them fail with 34,
# CUDA_ERROR_STUB_LIBRARY. Its folder is for linking and for check.sh; where there is a driver, the driver's is found.
mkdir -p "$dir/stub"
if [ ! -e "$dir/stub/libcuda.so.1" ]; then
    bindings=$(cargo metadata --locked --format-version 1 --features cuda | python3 -c '
import json, os, sys
found = [p for p in json.load(sys.stdin)["packages"] if p["name"] == "cudarc"]
print(os.path.dirname(found[0]["manifest_path"]))')
    {
        echo 'static const char *text = "no driver: this library is a stub to link with";'
        echo 'int cuGetErrorName(int e, const char **s) { (void)e; *s = text; return 0; }'
        echo 'int cuGetErrorString(int e, const char **s) { (void)e; *s = text; return 0; }'
        grep -ohE '\bfn cu[A-Za-z0-9_]+' "$bindings/src/driver/sys/mod.rs" | sort -u | grep -vE 'cuGetError(Name|String)$' |
            sed -E 's/^fn (.*)$/int \1(void) { return 34; }/'
    } >"$dir/stub/cuda.c"
    gcc -shared -fPIC -fno-builtin -Wl,-soname,libcuda.so.1 -o "$dir/stub/libcuda.so" "$dir/stub/cuda.c"
    ln -sfn libcuda.so "$dir/stub/libcuda.so.1"
    say "a stub libcuda.so with $(grep -c '^int' "$dir/stub/cuda.c") functions in $dir/stub"
fi

# 4. the program, in a target folder of its own: the CPU-only build stays as it is
say "kinelm for compute capability $cap; about twenty minutes of processor time the first time"
PATH="$root/bin:$PATH" CUDA_HOME="$root" CUDA_PATH="$root" CUDA_ROOT="$root" CUDA_COMPUTE_CAP="$cap" \
    LIBRARY_PATH="$root/lib:$dir/stub${LIBRARY_PATH:+:$LIBRARY_PATH}" \
    cargo build --release --locked --package kinelm --features cuda --target-dir target/cuda-build
binary=target/cuda-build/release/kinelm
say "$binary: $(($(stat -c %s "$binary") / 1000000)) MB, $(($(date +%s) - started)) s"
say "at run time it needs libcuda.so.1 of a driver for CUDA 13 (580 or later) and the libraries in $root/lib:"
say "  LD_LIBRARY_PATH=$root/lib $binary pretrain --device cuda:0 .."
[ -z "$check" ] || exec scripts/cuda/check.sh "$dir"
