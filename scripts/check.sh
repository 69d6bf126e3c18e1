#!/bin/sh
# Everything a change must pass before it lands: form, lints, tests, documentation, packages.   usage: scripts/check.sh
# Needs cargo-deny: cargo install cargo-deny --locked
set -eu
cd "$(dirname "$0")/.."
scripts/module_graph.py --check
scripts/compiled_once.py
cargo fmt --all --check
cargo clippy --release --workspace --all-targets --locked -- -D warnings
cargo test --release --workspace --locked
cargo test --profile checked --locked --test fuzz
cargo build --release --workspace --locked
scripts/python.sh
scripts/studio.sh
RUSTDOCFLAGS="-D warnings" cargo doc --release --workspace --no-deps --locked
cargo deny --locked check bans licenses sources
cargo package --workspace --locked
# the oldest and the newest of Hugging Face's tokenizers; installs them once
scripts/tokenizers/check.sh target/tokenizers
# Blender 4.2, 4.5 and 5.0 and three.js read what is written; installs them once
scripts/importers/check.sh target/importers crates/motion/tests/golden/blender_dance_y_up.bvh
