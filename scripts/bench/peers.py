"""kinelm beside other programs: `peers.sh` installs them and calls this."""

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
LAB = HERE.parents[1] / "target" / "release" / "kinelm-lab"
# Rows of the index that other programs are given at a time, and queries of each.
BLOCK, QUERIES = 50_000, 15


def call(args, command, shim=True):
    """The JSON lines of a program, which measures itself; by the processor's time with one thread."""
    env = dict(os.environ, OMP_NUM_THREADS=str(args.threads), RAYON_NUM_THREADS=str(args.threads))
    if args.threads == 1 and shim:
        env["LD_PRELOAD"] = str(args.folder / "clock.so")
    out = subprocess.run([str(c) for c in command], env=env, check=True, capture_output=True, text=True)
    return [json.loads(line) for line in out.stdout.splitlines() if line.startswith("{")]


def lab(args, what, *more):
    return call(args, [LAB, what, "--json", "-q", "--threads", args.threads, *more])


def seconds(args, work):
    clock = time.process_time if args.threads == 1 else time.perf_counter
    start = clock()
    work()
    return clock() - start


class Row:
    """A task: what each program takes for it, round by round; less is better, or with `rate` more."""

    def __init__(self, task, unit, rate=False, note=""):
        self.task, self.unit, self.rate, self.note = task, unit, rate, note
        self.figures = {}

    def add(self, who, figure):
        self.figures.setdefault(who, []).append(figure)

    def __str__(self):
        said = lambda all: f"{statistics.median(all):.3g} ({min(all):.3g} to {max(all):.3g})"
        ours, *others = self.figures
        lines = []
        for who in others:
            pairs = zip(self.figures[ours], self.figures[who])
            ratios = [a / b if self.rate else b / a for a, b in pairs]
            cells = [self.task, self.unit, said(self.figures[ours]), who, said(self.figures[who]), said(ratios), self.note]
            lines.append("| " + " | ".join(cells) + " |")
        return "\n".join(lines)


def read(args):
    import bvhio
    import kinelm
    import pybvh

    row = Row("a BVH as a clip, from Python", "ms", note=f"{args.file.stat().st_size / 1e6:.1f} MB")
    ways = {
        "kinelm": lambda: kinelm.Clip.read(args.file),
        "pybvh 0.9.0": lambda: pybvh.read_bvh_file(args.file),
        "bvhio 1.5.4": lambda: bvhio.readAsHierarchy(str(args.file)),
    }
    kinelm.Clip.read(args.file)  # the first of a process fetches its memory
    for _ in range(args.rounds):
        for who, work in ways.items():
            row.add(who, 1e3 * seconds(args, work))
    yield row


def encode(args):
    import kinelm

    sys.path.insert(0, str(HERE))
    from tokenize_rate import FRAMES, JOINTS, Uniform, clip as quaternions_of_seed

    smpl = kinelm.Clip.read(args.file).retarget("smpl")

    def of_seed(seed):
        turns = np.zeros((FRAMES, 24, 4))
        turns[:, :, 3] = 1
        turns[:, JOINTS] = quaternions_of_seed(seed)
        root = np.tile([0.0, 0.9, 0.0], (FRAMES, 1))
        return kinelm.Clip(smpl.joints, smpl.parents, smpl.offsets, root, turns, 20.0)

    clips, arrays, theirs = [of_seed(s) for s in range(4)], [quaternions_of_seed(s) for s in range(4)], Uniform()
    ours = kinelm.Tokenizer.fit(clips, joints="13")
    ids, codes = [ours.encode(clip, floor=0.0) for clip in clips], [theirs.encode(a) for a in arrays]
    frames = FRAMES * len(clips)
    rows = [Row(f"{what}, 13 joints in 360 bins, from Python", "frames/s", rate=True, note=note) for what, note in [
        ("encoding", "kinelm also codes the root in closed loop"), ("decoding", "kinelm also makes a clip of 24 joints")]]
    for _ in range(args.rounds):
        rows[0].add("kinelm", frames / seconds(args, lambda: [ours.encode(clip, floor=0.0) for clip in clips]))
        rows[0].add("numpy 2.4.6, scipy 1.17.1", frames / seconds(args, lambda: [theirs.encode(a) for a in arrays]))
        rows[1].add("kinelm", frames / seconds(args, lambda: [ours.decode(i) for i in ids]))
        rows[1].add("numpy 2.4.6, scipy 1.17.1", frames / seconds(args, lambda: [theirs.decode(c) for c in codes]))
    yield from rows


def search(args):
    import faiss
    from usearch.index import MetricKind, search as usearch

    file = args.folder / "features.f32"
    if not file.exists() or file.stat().st_size != 4 * 1152 * args.windows:
        lab(args, "query", "--windows", args.windows, "--repeats", 1, "--save", file)
    features = np.memmap(file, np.float32, "r").reshape(args.windows, 1152)
    bytes_of = np.empty(features.shape, np.int8)
    index = faiss.IndexScalarQuantizer(1152, faiss.ScalarQuantizer.QT_8bit, faiss.METRIC_INNER_PRODUCT)
    unit = lambda rows: rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-30)
    index.train(unit(features[: 2 * BLOCK]))
    most = max(np.abs(unit(features[i : i + BLOCK])).max() for i in range(0, args.windows, BLOCK))
    for i in range(0, args.windows, BLOCK):
        rows = unit(features[i : i + BLOCK])
        index.add(rows)
        bytes_of[i : i + BLOCK] = np.rint(rows * (127 / most))
    faiss.omp_set_num_threads(args.threads)
    chosen = (7919 * np.arange(1, QUERIES + 1)) % args.windows
    queries, whole = unit(features[chosen]), bytes_of[chosen]
    exact = [set() for _ in chosen]
    scores = np.concatenate([unit(features[i : i + BLOCK]) @ queries.T for i in range(0, args.windows, BLOCK)])
    for n in range(QUERIES):
        exact[n] = set(np.argsort(-scores[:, n], kind="stable")[:10])
    found = {"faiss-cpu 1.15.1, SQ8": [], "usearch 2.26.6, i8, exact": []}
    row = Row(f"the 10 nearest of {args.windows:,} windows of 1,152 numbers", "ms")
    for _ in range(args.rounds):
        ours = lab(args, "query", "--windows", args.windows, "--repeats", QUERIES)
        row.add("kinelm", next(line["ms"] for line in ours if line["distance"] == "cosine"))
        times = {who: [] for who in found}
        for n in range(QUERIES):
            def by_faiss():
                found["faiss-cpu 1.15.1, SQ8"].append(len(exact[n] & set(index.search(queries[n : n + 1], 10)[1][0])))

            def by_usearch():
                matches = usearch(bytes_of, whole[n], 10, MetricKind.Cos, exact=True, threads=args.threads)
                found["usearch 2.26.6, i8, exact"].append(len(exact[n] & set(matches.keys)))

            times["faiss-cpu 1.15.1, SQ8"].append(1e3 * seconds(args, by_faiss))
            times["usearch 2.26.6, i8, exact"].append(1e3 * seconds(args, by_usearch))
        for who, all in times.items():
            row.add(who, statistics.median(all))
    row.note = "of the ten that are right: kinelm 10, " + ", ".join(f"{w.split()[0]} {np.mean(n):.1f}" for w, n in found.items())
    yield row


def torch(args, *more):
    return call(args, [sys.executable, HERE / "torch_gpt.py", *more, "--threads", args.threads])[-1]["tokens_per_s"]


def train(args):
    for name, more, count in [("tiny, 256 x 8", ["--config", "tiny"], 12), ("26 M, 1,024 x 1", ["--config", "thesis-26m", "--batch", 1], 4)]:
        row = Row(f"training {name}, f32", "tokens/s", rate=True)
        narrow = Row(f"training {name}, bf16", "tokens/s", rate=True)
        for _ in range(args.rounds):
            row.add("kinelm", lab(args, "train", *more, "--repeats", count)[-1]["tokens_per_s"])
            row.add("PyTorch 2.15.0, eager", torch(args, "train", *more, "--repeats", count))
            # its compiler works beside it, which the processor's time would count
            if args.threads > 1:
                row.add("PyTorch 2.15.0, compiled", torch(args, "train", *more, "--repeats", count, "--compile"))
            narrow.add("kinelm", lab(args, "train", *more, "--repeats", count, "--precision", "bf16")[-1]["tokens_per_s"])
            narrow.add("PyTorch 2.15.0, autocast", torch(args, "train", *more, "--repeats", count, "--bf16"))
        yield from [row, narrow]


def gpt2(args, kind):
    """A GPT-2 of the thesis's 26 million parameters, random, as llama.cpp reads it."""
    import gguf

    file = args.folder / f"thesis-26m-{kind}.gguf"
    if file.exists():
        return file
    layers, width, context, vocabulary = 8, 512, 1024, 366
    rng = np.random.default_rng(1)
    to = gguf.GGUFWriter(str(file), "gpt2")
    to.add_context_length(context)
    to.add_embedding_length(width)
    to.add_block_count(layers)
    to.add_feed_forward_length(4 * width)
    to.add_head_count(8)
    to.add_layer_norm_eps(1e-5)
    to.add_tokenizer_model("gpt2")
    to.add_tokenizer_pre("gpt-2")
    tokens = [chr(0x100 + i) for i in range(vocabulary)]
    to.add_token_list(tokens)
    to.add_token_types([gguf.TokenType.NORMAL] * vocabulary)
    to.add_token_merges([f"{tokens[0]} {tokens[1]}"])
    to.add_bos_token_id(0)
    to.add_eos_token_id(1)

    def matrix(name, rows, columns):
        numbers = rng.normal(0, 0.02, (rows, columns)).astype(np.float32)
        if kind == "q8_0":
            q8 = gguf.GGMLQuantizationType.Q8_0
            to.add_tensor(name, gguf.quants.quantize(numbers, q8), raw_dtype=q8)
        else:
            to.add_tensor(name, numbers)

    def vector(name, size, value=0.0):
        to.add_tensor(name, np.full(size, value, np.float32))

    matrix("token_embd.weight", vocabulary, width)
    to.add_tensor("position_embd.weight", rng.normal(0, 0.02, (context, width)).astype(np.float32))
    for i in range(layers):
        for name, rows, columns in [("attn_qkv", 3 * width, width), ("attn_output", width, width), ("ffn_up", 4 * width, width), ("ffn_down", width, 4 * width)]:
            matrix(f"blk.{i}.{name}.weight", rows, columns)
            vector(f"blk.{i}.{name}.bias", rows)
        for name in ["attn_norm", "ffn_norm"]:
            vector(f"blk.{i}.{name}.weight", width, 1.0)
            vector(f"blk.{i}.{name}.bias", width)
    vector("output_norm.weight", width, 1.0)
    vector("output_norm.bias", width)
    matrix("output.weight", vocabulary, width)
    to.write_header_to_file()
    to.write_kv_data_to_file()
    to.write_tensors_to_file()
    to.close()
    return file


def decode(args):
    big = ["--config", "thesis-26m", "--context", 1000]
    rows = {}
    for what, how in [("decode", "one token after the other"), ("prefill", "a context of 1,000 at once")]:
        for kind in ["f32", "int8"]:
            rows[what, kind] = Row(f"26 M, {how}, {kind}", "tokens/s", rate=True)
    peers = {"f32": "f32", "int8": "q8_0"}
    for _ in range(args.rounds):
        for kind, theirs in peers.items():
            for line in lab(args, "decode", *big, "--weights", kind, *(["--kv", "f16"] if kind == "int8" else [])):
                if line["what"] in ("decode", "prefill"):
                    rows[line["what"], kind].add("kinelm", line["tokens_per_s"])
            # Node's own threads need the wall's clock; the script asks for its processor time
            line = call(args, ["node", HERE / "llama.mjs", args.folder / "llama", gpt2(args, theirs), args.threads], shim=False)[-1]
            for what in ["decode", "prefill"]:
                rows[what, kind].add(f"llama.cpp (node-llama-cpp 3.22.0), {theirs}", line[what])
        for what in ["decode", "prefill"]:
            rows[what, "f32"].add("PyTorch 2.15.0", torch(args, what, *big))
    yield from rows.values()


TASKS = {task.__name__: task for task in [read, encode, search, train, decode]}


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("file", type=Path)
    parser.add_argument("--folder", type=Path, required=True)
    parser.add_argument("--only", default=",".join(TASKS))
    parser.add_argument("--windows", type=int, default=1_000_000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--threads", type=int, default=1)
    args = parser.parse_args()
    by = "processor time" if args.threads == 1 else "wall"
    print(f"{args.threads} threads, by {by}, {args.rounds} rounds in turn, medians (least to most)\n")
    print("| task | unit | kinelm | beside | its figure | kinelm is so many times as fast | |\n|---|---|--:|---|--:|--:|---|")
    for name in args.only.split(","):
        for row in TASKS[name](args):
            print(row, flush=True)


main()
