#!/bin/sh
# A picture of a page of `kinelm view`, made by a headless chromium.
#   scripts/screenshot.sh PAGE.html OUT.png [FRAGMENT [WIDTHxHEIGHT]]
# FRAGMENT sets the page up as in its address, for example 't=2.5&pause&bare&light'; the default is 't=2&pause'.
set -eu
[ $# -ge 2 ] || { sed -n '2,4s/^# *//p' "$0" >&2; exit 2; }
page=$(realpath "$1") out=$2 fragment=${3:-'t=2&pause'} size=${4:-1280x720}
for browser in chromium-headless-shell chromium chromium-browser google-chrome google-chrome-stable; do
  command -v "$browser" >/dev/null && break
done
command -v "$browser" >/dev/null || { echo "screenshot.sh: no chromium on the PATH" >&2; exit 1; }
profile=$(mktemp -d)
# headless browsers hang now and then
limit=$(command -v timeout >/dev/null && echo "timeout 120" || true)
trap 'rm -rf "$profile"' EXIT
$limit "$browser" --headless --no-sandbox --use-angle=swiftshader --enable-unsafe-swiftshader --hide-scrollbars \
  --disable-quic --no-first-run --disable-background-networking --disable-component-update --disable-sync \
  --user-data-dir="$profile" --window-size="$(echo "$size" | tr x ,)" \
  --screenshot="$out" "file://$page#$fragment" 2>"$profile/log" || { cat "$profile/log" >&2; exit 1; }
[ -s "$out" ] || { cat "$profile/log" >&2; exit 1; }
