"""A run through `kinelm export --format hf`, transformers, and `kinelm import`: everything that must be equal, measured.

    pip install torch==2.15.0 transformers==5.23.0 tokenizers==0.23.3 safetensors numpy
    python scripts/reference/hf_round_trip.py KINELM RUN CORPUS [--split test] [--windows 32]

KINELM is the program, RUN a run that GPT-2 can express (configs/train/thesis-26m.toml has one), CORPUS its corpus. Measured:
  logits        of AutoModelForCausalLM.from_pretrained(export) and of scripts/cluster/model.py with the weights under our own
                names, on some windows of the split, spread evenly: at most 1e-4 apart
  bits/frame    of the transformers model on these windows, and what `kinelm evaluate likelihood` says: 1e-4 apart
  ids           of PreTrainedTokenizerFast.from_pretrained(export) for the text of every window: those of the corpus
  import        of the folder as transformers saves it again (with our tokenizer.json): bits/frame from kinelm that are 1e-9 of
                them apart at most (wpe holds the sums of the position tables), and weights equal bit by bit
Exits with 1 where one of them fails. No randomness but the run's.
"""
import argparse
import json
import math
import subprocess
import sys
import tempfile
from pathlib import Path

import torch
import transformers
from safetensors.torch import load_file

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "scripts/cluster"))
from folder import Model  # noqa: E402
from windows import Conditions, Corpus, causal, eval_windows, room  # noqa: E402

BOUND = 1e-4
EPSILON = 1e-9


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("kinelm")
    parser.add_argument("run", type=Path)
    parser.add_argument("corpus", type=Path)
    parser.add_argument("--split", default="test")
    parser.add_argument("--windows", type=int, default=32, help="at most, spread evenly; 0: all")
    args = parser.parse_args()
    torch.manual_seed(0)
    with tempfile.TemporaryDirectory() as work:
        sys.exit(0 if all(checks(args, Path(work))) else 1)


def checks(args, work):
    def kinelm(*words):
        return subprocess.run([args.kinelm, *map(str, words)], check=True, capture_output=True, text=True)

    def bits(run):
        where = ["--run", run, "--corpus", args.corpus, "--split", args.split, "--windows", args.windows]
        return json.loads(kinelm("evaluate", "likelihood", *where, "--json").stdout)

    hf, own = work / "hf", work / "own"
    kinelm("export", "--run", args.run, "--format", "hf", "--out", hf)
    kinelm("export", "--run", args.run, "--format", "kinelm", "--out", own)
    model = transformers.AutoModelForCausalLM.from_pretrained(hf).eval()
    assert type(model).__name__ == "GPT2LMHeadModel"
    description = Model.read(own)
    plain = description.build().eval()
    windows = list(all_windows(Corpus(args.corpus), description, args.split))
    most = min(args.windows or len(windows), len(windows))
    windows = [windows[i * len(windows) // most] for i in range(most)]

    far = max(far_apart(model, plain, inputs) for inputs, _ in windows)
    yield say("logits", far <= BOUND, f"at most {far:.2e} apart over {len(windows)} windows")

    told = bits(args.run)
    nats = sum(cost(model, *window) for window in windows)
    found = nats / math.log(2) / told["frames"]
    apart = abs(found - told["bits_per_frame"])
    text = f"{found:.6f} by transformers, {told['bits_per_frame']:.6f} by kinelm over {len(windows)} windows"
    yield say("bits/frame", apart <= BOUND, text)

    tokenizer = transformers.AutoTokenizer.from_pretrained(hf)
    assert isinstance(tokenizer, transformers.PreTrainedTokenizerFast)
    special = {name: getattr(tokenizer, f"{name}_token_id") for name in ("pad", "bos", "eos", "mask", "unk")}
    yield say("special ids", list(special.values()) == [0, 1, 2, 3, 4], special)
    yield say("longest input", tokenizer.model_max_length == description.config.context, tokenizer.model_max_length)
    wrong, count = 0, 0
    for inputs, _ in windows:
        ids = inputs[inputs != 0][description.tokens.front :].tolist()
        text = "".join(tokenizer.convert_ids_to_tokens(ids))
        wrong += tokenizer(text)["input_ids"] != [1, *ids] or tokenizer.decode(ids) != text
        count += len(ids)
    yield say("ids", wrong == 0, f"{wrong} of {len(windows)} windows of {count} characters differ")

    again, back = work / "again", work / "back"
    model.save_pretrained(again)
    for name in ("tokenizer.json", "kinelm.json"):
        (again / name).write_bytes((hf / name).read_bytes())
    kinelm("import", again, "--run", back)
    found = bits(back)["bits_per_frame"]
    apart = abs(found / told["bits_per_frame"] - 1)
    yield say("imported bits/frame", apart <= EPSILON, f"{found!r}, before {told['bits_per_frame']!r}")
    before, behind = model.state_dict(), load_file(next((back / "checkpoints").glob("step-*")) / "model.safetensors")
    pairs = [("token.weight", "transformer.wte.weight"), ("position.absolute.weight", "transformer.wpe.weight")]
    last = description.config.layers - 1
    pairs += [(f"block.{last:02}.mlp.down.weight", f"transformer.h.{last}.mlp.c_proj.weight"), ("norm.bias", "transformer.ln_f.bias")]
    same = all(torch.equal(behind[ours], before[theirs]) for ours, theirs in pairs)
    yield say("imported weights", same, f"{len(behind)} tensors, {len(pairs)} of them compared")


def say(what, holds, text):
    print(f"{'ok  ' if holds else 'FAIL'} {what}: {text}", flush=True)
    return holds


def all_windows(corpus, description, split):
    """Inputs and targets of every measuring window; what the one before has scored is padding."""
    conditions = Conditions(description.conditions, json.loads(description.tokenizer))
    config, tokens = description.config, description.tokens
    for clip in corpus.split(split):
        front = conditions.front(corpus.clips[clip]["labels"], tokens.bos)
        for start, count, scored in eval_windows(corpus.words(clip), room(config, tokens)):
            inputs, targets = causal(corpus.ids(clip, start, start + count), front, tokens.pad, config.context)
            targets[: len(front) - 1 + scored] = tokens.pad
            yield inputs, targets


def seen(model, ids):
    """Logits of windows whose padding stands behind all that counts."""
    return model(ids, attention_mask=torch.ones_like(ids)).logits


@torch.no_grad()
def far_apart(model, plain, inputs):
    ids = torch.from_numpy(inputs)[None]
    return (seen(model, ids) - plain(ids)).abs().max().item()


@torch.no_grad()
def cost(model, inputs, targets):
    logits = seen(model, torch.from_numpy(inputs)[None])[0].double()
    return torch.nn.functional.cross_entropy(logits, torch.from_numpy(targets), ignore_index=0, reduction="sum").item()


if __name__ == "__main__":
    main()
