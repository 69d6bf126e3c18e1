"""Golden ids: what Python's tokenizers and transformers make of the tokenizer.json that kinelm wrote,
one with characters alone and one with byte-pair merges.

    pip install numpy==2.4.6 tokenizers==0.23.3 transformers==5.23.0   (the versions used are in the file's header)
    for kind in plain merged; do cargo run --release -p kinelm-tokenizer --example golden_tokenizer $kind > $kind.json; done
    python scripts/reference/tokenizer_ids.py plain.json merged.json > tokenizer/tests/golden/tokenizer_ids.json

Random words come from numpy's generator with seed 10, those of the second text are of the few characters that the merges
were learnt on; texts with tokens and strange characters are written out.
"""

import json
import sys
import tempfile
from pathlib import Path

import numpy
import tokenizers
import transformers

SEED = 10
CHARACTERS = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz"


def measure(path):
    whole = json.loads(path.read_text(encoding="utf-8"))
    own = whole["decoder"]["kinelm"]
    bins = own["config"]["scheme"]["bins"]
    channels = 3 + 3 * len(own["config"]["joints"])
    characters = CHARACTERS + "".join(chr(0x4E00 + i) for i in range(bins - len(CHARACTERS)))
    random = numpy.random.default_rng(SEED)
    codes = random.integers(0, bins, (12, channels))
    words = "".join("".join(characters[k] for k in word) + " " for word in codes)

    # what merges were learnt on stands often; parts of it in another order put the ranks to the test
    merges = whole["model"]["merges"]
    known = sorted({token for pair in merges for token in pair.split()}) or list(characters[:9])
    mixed = "".join("".join(random.choice(known, 6)) + " " for _ in range(40))

    texts = [
        words,
        mixed,
        characters,
        "",
        " ",
        "<bos>012345678 <genre:salsa>012345678 <dancer:two words: 61> <mask><pad><eos><unk>",
        "<bos <bos><<bos>> <genre:waltz> <genre:salsa",
        "0\n1\t2  3 \u00e9 \u4e11 \u4e12 \u3000 _",
        "\u00e9\u00e901\u4e12\u9999234 \u4e12<unk>\u4e12",
    ]
    ours = tokenizers.Tokenizer.from_file(str(path))
    fast = transformers.PreTrainedTokenizerFast(tokenizer_file=str(path))
    with tempfile.TemporaryDirectory() as folder:
        fast.save_pretrained(folder)
        auto = transformers.AutoTokenizer.from_pretrained(folder)

    cases = []
    for text in texts:
        ids = ours.encode(text, add_special_tokens=False).ids
        with_bos = ours.encode(text).ids
        assert with_bos == [1] + ids
        for other in (fast, auto):
            assert other(text, add_special_tokens=False)["input_ids"] == ids, text
            assert other(text)["input_ids"] == with_bos, text
        decoded = ours.decode(ids, skip_special_tokens=False)
        assert text != words or decoded == words
        cases.append({"text": text, "ids": ids, "decoded": decoded})
    return {"sha256": own["sha256"], "size": ours.get_vocab_size(), "codes": codes.ravel().tolist(), "cases": cases}


json.dump(
    {
        "script": "scripts/reference/tokenizer_ids.py",
        "versions": {
            "python": sys.version.split()[0],
            "numpy": numpy.__version__,
            "tokenizers": tokenizers.__version__,
            "transformers": transformers.__version__,
        },
        "seed": SEED,
        "plain": measure(Path(sys.argv[1])),
        "merged": measure(Path(sys.argv[2])),
    },
    sys.stdout,
    ensure_ascii=False,
    indent=1,
)
print()
