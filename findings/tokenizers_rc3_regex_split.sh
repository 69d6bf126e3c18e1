#!/usr/bin/env bash
# tokenizers 1.0.0rc3 (PyPI; a candidate whose summary says "not for release yet"): a tokenizer.json whose pre-tokenizer is a
# Split by a Regex, as 0.23.3 writes it, loads without a word and then raises when a text that isn't empty is encoded. The
# patterns of GPT-2 and Llama 3, isolated, are recognised and work; others, even \s+, need a feature of the Rust crate, which
# who installs the wheel can't choose. Split by a String works in both versions.
#
# Seen: 0.23.3 encodes "one two" to [1, 2] by the Regex \s+ and by the String " "; 1.0.0rc3 loads both files, encodes to [1, 2]
# by the String, and by the Regex raises ValueError: this `Split` pattern needs a system-regex backend; enable the
# `fancy-regex` feature. Needs python3 with venv; prints what it saw and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
for version in 0.23.3 1.0.0rc3; do
    python3 -m venv "$version"
    "$version/bin/pip" install --quiet --disable-pip-version-check "tokenizers==$version"
done
cat >write.py <<'PY'
from tokenizers import Regex, Tokenizer, models, pre_tokenizers

for name, pattern in [("regex.json", Regex(r"\s+")), ("string.json", " ")]:
    tokenizer = Tokenizer(models.WordLevel({"[UNK]": 0, "one": 1, "two": 2}, unk_token="[UNK]"))
    tokenizer.pre_tokenizer = pre_tokenizers.Split(pattern, "removed")
    tokenizer.save(name)
PY
cat >look.py <<'PY'
import sys

from tokenizers import Tokenizer, __version__

seen = []
for name in ["string.json", "regex.json"]:
    tokenizer = Tokenizer.from_file(name)
    try:
        seen.append(tokenizer.encode("one two").ids)
    except ValueError as error:
        seen.append(f"ValueError: {error}")
    print(f"{__version__}, {name}: loaded; encode: {seen[-1]}")
assert seen[0] == [1, 2]
assert seen[1] == [1, 2] if sys.argv[1] == "encodes" else "system-regex backend" in seen[1]
PY
0.23.3/bin/python write.py
0.23.3/bin/python look.py encodes
1.0.0rc3/bin/python look.py raises
