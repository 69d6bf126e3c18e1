"""Whether the installed tokenizers gives a golden file's ids and texts: check.sh calls it.

    python load.py tokenizer_ids.json plain.json merged.json
"""

import json
import sys

import tokenizers

golden = json.load(open(sys.argv[1], encoding="utf-8"))
count = 0
for kind, path in zip(("plain", "merged"), sys.argv[2:4], strict=True):
    whole = json.load(open(path, encoding="utf-8"))
    if whole["decoder"]["kinelm"]["sha256"] != golden[kind]["sha256"]:
        sys.exit(f"{path}: another tokenizer than the golden file's")
    theirs = tokenizers.Tokenizer.from_file(path)
    specials = {token["content"]: token["id"] for token in whole["added_tokens"]}
    cases = [(case["text"], case["ids"], case["decoded"]) for case in golden[kind]["cases"]]
    for text, ids, decoded in cases + [(token, [at], token) for token, at in specials.items()]:
        found = list(theirs.encode(text, add_special_tokens=False).ids)
        with_bos = list(theirs.encode(text).ids)
        again = theirs.decode(ids, skip_special_tokens=False)
        if found != ids or with_bos != [1] + ids or again != decoded:
            sys.exit(f"tokenizers {tokenizers.__version__}, {path}: {text!r} is {found} and {again!r}, expected {ids} and {decoded!r}")
        count += 1
print(f"tokenizers {tokenizers.__version__}: {count} texts have the same ids, and come back")
