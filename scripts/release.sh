#!/bin/sh
# Builds what a release gives out for Linux on x86-64 with glibc 2.17 or newer: the program with man pages and completions as
# a .tar.xz, the wheel for Python, their sums.   usage: scripts/release.sh OUT
# Needs a checkout without changes, binutils, xz, Python 3.10 or newer, and Rust's target x86_64-unknown-linux-gnu. Other
# tools come from PyPI into target/release-tools.
set -eu

fail() {
    echo "release.sh: $1" >&2
    exit 1
}
# size FILE LIMIT: fails beyond LIMIT megabytes
size() {
    bytes=$(stat -c %s "$1")
    echo "$(basename "$1"): $bytes bytes, at most $2 MB"
    [ "$bytes" -le $(($2 * 1000000)) ] || fail "$(basename "$1") is larger than $2 MB"
}

[ $# = 1 ] || fail "the call is: scripts/release.sh OUT"
out=$(realpath -m "$1")
cd "$(dirname "$0")/.."
[ ! -e "$out" ] || fail "$out exists; give a new folder"
[ -z "$(git status --porcelain)" ] || fail "the checkout has changes; a release is built from a commit"

platform=x86_64-unknown-linux-gnu
glibc=2.17
target=$(realpath -m "${CARGO_TARGET_DIR:-target}")
export CARGO_TARGET_DIR="$target"
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -1)
stage=$target/release-stage
rm -rf "$stage"
mkdir -p "$stage/out"

[ -x "$target/release-tools/bin/python" ] || python3 -m venv "$target/release-tools"
PATH=$target/release-tools/bin:$PATH
python -m pip install --quiet \
    cargo-zigbuild==0.24.1 ziglang==0.17.1 maturin==1.16.0 auditwheel==6.8.2 abi3audit==0.0.26

# the program
cargo zigbuild --profile dist --locked --target "$platform.$glibc" --bin kinelm
cargo zigbuild --profile dist --locked --target "$platform.$glibc" --example man
program=$target/$platform/dist/kinelm
newest=$(objdump -T "$program" | grep -o 'GLIBC_[0-9.]*' | sed 's/GLIBC_//' | sort -Vu | tail -1)
echo "kinelm needs glibc $newest"
[ "$(printf '%s\n' "$newest" "$glibc" | sort -V | tail -1)" = "$glibc" ] ||
    fail "kinelm needs glibc $newest, newer than $glibc"
size "$program" 38
python - "$program" <<'PYTHON'
import statistics, subprocess, sys, time

def once():
    start = time.perf_counter()
    subprocess.run([sys.argv[1], "--version"], check=True, stdout=subprocess.DEVNULL)
    return 1000 * (time.perf_counter() - start)

times = [once() for _ in range(20)]
median = statistics.median(times)
print(f"kinelm --version: {median:.1f} ms, median of 20 ({min(times):.1f} to {max(times):.1f})", flush=True)
sys.exit("release.sh: kinelm --version takes 20 ms or more" if median >= 20 else 0)
PYTHON

# its archive: a tree that is unpacked into ~/.local or /usr/local
name=kinelm-$version-x86_64-linux
tree=$stage/$name
share=$tree/share
mkdir -p "$tree/bin" "$share/doc/kinelm" "$share/bash-completion/completions" "$share/zsh/site-functions" \
    "$share/fish/vendor_completions.d" "$share/elvish/lib" "$share/powershell"
scripts/third_party.py "$platform" > "$stage/LICENSE-THIRD-PARTY"
cp "$program" "$tree/bin/kinelm"
cp README.md LICENSE-MIT LICENSE-APACHE "$stage/LICENSE-THIRD-PARTY" "$share/doc/kinelm/"
"$program" completions bash > "$share/bash-completion/completions/kinelm"
"$program" completions zsh > "$share/zsh/site-functions/_kinelm"
"$program" completions fish > "$share/fish/vendor_completions.d/kinelm.fish"
"$program" completions elvish > "$share/elvish/lib/kinelm.elv"
"$program" completions powershell > "$share/powershell/kinelm.ps1"
"$target/$platform/dist/examples/man" "$share/man/man1"
tar --create --directory "$stage" --sort=name --owner=0 --group=0 --numeric-owner --mtime="@$(git log -1 --format=%ct)" \
    "$name" | xz -9e --threads=1 > "$stage/out/$name.tar.xz"
size "$stage/out/$name.tar.xz" 20

# the wheel, with the same licences in it
licences=bindings/python/LICENSE-THIRD-PARTY
trap 'rm -f "$licences"' EXIT
cp "$stage/LICENSE-THIRD-PARTY" "$licences"
maturin build --profile dist --locked --zig --target "$platform" --compatibility manylinux2014 \
    --manifest-path bindings/python/Cargo.toml --out "$stage/out"
wheel=$(echo "$stage"/out/*.whl)
size "$wheel" 30
auditwheel show "$wheel" > "$stage/auditwheel"
grep -q '"manylinux_2_17_x86_64"' "$stage/auditwheel" || {
    cat "$stage/auditwheel"
    fail "auditwheel finds that the wheel isn't manylinux_2_17_x86_64"
}
echo "auditwheel: manylinux_2_17_x86_64"
abi3audit --strict --report --output "$stage/abi3audit" "$wheel"

(cd "$stage/out" && sha256sum ./* | sed 's# \./# #' > SHA256SUMS && cat SHA256SUMS)
mkdir -p "$(dirname "$out")"
mv "$stage/out" "$out"
