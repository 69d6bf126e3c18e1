#!/bin/sh
# Everything a change must pass before it lands: form, lints, tests, documentation.   usage: scripts/check.sh
set -eu
cd "$(dirname "$0")/.."
cargo fmt --all --check
cargo clippy --release --workspace --all-targets --locked -- -D warnings
cargo test --release --workspace --locked
RUSTDOCFLAGS="-D warnings" cargo doc --release --workspace --no-deps --locked
