#!/bin/sh
# The studio in a headless browser, as a person would use it, and the types of its page. Needs Chromium and the program that
# `cargo build --release` left; node and npm, with which it gets playwright-core and tsc.   usage: scripts/studio.sh
set -eu
cd "$(dirname "$0")/.."
KINELM=$(realpath "${CARGO_TARGET_DIR:-target}/release/kinelm")
export KINELM
cd scripts/studio
[ -e node_modules/typescript ] || npm install --no-package-lock --no-fund --no-audit --silent || {
    echo "SKIPPED the studio's page: npm could not install playwright-core and typescript"
    exit 0
}
npm run --silent types
npm test --silent
