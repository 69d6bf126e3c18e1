"""kinelm's language model in plain PyTorch: every input and every head, under the names that kinelm writes on disk.

B windows, T tokens of a window, K of them in front, V ids, W tokens of a word (its space is the last), D width, H heads.
Matrices are (in, out). A causal model's input i predicts word token k = i - (K - 1), which stands at place k mod W of its
word; a masked one's predicts the token that stands at i itself.
"""
import math
from dataclasses import dataclass, field

import torch
from torch import nn
from torch.nn import functional as F


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
    """The `[model]` table."""

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


class Table(nn.Module):
    """Rows of D numbers, Normal(0, 0.02)."""

    def __init__(self, rows, width):
        super().__init__()
        self.weight = nn.Parameter(0.02 * torch.randn(rows, width))

    def forward(self, rows):
        return F.embedding(rows, self.weight)


class Linear(nn.Module):
    def __init__(self, i, o, sd=0.02):
        super().__init__()
        self.weight = nn.Parameter(sd * torch.randn(i, o))
        self.bias = nn.Parameter(torch.zeros(o))

    def forward(self, x):
        return F.linear(x, self.weight.T, self.bias)


class Attention(nn.Module):
    def __init__(self, c, residual):
        super().__init__()
        self.heads, self.causal, self.dropout = c.heads, c.kind == "causal", c.dropout
        self.qkv, self.out = Linear(c.width, 3 * c.width), Linear(c.width, c.width, residual)

    def forward(self, x, turn):
        B, T, D = x.shape
        q, k, v = self.qkv(x).view(B, T, 3, self.heads, D // self.heads).permute(2, 0, 3, 1, 4)  # (B, H, T, d) each
        if turn is not None:
            q, k = rotate(q, turn).to(v.dtype), rotate(k, turn).to(v.dtype)
        share = self.dropout if self.training else 0.0
        mixed = F.scaled_dot_product_attention(q, k, v, is_causal=self.causal, dropout_p=share)
        return self.out(mixed.transpose(1, 2).reshape(B, T, D))


class Mlp(nn.Module):
    def __init__(self, c, residual):
        super().__init__()
        self.up, self.down = Linear(c.width, 4 * c.width), Linear(4 * c.width, c.width, residual)

    def forward(self, x):
        return self.down(F.gelu(self.up(x), approximate="tanh"))


class Block(nn.Module):
    def __init__(self, c):
        super().__init__()
        residual = 0.02 / math.sqrt(2 * c.layers)
        self.norm1, self.norm2 = nn.LayerNorm(c.width, 1e-5), nn.LayerNorm(c.width, 1e-5)
        self.attention, self.mlp, self.drop = Attention(c, residual), Mlp(c, residual), nn.Dropout(c.dropout)

    def forward(self, x, turn):
        x = x + self.drop(self.attention(self.norm1(x), turn))
        return x + self.drop(self.mlp(self.norm2(x)))


class Head(nn.Module):
    """`weight` (V, D) unless tied; `circular` and `clamped`: rows for the steps from the frame before."""

    def __init__(self, c, tokens):
        super().__init__()
        if not c.tied_head:
            self.weight = nn.Parameter(0.02 * torch.randn(tokens.vocabulary, c.width))
        counts = lambda circular: [n for _, n, goes in tokens.place_ids() if goes == circular]
        if c.head == "relative" and counts(True):
            self.circular = Table(max(counts(True)), c.width)
        if c.head == "relative" and counts(False):
            self.clamped = Table(2 * max(counts(False)) - 1, c.width)


class Gpt(nn.Module):
    def __init__(self, config, tokens):
        super().__init__()
        self.config, self.tokens = config.resolved(tokens), tokens
        c, W = self.config, tokens.word
        self.token = Table(tokens.vocabulary, c.width)
        rows = {"absolute": {"absolute": c.context}, "rope": {"front": tokens.front, "place": W},
                "frame_joint": {"front": tokens.front, "frame": tokens.words(c.context), "place": W}}[c.positions]
        self.position = nn.ModuleDict({name: Table(n, c.width) for name, n in rows.items()})
        if c.previous_frame:
            self.steps = max(n for _, n, _ in tokens.place_ids())
            rows = {"character": tokens.vocabulary, "step": self.steps + 1}
            self.previous = nn.ModuleDict({name: Table(n, c.width) for name, n in rows.items()})
        self.drop = nn.Dropout(c.dropout)
        self.block = nn.ModuleDict({f"{l:02}": Block(c) for l in range(c.layers)})
        self.norm = nn.LayerNorm(c.width, 1e-5)
        self.head = Head(c, tokens)
        # per place of a word: first id, bins, whether they go round; the space has no bins
        kinds = torch.tensor([*tokens.place_ids(), (0, 0, 0)] if tokens.places else [(0, 0, 0)] * W)
        self.register_buffer("kinds", kinds.long(), persistent=False)
        self.plans = {}

    def forward(self, ids):
        """Logits (B, T, V) of inputs (B, T), -inf where an id can't be. Rows of the front that predict nothing have some."""
        x = self.token(ids) + self.places(ids)
        if self.config.previous_frame:
            x = x + self.frame_before(ids)
        turn = turns(self.frames(ids), self.config, x) if self.config.positions == "rope" else None
        x = self.drop(x)
        for block in self.block.values():
            x = block(x, turn)
        return self.logits(self.norm(x), ids)

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

    # --- the frame before

    def earlier(self, ids, words):
        """Of every input: the id that stands `words` frames before what it predicts, -1 where there is none: (B, T)."""
        T, K, by = ids.shape[1], self.tokens.front, words * self.tokens.word
        first = K - 1 + by  # the first input with one
        found = F.pad(ids, (by - 1, 0), value=-1)[:, :T]
        return torch.where(torch.arange(T, device=ids.device) >= first, found, -1)

    def kind_of(self, T):
        """First id, bins, goes round, of the place that each of T inputs predicts: (T) each; no bins in front."""
        shift = self.tokens.front - 1 if self.config.kind == "causal" else self.tokens.front
        k = torch.arange(T, device=self.kinds.device) - shift
        return torch.where((k >= 0)[:, None], self.kinds[k % self.tokens.word], 0).unbind(1)

    def frame_before(self, ids):
        """Embeddings (B, T, D) of the id one frame before what is predicted, and of the step that led to it."""
        a, b = self.earlier(ids, 1), self.earlier(ids, 2)
        first, count, _ = self.kind_of(ids.shape[1])
        bins = lambda x: (x >= first) & (x < first + count)
        step = torch.where(bins(a) & bins(b), (a - b) % count.clamp(min=1), self.steps)
        character = torch.where(a >= 0, a, self.tokens.pad)
        return self.previous["character"](character) + self.previous["step"](step)

    # --- heads

    def logits(self, h, ids):
        """Logits (B, T, V) of states (B, T, D)."""
        B, T, V = *ids.shape, self.tokens.vocabulary
        absolute = self.token.weight if self.config.tied_head else self.head.weight
        if self.config.head == "absolute":
            return h @ absolute.T
        plain, steps = self.answers(T)
        logits = h[:, plain] @ absolute.T
        out = torch.full((B, T, V), -torch.inf, dtype=logits.dtype, device=ids.device)
        out = out.index_copy(1, plain, logits)
        before = self.earlier(ids, 1)
        for name, r, first, n in steps:  # R inputs; (R, 1) of each
            table = getattr(self.head, name).weight
            bin = torch.arange(V, device=ids.device) - first  # (R, V): j of every id
            p = (before[:, r] - first[:, 0]).unsqueeze(2)  # (B, R, 1); no bin only where nothing counts
            there = (bin >= 0) & (bin < n)
            row = (bin - p) % n if name == "circular" else bin - p + len(table) // 2
            found = (h[:, r] @ table.T).gather(2, row.clamp(0, len(table) - 1))
            out = out.index_copy(1, r, found.masked_fill(~there, -torch.inf))
        return out

    def answers(self, T):
        """Of T inputs, those that the head over all ids answers, and those that each table of steps does, with the first
        id and the number of bins of their places. Found once: it would make a GPU wait."""
        if T not in self.plans:
            first, count, circular = (x.cpu() for x in self.kind_of(T))
            late = torch.arange(T) >= self.tokens.front - 1 + self.tokens.word
            relative, goes = late & (count > 0), circular > 0
            rows = lambda which: which.nonzero()[:, 0]
            tables = [("circular", rows(relative & goes)), ("clamped", rows(relative & ~goes))]
            move = lambda *all: [x.to(self.kinds.device) for x in all]
            steps = [(name, *move(r, first[r, None], count[r, None])) for name, r in tables if len(r)]
            self.plans[T] = *move(rows(~relative)), steps
        return self.plans[T]

    def uncounted(self, ids):
        """(B, T) where a target may not count: the relative head has no bin one frame before."""
        if self.config.head == "absolute":
            return torch.zeros_like(ids, dtype=torch.bool)
        first, count, _ = self.kind_of(ids.shape[1])
        a = self.earlier(ids, 1)
        return (count > 0) & (a >= 0) & ~((a >= first) & (a < first + count))

    # --- the loss

    def nats(self, logits, targets):
        """-ln p of every target (B, T), 0 where it is pad."""
        flat, pad = widened(logits).flatten(0, 1), self.tokens.pad
        return F.cross_entropy(flat, targets.flatten(), ignore_index=pad, reduction="none").view_as(targets)

    def ordinal(self, logits, targets, width):
        """What is trained instead where bins are ordered: cross-entropy (B, T) with the target's mass spread over bins near
        it, by exp(-d^2 / (2 width^2)) up to 3 widths off, round the circle or up to the ends. Other places keep theirs."""
        first, count, circular = (x[:, None] for x in self.kind_of(targets.shape[1]))  # (T, 1)
        bin = torch.arange(self.tokens.vocabulary, device=targets.device) - first  # (T, V)
        of_target = targets[:, :, None] - first  # (B, T, 1)
        far = (bin - of_target).abs()
        far = torch.where(circular > 0, torch.minimum(far, count - far), far)
        near = (bin >= 0) & (bin < count) & (far <= 3 * width)
        logits = widened(logits)
        share = torch.where(near, torch.exp(-(far.to(logits.dtype) ** 2) / (2 * width**2)), 0.0)
        spread = (of_target >= 0) & (of_target < count)
        one = F.one_hot(targets, self.tokens.vocabulary).to(logits.dtype)
        share = torch.where(spread, share / share.sum(2, keepdim=True).clamp(min=1e-30), one)
        each = torch.where(share > 0, -share * logits.log_softmax(2), 0.0).sum(2)
        return torch.where(targets == self.tokens.pad, 0.0, each)

    def groups(self, decay):
        """Parameters for AdamW: matrices but no embeddings decay."""
        decays = lambda name, p: p.dim() == 2 and not name.startswith(("token.", "position.", "previous."))
        named = list(self.named_parameters())
        pick = lambda which: [p for name, p in named if decays(name, p) == which]
        return [{"params": pick(True), "weight_decay": decay}, {"params": pick(False), "weight_decay": 0.0}]


def widened(x):
    """At least f32: sums of many exponentials want it under autocast."""
    return x if x.dtype == torch.float64 else x.float()


def turns(frames, c, x):
    """Cosines and sines (B or 1, 1, T, d/2) of rope's angles: frame x 10000^(-2j/d)."""
    d = c.width // c.heads
    pair = widened(x).new_tensor(range(d // 2))
    angle = frames[:, None, :, None] * 10000.0 ** (-2 * pair / d)
    return angle.cos(), angle.sin()


def rotate(x, turn):
    """x (B, H, T, d) with its pairs (j, j + d/2) turned."""
    (cos, sin), (a, b) = turn, x.chunk(2, -1)
    return torch.cat([a * cos - b * sin, a * sin + b * cos], -1)
