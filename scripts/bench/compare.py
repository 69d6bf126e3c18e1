#!/usr/bin/env python3
"""Measures kinelm and PyTorch in turn and prints medians, spread and ratios; `run.sh` beside this file calls it.

A heat is some programs whose figures are compared. Each runs once a round, in a process of its own, the order turned
around every other round; its figure of a round is the median of its timings, its figure of the heat the median of the
rounds. Ratios are taken within a round. PyTorch's programs run under the interpreter that runs this file.

The machine counts as quiet if, in every pause between two programs, other work took at most 5 % of the cores, and over the
whole time at most 1 % was taken by other machines on the same hardware ("steal").
"""
import argparse, json, os, pathlib, platform, statistics, subprocess, sys, time

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[1]
BUSY, STEAL = 0.05, 0.01
# glibc keeps memory instead of giving it back at every step
KEEP_HEAP = {"MALLOC_MMAP_THRESHOLD_": str(8 << 30), "MALLOC_TRIM_THRESHOLD_": str(8 << 30), "MALLOC_TOP_PAD_": str(256 << 20)}


class Entry:
    """A program of a heat; a figure for each kind of line that it prints."""

    def __init__(self, label, command, env=None):
        self.label, self.command, self.env, self.error = label, command, env or {}, None
        self.lines = {}  # by their "what", a line a round

    def run(self):
        if self.error:
            return
        done = subprocess.run(self.command, capture_output=True, text=True, env=os.environ | self.env)
        try:
            if done.returncode:
                raise ValueError
            for line in map(json.loads, done.stdout.splitlines()):
                self.lines.setdefault(line["what"], []).append(line)
        except ValueError:
            self.error = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]


class Ratio:
    """How often one entry's rate goes into another's; `of` and `to` are (label, what)."""

    def __init__(self, of, to, least=None, memory=False):
        self.of, self.to, self.least, self.memory = of, to, least, memory
        self.name = f"{of[0]} / {to[0]}"


class Share:
    """What an entry says of itself under a key."""

    def __init__(self, of, key, least):
        self.of, self.key, self.least, self.name = of, key, least, f"{of[0]}: {key.replace('_', ' ')}"


class Heat:
    def __init__(self, group, name, entries, aims=()):
        self.group, self.name, self.entries, self.aims = group, name, entries, aims

    def lines(self, of):
        label, what = of
        return next((e.lines.get(what, []) for e in self.entries if e.label == label and not e.error), [])


def rate(line):
    return line.get("tokens_per_s") or line.get("frames_per_s")


def heats(args):
    lab, torch, n = str(args.lab), str(HERE / "torch_gpt.py"), str(args.threads)
    repeats = lambda n: ["--repeats", str(max(3, n // 3) if args.quick else n)]
    decoded = ["--repeats", "2"] if args.quick else []

    def ours(label, what, *more, threads=n):
        return Entry(label, [lab, what, "--json", "-q", "--threads", threads, *more])

    def theirs(label, what, *more, env=None):
        return [] if args.no_torch else [Entry(label, [sys.executable, torch, what, "--threads", n, *more], env)]

    def train(name, aim, count, *more):
        more, rivals = [*more, *repeats(count)], ["PyTorch", "PyTorch, memory kept", "torch.compile"]
        entries = [ours("kinelm", "train", *more), *theirs(rivals[0], "train", *more)]
        entries += [*theirs(rivals[1], "train", *more, env=KEEP_HEAP), *theirs(rivals[2], "train", *more, "--compile")]
        aims = [Ratio(("kinelm", "train"), (r, "train"), aim, memory=True) for r in rivals]
        return Heat("train", f"training {name}", entries, aims)

    def bf16(name, ours_aim, their_aim, count, *more, torch=True):
        more = [*more, *repeats(count)]
        here = ours("kinelm, bf16", "train", *more, "--precision", "bf16")
        entries, aims = [here, ours("kinelm, f32", "train", *more)], []
        aims.append(Ratio((here.label, "train"), ("kinelm, f32", "train"), ours_aim))
        if torch:
            for label, how, env in [("autocast", [], None), ("autocast, memory kept", [], KEEP_HEAP), ("autocast, compiled", ["--compile"], None)]:
                entries += theirs(label, "train", *more, "--bf16", *how, env=env)
                aims.append(Ratio((here.label, "train"), (label, "train"), their_aim))
        return Heat("bf16", f"bf16, {name}", entries, aims)

    big = ["--config", "thesis-26m"]
    yield train("tiny, 256 x 8", 1.5, 40, "--config", "tiny")
    yield train("26 M, 1,024 x 1", 1.15, 9, *big, "--batch", "1")
    yield train("26 M, 1,024 x 2", 1.15, 6, *big, "--batch", "2")
    yield train("two levels, 128 frames x 1", 1.4, 20, "--config", "two-level")
    if args.threads > 1:
        for name, config, count in [("tiny, 256 x 8", ["--config", "tiny"], 30), ("26 M, 1,024 x 1", big, 6)]:
            more = [*config, *repeats(count)]
            entries = [ours(f"{n} threads", "train", *more), ours("one thread", "train", *more, threads="1")]
            aim = Ratio((f"{n} threads", "train"), ("one thread", "train"), 1.8 if args.threads == 2 else None)
            yield Heat("train", f"threads, {name}", entries, [aim])
    # what products of bf16 are to gain over f32: on the tiles of AMX, else in registers
    gains = (1.5, 3.0, 1.5) if "amx_bf16" in flags().split() else (1.25, 1.45, 1.3)
    if {"amx_bf16", "avx512_bf16"} & set(flags().split()):
        yield bf16("tiny, 256 x 8", gains[0], None, 40, "--config", "tiny")
        yield bf16("26 M, 1,024 x 1", gains[1], 1.3, 9, *big, "--batch", "1")
        yield bf16("two-level, 4 windows", gains[2], None, 9, "--config", "two-level", "--batch", "4", torch=False)
    contexts = [256, 512, 1024, 2048, 4096]
    shape = lambda t: ["--config", "small", "--context", str(t), "--batch", str(4096 // t), *repeats(6)]
    yield Heat("train", "contexts, small, 4,096 tokens a step", [ours(f"context {t:,}", "train", *shape(t)) for t in contexts])

    kinds = {"f32": ["--weights", "f32"], "int8": ["--weights", "int8", "--kv", "f16"]}
    limits = {1000: [{"f32": 1.6, "int8": 4.0}, {"f32": 2.2, "int8": 1.6}], 128: [{}, {"f32": 4.0, "int8": 4.0}]}
    for context, (single, eight) in limits.items():
        entries, aims = [], []
        for streams in [1, 8]:
            more = [*big, "--context", str(context), "--streams", str(streams), *decoded]
            them = f"PyTorch x {streams}"
            entries += theirs(them, "decode", *more)
            for kind, how in kinds.items():
                label = f"{kind} x {streams}"
                entries.append(ours(label, "decode", *more, *how))
                aims.append(Ratio((label, "decode"), (them, "decode"), single.get(kind) if streams == 1 else None))
                if streams == 8:
                    aims.append(Ratio((label, "decode"), (f"{kind} x 1", "decode"), eight[kind]))
        if context == 1000:
            entries += theirs("PyTorch prefill", "prefill", *big, "--context", "1000", *decoded)
            aims.append(Ratio(("f32 x 1", "prefill"), ("PyTorch prefill", "prefill"), 1.0))
            four = [*big, "--context", "1000", "--streams", "4", *decoded]
            entries += [ours(f"{kind} x 4", "decode", *four, *how) for kind, how in kinds.items()]
            aims.append(Share(("f32 x 1", "decode"), "share_of_bandwidth", 0.8))
            aims += [Share((f"{k} x {s}", "generate"), "frames_per_s", f) for k in kinds for s, f in [(1, 12), (4, 20)]]
        yield Heat("decode", f"decoding 26 M, context {context:,}", entries, aims)

    def recurrent(label, *more):
        command = [sys.executable, str(HERE / "torch_lstm.py"), "--threads", n, *more]
        return [] if args.no_torch else [Entry(label, command)]

    for width, count, least in [(256, 10, 1.5), (1024, 4, 1.0)]:
        more = ["--width", str(width), *repeats(count)]
        entries = [ours("kinelm", "lstm", *more), *recurrent("cells", *more), *recurrent("cells, compiled", *more, "--compile")]
        aims = [Ratio(("kinelm", "lstm"), (r, "lstm"), least) for r in ["cells", "cells, compiled"]]
        yield Heat("lstm", f"LSTM {width}, 5 true frames and 5 own", entries, aims)
        more += ["--condition", "0"]
        entries = [ours("kinelm", "lstm", *more), *recurrent("nn.LSTM", *more, "--whole")]
        yield Heat("lstm", f"LSTM {width}, true frames alone", entries, [Ratio(("kinelm", "lstm"), ("nn.LSTM", "lstm"), None)])


def flags():
    """What of the processor decides which kernels run."""
    try:
        line = next(l for l in open("/proc/cpuinfo") if l.startswith("flags"))
    except (OSError, StopIteration):
        return ""
    return " ".join(f for f in ("avx2", "avx512f", "avx512_vnni", "avx512_bf16", "amx_bf16", "amx_int8") if f in line.split())


class Machine:
    """Whether other work ran beside ours."""

    def __init__(self):
        self.worst, self.first, self.load = 0.0, self.times(), self.load_now()

    def times(self):
        """Clock ticks of all cores: all, idle, stolen; None where the system doesn't tell."""
        try:
            ticks = [int(x) for x in open("/proc/stat").readline().split()[1:9]]
        except (OSError, ValueError):
            return None
        return sum(ticks), ticks[3] + ticks[4], ticks[7]

    def load_now(self):
        return os.getloadavg()[0] if hasattr(os, "getloadavg") else None

    def pause(self, seconds):
        before = self.times()
        time.sleep(seconds)
        if before:
            total, idle, _ = (b - a for a, b in zip(before, self.times()))
            self.worst = max(self.worst, 1 - idle / max(total, 1))

    def verdict(self):
        if not self.first:
            return {"quiet": None, "said": "this system doesn't tell whether other work ran"}
        total, _, stolen = (b - a for a, b in zip(self.first, self.times()))
        steal = stolen / max(total, 1)
        quiet = self.worst <= BUSY and steal <= STEAL
        said = (
            f"the machine was {'quiet' if quiet else 'NOT QUIET'}: in pauses other work took up to {self.worst:.1%} of the cores "
            f"(limit {BUSY:.0%}), {steal:.2%} was stolen in all (limit {STEAL:.0%}); load {self.load:.2f} before"
        )
        return {"quiet": quiet, "said": said, "busy_in_pauses": round(self.worst, 4), "steal": round(steal, 4), "load": self.load}


def facts(args):
    def said(*command):
        try:
            return subprocess.run(command, capture_output=True, text=True, cwd=ROOT).stdout.strip()
        except OSError:
            return ""

    try:
        cpu = next(l.split(":")[1].strip() for l in open("/proc/cpuinfo") if l.startswith("model name"))
    except (OSError, StopIteration):
        cpu = platform.processor() or platform.machine()
    commit = said("git", "rev-parse", "--short", "HEAD") + ("+" if said("git", "status", "--porcelain", "-uno") else "")
    rustc = " ".join(said("rustc", "--version").split()[:2])
    return f"{cpu} ({flags()}), {os.cpu_count()} cores, {args.threads} threads; {rustc}; commit {commit}; {time.strftime('%Y-%m-%d')}"


def number(x):
    return f"{x:,.0f}" if x >= 1000 else f"{x:,.1f}" if x >= 10 else f"{x:,.2f}"


def middle(values):
    spread = f" ({number(min(values))} to {number(max(values))})" if len(values) > 1 else ""
    return number(statistics.median(values)) + spread


def figures(heat):
    """A row for each kind of line of each entry, as JSON has it."""
    for entry in heat.entries:
        if entry.error:
            yield {"schema": 1, "what": heat.name, "who": entry.label, "error": entry.error}
            continue
        for what, lines in entry.lines.items():
            last, rates = lines[-1], [rate(line) for line in lines]
            unit = "tokens_per_s" if "tokens_per_s" in last else "frames_per_s"
            row = {"schema": 1, "what": heat.name, "who": entry.label, "part": what, unit: statistics.median(rates)}
            row |= {"spread": [min(rates), max(rates)], "peak_rss_mb": max(line["peak_rss_mb"] or 0 for line in lines)}
            kept = ("form", "kernels", "gflops", "share_of_peak", "gb_per_s", "share_of_bandwidth", "rss_at_start_mb")
            yield row | {key: last[key] for key in kept if key in last}


def aims(heat):
    """A row for each comparison that has both its sides."""
    for aim in heat.aims:
        lines = heat.lines(aim.of)
        if isinstance(aim, Share):
            values = [line[aim.key] for line in lines if aim.key in line]
            memory = None
        else:
            pairs = list(zip(lines, heat.lines(aim.to)))
            values = [rate(a) / rate(b) for a, b in pairs]
            memory = max((a["peak_rss_mb"] / b["peak_rss_mb"] for a, b in pairs), default=None) if aim.memory else None
        if values:
            found = statistics.median(values)
            row = {"schema": 1, "what": heat.name, "ratio": aim.name, "median": found, "rounds": values, "memory": memory}
            yield row | {"aim": aim.least, "reached": None if aim.least is None else found >= aim.least}


def table(heat):
    """The heat's lines in Markdown."""
    for row in figures(heat):
        if "error" in row:
            yield f"| {heat.name} | {row['who']} | failed: {row['error'][:120]} | | |"
            continue
        key, unit = ("tokens_per_s", "tokens/s") if "tokens_per_s" in row else ("frames_per_s", "frames/s")
        low, high = map(number, row["spread"])
        text = f"{number(row[key])} {unit} ({low} to {high})"
        text += f"; {row['gflops']:.0f} GFLOP/s, {row['share_of_peak']:.0%} of the peak" if "share_of_peak" in row else ""
        text += f"; {row['gb_per_s']:.1f} GB/s, {row['share_of_bandwidth']:.0%} of the memory's" if "gb_per_s" in row else ""
        who = row["who"] + ("" if row["part"] in ("train", "decode") else f", {row['part']}")
        peak = f"{row['peak_rss_mb']:,}" + (f" ({row['rss_at_start_mb']:,} at import)" if "rss_at_start_mb" in row else "")
        yield f"| {heat.name} | {who} | {text} | | {peak} |"
    for row in aims(heat):
        reached = "" if row["aim"] is None else f"{row['aim']}: {'reached' if row['reached'] else 'MISSED'}"
        memory = "" if row["memory"] is None else f"{row['memory']:.2f}: {'reached' if row['memory'] <= 1 else 'MISSED'}"
        yield f"| {heat.name} | **{row['ratio']}** | {middle(row['rounds'])} | {reached} | {memory} |"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--lab", type=pathlib.Path, default=ROOT / "target" / "release" / "kinelm-lab")
    parser.add_argument("--only", choices=["train", "bf16", "decode", "lstm"])
    parser.add_argument("--match", help="only heats whose name holds this")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--quick", action="store_true", help="two rounds, a third of the steps: to see that all works")
    parser.add_argument("--threads", type=int, default=os.cpu_count())
    parser.add_argument("--json", type=pathlib.Path, help="write one object a row to this file, too")
    parser.add_argument("--torch", help="read by run.sh")
    parser.add_argument("--no-torch", action="store_true")
    args = parser.parse_args()
    rounds = 2 if args.quick else args.rounds
    machine, out = Machine(), []
    machine.pause(3)
    chosen = [h for h in heats(args) if args.only in (None, h.group) and (args.match or "") in h.name]
    print(f"{facts(args)}; {rounds} rounds\n")
    print("| what | who | median (lowest to highest round) | aim | peak MB, aim 1 |\n|---|---|---|---|---|", flush=True)
    for heat in chosen:
        for turn in range(rounds):
            for entry in heat.entries[:: -1 if turn % 2 else 1]:
                machine.pause(1)
                entry.run()
        print("\n".join(table(heat)), flush=True)
        out += [*figures(heat), *aims(heat)]
    verdict = machine.verdict()
    print(f"\n{verdict['said']}")
    if args.json:
        lines = [*out, {"schema": 1, "what": "machine", "facts": facts(args), **verdict}]
        args.json.write_text("".join(json.dumps(line) + "\n" for line in lines))
    if verdict["quiet"] is False:
        print("take the ratios with care and run it again", file=sys.stderr)


if __name__ == "__main__":
    main()
