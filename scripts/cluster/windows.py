"""Corpus folders and the windows of a training, as kinelm cuts and orders them (crates/corpus/src, crates/train/src/batches.rs).

T tokens of context, K of them in front (`<bos>` and a label a field), word tokens behind. Windows begin at a word.
"""
import json
import math
from pathlib import Path

import numpy as np

import streams
from forecast import HISTORY

UNKNOWN, MASK, SPACE = 4, 3, 5
WITHOUT_HISTORY = 0.1  # share of the windows that are read as if a clip began with them
FIRST_FIELDS = ["genre", "dancer", "music", "situation", "choreography"]


class Corpus:
    """`corpus.json`, `clips.jsonl`, and the tokens by memory map."""

    def __init__(self, folder):
        self.folder = Path(folder)
        self.manifest = json.loads((self.folder / "corpus.json").read_text())
        if self.manifest["version"] != 5:
            raise SystemExit(f"{folder}/corpus.json: found version {self.manifest['version']}; expected version 5")
        self.clips = [json.loads(line) for line in (self.folder / "clips.jsonl").read_text().splitlines() if line]
        kind = self.manifest["token_type"]
        path = self.folder / f"tokens.{kind}"
        if path.stat().st_size != self.manifest["tokens"]["bytes"]:
            raise SystemExit(f"{path}: found {path.stat().st_size} bytes; expected {self.manifest['tokens']['bytes']}")
        self.tokens = np.memmap(path, {"u16": "<u2", "u32": "<u4"}[kind], "r") if path.stat().st_size else np.zeros(0, "<u2")
        self.word = self.manifest["tokens_per_word"]  # None where words differ in length
        self.starts = {}

    def split(self, name):
        """Numbers of a split's clips that have a frame."""
        return [i for i, c in enumerate(self.clips) if c["split"] == name and c["frames"] > 0]

    def ids(self, clip, start, end):
        first = self.clips[clip]["offset"]
        return self.tokens[first + start : first + end].astype(np.int64)

    def words(self, clip):
        """Where each word of a clip begins and its last one ends, in tokens from the clip's first."""
        if clip not in self.starts:
            total = self.clips[clip]["tokens"]
            spaces = lambda: np.flatnonzero(self.ids(clip, 0, total) == SPACE)
            ends = np.arange(self.word, total + 1, self.word) if self.word else spaces() + 1
            self.starts[clip] = np.concatenate([[0], ends])
        return self.starts[clip]

    def frames(self, clip, words):
        """Frames of a clip's first `words` words."""
        return np.minimum(self.clips[clip]["frames"], np.asarray(words) * self.manifest["frames_per_word"])

    def count(self, name, what):
        """Tokens or frames of a split."""
        return sum(c[what] for c in self.clips if c["split"] == name)


class Conditions:
    """Labels as tokens in front of a window: fields in their order, ids from the `<field:value>` of tokenizer.json."""

    def __init__(self, fields, tokenizer):
        rank = lambda f: (FIRST_FIELDS.index(f) if f in FIRST_FIELDS else len(FIRST_FIELDS), f)
        self.fields = sorted(fields, key=rank)
        added = {t["content"]: t["id"] for t in tokenizer["added_tokens"]}
        self.ids = {**tokenizer["model"]["vocab"], **added}

    def front(self, labels, bos):
        return [bos] + [self.ids.get(f"<{f}:{labels[f]}>", UNKNOWN) if f in labels else UNKNOWN for f in self.fields]


class Windows:
    """The training windows of some corpora: those of kinelm with the same seed, or those of an order that it wrote.

    `parts`: (corpus, weight) each. A pass takes weight times a corpus's windows: whole rounds of them, and a drawn part of a
    round, of which the next pass takes the rest.
    """

    def __init__(self, parts, conditions, config, tokens, train, order=None, context=None, first=0, batch=None):
        self.conditions, self.tokens, self.order_file = conditions, tokens, order
        self.context, self.masked, self.seed = context or config.context, config.kind == "masked", train["seed"]
        self.rows, self.first = (batch or train["batch"]) * train["accumulate"], first  # of a step; the first of its steps
        self.label_dropout = train["label_dropout"]
        self.history = history(config, tokens)
        self.room = self.context - config.context + room(config, tokens)
        self.clips, self.shares, ends = [], [], [0]  # (corpus, clip); per corpus: first window, windows, those of a pass
        for corpus, weight in parts:
            whole = self.room // corpus.word if corpus.word else None
            if self.room < 1 or whole == 0:
                raise SystemExit(f"a context of {self.context} tokens doesn't hold one word of {corpus.word}")
            first = ends[-1]
            for clip in corpus.split("train"):
                tokens_, words = corpus.clips[clip]["tokens"], len(corpus.words(clip)) - 1
                ends.append(ends[-1] + (-(-words // whole) if whole else -(-tokens_ // self.room)))
                self.clips.append((corpus, clip))
            if ends[-1] == first:
                raise SystemExit(f"{corpus.folder}: no training clip; expected a corpus with training clips")
            self.shares.append((first, ends[-1] - first, max(1, math.floor(weight * (ends[-1] - first) + 0.5))))
        self.ends = np.array(ends[1:])
        self.per_pass = sum(of_pass for *_, of_pass in self.shares)
        self.drawn = None, None

    def where(self, step, rows):
        """Of these rows of a step: corpus, clip, first token, number of tokens, and the (round, window) that randomness goes
        by."""
        places = [divmod((step - self.first) * self.rows + r, self.per_pass) for r in rows]
        keys = [self.order(number)[at] for number, at in places]
        if self.order_file is None:
            return [self.stand(*key) for key in keys]
        found = [map(int, self.order_file[step, r]) for r in rows]
        return [(*self.clips[clip], start, count, key) for key, (clip, start, count) in zip(keys, found)]

    def order(self, number):
        """The windows of a pass, (round, window) each."""
        if self.drawn[0] != number:
            found = []
            for first, windows, of_pass in self.shares:
                start, end = number * of_pass, (number + 1) * of_pass
                for round in range(start // windows, -(-end // windows)):
                    low, high = max(start - round * windows, 0), min(end - round * windows, windows)
                    taken = range(windows)
                    if (low, high) != (0, windows):
                        taken = sorted(streams.shuffled(self.seed, "round", round, windows, first)[low:high])
                    found += [(round, first + w) for w in taken]
            self.drawn = number, [found[i] for i in streams.shuffled(self.seed, "order", number, len(found))]
        return self.drawn[1]

    def stand(self, round, window):
        """Where a window stands: its clip's possible starts are cut into stretches, and one start is drawn in its own."""
        index = int(np.searchsorted(self.ends, window, "right"))
        before = int(self.ends[index - 1]) if index else 0
        (corpus, clip), stretch, stretches = self.clips[index], window - before, int(self.ends[index]) - before
        words = corpus.words(clip)
        total = int(words[-1])
        starts = min(int(np.searchsorted(words[:-1], max(0, total - self.room), "left")) + 1, len(words) - 1)
        low, high = starts * stretch // stretches, starts * (stretch + 1) // stretches
        first, second = streams.units(self.seed, "window", round, 2, window)
        word = low + int(first * (high - low))
        start, end = int(words[word]), int(words[word + 1])
        if end - start > self.room:  # begun anywhere, so that its end is seen too
            start += int(second * (end - start - self.room + 1))
        return corpus, clip, start, min(total - start, self.room), (round, window)

    def batch(self, step, rows):
        """Inputs and targets (len(rows), T) of some rows of a step, counted from 0."""
        pairs = [self.window(*row) for row in self.where(step, rows)]
        return tuple(np.stack(side) for side in zip(*pairs))

    def window(self, corpus, clip, start, count, place):
        front = self.conditions.front(corpus.clips[clip]["labels"], self.tokens.bos)
        hidden = streams.units(self.seed, "label dropout", place[0], len(front) - 1, place[1]) < self.label_dropout
        front = front[:1] + [UNKNOWN if h else id for h, id in zip(hidden, front[1:])]
        ids = corpus.ids(clip, start, start + count)
        if self.masked:
            return masked(ids, front, self.tokens.pad, self.context, chosen(count, self.seed, *place))
        inputs, targets = causal(ids, front, self.tokens.pad, self.context)
        hidden = self.history and streams.units(self.seed, "history", place[0], 1, place[1])[0] < WITHOUT_HISTORY
        before = corpus.ids(clip, start if hidden else max(0, start - self.history), start)
        return with_history(inputs, len(front), before, self.history, self.tokens.pad), targets


class Stages:
    """Windows that grow (crates/train/src/stages.rs): those of `[[train.stages]]`, each until a share of the steps, then the model's."""

    def __init__(self, parts, conditions, config, tokens, train, order=None):
        known, first, before, self.all = {"until", "frames", "batch"}, 0, 0.0, []
        whole = room(config, tokens) // tokens.word
        if train["stages"] and (order is not None or tokens.varying):
            raise SystemExit("train.stages: words that differ in length and orders of --order have no windows that grow")
        for i, stage in enumerate(train["stages"], 1):
            right = stage.keys() == known and before < stage["until"] < 1 and 0 < stage["frames"] <= whole
            if not right or stage["batch"] < 1:
                wanted = f"until above {before} and below 1, frames 1 to {whole}, batch 1 or more"
                raise SystemExit(f"train.stages: stage {i} is {stage}; expected {wanted}")
            context = stage["frames"] * tokens.word + config.context - room(config, tokens)
            self.all.append(Windows(parts, conditions, config, tokens, train, None, context, first, stage["batch"]))
            before, first = stage["until"], math.floor(stage["until"] * train["steps"] + 0.5)
        self.all.append(Windows(parts, conditions, config, tokens, train, order, first=first))
        self.fewest = min(w.rows for w in self.all)  # windows of a step

    def at(self, step):
        """The windows of a step's stage."""
        return [w for w in self.all if w.first <= step][-1]


def history(config, tokens):
    """Tokens of the frames before a window that a model reads."""
    return HISTORY * tokens.word if getattr(config, "forecast", False) else 0


def with_history(inputs, front, before, length, pad):
    """A window's inputs with `length` tokens behind the front: padding, and the tokens `before` the window."""
    return np.concatenate([inputs[:front], np.full(length - len(before), pad, np.int64), before, inputs[front:]])


def room(config, tokens):
    """Word tokens of a window: a masked model's last input is one of them, a causal model's last target another."""
    return config.context - tokens.front + (0 if config.kind == "masked" else 1)


def causal(ids, front, pad, length):
    """Input `front t0 t1 ..`, target `t0 t1 ..` from the last token of the front on; filled up with pad."""
    K, n = len(front), len(ids)
    inputs, targets = np.full(length, pad, np.int64), np.full(length, pad, np.int64)
    inputs[:K], targets[K - 1 : K - 1 + n] = front, ids
    shown = min(n, length - K)
    inputs[K : K + shown] = ids[:shown]
    return inputs, targets


def masked(ids, front, pad, length, choice):
    """No shift; the chosen places are targets, some of them `<mask>` in the input: `choice` is (places, hidden)."""
    K, (places, hidden) = len(front), choice
    inputs, targets = np.full(length, pad, np.int64), np.full(length, pad, np.int64)
    inputs[:K], inputs[K : K + len(ids)] = front, ids
    targets[K + places] = ids[places]
    inputs[K + places[hidden]] = MASK
    return inputs, targets


def chosen(count, seed, number, window):
    """The places of a masked window that count: 15 % of them, rounded up, nine in ten of these hidden."""
    units = streams.units(seed, "mask", number, 2 * count, window)
    order = np.argsort(units[:count], kind="stable")[: math.ceil(0.15 * count)]
    places = np.sort(order)
    return places, units[count + np.arange(len(places))] < 0.9


def eval_windows(words, context):
    """Measuring windows of a clip whose words begin at `words[:-1]`: (start, tokens, first that is scored).

    As many whole words as fit, moved by half of them; every token is scored once.
    """
    total, found = int(words[-1]), []
    at = lambda token: int(np.searchsorted(words[:-1], token, "left"))  # words that begin before a token
    first = lambda word: int(words[min(word, len(words) - 1)])
    start = done = 0
    while done < total:
        full = min(total, start + context)
        end = first(max(0, at(full + 1) - 1))
        end = end if full < total and end > done else full
        found.append((start, end - start, done - start))
        done = end
        half = first(max(0, at(start + (end - start) // 2 + 1) - 1))
        later = [n for n in (half, first(at(start + 1))) if start < n <= end]
        start = later[0] if later else start + max(1, context // 2)
    return found
