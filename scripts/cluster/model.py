"""kinelm's language models in plain PyTorch: every input and every head, under the names that kinelm writes on disk.

B windows, T tokens of a window, K of them in front, V ids, W tokens of a word (its space is the last), D width, H heads.
What a row answers is written in answers.py, the model of two levels in two_level.py.
"""
from dataclasses import dataclass, field

import torch
from torch import nn
from torch.nn import functional as F

from answers import Answers
from blocks import Table, stack, turns
from two_level import TwoLevel, TwoLevelConfig


@dataclass
class Tokens:
    """What the tokenizer decides: `tokens` of kinelm.json."""

    vocabulary: int
    word: int
    pad: int
    bos: int
    space: int
    varying: bool = False
    front: int = 1
    places: list = field(default_factory=list)  # [{"number": n, "kind": {"first", "count", "circular"}}]

    def place_ids(self):
        """(first id, number of bins, whether they go round) of every place up to the space; [] where words vary."""
        kind = lambda s: (s["kind"]["first"], s["kind"]["count"], s["kind"]["circular"])
        return [kind(s) for s in self.places for _ in range(s["number"])]

    def words(self, context):
        """Rows of the table of words: those that a window can hold."""
        return -(-max(context + 1 - self.front, 0) // (2 if self.varying else self.word))


@dataclass
class Config:
    """The `[model]` table of one stack of blocks over all tokens."""

    architecture: str = "flat"
    kind: str = "causal"
    layers: int = 4
    heads: int = 4
    width: int = 128
    context: int = 256
    positions: str = "frame_joint"
    dropout: float = 0.0
    tied_head: bool = True
    previous_frame: bool | None = None
    head: str | None = None

    def resolved(self, tokens):
        """With `previous_frame` and `head` decided; what can't be is refused."""
        able = self.kind == "causal" and bool(tokens.places)
        known = {"kind": ("causal", "masked"), "positions": ("absolute", "frame_joint", "rope"),
                 "head": (None, "absolute", "relative")}
        for key, values in known.items():
            if getattr(self, key) not in values:
                raise ValueError(f"model.{key} is {getattr(self, key)!r}; expected one of {values}")
        if (self.previous_frame or self.head == "relative") and not able:
            why = "reads masked tokens" if self.kind != "causal" else "has words without places of one kind"
            raise ValueError(f'previous_frame and the head "relative" need the frame before; this model {why}')
        if self.width % self.heads or (self.positions == "rope" and self.width // self.heads % 2):
            sizes = f"model.width is {self.width} and model.heads {self.heads}"
            raise ValueError(f"{sizes}; expected heads that divide the width, and for rope into an even number")
        previous = able if self.previous_frame is None else self.previous_frame
        head = ("relative" if able else "absolute") if self.head is None else self.head
        return Config(**{**self.__dict__, "previous_frame": previous, "head": head})

    def stated(self):
        """As kinelm.json has it."""
        return dict(vars(self))


class Gpt(Answers):
    """One stack of blocks over all tokens."""

    def __init__(self, config, tokens):
        c, W = config.resolved(tokens), tokens.word
        super().__init__(c, tokens, c.width)
        self.token = Table(tokens.vocabulary, c.width)
        rows = {"absolute": {"absolute": c.context}, "rope": {"front": tokens.front, "place": W},
                "frame_joint": {"front": tokens.front, "frame": tokens.words(c.context), "place": W}}[c.positions]
        self.position = nn.ModuleDict({name: Table(n, c.width) for name, n in rows.items()})
        if c.previous_frame:
            self.steps = max(n for _, n, _ in tokens.place_ids())
            rows = {"character": tokens.vocabulary, "step": self.steps + 1}
            self.previous = nn.ModuleDict({name: Table(n, c.width) for name, n in rows.items()})
        self.drop = nn.Dropout(c.dropout)
        self.block = stack(c)

    def states(self, ids):
        """(B, T, D) of inputs (B, T)."""
        x = self.token(ids) + self.places(ids)
        if self.config.previous_frame:
            x = x + self.frame_before(ids)
        turn = turns(self.frames(ids), self.config, x) if self.config.positions == "rope" else None
        x = self.drop(x)
        for block in self.block.values():
            x = block(x, turn)
        return x

    def ids_table(self):
        return self.token.weight if self.config.tied_head else self.head.weight

    # --- places

    def stands(self, ids):
        """Word of the window and place in the word of every input behind the front: (B or 1, T - K) each."""
        K, W = self.tokens.front, self.tokens.word
        if not self.tokens.varying:
            k = torch.arange(ids.shape[1] - K, device=ids.device)[None]
            return k // W, k % W
        ends = (ids[:, K:] == self.tokens.space).long()
        word = ends.cumsum(1) - ends  # spaces before it
        k = torch.arange(ends.shape[1], device=ids.device)[None]
        behind = torch.where(ends > 0, k + 1, 0).cummax(1).values  # where the word behind the last space begins ...
        start = F.pad(behind, (1, 0))[:, :-1]  # ... seen from the token behind it
        return word, (k - start).clamp(max=W - 1)

    def places(self, ids):
        """What is added for the places, (B or 1, T, D)."""
        T, table = ids.shape[1], self.position
        if "absolute" in table:
            return table["absolute"].weight[None, :T]
        word, place = self.stands(ids)
        x = table["place"](place)
        if "frame" in table:
            x = x + table["frame"](word.clamp(max=len(table["frame"].weight) - 1))
        return torch.cat([table["front"].weight[None, :T].expand(len(x), -1, -1), x], 1)

    def frames(self, ids):
        """Frame numbers (B or 1, T) that rope turns by: 0 in front, then from 1."""
        return F.pad(1 + self.stands(ids)[0], (self.tokens.front, 0))

    def frame_before(self, ids):
        """Embeddings (B, T, D) of the id one frame before what is predicted, and of the step that led to it."""
        a, b = self.earlier(ids, 1), self.earlier(ids, 2)
        first, count, _ = self.kind_of(ids.shape[1])
        bins = lambda x: (x >= first) & (x < first + count)
        step = torch.where(bins(a) & bins(b), (a - b) % count.clamp(min=1), self.steps)
        character = torch.where(a >= 0, a, self.tokens.pad)
        return self.previous["character"](character) + self.previous["step"](step)


def config_of(table):
    """The `[model]` table as the configuration of its architecture; ValueError names what isn't known."""
    kinds = {"flat": Config, "two_level": TwoLevelConfig}
    kind = kinds.get(table.get("architecture", "flat"))
    if kind is None:
        raise ValueError(f"model.architecture is {table['architecture']!r}; expected one of {', '.join(kinds)}")
    for key in table:
        if key not in kind.__dataclass_fields__:
            raise ValueError(f"[model] has `{key}`; expected one of {', '.join(kind.__dataclass_fields__)}")
    return kind(**table)


def build(config, tokens):
    """The model of a configuration."""
    return (Gpt if isinstance(config, Config) else TwoLevel)(config, tokens)
