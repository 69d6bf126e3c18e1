#!/usr/bin/env python3
"""Measures kinelm and PyTorch in turn and prints medians, spread and ratios; `run.sh` beside this file calls it.

A heat is some programs that do the same work. Each runs once a round, in a process of its own, the order turned around
every other round; its figure of a round is the median of its timed steps, its figure of the heat the median of the rounds.
Ratios are taken within a round. PyTorch's programs run under the interpreter that runs this file.

The machine counts as quiet if, in every pause between two programs, other work took at most 5 % of the cores, and over the
whole time at most 1 % was taken by other machines on the same hardware ("steal").
"""
import argparse, json, os, pathlib, platform, statistics, subprocess, sys, time

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[1]
BUSY, STEAL = 0.05, 0.01
# glibc keeps memory instead of giving it back at every step: what kinelm sets for its own plain form
KEEP_HEAP = {"MALLOC_MMAP_THRESHOLD_": str(8 << 30), "MALLOC_TRIM_THRESHOLD_": str(8 << 30), "MALLOC_TOP_PAD_": str(256 << 20)}


class Entry:
    """A program of a heat."""

    def __init__(self, label, command, env=None):
        self.label, self.command, self.env, self.lines, self.error = label, command, env or {}, [], None

    def run(self):
        if self.error:
            return
        done = subprocess.run(self.command, capture_output=True, text=True, env=os.environ | self.env)
        try:
            self.lines.append(json.loads(done.stdout.splitlines()[0]))
        except (IndexError, ValueError):
            said = done.stderr.strip().splitlines() or [f"exit code {done.returncode}"]
            self.error = said[-1]

    def rates(self):
        return [line["tokens_per_s"] for line in self.lines]

    def peak(self):
        return max((line.get("peak_rss_mb") or 0 for line in self.lines), default=0)


class Heat:
    """`entries[0]` is what the others are compared with."""

    def __init__(self, group, name, aim, entries):
        self.group, self.name, self.aim, self.entries = group, name, aim, entries


def heats(args):
    repeats = lambda n: ["--repeats", str(max(3, n // 3) if args.quick else n)]
    kinelm, torch, n = str(args.kinelm), str(HERE / "torch_gpt.py"), str(args.threads)

    def ours(what, *more, label="kinelm", threads=n):
        return Entry(label, [kinelm, "bench", what, "--json", "-q", "--threads", threads, *more])

    def theirs(what, *more, label="PyTorch", env=None):
        return Entry(label, [sys.executable, torch, what, "--threads", n, *more], env)

    def rivals(what, *more, compiled=False):
        if args.no_torch:
            return []
        found = [theirs(what, *more)]
        if compiled:
            found.append(theirs(what, *more, label="PyTorch, memory kept", env=KEEP_HEAP))
            found.append(theirs(what, *more, "--compile", label="torch.compile"))
        return found

    def train(name, aim, count, *more):
        more = [*more, *repeats(count)]
        return Heat("train", f"training {name}", aim, [ours("train", *more), *rivals("train", *more, compiled=True)])

    big = ["--config", "thesis-26m"]
    yield train("tiny, 256 x 8", 1.5, 40, "--config", "tiny")
    yield train("26 M, 1,024 x 1", 1.15, 9, *big, "--batch", "1")
    yield train("26 M, 1,024 x 2", 1.15, 6, *big, "--batch", "2")
    if args.threads > 1:
        for name, config, count in [("tiny, 256 x 8", ["--config", "tiny"], 30), ("26 M, 1,024 x 1", big, 6)]:
            more = [*config, *repeats(count)]
            one = ours("train", *more, label="one thread", threads="1")
            aim = 1.8 if args.threads == 2 else None
            yield Heat("train", f"threads, {name}", aim, [ours("train", *more, label=f"{n} threads"), one])
    for context in [256, 512, 1024, 2048, 4096]:
        more = ["--config", "small", "--context", str(context), "--batch", str(4096 // context), *repeats(6)]
        yield Heat("train", f"context {context:,}, small, 4,096 tokens a step", None, [ours("train", *more)])
    for context, streams, aims in [(1000, 1, (1.6, 4.0)), (128, 1, (None, None)), (1000, 8, (None, None)), (128, 8, (None, None))]:
        more = [*big, "--context", str(context), "--streams", str(streams), *repeats(20)]
        for weights, aim in zip(["f32", "int8"], aims):
            entries = [ours("decode", *more, "--weights", weights, label=f"kinelm {weights}"), *rivals("decode", *more)]
            yield Heat("decode", f"decoding 26 M, {weights}, context {context:,} x {streams}", aim, entries)
    more = [*big, "--context", "1000", *repeats(6)]
    yield Heat("decode", "prefill 26 M, 1,000 tokens", 1.0, [ours("decode", "--prefill", *more), *rivals("prefill", *more)])


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
    return f"{cpu}, {os.cpu_count()} cores, {args.threads} threads; {rustc}; commit {commit}; {time.strftime('%Y-%m-%d')}"


def number(x):
    return f"{x:,.0f}" if x >= 100 else f"{x:,.1f}"


def middle(values, form):
    low, high = form(min(values)), form(max(values))
    return form(statistics.median(values)) + (f" ({low} to {high})" if len(values) > 1 else "")


def rows(heat):
    """A row for each entry, as JSON has it."""
    first = heat.entries[0]
    for entry in heat.entries:
        row = {"schema": 1, "what": heat.name, "who": entry.label, "error": entry.error}
        if not entry.error:
            last, rates = entry.lines[-1], entry.rates()
            row |= {"tokens_per_s": statistics.median(rates), "spread": [min(rates), max(rates)], "peak_rss_mb": entry.peak()}
            row |= {k: last[k] for k in ("form", "kernels", "gflops", "share_of_peak", "rss_at_start_mb") if k in last}
            if entry is not first and not first.error:
                ratios = [a / b for a, b in zip(first.rates(), rates)]
                row |= {"ratios": ratios, "ratio": statistics.median(ratios)}
        yield row


def table(heat):
    """The heat's lines in Markdown."""
    found = list(rows(heat))
    for row, entry in zip(found, heat.entries):
        if row["error"]:
            yield f"| {heat.name} | {entry.label} | failed: {row['error'][:120]} | | |"
            continue
        ratio = middle(row["ratios"], lambda x: f"{x:.2f}") if "ratios" in row else ""
        share = f"; {row['gflops']:.0f} GFLOP/s, {row['share_of_peak']:.0%} of the peak" if "share_of_peak" in row else ""
        peak = f"{row['peak_rss_mb']:,}" + (f" ({row['rss_at_start_mb']:,} at import)" if "rss_at_start_mb" in row else "")
        yield f"| {heat.name} | {entry.label} | {middle(entry.rates(), number)}{share} | {ratio} | {peak} |"
    ratios = [row["ratio"] for row in found if "ratio" in row]
    if heat.aim and ratios:
        worst, peaks = min(ratios), [row["peak_rss_mb"] for row in found if "ratio" in row]
        reached = "reached" if worst >= heat.aim else "MISSED"
        memory = f"{found[0]['peak_rss_mb'] / min(peaks):.2f} of the least" if "rss_at_start_mb" in found[1] else ""
        yield f"| | aim: at least {heat.aim} | {reached} | {worst:.2f} | {memory} |"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kinelm", type=pathlib.Path, default=ROOT / "target" / "release" / "kinelm")
    parser.add_argument("--only", choices=["train", "decode"])
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
    print("| what | who | tokens/s: median (lowest to highest round) | kinelm / it | peak MB |\n|---|---|---|---|---|", flush=True)
    for heat in chosen:
        for turn in range(rounds):
            for entry in heat.entries[:: -1 if turn % 2 else 1]:
                machine.pause(1)
                entry.run()
        print("\n".join(table(heat)), flush=True)
        out += rows(heat)
    verdict = machine.verdict()
    print(f"\n{verdict['said']}")
    if args.json:
        lines = [*out, {"schema": 1, "what": "machine", "facts": facts(args), **verdict}]
        args.json.write_text("".join(json.dumps(line) + "\n" for line in lines))
    if verdict["quiet"] is False:
        print("take the ratios with care and run it again", file=sys.stderr)


if __name__ == "__main__":
    main()
