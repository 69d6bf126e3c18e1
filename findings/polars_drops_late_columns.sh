#!/usr/bin/env bash
# polars 2.1.0 (PyPI), read_ndjson and scan_ndjson: a key that first occurs after line 100 is dropped, with its values. There
# is no error, no warning and no column: the columns are those of the first `infer_schema_length` lines, 100 unless stated,
# and what else later lines have is skipped. A log of training that has a validation loss every 200 steps loses all of them.
# Known there as issue 29330 of pola-rs/polars, open when this was written; `infer_schema_length=None` keeps the key.
#
# Seen: of 1000 lines {"step": N, "loss": X}, every 200th with "val" too, 5 values of "val" are written; read_ndjson and
# scan_ndjson return 0 of them, infer_schema_length=None all 5, and read_ndjson without the first 199 lines all 5.
# Needs python3 with venv; prints what it saw and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv python
python/bin/pip install --quiet --disable-pip-version-check polars==2.1.0 polars-runtime-32==2.1.0
cat >look.py <<'PY'
import json
import warnings

import polars as pl

warnings.simplefilter("error")
lines = [{"step": step, "loss": 1 / step, **({"val": 2 / step} if step % 200 == 0 else {})} for step in range(1, 1001)]
for name, kept in [("log.jsonl", lines), ("late.jsonl", lines[199:])]:
    with open(name, "w") as file:
        file.writelines(json.dumps(line) + "\n" for line in kept)


def values(table):
    return table["val"].count() if "val" in table.columns else 0


seen = {
    "in the file": sum("val" in line for line in lines),
    "read_ndjson": values(pl.read_ndjson("log.jsonl")),
    "scan_ndjson": values(pl.scan_ndjson("log.jsonl").collect()),
    "infer_schema_length=None": values(pl.read_ndjson("log.jsonl", infer_schema_length=None)),
    "from line 200 on": values(pl.read_ndjson("late.jsonl")),
}
print("values of val:", ", ".join(f"{count} {name}" for name, count in seen.items()))
print("columns of read_ndjson:", pl.read_ndjson("log.jsonl").columns)
assert list(seen.values()) == [5, 0, 0, 5, 5]
PY
python/bin/python look.py
